"""Direction of rotation and standstills of a shaft, from the knots of its phase."""

import math

import numpy as np

from signals._checks import Array


def direction_of(times_s: Array, revolutions: Array) -> int:
    """Return the direction of rotation, +1 or -1; the angle may also stay.

    Raises
    ------
    ValueError
        A shaft that reverses.
    """
    steps = np.diff(revolutions)
    moving = np.flatnonzero(steps)
    signs = np.sign(steps[moving])
    reversals = np.flatnonzero(np.diff(signs))
    if reversals.size:
        time = times_s[moving[reversals[0] + 1]]
        raise ValueError(
            f"the shaft turns back at {time:g} s, so an angle has several times; resample the record before and after "
            "separately, each with a phase of its own pulses."
        )
    return -1 if np.any(signs < 0) else 1


def refuse_rest(
    times_s: Array, revolutions: Array, *, start_s: float, stop_s: float, rate_hz: float | None = None
) -> None:
    """Raise where the shaft stands within a span of time; given the sampling rate, name the samples to use instead.

    Raises
    ------
    ValueError
        With the times of the first standstill, and how many there are.
    """
    still = np.concatenate([[False], np.diff(revolutions) == 0, [False]])
    edges = np.flatnonzero(np.diff(still))
    begins, ends = times_s[edges[::2]], times_s[edges[1::2]]
    within = np.flatnonzero((begins > max(start_s, times_s[0])) & (ends < min(stop_s, times_s[-1])))
    if not within.size:
        return
    begin, end = float(begins[within[0]]), float(ends[within[0]])
    remedy = "use the parts before and after separately."
    if rate_hz is not None:
        # the last sample before the standstill and the first after it
        stop, start = math.floor((begin - start_s) * rate_hz) + 1, math.ceil((end - start_s) * rate_hz)
        remedy = f"resample x[:{stop}] and, with start_s={start_s + start / rate_hz:.9g}, x[{start}:] separately."
    raise ValueError(
        f"the shaft stands still from {begin:g} to {end:g} s, within the record, and its angle there has no single "
        f"time ({within.size} such rests); {remedy}"
    )
