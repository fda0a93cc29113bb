"""Means and covariances of walks at a knot, what later data say of them, and steps from knot to knot, in place.

A state holds the levels of all columns, their first differences, and so on: see `_information`. What later data say of
it is a vector r and a matrix L that past covariances multiply [1]_, [2]_.

References
----------
.. [1] A. E. Bryson, M. Frazier, "Smoothing for linear and nonlinear dynamic systems", TDR-63-119, 1963.
.. [2] P. de Jong, "Smoothing and interpolation with the state-space model", J. American Statistical Association 84,
   1989.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._information import Knowledge

Floats = NDArray[np.float64]

# A variance predicted for a knot, at the most, times what the knot tells of it.
MOST_OPEN = 1e5


class Moments(NamedTuple):
    """Mean, (state, lane), and covariance, (state, state)."""

    mean: Floats
    covariance: Floats

    @classmethod
    def of(cls, known: Knowledge) -> "Moments":
        """Return those that go with what is known."""
        covariance = np.asarray(np.linalg.inv(known.matrix), dtype=np.float64)
        even(covariance)
        return cls(covariance @ known.vector, covariance)

    def copy(self) -> "Moments":
        return Moments(self.mean.copy(), self.covariance.copy())


class Later(NamedTuple):
    """What later data say of a state: r, (state, lane), and L, (state, state): see `met`."""

    vector: Floats
    matrix: Floats

    @classmethod
    def of(cls, known: Knowledge, state: Moments) -> "Later":
        """Return what knowledge of its own says beside that of the past."""
        both = np.eye(len(known.matrix)) + known.matrix @ state.covariance
        vector, matrix = known.vector - known.matrix @ state.mean, known.matrix
        return cls(*(np.asarray(np.linalg.solve(both, part), dtype=np.float64) for part in (vector, matrix)))

    def known(self, state: Moments) -> Knowledge:
        """Return what later data say by themselves."""
        one = np.eye(len(self.matrix))
        matrix = np.asarray(np.linalg.solve(one - self.matrix @ state.covariance, self.matrix), dtype=np.float64)
        even(matrix)
        return Knowledge(matrix, matrix @ state.mean + (one + matrix @ state.covariance) @ self.vector)


class Step(NamedTuple):
    """What the filter leaves of a knot for the way back.

    Attributes
    ----------
    gain : (state, row) array, W: by `W W^T` the covariance fell.
    seen : (state, row) array, M: rows over the root of the innovations' covariance.
    innovations : (row, lane) array, over the same root.
    """

    gain: Floats
    seen: Floats
    innovations: Floats


def measure(state: Moments, rows: Floats, values: Floats) -> tuple[Step, float]:
    """Take in, in place, (row, lane) values of (row, state) rows in noise of variance 1.

    Returns
    -------
    what to keep, and the log variance of the innovations of one lane.
    """
    shared = state.covariance @ rows.T
    root = np.linalg.cholesky(np.eye(len(rows)) + rows @ shared)
    inverse = np.linalg.inv(root).T
    step = Step(gain=shared @ inverse, seen=rows.T @ inverse, innovations=inverse.T @ (values - rows @ state.mean))
    state.mean[...] += step.gain @ step.innovations
    state.covariance[...] -= step.gain @ step.gain.T
    return step, 2 * float(np.log(np.diag(root)).sum())


def is_open(state: Moments, rows: Floats) -> bool:
    """Say whether next to nothing is known of what rows measure: of differences with the future no digit is left."""
    return bool(np.max(np.diag(state.covariance) * np.sum(rows**2, axis=0)) > MOST_OPEN)


def unmeasure(later: Later, step: Step) -> None:
    """Add, in place, what a knot's own data say of what was predicted for it."""
    gain, seen, innovations = step
    later.vector[...] += seen @ (innovations - gain.T @ later.vector)
    turned = later.matrix @ gain
    half = seen @ (0.5 * (np.eye(gain.shape[1]) + gain.T @ turned)) - turned
    both = half @ seen.T
    later.matrix[...] += both
    later.matrix[...] += both.T


def met(state: Moments, later: Later, width: int) -> tuple[Floats, Floats]:
    """Return the mean and the variances of the levels, (width,), given past and future."""
    levels = state.covariance[:width]
    variances = np.diag(state.covariance)[:width] - np.einsum("ab,ab->a", levels @ later.matrix, levels)
    return state.mean + state.covariance @ later.vector, variances


def even(matrix: Floats) -> None:
    """Make a matrix symmetric again, in place: what rounding does otherwise grows with the walks."""
    matrix += matrix.T
    matrix *= 0.5


def multiply(values: Floats, width: int, *, onward: bool, turned: bool) -> None:
    """Multiply (state, ...) values in place by F, in which every difference joins what is below it.

    Parameters
    ----------
    onward : whether by F, else by its inverse.
    turned : whether transposed.
    """
    below = list(range(0, len(values) - width, width))
    for low in reversed(below) if onward != turned else below:
        to, by = (low + width, low) if turned else (low, low + width)
        part = values[by : by + width]
        if onward:
            values[to : to + width] += part
        else:
            values[to : to + width] -= part
