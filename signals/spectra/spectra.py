"""Amplitude spectra and averaged power spectra over frequency or order, with scaling, window and resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from scipy import fft

from signals._transforms import Window, forget_plans, window_of, without_mean
from signals._validation import Array, Samples, checked, choice, number, positive, real_vector, whole

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.resampling.resampling import AngularSignal

PADDING = 8  # the scalloping loss of a Hann line is then 0.25 %, and 0.003 % after parabolic interpolation

Scaling = Literal["peak", "rms", "density"]


@dataclass(frozen=True, kw_only=True)
class AmplitudeSpectrum:
    """Peak amplitude against frequency (Hz) or order, interpolated by zero padding.

    A line is ``Re{complex_amplitude exp(j 2 pi axis u)}``, u being time in s or angle in revolutions. The phase of a
    line d bins off the grid is in error by pi d, the phase difference of the two frequencies at the middle of the
    record.

    Attributes
    ----------
    axis : (line,) array
        Frequencies in Hz, or orders.
    amplitude, complex_amplitude : (line,) arrays
        Peak amplitude, real and complex, in the unit of the record.
    bin_width : float
        Reciprocal of the record length, in the unit of the axis; the grid is finer by the padding.
    resolution : float
        Full -3 dB width of the window, in the unit of the axis.
    window : str
        Name of the window in `scipy.signal`.
    noise_bandwidth_bins : float
        Equivalent noise bandwidth of the window in bins.
    spread : float
        Second moment of the squared window about its middle, over its length squared; see `signals.spectra.lines`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> spectrum = amplitude_spectrum(np.sin(2 * np.pi * 8 * np.arange(64) / 64), rate=64)
    >>> round(spectrum.bin_width, 6), round(spectrum.resolution, 2), round(spectrum.noise_bandwidth_bins, 6)
    (1.0, 1.44, 1.5)
    """

    axis: Array = field(metadata={"dims": ("line",), "units": "Hz or order"})
    amplitude: Array = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    complex_amplitude: NDArray[np.complex128] = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    bin_width: float
    resolution: float
    window: str
    noise_bandwidth_bins: float
    spread: float

    @property
    def phase_rad(self) -> Array:
        """Phase of each line at time or angle zero, (line,), in rad."""
        return np.asarray(np.angle(self.complex_amplitude), dtype=np.float64)


@checked
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
        Samples, any unit.
    rate : float
        Samples per second for an axis in Hz, samples per revolution for one in orders.
    window : str
        A window of `scipy.signal`; the amplitude is divided by its mean, so that a line has its true peak.
    padding : int
        Zero padding, the ratio of the bin width to the step of the axis; above 1 it is rounded up, by a few per cent at
        most, to a length with a fast transform.
    maximum : float, optional
        End of the axis, in its unit; default: half of `rate`.
    start : float
        Time in s or angle in revolutions of the first sample; phases refer to zero.

    Returns
    -------
    AmplitudeSpectrum

    Raises
    ------
    ValueError
        Fewer than four values, values that are not finite, an unknown window, or a rate, padding or maximum that is not
        positive.

    Examples
    --------
    A tone of amplitude 2 at 8 Hz:

    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> t = np.arange(1024) / 256
    >>> spectrum = amplitude_spectrum(2 * np.cos(2 * np.pi * 8 * t), rate=256)
    >>> top = np.argmax(spectrum.amplitude)
    >>> float(spectrum.axis[top]), round(float(spectrum.amplitude[top]), 6)
    (8.0, 2.0)
    """
    return _amplitude_spectra([values], rate=rate, window=window, padding=padding, maximum=maximum, start=start)[0]


def _amplitude_spectra(
    rows: Sequence[ArrayLike],
    *,
    rate: float,
    window: str,
    padding: int,
    maximum: float | None,
    start: float,
    single: bool = False,
) -> list[AmplitudeSpectrum]:
    """Return the `amplitude_spectrum` of each of several records of one length."""
    signals = [real_vector(values, name="the signal", minimum=4) for values in rows]
    size = signals[0].size
    rate = positive(rate, name="rate")
    padding = whole(padding, name="padding", least=1)
    start = number(start, name="start")
    shape = window_of(window, size)
    length = fft.next_fast_len(size * padding) if padding > 1 else size
    axis = np.arange(length // 2 + 1, dtype=np.float64) * (rate / length)
    stop = _end_of(axis, maximum)
    # scaled, since small and large units would under- or overflow in single precision
    largest = (max(float(np.abs(signal).max()) for signal in signals) if single else 0.0) or 1.0
    weights = shape.weights / largest
    axis, scale = axis[:stop], 2 * largest / shape.weights.sum()
    turned = scale * _phasors(-start * rate / length, stop) if start else scale
    noise_bandwidth_bins, spread = shape.noise_bandwidth_bins, shape.spread
    found: list[AmplitudeSpectrum] = []
    # 2**22 padded samples transformed at once, 16 MB in single precision: batched rows take a third of the time
    at_once = max(1, 2**22 // length)
    memory = np.empty(length // 2 + 1, dtype=np.complex128)
    for first in range(0, len(signals), at_once):
        some = [without_mean(signal) * weights for signal in signals[first : first + at_once]]
        # numpy pads without a copy and reuses memory; scipy takes a third of the time for several rows
        alone = len(some) == 1 and not single
        dtype = np.float32 if single else np.float64
        transformed = [np.fft.rfft(some[0], length, out=memory)] if alone else fft.rfft(_padded(some, length, dtype))
        for lines in transformed:
            turned_lines = lines[:stop] * turned
            found.append(
                AmplitudeSpectrum(
                    axis=axis,
                    amplitude=np.abs(turned_lines),
                    complex_amplitude=turned_lines,
                    bin_width=rate / size,
                    resolution=shape.width_bins * rate / size,
                    window=window,
                    noise_bandwidth_bins=noise_bandwidth_bins,
                    spread=spread,
                )
            )
    forget_plans(length)
    return found


def _padded(rows: Sequence[Array], length: int, dtype: type[np.floating]) -> Samples:
    """Return rows with zeros appended, (row, length), faster than scipy pads them."""
    padded = np.zeros((len(rows), length), dtype=dtype)
    for out, row in zip(padded, rows, strict=True):
        out[: row.size] = row
    return padded


def _phasors(turns: float, count: int) -> NDArray[np.complex128]:
    """Return ``exp(j 2 pi turns n)`` for n = 0, 1, ..., as products of coarse and fine steps.

    That takes ``2 sqrt(count)`` exponentials, each of which costs as much as twenty products.
    """
    step = math.isqrt(count) + 1
    coarse = np.exp(2j * np.pi * np.mod(turns * step * np.arange(-(-count // step)), 1.0))
    fine = np.exp(2j * np.pi * np.mod(turns * np.arange(step), 1.0))
    return np.outer(coarse, fine).ravel()[:count]


@checked
def order_spectrum(signal: AngularSignal, *, max_order: float | None = None) -> AmplitudeSpectrum:
    """Return the peak amplitude spectrum of an angular signal over orders, up to its passband.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the shaft; its mean is removed.
    max_order : float, optional
        End of the axis; default and upper limit: the passband of the signal.

    Returns
    -------
    AmplitudeSpectrum
        Phases refer to the tachometer's datum, where the angle of the shaft is zero.

    Raises
    ------
    ValueError
        As in `amplitude_spectrum`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal, order_spectrum
    >>> angle = 2 * np.pi * np.arange(32 * 128) / 128
    >>> signal = AngularSignal(values=3 * np.cos(21 * angle), samples_per_rev=128, start_rev=0.0, passband_orders=56.0)
    >>> spectrum = order_spectrum(signal)
    >>> round(float(np.interp(21, spectrum.axis, spectrum.amplitude)), 6), bool(spectrum.axis[-1] <= 56)
    (3.0, True)
    """
    return order_spectra([signal], max_order=max_order)[0]


def order_spectra(
    signals: Sequence[AngularSignal],
    *,
    max_order: float | None = None,
    single: bool = False,
) -> list[AmplitudeSpectrum]:
    """Return the `order_spectrum` of each of several signals over the same angles.

    Parameters
    ----------
    signals : sequence of AngularSignal
        One or more, of one length, start and passband.
    max_order
        As in `order_spectrum`.
    single : bool
        Whether to transform in single precision, in half the time: the error of a line is below 1e-6 of the largest
        deviation from the mean.

    Returns
    -------
    list of AmplitudeSpectrum

    Raises
    ------
    ValueError
        As in `amplitude_spectrum`.
    """
    first = signals[0]
    return _amplitude_spectra(
        [signal.values for signal in signals],
        rate=first.samples_per_rev,
        window="hann",
        padding=PADDING,
        maximum=last_order(first, max_order),
        start=first.start_rev,
        single=single,
    )


@dataclass(frozen=True, kw_only=True)
class AveragedSpectrum:
    """Power spectrum averaged over segments, as density or as the RMS or peak amplitude of a line.

    The integral of a "density" over the axis is the variance. "rms" and "peak" are exact for a line on the grid, and
    proportional to ``sqrt(noise_bandwidth)`` for noise.

    Attributes
    ----------
    axis : (line,) array
        Frequencies in Hz, or orders.
    value : (line,) array
        Density, RMS or peak amplitude, according to `scaling`.
    low, high : (line,) arrays
        Limits of the 95 % confidence interval of `value` for Gaussian noise; the interval of a line is narrower.
    scaling : {"density", "rms", "peak"}
        Meaning of `value`.
    averages : int
        Number of segments.
    degrees_of_freedom : float
        Degrees of freedom of the chi-square distribution of the power, allowing for overlap.
    bin_width, resolution, noise_bandwidth : float
        Step of the axis, -3 dB width and equivalent noise bandwidth of the window, in the unit of the axis.
    window : str
        Name of the window in `scipy.signal`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import averaged_spectrum
    >>> spectrum = averaged_spectrum(np.random.default_rng(1).standard_normal(4096), rate=1.0, segment=256, overlap=0)
    >>> spectrum.averages, round(spectrum.degrees_of_freedom, 6)
    (16, 32.0)
    """

    axis: Array = field(metadata={"dims": ("line",), "units": "Hz or order"})
    value: Array = field(metadata={"dims": ("line",), "units": "as the record, or squared over the axis' unit"})
    low: Array = field(metadata={"dims": ("line",), "units": "as value"})
    high: Array = field(metadata={"dims": ("line",), "units": "as value"})
    scaling: Scaling
    averages: int
    degrees_of_freedom: float
    bin_width: float
    resolution: float
    noise_bandwidth: float
    window: str


@checked
def averaged_spectrum(
    values: ArrayLike,
    *,
    rate: float,
    segment: int,
    overlap: float = 0.5,
    window: str = "hann",
    scaling: Scaling = "density",
) -> AveragedSpectrum:
    """Return the power spectrum averaged over segments (Welch 1967), with its 95 % chi-square confidence interval.

    Parameters
    ----------
    values : (n,) array
        Samples, any unit; their mean is removed once, over the whole record.
    rate : float
        Samples per second for an axis in Hz, samples per revolution for one in orders.
    segment : int
        Samples per segment; `resolution` is inversely proportional to it. Samples after the last full segment are
        unused.
    overlap : float
        Fraction of a segment that the next one shares, from 0 to below 1.
    window : str
        A window of `scipy.signal`.
    scaling : {"density", "rms", "peak"}
        Power density (one-sided, in units squared over the unit of the axis), or RMS or peak amplitude of a line.

    Returns
    -------
    AveragedSpectrum

    Raises
    ------
    ValueError
        A segment longer than the record, an overlap outside 0 to 1, an unknown window or scaling, or a rate that is not
        positive.

    Notes
    -----
    The powers of segments k hops apart have the correlation ``rho_k^2``, where rho_k is the normalised autocorrelation
    of the window at k hops, so that K segments have ``2 K / (1 + 2 sum (1 - k / K) rho_k^2)`` degrees of freedom (Welch
    1967), and half as many at zero and at half the rate, where the transform is real.

    Examples
    --------
    The integral of the density of noise of variance 4 is its variance:

    >>> import numpy as np
    >>> from signals import averaged_spectrum
    >>> noise = 2 * np.random.default_rng(1).standard_normal(40_000)
    >>> spectrum = averaged_spectrum(noise, rate=1000.0, segment=1000)
    >>> round(float(spectrum.value.sum() * spectrum.bin_width), 1)
    4.0
    """
    signal = real_vector(values, name="the signal", minimum=4)
    rate = positive(rate, name="rate")
    length = whole(segment, name="segment", least=4, most=signal.size)
    choice(scaling, name="scaling", choices=get_args(Scaling))
    shape = window_of(window, length)
    hop = hop_of(length, overlap)
    axis = np.arange(length // 2 + 1, dtype=np.float64) * (rate / length)
    power, count = np.zeros(axis.size), 0
    for lines in transformed(without_mean(signal), shape, hop):
        power += np.sum(lines.real**2 + lines.imag**2, axis=0)
        count += len(lines)
    rho = shape.overlap_correlation(hop)[: count - 1]
    degrees = 2 * count / (1 + 2 * np.sum((1 - np.arange(1, rho.size + 1) / count) * rho**2))
    each = np.where(_real_lines(length), degrees / 2, degrees)
    with np.errstate(over="ignore"):
        peak = power.max(initial=0.0) / rate
    if not np.isfinite(peak):
        raise ValueError(f"rate={rate:g} is so low that densities overflow; give the samples per unit of the axis.")
    value = scaled_power(power / count, shape, rate=rate, scaling=scaling)
    lower, upper = (_chi_square(each, probability) / each for probability in (0.975, 0.025))
    root = 1.0 if scaling == "density" else 0.5
    return AveragedSpectrum(
        axis=axis,
        value=value,
        low=value / lower**root,
        high=value / upper**root,
        scaling=scaling,
        averages=count,
        degrees_of_freedom=float(degrees),
        bin_width=rate / length,
        resolution=shape.width_bins * rate / length,
        noise_bandwidth=shape.noise_bandwidth_bins * rate / length,
        window=window,
    )


def _end_of(axis: Array, maximum: float | None) -> int:
    """Return the number of lines up to `maximum`, all by default."""
    return axis.size if maximum is None else int(np.searchsorted(axis, positive(maximum, name="maximum"), side="right"))


def hop_of(length: int, overlap: float) -> int:
    """Return the number of samples from one segment to the next, at least one."""
    if not 0 <= overlap < 1:
        raise ValueError(f"overlap={overlap!r} must be at least 0 and below 1, the fraction that two segments share.")
    return max(1, round(length * (1 - overlap)))


def transformed(signal: Samples, shape: Window, hop: int) -> Iterator[NDArray[np.complex128]]:
    """Yield the Fourier transforms of windowed segments, (segments, lines), a few at a time in constant memory."""
    length = shape.weights.size
    segments = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
    count = max(1, 2**18 // length)  # 2**18 samples transformed at a time
    for first in range(0, len(segments), count):
        yield fft.rfft(segments[first : first + count] * shape.weights, axis=1)


def scaled_power(power: Array, shape: Window, *, rate: float, scaling: Scaling) -> Array:
    """Scale the squared magnitudes of windowed transforms, (..., lines) from zero on, to density, RMS or peak."""
    sides = np.where(_real_lines(shape.weights.size), 1.0, 2.0)[: power.shape[-1]]
    if scaling == "density":
        return np.asarray(power * sides / (rate * np.sum(shape.weights**2)))
    mean_square = power * sides / shape.weights.sum() ** 2
    if scaling == "rms":
        return np.asarray(np.sqrt(mean_square))
    return np.asarray(np.sqrt(mean_square * sides))  # the RMS of a real line is its peak


def _real_lines(length: int) -> NDArray[np.bool_]:
    """Return which lines of the transform of a real signal are real: those at zero and at half the rate."""
    real = np.zeros(length // 2 + 1, dtype=bool)
    real[0] = True
    if length % 2 == 0:
        real[-1] = True
    return real


def _chi_square(degrees: Array, probability: float) -> Array:
    from scipy.special import gammaincinv  # noqa: PLC0415

    return np.asarray(2 * gammaincinv(degrees / 2, probability))


def last_order(signal: AngularSignal, max_order: float | None) -> float:
    """Return the end of an axis of orders: `max_order`, but no more than the passband of the signal."""
    return signal.passband_orders if max_order is None else min(max_order, signal.passband_orders)
