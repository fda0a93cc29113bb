"""Teeth that change in time, and mesh forces under triangular weights, against equations and sums written down here."""

import gear_pair
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from data_synth.dynamics.system import Mesh, MeshHistory, System
from data_synth.gears.mesh_stiffness import Fourier
from data_synth.gears.transmission_error import PitchError, ProfileError
from data_synth.integrators.driver import integrate, integrate_blocks, steps_for_error
from data_synth.integrators.problem import Output, State

FIRST = Fourier(mean=1e6, harmonics=np.array([2e5, 5e4j]))
LATER = Fourier(mean=0.8e6, harmonics=np.array([1e5 - 1e5j, 8e4]))
SMALL, LARGE = (ProfileError(harmonics_m=np.array([size + 0j])) for size in (1e-5, 4e-5))
JUMPING = PitchError(teeth_m=np.array([0.0, 3e-5, -2e-5]), handover=0.0)
TIMES = np.array([0.004, 0.010, 0.012])
HISTORY = MeshHistory(times_s=TIMES, stiffnesses=(FIRST, LATER, FIRST), errors=(SMALL, LARGE, LARGE))


def changing(history=HISTORY, **settings):
    plain = gear_pair.pair(history.stiffnesses[0], error=history.errors[0], **settings)
    meshes = (Mesh(**{**vars(plain.meshes[0]), "history": history}),)
    return System(**{**vars(plain), "meshes": meshes})


def teeth(t):
    """Stiffness and error that go from one series to the next as straight lines in time."""
    turn = np.exp(1j * gear_pair.MESH_RAD_S * t)
    one = 1e6 + (2e5 * turn + 5e4j * turn**2).real
    other = 0.8e6 + ((1e5 - 1e5j) * turn + 8e4 * turn**2).real
    share = np.interp(t, TIMES, [0, 1, 0])
    return one + share * (other - one), np.interp(t, TIMES[:2], [1e-5, 4e-5]) * turn.real


@pytest.mark.parametrize(("backlash_m", "tolerance"), [(0.0, 4e-6), (2e-4, 2e-4)])
def test_teeth_change_as_their_course_says(backlash_m, tolerance):
    problem = gear_pair.driven(changing(backlash_m=backlash_m), duration_s=0.016)
    found = integrate(problem, output=gear_pair.output(25_000), steps=8)
    expected = gear_pair.by_scipy(problem, gear_pair.output(25_000), relative=1e-10, teeth=teeth)
    # a history stands still for a step: second order, as are contacts of teeth that part
    assert gear_pair.worst(found.values, expected) < tolerance
    still = integrate(
        gear_pair.driven(gear_pair.pair(FIRST, error=SMALL), duration_s=0.016),
        output=gear_pair.output(25_000),
        steps=8,
    )
    assert gear_pair.worst(still.values, expected) > 0.01


def test_blocks_cut_a_course_nowhere():
    problem = gear_pair.driven(changing(), duration_s=0.016)
    hats = Output(rate_hz=25_000, weighted_mesh_force=np.ones((1, 1)))
    whole = integrate(problem, output=hats, steps=2)
    blocks = [
        *integrate_blocks(problem, output=hats, steps=2, block=7),
    ]
    # the same numbers in another order of sums
    assert_allclose(np.concatenate([block.values for block in blocks]), whole.values, rtol=1e-9)


@pytest.mark.parametrize("stiffness", [gear_pair.rectangle(), gear_pair.ten_harmonics()])
@pytest.mark.parametrize("sense", [1, -1])
def test_an_error_that_jumps_needs_no_finer_steps(stiffness, sense):
    """As teeth of other pitch take over at once; beside jumps of the stiffness, and alone.

    Backwards the first step leaves a jump behind: the value at its beginning is that of the other side.
    """
    turning = gear_pair.turning(sense * gear_pair.MESH_RAD_S)
    problem = gear_pair.driven(gear_pair.pair(stiffness, error=JUMPING), duration_s=0.01, reference=turning)
    expected = gear_pair.by_scipy(problem, gear_pair.output(20_000), relative=1e-10)
    settings = {"output": gear_pair.output(20_000)}
    errors = [gear_pair.worst(integrate(problem, steps=steps, **settings).values, expected) for steps in (1, 4)]
    # an error taken for a parabola between its values would make 4e-3 and 2e-3 of it
    assert errors[0] < 1e-6
    assert errors[1] < errors[0] / 10


@pytest.mark.parametrize("backlash_m", [0.0, 2e-5])
def test_errors_that_jump_change_as_their_course_says(backlash_m):
    """Against steps a hundred times as fine, through a history whose errors all jump."""
    larger = PitchError(teeth_m=3 * JUMPING.teeth_m, handover=0.0)
    history = MeshHistory(times_s=TIMES, stiffnesses=(FIRST, LATER, FIRST), errors=(JUMPING, larger, JUMPING))
    problem = gear_pair.driven(changing(history, backlash_m=backlash_m), duration_s=0.016)
    settings = {"output": gear_pair.output(25_000)}
    coarse, middle, fine = (integrate(problem, steps=steps, **settings).values for steps in (2, 8, 200))
    assert gear_pair.worst(coarse, fine) < 5e-3
    assert gear_pair.worst(middle, fine) < gear_pair.worst(coarse, fine) / 4


def hats_by_exponentials(damping, *, samples, per_period, fine):
    """Weighted mesh force of the damped pair, and that at samples, by `expm` of its equations and Simpson's rule.

    A sample is ``fine`` parts of a mesh period that is cut into ``per_period``: all jumps lie on edges of parts.
    """
    step = gear_pair.PERIOD_S / per_period
    system = gear_pair.pair(gear_pair.rectangle(), damping=damping)
    g = system.meshes[0].direction
    halves = {}
    for k in (0.76e6, 1.36e6):
        whole = np.zeros((9, 9))
        whole[:4, 4:8] = np.eye(4)
        whole[4:8, :4] = -(system.stiffness + k * np.outer(g, g)) / gear_pair.MASSES[:, None]
        whole[4:8, 4:8] = -damping / gear_pair.MASSES[:, None]
        whole[5, 8] = gear_pair.TORQUE_NM / gear_pair.MASSES[1]
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


def test_a_hat_by_matrix_exponentials():
    # a sample is 0.31 of a period: jumps fall anywhere within samples
    damping, rate_hz = np.diag([50.0, 0, 50, 0]), 100 / 31 / gear_pair.PERIOD_S
    output = Output(rate_hz=rate_hz, weighted_mesh_force=np.array([[1.0], [0.0]]), mesh_force=np.array([[0.0], [1.0]]))
    problem = gear_pair.driven(gear_pair.pair(gear_pair.rectangle(), damping=damping), duration_s=60 / rate_hz)
    found = integrate(problem, output=output, steps=32).values
    hats, points = hats_by_exponentials(damping, samples=60, per_period=100, fine=31)
    # parts of 7.5 us turn the fastest mode by 0.03 rad: Simpson's rule is off by its fourth power over 2880
    assert gear_pair.worst(found[1:, :1], hats[:, None]) < 2e-9
    # the 31st sample of a hundred lies on a jump, where rounding decides between both sides
    beside_jumps = ~np.isin(np.arange(1, 61) * 31 % 100, (0, 40))
    assert_allclose(found[1:, 1][beside_jumps], points[beside_jumps], rtol=5e-8)


def test_a_hat_weighs_the_force_of_two_samples_where_errors_jump():
    problem = gear_pair.driven(gear_pair.pair(gear_pair.rectangle(), error=JUMPING), duration_s=0.01)
    fine, rate = 400, 20_000
    read = Output(rate_hz=fine * rate, mesh_force=np.ones((1, 1)))
    dense = integrate(problem, output=read, steps=1).values[:, 0]
    hat = (1 - np.abs(np.arange(-fine, fine + 1)) / fine) / fine
    middles = np.arange(fine, dense.size - fine, fine)
    expected = np.array([hat @ dense[at - fine : at + fine + 1] for at in middles])
    output = Output(rate_hz=rate, weighted_mesh_force=np.array([[1.0], [0.0]]), mesh_force=np.array([[0.0], [1.0]]))
    for steps in (1, 3):
        found = integrate(problem, output=output, steps=steps).values
        # the fine sum is off by half a point of it where a jump falls between two
        assert np.std(found[2:, 0] - expected) < 2.5e-4 * np.std(expected)
        # before the start, nothing pressed; the force at samples is that of the fine run, to the error of the steps
        assert found[0, 0] == 0
        assert np.std(found[:, 1] - dense[::fine]) < 2e-4 * np.std(dense)


def test_steps_are_judged_by_what_moves():
    turning = State(displacement=np.zeros(4), velocity=np.array([0, 175.0, 0, 100.0]))
    problem = gear_pair.driven(gear_pair.pair(gear_pair.ten_harmonics()), duration_s=0.02, start=turning)
    speed = Output(rate_hz=5000, velocity=np.array([[0, 0, 0, 1.0]]))

    def run(steps):
        return integrate(problem, output=speed, steps=steps)

    fine = run(128).values
    # 100 rad/s and what swings about them: the error of what swings is what was asked for
    assert np.std(run(steps_for_error(problem, output=speed, relative=3e-6)).values - fine) < 3e-6 * np.std(fine)
