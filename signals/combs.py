"""Comb filter of synchronous averaging: its gain, the best number of revolutions, and the hunting-tooth period."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational, Real
from typing import TYPE_CHECKING

import numpy as np

from signals._checks import Array, number, whole

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

_WHOLE = 1e-150  # distance from a whole order below which the gain is one; the quotient would underflow


def comb_gain(orders: ArrayLike, *, revolutions: int) -> Array:
    """Return the gain of an average over N revolutions at each order, from 0 to 1.

    ``|sin(pi N f) / (N sin(pi f))|`` (McFadden 1987), one at whole orders.

    Parameters
    ----------
    orders : array of numbers or of Fractions, any shape
        Orders of the averaged shaft. Fractions are reduced exactly, so that their nulls are exactly zero.
    revolutions : int
        N.

    Returns
    -------
    array
        Gains, of the shape of `orders`.

    Examples
    --------
    A null at 20 revolutions, since 20 times 32.05 is whole; -3.89 dB at 10:

    >>> import numpy as np
    >>> from fractions import Fraction
    >>> from signals import comb_gain
    >>> float(comb_gain(Fraction(641, 20), revolutions=20))
    0.0
    >>> round(float(20 * np.log10(comb_gain(32.05, revolutions=10))), 2)
    -3.89
    """
    count = whole(revolutions, name="revolutions", least=1)
    given = np.asarray(orders)
    if given.dtype.kind not in "iufO":
        raise ValueError(f"orders of type {given.dtype} must be real numbers or Fractions.")
    if given.dtype.kind == "O":
        exact = [_exact(order) for order in given.ravel()]
        beside = np.array([float(order - round(order)) for order in exact]).reshape(given.shape)
        phase = np.array([float(count * order - round(count * order)) for order in exact]).reshape(given.shape)
    else:
        if not np.all(np.isfinite(given)):
            raise ValueError("some of the orders are not finite; leave them out.")
        beside = given - np.rint(given)
        phase = count * beside - np.rint(count * beside)
    passing = np.abs(beside) < _WHOLE
    below = count * np.sin(np.pi * np.where(passing, 0.5, beside))
    return np.asarray(np.where(passing, 1.0, np.abs(np.sin(np.pi * phase) / below)), dtype=np.float64)


def _exact(order: object) -> Fraction:
    """Return an order as a Fraction, that of its binary value where it is a float."""
    if isinstance(order, bool) or not isinstance(order, Real):
        raise ValueError(f"order {order!r} must be a number or a Fraction.")  # noqa: TRY004
    if not isinstance(order, Rational):
        return Fraction(number(order, name="order"))
    return Fraction(order)


@dataclass(frozen=True, kw_only=True)
class CombAdvice:
    """Number of revolutions to average, and the comb filter's largest gain over the interfering orders.

    Attributes
    ----------
    revolutions : int
        Number of revolutions.
    gain : float
        Largest gain over the interfering orders, 0 to 1.
    null_every : int or None
        Smallest number of revolutions with an exact null on all of them, as its multiples have; None where an order is
        a float.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from signals import quietest_revolutions
    >>> quietest_revolutions([Fraction(21, 41)], most=100)
    CombAdvice(revolutions=82, gain=0.0, null_every=41)
    """

    revolutions: int
    gain: float
    null_every: int | None


def quietest_revolutions(orders: Iterable[Fraction | float], *, most: int) -> CombAdvice:
    """Return the number of revolutions whose average attenuates interfering orders most.

    An order a/b in lowest terms has its nulls at the multiples of b revolutions, all orders together at those of
    the least common multiple. Where there are not as many, or an order is a float, the number with the smallest
    largest gain is returned; of equals the largest, since noise decreases with the number.

    Parameters
    ----------
    orders : iterable of Fraction or float
        Interfering orders of the averaged shaft, Fractions where teeth define them. A null on a shaft is one on its
        harmonics too, except on those that are whole orders.
    most : int
        Largest number of revolutions available.

    Returns
    -------
    CombAdvice

    Raises
    ------
    ValueError
        No order, or a whole one, which repeats with the shaft and is not attenuated by any number of revolutions.

    Examples
    --------
    The mate of a pair of 21 and 41 teeth turns at order 21/41; its nulls are the multiples of 41 revolutions:

    >>> from fractions import Fraction
    >>> from signals import quietest_revolutions
    >>> quietest_revolutions([Fraction(21, 41)], most=100).revolutions
    82
    """
    limit = whole(most, name="most", least=1)
    given = list(orders)
    exact = [_exact(order) for order in given]
    if not exact:
        raise ValueError("no interfering order was named; name at least one.")
    for order in exact:
        if order.denominator == 1:
            raise ValueError(
                f"order {order} repeats with the averaged shaft, so no number of revolutions removes it; leave it out."
            )
    known = all(isinstance(order, Rational) for order in given)
    every = math.lcm(*(order.denominator for order in exact)) if known else None
    if every is not None and every <= limit:
        return CombAdvice(revolutions=limit // every * every, gain=0.0, null_every=every)
    counts = np.arange(1, limit + 1)
    worst = np.zeros(limit)
    for order in exact:
        beside = float(order - round(order))
        phase = counts * beside
        gain = np.abs(np.sin(np.pi * (phase - np.rint(phase))) / (counts * math.sin(math.pi * beside)))
        worst = np.maximum(worst, gain)
    best = int(limit - 1 - np.argmin(worst[::-1]))
    return CombAdvice(revolutions=best + 1, gain=float(worst[best]), null_every=every)


@dataclass(frozen=True, kw_only=True)
class HuntingPeriod:
    """Period after which the same two teeth of a gear pair mesh again.

    Attributes
    ----------
    meshes : int
        Tooth engagements in a period: the least common multiple of the numbers of teeth.
    revolutions, mate_revolutions : int
        Revolutions of either gear in a period.
    assembly_phases : int
        Number of assembly phases: the greatest common divisor of the numbers of teeth. One is a hunting-tooth pair, of
        which every tooth meets every tooth of the mate.

    Examples
    --------
    >>> from signals import hunting_period
    >>> hunting_period(20, 30).assembly_phases
    10
    """

    meshes: int
    revolutions: int
    mate_revolutions: int
    assembly_phases: int


def hunting_period(teeth: int, mate_teeth: int) -> HuntingPeriod:
    """Return the hunting-tooth period of a gear pair, in meshes and in revolutions of either gear.

    Parameters
    ----------
    teeth, mate_teeth : int
        Numbers of teeth of both gears.

    Returns
    -------
    HuntingPeriod

    Examples
    --------
    >>> from signals import hunting_period
    >>> hunting_period(21, 41)
    HuntingPeriod(meshes=861, revolutions=41, mate_revolutions=21, assembly_phases=1)
    """
    first = whole(teeth, name="teeth", least=1)
    second = whole(mate_teeth, name="mate_teeth", least=1)
    meshes = math.lcm(first, second)
    return HuntingPeriod(
        meshes=meshes,
        revolutions=meshes // first,
        mate_revolutions=meshes // second,
        assembly_phases=math.gcd(first, second),
    )
