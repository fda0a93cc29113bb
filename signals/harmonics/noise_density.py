"""Density of the noise on both sides of each order, from periodograms of short segments of the record.

The variance of an estimate is the integral of the squared gain times the spectral density of the noise. Within a
passband the density is taken as constant, so that the covariance for white noise holds with the density S at the order
in place of R. The record does not show S at the order itself, where the line is and where the tracker's residual has a
notch: it is extrapolated from both sides, from frequencies that no tracked order passes and where amplitudes that walk
as the model says add less than a quarter to the noise. Each side contributes medians of periodogram bins, over ln 2 as
for the exponential distribution of noise [1]_, which a line that is not tracked does not raise: of bins near the order
and of bins farther away, through whose logarithms a parabola is laid, as the top of a resonance is.

References
----------
.. [1] D. B. Percival, A. T. Walden, "Spectral Analysis for Physical Applications", Cambridge 1993, section 6.6.
"""

import math
from functools import lru_cache

import numpy as np

from signals.harmonics.state_space import Flags, Floats, HarmonicModel, Indices

# Length of a segment in units of one over the largest bandwidth, and change of a frequency over it in bins.
SEGMENT, _SWEEP = 16.0, 1.0
_SIGNAL = 0.25  # largest density of walking amplitudes over that of the noise
_SHORTEST = 64  # samples of a segment
_MOST_SEGMENTS = 32  # evenly spread
_LOBE = 4  # bins, half of the main lobe of the window
_NEAR, _FAR, _SEARCHED = 12, 36, 64  # bins near an order on either side of it, those farther away, and all
_INTERVALS = 8  # of the record, in which densities are found where each has so many bins, else one
_POOLED, _FEWEST = 96, 8  # and the fewest of which a median is taken
# Relative variance of the median of n exponential values times n, 1 / ln(2)^2, of which the window makes two dependent.
_CHANCE = 2 / math.log(2) ** 2


def noise_density(
    record: Floats, seen: Flags, model: HarmonicModel, white: Floats, freedom: float = 1e9, curved: bool = True
) -> tuple[Floats, Floats]:
    """Return the variance of white noise as dense as that about each order, and its degrees of freedom.

    Parameters
    ----------
    record : (channel, sample) array
        Channels that miss the same samples.
    seen : (sample,) array
        Whether a sample is not missing.
    model : HarmonicModel
        Orders, phases and bandwidths.
    white : (channel,) array
        Variance of the noise if it is white; NaN where unknown.
    freedom : float
        Degrees of freedom of `white`; as good as known by default.
    curved : bool
        Whether the logarithm of the density is a parabola about an order, in records of 16 / bandwidth or more, or
        straight, from more bins.

    Returns
    -------
    density : (channel, order, interval) array
        In the unit of the record squared, in equal intervals of the record. Differences between intervals are shrunk
        by what chance explains of them. Where the record shows too little on both sides for a parabola, so is the
        difference of their median from `white`; it is `white` in a record shorter than 64 samples, with gaps
        everywhere, or where orders are side by side.
    freedom : (channel, order, interval) array
        Degrees of freedom of a chi-square variable with its relative variance.
    """
    from scipy.fft import rfft  # noqa: PLC0415 - slow to import

    known = np.broadcast_to(white, (model.orders.size, white.size))
    starts, length = _segments(seen, model, fewest=2 if curved else 4)
    window = _window(length)
    bins, rank, away = _bins(starts, length, model)
    values = np.empty((*bins.shape, len(record)))  # segment, order, side, bin, channel
    for segment, at in enumerate(starts):
        piece = record[:, at : at + length] * window
        scale = np.linalg.norm(piece, axis=1)
        piece /= np.where(scale > 0, scale, 1.0)[:, None]
        # Single precision rounds at -140 dB of the piece, below the side lobes of the window, in half the time.
        spectrum = rfft(piece.astype(np.float32), overwrite_x=True).T[bins[segment]]
        values[segment] = np.abs(spectrum.astype(np.complex128)) ** 2 * scale**2
    values[(rank == 0) | (curved & (rank > _FAR))] = np.nan
    flat, flat_chance = _shrunk(*_pooled(values), known, np.full(known.shape, 2 / freedom))
    top, top_chance = _extrapolated(values, rank, away)
    shown = curved & (top > 0) & (seen.size * model.bandwidth.max(axis=1) >= SEGMENT)[:, None]
    density = np.repeat(np.where(shown, top, flat)[None], _INTERVALS, axis=0)
    chance = np.repeat(np.where(shown, top_chance, flat_chance)[None], _INTERVALS, axis=0)
    if values[..., 0].size * _NEAR >= _INTERVALS * _POOLED * model.orders.size * _SEARCHED:
        of_interval = (starts + length / 2) * _INTERVALS // seen.size
        for interval in range(_INTERVALS):
            changed, more = _shrunk(*_pooled(values[of_interval == interval]), flat, np.zeros_like(flat))
            density[interval] *= np.divide(changed, flat, out=np.ones_like(flat), where=flat > 0)
            chance[interval] += more
    return density.transpose(2, 1, 0), 2 / chance.transpose(2, 1, 0)


def _extrapolated(values: Floats, rank: Indices, away: Floats) -> tuple[Floats, Floats]:
    """Return (order, channel) densities at the orders, and the relative variances that chance gives them.

    The logarithm of the density is a parabola of the distance from the order, through medians near it and farther away.
    NaN where it falls off faster than that of a mode, by the square of the distance, as beside a line.
    """
    parts = [(rank > 0) & (rank <= _NEAR), (rank > _NEAR) & (rank <= _FAR)]
    (near, near_chance), (far, far_chance) = (_pooled(np.where(part[..., None], values, np.nan)) for part in parts)
    close, distant = (
        np.sum(away**2 * part, axis=(0, 2, 3)) / np.maximum(part.sum(axis=(0, 2, 3)), 1) for part in parts
    )
    lever = np.clip(close / np.maximum(distant - close, 1.0), 0, 1)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.where(near / far < (distant / close)[:, None], near, np.nan)
        return near * (near / far) ** lever, (1 + lever) ** 2 * near_chance + lever**2 * far_chance


def _pooled(values: Floats) -> tuple[Floats, Floats]:
    """Return (order, channel) densities, and the relative variances that chance gives them; NaN where unknown."""
    segments, orders, _, _, channels = values.shape
    joined = np.sort(np.moveaxis(values, 0, 2).reshape(orders, 2, -1, channels), axis=2)  # NaN last
    count = np.count_nonzero(~np.isnan(joined), axis=2)
    if segments == 0:
        return np.full((orders, channels), np.nan), np.ones((orders, channels))
    lower, upper = (np.take_along_axis(joined, np.maximum(count + k, 0)[:, :, None] // 2, axis=2) for k in (-1, 0))
    sides = np.where(count < _FEWEST, np.nan, (lower + upper)[:, :, 0] / 2) / math.log(2)
    sides = np.where(np.isnan(sides), sides[:, ::-1], sides)
    return np.asarray(np.sqrt(sides).prod(axis=1)), _CHANCE / np.maximum(count.sum(axis=1), 1)


def _shrunk(found: Floats, chance: Floats, towards: Floats, other: Floats) -> tuple[Floats, Floats]:
    """Return what was found, its logarithm shrunk towards another by the part that chance explains twice over.

    `chance` and `other` are the relative variances of the two; that of the result is returned, too.
    """
    known = (found > 0) & (towards > 0)
    away = np.log(np.where(known, found, 1.0) / np.where(known, towards, 1.0))
    part = np.maximum(0.0, 1 - 2 * chance / np.maximum(away**2, chance))
    part = np.where(known, part, ~np.isnan(found))
    mixed = np.where(known, towards * np.exp(part * away), np.where(np.isnan(found), towards, found))
    return mixed, part**2 * chance + (1 - part) ** 2 * other


def _segments(seen: Flags, model: HarmonicModel, *, fewest: int) -> tuple[Indices, int]:
    """Return the starts of segments without missing samples, `fewest` in a long record, and their length."""
    from scipy.fft import next_fast_len  # noqa: PLC0415 - slow to import

    if seen.size < _SHORTEST:
        return np.empty(0, dtype=int), 0
    edges = np.linspace(0, seen.size - 1, _SHORTEST).astype(int)
    rates = np.diff(model.turns(edges)) / np.diff(edges)
    change = np.quantile(np.abs(np.diff(rates)) / np.diff(edges)[1:], 0.9, axis=-1)  # of a frequency, in a sample
    steady = math.sqrt(_SWEEP / max(change.max(initial=0.0), 1e-12))
    longest = min(SEGMENT / model.bandwidth.max(), max(seen.size / fewest, _SHORTEST), steady)
    gaps = np.flatnonzero(~seen)
    length = next(n for n in range(max(int(longest), 1), 0, -1) if next_fast_len(n) == n)
    while length >= _SHORTEST:
        count = min(_MOST_SEGMENTS, round(seen.size / length))
        starts = np.linspace(0, seen.size - length, count).astype(int)
        whole = np.searchsorted(gaps, starts) == np.searchsorted(gaps, starts + length)
        if 2 * np.count_nonzero(whole) >= count:
            return starts[whole], length
        length //= 2
    return np.empty(0, dtype=int), 0


def _bins(starts: Indices, length: int, model: HarmonicModel) -> tuple[Indices, Indices, Floats]:
    """Return (segment, order, side, bin) numbers of bins beside each order, ranks of those with noise, and places.

    The nearest to the order has rank 1, bins with a line have 0. Places are distances from the order in bins.
    """
    ends = np.stack([starts, starts + length // 2, starts + length - 1])
    first, second = np.diff(model.turns(ends), axis=1).transpose(1, 2, 0)  # (segment, order) cycles in each half
    cycles = (first + second) * length / (length - 1)
    position = np.abs(cycles - length * np.rint(cycles / length))  # in bins, folded at half of the rate
    # where the smoother's gain g has g / (1 - g), the density of walking amplitudes over the noise's, at _SIGNAL
    reach = 0.5 * (1 / _SIGNAL / (math.sqrt(2) - 1)) ** (0.5 / model.poles)
    guard = _LOBE + reach * length * model.bandwidth.max(axis=1) + 2 * np.abs(second - first)
    last = length // 2
    edges = np.clip(np.stack([np.floor(position - guard), np.ceil(position + guard) + 1]), 0, last + 1).astype(int)
    covered = np.zeros((starts.size, last + 2), dtype=int)
    rows = np.broadcast_to(np.arange(starts.size)[:, None], position.shape)
    np.add.at(covered, (rows, edges[0]), 1)
    np.add.at(covered, (rows, edges[1]), -1)
    free = np.cumsum(covered, axis=1)[:, :-1] == 0
    free[:, : _LOBE + 1] = free[:, last:] = False  # the mean, and half of the rate
    away = (guard[:, :, None] + np.arange(1, _SEARCHED + 1))[:, :, None, :] * np.array([-1, 1])[:, None]
    bins = np.rint(position[:, :, None, None] + away).astype(int)
    inside = (bins >= 0) & (bins <= last)
    bins = np.clip(bins, 0, last)
    taken = inside & free[np.arange(starts.size)[:, None, None, None], bins]
    return bins, np.cumsum(taken, axis=-1) * taken, np.broadcast_to(away, bins.shape)


@lru_cache(maxsize=4)
def _window(length: int) -> Floats:
    """Return a four-term Blackman-Harris window, side lobes at -92 dB, of unit energy."""
    from scipy.signal.windows import blackmanharris  # noqa: PLC0415

    window = np.asarray(blackmanharris(length, sym=False), dtype=np.float64)
    return np.asarray(window / np.sqrt(np.sum(window**2)))
