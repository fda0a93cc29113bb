"""From defect orders to whole families of lines, and which lines a record cannot tell apart."""

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

HANN_HALF_LOBE = 2.0  # bins of 1 / revolutions from the peak of a Hann line to its first zero
_ROUNDING = 16 * np.finfo(float).eps  # a few products and sums of rounded rates


class _Line(NamedTuple):
    """One line of a family, in the columns of `order_families`."""

    component: str
    kind: str
    order: float
    exact: Fraction | None
    sources: int
    seen_from: str
    harmonic: int
    sideband: int
    spacing: float


def order_families(table: pd.DataFrame, *, harmonics: int, sidebands: int) -> pd.DataFrame:
    """List the harmonics of every defect order and the sidebands about each of them.

    Parameters
    ----------
    table : pandas.DataFrame
        What `defect_orders` returns.
    harmonics : int
        Harmonics 1 to this one.
    sidebands : int
        Sidebands up to this number on either side of each harmonic, by every spacing in column ``sidebands``.

    Returns
    -------
    pandas.DataFrame
        ``component``, ``kind``, ``order``, ``exact``, ``sources`` and ``seen_from`` as in `defect_orders`, then
        ``harmonic``, ``sideband`` (signed, 0 for the harmonic itself) and ``spacing`` (orders, 0 without a
        sideband): ``order = |harmonic x fundamental + sideband x spacing|``. It is exact where both terms are.
        A sideband that would lie below zero is listed where a spectrum shows it, one at zero not at all.
    """
    _check_count("harmonics", harmonics, least=1)
    _check_count("sidebands", sidebands, least=0)
    lines = [line for row in table.itertuples(index=False) for line in _family(row, harmonics, sidebands)]
    return pd.DataFrame(lines, columns=list(_Line._fields))


def collisions(table: pd.DataFrame, *, revolutions: float) -> pd.DataFrame:
    """List the lines of different components, or of different kinds, that lie too close for a record.

    Two lines can be told apart once they are ``HANN_HALF_LOBE`` = 2 bins apart, a bin being ``1 / revolutions``:
    the half width of the main lobe of a Hann window, so that the peak of each falls on the first zero of the other.

    Parameters
    ----------
    table : pandas.DataFrame
        What `defect_orders` or `order_families` returns.
    revolutions : float
        Length of the record in revolutions of the reference.

    Returns
    -------
    pandas.DataFrame
        A row for every pair that cannot be told apart, and for every pair next to each other that can.
        ``component``, ``kind`` and ``order`` (for families ``harmonic`` and ``sideband`` too) with ``_a`` for the
        lower and ``_b`` for the upper line; ``difference`` in orders; ``exact``, whether teeth alone make both
        orders equal; ``resolvable``; and ``revolutions_needed``, which is infinite where no record would do.

    Raises
    ------
    ValueError
        Where `revolutions` is not a positive number.
    """
    if not (math.isfinite(revolutions) and revolutions > 0):
        raise ValueError(f"revolutions = {revolutions} is not a positive number; give the length of the record.")
    lines = table.sort_values("order", kind="stable", ignore_index=True)
    lower, upper = _close_pairs(lines, HANN_HALF_LOBE / revolutions)
    difference, exact = _differences(lines, lower, upper)
    needed = np.full(difference.size, np.inf)
    np.divide(HANN_HALF_LOBE, difference, out=needed, where=difference > 0)
    shown = [name for name in ("component", "kind", "harmonic", "sideband", "order") if name in lines]
    sides = [
        lines.loc[rows, shown].reset_index(drop=True).add_suffix(suffix)
        for rows, suffix in ((lower, "_a"), (upper, "_b"))
    ]
    return pd.concat(sides, axis=1).assign(
        difference=difference, exact=exact, resolvable=needed <= revolutions, revolutions_needed=needed
    )


def _family(row: Any, harmonics: int, sidebands: int) -> Iterator[_Line]:  # noqa: ANN401 - a row of a table
    sides = [side for side in range(-sidebands, sidebands + 1) if side]
    for harmonic in range(1, harmonics + 1):
        yield _line(row, harmonic, 0, Fraction(0))
        for spacing in row.sidebands:
            beside = (_line(row, harmonic, side, spacing) for side in sides)
            yield from (line for line in beside if line.order > _ROUNDING * harmonic * row.order)


def _line(row: Any, harmonic: int, sideband: int, spacing: Fraction | float) -> _Line:  # noqa: ANN401
    both = isinstance(row.exact, Fraction) and isinstance(spacing, Fraction)
    exact = abs(harmonic * row.exact + sideband * spacing) if both else None
    order = abs(harmonic * row.order + sideband * float(spacing)) if exact is None else float(exact)
    return _Line(
        component=row.component,
        kind=row.kind,
        order=order,
        exact=exact,
        sources=row.sources,
        seen_from=row.seen_from,
        harmonic=harmonic,
        sideband=sideband,
        spacing=float(spacing),
    )


def _close_pairs(lines: pd.DataFrame, width: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of all pairs closer than `width` and of all neighbours, of rising orders.

    Lines of one component and kind are left out: that they meet hides nothing.
    """
    order = lines["order"].to_numpy(dtype=float)
    own = np.arange(order.size)
    beyond = np.searchsorted(order, order + width)
    reach = np.minimum(np.maximum(beyond, own + 2), order.size) - own - 1
    lower = np.repeat(own, reach)
    upper = lower + 1 + np.arange(lower.size) - np.repeat(np.cumsum(reach) - reach, reach)
    family = lines.groupby(["component", "kind"]).ngroup().to_numpy()
    different = family[lower] != family[upper]
    return lower[different], upper[different]


def _differences(
    lines: pd.DataFrame, lower: NDArray[np.intp], upper: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return how far apart pairs are, in rational arithmetic where both orders are exact, and which are equal so."""
    order, fractions = lines["order"].to_numpy(dtype=float), list(lines["exact"])
    difference = order[upper] - order[lower]
    # rates that are equal by formula, such as elements x cage and outer race, may differ by their rounding
    difference[difference <= _ROUNDING * order.max(initial=0.0)] = 0.0
    equal = np.zeros(difference.size, dtype=bool)
    for pair, (a, b) in enumerate(zip(lower, upper, strict=True)):
        one, other = fractions[a], fractions[b]
        if isinstance(one, Fraction) and isinstance(other, Fraction):
            difference[pair] = abs(other - one)
            equal[pair] = one == other
    return difference, equal


def _check_count(name: str, value: object, *, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} = {value!r}: give a whole number, at least {least}.")
