"""Piecewise-linear time histories of speed or torque, and random fluctuations."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from data_synth.operation.shaft_angle import Array

_KNOTS_PER_CYCLE = 8  # of the fastest component, of which linear interpolation retains 95 %
_SPARE_SCALES = 20  # time scales by which the period of a fluctuation exceeds the duration


@dataclass(frozen=True, kw_only=True)
class PiecewiseLinear:
    """A quantity against time, linear between knots and constant outside them; two knots at one time are a jump.

    Attributes
    ----------
    times_s : (m,) array
        Times of the knots in s, rising.
    values : (m,) array
        Values at the knots, in the unit of the quantity.
    """

    times_s: Array = field(metadata={"dims": ("knot",), "units": "s"})
    values: Array = field(metadata={"dims": ("knot",), "units": "any"})

    def at(self, times_s: ArrayLike) -> Array:
        """Return the values at `times_s` (n,); at a jump, the one after it."""
        return np.asarray(np.interp(np.asarray(times_s, dtype=np.float64), self.times_s, self.values))

    def scaled(self, factor: float) -> "PiecewiseLinear":
        """Return the time history multiplied by `factor`."""
        return PiecewiseLinear(times_s=self.times_s, values=self.values * factor)


def sum_of(first: PiecewiseLinear, second: PiecewiseLinear) -> PiecewiseLinear:
    """Return the exact sum of two time histories, with the knots and jumps of both."""
    unique = np.union1d(first.times_s, second.times_s)
    jumps = np.concatenate([knots.times_s[1:][np.diff(knots.times_s) == 0] for knots in (first, second)])
    doubled = np.isin(unique, jumps)
    times = np.repeat(unique, 1 + doubled)
    before = np.concatenate([(times[1:] == times[:-1]), [False]])
    values = np.where(
        before, _left_limits(first, times) + _left_limits(second, times), first.at(times) + second.at(times)
    )
    return PiecewiseLinear(times_s=times, values=values)


def _left_limits(knots: PiecewiseLinear, times: Array) -> Array:
    mirrored = PiecewiseLinear(times_s=-knots.times_s[::-1], values=knots.values[::-1])
    return mirrored.at(-times)


@dataclass(frozen=True, kw_only=True)
class Kaimal:
    """Kaimal spectrum of the longitudinal wind: ``4 s^2 T / (1 + 6 f T)^(5/3)``, s = `rms`, T = `time_scale_s`.

    T is the length scale over the mean wind speed (Kaimal, Wyngaard, Izumi and Cote 1972, Q. J. R. Meteorol. Soc. 98,
    563-589, in the form of IEC 61400-1).
    """

    rms: float
    time_scale_s: float

    def density(self, frequency_hz: ArrayLike) -> Array:
        """Return the one-sided power spectral density per Hz; its integral from zero is ``rms ** 2``."""
        reduced = np.asarray(frequency_hz, dtype=np.float64) * self.time_scale_s
        return np.asarray(4 * self.rms**2 * self.time_scale_s / (1 + 6 * reduced) ** (5 / 3))


def fluctuation(spectrum: Kaimal, *, duration_s: float, highest_hz: float, rng: np.random.Generator) -> PiecewiseLinear:
    """Draw a zero-mean Gaussian fluctuation without components above `highest_hz`, as knots from 0 to `duration_s`.

    It is a sum of cosines at equally spaced frequencies with independent Gaussian coefficients (Rice 1944), by one
    inverse FFT. Its period is `duration_s` plus twenty time scales, so that its end is not correlated with its start;
    the mean and components slower than that period are left out. Between the knots, eight per period of the highest
    frequency, the fluctuation *is* linear, so that the angle of a shaft that follows it is exact; this reduces
    components at `highest_hz` by 5 %.

    Parameters
    ----------
    spectrum : Kaimal
        Its power spectral density.
    duration_s, highest_hz : float
        Duration in s and highest frequency in Hz, above zero.
    rng : numpy.random.Generator
    """
    spacing = 1 / (_KNOTS_PER_CYCLE * highest_hz)
    count = math.ceil((duration_s + _SPARE_SCALES * spectrum.time_scale_s) / spacing)
    frequencies = np.arange(count // 2 + 1) / (count * spacing)
    # one cosine per line, whose mean square is the density times the spacing of lines
    deviations = np.sqrt(spectrum.density(frequencies) / (count * spacing))
    deviations[(frequencies == 0) | (frequencies > highest_hz)] = 0.0
    parts = rng.standard_normal((2, frequencies.size))
    values = np.fft.irfft(deviations * (parts[0] + 1j * parts[1]) * (count / 2), n=count)
    kept = math.ceil(duration_s / spacing) + 1
    return PiecewiseLinear(times_s=np.asarray(np.arange(kept) * spacing), values=values[:kept])
