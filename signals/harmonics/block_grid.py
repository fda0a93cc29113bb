"""A record in blocks: moments of its samples for the nodes between blocks, and interpolation from nodes to samples.

With one pole a node has the moments of the samples under a triangular weight, which falls from 1 at the node to 0 at
its neighbours. With more, amplitudes are polynomials from node to node, and a node has the moments of the block before
it: as many as there are poles, and of products one less than twice as many.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import pi, sin

import numpy as np

from signals.harmonics import _block_kernels
from signals.harmonics._block_kernels import PIECE
from signals.harmonics.bandwidth import HALF_POWER, MOST_POLES
from signals.harmonics.state_space import Complexes, Flags, Floats, HarmonicModel, Indices

SAMPLES_AT_ONCE = 1 << 16  # numbers at a time, which stay in a near cache
# Angle by which a jump of the speed may lead the highest order astray within a block.
LARGEST_JUMP_RAD = 0.03
# Blocks, at least, whose moments are worth a table of the phasors in one, and samples in a product with it.
FEWEST_TABULATED, TABULATED_AT_ONCE = 8, 1 << 18


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """A record in blocks: nodes at the first sample of each, and one after the last."""

    model: HarmonicModel  # of the record
    x: Floats  # (channel, sample), the record, NaN where missing
    seen: Flags  # (sample,), whether the sample is there
    length: int  # samples in a block
    tolerance: float = 0.0  # largest relative leakage of an order that is not coupled

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.x.shape[1])

    @property
    def blocks(self) -> int:
        """Number of blocks; the last one may be partly filled."""
        return -(-self.samples // self.length)

    @property
    def nodes(self) -> int:
        """Number of nodes: one more than blocks."""
        return self.blocks + 1

    def reach(self, memories: float) -> int:
        """Return the nodes in so many time constants of the slowest root of the smoother's response."""
        poles = self.model.poles
        decay = pi * self.model.narrowest * HALF_POWER ** (-0.5 / poles) * sin(0.5 * pi / poles)
        return int(np.clip(memories / (decay * self.length) + 1, 1, self.nodes))

    def spans(self, first_block: int, last_block: int, samples: int = SAMPLES_AT_ONCE) -> Iterator[tuple[slice, slice]]:
        """Yield ranges of about so many samples, and the ranges of blocks they fill."""
        at_once = max(1, samples // self.length)
        for first in range(first_block, last_block, at_once):
            last = min(first + at_once, last_block)
            yield slice(first * self.length, min(last * self.length, self.samples)), slice(first, last)

    def runs(self, blocks: Flags) -> Iterator[tuple[slice, slice]]:
        """Yield ranges of samples, and the ranges of blocks they fill, that make up some of the blocks."""
        edges = np.flatnonzero(np.diff(blocks, prepend=False, append=False)).reshape(-1, 2)
        for first, last in edges.tolist():
            yield from self.spans(first, last)

    @property
    def squares(self) -> int:
        """Moments of a block that hold all its information on amplitudes."""
        return max(2 * self.model.poles - 1, 2)

    def counts(self, weight: Floats, moments: int) -> Floats:
        """(block, moment) sums of the weights of samples from the start of a block on, times powers of u."""
        filled = np.pad(weight, (0, -weight.size % self.length)).reshape(-1, self.length)
        return np.asarray(filled @ self._powers[:, :moments])

    @cached_property
    def _powers(self) -> Floats:
        """(sample, moment) powers of u in a block, as many as moments of products need with most poles."""
        return (np.arange(self.length) / self.length)[:, None] ** np.arange(2 * MOST_POLES - 1)

    @cached_property
    def seen_counts(self) -> Floats:
        """(block, moment) sums over the samples seen of powers of u."""
        parts = (self.seen[samples].astype(np.float64) for samples, _ in self.spans(0, self.blocks))
        return np.concatenate([self.counts(part, self.squares) for part in parts])

    def taper(self, nodes: Flags, samples: slice) -> Floats:
        """(sample,) array, sum of the triangular weights of some nodes."""
        place = np.arange(samples.start, samples.stop) / self.length
        return np.asarray(np.interp(place, np.arange(self.nodes), nodes.astype(np.float64)))

    @cached_property
    def cut(self) -> Flags:
        """(node,) array, true where a weight is incomplete or a speed jumps."""
        return (triangular(self.seen_counts) / self.length < 1 - self.tolerance) | self.jumps

    def around(self, nodes: slice, memories: float) -> slice:
        """Return a range of nodes, widened by so many time constants."""
        reach = self.reach(memories)
        return slice(max(nodes.start - reach, 0), min(nodes.stop + reach, self.nodes))

    def samples_of(self, nodes: slice) -> slice:
        """Return the range of samples from some nodes on."""
        return slice(min(nodes.start * self.length, self.samples - 1), min(nodes.stop * self.length, self.samples))

    @cached_property
    def jumps(self) -> Flags:
        """(node,) array, true where a speed jumps in a block beside the node."""
        largest = np.zeros(self.blocks)
        for number, phase in enumerate(self.model.phases):
            highest = float(self.model.orders[self.model.shaft == number].max(initial=0.0))
            own = np.zeros(self.blocks)
            _block_kernels.step_changes(phase, self.length, own)
            largest = np.maximum(largest, highest * own)
        jumps = largest * self.length > LARGEST_JUMP_RAD
        return np.asarray(np.concatenate([jumps[:1], jumps]) | np.concatenate([jumps, jumps[-1:]]))

    def process_noise(self, orders: Indices) -> Floats:
        """(node or 1, column) array, process-noise variances from node to node of some orders."""
        model = self.model.subset(orders)
        return model.process_noise(slice(0, None, self.length), step=self.length)

    @cached_property
    def moments(self) -> Floats:
        """(block, moment, order, channel, 2) array of the record: see `project` in `_block_kernels`."""
        return self.project(self.x, slice(0, self.blocks), np.arange(self.model.orders.size))

    @cached_property
    def _table(self) -> Complexes:
        """(sample, moment, order) array of the first block at steady speed, powers of u times exp(-j angle)."""
        angle = (self.model.steady_step or 0.0) * np.arange(self.length)[:, None] * self.model.orders
        powers = self._powers[:, : max(self.model.poles, 2)]
        return np.asarray(powers[:, :, None] * _block_kernels.phasors(angle)[:, None])

    def project(self, x: Floats, blocks: slice, orders: Indices) -> Floats:
        """Return the moments, as above, of values, (channel, sample), of some blocks against some orders.

        Where the angle grows steadily, those of whole blocks are products with one table, turned by the angle at the
        start of each block.
        """
        model, length = self.model, self.length
        moments, whole, start = max(model.poles, 2), blocks.start, blocks.start * length
        sums = np.zeros((blocks.stop - blocks.start, moments, orders.size, len(x), 2))
        if model.steady_step is not None and min(blocks.stop, self.samples // length) >= whole + FEWEST_TABULATED:
            whole = min(blocks.stop, self.samples // length)
            table = np.ascontiguousarray(self._table[:, :, orders]).reshape(length, -1).view(np.float64)
            turn = _block_kernels.phasors(model.phases[0][: whole * length : length, None] * model.orders[orders])
        for samples, some in (*self.spans(blocks.start, whole, TABULATED_AT_ONCE), *self.spans(whole, blocks.stop)):
            values, seen = x[:, samples.start - start : samples.stop - start], self.seen[samples]
            values = np.ascontiguousarray(values if seen.all() else np.where(seen, values, 0.0))
            part = sums[some.start - blocks.start : some.stop - blocks.start]
            if some.stop <= whole:
                products = (values.reshape(-1, length) @ table).view(np.complex128)
                turned = products.reshape(len(x), -1, moments, orders.size) * turn[some, None]
                part[..., 0], part[..., 1] = turned.real.transpose(1, 2, 3, 0), turned.imag.transpose(1, 2, 3, 0)
            else:
                phase = model.phase(samples)
                work = np.empty((2 + len(x) * moments, 2 * PIECE))
                _block_kernels.project(values, phase, model.orders[orders], model.shaft[orders], length, work, part)
        return sums

    def waveforms(self, pieces: Floats, orders: Indices, samples: slice) -> Floats:
        """(channel, sample) array, of some orders added up, from (channel, order, block, 2, 4) `pieces_between`."""
        model, waves = self.model, np.zeros((len(pieces), samples.stop - samples.start))
        first, last = samples.start // self.length, -(-samples.stop // self.length)
        own, given = np.ascontiguousarray(pieces[:, orders, first:last]), (model.orders[orders], model.shaft[orders])
        start, work = samples.start - first * self.length, np.empty((2, PIECE))
        for some, wave in zip(own, waves, strict=True):
            _block_kernels.remodulate(some, self.length, model.phase(samples), *given, start, work, wave)
        return waves

    def at_nodes(self, moments: Floats) -> Floats:
        """(node, moment, ...) array from (block, moment, ...): of all blocks, in a row, what nodes stand for."""
        if self.model.poles == 1:
            return triangular(moments)[:, None]
        return np.concatenate([np.zeros_like(moments[:1]), moments])

    def gram(self, orders: Indices, nodes: slice) -> Floats:
        """(node, moment, column, column) array, of products of the columns of some orders what nodes stand for."""
        first, last = max(nodes.start - 1, 0), min(nodes.stop, self.blocks)
        model = self.model.subset(orders)
        width = model.order_of_column.size
        sums = np.zeros((last - first, self.squares, width, width))
        powers = np.empty((3 * -(-self.squares // 3), PIECE))
        for samples, blocks in self.spans(first, last, SAMPLES_AT_ONCE // width):
            columns, own = model.regressors(samples), sums[blocks.start - first : blocks.stop - first]
            _block_kernels.correlate(columns, self.seen[samples], self.length, powers, own)
        return np.ascontiguousarray(self.at_nodes(sums)[nodes.start - first : nodes.stop - first])


def triangular(moments: Floats) -> Floats:
    """Turn first two moments of blocks, (block, moment, ...), into sums under triangular weights, (node, ...)."""
    plain, late = moments[:, 0], moments[:, 1]
    sums = np.zeros((len(plain) + 1, *plain.shape[1:]))
    sums[:-1] = plain - late
    sums[1:] += late
    return sums


def pieces_between(values: Complexes | Floats, *, cubic: bool) -> Floats:
    """(..., block, part, 4) coefficients between (..., node) values: a complex one has two parts."""
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


def at_outputs(levels: Complexes, grid: Grid, *, every: int) -> Complexes:
    """(channel, order, output) amplitudes from (channel, order, node) levels, cubic in between, straight for one pole.

    Outputs are `every` samples apart.
    """
    pieces = pieces_between(levels, cubic=grid.model.poles > 1)
    values = np.empty((pieces.shape[0] * pieces.shape[1], 2 * len(range(0, grid.samples, every))))
    _block_kernels.evaluate(pieces.reshape(-1, *pieces.shape[2:]), grid.length, every, values)
    return values.view(np.complex128).reshape(*pieces.shape[:2], -1)
