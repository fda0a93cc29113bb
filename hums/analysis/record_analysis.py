"""Analysis of one record: from record, gearbox and settings to spectra, lines, tracks, indicators and findings.

An analysis is an `xarray.DataTree` with the groups `/speed`, `/health`, `/order_spectrum`, `/envelope`, `/tracks`,
`/envelope_tracks`, `/indicators` and `/findings` (see `hums.analysis.result`), the evidence of verdicts
(`hums.analysis.verdicts`), and the data of plots (`hums.analysis.pictures`); reports and scores use nothing else.
"""

import json
import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from os import PathLike

import numpy as np
import xarray as xr

from hums.analysis.averages import average_channel, average_segments, no_speed, parts_of_average
from hums.analysis.channel import (
    AnalysedChannel,
    analyse_channel,
    drawn_by,
    read_anew,
    setting_of,
)
from hums.analysis.declaration import Declaration, judged_declaration
from hums.analysis.evidence import AssessedLine, assessed_lines
from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM, SearchPlan, expected_lines
from hums.analysis.findings import Finding, findings
from hums.analysis.indicators import HISTORIES, Baseline, read_baseline
from hums.analysis.pictures import channel_pictures, picture_groups
from hums.analysis.reference_angle import Machine
from hums.analysis.result import (
    Analysis,
    IndicatorValue,
    SensorCondition,
    check_analysis,
    confidence_words,
    root_attributes,
    rows_dataset,
    spectrum_dataset,
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
from hums.analysis.verdicts import CONTRADICTION, DOUBT, EXPLAINED, MISDRAWN, UNSURE, evidence_groups, verdicts_from
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.gearbox.model import Gearbox
from hums.records.channels import is_average
from hums.records.store import open_record
from hums.records.validation import check_record
from signals._validation import checked

__all__ = ["AnalysisSettings", "analyze"]

_log = logging.getLogger("hums")
_MOST_OF = 0.9  # of a record, below which the analysed part has a note
_SPIKE = 100.0  # crest factor; Gaussian noise of a million samples reaches 5, bearing impacts some 30


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
        Vibration channels and tachometer, from `hums.open_record` or `hums.make_record`; or the path of a record. For
        an average in angle (`hums.AngularAverage`) only the applicable indicators are computed, and nothing is judged.
        Snapshots (`hums.join_snapshots`) are segments: their spectra are power-averaged, and judged once.
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
        Groups ``/speed``, ``/health``, ``/order_spectrum``, ``/envelope``, ``/tracks``, ``/envelope_tracks`` (envelope
        lines of components with a finding), ``/indicators`` and ``/findings``; `line_table`, `findings_table`,
        `verdict_table`, `indicator_table`, `health_table` and `summary` read them.

    Raises
    ------
    AnalysisError
        If a channel or shaft does not exist, no channel varies between gaps, the speed cannot be estimated, or
        the record is shorter than one revolution of the reference.

    Notes
    -----
    A record is analysed in segments (`hums.analysis.segments`): one of more than 4,000,000 samples per channel is cut
    into equal parts, and a gap ends a segment. Spectra are averaged in power, and lines and components are judged once;
    indicators and gears are those of the median segment, weighted by revolutions (`hums.analysis.channel`).

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
    histories, channels = _analysed(there, settings, baseline, record=record)
    declaration = Declaration() if average else _declaration(channels, there.machine, settings)
    if declaration.speed_ratio != 1:
        record = record.assign(
            nominal_speed=record["nominal_speed"].copy(data=record["nominal_speed"] * declaration.speed_ratio)
        )
        there = segmented(record, gearbox, settings)
        histories, channels = _analysed(there, settings, baseline, record=record)
        declaration = replace(_declaration(channels, there.machine, settings), note=declaration.note)
    machine = there.machine
    assessed = assessed_lines(
        [line for channel in channels for line in channel.lines],
        [part for channel in channels for part in channel.evidence],
        false_alarm_probability=settings.false_alarm_probability,
        healthy_spacings=_healthy_spacings(machine),
    )
    if not (declaration.contradiction or declaration.explained):
        spectra = [channel.spectra[ORDER_SPECTRUM] for channel in channels if not (channel.faulty or average)]
        unlike = unlike_drawing(spectra, drawn_by(machine, settings), setting_of(machine))
        declaration = replace(declaration, contradiction=unlike)
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
    caveats = _notes(there, settings, channels, declaration)
    indicators = [row for channel in channels for row in channel.indicators]
    groups = {
        "/": xr.Dataset(
            attrs=root_attributes(record, gearbox, machine.reference, settings, channels=described, notes=caveats)
            | {CONTRADICTION: declaration.contradiction, DOUBT: declaration.doubt}
            | {EXPLAINED: int(declaration.explained)}
            | {UNSURE: json.dumps(dict.fromkeys(declaration.unsure, declaration.unseen))}
            | {MISDRAWN: json.dumps(declaration.misdrawn)}
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
    motion = groups["/speed"]
    for one in filter(len, (tracks, envelope_tracks)):
        speed = np.interp(one["time_s"], motion["time_s"], motion["speed_hz"])
        one.coords["speed_hz"] = ("output", speed, {"units": "rev s-1"})
    tree = xr.DataTree.from_dict(
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


def _analysed(
    there: SegmentedRecord, settings: AnalysisSettings, baseline: Analysis | None, *, record: xr.Dataset
) -> tuple[Baseline, list[AnalysedChannel]]:
    """Return the analysis of every channel that has segments, and the updated histories."""
    usable = {name: one for name, one in there.channels.items() if one.segments}
    units = {name: one.segments[0].units for name, one in usable.items()}
    of = {"gearbox": there.machine.kinematics.gearbox.name, "machine": str(record.attrs.get("machine", ""))}
    histories = read_baseline(
        baseline, settings, units=units, of=of, recorded_at=str(record.attrs.get("recorded_at", ""))
    )
    expected = expected_lines(there.machine.kinematics, _plan(there.machine, settings))
    channels: list[AnalysedChannel] = []
    for number, (name, channel) in enumerate(usable.items(), start=1):
        _log.info("channel %s, %d of %d", name, number, len(usable))
        if is_average(record):
            channels.append(average_channel(channel, settings, histories))
        else:
            analysed = analyse_channel(
                channel, there.machine, expected, settings, histories, channels=len(usable), draw=channel_pictures
            )
            channels.append(analysed)
    return histories, channels


def _declaration(channels: Sequence[AnalysedChannel], machine: Machine, settings: AnalysisSettings) -> Declaration:
    if machine.source.contradiction:
        return Declaration(contradiction=machine.source.contradiction)
    sound = [one for one in channels if not one.faulty]
    spectra = [(one.spectra[ORDER_SPECTRUM], one.bands) for one in sound]
    damaged = [part.found for one in sound for part in one.evidence if part.shows]
    return judged_declaration(spectra, machine, slip=settings.slip, damaged=damaged)


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
        attrs["declared_hz"] = declared.declared_hz * machine.ratio  # of the reference
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
    """Return the amplitude tracks of the strongest identified lines of every channel, and of envelope lines.

    The samples of several segments are read again.
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


# ---- Caveats: limits of speed, bands, channels and spectra ----------------------------------------------------------


def _notes(
    record: SegmentedRecord, settings: AnalysisSettings, channels: Sequence[AnalysedChannel], declaration: Declaration
) -> list[str]:
    """Return the caveats, those on speed and tachometer first."""
    machine = record.machine
    left_out = [f"Left out: {one.why}" for one in record.channels.values() if not one.segments]
    if not record.machines:  # an average in angle has no speed
        return [*record.left_out, *left_out]
    return [
        *(
            one[0].upper() + one[1:] + "."
            for one in (
                declaration.contradiction,
                declaration.doubt,
                declaration.unseen,
                *set(declaration.misdrawn.values()),
            )
            if one
        ),
        *([declaration.note] if declaration.note else []),
        *_speed_notes(machine, settings),
        *machine.tachometer_condition[1],
        *_band_notes(machine, settings),
        *_jitter_notes(machine, channels),
        *_said_of({channel.name: _channel_notes(channel, machine, settings) for channel in channels}),
        *dict.fromkeys(note for channel in channels for note in _pooled_notes(channel)),
        *record.left_out,
        *(f"A segment is left out: {why}" for channel in channels for why in channel.failed),
        *left_out,
    ]


def _pooled_notes(channel: AnalysedChannel) -> Iterator[str]:
    """Yield a note on the segments that are averaged."""
    if len(channel.segments) == 1:
        return
    spectrum = channel.spectra[ORDER_SPECTRUM]
    snapshots = channel.segments[0].parts_per_turn > 1
    pieces = "snapshots" if snapshots else "segments"
    yield (
        f"{len(channel.segments)} {pieces} were analysed together: spectra are averages of power over "
        f"{channel.blocks} blocks of {1 / spectrum.bin_width:.4g} revolutions. Lines closer to each other than "
        f"{spectrum.resolution:.2g} orders are not resolved, whatever the number of {pieces}; probabilities are those "
        "of continuous records, which pooled noise does not exceed."
        + ("" if snapshots else " Indicators and gears are those of the median segment; plots show the first.")
    )


def _speed_notes(machine: Machine, settings: AnalysisSettings) -> Iterator[str]:
    shaft, found = machine.source.shaft, machine.source.estimated
    if settings.speed_range_hz is not None and found is None:
        known = f'tachometer "{machine.source.tachometer}"' if machine.source.tachometer else "a declared speed"
        yield (
            f"The record has {known}, which defines the angle: the range and acceleration for estimating the speed "
            "(speed_range_hz, --speed-range; max_acceleration_hz_s, --max-acceleration) were not used."
        )
    declared = machine.source.declared
    if declared is not None and declared.refined:
        lines = ", ".join(f"{order:.4g}" for order in declared.orders[:6])
        yield (
            f"The declared speed of {shaft} was refined from {declared.declared_hz:.5g} to {declared.speed_hz:.5g} Hz "
            f"from the lines at orders {lines} of this shaft."
        )
    if machine.phase.nominal:
        known = "refined" if declared is not None and declared.refined else "declared"
        yield (
            f"The speed is nominal: {known} for {shaft}, not measured. Lines are searched within "
            f"{settings.nominal_speed_tolerance:.1%} of their nominal order"
            + (
                "; changes of speed were tracked by the lines of shafts and meshes."
                if machine.source.followed
                else " and smear if the speed changed."
            )
        )
    if found is not None:
        yield (
            f'The speed is estimated from the vibration of channel "{found.channel}", without a tachometer: mean '
            f"confidence {confidence_words(found.confidence)}. It assumes that the orders of the gearbox are right."
        )


def _band_notes(machine: Machine, settings: AnalysisSettings) -> Iterator[str]:
    if settings.envelope_band_hz is None and machine.bearings:
        yield (
            "No envelope band was given, so bearing lines were not searched. Choose a band with a resonance that the "
            "bearing excites (envelope_band_hz, on the command line --envelope-band LOW HIGH)."
        )


def _jitter_notes(machine: Machine, channels: Sequence[AnalysedChannel]) -> Iterator[str]:
    blurred = machine.jitter_limit_order
    jitter = f"The tachometer's pulses jitter by {machine.jitter_s * 1e6:.3g} us"
    if of_pulses := sum(channel.of_pulses for channel in channels):
        jitter += (
            f", as with a coarse sampling clock: {of_pulses} otherwise unexplained lines are sidebands of larger ones "
            "that this causes"
        )
    if not any(blurred < channel.spectra[ORDER_SPECTRUM].axis[-1] for channel in channels):
        yield from [f"{jitter}."] if of_pulses else []
    elif machine.source.tachometer:
        yield f"{jitter}; lines above {blurred:.3g} orders are smeared and underestimated."
    elif machine.source.estimated is not None:
        yield (
            f"The angle estimated from the vibration is uncertain by about {machine.jitter_s * 1e6:.3g} us: "
            f"lines above {blurred:.3g} orders are smeared and underestimated."
        )


def _said_of(notes: dict[str, Iterator[str]]) -> Iterator[str]:
    """Yield each note once, after the names of the channels that it holds for."""
    names: dict[str, list[str]] = {}
    for channel, said in notes.items():
        for note in said:
            names.setdefault(note, []).append(f'"{channel}"')
    yield from (f"Channel{'s' if len(them) > 1 else ''} {', '.join(them)}: {note}" for note, them in names.items())


def _channel_notes(channel: AnalysedChannel, machine: Machine, settings: AnalysisSettings) -> Iterator[str]:
    if channel.faulty:
        yield "faulty (see sensor health); no damage is diagnosed from it, and only its raw RMS is stated."
    analysed = f"{channel.analysed_s:.3g} of {channel.duration_s:.3g} s are analysed"
    if channel.left_out:
        yield f"{channel.left_out}; {analysed}, whole revolutions in {len(channel.segments)} segments between gaps."
    elif channel.analysed_s < _MOST_OF * channel.duration_s:
        where = "the tachometer covers" if machine.source.tachometer else "the shaft's angle is known for"
        yield f"{analysed}, the whole revolutions that {where}; the rest is not analysed."
    if channel.undrawn:
        yield f"{channel.undrawn}."
    if isinstance(settings.envelope_band_hz, tuple):
        low, high = settings.envelope_band_hz
        yield f"bearings were inspected from {low:g} to {high:g} Hz alone: damage that rings elsewhere is not seen."
    if channel.crest_factor > _SPIKE:
        yield (
            f"one sample reaches {channel.crest_factor:.0f} times the RMS, like an electrical spike, which may mask "
            "everything else."
        )
    if (end_hz := channel.segments[0].end_hz) < channel.rate_hz / 2:
        yield (
            f"the signal ends at {end_hz:.3g} Hz, as behind a low-pass filter, and so do the envelope bands: damage "
            "that rings above would not be seen."
        )
    stated, last = settings.max_order, float(channel.spectra[ORDER_SPECTRUM].axis[-1])
    if stated is not None and last + channel.spectra[ORDER_SPECTRUM].bin_width < stated:
        yield (
            f"the order spectrum ends at {last:.4g} orders, not at the {stated:g} asked for (max_order, --max-order): "
            f"at top speed, a sampling rate of {channel.rate_hz:g} Hz permits no higher order."
        )
    if channel.out_of_range:
        names = sorted({f"{w.component} {w.kind.replace('_', ' ')}" for w in channel.out_of_range})
        yield (
            f"{len(channel.out_of_range)} lines could not be assessed, being above the range of the sampling rate or "
            f"envelope band, or in too short a record: {', '.join(names)}."
        )
