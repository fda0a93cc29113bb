"""Truth of a synthetic record: its variables ``truth_...``."""

from fractions import Fraction
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import xarray as xr

from data_synth.bearings.impacts import signed_cage_order
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.sources.families import last_s, turning_ratios
from data_synth.sources.impact_lines import impact_lines
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.gear_lines import GearLines
from data_synth.vibration.run import Motion, fault_passes


class _LineSource(NamedTuple):
    """The part of one source in the line at one order: Z (sensor, instant)."""

    component: str
    kind: str
    amplitude: ComplexArray


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


def truth_variables(prepared: PreparedScene, *, measured: GearLines | None = None) -> dict[str, xr.DataArray]:
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

    Each is relative to the frame and signed, links whose axis is carried in another direction left out, but for the
    rotation of elements, which is about their own axis relative to the cage; all are zero at the tachometer's first
    mark, under pure rolling. A bearing with a defect follows its impacts, slip included: its cage is zero where element
    1 has the largest load, and the phase of the defect itself, whole at each impact, is stated too. Two defects of a
    bearing have independent slip; its cage and elements are then those of the first.
    """
    scene = prepared.scene
    revolutions = prepared.drive.angle.revolutions(np.arange(scene.samples) / scene.rate_hz)
    shafts = {link: ratio * revolutions for link, ratio in turning_ratios(scene).items()}
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


def _line_truth(prepared: PreparedScene, instants: xr.DataArray, measured: GearLines | None) -> dict[str, xr.DataArray]:
    """Return complex amplitude, component and kind of every line, and poles and gain of the chain."""
    every = _lines(prepared)
    for line in measured.lines if measured is not None else ():
        every.setdefault(line.order, []).append(_LineSource(line.component, line.kind, line.amplitude))
    rising = sorted(every.items(), key=itemgetter(0))
    values, lines = [value for value, _ in rising], [parts for _, parts in rising]
    for parts in lines:
        if len(parts) > 1:
            parts.sort(key=lambda part: -float(np.max(np.abs(part.amplitude))))
    orders = {"truth_order": values}
    sensors = prepared.scene.sensors
    channels = {"truth_channel": [sensor.name for sensor in sensors]}
    coords = {**channels, **orders, "truth_time": instants}
    dims = ("truth_channel", "truth_order", "truth_time")
    summed = [_summed(parts) for parts in lines] or [np.zeros((len(sensors), instants.size), dtype=np.complex128)]
    amplitude = xr.DataArray(
        # lines of gears in motion are not known to more digits
        np.stack(summed, axis=1, dtype=np.complex64 if measured is not None else np.complex128)[:, : len(lines)],
        dims=dims,
        coords=coords,
        attrs={"units": sensors[0].channel_units, "convention": "x = Re{Z exp(j order phase)}, peak amplitude"},
    )
    labels = {
        f"truth_{name}": xr.DataArray(
            [" + ".join(dict.fromkeys(getattr(part, name) for part in parts)) for parts in lines],
            dims="truth_order",
            coords=orders,
        )
        for name in ("component", "kind")
    }
    chain = dict[str, xr.DataArray]()
    coupling_hz = [each.ac_coupling_hz for each in sensors]
    if any(coupling_hz):
        attrs = {"units": "Hz", "about": "j f / (j f + it) is a factor of truth_amplitude"}
        corners = np.array(coupling_hz, dtype=np.float64)
        chain["truth_chain_coupling"] = xr.DataArray(corners, dims="truth_channel", coords=channels, attrs=attrs)
    if any(each.skew_s for each in prepared.chains):
        attrs = {"units": "s", "about": "exp(2j pi f skew) is a factor of truth_amplitude"}
        skews = np.array([each.skew_s for each in prepared.chains])
        chain["truth_chain_skew"] = xr.DataArray(skews, dims="truth_channel", coords=channels, attrs=attrs)
    if any(each.poles.size or each.gain != 1 for each in prepared.chains):
        poles = np.full((len(sensors), max(each.poles.size for each in prepared.chains)), np.nan, dtype=np.complex128)
        for row, each in zip(poles, prepared.chains, strict=True):
            row[: each.poles.size] = each.poles
        units = f"{sensors[0].channel_units} ({sensors[0].units})-1"
        about = "H(f) = truth_chain_gain prod p / (p - 2j pi f), a factor of truth_amplitude"
        chain |= {
            "truth_chain_poles": xr.DataArray(
                poles,
                dims=("truth_channel", "truth_chain_pole"),
                coords=channels,
                attrs={"units": "rad s-1", "about": about},
            ),
            "truth_chain_gain": xr.DataArray(
                [each.gain for each in prepared.chains],
                dims="truth_channel",
                coords=channels,
                attrs={"units": units, "about": about},
            ),
        }
    left = (
        {
            f"truth_{name}": xr.DataArray(share, dims="truth_channel", coords=channels, attrs={"units": "1"})
            for name, share in (("left", measured.left), ("fault_left", measured.fault_left))
            if share is not None
        }
        if measured is not None
        else {}
    )
    return {"truth_amplitude": amplitude, **labels, **left, **chain}


def _summed(parts: list[_LineSource]) -> ComplexArray:
    """Return the amplitude of all sources at one order."""
    return parts[0].amplitude if len(parts) == 1 else np.sum([part.amplitude for part in parts], axis=0)


def _lines(prepared: PreparedScene) -> dict[float, list[_LineSource]]:
    """Return the sources of the line at each order: harmonic families, then the impacts at the same orders.

    By numbers, correctly rounded: exact orders are compared ten times as slowly.
    """
    lines: dict[float, list[_LineSource]] = {}
    listed = set[Fraction]()
    for family, amplitudes in zip(prepared.families, prepared.amplitudes, strict=True):
        for index, (order, nonzero) in enumerate(zip(family.orders, family.nonzero, strict=True)):
            if nonzero:
                part = _LineSource(component=family.component, kind=family.kind, amplitude=amplitudes[:, index])
                lines.setdefault(float(order), []).append(part)
                listed.add(order)
    for train, orders, amplitudes in impact_lines(prepared, listed=frozenset(listed)):
        for index, order in enumerate(orders):
            part = _LineSource(component=train.component, kind=train.kind, amplitude=amplitudes[:, index])
            lines.setdefault(float(order), []).append(part)
    return lines


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
    errors = ("uneven", "missing", "spurious", "jitter", "delay_s", "clock_ppm")
    if pick_up is None and not any(getattr(tachometer, name) for name in errors):
        return {}
    about = "phase zero is at the first of them"
    return {
        "truth_marks": xr.DataArray(pulses.marks_s, dims="truth_mark", attrs={"units": "s", "about": about}),
        "truth_missed_marks": xr.DataArray(pulses.missed, dims="truth_missed_mark"),
        "truth_spurious_pulses": xr.DataArray(pulses.spurious_s, dims="truth_spurious", attrs={"units": "s"}),
    }
