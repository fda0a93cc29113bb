"""Random walks seen at the knots of a grid: what the past and the future say of each knot, added up.

What is known of a state x is a matrix J and a vector j: its likelihood is `exp(j . x - x . J x / 2)` up to a factor.
Measurements only ever add to both, from the first knot forward and from the last backward, and at each knot the two
sums meet [1]_: nothing large is subtracted from anything large, however little is known at first. The matrix is
shared by all *lanes*, that is by all data with the same measurements and walks (two quadratures, several orders,
several channels).

A state holds `poles` blocks of `width` numbers: the levels, their first backward differences, and so on. From one
knot to the next it becomes `F (state + increment)`: F an upper triangle of ones, the increment in the highest
differences alone. Between a knot and the one before it levels follow Newton's backward formula, `sum_k
C(u + k - 2, k) difference_k` at the place u from 0 to 1 [2]_: a polynomial, constant with one pole, straight with two,
so that moments tell all that samples there say of it.

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
from numpy.typing import NDArray

from signals.harmonics._knot_kernels import backward, forward

Floats = NDArray[np.float64]

# Numbers in the matrices and vectors of the stretch of knots that is smoothed at once.
STRETCH_NUMBERS = 1 << 22


class Knowledge(NamedTuple):
    """J, (state, state), and j, (state, lane)."""

    matrix: Floats
    vector: Floats

    @classmethod
    def prior(cls, variance: Floats, lanes: int) -> "Knowledge":
        """Return what (pole, width) variances about zero tell."""
        return cls(np.diag(1.0 / variance.ravel()), np.zeros((variance.size, lanes)))

    def copy(self) -> "Knowledge":
        return Knowledge(self.matrix.copy(), self.vector.copy())

    def nothing(self) -> "Knowledge":
        """Return none, of the same state."""
        return Knowledge(np.zeros_like(self.matrix), np.zeros_like(self.vector))


@dataclass(frozen=True, kw_only=True, eq=False)
class KnotChain:
    """A random walk over knots and what is measured of it there; arrays as `forward` explains them.

    Attributes
    ----------
    gram : (knot or 1, moment, width, width) array, or what gives it for a range of knots where all would be too much.
    data : (knot, pole, width, lane) array.
    walk_variance : (knot or 1, width) array.
    before : what is known of the state at the first knot before its data.
    after : what is known of it at the last knot from data after it.
    """

    gram: Floats | Callable[[slice], Floats]
    data: Floats
    walk_variance: Floats
    before: Knowledge
    after: Knowledge

    @property
    def knots(self) -> int:
        """How many."""
        return len(self.data)

    def stretch(self, knots: slice) -> tuple[Floats, Floats, Floats]:
        """Gram and data of a range of knots, and the shapes of walks of so many poles."""
        data, shape = self.data[knots], shapes(self.data.shape[1])
        if callable(self.gram):
            return self.gram(knots), data, shape
        return (self.gram if len(self.gram) == 1 else self.gram[knots]), data, shape

    def walk(self, knots: slice, *, shift: int) -> Floats:
        """Walk variances of a range of knots; with a shift of -1, of the knots before them."""
        if len(self.walk_variance) == 1:
            return self.walk_variance
        place = np.arange(knots.start, knots.stop) + shift
        return np.ascontiguousarray(self.walk_variance[place.clip(0, len(self.walk_variance) - 1)])

    def known_at(self, knots: slice) -> tuple[Knowledge, Knowledge]:
        """Return what all other knots tell of the first of a range, before its data, and of the last, after it."""
        before, after, none = self.before.copy(), self.after.copy(), _room(0, *self.before.vector.shape)
        early, late = slice(0, knots.start), slice(knots.stop, self.knots)
        forward(*self.stretch(early), self.walk(early, shift=0), *before, *none)
        _, _, width, lanes = self.data.shape
        found = np.empty((0, width, lanes)), np.empty((0, width))
        backward(*self.stretch(late), self.walk(late, shift=-1), *after, *none, *found)
        return before, after


@lru_cache
def shapes(poles: int) -> Floats:
    """(pole, pole) array: what each difference adds to levels between two knots, as coefficients of powers of u."""
    rows = [np.ones(1)]
    for k in range(1, poles):
        rows.append(np.convolve(rows[-1], [k - 2, 1]) / k)
    return np.array([np.pad(row, (0, poles - row.size)) for row in rows])


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
    knots, _, width, lanes = chain.data.shape
    size = len(chain.before.matrix)
    length = max(isqrt(knots), STRETCH_NUMBERS // (size * (size + lanes)))
    stretches = [slice(begin, min(begin + length, knots)) for begin in range(0, knots, length)]
    known = chain.before.copy()
    starts, log_variance = [], 0.0
    past = _room(0, size, lanes)
    for stretch in stretches:
        starts.append(known.copy())
        if stretch is stretches[-1]:
            past = _room(stretch.stop - stretch.start, size, lanes)
        for part in (slice(stretch.start, min(first, stretch.stop)), slice(max(first, stretch.start), stretch.stop)):
            if part.start == first and part.stop > first:
                log_variance = -float(np.linalg.slogdet(known.matrix)[1])
            if part.stop > part.start:
                kept = slice(part.start - stretch.start, part.stop - stretch.start)
                left = past[0][kept], past[1][kept]
                log_variance += forward(*chain.stretch(part), chain.walk(part, shift=0), *known, *left)
    log_variance += float(np.linalg.slogdet(known.matrix)[1])
    levels, variances = np.empty((knots, width, lanes)), np.empty((knots, width))
    later = chain.after.copy()
    for stretch, start in zip(reversed(stretches), reversed(starts), strict=True):
        data = chain.stretch(stretch)
        if stretch is not stretches[-1]:
            past = _room(stretch.stop - stretch.start, size, lanes)
            forward(*data, chain.walk(stretch, shift=0), *start, *past)
        found = levels[stretch], variances[stretch]
        if not backward(*data, chain.walk(stretch, shift=-1), *later, *past, *found):
            raise np.linalg.LinAlgError("information matrix is not positive definite")
    return levels, variances, log_variance


def _room(knots: int, size: int, lanes: int) -> tuple[Floats, Floats]:
    """Return room for what the past knows of so many knots."""
    return np.empty((knots, size, size)), np.empty((knots, size, lanes))
