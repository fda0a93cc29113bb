"""Validation of arguments; each error names the argument, its value, the bound and a remedy."""

import math
from collections.abc import Sequence
from difflib import get_close_matches
from numbers import Real
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Samples = NDArray[np.floating]  # float32 where the source is, else float64


def real_vector(values: ArrayLike, *, name: str, minimum: int = 1, finite: bool = True) -> Array:
    """Return `values` as a contiguous (n,) float64 array, or raise ValueError."""
    vector = real_samples(values, name=name, minimum=minimum, finite=finite)
    return np.ascontiguousarray(vector, dtype=np.float64)


def real_samples(values: ArrayLike, *, name: str, minimum: int = 1, finite: bool = True) -> Samples:
    """Return `values` as a contiguous (n,) array, float32 if they are and else float64, or raise ValueError."""
    vector = np.asarray(values)
    if vector.ndim != 1 or vector.dtype.kind not in "iuf":
        raise ValueError(f"{name} has shape {vector.shape} and type {vector.dtype}; it must be one real (n,) array.")
    if vector.size < minimum:
        raise ValueError(f"{name} has {vector.size} values; at least {minimum} are needed.")
    vector = np.ascontiguousarray(vector, dtype=None if vector.dtype == np.float32 else np.float64)
    if finite and not np.all(np.isfinite(vector)):
        bad = np.flatnonzero(~np.isfinite(vector))
        raise ValueError(
            f"{name} has {bad.size} values that are not finite, the first at index {bad[0]}; "
            "repair or leave out that part of the record."
        )
    return vector


def number(value: object, *, name: str) -> float:
    """Return a finite real number, or raise ValueError."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name}={value!r} must be a number, not {type(value).__name__}.")  # noqa: TRY004
    if not math.isfinite(value):
        raise ValueError(f"{name}={value} must be finite.")
    return float(value)


def positive(value: object, *, name: str) -> float:
    """Return a finite number above zero, or raise ValueError."""
    found = number(value, name=name)
    if found <= 0:
        raise ValueError(f"{name}={value!r} must be above zero; give a positive number.")
    return found


def whole(value: object, *, name: str, least: int, most: int | None = None) -> int:
    """Return a whole number within bounds, or raise ValueError."""
    bounds = f"of at least {least}" if most is None else f"from {least} to {most}"
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):  # type: ignore[operator]
        raise ValueError(f"{name}={value!r} must be a whole number {bounds}.")
    return int(value)  # type: ignore[call-overload, no-any-return]


def choice(value: object, *, name: str, choices: Sequence[str]) -> None:
    """Raise ValueError at anything that is not one of the choices."""
    if value not in choices:
        raise ValueError(
            f"{name}={value!r} is unknown; it must be one of {', '.join(choices)}.{nearest(value, choices)}"
        )


def nearest(value: object, choices: Sequence[str]) -> str:
    """Return `` Did you mean 'x'?`` for the closest of the choices, or an empty string where none is close."""
    close = get_close_matches(str(value), choices, n=1)
    return f" Did you mean {close[0]!r}?" if close else ""


# ---- Values of a record that are not finite: refused with their index, or replaced by NaN ----------------------------


Missing = Literal["refuse", "mark"]


def samples(
    x: ArrayLike, *, missing: Missing, minimum: int = 0, rate_hz: float = 1.0, start_s: float = 0.0, first: int = 0
) -> Samples:
    """Return a block of a record from index `first` on; raise at values that are not finite, or make them NaN."""
    choice(missing, name="missing", choices=get_args(Missing))
    vector = real_samples(x, name="the signal", minimum=minimum, finite=False)
    bad = np.flatnonzero(~np.isfinite(vector))
    if bad.size and missing == "refuse":
        index = first + int(bad[0])
        raise ValueError(
            f"the signal has {bad.size} values that are not finite, the first at index {index} "
            f"({start_s + index / rate_hz:.6g} s); repair or leave out that part of the record, or say "
            'missing="mark" to have NaN where the filter reaches them.'
        )
    if bad.size:
        vector = vector.copy()
        vector[bad] = np.nan
    return vector
