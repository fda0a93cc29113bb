"""Monitored series, logarithms of the indicators and lines of a record, and what may explain their change."""

import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hums.gearbox.defect_orders import BEARING_KINDS
from signals.monitoring.charts import LimitTable
from signals.monitoring.explanations import evidence
from signals.monitoring.health import FEWEST_LEVELS, Layout, Prior

LINE_LEVEL, LINE_RATIO = "line_level", "line_over_background"
_JOINT, _AND = "one of ", ", "
WHOLE_SIGNAL = "record"
_IMPULSES = "record (impulses)"
_EVIDENCE = "modulation"  # strength of a bearing part's lines, of records in which nothing is significant as well
_OF_HISTORY = ("na4", "nb4")  # whose own history they are held against: the charts do that here
_STRIKES = "envelope"
_WEAK = 2.0  # ratio to the background below which a line is as uncertain as noise
LINE = ("channel", "spectrum", "component", "kind", "harmonic", "sideband", "units")
INDICATOR = ("channel", "component", "kind", "indicator", "units")
CONDITION = ("component", "kind")


class Keys(tuple[Any, ...]):
    """Keys of numbers: `shared` returns the same ones for equal tuples, so that caches compare them by identity."""

    __slots__ = ()
    __hash__ = object.__hash__
    __eq__ = object.__eq__


@lru_cache(maxsize=4096)
def shared(keys: tuple[Any, ...]) -> Keys:
    """Return the keys of a tuple, held once, so that what is derived from them is cached."""
    return Keys(keys)


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Numbers of a record (keys, ...) under keys that other records share."""

    keys: Keys
    values: NDArray[Any]


NOTHING = Numbers(keys=shared(()), values=np.zeros(0))  # of a record that is not analysed


def named(rows: Iterable[Sequence[Any]], names: int, numbers: int) -> Numbers:
    """Return rows of this many names, and of numbers."""
    taken = [tuple(row) for row in rows]
    values = np.array([row[names:] for row in taken], dtype=np.float64).reshape(len(taken), numbers)
    return Numbers(keys=shared(tuple(row[:names] for row in taken)), values=values)


class Series(NamedTuple):
    """One number of every record of a machine: its channel, component, indicator and unit."""

    channel: str
    component: str
    kind: str
    indicator: str
    unit: str

    @property
    def words(self) -> str:
        """Its indicator, with the kind of damage."""
        return self.indicator if self.kind in self.indicator else f"{self.kind} {self.indicator}"

    @property
    def power(self) -> int:
        """Power of the signal's unit: 1 for an amplitude, 2 for an energy, 0 for a ratio."""
        if self.unit in ("1", "", "deg", "rad"):
            return 0
        return 2 if self.unit.endswith("2") and not self.unit.endswith("-2") else 1


def series_of(indicators: Numbers, lines: Numbers, *, without: Collection[str] = ()) -> Numbers:
    """Return the logarithms of the positive indicators and lines of one record, `without` some channels.

    The lines of a component in a spectrum are two series: the logarithm of the root mean square of their amplitudes,
    and of their ratios to the background. Bearings whose lines have the same orders are one component.
    """
    joint = joint_names(lines)
    found, squares = dict[Series, float](), dict[Series, list[float]]()
    for (channel, component, kind, name, unit), value in zip(
        indicators.keys, indicators.values[:, 0].tolist(), strict=True
    ):
        if name not in _OF_HISTORY and value > 0:
            found[Series(channel, joint.get(component, component), kind, name, unit)] = math.log(value)
    for (channel, spectrum, drawn, kind, *_, unit), numbers in zip(lines.keys, lines.values.tolist(), strict=True):
        component = joint.get(f"{spectrum} {drawn}", joint.get(drawn, drawn))
        if all(map(math.isfinite, numbers)):
            for name, of, value in ((LINE_LEVEL, unit, numbers[1]), (LINE_RATIO, "1", numbers[2])):
                squares.setdefault(Series(channel, component, kind, f"{spectrum} {name}", of), []).append(value**2)
    found |= {key: math.log(mean) / 2 for key, those in squares.items() if (mean := sum(those) / len(those)) > 0}
    kept = {key: value for key, value in found.items() if key.channel not in without and value < math.inf}
    return Numbers(keys=shared(tuple(kept)), values=np.array(list(kept.values())))


@lru_cache(maxsize=4096)
def places(there: Keys, wanted: Keys) -> NDArray[np.int64]:
    """Return the indices of the requested series among others, -1 for missing ones."""
    at = {key: place for place, key in enumerate(there)}
    return np.array([at.get(key, -1) for key in wanted], dtype=np.int64)


def joint_names(lines: Numbers) -> Mapping[str, str]:
    """Return the names under which parts whose lines have the same orders are monitored.

    Bearings whose lines cannot be told apart are one component: monitored separately, a fault of one would raise an
    alarm of each. The lines of a shaft in the envelope, here "envelope SHAFT", are impacts once per revolution: of the
    shaft or of a tooth of its gears, whose sidebands are one order of the shaft apart.
    """
    bearings, equal = dict[str, list[Any]](), dict[tuple[Any, ...], list[str]]()
    first: dict[tuple[str, int], dict[str, float]] = {("shaft", 0): {}, ("tooth", -1): {}, ("tooth", 1): {}}
    for (*where, component, kind, harmonic, sideband, _), order in zip(
        lines.keys, lines.values[:, 0].tolist(), strict=True
    ):
        if kind in BEARING_KINDS:
            bearings.setdefault(component, []).append((*where, kind, harmonic, sideband, order))
        elif harmonic == 1 and (kind, sideband) in first:
            first[kind, sideband][component] = order
    for component, those in bearings.items():
        equal.setdefault(tuple(those), []).append(component)
    found = {name: _JOINT + _AND.join(sorted(names)) for names in equal.values() if len(names) > 1 for name in names}
    shafts, below, above = first.values()
    for shaft, order in shafts.items():
        gears = sorted(gear for gear in below if math.isclose(above[gear] - below[gear], 2 * order))
        if gears:
            found[f"{_STRIKES} {shaft}"] = _JOINT + _AND.join([shaft, *gears])
    return found


def component_parts(component: str) -> tuple[str, ...]:
    """Return the components that a monitored name stands for: of "one of A, B" both, and the name itself."""
    if not component.startswith(_JOINT):
        return (component,)
    return (component, *component.removeprefix(_JOINT).split(_AND))


def vector(found: Numbers, series: tuple[Series, ...]) -> NDArray[np.float64]:
    """Return the values of some series, NaN if the record has none."""
    return np.append(found.values, np.nan)[places(found.keys, shared(series))]


def watched_component(key: Series) -> str:
    """Return the name under which a series is monitored: its component.

    Indicators of the whole signal that depend on its few largest samples (peak, and those without a unit: kurtosis,
    crest factor) are monitored apart from its levels: a single impact raises them, and with such bursts in the baseline
    the limits would be too wide to detect growth of the level.
    """
    if key.component == WHOLE_SIGNAL and (not key.power or key.indicator == "peak"):
        return _IMPULSES
    return key.component


def layout_of(series: tuple[Series, ...]) -> tuple[tuple[str, ...], tuple[str, ...], Layout]:
    """Return the component of each score, the channels with a level, and the series of each score, by kind.

    Each component has a score of all its series, by kind of damage. A spall on one tooth raises the tooth outlier and
    no other indicator of the gear, among which it would be diluted; it is scored with the lines of the teeth. A bearing
    also has one for each race, rolling element and cage, of the modulation on which verdicts are based. Modulation is
    independent of the level, which changes with load and noise, so its limits are lower, and weak evidence accumulates
    over records.
    """
    components = tuple(sorted({watched_component(key) for key in series}))
    powers = np.array([key.power for key in series], dtype=np.float64)
    absolute = {
        channel: np.array([i for i, key in enumerate(series) if key.channel == channel and key.power], dtype=np.int64)
        for channel in sorted({key.channel for key in series})
    }
    channels = {name: those for name, those in absolute.items() if those.size >= FEWEST_LEVELS}
    kinds: dict[tuple[str, str], list[int]] = {}
    for number, key in enumerate(series):
        damage = "tooth" if key.indicator == "tooth_outlier" else key.kind
        kinds.setdefault((watched_component(key), damage), []).append(number)
    names, groups, scores = [], [], []
    for name in components:
        of_kinds = [np.array(those, dtype=np.int64) for (of, _), those in sorted(kinds.items()) if of == name]
        evidence = [those[[series[i].indicator == _EVIDENCE for i in those]] for those in of_kinds]
        parts = [(those,) for those in evidence if those.size]
        scores += [tuple(of_kinds), *parts]
        names += [name] * (1 + len(parts))
        groups += [0, *[1] * len(parts)]
    layout = Layout(components=tuple(scores), channels=tuple(channels.values()), powers=powers, groups=tuple(groups))
    return tuple(names), tuple(channels), layout


# ---- what is usual over machines, learned from healthy ones ----------------------------------------------------------


@lru_cache(maxsize=1)
def _stored_prior() -> dict[str, Any]:
    """Return the stored prior."""
    learned: dict[str, Any] = json.loads((files("hums.fleet") / "prior.json").read_text(encoding="utf-8"))
    return learned


def prior_of(series: Sequence[Series], layout: Layout, levels: NDArray[np.float64]) -> Prior:
    """Return the usual deviations of some series; for one that no machine of the prior had, the typical one.

    That of the level of a line falls with its ratio to the background, to that of a line without noise. Temperature and
    load move lines more slowly than a short baseline lasts, so theirs is the least one, too. `levels` (series,) are the
    series in the baseline, of which the ratios are taken.
    """
    learned = _stored_prior()
    score = learned["score_std"] * np.power([float(those.size) for those in layout.series], learned["score_power"])
    known, strong = learned["log_std"], learned["strong_line_std"]
    over = dict(zip(series, levels.tolist(), strict=True))
    usual = np.array([known.get(key.indicator, float(np.median(list(known.values())))) for key in series])
    lines = np.array([key.indicator in strong for key in series])
    for n in np.flatnonzero(lines).tolist():
        ratio = over.get(series[n]._replace(indicator=f"order_spectrum {LINE_RATIO}", unit="1"), 0.0)
        noise, least = min(1.0, _WEAK * math.exp(-ratio)), strong[series[n].indicator]
        usual[n] = math.hypot(least, noise * math.sqrt(usual[n] ** 2 - least**2))
    least = np.where(lines, usual, 0.0)
    return Prior(series=usual, least=least, score=score, level=learned["level_std"], dof=learned["dof"])


def limit_table() -> LimitTable:
    """Return the limits learned from healthy machines, one group for each of `Layout.groups`."""
    return LimitTable(**{name: np.array(values) for name, values in _stored_prior()["limits"].items()})


# ---- what may explain a change: parts, a sensor, the regime, maintenance, or something unknown -----------------------


REGIME, UNKNOWN = "regime", "unknown"


def explanations(series: Keys, change: NDArray[np.float64]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the evidence of each part, and of each other explanation, of the change of series (series,)."""
    kinds, channels, patterns = _patterns(series)
    of_kinds, of_channels, unknown = evidence(change, *patterns)
    parts: dict[str, float] = {}
    for part, value in zip(kinds, of_kinds.tolist(), strict=True):
        parts[part] = max(value, parts.get(part, value))  # by the kind of damage that explains most
    sensors = {f"sensor {name}": value for name, value in zip(channels, of_channels.tolist(), strict=True)}
    return parts, sensors | {REGIME: float(of_channels.sum()), UNKNOWN: unknown}


@lru_cache(maxsize=256)
def _patterns(series: Keys) -> tuple[list[str], list[str], tuple[Any, Any, Any]]:
    """Return the part of each kind of damage, the channels, and the arguments of `evidence` for them.

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
    watched = [watched_component(key) for key in series]
    own, related = np.array([those for _, those in kinds]), np.zeros((len(kinds), len(series)), dtype=np.bool_)
    for row, (part, _) in zip(related, kinds, strict=True):
        row[:] = [name.startswith(WHOLE_SIGNAL) or bool(belongs[part] & belongs[name]) for name in watched]
    alike: dict[str, dict[str, list[int]]] = {}
    for place, key in enumerate(series):
        alike.setdefault(key.channel, {}).setdefault(key.indicator, []).append(place)
    groups = [[np.array(one) for one in of.values() if len(one) >= FEWEST_LEVELS] for of in alike.values()]
    return [part for part, _ in kinds], list(alike), (own, related, groups)
