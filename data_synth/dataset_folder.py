"""Make a labelled dataset of many scenes in a folder, byte for byte the same for any number of workers.

Record i depends only on the plan, its seed and i. Records are written in files of a few dozen, each moved into place
when complete, so that an interrupted run resumes with the missing files.
"""

import hashlib
import math
import shutil
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from data_synth.card import data_card
from data_synth.cost import BYTES, explain
from data_synth.draws import PlanError
from data_synth.plan import Plan, load_plan
from data_synth.scene.scene import SceneError
from data_synth.simulation import simulate
from hums.jobs import Job, Serial, Tally, Workers, run_jobs
from hums.records.dataset_store import INDEX, LABELS, SHARD, open_dataset, write_index
from hums.records.outputs import SEALS, atomic_write, check_outputs, make_folder, remove_partial_files, write_text
from hums.records.store import write_shard
from signals._validation import checked

CHECKSUMS = "checksums.sha256"
_AMPLE = 20  # times the size of the samples, more than any truth needs; avoids an estimate that takes seconds
_MADE_BY = "# made by hums-toolkit {}; the plan with its scene and every default written out\n"
_EXPLAINED = 9  # records from which size and time are estimated, since the truth differs by half between gearboxes


@checked
def make_dataset(
    plan: Plan | str | Path,
    folder: str | Path,
    *,
    workers: Workers | None = None,
    progress: bool = False,
    force: bool = False,
) -> Tally:
    """Make the dataset of a plan in a folder, or resume an interrupted one.

    Parameters
    ----------
    plan : Plan, str or Path
        A plan, the path of its file, or its name in the catalogue.
    folder : str or Path
        New, empty, or started with the same plan. It receives ``plan.toml``, ``shards/``, ``index.h5`` (which
        `hums.open_dataset` reads), ``labels.csv``, ``data-card.md``, ``records.parquet`` if the plan requests it and,
        last, ``checksums.sha256``.
    workers : Serial, Processes or Cluster of `hums.jobs`, optional
        Workers that compute the files; default: one process. The files do not depend on them.
    progress : bool
        Whether to show a progress bar on standard error.
    force : bool
        Whether to use a folder that holds other files, replacing those of other programs.

    Returns
    -------
    Tally
        Number of files written by this run, `done`, and already present, `kept`.

    Raises
    ------
    PlanError
        A disk too small, a folder that holds something else, or ``parquet = true`` without pyarrow.
    RecordError
        A table or card in the folder that was edited or belongs to another program.
    SceneError
        A record that cannot be simulated, with its number and class.
    JobError
        See `hums.jobs.run_jobs`.

    Examples
    --------
    Two records, each in its own file, then the same call again:

    >>> import tempfile
    >>> from data_synth import make_dataset
    >>> from data_synth.plan import parse_plan
    >>> plan = parse_plan('''scene = "demo"
    ... records = 2
    ... seed = 1
    ... change = { duration_s = 0.2, rate_hz = 12000, fault = [] }''')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     make_dataset(plan, folder).done, make_dataset(plan, folder).kept
    (2, 2)
    """
    plan = load_plan(plan) if isinstance(plan, str | Path) else plan
    folder = Path(folder).absolute()
    written = [folder / name for name in (INDEX, LABELS, CHECKSUMS, "data-card.md")]
    written += [folder / "records.parquet"] if plan.table.parquet else []
    if plan.table.parquet and find_spec("pyarrow") is None:
        raise PlanError('parquet = true needs pyarrow: pip install "hums-toolkit[parquet]", or leave it out.')
    check_outputs(written, folder=folder, force=force)
    _begin_folder(folder, plan, force=force)
    count = math.ceil(plan.records / plan.records_per_shard)
    jobs = [
        Job(name=Path(SHARD.format(shard)).name, item=shard, size=len(_record_numbers(plan, shard)))
        for shard in range(count)
    ]
    shards = folder / "shards"
    _check_space(plan, shards, missing=sum(job.size for job in jobs if not (shards / job.name).exists()))
    tally = run_jobs(
        partial(write_records, plan),
        jobs,
        folder=shards,
        workers=workers or Serial(),
        title="records" if progress else None,
    )
    remove_partial_files(folder)
    if tally.done or force or not all(path.is_file() for path in written):
        write_text(folder / "data-card.md", data_card(plan))
        write_index(folder, [shards / job.name for job in jobs], plan=plan.text)
        if plan.table.parquet:
            _write_parquet(folder, at_once=plan.records_per_shard)
        _write_checksums(folder)
    return tally


def _write_parquet(folder: Path, *, at_once: int) -> None:
    """Write the records of a dataset as a Parquet file, one row per record, with labels and channels as columns."""
    import pyarrow as pa  # noqa: PLC0415 - an optional part
    from pyarrow.parquet import ParquetWriter  # noqa: PLC0415

    data = open_dataset(folder)
    names = [str(name) for name, values in data.variables.items() if values.dims[:1] == ("record",)]
    facts = {name: str(data[name].attrs.get("units", "")) for name in names} | {"rate_hz": str(data.attrs["rate_hz"])}

    def cells(part: xr.DataArray) -> list[Any]:
        pulses = str(part.dims[-1]).startswith("pulse_")  # padded with NaN in records with fewer
        return (
            part.values.tolist() if part.ndim == 1 else [row[~np.isnan(row)] if pulses else row for row in part.values]
        )

    parts = (data.isel(record=slice(at, at + at_once)) for at in range(0, data.sizes["record"], at_once))
    tables = (pa.table({name: cells(part[name]) for name in names}, metadata=facts) for part in parts)
    first = next(tables)
    with atomic_write(folder / "records.parquet") as path, ParquetWriter(path, first.schema) as writer:
        for table in chain([first], tables):
            writer.write_table(table)


def _write_checksums(folder: Path) -> None:
    """Write the SHA-256 of every file of a dataset, in the format of ``sha256sum -c``."""

    def line(path: Path) -> str:
        with path.open("rb") as file:
            return f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path.relative_to(folder).as_posix()}\n"

    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name not in {CHECKSUMS, SEALS})
    write_text(folder / CHECKSUMS, "".join(map(line, files)))


@dataclass(frozen=True, kw_only=True)
class DatasetCost:
    """Estimated size and time of a dataset.

    Attributes
    ----------
    size_bytes, truth_bytes : int
        Size in bytes of the samples of all records, and of their truth before compression.
    seconds : float
        Time in s on one core.
    """

    size_bytes: int
    truth_bytes: int
    seconds: float


def dataset_cost(plan: Plan) -> DatasetCost:
    """Return the estimated size and time of a dataset, from `data_synth.explain` for some of its records.

    Parameters
    ----------
    plan : Plan
        Plan of the dataset.

    Returns
    -------
    DatasetCost

    Raises
    ------
    SceneError
        A record among these that cannot be simulated.

    Examples
    --------
    A thousand records of 50,000 samples of 4 bytes:

    >>> from data_synth import load_plan
    >>> from data_synth.dataset_folder import dataset_cost
    >>> dataset_cost(load_plan("classification")).size_bytes
    200000000
    """
    numbers = range(0, plan.records, max(1, plan.records // _EXPLAINED))[:_EXPLAINED]
    seconds, truth = list[float](), list[float]()
    for number in numbers:
        scene, trial_s = plan.scene(number), plan.table.detectability_s
        own = explain(scene)
        seconds.append(own.seconds)
        truth.append(own.truth_bytes * np.dtype(plan.table.dtype).itemsize / BYTES)
        if trial_s is not None and scene.faults:
            healthy = scene.changed(faults=(), duration_s=min(trial_s, scene.duration_s))
            seconds.append(explain(healthy).seconds)
    return DatasetCost(
        size_bytes=plan.records * plan.record_bytes,
        truth_bytes=round(sum(truth) / len(numbers) * plan.records),
        seconds=sum(seconds) / len(numbers) * plan.records,
    )


def write_records(plan: Plan, shard: int, path: Path) -> None:
    """Simulate the records of one file and write it.

    Parameters
    ----------
    plan : Plan
    shard : int
        Number of the file, from 0.
    path : Path
        Destination of the file.
    """
    numbers = _record_numbers(plan, shard)
    made = [_simulated(plan, number) for number in numbers]
    records, rows = [record for record, _ in made], [row for _, row in made]
    labels = {name: [row[name] for row in rows] for name in rows[0]}
    write_shard(records, path, labels=labels, dtype=plan.table.dtype)


def _record_numbers(plan: Plan, shard: int) -> range:
    return range(shard * plan.records_per_shard, min((shard + 1) * plan.records_per_shard, plan.records))


def _simulated(plan: Plan, number: int) -> tuple[xr.Dataset, dict[str, Any]]:
    """Return a record and its labels."""
    labels, trial_s = plan.labels(number), plan.table.detectability_s
    seed, machine_seed = plan.seed_of(number), plan.machine_seed_of(number)
    try:
        record = simulate(plan.scene(number), seed=seed, machine_seed=machine_seed, detectability=trial_s or False)
    except SceneError as error:
        raise SceneError(f'record {number}, class "{labels["class"]}": {error}') from None
    if trial_s is not None:
        found_db = record["truth_fault_detectability_db"].values[0]
        labels["detectability_db"] = float(found_db[0]) if found_db.size else math.nan
    return record.drop_vars("truth_fault_detectability_db", errors="ignore"), labels


# ---- the folder --------------------------------------------------------------------------------------------


def _begin_folder(folder: Path, plan: Plan, *, force: bool) -> None:
    """Write the plan into a new folder; refuse a folder begun with another plan."""
    mark = folder / "plan.toml"
    own = _MADE_BY.format(version("hums-toolkit")) + plan.text
    if mark.is_file():
        _require_same_plan(folder, mark.read_text(encoding="utf-8"), own)
        return
    make_folder(folder)
    if not force and any(not path.name.startswith(".hums-") for path in folder.iterdir()):
        raise PlanError(
            f"{folder} holds files that do not belong to a dataset; name a new folder, or use --force (force=True)."
        )
    write_text(mark, own)


def _require_same_plan(folder: Path, there: str, own: str) -> None:
    """Raise PlanError for a folder whose plan differs, with the first differing line."""
    differing = next(((a, b) for a, b in zip(there.splitlines(), own.splitlines(), strict=False) if a != b), None)
    if there == own:
        return
    detail = f': there "{differing[0].strip()}", here "{differing[1].strip()}"' if differing else ""
    raise PlanError(
        f"{folder} was started with another plan or another version of this program{detail}. Name another folder, or "
        f"resume with its own plan, {folder / 'plan.toml'}."
    )


def _check_space(plan: Plan, shards: Path, *, missing: int) -> None:
    """Raise PlanError if the disk has less free space than the missing records need with their truth."""
    shards.mkdir(exist_ok=True)
    free = shutil.disk_usage(shards).free
    if free >= missing * plan.record_bytes * _AMPLE:
        return
    truth_bytes = dataset_cost(plan).truth_bytes / plan.records
    need = missing * (plan.record_bytes + truth_bytes)
    if need > free:
        raise PlanError(
            f"{missing} records of {plan.record_bytes / 1e6:.3g} MB and {truth_bytes / 1e6:.3g} MB of truth need "
            f"{need / 1e9:.3g} GB, but {free / 1e9:.3g} GB are free at {shards}. Lower records, duration_s or rate_hz, "
            "use float32, or choose another disk."
        )
