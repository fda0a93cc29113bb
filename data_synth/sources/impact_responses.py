"""Response of the channels to impacts, through a mode or a measured path, and the lines of periodic impacts."""

import math
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.sources.prepared import PreparedScene
from data_synth.transfer.acquisition import BLOCK, add_ringing, measured_filter
from data_synth.transfer.paths import FirFilter, MeasuredPath, impact_line, ringing

_HALF = 32  # samples on either side over which an impact between samples is spread
_FINE = 256  # points per sample, between which the integral of a sinc is linear
_KAISER = 10.0  # an error of 1e-5 up to 0.9 of half the rate


def add_impacts(prepared: PreparedScene, number: int, train: ImpactTrain, signal: Array) -> None:
    """Add the response to a train of fault `number` (from 0) to the channels (sensor, n), in place."""
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
        way = ringing(scene.resonance).then(chain) if path is None else chain
        poles, residues = way.residues(sensor.name, before=path)
        at_s, sizes = times_s, gain * strength if path is None else strength
        if duration_s is not None:
            at_s, sizes, poles, residues = _step_pairs(times_s, sizes, duration_s, poles, residues)
        add_ringing(
            values,
            times_s=at_s - chain.skew_s,
            amplitudes=sizes,
            poles=poles,
            residues=residues,
            rate_hz=scene.rate_hz,
        )


def _step_pairs(
    times_s: Array, sizes: Array, duration_s: Array, poles: ComplexArray, residues: ComplexArray
) -> tuple[Array, Array, ComplexArray, ComplexArray]:
    """Return impacts of constant force and finite duration as steps up and down, with the step response of modes."""
    rising = np.argsort(both := np.concatenate([times_s, times_s + duration_s]), kind="stable")
    heights = np.concatenate([sizes / duration_s, -sizes / duration_s])
    steps = residues / poles
    # the response to a step tends to a constant, which the step down cancels
    return both[rising], heights[rising], np.append(poles, 0.0), np.append(steps, -np.sum(steps.real))


def add_fir_response(
    values: Array,
    *,
    times_s: Array,
    impulses_ns: Array,
    fir: FirFilter,
    rate_hz: float,
    duration_s: Array | None = None,
) -> None:
    """Add the response to impacts at any instants to a channel (n,), in place, compensated for the filter delay.

    An impact between samples is a Kaiser-windowed sinc, accurate to 1e-5 up to 0.9 of half the rate; an impact of
    finite duration is the mean of these.
    """
    at = times_s * rate_hz
    near = np.floor(at).astype(np.int64)
    late = np.zeros(at.size) if duration_s is None else duration_s * rate_hz
    offsets = np.arange(-_HALF + 1, _HALF + math.ceil(np.max(late, initial=0.0)) + 1)
    begin, lead = -fir.taps.size - offsets.size, round(fir.delay_s * rate_hz) + _HALF
    overlap = np.zeros(offsets.size)
    for start in range(begin, values.size + lead, BLOCK):
        count = min(BLOCK, values.size + lead - start)
        spread = np.zeros(count + offsets.size)
        spread[: offsets.size] = overlap
        here = (near >= start) & (near < start + count)
        shares = _interpolation_weights(offsets - (at[here] - near[here])[:, None], late[here])
        places = near[here][:, None] - start + offsets + _HALF
        np.add.at(spread, places, impulses_ns[here][:, None] * rate_hz * shares)
        overlap = spread[count:].copy()
        response = fir.push(spread[:count])
        # the first sample of spread impacts is early, and the filter late, by this lead
        first = start - lead
        inside = slice(max(-first, 0), max(min(count, values.size - first), 0))
        if inside.start < inside.stop:
            values[first + inside.start : first + inside.stop] += response[inside]


def later(values: Array, samples: float) -> Array:
    """Return a band-limited signal (n,) `samples` later, with odd continuation beyond its ends."""
    whole = math.floor(samples)
    reach = _HALF + abs(whole) + 1
    padded = np.pad(values, reach, mode="reflect", reflect_type="odd")
    weights = _sinc(np.arange(-_HALF, _HALF + 1.0) - (samples - whole))
    first = reach + whole - _HALF
    return np.convolve(padded[first : first + values.size + 2 * _HALF], weights[::-1], mode="valid")


def _interpolation_weights(since: Array, late: Array) -> Array:
    """Return the weights of samples (m, k) `since` an impact, for impacts lasting `late` samples (m,)."""
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


# ---- Lines: harmonics of a damaged tooth of a kinematic scene, which strikes once per revolution ---------------------


FLOOR = 1e-2  # of the largest line of the same impacts
BELOW_NYQUIST = 0.98  # of half the rate at the highest speed, above which lines are left out
_SEARCHED = 33  # instants at which significant lines are searched for


def impact_lines(
    prepared: PreparedScene, *, listed: frozenset[Fraction] = frozenset()
) -> Iterator[tuple[ImpactTrain, list[Fraction], ComplexArray]]:
    """Yield each periodic impact train, the orders of its significant lines, and their Z (sensor, line, instant).

    Impacts of several teeth of one gear interfere, so that a line is significant if their sum exceeds `FLOOR` times its
    largest line; every order in `listed` is included as well.
    """
    scene = prepared.scene
    top = BELOW_NYQUIST * scene.rate_hz / 2 / prepared.drive.angle.top_speed_hz(0.0, scene.duration_s)
    few = np.unique(np.linspace(0, prepared.instants_s.size - 1, _SEARCHED).round().astype(int))
    together: dict[tuple[str, Fraction], list[tuple[int, ImpactTrain]]] = {}
    for number, train in prepared.trains:
        if train.order is not None and train.amplitudes.any():
            together.setdefault((train.component, train.order), []).append((number, train))
    for (_, order), trains in together.items():
        harmonics = np.arange(1, int(top / float(order)) + 1)
        if not harmonics.size:
            continue
        summed = sum((_lines(prepared, *item, harmonics, few) for item in trains), np.zeros(1, dtype=np.complex128))
        sizes = np.max(np.abs(summed), axis=(0, 2))
        known = np.array([harmonic * order in listed for harmonic in harmonics.tolist()])
        loud = harmonics[known | (sizes > FLOOR * np.max(sizes))]
        every = np.arange(prepared.instants_s.size)
        for number, train in trains:
            orders = [harmonic * order for harmonic in loud.tolist()]
            yield train, orders, _lines(prepared, number, train, loud, every)


def _lines(
    prepared: PreparedScene, number: int, train: ImpactTrain, harmonics: NDArray[np.int_], instants: NDArray[np.int_]
) -> ComplexArray:
    """Return Z (sensor, line, instant) of harmonics of a train of fault `number`, at given instants of the truth."""
    load = prepared.impact_factor(number, prepared.instants_s[instants])
    speed_hz = prepared.speed_hz[instants]
    frequency = harmonics[:, None] * float(train.order or 0) * speed_hz
    found = []
    for sensor, gain, chain in zip(prepared.scene.sensors, prepared.gains[train.source], prepared.chains, strict=True):
        path = prepared.paths.get((train.source, sensor.name))
        rung = impact_line(
            train,
            harmonic=harmonics[:, None],
            speed_hz=speed_hz,
            load=load,
            path=path or ringing(prepared.scene.resonance),
        )
        found.append((abs(gain) if path is None else 1.0) * chain.response(frequency) * rung)
    return np.stack(found)
