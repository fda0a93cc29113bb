"""A random walk measured step by step: its filter and its smoother, stretch by stretch.

A covariance filter goes forward, an information filter backward, and they meet at the outputs. Only the state
at the start of each stretch is kept, and the filter runs through a stretch again when the backward one gets
there: memory beyond the outputs grows with the square root of the number of steps.

The usual backward recursions, of Rauch, Tung and Striebel [1]_ and of Bryson and Frazier [2]_, subtract what the
future adds from what the past left open. Where the first turn of a slow shaft leaves orders open for thousands of
samples, that difference has no correct digit left; two kinds of knowledge only ever add up [3]_.

References
----------
.. [1] H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems",
   AIAA J. 3, 1965.
.. [2] A. E. Bryson, M. Frazier, "Smoothing for linear and nonlinear dynamic systems", TDR-63-119, 1963.
.. [3] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, isqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _kernels

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Steps in a stretch at least, and numbers in the matrices of a stretch at most.
SHORTEST_STRETCH = 256
STRETCH_NUMBERS = 1 << 20


class Knowledge(NamedTuple):
    """Of one state or of several: mean and covariance, or information times mean and information."""

    vector: Floats
    matrix: Floats

    def copy(self) -> "Knowledge":
        return Knowledge(self.vector.copy(), self.matrix.copy())


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A random walk and its measurements, step by step.

    Attributes
    ----------
    measurements : from a range of steps to their rows (step, row, column) and data (step, row).
    walk_variance : (column,) array.
    prior_variance : (pole, column) array, before the first step.
    wanted : (step,) array, the steps that give an output.
    """

    measurements: Callable[[slice], tuple[Floats, Floats]]
    walk_variance: Floats
    prior_variance: Floats
    wanted: Flags

    def stretches(self) -> list[slice]:
        """Ranges of about the square root of all steps: as much to keep in each as there are of them."""
        length = min(
            max(SHORTEST_STRETCH, isqrt(self.wanted.size)),
            ceil(STRETCH_NUMBERS / self.prior_variance.size**2),
        )
        return [slice(start, start + length) for start in range(0, self.wanted.size, length)]

    def prior(self) -> Knowledge:
        """State before the first step."""
        return Knowledge(np.zeros(self.prior_variance.size), np.diag(self.prior_variance.ravel()))


@dataclass
class Tally:
    """Sums over the innovations that count: squares over variances, log variances, how many."""

    square: float = 0.0
    log_variance: float = 0.0
    count: int = 0

    def add(self, innovations: Floats, roots: Floats, *, skip: int) -> None:
        """Count a stretch but for its first `skip` steps, as `forward` left it."""
        innovations, roots = innovations[max(skip, 0) :], roots[max(skip, 0) :]
        observed = roots != 0.0
        self.square += float(np.sum(innovations**2))
        self.log_variance -= 2 * float(np.sum(np.log(roots[observed])))
        self.count += int(np.count_nonzero(observed))


def filter_chain(chain: Chain, startup: int) -> tuple[Floats, Floats, Tally]:
    """Filter all steps.

    Returns
    -------
    levels, variances : (output, column) arrays.
    tally : of the innovations from step `startup` on.
    """
    columns = chain.walk_variance.size
    tally, state, parts = Tally(), chain.prior(), []
    for stretch in chain.stretches():
        wanted = chain.wanted[stretch]
        filtered, *innovations = _forward(chain, chain.measurements(stretch), state, wanted)
        tally.add(*innovations, skip=startup - stretch.start)
        variances = np.diagonal(filtered.matrix, axis1=1, axis2=2)
        # Copies: a view would keep the whole covariances.
        parts.append((filtered.vector[:, :columns].copy(), variances[:, :columns].copy()))
    levels, variances = (np.concatenate(part) for part in zip(*parts, strict=True))
    return levels, variances, tally


def smooth_chain(chain: Chain, startup: int) -> tuple[Floats, Floats, Tally]:
    """Smooth all steps: as `filter_chain`, with levels and variances from all data.

    The filter runs once for its state at the start of each stretch, then again stretch by stretch from the
    last, where what it knows meets what later data say.
    """
    tally, state, starts = Tally(), chain.prior(), []
    for stretch in chain.stretches():
        starts.append((stretch, state.copy()))
        nothing = np.zeros_like(chain.wanted[stretch])
        _, *innovations = _forward(chain, chain.measurements(stretch), state, nothing)
        tally.add(*innovations, skip=startup - stretch.start)
    later, parts = Knowledge(np.zeros_like(state.vector), np.zeros_like(state.matrix)), []
    for stretch, start in reversed(starts):
        measurements, wanted = chain.measurements(stretch), chain.wanted[stretch]
        filtered, *_ = _forward(chain, measurements, start, wanted)
        ahead = _room(wanted, later)
        _kernels.backward(*measurements, chain.walk_variance, *later, wanted, *ahead)
        parts.append(_meet(filtered, ahead, chain.walk_variance.size))
    levels, variances = (np.concatenate(part[::-1]) for part in zip(*parts, strict=True))
    return levels, variances, tally


def _forward(
    chain: Chain, measurements: tuple[Floats, Floats], state: Knowledge, wanted: Flags
) -> tuple[Knowledge, Floats, Floats]:
    """Return the filtered states where wanted and all innovations; carry `state` to the step after."""
    filtered = _room(wanted, state)
    innovations, roots = np.empty((2, *measurements[1].shape))
    _kernels.forward(*measurements, chain.walk_variance, *state, innovations, roots, wanted, *filtered)
    return filtered, innovations, roots


def _room(wanted: Flags, state: Knowledge) -> Knowledge:
    outputs = int(np.count_nonzero(wanted))
    return Knowledge(np.empty((outputs, *state.vector.shape)), np.empty((outputs, *state.matrix.shape)))


def _meet(filtered: Knowledge, ahead: Knowledge, columns: int) -> tuple[Floats, Floats]:
    """Levels and variances given both past (m, P) and future (j, J): `P' = (P^-1 + J)^-1, m + P' (j - J m)`.

    With `P = C C^T` and `I + C^T J C = G G^T`, `P' = (C G^-T) (C G^-T)^T`: sums of squares, in which nothing
    cancels however little one of the two knows.
    """
    root = np.linalg.cholesky(filtered.matrix)
    transposed = root.transpose(0, 2, 1)
    inner = np.linalg.cholesky(np.eye(filtered.vector.shape[1]) + transposed @ ahead.matrix @ root)
    surprise = ahead.vector[..., None] - ahead.matrix @ filtered.vector[..., None]
    right = np.concatenate([transposed[..., :columns], transposed @ surprise], axis=-1)
    solved = np.linalg.solve(inner, right)
    level_roots, correction = solved[..., :columns], solved[..., columns]
    levels = filtered.vector[:, :columns] + np.einsum("osc,os->oc", level_roots, correction)
    return levels, np.einsum("osc,osc->oc", level_roots, level_roots)
