"""How the size of a fault grows with time; sizes in any unit, the same in and out."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from data_synth.profile import Array


class Growth(Protocol):
    """The size of a fault against time."""

    def size(self, times_s: ArrayLike) -> Array:
        """Return the size at `times_s` (n,), which count from the record's beginning."""


@dataclass(frozen=True, kw_only=True)
class ConstantSize:
    """A fault that stays as it is."""

    initial: float

    def __post_init__(self) -> None:
        _not_negative(initial=self.initial)

    def size(self, times_s: ArrayLike) -> Array:
        """Return the size at `times_s` (n,)."""
        return np.full(np.shape(times_s), self.initial)


@dataclass(frozen=True, kw_only=True)
class LinearGrowth:
    """``initial + rate_per_s t``, between nothing and `largest`."""

    initial: float
    rate_per_s: float
    largest: float = math.inf

    def __post_init__(self) -> None:
        _not_negative(initial=self.initial, largest=self.largest)

    def size(self, times_s: ArrayLike) -> Array:
        """Return the size at `times_s` (n,)."""
        grown = self.initial + self.rate_per_s * np.asarray(times_s, dtype=np.float64)
        return np.clip(grown, 0.0, self.largest)


@dataclass(frozen=True, kw_only=True)
class ExponentialGrowth:
    """``initial exp(t / time_constant_s)``, up to `largest`."""

    initial: float
    time_constant_s: float
    largest: float

    def __post_init__(self) -> None:
        _not_negative(initial=self.initial, largest=self.largest)
        if self.time_constant_s == 0:
            raise ValueError("time_constant_s = 0: growth takes time; give a time above zero, or below for decay")

    def size(self, times_s: ArrayLike) -> Array:
        """Return the size at `times_s` (n,)."""
        ages = np.asarray(times_s, dtype=np.float64) / self.time_constant_s
        with np.errstate(over="ignore"):
            return np.minimum(self.initial * np.exp(ages), self.largest)


@dataclass(frozen=True, kw_only=True)
class ParisGrowth:
    """A fatigue crack: ``da/dt = rate_per_s (a / initial) ** (exponent / 2)``, up to `largest`.

    Paris' law ``da/dN = C (dK)^m`` with ``dK = Y dS sqrt(pi a)`` at a steady number of load cycles a second (Paris and
    Erdogan 1963, J. Basic Eng. 85, 528-533); m = `exponent`. `paris_rate` gives the rate of the initial crack. In
    closed form ``a0 (1 - (m/2 - 1) rate t / a0) ** (-1 / (m/2 - 1))``, for m = 2 an exponential. For m > 2 the crack
    runs away after ``a0 / ((m/2 - 1) rate)``; from where it reaches `largest` it stays there.
    """

    initial: float
    rate_per_s: float
    exponent: float
    largest: float

    def __post_init__(self) -> None:
        _not_negative(rate_per_s=self.rate_per_s, largest=self.largest)
        if not self.initial > 0:
            raise ValueError(f"initial = {self.initial:g}: a crack grows from a crack; give a size above zero")

    def size(self, times_s: ArrayLike) -> Array:
        """Return the size at `times_s` (n,)."""
        power = self.exponent / 2 - 1
        ages = np.asarray(times_s, dtype=np.float64) * (self.rate_per_s / self.initial)
        with np.errstate(over="ignore", divide="ignore"):
            grown = np.exp(ages) if power == 0 else np.maximum(1 - power * ages, 0.0) ** (-1 / power)
        return np.minimum(self.initial * grown, self.largest)


def paris_rate(
    *, size_m: float, coefficient: float, exponent: float, stress_range_pa: float, geometry: float, cycles_hz: float
) -> float:
    """Return how fast a crack of `size_m` grows, m s-1: ``f C (Y dS sqrt(pi a)) ** m``.

    Parameters
    ----------
    size_m : float
        a.
    coefficient : float
        C, in m per cycle and (Pa sqrt(m)) ** m.
    exponent : float
        m.
    stress_range_pa : float
        dS, of one load cycle.
    geometry : float
        Y.
    cycles_hz : float
        f: for a tooth, its contacts a second.
    """
    intensity = geometry * stress_range_pa * math.sqrt(math.pi * size_m)
    return cycles_hz * coefficient * math.pow(intensity, exponent)


def _not_negative(**sizes: float) -> None:
    for name, value in sizes.items():
        if not value >= 0:
            raise ValueError(f"{name} = {value:g}: a size or rate of growth of 0 or more is needed")
