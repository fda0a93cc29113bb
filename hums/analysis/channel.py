"""Analysis of one channel over its segments: spectra averaged by power, lines measured once.

Spectra are averaged over blocks of equal numbers of revolutions. Levels in the table of indicators (RMS) are the root
mean square over the segments; other indicators, and the assessment of gears, are medians. Both are weighted by
revolutions.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from hums.analysis.combs import Setting
from hums.analysis.evidence import (
    LEAKAGE_SHARE,
    BandEvidence,
    PartEvidence,
    bearing_evidence,
    load_spacings,
    single_probability,
)
from hums.analysis.expected_lines import (
    ENVELOPE,
    ORDER_SPECTRUM,
    TOOTH_KINDS,
    ExpectedLine,
    MeasuredLine,
    envelope_sidebands,
    search,
)
from hums.analysis.gear_damage import GearJudgement, ToothEnvelope, gear_damage, gear_indicators, most_conspicuous
from hums.analysis.indicators import (
    Baseline,
    averaged_indicators,
    bearing_indicators,
    not_averaged,
    raw_indicators,
)
from hums.analysis.reference_angle import Machine
from hums.analysis.result import ChannelPictures, EnvelopeBand, IndicatorValue, SensorCondition
from hums.analysis.segments import ChannelSegments, Segment, capitalised
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.thresholds import (
    IN_TIME,
    LEAST_SCORE,
    MAINS_ACCURACY,
    MAINS_HARMONICS,
    MAINS_HZ,
    PEAK_RATIO,
)
from hums.analysis.tracks import EnvelopeLine, tooth_line
from hums.analysis.unexplained import Drawn, PulseVariation, UnexplainedLine, drawn_orders, unexplained_lines
from hums.gearbox.bearing_catalogue import BearingOrders
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.demodulation.envelope import bank_bands, bank_envelopes, level_normalised
from signals.demodulation.time_or_angle import FEWEST_SAMPLES, power_in_time_and_angle
from signals.health import SensorHealth
from signals.resampling.resampling import PASSBAND, AngularSignal
from signals.spectra.lines import BACKGROUND_WIDTH, has_background
from signals.spectra.peaks import noise_left, pooled_spectrum, spectral_peaks
from signals.spectra.spectra import AmplitudeSpectrum, order_spectra, order_spectrum

_ENVELOPE_SHARE = 0.5
_LEVEL_PERIODS = 4.0  # of the slowest bearing defect: what is slower is taken for a change of level
_LEAST_ORDERS = 20.0  # of a spectrum
_MARGIN = 1.1  # end of a spectrum over (highest expected order + 1), so that the background of its lines fits
_HELD = 2**18  # samples of envelopes whose spectra, some 40 times as large, are made and held at once
_TOGETHER = 2**21  # samples of envelopes resampled at once: their angles are found once, in 16 MB
_OF_THE_LINE = 0.5  # of a line in angle, which one in time must leave there: another line that is larger leaves nothing
_HARMONICS_IN_TIME = 4.5  # of a line that is looked for in time: the first four, and half of one to the filter's edge
_POOLED_BINS = 12.0  # next to a line of a pooled spectrum: nine without its main lobe, of a record of three turns
_FAULTY_SHARE = 0.5  # of the turns
_LARGEST_CLIPPED = 0.05  # share of the samples, above which `std` of tracks with censored samples is a lower bound
_LEVELS = ("rms", "velocity_rms")  # indicators of which the mean square is averaged


@dataclass(frozen=True, kw_only=True)
class AnalysedChannel:
    """Spectra, measured lines, indicators, gears and sensor health of one channel, over all of its segments.

    `analysed_s` of `duration_s` are in whole revolutions, of which the longest segment has `revolutions`; `left_out`
    describes the gaps, `failed` states why segments were omitted. Spectra of `blocks` blocks were averaged;
    `noise_left` is the remaining share of the noise power. `teeth` has, by component, the envelopes of gears with a
    tooth that stands out, one per segment.
    """

    name: str
    units: str
    rate_hz: float
    segments: tuple[Segment, ...]
    duration_s: float
    analysed_s: float
    revolutions: int
    left_out: str
    failed: tuple[str, ...]
    spectra: Mapping[str, AmplitudeSpectrum]
    blocks: int
    noise_left: float
    lines: tuple[MeasuredLine, ...]
    out_of_range: tuple[ExpectedLine, ...]
    crest_factor: float
    condition: SensorCondition | None
    band: EnvelopeBand | None
    bands: tuple[BandEvidence, ...] = field(default=(), repr=False)
    evidence: tuple[PartEvidence, ...] = ()
    undrawn: str = ""  # deepest line of its envelopes that belongs to no component
    unexplained: tuple[UnexplainedLine, ...] = ()
    of_pulses: int = 0  # lines that are sidebands by the tachometer's jitter
    envelope_reach: float = 0.0  # highest order of any envelope's spectrum
    indicators: tuple[IndicatorValue, ...] = ()
    gears: tuple[GearJudgement, ...] = ()
    teeth: tuple[Mapping[str, EnvelopeLine], ...] = field(default=(), repr=False)
    pictures: ChannelPictures | None = field(default=None, repr=False)

    @property
    def faulty(self) -> bool:
        """Whether the sensor is faulty, so that no estimate from it is reliable."""
        return self.condition is not None and self.condition.status == "faulty"


@dataclass(frozen=True, kw_only=True)
class _Part:
    """Results of one segment other than spectra."""

    turns: float
    analysed_s: float
    crest_factor: float
    health: SensorHealth | None
    faulty: bool
    indicators: list[IndicatorValue]
    gears: list[GearJudgement]
    teeth: dict[str, EnvelopeLine]
    histories: Baseline


def read_anew(segments: Sequence[Segment]) -> Iterator[Segment]:
    """Yield the segments, copied if there are several, so that the samples of each are freed after use."""
    yield from segments if len(segments) == 1 else (replace(one, averages={}) for one in segments)


def _analysable(segments: Sequence[Segment], failed: dict[int, str]) -> Iterator[Segment]:
    """Yield the segments that can be resampled in angle; raise if none can, as for a shaft at rest."""
    for number, segment in enumerate(read_anew(segments)):
        try:
            _ = segment.signal
        except AnalysisError as error:
            failed[number] = str(error)
            if len(failed) == len(segments):
                raise
            continue
        yield segment


def analyse_channel(
    channel: ChannelSegments,
    machine: Machine,
    expected: Sequence[ExpectedLine],
    settings: AnalysisSettings,
    baseline: Baseline,
    *,
    channels: int,
    draw: Callable[[Segment, AnalysisSettings], ChannelPictures],
) -> AnalysedChannel:
    """Return the analysis of one of `channels`; `machine` is that of the whole record.

    `draw` adds the pictures of the first segment. The histories in `baseline` are updated by the segments whose
    indicators are used.
    """
    first = channel.segments[0]
    name, units, rate_hz = first.name, first.units, first.when.rate_hz
    searched = [line for line in expected if line.spectrum == ORDER_SPECTRUM]
    last = _spectrum_end(searched, settings.max_order, PASSBAND / 2 * rate_hz / machine.top_speed_hz)
    drawn = drawn_by(machine, settings)
    segments = tuple(replace(one, last_order=last, drawn=replace(drawn, tolerance=0.0)) for one in channel.segments)
    in_envelopes = [line for line in expected if line.spectrum == ENVELOPE]
    bands = _bands_to_search(first, machine, in_envelopes, settings)
    envelopes = _Envelopes.of(bands, in_envelopes, machine)
    block = _block_turns(segments, early_s=envelopes.end_s)
    single = len(segments) == 1
    width = BACKGROUND_WIDTH if single else max(BACKGROUND_WIDTH, _POOLED_BINS / block)
    if not has_background(1 / block, background_width=width):
        envelopes = replace(envelopes, bands=bands[:1])  # no line is evidence: one band to show
    pool: _Pool | None = None
    parts, pictures = list[_Part](), None
    failed: dict[int, str] = {}
    for segment in _analysable(segments, failed):
        pool = _with_order_spectra(pool, segment, block, single=single)
        envelopes.add(segment, block, single=single)
        if not single:
            segment.forget_spectra()
        parts.append(_part(segment, settings, baseline, channels=channels))
        if settings.pictures and segment.parts_per_turn == 1 and pictures is None:
            pictures = draw(segment, settings)
    segments = tuple(one for number, one in enumerate(segments) if number not in failed)
    if pool is None:  # the others hold no block
        left = replace(channel, segments=segments)
        return analyse_channel(left, machine, expected, settings, baseline, channels=channels, draw=draw)
    spectrum, blocks = pool.spectrum(), pool.count
    lines, out_of_range = search(
        spectrum,
        searched,
        channel=name,
        units=units,
        background_width=width,
        seen=settings.false_alarm_probability,
    )
    longest = max(read_anew(segments), key=lambda one: one.turns)
    lines = _with_passed_mains(lines, longest)
    best, seen, evidence, undrawn = _assessed_envelopes(
        envelopes, segments, longest, machine, in_envelopes, settings, searches=len(bands), width=width
    )
    angle = machine.phase
    unexplained, of_pulses = unexplained_lines(
        spectrum,
        drawn,
        setting_of(machine),
        channel=name,
        units=units,
        pulses=PulseVariation.of(angle.times_s, angle.revolutions, machine.jitter_s) if machine.jitter_s else None,
    )
    spectra = {ORDER_SPECTRUM: spectrum} | ({ENVELOPE: best.spectrum} if best is not None else {})
    if best is not None:
        lines = [*lines, *best.lines, *_with_sidebands(best, machine.bearings)]
        out_of_range = [*out_of_range, *best.out_of_range]
    state = _pooled_condition(name, channel, parts)
    faulty = state is not None and state.status == "faulty"
    alike = [part for part in parts if part.faulty == faulty]
    gears, indicators = _pooled_gears(alike), _pooled_indicators(alike, baseline)
    if best is not None and not faulty:
        indicators += bearing_indicators(name, units, evidence, best.band.band_hz, best.spectrum, machine, settings)
    if not faulty:
        indicators += not_averaged(name, units, indicators) if first.parts_per_turn > 1 else gear_indicators(gears)
    return AnalysedChannel(
        name=name,
        units=units,
        rate_hz=rate_hz,
        segments=segments,
        duration_s=channel.duration_s,
        analysed_s=sum(part.analysed_s for part in parts),
        revolutions=int(max(one.turns for one in segments)),
        left_out=channel.gaps,
        failed=tuple(failed.values()),
        spectra=spectra,
        blocks=blocks,
        noise_left=noise_left(pool.count),
        lines=tuple(lines),
        out_of_range=tuple(out_of_range),
        crest_factor=max(part.crest_factor for part in parts),
        condition=state,
        band=None if best is None else best.band,
        bands=seen,
        evidence=evidence,
        undrawn=undrawn,
        unexplained=tuple(_unless_passed_mains(line, longest) for line in unexplained),
        of_pulses=of_pulses,
        envelope_reach=0.0 if best is None else best.reach,
        indicators=tuple(indicators),
        gears=tuple(gears),
        teeth=tuple(part.teeth for part in parts),
        pictures=pictures,
    )


def _block_turns(segments: Sequence[Segment], *, early_s: float) -> float:
    """Return the number of revolutions per averaged block that is best for detecting a weak line.

    With K blocks of M revolutions, the power of a line over the scatter of the noise power grows as ``M sqrt(K)``.
    Envelopes end up to `early_s` before their segment.
    """
    if len(segments) == 1:
        return segments[0].turns
    turns = []
    for one in segments:
        try:
            turns.append(one.machine.whole_turns(one.when, parts_per_turn=one.parts_per_turn, early_s=early_s))
        except ValueError:  # not one of them
            continue
    longest = np.array(turns or [1.0])
    return float(max(np.unique(longest), key=lambda block: block * math.sqrt(np.sum(longest // block))))


def _with_passed_mains(lines: Sequence[MeasuredLine], segment: Segment) -> list[MeasuredLine]:
    """Return the sidebands of a spectrum with the leakage from mains harmonics that the speed sweeps past."""
    found = []
    for line in lines:
        leakage = line.line.leakage
        if line.expected.kind == "tooth" and not math.isnan(leakage):  # NaN: no line is seen
            leakage = max(leakage, _passed_mains(line.line.found, segment)[0])
        found.append(replace(line, line=replace(line.line, leakage=leakage)))
    return found


def _unless_passed_mains(line: UnexplainedLine, segment: Segment) -> UnexplainedLine:
    """Return an unexplained line, attributed to a mains harmonic swept past if that accounts for most of it."""
    amplitude, name = _passed_mains(line.order, segment)
    return replace(line, might_be=name) if amplitude > LEAKAGE_SHARE * line.amplitude else line


def _passed_mains(order: float, segment: Segment) -> tuple[float, str]:
    """Return the largest amplitude at an order due to a mains harmonic that the speed sweeps past, and its name.

    A line of constant frequency f and amplitude A contributes ``A |sum w exp(2 pi j (f t - order revolutions))| / sum
    w`` at an order, mostly while the speed is near f over the order.
    """
    when, phase, speeds_hz = segment.when, segment.machine.phase, segment.machine.speeds_hz
    passed = [
        (multiple * mains, f"mains, {multiple} x {mains:g} Hz")
        for mains in MAINS_HZ
        for multiple in range(1, MAINS_HARMONICS + 1)
        if order * min(speeds_hz) <= multiple * mains <= order * max(speeds_hz)
    ]
    if setting_of(segment.machine).steady or not passed:  # a line of constant frequency is one of constant order
        return 0.0, ""
    start_s, stop_s = max(phase.start_s, when.start_s), min(phase.stop_s, when.start_s + when.count / when.rate_hz)
    # four instants per beat, at which the two differ by no more than the frequency of the order changes
    beats = order * (max(speeds_hz) - min(speeds_hz)) * (stop_s - start_s)
    times_s = np.linspace(start_s, stop_s, 64 + math.ceil(4 * beats))
    window, turned = np.hanning(times_s.size), order * phase.revolutions_at(times_s)
    left = []
    for frequency_hz, name in passed:
        apart = window @ np.exp(2j * np.pi * (frequency_hz * times_s - turned))
        reach_hz = MAINS_ACCURACY * frequency_hz + when.rate_hz / when.count
        first, last = (round((frequency_hz + by) * when.count / when.rate_hz) for by in (-reach_hz, reach_hz))
        amplitude = 2 * np.abs(segment.filled_transform[first : last + 1]).max(initial=0.0) / when.count
        left.append((float(amplitude * abs(apart) / window.sum()), name))
    return max(left)


def _blocks(signal: AngularSignal, turns: float, *, single: bool) -> Iterator[AngularSignal]:
    """Yield blocks of a number of revolutions, evenly spread over a signal; the whole signal of a `single` segment."""
    size = signal.values.size if single else round(turns * signal.samples_per_rev)
    count = signal.values.size // size
    for start in np.linspace(0, signal.values.size - size, count).astype(int).tolist() if count > 1 else [0] * count:
        begin = signal.start_rev + start / signal.samples_per_rev
        yield replace(signal, values=signal.values[start : start + size], start_rev=begin)


def _part(segment: Segment, settings: AnalysisSettings, baseline: Baseline, *, channels: int) -> _Part:
    """Return the results of one segment other than spectra."""
    signal, phase, values = segment.signal, segment.machine.phase, segment.values
    turns = signal.values.size / signal.samples_per_rev
    ends = phase.times_at(np.array([signal.start_rev, signal.start_rev + turns]))
    mean, histories = values.mean(dtype=np.float64), baseline.copy()
    indicators = list(raw_indicators(segment))
    gears: list[GearJudgement] = []
    teeth: dict[str, EnvelopeLine] = {}
    if segment.parts_per_turn == 1:
        indicators += [] if segment.faulty else averaged_indicators(segment, settings, histories)
        envelopes: dict[str, ToothEnvelope] | None = {} if settings.most_tracks else None
        gears = gear_damage(
            segment,
            false_alarm_probability=settings.false_alarm_probability,
            channels=channels,
            envelopes=envelopes,
        )
        teeth = {component: tooth_line(segment, component, tooth) for component, tooth in (envelopes or {}).items()}
    return _Part(
        turns=segment.turns,
        analysed_s=float(ends[1] - ends[0]),
        crest_factor=float(max(values.max() - mean, mean - values.min()) / values.std(dtype=np.float64)),
        health=segment.health,
        faulty=segment.faulty,
        indicators=indicators,
        gears=gears,
        teeth=teeth,
        histories=histories,
    )


def weighted_median(values: Sequence[float], weights: Sequence[float]) -> int:
    """Return the index of the lower weighted median: the smallest value with half of the weight at or below it."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(np.asarray(weights)[order])
    return int(order[np.searchsorted(total, total[-1] / 2)])


def _pooled_indicators(parts: Sequence[_Part], baseline: Baseline) -> list[IndicatorValue]:
    """Return one row per indicator over all segments, and add its history to the baseline."""
    rows: dict[tuple[str, str, str], list[tuple[IndicatorValue, _Part]]] = {}
    for part in parts:
        for row in part.indicators:
            rows.setdefault((row.component, row.kind, row.indicator), []).append((row, part))
    pooled = []
    for (component, _, indicator), some in rows.items():
        known = [(row, part) for row, part in some if not row.withheld] or some[:1]
        weights = [part.turns for _, part in known]
        values = [row.value for row, _ in known]
        row, part = known[weighted_median(values, weights)]
        baseline.take((row.channel, component, indicator), part.histories)
        if len(known) > 1:
            how = "median"
            if indicator in _LEVELS:
                how, level = "root mean square", math.sqrt(np.average(np.square(values), weights=weights))
                row = replace(row, value=level)
            row = replace(row, takes=f"{row.takes}; {how} of {len(known)} segments")
        pooled.append(row)
    return pooled


def _pooled_gears(parts: Sequence[_Part]) -> list[GearJudgement]:
    """Return the assessment of each gear in the segment of median strength, among those that can be assessed."""
    if len(parts) == 1:
        return parts[0].gears
    rows: dict[str, list[tuple[GearJudgement, float]]] = {}
    for part in parts:
        for row in part.gears:
            rows.setdefault(row.component, []).append((row, part.turns))
    pooled = []
    for some in rows.values():
        judged = [(row, turns) for row, turns in some if not row.not_judged] or some[:1]
        place = weighted_median([row.strength for row, _ in judged], [turns for _, turns in judged])
        pooled.append(judged[place][0])
    return most_conspicuous(pooled)


def _pooled_condition(name: str, channel: ChannelSegments, parts: Sequence[_Part]) -> SensorCondition | None:
    """Return the condition of a sensor: the worst of any segment, but faulty only if so for half of the revolutions."""
    known = [(part.health, part.turns) for part in parts if part.health is not None]
    if not known:
        return None
    rank = ("ok", "suspect", "faulty").index
    worst = max((health for health, _ in known), key=lambda health: rank(health.status))
    faulty = sum(turns for health, turns in known if health.status == "faulty")
    status: str = worst.status
    if faulty < _FAULTY_SHARE * sum(turns for _, turns in known):
        status = min(status, "suspect", key=rank)
    more = []
    if len(known) > 1 and worst.reasons:
        alike = sum(health.status == worst.status for health, _ in known)
        more.append(f"The same holds in {alike} of {len(known)} segments.")
    if channel.gaps:
        status = max(status, "suspect", key=rank)
        more.append(f"It drops out: it has {channel.gaps}.")
    shares = [(health.missing.mean(), health.clipped.mean()) for health, _ in known]
    lost, clipped = np.average(shares, axis=0, weights=[turns for _, turns in known]).tolist()
    if clipped > _LARGEST_CLIPPED:
        more.append(f"With {clipped:.0%} of the samples clipped, std of its tracks is a lower bound.")
    return SensorCondition(
        name=name,
        sensor="vibration",
        status=status,
        reasons=" ".join([*capitalised(worst.reasons), *more]),
        missing=channel.missing + (1 - channel.missing) * lost,
        not_judged="; ".join(worst.not_judged),
    )


# ---- Envelopes of all bands ------------------------------------------------------------------------------------------


@dataclass
class _Pool:
    """Sum of the power of spectra on the axis of the first, of which no lines are kept."""

    first: AmplitudeSpectrum
    power: NDArray[np.float64]
    count: int = 1

    @staticmethod
    def add(pool: "_Pool | None", spectrum: AmplitudeSpectrum) -> "_Pool":
        """Return the pool with another spectrum added."""
        power = spectrum.amplitude**2
        if pool is None:
            none = np.zeros(0, dtype=np.complex128)
            return _Pool(replace(spectrum, amplitude=power[:0], complex_amplitude=none), power)
        np.add(pool.power, power, out=pool.power)
        pool.count += 1
        return pool

    def spectrum(self) -> AmplitudeSpectrum:
        """Return the pooled spectrum."""
        return pooled_spectrum(self.first, power=self.power, count=self.count)


def _with_order_spectra(pool: _Pool | None, segment: Segment, block: float, *, single: bool) -> _Pool | None:
    """Return the pool with the order spectra of the blocks of a segment added."""
    if single:
        return _Pool.add(pool, segment.spectrum)
    for one in _blocks(segment.signal, block, single=False):
        pool = _Pool.add(pool, order_spectrum(one, max_order=segment.last_order))
    return pool


@dataclass(frozen=True, kw_only=True)
class _Envelope:
    """The envelope of one band: its order spectrum, and the lines measured in it."""

    band: EnvelopeBand
    spectrum: AmplitudeSpectrum
    lines: list[MeasuredLine]
    out_of_range: list[ExpectedLine]
    level: float
    reach: float  # of all bands


@dataclass(frozen=True, kw_only=True)
class _Envelopes:
    """Pooled spectra of the envelopes of bands, up to the order `last`; `slowest` is the lowest order of a component.

    The envelopes of several segments are pooled relative to their levels.
    """

    bands: Sequence[tuple[float, float]]
    last: float
    slowest: float
    highest_hz: float
    pools: dict[tuple[float, float], _Pool] = field(default_factory=dict)
    levels: dict[tuple[float, float], list[tuple[float, float]]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, bands: Sequence[tuple[float, float]], expected: Sequence[ExpectedLine], machine: Machine
    ) -> "_Envelopes":
        # the envelope spectrum of noise in a band of width B falls to zero at B, and is nearly flat up to B / 2
        widest = _ENVELOPE_SHARE * min((high - low for low, high in bands), default=0.0) / machine.top_speed_hz
        last = _spectrum_end(expected, None, widest)
        return cls(
            bands=bands,
            last=last,
            slowest=min((line.order for line in expected if line.fundamental), default=1.0),
            highest_hz=last * machine.top_speed_hz,
        )

    @property
    def end_s(self) -> float:
        """Largest time in s by which envelopes end before the samples: half a cycle of their highest frequency."""
        return 1 / (2 * self.highest_hz) if self.bands else 0.0

    def add(self, segment: Segment, block: float, *, single: bool) -> None:
        """Add the envelopes of a segment, several at a time, in blocks of a number of revolutions."""
        if not self.bands:
            return
        try:
            self._add(segment, block, single=single)
        except ValueError as error:
            raise AnalysisError(
                f'envelope of channel "{segment.name}": {error} Or leave the channel out with channels=(...), on the '
                "command line --channel NAME."
            ) from None

    def _add(self, segment: Segment, block: float, *, single: bool) -> None:
        signals = zip(self.bands, self._over_angle(segment), strict=True)
        for first in signals:
            some = [first, *islice(signals, _HELD // first[1].values.size)]
            flat = []
            for band, signal in some:
                level = float(signal.values.mean())
                self.levels.setdefault(band, []).append((level, segment.turns))
                even = level_normalised(signal, revolutions=_LEVEL_PERIODS / self.slowest)
                flat.append(replace(even, values=even.values / level if level > 0 else even.values))
            for signals_of in zip(*(_blocks(one, block, single=single) for one in flat), strict=True):
                # envelopes of a bank are in single precision already
                spectra = order_spectra(signals_of, max_order=self.last, single=True)
                for (band, _), spectrum in zip(some, spectra, strict=True):
                    self.pools[band] = _Pool.add(self.pools.get(band), spectrum)

    def _over_angle(self, segment: Segment) -> Iterator[AngularSignal]:
        """Yield the envelope of each band over angle, resampled several at a time."""
        when = segment.when
        envelopes = bank_envelopes(
            segment.filled,
            rate_hz=when.rate_hz,
            bands_hz=self.bands,
            highest_hz=self.highest_hz,
            transform=segment.free_transform,
        )
        for rate_hz, first in envelopes:
            some = [first, *(values for _, values in islice(envelopes, _TOGETHER // first.size))]
            at = replace(when, rate_hz=rate_hz, count=first.size)
            yield from segment.over_angle(some, at, self.last, highest_hz=self.highest_hz)

    def spectrum(self, band: tuple[float, float]) -> tuple[float, AmplitudeSpectrum]:
        """Return the mean level of a band's envelope, and its spectrum."""
        levels, turns = zip(*self.levels[band], strict=True)
        pooled = self.pools[band].spectrum()
        level = float(np.average(levels, weights=turns))
        amplitude = pooled.amplitude * level
        return level, replace(pooled, amplitude=amplitude, complex_amplitude=amplitude.astype(np.complex128))


def _assessed_envelopes(
    envelopes: _Envelopes,
    segments: Sequence[Segment],
    longest: Segment,
    machine: Machine,
    expected: Sequence[ExpectedLine],
    settings: AnalysisSettings,
    *,
    searches: int,
    width: float,
) -> tuple[_Envelope | None, tuple[BandEvidence, ...], tuple[PartEvidence, ...], str]:
    """Return the envelope with the strongest evidence, the lines in all bands, their evidence, and what has no part."""
    name, units = segments[0].name, segments[0].units
    if not envelopes.bands:
        return None, (), (), ""
    bearings = {bearing.name: bearing for bearing in machine.bearings}
    found: dict[tuple[float, float], tuple[float, AmplitudeSpectrum]] = {}
    seen: list[BandEvidence] = []

    def searched(
        band: tuple[float, float], wanted: Iterable[ExpectedLine], leaking: float
    ) -> tuple[list[MeasuredLine], list[ExpectedLine]]:
        level, spectrum = found[band]
        return search(
            spectrum,
            wanted,
            channel=name,
            units=units,
            level=level,
            searches=searches,
            background_width=width,
            seen=leaking,
        )

    for band in envelopes.bands:
        level, spectrum = found[band] = envelopes.spectrum(band)
        # the leakage of these lines is not read
        lines, _ = searched(band, (line for line in expected if line.kind in BEARING_KINDS), 0.0)
        peaks = spectral_peaks(spectrum, ratio=PEAK_RATIO)
        heard = slice(None) if level > 0 else slice(0)  # an envelope of zeros has no depths
        seen.append(
            BandEvidence(
                band_hz=band,
                lines=lines,
                orders=peaks.position[heard],
                depths=peaks.amplitude[heard] / level,
                backgrounds=peaks.background[heard] / level,
                bin_width=spectrum.bin_width,
                line_probability=single_probability(lines, settings.false_alarm_probability),
            )
        )
    evidence, undrawn = bearing_evidence(seen, bearings, setting_of(machine))
    if len(segments) > 1:
        evidence = _unresolved(evidence, expected, spectrum.resolution)
    if segments[0].parts_per_turn == 1 and machine.separates_time_from_angle:
        evidence = [_unless_in_time(part, longest) for part in evidence]
    strongest = max(evidence, key=lambda part: (not part.hidden_by, part.score), default=None)
    band = envelopes.bands[0]
    if strongest is not None and strongest.strength > 0:
        band = (strongest.band_low_hz, strongest.band_high_hz)
    lines, out_of_range = searched(band, expected, settings.false_alarm_probability)
    level, spectrum = found[band]
    chosen = EnvelopeBand(low_hz=band[0], high_hz=band[1], chosen=not isinstance(settings.envelope_band_hz, tuple))
    best = _Envelope(
        band=_explained(chosen, strongest, searches),
        spectrum=spectrum,
        lines=lines,
        out_of_range=out_of_range,
        level=level,
        reach=max(float(one.axis[-1]) for _, one in found.values()),
    )
    return best, tuple(seen), tuple(evidence), undrawn


def _unresolved(
    evidence: Iterable[PartEvidence], expected: Sequence[ExpectedLine], resolution: float
) -> list[PartEvidence]:
    """Return the evidence of pooled segments: that of components with unresolved lines may come from any of them."""
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
        score = max([part.score, *(other.score for other in near)])
        if near and score > 0 and not part.hidden_by:
            other, order = near[0], orders[near[0].component, near[0].kind]
            why = (
                f"segments this short resolve {resolution:.2g} orders, and {other.kind.replace('_', ' ')} of "
                f"{other.component}, at {order:.3f}, is closer than that to {orders[own]:.3f}"
            )
            found.append(replace(part, hidden_by=why, score=score))
        else:
            found.append(part)
    return found


def _unless_in_time(part: PartEvidence, segment: Segment) -> PartEvidence:
    """Return the evidence for a component, masked if its line is constant in frequency, not in order."""
    if part.hidden_by or part.score < LEAST_SCORE:
        return part
    band, when, phase = (part.band_low_hz, part.band_high_hz), segment.when, segment.machine.phase
    highest_hz = _HARMONICS_IN_TIME * part.found * float(np.max(phase.mean_speed_per_revolution_hz()))
    rate_hz, envelope = segment.envelope(band, min(highest_hz, _ENVELOPE_SHARE * (band[1] - band[0])))
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
        f"its frequency is constant: at {of.frequency_hz:.2f} Hz it has {of.in_time / of.in_angle:.1f} times its power "
        "over the shaft angle, like a line of another machine"
    )
    return replace(part, hidden_by=why)


def _bands_to_search(
    segment: Segment, machine: Machine, expected: Sequence[ExpectedLine], settings: AnalysisSettings
) -> Sequence[tuple[float, float]]:
    """Return the bands to demodulate, as wide as the lines need, or halves of the range.

    There are none where a filter left too little for lines with harmonics, and damage may ring in what it removed.
    """
    given = settings.envelope_band_hz
    if given is None or not expected:
        return ()
    if isinstance(given, tuple):
        return (given,)
    needed = _spectrum_end(expected, None, math.inf) * machine.top_speed_hz / _ENVELOPE_SHARE
    bands = bank_bands(rate_hz=2 * segment.end_hz, least_width_hz=needed)
    narrow = bands[0][1] - bands[0][0] < needed
    return () if narrow and segment.end_hz < segment.when.rate_hz / 2 else bands


def drawn_by(machine: Machine, settings: AnalysisSettings) -> Drawn:
    """Return the orders explained by the gearbox."""
    tolerance = settings.nominal_speed_tolerance if machine.phase.nominal else 0.0
    return drawn_orders(machine.defect_orders, tolerance=tolerance, slip=settings.slip)


def setting_of(machine: Machine) -> Setting:
    """Return the sources in the machine that explain lines of an envelope: shafts, and teeth of planets."""
    speeds, turning = machine.speeds_hz, {"shaft", *TOOTH_KINDS}
    return Setting(
        shafts=tuple(sorted({round(row.order, 9) for row in machine.defect_orders if row.kind in turning} - {0.0})),
        speed_hz=float(speeds.mean()),
        speed_range_hz=float(np.ptp(speeds)),
        measured=not machine.phase.nominal,
    )


def _explained(band: EnvelopeBand, strongest: PartEvidence | None, count: int) -> EnvelopeBand:
    """Return a band with the reason for its choice."""
    if not band.chosen:
        return band
    why = f"{band.low_hz:.6g}-{band.high_hz:.6g} Hz, of {count} bands from halves to sixteenths of the range"
    if strongest is None or strongest.strength == 0:
        return replace(band, why=f"{why}. No bearing line stands out in any band.")
    part = f"{strongest.component} {strongest.kind.replace('_', ' ')}"
    return replace(
        band, why=f"{why}: the line of {part} modulates it by {strongest.depth:.1%}, more than any other part."
    )


def _spectrum_end(expected: Iterable[ExpectedLine], stated: float | None, highest: float) -> float:
    """Return the highest order of a spectrum: as specified, or sufficient for all expected lines; at most `highest`."""
    needed = _MARGIN * (max((line.order + line.tolerance for line in expected), default=0.0) + 1.0)
    return min(stated or max(needed, _LEAST_ORDERS), highest)


def _with_sidebands(envelope: _Envelope, bearings: Iterable[BearingOrders]) -> list[MeasuredLine]:
    """Return the measured sidebands of every bearing fundamental, at the spacing of its kind of defect."""
    by_name = {bearing.name: bearing for bearing in bearings}
    sidebands: list[MeasuredLine] = []
    for line in envelope.lines:
        if not line.expected.fundamental:
            continue
        expected = envelope_sidebands(line, load_spacings(by_name[line.expected.component], line.expected.kind))
        found, _ = search(envelope.spectrum, expected, channel=line.channel, units=line.units, level=envelope.level)
        sidebands += found
    return sidebands
