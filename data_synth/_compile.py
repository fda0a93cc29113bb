"""The one door of this package to numba: compiled kernels, cached on disk."""

from collections.abc import Callable
from typing import Literal, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` to machine code at its first call and keep the result on disk.

    Kernels take contiguous arrays and plain numbers, raise nothing, and release the interpreter lock. Sums may be
    added up in any order, and a product and the sum that takes it may become one instruction.
    """
    return _compile(kernel, inline="never")


def compiled_inside(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` into each kernel that calls it: no array is counted for the call."""
    return _compile(kernel, inline="always")


def _compile(kernel: Callable[P, R], *, inline: Literal["never", "always"]) -> Callable[P, R]:
    build = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}, inline=inline)
    return cast("Callable[P, R]", build(kernel))
