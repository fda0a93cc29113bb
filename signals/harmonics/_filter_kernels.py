"""Loops over samples of the causal filters: the covariance filter with a diffuse prior, and steady-state gains.

A state holds `poles` blocks of quadratures: the levels, their first backward differences, and so on; real and imaginary
parts of the orders alternate within a block. From sample to sample it becomes `F (state + increment)`: F an upper
triangle of ones, the increment, of variance Q, in the highest differences alone.
"""

from math import ceil, prod

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_in_place, compiled_sums_in_place
from signals.harmonics._block_kernels import fill_phasors

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECE = 128  # samples whose phasors are made at a time: they stay in the nearest cache
PAIRS_PIECE = 64  # the same beside P and what a pair of samples needs
LOOK_AHEAD = 4  # samples whose innovations are found together
# Numbers in a row of a tile, two vector registers of 64 bytes: so many, and known to the compiler, loops over them have
# no remainder and need no comparison of addresses.
LANES = 16
# Where the rows of a group of LANES quadratures begin: P h of the samples of the former pair, given the samples before
# each; the same of the next pair, as far as found; variance that increments added and tiles lack; the increments after
# either sample; variances before the pair and after each of its samples.
FORMER, FORMER_SECOND, NEXT, NEXT_SECOND, ADDED, INCREMENT, INCREMENT_SECOND, VARIANCE, AFTER, AFTER_SECOND = range(
    0, 10 * LANES, LANES
)


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
def _dot(a: Floats, b: Floats) -> float:
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
    variance = known + _dot(a, a)
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
def _transition_rows(values: Floats, width: int) -> None:
    """Replace (state, any) values by `F values`: each block becomes its sum with all later ones."""
    for a in range(len(values) - width - 1, -1, -1):
        own, later = values[a], values[a + width]
        for b in range(own.size):
            own[b] += later[b]


@compiled_sums_in_place
def _transition_columns(values: Floats, width: int) -> None:
    """Replace (any, state) values by `values F^T`."""
    for a in range(len(values)):
        for start in range(values.shape[1] - 2 * width, -1, -width):
            own, later = values[a, start : start + width], values[a, start + width : start + 2 * width]
            for b in range(width):
                own[b] += later[b]


@compiled_sums_in_place
def filter_covariance(
    x: Floats, phase: Floats, orders: Floats, shaft: Indices, process: Floats, mean: Floats, P: Floats,
    outputs: tuple[int, int], innovations: Floats, innovation_variances: Floats, levels: Floats, variances: Floats,
    V: Floats, diffuse: bool, work: Floats, rows: Floats,
) -> None:  # fmt: skip
    """Run the covariance filter over some samples, with measurements `x = h . levels + noise` of variance 1.

    Given are (sample, channel) x, NaN where missing in all channels; (shaft, sample) angles, orders and the shaft of
    each; (sample or 1, 2 order) variances of the increments after each sample; the samples before the first output, and
    from one to the next; whether V is not zero; scratch of (5, PIECE or state) and (PIECE, 2 order). The
    (channel, state) mean and its covariance P + V V^T, predicted for the first sample, become those for the one after
    the last. Filled are (sample, channel) innovations over their standard deviations, their (sample,) variances, both
    left zero where missing, (output, channel, 2 order) levels, and (output, order) variances: half the sums over both
    quadratures, of which the mean's second is 0.
    """
    (samples, channels), (skip, every) = x.shape, outputs
    width, size = process.shape[1], mean.shape[1]
    ph, gain, projection = work[2, :size], work[3, :size], work[4, :size]
    output = 0
    for i in range(samples):
        at = i % PIECE
        if at == 0:
            _fill_regressors(phase, orders, shaft, i, work[0], work[1], rows)
        h = rows[at]
        if not np.isnan(x[i, 0]):
            # Gain K = P h / s with s = 1 + h . P h; update P - K (P h)^T.
            for a in range(0, size, 2):  # the quadratures of an order share what is read of h
                first, second = 0.0, 0.0
                for b in range(width):
                    first += P[a, b] * h[b]
                    second += P[a + 1, b] * h[b]
                ph[a], ph[a + 1] = first, second
            known = 1.0 + _dot(h, ph[:width])
            precision = 1.0 / known
            for a in range(size):
                share = precision * ph[a]
                gain[a] = share
                for b in range(size):
                    P[a, b] -= share * ph[b]
            variance = known
            if diffuse:  # gain K = (P + V V^T) h / s with s = 1 + h . (P + V V^T) h
                variance = _update_diffuse(V, h, ph, known, projection, gain)
                precision = 1.0 / variance
                for a in range(size):
                    gain[a] *= precision
            innovation_variances[i] = variance
            for channel in range(channels):
                # Innovation e = x - h . mean; update mean + K e.
                own = mean[channel]
                innovation = x[i, channel] - _dot(h, own[:width])
                innovations[i, channel] = innovation * np.sqrt(precision)
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
        # Predict F mean, F (P + Q) F^T, F V.
        step = min(i, len(process) - 1)
        for b in range(width):
            P[size - width + b, size - width + b] += process[step, b]
        _transition_rows(P, width)
        _transition_columns(P, width)
        _transition_columns(mean, width)
        if diffuse:
            _transition_rows(V, width)


@compiled_in_place
def _update_and_multiply(P: Floats, groups: Floats, gain: Floats, second: Floats, rows: Floats, n: int) -> None:
    """Subtract from P what the former pair of samples adds to the knowledge of the state; add `P h` of the next pair.

    Each element of P is read and written once for all four products. P is a (row / 4, group, 4 LANES) array; without
    sums in any order those of four rows do not wait for what the rows before added.
    """
    for q in range(len(P)):
        b = 4 * q
        f0, f1, f2, f3 = gain[b], gain[b + 1], gain[b + 2], gain[b + 3]
        s0, s1, s2, s3 = second[b], second[b + 1], second[b + 2], second[b + 3]
        h0, h1, h2, h3 = rows[n, b], rows[n, b + 1], rows[n, b + 2], rows[n, b + 3]
        k0, k1, k2, k3 = rows[n + 1, b], rows[n + 1, b + 1], rows[n + 1, b + 2], rows[n + 1, b + 3]
        for g in range(len(groups)):
            for c in range(LANES):
                u, v = groups[g, FORMER + c], groups[g, FORMER_SECOND + c]
                p0 = P[q, g, c] - f0 * u - s0 * v
                p1 = P[q, g, LANES + c] - f1 * u - s1 * v
                p2 = P[q, g, 2 * LANES + c] - f2 * u - s2 * v
                p3 = P[q, g, 3 * LANES + c] - f3 * u - s3 * v
                P[q, g, c], P[q, g, LANES + c], P[q, g, 2 * LANES + c], P[q, g, 3 * LANES + c] = p0, p1, p2, p3
                groups[g, NEXT + c] += (h0 * p0 + h1 * p1) + (h2 * p2 + h3 * p3)
                groups[g, NEXT_SECOND + c] += (k0 * p0 + k1 * p1) + (k2 * p2 + k3 * p3)


@compiled_sums_in_place
def _covariance_of_pair(groups: Floats, rows: Floats, n: int) -> tuple[float, float, float]:
    """Complete P h of a pair of samples; return the elements of the covariance of their innovations."""
    own, shared, second = 1.0, 0.0, 1.0
    for g in range(len(groups)):
        for c in range(LANES):
            h, k = rows[n, LANES * g + c], rows[n + 1, LANES * g + c]
            before = groups[g, ADDED + c] + groups[g, INCREMENT + c]
            ph = groups[g, NEXT + c] + groups[g, ADDED + c] * h
            pk = groups[g, NEXT_SECOND + c] + before * k
            own += h * ph
            shared += k * ph
            second += k * pk
            groups[g, FORMER + c], groups[g, FORMER_SECOND + c] = ph, pk
            groups[g, ADDED + c] = before + groups[g, INCREMENT_SECOND + c]
    return own, shared, second


@compiled_in_place
def _eliminate(groups: Floats, share: float, one: float, two: float, gain: Floats, second: Floats) -> None:
    """Condition the second sample of a pair on the first; fill the gains of both, and the variances after each.

    `one` and `two` are one over the variances of the innovations, 0 where a sample is missing.
    """
    for g in range(len(groups)):
        for c in range(LANES):
            ph = groups[g, FORMER + c]
            pk = groups[g, FORMER_SECOND + c] - share * ph
            first, last = one * ph, two * pk
            after = groups[g, VARIANCE + c] - first * ph
            then = after + groups[g, INCREMENT + c] - last * pk
            groups[g, FORMER_SECOND + c] = pk
            groups[g, NEXT + c], groups[g, NEXT_SECOND + c] = 0.0, 0.0
            groups[g, AFTER + c], groups[g, AFTER_SECOND + c] = after, then
            groups[g, VARIANCE + c] = then + groups[g, INCREMENT_SECOND + c]
            gain[LANES * g + c], second[LANES * g + c] = first, last


@compiled_in_place
def _store(means: Floats, groups: Floats, late: int, levels: Floats, variances: Floats, output: int) -> None:
    """Fill an output after the first or the second sample of a pair: variances are half the sums over quadratures."""
    for channel in range(len(means)):
        for c in range(levels.shape[2]):
            levels[output, channel, c] = means[channel, c]
    for order in range(variances.shape[1]):
        g, c = 2 * order // LANES, AFTER + LANES * late + 2 * order % LANES
        variances[output, order] = 0.5 * (groups[g, c] + groups[g, c + 1])


def _aligned(*shape: int) -> Floats:
    """Return zeros that begin at a cache line."""
    spare = np.zeros(prod(shape) + LANES)
    first = -(spare.ctypes.data // 8) % 8
    return spare[first : first + prod(shape)].reshape(shape)


def filter_pairs(
    x: Floats, phase: Floats, orders: Floats, shaft: Indices, process: Floats, mean: Floats, P: Floats,
    outputs: tuple[int, int], innovations: Floats, innovation_variances: Floats, levels: Floats, variances: Floats,
) -> None:  # fmt: skip
    """Run the covariance filter with one pole and no diffuse part as `filter_covariance` does, by pairs of samples.

    The innovations of a pair have the covariance `S = [h k]^T P [h k] + I`, with what increments add in between, and
    its second one is made independent of the first: the update of P is the sum of those of both samples.
    """
    channels, size = mean.shape
    count, quads = ceil(size / LANES), ceil(size / 4)
    columns = count * LANES
    tiles, groups, means = _aligned(quads, count, 4 * LANES), _aligned(count, 10 * LANES), _aligned(channels, columns)
    padded = np.zeros((4 * quads, columns))
    padded[:size, :size] = P
    tiled = tiles.reshape(quads, count, 4, LANES).transpose(0, 2, 1, 3)
    tiled[:] = padded.reshape(quads, 4, count, LANES)
    groups[:, VARIANCE : VARIANCE + LANES].flat[:size] = P.diagonal()
    means[:, :size] = mean
    rows, gains, between = _aligned(PAIRS_PIECE, columns), _aligned(2, columns), _aligned(channels, columns)
    _filter_tiles(
        x, phase, orders, shaft, process, outputs, (np.empty(PAIRS_PIECE), np.empty(PAIRS_PIECE)), rows, tiles, groups,
        (means, between), (gains[0], gains[1]), innovations, innovation_variances, levels, variances,
    )  # fmt: skip
    former, second, added = (
        groups[:, row : row + LANES].reshape(-1)[:size] for row in (FORMER, FORMER_SECOND, ADDED)
    )  # of the last pair, which tiles lack
    P[:] = tiled.reshape(4 * quads, columns)[:size, :size]
    P -= np.outer(gains[0, :size], former) + np.outer(gains[1, :size], second) - np.diag(added)
    mean[:] = means[:, :size]


@compiled_sums_in_place
def _filter_tiles(
    x: Floats, phase: Floats, orders: Floats, shaft: Indices, process: Floats, outputs: tuple[int, int],
    work: tuple[Floats, Floats], rows: Floats, P: Floats, groups: Floats, both_means: tuple[Floats, Floats],
    gains: tuple[Floats, Floats], innovations: Floats, innovation_variances: Floats, levels: Floats, variances: Floats,
) -> None:  # fmt: skip
    """Run the filter over pairs of samples: `filter_pairs` with its arrays in tiles.

    `work` is scratch; the means are those before a pair and after its first sample; each sample has its gain.
    """
    (samples, channels), (due, every), size = x.shape, outputs, 2 * orders.size
    (cosine, sine), (means, between), (gain, second_gain) = work, both_means, gains
    output = 0
    for i in range(0, samples, 2):
        n, both = i % len(rows), i + 1 < samples
        if n == 0:
            _fill_regressors(phase, orders, shaft, i, cosine, sine, rows)
            for b in range(size):  # P gets what increments added, before that is large beside it
                g, c = b // LANES, b % LANES
                P[b // 4, g, b % 4 * LANES + c] += groups[g, ADDED + c]
                groups[g, ADDED + c] = 0.0
        if i == 0 or len(process) > 1 or not both:
            for b in range(size):
                g, c = b // LANES, b % LANES
                groups[g, INCREMENT + c] = process[min(i, len(process) - 1), b]
                groups[g, INCREMENT_SECOND + c] = process[min(i + 1, len(process) - 1), b] if both else 0.0
        _update_and_multiply(P, groups, gain, second_gain, rows, n)
        variance, shared, second_variance = _covariance_of_pair(groups, rows, n)
        seen, second_seen = not np.isnan(x[i, 0]), both and not np.isnan(x[i + both, 0])
        precision = 1.0 / variance if seen else 0.0
        share = shared * precision
        second_variance -= share * shared
        second_precision = 1.0 / second_variance if second_seen else 0.0
        _eliminate(groups, share, precision, second_precision, gain, second_gain)
        for channel in range(channels):
            innovation, second = 0.0, 0.0  # e = x - h . mean
            if seen:
                innovation = x[i, channel] - _dot(means[channel], rows[n])
            if second_seen:
                second = x[i + 1, channel] - _dot(means[channel], rows[n + 1]) - share * innovation
            for c in range(gain.size):
                between[channel, c] = means[channel, c] + gain[c] * innovation
                means[channel, c] = between[channel, c] + second_gain[c] * second
            innovations[i, channel] = innovation * np.sqrt(precision)
            if both:
                innovations[i + 1, channel] = second * np.sqrt(second_precision)
        if seen:
            innovation_variances[i] = variance
        if second_seen:
            innovation_variances[i + 1] = second_variance
        for late in range(1 + both):
            if due == i + late:
                _store(means if late else between, groups, late, levels, variances, output)
                output += 1
                due += every


@compiled_sums_in_place
def _turn(regressors: Floats, cosine: Floats, sine: Floats) -> None:
    """Turn regressors, cos and -sin in turn, by the angles whose phasors are given."""
    for i in range(cosine.size):
        one, other = regressors[2 * i], regressors[2 * i + 1]
        regressors[2 * i] = one * cosine[i] + other * sine[i]
        regressors[2 * i + 1] = other * cosine[i] - one * sine[i]


@compiled_sums_in_place
def on_line(phase: Floats, step: float, most: float) -> bool:
    """Return whether no angle is further than `most` from one that grows steadily from the first."""
    for i in range(phase.size):  # noqa: SIM110 - numba compiles no generators
        if not abs(phase[i] - (phase[0] + step * i)) <= most:
            return False
    return True


@compiled_sums_in_place
def _filter_ahead(
    x: Floats, first: int, rows: Floats, gains: Floats, ahead: Floats, state: Floats, skip: int, every: int,
    innovations: Floats, levels: Floats, unused: Floats,
) -> int:  # fmt: skip
    """Run the filter with one pole over the piece from sample `first` on; return the first sample left over.

    The products of `LOOK_AHEAD` regressors with the levels before the first of them do not wait for one another.
    `ahead` is what an innovation adds to the prediction so many samples on; the others as for `filter_steadily`.
    """
    width, samples = gains.shape[1], min(first + len(rows), len(x)) - first
    samples -= samples % LOOK_AHEAD
    output = -((skip - first) // every)
    for begin in range(0, samples, LOOK_AHEAD):
        h0, h1, h2, h3 = rows[begin], rows[begin + 1], rows[begin + 2], rows[begin + 3]
        at = first + begin
        for channel in range(len(state)):
            own = state[channel, 0]
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for i in range(width):
                a += h0[i] * own[i]
                b += h1[i] * own[i]
                c += h2[i] * own[i]
                d += h3[i] * own[i]
            e0 = x[at, channel] - a
            e1 = x[at + 1, channel] - b - ahead[1] * e0
            e2 = x[at + 2, channel] - c - ahead[2] * e0 - ahead[1] * e1
            e3 = x[at + 3, channel] - d - ahead[3] * e0 - ahead[2] * e1 - ahead[1] * e2
            innovations[at, channel], innovations[at + 1, channel] = e0, e1
            innovations[at + 2, channel], innovations[at + 3, channel] = e2, e3
        for n in range(begin, begin + LOOK_AHEAD):
            h, due = rows[n], first + n == skip + output * every
            for channel in range(len(state)):
                own, innovation = state[channel, 0], innovations[first + n, channel]
                level = levels[output, channel] if due else unused
                for i in range(width):
                    own[i] += gains[0, i] * innovation * h[i]
                    level[i] = own[i]
            output += due
    return first + samples


@compiled_sums_in_place
def filter_steadily(
    x: Floats, phase: Floats, orders: Floats, shaft: Indices, turn: Floats, ahead: Floats, gains: Floats, state: Floats,
    skip: int, every: int, work: Floats, rows: Floats, innovations: Floats, levels: Floats,
) -> None:  # fmt: skip
    """Run the filter with steady-state gains over some samples.

    Where the only shaft turns steadily, each piece has the regressors of the last one, turned by one angle.
    With one pole an innovation e then adds `e sum_k g_k cos(m order_k step)` to the prediction m samples on, and
    `_filter_ahead` finds `LOOK_AHEAD` innovations at a time.

    `turn` holds cos and sin of what each order turns in a piece, for all of its samples: of shape (2, 0) where the
    shaft turns unsteadily. `ahead` holds these sums, none with more poles. The (pole, 2 order) gains times h are the
    Kalman gains; the (channel, pole, 2 order) state is the mean of `filter_covariance`, as the other arguments are its;
    `work` and `rows` are scratch of (3, PIECE or 2 order) and (PIECE, 2 order).
    """
    samples, channels = x.shape
    poles, width = gains.shape
    cosine, sine, unused, steady = work[0], work[1], work[2], turn.size > 0
    for first in range(0, samples, PIECE):
        if steady and first:
            _turn(rows.reshape(-1), turn[0], turn[1])
        else:
            _fill_regressors(phase, orders, shaft, first, cosine, sine, rows)
        begin = first
        if steady and ahead.size:
            begin = _filter_ahead(x, first, rows, gains, ahead, state, skip, every, innovations, levels, unused)
        output = -((skip - begin) // every)
        for i in range(begin, min(first + PIECE, samples)):
            h, due = rows[i - first], i == skip + output * every
            for channel in range(channels):
                own = state[channel]
                level = levels[output, channel] if due else unused
                # Innovation e = x - h . level; update each difference by its gain h e.
                innovation = x[i, channel] - _dot(h, own[0])
                innovations[i, channel] = innovation
                for b in range(width):
                    own[0, b] += gains[0, b] * innovation * h[b]
                    level[b] = own[0, b]
                for j in range(1, poles):
                    for b in range(width):
                        own[j, b] += gains[j, b] * innovation * h[b]
                for j in range(poles - 2, -1, -1):  # predict by F
                    for b in range(width):
                        own[j, b] += own[j + 1, b]
            output += due
