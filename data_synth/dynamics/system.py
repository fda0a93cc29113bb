"""The equations of motion of a gearbox: bodies and elements assembled into mass, damping, stiffness and meshes.

    M q'' + (C + G) q' + K q + sum_m g_m k_m(phi_m) f(g_m . q - e_m(phi_m)) = F(t)

where mesh m has the deflection row g_m, the stiffness k_m and the transmission error e_m at its phase phi_m, and f is a
dead zone of half width `Mesh.backlash_m`. Bodies are rigid; motions that they are not given are held at zero. Every
element that connects bodies has a row g, which turns displacements into a deflection, and a constant k. Bearings and
shafts consist of several such springs; a mesh is one whose stiffness depends on the mesh phase. `System.springs` keeps
the springs as well as their sum ``K = sum k g g'``, in which soft ones lose digits to stiff ones.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from data_synth.gears.friction import FrictionShare
from data_synth.gears.mesh_stiffness import Stiffness
from data_synth.gears.transmission_error import TransmissionError

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
TORSION = ("rotation",)
PLANE = ("x", "y", "rotation")
SPACE = ("x", "y", "z", "tilt x", "tilt y", "rotation")
_TRANSLATIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_ALONG_Z = 1e-12


@dataclass(frozen=True, kw_only=True)
class MeshHistory:
    """Teeth that change slowly in time, such as by a growing fault, interpolated linearly between instants.

    Attributes
    ----------
    times_s : (j,) array
        Two or more instants in s, increasing; nothing changes before the first and after the last.
    stiffnesses : tuple of j Stiffness
        Mesh stiffness as a function of mesh phase at each instant.
    errors : tuple of j TransmissionError or None
        Transmission error as a function of mesh phase at each instant; all given, or all None.

    Raises
    ------
    ValueError
        If there are fewer than two instants, they do not increase, or the numbers of values differ.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Constant, MeshHistory
    >>> teeth = Constant(mean=2e8), Constant(mean=1e8)
    >>> history = MeshHistory(times_s=np.array([0.0, 10.0]), stiffnesses=teeth, errors=(None, None))
    >>> history.position(np.array([5.0])).tolist()
    [0.5]
    """

    times_s: Array = field(metadata={"dims": ("stage",), "units": "s"})
    stiffnesses: tuple[Stiffness, ...]
    errors: tuple[TransmissionError | None, ...]

    def __post_init__(self) -> None:
        count = len(self.times_s)
        if count < 2 or not np.all(np.diff(self.times_s) > 0):  # noqa: PLR2004
            raise ValueError(f"times_s = {self.times_s} must be two or more increasing instants.")
        if (len(self.stiffnesses), len(self.errors)) != (count, count) or len({e is None for e in self.errors}) != 1:
            raise ValueError(
                f"{count} instants need as many stiffnesses and errors, the errors all given or all None; there are "
                f"{len(self.stiffnesses)} and {len(self.errors)}."
            )

    def position(self, times_s: Array) -> Array:
        """Return the fractional index (n,) of the instant at each time: 1.5 is midway between the second and third.

        Parameters
        ----------
        times_s : (n,) array
            Times in s.
        """
        return np.interp(times_s, self.times_s, np.arange(len(self.times_s)))


@dataclass(frozen=True, kw_only=True)
class FrictionForce:
    """Tooth friction: a force of ``direction x factor(phase)`` times the normal force between the driving flanks.

    Attributes
    ----------
    direction : (dof,) array
        Generalised force per unit of friction force.
    factor : FrictionShare
        Friction force over normal force at each mesh phase.

    Examples
    --------
    With one pair of teeth in contact beyond the pitch point, the friction force is the coefficient of friction times
    the normal force:

    >>> import numpy as np
    >>> from data_synth.dynamics import FrictionForce
    >>> from data_synth.gears.friction import SlidingFriction
    >>> from data_synth.gears.geometry import GearPair
    >>> gears = GearPair(teeth=(20, 40), module_m=0.004, face_width_m=0.03, pressure_angle_rad=0.349)
    >>> transverse, moment = SlidingFriction(gears=gears, coefficient=0.05).shares
    >>> force = FrictionForce(direction=np.array([0.0, 1.0]), factor=transverse)  # of the degrees of freedom x and y
    >>> force.factor([0.9]).tolist()
    [-0.05]
    """

    direction: Array = field(metadata={"dims": ("dof",), "units": "1 or m, over factor"})
    factor: FrictionShare


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """One gear mesh in the equations of motion.

    Attributes
    ----------
    name : str
        Name of the contact, such as "sun-planet 1".
    direction : (dof,) array
        g: the deflection along the line of action is ``g . q``, positive if teeth are pressed together. In m/m for
        translations, m/rad for rotations.
    stiffness : Stiffness
        Mesh stiffness k in N/m as a function of mesh phase in cycles.
    error : TransmissionError or None
        Transmission error e in m as a function of mesh phase, subtracted from the deflection.
    backlash_m : float
        Half the backlash in m. 0: teeth stay in contact and the mesh is linear.
    cycles_per_rev : float
        Mesh cycles per revolution of the reference; phase is zero at zero angle of the reference.
    history : MeshHistory or None
        Change of the teeth in time, starting with `stiffness` and `error`.
    friction : tuple of FrictionForce
        Friction forces, proportional to the mesh force and perpendicular to it. Contact on the back flanks has none.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Mesh, Rectangular
    >>> stiffness = Rectangular.by_contact_ratio(pair_stiffness=2e8, contact_ratio=1.6)
    >>> mesh = Mesh(name="pinion-wheel", direction=np.array([0.03, -0.06]), stiffness=stiffness, cycles_per_rev=20)
    >>> mesh.stiffness([0.1, 0.9]).tolist()  # two pairs in contact, then one
    [400000000.0, 200000000.0]
    """

    name: str
    direction: Array = field(metadata={"dims": ("dof",), "units": "m/m or m/rad"})
    stiffness: Stiffness
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    cycles_per_rev: float = 1.0
    history: MeshHistory | None = None
    friction: tuple[FrictionForce, ...] = ()

    def in_coordinates(self, row: Callable[[Array], Array]) -> "Mesh":
        """Return the mesh in other coordinates; `row` transforms a generalised force (dof,) to them."""
        return replace(
            self,
            direction=row(self.direction),
            friction=tuple(replace(force, direction=row(force.direction)) for force in self.friction),
        )

    def teeth_at(self, phase_cycles: Array, times_s: Array) -> tuple[Array, Array]:
        """Return mesh stiffness in N/m and transmission error in m at phases and times.

        Parameters
        ----------
        phase_cycles : (n,) array
            Mesh phase in cycles.
        times_s : (n,) array
            Times in s, for teeth with a history.

        Returns
        -------
        stiffness, error : (n,) array
        """
        zero = np.zeros(np.shape(phase_cycles))
        if self.history is None:
            return self.stiffness(phase_cycles), zero if self.error is None else self.error(phase_cycles)
        position = self.history.position(times_s)
        weights = [np.maximum(1 - np.abs(position - number), 0) for number in range(len(self.history.times_s))]
        errors = [zero if error is None else error(phase_cycles) for error in self.history.errors]
        stiffness = sum((w * k(phase_cycles) for w, k in zip(weights, self.history.stiffnesses, strict=True)), zero)
        return stiffness, sum((w * e for w, e in zip(weights, errors, strict=True)), zero)


def errors_at(meshes: Sequence[Mesh], *, revolutions: float, time_s: float) -> Array:
    """Return the transmission error (mesh,) in m of each mesh at an angle of the reference in rev and a time in s."""
    at = np.array([time_s])
    return np.array([mesh.teeth_at(np.array([mesh.cycles_per_rev * revolutions]), at)[1][0] for mesh in meshes])


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A linear spring with a parallel damper: force ``-g (stiffness s + damping s')`` for a deflection s.

    Attributes
    ----------
    direction : (dof,) array
        g: the deflection s is ``g . q``.
    stiffness, damping : float
        N/m and N s/m, or N m/rad and N m s/rad where the deflection is an angle.

    Examples
    --------
    `System.springs` holds the springs of an assembled system:

    >>> from data_synth.dynamics import Body, Support, build_system
    >>> gear = Body(name="gear", mass_kg=2.0, motions=("x", "y"))
    >>> springs = build_system([gear], [Support(between=("gear", None), x=1e8, y=2e8)]).springs
    >>> [(spring.direction.tolist(), spring.stiffness) for spring in springs]
    [([1.0, 0.0], 100000000.0), ([0.0, 1.0], 200000000.0)]
    """

    direction: Array = field(metadata={"dims": ("dof",), "units": "m/m or m/rad"})
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True, kw_only=True)
class System:
    """Matrices and meshes of ``M q'' + (C + G) q' + K q + sum_m g_m k_m(phi_m) f(s_m) = F(t)``.

    The deflection of mesh m is ``s_m = g_m . q - e_m(phi_m)``.

    Attributes
    ----------
    mass, damping, stiffness : (dof, dof) arrays
        Constant parts without meshes, in kg, N s/m and N/m for translations and kg m2, N m s and N m for rotations.
    gyroscopic : (dof, dof) array or None
        Skew-symmetric part of the velocity terms at the speed of assembly.
    meshes : tuple of Mesh
        Gear meshes, whose stiffness depends on the mesh phase.
    names : tuple of str
        Degrees of freedom, each a body and a motion, such as "pinion x" or "pinion rotation".
    springs : tuple of Spring
        Springs whose sum is `stiffness`; empty if it has other terms.

    Examples
    --------
    One mass on a spring of 9 N/m, written as matrices:

    >>> import numpy as np
    >>> from data_synth.dynamics import System, solve_modes
    >>> one = np.eye(1)
    >>> system = System(mass=one, damping=0 * one, stiffness=9 * one, meshes=(), names=("mass x",))
    >>> solve_modes(system).angular.round(6).tolist()
    [3.0]
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
        """Number of degrees of freedom."""
        return len(self.names)

    def mean_stiffness(self) -> Array:
        """Return K (dof, dof) with every mesh in contact at its mean stiffness."""
        parts = (mesh.stiffness.mean * np.outer(mesh.direction, mesh.direction) for mesh in self.meshes)
        return np.asarray(sum(parts, self.stiffness))


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid axisymmetric body.

    Attributes
    ----------
    name : str
        Unique name.
    mass_kg : float
        Mass in kg; required if the body translates.
    inertia_kgm2 : float
        Moment of inertia about the axis in kg m2; required if the body rotates.
    tilt_inertia_kgm2 : float
        Moment of inertia about any diameter through the centre in kg m2; required if the body tilts.
    motions : tuple of str
        Degrees of freedom, any of "x", "y", "z" (along the directions of space), "rotation" (about the axis), "tilt x",
        "tilt y" (about two directions transverse to the axis: x and y for an axis along z).
    centre_m : vector of 3
        Centre in m.
    axis : vector of 3
        Direction of the axis, of any length.
    speed_ratio : float
        Speed about the axis relative to that of the reference, in the inertial frame; for gyroscopic terms only.
    frame_ratio : float
        Speed of the body's x and y coordinates about z relative to that of the reference: the carrier's speed ratio in
        a planetary stage. Mass times ``2 Omega`` then couples x and y, and ``-Omega^2`` times the mass is added to the
        stiffness (Lin and Parker 1999, eq. 1). Supports outside a rotating frame must be isotropic in x and y.
    rotates_with : str or None
        Another body to which this one is fixed in rotation; both share one degree of freedom "rotation".

    Raises
    ------
    ValueError
        If a motion is unknown or its mass or moment of inertia is not positive.

    Examples
    --------
    A solid steel disc of 0.1 m radius and 0.02 m width, free to translate in its plane and to rotate:

    >>> import math
    >>> from data_synth.dynamics import Body
    >>> mass = 7800 * math.pi * 0.1**2 * 0.02
    >>> wheel = Body(name="wheel", mass_kg=mass, inertia_kgm2=mass * 0.1**2 / 2, motions=("x", "y", "rotation"))
    >>> round(wheel.inertia("x"), 2), round(wheel.inertia("rotation"), 4)  # kg, and kg m2
    (4.9, 0.0245)
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
    rotates_with: str | None = None

    def __post_init__(self) -> None:
        for motion in self.motions:
            if motion not in SPACE:
                raise ValueError(f'body "{self.name}": the motion "{motion}" is not one of {", ".join(SPACE)}.')
            if not self.inertia(motion) > 0 and (motion != "rotation" or self.rotates_with is None):
                what = "mass_kg" if motion in _TRANSLATIONS else "inertia_kgm2"
                what = "tilt_inertia_kgm2" if motion.startswith("tilt") else what
                raise ValueError(
                    f'body "{self.name}": {what} = {self.inertia(motion)!r} must be positive to move along "{motion}"; '
                    "correct it, or leave the motion out."
                )

    def inertia(self, motion: str) -> float:
        """Return the mass in kg or moment of inertia in kg m2 for one of the motions."""
        if motion in _TRANSLATIONS:
            return self.mass_kg
        return self.inertia_kgm2 if motion == "rotation" else self.tilt_inertia_kgm2

    def rotation_axis(self, motion: str) -> Array:
        """Return the unit vector (3,) about which "rotation", "tilt x" or "tilt y" rotates the body."""
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
    """The vector q of all degrees of freedom, and displacements and rotations as rows g with ``g . q``.

    ``places`` lists body and motion of each entry of q, ``names`` its name; ``index`` maps (body, motion) to it.
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        names = [body.name for body in bodies]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f'two bodies are called "{min(twice)}"; give each a name of its own.')
        self.bodies = {body.name: body for body in bodies}
        self.places = [
            (body.name, motion)
            for body in bodies
            for motion in body.motions
            if motion != "rotation" or body.rotates_with is None
        ]
        self.index = {place: number for number, place in enumerate(self.places)}
        self.names = tuple(f"{name} {motion}" for name, motion in self.places)
        for body in bodies:
            if body.rotates_with is not None:
                self.index[body.name, "rotation"] = self.index[body.rotates_with, "rotation"]

    def body(self, name: str) -> Body:
        """Return a body by its name; raise ValueError if it is unknown."""
        if name not in self.bodies:
            raise ValueError(f'no body is called "{name}"; known: {", ".join(self.bodies)}.')
        return self.bodies[name]

    def displacement_row(
        self, one: str | None, other: str | None, point_m: Vector | Array, direction: Vector | Array
    ) -> Array:
        """Return the row g (dof,) of the displacement of a point P of one body relative to another along a direction d.

        ``g . q = d . (u + theta x (P - centre))`` of the first, less that of the second; None is the ground.
        """
        row, along = np.zeros(len(self.names)), np.asarray(direction, dtype=np.float64)
        for name, signed in ((one, along), (other, -along)):
            if name is not None:
                arm = np.asarray(point_m) - np.asarray(self.body(name).centre_m)
                self._add(row, name, signed, np.cross(arm, signed))
        return row

    def rotation_row(self, one: str | None, other: str | None, direction: Vector | Array) -> Array:
        """Return the row g (dof,) of the rotation of one body relative to another about a direction; None: ground."""
        row, about = np.zeros(len(self.names)), np.asarray(direction, dtype=np.float64)
        for name, signed in ((one, about), (other, -about)):
            if name is not None:
                self._add(row, name, np.zeros(3), signed)
        return row

    def _add(self, row: Array, name: str, force: Array, moment: Array) -> None:
        """Add to `row` the generalised force of a force and a moment on a body at its centre, (3,) each."""
        body = self.body(name)
        for motion in body.motions:
            rotates = motion not in _TRANSLATIONS
            share = body.rotation_axis(motion) @ moment if rotates else np.asarray(_TRANSLATIONS[motion]) @ force
            row[self.index[name, motion]] += share


class Element(Protocol):
    """A connection between bodies that adds springs and meshes to the system."""

    def terms(self, at: Coordinates) -> Iterator[Spring | Mesh]:
        """Yield its springs and meshes in the coordinates of the system."""


def build_system(bodies: Sequence[Body], elements: Iterable[Element], *, speed_rad_s: float = 0.0) -> System:
    """Assemble bodies and the elements that connect them into the equations of motion.

    Parameters
    ----------
    bodies : sequence of Body
        Rigid bodies, each with its own degrees of freedom.
    elements : iterable of Element
        Bearings, shafts, couplings and meshes; see `data_synth.dynamics.elements`.
    speed_rad_s : float
        Speed of the reference shaft in rad/s; a value other than 0 adds gyroscopic terms.

    Returns
    -------
    System

    Raises
    ------
    ValueError
        If two bodies have the same name, or an element names an unknown body or motion.

    Examples
    --------
    A torsional gear pair with base radii of 0.05 m and 0.1 m has ``omega^2 = k (r1^2 / J1 + r2^2 / J2)``:

    >>> from data_synth.dynamics import Body, Constant, GeneralMesh, build_system, solve_modes
    >>> pinion = Body(name="pinion", inertia_kgm2=0.005, motions=("rotation",))
    >>> wheel = Body(name="wheel", inertia_kgm2=0.02, motions=("rotation",))
    >>> row = {("pinion", "rotation"): 0.05, ("wheel", "rotation"): -0.1}
    >>> system = build_system([pinion, wheel], [GeneralMesh(name="m", motions=row, stiffness=Constant(mean=1e8))])
    >>> solve_modes(system).angular.round(4).tolist()
    [0.0, 10000.0]
    """
    coordinates = Coordinates(bodies)
    terms = [term for element in elements for term in element.terms(coordinates)]
    springs = tuple(term for term in terms if isinstance(term, Spring))
    mass = np.diag([coordinates.bodies[name].inertia(motion) for name, motion in coordinates.places])
    stiffness, damping = spring_matrices(springs, len(coordinates.names))
    gyroscopic, centripetal = _rotation_terms(coordinates, speed_rad_s)
    return System(
        mass=mass,
        damping=damping,
        stiffness=stiffness + centripetal,
        gyroscopic=gyroscopic if gyroscopic.any() else None,
        meshes=tuple(term for term in terms if isinstance(term, Mesh)),
        names=coordinates.names,
        springs=() if centripetal.any() else springs,
    )


def spring_matrices(springs: Sequence[Spring], size: int) -> tuple[Array, Array]:
    """Return the stiffness and damping matrices (size, size) of springs, sums of ``constant g g'``."""
    rows = np.array([spring.direction for spring in springs]).reshape(-1, size)
    constants = np.array([(spring.stiffness, spring.damping) for spring in springs]).reshape(-1, 2)
    stiffness, damping = (np.einsum("k,ki,kj->ij", each, rows, rows) for each in constants.T)
    return stiffness, damping


def _rotation_terms(coordinates: Coordinates, speed: float) -> tuple[Array, Array]:
    """Return the gyroscopic and the centripetal matrix.

    With z = x + jy in a frame rotating at Omega, the inertia force of a mass is ``m (z'' + 2j Omega z' - Omega^2 z)``,
    and the moment of a tilt t of a body spinning at w is ``I (t'' + 2j Omega t' - Omega^2 t) - j J w (t' + j Omega
    t)``. If the axis is not along z, as for a bevel planet, tilt terms ignore the rotation of the frame.
    """
    size = len(coordinates.names)
    gyroscopic, centripetal = np.zeros((size, size)), np.zeros((size, size))
    for body in coordinates.bodies.values():
        frame = body.frame_ratio * speed
        upright = np.hypot(body.axis[0], body.axis[1]) <= _ALONG_Z
        across = np.cross(body.rotation_axis("tilt x"), body.rotation_axis("tilt y")) @ body.rotation_axis("rotation")
        spin = across * body.inertia_kgm2 * body.speed_ratio * speed
        for pair, inertia, momentum in (
            (("x", "y"), body.mass_kg, 0.0),
            (("tilt x", "tilt y"), body.tilt_inertia_kgm2, spin),
        ):
            if frame and not upright and pair[0] != "x":
                continue
            numbers = [coordinates.index.get((body.name, motion)) for motion in pair]
            for number in (found for found in numbers if found is not None):
                centripetal[number, number] = frame * (momentum - inertia * frame)
            if None not in numbers:
                first, second = numbers
                gyroscopic[second, first] = 2 * inertia * frame - momentum
                gyroscopic[first, second] = -gyroscopic[second, first]
    return gyroscopic, centripetal
