import numpy as np
import pandas as pd
import pytest
from fleets import HEALTHY, kept

from hums.fleet import table
from hums.fleet.series import Numbers, shared
from hums.fleet.table import write_tables

KEYS = (("a", "record", "channel", "rms", "g"), ("b", "stage 1/pinion", "gear", "fm4", "1"))


def records():
    found = [kept(one) for one in HEALTHY[:3]]
    for number, one in enumerate(found):
        keys = KEYS[: 1 + number % 2]
        values = np.arange(len(keys), dtype=np.float32) + 10 * number
        object.__setattr__(one, "indicators", Numbers(keys=shared(keys), values=values))
    return found


def test_a_row_for_each_record_and_indicator(tmp_path):
    pytest.importorskip("pyarrow")
    expected = [
        (one.record, one.machine, one.recorded_at, *key, value)
        for one in records()
        for key, value in zip(one.indicators.keys, list(one.indicators.values), strict=True)
    ]
    write_tables(records(), tmp_path)
    found = pd.read_parquet(tmp_path / "indicators.parquet")
    assert list(found.itertuples(index=False, name=None)) == expected
    assert list(found) == [
        *("record", "machine", "recorded_at", "channel", "component", "kind", "indicator", "units", "value"),
    ]


def test_no_indicators_of_an_earlier_run_without_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "find_spec", lambda _: None)
    (tmp_path / "indicators.parquet").touch()  # of other records than the tables beside it
    write_tables(records(), tmp_path)
    assert not (tmp_path / "indicators.parquet").exists()
