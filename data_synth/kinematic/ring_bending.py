"""Static bending of an elastic ring gear under the tooth forces of its planets, and its lines at a sensor on the ring.

A ring supported evenly all round bends between its planets like a free thin ring: in two or more waves around the
circumference, without extension of its centre line. Under a force F_r outwards and F_t along the circle at the angle
alpha, at the radius ``R - e`` of the teeth, the centre line of radius R moves outwards by

    w(theta) = R^3 / (pi E I) sum_n (F_r cos n(theta - alpha) + k_n F_t sin n(theta - alpha)) / (n^2 - 1)^2, n >= 2,
    k_n = (1 - e / R) / n + n e / R

(virtual work of the bending energy ``E I / (2 R^3) integral (w'' + w)^2``: Timoshenko, Strength of Materials, part II,
1956, on rings; k_n adds the couple ``e F_t``). The shape passes a stationary sensor with the carrier, so that the
static force of N equal, evenly spaced planets gives lines only at multiples of N times the carrier order.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from data_synth.kinematic.harmonics import ComplexArray, HarmonicFamily
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene, SceneError, declared_size_mm

_STEEL_PA = 206e9
_DEDENDUM = 1.25  # modules: ISO 53
_ROUNDING = 1e-12  # remainder of lines that cancel, relative to the largest of one planet
_RIM = 3.5  # modules, above which ISO 6336-3 (2006) neglects the effect of the rim of an internal gear on its teeth


@dataclass(frozen=True, kw_only=True)
class ElasticRing:
    """A thin ring of rectangular section, bent by forces on its teeth.

    Attributes
    ----------
    radius_m : float
        Radius R of the centre line of the rim in m.
    tooth_radius_m : float
        Radius ``R - e`` of the pitch circle in m, where forces act.
    rim_m, width_m : float
        Radial thickness and axial width of the rim in m.
    young_pa : float
        Young's modulus in Pa.
    """

    radius_m: float
    tooth_radius_m: float
    rim_m: float
    width_m: float
    young_pa: float = _STEEL_PA

    @property
    def waves(self) -> Array:
        """Waves per circumference, (n,), from 2 up to a half wave as short as the rim is thick."""
        return np.arange(2, max(3, math.floor(math.pi * self.radius_m / self.rim_m) + 1), dtype=np.float64)

    @property
    def compliances(self) -> tuple[Array, Array]:
        """Outward displacement per force in m N-1 of each wave, (n,): the cosine for F_r, the sine for F_t."""
        n, offset = self.waves, 1 - self.tooth_radius_m / self.radius_m
        stiffness_n_m2 = self.young_pa * self.width_m * self.rim_m**3 / 12
        radial = self.radius_m**3 / (math.pi * stiffness_n_m2) / (n**2 - 1) ** 2
        return radial, radial * ((1 - offset) / n + n * offset)


@dataclass(frozen=True, kw_only=True)
class RingMesh:
    """A mesh of planets with a ring at rest.

    Attributes
    ----------
    mesh, carrier : str
        Names of the mesh and of its carrier.
    places_rad : (N,) array
        Angles in rad of the planets from the sensors at revolution zero, in the direction of positive speeds.
    shares : (N,) array
        Their loads relative to the mean.
    """

    mesh: str
    carrier: str
    places_rad: Array
    shares: Array


@dataclass(frozen=True, kw_only=True)
class RingLoad:
    """The static force of one planet on a ring, as seen by a sensor on the ring.

    Attributes
    ----------
    mesh, carrier : str
        Names of the mesh and of its carrier.
    ratio : float
        Revolutions of the carrier per revolution of the reference, in the direction of positive forces.
    sensor : int
        Index of the sensor.
    place_rad : float
        Angle in rad of the planet from the sensor at revolution zero, in that direction.
    radial_n, tangential_n : (instant,) arrays
        Outward and tangential forces in N, times the radial component of the sensor direction.
    """

    mesh: str
    carrier: str
    ratio: float
    sensor: int
    place_rad: float
    radial_n: Array = field(repr=False)
    tangential_n: Array = field(repr=False)


def ring_of(scene: Scene, mesh: str) -> ElasticRing:
    """Return the ring gear of a mesh with the rim declared by `planet_pass.ring`.

    Raises
    ------
    SceneError
        An undeclared module or face width.
    """
    assert scene.planet_pass is not None  # noqa: S101 - the caller has checked
    assert scene.planet_pass.ring is not None  # noqa: S101
    declared = {each.name: each for each in scene.gearbox.meshes}[mesh]
    sizes = {key: declared_size_mm(scene, mesh, key) for key in ("module_mm", "face_width_mm")}
    for key, value in sizes.items():
        if value is None:
            raise SceneError(
                f'planet_pass.ring needs {key} of mesh "{mesh}"; declare it in the gearbox or in dynamics.meshes.'
            )
    module_m, width_m = (1e-3 * float(value or 0) for value in sizes.values())
    rim_mm = scene.planet_pass.ring.rim_mm
    rim_m = _RIM * module_m if rim_mm is None else 1e-3 * rim_mm
    teeth = max(abs(gear.teeth) for gear in declared.gears)
    pitch_m = teeth * module_m / math.cos(math.radians(declared.helix_angle_deg or 0.0)) / 2
    return ElasticRing(
        radius_m=pitch_m + _DEDENDUM * module_m + rim_m / 2, tooth_radius_m=pitch_m, rim_m=rim_m, width_m=width_m
    )


def sensors_on_ring(scene: Scene, mesh: str) -> list[int]:
    """Return the indices of the sensors on the ring of a mesh: on its body, or on the mesh itself."""
    bodies = scene.kinematics.bodies
    gears = {each.name: each for each in scene.gearbox.meshes}[mesh].gears
    ring = max(gears, key=lambda gear: abs(gear.teeth)).link
    return [
        number
        for number, sensor in enumerate(scene.sensors)
        if sensor.on == mesh or (sensor.on in bodies and bodies[sensor.on] == bodies[ring])
    ]


def kinematic_ring_loads(scene: Scene, rings: Sequence[RingMesh], *, torques_nm: Mapping[str, Array]) -> list[RingLoad]:
    """Return the forces of all planets on their rings, from the mean torque (instant,) of a planet on each, by mesh.

    Raises
    ------
    SceneError
        An undeclared module, face width or pressure angle.
    """
    loads = []
    for ring in rings:
        angle_deg = declared_size_mm(scene, ring.mesh, "pressure_angle_deg")
        if angle_deg is None:
            raise SceneError(
                f'planet_pass.ring needs pressure_angle_deg of mesh "{ring.mesh}"; declare it in the gearbox or in '
                "dynamics.meshes."
            )
        tangential_n = torques_nm[ring.mesh] / ring_of(scene, ring.mesh).tooth_radius_m
        for sensor in sensors_on_ring(scene, ring.mesh):
            for place_rad, share in zip(ring.places_rad, ring.shares, strict=True):
                loads.append(
                    RingLoad(
                        mesh=ring.mesh,
                        carrier=ring.carrier,
                        ratio=float(scene.ratio(ring.carrier)),
                        sensor=sensor,
                        place_rad=place_rad,
                        radial_n=share * np.abs(tangential_n) * math.tan(math.radians(angle_deg)),
                        tangential_n=share * tangential_n,
                    )
                )
    return loads


def ring_bending_lines(
    scene: Scene, loads: Sequence[RingLoad], *, speed_hz: Array
) -> list[tuple[HarmonicFamily, ComplexArray]]:
    """Return the lines of bending rings, and their Z (sensor, k, instant) in m s-2.

    They are those of the acceleration ``-(2 pi n carrier speed)^2 w``. Changes of load and speed within a pass are
    neglected, as is the inertia of the ring, whose first bending mode is far above these lines.

    Parameters
    ----------
    scene : Scene
    loads : sequence of RingLoad
    speed_hz : (instant,) array
        Speed of the reference in rev s-1.
    """
    found = []
    for mesh in dict.fromkeys(load.mesh for load in loads):
        here = [load for load in loads if load.mesh == mesh]
        ring, order = ring_of(scene, mesh), abs(scene.ratio(here[0].carrier))
        passing_hz = float(order) * float(np.max(np.abs(speed_hz)))
        waves = ring.waves[ring.waves * passing_hz < scene.rate_hz / 2]
        radial, tangential = (part[: waves.size, None] for part in ring.compliances)
        shape = np.zeros((len(scene.sensors), waves.size, speed_hz.size), dtype=np.complex128)
        largest = 0.0
        for load in here:
            turn = np.exp(1j * waves * load.place_rad)[:, None]
            wave = (radial * load.radial_n + 1j * tangential * load.tangential_n) * turn
            shape[load.sensor] += wave if load.ratio > 0 else wave.conj()
            largest = max(largest, float(np.max(np.abs(wave), initial=0.0)))
        shape[:, np.max(np.abs(shape), axis=(0, 2)) < _ROUNDING * largest] = 0.0
        square = -((2 * np.pi * float(order) * np.multiply.outer(waves, speed_hz)) ** 2)
        amplitudes = np.pad(square * shape, ((0, 0), (1, 0), (0, 0)))  # no first harmonic
        family = HarmonicFamily(
            component=mesh,
            kind="ring_bending",
            source=mesh,
            base_order=order,
            coefficients=amplitudes[here[0].sensor],
            load_dependent=False,
        )
        found.append((family, amplitudes))
    return found
