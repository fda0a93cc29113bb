"""The gear pair from rest to its steady state: published and independently computed facts of its start-up."""

from dataclasses import replace

import numpy as np
import pytest
from gear_pair import DRAG, RADII, TOP_RAD_S, constant, driven, output, pair
from scipy.optimize import least_squares

from data_synth.dynamics.modes import eigenvalues
from data_synth.integrators.driver import integrate
from data_synth.vibration.steady_state import periodic_state

TORQUE_NM = 75.0


@pytest.fixture(scope="module")
def start_up():
    """Return times and q, x2', w2 over 2 s."""
    found = integrate(
        driven(pair(constant()), duration_s=2.0, drag=DRAG),
        output=output(20e3),
        steps=2,
    )
    return found.times_s, found.values


def test_the_ripple_near_half_a_second(start_up):
    times_s, values = start_up
    near = np.abs(times_s - 0.5) < 0.05
    since, speed = times_s[near] - 0.5, values[near, 2]

    def apart(p):
        turn = 2 * np.pi * p[0] * since
        fading = np.exp(-p[1] * since)
        columns = [fading * np.cos(turn), fading * np.sin(turn), *(since**power for power in range(5))]
        whole = np.column_stack(columns) / np.linalg.norm(columns, axis=1)
        return whole @ np.linalg.lstsq(whole, speed, rcond=None)[0] - speed

    rate_hz, decay = least_squares(apart, [110.0, 2.0], x_scale=[1.0, 1.0], xtol=1e-12, ftol=1e-12).x
    # 110.164 Hz is printed; the load's damping still grows a little over the segment
    assert rate_hz == pytest.approx(110.164, abs=1e-3)
    assert decay == pytest.approx(2.31, abs=0.02)


def test_the_steady_transmission_error():
    problem = driven(pair(constant()), duration_s=1e-3, drag=DRAG)
    found = periodic_state(problem, output=output(1.0), samples=20)
    q = found.waveform.values[:, 0]
    np.testing.assert_allclose(q, 1.1877506580e-3, rtol=1e-9)  # eleven digits are given
    assert pytest.approx(1.1877506580e-3, rel=1e-10) == TORQUE_NM / RADII[0] * (1 / 1e6 + 2 / 1e8)


def test_the_load_damps_the_second_mode_and_leaves_the_others():
    # at top speed the quadratic load is a damper of 2 c w: 2.31, 2.1e-3 and 6.4e-4 1/s are printed
    slope = np.diag([0, 0, 0, 2 * DRAG * TOP_RAD_S])
    found = eigenvalues(replace(pair(constant()), damping=slope))
    swinging = found[found.imag > 1]
    decays = -swinging.real[np.argsort(swinging.imag)]
    assert decays[0] == pytest.approx(2.31, abs=5e-3)
    assert decays[1] == pytest.approx(2.1e-3, abs=5e-5)
    assert decays[2] == pytest.approx(6.4e-4, abs=5e-6)
