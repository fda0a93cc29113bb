"""Analysis of one record: from record, gearbox and settings to spectra, lines, tracks, indicators and findings.

An analysis is an `xarray.DataTree` with the groups `/speed`, `/health`, `/order_spectrum`, `/envelope`, `/tracks`,
`/indicators` and `/findings` (see `hums.layout`); reports and scores are made from it alone.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from hums.baseline import HISTORIES, baseline_of
from hums.channels import AnalysedChannel, analysed_channel, chosen_channels, living_values, unfit_channels
from hums.findings import Finding, findings
from hums.gearbox import Gearbox
from hums.indicators import channel_indicators, localities
from hums.judging import Judge, JudgedLine
from hums.layout import (
    SCHEMA,
    Analysis,
    AnalysisError,
    IndicatorValue,
    Verdict,
    check_analysis,
    rows_dataset,
    spectrum_dataset,
)
from hums.machine import Machine, machine_of
from hums.notes import notes
from hums.record import channel_values, check_record
from hums.search import ENVELOPE, ORDER_SPECTRUM, SearchPlan, wanted_lines
from hums.settings import AnalysisSettings
from hums.tracking import track_lines, tracked_lines
from signals.health import SensorHealth

__all__ = ["AnalysisSettings", "analyze"]


def analyze(
    record: xr.Dataset,
    gearbox: Gearbox,
    *,
    settings: AnalysisSettings | None = None,
    baseline: Analysis | None = None,
) -> Analysis:
    """Return spectra, lines, amplitude tracks, condition indicators and findings of a record.

    Parameters
    ----------
    record : xarray.Dataset
        Vibration channels and tachometer, from `hums.open_record` or `hums.make_record`.
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
        Groups ``/speed``, ``/health``, ``/order_spectrum``, ``/envelope``, ``/tracks``, ``/indicators`` and
        ``/findings``; `line_table`, `findings_table`, `indicator_table`, `health_table` and `summary` read them.

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
    settings = settings or AnalysisSettings()
    if not isinstance(settings, AnalysisSettings):
        raise AnalysisError(f"settings is a {type(settings).__name__}; pass hums.AnalysisSettings(...).")
    check_record(record)
    chosen = chosen_channels(record, settings)
    gapped, dead = unfit_channels(record, chosen)
    names = [name for name in chosen if name not in gapped and name not in dead]
    past = baseline_of(baseline, settings, units={name: record[name].attrs["units"] for name in names})
    machine = machine_of(record, gearbox, settings.model_copy(update={"channels": tuple(names)}))
    wanted = wanted_lines(machine.kinematics, _plan(machine, settings))
    channels: list[AnalysedChannel] = []
    indicators: list[IndicatorValue] = []
    for name in names:
        values = living_values(record, name)
        channel = analysed_channel(record, name, values, machine, wanted, settings)
        channels.append(channel)
        indicators += channel_indicators(record, channel, values, machine, settings, past)
    judge = Judge(
        {bearing.name: bearing for bearing in machine.bearings},
        settings.false_alarm_probability,
        _natural_spacings(machine),
    )
    judged = judge.judge([line for channel in channels for line in channel.lines])
    found = findings(
        judged,
        locality=localities(indicators, _loudest(judged), harmonics=settings.harmonics),
        sick=[channel.name for channel in channels if channel.sick],
    )
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(
                attrs=_root_attrs(
                    record, gearbox, machine, settings, channels, [*_about_dead(dead), *_about_gaps(gapped)]
                )
            ),
            "/speed": _speed_dataset(machine),
            "/health": rows_dataset(
                [*_gap_verdicts(record, gapped), *_verdicts(channels, dead, machine)], Verdict, dim="item"
            ),
            f"/{ORDER_SPECTRUM}": _spectra(channels, ORDER_SPECTRUM, judged),
            f"/{ENVELOPE}": _spectra(channels, ENVELOPE, judged),
            "/tracks": _tracks_dataset(record, channels, machine, judged, settings),
            "/indicators": rows_dataset(indicators, IndicatorValue, dim="row").assign_attrs(
                {HISTORIES: past.to_json()}
            ),
            "/findings": rows_dataset(found, Finding, dim="finding"),
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


def _natural_spacings(machine: Machine) -> dict[str, tuple[float, ...]]:
    """Return the sideband spacings of a healthy planetary stage at a sensor on the frame, by gear, in orders."""
    passing = tuple(row.order for row in machine.rows if row.kind == "planet_pass")
    turns = {row.component: row.order for row in machine.rows if row.kind == "shaft"}
    frame = machine.kinematics.gearbox.frame
    return {
        row.component: (*passing, *([turns[row.seen_from]] if row.seen_from in turns else []))
        for row in machine.rows
        if row.kind == "tooth" and row.seen_from != frame
    }


def _loudest(judged: Sequence[JudgedLine]) -> dict[str, str]:
    """Return the channel with the highest signal-to-noise ratio of significant sidebands, by gear."""
    best: dict[str, JudgedLine] = {}
    for line in judged:
        if line.claimed and line.found.wanted.kind == "tooth" and line.found.wanted.sideband:
            name = line.found.wanted.component
            if name not in best or line.found.line.snr > best[name].found.line.snr:
                best[name] = line
    return {name: line.found.channel for name, line in best.items()}


def _verdicts(channels: Sequence[AnalysedChannel], dead: Mapping[str, SensorHealth], machine: Machine) -> list[Verdict]:
    """Return the condition of every sensor, the tachometer last."""
    judged = {channel.name: channel.health for channel in channels if channel.health is not None}
    rows = [
        Verdict(
            name=name,
            sensor="vibration",
            status=health.status,
            reasons=" ".join(reason[0].upper() + reason[1:] for reason in health.reasons),
            missing=float(health.missing.mean()),
            not_judged="; ".join(health.not_judged),
        )
        for name, health in (*judged.items(), *dead.items())
    ]
    if machine.source.tachometer:
        status, reasons = machine.tachometer_verdict
        rows.append(
            Verdict(name=machine.source.tachometer, sensor="tachometer", status=status, reasons=" ".join(reasons))
        )
    return rows


def _root_attrs(
    record: xr.Dataset,
    gearbox: Gearbox,
    machine: Machine,
    settings: AnalysisSettings,
    channels: Sequence[AnalysedChannel],
    left_out: Sequence[str],
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "record": Path(str(record.encoding.get("source", ""))).name,
        "version": version("hums-toolkit"),
        "channels_json": json.dumps(
            [
                {"name": c.name, "units": c.units, "rate_hz": c.rate_hz, "duration_s": c.duration_s}
                | {
                    key: str(record[c.name].attrs[key])
                    for key in ("sensor", "direction")
                    if key in record[c.name].attrs
                }
                for c in channels
            ]
        ),
        "machine": record.attrs.get("machine", ""),
        "recorded_at": record.attrs.get("recorded_at", ""),
        "gearbox": gearbox.name,
        "gearbox_json": gearbox.model_dump_json(exclude_none=True),
        "reference": machine.reference,
        "settings_json": settings.model_dump_json(),
        "notes_json": json.dumps([*notes(machine, settings, channels), *left_out]),
    }


def _about_dead(dead: Collection[str]) -> list[str]:
    return [f'Channel "{name}" is dead and left out: it has the same value throughout.' for name in dead]


def _about_gaps(gapped: Mapping[str, str]) -> list[str]:
    return [f'Channel "{name}" is left out: it has {gaps}.' for name, gaps in gapped.items()]


def _gap_verdicts(record: xr.Dataset, gapped: Mapping[str, str]) -> list[Verdict]:
    """Return the condition of the channels that are excluded because samples are missing."""
    return [
        Verdict(
            name=name,
            sensor="vibration",
            status="sick",
            reasons=f"It drops out: it has {gaps}.",
            missing=float(np.mean(~np.isfinite(channel_values(record, name)))),
        )
        for name, gaps in gapped.items()
    ]


def _speed_dataset(machine: Machine) -> xr.Dataset:
    phase, found = machine.phase, machine.source.estimated
    speed = phase.mean_speed_per_revolution_hz()
    middle = float(phase.revolutions[0]) + 0.5 + np.arange(speed.size)
    attrs = {
        "shaft": machine.reference,
        "measured_on": machine.source.shaft,
        "tachometer": machine.source.tachometer,
        "nominal": int(phase.nominal),
        "stripe_positions_rev": machine.source.phase.stripe_positions_rev,
    }
    if found is not None:
        attrs |= {
            "estimated_from": found.channel,
            "status": found.speed.status,
            "confidence": found.confidence,
            "phase_std_rev": found.speed.phase_std_rev,
        }
    return xr.Dataset(
        {"speed_hz": ("revolution", speed, {"units": "rev s-1", "long_name": "mean over each revolution"})},
        coords={"time_s": ("revolution", phase.times_at(middle), {"units": "s"})},
        attrs=attrs,
    )


def _spectra(channels: Sequence[AnalysedChannel], name: str, judged: Sequence[JudgedLine]) -> xr.Dataset:
    there = [(channel.name, channel.units, channel.spectra[name]) for channel in channels if name in channel.spectra]
    bands = {channel.name: channel.band for channel in channels if channel.band is not None}
    lines = [line for line in judged if line.found.wanted.spectrum == name]
    return spectrum_dataset(there, lines, bands=bands if name == ENVELOPE else None)


def _tracks_dataset(
    record: xr.Dataset,
    channels: Sequence[AnalysedChannel],
    machine: Machine,
    judged: Sequence[JudgedLine],
    settings: AnalysisSettings,
) -> xr.Dataset:
    tracks = []
    for channel in channels:
        mine = [line for line in judged if line.found.channel == channel.name]
        lines = tracked_lines(mine, most=settings.most_tracks)
        if lines:
            bandwidth = settings.track_bandwidth_orders
            tracks.append(track_lines(record, channel, machine, lines, bandwidth_orders=bandwidth))
    if not tracks:
        return xr.Dataset()
    # channels at other rates may end a revolution sooner; what they share is kept
    shared = min(track.sizes["output"] for track in tracks)
    alike = [track.isel(output=slice(shared)) for track in tracks]
    return xr.concat(alike, dim="track", data_vars="minimal", coords="minimal", compat="override", join="override")
