"""Flags of the outputs of a stream: orders too close, ends and gaps.

Speeds are means over stretches that do not depend on where the stream is cut into blocks: they end at samples 1, 2, 4,
8 and so on, until one is as long as all that follow it.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from signals.harmonics.model import Floats, HarmonicModel, Indices
from signals.harmonics.separability import (
    Marks,
    Seen,
    distances,
    distances_to_images,
    flag_ends_and_gaps,
    half_memory,
    marks,
    unresolved_pairs,
)
from signals.harmonics.tracks import UnresolvedPair

# Stretches in one over the largest bandwidth, at the least.
STRETCHES = 4
# A bandwidth in cycles a sample that no stream is long enough for: below it, numbers of samples would overflow.
NARROWEST = 2.0**-48


@dataclass(kw_only=True, eq=False)
class StreamFlags:
    """What past samples say of the flags of outputs to come.

    Attributes
    ----------
    end : sample at which the last whole stretch ended.
    phase : (shaft,) array, angles in rad at that sample.
    frequency : (order,) array, mean of that stretch in cycles a sample.
    flags : (order,) array, of that stretch.
    turns, together : (order, order) arrays, filled above the diagonal: by how many turns two lines have parted so far,
        and in how many samples they were within half a bandwidth.
    first_seen : the first sample that was there; infinite while none was.
    missing : (missing sample,) array, as far back as outputs to come rest on them.
    """

    end: int
    phase: Floats
    frequency: Floats
    flags: Marks
    turns: Floats
    together: Floats
    first_seen: float
    missing: Indices

    @classmethod
    def begin(cls, model: HarmonicModel, *, shafts: int) -> "StreamFlags":
        """Return the state before the first sample: every shaft seems at rest."""
        orders = model.orders.size
        return cls(
            end=0,
            phase=np.full(shafts, np.nan),
            frequency=np.zeros(orders),
            flags=marks(np.full(orders, orders > 1), model.orders != 0),
            turns=np.zeros((orders, orders)),
            together=np.zeros((orders, orders)),
            first_seen=np.inf,
            missing=np.empty(0, dtype=np.int64),
        )

    @property
    def unresolved(self) -> tuple[UnresolvedPair, ...]:
        """Pairs of orders that were not separable, and for which part of the samples so far; all until a turn apart."""
        return unresolved_pairs(np.triu(np.where(self.turns < 1, 1.0, self.together / max(self.end, 1)), k=1))

    def update(
        self,
        model: HarmonicModel,
        outputs: Indices,
        phase: Floats,
        seen: Seen,
        first: int,
        samples: int,
        lag: int | None,
    ) -> Marks:
        """Return the (order, output) flags of the next outputs.

        Parameters
        ----------
        model : what is estimated.
        outputs : (output,) array, the sample of each.
        phase : (shaft, sample) array, angles in rad from sample `first` on: of those that give the outputs, and of the
            later ones that they rest on.
        seen : (sample,) array, whether these samples are there.
        first : number of the first of them; all before it were passed before.
        samples : how many of them are passed now; where these are all of a lag's, the stream has ended.
        lag : None for a filter.
        """
        found = self._separability(model, outputs, phase, first, first + samples, lag)
        if seen.any():
            self.first_seen = min(self.first_seen, float(first + seen.argmax()))
        reach = half_memory(np.maximum(model.bandwidth, NARROWEST))
        longest = ceil(float(reach.max()))
        start = max(first - longest, 0) if self.missing.size or not seen.all() else first
        window = np.concatenate([np.ones(first - start, dtype=np.bool_), seen])
        window[self.missing - start] = False
        flag_ends_and_gaps(found, outputs - start, reach, window, first=self.first_seen - start, later=lag is not None)
        missing = np.concatenate([self.missing, first + np.flatnonzero(~seen[:samples])])
        self.missing = missing[missing >= first + samples - longest]
        return found

    def _separability(
        self, model: HarmonicModel, outputs: Indices, phase: Floats, first: int, stop: int, lag: int | None
    ) -> Marks:
        """Return the flags of orders too close, and pass the stretches that outputs before `stop` need.

        Of a filter's outputs these are the last that have ended by then; of a smoother's, which know the speed of
        their own, the first that end after them.
        """
        if first == 0:
            self.phase = phase[:, 0].copy()
        last = first + phase.shape[1] - 1
        longest = max(1.0, 1 / (STRETCHES * max(float(model.bandwidth.max()), NARROWEST)))
        longest = 1 << int(np.log2(min(longest, lag or longest)))
        steady = np.arange(longest * max(self.end // longest, 1), last + 1, longest)
        ends = np.append(1 << np.arange(longest.bit_length() - 1), steady)
        if lag is not None and stop > last:  # the stream has ended
            ends = np.union1d(ends, last)
        ends = ends[(ends > self.end) & (ends <= last)]
        if lag is not None:
            ends = ends[: np.searchsorted(ends, stop) + 1]
        place = np.searchsorted(np.append(self.end, ends), outputs, side="right") - (lag is None)
        flags = self.flags[:, None]
        if ends.size:
            flags = np.concatenate([flags, self._pass(model, ends, phase[:, ends - first])], axis=1)
        self.flags = flags[:, -1].copy()
        return flags[:, np.minimum(place, flags.shape[1] - 1)]

    def _pass(self, model: HarmonicModel, ends: Indices, phase: Floats) -> Marks:
        """Take whole stretches in, given the (shaft, stretch) angles at their ends; return their flags."""
        lengths = np.diff(ends, prepend=self.end).astype(np.float64)
        speed = np.diff(phase, prepend=self.phase[:, None]) / (2 * np.pi * lengths)
        frequency = np.concatenate([self.frequency[:, None], model.orders[:, None] * speed[model.shaft]], axis=1)
        close = np.zeros((len(frequency), ends.size), dtype=np.bool_)
        width = model.bandwidth[:, 0]
        for k in range(len(close) - 1):
            rest = slice(k + 1, None)
            distance = distances(frequency[k], frequency[rest], both_sides=False)[:, 1:]
            near = distance < np.maximum(width[k], width[rest])[:, None] / 2
            turns = self.turns[k, rest, None] + np.cumsum(distance * lengths, axis=1)
            self.together[k, rest] += near @ lengths
            self.turns[k, rest] = turns[:, -1]
            alike = near | (turns < 1)
            close[k] |= alike.any(axis=0)
            close[rest] |= alike
        self.end, self.phase, self.frequency = int(ends[-1]), phase[:, -1].copy(), frequency[:, -1].copy()
        return marks(close, distances_to_images(model.orders, frequency[:, 1:]) < model.bandwidth / 2)
