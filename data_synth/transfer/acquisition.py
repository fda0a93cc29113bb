"""The measurement chain from the machine surface to the file, part by part.

The linear filters are exact: by their frequency response for harmonics, whose amplitudes change slowly, and by their
poles for impacts, whose response is a sum of decaying exponentials. Nonlinear parts modify the samples in place and
return what they changed.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import SceneError
from data_synth.scene.sensors import AntiAlias, DropOuts, Quantisation, Sensor
from data_synth.transfer.paths import AnalogFilter, FirFilter, MeasuredPath, mode_filter

ComplexArray = NDArray[np.complex128]

BLOCK = 65536  # samples processed at once
# relative RMS that the filter of a measured path may leave out; the larger one if its band ends abruptly
_LEAKAGES = (1e-3, 1e-2)
_FEWEST = 64  # taps
_SPACINGS = 8  # longest filter, relative to the impulse response length from the spacing of lines


def linear_chain(sensor: Sensor, *, rate_hz: float) -> AnalogFilter:
    """Return the linear part of a channel sampled at `rate_hz`, from its mount to the recorder, as one filter."""
    gain = sensor.sensitivity.value if sensor.sensitivity is not None else 1.0
    gain *= sensor.gain if sensor.gain is not None else 1.0
    coupling = [] if sensor.ac_coupling_hz is None else [-2 * math.pi * sensor.ac_coupling_hz]
    chain = AnalogFilter(gain=gain, coupling=np.array(coupling, dtype=np.complex128), skew_s=sensor.skew_s)
    if isinstance(sensor.anti_alias, AntiAlias):
        chain = AnalogFilter(poles=np.array(butterworth_poles(sensor.anti_alias, rate_hz=rate_hz))).then(chain)
    return chain if sensor.resonance is None else mode_filter(sensor.resonance).then(chain)


def butterworth_poles(filter_: AntiAlias, *, rate_hz: float) -> list[complex]:
    """Return the poles of a Butterworth low-pass filter, evenly on the left half of a circle (Butterworth 1930)."""
    radius, order = 2 * math.pi * filter_.cutoff_hz(rate_hz), filter_.order
    angles = [math.pi * (2 * k + order + 1) / (2 * order) for k in range(order)]
    return [
        radius * complex(math.cos(angle), 0.0 if 2 * k + 1 == order else math.sin(angle))
        for k, angle in enumerate(angles)
    ]


def add_ringing(
    signal: Array, *, times_s: Array, amplitudes: Array, poles: ComplexArray, residues: ComplexArray, rate_hz: float
) -> None:
    """Add ``amplitude Re sum_p residue exp(pole (t - time))`` after each impact, exact also between samples.

    Parameters
    ----------
    signal : (n,) array
        Modified in place; sample i is at ``i / rate_hz``.
    times_s, amplitudes : (m,) arrays
        Times of the impacts in s, rising, and their amplitudes; impacts before the first sample contribute as well.
    poles, residues : (p,) complex arrays
    rate_hz : float
    """
    from data_synth.transfer._acquisition_kernels import add_decays  # noqa: PLC0415 - loads numba

    firsts = np.maximum(np.ceil(times_s * rate_hz), 0).astype(np.int64)
    initial_states = amplitudes[:, None] * residues * np.exp(poles * (firsts / rate_hz - times_s)[:, None])
    add_decays(signal, firsts, initial_states, np.exp(poles / rate_hz))


def add_noise(
    signal: Array, *, rms: float, rng: np.random.Generator, level_db: Callable[[Array], Array] = np.zeros_like
) -> None:
    """Add white Gaussian noise of `rms`, in the units of the signal, to a signal (n,) in place.

    `level_db` returns the level relative to the RMS at given sample indices (n,); 0 by default.
    """
    start = 0
    for part in _blocks(signal) if rms > 0 else ():
        noise = rms * rng.standard_normal(part.size)
        part[:] += 10 ** (level_db(np.arange(start, start + part.size, dtype=np.float64)) / 20) * noise
        start += part.size


def _blocks(signal: Array) -> Iterator[Array]:
    """Yield views of a signal (n,), so that temporary arrays do not grow with it."""
    for start in range(0, signal.size, BLOCK):
        yield signal[start : start + BLOCK]


def clip(signal: Array, *, level: float) -> int:
    """Clip a signal (n,) to plus and minus `level`, in place; return the number of samples clipped."""
    out_of_range = 0
    for part in _blocks(signal):
        out_of_range += int(np.count_nonzero(np.abs(part) > level))
        np.clip(part, -level, level, out=part)
    return out_of_range


def quantise(signal: Array, converter: Quantisation) -> int:
    """Quantise a signal (n,) in place; return the number of samples beyond the range of the converter."""
    half = 2 ** (converter.bits - 1)
    step, out_of_range = converter.full_scale / half, 0
    for part in _blocks(signal):
        codes = np.rint(part / step)
        out_of_range += int(np.count_nonzero((codes < -half) | (codes > half - 1)))
        np.clip(codes, -half, half - 1, out=codes)
        part[:] = codes * step
    return out_of_range


def drop_outs(signal: Array, drops: DropOuts, *, rate_hz: float, rng: np.random.Generator) -> Array:
    """Insert random gaps in a signal (n,), in place; return their start and end times, (m, 2) in s.

    Their starts are a Poisson process; overlapping gaps are merged.
    """
    duration_s = signal.size / rate_hz
    starts_s = np.sort(duration_s * rng.random(rng.poisson(drops.per_second * duration_s)))
    firsts = np.ceil(starts_s * rate_hz).astype(np.int64)
    firsts = firsts[firsts < signal.size]
    ends = np.minimum(firsts + max(1, round(drops.duration_s * rate_hz)), signal.size)
    apart = firsts > np.concatenate([[-1], ends])[:-1]
    spans = np.stack([firsts[apart], ends[np.roll(apart, -1)]], axis=1)
    for first, end in spans.tolist():
        held = signal[first - 1] if first else 0.0
        signal[first:end] = {"nan": np.nan, "zero": 0.0, "hold": held}[drops.reads]
    return np.asarray(spans / rate_hz)


def measured_filter(path: MeasuredPath, chain: AnalogFilter, *, rate_hz: float, sensor: Sensor) -> FirFilter:
    """Return a measured path followed by the chain as an FIR filter, of the shortest sufficient power of two.

    The impulse response is the inverse transform of H. Its part before time zero, due to the truncation of H at half
    the rate or at its last line, is retained by a delay: the fewest samples that leave out no more than the leakage.

    Raises
    ------
    SceneError
        Lines too widely spaced for the impulse response to decay.
    """
    longest = 1 << math.ceil(math.log2(max(_FEWEST, _SPACINGS * path.ringing_time_s() * rate_hz)))
    lines_hz = np.arange(longest + 1) * rate_hz / (2 * longest)
    response = np.fft.irfft(path.response(lines_hz) * chain.response(lines_hz))
    energy = response**2
    early = np.cumsum(energy[::-1])[:longest]  # in the samples before zero, backwards: -1, -2, ...
    ahead, whole = np.concatenate([[early[-1]], early[-1] - early]), np.sum(energy)  # by a delay of 0, 1, 2, ...
    for leakage in _LEAKAGES:
        delay = int(np.argmax(ahead <= leakage**2 * whole))
        held = np.cumsum(np.roll(energy, delay)[:longest])
        taps = _FEWEST
        while taps <= longest:
            if whole - held[taps - 1] <= (2 * leakage) ** 2 * whole:
                return FirFilter(np.roll(response, delay)[:taps], delay_s=delay / rate_hz)
            taps *= 2
    raise SceneError(
        f'sensor "{sensor.name}": a measured transfer to it does not decay within {longest / rate_hz:.3g} s, so its '
        "lines are too widely spaced; measure with a finer resolution."
    )
