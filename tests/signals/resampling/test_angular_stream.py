"""Angular resampling in blocks against the whole record at once, and its memory."""

import tracemalloc

import numpy as np
import pytest

from signals.resampling.angular_stream import AngularStream
from signals.resampling.resampling import angular_resample
from signals.shaft.phase import ShaftPhase, constant_speed

RATE_HZ = 51_200.0
ROUNDING = 1e-13  # of values of about one, summed in another order where a block ends: a hundred products


@pytest.fixture(scope="module")
def pulsed_phase(swinging):
    return ShaftPhase(times_s=swinging.times_at(np.arange(301)), revolutions=np.arange(301.0))


def split(record, lengths):
    """The record in blocks of these lengths, over and over."""
    at = 0
    while at < record.size:
        for length in lengths:
            yield record[at : at + length]
            at += length


def resampled(blocks, **settings):
    """What the stream completes with each block, and what remains at its end."""
    stream = AngularStream(**settings)
    return [part for part in (*map(stream.push, blocks), stream.finish()) if part.values.size]


def settings(phase, samples_per_rev, **more):
    return {"rate_hz": RATE_HZ, "phase": phase, "samples_per_rev": samples_per_rev, **more}


class TestAgainstTheWhole:
    """The shaft swings through 1,024 samples a revolution, so with those both forms of the filter take turns."""

    @pytest.mark.parametrize(
        ("method", "samples_per_rev"),
        [("sinc", 32), ("sinc", 1024), ("sinc", 3000), ("cubic", 1024), ("linear", 1024)],
    )
    @pytest.mark.parametrize("lengths", [(100_000,), (40_000, 1, 0, 7, 333)], ids=["long", "ragged"])
    def test_splitting_changes_nothing(self, pulsed_phase, method, samples_per_rev, lengths):
        record = 1e3 + np.random.default_rng(0).standard_normal(210_000)
        common = settings(pulsed_phase, samples_per_rev, start_s=0.31, method=method)
        whole = angular_resample(record, **common)
        blocks = resampled(split(record, lengths), **common)
        assert all(block.values.size % samples_per_rev == 0 for block in blocks)
        assert len(blocks) > 2
        starts = [block.start_rev for block in blocks]
        np.testing.assert_array_equal(starts, whole.start_rev + np.cumsum([0, *(b.revolutions for b in blocks[:-1])]))
        joined = np.concatenate([block.values for block in blocks])
        np.testing.assert_allclose(joined, whole.values, rtol=0, atol=1e-12)
        assert blocks[0].unsettled[0] == whole.unsettled[0]
        assert blocks[-1].unsettled[1] == whole.unsettled[1]

    def test_gaps_are_marked_alike(self, pulsed_phase):
        record = np.random.default_rng(2).standard_normal(120_000)
        record[:10] = record[70_000:70_100] = np.nan
        common = settings(pulsed_phase, 64, missing="mark")
        whole = angular_resample(record, **common)
        joined = np.concatenate([block.values for block in resampled(split(record, [5, 999]), **common)])
        np.testing.assert_allclose(joined, whole.values, rtol=0, atol=ROUNDING)
        assert 0 < np.isnan(joined).sum() < joined.size / 10

    def test_a_record_that_starts_long_before_the_phase_is_known(self):
        phase = constant_speed(50.0, start_s=2.0, stop_s=4.0)
        t = np.arange(5 * 51_200) / RATE_HZ
        blocks = resampled(split(np.cos(2 * np.pi * 350 * t), [10_000]), **settings(phase, 64))
        joined = np.concatenate([block.values for block in blocks])
        assert joined.size == 100 * 64
        truth = np.cos(2 * np.pi * 7 * np.arange(joined.size) / 64)
        assert np.abs(joined - truth).max() < 2e-6  # with the record before and after, to the very ends


class TestRefusals:
    def test_a_gap_is_named_by_its_place_in_the_record(self, pulsed_phase):
        stream = AngularStream(**settings(pulsed_phase, 64, start_s=1.0))
        stream.push(np.zeros(51_200))
        with pytest.raises(ValueError, match=r"the first at index 51203 \(2\.00006 s\)"):
            stream.push([0.0, 0.0, 0.0, np.inf])

    def test_after_the_end(self, pulsed_phase):
        stream = AngularStream(**settings(pulsed_phase, 64))
        stream.push(np.zeros(5000))
        stream.finish()
        for call in (stream.finish, lambda: stream.push(np.zeros(3))):
            with pytest.raises(ValueError, match="finished; make another AngularStream"):
                call()

    @pytest.mark.parametrize(("method", "least"), [("sinc", 2), ("cubic", 4), ("linear", 2)])
    def test_too_few_samples(self, pulsed_phase, method, least):
        stream = AngularStream(**settings(pulsed_phase, 64, method=method))
        stream.push(np.zeros(least - 1))
        with pytest.raises(ValueError, match=f"after {least - 1} samples; at least {least}"):
            stream.finish()


def test_memory_does_not_grow_with_the_record(swinging):
    """A lap of 20 s is 1,000 revolutions and ten swings of the speed; the record begins as if 75 had gone before."""
    per_rev, start_s, lap_s = 128, 1500.0, 20.0
    turns = swinging.times_at(np.arange(1000))
    times = start_s + np.concatenate([lap * lap_s + turns for lap in range(4)])
    phase = ShaftPhase(times_s=times, revolutions=np.arange(times.size, dtype=float))
    angle = swinging.revolutions(np.arange(1_024_000) / RATE_HZ).astype(float)
    lap = np.cos(2 * np.pi * 5 * angle) + np.cos(2 * np.pi * 5.5 * angle)
    stream = AngularStream(**settings(phase, per_rev, start_s=start_s))
    total, held = np.zeros(per_rev), []
    tracemalloc.start()
    for _ in range(4):
        total += stream.push(lap).values.reshape(-1, per_rev).sum(axis=0)
        held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    total += stream.finish().values.reshape(-1, per_rev).sum(axis=0)
    assert held[-1] - held[0] < 100_000  # bytes: a lap is eight million
    # 3,999 revolutions: the half order cancels in pairs, of which the last is alone; the filter itself errs by 2e-6
    truth = np.cos(2 * np.pi * 5 * np.arange(per_rev) / per_rev)
    assert np.abs(total / 3999 - truth).max() < 1 / 3999 + 5e-6
