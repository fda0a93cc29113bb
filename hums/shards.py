"""A dataset in a folder: many alike records and their labels, opened as one lazy `xarray.Dataset`.

The folder holds ``index.h5``, the labels of all records and what their channels are, and the records themselves
in files of a few dozen (`hums.store.write_shard`). Files are opened when values are read and closed again, so a
dataset may be pickled, forked and read from many processes at once.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from hums.record import RecordError, attach_time
from hums.store import open_hdf5, open_shard, open_tree, record_of_shard

__all__ = ["INDEX", "SCHEMA", "dataset_record", "dataset_size", "is_dataset", "open_dataset"]

INDEX, SCHEMA = "index.h5", "hums-dataset/1"


def is_dataset(folder: str | Path) -> bool:
    """Tell whether a folder holds a dataset that is complete."""
    return (Path(folder) / INDEX).is_file()


def open_dataset(folder: str | Path) -> xr.Dataset:
    """Open a dataset that ``hums dataset`` made.

    Parameters
    ----------
    folder : path

    Returns
    -------
    xarray.Dataset
        Each channel (record, time) and each tachometer's pulse times (record, pulse_NAME), padded with NaN, with
        their units; samples are read when they are used. Labels are coordinates along `record`, in memory. The
        truth of one record is in what `dataset_record` returns.

    Raises
    ------
    RecordError
        If the folder holds no dataset, or one that is not finished.
    """
    folder = Path(folder).resolve()
    index = _index(folder, labels=True)
    rows = index.sizes["record"]
    variables = {}
    for name, facts in json.loads(index.attrs["arrays_json"]).items():
        values = _Rows(
            folder=folder,
            pattern=index.attrs["shards"],
            per_shard=int(index.attrs["records_per_shard"]),
            name=name,
            shape=(rows, *facts["width"]),
            dtype=np.dtype(facts["dtype"]),
        )
        variables[name] = xr.Variable(("record", *facts["dims"]), indexing.LazilyIndexedArray(values), facts["attrs"])
    attrs = {name: index.attrs[name] for name in ("schema", "machine", "rate_hz", "start_s", "plan")}
    dataset = xr.Dataset(variables, attrs=attrs)
    return _with_time(dataset).assign_coords(index.data_vars).assign_coords(record=np.arange(rows))


def dataset_size(folder: str | Path) -> int:
    """Return how many records a dataset holds."""
    return int(_index(Path(folder).resolve(), labels=False).attrs["records"])


def dataset_record(folder: str | Path, number: int) -> xr.Dataset:
    """Read one record of a dataset, as it was simulated, with its truth; in memory.

    Parameters
    ----------
    folder : path
    number : int
        From 0.

    Raises
    ------
    RecordError
        If there is no such record, or its file is damaged.
    """
    folder = Path(folder).resolve()
    index = _index(folder, labels=False)
    count = index.attrs["records"]
    if not 0 <= number < count:
        raise RecordError(f"{folder} has no record {number}; its {count} records count from 0 to {count - 1}.")
    shard, row = divmod(number, int(index.attrs["records_per_shard"]))
    with open_shard(folder / index.attrs["shards"].format(shard)) as opened:
        try:
            return record_of_shard(opened, row)
        except OSError as error:
            raise _damaged(opened.encoding["source"], f"record {number}", error) from error


def _index(folder: Path, *, labels: bool) -> xr.Dataset:
    if not folder.is_dir():
        raise RecordError(f"{folder}: there is no such folder; name the one that hums dataset wrote into.")
    if not is_dataset(folder):
        begun = (folder / "plan.toml").is_file()
        remedy = "finish it with the same hums dataset again" if begun else "make one with hums dataset"
        raise RecordError(f"{folder} holds no finished dataset, no {INDEX}; {remedy}.")
    with open_tree(folder / INDEX) as tree:
        index = tree.to_dataset()
        index = index.load() if labels else index[[]].assign_attrs(records=index.sizes["record"])
    if index.attrs.get("schema") != SCHEMA:
        raise RecordError(f"{folder / INDEX} holds {index.attrs.get('schema')!r}, where a dataset holds {SCHEMA!r}.")
    return index


def _with_time(dataset: xr.Dataset) -> xr.Dataset:
    """Attach the time axes that each record has; none is stored."""
    return dataset.assign_coords(attach_time(dataset.isel(record=0)).coords)


class _Rows(BackendArray):
    """One array (record, ...) over all files of a dataset, padded with NaN to the longest row."""

    def __init__(
        self, *, folder: Path, pattern: str, per_shard: int, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]
    ) -> None:
        self.folder, self.pattern, self.per_shard, self.name = folder, pattern, per_shard, name
        self.shape, self.dtype = shape, dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:  # noqa: ANN401
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        picked, *columns = (np.asarray(np.arange(size)[part]) for size, part in zip(self.shape, key, strict=True))
        rows, shards = np.atleast_1d(picked), np.atleast_1d(picked) // self.per_shard
        spans = [(int(part.min()), int(part.max()) + 1) if part.size else (0, 0) for part in columns]
        block = np.full((rows.size, *(stop - start for start, stop in spans)), np.nan, dtype=self.dtype)
        for shard in np.unique(shards):
            with open_hdf5(self.folder / self.pattern.format(shard)) as file:
                for at in np.flatnonzero(shards == shard):
                    values = self._row(file, int(rows[at]), [slice(*span) for span in spans])
                    place: tuple[Any, ...] = (at, *(slice(size) for size in values.shape))
                    block[place] = values
        within: list[Any] = [part - start for part, (start, _) in zip(columns, spans, strict=True)]
        kept: NDArray[Any] = block[(slice(None), *within)]
        return np.asarray(kept if picked.ndim else kept[0])

    def _row(self, file: Any, number: int, columns: Sequence[slice]) -> NDArray[Any]:  # noqa: ANN401
        try:
            return np.asarray(file[self.name][(number % self.per_shard, *columns)])
        except (OSError, KeyError) as error:
            raise _damaged(file.filename, f'"{self.name}" of record {number}', error) from error


def _damaged(path: str, what: str, error: Exception) -> RecordError:
    return RecordError(
        f"{path}: {what} cannot be read ({error}). The file is damaged: remove it and run the same hums dataset again, "
        "which makes what is missing."
    )
