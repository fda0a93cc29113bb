"""Families of harmonics and sidebands of defect orders, and those lines that a record cannot resolve."""

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from signals._validation import brief, checked, is_float

HANN_HALF_LOBE = 2.0  # bins of 1 / revolutions, from the peak of a line to its first zero with a Hann window
_ROUNDING = 16 * np.finfo(float).eps  # of an order, after a few products and sums


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


@checked
def order_families(table: pd.DataFrame, *, harmonics: int, sidebands: int) -> pd.DataFrame:
    """Return the harmonics of every defect order and their sidebands.

    Parameters
    ----------
    table : pandas.DataFrame
        Result of `defect_orders`.
    harmonics : int
        Highest harmonic.
    sidebands : int
        Number of sidebands on either side of each harmonic, for every spacing in column ``sidebands``.

    Returns
    -------
    pandas.DataFrame
        ``component``, ``kind``, ``order``, ``exact``, ``sources`` and ``seen_from`` as in `defect_orders`, then
        ``harmonic``, ``sideband`` (signed, 0 for the harmonic itself) and ``spacing`` (in orders, 0 without a
        sideband): ``order = |harmonic x fundamental + sideband x spacing|``, exact if both terms are. Negative orders
        are folded to their magnitude, where they appear in a spectrum; zero orders are omitted.

    Raises
    ------
    ValueError
        If `harmonics` or `sidebands` is not a whole number in range.

    Examples
    --------
    >>> import hums
    >>> table = hums.defect_orders(hums.load_gearbox("two-stage"))
    >>> mesh = table[(table.component == "stage 1") & (table.kind == "gear_mesh")]
    >>> families = hums.order_families(mesh, harmonics=1, sidebands=1)  # 23 teeth, shafts at 1 and 23/67
    >>> [str(order) for order in families.exact]
    ['23', '22', '24', '1518/67', '1564/67']
    """
    _check_table(table)
    _check_count("harmonics", harmonics, least=1)
    _check_count("sidebands", sidebands, least=0)
    most_lines = 10_000_000  # of a table: some gigabytes
    if len(table) * harmonics * (2 * sidebands + 1) > most_lines:
        raise ValueError(
            f"{len(table)} orders with harmonics = {brief(harmonics)} and sidebands = {brief(sidebands)} are over "
            f"{most_lines} lines; reduce harmonics or sidebands."
        )
    lines = [line for row in table.itertuples(index=False) for line in _family(row, harmonics, sidebands)]
    return pd.DataFrame(lines, columns=list(_Line._fields))


@checked
def collisions(table: pd.DataFrame, *, revolutions: float) -> pd.DataFrame:
    """Return close pairs of lines of different components or kinds, and whether a record resolves them.

    Two lines are resolved if they are at least ``HANN_HALF_LOBE`` = 2 bins of ``1 / revolutions`` apart, half the width
    of the main lobe of a Hann window, so that the peak of each falls on the first zero of the other.

    Parameters
    ----------
    table : pandas.DataFrame
        Result of `defect_orders` or `order_families`.
    revolutions : float
        Length of the record in revolutions of the reference.

    Returns
    -------
    pandas.DataFrame
        One row per unresolved pair, and per resolved pair of neighbours: ``component``, ``kind`` and ``order`` (for
        families also ``harmonic`` and ``sideband``), with ``_a`` for the lower and ``_b`` for the upper line;
        ``difference`` in orders; ``exact``, whether the orders are equal fractions; ``resolvable``; and
        ``revolutions_needed``, infinite for equal orders.

    Raises
    ------
    ValueError
        If `revolutions` is not a positive number.

    Examples
    --------
    >>> import hums
    >>> table = hums.defect_orders(hums.load_gearbox("two-stage"))
    >>> shaft = table[(table.component == "input") & (table.kind == "shaft")]  # order 1
    >>> tooth = table[table.component == "stage 1/intermediate"]  # order 23/67, 44/67 below
    >>> pairs = hums.collisions(table.loc[[*shaft.index, *tooth.index]], revolutions=3)
    >>> bool(pairs.resolvable[0]), float(pairs.revolutions_needed[0].round(6)), round(2 * 67 / 44, 6)
    (False, 3.045455, 3.045455)
    """
    _check_table(table)
    if not (is_float(revolutions) and math.isfinite(revolutions) and revolutions > 0):
        raise ValueError(f"revolutions = {brief(revolutions)} is not a positive number; give the length of the record.")
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
    """Yield the harmonics of a defect order, each with its sidebands."""
    numbers = [number for number in range(-sidebands, sidebands + 1) if number]
    for harmonic in range(1, harmonics + 1):
        yield _line(row, harmonic, 0, Fraction(0))
        for spacing in row.sidebands:
            lines = (_line(row, harmonic, number, spacing) for number in numbers)
            yield from (line for line in lines if line.order > _ROUNDING * harmonic * row.order)


def _line(row: Any, harmonic: int, sideband: int, spacing: Fraction | float) -> _Line:  # noqa: ANN401
    """Return the line at a harmonic of a defect order plus a number of sideband spacings."""
    is_exact = isinstance(row.exact, Fraction) and isinstance(spacing, Fraction)
    exact = abs(harmonic * row.exact + sideband * spacing) if is_exact else None
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
    """Return the rows of all pairs closer than `width` and of all neighbours, among lines sorted by order.

    Pairs of the same component and kind are omitted, as their overlap is not ambiguous.
    """
    order = lines["order"].to_numpy(dtype=float)
    row = np.arange(order.size)
    end = np.searchsorted(order, order + width)
    count = np.minimum(np.maximum(end, row + 2), order.size) - row - 1  # pairs in which the row is the lower line
    lower = np.repeat(row, count)
    upper = lower + 1 + np.arange(lower.size) - np.repeat(np.cumsum(count) - count, count)
    family = lines.groupby(["component", "kind"]).ngroup().to_numpy()
    different = family[lower] != family[upper]
    return lower[different], upper[different]


def _differences(
    lines: pd.DataFrame, lower: NDArray[np.intp], upper: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the differences of pairs, in rational arithmetic if both orders are exact, and which are exactly 0."""
    order, fractions = lines["order"].to_numpy(dtype=float), list(lines["exact"])
    difference = order[upper] - order[lower]
    # rates that are equal by formula, such as elements x cage and outer race, may differ by rounding
    difference[difference <= _ROUNDING * order.max(initial=0.0)] = 0.0
    equal = np.zeros(difference.size, dtype=bool)
    for pair, (a, b) in enumerate(zip(lower, upper, strict=True)):
        one, other = fractions[a], fractions[b]
        if isinstance(one, Fraction) and isinstance(other, Fraction):
            difference[pair] = abs(other - one)
            equal[pair] = one == other
    return difference, equal


def _check_table(table: object) -> None:
    if not (isinstance(table, pd.DataFrame) and {"order", "exact"} <= set(table.columns)):
        raise ValueError(f"table = {brief(table)}: give a table of orders from defect_orders.")


def _check_count(name: str, value: object, *, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} = {brief(value)}: give a whole number, at least {least}.")
