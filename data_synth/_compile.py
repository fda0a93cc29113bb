"""The one door of this package to numba: compiled kernels, cached on disk."""

import logging
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import event

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` to machine code at its first call and keep the result on disk.

    Kernels take contiguous arrays and plain numbers, raise nothing, and release the interpreter lock. Every operation
    is rounded as IEEE 754 says, in the order of the source: results do not depend on how a loop was vectorised, or on
    where arrays are in memory, as the promise of the same bytes needs.
    """
    return _compile(kernel, inside=False)


def compiled_inside(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` into each kernel that calls it. It allocates no array.

    It is analysed once and put in place by LLVM: in place of the source that would take twice as long to compile.
    Without the allocator (``_nrt``) references to its arrays are not counted: an atomic increment for each array of a
    tuple at each call was 40 % of an integration's time.
    """
    return _compile(kernel, inside=True)


def _compile(kernel: Callable[P, R], *, inside: bool) -> Callable[P, R]:
    settings: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,  # a further entry, for C, which none needs and which takes time to compile
        "forceinline": inside,
        "_nrt": not inside,
    }
    try:
        return cast("Callable[P, R]", numba.njit(cache=True, **settings)(kernel))
    except RuntimeError:  # neither the package's folder nor the user's cache can be written: compiled in each process
        return cast("Callable[P, R]", numba.njit(**settings)(kernel))


class _Announcer(event.Listener):
    """Logs that a kernel is compiled, which takes seconds once and is then read from disk."""

    def on_start(self, _event: event.Event) -> None:
        logging.getLogger("hums").info("compiling, first run only")

    def on_end(self, _event: event.Event) -> None:
        pass


cast("Any", event).register("numba:compile", _Announcer())
