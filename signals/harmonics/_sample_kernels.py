"""The filter of harmonics, from angles to complex amplitudes, piece by piece.

With one pole and doubles, samples are taken eight at a time (`_octet_kernels`); otherwise one by one
(`_filter_kernels`).
"""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import (
    WIDE,
    interleave,
    load_wide,
    multiply_add,
    negative,
    plus,
    repeat_wide,
    running_sums,
    spread_wide,
    store,
    times,
)
from signals.harmonics._filter_kernels import forward
from signals.harmonics._octet_kernels import close_octet, follow, innovate, open_octet
from signals.harmonics._phasors import Recipe, fill_rows
from signals.harmonics._settling_kernels import COUNTDOWN, TWOFOLD, look

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Samples whose phasors are held at a time: they stay in the nearest caches.
PIECE = 1024


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
    amplitude: Floats,
    variance: Floats,
) -> None:
    """Filter samples that measure harmonics.

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
    amplitude : (channel, order, 2 output) array, real and imaginary parts in turn, filled from there on.
    variance : (order, output) array, filled likewise: the mean over the quadratures.
    """
    samples, phasors, n = x.shape[1], recipe[0].size, mean.shape[2]
    cosine, sine = np.empty((phasors, PIECE)), np.empty((phasors, PIECE))
    work = np.empty((n, n))
    output = first_output
    for first in range(0, samples, PIECE):
        last = min(first + PIECE, samples)
        fill_rows(recipe, phase, first, last, cosine, sine)
        start = first
        while start < last:
            if status[COUNTDOWN] <= 0:
                look(status, interval, covariance, mean, walk.shape[1], 1.0, work)
            stop = min(last, start + status[COUNTDOWN])
            # A row of zeros stays at the reach of one.
            own = walk[start:stop] if len(walk) > 1 else walk
            if n == walk.shape[1] and status[TWOFOLD] == 0:
                output = _by_eights(
                    places, cosine, sine, start - first, x[:, start:stop], own, mean, covariance,
                    innovations[start:stop], roots[start:stop], wanted[start:stop], output, amplitude, variance,
                )  # fmt: skip
                status[COUNTDOWN] -= stop - start
            else:
                output = _by_ones(
                    places, cosine, sine, start - first, x[:, start:stop], own, interval, status, mean, covariance,
                    innovations[start:stop], roots[start:stop], wanted[start:stop], output, amplitude, variance,
                )  # fmt: skip
            start = stop


@compiled
def _by_ones(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, walk: Floats, interval: int,
    status: Integers, mean: Floats, covariance: Floats, innovations: Floats, roots: Floats, wanted: Flags,
    output: int, amplitude: Floats, variance: Floats,
) -> int:  # fmt: skip
    """Filter samples whose phasors stand from `offset` on; return the number of outputs so far."""
    channels, size = x.shape
    n, width = mean.shape[2], walk.shape[1]
    count = 0
    for i in range(size):
        count += wanted[i]
    rows, data = np.zeros((size, 1, width)), np.empty((size, 1, channels))
    means, variances = np.empty((count, 1, channels, width)), np.empty((count, width))
    for k in range(places.shape[1]):
        row, real, imaginary = places[0, k], places[1, k], places[2, k]
        for i in range(size):
            rows[i, 0, real] = cosine[row, offset + i]
            if imaginary >= 0:
                rows[i, 0, imaginary] = -sine[row, offset + i]
    for k in range(channels):
        for i in range(size):
            data[i, 0, k] = x[k, i]
    forward(
        rows, data, walk, 1.0, interval, status, mean, covariance, innovations, roots, wanted, means, variances,
        np.empty((0, 2, n, n)), np.empty(count, dtype=np.bool_),
    )  # fmt: skip
    for k in range(places.shape[1]):
        real, imaginary = places[1, k], places[2, k]
        for i in range(count):
            at = 2 * (output + i)
            for channel in range(channels):
                amplitude[channel, k, at] = means[i, 0, channel, real]
                amplitude[channel, k, at + 1] = means[i, 0, channel, imaginary] if imaginary >= 0 else 0.0
            both = variances[i, real]
            if imaginary >= 0:
                both = 0.5 * (both + variances[i, imaginary])
            variance[k, output + i] = both
    return output + count


@compiled
def _aligned(size: int) -> Floats:
    """Return zeros that begin where a line of the cache does."""
    room = np.zeros(size + WIDE)
    start = -(room.ctypes.data // room.itemsize) % WIDE
    return room[start : start + size]


@compiled
def _by_eights(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, walk: Floats, mean: Floats,
    covariance: Floats, innovations: Floats, roots: Floats, wanted: Flags, output: int, amplitude: Floats,
    variance: Floats,
) -> int:  # fmt: skip
    """Filter as `_by_ones` does, with one pole and doubles."""
    channels, size = x.shape
    n = walk.shape[1]
    stride = n + -n % WIDE
    h, cross, gains, levels = _aligned(WIDE * n), _aligned(WIDE * n), _aligned(WIDE * n), _aligned(WIDE * n * channels)
    data, found, own_roots = _aligned(WIDE * channels), _aligned(WIDE * channels), _aligned(WIDE)
    joint, white, across = _aligned(WIDE * WIDE), _aligned(WIDE * WIDE), _aligned(WIDE * stride)
    walked, last_walked = _aligned(WIDE * n), _aligned(WIDE * n)
    before, last_before = _aligned(n), _aligned(n)
    middle, inner = _aligned(n * channels), _aligned(n * stride)
    ahead, seen = np.empty(n), np.empty(WIDE, dtype=np.bool_)
    for a in range(n):
        for b in range(n):
            inner[a * stride + b] = covariance[0, a, b]
        for k in range(channels):
            middle[k * n + a] = mean[0, k, a]
    for first in range(0, size, WIDE):
        count = min(WIDE, size - first)
        if first < 2 * WIDE or len(walk) > 1 or count < WIDE:
            _walk_on(walk, first, count, walked, ahead)
        _measure(places, cosine, sine, offset + first, x, first, count, h, data, seen)
        open_octet(h, walked, inner, cross, joint, white, own_roots)
        if first:
            # The outputs of the eight before wait till here, where the processor waits for eight divisions in turn.
            follow(gains, found, middle, levels)
            output = _emit(
                places, levels, last_before, last_walked, gains, wanted[first - WIDE : first], joint, output,
                amplitude, variance,
            )  # fmt: skip
        innovate(h, data, middle, white, found)
        for a in range(n):
            before[a] = inner[a * stride + a]
        close_octet(cross, white, inner, gains, across)
        for a in range(n):
            inner[a * stride + a] += ahead[a]
        for i in range(count):
            roots[first + i, 0] = own_roots[i] if seen[i] else 0.0
            for k in range(channels):
                innovations[first + i, 0, k] = found[k * WIDE + i]
        walked, last_walked = last_walked, walked
        before, last_before = last_before, before
    follow(gains, found, middle, levels)
    rest = wanted[(size - 1) // WIDE * WIDE :]
    output = _emit(places, levels, last_before, last_walked, gains, rest, joint, output, amplitude, variance)
    for a in range(n):
        for b in range(a + 1):
            covariance[0, a, b] = covariance[0, b, a] = inner[a * stride + b]
        for k in range(channels):
            mean[0, k, a] = middle[k * n + a]
    return output


@compiled
def _walk_on(walk: Floats, first: int, count: int, walked: Floats, ahead: Floats) -> None:
    """Fill in the variances that are walked from the first of the samples to each, and to the one after the last."""
    for a in range(ahead.size):
        total = 0.0
        for i in range(WIDE):
            walked[WIDE * a + i] = total
            if i < count:
                total += walk[first + i if len(walk) > 1 else 0, a]
        ahead[a] = total


@compiled
def _measure(
    places: Integers, cosine: Floats, sine: Floats, at: int, x: Floats, first: int, count: int, h: Floats, data: Floats,
    seen: Flags,
) -> None:  # fmt: skip
    """Fill in what eight samples measure and found: nothing where they are missing, or beyond the count."""
    complete = count == WIDE
    for i in range(WIDE):
        seen[i] = i < count and not np.isnan(x[0, first + i])
        complete &= seen[i]
    for k in range(len(x)):
        for i in range(WIDE):
            data[WIDE * k + i] = x[k, first + i] if seen[i] else 0.0
    for k in range(places.shape[1]):
        row, real, imaginary = places[0, k], places[1, k], places[2, k]
        start = row * cosine.shape[1]
        if complete:
            store(h, WIDE * real, load_wide(cosine, start + at))
            if imaginary >= 0:
                store(h, WIDE * imaginary, negative(load_wide(sine, start + at)))
        else:
            for i in range(WIDE):
                h[WIDE * real + i] = cosine[row, at + i] if seen[i] else 0.0
                if imaginary >= 0:
                    h[WIDE * imaginary + i] = -sine[row, at + i] if seen[i] else 0.0


@compiled
def _emit(
    places: Integers, levels: Floats, before: Floats, walked: Floats, gains: Floats, wanted: Flags, room: Floats,
    output: int, amplitude: Floats, variance: Floats,
) -> int:  # fmt: skip
    """Put those of eight outputs that are wanted in their places, some by way of the room. Return the number so far."""
    outputs, columns, orders = 0, before.size, len(variance)
    for i in range(wanted.size):
        outputs += wanted[i]
    if outputs == 0:
        return output
    nothing = spread_wide(0.0)
    all_eight = outputs == WIDE
    for k in range(orders):
        real, imaginary = WIDE * places[1, k], WIDE * places[2, k]
        # What was open before and what is walked, less what is learnt.
        own = load_wide(gains, real)
        learnt = times(own, negative(own))
        still = plus(repeat_wide(before, places[1, k]), load_wide(walked, real))
        share = 1.0
        if imaginary >= 0:
            own = load_wide(gains, imaginary)
            learnt = multiply_add(own, negative(own), learnt)
            still = plus(still, plus(repeat_wide(before, places[2, k]), load_wide(walked, imaginary)))
            share = 0.5
        mean = times(spread_wide(share), plus(still, running_sums(learnt)))
        if all_eight:
            store(variance, k * variance.shape[1] + output, mean)
        else:
            store(room, 0, mean)
            _pick(wanted, room, 1, variance[k], output)
        for channel in range(len(amplitude)):
            start = WIDE * channel * columns
            part = load_wide(levels, start + imaginary) if imaginary >= 0 else nothing
            if all_eight:
                at = (channel * orders + k) * amplitude.shape[2] + 2 * output
                interleave(load_wide(levels, start + real), part, amplitude, at)
            else:
                interleave(load_wide(levels, start + real), part, room, 0)
                _pick(wanted, room, 2, amplitude[channel, k], output)
    return output + outputs


@compiled
def _pick(wanted: Flags, values: Floats, count: int, target: Floats, output: int) -> None:
    """Put the wanted ones of eight groups of `count` values in their places, from an output on."""
    at = count * output
    for i in range(wanted.size):
        if wanted[i]:
            for part in range(count):
                target[at + part] = values[count * i + part]
            at += count
