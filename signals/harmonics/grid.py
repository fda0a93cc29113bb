"""A record in blocks: what samples say at the knots between them, and amplitudes at the knots back at the samples.

With one pole a knot stands for the samples under a hat, which falls from 1 at the knot to 0 at its neighbours: their
first two moments. With more, amplitudes are polynomials from knot to knot, and a knot stands for the block before it:
as many moments as there are poles, and of what is squared one less than twice as many.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import comb, pi, sin

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _block_kernels
from signals.harmonics._phasors import kinks
from signals.harmonics.bandwidth import HALF_POWER
from signals.harmonics.model import Floats, HarmonicModel, Indices

SAMPLES_AT_ONCE = 1 << 16
# Angle by which a jump of the speed may lead the highest order astray within a block.
LARGEST_KINK_RAD = 0.03


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """A record in blocks: knots at the first sample of each, and one after the last.

    Attributes
    ----------
    model : what is estimated.
    x : (channel, sample) array, NaN where missing.
    seen : (sample,) array, whether the sample is there.
    length : samples in a block.
    tolerance : part of an amplitude that a neighbour may disturb without being coupled.
    shared : (order,) array, how many amplitudes each is the sum of: as many walks added up.
    """

    model: HarmonicModel
    x: Floats
    seen: NDArray[np.bool_]
    length: int
    tolerance: float
    shared: Indices

    @property
    def samples(self) -> int:
        """Of the record."""
        return int(self.x.shape[1])

    @property
    def blocks(self) -> int:
        """How many, the last one partly filled."""
        return -(-self.samples // self.length)

    @property
    def knots(self) -> int:
        """How many: one more than blocks."""
        return self.blocks + 1

    def reach(self, memories: float) -> int:
        """Knots in so many memories: the slowest root of the smoother's response tells how long one is."""
        poles, narrowest = self.model.poles, float(self.model.bandwidth.max(axis=1).min())
        decay = pi * narrowest * HALF_POWER ** (-0.5 / poles) * sin(0.5 * pi / poles)
        return int(np.clip(memories / (decay * self.length) + 1, 1, self.knots))

    def spans(self, first_block: int, last_block: int) -> Iterator[tuple[slice, slice]]:
        """Ranges of samples, and the ranges of blocks they fill."""
        at_once = max(1, SAMPLES_AT_ONCE // self.length)
        for first in range(first_block, last_block, at_once):
            last = min(first + at_once, last_block)
            yield slice(first * self.length, min(last * self.length, self.samples)), slice(first, last)

    @property
    def squares(self) -> int:
        """How many moments of a block tell what is known of amplitudes there."""
        return max(2 * self.model.poles - 1, 2)

    def counts(self, weight: Floats, moments: int) -> Floats:
        """(block, moment) sums of the weights of samples from the start of a block on, times powers of u."""
        filled = np.pad(weight, (0, -weight.size % self.length)).reshape(-1, self.length)
        return np.asarray(filled @ self.powers(moments))

    def powers(self, moments: int) -> Floats:
        """(sample of a block, moment) array, powers of u."""
        return (np.arange(self.length) / self.length)[:, None] ** np.arange(moments)

    @cached_property
    def seen_counts(self) -> Floats:
        """(block, moment) sums over the samples seen of powers of u."""
        counts = np.repeat(self.powers(self.squares).sum(axis=0)[None], self.blocks, axis=0)
        whole = np.logical_and.reduceat(self.seen, np.arange(0, self.samples, self.length))
        whole[-1] &= self.samples % self.length == 0
        for samples, blocks in self.runs(~whole):
            counts[blocks] = self.counts(self.seen[samples].astype(np.float64), self.squares)
        return counts

    @cached_property
    def shares(self) -> Floats:
        """(knot,) array, the share of the samples under each hat that are seen."""
        return under_hats(self.seen_counts) / self.length

    def runs(self, blocks: NDArray[np.bool_]) -> Iterator[tuple[slice, slice]]:
        """Yield ranges of samples, and the ranges of blocks they fill, that make up some of the blocks."""
        edges = np.flatnonzero(np.diff(blocks, prepend=False, append=False)).reshape(-1, 2)
        for first, last in edges.tolist():
            yield from self.spans(first, last)

    def taper(self, knots: NDArray[np.bool_], samples: slice) -> Floats:
        """(sample,) array, sum of the hats of some knots."""
        place = np.arange(samples.start, samples.stop) / self.length
        return np.asarray(np.interp(place, np.arange(self.knots), knots.astype(np.float64)))

    @cached_property
    def kinked(self) -> NDArray[np.bool_]:
        """(knot,) array: whether a speed jumps under the hat, so that it no longer is one for the orders."""
        jumps = np.zeros(self.blocks)
        for number, phase in enumerate(self.model.phases):
            highest = float(self.model.orders[self.model.shaft == number].max(initial=0.0))
            own = np.zeros(self.blocks)
            kinks(phase, self.length, own)
            jumps = np.maximum(jumps, highest * own)
        kinked = jumps * self.length > LARGEST_KINK_RAD
        return np.asarray(np.concatenate([kinked[:1], kinked]) | np.concatenate([kinked, kinked[-1:]]))

    def walk_variance(self, orders: Indices) -> Floats:
        """(knot or 1, column) array for some orders: the walk takes one step a knot."""
        model = self.model.subset(orders)
        walk = model.walk_variance(slice(0, None, self.length), step=self.length)
        return walk * self.shared[orders][model.order_of_column]

    def prior_variance(self, orders: Indices, knot: int = 0) -> Floats:
        """(pole, column) array for some orders: what is assumed at the first knot, grown as the walk goes on to one."""
        model = self.model.subset(orders)
        variance = model.prior_variance(step=self.length) * self.shared[orders][model.order_of_column]
        grown = [
            sum(comb(knot, i - j) ** 2 * variance[i] for i in range(j, len(variance))) for j in range(len(variance))
        ]
        return np.stack(grown)

    def unseen_variance(self, order: int) -> Floats:
        """(knot,) array, variance of a quadrature of one of the amplitudes of an order that is never measured."""
        place = np.array([order])
        walk = np.broadcast_to(self.walk_variance(place)[:, 0] / self.shared[order], self.knots)
        covariance = np.diag(self.prior_variance(place)[:, 0] / self.shared[order])
        step = np.triu(np.ones(covariance.shape))
        variance = np.empty(self.knots)
        for knot in range(self.knots):
            variance[knot] = covariance[0, 0]
            covariance[-1, -1] += walk[knot]
            covariance = step @ covariance @ step.T
        return variance

    @cached_property
    def moments(self) -> Floats:
        """(order, block, pair channel, 4) array of the record: see `project` in `_block_kernels`."""
        return self.project(self.x, slice(0, self.blocks), np.arange(self.model.orders.size))

    def project(self, x: Floats, blocks: slice, orders: Indices) -> Floats:
        """Return the moments, as above, of values, (channel, sample), of some blocks against some orders."""
        model, pairs = self.model, -(-self.model.poles // 2)
        sums = np.empty((orders.size, blocks.stop - blocks.start, pairs * len(x), 4))
        start = blocks.start * self.length
        for samples, some in self.spans(blocks.start, blocks.stop):
            values, seen = x[:, samples.start - start : samples.stop - start], self.seen[samples]
            values = np.ascontiguousarray(values if seen.all() else np.where(seen, values, 0.0))
            part = np.empty((orders.size, some.stop - some.start, *sums.shape[2:]))
            phase = model.phase(samples)
            _block_kernels.project(values, phase, model.orders[orders], model.shaft[orders], self.length, part)
            sums[:, some.start - blocks.start : some.stop - blocks.start] = part
        return sums

    def data(self, moments: Floats) -> Floats:
        """(knot, pole, order, channel, 2) array: of all blocks, in a row, what knots stand for."""
        orders, blocks = moments.shape[:2]
        parts = moments.reshape(orders, blocks, -1, len(self.x), 2, 2).transpose(1, 2, 5, 0, 3, 4)
        return self.at_knots(parts.reshape(blocks, -1, orders, len(self.x), 2)[:, : max(self.model.poles, 2)])

    def at_knots(self, moments: Floats) -> Floats:
        """(knot, moment, ...) array from (block, moment, ...): of all blocks, in a row, what knots stand for."""
        if self.model.poles == 1:
            return under_hats(moments)[:, None]
        return np.concatenate([np.zeros_like(moments[:1]), moments])

    def gram(self, orders: Indices, knots: slice) -> Floats:
        """(knot, moment, column, column) array, of products of the columns of some orders what knots stand for."""
        first, last = max(knots.start - 1, 0), min(knots.stop, self.blocks)
        sums = np.empty((last - first, self.squares, 2 * orders.size, 2 * orders.size))
        model = self.model
        for samples, blocks in self.spans(first, last):
            seen, phase = self.seen[None, samples].astype(np.float64), model.phase(samples)
            part = sums[blocks.start - first : blocks.stop - first]
            _block_kernels.correlate(seen, phase, model.orders[orders], model.shaft[orders], self.length, part)
        if orders.size > np.count_nonzero(self.model.orders[orders]):
            turning = np.flatnonzero(self.model.orders[orders])
            columns = np.concatenate([np.arange(orders.size), orders.size + turning])
            sums = sums[:, :, columns[:, None], columns]
        return np.ascontiguousarray(self.at_knots(sums)[knots.start - first : knots.stop - first])


def under_hats(moments: Floats) -> Floats:
    """Turn first two moments of blocks, (block, moment, ...), into sums under hats, (knot, ...)."""
    plain, late = moments[:, 0], moments[:, 1]
    sums = np.zeros((len(plain) + 1, *plain.shape[1:]))
    sums[:-1] = plain - late
    sums[1:] += late
    return sums


def pieces_between(values: NDArray[np.complex128] | Floats, *, cubic: bool) -> Floats:
    """(..., block, part, 4) coefficients between (..., knot) values: a complex one has two parts."""
    parts = np.ascontiguousarray(values)[..., None].view(np.float64)
    left, right = parts[..., :-1, :], parts[..., 1:, :]
    pieces = np.zeros((*left.shape, 4))
    pieces[..., 0] = left
    pieces[..., 1] = right - left
    if cubic and values.shape[-1] > 2:  # noqa: PLR2004
        slope = np.gradient(parts, axis=-2, edge_order=2)
        before, after = slope[..., :-1, :], slope[..., 1:, :]
        pieces[..., 2] = 3 * (right - left) - 2 * before - after
        pieces[..., 3] = 2 * (left - right) + before + after
        pieces[..., 1] = before
    return pieces
