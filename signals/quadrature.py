"""Edges and direction of rotation from two tachometer channels in quadrature."""

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
    """Edges of two channels in quadrature, four per stripe, with the direction of rotation at each.

    For `shaft_phase`: ``shaft_phase(edges.times_s, direction=edges.direction, pulses_per_rev=4 * stripes)``.

    Attributes
    ----------
    times_s : (edge,) array
        Times of the edges in s.
    direction : (edge,) array
        +1 where the first channel leads the second, else -1.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import quadrature_direction
    >>> angle = 2 * np.pi * np.arange(1000) / 100
    >>> edges = quadrature_direction(np.sin(angle), np.sin(angle - np.pi / 2), rate_hz=1000)
    >>> np.diff(edges.times_s[5:9]).round(3).tolist()
    [0.025, 0.025, 0.025]
    """

    times_s: Array = field(metadata={"dims": ("edge",), "units": "s"})
    direction: NDArray[np.int64] = field(metadata={"dims": ("edge",), "units": "1"})


def quadrature_direction(
    first: ArrayLike, second: ArrayLike, *, rate_hz: float, start_s: float = 0.0
) -> QuadratureEdges:
    """Return all edges of two channels in quadrature, with the direction of rotation at each.

    The two channels have four states per stripe, whose order gives the direction. Where the shaft reverses, the same
    edge passes twice, once in each direction.

    Parameters
    ----------
    first, second : (n,) arrays, any unit
        Waveforms of the two channels on one clock; the second lags by a quarter of a stripe in forward rotation.
    rate_hz : float
        Sampling rate in Hz.
    start_s : float
        Time of the first sample in s.

    Returns
    -------
    QuadratureEdges

    Raises
    ------
    ValueError
        Channels of unequal length; two consecutive edges of one channel with the same sign, so that one is missing; or
        too few edges.

    Examples
    --------
    A shaft that reverses half-way:

    >>> import numpy as np
    >>> from signals import quadrature_direction
    >>> angle = 2 * np.pi * np.abs(np.arange(1001) - 500.3) / 100
    >>> edges = quadrature_direction(np.sin(angle - np.pi / 2), np.sin(angle), rate_hz=1000)
    >>> edges.direction[[0, -1]].tolist()
    [1, -1]
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
    quarter = np.array([[0, 3], [1, 2]])[states[:, 0], states[:, 1]]  # forward: 00, 10, 11, 01
    steps = (np.diff(quarter) + 1) % 4 - 1
    return QuadratureEdges(times_s=times[1:], direction=steps)


def _states(channel: NDArray[np.int64], level: NDArray[np.int64], times: Array) -> NDArray[np.int64]:
    """Return the states of both channels after each edge, (edge, 2), or raise where an edge is missing."""
    states = np.empty((channel.size, 2), dtype=np.int64)
    for which in (0, 1):
        own = np.flatnonzero(channel == which)
        repeated = np.flatnonzero(np.diff(level[own]) == 0)
        if repeated.size:
            i = own[repeated[0] + 1]
            raise ValueError(
                f"channel {which + 1} {'rises' if level[i] else 'falls'} twice in a row, the second time at "
                f"{times[i]:g} s: an edge is missing. Check that channel, or use the part of the record without it."
            )
        latest = np.searchsorted(own, np.arange(channel.size), side="right") - 1
        states[:, which] = np.where(latest >= 0, level[own[np.maximum(latest, 0)]], 1 - level[own[0]])
    return states
