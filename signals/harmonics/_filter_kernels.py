"""Loops over samples of the causal filter, with the gains of its covariance or of the steady state.

A state holds `poles` blocks of quadratures: the levels, their first backward differences, and so on. From sample to
sample it becomes `F (state + increment)`: F an upper triangle of ones, the increment, of variance Q, in the highest
differences alone.
"""

import numpy as np

from signals._compile import compiled_sums_in_place
from signals.harmonics._block_kernels import Complexes, Floats, Indices


@compiled_sums_in_place
def dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled_sums_in_place
def _update_diffuse(V: Floats, h: Floats, ph: Floats, known: float, a: Floats) -> float:
    """Update the factor V of the diffuse covariance; return the variance of the innovation.

    With `a = V^T h`, the P h of before P was updated and `known` the innovation's variance without V, the whole
    variance is `s = known + a . a` and V becomes `V (I - a a^T / (known r (r + 1))) - P h a^T / (known r)`, r^2 = s /
    known: Potter's update [1]_ beside that of P, without differences of large variances. `ph` becomes `(P + V V^T) h`.

    References
    ----------
    .. [1] J. E. Potter, R. G. Stern, "Statistical filtering of space navigation measurements", AIAA Guidance and
       Control Conference, 1963.
    """
    a[:] = 0.0
    for b in range(h.size):
        for d in range(a.size):
            a[d] += h[b] * V[b, d]
    s = known + dot(a, a)
    r = np.sqrt(s / known)
    for b in range(a.size):
        va = dot(V[b], a)
        factor = (va / (r + 1.0) + ph[b]) / (known * r)
        for d in range(a.size):
            V[b, d] -= factor * a[d]
        ph[b] += va
    return s


@compiled_sums_in_place
def project(P: Floats, h: Floats, ph: Floats) -> float:
    """Fill `ph` with P h; return the innovation's variance, s = 1 + h . P h."""
    for a in range(ph.size):
        ph[a] = 0.0
    for b in range(h.size):
        row, share = P[b], h[b]
        for a in range(ph.size):
            ph[a] += share * row[a]
    return 1.0 + dot(h, ph[: h.size])


@compiled_sums_in_place
def update_covariance(P: Floats, ph: Floats, precision: float) -> None:
    """Update the covariance: P - (P h) (P h)^T / s, given 1 / s."""
    for a in range(ph.size):
        row, share = P[a], precision * ph[a]
        for b in range(row.size):
            row[b] -= share * ph[b]


@compiled_sums_in_place
def update_mean(mean: Floats, h: Floats, x: float, gain: Floats) -> float:
    """Update the mean, mean + K e; return the innovation e = x - h . mean."""
    e = x - dot(h, mean[: h.size])
    for a in range(gain.size):
        mean[a] += gain[a] * e
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
    for a in range(len(values)):
        for start in range(values.shape[1] - 2 * width, -1, -width):
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
def _variance(P: Floats, V: Floats, diffuse: bool, a: int) -> float:
    known: float = P[a, a]
    return known + dot(V[a], V[a]) if diffuse else known


@compiled_sums_in_place
def filter_samples(
    x: Floats, regressors: Floats, process: Floats, mean: Floats, P: Floats, V: Floats, diffuse: bool,
    shares: Floats, steady: float, outputs: tuple[int, int], nonzero: Indices, innovations: Floats,
    amplitudes: Complexes, variances: Floats, work: Floats,
) -> None:  # fmt: skip
    """Filter some samples, with measurements `x = h . levels + noise` of variance 1.

    Given are (channel, sample) x, NaN where missing in all channels; (column, sample) h; (sample or 1, column)
    variances of the increments after each sample; whether V is not zero; the samples before the first output, and from
    one to the next. The (channel, state) mean and its covariance P + V V^T, predicted for the first sample, become
    those for the one after the last. With the variance `steady` of innovations in the steady state, else 0, the gains
    are the (state,) shares times h, and the covariance stays. Filled are (channel, sample) innovations over their
    standard deviations, left zero where missing, (output, channel, order) amplitudes, those `nonzero` complex, and, but
    for steady gains, (output, order) variances, means over the quadratures. `work` is (3, state) scratch.
    """
    (channels, samples), (skip, every) = x.shape, outputs
    width, size, output = len(regressors), mean.shape[1], 0
    gain, h, projection, scale = work[0], work[1, :width], work[2], 1.0 / np.sqrt(steady)
    for i in range(samples):
        if not np.isnan(x[0, i]):
            for b in range(width):
                h[b] = regressors[b, i]
            if steady > 0.0:  # the gain K of the steady state
                for start in range(0, size, width):
                    for b in range(width):
                        gain[start + b] = shares[start + b] * h[b]
            else:
                s = project(P, h, gain)
                update_covariance(P, gain, 1.0 / s)
                if diffuse:
                    s = _update_diffuse(V, h, gain, s, projection)
                for a in range(size):  # K = (P + V V^T) h / s
                    gain[a] /= s
                scale = 1.0 / np.sqrt(s)
            for channel in range(channels):  # update with the innovation
                innovations[channel, i] = update_mean(mean[channel], h, x[channel, i], gain) * scale
        if i >= skip and (i - skip) % every == 0:
            orders = amplitudes.shape[2]
            for channel in range(channels):
                for k in range(orders):
                    amplitudes[output, channel, k] = mean[channel, k]
                for m in range(nonzero.size):
                    amplitudes[output, channel, nonzero[m]] += 1j * mean[channel, orders + m]
            if steady == 0.0:
                for k in range(orders):
                    variances[output, k] = _variance(P, V, diffuse, k)
                for m in range(nonzero.size):
                    k, other = nonzero[m], _variance(P, V, diffuse, orders + m)
                    variances[output, k] = 0.5 * (variances[output, k] + other)
            output += 1
        _transition_columns(mean, width)  # predict
        if steady == 0.0:
            _predict_covariance(P, process[min(i, len(process) - 1)])
            if diffuse:
                _transition_rows(V, width)
