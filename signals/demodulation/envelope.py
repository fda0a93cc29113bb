"""Envelope of a frequency band, and its spectrum."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import groupby, islice, pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.ndimage import convolve1d

from signals._transforms import forget_plans, transform_of
from signals._validation import Samples, checked, positive, real_samples, real_vector
from signals.resampling.resampling import angular_resample
from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum, averaged_spectrum, order_spectrum

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.resampling.resampling import AngularSignal
    from signals.shaft.phase import ShaftPhase


def envelope(x: ArrayLike, *, rate_hz: float, band_hz: tuple[float, float]) -> Samples:
    """Return the magnitude of the analytic signal of one band, (n,), in the unit of `x`.

    The mean is removed and the band is selected with sharp edges in the Fourier transform of the whole record, which is
    taken as periodic. float32 samples are processed in single precision, with an error below 1e-6 of the RMS of the
    record.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    band_hz : (low, high)
        Band edges in Hz, ``0 <= low < high <= rate_hz / 2``.

    Returns
    -------
    (n,) array

    Raises
    ------
    ValueError
        Fewer than four samples, values that are not finite, or a band outside 0 to half the sampling rate.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.demodulation.envelope import envelope
    >>> t = np.arange(1000) / 1000
    >>> x = (1 + 0.5 * np.cos(2 * np.pi * 5 * t)) * np.cos(2 * np.pi * 100 * t)
    >>> bool(np.allclose(envelope(x, rate_hz=1000, band_hz=(80, 120)), 1 + 0.5 * np.cos(2 * np.pi * 5 * t)))
    True
    """
    signal = real_samples(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    low, high = _band(band_hz, rate)
    lines = transform_of(signal)
    begin, end = (int(edge / rate * signal.size) + np.arange(2) for edge in (low, high))  # lines next to the edges
    first, stop = begin[0] + np.sum(begin * rate / signal.size < low), end[0] + np.sum(end * rate / signal.size <= high)
    lines[:first], lines[stop:] = 0, 0
    real = np.asarray(fft.irfft(lines, signal.size))
    lines *= -1j  # the Hilbert transform
    imaginary = np.asarray(fft.irfft(lines, signal.size, overwrite_x=True))
    forget_plans(signal.size)
    return np.asarray(np.hypot(real, imaginary, out=real))


def _band(band_hz: tuple[float, float], rate: float) -> tuple[float, float]:
    low, high = (float(edge) for edge in band_hz)
    if not 0 <= low < high <= rate / 2:
        raise ValueError(
            f"band_hz = ({low:g}, {high:g}) must rise and lie between 0 and {rate / 2:g} Hz, half the sampling rate."
        )
    return low, high


def _modulation(magnitude: Samples, *, squared: bool, relative: bool) -> Samples:
    values = magnitude**2 if squared else magnitude
    if not relative:
        return values
    mean = values.mean()
    if mean == 0:
        raise ValueError(
            "the envelope of the band is zero, so that it cannot be divided by its mean; choose another band."
        )
    return np.asarray(values / mean)


@checked
def envelope_spectrum(
    x: ArrayLike,
    *,
    rate_hz: float,
    band_hz: tuple[float, float],
    squared: bool = True,
    relative: bool = False,
    maximum_hz: float | None = None,
) -> AmplitudeSpectrum:
    """Return the amplitude spectrum over frequency of the envelope, or squared envelope, of a band.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    band_hz : (low, high)
        Band edges in Hz, ``0 <= low < high <= rate_hz / 2``.
    squared : bool
        Whether the envelope is squared; amplitudes are then in the unit of `x` squared.
    relative : bool
        Whether the envelope, or its square, is divided by its mean.
    maximum_hz : float, optional
        End of the axis in Hz; the squared envelope has no components beyond the width of the band.

    Returns
    -------
    AmplitudeSpectrum
        Peak amplitudes of the modulation. A carrier modulated by ``1 + m cos`` gives m in the relative spectrum of the
        envelope, and ``2 m / (1 + m^2 / 2)`` in that of the squared envelope.

    Raises
    ------
    ValueError
        A band outside 0 to half the sampling rate, values that are not finite, or with `relative` an envelope of zero.

    Examples
    --------
    A tone of 100 Hz, modulated at 5 Hz by m = 0.5:

    >>> import numpy as np
    >>> from signals import envelope_spectrum
    >>> t = np.arange(1000) / 1000
    >>> x = (1 + 0.5 * np.cos(2 * np.pi * 5 * t)) * np.cos(2 * np.pi * 100 * t)
    >>> spectrum = envelope_spectrum(x, rate_hz=1000, band_hz=(80, 120), squared=False, relative=True)
    >>> round(float(np.interp(5, spectrum.axis, spectrum.amplitude)), 6)
    0.5
    """
    magnitude = envelope(x, rate_hz=rate_hz, band_hz=band_hz)
    values = _modulation(magnitude, squared=squared, relative=relative)
    return amplitude_spectrum(values, rate=rate_hz, maximum=maximum_hz)


@checked
def envelope_order_spectrum(
    x: ArrayLike,
    *,
    rate_hz: float,
    band_hz: tuple[float, float],
    phase: ShaftPhase,
    samples_per_rev: int,
    start_s: float = 0.0,
    max_order: float | None = None,
    squared: bool = False,
    relative: bool = False,
) -> AmplitudeSpectrum:
    """Return the order spectrum of the envelope of a band, demodulated in time and resampled over angle.

    A resonance stays at its frequency while the speed changes, so the band is filtered in time; a defect repeats with
    the shaft, so its line is sharp in orders.

    Parameters
    ----------
    x, rate_hz, band_hz, squared, relative
        As in `envelope_spectrum`.
    phase, samples_per_rev, start_s
        As in `angular_resample`.
    max_order : float, optional
        End of the axis; default and upper limit: the passband of the resampled envelope.

    Returns
    -------
    AmplitudeSpectrum

    Raises
    ------
    ValueError
        As `envelope_spectrum` and `angular_resample`.

    Examples
    --------
    A tone of 300 Hz, modulated once per revolution of an accelerating shaft by m = 0.5:

    >>> import numpy as np
    >>> from signals import ShaftPhase, envelope_order_spectrum
    >>> t = np.arange(4000) / 1000
    >>> rev = 5 * t + t**2
    >>> x = (1 + 0.5 * np.cos(2 * np.pi * rev)) * np.cos(2 * np.pi * 300 * t)
    >>> phase = ShaftPhase(times_s=t[::100], revolutions=rev[::100])
    >>> spectrum = envelope_order_spectrum(x, rate_hz=1000, band_hz=(250, 350), phase=phase, samples_per_rev=32)
    >>> round(float(np.interp(1, spectrum.axis, spectrum.amplitude)), 2)
    0.5
    """
    magnitude = envelope(x, rate_hz=rate_hz, band_hz=band_hz)
    over_angle = angular_resample(
        _modulation(magnitude, squared=squared, relative=relative),
        rate_hz=rate_hz,
        phase=phase,
        samples_per_rev=samples_per_rev,
        start_s=start_s,
    )
    return order_spectrum(over_angle, max_order=max_order)


# ---- Envelopes of a bank of bands at once, and their slowly varying level --------------------------------------------
# Demodulation takes one Fourier transform of the record, and for each band an inverse transform whose length is twice
# the width of the band. A bank of nested bands, halves to sixteenths of the range, therefore costs little more than one
# band. If only the slow part of an envelope is required, it is selected in its transform and needs as few samples.
# Changes of load, speed or noise level modulate every band. An envelope divided by its moving average retains what
# repeats within the width of that average.


def passband_end_hz(x: ArrayLike, *, rate_hz: float) -> float:
    """Return the frequency at which a low-pass filter ends the signal, or half the sampling rate if none does.

    Behind a filter, the noise of the record decreases by at least 40 dB within an octave, and nowhere above is it
    stronger. The noise of a machine does not: above a resonance it decreases by 12 dB per octave.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit, at least 512; the noise is the median of the power density over a 512th of the range, with
        fewer than 16,384 samples over more of it.
    rate_hz : float
        Sampling rate in Hz.

    Returns
    -------
    float
        In Hz; the highest frequency at which the noise is no more than 20 dB below that in the octave below the filter.
        Half the sampling rate also if that is above nine tenths of it, as behind an anti-alias filter.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import butter, sosfilt
    >>> from signals.demodulation.envelope import passband_end_hz
    >>> noise = np.random.default_rng(1).standard_normal(2**16)
    >>> passband_end_hz(noise, rate_hz=50_000)
    25000.0
    >>> filtered = sosfilt(butter(8, 5000, fs=50_000, output="sos"), noise)
    >>> round(passband_end_hz(filtered, rate_hz=50_000), -2)
    6500.0
    """
    samples, rate = real_vector(x, name="x", minimum=512), positive(rate_hz, name="rate_hz")
    power = averaged_spectrum(samples, rate=rate, segment=min(4096, samples.size // 8)).value
    bins = max(4, power.size // 512)
    levels = np.median(power[: power.size // bins * bins].reshape(-1, bins), axis=1)
    above = np.maximum.accumulate(levels[::-1])[::-1]
    # above 0.9 of half the rate a filter takes so little of a bank's range that it is left as it is
    for top in range(4, int(0.9 / 2 * levels.size)):
        inside = np.median(levels[top // 2 : top])
        if above[2 * top] < 1e-4 * inside:
            return float((np.flatnonzero(levels > 1e-2 * inside)[-1] + 1) / levels.size * rate / 2)
    return rate / 2


def bank_bands(*, rate_hz: float, least_width_hz: float) -> tuple[tuple[float, float], ...]:
    """Return the bands of a bank: halves of the range, and quarters, eighths and sixteenths that are wide enough.

    Parameters
    ----------
    rate_hz : float
        Sampling rate in Hz.
    least_width_hz : float
        Width in Hz below which a band cannot carry the modulation of interest.

    Returns
    -------
    tuple of (low, high)
        Edges in Hz, wider bands first.

    Examples
    --------
    >>> from signals.demodulation.envelope import bank_bands
    >>> bank_bands(rate_hz=1000, least_width_hz=200)
    ((10.0, 250.0), (250.0, 490.0))
    """
    rate, least = positive(rate_hz, name="rate_hz"), positive(least_width_hz, name="least_width_hz")
    low, high = 0.02 * rate / 2, 0.98 * rate / 2  # offsets and drift lie below, the anti-alias filter above
    counts = [2, *(count for count in (4, 8, 16) if (high - low) / count >= least)]
    edges = (np.linspace(low, high, count + 1).tolist() for count in counts)
    return tuple(pair for each in edges for pair in pairwise(each))


def bank_envelopes(
    x: ArrayLike,
    *,
    rate_hz: float,
    bands_hz: Sequence[tuple[float, float]],
    highest_hz: float | None = None,
    transform: NDArray[np.complexfloating] | None = None,
) -> Iterator[tuple[float, Samples]]:
    """Yield the envelope of each band, sampled at least at twice the bandwidth, or its part below a frequency.

    The envelope is the magnitude of the analytic signal of the band, selected with sharp edges in the transform of the
    whole record, and equals that of `signals.demodulation.envelope.envelope` at fewer instants. It is not band-limited:
    components above the bandwidth alias, as noise of at most a few per cent of the level.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    bands_hz : sequence of (low, high)
        Edges in Hz, ``0 <= low < high <= rate_hz / 2``.
    highest_hz : float, optional
        Cut-off of the envelopes in Hz, with a sharp edge; all envelopes then have a rate of 2.5 times as much. They are
        computed in single precision, with an error below 1e-6 of the largest value of the band.
    transform : (n // 2 + 1,) array, optional
        Fourier transform of the record without its mean (`scipy.fft.rfft`), if known.

    Yields
    ------
    rate_hz : float
        Sampling rate of the envelope in Hz; its first sample coincides with that of the record.
    values : (m,) array
        Envelope in the unit of `x`, and in its precision unless `highest_hz` is given.

    Raises
    ------
    ValueError
        A band outside 0 to half the sampling rate, values that are not finite, or a transform of another length.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.demodulation.envelope import bank_envelopes
    >>> t = np.arange(1000) / 1000
    >>> x = (1 + 0.5 * np.cos(2 * np.pi * 5 * t)) * np.cos(2 * np.pi * 100 * t)
    >>> ((rate, values),) = bank_envelopes(x, rate_hz=1000, bands_hz=[(80, 120)])
    >>> rate, bool(np.allclose(values, 1 + 0.5 * np.cos(2 * np.pi * 5 * np.arange(values.size) / rate)))
    (80.0, True)
    """
    signal = real_samples(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    size = signal.size
    lines = transform_of(signal, transform)
    places: list[tuple[int, int]] = []
    for low, high in bands_hz:
        if not 0 <= low < high <= rate / 2 * (1 + 1e-12):
            raise ValueError(f"the band ({low:g}, {high:g}) Hz of bands_hz must rise and lie in 0 to {rate / 2:g} Hz.")
        places.append((int(np.ceil(low / rate * size)), int(np.floor(high / rate * size)) + 1))
    if highest_hz is None:
        for first, stop in places:
            (magnitude,) = _magnitudes(lines, [(first, stop)], size)
            yield magnitude.size / size * rate, magnitude
        return
    kept = int(positive(highest_hz, name="highest_hz") / rate * size) + 1
    # 2.5 samples per cycle of the slow part, which `angular_resample` then passes even 10 % above the mean speed
    short = fft.next_fast_len(int(2.5 * kept) + 1, real=True)
    scale = float(np.abs(lines).max()) or 1.0  # small units would underflow
    singles = np.asarray(lines / scale, dtype=np.complex64)
    for length, alike in groupby(places, key=lambda place: _length(place[1] - place[0])):
        # 2**19 samples transformed at once, 4 MB: four rows together take half the time of four single ones
        at_once = max(1, 2**19 // length)
        while some := list(islice(alike, at_once)):
            magnitudes = _magnitudes(singles, some, size)
            slow = fft.rfft(magnitudes)[:, :kept]
            for row in fft.irfft(slow, short):
                yield short / size * rate, row * np.float64(scale * short / length)


def _length(lines: int) -> int:
    """Return the number of samples at twice the width of a band of so many lines, or a few more."""
    return int(fft.next_fast_len(max(2, 2 * (lines - 1))))


def _magnitudes(lines: NDArray[np.complexfloating], places: Sequence[tuple[int, int]], size: int) -> Samples:
    """Return the (band, m) magnitudes of the analytic signals of bands of equal length from lines of `size` samples."""
    length = _length(places[0][1] - places[0][0])
    analytic = np.zeros((len(places), length), dtype=lines.dtype)
    for row, (first, stop) in zip(analytic, places, strict=True):
        band = lines[first:stop][:length]
        row[: band.size] = band
        if first == 0:
            row[0] *= 0.5  # it and the Nyquist line are single, all others stand for two
        if size % 2 == 0 and stop == lines.size:
            row[band.size - 1] *= 0.5
    magnitude = np.abs(fft.ifft(analytic, overwrite_x=True))
    magnitude *= 2 * length / size
    return np.asarray(magnitude)


def level_normalised(signal: AngularSignal, *, revolutions: float) -> AngularSignal:
    """Return an envelope over angle divided by its moving average and multiplied by its mean.

    The average is weighted by a Hann window over `revolutions`, truncated at the ends of the record. Components with
    four or more periods within it pass with a gain within 1e-3 of 1, except at the ends.

    Parameters
    ----------
    signal : AngularSignal
        Envelope, not negative, any unit.
    revolutions : float
        Width of the window, limited to the length of the record.

    Returns
    -------
    AngularSignal

    Raises
    ------
    ValueError
        A width that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.demodulation.envelope import level_normalised
    >>> turns = np.arange(1600) / 16
    >>> load = 1 + 0.5 * (turns > 50)
    >>> x = AngularSignal(values=load, samples_per_rev=16, start_rev=0.0, passband_orders=6.0)
    >>> flat = level_normalised(x, revolutions=4).values
    >>> round(float(flat[200]), 3) == round(float(flat[1400]), 3) == round(float(load.mean()), 3)
    True
    """
    width = min(positive(revolutions, name="revolutions"), float(signal.revolutions))
    step = max(1, int(width * signal.samples_per_rev / 64))  # 64 points of the level per window
    count = max(1, signal.values.size // step)
    starts = np.arange(0, count * step, step)
    coarse = np.add.reduceat(signal.values, starts) / np.diff(np.append(starts, signal.values.size))
    window, weights = _hann_weights(max(1, round(width * signal.samples_per_rev / step)), count)
    level = convolve1d(coarse, window, mode="constant") / weights
    middle = (np.arange(count) + 0.5) * step
    smooth = np.interp(np.arange(signal.values.size), middle, level)
    mean = float(signal.values.mean())
    ratio = np.divide(signal.values, smooth, out=np.ones(signal.values.size), where=smooth > 0)
    return replace(signal, values=ratio * mean)


@lru_cache(maxsize=4)  # shared by the bands of a record
def _hann_weights(points: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a Hann window of so many points, and the sum of it within the record at each of `count` places."""
    window = np.hanning(points + 2)[1:-1]
    return window, np.asarray(convolve1d(np.ones(count), window, mode="constant"))
