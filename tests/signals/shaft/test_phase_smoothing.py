"""The smoother of jitter against dense least squares, its gain against its statement, its error against its std."""

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from signals.shaft.phase_smoothing import smooth_phase
from signals.shaft.tachometer import shaft_phase


def dense(times, angles, noise, density):
    """States and covariance of the same model by the pseudo-inverse, its discretisation by Van Loan's exponential."""
    n = times.size
    drift = np.diag([1.0, 1.0], 1)
    rows, right = [], []
    for k, h in enumerate(np.diff(times)):
        power = np.zeros((3, 3))
        power[2, 2] = density[k]
        both = expm(np.block([[-drift, power], [np.zeros((3, 3)), drift.T]]) * h)
        move = both[3:, 3:].T
        root = np.linalg.inv(np.linalg.cholesky(move @ both[:3, 3:]))
        row = np.zeros((3, 3 * n))
        row[:, 3 * k : 3 * k + 6] = root @ np.hstack([-move, np.eye(3)])
        rows.append(row)
        right.append(np.zeros(3))
    rows.append(block_diag(*[np.array([[1, 0, 0]]) / np.sqrt(r) for r in noise]))
    right.append(angles / np.sqrt(noise))
    matrix = np.vstack(rows)
    inverse = np.linalg.pinv(matrix)
    return (inverse @ np.concatenate(right)).reshape(n, 3), inverse @ inverse.T


@pytest.fixture(scope="module")
def uneven():
    """Forty pulses, a fifth of them missing, with jitter of 1 %."""
    rng = np.random.default_rng(7)
    counts = np.sort(rng.choice(50, 40, replace=False))
    times = (counts + 0.01 * rng.standard_normal(40)) / 10 + 3
    return times, counts.astype(float), counts


class TestAgainstDense:
    def test_states_and_covariances(self, uneven):
        times, revolutions, counts = uneven
        angle, smooth, jitter = smooth_phase(
            times, revolutions, counts=counts, bandwidth_hz=np.full(40, 0.8), jitter_s=0.001
        )
        speed = np.gradient(revolutions, times)
        states, covariance = dense(times, revolutions - 10 * times, 1e-6 * speed**2, smooth.jerk_density)
        # the dense system's condition is some 1e5
        np.testing.assert_allclose(angle, states[:, 0] + 10 * times, rtol=0, atol=1e-9)
        np.testing.assert_allclose(smooth.speed_hz, states[:, 1] + 10, rtol=0, atol=1e-8)
        np.testing.assert_allclose(smooth.acceleration, states[:, 2], rtol=0, atol=1e-7)
        blocks = covariance.reshape(40, 3, 40, 3)
        own = blocks[np.arange(40), :, np.arange(40)]
        scale = np.abs(own).max(axis=0)
        np.testing.assert_allclose(smooth.covariance / scale, own / scale, rtol=0, atol=1e-7)
        with_next = blocks[np.arange(39), :, np.arange(1, 40)]
        np.testing.assert_allclose(smooth.cross_covariance / scale, with_next / scale, rtol=0, atol=1e-7)
        assert jitter == 0.001

    def test_std_between_pulses_is_that_of_an_instant_added_without_a_pulse(self, uneven):
        times, revolutions, counts = uneven
        _, smooth, _ = smooth_phase(times, revolutions, counts=counts, bandwidth_hz=np.full(40, 0.8), jitter_s=0.001)
        speed = np.gradient(revolutions, times)
        for cell, share in ((0, 0.3), (11, 0.5), (25, 0.9)):
            at = times[cell] + share * (times[cell + 1] - times[cell])
            more = np.insert(times, cell + 1, at)
            noise = np.insert(1e-6 * speed**2, cell + 1, 1e12)
            density = np.insert(smooth.jerk_density, cell, smooth.jerk_density[cell])
            _, covariance = dense(more, more * 0, noise, density)
            expected = np.sqrt(covariance[3 * (cell + 1), 3 * (cell + 1)])
            np.testing.assert_allclose(smooth.std_rev(np.array([at]), knots_s=times), expected, rtol=1e-5)


class TestGain:
    @pytest.mark.parametrize(
        ("ratio", "gain"), [(0.5, 1 / (1 + 0.41421356 / 64)), (1, 2**-0.5), (2, 1 / (1 + 64 * 0.41421356))]
    )
    @pytest.mark.parametrize("in_orders", [False, True])
    def test_of_a_swing_of_the_angle(self, ratio, gain, in_orders):
        # 60 pulses a second, swung by 1e-3 turns at `ratio` times the bandwidth of 2 Hz
        swing = 2.0 * ratio
        base = np.arange(3600) / 60
        times = base + 1e-3 / 60 * np.sin(2 * np.pi * swing * base)  # the angle lags by as much
        phase = shaft_phase(times, **({"bandwidth_orders": 2 / 60} if in_orders else {"bandwidth_hz": 2.0}))
        at = np.linspace(10, 50, 20_001)[:-1]
        left = phase.revolutions_at(at) - 60 * at
        amplitude = 2 * np.abs(np.mean(left * np.exp(-2j * np.pi * swing * at)))
        # a spline of 60 pulses a second carries 4 Hz to 1e-5; orders follow a speed that swings by 1 %
        np.testing.assert_allclose(amplitude, 1e-3 * gain, rtol=0.01 if in_orders else 1e-3)


class TestStd:
    @pytest.mark.parametrize(
        ("bandwidth", "per_rev"), [({"bandwidth_hz": 5.0}, 1), ({"bandwidth_orders": 0.5}, 4), ({}, 1)]
    )
    def test_is_the_error(self, swinging, middle, bandwidth, per_rev):
        rng = np.random.default_rng(21)
        marks = np.arange(1000 * per_rev) / per_rev
        times = swinging.times_at(marks)
        ratios = []
        for _ in range(4):
            phase = shaft_phase(times + 2e-6 * rng.standard_normal(times.size), pulses_per_rev=per_rev, **bandwidth)
            assert phase.jitter_s == pytest.approx(2e-6, rel=0.15)
            at = middle(np.linspace(phase.start_s, phase.stop_s, 50_001))
            error = 2 * np.pi * (phase.revolutions_at(at) - swinging.revolutions(at).astype(float))
            error -= error.mean()  # the first pulse's own jitter, and that of the stripes, move the whole
            ratios.append(np.sqrt(np.mean((error / phase.std_rad(at)) ** 2)))
        # of the smoother the noise alone is sqrt(5/6) = 0.91, the rest is what the shaft might have done; a curve
        # through every pulse has the jitter at the pulses, and somewhat less between
        assert 0.8 < np.mean(ratios) < 1.1

    def test_grows_in_a_gap_and_at_the_ends(self, swinging):
        times = np.delete(swinging.times_at(np.arange(200)), [100, 101, 102])
        rng = np.random.default_rng(3)
        phase = shaft_phase(times + 1e-6 * rng.standard_normal(times.size), bandwidth_hz=8.0)
        assert phase.repairs.missing == 3
        gap, usual, end = phase.std_rad([(times[99] + times[100]) / 2, times[60], phase.start_s])
        assert gap > 1.3 * usual
        assert end > 1.5 * usual

    @pytest.mark.compiles
    def test_scales(self, swinging):
        phase = shaft_phase(swinging.times_at(np.arange(100)) + 1e-6 * np.sin(np.arange(100) ** 2), bandwidth_hz=8.0)
        at = np.linspace(0.2, 1.8, 9)
        np.testing.assert_allclose(phase.scaled(-2.5).std_rad(at), 2.5 * phase.std_rad(at), rtol=1e-12)
        np.testing.assert_allclose(phase.scaled(-2.5).revolutions_at(at), -2.5 * phase.revolutions_at(at), rtol=1e-12)


class TestSmoothing:
    def test_less_jitter_than_before(self, swinging, middle):
        rng = np.random.default_rng(5)
        times = swinging.times_at(np.arange(1000)) + 2e-5 * rng.standard_normal(1000)
        at = middle(np.linspace(times[0], times[-1], 20_001))

        def error(phase):
            return np.sqrt(np.mean((phase.revolutions_at(at) - swinging.revolutions(at).astype(float)) ** 2))

        # noise of 25 Hz either side, of which 1.0472 x 5/6 x 3 / 0.863 Hz stay: white noise through the squared gain
        expected = np.sqrt(3 / 0.8633 * np.pi / 6 / np.sin(np.pi / 6) * 5 / 6 / 25) * 2e-5 * 50
        # about 240 independent errors: 5 %, three times that
        assert error(shaft_phase(times, bandwidth_hz=3.0)) == pytest.approx(expected, rel=0.15)

    @pytest.mark.parametrize(
        ("settings", "words"),
        [
            ({"bandwidth_hz": 0.0}, "bandwidth_hz=0.0 must be above zero"),
            ({"bandwidth_orders": -1.0}, "bandwidth_orders=-1.0 must be above zero"),
            ({"bandwidth_hz": 3.0, "bandwidth_orders": 1.0}, "both given; state one of them"),
            ({"bandwidth_hz": 40.0}, r"more than pulses every 0\.02\d* s at .* can show"),
        ],
    )
    def test_refused(self, swinging, settings, words):
        with pytest.raises(ValueError, match=words):
            shaft_phase(swinging.times_at(np.arange(100)), **settings)

    def test_too_few_pulses(self):
        with pytest.raises(ValueError, match="5 pulses from 0 s on are too few to smooth; 6 are needed"):
            shaft_phase(np.arange(5.0), bandwidth_hz=0.1)

    def test_no_smoothing_of_a_shaft_that_turns_back(self):
        with pytest.raises(ValueError, match="smoothing needs a shaft that keeps its direction"):
            shaft_phase(np.arange(8.0), direction=[1, 1, 1, 1, -1, -1, -1, -1], bandwidth_hz=0.1)
