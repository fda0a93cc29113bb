"""Figures, rows with their limits, and the table they make."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from scipy.stats import binom

LOST = 0.01  # probability that numbers of their own carry an unchanged tree beyond the limit of a counted row
SPREADS = 4.0  # of an averaged figure: its own spread and that of the baseline, at a probability well below LOST


@dataclass(frozen=True, kw_only=True)
class Figure:
    """What was measured: a number, of how many where it counts, its standard error where it is an average."""

    value: float
    of: int | None = None
    spread: float = 0.0

    def __str__(self) -> str:
        if self.of is not None:
            return f"{self.value:.0f} of {self.of}"
        return f"{self.value:.3g}" if self.value < 1000 else f"{self.value:,.0f}"  # noqa: PLR2004

    @classmethod
    def share(cls, counted: Sequence[bool]) -> "Figure":
        """Return how many are true, of how many."""
        return cls(value=sum(counted), of=len(counted))

    @classmethod
    def mean(cls, values: Sequence[float]) -> "Figure":
        """Return the mean of values of independent records, with its standard error."""
        middle = sum(values) / len(values)
        variance = sum((value - middle) ** 2 for value in values) / max(1, len(values) - 1)
        return cls(value=middle, spread=math.sqrt(variance / len(values)))


Better = Literal["more", "less"]
Limit = Callable[[Figure, Figure | None], float | None]


@dataclass(frozen=True)
class Miss:
    """A limit known not to hold: the row says no and why, and counts as broken only where it is worse than a figure."""

    figure: float
    why: str


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row: what is measured, which way is better, and the limit, from the figure now and that of the baseline."""

    name: str
    what: str
    better: Better = "less"
    limit: Limit = lambda _, __: None
    timed: bool = False  # the figure is a time: processors differ, and other work beside slows some parts more
    missed: Miss | None = None

    def judged(self, now: Figure | str, before: Figure | None, *, times: bool) -> tuple[tuple[str, ...], bool]:
        """Return the cells of the row, and whether it holds or is known not to; what could not be measured does not.

        Times are judged only where `times` says so.
        """
        earlier = "-" if before is None else str(before)
        if isinstance(now, str):
            return (self.name, self.what, now, earlier, "-", "**no**"), False
        limit = self.limit(now, before) if times or not self.timed else None
        if limit is None:
            return (self.name, self.what, str(now), earlier, "-", "-"), True
        holds = self.reaches(now.value, limit)
        word = "at least" if self.better == "more" else "at most"
        known = self.missed is not None and self.reaches(now.value, self.missed.figure)
        said = "yes" if holds else f"**no**: {self.missed.why}" if self.missed and known else "**no**"
        return (self.name, self.what, str(now), earlier, f"{word} {limit:.5g}", said), holds or known

    def reaches(self, value: float, limit: float) -> bool:
        """Whether a value is at least as good as a limit."""
        return value >= limit if self.better == "more" else value <= limit


def fixed(most: float) -> Limit:
    """Return a limit that does not depend on the baseline."""
    return lambda _, __: most


def same(now: Figure, before: Figure | None) -> float | None:
    """Return the baseline itself: of records that never change."""
    return None if before is None or now.of != before.of else before.value


def times(factor: float, *, least: float = 0.0) -> Limit:
    """Return a limit that is a multiple of the baseline, or `least` where that is below it, as for rounding."""
    return lambda _, before: None if before is None else max(least, factor * before.value)


def counted(better: Better) -> Limit:
    """Return the count that an unchanged tree passes with other records in all but a hundredth of cases.

    The share is the baseline's, with half a count more and less, so that none of few is not taken for never.
    """

    def limit(now: Figure, before: Figure | None) -> float | None:
        if before is None or before.of is None or now.of is None:
            return None
        share = (before.value + 0.5) / (before.of + 1)
        return float(binom.ppf(LOST if better == "more" else 1 - LOST, now.of, share))

    return limit


def averaged(better: Better) -> Limit:
    """Return the baseline, worse by some standard errors of the difference of both averages."""

    def limit(now: Figure, before: Figure | None) -> float | None:
        if before is None:
            return None
        margin = SPREADS * math.hypot(now.spread, before.spread)
        return before.value + (-margin if better == "more" else margin)

    return limit


def count_row(name: str, what: str, better: Better) -> Row:
    """Return a row that counts records whose numbers may advance."""
    return Row(name=name, what=what, better=better, limit=counted(better))


def saved(figures: Mapping[str, Figure | str]) -> dict[str, Any]:
    """Return figures as JSON holds them; what could not be measured is left out."""
    return {name: asdict(figure) for name, figure in figures.items() if isinstance(figure, Figure)}


def table(
    rows: Sequence[Row], now: Mapping[str, Figure | str], before: Mapping[str, Figure], *, baseline: str, times: bool
) -> tuple[list[str], bool]:
    """Return the lines of the table, of the rows that were measured, and whether all hold; `times` as in `Row`."""
    cells, every = [], True
    for row in rows:
        if row.name in now:
            line, holds = row.judged(now[row.name], before.get(row.name), times=times)
            cells.append(line)
            every &= holds
    head = ("row", "what", "now", baseline, "limit", "holds")
    return ["| " + " | ".join(line) + " |" for line in (head, ("---",) * len(head), *cells)], every
