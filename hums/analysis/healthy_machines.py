"""How often healthy machines show as much: the null distribution of a verdict.

A line that noise alone would not make is no defect: sound bearings have waviness, loads wander, other machines are
heard. The distribution is that of the strength of the evidence (`hums.analysis.evidence`) over all parts of a library
of healthy synthetic records with every drive and imperfection of the generator; ``benchmarks/healthy_library.py`` makes
it, from synthetic records only. It is empirical: nothing below one in the number of its records plus one is stated.

A record with N parts shows its strongest by chance more often than each: ``1 - (1 - p)^N``, parts taken as independent,
which is careful where they share a cause.
"""

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

__all__ = ["HealthyMachines", "healthy_machines"]

_FILE = "healthy_machines.json"


@dataclass(frozen=True, kw_only=True)
class HealthyMachines:
    """Distribution of strengths over healthy records, for each kind of part.

    Attributes
    ----------
    records : int
        Number of independent healthy records.
    parts : dict of str to int
        Number of parts of a kind in all of them.
    strengths : dict of str to tuple of float
        Strengths above 0, falling.
    """

    records: int
    parts: dict[str, int]
    strengths: dict[str, tuple[float, ...]]

    def probability(self, kind: str, strength: float, *, parts: int = 1) -> float:
        """Return the probability that any of `parts` parts of a healthy record shows this strength or more.

        Between two strengths of the library the probability is interpolated in its logarithm; above its largest it is
        one over the number of records plus one.

        Examples
        --------
        >>> from hums.analysis.healthy_machines import HealthyMachines
        >>> library = HealthyMachines(records=99, parts={"cage": 99}, strengths={"cage": (0.4, 0.2, 0.1)})
        >>> [round(library.probability("cage", s), 4) for s in (0.5, 0.2, 0.1)]
        [0.01, 0.03, 0.04]
        """
        if not strength > 0:
            return 1.0
        known = np.asarray(self.strengths.get(kind, ()))[::-1]
        total = self.parts.get(kind, 0) + 1
        # k of them at least as strong as the k-th: (k + 1) / (n + 1); below the weakest it rises to 1 at strength 0
        chance = np.arange(known.size, 0, -1) + 1.0
        single = (
            math.exp(
                float(
                    np.interp(strength, np.r_[0.0, known, known[-1:] * (1 + 1e-9)], np.log(np.r_[total, chance, 1.0]))
                )
            )
            / total
            if known.size
            else 1 / total
        )
        whole = -math.expm1(parts * math.log1p(-min(single, 1 - 1e-12)))
        return min(1.0, max(whole, 1 / (self.records + 1)))

    def strength_at(self, kind: str, probability: float, *, parts: int = 1) -> float:
        """Return the least strength whose `probability` is at most that stated; inf where no strength reaches it."""
        known = (*self.strengths.get(kind, ()), 0.0)
        low, high = 0.0, 2.0 * known[0] + 1e-6
        if self.probability(kind, high, parts=parts) > probability:
            return math.inf
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (low, middle) if self.probability(kind, middle, parts=parts) <= probability else (middle, high)
        return high

    def to_json(self) -> str:
        """Return the distribution as JSON."""
        return json.dumps({"records": self.records, "parts": self.parts, "strengths": self.strengths})


@cache
def healthy_machines() -> HealthyMachines:
    """Return the distribution that is shipped with the package."""
    read = json.loads(resources.files("hums.analysis").joinpath(_FILE).read_text(encoding="utf-8"))
    return HealthyMachines(
        records=read["records"],
        parts=read["parts"],
        strengths={kind: tuple(values) for kind, values in read["strengths"].items()},
    )
