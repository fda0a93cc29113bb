"""Pulse times from waveforms of known shape, and what is refused rather than repaired in silence."""

import numpy as np
import pytest

from signals.shaft.tachometer import pulse_times, shaft_phase

RATE_HZ = 51200.0
SECONDS = 4.0
STRIPES = [[0], [0, 0.53], [0, 0.2], [0, 0.8], [0, 0.32, 0.655]]
# the inverse of the angle in closed form, and how many revolutions it lasts
SPEED_LAWS = {
    "run-up, 10 to 40 Hz in 5 s": (lambda revs: (-10 + np.sqrt(100 + 12 * revs)) / 6, 125),
    "run-up from rest": (lambda revs: np.sqrt(revs / 5), 50),
    "run-down to 0.02 Hz in 10 s": (lambda revs: (30 - np.sqrt(900 - 4 * 1.499 * revs)) / (2 * 1.499), 150),
    "coasting with a time constant of 10 s": (lambda revs: -10 * np.log1p(-revs / 300.0002), 300),
    "stopping within a second": (lambda revs: -0.3 * np.log1p(-revs / 9.001), 9),
}


def revolutions(t):
    """A run-up from 20 to 32 Hz, first whole revolution after 0.015 s."""
    return 20 * t + 1.5 * t**2 - 0.3


def passes(fraction):
    """Times at which the run-up passes `fraction` of each revolution, from the quadratic formula."""
    turns = np.arange(0, int(revolutions(SECONDS)) + 1) + fraction
    times = (-20 + np.sqrt(400 + 6 * (turns + 0.3))) / 3
    return times[(times > 0) & (times < SECONDS - 1 / RATE_HZ)]


@pytest.fixture(scope="module")
def turn():
    """Fraction of the revolution at every sample."""
    return revolutions(np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ) % 1


def half_sine(turn):
    return np.where(turn < 0.5, np.sin(2 * np.pi * turn), 0.0)


class TestWaveforms:
    def test_half_sine_between_samples(self, turn):
        train = pulse_times(half_sine(turn), rate_hz=RATE_HZ)
        expected = passes(np.arcsin(train.threshold) / (2 * np.pi))
        # a straight line misses a sine by f'' / 8 f' samples: pi f / 4 rate tan(30 deg), 3e-4 at 32 Hz
        np.testing.assert_allclose(train.times_s, expected, rtol=0, atol=3.5e-4 / RATE_HZ)
        # half of the wave's swing, less what the percentiles leave out
        assert train.threshold == pytest.approx(0.5, abs=2e-3)
        assert train.hysteresis == pytest.approx(0.25, abs=1e-3)

    @pytest.mark.parametrize(("gain", "offset"), [(1e-3, -7.0), (2400.0, 0.0)])
    def test_volts_and_offset_do_not_matter(self, turn, gain, offset):
        plain = pulse_times(half_sine(turn), rate_hz=RATE_HZ).times_s
        other = pulse_times(gain * (half_sine(turn) + offset), rate_hz=RATE_HZ, start_s=12.5).times_s
        np.testing.assert_allclose(
            other - 12.5, plain, rtol=0, atol=1e-9 / RATE_HZ
        )  # rounding of 7 against slopes of 2e-3

    @pytest.mark.parametrize("noise", [0.0, 0.02, 0.08])
    def test_square_within_a_sample(self, turn, noise):
        wave = np.where(turn < 0.4, 5.0, 0.0)
        wave += 5 * noise * np.random.default_rng(4).standard_normal(wave.size)
        # an edge between two samples: each edge once, its place known to the gap, blurred a little by the noise
        np.testing.assert_allclose(
            pulse_times(wave, rate_hz=RATE_HZ).times_s, passes(0.0), rtol=0, atol=(0.5 + 4 * noise) / RATE_HZ
        )

    @pytest.mark.parametrize("noise", [0.05, 0.1])
    def test_noise_on_a_slow_edge_moves_it_neither_way(self, noise):
        speed_hz, pulses = 20.0, 600
        t = np.arange(round(pulses / speed_hz * RATE_HZ)) / RATE_HZ
        wave = np.sin(2 * np.pi * (speed_hz * t - 0.25)) + noise * np.random.default_rng(6).standard_normal(t.size)
        train = pulse_times(wave, rate_hz=RATE_HZ)
        expected = (np.arange(pulses) + 0.25 + np.arcsin(train.threshold) / (2 * np.pi)) / speed_hz
        error = (train.times_s - expected) * RATE_HZ
        # The time below a straight rise is the sum of independent samples, each below with probability p, and the
        # integral of p (1 - p) over a normal distribution is sigma / sqrt(pi)
        deviation = np.sqrt(noise / (2 * np.pi * speed_hz) * RATE_HZ / np.sqrt(np.pi))
        assert abs(error.mean()) < 4 * deviation / np.sqrt(pulses)
        assert error.std() == pytest.approx(deviation, rel=4 / np.sqrt(2 * pulses))

    @pytest.mark.parametrize(
        ("wave", "words"),
        [
            (passes(0.0), "rises at every sample: it looks like a list of pulse times"),
            (np.zeros(100), "is constant, 0 at every sample: at least 2 pulses are needed"),
            (np.repeat([0.0, 1.0, 0.0], 50), "upwards 1 times"),
            (np.array([0.0, 1, np.nan, 1, 0, 1]), "1 values that are not finite, the first at index 2"),
            (np.array([0.0, 1]), "at least 3"),
        ],
    )
    def test_refused(self, wave, words):
        with pytest.raises(ValueError, match=words):
            pulse_times(wave, rate_hz=RATE_HZ)


class TestPulses:
    @pytest.mark.parametrize("positions", [[0, 0.53], [0, 0.32, 0.655]])
    def test_displaced_stripes_are_found(self, swinging, positions):
        true = (np.arange(300)[:, None] + positions).ravel()
        phase = shaft_phase(swinging.times_at(true), pulses_per_rev=len(positions))
        # the spline through the first stripe alone errs by some 1e-10 revolutions, at the ends a little more
        np.testing.assert_allclose(phase.stripe_positions_rev, positions, rtol=0, atol=1e-9)
        np.testing.assert_allclose(phase.revolutions, true, rtol=0, atol=1e-9)
        between = np.linspace(phase.start_s, phase.stop_s, 20001)[1000:-1000]
        exact = swinging.revolutions(between).astype(float)
        assert np.max(np.abs(phase.revolutions_at(between) - exact)) < 2e-9

    def test_pulses_that_start_at_another_stripe(self, swinging):
        # revolution zero is the first pulse, whichever stripe made it
        true = (np.arange(300)[:, None] + [0, 0.53]).ravel()[1:]
        phase = shaft_phase(swinging.times_at(true), pulses_per_rev=2)
        np.testing.assert_allclose(phase.revolutions, true - 0.53, rtol=0, atol=1e-9)

    @pytest.mark.parametrize("positions", STRIPES)
    def test_every_missing_pulse_is_seen(self, swinging, positions):
        true = (np.arange(20)[:, None] + positions).ravel()
        times, n = swinging.times_at(true), len(positions)
        for missing in range(n + 1, times.size - n - 1):  # the ends, where one side is missing, are above
            phase = shaft_phase(np.delete(times, missing), pulses_per_rev=n)
            repairs = phase.repairs
            assert repairs.total
            if 5 * n < missing < times.size - 5 * n:
                assert (repairs.missing, repairs.total) == (1, 1)
                np.testing.assert_allclose(phase.revolutions, np.delete(true, missing), rtol=0, atol=1e-7)
                assert times[missing - 1] < repairs.missing_times_s[0] < times[missing + 1]

    @pytest.mark.parametrize("share", [0.003, 0.5, 0.997])
    @pytest.mark.parametrize("positions", STRIPES)
    def test_every_extra_pulse_is_seen(self, swinging, positions, share):
        times = swinging.times_at((np.arange(20)[:, None] + positions).ravel())
        n = len(positions)
        for place in range(n, times.size - 1 - n):
            extra = (1 - share) * times[place] + share * times[place + 1]
            repairs = shaft_phase(np.insert(times, place + 1, extra), pulses_per_rev=n).repairs
            assert repairs.total
            if 5 * n < place < times.size - 5 * n:
                assert (repairs.missing, repairs.total) == (0, 1)

    @pytest.mark.parametrize("law", SPEED_LAWS)
    @pytest.mark.parametrize("positions", STRIPES)
    @pytest.mark.parametrize("offset", [0.0, 0.62])
    def test_sound_pulses_are_accepted(self, law, positions, offset):
        times_at, turns = SPEED_LAWS[law]
        marks = (np.arange(turns)[:, None] + np.array(positions) + offset).ravel()
        times = times_at(marks[marks < turns])
        assert shaft_phase(times, pulses_per_rev=len(positions)).times_s.size == times.size

    @pytest.mark.parametrize(("pulses_per_rev", "pulses"), [(1, 500), (60, 6000), (60, 150)])
    def test_jitter_is_accepted(self, pulses_per_rev, pulses):
        rng = np.random.default_rng(8)
        for _ in range(20):
            times = (np.arange(pulses) + 0.05 * rng.standard_normal(pulses)) / (25 * pulses_per_rev)
            assert shaft_phase(times, pulses_per_rev=pulses_per_rev).times_s.size == pulses

    @pytest.mark.parametrize(
        ("times", "words"),
        [
            ([0.0, 1, 3, 2, 4], r"do not increase: pulse 3 at 2 s is not after pulse 2 at 3 s \(1 such places\)"),
            ([0.0, 1, 1, 2], r"pulse 2 at 1 s is not after pulse 1 at 1 s"),
            ([4.0, 3, 2], r"\(2 such places\)"),
            ([0.0, 1, np.nan, 3], "not finite, the first at index 2"),
            ([1.0], "1 values; at least 2"),
        ],
    )
    def test_refused(self, times, words):
        with pytest.raises(ValueError, match=words):
            shaft_phase(times)
        with pytest.raises(ValueError, match="pulses_per_rev="):
            shaft_phase(np.arange(20.0), pulses_per_rev=True)
