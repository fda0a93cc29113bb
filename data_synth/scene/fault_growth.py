"""Growth of a fault's size with time, as a scene declares it, and the size that follows."""

from abc import abstractmethod
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from data_synth.scene.operation import NotNegative
from hums.gearbox.components import Declared, Name, Positive

Array = NDArray[np.float64]


class Growth(Declared):
    """Growth of a fault at ``da/dt = rate_mm_per_s (a / a0) ** (exponent / 2)``, up to `largest_mm`; a0 is its size.

    With the exponent 0 growth is linear, with 2 exponential, by the factor e every ``a0 / rate_mm_per_s`` seconds; with
    that of its material a crack obeys Paris' law, ``da/dN = C (dK)^m`` with ``dK = Y dS sqrt(pi a)``, at a constant
    number of load cycles a second (Paris and Erdogan 1963, J. Basic Eng. 85, 528-533): the rate of the initial crack is
    ``f C (Y dS sqrt(pi a0)) ** m`` at f load cycles a second. In closed form ``a0 (1 - (m/2 - 1) rate t / a0) ** (-1 /
    (m/2 - 1))``, which for m > 2 diverges after ``a0 / ((m/2 - 1) rate)``; the size stays at `largest_mm` once it is
    there.
    """

    rate_mm_per_s: Positive
    exponent: NotNegative = 0.0
    largest_mm: Positive

    def relative_size(self, times_s: ArrayLike, *, initial_mm: float) -> Array:
        """Return the size over `initial_mm` at times (n,) in s from the beginning, a / a0."""
        power = self.exponent / 2 - 1
        ages = np.asarray(times_s, dtype=np.float64) * (self.rate_mm_per_s / initial_mm)
        with np.errstate(over="ignore", divide="ignore"):
            grown = np.exp(ages) if power == 0 else np.maximum(1 - power * ages, 0.0) ** (-1 / power)
        return np.minimum(grown, self.largest_mm / initial_mm)


class GrowingFault(Declared):
    """A fault of a component, which may grow."""

    component: Name
    growth: Growth | None = None

    @property
    @abstractmethod
    def initial_mm(self) -> float:
        """Size at the beginning of the record, mm."""

    @model_validator(mode="after")
    def _check_largest(self) -> Self:
        if self.growth is not None and self.growth.largest_mm < self.initial_mm:
            raise ValueError(
                f"growth: largest_mm = {self.growth.largest_mm:g} is less than the size at the beginning, "
                f"{self.initial_mm:g} mm; give at least that"
            )
        return self

    def relative_size(self, times_s: ArrayLike) -> Array:
        """Return the size at times (n,) in s over the initial size."""
        if self.growth is None:
            return np.ones(np.shape(times_s))
        return self.growth.relative_size(times_s, initial_mm=self.initial_mm)
