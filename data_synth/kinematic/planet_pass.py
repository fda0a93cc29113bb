"""Planet meshes: their phases, their modulation as planets pass a sensor, and the resulting lines.

Planet n is at the angle ``theta + psi_n`` from the sensor, theta being the angle of the carrier. The phase of its mesh
with the ring is ``z_r (theta + psi_n)``, and its gain is the window of the same angle. Line ``l z_r + j`` of the
carrier is therefore ``C_l W_j sum_n a_n exp(1j (l z_r + j) psi_n)``: with N equal, evenly spaced planets only those
with ``(l z_r + j) mod N = 0`` reach the sensor (McFadden and Smith 1985, Proc. Inst. Mech. Eng. C 199, 65-70).

A mesh with the sun has the phase ``z_s (theta_s - theta - psi_n)`` and reaches the ring through its planet, with the
same window (Feng and Zuo 2012, J. Sound Vib. 331, 4919-4939): its line ``l z_r + j`` has the phasors of ``j - l z_s``.
Evenly spaced planets require z_s + z_r to be a multiple of N, so that the same lines remain.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.kinematic.harmonics import HarmonicFamily
from data_synth.kinematic.imperfect_parts import carrier_radius_m, planet_displacements_m, planet_loads
from data_synth.kinematic.ring_bending import RingMesh
from data_synth.operation.shaft_angle import Array
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError
from hums.gearbox.components import Axis, planet_angles

ComplexArray = NDArray[np.complex128]

_SMALLEST = 1e-6  # coefficients of a window below this fraction of the largest are neglected
_ROUNDING = 1e-12  # remainder of phasors that cancel, relative to the largest line


@dataclass(frozen=True, kw_only=True)
class PassWindow:
    """Gain of a planet at an angle from the sensor: ``floor + (1 - floor) exp(kappa (cos angle - 1))``.

    Attributes
    ----------
    half_width_rad : float
        Angle at which the modulated part is one half, above 0 and below pi.
    floor : float
        Gain independent of the angle, 0 to 1.
    """

    half_width_rad: float
    floor: float = 0.0

    @property
    def kappa(self) -> float:
        """Concentration of the window."""
        return math.log(2) / (1 - math.cos(self.half_width_rad))

    def gain(self, angle_rad: ArrayLike) -> Array:
        """Return the gain (n,) of a planet at `angle_rad` (n,) from the sensor."""
        passing = np.exp(self.kappa * (np.cos(np.asarray(angle_rad, dtype=np.float64)) - 1))
        return np.asarray(self.floor + (1 - self.floor) * passing)

    def coefficients(self) -> Array:
        """Return W_0, W_1, ... of ``gain = sum_j W_j exp(1j j angle)``, j of either sign, to 1e-6 of the largest."""
        count = 64 * max(1, math.ceil(math.sqrt(self.kappa)))  # the spectrum is a bell of width sqrt(kappa)
        lines = np.fft.rfft(self.gain(2 * np.pi * np.arange(count) / count)).real / count
        superpose = np.flatnonzero(np.abs(lines) >= _SMALLEST * np.max(np.abs(lines)))
        return np.asarray(lines[: superpose[-1] + 1])


@dataclass(frozen=True, kw_only=True)
class MovingPath:
    """Transfer path of each planet to a sensor on the ring gear, modulated by the rotation of the carrier.

    Attributes
    ----------
    window : PassWindow
        Gain by the angle from the sensor.
    places_rad : (N,) array
        Angles psi_n of the planets on the carrier.
    strengths : (N,) array
        Relative amplitude of each planet, 1 if they are equal.
    """

    window: PassWindow
    places_rad: Array = field(metadata={"dims": ("planet",), "units": "rad"})
    strengths: Array = field(metadata={"dims": ("planet",), "units": "1"})

    def phasor_sum(self, lines: ArrayLike) -> ComplexArray:
        """Return ``sum_n strengths_n exp(1j line psi_n)`` at lines (k,) of the carrier."""
        turns = np.exp(1j * np.multiply.outer(np.asarray(lines, dtype=np.float64), np.asarray(self.places_rad)))
        return np.asarray(turns @ np.asarray(self.strengths))


def planet_pass_family(
    path: MovingPath,
    *,
    component: str,
    source: str,
    coefficients: ComplexArray,
    ring_teeth: int | Fraction,
    carrier_order: Fraction,
    carrier_offset: float = 0.0,
    phase_teeth: int | None = None,
) -> HarmonicFamily:
    """Return the lines of planet meshes at a sensor on the ring gear, which replace the harmonics of the mesh.

    Line ``l z_r + j`` of the carrier is the sum of ``C_l W_j`` over all l and j with that order, times the phasor sum
    of ``l z + j``, z being the `phase_teeth`.

    Parameters
    ----------
    path : MovingPath
    component, source : str
        The mesh, and the source of its transfer functions.
    coefficients : (k,) complex array
        C_l of the mesh of one planet at the sensor, l from 1.
    ring_teeth : int or Fraction
        z_r: mesh cycles per revolution of the carrier, relative to a ring at rest or any other gear.
    carrier_order : Fraction
        Absolute value of the revolutions of the carrier, in the frame, per revolution of the reference shaft.
    carrier_offset : float
        Revolutions of the carrier at revolution zero.
    phase_teeth : int, optional
        Teeth z by which the mesh of a planet at psi is ahead, ``z psi``: those of the ring by default; minus those of
        the sun for a mesh with the sun.
    """
    cycles, ahead = Fraction(ring_teeth), ring_teeth if phase_teeth is None else phase_teeth
    windows = path.window.coefficients()
    sidebands = np.arange(-windows.size + 1, windows.size)
    harmonics = np.arange(1, coefficients.size + 1)[:, None]
    # in multiples of the largest common base of the orders of mesh and carrier
    multiples = cycles.numerator * harmonics + cycles.denominator * sidebands
    turned = float(ahead) * harmonics + sidebands
    lines = np.asarray(coefficients)[:, None] * windows[np.abs(sidebands)]
    lines = lines * path.phasor_sum(turned) * np.exp(2j * np.pi * carrier_offset * turned)
    summed = np.zeros(int(np.max(np.abs(multiples))) + 1, dtype=np.complex128)
    np.add.at(summed, np.abs(multiples), np.where(multiples < 0, lines.conj(), lines))
    summed[np.abs(summed) < _ROUNDING * np.max(np.abs(coefficients), initial=0.0) * np.sum(path.strengths)] = 0.0
    return HarmonicFamily(
        component=component,
        kind="gear_mesh",
        source=source,
        base_order=abs(carrier_order) / cycles.denominator,
        coefficients=summed[1:],
        load_dependent=True,
    )


# ---- Planet pass modulation in a scene: the lines of its ring meshes at the sensors ----------------------------------


_RETAINED = 1e-4
_EVERYWHERE = PassWindow(half_width_rad=1.0, floor=1.0)  # the same gain at every angle


def with_planet_pass(
    scene: Scene, families: Sequence[HarmonicFamily], *, rng_for: RandomStreams
) -> list[HarmonicFamily]:
    """Return the harmonic families, those of planets as the sum of one mesh per planet.

    Each mesh has the phase determined by its teeth and the position of its planet. With planet pass modulation, all
    meshes of a carrier in a ring at rest are modulated; otherwise the sensor responds equally to every planet.

    Raises
    ------
    SceneError
        Planet pass modulation of a gearbox without such planets.
    """
    meshes, window = _planet_meshes(scene), pass_window(scene)
    rings = {planets.carrier: name for name, planets in meshes.items() if planets.ring_at_rest}
    if window is not None and not rings:
        raise SceneError(
            f'planet_pass requires planets on a ring at rest, but gearbox "{scene.gearbox.name}" has none; '
            "leave it out."
        )
    return [
        _planet_family(scene, family, meshes[family.component], window, rings, rng_for)
        if family.component in meshes
        else family
        for family in families
    ]


def pass_window(scene: Scene) -> PassWindow | None:
    """Return the gain of a planet as a function of its angle from a sensor; None without planet pass modulation."""
    declared = scene.planet_pass
    if declared is None:
        return None
    return PassWindow(half_width_rad=math.radians(declared.half_width_deg), floor=declared.floor)


def pass_orders(scene: Scene, mesh: str) -> tuple[Fraction, int]:
    """Return the order of the carrier of a mesh, and the number of sidebands at its multiples around mesh harmonics.

    These are the lines of the planet pass window down to -80 dB; without a window there is one, from the rotating
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


def ring_meshes(scene: Scene, *, rng_for: RandomStreams) -> list[RingMesh]:
    """Return the meshes of a kinematic scene whose planets pass the sensors."""
    meshes = _planet_meshes(scene)
    rings = {planets.carrier: name for name, planets in meshes.items() if planets.ring_at_rest}
    found = []
    for name, planets in meshes.items():
        if planets.ring_at_rest:
            axis, places = _places_on_carrier(scene, name, planets, rng_for=rng_for)
            ahead = places + 2 * np.pi * _carrier_offset(rings[planets.carrier], rng_for=rng_for)
            sense = 1 if scene.ratio(planets.carrier) > 0 else -1
            shares = planet_loads(scene, axis, rng_for=rng_for)
            found.append(RingMesh(mesh=name, carrier=planets.carrier, places_rad=sense * ahead, shares=shares))
    return found


def _carrier_offset(ring_mesh: str, *, rng_for: RandomStreams) -> float:
    """Draw the angle in revolutions of a carrier from the sensor at revolution zero, in its direction of rotation."""
    return float(rng_for("planet pass", ring_mesh).random())


def _places_on_carrier(
    scene: Scene, mesh_name: str, planets: "_PlanetMesh", *, rng_for: RandomStreams
) -> tuple[Axis, Array]:
    """Return the axis of the planets of a mesh, and their angles (N,) in the carrier's sense, with displacements."""
    axis = next(axis for axis in scene.gearbox.axes if planets.planet in axis.links)
    angles_deg = planet_angles(axis.copies or 1, axis.spacing_deg)
    places = np.radians(angles_deg) * (1 if scene.ratio(planets.carrier) > 0 else -1)
    displacements_m = planet_displacements_m(scene, axis, rng_for=rng_for)
    if displacements_m.any():
        mesh = next(mesh for mesh in scene.gearbox.meshes if mesh.name == mesh_name)
        places = places + displacements_m / carrier_radius_m(scene, mesh)
    return axis, places


@dataclass(frozen=True, kw_only=True)
class _PlanetMesh:
    """A mesh between the planets of a rotating carrier and a gear on its axis, or between two sets of planets.

    `phase_teeth` times the angle of a planet, in the sense of the carrier, is the phase by which its mesh is ahead.
    """

    planet: str
    carrier: str
    phase_teeth: int
    ring_at_rest: bool


def _planet_family(
    scene: Scene,
    family: HarmonicFamily,
    planets: _PlanetMesh,
    window: PassWindow | None,
    rings: Mapping[str, str],
    rng_for: RandomStreams,
) -> HarmonicFamily:
    """Return the lines of one planet mesh at the sensors."""
    axis, places = _places_on_carrier(scene, family.component, planets, rng_for=rng_for)
    passes = window is not None and planets.carrier in rings
    path = MovingPath(
        window=window if window is not None and passes else _EVERYWHERE,
        places_rad=places,
        strengths=planet_loads(scene, axis, rng_for=rng_for),
    )
    offset = _carrier_offset(rings[planets.carrier], rng_for=rng_for) if passes else 0.0
    carrier_order = abs(scene.ratio(planets.carrier))
    return planet_pass_family(
        path,
        component=family.component,
        source=family.source,
        coefficients=family.coefficients / places.size,  # the declared amplitude is that of all planets together
        ring_teeth=family.base_order / carrier_order,
        carrier_order=carrier_order,
        carrier_offset=offset,
        phase_teeth=planets.phase_teeth,
    )


def _planet_meshes(scene: Scene) -> dict[str, _PlanetMesh]:
    """Return the meshes whose planets rotate with a carrier in the frame.

    A mesh between two sets of planets is as far ahead as the mesh of either with a gear on the axis of the carrier,
    since the same teeth pass both. Meshes without such a gear are taken to be in phase.
    """
    copied, found = scene.gearbox.copied, dict[str, _PlanetMesh]()
    carriers = {contact.mesh: contact.carrier for contact in scene.kinematics.contacts}
    between = []
    for mesh in scene.gearbox.meshes:
        planets = [gear for gear in mesh.gears if gear.link in copied]
        others = [gear for gear in mesh.gears if gear.link not in copied]
        carrier = carriers[mesh.name]
        speed = scene.ratio(carrier) if planets and carrier != scene.kinematics.mechanism.frame else 0
        if not speed:
            continue
        if len(planets) != 1 or len(others) != 1:
            between.append((mesh.name, planets))
            continue
        passing = (scene.ratio(others[0].link) - speed) / speed
        found[mesh.name] = _PlanetMesh(
            planet=planets[0].link,
            carrier=carrier,
            phase_teeth=-abs(others[0].teeth) if passing > 0 else abs(others[0].teeth),
            ring_at_rest=scene.ratio(others[0].link) == 0,
        )
    gears = {
        (gear.link, gear.teeth): mesh.name for mesh in scene.gearbox.meshes for gear in mesh.gears if mesh.name in found
    }
    for name, planets in between:
        known = next(
            (found[gears[gear.link, gear.teeth]] for gear in planets if (gear.link, gear.teeth) in gears), None
        )
        if known is not None:
            found[name] = replace(known, ring_at_rest=False)
    return found
