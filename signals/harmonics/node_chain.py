"""The smoother of random walks observed at the nodes of a grid: a filter in information form, then one pass back.

The information on a state x is a matrix J and a vector j: its likelihood is `exp(j . x - x . J x / 2)` up to a factor.
Measurements add to both, and however diffuse the prior, no large numbers are subtracted [1]_. From the last node back,
the mean and the covariance of each state follow from those of the next one [2]_: one increment after the other is
estimated from the state after it, and its variance added, so that the covariance stays positive. All data with the same
regressors and process noise (two quadratures, several orders, several channels) share J and the covariance, each with
its own j: *lanes*, the right-hand sides.

A state holds `poles` blocks of `width` numbers: the highest backward differences first, the levels last. From one node
to the next it becomes `F (state + increment)`: F adds to each block all higher ones, and the increment is in the
highest differences alone. Between a node and the one before it levels follow Newton's backward formula, `sum_k
C(u + k - 2, k) difference_k` for u from 0 to 1 [3]_: a polynomial, constant with one pole, straight with two, on which
moments of the samples there hold all information.

References
----------
.. [1] B. D. O. Anderson, J. B. Moore, *Optimal Filtering*, Prentice-Hall 1979, section 6.3.
.. [2] H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA J. 3, 1965.
.. [3] M. Abramowitz, I. A. Stegun, "Handbook of mathematical functions", National Bureau of Standards 1964, 25.2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import isqrt
from typing import Any, NamedTuple

import numpy as np

from signals.harmonics._chain_kernels import filter_forward, smooth_backward
from signals.harmonics.state_space import Floats

# Numbers of a segment of nodes that are kept for the way back, some 30 MB; more are made again, segment by segment.
KEPT_NUMBERS = 1 << 22


class Information(NamedTuple):
    """J, (state, state), and j, (state, lane)."""

    matrix: Floats
    vector: Floats

    @classmethod
    def prior(cls, variance: Floats, lanes: int) -> "Information":
        """Return the information of a prior with mean zero and (pole, width) variances, levels first."""
        return cls(np.diag(1.0 / variance[::-1].ravel()), np.zeros((variance.size, lanes)))


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeChain:
    """A random walk over nodes with its measurements."""

    # Of a range of nodes, the (node, moment, width, width) moments of the products of the regressors of the levels: a
    # function, so that those of a long chain need not be kept.
    gram: Callable[[slice], Floats]
    data: Floats  # (node, pole, width, lane) moments of regressors times data
    process_noise: Floats  # (node or 1, width) variances of the increments that follow each node
    before: Information  # on the state at the first node before its data

    def measured(self, nodes: slice) -> tuple[Floats, Floats]:
        """Return the information in a range of nodes' data: J, (node, state state), and j, (node, state lane)."""
        gram = self.gram(nodes)
        (_, moments, width, _), (count, poles, _, lanes) = gram.shape, self.data[nodes].shape
        (basis, products), size = newton_basis(poles), poles * width
        pairs = products.reshape(poles**2, moments) @ gram.reshape(count, moments, width**2)
        information = pairs.reshape(count, poles, poles, width, width).swapaxes(2, 3)
        score = basis @ self.data[nodes].reshape(count, poles, width * lanes)
        return information.reshape(count, size**2), score.reshape(count, size * lanes)


class SmoothedChain(NamedTuple):
    """Estimates at the nodes of a chain."""

    levels: Floats  # (node, width, lane)
    variances: Floats  # (node, width), where the noise has variance 1
    # (node,) variance of the fitted waveform summed over the samples of a node, in that unit: the trace of the state's
    # covariance times the information in the node's data
    explained: Floats


@lru_cache
def newton_basis(poles: int) -> tuple[Floats, Floats]:
    """Coefficients of powers of u of each difference's polynomial in Newton's backward formula, and of their products.

    (pole, pole) and (pole, pole, 2 pole - 1) arrays, the highest difference first.
    """
    rows = [np.ones(1)]
    for k in range(1, poles):
        rows.append(np.convolve(rows[-1], [k - 2, 1]) / k)
    basis = np.array([np.pad(row, (0, poles - row.size)) for row in rows[::-1]])
    return basis, np.array([[np.convolve(one, other) for other in basis] for one in basis])


def filter_nodes(*arguments: *tuple[Any, ...]) -> float:
    """Run `filter_forward`, or refuse information that is not positive definite in double precision."""
    log_determinant = filter_forward(*arguments)
    if np.isnan(log_determinant):
        raise np.linalg.LinAlgError("information matrix is not positive definite")
    return log_determinant


def integrate_out(state: Information, squares: Floats) -> tuple[float, tuple[Floats, Floats, Floats]]:
    """Integrate out the state, as if an independent one of unit variance replaced it.

    Returns log det J, and the gains, variances and offsets of `filter_forward`; `squares` grows by `j . J^-1 j`.
    """
    size, lanes = state.vector.shape
    none = np.zeros((1, size**2)), np.zeros((1, size * lanes))
    filled = np.empty((1, size, size)), np.empty((1, size)), np.empty((1, size, lanes))
    return filter_nodes(*none, np.ones((1, size)), True, *state, *filled, squares), filled


def smooth_chain(chain: NodeChain) -> SmoothedChain:
    """Smooth a chain.

    Beside the result the memory grows with the root of the chain's length: the forward filter runs once for its state
    at the start of each segment, then again segment by segment, from the last one back. Raises
    `numpy.linalg.LinAlgError` of information that is not positive definite in double precision.
    """
    (size, lanes), width = chain.before.vector.shape, chain.process_noise.shape[1]
    length = min(max(isqrt(len(chain.data)), KEPT_NUMBERS // (size * (size + lanes))), len(chain.data))
    segments = [slice(begin, min(begin + length, len(chain.data))) for begin in range(0, len(chain.data), length)]
    found = np.empty((len(chain.data), width, lanes)), np.empty((len(chain.data), width)), np.empty(len(chain.data))
    gains, variances, squares = np.empty((length, width, size)), np.empty((length, width)), np.zeros(lanes)

    def filtered(segment: slice, state: Information) -> Floats:
        (information, score), offsets, process = chain.measured(segment), found[0][segment], chain.process_noise
        if len(process) > 1:
            process = process[np.arange(segment.start, segment.stop).clip(0, len(process) - 1)]
        filled = gains[: len(offsets)], variances[: len(offsets)], offsets
        filter_nodes(information, score, process, False, *state, *filled, squares)
        return information

    state, starts = Information(*(values.copy() for values in chain.before)), list[Information]()
    for segment in segments:
        starts.append(Information(*(values.copy() for values in state)))
        information = filtered(segment, state)
    row, covariance, mean = np.empty(size), np.eye(size), np.zeros((size, lanes))
    _, end = integrate_out(state, squares)
    unused = np.empty((1, size)), np.empty(1)
    smooth_backward(np.zeros((1, size**2)), *end[:2], covariance, mean, row, end[2], *unused)
    for segment, start in zip(reversed(segments), reversed(starts), strict=True):
        if segment is not segments[-1]:
            information = filtered(segment, start)
        some = slice(0, segment.stop - segment.start)
        own = (values[segment] for values in found)
        smooth_backward(information, gains[some], variances[some], covariance, mean, row, *own)
    return SmoothedChain(*found)
