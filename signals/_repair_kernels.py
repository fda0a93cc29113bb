"""The least costly numbering of pulses of which some are missing and some are extra."""

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array
from signals._compile import compiled

Places = NDArray[np.int64]

# columns of a partial numbering: its cost, its last number, its node, the last three times, the last three places
_COST, _NUMBER, _NODE, _T, _P = 0, 1, 2, 3, 6
_COLUMNS = 9
_KNOWN = 3  # pulses that begin every numbering
_MISSING = 0.8  # of the price of an extra pulse: at the ends one of each is likelier than two extra
_DEAREST = 2.5  # in extra pulses: a pulse far off must not cost more than to give up all that follow
_KNEE = 2.0  # standard deviations beyond which the price grows in proportion (Huber)
_SAME = 1e-9  # revolutions


@compiled
def _place(number: int, pattern: Array) -> float:
    """Revolutions at which the pulse of a number stands."""
    lap = number // pattern.size
    return float(lap + pattern[number - lap * pattern.size])


@compiled
def _off(row: Array, time: float, place: float, steps: int, between: bool) -> float:
    """How far a pulse lies off its place in intervals, by the last three: evenly, or at a constant acceleration."""
    speed = (row[_P] - row[_P + 1]) / (row[_T] - row[_T + 1])
    earlier = (row[_P + 1] - row[_P + 2]) / (row[_T + 1] - row[_T + 2])
    ahead = place - row[_P]
    even = row[_T] + ahead / speed
    acceleration = 2 * (speed - earlier) / (row[_T] - row[_T + 2])
    now = speed + acceleration * (row[_T] - row[_T + 1]) / 2
    under = now * now + 2 * acceleration * ahead
    if now <= 0 or under <= 0:  # it would stop before: as late as it likes, within reason
        low, high = even, row[_T] + 3 * ahead / speed
    else:
        bent = row[_T] + 2 * ahead / (now + np.sqrt(under))
        low, high = (min(even, bent), max(even, bent)) if between else (bent, bent)
    error = time - low if time < low else (time - high if time > high else 0.0)
    return float(error * steps / (even - row[_T]))


@compiled
def _alike(one: Array, other: Array, stripes: int) -> bool:
    """Whether two numberings can only go on alike: the same last three pulses, as far apart, at the same stripe."""
    for k in range(_KNOWN):
        if one[_T + k] != other[_T + k]:
            return False
    near = abs((one[_P] - one[_P + 1]) - (other[_P] - other[_P + 1])) < _SAME
    far = abs((one[_P + 1] - one[_P + 2]) - (other[_P + 1] - other[_P + 2])) < _SAME
    return near and far and int(one[_NUMBER] - other[_NUMBER]) % stripes == 0


@compiled
def best_numbering(
    times: Array, pattern: Array, first: int, beam: int, width: float, between: bool, price: float
) -> tuple[Places, Places]:
    """Return the indices of the pulses kept, and their numbers; the first three are sound, numbered from `first`.

    A numbering goes on by leaving the next pulse out, or by giving it one of the numbers nearest to where it falls.
    Of those that agree in their last three pulses the cheapest stays, of all the `beam` cheapest. With `between`, a
    pulse between its even and its accelerated place is on its place.
    """
    n = times.size
    rows = np.empty((4 * beam, _COLUMNS))
    pulse = np.empty(4 * beam, dtype=np.int64)  # -1 where the pulse is left out
    best = np.empty((beam, _COLUMNS))
    node_pulse = np.empty(_KNOWN + n * beam, dtype=np.int64)
    node_number = np.empty(_KNOWN + n * beam, dtype=np.int64)
    node_before = np.empty(_KNOWN + n * beam, dtype=np.int64)
    for k in range(_KNOWN):
        node_pulse[k], node_number[k], node_before[k] = k, first + k, k - 1
        best[0, _T + _KNOWN - 1 - k] = times[k]
        best[0, _P + _KNOWN - 1 - k] = _place(first + k, pattern)
    best[0, _COST], best[0, _NUMBER], best[0, _NODE] = 0.0, first + _KNOWN - 1, _KNOWN - 1
    alive, nodes = 1, _KNOWN
    for i in range(_KNOWN, n):
        found = 0
        for b in range(alive):
            rows[found] = best[b]
            rows[found, _COST] += price
            pulse[found] = -1
            found += 1
            speed = (best[b, _P] - best[b, _P + 1]) / (best[b, _T] - best[b, _T + 1])
            about = int(speed * (times[i] - best[b, _T]) * pattern.size)
            for m in range(max(about - 1, 1), max(about, 1) + 2):
                number = int(best[b, _NUMBER]) + m
                place = _place(number, pattern)
                far = abs(_off(best[b], times[i], place, m, between)) / width
                off_price = 0.5 * far * far if far <= _KNEE else _KNEE * (far - _KNEE / 2)
                rows[found, _COST] = best[b, _COST] + min(off_price + _MISSING * price * (m - 1), _DEAREST * price)
                rows[found, _NUMBER] = number
                rows[found, _NODE] = best[b, _NODE]
                rows[found, _T], rows[found, _P] = times[i], place
                for k in range(1, _KNOWN):
                    rows[found, _T + k], rows[found, _P + k] = best[b, _T + k - 1], best[b, _P + k - 1]
                pulse[found] = i
                found += 1
        alive = 0
        for c in np.argsort(rows[:found, _COST]):
            new = True
            for b in range(alive):
                if _alike(rows[c], best[b], pattern.size):
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
    return _traced(int(best[0, _NODE]), node_pulse, node_number, node_before)


@compiled
def _traced(last: int, node_pulse: Places, node_number: Places, node_before: Places) -> tuple[Places, Places]:
    """Pulses and numbers from the first node to the last."""
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
