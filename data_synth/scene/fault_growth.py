"""Growth of a fault's size with time: laws that a scene declares, and the size that follows."""

from abc import abstractmethod
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from hums.gearbox.components import Declared, Name, Positive

Array = NDArray[np.float64]


class LinearGrowth(Declared):
    """Growth at a constant rate, up to `largest_mm`."""

    law: Literal["linear"]
    rate_mm_per_s: Positive
    largest_mm: Positive

    def relative_size(self, times_s: ArrayLike, *, initial_mm: float) -> Array:
        """Return the size over `initial_mm` at times (n,) in s from the beginning, ``1 + rate t / initial_mm``."""
        grown = 1.0 + self.rate_mm_per_s / initial_mm * np.asarray(times_s, dtype=np.float64)
        return np.clip(grown, 0.0, self.largest_mm / initial_mm)


class ExponentialGrowth(Declared):
    """Growth by the factor e every `time_constant_s`, up to `largest_mm`."""

    law: Literal["exponential"]
    time_constant_s: Positive
    largest_mm: Positive

    def relative_size(self, times_s: ArrayLike, *, initial_mm: float) -> Array:
        """Return the size over `initial_mm` at times (n,) in s from the beginning: ``exp(t / time_constant_s)``."""
        ages = np.asarray(times_s, dtype=np.float64) / self.time_constant_s
        with np.errstate(over="ignore"):
            return np.minimum(np.exp(ages), self.largest_mm / initial_mm)


class ParisGrowth(Declared):
    """Fatigue crack growth by Paris' law, from `rate_mm_per_s` at the beginning, up to `largest_mm`.

    ``da/dN = C (dK)^m`` with ``dK = Y dS sqrt(pi a)`` and m = `exponent`, at a constant number of load cycles a second
    (Paris and Erdogan 1963, J. Basic Eng. 85, 528-533): ``da/dt = rate (a / a0) ** (m / 2)``, where the rate of the
    initial crack is ``f C (Y dS sqrt(pi a0)) ** m`` at f load cycles a second. In closed form ``a0 (1 - (m/2 - 1) rate
    t / a0) ** (-1 / (m/2 - 1))``, for m = 2 an exponential. For m > 2 the closed form diverges after ``a0 / ((m/2 - 1)
    rate)``; the size stays at `largest_mm` once it is there.
    """

    law: Literal["paris"]
    rate_mm_per_s: Positive
    exponent: Positive
    largest_mm: Positive

    def relative_size(self, times_s: ArrayLike, *, initial_mm: float) -> Array:
        """Return the size over `initial_mm` at times (n,) in s from the beginning, a / a0."""
        power = self.exponent / 2 - 1
        ages = np.asarray(times_s, dtype=np.float64) * (self.rate_mm_per_s / initial_mm)
        with np.errstate(over="ignore", divide="ignore"):
            grown = np.exp(ages) if power == 0 else np.maximum(1 - power * ages, 0.0) ** (-1 / power)
        return np.minimum(grown, self.largest_mm / initial_mm)


GrowthLaw = Annotated[LinearGrowth | ExponentialGrowth | ParisGrowth, Field(discriminator="law")]


class GrowingFault(Declared):
    """A fault of a component, which may grow."""

    component: Name
    growth: GrowthLaw | None = None

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
