"""Gear faults as declared in a scene: kind, component, size and growth; and the kinds of all faults."""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from data_synth.gears import transmission_error
from data_synth.gears.geometry import GearPair
from data_synth.gears.lost_contact import LoadSharing, LostContact, broken_tip_gap, pitted_share, spall_gap, wear_gap
from data_synth.gears.mesh_stiffness import Array
from data_synth.gears.root_crack import RootCrack
from data_synth.gears.tooth_compliance import DamagedTooth
from data_synth.gears.transmission_error import TransmissionError
from data_synth.scene.machine_faults import BearingFault, GrowingFault, ShaftFault
from data_synth.scene.operation import NotNegative, Share, Turns
from hums.gearbox.components import Declared, Positive

# ---- Gear faults: what a scene declares, and what each changes -------------------------------------------------------
# Each fault has a modulation function of the angle of its gear, 1 where the damage is worst. In a kinematic scene it
# modulates the mesh harmonics (`data_synth.kinematic.gear_faults.gear_damage_family`) and causes impacts
# (`damage_trains`). In a scene with gear dynamics, `GearDamage` lists what is cracked, missing or worn at each tooth:
# `damaged_teeth` turns it into tooth compliance, `transmission_errors` into transmission errors.
#
# `turns` are revolutions of the gear, zero where the damaged tooth is in the middle of its mesh.


ImpactPlaces = tuple[tuple[float, float], ...]
Length = Annotated[float, Field(gt=0, le=1)]

_CRACK_ANGLE_DEG = 45.0  # to the centre line of the tooth; typical of cracks in gears with a thick rim
_DEDENDUM = 1.25  # modules: ISO 53
_CRACK_POINTS = 513  # along the path, between which the compliance of a cracked tooth is linear


@dataclass(frozen=True, kw_only=True)
class FaultyGear:
    """Properties of a gear on which its faults depend.

    Attributes
    ----------
    teeth : float
        Tooth pitches from one contact of a tooth to its next.
    face_width_m : float or None
        Face width in m; None if undeclared.
    module_m : float
        Module in m; infinite if undeclared, so that no depth is too large.
    rng : callable
        Function that returns a generator in the same state at every call, so that draws are reproducible.
    """

    teeth: float
    face_width_m: float | None = None
    module_m: float = math.inf
    rng: Callable[[], np.random.Generator] = field(default=lambda: np.random.default_rng(0), repr=False, compare=False)

    def face_fraction(self, size_m: float) -> float:
        """Return `size_m` as a fraction of the face width; raise ValueError if that is undeclared or smaller."""
        if self.face_width_m is None:
            raise ValueError(
                "its face width is not declared; give face_width_mm in the mesh of the gearbox or in dynamics.meshes"
            )
        if not 0 <= size_m <= self.face_width_m:
            raise ValueError(f"{_mm(size_m)} exceeds the face width of {_mm(self.face_width_m)}; reduce the size")
        return size_m / self.face_width_m

    def flank_depth(self, size_m: float) -> float:
        """Return `size_m`, at most half the tooth thickness at the reference circle, pi m / 4."""
        return _at_most(size_m, math.pi / 4 * self.module_m, "half the thickness of its tooth")

    def worn_depth(self, size_m: float) -> float:
        """Return `size_m`, at most a quarter of the tooth thickness at the reference circle, pi m / 8.

        The bending stress of the root, inversely proportional to the thickness squared, is then 1.8 times as large, and
        no gear survives beyond.
        """
        return _at_most(size_m, math.pi / 8 * self.module_m, "a quarter of the thickness of its tooth")

    def runout(self, size_m: float) -> float:
        """Return `size_m`, at most the bottom clearance, m / 4, beyond which tips touch roots (ISO 53)."""
        return _at_most(size_m, self.module_m / 4, "the bottom clearance")

    def crack_depth(self, size_m: float, angle_rad: float) -> float:
        """Return `size_m`, at most the depth through the root of the basic rack tooth (ISO 53) at an angle."""
        root_m = (math.pi / 2 + 2 * _DEDENDUM * math.tan(math.radians(20))) * self.module_m
        return _at_most(size_m, root_m / math.sin(angle_rad), "the root of its tooth")


def _at_most(size_m: float, most_m: float, name: str) -> float:
    if not 0 <= size_m <= most_m:
        raise ValueError(f"{_mm(size_m)} exceeds {name}, {_mm(most_m)}; reduce the size")
    return size_m


def _mm(size_m: float) -> str:
    return f"{1e3 * size_m:.6g} mm"


@dataclass(frozen=True, kw_only=True)
class GearDamage:
    """Damage of a gear, tooth by tooth, starting at the damaged one.

    Attributes
    ----------
    crack_m : (z,) array
        Depth in m of a crack in the root of each tooth, which reduces its stiffness according to the tooth model.
    contact_fraction : (z,) array
        Fraction of the face width of each tooth in contact, to which the stiffness is proportional; 1 if healthy.
    broken_m : (z,) array
        Height in m missing from the tip of each tooth, where there is no contact.
    removed_m : (z,) array
        Depth in m of the spall in each flank, over whose length contact is lost or approaches by that depth.
    spall_pitches : float
        Length of these spalls along the path of contact, in base pitches.
    spall_share : float or None
        Initial fraction of the face width that they span; None for an area of 4 % of the active flank.
    spall_growth : float
        Ratio of their width to the initial one.
    runout_m : float
        Eccentricity of the pitch circle in m, a transmission error ``runout_m cos(2 pi turns)``.
    profile_m : float
        Largest depth in m worn from every flank alike, zero at the pitch point.
    crack : RootCrack
        Angle and model of these cracks.
    """

    crack_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    contact_fraction: Array = field(metadata={"dims": ("tooth",), "units": "1"})
    broken_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    removed_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    spall_pitches: float = 0.0
    spall_share: float | None = None
    spall_growth: float = 1.0
    runout_m: float = 0.0
    profile_m: float = 0.0
    crack: RootCrack = field(default=RootCrack(depth_m=0.0, angle_rad=math.radians(_CRACK_ANGLE_DEG)))

    @classmethod
    def on(cls, gear: FaultyGear, **damage: Any) -> "GearDamage":  # noqa: ANN401
        """Return the damage of a gear that is healthy apart from the damage given."""
        crack, broken, removed = np.zeros((3, round(gear.teeth)))
        return cls(crack_m=crack, contact_fraction=np.ones(crack.size), broken_m=broken, removed_m=removed, **damage)

    @property
    def softens(self) -> bool:
        """Whether teeth in contact are softer."""
        return bool(np.any(self.crack_m) or np.any(self.contact_fraction < 1))

    @property
    def loses_contact(self) -> bool:
        """Whether pairs lose contact, or load to their neighbours, so that the static force matters."""
        per_tooth = (1 - self.contact_fraction, self.broken_m, self.removed_m, self.crack_m)
        return bool(self.profile_m or any(np.any(part) for part in per_tooth))


def von_mises_window(turns: ArrayLike, *, width_turns: float) -> Array:
    """Return ``exp(kappa (cos 2 pi turns - 1))``: 1 at whole revolutions, 1/2 at half a width from them.

    It is smooth and periodic; its Fourier coefficients, ``exp(-kappa) I_k(kappa)``, decay fast.
    """
    kappa = math.log(2) / (1 - math.cos(math.pi * width_turns))
    return np.asarray(np.exp(kappa * (np.cos(2 * np.pi * np.asarray(turns, dtype=np.float64)) - 1)))


class GearFault(GrowingFault):
    """A gear fault: of one tooth, active while that tooth is in mesh, unless its class states otherwise.

    In a kinematic scene its contribution is the linear response of the gears, scaled to the level of its mesh, if
    module, face width, torque and sensor directions are declared and there are no planets
    (`data_synth.fidelity.linear_response.with_gear_faults`). Otherwise, or if a fault declares one of the factors, the
    effect of the size, ``size ** size_exponent`` in mm, times each factor gives the relative rise of the mesh amplitude
    (default factor: 0.2), the phase lag of the first mesh harmonic in rad (0.1; h times as much for harmonic h), and
    the impact amplitude at full load (1), which is proportional to the load to the power `load_exponent`. These factors
    are illustrative. The most damaged place was in mesh `offset_rev` revolutions of the gear before the angle of the
    reference is zero; by default that is drawn.
    """

    amplitude_per_mm: NotNegative | None = None
    phase_rad_per_mm: NotNegative | None = None
    impact_per_mm: NotNegative | None = None
    size_exponent: Positive = 1.0
    load_exponent: NotNegative = 1.0
    offset_rev: Turns | None = None

    @property
    def factors(self) -> tuple[float, float, float]:
        """Rise of the mesh amplitude, its phase lag in rad, and impact amplitude, per mm of effect."""
        rise, lag, impact = self.declared_factors
        return 0.2 if rise is None else rise, 0.1 if lag is None else lag, 1.0 if impact is None else impact

    @property
    def declared_factors(self) -> tuple[float | None, float | None, float | None]:
        """The declared factors, None where left out."""
        return self.amplitude_per_mm, self.phase_rad_per_mm, self.impact_per_mm

    def effect_mm(self, size_mm: ArrayLike) -> Array:
        """Return the effect (n,) in mm of sizes (n,) in mm, by which the factors are multiplied."""
        return np.asarray(np.power(size_mm, self.size_exponent))

    def width_pitches(self) -> float:
        """Return the width of the modulation window, in tooth pitches."""
        return 1.0

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:
        """Return the modulation function at `turns` (n,) of the gear, 1 where the damage is worst."""
        return von_mises_window(turns, width_turns=self.width_pitches() / gear.teeth)

    def harmonic_weights(self, harmonic: ArrayLike) -> Array:
        """Return the relative rise of mesh harmonics (k,), numbered from 1, 1 for the first."""
        return np.ones(np.shape(harmonic))

    def impacts(self, gear: FaultyGear) -> ImpactPlaces:  # noqa: ARG002 - others need it
        """Return the impacts of one revolution: position in revolutions, and relative amplitude."""
        return ((0.0, 1.0),)

    @abstractmethod
    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the damage of a gear with a fault of `size_m`, for the dynamics.

        Raises
        ------
        ValueError
            A size larger than the gear allows.
        """


class ToothCrack(GearFault):
    """A cracked tooth root: modulation once per revolution over about one tooth, with one impact.

    If gears vibrate, the crack runs at `angle_deg` to the centre line of its tooth and reduces its stiffness by one of
    two published models, `compliance`.
    """

    kind: Literal["tooth_crack"]
    depth_mm: Positive
    size_exponent: Positive = 1.3
    angle_deg: Annotated[float, Field(gt=0, le=90)] = _CRACK_ANGLE_DEG
    compliance: Literal["dead_zone", "fracture_mechanics"] = "dead_zone"

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record, mm."""
        return self.depth_mm

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the crack, which increases the compliance of the tooth."""
        crack = RootCrack(depth_m=size_m, angle_rad=math.radians(self.angle_deg), model=self.compliance)
        found = GearDamage.on(gear, crack=crack)
        found.crack_m[0] = gear.crack_depth(size_m, crack.angle_rad)
        return found


class SizedGearFault(GearFault):
    """A gear fault whose size is `size_mm`."""

    size_mm: Positive

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record, mm."""
        return self.size_mm


class Chipping(SizedGearFault):
    """A corner of one tooth broken off; the size is the lost face width."""

    kind: Literal["chipping"]

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the remaining fraction of the face in contact."""
        found = GearDamage.on(gear)
        found.contact_fraction[0] = 1 - gear.face_fraction(size_m)
        return found


class MissingTooth(SizedGearFault):
    """One broken tooth; the size is the height missing from its tip, the whole tooth at 2.25 modules or more."""

    kind: Literal["missing_tooth"]
    load_exponent: NotNegative = 0.0

    def impacts(self, gear: FaultyGear) -> ImpactPlaces:
        """Return one impact per revolution, where the next tooth comes into contact."""
        return ((1 / (2 * gear.teeth), 1.0),)

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the broken tooth."""
        found = GearDamage.on(gear)
        found.broken_m[0] = min(size_m, (1 + _DEDENDUM) * gear.module_m)
        return found


class _SpalledGear(SizedGearFault):
    """A gear with spalled flanks.

    The size is the depth, `length_pitches` the length along the path of contact in base pitches, and `width_mm` the
    initial width along the face, which grows with the depth. By default the area of a spall is 4 % of the active flank,
    the criterion for pitting of a case-hardened tooth (FVA information sheet 2/IV, 1997).
    """

    load_exponent: NotNegative = 0.0
    length_pitches: Length = 0.3
    width_mm: Positive | None = None

    def width_pitches(self) -> float:
        """Return the length of a spall, in tooth pitches."""
        return self.length_pitches

    def sound(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the dimensions of spalls of a size, not yet assigned to teeth."""
        return GearDamage.on(
            gear,
            spall_pitches=self.length_pitches,
            spall_share=None if self.width_mm is None else gear.face_fraction(1e-3 * self.width_mm),
            spall_growth=1e3 * size_m / self.size_mm,
        )


class Spall(_SpalledGear):
    """A spall on one flank, with an impact at the exit and `entry_share` times that impact at the entry."""

    kind: Literal["spall"]
    entry_share: Annotated[float, Field(ge=-1, le=1)] = -0.5

    def impacts(self, gear: FaultyGear) -> ImpactPlaces:
        """Return two impacts per revolution, at entry and at exit."""
        half = self.length_pitches / (2 * gear.teeth)
        return ((-half, self.entry_share), (half, 1.0))

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the spall."""
        found = self.sound(size_m, gear)
        found.removed_m[0] = gear.flank_depth(size_m)
        return found


class Pitting(_SpalledGear):
    """Pits on `count` of `spread` adjacent teeth, one of them the deepest, the others at least half as deep."""

    kind: Literal["pitting"]
    count: Annotated[int, Field(ge=1)] = 3
    spread: Annotated[int, Field(ge=1)] = 5

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.count > self.spread:
            raise ValueError(f"count = {self.count} pitted teeth do not fit among spread = {self.spread} neighbours")
        return self

    def pits(self, gear: FaultyGear) -> tuple[tuple[int, float], ...]:
        """Return the tooth number, counted from the one at angle 0, and the relative depth of each pit."""
        rng = gear.rng()
        others = np.sort(1 + rng.permutation(self.spread - 1)[: self.count - 1])
        shares = 0.5 + 0.5 * rng.random(self.count - 1)
        drawn = zip(others, shares, strict=True)
        return ((0, 1.0), *((int(place), float(share)) for place, share in drawn))

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:
        """Return the sum of the windows of all pits."""
        at = np.asarray(turns, dtype=np.float64)
        width = self.length_pitches / gear.teeth
        windows = (
            share * von_mises_window(at - place / gear.teeth, width_turns=width) for place, share in self.pits(gear)
        )
        return np.asarray(sum(windows))

    def impacts(self, gear: FaultyGear) -> ImpactPlaces:
        """Return one impact per revolution for each pitted tooth."""
        return tuple((place / gear.teeth, share) for place, share in self.pits(gear))

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return a spall on each pitted tooth."""
        found = self.sound(size_m, gear)
        for place, share in self.pits(gear):
            found.removed_m[place % found.removed_m.size] = gear.flank_depth(size_m) * share
        return found


class _DistributedFault(SizedGearFault):
    """A distributed fault of the whole gear, without impacts."""

    @model_validator(mode="after")
    def _check_impact(self) -> Self:
        if self.impact_per_mm:
            raise ValueError("impact_per_mm applies to damaged teeth, not to a whole gear; leave it out")
        return self

    def impacts(self, gear: FaultyGear) -> ImpactPlaces:  # noqa: ARG002 - local damage needs it
        """Return no impacts."""
        return ()


class Eccentricity(_DistributedFault):
    """A pitch circle whose centre is off the axis by the size: modulation once per revolution."""

    kind: Literal["eccentricity"]

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:  # noqa: ARG002 - local damage needs it
        """Return ``cos(2 pi turns)``."""
        return np.cos(2 * np.pi * np.asarray(turns, dtype=np.float64))

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the runout."""
        return GearDamage.on(gear, runout_m=gear.runout(size_m))


class Misalignment(_DistributedFault):
    """A tilted gear axis: modulation once and twice per revolution; the size is the largest face width out of contact.

    `twice` is the fraction of the modulation at twice per revolution. The second mesh harmonic rises most.
    """

    kind: Literal["misalignment"]
    twice: Share = 0.5

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:  # noqa: ARG002 - local damage needs it
        """Return ``(1 - twice) cos(2 pi turns) + twice cos(4 pi turns)``."""
        angle = 2 * np.pi * np.asarray(turns, dtype=np.float64)
        return np.asarray((1 - self.twice) * np.cos(angle) + self.twice * np.cos(2 * angle))

    def harmonic_weights(self, harmonic: ArrayLike) -> Array:
        """Return 2 for the second mesh harmonic, 1 for the others (k,)."""
        return np.where(np.asarray(harmonic) == 2, 2.0, 1.0)  # noqa: PLR2004

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the fraction of the face of each tooth in contact."""
        found = GearDamage.on(gear)
        teeth = found.contact_fraction.size
        swing = (1 + self.modulation(np.arange(teeth) / teeth, gear)) / 2
        found.contact_fraction[:] -= gear.face_fraction(size_m) * swing
        return found


class Wear(_DistributedFault):
    """Uniform wear of all teeth; the size is its largest depth. Mesh harmonics rise in proportion to their number."""

    kind: Literal["wear"]

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:  # noqa: ARG002 - local damage needs it
        """Return 1: all teeth are alike."""
        return np.ones(np.shape(turns))

    def harmonic_weights(self, harmonic: ArrayLike) -> Array:
        """Return the number of the mesh harmonic (k,)."""
        return np.asarray(harmonic, dtype=np.float64)

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the worn profile."""
        return GearDamage.on(gear, profile_m=gear.worn_depth(size_m))


LOSING_CONTACT = (ToothCrack, Chipping, MissingTooth, Spall, Pitting, Misalignment, Wear)
"""Faults by which tooth pairs lose contact, or load to their neighbours, depending on the load."""

GEAR_FAULTS = ToothCrack | Chipping | MissingTooth | Spall | Pitting | Eccentricity | Misalignment | Wear


# ---- Changes of the compliance of a tooth pair -----------------------------------------------------------------------


def damaged_teeth(
    damage: GearDamage, *, gear: int, first: int, sharing: LoadSharing | None = None
) -> Iterator[DamagedTooth]:
    """Yield the teeth whose stiffness changes; tooth 0 of `damage` is number `first` of the mesh."""
    teeth = damage.contact_fraction.size
    for place, lost in lost_contacts(damage, gear=gear, sharing=sharing):
        yield DamagedTooth(gear=gear, tooth=None if lost.every else (first + place) % teeth, fault=lost)


def lost_contacts(damage: GearDamage, *, gear: int, sharing: LoadSharing | None) -> Iterator[tuple[int, LostContact]]:
    """Yield the number of each tooth of a damaged gear that loses contact, 0 if all do, and how."""
    if not damage.loses_contact:
        return
    if sharing is None:
        raise ValueError("sharing is missing; loss of contact depends on the static force on the tooth pairs: give it.")
    pair = sharing.gears
    for place in np.flatnonzero(damage.crack_m):
        crack = replace(damage.crack, depth_m=float(damage.crack_m[place]))
        yield int(place), LostContact(sharing=sharing, added=_crack_compliance(crack, gear=gear, sharing=sharing))
    neighbours = (np.roll(damage.contact_fraction, 1) + np.roll(damage.contact_fraction, -1)) / 2
    for place in np.flatnonzero(damage.contact_fraction < 1):
        share, others = float(damage.contact_fraction[place]), float(neighbours[place])
        yield int(place), LostContact(sharing=sharing, face_share=share, others_share=others)
    for place in np.flatnonzero(damage.broken_m):
        gap = broken_tip_gap(pair, gear, height_m=float(damage.broken_m[place]))
        yield int(place), LostContact(sharing=sharing, gap=gap)
    for place in np.flatnonzero(damage.removed_m):
        depth_m = float(damage.removed_m[place])
        share = damage.spall_share or pitted_share(pair, length_pitches=damage.spall_pitches)
        share = min(share * damage.spall_growth, 1.0)
        gap = spall_gap(pair, gear, depth_m=depth_m, length_pitches=damage.spall_pitches, across=share == 1)
        yield int(place), LostContact(sharing=sharing, gap=gap, gap_share=share)
    if damage.profile_m:
        yield 0, LostContact(sharing=sharing, gap=wear_gap(pair, gear, depth_m=damage.profile_m), every=True)


def _crack_compliance(crack: RootCrack, *, gear: int, sharing: LoadSharing) -> Callable[[Array], Array]:
    """Return the compliance in m/N that a crack adds to a pair, as a function of the cycles since it entered."""
    if sharing.teeth is None:
        raise ValueError("sharing.teeth is missing; the compliance of a crack depends on the tooth shape: give it.")
    path = np.linspace(0.0, sharing.gears.contact_ratio, _CRACK_POINTS)
    added = sharing.scale * crack.added_compliance(sharing.teeth, gear, path)
    return lambda since: np.interp(since, path, added)


def transmission_errors(
    damage: GearDamage,
    *,
    pair: GearPair,
    gear: int,
    first: int,
    sharing: LoadSharing | None = None,
    stiffness_too: bool = True,
) -> Iterator[TransmissionError]:
    """Yield the transmission errors of a damaged gear; tooth 0 of `damage` enters the mesh at phase `first`.

    Removed material lets the gears approach, so errors are positive. `stiffness_too` states whether pairs without
    contact are also missing from the mesh stiffness (`damaged_teeth`).
    """
    teeth = damage.removed_m.size
    for place, lost in lost_contacts(damage, gear=gear, sharing=sharing):
        error = lost.error(teeth=teeth, first=first + place, stiffness_too=stiffness_too)
        if error.error_m.any():
            yield error
    if damage.runout_m:
        middle = first + pair.contact_ratio / 2  # the damaged tooth is in the middle of its mesh at angle 0
        yield transmission_error.Eccentricity(
            teeth=teeth, eccentricity_m=damage.runout_m, phase_rad=math.pi / 2 - 2 * math.pi * middle / teeth
        )


# ---- Faults ----------------------------------------------------------------------------------------------------------


Fault = Annotated[GEAR_FAULTS | ShaftFault | BearingFault, Field(discriminator="kind")]


def _kinds(model: type[Declared]) -> tuple[str, ...]:
    return get_args(model.model_fields["kind"].annotation)


_GEAR_KINDS = tuple(kind for model in get_args(GEAR_FAULTS) for kind in _kinds(model))
FAULT_KINDS = (*_GEAR_KINDS[:1], *_kinds(BearingFault), *_GEAR_KINDS[1:], *_kinds(ShaftFault))
ROW_OF = dict.fromkeys(_GEAR_KINDS, "tooth") | dict.fromkeys(_kinds(ShaftFault), "shaft")
"""The kind of defect order at which a fault repeats, if not its own name."""
DIMENSIONS = {
    "tooth_crack": "depth from the flank at the root",
    "chipping": "lost face width",
    "missing_tooth": "lost height, from the tip",
    "spall": "depth of the spall",
    "pitting": "depth of the worst pit",
    "eccentricity": "distance from the axis to the centre of the pitch circle",
    "misalignment": "face width without contact at the worst position",
    "wear": "maximum depth worn off a flank",
    "imbalance": "eccentricity of the mass",
    "bent_shaft": "run-out of the bend",
    "shaft_misalignment": "offset of the shafts",
    "inner_race": "length of the spall along the race",
    "outer_race": "length of the spall along the race",
    "rolling_element": "length of the spall along the element",
    "cage": "width of the break in the cage",
}
"""Meaning of the size of each kind: one dimension, the same in scenes, plans, labels, truth and data cards."""
