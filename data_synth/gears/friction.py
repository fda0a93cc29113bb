"""Sliding friction between teeth: moments on the gears and transverse force, relative to the mesh force."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_synth.gears.geometry import GearPair
from data_synth.gears.mesh_stiffness import Array


@dataclass(frozen=True, kw_only=True)
class SlidingFriction:
    """Coulomb friction on the flanks of external spur or helical gears whose pairs in contact share the load equally.

    With the mesh force along n, from the counter-clockwise driver to the driven gear, flanks slide along z x n. Sliding
    reverses at the pitch point: before it the driven flank is faster, after it the driver's. At a distance s from the
    tangent point on the driver's base circle, friction has the moment arm s about the driver and ``a sin(alpha) - s``
    about the driven gear (moments M_fp and M_fg of Howard, Jia and Wang 2001, Mech. Syst. Signal Process. 15).

    Attributes
    ----------
    gears : GearPair
        Driver first.
    coefficient : float
        Coefficient of friction, at least 0 and below 1.
    by_cycles : float
        Mesh cycles since the last pair entered, at phase zero.

    Raises
    ------
    ValueError
        If a gear is internal or the coefficient is out of range.
    """

    gears: GearPair
    coefficient: float
    by_cycles: float = 0.0

    def __post_init__(self) -> None:
        if self.gears.teeth[1] < 0:
            raise ValueError(f"teeth = {self.gears.teeth}: friction is modelled for external gears only; leave it out.")
        if not 0 <= self.coefficient < 1:
            raise ValueError(f"coefficient = {self.coefficient!r} must be at least 0 and below 1.")

    def moment_arms_m(self, phase_cycles: ArrayLike) -> tuple[Array, Array]:
        """Return friction moment over mesh force in m on driver and driven gear, positive in their sense of rotation.

        Friction slows the faster flank and drives the slower one, so the signs differ and the total power is a loss.
        """
        on_path, sense, in_contact = self._contact_lines(phase_cycles)
        whole = self.gears.centre_distance_m * math.sin(self.gears.working_angle_rad)
        share = self.coefficient * sense / in_contact.sum(axis=0)
        return np.asarray((share * on_path).sum(axis=0)), np.asarray(-(share * (whole - on_path)).sum(axis=0))

    def sideways(self, phase_cycles: ArrayLike) -> Array:
        """Return friction force over mesh force on the driver along z x n; it is opposite on the driven gear."""
        _, sense, in_contact = self._contact_lines(phase_cycles)
        return np.asarray(self.coefficient * sense.sum(axis=0) / in_contact.sum(axis=0))

    @property
    def shares(self) -> "tuple[FrictionShare, FrictionShare]":
        """Transverse force and driver's moment over mesh force; friction on both gears follows from these."""
        return FrictionShare(friction=self, moment=False), FrictionShare(friction=self, moment=True)

    def _contact_lines(self, phase_cycles: ArrayLike) -> tuple[Array, Array, Array]:
        """Return position on the path, sense of friction (0 out of contact) and contact (0 or 1) of every pair."""
        begin, end = self.gears.path_m
        pitch_point = self.gears.base_radii_m[0] * math.tan(self.gears.working_angle_rad)
        since = np.remainder(np.asarray(phase_cycles, dtype=np.float64) + self.by_cycles, 1.0)
        older = np.arange(math.ceil(self.gears.contact_ratio)).reshape(-1, *(1,) * since.ndim)
        on_path = begin + (since + older) * self.gears.base_pitch_m
        in_contact = (on_path < end).astype(np.float64)
        return np.asarray(on_path), np.asarray(in_contact * np.sign(pitch_point - on_path)), in_contact


@dataclass(frozen=True, kw_only=True)
class FrictionShare:
    """Transverse friction force, or the driver's friction moment in m, over mesh force as a function of mesh phase."""

    friction: SlidingFriction
    moment: bool

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which a pair enters, leaves, or passes the pitch point."""
        gears = self.friction.gears
        begin, end = gears.path_m
        pitch_point = gears.base_radii_m[0] * math.tan(gears.working_angle_rad)
        places = {0.0, *((place - begin) / gears.base_pitch_m for place in (end, pitch_point))}
        return tuple(sorted((place - self.friction.by_cycles) % 1.0 for place in places))

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the ratio at phases in mesh cycles, any shape."""
        return self.friction.moment_arms_m(phase_cycles)[0] if self.moment else self.friction.sideways(phase_cycles)
