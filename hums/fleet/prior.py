"""What is usual over machines, learned from healthy ones: deviations of indicators, and limits of their scores."""

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from hums.fleet.series import Series
from signals.monitoring.health import Layout, Prior
from signals.monitoring.limits import LimitTable

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


@lru_cache(maxsize=1)
def limit_table() -> LimitTable:
    """Return the limits that the healthy machines have shown, one group for each of `Layout.groups`."""
    return LimitTable(**{name: np.array(values) for name, values in read_prior()["limits"].items()})
