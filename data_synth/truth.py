"""Truth of a synthetic record: its variables ``truth_...``."""

from collections.abc import Iterator
from fractions import Fraction
from functools import reduce

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from data_synth.bearings.impacts import signed_cage_order
from data_synth.operation.shaft_angle import Array
from data_synth.sources.families import last_s, turning_ratios
from data_synth.sources.impact_responses import impact_lines
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.gear_lines import GearLines, Line
from data_synth.vibration.run import Motion, fault_passes


def truth_variables(
    prepared: PreparedScene, *, motion: Motion | None = None, measured: GearLines | None = None
) -> dict[str, xr.DataArray]:
    """Return the truth of every record: speed, lines, measurement chain, faults and tachometer.

    `motion` is that of vibrating gears, and `measured` their lines where they are integrated. `data_synth.simulate`
    documents the variables.
    """
    reference, torque = str(prepared.scene.gearbox.reference), prepared.drive.torque
    histories = {
        "speed": (prepared.speed_hz, "rev s-1", reference),
        "revolutions": (prepared.drive.angle.revolutions(prepared.instants_s), "rev", reference),
    }
    if torque is not None and prepared.scene.torque is not None:
        histories["torque"] = torque.at(prepared.instants_s), "N m", prepared.scene.torque.link
    return {
        **{
            f"truth_{name}": xr.DataArray(values, dims="truth_time", attrs={"units": units, "shaft": shaft})
            for name, (values, units, shaft) in histories.items()
        },
        **_line_truth(prepared, measured),
        **_chain_truth(prepared),
        **_fault_truth(prepared),
        **_pulse_truth(prepared),
        **(_pass_truth(motion) if motion is not None else {}),
    }


def angle_truth(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return the exact angle of every shaft, cage and rolling element at every sample, in rev.

    Angles are signed and relative to the frame, except that elements rotate about their own axes relative to the cage;
    links whose axis is carried round in another direction are left out. Under pure rolling all are zero at the first
    tachometer mark. A bearing with a defect follows its impacts, slip included: its cage is at zero where element 1
    carries the largest load, and the phase of the defect, a whole number at each impact, is returned as well. Two
    defects of one bearing slip independently; cage and elements then follow the first.
    """
    scene = prepared.scene
    revolutions = prepared.drive.angle.revolutions(np.arange(scene.samples) / scene.rate_hz)
    shafts = {link: ratio * revolutions for link, ratio in turning_ratios(scene).items()}
    rollers = dict[str, Array]()
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
        # an element's defect meets both races in one revolution of the element
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


def _line_truth(prepared: PreparedScene, measured: GearLines | None) -> dict[str, xr.DataArray]:
    """Return complex amplitude, component and kind of every line, with the coordinates of the whole truth."""
    at_orders: dict[float, list[Line]] = {}
    for line in (*_lines(prepared), *(measured.lines if measured is not None else ())):
        at_orders.setdefault(line.order, []).append(line)
    lines = [
        sorted(at_orders[order], key=lambda line: -float(np.max(np.abs(line.amplitude)))) for order in sorted(at_orders)
    ]
    sensors, instants_s = prepared.scene.sensors, prepared.instants_s
    none = np.zeros((len(sensors), instants_s.size), dtype=np.complex128)
    summed = [reduce(np.add, [line.amplitude for line in parts]) for parts in lines] or [none]
    amplitude = xr.DataArray(
        # lines of vibrating gears are not accurate enough for more digits
        np.stack(summed, axis=1, dtype=np.complex64 if measured is not None else np.complex128)[:, : len(lines)],
        dims=("truth_channel", "truth_order", "truth_time"),
        coords={
            "truth_channel": [sensor.name for sensor in sensors],
            "truth_order": sorted(at_orders),
            "truth_time": ("truth_time", instants_s, {"units": "s"}),
        },
        attrs={"units": sensors[0].channel_units, "convention": "x = Re{Z exp(j order phase)}, peak amplitude"},
    )
    labels = {
        f"truth_{name}": xr.DataArray(
            [" + ".join(dict.fromkeys(getattr(part, name) for part in parts)) for parts in lines], dims="truth_order"
        )
        for name in ("component", "kind")
    }
    shares = ("free", "left", "fault_left") if measured is not None else ()
    left = {
        f"truth_{name}": xr.DataArray(share, dims="truth_channel", attrs={"units": "1"})
        for name in shares
        if (share := getattr(measured, name)) is not None
    }
    return {"truth_amplitude": amplitude, **labels, **left}


def _chain_truth(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return AC coupling, skew, poles and gain of the measurement chains, where a channel has any."""
    sensors, chains, truth = prepared.scene.sensors, prepared.chains, dict[str, xr.DataArray]()

    def add(name: str, values: ArrayLike, units: str, about: str, *dims: str) -> None:
        attrs = {"units": units, "about": about}
        truth[f"truth_chain_{name}"] = xr.DataArray(np.array(values), dims=("truth_channel", *dims), attrs=attrs)

    if any(each.ac_coupling_hz for each in sensors):
        corners_hz = [np.nan if each.ac_coupling_hz is None else each.ac_coupling_hz for each in sensors]
        add("coupling", corners_hz, "Hz", "j f / (j f + it) is a factor of truth_amplitude")
    if any(each.skew_s for each in chains):
        add("skew", [each.skew_s for each in chains], "s", "exp(2j pi f skew) is a factor of truth_amplitude")
    if any(each.poles.size or each.gain != 1 for each in chains):
        most = max(each.poles.size for each in chains)
        poles = [np.append(each.poles, np.full(most - each.poles.size, np.nan)) for each in chains]
        about = "H(f) = truth_chain_gain prod p / (p - 2j pi f), a factor of truth_amplitude"
        add("poles", poles, "rad s-1", about, "truth_chain_pole")
        add("gain", [each.gain for each in chains], f"{sensors[0].channel_units} ({sensors[0].units})-1", about)
    return truth


def _lines(prepared: PreparedScene) -> Iterator[Line]:
    """Yield the lines of harmonic families, then those of impacts, which may share their orders."""
    listed = set[Fraction]()
    for family, amplitudes in zip(prepared.families, prepared.amplitudes, strict=True):
        orders = family.orders
        for index in np.flatnonzero(family.nonzero).tolist():
            listed.add(orders[index])
            yield Line(float(orders[index]), family.component, family.kind, amplitudes[:, index])
    for train, orders, amplitudes in impact_lines(prepared, listed=frozenset(listed)):
        for index, order in enumerate(orders):
            yield Line(float(order), train.component, train.kind, amplitudes[:, index])


def _fault_truth(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return component, kind and size of every fault, and the times of its impacts."""
    faults = prepared.scene.faults
    truth = {
        f"truth_fault_{name}": xr.DataArray(
            np.array([getattr(fault, name) for fault in faults], dtype=np.str_), dims="truth_fault"
        )
        for name in ("component", "kind")
    }
    if faults:
        sizes = [fault.initial_mm * fault.relative_size(prepared.instants_s) for fault in faults]
        truth["truth_fault_size"] = xr.DataArray(
            np.stack(sizes), dims=("truth_fault", "truth_time"), attrs={"units": "mm"}
        )
    for number, fault in enumerate(faults):
        for what, is_entry in (("impact", False), ("entry", True)):
            struck_s = [
                prepared.impacts_at_source(number, train)[0]
                for of, train in prepared.trains
                if of == number and train.is_entry is is_entry
            ]
            if struck_s:
                times_s = np.sort(np.concatenate(struck_s))
                truth[f"truth_{what}_times_{number + 1}"] = xr.DataArray(
                    times_s[(times_s >= 0) & (times_s <= last_s(prepared.scene))],
                    dims=f"truth_{what}_{number + 1}",
                    attrs={"units": "s", "component": fault.component, "kind": fault.kind},
                )
    return truth


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


def _pass_truth(motion: Motion) -> dict[str, xr.DataArray]:
    """Return the times in s at which damaged teeth are midway through their mesh, one variable per gear fault."""
    return {
        f"truth_tooth_passes_{number + 1}": xr.DataArray(
            times_s,
            dims=f"truth_tooth_pass_{number + 1}",
            attrs={"units": "s", "component": motion.stage.scene.faults[number].component, "half_width_rev": half_rev},
        )
        for number, (times_s, half_rev) in fault_passes(motion).items()
    }
