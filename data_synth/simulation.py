"""Simulate a scene: sum the sources, apply the measurement chain, and state the truth beside the record."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from data_synth.cost import refuse_too_large
from data_synth.fidelity.choice import Choice, chosen, with_gear_lines
from data_synth.fidelity.linear_response import with_gear_faults
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
from data_synth.truth import angle_truth, tooth_pass_truth, truth_variables
from data_synth.vibration.gear_lines import gear_lines, samples_compared
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
    detectability: bool = False,
) -> xr.Dataset:
    """Simulate a scene: return its record together with its truth.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, the path of its file, or its name in the catalogue.
    seed : int
        Not negative. Every random quantity has a stream of its own, named after what it belongs to, so that an added
        fault leaves phases, noise and tachometer as they were. Same scene and seed: same bytes.
    machine_seed : int or None
        For one of several records of a machine: a seed of what stays the same from one to the next, errors and damage
        of teeth, imbalance, phases, gains and mounts of sensors. The machine has made a random number of turns before
        the record. None: all of it follows from `seed`.
    by_source : bool
        Also return ``truth_source`` (truth_channel, truth_source_name, time): the noise-free signal of each source
        after the linear part of the chain, as large as a channel for each source.
    phases : bool
        Also return the exact angle at each sample of every shaft and of every bearing's cage and rolling elements,
        ``truth_shaft_revolutions`` (truth_shaft, time) and ``truth_roller_revolutions`` (truth_roller, time), in rev.
    mechanics : bool
        Also return the speed of every link at each sample and, where gears vibrate, what is inside the gearbox:
        ``truth_transmission_error``, ``truth_mesh_force``, ``truth_mesh_stiffness``, ``truth_bearing_force`` ..., as
        `data_synth.vibration.mechanics.mechanics_truth` defines them. It costs a second integration.
    detectability : bool
        Also return ``truth_fault_detectability_db`` (truth_channel, truth_fault): what each fault alone adds to the
        noise-free healthy channel of the same seed, against the channel's noise and quantisation, as
        `fault_detectability` returns it. It costs the simulation of the healthy channel, and where there are several
        faults one of each.

    Returns
    -------
    xarray.Dataset
        A record. Its truth, on the clock of the record:

        ``truth_amplitude`` (truth_channel, truth_order, truth_time), complex
            Z of the noise-free signal at each order of the reference shaft, ``x = Re{Z exp(j order phase)}``, phase
            zero at the first tachometer mark, after the filters and the sensitivity of the channel. Between the
            instants of truth_time Z is linear: so a kinematic signal is built, without approximation; where gears
            vibrate, ``docs/benchmarks/truth.md`` has the share of the power that all lines add up to. Sources at one
            exact order are added. Impacts of a damaged tooth have their own orders, down
            to a hundredth of the loudest (`data_synth.transfer.paths.impact_line` states the error); a bearing with
            slip has no line.
        ``truth_component``, ``truth_kind`` (truth_order)
            The sources at that order, largest first, joined by " + ".
        ``truth_free`` (truth_channel)
            Share of free vibration, after a start from rest and jumps of the load, in the power of gears in motion.
        ``truth_left``, ``truth_fault_left`` (truth_channel)
            Share of the power that lines leave of the rest, and of what damaged teeth add to it. Left out, the lines
            are the signal.
        ``truth_chain_poles`` (truth_channel, truth_chain_pole), complex, ``truth_chain_gain`` (truth_channel)
            Filters and sensitivity, ``H(f) = gain prod p / (p - 2j pi f)``, a factor of truth_amplitude; where a
            channel has any. Shorter channels end in NaN.
        ``truth_speed``, ``truth_revolutions`` (truth_time)
            Speed of the reference shaft in rev s-1 and its exact angle in rev; ``truth_torque`` in N m as declared.
        ``truth_fault_component``, ``truth_fault_kind`` (truth_fault)
            As declared; of length zero in a healthy record. ``truth_fault_size`` (truth_fault, truth_time) in mm where
            one grows.
        ``truth_impact_times_1`` ...
            Times in s of the impacts of fault 1 ...
        ``truth_marks``, ``truth_missed_marks``, ``truth_spurious_pulses``
            Where the scene degrades its tachometer: exact times in s of its marks, the numbers of those without a
            pulse, and times in s of pulses without a mark.
        ``truth_clipped_1``, ``truth_saturated_1``, ``truth_drop_outs_1``
            Where a channel has such a part: number of samples clipped and beyond the converter, and begin and end of
            missing samples in s.
        ``truth_electrical``, ``truth_neighbour``, ``truth_knocks``, ``truth_gain``, ``truth_noise_level`` ...
            What the scene's imperfections add from outside of the machine or change in its sensors; `docs/scenes.md`.
        ``truth_tooth_passes_1`` ...
            Where gears vibrate: times in s at which the damaged tooth of fault 1 ... is in the middle of its mesh; its
            attribute ``half_width_rev`` is half the time it is in mesh, in rev of the reference shaft.

        Where gears vibrate, truth_amplitude has every loud line of meshes, of damaged gears and of what they make
        with each other, projected from their clean signal; what damage adds is the difference to sound teeth
        (`data_synth.vibration.gear_lines.gear_lines`). Attribute ``truth_mesh_lines`` states their resolution,
        ``truth_fidelity`` the model of gears and why.
        Attribute ``truth_scene`` holds the scene with every default written out, ``truth_seed`` the seed,
        ``truth_machine_seed`` that of the machine if it has one.

    Raises
    ------
    SceneError
        A scene that cannot be simulated, or that memory does not hold, with the reason and the remedy.

    Examples
    --------
    A mesh of 23 teeth at 20 rev/s is a tone of 460 Hz, here of amplitude 2:

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
            raise SceneError(f"{name} = {value!r}: a whole number, 0 or more, is needed.")
    refuse_too_large(declared, by_source=by_source, phases=phases, mechanics=mechanics)
    streams, kept = Streams(seed=seed, machine_seed=machine_seed), declared.samples if detectability else 0
    record, noise_free = _simulated(declared, streams, kept, by_source=by_source, phases=phases, mechanics=mechanics)
    if detectability:
        own = noise_free if len(declared.faults) == 1 else None
        found_db = fault_detectability(declared, seed=seed, machine_seed=machine_seed, own=own)
        return record.assign(truth_fault_detectability_db=found_db)
    return record


@dataclass(frozen=True, kw_only=True)
class NoiseFree:
    """Channels after the linear part of their chains, (sensor, n).

    `of_sound_gears` is what gears in motion with sound teeth add to them, and `steps` those of the integration to a
    sample, where there are any.
    """

    signal: Array
    of_sound_gears: Array | None = None
    steps: int | None = None


def simulate_with_detectability(
    scene: Scene, *, seed: int, machine_seed: int | None = None, trial_s: float
) -> tuple[xr.Dataset, float]:
    """Return the record of a scene, and the detectability of its first fault in its first channel from the beginning.

    Parameters
    ----------
    scene : Scene
    seed : int
    machine_seed : int or None
    trial_s : float
        Length of the beginning in s that is simulated without the fault as well.

    Returns
    -------
    record : xarray.Dataset
        As `simulate` returns it.
    detectability_db : float
        Of the fault in the whole record, from what it adds to its first `trial_s` seconds.
    """
    samples = min(scene.samples, round(trial_s * scene.rate_hz))
    record, noise_free = _simulated(scene, Streams(seed=seed, machine_seed=machine_seed), samples)
    own = noise_free if len(scene.faults) == 1 else None
    ratio_db = fault_detectability(scene, seed=seed, machine_seed=machine_seed, own=own, samples=samples)
    return record, float(ratio_db[0, 0]) + 10 * math.log10(scene.samples / samples)


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
    prepared, motion, choice, gear_faults = _set_up(declared, streams, turns_before=streams.turns_before)
    parts = _by_source(prepared) if by_source else {}
    signal = _clean(prepared)
    if motion is not None and choice is not None:
        truth, attrs, noise_free = _with_gears(prepared, motion, choice, signal, parts, kept=kept)
    else:
        truth, attrs = truth_variables(prepared), {"truth_gear_faults": gear_faults} if gear_faults else {}
        noise_free = NoiseFree(signal=signal[:, :kept].copy())
    truth |= add_outside_sources(prepared, signal)
    if declared.imperfections is not None:
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
) -> tuple[PreparedScene, Motion | None, Choice | None, str]:
    """Return a prepared scene with the lines that are not integrated; where gears vibrate, their motion and its model.

    Last, how the gear faults of a kinematic scene came about. `choice` is the model; None: that of the scene.
    """
    prepared = prepare_scene(scene, rng_for=rng_for, turns_before=turns_before)
    if scene.fidelity == "kinematic":
        prepared, gear_faults = with_gear_faults(prepared)
        return prepared, None, None, gear_faults
    motion = motion_of(prepared)
    choice = chosen(motion) if choice is None else choice
    return with_gear_lines(prepared, motion, choice), motion, choice, ""


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
    """Return the signal after the linear chain, (sensor, n), of all sources or of one (component, kind).

    Of the first `samples` samples, if not of all.
    """
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


def _gear_vibration(motion: Motion, *, samples: int) -> Array:
    """Return the response of the sensors to the vibration of the gears, (sensor, n)."""
    signal, at = np.empty((len(motion.stage.scene.sensors), samples)), 0
    for block in motion.channels(samples=samples):
        signal[:, at : at + block.shape[1]] = block
        at += block.shape[1]
    for sensor, values in zip(motion.stage.scene.sensors, signal, strict=True):
        if sensor.skew_s:
            values[:] = later(values, sensor.skew_s * motion.stage.scene.rate_hz)
    return signal


def _with_gears(
    prepared: PreparedScene, motion: Motion, choice: Choice, signal: Array, parts: dict[str, xr.DataArray], *, kept: int
) -> tuple[dict[str, xr.DataArray], dict[str, str], NoiseFree]:
    """Add the vibration of the gears to a signal (sensor, n) and to `parts`.

    Return the truth, attributes that state the model and the error of the amplitudes of the mesh harmonics, and the
    first `kept` samples.
    """
    passes = tooth_pass_truth(motion)
    if choice.linear:
        attrs = {"truth_fidelity": str(choice), "truth_mesh_lines": "exact"}
        return truth_variables(prepared) | passes, attrs, NoiseFree(signal=signal[:, :kept].copy())
    steps, samples = motion.steps(), prepared.scene.samples
    gear_signal = sound_signal = _gear_vibration(replace(motion, steps_per_sample=steps), samples=samples)
    signal += gear_signal
    free = _free_vibration(motion, gear_signal, steps=steps)
    if damaged := any(isinstance(fault, GearFault) for fault in prepared.scene.faults):
        sound = prepared.without_faults()
        sound_motion = replace(motion_of(sound), steps_per_sample=steps)
        sound_signal = _gear_vibration(sound_motion, samples=max(kept, samples_compared(prepared, prepared.scene)))
    sound_forced = sound_signal - free[:, : sound_signal.shape[1]]
    measured = gear_lines(prepared, gear_signal - free, sound=sound_forced if damaged else None)
    truth = truth_variables(prepared, measured=measured, free=_share(free, gear_signal)) | passes
    for name, sources in parts.items():
        # meshes act on each other, so all gears in motion are one source
        own = xr.DataArray(gear_signal[:, None], dims=sources.dims, coords={"truth_source_name": ["gears, motion"]})
        parts[name] = xr.concat([sources, own], dim="truth_source_name").assign_attrs(sources.attrs)
    attrs = {"truth_fidelity": str(choice), "truth_mesh_lines": measured.about}
    noise_free = NoiseFree(
        signal=signal[:, :kept].copy(),
        of_sound_gears=sound_signal[:, :kept].copy(),
        steps=steps,
    )
    return truth, attrs, noise_free


def _free_vibration(motion: Motion, signal: Array, *, steps: int) -> Array:
    """Return what a start from rest and jumps of the load set off in a signal (sensor, n): zero where there are none.

    The difference of two motions by the same forces is a free vibration; the other one begins in static equilibrium,
    and follows it where the load jumps.
    """
    forced = motion.without_free_vibration()
    if forced is None:
        return np.zeros_like(signal)
    return signal - _gear_vibration(replace(forced, steps_per_sample=steps), samples=signal.shape[1])


def _share(part: Array, signal: Array) -> Array:
    """Return the power of a part over that of the signal about its mean, (sensor,)."""
    whole = np.var(signal, axis=1)
    return np.asarray(np.divide(np.mean(part**2, axis=1), whole, out=np.zeros_like(whole), where=whole > 0))


def _by_source(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return the signal of each source alone at every sensor."""
    sources = dict.fromkeys(
        [(family.component, family.kind) for family in prepared.families]
        + [(train.component, train.kind) for _, train in prepared.trains]
    )
    signals = np.empty((len(prepared.scene.sensors), len(sources), prepared.scene.samples))
    for index, source in enumerate(sources):
        signals[:, index] = _clean(prepared, only=source)
    return {
        "truth_source": xr.DataArray(
            signals,
            dims=("truth_channel", "truth_source_name", "time"),
            coords={"truth_source_name": [f"{component}, {kind}" for component, kind in sources]},
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
            'mechanics: with fidelity = "auto" this record is a linear response, which has no motion in time; write '
            'fidelity = "dynamic".'
        )
    return mechanics_truth(motion)


_OF_A_FAULT = {"offset", "impacts", "pits"}  # random streams that are named by the number of the fault


def fault_detectability(
    scene: Scene,
    *,
    seed: int,
    machine_seed: int | None = None,
    own: NoiseFree | None = None,
    samples: int | None = None,
) -> xr.DataArray:
    """Return how detectable each fault of a scene alone is in each channel, in dB.

    The signal-to-noise ratio at the output of the filter matched to what the fault adds to the noise-free healthy
    channel of the same seed [1]_: the sum of its squares over the variance of the channel's white noise, whose level
    may wander, with that of quantisation. The best detector that knows all of it has a deflection of its square root:
    14 dB are a probability of detection of 0.99 at one false alarm in 200. It costs a simulation for each fault and one
    more, none of them with a truth.

    Parameters
    ----------
    scene : Scene
    seed : int
    machine_seed : int or None
    own : NoiseFree, optional
        The channels of the scene itself, where it has one fault and they are known.
    samples : int, optional
        From the beginning of the scene, if not all.

    Returns
    -------
    xarray.DataArray
        (truth_channel, truth_fault); see `simulate`.

    Raises
    ------
    SceneError
        A scene that cannot be simulated.

    References
    ----------
    .. [1] G. L. Turin, An introduction to matched filters, IRE Transactions on Information Theory 6 (1960) 311-329.
    """
    streams = Streams(seed=seed, machine_seed=machine_seed)
    choice = _set_up(scene, streams, turns_before=streams.turns_before)[2] if scene.fidelity == "auto" else None
    # with the steps of one motion, whose error is nearly the same in the other and leaves the difference
    count = scene.samples if samples is None else samples
    healthy = _noise_free(
        scene.changed(faults=()),
        streams,
        choice,
        turns_before=streams.turns_before,
        samples=count,
        steps=own.steps if own is not None else None,
        of_gears=own.of_sound_gears if own is not None else None,
    )
    variances = [_noise_variance(scene, sensor, streams) for sensor in scene.sensors]
    ratios_db = np.empty((len(scene.sensors), len(scene.faults)))
    for number, fault in enumerate(scene.faults):

        def rng_for(*words: str, number: int = number) -> np.random.Generator:
            return streams(*((words[0], str(number)) if words[0] in _OF_A_FAULT else words))

        faulty = own
        if faulty is None:
            alone = scene.changed(faults=(fault,))
            faulty = _noise_free(
                alone, rng_for, choice, turns_before=streams.turns_before, samples=count, steps=healthy.steps
            )
        added = faulty.signal[:, :count] - healthy.signal
        for row, variance in enumerate(variances):
            with np.errstate(divide="ignore", invalid="ignore"):
                shares = np.where(added[row] != 0, added[row] ** 2 / variance[:count], 0.0)
                ratios_db[row, number] = 10 * np.log10(np.sum(shares))
    about = "matched filter for what the fault adds, against the noise of the channel: sum of d^2 / s^2"
    return xr.DataArray(
        ratios_db,
        dims=("truth_channel", "truth_fault"),
        coords={"truth_channel": [sensor.name for sensor in scene.sensors]},
        attrs={"units": "dB", "about": about},
    )


def noise_free(scene: Scene, *, seed: int, steps: int | None = None) -> NoiseFree:
    """Return the channels of a scene after the linear part of their chains, without a record and its truth.

    Parameters
    ----------
    scene : Scene
    seed : int
    steps : int, optional
        Of the integration of gears in motion to a sample; left out, as the scene's error asks.

    Examples
    --------
    >>> from data_synth import load_scene
    >>> from data_synth.simulation import noise_free
    >>> noise_free(load_scene("demo").changed(duration_s=0.1), seed=1).signal.shape
    (1, 5000)
    """
    streams = Streams(seed=seed)
    return _noise_free(scene, streams, None, turns_before=streams.turns_before, samples=scene.samples, steps=steps)


def _noise_free(
    scene: Scene,
    rng_for: RandomStreams,
    choice: Choice | None,
    *,
    turns_before: int,
    samples: int,
    steps: int | None,
    of_gears: Array | None = None,
) -> NoiseFree:
    """Return the beginning of the channels of a scene after the linear part of their chains.

    `choice` is the model of the gears, None that of the scene; `of_gears` their vibration, where it is known.
    """
    prepared, motion, choice, _ = _set_up(scene, rng_for, turns_before=turns_before, choice=choice)
    signal = _clean(prepared, samples=samples)
    if motion is not None and of_gears is None and not (choice is not None and choice.linear):
        steps = motion.steps() if steps is None else steps
        of_gears = _gear_vibration(replace(motion, steps_per_sample=steps), samples=samples)
    return NoiseFree(signal=signal if of_gears is None else signal + of_gears, steps=steps)


def _noise_variance(scene: Scene, sensor: Sensor, rng_for: RandomStreams) -> Array:
    """Return the variance of a channel's white noise, (n,) where its level wanders, else (1,), with that of rounding.

    Rounding to steps adds a twelfth of the square of one.
    """
    gain = abs(sensor.sensitivity.value) if sensor.sensitivity is not None else 1.0
    variance = np.full(1, (gain * scene.noise.rms) ** 2)
    if scene.imperfections is not None and scene.imperfections.noise is not None:
        level_db = noise_level(scene, rng_for=rng_for)
        variance = variance * 10 ** (level_db(np.arange(scene.samples) / scene.rate_hz) / 10)
    if sensor.quantisation is not None:
        variance = variance + (2 * sensor.quantisation.full_scale / 2**sensor.quantisation.bits) ** 2 / 12
    return variance


# ---- what is not linear in the chain, or not of the machine --------------------------------------------------


def _apply_chain(prepared: PreparedScene, sensor: Sensor, number: int, values: Array) -> dict[str, xr.DataArray]:
    """Apply the nonlinear part of a channel's chain to its samples (n,), in place and in hardware order.

    Returns the truth variables that state what was done.
    """
    scene, truth = prepared.scene, {}
    channel = {"channel": sensor.name}
    gain = abs(sensor.sensitivity.value) if sensor.sensitivity is not None else 1.0
    factor = None
    if scene.imperfections is not None and scene.imperfections.noise is not None:
        level_db = noise_level(scene, rng_for=prepared.rng_for)
        factor = lambda numbers: 10 ** (level_db(numbers / scene.rate_hz) / 20)  # noqa: E731
    add_noise(values, rms=gain * scene.noise.rms, rng=prepared.rng_for("noise", sensor.name), factor=factor)
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
    """Multiply the channels (sensor, n), in place, and what is stated of them by the drift of the sensitivity."""
    scene = prepared.scene
    if prepared.scene.imperfections is None or prepared.scene.imperfections.temperature is None:
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
