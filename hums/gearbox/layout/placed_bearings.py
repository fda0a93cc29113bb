"""Bearings on placed shafts and planets."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from hums.gearbox.components import Bearing
from hums.gearbox.layout.axis_geometry import vector
from hums.gearbox.layout.rods import usual_face
from hums.gearbox.layout.shapes import BearingShape, GearShape, Rod
from hums.gearbox.layout.stages import Stages


def bearing_shapes(stages: Stages, gears: list[GearShape], rods: list[Rod]) -> Iterator[BearingShape]:
    """Yield the bearings, each copy of them between its rings; without positions they share their shaft."""
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
    """Return between which places along an axis the bearings of two bodies stand, the first of them at one end."""
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
