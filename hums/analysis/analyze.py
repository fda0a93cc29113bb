"""Analysis of one record: from record, gearbox and settings to spectra, lines, tracks, indicators and findings.

An analysis is an `xarray.DataTree` with the groups `/speed`, `/health`, `/order_spectrum`, `/envelope`, `/tracks`,
`/envelope_tracks`, `/indicators` and `/findings` (see `hums.analysis.result`), what verdicts rest on
(`hums.analysis.verdicts`), and what pictures need (`hums.analysis.pictures`); reports and scores are made from it
alone.
"""

import logging
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
import xarray as xr

from hums.analysis.averages import analyse_average
from hums.analysis.caveats import notes
from hums.analysis.channel import (
    AnalysedChannel,
    Stretch,
    analyse_channel,
    drawn_by,
    excluded_channels,
    selected_channels,
    setting_of,
    varying_values,
)
from hums.analysis.detection import AssessedLine, LineAssessor
from hums.analysis.findings import Finding, findings
from hums.analysis.gear_damage import GearJudgement, ToothEnvelope, gear_damage, gear_indicators
from hums.analysis.indicators import HISTORIES, Baseline, channel_indicators, read_baseline, snapshot_indicators
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM, SearchPlan, expected_lines
from hums.analysis.pictures import ChannelPictures, channel_pictures, picture_groups
from hums.analysis.reference_angle import Machine, prepare_machine, prepare_snapshots
from hums.analysis.result import (
    Analysis,
    IndicatorValue,
    SensorCondition,
    check_analysis,
    root_attributes,
    rows_dataset,
    spectrum_dataset,
    tree_of,
)
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.stretches import analyse_stretches, is_long
from hums.analysis.tracks import bearing_line, lines_to_track, tooth_line, track_envelope_lines, track_lines
from hums.analysis.unexplained import UnexplainedLine, not_named, unlike_drawing
from hums.analysis.verdicts import UNLIKE, evidence_groups, verdicts_from
from hums.gearbox.model import Gearbox
from hums.gearbox.orders import BEARING_KINDS
from hums.records.channels import is_average
from hums.records.record import channel_values, check_record, sampling
from hums.records.snapshots import is_snapshots, snapshots_of
from hums.records.store import open_record
from signals._validation import checked
from signals.health import SensorHealth

__all__ = ["AnalysisSettings", "analyze"]

_log = logging.getLogger("hums")


@checked
def analyze(
    record: xr.Dataset | str | PathLike[str],
    gearbox: Gearbox,
    *,
    settings: AnalysisSettings | None = None,
    baseline: Analysis | None = None,
) -> Analysis:
    """Return spectra, lines, amplitude tracks, condition indicators and findings of a record.

    Parameters
    ----------
    record : xarray.Dataset, str or Path
        Vibration channels and tachometer, from `hums.open_record` or `hums.make_record`; or the path of a record. Of
        an average in angle (`hums.AngularAverage`) the indicators are made that it allows, and nothing is judged.
        Snapshots (`hums.join_snapshots`) are pooled: their spectra are averaged in power, and the whole stretch is
        judged.
    gearbox : Gearbox
        The gearbox, with one degree of freedom; the record's tachometer or declared speed is that of one of its links.
    settings : AnalysisSettings, optional
        Defaults to ``AnalysisSettings()``.
    baseline : xarray.DataTree, optional
        Analysis of the previous record of this machine. It holds the variances of all earlier records, to which NA4
        and NB4 refer; the result holds them updated by this record. Without it the history starts at this record.

    Returns
    -------
    xarray.DataTree
        Groups ``/speed``, ``/health``, ``/order_spectrum``, ``/envelope``, ``/tracks``, ``/envelope_tracks`` (lines of
        named parts in the envelopes that show them), ``/indicators`` and ``/findings``; `line_table`, `findings_table`,
        `verdict_table`, `indicator_table`, `health_table` and `summary` read them.

    Notes
    -----
    A record of more than 4,000,000 samples a channel is analysed in stretches of equal length, which are joined:
    spectra are averaged by power, each row of a table is that of the stretch with its median, and a part is named by
    what at least half of the stretches show (`hums.analysis.stretches`). A gap costs its stretch alone.

    Raises
    ------
    AnalysisError
        If a channel or shaft does not exist, every channel is constant or has NaN, the speed cannot be estimated, or
        the record is shorter than one revolution of the reference.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(8000) / 4000
    >>> tone = 0.5 * np.cos(2 * np.pi * 23 * 20 * times_s)  # 23 teeth at 20 rev/s
    >>> noise = np.random.default_rng(0).normal(0, 0.05, times_s.size)
    >>> pulses = hums.PulseTimes(times_s=np.arange(41) / 20, shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": tone + noise}, rate_hz=4000, units="g", angle=pulses)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> lines = hums.line_table(analysis, "order_spectrum")
    >>> mesh = lines[(lines["component"] == "stage 1") & (lines["harmonic"] == 1)].iloc[0]
    >>> print(f"order {mesh['order']:g}: {mesh['amplitude']:.2f} {mesh['units']}")
    order 23: 0.50 g
    """
    if isinstance(record, str | PathLike):
        with open_record(record) as opened:
            return analyze(opened, gearbox, settings=settings, baseline=baseline)
    settings = settings or AnalysisSettings()
    check_record(record)
    if is_average(record):
        return analyse_average(record, gearbox, settings, baseline)
    if is_snapshots(record):
        return _analyse_snapshots(record.compute(), gearbox, settings, baseline)
    chosen = selected_channels(record, settings)
    if is_long(record, chosen):

        def analyse(part: xr.Dataset, pictures: bool) -> Analysis:
            own = settings.model_copy(update={"pictures": settings.pictures and pictures})
            return analyze(part, gearbox, settings=own, baseline=baseline)

        return analyse_stretches(record, chosen, analyse)
    gapped, constant = excluded_channels(record, chosen)
    names = [name for name in chosen if name not in gapped and name not in constant]
    histories = read_baseline(baseline, settings, units={name: record[name].attrs["units"] for name in names})
    _log.info("angle of the reference shaft")
    machine = prepare_machine(record, gearbox, settings.model_copy(update={"channels": tuple(names)}))
    expected = expected_lines(machine.kinematics, _plan(machine, settings))
    channels: list[AnalysedChannel] = []
    indicators: list[IndicatorValue] = []
    gears: list[GearJudgement] = []
    teeth: dict[str, dict[str, ToothEnvelope]] = {}
    pictures: list[ChannelPictures] = []
    for number, name in enumerate(names, start=1):
        _log.info("channel %s, %d of %d", name, number, len(names))
        values = varying_values(record, name)
        stretch = Stretch(values=values, phase=machine.phase)
        channel = analyse_channel(record, name, [stretch], machine, expected, settings)
        channels.append(channel)
        indicators += channel_indicators(record, channel, stretch, machine, settings, histories)
        of_gears = gear_damage(
            values,
            sampling(record, name),
            machine,
            channel=name,
            units=channel.units,
            false_alarm_probability=settings.false_alarm_probability,
            channels=len(names),
            faulty=channel.faulty,
            envelopes=teeth.setdefault(name, {}) if settings.most_tracks else None,
        )
        indicators += [] if channel.faulty else gear_indicators(of_gears)
        gears += of_gears
        if settings.pictures:
            pictures.append(channel_pictures(channel, stretch, sampling(record, name), machine, settings))
    excluded = [f'Channel "{name}" is dead and left out: it has the same value throughout.' for name in constant]
    excluded += [f'Channel "{name}" is left out: it has {gaps}.' for name, gaps in gapped.items()]
    conditions = _sensor_conditions(record, channels, gapped, constant, machine)
    assessed = _assessed(channels, machine, settings)
    groups = _without_verdicts(
        record, gearbox, machine, settings, channels, assessed, gears, baseline, notes=excluded, conditions=conditions
    )
    _log.info("amplitude tracks")
    groups |= {
        "/speed": _speed_dataset(machine),
        "/tracks": _tracks_dataset(record, channels, machine, assessed, settings),
        "/indicators": _indicator_rows(indicators, histories),
    }
    groups |= picture_groups(pictures) if pictures else {}
    found = _judge(groups, channels)
    groups["/envelope_tracks"] = _envelope_tracks(record, channels, teeth, machine, found, settings)
    tree = tree_of(groups)
    check_analysis(tree)
    return tree


def _analyse_snapshots(
    record: xr.Dataset, gearbox: Gearbox, settings: AnalysisSettings, baseline: Analysis | None
) -> Analysis:
    """Return the analysis of a record of snapshots, whose spectra are pooled by power.

    Tracks, averages over turns and what one tooth shows need the angle from snapshot to snapshot, and are left out.
    """
    parts = list(snapshots_of(record))
    chosen = selected_channels(record, settings)
    usable = {name: [n for n, part in enumerate(parts) if _is_usable(part, name)] for name in chosen}
    names = [name for name in chosen if usable[name]]
    if not names:
        raise AnalysisError(
            f'channel "{chosen[0]}" has samples that are not finite, or the same value throughout, in every snapshot; '
            "check the sensor, or choose other channels."
        )
    histories = read_baseline(baseline, settings, units={name: record[name].attrs["units"] for name in names})
    _log.info("angle of the reference shaft")
    machines = prepare_snapshots(parts, gearbox, settings.model_copy(update={"channels": tuple(names)}))
    machine = max(machines, key=lambda one: one.top_speed_hz)
    expected = expected_lines(machine.kinematics, _plan(machine, settings))
    channels, indicators = [], []
    for number, name in enumerate(names, start=1):
        _log.info("channel %s, %d of %d", name, number, len(names))
        rows = {n: channel_values(parts[n], name) for n in usable[name]}
        stretches = [
            Stretch(values=values, phase=machines[n].phase.scaled(_PARTS), parts=_PARTS) for n, values in rows.items()
        ]
        channel = analyse_channel(parts[usable[name][0]], name, stretches, machine, expected, settings)
        channels.append(channel)
        indicators += snapshot_indicators(channel, list(rows.values()), machine, settings)
    left = [
        f'Channel "{name}": {len(parts) - len(some)} of {len(parts)} snapshots are left out, which have gaps or the '
        "same value throughout."
        for name, some in usable.items()
        if len(some) < len(parts)
    ]
    conditions = [
        SensorCondition(name=name, sensor="vibration", status="sick", reasons="No snapshot of it can be used.")
        for name in chosen
        if not usable[name]
    ]
    conditions += _sensor_conditions(record, channels, {}, {}, machine)
    assessed = _assessed(channels, machine, settings)
    notes = [_pooled_note(channels, len(parts)), *left]
    groups = _without_verdicts(
        record, gearbox, machine, settings, channels, assessed, [], baseline, notes=notes, conditions=conditions
    )
    groups |= {
        "/speed": _speeds_of_snapshots(record, machines),
        "/tracks": xr.Dataset(),
        "/indicators": _indicator_rows(indicators, histories),
    }
    _judge(groups, channels)
    tree = tree_of(groups | {"/envelope_tracks": xr.Dataset()})
    check_analysis(tree)
    return tree


_PARTS = 8  # of a turn, to whole ones of which a snapshot is cut: of three turns an eighth is lost, not one


def _is_usable(part: xr.Dataset, name: str) -> bool:
    values = channel_values(part, name)
    return bool(np.isfinite(values).all() and values.min() != values.max())


def _pooled_note(channels: Sequence[AnalysedChannel], count: int) -> str:
    spectrum = channels[0].spectra.get(ENVELOPE, channels[0].spectra[ORDER_SPECTRUM])
    return (
        f"{count} snapshots of {1 / spectrum.bin_width:.3g} turns were pooled by power. Lines nearer to each other "
        f"than {spectrum.resolution:.2g} orders are one, whatever the number of snapshots; probabilities are those of "
        "records in one piece, which pooled noise does not exceed."
    )


def _speeds_of_snapshots(record: xr.Dataset, machines: Sequence[Machine]) -> xr.Dataset:
    """Return the mean speed over each revolution of all snapshots, against time from the first."""
    starts_s = record["snapshot_s"].values if "snapshot_s" in record.coords else np.zeros(len(machines))
    each = [_speed_dataset(machine) for machine in machines]
    shifted = [one.assign_coords(time_s=one["time_s"] + start) for one, start in zip(each, starts_s, strict=True)]
    return xr.concat(shifted, dim="revolution", combine_attrs="override")


def _assessed(channels: Sequence[AnalysedChannel], machine: Machine, settings: AnalysisSettings) -> list[AssessedLine]:
    assessor = LineAssessor(
        {bearing.name: bearing for bearing in machine.bearings},
        settings.false_alarm_probability,
        _healthy_spacings(machine),
    )
    return assessor.assess([line for channel in channels for line in channel.lines])


def _judge(groups: dict[str, xr.Dataset], channels: Sequence[AnalysedChannel]) -> list[Finding]:
    """Add the verdicts that the groups of an analysis, by path, allow, and return the findings among them."""
    judged = verdicts_from(groups, groups["/"].attrs)
    found = findings(judged)
    groups["/findings"] = rows_dataset(found, Finding, dim="finding")
    groups["/verdicts"] = rows_dataset([one for one in judged if one not in found], Finding, dim="part")
    left = not_named(
        [line for channel in channels for line in channel.unexplained],
        [one.order_found for one in found if one.kind in BEARING_KINDS],
        bin_width=groups[f"/{ORDER_SPECTRUM}"].attrs["bin_width_orders"],
    )
    groups["/unexplained"] = rows_dataset(left, UnexplainedLine, dim="line")
    return found


def _without_verdicts(
    record: xr.Dataset,
    gearbox: Gearbox,
    machine: Machine,
    settings: AnalysisSettings,
    channels: Sequence[AnalysedChannel],
    assessed: Sequence[AssessedLine],
    gears: Sequence[GearJudgement],
    baseline: Analysis | None,
    *,
    notes: Sequence[str],
    conditions: Sequence[SensorCondition],
) -> dict[str, xr.Dataset]:
    """Return the groups of an analysis that records in one piece and snapshots have alike."""
    unlike = unlike_drawing(
        [channel.spectra[ORDER_SPECTRUM] for channel in channels if not channel.faulty],
        drawn_by(machine, settings),
        setting_of(machine),
    )
    doubts = [unlike[0].upper() + unlike[1:] + "."] if unlike else []
    return {
        "/": xr.Dataset(
            attrs=_root_attrs(record, gearbox, machine, settings, channels, [*doubts, *notes]) | {UNLIKE: unlike}
        ),
        "/health": rows_dataset(conditions, SensorCondition, dim="item"),
        f"/{ORDER_SPECTRUM}": _spectra(channels, ORDER_SPECTRUM, assessed),
        f"/{ENVELOPE}": _spectra(channels, ENVELOPE, assessed),
    } | evidence_groups(channels, gears, machine, settings, baseline)


def _indicator_rows(indicators: Sequence[IndicatorValue], histories: Baseline) -> xr.Dataset:
    rows = rows_dataset(indicators, IndicatorValue, dim="row")
    return rows.assign_attrs({HISTORIES: histories.to_json()})


def _plan(machine: Machine, settings: AnalysisSettings) -> SearchPlan:
    band = settings.envelope_band_hz
    return SearchPlan(
        harmonics=settings.harmonics,
        sidebands=settings.sidebands,
        slip=settings.slip,
        speed_tolerance=settings.nominal_speed_tolerance if machine.phase.nominal else 0.0,
        envelope=isinstance(band, tuple) or (band is not None and bool(machine.bearings)),
    )


def _healthy_spacings(machine: Machine) -> dict[str, tuple[float, ...]]:
    """Return the sideband spacings of a healthy planetary stage at a sensor on the frame, by gear, in orders."""
    planet_pass = tuple(row.order for row in machine.defect_orders if row.kind == "planet_pass")
    shaft_order = {row.component: row.order for row in machine.defect_orders if row.kind == "shaft"}
    frame = machine.kinematics.gearbox.frame
    return {
        row.component: (*planet_pass, *([shaft_order[row.seen_from]] if row.seen_from in shaft_order else []))
        for row in machine.defect_orders
        if row.kind == "tooth" and row.seen_from != frame
    }


def _sensor_conditions(
    record: xr.Dataset,
    channels: Sequence[AnalysedChannel],
    gapped: Mapping[str, str],
    constant: Mapping[str, SensorHealth],
    machine: Machine,
) -> list[SensorCondition]:
    """Return the condition of every sensor: channels with gaps first, the tachometer last."""
    rows = [
        SensorCondition(
            name=name,
            sensor="vibration",
            status="sick",
            reasons=f"It drops out: it has {gaps}.",
            missing=float(np.mean(~np.isfinite(channel_values(record, name)))),
        )
        for name, gaps in gapped.items()
    ]
    checked = {channel.name: channel.health for channel in channels if channel.health is not None}
    rows += [
        SensorCondition(
            name=name,
            sensor="vibration",
            status=health.status,
            reasons=" ".join(reason[0].upper() + reason[1:] for reason in health.reasons),
            missing=float(health.missing.mean()),
            not_judged="; ".join(health.not_judged),
        )
        for name, health in (*checked.items(), *constant.items())
    ]
    if machine.source.tachometer:
        status, reasons = machine.tachometer_condition
        rows.append(
            SensorCondition(
                name=machine.source.tachometer, sensor="tachometer", status=status, reasons=" ".join(reasons)
            )
        )
    return rows


def _root_attrs(
    record: xr.Dataset,
    gearbox: Gearbox,
    machine: Machine,
    settings: AnalysisSettings,
    channels: Sequence[AnalysedChannel],
    excluded: Sequence[str],
) -> dict[str, Any]:
    """Return the attributes of the analysis: its inputs, settings and caveats."""
    described = [
        {"name": c.name, "units": c.units, "rate_hz": c.rate_hz, "duration_s": c.duration_s}
        | {key: str(record[c.name].attrs[key]) for key in ("sensor", "direction") if key in record[c.name].attrs}
        for c in channels
    ]
    caveats = [*notes(machine, settings, channels), *excluded]
    return root_attributes(record, gearbox, machine.reference, settings, channels=described, notes=caveats)


def _speed_dataset(machine: Machine) -> xr.Dataset:
    """Return the mean speed of the reference over each revolution, with its source."""
    phase, found = machine.phase, machine.source.estimated
    speed = machine.speeds_hz
    midpoints = float(phase.revolutions[0]) + 0.5 + np.arange(speed.size)
    attrs = {
        "shaft": machine.reference,
        "measured_on": machine.source.shaft,
        "tachometer": machine.source.tachometer,
        "nominal": int(phase.nominal),
        "stripe_positions_rev": machine.source.phase.stripe_positions_rev,
    }
    declared = machine.source.declared
    if declared is not None and declared.refined:
        attrs["declared_hz"] = declared.declared_hz * machine.mean_speed_hz / declared.speed_hz  # of the reference
    if found is not None:
        attrs |= {
            "estimated_from": found.channel,
            "status": found.speed.status,
            "confidence": found.confidence,
            "phase_std_rev": found.speed.phase_std_rev,
        }
    return xr.Dataset(
        {"speed_hz": ("revolution", speed, {"units": "rev s-1", "long_name": "mean over each revolution"})},
        coords={"time_s": ("revolution", phase.times_at(midpoints), {"units": "s"})},
        attrs=attrs,
    )


def _spectra(channels: Sequence[AnalysedChannel], name: str, assessed: Sequence[AssessedLine]) -> xr.Dataset:
    spectra = [(channel.name, channel.units, channel.spectra[name]) for channel in channels if name in channel.spectra]
    bands = {channel.name: channel.band for channel in channels if channel.band is not None}
    lines = [line for line in assessed if line.measured.expected.spectrum == name]
    return spectrum_dataset(spectra, lines, bands=bands if name == ENVELOPE else None)


def _tracks_dataset(
    record: xr.Dataset,
    channels: Sequence[AnalysedChannel],
    machine: Machine,
    assessed: Sequence[AssessedLine],
    settings: AnalysisSettings,
) -> xr.Dataset:
    """Return the amplitude tracks of the strongest significant lines of every channel."""
    tracks = []
    for channel in channels:
        own = [line for line in assessed if line.measured.channel == channel.name]
        lines = lines_to_track(own, most=settings.most_tracks)
        if lines:
            bandwidth = settings.track_bandwidth_orders
            tracks.append(track_lines(record, channel, machine, lines, bandwidth_orders=bandwidth))
    if not tracks:
        return xr.Dataset()
    # channels of other rates may end a revolution earlier
    shared = min(track.sizes["output"] for track in tracks)
    tracks = [track.isel(output=slice(shared)) for track in tracks]
    return xr.concat(tracks, dim="track", data_vars="minimal", coords="minimal", compat="override", join="override")


def _envelope_tracks(
    record: xr.Dataset,
    channels: Sequence[AnalysedChannel],
    teeth: Mapping[str, Mapping[str, ToothEnvelope]],
    machine: Machine,
    found: Sequence[Finding],
    settings: AnalysisSettings,
) -> xr.Dataset:
    """Return the amplitude tracks of the lines of named bearings and gears in the envelopes that show them."""
    by_name, lines = {channel.name: channel for channel in channels}, []
    for one in found[: settings.most_tracks]:
        channel = by_name[one.channel]
        if one.kind in BEARING_KINDS:
            part = next(part for part in channel.evidence if (part.component, part.kind) == (one.component, one.kind))
            lines.append(bearing_line(record, channel, machine, part, slip=settings.slip))
        elif one.kind == "tooth":
            lines.append(tooth_line(channel, machine, one.component, teeth[one.channel][one.component]))
    return track_envelope_lines(lines, machine, bandwidth_orders=settings.track_bandwidth_orders)
