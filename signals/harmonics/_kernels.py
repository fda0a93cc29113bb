"""The two sweeps of the smoother: forward a covariance filter, backward an information filter.

A *step* is none, one or several scalar measurements (*rows*) followed by one transition of the state, which holds
`poles` blocks of `width` numbers: the levels, their first backward differences, and so on. Every measurement
has unit noise and touches the levels only. The transition is `F (state + increment)`: F an upper triangle of
ones, the increment in the highest differences alone.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled
def _shear(matrix: Floats, vector: Floats, width: int, target: int, source: int) -> None:
    """Add block `source` to block `target`: `E M E^T` and `E v`, E = I + a one at (target, source)."""
    for a in range(target * width, (target + 1) * width):
        b = a + (source - target) * width
        vector[a] += vector[b]
        for c in range(vector.size):
            matrix[a, c] += matrix[b, c]
    for c in range(vector.size):
        for a in range(target * width, (target + 1) * width):
            matrix[c, a] += matrix[c, a + (source - target) * width]


@compiled
def _mirror(matrix: Floats) -> None:
    """Make the matrix symmetric to the last bit: nothing else stops an antisymmetric error from growing."""
    for a in range(len(matrix)):
        for b in range(a):
            matrix[b, a] = matrix[a, b]


@compiled
def _update(row: Floats, datum: float, mean: Floats, covariance: Floats, gain: Floats) -> tuple[float, float]:
    """Take one measurement in; return the innovation over its standard deviation, and one over the latter.

    The gain is kept multiplied by that standard deviation: `mean += gain innovation; P -= gain gain^T`.
    """
    gain[:] = 0.0
    for a in range(row.size):
        for b in range(mean.size):
            gain[b] += row[a] * covariance[a, b]
    innovation, variance = datum, 1.0
    for a in range(row.size):
        innovation -= row[a] * mean[a]
        variance += row[a] * gain[a]
    root = 1.0 / np.sqrt(variance)
    innovation *= root
    for a in range(mean.size):
        gain[a] *= root
        mean[a] += gain[a] * innovation
    for a in range(mean.size):
        for b in range(mean.size):
            covariance[a, b] -= gain[a] * gain[b]
    return innovation, root


@compiled
def _advance(walk_variance: Floats, mean: Floats, covariance: Floats) -> None:
    """Move the filter over one transition: `F mean` and `F (P + Q) F^T`."""
    width = walk_variance.size
    blocks = mean.size // width
    for a in range(width):
        top = (blocks - 1) * width + a
        covariance[top, top] += walk_variance[a]
    for block in range(blocks - 2, -1, -1):
        _shear(covariance, mean, width, block, block + 1)
    if blocks > 1:
        _mirror(covariance)


@compiled
def forward(
    rows: Floats,
    data: Floats,
    walk_variance: Floats,
    mean: Floats,
    covariance: Floats,
    innovations: Floats,
    roots: Floats,
    wanted: Flags,
    means: Floats,
    covariances: Floats,
) -> None:
    """Filter a stretch of steps.

    Parameters
    ----------
    rows : (step, row, width) array, what multiplies the levels in each measurement.
    data : (step, row) array, the measurements; NaN is a missing one.
    walk_variance : (width,) array, variances of the increments.
    mean : (state,) array, predicted for the first step on entry, for the step after the last on return.
    covariance : (state, state) array, that of `mean`.
    innovations : (step, row) array, filled: innovation over its standard deviation, 0 where missing.
    roots : (step, row) array, filled: one over that standard deviation, 0 where missing.
    wanted : (step,) array, the steps that give an output.
    means : (output, state) array, filled with the filtered states.
    covariances : (output, state, state) array, filled with theirs.
    """
    gain = np.empty(mean.size)
    output = 0
    for step in range(len(rows)):
        for i in range(rows.shape[1]):
            if np.isnan(data[step, i]):
                innovations[step, i] = roots[step, i] = 0.0
            else:
                innovations[step, i], roots[step, i] = _update(rows[step, i], data[step, i], mean, covariance, gain)
        if wanted[step]:
            means[output] = mean
            covariances[output] = covariance
            output += 1
        _advance(walk_variance, mean, covariance)


@compiled
def _retreat(walk_variance: Floats, vector: Floats, information: Floats, column: Floats) -> None:
    """Move later knowledge back over one transition: `F^T J F`, then each unknown increment integrated out."""
    width = walk_variance.size
    blocks = vector.size // width
    for block in range(blocks - 1):
        _shear(information, vector, width, block + 1, block)
    if blocks > 1:
        _mirror(information)
    for increment in range(width):
        top = (blocks - 1) * width + increment
        root = 1.0 / np.sqrt(1.0 / walk_variance[increment] + information[top, top])
        for a in range(vector.size):
            column[a] = information[top, a] * root
        share = vector[top] * root
        for a in range(vector.size):
            vector[a] -= column[a] * share
        for a in range(vector.size):
            for b in range(vector.size):
                information[a, b] -= column[a] * column[b]


@compiled
def backward(
    rows: Floats,
    data: Floats,
    walk_variance: Floats,
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
    rows, data, walk_variance, wanted : as for `forward`.
    vector : (state,) array, from the data after the stretch on entry, from the stretch on too on return.
    information : (state, state) array, likewise.
    vectors : (output, state) array, filled: at each wanted step, from the steps after it.
    informations : (output, state, state) array, filled likewise.
    """
    column = np.empty(vector.size)
    output = len(vectors)
    for step in range(len(rows) - 1, -1, -1):
        _retreat(walk_variance, vector, information, column)
        if wanted[step]:
            output -= 1
            vectors[output] = vector
            informations[output] = information
        for i in range(rows.shape[1]):
            if not np.isnan(data[step, i]):
                row = rows[step, i]
                for a in range(row.size):
                    vector[a] += row[a] * data[step, i]
                    for b in range(row.size):
                        information[a, b] += row[a] * row[b]
