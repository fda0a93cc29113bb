"""Square-root information smoother of angle, speed and acceleration over unevenly spaced pulses."""

import numpy as np

from signals._checks import Array
from signals._compile import compiled


@compiled
def _triangle(rows: Array) -> None:
    """Turn (7, 7) rows into an upper triangle in place, by Householder's reflections of the first six columns."""
    for k in range(6):
        length = 0.0
        for i in range(k, 7):
            length += rows[i, k] ** 2
        length = np.sqrt(length)
        if length == 0.0:
            continue
        if rows[k, k] > 0:
            length = -length
        head = rows[k, k] - length
        norm = head * head
        for i in range(k + 1, 7):
            norm += rows[i, k] ** 2
        if norm == 0.0:
            continue
        for j in range(k + 1, 7):
            dot = head * rows[k, j]
            for i in range(k + 1, 7):
                dot += rows[i, k] * rows[i, j]
            dot *= 2 / norm
            rows[k, j] -= dot * head
            for i in range(k + 1, 7):
                rows[i, j] -= dot * rows[i, k]
        rows[k, k] = length
        for i in range(k + 1, 7):
            rows[i, k] = 0.0


@compiled
def _inverse(upper: Array) -> Array:
    """Inverse of an upper triangle, (3, 3)."""
    found = np.zeros((3, 3))
    for j in range(3):
        found[j, j] = 1 / upper[j, j]
        for i in range(j - 1, -1, -1):
            total = 0.0
            for k in range(i + 1, j + 1):
                total += upper[i, k] * found[k, j]
            found[i, j] = -total / upper[i, i]
    return found


@compiled
def smooth_states(
    steps: Array, density: Array, noise: Array, angles: Array, root: Array
) -> tuple[Array, Array, Array, Array]:
    """Return smoothed states (n, 3), their covariances (n, 3, 3), those with the next (n - 1, 3, 3), leverages (n,).

    `steps` and `density` (n - 1,) are the times between pulses and the power of the jerk, `noise` (n,) the variances
    of the angles observed, `root` that of `signals.smoothing`.
    """
    n = angles.size
    upper = np.empty((n, 3, 3))
    beside = np.empty((n, 3, 3))
    right = np.empty((n, 3))
    rows = np.zeros((7, 7))
    known = np.zeros((3, 4))
    for k in range(n):
        rows[:, :] = 0.0
        weight = 1 / np.sqrt(noise[k])
        if k < n - 1:
            h = steps[k]
            for i in range(3):
                for j in range(i + 1):
                    rows[i, 3 + j] = root[i, j] * h ** (j - 2.5) / np.sqrt(density[k])
                rows[i, 0] = -rows[i, 3]
                rows[i, 1] = -(rows[i, 3] * h + rows[i, 4])
                rows[i, 2] = -(rows[i, 3] * h * h / 2 + rows[i, 4] * h + rows[i, 5])
        rows[3:6, 0:3] = known[:, 0:3]
        rows[3:6, 6] = known[:, 3]
        rows[6, 0] = weight
        rows[6, 6] = weight * angles[k]
        _triangle(rows)
        upper[k] = rows[0:3, 0:3]
        beside[k] = rows[0:3, 3:6]
        right[k] = rows[0:3, 6]
        known[:, 0:3] = rows[3:6, 3:6]
        known[:, 3] = rows[3:6, 6]
    states = np.empty((n, 3))
    covariance = np.empty((n, 3, 3))
    cross = np.empty((n - 1, 3, 3))
    leverage = np.empty(n)
    for k in range(n - 1, -1, -1):
        inverse = _inverse(upper[k])
        for i in range(3):
            for j in range(3):
                total = 0.0
                for m in range(3):
                    total += inverse[i, m] * inverse[j, m]
                covariance[k, i, j] = total
            total = 0.0
            for m in range(3):
                carried = right[k, m]
                if k < n - 1:
                    for p in range(3):
                        carried -= beside[k, m, p] * states[k + 1, p]
                total += inverse[i, m] * carried
            states[k, i] = total
        if k < n - 1:
            gain = np.zeros((3, 3))
            for i in range(3):
                for j in range(3):
                    for m in range(3):
                        gain[i, j] -= inverse[i, m] * beside[k, m, j]
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for m in range(3):
                        total += gain[i, m] * covariance[k + 1, m, j]
                    cross[k, i, j] = total
            for i in range(3):
                for j in range(3):
                    for m in range(3):
                        covariance[k, i, j] += cross[k, i, m] * gain[j, m]
        leverage[k] = covariance[k, 0, 0] / noise[k]
    return states, covariance, cross, leverage
