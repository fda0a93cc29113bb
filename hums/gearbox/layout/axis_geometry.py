"""Axes in space, and what is where along them."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hums.gearbox.components import Vector

Array = NDArray[np.float64]

PARALLEL = 1e-9


@dataclass
class Line:
    """An axis in space while it is placed: the point whose coordinate along the axis is 0, and what is taken of it."""

    name: str
    direction: Array
    angle_rad: float = 0.0
    copied: bool = False
    origin: Array | None = None
    taken: list[tuple[float, float]] = field(default_factory=list)

    def at(self, place: float) -> Array:
        """Return the point with this coordinate along the line."""
        assert self.origin is not None  # noqa: S101  - only placed lines are asked
        return np.asarray(self.origin + place * self.direction)

    @property
    def end(self) -> float:
        """Where what is taken of the line ends."""
        return max((high for _, high in self.taken), default=0.0)

    @property
    def start(self) -> float:
        """Where what is taken of the line begins."""
        return min((low for low, _ in self.taken), default=0.0)

    def along(self, point: Array) -> float:
        """Return where along the line a point is."""
        assert self.origin is not None  # noqa: S101  - only placed lines are asked
        return float((point - self.origin) @ self.direction)

    def distance_to(self, point: Array) -> float:
        """Return how far from the line a point is."""
        return float(np.linalg.norm(np.cross(point - self.at(0.0), self.direction)))


def transverse_axes(direction: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors across a direction; the first is in the plane with this normal, where it holds both."""
    first = np.cross(normal, direction)
    if np.linalg.norm(first) < PARALLEL:
        first = np.cross((0.0, 0.0, 1.0) if abs(direction[2]) < 0.9 else (1.0, 0.0, 0.0), direction)  # noqa: PLR2004
    first = first / np.linalg.norm(first)
    first = first if first[int(np.argmax(np.abs(first)))] > 0 else -first
    return vector(first), vector(np.cross(direction, first))


def nearest_place(line: Line, other: Line) -> float:
    """Return where along a line another one that is not parallel passes it nearest."""
    between = other.at(0.0) - line.at(0.0)
    cosine = float(line.direction @ other.direction)
    return float((line.direction - cosine * other.direction) @ between) / (1 - cosine**2)


def corner(one: Array, other: Array, axis: Array, *, distances: tuple[float, float]) -> Array | None:
    """Return the corner of a triangle at these distances from two points, seen along an axis; None where it is open."""
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
    """Return a unit vector across a direction."""
    normal = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    return np.asarray(normal / np.linalg.norm(normal))


def vector(values: Array | Vector) -> Vector:
    """Return three numbers as plain ones, free of rounding and of negative zeros."""
    x, y, z = (float(round(value, 12)) + 0.0 for value in values)
    return (x, y, z)
