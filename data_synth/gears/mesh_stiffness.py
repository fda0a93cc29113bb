"""Tooth mesh stiffness as a function of the mesh phase.

The phase is in mesh cycles: one cycle from the entry of one pair of teeth to that of the next, at any speed. A new pair
enters at integer phases. The effect of a damaged tooth has a period of as many cycles as its gear has teeth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_NODES = 24  # Gauss-Legendre nodes per third of a harmonic's cycle or smooth segment


class Stiffness(Protocol):
    """Stiffness of a mesh along its line of action."""

    @property
    def mean(self) -> float:
        """Mean over a period in N/m."""

    @property
    def period(self) -> int:
        """Period in mesh cycles: 1 for a healthy mesh, the number of teeth where one is damaged."""

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases in [0, period), increasing, of its discontinuities."""

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles, any shape."""


@dataclass(frozen=True, kw_only=True)
class Constant:
    """A constant stiffness, N/m.

    Raises
    ------
    ValueError
        If it is negative or not finite.

    Examples
    --------
    >>> from data_synth.dynamics import Constant
    >>> Constant(mean=2e8)([0.0, 0.5]).tolist()
    [200000000.0, 200000000.0]
    """

    mean: float
    period: int = field(default=1, init=False)
    jumps: tuple[float, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        _not_negative(self.mean, "mean")

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles, any shape."""
        return np.full(np.shape(phase_cycles), float(self.mean))


@dataclass(frozen=True, kw_only=True)
class Fourier:
    """A stiffness given by a Fourier series: ``mean + Re sum_h harmonics[h - 1] exp(2j pi h phase / period)``.

    Attributes
    ----------
    mean : float
        N/m.
    harmonics : (h,) complex array
        Complex peak amplitudes, N/m.
    period : int
        Mesh cycles.

    Raises
    ------
    ValueError
        If `mean` is negative or not finite, or `harmonics` is not a row of finite numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Fourier
    >>> Fourier(mean=2.0, harmonics=np.array([0.5]))([0.0, 0.25, 0.5]).round(9).tolist()  # 2 + 0.5 cos(2 pi phase)
    [2.5, 2.0, 1.5]
    """

    mean: float
    harmonics: ComplexArray = field(metadata={"dims": ("harmonic",), "units": "N/m"})
    period: int = 1
    jumps: tuple[float, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        _not_negative(self.mean, "mean")
        if np.ndim(self.harmonics) != 1 or not np.all(np.isfinite(self.harmonics)):
            raise ValueError(f"harmonics, of shape {np.shape(self.harmonics)}, must be a row of finite numbers.")

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles, any shape."""
        turn = np.exp(2j * np.pi / self.period * np.asarray(phase_cycles, dtype=np.float64))
        total = np.zeros_like(turn)
        for value in self.harmonics[::-1]:
            total = (total + value) * turn
        return np.asarray(self.mean + total.real)


@dataclass(frozen=True, kw_only=True)
class Rectangular:
    """A rectangular wave: `high` for the first part of every cycle, `low` for the rest.

    Attributes
    ----------
    low, high : float
        N/m.
    duty : float
        Fraction of the cycle at `high`, above 0 and below 1.

    Raises
    ------
    ValueError
        If a value is out of range.

    Examples
    --------
    With a contact ratio of 1.6 two pairs of teeth are in contact for 60 % of each cycle:

    >>> from data_synth.dynamics import Rectangular
    >>> k = Rectangular.by_contact_ratio(pair_stiffness=1.0, contact_ratio=1.6)
    >>> k([0.3, 0.8]).tolist(), round(k.mean, 9)
    ([2.0, 1.0], 1.6)
    """

    low: float
    high: float
    duty: float
    period: int = field(default=1, init=False)

    def __post_init__(self) -> None:
        _not_negative(self.low, "low")
        _not_negative(self.high, "high")
        if not 0 < self.duty < 1:
            raise ValueError(
                f"duty = {self.duty!r} must be above 0 and below 1; for a stiffness that does not vary use Constant."
            )

    @classmethod
    def by_contact_ratio(cls, *, pair_stiffness: float, contact_ratio: float, **shape: float) -> Self:
        """Return the stiffness of equal tooth pairs: ``ceil(ratio)`` pairs for ``ratio % 1`` cycles, then one fewer.

        Parameters
        ----------
        pair_stiffness : float
            Stiffness of one pair of teeth, N/m.
        contact_ratio : float
            Transverse contact ratio, not a whole number.
        **shape : float
            `ramp` of a `Trapezoidal` wave.
        """
        pairs = math.floor(contact_ratio)
        low, high = pairs * pair_stiffness, (pairs + 1) * pair_stiffness
        return cls(low=low, high=high, duty=contact_ratio - pairs, **shape)

    @property
    def mean(self) -> float:
        """Mean over a cycle in N/m."""
        return self.low + self.duty * (self.high - self.low)

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which the stiff part begins and ends."""
        return (0.0, self.duty)

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles, any shape."""
        phase = np.remainder(np.asarray(phase_cycles, dtype=np.float64), 1.0)
        return np.where(phase < self.duty, float(self.high), float(self.low))


@dataclass(frozen=True, kw_only=True)
class Trapezoidal(Rectangular):
    """A trapezoidal wave: `Rectangular` with linear rise and fall.

    Attributes
    ----------
    low, high : float
        N/m.
    duty : float
        Fraction of the cycle between the middles of rise and fall; the rise starts at phase 0.
    ramp : float
        Length of the rise and of the fall in cycles, at most ``duty`` and ``1 - duty``.

    Raises
    ------
    ValueError
        If a value is out of range.

    Examples
    --------
    >>> from data_synth.dynamics import Trapezoidal
    >>> k = Trapezoidal(low=1.0, high=2.0, duty=0.5, ramp=0.2)
    >>> k([0.1, 0.3, 0.6, 0.9]).round(9).tolist(), k.mean  # middle of the rise, top, middle of the fall, bottom
    ([1.5, 2.0, 1.5, 1.0], 1.5)
    """

    ramp: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.ramp <= min(self.duty, 1 - self.duty):
            raise ValueError(
                f"ramp = {self.ramp!r} must be above 0 and at most {min(self.duty, 1 - self.duty):g}, the smaller of "
                "duty and 1 - duty; without ramps use Rectangular."
            )

    @property
    def jumps(self) -> tuple[float, ...]:
        """No phases: the stiffness is continuous."""
        return ()

    @property
    def corners(self) -> tuple[float, ...]:
        """Phases at which the slope changes."""
        return (0.0, self.ramp, self.duty, self.duty + self.ramp)

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles, any shape."""
        phase = np.remainder(np.asarray(phase_cycles, dtype=np.float64), 1.0)
        knots = [*self.corners, 1.0]
        return np.interp(phase, knots, [self.low, self.high, self.high, self.low, self.low])


@dataclass(frozen=True, kw_only=True)
class Shifted:
    """A stiffness shifted in phase, ``of(phase + by_cycles)``, like the meshes of one planet relative to another.

    Examples
    --------
    >>> from data_synth.dynamics import Rectangular, Shifted
    >>> second_planet = Shifted(of=Rectangular(low=1.0, high=2.0, duty=0.5), by_cycles=0.25)
    >>> second_planet([0.0, 0.3]).tolist(), second_planet.jumps
    ([2.0, 1.0], (0.25, 0.75))
    """

    of: Stiffness
    by_cycles: float

    @property
    def mean(self) -> float:
        """Mean over a period in N/m."""
        return self.of.mean

    @property
    def period(self) -> int:
        """Mesh cycles after which it repeats."""
        return self.of.period

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases in [0, period), increasing, at which it jumps."""
        return tuple(sorted((jump - self.by_cycles) % self.period for jump in self.of.jumps))

    @property
    def corners(self) -> tuple[float, ...]:
        """Phases at which the slope changes."""
        return tuple(sorted((corner - self.by_cycles) % self.period for corner in getattr(self.of, "corners", ())))

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles, any shape."""
        return self.of(np.asarray(phase_cycles, dtype=np.float64) + self.by_cycles)


def fourier_series(stiffness: Stiffness, *, harmonics: int) -> Fourier:
    """Return the first terms of the Fourier series of a stiffness.

    Gauss-Legendre quadrature between discontinuities and corners makes them exact to rounding where the stiffness is
    smooth in between.

    Parameters
    ----------
    stiffness : Stiffness
    harmonics : int
        Number of terms; the fundamental has the period of the stiffness.

    Returns
    -------
    Fourier

    Raises
    ------
    ValueError
        If `harmonics` is below 1.

    Examples
    --------
    Harmonic h of a rectangular wave of duty d has an amplitude of ``2 sin(pi h d) / (pi h)`` times the step:

    >>> import numpy as np
    >>> from data_synth.dynamics import Rectangular, fourier_series
    >>> series = fourier_series(Rectangular(low=1e8, high=2e8, duty=0.5), harmonics=3)
    >>> np.round(np.abs(series.harmonics) / 1e8, 4).tolist()
    [0.6366, 0.0, 0.2122]
    """
    if harmonics < 1:
        raise ValueError(f"harmonics = {harmonics!r} must be at least 1.")
    phases, weights = quadrature(stiffness, harmonics=harmonics)
    values = weights * stiffness(phases) / stiffness.period
    orders = np.arange(1, harmonics + 1)
    lines = np.exp(-2j * np.pi / stiffness.period * np.outer(orders, phases)) @ values
    return Fourier(mean=stiffness.mean, harmonics=2 * lines, period=stiffness.period)


def quadrature(stiffness: Stiffness, *, harmonics: int = 1) -> tuple[Array, Array]:
    """Return Gauss-Legendre phases and weights over a period, (n,) each; no interval spans a jump or a corner."""
    breaks = {0.0, float(stiffness.period), *stiffness.jumps, *getattr(stiffness, "corners", ())}
    ends = np.array(sorted(breaks))
    even = np.linspace(0, stiffness.period, 3 * harmonics + 1)
    ends = np.unique(np.concatenate([ends, even]))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    half, middle = np.diff(ends) / 2, (ends[1:] + ends[:-1]) / 2
    return (middle[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel()


def _not_negative(value: float, name: str) -> None:
    if not (math.isfinite(value) and value >= 0):
        raise ValueError(f"{name} = {value!r} N/m must be a finite number, 0 or more.")
