"""Compiled exact steps for mesh stiffness that is constant between switching instants."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Propagators(NamedTuple):
    """Propagators of the state x (s,), and outputs, for each combination of mesh stiffnesses.

    s is 2 n, and twice the number of meshes more where their forces are integrated (`data_synth.integrate.pieces`). All
    are stored by columns, the contribution of the constant load apart. Over 1, 2, ... samples: ``powers``
    (combinations, samples, s, s) and ``gains`` (combinations, samples, s), with the outputs at all of these samples in
    ``outputs_matrix`` (combinations, s, samples x channels) and ``output_gains`` (combinations, samples x channels).
    Over 1/2, 1/4, ... of a sample: ``halved`` (combinations, halvings, s, s) and ``halved_gains``. Over any part of the
    last of these: the terms of the power series ``series`` (combinations, s, terms x s) and ``series_gains``
    (combinations, terms x s).
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
        now, then = start + sample * sample_s, start + (sample + 1) * sample_s
        for i in range(states, size):
            x[i] = 0.0
        while now < then:
            # up to the next switching instant, or to the next sample
            switching = event < switches.size and switches[event] < then
            stop = switches[event] if switching else then
            propagate_fraction(x, other, terms, propagators, combinations[event], (stop - now) / sample_s)
            now = stop
            event += switching
        for r in range(channels):
            row = rows[r]
            total = constant[r]
            for i in range(size):
                total += row[i] * x[i]
            outputs[sample, r] = total
        sample += 1
