"""The smoother of random walks measured at the nodes of a grid, in information form.

What is known of a state x is a matrix J and a vector j: its likelihood is `exp(j . x - x . J x / 2)` up to a factor.
Measurements only ever add to both, from the first node forward and from the last backward, and at each node the two
sums are added [1]_: nothing large is subtracted from anything large, however diffuse the prior. The matrix is shared by
all *lanes*, that is by all data with the same measurements and walks (two quadratures, several orders, several
channels).

A state holds `poles` blocks of `width` numbers: the highest backward differences first, the levels last. From one node
to the next it becomes `F (state + increment)`: each block becomes its sum with all higher ones, the increment is in the
highest differences alone. Between a node and the one before it levels follow Newton's backward formula, `sum_k
C(u + k - 2, k) difference_k` at the place u from 0 to 1 [2]_: a polynomial, constant with one pole, straight with two,
so that moments of the samples there are all the information on it.

References
----------
.. [1] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
.. [2] M. Abramowitz, I. A. Stegun, "Handbook of mathematical functions", National Bureau of Standards 1964, 25.2.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import isqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._information_kernels import BACKWARD, FORWARD, combine, filter_information

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Gram = Floats | Callable[[slice], Floats]
Outside = tuple["Information", "Information"]  # on the first node of a range, and on the last

# Numbers in the matrices and vectors of the stretch of nodes that is smoothed at once.
STRETCH_NUMBERS = 1 << 19


class Information(NamedTuple):
    """J, (state, state), and j, (state, lane)."""

    matrix: Floats
    vector: Floats

    @classmethod
    def prior(cls, variance: Floats, lanes: int) -> "Information":
        """Return that of (pole, width) variances about zero, of the levels first."""
        return cls(np.diag(1.0 / variance[::-1].ravel()), np.zeros((variance.size, lanes)))

    def copy(self) -> "Information":
        return Information(self.matrix.copy(), self.vector.copy())

    def none(self) -> "Information":
        """Return no information on the same state."""
        return Information(np.zeros_like(self.matrix), np.zeros_like(self.vector))


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeChain:
    """A random walk over nodes and its measurements there.

    Attributes
    ----------
    gram : (node or 1, moment, width, width) array, moments of the information on the levels, one node standing for
        all; or a function from a range of nodes to them where all would be too much.
    data : (node, pole, width, lane) array, moments of information times data; or a function as for `gram`.
    nodes : how many.
    process_noise : (node or 1, width) array, variances of the increments that follow each node.
    before : information on the state at the first node before its data.
    after : information on that at the last node from data after it.
    """

    gram: Gram
    data: Floats | Callable[[slice], Floats]
    nodes: int
    process_noise: Floats
    before: Information
    after: Information

    def filter(self, nodes: slice, steps: Indices, state: Information, data: "Measured", stored: "Stored") -> float:
        """Run the information filter over a range of nodes, in place.

        Parameters
        ----------
        nodes : the range.
        steps : `FORWARD` or `BACKWARD`.
        state : information at the node entered first, before its data; on return at the node after the one left last.
        data : as `measured` returns it, of these nodes.
        stored : filled with the information at every node, forward with its data, backward without; or of no nodes.

        Returns
        -------
        sum over the increments of `log det(I + Q J)`.
        """
        process = self.process_noise
        if len(process) > 1:
            place = np.arange(nodes.start, nodes.stop) - (steps is BACKWARD)
            process = np.ascontiguousarray(process[place.clip(0, len(process) - 1)])
        return filter_information(*data, process, False, steps, *state, *stored, np.zeros(state.vector.shape[1]))

    def measured(self, nodes: slice) -> "Measured":
        """Return the information in the data of a range of nodes."""
        one = not callable(self.gram) and len(self.gram) == 1
        gram = self.gram(nodes) if callable(self.gram) else self.gram if one else self.gram[nodes]
        data = self.data(nodes) if callable(self.data) else self.data[nodes]
        basis = newton_basis(data.shape[1])[::-1]
        products = np.array([[np.convolve(one, other) for other in basis] for one in basis])
        information = gram if len(basis) == 1 else _blocks(products, gram)
        score = data if len(basis) == 1 else np.einsum("im,nmal->nial", basis, data)
        shapes = (len(gram), self.before.matrix.size), (len(data), self.before.vector.size)
        return Measured(
            *(
                np.ascontiguousarray(part.reshape(shape))
                for part, shape in zip((information, score), shapes, strict=True)
            )
        )

    def outside(self, nodes: slice) -> Outside:
        """Return the information of all other nodes on the first of a range, before its data, and on the last."""
        before, after, unkept = self.before.copy(), self.after.copy(), self.store(slice(0, 0))
        early, late = slice(0, nodes.start), slice(nodes.stop, self.nodes)
        self.filter(early, FORWARD, before, self.measured(early), unkept)
        self.filter(late, BACKWARD, after, self.measured(late), unkept)
        return before, after

    def store(self, nodes: slice) -> "Stored":
        """Return empty arrays for a range of nodes."""
        count, (matrix, vector) = nodes.stop - nodes.start, self.before
        return Stored(np.empty((count, matrix.size)), np.empty((count, vector.size)))


def _blocks(products: Floats, gram: Floats) -> Floats:
    """(node, pole, width, pole, width) array `sum_m products_ikm gram_nmab`."""
    nodes, moments, width, _ = gram.shape
    poles = len(products)
    flat = products.reshape(-1, moments) @ gram.reshape(nodes, moments, width * width)
    return flat.reshape(nodes, poles, poles, width, width).transpose(0, 1, 3, 2, 4)


class Measured(NamedTuple):
    """Information in the data of nodes: H^T H, (node or 1, state state), and H^T y, (node, state lane)."""

    matrices: Floats
    vectors: Floats

    def part(self, nodes: slice) -> "Measured":
        """Return that of some of the nodes, counted from the first."""
        return Measured(self.matrices if len(self.matrices) == 1 else self.matrices[nodes], self.vectors[nodes])


class Stored(NamedTuple):
    """Information at the nodes of a range: J, (node, state state), and j, (node, state lane)."""

    matrices: Floats
    vectors: Floats

    def part(self, nodes: slice) -> "Stored":
        """Return that of some of the nodes, counted from the first."""
        return Stored(self.matrices[nodes], self.vectors[nodes])


class SmoothedChain(NamedTuple):
    """What `smooth_chain` returns.

    Attributes
    ----------
    levels : (node, width, lane) array.
    variances : (node, width) array, where the noise has variance 1.
    explained : (node,) array, the variance of the fitted waveform summed over the samples of a node, in that unit: the
        trace of the joint covariance of the levels times the information of the node on them.
    log_variance : sum, from node `first` on, of the log variances of the innovations of one lane.
    """

    levels: Floats
    variances: Floats
    explained: Floats
    log_variance: float


@lru_cache
def newton_basis(poles: int) -> Floats:
    """(pole, pole) array: the part of each difference in the levels between two nodes, coefficients of powers of u."""
    rows = [np.ones(1)]
    for k in range(1, poles):
        rows.append(np.convolve(rows[-1], [k - 2, 1]) / k)
    return np.array([np.pad(row, (0, poles - row.size)) for row in rows])


def smooth_chain(chain: NodeChain, *, first: int) -> SmoothedChain:
    """Smooth a chain.

    Parameters
    ----------
    chain : the measurements.
    first : the node whose innovations count first.

    Raises
    ------
    numpy.linalg.LinAlgError
        An information matrix is not positive definite in double precision.
    """
    width, lanes = chain.process_noise.shape[1], chain.before.vector.shape[1]
    found = np.empty((chain.nodes, width, lanes)), np.empty((chain.nodes, width)), np.empty(chain.nodes)
    log_variance = 0.0
    for nodes, part in smooth_stretches(chain, first=first):
        for values, own in zip(found, part[:3], strict=True):
            values[nodes] = own
        log_variance = part.log_variance
    return SmoothedChain(*found, log_variance)


def smooth_stretches(chain: NodeChain, *, first: int) -> Iterator[tuple[slice, SmoothedChain]]:
    """Smooth a chain stretch by stretch, from the last one back, in memory that grows with the root of its length.

    The filter runs once for its state at the start of each stretch, then again stretch by stretch.

    Yields
    ------
    nodes, smoothed : a stretch and what `smooth_chain` returns of it; the log variance is that of the whole chain.
    """
    width, (matrix, vector) = chain.process_noise.shape[1], chain.before
    length = max(isqrt(chain.nodes), STRETCH_NUMBERS // (matrix.size + vector.size))
    stretches = [slice(begin, min(begin + length, chain.nodes)) for begin in range(0, chain.nodes, length)]
    state, starts, log_variance = chain.before.copy(), [], 0.0
    unkept = chain.store(slice(0, 0))
    for stretch in stretches:
        starts.append(state.copy())
        data, past = chain.measured(stretch), chain.store(stretch) if stretch is stretches[-1] else unkept
        for part in (slice(stretch.start, min(first, stretch.stop)), slice(max(first, stretch.start), stretch.stop)):
            if part.start == first < part.stop:
                log_variance = -float(np.linalg.slogdet(state.matrix)[1])
            if part.stop > part.start:
                own = slice(part.start - stretch.start, part.stop - stretch.start)
                log_variance += chain.filter(part, FORWARD, state, data.part(own), past.part(own))
    log_variance += float(np.linalg.slogdet(state.matrix)[1])
    later = chain.after.copy()
    for stretch, start in zip(reversed(stretches), reversed(starts), strict=True):
        if stretch is not stretches[-1]:
            data, past = chain.measured(stretch), chain.store(stretch)
            chain.filter(stretch, FORWARD, start, data, past)
        future = chain.store(stretch)
        chain.filter(stretch, BACKWARD, later, data, future)
        count = stretch.stop - stretch.start
        found = np.empty((count, width, vector.shape[1])), np.empty((count, width)), np.empty(count)
        if not combine(data.matrices, *past, *future, *found):
            raise np.linalg.LinAlgError("information matrix is not positive definite")
        yield stretch, SmoothedChain(*found, log_variance)


def carry(chain: NodeChain) -> Information:
    """Return the information of all nodes' data, and that before them, on the state at the last node."""
    state, last = chain.before.copy(), slice(chain.nodes - 1, chain.nodes)
    early, stored = slice(0, last.start), chain.store(last)
    chain.filter(early, FORWARD, state, chain.measured(early), chain.store(slice(0, 0)))
    chain.filter(last, FORWARD, state, chain.measured(last), stored)
    return Information(*(part.reshape(like.shape) for part, like in zip(stored, chain.before, strict=True)))
