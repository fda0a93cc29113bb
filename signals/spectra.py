"""Spectra over frequency or order, of whole records and averaged: scaling, window and resolution stated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from scipy import fft

from signals._checks import Array, Samples, choice, number, positive, real_vector, whole
from signals._plans import forget_plans
from signals._windows import Window, window_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray

    from signals.resampling import AngularSignal

PADDING = 8  # zero padding; the grid then meets a Hann line within 0.25 % of its height, a parabola within 0.003 %
_CHUNK = 2**18  # samples transformed at a time

Scaling = Literal["peak", "rms", "density"]


@dataclass(frozen=True, kw_only=True)
class AmplitudeSpectrum:
    """Peak amplitude against frequency (Hz) or order, interpolated by zero padding.

    ``resolution`` is the window's full -3 dB width; ``bin_width`` is one over the length of the record, in
    the axis' unit, and the grid is finer than it by the padding. A line is ``Re{complex_amplitude exp(j 2 pi axis u)}``
    with u the time or the turns of the shaft; off the grid by d bins its phase is off by pi d, since the grid's
    frequency and the line's part between u = 0 and the middle of the record.
    """

    axis: Array = field(metadata={"dims": ("line",), "units": "Hz or order"})
    amplitude: Array = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    complex_amplitude: NDArray[np.complex128] = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    bin_width: float
    resolution: float
    window: str
    noise_bandwidth_bins: float  # equivalent noise bandwidth of the window
    spread: float  # second moment of the squared window about its middle, over length squared: see signals.lines

    @property
    def phase_rad(self) -> Array:
        """Phase of each line at u = 0, (line,), in rad."""
        return np.asarray(np.angle(self.complex_amplitude), dtype=np.float64)


def amplitude_spectrum(
    values: ArrayLike,
    *,
    rate: float,
    window: str = "hann",
    padding: int = PADDING,
    maximum: float | None = None,
    start: float = 0.0,
) -> AmplitudeSpectrum:
    """Return the peak amplitude spectrum of a record with its mean removed.

    Parameters
    ----------
    values : (n,) array
    rate : float
        Samples a second for an axis in Hz, samples a revolution for one in orders.
    window : str
        A window of `scipy.signal`; the amplitude is corrected for its mean, so a line reads its true peak.
    padding : int
        How many times finer than one over the record the axis is.
    maximum : float, optional
        Where the axis ends; default half of `rate`.
    start : float
        Time (s) or angle (revolutions) of the first sample; phases are those at zero.
    """
    signal = real_vector(values, name="the signal", minimum=4)
    rate = positive(rate, name="rate")
    padding = whole(padding, name="padding", least=1)
    start = number(start, name="start")
    shape = window_of(window, signal.size)
    length = signal.size * padding
    lines = fft.rfft(without_mean(signal) * shape.weights, length)
    forget_plans(length)
    axis = np.arange(lines.size, dtype=np.float64) * (rate / length)
    keep = slice(None) if maximum is None else slice(int(np.searchsorted(axis, maximum, side="right")))
    axis, lines = axis[keep], lines[keep] * (2 / shape.weights.sum())
    if start:
        lines *= np.exp(-2j * np.pi * np.mod(axis * start, 1.0))
    return AmplitudeSpectrum(
        axis=np.asarray(axis),
        amplitude=np.abs(lines),
        complex_amplitude=np.asarray(lines, dtype=np.complex128),
        bin_width=rate / signal.size,
        resolution=shape.width_bins * rate / signal.size,
        window=window,
        noise_bandwidth_bins=shape.noise_bandwidth_bins,
        spread=shape.spread,
    )


def order_spectrum(
    signal: AngularSignal, *, window: str = "hann", padding: int = PADDING, max_order: float | None = None
) -> AmplitudeSpectrum:
    """Return the peak amplitude spectrum of an angular signal over orders, up to its passband.

    Phases are those at the tachometer's datum, where the shaft's angle is zero.
    """
    return amplitude_spectrum(
        signal.values,
        rate=signal.samples_per_rev,
        window=window,
        padding=padding,
        maximum=_last_order(signal, max_order),
        start=signal.start_rev,
    )


@dataclass(frozen=True, kw_only=True)
class AveragedSpectrum:
    """Power averaged over segments, as its density, or as the rms or peak amplitude of a line.

    For noise the power lies from ``low`` to ``high`` with probability `confidence`; a steady line is known better.
    ``degrees_of_freedom`` counts what overlapping segments share once. `density` integrates over the axis to the
    variance; `rms` and `peak` read a line that stands on the grid, the window's mean corrected for, and grow with
    ``sqrt(noise_bandwidth)`` on noise.
    """

    axis: Array = field(metadata={"dims": ("line",), "units": "Hz or order"})
    value: Array = field(metadata={"dims": ("line",), "units": "as the record, or squared over the axis' unit"})
    low: Array = field(metadata={"dims": ("line",), "units": "as value"})
    high: Array = field(metadata={"dims": ("line",), "units": "as value"})
    scaling: Scaling
    confidence: float
    averages: int
    degrees_of_freedom: float
    bin_width: float
    resolution: float
    noise_bandwidth: float  # of a line, in the axis' unit
    window: str


def averaged_spectrum(
    values: ArrayLike,
    *,
    rate: float,
    segment: int,
    overlap: float = 0.5,
    window: str = "hann",
    scaling: Scaling = "density",
    confidence: float = 0.95,
    maximum: float | None = None,
) -> AveragedSpectrum:
    """Return the power spectrum averaged over segments (Welch 1967), with its chi-square interval.

    Parameters
    ----------
    values : (n,) array
        Its mean is removed once, over the whole record.
    rate : float
        Samples a second for an axis in Hz, samples a revolution for one in orders.
    segment : int
        Samples of a segment: `resolution` is the window's width over its length. What the last one does not fill is
        left out.
    overlap : float
        Part of a segment that the next one shares, from 0 to below 1.
    window : str
        A window of `scipy.signal`.
    scaling : str
        ``density`` (one-sided, units squared over the axis' unit), ``rms`` or ``peak``.
    confidence : float
        Probability of the interval, between 0 and 1.
    maximum : float, optional
        Where the axis ends; default half of `rate`.

    Notes
    -----
    Segments k hops apart correlate by ``rho_k^2``, rho_k the normalised correlation of the window with itself, so K of
    them are worth ``2 K / (1 + 2 sum (1 - k / K) rho_k^2)`` degrees of freedom (Welch 1967); half of that at zero
    and at half the rate, where a line is real.
    """
    signal = real_vector(values, name="the signal", minimum=4)
    rate = positive(rate, name="rate")
    length = whole(segment, name="segment", least=4, most=signal.size)
    choice(scaling, name="scaling", choices=get_args(Scaling))
    if not 0 < number(confidence, name="confidence") < 1:
        raise ValueError(f"confidence={confidence!r} must lie between 0 and 1: the probability of the interval.")
    shape = window_of(window, length)
    hop = hop_of(length, overlap)
    axis = np.arange(length // 2 + 1, dtype=np.float64) * (rate / length)
    power, count = np.zeros(axis.size), 0
    for lines in transformed(without_mean(signal), shape, hop):
        power += np.sum(lines.real**2 + lines.imag**2, axis=0)
        count += len(lines)
    alike = shape.overlap_correlation(hop)[: count - 1]
    degrees = 2 * count / (1 + 2 * np.sum((1 - np.arange(1, alike.size + 1) / count) * alike**2))
    each = np.where(_real_lines(length), degrees / 2, degrees)
    keep = slice(None) if maximum is None else slice(int(np.searchsorted(axis, maximum, side="right")))
    value = scaled_power(power / count, shape, rate=rate, scaling=scaling)[keep]
    lower, upper = (_chi_square(each[keep], p) / each[keep] for p in ((1 + confidence) / 2, (1 - confidence) / 2))
    root = 1.0 if scaling == "density" else 0.5
    return AveragedSpectrum(
        axis=axis[keep],
        value=value,
        low=value / lower**root,
        high=value / upper**root,
        scaling=scaling,
        confidence=float(confidence),
        averages=count,
        degrees_of_freedom=float(degrees),
        bin_width=rate / length,
        resolution=shape.width_bins * rate / length,
        noise_bandwidth=shape.noise_bandwidth_bins * rate / length,
        window=window,
    )


def averaged_order_spectrum(
    signal: AngularSignal,
    *,
    revolutions: int,
    overlap: float = 0.5,
    window: str = "hann",
    scaling: Scaling = "density",
    confidence: float = 0.95,
    max_order: float | None = None,
) -> AveragedSpectrum:
    """Return `averaged_spectrum` over orders from segments of whole revolutions, up to the signal's passband."""
    turns = whole(revolutions, name="revolutions", least=1, most=signal.revolutions)
    return averaged_spectrum(
        signal.values,
        rate=signal.samples_per_rev,
        segment=turns * signal.samples_per_rev,
        overlap=overlap,
        window=window,
        scaling=scaling,
        confidence=confidence,
        maximum=_last_order(signal, max_order),
    )


def hop_of(length: int, overlap: float) -> int:
    """Return samples from one segment to the next, at least one."""
    if not 0 <= overlap < 1:
        raise ValueError(f"overlap = {overlap!r} must lie from 0 to below 1: the part that two segments share.")
    return max(1, round(length * (1 - overlap)))


def transformed(signal: Samples, shape: Window, hop: int) -> Iterator[NDArray[np.complex128]]:
    """Yield the Fourier lines (some, lines) of windowed segments, so many at a time that memory stays constant."""
    length = shape.weights.size
    segments = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
    some = max(1, _CHUNK // length)
    for first in range(0, len(segments), some):
        yield fft.rfft(segments[first : first + some] * shape.weights, axis=1)


def scaled_power(power: Array, shape: Window, *, rate: float, scaling: Scaling) -> Array:
    """Return ``|lines|^2`` (..., lines), from 0 on, of windowed segments as density, rms or peak."""
    sides = np.where(_real_lines(shape.weights.size), 1.0, 2.0)[: power.shape[-1]]
    if scaling == "density":
        return np.asarray(power * sides / (rate * np.sum(shape.weights**2)))
    mean_square = power * sides / shape.weights.sum() ** 2
    if scaling == "rms":
        return np.asarray(np.sqrt(mean_square))
    return np.asarray(np.sqrt(mean_square * sides))  # where a line is real its rms is its peak


def _real_lines(length: int) -> NDArray[np.bool_]:
    """Which lines of a real transform have no imaginary part."""
    real = np.zeros(length // 2 + 1, dtype=bool)
    real[0] = True
    if length % 2 == 0:
        real[-1] = True
    return real


def _chi_square(degrees: Array, probability: float) -> Array:
    """Quantile of the chi-square distribution."""
    from scipy.special import gammaincinv  # noqa: PLC0415

    return np.asarray(2 * gammaincinv(degrees / 2, probability))


def without_mean(signal: Samples) -> Samples:
    """Remove the mean, and the rounding that a large one leaves."""
    centred = signal - signal.mean(dtype=np.float64).astype(signal.dtype)
    centred -= centred.mean(dtype=np.float64).astype(signal.dtype)
    return np.asarray(centred)


def _last_order(signal: AngularSignal, max_order: float | None) -> float:
    return signal.passband_orders if max_order is None else min(max_order, signal.passband_orders)
