"""Loops over samples of the causal filters: the covariance filter with a diffuse prior, and steady-state gains.

A state holds `poles` blocks of quadratures: the levels, their first backward differences, and so on; real and imaginary
parts of the orders alternate within a block. From sample to sample it becomes `F (state + increment)`: F an upper
triangle of ones, the increment, of variance Q, in the highest differences alone.
"""

import numpy as np

from signals._compile import compiled_sums_in_place
from signals.harmonics._block_kernels import fill_phasors
from signals.harmonics.state_space import Floats, Indices

PIECE = 128  # samples whose phasors are made at a time: they stay in the nearest cache


@compiled_sums_in_place
def _fill_regressors(
    phase: Floats, orders: Floats, shaft: Indices, first: int, cosine: Floats, sine: Floats, rows: Floats
) -> None:
    """Fill (sample, 2 order) rows H with cos and -sin of each order in turn, from sample `first` on."""
    last = min(first + len(rows), phase.shape[1])
    for k in range(orders.size):
        fill_phasors(orders[k], phase[shaft[k], first:last], cosine, sine)
        for i in range(last - first):
            rows[i, 2 * k] = cosine[i]
            rows[i, 2 * k + 1] = -sine[i]


@compiled_sums_in_place
def dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled_sums_in_place
def _update_diffuse(V: Floats, h: Floats, ph: Floats, known: float, a: Floats, covariance: Floats) -> float:
    """Update the factor V of the diffuse covariance; return the variance of the innovation.

    With `a = V^T h` and `known` the innovation's variance without V, the whole variance is `s = known + a . a` and V
    becomes `V (I - a a^T / (known r (r + 1))) - P h a^T / (known r)`, r^2 = s / known: Potter's update [1]_ beside that
    of P, without differences of large variances. `covariance` is filled with `(P + V V^T) h`.

    References
    ----------
    .. [1] J. E. Potter, R. G. Stern, "Statistical filtering of space navigation measurements", AIAA Guidance and
       Control Conference, 1963.
    """
    size = a.size
    for d in range(size):
        a[d] = 0.0
    for b in range(h.size):
        for d in range(size):
            a[d] += h[b] * V[b, d]
    variance = known + dot(a, a)
    root = np.sqrt(variance / known)
    for b in range(size):
        va = 0.0
        for d in range(size):
            va += V[b, d] * a[d]
        covariance[b] = ph[b] + va
        factor = (va / (root + 1.0) + ph[b]) / (known * root)
        for d in range(size):
            V[b, d] -= factor * a[d]
    return variance


@compiled_sums_in_place
def project(P: Floats, h: Floats, ph: Floats) -> float:
    """Fill `ph` with P h; return the innovation's variance, s = 1 + h . P h."""
    ph[:] = 0.0
    for b in range(0, h.size, 2):  # the rows of both parts of an order: half as many passes over P h
        row, other = P[b], P[b + 1]
        for a in range(ph.size):
            ph[a] += h[b] * row[a] + h[b + 1] * other[a]
    return 1.0 + dot(h, ph[: h.size])


@compiled_sums_in_place
def update_covariance(P: Floats, ph: Floats, precision: float) -> None:
    """Update the covariance: P - (P h) (P h)^T / s, given 1 / s."""
    for a in range(ph.size):
        row, share = P[a], precision * ph[a]
        for b in range(row.size):
            row[b] -= share * ph[b]


@compiled_sums_in_place
def update_mean(mean: Floats, h: Floats, x: float, ph: Floats, precision: float) -> float:
    """Update the mean with the gain K = P h / s, given 1 / s: mean + K e; return the innovation e = x - h . mean."""
    e = x - dot(h, mean[: h.size])
    scaled = precision * e
    for a in range(ph.size):
        mean[a] += scaled * ph[a]
    return e


@compiled_sums_in_place
def _transition_rows(values: Floats, width: int) -> None:
    """Predict (state, any) values: F values, in which each block becomes its sum with all later ones."""
    for a in range(len(values) - width - 1, -1, -1):
        own, later = values[a], values[a + width]
        for b in range(own.size):
            own[b] += later[b]


@compiled_sums_in_place
def _transition_columns(values: Floats, width: int) -> None:
    """Predict (any, state) values: values F^T."""
    for start in range(values.shape[1] - 2 * width, -1, -width):
        for a in range(len(values)):
            own, later = values[a, start : start + width], values[a, start + width : start + 2 * width]
            for b in range(width):
                own[b] += later[b]


@compiled_sums_in_place
def _predict_covariance(P: Floats, q: Floats) -> None:
    """Predict the covariance: F (P + Q) F^T, with Q in the highest differences alone."""
    first = len(P) - q.size
    for b in range(q.size):
        P[first + b, first + b] += q[b]
    _transition_rows(P, q.size)
    _transition_columns(P, q.size)


@compiled_sums_in_place
def filter_covariance(
    x: Floats, phase: Floats, orders: Floats, shaft: Indices, process: Floats, mean: Floats, P: Floats,
    outputs: tuple[int, int], innovations: Floats, levels: Floats, variances: Floats, V: Floats, diffuse: bool,
    work: Floats, rows: Floats,
) -> None:  # fmt: skip
    """Run the covariance filter over some samples, with measurements `x = h . levels + noise` of variance 1.

    Given are (sample, channel) x, NaN where missing in all channels; (shaft, sample) angles, orders and the shaft of
    each; (sample or 1, 2 order) variances of the increments after each sample; the samples before the first output, and
    from one to the next; whether V is not zero; scratch of (5, PIECE or state) and (PIECE, 2 order). The
    (channel, state) mean and its covariance P + V V^T, predicted for the first sample, become those for the one after
    the last. Filled are (sample, channel) innovations over their standard deviations, left zero where missing, and of
    the first orders (output, channel, 2 order) levels and (output, order) variances: half the sums over both
    quadratures, of which the mean's second is 0.
    """
    (samples, channels), (skip, every) = x.shape, outputs
    width, size = process.shape[1], mean.shape[1]
    ph, whole, projection = work[2, :size], work[3, :size], work[4, :size]
    output = 0
    for i in range(samples):
        if i % PIECE == 0:
            _fill_regressors(phase, orders, shaft, i, work[0], work[1], rows)
        h = rows[i % PIECE]
        if not np.isnan(x[i, 0]):
            s = known = project(P, h, ph)
            update_covariance(P, ph, 1.0 / known)
            projected = ph
            if diffuse:  # of P + V V^T
                s, projected = _update_diffuse(V, h, ph, known, projection, whole), whole
            precision = 1.0 / s
            for channel in range(channels):
                e = update_mean(mean[channel], h, x[i, channel], projected, precision)
                innovations[i, channel] = e * np.sqrt(precision)
        if i >= skip and (i - skip) % every == 0:
            for channel in range(channels):
                for b in range(levels.shape[2]):
                    levels[output, channel, b] = mean[channel, b]
            for k in range(variances.shape[1]):
                total = P[2 * k, 2 * k] + P[2 * k + 1, 2 * k + 1]
                if diffuse:
                    total += dot(V[2 * k], V[2 * k]) + dot(V[2 * k + 1], V[2 * k + 1])
                variances[output, k] = 0.5 * total
            output += 1
        _predict_covariance(P, process[min(i, len(process) - 1)])
        _transition_columns(mean, width)
        if diffuse:
            _transition_rows(V, width)


@compiled_sums_in_place
def filter_steadily(
    x: Floats, phase: Floats, orders: Floats, shaft: Indices, gains: Floats, state: Floats, skip: int, every: int,
    work: Floats, rows: Floats, innovations: Floats, levels: Floats,
) -> None:  # fmt: skip
    """Run the filter with steady-state gains over some samples.

    The (pole, 2 order) gains times h are the Kalman gains; the (channel, pole, 2 order) state is the mean of
    `filter_covariance`, as the other arguments are its, with scratch `work`, (2, PIECE), and `rows`, (PIECE, 2 order).
    """
    samples, channels = x.shape
    poles, width = gains.shape
    output = 0
    for i in range(samples):
        if i % PIECE == 0:
            _fill_regressors(phase, orders, shaft, i, work[0], work[1], rows)
        h, due = rows[i % PIECE], i == skip + output * every
        for channel in range(channels):
            own = state[channel]
            # Innovation e = x - h . level; update each difference by its gain h e.
            innovation = x[i, channel] - dot(h, own[0])
            innovations[i, channel] = innovation
            for j in range(poles):
                for b in range(width):
                    own[j, b] += gains[j, b] * innovation * h[b]
            if due:
                for b in range(levels.shape[2]):
                    levels[output, channel, b] = own[0, b]
            for j in range(poles - 2, -1, -1):  # predict by F
                for b in range(width):
                    own[j, b] += own[j + 1, b]
        output += due
