"""Compiled exact steps through stiffnesses that are constant between switching instants."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ROUNDING = 1e-17  # of the state: terms of the power series below it change no digit


@compiled_inside
def apply_columns(columns: Array, added: Array, x: Array, out: Array) -> None:
    """Multiply by a matrix whose columns are the rows of `columns`, and add: four at a time, their number is even."""
    size = x.size
    first, second, a, b = columns[0], columns[1], x[0], x[1]
    for i in range(size):
        out[i] = added[i] + first[i] * a + second[i] * b
    left = 2
    if size % 4 == 0:
        third, fourth, c, d = columns[2], columns[3], x[2], x[3]
        for i in range(size):
            out[i] += third[i] * c + fourth[i] * d
        left = 4
    for j in range(left, size, 4):
        first, second, a, b = columns[j], columns[j + 1], x[j], x[j + 1]
        third, fourth, c, d = columns[j + 2], columns[j + 3], x[j + 2], x[j + 3]
        for i in range(size):
            out[i] += first[i] * a + second[i] * b + third[i] * c + fourth[i] * d


@compiled_inside
def pass_time(
    x: Array,
    other: Array,
    term: Array,
    none: Array,
    ladder: Array,
    gains: Array,
    generator: Array,
    drive: Array,
    norm: float,
    time: float,
    unit: float,
) -> None:
    """Let the flow act for a time below `unit`: by its propagators over unit / 2, / 4, ..., then by its power series.

    `other`, `term` are room to work in, `none` zeros.
    """
    size = x.size
    part = unit
    for rung in range(1, ladder.shape[0]):
        part *= 0.5
        if time >= part:
            time -= part
            apply_columns(ladder[rung], gains[rung], x, other)
            for i in range(size):
                x[i] = other[i]
    if time > 0.0:
        for i in range(size):
            term[i] = x[i]
        bound, power = 1.0, 0
        while bound > ROUNDING:
            power += 1
            bound *= norm * time / power
            factor = time / power
            apply_columns(generator, drive if power == 1 else none, term, other)
            for i in range(size):
                term[i] = other[i] * factor
                x[i] += term[i]


@compiled
def transition_steps(
    x: Array,
    readings: Array,
    rows: Array,
    constant: Array,
    samples: Array,
    switches: Array,
    kinds: Integers,
    ladders: Array,
    gains: Array,
    generators: Array,
    drive: Array,
    norms: Array,
    unit: float,
) -> None:
    """Advance x (2 n,) from samples[0] to each further sample time and read it there.

    ``kinds`` (switches + 1,) says which of the matrices holds before the first switching time and after each; for
    each of them a ladder of propagators over unit, unit / 2, ... with what the drive adds, the generator and its norm.
    """
    size = x.size
    other, term, none = np.empty(size), np.empty(size), np.zeros(size)
    event = 0
    whole, gain = ladders[kinds[0], 0], gains[kinds[0], 0]
    for sample in range(readings.shape[0]):
        now, then = samples[sample], samples[sample + 1]
        if event == switches.size or switches[event] >= then:
            apply_columns(whole, gain, x, other)
            for i in range(size):
                x[i] = other[i]
        else:
            while now < then:
                # one stretch up to the next switching instant, or to the sample where none is left before it
                kind, switching = kinds[event], event < switches.size and switches[event] < then
                stop = switches[event] if switching else then
                pass_time(
                    x,
                    other,
                    term,
                    none,
                    ladders[kind],
                    gains[kind],
                    generators[kind],
                    drive,
                    norms[kind],
                    stop - now,
                    unit,
                )
                now = stop
                event += switching
            whole, gain = ladders[kinds[event], 0], gains[kinds[event], 0]
        for r in range(rows.shape[0]):
            row = rows[r]
            total = constant[r]
            for i in range(size):
                total += row[i] * x[i]
            readings[sample, r] = total
