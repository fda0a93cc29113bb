"""A record in blocks: what samples say at the knots between them, and amplitudes at the knots back at the samples."""

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
LARGEST_KINK_RAD = 0.1


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

    @cached_property
    def weights(self) -> tuple[Floats, Floats]:
        """Observed samples under each hat, and how far their centre lies from the knot, in blocks."""
        u = np.arange(self.length) / self.length
        powers = np.stack([np.ones(self.length), u, u**2], axis=1)
        moments = np.repeat(powers.sum(axis=0)[:, None], self.blocks, axis=1)
        whole = np.logical_and.reduceat(self.seen, np.arange(0, self.samples, self.length))
        whole[-1] &= self.samples % self.length == 0
        for block in np.flatnonzero(~whole):
            seen = self.seen[block * self.length : (block + 1) * self.length]
            moments[:, block] = seen @ powers[: seen.size]
        count, first, second = moments
        weight = at_knots(np.stack([count, first]))
        moment = np.zeros(self.blocks + 1)
        moment[:-1] += first - second
        moment[1:] -= first - second
        return weight, np.divide(moment, weight, out=np.zeros_like(moment), where=weight > 0)

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
    def data(self) -> Floats:
        """(order, knot, channel, 2) array, sums under the hats of the record times cos and -sin."""
        orders = np.arange(self.model.orders.size)
        sums = np.empty((orders.size, self.blocks, len(self.x), 4))
        for samples, blocks in self.spans(0, self.blocks):
            self.project(self.x[:, samples], samples, orders, sums[:, blocks])
        return hat_sums(sums).swapaxes(0, 1)

    def project(self, x: Floats, samples: slice, orders: Indices, sums: Floats) -> None:
        """Fill the moments of values, (channel, sample), of some samples against some orders: see `project` there."""
        values = x if self.seen[samples].all() else np.where(self.seen[samples], x, 0.0)
        part = np.empty(sums.shape)
        model, phase = self.model, self.model.phase(samples)
        _block_kernels.project(
            np.ascontiguousarray(values), phase, model.orders[orders], model.shaft[orders], self.length, part
        )
        sums[:] = part

    def gram(self, orders: Indices, knots: slice) -> Floats:
        """(knot, column, column) array, sums under the hats of products of the columns of some orders."""
        first, last = max(knots.start - 1, 0), min(knots.stop, self.blocks)
        sums = np.empty((last - first, 2, 2 * orders.size, 2 * orders.size))
        model = self.model
        for samples, blocks in self.spans(first, last):
            seen = self.seen[None, samples].astype(np.float64)
            phase = self.model.phase(samples)
            part = sums[blocks.start - first : blocks.stop - first]
            _block_kernels.correlate(seen, phase, model.orders[orders], model.shaft[orders], self.length, part)
        turning = np.flatnonzero(self.model.orders[orders])
        columns = np.concatenate([np.arange(orders.size), orders.size + turning])
        hats = at_knots(sums.swapaxes(0, 1))[knots.start - first : knots.stop - first]
        return np.ascontiguousarray(hats[:, columns[:, None], columns])


def at_knots(moments: Floats) -> Floats:
    """Turn a block's sums, (2, block, ...) plain and times u, into sums under hats, (knot, ...)."""
    plain, weighted = moments
    sums = np.zeros((len(plain) + 1, *plain.shape[1:]))
    sums[:-1] = plain - weighted
    sums[1:] += weighted
    return sums


def hat_sums(sums: Floats) -> Floats:
    """(knot, order, channel, 2) array, sums under hats of x cos and -x sin, from a `project`'s (order, block, ...)."""
    return at_knots(sums.reshape(*sums.shape[:3], 2, 2).transpose(4, 1, 0, 2, 3))


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
