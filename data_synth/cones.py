"""Pitch cones of bevel gears: their line of contact and their virtual spur gears."""

import math
from dataclasses import dataclass, replace

import numpy as np

from data_synth.elements import as_vector
from data_synth.gear_geometry import GearPair
from data_synth.mechanics import Array, Vector

_MAX_TEETH = 2000  # of a virtual gear: a crown wheel would be a rack


@dataclass(frozen=True, kw_only=True)
class Cone:
    """The pitch cones of a bevel pair, which roll on each other along one line.

    Attributes
    ----------
    element : vector of 3
        Direction in space from the apex along the line of contact of the cones.
    axes : pair of vectors
        Directions of the gears' axes.
    internal : bool
        Whether one of them is an internal gear.
    """

    element: Vector
    axes: tuple[Vector, Vector]
    internal: bool

    @property
    def cosines(self) -> tuple[float, float]:
        """Cosines of the pitch angles, between each axis and the element."""
        one, two = (float(np.dot(self.element, axis)) for axis in self.axes)
        return one, two

    @property
    def sines(self) -> tuple[float, float]:
        """Sines of the pitch angles: pitch radii over the distance from the apex."""
        one, two = (math.sqrt(1 - cosine**2) for cosine in self.cosines)
        return one, two

    @property
    def away(self) -> Array:
        """Unit vector (3,) across the element, from the first gear, an external one, into the second."""
        cosine, sine = self.cosines[0], self.sines[0]
        outwards = (cosine * np.array(self.element) - np.array(self.axes[0])) / sine
        return np.asarray(outwards if cosine >= 0 else -outwards)

    def distance_m(self, middle: GearPair) -> float:
        """Return the mean cone distance: from the apex to the middle of the face."""
        return middle.reference_radii_m[0] / self.sines[0]

    def middle(self, outer: GearPair, mesh: str) -> GearPair:
        """Return the section in the middle of the face of a pair whose module is that of the outer end."""
        cone_distance_m = self.distance_m(outer)
        if not outer.face_width_m < cone_distance_m:
            raise ValueError(
                f'mesh "{mesh}": a face of {1e3 * outer.face_width_m:.4g} mm does not fit a cone of '
                f"{1e3 * cone_distance_m:.4g} mm from its apex; correct face_width_mm or module_mm."
            )
        return replace(outer, module_m=outer.module_m * (1 - outer.face_width_m / 2 / cone_distance_m))

    def virtual_spur_gears(self, middle: GearPair) -> GearPair:
        """Return the virtual spur gears, ``z / cos(delta)`` rounded to whole teeth (Tredgold; ISO 10300-1)."""
        one, two = (
            min(_MAX_TEETH, round(abs(teeth) / max(abs(cosine), 1 / _MAX_TEETH)))
            for teeth, cosine in zip(middle.teeth, self.cosines, strict=True)
        )
        return replace(middle, teeth=(one, -two if self.internal else two))

    def reversed(self) -> "Cone":
        """Return the same cones with the gears in the other order."""
        return replace(self, axes=(self.axes[1], self.axes[0]))


def cone_of(axes: tuple[Array, Array], teeth: tuple[int, int]) -> Cone:
    """Return the pitch cones of two gears on axes of given directions, with signs as in ``Z_i w_i + Z_j w_j = 0``.

    Relative rotation is about the element, so it is along ``Z_j a_i + Z_i a_j``; a gear with a minus is on the negative
    side of the apex, or internal.
    """
    along = math.copysign(1.0, teeth[0] * teeth[1]) * (teeth[1] * axes[0] + teeth[0] * axes[1])
    element = along / np.linalg.norm(along)
    cosines = [float(element @ axis) for axis in axes]
    # both cones on one side of the element: one is inside the other
    inside = math.copysign(1.0, cosines[0] * cosines[1]) * (float(axes[0] @ axes[1]) - cosines[0] * cosines[1]) > 0
    return Cone(element=as_vector(element), axes=(as_vector(axes[0]), as_vector(axes[1])), internal=inside)
