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
    """Compile `kernel` to machine code at its first call and cache the result on disk.

    Kernels take contiguous arrays and plain numbers, do not raise, and release the global interpreter lock. Products
    and sums may be contracted into fused multiply-adds.
    """
    return _compile(kernel, {"contract"})


def compiled_sums(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, with sums reordered so that they can be vectorised."""
    return _compile(kernel, {"contract", "reassoc"})


def compiled_in_place(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile, as `compiled` does, a kernel that writes into its arguments and allocates no array.

    Array references are then not counted, which saves a fifth of the compilation time. Numba refuses methods that
    allocate internally, such as ``x.max()``.
    """
    return _compile(kernel, {"contract"}, counted=False)


def compiled_sums_in_place(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled_in_place` does, with sums reordered."""
    return _compile(kernel, {"contract", "reassoc"}, counted=False)


def compiled_exactly(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, with strict IEEE 754 arithmetic in the order of the source.

    Results then depend neither on vectorisation nor on memory alignment, as byte-for-byte reproducible records require.
    """
    return _compile(kernel, set())


def compiled_inline(kernel: Callable[P, R]) -> Callable[P, R]:
    """Inline `kernel` in each kernel that calls it, with the arithmetic of `compiled_exactly`. It allocates no array.

    LLVM inlines what numba has analysed once; inlining the source instead would double the compilation time. Without
    the allocator (``_nrt``) array references are not counted: an atomic increment per array of a tuple and call took
    40 % of the time of an integration.
    """
    return _compile(kernel, set(), counted=False, inline=True)


def _compile(
    kernel: Callable[P, R], freedoms: set[str], *, counted: bool = True, inline: bool = False
) -> Callable[P, R]:
    settings = {
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,  # a C entry point, which nothing uses and which takes time to compile
        "fastmath": freedoms or False,
        "forceinline": inline,
        "_nrt": counted,
    }
    name = kernel.__qualname__
    kernel.__qualname__ += f"-{_sources()}"  # a part of the name of the file on disk
    try:
        return cast("Callable[P, R]", cast("Any", numba.njit)(cache=True, **settings)(kernel))
    except RuntimeError:  # neither the package folder nor the user's cache is writable: compile in each process
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
    """Logs the compilation of kernels, which takes seconds once; later runs read the cache."""

    def on_start(self, _event: event.Event) -> None:
        logging.getLogger("hums").info("compiling, first run only")

    def on_end(self, _event: event.Event) -> None:
        pass


cast("Any", event).register("numba:compile", _Announcer())
