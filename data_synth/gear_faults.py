"""Faults of gears: what a scene declares of each, and what each changes.

Each fault has a modulation function of the angle of its gear, 1 where the damage is worst. In a kinematic scene it
modulates the mesh harmonics (`data_synth.faults.gear_damage_family`) and causes impacts (`damage_trains`). In a scene
with gear dynamics, `GearDamage` lists for each tooth what is cracked, missing or worn off: `damaged_teeth` turns it
into tooth compliance, `transmission_errors` into transmission errors.

Turns are revolutions of the gear, counted from where the damaged tooth is in the middle of its mesh.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from data_synth import transmission_error
from data_synth.driving import NotNegative, Share
from data_synth.gear_geometry import GearPair
from data_synth.growth import GrowingFault
from data_synth.mesh import Array
from data_synth.teeth_in_mesh import DamagedTooth
from data_synth.tooth_stiffness import CrackedSection, Tooth, ToothPair
from data_synth.transmission_error import PitchError, ProfileError, TransmissionError
from hums.gearbox import Positive

Strikes = tuple[tuple[float, float], ...]
Length = Annotated[float, Field(gt=0, le=1)]

_CRACK_ANGLE_DEG = 45.0  # to the middle of the tooth; cracks of gears with a thick rim run at about this angle
_ROOT_TANGENT = math.radians(30)  # the critical section of ISO 6336-3
_BISECTIONS = 60


@dataclass(frozen=True, kw_only=True)
class FaultyGear:
    """The properties of a gear on which its faults depend.

    Attributes
    ----------
    teeth : float
        Tooth pitches from one contact of a tooth to its next.
    face_width_m : float
        Infinite where nobody declared it.
    rng : callable
        Returns a generator in the same state every time: what is drawn stays.
    """

    teeth: float
    face_width_m: float = math.inf
    rng: Callable[[], np.random.Generator] = field(default=lambda: np.random.default_rng(0), repr=False, compare=False)

    def face_fraction(self, size_m: float) -> float:
        """Return the share of the face width that `size_m` is."""
        if not 0 <= size_m <= self.face_width_m:
            raise ValueError(f"size_m = {size_m:g} is not within the face width of {self.face_width_m:g} m")
        return size_m / self.face_width_m


@dataclass(frozen=True, kw_only=True)
class GearDamage:
    """How a damaged gear departs from a sound one, tooth by tooth from the damaged one on.

    Attributes
    ----------
    crack_m : (z,) array
        Depth of a crack in the root of each tooth, m: takes stiffness by the model of the tooth.
    contact_fraction : (z,) array
        Share of the face width of each tooth that carries: stiffness is in proportion. 1 is sound, 0 a tooth gone.
    removed_m : (z,) array
        Material missing on each flank along the line of action, m: a transmission error while the tooth carries.
    runout_m : float
        Eccentricity of the pitch circle, m: a transmission error ``runout_m cos(2 pi turns)``.
    profile_m : float
        Material missing alike on every flank where it slides, none at the pitch point: a transmission error
        ``profile_m (1 - cos(4 pi phase)) / 2`` in the phase of the mesh, the pitch point at phase 0.
    crack_angle_rad : float
        Between cracks and the middle of their tooth.
    """

    crack_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    contact_fraction: Array = field(metadata={"dims": ("tooth",), "units": "1"})
    removed_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    runout_m: float = 0.0
    profile_m: float = 0.0
    crack_angle_rad: float = math.radians(_CRACK_ANGLE_DEG)

    @classmethod
    def on(cls, gear: FaultyGear, **damage: float) -> "GearDamage":
        """Return those of a gear that is sound but for what is given."""
        teeth = round(gear.teeth)
        return cls(crack_m=np.zeros(teeth), contact_fraction=np.ones(teeth), removed_m=np.zeros(teeth), **damage)


def von_mises_window(turns: ArrayLike, *, width_turns: float) -> Array:
    """Return ``exp(kappa (cos 2 pi turns - 1))``: 1 at whole turns, 1/2 half a width beside them.

    Smooth and periodic, so its Fourier coefficients, ``exp(-kappa) I_k(kappa)``, fall fast.
    """
    kappa = math.log(2) / (1 - math.cos(math.pi * width_turns))
    return np.asarray(np.exp(kappa * (np.cos(2 * np.pi * np.asarray(turns, dtype=np.float64)) - 1)))


def phase_of_error(error_m: float, *, module_m: float, pressure_angle_rad: float) -> float:
    """Return by how much an error along the line of action turns the first mesh harmonic: 2 pi a base pitch, in rad."""
    return 2 * math.pi * error_m / (math.pi * module_m * math.cos(pressure_angle_rad))


class GearFault(GrowingFault):
    """A fault of a gear: of one tooth, felt while that tooth is in mesh, unless its class says otherwise.

    The size in mm times each of the three factors gives the relative rise of the mesh amplitude, the lag of the first
    mesh harmonic's phase (harmonic h: h times), and the amplitude of the impact, at full load. The factors are
    illustrative: a kinematic scene has no tooth stiffness to derive them from.
    """

    amplitude_per_mm: NotNegative = 0.2
    phase_rad_per_mm: NotNegative = 0.1
    impact_per_mm: NotNegative = 1.0

    def width_pitches(self) -> float:
        """Return the width of the window in which it is felt, in tooth pitches."""
        return 1.0

    def narrowest_feature(self, gear: FaultyGear) -> float:
        """Return the width of the finest feature of the shape, in turns."""
        return self.width_pitches() / gear.teeth

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:
        """Return what modulates the mesh at `turns` (n,) of the gear: 1 at the worst place of damage."""
        return von_mises_window(turns, width_turns=self.width_pitches() / gear.teeth)

    def harmonic_weights(self, harmonic: ArrayLike) -> Array:
        """Return how strongly mesh harmonics (k,), from 1, rise beside the first."""
        return np.ones(np.shape(harmonic))

    def impacts(self, gear: FaultyGear) -> Strikes:  # noqa: ARG002 - others need it
        """Return the impacts of a turn: when, in turns, and how hard."""
        return ((0.0, 1.0),)

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return what damage of `size_m` changes in the mechanics of a gear.

        Raises
        ------
        ValueError
            A size that the gear does not have.
        """
        raise NotImplementedError


class ToothCrack(GearFault):
    """A cracked tooth: the mesh modulated once a revolution over about one tooth, and one impact in it.

    Where gears vibrate, the crack runs at `angle_deg` to the middle of its tooth, and takes stiffness from it.
    """

    kind: Literal["tooth_crack"]
    depth_mm: Positive
    angle_deg: Annotated[float, Field(gt=0, le=90)] = _CRACK_ANGLE_DEG

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record."""
        return self.depth_mm

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the crack: the tooth bends further."""
        found = GearDamage.on(gear, crack_angle_rad=math.radians(self.angle_deg))
        found.crack_m[0] = size_m
        return found


class SizedGearFault(GearFault):
    """One whose size is called so."""

    size_mm: Positive

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record."""
        return self.size_mm


class Chipping(SizedGearFault):
    """A corner of one tooth broken off: the size is the face width that is gone."""

    kind: Literal["chipping"]

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the share of the face that still carries."""
        found = GearDamage.on(gear)
        found.contact_fraction[0] = 1 - gear.face_fraction(size_m)
        return found


class MissingTooth(SizedGearFault):
    """One tooth gone: nothing carries in its place, and the size is what the next one is hit by."""

    kind: Literal["missing_tooth"]

    def impacts(self, gear: FaultyGear) -> Strikes:
        """Return one impact a turn, where the next tooth takes over."""
        return ((1 / (2 * gear.teeth), 1.0),)

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:  # noqa: ARG002 - a tooth is there or not
        """Return the gap."""
        found = GearDamage.on(gear)
        found.contact_fraction[0] = 0.0
        return found


class Spall(SizedGearFault):
    """A hole in the flank of one tooth, `length_pitches` long in parts of the path from tooth to tooth.

    The contact drops in at one end, with `entry_share` of the impact by which it hits the other.
    """

    kind: Literal["spall"]
    length_pitches: Length = 0.3
    entry_share: Annotated[float, Field(ge=-1, le=1)] = -0.5

    def width_pitches(self) -> float:
        """Return the length of the spall."""
        return self.length_pitches

    def impacts(self, gear: FaultyGear) -> Strikes:
        """Return two impacts a turn: entry and exit."""
        half = self.length_pitches / (2 * gear.teeth)
        return ((-half, self.entry_share), (half, 1.0))

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the material that is gone."""
        found = GearDamage.on(gear)
        found.removed_m[0] = size_m
        return found


class Pitting(SizedGearFault):
    """Pits `length_pitches` long on `count` of `spread` neighbours: one the worst, the others half as deep or more."""

    kind: Literal["pitting"]
    length_pitches: Length = 0.3
    count: Annotated[int, Field(ge=1)] = 3
    spread: Annotated[int, Field(ge=1)] = 5

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.count > self.spread:
            raise ValueError(f"count = {self.count} pitted teeth do not fit among spread = {self.spread} neighbours")
        return self

    def pits(self, gear: FaultyGear) -> tuple[tuple[int, float], ...]:
        """Return (tooth, counted from the one at turn 0, and depth relative to the worst) of each pit."""
        rng = gear.rng()
        others = np.sort(1 + rng.permutation(self.spread - 1)[: self.count - 1])
        shares = 0.5 + 0.5 * rng.random(self.count - 1)
        drawn = zip(others, shares, strict=True)
        return ((0, 1.0), *((int(place), float(share)) for place, share in drawn))

    def width_pitches(self) -> float:
        """Return the length of a pit."""
        return self.length_pitches

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:
        """Return the pits' windows."""
        at = np.asarray(turns, dtype=np.float64)
        width = self.length_pitches / gear.teeth
        windows = (
            share * von_mises_window(at - place / gear.teeth, width_turns=width) for place, share in self.pits(gear)
        )
        return np.asarray(sum(windows))

    def impacts(self, gear: FaultyGear) -> Strikes:
        """Return one impact a turn for each pitted tooth."""
        return tuple((place / gear.teeth, share) for place, share in self.pits(gear))

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the material that is gone."""
        found = GearDamage.on(gear)
        for place, share in self.pits(gear):
            found.removed_m[place % found.removed_m.size] = size_m * share
        return found


class _DistributedFault(SizedGearFault):
    """Damage of the whole gear: nothing strikes."""

    def narrowest_feature(self, gear: FaultyGear) -> float:  # noqa: ARG002 - local damage needs it
        """Return the width of the finest feature of the shape, in turns."""
        return 0.25

    def impacts(self, gear: FaultyGear) -> Strikes:  # noqa: ARG002 - local damage needs it
        """Return none."""
        return ()


class Eccentricity(_DistributedFault):
    """A pitch circle off the axis by the size: the mesh swings once a turn."""

    kind: Literal["eccentricity"]

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:  # noqa: ARG002 - local damage needs it
        """Return ``cos(2 pi turns)``."""
        return np.cos(2 * np.pi * np.asarray(turns, dtype=np.float64))

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the runout."""
        return GearDamage.on(gear, runout_m=size_m)


class Misalignment(_DistributedFault):
    """A gear whose axis leans: the size of its face width lies off at the end, once and twice a turn more and less.

    `twice` is what swings twice a turn, over the whole swing. The second mesh harmonic rises most.
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
        """Return the share of each tooth's face that carries."""
        found = GearDamage.on(gear)
        teeth = found.contact_fraction.size
        swing = (1 + self.modulation(np.arange(teeth) / teeth, gear)) / 2
        found.contact_fraction[:] -= gear.face_fraction(size_m) * swing
        return found


class Wear(_DistributedFault):
    """Flanks worn alike, as deep as the size: all mesh harmonics rise, the higher the more, and no sideband comes."""

    kind: Literal["wear"]

    def modulation(self, turns: ArrayLike, gear: FaultyGear) -> Array:  # noqa: ARG002 - local damage needs it
        """Return 1: every tooth is alike."""
        return np.ones(np.shape(turns))

    def harmonic_weights(self, harmonic: ArrayLike) -> Array:
        """Return the number of the mesh harmonic (k,)."""
        return np.asarray(harmonic, dtype=np.float64)

    def damage(self, size_m: float, gear: FaultyGear) -> GearDamage:
        """Return the worn profile."""
        return GearDamage.on(gear, profile_m=size_m)


GEAR_FAULTS = ToothCrack | Chipping | MissingTooth | Spall | Pitting | Eccentricity | Misalignment | Wear


# ---- what changes the compliance of a pair of teeth ------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class RootCrack:
    """A crack through the whole face, from the fillet of the loaded flank into the tooth.

    It starts where the fillet's tangent makes 30 degrees with the middle of the tooth. What lies between the surface
    and a line through its tip, along the middle, carries no bending and no shear (Wu, Zuo and Parey 2008, J. Sound Vib.
    317; Chaari, Fakhfakh and Haddar 2009, Eur. J. Mech. A 28); compression closes it.

    Attributes
    ----------
    depth_m : float
        Length of the crack.
    angle_rad : float
        Between the crack and the middle of the tooth.
    """

    depth_m: float
    angle_rad: float

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return what it adds to the compliance of a pair, (n,) m/N."""
        tooth = pair.teeth[gear]
        angles = pair.angles_rad(phase_cycles)[gear]
        return np.asarray(tooth.compliance(angles, left=self.section(tooth)) - tooth.compliance(angles))

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return no phases: a crack adds without a jump."""
        return ()

    def section(self, tooth: Tooth) -> CrackedSection:
        """Return what is left of the cracked half of a tooth.

        Raises
        ------
        ValueError
            A crack through the tooth.
        """
        half, height = _critical_section(tooth)
        left = half - self.depth_m * math.sin(self.angle_rad)
        tip = height - self.depth_m * math.cos(self.angle_rad)
        if self.depth_m < 0 or left <= -half:
            raise ValueError(
                f"depth_m = {self.depth_m:g} at {math.degrees(self.angle_rad):.3g} degrees leaves nothing of a tooth "
                f"{2e3 * half:.3g} mm thick; make it smaller, or let the tooth be missing."
            )

        return CrackedSection(left_m=left, tip_m=tip)


@dataclass(frozen=True, kw_only=True)
class PartialFaceContact:
    """A tooth that carries over a share of its face only: the pair is as much softer; with 0 nothing carries."""

    share: float

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:  # noqa: ARG002
        """Return what it adds to the compliance of a pair, (n,) m/N."""
        if self.share <= 0:
            return np.full(phase_cycles.shape, math.inf)
        return np.asarray((1 / self.share - 1) * pair.compliance(phase_cycles))

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return no phases: it is the same all along the path."""
        return ()


def damaged_teeth(damage: GearDamage, *, gear: int, first: int) -> Iterator[DamagedTooth]:
    """Yield the teeth whose stiffness changes; tooth 0 of `damage` is number `first` of the mesh."""
    teeth = damage.contact_fraction.size
    for place in range(teeth):
        tooth = (first + place) % teeth
        if damage.crack_m[place] > 0:
            crack = RootCrack(depth_m=float(damage.crack_m[place]), angle_rad=damage.crack_angle_rad)
            yield DamagedTooth(gear=gear, tooth=tooth, fault=crack)
        share = float(damage.contact_fraction[place])
        if share < 1:
            yield DamagedTooth(gear=gear, tooth=tooth, fault=PartialFaceContact(share=share))


def transmission_errors(damage: GearDamage, *, pair: GearPair, first: int) -> Iterator[TransmissionError]:
    """Yield the transmission errors; tooth 0 of `damage` enters the mesh at phase `first`.

    Material that is gone lets the gears turn closer, so errors are positive. What is worn off alike everywhere,
    ``profile_m / 2``, moves no tooth against another and is left out.
    """
    teeth = damage.removed_m.size
    if np.any(damage.removed_m):
        handover = min(pair.contact_ratio - 1, 1.0)
        yield PitchError(teeth_m=np.roll(damage.removed_m, first), handover=max(handover, 0.0))
    if damage.runout_m:
        middle = first + pair.contact_ratio / 2  # turn 0 is where the damaged tooth is in the middle of its mesh
        yield transmission_error.Eccentricity(
            teeth=teeth, eccentricity_m=damage.runout_m, phase_rad=math.pi / 2 - 2 * math.pi * middle / teeth
        )
    if damage.profile_m:
        pitch_point = pair.base_radii_m[0] * math.tan(pair.working_angle_rad)
        at = (pitch_point - pair.path_m[0]) / pair.base_pitch_m
        second = -damage.profile_m / 2 * np.exp(-4j * np.pi * at)
        yield ProfileError(harmonics_m=np.array([0.0, second]))


def _critical_section(tooth: Tooth) -> tuple[float, float]:
    """Return half thickness and height where the fillet's tangent leans 30 degrees, by bisection."""
    low, high = tooth.pressure_angle_rad, math.pi / 2 - 1e-9
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        turn = (tooth._rounding[1] / math.tan(middle) + tooth._rounding[2]) / tooth.radius_m  # noqa: SLF001
        # the rack's tip leans by `middle` in space, and the tooth has turned by `turn` meanwhile
        low, high = (middle, high) if middle - turn < _ROOT_TANGENT else (low, middle)
    half, height, _ = tooth.fillet_at(np.array(low))
    return float(half), float(height)
