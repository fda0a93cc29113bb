"""The covariance filter, forward through a stretch of steps.

A *step* is one or several scalar measurements (*rows*) followed by one transition of the state, which holds
`poles` blocks of `width` numbers: the levels, their first backward differences, and so on. Every measurement has unit
noise and touches the levels only. The transition is `F (state + increment)`: F an upper triangle of ones, the increment
in the highest differences alone. All channels share the covariance.

From one look at the covariance to the next (`_settling_kernels`), the filter goes on in the coordinates of the state at
the look (`_still_kernels`). Until a state has settled, matrices have low parts beside the high ones.

Widths are multiples of LANES; what is filled up has no variance and is never measured.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals.harmonics._row_kernels import add_row
from signals.harmonics._settling_kernels import COUNTDOWN, TWOFOLD, look
from signals.harmonics._still_kernels import add_walk, binomial, carry, filled, lay, subtract, take, take_pairs
from signals.harmonics._twofold import add_product, multiply

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


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
    steps, width = len(rows), rows.shape[2]
    stride = filled(n)
    level, spread = np.zeros((2, channels, stride)), np.zeros((2, n, stride))
    # Rows and gains of a measurement and of the one before.
    own, gains, own_roots = np.zeros((2, 2, stride)), np.zeros((2, 2, stride)), np.empty((2, 2))
    errors, work = np.empty((2, 2, channels)), np.empty((n, n))
    powers, gained = np.empty(n // width), np.empty(n // width)
    output, first = 0, 0
    while first < steps:
        if status[COUNTDOWN] <= 0:
            look(status, interval, covariance, mean, width, reach, work)
        pairs = status[TWOFOLD] != 0
        last = min(steps, first + status[COUNTDOWN])
        status[COUNTDOWN] -= last - first
        level[:, :, :n], spread[:, :, :n] = mean, covariance
        place, before = 0, -1
        for step in range(first, last):
            for i in range(rows.shape[1]):
                if np.isnan(data[step, i, 0]):
                    innovations[step, i] = 0.0
                    roots[step, i] = 0.0
                    continue
                lay(pairs, step - first, rows, step, i, own, place, powers.size)
                if pairs:
                    take_pairs(data, step, i, level, spread, own, gains, own_roots, errors, before, place)
                else:
                    take(data, step, i, level, spread, own, gains, own_roots, errors, before, place)
                roots[step, i] = own_roots[0, place]
                for k in range(channels):
                    innovations[step, i, k] = errors[0, place, k]
                before, place = place, 1 - place
            if wanted[step]:
                if len(covariances) > 0:
                    means[output], covariances[output] = level[:, :, :n], spread[:, :, :n]
                    if before >= 0:
                        _settle(pairs, covariances[output], gains, before)
                    carry(pairs, step - first, width, means[output], covariances[output])
                    _variances(covariances[output], variances, output)
                else:
                    for block in range(gained.size):
                        gained[block] = binomial(step - first, block)
                    _emit(pairs, gained, width, level, spread, gains, before, means, variances, output)
                twofold[output] = pairs
                output += 1
            for block in range(powers.size):
                powers[block] = binomial(first - step, powers.size - 1 - block)
            add_walk(pairs, powers, walk, step if len(walk) > 1 else 0, spread)
        if before >= 0:
            subtract(pairs, spread, gains, before)
        mean[:], covariance[:] = level[:, :, :n], spread[:, :, :n]
        carry(pairs, last - first, width, mean, covariance)
        first = last


@compiled_inside
def _settle(pairs: bool, covariance: Floats, gains: Floats, place: int) -> None:
    """Subtract the last measurement's share, still due, from a covariance that goes out."""
    n, stride = covariance.shape[1], gains.shape[2]
    for a in range(n):
        add_row(pairs, covariance, a * n, -gains[0, place, a], -gains[1, place, a], gains, place * stride, n)


@compiled_inside
def _variances(covariance: Floats, variances: Floats, output: int) -> None:
    for c in range(variances.shape[1]):
        variances[output, c] = covariance[0, c, c]


@compiled_inside
def _emit(
    pairs: bool, gained: Floats, width: int, level: Floats, spread: Floats, gains: Floats, before: int, means: Floats,
    variances: Floats, output: int,
) -> None:  # fmt: skip
    """Write down the levels after some steps, and their variances less the last measurement's share, still due.

    `gained` is what a level has gained by then from each block.
    """
    poles = gained.size
    due = 1.0 if before >= 0 else 0.0
    for k in range(level.shape[1]):
        for c in range(width):
            means[output, 0, k, c] = level[0, k, c]
            for block in range(1, poles):
                means[output, 0, k, c] += gained[block] * level[0, k, block * width + c]
    last = max(before, 0)
    for c in range(width):
        if pairs:
            high, low, gain, rest = 0.0, 0.0, 0.0, 0.0
            for i in range(poles):
                a, weight = i * width + c, gained[i]
                gain, rest = add_product(gain, rest, gains[0, last, a], gains[1, last, a], weight, 0.0)
                for j in range(poles):
                    b = j * width + c
                    both = multiply(weight, 0.0, gained[j], 0.0)
                    high, low = add_product(high, low, spread[0, a, b], spread[1, a, b], both[0], both[1])
            variances[output, c] = add_product(high, low, due * gain, due * rest, -gain, -rest)[0]
        else:
            value, gain = 0.0, 0.0
            for i in range(poles):
                a, weight, part = i * width + c, gained[i], 0.0
                gain += weight * gains[0, last, a]
                for j in range(poles):
                    part += gained[j] * spread[0, a, j * width + c]
                value += weight * part
            variances[output, c] = value - due * gain * gain
