"""What may be written: never what is read, and no file of another program."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from hums.records.fields import RecordError
from hums.records.store import schema_of

__all__ = ["check_outputs"]

_MARKED = (".h5", ".hdf5")  # formats in which every file of this toolkit states its schema


def check_outputs(outputs: Iterable[Path], *, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse to write a file that is read, or one that exists and was written by another program.

    Call it before the work begins. Of HDF5 files the schema says who wrote them; files of other formats carry no mark,
    and are refused only where they are read.

    Parameters
    ----------
    outputs : iterable of Path
        Files that are to be written, and folders of which every file may be.
    inputs : iterable of str or Path
        Files that are read; names of the catalogue do no harm.

    Raises
    ------
    RecordError
        With the file and what to do.
    """
    read = {identity: path for path in inputs for identity in _identities(Path(path))}
    read |= {folder: path for path in inputs for folder in Path(path).resolve().parents}
    for output in outputs:
        for identity in _identities(output):
            if identity in read:
                raise RecordError(
                    f"{output} would be overwritten: {read[identity]} is read here, and what is read is never written; "
                    "name another output."
                )
        if output.suffix.lower() in _MARKED and output.is_file() and not _is_own(output):
            raise RecordError(
                f"{output} exists and was not written by hums, so it is not replaced; name another output, or move "
                "that file away."
            )


def _identities(path: Path) -> Iterator[object]:
    """Yield the resolved path and, of a file that exists, its device and inode, which its other names share."""
    yield path.resolve()
    if path.exists():
        stat = path.stat()
        yield stat.st_dev, stat.st_ino


def _is_own(path: Path) -> bool:
    if path.stat().st_size == 0:
        return True  # reserved by whoever named it: there is nothing to lose
    return schema_of(path).startswith("hums-")
