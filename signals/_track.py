"""Evaluation of an increasing function on an even grid: cubic Hermite between exact nodes, with an error bound."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from signals._checks import Array

NODE_STEP = 64  # points between exact values
_TOLERANCE = 1e-8  # of a step of the other grid: 3e-8 rad at the end of the band

Curve = Callable[[Array], Array]


@dataclass(frozen=True, kw_only=True)
class Track:
    """``(value - offset) * scale`` on an even grid of the argument, and its slope per point.

    Between every `NODE_STEP`-th point it is a Hermite cubic, wherever that is within 1e-8 at a third and at two thirds
    of the way; elsewhere the function is evaluated at every point. Beyond `start` and `stop` the function is continued
    by point reflection about its ends.

    Attributes
    ----------
    value, slope
        The function and its derivative, of an array of arguments from `start` to `stop`.
    origin, spacing
        The argument of point 0 and the step from one point to the next.
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
        """Return value and slope at the points from `first` up to, but not including, `last`."""
        from signals._resampling_kernel import hermite  # noqa: PLC0415

        cell = first // NODE_STEP
        nodes = NODE_STEP * np.arange(cell, (last - 1) // NODE_STEP + 2, dtype=np.float64)
        values, slopes = self._values(nodes), self._slopes(nodes)
        skip = first - cell * NODE_STEP
        out, out_slopes = np.empty(last - first), np.empty(last - first)
        hermite(values, slopes, NODE_STEP, skip, out, out_slopes)
        for inexact in self._inexact_cells(nodes, values, slopes):
            begin, end = max(inexact * NODE_STEP - skip, 0), min((inexact + 1) * NODE_STEP - skip, out.size)
            points = np.arange(first + begin, first + end, dtype=np.float64)
            out[begin:end], out_slopes[begin:end] = self._values(points), self._slopes(points)
        return out, out_slopes

    def _inexact_cells(self, nodes: Array, values: Array, slopes: Array) -> list[int]:
        """Return the cells in which the cubic exceeds the tolerance."""
        rise = np.diff(values)
        early, late = NODE_STEP * slopes[:-1] - rise, rise - NODE_STEP * slopes[1:]
        inexact = np.zeros(rise.size, dtype=bool)
        for u in (1 / 3, 2 / 3):
            cubic = values[:-1] + u * rise + u * (1 - u) * ((1 - u) * early + u * late)
            inexact |= ~(np.abs(cubic - self._values(nodes[:-1] + u * NODE_STEP)) <= _TOLERANCE)
        return [int(index) for index in np.flatnonzero(inexact)]

    def _values(self, points: Array) -> Array:
        inside, passed = self._reflected(points)
        found = self.value(inside)
        if passed is not None:
            low, high = self.value(np.array([self.start, self.stop]))
            found = np.where(passed % 2 == 0, found, low + high - found) + passed * (high - low)
        return (found - self.offset) * self.scale

    def _slopes(self, points: Array) -> Array:
        return np.asarray(self.slope(self._reflected(points)[0]) * (self.scale * self.spacing))

    def _reflected(self, points: Array) -> tuple[Array, Array | None]:
        """Return the arguments reflected into start..stop, and the number of ends passed; None where none is."""
        argument = self.origin + self.spacing * points
        if argument[0] >= self.start and argument[-1] <= self.stop:
            return argument, None
        span = self.stop - self.start
        passed = np.floor((argument - self.start) / span)
        passed[(argument >= self.start) & (argument <= self.stop)] = 0
        shifted = argument - passed * span
        reflected = np.where(passed % 2 == 0, shifted, self.start + self.stop - shifted)
        return np.clip(reflected, self.start, self.stop), passed
