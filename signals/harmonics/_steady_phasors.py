"""Phasors of many orders of shafts that turn nearly steadily, for a few operations a sample and no sine.

Within a short piece the angle is a line through its ends and a small deviation d. The phasors of the line follow from
one another by a turn that stays the same, sixteen samples apart; each is then turned on by the deviation,
`exp(j order d)`, whose Taylor polynomial is short. Where a shaft turns too unsteadily for that, phasors are made from
the angles themselves.
"""

from math import factorial

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums
from signals._lanes import WIDE, load_wide, minus, multiply_add, negative, plus, repeat_wide, spread_wide, store, times
from signals.harmonics._phasors import fill_phasors

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Workspace = tuple[Floats, Floats, Floats, Floats, Floats, Floats]

PIECE = 256  # samples of a piece at most
ROWS = 8  # orders whose phasors of a piece stay in the nearest cache
STRIDE = 2 * WIDE
# Angles up to which the terms left out, of second and of eighth degree on, are below 1e-16.
_LINEAR, _SHORT = 1e-8, 0.04
_C2, _C4, _C6 = -1 / factorial(2), 1 / factorial(4), -1 / factorial(6)
_S3, _S5, _S7 = -1 / factorial(3), 1 / factorial(5), -1 / factorial(7)
# Among the angles of a line, after those of its first samples from its start.
_START, _LATER, _TURN = WIDE, WIDE + 1, WIDE + 2


@compiled
def workspace(shafts: int, rows: int) -> Workspace:
    """Return room for what is known of a piece, and for the first phasors of so many rows."""
    return (
        np.zeros((shafts, STRIDE)),
        np.zeros((shafts, PIECE)),
        np.zeros(shafts),
        np.zeros(rows * STRIDE),
        np.zeros(rows * STRIDE),
        np.zeros(rows * STRIDE),
    )


@compiled_sums
def begin_piece(work: Workspace, phase: Floats, first: int, last: int) -> None:
    """Split the angles of samples `first` up to `last`, `PIECE` at most, into lines and deviations.

    Parameters
    ----------
    phase : (shaft, sample) array in rad.
    """
    lines, deviations, largest = work[0], work[1], work[2]
    for shaft in range(len(phase)):
        angle, line, deviation = phase[shaft][first:last], lines[shaft], deviations[shaft]
        start = angle[0]
        step = (angle[angle.size - 1] - start) / max(angle.size - 1, 1)
        for n in range(WIDE):
            line[n] = step * n
        line[_START], line[_LATER], line[_TURN] = start, step * WIDE, step * STRIDE
        fourth = 0.0
        for n in range(angle.size):
            apart = (angle[n] - start) - step * n
            deviation[n] = apart
            fourth += (apart * apart) * (apart * apart)
        largest[shaft] = np.sqrt(np.sqrt(fourth))


@compiled
def fill_steady(
    work: Workspace,
    order: Floats,
    shaft: Indices,
    phase: Floats,
    first: int,
    last: int,
    cosine: Floats,
    sine: Floats,
) -> None:
    """Fill the phasors of some orders in the piece begun.

    Parameters
    ----------
    order, shaft : (row,) arrays, cycles per revolution and the shaft they count.
    phase, first, last : as for `begin_piece`.
    cosine, sine : (row or more, PIECE) arrays, filled; behind the last sample with something finite.
    """
    lines, deviations, largest, angles, cosines, sines = work
    for k in range(order.size):
        for n in range(STRIDE):
            angles[k * STRIDE + n] = order[k] * lines[shaft[k], n]
    count = order.size * STRIDE
    fill_phasors(1.0, angles[:count], cosines, sines)
    for k in range(order.size):
        apart = order[k] * largest[shaft[k]]
        if not apart < _SHORT:
            fill_phasors(order[k], phase[shaft[k]][first:last], cosine[k], sine[k])
            continue
        seed = k * STRIDE
        c, s = repeat_wide(cosines, seed + _START), repeat_wide(sines, seed + _START)
        c0, s0 = _turned(load_wide(cosines, seed), load_wide(sines, seed), c, s)
        c1, s1 = _turned(c0, s0, repeat_wide(cosines, seed + _LATER), repeat_wide(sines, seed + _LATER))
        turn_cosine, turn_sine = repeat_wide(cosines, seed + _TURN), repeat_wide(sines, seed + _TURN)
        factor = spread_wide(order[k])
        linear = apart < _LINEAR
        row, source = k * PIECE, shaft[k] * PIECE
        for n in range(0, last - first, STRIDE):
            t0 = times(factor, load_wide(deviations, source + n))
            t1 = times(factor, load_wide(deviations, source + n + WIDE))
            _store_turned(c0, s0, t0, linear, cosine, sine, row + n)
            _store_turned(c1, s1, t1, linear, cosine, sine, row + n + WIDE)
            c0, s0 = _turned(c0, s0, turn_cosine, turn_sine)
            c1, s1 = _turned(c1, s1, turn_cosine, turn_sine)


@compiled
def _turned(cosine, sine, turn_cosine, turn_sine):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202  (lanes)
    """Return the product of two phasors."""
    return (
        minus(times(cosine, turn_cosine), times(sine, turn_sine)),
        plus(times(sine, turn_cosine), times(cosine, turn_sine)),
    )


@compiled
def _store_turned(cosine, sine, angle, linear, cosines, sines, at):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Store a phasor turned on by a small angle."""
    if linear:
        store(cosines, at, multiply_add(negative(sine), angle, cosine))
        store(sines, at, multiply_add(cosine, angle, sine))
    else:
        square = times(angle, angle)
        even = multiply_add(square, spread_wide(_C6), spread_wide(_C4))
        even = multiply_add(square, multiply_add(square, even, spread_wide(_C2)), spread_wide(1.0))
        odd = multiply_add(square, spread_wide(_S7), spread_wide(_S5))
        odd = times(angle, multiply_add(square, multiply_add(square, odd, spread_wide(_S3)), spread_wide(1.0)))
        c, s = _turned(cosine, sine, even, odd)
        store(cosines, at, c)
        store(sines, at, s)
