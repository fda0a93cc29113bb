"""Sudden, lasting changes of RMS or mean, as from a sensor that comes loose."""

import numpy as np

from signals._checks import Array, Samples
from signals.health.faults import SensorFault, graded

_PARTS = 64
_SIDE = 8  # parts on either side of a jump
_FEWEST_IN_PART = 64
_JUMP = 2.0  # smallest ratio of RMS
_FAULTY_JUMP = 8.0
_STEADY = 0.4  # largest range of the levels on either side, relative to the jump
_OFFSET = 3.0  # smallest jump of the mean over the RMS about it
_FAULTY_OFFSET = 30.0


def jumps(x: Samples, *, rate_hz: float, units: str) -> tuple[list[SensorFault], str | None]:
    """Return faults for sudden, lasting changes of RMS or mean, or the reason why they cannot be judged.

    The record is cut into 64 parts. A run-up changes its level from part to part; around a jump the level of eight
    parts on either side is steady.
    """
    if x.size < _PARTS * _FEWEST_IN_PART:
        return [], f"jumps of level need {_PARTS * _FEWEST_IN_PART} samples; the record has {x.size}"
    parts = x[: x.size // _PARTS * _PARTS].reshape(_PARTS, -1)
    part_s = parts.shape[1] / rate_hz
    mean = parts.mean(axis=1, dtype=np.float64)
    level = np.array([part.std(dtype=np.float64) for part in parts])
    found = []
    if level.min() > 0:
        at, jump = _largest_jump(np.log(level))
        if jump > np.log(_JUMP):
            before, after = (float(np.exp(np.median(np.log(side)))) for side in _sides(level, at))
            factor = float(np.exp(jump))
            sentence = (
                f"its level jumps from {before:.4g} to {after:.4g} {units} RMS, {factor:.3g} times, about "
                f"{at * part_s:.4g} s. Check mount and cable, or whether the load changed then."
            )
            found.append(graded("level jump", sick=factor > _FAULTY_JUMP, size=factor, sentence=sentence))
    at, jump = _largest_jump(mean)
    typical = float(np.median(level))
    if typical > 0 and jump > _OFFSET * typical:
        size = jump / typical
        sentence = (
            f"its mean jumps by {jump:.4g} {units}, {size:.3g} times its RMS, about {at * part_s:.4g} s. Check "
            "connector and supply."
        )
        found.append(graded("offset jump", sick=size > _FAULTY_OFFSET, size=size, sentence=sentence))
    return found, None


def _sides(values: Array, at: int) -> tuple[Array, Array]:
    return values[max(at - _SIDE, 0) : at], values[at : at + _SIDE]


def _largest_jump(values: Array) -> tuple[int, float]:
    """Return the part after the largest jump between steady levels, and its height; 0 where there is none."""
    best = (0, 0.0)
    for at in range(_SIDE, values.size - _SIDE + 1):
        before, after = _sides(values, at)
        before, after = before[:-1], after[1:]  # the parts that the jump itself may lie in
        height = abs(float(np.median(after) - np.median(before)))
        if height > best[1] and max(np.ptp(before), np.ptp(after)) < _STEADY * height:
            best = (at, height)
    return best
