"""Positions in space of the gears, shafts, carrier arms and bearings of a declared gearbox, for drawings.

Gears are drawn by their operating pitch circles, which touch: on parallel axes a distance a apart their radii are
``a z / |z1 +- z2|``; bevel gears have the pitch cones that roll on each other. What a gearbox file leaves open is
schematic and said so in `Layout.notes`: without a declared module lengths count modules, without positions stages
stand in the order of declaration.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from hums.gearbox.components import Bearing, Mesh, Vector, planet_angles
from hums.gearbox.mechanism import Contact, Mechanism, build_mechanism
from hums.gearbox.model import Gearbox

Array = NDArray[np.float64]

_PARALLEL = 1e-9
_FACE_MODULES = 10.0  # face width over module where none is declared: usual for spur gears
_GAP = 1.0  # between stages on one axis, of the face width
_WORM_SHARE = 0.35  # radius of a worm over that of its wheel, which its starts do not give
_BELT_SHARE = 1.6  # centre distance of a belt over the sum of its radii
_SIDES_DEG = (0.0, 180.0, 90.0, 270.0, 45.0, 135.0, 225.0, 315.0)


@dataclass(frozen=True, kw_only=True)
class GearShape:
    """One gear: its pitch circle in the middle of the face, or at the outer end of a pitch cone.

    Attributes
    ----------
    link, declared, body : str
        Link (a copy has its number), the link as declared, and the body it belongs to.
    teeth : int
        Number of teeth, positive.
    internal : bool
        Whether the teeth point inwards.
    meshes : tuple of str
        Names of its meshes.
    centre, axis : vector of 3
        Centre of the pitch circle, and unit vector of the axis.
    radius, face : float
        Pitch radius and face width.
    cone_rad : float
        Signed angle of the pitch cone: 0 for a cylinder; the apex is ``radius / tan(cone)`` against the axis.
    tooth_rad : float
        Angle of the middle of a tooth about the axis, from `transverse_axes`, in the drawn position.
    """

    link: str
    declared: str
    body: str
    teeth: int
    internal: bool
    meshes: tuple[str, ...]
    centre: Vector
    axis: Vector
    radius: float
    face: float
    cone_rad: float = 0.0
    tooth_rad: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A part of a body drawn as a line through points: a shaft, a carrier arm with its pin, or the web of a ring gear.

    `kind` is "shaft", "arm" or "web"; `planet` the body that an arm holds.
    """

    body: str
    kind: str
    points: tuple[Vector, ...]
    radius: float
    planet: str = ""


@dataclass(frozen=True, kw_only=True)
class BearingShape:
    """A bearing: the circle of its elements, and their number and radius."""

    name: str
    inner: str
    outer: str
    centre: Vector
    axis: Vector
    radius: float
    element_radius: float
    elements: int


@dataclass(frozen=True, kw_only=True)
class MeshPoint:
    """The pitch point of one contact; it moves with the carrier."""

    mesh: str
    carrier: str
    point: Vector
    flexible: bool


@dataclass(frozen=True, kw_only=True)
class TurningPair:
    """The axis of a body: a point of it, its direction, and the body that carries it."""

    body: str
    carried_by: str
    point: Vector
    direction: Vector


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The parts of a gearbox in space, as drawn.

    Attributes
    ----------
    gears, rods, bearings, meshes, pairs : tuples of shapes
    unit : str
        Unit of lengths: "mm", or "modules" where no module is declared.
    across, up : vector of 3
        Directions to the right and upwards of the section; all axes lie in this plane where they share one.
    planar : bool
        Whether all axes are parallel.
    notes : tuple of str
        What is not to scale, in sentences.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.layout import layout_of
    >>> drawn = layout_of(hums.load_gearbox("wijianto-pair"))
    >>> {gear.link: round(2 * gear.radius, 2) for gear in drawn.gears}  # mm: 128.81 and 225.43 are printed there
    {'pinion': 128.81, 'gear': 225.43}
    """

    gears: tuple[GearShape, ...]
    rods: tuple[Rod, ...]
    bearings: tuple[BearingShape, ...]
    meshes: tuple[MeshPoint, ...]
    pairs: tuple[TurningPair, ...]
    unit: str
    across: Vector
    up: Vector
    planar: bool
    notes: tuple[str, ...]

    @property
    def axial(self) -> tuple[Vector, Vector]:
        """Directions to the right and upwards of the view along the axes."""
        direction = self.pairs[0].direction
        return transverse_axes(direction, _vector(np.cross(self.across, self.up)))


def layout_of(gearbox: Gearbox) -> Layout:
    """Return where the parts of a gearbox are drawn.

    Parameters
    ----------
    gearbox : Gearbox
        From `hums.load_gearbox`.

    Returns
    -------
    Layout

    Raises
    ------
    GearboxError
        A gearbox that is not a mechanism.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.layout import layout_of
    >>> drawn = layout_of(hums.load_gearbox("planetary-27-36-99"))
    >>> [round(gear.radius, 1) for gear in drawn.gears if gear.link in ("sun", "planet 1", "ring")]
    [13.5, 18.0, 49.5]
    >>> drawn.unit
    'modules'
    """
    return _Drawing(build_mechanism(gearbox)).layout()


def transverse_axes(direction: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors across a direction; the first is in the plane with this normal, where it holds both."""
    first = np.cross(normal, direction)
    if np.linalg.norm(first) < _PARALLEL:
        first = np.cross((0.0, 0.0, 1.0) if abs(direction[2]) < 0.9 else (1.0, 0.0, 0.0), direction)  # noqa: PLR2004
    first = first / np.linalg.norm(first)
    first = first if first[int(np.argmax(np.abs(first)))] > 0 else -first
    return _vector(first), _vector(np.cross(direction, first))


# ---- Construction ----------------------------------------------------------------------------------------------------


@dataclass
class _Line:
    """An axis in space while it is placed: the point whose coordinate along the axis is 0, and what is taken of it."""

    name: str
    direction: Array
    angle_rad: float = 0.0
    copied: bool = False
    origin: Array | None = None
    taken: list[tuple[float, float]] = field(default_factory=list)

    def at(self, place: float) -> Array:
        assert self.origin is not None  # noqa: S101  - only placed lines are asked
        return np.asarray(self.origin + place * self.direction)

    @property
    def end(self) -> float:
        return max((high for _, high in self.taken), default=0.0)

    @property
    def start(self) -> float:
        return min((low for low, _ in self.taken), default=0.0)


@dataclass(frozen=True)
class _Pair:
    """A contact with the lines of its gears."""

    number: int
    contact: Contact
    mesh: Mesh
    lines: tuple[str, ...]
    parallel: bool
    module: float

    @property
    def rolling(self) -> bool:
        """Whether pitch circles or cones touch: not for belts and crossed axes."""
        return self.mesh.kind is None

    def key(self, which: int) -> tuple[str, int, str, str]:
        """Return what a gear is known by, also one of two meshes: link, teeth, line, and of a ring the stage."""
        link, teeth = self.contact.gears[which]
        return (link, teeth, self.lines[which], self.contact.carrier if teeth < 0 and self.parallel else "")


class _Drawing:
    """The construction of a layout: lines are placed one by one, then gears, rods and bearings on them."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.gearbox = mechanism.gearbox
        self.meshes = {mesh.name: mesh for mesh in self.gearbox.meshes}
        self.normal = self._normal()
        self.lines = self._unplaced_lines()
        modules = self._modules()
        self.any_module = any(mesh.module_mm for mesh in self.gearbox.meshes)
        self.pairs = [
            self._pair(number, contact, modules[contact.mesh]) for number, contact in enumerate(mechanism.contacts)
        ]
        self.places: dict[int, float] = {}  # of a contact: along its first gear's line
        self.notes: list[str] = []

    # ---- axes ------------------------------------------------------------------------------------------------

    def _normal(self) -> Array:
        """Return the normal of the plane of the section: that of the first two axes that are not parallel."""
        directions = [np.array(vector) for vector in self.mechanism.directions.values()]
        for other in directions:
            normal = np.cross(directions[0], other)
            if np.linalg.norm(normal) > _PARALLEL:
                normal = normal / np.linalg.norm(normal)
                return np.asarray(normal if normal[int(np.argmax(np.abs(normal)))] > 0 else -normal)
        z = np.array([0.0, 0.0, 1.0])
        return z if abs(directions[0][2]) < _PARALLEL else _orthogonal(directions[0])

    def _unplaced_lines(self) -> dict[str, _Line]:
        lines = {}
        for axis in self.gearbox.axes:
            angles = planet_angles(axis.copies, axis.spacing_deg) if axis.copies else [0.0]
            for name, angle in zip(axis.instances(), angles, strict=True):
                direction = np.array(self.mechanism.directions[name])
                line = _Line(name, direction, math.radians(angle), copied=axis.copies is not None)
                if axis.through is not None and axis.copies is None:
                    line.origin = np.array(axis.through)
                lines[name] = line
        for name, line in lines.items():  # bevel planets are turned about their carrier's axis
            about = self._carrier_axis(name)
            if about is not None and line.angle_rad:
                line.direction = _rotated(line.direction, lines[about].direction, line.angle_rad)
        return lines

    def _carrier_axis(self, line: str) -> str | None:
        """Return the axis about which the body turns that carries a line."""
        for joint in self.mechanism.joints.values():
            if joint.axis == line and joint.carried_by in self.mechanism.joints:
                return self.mechanism.joints[joint.carried_by].axis
        return None

    def _modules(self) -> dict[str, float]:
        """Return the module of each mesh: declared, else that of a mesh with a gear in common, else a usual one."""
        cosines = {name: math.cos(math.radians(mesh.helix_angle_deg or 0)) for name, mesh in self.meshes.items()}
        found = {name: mesh.module_mm / cosines[name] for name, mesh in self.meshes.items() if mesh.module_mm}
        usual = median(found.values()) if found else 1.0
        gears = {name: {(gear.link, abs(gear.teeth)) for gear in mesh.gears} for name, mesh in self.meshes.items()}
        for _ in self.meshes:
            for name in self.meshes:
                if name not in found:
                    shared = [module for other, module in found.items() if gears[name] & gears[other]]
                    found |= {name: shared[0]} if shared else {}
        return {name: found.get(name, usual) for name in self.meshes}

    def _pair(self, number: int, contact: Contact, module: float) -> _Pair:
        bodies = self.mechanism.bodies
        lines = tuple(
            self.mechanism.shared_axis(bodies[link], contact.carrier) or next(iter(self.lines))
            for link, _ in contact.gears
        )
        directions = [self.lines[name].direction for name in lines]
        parallel = len(lines) < 2 or bool(np.linalg.norm(np.cross(directions[0], directions[1])) < _PARALLEL)  # noqa: PLR2004
        return _Pair(number, contact, self.meshes[contact.mesh], lines, parallel, module)

    # ---- dimensions ------------------------------------------------------------------------------------------

    def face(self, pair: _Pair) -> float:
        """Return the face width of a contact, at most a third of its largest diameter where it is not declared."""
        if pair.mesh.face_width_mm and self.any_module:
            return pair.mesh.face_width_mm
        largest = max(abs(teeth) for _, teeth in pair.contact.gears)
        return min(_FACE_MODULES, largest / 3) * pair.module

    def signs(self, pair: _Pair) -> int:
        """Return +1 for two external gears on parallel axes, -1 where one of them is internal."""
        one, two = (teeth for _, teeth in pair.contact.gears)
        along = float(self.lines[pair.lines[0]].direction @ self.lines[pair.lines[1]].direction)
        return 1 if one * two * along > 0 else -1

    def distance(self, pair: _Pair) -> float:
        """Return the nominal centre distance of parallel axes, or the distance of crossed ones."""
        one, two = (abs(teeth) * pair.module / 2 for _, teeth in pair.contact.gears)
        if pair.mesh.kind in {"belt", "chain"}:
            return _BELT_SHARE * (one + two)
        if not pair.parallel:
            return sum(self._crossed_radii(pair))
        sign = self.signs(pair)
        shift = pair.mesh.profile_shift or (0.0, 0.0)
        # the shift moves the axes by nearly this much; the inclination of the flanks takes a few hundredths of it off
        moved = (shift[0] + shift[-1] if sign > 0 else abs(shift[1] - shift[0])) * (pair.mesh.module_mm or 0.0)
        return (one + two if sign > 0 else abs(one - two)) + moved

    def _crossed_radii(self, pair: _Pair) -> tuple[float, float]:
        one, two = (abs(teeth) * pair.module / 2 for _, teeth in pair.contact.gears)
        least = _WORM_SHARE * max(one, two)
        return max(one, least), max(two, least)

    def cones(self, pair: _Pair) -> tuple[Array, tuple[float, float], float]:
        """Return the common element of two pitch cones, their signed angles, and the outer cone distance.

        The relative rotation is about the element: along ``z2 a1 + z1 a2`` for ``z1 w1 + z2 w2 = 0``.
        """
        (_, one), (_, two) = pair.contact.gears
        axes = [self.lines[name].direction for name in pair.lines]
        along = math.copysign(1.0, one * two) * (two * axes[0] + one * axes[1])
        element = along / np.linalg.norm(along)
        first, second = (math.acos(max(-1.0, min(1.0, float(element @ axis)))) for axis in axes)
        return element, (first, second), abs(one) * pair.module / 2 / math.sin(first)

    # ---- placement -------------------------------------------------------------------------------------------

    def layout(self) -> Layout:
        self._place()
        gears = self._gears()
        gears = self._meshed(gears)
        rods, gears = self._rods(gears)
        bearings, rods = self._bearings(gears, rods)
        joints = self.mechanism.joints
        across, up = self._picture()
        return Layout(
            gears=tuple(gears),
            rods=tuple(rods),
            bearings=tuple(bearings),
            meshes=tuple(self._mesh_points()),
            pairs=tuple(
                TurningPair(
                    body=body,
                    carried_by=joint.carried_by,
                    point=_vector(self.lines[joint.axis].at(0.0)),
                    direction=_vector(self.lines[joint.axis].direction),
                )
                for body, joint in joints.items()
            ),
            unit="mm" if self.any_module else "modules",
            across=across,
            up=up,
            planar=all(
                np.linalg.norm(np.cross(line.direction, next(iter(self.lines.values())).direction)) < _PARALLEL
                for line in self.lines.values()
            ),
            notes=tuple(self._scale_notes()),
        )

    def _picture(self) -> tuple[Vector, Vector]:
        """Return right and up of the section: x and y where they span it, else the first axis and across it."""
        if abs(abs(self.normal[2]) - 1) < _PARALLEL:
            return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        across = next(iter(self.lines.values())).direction
        return _vector(across), _vector(np.cross(self.normal, across))

    def _place(self) -> None:
        """Place lines and contacts, in the order of declaration as far as what they refer to is placed."""
        first = next(iter(self.lines.values()))
        if all(line.origin is None for line in self.lines.values()):
            first.origin = np.zeros(3)
        waiting = list(self.pairs)
        while waiting:
            ready = [pair for pair in waiting if any(self.lines[name].origin is not None for name in pair.lines)]
            if not ready:
                self._place_apart(self.lines[waiting[0].lines[0]])
                continue
            pair = ready[0]
            waiting.remove(pair)
            self._place_contact(pair, waiting)
        for line in self.lines.values():
            if line.origin is None:
                self._place_apart(line)

    def _place_apart(self, line: _Line) -> None:
        """Place a line that no gear connects with the others at one side of them."""
        placed = [other.origin for other in self.lines.values() if other.origin is not None]
        reach = max((abs(teeth) * pair.module for pair in self.pairs for _, teeth in pair.contact.gears), default=10.0)
        line.origin = (
            np.mean(placed, axis=0) + 1.5 * reach * np.array(self.transverse(line)[0]) if placed else np.zeros(3)
        )
        self.notes.append(f'The place of axis "{line.name}" is not declared; it is drawn at one side.')

    def transverse(self, line: _Line) -> tuple[Vector, Vector]:
        return transverse_axes(_vector(line.direction), _vector(self.normal))

    def _place_contact(self, pair: _Pair, waiting: list[_Pair]) -> None:
        lines = [self.lines[name] for name in pair.lines]
        if len(lines) == 1 or pair.parallel:
            unplaced = [line for line in lines if line.origin is None]
            if unplaced:
                self._place_beside(unplaced[0], pair, waiting)
            self._give_slot(pair)
            return
        if lines[0].origin is None or lines[1].origin is None:
            known, other = (lines[0], lines[1]) if lines[1].origin is None else (lines[1], lines[0])
            place = self._free_place(pair, known)
            crossing = known.at(place)
            if pair.rolling:
                other.origin = crossing
            else:
                common = np.cross(known.direction, other.direction)
                other.origin = crossing - self.distance(pair) * common / np.linalg.norm(common)
        self.places[pair.number] = _nearest_place(lines[0], lines[1])
        for which, line in enumerate(lines):
            low, high = self._extent(pair, which)
            apex = _nearest_place(line, lines[1 - which])
            line.taken.append((apex + low, apex + high))

    def _extent(self, pair: _Pair, which: int) -> tuple[float, float]:
        """Return what a pair whose axes are not parallel takes of one of them, from the point where they meet."""
        if not pair.rolling:
            reach = max(self._crossed_radii(pair)[1 - which], self.face(pair) / 2)
            return -reach, reach
        _, angles, distance = self.cones(pair)
        mate = distance * math.sin(angles[1 - which])
        own = distance * math.cos(angles[which])
        return min(own, -mate) - 0.1 * mate, max(own, mate) + 0.1 * mate

    def _free_place(self, pair: _Pair, line: _Line) -> float:
        """Return where along a placed line the next pair begins: as declared, else beyond what is taken."""
        if pair.mesh.position_mm is not None and pair.lines[0] == line.name and self.any_module:
            return pair.mesh.position_mm
        if not line.taken:
            return 0.0
        low, _ = self._extent(pair, pair.lines.index(line.name))
        return line.end + _GAP * self.face(pair) - low

    def _place_beside(self, line: _Line, pair: _Pair, waiting: list[_Pair]) -> None:
        """Place a line parallel to the other one of a contact, or at the two distances that two contacts give."""
        others = [p for p in [pair, *waiting] if p.parallel and len(p.lines) > 1 and line.name in p.lines]
        bounds: dict[str, tuple[_Line, float]] = {}
        for each in others:
            mate = self.lines[each.lines[1 - each.lines.index(line.name)]]
            if mate.origin is not None and mate is not line:
                bounds.setdefault(mate.name, (mate, self.distance(each)))
        (mate, distance), *more = bounds.values()
        assert mate.origin is not None  # noqa: S101  - chosen so
        e1, e2 = (np.array(axis) for axis in self.transverse(mate))
        for other, length in more:
            assert other.origin is not None  # noqa: S101
            between = other.origin - mate.origin
            between -= (between @ mate.direction) * mate.direction
            gap = float(np.linalg.norm(between))
            if abs(distance - length) < gap < distance + length:
                along = (gap**2 + distance**2 - length**2) / (2 * gap)
                aside = math.sqrt(distance**2 - along**2)
                unit = between / gap
                line.origin = mate.origin + along * unit + aside * np.cross(mate.direction, unit)
                return
        for degrees in (0.0,) if line.copied else _SIDES_DEG:
            angle = line.angle_rad + math.radians(degrees)
            line.origin = mate.origin + distance * (math.cos(angle) * e1 + math.sin(angle) * e2)
            if not self._collides(line, pair):
                return

    def _collides(self, line: _Line, pair: _Pair) -> bool:
        """Return whether a gear at this place covers another one that meshes with the same mate."""
        radius = self._radius_on(pair, line.name)
        mate = pair.lines[1 - pair.lines.index(line.name)]
        for other in self.pairs:
            elsewhere = mate not in other.lines or other.contact.carrier != pair.contact.carrier
            if elsewhere or not other.parallel or len(other.lines) < 2:  # noqa: PLR2004
                continue
            neighbour = self.lines[other.lines[1 - other.lines.index(mate)]]
            if neighbour is line or neighbour.origin is None or line.origin is None:
                continue
            space = float(np.linalg.norm(np.cross(line.origin - neighbour.origin, line.direction)))
            if space < 0.9 * (radius + self._radius_on(other, neighbour.name)):
                return True
        return False

    def _radius_on(self, pair: _Pair, line: str) -> float:
        return abs(pair.contact.gears[pair.lines.index(line)][1]) * pair.module / 2

    def _give_slot(self, pair: _Pair) -> None:
        """Place a contact of parallel axes along them: as declared, with one that has a gear in common, or next."""
        lines = [self.lines[name] for name in pair.lines]
        face = self.face(pair)
        if pair.mesh.position_mm is not None and self.any_module:
            place = pair.mesh.position_mm
        else:
            shared = [
                other
                for other in self.pairs
                if other.number in self.places and other.parallel and not self._blocked(pair, other)
            ]
            if shared:
                place = self._along(lines[0], self.lines[shared[0].lines[0]].at(self.places[shared[0].number]))
            elif not any(line.taken for line in lines):
                place = 0.0
            else:
                moves = pair.contact.carrier != self.mechanism.frame
                space = face * (0.5 + _GAP * (2 if moves else 1))
                ends = [self._along(lines[0], line.at(line.end)) for line in lines if line.taken]
                place = max(ends) + space
        self.places[pair.number] = place
        room = face * (0.5 + (_GAP if pair.contact.carrier != self.mechanism.frame else 0.0))
        for line in lines:
            here = self._along(line, lines[0].at(place))
            line.taken.append((here - room, here + room))

    def _blocked(self, pair: _Pair, other: _Pair) -> bool:
        """Return whether a contact cannot stand in the plane of another: no gear in common, or one in the way."""
        keys = {pair.key(number) for number in range(len(pair.lines))}
        plane = [p for p in self.pairs if p.number in self.places and p.parallel and self._same_plane(p, other)]
        there = {p.key(number) for p in plane for number in range(len(p.lines))}
        if not keys & there:
            copies = {(pair.mesh.name, p.mesh.name) for p in plane if p.mesh.name == pair.mesh.name}
            if not copies:
                return True
        return any(
            at == line and (z > 0) == (teeth > 0) and (of, z) != (link, teeth)
            for link, teeth, line, _ in keys - there
            for of, z, at, _ in there
        )

    def _same_plane(self, one: _Pair, other: _Pair) -> bool:
        points = [self.lines[pair.lines[0]].at(self.places[pair.number]) for pair in (one, other)]
        return abs(float((points[0] - points[1]) @ self.lines[other.lines[0]].direction)) < _PARALLEL

    @staticmethod
    def _along(line: _Line, point: Array) -> float:
        assert line.origin is not None  # noqa: S101  - only placed lines are asked
        return float((point - line.origin) @ line.direction)

    # ---- parts -----------------------------------------------------------------------------------------------

    def _gears(self) -> list[GearShape]:
        """Return the gears; one that several contacts share has the mean of their radii and spans their planes."""
        found: dict[tuple[object, ...], list[GearShape]] = {}
        for pair in self.pairs:
            for which, shape in enumerate(self._shapes(pair)):
                found.setdefault(pair.key(which), []).append(shape)
        return [_joined(shapes) for shapes in found.values()]

    def _shapes(self, pair: _Pair) -> Iterator[GearShape]:
        """Yield the gears of one contact."""
        lines = [self.lines[name] for name in pair.lines]
        place, face = self.places[pair.number], self.face(pair)
        radii = self._radii(pair)
        for which, (link, teeth) in enumerate(pair.contact.gears):
            line, cone = lines[which], 0.0
            centre = line.at(self._along(line, lines[0].at(place)))
            internal = teeth < 0 and pair.parallel and pair.mesh.kind is None
            if not pair.parallel and pair.rolling:
                _, angles, distance = self.cones(pair)
                cone = angles[which]
                centre = line.at(_nearest_place(line, lines[1 - which]) + distance * math.cos(cone))
                face = min(face, distance / 3) if not pair.mesh.face_width_mm else face
                internal = self._is_inner_cone(pair, which)
            elif not pair.parallel:
                centre = line.at(_nearest_place(line, lines[1 - which]))
            yield GearShape(
                link=link,
                declared=_declared(self.gearbox, link),
                body=self.mechanism.bodies[link],
                teeth=abs(teeth),
                internal=internal,
                meshes=(pair.mesh.name,),
                centre=_vector(centre),
                axis=_vector(line.direction),
                radius=radii[which],
                face=face,
                cone_rad=cone,
            )

    def _is_inner_cone(self, pair: _Pair, which: int) -> bool:
        """Return whether a bevel gear holds its mate inside its cone."""
        _, angles, _ = self.cones(pair)
        axes = [self.lines[name].direction for name in pair.lines]
        cosines = [math.cos(angle) for angle in angles]
        one_side = (
            math.copysign(1.0, cosines[0] * cosines[1]) * (float(axes[0] @ axes[1]) - cosines[0] * cosines[1]) > 0
        )
        sines = [math.sin(angle) for angle in angles]
        return one_side and sines[which] > sines[1 - which]

    def _radii(self, pair: _Pair) -> tuple[float, ...]:
        """Return the operating pitch radii of a contact."""
        teeth = [abs(number) for _, number in pair.contact.gears]
        if len(teeth) == 1:
            return (teeth[0] * pair.module / 2,)
        if not pair.parallel and pair.rolling:
            _, angles, distance = self.cones(pair)
            return tuple(distance * math.sin(angle) for angle in angles)
        if not pair.parallel:
            return self._crossed_radii(pair)
        if not pair.rolling:
            return tuple(number * pair.module / 2 for number in teeth)
        lines = [self.lines[name] for name in pair.lines]
        between = np.cross(lines[1].at(0.0) - lines[0].at(0.0), lines[0].direction)
        sum_of_teeth = teeth[0] + teeth[1] if self.signs(pair) > 0 else abs(teeth[0] - teeth[1])
        return tuple(float(np.linalg.norm(between)) * number / sum_of_teeth for number in teeth)

    def _pitch_point(self, pair: _Pair) -> Array:
        """Return the point where the pitch circles of a contact touch; of belts the middle between the axes."""
        lines = [self.lines[name] for name in pair.lines]
        here = lines[0].at(self.places[pair.number])
        if len(lines) == 1:
            e1 = np.array(self.transverse(lines[0])[0])
            return np.asarray(here + self._radii(pair)[0] * e1)
        if not pair.parallel and pair.rolling:
            element, _, distance = self.cones(pair)
            return np.asarray(lines[0].at(_nearest_place(lines[0], lines[1])) + distance * element)
        there = lines[1].at(self._along(lines[1], here))
        towards = (there - here) / np.linalg.norm(there - here)
        if pair.rolling and pair.parallel and self.signs(pair) < 0:
            (_, one), (_, two) = pair.contact.gears
            towards = towards if abs(one) > abs(two) else -towards
        return np.asarray(here + self._radii(pair)[0] * towards)

    def _mesh_points(self) -> Iterator[MeshPoint]:
        for pair in self.pairs:
            yield MeshPoint(
                mesh=pair.mesh.name,
                carrier=pair.contact.carrier,
                point=_vector(self._pitch_point(pair)),
                flexible=pair.mesh.kind in {"belt", "chain"},
            )

    def _meshed(self, gears: list[GearShape]) -> list[GearShape]:
        """Turn the gears so that teeth meet gaps, as far as the places of planets allow it all round."""
        keys = list(dict.fromkeys(pair.key(which) for pair in self.pairs for which in range(len(pair.lines))))
        by_key = dict(zip(keys, gears, strict=True))
        turned: set[tuple[object, ...]] = set()
        for _ in self.pairs:
            for pair in self.pairs:
                if len(pair.lines) < 2 or not pair.rolling:  # noqa: PLR2004
                    continue
                one, two = pair.key(0), pair.key(1)
                if one in turned and two in turned:
                    continue
                driver, driven = (two, one) if two in turned else (one, two)
                angle = self._meshing_angle(by_key[driver], by_key[driven], self._pitch_point(pair))
                by_key[driven] = replace(by_key[driven], tooth_rad=angle)
                turned |= {driver, driven}
        return list(by_key.values())

    def _meshing_angle(self, one: GearShape, two: GearShape, point: Array) -> float:
        """Return the tooth angle of the second gear whose gap is where the first one has a tooth."""
        angles, tangents = [], []
        for gear in (one, two):
            e1, e2 = (np.array(axis) for axis in transverse_axes(gear.axis, _vector(self.normal)))
            arm = point - np.array(gear.centre)
            angles.append(math.atan2(arm @ e2, arm @ e1))
            tangents.append(np.cross(gear.axis, arm))
        sense = math.copysign(1.0, float(tangents[0] @ tangents[1]))
        past = (angles[0] - one.tooth_rad) * one.teeth / (2 * math.pi)  # pitches from a tooth of the first gear
        pitch = 2 * math.pi / two.teeth
        return (angles[1] - (sense * past + 0.5) * pitch) % pitch

    def _rods(self, gears: list[GearShape]) -> tuple[list[Rod], list[GearShape]]:
        """Return carrier arms, webs of ring gears and shafts."""
        arms = [rod for body in self.mechanism.joints for rod in self._arm(body, gears)]
        webs = [rod for gear in gears for rod in self._web(gear, arms)]
        return [*arms, *webs, *self._shafts(gears, [*arms, *webs])], gears

    def _arm(self, body: str, gears: list[GearShape]) -> Iterator[Rod]:
        """Yield the arm that carries a planet: its pin, and the way from there to the carrier's axis."""
        joint = self.mechanism.joints[body]
        if joint.carried_by == self.mechanism.frame:
            return
        line, main = self.lines[joint.axis], self.lines[self.mechanism.joints[joint.carried_by].axis]
        own = [gear for gear in gears if gear.body == body and _on(gear, line)]
        if not own:
            return
        spans = [
            (
                self._along(line, np.array(gear.centre)) - gear.face / 2,
                self._along(line, np.array(gear.centre)) + gear.face / 2,
            )
            for gear in own
        ]
        face = min(gear.face for gear in own)
        radius = 0.25 * min(gear.radius for gear in own)
        side = self._arm_side(gears, own, line, main)
        low, high = min(low for low, _ in spans), max(high for _, high in spans)
        if np.linalg.norm(np.cross(line.direction, main.direction)) > _PARALLEL:
            apex = _nearest_place(line, main)  # a bevel planet is held on the side away from the apex
            side = 1.0 if high - apex > apex - low else -1.0
        far, near = (high, low) if side > 0 else (low, high)
        pin = [line.at(near - side * 0.1 * face), line.at(far + side * 0.3 * face)]
        height = self._along(main, pin[1])
        foot = main.at(height)
        rims = [g for g in gears if g.body == joint.carried_by and _on(g, main) and g.radius > _distance(main, pin[1])]
        if rims:  # the carrier is a gear itself, as the cage of a differential: the pin stands on its face
            rim = self._along(main, np.array(rims[0].centre))
            foot = pin[1] + (rim + math.copysign(rims[0].face / 2, height - rim) - height) * main.direction
        elif np.linalg.norm(np.cross(line.direction, main.direction)) > _PARALLEL:
            height = max(height, main.end + 0.15 * face)
            foot = main.at(height)
            pin.append(pin[1] + (height - self._along(main, pin[1])) * main.direction)
        points = tuple(map(_vector, [*pin, foot]))
        yield Rod(body=joint.carried_by, kind="arm", points=points, radius=min(radius, 0.2 * face), planet=body)

    def _arm_side(self, gears: list[GearShape], own: list[GearShape], line: _Line, main: _Line) -> float:
        """Return on which side of its gears a planet is held: away from where a sun's shaft goes on to other stages."""
        here = self._along(main, np.array(own[0].centre))
        mates = {
            self.mechanism.bodies[link]
            for pair in self.pairs
            for link, teeth in pair.contact.gears
            if teeth > 0 and any(self.mechanism.bodies[name] == own[0].body for name, _ in pair.contact.gears)
        } - {own[0].body}
        others = [
            self._along(main, np.array(gear.centre)) - here for gear in gears if gear.body in mates and _on(gear, main)
        ]
        towards = sum(others)
        return (
            -math.copysign(1.0, float(line.direction @ main.direction))
            if towards > _PARALLEL
            else math.copysign(1.0, float(line.direction @ main.direction))
        )

    def _web(self, gear: GearShape, arms: list[Rod]) -> Iterator[Rod]:
        """Yield the web between the rim of a turning ring gear and its axis, on the side away from the carrier."""
        if not gear.internal or gear.body == self.mechanism.frame:
            return
        line = self._line_of(gear)
        here = self._along(line, np.array(gear.centre))
        near = [self._along(line, np.array(arm.points[-1])) - here for arm in arms]
        side = -math.copysign(1.0, min(near, key=abs, default=1.0))
        at = here if gear.cone_rad else here + side * 0.75 * gear.face
        e1 = np.array(self.transverse(line)[0])
        rims = [line.at(at) + sign * 1.08 * gear.radius * e1 for sign in (1, -1)]
        yield Rod(
            body=gear.body,
            kind="web",
            points=tuple(map(_vector, (rims[0], line.at(at), rims[1]))),
            radius=0.1 * gear.face,
        )

    def _shafts(self, gears: list[GearShape], rods: list[Rod]) -> Iterator[Rod]:
        """Yield the shaft of each body on its axis; the first and the last one on an axis reach beyond all gears."""
        for name, line in self.lines.items():
            on_line = [body for body, joint in self.mechanism.joints.items() if joint.axis == name]
            places = {body: self._places_on(line, body, gears, rods) for body in on_line}
            on_line = [body for body in on_line if places[body]]
            for body in on_line:
                if self.mechanism.joints[body].carried_by != self.mechanism.frame:
                    continue  # a planet turns on its pin
                own = [gear for gear in gears if gear.body == body and _on(gear, line)]
                smallest = min((gear.radius for gear in own if not gear.internal), default=0.0)
                face = min((gear.face for gear in own), default=self._usual_face(gears))
                middle = sum(places[body]) / len(places[body])
                means = {other: sum(places[other]) / len(places[other]) for other in on_line}
                low, high = min(places[body]) - 0.5 * face, max(places[body]) + 0.5 * face
                first = middle <= min(means.values()) and body == min(on_line, key=lambda each: means[each])
                last = body == max(reversed(on_line), key=lambda each: means[each])
                low = min(low, line.start - 1.5 * face) if first else low
                high = max(high, line.end + 1.5 * face) if last else high
                radius = min(0.3 * smallest, 0.25 * face) if smallest else 0.2 * face
                yield Rod(
                    body=body, kind="shaft", points=(_vector(line.at(low)), _vector(line.at(high))), radius=radius
                )

    def _usual_face(self, gears: list[GearShape]) -> float:
        return median([gear.face for gear in gears] or [10.0])

    def _places_on(self, line: _Line, body: str, gears: list[GearShape], rods: list[Rod]) -> list[float]:
        """Return where along an axis a body has gears, arms and webs."""
        points = [
            gear.centre for gear in gears if gear.body == body and _on(gear, line) and not self._is_ring(gear, line)
        ]
        for rod in rods:
            foot = rod.points[1] if rod.kind == "web" else rod.points[-1]
            points += [foot] if rod.body == body and _distance(line, np.array(foot)) < 1e-6 else []  # noqa: PLR2004
        return [self._along(line, np.array(point)) for point in points]

    @staticmethod
    def _is_ring(gear: GearShape, line: _Line) -> bool:
        return gear.internal and not gear.cone_rad and _on(gear, line)

    def _line_of(self, gear: GearShape) -> _Line:
        return next(line for line in self.lines.values() if _on(gear, line))

    # ---- bearings --------------------------------------------------------------------------------------------

    def _bearings(self, gears: list[GearShape], rods: list[Rod]) -> tuple[list[BearingShape], list[Rod]]:
        """Return the bearings, and the rods with shafts as long as their bearings need."""
        found: list[BearingShape] = []
        for bearing in self.gearbox.bearings:
            for inner, outer in self._rings(bearing):
                found += self._on_shaft(bearing, inner, outer, gears, rods)
        return found, rods

    def _rings(self, bearing: Bearing) -> list[tuple[str, str]]:
        """Return the links of inner and outer ring of each copy."""
        inner, outer = (self.gearbox.instances(ring) for ring in (bearing.inner_ring, bearing.outer_ring))
        copies = max(len(inner), len(outer))
        return [(inner[n % len(inner)], outer[n % len(outer)]) for n in range(copies)]

    def _on_shaft(
        self, bearing: Bearing, inner: str, outer: str, gears: list[GearShape], rods: list[Rod]
    ) -> Iterator[BearingShape]:
        bodies = [self.mechanism.bodies[link] for link in (inner, outer)]
        axis = self.mechanism.shared_axis(*bodies)
        if axis is None:
            return
        line = self.lines[axis]
        planet = next((body for body in bodies if self._is_planet(body)), None)
        if planet is not None:
            places = [self._along(line, np.array(g.centre)) for g in gears if g.body == planet and _on(g, line)]
            low = high = sum(places) / len(places) if places else 0.0
        else:
            shaft = next((rod for rod in rods if rod.kind == "shaft" and rod.body in bodies), None)
            ends = [0.0, 0.0] if shaft is None else [self._along(line, np.array(point)) for point in shaft.points]
            low, high = ends[0] + 0.15 * (ends[1] - ends[0]), ends[1] - 0.15 * (ends[1] - ends[0])
        own = [rod.radius for rod in rods if rod.body in bodies and rod.kind != "web"]
        usual = 1.8 * max(own, default=0.2 * self._usual_face(gears))
        radius = bearing.pitch_diameter_mm / 2 if bearing.pitch_diameter_mm and self.any_module else usual
        ratio = (bearing.element_diameter_mm or 0.2) / (bearing.pitch_diameter_mm or 1.0)
        multiples = bearing.multiples
        count = bearing.elements or (round(multiples.inner + multiples.outer) if multiples else 8)
        for number, name in enumerate(bearing.names):
            place = low + (high - low) * (number / max(1, len(bearing.names) - 1))
            if bearing.position_mm is not None and self.any_module:
                place = bearing.position_mm[number]
            yield BearingShape(
                name=name,
                inner=inner,
                outer=outer,
                centre=_vector(line.at(place)),
                axis=_vector(line.direction),
                radius=radius,
                element_radius=radius * ratio if self.any_module else radius * max(ratio, 0.25),
                elements=count,
            )

    def _is_planet(self, body: str) -> bool:
        joint = self.mechanism.joints.get(body)
        return joint is not None and joint.carried_by != self.mechanism.frame

    def _scale_notes(self) -> Iterator[str]:
        without = [name for name, mesh in self.meshes.items() if mesh.module_mm is None]
        if without:
            which = "" if len(without) == len(self.meshes) else f" of {', '.join(without)}"
            yield (
                f"Not to scale: no module_mm{which} is declared, so radii go by the numbers of teeth"
                f"{' of each stage' if len(self.meshes) > 1 else ''}."
            )
        elif self.meshes:
            yield "Pitch circles are to scale."
        free = [mesh for mesh in self.meshes.values() if mesh.position_mm is None]
        if free and len(self.meshes) > 1:
            yield "Positions along the axes are schematic."
        if any(mesh.kind for mesh in self.meshes.values()):
            yield "Centre distances of belts and chains, and diameters of worms, are schematic."
        yield from self.notes


def _joined(shapes: list[GearShape]) -> GearShape:
    """Return one gear of its shapes in several contacts."""
    first = shapes[0]
    axis, centres = np.array(first.axis), np.array([shape.centre for shape in shapes])
    along = (centres - centres[0]) @ axis
    low = min(float(place) - shape.face / 2 for place, shape in zip(along, shapes, strict=True))
    high = max(float(place) + shape.face / 2 for place, shape in zip(along, shapes, strict=True))
    return replace(
        first,
        meshes=tuple(dict.fromkeys(mesh for shape in shapes for mesh in shape.meshes)),
        centre=_vector(centres[0] + (low + high) / 2 * axis) if not first.cone_rad else first.centre,
        radius=float(np.mean([shape.radius for shape in shapes])),
        face=high - low if not first.cone_rad else first.face,
    )


def _declared(gearbox: Gearbox, instance: str) -> str:
    return next((link for link in gearbox.copied if instance in gearbox.instances(link)), instance)


def _on(gear: GearShape, line: _Line) -> bool:
    """Return whether a gear turns about a line."""
    along = np.linalg.norm(np.cross(gear.axis, line.direction)) < 1e-6  # noqa: PLR2004
    return bool(along) and _distance(line, np.array(gear.centre)) < 1e-6 * max(gear.radius, 1.0)


def _distance(line: _Line, point: Array) -> float:
    return float(np.linalg.norm(np.cross(point - line.at(0.0), line.direction)))


def _nearest_place(line: _Line, other: _Line) -> float:
    """Return where along a line another one that is not parallel passes it nearest."""
    between = other.at(0.0) - line.at(0.0)
    cosine = float(line.direction @ other.direction)
    return float((line.direction - cosine * other.direction) @ between) / (1 - cosine**2)


def _rotated(vector: Array, about: Array, angle: float) -> Array:
    """Return a vector rotated about a unit vector (Rodrigues)."""
    along = (about @ vector) * about
    return np.asarray(along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(about, vector))


def _orthogonal(direction: Array) -> Array:
    normal = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    return np.asarray(normal / np.linalg.norm(normal))


def _vector(values: Array | Vector) -> Vector:
    x, y, z = (float(round(value, 12)) + 0.0 for value in values)
    return (x, y, z)
