"""Integrators against closed forms, 50-digit states, scipy and each other."""

import tracemalloc
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from gear_pair import (
    DIRECTION,
    DRAG,
    LINEAR_DRAG,
    MASSES,
    PERIOD_S,
    RADII,
    Curve,
    by_exponentials,
    by_scipy,
    constant,
    driven,
    output,
    pair,
    rectangle,
    state_output,
    ten_harmonics,
    turning,
    worst,
)
from numpy.testing import assert_allclose

from data_synth.dynamics.system import Mesh, System
from data_synth.gears.transmission_error import Eccentricity
from data_synth.integrators.driver import integrate, integrate_blocks, steps_for_error
from data_synth.integrators.problem import (
    IntegrationError,
    Load,
    Output,
    Problem,
    State,
)
from data_synth.operation.shaft_angle import ShaftAngle

GEAR_DRAG = np.diag([0, 0, 0, LINEAR_DRAG])


class Wobble:
    """A transmission error that repeats after two mesh cycles."""

    period = 2.0

    def __call__(self, phase_cycles):
        return 2e-6 * np.sin(np.pi * np.asarray(phase_cycles))


def run(problem, *, steps=1, rate_hz=50e3, read=output):
    return integrate(problem, output=read(rate_hz), steps=steps).values


class TestStateOracles:
    # x1, x2, q, x2', w2 of the exact set, computed with 50 digits (linear load, from rest)
    AFTER_2652 = (1.158291726597e-5, -1.244479508671e-5, 1.199957237219e-3, 1.505469885551e-4, 132.1547571565)

    def test_constant_stiffness(self):
        problem = driven(pair(constant(), damping=GEAR_DRAG), duration_s=2652 * PERIOD_S)
        values = run(problem, rate_hz=10 / PERIOD_S, read=state_output)
        # 26,520 steps of a propagator rounded to 1.1e-16 each: 3e-12 of the largest entry; x2' is 2 % of its
        # largest, so 1.5e-10 of it
        np.testing.assert_allclose(values[-1], self.AFTER_2652, rtol=5e-10)


def digits_after(bearings, periods, duty=0.4, low=0.76e6, high=1.36e6):
    """x1, x2, q, x2', w2 of the undamped pair under balanced torques in 60 digits, by modes segment by segment."""
    with mpmath.workdps(60):
        g = mpmath.matrix([mpmath.mpf(x) for x in DIRECTION])
        root = [mpmath.sqrt(mpmath.mpf(m)) for m in MASSES]
        base = mpmath.diag([mpmath.mpf(bearings), 0, mpmath.mpf(bearings), 0])
        force = [0, mpmath.mpf(75), 0, -mpmath.mpf(75) * 1.75]
        pieces = []
        for stiffness, share in ((high, duty), (low, 1 - duty)):
            k = base + mpmath.mpf(stiffness) * g * g.T
            scaled = mpmath.matrix(4, 4)
            for i in range(4):
                for j in range(4):
                    scaled[i, j] = k[i, j] / root[i] / root[j]
            squares, shapes = mpmath.eigsy(scaled)
            t = mpmath.mpf(PERIOD_S) * mpmath.mpf(share)
            pieces.append(
                (squares, shapes, t, shapes.T * mpmath.matrix([f / r for f, r in zip(force, root, strict=True)]))
            )
        y, v = mpmath.matrix(4, 1), mpmath.matrix(4, 1)
        for _ in range(periods):
            for squares, shapes, t, push in pieces:
                a, b = shapes.T * y, shapes.T * v
                for i in range(4):
                    if abs(squares[i]) < 1e-30:
                        a[i], b[i] = a[i] + b[i] * t + push[i] * t * t / 2, b[i] + push[i] * t
                        continue
                    w = mpmath.sqrt(squares[i])
                    c, s, rest = mpmath.cos(w * t), mpmath.sin(w * t), push[i] / squares[i]
                    a[i], b[i] = rest + (a[i] - rest) * c + b[i] * s / w, -(a[i] - rest) * w * s + b[i] * c
                y, v = shapes * a, shapes * b
        q = [y[i] / root[i] for i in range(4)]
        return np.array(
            [float(z) for z in (q[0], q[2], RADII[0] * q[1] - RADII[1] * q[3], v[2] / root[2], v[3] / root[3])]
        )


def q_and_speed(rate_hz):
    """Read q and w2, which bearings hardly move."""
    maps = state_output(rate_hz)
    return Output(rate_hz=rate_hz, displacement=maps.displacement[[2, 4]], velocity=maps.velocity[[2, 4]])


@pytest.mark.parametrize(("bearings", "tolerance"), [(1e8, 1.5e-10), (1e12, 1.5e-10), (1e16, 1e-7)])
def test_the_teeth_keep_their_digits_beside_stiff_bearings(bearings, tolerance):
    load = Load(constant=np.array([0, 75.0, 0, -75 * 1.75]))
    system = pair(rectangle(), bearings=bearings)
    problem = Problem(system=system, reference=turning(), load=load, duration_s=500 * PERIOD_S)
    values = run(problem, steps=32, rate_hz=30 / PERIOD_S, read=q_and_speed)
    error = np.abs(values[-1] - digits_after(bearings, 500)[[2, 4]]) / np.sqrt(np.mean(values**2, axis=0))
    # 960 steps to a mesh period: at 1e12 N/m a step turns the fastest mode by 0.3 rad, at 1e16 N/m by 34 rad
    assert np.all(error < tolerance)


class TestOrders:
    def test_the_splitting_has_its_order(self):
        smooth = Curve(value=lambda p: 1e6 + 3e5 * np.cos(2 * np.pi * p))
        system = pair(smooth, damping=GEAR_DRAG + np.diag([50.0, 0, 50, 0]), error=Wobble())
        load = Load(constant=np.array([0, 75.0, 0, 0]), varying=lambda t: np.outer(np.sin(3000 * t), [10, 1, 0, 0]))
        # 5.4 kHz: 4.07 samples to a mesh cycle, so that errors are well above the 1e-10 that tables of phases cost
        problem = Problem(system=system, reference=turning(), load=load, duration_s=0.01)
        reference = by_scipy(problem, output(5.4e3), relative=1e-12, absolute=1e-17)
        errors = [worst(run(problem, steps=s, rate_hz=5.4e3), reference) for s in (1, 2, 4)]
        # 2^4 when the step is halved; a fifth less is left to the next order's share
        assert errors[0] > 12.8 * errors[1] > 12.8**2 * errors[2], errors

    def test_a_load_that_is_a_parabola_in_time_is_exact_in_any_step(self):
        """x = 1 - 2 t + 3 t^2 of an oscillator of 200 rad/s, 3 rad to a step, under the load that this takes."""
        one, w, c = np.eye(1), 200.0, 10.0
        system = System(mass=one, damping=c * one, stiffness=w * w * one, meshes=(), names=("mass x",))

        def x(t):
            return 1 - 2 * t + 3 * t**2

        load = Load(constant=np.full(1, 6.0), varying=lambda t: (w * w * x(t) + c * (6 * t - 2))[:, None])
        start = State(displacement=np.ones(1), velocity=np.full(1, -2.0))
        problem = Problem(system=system, reference=turning(), load=load, duration_s=1.0, start=start)
        found = integrate(problem, output=Output(rate_hz=66.0, displacement=one), steps=1)
        assert_allclose(found.values[:, 0], x(found.times_s), rtol=1e-12)

    def test_a_quadratic_load_keeps_second_order_and_little_error(self):
        problem = driven(pair(ten_harmonics()), duration_s=0.2, drag=DRAG)
        reference = run(problem, steps=32)
        errors = [worst(run(problem, steps=s), reference) for s in (1, 2)]
        assert errors[0] < 3e-6
        assert errors[0] > 3 * errors[1]
        soon = replace(problem, duration_s=0.005)
        assert worst(run(soon, steps=8), by_scipy(soon, output(50e3), relative=1e-10)) < 1e-7


class TestTwoEngines:
    def test_teeth_that_part(self):
        system = pair(ten_harmonics(), damping=np.diag([50.0, 0, 50, 0]), backlash_m=2e-5, error=Wobble())
        problem = driven(system, duration_s=0.01)
        split = run(problem, steps=8)
        assert np.min(split[:, 0]) < 2e-5  # some of it out of contact
        # kinks of the force: second order in the step, 2.5 us
        assert worst(split, by_scipy(problem, output(50e3))) < 1e-5

    def test_backlash_costs_nothing_while_teeth_stay_in_contact(self):
        # steps as coarse as without it: what lies between the flanks, 80 kN of mean stiffness, is in the exact flow
        half_gap, damping = 0.1, np.diag([50.0, 0, 50, 0])
        found = []
        for gap in (0.0, half_gap):
            turned = np.array([0.0, (1.2e-3 + gap) / RADII[0], 0.0, 0.0])  # pressed as 75 Nm press the teeth
            problem = driven(
                pair(ten_harmonics(), damping=damping, backlash_m=gap),
                duration_s=0.01,
                start=State(displacement=turned, velocity=np.zeros(4)),
            )
            found.append(run(problem, rate_hz=3e3))  # 4 steps to a period of the fastest mode
        assert np.min(found[1][:, 0]) > half_gap
        np.testing.assert_allclose(found[1][:, 0] - half_gap, found[0][:, 0], atol=1e-9 * np.max(found[0][:, 0]))
        np.testing.assert_allclose(found[1][:, 1:], found[0][:, 1:], atol=1e-7 * np.max(np.abs(found[0][:, 1:])))

    def test_large_errors_of_teeth_cost_no_steps(self):
        # a gear 5 mm out of its axis, where the load presses teeth by 1 mm: what follows the error is in the exact flow
        error = Eccentricity(teeth=20, eccentricity_m=5e-3, phase_rad=0.7)
        damping, off = np.diag([50.0, 0, 50, 0]), 5e-3 * np.sin(0.7)
        turned = np.array([0.0, (1.2e-3 + off) / RADII[0], 0.0, 0.0])
        problem = driven(
            pair(constant(), damping=damping, error=error),
            duration_s=0.05,
            start=State(displacement=turned, velocity=np.zeros(4)),
        )
        # 4 steps to a period of the fastest mode; 46 to one of the error, a parabola over each
        assert worst(run(problem, rate_hz=3e3), by_scipy(problem, output(3e3))) < 3e-5

    def test_a_run_up_with_two_meshes_by_matrix_exponentials(self):
        other = Mesh(
            name="other",
            direction=np.array([0.0, 0.1, 1.0, 0.0]),
            stiffness=rectangle(2e5, 5e5, 0.3),
            cycles_per_rev=2.7,
        )
        system = pair(rectangle(), damping=GEAR_DRAG)
        system = replace(system, meshes=(*system.meshes, other))
        ramp = ShaftAngle(times_s=np.array([0.0, 0.2]), speeds_hz=np.array([20.0, 900.0]))
        problem = driven(system, duration_s=0.2, reference=ramp)
        exact = by_exponentials(problem, output(50e3))
        errors = [worst(run(problem, steps=s), exact) for s in (1, 2)]
        assert errors[1] < 1e-6
        assert errors[0] > 4 * errors[1]

    def test_gyroscopic_terms(self):
        spin = np.zeros((4, 4))
        spin[0, 2], spin[2, 0] = 400.0, -400.0
        problem = driven(replace(pair(ten_harmonics()), gyroscopic=spin), duration_s=0.01)
        assert worst(run(problem, steps=4), by_scipy(problem, output(50e3), relative=1e-10)) < 1e-7


class TestOutputs:
    def test_blocks_are_the_record(self):
        problem = driven(pair(ten_harmonics(), backlash_m=1e-5, error=Wobble()), duration_s=0.02, drag=DRAG)
        whole = integrate(problem, output=output(50e3), steps=1)
        blocks = list(integrate_blocks(problem, output=output(50e3), steps=1, block=137))
        np.testing.assert_allclose(np.concatenate([b.values for b in blocks]), whole.values, rtol=1e-12)
        np.testing.assert_array_equal(np.concatenate([b.times_s for b in blocks]), whole.times_s)
        assert max(b.times_s.size for b in blocks) == 137

    def test_memory_does_not_grow_with_the_record(self):
        def peak(duration_s):
            problem = driven(pair(rectangle()), duration_s=duration_s)
            tracemalloc.start()
            for _ in integrate_blocks(problem, output=output(20e3), steps=1):
                pass
            _, most = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            return most

        peak(0.1)
        assert peak(20.0) < 1.2 * peak(3.0)  # longer than three blocks, both


class TestAccuracy:
    @pytest.mark.parametrize("relative", [1e-4, 1e-6, 1e-8])
    def test_steps_follow_from_the_error_asked_for(self, relative):
        problem = driven(pair(ten_harmonics(), damping=GEAR_DRAG), duration_s=0.5)
        steps = steps_for_error(problem, output=output(10e3), relative=relative)
        error = worst(run(problem, steps=steps, rate_hz=10e3), run(problem, steps=128, rate_hz=10e3))
        assert error < relative
        assert error > relative / 1e4  # not by brute force: one halving of the step gains 16

    @pytest.mark.parametrize("relative", [1e-2, 1e-3, 1e-4])
    def test_teeth_that_part_are_followed_as_asked(self, relative):
        system = pair(rectangle(), damping=np.diag([50.0, 0, 50, 0]), backlash_m=2e-5)
        problem = driven(system, duration_s=0.2)
        steps = steps_for_error(problem, output=output(5e3), relative=relative)
        assert worst(run(problem, steps=steps, rate_hz=5e3), run(problem, steps=512, rate_hz=5e3)) < relative

    def test_out_of_reach(self):
        problem = driven(pair(ten_harmonics()), duration_s=0.001)
        with pytest.raises(
            IntegrationError, match=r"256 steps per sample.*1e-15 is asked for.*To do: tolerate"
        ) as caught:
            steps_for_error(problem, output=output(50e3), relative=1e-15)
        assert "tolerate a larger error" in str(caught.value)


class TestRefusals:
    @pytest.mark.parametrize(
        ("system", "rate_hz", "words"),
        [
            (pair(rectangle(0.0, 2e8, 0.5)), 4e3, "is unstable: the variation"),
            # 1326.4 Hz over 1 ms
            (pair(ten_harmonics(), bearings=1e4), 1e3, r"1\.33 mesh cycles.* To do: take more steps per sample"),
            (pair(constant(), damping=-1e5 * np.diag(MASSES)), 50e3, "exceeds the range of floating-point numbers"),
        ],
    )
    def test_motion_that_steps_cannot_follow(self, system, rate_hz, words):
        with pytest.raises(IntegrationError, match=words):
            run(driven(system, duration_s=0.1), rate_hz=rate_hz)

    @pytest.mark.parametrize("steps", [1, 2, 4])
    def test_modes_that_no_step_resolves(self, steps):
        # 2.4540e6 rad/s: 49.1, 24.5 and 12.3 rad, near 4, 4 and 2 turns a kick, so that half a step errs alike
        problem = driven(pair(rectangle(), bearings=1e14, damping=GEAR_DRAG), duration_s=0.02)
        with pytest.raises(
            IntegrationError, match=r"share in a channel is 1, .* of its RMS.*To do: take more"
        ) as caught:
            integrate(problem, output=output(50e3), steps=steps)
        assert f"advances the mode at 2.454e+06 rad/s by {49.08 / steps:.3g} rad" in caught.value.detail
        assert "25 steps per sample resolve the mode" in caught.value.detail

    def test_steps_that_resolve_what_is_read_are_taken(self):
        problem = driven(pair(rectangle(), bearings=1e14, damping=GEAR_DRAG), duration_s=0.02)
        # from as many steps as it names on, the error of the fastest mode falls with the fourth power
        exact = by_exponentials(problem, output(50e3))
        errors = [worst(run(problem, steps=count), exact) for count in (25, 50)]
        assert errors[0] < 0.2
        assert errors[1] < errors[0] / 12.8
        steps = steps_for_error(problem, output=output(50e3), relative=1e-3)
        assert worst(run(problem, steps=steps), exact) < 1e-3

        def without_bearings(rate_hz):
            return Output(rate_hz=rate_hz, displacement=output(1).displacement[:1])

        slow = run(problem, read=without_bearings)  # q alone has nothing of the bearings
        assert worst(slow, exact[:, :1]) < 1e-6

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"duration_s": -1.0}, "duration_s = -1.0"),
            ({"load": Load(constant=np.zeros(3))}, "load.constant"),
            ({"load": Load(constant=np.full(4, np.nan))}, "load.constant"),
            ({"load": Load(constant=np.zeros(4), quadratic_drag=-np.ones(4))}, "must not be negative"),
        ],
    )
    def test_bad_problems(self, change, message):
        with pytest.raises(ValueError, match=message):
            replace(driven(pair(constant()), duration_s=1.0), **change)

    def test_bad_maps_and_loads(self):
        problem = driven(pair(constant()), duration_s=0.01)
        for maps in (Output(rate_hz=1e3, displacement=np.eye(3)), Output(rate_hz=1e3, mesh_force=np.eye(2))):
            with pytest.raises(ValueError, match=r"output\.(displacement|mesh_force) must be finite"):
                integrate(problem, output=maps, steps=1)
        with pytest.raises(ValueError, match="one row per channel"):
            Output(rate_hz=1e3, displacement=np.eye(4), velocity=np.eye(4)[:2])
        bad = replace(problem, load=Load(constant=np.zeros(4), varying=lambda t: np.full((t.size, 4), np.nan)))
        with pytest.raises(ValueError, match=r"load\.varying must return finite forces"):
            run(bad)
