"""Angular resampling in blocks against the whole record at once, and its memory over a long one."""

import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from signals.resampling.angular_stream import AngularStream, angular_blocks
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
        blocks = list(angular_blocks(split(record, lengths), **common))
        assert all(block.values.size % samples_per_rev == 0 for block in blocks)
        assert len(blocks) > 2
        starts = [block.start_rev for block in blocks]
        np.testing.assert_array_equal(starts, whole.start_rev + np.cumsum([0, *(b.revolutions for b in blocks[:-1])]))
        joined = np.concatenate([block.values for block in blocks])
        np.testing.assert_allclose(joined, whole.values, rtol=0, atol=1e-12)
        assert blocks[0].unsettled[0] == whole.unsettled[0]
        assert blocks[-1].unsettled[1] == whole.unsettled[1]

    @pytest.mark.parametrize("block_size", [1, 1024, 70_000])
    def test_blocks_of_any_size(self, pulsed_phase, block_size):
        record = np.random.default_rng(1).standard_normal(3_000 if block_size == 1 else 150_000)
        common = settings(pulsed_phase, 128)
        whole = angular_resample(record, **common)
        blocks = list(angular_blocks([record[:1000], record[1000:]], block_size=block_size, **common))
        assert {block.values.size for block in blocks[:-1]} <= {block_size}
        assert 0 < blocks[-1].values.size <= block_size
        np.testing.assert_allclose(
            np.concatenate([block.values for block in blocks]), whole.values, rtol=0, atol=ROUNDING
        )
        np.testing.assert_allclose(
            np.concatenate([block.angle_rad for block in blocks]), whole.angle_rad, rtol=0, atol=1e-9
        )
        assert sum(block.unsettled[0] for block in blocks) == whole.unsettled[0]

    def test_gaps_are_marked_alike(self, pulsed_phase):
        record = np.random.default_rng(2).standard_normal(120_000)
        record[:10] = record[70_000:70_100] = np.nan
        common = settings(pulsed_phase, 64, missing="mark")
        whole = angular_resample(record, **common)
        joined = np.concatenate([block.values for block in angular_blocks(split(record, [5, 999]), **common)])
        np.testing.assert_allclose(joined, whole.values, rtol=0, atol=ROUNDING)
        assert 0 < np.isnan(joined).sum() < joined.size / 10

    def test_a_record_that_starts_long_before_the_phase_is_known(self):
        phase = constant_speed(50.0, start_s=2.0, stop_s=4.0)
        t = np.arange(5 * 51_200) / RATE_HZ
        blocks = angular_blocks(split(np.cos(2 * np.pi * 350 * t), [10_000]), **settings(phase, 64))
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


LONG = """
    import sys
    import numpy as np
    sys.path.insert(0, {folder!r})
    from conftest import revolutions, times_at
    from signals import AngularStream, ShaftPhase

    rate_hz, per_rev, laps = 51_200.0, 128, 6  # a lap of 20 s is 1,000 revolutions and ten swings of the speed
    start_s = 75 * 20.0  # as if 75 laps had gone before
    turns = times_at(np.arange(1000))
    times = start_s + np.concatenate([lap * 20.0 + turns for lap in range(laps)])
    phase = ShaftPhase(times_s=times, revolutions=np.arange(times.size, dtype=float))
    lap = revolutions(np.arange(1_024_000) / rate_hz).astype(float)
    record = np.cos(2 * np.pi * 5 * lap) + np.cos(2 * np.pi * 5.5 * lap)
    stream = AngularStream(rate_hz=rate_hz, phase=phase, samples_per_rev=per_rev, start_s=start_s)
    def peak_mb():
        # of this program alone: the largest that getrusage knows may be that of the process it was started from
        peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM:"))
        return int(peak.split()[1]) / 1024

    total, count = np.zeros(per_rev), 0
    for number in range(laps):
        signal = stream.push(record)
        if number == 1:
            early_mb = peak_mb()
        total += signal.values.reshape(-1, per_rev).sum(axis=0)
        count += signal.revolutions
    last = stream.finish()
    total += last.values.reshape(-1, per_rev).sum(axis=0)
    count += last.revolutions
    truth = np.cos(2 * np.pi * 5 * np.arange(per_rev) / per_rev)
    print(count, np.abs(total / count - truth).max(), early_mb, peak_mb())
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the peak of resident memory is read from /proc")
def test_six_million_samples_take_the_memory_of_two():
    folder = str(Path(__file__).parents[1])
    code = textwrap.dedent(LONG).format(folder=folder)
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    count, error, early_mb, megabytes = (float(word) for word in out.split())
    assert count == 5999  # pulses, less one
    # the half order cancels in pairs of revolutions, of which the last is alone; the filter itself errs by 2e-6
    assert error < 1 / count + 5e-6
    assert megabytes < early_mb + 20  # the four million samples between are 33 MB, their turns 4
