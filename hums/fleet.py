"""Many records -> one table of lines, indicators and verdicts, and their trends over time.

Each record is analysed by itself, in any process, and what is kept of it is one small file; so a run that was
stopped goes on where it was, records that were added later are the only ones analysed when it is run again, and
memory holds one record a worker. A record that cannot be analysed is a row with the sentence that says why.
"""

import gzip
import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import xarray as xr

from hums.analysis import AnalysisSettings, analyze
from hums.fleet_table import write_tables
from hums.gearbox import Gearbox, load_gearbox
from hums.jobs import Job, Serial, Workers, run_jobs
from hums.layout import Analysis, group
from hums.search import ENVELOPE, ORDER_SPECTRUM
from hums.shards import dataset_record, dataset_size, is_dataset
from hums.store import atomic_write, open_record
from hums.tables import findings_table, indicator_table, line_table

__all__ = ["Fleet", "FleetError", "analyze_fleet"]


class FleetError(ValueError):
    """A run over many records that cannot start."""


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """What a run over many records left.

    Attributes
    ----------
    folder : Path
        With ``fleet.h5`` and ``fleet.csv``, a row a record, ``trends.csv``, a row a series and machine, and
        ``records/``, what was kept of each.
    records, failed : int
        Rows, and those of them that hold a sentence instead of results.
    analysed, kept : int
        Records analysed in this run, and before it.
    errors : mapping of str to str
        Why each of the failed records failed.
    no_trends : str
        Why ``trends.csv`` has no row; empty where it has.
    """

    folder: Path
    records: int
    failed: int
    analysed: int
    kept: int
    errors: Mapping[str, str] = field(default_factory=dict)
    no_trends: str = ""


@dataclass(frozen=True, kw_only=True)
class _Source:
    """A record: a file, or one of a dataset in a folder."""

    name: str
    path: Path
    number: int | None = None


def analyze_fleet(
    sources: Sequence[str | Path],
    gearbox: Gearbox | str | Path,
    folder: str | Path,
    *,
    settings: AnalysisSettings | None = None,
    workers: Workers | None = None,
    progress: bool = False,
) -> Fleet:
    """Analyse many records of one kind of gearbox.

    Parameters
    ----------
    sources : sequence of path
        Records, folders of records (searched for ``.h5``), and folders that ``hums dataset`` made.
    gearbox : Gearbox, path or catalogue name
    folder : path
        New, or of an earlier run with the same gearbox and settings: records that are there are not analysed again
        unless their file has changed.
    settings : AnalysisSettings, optional
        By default those of `hums.analyze` without tracks, which the table does not hold.
    workers : Serial, Processes or Cluster of `hums.jobs`, optional
        Serial if left out.
    progress : bool
        Whether to draw a bar on standard error.

    Returns
    -------
    Fleet

    Raises
    ------
    FleetError
        If there are no records, a path is not there, or the folder belongs to another gearbox or other settings.
    JobError
        See `hums.jobs.run_jobs`.
    """
    gearbox = gearbox if isinstance(gearbox, Gearbox) else load_gearbox(gearbox)
    settings = settings or AnalysisSettings(most_tracks=0)
    found = _sources(sources)
    folder = Path(folder).resolve()
    task = {
        "gearbox": gearbox.model_dump_json(exclude_none=True),
        "settings": settings.model_dump_json(),
        "version": version("hums-toolkit"),
    }
    pieces = folder / "records"
    pieces.mkdir(parents=True, exist_ok=True)
    _claim(folder / "task.json", task)
    jobs = [Job(name=_piece(source), item=source) for source in found]
    tally = run_jobs(
        partial(_write_piece, task["gearbox"], task["settings"]),
        jobs,
        folder=pieces,
        workers=workers or Serial(),
        title="records" if progress else None,
    )
    written = write_tables([pieces / job.name for job in jobs], folder)
    return Fleet(
        folder=folder,
        records=len(jobs),
        failed=len(written.errors),
        analysed=tally.done,
        kept=tally.kept,
        errors=written.errors,
        no_trends=written.no_trends,
    )


def _claim(mark: Path, task: dict[str, str]) -> None:
    """Note what the folder is for, or refuse one that is for something else."""
    if not mark.is_file():
        with atomic_write(mark) as part:
            part.write_text(json.dumps(task, indent=1), encoding="utf-8")
        return
    there = json.loads(mark.read_text(encoding="utf-8"))
    differing = [name for name in task if there.get(name) != task[name]]
    if differing:
        raise FleetError(
            f"{mark.parent} holds records analysed with another {' and another '.join(differing)}; a table mixes none. "
            "Name another folder."
        )


# ---- the records -------------------------------------------------------------------------------------------


def _sources(given: Sequence[str | Path]) -> list[_Source]:
    found: dict[tuple[Path, int | None], _Source] = {}
    for path in map(Path, given):
        if not path.exists():
            raise FleetError(f"{path}: there is no such file or folder; check the path.")
        for source in _in_folder(path) if path.is_dir() else [_Source(name=str(path), path=path.resolve())]:
            found[source.path, source.number] = source
    if not found:
        raise FleetError("no records were named; name files, or folders that hold some.")
    return list(found.values())


def _in_folder(folder: Path) -> list[_Source]:
    whole = folder.resolve()
    if is_dataset(folder) or (folder / "plan.toml").is_file():
        return [_Source(name=f"{folder}/{n}", path=whole, number=n) for n in range(dataset_size(folder))]
    there = [_Source(name=str(path), path=path.resolve()) for path in sorted(folder.rglob("*.h5"))]
    if not there:
        raise FleetError(f"{folder} holds no record, no file that ends in .h5; make records with hums convert.")
    return there


def _piece(source: _Source) -> str:
    """Name the file of a record after the record and the state its file is in."""
    words: list[Any] = [str(source.path), source.number]
    if source.number is None and source.path.exists():
        facts = source.path.stat()
        words += [facts.st_size, facts.st_mtime_ns]
    return hashlib.sha256(json.dumps(words).encode()).hexdigest()[:24] + ".json.gz"


def _write_piece(gearbox: str, settings: str, source: _Source, path: Path) -> None:
    row = {"record": source.name} | _row(source, *_prepared(gearbox, settings))
    with atomic_write(path) as part:
        part.write_bytes(gzip.compress(json.dumps(row).encode(), mtime=0))


@lru_cache(maxsize=4)
def _prepared(gearbox: str, settings: str) -> tuple[Gearbox, AnalysisSettings]:
    return Gearbox.model_validate_json(gearbox), AnalysisSettings.model_validate_json(settings)


def _row(source: _Source, gearbox: Gearbox, settings: AnalysisSettings) -> dict[str, Any]:
    facts = {"machine": "", "recorded_at": ""}
    try:
        with _opened(source) as record:
            facts = {name: str(record.attrs.get(name, "")) for name in facts}
            return facts | _results(analyze(record, gearbox, settings=settings))
    except Exception as error:  # noqa: BLE001 - whatever is wrong with one record, the others are to be analysed
        sentence = str(error) if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: {error}"
        return facts | {"error": sentence or type(error).__name__}


def _opened(source: _Source) -> xr.Dataset:
    return open_record(source.path) if source.number is None else dataset_record(source.path, source.number)


def _results(analysis: Analysis) -> dict[str, Any]:
    speed = group(analysis, "speed")["speed_hz"]
    return {
        "error": "",
        "speed_hz": speed.size / float((1 / speed).sum()),
        "lines": [line for name in (ORDER_SPECTRUM, ENVELOPE) for line in _lines(analysis, name)],
        "indicators": [
            [row[name] for name in ("channel", "component", "kind", "indicator", "unit", "value")]
            for row in indicator_table(analysis).to_dict("records")
            if math.isfinite(row["value"])
        ],
        "findings": [
            [row[name] for name in ("component", "kind", "verdict", "channel", "evidence")]
            for row in findings_table(analysis).to_dict("records")
        ],
    }


def _lines(analysis: Analysis, name: str) -> Iterator[list[Any]]:
    for row in line_table(analysis, name).to_dict("records"):
        key = [row["channel"], name, *(row[part] for part in ("component", "kind", "harmonic", "sideband", "units"))]
        yield [*key, row["order"], row["amplitude"], row["snr"], int(row["claimed"])]
