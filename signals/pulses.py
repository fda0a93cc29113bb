"""Tachometer waveform to pulse times: a threshold that follows the waveform, and edges between the samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from signals._checks import Array, choice, number, positive, real_vector

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_HYSTERESIS = 0.25  # of the swing, either side of the middle
_SWING_PERCENTILES = (1.0, 99.0)
_STRETCHES = 32  # of the record, in each of which a threshold for all of it must be crossed both ways
_FINEST = 1024  # blocks with a level of their own
_PULSES_A_BLOCK = 8
_SMALLEST_SWING = 0.1  # of the largest of all blocks: less is a shaft at rest
_OF_NOISE = 8.0  # standard deviations of the noise that a swing must have
_SHARPER = 0.8

Edge = Literal["rising", "falling", "auto"]


@dataclass(frozen=True, kw_only=True)
class PulseTrain:
    """Times at which a tachometer waveform goes through its threshold.

    `threshold` and `hysteresis` are medians of `levels` and `margins`, which hold at `level_times_s` and change evenly
    between; one of each where the waveform does not drift. `gaps_s` are the stretches without a value, in which no
    edge is known; `debounced` counts edges left out as too close to the one before.
    """

    times_s: Array = field(metadata={"dims": ("pulse",), "units": "s"})
    threshold: float
    hysteresis: float
    edge: Literal["rising", "falling"] = "rising"
    level_times_s: Array = field(default_factory=lambda: np.zeros(1), metadata={"dims": ("level",), "units": "s"})
    levels: Array = field(default_factory=lambda: np.zeros(1), metadata={"dims": ("level",), "units": "as waveform"})
    margins: Array = field(default_factory=lambda: np.zeros(1), metadata={"dims": ("level",), "units": "as waveform"})
    gaps_s: Array = field(default_factory=lambda: np.zeros((0, 2)), metadata={"dims": ("gap", "side"), "units": "s"})
    debounced: int = 0


def pulse_times(
    waveform: ArrayLike,
    *,
    rate_hz: float,
    start_s: float = 0.0,
    edge: Edge = "rising",
    min_interval_s: float = 0.0,
    on_gap: Literal["refuse", "mark"] = "refuse",
) -> PulseTrain:
    """Find the edges of a tachometer waveform, between samples by linear interpolation.

    The threshold is half-way between the 1st and 99th percentile; an edge counts once the waveform has been
    a quarter of the swing below it, and is to rise a quarter above, so noise on an edge makes one pulse. Where
    noise carries an edge through the threshold several times, its place is the sum of the rises less the sum of
    the falls: that of one clean rise with as much time below. Measured on a sine of
    20 Hz at 51.2 kHz with noise of 5 % of its amplitude: bias 0.1 samples and standard deviation 3.2, where the
    first rise comes 31 samples early, with 11.

    Where one threshold does not serve the whole record, as baseline or amplitude drift, each block of the record has
    its own, about a baseline through the means of the blocks, and all are carried on evenly between. Blocks are halved
    for as long as that finds more pulses and each holds eight. A block whose swing is below a tenth of the largest,
    or within the noise, is a shaft at rest and takes the levels of its neighbours.

    Parameters
    ----------
    waveform : (n,) array, any unit
    rate_hz : float
    start_s : float
        Time of the first sample.
    edge : {"rising", "falling", "auto"}
        Which edge makes the pulse. "auto" takes the sharper, by the samples it takes from one side of the hysteresis
        to the other; where neither takes 0.8 of the other's, the leading edge of the narrower side.
    min_interval_s : float
        An edge that follows the one before by less is left out, and counted.
    on_gap : {"refuse", "mark"}
        What becomes of values that are not finite. "mark" takes no edge across them and returns `gaps_s`.

    Raises
    ------
    ValueError
        Fewer than two edges, a constant waveform, gaps, or a waveform that looks like a list of times.
    """
    choice(edge, name="edge", choices=("rising", "falling", "auto"))
    choice(on_gap, name="on_gap", choices=("refuse", "mark"))
    wave = real_vector(waveform, name="the tachometer waveform", minimum=3, finite=on_gap == "refuse")
    rate = positive(rate_hz, name="rate_hz")
    start, closest = number(start_s, name="start_s"), number(min_interval_s, name="min_interval_s")
    _refuse_what_is_none(wave)
    wave, edge_found, found = _edges(wave, edge)
    sign = -1.0 if edge_found == "falling" else 1.0
    times, debounced = _debounced(start + found.positions / rate, closest)
    if times.size < 2:  # noqa: PLR2004
        way = "downwards" if edge_found == "falling" else "upwards"
        raise ValueError(
            f"the tachometer waveform crosses {sign * np.median(found.levels):.4g} {way} {times.size} times; at least "
            "2 pulses are needed. Check the channel."
        )
    return PulseTrain(
        times_s=times,
        threshold=float(sign * np.median(found.levels)),
        hysteresis=float(np.median(found.margins)),
        edge=edge_found,
        level_times_s=start + found.centres / rate,
        levels=sign * found.levels,
        margins=found.margins,
        gaps_s=start + _gaps(wave) / rate,
        debounced=debounced,
    )


@dataclass(frozen=True, kw_only=True)
class _Found:
    """Rising edges in samples, how long each took, and the levels that found them."""

    positions: Array
    transits: NDArray[np.int64]
    centres: Array
    levels: Array
    margins: Array


def _refuse_what_is_none(wave: Array) -> None:
    finite = wave[np.isfinite(wave)]
    if finite.size < 3:  # noqa: PLR2004
        raise ValueError(f"the tachometer waveform has {finite.size} finite values; at least 3 are needed.")
    if np.all(np.diff(finite) > 0):
        raise ValueError(
            "the tachometer waveform only ever rises: it looks like a list of pulse times, not a waveform; "
            "hand it over as pulse times (on the command line: --tach-times)."
        )
    if finite.min() == finite.max():
        raise ValueError(
            f"the tachometer waveform is constant, {finite[0]:.6g} at every sample: at least 2 "
            "pulses are needed. Check the channel and its cable."
        )


def _edges(wave: Array, edge: Edge) -> tuple[Array, Literal["rising", "falling"], _Found]:
    """Return the waveform, turned over for falling edges, which edge it is, and the edges found."""
    if edge != "auto":
        turned = wave if edge == "rising" else -wave
        return turned, edge, _rises(turned)
    rising, falling = _rises(wave), _rises(-wave)
    up = float(np.mean(rising.transits)) if rising.transits.size else np.inf
    down = float(np.mean(falling.transits)) if falling.transits.size else np.inf
    if min(up, down) > _SHARPER * max(up, down):
        finite = wave[np.isfinite(wave)]
        takes_rise = bool(np.mean(finite > np.median(rising.levels)) <= 0.5)  # noqa: PLR2004 - high for less than half
    else:
        takes_rise = up < down
    return (wave, "rising", rising) if takes_rise else (-wave, "falling", falling)


def _rises(wave: Array) -> _Found:
    """Find the rising edges by one threshold for all, or by as many as the drift of the waveform needs."""
    best = _rises_by(wave, 1)
    if best is None:
        raise ValueError("the tachometer waveform does not swing; check the channel.")
    if _serves_everywhere(wave, best):
        return best
    blocks = 2
    while blocks <= min(_FINEST, wave.size // 16):
        finer = _rises_by(wave, blocks)
        if finer is None or finer.positions.size < _PULSES_A_BLOCK * blocks:
            if best.positions.size > _PULSES_A_BLOCK * blocks * 2:
                break
        elif finer.positions.size > best.positions.size:
            best = finer
        blocks *= 2
    return best


def _serves_everywhere(wave: Array, found: _Found) -> bool:
    """Whether every stretch of the record goes beyond the hysteresis on both sides."""
    length = wave.size // _STRETCHES
    if length == 0 or found.positions.size < 2 * _STRETCHES:
        return found.positions.size <= _PULSES_A_BLOCK and not _drifts(wave)
    rows = wave[: length * _STRETCHES].reshape(_STRETCHES, length)
    filled = np.isfinite(rows).all(axis=1)
    level, margin = found.levels[0], found.margins[0]
    crossed = (rows.max(axis=1) > level + margin) & (rows.min(axis=1) < level - margin)
    return bool(np.all(crossed | ~filled))


def _drifts(wave: Array) -> bool:
    """Whether a record with few edges may hold more: its halves swing far less than all of it."""
    eighths = np.array_split(wave[np.isfinite(wave)], 8)
    swings = [np.ptp(part) for part in eighths if part.size]
    return bool(np.median(swings) < 0.5 * np.ptp(wave[np.isfinite(wave)]) and np.median(swings) > 0)


def _rises_by(wave: Array, blocks: int) -> _Found | None:
    """Find rising edges with a level for each of so many blocks; None where no block swings."""
    bounds = np.linspace(0, wave.size, blocks + 1).astype(np.int64)
    base = _baseline(wave, bounds)
    level_wave = wave - base if base is not None else wave
    low, high = np.array([_swing(level_wave[a:b]) for a, b in pairwise(bounds.tolist())]).T
    swing = high - low
    noise = _noise(wave) if blocks > 1 else 0.0
    with np.errstate(invalid="ignore"):  # blocks without a value
        turning = (swing > 0) & (swing >= _SMALLEST_SWING * np.nanmax(swing)) & (swing > _OF_NOISE * noise)
    if not turning.any():
        return None
    centres = ((bounds[:-1] + bounds[1:] - 1) / 2)[turning]
    levels, margins = ((low + high) / 2)[turning], (_HYSTERESIS * swing)[turning]
    if base is None:
        return _through(wave, levels[0], margins[0], centres, levels, margins)
    at = np.arange(wave.size)
    level = base + np.interp(at, centres, levels)
    return _through(wave, level, np.interp(at, centres, margins), centres, level[np.rint(centres).astype(int)], margins)


def _baseline(wave: Array, bounds: NDArray[np.int64]) -> Array | None:
    """Block means, carried on evenly between and beyond; None for a single block."""
    means = np.array([_mean(wave[a:b]) for a, b in pairwise(bounds.tolist())])
    centres = ((bounds[:-1] + bounds[1:] - 1) / 2)[np.isfinite(means)]
    means = means[np.isfinite(means)]
    if bounds.size == 2 or means.size < 2:  # noqa: PLR2004
        return None
    first, last = np.diff(means)[[0, -1]] / np.diff(centres)[[0, -1]]
    centres = np.concatenate([[0.0], centres, [wave.size - 1.0]])
    beyond = means[0] - first * centres[1], means[-1] + last * (centres[-1] - centres[-2])
    return np.asarray(np.interp(np.arange(wave.size), centres, np.concatenate([beyond[:1], means, beyond[1:]])))


def _mean(part: Array) -> float:
    finite = part[np.isfinite(part)]
    return float(finite.mean()) if finite.size else np.nan


def _swing(part: Array) -> tuple[float, float]:
    """Low and high level of a stretch, NaN where it holds no value."""
    finite = part[np.isfinite(part)]
    if finite.size == 0:
        return np.nan, np.nan
    low, high = np.percentile(finite, _SWING_PERCENTILES)
    # narrow pulses can hide from the percentiles
    return (float(low), float(high)) if high > low else (float(finite.min()), float(finite.max()))


def _noise(wave: Array) -> float:
    """Return the standard deviation of the noise, from the median of second differences: edges are few."""
    bends = np.abs(np.diff(wave, 2))
    return float(1.4826 * np.nanmedian(bends) / np.sqrt(6))


def _through(
    wave: Array, level: Array | float, margin: Array | float, centres: Array, levels: Array, margins: Array
) -> _Found:
    """Find the places in samples at which `wave` rises through `level`, each from below the margin to above it.

    Of several crossings in one rise: the one rise that leaves as much time below the level as there is.
    """
    height = wave - level
    state = np.where(height > margin, 1, np.where(height < -margin, -1, 0))
    state[~np.isfinite(wave)] = 2  # neither: no edge is told across a gap
    decided = np.flatnonzero(state)
    rises = np.flatnonzero((state[decided][:-1] == -1) & (state[decided][1:] == 1))
    last_low, first_high = decided[rises], decided[rises + 1]
    above = height >= 0
    before = np.flatnonzero(above[1:] != above[:-1])
    edge = np.searchsorted(last_low, before, side="right") - 1
    within = (edge >= 0) & (before < first_high[np.maximum(edge, 0)]) if rises.size else np.zeros(before.size, bool)
    before, edge = before[within], edge[within]
    way = np.where(above[before + 1], 1.0, -1.0)  # a rise, a fall, ... a rise
    part = before - last_low[edge] + height[before] / (height[before] - height[before + 1])
    positions = last_low.astype(np.float64) + np.bincount(edge, weights=way * part, minlength=rises.size)
    return _Found(positions=positions, transits=first_high - last_low, centres=centres, levels=levels, margins=margins)


def _debounced(times: Array, closest: float) -> tuple[Array, int]:
    """Return the times without those that follow the last one kept too soon, and how many those are."""
    if closest <= 0 or times.size == 0 or np.diff(times).min(initial=np.inf) >= closest:
        return times, 0
    kept, last = [], -np.inf
    for time in times.tolist():
        if time - last >= closest:
            kept.append(time)
            last = time
    return np.array(kept), times.size - len(kept)


def _gaps(wave: Array) -> Array:
    """Last sample before and first after each run of values that are not finite, (gap, 2)."""
    bad = np.concatenate([[False], ~np.isfinite(wave), [False]]).astype(np.int8)
    change = np.diff(bad)
    return np.stack([np.flatnonzero(change > 0) - 1.0, np.flatnonzero(change < 0) + 0.0], axis=1)
