"""Flags of the outputs of a stream: orders too close, ends and gaps.

Speeds are means over stretches that do not depend on where the stream is cut into blocks: they end at samples 1, 2, 4,
8 and so on, until one is as long as all that follow it.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np

from signals.harmonics.model import Floats, HarmonicModel, Indices
from signals.harmonics.separability import Marks, Seen, distances, flag_gaps, half_memory, marks, unresolved_pairs
from signals.harmonics.tracks import UnresolvedPair

# Stretches in one over the largest bandwidth, at the least.
STRETCHES = 4
# A bandwidth in cycles a sample that no stream is long enough for: below it, numbers of samples would overflow.
NARROWEST = 2.0**-48


@dataclass(kw_only=True, eq=False)
class StreamFlags:
    """What past samples say of the flags of outputs to come."""

    end: int  # sample at which the last whole stretch ended
    phase: Floats  # (shaft,) angles in rad at that sample
    frequency: Floats  # (order,) means of that stretch in cycles a sample
    flags: Marks  # (order,) of that stretch
    # (order, order) arrays, filled above the diagonal: by how many turns two lines have parted so far, and in how many
    # samples they were within half a bandwidth.
    turns: Floats
    together: Floats
    first_seen: float  # the first sample that was there; infinite while none was
    missing: Indices  # missing samples, as far back as outputs to come rest on them

    @classmethod
    def begin(cls, model: HarmonicModel, *, shafts: int) -> "StreamFlags":
        """Return the state before the first sample: every shaft seems at rest."""
        orders = model.orders.size
        rest = np.zeros((orders, 1))
        return cls(
            end=0,
            phase=np.full(shafts, np.nan),
            frequency=rest[:, 0],
            flags=marks(np.full((orders, 1), orders > 1), model.orders, rest, model.bandwidth)[:, 0],
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
        self, model: HarmonicModel, outputs: Indices, phase: Floats, seen: Seen, first: int, count: int, lag: int | None
    ) -> Marks:
        """Take samples in and return the (order, output) flags of their outputs.

        Parameters
        ----------
        outputs : (output,) array, the sample of each.
        phase, seen : (shaft, sample) angles in rad and (sample,) array, whether the sample is there: of those taken in,
            from `first` on, and of the later ones that outputs rest on.
        count : how many are taken in; with a lag, all where the stream has ended.
        lag : None for a filter.
        """
        if first == 0:
            self.phase = phase[:, 0].copy()
        stop, last = first + count, first + seen.size - 1
        length = max(1.0, 1 / (STRETCHES * max(float(model.bandwidth.max()), NARROWEST)))
        length = 1 << int(np.log2(min(length, lag or length)))
        steady = np.arange(length * max(self.end // length, 1), last + 1, length)
        ends = np.append(1 << np.arange(length.bit_length() - 1), steady)
        ends = ends[(ends > self.end) & (ends <= last)]
        if lag is not None:
            ends = np.union1d(ends, last) if stop > last > self.end else ends
            ends = ends[: np.searchsorted(ends, stop) + 1]
        # Of a filter's outputs the last stretch that has ended by then, else the first that ends after them.
        place = np.searchsorted(np.append(self.end, ends), outputs, side="right") - (lag is None)
        flags = self.flags[:, None]
        if ends.size:
            flags = np.concatenate([flags, self._pass(model, ends, phase[:, ends - first])], axis=1)
        self.flags, found = flags[:, -1].copy(), flags[:, np.minimum(place, flags.shape[1] - 1)]
        if seen.any():
            self.first_seen = min(self.first_seen, float(first + seen.argmax()))
        reach = half_memory(np.maximum(model.bandwidth, NARROWEST))
        farthest = ceil(float(reach.max()))
        start = max(first - farthest, 0) if self.missing.size or not seen.all() else first
        if lag is not None or start < first or first < self.first_seen + farthest:
            window = np.concatenate([np.ones(first - start, dtype=np.bool_), seen])
            window[self.missing - start] = False
            flag_gaps(found, outputs - start, reach, window, first=self.first_seen - start, later=lag is not None)
        missing = np.concatenate([self.missing, first + np.flatnonzero(~seen[:count])])
        self.missing = missing[missing >= stop - farthest]
        return found

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
        return marks(close, model.orders, frequency[:, 1:], model.bandwidth)
