"""What later data say of a state, gathered backward through a stretch of steps, and where it meets what is known.

It is gathered segment by segment, from output to output (`_segment_kernels`). Steps are those of `_filter_kernels`;
matrices have low parts beside the high ones until later data tell all.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import LANES, load, multiply_add, spread, store, times
from signals.harmonics._row_kernels import add_rows
from signals.harmonics._segment_kernels import come_back, depart, mirror, rebase
from signals.harmonics._settling_kernels import LEAST_PIVOT, least_pivot
from signals.harmonics._still_kernels import filled
from signals.harmonics._twofold import inverse_root, multiply

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
# (2, channel, stride) and (2, state, stride) arrays: what is known of a state.
Known = tuple[Floats, Floats]
# Variances, of noise of unit variance, down to which one over a number and its low part are numbers.
NEGLIGIBLE = 1e-270


@compiled_inside
def _informed(information: Floats, walk: Floats, work: Floats) -> bool:
    """Tell whether doubles do for this information; what never walks is filling."""
    for a in range(len(information)):
        if information[a, a] == 0.0 and walk[a % walk.size] > 0.0:
            return False
    return least_pivot(information, work) >= LEAST_PIVOT


@compiled
def backward(
    rows: Floats,
    data: Floats,
    walk: Floats,
    longest: int,
    open_: bool,
    vector: Floats,
    information: Floats,
    wanted: Flags,
    vectors: Floats,
    informations: Floats,
) -> None:
    """Gather, from the last step of a stretch to its first, what later data say of the state.

    Their likelihood is `exp(vector . state - state . information state / 2)` up to a factor.

    Parameters
    ----------
    rows, data, walk, wanted : as for `forward`.
    longest : steps in a segment at most.
    open_ : whether the filter is open anywhere in the stretch: then what is left of later knowledge after rounding,
        in a direction that it does not tell, would pass for knowledge, and low parts count until it tells all.
    vector : (2, channel, state) array, from the data after the stretch on entry, from the stretch on too on return.
    information : (2, state, state) array, likewise.
    vectors : (output, 2, channel, state) array, filled: at each wanted step, from the steps after it.
    informations : (output, 2, state, state) array, filled likewise.
    """
    channels, n = vector.shape[1:]
    steps, measurements, width = rows.shape
    count, stride = min(longest, steps + 1) * measurements, filled(n)
    # The filling is zero, and nothing is ever added to it.
    kept = (
        np.zeros((2, count, stride)), np.zeros((2, count, stride)), np.empty((2, count)), np.empty((2, count, channels))
    )  # fmt: skip
    past, future = (np.zeros((2, channels, stride)), np.zeros((2, n, stride))), _copied(vector, information, stride)
    work = np.empty((n, n))
    output, after = len(vectors), steps
    while after >= 0:
        first = after - 1
        while first >= 0 and not wanted[first] and after - first < longest:
            first -= 1
        pairs = open_ and not _informed(future[1][0], walk[min(after, len(walk) - 1)], work)
        if not pairs:
            _forget(future)
        depart(pairs, (first, after, steps), rows, data, walk, past[0], past[1], kept)
        rebase(pairs, after - max(first, 0), width, future[0], future[1])
        _close(pairs, past, future)
        come_back(pairs, kept, (min(after, steps - 1) - first) * measurements, future[0], future[1])
        if first >= 0 and wanted[first]:
            output -= 1
            vectors[output], informations[output] = future[0][:, :, :n], future[1][:, :, :n]
        after = first
    vector[:], information[:] = future[0][:, :, :n], future[1][:, :, :n]


@compiled
def _copied(vector: Floats, information: Floats, stride: int) -> Known:
    """Return copies whose rows are filled up with zeros to the stride."""
    channels, n = vector.shape[1:]
    both = np.zeros((2, channels, stride)), np.zeros((2, n, stride))
    both[0][:, :, :n], both[1][:, :, :n] = vector, information
    return both


@compiled_inside
def _forget(known: Known) -> None:
    """Set the low parts to zero."""
    for part in known:
        half = part.size // 2
        for c in range(half, part.size, LANES):
            store(part, c, spread(0.0))


@compiled
def _close(pairs: bool, past: Known, future: Known) -> None:
    """Turn what later data say of a state, (j, J), into what they say of the error of a filter that knows (m, P).

    That is `(I + J P)^-1 (j - J m)` and `(I + J P)^-1 J`. With `(P^-1 + J)^-1 = W^T W` these are `v - J W^T W v` of
    `v = j - J m`, and `J - J W^T W J`. The covariance is destroyed.
    """
    (mean, covariance), (vector, information) = past, future
    channels, (n, stride) = vector.shape[1], information.shape[1:]
    columns = stride + channels + -channels % LANES
    right = np.empty((2, n, columns))
    _combine(pairs, mean, covariance, vector, information, True, stride, right)
    for k in range(channels):
        add_rows(pairs, vector, k * stride, -1.0, mean, k * stride, 1, information, 0, stride, n, stride)
        add_rows(pairs, vector, k * stride, -1.0, right, stride + k, columns, right, 0, columns, n, stride)
    for a in range(n):
        start = a - a % LANES
        add_rows(
            pairs, information, a * stride + start, -1.0, right, a, columns, right, start, columns, n, stride - start
        )
    mirror(information)


@compiled
def _combine(
    pairs: bool, mean: Floats, covariance: Floats, vector: Floats, information: Floats, turned: bool, kept: int,
    right: Floats,
) -> None:  # fmt: skip
    """Combine past (m, P) and future (j, J).

    With `P = C^T C` and `I + C J C^T = U^T U`, `(P^-1 + J)^-1 = W^T W` of `W = U^-T C`: a sum of squares, in which
    nothing cancels however little one of the two knows; and the mean moves by `W^T U^-T C (j - J m)`.

    Parameters
    ----------
    mean, vector : (2, channel, stride) arrays.
    covariance, information : (2, state, stride) arrays, the first destroyed.
    turned : whether W J is asked for instead of W.
    kept : columns of it that are.
    right : (2, state, column) array, filled with these, then with a column `U^-T C (j - J m)` for each channel.
    """
    channels, (n, stride) = mean.shape[1], information.shape[1:]
    columns = right.shape[2]
    upper, lower, surprise = covariance, np.zeros((2, n, stride)), vector.copy()
    product, inner, seen = np.zeros((2, n, stride)), np.zeros((2, n, stride)), np.zeros((2, channels, stride))
    _factor(pairs, upper)
    right[:] = 0.0
    for part in range(2 if pairs else 1):
        for a in range(n):
            for b in range(a, n):
                lower[part, b, a] = upper[part, a, b]
    for k in range(channels):
        add_rows(pairs, surprise, k * stride, -1.0, mean, k * stride, 1, information, 0, stride, n, stride)
        add_rows(pairs, seen, k * stride, 1.0, surprise, k * stride, 1, lower, 0, stride, n, stride)
        for a in range(n):
            right[0, a, kept + k], right[1, a, kept + k] = seen[0, k, a], seen[1, k, a]
    for a in range(n):
        row, start = a * stride, a - a % LANES
        add_rows(pairs, product, row, 1.0, upper, row + a, 1, information, row, stride, n - a, stride)
        inner[0, a, a] = 1.0
        # Of this symmetric matrix the upper triangle counts.
        add_rows(pairs, inner, row + start, 1.0, product, row + a, 1, lower, row + start, stride, n - a, stride - start)
        for part in range(2 if pairs else 1):
            for b in range(kept):
                right[part, a, b] = product[part, a, b] if turned else upper[part, a, b]
    _factor(pairs, inner)
    for a in range(n):
        add_rows(pairs, right, a * columns, -1.0, inner, a, stride, right, 0, columns, a, columns)
        root = inverse_root(inner[0, a, a], inner[1, a, a])
        inverse = multiply(root[0], root[1], root[0], root[1])
        _scale(pairs, right, a * columns, inverse[0], inverse[1], columns)


@compiled
def _factor(pairs: bool, matrix: Floats) -> None:
    """Replace a symmetric matrix by the upper triangle U of `U^T U`; a direction without variance gets zeros."""
    n, stride = matrix.shape[1:]
    for k in range(n):
        size, start = matrix[0, k, k], k - k % LANES
        add_rows(pairs, matrix, k * stride + start, -1.0, matrix, k, stride, matrix, start, stride, k, stride - start)
        for part in range(2):
            for i in range(k):
                matrix[part, k, i] = 0.0
        if matrix[0, k, k] > max((1e-29 if pairs else 1e-15) * size, NEGLIGIBLE):
            root = inverse_root(matrix[0, k, k], matrix[1, k, k] if pairs else 0.0)
            _scale(pairs, matrix, k * stride, root[0], root[1], stride)
        else:
            matrix[:, k] = 0.0


@compiled_inside
def _scale(pairs: bool, matrix: Floats, at: int, high: float, low: float, count: int) -> None:
    """Multiply `count` numbers from a flat index on."""
    half = matrix.size // 2
    for c in range(at, at + count, LANES):
        if pairs:
            value = multiply(load(matrix, c), load(matrix, half + c), spread(high), spread(low))
            store(matrix, c, value[0])
            store(matrix, half + c, value[1])
        else:
            store(matrix, c, times(load(matrix, c), spread(high)))


@compiled
def meet(
    means: Floats, covariances: Floats, twofold: Flags, vectors: Floats, informations: Floats, levels: Floats,
    variances: Floats,
) -> None:  # fmt: skip
    """Levels and variances given both past (m, P) and future (j, J): `P' = (P^-1 + J)^-1, m + P' (j - J m)`.

    Parameters
    ----------
    means, covariances, twofold : as `forward` leaves them; destroyed.
    vectors, informations : as `backward` leaves them.
    levels : (output, channel, width) array, filled.
    variances : (output, width) array, filled.
    """
    channels, n = means.shape[2:]
    width = variances.shape[1]
    columns = width + channels + -channels % LANES
    right = np.empty((2, n, columns))
    for output in range(len(levels)):
        mean = means[output]
        _combine(
            twofold[output], mean, covariances[output], vectors[output], informations[output], False, width, right,
        )  # fmt: skip
        for c in range(0, width, LANES):
            squares = spread(0.0)
            for at in range(c, c + n * columns, columns):
                squares = multiply_add(load(right, at), load(right, at), squares)
            store(variances, output * width + c, squares)
        for k in range(channels):
            add_rows(twofold[output], mean, k * n, 1.0, right, width + k, columns, right, 0, columns, n, width)
            for c in range(width):
                levels[output, k, c] = mean[0, k, c]
