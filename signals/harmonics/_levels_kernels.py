"""The covariance filter where the state is levels alone, each step measures once and doubles do: all in one loop."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import LANES, load, multiply_add, plus, repeat, spread, store, times, total

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@compiled
def filter_levels(
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
