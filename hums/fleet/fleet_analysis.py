"""Analysis of many records: one table of lines, indicators and verdicts, and their trends over time.

Each record is analysed independently, in any process, and leaves one small result file. An interrupted run therefore
resumes, a later run analyses only records that are new or changed, and memory holds one record per worker. A record
that cannot be analysed, or kills its worker process, becomes a row with its error.
"""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.fleet.fleet_page import write_page
from hums.fleet.observation import NOT_ANALYSED, FleetError, MonitorSettings, order_key, read_maintenance
from hums.fleet.result_files import StoredRecord, read_results, results, write_row
from hums.fleet.table import write_tables
from hums.fleet.watched_machines import (
    watch_machines,
    write_alarms,
    write_baselines,
    write_components,
)
from hums.gearbox.model import Gearbox, load_gearbox
from hums.jobs import Job, Serial, Workers, cpu_limit, locked, run_jobs
from hums.records.dataset_store import dataset_files, dataset_record, is_begun, open_dataset
from hums.records.outputs import check_outputs, make_folder, own_json, write_text
from hums.records.store import open_record
from signals._validation import checked

_READING_S, _READING_S_PER_BYTE = 20.0, 1e-7  # of a record by a worker: a hundred times what a whole file takes


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Result of `analyze_fleet`: its folder, the number of records, and the errors.

    Attributes
    ----------
    folder : Path
        Holds ``fleet.h5`` and ``fleet.csv``, one row per record; ``trends.csv``, one row per series and machine;
        ``alarms.csv``, one row per alarm; ``components.csv``, the condition of every component;
        ``baselines.json``, the baselines; ``indicators.parquet``, one row per indicator and record, if pyarrow is
        installed; ``fleet.html``, the fleet page; and ``records/``, the results of each record.
    records, failed : int
        Numbers of records, and of records that could not be analysed.
    analysed, kept : int
        Number of records analysed in this run, and in earlier runs.
    errors : mapping of str to str
        Error of each failed record, by name.
    no_trends : str
        Reason why ``trends.csv`` has no row; empty if it has rows.
    alarms : int
        Number of alarms raised, the rows of ``alarms.csv``.
    learning : tuple of str
        Machines whose baseline is incomplete, so that they are not judged.

    Examples
    --------
    See `analyze_fleet`, which returns it.

    >>> from pathlib import Path
    >>> import hums
    >>> fleet = hums.Fleet(folder=Path("fleet"), records=3, failed=1, analysed=2, kept=1)
    >>> fleet.records - fleet.failed
    2
    """

    folder: Path
    records: int
    failed: int
    analysed: int
    kept: int
    errors: Mapping[str, str] = field(default_factory=dict)
    no_trends: str = ""
    alarms: int = 0
    learning: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Source:
    """A record: a file, or a row of a dataset folder with its class, and the file that holds its samples."""

    name: str
    path: Path
    file: Path
    number: int | None = None
    label: str = ""

    @property
    def whole_name(self) -> str:
        """Name that is unique to each record, from whatever folder it is given."""
        return str(self.path) if self.number is None else f"{self.path}/{self.number}"


@checked
def analyze_fleet(
    sources: Sequence[str | Path],
    gearbox: Gearbox | str | Path,
    folder: str | Path,
    *,
    settings: AnalysisSettings | None = None,
    workers: Workers | None = None,
    progress: bool = False,
    monitoring: MonitorSettings | None = None,
    maintenance: str | Path | None = None,
    append: bool = False,
    force: bool = False,
) -> Fleet:
    """Analyse many records of one gearbox type; write their table, trends, alarms and baselines into a folder.

    Parameters
    ----------
    sources : sequence of path
        Records, folders of records (searched for ``.h5``), and folders written by ``hums dataset``.
    gearbox : Gearbox, path or catalogue name
        The gearbox of all records.
    folder : path
        New folder, or that of an earlier run with the same gearbox and settings: its records are not analysed again
        unless their files have changed.
    settings : AnalysisSettings, optional
        Defaults to ``AnalysisSettings(most_tracks=0)``: the table holds no tracks.
    workers : Serial, Processes or Cluster of `hums.jobs`, optional
        Where the records are analysed. Default: `Serial`.
    progress : bool
        Whether to draw a progress bar on standard error.
    monitoring : MonitorSettings, optional
        Choice of baseline, and rate of false alarms.
    maintenance : path, optional
        CSV file of replaced components and acknowledged alarms; see `read_maintenance`.
    append : bool
        Whether to keep the records of earlier runs in this folder in the fleet.
    force : bool
        Whether to overwrite files of the same names that other programs wrote.

    Returns
    -------
    Fleet
        The folder, the number of records, and the errors.

    Raises
    ------
    FleetError
        If there are no records, a path does not exist, or the folder belongs to another gearbox or other settings.
    RecordError
        If, without `force`, the folder holds files of these names from other programs.
    JobError
        See `hums.jobs.run_jobs`.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> with TemporaryDirectory() as folder:
    ...     hums.save_record(record, f"{folder}/monday.h5")
    ...     fleet = hums.analyze_fleet([f"{folder}/monday.h5"], "two-stage", f"{folder}/fleet")
    >>> fleet.records, fleet.failed
    (1, 0)
    """
    named = gearbox.name if isinstance(gearbox, Gearbox) else str(gearbox)
    gearbox = gearbox if isinstance(gearbox, Gearbox) else load_gearbox(gearbox)
    settings = (settings or AnalysisSettings(most_tracks=0)).model_copy(update={"pictures": False})  # it draws none
    work = read_maintenance(maintenance) if maintenance is not None else ()
    folder = Path(os.path.realpath(folder))
    outputs = [folder / name for name in (*FILES, _INDICATORS, _LIST, _TASK)]
    found = _sources(sources, written=outputs)
    check_outputs(outputs, inputs=[*(source.file for source in found), named, maintenance or named], force=force)
    task = {
        "gearbox": gearbox.model_dump_json(exclude_none=True),
        "settings": settings.model_dump_json(),
        "version": f"hums-toolkit {version('hums-toolkit')}",
        "format": _FORMAT,
    }
    results_folder = folder / "records"
    make_folder(results_folder)
    with locked(folder):  # from the list that is read to the one that is written
        _check_task(folder / _TASK, task)
        listed = own_json(folder / _LIST) if append else {}  # in the order of the runs
        names = listed | {source.whole_name: _result_name(source) for source in found}
        jobs = [Job(name=_result_name(source), item=source) for source in found]
        tally = run_jobs(
            partial(_analyse_to_file, gearbox, settings),
            jobs,
            folder=results_folder,
            workers=workers or Serial(),
            title="records" if progress else None,
            when_killed=lambda *_: None,
        )
        write_text(folder / _LIST, json.dumps(names))
        paths = {name: results_folder / file for name, file in names.items()}
        records = read_results(path for path in paths.values() if path.exists())
        records += [_killed(name) for name, path in paths.items() if not path.exists()]
        records.sort(key=lambda one: order_key("", one.record))  # whatever the files' order was
        histories = watch_machines(records, settings=monitoring or MonitorSettings(), work=work)
        write_alarms(histories, folder / "alarms.csv")
        write_components(histories, folder / "components.csv")
        write_baselines(histories, folder / "baselines.json")
        no_trends = write_tables(
            records,
            folder,
            health={one["seen"].record: one for history in histories for one in history.records},
            limits={key: score for history in histories for key, score in history.severe_scores.items()},
        )
        write_page(histories, folder / "fleet.html", gearbox=named)
    errors = {one.record: one.error for one in records if one.error}
    return Fleet(
        folder=folder,
        records=len(records),
        failed=len(errors),
        analysed=tally.done,
        kept=len(records) - tally.done,
        errors=errors,
        no_trends=no_trends,
        alarms=sum(len(history.alarms) for history in histories),
        learning=tuple(history.state.machine for history in histories if history.waiting == "learning"),
    )


FILES = ("fleet.html", "fleet.csv", "fleet.h5", "trends.csv", "alarms.csv", "components.csv", "baselines.json")
"""What `analyze_fleet` writes for its readers into the folder."""
_INDICATORS, _LIST, _TASK, _FORMAT = "indicators.parquet", "records.json", "task.json", "hums-results/4"


def _check_task(path: Path, task: dict[str, str]) -> None:
    """Write gearbox, settings and version into the folder; raise FleetError if it holds different ones."""
    there = own_json(path)
    if differing := [name for name in task if there and there.get(name) != task[name]]:
        raise FleetError(
            f"{path.parent} holds records analysed with another {' and another '.join(differing)}; mixing is refused. "
            "Name another folder."
        )
    write_text(path, json.dumps(task, indent=1))


# ---- the records -------------------------------------------------------------------------------------------


def _sources(given: Sequence[str | Path], *, written: Sequence[Path]) -> list[_Source]:
    found: dict[tuple[Path, int | None], _Source] = {}
    for path in map(Path, given):
        if not path.exists():
            raise FleetError(f"{path}: there is no such file or folder; check the path.")
        for source in _sources_in_folder(path, written) if path.is_dir() else [_of_file(path)]:
            found[source.path, source.number] = source
    if not found:
        raise FleetError("no records were named; name files, or folders that hold some.")
    return list(found.values())


def _sources_in_folder(folder: Path, written: Sequence[Path]) -> list[_Source]:
    whole = Path(os.path.realpath(folder))
    if is_begun(folder):
        files, labels = dataset_files(folder), open_dataset(folder)
        classes = labels["class"].to_numpy() if "class" in labels else [""] * len(files)
        return [
            _Source(name=f"{folder}/{n}", path=whole, file=file, number=n, label=str(label))
            for n, (file, label) in enumerate(zip(files, classes, strict=True))
        ]
    there = [_of_file(path) for path in sorted(folder.rglob("*.h5")) if Path(os.path.realpath(path)) not in written]
    if not there:
        raise FleetError(f"{folder} holds no record, no file that ends in .h5; make records with hums convert.")
    return there


def _of_file(path: Path) -> _Source:
    real = Path(os.path.realpath(path))
    return _Source(name=str(path), path=real, file=real)


def _result_name(source: _Source) -> str:
    """Return the name of a record's result file: a hash of its path, and of its file's size and modification time."""
    key: list[Any] = [str(source.path), source.number]
    if source.file.exists():
        stat = source.file.stat()
        key += [stat.st_size, stat.st_mtime_ns]
    return hashlib.sha256(json.dumps(key).encode()).hexdigest()[:24] + ".json.gz"


def _analyse_to_file(gearbox: Gearbox, settings: AnalysisSettings, source: _Source, path: Path) -> None:
    """Write facts and results of one record for the table, or the facts and the error if the analysis fails."""
    row: dict[str, Any] = {"record": source.name, "label": source.label, "machine": "", "recorded_at": ""}
    try:
        size = source.file.stat().st_size if source.file.exists() else 0
        with cpu_limit(_READING_S + _READING_S_PER_BYTE * size):
            opened = open_record if source.number is None else partial(dataset_record, number=source.number)
            record = opened(source.path).load()
        with record:
            row |= {name: str(record.attrs.get(name, "")) for name in ("machine", "recorded_at")}
            row |= results(analyze(record, gearbox, settings=settings))
    except Exception as error:  # noqa: BLE001 - whatever is wrong with one record, the others are to be analysed
        sentence = str(error) if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: {error}"
        row |= {"error": sentence or type(error).__name__, "unjudged": NOT_ANALYSED}
    write_row(row, path)


def _killed(name: str) -> StoredRecord:
    """Return a record without results, whose worker process died, in this run or in an earlier one.

    The process may have been killed from outside, or because another exhausted the memory: the next run retries it.
    """
    sentence = (
        f"{name}: the process that analysed it died twice. The file is damaged, or needs more memory than was "
        "available. Copy it again from its source, or run again."
    )
    return StoredRecord(machine="", record=name, error=sentence, unjudged=NOT_ANALYSED)
