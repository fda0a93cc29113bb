"""The covariance filter, forward through a stretch of steps.

A *step* is one or several scalar measurements (*rows*) followed by one transition of the state, which holds
`poles` blocks of `width` numbers: the levels, their first backward differences, and so on. Every measurement has unit
noise and touches the levels only. The transition is `F (state + increment)`: F an upper triangle of ones, the increment
in the highest differences alone. All channels share the covariance.

Until a state has settled (`_settling_kernels`), matrices have low parts beside the high ones.

Widths are multiples of LANES; what is filled up has no variance and is never measured.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import LANES, load, multiply_add, spread, store, times, total
from signals.harmonics._levels_kernels import filter_levels
from signals.harmonics._row_kernels import add_row, shear
from signals.harmonics._settling_kernels import COUNTDOWN, TWOFOLD, look
from signals.harmonics._twofold import add, add_product, inverse_root, multiply

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


@compiled_inside
def _weigh(pairs: bool, covariance: Floats, rows: Floats, row: int, gain: Floats, width: int) -> None:
    """Fill the gain, not yet scaled, with `P h`; h starts at `row` in the flat array `rows`."""
    n = gain.shape[1]
    gain[:] = 0.0
    for a in range(width):
        add_row(pairs, gain, 0, rows[row + a], 0.0, covariance, a * n, n)


@compiled_inside
def _measure(
    rows: Floats, row: int, width: int, data: Floats, datum: int, mean: Floats, gain: Floats, scaled: Floats,
    innovations: Floats,
) -> float:  # fmt: skip
    """Take one measurement into the means; return one over the innovation's standard deviation.

    Parameters
    ----------
    rows, row : flat array and where h starts in it.
    width : numbers in h.
    data, datum : flat array and where the measurements of the channels start in it.
    mean : (2, channel, state) array, updated.
    gain : (2, state) array, `P h`.
    scaled : (2, state) array, filled with the gain over the innovation's standard deviation: `P -= g g^T`.
    innovations : flat array, filled from `datum` on with innovations over their standard deviation.
    """
    channels, n = mean.shape[1:]
    lanes = spread(0.0)
    for c in range(0, width, LANES):
        lanes = multiply_add(load(rows, row + c), load(gain, c), lanes)
    root = 1.0 / np.sqrt(1.0 + total(lanes))
    lanes = spread(root)
    for c in range(0, n, LANES):
        store(scaled, c, times(load(gain, c), lanes))
    for k in range(channels):
        lanes = spread(0.0)
        for c in range(0, width, LANES):
            lanes = multiply_add(load(rows, row + c), load(mean, k * n + c), lanes)
        innovation = (data[datum + k] - total(lanes)) * root
        innovations[datum + k] = innovation
        lanes = spread(innovation)
        for c in range(0, n, LANES):
            store(mean, k * n + c, multiply_add(load(scaled, c), lanes, load(mean, k * n + c)))
    return float(root)


@compiled_inside
def _measure_pairs(
    rows: Floats, row: int, width: int, data: Floats, datum: int, mean: Floats, gain: Floats, scaled: Floats,
    innovations: Floats,
) -> float:  # fmt: skip
    """Take one measurement in as `_measure` does."""
    channels, n = mean.shape[1:]
    variance = (1.0, 0.0)
    for a in range(width):
        variance = add_product(variance[0], variance[1], gain[0, a], gain[1, a], rows[row + a], 0.0)
    root = inverse_root(variance[0], variance[1])
    for a in range(n):
        scaled[0, a], scaled[1, a] = multiply(gain[0, a], gain[1, a], root[0], root[1])
    for k in range(channels):
        error = (data[datum + k], 0.0)
        for a in range(width):
            error = add_product(error[0], error[1], mean[0, k, a], mean[1, k, a], -rows[row + a], 0.0)
        error = multiply(error[0], error[1], root[0], root[1])
        innovations[datum + k] = error[0]
        for a in range(n):
            mean[0, k, a], mean[1, k, a] = add_product(
                mean[0, k, a], mean[1, k, a], scaled[0, a], scaled[1, a], error[0], error[1]
            )
    return root[0]


@compiled_inside
def _sweep(
    pairs: bool, moves: bool, covariance: Floats, scaled: Floats, rows: Floats, row: int, gain: Floats, walk: Floats,
    q: int, width: int,
) -> None:  # fmt: skip
    """Subtract `g g^T`, move on where the step ends here, and weigh with the next row.

    Parameters
    ----------
    pairs : whether low parts count.
    moves : whether the transition follows.
    covariance : (2, state, state) array, updated.
    scaled : (2, state) array, g.
    rows, row : flat array and where the next measurement's h starts in it.
    gain : (2, state) array, filled with `P h`.
    walk, q : flat array and where the variances of the increments start in it.
    width : numbers in h.
    """
    n = gain.shape[1]
    poles = n // width
    for a in range(n):
        add_row(pairs, covariance, a * n, -scaled[0, a], -scaled[1, a], scaled, 0, n)
    if moves:
        for block in range(poles - 2, -1, -1):
            shear(pairs, covariance, block, block + 1, width)
        for a in range(width):
            for i in range(a, n, width):
                for j in range(a, n, width):
                    if pairs:
                        value = add(covariance[0, i, j], covariance[1, i, j], walk[q + a], 0.0)
                        covariance[0, i, j], covariance[1, i, j] = value
                    else:
                        covariance[0, i, j] += walk[q + a]
    _weigh(pairs, covariance, rows, row, gain, width)


@compiled_inside
def _move(pairs: bool, mean: Floats, width: int) -> None:
    """Move the means over one transition."""
    n = mean.shape[2]
    for k in range(mean.shape[1]):
        for a in range(n - width - 1, -1, -1):
            if pairs:
                mean[0, k, a], mean[1, k, a] = add(
                    mean[0, k, a], mean[1, k, a], mean[0, k, a + width], mean[1, k, a + width]
                )
            else:
                mean[0, k, a] += mean[0, k, a + width]


@compiled
def forward(
    rows: Floats,
    data: Floats,
    walk: Floats,
    reach: float,
    interval: int,
    status: Integers,
    mean: Floats,
    covariance: Floats,
    innovations: Floats,
    roots: Floats,
    wanted: Flags,
    means: Floats,
    variances: Floats,
    covariances: Floats,
    twofold: Flags,
) -> None:
    """Filter a stretch of steps.

    Parameters
    ----------
    rows : (step, row, width) array, what multiplies the levels in each measurement.
    data : (step, row, channel) array, the measurements; NaN, in all channels, is a missing one.
    walk : (step, width) array, variances of the increments after each step, or (1, width), of all.
    reach : largest square of a number in `rows`.
    interval : steps between looks at a plain covariance.
    status : (2,) array: whether low parts count, and how many steps are left to the next look.
    mean : (2, channel, state) array, predicted for the first step on entry, for the step after the last on return.
    covariance : (2, state, state) array, that of `mean`.
    innovations : (step, row, channel) array, filled: innovation over its standard deviation, 0 where missing.
    roots : (step, row) array, filled: one over that standard deviation, 0 where missing.
    wanted : (step,) array, the steps that give an output.
    means : (output, 2, channel, state) array, filled with the filtered means; or (output, 1, channel, width), with
        the high parts of their levels.
    variances : (output, width) array, filled with the variances of the levels.
    covariances : (output, 2, state, state) array, filled with the covariances; or none at all.
    twofold : (output,) array, filled: whether low parts count.
    """
    channels, n = mean.shape[1:]
    steps, measurements, width = rows.shape
    flat, flat_data, flat_walk = rows.reshape(rows.size), data.reshape(data.size), walk.reshape(walk.size)
    flat_innovations, flat_roots = innovations.reshape(data.size), roots.reshape(roots.size)
    gain, scaled = np.zeros((2, n)), np.zeros((2, n))
    work = np.empty((n, n))
    output, step = 0, 0
    weighed = False
    while step < steps:
        if status[COUNTDOWN] <= 0:
            weighed &= not look(status, interval, covariance, mean, width, reach, work)
        pairs = status[TWOFOLD] != 0
        if not weighed:
            _weigh(pairs, covariance, flat, step * measurements * width, gain, width)
            weighed = True
        stop = min(steps, step + status[COUNTDOWN])
        status[COUNTDOWN] -= stop - step
        if n == width and measurements == 1 and not pairs and len(covariances) == 0:
            twofold[output:] = False
            output = filter_levels(
                step, stop, flat, flat_data, flat_walk, mean, covariance, gain, scaled, flat_innovations, flat_roots,
                wanted, means, variances, output,
            )  # fmt: skip
            step = stop
        while step < stop:
            q = step * width if len(walk) > 1 else 0
            for i in range(measurements):
                number = step * measurements + i
                row, datum = number * width, number * channels
                if np.isnan(flat_data[datum]):
                    flat_innovations[datum : datum + channels] = 0.0
                    flat_roots[number] = 0.0
                    scaled[:] = 0.0
                elif pairs:
                    flat_roots[number] = _measure_pairs(
                        flat, row, width, flat_data, datum, mean, gain, scaled, flat_innovations
                    )
                else:
                    flat_roots[number] = _measure(
                        flat, row, width, flat_data, datum, mean, gain, scaled, flat_innovations
                    )
                moves = i == measurements - 1
                if moves and wanted[step]:
                    _emit(pairs, mean, covariance, scaled, means, variances, covariances, output)
                    twofold[output] = pairs
                    output += 1
                # After the very last row there is none to weigh with, and the gain is not used.
                following = min(number + 1, roots.size - 1) * width
                _sweep(pairs, moves, covariance, scaled, flat, following, gain, flat_walk, q, width)
            if n > width:
                _move(pairs, mean, width)
            step += 1


@compiled
def _emit(
    pairs: bool, mean: Floats, covariance: Floats, scaled: Floats, means: Floats, variances: Floats,
    covariances: Floats, output: int,
) -> None:  # fmt: skip
    channels, n = mean.shape[1:]
    parts, kept, width = means.shape[1], means.shape[3], variances.shape[1]
    for part in range(parts):
        for k in range(channels):
            at, start = ((output * parts + part) * channels + k) * kept, (part * channels + k) * n
            for c in range(0, kept, LANES):
                store(means, at + c, load(mean, start + c))
    for a in range(width):
        if pairs:
            variances[output, a] = add_product(
                covariance[0, a, a], covariance[1, a, a], scaled[0, a], scaled[1, a], -scaled[0, a], -scaled[1, a]
            )[0]
        else:
            variances[output, a] = covariance[0, a, a] - scaled[0, a] * scaled[0, a]
    if len(covariances):
        covariances[output] = covariance
        emitted = covariances[output]
        for a in range(n):
            add_row(pairs, emitted, a * n, -scaled[0, a], -scaled[1, a], scaled, 0, n)
