"""Compiled kernels: likelihoods of speeds, demodulation, and the most likely numbering of missing and extra pulses.

Pulses are numbered by multiple-hypothesis tracking. Each hypothesis is a Kalman filter of angle, speed and
acceleration, in stripes, with discounted covariances and unknown error scale (West and Harrison 1997, "Bayesian
forecasting and dynamic models", chapters 4 and 6): the angle of a pulse has a Student's t distribution about its
prediction.
"""

import math

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def add_votes(
    levels: Array, bins_per_hz: float, orders: Array, weights: Array, speeds: Array, first_bin: float, votes: Array
) -> None:
    """Add ``weight levels[order * speed]`` of every order to ``votes[speed, frame]``, interpolated between bins.

    `levels` is (bins, frames), so that the innermost loop is contiguous in memory. Nothing is added below `first_bin`
    or beyond the last bin.
    """
    frames = levels.shape[1]
    last = levels.shape[0] - 1
    for s in range(speeds.size):
        row = votes[s]
        for h in range(orders.size):
            position = orders[h] * speeds[s] * bins_per_hz
            low = int(position)
            if position < first_bin or low >= last:
                continue
            part = position - low
            below = levels[low]
            above = levels[low + 1]
            for t in range(frames):
                row[t] += weights[h] * (below[t] + part * (above[t] - below[t]))


@compiled
def most_likely_path(votes: Array, log_kernel: Array) -> Indices:
    """Return the Viterbi path through log likelihoods ``votes`` (frames, speeds) with log transitions `log_kernel`."""
    frames, n = votes.shape
    half = log_kernel.size // 2
    came_from = np.empty((frames, n), dtype=np.int32)
    best = votes[0].copy()
    following = np.empty(n)
    for t in range(1, frames):
        for s in range(n):
            top = -np.inf
            source = s
            for r in range(max(0, s - half), min(n, s + half + 1)):
                value = best[r] + log_kernel[s - r + half]
                if value > top:
                    top = value
                    source = r
            following[s] = top + votes[t, s]
            came_from[t, s] = source
        best[:] = following
    path = np.empty(frames, dtype=np.int64)
    path[-1] = np.argmax(best)
    for t in range(frames - 1, 0, -1):
        path[t - 1] = came_from[t, path[t]]
    return path


@compiled
def demodulate(
    x: Array, revolutions: Array, orders: Array, first: float, hop: float, count: int, table: Array
) -> tuple[Array, Array]:
    """Return the complex amplitude of each order in Hann windows along the angle, real and imaginary (count, orders).

    Window m is centred on ``first + m hop`` and four hops long, so that four windows, a quarter of a period apart,
    cover each sample: their cosines are c, s, -c and -s of one angle. `table` holds one period of the cosine plus one
    entry, interpolated linearly.
    """
    steps = table.size - 1
    quarter = steps - steps // 4  # cos(a - 90 degrees) is sin(a)
    re = np.zeros((count, orders.size))
    im = np.zeros((count, orders.size))
    cosines = np.empty(orders.size)
    sines = np.empty(orders.size)
    windows = np.empty(4)
    for n in range(1, x.size - 1):
        angle = revolutions[n]
        early = int(np.ceil((angle - first) / hop - 2))
        if early + 3 < 0 or early >= count:
            continue
        # Hann: mean 1/2; amplitude: 2
        value = x[n] * (revolutions[n + 1] - revolutions[n - 1]) / (2 * hop)
        away = 0.5 * np.pi * ((angle - first) / hop - early)
        c, s = 0.5 * np.cos(away), 0.5 * np.sin(away)
        windows[0] = 0.5 + c
        windows[1] = 0.5 + s
        windows[2] = 0.5 - c
        windows[3] = 0.5 - s
        for k in range(orders.size):
            cycles = orders[k] * angle
            position = (cycles - np.floor(cycles)) * steps
            cell = min(int(position), steps - 1)
            part = position - cell
            cosines[k] = value * (table[cell] + part * (table[cell + 1] - table[cell]))
            cell += quarter
            if cell >= steps:
                cell -= steps
            sines[k] = value * (table[cell] + part * (table[cell + 1] - table[cell]))
        for m in range(max(early, 0), min(early + 4, count)):
            window = windows[m - early]
            row_re = re[m]
            row_im = im[m]
            for k in range(orders.size):
                row_re[k] += window * cosines[k]
                row_im[k] -= window * sines[k]
    return re, im


_BEAM = 16  # hypotheses
_WINDOW = 25.0  # of log likelihood below the best
_DISCOUNT = 0.5  # of the information, per stripe: a memory of two intervals
_LONGEST = 8.0  # stripes of discount in a gap
_DEGREES = 10.0  # degrees of freedom, the memory of the scale
_STD, _LEAST_STD = 0.05, 0.001  # of the errors in stripes: initial, and smallest
_LOOSE = 0.3  # relative std of the initial speed and acceleration
_MISSING = 5.5  # negative log probabilities
_MOST_COUNTED = 4  # consecutive missing pulses that cost; a drop-out of the sensor may last any time
_EXTRA = 8.5
_DOUBLE = 6.0
_LIKE = 2  # pulses before the last that two hypotheses must number alike to be merged


@compiled
def _angle(number: int, positions: Array) -> float:
    """Return the shaft angle in stripes at the pulse of a given number."""
    revolution = number // positions.size
    return float((revolution + positions[number - revolution * positions.size]) * positions.size)


@compiled
def _predict(state: Array, covariance: Array, step: float, predicted: Array, spread: Array) -> None:
    """Write the state and covariance a time `step` later: ``F x`` and ``F P F' / discount^stripes``.

    A shaft that decelerates to rest before then stays at rest.
    """
    speed, acceleration = state[1], state[2]
    moving = step
    if acceleration < 0 and speed + acceleration * step < 0:
        moving = max(-speed / acceleration, 0.0)
    predicted[0] = state[0] + (speed + acceleration * moving / 2) * moving
    predicted[1], predicted[2] = speed + acceleration * step, acceleration
    growth = _DISCOUNT ** -min(step * abs(speed), _LONGEST)
    rows = np.empty((3, 3))
    half = step * step / 2
    for j in range(3):
        rows[0, j] = covariance[0, j] + step * covariance[1, j] + half * covariance[2, j]
        rows[1, j] = covariance[1, j] + step * covariance[2, j]
        rows[2, j] = covariance[2, j]
    for i in range(3):
        spread[i, 0] = growth * (rows[i, 0] + step * rows[i, 1] + half * rows[i, 2])
        spread[i, 1] = growth * (rows[i, 1] + step * rows[i, 2])
        spread[i, 2] = growth * rows[i, 2]


@compiled
def _update(predicted: Array, spread: Array, innovation: float, state: Array, covariance: Array) -> None:
    """Write the state and covariance after a pulse, the angle counted from it: ``x + K e`` and ``P - K S K'``."""
    for i in range(3):
        gain = spread[i, 0] / (1 + spread[0, 0])
        state[i] = gain * innovation + (predicted[i] if i else -innovation)
        for j in range(3):
            covariance[i, j] = spread[i, j] - gain * spread[0, j]


@compiled
def _surprise(innovation: float, variance: float) -> float:
    """Return the negative log likelihood of an innovation, Student's t, up to a constant near zero."""
    tail = (_DEGREES + 1) / 2 * math.log1p(innovation * innovation / (_DEGREES * variance))
    return float(tail + math.log(2 * math.pi * variance) / 2)


@compiled
def _alike(one: int, other: int, apart: int, pulses: Indices, numbers: Indices, before: Indices) -> bool:
    """Return whether two hypotheses share the pulses before the last, with numbers that differ by a constant."""
    for _ in range(_LIKE):
        if one < 0 or other < 0:
            return one == other
        if pulses[one] != pulses[other] or numbers[one] - numbers[other] != apart:
            return False
        one, other = before[one], before[other]
    return True


@compiled
def best_numbering(times: Array, since: Array, positions: Array, soon: float) -> tuple[Indices, Indices]:
    """Return the indices of the pulses kept and their numbers, zero for the first; the first two must be sound.

    Each pulse is extra, or has one of the two numbers next to the predicted angle. A pulse less than `soon` stripes
    after the preceding one in the list, a time `since` earlier, may be its double. Of hypotheses with the same last
    pulses only the likeliest is kept, and of all hypotheses the `_BEAM` likeliest.
    """
    n, stripes = times.size, positions.size
    cost, node, scale = np.zeros(_BEAM), np.zeros(_BEAM, dtype=np.int64), np.empty(_BEAM)
    state, covariance = np.zeros((_BEAM, 3)), np.zeros((_BEAM, 3, 3))
    next_cost, next_node, next_scale = cost.copy(), node.copy(), scale.copy()
    next_state, next_covariance = state.copy(), covariance.copy()
    predicted, spread = np.empty((_BEAM, 3)), np.empty((_BEAM, 3, 3))
    likelihood = np.empty(3 * _BEAM)  # of candidates, with the hypothesis that each extends, and its number
    parent, number = np.empty(3 * _BEAM, dtype=np.int64), np.empty(3 * _BEAM, dtype=np.int64)
    pulses = np.zeros(1 + n * _BEAM, dtype=np.int64)
    numbers, before = np.zeros_like(pulses), np.full_like(pulses, -1)
    speed = _angle(1, positions) / (times[1] - times[0])
    state[0, 1], scale[0] = speed, _STD * _STD
    covariance[0, 0, 0] = 1.0
    covariance[0, 1, 1] = (_LOOSE * speed / _STD) ** 2
    covariance[0, 2, 2] = (_LOOSE * speed * speed / _STD) ** 2
    alive, nodes = 1, 1
    for i in range(1, n):
        found = 0
        for b in range(alive):
            last = numbers[node[b]]
            _predict(state[b], covariance[b], times[i] - times[pulses[node[b]]], predicted[b], spread[b])
            variance = scale[b] * (1 + spread[b, 0, 0])
            double = since[i] * state[b, 1] < soon
            likelihood[found], parent[found], number[found] = cost[b] + (_DOUBLE if double else _EXTRA), b, last
            found += 1
            angle = predicted[b, 0] + _angle(last, positions)
            above = last + max(int(predicted[b, 0]), 1)
            while _angle(above, positions) < angle:
                above += 1
            while above > last + 1 and _angle(above - 1, positions) > angle:
                above -= 1
            for candidate in range(max(above - 1, last + 1), above + 1):
                surprise = _surprise(_angle(candidate, positions) - angle, variance)
                likelihood[found] = cost[b] + surprise + _MISSING * min(candidate - last - 1, _MOST_COUNTED)
                parent[found], number[found] = b, candidate
                found += 1
        order = np.argsort(likelihood[:found])
        kept = 0
        for c in order:
            if kept == _BEAM or likelihood[c] > likelihood[order[0]] + _WINDOW:
                break
            b = parent[c]
            left_out = number[c] == numbers[node[b]]
            new = True
            for k in range(kept):
                apart = number[c] - numbers[next_node[k]]
                if left_out:
                    same = pulses[next_node[k]] == pulses[node[b]]
                    other = before[node[b]]
                else:
                    same = pulses[next_node[k]] == i
                    other = node[b]
                if (
                    same
                    and apart % stripes == 0
                    and _alike(other, before[next_node[k]], apart, pulses, numbers, before)
                ):
                    new = False
                    break
            if not new:
                continue
            next_cost[kept] = likelihood[c]
            if left_out:
                next_node[kept], next_scale[kept] = node[b], scale[b]
                next_state[kept], next_covariance[kept] = state[b], covariance[b]
            else:
                step = _angle(number[c], positions) - _angle(numbers[node[b]], positions)
                error = step - predicted[b, 0]
                _update(predicted[b], spread[b], error, next_state[kept], next_covariance[kept])
                squared = error * error / (1 + spread[b, 0, 0])
                next_scale[kept] = max((_DEGREES * scale[b] + squared) / (_DEGREES + 1), _LEAST_STD * _LEAST_STD)
                pulses[nodes], numbers[nodes], before[nodes] = i, number[c], node[b]
                next_node[kept] = nodes
                nodes += 1
            kept += 1
        alive = kept
        cost, next_cost = next_cost, cost
        node, next_node = next_node, node
        scale, next_scale = next_scale, scale
        state, next_state = next_state, state
        covariance, next_covariance = next_covariance, covariance
    path = np.empty(n, dtype=np.int64)
    length, at = 0, node[0]
    while at >= 0:
        path[length] = at
        length += 1
        at = before[at]
    backwards = path[:length][::-1]
    return pulses[backwards], numbers[backwards]
