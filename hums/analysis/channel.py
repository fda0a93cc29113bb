"""Analysis of one channel: sensor health, angle-domain signal, order and envelope spectrum, measured lines."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.analysis.detection import LineAssessor
from hums.analysis.evidence import BandEvidence, PartEvidence, Setting, bearing_evidence
from hums.analysis.lines import (
    ENVELOPE,
    ORDER_SPECTRUM,
    ExpectedLine,
    MeasuredLine,
    envelope_sidebands,
    narrowed,
    search,
)
from hums.analysis.reference_angle import Machine
from hums.analysis.result import EnvelopeBand
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.thresholds import IN_TIME, MESH_SHARE, PEAK_RATIO
from hums.analysis.unexplained import Drawn, UnexplainedLine, drawn_orders, unexplained_lines
from hums.gearbox.bearing_orders import BearingOrders
from hums.gearbox.components import closest
from hums.gearbox.orders import BEARING_KINDS
from hums.records.record import Sampling, channel_values, sampling, vibration_channels
from signals._fft_plans import transform_of
from signals.angle.averaging import SynchronousAverage
from signals.demodulation.envelope_bank import bank_bands, bank_envelopes, level_normalised
from signals.demodulation.time_or_angle import FEWEST_SAMPLES, power_in_time_and_angle
from signals.health import SensorHealth, sensor_health
from signals.resampling.resampling import PASSBAND, AngularSignal, angular_resample_all
from signals.shaft.phase import ShaftPhase
from signals.spectra.lines import SURROUNDINGS, has_background
from signals.spectra.peaks import spectral_peaks
from signals.spectra.pooling import pooled_spectrum
from signals.spectra.spectra import AmplitudeSpectrum, order_spectra, order_spectrum

_ENVELOPE_SHARE = 0.5
_WIDEST = 0.25  # of the rate: halves of the range are the widest bands
_SEEN = 0.01  # probability that noise alone makes a line, below which it counts
_LEVEL_PERIODS = 4.0  # of the slowest bearing defect: what is slower is taken for a change of level
_LEAST_ORDERS = 20.0  # of a spectrum
_MARGIN = 1.1  # end of a spectrum over (highest expected order + 1), so that the background of its lines fits
_HELD = 2**19  # samples of envelopes whose spectra, some 40 times as large, are made and held at once
_TOGETHER = 2**21  # samples of envelopes resampled at once: their angles are found once, in 16 MB
_SHORTEST = 64  # samples that a check of the sensor needs
_SPEEDS = 256  # over the record, for that check: four in each part in which it looks for a change of level
_LEAST_STRENGTH = 0.03  # of evidence that may name a part, half of the least that does in records of minutes
_OF_THE_LINE = 0.5  # of a line in angle, which one in time must leave there: another line that is larger leaves nothing
_HARMONICS_IN_TIME = 4.5  # of a line that is looked for in time: the first four, and half of one to the filter's edge
_POOLED_BINS = 12.0  # beside a line of a pooled spectrum: nine without its main lobe, of a record of three turns

Values = NDArray[np.floating]  # samples, in the precision of their source


@dataclass(frozen=True, kw_only=True)
class AnalysedChannel:
    """Angle-domain signal, spectra, measured lines and sensor health of one channel."""

    name: str
    units: str
    signal: AngularSignal
    spectra: Mapping[str, AmplitudeSpectrum]
    lines: tuple[MeasuredLine, ...]
    out_of_range: tuple[ExpectedLine, ...]
    duration_s: float
    rate_hz: float
    crest_factor: float
    health: SensorHealth | None
    band: EnvelopeBand | None
    no_band: str = ""
    evidence: tuple[PartEvidence, ...] = ()
    unexplained: tuple[UnexplainedLine, ...] = ()
    envelope_reach: float = 0.0  # highest order of any envelope's spectrum
    transform: NDArray[np.complexfloating] | None = field(
        default=None, repr=False
    )  # of its samples, missing ones filled
    averages: dict[str, SynchronousAverage] = field(
        default_factory=dict, repr=False
    )  # of shafts, as they are asked for

    @property
    def faulty(self) -> bool:
        """Whether the sensor is faulty, so that nothing estimated from it is reliable."""
        return self.health is not None and self.health.status == "sick"


def selected_channels(record: xr.Dataset, settings: AnalysisSettings) -> tuple[str, ...]:
    """Return the names of the channels to analyse; raise AnalysisError for one that the record does not have."""
    there = vibration_channels(record)
    for name in settings.channels or ():
        if name not in there:
            raise AnalysisError(f'the record has no vibration channel "{name}"{closest(name, there)}')
    return tuple(there) if settings.channels is None else tuple(dict.fromkeys(settings.channels))


def excluded_channels(record: xr.Dataset, names: Sequence[str]) -> tuple[dict[str, str], dict[str, SensorHealth]]:
    """Return the channels that are not analysed: those with samples that are not finite, and constant ones.

    Returns
    -------
    gapped : dict of str to str
        Number and place of the samples that are not finite, in words.
    constant : dict of str to SensorHealth
        Empty where all channels without gaps are constant: `varying_values` then raises for the first one.

    Raises
    ------
    AnalysisError
        If every channel has gaps.
    """
    gapped, constant = {}, {}
    for name in names:
        values = channel_values(record, name)
        if gaps := _gaps(values, sampling(record, name)):
            gapped[name] = gaps
        elif values.size >= _SHORTEST and values.min() == values.max():
            units = record[name].attrs["units"]
            constant[name] = sensor_health(values, rate_hz=sampling(record, name).rate_hz, units=units)
    if gapped and len(gapped) == len(names):
        name = next(iter(gapped))
        others = "" if len(names) == 1 else f", and none of the {len(names)} channels is without such samples"
        raise AnalysisError(
            f'channel "{name}" has {gapped[name]}{others}. Cut the record to a part without them, with '
            "record.isel(time=slice(...)) or in the source file before hums convert, or choose a channel without them: "
            "channels=(...), on the command line --channel NAME."
        )
    return gapped, constant if len(constant) < len(names) - len(gapped) else {}


def _gaps(values: Values, when: Sampling) -> str:
    """Return in words how many samples are not finite, in how many gaps and where; empty if all are finite."""
    bad = np.flatnonzero(~np.isfinite(values))
    if not bad.size:
        return ""
    count = 1 + np.count_nonzero(np.diff(bad) > 1)
    where = f"{count} gaps, the first" if count > 1 else "one gap,"
    samples = f"{bad.size} samples that are" if bad.size > 1 else "1 sample that is"
    return f"{samples} not finite in {where} at index {bad[0]} ({when.start_s + bad[0] / when.rate_hz:g} s)"


def varying_values(record: xr.Dataset, name: str) -> Values:
    """Return the samples of a channel; raise AnalysisError if they are constant."""
    values = channel_values(record, name)
    if values.size and values.min() == values.max():
        raise AnalysisError(
            f'channel "{name}" has the same value {values[0]:g} throughout: a dead sensor or a wrong channel. Leave it '
            "out with channels=(...), on the command line --channel NAME."
        )
    return values


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Samples of a channel in one stretch of time, and the reference's angle in it: of a record, or of a snapshot.

    A snapshot of few turns is cut to whole parts of one, `parts` of which are a turn: `phase` counts these.
    """

    values: Values
    phase: ShaftPhase
    parts: int = 1

    @cached_property
    def transform(self) -> NDArray[np.complexfloating]:
        """Fourier transform of the samples without their mean."""
        return transform_of(self.values)

    def over_angle(
        self, rows: Sequence[Values], when: Sampling, name: str, last_order: float, *, highest_hz: float | None = None
    ) -> list[AngularSignal]:
        """Return signals of this stretch, which end at `highest_hz`, at equal increments of the reference's angle."""
        last, multiple = last_order / self.parts, 8 if self.parts == 1 else 1
        signals = resample_all_in_angle(rows, when, name, self.phase, last, multiple_of=multiple, highest_hz=highest_hz)
        if self.parts == 1:
            return signals
        return [
            replace(
                signal,
                samples_per_rev=self.parts * signal.samples_per_rev,
                start_rev=signal.start_rev / self.parts,
                passband_orders=self.parts * signal.passband_orders,
            )
            for signal in signals
        ]


def analyse_channel(
    record: xr.Dataset,
    name: str,
    stretches: Sequence[Stretch],
    machine: Machine,
    expected: Sequence[ExpectedLine],
    settings: AnalysisSettings,
) -> AnalysedChannel:
    """Return the sensor health, spectra and measured lines of a channel, those of snapshots pooled.

    `record` is that of one stretch; `machine` is that of the fastest.
    """
    when, units = sampling(record, name), record[name].attrs["units"]
    conditions = [_health(one, when, units) for one in stretches]
    health = _usual_health(conditions)
    searched = [line for line in expected if line.spectrum == ORDER_SPECTRUM]
    last = _spectrum_end(searched, settings.max_order, PASSBAND / 2 * when.rate_hz / machine.top_speed_hz)
    signals = _equally_long([one.over_angle([one.values], when, name, last)[0] for one in stretches])
    spectrum = pooled_spectrum([order_spectrum(one, max_order=last) for one in signals])
    signal = signals[0]
    values = stretches[0].values if len(stretches) == 1 else np.concatenate([one.values for one in stretches])
    spectra = {ORDER_SPECTRUM: spectrum}
    beside = surroundings_of(spectrum, len(stretches))
    seen = settings.false_alarm_probability
    lines, out_of_range = search(spectrum, searched, channel=name, units=units, surroundings=beside, seen=seen)
    unexplained = unexplained_lines(
        spectra[ORDER_SPECTRUM], drawn_by(machine, settings), setting_of(machine), channel=name, units=units
    )
    filled = [
        one if (whole := whole_values(one.values, own)) is one.values else replace(one, values=whole)
        for one, own in zip(stretches, conditions, strict=True)
    ]
    searched = narrowed((line for line in expected if line.spectrum == ENVELOPE), lines)
    measurable = has_background(spectrum.bin_width, surroundings=beside)
    best, evidence, no_band = _envelopes(
        filled, record, name, machine, searched, lines, settings, measurable=measurable
    )
    if best is not None:
        spectra[ENVELOPE] = best.spectrum
        lines = [*lines, *best.lines, *_with_sidebands(best, machine.bearings)]
        out_of_range = [*out_of_range, *best.out_of_range]
    elif no_band:
        out_of_range = [*out_of_range, *searched]
    return AnalysedChannel(
        name=name,
        units=units,
        signal=signal,
        spectra=spectra,
        lines=tuple(lines),
        out_of_range=tuple(out_of_range),
        duration_s=when.count / when.rate_hz,
        rate_hz=when.rate_hz,
        crest_factor=_crest_factor(values),
        health=health,
        band=None if best is None else best.band,
        evidence=evidence,
        unexplained=tuple(unexplained),
        no_band=no_band,
        envelope_reach=0.0 if best is None else best.reach,
        transform=filled[0].transform if len(filled) == 1 and settings.most_tracks else None,
    )


def _crest_factor(values: Values) -> float:
    mean = values.mean(dtype=np.float64)
    return float(max(values.max() - mean, mean - values.min()) / values.std(dtype=np.float64))


def resample_in_angle(
    values: Values,
    when: Sampling,
    name: str,
    phase: ShaftPhase,
    last_order: float,
    *,
    multiple_of: int = 8,
) -> AngularSignal:
    """Return samples of a channel at equal angle increments of `phase`, with a passband up to `last_order`."""
    return resample_all_in_angle([values], when, name, phase, last_order, multiple_of=multiple_of)[0]


def resample_all_in_angle(
    rows: Sequence[Values],
    when: Sampling,
    name: str,
    phase: ShaftPhase,
    last_order: float,
    *,
    multiple_of: int = 8,
    highest_hz: float | None = None,
) -> list[AngularSignal]:
    """Return what `resample_in_angle` does of each of several signals of a channel, of the same times."""
    try:
        return angular_resample_all(
            rows,
            rate_hz=when.rate_hz,
            phase=phase,
            samples_per_rev=multiple_of * math.ceil(2 * last_order / (multiple_of * PASSBAND)),
            start_s=when.start_s,
            highest_hz=highest_hz,
        )
    except ValueError as error:
        raise AnalysisError(f'channel "{name}": {error}') from None


@dataclass(frozen=True, kw_only=True)
class _Envelope:
    """The envelope of one band: its order spectrum, and the lines measured in it."""

    band: EnvelopeBand
    spectrum: AmplitudeSpectrum
    lines: list[MeasuredLine]
    out_of_range: list[ExpectedLine]
    level: float
    reach: float = 0.0  # of all bands


def _health(stretch: Stretch, when: Sampling, units: str) -> SensorHealth | None:
    if stretch.values.size < _SHORTEST:
        return None
    phase, times_s = stretch.phase, when.start_s + np.linspace(0, when.count / when.rate_hz, _SPEEDS)
    return sensor_health(
        stretch.values,
        rate_hz=when.rate_hz,
        units=units,
        transform=stretch.transform,
        speed_hz=phase.speed_hz(np.clip(times_s, phase.start_s, phase.stop_s)),
    )


def _usual_health(each: Sequence[SensorHealth | None]) -> SensorHealth | None:
    """Return the health that half of the stretches have at least, of their statuses from ok to sick."""
    known = sorted(
        (one for one in each if one is not None), key=lambda one: ("ok", "suspect", "sick").index(one.status)
    )
    return known[(len(known) - 1) // 2] if known else None


def _equally_long(signals: Sequence[AngularSignal]) -> list[AngularSignal]:
    """Return signals cut to the length of the shortest, so that their spectra have one axis."""
    size = min(one.values.size for one in signals)
    return [one if one.values.size == size else replace(one, values=one.values[:size]) for one in signals]


def surroundings_of(spectrum: AmplitudeSpectrum, stretches: int) -> float:
    """Return the orders on either side of a line within which its background is measured: more in pooled spectra."""
    return SURROUNDINGS if stretches == 1 else max(SURROUNDINGS, _POOLED_BINS * spectrum.bin_width)


def _pooled_envelopes(
    rows: Sequence[Sequence[AngularSignal]], last: float, slowest: float
) -> list[tuple[float, AmplitudeSpectrum]]:
    """Return of each row, a band's envelopes in some stretches, the mean level and the spectrum, pooled over levels."""
    levels = [[float(one.values.mean()) for one in row] for row in rows]
    flat = []
    for row, own in zip(rows, levels, strict=True):
        even = [level_normalised(one, revolutions=_LEVEL_PERIODS / slowest) for one in row]
        if len(row) > 1:
            gains = [np.mean(own) / level if level > 0 else 0.0 for level in own]
            even = [replace(one, values=one.values * gain) for one, gain in zip(even, gains, strict=True)]
        flat.append(_equally_long(even))
    # envelopes of a bank are in single precision already
    spectra = [order_spectra(stretch, max_order=last, single=True) for stretch in zip(*flat, strict=True)]
    pooled = [pooled_spectrum(band) for band in zip(*spectra, strict=True)]
    return [(float(np.mean(own)), spectrum) for own, spectrum in zip(levels, pooled, strict=True)]


def _unresolved(
    evidence: Iterable[PartEvidence], expected: Sequence[ExpectedLine], resolution: float
) -> list[PartEvidence]:
    """Return the evidence of pooled snapshots: of parts whose lines are not resolved each may have made that of all."""
    orders = {(line.component, line.kind): line.order for line in expected if line.fundamental}
    parts, found = list(evidence), []
    for part in parts:
        own = (part.component, part.kind)
        near = [
            other
            for other in parts
            if (other.component, other.kind) != own
            and abs(orders[other.component, other.kind] - orders[own]) < resolution
        ]
        strength = max([part.strength, *(other.strength for other in near)])
        if near and strength > 0 and not part.hidden_by:
            other, order = near[0], orders[near[0].component, near[0].kind]
            why = (
                f"snapshots this short resolve {resolution:.2g} orders, and {other.kind.replace('_', ' ')} of "
                f"{other.component}, at {order:.3f}, is nearer than that to {orders[own]:.3f}"
            )
            found.append(replace(part, hidden_by=why, strength=strength))
        else:
            found.append(part)
    return found


def _unless_in_time(part: PartEvidence, stretch: Stretch, when: Sampling) -> PartEvidence:
    """Return the evidence for a part, hidden where its line follows the clock and not the shaft."""
    if part.hidden_by or part.strength < _LEAST_STRENGTH:
        return part
    band, phase = (part.band_low_hz, part.band_high_hz), stretch.phase
    highest_hz = _HARMONICS_IN_TIME * part.found * float(np.max(phase.mean_speed_per_revolution_hz()))
    bank = bank_envelopes(
        stretch.values,
        rate_hz=when.rate_hz,
        bands_hz=[band],
        highest_hz=min(highest_hz, _ENVELOPE_SHARE * (band[1] - band[0])),
        transform=stretch.transform,
    )
    rate_hz, envelope = next(iter(bank))
    times_s = when.start_s + np.arange(envelope.size) / rate_hz
    inside = (times_s >= phase.start_s) & (times_s <= phase.stop_s)
    if np.count_nonzero(inside) < FEWEST_SAMPLES:
        return part
    of = power_in_time_and_angle(
        envelope[inside], rate_hz=rate_hz, revolutions=phase.revolutions_at(times_s[inside]), order=part.found
    )
    if not (of.in_time > IN_TIME * of.in_angle and of.left_in_angle > _OF_THE_LINE * of.in_angle):
        return part
    why = (
        f"it follows the clock: at {of.frequency_hz:.2f} Hz it has {of.in_time / of.in_angle:.1f} times the power that "
        "it has over the shaft's angle, as the line of another machine does"
    )
    return replace(part, hidden_by=why)


def _envelopes(
    stretches: Sequence[Stretch],
    record: xr.Dataset,
    name: str,
    machine: Machine,
    expected: Sequence[ExpectedLine],
    shaft_locked: Sequence[MeasuredLine],
    settings: AnalysisSettings,
    *,
    measurable: bool,
) -> tuple[_Envelope | None, tuple[PartEvidence, ...], str]:
    """Return the envelope with the strongest evidence, the evidence of all bands, and why there is none.

    Bands whose power is mostly that of meshes and shafts are left to others: their lines beat with one another. Where
    no line is `measurable`, in a record of few turns, none is evidence, and the first band is the one to show.
    """
    when = sampling(record, name)
    bands, no_band = _bands_to_search(when.rate_hz, machine, expected, settings)
    if not bands:
        return None, (), no_band
    assessor = LineAssessor({bearing.name: bearing for bearing in machine.bearings}, settings.false_alarm_probability)
    loud = [line for line in shaft_locked if line.line.false_alarm_probability < _SEEN]
    found: list[_Envelope] = []
    seen: list[BandEvidence] = []
    try:
        most = len(bands) if measurable else 1
        for band, level, spectrum in _envelope_spectra(stretches, when, name, machine, expected, bands, most):
            lines, out_of_range = search(
                spectrum,
                expected,
                channel=name,
                units=record[name].attrs["units"],
                level=level,
                searches=len(bands),
                surroundings=surroundings_of(spectrum, len(stretches)),
                seen=settings.false_alarm_probability,
            )
            chosen = EnvelopeBand(
                low_hz=band[0], high_hz=band[1], chosen=not isinstance(settings.envelope_band_hz, tuple)
            )
            found.append(_Envelope(band=chosen, spectrum=spectrum, lines=lines, out_of_range=out_of_range, level=level))
            peaks = spectral_peaks(spectrum, ratio=PEAK_RATIO)
            seen.append(
                BandEvidence(
                    band_hz=band,
                    lines=assessor.assess(lines),
                    orders=peaks.position,
                    depths=peaks.amplitude / level if level > 0 else np.zeros(peaks.position.size),
                    backgrounds=peaks.background / level if level > 0 else np.zeros(peaks.position.size),
                    bin_width=spectrum.bin_width,
                    clear=not chosen.chosen or _mesh_share(found[-1], loud, machine) < MESH_SHARE,
                    line_probability=assessor.single_probability(lines),
                )
            )
    except ValueError as error:
        raise AnalysisError(
            f'envelope of channel "{name}": {error} Or leave the channel out with channels=(...), on the command line '
            "--channel NAME."
        ) from None
    evidence = bearing_evidence(seen, assessor.bearings, setting_of(machine))
    if len(stretches) > 1:
        evidence = _unresolved(evidence, expected, found[0].spectrum.resolution)
    elif not machine.phase.nominal:
        evidence = [_unless_in_time(part, stretches[0], when) for part in evidence]
    strongest = max(evidence, key=lambda part: (not part.hidden_by, part.strength), default=None)
    shown = [place for place, band in enumerate(seen) if band.clear] or [0]
    place = shown[0]
    if strongest is not None and strongest.strength > 0:
        place = next(
            place
            for place in range(len(seen))
            if seen[place].band_hz == (strongest.band_low_hz, strongest.band_high_hz)
        )
    best = found[place]
    reach = max(float(one.spectrum.axis[-1]) for one in found)
    return replace(best, band=_explained(best.band, strongest, len(bands)), reach=reach), tuple(evidence), ""


def _envelope_spectra(
    stretches: Sequence[Stretch],
    when: Sampling,
    name: str,
    machine: Machine,
    expected: Sequence[ExpectedLine],
    bands: Sequence[tuple[float, float]],
    most: int,
) -> Iterator[tuple[tuple[float, float], float, AmplitudeSpectrum]]:
    """Yield each of the first `most` bands, the mean level of its envelope, and its order spectrum of all stretches."""
    # the envelope spectrum of noise in a band of width B falls to zero at B, and is nearly flat up to B / 2
    widest = _ENVELOPE_SHARE * min(high - low for low, high in bands) / machine.top_speed_hz
    last = _spectrum_end(expected, None, widest)
    slowest = min((line.order for line in expected if line.fundamental), default=1.0)
    each = (_over_angle(one, when, name, machine, bands[:most], last) for one in stretches)
    pairs = zip(bands[:most], zip(*each, strict=True), strict=True)
    for first in pairs:
        some = [first, *islice(pairs, _HELD // sum(row.values.size for row in first[1]))]
        pooled = _pooled_envelopes([row for _, row in some], last, slowest)
        yield from ((band, *own) for (band, _), own in zip(some, pooled, strict=True))


def _over_angle(
    stretch: Stretch,
    when: Sampling,
    name: str,
    machine: Machine,
    bands: Sequence[tuple[float, float]],
    last: float,
) -> Iterator[AngularSignal]:
    """Yield the envelope of each band over angle, up to the order `last`; some are resampled together."""
    highest_hz = last * machine.top_speed_hz
    envelopes = bank_envelopes(
        stretch.values, rate_hz=when.rate_hz, bands_hz=bands, highest_hz=highest_hz, transform=stretch.transform
    )
    for rate_hz, first in envelopes:
        some = [first, *(values for _, values in islice(envelopes, _TOGETHER // first.size))]
        at = replace(when, rate_hz=rate_hz, count=first.size)
        yield from stretch.over_angle(some, at, name, last, highest_hz=highest_hz)


def _bands_to_search(
    rate_hz: float, machine: Machine, expected: Sequence[ExpectedLine], settings: AnalysisSettings
) -> tuple[Sequence[tuple[float, float]], str]:
    """Return the bands to demodulate, or none with the reason."""
    given = settings.envelope_band_hz
    if given is None or not expected:
        return (), ""
    if isinstance(given, tuple):
        return (given,), ""
    # as wide as the lines need, but at most a quarter of the rate, which leaves a choice
    needed = _spectrum_end(expected, None, math.inf) * machine.top_speed_hz / _ENVELOPE_SHARE
    try:
        return bank_bands(rate_hz=rate_hz, least_width_hz=min(needed, _WIDEST * rate_hz)), ""
    except ValueError as error:
        return (), str(error)


def drawn_by(machine: Machine, settings: AnalysisSettings) -> Drawn:
    """Return the orders that the drawing explains."""
    return drawn_orders(
        machine.defect_orders,
        bearing_kinds=BEARING_KINDS,
        tolerance=settings.nominal_speed_tolerance if machine.phase.nominal else 0.0,
        slip=settings.slip,
    )


def setting_of(machine: Machine) -> Setting:
    """Return what of the machine explains lines of an envelope."""
    speeds = machine.speeds_hz
    return Setting(
        shafts=tuple(sorted({row.order for row in machine.defect_orders if row.kind == "shaft" and row.order > 0})),
        meshes=tuple(sorted({row.order for row in machine.defect_orders if row.kind == "gear_mesh"})),
        speed_hz=float(speeds.mean()),
        speed_range_hz=float(np.ptp(speeds)),
        measured=not machine.phase.nominal,
    )


def _mesh_share(envelope: _Envelope, loud: Sequence[MeasuredLine], machine: Machine) -> float:
    """Return the share of a band's power that significant lines of meshes and shafts, `loud`, have at any speed."""
    slow, fast = float(machine.speeds_hz.min()), machine.top_speed_hz
    power = sum(
        line.line.amplitude**2 / 2
        for line in loud
        if line.line.found * fast > envelope.band.low_hz and line.line.found * slow < envelope.band.high_hz
    )
    return power / (envelope.level**2 / 2) if envelope.level > 0 else 0.0


def _explained(band: EnvelopeBand, strongest: PartEvidence | None, count: int) -> EnvelopeBand:
    """Return a band with the reason for its choice, and the doubts about it."""
    if not band.chosen:
        return band
    why = f"{band.low_hz:.6g}-{band.high_hz:.6g} Hz, of {count} bands from halves to sixteenths of the range"
    doubts: tuple[str, ...] = ()
    if strongest is None or strongest.strength == 0:
        doubts = ("In no band does a bearing line stand out.",)
    else:
        part = f"{strongest.component} {strongest.kind.replace('_', ' ')}"
        why += f": the line of {part} modulates it by {strongest.depth:.1%}, more than any other part"
    return replace(band, why=why + ".", doubts=doubts)


def whole_values(values: Values, health: SensorHealth | None) -> Values:
    """Return samples with those that the sensor misses replaced by linear interpolation."""
    if health is None or not health.missing.any():
        return values
    missing = health.missing
    places = np.arange(values.size)
    return np.where(missing, np.interp(places, places[~missing], values[~missing]).astype(values.dtype), values)


def _spectrum_end(expected: Iterable[ExpectedLine], stated: float | None, highest: float) -> float:
    """Return the highest order of a spectrum: as stated, or sufficient for all expected lines; at most `highest`."""
    needed = _MARGIN * (max((line.order + line.tolerance for line in expected), default=0.0) + 1.0)
    return min(stated or max(needed, _LEAST_ORDERS), highest)


def _with_sidebands(envelope: _Envelope, bearings: Iterable[BearingOrders]) -> list[MeasuredLine]:
    """Return the measured sidebands of every bearing fundamental, spaced as its kind of defect modulates it."""
    by_name = {bearing.name: bearing for bearing in bearings}
    beside: list[MeasuredLine] = []
    for line in envelope.lines:
        if not line.expected.fundamental:
            continue
        bearing = by_name[line.expected.component]
        spacing = {
            "inner_race": bearing.inner_ring,
            "outer_race": bearing.outer_ring,
            "rolling_element": bearing.cage,
        }.get(line.expected.kind, 0.0)
        spacings = dict.fromkeys(abs(x) for x in (spacing, bearing.carried) if x)
        expected = envelope_sidebands(line, spacings)
        beside += search(envelope.spectrum, expected, channel=line.channel, units=line.units, level=envelope.level)[0]
    return beside
