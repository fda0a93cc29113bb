"""The filter of harmonics eight samples at a time: what they measure, `_octet_kernels`, and where outputs go."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_inside
from signals._lanes import WIDE, load_wide, negative, plus, spread_wide, store, times, total
from signals._tiles import pairs_transposed, transposed
from signals.harmonics._octet_kernels import (
    AHEAD,
    SECTIONS,
    STEPS,
    VARIANCES,
    WALKED,
    H,
    aligned,
    close_octet,
    entry,
    follow,
    innovate,
    open_octet,
    place,
    section,
    spread_variances,
)
from signals.harmonics._open_kernels import Outputs, Span

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns, and those that tiles hold.
Sizes = tuple[int, int]
# The room; the means predicted for the next sample, (channel, stride), and filtered, (channel, tile, sample, column);
# data and innovations, (channel, sample); one over the standard deviations of these.
Work = tuple[Floats, Floats, Floats, Floats, Floats, Floats]
# Orders whose pairs of columns fill lanes.
_ORDERS = WIDE // 2


@compiled
def filter_eights(
    places: Integers, cosine: Floats, sine: Floats, offset: int, x: Floats, span: Span, walk: Floats,
    mean: Floats, covariance: Floats, innovations: Floats, roots: Floats, outputs: Outputs, amplitude: Floats,
    variance: Floats,
) -> None:  # fmt: skip
    """Filter the samples of a span, whose phasors stand from `offset` on, with one pole and doubles.

    In the room the two columns of an order stand side by side, the second empty where there is no imaginary part.
    """
    channels, orders = len(x), places.shape[1]
    columns = 2 * orders + 2 * orders % _ORDERS
    stride = columns + -columns % WIDE
    room, middle, levels = (
        aligned(section(SECTIONS, stride)),
        aligned(stride * channels),
        aligned(WIDE * stride * channels),
    )
    data, found, own_roots = aligned(WIDE * channels), aligned(WIDE * channels), aligned(WIDE)
    _carry(True, places, stride, room, middle, mean, covariance)
    _take(
        places, (cosine, sine), offset, x, span, walk, (columns, stride),
        (room, middle, levels, data, found, own_roots), innovations, roots, outputs, amplitude, variance,
    )  # fmt: skip
    _carry(False, places, stride, room, middle, mean, covariance)


@compiled_inside
def _take(
    places: Integers, phasors: tuple[Floats, Floats], offset: int, x: Floats, span: Span, walk: Floats, sizes: Sizes,
    work: Work, innovations: Floats, roots: Floats, outputs: Outputs, amplitude: Floats, variance: Floats,
) -> None:  # fmt: skip
    """Take the samples in, eight by eight."""
    (start, stop), (following, every, output), (columns, stride) = span, outputs, sizes
    (cosine, sine), (room, middle, levels, data, found, own_roots) = phasors, work
    for first in range(start, stop, WIDE):
        count = min(WIDE, stop - first)
        complete = count == WIDE and _complete(x, first)
        steady = len(walk) == 1 and count == WIDE and first > start
        _measure(places, cosine, sine, offset + first - start, x, first, count, complete, room, stride, data)
        if not steady:
            _walk_to(places, walk, first, count, room, stride)
        open_octet(room, columns, stride, own_roots)
        if first > start:
            # The outputs of the eight before wait till here, where the processor waits for eight divisions in turn.
            follow(room, stride, middle, found, levels)
            spread_variances(room, stride)
            following, output = _emit(
                places, room, stride, levels, first - WIDE, first, following, every, output, amplitude, variance
            )
        innovate(room, columns, stride, middle, data, found)
        if not steady:
            _walk_on(places, walk, first, count, room, stride)
        close_octet(room, columns, stride)
        _note(x, first, count, complete, own_roots, found, innovations, roots)
    follow(room, stride, middle, found, levels)
    spread_variances(room, stride)
    rest = start + (stop - start - 1) // WIDE * WIDE
    _emit(places, room, stride, levels, rest, stop, following, every, output, amplitude, variance)


@compiled_inside
def _note(
    x: Floats, first: int, count: int, complete: bool, own_roots: Floats, found: Floats, innovations: Floats,
    roots: Floats,
) -> None:  # fmt: skip
    """Write down the innovations of eight samples."""
    channels = len(x)
    if complete and channels == 1:
        store(roots, first, load_wide(own_roots, 0))
        store(innovations, first, load_wide(found, 0))
        return
    for i in range(count):
        roots[first + i, 0] = 0.0 if np.isnan(x[0, first + i]) else own_roots[i]
        for k in range(channels):
            innovations[first + i, 0, k] = found[k * WIDE + i]


@compiled_inside
def _carry(
    into: bool, places: Integers, stride: int, room: Floats, middle: Floats, mean: Floats, covariance: Floats
) -> None:
    """Copy a state into the room or, as it is then, back."""
    for k in range(places.shape[1]):
        for part in range(1, 3):
            a, row = places[part, k], 2 * k + part - 1
            if a < 0:
                continue
            for channel in range(mean.shape[1]):
                if into:
                    middle[channel * stride + row] = mean[0, channel, a]
                else:
                    mean[0, channel, a] = middle[channel * stride + row]
            for other in range(k + 1):
                for beside in range(1, 3):
                    b, column = places[beside, other], 2 * other + beside - 1
                    if b < 0 or column > row:
                        continue
                    if into:
                        room[entry(row, column, stride)] = covariance[0, a, b]
                        if row // WIDE == column // WIDE:
                            # The tile on the diagonal is whole.
                            room[entry(column, row, stride)] = covariance[0, a, b]
                    else:
                        covariance[0, a, b] = covariance[0, b, a] = room[entry(row, column, stride)]


@compiled_inside
def _complete(x: Floats, first: int) -> bool:
    """Tell whether none of eight samples is missing. No is said as well where their sum overflows."""
    return bool(np.isfinite(total(load_wide(x, first))))


@compiled_inside
def _walk_to(places: Integers, walk: Floats, first: int, count: int, room: Floats, stride: int) -> None:
    """Fill in the variances that are walked from the first of the samples to each."""
    walked = section(WALKED, stride)
    for k in range(places.shape[1]):
        for part in range(1, 3):
            a, so_far = places[part, k], 0.0
            if a >= 0:
                for i in range(count):
                    room[walked + WIDE * (2 * k + part - 1) + i] = so_far
                    so_far += walk[first + i if len(walk) > 1 else 0, a]


@compiled_inside
def _walk_on(places: Integers, walk: Floats, first: int, count: int, room: Floats, stride: int) -> None:
    """Fill in the variances that are walked from each sample to the next, and in all."""
    steps, ahead = section(STEPS, stride), section(AHEAD, stride)
    for k in range(places.shape[1]):
        for part in range(1, 3):
            a, to, so_far = places[part, k], 2 * k + part - 1, 0.0
            if a >= 0:
                for i in range(count):
                    step = walk[first + i if len(walk) > 1 else 0, a]
                    room[steps + place(to) + WIDE * i] = step
                    so_far += step
                room[ahead + to] = so_far


@compiled_inside
def _measure(
    places: Integers, cosine: Floats, sine: Floats, at: int, x: Floats, first: int, count: int, complete: bool,
    room: Floats, stride: int, data: Floats,
) -> None:  # fmt: skip
    """Fill in what eight samples measure and found: nothing where they are missing, or beyond the count."""
    h = section(H, stride)
    if complete:
        for channel in range(len(x)):
            store(data, WIDE * channel, load_wide(x, channel * x.shape[1] + first))
        for k in range(places.shape[1]):
            start = places[0, k] * cosine.shape[1] + at
            store(room, h + 2 * WIDE * k, load_wide(cosine, start))
            if places[2, k] >= 0:
                store(room, h + 2 * WIDE * k + WIDE, negative(load_wide(sine, start)))
        return
    for i in range(WIDE):
        seen = i < count and not np.isnan(x[0, first + i])
        for channel in range(len(x)):
            data[WIDE * channel + i] = x[channel, first + i] if seen else 0.0
        for k in range(places.shape[1]):
            row, to = places[0, k], h + 2 * WIDE * k + i
            room[to] = cosine[row, at + i] if seen else 0.0
            if places[2, k] >= 0:
                room[to + WIDE] = -sine[row, at + i] if seen else 0.0


@compiled_inside
def _emit(
    places: Integers, room: Floats, stride: int, levels: Floats, first: int, last: int, following: int, every: int,
    output: int, amplitude: Floats, variance: Floats,
) -> tuple[int, int]:  # fmt: skip
    """Put those of eight outputs that are wanted in their places. Return what comes next, and where it goes."""
    if following >= last:
        return following, output
    variances, orders = section(VARIANCES, stride), len(variance)
    if every == 1 and last - first == WIDE:
        for channel in range(len(amplitude)):
            for tile in range(0, orders, _ORDERS):
                for half in range(0, WIDE, _ORDERS):
                    lanes = pairs_transposed(levels, channel * WIDE * stride + 2 * WIDE * tile + WIDE * half, WIDE)
                    to = (channel * orders + tile) * amplitude.shape[2] + 2 * (output + half)
                    _put(lanes, amplitude, to, amplitude.shape[2], orders - tile)
        for tile in range(0, orders, _ORDERS):
            parts = transposed(room, variances + 2 * WIDE * tile, WIDE)
            half = spread_wide(0.5)
            a, b = times(half, plus(parts[0], parts[1])), times(half, plus(parts[2], parts[3]))
            c, d = times(half, plus(parts[4], parts[5])), times(half, plus(parts[6], parts[7]))
            _put((a, b, c, d), variance, tile * variance.shape[1] + output, variance.shape[1], orders - tile)
            for k in range(tile, min(tile + _ORDERS, orders)):
                if places[2, k] < 0:
                    for i in range(WIDE):
                        variance[k, output + i] *= 2.0
        return last, output + WIDE
    while following < last:
        i = following - first
        for k in range(orders):
            for channel in range(len(amplitude)):
                at = channel * WIDE * stride + place(2 * k) + WIDE * i
                amplitude[channel, k, 2 * output] = levels[at]
                amplitude[channel, k, 2 * output + 1] = levels[at + 1]
            at = variances + place(2 * k) + WIDE * i
            variance[k, output] = room[at] if places[2, k] < 0 else 0.5 * (room[at] + room[at + 1])
        following += every
        output += 1
    return following, output


@compiled_inside
def _put(lanes: tuple[Floats, Floats, Floats, Floats], target: Floats, to: int, apart: int, count: int) -> None:
    """Put up to four times eight numbers in a flat array, so far apart."""
    store(target, to, lanes[0])
    if count > 1:
        store(target, to + apart, lanes[1])
    if count > 2:  # noqa: PLR2004
        store(target, to + 2 * apart, lanes[2])
    if count > 3:  # noqa: PLR2004
        store(target, to + 3 * apart, lanes[3])
