"""What may be written: never what is read, no device or pipe, and no file that this toolkit did not write."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from hums.records._contained import schema_of
from hums.records.fields import RecordError

__all__ = ["MARK", "check_outputs"]

MARK = "hums-toolkit"  # near the beginning or end of files whose format has a place for it; HDF5 states a schema
_HEAD, _TAIL = 2048, 16384  # bytes: a PDF ends in its metadata and a table of its objects
_TABLES = {".csv", ".json", ".parquet"}  # without such a place: the folder's own marked files speak for them


def check_outputs(
    outputs: Iterable[Path], *, inputs: Iterable[str | Path] = (), folder: Path | None = None, force: bool = False
) -> None:
    """Refuse to write what is read, what is no regular file, and what exists and was not written by this toolkit.

    Call it before the work begins.

    Parameters
    ----------
    outputs : iterable of Path
        Files that are to be written.
    inputs : iterable of str or Path
        Files that are read; names of the catalogue do no harm.
    folder : Path, optional
        Folder in which any file may be written, so that it holds no input.
    force : bool
        Whether files of other programs are replaced.

    Raises
    ------
    RecordError
        With the file and what to do.
    """
    read = {identity: path for path in inputs for identity in _identities(Path(path))}
    parents = {parent: path for path in inputs for parent in Path(os.path.realpath(path)).parents}
    for output, known in [*((output, read) for output in outputs), *([(folder, read | parents)] if folder else [])]:
        for identity in _identities(output):
            if identity in known:
                raise RecordError(
                    f"{output} would be overwritten: {known[identity]} is read here, and what is read is never "
                    "written; name another output."
                )
        if not output.exists() or (output == folder and output.is_dir()):
            continue
        if output == folder:
            raise RecordError(f"{output} is a file; name a folder.")
        if not output.is_file():
            kind = "a directory" if output.is_dir() else "a device or pipe"
            raise RecordError(f"{output} is {kind}, where a file is written; name another output.")
        if not (force or _is_own(output)):
            raise RecordError(
                f"{output} exists and was not written by hums, so it is not replaced; name another output, move that "
                "file away, or replace it with --force (force=True)."
            )


def _identities(path: Path) -> Iterator[object]:
    """Yield the resolved path and, of a file that exists, its device and inode, which its other names share."""
    yield Path(os.path.realpath(path))
    if path.exists():
        stat = path.stat()
        yield stat.st_dev, stat.st_ino


def _is_own(path: Path) -> bool:
    if path.stat().st_size == 0:
        return True  # reserved by whoever named it: there is nothing to lose
    marks = ("analysis.h5", "task.json") if path.suffix in _TABLES else ()  # written before any table
    if any(mark != path.name and path.with_name(mark).is_file() and _is_own(path.with_name(mark)) for mark in marks):
        return True
    if schema_of(path).startswith("hums-"):
        return True
    with path.open("rb") as file:
        head = file.read(_HEAD)
        file.seek(max(0, path.stat().st_size - _TAIL))
        return MARK.encode() in head + b"\n" + file.read(_TAIL)
