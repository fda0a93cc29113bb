"""Teeth that part and meet: closed forms, energy over many contacts, and the band of two motions."""

from dataclasses import replace

import numpy as np
import pytest
from gear_pair import (
    Curve,
    by_scipy,
    constant,
    driven,
    output,
    pair,
    rectangle,
    turning,
    worst,
)

from data_synth.dynamics.system import Mesh, System
from data_synth.integrators.driver import integrate
from data_synth.integrators.problem import IntegrationError, Load, Output, Problem, State
from data_synth.vibration.steady_state import periodic_state

HALF_GAP, AMPLITUDE = 1.0, 3.0
SPEED = AMPLITUDE - HALF_GAP  # through the gap
PERIOD = 2 * np.pi + 4 * HALF_GAP / SPEED
DEEP = 50.0  # half a gap so wide that the back flanks are never reached


def mass_between(half_gap, *, decay=0.0, stiffness=None):
    """1 kg on a mesh of 1 N/m."""
    mesh = Mesh(name="m", direction=np.ones(1), stiffness=stiffness or constant(1.0), backlash_m=half_gap)
    return System(
        mass=np.eye(1), damping=np.full((1, 1), 2 * decay), stiffness=np.zeros((1, 1)), meshes=(mesh,), names=("x",)
    )


def read(rate_hz):
    """Read x and x'."""
    return Output(rate_hz=rate_hz, displacement=np.array([[1.0], [0.0]]), velocity=np.array([[0.0], [1.0]]))


def free(half_gap, *, x, v=0.0, load=0.0, duration_s):
    """Return the mass let go."""
    return Problem(
        system=mass_between(half_gap),
        reference=turning(1.0),
        load=Load(constant=np.full(1, load)),
        duration_s=duration_s,
        start=State(displacement=np.full(1, x), velocity=np.full(1, v)),
    )


def swinging(times_s):
    """Let go at AMPLITUDE: a quarter of a cosine, a straight line through the gap, half a sine, and back."""
    at = np.mod(times_s, PERIOD)
    sign = np.where(at < PERIOD / 2, 1.0, -1.0)
    at = np.mod(at, PERIOD / 2) - np.pi / 2
    inside, straight = at - 2 * HALF_GAP / SPEED, HALF_GAP - SPEED * at
    cosine, sine = HALF_GAP - SPEED * np.sin(at), -HALF_GAP - SPEED * np.sin(inside)
    return sign * np.where(at < 0, cosine, np.where(inside < 0, straight, sine))


def relative_energy(values, half_gap=HALF_GAP):
    """Return how far the energy of x, x' is from that of the amplitude, relative to it."""
    x, v = values.T
    return (v**2 + np.maximum(np.abs(x) - half_gap, 0) ** 2) / SPEED**2 - 1


def run(problem, output, *, steps):
    return integrate(problem, output=output, steps=steps)


class TestContacts:
    def test_a_mass_between_two_walls_is_the_closed_form(self):
        problem = free(HALF_GAP, x=AMPLITUDE, duration_s=50 * PERIOD)
        errors = []
        for steps in (16, 64):
            found = run(problem, read(7.3 / PERIOD), steps=steps)
            errors.append(np.max(np.abs(found.values[:, 0] - swinging(found.times_s))))
        assert errors[1] < 3e-4
        assert errors[1] < errors[0] / 5  # second order gains 16; each of 200 contacts falls anywhere within a step

    def test_under_load_the_backbone(self):
        # x'' + max(x, 0) = 1 about x = 1 with amplitude 2: Omega = pi / (pi - acos(1/a) + sqrt(a^2 - 1))
        period = 2 * (np.pi - np.arccos(1 / 2) + np.sqrt(3))
        assert 2 * np.pi / period == pytest.approx(0.821021053874, abs=1e-12)
        problem = free(DEEP, x=DEEP + 3.0, load=1.0, duration_s=10 * period)
        values = run(problem, read(10 / period), steps=64).values[::10]
        np.testing.assert_allclose(values, [[DEEP + 3, 0]] * 11, atol=1e-3)

    def test_teeth_that_touch_and_no_more(self):
        # amplitude 1 about x = 1: at the edge of the gap for an instant each period, where x = 1 + cos t never leaves
        problem = free(DEEP, x=DEEP + 2.0, load=1.0, duration_s=100.0)
        found = run(problem, read(3.0), steps=4)
        np.testing.assert_allclose(found.values[:, 0], DEEP + 1 + np.cos(found.times_s), atol=1e-10)

    @pytest.mark.parametrize("x", [HALF_GAP, -HALF_GAP, 0.3])
    def test_at_rest_in_the_gap_or_on_its_edge(self, x):
        values = run(free(HALF_GAP, x=x, duration_s=10.0), read(1.0), steps=64).values
        # within the gap the mean stiffness, in the exact flow, is taken off again by impulses of fourth order
        np.testing.assert_allclose(values, [[x, 0]] * 11, atol=1e-8)

    def test_two_gaps_by_scipy(self):
        other = Mesh(
            name="other",
            direction=np.array([0.0, 0.1, 1.0, 0.0]),
            stiffness=rectangle(2e5, 5e5, 0.3),
            cycles_per_rev=2.7,
            backlash_m=1e-5,
        )
        system = pair(rectangle(), damping=np.diag([50.0, 0, 50, 0]), backlash_m=2e-5)
        problem = driven(replace(system, meshes=(*system.meshes, other)), duration_s=0.005, reference=turning(3000.0))
        values = run(problem, output(20e3), steps=16).values
        scipys = by_scipy(problem, output(20e3), relative=1e-11, absolute=1e-16)
        # scipy steps over jumps and kinks by trial
        assert worst(values, scipys) < 1e-7


class TestEnergy:
    def test_of_the_splitting_stays_bounded_and_falls_with_the_square_of_the_step(self):
        # a contact anywhere in a step changes the energy a little, up or down; the nine motions are independent
        largest = []
        for steps in (25, 50, 100):
            walks = [walk(steps, x, oscillations=1000) for x in np.linspace(1.5, 3.0, 9)]
            largest.append(rms([most for _, most in walks]))
        # two halvings gain 4^2 or more
        assert largest[0] > 16 * largest[2]
        walks = [walk(100, x, oscillations=2500) for x in np.linspace(1.5, 3.0, 18)]
        # 2.5 times as long, and hardly farther from where it began: a walk would come sqrt(2.5) times as far
        assert rms([most for _, most in walks]) < 1.5 * largest[2] < 2e-3
        # the slopes are a sample whose mean has a standard error
        slopes = np.array([slope for slope, _ in walks])
        assert abs(slopes.mean()) < 3 * slopes.std(ddof=1) / np.sqrt(slopes.size)


def walk(steps, x, *, oscillations):
    """Return the slope of the energy per oscillation of `steps` steps or so, and its largest departure."""
    # somewhere in contact, always with the same energy; a whole number of steps would keep in step with contacts
    v = np.sqrt(SPEED**2 - (x - HALF_GAP) ** 2)
    problem = free(HALF_GAP, x=x, v=v, duration_s=oscillations * PERIOD)
    # read at every fifth step: what a contact has changed stays until the next
    rate_hz = 1.037 * steps / PERIOD / 5
    found = integrate(problem, output=read(rate_hz), steps=5)
    energies = relative_energy(found.values)
    return float(np.polyfit(found.times_s / PERIOD, energies, 1)[0]), float(np.max(np.abs(energies)))


def rms(values):
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def motion(speed, start):
    """Return a periodic motion of x'' + 2 z x' + (1 + kappa cos(Omega t)) max(x, 0) = 1 at (z, kappa) = (0.02, 0.1)."""
    # steps of 0.016 rad: kinks within them move folds by less than 1e-4
    return periodic_state(parametric(speed, start), output=read(1.0), samples=400)


def parametric(speed, start):
    """Return the oscillator over one period."""
    stiffness = Curve(value=lambda p: 1 + 0.1 * np.cos(2 * np.pi * p), mean=1.0)
    return Problem(
        system=mass_between(DEEP, decay=0.02, stiffness=stiffness),
        reference=turning(speed),
        load=Load(constant=np.ones(1)),
        duration_s=2 * np.pi / speed,
        start=start,
    )


@pytest.fixture(scope="module")
def motions():
    """Return the small and the large motion at 0.88, after forty periods from two starts."""
    found = []
    for x in (1.0, 2.5):
        problem = parametric(0.88, State(displacement=np.full(1, DEEP + x), velocity=np.zeros(1)))
        wait = replace(problem, duration_s=40 * problem.duration_s)
        near = integrate(wait, output=read(0.88 * 50 / np.pi), steps=1).final
        found.append(motion(0.88, near))
    return sorted(found, key=swing)


def followed(state, step, stop):
    """Follow a stable motion from 0.88 on by shooting, each from the one before; return the speed of the last."""
    speed = 0.88
    while abs(step) > 2e-5 and (stop - speed) / step > 1e-9:
        try:
            new = motion(speed + step, state.start)
        except IntegrationError:
            step /= 2
            continue
        if new.stable and abs(swing(new) - swing(state)) < 0.25 * swing(state):
            speed, state = speed + step, new
        else:
            step /= 2
    return speed


class TestTwoMotions:
    def test_both_ends_of_the_band(self, motions):
        # two motions for Omega in 0.785 to 0.950
        small, large = motions
        assert swing(large) > 4 * swing(small)
        low, high = followed(large, -0.02, 0.5), followed(small, 0.02, 1.5)
        # as swept in steps of 0.005: the last with two motions on either side
        assert round(np.ceil(low / 0.005 - 0.02) * 0.005, 3) == 0.785
        assert round(np.floor(high / 0.005) * 0.005, 3) == 0.950
        # the folds themselves, where shooting with scipy's DOP853, restarted at each contact, ends too
        assert low == pytest.approx(0.7850, abs=2e-4)
        assert high == pytest.approx(0.9524, abs=2e-4)
        # each lives on beyond the end of the other
        assert followed(large, 0.02, 0.96) == pytest.approx(0.96)
        assert followed(small, -0.02, 0.76) == pytest.approx(0.76)


def swing(state):
    """Return the peak to peak displacement of a periodic motion."""
    return float(np.ptp(state.waveform.values[:, 0]))
