"""Scene -> record with its truth: builds what the scene asks for, adds it up, and says what went in."""

from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from data_synth.combs import ComplexArray, random_stream
from data_synth.fidelity import Choice, decided
from data_synth.impacts import add_train
from data_synth.levels import LEFT_OUT, most_detailed_motion, simulated_motion, with_kinematic_lines
from data_synth.meshing import Gears
from data_synth.motion import Motion, prepared_gears
from data_synth.profile import Array
from data_synth.room import refuse_too_large
from data_synth.scene import Scene, SceneError, Sensor, load_scene
from data_synth.sensors import (
    Cascade,
    add_noise,
    clip,
    drop_outs,
    hum_lines,
    linear_chain,
    quantise,
)
from data_synth.stage import Stage, staged
from data_synth.truth import mesh_lines, motion_truth, phases_of, truth_of
from hums.record import Channel, PulseTimes, make_record

_BLOCK = 65536  # samples computed at once: what is only needed on the way does not grow with the record


def simulate(scene: Scene | str | Path, *, seed: int, by_source: bool = False, phases: bool = False) -> xr.Dataset:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene, path or catalogue name
    seed : int
        Not negative. Every random part has a stream of its own, named after what it belongs to, so adding a
        fault leaves phases, noise and the tachometer as they were. Same scene and seed, same bytes.
    by_source : bool
        Also keep ``truth_source`` (truth_channel, truth_source_name, time): the clean signal of each source behind the
        linear part of the chain, as large as a channel for each source.
    phases : bool
        Also keep the exact angle at each sample of every shaft and of every bearing's cage and rolling elements,
        ``truth_shaft_revolutions`` (truth_shaft, time) and ``truth_roller_revolutions`` (truth_roller, time).

    Returns
    -------
    xarray.Dataset
        A record. Its truth, on the clock of the record:

        ``truth_amplitude`` (truth_channel, truth_order, truth_time), complex
            Z of the clean signal at each order of the reference shaft, ``x = Re{Z exp(j order phase)}``, phase
            zero at the first tachometer mark, behind the filters and the sensitivity of the channel. Between the
            instants of truth_time, Z is linear: the lines of the signal are built so, without approximation. Sources
            at one exact order are added. What a tooth's impacts add to the listed orders is in it
            (`data_synth.path.impact_line` states the error); the further orders they reach are not listed, nor has a
            bearing with slip any line.
        ``truth_component``, ``truth_kind`` (truth_order)
            What speaks there, largest first, joined by " + ".
        ``truth_chain_response`` (truth_channel, truth_order, truth_time), complex
            The part of filters and sensitivity in truth_amplitude, where a channel has any.
        ``truth_speed``, ``truth_revolutions`` (truth_time)
            Speed of the reference shaft in rev s-1 and its exact angle in rev; ``truth_torque`` in N m as declared.
        ``truth_fault_component``, ``truth_fault_kind`` (truth_fault)
            As declared; of length zero in a healthy record. ``truth_fault_size`` (truth_fault, truth_time) in mm where
            one grows.
        ``truth_impact_times_1`` ...
            Times in s at which fault 1 ... is struck.
        ``truth_marks``, ``truth_missed_marks``, ``truth_spurious_pulses``
            When the tachometer's marks truly passed in s, the numbers of those that gave no pulse, and pulses without
            mark, where the scene spoils its tachometer.
        ``truth_hum_1``, ``truth_clipped_1``, ``truth_saturated_1``, ``truth_drop_outs_1``
            Amplitude of the mains' harmonics at time zero, how many samples were clipped and beyond the converter, and
            from when to when samples are missing, in s; where a channel has such a part.

        ``truth_tooth_passes_1`` ...
            Where gears vibrate: times in s at which the damaged tooth of fault 1 ... is in the middle of its mesh; its
            attribute ``half_width_rev`` is half the time it is in mesh, in rev of the reference shaft.

        Where gears vibrate, truth_amplitude holds at the orders of the meshes what their steady motion puts there, at
        constant speed and torque. Attribute ``truth_mesh_lines`` says how well that is known, or why
        it is left out, ``truth_fidelity`` which motions were simulated.

        Attribute ``truth_scene`` holds the scene with every default written out, ``truth_seed`` the seed.

    Raises
    ------
    SceneError
        For a scene that cannot be simulated, or that memory does not hold, with the sentence that says why and what to
        do.
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise SceneError(f"seed = {seed!r}: a whole number, 0 or more, is needed.")
    refuse_too_large(declared, by_source=by_source, phases=phases)
    stage = staged(declared, draws=partial(random_stream, seed))
    gears = prepared_gears(stage) if declared.fidelity != "kinematic" else None
    choice = decided(declared) if gears is not None else None
    if gears is not None and choice is not None:
        stage = with_kinematic_lines(stage, gears, choice.levels)
    late_s = _late(stage)
    parts = _by_source(stage, late_s=late_s) if by_source else {}
    signal = _clean(stage, late_s=late_s)
    if gears is not None and choice is not None:
        truth, told = _with_gears(stage, gears, choice, signal, parts)
    else:
        truth, told = truth_of(stage), {}
    for number, sensor in enumerate(declared.sensors):
        truth |= _spoil(stage, sensor, number + 1, signal[number], late_s=late_s)
    truth |= parts
    truth |= phases_of(stage) if phases else {}
    return make_record(
        {sensor.name: _channel(sensor, values) for sensor, values in zip(declared.sensors, signal, strict=True)},
        rate_hz=declared.rate_hz,
        angle=PulseTimes(
            times_s=stage.pulses.times_s,
            shaft=declared.tachometer.link,
            pulses_per_rev=declared.tachometer.pulses_per_rev,
        ),
        machine=declared.gearbox.name,
        truth=truth,
        attrs={"truth_scene": declared.to_toml(), "truth_seed": seed, **told},
    )


def _channel(sensor: Sensor, values: Array) -> Channel:
    return Channel(
        values=values,
        units=sensor.channel_units,
        sensor=f"on {sensor.on}",
        direction=sensor.direction,
        sensitivity=sensor.sensitivity.value if sensor.sensitivity is not None else None,
        measures=sensor.units if sensor.sensitivity is not None else None,
    )


# ---- the sum of all sources ----------------------------------------------------------------------------------


def _late(stage: Stage) -> Array | None:
    """Return how much later than its place each sample is taken, s."""
    jitter, scene = stage.scene.sampling_jitter, stage.scene
    return jitter.std_s * stage.draws("jitter").standard_normal(scene.samples) if jitter is not None else None


def _clean(stage: Stage, *, late_s: Array | None, only: tuple[str, str] | None = None) -> Array:
    """Return the signal behind the linear chain, (sensor, n), of all sources or of one component and kind."""
    scene = stage.scene
    signal = np.zeros((len(scene.sensors), scene.samples))
    for start in range(0, scene.samples, _BLOCK):
        here = slice(start, min(start + _BLOCK, scene.samples))
        stage.add_lines(signal[:, here], first=start, late_s=None if late_s is None else late_s[here], only=only)
    for number, train in stage.trains:
        if only in (None, (train.component, train.kind)):
            add_train(stage, number, train, signal, late_s=late_s)
    return signal


def _in_motion(motion: Motion) -> Array:
    """Return what the sensors hear of gears that vibrate, (sensor, n)."""
    scene, at = motion.stage.scene, 0
    signal = np.empty((len(scene.sensors), scene.samples))
    for block in motion.channels(samples=scene.samples):
        signal[:, at : at + block.shape[1]] = block
        at += block.shape[1]
    return signal


def _with_gears(
    stage: Stage, gears: Gears, choice: Choice, signal: Array, parts: dict[str, xr.DataArray]
) -> tuple[dict[str, xr.DataArray], dict[str, str]]:
    """Add gears that vibrate to a signal (sensor, n) and to the parts by source, where kept, and return the truth.

    With it come attributes: which motions were simulated, and how well the lines of meshes are known.
    """
    motion = simulated_motion(stage, gears, choice.levels)
    all_move = motion is not None and LEFT_OUT not in choice.levels.values()
    passes = motion_truth(
        motion if motion is not None and all_move else most_detailed_motion(stage, gears, choice.levels)
    )
    if motion is None:
        return truth_of(stage) | passes, {"truth_fidelity": str(choice), "truth_mesh_lines": "exact"}
    heard = _in_motion(motion)
    signal += heard
    found = mesh_lines(stage, heard)
    for name, sources in parts.items():
        # meshes act on each other, so all gears in motion are one source
        coords = {"truth_channel": sources["truth_channel"], "truth_source_name": ["gears, motion"]}
        own = xr.DataArray(heard[:, None], dims=sources.dims, coords=coords)
        parts[name] = xr.concat([sources, own], dim="truth_source_name").assign_attrs(sources.attrs)
    return truth_of(stage, found=found) | passes, {"truth_fidelity": str(choice), "truth_mesh_lines": found.about}


def _by_source(stage: Stage, *, late_s: Array | None) -> dict[str, xr.DataArray]:
    sources = dict.fromkeys(
        [(comb.component, comb.kind) for comb in stage.combs]
        + [(train.component, train.kind) for _, train in stage.trains]
    )
    signals = np.empty((len(stage.scene.sensors), len(sources), stage.scene.samples))
    for index, source in enumerate(sources):
        signals[:, index] = _clean(stage, late_s=late_s, only=source)
    names = {
        "truth_channel": [sensor.name for sensor in stage.scene.sensors],
        "truth_source_name": [f"{component}, {kind}" for component, kind in sources],
    }
    return {
        "truth_source": xr.DataArray(
            signals,
            dims=("truth_channel", "truth_source_name", "time"),
            coords=names,
            attrs={"units": stage.scene.sensors[0].channel_units},
        )
    }


# ---- what is not linear in the chain, or not of the machine --------------------------------------------------


def _spoil(
    stage: Stage, sensor: Sensor, number: int, values: Array, *, late_s: Array | None
) -> dict[str, xr.DataArray]:
    """Do to a channel (n,) what its chain does, in the order of the hardware, and return what was done."""
    scene, truth = stage.scene, {}
    units, channel = sensor.channel_units, {"channel": sensor.name}
    if sensor.hum is not None:
        lines = hum_lines(sensor.hum, _behind_cable(sensor), rng=stage.draws("hum", sensor.name))
        frequencies = sensor.hum.frequency_hz * np.arange(1, lines.size + 1)
        _add_hum(values, lines, sensor.hum.frequency_hz, rate_hz=scene.rate_hz, late_s=late_s)
        dim = f"truth_hum_frequency_{number}"
        attrs = {"units": units, "convention": "x = Re{Z exp(2 pi j f t)}", **channel}
        truth[f"truth_hum_{number}"] = xr.DataArray(lines, dims=dim, coords={dim: frequencies}, attrs=attrs)
    gain = abs(sensor.sensitivity.value) if sensor.sensitivity is not None else 1.0
    add_noise(values, rms=gain * scene.noise.rms, rng=stage.draws("noise", sensor.name))
    if sensor.clipping is not None:
        beyond = clip(values, level=sensor.clipping.level)
        truth[f"truth_clipped_{number}"] = xr.DataArray(beyond, attrs={"units": "1", **channel})
    if sensor.quantisation is not None:
        beyond = quantise(values, sensor.quantisation)
        truth[f"truth_saturated_{number}"] = xr.DataArray(beyond, attrs={"units": "1", **channel})
    if sensor.drop_outs is not None:
        rng = stage.draws("drop-outs", sensor.name)
        spans = drop_outs(values, sensor.drop_outs, rate_hz=scene.rate_hz, rng=rng)
        dims = (f"truth_drop_out_{number}", "truth_edge")
        truth[f"truth_drop_outs_{number}"] = xr.DataArray(
            spans, dims=dims, coords={"truth_edge": ["begin", "end"]}, attrs={"units": "s", **channel}
        )
    return truth


def _behind_cable(sensor: Sensor) -> Cascade:
    return linear_chain(sensor.changed(resonance=None, sensitivity=None))


def _add_hum(values: Array, lines: ComplexArray, frequency_hz: float, *, rate_hz: float, late_s: Array | None) -> None:
    for start in range(0, values.size, _BLOCK):
        here = slice(start, min(start + _BLOCK, values.size))
        times_s = np.arange(here.start, here.stop) / rate_hz
        times_s = times_s if late_s is None else times_s + late_s[here]
        for harmonic, line in enumerate(lines, start=1):
            angle = 2 * np.pi * np.remainder(harmonic * frequency_hz * times_s, 1.0)
            values[here] += line.real * np.cos(angle) - line.imag * np.sin(angle)
