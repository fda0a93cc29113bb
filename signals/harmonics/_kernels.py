"""The sweeps of filter and smoother: forward a covariance filter, backward an information filter.

A *step* is one or several scalar measurements (*rows*) followed by one transition of the state, which holds
`poles` blocks of `width` numbers: the levels, their first backward differences, and so on. Every measurement has unit
noise and touches the levels only. The transition is `F (state + increment)`: F an upper triangle of ones, the increment
in the highest differences alone. All channels share the covariance.

A covariance filter subtracts: what a measurement takes off is as large as what was there, and of a prior of 1e12 times
the noise, 1e-4 of rounding error stays. So as long as a state is open in any direction, matrices are kept as
unevaluated sums of two doubles, high and low, which have digits for priors up to 1e24 times the noise; once it has
settled, the high parts do. `settled` tells.

Widths are multiples of LANES; what is filled up has no variance and is never measured.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals.harmonics._lanes import LANES, load, multiply_add, plus, repeat, spread, store, times, total
from signals.harmonics._phasors import Recipe, fill_rows
from signals.harmonics._twofold import add, add_product, inverse_root, multiply

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Complexes = NDArray[np.complex128]

# Samples whose rows and outputs are held at a time: they stay in the nearest caches.
PIECE = 256
# Entries of a filter's status.
TWOFOLD, COUNTDOWN = 0, 1
# Plain covariances may be open to this variance, and their correlations singular to this pivot: products of
# the two with 1e-16 and the root of the number of steps in the filter's memory are lost.
MOST_OPEN = 1e4
LEAST_PIVOT = 1e-7
# Steps between looks at a twofold state, and at most between those at a plain one.
LOOK_TWOFOLD, LOOK_PLAIN = 64, 1024


@compiled
def least_pivot(matrix: Floats, work: Floats) -> float:
    """Return the least pivot of the correlation matrix's Cholesky factor; rows without variance do not count."""
    n = len(matrix)
    least = 1.0
    for a in range(n):
        if matrix[a, a] > 0.0:
            scale = 1.0 / np.sqrt(matrix[a, a])
            for b in range(a + 1):
                other = 1.0 / np.sqrt(matrix[b, b]) if matrix[b, b] > 0.0 else 0.0
                work[a, b] = matrix[a, b] * scale * other
        else:
            work[a, : a + 1] = 0.0
    for a in range(n):
        if work[a, a] == 0.0:
            continue
        for b in range(a):
            if work[b, b] == 0.0:
                continue
            inner = work[a, b]
            for c in range(b):
                inner -= work[a, c] * work[b, c]
            work[a, b] = inner / work[b, b]
        pivot = work[a, a]
        for c in range(a):
            pivot -= work[a, c] * work[a, c]
        least = min(least, pivot)
        work[a, a] = np.sqrt(max(pivot, 1e-30))
    return least


@compiled
def settled(covariance: Floats, width: int, reach: float, work: Floats) -> bool:
    """Tell whether doubles do for this covariance, given the largest square of a row's numbers."""
    for a in range(width):
        if not covariance[a, a] * reach <= MOST_OPEN:
            return False
    return least_pivot(covariance, work) >= LEAST_PIVOT


@compiled
def _add_row(
    pairs: bool, target: Floats, at: int, high: float, low: float, source: Floats, start: int, count: int
) -> None:
    """Add a number times `count` numbers of one (2, ...) array, high parts and low, to those of another.

    `at` and `start` are the flat indices where they begin.
    """
    factor = spread(high)
    if pairs:
        rest = spread(low)
        t, s = target.size // 2, source.size // 2
        for c in range(0, count, LANES):
            value = add_product(
                load(target, at + c), load(target, t + at + c),
                load(source, start + c), load(source, s + start + c), factor, rest,
            )  # fmt: skip
            store(target, at + c, value[0])
            store(target, t + at + c, value[1])
    else:
        for c in range(0, count, LANES):
            store(target, at + c, multiply_add(factor, load(source, start + c), load(target, at + c)))


@compiled
def _weigh(pairs: bool, covariance: Floats, rows: Floats, row: int, gain: Floats, width: int) -> None:
    """Fill the gain, not yet scaled, with `P h`; h starts at `row` in the flat array `rows`."""
    n = gain.shape[1]
    gain[:] = 0.0
    for a in range(width):
        _add_row(pairs, gain, 0, rows[row + a], 0.0, covariance, a * n, n)


@compiled
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


@compiled
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


@compiled
def _filter_levels(
    first: int, last: int, rows: Floats, data: Floats, walk: Floats, mean: Floats, covariance: Floats, gain: Floats,
    scaled: Floats, innovations: Floats, roots: Floats, wanted: Flags, means: Floats, variances: Floats, output: int,
) -> int:  # fmt: skip
    """Do what `forward` does in steps `first` up to `last` of one row each, with one pole and doubles.

    All in one loop and one pass over the covariance a step: subtract `g g^T / s`, weigh with the next row, add the
    walk's variance. Rows, data, walk, innovations and roots are flat. Returns the number of outputs so far.
    """
    channels, n = mean.shape[1:]
    steps = roots.size
    varies = walk.size > n
    double = n - n % (2 * LANES)
    spreads = spread(0.0)
    for c in range(0, n, LANES):
        spreads = multiply_add(load(rows, first * n + c), load(gain, c), spreads)
    for step in range(first, last):
        row, datum, q = step * n, step * channels, step * n if varies else 0
        if np.isnan(data[datum]):
            inverse = 0.0
            roots[step] = 0.0
            for k in range(channels):
                innovations[datum + k] = 0.0
        else:
            inverse = 1.0 / (1.0 + total(spreads))
            root = np.sqrt(inverse)
            roots[step] = root
            for k in range(channels):
                lanes = spread(0.0)
                for c in range(0, n, LANES):
                    lanes = multiply_add(load(rows, row + c), load(mean, k * n + c), lanes)
                innovation = data[datum + k] - total(lanes)
                innovations[datum + k] = innovation * root
                lanes = spread(innovation * inverse)
                for c in range(0, n, LANES):
                    store(mean, k * n + c, multiply_add(load(gain, c), lanes, load(mean, k * n + c)))
        factor = spread(-inverse)
        for c in range(0, n, LANES):
            store(scaled, c, times(load(gain, c), factor))
        # After the very last row there is none to weigh with, and the gain is not used.
        row = min(step + 1, steps - 1) * n
        spreads = spread(0.0)
        for c in range(0, double, 2 * LANES):
            left, right = load(scaled, c), load(scaled, c + LANES)
            left_gain, right_gain = spread(0.0), spread(0.0)
            left_odd, right_odd = spread(0.0), spread(0.0)
            # Even rows and odd: two short sums instead of a long one, in which each would wait for the one before.
            for a in range(0, n, 2):
                k = a * n + c
                old, weight = repeat(gain, a), repeat(rows, row + a)
                one = multiply_add(old, left, load(covariance, k))
                other = multiply_add(old, right, load(covariance, k + LANES))
                store(covariance, k, one)
                store(covariance, k + LANES, other)
                left_gain = multiply_add(weight, one, left_gain)
                right_gain = multiply_add(weight, other, right_gain)
                k += n
                old, weight = repeat(gain, a + 1), repeat(rows, row + a + 1)
                one = multiply_add(old, left, load(covariance, k))
                other = multiply_add(old, right, load(covariance, k + LANES))
                store(covariance, k, one)
                store(covariance, k + LANES, other)
                left_odd = multiply_add(weight, one, left_odd)
                right_odd = multiply_add(weight, other, right_odd)
            left_gain, right_gain = plus(left_gain, left_odd), plus(right_gain, right_odd)
            left, right = load(rows, row + c), load(rows, row + c + LANES)
            left_gain = multiply_add(left, load(walk, q + c), left_gain)
            right_gain = multiply_add(right, load(walk, q + c + LANES), right_gain)
            spreads = multiply_add(left, left_gain, multiply_add(right, right_gain, spreads))
            # The old gain is still needed.
            store(gain, n + c, left_gain)
            store(gain, n + c + LANES, right_gain)
        for c in range(double, n, LANES):
            left, left_gain, left_odd = load(scaled, c), spread(0.0), spread(0.0)
            for a in range(0, n, 2):
                k = a * n + c
                one = multiply_add(repeat(gain, a), left, load(covariance, k))
                store(covariance, k, one)
                left_gain = multiply_add(repeat(rows, row + a), one, left_gain)
                k += n
                one = multiply_add(repeat(gain, a + 1), left, load(covariance, k))
                store(covariance, k, one)
                left_odd = multiply_add(repeat(rows, row + a + 1), one, left_odd)
            left_gain = plus(left_gain, left_odd)
            left = load(rows, row + c)
            left_gain = multiply_add(left, load(walk, q + c), left_gain)
            spreads = multiply_add(left, left_gain, spreads)
            store(gain, n + c, left_gain)
        for c in range(0, n, LANES):
            store(gain, c, load(gain, n + c))
        if wanted[step]:
            for c in range(0, channels * n, LANES):
                store(means, output * channels * n + c, load(mean, c))
            for a in range(n):
                variances[output, a] = covariance[0, a, a]
            output += 1
        for a in range(n):
            covariance[0, a, a] += walk[q + a]
    # Rounding of the two factors of g g^T / s differs: in so few steps it cannot have grown.
    for a in range(n):
        for b in range(a):
            covariance[0, b, a] = covariance[0, a, b]
    gain[1] = 0.0
    return output


@compiled
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
        _add_row(pairs, covariance, a * n, -scaled[0, a], -scaled[1, a], scaled, 0, n)
    if moves:
        for block in range(poles - 2, -1, -1):
            _shear(pairs, covariance, block, block + 1, width)
        for a in range(width):
            for i in range(a, n, width):
                for j in range(a, n, width):
                    if pairs:
                        value = add(covariance[0, i, j], covariance[1, i, j], walk[q + a], 0.0)
                        covariance[0, i, j], covariance[1, i, j] = value
                    else:
                        covariance[0, i, j] += walk[q + a]
    _weigh(pairs, covariance, rows, row, gain, width)


@compiled
def _shear(pairs: bool, matrix: Floats, target: int, source: int, width: int) -> None:
    """Add block `source` to block `target` of rows and columns: `E M E^T`.

    Every number and its mirror image take the same operations, so that the matrix stays symmetric to the last bit:
    nothing else stops an antisymmetric error from growing.
    """
    n = matrix.shape[1]
    down, across, low = (source - target) * width * n, (source - target) * width, n * n
    for a in range(width):
        start = a * n + target * width * (n + 1)
        for k in range(start, start + width, LANES):
            # (tt + ss) + (ts + st), which the mirror image shares.
            last = k + down + across
            if pairs:
                value = add(load(matrix, k), load(matrix, low + k), load(matrix, last), load(matrix, low + last))
                cross = add(
                    load(matrix, k + across), load(matrix, low + k + across),
                    load(matrix, k + down), load(matrix, low + k + down),
                )  # fmt: skip
                value = add(value[0], value[1], cross[0], cross[1])
                store(matrix, k, value[0])
                store(matrix, low + k, value[1])
            else:
                own = plus(load(matrix, k), load(matrix, last))
                store(matrix, k, plus(own, plus(load(matrix, k + across), load(matrix, k + down))))
    for a in range(width):
        for other in range(n // width):
            if other != target:
                k = a * n + (target * n + other) * width
                _add_row(pairs, matrix, k, 1.0, 0.0, matrix, k + down, width)
                k = a * n + (other * n + target) * width
                _add_row(pairs, matrix, k, 1.0, 0.0, matrix, k + across, width)


@compiled
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
def _look(
    status: Integers, interval: int, covariance: Floats, mean: Floats, width: int, reach: float, work: Floats
) -> bool:
    """Choose between doubles and pairs for the steps to come; tell whether the choice changed."""
    before = status[TWOFOLD]
    plain = settled(covariance[0], width, reach, work)
    if plain:
        covariance[1] = 0.0
        mean[1] = 0.0
    status[TWOFOLD] = 0 if plain else 1
    status[COUNTDOWN] = interval if plain else min(LOOK_TWOFOLD, interval)
    return bool(before != status[TWOFOLD])


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
            weighed &= not _look(status, interval, covariance, mean, width, reach, work)
        pairs = status[TWOFOLD] != 0
        if not weighed:
            _weigh(pairs, covariance, flat, step * measurements * width, gain, width)
            weighed = True
        stop = min(steps, step + status[COUNTDOWN])
        status[COUNTDOWN] -= stop - step
        if n == width and measurements == 1 and not pairs and len(covariances) == 0:
            twofold[output:] = False
            output = _filter_levels(
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
            _add_row(pairs, emitted, a * n, -scaled[0, a], -scaled[1, a], scaled, 0, n)


@compiled
def filter_samples(
    recipe: Recipe,
    places: Integers,
    phase: Floats,
    x: Floats,
    walk: Floats,
    interval: int,
    status: Integers,
    mean: Floats,
    covariance: Floats,
    innovations: Floats,
    roots: Floats,
    wanted: Flags,
    first_output: int,
    amplitude: Complexes,
    variance: Floats,
) -> None:
    """Filter samples that measure harmonics, piece by piece, from angles to complex amplitudes.

    Parameters
    ----------
    recipe : of the phasors.
    places : (3, order) array: the row of each order's phasor, the column of its real part and that of its imaginary
        part, -1 where there is none.
    phase : (shaft, sample) array in rad.
    x : (channel, sample) array, NaN, in all channels, where missing.
    walk, interval, status, mean, covariance : as for `forward`.
    innovations, roots, wanted : as for `forward`, (sample, 1, channel), (sample, 1) and (sample,) arrays.
    first_output : place of the first output.
    amplitude : (channel, order, output) array, filled from there on.
    variance : (order, output) array, filled likewise: the mean over the quadratures.
    """
    channels, samples = x.shape
    phasors, orders = recipe[0].size, places.shape[1]
    n = mean.shape[2]
    width = walk.shape[1]
    cosine, sine = np.empty((phasors, PIECE)), np.empty((phasors, PIECE))
    rows, data = np.zeros((PIECE, 1, width)), np.empty((PIECE, 1, channels))
    means, variances = np.empty((PIECE, 1, channels, width)), np.empty((PIECE, width))
    covariances, twofold = np.empty((0, 2, n, n)), np.empty(PIECE, dtype=np.bool_)
    output = first_output
    for first in range(0, samples, PIECE):
        last = min(first + PIECE, samples)
        size = last - first
        fill_rows(recipe, phase, first, last, cosine, sine)
        for k in range(orders):
            c, s = cosine[places[0, k]], sine[places[0, k]]
            for i in range(size):
                rows[i, 0, places[1, k]] = c[i]
            if places[2, k] >= 0:
                for i in range(size):
                    rows[i, 0, places[2, k]] = -s[i]
        for k in range(channels):
            for i in range(size):
                data[i, 0, k] = x[k, first + i]
        count = 0
        for i in range(first, last):
            count += wanted[i]
        forward(
            rows[:size], data[:size], walk[first:last] if len(walk) > 1 else walk, 1.0, interval, status, mean,
            covariance, innovations[first:last], roots[first:last], wanted[first:last], means[:count],
            variances[:count], covariances, twofold[:count],
        )  # fmt: skip
        for k in range(orders):
            real, imaginary = places[1, k], places[2, k]
            for channel in range(channels):
                for i in range(count):
                    part = means[i, 0, channel, imaginary] if imaginary >= 0 else 0.0
                    amplitude[channel, k, output + i] = complex(means[i, 0, channel, real], part)
            for i in range(count):
                both = variances[i, real]
                if imaginary >= 0:
                    both = 0.5 * (both + variances[i, imaginary])
                variance[k, output + i] = both
        output += count


@compiled
def _informed(information: Floats, walk: Floats, work: Floats) -> bool:
    """Tell whether doubles do for this information; what never walks is filling."""
    for a in range(len(information)):
        if information[a, a] == 0.0 and walk[a % walk.size] > 0.0:
            return False
    return least_pivot(information, work) >= LEAST_PIVOT


@compiled
def _retreat(pairs: bool, walk: Floats, vector: Floats, information: Floats, column: Floats) -> None:
    """Move later knowledge back over one transition: `F^T J F`, then each unknown increment integrated out."""
    channels, n = vector.shape[1:]
    width = walk.size
    for block in range(n // width - 1):
        _shear(pairs, information, block + 1, block, width)
        for k in range(channels):
            at = k * n + block * width
            _add_row(pairs, vector, at + width, 1.0, 0.0, vector, at, width)
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
        _add_row(pairs, column, 0, root[0], root[1], information, top * n, n)
        for k in range(channels):
            if pairs:
                share = multiply(vector[0, k, top], vector[1, k, top], -root[0], -root[1])
            else:
                share = (-vector[0, k, top] * root[0], 0.0)
            _add_row(pairs, vector, k * n, share[0], share[1], column, 0, n)
        for b in range(n):
            _add_row(pairs, information, b * n, -column[0, b], -column[1, b], column, 0, n)


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
                    _add_row(pairs, vector, k * n, data[step, i, k], 0.0, single, 0, width)
                for a in range(width):
                    _add_row(pairs, information, a * n, single[0, a], 0.0, single, 0, width)
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
            _add_row(pairs, row, first, root[0], root[1], matrix, k * n + first, n - first)
            for i in range(k + 1, n):
                from_ = i - i % LANES
                _add_row(pairs, matrix, i * n + from_, -row[0, i], -row[1, i], row, from_, n - from_)
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
                _add_row(pairs, surprise, k * n, -mean[0, k, a], -mean[1, k, a], information, a * n, n)
        product[:] = 0.0
        inner[:] = 0.0
        right[:] = 0.0
        for a in range(n):
            for b in range(a, n):
                lower[0, b, a], lower[1, b, a] = upper[0, a, b], upper[1, a, b]
        for a in range(n):
            for b in range(a, n):
                _add_row(pairs, product, a * n, upper[0, a, b], upper[1, a, b], information, b * n, n)
            inner[0, a, a] = 1.0
            for b in range(n):
                _add_row(
                    pairs, inner, a * n, product[0, a, b], product[1, a, b], lower, b * n, b + 1 + -(b + 1) % LANES
                )
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
        _add_row(pairs, row, 0, inverse[0], inverse[1], right, a * columns, columns)
        right[:, a] = row
        for b in range(a + 1, n):
            _add_row(pairs, right, b * columns, -upper[0, a, b], -upper[1, a, b], row, 0, columns)
