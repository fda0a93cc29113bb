"""Sensor faults: jumps, flat tops, constant segments, isolated spikes, mains hum, ski slopes.

The thresholds on samples depend on the resolution of the record, since a coarse converter also repeats values.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from signals._transforms import median, transform_of
from signals._validation import Array, Samples

# ---- A fault of a sensor, with its severity --------------------------------------------------------------------------


Kind = Literal["clipping", "drop-out", "stuck", "mains hum", "ski slope", "level jump", "offset jump", "spikes"]
Severity = Literal["suspect", "faulty"]


@dataclass(frozen=True, kw_only=True)
class SensorFault:
    """A fault in the record of a sensor.

    Attributes
    ----------
    kind : str
        "clipping", "drop-out", "stuck", "mains hum", "ski slope", "level jump", "offset jump" or "spikes".
    severity : str
        "suspect" (to be checked) or "faulty" (estimates are distorted).
    size : float
        The quantity named in the sentence: a fraction of samples or power, a ratio, or a count.
    sentence : str
        What was found, where, how large, and the remedy.

    Examples
    --------
    >>> from signals import sensor_health
    >>> fault = sensor_health([1.0] * 64, rate_hz=1000, units="g").faults[0]
    >>> print(f"{fault.kind}, {fault.severity}: {fault.sentence}")
    stuck, faulty: it is 1 g throughout. Check sensor, cable and supply.
    """

    kind: Kind
    severity: Severity
    size: float
    sentence: str


def graded(kind: Kind, *, faulty: bool, size: float, sentence: str) -> SensorFault:
    """Return a fault of severity "faulty", or else "suspect"."""
    return SensorFault(kind=kind, severity="faulty" if faulty else "suspect", size=size, sentence=sentence)


# ---- Sudden, lasting changes of RMS or mean, as from a sensor that comes loose ---------------------------------------


_PARTS = 64
_SIDE = 8  # parts on either side of a jump


def jumps(
    x: Samples, *, rate_hz: float, units: str, speed_hz: Array | None = None
) -> tuple[list[SensorFault], str | None]:
    """Return faults for sudden, lasting changes of RMS or mean, or the reason why they cannot be judged.

    The record is cut into 64 parts. In a run-up the level changes from part to part; on either side of a jump it is
    steady over eight parts. Where the speed of the machine (m,), at even times over the record, changes with the level,
    a resonance may have caused the change, which can be larger than that of any loose sensor, but takes longer than a
    quarter of a part: the speed has to change by its width.
    """
    fewest_in_part = 64
    if x.size < _PARTS * fewest_in_part:
        return [], f"detecting jumps in level takes {_PARTS * fewest_in_part} samples; the record has {x.size}"
    parts = x[: x.size // _PARTS * _PARTS].reshape(_PARTS, -1)
    part_s = parts.shape[1] / rate_hz
    mean = parts.mean(axis=1, dtype=np.float64)
    level = np.array([part.std(dtype=np.float64) for part in parts])
    found = []
    faulty_jump = 8.0
    if level.min() > 0:
        at, jump = _largest_jump(np.log(level))
        if jump > np.log(2.0):  # smallest ratio of RMS
            before, after = float(np.median(level[at - _SIDE : at])), float(np.median(level[at : at + _SIDE]))
            factor = float(np.exp(jump))
            earlier_hz, later_hz = _speeds_beside(parts, at, speed_hz, sudden=faulty_jump)
            # 0.03 of the speed: as much as half the width of a resonance with 3 % of damping
            turns = abs(later_hz - earlier_hz) > 0.03 * abs(earlier_hz)
            why = (
                f", where the speed changes from {earlier_hz:.4g} to {later_hz:.4g} rev/s and may cross a resonance. "
                "Check"
                if turns
                else ". Check mount and cable, or"
            )
            sentence = (
                f"its level jumps from {before:.4g} to {after:.4g} {units} RMS, by a factor of {factor:.3g}, at about "
                f"{at * part_s:.4g} s{why} whether the load changed then."
            )
            faulty = factor > faulty_jump and not turns
            found.append(graded("level jump", faulty=faulty, size=factor, sentence=sentence))
    at, jump = _largest_jump(mean)
    typical = float(np.median(level))
    faulty_offset = 30.0
    if typical > 0 and jump > 3.0 * typical:  # smallest jump of the mean over the RMS about it
        size = jump / typical
        sentence = (
            f"its mean jumps by {jump:.4g} {units}, {size:.3g} times its RMS, at about {at * part_s:.4g} s. Check "
            "connector and supply."
        )
        found.append(graded("offset jump", faulty=size > faulty_offset, size=size, sentence=sentence))
    return found, None


def _speeds_beside(parts: Samples, at: int, speed_hz: Array | None, *, sudden: float) -> Array:
    """Return the speed before and after a jump; zero where the speed is unknown.

    It is that in the middle of the steady parts on either side, but half a part from the jump where the level changes
    within a quarter of a part by a `sudden` factor: a resonance would take longer.
    """
    if speed_hz is None:
        return np.zeros(2)
    cells = np.array([cell.std(dtype=np.float64) for cell in np.array_split(parts[at - 1 : at + 2].ravel(), 24)])
    steps = np.abs(np.log(np.maximum(cells[2:], 1e-30) / np.maximum(cells[:-2], 1e-30)))
    reach = 0.5 if steps.max() > np.log(sudden) else _SIDE / 2
    places = at - 1 + (steps.argmax() + 1.5) / 8 + np.array([-reach, reach])
    return np.asarray(np.interp(places / _PARTS, np.linspace(0, 1, speed_hz.size), speed_hz))


def _largest_jump(values: Array) -> tuple[int, float]:
    """Return the part after the largest jump between steady levels, and its height; 0 where there is none."""
    # without a part that the jump itself may lie in
    sides = np.lib.stride_tricks.sliding_window_view(values, _SIDE - 1)
    middle, range_ = median(sides), np.ptp(sides, axis=1)
    before, after = slice(0, values.size - 2 * _SIDE + 1), slice(_SIDE + 1, None)
    heights = np.abs(middle[after] - middle[before])
    # 0.4 is the largest range of the levels on either side, relative to the jump
    heights[np.maximum(range_[before], range_[after]) >= 0.4 * heights] = 0
    best = int(heights.argmax())
    return (_SIDE + best, float(heights[best])) if heights[best] else (0, 0.0)


# ---- Samples ---------------------------------------------------------------------------------------------------------


Mask = NDArray[np.bool_]

_STUCK = 0.1  # of the record


def clipping(x: Samples, *, rate_hz: float, units: str) -> tuple[list[SensorFault], Mask]:
    """Return faults where an extreme value repeats more often than the adjacent levels, and an (n,) mask of it."""
    clipped = np.zeros(x.size, dtype=np.bool_)
    sides = []
    pile = 4.0  # a sine on a coarse converter has 2.4 times as many samples on its last level as on the one before
    for extreme, sign in ((float(x.max()), 1.0), (float(x.min()), -1.0)):
        at = x == extreme
        count = int(np.count_nonzero(at))
        if count > pile and count > pile * _usual_count(sign * x, sign * extreme):
            clipped |= at
            sides.append(f"{extreme:.6g} {units} {count} times")
    if not sides:
        return [], clipped
    share = float(np.mean(clipped))
    first = int(np.argmax(clipped)) / rate_hz
    sentence = (
        f"it is clipped: it reaches {' and '.join(sides)}, {share:.3%} of the samples, first at {first:.4g} s. "
        "Widen the measuring range, or leave those samples out."
    )
    faulty_clipped = 0.01
    return [graded("clipping", faulty=share > faulty_clipped, size=share, sentence=sentence)], clipped


def _usual_count(x: Samples, extreme: float) -> float:
    """Return the mean count of samples on the levels just below the extreme that together hold 16 samples."""
    below = x[x < extreme]
    near = min(below.size, 4096)
    below.partition(below.size - near)
    counts = np.unique(below[below >= below[-near]], return_counts=True)[1][::-1]
    if counts.size == 1:  # a signal of two levels, such as a tachometer's
        return float(x.size)
    together = np.cumsum(counts)
    # 16 samples below the extreme that its count is compared with
    levels = min(int(np.searchsorted(together, 16)), counts.size - 1) + 1
    return float(together[levels - 1] / levels)


def dropouts(x: Samples, *, missing: Mask, rate_hz: float, units: str) -> tuple[list[SensorFault], Mask]:
    """Return faults for gaps and for constant segments too long for the record's resolution, and an (n,) mask of both.

    Runs of equal values in a healthy record have a geometric distribution, whose parameter gives the length that one
    record in a million reaches. A slow oscillation on a coarse converter has longer runs on its crests, but enters and
    leaves them by one resolution step: a segment counts only if it is entered or left by more than two.
    """
    lost = missing.copy()
    alike = x[1:] == x[:-1]
    start, length = _runs(alike)
    long = length + 1 >= _longest_run(start.size, x.size - int(np.count_nonzero(alike)), x.size)
    if long.any():
        start, length = start[long], length[long] + 1
        values = np.unique(x)
        stop = start + length
        entry = np.where(start > 0, np.abs(x[start] - x[start - 1]), np.inf)
        leave = np.where(stop < x.size, np.abs(x[np.minimum(stop, x.size - 1)] - x[start]), np.inf)
        # two resolutions are the smallest step at an end of a faulty segment
        sudden = np.maximum(entry, leave) > 2.0 * float(np.min(np.diff(values)))
        extreme = (x[start] == values[0]) | (x[start] == values[-1])
        extreme &= length <= _STUCK * x.size  # a flat top is clipping, but not one as long as that
        for place in np.flatnonzero(sudden & ~extreme):
            lost[start[place] : stop[place]] = True
    if not lost.any():
        return [], np.zeros(x.size, dtype=np.bool_)  # which takes no memory until it is written to
    return [_dropout_fault(x, lost, rate_hz=rate_hz, units=units)], lost


def _dropout_fault(x: Samples, lost: Mask, *, rate_hz: float, units: str) -> SensorFault:
    """Return the fault of lost samples: stuck to the end of the record, or drop-outs."""
    start, length = _runs(lost)
    share, worst = float(np.mean(lost)), int(np.argmax(length))
    where = f"{length[worst] / rate_hz:.4g} s, starting at {start[worst] / rate_hz:.4g} s"
    value = x[start[worst] + length[worst] // 2]
    if start[worst] + length[worst] == x.size and length[worst] > _STUCK * x.size:
        sentence = f"it is stuck at {value:.6g} {units} to the end, for {where}. Check sensor, cable and supply."
        return graded("stuck", faulty=True, size=share, sentence=sentence)
    sentence = (
        f"it drops out {start.size} times, {share:.3%} of the samples; the longest segment, at {value:.6g} {units}, "
        f"lasts {where}. Check cable and logger, or leave those samples out."
    )
    faulty_lost = 0.01
    return graded("drop-out", faulty=share > faulty_lost, size=share, sentence=sentence)


def _runs(mask: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the starts and lengths of segments of True."""
    edges = np.flatnonzero(mask[1:] != mask[:-1]) + 1
    edges = np.concatenate([[0] if mask[0] else [], edges, [mask.size] if mask[-1] else []]).astype(np.intp)
    return edges[::2], edges[1::2] - edges[::2]


def _longest_run(several: int, runs: int, samples: int) -> int:
    """Return the run length that one in a million records reaches by chance, from the share of repeated values."""
    ratio = several / runs  # of the geometric distribution; a long run counts once
    shortest_run = 5
    if ratio == 0:
        return shortest_run
    if ratio == 1:
        return samples + 1
    # 1e-6 is the probability of a run this long in a healthy record
    return max(shortest_run, 1 + int(np.ceil(np.log(1e-6 / samples) / np.log(ratio))))


def spikes(x: Samples, *, rate_hz: float, units: str) -> tuple[list[SensorFault], Mask]:
    """Return faults for isolated samples far above all others, and an (n,) mask of them and their neighbours.

    An impact on a machine rings for many samples; one on a cable does not. Among thousands of impacts of a damaged
    bearing some look isolated by chance, so a spike must also exceed all other samples.
    """
    height = np.abs(x - float(median(x)))
    # where half of them reach this, no sample can be a spike, and the partition is saved
    spike = 8.0  # robust standard deviations
    deviation = 1.4826  # standard deviation of Gaussian values over their median absolute one
    if 2 * np.count_nonzero(height >= height.max() / (spike * deviation)) > x.size:
        return [], np.zeros(x.size, dtype=np.bool_)
    level = deviation * float(median(height))
    isolated = np.array(
        [at for at in np.flatnonzero(height > spike * level) if _is_isolated(height, int(at))], dtype=np.intp
    )
    found = _with_neighbours(isolated, x.size)
    if level > 0 and isolated.size and not found.all():
        # 1.5 times the largest value that is not isolated
        isolated = isolated[height[isolated] > 1.5 * float(np.max(height[~found]))]
        found = _with_neighbours(isolated, x.size)
    if level == 0 or not isolated.size:
        return [], np.zeros(x.size, dtype=np.bool_)
    largest = int(isolated[np.argmax(height[isolated])])
    sentence = (
        f"it has {isolated.size} isolated spikes, the largest {height[largest]:.4g} {units} or "
        f"{height[largest] / level:.3g} robust standard deviations high, at {largest / rate_hz:.6g} s. Check the "
        "cable, and for equipment switched nearby."
    )
    faulty_spikes = 1e-3
    faulty = isolated.size > faulty_spikes * x.size
    return [graded("spikes", faulty=faulty, size=float(isolated.size), sentence=sentence)], found


def _is_isolated(height: Samples, at: int) -> bool:
    """Return whether a sample is the largest of three, with low RMS on either side of the three."""
    beside = 6  # samples
    neighbours = np.concatenate((height[max(at - beside, 0) : max(at - 1, 0)], height[at + 2 : at + 1 + beside]))
    top = bool(height[at] == height[max(at - 1, 0) : at + 2].max())
    # 0.25 is the largest RMS beside a spike over its height; a ringing structure has more
    return top and float(np.sqrt(np.mean(neighbours**2))) < 0.25 * height[at]


def _with_neighbours(places: NDArray[np.intp], size: int) -> Mask:
    """Return an (n,) mask of samples and their neighbours."""
    mask = np.zeros(size, dtype=np.bool_)
    for offset in (-1, 0, 1):
        mask[np.clip(places + offset, 0, size - 1)] = True
    return mask


_STRAY_HZ = 0.1  # largest deviation of the grid's frequency in normal operation
_REACH_HZ = 10.0


def hum(x: Samples, amplitude: Samples, *, rate_hz: float) -> tuple[list[SensorFault], str | None]:
    """Return faults for lines at a mains frequency and its harmonics, or the reason why they cannot be judged.

    A machine that turns at a fraction of the mains frequency has the same lines and others between them: lines at
    multiples of a half or a third of the frequency exclude hum. `amplitude` is `amplitudes(x)`.
    """
    fewest_harmonics = 3
    shortest_hum_s = 1.0
    if x.size / rate_hz < shortest_hum_s or rate_hz < 2 * (fewest_harmonics * 60 + _REACH_HZ):
        return [], (
            f"detecting mains hum takes {shortest_hum_s:g} s and the third harmonic; the record lasts "
            f"{x.size / rate_hz:.3g} s at {rate_hz:g} Hz"
        )
    step = rate_hz / x.size
    level = float(np.std(x, dtype=np.float64))
    mains_hz = (50.0, 60.0)
    hum_share = 0.1  # RMS of the hum over that of the record
    faulty_hum = 0.5
    above = 5.0  # smallest amplitude over the median of the background; the lobe of noise alone gives 2.6
    for mains in mains_hz:
        base = _strongest(amplitude, step, mains)
        harmonics = [k for k in (1, 2, 3, 5, 7) if k * (mains + _STRAY_HZ) + _REACH_HZ < rate_hz / 2]
        heights = {k: _line(amplitude, step, k * base) for k in harmonics}
        standing = {k: line for k, (line, background) in heights.items() if line > above * background}
        between = [base * part for part in (1 / 2, 3 / 2, 1 / 3, 2 / 3, 4 / 3)]
        others = sum(line > above * background for line, background in (_line(amplitude, step, f) for f in between))
        share = float(np.sqrt(sum(line**2 for line in standing.values()) / 2)) / level
        if 1 in standing and len(standing) >= fewest_harmonics and others == 0 and share > hum_share:
            sentence = (
                f"it has mains hum: lines at {base:.2f} Hz and {len(standing) - 1} of its harmonics make up "
                f"{share:.1%} of its RMS. Check shielding and ground loops; a machine that turns at exactly this "
                "frequency has the same lines."
            )
            return [graded("mains hum", faulty=share > faulty_hum, size=share, sentence=sentence)], None
    return [], None


def amplitudes(x: Samples, transform: NDArray[np.complexfloating] | None = None) -> Samples:
    """Return the peak amplitude spectrum with a Hann window, in steps of one over the record's duration.

    The window, ``1/2 - cos(2 pi i / n) / 2``, is applied to the lines of the spectrum as a three-term convolution.
    `transform` is that of the record without its mean, if known.
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
    """Return the frequency of the largest line near a mains frequency, interpolated between bins."""
    low, high = int((mains - _STRAY_HZ) / step), int(np.ceil((mains + _STRAY_HZ) / step)) + 1
    top = low + int(np.argmax(amplitude[low:high]))
    left, middle, right = np.maximum(amplitude[top - 1 : top + 2], np.finfo(np.float64).tiny)
    side, sign = (right, 1) if right > left else (left, -1)
    shift = (2 * side / middle - 1) / (side / middle + 1)  # exact for a tone with a Hann window
    found = (top + sign * float(np.clip(shift, 0, 1))) * step
    return float(np.clip(found, mains - _STRAY_HZ, mains + _STRAY_HZ))


def _line(amplitude: Samples, step: float, at: float) -> tuple[float, float]:
    """Return the amplitude of a line from the power of its lobe, and the median amplitude of the background."""
    lobe = 3  # bins of a Hann line, rounded up
    centre, reach = round(at / step), max(int(_REACH_HZ / step), 4 * lobe)
    inside = amplitude[max(centre - lobe, 0) : centre + lobe + 1]
    background = np.concatenate(
        (amplitude[max(centre - reach, lobe) : max(centre - lobe, lobe)], amplitude[centre + lobe + 1 : centre + reach])
    )
    return float(np.sqrt(np.sum(inside**2) / 1.5)), float(median(background))


def ski_slope(x: Samples, amplitude: Samples, *, rate_hz: float) -> tuple[list[SensorFault], str | None]:
    """Return faults for a density that falls from the lowest octave upwards, or the reason why it cannot be judged.

    It is caused by a loose mount, thermal drift or the recovery of an overloaded amplifier. The density of an octave is
    its median, which the lines of a shaft do not affect; they do not count in the fraction of the power either.
    """
    slope_top_hz = 16.0
    edges = slope_top_hz / 2.0 ** np.arange(4, -1, -1)  # octaves
    step = rate_hz / x.size
    fewest_bins = 4
    if edges[1] - edges[0] < fewest_bins * step or rate_hz < 8 * slope_top_hz:
        return [], (
            f"a ski slope appears from {edges[0]:g} to {slope_top_hz:g} Hz, which the record of {x.size / rate_hz:.3g} "
            f"s at {rate_hz:g} Hz does not resolve"
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
    # the slope ends where it falls below 4.0 times the median density of the record
    end = int(np.argmax(np.append(density < 4.0 * floor, True)))
    shortest_slope = 2  # octaves
    slope_share = 0.05
    # 100.0 is the smallest density of the lowest octave over the record's median density
    if end < shortest_slope or density[0] < 100.0 * floor or share < slope_share:
        return [], None
    if np.any(density[: end - 1] < 2.0 * density[1:end]):  # smallest density over that of the octave above
        return [], None
    decibels = 10 * np.log10(density[0] / density[end - 1]) / (end - 1)
    sentence = (
        f"it has a ski slope: below {slope_top_hz:g} Hz its density falls by {decibels:.1f} dB per octave and holds "
        f"{share:.1%} of its power. Check the mount, and look for shocks that overload the amplifier."
    )
    faulty_slope = 0.5
    return [graded("ski slope", faulty=share > faulty_slope, size=share, sentence=sentence)], None
