"""The two-filter smoother of random walks observed at the nodes of a grid, in information form.

The information on a state x is a matrix J and a vector j: its likelihood is `exp(j . x - x . J x / 2)` up to a factor.
Measurements add to both, from the first node forward and from the last backward, and at each node the two sums are
added [1]_: no large numbers are subtracted, however diffuse the prior. All data with the same regressors and process
noise (two quadratures, several orders, several channels) share J, each with its own j: *lanes*, the right-hand sides.

A state holds `poles` blocks of `width` numbers: the highest backward differences first, the levels last. From one node
to the next it becomes `F (state + increment)`: F adds to each block all higher ones, and the increment is in the
highest differences alone. Between a node and the one before it levels follow Newton's backward formula, `sum_k
C(u + k - 2, k) difference_k` for u from 0 to 1 [2]_: a polynomial, constant with one pole, straight with two, on which
moments of the samples there hold all information.

References
----------
.. [1] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
.. [2] M. Abramowitz, I. A. Stegun, "Handbook of mathematical functions", National Bureau of Standards 1964, 25.2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import isqrt
from typing import NamedTuple

import numpy as np

from signals.harmonics._information_kernels import BACKWARD, FORWARD, combine, filter_information
from signals.harmonics.state_space import Floats, Indices

Gram = Floats | Callable[[slice], Floats]

# Size of the matrices and vectors of a segment of nodes, which stay in a near cache, and of those at the record's end
# whose data and past are kept, some 60 MB, so that the way back need not make them again.
STRETCH_NUMBERS, KEPT_NUMBERS = 1 << 16, 1 << 22


class Information(NamedTuple):
    """J, (state, state), and j, (state, lane)."""

    matrix: Floats
    vector: Floats

    @classmethod
    def prior(cls, variance: Floats, lanes: int) -> "Information":
        """Return the information of a prior with mean zero and (pole, width) variances, levels first."""
        return cls(np.diag(1.0 / variance[::-1].ravel()), np.zeros((variance.size, lanes)))

    def copy(self) -> "Information":
        return Information(self.matrix.copy(), self.vector.copy())


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeChain:
    """A random walk over nodes with its measurements.

    To save memory, `gram` and `data` may be functions from a range of nodes to such arrays.
    """

    # (node or 1, moment, width, width) moments of the products of the regressors of the levels: one node stands for all
    gram: Gram
    data: Floats | Callable[[slice], Floats]  # (node, pole, width, lane) moments of regressors times data
    nodes: int  # how many
    process_noise: Floats  # (node or 1, width) variances of the increments that follow each node
    before: Information  # on the state at the first node before its data

    def filter(
        self, nodes: slice, steps: Indices, state: Information, data: "NodeInformation", stored: "NodeInformation"
    ) -> None:
        """Run the information filter over a range of nodes, in place.

        The state, before the data of the node entered first, becomes that at the node after the one left last; `data`
        are those `measured` in this range. `stored`, unless of no nodes, is filled with the information at every node,
        forward with its data, backward without.
        """
        process = self.process_noise
        if len(process) > 1:
            place = np.arange(nodes.start, nodes.stop) - (steps is BACKWARD)
            process = np.ascontiguousarray(process[place.clip(0, len(process) - 1)])
        column, squares = np.empty(len(state.matrix)), np.zeros(state.vector.shape[1])
        filter_information(*data, process, False, steps, *state, column, *stored, squares)

    def measured(self, nodes: slice) -> "NodeInformation":
        """Return the information in the data of a range of nodes."""
        one = not callable(self.gram) and len(self.gram) == 1
        gram = self.gram(nodes) if callable(self.gram) else self.gram if one else self.gram[nodes]
        data = self.data(nodes) if callable(self.data) else self.data[nodes]
        (known, moments, width, _), (count, poles, _, lanes) = gram.shape, data.shape
        (basis, products), size = newton_basis(poles), poles * width
        pairs = products.reshape(poles**2, moments) @ gram.reshape(known, moments, width**2)
        information = pairs.reshape(known, poles, poles, width, width).swapaxes(2, 3)
        score = basis @ data.reshape(count, poles, width * lanes)
        return NodeInformation(information.reshape(known, size**2), score.reshape(count, size * lanes))

    def buffer(self, nodes: slice) -> "NodeInformation":
        """Return empty arrays for a range of nodes."""
        count, (matrix, vector) = nodes.stop - nodes.start, self.before
        return NodeInformation(np.empty((count, matrix.size)), np.empty((count, vector.size)))


class NodeInformation(NamedTuple):
    """Information at nodes: J, (node or 1, state state), and j, (node, state lane)."""

    matrices: Floats
    vectors: Floats


class SmoothedChain(NamedTuple):
    """Estimates at the nodes of a chain."""

    levels: Floats  # (node, width, lane)
    variances: Floats  # (node, width), where the noise has variance 1
    # (node,) variance of the fitted waveform summed over the samples of a node, in that unit: the trace of the joint
    # covariance of the levels times the information in the node's data
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


def smooth_chain(chain: NodeChain) -> SmoothedChain:
    """Smooth a chain.

    Beside the result the memory grows with the root of the chain's length: the forward filter runs once for its state
    at the start of each segment, then again segment by segment, from the last one back. Raises
    `numpy.linalg.LinAlgError` of information that is not positive definite in double precision.
    """
    width, (matrix, vector) = chain.process_noise.shape[1], chain.before
    length = max(isqrt(chain.nodes), STRETCH_NUMBERS // (matrix.size + vector.size))
    segments = [slice(begin, min(begin + length, chain.nodes)) for begin in range(0, chain.nodes, length)]
    state, starts = chain.before.copy(), []
    kept: list[tuple[NodeInformation, NodeInformation]] = []
    unstored, late = chain.buffer(slice(0, 0)), chain.nodes - max(length, KEPT_NUMBERS // (matrix.size + vector.size))
    for segment in segments:
        starts.append(state.copy())
        is_kept = segment.start >= late or segment is segments[-1]
        data, past = chain.measured(segment), chain.buffer(segment) if is_kept else unstored
        chain.filter(segment, FORWARD, state, data, past)
        if is_kept:
            kept.append((data, past))
    later = Information(0 * matrix, 0 * vector)
    scratch = np.empty_like(matrix), np.empty_like(vector), np.empty((width, width))
    found = np.empty((chain.nodes, width, vector.shape[1])), np.empty((chain.nodes, width)), np.empty(chain.nodes)
    for segment, start in zip(reversed(segments), reversed(starts), strict=True):
        if kept:
            data, past = kept.pop()
        else:
            data, past = chain.measured(segment), chain.buffer(segment)
            chain.filter(segment, FORWARD, start, data, past)
        future = chain.buffer(segment)
        chain.filter(segment, BACKWARD, later, data, future)
        if not combine(data.matrices, *past, *future, *scratch, *(values[segment] for values in found)):
            raise np.linalg.LinAlgError("information matrix is not positive definite")
    return SmoothedChain(*found)
