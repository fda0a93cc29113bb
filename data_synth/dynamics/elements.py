"""Elements that connect the bodies of a gearbox: supports, shafts, couplings and meshes, each a few springs."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from data_synth.dynamics.system import Array, Coordinates, FrictionForce, Mesh, Spring, Vector
from data_synth.gears.friction import SlidingFriction
from data_synth.gears.mesh_stiffness import Stiffness
from data_synth.gears.transmission_error import TransmissionError

Place = tuple[str, str]  # a body and one of its motions
_SAME_GEARS = 1e-6
_YOUNG_PA, _POISSON = 206e9, 0.3  # of steel


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """A spring and damper between degrees of freedom, with deflection ``sum factor x motion``.

    Attributes
    ----------
    motions : mapping of (body, motion) to factor
        For example ``{("motor", "rotation"): 1.0, ("pinion", "rotation"): -1.0}``.
    stiffness, damping : float
        N/m and N s/m, or N m/rad and N m s/rad where the deflection is an angle.

    Examples
    --------
    >>> from data_synth.dynamics import Body, Coupling, build_system
    >>> rotors = [Body(name=name, inertia_kgm2=0.1, motions=("rotation",)) for name in ("motor", "pinion")]
    >>> twist = {("motor", "rotation"): 1.0, ("pinion", "rotation"): -1.0}
    >>> build_system(rotors, [Coupling(motions=twist, stiffness=2000.0)]).stiffness.tolist()
    [[2000.0, -2000.0], [-2000.0, 2000.0]]
    """

    motions: Mapping[Place, float]
    stiffness: float
    damping: float = 0.0

    def terms(self, coordinates: Coordinates) -> Iterator[Spring]:
        """Yield the spring."""
        yield Spring(direction=row_of(self.motions, coordinates), stiffness=self.stiffness, damping=self.damping)


@dataclass(frozen=True, kw_only=True)
class _MeshElement:
    """What all meshes have, however their deflection is given."""

    name: str
    stiffness: Stiffness
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    damping: float = 0.0
    cycles_per_rev: float = 1.0

    def _mesh_and_damper(self, row: Array, friction: tuple[FrictionForce, ...] = ()) -> Iterator[Spring | Mesh]:
        """Yield the mesh with deflection row g, and its damper."""
        yield Mesh(
            name=self.name,
            direction=row,
            stiffness=self.stiffness,
            error=self.error,
            backlash_m=self.backlash_m,
            cycles_per_rev=self.cycles_per_rev,
            friction=friction,
        )
        if self.damping:
            yield Spring(direction=row, stiffness=0.0, damping=self.damping)


@dataclass(frozen=True, kw_only=True)
class GeneralMesh(_MeshElement):
    """A mesh whose deflection is given as ``sum factor x motion``, as in torsional models.

    Attributes
    ----------
    name : str
        Name of the mesh.
    motions : mapping of (body, motion) to factor
        Factors of the deflection along the line of action, in m/m or m/rad; for a torsional pair
        ``{("pinion", "rotation"): r_b1, ("wheel", "rotation"): -r_b2}``.
    stiffness, error, backlash_m, cycles_per_rev
        As in `data_synth.dynamics.system.Mesh`.
    damping : float
        N s/m along the line of action, whether or not the teeth are in contact.

    Examples
    --------
    >>> from data_synth.dynamics import Body, Constant, GeneralMesh, build_system
    >>> rotors = [Body(name=name, inertia_kgm2=0.1, motions=("rotation",)) for name in ("pinion", "wheel")]
    >>> row = {("pinion", "rotation"): 0.05, ("wheel", "rotation"): -0.1}
    >>> mesh = GeneralMesh(name="m", motions=row, stiffness=Constant(mean=1e8))
    >>> build_system(rotors, [mesh]).meshes[0].direction.tolist()
    [0.05, -0.1]
    """

    motions: Mapping[Place, float]

    def terms(self, coordinates: Coordinates) -> Iterator[Spring | Mesh]:
        """Yield the mesh and its damper."""
        yield from self._mesh_and_damper(row_of(self.motions, coordinates))


@dataclass(frozen=True, kw_only=True)
class Support:
    """A bearing: springs between a point of one body and the same point of another, or the ground.

    Attributes
    ----------
    between : pair of body names; None for the ground
        The two bodies.
    point_m : vector of 3 or None
        Position in m; the first body's centre if left out.
    x, y, z : float
        Stiffness in N/m along the first body's "tilt x" and "tilt y" directions and its axis: x, y and z if the axis
        is along z.
    tilt_x, tilt_y, torsion : float
        Stiffness about the same directions in N m/rad.
    damping_s : float
        Damping over stiffness in s, the same for all directions.

    Examples
    --------
    Two bearings at distances of a = 0.2 m from the centre have a tilt stiffness of ``2 k a^2``:

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, Support, build_system
    >>> shaft = Body(name="shaft", mass_kg=5.0, tilt_inertia_kgm2=0.1, motions=("x", "tilt y"))
    >>> bearings = [Support(between=("shaft", None), point_m=(0, 0, z), x=1e8) for z in (-0.2, 0.2)]
    >>> np.round(build_system([shaft], bearings).stiffness).tolist()
    [[200000000.0, 0.0], [0.0, 8000000.0]]
    """

    between: tuple[str, str | None]
    point_m: Vector | None = None
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    torsion: float = 0.0
    damping_s: float = 0.0

    def terms(self, coordinates: Coordinates) -> Iterator[Spring]:
        """Yield a spring for each direction with a stiffness."""
        body = coordinates.body(self.between[0])
        point = self.point_m or body.centre_m
        axes = [body.rotation_axis(motion) for motion in ("tilt x", "tilt y", "rotation")]
        rows = [coordinates.displacement_row(*self.between, point, along) for along in axes]
        rows += [coordinates.rotation_row(*self.between, about) for about in axes]
        values = (self.x, self.y, self.z, self.tilt_x, self.tilt_y, self.torsion)
        yield from _springs(zip(values, rows, strict=True), self.damping_s)


@dataclass(frozen=True, kw_only=True)
class Shaft:
    """A round steel shaft between the centres of two coaxial bodies: a massless Timoshenko beam.

    Its six deformations are independent and form six springs: axial EA/L, torsional GJ/L, and in each plane the
    symmetric bending EI/L of ``t2 - t1`` and the antisymmetric bending ``3 EI / (L (1 + Phi))`` of ``t1 + t2 - 2 (v2 -
    v1) / L``, with ``Phi = 12 EI / (kappa G A L^2)`` (Przemieniecki 1968, Theory of Matrix Structural Analysis, sec.
    5.6). Cowper's ``kappa = 6 (1 + nu) / (7 + 6 nu)`` for a solid section is used for hollow sections as well (Cowper
    1966, J. Appl. Mech. 33).

    Attributes
    ----------
    between : pair of body names
        The bodies at its ends.
    diameter_m, bore_m : float
        Outer and inner diameter in m.
    damping_s : float
        Damping over stiffness in s.

    Examples
    --------
    The torsional stiffness is ``G pi d^4 / (32 L)``:

    >>> import math
    >>> from data_synth.dynamics import Body, Shaft, build_system
    >>> turning = {"inertia_kgm2": 0.1, "motions": ("rotation",)}
    >>> rotors = [Body(name="motor", **turning), Body(name="pinion", centre_m=(0, 0, 0.4), **turning)]
    >>> stiffness = build_system(rotors, [Shaft(between=("motor", "pinion"), diameter_m=0.05)]).stiffness[0, 0]
    >>> math.isclose(stiffness, 206e9 / 2.6 * math.pi * 0.05**4 / (32 * 0.4))
    True
    """

    between: tuple[str, str]
    diameter_m: float
    bore_m: float = 0.0
    damping_s: float = 0.0

    def terms(self, coordinates: Coordinates) -> Iterator[Spring]:
        """Yield a spring for each deformation the bodies' motions allow; raise ValueError if the length is zero."""
        (a, b), bodies = self.between, [coordinates.body(name) for name in self.between]
        here, there = (np.asarray(body.centre_m) for body in bodies)
        length = float(np.linalg.norm(there - here))
        if not length > 0:
            raise ValueError(f"shaft {a} - {b}: the centres of its bodies coincide; give centre_m of each body.")

        def stretch(direction: Array) -> Array:
            return coordinates.displacement_row(b, None, there, direction) - coordinates.displacement_row(
                a, None, here, direction
            )

        tension, shear, bending, torsion = _section(self.diameter_m, self.bore_m)
        along, shear_factor = (there - here) / length, 1 + 12 * bending / (shear * length**2)
        found = [(torsion / length, coordinates.rotation_row(b, a, along)), (tension / length, stretch(along))]
        for across in (bodies[0].rotation_axis("tilt x"), bodies[0].rotation_axis("tilt y")):
            about = np.cross(along, across)  # v' = t about this
            tilts = coordinates.rotation_row(a, None, about), coordinates.rotation_row(b, None, about)
            found.append((bending / length, tilts[1] - tilts[0]))
            found.append((3 * bending / (length * shear_factor), tilts[0] + tilts[1] - 2 * stretch(across) / length))
        yield from _springs(found, self.damping_s)


def _springs(deformations: Iterable[tuple[float, Array]], damping_s: float) -> Iterator[Spring]:
    """Yield a spring for each stiffness and deflection row that are not zero."""
    for value, row in deformations:
        if value and row.any():
            yield Spring(direction=row, stiffness=value, damping=damping_s * value)


def _section(diameter_m: float, bore_m: float) -> tuple[float, float, float, float]:
    """Return EA in N, kappa G A in N, EI in N m2 and GJ in N m2 of a round steel section."""
    area = math.pi / 4 * (diameter_m**2 - bore_m**2)
    second_moment = math.pi / 64 * (diameter_m**4 - bore_m**4)
    shear_pa = _YOUNG_PA / (2 * (1 + _POISSON))
    kappa = 6 * (1 + _POISSON) / (7 + 6 * _POISSON)
    return _YOUNG_PA * area, kappa * shear_pa * area, _YOUNG_PA * second_moment, 2 * shear_pa * second_moment


@dataclass(frozen=True, kw_only=True)
class BearingShaft:
    """A round steel shaft between two bearings that carries a body: a massless, simply supported Timoshenko beam.

    Attributes
    ----------
    diameter_m, bore_m : float
        Outer and inner diameter in m.
    to_bearings_m : pair of float
        Distances in m from the centre of the body to the bearings before and behind it along its axis.

    Examples
    --------
    A slender shaft with the body midway between stiff bearings has the stiffness of the Jeffcott rotor, ``48 EI /
    L^3``:

    >>> import math
    >>> from data_synth.dynamics import BearingShaft
    >>> shaft = BearingShaft(diameter_m=0.01, to_bearings_m=(0.5, 0.5))
    >>> radial, tilt, ahead_m = shaft.on_bearings(1e15)
    >>> math.isclose(radial, 48 * 206e9 * math.pi * 0.01**4 / 64, rel_tol=1e-3), abs(ahead_m) < 1e-12
    (True, True)
    """

    diameter_m: float
    bore_m: float = 0.0
    to_bearings_m: tuple[float, float]

    def on_bearings(self, radial: float) -> tuple[float, float, float]:
        """Return the equivalent support of the body in either plane, for bearings of `radial` N/m each.

        Values are the radial stiffness in N/m, the tilt stiffness in N m/rad, and the distance in m of the radial
        spring ahead of the centre. The compliance under a force and a moment is that of a simply supported beam (Roark
        2012, Formulas for Stress and Strain, table 8.1) with shear, plus that of the bearings.
        """
        (a, b), length = self.to_bearings_m, sum(self.to_bearings_m)
        _, shear, bending, _ = _section(self.diameter_m, self.bore_m)
        slant = np.array([[b, a], [-1.0, 1.0]]) / length  # displacement and tilt of the body per bearing displacement
        bent = np.array([[a * a * b * b, a * b * (b - a)], [a * b * (b - a), a * a - a * b + b * b]])
        compliance = bent / (3 * bending * length) + np.diag([a * b, 1.0]) / (shear * length) + slant @ slant.T / radial
        tilting = float(compliance[1, 1])
        return tilting / float(np.linalg.det(compliance)), 1 / tilting, -float(compliance[0, 1]) / tilting


@dataclass(frozen=True, kw_only=True)
class GearMesh(_MeshElement):
    """A mesh in space, with a line of action through a contact point.

    The deflection ``n . (u_a(P) - u_b(P))`` is the approach of the flanks. With gear a driving counter-clockwise, ``n``
    points from a to b.

    Attributes
    ----------
    name : str
        Name of the mesh.
    gears : pair of body names; None for a gear fixed to the ground
        Gears a and b.
    direction : vector of 3
        n: a unit vector; for helical gears its transverse part has unit length, so that `stiffness` refers to the
        transverse deflection, as in ISO 6336-1.
    point_m : vector of 3
        P in m.
    stiffness, error, backlash_m, cycles_per_rev
        As in `data_synth.dynamics.system.Mesh`.
    damping : float
        N s/m along the line of action, acting on displacements only, whether or not the teeth are in contact.
    friction : SlidingFriction or None
        Sliding friction for the same geometry, with gear a driving.

    Examples
    --------
    A rotation theta causes a deflection ``r_b theta`` along the line of action:

    >>> import math
    >>> from data_synth.dynamics import Body, Constant, GearMesh, build_system
    >>> n, point = (math.sin(math.radians(20)), math.cos(math.radians(20)), 0.0), (0.1, 0.0, 0.0)
    >>> gear = Body(name="gear", mass_kg=1.0, inertia_kgm2=0.01, motions=("x", "y", "rotation"))
    >>> mesh = GearMesh(name="m", gears=("gear", None), direction=n, point_m=point, stiffness=Constant(mean=1e8))
    >>> build_system([gear], [mesh]).meshes[0].direction.round(6).tolist()  # sin 20, cos 20, r_b
    [0.34202, 0.939693, 0.093969]
    """

    gears: tuple[str | None, str | None]
    direction: Vector
    point_m: Vector
    friction: SlidingFriction | None = None

    def terms(self, coordinates: Coordinates) -> Iterator[Spring | Mesh]:
        """Yield the mesh and its damper."""
        row = coordinates.displacement_row(*self.gears, self.point_m, self.direction)
        friction = () if self.friction is None else self._friction_forces(coordinates, self.friction)
        yield from self._mesh_and_damper(row, friction)

    def _friction_forces(
        self, coordinates: Coordinates, friction: SlidingFriction
    ) -> tuple[FrictionForce, FrictionForce]:
        """Return the friction force at the tangent point of gear a, and its moment per metre from that point."""
        if self.gears[0] is None:
            raise ValueError(f'mesh "{self.name}": friction needs a moving driver; name the driving gear first.')
        driver = coordinates.body(self.gears[0])
        axis, along = driver.rotation_axis("rotation"), np.asarray(self.direction, dtype=np.float64)
        along = along - (along @ axis) * axis
        from_centre = np.asarray(self.point_m) - np.asarray(driver.centre_m)
        on_path, moment = from_centre @ along, axis @ np.cross(from_centre, along)
        radius = friction.gears.base_radii_m[0]
        if not math.isclose(abs(moment), radius, rel_tol=_SAME_GEARS):
            raise ValueError(
                f'mesh "{self.name}": its line of action passes "{driver.name}" at {abs(moment):.6g} m, but '
                f"the first gear of its friction has a base radius of {radius:.6g} m; use the same geometry for both."
            )
        across = as_vector(math.copysign(1.0, moment) * np.cross(axis, along))

        def sliding(distance_m: float) -> Array:
            point = np.asarray(self.point_m) + (distance_m - on_path) * along
            return coordinates.displacement_row(*self.gears, point, across)

        sideways, lever = friction.shares
        return FrictionForce(direction=sliding(0.0), factor=sideways), FrictionForce(
            direction=sliding(1.0) - sliding(0.0), factor=lever
        )


def line_of_action_direction(
    *, along: Array, away: Array, pressure_angle_rad: float, flank: int, base_helix_rad: float, hand: str | None
) -> Array:
    """Return the direction (3,) of the force of gear a on gear b.

    With z the direction `along`, e the direction `away` and t = z x e, it is ``flank cos(alpha) t + sin(alpha) e``:
    flanks in contact push external gears apart and an internal gear outwards. The helix adds ``-+ flank tan(beta_b)``
    along z for a right- or left-handed gear a (the thrust on a right-handed driver obeys the right-hand rule).

    Parameters
    ----------
    along, away : (3,) arrays
        Unit vectors along the line of contact of the pitch surfaces, and across it from gear a into gear b.
    pressure_angle_rad, base_helix_rad : float
        Transverse working pressure angle and base helix angle in rad.
    flank : 1 or -1
        1 where gear a drives with a positive rotation about `along`.
    hand : {"left", "right"} or None
        Hand of gear a's helix; required if `base_helix_rad` is not zero.

    Raises
    ------
    ValueError
        If a helix has no hand.

    Examples
    --------
    >>> import math, numpy as np
    >>> from data_synth.dynamics.elements import line_of_action_direction
    >>> along, away = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    >>> line_of_action_direction(
    ...     along=along, away=away, pressure_angle_rad=math.radians(20), flank=1, base_helix_rad=0.0, hand=None
    ... ).round(3).tolist()
    [0.342, 0.94, 0.0]
    """
    sense = {"right": -1.0, "left": 1.0}.get(hand or "", 0.0)
    if base_helix_rad and not sense:
        raise ValueError(f'hand = {hand!r}: a helical mesh needs "left" or "right", the hand of its first gear.')
    across = np.cross(along, away)
    direction = flank * math.cos(pressure_angle_rad) * across + math.sin(pressure_angle_rad) * away
    return np.asarray(direction + sense * flank * math.tan(base_helix_rad) * along)


def as_vector(values: Array) -> Vector:
    """Return three numbers as a tuple."""
    return float(values[0]), float(values[1]), float(values[2])


def row_of(motions: Mapping[Place, float], coordinates: Coordinates) -> Array:
    """Return ``sum factor x motion`` as a row of the degrees of freedom, (dof,)."""
    row = np.zeros(len(coordinates.names))
    for (name, motion), factor in motions.items():
        coordinates.body(name)
        if (name, motion) not in coordinates.index:
            raise ValueError(
                f'body "{name}" does not have the motion "{motion}"; its motions are '
                f"{', '.join(coordinates.body(name).motions)}."
            )
        row[coordinates.index[name, motion]] += factor
    return row
