"""Pulse times from a tachometer waveform: threshold with hysteresis, edges interpolated between samples."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from signals._validation import Array, checked, choice, number, positive, real_array, real_vector

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


_HYSTERESIS = 0.25  # of the swing, either side of the middle
_PULSES_PER_BLOCK = 2

Edge = Literal["rising", "falling", "auto"]


@dataclass(frozen=True, kw_only=True)
class PulseTrain:
    """Times at which a tachometer waveform crosses its threshold.

    Attributes
    ----------
    times_s : (pulse,) array
        Times of the pulses in s.
    threshold, hysteresis : float
        Threshold, and hysteresis on either side of it, in the unit of the waveform; medians where they follow a drift.
    edge : {"rising", "falling"}
        Edge that defines the pulse.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import pulse_times
    >>> train = pulse_times(np.sin(2 * np.pi * 5 * np.arange(1000) / 1000), rate_hz=1000)
    >>> train.edge, bool(abs(train.threshold) < 0.01)
    ('rising', True)
    """

    times_s: Array = field(metadata={"dims": ("pulse",), "units": "s"})
    threshold: float
    hysteresis: float
    edge: Literal["rising", "falling"] = "rising"


@checked
def pulse_times(
    waveform: ArrayLike,
    *,
    rate_hz: float,
    start_s: float = 0.0,
    edge: Edge = "rising",
    full_scale: float | None = None,
    threshold: float | None = None,
    hysteresis: float | None = None,
) -> PulseTrain:
    """Return the times of the edges of a tachometer waveform, interpolated linearly between samples.

    Parameters
    ----------
    waveform : (n,) array
        Samples of the tachometer channel, any unit.
    rate_hz : float
        Sampling rate in Hz.
    start_s : float
        Time of the first sample in s.
    edge : {"rising", "falling", "auto"}
        Edge that defines the pulse. "auto" chooses the steeper one, with fewer samples across the hysteresis; if
        neither takes less than 0.8 times the samples of the other, the leading edge of the narrower level.
    full_scale : float, optional
        Full scale of the channel, in the unit of the waveform. A waveform that swings by less than a hundredth of it is
        hum or noise, from a shaft at rest or a disconnected sensor, and raises.
    threshold : float, optional
        Level whose crossing is the edge, in the unit of the waveform; estimated from the waveform by default.
    hysteresis : float, optional
        Distance on either side of the threshold that the waveform has to cross for an edge, in its unit; estimated from
        the waveform by default.

    Returns
    -------
    PulseTrain

    Raises
    ------
    ValueError
        Fewer than two edges, a constant waveform, a swing far below `full_scale`, a stated threshold outside the levels
        of the waveform, values that are not finite, or a waveform that looks like a list of times.

    Notes
    -----
    The threshold is half-way between the two levels of the waveform and the hysteresis a quarter of their difference on
    either side, so that a noisy edge gives one pulse. The levels are quantiles that exclude one hundredth of the
    samples at either end. Narrower pulses would be excluded as well: where fewer samples lie beyond the middle of the
    range, the quantiles are those of half that fraction, provided that the pulses are at least twice as high as the
    swing of the rest and regularly spaced, as pulses of a shaft are and outliers are not.

    Where noise crosses the threshold several times in one edge, the time of the edge is the sum of the upward crossings
    less that of the downward ones, which leaves the time spent below the threshold unchanged. On a sine of 20 Hz
    sampled at 51.2 kHz, with noise of 5 % of its amplitude, the measured bias is 0.1 samples and the standard deviation
    3.2; the first crossing is 31 samples early, with a standard deviation of 11.

    Where baseline or amplitude drift too far for one threshold, each block of the record has its own, relative to a
    baseline through the block means, and both are interpolated in between. The number of blocks is doubled as long as
    more pulses are found and each block holds two. Blocks whose swing is below a tenth of the largest, or within the
    noise, are attributed to a shaft at rest and use the thresholds of their neighbours.

    Examples
    --------
    A sine of 5 Hz rises through zero every 0.2 s; the first crossing after the start is at 0.2 s:

    >>> import numpy as np
    >>> from signals import pulse_times
    >>> t = np.arange(1000) / 1000
    >>> pulse_times(np.sin(2 * np.pi * 5 * t), rate_hz=1000).times_s.round(3).tolist()
    [0.2, 0.4, 0.6, 0.8]
    """
    choice(edge, name="edge", choices=("rising", "falling", "auto"))
    wave = real_vector(waveform, name="the tachometer waveform", minimum=3)
    rate, start = positive(rate_hz, name="rate_hz"), number(start_s, name="start_s")
    _refuse_non_waveform(wave)
    levels = _Levels(
        threshold=None if threshold is None else number(threshold, name="threshold"),
        hysteresis=None if hysteresis is None else positive(hysteresis, name="hysteresis"),
    )
    wave, edge_found, found = _edges(wave, edge, levels)
    sign = -1.0 if edge_found == "falling" else 1.0
    if full_scale is not None:
        _refuse_faint(found, positive(full_scale, name="full_scale"))
    times = start + found.positions / rate
    if times.size < 2:  # noqa: PLR2004
        sense = "downwards" if edge_found == "falling" else "upwards"
        raise ValueError(
            f"the tachometer waveform crosses {sign * found.level:.4g} {sense} {times.size} times; at "
            "least 2 pulses are needed. Check the channel and the threshold."
        )
    return PulseTrain(
        times_s=times,
        threshold=sign * found.level,
        hysteresis=found.margin,
        edge=edge_found,
    )


@dataclass(frozen=True)
class _Edges:
    """Rising edges: positions and durations in samples, threshold and hysteresis, and the swing of the waveform."""

    positions: Array
    durations: NDArray[np.int64]
    level: float
    margin: float
    swing: float


def _refuse_faint(found: _Edges, full_scale: float) -> None:
    """Raise where the waveform swings by far less than the full scale of its channel."""
    least_of_range = 0.01  # of full scale: conditioned pulses fill a tenth of it or more; hum stays below
    if found.swing < least_of_range * full_scale:
        raise ValueError(
            f"the waveform swings by {found.swing:.3g}, below {least_of_range:.0%} of the channel's full_scale of "
            f"{full_scale:g}: hum or noise, not pulses. Check that the shaft turns and the sensor is connected; if the "
            "pulses are that small, give the range the channel was recorded with as full_scale."
        )


def _refuse_non_waveform(wave: Array) -> None:
    """Raise where the values are constant, missing, or a list of pulse times."""
    if np.all(np.diff(wave) > 0):
        raise ValueError(
            "the tachometer waveform rises at every sample: it looks like a list of pulse times, not a waveform; "
            "pass it as pulse times (on the command line: --tach-times)."
        )
    if wave.min() == wave.max():
        raise ValueError(
            f"the tachometer waveform is constant, {wave[0]:.6g} at every sample: at least 2 "
            "pulses are needed. Check the channel and its cable."
        )


@dataclass(frozen=True, kw_only=True)
class _Levels:
    """Threshold and hysteresis as stated, None where to be estimated; `sign` is -1 for the negative of a waveform."""

    threshold: float | None
    hysteresis: float | None
    sign: int = 1


def _edges(wave: Array, edge: Edge, stated: _Levels) -> tuple[Array, Literal["rising", "falling"], _Edges]:
    """Return the waveform (its negative for falling edges), the edge chosen, and the edges found."""
    if edge == "falling":
        return -wave, edge, _rising_edges(-wave, replace(stated, sign=-1))
    rising = _rising_edges(wave, stated)
    if edge == "rising":
        return wave, edge, rising
    falling = _rising_edges(-wave, replace(stated, sign=-1))
    up = float(np.mean(rising.durations)) if rising.durations.size else np.inf
    down = float(np.mean(falling.durations)) if falling.durations.size else np.inf
    sharper = 0.8
    alike = min(up, down) > sharper * max(up, down)
    rises = bool(np.mean(wave > rising.level) <= 0.5) if alike else up < down  # noqa: PLR2004 - high for less than half
    return (wave, "rising", rising) if rises else (-wave, "falling", falling)


def _rising_edges(wave: Array, stated: _Levels) -> _Edges:
    """Return the rising edges at the levels stated, else at those of narrow pulses if there are any."""
    if stated.threshold is not None:
        low, high = _levels(wave, narrow=True)
        level = stated.sign * stated.threshold
        margin = stated.hysteresis or 2 * _HYSTERESIS * min(high - level, level - low)
        if not low < level - margin < level + margin < high:
            raise ValueError(
                f"threshold={stated.threshold:g} with a hysteresis of {margin:.4g} on either side is not within the "
                f"levels of the waveform, {stated.sign * low:.4g} and {stated.sign * high:.4g}; give one between them."
            )
        return _Edges(*_crossings(wave, level, margin), level, margin, high - low)
    found = _edges_at_levels(wave, stated.hysteresis, narrow=False)
    narrow = _edges_at_levels(wave, stated.hysteresis, narrow=True)
    best = found
    if narrow is not None and (found is None or _is_pulse_train(narrow, than=found)):
        best = narrow
    if best is None:
        raise ValueError("the tachometer waveform does not swing; check the channel.")
    return best


def _is_pulse_train(found: _Edges, *, than: _Edges) -> bool:
    """Return whether the edges are those of regularly spaced pulses far above the rest of the wave, not of outliers."""
    # twice the swing of the rest of the wave: pulses that high and regular are no outliers
    if found.swing < 2.0 * than.swing:
        return False
    intervals = np.log(np.diff(found.positions))
    changes = [
        np.quantile(np.abs(intervals[stripes:] - intervals[:-stripes]), 0.75)
        for stripes in range(1, min(8, intervals.size // 4) + 1)
    ]
    return bool(changes and min(changes) < np.log(1.5))  # of intervals one revolution apart; random ones have log 3


def _edges_at_levels(wave: Array, hysteresis: float | None, *, narrow: bool) -> _Edges | None:
    """Return the rising edges with one threshold, or with as many blocks as the drift of the waveform requires."""
    best = _edges_by_blocks(wave, 1, hysteresis, narrow=narrow)
    if best is None or _crossed_everywhere(wave, best):
        return best
    blocks = 2
    while blocks <= min(1024, wave.size // 16):  # with a threshold each
        finer = _edges_by_blocks(wave, blocks, hysteresis, narrow=narrow)
        if finer is None or finer.positions.size < _PULSES_PER_BLOCK * blocks:
            if best.positions.size > _PULSES_PER_BLOCK * blocks * 2:
                break
        elif finer.positions.size > best.positions.size:
            best = finer
        blocks *= 2
    return best


def _crossed_everywhere(wave: Array, found: _Edges) -> bool:
    """Return whether every section of the record crosses the hysteresis on both sides."""
    sections = 32  # one threshold serves the whole record only if it is crossed both ways in each section
    length = wave.size // sections
    if length == 0 or found.positions.size < 2 * sections:
        return found.positions.size <= _PULSES_PER_BLOCK and not _drifts(wave)
    rows = wave[: length * sections].reshape(sections, length)
    level, margin = found.level, found.margin
    crossed = (rows.max(axis=1) > level + margin) & (rows.min(axis=1) < level - margin)
    return bool(crossed.all())


def _drifts(wave: Array) -> bool:
    """Return whether an eighth of the record typically swings less than half as far as the whole."""
    swings = [np.ptp(part) for part in np.array_split(wave, 8) if part.size]
    return bool(0 < np.median(swings) < 0.5 * np.ptp(wave))


def _edges_by_blocks(wave: Array, blocks: int, hysteresis: float | None, *, narrow: bool) -> _Edges | None:
    """Return the rising edges with one threshold per block; None where no block swings."""
    bounds = np.linspace(0, wave.size, blocks + 1).astype(np.int64)
    base = _baseline(wave, bounds)
    detrended = wave - base if base is not None else wave
    low, high = np.array([_levels(detrended[a:b], narrow=narrow) for a, b in pairwise(bounds.tolist())]).T
    swing = high - low
    noise = _noise(wave) if blocks > 1 else 0.0
    # a shaft is at rest in blocks below 0.1 of the largest swing, or 8 standard deviations of the noise
    rotating = (swing > 0) & (swing >= 0.1 * swing.max()) & (swing > 8.0 * noise)
    if not rotating.any():
        return None
    centres = ((bounds[:-1] + bounds[1:] - 1) / 2)[rotating]
    levels, swing = ((low + high) / 2)[rotating], swing[rotating]
    margins = _HYSTERESIS * swing if hysteresis is None else np.full(swing.size, hysteresis)
    if base is None:
        first = float(levels[0]), float(margins[0]), float(swing[0])
        return _Edges(*_crossings(wave, levels[0], margins[0]), *first)
    at = np.arange(wave.size)
    level = base + np.interp(at, centres, levels)
    margin = np.interp(at, centres, margins)
    typical = (float(np.median(one)) for one in (level[np.rint(centres).astype(int)], margins, swing))
    return _Edges(*_crossings(wave, level, margin), *typical)


def _baseline(wave: Array, bounds: NDArray[np.int64]) -> Array | None:
    """Return the block means, interpolated and extrapolated linearly, (n,); None for a single block."""
    if bounds.size == 2:  # noqa: PLR2004
        return None
    means = np.array([wave[a:b].mean() for a, b in pairwise(bounds.tolist())])
    centres = (bounds[:-1] + bounds[1:] - 1) / 2
    first, last = np.diff(means)[[0, -1]] / np.diff(centres)[[0, -1]]
    centres = np.concatenate([[0.0], centres, [wave.size - 1.0]])
    ends = means[0] - first * centres[1], means[-1] + last * (centres[-1] - centres[-2])
    return np.asarray(np.interp(np.arange(wave.size), centres, np.concatenate([ends[:1], means, ends[1:]])))


def _levels(part: Array, *, narrow: bool) -> tuple[float, float]:
    """Return the low and high level of a block; `narrow` for pulses of any width."""
    tail = 0.01  # of the samples, beyond the levels on either side
    if narrow:
        above = float(np.mean(part > (part.min() + part.max()) / 2))
        tail = min(tail, above / 2, (1 - above) / 2)
    low, high = np.quantile(part, (tail, 1 - tail))
    return float(low), float(high)


def _noise(wave: Array) -> float:
    """Return the standard deviation of the noise from the median second difference, which edges hardly change."""
    differences = np.abs(np.diff(wave, 2))
    return float(1.4826 * np.median(differences) / np.sqrt(6))


def _crossings(wave: Array, level: Array | float, margin: Array | float) -> tuple[Array, NDArray[np.int64]]:
    """Return the edges at which `wave` rises through `level`, each from below the margin to above it.

    Several crossings in one edge are replaced by the single one that leaves as much time below the level.
    """
    height = wave - level
    state = np.where(height > margin, 1, np.where(height < -margin, -1, 0))
    decided = np.flatnonzero(state)
    rises = np.flatnonzero((state[decided][:-1] == -1) & (state[decided][1:] == 1))
    last_low, first_high = decided[rises], decided[rises + 1]
    above = height >= 0
    before = np.flatnonzero(above[1:] != above[:-1])
    edge = np.searchsorted(last_low, before, side="right") - 1
    within = (edge >= 0) & (before < first_high[np.maximum(edge, 0)]) if rises.size else np.zeros(before.size, bool)
    before, edge = before[within], edge[within]
    sign = np.where(above[before + 1], 1.0, -1.0)  # upward, downward, ... upward
    part = before - last_low[edge] + height[before] / (height[before] - height[before + 1])
    positions = last_low.astype(np.float64) + np.bincount(edge, weights=sign * part, minlength=rises.size)
    return positions, first_high - last_low


# ---- Edges and direction of rotation from two tachometer channels in quadrature --------------------------------------


@dataclass(frozen=True, kw_only=True)
class QuadratureEdges:
    """Edges of two channels in quadrature, four per stripe, with the direction of rotation at each.

    For `shaft_phase`: ``shaft_phase(edges.times_s, direction=edges.direction, pulses_per_rev=4 * stripes)``.

    Attributes
    ----------
    times_s : (edge,) array
        Times of the edges in s.
    direction : (edge,) array
        +1 where the first channel leads the second, else -1.
    missing_times_s : (missing,) array
        Times in s of those edges that one channel lost, restored half-way between those of the other.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import quadrature_direction
    >>> angle = 2 * np.pi * np.arange(1000) / 100
    >>> edges = quadrature_direction(np.sin(angle), np.sin(angle - np.pi / 2), rate_hz=1000)
    >>> np.diff(edges.times_s[5:9]).round(3).tolist()
    [0.025, 0.025, 0.025]
    """

    times_s: Array = field(metadata={"dims": ("edge",), "units": "s"})
    direction: NDArray[np.int64] = field(metadata={"dims": ("edge",), "units": "1"})
    missing_times_s: Array = field(default_factory=lambda: np.zeros(0), metadata={"dims": ("missing",), "units": "s"})


@checked
def quadrature_direction(
    first: ArrayLike, second: ArrayLike, *, rate_hz: float, start_s: float = 0.0
) -> QuadratureEdges:
    """Return all edges of two channels in quadrature, with the direction of rotation at each.

    The two channels pass through four states per stripe, in an order that gives the direction. Where the shaft
    reverses, the same edge passes twice, once in each direction.

    Where one channel loses a pulse, the next two edges of the other look like a shaft rocking back and forth over one
    edge. A rocking shaft has all but stopped: if the other channel keeps the pace of the preceding or following
    stripes, the pulse is taken as lost, and its edges are restored and listed in `missing_times_s`; otherwise, as next
    to a reversal, a warning says that the angle may be wrong.

    Parameters
    ----------
    first, second : (n,) arrays, any unit
        Waveforms of the two channels, sampled simultaneously; the second lags by a quarter of a stripe in forward
        rotation.
    rate_hz : float
        Sampling rate in Hz.
    start_s : float
        Time of the first sample in s.

    Returns
    -------
    QuadratureEdges

    Raises
    ------
    ValueError
        Channels of unequal length; two consecutive edges of one channel with the same sign, so that one is missing;
        more than a twentieth of the edges lost; or too few edges.

    Examples
    --------
    A shaft that reverses half-way:

    >>> import numpy as np
    >>> from signals import quadrature_direction
    >>> angle = 2 * np.pi * np.abs(np.arange(1001) - 500.3) / 100
    >>> edges = quadrature_direction(np.sin(angle - np.pi / 2), np.sin(angle), rate_hz=1000)
    >>> edges.direction[[0, -1]].tolist()
    [1, -1]
    """
    a, b = (real_array(values, name="the tachometer waveform") for values in (first, second))
    if a.shape != b.shape:
        raise ValueError(f"the channels have shapes {a.shape} and {b.shape}; both must cover the same samples.")
    found = []
    for channel, wave in enumerate((a, b)):
        for level, edge in ((1, "rising"), (0, "falling")):
            times = pulse_times(wave, rate_hz=rate_hz, start_s=start_s, edge=edge).times_s  # type: ignore[arg-type]
            found.append(np.stack([times, np.full(times.size, channel), np.full(times.size, level)]))
    edges = np.concatenate(found, axis=1)
    edges = edges[:, np.argsort(edges[0], kind="stable")]
    lost = _lost_edges(*edges)
    if lost.shape[1] > 0.05 * edges.shape[1]:
        raise ValueError(
            f"the two channels contradict each other: {lost.shape[1]} edges of {edges.shape[1]} are lost while the "
            f"other channel continues, the first in channel {int(lost[1, 0]) + 1} at {lost[0, 0]:g} s. Check its "
            "signal."
        )
    edges = np.concatenate([edges, lost], axis=1)
    times, channel, level = edges[:, np.argsort(edges[0], kind="stable")]
    states = _states(channel.astype(np.int64), level.astype(np.int64), times)
    quarter = np.array([[0, 3], [1, 2]])[states[:, 0], states[:, 1]]  # forward: 00, 10, 11, 01
    steps = (np.diff(quarter) + 1) % 4 - 1
    return QuadratureEdges(times_s=times[1:], direction=steps, missing_times_s=lost[0])


def _lost_edges(times: Array, channel: Array, level: Array) -> Array:
    """Return time, channel and level of the edges that one channel lost while the other continued, (3, lost)."""
    found, doubtful = [], []
    turns = np.flatnonzero(np.diff(channel) != 0)
    per_stripe = 4  # edges
    for first, last in zip(np.append(0, turns + 1).tolist(), np.append(turns, channel.size - 1).tolist(), strict=True):
        stripes = (last - first) // 2
        if stripes == 0:
            continue
        spans = [(first - per_stripe, first), (last, last + per_stripe)]
        paces = [times[end] - times[begin] for begin, end in spans if begin >= 0 and end < times.size]
        taken = times[first + 2 * stripes] - times[first]
        # relative difference allowed between the durations of adjacent stripes
        if any(abs(taken - stripes * pace) < 0.3 * stripes * pace for pace in paces):
            other = 1 - channel[first]
            before = np.flatnonzero(channel[:first] == other)
            high = level[before[-1]] if before.size else 1 - level[first]
            middles = (times[first : first + 2 * stripes] + times[first + 1 : first + 2 * stripes + 1]) / 2
            found += [(time, other, (high + 1 + number) % 2) for number, time in enumerate(middles.tolist())]
        else:
            doubtful.append(times[first])
    if doubtful:
        warnings.warn(
            f"one channel has several consecutive edges without one of the other in {len(doubtful)} places, first at "
            f"{doubtful[0]:g} s: counted as a shaft rocking over an edge. If it did not rock, the other channel lost "
            "pulses there, each of which puts the angle wrong by one stripe from then on; check that channel.",
            stacklevel=4,
        )
    return np.array(found).T.reshape(3, -1)


def _states(channel: NDArray[np.int64], level: NDArray[np.int64], times: Array) -> NDArray[np.int64]:
    """Return the states of both channels after each edge, (edge, 2), or raise where an edge is missing."""
    states = np.empty((channel.size, 2), dtype=np.int64)
    for which in (0, 1):
        own = np.flatnonzero(channel == which)
        repeated = np.flatnonzero(np.diff(level[own]) == 0)
        if repeated.size:
            i = own[repeated[0] + 1]
            raise ValueError(
                f"channel {which + 1} {'rises' if level[i] else 'falls'} twice in a row, the second time at "
                f"{times[i]:g} s: an edge is missing. Check that channel, or leave out that part of the record."
            )
        latest = np.searchsorted(own, np.arange(channel.size), side="right") - 1
        states[:, which] = np.where(latest >= 0, level[own[np.maximum(latest, 0)]], 1 - level[own[0]])
    return states
