"""Sliding friction between teeth: the moments and the sideways force it adds to a mesh force."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_synth.gear_geometry import GearPair
from data_synth.mesh import Array


@dataclass(frozen=True, kw_only=True)
class SlidingFriction:
    """Coulomb's friction on the flanks of spur or helical gears with teeth outside, pairs in contact sharing evenly.

    With the mesh force along n, from the ccw driver to the driven gear, flanks slide along z x n. Before the pitch
    point the driven flank is the faster one and after it the driver's, so friction turns round there. At the distance
    s from the tangent point on the driver's base circle it has the lever s about the driver and ``a sin(alpha) - s``
    about the driven gear, the moments M_fp and M_fg of Howard, Jia and Wang (2001, Mech. Syst. Signal Process. 15).

    Attributes
    ----------
    gears : GearPair
        The driver first.
    coefficient : float
    """

    gears: GearPair
    coefficient: float

    def __post_init__(self) -> None:
        if self.gears.teeth[1] < 0:
            raise ValueError(f"teeth = {self.gears.teeth}: friction is worked out for teeth outside.")
        if not 0 <= self.coefficient < 1:
            raise ValueError(f"coefficient = {self.coefficient!r} has to be at least 0 and below 1.")

    def levers_m(self, phase_cycles: ArrayLike) -> tuple[Array, Array]:
        """Return moment over mesh force on driver and driven gear, in m, each in the sense the gear turns.

        Friction slows the faster flank and drives the slower one: their signs differ, and together they lose power.
        """
        on_path, sense, in_contact = self._pairs(phase_cycles)
        whole = self.gears.centre_distance_m * math.sin(self.gears.working_angle_rad)
        share = self.coefficient * sense / in_contact.sum(axis=0)
        return np.asarray((share * on_path).sum(axis=0)), np.asarray(-(share * (whole - on_path)).sum(axis=0))

    def sideways(self, phase_cycles: ArrayLike) -> Array:
        """Return the friction force on the driver along z x n, over the mesh force; on the driven gear its opposite."""
        _, sense, in_contact = self._pairs(phase_cycles)
        return np.asarray(self.coefficient * sense.sum(axis=0) / in_contact.sum(axis=0))

    @property
    def shares(self) -> "tuple[FrictionShare, FrictionShare]":
        """`sideways` and the driver's lever over the phase: times the mesh force, all that rubs on both gears."""
        return FrictionShare(friction=self, moment=False), FrictionShare(friction=self, moment=True)

    def _pairs(self, phase_cycles: ArrayLike) -> tuple[Array, Array, Array]:
        """Return distance on the path, sense of the friction (0 where out of contact) and contact of every pair."""
        begin, end = self.gears.path_m
        pitch_point = self.gears.base_radii_m[0] * math.tan(self.gears.working_angle_rad)
        since = np.remainder(np.asarray(phase_cycles, dtype=np.float64), 1.0)
        older = np.arange(math.ceil(self.gears.contact_ratio)).reshape(-1, *(1,) * since.ndim)
        on_path = begin + (since + older) * self.gears.base_pitch_m
        in_contact = (on_path < end).astype(np.float64)
        return np.asarray(on_path), np.asarray(in_contact * np.sign(pitch_point - on_path)), in_contact


@dataclass(frozen=True, kw_only=True)
class FrictionShare:
    """What the mesh force is multiplied by, over the mesh phase: for the sideways force, or for the driver's moment."""

    friction: SlidingFriction
    moment: bool

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which a pair enters, leaves, or passes the pitch point."""
        gears = self.friction.gears
        begin, end = gears.path_m
        pitch_point = gears.base_radii_m[0] * math.tan(gears.working_angle_rad)
        return tuple(sorted({0.0, *((place - begin) / gears.base_pitch_m % 1.0 for place in (end, pitch_point))}))

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return it at phases in mesh cycles, any shape."""
        return self.friction.levers_m(phase_cycles)[0] if self.moment else self.friction.sideways(phase_cycles)
