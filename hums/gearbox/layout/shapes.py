"""Contents of a drawing of a gearbox: gears, rods, bearings, meshes and axes in space."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hums.gearbox.components import Vector

Array = NDArray[np.float64]

PARALLEL = 1e-9


@dataclass
class Line:
    """An axis in space during placement: the origin of its coordinate, and its occupied parts."""

    name: str
    direction: Array
    angle_rad: float = 0.0
    copied: bool = False
    origin: Array | None = None
    taken: list[tuple[float, float]] = field(default_factory=list)

    def at(self, place: float) -> Array:
        """Return the point at a coordinate along the line."""
        assert self.origin is not None  # noqa: S101  - only called for placed lines
        return np.asarray(self.origin + place * self.direction)

    @property
    def end(self) -> float:
        """End of the occupied part of the line."""
        return max((high for _, high in self.taken), default=0.0)

    @property
    def start(self) -> float:
        """Start of the occupied part of the line."""
        return min((low for low, _ in self.taken), default=0.0)

    def along(self, point: Array) -> float:
        """Return the coordinate of a point along the line."""
        assert self.origin is not None  # noqa: S101  - only called for placed lines
        return float((point - self.origin) @ self.direction)

    def distance_to(self, point: Array) -> float:
        """Return the distance of a point from the line."""
        return float(np.linalg.norm(np.cross(point - self.at(0.0), self.direction)))


def transverse_axes(direction: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors normal to a direction, the first in the plane with this normal, if that holds both."""
    first = np.cross(normal, direction)
    if np.linalg.norm(first) < PARALLEL:
        first = np.cross((0.0, 0.0, 1.0) if abs(direction[2]) < 0.9 else (1.0, 0.0, 0.0), direction)  # noqa: PLR2004
    first = first / np.linalg.norm(first)
    first = first if first[int(np.argmax(np.abs(first)))] > 0 else -first
    return vector(first), vector(np.cross(direction, first))


def nearest_place(line: Line, other: Line) -> float:
    """Return the coordinate along a line of its closest point to another, non-parallel line."""
    between = other.at(0.0) - line.at(0.0)
    cosine = float(line.direction @ other.direction)
    return float((line.direction - cosine * other.direction) @ between) / (1 - cosine**2)


def corner(one: Array, other: Array, axis: Array, *, distances: tuple[float, float]) -> Array | None:
    """Return the corner of a triangle at these distances from two points, viewed along an axis; None without one."""
    between = other - one - ((other - one) @ axis) * axis
    gap, (first, second) = float(np.linalg.norm(between)), distances
    if not abs(first - second) < gap < first + second:
        return None
    along, unit = (gap**2 + first**2 - second**2) / (2 * gap), between / gap
    return np.asarray(one + along * unit + math.sqrt(first**2 - along**2) * np.cross(axis, unit))


def rotated(vector: Array, about: Array, angle: float) -> Array:
    """Return a vector rotated about a unit vector (Rodrigues)."""
    along = (about @ vector) * about
    return np.asarray(along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(about, vector))


def orthogonal(direction: Array) -> Array:
    """Return a unit vector normal to a direction."""
    normal = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    return np.asarray(normal / np.linalg.norm(normal))


def vector(values: Array | Vector) -> Vector:
    """Return three numbers as floats, without rounding errors and negative zeros."""
    x, y, z = (float(round(value, 12)) + 0.0 for value in values)
    return (x, y, z)


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
        same = 1e-6  # of a length: far above rounding, far below any gear
        along = np.linalg.norm(np.cross(self.axis, line.direction)) < same
        return bool(along) and line.distance_to(np.array(self.centre)) < same * max(self.radius, 1.0)


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
    """Axis of a body: a point on it, its direction, and the body that carries it."""

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
        Unit of lengths: "mm", or "modules" if no module is declared.
    across, up : vector of 3
        Right and up directions of the section, a plane that contains all axes if there is one.
    planar : bool
        Whether all axes are parallel.
    notes : tuple of str
        Sentences on what is not to scale.

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
        """Right and up directions of the view along the axes."""
        return transverse_axes(self.pairs[0].direction, self.normal)
