"""The one door to numba: compiled kernels, cached on disk."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` to machine code at its first call and keep the result on disk.

    Kernels take contiguous arrays and plain numbers, raise nothing, and release the interpreter lock. A product
    and the sum that takes it may become one instruction, rounded once.
    """
    return _compile(kernel, {"contract"})


def compiled_sums(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, free to add up in any order, so that sums use vector registers."""
    return _compile(kernel, {"contract", "reassoc"})


def compiled_exactly(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, each operation rounded as written: for what rounding errors leave over."""
    return _compile(kernel, set())


def compiled_inside(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` as `compiled` does, to become a part of the kernels that call it.

    It counts no references to the arrays it is handed: counting, at every call and for each array, holds up all else
    that the processor does. So it must neither make arrays nor return any.
    """
    return _compile(kernel, {"contract"}, counts=False)


def _compile(kernel: Callable[P, R], freedoms: set[str], *, counts: bool = True) -> Callable[P, R]:
    build = cast("Any", numba.njit)(  # `_nrt`, its count of references, has no public name
        cache=True, nogil=True, error_model="numpy", fastmath=freedoms or False, _nrt=counts, forceinline=not counts
    )
    return cast("Callable[P, R]", build(kernel))
