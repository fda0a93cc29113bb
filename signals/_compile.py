"""Compilation of kernels with numba, cached on disk; no other module imports numba."""

import hashlib
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import event

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` to machine code at its first call and keep the result on disk.

    Kernels take contiguous arrays and plain numbers, do not raise, and release the interpreter lock. A product and a
    sum may be fused into one instruction, rounded once.
    """
    return _compile(kernel, {"contract"})


def compiled_sums(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, with sums in any order, so that they use vector registers."""
    return _compile(kernel, {"contract", "reassoc"})


def compiled_in_place(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile, as `compiled` does, a kernel that writes into the arrays that it is given and makes none.

    References to arrays are then not counted, which takes a fifth less to compile. Methods that make arrays inside, as
    ``x.max()`` does, are refused by numba.
    """
    return _compile(kernel, {"contract"}, counted=False)


def compiled_sums_in_place(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled_in_place` does, with sums in any order."""
    return _compile(kernel, {"contract", "reassoc"}, counted=False)


def compiled_exactly(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, with every operation rounded as IEEE 754 says, in the order of the source.

    Results then depend neither on how a loop was vectorised nor on where arrays lie in memory, which records that are
    to be the same bytes on every run need.
    """
    return _compile(kernel, set())


def compiled_inline(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` into each kernel that calls it, rounded as `compiled_exactly` does. It allocates no array.

    LLVM inlines what numba analysed once; inlining the source instead would take twice as long to compile. Without the
    allocator (``_nrt``) references to its arrays are not counted: an atomic increment for each array of a tuple at each
    call was 40 % of an integration's time.
    """
    return _compile(kernel, set(), counted=False, inline=True)


def _compile(
    kernel: Callable[P, R], freedoms: set[str], *, counted: bool = True, inline: bool = False
) -> Callable[P, R]:
    settings = {
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,  # a further entry, for C, which none needs and which takes time to compile
        "fastmath": freedoms or False,
        "forceinline": inline,
        "_nrt": counted,
    }
    name = kernel.__qualname__
    kernel.__qualname__ += f"-{_sources()}"  # a part of the name of the file on disk
    try:
        return cast("Callable[P, R]", cast("Any", numba.njit)(cache=True, **settings)(kernel))
    except RuntimeError:  # neither the package's folder nor the user's cache can be written: compiled in each process
        return cast("Callable[P, R]", cast("Any", numba.njit)(**settings)(kernel))
    finally:
        kernel.__qualname__ = name


@cache
def _sources() -> str:
    """Return a digest of all kernels: they call one another across modules, where numba sees no change on disk."""
    root = Path(__file__).resolve().parents[1]
    files = sorted(file for package in ("signals", "data_synth") for file in (root / package).rglob("_*kernels.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]


class _Announcer(event.Listener):
    """Logs that a kernel is compiled, which takes seconds once and is then read from disk."""

    def on_start(self, _event: event.Event) -> None:
        logging.getLogger("hums").info("compiling, first run only")

    def on_end(self, _event: event.Event) -> None:
        pass


cast("Any", event).register("numba:compile", _Announcer())
