"""Test of every gear of a channel for one damaged tooth (`signals.angle.local_damage`).

The record is folded at the contacts of one tooth with its mates: once per revolution on fixed axes; for a sun or ring
once per planet and revolution relative to the carrier, for a planet once per revolution relative to it. Sun, planets
and ring therefore need no window around the planet passes. These modulate the level within a revolution, by which the
record is divided. The probability of a verdict is the share of healthy gears with pitch deviations whose most
conspicuous tooth stands out as far (`hums.analysis.healthy_machines`).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.analysis.findings import INDICATED, NOTHING_FOUND, Finding, judging_nothing
from hums.analysis.healthy_machines import RAREST_STATED, HealthyMachines, healthy_machines, healthy_share_words
from hums.analysis.reference_angle import Machine
from hums.analysis.result import IndicatorValue
from hums.analysis.segments import Segment, resample_in_angle
from hums.analysis.thresholds import (
    FEWEST_CYCLES,
    GRAVE_RISE,
    MODULATED_MESH,
    SELDOM_SOUND,
)
from hums.gearbox.defect_orders import DefectOrder
from hums.gearbox.planetary_stages import planetary_stages
from signals.angle.local_damage import LocalDamage, folded, local_damage
from signals.angle.residual_energies import (
    BandEnergies,
    mesh_contrast,
    residual_energies,
    tapered_transform,
    whitened_residual,
)
from signals.resampling.resampling import PASSBAND, AngularSignal

# Half-width removed around a mesh harmonic, for run-out and planet passes, in rotation rates of its fastest gear.
# Halved, a run-out of several per cent leaves its second sideband; doubled, a quarter of the orders is lost.
_SIDEBANDS = 2.5
_SHAFT_ORDERS = 3  # of the fastest shaft, below which everything is removed
_SMOOTH_ORDERS = (
    2  # of a revolution, modulated by run-out, misalignment or planet passes; 0 for a sun, folded by planet
)
_MASKED_TEETH = 1.5  # on either side of a damaged tooth, removed before weaker gears are tested again
_NO_ANGLE = "the speed is nominal and no line follows its changes, so the angle is not known to within a tooth"
_FAULTY = "the sensor is faulty"
_COMPARE = "Compare with an earlier record at the same speed and load, or inspect the teeth."


@dataclass(frozen=True, kw_only=True)
class GearJudgement:
    """Evidence for one damaged tooth of a gear in one channel.

    Attributes
    ----------
    channel, units : str
    component : str
        Mesh and gear, as in `hums.defect_orders`.
    also : tuple of str
        Gears with the same tooth contact rate.
    rivals : tuple of str
        Those of `also` that the modulation of the meshes cannot exclude: the tooth may be on any of them.
    order : float
        Contacts of one tooth per revolution of the reference.
    teeth : int
    turns : int
        Revolutions of the gear used, with each contact of a sun or ring tooth with a planet counted; 0 if not judged.
    probability : float
        Probability that a healthy machine shows as much, over all gears and channels; 1 if not judged.
    strength, rise : float
        As in `LocalDamage`.
    least_rise : float
        Rise from which on the tooth would be named, whichever single band it affects.
    amplitude : float
        RMS of the envelope at the tooth, in `units`.
    position_rev : float
        Angle of the tooth, in revolutions of the gear from the reference's angle zero.
    band_orders : (float, float)
        Orders of the reference in which the tooth stands out most.
    knock_of : str
        Shaft whose knock once per revolution looks the same, since no mesh is modulated; empty if one is, or if the
        tooth contacts do not repeat at the rate of a shaft.
    explained_by : str
        Gears whose damaged teeth explain what this gear shows, joined by "or"; empty if there are none.
    not_judged : str
        Reason; empty if judged.
    unmeasured_angle : int
        1 if the speed is nominal and its changes were not followed. A tooth that stands out all the same is reported,
        but none is called sound.
    from_pulse : int
        1 if the gear turns with a shaft whose tachometer gives one pulse per revolution, so that teeth can be counted
        from the pulse.
    """

    channel: str
    units: str
    component: str
    also: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    order: float
    teeth: int
    turns: int = 0
    probability: float = 1.0
    strength: float = 0.0
    rise: float = 1.0
    least_rise: float = 1.0
    amplitude: float = math.nan
    position_rev: float = math.nan
    band_orders: tuple[float, float] = (math.nan, math.nan)
    knock_of: str = ""
    explained_by: str = ""
    not_judged: str = ""
    unmeasured_angle: int = 0
    from_pulse: int = 0


@dataclass(frozen=True, kw_only=True)
class ToothEnvelope:
    """The squared envelope of the band in which a gear's tooth stands out.

    `order` is the number of tooth contacts per revolution, `harmonic` the lowest multiple of it that modulation of a
    sound gear does not cause.
    """

    energies: BandEnergies
    order: float
    harmonic: int


@dataclass(frozen=True, kw_only=True)
class _Tooth:
    """A gear of a mesh: its row of the defect orders, its teeth, and how many pass from one contact to the next.

    A planet's tooth meshes with the sun and, half a revolution later, with the ring: two `contacts` per revolution.
    """

    row: DefectOrder
    teeth: int
    per_turn: float
    smooth_orders: int = _SMOOTH_ORDERS
    contacts: int = 1
    shaft: str = ""  # on a fixed axis, turning at the contact rate


def gear_damage(
    segment: Segment,
    *,
    false_alarm_probability: float,
    channels: int = 1,
    library: HealthyMachines | None = None,
    envelopes: dict[str, ToothEnvelope] | None = None,
) -> list[GearJudgement]:
    """Return the evidence for every gear of a gearbox in one segment, the strongest first.

    Parameters
    ----------
    segment : Segment
        Samples of a channel; nothing is judged if its sensor is faulty.
    false_alarm_probability : float
        Per record: gears below it are significant, and explain weaker ones.
    channels : int
        Number of channels over which the probability is taken.
    library : HealthyMachines, optional
        Default the shipped one.
    envelopes : dict, optional
        Filled in place, by component, for the gears below that probability.
    """
    gears = _gears(segment.machine)
    if not gears:
        return []
    machine, source = segment.machine, segment.machine.source
    judged = [
        GearJudgement(
            channel=segment.name,
            units=segment.units,
            component=gear.row.component,
            order=gear.row.order,
            teeth=gear.teeth,
            unmeasured_angle=int(machine.phase.nominal and not source.followed),
            from_pulse=int(
                gear.shaft != "" and source.pulses_per_rev == 1 and math.isclose(gear.row.order * machine.ratio, 1)
            ),
        )
        for gear in gears
    ]
    if segment.faulty:
        return [replace(row, not_judged=_FAULTY) for row in judged]
    try:
        residual = _residual(segment)
        energies = residual_energies(
            residual.signal,
            meshes=residual.meshes,
            lowest_order=residual.lowest_order,
            transform=residual.transform,
        )
    except ValueError as error:
        return [replace(row, not_judged=str(error)) for row in judged]
    tests = channels * len({gear.row.order for gear in gears})
    judge = _Judge(
        residual=residual,
        energies=energies,
        tests=tests,
        threshold=false_alarm_probability,
        library=library or healthy_machines("teeth"),
    )
    judged = [judge.of(row, gear) for row, gear in zip(judged, gears, strict=True)]
    named = {gear.row.component: gear for gear in gears}
    judged = judge.explained(judged, named)
    if envelopes is not None:
        envelopes |= {
            row.component: judge.envelope(row, named[row.component])
            for row in judged
            if row.probability <= false_alarm_probability
        }
    return judged


def _gears(machine: Machine) -> list[_Tooth]:
    """Return the gears of every mesh."""
    meshes = {row.component: row for row in machine.defect_orders if row.kind == "gear_mesh"}
    copies: dict[str, int] = {}
    for contact in machine.kinematics.contacts:
        for link, teeth in contact.gears:
            copies[f"{contact.mesh}/{link}"] = copies[f"{contact.mesh}/{link.rpartition(' ')[0]}"] = abs(teeth)
    shafts = {row.component: row.order for row in machine.defect_orders if row.kind == "shaft"}
    planets = {
        name
        for stage in planetary_stages(machine.kinematics)
        for planet in stage.planets
        for link in (planet, planet.rpartition(" ")[0])
        for name in (f"{stage.sun_mesh}/{link}", f"{stage.ring_mesh}/{link}")
    }
    found = []
    for row in (row for row in machine.defect_orders if row.kind == "tooth" and row.component in copies):
        mesh, teeth = meshes[row.component.rpartition("/")[0]], copies[row.component]
        per_turn = mesh.order / row.order
        several = row.component.rpartition("/")[2] in shafts and round(teeth / per_turn) > 1
        found.append(
            _Tooth(
                row=row,
                teeth=teeth,
                per_turn=per_turn,
                smooth_orders=0 if several else _SMOOTH_ORDERS,
                contacts=2 if row.component in planets else 1,
                shaft="" if several or row.component in planets else _shaft_of(row, shafts),
            )
        )
    return found


def _shaft_of(tooth: DefectOrder, shafts: Mapping[str, float]) -> str:
    """Return the shaft that turns once per tooth contact, preferably the gear's own; empty if there is none."""
    at_rate = [name for name, order in shafts.items() if math.isclose(order, tooth.order, rel_tol=1e-9)]
    own = tooth.component.rpartition("/")[2]
    return own if own in at_rate else min(at_rate, default="")


@dataclass(frozen=True, kw_only=True)
class _Residual:
    """A channel over angle, with the orders to remove: around mesh harmonics, and below the lowest."""

    signal: AngularSignal
    meshes: dict[float, float]
    lowest_order: float

    @cached_property
    def transform(self) -> NDArray[np.complex128]:
        """Fourier transform of the signal."""
        return tapered_transform(self.signal)


def _residual(segment: Segment) -> _Residual:
    when, machine = segment.when, segment.machine
    last = PASSBAND * segment.end_hz / machine.top_speed_hz
    (signal,) = resample_in_angle([segment.values], when, segment.name, machine.phase, last)
    meshes: dict[float, float] = {}
    for row in (row for row in machine.defect_orders if row.kind == "gear_mesh"):
        removed = _SIDEBANDS * max((float(spacing) for spacing in row.sidebands), default=0.0)
        meshes[row.order] = max(removed, meshes.get(row.order, 0.0))
    fastest = max(row.order for row in machine.defect_orders if row.kind == "shaft")
    return _Residual(signal=signal, meshes=meshes, lowest_order=_SHAFT_ORDERS * fastest)


@dataclass(frozen=True, kw_only=True)
class _Judge:
    """Judges the gears of one channel, `tests` of them in the record."""

    residual: _Residual
    energies: BandEnergies
    tests: int
    threshold: float
    library: HealthyMachines

    @cached_property
    def named_at(self) -> float:
        """Least strength at which a gear is named."""
        return self.library.strength_at(self.threshold, parts=self.tests)

    @cached_property
    def white(self) -> AngularSignal:
        """The residual with bands of equal power."""
        residual = self.residual
        return whitened_residual(
            residual.signal, meshes=residual.meshes, edges=self.energies.edges, transform=residual.transform
        )

    def of(self, row: GearJudgement, gear: _Tooth, keep: NDArray[np.bool_] | None = None) -> GearJudgement:
        """Return the evidence for a gear, from some of the samples."""
        try:
            folds = folded(
                self.energies,
                order=gear.row.order,
                teeth=gear.per_turn,
                keep=keep,
                smooth_orders=gear.smooth_orders,
                contacts=gear.contacts,
            )
        except ValueError as error:
            return replace(row, not_judged=f"too short, or its sampling rate too low: {error}")
        return replace(row, **self._fields(local_damage(folds, stated=self.named_at)))

    def _fields(self, found: LocalDamage) -> dict[str, Any]:
        level = float(self.energies.values[found.band].mean())
        return {
            "turns": found.turns,
            "probability": self.library.probability(found.strength, parts=self.tests),
            "strength": found.strength,
            "rise": found.rise,
            "least_rise": found.least_rise,
            "amplitude": math.sqrt(level * found.rise),
            "position_rev": found.position_rev,
            "band_orders": (float(self.energies.edges[found.band]), float(self.energies.edges[found.band + 1])),
        }

    def explained(self, judged: Sequence[GearJudgement], gears: dict[str, _Tooth]) -> list[GearJudgement]:
        """Return the gears in order of evidence, each tested without the teeth of stronger ones."""
        keep = np.ones(self.energies.values.shape[1], dtype=bool)
        named: list[GearJudgement] = []
        others = [row for row in judged if row.probability > self.threshold or row.not_judged]
        for row in sorted((row for row in judged if row not in others), key=_evidence):
            equal = next((one for one in named if row.component in {one.component, *one.also}), None)
            if equal is not None:
                others.append(replace(row, explained_by=equal.component))
                continue
            gear = gears[row.component]
            again = self.of(row, gear, keep) if named else row
            if again.probability > self.threshold or again.not_judged:
                others.append(replace(row, explained_by=" or ".join(one.component for one in named)))
                continue
            also = tuple(
                one.component
                for one in judged
                if one.component != row.component and math.isclose(one.order, row.order, rel_tol=1e-9)
            )
            named.append(self._by_its_mesh(replace(again, also=also), gears))
            if named[-1].component != row.component:
                others.append(replace(row, explained_by=named[-1].component))
            keep &= ~self._at_tooth(row, gear)
        found = {row.component for row in named}
        return [*named, *sorted((row for row in others if row.component not in found), key=_evidence)]

    def _by_its_mesh(self, row: GearJudgement, gears: dict[str, _Tooth]) -> GearJudgement:
        """Return the evidence for the gear whose mesh the tooth modulates, among gears with the same contact rate.

        The gears of a shaft share the angle of the tooth, and more teeth give a sharper scatter, damaged or not. They
        are distinguished by which mesh is modulated at that angle (`mesh_contrast`); a knock of the shaft modulates
        none.
        """
        if not (row.also or gears[row.component].shaft):
            return row
        names = (row.component, *row.also)
        place = {"order": row.order, "position_rev": row.position_rev}
        contrast = {name: mesh_contrast(self.white, teeth=gears[name].per_turn, **place) for name in names}
        best = max(names, key=lambda name: contrast[name])
        also = tuple(name for name in names if name != best)
        rivals = tuple(name for name in also if contrast[best] < MODULATED_MESH * max(1.0, contrast[name]))
        knock_of = "" if contrast[best] >= MODULATED_MESH else gears[best].shaft
        return replace(row, component=best, also=also, rivals=rivals, teeth=gears[best].teeth, knock_of=knock_of)

    def envelope(self, row: GearJudgement, gear: _Tooth) -> ToothEnvelope:
        """Return the squared envelope of the band in which a gear's tooth stands out."""
        energies = self.energies
        band = int(np.argmin(np.abs(energies.edges[:-1] - row.band_orders[0])))
        values, edges = energies.values[band : band + 1].copy(), energies.edges[band : band + 2]
        alone = replace(energies, values=values, edges=edges)
        return ToothEnvelope(energies=alone, order=row.order, harmonic=gear.smooth_orders + 1)

    def _at_tooth(self, row: GearJudgement, gear: _Tooth) -> NDArray[np.bool_]:
        """Return which samples lie within `_MASKED_TEETH` of the damaged tooth."""
        energies = self.energies
        place = energies.start_rev + np.arange(energies.values.shape[1]) / energies.samples_per_rev
        apart = (gear.contacts * (row.order * place - row.position_rev) + 0.5) % 1.0 - 0.5
        return np.asarray(np.abs(apart) < gear.contacts * _MASKED_TEETH / gear.per_turn)


def most_conspicuous(judged: Sequence[GearJudgement]) -> list[GearJudgement]:
    """Return the rows with the strongest evidence first, those explained by others last."""
    return sorted(judged, key=lambda row: (bool(row.explained_by), _evidence(row)))


def _evidence(row: GearJudgement) -> tuple[bool, float]:
    return (bool(row.not_judged), -row.strength)


def gear_verdicts(judged: Sequence[GearJudgement], *, false_alarm_probability: float) -> list[Finding]:
    """Return the verdict on every gear, from the channel with the strongest evidence.

    A damaged tooth is at most *indicated*: a single pitch deviation of a sound gear is equally local, and one record
    cannot distinguish the two; a baseline or a declared grade of ISO 1328-1 could. A gear with a tooth that stands out
    more than in most healthy machines, and less than would be named, is not judged. Wear of all teeth is not judged at
    all.
    """
    named: dict[str, GearJudgement] = {}
    for row in judged:
        if row.probability <= false_alarm_probability and not row.explained_by:
            alike = {row.component, *row.also}
            name = next((name for name in named if name in alike), row.component)
            if name not in named or _evidence(row) < _evidence(named[name]):
                named[name] = row
    best: dict[str, GearJudgement] = {}
    for row in judged:
        if row.component not in best or _evidence(row) < _evidence(best[row.component]):
            best[row.component] = row
    others = [row for name, row in best.items() if name not in {row.component for row in named.values()}]
    return [
        *(_indicated(row, false_alarm_probability) for row in sorted(named.values(), key=_evidence)),
        *(_unnamed(row, false_alarm_probability) for row in others),
    ]


def _indicated(row: GearJudgement, stated: float) -> Finding:
    (low, high), shown = row.band_orders, max(row.probability, RAREST_STATED)
    rivals = " or ".join(row.rivals)
    doubt = f"it may be a tooth of {rivals}; " if rivals else ""
    doubt += "a single pitch deviation of a sound gear has the same effect"
    tooth = f"tooth of {row.component} or {rivals}" if rivals else "tooth"
    step = f"Compare with an earlier record at the same speed and load, or inspect the {tooth}"
    if row.from_pulse:
        number = int(row.position_rev % 1 * row.teeth) + 1
        step += f" (near tooth {number} of {row.teeth}, counted from the one in mesh at the tachometer's pulse)"
    if row.knock_of:
        doubt += (
            f", and so has a loose part on {row.knock_of} that strikes once per revolution, since no mesh is modulated"
        )
        step += f" and the parts mounted on {row.knock_of}"
    evidence = (
        f"between the mesh harmonics, from {low:.4g} to {high:.4g} orders, the energy at one tooth is "
        f"at least {row.rise:.1f} times that at the others throughout {row.turns} contacts per tooth; not certain: "
        f"{doubt}; compare with an earlier record, or measure the tooth."
    )
    return replace(
        _blank(row),
        alike=" or ".join([*row.rivals, *([f"a loose part on {row.knock_of}"] if row.knock_of else [])]),
        verdict=INDICATED,
        evidence=evidence,
        doubts=doubt,
        next_step=f"{step}.",
        least_change=f"nothing found if more than {healthy_share_words(stated)} healthy machines showed as much (now "
        f"{healthy_share_words(shown)})",
    )


def _unnamed(row: GearJudgement, stated: float) -> Finding:
    """Return that no tooth stands out, or why the gear is not judged."""
    blank, (why, next_step, least_change) = _blank(row), _why_not_judged(row, stated)
    if why:
        return judging_nothing(blank, why, least_change, next_step)
    return replace(
        blank,
        verdict=NOTHING_FOUND,
        evidence=f"no tooth stands out in {row.turns} contacts per tooth; one with {row.least_rise:.2g} times the "
        "energy of the others in any one band would have; pitting of many teeth or wear of all requires an earlier "
        "record.",
        least_change=f"indicated if at most {healthy_share_words(stated)} healthy machines showed as much (now "
        f"{healthy_share_words(row.probability)})",
    )


def _why_not_judged(row: GearJudgement, stated: float) -> tuple[str, str, str]:
    """Return why a gear without a finding is not judged, the next step and what would change that; empty if it is."""
    longer = "judged in a longer record, or at a higher sampling rate"
    if why := row.not_judged or (_NO_ANGLE if row.unmeasured_angle else ""):
        change = {_FAULTY: "judged with a sound sensor", _NO_ANGLE: "judged with a tachometer"}.get(why, longer)
        return why, "", change
    if row.explained_by and row.probability <= stated:
        by = row.explained_by
        return f"its evidence may be due to {by}", "", f"indicated without the tooth of {by}"
    if row.turns < FEWEST_CYCLES:
        why = f"too short: in {row.turns} revolutions only severe damage shows; at least {FEWEST_CYCLES:g} are required"
        return why, "", longer
    if stated < row.probability < SELDOM_SOUND:
        why = (
            f"one tooth stands out more than in most healthy machines ({healthy_share_words(row.probability)} show as "
            "much), as pits or large pitch deviations do"
        )
        return why, _COMPARE, f"nothing found, if {healthy_share_words(SELDOM_SOUND)} healthy machines showed as much"
    if row.least_rise > GRAVE_RISE:
        why = (
            f"its teeth are too few, or differ too much, to exclude a damaged one in every band: in one of them only a "
            f"tooth with {row.least_rise:.3g} times the energy of the others would stand out, and damage may cause less"
        )
        return why, _COMPARE, f"nothing found, if {GRAVE_RISE:g} times the energy of the others stood out"
    return "", "", ""


def _blank(row: GearJudgement) -> Finding:
    return Finding(
        component=row.component,
        kind="tooth",
        channel=row.channel,
        false_alarm_probability=math.nan if row.not_judged else max(row.probability, RAREST_STATED),
        snr=row.strength,
        strength=math.nan if row.not_judged else row.strength,
        order_found=row.order,
        amplitude=row.amplitude,
        units=row.units,
    )


def gear_indicators(judged: Iterable[GearJudgement]) -> list[IndicatorValue]:
    """Return how far the worst tooth of each gear is above the others, for the table of indicators."""
    return [
        IndicatorValue(
            channel=row.channel,
            component=row.component,
            kind="gear",
            indicator="tooth_outlier",
            value=math.nan if row.not_judged else row.strength,
            unit="1",
            noise_limit=math.nan,
            takes="residual energy over {} revolutions, {:.4g} to {:.4g} orders".format(row.turns, *row.band_orders),
            source="signals.angle.local_damage",
            withheld=row.not_judged,
        )
        for row in judged
    ]
