"""One channel of a record: its health, its signal over angle, its spectra, and the lines found in them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.declared import closest
from hums.layout import AnalysisError, EnvelopeBand
from hums.machine import Machine
from hums.orders import BearingOrders
from hums.record import Sampling, channel_values, sampling, vibration_channels
from hums.search import ENVELOPE, ORDER_SPECTRUM, FoundLine, Wanted, envelope_sidebands, search
from hums.settings import AnalysisSettings
from signals.bands import choose_band
from signals.envelope import envelope
from signals.health import SensorHealth, sensor_health
from signals.phase import ShaftPhase
from signals.resampling import PASSBAND, AngularSignal, angular_resample
from signals.spectra import AmplitudeSpectrum, order_spectrum

_ENVELOPE_SHARE = 0.5
_LEAST_ORDERS = 20.0  # a spectrum shows at least this many
_MARGIN = 1.1  # of order beyond the last line looked for, plus one, so that its surroundings fit
_SHORTEST = 64  # samples, below which a sensor is not judged

Values = NDArray[np.floating]  # samples, in the precision of their source


@dataclass(frozen=True, kw_only=True)
class AnalysedChannel:
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
    health: SensorHealth | None
    band: EnvelopeBand | None
    no_band: str = ""

    @property
    def sick(self) -> bool:
        """Whether its sensor spoils what is estimated."""
        return self.health is not None and self.health.status == "sick"


def chosen_channels(record: xr.Dataset, settings: AnalysisSettings) -> tuple[str, ...]:
    """Return the names of the channels to analyse.

    Raises
    ------
    AnalysisError
        One that the record does not have.
    """
    there = vibration_channels(record)
    for name in settings.channels or ():
        if name not in there:
            raise AnalysisError(f'the record has no vibration channel "{name}"{closest(name, there)}')
    return tuple(there) if settings.channels is None else tuple(dict.fromkeys(settings.channels))


def unfit_channels(record: xr.Dataset, names: Sequence[str]) -> tuple[dict[str, str], dict[str, SensorHealth]]:
    """Return the channels that are not analysed: those with gaps, and those that hold one value throughout.

    Returns
    -------
    gapped : mapping of str to str
        In words how many samples are not finite, and where.
    dead : mapping of str to SensorHealth
        Empty where all that are without gaps are dead, since nothing is left then.

    Raises
    ------
    AnalysisError
        Where every channel has gaps, since nothing is left then.
    """
    gapped, dead = {}, {}
    for name in names:
        values = channel_values(record, name)
        if gaps := _gaps(values, sampling(record, name)):
            gapped[name] = gaps
        elif values.size >= _SHORTEST and values.min() == values.max():
            units = record[name].attrs["units"]
            dead[name] = sensor_health(values, rate_hz=sampling(record, name).rate_hz, units=units)
    if gapped and len(gapped) == len(names):
        name = next(iter(gapped))
        others = "" if len(names) == 1 else f", and none of the {len(names)} channels is without such samples"
        raise AnalysisError(
            f'channel "{name}" has {gapped[name]}{others}. Cut the record to a part without them, with '
            "record.isel(time=slice(...)) or in the source file before hums convert, or choose a channel without them: "
            "channels=(...), on the command line --channel NAME."
        )
    return gapped, dead if len(dead) < len(names) - len(gapped) else {}


def _gaps(values: Values, when: Sampling) -> str:
    """Say how many samples of a channel are not finite, in how many gaps and where; empty where all are."""
    bad = np.flatnonzero(~np.isfinite(values))
    if not bad.size:
        return ""
    count = 1 + np.count_nonzero(np.diff(bad) > 1)
    where = f"{count} gaps, the first" if count > 1 else "one gap,"
    samples = f"{bad.size} samples that are" if bad.size > 1 else "1 sample that is"
    return f"{samples} not finite in {where} at index {bad[0]} ({when.start_s + bad[0] / when.rate_hz:g} s)"


def living_values(record: xr.Dataset, name: str) -> Values:
    """Read a channel without gaps, or say that it is dead."""
    values = channel_values(record, name)
    if values.size and values.min() == values.max():
        raise AnalysisError(
            f'channel "{name}" has the same value {values[0]:g} throughout: a dead sensor or a wrong channel. Leave it '
            "out with channels=(...), on the command line --channel NAME."
        )
    return values


def analysed_channel(
    record: xr.Dataset,
    name: str,
    values: Values,
    machine: Machine,
    wanted: Sequence[Wanted],
    settings: AnalysisSettings,
) -> AnalysedChannel:
    """Judge a channel's sensor by its `values`, make its spectra, and look for all lines in them."""
    when, units = sampling(record, name), record[name].attrs["units"]
    health = sensor_health(values, rate_hz=when.rate_hz, units=units) if values.size >= _SHORTEST else None
    crest = _crest(values)
    by_spectrum = {key: [line for line in wanted if line.spectrum == key] for key in (ORDER_SPECTRUM, ENVELOPE)}
    band, no_band = _band(values, health, when.rate_hz, by_spectrum[ENVELOPE], machine, settings)
    angular, spectra = {}, {}
    lines: list[FoundLine] = []
    beyond: list[Wanted] = []
    for key in (ENVELOPE, ORDER_SPECTRUM):  # the smaller spectrum first, beside which the envelope needs memory
        mine = by_spectrum[key]
        reach, stated, source = PASSBAND / 2 * when.rate_hz / machine.top_speed_hz, settings.max_order, values
        if key == ENVELOPE:
            if band is None:
                beyond += mine if no_band else []
                continue
            source, stated = _demodulated(values, when.rate_hz, band.band_hz, name), None
            # the envelope of noise in a band of width B thins out towards B: up to half of it the floor is near level
            reach = _ENVELOPE_SHARE * (band.high_hz - band.low_hz) / machine.top_speed_hz
        last = _last_order(mine, stated, reach)
        angular[key] = over_angle(source, record, name, machine.phase, last)
        del source
        spectra[key] = order_spectrum(angular[key], max_order=last)
        found, out_of_reach = search(spectra[key], mine, channel=name, units=units)
        if key == ENVELOPE:
            found += _with_sidebands(spectra[key], found, machine.bearings)
        lines = [*found, *lines]
        beyond = [*out_of_reach, *beyond]
    return AnalysedChannel(
        name=name,
        units=units,
        signal=angular[ORDER_SPECTRUM],
        spectra=spectra,
        lines=tuple(lines),
        beyond=tuple(beyond),
        duration_s=when.count / when.rate_hz,
        rate_hz=when.rate_hz,
        crest=crest,
        health=health,
        band=band,
        no_band=no_band,
    )


def _crest(values: Values) -> float:
    mean = values.mean(dtype=np.float64)
    return float(max(values.max() - mean, mean - values.min()) / values.std(dtype=np.float64))


def over_angle(
    values: Values,
    record: xr.Dataset,
    name: str,
    phase: ShaftPhase,
    last_order: float,
    *,
    multiple_of: int = 8,
) -> AngularSignal:
    """Resample a channel over the angle of `phase`, so that `last_order` passes, or say why not."""
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


def _band(
    values: Values,
    health: SensorHealth | None,
    rate_hz: float,
    wanted: Sequence[Wanted],
    machine: Machine,
    settings: AnalysisSettings,
) -> tuple[EnvelopeBand | None, str]:
    """Return the band to demodulate, or none and why none could be chosen."""
    given = settings.envelope_band_hz
    if given is None or not wanted:
        return None, ""
    if isinstance(given, tuple):
        return EnvelopeBand(low_hz=given[0], high_hz=given[1], chosen=False), ""
    # as wide as the lines need, but never so wide that no choice is left
    needed = _last_order(wanted, None, math.inf) * machine.top_speed_hz / _ENVELOPE_SHARE
    heard = values if health is None or not health.missing.any() else _bridged(values, health.missing)
    try:
        best = choose_band(heard, rate_hz=rate_hz, modulation_hz=min(needed, rate_hz / 4))
    except ValueError as error:
        return None, str(error)
    return EnvelopeBand(low_hz=best.low_hz, high_hz=best.high_hz, chosen=True, why=best.why, doubts=best.doubts), ""


def _bridged(values: Values, missing: NDArray[np.bool_]) -> Values:
    """Return the values with straight lines over those that are missing."""
    places = np.arange(values.size)
    return np.where(missing, np.interp(places, places[~missing], values[~missing]).astype(values.dtype), values)


def _demodulated(values: Values, rate_hz: float, band_hz: tuple[float, float], name: str) -> Values:
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
