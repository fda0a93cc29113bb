"""Validation of arguments; each error names the argument, its value, the bound and a remedy."""

import inspect
import math
import re
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import wraps
from numbers import Complex, Number, Real
from os import PathLike
from pathlib import PurePath
from types import UnionType
from typing import Any, Literal, ParamSpec, TypeGuard, TypeVar, get_args, get_origin
from unicodedata import category

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Samples = NDArray[np.floating]  # float32 where the source is, else float64
P = ParamSpec("P")
R = TypeVar("R")
Float = TypeVar("Float", bound=np.floating)

# Largest and smallest peak of a signal: the squares of a record's spectrum overflow beyond, or lose digits below.
_LONGEST_VALUE = 80  # characters of a value in a message
_LARGEST_WHOLE = 2**53  # above, doubles skip whole numbers


def real_vector(
    values: ArrayLike, *, name: str, minimum: int = 1, finite: bool = True, any_unit: bool = False
) -> Array:
    """Return `values` as a contiguous (n,) float64 array, or raise ValueError."""
    vector = real_samples(values, name=name, minimum=minimum, finite=finite, any_unit=any_unit)
    return np.ascontiguousarray(vector, dtype=np.float64)


def real_samples(
    values: ArrayLike, *, name: str, minimum: int = 1, finite: bool = True, any_unit: bool = False
) -> Samples:
    """Return `values` as a contiguous (n,) array, float32 if they are and else float64, or raise ValueError.

    Numbers whose squares over- or underflow are refused, but not with `any_unit`: the caller then scales them.
    """
    vector = real_array(values, name=name)
    if vector.ndim != 1 or vector.dtype.kind not in "iuf":
        raise ValueError(f"{name} has shape {vector.shape} and type {vector.dtype}; give a one-dimensional real array.")
    if vector.size < minimum:
        raise ValueError(f"{name} has {vector.size} values; at least {minimum} are needed.")
    vector = np.ascontiguousarray(vector, dtype=np.float32 if vector.dtype == np.float32 else np.float64)
    peak = _peak(vector)
    if finite and not math.isfinite(peak):
        bad = np.flatnonzero(~np.isfinite(vector))
        raise ValueError(
            f"{name} has {bad.size} values that are not finite, the first at index {bad[0]}; "
            "repair or leave out that part of the record (masked values are treated as NaN)."
        )
    peaks = {"float32": (1e-15, 1e15), "float64": (1e-152, 1e145)}
    least, most = peaks[vector.dtype.name]
    if not any_unit and ((peak > most and math.isfinite(peak)) or 0 < peak < least):
        raise ValueError(
            f"{name} has a peak of {peak:.3g}, outside {least:g} to {most:g}, where {vector.dtype} keeps the precision "
            "of squares; convert it to another unit."
        )
    return writable(vector)


def real_array(values: ArrayLike, *, name: str) -> NDArray[Any]:
    """Return anything like an array of numbers as an array, masked values as NaN, or raise ValueError."""
    try:
        array = np.ma.filled(np.ma.asarray(values, float), np.nan) if np.ma.is_masked(values) else np.asarray(values)
    except (ValueError, TypeError):
        raise ValueError(f"{name} is not an array of numbers; give rows of equal length.") from None
    if array.dtype.kind == "O" and all(isinstance(item, Real) for item in array.flat):  # fractions, large integers
        try:
            array = array.astype(np.float64)
        except OverflowError:
            raise ValueError(f"{name} has values beyond the range of floats; convert it to another unit.") from None
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}={brief(values)} has type {array.dtype}; give a real array.")
    return array


def _peak(vector: Samples) -> float:
    """Return the largest magnitude; NaN where a value is NaN."""
    return float(max(vector.max(), -vector.min())) if vector.size else 0.0


def writable(array: NDArray[Float]) -> NDArray[Float]:
    """Return a writable view of the array; numba would compile every kernel again for a read-only one."""
    if array.flags.writeable:
        return array

    class Memory:
        __array_interface__ = array.__array_interface__ | {"data": (array.ctypes.data, False)}
        owner = array

    return np.asarray(Memory())


def number(value: object, *, name: str) -> float:
    """Return a finite real number, or raise ValueError."""
    if not is_float(value):
        raise ValueError(f"{name}={brief(value)} must be a number, not {type(value).__name__}.")
    if not math.isfinite(value):
        raise ValueError(f"{name}={value} must be finite.")
    return float(value)


def positive(value: object, *, name: str) -> float:
    """Return a finite number above zero, or raise ValueError."""
    found = number(value, name=name)
    if found <= 0:
        raise ValueError(f"{name}={brief(value)} must be above zero; give a positive number.")
    least_number = 1e-250  # of a positive argument: products with smaller ones underflow
    if not least_number <= found <= 1 / least_number:
        raise ValueError(
            f"{name}={value:g} must lie between {least_number:g} and {1 / least_number:g}; give it in another unit."
        )
    return found


def whole(value: object, *, name: str, least: int, most: int | None = None) -> int:
    """Return a whole number within bounds, or raise ValueError."""
    bounds = f"of at least {least}" if most is None else f"from {least} to {most}"
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool) and abs(int(value)) <= _LARGEST_WHOLE
    if not is_whole or value < least or (most is not None and value > most):  # type: ignore[operator]
        raise ValueError(f"{name}={brief(value)} must be a whole number {bounds}.")
    return int(value)  # type: ignore[call-overload, no-any-return]


def choice(value: object, *, name: str, choices: Sequence[str]) -> None:
    """Raise ValueError at anything that is not one of the choices."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(
            f"{name}={brief(value)} is unknown; it must be one of {', '.join(choices)}.{nearest(value, choices)}"
        )


def nearest(value: object, choices: Sequence[str]) -> str:
    """Return `` Did you mean 'x'?`` for the closest of the choices, or an empty string where none is close."""
    close = get_close_matches(str(value)[:_LONGEST_VALUE], choices, n=1)
    return f" Did you mean {close[0]!r}?" if close else ""


def brief(value: object) -> str:
    """Return the `repr` of a value for a message, truncated where it is long."""
    if isinstance(value, int) and abs(value) > _LARGEST_WHOLE:
        return f"{'-' * (value < 0)}2**{abs(value).bit_length() - 1} or more"
    if isinstance(value, dict | list | tuple) and len(value) > 20:  # noqa: PLR2004
        return f"a {type(value).__name__} of {len(value)}"
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 3]}..."


# ---- Errors ----------------------------------------------------------------------------------------------------------


class SentenceError(ValueError):
    """An error with control characters escaped and the middle of a long message left out."""

    def __init__(self, message: object = "") -> None:
        super().__init__(plain_message(str(message)))


def plain_text(text: str, *, keep: str = "") -> str:
    r"""Return a text for terminals, tables and pages, with all but printable characters and those in `keep` escaped.

    A byte of a file name that is not valid UTF-8, in Python a lone surrogate, becomes \xNN.
    """
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign in keep or category(sign) == "Zs" else
        f"\\x{ord(sign) - 0xDC00:02x}" if "\udc80" <= sign <= "\udcff" else
        sign.encode("unicode_escape").decode()
        for sign in text
    )  # fmt: skip


def plain_message(text: str) -> str:
    """Return a message with control characters escaped, shortened in the middle to at most 1,000 characters."""
    shown = plain_text(text, keep="\n\t")
    longest_message = 1000  # characters, a screenful; longer ones come from names in damaged files
    half = longest_message // 2 - 3
    return shown if len(shown) <= longest_message else f"{shown[:half]} ... {shown[-half:]}"


# ---- Types of arguments, as their annotations declare them -----------------------------------------------------------


class ArgumentTypeError(SentenceError, TypeError):
    """An argument whose type differs from the declared one."""


_PATHS = frozenset({"Path", "PathLike", "PathLike[str]"})
_ARRAYS = frozenset({"ArrayLike", "NDArray", "Array", "Floats"})
# Whether values of these types agree may depend on what they are or hold; but for the next ones it does not.
_UNLIKE = (Complex, Iterable)
_ALIKE = frozenset({float, bool, str})


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that refuses arguments whose types differ from its annotations.

    Classes, numbers, strings, pairs, sequences and mappings are checked here, as are the characters and length of a
    path; choices, integers, arrays, shapes and bounds are checked where the function uses them.
    """
    annotations = {
        name: _alternatives(parameter.annotation) for name, parameter in inspect.signature(function).parameters.items()
    }
    names = tuple(annotations)
    arrays = {name for name, kinds in annotations.items() if any(kind.partition("[")[0] in _ARRAYS for kind in kinds)}
    agreed: set[tuple[str, type]] = set()  # kinds of value that need not be looked at again

    longest_name_bytes = 255  # of one file or folder, on the usual file systems

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in (*zip(names, args, strict=False), *kwargs.items()):
            kinds, seen = annotations.get(name, ()), (name, type(value))
            if not kinds or seen in agreed:
                pass
            elif any(_agrees(value, kind, function) for kind in kinds):
                array = name in arrays and isinstance(value, np.ndarray)
                if array or type(value) in _ALIKE or not isinstance(value, _UNLIKE):
                    agreed.add(seen)
            else:
                raise ArgumentTypeError(
                    f"{function.__name__} takes {' or '.join(map(_words, kinds))} for {name}, not {brief(value)} "
                    f"of type {type(value).__name__}."
                )
            if isinstance(value, str | PurePath) and not _PATHS.isdisjoint(kinds):
                if "\0" in str(value):
                    raise ArgumentTypeError(f"{name}={brief(value)} contains a NUL, which no path may; remove it.")
                longest = max((len(part.encode(errors="surrogatepass")) for part in PurePath(value).parts), default=0)
                if longest > longest_name_bytes:
                    raise SentenceError(
                        f"{name}={brief(value)} has a component of {longest} bytes; file names are limited to "
                        f"{longest_name_bytes}, so choose a shorter one."
                    )
        return function(*args, **kwargs)

    return call


def _alternatives(annotation: object) -> tuple[str, ...]:
    """Return the alternatives of an annotation as written, without module names; none without an annotation."""
    if annotation is inspect.Parameter.empty:
        return ()
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    text = re.sub(r"Optional\[(.*)\]$", r"\1 | None", re.sub(r"\b\w+\.", "", text))
    parts, depth, start = [], 0, 0
    for place, sign in enumerate(text):
        depth += (sign == "[") - (sign == "]")
        if sign == "|" and depth == 0:
            parts.append(text[start:place].strip())
            start = place + 1
    return (*parts, text[start:].strip())


def _agrees(value: object, kind: str, function: Callable[..., Any]) -> bool:  # noqa: C901, PLR0911, PLR0912 - a table of kinds
    outer, _, inner = kind.removesuffix("]").partition("[")
    match outer:
        case "None":
            return value is None
        case "float":
            return is_float(value)
        case "int" | "Fraction":
            return isinstance(value, Number | str | None)
        case "bool":
            return isinstance(value, bool | np.bool)
        case "str":
            return isinstance(value, str)
        case "ArrayLike" | "NDArray" | "Array" | "Floats":
            return not isinstance(value, list | tuple) or _is_even(value)
        case "Any":
            return True
        case "Literal":
            return isinstance(value, Hashable)
        case "PathLike" | "Path":
            return isinstance(value, PathLike)
        case "Mapping":
            keys, _, values = inner.partition(", ")
            return isinstance(value, Mapping) and all(
                any(_agrees(item, part, function) for part in _alternatives(inner_kind))
                for pair in value.items()
                for item, inner_kind in zip(pair, (keys, values), strict=True)
                if inner_kind
            )
        case "tuple":
            parts = inner.split(", ")
            return (
                isinstance(value, tuple | list | np.ndarray)
                and len(value) == len(parts)
                and all(_agrees(item, part, function) for item, part in zip(value, parts, strict=True))
            )
        case "Sequence" | "Iterable":
            if isinstance(value, str | bytes | Mapping) or not np.iterable(value):
                return False
            if not isinstance(value, list | tuple | np.ndarray):
                return outer == "Iterable" or hasattr(value, "__len__")
            return all(any(_agrees(item, part, function) for part in _alternatives(inner)) for item in value)
    declared = function.__globals__.get(outer)
    if get_origin(declared) is Literal:
        return isinstance(value, Hashable)
    if isinstance(declared, UnionType) and all(isinstance(part, type) for part in get_args(declared)):
        return isinstance(value, declared)
    if declared is not None and not isinstance(declared, type):
        return True  # another type under a name
    return any(base.__name__ == outer for base in type(value).__mro__)


def is_float(value: object) -> TypeGuard[float]:
    """Return whether a value is a real number that a float can hold, infinity and NaN among them."""
    if type(value) is float:  # nearly always, and the tests of other kinds take microseconds
        return True
    if isinstance(value, bool | np.bool) or not isinstance(value, Real):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def _is_even(rows: Sequence[object]) -> bool:
    """Return whether lists are rows of one length, which numpy makes an array."""
    try:
        np.asarray(rows)
    except ValueError:
        return False
    return True


def _words(kind: str) -> str:
    words = {"float": "a number", "int": "a whole number", "bool": "True or False", "str": "a string", "None": "None"}
    words |= dict.fromkeys(_PATHS, "a path")
    return words.get(kind, f"a {kind}")


# ---- Values of a record that are not finite: refused with their index, or replaced by NaN ----------------------------


Missing = Literal["refuse", "mark"]


def samples(
    x: ArrayLike, *, missing: Missing, minimum: int = 0, rate_hz: float = 1.0, start_s: float = 0.0, first: int = 0
) -> Samples:
    """Return a block of a record starting at index `first`; refuse values that are not finite, or mark them as NaN."""
    choice(missing, name="missing", choices=get_args(Missing))
    vector = real_samples(x, name="the signal", minimum=minimum, finite=False)
    bad = np.flatnonzero(~np.isfinite(vector))
    if bad.size and missing == "refuse":
        index = first + int(bad[0])
        raise ValueError(
            f"the signal has {bad.size} values that are not finite, the first at index {index} "
            f"({start_s + index / rate_hz:.6g} s); repair or leave out that part of the record, or give "
            'missing="mark" for NaN wherever the filter reaches them.'
        )
    if bad.size:
        vector = vector.copy()
        vector[bad] = np.nan
    return vector
