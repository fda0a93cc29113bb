"""Planet pass modulation in a scene: the lines of its ring meshes at the sensors."""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from data_synth.combs import HarmonicFamily, RandomStreams
from data_synth.planet_pass import MovingPath, PassWindow, even_places_rad, planet_pass_family
from data_synth.profile import Array
from data_synth.scene import Scene, SceneError
from hums.gearbox import Axis

_RETAINED = 1e-4


def with_planet_pass(
    scene: Scene, families: Sequence[HarmonicFamily], *, rng_for: RandomStreams
) -> list[HarmonicFamily]:
    """Return the harmonic families, those of planets on a stationary ring gear modulated by the planet pass.

    Raises
    ------
    SceneError
        A scene that asks for planet pass modulation of a gearbox without such planets.
    """
    if scene.planet_pass is None:
        return [*families]
    rings = _rings(scene)
    if not rings:
        raise SceneError(
            f'planet_pass asks for planets on a ring at rest, but gearbox "{scene.gearbox.name}" has none; '
            "leave it out."
        )
    window = pass_window(scene)
    assert window is not None  # noqa: S101 - planet_pass is there
    return [
        _ring_mesh_family(scene, family, window, rings, rng_for) if family.component in rings else family
        for family in families
    ]


def pass_window(scene: Scene) -> PassWindow | None:
    """Return the gain of a planet by its angle from a sensor; None in a scene without planet pass modulation."""
    declared = scene.planet_pass
    if declared is None:
        return None
    return PassWindow(half_width_rad=math.radians(declared.half_width_deg), floor=declared.floor)


def pass_orders(scene: Scene, mesh: str) -> tuple[Fraction, int]:
    """Return the order of a mesh's carrier, and the number of sidebands at its multiples beside each mesh harmonic.

    Those are the lines of the planet pass window down to -80 dB; without a window it is the first, from the rotating
    direction of the mesh force. A mesh whose carrier is the frame has none.
    """
    carrier = next(contact.carrier for contact in scene.kinematics.contacts if contact.mesh == mesh)
    if carrier == scene.kinematics.mechanism.frame:
        return Fraction(0), 0
    window = pass_window(scene)
    if window is None:
        return abs(scene.ratio(carrier)), 1
    lines = np.abs(window.coefficients())
    return abs(scene.ratio(carrier)), int(np.flatnonzero(lines >= _RETAINED * lines[0])[-1])


def _ring_mesh_family(
    scene: Scene, family: HarmonicFamily, window: PassWindow, rings: dict[str, tuple[str, int]], rng_for: RandomStreams
) -> HarmonicFamily:
    """Return the lines of one ring mesh at the sensors."""
    planet, teeth = rings[family.component]
    axis = next(axis for axis in scene.gearbox.axes if planet in axis.links)
    places = _places_rad(axis)
    path = MovingPath(window=window, places_rad=places, strengths=np.ones(places.size))
    return planet_pass_family(
        path,
        component=family.component,
        source=family.source,
        coefficients=family.coefficients / places.size,  # the scene's amplitude is that of all planets together
        ring_teeth=teeth,
        carrier_order=family.base_order / teeth,
        carrier_offset=float(rng_for("planet pass", family.component).random()),
    )


def _places_rad(axis: Axis) -> Array:
    """Return the angles of planets on their carrier, from the first: even, or as declared by angles or by gaps."""
    count = axis.copies or 1
    if axis.spacing_deg is None:
        return even_places_rad(count)
    given = np.array(axis.spacing_deg)
    return np.asarray(np.radians(given if given[0] == 0 else np.cumsum(given) - given))


def _rings(scene: Scene) -> dict[str, tuple[str, int]]:
    """Return planet and ring teeth of each mesh of planets with a stationary ring gear."""
    found = {}
    copied = scene.gearbox.copied
    for mesh in scene.gearbox.meshes:
        planets = [gear.link for gear in mesh.gears if gear.link in copied]
        others = [gear for gear in mesh.gears if gear.link not in copied]
        if len(planets) == 1 and len(others) == 1 and scene.ratio(others[0].link) == 0:
            found[mesh.name] = planets[0], abs(others[0].teeth)
    return found
