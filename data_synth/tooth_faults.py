"""Damage to single teeth, as what it adds to the compliance of the pair they belong to."""

import math
from dataclasses import dataclass

import numpy as np

from data_synth.mesh import Array
from data_synth.tooth_stiffness import Section, Tooth, ToothPair, hertz_stiffness

_ROOT_TANGENT = math.radians(30)  # the critical section of ISO 6336-3
_BISECTIONS = 60


@dataclass(frozen=True, kw_only=True)
class ToothCrack:
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

    def section(self, tooth: Tooth) -> Section:
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
                f"{2e3 * half:.3g} mm thick; make it smaller, or use MissingTooth."
            )

        return Section(left_m=left, tip_m=tip)


@dataclass(frozen=True, kw_only=True)
class Spall:
    """A rectangular hole in the flank: the line of contact is shorter while it passes.

    Attributes
    ----------
    width_m : float
        Along the face.
    start_cycles, length_cycles : float
        Where it begins and how long it is along the path of contact, in cycles after the tooth entered.
    """

    width_m: float
    start_cycles: float
    length_cycles: float

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:  # noqa: ARG002
        """Return what it adds to the compliance of a pair, (n,) m/N."""
        inside = (phase_cycles >= self.start_cycles) & (phase_cycles < self.start_cycles + self.length_cycles)
        return _shorter_contact(pair, np.where(inside, self.width_m, 0.0))

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return the phases at which it begins and ends."""
        return (self.start_cycles, self.start_cycles + self.length_cycles)


@dataclass(frozen=True, kw_only=True)
class Pitting:
    """Round pits: the line of contact is shorter by the chord of each that it crosses.

    Attributes
    ----------
    places_cycles : tuple of float
        Where the middle of each pit stands along the path of contact, in cycles after the tooth entered.
    diameter_m : float
    """

    places_cycles: tuple[float, ...]
    diameter_m: float

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return what it adds to the compliance of a pair, (n,) m/N."""
        profile = self._along_flank(pair, gear, phase_cycles)
        places = self._along_flank(pair, gear, np.array(self.places_cycles))
        beyond = np.abs(profile[:, None] - places) / (self.diameter_m / 2)
        chords = self.diameter_m * np.sqrt(np.maximum(1 - beyond**2, 0))
        return _shorter_contact(pair, chords.sum(axis=1))

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return no phases: a chord grows from nothing."""
        return ()

    @staticmethod
    def _along_flank(pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return the length of the involute from the base circle to the contact, ``r_b tan^2(alpha) / 2``."""
        return np.asarray(pair.gears.base_radii_m[gear] * np.tan(pair.angles_rad(phase_cycles)[gear]) ** 2 / 2)


@dataclass(frozen=True, kw_only=True)
class Chipping:
    """A tip corner that has broken off: above a radius the tooth carries over a part of its face only.

    Attributes
    ----------
    radius_m : float
        Where the break begins; contact further out is on what is left.
    lost_share : float
        Part of the face that is gone, up to 1.
    """

    radius_m: float
    lost_share: float

    def __post_init__(self) -> None:
        if not 0 < self.lost_share <= 1:
            raise ValueError(f"lost_share = {self.lost_share!r} has to lie above 0 and be no more than 1.")

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return what it adds to the compliance of a pair, (n,) m/N."""
        radii = pair.gears.base_radii_m[gear] / np.cos(pair.angles_rad(phase_cycles)[gear])
        factor = self.lost_share / (1 - self.lost_share) if self.lost_share < 1 else math.inf
        added = np.zeros_like(radii)
        gone = radii > self.radius_m
        added[gone] = factor * pair.compliance(phase_cycles[gone])
        return added

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:
        """Return the phase at which contact crosses the break."""
        base, gears = pair.gears.base_radii_m[gear], pair.gears
        if self.radius_m <= base:
            raise ValueError(f"radius_m = {self.radius_m:g} is not above the base radius, {base:.4g} m.")
        reach = math.sqrt(self.radius_m**2 - base**2)
        if gear == 1:
            reach = sum(gears.base_radii_m) * math.tan(gears.working_angle_rad) - reach
        return ((reach - gears.path_m[0]) / gears.base_pitch_m,)


@dataclass(frozen=True, kw_only=True)
class MissingTooth:
    """A tooth that has broken off at its root."""

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:  # noqa: ARG002
        """Return infinity, (n,)."""
        return np.full(phase_cycles.shape, math.inf)

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return no phases beside those of the pair itself."""
        return ()


def _shorter_contact(pair: ToothPair, lost_m: Array) -> Array:
    """Return what a shorter line of contact adds to a pair's compliance; infinite where none is left."""
    face = pair.gears.face_width_m
    left = np.maximum(face - lost_m, 0.0)
    full = hertz_stiffness(young_pa=pair.young_pa, poisson=pair.poisson, width_m=face)
    added = np.full(left.shape, math.inf)
    np.divide(lost_m, left * full, out=added, where=left > 0)
    return added


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
