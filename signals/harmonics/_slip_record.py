"""A record over the angle of its shaft, the line that is looked for in it, and the record demodulated there."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import pi
from typing import Self

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._phasors import phasors

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Whole = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipRecord:
    """Samples, and the angle of the shaft at each, which may rest and turn back."""

    x: Floats  # (n,)
    phase: Floats  # (n,), rad

    @cached_property
    def turning(self) -> Floats:
        """(n,) array, how far the shaft has turned since the first sample, either way, in rad."""
        return np.append(0.0, np.cumsum(np.abs(np.diff(self.phase))))

    @cached_property
    def per_rev(self) -> float:
        """Samples in a revolution, at the speed with which an angle is turned on average: rests do not count."""
        step = np.diff(self.phase)
        return float(2 * pi * self.turning[-1] / (step @ step))


@dataclass(frozen=True, kw_only=True)
class Line:
    """What is looked for."""

    order: float  # of the fundamental, cycles per revolution
    harmonics: int  # how many
    largest_slip: float  # relative to the order
    slip_change: float  # standard deviation of the slip's change in a revolution

    @property
    def top(self) -> float:
        """Order of the highest harmonic."""
        return self.order * self.harmonics

    @property
    def steady_rev(self) -> float:
        """Revolutions over which the walk of the slip turns the highest harmonic by a radian."""
        # A walk of variance v a revolution turns by an angle of variance (2 pi order)^2 v m^3 / 3 in m of them.
        return float((np.sqrt(3) / (2 * pi * self.top * self.slip_change)) ** (2 / 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class Demodulated:
    """A record times exp(-j k order phase), summed over short blocks."""

    sums: Complexes  # (harmonic, block)
    counts: Floats  # (block,), of observed samples
    turned: Floats  # (block,), how far the shaft turns in each, rad
    angle: Floats  # (block,), of the shaft at the middle of each, rad
    parts: tuple[slice, ...]  # the blocks of each segment

    @classmethod
    def of(cls, record: SlipRecord, *, order: float, harmonics: int, block: int, cuts: Whole) -> Self:
        """Sum over blocks of so many samples, within segments that begin and end at the cuts."""
        n = record.x.size
        begins = np.zeros(n + 1, dtype=np.bool_)
        begins[::block] = begins[cuts] = True
        edges = np.flatnonzero(begins)
        observed = ~np.isnan(record.x)
        turn = phasors(order * record.phase)
        sums = np.empty((harmonics, edges.size - 1), dtype=np.complex128)
        product = np.where(observed, record.x, 0.0).astype(np.complex128)
        for harmonic in sums:
            product *= turn
            np.add.reduceat(product, edges[:-1], out=harmonic)
        return cls(
            sums=sums,
            counts=np.add.reduceat(observed.astype(np.float64), edges[:-1]),
            turned=np.diff(record.turning[np.minimum(edges, n - 1)]),
            angle=record.phase[(edges[:-1] + edges[1:]) // 2],
            parts=tuple(slice(int(a), int(b)) for a, b in pairwise(np.searchsorted(edges, cuts))),
        )

    def power(self, part: slice, harmonic: int, deviations: Floats, *, window: Floats | float = 1.0) -> Floats:
        """(deviation,) array, power of a segment at orders so far from that of a harmonic; of white noise R in each."""
        lead = self.angle[part] - self.angle[part].mean()
        sums = phasors(np.outer(deviations, lead)) @ (window * self.sums[harmonic, part])
        seen = float(np.sum(np.square(window) * self.counts[part]))
        return np.asarray((sums.real**2 + sums.imag**2) / (seen or 1.0))
