"""Scene -> record with its truth: builds what the scene asks for, adds it up, and says what went in."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from data_synth.combs import Comb, ComplexArray, Draws, add_lines, healthy_combs
from data_synth.faults import ImpactTrain, crack_comb, impact_train, mesh_of
from data_synth.path import add_rings, impact_line, line_amplitudes, ring_seconds, sensor_gains
from data_synth.profile import Array, ShaftAngle, load_share
from data_synth.scene import Scene, SceneError, ToothCrack, load_scene
from data_synth.sensors import add_noise, pulse_times
from hums.record import Channel, PulseTimes, make_record


def simulate(scene: Scene | str | Path, *, seed: int) -> xr.Dataset:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene, path or catalogue name
    seed : int
        Not negative. Every random part has a stream of its own, named after what it belongs to, so adding a
        fault leaves phases, noise and the tachometer as they were. Same scene and seed, same bytes.

    Returns
    -------
    xarray.Dataset
        A record. Its truth, on the clock of the record:

        ``truth_amplitude`` (truth_channel, truth_order, truth_time), complex
            Z of the clean signal at each order of the reference shaft, ``x = Re{Z exp(j order phase)}``, phase
            zero at the first tachometer pulse. Between the instants of truth_time, Z is linear: the lines of
            the signal are built so, without approximation. Sources at one exact order are added. What a
            tooth's impacts add to the listed orders is in it (`data_synth.path.impact_line` states the error);
            the further orders they reach are not listed, nor has a bearing with slip any line.
        ``truth_component``, ``truth_kind`` (truth_order)
            What speaks there, largest first, joined by " + ".
        ``truth_speed`` (truth_time)
            Speed of the reference shaft in rev s-1.
        ``truth_fault_component``, ``truth_fault_kind`` (truth_fault)
            As declared; of length zero in a healthy record.
        ``truth_impact_times_1`` ...
            Times in s at which fault 1 ... is struck.

        Attribute ``truth_scene`` holds the scene with every default written out, ``truth_seed`` the seed.

    Raises
    ------
    SceneError
        For a scene that cannot be simulated, with the sentence that says why and what to do.
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise SceneError(f"seed = {seed!r}: a whole number, 0 or more, is needed.")
    stage = _staged(declared, draws=partial(_stream, seed))
    return make_record(
        _channels(stage),
        rate_hz=declared.rate_hz,
        angle=_tachometer(stage),
        machine=declared.gearbox.name,
        truth=_truth(stage),
        attrs={"truth_scene": declared.to_toml(), "truth_seed": seed},
    )


def _stream(seed: int, *words: str) -> np.random.Generator:
    """Return the generator that belongs to `words`."""
    keys = tuple(zlib.crc32(word.encode()) for word in words)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=keys))


@dataclass(frozen=True, kw_only=True)
class _Stage:
    """Everything a scene sets in motion, before a sample is computed; `amplitudes` are those of the combs."""

    scene: Scene
    draws: Draws
    angle: ShaftAngle
    instants_s: Array
    speed_hz: Array
    load: Array
    combs: Sequence[Comb]
    amplitudes: Sequence[ComplexArray]
    trains: Sequence[ImpactTrain]
    gains: dict[str, ComplexArray]


def _staged(scene: Scene, *, draws: Draws) -> _Stage:
    angle = _reference_angle(scene, rng=draws("tachometer"))
    instants_s = np.linspace(0.0, scene.duration_s, scene.truth_times)
    speed_hz, load = angle.speed_hz(instants_s), load_share(scene.torque, instants_s)
    offsets = [float(draws("offset", str(number)).random()) for number in range(len(scene.faults))]
    combs = _combs(scene, offsets=offsets, draws=draws)
    _check_rate(scene, combs, angle)
    trains = _trains(scene, angle, offsets=offsets, draws=draws)
    sources = dict.fromkeys([comb.source for comb in combs] + [train.source for train in trains])
    gains = sensor_gains([*sources], sensors=len(scene.sensors), draws=draws)
    amplitudes = [
        line_amplitudes(comb, gains=gains[comb.source], speed_hz=speed_hz, load=load, mode=scene.path) for comb in combs
    ]
    return _Stage(
        scene=scene,
        draws=draws,
        angle=angle,
        instants_s=instants_s,
        speed_hz=speed_hz,
        load=load,
        combs=combs,
        amplitudes=amplitudes,
        trains=trains,
        gains=gains,
    )


def _reference_angle(scene: Scene, *, rng: np.random.Generator) -> ShaftAngle:
    """Return the angle of the reference shaft, revolution zero at the first pulse of the tachometer."""
    times_s, speeds_hz = np.array(scene.speed_knots_hz()).T
    tachometer = scene.tachometer
    spacing = 1 / tachometer.pulses_per_rev
    turn = tachometer.offset_rev if tachometer.offset_rev is not None else spacing * rng.random()
    angle = ShaftAngle(times_s=times_s, speeds_hz=speeds_hz)
    return replace(angle, datum_rev=turn / float(abs(scene.ratio(tachometer.link))))


def _combs(scene: Scene, *, offsets: Sequence[float], draws: Draws) -> list[Comb]:
    """Return the healthy gearbox, then what each crack adds; two cracks in one mesh do not modulate each other."""
    healthy = healthy_combs(scene, draws=draws)
    meshes = {comb.component: comb for comb in healthy if comb.kind == "gear_mesh"}
    cracks = [
        crack_comb(scene, fault, mesh=meshes[mesh_of(fault)], offset=offset)
        for fault, offset in zip(scene.faults, offsets, strict=True)
        if isinstance(fault, ToothCrack)
    ]
    return healthy + cracks


def _trains(scene: Scene, angle: ShaftAngle, *, offsets: Sequence[float], draws: Draws) -> list[ImpactTrain]:
    """Return the impacts that are heard in the record, so also those just before it."""
    before_s, last_s = -ring_seconds(scene.resonance), (scene.samples - 1) / scene.rate_hz
    first_rev, last_rev = angle.revolutions([before_s, last_s])
    span_rev = (float(first_rev), float(last_rev))
    return [
        impact_train(scene, number, offset=offset, span_rev=span_rev, draws=draws)
        for number, offset in enumerate(offsets)
    ]


def _check_rate(scene: Scene, combs: Sequence[Comb], angle: ShaftAngle) -> None:
    highest = float(max((comb.orders[-1] for comb in combs), default=Fraction(0)))
    turning_points_s = np.clip([0.0, scene.duration_s, *angle.times_s], 0.0, scene.duration_s)
    need = 2 * highest * float(np.max(angle.speed_hz(turning_points_s)))
    if scene.rate_hz <= need:
        raise SceneError(
            f"rate_hz = {scene.rate_hz:g} is not above {need:.0f} Hz, twice the highest line, order "
            f"{highest:g}, at top speed; raise rate_hz or lower excitation.harmonics."
        )


def _channels(stage: _Stage) -> dict[str, Channel]:
    scene, signal = stage.scene, _clean(stage)
    for sensor, values in zip(scene.sensors, signal, strict=True):
        add_noise(values, rms=scene.noise.rms, rng=stage.draws("noise", sensor.name))
    return {
        sensor.name: Channel(values=values, units=sensor.units, sensor=f"on {sensor.on}", direction=sensor.direction)
        for sensor, values in zip(scene.sensors, signal, strict=True)
    }


def _clean(stage: _Stage) -> Array:
    """Return the signal without noise, (sensor, n)."""
    scene = stage.scene
    times_s = np.arange(scene.samples) / scene.rate_hz
    revolutions = stage.angle.revolutions(times_s)
    position = times_s * ((scene.truth_times - 1) / scene.duration_s)
    signal = np.zeros((len(scene.sensors), scene.samples))
    for comb, amplitudes in zip(stage.combs, stage.amplitudes, strict=True):
        add_lines(signal, amplitudes, base=comb.base, revolutions=revolutions, position=position)
    for train in stage.trains:
        struck_s = stage.angle.times(train.revolutions)
        sizes = np.outer(np.abs(stage.gains[train.source]), train.amplitudes * load_share(scene.torque, struck_s))
        add_rings(signal, times_s=struck_s, amplitudes=sizes, mode=scene.resonance, rate_hz=scene.rate_hz)
    return signal


def _tachometer(stage: _Stage) -> PulseTimes:
    scene = stage.scene
    link, per_rev = scene.tachometer.link, scene.tachometer.pulses_per_rev
    times_s = pulse_times(
        stage.angle,
        turns_per_rev=float(abs(scene.ratio(link))),
        pulses_per_rev=per_rev,
        stop_s=(scene.samples - 1) / scene.rate_hz,
    )
    if times_s.size < 2:  # noqa: PLR2004 - a speed is a difference
        raise SceneError(
            f"duration_s = {scene.duration_s:g} holds {times_s.size} pulse(s) of the tachometer, but a speed "
            "needs 2; lengthen the scene."
        )
    return PulseTimes(times_s=times_s, shaft=link, pulses_per_rev=per_rev)


# ---- truth -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Part:
    """What one source adds at one order: Z (sensor, instant)."""

    component: str
    kind: str
    amplitude: ComplexArray


def _truth(stage: _Stage) -> dict[str, xr.DataArray]:
    instants = xr.DataArray(stage.instants_s, dims="truth_time", attrs={"units": "s"})
    speed = xr.DataArray(
        stage.speed_hz,
        dims="truth_time",
        coords={"truth_time": instants},
        attrs={"units": "rev s-1", "shaft": stage.scene.gearbox.reference},
    )
    return {"truth_speed": speed, **_line_truth(stage, instants), **_fault_truth(stage)}


def _line_truth(stage: _Stage, instants: xr.DataArray) -> dict[str, xr.DataArray]:
    lines = dict(sorted(_lines(stage).items()))
    for parts in lines.values():
        parts.sort(key=lambda part: -float(np.max(np.abs(part.amplitude))))
    orders = {"truth_order": [float(order) for order in lines]}
    sensors = stage.scene.sensors
    amplitude = xr.DataArray(
        np.stack([np.sum([part.amplitude for part in parts], axis=0) for parts in lines.values()], axis=1)
        if lines
        else np.zeros((len(sensors), 0, instants.size), dtype=np.complex128),
        dims=("truth_channel", "truth_order", "truth_time"),
        coords={"truth_channel": [sensor.name for sensor in sensors], **orders, "truth_time": instants},
        attrs={"units": sensors[0].units, "convention": "x = Re{Z exp(j order phase)}, peak amplitude"},
    )
    labels = {
        f"truth_{name}": xr.DataArray(
            [" + ".join(dict.fromkeys(getattr(part, name) for part in parts)) for parts in lines.values()],
            dims="truth_order",
            coords=orders,
        )
        for name in ("component", "kind")
    }
    return {"truth_amplitude": amplitude, **labels}


def _lines(stage: _Stage) -> dict[Fraction, list[_Part]]:
    """Return what is heard at each order: the lines of the combs, then what impacts add to them."""
    lines: dict[Fraction, list[_Part]] = {}
    for comb, amplitudes in zip(stage.combs, stage.amplitudes, strict=True):
        for index, order in enumerate(comb.orders):
            if comb.coefficients[index] != 0:
                part = _Part(component=comb.component, kind=comb.kind, amplitude=amplitudes[:, index])
                lines.setdefault(order, []).append(part)
    for train in stage.trains:
        for order, parts in lines.items():
            if train.order is not None and train.amplitudes.any() and (order / train.order).denominator == 1:
                parts.append(_impact_part(stage, train, harmonic=int(order / train.order)))
    return lines


def _impact_part(stage: _Stage, train: ImpactTrain, *, harmonic: int) -> _Part:
    amplitude = impact_line(
        train,
        harmonic=harmonic,
        speed_hz=stage.speed_hz,
        load=stage.load,
        mode=stage.scene.resonance,
    )
    gains = np.abs(stage.gains[train.source])
    return _Part(component=train.component, kind=train.kind, amplitude=np.outer(gains, amplitude))


def _fault_truth(stage: _Stage) -> dict[str, xr.DataArray]:
    faults = stage.scene.faults
    truth = {
        f"truth_fault_{name}": xr.DataArray(
            np.array([getattr(fault, name) for fault in faults], dtype=np.str_), dims="truth_fault"
        )
        for name in ("component", "kind")
    }
    last_s = (stage.scene.samples - 1) / stage.scene.rate_hz
    for number, train in enumerate(stage.trains, start=1):
        times_s = stage.angle.times(train.revolutions)
        truth[f"truth_impact_times_{number}"] = xr.DataArray(
            times_s[(times_s >= 0) & (times_s <= last_s)],
            dims=f"truth_impact_{number}",
            attrs={"units": "s", "component": train.component, "kind": faults[number - 1].kind},
        )
    return truth
