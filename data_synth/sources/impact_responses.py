"""Response of the channels to impacts: by a mode, by a measured path, or by the dynamics of a bearing."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from data_synth.bearings.five_dof import BearingModel, integrate_bearing
from data_synth.bearings.impacts import BearingImpacts
from data_synth.kinematic.bearing_faults import bearing_fault, bearing_model, settling_time_s, shaft_load_n, zone_order
from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import BearingFault, SceneError
from data_synth.sources.prepared import PreparedScene
from data_synth.transfer.acquisition import (
    add_ringing,
    measured_filter,
    partial_fractions,
    path_residues,
    ringing_residues,
)
from data_synth.transfer.housing import AHEAD, PoleFilter
from data_synth.transfer.paths import FirPath, MeasuredPath

# ---- Time integration of a bearing in a scene, build_drive by its speed and load, in blocks of bounded memory --------


_PER_RADIAN = (
    2.5  # steps to a radian of the fastest mode: the classical Runge-Kutta method then loses 1e-5 of it in a step
)
_BLOCK_STEPS = 16384  # steps in memory at a time
_GROWS_S = 0.01  # between updates of the size of a growing spall
_DOWN = 0.25  # of a revolution


@dataclass(frozen=True, kw_only=True)
class BearingSimulation:
    """A bearing model of a scene, ready to be integrated.

    Attributes
    ----------
    stage : PreparedScene
    number : int
        Number of its fault, from 0.
    impacts : BearingImpacts
    per_sample : int
        Integration steps to a sample of the channels.
    settling_steps : int
        Steps before time zero, in which the transient of the start from rest decays.
    """

    stage: PreparedScene
    number: int
    impacts: BearingImpacts
    per_sample: int
    settling_steps: int

    def blocks(self, *, steps: int) -> Iterator[dict[str, Array]]:
        """Yield acceleration and force of the pedestal, from `settling_steps` steps before time zero, `steps` in all.

        ``acceleration`` (n,) of its resonator, upwards in m s-2; ``force`` (n,) of the elements on it, upwards in N.

        Raises
        ------
        SceneError
            If the integration diverges.
        """
        scene, state = self.stage.scene, None
        step_s = 1 / (self.per_sample * scene.rate_hz)
        fault = bearing_fault(scene, self.number)
        grows = math.ceil(_GROWS_S / step_s) if fault.growth is not None else _BLOCK_STEPS
        for begin in range(-self.settling_steps, steps - self.settling_steps, block := min(grows, _BLOCK_STEPS)):
            count = min(block, steps - self.settling_steps - begin)
            middle_s = max((begin + count / 2) * step_s, 0.0)
            model = bearing_model(scene, fault, size_mm=fault.size_mm * float(fault.relative_size(middle_s)))
            cage, spot, load_n = self._driven((begin + np.arange(2 * count + 1) / 2) * step_s)
            try:
                motion = integrate_bearing(
                    model, cage_turns=cage, defect_turns=spot, load_n=load_n, step_s=step_s, state=state
                )
            except ValueError as caught:
                raise SceneError(
                    f"fault {self.number + 1}: the bearing cannot be followed in time: {caught}."
                ) from None
            state, shaft = motion.state, model.shaft
            force = load_n[1, :-1:2] - shaft.mass_kg * motion.acceleration_m_s2[:-1, 1]
            force -= shaft.damping_n_s_m * motion.velocity_m_s[:-1, 1]
            force -= shaft.stiffness_n_m * motion.displacement_m[:-1, 1]
            yield {"acceleration": np.ascontiguousarray(motion.acceleration_m_s2[:-1, 4]), "force": force}

    def _driven(self, times_s: Array) -> tuple[Array, Array, Array]:
        """Return revolutions of cage and defect (n,), and the load in N (2, n)."""
        stage, rolling = self.stage, self.impacts.rolling
        fault = bearing_fault(stage.scene, self.number)
        times = np.clip(times_s, stage.drive.start_s, stage.scene.duration_s)
        revolutions = stage.drive.angle.revolutions(times)
        on_element = fault.kind == "rolling_element"
        spot = rolling.defect_phase(revolutions) / 2 if on_element else rolling.defect_turns(revolutions) - _DOWN
        zone = zone_order(stage.scene, fault) * revolutions - _DOWN
        load_n = shaft_load_n(fault, load=stage.drive.load(times), turns=zone)
        return rolling.cage_turns(revolutions) - _DOWN, spot, load_n


def bearing_simulation(stage: PreparedScene, number: int, train: ImpactTrain) -> BearingSimulation:
    """Return the bearing model of fault `number` (from 0), at rest, rolling as the impacts of `train` do."""
    scene = stage.scene
    fault = bearing_fault(scene, number)
    assert fault.five_dof is not None and train.bearing is not None  # noqa: S101, PT018 - only such bearings run
    model = bearing_model(scene, fault, size_mm=fault.size_mm)
    steps = steps_per_sample(model, force_n=fault.five_dof.load_n, rate_hz=scene.rate_hz)
    settling_steps = math.ceil(settling_time_s(scene, fault) * scene.rate_hz) * steps
    return BearingSimulation(
        stage=stage, number=number, impacts=train.bearing, per_sample=steps, settling_steps=settling_steps
    )


def steps_per_sample(model: BearingModel, *, force_n: float, rate_hz: float) -> int:
    """Return the integration steps to a sample for a bearing under a load."""
    return max(2, math.ceil(_PER_RADIAN * model.highest_rad_s(force_n) / rate_hz))


# ---- Impacts ---------------------------------------------------------------------------------------------------------


_BLOCK = 65536
_HALF = 32  # samples on either side over which an impact between samples is spread
_FINE = 256  # points to a sample, between which the sum of a sinc is linear
_KAISER = 10.0  # 1e-5 of error up to nine tenths of half the rate
_STANDARD_GRAVITY = 9.80665


def add_impacts(
    prepared: PreparedScene, number: int, train: ImpactTrain, signal: Array, *, timing_errors_s: Array | None = None
) -> None:
    """Add the response to a train of fault `number` (from 0) to the channels (sensor, n), in place.

    `timing_errors_s` (n,) are errors of the sampling instants.
    """
    fault = prepared.scene.faults[number]
    if isinstance(fault, BearingFault) and fault.five_dof is not None:
        _add_motion(prepared, number, train, signal)
    else:
        _add_impacts(prepared, number, train, signal, timing_errors_s=timing_errors_s)


def _add_impacts(
    prepared: PreparedScene, number: int, train: ImpactTrain, signal: Array, *, timing_errors_s: Array | None
) -> None:
    """Add the response of every sensor to a train of impacts, by way of its path and measurement chain."""
    times_s, strength = prepared.impacts_at_source(number, train)
    scene, duration_s = prepared.scene, None
    if train.duration_rev is not None:
        duration_s = prepared.drive.angle.times(train.revolutions + train.duration_rev) - times_s
    gains = np.abs(prepared.gains[train.source])
    for sensor, chain, gain, values in zip(scene.sensors, prepared.chains, gains, signal, strict=True):
        path = prepared.paths.get((train.source, sensor.name))
        if isinstance(path, MeasuredPath):
            fir = measured_filter(path, chain, rate_hz=scene.rate_hz, sensor=sensor)
            add_fir_response(
                values, times_s=times_s, impulses_ns=strength, duration_s=duration_s, fir=fir, rate_hz=scene.rate_hz
            )
            continue
        if path is None:
            poles, residues = ringing_residues(scene.resonance, chain, sensor=sensor.name)
        else:
            (poles, residues), gain = path_residues(path, chain, sensor=sensor.name), 1.0  # noqa: PLW2901
        at_s, sizes = times_s, gain * strength
        if duration_s is not None:
            at_s, sizes, poles, residues = _step_pairs(times_s, sizes, duration_s, poles, residues)
        add_ringing(
            values,
            times_s=at_s,
            amplitudes=sizes,
            poles=poles,
            residues=residues,
            rate_hz=scene.rate_hz,
            timing_errors_s=timing_errors_s,
        )


def _step_pairs(
    times_s: Array, sizes: Array, duration_s: Array, poles: ComplexArray, residues: ComplexArray
) -> tuple[Array, Array, ComplexArray, ComplexArray]:
    """Return impacts of constant force and finite duration as steps up and down, with the modes' step response."""
    rising = np.argsort(both := np.concatenate([times_s, times_s + duration_s]), kind="stable")
    heights = np.concatenate([sizes / duration_s, -sizes / duration_s])
    steps = residues / poles
    # the ringing of a step ends at a constant, which the step down takes away
    return both[rising], heights[rising], np.append(poles, 0.0), np.append(steps, -np.sum(steps.real))


def add_fir_response(
    values: Array,
    *,
    times_s: Array,
    impulses_ns: Array,
    fir: FirPath,
    rate_hz: float,
    duration_s: Array | None = None,
) -> None:
    """Add the response to impacts at any instants to a channel (n,), in place, compensated for the filter's delay.

    An impact between samples is a sinc on them with a Kaiser window: exact to 1e-5 up to nine tenths of half the rate.
    One of finite duration is the mean of such.
    """
    at = times_s * rate_hz
    near = np.floor(at).astype(np.int64)
    late = np.zeros(at.size) if duration_s is None else duration_s * rate_hz
    offsets = np.arange(-_HALF + 1, _HALF + math.ceil(np.max(late, initial=0.0)) + 1)
    begin, lead = -fir.taps.size - offsets.size, round(fir.delay_s * rate_hz) + _HALF
    fir_filter, overlap = fir.filter(), np.zeros(offsets.size)
    for start in range(begin, values.size + lead, _BLOCK):
        count = min(_BLOCK, values.size + lead - start)
        spread = np.zeros(count + offsets.size)
        spread[: offsets.size] = overlap
        here = (near >= start) & (near < start + count)
        shares = _interpolation_weights(offsets - (at[here] - near[here])[:, None], late[here])
        places = near[here][:, None] - start + offsets + _HALF
        np.add.at(spread, places, impulses_ns[here][:, None] * rate_hz * shares)
        overlap = spread[count:].copy()
        response = fir_filter.push(spread[:count])
        # the first sample of spread impacts is that many early, and the filter late
        first = start - lead
        inside = slice(max(-first, 0), max(min(count, values.size - first), 0))
        if inside.start < inside.stop:
            values[first + inside.start : first + inside.stop] += response[inside]


def _interpolation_weights(since: Array, late: Array) -> Array:
    """Return the weights of samples (m, k) `since` an impact, for impacts that last `late` samples (m,)."""
    if not late.any():
        return _sinc(since)
    grid = np.arange(-_HALF * _FINE, _HALF * _FINE + 1) / _FINE
    summed = np.concatenate([[0.0], np.cumsum(_sinc(grid[:-1] + 0.5 / _FINE)) / _FINE])
    ends = np.interp(since, grid, summed), np.interp(since - late[:, None], grid, summed)
    return np.asarray((ends[0] - ends[1]) / late[:, None])


def _sinc(at: Array) -> Array:
    """Return the sinc function under a Kaiser window of 2 * _HALF samples."""
    window = np.i0(_KAISER * np.sqrt(np.maximum(1 - (at / _HALF) ** 2, 0.0))) / np.i0(_KAISER)
    return np.asarray(np.sinc(at) * window * (np.abs(at) < _HALF))


# ---- a bearing that moves ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _ChannelFilter:
    """Filter from the motion of a bearing to a channel: its input signal, its delay in samples and a gain."""

    input_name: str
    push: Callable[[Array], Array]
    lag: int
    gain: float = 1.0


def _add_motion(prepared: PreparedScene, number: int, train: ImpactTrain, signal: Array) -> None:
    """Add the response of every sensor to the simulated motion of a faulty bearing, integrated block by block."""
    bearing = bearing_simulation(prepared, number, train)
    filters = [_channel_filter(prepared, bearing, train, index) for index in range(len(signal))]
    samples, each = signal.shape[1], bearing.per_sample
    steps = bearing.settling_steps + (samples - 1) * each + 1 + max(filter_.lag for filter_ in filters)
    begun = -bearing.settling_steps
    for block in bearing.blocks(steps=steps):
        for filter_, values in zip(filters, signal, strict=True):
            response = filter_.push(block[filter_.input_name])
            # the step of each sample, as late as the filter
            first = begun - filter_.lag
            skipped = -first if first < 0 else -first % each
            now = response[skipped::each]
            at = (first + skipped) // each
            count = min(now.size, samples - at)
            values[at : at + count] += filter_.gain * now[:count]
        begun += block["force"].size


def _channel_filter(
    prepared: PreparedScene, bearing: BearingSimulation, train: ImpactTrain, index: int
) -> _ChannelFilter:
    """Return the filter of a channel: from the resonator's acceleration, or from the force on a declared path."""
    scene, chain, sensor = prepared.scene, prepared.chains[index], prepared.scene.sensors[index]
    rate_hz = bearing.per_sample * scene.rate_hz
    path = prepared.paths.get((train.source, sensor.name))
    if isinstance(path, MeasuredPath):
        fir = measured_filter(path, chain, rate_hz=rate_hz, sensor=sensor)
        return _ChannelFilter(input_name="force", push=fir.filter().push, lag=round(fir.delay_s * rate_hz))
    if path is not None:
        poles, residues = path_residues(path, chain, sensor=sensor.name)
        filter_ = PoleFilter(poles=poles, residues=residues, direct=0.0, rate_hz=rate_hz)
        return _ChannelFilter(input_name="force", push=filter_.push, lag=AHEAD)
    poles, residues, direct = partial_fractions(chain)
    filter_ = PoleFilter(poles=poles, residues=residues, direct=direct, rate_hz=rate_hz)
    gain = abs(complex(prepared.gains[train.source][index])) / (_STANDARD_GRAVITY if sensor.units == "g" else 1.0)
    return _ChannelFilter(input_name="acceleration", push=filter_.push, lag=AHEAD, gain=gain)
