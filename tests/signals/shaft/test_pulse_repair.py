"""Missing, double and spurious pulses: each is found and counted, and the phase is that of the sound pulses."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from signals.shaft.tachometer import shaft_phase

RECORD_S = 1e6 / 51_200


def spoilt(times, rng, *, missing=0.05, spurious=0.05, margin=6):
    """Take pulses away and put others in, none within `margin` of the ends: the bad list and the truth.

    A spurious pulse beside a missing one may be taken for that one, early or late: there is none.
    """
    inner = np.arange(margin, times.size - margin)
    lost = rng.choice(inner, round(missing * times.size), replace=False)
    cells = rng.choice(np.setdiff1d(inner, np.append(lost, lost - 1)), round(spurious * times.size), replace=False)
    share = rng.uniform(0.003, 0.997, cells.size)
    extra = times[cells] + share * (times[cells + 1] - times[cells])
    # the definition of a double: within a tenth of the interval after a pulse that is there
    double = int(np.sum(share < 0.1))
    return np.sort(np.concatenate([np.delete(times, lost), extra])), lost, extra, double


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


@pytest.fixture(scope="module")
def pulses(swinging):
    times = swinging.times_at(np.arange(1000))
    return times[times < RECORD_S]


class TestJitterWithFaults:
    @pytest.mark.parametrize("seed", range(2))
    def test_all_are_counted_and_cost_little(self, pulses, swinging, middle, seed):
        rng = np.random.default_rng([2, seed])
        jittered = pulses + 1e-6 * rng.standard_normal(pulses.size)
        bad, lost, extra, double = spoilt(jittered, rng)
        phase = shaft_phase(bad)
        repairs = phase.repairs
        assert (repairs.missing, repairs.double + repairs.spurious) == (lost.size, extra.size)
        assert repairs.double == double
        assert repairs.total == lost.size + extra.size
        # where the missing ones should have been: the mean of neighbours errs by half the change of an interval
        np.testing.assert_allclose(repairs.missing_times_s, pulses[np.sort(lost)], rtol=0, atol=2e-3)
        found = np.sort(np.concatenate([repairs.double_times_s, repairs.spurious_times_s]))
        np.testing.assert_array_equal(found, np.sort(extra))
        grid = middle(np.linspace(phase.start_s, phase.stop_s, 100_001))
        exact = swinging.revolutions(grid).astype(float)
        alone = shaft_phase(jittered)
        assert alone.repairs.total == 0
        assert rms(phase.revolutions_at(grid) - exact) < 1.2 * rms(alone.revolutions_at(grid) - exact)


class TestSingleFaults:
    @pytest.mark.parametrize("missing", [[40], [40, 41], [40, 41, 42], [40, 42], [40, 42, 44, 46, 48]])
    def test_missing_pulses_are_counted_on(self, swinging, missing):
        times = swinging.times_at(np.arange(120))
        phase = shaft_phase(np.delete(times, missing))
        np.testing.assert_array_equal(phase.revolutions, np.delete(np.arange(120), missing))
        assert (phase.repairs.missing, phase.repairs.total) == (len(missing), len(missing))
        assert phase.stops_s.size == 0

    def test_among_the_stripes_of_a_zebra_tape_with_a_butt_joint(self, swinging):
        # 60 stripes, the last gap 40 % wider; twelve pulses missing and twelve spurious in 60 turns
        widths = np.append(np.ones(59), 1.4)
        positions = np.concatenate([[0], np.cumsum(widths)[:-1]]) / widths.sum()
        true = (np.arange(60)[:, None] + positions).ravel()
        rng = np.random.default_rng(12)
        bad, lost, extra, _ = spoilt(swinging.times_at(true), rng, missing=12 / 3600, spurious=12 / 3600, margin=10)
        phase = shaft_phase(bad, pulses_per_rev=60)
        assert phase.repairs.missing == lost.size
        assert phase.repairs.double + phase.repairs.spurious == extra.size
        np.testing.assert_allclose(phase.stripe_positions_rev, positions, rtol=0, atol=1e-7)

    @pytest.mark.parametrize(("missing", "extra"), [([30], []), ([], [30]), ([30, 31], [45]), ([25, 40], [33])])
    def test_on_a_run_up_from_rest(self, missing, extra):
        # 40 Hz after 5 s: the angle is 4 t^2
        times = np.sqrt(np.arange(100) / 4)
        bad = np.sort(np.concatenate([np.delete(times, missing), (times[extra] + times[np.array(extra, int) + 1]) / 2]))
        phase = shaft_phase(bad)
        np.testing.assert_array_equal(phase.revolutions, np.delete(np.arange(100), missing))
        assert (phase.repairs.missing, phase.repairs.spurious) == (len(missing), len(extra))


class TestAtTheEnds:
    @pytest.mark.parametrize("end", ["first", "last"])
    @pytest.mark.parametrize("away", [1, 4])
    def test_one_pulse_is_missing_in_a_run_down(self, end, away):
        # from 30 Hz at 4 Hz/s until 3 Hz: the angle is 30 t - 2 t^2
        turns = np.arange(111)
        times = (30 - np.sqrt(900 - 8 * turns)) / 4
        place = away if end == "first" else turns.size - 1 - away
        phase = shaft_phase(np.delete(times, place))
        assert (phase.repairs.missing, phase.repairs.total) == (1, 1)
        np.testing.assert_array_equal(phase.revolutions, np.delete(turns, place))

    def test_every_fifth_pulse_is_missing_to_the_end(self):
        turns = np.arange(400)
        turns = turns[(turns < 200) | (turns % 5 > 0)]
        np.testing.assert_array_equal(shaft_phase(turns / 50).revolutions, turns)


class TestHopeless:
    def test_more_wrong_than_right(self):
        rng = np.random.default_rng(0)
        times = np.sort(rng.uniform(0, 10, 400))
        with pytest.raises(ValueError, match=r"cannot be repaired: \d+ would be missing and \d+ extra, of 400"):
            shaft_phase(times)

    def test_too_long_a_gap(self, swinging):
        times = swinging.times_at(np.arange(300))
        with pytest.raises(ValueError, match=r"missing in a row, too many to count reliably") as caught:
            shaft_phase(np.delete(times, np.arange(100, 140)))
        assert f"from {times[99]:g} to {times[140]:g} s: about " in str(caught.value)


class TestStops:
    TIMES = np.concatenate([-np.sqrt(np.arange(40, 0, -1) / 5), np.sqrt((np.arange(1, 40) - 0.4) / 5)])

    def test_a_stop_is_flagged(self):
        # slowing evenly to rest a whole turn after the pulse, then gathering speed
        times = self.TIMES + 10
        phase = shaft_phase(times)
        assert phase.stops_s.tolist() == [[times[39], times[40]]]
        assert phase.direction_unknown
        assert phase.repairs.total == 0
        np.testing.assert_array_equal(phase.revolutions, np.arange(times.size))
        declared = shaft_phase(times + 2e-4, direction=-1, delay_s=2e-4)
        assert not declared.direction_unknown
        assert declared.revolutions[-1] == 1 - times.size
        np.testing.assert_allclose(declared.times_s, times, rtol=0, atol=1e-14)
        assert phase.speed_hz(np.linspace(times[0], times[-1], 5001)).min() >= 0

    @pytest.mark.parametrize(("past", "stripes"), [(0.003, 1), (0.2, 4), (0.5, 1), (0.9, 4)])
    def test_a_reversal_is_flagged_wherever_it_is(self, past, stripes):
        # from 10 Hz to -10 Hz in 10 s: both passes of the last stripe are true
        distance = np.arange(24 * stripes, -1, -1) + past
        before = 5 - np.sqrt(distance / stripes)
        times = np.concatenate([before, 10 - before[::-1]])
        phase = shaft_phase(times, pulses_per_rev=stripes)
        assert phase.stops_s.tolist() == [[before[-1], 10 - before[-1]]]
        assert phase.direction_unknown
        assert phase.repairs.total == 0


class TestOtherWays:
    @pytest.mark.parametrize("per_rev", [Fraction(41, 20), 2.05])
    def test_pulses_of_another_shaft(self, swinging, per_rev):
        times = swinging.times_at(np.arange(300))
        phase = shaft_phase(times, pulses_per_rev=per_rev)
        np.testing.assert_allclose(phase.revolutions, np.arange(300) * 20 / 41, rtol=1e-14)
        np.testing.assert_array_equal(phase.stripe_positions_rev, [0.0])

    @pytest.mark.parametrize("turns", [1.5, 1.0])
    def test_a_record_of_one_and_a_half_revolutions(self, turns):
        # four stripes: seven pulses at most
        marks = np.arange(0, turns + 1e-9, 0.25)
        phase = shaft_phase(marks / 25, pulses_per_rev=4)
        at = np.linspace(0, marks[-1] / 25, 101)
        np.testing.assert_allclose(phase.revolutions_at(at), 25 * at, rtol=0, atol=1e-12)
        assert np.isnan(phase.jitter_s)
        with pytest.raises(ValueError, match=r"jitter of this phase is unknown: \d knots are too few"):
            phase.std_rad(at)

    def test_two_pulses(self):
        np.testing.assert_allclose(shaft_phase([0.01, 0.05]).revolutions_at([0.03]), [0.5], rtol=1e-12)

    @pytest.mark.parametrize("wave", [np.sin(np.arange(1000.0)), np.tile([0, 0, 5, 5], 50)])
    def test_a_waveform_in_place_of_times(self, wave):
        with pytest.raises(ValueError, match=r"not pulse times: \d+ of them do not exceed .* look like a waveform"):
            shaft_phase(wave)

    @pytest.mark.parametrize("direction", [0, 2, [1, -1], "forward", [1.0, 1, 1, 0.5]])
    def test_directions_that_are_none(self, direction):
        with pytest.raises(ValueError, match=r"must be \+1, -1, or one of these for each of the 4 pulses"):
            shaft_phase([0.0, 1, 2, 3], direction=direction)


class TestOneFaultIsOneRepair:
    """At constant acceleration a the pulse at angle n / p comes at (sqrt(f^2 + 2 a n / p) - f) / a."""

    @staticmethod
    def ramp(start_hz, stop_hz, duration_s, per_rev, jitter, rng):
        a = (stop_hz - start_hz) / duration_s
        turns = np.arange(int((start_hz + stop_hz) / 2 * duration_s * per_rev)) / per_rev
        times = 2 * turns / (start_hz + np.sqrt(start_hz**2 + 2 * a * turns))
        return times + jitter * np.gradient(times) * rng.standard_normal(times.size)

    @given(
        ends=st.tuples(st.floats(6, 60), st.floats(6, 60)).filter(lambda ends: abs(ends[0] - ends[1]) > 0.1),
        duration=st.floats(1, 6),
        per_rev=st.sampled_from([1, 2, 4, 20, 60]),
        jitter=st.sampled_from([0.0, 1e-5, 1e-3]),  # of the interval; at 5e-3 a pulse in a thousand is a fault itself
        fault=st.sampled_from(["missing", "double", "spurious"]),
        place=st.floats(0, 1),
        seed=st.integers(0, 1000),
    )
    @example(ends=(16.0, 6.0), duration=1.0, per_rev=60, jitter=0.0, fault="spurious", place=0.9976, seed=0)
    @settings(max_examples=60, deadline=None)
    @pytest.mark.compiles
    def test_of_one_pulse(self, ends, duration, per_rev, jitter, fault, place, seed):
        times = self.ramp(*ends, duration, per_rev, jitter, np.random.default_rng(seed))
        # intervals are predicted from five, those of stripes from a revolution too: nearer to an end less is certain
        margin = 6 + min(per_rev, 6)
        assume(times.size > 4 * max(margin, per_rev))
        at = margin + int(place * (times.size - 2 * margin - 2))
        gap = times[at + 1] - times[at]
        share = {"missing": 0.0, "double": 0.05, "spurious": 0.5}[fault]
        bad = np.delete(times, at) if fault == "missing" else np.insert(times, at + 1, times[at] + share * gap)
        phase = shaft_phase(bad, pulses_per_rev=per_rev)
        repairs = phase.repairs
        found = {"missing": repairs.missing, "double": repairs.double, "spurious": repairs.spurious}
        assert found == {"missing": 0, "double": 0, "spurious": 0} | {fault: 1}
        np.testing.assert_array_equal(phase.times_s, np.delete(times, at) if fault == "missing" else times)
