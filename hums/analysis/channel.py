"""Analysis of one channel: sensor health, angle-domain signal, order and envelope spectrum, measured lines."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM, ExpectedLine, MeasuredLine, envelope_sidebands, search
from hums.analysis.reference_angle import Machine
from hums.analysis.result import AnalysisError, EnvelopeBand
from hums.analysis.settings import AnalysisSettings
from hums.gearbox.components import closest
from hums.gearbox.orders import BearingOrders
from hums.records.record import Sampling, channel_values, sampling, vibration_channels
from signals.demodulation.band_selection import choose_band
from signals.demodulation.envelope import envelope
from signals.health import SensorHealth, sensor_health
from signals.resampling.resampling import PASSBAND, AngularSignal, angular_resample
from signals.shaft.phase import ShaftPhase
from signals.spectra.spectra import AmplitudeSpectrum, order_spectrum

_ENVELOPE_SHARE = 0.5
_LEAST_ORDERS = 20.0  # of a spectrum
_MARGIN = 1.1  # end of a spectrum over (highest expected order + 1), so that the background of its lines fits
_SHORTEST = 64  # samples that a check of the sensor needs

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


def analyse_channel(
    record: xr.Dataset,
    name: str,
    values: Values,
    machine: Machine,
    expected: Sequence[ExpectedLine],
    settings: AnalysisSettings,
) -> AnalysedChannel:
    """Return the sensor health, spectra and measured lines of a channel with samples `values`."""
    when, units = sampling(record, name), record[name].attrs["units"]
    health = sensor_health(values, rate_hz=when.rate_hz, units=units) if values.size >= _SHORTEST else None
    crest_factor = _crest_factor(values)
    by_spectrum = {key: [line for line in expected if line.spectrum == key] for key in (ORDER_SPECTRUM, ENVELOPE)}
    band, no_band = _envelope_band(values, health, when.rate_hz, by_spectrum[ENVELOPE], machine, settings)
    angular, spectra = {}, {}
    lines: list[MeasuredLine] = []
    out_of_range: list[ExpectedLine] = []
    for key in (ENVELOPE, ORDER_SPECTRUM):  # the smaller spectrum first: the envelope needs memory of its own
        searched = by_spectrum[key]
        highest, stated, source = PASSBAND / 2 * when.rate_hz / machine.top_speed_hz, settings.max_order, values
        if key == ENVELOPE:
            if band is None:
                out_of_range += searched if no_band else []
                continue
            source, stated = _envelope_of(values, when.rate_hz, band.band_hz, name), None
            # the envelope spectrum of noise in a band of width B falls to zero at B, and is nearly flat up to B / 2
            highest = _ENVELOPE_SHARE * (band.high_hz - band.low_hz) / machine.top_speed_hz
        last = _spectrum_end(searched, stated, highest)
        angular[key] = resample_in_angle(source, record, name, machine.phase, last)
        del source
        spectra[key] = order_spectrum(angular[key], max_order=last)
        found, above = search(spectra[key], searched, channel=name, units=units)
        if key == ENVELOPE:
            found += _with_sidebands(spectra[key], found, machine.bearings)
        lines = [*found, *lines]
        out_of_range = [*above, *out_of_range]
    return AnalysedChannel(
        name=name,
        units=units,
        signal=angular[ORDER_SPECTRUM],
        spectra=spectra,
        lines=tuple(lines),
        out_of_range=tuple(out_of_range),
        duration_s=when.count / when.rate_hz,
        rate_hz=when.rate_hz,
        crest_factor=crest_factor,
        health=health,
        band=band,
        no_band=no_band,
    )


def _crest_factor(values: Values) -> float:
    mean = values.mean(dtype=np.float64)
    return float(max(values.max() - mean, mean - values.min()) / values.std(dtype=np.float64))


def resample_in_angle(
    values: Values,
    record: xr.Dataset,
    name: str,
    phase: ShaftPhase,
    last_order: float,
    *,
    multiple_of: int = 8,
) -> AngularSignal:
    """Return a channel resampled at equal angle increments of `phase`, with a passband up to `last_order`."""
    when = sampling(record, name)
    try:
        return angular_resample(
            values,
            rate_hz=when.rate_hz,
            phase=phase,
            samples_per_rev=multiple_of * math.ceil(2 * last_order / (multiple_of * PASSBAND)),
            start_s=when.start_s,
        )
    except ValueError as error:
        raise AnalysisError(f'channel "{name}": {error}') from None


def _envelope_band(
    values: Values,
    health: SensorHealth | None,
    rate_hz: float,
    expected: Sequence[ExpectedLine],
    machine: Machine,
    settings: AnalysisSettings,
) -> tuple[EnvelopeBand | None, str]:
    """Return the band to demodulate, or None with the reason why none could be chosen."""
    given = settings.envelope_band_hz
    if given is None or not expected:
        return None, ""
    if isinstance(given, tuple):
        return EnvelopeBand(low_hz=given[0], high_hz=given[1], chosen=False), ""
    # as wide as the lines need, but at most a quarter of the rate, which leaves a choice
    needed = _spectrum_end(expected, None, math.inf) * machine.top_speed_hz / _ENVELOPE_SHARE
    samples = values if health is None or not health.missing.any() else _interpolated(values, health.missing)
    try:
        best = choose_band(samples, rate_hz=rate_hz, modulation_hz=min(needed, rate_hz / 4))
    except ValueError as error:
        return None, str(error)
    return EnvelopeBand(low_hz=best.low_hz, high_hz=best.high_hz, chosen=True, why=best.why, doubts=best.doubts), ""


def _interpolated(values: Values, missing: NDArray[np.bool_]) -> Values:
    """Return the values with missing ones replaced by linear interpolation."""
    places = np.arange(values.size)
    return np.where(missing, np.interp(places, places[~missing], values[~missing]).astype(values.dtype), values)


def _envelope_of(values: Values, rate_hz: float, band_hz: tuple[float, float], name: str) -> Values:
    try:
        return envelope(values, rate_hz=rate_hz, band_hz=band_hz)
    except ValueError as error:
        raise AnalysisError(
            f'envelope of channel "{name}": {error} Or leave the channel out with channels=(...), on the command line '
            "--channel NAME."
        ) from None


def _spectrum_end(expected: Iterable[ExpectedLine], stated: float | None, highest: float) -> float:
    """Return the highest order of a spectrum: as stated, or sufficient for all expected lines; at most `highest`."""
    needed = _MARGIN * (max((line.order + line.tolerance for line in expected), default=0.0) + 1.0)
    return min(stated or max(needed, _LEAST_ORDERS), highest)


def _with_sidebands(
    spectrum: AmplitudeSpectrum, lines: Sequence[MeasuredLine], bearings: Iterable[BearingOrders]
) -> list[MeasuredLine]:
    """Return the measured sidebands of every bearing fundamental, spaced as its kind of defect modulates it."""
    by_name = {bearing.name: bearing for bearing in bearings}
    beside: list[MeasuredLine] = []
    for line in lines:
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
        beside += search(spectrum, expected, channel=line.channel, units=line.units)[0]
    return beside
