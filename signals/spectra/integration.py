"""Velocity and displacement from acceleration, band-limited as in ISO 20816."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._transforms import forget_plans, transform_of
from signals._validation import Array, Samples, checked, choice, number, positive, real_samples

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

ISO_20816_HZ = (10.0, 1000.0)  # machines above 600 rpm
ISO_20816_SLOW_HZ = (2.0, 1000.0)  # machines from 120 to 600 rpm
STANDARD_GRAVITY = 9.80665  # m s-2, exact by definition
_TAPER = 0.25  # width of the transition beyond each edge, as a fraction of it; narrow ones settle slowly
_ORDER = {"displacement": 0, "velocity": 1, "acceleration": 2}  # derivatives of displacement
_UNITS = {  # quantity, and factor to SI units
    "m s-2": ("acceleration", 1.0),
    "mm s-2": ("acceleration", 1e-3),
    "g": ("acceleration", STANDARD_GRAVITY),
    "m s-1": ("velocity", 1.0),
    "mm s-1": ("velocity", 1e-3),
    "m": ("displacement", 1.0),
    "mm": ("displacement", 1e-3),
    "um": ("displacement", 1e-6),
}


@dataclass(frozen=True, kw_only=True)
class Integrated:
    """A record integrated once or twice within a band.

    Attributes
    ----------
    values : (n,) array
        The integral, in `units`.
    units : str
        Unit of the values.
    rate_hz : float
        Sampling rate in Hz.
    low_hz, high_hz : float
        Edges in Hz of the band in which the integral is exact.
    settling_s : float
        Duration in s of the transient at either end of the record.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import velocity
    >>> result = velocity(np.zeros(20_000), rate_hz=5000, units="g")
    >>> result.units, round(result.settling_s, 3), result.rms
    ('mm s-1', 1.2, 0.0)
    """

    values: Samples = field(metadata={"dims": ("time",), "units": "units"})
    units: str
    rate_hz: float
    low_hz: float
    high_hz: float
    settling_s: float

    @property
    def settled(self) -> Samples:
        """Values without the transients at both ends; empty if the record is shorter than these."""
        skip = int(np.ceil(self.settling_s * self.rate_hz))
        return self.values[skip : max(self.values.size - skip, skip)]

    @property
    def rms(self) -> float:
        """RMS without the transients, in `units`: in mm/s, the vibration magnitude of ISO 20816.

        ValueError if the record is shorter than the transients.
        """
        part = self.settled
        if not part.size:
            raise ValueError(
                f"the record of {self.values.size / self.rate_hz:g} s holds nothing beyond the {self.settling_s:g} s "
                "of transient at either end; record longer, or raise the lower edge of the band."
            )
        return float(np.sqrt(np.mean(part * part, dtype=np.float64)))


@checked
def velocity(
    x: ArrayLike,
    *,
    rate_hz: float,
    units: str,
    band_hz: tuple[float, float] = ISO_20816_HZ,
    transform: NDArray[np.complexfloating] | None = None,
    reduced: bool = False,
) -> Integrated:
    """Integrate acceleration to velocity, or filter a velocity, within a band.

    Parameters
    ----------
    x : (n,) array
        Acceleration or velocity.
    rate_hz : float
        Sampling rate in Hz.
    units : str
        Unit of `x`: ``m s-2``, ``mm s-2``, ``g`` (9.80665 m/s2), ``m s-1`` or ``mm s-1``.
    band_hz : (low, high)
        Band in Hz. Default 10 to 1000 Hz (ISO 20816-1 and -3); from 2 Hz for machines below 600 rpm.
        Beyond each edge follows a smooth transition of a quarter of that edge.
    transform : (n // 2 + 1,) array, optional
        Fourier transform of the record without its mean (`scipy.fft.rfft`), if known.
    reduced : bool
        Whether to decimate the result to four samples per cycle of the highest frequency that passes. Its RMS agrees
        with that of all samples to within 1e-3.

    Returns
    -------
    Integrated

    Raises
    ------
    ValueError
        Unknown units, or units of displacement; a band beyond half the sampling rate; a lower transition narrower than
        the reciprocal of the record length; a transform of another length.

    Notes
    -----
    The Fourier transform of the record without its mean is divided by ``j 2 pi f`` for each integration: exact for
    whole cycles of any tone in the band. float32 samples are processed in single precision, with an error below 3e-6 of
    the RMS.

    Examples
    --------
    An acceleration of 1 m/s2 peak at 50 Hz is a velocity of 1 / (2 pi 50) m/s peak, 2.251 mm/s RMS:

    >>> import numpy as np
    >>> from signals import velocity
    >>> x = np.cos(2 * np.pi * 50 * np.arange(20_000) / 5000)
    >>> round(velocity(x, rate_hz=5000, units="m s-2").rms, 3)
    2.251
    """
    return _integrate(
        x, rate_hz=rate_hz, units=units, to="mm s-1", band_hz=band_hz, transform=transform, reduced=reduced
    )


@checked
def line_velocity(amplitude: float, *, frequency_hz: float, units: str) -> float:
    """Return the RMS velocity in mm/s of a sinusoid, such as a line of a spectrum.

    Parameters
    ----------
    amplitude : float
        Peak amplitude.
    frequency_hz : float
        Its frequency in Hz.
    units : str
        Unit of the amplitude, of acceleration, velocity or displacement, as in `velocity` and `displacement`.

    Raises
    ------
    ValueError
        Unknown units, or a frequency that is not positive.

    Examples
    --------
    An acceleration of 1 m/s2 peak at 50 Hz is a velocity of 1 / (2 pi 50) m/s peak:

    >>> from signals.spectra.integration import line_velocity
    >>> round(line_velocity(1.0, frequency_hz=50.0, units="m s-2"), 3)
    2.251
    """
    choice(units, name="units", choices=tuple(_UNITS))
    quantity, si = _UNITS[units]
    per_second = (2 * np.pi * positive(frequency_hz, name="frequency_hz")) ** (1 - _ORDER[quantity])
    return float(1e3 * amplitude * si * per_second / np.sqrt(2))


@checked
def displacement(
    x: ArrayLike, *, rate_hz: float, units: str, band_hz: tuple[float, float] = ISO_20816_HZ
) -> Integrated:
    """Integrate acceleration twice, or velocity once, to displacement within a band.

    Parameters
    ----------
    x, rate_hz, band_hz
        As in `velocity`.
    units : str
        Unit of `x`: as in `velocity`, or ``m``, ``mm`` or ``um``.

    Returns
    -------
    Integrated

    Raises
    ------
    ValueError
        As in `velocity`, except that units of displacement are accepted.

    Examples
    --------
    A velocity of 1 mm/s peak at 50 Hz is a displacement of 1000 / (2 pi 50) um peak, 2.251 um RMS:

    >>> import numpy as np
    >>> from signals import displacement
    >>> x = np.cos(2 * np.pi * 50 * np.arange(20_000) / 5000)
    >>> round(displacement(x, rate_hz=5000, units="mm s-1").rms, 3)
    2.251
    """
    return _integrate(x, rate_hz=rate_hz, units=units, to="um", band_hz=band_hz)


def _integrate(
    x: ArrayLike,
    *,
    rate_hz: float,
    units: str,
    to: str,
    band_hz: tuple[float, float],
    transform: NDArray[np.complexfloating] | None = None,
    reduced: bool = False,
) -> Integrated:
    """Return the record integrated to a unit by division by ``j 2 pi f``."""
    signal = real_samples(x, name="the signal", minimum=4)
    rate = positive(rate_hz, name="rate_hz")
    quantity, result_scale = _UNITS[to]
    least = _ORDER[quantity]
    choice(units, name="units", choices=[unit for unit, (of, _) in _UNITS.items() if _ORDER[of] >= least])
    low, high = _checked_band(band_hz, rate=rate, duration_s=signal.size / rate)
    given, scale = _UNITS[units]
    transform = transform_of(signal, transform)
    step = rate / signal.size
    first, stop = int(low * (1 - _TAPER) / step) + 1, min(int(high * (1 + _TAPER) / step) + 1, transform.size)
    frequency = np.arange(first, stop, dtype=np.float64) * step
    gain = _band_gain(frequency, low, high) / (2j * np.pi * frequency) ** (_ORDER[given] - least)
    # a reduced result has 4 samples per cycle of the highest frequency
    size = min(signal.size, fft.next_fast_len(4 * stop, real=True)) if reduced else signal.size
    lines = np.zeros(size // 2 + 1, dtype=transform.dtype)  # the gain is zero elsewhere
    lines[first:stop] = transform[first:stop] * gain * (scale / result_scale * size / signal.size)
    values = np.asarray(fft.irfft(lines, size, overwrite_x=True))
    forget_plans(signal.size)
    # 3.0 over the width of the lower taper; measured error there: 2e-4 of a velocity, 1e-3 of a displacement
    return Integrated(
        values=values,
        units=to,
        rate_hz=rate * size / signal.size,
        low_hz=low,
        high_hz=high,
        settling_s=3.0 / (_TAPER * low),
    )


def _checked_band(band_hz: tuple[float, float], *, rate: float, duration_s: float) -> tuple[float, float]:
    """Return both edges in Hz, or raise where the record cannot resolve them."""
    low, high = (number(edge, name="an edge of band_hz") for edge in band_hz)
    if not 0 < low < high <= rate / 2:
        raise ValueError(
            f"band_hz = ({low:g}, {high:g}) must rise and lie above 0 and up to {rate / 2:g} Hz, half the sampling "
            "rate."
        )
    if _TAPER * low * duration_s < 1:
        raise ValueError(
            f"band_hz starts at {low:g} Hz with a taper of {_TAPER * low:.3g} Hz, narrower than the "
            f"{1 / duration_s:.3g} Hz resolved by a record of {duration_s:.3g} s; record at least "
            f"{1 / (_TAPER * low):.3g} s, or raise the lower edge."
        )
    return low, high


def _band_gain(frequency: Array, low: float, high: float) -> Array:
    """Return the gain (lines,): 1 in the band, 0 beyond smooth transitions, which keep the transient short."""
    below = np.clip((frequency / low - 1) / _TAPER + 1, 0, 1)
    above = np.clip((1 - frequency / high) / _TAPER + 1, 0, 1)
    return _smooth_step(below) * _smooth_step(above)


def _smooth_step(u: Array) -> Array:
    return np.asarray(np.sin(np.pi / 2 * np.sin(np.pi / 2 * u) ** 2) ** 2)
