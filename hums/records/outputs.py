"""Safe output: no overwriting of inputs, devices, pipes, or files that this toolkit did not write.

Each file is sealed by the SHA-256 of its bytes: in a comment at its end if its format has comments, else in a line of a
hidden list in its folder. An edited file no longer counts as written here. HDF5 files state a schema and a checksum.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from socket import gethostname
from tempfile import NamedTemporaryFile
from typing import Any
from uuid import uuid4

from hums.records._netcdf import is_own
from hums.records.fields import RecordError, is_utf8

SEALS = ".hums-written"  # the list, in the form of sha256sum; it only grows, so that writers need no lock
_LISTED = {".csv", ".json", ".parquet", ".sha256"}
_MARKUP = "<!-- {} hums-toolkit -->\n"
_COMMENTS = {  # PNG: after its last chunk, which readers ignore
    ".htm": _MARKUP, ".html": _MARKUP, ".md": _MARKUP, ".svg": _MARKUP, ".pdf": "% {} hums-toolkit\n",
    ".png": "{} hums-toolkit\n",
}  # fmt: skip


def check_outputs(
    outputs: Iterable[Path], *, inputs: Iterable[str | Path] = (), folder: Path | None = None, force: bool = False
) -> None:
    """Refuse outputs that are also inputs, are not regular files, or exist and were not written by this toolkit.

    Call it before the work begins.

    Parameters
    ----------
    outputs : iterable of Path
        Files to be written.
    inputs : iterable of str or Path
        Files that are read; catalogue names are ignored.
    folder : Path, optional
        Folder in which any file may be written, and which must therefore hold no input.
    force : bool
        Whether to overwrite files of other programs, except through symbolic links.

    Raises
    ------
    RecordError
        If an output is refused.
    """
    read = {identity: path for path in inputs for identity in _identities(Path(path))}
    parents = {parent: path for path in inputs for parent in Path(os.path.realpath(path)).parents}
    for output, known in [*((output, read) for output in outputs), *([(folder, read | parents)] if folder else [])]:
        for identity in _identities(output):
            if identity in known:
                raise RecordError(
                    f"{output} would be overwritten: {known[identity]} is an input of this command, and inputs are "
                    "never overwritten; name another output."
                )
        if output.suffix.lower() in _LISTED:
            _sealed(output.parent)  # refuses an invalid list before the work begins
        if output == folder or not output.exists():
            continue
        if not output.is_file():
            kind = "a directory" if output.is_dir() else "a device or pipe"
            raise RecordError(f"{output} is {kind}, not a file; name another output.")
        if not ((force and not output.is_symlink()) or _is_own(Path(os.path.realpath(output)))):
            raise RecordError(
                f"{output} exists and was not written by hums, or edited since, so it is not replaced; name another "
                "output, move that file away, or replace it with --force (force=True)."
            )


def make_folder(folder: Path) -> None:
    """Create a folder if necessary; refuse one that is a file or cannot be written, before a long run."""
    if folder.exists() and not folder.is_dir():
        raise RecordError(f"{folder} is a file; name a folder.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise RecordError(f"{folder} cannot be written ({error.strerror}); name a writable folder.") from None


def _identities(path: Path) -> Iterator[object]:
    """Yield the resolved path and, if the file exists, its device and inode, which hard links share."""
    yield Path(os.path.realpath(path))
    if path.exists():
        stat = path.stat()
        yield stat.st_dev, stat.st_ino


def seal(part: Path, target: Path) -> None:
    """Mark a complete file as written by this toolkit, before it is renamed."""
    if comment := _COMMENTS.get(target.suffix.lower()):
        with part.open("ab") as file:
            file.write(comment.format(_digest(part)).encode())
    elif target.suffix.lower() in _LISTED and (line := f"{_digest(part)}  {target.name}") not in _sealed(target.parent):
        with (target.parent / SEALS).open("a", encoding="utf-8") as file:
            file.write(f"{line}\n")
            file.flush()
            os.fsync(file.fileno())


def own_json(path: Path) -> dict[str, Any]:
    """Return the contents of a JSON file that this toolkit wrote; empty if there is none."""
    return dict(json.loads(path.read_bytes() or b"{}")) if path.is_file() and _is_own(path) else {}


def _is_own(path: Path) -> bool:
    if path.stat().st_size == 0:
        return True  # an empty file: there is nothing to lose
    if comment := _COMMENTS.get(path.suffix.lower()):
        whole = path.read_bytes()
        body = whole[: -len(comment.format("0" * 64))]
        return whole == body + comment.format(hashlib.sha256(body).hexdigest()).encode()
    if path.suffix.lower() in _LISTED:
        return f"{_digest(path)}  {path.name}" in _sealed(path.parent)
    return is_own(path)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sealed(folder: Path) -> list[str]:
    """Return the lines of the list of written files in a folder."""
    seals = folder / SEALS
    if seals.is_symlink() or (seals.exists() and not seals.is_file()):
        raise RecordError(f"{seals} must be a regular file, in which hums lists what it wrote here; remove it.")
    return seals.read_text(encoding="utf-8", errors="replace").splitlines() if seals.exists() else []


# ---- atomic writing ----------------------------------------------------------------------------------------------


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file by `atomic_write`, in UTF-8, with lone surrogates escaped."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8", errors="backslashreplace")


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, tidy: bool = True) -> Iterator[Path]:
    """Yield a temporary file to write, which replaces `path` on success and is removed on failure.

    The file is sealed as one of this toolkit. With `tidy`, temporary files of dead writers of `path` are removed, for
    which the folder is listed; writers of many files in one folder do so once before the first, and pass false.
    """
    target = Path(os.path.realpath(path))  # so that a symbolic link remains one
    if not is_utf8(target.name):
        raise RecordError(f"{path}: this name is not UTF-8 text, so the file could not be opened; choose another.")
    if target.exists() and not target.is_file():
        raise RecordError(f"{path} is {'a directory' if target.is_dir() else 'a device or pipe'}; name a file.")
    if not target.parent.is_dir():
        raise RecordError(f"{path}: there is no directory {target.parent}; create it first.")
    if tidy:
        remove_partial_files(target.parent, of=target.name)
    part = target.with_name(f".hums-{_short(target.name)}-{_writer(os.getpid())}-{uuid4().hex[:8]}.part")
    try:
        yield part
        seal(part, target)
        _sync(part)
        part.replace(target)
    except BaseException as error:
        with suppress(OSError):  # on a disk that is read-only
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno and error.filename in {None, str(part)}:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    if os.name == "posix":  # elsewhere a directory cannot be opened, and need not be
        _sync(target.parent)


def remove_partial_files(folder: Path, *, of: str | None = None) -> None:
    """Remove the temporary files of dead writers of one file, `of`, or of all files, from a folder.

    The name of a temporary file states its target, and the host, number and start of its writing process. Files of
    other hosts, whose processes cannot be checked, and of living processes stay.
    """
    for part in folder.glob(f".hums-{'*' if of is None else _short(of)}-*-*-*-*.part"):
        _, _, host, number, began, _ = part.name.split("-")  # .hums, target, host, process, its start, random
        if host == _short(gethostname()) and _writer(int(number)) != f"{host}-{number}-{began}":
            part.unlink(missing_ok=True)


def _short(text: str) -> str:
    """Return a hash of a text in eight characters for a file name."""
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()[:8]


def _writer(process: int) -> str:
    """Return host, number and start of a process, the last 0 if it has ended, x if starts are unknown."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        began = "0" if stat[0] == "Z" else stat[19]
    except OSError:
        began = "0" if Path("/proc/self").exists() else "x"  # without /proc every writer counts as alive
    return f"{_short(gethostname())}-{process}-{began}"


def _sync(path: Path) -> None:
    """Flush a file or directory to disk, so that after a power failure a new name never refers to old bytes."""
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
