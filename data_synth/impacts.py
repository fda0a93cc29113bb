"""What strikes, as the channels hear it: impacts that ring, impacts on a measured way, bearings that move."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from data_synth.bearing_run import BearingSimulation, bearing_simulation
from data_synth.chain import Sensor
from data_synth.combs import ComplexArray
from data_synth.faults import ImpactTrain
from data_synth.pole_filter import AHEAD, PoleFilter
from data_synth.profile import Array
from data_synth.scene import BearingFault, SceneError
from data_synth.sensors import Cascade, add_ringing, fractions, ringing, through
from data_synth.stage import Stage
from data_synth.transfer import FirPath, MeasuredPath

_BLOCK = 65536
_LEAKAGES = (1e-3, 1e-2)  # RMS that the filter of a measured way may lack; the larger where its band ends abruptly
_FEWEST = 64  # taps
_SPACINGS = 8  # longest filter, over what lines so far apart can tell
_HALF = 32  # samples on either side over which an impact between samples is spread
_FINE = 256  # points to a sample, between which the sum of a sinc is linear
_KAISER = 10.0  # 1e-5 of error up to nine tenths of half the rate
_STANDARD_GRAVITY = 9.80665


def add_train(stage: Stage, number: int, train: ImpactTrain, signal: Array, *, late_s: Array | None = None) -> None:
    """Add what a train of fault `number` (from 0) does to the channels (sensor, n), in place.

    `late_s` (n,) are errors of the sampling instants.
    """
    fault = stage.scene.faults[number]
    if isinstance(fault, BearingFault) and fault.five_dof is not None:
        _add_motion(stage, number, train, signal)
    else:
        _add_impacts(stage, number, train, signal, late_s=late_s)


def _add_impacts(stage: Stage, number: int, train: ImpactTrain, signal: Array, *, late_s: Array | None) -> None:
    times_s, strength = stage.struck(number, train)
    scene, lasting_s = stage.scene, None
    if train.lasting_rev is not None:
        lasting_s = stage.drive.angle.times(train.revolutions + train.lasting_rev) - times_s
    gains = np.abs(stage.gains[train.source])
    for sensor, chain, gain, values in zip(scene.sensors, stage.chains, gains, signal, strict=True):
        way = stage.ways.get((train.source, sensor.name))
        if isinstance(way, MeasuredPath):
            fir = measured_filter(way, chain, rate_hz=scene.rate_hz, sensor=sensor)
            add_measured(
                values, times_s=times_s, impulses_ns=strength, lasting_s=lasting_s, fir=fir, rate_hz=scene.rate_hz
            )
            continue
        if way is None:
            poles, residues = ringing(scene.resonance, chain, sensor=sensor.name)
        else:
            (poles, residues), gain = through(way, chain, sensor=sensor.name), 1.0  # noqa: PLW2901
        at_s, sizes = times_s, gain * strength
        if lasting_s is not None:
            at_s, sizes, poles, residues = _pressed(times_s, sizes, lasting_s, poles, residues)
        add_ringing(
            values,
            times_s=at_s,
            amplitudes=sizes,
            poles=poles,
            residues=residues,
            rate_hz=scene.rate_hz,
            late_s=late_s,
        )


def _pressed(
    times_s: Array, sizes: Array, lasting_s: Array, poles: ComplexArray, residues: ComplexArray
) -> tuple[Array, Array, ComplexArray, ComplexArray]:
    """Return impacts that press evenly for some time: a step up and one down again, each with the ringing of a step."""
    rising = np.argsort(both := np.concatenate([times_s, times_s + lasting_s]), kind="stable")
    heights = np.concatenate([sizes / lasting_s, -sizes / lasting_s])
    steps = residues / poles
    # the ringing of a step ends at a constant, which the step down takes away
    return both[rising], heights[rising], np.append(poles, 0.0), np.append(steps, -np.sum(steps.real))


# ---- a measured way ---------------------------------------------------------------------------------------------


def measured_filter(way: MeasuredPath, chain: Cascade, *, rate_hz: float, sensor: Sensor) -> FirPath:
    """Return a measured way with the chain behind it as the shortest filter, a power of two long, that holds it.

    Raises
    ------
    SceneError
        Lines so far apart that the response between them does not die away.
    """
    behind = MeasuredPath(frequencies_hz=way.frequencies_hz, values=way.values * chain.response(way.frequencies_hz))
    longest = max(_FEWEST, math.ceil(_SPACINGS * way.ring_seconds() * rate_hz))
    lengths = [_FEWEST << doubled for doubled in range(math.ceil(math.log2(longest / _FEWEST)) + 1)]
    for leakage in _LEAKAGES:
        for taps in lengths:
            with suppress(ValueError):
                return behind.fir(rate_hz=rate_hz, taps=taps, leakage=leakage)
    raise SceneError(
        f'sensor "{sensor.name}": a measured transfer to it does not die away within {longest / rate_hz:.3g} s, so '
        "its lines are too far apart; measure them closer together."
    )


def add_measured(
    values: Array,
    *,
    times_s: Array,
    impulses_ns: Array,
    fir: FirPath,
    rate_hz: float,
    lasting_s: Array | None = None,
) -> None:
    """Add the response to impacts at any instants to a channel (n,), in place and without the filter's delay.

    An impact between samples is a sinc on them, under a Kaiser window: true to 1e-5 up to nine tenths of half the rate.
    One that presses evenly for a time is the mean of such.
    """
    at = times_s * rate_hz
    near = np.floor(at).astype(np.int64)
    late = np.zeros(at.size) if lasting_s is None else lasting_s * rate_hz
    offsets = np.arange(-_HALF + 1, _HALF + math.ceil(np.max(late, initial=0.0)) + 1)
    begin, ahead = -fir.taps.size - offsets.size, round(fir.delay_s * rate_hz) + _HALF
    at_work, carried = fir.filter(), np.zeros(offsets.size)
    for start in range(begin, values.size + ahead, _BLOCK):
        count = min(_BLOCK, values.size + ahead - start)
        spread = np.zeros(count + offsets.size)
        spread[: offsets.size] = carried
        here = (near >= start) & (near < start + count)
        shares = _shares(offsets - (at[here] - near[here])[:, None], late[here])
        places = near[here][:, None] - start + offsets + _HALF
        np.add.at(spread, places, impulses_ns[here][:, None] * rate_hz * shares)
        carried = spread[count:].copy()
        heard = at_work.push(spread[:count])
        # the first sample of spread impacts is that many early, and the filter late
        first = start - ahead
        inside = slice(max(-first, 0), max(min(count, values.size - first), 0))
        if inside.start < inside.stop:
            values[first + inside.start : first + inside.stop] += heard[inside]


def _shares(since: Array, late: Array) -> Array:
    """Return what samples (m, k), `since` after an impact, have of impacts that last `late` samples (m,)."""
    if not late.any():
        return _sinc(since)
    grid = np.arange(-_HALF * _FINE, _HALF * _FINE + 1) / _FINE
    summed = np.concatenate([[0.0], np.cumsum(_sinc(grid[:-1] + 0.5 / _FINE)) / _FINE])
    ends = np.interp(since, grid, summed), np.interp(since - late[:, None], grid, summed)
    return np.asarray((ends[0] - ends[1]) / late[:, None])


def _sinc(at: Array) -> Array:
    """Return a sinc under a window that ends it."""
    window = np.i0(_KAISER * np.sqrt(np.maximum(1 - (at / _HALF) ** 2, 0.0))) / np.i0(_KAISER)
    return np.asarray(np.sinc(at) * window * (np.abs(at) < _HALF))


# ---- a bearing that moves ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Ear:
    """A channel at a bearing that moves: what it hears of it, as loud as `gain`, through a filter that lags."""

    hears: str
    push: Callable[[Array], Array]
    lag: int
    gain: float = 1.0


def _add_motion(stage: Stage, number: int, train: ImpactTrain, signal: Array) -> None:
    bearing = bearing_simulation(stage, number, train)
    ears = [_ear(stage, bearing, train, index) for index in range(len(signal))]
    samples, each = signal.shape[1], bearing.per_sample
    steps = bearing.settling_steps + (samples - 1) * each + 1 + max(ear.lag for ear in ears)
    begun = -bearing.settling_steps
    for block in bearing.blocks(steps=steps):
        for ear, values in zip(ears, signal, strict=True):
            heard = ear.push(block[ear.hears])
            # the step of each sample, as late as the filter
            first = begun - ear.lag
            skipped = -first if first < 0 else -first % each
            now = heard[skipped::each]
            at = (first + skipped) // each
            count = min(now.size, samples - at)
            values[at : at + count] += ear.gain * now[:count]
        begun += block["force"].size


def _ear(stage: Stage, bearing: BearingSimulation, train: ImpactTrain, index: int) -> _Ear:
    """Return how a channel hears it: by the acceleration of its resonator, or by its force on a declared way."""
    scene, chain, sensor = stage.scene, stage.chains[index], stage.scene.sensors[index]
    rate_hz = bearing.per_sample * scene.rate_hz
    way = stage.ways.get((train.source, sensor.name))
    if isinstance(way, MeasuredPath):
        fir = measured_filter(way, chain, rate_hz=rate_hz, sensor=sensor)
        return _Ear(hears="force", push=fir.filter().push, lag=round(fir.delay_s * rate_hz))
    if way is not None:
        poles, residues = through(way, chain, sensor=sensor.name)
        filter_ = PoleFilter(poles=poles, residues=residues, direct=0.0, rate_hz=rate_hz)
        return _Ear(hears="force", push=filter_.push, lag=AHEAD)
    poles, residues, direct = fractions(chain)
    filter_ = PoleFilter(poles=poles, residues=residues, direct=direct, rate_hz=rate_hz)
    gain = abs(complex(stage.gains[train.source][index])) / (_STANDARD_GRAVITY if sensor.units == "g" else 1.0)
    return _Ear(hears="acceleration", push=filter_.push, lag=AHEAD, gain=gain)
