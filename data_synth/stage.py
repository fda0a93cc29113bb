"""A scene prepared for simulation: its drive, sources, impacts and transfer paths, but for gears that vibrate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_synth.chain import Sensor
from data_synth.combs import ComplexArray, HarmonicFamily, RandomStreams, add_lines
from data_synth.damage import harmonic_families, impact_trains, last_s
from data_synth.drive import Drive, build_drive
from data_synth.faults import ImpactTrain
from data_synth.path import line_amplitudes, sensor_gains
from data_synth.profile import Array
from data_synth.pulses import Pulses, recorded_pulses
from data_synth.scene import Scene, SceneError
from data_synth.sensors import AllPoleFilter, linear_chain
from data_synth.ways import TransferPaths, transfer_paths


@dataclass(frozen=True, kw_only=True)
class PreparedScene:
    """The drive, sources, impacts and transfer paths of a scene.

    Attributes
    ----------
    scene : Scene
    rng_for : callable
        Returns the random generator that belongs to its words.
    drive : Drive
    instants_s, speed_hz : (instant,) array
        Time axis of the truth in s, and the reference shaft's speed there in rev s-1.
    load : (instant,) array
        Tooth load relative to full load.
    families : sequence of HarmonicFamily
    amplitudes : sequence of (sensor, line, instant) complex array
        Z of their harmonics in the channels, after the linear part of the chain.
    trains : sequence of (int, ImpactTrain)
        Impacts with the number of their fault, from 0.
    offsets : sequence of float
        Turns of each fault's component at revolution zero from its worst place.
    gains : mapping of source to (sensor,) complex array
        Drawn gains to the sensors.
    paths : mapping of (source, sensor) to ModalPath or MeasuredPath
        Declared transfer paths, which replace gains and modes.
    chains : sequence of AllPoleFilter
        The linear part of each sensor's chain.
    pulses : Pulses
    """

    scene: Scene
    rng_for: RandomStreams
    drive: Drive
    instants_s: Array
    speed_hz: Array
    load: Array
    families: Sequence[HarmonicFamily]
    amplitudes: Sequence[ComplexArray]
    trains: Sequence[tuple[int, ImpactTrain]]
    offsets: Sequence[float]
    gains: dict[str, ComplexArray]
    paths: TransferPaths
    chains: Sequence[AllPoleFilter]
    pulses: Pulses

    def add_lines(
        self,
        signal: Array,
        *,
        first: int = 0,
        timing_errors_s: Array | None = None,
        only: tuple[str, str] | None = None,
    ) -> None:
        """Add the harmonics of all families, or of one component and kind, to samples from number `first` on.

        Parameters
        ----------
        signal : (sensor, n) array
            Changed in place.
        first : int
        timing_errors_s : (n,) array or None
            Errors of the sampling instants, s.
        only : pair of component and kind, optional
        """
        family_amplitudes = [
            (family, amplitudes)
            for family, amplitudes in zip(self.families, self.amplitudes, strict=True)
            if only in (None, (family.component, family.kind))
        ]
        if not family_amplitudes:
            return
        times_s = np.arange(first, first + signal.shape[1]) / self.scene.rate_hz
        position = times_s * ((self.scene.truth_times - 1) / self.scene.duration_s)
        revolutions = self.drive.angle.revolutions(times_s if timing_errors_s is None else times_s + timing_errors_s)
        for family, amplitudes in family_amplitudes:
            add_lines(signal, amplitudes, base_order=family.base_order, revolutions=revolutions, position=position)

    def impacts_at_source(self, number: int, train: ImpactTrain) -> tuple[Array, Array]:
        """Return the times (m,) in s of a train of fault `number`, and the amplitudes of its impacts at the source."""
        times_s = self.drive.angle.times(train.revolutions)
        return times_s, train.amplitudes * self.impact_factor(number, times_s)

    def impact_factor(self, number: int, times_s: Array) -> Array:
        """Return the factor of load, speed and growth in the impacts of a fault at `times_s` (m,)."""
        share = self.drive.load(times_s) * _speed_factor(self.scene, self.drive, times_s)
        return np.asarray(share * self.scene.faults[number].relative_size(times_s))


def prepare_scene(scene: Scene, *, rng_for: RandomStreams) -> PreparedScene:
    """Prepare a scene for simulation; `rng_for` returns the random generator that belongs to its words."""
    tachometer = scene.tachometer
    spacing = 1 / tachometer.pulses_per_rev
    turn = tachometer.offset_rev if tachometer.offset_rev is not None else spacing * rng_for("tachometer").random()
    drive = build_drive(scene, datum_turn=turn, speed_rng=rng_for("speed"), torque_rng=rng_for("torque"))
    instants_s = np.linspace(0.0, scene.duration_s, scene.truth_times)
    offsets = [float(rng_for("offset", str(number)).random()) for number in range(len(scene.faults))]
    relative_sizes = [
        fault.relative_size(instants_s if fault.growth is not None else np.zeros(1)) for fault in scene.faults
    ]
    families = harmonic_families(scene, drive, offsets=offsets, relative_sizes=relative_sizes, rng_for=rng_for)
    trains = impact_trains(scene, drive, families, offsets=offsets, rng_for=rng_for)
    if scene.fidelity != "kinematic":  # what meshes do is then left to the mechanics
        meshes = {mesh.name for mesh in scene.gearbox.meshes}
        families = [family for family in families if family.source not in meshes]
        trains = [(number, train) for number, train in trains if train.source not in meshes]
    _check_rate(scene, families, drive)
    sources = dict.fromkeys([family.source for family in families] + [train.source for _, train in trains])
    gains, paths = _gains(scene, [*sources], rng_for=rng_for), transfer_paths(scene)
    chains = [linear_chain(sensor) for sensor in scene.sensors]
    speed_hz, load = drive.angle.speed_hz(instants_s), drive.load(instants_s)
    factor = _speed_factor(scene, drive, instants_s)
    amplitudes = []
    for family in families:
        at_place = line_amplitudes(family, gains=gains[family.source], speed_hz=speed_hz, load=load, mode=scene.path)
        for row, sensor in enumerate(scene.sensors):
            if (path := paths.get((family.source, sensor.name))) is not None:
                at_place[row] = line_amplitudes(family, gains=np.ones(1), speed_hz=speed_hz, load=load, mode=path)[0]
        amplitudes.append(_in_channels(family, at_place * factor, chains=chains, speed_hz=speed_hz))
    return PreparedScene(
        scene=scene,
        rng_for=rng_for,
        drive=drive,
        instants_s=instants_s,
        speed_hz=speed_hz,
        load=load,
        families=families,
        amplitudes=amplitudes,
        trains=trains,
        offsets=offsets,
        gains=gains,
        paths=paths,
        chains=chains,
        pulses=_pulses(scene, drive, rng=rng_for("pulses")),
    )


def ratio_of(scene: Scene, link: str) -> float:
    """Return the absolute speed ratio of a link to the reference shaft."""
    return float(abs(scene.ratio(link)))


def _pulses(scene: Scene, drive: Drive, *, rng: np.random.Generator) -> Pulses:
    link = scene.tachometer.link
    pulses = recorded_pulses(
        drive.angle, scene.tachometer, turns_per_rev=ratio_of(scene, link), stop_s=last_s(scene), rng=rng
    )
    if pulses.times_s.size < 2:  # noqa: PLR2004 - a speed is a difference
        raise SceneError(
            f"duration_s = {scene.duration_s:g} holds {pulses.times_s.size} pulse(s) of the tachometer, but a speed "
            "needs 2; lengthen the scene."
        )
    return pulses


def _speed_factor(scene: Scene, drive: Drive, times_s: Array) -> Array:
    """Return the declared dependence of source amplitudes on speed, at times (n,)."""
    exponent = scene.excitation.speed_exponent
    if exponent == 0:
        return np.ones(np.shape(times_s))
    top = drive.angle.top_speed_hz(0.0, scene.duration_s)
    return np.asarray((np.abs(drive.angle.speed_hz(times_s)) / top) ** exponent)


def _gains(scene: Scene, sources: list[str], *, rng_for: RandomStreams) -> dict[str, ComplexArray]:
    """Return the gain of each source to each sensor, with the transverse motion of the sensor."""
    along = sensor_gains(sources, sensors=len(scene.sensors), rng_for=rng_for)
    shares = np.array([_cross_axis_share(sensor) for sensor in scene.sensors])
    if not shares.any():
        return along
    # one sensor more, whose gain is not held at 1
    across = sensor_gains(sources, sensors=shares.size + 1, rng_for=lambda *words: rng_for(*words, "across"))
    return {source: gains + shares * across[source][1:] for source, gains in along.items()}


def _cross_axis_share(sensor: Sensor) -> float:
    """Return the transverse sensitivity of a sensor."""
    return sensor.cross_axis.share if sensor.cross_axis is not None else 0.0


def _in_channels(
    family: HarmonicFamily, amplitudes: ComplexArray, *, chains: Sequence[AllPoleFilter], speed_hz: Array
) -> ComplexArray:
    """Return the amplitudes of a family after the linear chain of each channel."""
    frequencies = np.outer([float(order) for order in family.orders], speed_hz)
    family_amplitudes = [chain.response(frequencies) for chain in chains]
    return np.asarray(amplitudes * np.stack(family_amplitudes))


def _check_rate(scene: Scene, families: Sequence[HarmonicFamily], drive: Drive) -> None:
    """Raise SceneError where the highest line is above half the sampling rate."""
    top_hz = drive.angle.top_speed_hz(0.0, scene.duration_s)
    highest = max((float(family.orders[-1]) for family in families), default=0.0)
    what, lower = f"highest line, order {highest:g}", "excitation.harmonics"
    if scene.fidelity != "kinematic":
        mesh, order = max(scene.exact_orders("gear_mesh").items(), key=lambda item: item[1])
        if order > highest:
            highest, what, lower = float(order), f'order of "{mesh}", {float(order):g}', "the speed"
    need = 2 * highest * top_hz
    if scene.rate_hz <= need:
        raise SceneError(
            f"rate_hz = {scene.rate_hz:g} is not above {need:.0f} Hz, twice the {what}, at top speed; raise rate_hz, "
            f"or lower {lower}: the highest order that fits is {scene.rate_hz / 2 / top_hz:.4g}."
        )
