"""Sampling from sample times: rate, start and missing samples."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.records.fields import RATE_REMEDY, RecordError
from signals._validation import is_float

_OFF = 0.25  # of a step: tolerance of a sample time on an even grid, in addition to its rounding
_WRONG = 'if these times are wrong, give the rate with trust="declared" (--rate-hz ... --trust declared)'


TIMES_S: Mapping[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "\N{GREEK SMALL LETTER MU}s", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
"""Units of time in s."""
_TIME_NAMES = {"t", "time", "times", "timestamp", "timestamps", "datetime", "zeit", "temps", "tiempo", "tempo", "tijd"}


@dataclass(frozen=True, kw_only=True)
class SampleTimes:
    """Sampling found from sample times.

    Attributes
    ----------
    rate_hz : float
        Sampling rate between gaps in Hz.
    resolution : float
        Relative uncertainty of the rate due to the rounding of the times.
    coarse : bool
        Whether the times are rounded to more than two sampling intervals: over n samples, a line at half the sampling
        rate may then be off by more than one bin of the spectrum, 2 / n of the rate.
    start_s : float
        Time of the first sample in s.
    places : (n,) array of int or None
        Index of each sample on an even grid; None if no sample is missing.
    """

    rate_hz: float
    resolution: float
    coarse: bool
    start_s: float
    places: NDArray[np.intp] | None

    @property
    def range_text(self) -> str:
        """Range of rates that the rounding of the times allows, in words."""
        low, high = ((1 + sign * self.resolution) * self.rate_hz for sign in (-1, 1))
        return f"between {max(low, 0.0):.6g} and {high:.6g} Hz"

    def filled(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return samples on the even grid, with NaN where samples are missing."""
        if self.places is None:
            return values
        grid = np.full(int(self.places[-1]) + 1, np.nan, dtype=np.float32 if values.dtype == np.float32 else np.float64)
        grid[self.places] = values
        return grid


def rates_agree(declared: float, stated: float, *, resolution: float = 0.0) -> bool:
    """Return whether two rates agree, allowing for a fraction dropped from a whole number and rounded time steps."""
    tolerance = max(1e-5, resolution)  # a step printed with six digits
    if not resolution and (float(declared).is_integer() != float(stated).is_integer()):
        # a whole number drops a fraction: less than 1 Hz, and at most this share of the rate
        tolerance = max(tolerance, min(1 / stated, 1e-3))
    return abs(declared - stated) < tolerance * stated


def sample_times(times: NDArray[Any], *, unit_s: float, what: str) -> SampleTimes | None:
    """Return the sampling found from sample times; None if all are equal or unknown.

    The first estimate of the rate is the median over intervals much longer than the rounding of the times. Intervals
    longer than expected by half a step or more are gaps; the rate is then that of the least-squares line through the
    times with the gaps removed.

    Parameters
    ----------
    times : (n,) array
        In units of `unit_s`; NaN where a time is unknown.
    unit_s : float
        Unit of the times in s.
    what : str
        Name of the times for error messages.

    Raises
    ------
    RecordError
        If times run backwards, are uneven between gaps, or more samples are missing than were recorded.
    """
    known = np.flatnonzero(np.isfinite(times.astype(np.float64)))
    seconds = unit_s * times[known].astype(np.float64)
    if known.size < 2 or seconds.min() == seconds.max():  # noqa: PLR2004
        return None
    number = known - known[0]
    quantum_s = unit_s * _quantum(times[known])
    steps_s = np.diff(seconds)
    if (repeated := steps_s == 0).mean() > 0.1:  # one time for several samples  # noqa: PLR2004
        quantum_s = max(quantum_s, float(np.median(steps_s[~repeated & (steps_s > 0)])))
    lag = 1
    # 64 steps of rounding in the interval from which the rate is first estimated
    while lag < known.size // 4 and np.median(seconds[lag:] - seconds[:-lag]) < 64 * quantum_s:
        lag *= 2
    backwards = np.flatnonzero(steps_s < 0)
    if backwards.size:
        at = int(backwards[0])
        raise RecordError(
            f"{what} run backwards: row {known[at + 1] + 1} is {-steps_s[at]:.6g} s before row {known[at] + 1}. Split "
            f"the file there; or, {_WRONG}."
        )
    median_s = float(np.median((seconds[lag:] - seconds[:-lag]) / (number[lag:] - number[:-lag])))
    rate_hz = 1 / (median_s or (seconds[-1] - seconds[0]) / number[-1])
    longer = steps_s * rate_hz - np.diff(number)
    rounding = quantum_s * rate_hz
    usual = float(np.quantile(np.abs(longer), 0.9))
    # 0.5 of a step, from which a longer interval is a gap
    gaps = np.flatnonzero(longer > 0.5 + (min(rounding, usual) if rounding < 2 else rounding))  # noqa: PLR2004
    missing = np.zeros(known.size)
    missing[gaps + 1] = longer[gaps]
    missing = np.cumsum(missing)
    joined_s = seconds - seconds[0] - missing / rate_hz
    step_s, first_s = np.polyfit(number, joined_s, 1)
    off = np.abs(joined_s - first_s - step_s * number) / step_s
    # more than 1 % of the intervals are not gaps: the samples are uneven
    # 0.6 of the rounding: deviation of truncated times from the line through them, half plus a slope error
    if off.max() > _OFF + 0.6 * quantum_s / step_s or gaps.size > max(1, 0.01 * known.size):
        raise RecordError(
            f"{what} are not evenly spaced: {gaps.size} intervals are longer than the others by half a step or more, "
            f"and row {known[off.argmax()] + 1} is {off.max():.3g} steps from its place at {1 / step_s:.6g} Hz. "
            f"Resample the record to even times; or, {_WRONG}."
        )
    lost = round(missing[-1])
    if lost > times.size:
        at = int(gaps[np.argmax(longer[gaps])])
        raise RecordError(
            f"{what} skip {lost} samples, more than the {times.size} recorded: from row {known[at] + 1} to row "
            f"{known[at + 1] + 1} they advance by {steps_s[at]:.6g} s. Split the file there and convert its parts "
            "separately."
        )
    whole = round(1 / step_s)
    return SampleTimes(
        rate_hz=float(whole) if abs(whole * step_s - 1) < 1e-9 else float(1 / step_s),  # noqa: PLR2004
        resolution=max(quantum_s / (step_s * known.size), 1e-9),
        coarse=bool(quantum_s > (2 + _OFF) * step_s),
        start_s=float(seconds[0] - known[0] * step_s),
        places=None if lost < 1 else _places(times.size, known, missing),
    )


def _places(count: int, known: NDArray[np.intp], missing: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the index of each sample on the even grid; a sample without a time follows the one before it."""
    before = np.searchsorted(known, np.arange(count), side="right") - 1
    return np.asarray(np.arange(count) + np.rint(missing[np.maximum(before, 0)]).astype(np.intp))


def _quantum(times: NDArray[Any]) -> float:
    """Return the rounding of times: the decimal place of the last digit, or the floating-point spacing."""
    few = times[:: max(1, times.size // 4096)]  # 4096 times from which their rounding is found
    kind = few.dtype if few.dtype.kind == "f" else np.dtype(np.float64)
    spacing = float(np.spacing(np.abs(few).max().astype(kind)))
    for places in range(13):
        scaled = few.astype(np.float64) * 10.0**places
        if 10.0**-places <= spacing:
            break
        if np.max(np.abs(scaled - np.rint(scaled))) < max(1e-6, 2 * spacing * 10.0**places):
            return 10.0**-places
    return spacing


def time_scale(units: str | None) -> tuple[float, datetime | None] | None:
    """Return the unit of time in s and its epoch from units such as "ms since 2024-01-01"; None for other units.

    An epoch without a UTC offset is in UTC, by the CF conventions.
    """
    unit, _, since = (units or "").strip().partition(" since ")
    seconds = TIMES_S.get(unit.strip().lower())
    if seconds is None:
        return None
    try:
        epoch = datetime.fromisoformat(since.strip().removesuffix(" UTC")) if since else None
    except ValueError:
        return None
    return seconds, epoch.replace(tzinfo=UTC) if epoch is not None and epoch.tzinfo is None else epoch


def words_of(name: str) -> list[str]:
    """Return the words of a name in lower case."""
    return [word for word in re.split(r"[\W_]+", name.lower()) if word]


def is_time_name(name: str) -> bool:
    """Return whether a name is that of sample times: "t", "Time [ms]", "time_s", "t2 [s]", "elapsed time"."""
    own = re.sub(r"([a-z])(\d)", r"\1 \2", name.rpartition(".")[2])  # "t1", but "T1" may be a temperature
    words = [word for word in words_of(own) if not word.isdigit()] or [""]
    others = set(words) - _TIME_NAMES
    beside_time = {"elapsed", "relative", "rel", "absolute", "abs", "date", "stamp", "utc", "axis", "in", "seconds"}
    plain = len(others) < len(set(words)) and all(word in beside_time or word in TIMES_S for word in others)
    return plain or (words[0] in _TIME_NAMES and words[-1] in TIMES_S)  # such as "time DE [s]" and "time NDE [s]"


def held_times(
    values: Any,  # noqa: ANN401
    *,
    what: str,
    rate_hz: float | None,
    start_s: float,
) -> tuple[Any, float | None, float]:
    """Return samples with their rate and start; the times of a DataArray are checked against the declarations.

    Returns
    -------
    values : (n,) array
        Samples, with NaN where times skip some.
    rate_hz : float or None
        As declared, else from the times.
    start_s : float
        Time of the first sample in s.

    Raises
    ------
    RecordError
        If times contradict the rate or a start other than zero, or are too coarse for a rate.
    """
    times = _own_times(values, f"{what}: the times of its DataArray") if isinstance(values, xr.DataArray) else None
    if times is None:
        return values, rate_hz, start_s
    if is_float(rate_hz) and not rates_agree(rate_hz, times.rate_hz, resolution=times.resolution):
        raise RecordError(
            f"{what}: the times of its DataArray state {times.rate_hz:g} Hz, which rate_hz={rate_hz:g} contradicts; "
            "omit it, or pass only the values."
        )
    if rate_hz is None and times.coarse:
        raise RecordError(f"{what}: the times of its DataArray state a rate {times.range_text} only; {RATE_REMEDY}.")
    start_s = start_s or times.start_s
    if abs(times.start_s - start_s) * times.rate_hz > 0.5:  # noqa: PLR2004
        raise RecordError(
            f"{what}: the times of its DataArray begin at {times.start_s:g} s, which start_s={start_s:g} contradicts; "
            "omit start_s, or pass only the values."
        )
    return times.filled(values.values), times.rate_hz if rate_hz is None else rate_hz, start_s


def _own_times(array: xr.DataArray, what: str) -> SampleTimes | None:
    """Return the sampling from the time coordinate of a row of samples; None if it has none."""
    dim = str(array.dims[0]) if array.ndim == 1 else ""
    if dim not in array.coords:
        return None
    axis = array[dim]
    scale = time_scale(axis.attrs.get("units"))
    if axis.dtype.kind in "mM":
        return sample_times((axis.values - axis.values[0]) / np.timedelta64(1, "s"), unit_s=1.0, what=what)
    if axis.dtype.kind not in "iuf" or (scale is None and not is_time_name(dim)):
        return None
    return sample_times(axis.values, unit_s=scale[0] if scale else 1.0, what=what)
