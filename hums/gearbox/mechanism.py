"""Graph of a mechanism: bodies, turning pairs, and contacts between gears with their carriers.

It is derived from a `hums.Gearbox`: copies are expanded, rigidly connected links become one body, every body except the
frame gets its turning pair, and every mesh its carrier.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from hums.gearbox.components import Mesh, Vector, first_of, united
from hums.gearbox.model import Gearbox, GearboxError
from signals._validation import checked


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Turning pair of a body: the axis about which it rotates, and the body that carries this axis."""

    body: str
    axis: str
    carried_by: str


@dataclass(frozen=True, kw_only=True)
class Contact:
    """One mesh of the expanded mechanism, one per copy of a planet: (link, teeth) of its gears, and carrier."""

    mesh: str
    gears: tuple[tuple[str, int], ...]
    carrier: str
    pitch_angle_deg: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Mechanism:
    """Bodies, turning pairs and contacts of a gearbox.

    Attributes
    ----------
    gearbox : Gearbox
        The declaration.
    bodies : mapping of link to body
        Rigidly connected links are one body, named after the first of them.
    levels : mapping of axis to tuple of bodies
        The bodies on each axis, copies expanded.
    directions : mapping of axis to (3,) unit vector
        Direction of each axis.
    joints : mapping of body to Joint
        Turning pair of every body except the frame, in the order of declaration.
    contacts : tuple of Contact
        Every mesh, copies expanded.
    """

    gearbox: Gearbox
    bodies: Mapping[str, str]
    levels: Mapping[str, tuple[str, ...]]
    directions: Mapping[str, Vector]
    joints: Mapping[str, Joint]
    contacts: tuple[Contact, ...]

    @property
    def frame(self) -> str:
        """The body at rest."""
        return self.bodies[self.gearbox.frame]

    @cached_property
    def axes_of(self) -> Mapping[str, tuple[str, ...]]:
        """Axes that each body rotates about or carries, that of its own turning pair first."""
        return _axes_of(self.levels, self.joints)

    def shared_axis(self, body: str, other: str) -> str | None:
        """Return the axis that two bodies share, or None."""
        others = self.axes_of[other]
        return next((axis for axis in self.axes_of[body] if axis in others), None)


def build_mechanism(gearbox: Gearbox) -> Mechanism:
    """Derive the mechanism of a gearbox.

    Raises
    ------
    GearboxError
        If a link has no turning pair or two, a mesh has no carrier or two possible ones, the axes of two gears do not
        allow a mesh, or the file holds several mechanisms.
    """
    bodies = _bodies(gearbox)
    levels, directions = _levels(gearbox, bodies)
    joints = _joints(gearbox, bodies, levels)
    axes_of = _axes_of(levels, joints)
    contacts = tuple(
        _contact(gearbox, mesh, number, bodies, levels, axes_of)
        for mesh in gearbox.meshes
        for number in range(max(len(gearbox.instances(gear.link)) for gear in mesh.gears))
    )
    mechanism = Mechanism(gearbox, bodies, levels, directions, joints, contacts)
    _check_axes(mechanism)
    _check_connected(mechanism)
    return mechanism


def _bodies(gearbox: Gearbox) -> dict[str, str]:
    """Map each link to its body: itself, or the first link of its rigid group, in which the frame comes first."""
    rank = [name for group in gearbox.rigid for link in group for name in gearbox.instances(link)]
    groups: list[tuple[str, ...]] = []
    for group in gearbox.rigid:
        instances = [gearbox.instances(link) for link in group]
        same_copies = len({len(names) for names in instances}) == 1
        # links with the same number of copies are joined copy by copy: a stepped planet
        groups += zip(*instances, strict=True) if same_copies else [sum(instances, ())]
    body = {link: link for link in gearbox.links}
    for names in united(groups):
        body |= dict.fromkeys(names, gearbox.frame if gearbox.frame in names else min(names, key=rank.index))
    return body


def _levels(gearbox: Gearbox, bodies: Mapping[str, str]) -> tuple[dict[str, tuple[str, ...]], dict[str, Vector]]:
    """Return the bodies on each axis, each body once, and the direction of each axis; copies expanded."""
    levels, directions, declared = {}, {}, gearbox.directions()
    for axis in gearbox.axes:
        members = [gearbox.instances(link) for link in axis.links]
        for number, name in enumerate(axis.instances()):
            levels[name] = tuple(dict.fromkeys(bodies[m[number] if len(m) > 1 else m[0]] for m in members))
            directions[name] = declared[axis.name]
    return levels, directions


def _joints(gearbox: Gearbox, bodies: Mapping[str, str], levels: Mapping[str, tuple[str, ...]]) -> dict[str, Joint]:
    """Find the turning pair of each body, breadth-first from the frame: the first axis that reaches it."""
    axes_through: dict[str, list[str]] = {}
    for axis, members in levels.items():
        for body in members:
            axes_through.setdefault(body, []).append(axis)
    frame = bodies[gearbox.frame]
    joints: dict[str, Joint] = {}
    queue, visited = [frame], set()
    for body in queue:
        for axis in axes_through.get(body, ()):
            if axis in visited:
                continue
            visited.add(axis)
            for other in levels[axis]:
                if other == body:
                    continue
                if other in joints or other == frame:
                    first = joints[other].axis if other in joints else "the frame"
                    raise GearboxError(
                        f'gearbox "{gearbox.name}": "{other}" is held twice, by axis "{axis}" and by "{first}"; '
                        "list coaxial links on one axis."
                    )
                joints[other] = Joint(body=other, axis=axis, carried_by=body)
                queue.append(other)
    order = dict.fromkeys(bodies.values())
    loose = [body for body in order if body not in joints and body != frame]
    if loose:
        raise GearboxError(
            f'gearbox "{gearbox.name}": nothing holds "{loose[0]}"; put it on an axis that leads to the frame '
            f'"{gearbox.frame}", or make it rigid with a link that is.'
        )
    return {body: joints[body] for body in order if body != frame}


def _axes_of(levels: Mapping[str, tuple[str, ...]], joints: Mapping[str, Joint]) -> dict[str, tuple[str, ...]]:
    """Return the axes of each body, that of its turning pair first."""
    axes: dict[str, list[str]] = {}
    for axis, members in levels.items():
        for body in members:
            own = body in joints and joints[body].axis == axis
            axes.setdefault(body, []).insert(0 if own else len(axes[body]), axis)
    return {body: tuple(names) for body, names in axes.items()}


def _contact(
    gearbox: Gearbox,
    mesh: Mesh,
    number: int,
    bodies: Mapping[str, str],
    levels: Mapping[str, tuple[str, ...]],
    axes_of: Mapping[str, tuple[str, ...]],
) -> Contact:
    """Return copy `number` of a mesh with its carrier, the one body that shares an axis with each gear."""

    def instance(link: str) -> str:
        names = gearbox.instances(link)
        return names[number] if len(names) > 1 else names[0]

    gears = tuple((instance(gear.link), gear.teeth) for gear in mesh.gears)
    # S_i of Penaud 2012, eq. 1: the bodies that share an axis with gear i
    coaxial = [{x for axis in axes_of[bodies[link]] for x in levels[axis]} - {bodies[link]} for link, _ in gears]
    found = f"{gears[0][0]} is coaxial with {_set(coaxial[0])}" + "".join(
        f", {link} with {_set(others)}" for (link, _), others in zip(gears[1:], coaxial[1:], strict=True)
    )
    if len(gears) == 2 and bodies[gears[1][0]] in coaxial[0]:  # noqa: PLR2004
        raise GearboxError(
            f'mesh "{mesh.name}": both gears are on the same axis ({found}), so they cannot mesh, and each of '
            f"{_set(set.intersection(*coaxial))} could be their carrier. Put the gears on two axes."
        )
    if mesh.carrier is not None:
        carrier = bodies[instance(mesh.carrier)]
        for (link, _), others in zip(gears, coaxial, strict=True):
            if carrier not in others:
                raise GearboxError(
                    f'mesh "{mesh.name}": the carrier "{mesh.carrier}" does not hold "{link}" '
                    f"({link} is coaxial with {_set(others)}). Name a carrier that shares an axis with each gear."
                )
    else:
        # two axes of a tree share at most one body
        common = set.intersection(*coaxial)
        if not common:
            raise GearboxError(
                f'mesh "{mesh.name}": no link carries both gears ({found}). Add the axis that holds the gears, or '
                'name the carrier with carrier = "...".'
            )
        carrier = common.pop()
    return Contact(mesh=mesh.name, gears=gears, carrier=carrier, pitch_angle_deg=mesh.pitch_angle_deg)


def _check_axes(mechanism: Mechanism) -> None:
    """Refuse gears whose axes (parallel, intersecting or crossed) do not suit their kind."""
    gearbox = mechanism.gearbox
    kinds = {mesh.name: mesh.kind for mesh in gearbox.meshes}
    through = {axis.name: axis.through for axis in gearbox.axes if axis.through is not None}
    checked = set()
    meet_mm = 1e-6  # smallest distance between axes that do not intersect
    rounding = 1e-9
    for contact in mechanism.contacts:
        if contact.mesh in checked or len(contact.gears) == 1:
            continue
        checked.add(contact.mesh)
        axes = [mechanism.shared_axis(mechanism.bodies[link], contact.carrier) or "" for link, _ in contact.gears]
        one, two = (mechanism.directions[axis] for axis in axes)
        normal = _cross(one, two)
        parallel = math.hypot(*normal) < rounding
        kind = kinds[contact.mesh]
        if kind in {"worm", "crossed_helical"} and parallel:
            problem = f'kind = "{kind}" needs axes that cross, but these are parallel'
        elif kind in {"belt", "chain"} and not parallel:
            problem = f'kind = "{kind}" needs parallel axes, but these are not'
        elif kind is None and not parallel and all(axis in through for axis in axes):
            between = [b - a for a, b in zip(*(through[axis] for axis in axes), strict=True)]
            gap = abs(sum(n * x for n, x in zip(normal, between, strict=True))) / math.hypot(*normal)
            problem = f"its axes neither intersect nor are parallel (they are {gap:.4g} apart)" if gap > meet_mm else ""
        else:
            problem = ""
        if kind is None and parallel:
            _check_inside(contact, same_sense=sum(a * b for a, b in zip(one, two, strict=True)) > 0)
        if problem:
            raise GearboxError(
                f'mesh "{contact.mesh}": {problem} (axes {" and ".join(axes)}). Correct direction or through, or '
                'declare kind = "worm" or "crossed_helical" for axes that cross, "belt" or "chain" for parallel ones.'
            )


def _check_inside(contact: Contact, *, same_sense: bool) -> None:
    """Refuse two gears neither of which fits inside the other; internal teeth are negative if the axes point alike."""
    (one, few), (other, many) = sorted(contact.gears, key=lambda gear: abs(gear[1]))
    if same_sense and few < 0 and many < 0:
        raise GearboxError(
            f'mesh "{contact.mesh}": {one} = {few} and {other} = {many} are both internal gears, which cannot mesh; '
            "omit the minus of the gear with external teeth."
        )
    if (few * many < 0) == same_sense and (abs(few) == abs(many) or (same_sense and few < 0)):
        ring, pinion = ((one, few), (other, many)) if few < 0 else ((other, many), (one, few))
        raise GearboxError(
            f'mesh "{contact.mesh}": the internal gear {ring[0]} = {ring[1]} has no room for {pinion[0]} = '
            f"{pinion[1]}; it needs more than {pinion[1]} teeth. Correct the numbers of teeth, or the minus."
        )


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _check_connected(mechanism: Mechanism) -> None:
    """Refuse a file of several mechanisms that share only the frame."""
    meshing = [[mechanism.bodies[link] for link, _ in contact.gears] for contact in mechanism.contacts]
    groups = [[joint.body, joint.carried_by] for joint in mechanism.joints.values()]
    groups += [[*gears, contact.carrier] for gears, contact in zip(meshing, mechanism.contacts, strict=True)]
    geared = {body for gears in meshing for body in gears}  # shafts without gears do not count
    moving = ([body for body in group if body in mechanism.joints] for group in groups)
    parts = [bodies for bodies in united(moving) if geared & set(bodies)]
    if len(parts) > 1:
        first, second, *_ = parts
        raise GearboxError(
            f'gearbox "{mechanism.gearbox.name}" holds {len(parts)} mechanisms that share only the frame '
            f"({', '.join(first)}; and {', '.join(second)}). Put each in its own file, or add the mesh that "
            "connects them."
        )


def _set(names: set[str]) -> str:
    return "{" + ", ".join(sorted(names)) + "}"


@checked
def undeclared_parts(gearbox: Gearbox) -> list[str]:
    """Return a sentence for each kind of component that the gearbox file does not declare.

    Parameters
    ----------
    gearbox : Gearbox
        From `hums.load_gearbox`.

    Returns
    -------
    list of str
        Sentences on rotating bodies without a bearing, and on a gearbox without a mesh; empty if neither applies.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.mechanism import undeclared_parts
    >>> undeclared_parts(hums.load_gearbox("two-stage"))
    ['No bearing is declared on output: damage to its bearings was not assessed.']
    """
    mechanism = build_mechanism(gearbox)
    borne = set()
    for bearing in gearbox.bearings:  # a planet bearing bears the planet, not the carrier
        bodies = {mechanism.bodies[name] for name in gearbox.ring_links(bearing)}
        for body in bodies & mechanism.joints.keys():
            if any(mechanism.joints[body].axis in mechanism.axes_of[other] for other in bodies - {body}):
                borne.add(body)
    bare = list(dict.fromkeys(gearbox.copy_links.get(body, body) for body in mechanism.joints if body not in borne))
    said = []
    if bare:
        whose = "its" if len(bare) == 1 else "their"
        said.append(f"No bearing is declared on {first_of(bare, 12)}: damage to {whose} bearings was not assessed.")
    if not gearbox.meshes:
        said.append("No gear mesh is declared: damage to teeth was not assessed.")
    return said
