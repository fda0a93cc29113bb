"""Periodic steady states, their multipliers, and cases where several of them exist."""

import numpy as np
import pytest
from gear_pair import DRAG, PERIOD_S, driven, output, pair, rectangle, turning

from data_synth.dynamics.system import Mesh, System
from data_synth.integrators.problem import IntegrationError, Load, Output, Problem
from data_synth.vibration.steady_state import periodic_state

READ = output(1.0)


def oscillator(stiffness):
    mesh = Mesh(name="m", direction=np.ones(1), stiffness=stiffness)
    zero = np.zeros((1, 1))
    return System(mass=np.eye(1), damping=zero, stiffness=zero, meshes=(mesh,), names=("x",))


class TestGearPair:
    def test_quadratic_load_and_its_slowest_multiplier(self):
        problem = driven(pair(rectangle()), duration_s=PERIOD_S, drag=DRAG)
        found = periodic_state(problem, output=READ, samples=50)
        assert np.abs(found.multipliers).max() == pytest.approx(0.9999995, abs=5e-8)
        assert found.iterations < 10

    def test_half_a_gap_moves_the_teeth_and_nothing_else(self):
        wide, none = (
            periodic_state(
                driven(pair(rectangle(), backlash_m=gap), duration_s=PERIOD_S, drag=DRAG),
                output=READ,
                samples=50,
            ).waveform.values
            for gap in (5e-5, 0.0)
        )
        # the state returns to 1e-11 of itself, and the slowest multiplier keeps 5e-7 of an error a period
        np.testing.assert_allclose(wide[:, 0] - none[:, 0], 5e-5, rtol=0, atol=1e-9)
        np.testing.assert_allclose(wide[:, 2], none[:, 2], rtol=1e-8)

    @pytest.mark.parametrize(
        ("stiffness", "changes", "words"),
        [
            (rectangle(), {}, "still changes by"),  # torques out of balance
            (rectangle(0.0, 2e9, 0.5), {"drag": DRAG}, "s is unstable: the variation"),
        ],
    )
    def test_motion_without_a_steady_state_is_refused(self, stiffness, changes, words):
        with pytest.raises(IntegrationError, match=words):
            periodic_state(driven(pair(stiffness), duration_s=PERIOD_S, **changes), output=READ, samples=4)


class TestMultipliers:
    def test_meissners_equation(self):
        # trace = 2 cos cos - (a/b + b/a) sin sin for a^2 = 1.3, b^2 = 0.7, duty 0.5, period pi
        a, b = np.sqrt(1.3), np.sqrt(0.7)
        x, y = a * np.pi / 2, b * np.pi / 2
        trace = 2 * np.cos(x) * np.cos(y) - (a / b + b / a) * np.sin(x) * np.sin(y)
        assert trace == pytest.approx(-2.089829426306, abs=1e-12)
        problem = Problem(
            system=oscillator(rectangle(0.7, 1.3, 0.5)),
            reference=turning(2.0),
            load=Load(constant=np.ones(1)),
            duration_s=np.pi,
        )
        for samples, tolerance in ((64, 1e-7), (512, 1e-10)):  # steps of 0.05 and 0.006 rad, to the fourth / 72
            found = periodic_state(problem, output=Output(rate_hz=1, displacement=np.eye(1)), samples=samples)
            assert found.multipliers.sum().real == pytest.approx(trace, abs=tolerance)
            assert not found.stable
