"""Loops over samples of the causal filters: the covariance filter with a diffuse start, and fixed gains.

A state holds `poles` blocks of quadratures: the levels, their first backward differences, and so on; real and imaginary
parts of the orders alternate within a block. From sample to sample it becomes `F (state + increment)`: F an upper
triangle of ones, the increment in the highest differences alone. Both filters work with the state at the start of a
*stretch* of samples: k samples on, the transition is in the measurement row `h = (1, k, k (k + 1) / 2, ...) cos` and in
the increment, `F^-k` of it, and nothing else moves.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums
from signals.harmonics._phasors import fill_phasors

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
def _covariance_times(P: Floats, gain: Floats, ph: Floats, h: Floats, result: Floats) -> None:
    """Subtract `gain ph^T` from P, what the sample before has taken off it, and fill `P h` in the same pass."""
    for a in range(h.size):
        factor, total = gain[a], 0.0
        for b in range(h.size):
            value = P[a, b] - factor * ph[b]
            P[a, b] = value
            total += value * h[b]
        result[a] = total


@compiled_sums
def _settle(P: Floats, own: Floats, gain: Floats, ph: Floats, grown: Floats) -> None:
    """Subtract what the last sample has taken off P, and add the process noise since."""
    for a in range(gain.size):
        for b in range(gain.size):
            P[a, b] -= gain[a] * ph[b]
        gain[a] = 0.0
    for j in range(len(grown)):
        for m in range(len(grown)):
            for b in range(grown.shape[2]):
                own[j, m, b] += grown[j, m, b]
                grown[j, m, b] = 0.0


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
    size = h.size
    for d in range(size):
        seen[d] = 0.0
    for b in range(size):
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
def _advance(state: Floats, rise: Floats, width: int) -> None:
    """Multiply (state, any) values by a power of F, whose first row of blocks is `rise`, in place."""
    for block in range(rise.size):
        for later in range(1, rise.size - block):
            for a in range(block * width, (block + 1) * width):
                for b in range(state.shape[1]):
                    state[a, b] += rise[later] * state[a + later * width, b]


@compiled_sums
def filter_covariance(
    x: Floats,
    phase: Floats,
    orders: Floats,
    shaft: Indices,
    process: Floats,
    stretch: tuple[int, int],
    diffuse: bool,
    mean: Floats,
    P: Floats,
    own: Floats,
    V: Floats,
    outputs: tuple[int, int],
    innovations: Floats,
    scales: Floats,
    levels: Floats,
    variances: Floats,
) -> None:
    """Run the covariance filter over some samples.

    Of each sample `x = h . state + noise` of variance 1: the innovation `x - h . mean`, its variance `s = 1 + h . (P +
    V V^T) h`, the gain `(P + V V^T) h / s`, the update of mean and covariance; then the process noise.

    Parameters
    ----------
    x : (sample, channel) array, NaN where missing, in all channels.
    phase : (shaft, sample) array in rad.
    orders, shaft : (order,) arrays, cycles per revolution and the shaft they count.
    process : (sample or 1, 2 order) array, variances of the increments after each sample.
    stretch : samples since the start of a stretch, and in one.
    diffuse : whether V counts.
    mean : (channel, state) array, predicted for the first sample on entry, for the one after the last on return.
    P : (state, state) array, the covariance of the mean but for V V^T.
    own : (pole, pole, 2 order) view of P: the covariances of levels and differences of each quadrature.
    V : (state, state) array, factor of what the prior leaves open.
    outputs : samples before the first of them, and from one to the next.
    innovations : (sample, channel) array, filled: over their standard deviations, 0 where missing.
    scales : (sample,) array, filled: variances of the innovations, 0 where missing.
    levels : (output, channel, 2 order) array, filled.
    variances : (output, order) array, filled: half the sums over two quadratures, of which the mean's second has none.
    """
    samples, channels = x.shape
    (place, longest), (skip, every) = stretch, outputs
    width = process.shape[1]
    size = mean.shape[1]
    poles = size // width
    cosine, sine, rows = np.empty(PIECE), np.empty(PIECE), np.empty((PIECE, width))
    h, ph, gain = np.empty(size), np.zeros(size), np.zeros(size)
    product, seen = np.empty(size), np.empty(size)
    rise, fall, grown = np.ones(poles), np.ones(poles), np.zeros((poles, poles, width))
    output, at = 0, PIECE
    for i in range(samples):
        if at == PIECE:
            at = 0
            _fill_regressors(phase, orders, shaft, i, cosine, sine, rows)
        for j in range(1, poles):  # of F^k, and of F^-k
            rise[j] = rise[j - 1] * (place + j - 1) / j
            fall[j] = -fall[j - 1] * (place - j + 1) / j
        scales[i] = 0.0
        for channel in range(channels):
            innovations[i, channel] = 0.0
        if not np.isnan(x[i, 0]):
            for j in range(poles):
                for b in range(width):
                    h[j * width + b] = rise[j] * rows[at, b]
            _covariance_times(P, gain, ph, h, product)
            for j in range(poles):
                for m in range(poles):
                    for b in range(width):
                        product[j * width + b] += grown[j, m, b] * h[m * width + b]
            variance = 1.0 + _dot(h, product)
            share = 1.0 / variance
            for b in range(size):
                ph[b] = product[b]
                gain[b] = share * product[b]
            if diffuse:
                variance = _update_diffuse(V, h, ph, variance, seen, product)
                share = 1.0 / variance
            scales[i] = variance
            for channel in range(channels):
                own_mean = mean[channel]
                innovation = x[i, channel] - _dot(h, own_mean)
                innovations[i, channel] = innovation * np.sqrt(share)
                innovation *= share
                for b in range(size):
                    own_mean[b] += product[b] * innovation
        if i >= skip and (i - skip) % every == 0:
            spread = variances[output]
            for k in range(orders.size):
                spread[k] = 0.5 * (own[0, 0, 2 * k] + grown[0, 0, 2 * k] - gain[2 * k] * ph[2 * k])
                b = 2 * k + 1
                spread[k] += 0.5 * (own[0, 0, b] + grown[0, 0, b] - gain[b] * ph[b])
            for channel in range(channels):
                for b in range(width):
                    levels[output, channel, b] = mean[channel, b]
            if poles > 1:
                for channel in range(channels):
                    for j in range(1, poles):
                        for b in range(width):
                            levels[output, channel, b] += rise[j] * mean[channel, j * width + b]
                for j in range(poles):
                    for m in range(poles):
                        if j + m > 0:
                            share = 0.5 * rise[j] * rise[m]
                            for b in range(width):
                                taken = gain[j * width + b] * ph[m * width + b]
                                spread[b // 2] += share * (own[j, m, b] + grown[j, m, b] - taken)
            if diffuse:
                for b in range(width):
                    for d in range(size):
                        total = V[b, d]
                        for j in range(1, poles):
                            total += rise[j] * V[j * width + b, d]
                        spread[b // 2] += 0.5 * total * total
            output += 1
        step = min(i, len(process) - 1)
        for j in range(poles):
            for m in range(poles):
                share = fall[poles - 1 - j] * fall[poles - 1 - m]
                for b in range(width):
                    grown[j, m, b] += share * process[step, b]
        at += 1
        place += 1
        if place == longest:
            place = 0
            if poles > 1:
                _settle(P, own, gain, ph, grown)
                for j in range(1, poles):
                    rise[j] = rise[j - 1] * (longest + j - 1) / j
                _advance(P, rise, width)
                _advance(P.T, rise, width)
                _advance(V, rise, width)
                _advance(mean.T, rise, width)
    _settle(P, own, gain, ph, grown)


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
