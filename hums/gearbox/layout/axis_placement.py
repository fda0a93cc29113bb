"""Placement of axes and contacts: as declared, else as contacts require, one after another."""

import math

import numpy as np

from hums.gearbox.layout.shapes import PARALLEL, Array, Line, corner, nearest_place
from hums.gearbox.layout.stages import Pair, Stages

_GAP = 1.0  # between stages on one axis, of the face width


def place(stages: Stages) -> None:
    """Place lines and contacts, in the order of declaration as far as dependencies allow."""
    first = next(iter(stages.lines.values()))
    if all(line.origin is None for line in stages.lines.values()):
        first.origin = np.zeros(3)
    waiting = list(stages.pairs)
    while waiting:
        ready = [pair for pair in waiting if any(stages.lines[name].origin is not None for name in pair.lines)]
        if not ready:
            _place_apart(stages, stages.lines[waiting[0].lines[0]])
            continue
        pair = ready[0]
        waiting.remove(pair)
        _place_contact(stages, pair, waiting)
    for line in stages.lines.values():
        if line.origin is None:
            _place_apart(stages, line)


def _place_apart(stages: Stages, line: Line) -> None:
    """Place a line that no gear connects to the others on one side of them."""
    placed = [other.origin for other in stages.lines.values() if other.origin is not None]
    reach = max((abs(teeth) * pair.module for pair in stages.pairs for _, teeth in pair.contact.gears), default=10.0)
    line.origin = (
        np.mean(placed, axis=0) + 1.5 * reach * np.array(stages.transverse(line)[0]) if placed else np.zeros(3)
    )
    stages.notes.append(f'The position of axis "{line.name}" is not declared; it is drawn on one side.')


def _place_contact(stages: Stages, pair: Pair, waiting: list[Pair]) -> None:
    lines = [stages.lines[name] for name in pair.lines]
    if len(lines) == 1 or pair.parallel:
        unplaced = [line for line in lines if line.origin is None]
        if unplaced:
            _place_adjacent(stages, unplaced[0], pair, waiting)
        _give_slot(stages, pair)
        return
    if lines[0].origin is None or lines[1].origin is None:
        known, other = (lines[0], lines[1]) if lines[1].origin is None else (lines[1], lines[0])
        place = _free_place(stages, pair, known)
        crossing = known.at(place)
        if pair.rolling:
            other.origin = crossing
        else:
            common = np.cross(known.direction, other.direction)
            other.origin = crossing - stages.distance(pair) * common / np.linalg.norm(common)
    stages.places[pair.number] = nearest_place(lines[0], lines[1])
    for which, line in enumerate(lines):
        low, high = _extent(stages, pair, which)
        apex = nearest_place(line, lines[1 - which])
        line.taken.append((apex + low, apex + high))


def _extent(stages: Stages, pair: Pair, which: int) -> tuple[float, float]:
    """Return the extent of a pair with non-parallel axes along one of them, from the point where they intersect."""
    if not pair.rolling:
        reach = max(stages.crossed_radii(pair)[1 - which], stages.face(pair) / 2)
        return -reach, reach
    _, angles, distance = stages.cones(pair)
    mate = distance * math.sin(angles[1 - which])
    own = distance * math.cos(angles[which])
    return min(own, -mate) - 0.1 * mate, max(own, mate) + 0.1 * mate


def _free_place(stages: Stages, pair: Pair, line: Line) -> float:
    """Return the position of the next pair along a placed line: as declared, else beyond the occupied part."""
    if pair.mesh.position_mm is not None and pair.lines[0] == line.name and stages.any_module:
        return pair.mesh.position_mm
    if not line.taken:
        return 0.0
    low, _ = _extent(stages, pair, pair.lines.index(line.name))
    return line.end + _GAP * stages.face(pair) - low


def _place_adjacent(stages: Stages, line: Line, pair: Pair, waiting: list[Pair]) -> None:
    """Place a line parallel to the other one of a contact, or at the two distances required by two contacts."""
    others = [p for p in [pair, *waiting] if p.parallel and len(p.lines) > 1 and line.name in p.lines]
    bounds: dict[str, tuple[Line, Array, float]] = {}
    for each in others:
        mate = stages.lines[each.lines[1 - each.lines.index(line.name)]]
        if mate.origin is not None and mate is not line:
            bounds.setdefault(mate.name, (mate, mate.origin, stages.distance(each)))
    (mate, origin, distance), *more = bounds.values()
    e1, e2 = (np.array(axis) for axis in stages.transverse(mate))
    for _, other, length in more:
        found = corner(origin, other, mate.direction, distances=(distance, length))
        if found is not None:
            line.origin = found
            return
    sides_deg = (0.0, 180.0, 90.0, 270.0, 45.0, 135.0, 225.0, 315.0)
    for degrees in (0.0,) if line.copied else sides_deg:
        angle = line.angle_rad + math.radians(degrees)
        line.origin = origin + distance * (math.cos(angle) * e1 + math.sin(angle) * e2)
        if not _collides(stages, line, pair):
            return


def _collides(stages: Stages, line: Line, pair: Pair) -> bool:
    """Return whether a gear at this position overlaps another that meshes with the same mate."""
    radius = _radius_on(pair, line.name)
    mate = pair.lines[1 - pair.lines.index(line.name)]
    for other in stages.pairs:
        elsewhere = mate not in other.lines or other.contact.carrier != pair.contact.carrier
        if elsewhere or not other.parallel or len(other.lines) < 2:  # noqa: PLR2004
            continue
        neighbour = stages.lines[other.lines[1 - other.lines.index(mate)]]
        if neighbour is line or neighbour.origin is None or line.origin is None:
            continue
        space = float(np.linalg.norm(np.cross(line.origin - neighbour.origin, line.direction)))
        if space < 0.9 * (radius + _radius_on(other, neighbour.name)):
            return True
    return False


def _radius_on(pair: Pair, line: str) -> float:
    return abs(pair.contact.gears[pair.lines.index(line)][1]) * pair.module / 2


def _give_slot(stages: Stages, pair: Pair) -> None:
    """Place a contact of parallel axes along them: as declared, in the plane of one that shares a gear, or next."""
    lines = [stages.lines[name] for name in pair.lines]
    face = stages.face(pair)
    if pair.mesh.position_mm is not None and stages.any_module:
        place = pair.mesh.position_mm
    else:
        shared = [
            other
            for other in stages.pairs
            if other.number in stages.places and other.parallel and not _blocked(stages, pair, other)
        ]
        if shared:
            place = lines[0].along(stages.lines[shared[0].lines[0]].at(stages.places[shared[0].number]))
        elif not any(line.taken for line in lines):
            place = 0.0
        else:
            moves = pair.contact.carrier != stages.mechanism.frame
            space = face * (0.5 + _GAP * (2 if moves else 1))
            ends = [lines[0].along(line.at(line.end)) for line in lines if line.taken]
            place = max(ends) + space
    stages.places[pair.number] = place
    room = face * (0.5 + (_GAP if pair.contact.carrier != stages.mechanism.frame else 0.0))
    for line in lines:
        here = line.along(lines[0].at(place))
        line.taken.append((here - room, here + room))


def _blocked(stages: Stages, pair: Pair, other: Pair) -> bool:
    """Return whether a contact cannot be in the plane of another: they share no gear, or one is in the way."""
    keys = {pair.key(number) for number in range(len(pair.lines))}
    plane = [p for p in stages.pairs if p.number in stages.places and p.parallel and _same_plane(stages, p, other)]
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


def _same_plane(stages: Stages, one: Pair, other: Pair) -> bool:
    points = [stages.lines[pair.lines[0]].at(stages.places[pair.number]) for pair in (one, other)]
    return abs(float((points[0] - points[1]) @ stages.lines[other.lines[0]].direction)) < PARALLEL
