"""Compiled exact steps for mesh stiffness that is constant between switching instants.

Each operation is rounded as written, and no array is allocated in parts that are compiled into others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside
from data_synth.integrators._matrix_kernels import apply_columns

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Propagators(NamedTuple):
    """Propagators of the state x (s,), and outputs, for each combination of mesh stiffnesses.

    s is 2 n, and twice the number of meshes more where their forces are integrated
    (`data_synth.integrators.exact_transition`). All are stored by columns, the contribution of the constant load apart.
    Over 1, 2, ... samples: ``powers`` (combinations, samples, s, s) and ``gains`` (combinations, samples, s), with the
    outputs at all of these samples in ``outputs_matrix`` (combinations, s, samples x channels) and ``output_gains``
    (combinations, samples x channels). Over 1/2, 1/4, ... of a sample: ``halved`` (combinations, halvings, s, s) and
    ``halved_gains``. Over any part of the last of these: the terms of the power series ``series`` (combinations, s,
    terms x s) and ``series_gains`` (combinations, terms x s).
    """

    powers: Array
    gains: Array
    outputs_matrix: Array
    output_gains: Array
    halved: Array
    halved_gains: Array
    series: Array
    series_gains: Array


@compiled
def add_series(x: Array, other: Array, terms: Array, fraction: float) -> None:
    """Add the power series whose coefficients are `terms`, one after the other from the first power on, to x."""
    size = x.size
    count = terms.size // size
    for i in range(size):
        other[i] = terms[(count - 1) * size + i]
    for term in range(count - 2, -1, -1):
        for i in range(size):
            other[i] = terms[term * size + i] + fraction * other[i]
    for i in range(size):
        x[i] += fraction * other[i]


@compiled_inside
def propagate_fraction(
    x: Array, other: Array, terms: Array, propagators: Propagators, combination: int, fraction: float
) -> None:
    """Propagate over a fraction below 1 of a sample: by halves, quarters, ..., then by the power series."""
    size, last = x.size, 1.0
    for halving in range(propagators.halved.shape[1]):
        last *= 0.5
        if fraction >= last:
            fraction -= last
            apply_columns(
                propagators.halved[combination, halving], propagators.halved_gains[combination, halving], x, other
            )
            for i in range(size):
                x[i] = other[i]
    apply_columns(propagators.series[combination], propagators.series_gains[combination], x, terms)
    add_series(x, other, terms, fraction / last)


@compiled_inside
def samples_before(switch: float, start: float, sample_s: float, sample: int, count: int) -> int:
    """Return the number of samples after `sample` that come before, or at, a switching time."""
    samples_ahead = int(min((switch - (start + sample * sample_s)) / sample_s, float(count - sample)))
    # the quotient may be off by rounding
    while samples_ahead > 0 and start + (sample + samples_ahead) * sample_s > switch:
        samples_ahead -= 1
    while sample + samples_ahead < count and start + (sample + samples_ahead + 1) * sample_s <= switch:
        samples_ahead += 1
    return samples_ahead


@compiled_inside
def part_before(switches: Array, event: int, now: float, sample_s: float) -> float:
    """Return the part of a sample interval from `now` on that lies before a switching time, at most 1."""
    return min((switches[event] - now) / sample_s, 1.0) if event < switches.size else 1.0


@compiled
def transition_steps(
    x: Array,
    outputs: Array,
    rows: Array,
    constant: Array,
    start: float,
    sample_s: float,
    switches: Array,
    combinations: Integers,
    propagators: Propagators,
    states: int,
) -> None:
    """Propagate x (s,) from the time `start` over samples `sample_s` apart, and compute the outputs at each.

    From entry `states` on (the force integrals), x is zero at the beginning of every sample, as the propagators over
    whole samples assume. ``combinations`` (switches + 1,) are those before the first switching time and after each.
    """
    size, max_samples = x.size, propagators.powers.shape[1]
    count, channels = outputs.shape
    other, terms = np.empty(size), np.empty(propagators.series.shape[2])
    flat = outputs.reshape(count * channels)
    sample = event = 0
    while sample < count:
        combination = combinations[event]
        samples_ahead = samples_before(
            switches[event] if event < switches.size else np.inf, start, sample_s, sample, count
        )
        while samples_ahead > 0:
            samples = min(samples_ahead, max_samples)
            apply_columns(
                propagators.outputs_matrix[combination],
                propagators.output_gains[combination],
                x,
                flat[sample * channels : (sample + samples) * channels],
            )
            apply_columns(
                propagators.powers[combination, samples - 1], propagators.gains[combination, samples - 1], x, other
            )
            for i in range(size):
                x[i] = other[i]
            sample += samples
            samples_ahead -= samples
        if sample == count:
            break
        for i in range(states, size):
            x[i] = 0.0
        place = 0.0
        while place < 1.0:
            # up to the next switching instant, or to the next sample; in fractions of one, whose sum is exact
            stop = part_before(switches, event, start + sample * sample_s, sample_s)
            propagate_fraction(x, other, terms, propagators, combinations[event], max(stop - place, 0.0))
            place = max(stop, place)
            event += stop < 1.0
        for r in range(channels):
            row = rows[r]
            total = constant[r]
            for i in range(size):
                total += row[i] * x[i]
            outputs[sample, r] = total
        sample += 1


# ---- Compiled exact steps with backlash: linear between contact events, whose instants are roots of a power series ---


NONE = 2.0  # beyond every interval, which end at 1
MAX_ITERATIONS = 60
MAX_EVENTS = 64  # in one interval: beyond, teeth rest at the boundary of contact to the last digit


@compiled_inside
def polynomial(c: Array, first: int, s: float) -> tuple[float, float]:
    """Return ``c[first] + c[first + 1] s + ...`` and its slope."""
    value = slope = 0.0
    for k in range(c.size - 1, first - 1, -1):
        slope = slope * s + value
        value = value * s + c[k]
    return value, slope


@compiled_inside
def root_between(c: Array, first: int, low: float, high: float) -> float:
    """Return the root of a polynomial that is negative at `low`, positive at `high`: Newton's method, bracketed."""
    s = 0.5 * (low + high)
    for _ in range(MAX_ITERATIONS):
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
def maximum_of(c: Array, first: int, high: float) -> float:
    """Return the position of the maximum of a polynomial that rises at 0 and falls at `high`, by bisection."""
    low = 0.0
    for _ in range(MAX_ITERATIONS):
        s = 0.5 * (low + high)
        _, slope = polynomial(c, first, s)
        if slope > 0:
            low = s
        else:
            high = s
    return low


@compiled_inside
def first_crossing(c: Array, fraction: float, on_edge: bool) -> float:
    """Return the first point in [0, fraction] at which a polynomial becomes positive, NONE where it does not.

    With `on_edge` its constant term is taken to be zero, free of rounding, and the following terms decide.
    """
    first = 1 if on_edge or c[0] == 0.0 else 0
    bound, power = c[first], fraction
    for k in range(first + 1, c.size):
        bound += abs(c[k]) * power
        power *= fraction
    if bound <= 0.0:
        return NONE
    if c[first] >= 0.0:
        return 0.0
    end, falling = polynomial(c, first, fraction)
    if end > 0.0:
        return root_between(c, first, 0.0, fraction)
    if c[first + 1] > 0.0 and falling < 0.0:
        top = maximum_of(c, first, fraction)
        highest, _ = polynomial(c, first, top)
        if highest > 0.0:
            return root_between(c, first, 0.0, top)
    return NONE


@compiled_inside
def next_contact(
    deflections: Array, half_gaps: Array, contact: Integers, edge: int, fraction: float, buffer: Array
) -> tuple[float, int, int]:
    """Return instant in [0, fraction], boundary and new contact state of the first contact event."""
    instant, mesh, then = NONE, -1, 0
    for m in range(half_gaps.size):
        for side in range(-1, 2, 2):
            # contact ends at one boundary; from free flight both can be reached
            if contact[m] == side:
                sign, after = -side, 0
            elif contact[m] == 0:
                sign, after = side, side
            else:
                continue
            for k in range(buffer.size):
                buffer[k] = sign * deflections[m, k]
            buffer[0] -= sign * side * half_gaps[m]
            found = first_crossing(buffer, fraction, edge == 2 * m + (side + 1) // 2)
            if found < instant:
                instant, mesh, then = found, 2 * m + (side + 1) // 2, after
    return instant, mesh, then


@compiled
def contact_steps(
    x: Array,
    contact: Integers,
    outputs: Array,
    rows: Array,
    constant: Array,
    start: float,
    sample_s: float,
    series_fraction: float,
    switches: Array,
    combinations: Integers,
    series: Array,
    series_gains: Array,
    deflection_rows: Array,
    half_gaps: Array,
    states: int,
) -> None:
    """Propagate x (s,) from the time `start` over samples `sample_s` apart, and compute the outputs at each.

    From entry `states` on (the force integrals), x is zero at the beginning of every sample. ``contact`` (gaps,),
    updated too, is 1 for contact on the driving flank, -1 on the back flank, 0 for none. ``combinations`` (switches +
    1,) of mesh stiffnesses are those before the first switching time and after each; for each of them ``series``
    (combinations, 3^gaps, s, terms x s) and ``series_gains`` (combinations, 3^gaps, terms x s) hold the terms of the
    power series over ``series_fraction`` of a sample, by columns, and the contribution of the constant load.
    ``deflection_rows`` (gaps, s) give the deflections.
    """
    size, gaps = x.size, half_gaps.size
    terms = np.empty(series.shape[3])
    count = terms.size // size
    deflections, buffer, other = np.empty((gaps, count + 1)), np.empty(count + 1), np.empty(size)
    event, edge = 0, -1
    for sample in range(outputs.shape[0]):
        for i in range(states, size):
            x[i] = 0.0
        place = 0.0
        while place < 1.0:
            stop = part_before(switches, event, start + sample * sample_s, sample_s)
            left, events = stop - place, 0
            while left > 0.0:
                state = 0
                for m in range(gaps):
                    state = 3 * state + contact[m] + 1
                apply_columns(series[combinations[event], state], series_gains[combinations[event], state], x, terms)
                for m in range(gaps):
                    for k in range(count + 1):
                        total = 0.0
                        for i in range(size):
                            total += deflection_rows[m, i] * (terms[(k - 1) * size + i] if k else x[i])
                        deflections[m, k] = total
                fraction = min(left / series_fraction, 1.0)
                instant, mesh, after = next_contact(deflections, half_gaps, contact, edge, fraction, buffer)
                event_found = instant <= fraction and events < MAX_EVENTS
                fraction = instant if event_found else fraction
                add_series(x, other, terms, fraction)
                left = left - fraction * series_fraction if fraction * series_fraction < left else 0.0
                edge = mesh if event_found else -1
                if event_found:
                    contact[mesh // 2] = after
                    events += 1
            place = max(stop, place)
            event += stop < 1.0
        for r in range(rows.shape[0]):
            row = rows[r]
            total = constant[r]
            for i in range(size):
                total += row[i] * x[i]
            outputs[sample, r] = total
