"""Transfer routes from vibrating gears to sensors: through the housing, or by declared paths from single links.

A declared path starts from the supports of a link, in the direction of its sensor; the housing transfers the rest.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from data_synth.assembly import Assembly
from data_synth.chain import Sensor
from data_synth.combs import ComplexArray
from data_synth.housing import Housing
from data_synth.impacts import measured_filter
from data_synth.meshing import declared_of
from data_synth.pole_filter import AHEAD, PoleFilter
from data_synth.profile import Array
from data_synth.scene import Scene, SceneError
from data_synth.sensors import linear_chain, path_residues
from data_synth.transfer import FirPath, MeasuredPath
from data_synth.ways import TransferPath, transfer_paths


@dataclass(frozen=True, kw_only=True)
class Route:
    """A transfer route from gears to a sensor.

    Attributes
    ----------
    number : int
        Number of the sensor.
    source : str or None
        The link or bearing it starts from; None for the housing, which transfers all that have no path of their own.
    """

    number: int
    source: str | None = None
    path: TransferPath | None = field(default=None, repr=False)

    def response(self, scene: Scene, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitude in the channel for 1 N at frequencies, any shape."""
        sensor = scene.sensors[self.number]
        if self.path is None:
            return self._housing(scene, sensor, scene.rate_hz).response(frequency_hz)
        return np.asarray(self.path.response(frequency_hz) * linear_chain(sensor).response(frequency_hz))

    def filter_at(self, scene: Scene, *, rate_hz: float) -> "RouteFilter":
        """Return the filter of the route at rest, for a force at `rate_hz`."""
        sensor = scene.sensors[self.number]
        if isinstance(self.path, MeasuredPath):
            fir = measured_filter(self.path, linear_chain(sensor), rate_hz=rate_hz, sensor=sensor)
            return RouteFilter(push=_StartingConstant(fir).push, lag=round(fir.delay_s * rate_hz))
        if self.path is None:
            return RouteFilter(push=self._housing(scene, sensor, rate_hz).push, lag=AHEAD)
        poles, residues = path_residues(self.path, linear_chain(sensor), sensor=sensor.name)
        return RouteFilter(push=PoleFilter(poles=poles, residues=residues, direct=0.0, rate_hz=rate_hz).push, lag=AHEAD)

    def _housing(self, scene: Scene, sensor: Sensor, rate_hz: float) -> Housing:
        declared = declared_of(scene)
        return Housing(
            mass_kg=declared.housing_kg, mounts=declared.mounts, path=scene.path, sensor=sensor, rate_hz=rate_hz
        )


@dataclass(kw_only=True)
class RouteFilter:
    """The filter of a route, with a further delay to align it with others."""

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


class _StartingConstant:
    """A FIR filter whose input was constant before its first sample."""

    def __init__(self, fir: FirPath) -> None:
        self._filter, self._static_gain = fir.filter(), float(np.sum(fir.taps))
        self._first: float | None = None

    def push(self, force: Array, *, at_once: Array) -> Array:
        """Return the response (n,) to the next n samples; `at_once` is for filters with a direct part."""
        del at_once
        if self._first is None:
            self._first = float(force[0])
        return self._filter.push(force - self._first) + self._static_gain * self._first


def routes_of(scene: Scene) -> tuple[Route, ...]:
    """Return the routes to the sensors of a scene: to each through the housing, then the declared paths.

    Raises
    ------
    SceneError
        If a path starts from a mesh; it has to start from a link or a bearing.
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
    return (*(Route(number=number) for number in range(len(numbers))), *declared)


def route_gains(scene: Scene, whole: Assembly, route: Route, routes: tuple[Route, ...]) -> dict[str, float]:
    """Return the gains of a route for the supports of each body, and for gears of the frame.

    A declared path has those of its source, the housing all bodies without a path of their own to this sensor.
    """
    sensor = scene.sensors[route.number]
    weights = _weights(scene, whole, sensor)
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
    own_bodies = _holders(scene, whole, route.source) if route.source is not None else set()
    return {
        body: float(body in own_bodies) if route.source is not None else weight * (body not in source_of)
        for body, weight in weights.items()
    }


def _holders(scene: Scene, whole: Assembly, source: str) -> set[str]:
    """Return the bodies of a link or bearing: of a bearing the rings that are not the frame."""
    gearbox, parts = scene.gearbox, whole.parts
    for bearing in gearbox.bearings:
        if source in bearing.names:
            rings = {link for ring in (bearing.inner_ring, bearing.outer_ring) for link in gearbox.instances(ring)}
            return {parts.body(link) for link in rings} - {parts.frame}
    return {parts.body(link) for link in gearbox.instances(source)}


def _weights(scene: Scene, whole: Assembly, sensor: Sensor) -> dict[str, float]:
    """Return the gains to a sensor for the supports of each body, and for gears of the frame."""
    declared, gearbox, parts = declared_of(scene), scene.gearbox, whole.parts
    bodies, frame = parts.kinematics.bodies, parts.frame
    links_below = {sensor.on}
    for mesh in gearbox.meshes:
        if mesh.name == sensor.on:
            links_below |= {gear.link for gear in mesh.gears}
    for bearing in gearbox.bearings:
        if sensor.on in bearing.names:
            rings = {link for ring in (bearing.inner_ring, bearing.outer_ring) for link in gearbox.instances(ring)}
            links_below |= {link for link in rings if bodies[link] != frame}
    bodies_near = {
        parts.body(link) for name in links_below if name in _links(scene) for link in gearbox.instances(name)
    }
    all_bodies = [*parts.kinematics.joints, *parts.elastic_links, frame]
    weights = {body: 1.0 if body in bodies_near else declared.elsewhere for body in all_bodies}
    for hearing in declared.hearing:
        if hearing.sensor not in [other.name for other in scene.sensors]:
            raise SceneError(f'dynamics.hearing names "{hearing.sensor}", which is no sensor of this scene.')
        for link, weight in hearing.links:
            if link not in _links(scene):
                raise SceneError(f'dynamics.hearing names "{link}", which is no link with bearings in this gearbox.')
            if hearing.sensor == sensor.name:
                weights |= {parts.body(name): weight for name in gearbox.instances(link)}
    return weights


def _links(scene: Scene) -> set[str]:
    return {*scene.gearbox.links, *scene.gearbox.copied}
