"""Compiled loops of the speed search: votes of the orders, passages through a chain of speeds, demodulation."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled, compiled_sums

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def add_votes(levels: Array, bins_per_hz: float, orders: Array, speeds: Array, first_bin: float, votes: Array) -> None:
    """Add ``levels[order * speed]`` of every order to ``votes[speed, frame]``, read between the bins.

    `levels` is (bins, frames), so that the innermost loop runs along memory. Below `first_bin` and beyond the last
    nothing is known, and nothing added.
    """
    frames = levels.shape[1]
    last = levels.shape[0] - 1
    for s in range(speeds.size):
        row = votes[s]
        for h in range(orders.size):
            place = orders[h] * speeds[s] * bins_per_hz
            low = int(place)
            if place < first_bin or low >= last:
                continue
            part = place - low
            below = levels[low]
            above = levels[low + 1]
            for t in range(frames):
                row[t] += below[t] + part * (above[t] - below[t])


@compiled_sums
def _spread(before: Array, kernel: Array, after: Array) -> None:
    """``after[s] = sum_d kernel[d] before[s - d]``, the kernel centred; what leaves the range is lost."""
    half = kernel.size // 2
    n = before.size
    for s in range(n):
        low = max(0, s - half)
        high = min(n - 1, s + half)
        total = 0.0
        for r in range(low, high + 1):
            total += kernel[s - r + half] * before[r]
        after[s] = total


@compiled
def posterior(likelihood: Array, kernel: Array, switch: float) -> tuple[Array, Array, float]:
    """Forward and backward through the frames.

    `likelihood` (frames, speeds) is relative to that of a shaft that does not show. From one frame to the next the
    shaft appears or disappears with probability `switch`; while it shows, its speed moves by `kernel`.

    Returns the probability of each speed in each frame (frames, speeds), that of showing nothing (frames,), and
    the logarithm of the evidence against a shaft that never shows.
    """
    frames, n = likelihood.shape
    forward = np.empty((frames, n))
    unseen = np.empty(frames)
    moved = np.empty(n)
    evidence = 0.0
    for t in range(frames):
        if t == 0:
            row = forward[0]
            for s in range(n):
                row[s] = 0.5 / n * likelihood[0, s]
            unseen[0] = 0.5
        else:
            _spread(forward[t - 1], kernel, moved)
            row = forward[t]
            gone = 0.0
            for s in range(n):
                gone += forward[t - 1, s]
            born = switch * unseen[t - 1] / n
            for s in range(n):
                row[s] = ((1 - switch) * moved[s] + born) * likelihood[t, s]
            unseen[t] = (1 - switch) * unseen[t - 1] + switch * gone
        total = unseen[t]
        for s in range(n):
            total += row[s]
        for s in range(n):
            row[s] /= total
        unseen[t] /= total
        evidence += np.log(total)
    back = np.ones(n)
    back_unseen = 1.0
    weighted = np.empty(n)
    for t in range(frames - 2, -1, -1):
        mean = 0.0
        for s in range(n):
            weighted[s] = back[s] * likelihood[t + 1, s]
            mean += weighted[s] / n
        _spread(weighted, kernel[::-1].copy(), moved)
        largest = 0.0
        fresh = (1 - switch) * back_unseen + switch * mean
        for s in range(n):
            back[s] = (1 - switch) * moved[s] + switch * back_unseen
            largest = max(largest, back[s])
        back_unseen = fresh
        largest = max(largest, back_unseen)
        back_unseen /= largest
        row = forward[t]
        total = unseen[t] * back_unseen
        for s in range(n):
            back[s] /= largest
            row[s] *= back[s]
            total += row[s]
        for s in range(n):
            row[s] /= total
        unseen[t] *= back_unseen / total
    return forward, unseen, evidence


@compiled
def likeliest_path(votes: Array, log_kernel: Array) -> Indices:
    """Viterbi's path through ``votes`` (frames, speeds), moves weighed by `log_kernel`."""
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
    """Complex amplitude of each order under Hann windows along the angle, real and imaginary part (count, orders).

    Window m is centred on ``first + m hop`` and is four hops long, so that four cover each sample, a quarter of their
    period apart: their cosines are c, s, -c and -s of one angle. `table` holds one period of the cosine and one entry
    more; between its entries it is read linearly.
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
            turn = orders[k] * angle
            place = (turn - np.floor(turn)) * steps
            cell = min(int(place), steps - 1)
            part = place - cell
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
