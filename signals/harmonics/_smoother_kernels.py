"""The information filter, backward through a stretch of steps, and where it meets the forward one.

Steps are those of `_filter_kernels`; matrices have low parts beside the high ones until later data tell all.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import LANES
from signals.harmonics._row_kernels import add_row, shear
from signals.harmonics._settling_kernels import LEAST_PIVOT, LOOK_TWOFOLD, least_pivot
from signals.harmonics._twofold import add, add_product, inverse_root, multiply

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled_inside
def _informed(information: Floats, walk: Floats, work: Floats) -> bool:
    """Tell whether doubles do for this information; what never walks is filling."""
    for a in range(len(information)):
        if information[a, a] == 0.0 and walk[a % walk.size] > 0.0:
            return False
    return least_pivot(information, work) >= LEAST_PIVOT


@compiled_inside
def _retreat(pairs: bool, walk: Floats, vector: Floats, information: Floats, column: Floats) -> None:
    """Move later knowledge back over one transition: `F^T J F`, then each unknown increment integrated out."""
    channels, n = vector.shape[1:]
    width = walk.size
    for block in range(n // width - 1):
        shear(pairs, information, block + 1, block, width)
        for k in range(channels):
            at = k * n + block * width
            add_row(pairs, vector, at + width, 1.0, 0.0, vector, at, width)
    for a in range(width):
        if walk[a] == 0.0:
            continue
        top = n - width + a
        if pairs:
            open_ = add(1.0 / walk[a], 0.0, information[0, top, top], information[1, top, top])
            root = inverse_root(open_[0], open_[1])
        else:
            root = (1.0 / np.sqrt(1.0 / walk[a] + information[0, top, top]), 0.0)
        column[:] = 0.0
        add_row(pairs, column, 0, root[0], root[1], information, top * n, n)
        for k in range(channels):
            if pairs:
                share = multiply(vector[0, k, top], vector[1, k, top], -root[0], -root[1])
            else:
                share = (-vector[0, k, top] * root[0], 0.0)
            add_row(pairs, vector, k * n, share[0], share[1], column, 0, n)
        for b in range(n):
            add_row(pairs, information, b * n, -column[0, b], -column[1, b], column, 0, n)


@compiled
def backward(
    rows: Floats,
    data: Floats,
    walk: Floats,
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
    open_ : whether the filter is open anywhere in the stretch: then what is left of later knowledge after rounding,
        in a direction that it does not tell, would pass for knowledge, and low parts count until it tells all.
    vector : (2, channel, state) array, from the data after the stretch on entry, from the stretch on too on return.
    information : (2, state, state) array, likewise.
    vectors : (output, 2, channel, state) array, filled: at each wanted step, from the steps after it.
    informations : (output, 2, state, state) array, filled likewise.
    """
    channels, n = vector.shape[1:]
    width = rows.shape[2]
    column, work = np.empty((2, n)), np.empty((n, n))
    single = np.zeros((2, width))
    output = len(vectors)
    pairs = False
    for step in range(len(rows) - 1, -1, -1):
        increments = walk[step if len(walk) > 1 else 0]
        if open_ and (len(rows) - 1 - step) % LOOK_TWOFOLD == 0:
            pairs = not _informed(information[0], increments, work)
            if not pairs:
                information[1] = 0.0
                vector[1] = 0.0
        _retreat(pairs, increments, vector, information, column)
        if wanted[step]:
            output -= 1
            vectors[output] = vector
            informations[output] = information
        for i in range(rows.shape[1]):
            if not np.isnan(data[step, i, 0]):
                single[0] = rows[step, i]
                for k in range(channels):
                    add_row(pairs, vector, k * n, data[step, i, k], 0.0, single, 0, width)
                for a in range(width):
                    add_row(pairs, information, a * n, single[0, a], 0.0, single, 0, width)
    if not pairs:
        information[1] = 0.0
        vector[1] = 0.0


@compiled
def _factor(pairs: bool, matrix: Floats) -> None:
    """Replace a symmetric matrix by the upper triangle U of `U^T U`; a direction without variance gets zeros."""
    n = matrix.shape[1]
    row = np.zeros((2, n))
    size = np.empty(n)
    for k in range(n):
        size[k] = matrix[0, k, k]
    for k in range(n):
        first = k - k % LANES
        if matrix[0, k, k] > (1e-29 if pairs else 1e-15) * size[k]:
            root = inverse_root(matrix[0, k, k], matrix[1, k, k]) if pairs else (1.0 / np.sqrt(matrix[0, k, k]), 0.0)
            row[:] = 0.0
            add_row(pairs, row, first, root[0], root[1], matrix, k * n + first, n - first)
            for i in range(k + 1, n):
                from_ = i - i % LANES
                add_row(pairs, matrix, i * n + from_, -row[0, i], -row[1, i], row, from_, n - from_)
        else:
            row[:] = 0.0
        row[:, :k] = 0.0
        matrix[:, k] = row


@compiled
def meet(
    means: Floats, covariances: Floats, twofold: Flags, vectors: Floats, informations: Floats, levels: Floats,
    variances: Floats,
) -> None:  # fmt: skip
    """Levels and variances given both past (m, P) and future (j, J): `P' = (P^-1 + J)^-1, m + P' (j - J m)`.

    With `P = C C^T` and `I + C^T J C = U^T U`, `P' = (U^-T C^T)^T (U^-T C^T)`: sums of squares, in which nothing
    cancels however little one of the two knows.

    Parameters
    ----------
    means, covariances, twofold : as `forward` leaves them.
    vectors, informations : as `backward` leaves them.
    levels : (output, channel, width) array, filled.
    variances : (output, width) array, filled.
    """
    channels, n = means.shape[2:]
    width = variances.shape[1]
    columns = width + channels + -channels % LANES
    lower, product, inner = np.zeros((2, n, n)), np.empty((2, n, n)), np.empty((2, n, n))
    surprise, right = np.empty((2, channels, n)), np.empty((2, n, columns))
    for output in range(len(levels)):
        pairs = twofold[output]
        upper, information, mean = covariances[output], informations[output], means[output]
        _factor(pairs, upper)
        surprise[:] = vectors[output]
        for k in range(channels):
            for a in range(n):
                add_row(pairs, surprise, k * n, -mean[0, k, a], -mean[1, k, a], information, a * n, n)
        product[:] = 0.0
        inner[:] = 0.0
        right[:] = 0.0
        for a in range(n):
            for b in range(a, n):
                lower[0, b, a], lower[1, b, a] = upper[0, a, b], upper[1, a, b]
        for a in range(n):
            for b in range(a, n):
                add_row(pairs, product, a * n, upper[0, a, b], upper[1, a, b], information, b * n, n)
            inner[0, a, a] = 1.0
            for b in range(n):
                add_row(pairs, inner, a * n, product[0, a, b], product[1, a, b], lower, b * n, b + 1 + -(b + 1) % LANES)
            right[:, a, :width] = upper[:, a, :width]
            for k in range(channels):
                value = (0.0, 0.0)
                for b in range(a, n):
                    value = add_product(
                        value[0], value[1], upper[0, a, b], upper[1, a, b], surprise[0, k, b], surprise[1, k, b]
                    )
                right[0, a, width + k], right[1, a, width + k] = value
        _factor(pairs, inner)
        _solve(pairs, inner, right)
        for c in range(width):
            variances[output, c] = 0.0
            for a in range(n):
                variances[output, c] += right[0, a, c] * right[0, a, c]
            for k in range(channels):
                value = (mean[0, k, c], mean[1, k, c])
                for a in range(n):
                    value = add_product(value[0], value[1], right[0, a, c], 0.0, right[0, a, width + k], 0.0)
                levels[output, k, c] = value[0]


@compiled
def _solve(pairs: bool, upper: Floats, right: Floats) -> None:
    """Replace `right` by `U^-T right`."""
    n, columns = right.shape[1:]
    row = np.empty((2, columns))
    for a in range(n):
        if pairs:
            root = inverse_root(upper[0, a, a], upper[1, a, a])
            inverse = multiply(root[0], root[1], root[0], root[1])
        else:
            inverse = (1.0 / upper[0, a, a], 0.0)
        row[:] = 0.0
        add_row(pairs, row, 0, inverse[0], inverse[1], right, a * columns, columns)
        right[:, a] = row
        for b in range(a + 1, n):
            add_row(pairs, right, b * columns, -upper[0, a, b], -upper[1, a, b], row, 0, columns)
