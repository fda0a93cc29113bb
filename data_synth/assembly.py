"""From a declared gearbox to its equations of motion.

Teeth, axes and geometry come from `hums.gearbox.Gearbox`; masses and stiffnesses that are not given have these
defaults, all of steel and none of them more than a first guess:

- A gear is a solid disc of its reference circle (of a bevel that of its middle) and face width, an internal gear a rim
  of 4 modules outside it, a carrier a solid disc through the centres of its planets, as thick as they are. All that is
  on one link adds up to one body.
- A link has supports of 1e8 N/m radially and axially and 1e5 N m/rad against tilt, one for each bearing of the
  gearbox that names it, else one in its centre: the order of magnitude that Chaari's gear pair and the planetary set of
  Lin and Parker (1999) have. Its rotation is free.
- A mesh has the constant mean stiffness of ISO 6336-1, a bevel mesh that of its virtual spur gears.

Bevel gears are in contact in the middle of their face, on the line where their pitch cones touch; their axes cross, so
their bodies need motions in space.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from data_synth.bodies import bodies, supports_of
from data_synth.elements import Coupling, GearMesh
from data_synth.layout import axis_points, contacts_of, direction_of
from data_synth.mechanics import PLANE, SPACE, TORSION, Body, Coordinates, Spring, System, Vector, build_system
from data_synth.mesh_parts import mesh_elements
from data_synth.parts import AttachedRotor, Inertia, MeshProperties, Parts, SupportStiffness
from hums.gearbox import Gearbox, closest
from hums.kinematics import Kinematics, solve_kinematics

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Assembly", "AttachedRotor", "Inertia", "MeshProperties", "SupportStiffness", "assemble", "assemble_parts"]

_PARALLEL = 1e-9
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
        Bodies, in the order of the degrees of freedom.
    springs, grounded : tuple of Spring
        All springs, and those between a body and the frame.
    on_frame : mapping of contact to vector
        Direction of the mesh force on each gear that is fixed to the frame.
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
    attached: Sequence[AttachedRotor] = (),
    speeds: Mapping[str, float] | None = None,
    speed_rad_s: float = 0.0,
    rotating_frame: str | None = None,
) -> System:
    """Return the equations of motion of a declared gearbox.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
        Teeth, axes and, for meshes without `MeshProperties.geometry`, modules, face widths and pressure angles.
    motions : {"torsion", "plane", "space"}
        Degrees of freedom of each body: rotation; x and y across the common direction of all axes as well; axial motion
        and tilt as well. Axes that are not parallel allow torsion or space. In torsion, planets have no motion of their
        own across their axis, and the carrier has their mass.
    inertias : mapping of link to Inertia, optional
        Masses and moments of inertia, in place of the defaults.
    supports : mapping of link or bearing to SupportStiffness, optional
        Stiffness of bearings, in place of the defaults. A link that is rigid with the frame and named here or in
        `inertias` is a body of its own: a ring in an elastic housing.
    meshes : mapping of mesh, or of one contact, to MeshProperties, optional
        Mesh stiffness, transmission error, backlash, damping and geometry.
    attached : sequence of AttachedRotor
        Rotors outside of the gearbox, as motor and load.
    speeds : mapping of link to speed, optional
        As `Kinematics.rates` takes them; one turn of the reference if left out. They decide which flanks are in
        contact, and the mesh cycles per revolution of the reference.
    speed_rad_s : float
        Speed of the reference in rad/s: other than 0 adds gyroscopic terms.
    rotating_frame : str, optional
        A carrier with which all coordinates rotate, as those of Lin and Parker; ``"carriers"``: those of each body
        rotate with the carrier of its meshes. Then a link with gears on several carriers has a piece for each, and the
        pieces share nothing but their rotation, as shafts that a toothed coupling joins.

    Returns
    -------
    System
        Meshes are named like the contacts, ``sun-planet 1`` and so on, with the phase differences of their planets
        (``gamma = Z psi / 2 pi`` cycles, Z the central gear's signed teeth; Parker and Lin 2004, J. Mech. Des. 126).

    Raises
    ------
    ValueError
        If a name is not in the gearbox, geometry is missing, or the axes need other motions.

    Examples
    --------
    A torsional gear pair with base radii r1 and r2: ``omega^2 = k (r1^2 / J1 + r2^2 / J2)``:

    >>> import math
    >>> from data_synth.assembly import Inertia, MeshProperties, assemble
    >>> from data_synth.mesh import Constant
    >>> from data_synth.modal import solve_modes
    >>> from hums.gearbox import Gearbox
    >>> axes = {name: {"direction": [1, 0, 0], "links": ["housing", name]} for name in ("pinion", "wheel")}
    >>> mesh = {"teeth": {"pinion": 20, "wheel": 40}, "module_mm": 4, "face_width_mm": 30, "pressure_angle_deg": 20}
    >>> table = {"name": "pair", "frame": "housing", "reference": "pinion", "axes": axes, "mesh": [mesh]}
    >>> gearbox = Gearbox.from_mapping(table)
    >>> system = assemble(
    ...     gearbox,
    ...     motions="torsion",
    ...     inertias={"pinion": Inertia(inertia_kgm2=0.01), "wheel": Inertia(inertia_kgm2=0.04)},
    ...     meshes={"pinion-wheel": MeshProperties(stiffness=Constant(mean=2e8))},
    ... )
    >>> r1, r2 = 0.04 * math.cos(math.radians(20)), 0.08 * math.cos(math.radians(20))
    >>> math.isclose(solve_modes(system).angular[1], math.sqrt(2e8 * (r1**2 / 0.01 + r2**2 / 0.04)))
    True
    """
    return assemble_parts(
        gearbox,
        motions=motions,
        inertias=inertias,
        supports=supports,
        meshes=meshes,
        attached=attached,
        speeds=speeds,
        speed_rad_s=speed_rad_s,
        rotating_frame=rotating_frame,
    ).system


def assemble_parts(
    gearbox: Gearbox | Kinematics,
    *,
    motions: Motions,
    inertias: Mapping[str, Inertia] | None = None,
    supports: Mapping[str, SupportStiffness] | None = None,
    meshes: Mapping[str, MeshProperties] | None = None,
    attached: Sequence[AttachedRotor] = (),
    speeds: Mapping[str, float] | None = None,
    speed_rad_s: float = 0.0,
    rotating_frame: str | None = None,
) -> Assembly:
    """Return the equations of motion with the bodies and springs they were assembled from; see `assemble`."""
    kinematics = gearbox if isinstance(gearbox, Kinematics) else solve_kinematics(gearbox)
    if motions not in MOTIONS:
        raise ValueError(f'motions = "{motions}" is not one of {", ".join(MOTIONS)}.')
    given = dict(meshes or {})
    geometries = {name: item.geometry for name, item in given.items() if item.geometry is not None}
    contacts = contacts_of(kinematics, geometries)
    _refuse_unknown(
        kinematics,
        links={
            "inertias": list(inertias or {}),
            "supports": list(supports or {}),
            "attached": [item.to for item in attached],
        },
        meshes=list(given),
        contacts=[contact.name for contact in contacts],
    )
    if motions == "plane":
        _refuse_crossed(kinematics)
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
        rotating_coordinates=rotating_frame == "carriers",
    )
    _refuse_nested(parts)
    rotors = [
        Body(name=item.name, inertia_kgm2=item.inertia_kgm2, motions=TORSION, axis=parts.axis(item.to))
        for item in attached
    ]
    couplings = [
        Coupling(
            motions={(item.name, "rotation"): 1.0, (parts.body(item.to), "rotation"): -1.0},
            stiffness=item.stiffness,
            damping=item.damping,
        )
        for item in attached
    ]
    every, holds, teeth = [*bodies(parts), *rotors], [*supports_of(parts)], [*mesh_elements(parts)]
    coordinates, elements = Coordinates(every), [*holds, *teeth, *couplings]
    common_frame = None if parts.rotating_coordinates else rotating_frame
    return Assembly(
        system=build_system(
            every,
            elements,
            speed_rad_s=speed_rad_s,
            frame_ratio=0.0 if common_frame is None else parts.frame_ratio(common_frame),
        ),
        parts=parts,
        bodies=tuple(every),
        springs=tuple(term for element in elements for term in element.terms(coordinates) if isinstance(term, Spring)),
        grounded=tuple(spring for hold in holds if hold.between[1] is None for spring in hold.terms(coordinates)),
        on_frame={
            mesh.name: _force_direction(mesh) for mesh in teeth if isinstance(mesh, GearMesh) and None in mesh.gears
        },
    )


def _force_direction(mesh: GearMesh) -> Vector:
    """Return the direction of the mesh force on the gear of the frame."""
    x, y, z = mesh.direction
    return (-x, -y, -z) if mesh.gears[0] is None else (x, y, z)


def _refuse_unknown(
    kinematics: Kinematics,
    *,
    links: Mapping[str, Sequence[str]],
    meshes: Sequence[str],
    contacts: Sequence[str],
) -> None:
    """Raise ValueError for a name that the gearbox lacks, or for a link that belongs to a body of another name."""
    gearbox = kinematics.gearbox
    bearings = [name for bearing in gearbox.bearings for name in bearing.names]
    for word, names in links.items():
        known = {*kinematics.links, *(bearings if word == "supports" else ())}
        for name in names:
            if name not in known:
                raise ValueError(f'{word} names "{name}", which is not in the gearbox{closest(name, sorted(known))}.')
            body = kinematics.bodies.get(name, name)
            if body not in (name, kinematics.mechanism.frame):
                raise ValueError(f'{word} names "{name}", which is one body with "{body}"; write "{body}".')
    known = {*(mesh.name for mesh in gearbox.meshes), *contacts}
    for name in meshes:
        if name not in known:
            raise ValueError(f'meshes names "{name}", which is not in the gearbox{closest(name, sorted(known))}.')


def _refuse_crossed(kinematics: Kinematics) -> None:
    """Raise ValueError where an axis is not parallel to the first."""
    bodies_ = list(kinematics.joints)
    first = direction_of(kinematics, bodies_[0])
    for body in bodies_[1:]:
        if abs(abs(float(direction_of(kinematics, body) @ first)) - 1) > _PARALLEL:
            raise ValueError(
                f'motions = "plane" needs parallel axes, but those of "{bodies_[0]}" and "{body}" are not; use '
                '"torsion" or "space".'
            )


def _refuse_nested(parts: Parts) -> None:
    """Raise ValueError where a carrier is carried itself, or rotates about an axis that is not z."""
    for body in parts.kinematics.joints:
        for carrier in parts.frames(body):
            if carrier == parts.frame:
                continue
            if parts.kinematics.joints[carrier].carried_by != parts.frame:
                raise ValueError(
                    f'"{carrier}" carries planets and is carried itself, which a kinematic scene or motions = '
                    '"torsion" allow, but no motion across axes.'
                )
            if abs(abs(parts.cosine_to_z(carrier)) - 1) > _PARALLEL:
                raise ValueError(
                    f'"{carrier}" carries planets, but other carriers turn about another direction, which a kinematic '
                    'scene or motions = "torsion" allow, but no motion across axes.'
                )
