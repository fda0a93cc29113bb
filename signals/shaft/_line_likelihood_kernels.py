"""Compiled kernels of the speed search: likelihoods, Viterbi algorithm, demodulation."""

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

    `levels` is (bins, frames), so that the innermost loop runs along memory. Nothing is added below `first_bin` and
    beyond the last bin.
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

    Window m is centred on ``first + m hop`` and is four hops long, so that four windows, a quarter of a period apart,
    cover each sample: their cosines are c, s, -c and -s of one angle. `table` is one period of the cosine and one more
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
