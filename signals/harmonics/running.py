"""A causal filter, or a smoother with a lag, on its way through a stream of samples."""

from collections.abc import Mapping
from dataclasses import replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from signals.harmonics._chain import Chain, State, look_back, smooth_back, survey
from signals.harmonics._stored import array, restored, stored
from signals.harmonics._tally import Tally
from signals.harmonics.exact import chain_of, filter_on, parts, start
from signals.harmonics.model import Complexes, Floats, HarmonicModel, Indices, lost
from signals.harmonics.separability import Marks
from signals.harmonics.watch import Watch

_STATE = ("vector", "matrix", "status")
_TALLY = ("square", "products", "pairs", "recent", "recent_seen", "log_variance", "count")


class Outputs(NamedTuple):
    """What some outputs are: (channel, order, output) amplitudes, (order, output) variances and flags."""

    amplitude: Complexes
    variance: Floats
    flags: Marks

    @classmethod
    def joined(cls, parts: list["Outputs"], *, channels: int, orders: int) -> "Outputs":
        """Return all of them, none at the least."""
        if len(parts) == 1:
            return parts[0]
        none = cls(
            np.empty((channels, orders, 0), dtype=np.complex128),
            np.empty((orders, 0)),
            np.empty((orders, 0), dtype=np.uint8),
        )
        return cls(*(np.concatenate(values, axis=-1) for values in zip(none, *parts, strict=True)))


class Running:
    """What is known half way through a stream.

    Attributes
    ----------
    model : what is estimated, without any angles.
    lag : samples that each output waits for at least; None for a filter.
    every : samples from one output to the next.
    state : the prediction for the next sample.
    tally : of the innovations so far.
    watch : what the flags are made of.
    done : samples whose outputs, if any, were given.
    x, phase : (channel, sample) and (shaft, sample) arrays, the samples that wait for later ones, and their angles.
    """

    def __init__(self, model: HarmonicModel, *, channels: int, shafts: int, lag: int | None, every: int) -> None:
        self.model, self.lag, self.every = model, lag, every
        self.state = start(model, channels=channels)
        self.tally = Tally.empty(channels=channels)
        self.watch = Watch.begin(model, shafts=shafts, lag=lag)
        self.done = 0
        self.x = np.empty((channels, 0))
        self.phase = np.empty((shafts, 0))

    def take(self, x: Floats, phase: Floats) -> list[Outputs]:
        """Take the next (channel, sample) data and (shaft, sample) angles in; return the outputs that are due."""
        if self.lag is None:
            return [self._filter(x, phase)]
        found = []
        for begin in range(0, x.shape[1], self.lag):
            # No more than a segment at a time, so that what waits stays below three.
            span = slice(begin, begin + self.lag)
            self.x = np.concatenate([self.x, x[:, span]], axis=1)
            self.phase = np.concatenate([self.phase, phase[:, span]], axis=1)
            if self.x.shape[1] >= 2 * self.lag:
                found.append(self._smooth(self.lag, known=2 * self.lag))
        return found

    def finish(self) -> list[Outputs]:
        """Return the outputs of the samples that wait."""
        waiting = self.x.shape[1]
        return [self._smooth(waiting, known=waiting)] if waiting else []

    def _filter(self, x: Floats, phase: Floats) -> Outputs:
        first, samples = self.done, x.shape[1]
        amplitude, variance = filter_on(
            replace(self.model, phases=tuple(phase)), x, self.state, self.tally,
            first=first, output_every=self.every, startup=self._startup,
        )  # fmt: skip
        self._check_digits()
        self.done += samples
        seen = ~np.isnan(x[0])
        flags = self.watch.flag(self._since(first), phase=phase, seen=seen, first=first, samples=samples)
        return Outputs(amplitude, variance, flags)

    def _smooth(self, samples: int, *, known: int) -> Outputs:
        """Smooth the first of the waiting samples, by those known of them, and let them go."""
        first, chain = self.done, self._waiting(slice(0, samples))
        starts = survey(chain, self.state, self.tally, self._startup - first)
        later = look_back(self._waiting(slice(samples, known)), self.state)
        amplitude, variance = parts(self.model, *smooth_back(chain, starts, later))
        if not variance.min(initial=np.inf) > 0:
            raise lost(self.model, "exact")
        self._check_digits()
        self.done += samples
        flags = self.watch.flag(
            self._since(first), phase=self.phase[:, :known], seen=~np.isnan(self.x[0, :known]), first=first,
            samples=samples, ended=known == samples,
        )  # fmt: skip
        self.x, self.phase = self.x[:, samples:].copy(), self.phase[:, samples:].copy()
        return Outputs(amplitude, variance, flags)

    def _check_digits(self) -> None:
        """Look at the covariance, too, where no output does."""
        if not np.diagonal(self.state.matrix[0]).min() >= 0:
            raise lost(self.model, "exact")

    def _waiting(self, span: slice) -> Chain:
        """Return some of the waiting samples as a chain."""
        x, phase = self.x[:, span], self.phase[:, span]
        wanted = np.zeros(x.shape[1], dtype=np.bool_)
        wanted[-(self.done + span.start) % self.every :: self.every] = True
        return chain_of(replace(self.model, phases=tuple(phase)), x, wanted)

    def _since(self, first: int) -> Indices:
        """Return the samples that give an output, from `first` up to those done."""
        return np.arange(first + -first % self.every, self.done, self.every)

    @property
    def _startup(self) -> int:
        return ceil(1 / float(self.model.bandwidth.min())) + self.model.state_size

    def stored(self) -> dict[str, Any]:
        """Return all that changes, under plain names."""
        own = {"done": self.done, "x": self.x.copy(), "phase": self.phase.copy()}
        return own | stored("state", self.state, _STATE) | stored("tally", self.tally, _TALLY) | self.watch.stored()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `stored` returned, of as many channels and shafts."""
        self.done = int(array(state, "done", ()))
        self.x = array(state, "x", (len(self.x), None)).astype(np.float64)
        self.phase = array(state, "phase", (len(self.phase), self.x.shape[1])).astype(np.float64)
        self.state = State(**restored("state", self.state, _STATE, state))
        for name, value in restored("tally", self.tally, _TALLY, state).items():
            setattr(self.tally, name, value)
        self.watch.restore(state)
