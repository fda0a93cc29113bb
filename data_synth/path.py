"""Transfer from a source to the accelerometer: one mode of the structure, and a gain for each pair of the two.

Shaft and mesh harmonics change slowly, so the frequency response of the mode applies to them. Impacts are short, so the
mode responds in time: ``a exp(-zeta w_n t) sin(w_d t)`` from the very instant of the impact. That response is sampled
without an anti-aliasing filter; its spectrum falls with the square of frequency, so the alias is about
``2 zeta (f_n / rate) ** 2`` of the peak.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from data_synth.combs import ComplexArray, HarmonicFamily, RandomStreams
from data_synth.faults import ImpactTrain
from data_synth.profile import Array
from data_synth.scene import Mode
from data_synth.transfer import MeasuredPath, ModalPath

_DECAYED = 30.0  # decay in nepers after which a ringing has ended: 1e-13 of its amplitude


def sensor_gains(sources: list[str], *, sensors: int, rng_for: RandomStreams) -> dict[str, ComplexArray]:
    """Draw the complex gain (sensors,) from each source to each sensor.

    The scene's amplitudes are those at the first sensor, so its gain is 1; each other gain is log-uniform between a
    half and two, with a uniform phase. For impacts its absolute value applies.
    """
    gains = {}
    for source in sources:
        octaves, turns = rng_for("gain", source).random((sensors, 2)).T
        gains[source] = np.exp2(2 * octaves - 1) * np.exp(2j * np.pi * turns)
        gains[source][0] = 1.0
    return gains


def mode_response(mode: Mode | ModalPath | MeasuredPath | None, frequency_hz: ArrayLike) -> ComplexArray:
    """Return ``1 / (1 - r^2 + 2 j zeta r)``, r = frequency / natural frequency; 1 without a mode.

    For a transfer path, its declared response.
    """
    if mode is None:
        return np.ones(np.shape(frequency_hz), dtype=np.complex128)
    if isinstance(mode, ModalPath | MeasuredPath):
        return mode.response(frequency_hz)
    ratio = np.asarray(frequency_hz, dtype=np.float64) / mode.frequency_hz
    return np.asarray(1 / (1 - ratio**2 + 2j * mode.damping_ratio * ratio))


def line_amplitudes(
    family: HarmonicFamily,
    *,
    gains: ArrayLike,
    speed_hz: Array,
    load: Array,
    mode: Mode | ModalPath | MeasuredPath | None,
) -> ComplexArray:
    """Return Z of a harmonic family at the sensors, (sensor, line, instant), in the sensors' units.

    Parameters
    ----------
    family : HarmonicFamily
    gains : (sensor,) complex array
    speed_hz, load : (instant,) array
        Speed of the reference shaft in rev s-1, and tooth load relative to full load.
    mode : Mode, ModalPath, MeasuredPath or None
        The mode of the path, or a transfer path.
    """
    response = mode_response(mode, np.outer([float(order) for order in family.orders], speed_hz))
    coefficients = family.coefficients if family.coefficients.ndim > 1 else family.coefficients[:, None]
    at_source = coefficients * response * (load if family.load_dependent else 1.0)
    if family.speed_exponent:
        at_source = at_source * (speed_hz / family.reference_speed_hz) ** family.speed_exponent
    return np.asarray(np.asarray(gains)[:, None, None] * at_source)


def mode_pole(mode: Mode) -> complex:
    """Return the pole of a mode, ``-zeta w_n + j w_d`` in rad s-1."""
    return 2 * math.pi * mode.frequency_hz * complex(-mode.damping_ratio, math.sqrt(1 - mode.damping_ratio**2))


def ringing_time_s(mode: Mode) -> float:
    """Return the time after which an impulse response has decayed to 1e-13."""
    return _DECAYED / -mode_pole(mode).real


def ringing_spectrum(mode: Mode | ModalPath | MeasuredPath, frequency_hz: ArrayLike) -> ComplexArray:
    """Return the Fourier transform of the impulse response, ``w_d / (w_n^2 - w^2 + 2 j zeta w_n w)``, in s.

    For a transfer path it is its response, for an impact in N s.
    """
    if isinstance(mode, ModalPath | MeasuredPath):
        return mode.response(frequency_hz)
    shifted = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) - mode_pole(mode)
    conjugate = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) - mode_pole(mode).conjugate()
    return np.asarray(mode_pole(mode).imag / (shifted * conjugate))


def impact_line(
    train: ImpactTrain, *, harmonic: int, speed_hz: Array, load: Array, mode: Mode | ModalPath | MeasuredPath
) -> ComplexArray:
    """Return Z (instant,) of a harmonic of a strictly periodic train of impacts.

    ``2 a f H(m f) exp(j 2 pi m offset)`` with impacts at rate f through the spectrum H of the impulse response: exact
    at constant speed and load. When f changes at f' per second, the relative error is about ``f' / f`` times the decay
    time ``1 / (zeta w_n)``, and ``2 pi m f'`` times its square: 1e-4 in a run-up of 1 rev/s per second.
    """
    if train.order is None or not train.amplitudes.any():
        return np.zeros(speed_hz.size, dtype=np.complex128)
    rate = float(train.order) * speed_hz
    turn = np.exp(2j * np.pi * harmonic * train.offset)
    return np.asarray(2 * train.amplitudes[0] * load * rate * ringing_spectrum(mode, harmonic * rate) * turn)
