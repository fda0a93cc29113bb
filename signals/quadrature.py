"""Two tachometer channels a quarter of a stripe apart: every edge, and which way the shaft turned over it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from signals.pulses import pulse_times

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from signals._checks import Array


@dataclass(frozen=True, kw_only=True)
class QuadratureEdges:
    """Edges of both channels in order of time, four a stripe, and the way the shaft turned over each, +1 or -1.

    Forward is the way in which the first channel rises before the second. For `shaft_phase`: its `times_s`, with
    ``direction=edges.direction`` and ``pulses_per_rev`` four times the stripes.
    """

    times_s: Array = field(metadata={"dims": ("edge",), "units": "s"})
    direction: NDArray[np.int64] = field(metadata={"dims": ("edge",), "units": "1"})


def quadrature_direction(
    first: ArrayLike, second: ArrayLike, *, rate_hz: float, start_s: float = 0.0
) -> QuadratureEdges:
    """Find all edges of two channels in quadrature and the direction of each.

    The two channels run through four states a stripe; the next state tells the way. Where the shaft turns about, the
    same edge passes twice, and counts once forward and once back.

    Parameters
    ----------
    first, second : (n,) arrays, any unit
        Waveforms of the two channels on one clock; the second is a quarter of a stripe behind when turning forward.
    rate_hz : float
    start_s : float
        Time of the first sample.

    Raises
    ------
    ValueError
        Channels of unequal length; an edge of one channel seen twice with the same sign, so that one is missing; or
        too few edges.
    """
    a, b = np.asarray(first), np.asarray(second)
    if a.shape != b.shape:
        raise ValueError(f"the channels have {a.shape} and {b.shape} samples; both must cover the same time.")
    found = []
    for channel, wave in enumerate((a, b)):
        for level, edge in ((1, "rising"), (0, "falling")):
            times = pulse_times(wave, rate_hz=rate_hz, start_s=start_s, edge=edge).times_s  # type: ignore[arg-type]
            found.append(np.stack([times, np.full(times.size, channel), np.full(times.size, level)]))
    edges = np.concatenate(found, axis=1)
    times, channel, level = edges[:, np.argsort(edges[0], kind="stable")]
    states = _states(channel.astype(np.int64), level.astype(np.int64), times)
    # forward: 00, 10, 11, 01
    turn = np.array([[0, 3], [1, 2]])[states[:, 0], states[:, 1]]
    steps = (np.diff(turn) + 1) % 4 - 1
    return QuadratureEdges(times_s=times[1:], direction=steps)


def _states(channel: NDArray[np.int64], level: NDArray[np.int64], times: Array) -> NDArray[np.int64]:
    """State of both channels after each edge, (edge, 2); refuse edges that contradict each other."""
    states = np.empty((channel.size, 2), dtype=np.int64)
    for which in (0, 1):
        mine = np.flatnonzero(channel == which)
        repeated = np.flatnonzero(np.diff(level[mine]) == 0)
        if repeated.size:
            i = mine[repeated[0] + 1]
            raise ValueError(
                f"channel {which + 1} {'rises' if level[i] else 'falls'} twice on end, the second time at "
                f"{times[i]:g} s: an edge is missing. Check that channel, or use the part of the record without it."
            )
        latest = np.searchsorted(mine, np.arange(channel.size), side="right") - 1
        states[:, which] = np.where(latest >= 0, level[mine[np.maximum(latest, 0)]], 1 - level[mine[0]])
    return states
