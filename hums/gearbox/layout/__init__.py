"""Positions in space of the gears, shafts, carrier arms and bearings of a declared gearbox, for drawings.

Gears are drawn as operating pitch circles, which touch: on parallel axes a distance a apart their radii are
``a z / |z1 +- z2|``; bevel gears have the pitch cones that roll on each other. Undeclared dimensions are schematic, as
`Layout.notes` states: without a declared module lengths are in modules, without positions stages follow in the order of
declaration.
"""

from collections.abc import Iterator

import numpy as np

from hums.gearbox.components import Vector
from hums.gearbox.layout.axis_placement import place
from hums.gearbox.layout.bodies import bearing_shapes, gear_shapes, mesh_points, rods_of
from hums.gearbox.layout.shapes import (
    PARALLEL,
    BearingShape,
    GearShape,
    Layout,
    MeshPoint,
    Rod,
    TurningPair,
    transverse_axes,
    vector,
)
from hums.gearbox.layout.stages import Stages
from hums.gearbox.mechanism import build_mechanism
from hums.gearbox.model import Gearbox

__all__ = ["BearingShape", "GearShape", "Layout", "MeshPoint", "Rod", "TurningPair", "layout_of", "transverse_axes"]


def layout_of(gearbox: Gearbox) -> Layout:
    """Return the positions of the parts of a gearbox in a drawing.

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
        If the gearbox is not a mechanism.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.layout import layout_of
    >>> drawn = layout_of(hums.load_gearbox("planetary-27-36-99"))
    >>> [round(gear.radius, 1) for gear in drawn.gears if gear.link in ("sun", "planet 1", "ring")]
    [27.0, 36.0, 99.0]
    >>> drawn.unit
    'mm'
    """
    stages = Stages(build_mechanism(gearbox))
    place(stages)
    gears = gear_shapes(stages)
    rods = rods_of(stages, gears)
    joints = stages.mechanism.joints
    across, up = _picture(stages)
    return Layout(
        gears=tuple(gears),
        rods=tuple(rods),
        bearings=tuple(bearing_shapes(stages, gears, rods)),
        meshes=tuple(mesh_points(stages)),
        pairs=tuple(
            TurningPair(
                body=body,
                carried_by=joint.carried_by,
                point=vector(stages.lines[joint.axis].at(0.0)),
                direction=vector(stages.lines[joint.axis].direction),
            )
            for body, joint in joints.items()
        ),
        unit="mm" if stages.any_module else "modules",
        across=across,
        up=up,
        planar=all(
            np.linalg.norm(np.cross(line.direction, next(iter(stages.lines.values())).direction)) < PARALLEL
            for line in stages.lines.values()
        ),
        notes=tuple(_scale_notes(stages)),
    )


def _picture(stages: Stages) -> tuple[Vector, Vector]:
    """Return the right and up directions of the section: x and y if they span it, else along the first axis."""
    if abs(abs(stages.normal[2]) - 1) < PARALLEL:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    across = next(iter(stages.lines.values())).direction
    return vector(across), vector(np.cross(stages.normal, across))


def _scale_notes(stages: Stages) -> Iterator[str]:
    without = [name for name, mesh in stages.meshes.items() if mesh.module_mm is None]
    if without:
        which = "" if len(without) == len(stages.meshes) else f" of {', '.join(without)}"
        yield (
            f"Not to scale: no module_mm{which} is declared, so radii are in proportion to the numbers of teeth"
            f"{' of each stage' if len(stages.meshes) > 1 else ''}."
        )
    elif stages.meshes:
        yield "Pitch circles are to scale."
    free = [mesh for mesh in stages.meshes.values() if mesh.position_mm is None]
    if free and len(stages.meshes) > 1:
        yield "Positions along the axes are schematic."
    if any(mesh.kind for mesh in stages.meshes.values()):
        yield "Centre distances of belts and chains, and diameters of worms, are schematic."
    yield from stages.notes
