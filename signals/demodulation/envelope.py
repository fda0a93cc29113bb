"""Envelope of a frequency band, of a whole record or of a stream, and its spectrum."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import groupby, islice, pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.ndimage import convolve1d

from signals._transforms import forget_plans, transform_of
from signals._validation import Array, Samples, checked, positive, real_samples, real_vector
from signals.resampling.resampling import angular_resample
from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum, order_spectrum

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.resampling.resampling import AngularSignal
    from signals.shaft.phase import ShaftPhase

_ATTENUATION_DB = 80.0
_MOST_TAPS = 2**18  # over the transition's width in cycles per sample: 2.6 times as many taps, 200 MB while they work


def envelope(x: ArrayLike, *, rate_hz: float, band_hz: tuple[float, float]) -> Samples:
    """Return the magnitude of the analytic signal of one band, (n,), in the unit of `x`.

    The mean is removed and the band is cut out with sharp edges in the Fourier transform of the whole record, which is
    taken as periodic. `stream_envelope` needs memory for its filter only. float32 samples are processed in single
    precision, with an error below 1e-6 of the record's RMS.

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
    begin, end = (int(edge / rate * signal.size) + np.arange(2) for edge in (low, high))  # at or beside the edges
    first, stop = begin[0] + np.sum(begin * rate / signal.size < low), end[0] + np.sum(end * rate / signal.size <= high)
    lines[:first], lines[stop:] = 0, 0
    real = np.asarray(fft.irfft(lines, signal.size))
    lines *= -1j  # the Hilbert transform
    imaginary = np.asarray(fft.irfft(lines, signal.size, overwrite_x=True))
    forget_plans(signal.size)
    return np.asarray(np.hypot(real, imaginary, out=real))


@checked
def stream_envelope(
    blocks: Iterable[ArrayLike],
    *,
    rate_hz: float,
    band_hz: tuple[float, float],
    transition_hz: float | None = None,
) -> Iterator[Array]:
    """Yield the envelope of a record that arrives in blocks, in constant memory, as many samples as the record has.

    The filter is of linear phase, its delay removed. Its gain is within 1e-4 of 1 in the band and within 1e-4 of 0
    (80 dB) from one transition width beyond either edge; it removes an offset to rounding. Beyond its ends the record
    is continued by the mean of its first half filter length, so that about ``2.5 / transition_hz`` seconds at either
    end are a transient.

    Parameters
    ----------
    blocks : iterable of (n,) arrays
        Consecutive parts of the record, of any lengths, any unit.
    rate_hz : float
        Sampling rate in Hz.
    band_hz : (low, high)
        Edges of the passband in Hz, ``0 < low < high < rate_hz / 2``.
    transition_hz : float, optional
        Width in Hz of the transition outside either edge; at most the distance of the band to 0 and to half the rate.
        Default a quarter of the band's width, or that distance where it is less.

    Yields
    ------
    (m,) array

    Raises
    ------
    ValueError
        At the first block with a value that is not finite; or a band too close to 0 or to half the rate.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import stream_envelope
    >>> x = 2 * np.cos(2 * np.pi * 100 * np.arange(4000) / 1000)
    >>> parts = list(stream_envelope(np.split(x, 4), rate_hz=1000, band_hz=(80, 120)))
    >>> round(float(np.concatenate(parts)[2000]), 3)
    2.0
    """
    rate = positive(rate_hz, name="rate_hz")
    low, high = _band(band_hz, rate)
    margin = min(low, rate / 2 - high)
    width = min((high - low) / 4, margin) if transition_hz is None else positive(transition_hz, name="transition_hz")
    if width <= 0 or width > margin * (1 + 1e-12):
        raise ValueError(
            f"transition_hz={width:g} of the band ({low:g}, {high:g}) Hz must be above zero and at most {margin:g}, "
            f"the least distance of the band to 0 and {rate / 2:g} Hz; narrow either, or take `envelope` of the whole "
            "record."
        )
    if width < rate / _MOST_TAPS:
        raise ValueError(
            f"transition_hz={width:g} makes a filter of more than {_MOST_TAPS} samples at {rate:g} Hz; give "
            f"{rate / _MOST_TAPS:.3g} Hz or more, or a band further from 0 and from half the rate."
        )
    return _filtered(blocks, _analytic_taps(low / rate, high / rate, width / rate))


def _analytic_taps(low: float, high: float, width: float) -> NDArray[np.complex128]:
    """Return a Kaiser-windowed complex band-pass of gain 2 from `low` to `high` (cycles per sample), (taps,)."""
    beta = 0.1102 * (_ATTENUATION_DB - 8.7)  # Kaiser's design formulas, here and for the number of taps
    half = int(np.ceil((_ATTENUATION_DB - 7.95) / (2.285 * 2 * np.pi * width) / 2))
    place = np.arange(-half, half + 1)
    weights = np.kaiser(place.size, beta)
    wide, middle = high - low + width, (high + low) / 2
    taps = wide * np.sinc(wide * place) * weights * np.exp(2j * np.pi * middle * place)
    taps -= taps.sum() / weights.sum() * weights  # gain exactly zero at zero frequency
    return np.asarray(2 * taps, dtype=np.complex128)


def _filtered(blocks: Iterable[ArrayLike], taps: NDArray[np.complex128]) -> Iterator[Array]:
    """Yield ``|taps * x|`` by overlap-save, without the delay of half the taps."""
    order = taps.size - 1
    size = fft.next_fast_len(max(8 * taps.size, 2**14))  # 2**14 samples transformed at a time
    step = size - order
    response = fft.fft(taps, size)
    buffer = np.zeros(order // 2)
    offset, seen = None, 0
    waiting: list[Array] = []  # until the offset is known, which is to depend on the record alone and not on its blocks

    def convolve(values: Array) -> Array:
        return np.abs(fft.ifft(fft.fft(values, size) * response)[order : values.size])

    for block in blocks:
        signal = real_vector(block, name="a block", minimum=0)
        seen += signal.size
        if offset is None:
            waiting.append(signal)
            if seen < order // 2:
                continue
            signal, waiting = np.concatenate(waiting), []
            offset = signal[: order // 2].mean()
        buffer = np.concatenate([buffer, signal - offset])
        while buffer.size >= size:
            yield convolve(buffer[:size])
            buffer = buffer[step:]
    if not seen:
        raise ValueError("the record has no samples; give at least one block that holds some.")
    if offset is None:
        whole_record = np.concatenate(waiting)
        buffer = np.concatenate([buffer, whole_record - whole_record.mean()])
    buffer = np.concatenate([buffer, np.zeros(order // 2)])
    for first in range(0, buffer.size - order, step):
        yield convolve(buffer[first : first + size])


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
            "the envelope of the band is zero, and nothing can be relative to its mean; choose another band."
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
    """Return the amplitude spectrum over frequency of a band's envelope or squared envelope.

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
        End of the axis; the squared envelope has no components beyond the band's width.

    Returns
    -------
    AmplitudeSpectrum
        Peak amplitudes of the modulation. A carrier modulated by ``1 + m cos`` gives m in the relative spectrum of the
        envelope, and ``2 m / (1 + m^2 / 2)`` in that of the squared envelope.

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
    """Return the amplitude spectrum over orders of a band's envelope, demodulated in time and resampled over angle.

    A resonance stays at its frequency while the speed of the shaft changes, so the band is filtered in time; the
    defect repeats with the shaft, so its line is sharp in orders.

    Parameters
    ----------
    x, rate_hz, band_hz, squared, relative
        As in `envelope_spectrum`.
    phase, samples_per_rev, start_s
        As in `angular_resample`.
    max_order : float, optional
        End of the axis; default, and at most, the passband of the resampled envelope.

    Returns
    -------
    AmplitudeSpectrum

    Examples
    --------
    A tone of 300 Hz, modulated once a revolution of an accelerating shaft by m = 0.5:

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


# Part of half the rate at which the bank begins and ends: offsets and drift lie below, the anti-alias filter above.
# ---- Envelopes of a bank of bands at once, and their level that changes slowly ---------------------------------------
# Demodulating a band needs the Fourier transform of the record once, and for each band an inverse transform as long as
# twice the band is wide. A bank of nested bands, halves to sixteenths of the range, so costs little more than one band.
# Of an envelope only the slow part may be wanted: cut out of its transform, it needs as few samples as that part has.
# What changes the level of a whole record (load, speed, noise that wanders) modulates every band of it. An envelope
# over its own moving average keeps what repeats within the width of that average.

_LOWEST, _HIGHEST = 0.02, 0.98


def bank_bands(*, rate_hz: float, least_width_hz: float) -> tuple[tuple[float, float], ...]:
    """Return the bands of a bank: halves, quarters, eighths and sixteenths of the range that are wide enough.

    Parameters
    ----------
    rate_hz : float
        Sampling rate in Hz.
    least_width_hz : float
        Width below which a band cannot carry the modulation that is looked for, in Hz.

    Returns
    -------
    tuple of (low, high)
        Edges in Hz, wider bands first.

    Raises
    ------
    ValueError
        Not even half the range is wide enough.

    Examples
    --------
    >>> from signals.demodulation.envelope import bank_bands
    >>> bank_bands(rate_hz=1000, least_width_hz=200)
    ((10.0, 250.0), (250.0, 490.0))
    """
    rate, least = positive(rate_hz, name="rate_hz"), positive(least_width_hz, name="least_width_hz")
    low, high = _LOWEST * rate / 2, _HIGHEST * rate / 2
    # halves, quarters, eighths, sixteenths
    counts = [2**level for level in range(1, 5) if (high - low) / 2**level >= least]
    if not counts:
        raise ValueError(
            f"least_width_hz={least:g} is more than half the range up to {high:g} Hz; lower it, or sample faster."
        )
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
    """Yield the envelope of each band, sampled at least at twice its width, or its part below a frequency.

    The envelope is the magnitude of the analytic signal of the band, cut out with sharp edges in the transform of the
    whole record: `signals.demodulation.envelope.envelope` at fewer instants, to rounding. Its own bandwidth is not
    limited; what lies above the band's width folds, which is noise of some per cent of the level at most.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    bands_hz : sequence of (low, high)
        Edges in Hz, ``0 <= low < high <= rate_hz / 2``.
    highest_hz : float, optional
        End of the part of the envelope that is wanted, cut off with a sharp edge; all bands then have one rate, 2.5
        times as much. It is found in single precision, with an error below 1e-6 of the band's largest value.

    transform : (n // 2 + 1,) array, optional
        The Fourier transform of the record without its mean, where it is known.

    Yields
    ------
    rate_hz : float
        Rate of the envelope in Hz, the first sample at that of the record.
    values : (m,) array
        In the unit of `x`, and in its precision unless `highest_hz` is given.

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
            raise ValueError(f"the band ({low:g}, {high:g}) Hz must rise and lie between 0 and {rate / 2:g} Hz.")
        places.append((int(np.ceil(low / rate * size)), int(np.floor(high / rate * size)) + 1))
    if highest_hz is None:
        for first, stop in places:
            (magnitude,) = _magnitudes(lines, [(first, stop)], size)
            yield magnitude.size / size * rate, magnitude
        return
    kept = int(positive(highest_hz, name="highest_hz") / rate * size) + 1
    # 2.5 samples a cycle of the slow part, which `angular_resample` then passes, 10 % above the mean speed too
    short = fft.next_fast_len(int(2.5 * kept) + 1, real=True)
    scale = float(np.abs(lines).max()) or 1.0  # small units would underflow
    singles = np.asarray(lines / scale, dtype=np.complex64)
    for length, alike in groupby(places, key=lambda place: _length(place[1] - place[0])):
        # 2**19 samples of bands transformed at once, 4 MB: four rows take half the time of four single ones
        at_once = max(1, 2**19 // length)
        while some := list(islice(alike, at_once)):
            magnitudes = _magnitudes(singles, some, size)
            slow = fft.rfft(magnitudes)[:, :kept]
            for row in fft.irfft(slow, short):
                yield short / size * rate, row * np.float64(scale * short / length)


def _length(lines: int) -> int:
    """Return the samples at twice the width of a band of so many lines, or a few more."""
    return int(fft.next_fast_len(max(2, 2 * (lines - 1))))


def _magnitudes(lines: NDArray[np.complexfloating], places: Sequence[tuple[int, int]], size: int) -> Samples:
    """Return the (band, m) magnitudes of the analytic signals of bands of one length, from lines of `size` samples."""
    length = _length(places[0][1] - places[0][0])
    analytic = np.zeros((len(places), length), dtype=lines.dtype)
    for row, (first, stop) in zip(analytic, places, strict=True):
        band = lines[first:stop][:length]
        row[: band.size] = band
        if first == 0:
            row[0] *= 0.5  # it and that at half the rate stand for one line, all others for two
        if size % 2 == 0 and stop == lines.size:
            row[band.size - 1] *= 0.5
    magnitude = np.abs(fft.ifft(analytic, overwrite_x=True))
    magnitude *= 2 * length / size
    return np.asarray(magnitude)


def level_normalised(signal: AngularSignal, *, revolutions: float) -> AngularSignal:
    """Return an envelope over angle divided by its moving average, and multiplied by its mean.

    The average is weighted by a Hann window over `revolutions`; at the ends by the part of it that lies in the record.
    What repeats four times or more within it is passed with a gain within 1e-3 of 1, except at the ends.

    Parameters
    ----------
    signal : AngularSignal
        Not negative, any unit.
    revolutions : float
        Width of the window; the record's length if that is less.

    Returns
    -------
    AngularSignal

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
    step = max(1, int(width * signal.samples_per_rev / 64))  # 64 points of the level within the width of its average
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


@lru_cache(maxsize=4)  # the same ones for the bands of a record
def _hann_weights(points: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Hann's window of some points, and the sum of it that lies in the record at each of `count` places."""
    window = np.hanning(points + 2)[1:-1]
    return window, np.asarray(convolve1d(np.ones(count), window, mode="constant"))
