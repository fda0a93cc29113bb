"""Which integrator a problem and a scene take, and mesh forces under triangular weights by exact transitions."""

from dataclasses import replace

import numpy as np
import pytest
from gear_pair import DRAG, MASSES, PERIOD_S, TORQUE_NM, constant, driven, pair, rectangle, ten_harmonics, worst
from moving_pair import motion, scene
from scipy.linalg import expm

from data_synth import explain
from data_synth.dynamics.system import FrictionForce, MeshHistory
from data_synth.gears.mesh_stiffness import Rectangular
from data_synth.gears.transmission_error import ProfileError
from data_synth.integrators.choice import MethodChoice, method_for
from data_synth.integrators.driver import integrate, integrate_blocks
from data_synth.integrators.exact_transition import Transition
from data_synth.integrators.problem import CoupledReference, Load, Output, Steps
from data_synth.integrators.splitting import Splitting

ONE = Steps(per_sample=1)
DAMPED = np.diag([50.0, 0, 50, 0])


JUMPS = driven(pair(rectangle()), duration_s=0.01)
EVEN = {"shape": "constant", "error_um": 0}  # teeth of a scene


def with_mesh(problem, **changes):
    """Return a problem with another mesh."""
    mesh = replace(problem.system.meshes[0], **changes)
    return replace(problem, system=replace(problem.system, meshes=(mesh,)))


class TestChoice:
    @pytest.mark.parametrize(
        "problem",
        [JUMPS, driven(pair(constant()), duration_s=0.01), with_mesh(JUMPS, backlash_m=1e-5)],
        ids=["rectangle", "constant", "gap"],
    )
    def test_what_is_constant_between_jumps_takes_exact_transitions(self, problem):
        assert method_for(problem) == MethodChoice(
            method=Transition(), reason="every stiffness is constant between jumps, and so is the load"
        )

    @pytest.mark.parametrize(
        ("problem", "reason"),
        [
            (driven(pair(ten_harmonics()), duration_s=0.01), "stiffness of mesh 'pair' is not constant between jumps"),
            (driven(pair(rectangle()), duration_s=0.01, drag=DRAG), "the load has a quadratic drag"),
            (replace(JUMPS, load=Load(constant=np.zeros(4), varying=lambda t: np.ones((t.size, 4)))), "load varies"),
            (
                replace(JUMPS, reference=CoupledReference(name="pinion rotation")),
                "reference is coupled to the motion",
            ),
            (with_mesh(JUMPS, error=ProfileError(harmonics_m=np.array([1e-6 + 0j]))), "has a transmission error"),
            (with_mesh(JUMPS, friction=(FrictionForce(direction=np.ones(4), factor=rectangle()),)), "has friction"),
            (
                with_mesh(
                    JUMPS,
                    history=MeshHistory(times_s=np.arange(2.0), stiffnesses=(rectangle(),) * 2, errors=(None, None)),
                ),
                "the teeth of mesh 'pair' change in time",
            ),
            (
                replace(
                    JUMPS,
                    system=replace(
                        JUMPS.system,
                        meshes=tuple(replace(JUMPS.system.meshes[0], cycles_per_rev=1 + 0.1 * n) for n in range(9)),
                    ),
                ),
                "512 combinations",
            ),
        ],
    )
    def test_what_is_not_takes_splitting(self, problem, reason):
        chosen = method_for(problem)
        assert chosen.method == Splitting()
        assert reason in chosen.reason


def hats_by_exponentials(*, samples, per_period, fine):
    """Weighted mesh force of the damped pair, and that at samples, by `expm` of its equations and Simpson's rule.

    A sample is ``fine`` parts of a mesh period that is cut into ``per_period``: all jumps lie on edges of parts.
    """
    step = PERIOD_S / per_period
    system = pair(rectangle(), damping=DAMPED)
    g = system.meshes[0].direction
    halves = {}
    for k in (0.76e6, 1.36e6):
        whole = np.zeros((9, 9))
        whole[:4, 4:8] = np.eye(4)
        whole[4:8, :4] = -(system.stiffness + k * np.outer(g, g)) / MASSES[:, None]
        whole[4:8, 4:8] = -DAMPED / MASSES[:, None]
        whole[5, 8] = TORQUE_NM / MASSES[1]
        halves[k] = expm(whole * step / 2)
    state, forces, points = np.append(np.zeros(8), 1.0), [], [0.0]
    for part in range(samples * fine):
        k = 1.36e6 if (part % per_period) < 0.4 * per_period else 0.76e6
        middle = halves[k] @ state
        end = halves[k] @ middle
        forces.append([k * g @ x[:4] for x in (state, middle, end)])
        state = end
        k_next = 1.36e6 if ((part + 1) % per_period) < 0.4 * per_period else 0.76e6
        points.append(k_next * g @ state[:4])
    forces = np.array(forces).reshape(samples, fine, 3)
    at = (np.arange(fine)[:, None] + np.array([0, 0.5, 1])) / fine
    simpson = np.array([1, 4, 1]) / 6 / fine
    rising = np.sum(forces * at * simpson, axis=(1, 2))
    falling = np.sum(forces * (1 - at) * simpson, axis=(1, 2))
    hats = falling + np.append(0.0, rising[:-1])
    return hats, np.array(points)[fine::fine]


HATS = {"weighted_mesh_force": np.array([[1.0], [0.0]]), "mesh_force": np.array([[0.0], [1.0]])}


class TestHats:
    def test_by_matrix_exponentials(self):
        # a sample is 0.31 of a period: jumps fall anywhere within samples
        output = Output(rate_hz=100 / 31 / PERIOD_S, **HATS)
        problem = driven(pair(rectangle(), damping=DAMPED), duration_s=60 / output.rate_hz)
        found = integrate(problem, method=Transition(), output=output, tolerance=ONE).checked().values
        hats, points = hats_by_exponentials(samples=60, per_period=100, fine=31)
        # parts of 7.5 us turn the fastest mode by 0.03 rad: Simpson's rule is off by its fourth power over 2880
        assert worst(found[1:, :1], hats[:, None]) < 1e-9
        # the 31st sample of a hundred lies on a jump, where rounding decides between both sides
        apart = np.abs(found[1:, 1] / points - 1) > 1e-9
        assert not np.any(apart & (np.arange(1, 61) * 31 % 100 != 0) & (np.arange(1, 61) * 31 % 100 != 40))

    @pytest.mark.parametrize(("gap", "tolerances"), [(0.0, (1e-6, 1e-10)), (2e-5, (1e-4, 1e-7))])
    @pytest.mark.compiles
    def test_splitting_comes_to_them(self, gap, tolerances):
        problem = driven(pair(rectangle(), damping=DAMPED, backlash_m=gap), duration_s=0.05)
        output = Output(rate_hz=20e3, **HATS)
        exact = integrate(problem, method=Transition(), output=output, tolerance=ONE).checked().values
        for steps, tolerance in zip((2, 32), tolerances, strict=True):
            split = integrate(problem, method=Splitting(), output=output, tolerance=Steps(per_sample=steps)).values
            assert worst(split, exact) < tolerance
        blocks = integrate_blocks(problem, method=Transition(), output=output, tolerance=ONE, block=37)
        joined = np.concatenate([block.values for block in blocks])
        np.testing.assert_allclose(joined, exact, rtol=1e-9, atol=1e-9 * np.max(np.abs(exact)))


class TestScenes:
    def test_constant_teeth_take_exact_transitions(self):
        declared = scene(mesh=EVEN, duration_s=0.05)
        ready = motion(declared)
        assert ready.method.method == Transition()
        assert ready.steps() == 1
        (channel,) = np.concatenate(list(ready.channels(samples=1000)), axis=1)
        assert np.ptp(channel) < 1e-9  # they carry a steady torque, and nothing swings
        assert "exact transitions, 1 a sample" in str(explain(declared))

    @pytest.mark.parametrize(
        ("changes", "reason"),
        [
            ({"mesh": {"error_um": 0}}, "the stiffness of mesh 'mesh' is not constant between jumps"),
            ({"mesh": {"shape": "constant"}}, "mesh 'mesh' has a transmission error"),
            ({"mesh": EVEN, "torque": {"link": "gear", "nm": [[0, 100], [1, 130]]}}, "the load varies"),
            ({"mesh": EVEN, "speed": {"link": "pinion", "rpm": [[0, 600], [1, 700]]}}, "the load varies"),
        ],
    )
    def test_others_take_splitting(self, changes, reason):
        declared = scene(duration_s=0.05, **{"mesh": {}, **changes})
        chosen = motion(declared).method
        assert chosen.method == Splitting()
        assert reason in chosen.reason
        (part,) = (part for part in explain(declared).parts if part.name == "fidelity")
        assert f"splitting, for {chosen.reason}, with an error below 1e-05" in part.why

    @pytest.mark.parametrize("fidelity", ["lateral", "torsional"])
    def test_channels_are_those_of_splitting(self, fidelity):
        ready = motion(scene(mesh={**EVEN, "backlash_um": 2}, fidelity=fidelity, duration_s=0.05))
        (mesh,) = ready.system.meshes
        jumping = replace(mesh, stiffness=Rectangular(low=1.5e8, high=2.5e8, duty=0.5))
        exact, split = (replace(ready, system=replace(ready.system, meshes=(jumping,))) for _ in range(2))
        assert exact.method.method == Transition()
        vars(split)["method"] = MethodChoice(method=Splitting(), reason="asked for")
        one, other = (np.concatenate(list(each.channels(samples=1000)), axis=1) for each in (exact, split))
        assert np.ptp(one) > 0
        # the error that the scene allows the splitting, 1e-5
        assert worst(other.T, one.T) < 2e-5
