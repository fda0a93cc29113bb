"""Forces on the housing in the direction of each sensor, from the motion of the gears and the mesh forces.

The force of a bearing is that of its springs; along a degree of freedom that is not simulated it follows from the mesh
forces by statics. Mesh forces on gears of the frame, as a ring in its housing, act on it directly. Forces in
coordinates that rotate with a carrier are resolved in the fixed direction of the sensor; and where planets pass the
sensors, each ring mesh is weighted by the pass window of its angle from the sensor, which is taken to be on the ring in
the direction of its axis.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from data_synth.assembly import Assembly
from data_synth.integrate import Output
from data_synth.keeping import ActiveDofs
from data_synth.layout import planet_angle, planet_of
from data_synth.listening import Route, route_gains, routes_of
from data_synth.mechanics import Array, System
from data_synth.meshing import Gears, declared_of
from data_synth.passing import pass_window
from data_synth.planet_pass import PassWindow
from data_synth.scene import SceneError, Sensor
from data_synth.stage import PreparedScene

_ALONG = 1e-9


@dataclass(frozen=True, kw_only=True)
class RotatingReading:
    """Two force components that rotate with a carrier: ``cos(angle) first + sin(angle) second`` acts on a route."""

    route: int
    first: int
    second: int
    carrier: str


@dataclass(frozen=True, kw_only=True)
class PassingMesh:
    """The force of a ring mesh that passes a sensor, `place_rad` ahead of its carrier's angle from it."""

    route: int
    reading: int
    carrier: str
    place_rad: float
    weight: float


@dataclass(frozen=True, kw_only=True)
class SensorForces:
    """Forces that excite the transfer routes to the sensors, as output maps and their combination.

    Attributes
    ----------
    output : Output
        Output maps: one for each route in fixed coordinates, then those that `rotating` and `passing` use.
    routes : tuple of Route
        Transfer routes.
    carriers : mapping of carrier to (ratio, offset)
        Revolutions per revolution of the reference, and at its revolution zero.
    """

    stage: PreparedScene = field(repr=False)
    output: Output
    routes: tuple[Route, ...]
    rotating: tuple[RotatingReading, ...] = ()
    passing: tuple[PassingMesh, ...] = ()
    window: PassWindow | None = None
    carriers: dict[str, tuple[float, float]]

    @property
    def rotate(self) -> bool:
        """Whether a route to a sensor varies with the angle of a carrier."""
        return bool(self.rotating or self.passing)

    def forces(self, readings: Array, *, times_s: Array) -> Array:
        """Return the forces (n, routes) in N from readings (n, readings)."""
        count = len(self.routes)
        if not self.rotate:
            return readings
        sensed = readings[:, :count].copy()
        revolutions = self.stage.drive.angle.revolutions(times_s)
        angles = {
            carrier: 2 * np.pi * np.remainder(ratio * revolutions + offset, 1.0)
            for carrier, (ratio, offset) in self.carriers.items()
        }
        waves = {item.carrier: (np.cos(angles[item.carrier]), np.sin(angles[item.carrier])) for item in self.rotating}
        for item in self.rotating:
            cosine, sine = waves[item.carrier]
            sensed[:, item.route] += cosine * readings[:, item.first] + sine * readings[:, item.second]
        for passes in self.passing:
            assert self.window is not None  # noqa: S101 - planets pass by it
            gain = self.window.gain(angles[passes.carrier] + passes.place_rad)
            sensed[:, passes.route] += passes.weight * gain * readings[:, passes.reading]
        return np.asarray(sensed)


def sensor_forces_of(stage: PreparedScene, gears: Gears, whole: Assembly, active: ActiveDofs) -> SensorForces:
    """Return the forces of a scene's gears towards its sensors.

    Parameters
    ----------
    stage : PreparedScene
    gears : Gears
    whole : Assembly
        With all degrees of freedom.
    active : Kept
        Those that are simulated.
    """
    scene, parts = stage.scene, whole.parts
    frames = list(dict.fromkeys(contact.carrier for contact in parts.contacts if contact.carrier != parts.frame))
    rows = _Readings(
        whole, active, {name: declared_of(scene).mesh(mesh).damping_n_s_m for name, mesh in gears.meshes.items()}
    )
    window, rotating, passing = pass_window(scene), [], []
    routes = routes_of(scene)
    directions_of_sensors = [
        _sensitive_direction(stage, whole, sensor, passes=window is not None) for sensor in scene.sensors
    ]
    directions = [directions_of_sensors[route.number] for route in routes]
    weights = [route_gains(scene, whole, route, routes) for route in routes]
    for along, gains in zip(directions, weights, strict=True):
        rows.add(along, gains, frame=parts.frame, ring=window is None, axial=frames)
    for carrier in frames:
        for number, (along, gains) in enumerate(zip(directions, weights, strict=True)):
            x, y, _ = along
            first = rows.add(np.array([x, y, 0.0]), gains, frame=carrier, ring=window is None)
            second = rows.add(np.array([y, -x, 0.0]), gains, frame=carrier, ring=window is None)
            rotating.append(RotatingReading(route=number, first=first, second=second, carrier=carrier))
    if window is not None:
        for contact in parts.contacts:
            planet = planet_of(parts.kinematics, contact)
            if contact.name not in whole.on_frame or planet is None:
                continue
            reading = rows.mesh(contact.name)
            joint = parts.kinematics.joints[parts.kinematics.bodies[contact.links[planet]]]
            for number, (along, gains) in enumerate(zip(directions, weights, strict=True)):
                azimuth_rad = math.atan2(along[1], along[0]) if np.hypot(along[0], along[1]) > _ALONG else 0.0
                passing.append(
                    PassingMesh(
                        route=number,
                        reading=reading,
                        carrier=contact.carrier,
                        place_rad=planet_angle(scene.gearbox, joint.axis) - azimuth_rad,
                        weight=gains[parts.frame],
                    )
                )
    return SensorForces(
        stage=stage,
        output=rows.output(scene.rate_hz),
        routes=routes,
        rotating=tuple(rotating),
        passing=tuple(passing),
        window=window,
        carriers={
            carrier: (parts.frame_ratio(carrier), float(stage.rng_for("carrier", carrier).random()))
            for carrier in frames
        },
    )


class _Readings:
    """Output maps of motion and mesh forces, added one by one."""

    def __init__(self, whole: Assembly, active: ActiveDofs, damping: dict[str, float]) -> None:
        self._whole, self._active, self._coordinates = whole, active, whole.coordinates
        system: System = whole.system
        self._names = [mesh.name for mesh in system.meshes]
        self._meshes = np.array([mesh.direction for mesh in system.meshes])
        self._damping = np.array([damping[name] for name in self._names])
        self._displacement: list[Array] = []
        self._velocity: list[Array] = []
        self._mesh_force: list[Array] = []

    def add(
        self, along: Array, weights: dict[str, float], *, frame: str, ring: bool, axial: list[str] | None = None
    ) -> int:
        """Add the force along a direction of all bodies with coordinates in `frame`, and return its number.

        The axial forces in the `axial` frames are added to it.
        """
        displacement, velocity = np.zeros((2, len(self._coordinates.names)))
        mesh_force = np.zeros(len(self._names))
        parts, upright = self._whole.parts, np.array([0.0, 0.0, along[2]])
        for body in (*parts.kinematics.joints, *parts.elastic_links):
            for each in parts.frames(body):
                sensed = along if each == frame else upright if each in (axial or ()) else None
                if sensed is not None and sensed.any():
                    bearing = self._bearing(parts.piece(body, each), sensed)
                    displacement += weights[body] * bearing[0]
                    velocity += weights[body] * bearing[1]
                    mesh_force += weights[body] * bearing[2]
        for contact in parts.contacts if ring else ():
            sensed = along if contact.carrier == frame else upright if contact.carrier in (axial or ()) else None
            if sensed is not None and contact.name in self._whole.on_frame:
                projection = float(np.array(self._whole.on_frame[contact.name]) @ sensed)
                mesh_force[self._names.index(contact.name)] += weights[parts.frame] * projection
        moving = self._active.expansion
        return self._append(displacement @ moving, velocity @ moving, mesh_force)

    def mesh(self, name: str) -> int:
        """Add the force of a mesh, and return its number."""
        none = np.zeros(self._active.numbers.size)
        return self._append(none, none, np.eye(len(self._names))[self._names.index(name)])

    def output(self, rate_hz: float) -> Output:
        """Return the output with all maps."""
        displacement, velocity, mesh_force = (
            np.array(rows) for rows in (self._displacement, self._velocity, self._mesh_force)
        )
        return Output(
            rate_hz=rate_hz,
            displacement=displacement,
            velocity=velocity if velocity.any() else None,
            mesh_force=mesh_force if mesh_force.any() else None,
        )

    def _append(self, displacement: Array, velocity: Array, mesh_force: Array) -> int:
        self._displacement.append(displacement)
        self._velocity.append(velocity)
        self._mesh_force.append(mesh_force)
        return len(self._displacement) - 1

    def _bearing(self, body: str, along: Array) -> tuple[Array, Array, Array]:
        """Return the force of a body's supports on the frame per displacement, velocity and mesh force."""
        displacement, velocity = np.zeros((2, len(self._coordinates.names)))
        mesh_force = np.zeros(len(self._names))
        for share, motion in zip(along, "xyz", strict=True):
            number = self._coordinates.index.get((body, motion))
            if number is None or abs(share) < _ALONG or not self._grounded(number):
                continue
            if number in self._active.numbers:
                for spring in self._whole.grounded:
                    if spring.direction[number]:
                        projection = share * spring.direction[number] * spring.direction
                        displacement += spring.stiffness * projection
                        velocity += spring.damping * projection
            else:
                rows = self._meshes @ self._active.constraint[:, number]
                mesh_force -= share * rows
                velocity -= share * (rows * self._damping) @ self._meshes
        return displacement, velocity, mesh_force

    def _grounded(self, number: int) -> bool:
        """Return whether a spring connects a degree of freedom to the frame."""
        return any(spring.direction[number] for spring in self._whole.grounded)


def _sensitive_direction(stage: PreparedScene, whole: Assembly, sensor: Sensor, *, passes: bool) -> Array:
    """Return a sensor's direction with its cross-axis sensitivity, in x, y and z of the assembly, (3,)."""
    direction = np.asarray(sensor.direction, dtype=np.float64)
    direction = direction / np.linalg.norm(direction)
    if sensor.cross_axis is not None:
        drawn = stage.rng_for("cross axis", sensor.name).standard_normal(3)
        across = drawn - (drawn @ direction) * direction
        direction = direction + sensor.cross_axis.share * across / np.linalg.norm(across)
    along = np.asarray(whole.parts.space @ direction)
    along[np.abs(along) < _ALONG] = 0.0
    moves = {motion for _, motion in whole.coordinates.index}
    if not passes and not any(value and motion in moves for value, motion in zip(along, "xyz", strict=True)):
        raise SceneError(
            f'sensor "{sensor.name}" is directed along the shafts, where gears that move in a plane have no force; '
            'change its direction, or write fidelity = "full".'
        )
    return along
