"""What a drawing of a gearbox holds: gears, rods, bearings, meshes and axes in space."""

from dataclasses import dataclass

import numpy as np

from hums.gearbox.components import Vector
from hums.gearbox.layout.axis_geometry import Line, transverse_axes, vector

_SAME = 1e-6  # of a length: far above rounding, far below any gear


@dataclass(frozen=True, kw_only=True)
class GearShape:
    """One gear: its pitch circle in the middle of the face, or at the outer end of a pitch cone.

    Attributes
    ----------
    link, declared, body : str
        Link (a copy has its number), the link as declared, and the body it belongs to.
    teeth : int
        Number of teeth, positive.
    internal : bool
        Whether the teeth point inwards.
    meshes : tuple of str
        Names of its meshes.
    centre, axis : vector of 3
        Centre of the pitch circle, and unit vector of the axis.
    radius, face : float
        Pitch radius and face width.
    cone_rad : float
        Signed angle of the pitch cone: 0 for a cylinder; the apex is ``radius / tan(cone)`` against the axis.
    tooth_rad : float
        Angle of the middle of a tooth about the axis, from `transverse_axes`, in the drawn position.
    """

    link: str
    declared: str
    body: str
    teeth: int
    internal: bool
    meshes: tuple[str, ...]
    centre: Vector
    axis: Vector
    radius: float
    face: float
    cone_rad: float = 0.0
    tooth_rad: float = 0.0

    def turns_about(self, line: Line) -> bool:
        """Whether the axis of the gear is this line."""
        along = np.linalg.norm(np.cross(self.axis, line.direction)) < _SAME
        return bool(along) and line.distance_to(np.array(self.centre)) < _SAME * max(self.radius, 1.0)


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A part of a body drawn as a line through points: a shaft, a carrier arm with its pin, or the web of a ring gear.

    `kind` is "shaft", "arm" or "web"; `planet` the body that an arm holds.
    """

    body: str
    kind: str
    points: tuple[Vector, ...]
    radius: float
    planet: str = ""


@dataclass(frozen=True, kw_only=True)
class BearingShape:
    """A bearing: the circle of its elements, and their number and radius."""

    name: str
    inner: str
    outer: str
    centre: Vector
    axis: Vector
    radius: float
    element_radius: float
    elements: int


@dataclass(frozen=True, kw_only=True)
class MeshPoint:
    """The pitch point of one contact; it moves with the carrier."""

    mesh: str
    carrier: str
    point: Vector
    flexible: bool


@dataclass(frozen=True, kw_only=True)
class TurningPair:
    """The axis of a body: a point of it, its direction, and the body that carries it."""

    body: str
    carried_by: str
    point: Vector
    direction: Vector


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The parts of a gearbox in space, as drawn.

    Attributes
    ----------
    gears, rods, bearings, meshes, pairs : tuples of shapes
    unit : str
        Unit of lengths: "mm", or "modules" where no module is declared.
    across, up : vector of 3
        Directions to the right and upwards of the section; all axes lie in this plane where they share one.
    planar : bool
        Whether all axes are parallel.
    notes : tuple of str
        What is not to scale, in sentences.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.layout import layout_of
    >>> drawn = layout_of(hums.load_gearbox("wijianto-pair"))
    >>> {gear.link: round(2 * gear.radius, 2) for gear in drawn.gears}  # mm: 128.81 and 225.43 are printed there
    {'pinion': 128.81, 'gear': 225.43}
    """

    gears: tuple[GearShape, ...]
    rods: tuple[Rod, ...]
    bearings: tuple[BearingShape, ...]
    meshes: tuple[MeshPoint, ...]
    pairs: tuple[TurningPair, ...]
    unit: str
    across: Vector
    up: Vector
    planar: bool
    notes: tuple[str, ...]

    @property
    def normal(self) -> Vector:
        """Direction out of the section, towards the viewer."""
        return vector(np.cross(self.across, self.up))

    @property
    def axial(self) -> tuple[Vector, Vector]:
        """Directions to the right and upwards of the view along the axes."""
        return transverse_axes(self.pairs[0].direction, self.normal)
