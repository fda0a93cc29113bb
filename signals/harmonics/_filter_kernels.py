"""Loops over samples of the causal filters: the covariance filter with a diffuse start, and fixed gains.

A state holds `poles` blocks of quadratures: the levels, their first backward differences, and so on; real and imaginary
parts of the orders alternate within a block. From sample to sample it becomes `F (state + increment)`: F an upper
triangle of ones, the increment in the highest differences alone.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums
from signals.harmonics._block_kernels import fill_phasors

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECE = 128  # samples whose phasors are made at a time: they stay in the nearest cache


@compiled_sums
def _fill_regressors(
    phase: Floats, orders: Floats, shaft: Indices, first: int, cosine: Floats, sine: Floats, rows: Floats
) -> None:
    """Fill (sample, 2 order) rows with cos and -sin of each order in turn, from sample `first` on."""
    last = min(first + len(rows), phase.shape[1])
    for k in range(orders.size):
        fill_phasors(orders[k], phase[shaft[k], first:last], cosine, sine)
        for i in range(last - first):
            rows[i, 2 * k] = cosine[i]
            rows[i, 2 * k + 1] = -sine[i]


@compiled_sums
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled_sums
def _update_diffuse(V: Floats, h: Floats, ph: Floats, known: float, seen: Floats, covariance: Floats) -> float:
    """Update the factor V of what the prior leaves open; return the variance of the innovation.

    With `a = V^T h` and `known` the innovation's variance without V, the whole variance is `s = known + a . a` and V
    becomes `V (I - a a^T / (known r (r + 1))) - P h a^T / (known r)`, r^2 = s / known: Potter's update [1]_ beside that
    of P, no difference of large variances. `covariance` is filled with `(P + V V^T) h`, `seen` with a.

    References
    ----------
    .. [1] J. E. Potter, R. G. Stern, "Statistical filtering of space navigation measurements", AIAA Guidance and
       Control Conference, 1963.
    """
    size = seen.size
    for d in range(size):
        seen[d] = 0.0
    for b in range(h.size):
        for d in range(size):
            seen[d] += h[b] * V[b, d]
    variance = known + _dot(seen, seen)
    root = np.sqrt(variance / known)
    for b in range(size):
        reach = 0.0
        for d in range(size):
            reach += V[b, d] * seen[d]
        covariance[b] = ph[b] + reach
        factor = (reach / (root + 1.0) + ph[b]) / (known * root)
        for d in range(size):
            V[b, d] -= factor * seen[d]
    return variance


@compiled_sums
def _covariance_times(P: Floats, h: Floats, ph: Floats) -> None:
    """Fill `P h`, for a row h that has levels alone."""
    for a in range(ph.size):
        total = 0.0
        for b in range(h.size):
            total += P[a, b] * h[b]
        ph[a] = total


@compiled_sums
def _update_covariance(P: Floats, gain: Floats, ph: Floats) -> None:
    """Subtract `gain ph^T` from P."""
    for a in range(gain.size):
        share = gain[a]
        for b in range(ph.size):
            P[a, b] = P[a, b] - share * ph[b]


@compiled_sums
def _sum_rows(values: Floats, width: int) -> None:
    """Multiply (state, any) values by F, in place: each block becomes its sum with all later ones."""
    for a in range(len(values) - width - 1, -1, -1):
        own, later = values[a], values[a + width]
        for b in range(own.size):
            own[b] += later[b]


@compiled_sums
def _sum_columns(values: Floats, width: int) -> None:
    """Multiply (any, state) values by F^T from the right, in place."""
    for a in range(len(values)):
        for start in range(values.shape[1] - 2 * width, -1, -width):
            own, later = values[a, start : start + width], values[a, start + width : start + 2 * width]
            for b in range(width):
                own[b] += later[b]


@compiled_sums
def filter_covariance(
    x: Floats,
    phase: Floats,
    orders: Floats,
    shaft: Indices,
    process: Floats,
    diffuse: bool,
    mean: Floats,
    P: Floats,
    V: Floats,
    outputs: tuple[int, int],
    innovations: Floats,
    scales: Floats,
    levels: Floats,
    variances: Floats,
) -> None:
    """Run the covariance filter over some samples.

    Of each sample `x = h . levels + noise` of variance 1: the innovation `x - h . mean`, its variance `s = 1 + h . (P +
    V V^T) h`, the gain `(P + V V^T) h / s`, the update of mean and covariance; then the prediction of the next one.

    Parameters
    ----------
    x : (sample, channel) array, NaN where missing, in all channels.
    phase : (shaft, sample) array in rad.
    orders, shaft : (order,) arrays, cycles per revolution and the shaft they count.
    process : (sample or 1, 2 order) array, variances of the increments after each sample.
    diffuse : whether V counts.
    mean : (channel, state) array, predicted for the first sample on entry, for the one after the last on return.
    P : (state, state) array, the covariance of the mean but for V V^T.
    V : (state, state) array, factor of what the prior leaves open.
    outputs : samples before the first of them, and from one to the next.
    innovations : (sample, channel) array, filled: over their standard deviations, 0 where missing.
    scales : (sample,) array, filled: variances of the innovations, 0 where missing.
    levels : (output, channel, 2 order) array, filled.
    variances : (output, order) array, filled: half the sums over two quadratures, of which the mean's second has none.
    """
    (samples, channels), (skip, every) = x.shape, outputs
    width, size = process.shape[1], mean.shape[1]
    cosine, sine, rows = np.empty(PIECE), np.empty(PIECE), np.empty((PIECE, width))
    ph, gain, seen = np.empty(size), np.empty(size), np.empty(size)
    output = 0
    for i in range(samples):
        at = i % PIECE
        if at == 0:
            _fill_regressors(phase, orders, shaft, i, cosine, sine, rows)
        h = rows[at]
        scales[i] = 0.0
        for channel in range(channels):
            innovations[i, channel] = 0.0
        if not np.isnan(x[i, 0]):
            _covariance_times(P, h, ph)
            known = 1.0 + _dot(h, ph[:width])
            share = 1.0 / known
            for a in range(size):
                gain[a] = share * ph[a]
            _update_covariance(P, gain, ph)
            variance = known
            if diffuse:
                variance = _update_diffuse(V, h, ph, known, seen, gain)
                share = 1.0 / variance
                for a in range(size):
                    gain[a] *= share
            scales[i] = variance
            for channel in range(channels):
                own = mean[channel]
                innovation = x[i, channel] - _dot(h, own[:width])
                innovations[i, channel] = innovation * np.sqrt(share)
                for a in range(size):
                    own[a] += gain[a] * innovation
        if i >= skip and (i - skip) % every == 0:
            for channel in range(channels):
                for b in range(width):
                    levels[output, channel, b] = mean[channel, b]
            for k in range(orders.size):
                total = P[2 * k, 2 * k] + P[2 * k + 1, 2 * k + 1]
                if diffuse:
                    total += _dot(V[2 * k], V[2 * k]) + _dot(V[2 * k + 1], V[2 * k + 1])
                variances[output, k] = 0.5 * total
            output += 1
        step = min(i, len(process) - 1)
        for b in range(width):
            P[size - width + b, size - width + b] += process[step, b]
        if size > width:
            _sum_rows(P, width)
            _sum_columns(P, width)
            _sum_columns(mean, width)
            if diffuse:
                _sum_rows(V, width)


@compiled_sums
def filter_steadily(
    x: Floats,
    phase: Floats,
    orders: Floats,
    shaft: Indices,
    gains: Floats,
    state: Floats,
    skip: int,
    every: int,
    innovations: Floats,
    levels: Floats,
) -> None:
    """Run the filter with fixed gains over some samples.

    Of each sample the innovation `e = x - h . level`, levels and differences `+= gain h e`, then F.

    Parameters
    ----------
    x : (sample, channel) array.
    phase, orders, shaft, skip, every : as for `filter_covariance`.
    gains : (pole, 2 order) array.
    state : (channel, pole, 2 order) array, predicted for the first sample on entry, for the one after the last on
        return.
    innovations : (sample, channel) array, filled.
    levels : (output, channel, 2 order) array, filled.
    """
    samples, channels = x.shape
    poles, width = gains.shape
    cosine, sine, rows = np.empty(PIECE), np.empty(PIECE), np.empty((PIECE, width))
    unwanted, output = np.empty(width), 0
    for first in range(0, samples, PIECE):
        _fill_regressors(phase, orders, shaft, first, cosine, sine, rows)
        for i in range(first, min(first + PIECE, samples)):
            h = rows[i - first]
            wanted = i >= skip and (i - skip) % every == 0
            for channel in range(channels):
                own = state[channel]
                kept = levels[output, channel] if wanted else unwanted
                innovation = x[i, channel] - _dot(h, own[0])
                innovations[i, channel] = innovation
                for b in range(width):
                    own[0, b] += gains[0, b] * innovation * h[b]
                    kept[b] = own[0, b]
                for j in range(1, poles):
                    for b in range(width):
                        own[j, b] += gains[j, b] * innovation * h[b]
                for j in range(poles - 2, -1, -1):
                    for b in range(width):
                        own[j, b] += own[j + 1, b]
            if wanted:
                output += 1
