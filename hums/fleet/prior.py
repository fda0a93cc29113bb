"""What is usual over machines, learned from healthy ones: deviations of indicators, and how scores depend on before."""

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from hums.fleet.series import Series
from signals.monitoring.autocorrelation import Correlation
from signals.monitoring.health import Layout, Prior
from signals.monitoring.limits import HealthyScores

PRIOR_NAME = "prior.json"


@lru_cache(maxsize=1)
def read_prior() -> dict[str, Any]:
    """Return the prior as it is stored."""
    learned: dict[str, Any] = json.loads((files("hums.fleet") / PRIOR_NAME).read_text(encoding="utf-8"))
    return learned


def prior_of(series: Sequence[Series], layout: Layout, learned: Mapping[str, Any] | None = None) -> Prior:
    """Return the usual deviations of some series; of one that no machine of the prior had, that of most others."""
    learned = learned or read_prior()
    score = learned["score_std"] * np.power(np.maximum(layout.sizes, 1), learned["score_power"])
    known = learned["log_std"]
    usual = [known.get(key.indicator, float(np.median(list(known.values())))) for key in series]
    return Prior(series=np.array(usual), score=score, level=learned["level_std"], dof=learned["dof"])


def healthy_scores(learned: Mapping[str, Any] | None = None) -> tuple[HealthyScores, ...]:
    """Return the models of healthy scores that limits are made with, one for each group of `Layout.groups`."""
    learned = learned or read_prior()
    return tuple(
        HealthyScores(
            shares=tuple(tuple(row) for row in group["shares"]),
            quantiles=tuple(tuple(row) for row in group["quantiles"]),
            widening=tuple(tuple(row) for row in group["widening"]),
            scale_dof=learned["dof"],
            correlation=Correlation(),
        )
        for group in learned["groups"]
    )
