"""Complex amplitude over time of the shaft-synchronous lines of a channel."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.analysis.channel import AnalysedChannel, varying_values
from hums.analysis.detection import AssessedLine
from hums.analysis.lines import ORDER_SPECTRUM, MeasuredLine
from hums.analysis.reference_angle import Machine
from hums.gearbox.orders import BEARING_KINDS
from hums.records.record import sampling
from signals.harmonics import OrderTracks, track_orders
from signals.harmonics.bandwidth_selection import likely_bandwidth
from signals.resampling.resampling import AngularSignal
from signals.spectra.spectra import AmplitudeSpectrum

_MOST_OUTPUTS = 200
_STEPS_REV = (0.125, 0.25, 0.5)
_LARGEST_BANDWIDTH = 0.1  # orders; the most likely one is looked for below this
_POLES = 2  # amplitudes that vary smoothly; a passband with steep sides, so that neighbours stay out
_OUTPUTS_A_BANDWIDTH = 16.0
_SLOWEST_OUTPUT_REV = 8.0


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
    record: xr.Dataset,
    channel: AnalysedChannel,
    machine: Machine,
    lines: Sequence[MeasuredLine],
    *,
    bandwidth_orders: float | None,
) -> xr.Dataset:
    """Return the complex amplitude of lines of one channel from the Kalman smoother, with its standard deviation.

    Parameters
    ----------
    record : xarray.Dataset
        The record, whose samples in time are used where some are missing.
    channel : AnalysedChannel
        The channel in the angle domain, with its order spectrum and sensor health.
    machine : Machine
        Kinematics and angle of the reference.
    lines : sequence of MeasuredLine
        Lines to track, at their expected orders; at their measured orders where the speed is nominal.
    bandwidth_orders : float, optional
        Full -3 dB width of the smoother in orders; None for the maximum-likelihood one of each line.

    Returns
    -------
    xarray.Dataset
        ``complex_amplitude`` and ``std`` (track, output), with the identity of each track as coordinates. ``std``
        contains the noise around the line and the effect of the shaft angle's uncertainty on its amplitude.
    """
    signal, phase = channel.signal, machine.phase
    orders = np.array([line.line.found if phase.nominal else line.expected.order for line in lines])
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
    tracks = _track_in_time if gaps else _track_in_angle
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
            "component": ("track", [line.expected.component for line in lines]),
            "kind": ("track", [line.expected.kind for line in lines]),
            "harmonic": ("track", [line.expected.harmonic for line in lines]),
            "sideband": ("track", [line.expected.sideband for line in lines]),
            "revolution": ("output", revolution),
            "time_s": ("output", times, {"units": "s"}),
        },
        attrs={"method": found.method, "poles": found.poles},
    )


_Tracked = tuple[NDArray[np.complex128], NDArray[np.float64], OrderTracks]


def _track_in_angle(
    _record: xr.Dataset,
    channel: AnalysedChannel,
    _machine: Machine,
    orders: NDArray[np.float64],
    bandwidth: NDArray[np.float64] | float,
    noise: NDArray[np.float64],
    _times: NDArray[np.float64],
) -> _Tracked:
    """Track lines in the angle domain."""
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
    # the tracker's std assumes the mean noise over all orders; each line has the noise of its own background
    return tracks.complex_amplitude, tracks.std * np.sqrt(noise / tracks.noise_variance)[:, None], tracks


def _track_in_time(
    record: xr.Dataset,
    channel: AnalysedChannel,
    machine: Machine,
    orders: NDArray[np.float64],
    bandwidth: NDArray[np.float64] | float,
    noise: NDArray[np.float64],
    times: NDArray[np.float64],
) -> _Tracked:
    """Track lines in the time domain, where the tracker can leave out the missing samples.

    Resampling would spread each missing sample over the length of its filter. Outputs are at most a sixteenth of the
    inverse bandwidth apart, so that linear interpolation to the times of the other channels errs by at most 0.5 % of
    the change.
    """
    phase, missing = machine.phase, channel.health.missing if channel.health else np.zeros(0, dtype=np.bool_)
    when = sampling(record, channel.name)
    taken = when.start_s + np.arange(when.count) / when.rate_hz
    inside = (taken >= max(phase.start_s, times[0])) & (taken <= phase.stop_s)
    values = np.where(missing, np.float64(np.nan), varying_values(record, channel.name))[inside]
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
    """Return the number of samples between outputs: a step in revolutions that all channels share, at least 1/8."""
    enough = signal.revolutions / _MOST_OUTPUTS
    step = next((step for step in _STEPS_REV if step >= enough), math.ceil(enough))
    return round(step * signal.samples_per_rev)


def _local_noise(
    signal: AngularSignal, spectrum: AmplitudeSpectrum, lines: Sequence[MeasuredLine]
) -> NDArray[np.float64]:
    """Return the variance of white noise whose density is that of the background of each line.

    White noise of variance R has the mean square amplitude 4 R ENBW / n in a windowed spectrum of n samples.
    """
    power = np.array([2 * line.line.amplitude_std**2 for line in lines])
    return power * signal.values.size / (4 * spectrum.noise_bandwidth_bins)
