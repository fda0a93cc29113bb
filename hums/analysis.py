"""The workflow: a record, a gearbox and settings become an analysis.

An analysis is an `xarray.DataTree` with the groups `/speed`, `/order_spectrum`, `/envelope`, `/tracks` and
`/findings` (see `hums.layout`); reports and scores are made from it alone.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from hums.declared import Declared, closest, sentences
from hums.findings import Judge, JudgedLine, Locality, findings
from hums.gearbox import Gearbox
from hums.kinematics import Kinematics, solve_kinematics
from hums.layout import SCHEMA, Analysis, AnalysisError, check_analysis, findings_dataset, spectrum_dataset
from hums.orders import BearingOrders, bearing_orders, defects
from hums.record import (
    channel_values,
    check_record,
    nominal_speed,
    sampling,
    tachometers,
    vibration_channels,
)
from hums.search import (
    ENVELOPE,
    ORDER_SPECTRUM,
    FoundLine,
    SearchPlan,
    Wanted,
    envelope_sidebands,
    search,
    wanted_lines,
)
from hums.tracking import track_lines, tracked_lines
from signals.averaging import synchronous_average
from signals.envelope import envelope
from signals.phase import ShaftPhase, constant_speed
from signals.resampling import PASSBAND, AngularSignal, angular_resample
from signals.residues import difference_signal
from signals.spectra import AmplitudeSpectrum, order_spectrum
from signals.tachometer import shaft_phase

_ENVELOPE_SHARE = 0.5
_LEAST_ORDERS = 20.0  # a spectrum shows at least this many
_BLUR_RAD = 0.3  # phase error that takes 4 % off a line
_MOST_OF = 0.9  # of a record: less than this analysed is worth a note
_SPIKE = 100.0  # crest factor; Gaussian noise of a million samples reaches 5, bearing impacts some 30
_MARGIN = 1.1  # of order beyond the last line looked for, plus one, so that its surroundings fit


class AnalysisSettings(Declared):
    """What an analyst decides; every default is written into the result.

    Attributes
    ----------
    channels : names of vibration channels; default all.
    envelope_band_hz : (low, high) of the band to demodulate. Without it no bearing line is searched.
    false_alarm_probability : chance that noise alone raises any finding in the whole record.
    harmonics : how many of each shaft, mesh and bearing rate are looked for.
    sidebands : how many on either side of each mesh harmonic.
    slip : how far a bearing line may lie from nominal, relative.
    nominal_speed_tolerance : how far any line may lie from nominal where the speed is declared, not measured.
    max_order : where the order spectrum ends; default a little above the last line looked for.
    track_bandwidth_orders : full -3 dB width of the amplitude trackers; default the most likely one of each line,
        at most 0.1 orders.
    most_tracks : how many lines of a channel are tracked, the strongest first; 0 for none.
    """

    channels: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    envelope_band_hz: tuple[float, float] | None = None
    false_alarm_probability: Annotated[float, Field(gt=0, lt=1)] = 0.01
    harmonics: Annotated[int, Field(ge=1, le=20)] = 3
    sidebands: Annotated[int, Field(ge=0, le=20)] = 3
    slip: Annotated[float, Field(gt=0, lt=0.2)] = 0.02
    nominal_speed_tolerance: Annotated[float, Field(ge=0, lt=0.2)] = 0.02
    max_order: Annotated[float, Field(gt=0)] | None = None
    track_bandwidth_orders: Annotated[float, Field(gt=0)] | None = None
    most_tracks: Annotated[int, Field(ge=0)] = 24

    def __init__(self, **values: Any) -> None:  # noqa: ANN401
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise AnalysisError(f"settings: {sentences(error)}") from None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.envelope_band_hz is not None and not 0 <= self.envelope_band_hz[0] < self.envelope_band_hz[1]:
            raise ValueError(f"envelope_band_hz = {self.envelope_band_hz} must rise from 0 or more; give (low, high)")
        return self


@dataclass(frozen=True, kw_only=True)
class _Machine:
    """What is known before any channel is read."""

    kinematics: Kinematics
    reference: str
    bearings: tuple[BearingOrders, ...]
    phase: ShaftPhase
    tachometer_shaft: str
    jitter_s: float

    @cached_property
    def top_speed_hz(self) -> float:
        """Highest mean speed of the reference over a revolution."""
        return float(self.phase.mean_speed_per_revolution_hz().max())


@dataclass(frozen=True, kw_only=True)
class _Channel:
    """One channel over angle: its spectra, the lines found in them, and what is out of reach."""

    name: str
    units: str
    signal: AngularSignal
    spectra: Mapping[str, AmplitudeSpectrum]
    lines: tuple[FoundLine, ...]
    beyond: tuple[Wanted, ...]
    duration_s: float
    rate_hz: float
    crest: float


def analyze(record: xr.Dataset, gearbox: Gearbox, *, settings: AnalysisSettings | None = None) -> Analysis:
    """Analyse a record: which component of the gearbox makes which line, how large, how sure.

    Parameters
    ----------
    record : xarray.Dataset
        From `hums.open_record` or `hums.make_record`.
    gearbox : Gearbox
        With one degree of freedom; the record's tachometer (or declared speed) is on one of its links.
    settings : AnalysisSettings, optional

    Returns
    -------
    xarray.DataTree
        Checked by `check_analysis`.

    Raises
    ------
    AnalysisError
        A channel that is not there, NaN in the signal, a shaft the gearbox does not have, a record shorter
        than one revolution: with the name, the value, and what to do.
    """
    settings = settings or AnalysisSettings()
    if not isinstance(settings, AnalysisSettings):
        raise AnalysisError(f"settings is a {type(settings).__name__}; pass hums.AnalysisSettings(...).")
    check_record(record)
    machine = _machine(record, gearbox)
    plan = SearchPlan(
        harmonics=settings.harmonics,
        sidebands=settings.sidebands,
        slip=settings.slip,
        speed_tolerance=settings.nominal_speed_tolerance if machine.phase.nominal else 0.0,
        envelope=settings.envelope_band_hz is not None,
    )
    wanted = wanted_lines(machine.kinematics, plan)
    channels = [_channel(record, name, machine, wanted, settings) for name in _chosen(record, settings)]
    judge = Judge(
        {bearing.name: bearing for bearing in machine.bearings},
        settings.false_alarm_probability,
        _natural_spacings(machine.kinematics),
    )
    judged = judge.judge([line for channel in channels for line in channel.lines])
    found = findings(judged, locality=_localities(record, machine, judged, settings))
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs=_root_attrs(record, gearbox, machine, settings, channels)),
            "/speed": _speed_dataset(machine),
            f"/{ORDER_SPECTRUM}": _spectra(channels, ORDER_SPECTRUM, judged),
            f"/{ENVELOPE}": _spectra(channels, ENVELOPE, judged),
            "/tracks": _tracks_dataset(channels, machine, judged, settings),
            "/findings": findings_dataset(found),
        }
    )
    check_analysis(tree)
    return tree


def _natural_spacings(kinematics: Kinematics) -> dict[str, tuple[float, ...]]:
    """Sideband spacings that a healthy planetary stage shows a sensor on the frame, by gear of its meshes."""
    rows = defects(kinematics)
    passing = tuple(row.order for row in rows if row.kind == "planet_pass")
    turns = {row.component: row.order for row in rows if row.kind == "shaft"}
    frame = kinematics.gearbox.frame
    return {
        row.component: (*passing, *([turns[row.seen_from]] if row.seen_from in turns else []))
        for row in rows
        if row.kind == "tooth" and row.seen_from != frame
    }


def _machine(record: xr.Dataset, gearbox: Gearbox) -> _Machine:
    if not isinstance(gearbox, Gearbox):
        raise AnalysisError(f"gearbox is a {type(gearbox).__name__}; load it first, as hums.load_gearbox(...) does.")
    kinematics = solve_kinematics(gearbox)
    if kinematics.dof != 1:
        raise AnalysisError(
            f'gearbox "{gearbox.name}" has {kinematics.dof} degrees of freedom; an analysis needs one, so that one '
            "tachometer tells every speed. Fix the other inputs, for example by making them rigid with the frame."
        )
    if gearbox.reference is None:
        raise AnalysisError(f'gearbox "{gearbox.name}" declares no reference shaft; add reference = "LINK".')
    shaft, phase = _tachometer_phase(record)
    if shaft not in kinematics.links:
        raise AnalysisError(
            f'the record\'s angle is of shaft "{shaft}", which gearbox "{gearbox.name}" does not have'
            f"{closest(shaft, list(kinematics.links))}"
        )
    turns = kinematics.rates({shaft: 1})
    ratio = sum(float(factor * turns[body]) for body, factor in kinematics.spin(gearbox.reference).items())
    if ratio == 0:
        raise AnalysisError(
            f'the shaft "{shaft}" turns, but the reference "{gearbox.reference}" does not; name another.'
        )
    jitter = 0.0 if math.isnan(phase.jitter_s) else phase.jitter_s
    phase = phase if abs(ratio) == 1 else phase.scaled(abs(ratio))
    turned = float(phase.revolutions[-1] - phase.revolutions[0])
    if turned < 1:
        raise AnalysisError(
            f'the record holds no whole revolution of the reference "{gearbox.reference}" ({turned:.3g} of one in '
            f"{phase.stop_s - phase.start_s:.3g} s); record longer, or choose a faster reference."
        )
    return _Machine(
        kinematics=kinematics,
        reference=gearbox.reference,
        bearings=bearing_orders(kinematics),
        phase=phase,
        tachometer_shaft=shaft,
        jitter_s=jitter,
    )


def _tachometer_phase(record: xr.Dataset) -> tuple[str, ShaftPhase]:
    """Phase of the shaft that the record knows, from its first tachometer or its declared speed."""
    names = tachometers(record)
    if names:
        pulses = record[names[0]]
        times = channel_values(record, names[0])
        try:
            return pulses.attrs["shaft"], shaft_phase(times, pulses_per_rev=int(pulses.attrs["pulses_per_rev"]))
        except ValueError as error:
            raise AnalysisError(f'tachometer "{names[0]}": {error}') from None
    declared = nominal_speed(record)
    if declared is None:  # check_record has refused this already
        raise AnalysisError("the record has no source of shaft angle.")
    when = sampling(record, vibration_channels(record)[0])
    stop = when.start_s + (when.count - 1) / when.rate_hz
    return declared.attrs["shaft"], constant_speed(float(declared), start_s=when.start_s, stop_s=stop)


def _chosen(record: xr.Dataset, settings: AnalysisSettings) -> tuple[str, ...]:
    there = vibration_channels(record)
    for name in settings.channels or ():
        if name not in there:
            raise AnalysisError(f'the record has no vibration channel "{name}"{closest(name, there)}')
    return tuple(there) if settings.channels is None else tuple(dict.fromkeys(settings.channels))


def _channel(
    record: xr.Dataset, name: str, machine: _Machine, wanted: Sequence[Wanted], settings: AnalysisSettings
) -> _Channel:
    values = _finite_values(record, name)
    crest = float(np.abs(values - values.mean()).max() / values.std())
    when = sampling(record, name)
    reach = PASSBAND / 2 * when.rate_hz / machine.top_speed_hz
    angular, spectra, lines, beyond = {}, {}, [], []
    for spectrum in (ORDER_SPECTRUM, ENVELOPE):
        mine = [line for line in wanted if line.spectrum == spectrum]
        if spectrum == ENVELOPE:
            if settings.envelope_band_hz is None:
                continue
            low, high = settings.envelope_band_hz
            values = _demodulated(values, when.rate_hz, (low, high), name)
            # the envelope of noise in a band of width B thins out towards B: up to half of it the floor is near level
            reach = _ENVELOPE_SHARE * (high - low) / machine.top_speed_hz
        last = _last_order(mine, settings.max_order if spectrum == ORDER_SPECTRUM else None, reach)
        signal = _over_angle(values, record, name, machine.phase, last)
        angular[spectrum] = signal
        spectra[spectrum] = order_spectrum(signal, max_order=last)
        units = record[name].attrs["units"]
        found, out_of_reach = search(spectra[spectrum], mine, channel=name, units=units)
        if spectrum == ENVELOPE:
            found += _with_sidebands(spectra[spectrum], found, machine.bearings)
        lines += found
        beyond += out_of_reach
    return _Channel(
        name=name,
        units=record[name].attrs["units"],
        signal=angular[ORDER_SPECTRUM],
        spectra=spectra,
        lines=tuple(lines),
        beyond=tuple(beyond),
        duration_s=when.count / when.rate_hz,
        rate_hz=when.rate_hz,
        crest=crest,
    )


def _finite_values(record: xr.Dataset, name: str) -> NDArray[np.float64]:
    values = np.asarray(channel_values(record, name), dtype=np.float64)
    if values.size and values.min() == values.max():
        raise AnalysisError(
            f'channel "{name}" has the same value {values[0]:g} throughout: a dead sensor or a wrong channel. Leave it '
            "out with channels=(...), on the command line --channel NAME."
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise AnalysisError(
            f'channel "{name}" has {bad.size} samples that are not finite, the first at index {bad[0]} '
            f"({sampling(record, name).start_s + bad[0] / sampling(record, name).rate_hz:g} s). Cut that part off with "
            "record.isel(time=slice(...)), or leave the channel out with channels=(...)."
        )
    return values


def _demodulated(
    values: NDArray[np.float64], rate_hz: float, band_hz: tuple[float, float], name: str
) -> NDArray[np.float64]:
    try:
        return envelope(values, rate_hz=rate_hz, band_hz=band_hz)
    except ValueError as error:
        raise AnalysisError(
            f'envelope of channel "{name}": {error} Or leave the channel out with channels=(...), on the command line '
            "--channel NAME."
        ) from None


def _last_order(wanted: Iterable[Wanted], stated: float | None, reach: float) -> float:
    """Where a spectrum ends: as stated, or far enough for every line looked for and its surroundings."""
    needed = _MARGIN * (max((line.order + line.tolerance for line in wanted), default=0.0) + 1.0)
    return min(stated or max(needed, _LEAST_ORDERS), reach)


def _over_angle(
    values: NDArray[np.float64], record: xr.Dataset, name: str, phase: ShaftPhase, last_order: float
) -> AngularSignal:
    when = sampling(record, name)
    try:
        return angular_resample(
            values,
            rate_hz=when.rate_hz,
            phase=phase,
            samples_per_rev=8 * math.ceil(last_order / (4 * PASSBAND)),
            start_s=when.start_s,
        )
    except ValueError as error:
        raise AnalysisError(f'channel "{name}": {error}') from None


def _with_sidebands(
    spectrum: AmplitudeSpectrum, lines: Sequence[FoundLine], bearings: Iterable[BearingOrders]
) -> list[FoundLine]:
    """Look beside every bearing fundamental for the sidebands its kind of defect makes."""
    by_name = {bearing.name: bearing for bearing in bearings}
    beside: list[FoundLine] = []
    for line in lines:
        if not line.wanted.fundamental:
            continue
        bearing = by_name[line.wanted.component]
        spacing = {
            "inner_race": bearing.inner_ring,
            "outer_race": bearing.outer_ring,
            "rolling_element": bearing.cage,
        }.get(line.wanted.kind, 0.0)
        spacings = dict.fromkeys(abs(x) for x in (spacing, bearing.carried) if x)
        wanted = envelope_sidebands(line, spacings)
        beside += search(spectrum, wanted, channel=line.channel, units=line.units)[0]
    return beside


def _localities(
    record: xr.Dataset, machine: _Machine, judged: Sequence[JudgedLine], settings: AnalysisSettings
) -> dict[str, Locality]:
    """Residual kurtosis of every gear that has a claimed sideband and turns about a fixed axis."""
    best: dict[str, JudgedLine] = {}
    for line in judged:
        if line.claimed and line.found.wanted.kind == "tooth":
            name = line.found.wanted.component
            if name not in best or line.found.line.snr > best[name].found.line.snr:
                best[name] = line
    gears = {
        f"{contact.mesh}/{link}": (link, abs(teeth))
        for contact in machine.kinematics.contacts
        for link, teeth in contact.gears
        if contact.carrier == machine.kinematics.bodies[machine.kinematics.gearbox.frame]
    }
    return {
        name: _locality(record, line.found.channel, machine, *gears[name], settings.harmonics)
        for name, line in best.items()
        if name in gears
    }


def _locality(record: xr.Dataset, channel: str, machine: _Machine, link: str, teeth: int, harmonics: int) -> Locality:
    """Kurtosis (FM4 of Stewart 1977) of the residual: without mesh harmonics, their first sidebands, and 1x, 2x."""
    ratio = abs(float(machine.kinematics.relative_speed(link, seen_from=machine.kinematics.gearbox.frame)))
    when = sampling(record, channel)
    phase = machine.phase.scaled(ratio)
    reach = PASSBAND / 2 * when.rate_hz / (machine.top_speed_hz * ratio)
    last = int(min((harmonics + 0.5) * teeth, reach))
    average = synchronous_average(_over_angle(_finite_values(record, channel), record, channel, phase, last))
    left = difference_signal(average, teeth=teeth, harmonics=harmonics, shaft_orders=(1, 2), max_order=last).values
    power = float(np.mean(left**2))
    kurtosis = float(np.mean(left**4)) / power**2 if power > 0 else 0.0
    # 2 last independent values a turn; kurtosis of n Gaussian values: 3 +- sqrt(24 / n), four times that allowed
    return Locality(kurtosis=kurtosis, limit=3 + 4 * math.sqrt(24 / (2 * last)))


def _root_attrs(
    record: xr.Dataset,
    gearbox: Gearbox,
    machine: _Machine,
    settings: AnalysisSettings,
    channels: Sequence[_Channel],
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
        "notes_json": json.dumps(_notes(machine, settings, channels)),
    }


def _notes(machine: _Machine, settings: AnalysisSettings, channels: Sequence[_Channel]) -> list[str]:
    """Say what a reader must know before believing the rest."""
    notes = []
    if machine.phase.nominal:
        notes.append(
            f"The speed is nominal: declared for {machine.tachometer_shaft}, not measured. Lines are searched within "
            f"{settings.nominal_speed_tolerance:.1%} of their nominal order and smear if the speed changed."
        )
    notes += _tachometer_notes(machine.phase)
    if settings.envelope_band_hz is None and machine.bearings:
        notes.append(
            "No envelope band was given, so no bearing line was searched. Choose a band with a resonance that the "
            "bearing excites (envelope_band_hz, on the command line --envelope-band LOW HIGH)."
        )
    blurred = _BLUR_RAD / (2 * math.pi * machine.jitter_s * _mean_speed_hz(machine)) if machine.jitter_s else math.inf
    if any(blurred < channel.spectra[ORDER_SPECTRUM].axis[-1] for channel in channels):
        notes.append(
            f"The tachometer's pulses jitter by {machine.jitter_s * 1e6:.3g} us: lines above {blurred:.3g} orders are "
            "blurred and read low."
        )
    for channel in channels:
        analysed = _analysed_s(channel, machine.phase)
        if analysed < _MOST_OF * channel.duration_s:
            notes.append(
                f'Channel "{channel.name}": {analysed:.3g} of {channel.duration_s:.3g} s are analysed, the whole '
                "revolutions that the tachometer covers; the rest says nothing here."
            )
        if channel.crest > _SPIKE:
            notes.append(
                f'Channel "{channel.name}": one sample stands {channel.crest:.0f} times above the RMS, as a spike of '
                "the electronics does; it can hide everything else."
            )
    for channel in channels:
        if channel.beyond:
            names = sorted({f"{w.component} {w.kind}" for w in channel.beyond})
            notes.append(
                f'Channel "{channel.name}": {len(channel.beyond)} lines are out of reach, above what the sampling rate '
                f"or the envelope's band carries or in too short a record to judge: {', '.join(names)}."
            )
    return notes


def _tachometer_notes(phase: ShaftPhase) -> list[str]:
    """Say what was wrong with the pulses."""
    notes = []
    repairs = phase.repairs
    if repairs.total:
        notes.append(
            f"The tachometer's pulses were repaired: {repairs.missing} were missing and counted, {repairs.double} "
            f"double and {repairs.spurious} spurious ones left out, of {phase.times_s.size} that remain."
        )
    if phase.direction_unknown:
        begin, end = phase.stops_s[0]
        notes.append(
            f"The shaft may have stopped ({len(phase.stops_s)} times, first from {begin:.4g} to {end:.4g} s), and the "
            "pulses do not tell which way it turned after: the angle is counted as if it went on."
        )
    return notes


def _mean_speed_hz(machine: _Machine) -> float:
    """Mean speed of the reference."""
    phase = machine.phase
    return float(phase.revolutions[-1] - phase.revolutions[0]) / (phase.stop_s - phase.start_s)


def _analysed_s(channel: _Channel, phase: ShaftPhase) -> float:
    """Time that the whole revolutions of a channel last."""
    signal = channel.signal
    ends = phase.times_at(np.array([signal.start_rev, signal.start_rev + signal.revolutions]))
    return float(ends[1] - ends[0])


def _speed_dataset(machine: _Machine) -> xr.Dataset:
    phase = machine.phase
    speed = phase.mean_speed_per_revolution_hz()
    middle = float(phase.revolutions[0]) + 0.5 + np.arange(speed.size)
    return xr.Dataset(
        {"speed_hz": ("revolution", speed, {"units": "rev s-1", "long_name": "mean over each revolution"})},
        coords={"time_s": ("revolution", phase.times_at(middle), {"units": "s"})},
        attrs={
            "shaft": machine.reference,
            "measured_on": machine.tachometer_shaft,
            "nominal": int(phase.nominal),
            "stripe_positions_rev": phase.stripe_positions_rev,
        },
    )


def _spectra(channels: Sequence[_Channel], name: str, judged: Sequence[JudgedLine]) -> xr.Dataset:
    there = [(channel.name, channel.units, channel.spectra[name]) for channel in channels if name in channel.spectra]
    return spectrum_dataset(there, [line for line in judged if line.found.wanted.spectrum == name])


def _tracks_dataset(
    channels: Sequence[_Channel], machine: _Machine, judged: Sequence[JudgedLine], settings: AnalysisSettings
) -> xr.Dataset:
    tracks = []
    for channel in channels:
        mine = [line for line in judged if line.found.channel == channel.name]
        lines = tracked_lines(mine, most=settings.most_tracks)
        if lines:
            spectrum, bandwidth = channel.spectra[ORDER_SPECTRUM], settings.track_bandwidth_orders
            tracks.append(track_lines(channel.signal, spectrum, machine.phase, lines, bandwidth_orders=bandwidth))
    if not tracks:
        return xr.Dataset()
    # channels at other rates may end a revolution sooner; what they share is kept
    shared = min(track.sizes["output"] for track in tracks)
    alike = [track.isel(output=slice(shared)) for track in tracks]
    return xr.concat(alike, dim="track", data_vars="minimal", coords="minimal", compat="override", join="override")
