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
    spread_wide,
    store,
    times,
    total,
)
from signals._tiles import load_tile, multiply_add_tile, spread_tile, store_tile, times_tile, totals
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

# Vectors in the room: h, the gain, a, what V a has become, what V's rows change by for each of a, what is walked;
# then the means.
H, GAIN, TOLD, REACH, CHANGE, WALK, MEANS = 0, 1, 2, 3, 4, 5, 6

_SELF, _NOTHING = np.eye(WIDE).ravel(), np.zeros(WIDE * WIDE)


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

    P and V stand in one flat array, the *room*, tile after tile, vectors after them; all filled up to whole tiles.
    """
    channels, n = mean.shape[1], mean.shape[2]
    stride = n + -n % WIDE
    room = aligned(_vector(MEANS + channels, stride))
    for a in range(n):
        for b in range(n):
            room[_entry(a, b, stride)] = covariance[0, a, b]
            room[stride * stride + _entry(a, b, stride)] = covariance[1, a, b]
        for channel in range(channels):
            room[_vector(MEANS + channel, stride) + a] = mean[0, channel, a]
    _take_all(places, cosine, sine, offset, x, span, walk, n, room, innovations, roots, outputs, amplitude, variance)
    for a in range(n):
        for b in range(n):
            covariance[0, a, b] = room[_entry(a, b, stride)]
            covariance[1, a, b] = room[stride * stride + _entry(a, b, stride)]
        for channel in range(channels):
            mean[0, channel, a] = room[_vector(MEANS + channel, stride) + a]


@compiled_inside
def _entry(row: int, column: int, stride: int) -> int:
    """Return where an entry of P is; the same entry of V is a square of strides further on."""
    return (row - row % WIDE) * stride + WIDE * (column - column % WIDE) + WIDE * (row % WIDE) + column % WIDE


@compiled_inside
def _vector(number: int, stride: int) -> int:
    """Return where a vector starts."""
    return stride * (2 * stride + number)


@compiled_inside
def _take_all(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, span: Span, walk: Floats, n: int,
    room: Floats, innovations: Floats, roots: Floats, outputs: Outputs, amplitude: Floats, variance: Floats,
) -> None:  # fmt: skip
    """Take the samples in, one by one."""
    (start, stop), (following, every, output) = span, outputs
    stride = n + -n % WIDE
    h, walked = _vector(H, stride), _vector(WALK, stride)
    for i in range(start, stop):
        if np.isnan(x[0, i]):
            roots[i, 0] = 0.0
            innovations[i, 0] = 0.0
        else:
            for k in range(places.shape[1]):
                room[h + places[1, k]] = cosine[places[0, k], offset + i - start]
                if places[2, k] >= 0:
                    room[h + places[2, k]] = -sine[places[0, k], offset + i - start]
            roots[i, 0] = _take(room, stride, x, i, innovations)
        if i == following:
            _put(places, room, stride, len(x), output, amplitude, variance)
            following += every
            output += 1
        if i == start or len(walk) > 1:
            for a in range(n):
                room[walked + a] = walk[i if len(walk) > 1 else 0, a]
        for a in range(0, stride, WIDE):
            k = _entry(a, a, stride)
            store_tile(room, k, multiply_add_tile(load_tile(_SELF, 0), load_wide(room, walked + a), load_tile(room, k)))


@compiled_inside
def _take(room: Floats, stride: int, x: Floats, i: int, innovations: Floats) -> float:
    """Take a sample in, with the room as `filter_open` fills it. Return one over the innovation's deviation."""
    square, h, gain, told = stride * stride, _vector(H, stride), _vector(GAIN, stride), _vector(TOLD, stride)
    reach, change, middle = _vector(REACH, stride), _vector(CHANGE, stride), _vector(MEANS, stride)
    for b in range(0, stride, WIDE):
        _weigh(room, b, stride)
    root = 1.0 / np.sqrt(1.0 + _dot(room, h, gain, stride))
    scale = spread_wide(root)
    for b in range(0, stride, WIDE):
        store(room, gain + b, times(load_wide(room, gain + b), scale))
        store(room, told + b, times(load_wide(room, told + b), scale))
    own = _dot(room, told, told, stride)
    deviation = np.sqrt(1.0 + own)
    share, less = spread_wide(1.0 / (deviation * (deviation + 1.0))), spread_wide(-own)
    for a in range(0, stride, WIDE):
        reached = _reached(room, square + stride * a, told, stride)
        own_gain = load_wide(room, gain + a)
        reached = multiply_add(less, own_gain, reached)
        store(room, reach + a, reached)
        store(room, change + a, negative(multiply_add(share, reached, own_gain)))
        _add_products(room, stride * a, gain + a, gain, -1.0, stride)
        _add_products(room, square + stride * a, change + a, told, 1.0, stride)
    for channel in range(len(x)):
        at = middle + channel * stride
        new = (x[channel, i] - _dot(room, h, at, stride)) * root
        innovations[i, 0, channel] = new / deviation
        one, other = spread_wide(new), spread_wide(new / (1.0 + own))
        for b in range(0, stride, WIDE):
            level = multiply_add(one, load_wide(room, gain + b), load_wide(room, at + b))
            store(room, at + b, multiply_add(other, load_wide(room, reach + b), level))
    return float(root / deviation)


@compiled_inside
def _dot(room: Floats, one: int, other: int, stride: int) -> float:
    lanes = spread_wide(0.0)
    for b in range(0, stride, WIDE):
        lanes = multiply_add(load_wide(room, one + b), load_wide(room, other + b), lanes)
    return float(total(lanes))


@compiled_inside
def _weigh(room: Floats, column: int, stride: int) -> None:
    """Find eight numbers of the gain and of a, not yet scaled."""
    h, known, left = _vector(H, stride), load_tile(_NOTHING, 0), load_tile(_NOTHING, 0)
    for a in range(0, stride, WIDE):
        k, weights = stride * a + WIDE * column, spread_tile(room, h + a)
        known = multiply_add_tile(weights, load_tile(room, k), known)
        left = multiply_add_tile(weights, load_tile(room, stride * stride + k), left)
    store(room, _vector(GAIN, stride) + column, _summed(known))
    store(room, _vector(TOLD, stride) + column, _summed(left))


@compiled_inside
def _summed(tile):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  (lanes)
    """Return the sum of a tile's rows."""
    early = plus(plus(tile[0], tile[1]), plus(tile[2], tile[3]))
    return plus(early, plus(plus(tile[4], tile[5]), plus(tile[6], tile[7])))


@compiled_inside
def _reached(room, at, weights, stride):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  (lanes)
    """Return the sums of eight rows' columns, each with its weight."""
    sums = load_tile(_NOTHING, 0)
    for b in range(0, stride, WIDE):
        sums = multiply_add_tile(load_tile(room, at + WIDE * b), load_wide(room, weights + b), sums)
    return totals(sums)


@compiled_inside
def _add_products(room: Floats, at: int, weights: int, row: int, sign: float, stride: int) -> None:
    """Add a row to eight rows, each times its weight."""
    numbers, lanes = spread_tile(room, weights), spread_wide(sign)
    for b in range(0, stride, WIDE):
        k = at + WIDE * b
        store_tile(room, k, multiply_add_tile(numbers, times(lanes, load_wide(room, row + b)), load_tile(room, k)))


@compiled_inside
def _put(
    places: Integers, room: Floats, stride: int, channels: int, output: int, amplitude: Floats, variance: Floats
) -> None:
    """Put an output in its place."""
    both, middle = _vector(REACH, stride), _vector(MEANS, stride)
    for a in range(0, stride, WIDE):
        sums = times_tile(load_tile(_SELF, 0), load_tile(room, _entry(a, a, stride)))
        for b in range(0, stride, WIDE):
            tile = load_tile(room, stride * (stride + a) + WIDE * b)
            sums = multiply_add_tile(tile, tile, sums)
        store(room, both + a, totals(sums))
    for k in range(places.shape[1]):
        real, imaginary = places[1, k], places[2, k]
        for channel in range(channels):
            at = middle + channel * stride
            amplitude[channel, k, 2 * output] = room[at + real]
            amplitude[channel, k, 2 * output + 1] = room[at + imaginary] if imaginary >= 0 else 0.0
        variance[k, output] = 0.5 * (room[both + real] + room[both + (imaginary if imaginary >= 0 else real)])
