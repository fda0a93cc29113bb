"""Series that are watched: logarithms of the indicators and lines of a record, by channel, component and name."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.gearbox.orders import BEARING_KINDS
from signals.monitoring.health import FEWEST_LEVELS, Layout

__all__ = [
    "LINE_LEVEL",
    "LINE_RATIO",
    "Series",
    "component_parts",
    "joint_names",
    "layout_of",
    "series_of",
    "vector",
    "watched_component",
]

LINE_LEVEL, LINE_RATIO = "line_level", "line_over_surroundings"
_JOINT, _AND = "one of ", ", "
_WHOLE_SIGNAL = "record"
_IMPULSES = "record (impulses)"
_OF_HISTORY = ("na4", "nb4")  # whose own history they are held against: the charts do that here


@dataclass(frozen=True, kw_only=True, order=True)
class Series:
    """One number of every record of a machine: its channel, component, indicator and unit."""

    channel: str
    component: str
    kind: str
    indicator: str
    unit: str

    @cached_property
    def _hash(self) -> int:
        return hash((self.channel, self.component, self.kind, self.indicator, self.unit))

    def __hash__(self) -> int:  # kept, since every record looks up all of them
        return self._hash

    def __reduce__(self) -> tuple[Any, ...]:
        return _series, (self.channel, self.component, self.kind, self.indicator, self.unit)  # hashes differ elsewhere

    @property
    def power(self) -> int:
        """Power of the signal's unit: 1 of an amplitude, 2 of an energy, 0 of a ratio."""
        if self.unit in ("1", "", "deg", "rad"):
            return 0
        return 2 if self.unit.endswith("2") and not self.unit.endswith("-2") else 1


def series_of(row: Mapping[str, Any]) -> dict[Series, float]:
    """Return the logarithms of the positive indicators and lines of one record's results.

    The lines of a component in a spectrum are two series: the logarithm of the root mean square of their amplitudes,
    and of what they are over their surroundings. Bearings whose lines have the same orders are one component.
    """
    joint = joint_names(row)
    found = {
        _series(channel, joint.get(component, component), kind, name, unit): math.log(value)
        for channel, component, kind, name, unit, value in row.get("indicators", ())
        if value > 0 and name not in _OF_HISTORY
    }
    lines: dict[tuple[str, ...], list[float]] = {}
    for channel, spectrum, component, kind, _, _, unit, _, amplitude, snr, _ in row.get("lines", ()):
        if amplitude is not None and snr is not None and math.isfinite(amplitude) and math.isfinite(snr):
            sums = lines.setdefault((channel, spectrum, joint.get(component, component), kind, unit), [0.0, 0.0, 0.0])
            sums[0] += amplitude**2
            sums[1] += snr**2
            sums[2] += 1
    for (channel, spectrum, component, kind, unit), (levels, ratios, count) in lines.items():
        for name, of, square in ((LINE_LEVEL, unit, levels), (LINE_RATIO, "1", ratios)):
            if square > 0:
                found[_series(channel, component, kind, f"{spectrum} {name}", of)] = math.log(square / count) / 2
    return found


def joint_names(row: Mapping[str, Any]) -> dict[str, str]:
    """Return the name under which each of several bearings is watched whose lines have the same orders.

    What one of them shows, all show; watched apart, a fault of one would raise an alarm of each.
    """
    orders: dict[str, set[tuple[Any, ...]]] = {}
    for _, spectrum, component, kind, harmonic, sideband, _, order, *_ in row.get("lines", ()):
        if kind in BEARING_KINDS:
            orders.setdefault(component, set()).add((spectrum, kind, harmonic, sideband, order))
    equal: dict[frozenset[tuple[Any, ...]], list[str]] = {}
    for component, own in orders.items():
        equal.setdefault(frozenset(own), []).append(component)
    groups = [sorted(names) for names in equal.values() if len(names) > 1]
    return {name: _JOINT + _AND.join(names) for names in groups for name in names}


def component_parts(component: str) -> tuple[str, ...]:
    """Return the components that a watched name stands for: of "one of A, B" both, and the name itself."""
    if not component.startswith(_JOINT):
        return (component,)
    return (component, *component.removeprefix(_JOINT).split(_AND))


@lru_cache(maxsize=100_000)
def _series(channel: str, component: str, kind: str, indicator: str, unit: str) -> Series:
    """Return the same series for all records that have it."""
    return Series(channel=channel, component=component, kind=kind, indicator=indicator, unit=unit)


def vector(found: Mapping[Series, float], series: Iterable[Series]) -> NDArray[np.float64]:
    """Return the values of some series, NaN where a record has none."""
    return np.array([found.get(key, math.nan) for key in series], dtype=np.float64)


def watched_component(key: Series) -> str:
    """Return the name under which a series is watched: its component.

    Of the whole signal, what its few largest samples set (peak, and all without a unit: kurtosis, crest factor) is
    watched apart from its levels: one impact raises the former, and the limits of a machine that has such bursts in its
    baseline would be so wide that no growth of its level reaches them.
    """
    if key.component == _WHOLE_SIGNAL and (not key.power or key.indicator == "peak"):
        return _IMPULSES
    return key.component


def layout_of(series: tuple[Series, ...]) -> tuple[tuple[str, ...], tuple[str, ...], Layout]:
    """Return the names of components and of channels with a level, and which series belong to each, by kind."""
    components = tuple(sorted({watched_component(key) for key in series}))
    powers = np.array([key.power for key in series], dtype=np.float64)
    absolute = {
        channel: np.array([i for i, key in enumerate(series) if key.channel == channel and key.power], dtype=np.int64)
        for channel in sorted({key.channel for key in series})
    }
    channels = {name: those for name, those in absolute.items() if those.size >= FEWEST_LEVELS}
    kinds: dict[tuple[str, str], list[int]] = {}
    for number, key in enumerate(series):
        kinds.setdefault((watched_component(key), key.kind), []).append(number)
    groups = tuple(
        tuple(np.array(those, dtype=np.int64) for (component, _), those in sorted(kinds.items()) if component == name)
        for name in components
    )
    layout = Layout(components=groups, channels=tuple(channels.values()), powers=powers)
    return components, tuple(channels), layout
