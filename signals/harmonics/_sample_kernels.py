"""The filter of harmonics, from angles to complex amplitudes, piece by piece.

With one pole, samples are taken one by one while the prior is open (`_open_kernels`), then eight at a time
(`_eights_kernels`); where doubles do not do, and with several poles, one by one (`_filter_kernels`).
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import WIDE
from signals.harmonics._eights_kernels import filter_eights
from signals.harmonics._filter_kernels import forward
from signals.harmonics._open_kernels import Outputs, Span, factor, filter_open, look_open
from signals.harmonics._phasors import Recipe, fill_rows
from signals.harmonics._settling_kernels import COUNTDOWN, FACTORED, PAIRS, TWOFOLD, look

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Samples whose phasors are held at a time: they stay in the nearest caches. (Rows are a little longer: at distances of
# whole pages they would fight for the same lines.)
PIECE = 1024


@compiled
def filter_samples(
    recipe: Recipe,
    places: Integers,
    phase: Floats,
    x: Floats,
    walk: Floats,
    interval: int,
    status: Integers,
    mean: Floats,
    covariance: Floats,
    innovations: Floats,
    roots: Floats,
    skip: int,
    every: int,
    output: int,
    amplitude: Floats,
    variance: Floats,
) -> int:
    """Filter samples that measure harmonics.

    Parameters
    ----------
    recipe : of the phasors.
    places : (3, order) array: the row of each order's phasor, the column of its real part and that of its imaginary
        part, -1 where there is none.
    phase : (shaft, sample) array in rad.
    x : (channel, sample) array, NaN, in all channels, where missing.
    walk, interval, status, mean, covariance : as for `forward`.
    innovations, roots : as for `forward`, (sample, 1, channel) and (sample, 1) arrays.
    skip, every : samples before the first that gives an output, and from one to the next.
    output : place of the first output.
    amplitude : (channel, order, 2 output) array, real and imaginary parts in turn, filled from there on.
    variance : (order, output) array, filled likewise: the mean over the quadratures.

    Returns
    -------
    place of the next output
    """
    samples, phasors, n = x.shape[1], recipe[0].size, mean.shape[2]
    cosine, sine = np.empty((phasors, PIECE + WIDE)), np.empty((phasors, PIECE + WIDE))
    work, levels_alone = np.empty((n, n)), n == walk.shape[1]
    for first in range(0, samples, PIECE):
        last = min(first + PIECE, samples)
        fill_rows(recipe, phase, first, last, cosine, sine)
        start = first
        while start < last:
            if status[COUNTDOWN] <= 0:
                if levels_alone and status[TWOFOLD] == PAIRS:
                    factor(status, covariance)
                if status[TWOFOLD] == FACTORED:
                    look_open(status, interval, covariance, work)
                if status[TWOFOLD] != FACTORED:
                    look(status, interval, covariance, mean, walk.shape[1], 1.0, work)
            stop = min(last, start + status[COUNTDOWN])
            # Outputs before the start, of those at skip, skip + every, ...
            before = max(0, (start - skip + every - 1) // every)
            span, outputs = (start, stop), (skip + before * every, every, output + before)
            if levels_alone and status[TWOFOLD] == FACTORED:
                filter_open(
                    places, cosine, sine, start - first, x, span, walk, mean, covariance, innovations, roots,
                    outputs, amplitude, variance,
                )  # fmt: skip
                status[COUNTDOWN] -= stop - start
            elif levels_alone and status[TWOFOLD] != PAIRS:
                filter_eights(
                    places, cosine, sine, start - first, x, span, walk, mean, covariance, innovations, roots,
                    outputs, amplitude, variance,
                )  # fmt: skip
                status[COUNTDOWN] -= stop - start
            else:
                _by_ones(
                    places, cosine, sine, start - first, x, span, walk, interval, status, mean, covariance,
                    innovations, roots, outputs, amplitude, variance,
                )  # fmt: skip
            start = stop
    return int(output + max(0, (samples - skip + every - 1) // every))


@compiled
def measured(recipe: Recipe, places: Integers, phase: Floats, width: int) -> Floats:
    """Return what multiplies the levels in these samples as rows for `forward`, (sample, 1, width)."""
    samples, phasors = phase.shape[1], recipe[0].size
    cosine, sine = np.empty((phasors, PIECE + WIDE)), np.empty((phasors, PIECE + WIDE))
    rows = np.zeros((samples, 1, width))
    for first in range(0, samples, PIECE):
        last = min(first + PIECE, samples)
        fill_rows(recipe, phase, first, last, cosine, sine)
        _lay(places, cosine, sine, 0, rows[first:last])
    return rows


@compiled
def _lay(places: Integers, cosine: Floats, sine: Floats, offset: int, rows: Floats) -> None:
    """Put phasors, from `offset` on, in their places in the rows of as many samples."""
    for i in range(len(rows)):
        for k in range(places.shape[1]):
            row, imaginary = places[0, k], places[2, k]
            rows[i, 0, places[1, k]] = cosine[row, offset + i]
            if imaginary >= 0:
                rows[i, 0, imaginary] = -sine[row, offset + i]


@compiled
def _by_ones(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, span: Span, walk: Floats,
    interval: int, status: Integers, mean: Floats, covariance: Floats, innovations: Floats, roots: Floats,
    outputs: Outputs, amplitude: Floats, variance: Floats,
) -> None:  # fmt: skip
    """Filter the samples of a span, whose phasors stand from `offset` on."""
    (start, stop), (following, every, output) = span, outputs
    channels, size = len(x), stop - start
    n, width = mean.shape[2], walk.shape[1]
    wanted = np.zeros(size, dtype=np.bool_)
    wanted[following - start :: every] = True
    count = (size - following + start + every - 1) // every if following < stop else 0
    rows, data = np.zeros((size, 1, width)), np.empty((size, 1, channels))
    means, variances = np.empty((count, 1, channels, width)), np.empty((count, width))
    _lay(places, cosine, sine, offset, rows)
    for k in range(channels):
        for i in range(size):
            data[i, 0, k] = x[k, start + i]
    # A row of zeros stays at the reach of one.
    own = walk[start:stop] if len(walk) > 1 else walk
    forward(
        rows, data, own, 1.0, interval, status, mean, covariance, innovations[start:stop], roots[start:stop], wanted,
        means, variances, np.empty((0, 2, n, n)), np.empty(count, dtype=np.bool_),
    )  # fmt: skip
    for k in range(places.shape[1]):
        real, imaginary = places[1, k], places[2, k]
        for i in range(count):
            at = 2 * (output + i)
            for channel in range(channels):
                amplitude[channel, k, at] = means[i, 0, channel, real]
                amplitude[channel, k, at + 1] = means[i, 0, channel, imaginary] if imaginary >= 0 else 0.0
            both = variances[i, real]
            if imaginary >= 0:
                both = 0.5 * (both + variances[i, imaginary])
            variance[k, output + i] = both
