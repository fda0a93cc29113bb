import csv

import numpy as np
import pytest
from fleets import HEALTHY, PINION, kept, observed

from hums.fleet.alarms import ALARM_COLUMNS, Alarm
from hums.fleet.monitor import MachineState
from hums.fleet.monitor_settings import MonitorSettings
from hums.fleet.watched_machines import (
    MachineHistory,
    watch_machines,
    write_alarms,
    write_baselines,
    write_components,
)
from hums.records.store import open_tree

SETTINGS = MonitorSettings(baseline_records=20)
COURSE = [*HEALTHY, *(observed(number, **PINION) for number in range(40, 50))]
RECORDS = [kept(one) for one in COURSE]


def watched(records):
    return watch_machines(records, settings=SETTINGS)


def tables(histories, folder):
    write_alarms(histories, folder / "alarms.csv")
    write_components(histories, folder / "components.csv")
    return [(folder / name).read_bytes() for name in ("alarms.csv", "components.csv")]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    histories = watched(RECORDS)
    return histories, tables(histories, folder), folder


def test_any_order_of_the_records_gives_the_same(whole, tmp_path):
    shuffled = [RECORDS[number] for number in np.random.default_rng(1).permutation(len(RECORDS))]
    assert tables(watched(shuffled), tmp_path) == whole[1]


def test_alarms_have_the_columns_and_name_their_baseline(whole):
    with (whole[2] / "alarms.csv").open(encoding="utf-8", newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert tuple(row) == ALARM_COLUMNS
    assert (row["machine"], row["component"], row["state"]) == ("mill", "stage 1/pinion", "raised")
    write_baselines(whole[0], whole[2] / "baseline.h5")
    with open_tree(whole[2] / "baseline.h5") as tree:
        baseline = tree[row["baseline"]].to_dataset()
        assert baseline.attrs["machine"] == "mill"
        assert baseline.record.to_numpy().tolist() == [f"record {number}" for number in range(20)]


def test_components_are_the_worst_first(whole):
    with (whole[2] / "components.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert rows[0]["component"] == "stage 1/pinion"
    assert rows[0]["state"] == "raised"
    assert float(rows[0]["growth_per_day"]) != 0


def test_growth_is_that_of_the_score_since_it_left_normal():
    history = MachineHistory(state=MachineState(machine="mill", alarms={"pinion": Alarm(since=COURSE[10].recorded_at)}))
    history.records = [
        {"seen": one, "scores": {"pinion": 0.5 * max(0, number - 10)}} for number, one in enumerate(COURSE[:20])
    ]
    assert history.growth_per_day("pinion") == pytest.approx(0.5, rel=1e-9)  # a record a day
    assert np.isnan(history.growth_per_day("wheel"))


def test_a_component_says_how_many_times_normal_its_indicators_are():
    rising = [*HEALTHY[:20], *(observed(40 + n, **PINION | {"shift": 1.0 + n}) for n in range(3))]
    history = MachineHistory(state=MachineState(machine="mill", settings=SETTINGS))
    history.follow(rising, ())
    # the shift of the logarithm; one of several series that drive it
    assert history.last.drivers["stage 1/pinion"][-1] == pytest.approx(np.exp(3.0), rel=0.6)
