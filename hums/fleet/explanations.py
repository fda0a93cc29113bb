"""What may explain a change of a machine: its parts, a sensor, its regime, maintenance, or something unknown."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.fleet.series import WHOLE_SIGNAL, Keys, component_parts, layout_of, watched_component
from signals.monitoring.explanations import evidence
from signals.monitoring.health import FEWEST_LEVELS

Array = NDArray[np.float64]
REGIME, UNKNOWN = "regime", "unknown"


def explanations(series: Keys, change: Array, levels: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the evidence of each part, and of each other explanation, of a change.

    Parameters
    ----------
    series : Keys
        The series of the machine.
    change : (series,) array
        Their change in standard deviations.
    levels : mapping of str to float
        That of the levels of some channels.
    """
    kinds, channels, patterns = _patterns(series)
    found = evidence(change, np.array([levels.get(channel, 0.0) for channel in channels]), **patterns)
    parts: dict[str, float] = {}
    for part, value in zip(kinds, found.explanations.tolist(), strict=True):
        parts[part] = max(value, parts.get(part, value))  # by the kind of damage that explains most
    sensors = {f"sensor {name}": value for name, value in zip(channels, found.channels.tolist(), strict=True)}
    return parts, sensors | {REGIME: float(found.channels.sum()), UNKNOWN: found.unknown}


@lru_cache(maxsize=256)
def _patterns(series: Keys) -> tuple[tuple[str, ...], tuple[str, ...], dict[str, Any]]:
    """Return the part of each kind of damage, the channels, and what `evidence` is told of them.

    Impacts once per revolution of a shaft are those of its gears. Related are the gears and the mesh of a stage, what
    is on one shaft, all indicators of a part, and those of the whole signal.
    """
    names, _, layout = layout_of(series)
    belongs, kinds = dict[str, set[str]](), list[tuple[str, NDArray[np.bool_]]]()
    for name, damages in zip(names, layout.components, strict=True):
        together = component_parts(name)
        for part in together:
            belongs.setdefault(part, {part.partition("/")[0]}).add(name)
        gears = [part for part in together[1:] if "/" in part]
        kinds += [(part, np.isin(np.arange(len(series)), those)) for those in damages for part in gears or [name]]
    own, watched = np.array([those for _, those in kinds]), [watched_component(key) for key in series]
    near = [
        [name.startswith(WHOLE_SIGNAL) or bool(belongs[part] & belongs[name]) for name in watched] for part, _ in kinds
    ]
    alike: dict[str, dict[str, list[int]]] = {}
    for place, key in enumerate(series):
        alike.setdefault(key.channel, {}).setdefault(key.indicator, []).append(place)
    groups = [[np.array(one) for one in of.values() if len(one) >= FEWEST_LEVELS] for of in alike.values()]
    return (
        tuple(part for part, _ in kinds),
        tuple(alike),
        {"own": own, "related": np.array(near) & ~own, "alike": groups},
    )
