"""Records of snapshots: what is joined comes out again as it was, from memory, from a file and from a dataset."""

import numpy as np
import pytest

from hums.records.dataset_store import dataset_record, open_dataset, write_index
from hums.records.fields import RecordError
from hums.records.quantities import Measured
from hums.records.record import NominalSpeed, PulseTimes, make_record
from hums.records.snapshots import join_snapshots, snapshot_record, snapshots_of
from hums.records.store import write_shard
from hums.records.validation import check_record

RATE_HZ, COUNT = 2000.0, 400
WHEN = ("2010-12-01T23:59:50Z", "2010-12-02T00:00:00Z", "2010-12-02T00:00:20Z")


def short(number, *, when="", pulses=0, rpm=1800.0, count=COUNT, **changes):
    rng = np.random.default_rng(number)
    angle = NominalSpeed(rpm=rpm, shaft="input")
    if pulses:
        angle = PulseTimes(times_s=np.arange(pulses) * 0.2 / pulses, shaft="input", pulses_per_rev=1)
    values = {"h": rng.normal(size=count), "v": rng.normal(size=count)}
    arguments = {"rate_hz": RATE_HZ, "units": "g", "angle": angle, "machine": "1_1", "recorded_at": when} | changes
    return make_record(values, **arguments)


@pytest.fixture(scope="module")
def parts():
    return [short(number, when=when, pulses=5 + number) for number, when in enumerate(WHEN)]


def test_what_is_joined_comes_out_again(parts):
    joined = join_snapshots(parts)
    assert dict(joined.h.sizes) == {"snapshot": 3, "time": COUNT}
    assert joined.snapshot_s.values.tolist() == [0, 10, 30]  # over midnight, and unevenly
    assert all(one.identical(part) for one, part in zip(snapshots_of(joined), parts, strict=True))


def test_a_dataset_keeps_it(parts, tmp_path):
    records = [join_snapshots(parts[:2]), join_snapshots(parts[1:])]
    (tmp_path / "shards").mkdir()
    for number, record in enumerate(records):  # file 1 has no record
        write_shard([record], tmp_path / f"shards/{2 * number:06d}.h5", labels={"file": ["x"]}, dtype="float64")
    write_index(tmp_path, sorted((tmp_path / "shards").iterdir()), plan="by hand")
    for number, record in enumerate(records):
        assert dataset_record(tmp_path, number).identical(record)
    whole = open_dataset(tmp_path)
    assert whole.h.sizes == {"record": 2, "snapshot": 2, "time": COUNT}
    np.testing.assert_array_equal(whole.h[1, 1], parts[2].h)


def test_each_has_its_speed_and_what_was_measured():
    joined = join_snapshots(
        [short(n, rpm=1500 + n, measured={"torque": Measured(values=0.1 * n, units="kN m")}) for n in range(3)]
    )
    assert "snapshot_s" not in joined.coords  # their times are not known
    with pytest.raises(RecordError, match=r"no snapshot 3; its 3"):
        snapshot_record(joined, 3)
    assert float(snapshot_record(joined, 2).nominal_speed) == pytest.approx(1502 / 60)
    assert float(snapshot_record(joined, 2).torque) == pytest.approx(200.0)
    assert joined.torque.attrs["units"] == "N m"


@pytest.mark.parametrize(
    ("others", "said"),
    [
        ([], "no record to join"),
        ([short(0), short(1, count=399)], '"h" is .*399'),
        ([short(0), short(1, machine="1_2")], '"machine" is 1_2'),
        ([short(0), short(1, rate_hz=2001.0)], '"rate_hz" is 2001.0'),
        ([short(0), short(1, units="m s-2")], '"h" is .*m s-2'),
        ([short(0), short(1, pulses=4)], "same channels"),
        ([short(0, when=WHEN[1]), short(1, when=WHEN[0])], "begins -10 s after"),
        ([short(0, when=WHEN[0]), short(1, when="2010-12-01T23:59:50.1Z")], "which lasts 0.2 s"),
        ([join_snapshots([short(0)])], "not of snapshots"),
    ],
)
def test_what_cannot_be_joined(others, said):
    with pytest.raises(RecordError, match=said):
        join_snapshots(others)


def test_checks_hold_for_each_snapshot(parts):
    joined = join_snapshots(parts)
    late = joined.tachometer.copy(data=joined.tachometer.values + np.array([[0], [9], [0]]))
    with pytest.raises(RecordError, match="lie outside the record"):
        check_record(joined.assign(tachometer=late))
    slow = join_snapshots([short(0), short(1)])
    with pytest.raises(RecordError, match=r"nominal_speed=0.0"):
        check_record(slow.assign(nominal_speed=slow.nominal_speed.copy(data=[30.0, 0.0])))


def test_snapshots_of_a_clock_that_runs_on():
    times_s = np.arange(5) * 0.04
    pulses = [PulseTimes(times_s=start_s + times_s, shaft="input", pulses_per_rev=1) for start_s in (0.0, 30.0)]
    parts = [short(0, angle=angle, start_s=start_s) for angle, start_s in zip(pulses, (0.0, 30.0), strict=True)]
    joined = join_snapshots(parts)
    np.testing.assert_allclose(joined.tachometer, [times_s, times_s], atol=1e-12)
    assert joined.attrs["start_s"] == 0
