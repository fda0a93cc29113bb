"""Verdicts on every part of the drawing, derived from the groups of an analysis alone.

`/evidence` holds the evidence for bearings, `/gears` that for a damaged tooth of each gear, `/shafts` the levels of the
lines of each shaft, and `/unmeasured` the parts whose lines are out of band or need a longer record, with the reason.
The groups also hold what the verdicts depend on: the library of healthy machines, the stated probability, and the
condition of the sensors. `derive_verdicts` therefore reproduces the verdicts of the analysis from its file.

Imbalance, a bend, misalignment and resonance all raise the lines of a shaft. Its level is compared with the limits of
ISO 20816 declared for the machine and with the first record of its baseline; without either it is not judged. A level
does not prove a cause, so a shaft is at most indicated.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache
from typing import Any, Literal

import xarray as xr

from hums.analysis.channel import AnalysedChannel
from hums.analysis.evidence import PartEvidence
from hums.analysis.expected_lines import ORDER_SPECTRUM, MeasuredLine
from hums.analysis.findings import (
    DIAGNOSED,
    INDICATED,
    NOTHING_FOUND,
    RANK,
    Finding,
    bearing_verdicts,
    doubted,
    judging_nothing,
)
from hums.analysis.gear_damage import GearJudgement, gear_verdicts
from hums.analysis.healthy_machines import HealthyMachines, healthy_machines, read_library
from hums.analysis.reference_angle import Machine
from hums.analysis.result import Analysis, Unmeasured, group, rows_dataset, rows_of
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.thresholds import (
    FAULTY_DEPTH,
    FEWEST_CYCLES,
    GEARS_SHARE,
    RIVAL_FACTOR,
    SAME_SPEED,
    SHAFT_CERTAINTY,
    SHAFT_GROWTH,
    SLOWEST_VELOCITY_HZ,
    ZONE_SHARE,
)
from hums.gearbox.defect_orders import BEARING_KINDS, DefectOrder
from signals._validation import checked
from signals.spectra.integration import line_velocity

EVIDENCE, GEARS, SHAFTS, UNMEASURED = "evidence", "gears", "shafts", "unmeasured"
# attributes of the root: what contradicts the declared angle, and why it is not sure; empty where nothing does
CONTRADICTION, DOUBT = "declaration_contradiction", "declaration_doubt"
EXPLAINED = "declaration_explained"  # 1 if lines show what else the declared angle would be
UNSURE = "declaration_unsure_json"  # components whose rotation no line confirms, and why
MISDRAWN = "declaration_misdrawn_json"  # components whose rotation lines contradict, and how
_LIBRARY = "library_json"
_FEWEST_TURNS = 8.0  # of the reference, whose lines one order apart are the noise next to a line
_SHAFT_KIND = "shaft"
_MM_S = "mm s-1"


@dataclass(frozen=True, kw_only=True)
class ShaftLevel:
    """Level of a shaft's lines in one channel.

    Attributes
    ----------
    channel, component, units : str
        `units` is mm s-1 where the channel's unit can be integrated, else that of the channel.
    speed_hz : float
        Mean speed of the shaft in rev/s.
    levels : tuple of float
        RMS of its first lines.
    level, std : float
        RMS of all of them together, and its standard deviation from the noise next to them.
    baseline_level, baseline_std, baseline_speed_hz : float
        Those of the first record of the baseline; NaN without one.
    """

    channel: str
    component: str
    units: str
    order: float
    speed_hz: float
    levels: tuple[float, ...]
    level: float
    std: float
    baseline_level: float = math.nan
    baseline_std: float = math.nan
    baseline_speed_hz: float = math.nan


def evidence_groups(
    channels: Sequence[AnalysedChannel],
    machine: Machine,
    settings: AnalysisSettings,
    baseline: Analysis | None,
    unmeasured: Sequence[Unmeasured] | None = None,
) -> dict[str, xr.Dataset]:
    """Return the groups of an analysis from which `derive_verdicts` makes its verdicts.

    `unmeasured` are the parts that cannot be judged, default `unmeasured_parts`.
    """
    evidence = [part for channel in channels for part in channel.evidence]
    gears = [row for channel in channels for row in channel.gears]
    if unmeasured is None:
        unmeasured = unmeasured_parts(channels, gears, machine, settings)
    return {
        f"/{EVIDENCE}": rows_dataset(evidence, PartEvidence, dim="part").assign_attrs({_LIBRARY: _written("bearings")}),
        f"/{GEARS}": rows_dataset(gears, GearJudgement, dim="gear").assign_attrs({_LIBRARY: _written("teeth")}),
        f"/{SHAFTS}": rows_dataset(shaft_levels(channels, machine, baseline), ShaftLevel, dim="shaft"),
        f"/{UNMEASURED}": rows_dataset(unmeasured, Unmeasured, dim="part"),
    }


@checked
def derive_verdicts(analysis: Analysis) -> list[Finding]:
    """Derive the verdicts anew from the evidence stored in an analysis.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `hums.analyze` or `hums.open_analysis`.

    Returns
    -------
    list of Finding
        Bearings, gears, shafts, and the components that could not be measured: the rows of `hums.verdict_table`, in a
        different order. Change a value in one of the groups to see its effect on the verdict.

    Raises
    ------
    AnalysisError
        If the analysis was written by a version that did not store the evidence.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(80_000) / 4000
    >>> meshes = sum(np.cos(2 * np.pi * order * 20 * times_s) for order in (23, 46, 23 * 19 / 67))
    >>> x = meshes + np.random.default_rng(0).normal(size=times_s.size)
    >>> angle = hums.PulseTimes(times_s=np.arange(0, 20, 1 / 20), shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": x}, rate_hz=4000, units="g", angle=angle)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> sorted({(one.kind, one.verdict) for one in hums.derive_verdicts(analysis)})[:2]
    [('cage', 'nothing found'), ('inner_race', 'nothing found')]
    """
    lacking = [name for name in (EVIDENCE, GEARS, SHAFTS, UNMEASURED) if name not in analysis.children]
    if lacking:
        raise AnalysisError(
            f"this analysis lacks the groups {', '.join(lacking)}, from which verdicts are derived; make it again with "
            "hums.analyze."
        )
    needed = (EVIDENCE, GEARS, SHAFTS, UNMEASURED, "health")
    return verdicts_from({f"/{name}": group(analysis, name) for name in needed}, analysis.attrs)


def verdicts_from(groups: Mapping[str, xr.Dataset], attrs: Mapping[Any, Any]) -> list[Finding]:
    """Return what `derive_verdicts` does, from groups by path and the attributes of an analysis."""
    settings = json.loads(attrs["settings_json"])
    evidence, judged_gears = groups[f"/{EVIDENCE}"], groups[f"/{GEARS}"]
    parts, gears = rows_of(evidence, PartEvidence), rows_of(judged_gears, GearJudgement)
    tests, teeth = len({(row.channel, row.order) for row in gears}), _library(judged_gears)
    gears = [
        replace(row, probability=teeth.probability(row.strength, parts=tests)) if not row.not_judged else row
        for row in gears
    ]
    unmeasured = rows_of(groups[f"/{UNMEASURED}"], Unmeasured)
    health = groups["/health"]
    sensors = zip(*(health.variables[name].to_numpy().tolist() for name in ("name", "sensor", "status")), strict=True)
    failed = {(sensor, name) for name, sensor, status in sensors if status == "faulty"}
    faulty = [name for sensor, name in failed if sensor == "vibration"]
    # bearings and gears share what may be named in health
    bearings = bool(parts) or any(row.kind in BEARING_KINDS for row in unmeasured)
    share = (GEARS_SHARE, 1 - GEARS_SHARE) if gears and bearings else (1.0, 1.0)
    of_gears, of_bearings = (settings["false_alarm_probability"] * one for one in share)
    judged = [
        *bearing_verdicts(
            parts,
            false_alarm_probability=of_bearings,
            faulty=faulty,
            library=_library(evidence),
        ),
        *gear_verdicts(gears, false_alarm_probability=of_gears),
        *_shaft_verdicts(rows_of(groups[f"/{SHAFTS}"], ShaftLevel), settings["velocity_limits_mm_s"], faulty),
        *(
            judging_nothing(Finding(component=row.component, kind=row.kind), row.why, row.least_change)
            for row in unmeasured
        ),
    ]
    if contradiction := str(attrs[CONTRADICTION]):
        change = "judged with the speed and drawing of the machine that was recorded"
        return [judging_nothing(one, contradiction, change) for one in judged]
    if any(sensor == "tachometer" for sensor, _ in failed):
        why = "speed: the tachometer is faulty, so that no order is reliable"
        return [judging_nothing(one, why, "judged with a sound tachometer") for one in judged]
    whys, doubt = json.loads(attrs.get(UNSURE, "{}")), str(attrs[DOUBT])
    if doubt:  # a deep line shows its bearing where nothing else confirms the speed, but not against other lines
        clear = math.inf if attrs[EXPLAINED] else RIVAL_FACTOR * FAULTY_DEPTH
        judged = [doubted(one, doubt) if one.verdict == DIAGNOSED and one.depth < clear else one for one in judged]
    misdrawn = json.loads(attrs.get(MISDRAWN, "{}"))
    whys |= misdrawn | (dict.fromkeys((one.component for one in judged), doubt) if doubt else {})
    change = "judged with a speed and drawing whose lines the record shows"
    return [
        judging_nothing(one, whys[one.component], change)
        if one.component in (whys if one.verdict == NOTHING_FOUND else misdrawn) and one.kind != _SHAFT_KIND
        else one
        for one in judged
    ]


@cache
def _written(parts: Literal["bearings", "teeth"]) -> str:
    return json.dumps(asdict(healthy_machines(parts)))


def _library(dataset: xr.Dataset) -> HealthyMachines:
    return _read(str(dataset.attrs[_LIBRARY]))


@lru_cache(maxsize=8)  # most analyses have the libraries that are shipped
def _read(library: str) -> HealthyMachines:
    return read_library(json.loads(library))


# ---- Parts of which no line was measured ---------------------------------------------------------------------------


def unmeasured_parts(
    channels: Sequence[AnalysedChannel], gears: Sequence[GearJudgement], machine: Machine, settings: AnalysisSettings
) -> list[Unmeasured]:
    """Return the parts of the drawing without evidence, each with the reason.

    Parameters
    ----------
    channels : sequence of AnalysedChannel
    gears : sequence of GearJudgement
    machine : Machine
        Its defect orders name every part that can fail.
    settings : AnalysisSettings
    """
    seen = {(part.component, part.kind) for channel in channels for part in channel.evidence}
    seen |= {(row.component, "tooth") for row in gears}
    seen |= {(line.expected.component, _SHAFT_KIND) for line in _shaft_lines(channels)}
    found: dict[tuple[str, str], Unmeasured] = {}
    for row in machine.defect_orders:
        key = (row.component, row.kind)
        can_fail = row.kind in {*BEARING_KINDS, "tooth", _SHAFT_KIND} and row.order > 0
        if can_fail and key not in seen and key not in found:
            why, least_change = _why_unmeasured(row, channels, machine, settings)
            found[key] = Unmeasured(component=row.component, kind=row.kind, why=why, least_change=least_change)
    return list(found.values())


def _why_unmeasured(
    row: DefectOrder, channels: Sequence[AnalysedChannel], machine: Machine, settings: AnalysisSettings
) -> tuple[str, str]:
    """Return why no line of a part was measured, and what would change that."""
    bearing, turns = row.kind in BEARING_KINDS, max(float(channel.revolutions) for channel in channels)
    cycles, line_hz = row.order * turns, row.order * machine.top_speed_hz
    if bearing and settings.envelope_band_hz is None:
        return "out of band: no envelope was requested", "judged with an envelope band (envelope_band_hz)"
    if cycles < FEWEST_CYCLES or not bearing:
        return (
            f"too short: the record holds {cycles:.2g} cycles of its line; {FEWEST_CYCLES:g} are required",
            f"judged in a record {math.ceil(10 * FEWEST_CYCLES / cycles) / 10:.2g} times as long",
        )
    reach = max(channel.envelope_reach for channel in channels)
    if row.order * (1 + settings.slip) > reach:
        why = f"its line at {line_hz:.4g} Hz is above the {reach * machine.top_speed_hz:.4g} Hz that envelopes carry"
        why = why if reach else "a filter left too little of the signal for an envelope band"
        remedy = "a wider envelope band" if isinstance(settings.envelope_band_hz, tuple) else "a higher sampling rate"
        return f"out of band: {why}", f"judged with {remedy}"
    return (
        f"too short: {turns:.3g} revolutions are too few to estimate the noise next to its line",
        f"judged in a record of {_FEWEST_TURNS:g} revolutions or more",
    )


# ---- Shafts --------------------------------------------------------------------------------------------------------


def _shaft_lines(channels: Sequence[AnalysedChannel]) -> Iterator[MeasuredLine]:
    for channel in channels:
        for line in channel.lines:
            expected = line.expected
            slow = expected.order < FEWEST_CYCLES * expected.harmonic * line.bin_width
            if expected.kind == _SHAFT_KIND and expected.spectrum == ORDER_SPECTRUM and not slow:
                yield line


def shaft_levels(
    channels: Sequence[AnalysedChannel], machine: Machine, baseline: Analysis | None = None
) -> list[ShaftLevel]:
    """Return the level of the lines of every shaft in every channel, with that of the first record of the baseline.

    Parameters
    ----------
    channels : sequence of AnalysedChannel
    machine : Machine
    baseline : xarray.DataTree, optional
        Analysis of an earlier record; what it took over from its own baseline is passed on.
    """
    earlier = {}
    if baseline is not None and SHAFTS in baseline.children:
        earlier = {(row.channel, row.component, row.units): row for row in rows_of(group(baseline, SHAFTS), ShaftLevel)}
    families: dict[tuple[str, str], list[MeasuredLine]] = {}
    for line in _shaft_lines(channels):
        families.setdefault((line.channel, line.expected.component), []).append(line)
    found = []
    for (channel, component), lines in families.items():
        order = lines[0].expected.order / lines[0].expected.harmonic
        units, integrable = lines[0].units, _integrable(lines[0].units)
        levels, noise = [], []
        for line in lines:
            frequency = line.expected.order * machine.mean_speed_hz
            per_unit = line_velocity(1.0, frequency_hz=frequency, units=units) if integrable else 1 / math.sqrt(2)
            levels.append(per_unit * line.line.amplitude)
            noise.append(per_unit * line.line.amplitude_std)
        level = math.hypot(*levels)
        # of a root sum of squares: each line's error weighed by its share
        std = math.hypot(*(a * s for a, s in zip(levels, noise, strict=True))) / level if level else max(noise)
        was = earlier.get((channel, component, _MM_S if integrable else units))
        carried = was is not None and math.isfinite(was.baseline_level)
        found.append(
            ShaftLevel(
                channel=channel,
                component=component,
                units=_MM_S if integrable else units,
                order=order,
                speed_hz=order * machine.mean_speed_hz,
                levels=tuple(levels),
                level=level,
                std=std,
                baseline_level=math.nan if was is None else was.baseline_level if carried else was.level,
                baseline_std=math.nan if was is None else was.baseline_std if carried else was.std,
                baseline_speed_hz=math.nan if was is None else was.baseline_speed_hz if carried else was.speed_hz,
            )
        )
    return found


def _integrable(units: str) -> bool:
    try:
        line_velocity(1.0, frequency_hz=1.0, units=units)
    except ValueError:
        return False
    return True


def _shaft_verdicts(
    rows: Sequence[ShaftLevel], limits: Sequence[float] | None, faulty: Sequence[str]
) -> Iterator[Finding]:
    """Yield the verdict on every shaft, from the channel with the gravest."""
    for component in dict.fromkeys(row.component for row in rows):
        own = [row for row in rows if row.component == component]
        sound = [row for row in own if row.channel not in faulty]
        if not sound:
            yield _shaft_not_judged(own[0], "the sensor is faulty and may itself produce any line", "a sound sensor")
            continue
        yield min((_shaft_verdict(row, limits) for row in sound), key=lambda one: (RANK[one.verdict], -one.amplitude))


def _shaft_verdict(row: ShaftLevel, limits: Sequence[float] | None) -> Finding:
    """Return the verdict on a shaft in one channel from its zone and its change, not judged if it has neither."""
    compared = math.isfinite(row.baseline_level)
    zoned = limits is not None and row.units == _MM_S and row.speed_hz >= SLOWEST_VELOCITY_HZ
    if not compared and not zoned:
        slow = limits is not None and row.units == _MM_S
        why = (
            f"no baseline: {row.speed_hz:.3g} rev/s are below the {SLOWEST_VELOCITY_HZ:g} Hz from which ISO 20816 "
            "limits velocity"
            if slow
            else "no baseline or limits"
        )
        return _shaft_not_judged(row, why, "an earlier analysis as the baseline" + ("" if slow else ", or limits"))
    changes: list[tuple[float, str]] = []  # what is above its limit, by how much
    said = [f"{_lines_text(row)}, together {row.level:.3g} {row.units} RMS"]
    if zoned and limits is not None:
        zone = "ABCD"[sum(row.level > limit for limit in limits)]
        said.append(f"alone in zone {zone} of ISO 20816")
        changes.append((row.level / limits[1], f"{limits[1]:.3g} {row.units}, the limit of zone B"))
    if compared:
        if abs(row.speed_hz / row.baseline_speed_hz - 1) > SAME_SPEED:
            if not zoned:
                why = (
                    f"no baseline at this speed: {row.speed_hz:.4g} rev/s, where the first record had "
                    f"{row.baseline_speed_hz:.4g}"
                )
                return _shaft_not_judged(row, why, f"a record within {SAME_SPEED:.0%} of that speed")
        else:
            said.append(f"{row.baseline_level:.3g} in the first record of the baseline")
            if zoned and limits is not None:
                most = row.baseline_level + ZONE_SHARE * limits[1]
                text = f"{most:.3g} {row.units}, {ZONE_SHARE:.0%} of the limit of zone B above the baseline"
            else:
                noise = math.hypot(row.std, SHAFT_GROWTH * row.baseline_std)
                most = SHAFT_GROWTH * row.baseline_level + SHAFT_CERTAINTY * noise
                text = f"{most:.3g} {row.units}, above which its growth is significant"
            changes.append((row.level / most if most else math.inf, text))
    over, text = max(changes)
    doubt = "imbalance, a bend, misalignment and a resonance raise the same lines"
    above = over > 1
    return Finding(
        component=row.component,
        kind=_SHAFT_KIND,
        channel=row.channel,
        verdict=INDICATED if above else NOTHING_FOUND,
        evidence="; ".join(said) + (f"; above {text}; not certain: {doubt}." if above else f"; below {text}."),
        false_alarm_probability=math.nan,
        snr=row.level / row.std if row.std > 0 else 1e9,
        order_found=row.order,
        amplitude=row.level,
        units=f"{row.units} RMS",
        doubts=doubt if above else "",
        severity=f"{over:.2g} times {text}" if above else "within its limits",
        next_step="Measure phase at both bearings to tell imbalance from misalignment; balance or align."
        if above
        else "",
        least_change=f"{'nothing found below' if above else 'indicated above'} {text} (now {row.level:.3g})",
    )


def _lines_text(row: ShaftLevel) -> str:
    lines = ", ".join(f"{number}x {level:.3g}" for number, level in enumerate(row.levels, start=1))
    return f"lines of {row.speed_hz:.4g} rev/s: {lines}"


def _shaft_not_judged(row: ShaftLevel, why: str, needs: str) -> Finding:
    shaft = Finding(component=row.component, kind=_SHAFT_KIND, channel=row.channel, units=f"{row.units} RMS")
    measured = replace(shaft, order_found=row.order, amplitude=row.level)
    return judging_nothing(measured, why, f"judged with {needs}")
