"""Least-cost numbering of pulses of which some are missing and some are extra: a beam search."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled
from signals._validation import Array

Indices = NDArray[np.int64]

# columns of a partial numbering: its cost, its last number, its node, the last three times and angles, latest first
_COST, _NUMBER, _NODE, _T, _A = 0, 1, 2, 3, 6
_COLUMNS = 9
_SEEDS = 3  # pulses that begin every numbering
_MISSING = 0.8  # cost of a missing over that of an extra pulse: at the ends one of each is likelier than two extra
_MOST_COST = 2.5  # in extra pulses: one outlier must not cost more than leaving out all pulses after it
_HUBER = 2.0  # standard deviations beyond which the cost of an error grows linearly
_SAME = 1e-9  # revolutions


@compiled
def _angle(number: int, positions: Array) -> float:
    """Return the shaft angle in revolutions at the pulse of a number."""
    revolution = number // positions.size
    return float(revolution + positions[number - revolution * positions.size])


@compiled
def _prediction_error(row: Array, time: float, angle: float, steps: int, between: bool) -> float:
    """Return the error of a pulse time, in intervals, against its prediction from the last three pulses.

    The prediction is that of constant acceleration; with `between`, any time from it to that of constant speed.
    """
    speed = (row[_A] - row[_A + 1]) / (row[_T] - row[_T + 1])
    earlier = (row[_A + 1] - row[_A + 2]) / (row[_T + 1] - row[_T + 2])
    ahead = angle - row[_A]
    at_speed = row[_T] + ahead / speed
    acceleration = 2 * (speed - earlier) / (row[_T] - row[_T + 2])
    now = speed + acceleration * (row[_T] - row[_T + 1]) / 2
    squared_speed = now * now + 2 * acceleration * ahead  # at that angle
    if now <= 0 or squared_speed <= 0:  # the shaft would stop before: up to three times as late is no error
        low, high = at_speed, row[_T] + 3 * ahead / speed
    else:
        accelerated = row[_T] + 2 * ahead / (now + np.sqrt(squared_speed))
        low, high = (min(at_speed, accelerated), max(at_speed, accelerated)) if between else (accelerated, accelerated)
    error = time - low if time < low else (time - high if time > high else 0.0)
    return float(error * steps / (at_speed - row[_T]))


@compiled
def _same_state(one: Array, other: Array, stripes: int) -> bool:
    """Return whether two numberings predict alike: same last three pulses, same angles between, same stripe."""
    for k in range(_SEEDS):
        if one[_T + k] != other[_T + k]:
            return False
    near = abs((one[_A] - one[_A + 1]) - (other[_A] - other[_A + 1])) < _SAME
    far = abs((one[_A + 1] - one[_A + 2]) - (other[_A + 1] - other[_A + 2])) < _SAME
    return near and far and int(one[_NUMBER] - other[_NUMBER]) % stripes == 0


@compiled
def best_numbering(
    times: Array, positions: Array, first: int, beam: int, std: float, between: bool, fault_cost: float
) -> tuple[Indices, Indices]:
    """Return the indices of the pulses kept, and their numbers; the first three are sound, numbered from `first`.

    Each partial numbering is extended by leaving the next pulse out, or by giving it one of the three numbers nearest
    to its time. Of numberings with the same state the cheapest is kept, and of all the `beam` cheapest. The cost of a
    prediction error is Huber's, in standard deviations `std`; `between` as in `_prediction_error`.
    """
    n = times.size
    rows = np.empty((4 * beam, _COLUMNS))
    pulse = np.empty(4 * beam, dtype=np.int64)  # -1 where the pulse is left out
    best = np.empty((beam, _COLUMNS))
    node_pulse = np.empty(_SEEDS + n * beam, dtype=np.int64)
    node_number = np.empty(_SEEDS + n * beam, dtype=np.int64)
    node_before = np.empty(_SEEDS + n * beam, dtype=np.int64)
    for k in range(_SEEDS):
        node_pulse[k], node_number[k], node_before[k] = k, first + k, k - 1
        best[0, _T + _SEEDS - 1 - k] = times[k]
        best[0, _A + _SEEDS - 1 - k] = _angle(first + k, positions)
    best[0, _COST], best[0, _NUMBER], best[0, _NODE] = 0.0, first + _SEEDS - 1, _SEEDS - 1
    alive, nodes = 1, _SEEDS
    for i in range(_SEEDS, n):
        found = 0
        for b in range(alive):
            rows[found] = best[b]
            rows[found, _COST] += fault_cost
            pulse[found] = -1
            found += 1
            speed = (best[b, _A] - best[b, _A + 1]) / (best[b, _T] - best[b, _T + 1])
            about = int(speed * (times[i] - best[b, _T]) * positions.size)
            for m in range(max(about - 1, 1), max(about, 1) + 2):
                number = int(best[b, _NUMBER]) + m
                angle = _angle(number, positions)
                error = abs(_prediction_error(best[b], times[i], angle, m, between)) / std
                cost = 0.5 * error * error if error <= _HUBER else _HUBER * (error - _HUBER / 2)
                cost = min(cost + _MISSING * fault_cost * (m - 1), _MOST_COST * fault_cost)
                rows[found, _COST] = best[b, _COST] + cost
                rows[found, _NUMBER] = number
                rows[found, _NODE] = best[b, _NODE]
                rows[found, _T], rows[found, _A] = times[i], angle
                for k in range(1, _SEEDS):
                    rows[found, _T + k], rows[found, _A + k] = best[b, _T + k - 1], best[b, _A + k - 1]
                pulse[found] = i
                found += 1
        alive = 0
        for c in np.argsort(rows[:found, _COST]):
            new = True
            for b in range(alive):
                if _same_state(rows[c], best[b], positions.size):
                    new = False
                    break
            if new:
                best[alive] = rows[c]
                if pulse[c] >= 0:
                    node_pulse[nodes], node_number[nodes] = i, int(rows[c, _NUMBER])
                    node_before[nodes] = int(rows[c, _NODE])
                    best[alive, _NODE] = nodes
                    nodes += 1
                alive += 1
                if alive == beam:
                    break
    last = int(best[0, _NODE])
    length, at = 0, last
    while at >= 0:
        length += 1
        at = node_before[at]
    kept = np.empty(length, dtype=np.int64)
    counts = np.empty(length, dtype=np.int64)
    at = last
    for k in range(length - 1, -1, -1):
        kept[k], counts[k] = node_pulse[at], node_number[at]
        at = node_before[at]
    return kept, counts
