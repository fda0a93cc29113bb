"""The compiled inner loops of angular resampling."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._lanes import WIDE, load_wide, multiply_add, plus, powers, spread_wide, store, times, total

Array = NDArray[np.float64]

_TOGETHER = 4  # neighbouring outputs share the reading of moments and weights
_HALVINGS = 60  # down to rounding


@compiled
def hermite(values: Array, slopes: Array, step: int, skip: int, out: Array, out_slopes: Array) -> None:
    """Cubics through `values` with `slopes` (a sample), `step` samples apart, at every sample from `skip` on."""
    h = float(step)
    for cell in range(skip // step, (skip + out.size - 1) // step + 1):
        begin = cell * step - skip
        value = values[cell]
        rise = values[cell + 1] - value
        early, late = h * slopes[cell] - rise, rise - h * slopes[cell + 1]
        for i in range(max(begin, 0), min(begin + step, out.size)):
            u = (i - begin) / h
            bend = early + u * (late - early)
            out[i] = value + u * rise + u * (1 - u) * bend
            out_slopes[i] = (rise + (1 - 2 * u) * bend + u * (1 - u) * (late - early)) / h


@compiled
def places_of(q: Array, slopes: Array, first: float, out: Array, out_slopes: Array) -> None:
    """Find where the rising `q`, known at whole places with its `slopes`, reaches first, first + 1, ...

    Solved on the cubic between two places: ``u rise + u (1 - u) bend(u) = target``. Where the bend is below 1e-4 of
    the rise, as almost everywhere, two rounds of ``u = (target - u (1 - u) bend(u)) / rise`` leave 3e-13; elsewhere
    Newton's method, halving where a step leaves the bracket. Beyond the ends it is the end. `out_slopes` is the slope
    of `q` there.
    """
    n = -1
    early = late = rise = reciprocal = 0.0
    gentle = False
    for m in range(out.size):
        wanted = first + m
        if n < 0 or (n < q.size - 2 and q[n + 1] <= wanted):
            n = max(n, 0)
            while n < q.size - 2 and q[n + 1] <= wanted:
                n += 1
            rise = q[n + 1] - q[n]
            early, late = slopes[n] - rise, rise - slopes[n + 1]
            gentle = abs(early) + abs(late) < 1e-4 * rise
            reciprocal = 1 / rise if gentle else 0.0
        target = min(max(wanted - q[n], 0.0), max(rise, 0.0))
        if gentle:
            start = target * reciprocal
            u = start - start * (1 - start) * (early + start * (late - early)) * reciprocal
            u = start - u * (1 - u) * (early + u * (late - early)) * reciprocal
        else:
            u = _solved(rise, early, late, target)
        bend = early + u * (late - early)
        out[m] = n + u
        out_slopes[m] = max(rise + (1 - 2 * u) * bend + u * (1 - u) * (late - early), 0.0)


@compiled
def _solved(rise: float, early: float, late: float, target: float) -> float:
    """Root of ``u rise + u (1 - u) (early + u (late - early)) = target`` between 0 and 1."""
    low, high = 0.0, 1.0
    u = target / rise if rise > 0 else 0.0
    for _ in range(_HALVINGS):
        bend = early + u * (late - early)
        beyond = u * rise + u * (1 - u) * bend - target
        slope = rise + (1 - 2 * u) * bend + u * (1 - u) * (late - early)
        if beyond > 0:
            high = u
        else:
            low = u
        following = u - beyond / slope if slope > 0 else -1.0
        if not low <= following <= high:
            following = low + (high - low) / 2
        moved = abs(following - u)
        u = following
        if moved < 1e-13:  # noqa: PLR2004
            break
    return u


@compiled
def interpolate(x: Array, places: Array, cuts: Array, rows: Array, out: Array) -> None:
    """Weigh the samples about each place whose cut-off is that of `x` itself; 0 for the others.

    ``out[m] = sum_n x[n] g(places[m] - n)``, with the weights on cubics through four of `rows`, whose length is a
    multiple of 8. `x` must reach half a row beyond every place.
    """
    taps, fractions = rows.shape[1], rows.shape[0] - 3
    weights = rows.ravel()
    for m in range(places.size):
        if cuts[m] < 1:
            out[m] = 0.0
            continue
        whole = np.floor(places[m])
        fraction = (places[m] - whole) * fractions
        row = int(fraction)
        u = fraction - row
        n, at = int(whole) - taps // 2 + 1, row * taps
        before, here, there, after = spread_wide(0.0), spread_wide(0.0), spread_wide(0.0), spread_wide(0.0)
        for i in range(at, at + taps, WIDE):
            samples = load_wide(x, n)
            before = multiply_add(load_wide(weights, i), samples, before)
            here = multiply_add(load_wide(weights, i + taps), samples, here)
            there = multiply_add(load_wide(weights, i + 2 * taps), samples, there)
            after = multiply_add(load_wide(weights, i + 3 * taps), samples, after)
            n += WIDE
        inner, outer = (u + 1) * (u - 2) / 2, u * (u - 1) / 6
        sums = times(before, spread_wide(-outer * (u - 2)))
        sums = multiply_add(here, spread_wide(inner * (u - 1)), sums)
        sums = multiply_add(there, spread_wide(-inner * u), sums)
        out[m] = total(multiply_add(after, spread_wide(outer * (u + 1)), sums))


@compiled
def gather(x: Array, q: Array, slopes: Array, first: int, moments: Array) -> None:
    """Add each sample, times its share of `q`, to the moments of the step of `q` that it lies in.

    ``moments[c - first, k] += x[n] slopes[n] v_n^k``, k = 0 .. 7, where v goes from -1 to 1 across step c. Steps that
    `moments` (steps, 8) does not hold are left out.
    """
    flat, steps = moments.ravel(), moments.shape[0]
    held, sums = -1, spread_wide(0.0)
    for n in range(x.size):
        floor = np.floor(q[n])
        step = int(floor) - first
        if step < 0 or step >= steps:
            continue
        if step != held:
            if held >= 0:
                store(flat, held * WIDE, sums)
            held, sums = step, load_wide(flat, step * WIDE)
        sums = multiply_add(spread_wide(x[n] * slopes[n]), powers(2 * (q[n] - floor) - 1), sums)
    if held >= 0:
        store(flat, held * WIDE, sums)


@compiled
def weigh(moments: Array, weights: Array, cuts: Array, out: Array) -> None:
    """Weigh the moments of the steps about each output whose cut-off lies below that of the record.

    ``out[m] = sum over steps i and powers k of weights[i, k] moments[m + i, k]``, k = 0 .. 7, an even number of steps;
    other outputs are left as they are. Four outputs share the reading of both, each a step behind the one before;
    `moments` must hold what the last four would need. A sum never reads a step beyond its own, be it times nothing:
    what is not a number stays where it is.
    """
    rows, every = moments.ravel(), weights.ravel()
    first, second = load_wide(every, 0), load_wide(every, WIDE)
    third, fourth = load_wide(every, 2 * WIDE), load_wide(every, 3 * WIDE)
    for m in range(0, out.size, _TOGETHER):
        alone = min(_TOGETHER, out.size - m)
        lowest = 1.0
        for i in range(alone):
            lowest = min(lowest, cuts[m + i])
        if lowest >= 1:
            continue
        at = m * WIDE
        row, other = load_wide(rows, at), load_wide(rows, at + WIDE)
        s0, t0, s1 = times(row, first), times(other, second), times(other, first)
        row, other = load_wide(rows, at + 2 * WIDE), load_wide(rows, at + 3 * WIDE)
        s0, t0 = multiply_add(row, third, s0), multiply_add(other, fourth, t0)
        t1, s1 = times(row, second), multiply_add(other, third, s1)
        s2, t2, s3, t3 = times(row, first), times(other, second), times(other, first), spread_wide(0.0)
        w1, w2, w3 = fourth, third, second
        for i in range(_TOGETHER * WIDE, every.size, 2 * WIDE):
            row, other = load_wide(rows, at + i), load_wide(rows, at + i + WIDE)
            w0, w = load_wide(every, i), load_wide(every, i + WIDE)
            s0, t0 = multiply_add(row, w0, s0), multiply_add(other, w, t0)
            s1, t1 = multiply_add(row, w1, s1), multiply_add(other, w0, t1)
            s2, t2 = multiply_add(row, w2, s2), multiply_add(other, w1, t2)
            s3, t3 = multiply_add(row, w3, s3), multiply_add(other, w2, t3)
            w1, w2, w3 = w, w0, w1
        at += every.size
        row, other = load_wide(rows, at), load_wide(rows, at + WIDE)
        s1, s2, t2 = multiply_add(row, w1, s1), multiply_add(row, w2, s2), multiply_add(other, w1, t2)
        s3, t3 = multiply_add(row, w3, s3), multiply_add(other, w2, t3)
        s3 = multiply_add(load_wide(rows, at + 2 * WIDE), w1, s3)
        sums = (total(plus(s0, t0)), total(plus(s1, t1)), total(plus(s2, t2)), total(plus(s3, t3)))
        for i, found in enumerate(sums):
            if i < alone and cuts[m + i] < 1:
                out[m + i] = found


@compiled
def linear(x: Array, places: Array, least: int, most: int, out: Array) -> None:
    """Straight lines between the samples from `least` to `most`."""
    for m in range(places.size):
        n = min(max(int(np.floor(places[m])), least), most - 1)
        u = places[m] - n
        out[m] = x[n] + u * (x[n + 1] - x[n]) if u > 0 else x[n]


@compiled
def cubic(x: Array, places: Array, least: int, most: int, out: Array) -> None:
    """Cubics through the four samples about each place (Lagrange), the outer four at the ends."""
    for m in range(places.size):
        n = min(max(int(np.floor(places[m])), least + 1), most - 2)
        u = places[m] - n
        a, b, c, d = x[n - 1], x[n], x[n + 1], x[n + 2]
        inner = (1 - u) * b + u * c
        left, right = 2 * b - a - c, 2 * c - b - d
        out[m] = inner + u * (1 - u) * ((2 - u) * left + (1 + u) * right) / 6
