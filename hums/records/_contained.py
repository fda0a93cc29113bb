"""HDF5 files that stand alone: nothing in them reaches into another file, and nothing was changed unseen."""

import hashlib
from collections.abc import Iterator
from os import PathLike
from typing import Any

import h5py
import numpy as np

from hums.records.fields import RecordError
from signals._validation import plain_text

_MOST_OBJECTS = 100_000  # a record has some dozens
_PLAUSIBLE = 100  # times the size of the file: more is possible only where values hardly vary
_ALWAYS_BYTES = 1 << 26  # read whatever the file's size is


def objects(file: h5py.File) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Yield the groups and datasets of a file, each once however many links lead to it; dangling links are left out.

    Raises
    ------
    RecordError
        Where a link leads into another file, or there are more objects than any record has.
    """
    seen, waiting = set(), [("", file["/"])]
    while waiting:
        where, group = waiting.pop()
        for name in group:
            path = f"{where}/{_utf8(name, file.filename)}"
            if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
                raise RecordError(
                    f'{file.filename}: "{_shown(path)}" is an external link, into another file, and is not followed; '
                    "copy what it points to into this file."
                )
            item = group.get(name)
            if item is None or isinstance(item, h5py.Datatype):
                continue
            address = h5py.h5o.get_info(item.id).addr
            if address in seen:
                continue
            seen.add(address)
            if len(seen) > _MOST_OBJECTS:
                raise RecordError(f"{file.filename} has over {_MOST_OBJECTS} objects; split it into smaller files.")
            yield path, item
            if isinstance(item, h5py.Group):
                waiting.append((path, item))


def is_own(path: str | PathLike[str]) -> bool:
    """Return whether a file states a schema of this toolkit, and names, shapes and attributes are as it wrote them."""
    try:
        with h5py.File(path) as contents:
            return str(contents.attrs.get("schema", "")).startswith("hums-") and bool(is_unchanged(contents))
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError):
        return False


def is_unchanged(file: h5py.File) -> bool | None:
    """Return whether names, shapes and attributes have the checksum that this toolkit wrote; None without one."""
    stated = file.attrs.get("_NCProperties", b"")
    text = stated.decode(errors="replace") if isinstance(stated, bytes) else str(stated)
    return text.endswith(f",hums={fingerprint(file)}") if ",hums=" in text else None


def _utf8(name: str | bytes, filename: str) -> str:
    """Return a name; refuse one that is not UTF-8, which h5py gives as bytes."""
    if isinstance(name, bytes):
        raise RecordError(
            f'{filename}: the name "{_shown(name.decode(errors="surrogateescape"))}" in it is not UTF-8 text; rename '
            "it in the program that wrote the file."
        )
    return name


def refuse_reaching_out(file: h5py.File) -> None:
    """Refuse a file of which a part lies in another one: external links and storage, virtual datasets."""
    for path, item in objects(file):
        if not isinstance(item, h5py.Dataset):
            continue
        created = item.id.get_create_plist()
        kind = (
            "has its values in another file (external storage)"
            if created.get_external_count()
            else "is a virtual dataset, of parts of other files"
            if created.get_layout() == h5py.h5d.VIRTUAL
            else ""
        )
        if kind:
            raise RecordError(
                f'{file.filename}: "{_shown(path)}" {kind}, which are not read; copy the values into this file.'
            )


def refuse_too_large(item: h5py.Dataset, *, most_bytes: int | None) -> None:
    """Refuse to read an array that declares far more than its file can hold, or than `most_bytes`."""
    refuse_size(
        item.size * item.dtype.itemsize,
        f'{item.file.filename}: "{_shown(item.name)}"',
        item.file.id.get_filesize(),
        most_bytes=most_bytes,
    )


def refuse_size(declared: int, what: str, file_bytes: int, *, most_bytes: int | None) -> None:
    """Refuse what declares more bytes than a file of its size plausibly holds, or than `most_bytes`."""
    most = max(_ALWAYS_BYTES, _PLAUSIBLE * file_bytes) if most_bytes is None else most_bytes
    if declared > most:
        raise RecordError(
            f"{what} declares {declared:.3g} bytes in a file of {file_bytes:.3g}; "
            f"at most {most:.3g} are read. If it is right, allow them, most_bytes=... in an import description (-d)."
        )


def fingerprint(file: h5py.File) -> str:
    """Return a checksum of names, shapes, types and attributes; the values of datasets have checksums of their own."""
    digest = hashlib.sha256()
    for path, item in sorted([("/", file["/"]), *objects(file)], key=lambda found: found[0]):
        layout = f"{item.shape} {item.dtype}" if isinstance(item, h5py.Dataset) else "group"
        digest.update(f"{path}\n{layout}\n".encode(errors="surrogateescape"))
        for name in sorted(item.attrs):
            if name not in {"_NCProperties", "REFERENCE_LIST", "DIMENSION_LIST"}:  # addresses are no contents
                digest.update(f"{name}={_text(item.attrs[name])}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _text(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, np.ndarray) and value.dtype.kind in "iufcb":
        return f"{value.dtype.str}{value.shape}{value.tobytes().hex()}"
    return repr(value.tolist() if isinstance(value, np.ndarray | np.generic) else value)


def _shown(path: str) -> str:
    return plain_text(path)[:200]
