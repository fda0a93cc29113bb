"""Bodies on placed axes: gears, rotated so that teeth meet gaps, carrier arms, webs of ring gears, shafts, bearings."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from statistics import median
from typing import Any

import numpy as np

from hums.gearbox.components import Bearing
from hums.gearbox.layout.shapes import (
    PARALLEL,
    Array,
    BearingShape,
    GearShape,
    Line,
    MeshPoint,
    Rod,
    nearest_place,
    transverse_axes,
    vector,
)
from hums.gearbox.layout.stages import Pair, Stages

_Key = tuple[str, int, str, str]  # of `Pair.key`


def gear_shapes(stages: Stages) -> list[GearShape]:
    """Return the gears; a gear in several contacts has the mean of their radii and spans their planes."""
    found: dict[_Key, list[GearShape]] = {}
    for pair in stages.pairs:
        for which, shape in enumerate(_shapes(stages, pair)):
            found.setdefault(pair.key(which), []).append(shape)
    return _meshed(stages, {key: _joined(shapes) for key, shapes in found.items()})


def _shapes(stages: Stages, pair: Pair) -> Iterator[GearShape]:
    """Yield the gears of one contact."""
    lines = [stages.lines[name] for name in pair.lines]
    place, face = stages.places[pair.number], stages.face(pair)
    radii = _radii(stages, pair)
    for which, (link, teeth) in enumerate(pair.contact.gears):
        line, cone = lines[which], 0.0
        centre = line.at(line.along(lines[0].at(place)))
        internal = teeth < 0 and pair.parallel and pair.mesh.kind is None
        if not pair.parallel and pair.rolling:
            _, angles, distance = stages.cones(pair)
            cone = angles[which]
            centre = line.at(nearest_place(line, lines[1 - which]) + distance * math.cos(cone))
            face = min(face, distance / 3) if not pair.mesh.face_width_mm else face
            internal = _is_inner_cone(stages, pair, which)
        elif not pair.parallel:
            centre = line.at(nearest_place(line, lines[1 - which]))
        yield GearShape(
            link=link,
            declared=stages.gearbox.copy_links.get(link, link),
            body=stages.mechanism.bodies[link],
            teeth=abs(teeth),
            internal=internal,
            meshes=(pair.mesh.name,),
            centre=vector(centre),
            axis=vector(line.direction),
            radius=radii[which],
            face=face,
            cone_rad=cone,
        )


def _is_inner_cone(stages: Stages, pair: Pair, which: int) -> bool:
    """Return whether a bevel gear encloses its mate in its cone."""
    _, angles, _ = stages.cones(pair)
    axes = [stages.lines[name].direction for name in pair.lines]
    cosines = [math.cos(angle) for angle in angles]
    one_side = math.copysign(1.0, cosines[0] * cosines[1]) * (float(axes[0] @ axes[1]) - cosines[0] * cosines[1]) > 0
    sines = [math.sin(angle) for angle in angles]
    return one_side and sines[which] > sines[1 - which]


def _radii(stages: Stages, pair: Pair) -> tuple[float, ...]:
    """Return the operating pitch radii of a contact."""
    teeth = [abs(number) for _, number in pair.contact.gears]
    if len(teeth) == 1:
        return (teeth[0] * pair.module / 2,)
    if not pair.parallel and pair.rolling:
        _, angles, distance = stages.cones(pair)
        return tuple(distance * math.sin(angle) for angle in angles)
    if not pair.parallel:
        return stages.crossed_radii(pair)
    if not pair.rolling:
        return tuple(number * pair.module / 2 for number in teeth)
    lines = [stages.lines[name] for name in pair.lines]
    between = np.cross(lines[1].at(0.0) - lines[0].at(0.0), lines[0].direction)
    sum_of_teeth = teeth[0] + teeth[1] if stages.signs(pair) > 0 else abs(teeth[0] - teeth[1])
    return tuple(float(np.linalg.norm(between)) * number / sum_of_teeth for number in teeth)


def _pitch_point(stages: Stages, pair: Pair) -> Array:
    """Return the point where the pitch circles of a contact touch; for belts the midpoint between the axes."""
    lines = [stages.lines[name] for name in pair.lines]
    here = lines[0].at(stages.places[pair.number])
    if len(lines) == 1:
        e1 = np.array(stages.transverse(lines[0])[0])
        return np.asarray(here + _radii(stages, pair)[0] * e1)
    if not pair.parallel and pair.rolling:
        element, _, distance = stages.cones(pair)
        return np.asarray(lines[0].at(nearest_place(lines[0], lines[1])) + distance * element)
    there = lines[1].at(lines[1].along(here))
    towards = (there - here) / np.linalg.norm(there - here)
    if pair.rolling and pair.parallel and stages.signs(pair) < 0:
        (_, one), (_, two) = pair.contact.gears
        towards = towards if abs(one) > abs(two) else -towards
    return np.asarray(here + _radii(stages, pair)[0] * towards)


def mesh_points(stages: Stages) -> Iterator[MeshPoint]:
    """Yield the pitch point of each contact."""
    for pair in stages.pairs:
        yield MeshPoint(
            mesh=pair.mesh.name,
            carrier=pair.contact.carrier,
            point=vector(_pitch_point(stages, pair)),
            flexible=pair.mesh.kind in {"belt", "chain"},
        )


def _meshed(stages: Stages, by_key: dict[_Key, GearShape]) -> list[GearShape]:
    """Rotate the gears so that teeth meet gaps, as far as the positions of planets allow."""
    turned: set[_Key] = set()
    for _ in stages.pairs:
        for pair in stages.pairs:
            if len(pair.lines) < 2 or not pair.rolling:  # noqa: PLR2004
                continue
            one, two = pair.key(0), pair.key(1)
            if one in turned and two in turned:
                continue
            driver, driven = (two, one) if two in turned else (one, two)
            angle = _meshing_angle(stages, by_key[driver], by_key[driven], _pitch_point(stages, pair))
            by_key[driven] = replace(by_key[driven], tooth_rad=angle)
            turned |= {driver, driven}
    return list(by_key.values())


def _meshing_angle(stages: Stages, one: GearShape, two: GearShape, point: Array) -> float:
    """Return the tooth angle of the second gear that puts a gap at a tooth of the first."""
    angles, tangents = [], []
    for gear in (one, two):
        e1, e2 = (np.array(axis) for axis in transverse_axes(gear.axis, vector(stages.normal)))
        arm = point - np.array(gear.centre)
        angles.append(math.atan2(arm @ e2, arm @ e1))
        tangents.append(np.cross(gear.axis, arm))
    sense = math.copysign(1.0, float(tangents[0] @ tangents[1]))
    past = (angles[0] - one.tooth_rad) * one.teeth / (2 * math.pi)  # pitches from a tooth of the first gear
    pitch = 2 * math.pi / two.teeth
    return (angles[1] - (sense * past + 0.5) * pitch) % pitch


def _joined(shapes: list[GearShape]) -> GearShape:
    """Combine the shapes of a gear in several contacts."""
    first = shapes[0]
    axis, centres = np.array(first.axis), np.array([shape.centre for shape in shapes])
    along = (centres - centres[0]) @ axis
    low = min(float(place) - shape.face / 2 for place, shape in zip(along, shapes, strict=True))
    high = max(float(place) + shape.face / 2 for place, shape in zip(along, shapes, strict=True))
    return replace(
        first,
        meshes=tuple(dict.fromkeys(mesh for shape in shapes for mesh in shape.meshes)),
        centre=vector(centres[0] + (low + high) / 2 * axis) if not first.cone_rad else first.centre,
        radius=float(np.mean([shape.radius for shape in shapes])),
        face=high - low if not first.cone_rad else first.face,
    )


def rods_of(stages: Stages, gears: list[GearShape]) -> list[Rod]:
    """Return carrier arms, webs of ring gears and shafts."""
    arms = [rod for body in stages.mechanism.joints for rod in _arm(stages, body, gears)]
    webs = [rod for gear in gears for rod in _web(stages, gear, arms)]
    return [*arms, *webs, *_shafts(stages, gears, [*arms, *webs])]


def _arm(stages: Stages, body: str, gears: list[GearShape]) -> Iterator[Rod]:
    """Yield the arm that carries a planet: its pin, and the connection to the carrier's axis."""
    joint = stages.mechanism.joints[body]
    if joint.carried_by == stages.mechanism.frame:
        return
    line, main = stages.lines[joint.axis], stages.lines[stages.mechanism.joints[joint.carried_by].axis]
    own = [gear for gear in gears if gear.body == body and gear.turns_about(line)]
    if not own:
        return
    places = [(line.along(np.array(gear.centre)), gear.face / 2) for gear in own]
    face = min(gear.face for gear in own)
    radius = 0.25 * min(gear.radius for gear in own)
    side = _arm_side(stages, gears, own, line, main)
    low, high = min(at - half for at, half in places), max(at + half for at, half in places)
    if np.linalg.norm(np.cross(line.direction, main.direction)) > PARALLEL:
        apex = nearest_place(line, main)  # a bevel planet is held on the side opposite the apex
        side = 1.0 if high - apex > apex - low else -1.0
    far, near = (high, low) if side > 0 else (low, high)
    pin = [line.at(near - side * 0.1 * face), line.at(far + side * 0.3 * face)]
    height = main.along(pin[1])
    foot = main.at(height)
    rims = [
        g for g in gears if g.body == joint.carried_by and g.turns_about(main) and g.radius > main.distance_to(pin[1])
    ]
    if rims:  # the carrier is a gear, such as the cage of a differential: the pin is on its face
        rim = main.along(np.array(rims[0].centre))
        foot = pin[1] + (rim + math.copysign(rims[0].face / 2, height - rim) - height) * main.direction
    elif np.linalg.norm(np.cross(line.direction, main.direction)) > PARALLEL:
        height = max(height, main.end + 0.15 * face)
        foot = main.at(height)
        pin.append(pin[1] + (height - main.along(pin[1])) * main.direction)
    points = tuple(map(vector, [*pin, foot]))
    yield Rod(body=joint.carried_by, kind="arm", points=points, radius=min(radius, 0.2 * face), planet=body)


def _arm_side(stages: Stages, gears: list[GearShape], own: list[GearShape], line: Line, main: Line) -> float:
    """Return the side on which a planet is held, opposite to where a sun's shaft continues to other stages."""
    here = main.along(np.array(own[0].centre))
    mates = {
        stages.mechanism.bodies[link]
        for pair in stages.pairs
        for link, teeth in pair.contact.gears
        if teeth > 0 and any(stages.mechanism.bodies[name] == own[0].body for name, _ in pair.contact.gears)
    } - {own[0].body}
    others = [
        main.along(np.array(gear.centre)) - here for gear in gears if gear.body in mates and gear.turns_about(main)
    ]
    along = math.copysign(1.0, float(line.direction @ main.direction))
    return -along if sum(others) > PARALLEL else along


def _web(stages: Stages, gear: GearShape, arms: list[Rod]) -> Iterator[Rod]:
    """Yield the web between the rim of a rotating ring gear and its axis, on the side opposite the carrier."""
    if not gear.internal or gear.body == stages.mechanism.frame:
        return
    line = _line_of(stages, gear)
    here = line.along(np.array(gear.centre))
    near = [line.along(np.array(arm.points[-1])) - here for arm in arms]
    side = -math.copysign(1.0, min(near, key=abs, default=1.0))
    at = here if gear.cone_rad else here + side * 0.75 * gear.face
    e1 = np.array(stages.transverse(line)[0])
    rims = [line.at(at) + sign * 1.08 * gear.radius * e1 for sign in (1, -1)]
    yield Rod(
        body=gear.body,
        kind="web",
        points=tuple(map(vector, (rims[0], line.at(at), rims[1]))),
        radius=0.1 * gear.face,
    )


def _shafts(stages: Stages, gears: list[GearShape], rods: list[Rod]) -> Iterator[Rod]:
    """Yield the shaft of each body on its axis; the first and last on an axis extend beyond all gears."""
    for name, line in stages.lines.items():
        on_line = [body for body, joint in stages.mechanism.joints.items() if joint.axis == name]
        places = {body: _places_on(line, body, gears, rods) for body in on_line}
        on_line = [body for body in on_line if places[body]]
        for body in on_line:
            if stages.mechanism.joints[body].carried_by != stages.mechanism.frame:
                continue  # a planet rotates on its pin
            own = [gear for gear in gears if gear.body == body and gear.turns_about(line)]
            smallest = min((gear.radius for gear in own if not gear.internal), default=0.0)
            face = min((gear.face for gear in own), default=usual_face(gears))
            middle = sum(places[body]) / len(places[body])
            means = {other: sum(places[other]) / len(places[other]) for other in on_line}
            low, high = min(places[body]) - 0.5 * face, max(places[body]) + 0.5 * face
            first = middle <= min(means.values()) and body == min(on_line, key=lambda each: means[each])
            last = body == max(reversed(on_line), key=lambda each: means[each])
            low = min(low, line.start - 1.5 * face) if first else low
            high = max(high, line.end + 1.5 * face) if last else high
            radius = min(0.3 * smallest, 0.25 * face) if smallest else 0.2 * face
            yield Rod(body=body, kind="shaft", points=(vector(line.at(low)), vector(line.at(high))), radius=radius)


def usual_face(gears: list[GearShape]) -> float:
    """Return the median face width."""
    return median([gear.face for gear in gears] or [10.0])


def _places_on(line: Line, body: str, gears: list[GearShape], rods: list[Rod]) -> list[float]:
    """Return the positions of a body's gears, arms and webs along an axis."""
    points = [
        gear.centre for gear in gears if gear.body == body and gear.turns_about(line) and not _is_ring(gear, line)
    ]
    for rod in rods:
        foot = rod.points[1] if rod.kind == "web" else rod.points[-1]
        points += [foot] if rod.body == body and line.distance_to(np.array(foot)) < 1e-6 else []  # noqa: PLR2004
    return [line.along(np.array(point)) for point in points]


def _is_ring(gear: GearShape, line: Line) -> bool:
    return gear.internal and not gear.cone_rad and gear.turns_about(line)


def _line_of(stages: Stages, gear: GearShape) -> Line:
    return next(line for line in stages.lines.values() if gear.turns_about(line))


def bearing_shapes(stages: Stages, gears: list[GearShape], rods: list[Rod]) -> Iterator[BearingShape]:
    """Yield the bearings, each copy between its rings; without positions they are spread along their shaft."""
    spans: dict[tuple[str, float, float], list[partial[BearingShape]]] = {}
    for bearing in stages.gearbox.bearings:
        for inner, outer in _rings(stages, bearing):
            bodies = [stages.mechanism.bodies[link] for link in (inner, outer)]
            axis = stages.mechanism.shared_axis(*bodies)
            if axis is None:
                continue
            free, sizes = _span(stages, bodies, axis, gears, rods), _sizes(stages, bearing, bodies, gears, rods)
            for number, name in enumerate(bearing.names):
                at = bearing.position_mm[number] if bearing.position_mm and stages.any_module else None
                shape = partial(BearingShape, name=name, inner=inner, outer=outer, **sizes)
                spans.setdefault((axis, *(free if at is None else (at, at))), []).append(shape)
    for (axis, low, high), shapes in spans.items():
        line = stages.lines[axis]
        for place, shape in zip(np.linspace(low, high, len(shapes)), shapes, strict=True):
            yield shape(centre=vector(line.at(float(place))), axis=vector(line.direction))


def _rings(stages: Stages, bearing: Bearing) -> list[tuple[str, str]]:
    """Return the links of inner and outer ring of each copy."""
    inner, outer = (stages.gearbox.instances(ring) for ring in (bearing.inner_ring, bearing.outer_ring))
    copies = max(len(inner), len(outer))
    return [(inner[n % len(inner)], outer[n % len(outer)]) for n in range(copies)]


def _span(stages: Stages, bodies: list[str], axis: str, gears: list[GearShape], rods: list[Rod]) -> tuple[float, float]:
    """Return the range along an axis for the bearings of two bodies, the first of which is at one end."""
    line = stages.lines[axis]
    joints, frame = stages.mechanism.joints, stages.mechanism.frame
    planet = next((body for body in bodies if body in joints and joints[body].carried_by != frame), None)
    if planet is not None:
        own = [gear for gear in gears if gear.body == planet and gear.turns_about(line)]
        middle = sum(line.along(np.array(gear.centre)) for gear in own) / max(1, len(own))
        return middle, middle + 0.5 * min((gear.face for gear in own), default=0.0)
    shaft = next((rod for rod in rods if rod.kind == "shaft" and rod.body in bodies), None)
    low, high = (0.0, 0.0) if shaft is None else (line.along(np.array(point)) for point in shaft.points)
    return 0.85 * low + 0.15 * high, 0.15 * low + 0.85 * high


def _sizes(
    stages: Stages, bearing: Bearing, bodies: list[str], gears: list[GearShape], rods: list[Rod]
) -> dict[str, Any]:
    own = [rod.radius for rod in rods if rod.body in bodies and rod.kind != "web"]
    usual = 1.8 * max(own, default=0.2 * usual_face(gears))
    radius = bearing.pitch_diameter_mm / 2 if bearing.pitch_diameter_mm and stages.any_module else usual
    ratio = (bearing.element_diameter_mm or 0.2) / (bearing.pitch_diameter_mm or 1.0)
    multiples = bearing.multiples
    return {
        "radius": radius,
        "element_radius": radius * (ratio if stages.any_module else max(ratio, 0.25)),
        "elements": bearing.elements or (round(multiples.inner + multiples.outer) if multiples else 8),
    }
