"""The comb that averaging is: what it lets through, which number of revolutions is best, when teeth meet again."""

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

_WHOLE = 1e-150  # nearer than this to a whole order the gain is one, and its quotient loses its digits


def comb_gain(orders: ArrayLike, *, revolutions: int) -> Array:
    """Return how much of each order an average over N revolutions lets through, from 0 to 1.

    ``|sin(pi N f) / (N sin(pi f))|`` (McFadden 1987), one at whole orders. An order of 32.05 is down by 3.89 dB
    after 10 revolutions, by 12.58 dB after 16, and gone after 20.

    Parameters
    ----------
    orders : (m,) array of numbers or of Fractions, or one
        In orders of the averaged shaft. Fractions are reduced exactly, so their nulls are exactly zero.
    revolutions : int
        N.

    Returns
    -------
    (m,) array
        Of the shape of `orders`.
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
    if isinstance(order, bool) or not isinstance(order, Real):
        raise ValueError(f"order {order!r} must be a number or a Fraction.")  # noqa: TRY004
    if not isinstance(order, Rational):
        return Fraction(number(order, name="order"))
    return Fraction(order)


@dataclass(frozen=True, kw_only=True)
class CombAdvice:
    """A number of revolutions, and the most that it lets through of the orders it was chosen against.

    ``null_every`` is the smallest number of revolutions with an exact null on all of them, and every multiple of it
    has one too; None where an order is known by a float only.
    """

    revolutions: int
    gain: float
    null_every: int | None


def quietest_revolutions(orders: Iterable[Fraction | float], *, most: int) -> CombAdvice:
    """Return how many revolutions to average so that least is left of interfering orders.

    An order a/b in lowest terms has its nulls at the multiples of b revolutions, all orders together at those of
    the least common multiple. Where that many are not to be had, or an order is no Fraction, the number is taken
    whose largest gain is least. Of equals the largest, since noise falls with the number.

    Parameters
    ----------
    orders : Fractions where teeth define them, else floats
        Interfering orders, counted in revolutions of the averaged shaft. A shaft and all its harmonics are nulled
        with the shaft, except those harmonics that are whole orders.
    most : int
        The most revolutions there are.

    Raises
    ------
    ValueError
        No order, or a whole one: it repeats with the shaft, and no number of revolutions removes it.
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
    """When two teeth that met meet again: after ``meshes`` tooth engagements, so many revolutions of either gear.

    ``assembly_phases`` is the greatest common divisor of the teeth: as many ways to assemble the pair differ in
    which teeth ever meet. One means a hunting pair: every tooth meets every tooth of its mate.
    """

    meshes: int
    revolutions: int
    mate_revolutions: int
    assembly_phases: int


def hunting_period(teeth: int, mate_teeth: int) -> HuntingPeriod:
    """Return the hunting period of a gear pair: least common multiple of the teeth, in meshes and revolutions."""
    first = whole(teeth, name="teeth", least=1)
    second = whole(mate_teeth, name="mate_teeth", least=1)
    meshes = math.lcm(first, second)
    return HuntingPeriod(
        meshes=meshes,
        revolutions=meshes // first,
        mate_revolutions=meshes // second,
        assembly_phases=math.gcd(first, second),
    )
