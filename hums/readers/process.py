"""Reading of foreign files in a separate process.

The libraries that parse HDF5 and MATLAB files may crash or hang on a few damaged bytes. A separate process contains
that: it serves many files and is restarted if it dies. Descriptions return as JSON and the requested parts of arrays as
bytes, through a pipe; nothing is unpickled, and no temporary file is written.
"""

from __future__ import annotations

import faulthandler
import json
import logging
import math
import multiprocessing
import os
import signal
import sys
import warnings
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

from hums.readers import convert, read_file
from hums.readers.draft import draft
from hums.records.channels import attach_time, detach_time
from hums.records.fields import RecordError, RecordWarning
from hums.records.store import open_record, open_tree

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess
    from os import PathLike

_CPU_S = 10.0  # for a request at least; and 10 MB/s, a tenth of the rate of the slowest reader, of text
_PATIENCE = 6  # waiting time over processor time: network storage may be slow
_FORKS = sys.platform == "linux"  # elsewhere a fork is unsafe, and a new interpreter takes about a second


class ReaderProcess(AbstractContextManager["ReaderProcess"]):
    """A process that reads files, alive within a ``with`` block.

    On Linux it is forked when the first file is read, elsewhere spawned; it is restarted after a file that kills it.
    Create it before any threads. A record that it opened can be read until the next `close`, by one thread.

    Parameters
    ----------
    cpu_s : float
        Maximum processor time of a request in s, plus 0.1 s per MB of the file; the maximum waiting time is six times
        as long.
    memory_bytes : int, optional
        Maximum memory of the process. Default: half of the machine's. Enforced only if the system supports such limits.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from hums.readers.process import ReaderProcess
    >>> with tempfile.TemporaryDirectory() as folder, ReaderProcess() as reader:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     np.savetxt(path, np.ones(1000), header="vib", comments="")
    ...     record = reader.convert(path, channels=["vib"], units="g", rate_hz=1000, no_tachometer=True)
    ...     print(float(record.vib[0]))
    1.0
    """

    def __init__(self, *, cpu_s: float = _CPU_S, memory_bytes: int | None = None) -> None:
        self._cpu_s = cpu_s
        self._memory_bytes = memory_bytes if memory_bytes is not None else _share_of_memory()
        self._running: tuple[BaseProcess, Connection] | None = None
        self._generation = 0

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    def open_record(self, path: str | PathLike[str]) -> xr.Dataset:
        """Open a record as `hums.open_record` does; samples are read on access, in the process.

        Raises
        ------
        RecordError
            If the file is missing, damaged or not a record, or kills the process.
        """
        return self._record("open", path, {})

    def convert(self, source: str | PathLike[str], **declared: Any) -> xr.Dataset:  # noqa: ANN401 - those of `convert`
        """Convert another program's file to a record, as `hums.convert` does.

        Raises
        ------
        RecordError
            If the file cannot be read or kills the process, or the declarations are incomplete or contradictory.
        """
        return self._record("convert", source, declared)

    def draft(self, path: str | PathLike[str]) -> str:
        """Return the draft of an import description of another program's file.

        Raises
        ------
        RecordError
            If the file cannot be read, or kills the process.
        """
        return str(self._ask({"do": "draft"}, os.fspath(path))["text"])

    def open_tree(self, path: str | PathLike[str]) -> xr.DataTree:
        """Open a tree of datasets that `hums.save_analysis` wrote; values are read on access, in the process.

        Raises
        ------
        RecordError
            If the file is missing or damaged, or kills the process.
        """
        file = os.fspath(path)
        found = self._ask({"do": "tree", "path": file, "declared": {}}, file)
        handle = (self._generation, found["number"])
        tree = xr.DataTree.from_dict(
            {where: self._dataset(handle, where, group, file) for where, group in found["groups"].items()}
        )
        tree.set_close(lambda: self._close_record(handle, file))
        return tree

    def close(self) -> None:
        """End the process; records that it opened can no longer be read."""
        if self._running is not None:
            process, pipe = self._running
            pipe.close()
            process.kill()
            process.join()
            process.close()
        self._running = None
        self._generation += 1

    def _record(self, what: str, path: str | PathLike[str], declared: Mapping[str, Any]) -> xr.Dataset:
        file = os.fspath(path)
        found = self._ask({"do": what, "path": file, "declared": dict(declared)}, file)
        for text in found["warnings"]:
            warnings.warn(text, RecordWarning, stacklevel=3)
        handle = (self._generation, found["number"])
        record = attach_time(self._dataset(handle, "/", found["groups"]["/"], file))
        if found["source"] is not None:
            record.encoding["source"] = found["source"]
        record.set_close(lambda: self._close_record(handle, file))
        return record

    def _dataset(self, handle: tuple[int, int], where: str, group: Mapping[str, Any], file: str) -> xr.Dataset:
        entries = group["coords"] | group["data_vars"]
        variables = {
            name: xr.Variable(entry["dims"], self._values(handle, (where, name), entry, file), entry["attrs"])
            for name, entry in entries.items()
        }
        return xr.Dataset(variables, attrs=group["attrs"]).set_coords(group["coords"])

    def _values(self, handle: tuple[int, int], name: tuple[str, str], entry: Mapping[str, Any], file: str) -> Any:  # noqa: ANN401
        if "text" in entry:
            return np.array(entry["text"], dtype=object).reshape(entry["shape"])
        array = _ArrayThere(self, handle, name, tuple(entry["shape"]), np.dtype(entry["dtype"]), file)
        return LazilyIndexedArray(array)

    def _close_record(self, handle: tuple[int, int], file: str) -> None:
        if handle[0] == self._generation and self._running is not None:
            with suppress(RecordError):
                self._ask({"do": "close", "number": handle[1]}, file)

    def read(self, array: _ArrayThere, key: tuple[Any, ...]) -> np.ndarray[Any, Any]:
        """Return a part of an array that the process holds, by integer indices and slices."""
        if array.handle[0] != self._generation:
            raise RecordError(f"{array.file} is no longer open: its reader was closed. Open it again.")
        indices = [[one.start, one.stop, one.step] if isinstance(one, slice) else int(one) for one in key]
        request = {"do": "read", "number": array.handle[1], "name": array.name, "key": indices}
        shape = tuple(self._ask(request, array.file)["shape"])
        values = np.empty(shape, array.dtype)
        rest = _bytes_of(values)
        while len(rest):
            piece = self._received(array.file)
            rest[: len(piece)] = piece
            rest = rest[len(piece) :]
        return values

    def _start(self) -> tuple[BaseProcess, Connection]:
        context: Any = multiprocessing.get_context("fork" if _FORKS else "spawn")
        xr.Variable("sample", np.empty(1))  # makes xarray load what it needs for arrays before the fork
        here, there = context.Pipe()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of forks with threads, see the class
            process = context.Process(
                target=_serve, args=(there, here if _FORKS else None, self._memory_bytes), daemon=True
            )
            process.start()
        there.close()
        return process, here

    def _ask(self, request: Mapping[str, Any], file: str) -> dict[str, Any]:
        self._running = self._running or self._start()
        try:
            size = os.path.getsize(file)  # noqa: PTH202 - the path is as the user gave it
        except (OSError, ValueError):
            size = 0
        limits = {"cpu_s": self._cpu_s + size * 1e-7}
        self._wait_s = _PATIENCE * limits["cpu_s"]
        try:
            text = json.dumps({"path": file, **request, **limits}, default=str)
        except (TypeError, ValueError) as error:
            raise RecordError(f"{file}: {error}; declare words, numbers and lists of words.") from None
        with suppress(OSError):  # a dead process, which the answer reveals
            self._running[1].send_bytes(text.encode())
        answer: dict[str, Any] = json.loads(self._received(file))
        if "error" in answer:
            raise RecordError(answer["error"])
        return answer

    def _received(self, file: str) -> bytes:
        why = "ended"
        if self._running is not None:
            process, pipe = self._running
            try:
                if pipe.poll(self._wait_s):
                    return pipe.recv_bytes()
                why = f"did not answer within {self._wait_s:.3g} s"
            except (EOFError, OSError):
                why = self._death(process)
        self.close()
        raise RecordError(
            f"{file}: the process that reads it {why}; the file is damaged, or larger than this machine can read. "
            "Copy it again from its source."
        )

    def _death(self, process: BaseProcess) -> str:
        process.join(_CPU_S)
        code = process.exitcode
        if code is not None and code < 0 and signal.Signals(-code).name == "SIGXCPU":
            return f"took more than {self._wait_s / _PATIENCE:.3g} s of processor time"
        return f"crashed ({signal.Signals(-code).name})" if code is not None and code < 0 else "ended"


@dataclass(eq=False)
class _ArrayThere(BackendArray):
    """An array that the process holds, of which parts are fetched by indexing."""

    reader: ReaderProcess
    handle: tuple[int, int]
    name: tuple[str, str]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    file: str

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401 - an indexer of xarray
        """Return a part of the array."""
        return explicit_indexing_adapter(
            key, self.shape, IndexingSupport.BASIC, lambda indices: self.reader.read(self, indices)
        )


def _share_of_memory() -> int | None:
    try:
        # half of this machine's memory: the other half is for the samples received
        return int(0.5 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return None


# ---- in the process --------------------------------------------------------------------------------------------------


def _serve(pipe: Connection, other_end: Connection | None, memory_bytes: int | None) -> None:
    """Answer requests until the pipe closes, which it also does if the other process dies."""
    if other_end is not None:
        other_end.close()  # inherited by the fork, it would keep the pipe open
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other process handles interrupts
    logging.disable()  # of the libraries, which also print
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
    sys.unraisablehook = lambda _: None  # exceptions of their destructors after damaged bytes
    faulthandler.disable()  # the caller reports a crash in a sentence
    _limit("RLIMIT_CORE", 0)
    if memory_bytes is not None:
        _limit("RLIMIT_AS", _used_bytes() + memory_bytes)
    opened: dict[int, tuple[xr.Dataset | xr.DataTree, dict[str, xr.Dataset]]] = {}
    piece_bytes = 1 << 24  # sent at a time, so that the copy stays small
    while True:
        try:
            request = json.loads(pipe.recv_bytes())
        except (EOFError, OSError):
            return
        _limit("RLIMIT_CPU", math.ceil(sum(os.times()[:2]) + request["cpu_s"]))
        try:
            answer, values = _answer(request, opened)
        except MemoryError:
            too_large = "needs more memory than a reader may use; split it, or read it on a larger machine."
            answer, values = {"error": f"{request.get('path', 'the file')} {too_large}"}, None
        except Exception as error:  # noqa: BLE001 - the libraries raise anything on damaged bytes
            ours = isinstance(error, ValueError | OSError) and request["do"] != "read"
            why = f"cannot be read ({type(error).__name__}: {error})"
            named = f"{request.get('path', 'the file')} {why}. Copy it again from its source."
            answer, values = {"error": str(error) if ours else named}, None
        pipe.send_bytes(json.dumps(answer).encode())
        if values is not None:
            whole = _bytes_of(np.ascontiguousarray(values))
            for start in range(0, len(whole), piece_bytes):
                pipe.send_bytes(whole[start : start + piece_bytes])


def _answer(
    request: Mapping[str, Any], opened: dict[int, tuple[xr.Dataset | xr.DataTree, dict[str, xr.Dataset]]]
) -> tuple[dict[str, Any], np.ndarray[Any, Any] | None]:
    match request["do"]:
        case "draft":
            return {"text": draft(read_file(request["path"]))}, None
        case "close":
            if request["number"] in opened:
                opened.pop(request["number"])[0].close()
            return {}, None
        case "read":
            key = tuple(slice(*one) if isinstance(one, list) else one for one in request["key"])
            where, name = request["name"]
            values = np.asarray(opened[request["number"]][1][where].variables[name][key].to_numpy())
            return {"shape": values.shape}, values
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RecordWarning)
        opens: Mapping[str, Callable[..., Any]] = {"tree": open_tree, "open": open_record, "convert": convert}
        thing = opens[request["do"]](request["path"], **request["declared"])
        nodes = thing.subtree if isinstance(thing, xr.DataTree) else ()
        groups = {node.path: node.to_dataset(inherit=False) for node in nodes} or {"/": detach_time(thing)}
    number = max(opened, default=0) + 1
    opened[number] = thing, groups
    return {
        "number": number,
        "groups": {where: _described(group) for where, group in groups.items()},
        "source": thing.encoding.get("source"),
        "warnings": [str(one.message) for one in caught if issubclass(one.category, RecordWarning)],
    }, None


def _described(dataset: xr.Dataset) -> dict[str, Any]:
    """Return names, dimensions, types and attributes of variables as JSON types, and the values of text."""
    found = dataset.to_dict(data=False)
    for name, entry in (found["coords"] | found["data_vars"]).items():
        if np.dtype(entry["dtype"]).kind in "OUS":
            entry["text"] = [str(one) for one in dataset.variables[name].to_numpy().ravel()]
    return found


def _bytes_of(values: np.ndarray[Any, Any]) -> memoryview:
    """Return the memory of a contiguous array."""
    flat: Any = values.reshape(-1).view(np.uint8) if values.size else b""
    return memoryview(flat)


def _limit(what: str, amount: int) -> None:
    """Set a resource limit of this process, if the system supports it."""
    try:
        import resource  # noqa: PLC0415 - exists on POSIX only
    except ImportError:
        return
    kind = getattr(resource, what, None)
    if kind is not None:
        _, most = resource.getrlimit(kind)
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (amount if most == resource.RLIM_INFINITY else min(amount, most), most))


def _used_bytes() -> int:
    try:
        with open("/proc/self/statm", encoding="ascii") as stream:  # noqa: PTH123
            return int(stream.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
