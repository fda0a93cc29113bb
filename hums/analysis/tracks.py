"""Complex amplitude over time: of the shaft-synchronous lines of a channel, and of its envelope lines."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import fft
from scipy.special import stdtrit

from hums.analysis.evidence import AssessedLine, PartEvidence
from hums.analysis.expected_lines import ORDER_SPECTRUM, MeasuredLine
from hums.analysis.gear_damage import ToothEnvelope
from hums.analysis.reference_angle import Machine
from hums.analysis.segments import Segment, resample_in_angle
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.harmonics import track_orders
from signals.harmonics.bandwidth_selection import likely_bandwidth
from signals.health import SensorHealth
from signals.slipping_order.slip_tracking import SlippingTrack, track_slipping_order
from signals.spectra.lines import find_line
from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum

_MOST_OUTPUTS = 200
_STEPS_REV = (0.125, 0.25, 0.5)
_LARGEST_BANDWIDTH = 0.1  # orders; the most likely one is looked for below this
_POLES = 2  # amplitudes that vary smoothly; a passband with steep sides, so that neighbours stay out
_OUTPUTS_A_BANDWIDTH = 16.0
_SLOWEST_OUTPUT_REV = 8.0
_CYCLES_A_BANDWIDTH = 8.0  # of a line in one over its bandwidth, so that it and its neighbours are apart
_SLIP_CHANGE = 1e-3  # a revolution; as `track_slipping_order` advises for rolling bearings
# steps of the smoother: to choose the bandwidth along a first path, where more change the amplitude by less than 1e-3
# of its largest, and at it
_FIRST_STEPS, _MOST_STEPS = 4, 100
_MARGIN_ORDERS = 1.5  # above a line, for the noise next to it
# what differs between segments of one track
_OF_A_SEGMENT = ("track_order", "bandwidth_orders", "clipped_share", "level", "method")
_ENDS = 8  # outputs, a turn in steps of an eighth, that not all channels have
_DECIMALS = 6  # of a revolution, to which outputs of several channels are matched
CONFIDENCE = 0.95  # of the intervals of amplitudes, at each output by itself
_BACKGROUND_SHARE = 0.4  # of a line's order: the next harmonic of its family stays out

Numbers = NDArray[np.float64]


def lines_to_track(assessed: Iterable[AssessedLine], *, most: int) -> list[MeasuredLine]:
    """Return the strongest significant lines of the order spectrum, one per order, in ascending order."""
    significant = [
        line.measured for line in assessed if line.significant and line.measured.expected.kind not in BEARING_KINDS
    ]
    locked = [line for line in significant if line.expected.spectrum == ORDER_SPECTRUM]
    strongest = sorted(locked, key=lambda line: -line.line.snr)
    chosen: list[MeasuredLine] = []
    for line in strongest:
        if all(abs(line.expected.order - other.expected.order) > line.bin_width for other in chosen):
            chosen.append(line)
    return sorted(chosen[:most], key=lambda line: line.expected.order)


def track_lines(
    segment: Segment,
    spectrum: AmplitudeSpectrum,
    lines: Sequence[MeasuredLine],
    *,
    noise_left: float = 1.0,
    bandwidth_orders: float | None,
    step_rev: float,
    origin_rev: float | None = None,
) -> xr.Dataset:
    """Return the complex amplitude of lines in one segment from the Kalman smoother, with its standard deviation.

    Parameters
    ----------
    segment : Segment
        Segment, whose samples in time are used if some are missing or clipped.
    spectrum : AmplitudeSpectrum
        Order spectrum of the channel, in which the lines were measured.
    lines : sequence of MeasuredLine
        Lines to track, at their expected orders; at their measured orders if the speed is nominal.
    noise_left : float
        Share of the noise power remaining in the spectrum.
    bandwidth_orders : float, optional
        Full -3 dB width of the smoother in orders; None for the maximum-likelihood width of each line.
    step_rev : float
        Revolutions between outputs.
    origin_rev : float, optional
        Origin of the output steps. Default: start of the segment.

    Returns
    -------
    xarray.Dataset
        ``complex_amplitude``, ``std`` and ``half_width`` (track, output), with the identity of each track as
        coordinates. ``std`` contains the noise around the line and the effect of the shaft angle's uncertainty on its
        amplitude; above 5 % of clipped samples, ``clipped_share``, it is a lower bound. ``half_width`` is that of the
        95 % interval of the real or imaginary part, by Student's t at the degrees of freedom of the noise's estimate.
    """
    signal, machine, phase = segment.signal, segment.machine, segment.machine.phase
    orders = np.array([line.line.found if phase.nominal else line.expected.order for line in lines])
    # white noise of variance R has the mean square amplitude 4 R ENBW / n in a windowed spectrum of n samples
    samples = signal.samples_per_rev / spectrum.bin_width
    power = np.array([2 * line.line.amplitude_std**2 for line in lines]) / noise_left
    noise = power * samples / (4 * spectrum.noise_bandwidth_bins)
    every = round(step_rev * signal.samples_per_rev)
    if origin_rev is not None:
        late = round((signal.start_rev - origin_rev) * signal.samples_per_rev) % every
        cut = (every - late) % every
        begin = signal.start_rev + cut / signal.samples_per_rev
        signal = replace(signal, values=signal.values[cut:], start_rev=begin)
    revolution = signal.start_rev + np.arange(0, signal.values.size, every) / signal.samples_per_rev
    times = phase.times_at(np.minimum(revolution, phase.revolutions[-1]))
    values, clipped = signal.values - signal.values.mean(), 0.0
    given = _arguments(signal.angle_rad, orders, signal.samples_per_rev)
    bandwidth = _widths(values, given, noise, bandwidth_orders)
    if segment.health is not None and segment.health.missing.any():
        amplitude, std, quantile = _track_in_time(segment, segment.health, orders, bandwidth, times)
        clipped = float(segment.health.clipped.mean())
    else:
        amplitude, std = _tracked(values, given, noise, bandwidth, every)
        quantile = _quantile([line.line.noise_degrees for line in lines])[:, None]
    turn = [machine.phase_std_rad(times, bandwidth_orders=float(width)) for width in bandwidth]
    std = np.sqrt(std**2 + (orders[:, None] * np.array(turn) * np.abs(amplitude)) ** 2 / 2)
    return xr.Dataset(
        {
            "complex_amplitude": (("track", "output"), amplitude),
            "std": (("track", "output"), std, {"long_name": "of the real and of the imaginary part"}),
            "half_width": (("track", "output"), quantile * std, {"confidence": CONFIDENCE}),
        },
        coords={
            "track_channel": ("track", [line.channel for line in lines]),
            "track_units": ("track", [line.units for line in lines]),
            "track_order": ("track", orders),
            "bandwidth_orders": ("track", bandwidth),
            "clipped_share": ("track", np.full(orders.size, clipped)),
            "component": ("track", [line.expected.component for line in lines]),
            "kind": ("track", [line.expected.kind for line in lines]),
            "harmonic": ("track", [line.expected.harmonic for line in lines]),
            "sideband": ("track", [line.expected.sideband for line in lines]),
            "revolution": ("output", revolution),
            "time_s": ("output", times, {"units": "s"}),
        },
        attrs={"method": "smoother", "poles": _POLES},
    )


def _arguments(angle: Numbers, orders: Numbers, samples_per_rev: float) -> dict[str, Any]:
    return {"phase_rad": angle, "orders": orders, "samples_per_rev": samples_per_rev, "poles": _POLES}


def _widths(
    values: Numbers, given: dict[str, Any], noise: Numbers, bandwidth: float | None, largest: float = _LARGEST_BANDWIDTH
) -> Numbers:
    """Return the bandwidth of each line in orders: as given, or of maximum likelihood."""
    if bandwidth is not None:
        return np.full(noise.shape, bandwidth)
    return likely_bandwidth(values, **given, noise_variance=noise, largest_bandwidth_orders=largest)


def _tracked(
    values: Numbers, given: dict[str, Any], noise: Numbers, widths: Numbers, every: int
) -> tuple[NDArray[np.complex128], Numbers]:
    """Return amplitudes over angle and their standard deviations, for lines with known noise."""
    found = track_orders(
        values, **given, bandwidth_orders=widths, output_every=every, noise_variance=1.0, method="fast"
    )
    return found.complex_amplitude, found.std * np.sqrt(noise)[:, None]


def _quantile(independent_bins: Sequence[float]) -> Numbers:
    """Return Student's t for lines whose noise is the median of a number of bins, with two degrees of freedom each."""
    return np.asarray(stdtrit(2 * np.array(independent_bins), 0.5 + CONFIDENCE / 2))


def _track_in_time(
    segment: Segment, health: SensorHealth, orders: Numbers, widths: Numbers, times: Numbers
) -> tuple[NDArray[np.complex128], Numbers, Numbers]:
    """Track lines and the mean in the time domain, with clipped samples as censored data and without missing ones.

    Resampling would spread each such sample over the length of its filter. Outputs are at most a sixteenth of the
    inverse bandwidth apart, so that linear interpolation to the times of the other channels has an error of at most 0.5
    % of the change.
    """
    machine, when = segment.machine, segment.when
    phase = machine.phase
    widest = max(float(widths.max()), 1 / _SLOWEST_OUTPUT_REV)
    taken = when.start_s + np.arange(when.count) / when.rate_hz
    inside = (taken >= max(phase.start_s, times[0])) & (taken <= phase.stop_s)
    values = np.where(health.lost | health.spiked, np.float64(np.nan), segment.values)
    limits = None
    if health.clipped.any():
        ends, reached = (np.nanmin(values), np.nanmax(values)), values[health.clipped]
        limits = [end if end in reached else beyond for end, beyond in zip(ends, (-np.inf, np.inf), strict=True)]
    tracks = track_orders(
        values[inside],
        phase_rad=phase.angle_rad(taken[inside]),
        orders=np.append(0.0, orders),
        bandwidth_orders=np.append(widths.min(), widths),
        rate_hz=when.rate_hz,
        output_every=max(1, int(when.rate_hz / (_OUTPUTS_A_BANDWIDTH * widest * machine.top_speed_hz))),
        poles=_POLES,
        method="auto" if np.isnan(values).any() else "fast",
        clip_limits=limits,
    )
    at = taken[inside][tracks.sample_index]
    amplitude = np.array([np.interp(times, at, row) for row in tracks.complex_amplitude[1:]])
    known = (tracks.std, tracks.half_width(CONFIDENCE))
    std, reach = (np.array([np.interp(times, at, row) for row in rows[1:]]) for rows in known)
    return amplitude, std, reach / std


def output_step_rev(revolutions: float) -> float:
    """Return the revolutions between outputs, a step that all channels of a part share, at least 1/8."""
    enough = revolutions / _MOST_OUTPUTS
    return next((step for step in _STEPS_REV if step >= enough), math.ceil(enough))


def joined_tracks(tables: Sequence[tuple[int, xr.Dataset]]) -> xr.Dataset:
    """Return the tracks of numbered segments on one axis; NaN where a line is not tracked."""
    if not tables:
        return xr.Dataset()
    first = tables[0][1]
    about = [str(name) for name in first.coords if first[name].dims == ("track",)]
    own = [name for name in about if name not in _OF_A_SEGMENT]
    revolutions: dict[int, Numbers] = {}
    rows: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for part, table in tables:
        there = np.round(table["revolution"].to_numpy(), _DECIMALS)
        revolutions[part] = np.union1d(revolutions.get(part, there[:0]), there)
        for place in range(table.sizes["track"]):
            described = {name: table[name].to_numpy()[place] for name in about}
            rows.setdefault(tuple(described[name] for name in own), []).append(described)
    if len(tables) == 1 and len(rows) == first.sizes["track"]:
        return first
    revolutions = dict(sorted(revolutions.items()))
    starts = dict(zip(revolutions, np.cumsum([0, *(one.size for one in revolutions.values())]), strict=False))
    size = sum(one.size for one in revolutions.values())
    values = {str(name): np.full((len(rows), size), np.nan, dtype=first[name].dtype) for name in first.data_vars}
    revolution, times = np.concatenate(list(revolutions.values())), np.full(size, np.nan)
    names = list(rows)
    for part, table in tables:
        at = starts[part] + np.searchsorted(revolutions[part], np.round(table["revolution"].to_numpy(), _DECIMALS))
        times[at] = table["time_s"].to_numpy()
        for place in range(table.sizes["track"]):
            row = names.index(tuple(table[name].to_numpy()[place] for name in own))
            known = ~np.isnan(table["complex_amplitude"].to_numpy()[place])
            for name, into in values.items():
                into[row, at[known]] = table[name].to_numpy()[place][known]
    coords: dict[str, Any] = {}
    for name in about:
        given = [np.array([one[name] for one in some]) for some in rows.values()]
        middle = [np.median(one) if one.dtype.kind == "f" else one[0] for one in given]
        coords[name] = ("track", np.array(middle), first[name].attrs)
    coords |= {"revolution": ("output", revolution), "time_s": ("output", times, {"units": "s"})}
    data = {name: (("track", "output"), into, first[name].attrs) for name, into in values.items()}
    # channels of other rates begin or end some outputs later or earlier
    complete = np.flatnonzero(~np.isnan(values["complex_amplitude"]).any(axis=0))
    begin, end = (complete[0], complete[-1] + 1) if complete.size else (0, size)
    shared = slice(begin if begin <= _ENDS else 0, end if size - end <= _ENDS else size)
    return xr.Dataset(data, coords=coords, attrs=first.attrs).isel(output=shared)


# ---- Lines of diagnosed and indicated parts in an envelope ---------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class EnvelopeLine:
    """Line of a component in the envelope of a band.

    `order` is the nominal one; `largest_slip` its largest relative deviation, 0 if the line is locked to a shaft.
    `values` is the envelope in `units`, sampled uniformly over the angle of the reference.
    """

    component: str
    kind: str
    channel: str
    units: str
    order: float
    harmonic: int
    band_hz: tuple[float, float]
    largest_slip: float
    values: Numbers
    samples_per_rev: float
    start_rev: float


def bearing_line(segment: Segment, part: PartEvidence, *, slip: float) -> EnvelopeLine:
    """Return the fundamental of a bearing defect in the envelope of its band, with sufficient sampling."""
    when, band = segment.when, (part.band_low_hz, part.band_high_hz)
    rate_hz, envelope = segment.envelope(band)
    at = replace(when, rate_hz=rate_hz, count=envelope.size)
    last = (1 + slip) * part.order + _MARGIN_ORDERS
    (signal,) = resample_in_angle([envelope], at, segment.name, segment.machine.phase, last, multiple_of=1)
    return EnvelopeLine(
        component=part.component,
        kind=part.kind,
        channel=segment.name,
        units=segment.units,
        order=part.order,
        harmonic=1,
        band_hz=band,
        largest_slip=slip,
        values=signal.values,
        samples_per_rev=signal.samples_per_rev,
        start_rev=signal.start_rev,
    )


def tooth_line(segment: Segment, component: str, tooth: ToothEnvelope) -> EnvelopeLine:
    """Return the line of a tooth in the envelope of the residual without meshes and shafts.

    It is the lowest harmonic of the tooth's contact rate that run-out of a sound gear does not also produce.
    """
    energies, order = tooth.energies, tooth.harmonic * tooth.order
    envelope = np.sqrt(energies.values[0])
    lines = np.asarray(fft.rfft(envelope))
    turns = envelope.size / energies.samples_per_rev
    size = min(envelope.size, 2 * math.ceil((order + _MARGIN_ORDERS) * turns))
    low, high = energies.edges * segment.machine.mean_speed_hz
    return EnvelopeLine(
        component=component,
        kind="tooth",
        channel=segment.name,
        units=segment.units,
        order=order,
        harmonic=tooth.harmonic,
        band_hz=(float(low), float(high)),
        largest_slip=0.0,
        values=np.asarray(fft.irfft(lines[: size // 2 + 1], size)) * (size / envelope.size),
        samples_per_rev=size / turns,
        start_rev=energies.start_rev,
    )


def track_envelope_lines(
    lines: Sequence[EnvelopeLine], machine: Machine, *, bandwidth_orders: float | None = None
) -> xr.Dataset:
    """Return the amplitude of component lines in their envelopes over time, with its standard deviation.

    A slipping line is followed by `signals.harmonics.track_slipping_order`, one locked to a shaft by the smoother of
    `track_orders`, both at the maximum-likelihood bandwidth.

    Parameters
    ----------
    lines : sequence of EnvelopeLine
    machine : Machine
        Angle of the reference.
    bandwidth_orders : float, optional
        Full -3 dB width of the smoothers in orders; None for the maximum-likelihood one of each line.

    Returns
    -------
    xarray.Dataset
        ``complex_amplitude``, ``std`` (of the amplitude), ``half_width`` (of its 95 % interval), ``slip`` and
        ``slip_std`` (track, output), with the identity of each line as coordinates; ``level`` is the mean of the
        envelope, so that ``abs(complex_amplitude) / level`` is the modulation depth. Empty without lines.
    """
    if not lines:
        return xr.Dataset()
    first = min(line.start_rev for line in lines)
    last = max(line.start_rev + (line.values.size - 1) / line.samples_per_rev for line in lines)
    revolution = np.linspace(first, last, _MOST_OUTPUTS)
    phase = machine.phase
    times = phase.times_at(np.clip(revolution, phase.revolutions[0], phase.revolutions[-1]))
    tracks = [_track_envelope_line(line, revolution, bandwidth_orders) for line in lines]
    whole = xr.concat(tracks, dim="track")
    return whole.assign_coords(revolution=("output", revolution), time_s=("output", times, {"units": "s"}))


def _track_envelope_line(line: EnvelopeLine, revolution: Numbers, bandwidth: float | None) -> xr.Dataset:
    level = float(line.values.mean())
    values = line.values - level
    angle = 2 * np.pi * (line.start_rev + np.arange(values.size) / line.samples_per_rev)
    grid = (revolution - line.start_rev) * line.samples_per_rev
    beyond = line.samples_per_rev  # a turn at most is missing at the ends of channels of other rates
    outside = (grid < -beyond) | (grid > values.size - 1 + beyond)
    largest = min(_LARGEST_BANDWIDTH, line.order / _CYCLES_A_BANDWIDTH)
    if line.largest_slip:
        amplitude, std, slip, slip_std, bandwidth, method = _followed(line, values, angle, grid, largest, bandwidth)
        quantile = _quantile([values.size / 2])  # the noise is what is left of all samples
    else:
        amplitude, std, quantile, bandwidth, method = _smoothed(line, values, angle, grid, largest, bandwidth)
        slip = slip_std = np.zeros(grid.size)
    amplitude, std, slip, slip_std = (np.where(outside, np.nan, row) for row in (amplitude, std, slip, slip_std))
    of = {name: getattr(line, name) for name in ("component", "kind", "harmonic")}
    of |= {"track_channel": line.channel, "track_units": line.units, "track_order": line.order, "sideband": 0}
    of |= {"band_low_hz": line.band_hz[0], "band_high_hz": line.band_hz[1], "method": method}
    of |= {"bandwidth_orders": bandwidth, "level": level}
    return xr.Dataset(
        {
            "complex_amplitude": (("track", "output"), amplitude[None]),
            "std": (("track", "output"), std[None], {"long_name": "of the amplitude"}),
            "half_width": (("track", "output"), quantile * std[None], {"confidence": CONFIDENCE}),
            "slip": (("track", "output"), slip[None], {"units": "1", "long_name": "relative to the nominal order"}),
            "slip_std": (("track", "output"), slip_std[None], {"units": "1"}),
        },
        coords={name: ("track", [value]) for name, value in of.items()},
    )


def _followed(
    line: EnvelopeLine, values: Numbers, angle: Numbers, grid: Numbers, largest: float, bandwidth: float | None
) -> tuple[NDArray[np.complex128], Numbers, Numbers, Numbers, float, str]:
    """Track a slipping line: first its angle, then, along it, at the maximum-likelihood bandwidth."""

    def follow(width: float, steps: int = _MOST_STEPS) -> SlippingTrack:
        return track_slipping_order(
            values,
            phase_rad=angle,
            order=line.order,
            largest_slip=line.largest_slip,
            slip_change_per_rev=_SLIP_CHANGE,
            bandwidth_orders=width,
            samples_per_rev=line.samples_per_rev,
            most_iterations=steps,
        )

    track = follow(bandwidth) if bandwidth else follow(largest, _FIRST_STEPS)
    if bandwidth is None:
        slipped = line.order * angle + np.interp(np.arange(values.size), track.sample_index, track.slip_phase_rad)
        (bandwidth,) = likely_bandwidth(
            values,
            phase_rad=slipped,
            orders=[1],
            samples_per_rev=line.samples_per_rev,
            noise_variance=[track.noise_variance],
            largest_bandwidth_orders=largest,
        ).tolist()
        track = follow(bandwidth)
    amplitude = np.asarray(np.interp(grid, track.sample_index, track.complex_amplitude[0]))
    std, slip, slip_std = (
        np.asarray(np.interp(grid, track.sample_index, row))
        for row in (track.amplitude_std[0], track.slip, track.slip_std)
    )
    return amplitude, std, slip, slip_std, float(bandwidth), f"slipping order, {track.status}"


def _smoothed(
    line: EnvelopeLine, values: Numbers, angle: Numbers, grid: Numbers, largest: float, bandwidth: float | None
) -> tuple[NDArray[np.complex128], Numbers, Numbers, float, str]:
    """Track a line that is locked to a shaft."""
    spectrum = amplitude_spectrum(values, rate=line.samples_per_rev)
    near = find_line(spectrum, expected=line.order, background_width=min(1.0, _BACKGROUND_SHARE * line.order))
    noise = np.array([2 * near.amplitude_std**2 * values.size / (4 * spectrum.noise_bandwidth_bins)])
    every = max(1, int(line.samples_per_rev / (_OUTPUTS_A_BANDWIDTH * largest)))
    given = _arguments(angle, np.array([line.order]), line.samples_per_rev)
    width = _widths(values, given, noise, bandwidth, largest)
    tracked, std = _tracked(values, given, noise, width, every)
    at = np.arange(0, values.size, every)
    amplitude, spread = np.interp(grid, at, tracked[0]), np.asarray(np.interp(grid, at, std[0]))
    return amplitude, spread, _quantile([near.noise_degrees]), float(width[0]), "smoother"
