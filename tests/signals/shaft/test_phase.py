"""Shaft angle against time: closed forms, polynomials a spline must reproduce, and shafts that stop."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from signals.shaft.phase import ShaftPhase, constant_speed

INTERVALS = st.lists(st.floats(0.01, 10.0), min_size=1, max_size=40)


def through(times, revolutions=None):
    times = np.asarray(times, dtype=float)
    return ShaftPhase(
        times_s=times, revolutions=np.arange(times.size, dtype=float) if revolutions is None else revolutions
    )


def fine_grid(phase, count):
    """`count` points in every interval between knots, and the knots."""
    steps = np.linspace(0, 1, count, endpoint=False)
    inner = phase.times_s[:-1, None] + np.diff(phase.times_s)[:, None] * steps
    return np.append(np.minimum(inner, phase.times_s[1:, None]).ravel(), phase.times_s[-1])


@pytest.fixture(scope="module")
def phase(swinging):
    return through(swinging.times_at(np.arange(1001)))


class TestSwingingSpeed:
    """Standard job J4: 20 s at 50 (1 + 0.1 sin(pi t)) Hz, known once a revolution."""

    def test_angle(self, phase, swinging, middle):
        times = middle(np.linspace(phase.start_s, phase.stop_s, 300_001))
        error = phase.revolutions_at(times) - swinging.revolutions(times).astype(float)
        # at order 400. The job asks for 1e-6; an independent quintic spline was measured at 3e-8, a cubic at 9e-5
        assert np.sqrt(np.mean((2 * np.pi * 400 * error) ** 2)) < 3e-8
        assert np.max(np.abs(phase.angle_rad(times) - 2 * np.pi * phase.revolutions_at(times))) == 0


class TestPolynomials:
    @pytest.mark.parametrize(("knots", "degree"), [(2, 1), (4, 3), (6, 5), (9, 5)])
    def test_reproduced_up_to_the_degree_of_the_spline(self, knots, degree):
        times = np.linspace(0, 1, knots) ** 1.3 + np.arange(knots) / 4
        law = np.polynomial.Polynomial([-3.0, 8, 0.9, -0.5, 0.4, 0.2][: degree + 1])  # rises throughout
        phase = through(times, law(times))
        between = np.linspace(times[0], times[-1], 999)
        # the spline's equations are conditioned like the fifth power of a few
        np.testing.assert_allclose(phase.revolutions_at(between), law(between), rtol=0, atol=1e-11)
        np.testing.assert_allclose(phase.speed_hz(between), law.deriv()(between), rtol=0, atol=1e-10)
        np.testing.assert_allclose(phase.times_at(law(between)), between, rtol=0, atol=1e-12)


class TestShaftsThatStop:
    def test_run_up_from_rest(self):
        # 2 Hz/s from standstill: the angle is t^2, its inverse has an endless slope at the start
        phase = through(np.sqrt(np.arange(60.0)))
        revolutions = np.concatenate([[0.0], np.geomspace(1e-6, 59, 4000)])
        times = phase.times_at(revolutions)
        np.testing.assert_allclose(phase.revolutions_at(times), revolutions, rtol=0, atol=1e-12)
        # a spline of unevenly close knots reproduces t^2 all the same
        np.testing.assert_allclose(times**2, revolutions, rtol=0, atol=1e-9)

    @given(intervals=INTERVALS)
    def test_any_pulses_give_a_monotone_invertible_phase(self, intervals):
        phase = through(np.concatenate([[0.0], np.cumsum(intervals)]))
        grid = fine_grid(phase, 64)
        angle = phase.revolutions_at(grid)
        rounding = 1e-12  # of angles up to 40, summed over powers up to the fifth
        assert np.all(np.diff(angle) >= -rounding)
        speed = phase.speed_hz(grid)
        assert speed.min() >= -rounding
        wanted = np.linspace(0, len(intervals), 501)
        missed = np.abs(phase.revolutions_at(phase.times_at(wanted)) - wanted)
        # times up to 400 s are settled to 1e-13 of that, at up to a few hundred Hz
        assert missed.max() <= rounding + 2e-13 * max(1.0, phase.stop_s) * speed.max()

    def test_a_shaft_at_rest_has_no_inverse(self):
        phase = through([0.0, 1, 2, 3], np.array([0.0, 1, 1, 2]))
        assert np.all(np.diff(phase.revolutions_at(fine_grid(phase, 50))) >= 0)
        with pytest.raises(ValueError, match=r"stands still from 1 s onwards \(1 standstills"):
            phase.times_at([0.5, 1.5])
        assert phase.times_at([1.0], at_rest="arrival") == 1
        assert phase.times_at([1.0], at_rest="departure") == 2
        with pytest.raises(ValueError, match="at_rest='never' is unknown"):
            phase.times_at([1.0], at_rest="never")

    def test_a_stop_is_felt_nowhere_else(self, swinging):
        # the swinging shaft stops dead between two pulses, stands for a second, and goes on as if it never had
        first, second = np.arange(500.0), np.arange(500.0, 1001.0)
        times = np.concatenate([swinging.times_at(first), swinging.times_at(second) + 1.0])
        phase = through(times, np.concatenate([first, second]))
        grid = np.linspace(times[0], times[-1], 40_001)
        assert np.all(np.diff(phase.revolutions_at(grid)) >= -1e-12)
        assert phase.speed_hz(grid).min() >= 0
        for later, early in ((grid < times[479], 0.0), (grid > times[520], 1.0)):
            at = grid[later]
            error = phase.revolutions_at(at) - swinging.revolutions(at - early).astype(float)
            # at order 400, as without the stop; 2,000 points a second, so that the ends are half a second away
            assert np.sqrt(np.mean((2 * np.pi * 400 * error[1000:-1000]) ** 2)) < 3e-8

    def test_a_standstill_is_constant(self):
        times = np.array([0.0, 1, 2, 3, 4, 5, 15, 16, 17, 18, 19, 20])
        phase = through(times, np.array([0.0, 1, 2, 3, 4, 5, 5, 6, 7, 8, 9, 10]))
        rest = np.linspace(5, 15, 101)
        np.testing.assert_array_equal(phase.revolutions_at(rest), np.full(101, 5.0))
        np.testing.assert_array_equal(phase.speed_hz(rest[:-1]), np.zeros(100))
        # the mean speed of the revolution that holds the standstill counts it
        speeds = phase.mean_speed_per_revolution_hz()
        np.testing.assert_allclose(np.sort(speeds), np.sort([1 / 11] + [1.0] * 9), rtol=1e-12)


class TestOtherShafts:
    @pytest.mark.parametrize("ratio", [20 / 41, -2.5])
    def test_another_shaft(self, swinging, ratio):
        phase = through(swinging.times_at(np.arange(101)))
        other = phase.scaled(ratio)
        times = np.linspace(phase.start_s, phase.stop_s, 777)
        np.testing.assert_allclose(other.revolutions_at(times), ratio * phase.revolutions_at(times), atol=1e-11)
        np.testing.assert_allclose(other.speed_hz(times), ratio * phase.speed_hz(times), rtol=1e-10)
        np.testing.assert_allclose(
            other.times_at(ratio * np.array([3.3, 77.0])), phase.times_at([3.3, 77.0]), rtol=1e-13
        )
        assert np.all(other.mean_speed_per_revolution_hz() * ratio > 0)
        assert other.mean_speed_per_revolution_hz().size == int(100 * abs(ratio))
        np.testing.assert_allclose(
            other.scaled(1 / ratio).revolutions_at(times), phase.revolutions_at(times), rtol=1e-13, atol=1e-12
        )
        with pytest.raises(ValueError, match="outside the known"):
            other.times_at([-1.0 if ratio > 0 else 1.0])

    def test_a_shaft_that_turns_back_has_no_inverse(self):
        # up to 1.5 at 1.5 s and down again: the angle is a parabola, which a quintic reproduces
        law = np.polynomial.Polynomial([0, 2, -2 / 3])
        times = np.sort(np.concatenate([(law - r).roots() for r in np.arange(0, 1.5, 0.125)]))
        phase = through(times, np.round(law(times) * 8) / 8)
        grid = np.linspace(times[0], times[-1], 1001)
        np.testing.assert_allclose(phase.revolutions_at(grid), law(grid), atol=1e-11)
        np.testing.assert_allclose(phase.speed_hz(grid), law.deriv()(grid), atol=1e-9)
        with pytest.raises(ValueError, match=r"reverses at 1\.\d+ s, so an angle has several times"):
            phase.times_at([0.5])

    def test_standard_deviation_scales_with_the_ratio(self, swinging):
        phase = replace(through(swinging.times_at(np.arange(101))), jitter_s=1e-6)
        at = np.linspace(0.1, 1.9, 7)
        np.testing.assert_allclose(phase.std_rad(at), 2 * np.pi * 1e-6 * swinging.speed_hz(at), rtol=1e-6)
        np.testing.assert_allclose(phase.scaled(-3.5).std_rad(at), 3.5 * phase.std_rad(at), rtol=1e-9)

    def test_constant_speed(self):
        phase = constant_speed(29.95, start_s=1.5, stop_s=11.5)
        times = np.array([1.5, 2.5, 11.5])
        np.testing.assert_allclose(phase.revolutions_at(times), [0, 29.95, 299.5], rtol=1e-14)
        np.testing.assert_allclose(phase.speed_hz(times), 29.95, rtol=1e-14)
        np.testing.assert_allclose(phase.times_at([0, 29.95, 299.5]), times, rtol=1e-14)
        assert phase.nominal
        assert phase.scaled(3.0).nominal
        assert phase.mean_speed_per_revolution_hz().size == 299
        with pytest.raises(ValueError, match="jitter of this phase is unknown: its speed is declared, not measured"):
            phase.std_rad([2.0])


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda p: p.scaled(0), "ratio"),
        (lambda _: constant_speed(-1.0, start_s=0, stop_s=1), "speed_hz"),
        (lambda _: constant_speed(9.0, start_s=1, stop_s=1.0), "stop_s"),
        (lambda p: p.revolutions_at([0.5, -0.01]), r"outside the known motion of the shaft, 0 to 1 s"),
        (lambda p: p.angle_rad([0.5, 1.01]), r"outside the known motion of the shaft, 0 to 1 s"),
        (lambda p: p.speed_hz([0.5, 1.01]), r"outside the known motion of the shaft, 0 to 1 s"),
        (lambda p: p.times_at([3.0, 20.001]), "outside the known 0 to 20"),
        (lambda p: p.revolutions_at([0.1, np.nan]), "times_s"),
        (lambda p: p.times_at([0.1, np.nan]), "revolutions"),
        (lambda _: through([0.0, 2.0, 1.0, 3.0]).revolutions_at([0.5]), "increasing"),
    ],
)
def test_refused(ask, words):
    with pytest.raises(ValueError, match=words):
        ask(through(np.linspace(0, 1, 21)))
