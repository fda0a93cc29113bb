"""Gears of placed contacts, turned so that teeth meet gaps, and their pitch points."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hums.gearbox.layout.shapes import Array, GearShape, MeshPoint, nearest_place, transverse_axes, vector
from hums.gearbox.layout.stages import Pair, Stages

_Key = tuple[str, int, str, str]  # of `Pair.key`


def gear_shapes(stages: Stages) -> list[GearShape]:
    """Return the gears; one that several contacts share has the mean of their radii and spans their planes."""
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
    """Return whether a bevel gear holds its mate inside its cone."""
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
    """Return the point where the pitch circles of a contact touch; of belts the middle between the axes."""
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
    """Turn the gears so that teeth meet gaps, as far as the places of planets allow it all round."""
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
    """Return the tooth angle of the second gear whose gap is where the first one has a tooth."""
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
    """Return one gear of its shapes in several contacts."""
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
