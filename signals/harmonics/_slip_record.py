"""A record over the angle of its shaft, the line that is looked for in it, and the record demodulated there."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import pi
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import real_vector
from signals.harmonics import _slip_kernels

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Whole = NDArray[np.int64]

# Samples beyond these, whose squares would not fit; and in standard deviations of the noise, in double precision.
_SMALLEST, _LARGEST, _LOUDEST = 1e-100, 1e100, 1e12


def check_samples(x: ArrayLike, *, noise_variance: float | None) -> Floats:
    """Return the samples, or refuse what is infinite, missing throughout, or beyond double precision."""
    record = real_vector(x, name="x", minimum=4, finite=False)
    infinite = np.flatnonzero(np.isinf(record))
    if infinite.size:
        raise ValueError(
            f"x[{infinite[0]}]={record[infinite[0]]} (and {infinite.size - 1} more) is infinite; "
            "samples must be finite, or NaN where missing: mark bad samples as NaN."
        )
    if np.isnan(record).all():
        raise ValueError(f"x has {record.size} samples, all of them missing (NaN); observed ones are needed.")
    peak = float(np.nanmax(np.abs(record)))
    if peak and not _SMALLEST <= peak <= _LARGEST:
        raise ValueError(
            f"x reaches {peak:g}, whose square is lost in double precision; give x in a unit in which it reaches "
            f"between {_SMALLEST:g} and {_LARGEST:g}."
        )
    if noise_variance is not None and peak > _LOUDEST * np.sqrt(noise_variance):
        raise ValueError(
            f"noise_variance={noise_variance:g} makes x of up to {peak:g} {peak / np.sqrt(noise_variance):.2g} times "
            f"the noise; double precision ends at {_LOUDEST:g}: give the variance of all that the line leaves over."
        )
    return record


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

    def memory_rad(self, width: Floats) -> float:
        """Tell the turning over which an amplitude of this bandwidth, cycles a sample, one or one a sample, keeps."""
        mean = width[0] if width.size == 1 else np.average(width[1:], weights=np.diff(self.turning))
        return float(2 * pi / (mean * self.per_rev)) if mean > 0 else np.inf


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

    def check(self, record: SlipRecord) -> None:
        """Refuse a slip of everything, a shaft that rests throughout, and lines above half of the rate."""
        if self.largest_slip >= 1:
            raise ValueError(
                f"largest_slip={self.largest_slip:g} is relative to the order and must be below 1; 2 % is 0.02."
            )
        turns = self.top * record.turning[-1] / (2 * pi)
        if turns < 1:
            raise ValueError(
                f"phase_rad turns by {record.turning[-1]:g} rad in all, order {self.top:g} by {turns:g} turns: "
                "the shaft has turned too little to tell a slip; take a longer record, or give the angle in rad."
            )
        step = np.diff(record.turning)
        at = int(step.argmax())
        fastest = self.top * (1 + self.largest_slip) * step[at]
        if fastest > pi:
            raise ValueError(
                f"order {self.top:g} with a slip of {self.largest_slip:g} turns by {fastest:.4g} rad between samples "
                f"{at} and {at + 1}; more than pi is above half of the rate: take fewer harmonics, raise the rate, or "
                "mend the phase there."
            )


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
        edges = np.unique(np.append(cuts, np.arange(0, record.x.size, block)))
        sums = np.zeros((harmonics, edges.size - 1), dtype=np.complex128)
        counts = np.zeros(edges.size - 1)
        _slip_kernels.demodulate(record.x, record.phase, order, edges, sums, counts)
        return cls(
            sums=sums,
            counts=counts,
            turned=np.diff(record.turning[np.minimum(edges, record.x.size - 1)]),
            angle=record.phase[(edges[:-1] + edges[1:]) // 2],
            parts=tuple(slice(int(a), int(b)) for a, b in pairwise(np.searchsorted(edges, cuts))),
        )
