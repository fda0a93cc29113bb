"""Amplitude and phase, revolution by revolution, of the lines that are locked to a shaft."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.findings import JudgedLine
from hums.orders import BEARING_KINDS
from hums.search import ORDER_SPECTRUM, FoundLine
from signals.harmonics import track_orders
from signals.harmonics.likelihood import likely_bandwidth
from signals.phase import ShaftPhase
from signals.resampling import AngularSignal
from signals.spectra import AmplitudeSpectrum

_MOST_OUTPUTS = 200
_STEPS_REV = (0.125, 0.25, 0.5)
_LARGEST_BANDWIDTH = 0.1  # orders; the most likely one is looked for below this


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
    signal: AngularSignal,
    spectrum: AmplitudeSpectrum,
    phase: ShaftPhase,
    lines: Sequence[FoundLine],
    *,
    bandwidth_orders: float | None,
) -> xr.Dataset:
    """Track lines of one channel with the Kalman smoother, each with the noise found beside it.

    Parameters
    ----------
    signal, spectrum : the channel over angle, and its order spectrum.
    phase : of the reference shaft, to tell the time of each output.
    lines : what to track, at nominal orders; at the orders found where the speed is nominal.
    bandwidth_orders : full -3 dB width of the smoother; None for the most likely one of each line.

    Returns
    -------
    xarray.Dataset
        Complex amplitude and `std` (track, output), with what each track is as coordinates.
    """
    per_rev = signal.samples_per_rev
    orders = [line.line.found if phase.nominal else line.wanted.order for line in lines]
    values = signal.values - signal.values.mean()
    noise = _local_noise(signal, spectrum, lines)
    bandwidth: NDArray[np.float64] | float | None = bandwidth_orders
    if bandwidth is None:
        bandwidth = likely_bandwidth(
            values,
            phase_rad=signal.angle_rad,
            orders=orders,
            samples_per_rev=per_rev,
            noise_variance=noise,
            largest_bandwidth_orders=_LARGEST_BANDWIDTH,
        )
    tracks = track_orders(
        values,
        phase_rad=signal.angle_rad,
        orders=orders,
        bandwidth_orders=bandwidth,
        samples_per_rev=per_rev,
        output_every=_output_every(signal),
    )
    # the tracker's own uncertainty rests on the mean noise over all orders; each line has its own surroundings
    std = tracks.std * np.sqrt(noise / tracks.noise_variance)[:, None]
    revolution = signal.start_rev + tracks.sample_index / per_rev
    return xr.Dataset(
        {
            "complex_amplitude": (("track", "output"), tracks.complex_amplitude),
            "std": (("track", "output"), std, {"long_name": "of the real and of the imaginary part"}),
        },
        coords={
            "track_channel": ("track", [line.channel for line in lines]),
            "track_units": ("track", [line.units for line in lines]),
            "track_order": ("track", np.asarray(orders, dtype=np.float64)),
            "bandwidth_orders": ("track", tracks.bandwidth),
            "component": ("track", [line.wanted.component for line in lines]),
            "kind": ("track", [line.wanted.kind for line in lines]),
            "harmonic": ("track", [line.wanted.harmonic for line in lines]),
            "sideband": ("track", [line.wanted.sideband for line in lines]),
            "revolution": ("output", revolution),
            "time_s": (
                "output",
                phase.times_at(np.minimum(revolution, phase.revolutions[-1])),
                {"units": "s"},
            ),
        },
        attrs={"method": tracks.method, "poles": tracks.poles},
    )


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
