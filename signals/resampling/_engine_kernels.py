"""The compiled inner loops of angular resampling."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums

Array = NDArray[np.float64]


@compiled
def hermite(values: Array, slopes: Array, step: int, skip: int, out: Array, out_slopes: Array) -> None:
    """Evaluate Hermite cubics through `values`, `slopes` (per sample), `step` apart, at every sample from `skip`."""
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
def invert(q: Array, slopes: Array, first: float, out: Array, out_slopes: Array) -> None:
    """Invert the increasing `q`, given at 0, 1, 2, ... with its `slopes`, at the values first, first + 1, ...

    Solved on the Hermite cubic between two samples: ``u rise + u (1 - u) bend(u) = target``. Where the bend is below
    1e-4 of the rise, as almost everywhere, two fixed-point iterations ``u = (target - u (1 - u) bend(u)) / rise`` leave
    an error of 3e-13; elsewhere Newton's method with bisection is used. Values beyond the ends give the end.
    `out_slopes` is the slope of `q` at the solution.
    """
    n = -1
    early = late = rise = reciprocal = 0.0
    gentle = False
    for m in range(out.size):
        value = first + m
        if n < 0 or (n < q.size - 2 and q[n + 1] <= value):
            n = max(n, 0)
            while n < q.size - 2 and q[n + 1] <= value:
                n += 1
            rise = q[n + 1] - q[n]
            early, late = slopes[n] - rise, rise - slopes[n + 1]
            gentle = abs(early) + abs(late) < 1e-4 * rise
            reciprocal = 1 / rise if gentle else 0.0
        target = min(max(value - q[n], 0.0), max(rise, 0.0))
        if gentle:
            start = target * reciprocal
            u = start - start * (1 - start) * (early + start * (late - early)) * reciprocal
            u = start - u * (1 - u) * (early + u * (late - early)) * reciprocal
        else:
            u = _cubic_root(rise, early, late, target)
        bend = early + u * (late - early)
        out[m] = n + u
        out_slopes[m] = max(rise + (1 - 2 * u) * bend + u * (1 - u) * (late - early), 0.0)


@compiled
def _cubic_root(rise: float, early: float, late: float, target: float) -> float:
    """Return the root of ``u rise + u (1 - u) (early + u (late - early)) = target`` between 0 and 1."""
    low, high = 0.0, 1.0
    u = target / rise if rise > 0 else 0.0
    bisections = 60  # down to rounding
    for _ in range(bisections):
        bend = early + u * (late - early)
        error = u * rise + u * (1 - u) * bend - target
        slope = rise + (1 - 2 * u) * bend + u * (1 - u) * (late - early)
        if error > 0:
            high = u
        else:
            low = u
        following = u - error / slope if slope > 0 else -1.0
        if not low <= following <= high:
            following = low + (high - low) / 2
        moved = abs(following - u)
        u = following
        if moved < 1e-13:  # noqa: PLR2004
            break
    return u


@compiled_sums
def interpolate(x: Array, positions: Array, slopes: Array, rows: Array, out: Array) -> None:
    """Interpolate ``out[:, m] = sum_n x[:, n] g(positions[m] - n)`` where the slope a is at least 1; 0 elsewhere.

    The weights g are interpolated by cubics through four of `rows`, once for all rows of `x`, which must extend half a
    row of weights beyond every position.
    """
    taps, fractions = rows.shape[1], rows.shape[0] - 3
    weights = np.empty(taps)
    for m in range(positions.size):
        if slopes[m] < 1:
            out[:, m] = 0.0
            continue
        whole = np.floor(positions[m])
        fraction = (positions[m] - whole) * fractions
        row = int(fraction)
        u = fraction - row
        inner, outer = (u + 1) * (u - 2) / 2, u * (u - 1) / 6
        before, here, there, after = -outer * (u - 2), inner * (u - 1), -inner * u, outer * (u + 1)
        for i in range(taps):
            weights[i] = before * rows[row, i] + here * rows[row + 1, i] + there * rows[row + 2, i]
            weights[i] += after * rows[row + 3, i]
        first = int(whole) - taps // 2 + 1
        for k in range(len(x)):
            samples = x[k, first : first + taps]
            total = 0.0
            for i in range(samples.size):
                total += weights[i] * samples[i]
            out[k, m] = total


@compiled
def _add_to_step(moments: Array, step: int, m0: float, m1: float, m2: float, m3: float, m4: float, m5: float, m6: float,
                 m7: float) -> None:  # fmt: skip
    """Add to the moments of a step, if it is within `moments`."""
    if 0 <= step < len(moments):
        own = moments[step]
        own[0] += m0
        own[1] += m1
        own[2] += m2
        own[3] += m3
        own[4] += m4
        own[5] += m5
        own[6] += m6
        own[7] += m7


@compiled
def add_moments(x: Array, q: Array, slopes: Array, first: int, moments: Array) -> None:
    """Add each sample, times the slope of `q` at it, to the moments of its step of the output grid.

    ``moments[c - first, k] += x[n] slopes[n] v_n^k``, k = 0 .. 7, where v goes from -1 to 1 across step c. Steps
    outside `moments` (steps, 8) are ignored.
    """
    step = -1
    m0 = m1 = m2 = m3 = m4 = m5 = m6 = m7 = 0.0  # of one step, in registers
    for n in range(x.size):
        floor = np.floor(q[n])
        here = int(floor) - first
        if here != step:
            _add_to_step(moments, step, m0, m1, m2, m3, m4, m5, m6, m7)
            step = here
            m0 = m1 = m2 = m3 = m4 = m5 = m6 = m7 = 0.0
        v, even = 2 * (q[n] - floor) - 1, x[n] * slopes[n]
        square, odd = v * v, even * v
        m0 += even
        m1 += odd
        even *= square
        odd *= square
        m2 += even
        m3 += odd
        even *= square
        odd *= square
        m4 += even
        m5 += odd
        m6 += even * square
        m7 += odd * square
    _add_to_step(moments, step, m0, m1, m2, m3, m4, m5, m6, m7)


@compiled_sums
def filter_moments(moments: Array, weights: Array, slopes: Array, out: Array) -> None:
    """Apply the filter to the moments of the steps about each output with slope a < 1; leave the others unchanged.

    ``out[m] = sum over steps i and powers k of weights[i, k] moments[m + i, k]``, k = 0 .. 7. No other step is read,
    even with a weight of zero, which would spread NaN.
    """
    flat, every = moments.ravel(), weights.ravel()
    powers, size = weights.shape[1], weights.size
    m = 0
    while m < out.size:
        first = m * powers
        if m + 3 < out.size and slopes[m : m + 4].max() < 1:
            # four outputs share the loaded weights
            a, b = flat[first : first + size], flat[first + powers : first + powers + size]
            c = flat[first + 2 * powers : first + 2 * powers + size]
            d = flat[first + 3 * powers : first + 3 * powers + size]
            sum_a, sum_b, sum_c, sum_d = 0.0, 0.0, 0.0, 0.0
            for i in range(size):
                sum_a += every[i] * a[i]
                sum_b += every[i] * b[i]
                sum_c += every[i] * c[i]
                sum_d += every[i] * d[i]
            out[m], out[m + 1], out[m + 2], out[m + 3] = sum_a, sum_b, sum_c, sum_d
            m += 4
            continue
        if slopes[m] < 1:
            own = flat[first : first + size]
            total = 0.0
            for i in range(size):
                total += every[i] * own[i]
            out[m] = total
        m += 1


@compiled
def linear(x: Array, positions: Array, least: int, most: int, out: Array) -> None:
    """Interpolate linearly between the samples from `least` to `most`."""
    for m in range(positions.size):
        n = min(max(int(np.floor(positions[m])), least), most - 1)
        u = positions[m] - n
        out[m] = x[n] + u * (x[n + 1] - x[n]) if u > 0 else x[n]


@compiled
def cubic(x: Array, positions: Array, least: int, most: int, out: Array) -> None:
    """Interpolate with the Lagrange cubic through the four samples about each position, the outermost at the ends."""
    for m in range(positions.size):
        n = min(max(int(np.floor(positions[m])), least + 1), most - 2)
        u = positions[m] - n
        a, b, c, d = x[n - 1], x[n], x[n + 1], x[n + 2]
        inner = (1 - u) * b + u * c
        left, right = 2 * b - a - c, 2 * c - b - d
        out[m] = inner + u * (1 - u) * ((2 - u) * left + (1 + u) * right) / 6
