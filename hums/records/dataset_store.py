"""A dataset in a folder: records of one layout and their labels, opened as one lazy `xarray.Dataset`.

``index.h5`` in the folder contains the labels of all records and the attributes of their channels; the records are in
files of a few dozen each (`hums.records.store.write_shard`). Files are open only while values are read, so a dataset
may be pickled, forked and read by many processes at once.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from hums.records.channels import attach_time
from hums.records.fields import RecordError, plain_cell
from hums.records.outputs import atomic_write
from hums.records.store import open_hdf5, open_shard, open_tree, record_of_shard, write_tree
from signals._validation import brief, checked

INDEX, LABELS, SCHEMA = "index.h5", "labels.csv", "hums-dataset/1"
SHARD = "shards/{:06d}.h5"
_KEPT = ("machine", "rate_hz", "start_s", "average_of", "samples_per_rev", "averaged_over")  # of the records
_BEGUN = {"plan.toml": "hums dataset", "conversion.json": "hums convert"}  # files written before the index


def is_begun(folder: str | Path) -> bool:
    """Return whether a folder contains a dataset, complete or not."""
    return is_dataset(folder) or any((Path(folder) / mark).is_file() for mark in _BEGUN)


def is_dataset(folder: str | Path) -> bool:
    """Return whether a folder contains a complete dataset."""
    return (Path(folder) / INDEX).is_file()


@checked
def open_dataset(folder: str | Path) -> xr.Dataset:
    r"""Open a dataset written by ``hums dataset`` or ``hums convert``.

    Parameters
    ----------
    folder : str or Path
        Folder of the dataset.

    Returns
    -------
    xarray.Dataset
        Each channel (record, time) and the pulse times of each tachometer (record, pulse_NAME), padded with NaN, with
        their units, read on access. Labels are coordinates along `record`, in memory. The ground truth of a record is
        returned by `dataset_record`.

    Raises
    ------
    RecordError
        If the folder contains no complete dataset.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import data_synth, hums
    >>> plan = 'records = 2\nseed = 1\nclass = [{ name = "healthy" }]\n[scene]\ngearbox = "two-stage"\n'
    >>> plan += 'rate_hz = 2000\nduration_s = 1\nfidelity = "kinematic"\nspeed = { link = "input", rpm = 600 }\n'
    >>> plan += 'tachometer = { link = "input", pulses_per_rev = 1 }\n'
    >>> plan += 'resonance = { frequency_hz = 500, damping_ratio = 0.05 }\n'
    >>> plan += 'sensor = [{ name = "vib", on = "output", units = "g" }]\n'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pathlib.Path(folder, "two.toml").write_text(plan, encoding="utf-8")
    ...     _ = data_synth.make_dataset(pathlib.Path(folder, "two.toml"), pathlib.Path(folder, "two"))
    ...     dataset = hums.open_dataset(pathlib.Path(folder, "two"))
    ...     print(dict(dataset.vib.sizes), dataset["class"].values.tolist(), dataset.tachometer.shape)
    {'record': 2, 'time': 2000} ['healthy', 'healthy'] (2, 10)
    """
    folder = Path(folder).absolute()
    index = _index(folder, labels=True)
    rows = index.sizes["record"]
    variables = {}
    for name, layout in json.loads(index.attrs["arrays_json"]).items():
        values = _Rows(
            folder=folder,
            pattern=index.attrs["shards"],
            starts=_starts(index),
            name=name,
            shape=(rows, *layout["width"]),
            dtype=np.dtype(layout["dtype"]),
        )
        variables[name] = xr.Variable(("record", *layout["dims"]), indexing.LazilyIndexedArray(values), layout["attrs"])
    attrs = {name: index.attrs[name] for name in ("schema", *_KEPT, "plan") if name in index.attrs}
    dataset = xr.Dataset(variables, attrs=attrs)
    times = attach_time(dataset.isel(record=0)).coords  # the same for all records, and not stored
    return dataset.assign_coords(times).assign_coords(index.data_vars).assign_coords(record=np.arange(rows))


def dataset_files(folder: str | Path) -> list[Path]:
    """Return the file that holds each record of a dataset."""
    folder = Path(folder).absolute()
    index = _index(folder, labels=False)
    count, pattern = int(index.attrs["records"]), index.attrs["shards"]
    starts = _starts(index)
    return [folder / pattern.format(_place(starts, number)[0]) for number in range(count)]


@checked
def dataset_record(folder: str | Path, number: int) -> xr.Dataset:
    r"""Return one record of a dataset with its truth, in memory.

    Parameters
    ----------
    folder : str or Path
        Folder of the dataset.
    number : int
        Number of the record, from 0.

    Returns
    -------
    xarray.Dataset
        The record as it was simulated.

    Raises
    ------
    RecordError
        If there is no such record, or its file is damaged.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import data_synth, hums
    >>> plan = 'records = 2\nseed = 1\nclass = [{ name = "healthy" }]\n[scene]\ngearbox = "two-stage"\n'
    >>> plan += 'rate_hz = 2000\nduration_s = 1\nfidelity = "kinematic"\nspeed = { link = "input", rpm = 600 }\n'
    >>> plan += 'tachometer = { link = "input", pulses_per_rev = 1 }\n'
    >>> plan += 'resonance = { frequency_hz = 500, damping_ratio = 0.05 }\n'
    >>> plan += 'sensor = [{ name = "vib", on = "output", units = "g" }]\n'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pathlib.Path(folder, "two.toml").write_text(plan, encoding="utf-8")
    ...     _ = data_synth.make_dataset(pathlib.Path(folder, "two.toml"), pathlib.Path(folder, "two"))
    ...     record = hums.dataset_record(pathlib.Path(folder, "two"), 1)
    >>> record.sizes["time"], record.vib.units, any(name.startswith("truth_") for name in record)
    (2000, 'g', True)
    """
    folder = Path(folder).absolute()
    index = _index(folder, labels=False)
    count = index.attrs["records"]
    if not isinstance(number, int | np.integer) or not 0 <= number < count:
        raise RecordError(f"{folder} has no record {brief(number)}; its {count} records are numbered 0 to {count - 1}.")
    shard, row = _place(_starts(index), number)
    with open_shard(folder / index.attrs["shards"].format(shard)) as opened:
        try:
            return record_of_shard(opened, row)
        except OSError as error:
            raise _damaged(opened.encoding["source"], f"record {number}", error) from error


def write_index(folder: Path, shards: Sequence[Path], *, plan: str) -> None:
    """Write ``index.h5`` and ``labels.csv``: the labels of all records, and the shapes and attributes of their arrays.

    Parameters
    ----------
    folder : Path
        Folder of the dataset.
    shards : sequence of Path
        Files of its records, named by `SHARD`, in order; numbers may be skipped.
    plan : str
        Description of its origin, in words or TOML.
    """
    tables, arrays = list[xr.Dataset](), dict[str, Any]()
    attrs = dict[str, Any]()
    for path in shards:
        with open_shard(path) as shard:
            labels = dict[str, xr.Variable]()
            for name, variable in shard.variables.items():
                if variable.attrs.get("role") == "label":
                    labels[str(name)] = variable.load()
                elif variable.dims[:1] == ("record",) and variable.dtype.kind == "f":
                    _update_array_facts(arrays, str(name), variable)
            tables.append(xr.Dataset(labels))
            attrs = json.loads(str(shard["attrs_of_record"].values[0]))
    table = xr.concat(tables, "record")
    rows = {int(path.stem): len(one["record"]) for path, one in zip(shards, tables, strict=True)}
    each = [rows.get(number, 0) for number in range(max(rows) + 1)]
    table.attrs = {
        "schema": SCHEMA,
        **{name: attrs[name] for name in _KEPT if name in attrs},
        "plan": plan,
        "shards": SHARD,
        "shard_starts": np.concatenate([[0], np.cumsum(each)[:-1]]),
        "arrays_json": json.dumps(arrays),
    }
    with atomic_write(folder / LABELS) as part:
        table.to_dataframe().map(plain_cell).to_csv(part)
    write_tree(xr.DataTree(table), folder / INDEX)


def _update_array_facts(arrays: dict[str, Any], name: str, array: xr.Variable) -> None:
    """Record dims, type and attributes of an array, and the largest shape among the files."""
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in array.attrs.items()}
    (_, *dims), (_, *width) = array.dims, array.shape
    facts = arrays.setdefault(name, {"dims": dims, "width": width, "dtype": str(array.dtype), "attrs": plain})
    facts["width"] = [max(pair) for pair in zip(facts["width"], width, strict=True)]


def _starts(index: xr.Dataset) -> NDArray[np.int64]:
    """Return the number of the first record of each file, equal to the next one's if a file is empty."""
    return np.atleast_1d(np.asarray(index.attrs["shard_starts"], dtype=np.int64))


def _place(starts: NDArray[np.int64], number: int) -> tuple[int, int]:
    """Return the number of the file that holds a record, and its row there."""
    shard = int(np.searchsorted(starts, number, side="right")) - 1
    return shard, number - int(starts[shard])


def _index(folder: Path, *, labels: bool) -> xr.Dataset:
    """Return the index of a dataset: its attributes and, if requested, the labels in memory."""
    if not folder.is_dir():
        raise RecordError(f"{folder}: there is no such folder; name an output folder of hums dataset or hums convert.")
    if not is_dataset(folder):
        begun = next((how for mark, how in _BEGUN.items() if (folder / mark).is_file()), "")
        remedy = f"complete it by the same {begun} again" if begun else "make one with hums dataset or hums convert"
        raise RecordError(f"{folder} holds no complete dataset, as it has no {INDEX}; {remedy}.")
    with open_tree(folder / INDEX) as tree:
        index = tree.to_dataset()
        index = index.load() if labels else index[[]].assign_attrs(records=index.sizes["record"])
    if index.attrs.get("schema") != SCHEMA:
        raise RecordError(
            f"{folder / INDEX} has schema {index.attrs.get('schema')!r}, not {SCHEMA!r}; open it with the version that "
            "wrote it, or make it again."
        )
    return index


@dataclass(kw_only=True, eq=False)
class _Rows(BackendArray):
    """One array (record, ...) over all files of a dataset, padded with NaN to the longest row."""

    folder: Path
    pattern: str
    starts: NDArray[np.int64]
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:  # noqa: ANN401
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        """Return the elements selected by an index from their shards, with NaN beyond the end of a record."""
        picked, *columns = (np.asarray(np.arange(size)[part]) for size, part in zip(self.shape, key, strict=True))
        rows = np.atleast_1d(picked)
        shards = np.searchsorted(self.starts, rows, side="right") - 1
        spans = [(int(part.min()), int(part.max()) + 1) if part.size else (0, 0) for part in columns]
        block = np.full((rows.size, *(stop - start for start, stop in spans)), np.nan, dtype=self.dtype)
        for shard in np.unique(shards):
            with open_hdf5(self.folder / self.pattern.format(shard)) as file:
                for at in np.flatnonzero(shards == shard):
                    values = self._row(file, int(rows[at]), [slice(*span) for span in spans])
                    target: tuple[Any, ...] = (at, *(slice(size) for size in values.shape))
                    block[target] = values
        within: list[Any] = [part - start for part, (start, _) in zip(columns, spans, strict=True)]
        kept: NDArray[Any] = block[(slice(None), *within)]
        return np.asarray(kept if picked.ndim else kept[0])

    def _row(self, file: Any, number: int, columns: Sequence[slice]) -> NDArray[Any]:  # noqa: ANN401
        try:
            return np.asarray(file[self.name][(_place(self.starts, number)[1], *columns)])
        except (OSError, KeyError) as error:
            raise _damaged(file.filename, f'"{self.name}" of record {number}', error) from error


def _damaged(path: str, what: str, error: Exception) -> RecordError:
    return RecordError(
        f"{path}: {what} cannot be read ({error}). The file is damaged: remove it and run the same hums dataset (or "
        "hums convert) again, which replaces it."
    )
