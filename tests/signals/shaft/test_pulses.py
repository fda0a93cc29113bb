"""Hard waveforms: drift, narrow pulses, falling edges, gaps, huge offsets, whole numbers, bouncing contacts."""

import numpy as np
import pytest

from signals.shaft.pulses import pulse_times

RATE_HZ = 20_000.0
SECONDS = 10.0
SPEED_HZ = 30.0


@pytest.fixture(scope="module")
def t():
    return np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ


@pytest.fixture(scope="module")
def turn(t):
    return (SPEED_HZ * t) % 1


def expected(fraction):
    times = (np.arange(int(SECONDS * SPEED_HZ)) + fraction) / SPEED_HZ
    return times[(times > 0) & (times < SECONDS - 1 / RATE_HZ)]


def smooth_pulse(turn, width):
    """A raised-cosine pulse of this share of a revolution, half-way up at a quarter of its width."""
    return np.where(turn < width, (1 - np.cos(2 * np.pi * turn / width)) / 2, 0.0)


class TestDrift:
    def test_baseline_that_wanders_by_many_times_the_swing(self, t, turn):
        drift = 8 * np.sin(2 * np.pi * 0.11 * t + 0.4)
        train = pulse_times(smooth_pulse(turn, 0.3) + drift, rate_hz=RATE_HZ)
        assert train.times_s.size == expected(0.075).size
        # the level is known to some tenth of the swing in each block; the pulse rises in 0.15 turns, 5 ms
        assert np.max(np.abs(train.times_s - expected(0.075))) < 0.2 * 5e-3

    def test_amplitude_and_baseline_together_on_a_run_up(self, t):
        # a magnetic pick-up: voltage in proportion to speed
        turns = 4 * t + 2.4 * t**2
        speed = 4 + 4.8 * t
        wave = speed * np.sin(2 * np.pi * turns) + 20 * np.sin(2 * np.pi * 0.05 * t)
        train = pulse_times(wave, rate_hz=RATE_HZ)
        whole = np.arange(1, int(turns[-1]) + 1)
        times = (-4 + np.sqrt(16 + 9.6 * whole)) / 4.8
        assert train.times_s.size == whole.size
        # the level is wrong by some tenths of an amplitude at most, which a sine passes within 0.05 turns
        assert np.max(np.abs(train.times_s - times) * (4 + 4.8 * times)) < 0.05

    def test_standstill_between_two_runs_makes_no_pulse(self, t):
        # 30 Hz, two seconds of rest in mid-gap, 30 Hz again
        turns = np.where(t < 4, 30 * t, np.where(t < 6, 120, 30 * (t - 2))) + 0.6
        noise = 0.01 * np.random.default_rng(3).standard_normal(t.size)
        train = pulse_times(smooth_pulse(turns % 1, 0.3) + noise, rate_hz=RATE_HZ)
        assert np.count_nonzero((train.times_s > 4.001) & (train.times_s < 5.999)) == 0
        assert train.times_s.size == 240


class TestWhichEdge:
    def test_falling_edges_are_the_rising_ones_of_the_wave_turned_over(self, turn):
        wave = smooth_pulse(turn, 0.3)
        falling = pulse_times(wave, rate_hz=RATE_HZ, edge="falling")
        turned = pulse_times(-wave, rate_hz=RATE_HZ)
        np.testing.assert_array_equal(falling.times_s, turned.times_s)
        assert (falling.edge, falling.threshold) == ("falling", -turned.threshold)
        # the place on the falling half of the cosine; a straight line misses a cosine by some 1e-3 samples
        down = 0.3 * (1 - np.arccos(1 - 2 * falling.threshold) / (2 * np.pi))
        np.testing.assert_allclose(falling.times_s, expected(down), rtol=0, atol=5e-3 / RATE_HZ)

    @pytest.mark.parametrize("sign", [1, -1])
    def test_the_sharper_edge(self, turn, sign):
        # steep at 0, slow back by 0.5
        wave = sign * np.where(turn < 0.02, turn / 0.02, np.clip(1 - (turn - 0.02) / 0.48, 0, None))
        train = pulse_times(wave, rate_hz=RATE_HZ, edge="auto")
        assert train.edge == ("rising" if sign > 0 else "falling")
        np.testing.assert_allclose(np.sort(train.times_s % (1 / SPEED_HZ))[[0, -1]], 0.01 / SPEED_HZ, atol=1e-5)

    @pytest.mark.parametrize("sign", [1, -1])
    def test_of_equal_edges_the_one_that_opens_the_narrower_side(self, turn, sign):
        train = pulse_times(sign * np.where(turn < 0.2, 1.0, 0.0), rate_hz=RATE_HZ, edge="auto")
        assert train.edge == ("rising" if sign > 0 else "falling")

    def test_no_such_edge(self, turn):
        with pytest.raises(ValueError, match="edge='rise' is unknown; it must be one of rising, falling, auto"):
            pulse_times(turn, rate_hz=RATE_HZ, edge="rise")


class TestWhatRecordersHandOver:
    def test_whole_numbers(self, turn):
        counts = np.round(30_000 * (smooth_pulse(turn, 0.3) - 0.5)).astype(np.int16)
        train = pulse_times(counts, rate_hz=RATE_HZ)
        exact = pulse_times(smooth_pulse(turn, 0.3), rate_hz=RATE_HZ)
        # half a count against a slope of 30,000 counts in some 60 samples
        np.testing.assert_allclose(train.times_s, exact.times_s, rtol=0, atol=5e-3 / RATE_HZ)

    def test_an_offset_a_million_times_the_signal(self, turn):
        exact = pulse_times(smooth_pulse(turn, 0.3), rate_hz=RATE_HZ).times_s
        train = pulse_times(smooth_pulse(turn, 0.3) + 1e6, rate_hz=RATE_HZ)
        # 1e6 is known to 1e-10; the slope is 1/60 a sample
        np.testing.assert_allclose(train.times_s, exact, rtol=0, atol=2e-8 / RATE_HZ)


class TestNarrowPulses:
    """A twentieth of a percent to a percent of a turn, 5 V high."""

    @staticmethod
    def turns(t, rise):
        return SPEED_HZ * (t + rise * t**2) + 0.5

    @pytest.mark.parametrize("rise", [0.0, 0.04])
    @pytest.mark.parametrize("disturbance", ["hum", "noise", "drift"])
    @pytest.mark.parametrize("width", [0.004, 0.009, 0.011])
    def test_each_passage_is_found(self, t, rise, disturbance, width):
        angle = self.turns(t, rise)
        added = {
            "hum": 0.05 * np.sin(2 * np.pi * 50 * t),
            "noise": 0.05 * np.random.default_rng(2).standard_normal(t.size),
            "drift": 8 * np.sin(2 * np.pi * 0.07 * t),
        }[disturbance]
        train = pulse_times(5.0 * (angle % 1 < width) + added, rate_hz=RATE_HZ)
        passes = t[1:][np.diff(np.floor(angle)) > 0]
        assert train.times_s.size == passes.size
        np.testing.assert_allclose(train.times_s, passes, rtol=0, atol=1 / RATE_HZ)

    def test_levels_that_are_stated(self, turn):
        wave = 5.0 * np.clip(4 * np.minimum(turn, 0.5 - turn), 0, 1)
        train = pulse_times(wave, rate_hz=RATE_HZ, threshold=1.0, hysteresis=0.5)
        assert (train.threshold, train.hysteresis) == (1.0, 0.5)
        np.testing.assert_allclose(train.times_s, expected(0.05)[: train.times_s.size], rtol=0, atol=1 / RATE_HZ)
        with pytest.raises(ValueError, match="is not within the levels of the waveform"):
            pulse_times(wave, rate_hz=RATE_HZ, threshold=7.0)


class TestRangeOfTheChannel:
    def test_hum_far_below_it_is_no_tachometer(self):
        t = np.arange(51_200) / 51_200
        hum = 0.9e-3 * np.sin(2 * np.pi * 995 * t)
        with pytest.raises(ValueError, match=r"swings by 0.0018, below 1% of the channel's full_scale of 10: hum"):
            pulse_times(hum, rate_hz=51_200, full_scale=10.0)
        assert pulse_times(hum, rate_hz=51_200, full_scale=0.1).times_s.size == 994
        assert pulse_times(1000 * hum, rate_hz=51_200, full_scale=10.0).times_s.size == 994
