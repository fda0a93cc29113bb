"""The one door to numba: compiled kernels, cached on disk."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile `kernel` to machine code at its first call and keep the result on disk.

    Kernels take contiguous arrays and plain numbers, raise nothing, and release the interpreter lock.
    """
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, error_model="numpy")(kernel))
