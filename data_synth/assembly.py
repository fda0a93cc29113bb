"""From a declared gearbox to its equations of motion.

Teeth, axes and geometry come from `hums.gearbox.Gearbox`; masses and stiffnesses that are not given have these
defaults, all of steel and none of them more than a first guess:

- A gear is a solid disc of its reference circle and face width, an internal gear a rim of 4 modules outside it, a
  carrier a solid disc through the centres of its planets, as thick as they are. Gears on one link add up to one body.
- A link stands in supports of 1e8 N/m radially and axially and 1e5 N m/rad against tilt, one for each bearing of the
  gearbox that names it, else one in its centre: the order of magnitude that Chaari's gear pair and the planetary set of
  Lin and Parker (1999) have. Nothing holds it against turning.
- A mesh has the constant mean stiffness of ISO 6336-1.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

from data_synth.elements import Link
from data_synth.layout import contacts_of, direction_of, stations
from data_synth.mechanics import PLANE, SPACE, TORSION, Body, Element, System, build_system
from data_synth.mesh_parts import mesh_elements
from data_synth.parts import Attached, Holding, Inertia, MeshProperties, Parts, bodies, supports_of
from hums.gearbox import Gearbox, closest
from hums.kinematics import Kinematics, solve_kinematics

__all__ = ["Attached", "Holding", "Inertia", "MeshProperties", "assemble"]

_PARALLEL = 1e-9
MOTIONS = {"torsion": TORSION, "plane": PLANE, "space": SPACE}
Motions = Literal["torsion", "plane", "space"]


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
        Axes that are not parallel have torsion alone. Without places of their own, planets then ride on their carrier,
        which has their mass.
    inertias, supports : mapping of link (or, for supports, bearing) to Inertia, Holding
        A link that is rigid with the frame and named here is a body of its own: a ring in an elastic housing.
    meshes : mapping of mesh to MeshProperties
    attached : sequence of Attached
    speeds : mapping of link to speed
        As `Kinematics.rates` takes them; None: one turn of the reference. They decide which flanks touch, and how many
        mesh cycles pass in a revolution of the reference.
    speed_rad_s : float
        Speed of the reference: other than 0 adds gyroscopic terms.
    turning_with : str, optional
        A carrier with whose turning the coordinates turn, as those of Lin and Parker.

    Returns
    -------
    System
        Meshes are named like the contacts: ``sun-planet 1`` and so on, in step as their planets stand (``gamma =
        Z psi / 2 pi`` cycles, Z the central gear's signed teeth; Parker and Lin 2004, J. Mech. Des. 126).

    Raises
    ------
    ValueError
        What is named and not there, geometry that is missing, axes that need ``motions = "torsion"``.
    """
    kinematics = gearbox if isinstance(gearbox, Kinematics) else solve_kinematics(gearbox)
    if motions not in MOTIONS:
        raise ValueError(f'motions = "{motions}" is not one of {", ".join(MOTIONS)}.')
    given = dict(meshes or {})
    _refuse_unknown(
        kinematics,
        links={
            "inertias": list(inertias or {}),
            "supports": list(supports or {}),
            "attached": [item.to for item in attached],
        },
        meshes=list(given),
    )
    geometries = {name: item.geometry for name, item in given.items() if item.geometry is not None}
    contacts = contacts_of(kinematics, geometries)
    if motions != "torsion":
        _refuse_crossed(kinematics, motions)
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
    )
    rotors = [
        Body(name=item.name, inertia_kgm2=item.inertia_kgm2, motions=TORSION, axis=_axis(parts, item.to))
        for item in attached
    ]
    couplings = [
        Link(
            motions={(item.name, "rotation"): 1.0, (parts.body(item.to), "rotation"): -1.0},
            stiffness=item.stiffness,
            damping=item.damping,
        )
        for item in attached
    ]
    elements: list[Element] = [*supports_of(parts), *mesh_elements(parts), *couplings]
    ratio = (
        float(parts.turns(turning_with, frame) / parts.unit()) * parts.upright(turning_with) if turning_with else 0.0
    )
    return build_system([*bodies(parts), *rotors], elements, speed_rad_s=speed_rad_s, frame_ratio=ratio)


def _axis(parts: Parts, link: str) -> tuple[float, float, float]:
    return (0.0, 0.0, -1.0) if parts.upright(link) < 0 else (0.0, 0.0, 1.0)


def _refuse_unknown(
    kinematics: Kinematics,
    *,
    links: Mapping[str, Sequence[str]],
    meshes: Sequence[str],
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
    known = {mesh.name for mesh in gearbox.meshes}
    for name in meshes:
        if name not in known:
            raise ValueError(f'meshes names "{name}", which is not in the gearbox{closest(name, sorted(known))}.')


def _refuse_crossed(kinematics: Kinematics, motions: str) -> None:
    """Raise ValueError where an axis is not parallel to the first."""
    bodies_ = list(kinematics.joints)
    first = direction_of(kinematics, bodies_[0])
    for body in bodies_[1:]:
        if abs(abs(float(direction_of(kinematics, body) @ first)) - 1) > _PARALLEL:
            raise ValueError(
                f'motions = "{motions}" needs parallel axes, but those of "{bodies_[0]}" and "{body}" are not; use '
                'motions = "torsion".'
            )
