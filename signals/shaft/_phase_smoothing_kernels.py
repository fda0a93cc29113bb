"""Square-root information smoother of angle, speed and acceleration over unevenly spaced pulses."""

import numpy as np

from signals._compile import compiled
from signals._validation import Array


@compiled
def _triangularize(rows: Array) -> None:
    """Reduce (7, 7) rows to upper triangular form in place, by Householder reflections of the first six columns."""
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
    """Return the inverse of an upper triangular matrix, (3, 3)."""
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
    """Return smoothed states (n, 3), covariances (n, 3, 3), those with the next state (n - 1, 3, 3), leverages (n,).

    `steps` and `density` (n - 1,) are the times between pulses and the spectral density of the jerk, `noise` (n,) the
    variances of the measured angles; `root` is a square root of the inverse process-noise covariance at unit step and
    density. With F(h) = [[1, h, h^2/2], [0, 1, h], [0, 0, 1]] and Q^-1 = B' B the least-squares problem is

        B (x[k + 1] - F x[k]) = 0,    (x[k][0] - angle[k]) / sqrt(noise[k]) = 0    for all k, up to unit noise.

    A forward pass of orthogonal reductions eliminates x[k] in favour of x[k + 1]; the backward pass is substitution
    (Paige and Saunders 1977). There is no prior: the initial state is diffuse.
    """
    n = angles.size
    upper = np.empty((n, 3, 3))
    beside = np.empty((n, 3, 3))
    right = np.empty((n, 3))
    rows = np.zeros((7, 7))  # columns: x[k], x[k + 1], right side
    information = np.zeros((3, 4))  # square-root information on x[k] from all pulses before it, and its right side
    for k in range(n):
        rows[:, :] = 0.0
        weight = 1 / np.sqrt(noise[k])
        if k < n - 1:  # predict: B x[k + 1] - B F x[k] = 0
            h = steps[k]
            for i in range(3):
                for j in range(i + 1):
                    rows[i, 3 + j] = root[i, j] * h ** (j - 2.5) / np.sqrt(density[k])
                rows[i, 0] = -rows[i, 3]
                rows[i, 1] = -(rows[i, 3] * h + rows[i, 4])
                rows[i, 2] = -(rows[i, 3] * h * h / 2 + rows[i, 4] * h + rows[i, 5])
        rows[3:6, 0:3] = information[:, 0:3]
        rows[3:6, 6] = information[:, 3]
        rows[6, 0] = weight  # update: the angle measured
        rows[6, 6] = weight * angles[k]
        _triangularize(rows)
        upper[k] = rows[0:3, 0:3]
        beside[k] = rows[0:3, 3:6]
        right[k] = rows[0:3, 6]
        information[:, 0:3] = rows[3:6, 3:6]
        information[:, 3] = rows[3:6, 6]
    states = np.empty((n, 3))
    covariance = np.empty((n, 3, 3))
    cross = np.empty((n - 1, 3, 3))
    leverage = np.empty(n)
    for k in range(n - 1, -1, -1):  # x[k] = R^-1 (z - S x[k + 1]), R, S, z = upper, beside, right
        inverse = _inverse(upper[k])
        for i in range(3):
            for j in range(3):
                total = 0.0
                for m in range(3):
                    total += inverse[i, m] * inverse[j, m]
                covariance[k, i, j] = total
            total = 0.0
            for m in range(3):
                remainder = right[k, m]
                if k < n - 1:
                    for p in range(3):
                        remainder -= beside[k, m, p] * states[k + 1, p]
                total += inverse[i, m] * remainder
            states[k, i] = total
        if k < n - 1:
            gain = np.zeros((3, 3))  # P[k] = (R' R)^-1 + G P[k + 1] G', with G = -R^-1 S
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
