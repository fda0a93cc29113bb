"""Indicators of all records as a tidy Parquet file; pandas writes it with pyarrow, which is optional."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hums.fleet.result_files import StoredRecord
from hums.fleet.series import INDICATOR
from hums.fleet.table import columns_of
from hums.records.outputs import atomic_write

NO_PYARROW = 'indicators.parquet needs pyarrow, which is not installed: pip install "hums-toolkit[parquet]".'
_FACTS = ("record", "machine", "recorded_at")


def write_indicators(records: Sequence[StoredRecord], path: Path) -> str:
    """Write ``indicators.parquet``: one row per record, channel, component and indicator.

    Parameters
    ----------
    records : sequence of StoredRecord
        All records.
    path : Path
        Columns ``record, machine, recorded_at, channel, component, kind, indicator, units, value``; names are stored as
        dictionaries. A file of an earlier run is removed if it cannot be rewritten.

    Returns
    -------
    str
        Reason why there is no file; empty if it was written.
    """
    if find_spec("pyarrow") is None:
        path.unlink(missing_ok=True)
        return NO_PYARROW
    keys, places = columns_of([one.indicators.keys for one in records])
    which = np.repeat(np.arange(len(records)), [len(one) for one in places])
    at, numbers = np.concatenate([[], *places]).astype(np.int64), [one.indicators for one in records]
    columns: dict[str, Any] = {name: pd.Categorical([getattr(one, name) for one in records])[which] for name in _FACTS}
    columns |= {name: pd.Categorical([key[number] for key in keys])[at] for number, name in enumerate(INDICATOR)}
    columns["value"] = np.concatenate([np.zeros(0, dtype=np.float32), *(one.values for one in numbers)])  # noqa: PD011
    with atomic_write(path) as part:
        pd.DataFrame(columns).to_parquet(part, engine="pyarrow", index=False)
    return ""
