"""Planets of a scene that pass its sensors: the lines of their ring meshes as the sensors hear them."""

import math
from collections.abc import Sequence

import numpy as np

from data_synth.combs import Comb, Draws
from data_synth.planet_pass import MovingPath, PassWindow, even_places_rad, planet_pass_comb
from data_synth.profile import Array
from data_synth.scene import Scene, SceneError
from hums.gearbox import Axis


def as_they_pass(scene: Scene, combs: Sequence[Comb], *, draws: Draws) -> list[Comb]:
    """Return the combs with those of planets on a ring at rest replaced by what passes the sensors.

    Raises
    ------
    SceneError
        A scene that asks for passing planets of a gearbox without any.
    """
    if scene.planet_pass is None:
        return [*combs]
    rings = _rings(scene)
    if not rings:
        raise SceneError(
            f'planet_pass asks for planets on a ring at rest, but gearbox "{scene.gearbox.name}" has none; '
            "leave it out."
        )
    window = PassWindow(half_width_rad=math.radians(scene.planet_pass.half_width_deg), floor=scene.planet_pass.floor)
    return [_passing(scene, comb, window, rings, draws) if comb.component in rings else comb for comb in combs]


def _passing(scene: Scene, comb: Comb, window: PassWindow, rings: dict[str, tuple[str, int]], draws: Draws) -> Comb:
    planet, teeth = rings[comb.component]
    axis = next(axis for axis in scene.gearbox.axes if planet in axis.links)
    places = _places_rad(axis)
    path = MovingPath(window=window, places_rad=places, strengths=np.ones(places.size))
    return planet_pass_comb(
        path,
        component=comb.component,
        source=comb.source,
        coefficients=comb.coefficients / places.size,  # the scene's amplitude is that of all planets together
        ring_teeth=teeth,
        carrier_order=comb.base / teeth,
        carrier_offset=float(draws("planet pass", comb.component).random()),
    )


def _places_rad(axis: Axis) -> Array:
    """Return where planets stand round their carrier, from the first: even, or as declared by angles or by gaps."""
    count = axis.copies or 1
    if axis.spacing_deg is None:
        return even_places_rad(count)
    given = np.array(axis.spacing_deg)
    return np.asarray(np.radians(given if given[0] == 0 else np.cumsum(given) - given))


def _rings(scene: Scene) -> dict[str, tuple[str, int]]:
    """Return planet and ring teeth of each mesh of planets with a ring at rest."""
    found = {}
    copied = scene.gearbox.copied
    for mesh in scene.gearbox.meshes:
        planets = [gear.link for gear in mesh.gears if gear.link in copied]
        others = [gear for gear in mesh.gears if gear.link not in copied]
        if len(planets) == 1 and len(others) == 1 and scene.ratio(others[0].link) == 0:
            found[mesh.name] = planets[0], abs(others[0].teeth)
    return found
