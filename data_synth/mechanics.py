"""The equations of motion of a gearbox: bodies and elements assembled into mass, damping, stiffness and meshes.

    M q'' + (C + G) q' + K q + sum_m g_m k_m(phi_m) f(g_m . q - e_m(phi_m)) = F(t)

with one row g_m per mesh, k_m its stiffness and e_m its transmission error at the mesh phase phi_m, and f the dead
zone of half width `Mesh.backlash_m`. Bodies are rigid and keep the motions they are given; a motion that a body lacks
is held at zero. Whatever joins bodies is one thing: a row g that turns displacements into one deflection, and a
constant k. Bearings and shafts give several such springs, a mesh one whose constant follows the mesh phase, so that
``K = sum k g g'`` is never stored in a form that has lost the soft springs beside the stiff ones (`System.springs`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
class Course:
    """How the teeth of a mesh change in time: as at each of some instants, and linear between them.

    Attributes
    ----------
    times_s : (j,) array
        Rising, two or more; before the first and after the last nothing changes.
    stiffnesses : tuple of j Stiffness
    errors : tuple of j TransmissionError or None
        All of them there, or none.
    """

    times_s: Array = field(metadata={"dims": ("stage",), "units": "s"})
    stiffnesses: tuple[Stiffness, ...]
    errors: tuple[TransmissionError | None, ...]

    def __post_init__(self) -> None:
        count = len(self.times_s)
        if count < 2 or not np.all(np.diff(self.times_s) > 0):  # noqa: PLR2004
            raise ValueError(f"times_s = {self.times_s}: two or more instants are needed, rising.")
        if (len(self.stiffnesses), len(self.errors)) != (count, count) or len({e is None for e in self.errors}) != 1:
            raise ValueError(
                f"{count} instants need as many stiffnesses and errors, these all or none of them None; there are "
                f"{len(self.stiffnesses)} and {len(self.errors)}."
            )

    def stage(self, times_s: Array) -> Array:
        """Return where in the course each time (n,) is: 1.5 lies halfway between the second and the third instant."""
        return np.interp(times_s, self.times_s, np.arange(len(self.times_s)))


class Share(Protocol):
    """A number that follows the mesh phase, cycle after cycle."""

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases in [0, 1), rising, at which it jumps."""

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return it at phases in mesh cycles, any shape."""


@dataclass(frozen=True, kw_only=True)
class Rubbing:
    """Friction of a mesh: bodies feel ``direction x share(phase)`` times the force between the flanks that drive."""

    direction: Array = field(metadata={"dims": ("dof",), "units": "1 or m, over share"})
    share: Share


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
    course : Course or None
        Where teeth change in time; its first stage is `stiffness` and `error`.
    friction : tuple of Rubbing
        Forces that go with the mesh force, across its direction. Backs of teeth that touch in a gap rub nothing.
    """

    name: str
    direction: Array = field(metadata={"dims": ("dof",), "units": "m/m or m/rad"})
    stiffness: Stiffness
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    cycles_per_rev: float = 1.0
    course: Course | None = None
    friction: tuple[Rubbing, ...] = ()

    def teeth_at(self, phase_cycles: Array, times_s: Array) -> tuple[Array, Array]:
        """Return stiffness in N/m and transmission error in m at phases and times (n,)."""
        none = np.zeros(np.shape(phase_cycles))
        if self.course is None:
            return self.stiffness(phase_cycles), none if self.error is None else self.error(phase_cycles)
        stage = self.course.stage(times_s)
        weights = [np.maximum(1 - np.abs(stage - number), 0) for number in range(len(self.course.times_s))]
        errors = [none if error is None else error(phase_cycles) for error in self.course.errors]
        stiffness = sum((w * k(phase_cycles) for w, k in zip(weights, self.course.stiffnesses, strict=True)), none)
        return stiffness, sum((w * e for w, e in zip(weights, errors, strict=True)), none)


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
    frame_ratio : float
        Turns of its x and y about z per revolution of the reference.
    turns_with : str or None
        Another body of which this one is a piece: its rotation is that of the other.
    """

    name: str
    mass_kg: float = 0.0
    inertia_kgm2: float = 0.0
    tilt_inertia_kgm2: float = 0.0
    motions: tuple[str, ...]
    centre_m: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    speed_ratio: float = 0.0
    frame_ratio: float = 0.0
    turns_with: str | None = None

    def __post_init__(self) -> None:
        for motion in self.motions:
            if motion not in SPACE:
                raise ValueError(f'body "{self.name}": the motion "{motion}" is not one of {", ".join(SPACE)}.')
            if not self.inertia(motion) > 0 and (motion != "rotation" or self.turns_with is None):
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
        places = [
            (body.name, motion)
            for body in bodies
            for motion in body.motions
            if motion != "rotation" or body.turns_with is None
        ]
        self.index = {place: number for number, place in enumerate(places)}
        self.names = tuple(f"{name} {motion}" for name, motion in places)
        for body in bodies:
            if body.turns_with is not None:
                self.index[body.name, "rotation"] = self.index[body.turns_with, "rotation"]

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
        Turns of all coordinates about z per revolution of the reference, in place of each body's own: the carrier's
        speed ratio for a planetary stage. Mass times ``2 Omega`` then couples x and y, and ``-Omega^2`` times the
        mass joins the stiffness (Lin and Parker 1999, eq. 1). What stands beside a turning frame has to be alike in x
        and y.

    Returns
    -------
    System

    Raises
    ------
    ValueError
        Names used twice or unknown.
    """
    if frame_ratio:
        bodies = [replace(body, frame_ratio=frame_ratio) for body in bodies]
    at = Coordinates(bodies)
    terms = [term for element in elements for term in element.terms(at)]
    springs = tuple(term for term in terms if isinstance(term, Spring))
    size = len(at.names)
    own = [(body, motion) for body in bodies for motion in body.motions if motion != "rotation" or not body.turns_with]
    mass = np.diag([body.inertia(motion) for body, motion in own])
    stiffness, damping = np.zeros((size, size)), np.zeros((size, size))
    for spring in springs:
        square = np.outer(spring.direction, spring.direction)
        stiffness += spring.stiffness * square
        damping += spring.damping * square
    gyroscopic, centripetal = _turning(at, speed_rad_s)
    return System(
        mass=mass,
        damping=damping,
        stiffness=stiffness + centripetal,
        gyroscopic=gyroscopic if gyroscopic.any() else None,
        meshes=tuple(term for term in terms if isinstance(term, Mesh)),
        names=at.names,
        springs=() if centripetal.any() else springs,
    )


def _turning(at: Coordinates, speed: float) -> tuple[Array, Array]:
    """Return the gyroscopic and the centripetal matrix.

    With z = x + jy in a frame that turns at Omega a mass obeys ``m (z'' + 2j Omega z' - Omega^2 z)``, and a tilt, the
    body spinning at w, ``I (t'' + 2j Omega t' - Omega^2 t) - j J w (t' + j Omega t)``; where its axis is not along z,
    as that of a bevel planet, the turning of the frame is left out of its tilt.
    """
    size = len(at.names)
    gyroscopic, centripetal = np.zeros((size, size)), np.zeros((size, size))
    for body in at.bodies.values():
        frame = body.frame_ratio * speed
        upright = np.hypot(body.axis[0], body.axis[1]) <= _ALONG_Z
        across = np.cross(body.turning("tilt x"), body.turning("tilt y")) @ body.turning("rotation")
        spin = across * body.inertia_kgm2 * body.speed_ratio * speed
        for pair, inertia, momentum in (
            (("x", "y"), body.mass_kg, 0.0),
            (("tilt x", "tilt y"), body.tilt_inertia_kgm2, spin),
        ):
            if frame and not upright and pair[0] != "x":
                continue
            places = [at.index.get((body.name, motion)) for motion in pair]
            for number in (place for place in places if place is not None):
                centripetal[number, number] = frame * (momentum - inertia * frame)
            if None not in places:
                first, second = places
                gyroscopic[second, first] = 2 * inertia * frame - momentum
                gyroscopic[first, second] = -gyroscopic[second, first]
    return gyroscopic, centripetal
