import csv
import gzip
import json
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from fleets import HEALTHY, PINION, followed, kept, observed

import hums
from hums.fleet.monitor import ALARM_COLUMNS, Alarm, MachineState, update
from hums.fleet.observation import FleetError, MonitorSettings
from hums.fleet.watched_machines import (
    MachineHistory,
    read_state,
    watch,
    watch_machines,
    write_alarms,
    write_baselines,
    write_components,
    write_state,
)

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
    write_baselines(whole[0], whole[2] / "baselines.json")
    (baseline,) = json.loads((whole[2] / "baselines.json").read_text())["mill"]
    assert baseline["identity"] == row["baseline"]
    assert baseline["records"] == [f"record {number}" for number in range(20)]


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


OF_TWO = MonitorSettings(baseline_records=2)


def analysis(day, *, machine="mill", regime="", seed=0):
    """Return the analysis of a record of a day's."""
    noise = np.random.default_rng([day, seed]).normal(size=8000)
    record = hums.make_record(
        {"a": noise}, rate_hz=4000, units="g", angle=hums.NominalSpeed(rpm=1200, shaft="input"), machine=machine,
        regime=regime, recorded_at=f"2026-03-{day:02d}T08:00:00Z",
    )  # fmt: skip
    settings = hums.AnalysisSettings(envelope_band_hz=None, most_tracks=0, pictures=False)
    return hums.analyze(record, hums.load_gearbox("two-stage"), settings=settings)


def watched_call(seed, state):
    """Watch a record of the second day, in a process of its own."""
    return watch(analysis(2, seed=seed), state).why


def test_the_state_is_kept_between_calls(tmp_path):
    found = [watch(analysis(day), tmp_path / "state", settings=OF_TWO) for day in (1, 2, 3)]
    assert [one.why for one in found] == ["learning", "learning", ""]
    assert found[2].index["record"] < 1
    # neither the latest record again, nor one of the baseline, nor one that comes late
    before = (tmp_path / "state").read_bytes()
    for again in (3, 1):
        late = watch(analysis(again), tmp_path / "state")
        assert not late.judged
        assert late.why.startswith(("watched before", "recorded at 2026-03-01T08:00:00Z, before the latest"))
    assert (tmp_path / "state").read_bytes() == before


def test_a_record_watched_again_and_again_is_no_baseline(tmp_path):
    one = analysis(1)
    assert [watch(one, tmp_path / "state", settings=OF_TWO).judged for _ in range(4)] == [False] * 4
    assert watch(analysis(2), tmp_path / "state").why == "learning"


def test_processes_that_share_a_state_lose_no_record(tmp_path):
    watch(analysis(1), tmp_path / "state", settings=MonitorSettings(baseline_records=20))
    with ProcessPoolExecutor(4) as pool:
        assert list(pool.map(partial(watched_call, state=tmp_path / "state"), range(6))) == ["learning"] * 6
    assert len(read_state(tmp_path / "state").epochs[""].pending) == 7


def test_a_regime_of_the_record_is_held_against_its_own_baseline(tmp_path):
    regimes = ("hover", "hover", "hover", "cruise")
    found = [
        watch(analysis(day, regime=of), tmp_path / "state", settings=OF_TWO).why for day, of in enumerate(regimes, 1)
    ]
    assert found == ["learning", "learning", "", "regime 'cruise' is not in the baseline"]


def test_another_machine_is_refused(tmp_path):
    watch(analysis(1), tmp_path / "state")
    with pytest.raises(FleetError, match="of machine 'fan' and the state of 'mill'; keep a state for each"):
        watch(analysis(2, machine="fan"), tmp_path / "state")


LATER = [observed(number, **PINION) for number in range(40, 50)]


@pytest.mark.parametrize("stopped", [7, 30, 42])
def test_saved_and_resumed_it_goes_on_bit_for_bit(tmp_path, stopped):
    course = [*HEALTHY, *LATER]
    through, found = followed(course)
    state, _ = followed(course[:stopped])
    write_state(state, tmp_path / "state")
    resumed = read_state(tmp_path / "state")
    again = [update(resumed, one) for one in course[stopped:]]
    assert [one.index for one in again] == [one.index for one in found[stopped:]]
    write_state(through, tmp_path / "through")
    write_state(resumed, tmp_path / "resumed")
    assert (tmp_path / "through").read_bytes() == (tmp_path / "resumed").read_bytes()


def test_its_size_does_not_grow(tmp_path):
    sizes = []
    state, _ = followed(HEALTHY)
    for number in range(40, 400):
        update(state, observed(number))
        if number in (60, 399):
            write_state(state, tmp_path / "state")
            sizes.append((tmp_path / "state").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]  # numbers of other digits compress a little differently


@pytest.mark.parametrize(
    "damaged",
    [
        b"nothing",
        gzip.compress(b"[]"),
        gzip.compress(
            b'{"schema": "hums-watch/14", "state": {"__kind__": "array", "values": [1], "dtype": "O", "shape": [2]}}'
        ),
        gzip.compress(b"[" * 100_000),
        gzip.compress(b"{}" * 1000)[:-20] + bytes(20),
    ],
    ids=["text", "list", "array", "deep", "torn"],
)
def test_what_is_no_state(tmp_path, damaged):
    (tmp_path / "state").write_bytes(damaged)
    with pytest.raises(FleetError, match=r"not a state of hums\.watch"):
        read_state(tmp_path / "state")
