import numpy as np
import pandas as pd
import pytest
from fleets import HEALTHY, kept

from hums.fleet import parquet
from hums.fleet.parquet import write_indicators
from hums.fleet.series import Numbers, shared

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
    assert write_indicators(records(), tmp_path / "indicators.parquet") == ""
    table = pd.read_parquet(tmp_path / "indicators.parquet")
    assert list(table.itertuples(index=False, name=None)) == expected
    assert list(table) == [
        *("record", "machine", "recorded_at", "channel", "component", "kind", "indicator", "units", "value"),
    ]


def test_no_file_without_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "find_spec", lambda _: None)
    (tmp_path / "indicators.parquet").touch()  # of an earlier run: other records than the tables beside it
    reason = write_indicators([], tmp_path / "indicators.parquet")
    assert reason == ('indicators.parquet needs pyarrow, which is not installed: pip install "hums-toolkit[parquet]".')
    assert not (tmp_path / "indicators.parquet").exists()
