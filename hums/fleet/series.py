"""Series that are watched: logarithms of the indicators and lines of a record, by channel, component and name."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.monitoring.health import FEWEST_LEVELS, Layout

__all__ = ["LINE_LEVEL", "LINE_RATIO", "Series", "layout_of", "series_of", "vector"]

LINE_LEVEL, LINE_RATIO = "line_level", "line_over_surroundings"
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
    and of what they are over their surroundings.
    """
    found = {
        _series(channel, component, kind, name, unit): math.log(value)
        for channel, component, kind, name, unit, value in row.get("indicators", ())
        if value > 0 and name not in _OF_HISTORY
    }
    lines: dict[tuple[str, ...], list[float]] = {}
    for channel, spectrum, component, kind, _, _, unit, _, amplitude, snr, _ in row.get("lines", ()):
        if amplitude is not None and snr is not None and math.isfinite(amplitude) and math.isfinite(snr):
            sums = lines.setdefault((channel, spectrum, component, kind, unit), [0.0, 0.0, 0.0])
            sums[0] += amplitude**2
            sums[1] += snr**2
            sums[2] += 1
    for (channel, spectrum, component, kind, unit), (levels, ratios, count) in lines.items():
        for name, of, square in ((LINE_LEVEL, unit, levels), (LINE_RATIO, "1", ratios)):
            if square > 0:
                found[_series(channel, component, kind, f"{spectrum} {name}", of)] = math.log(square / count) / 2
    return found


@lru_cache(maxsize=100_000)
def _series(channel: str, component: str, kind: str, indicator: str, unit: str) -> Series:
    """Return the same series for all records that have it."""
    return Series(channel=channel, component=component, kind=kind, indicator=indicator, unit=unit)


def vector(found: Mapping[Series, float], series: Iterable[Series]) -> NDArray[np.float64]:
    """Return the values of some series, NaN where a record has none."""
    return np.array([found.get(key, math.nan) for key in series], dtype=np.float64)


def layout_of(series: tuple[Series, ...]) -> tuple[tuple[str, ...], tuple[str, ...], Layout]:
    """Return the names of components and of channels with a level, and which series belong to each, by kind."""
    components = tuple(sorted({key.component for key in series}))
    powers = np.array([key.power for key in series], dtype=np.float64)
    absolute = {
        channel: np.array([i for i, key in enumerate(series) if key.channel == channel and key.power], dtype=np.int64)
        for channel in sorted({key.channel for key in series})
    }
    channels = {name: those for name, those in absolute.items() if those.size >= FEWEST_LEVELS}
    kinds: dict[tuple[str, str], list[int]] = {}
    for number, key in enumerate(series):
        kinds.setdefault((key.component, key.kind), []).append(number)
    groups = tuple(
        tuple(np.array(those, dtype=np.int64) for (component, _), those in sorted(kinds.items()) if component == name)
        for name in components
    )
    layout = Layout(components=groups, channels=tuple(channels.values()), powers=powers)
    return components, tuple(channels), layout
