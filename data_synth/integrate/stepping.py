"""Protocols of an integrator: a method makes a stepper, which integrates over a block of samples."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, Outcome
from data_synth.integrate.readings import Readings


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Why a step size is refused: outcome, and the numbers behind it."""

    outcome: Outcome
    detail: str


class Stepper(Protocol):
    """Integrates from sample to sample, and may keep a state of its own beside x."""

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Return readings (samples, readings) at the samples after number `first`; x is updated in place."""


class Method(Protocol):
    """An integrator and its settings: `Splitting`, `Transition`, or one with the same members."""

    @property
    def order(self) -> int | None:
        """Order of the global error in the step size for smooth motion; None without discretisation error."""

    def refusal(self, assembled: Assembled, step_s: float) -> Refusal | None:
        """Return why a step size is refused; None where it is not."""

    def stepper(self, readings: Readings, per_sample: int) -> Stepper:
        """Return a stepper for a number of steps to each sample."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Times of samples and steps."""

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
        """Return the times (steps + 1,) at which steps begin, and the last ends."""
        steps = first * self.per_sample + np.arange(samples * self.per_sample + 1)
        return np.asarray(self.assembled.problem.start_s + steps * self.step_s)
