"""Indicators of all records as a tidy Parquet file; the only module that imports pyarrow, which is optional."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from hums.fleet.result_files import StoredRecord
from hums.fleet.series import INDICATOR
from hums.fleet.table import columns_of
from hums.records.outputs import atomic_write

NO_PYARROW = 'indicators.parquet needs pyarrow, which is not installed: pip install "hums-toolkit[parquet]".'
_FACTS = ("record", "machine", "recorded_at")
_RECORDS = 1_000  # of a group: some 10 MB of memory while it is written


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
    import pyarrow as pa  # noqa: PLC0415 - an optional part
    from pyarrow.parquet import ParquetWriter  # noqa: PLC0415

    names = pa.dictionary(pa.int32(), pa.string())
    fields = [(name, names) for name in (*_FACTS, *INDICATOR)]
    schema = pa.schema([*fields, ("value", pa.float32())])
    with atomic_write(path) as part, ParquetWriter(part, schema) as writer:
        for start in range(0, max(len(records), 1), _RECORDS):
            writer.write_table(_rows(pa, schema, records[start : start + _RECORDS]))
    return ""


def _rows(pa: Any, schema: Any, records: Sequence[StoredRecord]) -> Any:  # noqa: ANN401 - pyarrow is loaded in use alone
    counts = [len(one.indicators.keys) for one in records]
    keys, places = columns_of([one.indicators.keys for one in records])
    at = np.concatenate([np.zeros(0, dtype=np.int64), *places])
    which = np.repeat(np.arange(len(records)), counts)
    columns = [_named(pa, [getattr(one, name) for one in records], which) for name in _FACTS]
    columns += [_named(pa, [key[number] for key in keys], at) for number in range(len(INDICATOR))]
    values = np.concatenate([np.zeros(0, dtype=np.float32), *(one.indicators.values for one in records)])
    return pa.Table.from_arrays([*columns, pa.array(values)], schema=schema)


def _named(pa: Any, names: Sequence[str], at: np.ndarray[Any, Any]) -> Any:  # noqa: ANN401
    """Return a dictionary-encoded column of names."""
    distinct, places = np.unique(np.array(names, dtype=np.str_), return_inverse=True)
    numbers = pa.array(places[at].astype(np.int32)) if len(names) else pa.array([], pa.int32())
    return pa.DictionaryArray.from_arrays(numbers, pa.array(distinct.tolist(), pa.string()))
