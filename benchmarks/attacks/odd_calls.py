"""Odd calls of every exported function: each gives a result, or an error in a sentence of ours, soon and in bounds."""

from __future__ import annotations

import dataclasses
import linecache
import math
import resource
import signal
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Number
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from types import FrameType

    from attacks.call_cases import Case

CPU_S = 5.0
MEMORY_BYTES = 1 << 30
ROOTS = tuple(str(Path(__file__).resolve().parents[2] / name) for name in ("signals", "hums", "data_synth"))
LEAST_WORDS = 4
LONGEST_MESSAGE = 1000
SCALES = (1e6, 1e-6)
FLOAT32_RTOL = 2e-3  # levels that single precision keeps through transforms and products
RTOL = 1e-9


class TooSlowError(BaseException):
    """A call took more of the processor than it may."""


@dataclass(frozen=True, kw_only=True)
class OddCall:
    """One call with one odd argument."""

    case: Case
    argument: str
    oddity: str
    value: Any

    def __str__(self) -> str:
        return f"{self.case.function.__name__}({self.argument}={self.oddity})"


# ---- what is odd -----------------------------------------------------------------------------------------------------


def _arrays(x: np.ndarray[Any, Any]) -> Iterator[tuple[str, Any]]:
    for value in (np.nan, np.inf, -np.inf):
        spoilt = np.array(x, dtype=np.float64)
        spoilt.flat[spoilt.size // 2] = value
        yield f"one {value}", spoilt
    yield "all NaN", np.full(x.shape, np.nan)
    yield "empty", x[:0]
    yield "one sample", x[:1]
    yield "two samples", x[:2]
    yield "zeros", np.zeros(x.shape)
    yield "constant", np.full(x.shape, 3.25)
    yield "2-D", np.stack([x, x])
    yield "column", x[..., None]
    for factor in (1e140, 1e154, 1e300, 1e-140, 1e-300):
        with np.errstate(over="ignore", under="ignore"):
            yield f"times {factor:g}", x * factor
    yield "complex", x.astype(complex)
    yield "bool", x > 0
    yield "text", x.astype(str)
    yield "object", x.astype(object)
    yield "times of day", x.astype("datetime64[s]")
    yield "ragged", [[1.0], [2.0, 3.0]]


WRONG_TYPES: tuple[tuple[str, Any], ...] = (
    ("None", None), ("word", "rubbish"), ("bytes", b"rubbish"), ("object()", object()), ("dict", {}), ("list", []),
    ("list of None", [None]), ("function", len), ("nan", math.nan), ("array of words", np.array(["a", "b"])),
)  # fmt: skip
NUMBERS: tuple[tuple[str, Any], ...] = (
    *((f"{value:g}", value) for value in (
        math.inf, -math.inf, 0, -1, 1, 2, 1e-300, 1e-12, 1e-3, 1e9, 1e12, 1e300, -2.5, 0.5)),
    ("10**30", 10**30), ("10**400", 10**400), ("True", True), ("complex", 1j), ("array", np.arange(3.0)),
    ("numpy 3", np.int16(3)),
)  # fmt: skip


def odd_values(value: object) -> Iterator[tuple[str, Any]]:
    """Yield odd values in the place of a valid one, each with its name."""
    yield from WRONG_TYPES
    if isinstance(value, bool):
        yield from (("3", 3), ("-1", -1))
    elif value is None or isinstance(value, Number):
        yield from NUMBERS
    elif isinstance(value, np.ndarray):
        yield from _arrays(value)
    elif isinstance(value, tuple) and value and isinstance(value[0], np.ndarray):
        whole = np.concatenate(value)
        yield from ((name, (odd,)) for name, odd in _arrays(whole))
        yield "not blocks", whole
    elif isinstance(value, list | tuple) and value and all(isinstance(item, Number) for item in value):
        kind = type(value)
        for name, odd in (*NUMBERS, *WRONG_TYPES):
            yield f"first {name}", kind([odd, *value[1:]])
        yield "one too many", kind([*value, value[-1]])
        yield "reversed", kind(reversed(value))
        yield "a number", value[0]
        yield "nested", kind([value, value])
    elif isinstance(value, str):
        yield from (("", ""), ("NUL", "a\0b"), ("control", "a\x1b[2Jb"), ("long", "x" * 20_000), ("number", 3))
    elif isinstance(value, Mapping):
        yield from ((f"value {name}", dict.fromkeys(value, odd)) for name, odd in (*NUMBERS, *WRONG_TYPES))
        yield "key 3", {3: 1.0}


def odd_calls(cases: list[Case]) -> list[OddCall]:
    """Return the odd calls of some cases: each has one argument that is odd."""
    return [
        OddCall(case=case, argument=name, oddity=oddity, value=odd)
        for case in cases
        for name, value in {**case.arguments, **case.also}.items()
        for oddity, odd in odd_values(value)
    ]


# ---- what may come of it ---------------------------------------------------------------------------------------------


def call(function: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return the result of a call; that of a generator as a list."""
    result = function(**arguments)
    return list(result) if hasattr(result, "__next__") else result


def failure(odd: OddCall) -> str | None:
    """Return what is wrong with the outcome of an odd call, None where nothing is."""
    arguments = {**odd.case.arguments, odd.argument: odd.value}
    found = bounded(lambda: call(odd.case.function, arguments))
    if found == "slow":  # once more, as kernels may have been compiled
        found = bounded(lambda: call(odd.case.function, arguments))
    return found


def bounded(attempt: Callable[[], Any]) -> str | None:
    """Return what is wrong with an attempt, None where it is done or refused in a sentence of ours, in bounds."""

    def stop(_signum: int, _frame: FrameType | None) -> None:
        raise TooSlowError

    before, limits = signal.signal(signal.SIGPROF, stop), resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, limits[1]))
    begun = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, CPU_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            attempt()
    except TooSlowError:
        return "slow"
    except (ValueError, TypeError, FloatingPointError) as error:
        return None if _is_ours(error) else f"{type(error).__name__}, not of ours: {str(error)[:200]}"
    except OSError as error:  # of a file that is not there
        return None if len(str(error).split()) >= LEAST_WORDS else repr(error)
    except Exception as error:  # noqa: BLE001 - all that should not be
        return f"{type(error).__name__}: {str(error)[:200]} ({_place(error)})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_AS, limits)
    return "slow" if time.process_time() - begun > CPU_S else None


def _is_ours(error: Exception) -> bool:
    """Return whether an error is a sentence that our code raises, as against one that Python or numpy does."""
    text = str(error)
    if not len(text.split()) >= LEAST_WORDS or len(text) > LONGEST_MESSAGE:
        return False
    if type(error).__module__.startswith("pydantic"):
        return True
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return False
    name = trace.tb_frame.f_code.co_filename
    return name.startswith(ROOTS) and linecache.getline(name, trace.tb_lineno).strip().startswith("raise")


def _place(error: Exception) -> str:
    """Return the last of our lines that an error passed."""
    places, trace = ["?"], error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename.startswith(ROOTS):
            places.append(f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}")
        trace = trace.tb_next
    return places[-1]


# ---- the same answer in other types, and in other units --------------------------------------------------------------


def other_types(x: np.ndarray[Any, Any]) -> Iterator[tuple[str, Any, float]]:
    """Yield the same numbers in other types and layouts, each with the tolerance of its results."""
    frozen = x.copy()
    frozen.flags.writeable = False
    spread = np.zeros(2 * x.size)
    spread[::2] = x
    yield "read-only", frozen, RTOL
    yield "strided", spread[::2], RTOL
    yield "reversed in memory", x[::-1].copy()[::-1], RTOL
    yield "big-endian", x.astype(">f8"), RTOL
    if np.array_equal(x, x.astype(np.float32)):
        yield "float32", x.astype(np.float32), FLOAT32_RTOL
    if np.array_equal(x, np.round(x)):
        for kind in ("i2", "i4", "i8", ">i2"):
            if np.array_equal(x, x.astype(kind)):
                yield kind, x.astype(kind), RTOL


def answers_that_differ(case: Case) -> Iterator[str]:
    """Yield how results differ where the same numbers come in another type, or in another unit."""
    reference = None
    for name, value in case.arguments.items():
        blocks = isinstance(value, tuple) and bool(value) and isinstance(value[0], np.ndarray)
        if not (isinstance(value, np.ndarray) or blocks) or case.function.__module__.split(".")[0] != "signals":
            continue
        reference = call(case.function, case.arguments) if reference is None else reference
        x = np.concatenate(value) if blocks else value
        for kind, other, rtol in other_types(x):
            given = tuple(np.split(other, len(value))) if blocks else other
            outcome = call(case.function, {**case.arguments, name: given})
            for wrong in _apart(reference, outcome, rtol=rtol):
                yield f"{case.function.__name__}({name} as {kind}): {wrong}"
        if name in {"x", "values", "blocks"} and "tracks" not in case.arguments:
            for scale in SCALES:
                given = tuple(scale * part for part in value) if blocks else scale * value
                other_units = {
                    key: case.arguments[key] * scale**2 for key in ("noise_variance",) if key in case.arguments
                }
                outcome = call(case.function, {**case.arguments, name: given, **other_units})
                for wrong in _apart(reference, outcome, rtol=1e-6, scale=scale):
                    yield f"{case.function.__name__}({name} times {scale:g}): {wrong}"


def leaves(thing: object, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the arrays, numbers and words of a result."""
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        for part in dataclasses.fields(thing):
            yield from leaves(getattr(thing, part.name), f"{name}.{part.name}")
    elif isinstance(thing, list | tuple):
        for number, part in enumerate(thing):
            yield from leaves(part, f"{name}[{number}]")
    elif isinstance(thing, np.ndarray | Number | str):
        yield name, thing


def _apart(reference: object, other: object, *, rtol: float, scale: float = 1.0) -> Iterator[str]:
    """Yield the leaves of two results that differ by more than `rtol` of the largest value and a power of `scale`."""
    expected, found = dict(leaves(reference)), dict(leaves(other))
    if expected.keys() != found.keys():
        yield "another structure"
        return
    for name, value in expected.items():
        a, b = np.asarray(value), np.asarray(found[name])
        if a.dtype.kind in "fc" and a.shape == b.shape:
            difference = _largest_difference(a, b, scale)
            if not difference <= rtol:
                yield f"{name or 'result'} differs by {difference:.1e} of its largest value"
        elif a.dtype.kind in "bi" and not np.array_equal(a, b):
            yield f"{name}: {a!r:.60} and {b!r:.60}"
        elif a.shape != b.shape:
            yield f"{name}: shapes {a.shape} and {b.shape}"


def _largest_difference(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any], scale: float) -> float:
    """Return the largest difference over the largest value, after `a` took the power of `scale` that `b` has."""
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return math.inf
    finite = np.isfinite(a)
    if not finite.any():
        return 0.0
    size, other = float(np.max(np.abs(a[finite]))), float(np.max(np.abs(b[finite])))
    if size == 0 or other == 0:
        return 0.0 if size == other else math.inf
    power = round(math.log(other / size) / math.log(scale)) if scale != 1 else 0
    return float(np.max(np.abs(b[finite] - a[finite] * scale**power)) / (size * scale**power))
