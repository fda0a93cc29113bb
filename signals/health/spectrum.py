"""Faults in the spectrum: mains hum, and the ski slope of a loose or overloaded sensor."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signals._transforms import median, transform_of
from signals._validation import Samples
from signals.health.samples import SensorFault, graded

_STRAY_HZ = 0.1  # largest deviation of the grid's frequency in normal operation
_HARMONICS = (1, 2, 3, 5, 7)
_REACH_HZ = 10.0
_OCTAVES = 4


def hum(x: Samples, amplitude: Samples, *, rate_hz: float) -> tuple[list[SensorFault], str | None]:
    """Return faults for lines at a mains frequency and its harmonics, or the reason why they cannot be judged.

    A machine that turns at a fraction of the mains frequency has the same lines, and others in between: lines at
    multiples of half or a third of the frequency exclude hum. `amplitude` is `amplitudes(x)`.
    """
    fewest_harmonics = 3
    shortest_hum_s = 1.0
    if x.size / rate_hz < shortest_hum_s or rate_hz < 2 * (fewest_harmonics * 60 + _REACH_HZ):
        return [], (
            f"mains hum needs {shortest_hum_s:g} s and lines up to the third harmonic; the record lasts "
            f"{x.size / rate_hz:.3g} s at {rate_hz:g} Hz"
        )
    step = rate_hz / x.size
    level = float(np.std(x, dtype=np.float64))
    mains_hz = (50.0, 60.0)
    hum_share = 0.1  # RMS of the hum over that of the record
    faulty_hum = 0.5
    above = 5.0  # smallest amplitude over the median beside; noise alone gives a lobe 2.6
    for mains in mains_hz:
        base = _strongest(amplitude, step, mains)
        harmonics = [k for k in _HARMONICS if k * (mains + _STRAY_HZ) + _REACH_HZ < rate_hz / 2]
        heights = {k: _line(amplitude, step, k * base) for k in harmonics}
        standing = {k: line for k, (line, background) in heights.items() if line > above * background}
        between = [base * part for part in (1 / 2, 3 / 2, 1 / 3, 2 / 3, 4 / 3)]
        others = sum(line > above * background for line, background in (_line(amplitude, step, f) for f in between))
        share = float(np.sqrt(sum(line**2 for line in standing.values()) / 2)) / level
        if 1 in standing and len(standing) >= fewest_harmonics and others == 0 and share > hum_share:
            sentence = (
                f"the mains hum in it: lines at {base:.2f} Hz and {len(standing) - 1} of its harmonics hold "
                f"{share:.1%} of its RMS. Check shield and ground loops; a machine that turns at this very frequency "
                "does the same."
            )
            return [graded("mains hum", sick=share > faulty_hum, size=share, sentence=sentence)], None
    return [], None


def amplitudes(x: Samples, transform: NDArray[np.complexfloating] | None = None) -> Samples:
    """Return the peak amplitude spectrum under Hann's window, in steps of one over the record's duration.

    The window, ``1/2 - cos(2 pi i / n) / 2``, is applied to the lines of the spectrum as a three-term convolution.
    `transform` is that of the record without its mean, where it is known.
    """
    lines = transform_of(x, transform)
    beyond = np.conj(lines[-2] if x.size % 2 == 0 else lines[-1])  # the line after the last: x is real
    windowed = lines[1:-1] - (lines[:-2] + lines[2:]) / 2
    found = np.empty(lines.size, dtype=x.dtype)
    found[0] = abs(lines[0] - lines[1].real)
    np.abs(windowed, out=found[1:-1])
    found[-1] = abs(lines[-1] - (lines[-2] + beyond) / 2)
    found *= 2 / x.size
    return found


def _strongest(amplitude: Samples, step: float, mains: float) -> float:
    """Return the frequency of the largest line near a mains frequency, interpolated between the steps."""
    low, high = int((mains - _STRAY_HZ) / step), int(np.ceil((mains + _STRAY_HZ) / step)) + 1
    top = low + int(np.argmax(amplitude[low:high]))
    left, middle, right = np.maximum(amplitude[top - 1 : top + 2], np.finfo(np.float64).tiny)
    side, sign = (right, 1) if right > left else (left, -1)
    shift = (2 * side / middle - 1) / (side / middle + 1)  # exact for a tone under Hann's window
    found = (top + sign * float(np.clip(shift, 0, 1))) * step
    return float(np.clip(found, mains - _STRAY_HZ, mains + _STRAY_HZ))


def _line(amplitude: Samples, step: float, at: float) -> tuple[float, float]:
    """Return the amplitude of a line from the power of its lobe, and the median amplitude beside it."""
    lobe = 3  # bins of a Hann line, rounded up
    centre, reach = round(at / step), max(int(_REACH_HZ / step), 4 * lobe)
    inside = amplitude[max(centre - lobe, 0) : centre + lobe + 1]
    background = np.concatenate(
        (amplitude[max(centre - reach, lobe) : max(centre - lobe, lobe)], amplitude[centre + lobe + 1 : centre + reach])
    )
    return float(np.sqrt(np.sum(inside**2) / 1.5)), float(median(background))


def ski_slope(x: Samples, amplitude: Samples, *, rate_hz: float) -> tuple[list[SensorFault], str | None]:
    """Return faults for a density that falls from the lowest octave on, or the reason why it cannot be judged.

    Its causes are a loose mount, thermal drift and the recovery of an overloaded amplifier. The density of an octave is
    its median, which the lines of a shaft do not change; nor do they count in the share of the power.
    """
    slope_top_hz = 16.0
    edges = slope_top_hz / 2.0 ** np.arange(_OCTAVES, -1, -1)
    step = rate_hz / x.size
    fewest_bins = 4
    if edges[1] - edges[0] < fewest_bins * step or rate_hz < 8 * slope_top_hz:
        return [], (
            f"a ski slope shows from {edges[0]:g} to {slope_top_hz:g} Hz; the record, {x.size / rate_hz:.3g} s at "
            f"{rate_hz:g} Hz, does not resolve that"
        )
    power = amplitude**2
    places = np.ceil(edges / step).astype(np.intp)
    density = np.array([median(power[low:high]) for low, high in pairwise(places)])
    # of exponential powers the mean is the median over log 2: lines of slow shafts above it are no part of the slope
    octaves = np.array([power[low:high].sum(dtype=np.float64) for low, high in pairwise(places)])
    within = np.minimum(octaves, density * np.diff(places) / math.log(2))
    below = power[1 : places[0]].sum(dtype=np.float64) + within.sum()
    share = float(below / power[1:].sum(dtype=np.float64))
    floor = float(median(power[1:]))
    # 4.0 times the record's median density, below which the slope has ended
    end = int(np.argmax(np.append(density < 4.0 * floor, True)))  # where the slope ends in the rest
    shortest_slope = 2  # octaves
    slope_share = 0.05
    # 100.0 is the smallest density of the lowest octave over the record's median density
    if end < shortest_slope or density[0] < 100.0 * floor or share < slope_share:
        return [], None
    if np.any(density[: end - 1] < 2.0 * density[1:end]):  # smallest density over that of the octave above
        return [], None
    decibels = 10 * np.log10(density[0] / density[end - 1]) / (end - 1)
    sentence = (
        f"it has a ski slope: below {slope_top_hz:g} Hz its density falls by {decibels:.1f} dB an octave and holds "
        f"{share:.1%} of its power. Check the mount; look for shocks that overload the amplifier."
    )
    faulty_slope = 0.5
    return [graded("ski slope", sick=share > faulty_slope, size=share, sentence=sentence)], None
