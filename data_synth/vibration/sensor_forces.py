"""Forces on the housing in the direction of each sensor, from the motion of the gears and the mesh forces.

The force of a bearing is that of its springs. Mesh forces on gears of the frame, such as a ring in its housing, act on
it directly. Forces in coordinates that rotate with a carrier are resolved in the fixed direction of the sensor.

Their vector sum acts on a rigid housing: balanced internal forces do not move it. The distance of a force from a sensor
matters only for the elastic housing, above its first mode (`data_synth.transfer.housing`): the gain of the housing
minus one is that of a second transfer path, parallel to the rigid one.

Where planets pass the sensors, the pass window, a function of a planet's angle from the sensor, which is taken to be on
the ring in the direction of its axis, is such a gain of the force of its ring mesh. It applies to the dynamic part F -
F_0 alone; F_0 is the static force under the load of the instant, which bends an elastic ring as its planet passes:
`data_synth.kinematic.ring_bending`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.assembly import Assembly
from data_synth.dynamics.placement import planet_angle, planet_of
from data_synth.dynamics.system import Array, spring_matrices
from data_synth.integrators.problem import Output
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.kinematic.planet_pass import PassWindow, pass_window
from data_synth.kinematic.ring_bending import RingLoad, sensors_on_ring
from data_synth.scene.scene import Scene, SceneError
from data_synth.sources.prepared import PreparedScene
from data_synth.transfer.acquisition import linear_chain, measured_filter
from data_synth.transfer.housing import AHEAD, PoleFilter, body_weights, housing_of, sensitive_direction
from data_synth.transfer.paths import MeasuredPath, TransferPath, transfer_paths

# ---- Transfer routes from gears to sensors: through the housing, or by declared paths from single links ----
# A declared path starts from the supports of a link, in the direction of its sensor; the housing transfers the rest.


@dataclass(frozen=True, kw_only=True)
class Route:
    """A transfer route from gears to a sensor.

    Attributes
    ----------
    number : int
        Number of the sensor.
    source : str or None
        Link or bearing at which it starts; None for the housing, which transfers all forces without a declared path.
    elastic : bool
        Whether it is the elastic contribution of the housing, which increases the response to forces near the sensor
        and reduces that to others.
    """

    number: int
    source: str | None = None
    path: TransferPath | None = field(default=None, repr=False)
    elastic: bool = False

    def response_in(self, scene: Scene) -> Callable[[Array], ComplexArray]:
        """Return the complex amplitude in the channel for 1 N as a function of frequencies in Hz, any shape."""
        sensor = scene.sensors[self.number]
        if self.path is None:
            return housing_of(scene, sensor, elastic=self.elastic).response
        path, chain = self.path, linear_chain(sensor, rate_hz=scene.rate_hz)
        return lambda frequency_hz: np.asarray(path.response(frequency_hz) * chain.response(frequency_hz))

    def filter_at(self, scene: Scene, *, rate_hz: float) -> "RouteFilter":
        """Return the filter of the route at rest, for a force at `rate_hz`."""
        sensor = scene.sensors[self.number].changed(skew_s=0.0)  # the delay applies to the whole channel
        chain = linear_chain(sensor, rate_hz=scene.rate_hz)
        if isinstance(self.path, MeasuredPath):
            fir = measured_filter(self.path, chain, rate_hz=rate_hz, sensor=sensor)
            # it starts at rest, since the static part of the force is subtracted
            return RouteFilter(push=lambda force, **_: fir.push(force), lag=round(fir.delay_s * rate_hz))
        way = housing_of(scene, sensor, elastic=self.elastic) if self.path is None else chain
        filter_ = PoleFilter(way, rate_hz=rate_hz, sensor=sensor.name, before=self.path)
        return RouteFilter(push=filter_.push, lag=AHEAD)


@dataclass(kw_only=True)
class RouteFilter:
    """Filter of a route, with a further delay to align it with others."""

    push: Callable[..., Array]
    lag: int
    _kept: Array = field(default_factory=lambda: np.empty(0), init=False, repr=False)

    def filtered(self, force: Array, *, at_once: Array, lag: int) -> Array:
        """Return the response (n,) to the next samples (n,) of the force, delayed by `lag` samples."""
        now, extra_lag = self.push(np.ascontiguousarray(force), at_once=at_once), lag - self.lag
        if not extra_lag:
            return now
        joined = np.concatenate([self._kept if self._kept.size else np.full(extra_lag, now[0]), now])
        self._kept = joined[now.size :]
        return joined[: now.size]


def routes_of(scene: Scene) -> tuple[Route, ...]:
    """Return the routes to each sensor of a scene: through the rigid and the elastic housing, then declared paths.

    Raises
    ------
    SceneError
        If a path starts at a mesh; it must start at a link or a bearing.
    """
    numbers = {sensor.name: number for number, sensor in enumerate(scene.sensors)}
    declared = [
        Route(number=numbers[sensor], source=source, path=path)
        for (source, sensor), path in transfer_paths(scene).items()
    ]
    for route in declared:
        if route.source in {mesh.name for mesh in scene.gearbox.meshes}:
            raise SceneError(
                f'fidelity = "{scene.fidelity}": a transfer starts from the mesh "{route.source}", but mesh '
                "forces reach a sensor through the supports of the gears; name a link or a bearing."
            )
    housing = [Route(number=number, elastic=elastic) for elastic in (False, True) for number in range(len(numbers))]
    return (*housing, *declared)


def route_gains(scene: Scene, whole: Assembly, route: Route, routes: tuple[Route, ...]) -> dict[str, float]:
    """Return the gains of a route for the supports of each body, and for gears of the frame.

    A declared path has those of its source, the housing those of all bodies without a path to this sensor: equal gains
    as a rigid body, and the differences of their weights from these as an elastic one.
    """
    sensor, parts = scene.sensors[route.number], whole.parts
    bodies = [*parts.kinematics.joints, *parts.elastic_links, parts.frame]
    weights = body_weights(scene, sensor, bodies=bodies, body_of=parts.body)
    source_of: dict[str, str] = {}
    for other in routes:
        if other.source is None or other.number != route.number:
            continue
        for body in sorted(_holders(scene, whole, other.source)):
            if source_of.setdefault(body, other.source) != other.source:
                raise SceneError(
                    f'transfers lead to sensor "{sensor.name}" from "{source_of[body]}" and "{other.source}", '
                    f'which both support "{body}"; keep one of them.'
                )
    if route.source is not None:
        own_bodies = _holders(scene, whole, route.source)
        return {body: float(body in own_bodies) for body in weights}
    return {
        body: (weight - 1.0 if route.elastic else 1.0) * (body not in source_of) for body, weight in weights.items()
    }


def _holders(scene: Scene, whole: Assembly, source: str) -> set[str]:
    """Return the bodies of a link or bearing; for a bearing, the rings other than the frame."""
    gearbox, parts = scene.gearbox, whole.parts
    for bearing in gearbox.bearings:
        if source in bearing.names:
            return {parts.body(link) for link in gearbox.ring_links(bearing)} - {parts.frame}
    return {parts.body(link) for link in gearbox.instances(source)}


# ---- Sensor forces ---------------------------------------------------------------------------------------------------


_ALONG = 1e-9


@dataclass(frozen=True, kw_only=True)
class PassingMesh:
    """Force of a ring mesh that passes a sensor, `place_rad` ahead of its carrier's angle from it.

    Its dynamic part acts with `weight` times the window as gain, less `rigid` times ``cos(angle) first + sin(angle)
    second + axial``, that on a rigid housing; where `rigid` is zero, as on a declared path, its static part with
    `weight` times the latter.
    """

    contact: str
    mesh: str
    route: int
    reading: int
    carrier: str
    place_rad: float
    weight: float
    rigid: float
    first: float
    second: float
    axial: float


@dataclass(frozen=True, kw_only=True)
class SensorForces:
    """Forces that excite the transfer routes to the sensors, as output maps and their combination.

    Attributes
    ----------
    output : Output
        Output maps: one for each route in fixed coordinates; two for each route and carrier, of forces that rotate with
        it, ``cos(angle) first + sin(angle) second``, those of all routes one after the other; then those of `passing`.
    routes : tuple of Route
        Transfer routes.
    carriers : mapping of carrier to (ratio, offset)
        Revolutions per revolution of the reference, and initial angle in revolutions.
    static_n : mapping of mesh to (instant,) array
        Static mesh forces under the load at the instants of the truth.
    static_readings : (reading, instant) array
        Static part of the readings. It is subtracted on declared paths: an accelerometer does not measure it, but a
        mode of unit static gain would transmit it.
    late_s : float
        Delay of static forces: half a sample where displacements jump after the sample nearest to a jump of the load.
        If not zero, they are subtracted on all routes: a housing would respond to the jumps.
    """

    stage: PreparedScene = field(repr=False)
    output: Output
    routes: tuple[Route, ...]
    passing: tuple[PassingMesh, ...] = ()
    window: PassWindow | None = None
    carriers: dict[str, tuple[float, float]]
    static_n: Mapping[str, Array] = field(repr=False)
    static_readings: Array = field(repr=False)
    late_s: float = 0.0

    @property
    def rotate(self) -> bool:
        """Whether a route to a sensor varies with the angle of a carrier."""
        return bool(self.carriers)

    def forces(self, readings: Array, *, times_s: Array) -> Array:
        """Return the forces (n, routes) in N from readings (n, readings)."""
        count = len(self.routes)
        readings = readings.copy()
        for number, route in enumerate(self.routes):
            if route.path is not None or self.late_s:
                static = self.static_readings[number]
                readings[:, number] -= np.interp(times_s - self.late_s, self.stage.instants_s, static)
        if not self.rotate:
            return readings
        sensed = readings[:, :count].copy()
        revolutions = self.stage.drive.angle.revolutions(times_s)
        angles = {
            carrier: 2 * np.pi * np.remainder(ratio * revolutions + offset, 1.0)
            for carrier, (ratio, offset) in self.carriers.items()
        }
        waves = {carrier: (np.cos(angle), np.sin(angle)) for carrier, angle in angles.items()}
        for number, (cosine, sine) in enumerate(waves.values(), start=1):
            pairs = readings[:, (2 * number - 1) * count : (2 * number + 1) * count]
            sensed += cosine[:, None] * pairs[:, ::2] + sine[:, None] * pairs[:, 1::2]
        for passes in self.passing:
            assert self.window is not None  # noqa: S101 - planets pass by it
            cosine, sine = waves[passes.carrier]
            static = np.interp(times_s - self.late_s, self.stage.instants_s, self.static_n[passes.contact])
            dynamic = readings[:, passes.reading] - static
            gain = self.window.gain(angles[passes.carrier] + passes.place_rad)
            along = cosine * passes.first + sine * passes.second + passes.axial
            shared = -passes.rigid * dynamic if passes.rigid else passes.weight * static
            sensed[:, passes.route] += passes.weight * gain * dynamic + shared * along
        return np.asarray(sensed)

    def ring_loads(self) -> list[RingLoad]:
        """Return the static forces of planets on the rings that carry sensors."""
        loads = []
        for passes in self.passing:
            route = self.routes[passes.route]
            if route.source is not None or route.number not in sensors_on_ring(self.stage.scene, passes.mesh):
                continue
            static, (ratio, offset) = self.static_n[passes.contact], self.carriers[passes.carrier]
            cosine, sine = math.cos(passes.place_rad), math.sin(passes.place_rad)
            loads.append(
                RingLoad(
                    mesh=passes.mesh,
                    carrier=passes.carrier,
                    ratio=ratio,
                    sensor=route.number,
                    place_rad=passes.place_rad + 2 * math.pi * offset,
                    radial_n=static * (cosine * passes.first - sine * passes.second),
                    tangential_n=static * (-sine * passes.first - cosine * passes.second),
                )
            )
        return loads


def sensor_forces_of(
    stage: PreparedScene, whole: Assembly, numbers: NDArray[np.int_], *, displacements: Array, static_n: Array
) -> SensorForces:
    """Return the forces of a scene's gears at its sensors.

    Parameters
    ----------
    stage : PreparedScene
    whole : Assembly
        Assembly with all degrees of freedom.
    numbers : (dof,) int array
        Numbers of the degrees of freedom that are integrated among all.
    displacements, static_n : (dof, instant), (mesh, instant) arrays
        Static displacements and mesh forces under the load at the instants of the truth.
    """
    scene, parts = stage.scene, whole.parts
    frames = list(dict.fromkeys(contact.carrier for contact in parts.contacts if contact.carrier != parts.frame))
    rows = _Readings(whole, numbers)
    window, passing = pass_window(scene), []
    every = routes_of(scene)
    of_each = [route_gains(scene, whole, route, every) for route in every]
    felt = [window is not None or any(gains.values()) for gains in of_each]
    routes, weights = tuple(compress(every, felt)), list(compress(of_each, felt))
    of_sensors = [_along(whole, sensitive_direction(sensor, rng_for=stage.rng_for)) for sensor in scene.sensors]
    directions = [of_sensors[route.number] for route in routes]
    rings = [window is None or (route.source is None and not route.elastic) for route in routes]
    for along, gains, ring in zip(directions, weights, rings, strict=True):
        upright = np.array([0.0, 0.0, along[2]])
        rows.add({**dict.fromkeys(frames, upright), parts.frame: along}, gains, ring=ring)
    for carrier in frames:
        for (x, y, _), gains, ring in zip(directions, weights, rings, strict=True):
            for rotating in ([x, y, 0.0], [y, -x, 0.0]):
                rows.add({carrier: np.array(rotating)}, gains, ring=ring)
    if window is not None:
        for contact in parts.contacts:
            planet = planet_of(parts.kinematics, contact)
            if contact.name not in whole.on_frame or planet is None:
                continue
            reading = rows.mesh(contact.name)
            joint = parts.kinematics.joints[parts.kinematics.bodies[contact.links[planet]]]
            for number, (along, gains, ring) in enumerate(zip(directions, weights, rings, strict=True)):
                if ring:
                    continue
                x, y, z = along
                rigid = weights[routes[number].number][parts.frame] if routes[number].elastic else 0.0
                force = np.array(whole.on_frame[contact.name])
                azimuth_rad = math.atan2(along[1], along[0]) if np.hypot(along[0], along[1]) > _ALONG else 0.0
                passing.append(
                    PassingMesh(
                        contact=contact.name,
                        mesh=contact.mesh,
                        route=number,
                        reading=reading,
                        carrier=contact.carrier,
                        place_rad=planet_angle(scene.gearbox, joint.axis) - azimuth_rad,
                        weight=gains[parts.frame] + rigid,
                        rigid=rigid,
                        first=float(force @ [x, y, 0.0]),
                        second=float(force @ [y, -x, 0.0]),
                        axial=float(force @ [0.0, 0.0, z]),
                    )
                )
    by_displacement, _, by_mesh_force = rows.maps
    return SensorForces(
        stage=stage,
        output=rows.output(scene.rate_hz),
        static_n={mesh.name: force for mesh, force in zip(whole.system.meshes, static_n, strict=True)},
        static_readings=by_displacement @ displacements + by_mesh_force @ static_n,
        routes=routes,
        passing=tuple(passing),
        window=window,
        carriers={
            carrier: (
                parts.frame_ratio(carrier),
                float(stage.rng_for("carrier", carrier).random())
                + stage.turns_before * parts.frame_ratio(carrier) % 1.0,
            )
            for carrier in frames
        },
    )


def support_forces(whole: Assembly, numbers: NDArray[np.int_]) -> tuple[list[str], Array, Array]:
    """Return the forces of the supports of each body on the frame along x, y and z of the gearbox, as output maps.

    Returns
    -------
    names : list of str
        Such as ``"input, x"``; forces that are always zero have no row.
    displacement, velocity : (row, dof) arrays
    """
    names, rows, parts = [], _Readings(whole, numbers), whole.parts
    bodies = (*parts.kinematics.joints, *parts.elastic_links)
    for body in bodies:
        if parts.frame not in parts.frames(body):
            continue
        for axis, unit in zip("xyz", np.eye(3), strict=True):
            gains = {other: float(other == body) for other in bodies}
            rows.add({parts.frame: _along(whole, unit)}, gains, ring=False)
            names.append(f"{body}, {axis}")
    displacement, velocity, _ = rows.maps
    nonzero = np.any(np.hstack([displacement, velocity]) != 0, axis=1)
    return [names[row] for row in np.flatnonzero(nonzero)], displacement[nonzero], velocity[nonzero]


class _Readings:
    """Output maps of motion and mesh forces, added one by one."""

    def __init__(self, whole: Assembly, numbers: NDArray[np.int_]) -> None:
        self._whole, self._numbers, dofs = whole, numbers, len(whole.coordinates.names)
        self._names = [mesh.name for mesh in whole.system.meshes]
        self._rows = list[tuple[Array, Array, Array]]()
        self._springs, self._dampers = spring_matrices(whole.grounded, dofs)

    def add(self, directions: Mapping[str, Array], gains: dict[str, float], *, ring: bool) -> None:
        """Add the forces of the supports along the directions of the frames of their bodies.

        With `ring` also those of meshes on gears of the frame.
        """
        parts, mesh_force = self._whole.parts, np.zeros(len(self._names))
        sensed = np.zeros(self._springs.shape[0])
        for body in (*parts.kinematics.joints, *parts.elastic_links):
            for frame in parts.frames(body):
                for share, motion in zip(directions.get(frame, ()), "xyz", strict=False):
                    number = self._whole.coordinates.index.get((parts.piece(body, frame), motion))
                    if number is not None:
                        sensed[number] += gains[body] * share
        for contact in parts.contacts if ring else ():
            if contact.carrier in directions and contact.name in self._whole.on_frame:
                projection = float(np.array(self._whole.on_frame[contact.name]) @ directions[contact.carrier])
                mesh_force[self._names.index(contact.name)] += gains[parts.frame] * projection
        self._rows.append(
            ((sensed @ self._springs)[self._numbers], (sensed @ self._dampers)[self._numbers], mesh_force)
        )

    def mesh(self, name: str) -> int:
        """Add the force of a mesh, and return its number."""
        none = np.zeros(self._numbers.size)
        self._rows.append((none, none, np.eye(len(self._names))[self._names.index(name)]))
        return len(self._rows) - 1

    def output(self, rate_hz: float) -> Output:
        """Return the output with all maps."""
        displacement, velocity, mesh_force = self.maps
        return Output(
            rate_hz=rate_hz,
            displacement=displacement,
            velocity=velocity if velocity.any() else None,
            mesh_force=mesh_force if mesh_force.any() else None,
        )

    @property
    def maps(self) -> tuple[Array, Array, Array]:
        """Maps of displacement, velocity and mesh force, with a row for each reading."""
        dofs = self._numbers.size
        widths = enumerate((dofs, dofs, len(self._names)))
        return tuple(np.reshape([row[part] for row in self._rows], (-1, width)) for part, width in widths)  # type: ignore[return-value]


def _along(whole: Assembly, direction: Array) -> Array:
    """Return a direction of the gearbox in x, y and z of the assembly, (3,)."""
    along = np.asarray(whole.parts.space @ direction)
    along[np.abs(along) < _ALONG] = 0.0
    return along
