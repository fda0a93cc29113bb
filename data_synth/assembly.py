"""From a declared gearbox to its equations of motion.

Teeth, axes and geometry come from `hums.gearbox.Gearbox`; masses and stiffnesses that are not given have these
defaults, all of steel and none of them more than a first guess:

- A gear is a solid disc of its reference circle (of a bevel that of its middle) and face width, an internal gear a rim
  of 4 modules outside it, a carrier a solid disc through the centres of its planets, as thick as they are. All that is
  on one link adds up to one body.
- A link stands in supports of 1e8 N/m radially and axially and 1e5 N m/rad against tilt, one for each bearing of the
  gearbox that names it, else one in its centre: the order of magnitude that Chaari's gear pair and the planetary set of
  Lin and Parker (1999) have. Nothing holds it against turning.
- A mesh has the constant mean stiffness of ISO 6336-1, a bevel mesh that of its virtual spur gears.

Bevel gears touch in the middle of their face, on the line where their pitch cones touch; their axes cross, so their
bodies move in space.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from data_synth.bodies import bodies, supports_of
from data_synth.elements import Coupling, GearMesh
from data_synth.layout import contacts_of, direction_of, stations
from data_synth.mechanics import PLANE, SPACE, TORSION, Body, Coordinates, Spring, System, Vector, build_system
from data_synth.mesh_parts import mesh_elements
from data_synth.parts import Attached, Holding, Inertia, MeshProperties, Parts
from hums.gearbox import Gearbox, closest
from hums.kinematics import Kinematics, solve_kinematics

__all__ = ["Assembly", "Attached", "Holding", "Inertia", "MeshProperties", "assemble", "assemble_parts"]

_PARALLEL = 1e-9
MOTIONS = {"torsion": TORSION, "plane": PLANE, "space": SPACE}
Motions = Literal["torsion", "plane", "space"]


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """A gearbox's equations of motion, and what they were made of.

    Attributes
    ----------
    system : System
    parts : Parts
    bodies : tuple of Body
    springs, grounded : tuple of Spring
        All of them, and those that hold a body to the frame.
    on_frame : mapping of contact to vector
        Of the gears of the frame: the direction in which teeth press them.
    """

    system: System
    parts: Parts
    bodies: tuple[Body, ...]
    springs: tuple[Spring, ...] = field(repr=False)
    grounded: tuple[Spring, ...] = field(repr=False)
    on_frame: Mapping[str, Vector]

    @property
    def at(self) -> Coordinates:
        """The coordinates of the system."""
        return Coordinates(self.bodies)


def assemble(
    gearbox: Gearbox | Kinematics,
    *,
    motions: Motions,
    inertias: Mapping[str, Inertia] | None = None,
    supports: Mapping[str, Holding] | None = None,
    meshes: Mapping[str, MeshProperties] | None = None,
    attached: Sequence[Attached] = (),
    speeds: Mapping[str, float] | None = None,
    speed_rad_s: float = 0.0,
    turning_with: str | None = None,
) -> System:
    """Return the equations of motion of a declared gearbox.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
    motions : {"torsion", "plane", "space"}
        Rotations; with x and y across the common direction of all axes; with axial motion and tilt as well.
        Axes that are not parallel have torsion or space. In torsion, planets ride on their carrier, which has their
        mass.
    inertias, supports : mapping of link (or, for supports, bearing) to Inertia, Holding
        A link that is rigid with the frame and named here is a body of its own: a ring in an elastic housing.
    meshes : mapping of mesh, or of one contact by its name, to MeshProperties
    attached : sequence of Attached
    speeds : mapping of link to speed
        As `Kinematics.rates` takes them; None: one turn of the reference. They decide which flanks touch, and how many
        mesh cycles pass in a revolution of the reference.
    speed_rad_s : float
        Speed of the reference: other than 0 adds gyroscopic terms.
    turning_with : str, optional
        A carrier with whose turning the coordinates turn, as those of Lin and Parker; ``"carriers"``: those of each
        body with the carrier of its meshes. Then a link with gears in several frames has a piece in each, and the
        pieces share nothing but their turning, as shafts do that a toothed coupling joins.

    Returns
    -------
    System
        Meshes are named like the contacts: ``sun-planet 1`` and so on, in step as their planets stand (``gamma =
        Z psi / 2 pi`` cycles, Z the central gear's signed teeth; Parker and Lin 2004, J. Mech. Des. 126).

    Raises
    ------
    ValueError
        What is named and not there, geometry that is missing, axes that need another kind of motion.
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
        turning_with=turning_with,
    ).system


def assemble_parts(
    gearbox: Gearbox | Kinematics,
    *,
    motions: Motions,
    inertias: Mapping[str, Inertia] | None = None,
    supports: Mapping[str, Holding] | None = None,
    meshes: Mapping[str, MeshProperties] | None = None,
    attached: Sequence[Attached] = (),
    speeds: Mapping[str, float] | None = None,
    speed_rad_s: float = 0.0,
    turning_with: str | None = None,
) -> Assembly:
    """Return what `assemble` does, with what it was made of."""
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
        held=tuple(link for link in named if kinematics.bodies.get(link) == frame),
        places=stations(kinematics, contacts) if motions != "torsion" else {},
        speeds=speeds,
        turning=turning_with == "carriers",
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
    whole = turning_with is not None and not parts.turning
    at, elements = Coordinates(every), [*holds, *teeth, *couplings]
    return Assembly(
        system=build_system(
            every,
            elements,
            speed_rad_s=speed_rad_s,
            frame_ratio=parts.frame_ratio(turning_with) if whole and turning_with is not None else 0.0,
        ),
        parts=parts,
        bodies=tuple(every),
        springs=tuple(term for element in elements for term in element.terms(at) if isinstance(term, Spring)),
        grounded=tuple(spring for hold in holds if hold.between[1] is None for spring in hold.terms(at)),
        on_frame={mesh.name: _pressed(mesh) for mesh in teeth if isinstance(mesh, GearMesh) and None in mesh.gears},
    )


def _pressed(mesh: GearMesh) -> Vector:
    """Return the direction in which the gear of the frame is pressed."""
    x, y, z = mesh.direction
    return (-x, -y, -z) if mesh.gears[0] is None else (x, y, z)


def _refuse_unknown(
    kinematics: Kinematics,
    *,
    links: Mapping[str, Sequence[str]],
    meshes: Sequence[str],
    contacts: Sequence[str],
) -> None:
    """Raise ValueError for a name that the gearbox does not have, or that its body goes by another one."""
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
    """Raise ValueError where frames turn about axes that are not z, or in each other."""
    for body in parts.kinematics.joints:
        for carrier in parts.frames(body):
            if carrier == parts.frame:
                continue
            if parts.kinematics.joints[carrier].carried_by != parts.frame:
                raise ValueError(
                    f'"{carrier}" carries planets and is carried itself, which a kinematic scene or motions = '
                    '"torsion" allow, but no motion across axes.'
                )
            if abs(abs(parts.upright(carrier)) - 1) > _PARALLEL:
                raise ValueError(
                    f'"{carrier}" carries planets, but other carriers turn about another direction, which a kinematic '
                    'scene or motions = "torsion" allow, but no motion across axes.'
                )
