"""Analysis of one record: from record, gearbox and settings to spectra, lines, tracks, indicators and findings.

An analysis is an `xarray.DataTree` with the groups `/speed`, `/health`, `/order_spectrum`, `/envelope`, `/tracks`,
`/envelope_tracks`, `/indicators` and `/findings` (see `hums.analysis.result`), what verdicts rest on
(`hums.analysis.verdicts`), and what pictures need (`hums.analysis.pictures`); reports and scores are made from it
alone.
"""

import logging
from collections.abc import Sequence
from os import PathLike

import numpy as np
import xarray as xr

from hums.analysis.averages import average_channel, average_segments, no_speed, parts_of_average
from hums.analysis.caveats import notes
from hums.analysis.channel import (
    AnalysedChannel,
    analyse_channel,
    drawn_by,
    read_anew,
    setting_of,
)
from hums.analysis.detection import AssessedLine, LineAssessor
from hums.analysis.findings import Finding, findings
from hums.analysis.indicators import HISTORIES, read_baseline
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM, SearchPlan, expected_lines
from hums.analysis.pictures import channel_pictures, picture_groups
from hums.analysis.reference_angle import Machine
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
from hums.analysis.segments import SegmentedRecord, segmented
from hums.analysis.settings import AnalysisSettings
from hums.analysis.tracks import (
    EnvelopeLine,
    bearing_line,
    joined_tracks,
    lines_to_track,
    output_step_rev,
    track_envelope_lines,
    track_lines,
)
from hums.analysis.unexplained import UnexplainedLine, not_named, unlike_drawing
from hums.analysis.verdicts import UNLIKE, evidence_groups, verdicts_from
from hums.gearbox.model import Gearbox
from hums.gearbox.orders import BEARING_KINDS
from hums.records.channels import is_average
from hums.records.record import check_record
from hums.records.store import open_record
from signals._validation import checked

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
        Snapshots (`hums.join_snapshots`) are segments: their spectra are averaged in power, and judged once.
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
    A record is analysed in segments (`hums.analysis.segments`): one of more than 4,000,000 samples a channel is cut
    into equal parts, and a gap ends a segment. Spectra are averaged by power, lines and parts judged once; of
    indicators and gears the median segment is taken, weighted by turns (`hums.analysis.channel`).

    Raises
    ------
    AnalysisError
        If a channel or shaft does not exist, no channel varies between gaps, the speed cannot be estimated, or
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
    average = str(record.attrs["average_of"]) if is_average(record) else ""
    there = (average_segments if average else segmented)(record, gearbox, settings)
    usable = {name: one for name, one in there.channels.items() if one.segments}
    units = {name: one.segments[0].units for name, one in usable.items()}
    histories, machine = read_baseline(baseline, settings, units=units), there.machine
    expected = expected_lines(machine.kinematics, _plan(machine, settings))
    channels: list[AnalysedChannel] = []
    for number, (name, channel) in enumerate(usable.items(), start=1):
        _log.info("channel %s, %d of %d", name, number, len(usable))
        if average:
            channels.append(average_channel(channel, settings, histories))
        else:
            analysed = analyse_channel(
                channel, machine, expected, settings, histories, channels=len(usable), draw=channel_pictures
            )
            channels.append(analysed)
    assessor = LineAssessor(
        {bearing.name: bearing for bearing in machine.bearings},
        settings.false_alarm_probability,
        _healthy_spacings(machine),
    )
    assessed = assessor.assess([line for channel in channels for line in channel.lines])
    unlike = machine.source.contradiction or unlike_drawing(
        [channel.spectra[ORDER_SPECTRUM] for channel in channels if not (channel.faulty or average)],
        drawn_by(machine, settings),
        setting_of(machine),
    )
    described = [
        {"name": one.name, "units": one.units}
        | (
            {"revolutions": one.revolutions, "samples_per_rev": int(record.attrs["samples_per_rev"])}
            if average
            else {"rate_hz": one.rate_hz, "duration_s": one.duration_s}
        )
        | {key: str(record[one.name].attrs[key]) for key in ("sensor", "direction") if key in record[one.name].attrs}
        for one in channels
    ]
    caveats = notes(there, settings, channels, unlike)
    indicators = [row for channel in channels for row in channel.indicators]
    groups = {
        "/": xr.Dataset(
            attrs=root_attributes(record, gearbox, machine.reference, settings, channels=described, notes=caveats)
            | {UNLIKE: unlike}
        ),
        "/speed": no_speed(machine) if average else _speeds(there),
        "/health": rows_dataset(_sensor_conditions(there, channels), SensorCondition, dim="item"),
        f"/{ORDER_SPECTRUM}": _spectra(channels, ORDER_SPECTRUM, assessed),
        f"/{ENVELOPE}": _spectra(channels, ENVELOPE, assessed),
        "/indicators": rows_dataset(indicators, IndicatorValue, dim="row").assign_attrs(
            {HISTORIES: histories.to_json()}
        ),
    } | evidence_groups(channels, machine, settings, baseline, parts_of_average(machine, average) if average else None)
    pictures = [channel.pictures for channel in channels if channel.pictures is not None]
    groups |= picture_groups(pictures) if pictures else {}
    judged = verdicts_from(groups, groups["/"].attrs)
    found = findings(judged)
    left = not_named(
        [line for channel in channels for line in channel.unexplained],
        [one.order_found for one in found if one.kind in BEARING_KINDS],
        bin_width=groups[f"/{ORDER_SPECTRUM}"].attrs["bin_width_orders"],
    )
    _log.info("amplitude tracks")
    tracks, envelope_tracks = _tracks(channels, there, assessed, found, settings)
    tree = tree_of(
        groups
        | {
            "/findings": rows_dataset(found, Finding, dim="finding"),
            "/verdicts": rows_dataset([one for one in judged if one not in found], Finding, dim="part"),
            "/unexplained": rows_dataset(left, UnexplainedLine, dim="line"),
            "/tracks": tracks,
            "/envelope_tracks": envelope_tracks,
        }
    )
    check_analysis(tree)
    return tree


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


def _sensor_conditions(there: SegmentedRecord, channels: Sequence[AnalysedChannel]) -> list[SensorCondition]:
    """Return the condition of every sensor that was checked, the tachometer last."""
    known = {name: one.condition for name, one in there.channels.items() if not one.segments}
    known |= {channel.name: channel.condition for channel in channels}
    rows = [row for name in there.channels if (row := known[name]) is not None]
    tachometer = there.machine.source.tachometer
    if tachometer:
        status, reasons = there.machine.tachometer_condition
        rows.append(SensorCondition(name=tachometer, sensor="tachometer", status=status, reasons=" ".join(reasons)))
    return rows


def _speeds(there: SegmentedRecord) -> xr.Dataset:
    """Return the mean speed of the reference over each revolution of all parts, with the worst doubt of any."""
    speeds = [
        one.assign_coords(time_s=one["time_s"] + there.starts_s[part]) if there.starts_s[part] else one
        for part, one in ((part, _speed_dataset(machine)) for part, machine in there.machines.items())
    ]
    if len(speeds) == 1:
        return speeds[0]
    whole = xr.concat(speeds, dim="revolution", combine_attrs="override")
    for name, worst in (("confidence", min), ("phase_std_rev", max)):
        if name in whole.attrs:
            whole.attrs[name] = worst(one.attrs[name] for one in speeds)
    return whole


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


def _tracks(
    channels: Sequence[AnalysedChannel],
    there: SegmentedRecord,
    assessed: Sequence[AssessedLine],
    found: Sequence[Finding],
    settings: AnalysisSettings,
) -> tuple[xr.Dataset, xr.Dataset]:
    """Return the amplitude tracks of the strongest significant lines of every channel, and of named parts in envelopes.

    Of several segments the samples are read once more.
    """
    turns: dict[int, float] = {}
    for segment in (segment for channel in channels for segment in channel.segments):
        turns[segment.part] = max(segment.turns, turns.get(segment.part, 0.0))
    origins: dict[int, float] = {}
    tables: list[tuple[int, xr.Dataset]] = []
    envelopes: dict[int, dict[int, list[EnvelopeLine]]] = {}
    named = list(enumerate(found[: settings.most_tracks]))
    for channel in channels:
        lines = lines_to_track(
            [line for line in assessed if line.measured.channel == channel.name], most=settings.most_tracks
        )
        own = [(rank, one) for rank, one in named if one.channel == channel.name]
        parts = {(part.component, part.kind): part for part in channel.evidence}
        if not (lines or own) or channel.segments[0].parts_per_turn > 1:
            continue
        for number, segment in enumerate(read_anew(channel.segments)):
            if lines:
                origin = origins.setdefault(segment.part, segment.signal.start_rev)
                table = track_lines(
                    segment,
                    channel.spectra[ORDER_SPECTRUM],
                    lines,
                    noise_left=channel.noise_left,
                    bandwidth_orders=settings.track_bandwidth_orders,
                    step_rev=output_step_rev(turns[segment.part]),
                    origin_rev=origin,
                )
                tables.append((segment.part, table))
            for rank, one in own:
                into = envelopes.setdefault(segment.part, {}).setdefault(rank, [])
                if one.kind in BEARING_KINDS:
                    into.append(bearing_line(segment, parts[one.component, one.kind], slip=settings.slip))
                elif one.component in channel.teeth[number]:
                    into.append(channel.teeth[number][one.component])
    of_envelopes = [
        (
            part,
            track_envelope_lines(
                [line for rank in sorted(by_rank) for line in by_rank[rank]],
                there.machines.get(part, there.machine),
                bandwidth_orders=settings.track_bandwidth_orders,
            ),
        )
        for part, by_rank in sorted(envelopes.items())
        if any(by_rank.values())
    ]
    return joined_tracks(tables), joined_tracks(of_envelopes)
