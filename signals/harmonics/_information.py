"""Random walks seen at the knots of a grid: what the past and the future say of each knot, added up.

What is known of a state x is a matrix J and a vector j: its likelihood is `exp(j . x - x . J x / 2)` up to a factor.
Measurements only ever add to both, from the first knot forward and from the last backward, and at each knot the two
sums meet [1]_: nothing large is subtracted from anything large, however little is known at first. The matrix is
shared by all *lanes*, that is by all data with the same measurements and walks (two quadratures, several orders,
several channels).

A state holds `poles` blocks of `width` numbers: the levels, their first backward differences, and so on. From one
knot to the next it becomes `F (state + increment)`: F an upper triangle of ones, the increment in the highest
differences alone. A measurement may lie off its knot, by a part `offset` of the spacing, and then sees the level
there by Newton's backward formula, `sum_k C(offset + k - 1, k) difference_k`.

References
----------
.. [1] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
"""

from dataclasses import dataclass
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._knot_kernels import backward, forward

Floats = NDArray[np.float64]

# Numbers in the matrices and vectors of the stretch of knots that is smoothed at once.
STRETCH_NUMBERS = 1 << 22


@dataclass(frozen=True, kw_only=True, eq=False)
class KnotChain:
    """A random walk over knots and what is measured of its levels there; each array as `forward` explains it.

    Attributes
    ----------
    gram : (knot or 1, width, width) array.
    data : (knot, width, lane) array.
    offset : (knot,) array.
    walk_variance : (knot or 1, width) array.
    prior_variance : (pole, width) array, of the levels and differences before the first knot.
    """

    gram: Floats
    data: Floats
    offset: Floats
    walk_variance: Floats
    prior_variance: Floats

    def stretch(self, knots: slice) -> tuple[Floats, Floats, Floats]:
        """Gram, data and offsets of a range of knots."""
        return (self.gram if len(self.gram) == 1 else self.gram[knots]), self.data[knots], self.offset[knots]

    def walk(self, knots: slice, *, shift: int) -> Floats:
        """Walk variances of a range of knots; with a shift of -1, of the knots before them."""
        if len(self.walk_variance) == 1:
            return self.walk_variance
        place = np.arange(knots.start, knots.stop) + shift
        return np.ascontiguousarray(self.walk_variance[place.clip(0, len(self.walk_variance) - 1)])


def smooth_knots(chain: KnotChain, *, first: int) -> tuple[Floats, Floats, float]:
    """Smooth a chain, stretch by stretch where what the past knows would not fit into memory.

    Parameters
    ----------
    chain : what is measured.
    first : the knot whose innovations count first.

    Returns
    -------
    levels : (knot, width, lane) array.
    variances : (knot, width) array.
    log_variance : sum, from knot `first` on, of the log variances of the innovations of one lane.

    Raises
    ------
    numpy.linalg.LinAlgError
        Rounding has eaten up what is known.
    """
    knots, width, lanes = chain.data.shape
    size = chain.prior_variance.size
    length = max(isqrt(knots), STRETCH_NUMBERS // (size * (size + lanes)))
    stretches = [slice(begin, min(begin + length, knots)) for begin in range(0, knots, length)]
    matrix, vector = np.diag(1.0 / chain.prior_variance.ravel()), np.zeros((size, lanes))
    starts, log_variance = [], 0.0
    past = np.empty((0, size, size)), np.empty((0, size, lanes))
    for stretch in stretches:
        starts.append((matrix.copy(), vector.copy()))
        if stretch is stretches[-1]:
            past = _room(stretch, size, lanes)
        for part in (slice(stretch.start, min(first, stretch.stop)), slice(max(first, stretch.start), stretch.stop)):
            if part.start == first and part.stop > first:
                log_variance = -float(np.linalg.slogdet(matrix)[1])
            if part.stop > part.start:
                kept = slice(part.start - stretch.start, part.stop - stretch.start)
                known = past[0][kept], past[1][kept]
                log_variance += forward(*chain.stretch(part), chain.walk(part, shift=0), matrix, vector, *known)
    log_variance += float(np.linalg.slogdet(matrix)[1])
    levels, variances = np.empty((knots, width, lanes)), np.empty((knots, width))
    matrix, vector = np.zeros((size, size)), np.zeros((size, lanes))
    for stretch, start in zip(reversed(stretches), reversed(starts), strict=True):
        data = chain.stretch(stretch)
        if stretch is not stretches[-1]:
            past = _room(stretch, size, lanes)
            forward(*data, chain.walk(stretch, shift=0), *start, *past)
        found = levels[stretch], variances[stretch]
        if not backward(*data, chain.walk(stretch, shift=-1), matrix, vector, *past, *found):
            raise np.linalg.LinAlgError("information matrix is not positive definite")
    return levels, variances, log_variance


def _room(stretch: slice, size: int, lanes: int) -> tuple[Floats, Floats]:
    """Return room for what the past knows of each knot of a stretch."""
    count = stretch.stop - stretch.start
    return np.empty((count, size, size)), np.empty((count, size, lanes))
