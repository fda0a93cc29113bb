"""Which way a shaft turns, and where it rests, by the knots of its phase."""

import math

import numpy as np

from signals._checks import Array


def turning(times_s: Array, revolutions: Array) -> int:
    """Return +1 where the angle rises and -1 where it falls; it may stay.

    Raises
    ------
    ValueError
        A shaft that turns both ways.
    """
    steps = np.diff(revolutions)
    moving = np.flatnonzero(steps)
    ways = np.sign(steps[moving])
    back = np.flatnonzero(np.diff(ways))
    if back.size:
        place = times_s[moving[back[0] + 1]]
        raise ValueError(
            f"the shaft turns back at {place:g} s, so an angle has several times; resample the record before and after "
            "apart, each over a phase of the pulses there alone."
        )
    return -1 if np.any(ways < 0) else 1


def refuse_rest(
    times_s: Array, revolutions: Array, *, start_s: float, stop_s: float, rate_hz: float | None = None
) -> None:
    """Raise where the shaft stands within a span and moves before and after; with a rate, say which samples to take.

    Raises
    ------
    ValueError
        With the times of the first rest, and how many there are.
    """
    still = np.concatenate([[False], np.diff(revolutions) == 0, [False]])
    edges = np.flatnonzero(np.diff(still))
    begins, ends = times_s[edges[::2]], times_s[edges[1::2]]
    within = np.flatnonzero((begins > max(start_s, times_s[0])) & (ends < min(stop_s, times_s[-1])))
    if not within.size:
        return
    begin, end = float(begins[within[0]]), float(ends[within[0]])
    remedy = "use the parts before and after, each by itself."
    if rate_hz is not None:
        # of whole samples, those that the rest begins and ends between
        stop, start = math.floor((begin - start_s) * rate_hz) + 1, math.ceil((end - start_s) * rate_hz)
        remedy = f"resample x[:{stop}] and, with start_s={start_s + start / rate_hz:.9g}, x[{start}:], each by itself."
    raise ValueError(
        f"the shaft stands still from {begin:g} to {end:g} s, within the record, and its angle there has no single "
        f"time ({within.size} such rests); {remedy}"
    )
