"""From a declared gearbox to its equations of motion.

Teeth, axes and geometry come from `hums.gearbox.model.Gearbox`. Masses and stiffnesses that are not given have the
following defaults, for steel, which are first estimates only:

- A gear is a solid disc with the radius of its reference circle (for a bevel gear that at mid-face) and its face width,
  an internal gear a rim 4 modules thick outside that circle, a carrier a solid disc through the centres of its planets,
  as wide as they are. Everything on one link forms one body.
- A link has supports of 1e8 N/m radially and axially and 1e5 N m/rad in tilt, one for each bearing of the gearbox that
  names it, or else one at its centre: the order of magnitude in Chaari's gear pair and the planetary set of Lin and
  Parker (1999). Its rotation is free.
- Bearings connect links to a rigid frame.
- The coordinates of each body rotate with the carrier of its meshes, as in Lin and Parker (1999). A link with gears on
  several carriers has one piece for each; the pieces share their rotation only, like shafts joined by a toothed
  coupling.
- A mesh has the constant mean stiffness of ISO 6336-1, a bevel mesh that of its virtual spur gears.

Bevel gears are in contact at mid-face, on the line of contact of their pitch cones; since their axes intersect, their
bodies need motions in space.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.elements import GearMesh, Support, as_vector
from data_synth.dynamics.parts import Inertia, MeshProperties, Parts, SupportStiffness, mesh_elements
from data_synth.dynamics.placement import Contact, are_parallel, axis_points, contacts_of, crossed_bodies
from data_synth.dynamics.system import (
    PLANE,
    SPACE,
    TORSION,
    Array,
    Body,
    Coordinates,
    Spring,
    System,
    Vector,
    build_system,
    spring_matrices,
)
from hums.gearbox.components import Bearing, closest
from hums.gearbox.kinematics import Kinematics, solve_kinematics
from hums.gearbox.model import Gearbox

# ---- Bodies and supports of a declared gearbox, with defaults for undeclared values ----------------------------------


_STEEL_KG_M3 = 7850.0
_RIM_MODULES = 4.0
_MM = 1e-3


def bodies(parts: Parts) -> Iterator[Body]:
    """Yield every moving body with its given inertia or that of steel discs; pieces of one body follow each other."""
    reference_speed = parts.reference_speed()
    for name in [*parts.kinematics.joints, *parts.elastic_links]:
        given = parts.inertias.get(name, Inertia())
        whole = _discs(parts, name)
        polar = whole[1] if given.inertia_kgm2 is None else given.inertia_kgm2
        if parts.torsion:
            polar += _carried(parts, name)
        if not polar > 0:
            raise ValueError(
                f'"{name}" has no gear and carries none, so it has no default inertia; give '
                f'inertias={{"{name}": Inertia(...)}}.'
            )
        frames = parts.frames(name)
        for frame in frames:
            share = _share(parts, name, frame)
            mass, tilt = whole[0] * share, whole[2] * share
            yield Body(
                name=parts.piece(name, frame),
                mass_kg=mass if given.mass_kg is None else given.mass_kg * share,
                inertia_kgm2=polar * share if len(frames) > 1 and frame != frames[0] else polar,
                tilt_inertia_kgm2=tilt if given.tilt_inertia_kgm2 is None else given.tilt_inertia_kgm2 * share,
                motions=parts.motions,
                centre_m=parts.centre(name, frame if len(frames) > 1 else None),
                axis=parts.axis(name),
                speed_ratio=0.0 if parts.torsion else _speed_ratio(parts, name, reference_speed),
                frame_ratio=parts.frame_ratio(frame),
                rotates_with=name if frame != frames[0] else None,
            )


def _speed_ratio(parts: Parts, name: str, reference_speed: Fraction) -> float:
    """Return the speed of a body about its axis relative to the frame, or for a tilted planet axis to the carrier."""
    joints = parts.kinematics.joints
    holder = joints[name].carried_by if name in joints else parts.frame
    if holder == parts.frame or are_parallel(np.array(parts.axis(name)), np.array(parts.axis(holder))):
        return float(parts.relative_speed(name, parts.frame) / reference_speed)
    return float(parts.relative_speed(name, holder) / reference_speed)


def _share(parts: Parts, body: str, frame: str) -> float:
    """Return the fraction of a body's mass in its piece in a frame: that of the discs there."""
    frames = parts.frames(body)
    if len(frames) == 1:
        return 1.0
    masses = [_discs(parts, body, each)[0] for each in frames]
    return masses[frames.index(frame)] / sum(masses) if all(masses) else 1 / len(frames)


def _discs(parts: Parts, body: str, frame: str | None = None) -> tuple[float, float, float]:
    """Return mass, polar and transverse moment of a body or its piece: each of its gears and its disc as a carrier."""
    discs: dict[tuple[float, float], tuple[float, float, float]] = {}
    for contact, number in parts.gears(body, frame):
        radius, width = contact.pair.reference_radii_m[number], contact.pair.face_width_m
        internal = number == 1 and contact.pair.teeth[1] < 0
        outer = radius + _RIM_MODULES * contact.pair.module_m if internal else radius
        discs[radius, width] = _disc(outer, radius if internal else 0.0, width)
    if frame in (None, body):
        for contact in parts.contacts:
            planet = _planet_of(parts, contact, body)
            if planet is not None:
                discs[0.0, 0.0] = _disc(_planet_radius(parts, contact, planet), 0.0, contact.pair.face_width_m)
    mass, polar, tilt = np.array([*discs.values(), (0.0, 0.0, 0.0)]).sum(axis=0).tolist()
    return mass, polar, tilt


def _disc(outer: float, inner: float, width: float) -> tuple[float, float, float]:
    mass = _STEEL_KG_M3 * math.pi * (outer**2 - inner**2) * width
    polar = mass * (outer**2 + inner**2) / 2
    return mass, polar, polar / 2 + mass * width**2 / 12


def _planet_of(parts: Parts, contact: Contact, carrier: str) -> str | None:
    """Return the body of a contact that is a planet of a carrier, or None."""
    joints = parts.kinematics.joints
    held = [body for body in map(parts.body, contact.links) if body in joints and joints[body].carried_by == carrier]
    return held[0] if held and carrier != parts.frame else None


def _planet_radius(parts: Parts, contact: Contact, planet: str) -> float:
    """Return the distance of a planet's centre from its carrier's axis; for a bevel planet the radius of its mate."""
    mate = 1 - [parts.body(link) for link in contact.links].index(planet)
    return contact.pair.centre_distance_m if contact.parallel else contact.pair.reference_radii_m[mate]


def _carried(parts: Parts, carrier: str) -> float:
    """Return the inertia of a carrier's planets about its axis, which is added to the carrier in torsion."""
    planets: dict[str, float] = {}
    for contact in parts.contacts:
        planet = _planet_of(parts, contact, carrier)
        if planet is not None and contact.carrier == carrier and planet not in planets:
            mass, _, tilt = _discs(parts, planet)
            given = parts.inertias.get(planet, Inertia())
            mass = mass if given.mass_kg is None else given.mass_kg
            # a bevel planet's axis is transverse to the carrier's, so the whole planet rotates with the carrier
            radius = _planet_radius(parts, contact, planet)
            planets[planet] = mass * radius**2 + (0.0 if contact.parallel else tilt)
    return sum(planets.values())


# ---- supports ----------------------------------------------------------------------------------------------


def supports_of(parts: Parts) -> Iterator[Support]:
    """Yield the supports between each body and its carrier: its bearings, or one support at its centre.

    Each further piece of a body has its own support.
    """
    joints = parts.kinematics.joints
    for body in [*joints, *parts.elastic_links]:
        holder = joints[body].carried_by if body in joints else parts.frame
        first, *others = parts.frames(body)
        own = parts.piece(body, holder) if holder != parts.frame else body
        between = (own, None if holder == parts.frame else parts.piece(holder, holder))
        if parts.torsion:  # torsion has no other degree of freedom
            hold = parts.supports.get(body, SupportStiffness())
            yield Support(between=between, torsion=hold.torsion, damping_s=hold.damping_s)
            continue
        bearings = [] if body in parts.supports else list(_bearings_of(parts, body, holder))
        centre = parts.centre(body, first if others else None)
        if not bearings:
            hold = parts.supports.get(body, SupportStiffness())
            if hold.shaft is not None:
                radial, tilt, ahead_m = hold.shaft.on_bearings(hold.radial)
                centre = as_vector(np.array(centre) + ahead_m * np.array(parts.axis(body)))
                hold = replace(hold, radial=radial, tilt=tilt)
            yield _support(between, centre, hold, axial=True, tilt=True)
        apart = len({place for _, place, _ in bearings}) > 1
        for name, place, axial in bearings:
            hold = parts.supports.get(name, SupportStiffness())
            yield _support(between, place, hold, axial=axial, tilt=not apart)
        for frame in others:
            piece = parts.piece(body, frame)
            hold = replace(parts.supports.get(body, SupportStiffness()), torsion=0.0)
            yield _support((piece, None), parts.centre(body, frame), hold, axial=True, tilt=True)


def _support(
    between: tuple[str, str | None], point: Vector, hold: SupportStiffness, *, axial: bool, tilt: bool
) -> Support:
    return Support(
        between=between,
        point_m=point,
        x=hold.radial,
        y=hold.radial,
        z=hold.axial if axial else 0.0,
        tilt_x=hold.tilt if tilt else 0.0,
        tilt_y=hold.tilt if tilt else 0.0,
        torsion=hold.torsion,
        damping_s=hold.damping_s,
    )


def _bearings_of(parts: Parts, body: str, holder: str) -> Iterator[tuple[str, Vector, bool]]:
    """Yield name, position and axial fixity of the bearings between a body and its carrier."""
    gearbox = parts.kinematics.gearbox

    def rings(bearing: Bearing) -> set[str]:
        links = (bearing.inner_ring, bearing.outer_ring)
        return {parts.kinematics.bodies[link] for ring in links for link in gearbox.instances(ring)}

    mine = [bearing for bearing in gearbox.bearings if {body, holder} <= rings(bearing)]
    any_axial = any(bearing.takes_axial for bearing in mine)
    for bearing in mine:
        for number, name in enumerate(bearing.names):
            place = parts.centre(body)
            if bearing.position_mm:
                along = _MM * bearing.position_mm[number] * np.array(parts.axis(body))
                place = as_vector(parts.axis_point(body, body) + along)
            yield name, place, name in bearing.takes_axial or not any_axial


# ---- Assembly --------------------------------------------------------------------------------------------------------


MOTIONS = {"torsion": TORSION, "plane": PLANE, "space": SPACE}
Motions = Literal["torsion", "plane", "space"]


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """The equations of motion of a gearbox with the bodies and springs they were assembled from.

    Attributes
    ----------
    system : System
        Equations of motion.
    parts : Parts
        Inputs and geometry.
    bodies : tuple of Body
        Bodies in the order of the degrees of freedom.
    springs, grounded : tuple of Spring
        All springs, and those from a body to the frame.
    on_frame : mapping of contact to vector
        Direction of the mesh force on each gear fixed to the frame.

    Examples
    --------
    >>> import hums
    >>> from data_synth.dynamics import assemble
    >>> assembly = assemble(hums.load_gearbox("wijianto-pair"), motions="plane")
    >>> assembly.system.names[:3], len(assembly.grounded)  # a spring along x and one along y for each of two shafts
    (('pinion x', 'pinion y', 'pinion rotation'), 4)
    """

    system: System
    parts: Parts
    bodies: tuple[Body, ...]
    springs: tuple[Spring, ...] = field(repr=False)
    grounded: tuple[Spring, ...] = field(repr=False)
    on_frame: Mapping[str, Vector]

    @property
    def coordinates(self) -> Coordinates:
        """The degrees of freedom of the system."""
        return Coordinates(self.bodies)


def assemble(
    gearbox: Gearbox | Kinematics,
    *,
    motions: Motions,
    inertias: Mapping[str, Inertia] | None = None,
    supports: Mapping[str, SupportStiffness] | None = None,
    meshes: Mapping[str, MeshProperties] | None = None,
    speeds: Mapping[str, float] | None = None,
    speed_rad_s: float = 0.0,
) -> Assembly:
    """Return the equations of motion of a declared gearbox.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
        Teeth, axes, modules, face widths and pressure angles.
    motions : {"torsion", "plane", "space"}
        Degrees of freedom of each body: rotation only; also x and y, transverse to all axes; also axial motion and
        tilt. Axes that are not parallel need torsion or space. In torsion, planets do not move relative to the carrier
        except to rotate, and their mass is added to the carrier.
    inertias : mapping of link to Inertia, optional
        Masses and moments of inertia that replace the defaults.
    supports : mapping of link or bearing to SupportStiffness, optional
        Support stiffnesses that replace the defaults. A link of the frame that is named here or in `inertias` becomes
        a body of its own, such as a ring in an elastic housing.
    meshes : mapping of mesh, or of one contact, to MeshProperties, optional
        Mesh stiffness, transmission error, backlash, damping and friction.
    speeds : mapping of link to speed, optional
        As for `Kinematics.rates`; the reference at unit speed if left out. They determine which flanks are in contact
        and the mesh cycles per revolution of the reference.
    speed_rad_s : float
        Speed of the reference in rad/s; a value other than 0 adds gyroscopic terms.

    Returns
    -------
    Assembly
        Its meshes are named after the contacts, such as ``sun-planet 1``, and have the phase differences of their
        planets (``gamma = Z psi / 2 pi`` cycles, Z the central gear's signed number of teeth; Parker and Lin 2004, J.
        Mech. Des. 126).

    Raises
    ------
    ValueError
        If a name is not in the gearbox, geometry is missing, or the axes do not allow these motions.

    Examples
    --------
    A torsional gear pair with base radii r1 and r2 has ``omega^2 = k (r1^2 / J1 + r2^2 / J2)``:

    >>> import math
    >>> from data_synth.dynamics import Constant, Inertia, MeshProperties, assemble, solve_modes
    >>> from hums.gearbox.model import Gearbox
    >>> axes = {name: {"direction": [1, 0, 0], "links": ["housing", name]} for name in ("pinion", "wheel")}
    >>> mesh = {"teeth": {"pinion": 20, "wheel": 40}, "module_mm": 4, "face_width_mm": 30, "pressure_angle_deg": 20}
    >>> table = {"name": "pair", "frame": "housing", "reference": "pinion", "axes": axes, "mesh": [mesh]}
    >>> gearbox = Gearbox.from_mapping(table)
    >>> system = assemble(
    ...     gearbox,
    ...     motions="torsion",
    ...     inertias={"pinion": Inertia(inertia_kgm2=0.01), "wheel": Inertia(inertia_kgm2=0.04)},
    ...     meshes={"pinion-wheel": MeshProperties(stiffness=Constant(mean=2e8))},
    ... ).system
    >>> r1, r2 = 0.04 * math.cos(math.radians(20)), 0.08 * math.cos(math.radians(20))
    >>> math.isclose(solve_modes(system).angular[1], math.sqrt(2e8 * (r1**2 / 0.01 + r2**2 / 0.04)))
    True
    """
    kinematics = gearbox if isinstance(gearbox, Kinematics) else solve_kinematics(gearbox)
    if motions not in MOTIONS:
        raise ValueError(f'motions = "{motions}" is not one of {", ".join(MOTIONS)}.')
    given = dict(meshes or {})
    contacts = contacts_of(kinematics)
    _refuse_unknown(
        kinematics,
        links={"inertias": list(inertias or {}), "supports": list(supports or {})},
        meshes=list(given),
        contacts=[contact.name for contact in contacts],
    )
    if motions == "plane" and (crossed := crossed_bodies(kinematics)) is not None:
        raise ValueError(
            f'motions = "plane" needs parallel axes, but those of "{crossed[0]}" and "{crossed[1]}" are not; use '
            '"torsion" or "space".'
        )
    frame = kinematics.mechanism.frame
    named = dict.fromkeys([*(inertias or {}), *(supports or {})])
    parts = Parts(
        kinematics=kinematics,
        contacts=contacts,
        motions=MOTIONS[motions],
        inertias=inertias or {},
        supports=supports or {},
        meshes=given,
        elastic_links=tuple(link for link in named if kinematics.bodies.get(link) == frame),
        axis_points=axis_points(kinematics, contacts) if motions != "torsion" else {},
        speeds=speeds,
    )
    _refuse_nested(parts)
    every, holds, teeth = [*bodies(parts)], [*supports_of(parts)], [*mesh_elements(parts)]
    coordinates, elements = Coordinates(every), [*holds, *teeth]
    return Assembly(
        system=build_system(every, elements, speed_rad_s=speed_rad_s),
        parts=parts,
        bodies=tuple(every),
        springs=tuple(term for element in elements for term in element.terms(coordinates) if isinstance(term, Spring)),
        grounded=tuple(spring for hold in holds if hold.between[1] is None for spring in hold.terms(coordinates)),
        on_frame={
            mesh.name: _force_direction(mesh) for mesh in teeth if isinstance(mesh, GearMesh) and None in mesh.gears
        },
    )


def _force_direction(mesh: GearMesh) -> Vector:
    """Return the direction of the mesh force on the gear fixed to the frame."""
    x, y, z = mesh.direction
    return (-x, -y, -z) if mesh.gears[0] is None else (x, y, z)


def _refuse_unknown(
    kinematics: Kinematics,
    *,
    links: Mapping[str, Sequence[str]],
    meshes: Sequence[str],
    contacts: Sequence[str],
) -> None:
    """Raise ValueError for a name not in the gearbox, or a link that is part of a body of another name."""
    gearbox = kinematics.gearbox
    bearings = [name for bearing in gearbox.bearings for name in bearing.names]
    for word, names in links.items():
        known = {*kinematics.links, *(bearings if word == "supports" else ())}
        for name in names:
            if name not in known:
                raise ValueError(f'{word} names "{name}", which is not in the gearbox{closest(name, sorted(known))}')
            body = kinematics.bodies.get(name, name)
            if body not in (name, kinematics.mechanism.frame):
                raise ValueError(f'{word} names "{name}", which is part of the body "{body}"; write "{body}".')
    known = {*(mesh.name for mesh in gearbox.meshes), *contacts}
    for name in meshes:
        if name not in known:
            raise ValueError(f'meshes names "{name}", which is not in the gearbox{closest(name, sorted(known))}')


def _refuse_nested(parts: Parts) -> None:
    """Raise ValueError if a carrier is carried itself, or does not rotate about z."""
    for body in parts.kinematics.joints:
        for carrier in parts.frames(body):
            if carrier == parts.frame:
                continue
            if parts.kinematics.joints[carrier].carried_by != parts.frame:
                raise ValueError(
                    f'"{carrier}" carries planets and is carried itself, which only a kinematic scene or motions = '
                    '"torsion" can model; use one of these.'
                )
            if not are_parallel(np.array(parts.axis(carrier)), np.array([0.0, 0.0, 1.0])):
                raise ValueError(
                    f'"{carrier}" carries planets about an axis that is not parallel to that of another carrier, which '
                    'only a kinematic scene or motions = "torsion" can model; use one of these.'
                )


# ---- Degrees of freedom that teeth and torques excite; the others stay at rest and can be left out exactly ----------


_ROUNDING = 1e-12


def excited_dofs_of(whole: Assembly) -> tuple[System, NDArray[np.int_]]:
    """Return the equations of motion of the degrees of freedom that are excited, and their numbers among all, (k,).

    They are those coupled to a rotation about an axis or to the deflection of a mesh. Gyroscopic terms are included;
    the centripetal stiffness of a rotating frame, of relative size ``(Omega / omega)^2``, is left out because it would
    make free rotations unstable.
    """
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    system, size = whole.system, len(whole.system.names)
    gyroscopic = np.zeros((size, size)) if system.gyroscopic is None else system.gyroscopic
    coupled = (system.mass != 0) | (gyroscopic != 0)
    excited = np.array([name.endswith(" rotation") for name in system.names])
    pressed = [_without_rounding(mesh.direction) != 0 for mesh in system.meshes]
    for joined in [*pressed, *(_without_rounding(spring.direction) != 0 for spring in whole.springs)]:
        coupled |= np.outer(joined, joined)
    excited |= np.any(pressed, axis=0)
    _, component = connected_components(coupled, directed=False)
    numbers = np.flatnonzero(np.isin(component, component[excited]))
    square = np.ix_(numbers, numbers)

    def reduced(direction: Array) -> Array:
        return _without_rounding(direction)[numbers]

    springs = [replace(spring, direction=reduced(spring.direction)) for spring in whole.springs]
    springs = [spring for spring in springs if spring.direction.any()]
    stiffness, damping = spring_matrices(springs, numbers.size)
    excited_system = System(
        mass=system.mass[square],
        damping=damping,
        stiffness=stiffness,
        gyroscopic=gyroscopic[square] if gyroscopic.any() else None,
        meshes=tuple(mesh.in_coordinates(reduced) for mesh in system.meshes),
        names=tuple(system.names[number] for number in numbers),
        springs=tuple(springs),
    )
    return excited_system, numbers


def _without_rounding(direction: Array) -> Array:
    """Return a direction with entries at rounding level set to zero."""
    return np.where(np.abs(direction) > _ROUNDING * np.max(np.abs(direction)), direction, 0.0)
