"""Checks of what comes in, each ending in a sentence that says what to do."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def real_vector(values: ArrayLike, *, name: str, minimum: int = 1, finite: bool = True) -> Array:
    """Return `values` as a contiguous (n,) float64 array, or raise ValueError."""
    vector = np.asarray(values)
    if vector.ndim != 1 or vector.dtype.kind not in "iuf":
        raise ValueError(f"{name} has shape {vector.shape} and type {vector.dtype}; it must be one real (n,) array.")
    if vector.size < minimum:
        raise ValueError(f"{name} has {vector.size} values; at least {minimum} are needed.")
    vector = np.ascontiguousarray(vector, dtype=np.float64)
    if finite and not np.all(np.isfinite(vector)):
        bad = np.flatnonzero(~np.isfinite(vector))
        raise ValueError(
            f"{name} has {bad.size} values that are not finite, the first at index {bad[0]}; "
            "repair or leave out that part of the record."
        )
    return vector


def positive(value: Any, *, name: str) -> float:  # noqa: ANN401
    """Return `value` as a float above zero, or raise ValueError."""
    if isinstance(value, bool | str) or not np.isscalar(value):
        raise ValueError(f"{name} = {value!r} is not a number; give a number above 0.")
    number = float(value)  # type: ignore[arg-type]
    if not math.isfinite(number) or number <= 0:
        raise ValueError(f"{name} = {value!r} must be a finite number above 0.")
    return number
