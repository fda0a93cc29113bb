"""Faults that single samples show: flat tops, stretches of one value, and lone spikes.

Each is held against what the record's own resolution makes likely, since a coarse converter repeats values too.
"""

import numpy as np
from numpy.typing import NDArray

from signals._checks import Samples
from signals.health.faults import SensorFault, graded

Mask = NDArray[np.bool_]

_PILE = 4.0  # a sine on a coarse converter puts 2.4 times as many samples on its last level as on the one before
_ENOUGH = 16  # samples below the extreme, that its count is held against
_NEAR = 4096
_SICK_CLIPPED = 0.01
_CHANCE = 1e-6  # of one run this long in a sound record
_SHORTEST_RUN = 5
_STEPS = 2.0  # of the resolution, by which a stretch is left or entered
_SICK_LOST = 0.01
_STUCK = 0.1  # of the record
_SPIKE = 8.0  # robust standard deviations
_LONE = 0.25  # what its surroundings reach of a spike's height; a ringing structure keeps more
_BESIDE = 6  # samples
_ABOVE_REST = 1.5  # times all that is not lone
_SICK_SPIKES = 1e-3


def clipping(x: Samples, *, rate_hz: float, units: str) -> tuple[list[SensorFault], Mask]:
    """Find extremes that repeat more often than the levels next to them let expect; mark those samples, (n,)."""
    clipped = np.zeros(x.size, dtype=np.bool_)
    sides = []
    for extreme, sign in ((float(x.max()), 1.0), (float(x.min()), -1.0)):
        at = x == extreme
        count = int(np.count_nonzero(at))
        if count > _PILE and count > _PILE * _usual_count(sign * x, sign * extreme):
            clipped |= at
            sides.append(f"{extreme:.6g} {units} {count} times")
    if not sides:
        return [], clipped
    share = float(np.mean(clipped))
    first = int(np.argmax(clipped)) / rate_hz
    sentence = (
        f"it is clipped: it reaches {' and '.join(sides)}, {share:.3%} of the samples, first after {first:.4g} s. "
        "Widen the measuring range, or leave those samples out."
    )
    return [graded("clipping", sick=share > _SICK_CLIPPED, size=share, sentence=sentence)], clipped


def _usual_count(x: Samples, extreme: float) -> float:
    """Return how many samples a level next below the extreme holds, over as many levels as hold sixteen."""
    below = x[x < extreme]
    near = min(below.size, _NEAR)
    below.partition(below.size - near)
    counts = np.unique(below[below >= below[-near]], return_counts=True)[1][::-1]
    if counts.size == 1:  # a signal of two levels, such as a tachometer's
        return float(x.size)
    together = np.cumsum(counts)
    levels = min(int(np.searchsorted(together, _ENOUGH)), counts.size - 1) + 1
    return float(together[levels - 1] / levels)


def dropouts(x: Samples, *, missing: Mask, rate_hz: float, units: str) -> tuple[list[SensorFault], Mask]:
    """Find stretches of one value longer than the record's resolution explains, and gaps; mark those samples, (n,).

    Runs of a sound record are geometric: what they go on with, from one sample to the next, gives the length that one
    in a million records reaches. A slow swing over a coarse converter lingers on its crests longer than that; but it
    enters and leaves them by single steps, and a stretch counts only beyond two.
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
        sudden = np.maximum(entry, leave) > _STEPS * float(np.min(np.diff(values)))
        extreme = (x[start] == values[0]) | (x[start] == values[-1])
        extreme &= length <= _STUCK * x.size  # a flat top is clipping, but not one as long as that
        for place in np.flatnonzero(sudden & ~extreme):
            lost[start[place] : stop[place]] = True
    if not lost.any():
        return [], np.zeros(x.size, dtype=np.bool_)  # which takes no memory until it is written to
    return [_about_lost(x, lost, rate_hz=rate_hz, units=units)], lost


def _about_lost(x: Samples, lost: Mask, *, rate_hz: float, units: str) -> SensorFault:
    start, length = _runs(lost)
    share, worst = float(np.mean(lost)), int(np.argmax(length))
    where = f"{length[worst] / rate_hz:.4g} s from {start[worst] / rate_hz:.4g} s on"
    value = x[start[worst] + length[worst] // 2]
    if start[worst] + length[worst] == x.size and length[worst] > _STUCK * x.size:
        sentence = f"it is stuck at {value:.6g} {units} to the end, for {where}. Check sensor, cable and supply."
        return graded("stuck", sick=True, size=share, sentence=sentence)
    sentence = (
        f"it drops out {start.size} times, {share:.3%} of the samples; the longest stretch, at {value:.6g} {units}, "
        f"lasts {where}. Check cable and logger, or leave those samples out."
    )
    return graded("drop-out", sick=share > _SICK_LOST, size=share, sentence=sentence)


def _runs(mask: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where stretches of True start and how long they are."""
    edges = np.flatnonzero(mask[1:] != mask[:-1]) + 1
    edges = np.concatenate([[0] if mask[0] else [], edges, [mask.size] if mask[-1] else []]).astype(np.intp)
    return edges[::2], edges[1::2] - edges[::2]


def _longest_run(several: int, runs: int, samples: int) -> int:
    """Return the length that a run of chance reaches in one of a million records: so many of all runs go on."""
    going_on = several / runs  # of a geometric law; long runs count once
    if going_on == 0:
        return _SHORTEST_RUN
    if going_on == 1:
        return samples + 1
    return max(_SHORTEST_RUN, 1 + int(np.ceil(np.log(_CHANCE / samples) / np.log(going_on))))


def spikes(x: Samples, *, rate_hz: float, units: str) -> tuple[list[SensorFault], Mask]:
    """Find lone samples far above all around them and all else in the record; mark them and their neighbours, (n,).

    What strikes a machine makes it ring for many samples; what strikes a cable does not. Among the thousand impacts of
    a bad bearing some look lone by chance, so a spike must stand above the largest of the rest too.
    """
    height = np.abs(x - float(np.median(x)))
    level = 1.4826 * float(np.median(height))
    lone = np.array([at for at in np.flatnonzero(height > _SPIKE * level) if _is_lone(height, int(at))], dtype=np.intp)
    found = _with_neighbours(lone, x.size)
    if level > 0 and lone.size and not found.all():
        lone = lone[height[lone] > _ABOVE_REST * float(np.max(height[~found]))]
        found = _with_neighbours(lone, x.size)
    if level == 0 or not lone.size:
        return [], np.zeros(x.size, dtype=np.bool_)
    largest = int(lone[np.argmax(height[lone])])
    sentence = (
        f"it has {lone.size} lone spikes, the largest {height[largest]:.4g} {units} or "
        f"{height[largest] / level:.3g} robust standard deviations high, after {largest / rate_hz:.6g} s. Check the "
        "cable and what is switched nearby."
    )
    sick = lone.size > _SICK_SPIKES * x.size
    return [graded("spikes", sick=sick, size=float(lone.size), sentence=sentence)], found


def _is_lone(height: Samples, at: int) -> bool:
    """Tell whether a sample is the top of at most three, with little on either side of them."""
    beside = np.concatenate((height[max(at - _BESIDE, 0) : max(at - 1, 0)], height[at + 2 : at + 1 + _BESIDE]))
    top = bool(height[at] == height[max(at - 1, 0) : at + 2].max())
    return top and float(np.sqrt(np.mean(beside**2))) < _LONE * height[at]


def _with_neighbours(places: NDArray[np.intp], size: int) -> Mask:
    mask = np.zeros(size, dtype=np.bool_)
    for offset in (-1, 0, 1):
        mask[np.clip(places + offset, 0, size - 1)] = True
    return mask
