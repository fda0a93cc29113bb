"""Bearings on placed shafts and planets."""

from collections.abc import Iterator

import numpy as np

from hums.gearbox.components import Bearing
from hums.gearbox.layout.axis_geometry import vector
from hums.gearbox.layout.rods import usual_face
from hums.gearbox.layout.shapes import BearingShape, GearShape, Rod
from hums.gearbox.layout.stages import Stages


def bearing_shapes(stages: Stages, gears: list[GearShape], rods: list[Rod]) -> Iterator[BearingShape]:
    """Yield the bearings, each copy of them between its rings."""
    for bearing in stages.gearbox.bearings:
        for inner, outer in _rings(stages, bearing):
            yield from _on_shaft(stages, bearing, inner, outer, gears, rods)


def _rings(stages: Stages, bearing: Bearing) -> list[tuple[str, str]]:
    """Return the links of inner and outer ring of each copy."""
    inner, outer = (stages.gearbox.instances(ring) for ring in (bearing.inner_ring, bearing.outer_ring))
    copies = max(len(inner), len(outer))
    return [(inner[n % len(inner)], outer[n % len(outer)]) for n in range(copies)]


def _on_shaft(
    stages: Stages, bearing: Bearing, inner: str, outer: str, gears: list[GearShape], rods: list[Rod]
) -> Iterator[BearingShape]:
    bodies = [stages.mechanism.bodies[link] for link in (inner, outer)]
    axis = stages.mechanism.shared_axis(*bodies)
    if axis is None:
        return
    line = stages.lines[axis]
    planet = next((body for body in bodies if _is_planet(stages, body)), None)
    if planet is not None:
        places = [line.along(np.array(g.centre)) for g in gears if g.body == planet and g.turns_about(line)]
        low = high = sum(places) / len(places) if places else 0.0
    else:
        shaft = next((rod for rod in rods if rod.kind == "shaft" and rod.body in bodies), None)
        ends = [0.0, 0.0] if shaft is None else [line.along(np.array(point)) for point in shaft.points]
        low, high = ends[0] + 0.15 * (ends[1] - ends[0]), ends[1] - 0.15 * (ends[1] - ends[0])
    own = [rod.radius for rod in rods if rod.body in bodies and rod.kind != "web"]
    usual = 1.8 * max(own, default=0.2 * usual_face(gears))
    radius = bearing.pitch_diameter_mm / 2 if bearing.pitch_diameter_mm and stages.any_module else usual
    ratio = (bearing.element_diameter_mm or 0.2) / (bearing.pitch_diameter_mm or 1.0)
    multiples = bearing.multiples
    count = bearing.elements or (round(multiples.inner + multiples.outer) if multiples else 8)
    for number, name in enumerate(bearing.names):
        place = low + (high - low) * (number / max(1, len(bearing.names) - 1))
        if bearing.position_mm is not None and stages.any_module:
            place = bearing.position_mm[number]
        yield BearingShape(
            name=name,
            inner=inner,
            outer=outer,
            centre=vector(line.at(place)),
            axis=vector(line.direction),
            radius=radius,
            element_radius=radius * ratio if stages.any_module else radius * max(ratio, 0.25),
            elements=count,
        )


def _is_planet(stages: Stages, body: str) -> bool:
    joint = stages.mechanism.joints.get(body)
    return joint is not None and joint.carried_by != stages.mechanism.frame
