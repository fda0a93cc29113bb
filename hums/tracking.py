"""Amplitude and phase, revolution by revolution, of the lines that are locked to a shaft."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.channels import AnalysedChannel, living_values
from hums.judging import JudgedLine
from hums.machine import Machine
from hums.orders import BEARING_KINDS
from hums.record import sampling
from hums.search import ORDER_SPECTRUM, FoundLine
from signals.harmonics import OrderTracks, track_orders
from signals.harmonics.likelihood import likely_bandwidth
from signals.resampling import AngularSignal
from signals.spectra import AmplitudeSpectrum

_MOST_OUTPUTS = 200
_STEPS_REV = (0.125, 0.25, 0.5)
_LARGEST_BANDWIDTH = 0.1  # orders; the most likely one is looked for below this
_POLES = 2  # amplitudes that vary smoothly; a passband with steep sides, so that neighbours stay out
_OUTPUTS_A_BANDWIDTH = 16.0
_SLOWEST_OUTPUT_REV = 8.0


def tracked_lines(judged: Iterable[JudgedLine], *, most: int) -> list[FoundLine]:
    """Return the strongest claimed lines of the order spectrum, one an order, by ascending order."""
    claimed = [line.found for line in judged if line.claimed and line.found.wanted.kind not in BEARING_KINDS]
    locked = [line for line in claimed if line.wanted.spectrum == ORDER_SPECTRUM]
    strongest = sorted(locked, key=lambda line: -line.line.snr)
    chosen: list[FoundLine] = []
    for line in strongest:
        if all(abs(line.wanted.order - other.wanted.order) > line.bin_width for other in chosen):
            chosen.append(line)
    return sorted(chosen[:most], key=lambda line: line.wanted.order)


def track_lines(
    record: xr.Dataset,
    channel: AnalysedChannel,
    machine: Machine,
    lines: Sequence[FoundLine],
    *,
    bandwidth_orders: float | None,
) -> xr.Dataset:
    """Track lines of one channel with the Kalman smoother, each with the noise found beside it.

    Parameters
    ----------
    record : the record, for the samples themselves where some of them are missing.
    channel : over angle, with its order spectrum and the health of its sensor.
    machine : whose reference the orders count.
    lines : what to track, at nominal orders; at the orders found where the speed is nominal.
    bandwidth_orders : full -3 dB width of the smoother; None for the most likely one of each line.

    Returns
    -------
    xarray.Dataset
        Complex amplitude and `std` (track, output), with what each track is as coordinates. `std` holds the noise
        beside the line and what the uncertainty of the shaft's angle makes of its amplitude.
    """
    signal, phase = channel.signal, machine.phase
    orders = np.array([line.line.found if phase.nominal else line.wanted.order for line in lines])
    noise = _local_noise(signal, channel.spectra[ORDER_SPECTRUM], lines)
    bandwidth: NDArray[np.float64] | float | None = bandwidth_orders
    if bandwidth is None:
        bandwidth = likely_bandwidth(
            signal.values - signal.values.mean(),
            phase_rad=signal.angle_rad,
            orders=orders,
            samples_per_rev=signal.samples_per_rev,
            noise_variance=noise,
            largest_bandwidth_orders=_LARGEST_BANDWIDTH,
            poles=_POLES,
        )
    every = _output_every(signal)
    revolution = signal.start_rev + np.arange(0, signal.values.size, every) / signal.samples_per_rev
    times = phase.times_at(np.minimum(revolution, phase.revolutions[-1]))
    gaps = channel.health is not None and bool(channel.health.missing.any())
    tracks = _with_gaps if gaps else _whole
    amplitude, std, found = tracks(record, channel, machine, orders, bandwidth, noise, times)
    turn = [machine.phase_std_rad(times, bandwidth_orders=float(width)) for width in found.bandwidth]
    std = np.sqrt(std**2 + (orders[:, None] * np.array(turn) * np.abs(amplitude)) ** 2 / 2)
    return xr.Dataset(
        {
            "complex_amplitude": (("track", "output"), amplitude),
            "std": (("track", "output"), std, {"long_name": "of the real and of the imaginary part"}),
        },
        coords={
            "track_channel": ("track", [line.channel for line in lines]),
            "track_units": ("track", [line.units for line in lines]),
            "track_order": ("track", orders),
            "bandwidth_orders": ("track", found.bandwidth),
            "component": ("track", [line.wanted.component for line in lines]),
            "kind": ("track", [line.wanted.kind for line in lines]),
            "harmonic": ("track", [line.wanted.harmonic for line in lines]),
            "sideband": ("track", [line.wanted.sideband for line in lines]),
            "revolution": ("output", revolution),
            "time_s": ("output", times, {"units": "s"}),
        },
        attrs={"method": found.method, "poles": found.poles},
    )


_Tracked = tuple[NDArray[np.complex128], NDArray[np.float64], OrderTracks]


def _whole(
    _record: xr.Dataset,
    channel: AnalysedChannel,
    _machine: Machine,
    orders: NDArray[np.float64],
    bandwidth: NDArray[np.float64] | float,
    noise: NDArray[np.float64],
    _times: NDArray[np.float64],
) -> _Tracked:
    """Track over even steps of angle."""
    signal = channel.signal
    tracks = track_orders(
        signal.values - signal.values.mean(),
        phase_rad=signal.angle_rad,
        orders=orders,
        bandwidth_orders=bandwidth,
        samples_per_rev=signal.samples_per_rev,
        output_every=_output_every(signal),
        poles=_POLES,
    )
    # the tracker's own uncertainty rests on the mean noise over all orders; each line has its own surroundings
    return tracks.complex_amplitude, tracks.std * np.sqrt(noise / tracks.noise_variance)[:, None], tracks


def _with_gaps(
    record: xr.Dataset,
    channel: AnalysedChannel,
    machine: Machine,
    orders: NDArray[np.float64],
    bandwidth: NDArray[np.float64] | float,
    noise: NDArray[np.float64],
    times: NDArray[np.float64],
) -> _Tracked:
    """Track over the samples as they were taken, those that hold nothing of the machine missing.

    Resampling would spread each of them over its filter. Outputs are interpolated to the times of the others: a
    sixteenth of the inverse bandwidth apart, or less, so that the line between two of them errs by 0.5 % of what
    changes, at most. What repeats with the shaft is often missing at the same angles: then the tracker takes short
    blocks, and all orders together.
    """
    phase, missing = machine.phase, channel.health.missing if channel.health else np.zeros(0, dtype=np.bool_)
    when = sampling(record, channel.name)
    taken = when.start_s + np.arange(when.count) / when.rate_hz
    inside = (taken >= max(phase.start_s, times[0])) & (taken <= phase.stop_s)
    values = np.where(missing, np.float64(np.nan), living_values(record, channel.name))[inside]
    widest = max(float(np.max(bandwidth)), 1 / _SLOWEST_OUTPUT_REV)
    tracks = track_orders(
        values - np.nanmean(values),
        phase_rad=phase.angle_rad(taken[inside]),
        orders=orders,
        bandwidth_orders=bandwidth,
        rate_hz=when.rate_hz,
        output_every=max(1, int(when.rate_hz / (_OUTPUTS_A_BANDWIDTH * widest * machine.top_speed_hz))),
        poles=_POLES,
    )
    at = taken[inside][tracks.sample_index]
    amplitude = np.array([np.interp(times, at, row) for row in tracks.complex_amplitude])
    std = np.array([np.interp(times, at, row) for row in tracks.std])
    density = np.count_nonzero(inside) / channel.signal.values.size  # samples here to one over angle
    return amplitude, std * np.sqrt(noise * density / tracks.noise_variance)[:, None], tracks


def _output_every(signal: AngularSignal) -> int:
    """Return the samples between outputs: a step in revolutions that all channels share, an eighth at the least."""
    enough = signal.revolutions / _MOST_OUTPUTS
    step = next((step for step in _STEPS_REV if step >= enough), math.ceil(enough))
    return round(step * signal.samples_per_rev)


def _local_noise(signal: AngularSignal, spectrum: AmplitudeSpectrum, lines: Sequence[FoundLine]) -> NDArray[np.float64]:
    """Return the variance of white noise as dense as the surroundings of each line.

    A Hann line of white noise with variance R has mean power 4 R ENBW / n, so the background tells R.
    """
    power = np.array([2 * line.line.amplitude_std**2 for line in lines])
    return power * signal.values.size / (4 * spectrum.noise_bandwidth_bins)
