"""What can be told of the outputs of a record that is still coming in: lines too close, ends and gaps.

Speeds are means over stretches, whose lengths the stream's own count sets, so that it does not matter in which blocks
the samples come: stretches end at samples 1, 2, 4, 8 and so on, until one is as long as all that follow it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np

from signals.harmonics._stored import restored, stored
from signals.harmonics.model import Floats, HarmonicModel, Indices
from signals.harmonics.separability import (
    NEAR,
    Marks,
    Seen,
    distances_to_images,
    flag_ends,
    flag_gaps,
    half_memory,
    marks,
)
from signals.harmonics.tracks import UnresolvedPair

# Stretches in one over the largest bandwidth, at the least.
STRETCHES = 4
# A bandwidth in cycles a sample that no stream is long enough for: below it, numbers of samples would overflow.
NARROWEST = 2.0**-48


@dataclass(kw_only=True, eq=False)
class Watch:
    """What a stream remembers to flag its outputs by.

    Attributes
    ----------
    model : what is estimated, without any angles.
    longest : samples in a stretch, but for the first ones: a power of two.
    later : whether samples after an output tell of it, too; then it takes the speed of its own stretch, else that of
        the last whole one.
    end : sample at which the last whole stretch ended.
    phase : (shaft,) array, angles in rad at that sample.
    frequency : (order,) array, in that stretch, in cycles a sample.
    flags : (order,) array, of that stretch.
    turns, together : (order, order) arrays, filled above the diagonal: by how much two lines have parted so far, and
        in how many samples they were within half a bandwidth.
    first_seen : the first sample that was there; -1 while none was.
    missing : samples that were missing, as far back as they tell of outputs to come.
    """

    model: HarmonicModel
    longest: int
    later: bool
    end: int
    phase: Floats
    frequency: Floats
    flags: Marks
    turns: Floats
    together: Floats
    first_seen: int
    missing: Indices

    @classmethod
    def begin(cls, model: HarmonicModel, *, shafts: int, lag: int | None) -> "Watch":
        """Return what is known before the first sample: every shaft seems at rest."""
        orders = model.orders.size
        longest = max(1.0, 1 / (STRETCHES * max(float(model.bandwidth.max()), NARROWEST)))
        frequency = np.zeros(orders)
        return cls(
            model=model,
            longest=1 << int(np.log2(longest if lag is None else min(longest, lag))),
            later=lag is not None,
            end=0,
            phase=np.full(shafts, np.nan),
            frequency=frequency,
            flags=_marks(model, np.full((orders, 1), orders > 1), frequency[:, None])[:, 0],
            turns=np.zeros((orders, orders)),
            together=np.zeros((orders, orders)),
            first_seen=-1,
            missing=np.empty(0, dtype=np.int64),
        )

    @property
    def unresolved(self) -> tuple[UnresolvedPair, ...]:
        """Pairs of orders that were not separable, and for which part of the samples so far; all until a turn apart."""
        shares = np.where(self.turns < 1, 1.0, self.together / max(self.end, 1))
        first, second = np.nonzero(np.triu(shares, k=1))
        return tuple(map(UnresolvedPair, first.tolist(), second.tolist(), shares[first, second].tolist()))

    @cached_property
    def reach(self) -> Floats:
        """(order, 1) array, for each order, the samples on either side that tell of an output."""
        return half_memory(np.maximum(self.model.bandwidth, NARROWEST))

    @cached_property
    def longest_reach(self) -> int:
        """The same in whole samples, of the order that looks farthest."""
        return ceil(float(self.reach.max()))

    def flag(
        self, outputs: Indices, *, phase: Floats, seen: Seen, first: int, samples: int, ended: bool = False
    ) -> Marks:
        """Return the (order, output) flags of the next outputs.

        Parameters
        ----------
        outputs : (output,) array, the sample of each.
        phase : (shaft, sample) array, angles in rad from sample `first` on: of those that give the outputs, and of the
            later ones that tell of them.
        seen : (sample,) array, whether these samples are there.
        first : number of the first of them; all before it were passed before.
        samples : how many of them are passed now.
        ended : whether no more will come.
        """
        found = self._close(outputs, phase, first, first + samples, ended=ended)
        there = np.flatnonzero(seen)
        if self.first_seen < 0 and there.size:
            self.first_seen = first + int(there[0])
        last = first + int(there[-1]) if there.size else -1
        begun = self.first_seen if self.first_seen >= 0 else first + seen.size
        if self.later or first < begun + self.longest_reach:
            flag_ends(found, outputs, self.reach, first=begun, last=last if self.later else None)
        if self.missing.size or there.size < seen.size:
            start = max(first - self.longest_reach, 0)
            window = np.concatenate([np.ones(first - start, dtype=np.bool_), seen])
            window[self.missing - start] = False
            flag_gaps(found, outputs - start, self.reach, window, later=self.later)
            gone = first + np.flatnonzero(~seen[:samples])
            kept = np.concatenate([self.missing, gone])
            self.missing = kept[kept >= first + samples - self.longest_reach]
        return found

    def _close(self, outputs: Indices, phase: Floats, first: int, stop: int, *, ended: bool) -> Marks:
        """Pass the stretches that tell of samples before `stop`; return the flags of outputs for orders too close."""
        if first == 0:
            self.phase = phase[:, 0].copy()
        ends = self._ends(first + phase.shape[1] - 1, stop, ended=ended)
        flags = self.flags[:, None]
        if ends.size:
            flags = np.concatenate([flags, self._pass(ends, phase[:, ends - first])], axis=1)
        # Of a filter's outputs the last stretch that has ended by then, else the first that ends after them.
        place = np.searchsorted(np.append(self.end, ends), outputs, side="right") - (not self.later)
        found = flags[:, np.minimum(place, flags.shape[1] - 1)]
        if ends.size:
            self.end, self.flags = int(ends[-1]), flags[:, -1].copy()
        return found

    def _ends(self, last: int, stop: int, *, ended: bool) -> Indices:
        """Return the samples up to `last` at which stretches end: those that outputs before `stop` need."""
        first_ones = 1 << np.arange(int(self.longest).bit_length() - 1)
        ends = np.append(first_ones, np.arange(self.longest * max(self.end // self.longest, 1), last + 1, self.longest))
        ends = ends[(ends > self.end) & (ends <= last)]
        if self.later:
            ends = ends[: np.searchsorted(ends, stop) + 1]
        return np.append(ends, last) if ended and (ends[-1] if ends.size else self.end) < last else ends

    def _pass(self, ends: Indices, phase: Floats) -> Marks:
        """Take whole stretches in, given the angles at their ends; return their (order, stretch) flags."""
        lengths = np.diff(ends, prepend=self.end).astype(np.float64)
        speed = np.diff(phase, prepend=self.phase[:, None]) / (2 * np.pi * lengths)
        frequency = np.concatenate([self.frequency[:, None], self.model.orders[:, None] * speed[self.model.shaft]], 1)
        close = np.zeros((frequency.shape[0], lengths.size), dtype=np.bool_)
        width = self.model.bandwidth[:, 0]
        for k in range(len(close) - 1):
            near, rest = np.maximum(width[k], width[k + 1 :])[:, None] / 2, slice(k + 1, None)
            distance = _new_distances(frequency[k], frequency[rest])
            turns = self.turns[k, rest, None] + np.cumsum(distance * lengths, axis=1)
            self.together[k, rest] += (distance < near) @ lengths
            self.turns[k, rest] = turns[:, -1]
            alike = (distance < near) | (turns < 1)
            close[k] |= alike.any(axis=0)
            close[rest] |= alike
        self.phase, self.frequency = phase[:, -1].copy(), frequency[:, -1].copy()
        return _marks(self.model, close, frequency[:, 1:])

    def stored(self) -> dict[str, Any]:
        """Return all that changes, under plain names."""
        return stored("watch", self, _KEPT)

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `stored` returned."""
        for name, value in restored("watch", self, _KEPT, state, free={"missing": (None,)}).items():
            setattr(self, name, value)


def _new_distances(one: Floats, others: Floats) -> Floats:
    """(order, stretch) distances of lines in each stretch after the first, 0 where they crossed since the one before.

    Parameters
    ----------
    one, others : (1 + stretch,) and (order, 1 + stretch) arrays in cycles a sample.
    """
    nearest = np.full((len(others), one.size - 1), 0.5)
    for apart in (others - one, others + one):
        folded = apart - np.rint(apart)
        before, now = folded[:, :-1], folded[:, 1:]
        crossed = (before * now < 0) & (np.maximum(np.abs(before), np.abs(now)) < NEAR)
        np.minimum(nearest, np.where(crossed, 0.0, np.abs(now)), out=nearest)
    return nearest


_KEPT = ("end", "phase", "frequency", "flags", "turns", "together", "first_seen", "missing")


def _marks(model: HarmonicModel, close: Seen, frequency: Floats) -> Marks:
    """(order, stretch) flags of lines at these frequencies, `close` to others or not."""
    return marks(close, distances_to_images(model.orders, frequency) < model.bandwidth / 2)
