"""Stribeck's distribution of the load on a bearing over its elements."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_synth.profile import Array

_POINT_CONTACT = 1.5


@dataclass(frozen=True, kw_only=True)
class LoadZone:
    """Stribeck's distribution: ``(1 - (1 - cos psi) / (2 e)) ** exponent`` within the load zone, zero outside.

    ``e = (1 - cos half_angle) / 2``: 90 degrees without clearance, less with, more under preload. The exponent is 3/2
    for balls and 10/9 for rollers (Harris 2001, Rolling Bearing Analysis).
    """

    half_angle_rad: float = math.pi / 2
    exponent: float = _POINT_CONTACT

    def __post_init__(self) -> None:
        if not 0 < self.half_angle_rad <= math.pi:
            raise ValueError(f"half_angle_rad = {self.half_angle_rad:g} is not above 0 and at most pi")

    @classmethod
    def of(cls, *, distribution: float, exponent: float = _POINT_CONTACT) -> "LoadZone":
        """Return the load zone of Stribeck's factor e, above 0 and at most 1: 0.5 where half of the ring is loaded."""
        return cls(half_angle_rad=math.acos(1 - 2 * distribution), exponent=exponent)

    def share(self, angle_rad: ArrayLike) -> Array:
        """Return the load relative to the largest, at `angle_rad` (n,) from the middle of the zone."""
        lowest = (1 - math.cos(self.half_angle_rad)) / 2
        return stribeck_load(angle_rad, distribution=lowest, exponent=self.exponent)


def stribeck_load(angle_rad: ArrayLike, *, distribution: float, exponent: float = _POINT_CONTACT) -> Array:
    """Return the load on an element relative to the largest: ``max(0, 1 - (1 - cos psi) / (2 eps)) ** exponent``.

    Parameters
    ----------
    angle_rad : (n,) array
        psi, from the middle of the load zone, in rad.
    distribution : float
        eps: 0.5 where half of the ring is loaded, less with clearance, more with preload.
    exponent : float
        3/2 for point contact, 10/9 for line contact.
    """
    lowered = (1 - np.cos(np.asarray(angle_rad, dtype=np.float64))) / (2 * distribution)
    return np.asarray(np.maximum(0.0, 1 - lowered) ** exponent)
