"""Compiled exact steps through stiffnesses that are constant between switching instants."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Flows(NamedTuple):
    """How x (s,) moves on under each of several stiffnesses, kind by kind, and what is read then.

    s is 2 n, and twice the meshes more where their forces are integrated beside (`data_synth.integrate.pieces`). All by
    columns over x, with what the drive adds apart. Over 1, 2, ... units of time ``powers`` (kinds, units, s,
    s) and ``gains`` (kinds, units, s); the readings then, one after the other, ``tables`` (kinds, s, units x
    channels) and ``constants`` (kinds, units x channels). Over half a unit, a quarter, ... ``ladders`` (kinds, rungs,
    s, s) and ``ladder_gains``; over a share of the last rung's length, ``last`` of a unit, the terms of the power
    series ``series`` (kinds, s, terms x s) and ``series_gains`` (kinds, terms x s).
    """

    powers: Array
    gains: Array
    tables: Array
    constants: Array
    ladders: Array
    ladder_gains: Array
    series: Array
    series_gains: Array


@compiled
def apply_columns(columns: Array, added: Array, x: Array, out: Array) -> None:
    """Multiply by a matrix whose columns are the rows of `columns`, and add: four at a time, their number is even."""
    size, width = x.size, out.size
    first, second, a, b = columns[0], columns[1], x[0], x[1]
    for i in range(width):
        out[i] = added[i] + first[i] * a + second[i] * b
    left = 2
    if size % 4 == 0:
        third, fourth, c, d = columns[2], columns[3], x[2], x[3]
        for i in range(width):
            out[i] += third[i] * c + fourth[i] * d
        left = 4
    for j in range(left, size, 4):
        first, second, a, b = columns[j], columns[j + 1], x[j], x[j + 1]
        third, fourth, c, d = columns[j + 2], columns[j + 3], x[j + 2], x[j + 3]
        for i in range(width):
            out[i] += first[i] * a + second[i] * b + third[i] * c + fourth[i] * d


@compiled
def follow_series(x: Array, other: Array, terms: Array, part: float) -> None:
    """Add the power series whose coefficients are `terms`, one after the other from the first power on, to x."""
    size = x.size
    count = terms.size // size
    for i in range(size):
        other[i] = terms[(count - 1) * size + i]
    for term in range(count - 2, -1, -1):
        for i in range(size):
            other[i] = terms[term * size + i] + part * other[i]
    for i in range(size):
        x[i] += part * other[i]


@compiled_inside
def pass_time(x: Array, other: Array, terms: Array, flows: Flows, kind: int, share: float) -> None:
    """Let the flow act for a share below 1 of a unit: by halves, quarters, ..., then by its power series."""
    size, last = x.size, 1.0
    for rung in range(flows.ladders.shape[1]):
        last *= 0.5
        if share >= last:
            share -= last
            apply_columns(flows.ladders[kind, rung], flows.ladder_gains[kind, rung], x, other)
            for i in range(size):
                x[i] = other[i]
    apply_columns(flows.series[kind], flows.series_gains[kind], x, terms)
    follow_series(x, other, terms, share / last)


@compiled_inside
def units_before(switch: float, start: float, unit: float, sample: int, count: int) -> int:
    """Return how many samples after `sample` are reached before, or at, a switching time."""
    ahead = int(min((switch - (start + sample * unit)) / unit, float(count - sample)))
    # the quotient may be off by rounding
    while ahead > 0 and start + (sample + ahead) * unit > switch:
        ahead -= 1
    while sample + ahead < count and start + (sample + ahead + 1) * unit <= switch:
        ahead += 1
    return ahead


@compiled
def transition_steps(
    x: Array,
    readings: Array,
    rows: Array,
    constant: Array,
    start: float,
    unit: float,
    switches: Array,
    kinds: Integers,
    flows: Flows,
    kept: int,
) -> None:
    """Advance x (s,) from a time `start` through samples a `unit` apart, and read it at each.

    From entry `kept` on, x begins at zero with every sample; so the flow over whole units takes it to be. ``kinds``
    (switches + 1,) says which of the flows acts before the first switching time and after each.
    """
    size, most = x.size, flows.powers.shape[1]
    count, channels = readings.shape
    other, terms = np.empty(size), np.empty(flows.series.shape[2])
    flat = readings.reshape(count * channels)
    sample = event = 0
    while sample < count:
        kind = kinds[event]
        ahead = units_before(switches[event] if event < switches.size else np.inf, start, unit, sample, count)
        while ahead > 0:
            units = min(ahead, most)
            apply_columns(
                flows.tables[kind], flows.constants[kind], x, flat[sample * channels : (sample + units) * channels]
            )
            apply_columns(flows.powers[kind, units - 1], flows.gains[kind, units - 1], x, other)
            for i in range(size):
                x[i] = other[i]
            sample += units
            ahead -= units
        if sample == count:
            break
        now, then = start + sample * unit, start + (sample + 1) * unit
        for i in range(kept, size):
            x[i] = 0.0
        while now < then:
            # one stretch up to the next switching instant, or to the sample where none is left before it
            switching = event < switches.size and switches[event] < then
            stop = switches[event] if switching else then
            pass_time(x, other, terms, flows, kinds[event], (stop - now) / unit)
            now = stop
            event += switching
        for r in range(channels):
            row = rows[r]
            total = constant[r]
            for i in range(size):
                total += row[i] * x[i]
            readings[sample, r] = total
        sample += 1
