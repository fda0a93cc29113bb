import gzip
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from fleets import HEALTHY, PINION, followed, observed

import hums
from hums.fleet.monitor import update
from hums.fleet.monitor_settings import MonitorSettings
from hums.fleet.observation import FleetError
from hums.fleet.watch import read_state, watch, write_state

SETTINGS = MonitorSettings(baseline_records=2)


def analysis(day, *, machine="mill", regime="", seed=0):
    """Return the analysis of a record of a day's."""
    noise = np.random.default_rng([day, seed]).normal(size=8000)
    record = hums.make_record(
        {"a": noise}, rate_hz=4000, units="g", angle=hums.NominalSpeed(rpm=1200, shaft="input"), machine=machine,
        regime=regime, recorded_at=f"2026-03-{day:02d}T08:00:00Z",
    )  # fmt: skip
    settings = hums.AnalysisSettings(envelope_band_hz=None, most_tracks=0, pictures=False)
    return hums.analyze(record, hums.load_gearbox("two-stage"), settings=settings)


def watched(seed, state):
    """Watch a record of the second day, in a process of its own."""
    return watch(analysis(2, seed=seed), state).why


def test_the_state_is_kept_between_calls(tmp_path):
    found = [watch(analysis(day), tmp_path / "state", settings=SETTINGS) for day in (1, 2, 3)]
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
    assert [watch(one, tmp_path / "state", settings=SETTINGS).judged for _ in range(4)] == [False] * 4
    assert watch(analysis(2), tmp_path / "state").why == "learning"


def test_processes_that_share_a_state_lose_no_record(tmp_path):
    watch(analysis(1), tmp_path / "state", settings=MonitorSettings(baseline_records=20))
    with ProcessPoolExecutor(4) as pool:
        assert list(pool.map(partial(watched, state=tmp_path / "state"), range(6))) == ["learning"] * 6
    assert len(read_state(tmp_path / "state").epochs[""].pending) == 7


def test_a_regime_of_the_record_is_held_against_its_own_baseline(tmp_path):
    regimes = ("hover", "hover", "hover", "cruise")
    found = [
        watch(analysis(day, regime=of), tmp_path / "state", settings=SETTINGS).why for day, of in enumerate(regimes, 1)
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
