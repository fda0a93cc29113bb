"""Compiled look-ups in tables of periodic functions: values, and moments over an interval of phase.

Each operation is rounded as written, and functions that are inlined allocate no arrays.
"""

import math

import numpy as np

from data_synth.integrators.periodic_tables import Array, Waves
from signals._compile import compiled_exactly, compiled_inline

# cycles below which Gauss's rule is used, since the difference of two periodic integrals would lose digits
SHORT = 1.0 / 512
NEAR = 1e-9  # cycles: a jump this close beyond the upper end counts, since a value there may be that after it
LONGEST = 1.0 / 8  # longest interval in cycles for Gauss's rule with four points: error at most 2e-3 of harmonic 10
POINTS, WEIGHTS = (tuple((0.5 * (np.polynomial.legendre.leggauss(4)[i] + (1, 0)[i])).tolist()) for i in range(2))
OUTER_NODE = 0.5 * math.sqrt(0.6)  # distance of the outer two of three nodes from the middle
SLOPE_WEIGHT = 5 / 6 * math.sqrt(0.6)


@compiled_inline
def locate(waves: Waves, which: int, phase: float) -> tuple[int, float]:
    """Return the segment of a phase and the phase within the period."""
    period = waves.periods[which]
    x = phase - math.floor(phase / period) * period
    low, last = waves.segments[which], waves.segments[which + 1] - 1
    if low == last:
        return low, x
    place = waves.segments[which] + int(x * waves.lookup_rates[which])
    low = waves.lookup[min(place, waves.segments[which + 1] - 1)]
    while low < last and waves.starts[low + 1] <= x:
        low += 1
    return low, x


@compiled_inline
def cell_at(waves: Waves, segment: int, x: float) -> tuple[int, float]:
    """Return the cell at x and the position in it from 0 to 1."""
    u = (x - waves.starts[segment]) * waves.densities[segment]
    inside = min(int(u), waves.counts[segment] - 1)
    return waves.firsts[segment] + inside, u - inside


@compiled_inline
def value_in(waves: Waves, segment: int, x: float) -> float:
    """Return the function at x from the polynomial of a known segment."""
    cell, u = cell_at(waves, segment, x)
    c = waves.rows[cell]
    value: float = c[0] + u * (c[1] + u * (c[2] + u * (c[3] + u * (c[4] + u * c[5]))))
    return value


@compiled_inline
def value_at(waves: Waves, which: int, phase: float) -> float:
    """Return the function at a phase in cycles."""
    segment, x = locate(waves, which, phase)
    return value_in(waves, segment, x)


@compiled_inline
def edge_of(waves: Waves, which: int, segment: int) -> float:
    """Return the end of a segment."""
    last = segment + 1 == waves.segments[which + 1]
    edge: float = waves.periods[which] if last else waves.starts[segment + 1]
    return edge


@compiled_inline
def following(waves: Waves, which: int, segment: int) -> int:
    """Return the segment after one, or the first after the last."""
    after: int = waves.segments[which] if segment + 1 == waves.segments[which + 1] else segment + 1
    return after


@compiled_inline
def jumps_within(waves: Waves, which: int, start: float, stop: float) -> bool:
    """Return whether the function jumps or is steep in an interval, not counting its lower end."""
    low, left = min(start, stop), abs(stop - start)
    segment, x = locate(waves, which, low)
    while True:
        width = edge_of(waves, which, segment) - x
        if width > left + NEAR:
            return False
        segment = following(waves, which, segment)
        if waves.jumps[segment]:
            return True
        left -= max(width, 0.0)
        x = waves.starts[segment]


@compiled_exactly
def legendre_of_product(
    one: Waves, first: int, other: Waves, second: int, start: float, stop: float
) -> tuple[float, float, float]:
    """Return the result of `legendre` for the product of two functions, by Gauss's rule between all their jumps."""
    low, high = min(start, stop), max(start, stop)
    whole, at = high - low, low
    own, x = locate(one, first, low)
    its, y = locate(other, second, low)
    if whole == 0.0:
        return value_in(one, own, x) * value_in(other, its, y), 0.0, 0.0
    sum0 = sum1 = sum2 = 0.0
    while True:
        # where rounding is past an edge, the interval up to it is empty
        left, to_own = high - at, max(edge_of(one, first, own) - x, 0.0)
        to_its = max(edge_of(other, second, its) - y, 0.0)
        width = min(left, to_own, to_its, LONGEST)
        for point in range(4):
            place = POINTS[point] * width
            weight = WEIGHTS[point]
            share = weight * width / whole * (value_in(one, own, x + place) * value_in(other, its, y + place))
            t = 2 * (at - low + place) / whole - 1
            sum0 += share
            sum1 += share * t
            sum2 += share * (1.5 * t * t - 0.5)
        if width == left:
            break
        at, x, y = at + width, x + width, y + width
        if width == to_own:
            own = following(one, first, own)
            x = one.starts[own]
        if width == to_its:
            its = following(other, second, its)
            y = other.starts[its]
    if stop < start:
        sum1 = -sum1
    return sum0, 3 * sum1, 5 * sum2


@compiled_inline
def legendre_short(waves: Waves, which: int, start: float, stop: float) -> tuple[float, float, float]:
    """Return the result of `legendre` by Gauss's rule; across jumps, of the product with the unit function."""
    whole = abs(stop - start)
    segment, x = locate(waves, which, min(start, stop))
    if segment + 1 < waves.segments[which + 1] and x + whole <= waves.starts[segment + 1]:
        # the usual case: three points between two jumps suffice, at a third of the cost
        first = value_in(waves, segment, x + (0.5 - OUTER_NODE) * whole)
        middle = value_in(waves, segment, x + 0.5 * whole)
        last_value = value_in(waves, segment, x + (0.5 + OUTER_NODE) * whole)
        slope = SLOPE_WEIGHT * (last_value - first)
        both = first + last_value
        return (5 * both + 8 * middle) * (1 / 18), slope if stop > start else -slope, (both - 2 * middle) * (5 / 9)
    return legendre_of_product(waves, which, waves, waves.means.size - 1, start, stop)


@compiled_inline
def integrals_at(waves: Waves, which: int, phase: float) -> tuple[float, float, float]:
    """Return the three periodic integrals of the function minus its mean."""
    segment, x = locate(waves, which, phase)
    cell, u = cell_at(waves, segment, x)
    c = waves.rows[cell]
    square = u * u
    # even and odd powers separately: half as long a chain of dependent sums
    first = c[6] + square * (c[8] + square * (c[10] + square * c[12])) + u * (c[7] + square * (c[9] + square * c[11]))
    second = (
        c[13]
        + square * (c[15] + square * (c[17] + square * c[19]))
        + u * (c[14] + square * (c[16] + square * (c[18] + square * c[20])))
    )
    third = (
        c[21]
        + square * (c[23] + square * (c[25] + square * (c[27] + square * c[29])))
        + u * (c[22] + square * (c[24] + square * (c[26] + square * c[28])))
    )
    return first, second, third


@compiled_inline
def legendre(waves: Waves, which: int, start: float, stop: float, known: Array) -> tuple[float, float, float]:
    """Return a0, a1, a2 of the least-squares fit ``a0 + a1 P1(x) + a2 P2(x)``, x from -1 at `start` to 1 at `stop`.

    By parts, ``int t^n f dt`` needs the function's integrals at both ends only: `known` (tables, 3) holds those at
    `start`, NaN if unknown, and receives those at `stop`.
    """
    width = stop - start
    if abs(width) < SHORT:
        known[which, 0] = np.nan
        return legendre_short(waves, which, start, stop)
    before = (known[which, 0], known[which, 1], known[which, 2])
    if np.isnan(before[0]):
        before = integrals_at(waves, which, start)
    after = integrals_at(waves, which, stop)
    known[which, 0], known[which, 1], known[which, 2] = after
    per_width = 1.0 / width  # a single division, which other look-ups need not wait for
    first0 = (after[0] - before[0]) * per_width
    rise1 = (after[1] - before[1]) * per_width
    first1 = (after[0] - rise1) * per_width
    first2 = (after[0] - 2 * (after[1] - (after[2] - before[2]) * per_width) * per_width) * per_width
    return (
        first0 + waves.means[which],
        3 * (2 * first1 - first0),
        5 * (6 * first2 - 6 * first1 + first0),
    )
