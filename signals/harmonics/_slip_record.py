"""A record over the angle of its shaft, the line that is looked for in it, and the noise beside that line.

The noise is measured by the power of cells of order near the line that no harmonic reaches. Where there is nothing but
noise these powers are independent and exponentially distributed. Other lines may stand in some: so only the lower half
of them counts, the others for no more than the highest of that half. The mean of such a sum has the Gamma
distribution of as many powers as it counts (Epstein and Sobel 1953 [1]_).

References
----------
.. [1] B. Epstein, M. Sobel, "Life testing", J. American Statistical Association 48, 1953.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import pi
from typing import Self

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._phasors import fill_phasors

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Whole = NDArray[np.int64]

# Of cells of noise, in widths, 1 / segment. Under Hann's window cells this far apart are as good as independent, a
# line this far away is 41 dB down and falls off by 18 dB an octave.
_SPACING = 2
_AWAY = 3
_CELLS = 24  # in a segment, for each harmonic
_FEWEST = 16  # in the record
_WANTED = 64  # in the record


@dataclass(frozen=True, kw_only=True, eq=False)
class SlipRecord:
    """Samples, and the angle of the shaft at each, which may rest and turn back.

    Attributes
    ----------
    x : (n,) array.
    phase : (n,) array, rad.
    """

    x: Floats
    phase: Floats

    @cached_property
    def turning(self) -> Floats:
        """(n,) array, how far the shaft has turned since the first sample, either way, in rad."""
        return np.append(0.0, np.cumsum(np.abs(np.diff(self.phase))))

    @cached_property
    def per_rev(self) -> float:
        """Samples in a revolution, at the speed with which an angle is turned on average: rests do not count."""
        step = np.diff(self.phase)
        return float(2 * pi * self.turning[-1] / (step @ step))

    def while_turning(self) -> Self:
        """Return the record without the samples at which the shaft rests."""
        still = np.concatenate([[True], np.diff(self.turning) == 0, [True]])
        return replace(self, x=np.where(still[:-1] & still[1:], np.nan, self.x))


@dataclass(frozen=True, kw_only=True)
class Line:
    """What is looked for.

    Attributes
    ----------
    order : cycles per revolution.
    harmonics : how many.
    largest_slip : relative.
    slip_change : standard deviation of the slip's change in a revolution.
    """

    order: float
    harmonics: int
    largest_slip: float
    slip_change: float

    @property
    def top(self) -> float:
        """Order of the highest harmonic."""
        return self.order * self.harmonics

    @property
    def steady_rev(self) -> float:
        """Revolutions over which the walk of the slip turns the highest harmonic by a radian."""
        # A walk of variance v a revolution turns by an angle of variance (2 pi order)^2 v m^3 / 3 in m of them.
        return float((np.sqrt(3) / (2 * pi * self.top * self.slip_change)) ** (2 / 3))


def phasors(angle: Floats) -> Complexes:
    """Return exp(-j angle)."""
    cosine, sine = np.empty(angle.size), np.empty(angle.size)
    fill_phasors(-1.0, angle.ravel(), cosine, sine)
    return (cosine + 1j * sine).reshape(angle.shape)


@dataclass(frozen=True, kw_only=True, eq=False)
class Demodulated:
    """A record times exp(-j k order phase), summed over short blocks.

    Attributes
    ----------
    sums : (harmonic, block) array.
    counts : (block,) array, of observed samples.
    turned : (block,) array, how far the shaft turns in each, rad.
    angle : (block,) array, of the shaft at the middle of each, rad.
    parts : the blocks of each segment.
    """

    sums: Complexes
    counts: Floats
    turned: Floats
    angle: Floats
    parts: tuple[slice, ...]

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


def cells_beside(record: SlipRecord, line: Line, *, width: float, segments: int) -> list[Floats]:
    """Choose the cells nearest to the searched bands: not in one, nor near order 0 or half of the rate.

    Returns
    -------
    For each harmonic the orders, counted from it, of the cells to which it is the nearest.
    """
    fastest = float(np.diff(record.turning).max())
    order = width * np.arange(_AWAY, pi / fastest / width - 1, _SPACING)
    number = np.arange(1, line.harmonics + 1)
    away = order[:, None] - number * line.order
    beyond = np.min(np.abs(away) - number * line.order * line.largest_slip, axis=1)
    good = np.flatnonzero(beyond >= _AWAY * width)
    near = good[np.argsort(beyond[good], kind="stable")]
    away = away[near[: max(_CELLS * line.harmonics, -(-_WANTED // segments))]]
    nearest = np.abs(away).argmin(axis=1)
    return [away[nearest == k, k] for k in range(line.harmonics)]


def noise_beside(data: Demodulated, cells: list[Floats], *, order: float) -> tuple[float, int]:
    """Measure the variance of white noise as dense as that in the cells.

    Returns
    -------
    The variance, and how many powers count: it has the distribution of the mean of so many.
    """
    powers = []
    for part in data.parts:
        angle, counts, turned = data.angle[part], data.counts[part], data.turned[part]
        lead = angle - (angle.max() + angle.min()) / 2
        window = 0.5 + 0.5 * np.cos(lead * (2 * pi / max(np.ptp(lead), 1e-300)))
        # What is half a gap has cells half as fine: neighbours are not independent, and the line is in some.
        if turned[counts > 0].sum() >= turned.sum() / 2 and window @ counts > 0:
            powers += [data.power(part, k, away, window=window) for k, away in enumerate(cells)]
    values = np.sort(np.concatenate(powers)) if powers else np.empty(0)
    if values.size < _FEWEST:
        raise ValueError(
            f"the noise beside order {order:g} shows in {values.size} independent cells of the record, and {_FEWEST} "
            "are needed to tell its variance: take a longer record or fewer harmonics, or pass noise_variance."
        )
    lower = values.size // 2
    noise = float(values[:lower].sum() + (values.size - lower) * values[lower - 1]) / lower
    if noise <= 0:
        raise ValueError(
            f"x shows no noise beside order {order:g} ({values.size} cells were looked at), and without it "
            "nothing can be weighed: pass noise_variance."
        )
    return noise, lower
