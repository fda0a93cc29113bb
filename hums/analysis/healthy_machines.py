"""Null distribution of the evidence over healthy machines.

A line that exceeds noise is not necessarily a defect: sound bearings have waviness, loads fluctuate, and the sensor
also picks up other machines. The distribution is that over all parts of a library of healthy synthetic records with
every drive and imperfection of the generator, made by ``benchmarks/healthy_library.py``; no measured record enters it.
It is empirical up to its largest value and extrapolated beyond by the upper 95 % bound of an exponential tail, so that
a gross defect is not lost among many parts; nothing below `RAREST_STATED` is reported.

Bearings (the scores of `hums.analysis.combs`) and teeth (the strengths of `hums.analysis.gear_damage`) have separate
distributions, that of teeth from the records whose gears have pitch deviations, since every gear has some.

For N parts the probability is ``1 - (1 - p)^N``, which treats them as independent and is conservative if they share a
cause. The channels of a record are one test of a part, with the harmonic mean of their probabilities [1]_: p if all C
channels agree, C times the least if only one shows anything.

References
----------
.. [1] D. J. Wilson, "The harmonic mean p-value for combining dependent tests", PNAS 116(4), 2019.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

_FILE = "healthy_machines.json"
RAREST_STATED = 1 / 2000  # of the library's records; what is rarer is an extrapolation, on which only verdicts rest


@dataclass(frozen=True, kw_only=True)
class HealthyMachines:
    """Distribution of strengths over healthy records.

    Attributes
    ----------
    records : int
        Number of independent healthy records.
    parts : int
        Number of parts in all of them.
    strengths : tuple of float
        Largest strengths of parts, in descending order.
    tail_strengths, tail_bounds : tuple of float
        Ascending strengths beyond the largest, and the upper 95 % bound of the probability that a part reaches each.
    """

    records: int
    parts: int
    strengths: tuple[float, ...]
    tail_strengths: tuple[float, ...] = ()
    tail_bounds: tuple[float, ...] = ()

    def probability(self, strength: float, *, parts: int = 1, others: Sequence[float] = ()) -> float:
        """Return the probability that any of `parts` parts of a healthy record reaches this strength.

        `others` are the strengths of the same part in the other channels of the record. The logarithm of the
        probability is interpolated between the strengths of the library. Above the largest, the probability for one
        part is ``1 / (parts of the library + 1)``, or the bound of the tail if that is smaller.

        Examples
        --------
        >>> from dataclasses import replace
        >>> from hums.analysis.healthy_machines import HealthyMachines
        >>> library = HealthyMachines(records=99, parts=99, strengths=(0.4, 0.2, 0.1))
        >>> [round(library.probability(s), 4) for s in (0.5, 0.2, 0.1)]
        [0.01, 0.03, 0.04]
        >>> tailed = replace(library, tail_strengths=(0.4, 4.0), tail_bounds=(2e-2, 2e-4))
        >>> [round(tailed.probability(s), 6) for s in (0.4, 0.5, 4.0)]
        [0.02, 0.01, 0.0002]
        >>> [round(library.probability(0.2, others=more), 4) for more in ([0.2], [0.0])]
        [0.03, 0.0583]
        """
        chances = [self._of_one(one) for one in (strength, *others)]
        single = len(chances) / sum(1 / chance for chance in chances)
        return -math.expm1(parts * math.log1p(-single)) if single < 1 else 1.0

    def _of_one(self, strength: float) -> float:
        """Return the probability that one part reaches a strength in one channel."""
        if not strength > 0:
            return 1.0
        single = math.exp(float(np.interp(strength, *self._curve))) / (self.parts + 1)
        if self.tail_strengths and strength > self.strengths[0]:
            bounds = np.interp(math.log(strength), np.log(self.tail_strengths), np.log(self.tail_bounds))
            single = min(single, math.exp(float(bounds)))
        return single

    @cached_property
    def _curve(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Strengths, and the logarithm of how many of n + 1 parts reach each."""
        known = np.sort(self.strengths)
        # of n parts k are at least as strong as the k-th: (k + 1) / (n + 1); 1 at strength 0, 1 / (n + 1) above all
        chance = np.concatenate([[self.parts + 1.0], np.arange(known.size, 0, -1) + 1.0, [1.0]])
        return np.concatenate([[0.0], known, known[-1:] * (1 + 1e-9)]), np.log(chance)

    def strength_at(self, probability: float, *, parts: int = 1, others: Sequence[float] = ()) -> float:
        """Return the least strength whose `probability` is at most that given; inf if none is."""
        low, high = 0.0, 2.0 * max(*self.strengths, *self.tail_strengths, 1.0)
        if self.probability(high, parts=parts, others=others) > probability:
            return math.inf
        for _ in range(60):  # halvings of a double's range
            middle = (low + high) / 2
            rare = self.probability(middle, parts=parts, others=others) <= probability
            low, high = (low, middle) if rare else (middle, high)
        return high


def healthy_share_words(probability: float) -> str:
    """Return how many healthy machines show as much, in words.

    Examples
    --------
    >>> from hums.analysis.healthy_machines import healthy_share_words
    >>> healthy_share_words(0.004), healthy_share_words(1e-9), healthy_share_words(0.7)
    ('1 in 250', 'fewer than 1 in 2,000', 'more than half of')
    """
    if probability > 0.5:  # noqa: PLR2004  (half)
        return "more than half of"
    share = f"1 in {1 / max(probability, RAREST_STATED):,.0f}"
    return share if probability > RAREST_STATED else f"fewer than {share}"


def read_library(fields: dict[str, Any]) -> HealthyMachines:
    """Return a distribution from its fields as JSON holds them."""
    return HealthyMachines(**fields | {key: tuple(value) for key, value in fields.items() if isinstance(value, list)})


@cache
def healthy_machines(parts: Literal["bearings", "teeth"]) -> HealthyMachines:
    """Return the distribution over some parts that is shipped with the package."""
    every = json.loads(resources.files("hums.analysis").joinpath(_FILE).read_text(encoding="utf-8"))
    return read_library(every[parts])
