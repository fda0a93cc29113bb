"""A record as a sequence of segments: parts of a channel without gaps, in which the angle of the reference is known.

- A record without gaps is one segment, or, with more than `LONGEST` samples per channel, several of equal length.
- A gap, a run of samples that are not finite, ends a segment; the next begins after it.
- Each snapshot is one segment; a snapshot of a few revolutions is truncated to whole eighths of a revolution.

A segment reads its samples on first use.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import fft

from hums.analysis.reference_angle import Machine, prepare_machine, together
from hums.analysis.result import SensorCondition
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.thresholds import UNEXPLAINED_RATIO
from hums.analysis.unexplained import Drawn, distances, locked_to_shafts
from hums.gearbox.components import closest
from hums.gearbox.model import Gearbox
from hums.records.channels import Sampling, channel_values, names_of, sampling, tachometers, vibration_channels
from hums.records.snapshots import is_snapshots, snapshots_of
from signals._transforms import transform_of
from signals.angle.averaging import SynchronousAverage
from signals.demodulation.envelope import bank_envelopes, passband_end_hz
from signals.health import SensorHealth, sensor_health
from signals.resampling.resampling import PASSBAND, AngularSignal, angular_resample_all, time_resample
from signals.shaft.phase import ShaftPhase
from signals.spectra.peaks import spectral_peaks
from signals.spectra.spectra import AmplitudeSpectrum, order_spectrum

LONGEST = 4_000_000  # samples of a channel at once: a gigabyte besides the record, two minutes at 33 kHz
SHORTEST = 64  # samples that a check of the sensor needs
_PARTS = 8  # of a turn, to whole ones of which a snapshot is cut: of three turns an eighth is lost, not one
_LEAST_SHARE = 0.05  # of the longest segment's turns: what is shorter shows nothing that the longest does not
# Changes of load that go with a line; a modulation of it by a shaft or a tooth is a line of its own. Of 16 damaged
# races and elements under loud meshes, halved names the same nine, doubled eight.
_SLOW_HZ = 2.0
_EXCERPT = 2**18  # samples, a 32nd of which is enough, for the end of the signal
_SPEEDS = 256  # over the record, for the check of the sensor: four in each part in which it looks for a change of level

Values = NDArray[np.floating]  # samples, in the precision of their source


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Samples of a channel without gaps, and the reference's angle while they were taken.

    Attributes
    ----------
    record : xarray.Dataset
        Part of the record that holds the samples.
    name : str
        Name of the channel.
    machine : Machine
        Machine with the angle of the reference in this part.
    part : int
        Number of the part of the record, counted from 0, which segments of other channels share.
    turns : float
        Revolutions of the reference, whole or in eighths.
    parts_per_turn : int
        8 for a snapshot, which is truncated to eighths of a revolution; otherwise 1.
    last_order : float
        End of its order spectrum.
    drawn : Drawn, optional
        Orders that the drawing explains.
    averages : dict
        Synchronous averages of shafts computed so far.
    """

    record: xr.Dataset
    name: str
    machine: Machine
    part: int
    turns: float
    parts_per_turn: int = 1
    last_order: float = 0.0
    drawn: Drawn | None = None
    averages: dict[str, SynchronousAverage] = field(default_factory=dict, repr=False)

    @property
    def when(self) -> Sampling:
        """Rate, start and number of the samples."""
        return sampling(self.record, self.name)

    @property
    def units(self) -> str:
        """Unit of the samples."""
        return str(self.record[self.name].attrs["units"])

    @cached_property
    def values(self) -> Values:
        """The samples."""
        return read(self.record, self.name)

    @cached_property
    def end_hz(self) -> float:
        """Frequency in Hz at which a low-pass filter ends the signal, from samples in the middle."""
        dim, first = self.record[self.name].dims[-1], max(0, (self.when.count - _EXCERPT) // 2)
        middle = channel_values(self.record.isel({dim: slice(first, first + _EXCERPT)}), self.name)
        known, rate_hz = middle[np.isfinite(middle)], self.when.rate_hz
        return passband_end_hz(known, rate_hz=rate_hz) if known.size >= _EXCERPT // 32 else rate_hz / 2

    @cached_property
    def transform(self) -> NDArray[np.complexfloating]:
        """Fourier transform of the samples without their mean."""
        return transform_of(self.values)

    @cached_property
    def health(self) -> SensorHealth | None:
        """Condition of the sensor; None with too few samples for a check."""
        when, phase = self.when, self.machine.phase
        if when.count < SHORTEST:
            return None
        times_s = when.start_s + np.linspace(0, when.count / when.rate_hz, _SPEEDS)
        return sensor_health(
            self.values,
            rate_hz=when.rate_hz,
            units=self.units,
            transform=self.transform,
            speed_hz=phase.speed_hz(np.clip(times_s, phase.start_s, phase.stop_s)),
        )

    @property
    def faulty(self) -> bool:
        """Whether the sensor is faulty, so that no estimate from it is reliable."""
        return self.health is not None and self.health.status == "faulty"

    @cached_property
    def filled(self) -> Values:
        """Samples, with missing ones interpolated linearly."""
        if self.health is None or not self.health.missing.any():
            return self.values
        missing, places = self.health.missing, np.arange(self.values.size)
        between = np.interp(places, places[~missing], self.values[~missing]).astype(self.values.dtype)
        return np.where(missing, between, self.values)

    @cached_property
    def filled_transform(self) -> NDArray[np.complexfloating]:
        """Fourier transform of `filled` without its mean."""
        return self.transform if self.filled is self.values else transform_of(self.filled)

    @cached_property
    def free_transform(self) -> NDArray[np.complexfloating]:
        """Fourier transform of `filled` without its mean and the lines of meshes and shafts, which beat in an envelope.

        A line is a peak of the order spectrum that `drawn` explains; with it goes what changes its amplitude slowly.
        """
        signal, when, spectrum = self.signal, self.when, self.spectrum
        peaks = spectral_peaks(spectrum, ratio=UNEXPLAINED_RATIO).position
        lines = np.sort(peaks[locked_to_shafts(peaks, self.drawn, spectrum.bin_width)]) if self.drawn else peaks[:0]
        if not lines.size:
            return self.filled_transform
        phase, size = self.machine.phase, signal.values.size
        orders = np.arange(size // 2 + 1) * signal.samples_per_rev / size
        away = distances(orders, lines) * float(self.machine.speeds_hz.mean()) / _SLOW_HZ
        gain = 0.5 + 0.5 * np.cos(np.pi * np.minimum(away, 1.0))
        kept = replace(signal, values=fft.irfft(gain * fft.rfft(signal.values - signal.values.mean()), size))
        (begin,) = phase.times_at(np.array([signal.start_rev]))
        first = math.ceil((begin - when.start_s) * when.rate_hz)
        start_s = when.start_s + first / when.rate_hz
        locked = time_resample(kept, phase=phase, rate_hz=when.rate_hz, start_s=start_s).values[: when.count - first]
        free = self.filled.copy()
        free[first : first + locked.size] -= locked
        return transform_of(free)

    def envelope(self, band_hz: tuple[float, float], highest_hz: float | None = None) -> tuple[float, Values]:
        """Return the rate and the samples of the envelope of a band, its slow part up to `highest_hz` if given."""
        ((rate_hz, values),) = bank_envelopes(
            self.filled,
            rate_hz=self.when.rate_hz,
            bands_hz=[band_hz],
            highest_hz=highest_hz,
            transform=self.free_transform,
        )
        return rate_hz, values

    @cached_property
    def signal(self) -> AngularSignal:
        """Samples over the angle of the reference, up to `last_order`."""
        return self.over_angle([self.values], self.when, self.last_order)[0]

    @cached_property
    def spectrum(self) -> AmplitudeSpectrum:
        """Order spectrum of `signal`."""
        return order_spectrum(self.signal, max_order=self.last_order)

    def forget_spectra(self) -> None:
        """Free the memory of the order spectrum and of the transform without lines, which envelopes alone need."""
        for name in ("spectrum", "free_transform"):
            self.__dict__.pop(name, None)

    def over_angle(
        self, rows: Sequence[Values], when: Sampling, last_order: float, *, highest_hz: float | None = None
    ) -> list[AngularSignal]:
        """Return signals of this segment, which end at `highest_hz`, at equal increments of the reference's angle."""
        parts = self.parts_per_turn
        phase, multiple = self.machine.phase_in_parts(parts), 8 if parts == 1 else 1
        signals = resample_in_angle(
            rows, when, self.name, phase, last_order / parts, multiple_of=multiple, highest_hz=highest_hz
        )
        if parts == 1:
            return signals
        return [
            replace(
                signal,
                samples_per_rev=parts * signal.samples_per_rev,
                start_rev=signal.start_rev / parts,
                passband_orders=parts * signal.passband_orders,
            )
            for signal in signals
        ]


def resample_in_angle(
    rows: Sequence[Values],
    when: Sampling,
    name: str,
    phase: ShaftPhase,
    last_order: float,
    *,
    multiple_of: int = 8,
    highest_hz: float | None = None,
) -> list[AngularSignal]:
    """Return signals of a channel at equal angle increments of `phase`, with a passband up to `last_order`."""
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
class ChannelSegments:
    """Segments of a channel, and the omitted parts.

    Attributes
    ----------
    segments : tuple of Segment
        Segments that can be analysed.
    duration_s : float
        Duration of all samples.
    gaps : str
        Number and position of samples that are not finite, in words; empty if none.
    missing : float
        Share of the samples that are not finite.
    condition : SensorCondition or None
        Condition of the sensor of a channel without segments.
    why : str
        Reason why no segment can be analysed, or empty.
    """

    segments: tuple[Segment, ...]
    duration_s: float
    gaps: str = ""
    missing: float = 0.0
    condition: SensorCondition | None = None
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class SegmentedRecord:
    """Segments by channel, the machine of the record and of each part, start times in s, and the omitted parts."""

    machine: Machine
    machines: Mapping[int, Machine]
    starts_s: Mapping[int, float]
    channels: Mapping[str, ChannelSegments]
    left_out: Sequence[str]


def read(record: xr.Dataset, name: str) -> Values:
    """Return the samples of a channel; an open record does not cache them."""
    return channel_values(record.isel({record[name].dims[-1]: slice(None)}), name)


def selected_channels(record: xr.Dataset, settings: AnalysisSettings) -> tuple[str, ...]:
    """Return the names of the channels to analyse; raise AnalysisError for one that the record does not have."""
    there = vibration_channels(record)
    for name in settings.channels or ():
        if name not in there:
            raise AnalysisError(f'the record has no vibration channel "{name}"{closest(name, there)}')
    return tuple(there) if settings.channels is None else tuple(dict.fromkeys(settings.channels))


def segmented(record: xr.Dataset, gearbox: Gearbox, settings: AnalysisSettings) -> SegmentedRecord:
    """Return the segments of every channel of a record, with the angle of the reference in each.

    The angle of a tachometer is that of the whole record. A declared speed is refined, and an unknown one estimated, in
    each part, from a channel without gaps in it; a part in which this fails is omitted. The declared speed of snapshots
    is not refined, as they have few revolutions.

    Raises
    ------
    AnalysisError
        If no channel has a segment, or the angle is known in no part.
    """
    names, snapshots = selected_channels(record, settings), is_snapshots(record)
    if snapshots:
        settings = settings.model_copy(update={"nominal_speed_tolerance": 0.0})
    parts = [(f"Snapshot {n}", part) for n, part in enumerate(snapshots_of(record.compute()))] if snapshots else None
    parts = parts or list(_parts(record, names))
    scans = {name: [Scan.of(read(part, name)) for _, part in parts] for name in names}
    usable = [name for name in names if not all(scan.constant for scan in scans[name])] or list(names)
    shared = None if snapshots or not tachometers(record) else prepare_machine(record, gearbox, settings)
    machines: dict[int, Machine] = {}
    left_out: list[str] = []
    for number, (label, part) in enumerate(parts):
        whole = [name for name in usable if scans[name][number].whole]
        own = settings.model_copy(update={"channels": tuple(whole or usable)})
        try:
            machines[number] = shared or prepare_machine(part, gearbox, own)
        except AnalysisError as error:
            if len(parts) == 1:
                raise
            left_out.append(f"{label}: nothing is analysed: {error}")
    if not machines:
        raise AnalysisError(left_out[0])
    pieces, parts_per_turn = [part for _, part in parts], _PARTS if snapshots else 1
    channels = {name: _channel_segments(pieces, name, scans[name], machines, parts_per_turn) for name in names}
    if not any(one.segments for one in channels.values()):
        raise AnalysisError(next(iter(channels.values())).why)
    given = record["snapshot_s"].to_numpy().tolist() if "snapshot_s" in record.coords else [0.0] * len(parts)
    return SegmentedRecord(
        machine=shared or together(list(machines.values())),
        machines={0: shared} if shared else machines,
        starts_s=dict(enumerate(given)),
        channels=channels,
        left_out=left_out,
    )


def _parts(record: xr.Dataset, names: Sequence[str]) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield the parts of a record, with a name for each.

    If the speed is estimated from a channel, a part ends at each gap of the channel with the fewest lost samples.
    """
    whens = [sampling(record, name) for name in names]
    count = max(math.ceil(when.count / LONGEST) for when in whens)
    first, last = min(when.start_s for when in whens), max(when.start_s + when.count / when.rate_hz for when in whens)
    for begin, end in pairwise(np.linspace(first, last, count + 1).tolist()):
        part = record if count == 1 else _between(record, begin, end)
        scans = {} if tachometers(record) else {name: Scan.of(read(part, name)) for name in names}
        name = min(scans, key=lambda name: scans[name].lost, default="")
        if not name or scans[name].whole or not scans[name].runs:
            yield f"From {begin:.6g} to {end:.6g} s", part
            continue
        when = sampling(part, name)
        for run in scans[name].runs:
            begin_s, end_s = (when.start_s + edge / when.rate_hz for edge in run)
            yield f"From {begin_s:.6g} to {end_s:.6g} s", _between(part, begin_s, end_s)


def _between(record: xr.Dataset, start_s: float, stop_s: float) -> xr.Dataset:
    """Return the record from `start_s` up to `stop_s`, with all pulses of its tachometers."""
    slices = {}
    for name in names_of(record, "vibration", "waveform"):
        when = sampling(record, name)
        ends = (math.ceil(round((moment - when.start_s) * when.rate_hz, 3)) for moment in (start_s, stop_s))
        slices[record[name].dims[0]] = slice(*(min(max(end, 0), when.count) for end in ends))
    return record.isel(slices)


@dataclass(frozen=True, kw_only=True)
class Scan:
    """Runs of finite samples of a channel in one part, and whether all have the same value."""

    count: int
    lost: int
    first_lost: int
    runs: tuple[tuple[int, int], ...]
    constant: bool

    @classmethod
    def of(cls, values: Values) -> "Scan":
        """Scan samples, NaN where missing."""
        finite = np.isfinite(values)
        lost = finite.size - int(np.count_nonzero(finite))
        if lost:
            edges = np.flatnonzero(np.diff(finite, prepend=False, append=False)).reshape(-1, 2)
            runs, some = tuple((int(a), int(b)) for a, b in edges), values[finite]
        else:
            runs, some = ((0, finite.size),) if finite.size else (), values
        return cls(
            count=finite.size,
            lost=lost,
            first_lost=int(np.argmin(finite)) if lost else -1,
            runs=runs,
            constant=some.size == 0 or bool(some.min() == some.max()),
        )

    @property
    def whole(self) -> bool:
        """Whether no sample is lost, and the samples vary."""
        return not self.lost and not self.constant


def _channel_segments(
    parts: Sequence[xr.Dataset],
    name: str,
    scans: Sequence[Scan],
    machines: Mapping[int, Machine],
    parts_per_turn: int,
) -> ChannelSegments:
    """Return the segments of a channel: runs of finite, varying samples of at least one revolution of the reference."""
    segments: list[Segment] = []
    whole = len(parts) == 1 and not scans[0].lost
    why = ""
    for number, machine in machines.items():
        scan, part = scans[number], parts[number]
        for first, stop in scan.runs if not scan.constant else ():
            piece = part if not scan.lost else part.isel({part[name].dims[0]: slice(first, stop)})
            when = sampling(piece, name)
            if when.count < SHORTEST and not whole:
                continue
            try:
                turns = machine.whole_turns(when, parts_per_turn=parts_per_turn)
            except ValueError as error:
                why = why or f'channel "{name}": {error}'
                continue
            segments.append(
                Segment(
                    record=piece,
                    name=name,
                    machine=machine,
                    part=number,
                    turns=turns,
                    parts_per_turn=parts_per_turn,
                )
            )
    longest = max((one.turns for one in segments), default=0.0)
    found = scanned(parts, name, scans)
    return replace(
        found,
        segments=tuple(one for one in segments if one.turns >= _LEAST_SHARE * longest),
        why="" if segments else found.why or why,
    )


def scanned(parts: Sequence[xr.Dataset], name: str, scans: Sequence[Scan]) -> ChannelSegments:
    """Return what is known of a channel from its samples alone, without segments.

    Its `why` holds if no segment between its gaps can be used, and where it has the same value throughout.
    """
    when = sampling(parts[0], name)
    lost, count = sum(scan.lost for scan in scans), sum(scan.count for scan in scans)
    gaps, why = _gaps(scans, when) if lost else "", ""
    status, reasons = "faulty", f"It drops out: it has {gaps}."
    if gaps:
        why = (
            f'channel "{name}" has {gaps}, and no segment between gaps that can be used. Choose another channel, '
            "channels=(...), on the command line --channel NAME, or restore the samples."
        )
    if all(scan.constant for scan in scans) and any(scan.runs for scan in scans):
        part, first = next((part, scan.runs[0][0]) for part, scan in zip(parts, scans, strict=True) if scan.runs)
        values = read(part, name)
        why = (
            f'channel "{name}" has the same value {values[first]:g} throughout: a dead sensor or a wrong channel. '
            "Leave it out with channels=(...), on the command line --channel NAME."
        )
        if not lost and values.size >= SHORTEST:
            health = sensor_health(values, rate_hz=when.rate_hz, units=part[name].attrs["units"])
            status, reasons = health.status, " ".join(capitalised(health.reasons))
    missing = lost / max(count, 1)
    return ChannelSegments(
        segments=(),
        duration_s=count / when.rate_hz,
        gaps=gaps,
        missing=missing,
        condition=SensorCondition(name=name, sensor="vibration", status=status, reasons=reasons, missing=missing),
        why=why,
    )


def capitalised(reasons: Iterable[str]) -> list[str]:
    """Return sentences that begin with a capital letter."""
    return [reason[0].upper() + reason[1:] for reason in reasons]


def _gaps(scans: Sequence[Scan], when: Sampling) -> str:
    """Return in words how many samples are not finite, in how many gaps, and where the first is."""
    lost = sum(scan.lost for scan in scans)
    gaps = sum(
        len(scan.runs) - 1 + (scan.runs[0][0] > 0) + (scan.runs[-1][1] < scan.count) if scan.runs else 1
        for scan in scans
        if scan.lost
    )
    part = next(number for number, scan in enumerate(scans) if scan.lost)
    index = sum(scan.count for scan in scans[:part]) + scans[part].first_lost
    where = f"{gaps} gaps, the first" if gaps > 1 else "one gap,"
    samples = f"{lost} samples that are" if lost > 1 else "1 sample that is"
    return f"{samples} not finite in {where} at index {index} ({when.start_s + index / when.rate_hz:g} s)"
