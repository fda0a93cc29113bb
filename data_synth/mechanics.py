"""The equations of motion of a gearbox: bodies and elements assembled into mass, damping, stiffness and meshes.

    M q'' + (C + G) q' + K q + sum_m g_m k_m(phi_m) f(g_m . q - e_m(phi_m)) = F(t)

with one row g_m per mesh, k_m its stiffness and e_m its transmission error at the mesh phase phi_m, and f the dead
zone of half width `Mesh.backlash_m`. Bodies are rigid and keep the motions they are given; a motion that a body lacks
is held at zero. Whatever joins bodies is one thing: a row g that turns displacements into one deflection, and a
constant k. Bearings and shafts give several such springs, a mesh one whose constant follows the mesh phase, so that
``K = sum k g g'`` is never stored in a form that has lost the soft springs beside the stiff ones (`System.springs`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from data_synth.mesh import Stiffness
from data_synth.transmission_error import TransmissionError

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
TORSION = ("rotation",)
PLANE = ("x", "y", "rotation")
SPACE = ("x", "y", "z", "tilt x", "tilt y", "rotation")
_TRANSLATIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_ALONG_Z = 1e-12


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """One mesh, as the equations of motion see it.

    Attributes
    ----------
    name : str
    direction : (dof,) array
        g: the deflection along the line of action is ``g . q``, positive where teeth are pressed together. In m/m for
        translations, m/rad for rotations.
    stiffness : Stiffness
        k over the mesh phase in cycles, N/m.
    error : TransmissionError or None
        e over the mesh phase in m, subtracted from the deflection.
    backlash_m : float
        Half the gap. 0: teeth never part, and the mesh is linear.
    cycles_per_rev : float
        Mesh cycles per revolution of the reference; the phase is zero where the reference's angle is.
    """

    name: str
    direction: Array = field(metadata={"dims": ("dof",), "units": "m/m or m/rad"})
    stiffness: Stiffness
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    cycles_per_rev: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A linear spring with a damper beside it: force ``-g (stiffness g . q + damping g . q')``."""

    direction: Array = field(metadata={"dims": ("dof",), "units": "m/m or m/rad"})
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True, kw_only=True)
class System:
    """Matrices and meshes of the equation above.

    Attributes
    ----------
    mass, damping, stiffness : (dof, dof) arrays
        The constant parts, without meshes: kg, N s/m, N/m for translations, and likewise for rotations.
    gyroscopic : (dof, dof) array or None
        Skew-symmetric part of the velocity terms, at the speed the system was assembled for.
    meshes : tuple of Mesh
    names : tuple of str
        One per degree of freedom, as "pinion x" or "pinion rotation".
    springs : tuple of Spring
        What `stiffness` is the sum of, where nothing else is in it; empty otherwise.
    """

    mass: Array = field(metadata={"dims": ("dof", "dof"), "units": "kg or kg m2"})
    damping: Array = field(metadata={"dims": ("dof", "dof"), "units": "N s/m or N m s"})
    stiffness: Array = field(metadata={"dims": ("dof", "dof"), "units": "N/m or N m"})
    gyroscopic: Array | None = None
    meshes: tuple[Mesh, ...]
    names: tuple[str, ...]
    springs: tuple[Spring, ...] = ()

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.names)

    def mean_stiffness(self) -> Array:
        """Return K with every mesh closed at its mean stiffness, (dof, dof)."""
        total = self.stiffness.copy()
        for mesh in self.meshes:
            total += mesh.stiffness.mean * np.outer(mesh.direction, mesh.direction)
        return total


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body that is round about its axis.

    Attributes
    ----------
    name : str
    mass_kg : float
    inertia_kgm2, tilt_inertia_kgm2 : float
        About the axis and about any line through the centre across it; needed where the motions have them.
    motions : tuple of str
        Of "x", "y", "z" (along the directions of space), "rotation" (about the axis), "tilt x", "tilt y" (about the
        directions across the axis: x and y themselves for an axis along z).
    centre_m, axis : vectors of 3
    speed_ratio : float
        Revolutions about the axis per revolution of the reference, as the frame at rest sees it; only gyroscopic terms
        use it.
    """

    name: str
    mass_kg: float = 0.0
    inertia_kgm2: float = 0.0
    tilt_inertia_kgm2: float = 0.0
    motions: tuple[str, ...]
    centre_m: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    speed_ratio: float = 0.0

    def __post_init__(self) -> None:
        for motion in self.motions:
            if motion not in SPACE:
                raise ValueError(f'body "{self.name}": the motion "{motion}" is not one of {", ".join(SPACE)}.')
            if not self.inertia(motion) > 0:
                what = "mass_kg" if motion in _TRANSLATIONS else "inertia_kgm2"
                what = "tilt_inertia_kgm2" if motion.startswith("tilt") else what
                raise ValueError(
                    f'body "{self.name}": {what} = {self.inertia(motion)!r} cannot move along "{motion}"; give a '
                    "positive number, or leave the motion out."
                )

    def inertia(self, motion: str) -> float:
        """Return what resists a motion: kg or kg m2."""
        if motion in _TRANSLATIONS:
            return self.mass_kg
        return self.inertia_kgm2 if motion == "rotation" else self.tilt_inertia_kgm2

    def turning(self, motion: str) -> Array:
        """Return the unit vector a rotation turns about, (3,)."""
        axis = np.asarray(self.axis, dtype=np.float64) / np.linalg.norm(self.axis)
        if motion == "rotation":
            return np.asarray(axis)
        first = np.array([1.0, 0.0, 0.0]) if np.hypot(axis[0], axis[1]) < _ALONG_Z else np.cross([0, 0, 1], axis)
        first = first / np.linalg.norm(first)
        if motion == "tilt x":
            return np.asarray(first)
        second = np.array([0.0, 1.0, 0.0]) if np.hypot(axis[0], axis[1]) < _ALONG_Z else np.cross(axis, first)
        return np.asarray(second, dtype=np.float64)


class Coordinates:
    """Where each motion of each body stands in q, and how points of bodies move with it."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        names = [body.name for body in bodies]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f'two bodies are called "{min(twice)}"; name each once.')
        self.bodies = {body.name: body for body in bodies}
        places = [(body.name, motion) for body in bodies for motion in body.motions]
        self.index = {place: number for number, place in enumerate(places)}
        self.names = tuple(f"{name} {motion}" for name, motion in places)

    def body(self, name: str) -> Body:
        """Return a body by name."""
        if name not in self.bodies:
            raise ValueError(f'no body is called "{name}"; there are {", ".join(self.bodies)}.')
        return self.bodies[name]

    def point(self, name: str | None, point_m: Vector | Array, direction: Vector | Array) -> Array:
        """Return the row g that gives how far a point of a body moves along a direction, (dof,).

        ``g . q = d . (u + theta x (P - centre))``; zero for None, which is the ground.
        """
        row = np.zeros(len(self.names))
        if name is None:
            return row
        body, along = self.body(name), np.asarray(direction, dtype=np.float64)
        moment = np.cross(np.asarray(point_m) - np.asarray(body.centre_m), along)
        for motion in body.motions:
            rotates = motion not in _TRANSLATIONS
            reach = body.turning(motion) @ moment if rotates else np.asarray(_TRANSLATIONS[motion]) @ along
            row[self.index[name, motion]] = reach
        return row

    def turn(self, name: str | None, direction: Vector | Array) -> Array:
        """Return the row g that gives how far a body turns about a direction, (dof,)."""
        row = np.zeros(len(self.names))
        if name is not None:
            body = self.body(name)
            for motion in body.motions:
                if motion not in _TRANSLATIONS:
                    row[self.index[name, motion]] = body.turning(motion) @ np.asarray(direction, dtype=np.float64)
        return row


class Element(Protocol):
    """What joins bodies: it adds springs and meshes."""

    def terms(self, at: Coordinates) -> Iterator[Spring | Mesh]:
        """Yield its springs and meshes in the coordinates of the system."""


def build_system(
    bodies: Sequence[Body],
    elements: Iterable[Element],
    *,
    speed_rad_s: float = 0.0,
    frame_ratio: float = 0.0,
) -> System:
    """Assemble bodies and elements.

    Parameters
    ----------
    bodies : sequence of Body
    elements : iterable of Element
        Bearings, shafts, couplings, meshes; see `data_synth.elements`.
    speed_rad_s : float
        Speed of the reference. Other than zero, gyroscopic terms are added.
    frame_ratio : float
        Turns of the coordinates themselves about z per revolution of the reference: the carrier's speed ratio for a
        planetary stage. Mass times ``2 Omega`` then couples x and y, and ``-Omega^2`` times the mass joins the
        stiffness (Lin and Parker 1999, eq. 1). What stands beside a turning frame has to be alike in x and y.

    Returns
    -------
    System

    Raises
    ------
    ValueError
        Names used twice or unknown, or a turning frame with a body whose axis is not along z.
    """
    at = Coordinates(bodies)
    terms = [term for element in elements for term in element.terms(at)]
    springs = tuple(term for term in terms if isinstance(term, Spring))
    size = len(at.names)
    mass = np.diag([body.inertia(motion) for body in bodies for motion in body.motions])
    stiffness, damping = np.zeros((size, size)), np.zeros((size, size))
    for spring in springs:
        square = np.outer(spring.direction, spring.direction)
        stiffness += spring.stiffness * square
        damping += spring.damping * square
    gyroscopic, centripetal = _turning(at, speed_rad_s, frame_ratio * speed_rad_s)
    return System(
        mass=mass,
        damping=damping,
        stiffness=stiffness + centripetal,
        gyroscopic=gyroscopic if gyroscopic.any() else None,
        meshes=tuple(term for term in terms if isinstance(term, Mesh)),
        names=at.names,
        springs=() if centripetal.any() else springs,
    )


def _turning(at: Coordinates, speed: float, frame: float) -> tuple[Array, Array]:
    """Return the gyroscopic and the centripetal matrix.

    With z = x + jy in a frame that turns at Omega a mass obeys ``m (z'' + 2j Omega z' - Omega^2 z)``, and a tilt, the
    body spinning at w, ``I (t'' + 2j Omega t' - Omega^2 t) - j J w (t' + j Omega t)``.
    """
    size = len(at.names)
    gyroscopic, centripetal = np.zeros((size, size)), np.zeros((size, size))
    for body in at.bodies.values():
        if frame and np.hypot(body.axis[0], body.axis[1]) > _ALONG_Z:
            raise ValueError(f'body "{body.name}": its axis {body.axis} is not along z, about which the frame turns.')
        across = np.cross(body.turning("tilt x"), body.turning("tilt y")) @ body.turning("rotation")
        spin = across * body.inertia_kgm2 * body.speed_ratio * speed
        for pair, inertia, momentum in (
            (("x", "y"), body.mass_kg, 0.0),
            (("tilt x", "tilt y"), body.tilt_inertia_kgm2, spin),
        ):
            places = [at.index.get((body.name, motion)) for motion in pair]
            for number in (place for place in places if place is not None):
                centripetal[number, number] = frame * (momentum - inertia * frame)
            if None not in places:
                first, second = places
                gyroscopic[second, first] = 2 * inertia * frame - momentum
                gyroscopic[first, second] = -gyroscopic[second, first]
    return gyroscopic, centripetal
