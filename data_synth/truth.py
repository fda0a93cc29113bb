"""Truth of a synthetic record: its variables ``truth_...``."""

from dataclasses import dataclass
from fractions import Fraction
from functools import reduce

import numpy as np
import xarray as xr
from numpy.polynomial.chebyshev import chebval

from data_synth.bearings.impacts import signed_cage_order
from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.kinematic.harmonics import ComplexArray, common_base
from data_synth.kinematic.planet_pass import pass_orders
from data_synth.operation.shaft_angle import Array
from data_synth.sources.prepared import PreparedScene, last_s
from data_synth.transfer.paths import impact_line
from data_synth.vibration.run import Motion, fault_passes

_STEADY = 1e-12  # of the speed: what rounding may change
_NUTTALL = (0.3635819, -0.4891775, 0.1365995, -0.0106411)
_BINS = 4
_BLOCK = 65536
_NOT_RESOLVED = 2e-5  # of the largest line: leakage of the window


@dataclass(frozen=True, kw_only=True)
class _LineSource:
    """The part of one source in the line at one order: Z (sensor, instant)."""

    component: str
    kind: str
    amplitude: ComplexArray


@dataclass(frozen=True, kw_only=True)
class MeshLines:
    """Lines of vibrating gears at the orders of their meshes, order -> (mesh, Z (sensor,)), and their error."""

    lines: dict[Fraction, tuple[str, ComplexArray]]
    about: str


def mesh_lines(prepared: PreparedScene, gears: Array) -> MeshLines:
    """Measure the lines of meshes in the channels of gears in steady motion, (sensor, n).

    With the four-term cosine window of least side lobes over the record (Nuttall 1981, -98 dB), so that lines four and
    more of its periods away leak less than 2e-5 of themselves.
    """
    scene = prepared.scene
    torque = prepared.drive.torque
    if np.ptp(prepared.speed_hz) > _STEADY * np.max(prepared.speed_hz) or (
        torque is not None and np.ptp(torque.values) > 0
    ):
        return MeshLines(
            lines={}, about="left out: speed or torque changes, so the lines of gears have no one amplitude"
        )
    orders = scene.exact_orders("gear_mesh")
    teeth = scene.exact_orders("tooth")
    if any(fault.growth is not None and fault.component in teeth for fault in scene.faults):
        return MeshLines(lines={}, about="left out: damage of teeth grows, so the lines of gears have no one amplitude")
    # meshes shake each other, so lines stand at all multiples of what their orders have in common
    passing = {mesh: pass_orders(scene, mesh) for mesh in orders}
    bases = [*orders.values(), *(teeth[fault.component] for fault in scene.faults if fault.component in teeth)]
    bases += [carrier for carrier, _ in passing.values() if carrier]
    periods = float(reduce(common_base, bases)) * float(prepared.speed_hz[0]) * scene.duration_s
    lines = {
        order: (mesh, line)
        for mesh, measured in zip(
            orders, _measured(prepared, gears, [(orders[m], *passing[m]) for m in orders]), strict=True
        )
        for order, line in measured.items()
    }
    # planets cancel most of the lines beside those of their meshes
    least = _NOT_RESOLVED * max((float(np.max(np.abs(line))) for _, line in lines.values()), default=0.0)
    lines = {
        order: (mesh, line)
        for order, (mesh, line) in lines.items()
        if not passing[mesh][1] or np.max(np.abs(line)) > least
    }
    known = "other lines add less than 2e-5" if periods >= _BINS else "lines less than 4 / duration_s away are in it"
    return MeshLines(lines=lines, about=f"of the steady motion, by a window over the record: {known}")


def _measured(
    prepared: PreparedScene, gears: Array, families: list[tuple[Fraction, Fraction, int]]
) -> list[dict[Fraction, ComplexArray]]:
    """Return Z (sensor,) of the lines of families, summed block by block.

    A family is an order with its harmonics, a second order, and the number of its multiples that are sidebands of each
    harmonic and of zero.
    """
    scene = prepared.scene
    top = scene.rate_hz / 2 / float(prepared.speed_hz[0])
    totals: list[dict[Fraction, ComplexArray]] = [{} for _ in families]
    for start in range(0, scene.samples, _BLOCK):
        numbers = np.arange(start, min(start + _BLOCK, scene.samples))
        turned = np.cos(2 * np.pi * (numbers + 0.5) / scene.samples)
        windowed = np.ascontiguousarray(gears[:, start : start + numbers.size] * chebval(turned, _NUTTALL))
        revolutions = prepared.drive.angle.revolutions(numbers / scene.rate_hz)
        for total, (order, beside, sides) in zip(totals, families, strict=True):
            once = _demodulator(order, revolutions)
            steps = {side: _demodulator(side * beside, revolutions) for side in range(-sides, sides + 1) if side}
            phasor = np.ones(numbers.size, dtype=np.complex128) if sides else once
            for harmonic in range(0 if sides else 1, scene.excitation.harmonics + 1):
                for side in range(-sides, sides + 1):
                    line = harmonic * order + side * beside
                    if 0 < line < top:
                        measured = windowed @ (phasor * steps[side] if side else phasor)
                        total[line] = total.get(line, 0.0) + measured
                phasor = phasor * once
    # the cosines of the window add up to nothing over the record
    return [
        {line: np.asarray(2 * measured / (_NUTTALL[0] * scene.samples)) for line, measured in total.items()}
        for total in totals
    ]


def _demodulator(order: Fraction, revolutions: Array) -> ComplexArray:
    """Return ``exp(-2j pi order revolutions)``."""
    return np.asarray(np.exp(-2j * np.pi * np.remainder(float(order) * revolutions, 1.0)))


def tooth_pass_truth(motion: Motion) -> dict[str, xr.DataArray]:
    """Return the times at which damaged teeth pass their mesh."""
    return {
        f"truth_tooth_passes_{number + 1}": xr.DataArray(
            times_s,
            dims=f"truth_tooth_pass_{number + 1}",
            attrs={"units": "s", "component": motion.stage.scene.faults[number].component, "half_width_rev": half_rev},
        )
        for number, (times_s, half_rev) in fault_passes(motion).items()
    }


def truth_variables(prepared: PreparedScene, *, measured: MeshLines | None = None) -> dict[str, xr.DataArray]:
    """Return the truth of every record: speed, lines (`measured` those of gears), chain, faults and tachometer."""
    instants = xr.DataArray(prepared.instants_s, dims="truth_time", attrs={"units": "s"})
    reference = str(prepared.scene.gearbox.reference)
    history = {
        "truth_speed": (prepared.speed_hz, "rev s-1"),
        "truth_revolutions": (prepared.drive.angle.revolutions(prepared.instants_s), "rev"),
    }
    truth = {
        name: xr.DataArray(
            values, dims="truth_time", coords={"truth_time": instants}, attrs={"units": units, "shaft": reference}
        )
        for name, (values, units) in history.items()
    }
    return {
        **truth,
        **_torque_truth(prepared, instants),
        **_line_truth(prepared, instants, measured),
        **_fault_truth(prepared, instants),
        **_pulse_truth(prepared),
    }


def angle_truth(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return the exact angle of every shaft, cage and rolling element at every sample, in rev.

    Each is relative to the frame and signed, but for the rotation of elements, which is about their own axis relative
    to the cage; all are zero at the tachometer's first mark, under pure rolling. A bearing with a defect follows its
    impacts, slip included: its cage is zero where element 1 has the largest load, and the phase of the defect itself,
    whole at each impact, is stated too. Two defects of a bearing have independent slip; its cage and elements are then
    those of the first.
    """
    scene = prepared.scene
    revolutions = prepared.drive.angle.revolutions(np.arange(scene.samples) / scene.rate_hz)
    shafts = {link: float(scene.ratio(link)) * revolutions for link in scene.gearbox.links if scene.ratio(link) != 0}
    rollers: dict[str, Array] = {}
    for _, train in prepared.trains:
        if train.bearing is None:
            continue
        rolling = train.bearing.rolling
        turned = rolling.cage_turns(revolutions) + rolling.rates.carried * revolutions
        rollers.setdefault(f"{train.component}/cage", turned)
        rollers.setdefault(f"{train.component}/element", rolling.element_turns(revolutions))
        rollers.setdefault(f"{train.component}/{train.kind} strike", rolling.defect_phase(revolutions))
    for bearing in (name for declared in scene.gearbox.bearings for name in declared.names):
        rates = scene.bearing(bearing)
        rollers.setdefault(f"{bearing}/cage", (signed_cage_order(rates) + rates.carried) * revolutions)
        # an element meets both races in one turn
        rollers.setdefault(f"{bearing}/element", rates.rolling_element / 2 * revolutions)
    return {
        f"truth_{what}_revolutions": xr.DataArray(
            np.stack([*turns.values()]),
            dims=(f"truth_{what}", "time"),
            coords={f"truth_{what}": [*turns]},
            attrs={"units": "rev"},
        )
        for what, turns in (("shaft", shafts), ("roller", rollers))
        if turns
    }


def _torque_truth(prepared: PreparedScene, instants: xr.DataArray) -> dict[str, xr.DataArray]:
    if prepared.drive.torque is None or prepared.scene.torque is None:
        return {}
    return {
        "truth_torque": xr.DataArray(
            prepared.drive.torque.at(prepared.instants_s),
            dims="truth_time",
            coords={"truth_time": instants},
            attrs={"units": "N m", "shaft": prepared.scene.torque.link},
        )
    }


def _line_truth(prepared: PreparedScene, instants: xr.DataArray, measured: MeshLines | None) -> dict[str, xr.DataArray]:
    """Return complex amplitude, component and kind of every line, and the frequency response of the chain."""
    every = _lines(prepared)
    for order, (mesh, windowed) in (measured.lines if measured is not None else {}).items():
        steady = np.repeat(windowed[:, None], instants.size, axis=1)
        every.setdefault(order, []).append(_LineSource(component=mesh, kind="gear_mesh", amplitude=steady))
    lines = dict(sorted(every.items()))
    for parts in lines.values():
        parts.sort(key=lambda part: -float(np.max(np.abs(part.amplitude))))
    orders = {"truth_order": [float(order) for order in lines]}
    sensors = prepared.scene.sensors
    channels = {"truth_channel": [sensor.name for sensor in sensors]}
    coords = {**channels, **orders, "truth_time": instants}
    dims = ("truth_channel", "truth_order", "truth_time")
    amplitude = xr.DataArray(
        np.stack([np.sum([part.amplitude for part in parts], axis=0) for parts in lines.values()], axis=1)
        if lines
        else np.zeros((len(sensors), 0, instants.size), dtype=np.complex128),
        dims=dims,
        coords=coords,
        attrs={"units": sensors[0].channel_units, "convention": "x = Re{Z exp(j order phase)}, peak amplitude"},
    )
    labels = {
        f"truth_{name}": xr.DataArray(
            [" + ".join(dict.fromkeys(getattr(part, name) for part in parts)) for parts in lines.values()],
            dims="truth_order",
            coords=orders,
        )
        for name in ("component", "kind")
    }
    chain = {}
    if any(chain.poles.size or chain.gain != 1 for chain in prepared.chains):
        frequencies = np.outer(orders["truth_order"], prepared.speed_hz)
        responses = np.stack([chain.response(frequencies) for chain in prepared.chains])
        about = f"{sensors[0].channel_units} for one {sensors[0].units}, part of truth_amplitude"
        chain["truth_chain_response"] = xr.DataArray(responses, dims=dims, coords=coords, attrs={"about": about})
    return {"truth_amplitude": amplitude, **labels, **chain}


def _lines(prepared: PreparedScene) -> dict[Fraction, list[_LineSource]]:
    """Return the sources of the line at each order: harmonic families, then the impacts at the same orders."""
    lines: dict[Fraction, list[_LineSource]] = {}
    for family, amplitudes in zip(prepared.families, prepared.amplitudes, strict=True):
        for index, (order, nonzero) in enumerate(zip(family.orders, family.nonzero, strict=True)):
            if nonzero:
                part = _LineSource(component=family.component, kind=family.kind, amplitude=amplitudes[:, index])
                lines.setdefault(order, []).append(part)
    for number, train in prepared.trains:
        for order, parts in lines.items():
            if train.order is not None and train.amplitudes.any() and (order / train.order).denominator == 1:
                parts.append(_impact_part(prepared, number, train, harmonic=int(order / train.order)))
    return lines


def _impact_part(prepared: PreparedScene, number: int, train: ImpactTrain, *, harmonic: int) -> _LineSource:
    """Return the part of a train of impacts in the line at one of its harmonics."""
    load = prepared.impact_factor(number, prepared.instants_s)
    frequency = harmonic * float(train.order or 0) * prepared.speed_hz
    windowed = []
    for sensor, gain, chain in zip(prepared.scene.sensors, prepared.gains[train.source], prepared.chains, strict=True):
        path = prepared.paths.get((train.source, sensor.name))
        rung = impact_line(
            train,
            harmonic=harmonic,
            speed_hz=prepared.speed_hz,
            load=load,
            mode=prepared.scene.resonance if path is None else path,
        )
        windowed.append((abs(gain) if path is None else 1.0) * chain.response(frequency) * rung)
    return _LineSource(component=train.component, kind=train.kind, amplitude=np.stack(windowed))


def _fault_truth(prepared: PreparedScene, instants: xr.DataArray) -> dict[str, xr.DataArray]:
    """Return component, kind and size of every fault, and the times of its impacts."""
    faults = prepared.scene.faults
    truth = {
        f"truth_fault_{name}": xr.DataArray(
            np.array([getattr(fault, name) for fault in faults], dtype=np.str_), dims="truth_fault"
        )
        for name in ("component", "kind")
    }
    if any(fault.growth is not None for fault in faults):
        sizes = [fault.initial_mm * fault.relative_size(prepared.instants_s) for fault in faults]
        truth["truth_fault_size"] = xr.DataArray(
            np.stack(sizes),
            dims=("truth_fault", "truth_time"),
            coords={"truth_time": instants},
            attrs={"units": "mm"},
        )
    for number, fault in enumerate(faults):
        for what, is_entry in (("impact", False), ("entry", True)):
            struck_s = [
                prepared.impacts_at_source(number, train)[0]
                for of, train in prepared.trains
                if of == number and train.is_entry is is_entry
            ]
            if struck_s:
                truth[f"truth_{what}_times_{number + 1}"] = xr.DataArray(
                    _within_record(np.sort(np.concatenate(struck_s)), last_s(prepared.scene)),
                    dims=f"truth_{what}_{number + 1}",
                    attrs={"units": "s", "component": fault.component, "kind": fault.kind},
                )
    return truth


def _within_record(times_s: Array, stop_s: float) -> Array:
    """Return the times within the record."""
    return times_s[(times_s >= 0) & (times_s <= stop_s)]


def _pulse_truth(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return the true times of the marks, where the tachometer is degraded."""
    tachometer, pulses = prepared.scene.tachometer, prepared.pulses
    electrical = prepared.scene.imperfections.electrical if prepared.scene.imperfections is not None else None
    pick_up = electrical.tachometer if electrical is not None else None
    if (tachometer.uneven, tachometer.missing, tachometer.spurious, tachometer.jitter, pick_up) == (None,) * 5:
        return {}
    about = "phase zero is at the first of them"
    return {
        "truth_marks": xr.DataArray(pulses.marks_s, dims="truth_mark", attrs={"units": "s", "about": about}),
        "truth_missed_marks": xr.DataArray(pulses.missed, dims="truth_missed_mark"),
        "truth_spurious_pulses": xr.DataArray(pulses.spurious_s, dims="truth_spurious", attrs={"units": "s"}),
    }
