"""A causal filter, or a smoother with a lag, on its way through a stream of samples."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from signals.harmonics._information_smoother import Information, carry, smooth_chain
from signals.harmonics._stored import array, restored, stored
from signals.harmonics.blocks import exact_length
from signals.harmonics.grid import Grid, at_outputs
from signals.harmonics.innovations import Innovations
from signals.harmonics.kalman_filter import FilterState, filter_on
from signals.harmonics.model import Complexes, Floats, HarmonicModel, lost
from signals.harmonics.separability import Marks
from signals.harmonics.smoothing import chain_together
from signals.harmonics.watch import Watch

_STATE = ("mean", "covariance", "factor", "diffuse", "count")
_SUMS = ("square", "products", "pairs", "recent", "recent_seen", "log_variance", "count")


class Outputs(NamedTuple):
    """(channel, order, output) amplitudes, (order, output) variances and flags of some outputs."""

    amplitude: Complexes
    variance: Floats
    flags: Marks

    @classmethod
    def joined(cls, parts: list["Outputs"], *, channels: int, orders: int) -> "Outputs":
        """Return all of them, none at the least."""
        if len(parts) == 1:
            return parts[0]
        none = np.empty((orders, 0))
        nothing = cls(np.empty((channels, orders, 0), dtype=np.complex128), none, none.astype(np.uint8))
        amplitude, variance, flags = zip(*[nothing, *parts], strict=True)
        return cls(*(np.concatenate(arrays, axis=-1) for arrays in (amplitude, variance, flags)))


@dataclass
class Running:
    """Where an estimator stands in a stream.

    Attributes
    ----------
    model : what is estimated, without any angles.
    every : samples between outputs.
    watch : flags of outputs.
    state : of the covariance filter, at the first sample whose outputs have not been given.
    innovations : statistics of those before it.
    lag : segment of samples that are smoothed together, a whole number of blocks; None for the filter.
    length : samples in a block of the smoother.
    known : information of the samples before on the amplitudes there, for the smoother.
    x, phase : (channel, sample) and (shaft, sample) arrays of the samples that wait.
    """

    model: HarmonicModel
    every: int
    watch: Watch
    state: FilterState
    innovations: Innovations
    lag: int | None
    length: int
    known: Information
    x: Floats
    phase: Floats

    @classmethod
    def begin(cls, model: HarmonicModel, *, channels: int, shafts: int, lag: int | None, every: int) -> "Running":
        """Return where an estimator stands before the first sample."""
        length = 1 if lag is None else _dividing(lag, exact_length(model))
        return cls(
            model=model,
            every=every,
            watch=Watch.begin(model, shafts=shafts, lag=lag),
            state=FilterState.prior(model, channels=channels),
            innovations=Innovations.none(channels=channels),
            lag=None if lag is None else length * ceil(lag / length),
            length=length,
            known=Information.prior(model.prior_variance(step=length), channels),
            x=np.empty((channels, 0)),
            phase=np.empty((shafts, 0)),
        )

    @property
    def done(self) -> int:
        """Samples whose outputs have been given."""
        return self.state.count

    def take(self, x: Floats, phase: Floats) -> list[Outputs]:
        """Take (channel, sample) and (shaft, sample) arrays in; return the outputs that are due."""
        if self.lag is None:
            return [self._filter(x, phase, ahead=phase, seen=~np.isnan(x[0]))]
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

    def _filter(self, x: Floats, phase: Floats, *, ahead: Floats, seen: Any, ended: bool = False) -> Outputs:  # noqa: ANN401
        """Filter samples, and flag their outputs given the angles, and what is seen, of later ones too."""
        first, samples = self.done, x.shape[1]
        outputs = np.arange(first + -first % self.every, first + samples, self.every)
        levels = np.empty((outputs.size, len(x), 2 * self.model.orders.size))
        variances = np.empty((outputs.size, self.model.orders.size))
        startup = ceil(1 / float(self.model.bandwidth.min())) + self.model.state_size
        filter_on(
            replace(self.model, phases=tuple(phase)), x, self.state, self.innovations, levels, variances,
            output_every=self.every, startup=startup,
        )  # fmt: skip
        flags = self.watch.flag(outputs, phase=ahead, seen=seen, first=first, samples=samples, ended=ended)
        return Outputs(levels.view(np.complex128).transpose(1, 2, 0), variances.T, flags)

    def _smooth(self, samples: int, *, known: int) -> Outputs:
        """Smooth the first of the waiting samples, by those known of them, and let them go."""
        first, group = self.done, np.arange(self.model.orders.size)
        grid = self._grid(known)
        chain = chain_together(grid, group, slice(0, grid.nodes), None, self._both())
        try:
            smoothed = smooth_chain(chain, first=0)
        except np.linalg.LinAlgError as error:
            raise lost(self.model, "exact") from error
        levels = np.stack([self.model.amplitude(own) for own in np.moveaxis(smoothed.levels, 2, 0)])
        amplitude = at_outputs(levels, grid, every=self.every, skip=-first % self.every, samples=samples)
        nodes, outputs = self.length * np.arange(grid.nodes), np.arange(-first % self.every, samples, self.every)
        deviations = np.sqrt(self.model.variance(smoothed.variances))
        variance = np.stack([np.interp(outputs, nodes, own) ** 2 for own in deviations])
        if samples < known:
            head = self._grid(samples)
            self.known = carry(chain_together(head, group, slice(0, head.nodes), None, self._both()))
        filtered = self._filter(
            self.x[:, :samples], self.phase[:, :samples], ahead=self.phase[:, :known],
            seen=~np.isnan(self.x[0, :known]), ended=known == samples,
        )  # fmt: skip
        self.x, self.phase = self.x[:, samples:].copy(), self.phase[:, samples:].copy()
        return Outputs(amplitude, variance, filtered.flags)

    def _grid(self, samples: int) -> Grid:
        """Return the first of the waiting samples as a grid."""
        model, x = replace(self.model, phases=tuple(self.phase[:, :samples])), self.x[:, :samples]
        shared = np.ones(model.orders.size, dtype=np.int64)
        return Grid(model=model, x=x, seen=~np.isnan(x[0]), length=self.length, tolerance=0.0, shared=shared)

    def _both(self) -> tuple[Information, Information]:
        return self.known.copy(), self.known.none()

    def stored(self) -> dict[str, Any]:
        """Return all that changes, under plain names."""
        own = {"x": self.x.copy(), "phase": self.phase.copy()} | stored("known", self.known, ("matrix", "vector"))
        return own | stored("state", self.state, _STATE) | stored("sums", self.innovations, _SUMS) | self.watch.stored()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `stored` returned, of as many channels and shafts."""
        self.x = array(state, "x", (len(self.x), None)).astype(np.float64)
        self.phase = array(state, "phase", (len(self.phase), self.x.shape[1])).astype(np.float64)
        self.known = Information(**restored("known", self.known, ("matrix", "vector"), state))
        for prefix, holder, names in (("state", self.state, _STATE), ("sums", self.innovations, _SUMS)):
            for name, value in restored(prefix, holder, names, state).items():
                setattr(holder, name, value)
        self.watch.restore(state)


def _dividing(lag: int, most: int) -> int:
    """Return samples in a block, `most` at the most, so that whole ones make up the lag, if not too short for it."""
    longest = min(most, lag)
    return next((length for length in range(longest, longest // 2, -1) if lag % length == 0), longest)
