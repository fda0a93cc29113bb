"""What every integrator is: a method that prepares a stepper, and a stepper that goes through a block of samples."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, Outcome
from data_synth.integrate.readings import Readings


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Why steps are not taken."""

    outcome: Outcome
    detail: str


class Stepper(Protocol):
    """Goes from sample to sample."""

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Return readings (samples, readings) after each further sample, `first` ones on; x is changed in place."""


class Method(Protocol):
    """An integrator and its settings."""

    @property
    def order(self) -> int | None:
        """Of its global error in the step, where motion and forces are smooth; None where steps add no error."""

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Return why this step is not taken; None where it is."""

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Prepare for steps of this size."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Where samples and steps lie in time, and what acts there."""

    assembled: Assembled
    rate_hz: float
    per_sample: int

    @property
    def step_s(self) -> float:
        """Length of a step."""
        return 1.0 / (self.rate_hz * self.per_sample)

    def at(self, sample: int) -> float:
        """Return the time of a sample."""
        return self.assembled.problem.start_s + sample * self.per_sample * self.step_s

    def edges(self, first: int, samples: int) -> Array:
        """Return times (steps + 1,) at which steps begin, and the last ends."""
        steps = first * self.per_sample + np.arange(samples * self.per_sample + 1)
        return np.asarray(self.assembled.problem.start_s + steps * self.step_s)
