"""Compiled exact steps through teeth that part and meet: linear between contacts, whose instants are roots."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside
from data_synth.integrate._transition_kernels import apply_columns, follow_series

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

NONE = 2.0  # beyond every stretch, which end at 1
ROUNDS = 60
MOST_CONTACTS = 64  # in one stretch: beyond, teeth rest on the edge of their gap to the last digit


@compiled_inside
def polynomial(c: Array, first: int, s: float) -> tuple[float, float]:
    """Return ``c[first] + c[first + 1] s + ...`` and its slope."""
    value = slope = 0.0
    for k in range(c.size - 1, first - 1, -1):
        slope = slope * s + value
        value = value * s + c[k]
    return value, slope


@compiled_inside
def rise_through_zero(c: Array, first: int, low: float, high: float) -> float:
    """Return where a polynomial that is below zero at `low` and above at `high` is zero: Newton's method, held in."""
    s = 0.5 * (low + high)
    for _ in range(ROUNDS):
        value, slope = polynomial(c, first, s)
        if value > 0:
            high = s
        else:
            low = s
        ahead = s - value / slope if slope > 0 else low
        if not low < ahead < high:
            ahead = 0.5 * (low + high)
        if abs(ahead - s) <= 1e-16 * high:
            return ahead
        s = ahead
    return s


@compiled_inside
def top_of(c: Array, first: int, high: float) -> float:
    """Return where a polynomial that rises at 0 and falls at `high` is largest."""
    low = 0.0
    for _ in range(ROUNDS):
        s = 0.5 * (low + high)
        _, slope = polynomial(c, first, s)
        if slope > 0:
            low = s
        else:
            high = s
    return low


@compiled_inside
def crossing(c: Array, part: float, on_edge: bool) -> float:
    """Return the first place in [0, part] where a polynomial rises above zero, NONE where it does not.

    On the edge it is zero at the start, whatever rounding says, and what counts is where it goes from there.
    """
    first = 1 if on_edge or c[0] == 0.0 else 0
    reach, power = c[first], part
    for k in range(first + 1, c.size):
        reach += abs(c[k]) * power
        power *= part
    if reach <= 0.0:
        return NONE
    if c[first] >= 0.0:
        return 0.0
    end, falling = polynomial(c, first, part)
    if end > 0.0:
        return rise_through_zero(c, first, 0.0, part)
    if c[first + 1] > 0.0 and falling < 0.0:
        top = top_of(c, first, part)
        highest, _ = polynomial(c, first, top)
        if highest > 0.0:
            return rise_through_zero(c, first, 0.0, top)
    return NONE


@compiled_inside
def next_contact(
    deflections: Array, half_gaps: Array, touching: Integers, edge: int, part: float, room: Array
) -> tuple[float, int, int]:
    """Return where in [0, part] teeth first part or meet, of which mesh, and what they touch from there on."""
    where, who, then = NONE, -1, 0
    for m in range(half_gaps.size):
        for side in range(-1, 2, 2):
            # from contact only one edge is met, from the gap both
            if touching[m] == side:
                outwards, after = -side, 0
            elif touching[m] == 0:
                outwards, after = side, side
            else:
                continue
            for k in range(room.size):
                room[k] = outwards * deflections[m, k]
            room[0] -= outwards * side * half_gaps[m]
            found = crossing(room, part, edge == 2 * m + (side + 1) // 2)
            if found < where:
                where, who, then = found, 2 * m + (side + 1) // 2, after
    return where, who, then


@compiled
def contact_steps(
    x: Array,
    touching: Integers,
    readings: Array,
    rows: Array,
    constant: Array,
    start: float,
    unit: float,
    last: float,
    switches: Array,
    kinds: Integers,
    series: Array,
    series_gains: Array,
    seen: Array,
    half_gaps: Array,
    kept: int,
) -> None:
    """Advance x (s,) from a time `start` through samples a `unit` apart, and read it at each.

    From entry `kept` on, x begins at zero with every sample. ``touching`` (gaps,), advanced too, says which flanks
    touch: 1 those that drive, -1 their backs, 0 none. ``kinds`` (switches + 1,) are those of the stiffness before the
    first switching time and after each; for each kind ``series`` (kinds, 3^gaps, s, terms x s) and ``series_gains``
    (kinds, 3^gaps, terms x s) hold the terms of the power series over ``last`` of a unit, by columns over x, and what
    the drive adds. ``seen`` (gaps, s) reads the deflections.
    """
    size, gaps = x.size, half_gaps.size
    terms = np.empty(series.shape[3])
    count = terms.size // size
    deflections, room, other = np.empty((gaps, count + 1)), np.empty(count + 1), np.empty(size)
    event, edge = 0, -1
    for sample in range(readings.shape[0]):
        now, then = start + sample * unit, start + (sample + 1) * unit
        for i in range(kept, size):
            x[i] = 0.0
        while now < then:
            switching = event < switches.size and switches[event] < then
            stop = switches[event] if switching else then
            left, contacts = (stop - now) / unit, 0
            while left > 0.0:
                state = 0
                for m in range(gaps):
                    state = 3 * state + touching[m] + 1
                apply_columns(series[kinds[event], state], series_gains[kinds[event], state], x, terms)
                for m in range(gaps):
                    for k in range(count + 1):
                        total = 0.0
                        for i in range(size):
                            total += seen[m, i] * (terms[(k - 1) * size + i] if k else x[i])
                        deflections[m, k] = total
                part = min(left / last, 1.0)
                where, who, after = next_contact(deflections, half_gaps, touching, edge, part, room)
                meets = where <= part and contacts < MOST_CONTACTS
                part = where if meets else part
                follow_series(x, other, terms, part)
                left = left - part * last if part * last < left else 0.0
                edge = who if meets else -1
                if meets:
                    touching[who // 2] = after
                    contacts += 1
            now = stop
            event += switching
        for r in range(rows.shape[0]):
            row = rows[r]
            total = constant[r]
            for i in range(size):
                total += row[i] * x[i]
            readings[sample, r] = total
