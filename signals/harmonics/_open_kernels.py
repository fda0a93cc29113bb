"""The covariance filter of levels while the prior is still open.

A prior of 1e6 times the noise beside what is known to a thousandth of it would take nine of a covariance's sixteen
digits. So the two are kept apart, as P + V V^T: V, a factor of what the prior left open, begins as the prior's
standard deviations, and P, what an exactly known start would have, as zero. P moves as ever. A sample measures h of the
state, which P expects with the variance `r^2 = 1 + h . P h`; it has the gain `g = P h / r` and the innovation e, of
variance 1. The open part of the state is V u, with u white and of variance 1. It adds `a . u` to e, where
`a = V^T h / r`: so e has the variance `s^2 = 1 + a . a`, and it moves the mean by `(g + V a / s^2) e`, where V has
followed the filter of P already, to `V - g a^T`. What it leaves open is

    V (1 - a a^T / (s (s + 1))),

Potter's update of a factor [1]_, no difference of large variances. Once V V^T is small, it is added to P.

References
----------
.. [1] J. E. Potter, R. G. Stern, "Statistical filtering of space navigation measurements", AIAA Guidance and Control
   Conference, 1963.
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import (
    WIDE,
    load_wide,
    multiply_add,
    negative,
    plus,
    repeat_wide,
    spread_wide,
    store,
    times,
    total,
)
from signals.harmonics._octet_kernels import aligned
from signals.harmonics._settling_kernels import COUNTDOWN, FACTORED, PAIRS, TWOFOLD, settled
from signals.harmonics._twofold import add_product

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# The first of some samples and the one after the last.
Span = tuple[int, int]
# Which sample gives the next output, how many lie between outputs, and the place of the next.
Outputs = tuple[int, int, int]

# Variances up to which a factor does: a sixteen-digit part of the standard deviation stays far below that of the noise.
# And those that P bears without harm.
MOST_FACTORED, LEAST_FACTORED = 1e13, 1e2
# Samples between looks.
LOOK_OPEN = 128

_SELF = np.eye(WIDE).ravel()


@compiled
def factor(status: Integers, covariance: Floats) -> None:
    """Turn a covariance that nothing was measured of into P and V, where V bears it."""
    n = covariance.shape[1]
    for a in range(n):
        for b in range(n):
            off = covariance[0, a, b] if a != b else max(covariance[0, a, a] - MOST_FACTORED, 0.0)
            if off != 0.0 or covariance[1, a, b] != 0.0:
                return
    for a in range(n):
        covariance[1, a, a] = np.sqrt(covariance[0, a, a])
        covariance[0, a, a] = 0.0
    status[TWOFOLD] = FACTORED


@compiled
def look_open(status: Integers, interval: int, covariance: Floats, work: Floats) -> None:
    """Choose how to go on from P and V: as before, with their sum, or with their sum in pairs."""
    n = covariance.shape[1]
    most = 0.0
    for a in range(n):
        variance = 0.0
        for d in range(n):
            variance += covariance[1, a, d] * covariance[1, a, d]
        most = max(most, variance)
    plain = settled(covariance[0], n, 1.0, work)
    status[COUNTDOWN] = min(LOOK_OPEN, interval)
    if plain and most > LEAST_FACTORED:
        return
    work[:] = covariance[1]
    covariance[1] = 0.0
    for a in range(n):
        for b in range(n):
            high, low = covariance[0, a, b], 0.0
            for d in range(n):
                high, low = add_product(high, low, work[a, d], 0.0, work[b, d], 0.0)
            covariance[0, a, b], covariance[1, a, b] = high, low
    # Whether pairs are needed, the next look tells.
    status[TWOFOLD] = PAIRS
    status[COUNTDOWN] = 0


@compiled
def filter_open(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, span: Span, walk: Floats,
    mean: Floats, covariance: Floats, innovations: Floats, roots: Floats, outputs: Outputs, amplitude: Floats,
    variance: Floats,
) -> None:  # fmt: skip
    """Filter the samples of a span, whose phasors stand from `offset` on.

    One by one: what little the first samples tell hangs on every digit, which sums over eight round differently
    wherever a record is cut. The other parameters are as for `filter_samples`.
    """
    channels, n = mean.shape[1], mean.shape[2]
    stride = n + -n % WIDE
    # P, V, V^T; then vectors: h, the gain, a, V a, what V's columns change by, the variances V leaves open, the means.
    room = aligned(stride * (3 * n + 6 + channels))
    factor_, turned, h = n * stride, 2 * n * stride, 3 * n * stride
    middle = h + 6 * stride
    for a in range(n):
        for b in range(n):
            room[a * stride + b] = covariance[0, a, b]
            room[factor_ + a * stride + b] = room[turned + b * stride + a] = covariance[1, a, b]
            room[h + 5 * stride + a] += covariance[1, a, b] * covariance[1, a, b]
        for channel in range(channels):
            room[middle + channel * stride + a] = mean[0, channel, a]
    _take_all(places, cosine, sine, offset, x, span, walk, n, room, innovations, roots, outputs, amplitude, variance)
    for a in range(n):
        for b in range(n):
            covariance[0, a, b] = room[a * stride + b]
            covariance[1, a, b] = room[factor_ + a * stride + b]
        for channel in range(channels):
            mean[0, channel, a] = room[middle + channel * stride + a]


@compiled_inside
def _take_all(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, span: Span, walk: Floats, n: int,
    room: Floats, innovations: Floats, roots: Floats, outputs: Outputs, amplitude: Floats, variance: Floats,
) -> None:  # fmt: skip
    """Take the samples in, one by one."""
    (start, stop), (following, every, output) = span, outputs
    stride = n + -n % WIDE
    h = 3 * n * stride
    for i in range(start, stop):
        if np.isnan(x[0, i]):
            roots[i, 0] = 0.0
            innovations[i, 0] = 0.0
        else:
            for k in range(places.shape[1]):
                room[h + places[1, k]] = cosine[places[0, k], offset + i - start]
                if places[2, k] >= 0:
                    room[h + places[2, k]] = -sine[places[0, k], offset + i - start]
            roots[i, 0] = _take(room, n, stride, x, i, innovations)
        if i == following:
            _put(places, room, n, stride, len(x), output, amplitude, variance)
            following += every
            output += 1
        row = (i if len(walk) > 1 else 0) * n
        for a in range(n):
            # As lanes: what is loaded as lanes soon should be stored as lanes.
            k = a * stride + a - a % WIDE
            diagonal = load_wide(_SELF, WIDE * (a % WIDE))
            store(room, k, multiply_add(repeat_wide(walk, row + a), diagonal, load_wide(room, k)))


@compiled_inside
def _dot(room: Floats, one: int, other: int, stride: int) -> float:
    lanes = spread_wide(0.0)
    for b in range(0, stride, WIDE):
        lanes = multiply_add(load_wide(room, one + b), load_wide(room, other + b), lanes)
    return float(total(lanes))


@compiled_inside
def _take(room: Floats, n: int, stride: int, x: Floats, i: int, innovations: Floats) -> float:
    """Take a sample in, with the room as `filter_open` fills it. Return one over the innovation's deviation."""
    factor_, turned, h = n * stride, 2 * n * stride, 3 * n * stride
    gain, told, reach, change, middle = h + stride, h + 2 * stride, h + 3 * stride, h + 4 * stride, h + 6 * stride
    for b in range(0, stride, WIDE):
        even, odd, even_told, odd_told = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
        for a in range(0, n, 2):
            k = a * stride + b
            weight = repeat_wide(room, h + a)
            even = multiply_add(weight, load_wide(room, k), even)
            even_told = multiply_add(weight, load_wide(room, factor_ + k), even_told)
            weight = repeat_wide(room, h + a + 1)
            odd = multiply_add(weight, load_wide(room, k + stride), odd)
            odd_told = multiply_add(weight, load_wide(room, factor_ + k + stride), odd_told)
        store(room, gain + b, plus(even, odd))
        store(room, told + b, plus(even_told, odd_told))
    root = 1.0 / np.sqrt(1.0 + _dot(room, h, gain, stride))
    scale = spread_wide(root)
    for b in range(0, stride, WIDE):
        store(room, gain + b, times(load_wide(room, gain + b), scale))
        store(room, told + b, times(load_wide(room, told + b), scale))
    own = _dot(room, told, told, stride)
    deviation = np.sqrt(1.0 + own)
    share = spread_wide(1.0 / (deviation * (deviation + 1.0)))
    for b in range(0, stride, WIDE):
        even, odd = times(spread_wide(-own), load_wide(room, gain + b)), spread_wide(0.0)
        for d in range(0, n, 2):
            k = turned + d * stride + b
            even = multiply_add(repeat_wide(room, told + d), load_wide(room, k), even)
            odd = multiply_add(repeat_wide(room, told + d + 1), load_wide(room, k + stride), odd)
        even = plus(even, odd)
        store(room, reach + b, even)
        store(room, change + b, negative(multiply_add(share, even, load_wide(room, gain + b))))
    for channel in range(len(x)):
        at = middle + channel * stride
        new = (x[channel, i] - _dot(room, h, at, stride)) * root
        innovations[i, 0, channel] = new / deviation
        one, other = spread_wide(new), spread_wide(new / (1.0 + own))
        for b in range(0, stride, WIDE):
            level = multiply_add(one, load_wide(room, gain + b), load_wide(room, at + b))
            store(room, at + b, multiply_add(other, load_wide(room, reach + b), level))
    _spread(room, n, stride)
    return float(root / deviation)


@compiled_inside
def _spread(room: Floats, n: int, stride: int) -> None:
    """Subtract from P, V and V^T what a sample tells, and fill in the variances V leaves open."""
    factor_, turned, h = n * stride, 2 * n * stride, 3 * n * stride
    gain, told, change, left = h + stride, h + 2 * stride, h + 4 * stride, h + 5 * stride
    for b in range(0, stride, WIDE):
        own_gain, own_told = load_wide(room, gain + b), load_wide(room, told + b)
        own_change, squares = load_wide(room, change + b), spread_wide(0.0)
        own_gain = negative(own_gain)
        for a in range(n):
            k = a * stride + b
            store(room, k, multiply_add(repeat_wide(room, gain + a), own_gain, load_wide(room, k)))
            k = factor_ + a * stride + b
            store(room, k, multiply_add(repeat_wide(room, change + a), own_told, load_wide(room, k)))
            k = turned + a * stride + b
            value = multiply_add(repeat_wide(room, told + a), own_change, load_wide(room, k))
            store(room, k, value)
            squares = multiply_add(value, value, squares)
        store(room, left + b, squares)


@compiled_inside
def _put(
    places: Integers, room: Floats, n: int, stride: int, channels: int, output: int, amplitude: Floats,
    variance: Floats,
) -> None:  # fmt: skip
    left, middle = (3 * n + 5) * stride, (3 * n + 6) * stride
    for k in range(places.shape[1]):
        real, imaginary = places[1, k], places[2, k]
        for channel in range(channels):
            at = middle + channel * stride
            amplitude[channel, k, 2 * output] = room[at + real]
            amplitude[channel, k, 2 * output + 1] = room[at + imaginary] if imaginary >= 0 else 0.0
        both = room[real * (stride + 1)] + room[left + real]
        if imaginary >= 0:
            both = 0.5 * (both + room[imaginary * (stride + 1)] + room[left + imaginary])
        variance[k, output] = both
