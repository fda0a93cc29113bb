"""What joins the bodies of a gearbox: supports, shafts, couplings and meshes, each a few springs."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from data_synth.friction import SlidingFriction
from data_synth.mechanics import Array, Coordinates, FrictionForce, Mesh, Spring, Vector
from data_synth.mesh import Stiffness
from data_synth.transmission_error import TransmissionError

Place = tuple[str, str]  # a body and one of its motions
_SAME_GEARS = 1e-6


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """A spring between motions as they are: its deflection is the sum of ``factor x motion``.

    Attributes
    ----------
    motions : mapping of (body, motion) to factor
        As ``{("motor", "rotation"): 1.0, ("pinion", "rotation"): -1.0}``.
    stiffness, damping : float
        N/m and N s/m, or N m/rad and N m s where the deflection is an angle.
    """

    motions: Mapping[Place, float]
    stiffness: float
    damping: float = 0.0

    def terms(self, at: Coordinates) -> Iterator[Spring]:
        """Yield the spring."""
        yield Spring(direction=row_of(self.motions, at), stiffness=self.stiffness, damping=self.damping)


@dataclass(frozen=True, kw_only=True)
class GeneralMesh:
    """A mesh whose deflection is written down as the sum of ``factor x motion``; else as `GearMesh`."""

    name: str
    motions: Mapping[Place, float]
    stiffness: Stiffness
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    damping: float = 0.0
    cycles_per_rev: float = 1.0

    def terms(self, at: Coordinates) -> Iterator[Spring | Mesh]:
        """Yield the mesh, and the damper in it."""
        yield from _mesh_terms(self, row_of(self.motions, at))


@dataclass(frozen=True, kw_only=True)
class Support:
    """A bearing: it holds a point of one body to the same point of another, or to the ground.

    Attributes
    ----------
    between : pair of body names; None for the ground
    point_m : vector of 3 or None
        Where it stands; the first body's centre if left out.
    x, y, z : float
        Stiffness across the first body's axis and along it, N/m: along x, y and z of space where it is z.
    tilt_x, tilt_y, torsion : float
        Stiffness about the same directions, N m/rad.
    damping_s : float
        Damping over stiffness, in s, of every one of them.
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

    def terms(self, at: Coordinates) -> Iterator[Spring]:
        """Yield a spring for each direction that has a stiffness."""
        one, other = self.between
        body = at.body(one)
        point = self.point_m or body.centre_m
        x, y, z = (body.rotation_axis(motion) for motion in ("tilt x", "tilt y", "rotation"))
        for value, along in ((self.x, x), (self.y, y), (self.z, z)):
            yield from self._spring(
                value, at.displacement_row(one, point, along) - at.displacement_row(other, point, along)
            )
        for value, about in ((self.tilt_x, x), (self.tilt_y, y), (self.torsion, z)):
            yield from self._spring(value, at.rotation_row(one, about) - at.rotation_row(other, about))

    def _spring(self, value: float, row: Array) -> Iterator[Spring]:
        if value and row.any():
            yield Spring(direction=row, stiffness=value, damping=self.damping_s * value)


@dataclass(frozen=True, kw_only=True)
class Shaft:
    """A round shaft between the centres of two bodies on one axis: Timoshenko's beam, massless.

    Its six deformations are independent of each other, so they are six springs: stretch EA/L, twist GJ/L, and in each
    plane the symmetric bending EI/L of ``t2 - t1`` and the antisymmetric ``3 EI / (L (1 + Phi))`` of
    ``t1 + t2 - 2 (v2 - v1) / L``, with ``Phi = 12 EI / (kappa G A L^2)`` and Cowper's ``kappa = 6 (1 + nu) / (7 + 6
    nu)`` for a solid section, used for hollow ones as well. (Przemieniecki 1968, Theory of Matrix Structural Analysis,
    sec. 5.6; Cowper 1966, J. Appl. Mech. 33.)

    Attributes
    ----------
    between : pair of body names
    diameter_m, bore_m : float
    length_m : float or None
        Between the centres, along z, if left out. A shaft bends only where it is this distance.
    young_pa, poisson : float
    damping_s : float
        Damping over stiffness, in s.
    """

    between: tuple[str, str]
    diameter_m: float
    bore_m: float = 0.0
    length_m: float | None = None
    young_pa: float = 206e9
    poisson: float = 0.3
    damping_s: float = 0.0

    def terms(self, at: Coordinates) -> Iterator[Spring]:
        """Yield a spring for each deformation that the motions of the bodies allow."""
        one, other = (at.body(name) for name in self.between)
        span = np.asarray(other.centre_m) - np.asarray(one.centre_m)
        distance = float(np.linalg.norm(span))
        length = distance if self.length_m is None else self.length_m
        if not length > 0:
            raise ValueError(
                f"shaft {' - '.join(self.between)}: the centres of its bodies coincide; give length_m for its "
                "torsion, or centre_m for each body."
            )
        along = span / distance if distance else one.rotation_axis("rotation")
        for value, row in self._deformations(at, along, length, bends=math.isclose(distance, length)):
            if row.any():
                yield Spring(direction=row, stiffness=value, damping=self.damping_s * value)

    def _deformations(
        self, at: Coordinates, along: Array, length: float, *, bends: bool
    ) -> Iterator[tuple[float, Array]]:
        (a, b), young = self.between, self.young_pa
        shear = young / (2 * (1 + self.poisson))
        area = math.pi / 4 * (self.diameter_m**2 - self.bore_m**2)
        bending = young * math.pi / 64 * (self.diameter_m**4 - self.bore_m**4)
        yield 2 * bending / young * shear / length, at.rotation_row(b, along) - at.rotation_row(a, along)
        if not bends:
            return
        here, there = at.body(a).centre_m, at.body(b).centre_m
        yield young * area / length, at.displacement_row(b, there, along) - at.displacement_row(a, here, along)
        kappa = 6 * (1 + self.poisson) / (7 + 6 * self.poisson)
        softer = 1 + 12 * bending / (kappa * shear * area * length**2)
        for across in (at.body(a).rotation_axis("tilt x"), at.body(a).rotation_axis("tilt y")):
            about = np.cross(along, across)  # v' = t about this
            rise = (at.displacement_row(b, there, across) - at.displacement_row(a, here, across)) / length
            tilts = at.rotation_row(a, about), at.rotation_row(b, about)
            yield bending / length, tilts[1] - tilts[0]
            yield 3 * bending / (length * softer), tilts[0] + tilts[1] - 2 * rise


@dataclass(frozen=True, kw_only=True)
class GearMesh:
    """A mesh in space: a line of action through a point of contact.

    The deflection is ``n . (u_a(P) - u_b(P))``, how far gear a presses into gear b; `line_of_action` gives n and P for
    gears on parallel axes. With gear a's rotation ccw driving, ``n`` points from a to b.

    Attributes
    ----------
    name : str
    gears : pair of body names; None for a gear of the ground
    direction : vector of 3
        n. A unit vector, or for helical gears its transverse part one, so that `stiffness` belongs to the transverse
        deflection, as in ISO 6336-1.
    point_m : vector of 3
    stiffness, error, backlash_m, cycles_per_rev
        As in `Mesh`.
    damping : float
        N s/m along the line of action, of the displacements alone, in contact or not.
    friction : SlidingFriction or None
        Of the same geometry, gear a driving.
    """

    name: str
    gears: tuple[str | None, str | None]
    direction: Vector
    point_m: Vector
    stiffness: Stiffness
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    damping: float = 0.0
    cycles_per_rev: float = 1.0
    friction: SlidingFriction | None = None

    def terms(self, at: Coordinates) -> Iterator[Spring | Mesh]:
        """Yield the mesh, and the damper in it."""
        one, other = self.gears
        row = at.displacement_row(one, self.point_m, self.direction) - at.displacement_row(
            other, self.point_m, self.direction
        )
        yield from _mesh_terms(self, row, () if self.friction is None else self._friction_forces(at, self.friction))

    def _friction_forces(self, at: Coordinates, friction: SlidingFriction) -> tuple[FrictionForce, FrictionForce]:
        """Return the sideways force as if at the tangent point of gear a, and what each metre on from there adds."""
        if self.gears[0] is None:
            raise ValueError(f'mesh "{self.name}": friction needs a driver; name the driving gear first.')
        driver = at.body(self.gears[0])
        axis, along = driver.rotation_axis("rotation"), np.asarray(self.direction, dtype=np.float64)
        along = along - (along @ axis) * axis
        from_centre = np.asarray(self.point_m) - np.asarray(driver.centre_m)
        on_path, moment = from_centre @ along, axis @ np.cross(from_centre, along)
        radius = friction.gears.base_radii_m[0]
        if not math.isclose(abs(moment), radius, rel_tol=_SAME_GEARS):
            raise ValueError(
                f'mesh "{self.name}": its line of action passes "{driver.name}" at {abs(moment):.6g} m, but the first '
                f"gear of its friction has a base radius of {radius:.6g} m; give the same geometry to both."
            )
        across = as_vector(math.copysign(1.0, moment) * np.cross(axis, along))

        def slip(place: float) -> Array:
            point = np.asarray(self.point_m) + (place - on_path) * along
            return at.displacement_row(self.gears[0], point, across) - at.displacement_row(self.gears[1], point, across)

        sideways, lever = friction.shares
        return FrictionForce(direction=slip(0.0), factor=sideways), FrictionForce(
            direction=slip(1.0) - slip(0.0), factor=lever
        )


def line_of_action(
    *,
    centre_m: Vector,
    pitch_radius_m: float,
    towards_rad: float,
    pressure_angle_rad: float,
    flank: int = 1,
    base_helix_rad: float = 0.0,
    hand: str | None = None,
) -> tuple[Vector, Vector]:
    """Return direction and point of contact for gear a on an axis along z.

    With e from the centre of gear a to the pitch point and t = z x e the direction is
    ``flank cos(alpha) t + sin(alpha) e``: pressed flanks push gears apart, and an internal gear outwards. The helix
    adds ``-+ flank tan(beta_b)`` along z for a right- or left-handed gear a (thrust on a right-handed driver follows
    the thumb of the right hand whose fingers follow its turning).

    Parameters
    ----------
    centre_m : vector of 3
    pitch_radius_m : float
        Working pitch radius of gear a.
    towards_rad : float
        Direction from gear a to the pitch point, from x: towards gear b if b is external or a internal, else away.
    pressure_angle_rad : float
        Transverse working pressure angle.
    flank : 1 or -1
        1 where gear a drives ccw or is driven cw.
    base_helix_rad : float
    hand : {"left", "right"} or None
        Of gear a's helix.
    """
    away = np.array([math.cos(towards_rad), math.sin(towards_rad), 0.0])
    direction = pressing(
        along=np.array([0.0, 0.0, 1.0]),
        away=away,
        pressure_angle_rad=pressure_angle_rad,
        flank=flank,
        base_helix_rad=base_helix_rad,
        hand=hand,
    )
    point = np.asarray(centre_m) + pitch_radius_m * away
    return as_vector(direction), as_vector(point)


def pressing(
    *, along: Array, away: Array, pressure_angle_rad: float, flank: int, base_helix_rad: float, hand: str | None
) -> Array:
    """Return the direction in which gear a presses, (3,), as `line_of_action` has it.

    Parameters
    ----------
    along, away : (3,) arrays
        Unit vectors along the line where the pitch surfaces touch, and across it from gear a into gear b.
    pressure_angle_rad, base_helix_rad, hand
        As in `line_of_action`.
    flank : 1 or -1
        Of a turning about `along`.
    """
    sense = {"right": -1.0, "left": 1.0}.get(hand or "", 0.0)
    if base_helix_rad and not sense:
        raise ValueError(f'hand = {hand!r}: a mesh with a helix needs "left" or "right", of its first gear.')
    across = np.cross(along, away)
    direction = flank * math.cos(pressure_angle_rad) * across + math.sin(pressure_angle_rad) * away
    return np.asarray(direction + sense * flank * math.tan(base_helix_rad) * along)


def as_vector(values: Array) -> Vector:
    """Return three numbers as a tuple."""
    return float(values[0]), float(values[1]), float(values[2])


def row_of(motions: Mapping[Place, float], at: Coordinates) -> Array:
    """Return ``sum factor x motion`` as a row of the system, (dof,)."""
    row = np.zeros(len(at.names))
    for (name, motion), factor in motions.items():
        at.body(name)
        if (name, motion) not in at.index:
            raise ValueError(
                f'body "{name}" does not move along "{motion}"; it has {", ".join(at.body(name).motions)}.'
            )
        row[at.index[name, motion]] += factor
    return row


def _mesh_terms(
    element: GearMesh | GeneralMesh, row: Array, friction: tuple[FrictionForce, ...] = ()
) -> Iterator[Spring | Mesh]:
    yield Mesh(
        name=element.name,
        direction=row,
        stiffness=element.stiffness,
        error=element.error,
        backlash_m=element.backlash_m,
        cycles_per_rev=element.cycles_per_rev,
        friction=friction,
    )
    if element.damping:
        yield Spring(direction=row, stiffness=0.0, damping=element.damping)
