"""A rising function, known exactly at a cost, at every point of an even grid for little."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from signals._checks import Array

NODE_STEP = 64  # points between exact values
_CLOSE = 1e-8  # of a step of the other grid: 3e-8 rad at the end of the band

Curve = Callable[[Array], Array]


@dataclass(frozen=True, kw_only=True)
class Track:
    """``(value - offset) * scale`` on an even grid of the argument, and its slope a point.

    Between every `NODE_STEP`-th point it is a cubic, wherever that comes within 1e-8 at a third and at two thirds of
    the way; elsewhere every point is taken exactly. Beyond `start` and `stop` the function is reflected: what it did
    there last it does again, backwards.

    Attributes
    ----------
    value, slope : the function and its derivative, of an array of arguments from `start` to `stop`.
    origin, spacing : the argument of point 0 and from one point to the next.
    """

    value: Curve
    slope: Curve
    start: float
    stop: float
    origin: float
    spacing: float
    offset: float
    scale: float

    def at(self, first: int, last: int) -> tuple[Array, Array]:
        """Value and slope at the points from `first` up to and without `last`."""
        from signals._resampling_kernel import hermite  # noqa: PLC0415

        cell = first // NODE_STEP
        nodes = NODE_STEP * np.arange(cell, (last - 1) // NODE_STEP + 2, dtype=np.float64)
        values, slopes = self._values(nodes), self._slopes(nodes)
        skip = first - cell * NODE_STEP
        out, out_slopes = np.empty(last - first), np.empty(last - first)
        hermite(values, slopes, NODE_STEP, skip, out, out_slopes)
        for place in self._rough(nodes, values, slopes):
            begin, end = max(place * NODE_STEP - skip, 0), min((place + 1) * NODE_STEP - skip, out.size)
            points = np.arange(first + begin, first + end, dtype=np.float64)
            out[begin:end], out_slopes[begin:end] = self._values(points), self._slopes(points)
        return out, out_slopes

    def _rough(self, nodes: Array, values: Array, slopes: Array) -> list[int]:
        """Cells in which the cubic is not close."""
        rise = np.diff(values)
        early, late = NODE_STEP * slopes[:-1] - rise, rise - NODE_STEP * slopes[1:]
        rough = np.zeros(rise.size, dtype=bool)
        for u in (1 / 3, 2 / 3):
            cubic = values[:-1] + u * rise + u * (1 - u) * ((1 - u) * early + u * late)
            rough |= ~(np.abs(cubic - self._values(nodes[:-1] + u * NODE_STEP)) <= _CLOSE)
        return [int(place) for place in np.flatnonzero(rough)]

    def _values(self, points: Array) -> Array:
        inside, turn = self._reflected(points)
        found = self.value(inside)
        if turn is not None:
            low, high = self.value(np.array([self.start, self.stop]))
            found = np.where(turn % 2 == 0, found, low + high - found) + turn * (high - low)
        return (found - self.offset) * self.scale

    def _slopes(self, points: Array) -> Array:
        return np.asarray(self.slope(self._reflected(points)[0]) * (self.scale * self.spacing))

    def _reflected(self, points: Array) -> tuple[Array, Array | None]:
        """Arguments brought back between start and stop, and how many ends were passed; None for none at all."""
        argument = self.origin + self.spacing * points
        if argument[0] >= self.start and argument[-1] <= self.stop:
            return argument, None
        span = self.stop - self.start
        turn = np.floor((argument - self.start) / span)
        turn[(argument >= self.start) & (argument <= self.stop)] = 0
        back = np.where(turn % 2 == 0, argument - turn * span, self.start + self.stop - (argument - turn * span))
        return np.clip(back, self.start, self.stop), turn
