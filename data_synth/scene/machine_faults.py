"""Shaft and bearing faults as declared in a scene: kind, component, size and growth."""

from abc import abstractmethod
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from data_synth.scene.operation import NotNegative, Share, Turns
from hums.gearbox.components import Declared, Name, Positive

Array = NDArray[np.float64]


class Growth(Declared):
    """Growth of a fault at ``da/dt = rate_mm_per_s (a / a0) ** (exponent / 2)``, up to `largest_mm`; a0 is its size.

    Growth is linear with exponent 0, and exponential with 2, by the factor e every ``a0 / rate_mm_per_s`` seconds. With
    the exponent of its material a crack obeys Paris' law, ``da/dN = C (dK)^m`` with ``dK = Y dS sqrt(pi a)``, at a
    constant frequency f of load cycles (Paris and Erdogan 1963, J. Basic Eng. 85, 528-533): the initial crack grows at
    the rate ``f C (Y dS sqrt(pi a0)) ** m``. In closed form the size is ``a0 (1 - (m/2 - 1) rate t / a0) ** (-1 / (m/2
    - 1))``, which for m > 2 diverges after ``a0 / ((m/2 - 1) rate)``. Growth ends at `largest_mm`.
    """

    rate_mm_per_s: Positive
    exponent: NotNegative = 0.0
    largest_mm: Positive

    def relative_size(self, times_s: ArrayLike, *, initial_mm: float) -> Array:
        """Return the relative size a / a0 at times (n,) in s from the start, a0 being `initial_mm`."""
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
                f"growth: largest_mm = {self.growth.largest_mm:g} is less than the initial size, "
                f"{self.initial_mm:g} mm; give at least that"
            )
        return self

    def relative_size(self, times_s: ArrayLike) -> Array:
        """Return the ratio of the size at times (n,) in s to the initial size."""
        if self.growth is None:
            return np.ones(np.shape(times_s))
        return self.growth.relative_size(times_s, initial_mm=self.initial_mm)


class SizedFault(GrowingFault):
    """A fault whose initial size is `size_mm`, and which may grow."""

    size_mm: Positive

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record, mm."""
        return self.size_mm


class ShaftFault(SizedFault):
    """A shaft fault: harmonics of amplitude `size_mm` times `amplitude_per_mm` (an illustrative factor) at top speed.

    `imbalance` (size: the eccentricity) excites the first harmonic in proportion to the square of speed; `bent_shaft`
    mainly the first and `shaft_misalignment` mainly the second, independent of speed. The heavy or bent side is at
    `offset_rev` when the angle of the reference is zero; by default that is drawn. An imbalance with `rotor_kg` is the
    force m e w^2 of that mass, which acts like that of `imperfections.imbalance`, and has no `amplitude_per_mm`, whose
    default is otherwise 1.
    """

    kind: Literal["imbalance", "bent_shaft", "shaft_misalignment"]
    amplitude_per_mm: NotNegative | None = None
    rotor_kg: Positive | None = None
    offset_rev: Turns | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.rotor_kg is not None and self.kind != "imbalance":
            raise ValueError(f"rotor_kg applies to imbalance, not to {self.kind}; leave it out")
        if self.rotor_kg is not None and self.amplitude_per_mm is not None:
            raise ValueError("rotor_kg and amplitude_per_mm both determine the imbalance; keep one")
        return self


class BearingFault(SizedFault):
    """A localised defect of a rolling bearing, with slip.

    Intervals between impacts are independent with the relative standard deviation `slip_std`, so that their errors
    accumulate (Antoni and Randall 2003, J. Vib. Acoust. 125); `mean_slip` lowers the mean rate below that of pure
    rolling. If the defect moves through the load zone, impacts follow Stribeck's load distribution with the factor
    `load_distribution` (0.5: half the ring is loaded) and `load_exponent` (3/2 for balls, 10/9 for rollers). The zone
    is stationary, as under weight and tooth forces, or rotates with the link `load_turns_with`, as under an imbalance.
    The impact amplitude at full load is `size_mm` times `impact_per_mm`, an illustrative factor.

    A defect of the outer ring, or of an inner ring at rest in the load zone, as on the pin of a planet, is at
    `place_deg` from the middle of the zone. Impacts of a rolling element on the inner race are `inner_share` times
    those on the outer race. An element entering a spall of a race causes an impact `entry_share` times that at its far
    end. An impact is an impulse, or a constant force for `pulse_share` of the time to pass the spall, which excites
    high modes less.
    """

    kind: Literal["inner_race", "outer_race", "rolling_element", "cage"]
    slip_std: Annotated[float, Field(ge=0, le=0.1)] = 0.01
    mean_slip: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    load_distribution: Annotated[float, Field(gt=0, le=1)] = 0.5
    load_exponent: Annotated[float, Field(ge=1, le=2)] = 1.5
    load_turns_with: Name | None = None
    place_deg: Annotated[float, Field(ge=-180, le=360)] = 0.0
    inner_share: NotNegative = 1.0
    entry_share: Annotated[float, Field(ge=-1, le=1)] = 0.0
    pulse_share: Share = 0.0
    impact_per_mm: NotNegative = 1.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key, kinds in _ONLY.items():
            if getattr(self, key) != type(self).model_fields[key].default and self.kind not in kinds:
                which = " and ".join([", ".join(kinds[:-1]), kinds[-1]] if kinds[1:] else kinds)
                raise ValueError(f"{key} applies to {which}, not to {self.kind}; leave it out")
        return self


_OF_ROLLING = ("inner_race", "outer_race", "rolling_element")
_ONLY = {
    "load_distribution": _OF_ROLLING,
    "load_exponent": _OF_ROLLING,
    "load_turns_with": _OF_ROLLING,
    "place_deg": ("inner_race", "outer_race"),
    "inner_share": ("rolling_element",),
    "entry_share": ("inner_race", "outer_race"),
    "pulse_share": _OF_ROLLING,
}
"""The kinds of bearing fault to which a key applies."""
