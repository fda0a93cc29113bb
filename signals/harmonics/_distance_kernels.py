"""Distances between the lines of many orders, stretch by stretch of a record."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]

# Adding and subtracting this rounds to whole numbers.
_ROUND = 1.5 * 2.0**52
NEAR = 0.25  # cycles a sample: two distances above it have no crossing between them, but the fold at half the rate


@compiled
def distances(one: Floats, other: Floats, folded: Floats, nearest: Floats) -> None:
    """Fill the distances, in cycles a sample, between a line and another or its image; 0 where they cross.

    Parameters
    ----------
    one, other : (stretch,) arrays, frequencies of two orders in cycles a sample.
    folded : (stretch,) array to work in.
    nearest : (stretch,) array, filled.
    """
    nearest[:] = 0.5
    for sign in (-1.0, 1.0):
        crossing = False
        for n in range(one.size):
            apart = other[n] + sign * one[n]
            folded[n] = apart - ((apart + _ROUND) - _ROUND)
            nearest[n] = min(nearest[n], abs(folded[n]))
        for n in range(one.size - 1):
            crossing |= folded[n] * folded[n + 1] < 0.0
        if crossing:
            for n in range(one.size - 1):
                a, b = folded[n], folded[n + 1]
                if a * b < 0.0 and max(abs(a), abs(b)) < NEAR:
                    nearest[n] = nearest[n + 1] = 0.0


@compiled
def _least_of(values: Floats) -> float:
    """Return the least of the values, which are lost: halves against each other, so that none waits for the last."""
    size = values.size
    while size > 1:
        half = (size + 1) // 2
        early, late = values[: size - half], values[half:size]
        for n in range(late.size):
            early[n] = min(early[n], late[n])
        size = half
    return float(values[0])


@compiled
def least(frequency: Floats, distance: Floats) -> None:
    """Fill the least distances of every two orders, (order, order), but for the diagonal.

    Parameters
    ----------
    frequency : (order, stretch) array in cycles a sample.
    """
    folded, nearest = np.empty(frequency.shape[1]), np.empty(frequency.shape[1])
    for k in range(len(frequency)):
        for other in range(k):
            distances(frequency[k], frequency[other], folded, nearest)
            distance[k, other] = distance[other, k] = _least_of(nearest)


@compiled
def close(
    frequency: Floats,
    bandwidth: Floats,
    lengths: Floats,
    distance: Floats,
    flagged: NDArray[np.bool_],
    shares: Floats,
) -> None:
    """Find where lines come within half a bandwidth of each other, or never part by a turn.

    Parameters
    ----------
    frequency, bandwidth : (order, stretch) arrays in cycles a sample.
    lengths : (stretch,) array, samples in each.
    distance : (order, order) array, as `least` fills it.
    flagged : (order, stretch) array, set where an order is close to another.
    shares : (order, order) array of zeros, filled above the diagonal: the part of the record where two are close.
    """
    folded, nearest = np.empty(frequency.shape[1]), np.empty(frequency.shape[1])
    samples, widest = lengths.sum(), [row.max() for row in bandwidth]
    for k in range(len(frequency)):
        for other in range(k + 1, len(frequency)):
            if distance[k, other] >= max(0.5 * widest[k], 0.5 * widest[other], 1.0 / samples):
                continue
            distances(frequency[k], frequency[other], folded, nearest)
            turns = 0.0
            for n in range(nearest.size):
                turns += nearest[n] * lengths[n]
            together = 0.0
            for n in range(nearest.size):
                if turns < 1.0 or nearest[n] < 0.5 * max(bandwidth[k, n], bandwidth[other, n]):
                    flagged[k, n] = flagged[other, n] = True
                    together += lengths[n]
            shares[k, other] = together / samples


@compiled
def dwell(frequency: Floats, bandwidth: Floats, lengths: Floats) -> bool:
    """Say whether any two lines stay within half a bandwidth of each other for as long as 1 over the bandwidth.

    Parameters
    ----------
    frequency, bandwidth, lengths : as for `close`.
    """
    folded, nearest = np.empty(frequency.shape[1]), np.empty(frequency.shape[1])
    for k in range(len(frequency)):
        for other in range(k + 1, len(frequency)):
            distances(frequency[k], frequency[other], folded, nearest)
            memories = 0.0
            for n in range(nearest.size):
                width = max(bandwidth[k, n], bandwidth[other, n])
                memories = memories + width * lengths[n] if nearest[n] < 0.5 * width else 0.0
                if memories >= 1.0:
                    return True
    return False


@compiled
def close_so_far(
    frequency: Floats, bandwidth: Floats, lengths: Floats, turns: Floats, together: Floats, flagged: NDArray[np.bool_]
) -> None:
    """Find where lines come within half a bandwidth of each other, or have not yet parted by a turn.

    Parameters
    ----------
    frequency : (order, 1 + stretch) array in cycles a sample, first those of the stretch before.
    bandwidth : (order,) array in cycles a sample.
    lengths : (stretch,) array, samples in each.
    turns, together : (order, order) arrays, updated above the diagonal: by how much two lines have parted so far, and
        in how many samples they were within half a bandwidth.
    flagged : (order, stretch) array, set where an order is close to another.
    """
    for k in range(len(frequency)):
        for other in range(k + 1, len(frequency)):
            near = 0.5 * max(bandwidth[k], bandwidth[other])
            for n in range(lengths.size):
                distance = 0.5
                for sign in (-1.0, 1.0):
                    before = frequency[other, n] + sign * frequency[k, n]
                    before -= (before + _ROUND) - _ROUND
                    now = frequency[other, n + 1] + sign * frequency[k, n + 1]
                    now -= (now + _ROUND) - _ROUND
                    crossed = before * now < 0.0 and max(abs(before), abs(now)) < NEAR
                    distance = 0.0 if crossed else min(distance, abs(now))
                turns[k, other] += distance * lengths[n]
                if distance < near:
                    together[k, other] += lengths[n]
                if distance < near or turns[k, other] < 1.0:
                    flagged[k, n] = flagged[other, n] = True
