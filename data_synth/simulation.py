"""Simulate a scene: sum the sources, apply the measurement chain, and state the truth beside the record."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from data_synth.cost import refuse_too_large
from data_synth.fidelity.choice import Choice, chosen, with_gear_lines
from data_synth.fidelity.linear_response import with_gear_faults
from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import GearFault
from data_synth.scene.random_streams import RandomStreams, Streams
from data_synth.scene.scene import Scene, SceneError, load_scene
from data_synth.scene.sensors import Sensor
from data_synth.sources.disturbances import (
    add_electrical,
    add_outside_sources,
    gain_drift,
    noise_level,
    sensor_truth,
)
from data_synth.sources.impact_responses import add_impacts, later
from data_synth.sources.prepared import PreparedScene, prepare_scene
from data_synth.transfer.acquisition import BLOCK, add_noise, clip, drop_outs, quantise
from data_synth.truth import angle_truth, truth_variables
from data_synth.vibration.gear_lines import GearLines, gear_lines, samples_compared
from data_synth.vibration.mechanics import link_speeds, mechanics_truth, speed_truth
from data_synth.vibration.run import Motion, motion_of
from hums.records.record import Channel, PulseTimes, make_record
from signals._validation import checked


@checked
def simulate(
    scene: Scene | str | Path,
    *,
    seed: int,
    machine_seed: int | None = None,
    by_source: bool = False,
    phases: bool = False,
    mechanics: bool = False,
    detectability: bool | float = False,
) -> xr.Dataset:
    """Simulate a scene: return its record together with its truth.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, the path of its file, or its name in the catalogue.
    seed : int
        Not negative. Every random quantity has a stream of its own, named after what it belongs to, so that adding a
        fault changes neither phases nor noise nor tachometer. The same scene and seed give the same bytes.
    machine_seed : int or None
        For several records of one machine: seed of what all of them share, such as tooth errors, tooth damage,
        imbalance, phases, and sensor gains and mounts. The machine has made a random number of revolutions before the
        record. None: everything follows from `seed`.
    by_source : bool
        Also return ``truth_source`` (truth_channel, truth_source_name, time): the noise-free signal of each source
        after the linear part of the measurement chain. Each source takes as much memory as a channel.
    phases : bool
        Also return the exact angle, at each sample, of every shaft and of the cage and rolling elements of every
        bearing: ``truth_shaft_revolutions`` (truth_shaft, time) and ``truth_roller_revolutions`` (truth_roller, time),
        in rev.
    mechanics : bool
        Also return the speed of every link at each sample and, where gears vibrate, the internal quantities
        ``truth_transmission_error``, ``truth_mesh_force``, ``truth_mesh_stiffness``, ``truth_bearing_force``, etc. that
        `data_synth.vibration.mechanics.mechanics_truth` defines. Costs a second integration.
    detectability : bool or float
        Also return ``truth_fault_detectability_db`` (truth_channel, truth_fault): what each fault alone adds to the
        noise-free healthy channel of the same seed, relative to the channel's noise and quantisation, in a matched
        filter (Turin 1960, IRE Trans. Inf. Theory 6, 311). Costs a simulation of the healthy channel and, with several
        faults, one for each; a number is the length in s of the beginning from which it is extrapolated.

    Returns
    -------
    xarray.Dataset
        The record with its truth, whose times are on the clock of the record:

        ``truth_amplitude`` (truth_channel, truth_order, truth_time), complex
            Complex amplitude Z of the noise-free signal at each order of the reference shaft, after the filters and
            the sensitivity of the channel: ``x = Re{Z exp(j order phase)}``, with phase zero at the first tachometer
            mark. Z is linear between the instants of truth_time; a kinematic signal is built this way, so its lines are
            exact. Where gears vibrate, ``docs/benchmarks/truth.md`` states the share of the power that the lines
            account for. Sources at exactly the same order are summed. Impacts of a damaged tooth have lines down to a
            hundredth of the largest (`data_synth.transfer.paths.impact_line` states the error); a bearing with slip has
            none.
        ``truth_component``, ``truth_kind`` (truth_order)
            Components and kinds of the sources at that order, largest first, joined by " + ".
        ``truth_free`` (truth_channel)
            Share of the gears' vibration power that is free vibration, after a start from rest or a load step.
        ``truth_left``, ``truth_fault_left`` (truth_channel)
            Share of the remaining power, and of the power added by damaged teeth, that the lines do not account for.
            Absent where the lines account for the whole signal.
        ``truth_chain_poles`` (truth_channel, truth_chain_pole), complex, ``truth_chain_gain`` (truth_channel)
            Filters and sensitivity, ``H(f) = gain prod p / (p - 2j pi f)``, already included in truth_amplitude;
            present where a channel has any. Channels with fewer poles are padded with NaN.
        ``truth_speed``, ``truth_revolutions`` (truth_time)
            Speed of the reference shaft in rev s-1 and its exact angle in rev; ``truth_torque``, N m, if declared.
        ``truth_fault_component``, ``truth_fault_kind`` (truth_fault)
            As declared; of length zero in a healthy record. ``truth_fault_size`` (truth_fault, truth_time), in mm, if
            there are faults.
        ``truth_impact_times_1``, etc.
            Times in s of the impacts of fault 1, etc.
        ``truth_marks``, ``truth_missed_marks``, ``truth_spurious_pulses``
            Where the scene degrades its tachometer: exact times of its marks in s, the numbers of marks without a
            pulse, and times in s of pulses without a mark.
        ``truth_clipped_1``, ``truth_saturated_1``, ``truth_drop_outs_1``
            Where a channel has such effects: numbers of clipped samples and of samples beyond the converter's range,
            and beginnings and ends of drop-outs in s.
        ``truth_electrical``, ``truth_neighbour``, ``truth_knocks``, ``truth_gain``, ``truth_noise_level``, etc.
            Disturbances from outside the machine and sensor imperfections that the scene declares: `docs/scenes.md`.
        ``truth_tooth_passes_1``, etc.
            Where gears vibrate: times in s at which the damaged tooth of fault 1, etc. is midway through its mesh;
            attribute ``half_width_rev`` is half the time in mesh, in rev of the reference shaft.

        Where gears vibrate, truth_amplitude has every significant line of the meshes, of damaged gears and of their
        intermodulation, projected from the noise-free signal; the contribution of damage is the difference from sound
        teeth (`data_synth.vibration.gear_lines.gear_lines`). Attribute ``truth_mesh_lines`` states their resolution,
        ``truth_fidelity`` the gear model and why it was chosen. ``truth_scene`` holds the scene with every default
        written out, ``truth_seed`` the seed, and ``truth_machine_seed`` that of the machine if given.

    Raises
    ------
    SceneError
        If the scene cannot be simulated or does not fit into memory; the message gives the reason and the remedy.

    Examples
    --------
    The mesh of a 23-tooth gear at 20 rev/s is a tone at 460 Hz, here of amplitude 2:

    >>> import numpy as np
    >>> from data_synth import Scene, simulate
    >>> scene = Scene.from_mapping({
    ...     "gearbox": "two-stage", "rate_hz": 5000, "duration_s": 1, "fidelity": "kinematic",
    ...     "speed": {"link": "input", "rpm": 1200}, "tachometer": {"link": "input", "pulses_per_rev": 1},
    ...     "excitation": {"mesh_amplitude": 2, "harmonics": 1}, "noise": {"rms": 0},
    ...     "sensor": [{"name": "input", "on": "input bearing", "units": "g"}],
    ... })
    >>> record = simulate(scene, seed=1)
    >>> spectrum = np.fft.rfft(record["input"].values) / (scene.samples / 2)
    >>> f"{abs(spectrum[460]):.2f}", f"{abs(record['truth_amplitude'].sel(truth_order=23)).values.max():.2f}"
    ('2.00', '2.00')
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    for name, value in (("seed", seed), ("machine_seed", 0 if machine_seed is None else machine_seed)):
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise SceneError(f"{name} = {value!r} must be a whole number, 0 or more.")
    if not 0 <= detectability < math.inf:
        raise SceneError(f"detectability = {detectability!r} must be true, false, or a length in s.")
    refuse_too_large(declared, by_source=by_source, phases=phases, mechanics=mechanics)
    streams, trial_s = Streams(seed=seed, machine_seed=machine_seed), detectability
    kept = declared.samples if trial_s is True else min(declared.samples, math.ceil(trial_s * declared.rate_hz))
    record, own = _simulated(declared, streams, kept, by_source=by_source, phases=phases, mechanics=mechanics)
    if kept:
        return record.assign(truth_fault_detectability_db=_fault_detectability(declared, streams, own))
    return record


@dataclass(frozen=True, kw_only=True)
class NoiseFree:
    """Channels after the linear part of their measurement chains.

    Attributes
    ----------
    signal : (sensor, n) array
        In the units of the channels.
    of_sound_gears : (sensor, n) array or None
        What vibrating gears with sound teeth would add to it; None without such gears.
    steps : int or None
        Integration steps per sample; None without vibrating gears.
    choice : Choice or None
        Model of the gears; None in a kinematic scene.
    """

    signal: Array
    of_sound_gears: Array | None = None
    steps: int | None = None
    choice: Choice | None = None


def _simulated(
    declared: Scene,
    streams: Streams,
    kept: int,
    *,
    by_source: bool = False,
    phases: bool = False,
    mechanics: bool = False,
) -> tuple[xr.Dataset, NoiseFree]:
    """Return the record of a scene, and the first `kept` samples after the linear part of its channels' chains."""
    prepared, motion, choice, attrs = _set_up(declared, streams, turns_before=streams.turns_before)
    signal, gear_signal = _clean(prepared), None
    if motion is not None and choice is not None and not choice.linear:
        measured, noise_free, gear_signal = _with_gears(prepared, motion, choice, signal, kept=kept)
        truth = truth_variables(prepared, motion=motion, measured=measured)
        attrs["truth_mesh_lines"] = measured.about
    else:
        truth, noise_free = (
            truth_variables(prepared, motion=motion),
            NoiseFree(signal=signal[:, :kept].copy(), choice=choice),
        )
    parts = _by_source(prepared, gear_signal) if by_source else {}
    truth |= add_outside_sources(prepared, signal)
    truth |= sensor_truth(prepared)
    _drift(prepared, signal, truth, parts)
    truth |= add_electrical(prepared, signal)
    for number, sensor in enumerate(declared.sensors):
        truth |= _apply_chain(prepared, sensor, number + 1, signal[number])
    truth |= parts
    truth |= angle_truth(prepared) if phases else {}
    if mechanics:
        truth |= _mechanics(prepared, motion, choice)
    record = make_record(
        {sensor.name: _channel(sensor, values) for sensor, values in zip(declared.sensors, signal, strict=True)},
        rate_hz=declared.rate_hz,
        angle=PulseTimes(
            times_s=prepared.pulses.times_s,
            shaft=declared.tachometer.link,
            pulses_per_rev=declared.tachometer.pulses_per_rev,
        ),
        machine=declared.gearbox.name,
        truth=truth,
        attrs={"truth_scene": declared.to_toml(), **streams.attrs, **attrs},
    )
    return record, noise_free


def _set_up(
    scene: Scene, rng_for: RandomStreams, *, turns_before: int, choice: Choice | None = None
) -> tuple[PreparedScene, Motion | None, Choice | None, dict[str, str]]:
    """Return the prepared scene and, where gears vibrate, their motion and its model.

    The last value has attributes that state the model, or how the gear faults of a kinematic scene were computed.
    `choice` is the model; None: that of the scene.
    """
    prepared = prepare_scene(scene, rng_for=rng_for, turns_before=turns_before)
    if scene.fidelity == "kinematic":
        prepared, gear_faults = with_gear_faults(prepared)
        return prepared, None, None, {"truth_gear_faults": gear_faults} if gear_faults else {}
    motion = motion_of(prepared)
    choice = chosen(motion) if choice is None else choice
    attrs = {"truth_fidelity": str(choice), "truth_mesh_lines": "exact"}
    return with_gear_lines(prepared, motion, choice), motion, choice, attrs


def _channel(sensor: Sensor, values: Array) -> Channel:
    """Return one sensor's samples as a channel of a record."""
    return Channel(
        values=values,
        units=sensor.channel_units,
        sensor=f"on {sensor.on}",
        direction=sensor.direction,
        sensitivity=sensor.sensitivity.value if sensor.sensitivity is not None else None,
        measures=sensor.units if sensor.sensitivity is not None else None,
    )


# ---- the sum of all sources ----------------------------------------------------------------------------------


def _clean(prepared: PreparedScene, *, only: tuple[str, str] | None = None, samples: int | None = None) -> Array:
    """Return the signal (sensor, n) after the linear chain: all sources or one (component, kind), `samples` or all."""
    scene = prepared.scene
    count = scene.samples if samples is None else samples
    signal = np.zeros((len(scene.sensors), count))
    for start in range(0, count, BLOCK):
        here = slice(start, min(start + BLOCK, count))
        prepared.add_lines(signal[:, here], first=start, only=only)
    for number, train in prepared.trains:
        if only in (None, (train.component, train.kind)):
            add_impacts(prepared, number, train, signal)
    return signal


def _gear_vibration(motion: Motion, *, samples: int, steps: int) -> Array:
    """Return the response of the sensors to the vibration of the gears, (sensor, n)."""
    signal, at = np.empty((len(motion.stage.scene.sensors), samples)), 0
    for block in motion.channels(samples=samples, steps=steps):
        signal[:, at : at + block.shape[1]] = block
        at += block.shape[1]
    for sensor, values in zip(motion.stage.scene.sensors, signal, strict=True):
        if sensor.skew_s:
            values[:] = later(values, sensor.skew_s * motion.stage.scene.rate_hz)
    return signal


def _with_gears(
    prepared: PreparedScene, motion: Motion, choice: Choice, signal: Array, *, kept: int
) -> tuple[GearLines, NoiseFree, Array]:
    """Add the integrated vibration of the gears to a signal (sensor, n).

    Return its lines, the first `kept` samples of the signal, and the vibration (sensor, n).
    """
    steps, samples = motion.steps(), prepared.scene.samples
    gear_signal = sound_signal = _gear_vibration(motion, samples=samples, steps=steps)
    signal += gear_signal
    free = _free_vibration(motion, gear_signal, steps=steps)
    if damaged := any(isinstance(fault, GearFault) for fault in prepared.scene.faults):
        compared = max(kept, samples_compared(prepared, prepared.scene))
        sound_signal = _gear_vibration(motion_of(prepared.without_faults()), samples=compared, steps=steps)
    sound_forced = sound_signal - free[:, : sound_signal.shape[1]]
    measured = gear_lines(prepared, gear_signal - free, sound=sound_forced if damaged else None)
    power, whole = np.mean(free**2, axis=1), np.var(gear_signal, axis=1)
    share = np.divide(power, whole, out=np.zeros_like(whole), where=whole > 0)
    noise_free = NoiseFree(
        signal=signal[:, :kept].copy(),
        of_sound_gears=sound_signal[:, :kept].copy(),
        steps=steps,
        choice=choice,
    )
    return replace(measured, free=share), noise_free, gear_signal


def _free_vibration(motion: Motion, signal: Array, *, steps: int) -> Array:
    """Return the free vibration in a signal (sensor, n) after a start from rest and load steps; zero without them.

    Two motions under the same forces differ by a free vibration; the other motion starts in static equilibrium and
    follows it through load steps.
    """
    forced = motion.without_free_vibration()
    if forced is None:
        return np.zeros_like(signal)
    return signal - _gear_vibration(forced, samples=signal.shape[1], steps=steps)


def _by_source(prepared: PreparedScene, gear_signal: Array | None) -> dict[str, xr.DataArray]:
    """Return the signal of each source alone at every sensor; meshes interact, so all vibrating gears are one."""
    names = [f"{component}, {kind}" for component, kind in prepared.sources]
    names += [] if gear_signal is None else ["gears, motion"]
    signals = np.empty((len(prepared.scene.sensors), len(names), prepared.scene.samples))
    for index, source in enumerate(prepared.sources):
        signals[:, index] = _clean(prepared, only=source)
    if gear_signal is not None:
        signals[:, -1] = gear_signal
    return {
        "truth_source": xr.DataArray(
            signals,
            dims=("truth_channel", "truth_source_name", "time"),
            coords={"truth_source_name": names},
            attrs={"units": prepared.scene.sensors[0].channel_units},
        )
    }


# ---- on request ----------------------------------------------------------------------------------------------


def _mechanics(prepared: PreparedScene, motion: Motion | None, choice: Choice | None) -> dict[str, xr.DataArray]:
    """Return the speeds of all links and, where gears vibrate, what is inside the gearbox."""
    if motion is None:
        return speed_truth(link_speeds(prepared))
    if choice is not None and choice.linear:
        raise SceneError(
            'mechanics = True needs a time integration, but with fidelity = "auto" this record is a linear response; '
            'set fidelity = "dynamic".'
        )
    return mechanics_truth(motion)


_OF_A_FAULT = {"offset", "impacts", "pits"}  # random streams named after the number of the fault


def _fault_detectability(scene: Scene, streams: Streams, own: NoiseFree) -> xr.DataArray:
    """Return the detectability (truth_channel, truth_fault) in dB of each fault alone in each channel.

    This is the signal-to-noise ratio at the output of a filter matched to what the fault adds to the noise-free healthy
    channel of the same seed (Turin 1960, IRE Trans. Inf. Theory 6, 311): the sum over samples of its square over the
    variance of the channel's white noise, whose level may wander, and quantisation noise. Its square root is the
    deflection of the optimum detector of a known signal: 14 dB gives a probability of detection of 0.99 at one false
    alarm in 200. `own` are the channels of the scene itself, from whose number of samples it is extrapolated. Costs
    one simulation, and with several faults one for each, none of them with a truth.
    """
    # the same steps in all motions: their integration errors nearly cancel in the difference
    samples = own.signal.shape[1]
    alike = partial(_noise_free, turns_before=streams.turns_before, samples=samples, choice=own.choice, steps=own.steps)
    healthy = alike(scene.changed(faults=()), streams, of_gears=own.of_sound_gears) if scene.faults else own
    variances = [_noise_variance(scene, sensor, streams) for sensor in scene.sensors]
    ratios_db = np.empty((len(scene.sensors), len(scene.faults)))
    for number, fault in enumerate(scene.faults):

        def rng_for(*words: str, number: int = number) -> np.random.Generator:
            return streams(*((words[0], str(number)) if words[0] in _OF_A_FAULT else words))

        faulty = own
        if len(scene.faults) > 1:
            faulty = alike(scene.changed(faults=(fault,)), rng_for)
        added = faulty.signal - healthy.signal
        for row, variance in enumerate(variances):
            with np.errstate(divide="ignore", invalid="ignore"):
                shares = np.where(added[row] != 0, added[row] ** 2 / variance[:samples], 0.0)
                ratios_db[row, number] = 10 * np.log10(np.sum(shares)) + 10 * math.log10(scene.samples / samples)
    about = "matched filter for what the fault adds, against the noise of the channel: sum of d^2 / s^2"
    return xr.DataArray(
        ratios_db,
        dims=("truth_channel", "truth_fault"),
        coords={"truth_channel": [sensor.name for sensor in scene.sensors]},
        attrs={"units": "dB", "about": about},
    )


def noise_free(scene: Scene, *, seed: int, steps: int | None = None) -> NoiseFree:
    """Return the channels of a scene after the linear part of their measurement chains, without record and truth.

    Parameters
    ----------
    scene : Scene
    seed : int
    steps : int, optional
        Integration steps per sample for vibrating gears; if left out, as many as the scene's error tolerance requires.

    Returns
    -------
    NoiseFree

    Raises
    ------
    SceneError
        If the scene cannot be simulated.

    Examples
    --------
    >>> from data_synth import load_scene
    >>> from data_synth.simulation import noise_free
    >>> noise_free(load_scene("demo").changed(duration_s=0.1), seed=1).signal.shape
    (1, 5000)
    """
    streams = Streams(seed=seed)
    return _noise_free(scene, streams, turns_before=streams.turns_before, samples=scene.samples, steps=steps)


def _noise_free(
    scene: Scene,
    rng_for: RandomStreams,
    *,
    turns_before: int,
    samples: int,
    choice: Choice | None = None,
    steps: int | None = None,
    of_gears: Array | None = None,
) -> NoiseFree:
    """Return the first `samples` of the channels of a scene after the linear part of their chains.

    `choice` is the gear model, None that of the scene; `of_gears` the vibration of the gears where it is known.
    """
    prepared, motion, choice, _ = _set_up(scene, rng_for, turns_before=turns_before, choice=choice)
    signal = _clean(prepared, samples=samples)
    if motion is not None and of_gears is None and not (choice is not None and choice.linear):
        steps = motion.steps() if steps is None else steps
        of_gears = _gear_vibration(motion, samples=samples, steps=steps)
    return NoiseFree(signal=signal if of_gears is None else signal + of_gears, steps=steps)


def _noise_variance(scene: Scene, sensor: Sensor, rng_for: RandomStreams) -> Array:
    """Return the variance (n,) of a channel's white and quantisation noise."""
    gain = abs(sensor.sensitivity.value) if sensor.sensitivity is not None else 1.0
    level_db = noise_level(scene, rng_for=rng_for)(np.arange(scene.samples) / scene.rate_hz)
    variance = (gain * scene.noise.rms) ** 2 * 10 ** (level_db / 10)
    if sensor.quantisation is not None:
        variance = variance + (2 * sensor.quantisation.full_scale / 2**sensor.quantisation.bits) ** 2 / 12
    return variance


# ---- the nonlinear part of the chain, and sensor drift -------------------------------------------------------


def _apply_chain(prepared: PreparedScene, sensor: Sensor, number: int, values: Array) -> dict[str, xr.DataArray]:
    """Apply the nonlinear part of a channel's chain to its samples (n,), in place and in hardware order.

    Returns the truth variables that state what was done.
    """
    scene, truth = prepared.scene, {}
    channel = {"channel": sensor.name}
    gain = abs(sensor.sensitivity.value) if sensor.sensitivity is not None else 1.0
    level_db, rng = noise_level(scene, rng_for=prepared.rng_for), prepared.rng_for("noise", sensor.name)
    add_noise(values, rms=gain * scene.noise.rms, rng=rng, level_db=lambda numbers: level_db(numbers / scene.rate_hz))
    if sensor.clipping is not None:
        beyond = clip(values, level=sensor.clipping.level)
        truth[f"truth_clipped_{number}"] = xr.DataArray(beyond, attrs={"units": "1", **channel})
    if sensor.quantisation is not None:
        beyond = quantise(values, sensor.quantisation)
        truth[f"truth_saturated_{number}"] = xr.DataArray(beyond, attrs={"units": "1", **channel})
    if sensor.drop_outs is not None:
        rng = prepared.rng_for("drop-outs", sensor.name)
        spans = drop_outs(values, sensor.drop_outs, rate_hz=scene.rate_hz, rng=rng)
        dims = (f"truth_drop_out_{number}", "truth_edge")
        truth[f"truth_drop_outs_{number}"] = xr.DataArray(
            spans, dims=dims, coords={"truth_edge": ["begin", "end"]}, attrs={"units": "s", **channel}
        )
    return truth


def _drift(
    prepared: PreparedScene, signal: Array, truth: dict[str, xr.DataArray], parts: dict[str, xr.DataArray]
) -> None:
    """Multiply the channels (sensor, n), in place, and their truth by the drift of the sensitivity."""
    scene = prepared.scene
    if imperfections_of(scene).temperature is None:
        return
    for start in range(0, scene.samples, BLOCK):
        here = slice(start, min(start + BLOCK, scene.samples))
        factor = gain_drift(scene, np.arange(here.start, here.stop) / scene.rate_hz)
        signal[:, here] *= factor
        for sources in parts.values():
            sources.values[..., here] *= factor
    if "truth_amplitude" in truth:
        stated = truth["truth_amplitude"]
        truth["truth_amplitude"] = stated.copy(data=stated.values * gain_drift(scene, prepared.instants_s))
