"""Envelope of a frequency band, of a whole record or of one that streams by, and its spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._checks import Array, Samples, positive, real_samples, real_vector
from signals._plans import forget_plans
from signals.resampling import angular_resample
from signals.spectra import AmplitudeSpectrum, amplitude_spectrum, order_spectrum, without_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from signals.phase import ShaftPhase

_ATTENUATION_DB = 80.0
_FEWEST_BLOCK = 2**14  # samples transformed at a time


def envelope(x: ArrayLike, *, rate_hz: float, band_hz: tuple[float, float]) -> Samples:
    """Return the magnitude of the analytic signal of one band, (n,), in the unit of `x`.

    The mean is removed, the band is cut out with sharp edges in the Fourier transform of the whole record; the
    record's ends are taken to meet. `stream_envelope` needs memory for its filter alone. Of float32 samples in single
    precision: the error is below 1e-6 of the record's RMS, of which a sample's own rounding is about a tenth.

    Parameters
    ----------
    x : (n,) array
    rate_hz : float
    band_hz : (low, high)
        Band edges, ``0 <= low < high <= rate_hz / 2``.
    """
    signal = real_samples(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    low, high = _band(band_hz, rate)
    lines = fft.rfft(without_mean(signal))
    begin, end = (int(edge / rate * signal.size) + np.arange(2) for edge in (low, high))  # at or beside the edges
    first, stop = begin[0] + np.sum(begin * rate / signal.size < low), end[0] + np.sum(end * rate / signal.size <= high)
    lines[:first], lines[stop:] = 0, 0
    real = np.asarray(fft.irfft(lines, signal.size))
    lines *= -1j  # the imaginary part of the analytic signal: every line turned back by a quarter
    imaginary = np.asarray(fft.irfft(lines, signal.size, overwrite_x=True))
    forget_plans(signal.size)
    return np.asarray(np.hypot(real, imaginary, out=real))


def stream_envelope(
    blocks: Iterable[ArrayLike],
    *,
    rate_hz: float,
    band_hz: tuple[float, float],
    transition_hz: float | None = None,
) -> Iterator[Array]:
    """Yield the envelope of a record that comes in blocks, as many samples as went in, in the unit of the record.

    A linear-phase filter of fixed length cuts the band, its delay taken out: memory does not grow with the record. The
    band passes within 1e-4 of 1 and its surroundings, one transition beyond either edge, within 1e-4 of 0 (80 dB), an
    offset to rounding. Before its first and after its last sample the record is taken as its first block's mean: for
    half the filter, about ``2.5 / transition_hz`` seconds, the ends are not settled.

    Parameters
    ----------
    blocks : iterable of (n,) arrays
        Any lengths, in order; nothing is kept of them but the filter's length.
    rate_hz : float
    band_hz : (low, high)
        Edges of the band that passes whole, ``0 < low < high < rate_hz / 2``.
    transition_hz : float, optional
        From pass to stop, outside the band; at most `low`, and what remains up to half the rate. Default a quarter of
        the band's width, or that most.

    Raises
    ------
    ValueError
        At the first block that holds a value that is not finite; or a band without room for its transitions.
    """
    rate = positive(rate_hz, name="rate_hz")
    low, high = _band(band_hz, rate)
    room = min(low, rate / 2 - high)
    width = min((high - low) / 4, room) if transition_hz is None else positive(transition_hz, name="transition_hz")
    if width <= 0 or width > room * (1 + 1e-12):
        raise ValueError(
            f"transition_hz={width:g} of the band ({low:g}, {high:g}) Hz must be above zero and at most {room:g}, the "
            f"least distance of the band to 0 and {rate / 2:g} Hz; narrow either, or take `envelope` of the whole "
            "record."
        )
    return _filtered(blocks, _analytic_taps(low / rate, high / rate, width / rate))


def _analytic_taps(low: float, high: float, width: float) -> NDArray[np.complex128]:
    """Kaiser-windowed filter that passes `low` to `high` (cycles a sample) at gain 2 and no negative frequency."""
    beta = 0.1102 * (_ATTENUATION_DB - 8.7)  # Kaiser's formulas, for the taps as well
    half = int(np.ceil((_ATTENUATION_DB - 7.95) / (2.285 * 2 * np.pi * width) / 2))
    place = np.arange(-half, half + 1)
    weights = np.kaiser(place.size, beta)
    wide, middle = high - low + width, (high + low) / 2
    taps = wide * np.sinc(wide * place) * weights * np.exp(2j * np.pi * middle * place)
    taps -= taps.sum() / weights.sum() * weights  # exactly nothing of an offset; changes others by what is taken
    return np.asarray(2 * taps, dtype=np.complex128)


def _filtered(blocks: Iterable[ArrayLike], taps: NDArray[np.complex128]) -> Iterator[Array]:
    """Overlap-save: yield ``|taps * x|`` in step with what came, the delay of half the taps taken out."""
    reach = taps.size - 1
    size = fft.next_fast_len(max(8 * taps.size, _FEWEST_BLOCK))
    step = size - reach
    response = fft.fft(taps, size)
    held = np.zeros(reach // 2)
    offset, seen = None, 0

    def convolve(values: Array) -> Array:
        return np.abs(fft.ifft(fft.fft(values, size) * response)[reach : values.size])

    for block in blocks:
        signal = real_vector(block, name="a block", minimum=0)
        if not signal.size:
            continue
        offset = signal.mean() if offset is None else offset
        seen += signal.size
        held = np.concatenate([held, signal - offset])
        while held.size >= size:
            yield convolve(held[:size])
            held = held[step:]
    if offset is None:
        raise ValueError("the record has no samples; give at least one block that holds some.")
    held = np.concatenate([held, np.zeros(reach // 2)])
    for first in range(0, held.size - reach, step):
        yield convolve(held[first : first + size])


def _band(band_hz: tuple[float, float], rate: float) -> tuple[float, float]:
    low, high = (float(edge) for edge in band_hz)
    if not 0 <= low < high <= rate / 2:
        raise ValueError(
            f"band_hz = ({low:g}, {high:g}) must rise and lie between 0 and {rate / 2:g} Hz, half the sampling rate."
        )
    return low, high


def _modulation(magnitude: Samples, *, squared: bool, relative: bool) -> Samples:
    """Return what of an envelope is transformed."""
    values = magnitude**2 if squared else magnitude
    if not relative:
        return values
    mean = values.mean()
    if mean == 0:
        raise ValueError("the band holds nothing, so nothing is relative to its envelope; choose another band.")
    return np.asarray(values / mean)


def envelope_spectrum(
    x: ArrayLike,
    *,
    rate_hz: float,
    band_hz: tuple[float, float],
    squared: bool = True,
    relative: bool = False,
    maximum_hz: float | None = None,
) -> AmplitudeSpectrum:
    """Return the spectrum over frequency of a band's squared envelope, or of the envelope.

    Peak amplitudes of the modulation, in the unit of `x` squared (`squared`) or as it is; `relative`: over the mean of
    what is transformed. Noise or a tone modulated as ``1 + m cos`` reads ``2 m / (1 + m^2 / 2)`` in the relative
    squared spectrum; a tone reads m in the relative plain one.

    Parameters
    ----------
    x, rate_hz, band_hz : as in `envelope`
    squared, relative : bool
    maximum_hz : float, optional
        Where the axis ends; the envelope of a band has nothing beyond the band's width.
    """
    magnitude = envelope(x, rate_hz=rate_hz, band_hz=band_hz)
    values = _modulation(magnitude, squared=squared, relative=relative)
    return amplitude_spectrum(values, rate=rate_hz, maximum=maximum_hz)


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
    """Demodulate a band in time, resample its envelope over angle, and return the spectrum over orders.

    A resonance stays at its frequency while the shaft's speed changes, so the band is cut in time; the
    defect repeats with the shaft, so its line is sharp in orders. Parameters as in `envelope` and
    `signals.angular_resample`, scaling as in `envelope_spectrum`.
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
