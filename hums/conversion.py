"""Conversion of many files of other programs to records: one packed dataset, or a file each.

Files are converted in pieces of a few dozen, each by a reader process (`hums.readers.process`). A complete piece leaves
a note of the names, sizes and times of its files, so that an interrupted conversion resumes, and a piece whose files
changed is converted again. Files that cannot be read are listed in ``refused.csv``.
"""

import hashlib
import json
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import xarray as xr

from hums.jobs import Job, Serial, Workers, locked, run_jobs
from hums.readers import SUFFIXES
from hums.readers.columns import in_zone
from hums.readers.description import OF_MANY_FILES, ImportDescription, describe
from hums.readers.process import ReaderProcess
from hums.records.channels import layout_of, other_layout
from hums.records.dataset_store import INDEX, LABELS, SHARD, write_index
from hums.records.fields import RecordError, natural_key, plain_cell, utc_text
from hums.records.outputs import atomic_write, check_outputs, make_folder, own_json, remove_partial_files, write_text
from hums.records.snapshots import join_snapshots
from hums.records.store import write_record, write_shard

Form = Literal["packed", "files"]
_MARKS: Mapping[Form, str] = {"packed": "conversion.json", "files": "conversion-files.json"}
_PIECES, _REFUSED = "pieces", "refused.csv"


@dataclass(frozen=True, kw_only=True)
class SourceFile:
    """A file to convert, and its recording time from its name, ISO 8601 in UTC; empty if the name states none."""

    path: Path
    recorded_at: str = ""


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """Result of a conversion.

    Attributes
    ----------
    folder : Path
        Folder of the records.
    records : int
        Number of records in the folder.
    done, kept : int
        Number of files read in this run, and in earlier ones.
    refused : mapping of str to str
        By file, why it could not be converted.
    """

    folder: Path
    records: int
    done: int
    kept: int
    refused: Mapping[str, str]


# ---- names -----------------------------------------------------------------------------------------------------------


def find_sources(
    given: Sequence[str | Path],
    description: ImportDescription | Mapping[str, Any] | str | PathLike[str] | None = None,
    **declared: Any,  # noqa: ANN401 - the keys of an ImportDescription, each with its type
) -> list[SourceFile]:
    """Return the files given by names, folders and patterns, in the order of their times or numbers.

    Parameters
    ----------
    given : sequence of path
        Files; folders, for all their files with a supported suffix; and patterns with ``*`` and ``?``.
    description : ImportDescription, mapping or path, optional
        Only ``time_in_names`` is used, with ``time_zone`` unless the pattern states it by ``%z`` or by ``Z`` after a
        directive; and ``every_s`` with ``recorded_at``.
    **declared
        Keys that override those of `description`.

    Returns
    -------
    list of SourceFile
        Each file once: by time if all names state one, else by name with numbers compared as numbers.

    Raises
    ------
    RecordError
        If nothing is found, a name does not match the pattern, or a UTC offset is missing.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from hums.conversion import find_sources
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("data-20130326T014150Z.mat", "data-20130311T030024Z.mat"):
    ...         _ = pathlib.Path(folder, name).write_bytes(b"...")
    ...     [file.recorded_at for file in find_sources([folder], time_in_names="data-%Y%m%dT%H%M%SZ")]
    ['2013-03-11T03:00:24Z', '2013-03-26T01:41:50Z']
    """
    spec, found = describe(description, **declared), dict[Path, SourceFile]()
    for path in (path for name in given for path in _matching(Path(name))):
        when = _time_of(path.name, spec.time_in_names, spec.time_zone) if spec.time_in_names else ""
        found.setdefault(path.resolve(), SourceFile(path=path, recorded_at=when))
    if not found:
        raise RecordError("no file was given; name files, folders or patterns.")
    files = sorted(found.values(), key=lambda file: natural_key(str(file.path)))
    if spec.every_s is not None and spec.moment is not None:
        return _numbered(files, spec.every_s, spec.moment)
    if all(file.recorded_at for file in files):
        files.sort(key=lambda file: datetime.fromisoformat(file.recorded_at))
    return files


def _matching(given: Path) -> list[Path]:
    """Return the files given by a name, folder or pattern."""
    if given.is_file():
        return [given]
    if given.is_dir():
        there = [path for path in given.iterdir() if path.is_file() and path.suffix.lower() in SUFFIXES]
        if not there:
            raise RecordError(f"{given} holds no file that ends in {', '.join(SUFFIXES)}; name the files.")
        return there
    if not re.search(r"[*?\[]", given.name):
        raise RecordError(f"{given}: there is no such file or folder; check the path.")
    there = [path for path in given.parent.glob(given.name) if path.is_file()]
    if not there:
        raise RecordError(f"{given}: no file matches. Check the pattern, and quote it in a shell.")
    return there


def _parsed(name: str, pattern: str) -> datetime | None:
    try:
        return datetime.strptime(name, pattern)  # noqa: DTZ007 - the offset follows
    except (ValueError, re.error):
        return None


def _time_of(name: str, pattern: str, time_zone: str | None) -> str:
    """Return the time stated by a file name, ISO 8601 in UTC."""
    moment = _parsed(name, pattern) or _parsed(Path(name).stem, pattern)
    if moment is None:
        raise RecordError(
            f'{name} does not match time_in_names = "{pattern}"; write it as in "data-%Y%m%dT%H%M%SZ", with the '
            "directives of strptime."
        )
    moment = in_zone(moment, "UTC" if re.search(r"%[A-Za-z]Z", pattern) else time_zone)
    if moment.tzinfo is None:
        raise RecordError(
            f'"{pattern}" does not state the UTC offset of {moment.isoformat()}: state time_zone, "Europe/Berlin", '
            '"+01:00" or "UTC", in an import description (-d); or write %z in the pattern, or Z for UTC.'
        )
    return utc_text(moment)


def _numbered(files: Sequence[SourceFile], every_s: float, began: datetime) -> list[SourceFile]:
    """Return files with times from the last numbers in their names."""
    numbers = [re.findall(r"\d+", file.path.stem) for file in files]
    if bare := [file.path.name for file, number in zip(files, numbers, strict=True) if not number]:
        raise RecordError(f"every_s={every_s:g}: {bare[0]} has no number in its name; leave the file out.")
    each = [int(number[-1]) for number in numbers]
    moments = [began + timedelta(seconds=every_s * (number - min(each))) for number in each]
    timed = [
        SourceFile(path=file.path, recorded_at=utc_text(moment)) for file, moment in zip(files, moments, strict=True)
    ]
    return sorted(timed, key=lambda file: datetime.fromisoformat(file.recorded_at))


# ---- the run ---------------------------------------------------------------------------------------------------------


def convert_files(
    sources: Sequence[SourceFile],
    folder: str | Path,
    *,
    description: ImportDescription | Mapping[str, Any] | str | PathLike[str] | None = None,
    form: Form = "packed",
    workers: Workers | None = None,
    progress: bool = False,
    force: bool = False,
    **declared: Any,  # noqa: ANN401 - the keys of an ImportDescription, each with its type
) -> Conversion:
    """Convert many files to records in a folder, or resume an interrupted conversion.

    Parameters
    ----------
    sources : sequence of SourceFile
        From `find_sources`, in their order.
    folder : str or Path
        New, empty, or begun with the same declarations.
    description : ImportDescription, mapping or path, optional
        What the files hold and do not state, as in `hums.convert`, and how many successive ones are joined into a
        record of snapshots.
    form : {"packed", "files"}
        One dataset, which `hums.open_dataset` reads, with records of one layout and samples of 32 bits; or one record
        per file, with its name.
    workers : Serial, Processes or Cluster of `hums.jobs`, optional
        Where the files are read. Default: in one process.
    progress : bool
        Whether to show a progress bar on standard error.
    force : bool
        Whether to use a folder that holds other files, and to overwrite files of other programs in it.
    **declared
        Keys that override those of `description`.

    Returns
    -------
    Conversion

    Raises
    ------
    RecordError
        If the folder was begun with other declarations or holds other files, two files would have the same name, or no
        file can be read.
    JobError
        See `hums.jobs.run_jobs`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import hums
    >>> from hums.conversion import convert_files, find_sources
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for number in (2, 10, 1):
    ...         np.savetxt(f"{folder}/acc_{number}.csv", np.full(1000, number), header="vib", comments="")
    ...     _ = pathlib.Path(folder, "acc_3.csv").write_text("")
    ...     made = convert_files(find_sources([f"{folder}/acc_*.csv"]), f"{folder}/out", channels=["vib"], units="g",
    ...                          rate_hz=1000, no_tachometer=True)
    ...     print(made.records, made.done, len(made.refused), hums.open_dataset(made.folder).vib[:, 0].values.tolist())
    3 4 1 [1.0, 2.0, 10.0]
    """
    folder = Path(folder).absolute()
    spec = describe(description, **declared)
    names = Counter(file.path.stem for file in sources[:: spec.snapshots])
    if form == "files" and (twice := [name for name, count in names.items() if count > 1]):
        raise RecordError(f'two files are named "{twice[0]}"; convert each folder separately, or into one dataset.')
    task = spec.keys()
    written = (_MARKS[form], _REFUSED, *((INDEX, LABELS) if form == "packed" else ()))
    inputs = [file.path for file in sources]
    check_outputs((folder / name for name in written), inputs=inputs, folder=folder, force=force)
    make_folder(folder)
    with locked(folder):  # from reading the notes to writing the index
        _begin(folder, form, task, force=force)
        readable = (
            record for file in sources for _, record in _converted([[str(file.path), file.recorded_at]], task, [])
        )
        layout = next(map(layout_of, readable), None) if form == "packed" else None
        jobs = [
            _job(files, number, form, task, layout, force=force)
            for number, files in enumerate(_pieces(sources, spec.snapshots))
        ]
        notes = folder / _PIECES
        if _drop_stale(folder, jobs, force=force):
            (folder / INDEX).unlink(missing_ok=True)
        remove_partial_files(folder)
        kept = sum(job.size for job in jobs if (notes / job.name).is_file())
        tally = run_jobs(
            _write_piece, jobs, folder=notes, workers=workers or Serial(), title="files" if progress else None
        )
        _reader().close()
        done = [json.loads((notes / job.name).read_text(encoding="utf-8")) for job in jobs]
        refused = {file: reason for note in done for file, reason in note["refused"]}
        _write_refused(folder, refused)
        shards = [
            folder / SHARD.format(number) for number, note in enumerate(done) if form == "packed" and note["records"]
        ]
        if not any(note["records"] for note in done):
            reason = next(iter(refused.values()))
            raise RecordError(f"none of {len(sources)} files could be converted; the first: {reason}")
        if form == "packed" and (tally.done or force or not (folder / INDEX).is_file()):
            write_index(folder, shards, plan=json.dumps(task))
    return Conversion(
        folder=folder,
        records=sum(note["records"] for note in done),
        done=len(sources) - kept,
        kept=kept,
        refused=refused,
    )


def _begin(folder: Path, form: Form, task: Mapping[str, Any], *, force: bool) -> None:
    """Write the declarations into a new folder; refuse one with other declarations or files."""
    mark = folder / _MARKS[form]
    if there := own_json(mark):
        if different := sorted(name for name in there.keys() | task.keys() if there.get(name) != task.get(name)):
            name = different[0]
            raise RecordError(
                f"{folder} was begun with {name} = {there.get(name)!r}, and not {task.get(name)!r}; name another "
                "folder, or continue with the same description."
            )
    elif not force and any(not path.name.startswith(".hums-") for path in folder.iterdir()):
        raise RecordError(
            f"{folder} holds files that are not from such a conversion; name a new or empty folder, or use --force "
            "(force=True)."
        )
    write_text(mark, json.dumps(task, indent=1))  # first, as a folder without it belongs to others
    for place in (folder / _PIECES, folder / Path(SHARD).parent if form == "packed" else folder):
        place.mkdir(parents=True, exist_ok=True)


def _pieces(sources: Sequence[SourceFile], snapshots: int) -> list[Sequence[SourceFile]]:
    # 32 files in a piece, which is lost when a run is stopped, and converted again when one of its files changes
    size = snapshots * max(1, 32 // snapshots)
    return [sources[first : first + size] for first in range(0, len(sources), size)]


def _job(
    files: Sequence[SourceFile],
    number: int,
    form: Form,
    task: Mapping[str, Any],
    layout: Any,  # noqa: ANN401
    *,
    force: bool,
) -> Job[dict[str, Any]]:
    stats = [file.path.stat() for file in files]
    item: dict[str, Any] = {
        "files": [
            [str(file.path.resolve()), file.recorded_at, stat.st_size, stat.st_mtime_ns]
            for file, stat in zip(files, stats, strict=True)
        ],
        "number": number,
        "form": form,
        "task": dict(task),
        "layout": layout,
    }
    item["key"] = hashlib.sha256(json.dumps(item).encode()).hexdigest()
    return Job(name=f"{number:06d}.json", item=item | {"force": force}, size=len(files))


def _drop_stale(folder: Path, jobs: Sequence[Job[dict[str, Any]]], *, force: bool) -> bool:
    """Remove the notes of pieces that changed or no longer exist, and return whether any went."""
    names = {job.name: job for job in jobs}
    given = {file[0] for job in jobs for file in job.item["files"]}
    notes = {note: own_json(note) for note in (folder / _PIECES).glob("*.json")}
    others = [file for there in notes.values() for file in there.get("files", []) if file not in given]
    if left := [file for file in others if Path(file).is_file()]:
        raise RecordError(
            f"{folder} holds records of {len(left)} files that are not among the sources, such as {left[0]}; add them "
            "to the sources, or name another folder."
        )
    gone = False
    for note, there in notes.items():
        job = names.get(note.name)
        outputs = [folder / name for name in there.get("outputs", [])]
        if job is not None and there.get("key") == job.item["key"] and all(path.is_file() for path in outputs):
            continue
        gone = True
        check_outputs(outputs, force=force)
        note.unlink()
        for path in outputs:
            path.unlink(missing_ok=True)
    return gone


def _write_refused(folder: Path, refused: Mapping[str, str]) -> None:
    table = pd.DataFrame(refused.items(), columns=["file", "reason"], dtype=object).map(plain_cell)
    with atomic_write(folder / _REFUSED) as part:
        table.to_csv(part, index=False, errors="backslashreplace")


# ---- a piece ---------------------------------------------------------------------------------------------------------


@cache
def _reader() -> ReaderProcess:
    """Return the reader process, one for all pieces that this process converts."""
    return ReaderProcess()


def _write_piece(item: Mapping[str, Any], note: Path) -> None:
    """Convert the files of a piece; write its records, then its note."""
    folder, declared = note.parent.parent, item["task"]
    refused: list[tuple[str, str]] = []
    made: list[tuple[list[str], xr.Dataset]] = []
    several = item["task"].get("snapshots", 1)
    for first in range(0, len(item["files"]), several):
        group = [
            (path, record)
            for path, record in _converted(item["files"][first : first + several], declared, refused)
            if _fits(record, item["layout"], path, refused)
        ]
        if not group:
            continue
        paths, records = [path for path, _ in group], [record for _, record in group]
        try:
            made.append((paths, join_snapshots(records) if several > 1 else records[0]))
        except RecordError as error:
            refused += [(path, str(error)) for path in paths]
    outputs = _write_records(folder, item, made)
    with atomic_write(note) as part:
        content = {
            "key": item["key"],
            "files": [path for path, *_ in item["files"]],
            "records": len(made),
            "refused": refused,
            "outputs": outputs,
        }
        part.write_text(json.dumps(content), encoding="utf-8")


def _converted(
    files: Sequence[Sequence[Any]], declared: Mapping[str, Any], refused: list[tuple[str, str]]
) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield each file that can be read with its record in memory; add the others to `refused`."""
    of_each = {name: value for name, value in declared.items() if name not in OF_MANY_FILES}
    for path, recorded_at, *_ in files:
        stated = {"recorded_at": recorded_at} if recorded_at else {}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of each of many files
                record = _reader().convert(path, **(of_each | stated))
                loaded = record.load()
                record.close()
        except (ValueError, OSError) as error:
            refused.append((path, str(error)))
        else:
            yield path, loaded


def _fits(record: xr.Dataset, layout: Any, path: str, refused: list[tuple[str, str]]) -> bool:  # noqa: ANN401
    """Return whether a record has the layout of the dataset; add it to `refused` otherwise."""
    if layout is not None and (differs := other_layout(layout_of(record), layout)):
        refused.append((path, f"{differs} file; write a record per file (--files)."))
        return False
    return True


def _write_records(folder: Path, item: Mapping[str, Any], made: Sequence[tuple[list[str], xr.Dataset]]) -> list[str]:
    """Write the records of a piece, and return the names of their files."""
    if not made:
        return []
    packed = item["form"] == "packed"
    names = [SHARD.format(item["number"])] if packed else [f"{Path(paths[0]).stem}.h5" for paths, _ in made]
    check_outputs((folder / name for name in names), force=item["force"])
    if packed:
        labels = {
            "file": [Path(paths[0]).name for paths, _ in made],
            "recorded_at": [record.attrs["recorded_at"] for _, record in made],
        }
        # 24 significant bits, as many as converters have
        write_shard([record for _, record in made], folder / names[0], labels=labels, dtype="float32")
        return names
    for name, (_, record) in zip(names, made, strict=True):
        write_record(record, folder / name, tidy=False)
    return names
