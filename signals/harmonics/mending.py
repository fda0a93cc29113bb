"""A record with the waveforms of all orders but one, or a group, taken out under some hats."""

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _block_kernels
from signals.harmonics.grid import Grid, pieces_between
from signals.harmonics.model import Floats, Indices


class Mended:
    """The moments of a record as they would be without the others, as far as their amplitudes are known.

    Taken out is a waveform times the sum of the hats of some knots: all under these, nothing a block off.
    """

    def __init__(self, grid: Grid, levels: NDArray[np.complex128], knots: NDArray[np.bool_]) -> None:
        self._grid, self._knots = grid, knots
        self._pieces = pieces_between(levels, cubic=grid.model.poles > 1)
        orders = np.arange(grid.model.orders.size)
        self._runs = list(grid.runs(knots[:-1] | knots[1:]))
        self._moments = grid.moments.copy()
        for samples, blocks in self._runs:
            rest = grid.x[:, samples] - self._waves(orders, samples)
            self._moments[:, blocks] = grid.project(rest, blocks, orders)

    def alone(self, orders: Indices) -> Floats:
        """(knot, pole, order, channel, 2) array, what knots stand for, of orders each without all others.

        Nor are its images left in what is put back of an order.
        """
        grid = self._grid
        moments = self._moments[orders]
        many = 2 * moments.shape[2] // len(grid.x)
        parts = np.where(grid.model.orders[orders] == 0, 1.0, 2.0)[:, None, None, None, None]
        for samples, blocks in self._runs:
            counts = grid.counts(grid.seen[samples] * grid.taper(self._knots, samples), many + 3)
            hankel = np.stack([counts[:, m : m + 4] for m in range(many)], axis=1)  # block, moment, power
            own = np.einsum("bmj,cobpj->obmcp", hankel, self._pieces[:, orders, blocks]) / parts
            shape = *own.shape[:2], many // 2, 2, *own.shape[3:]
            moments[:, blocks] += (
                own.reshape(shape).transpose(0, 1, 2, 4, 5, 3).reshape(moments[:, blocks].shape)
            )  # order, block, pair, channel, part, late
        return grid.data(moments)

    def together(self, group: Indices, knots: slice = slice(None)) -> Floats:
        """(knot, pole, order, channel, 2) array, what some knots stand for, of a group without all others."""
        grid = self._grid
        first, last, _ = knots.indices(grid.knots)
        start, stop = max(first - 1, 0), min(last, grid.blocks)
        moments = self._moments[group, start:stop]
        for samples, blocks in self._runs:
            if blocks.stop > start and blocks.start < stop:
                own = grid.project(self._waves(group, samples), blocks, group)
                inside = slice(max(blocks.start, start), min(blocks.stop, stop))
                moments[:, inside.start - start : inside.stop - start] += own[
                    :, inside.start - blocks.start : inside.stop - blocks.start
                ]
        return grid.data(moments)[first - start : last - start]

    def _waves(self, orders: Indices, samples: slice) -> Floats:
        """(channel, sample) array, the waveforms of some orders added up, times the hats."""
        grid, model = self._grid, self._grid.model
        waves = np.zeros((len(grid.x), samples.stop - samples.start))
        phase = model.phase(samples)
        for pieces, wave in zip(self._pieces, waves, strict=True):
            own = np.ascontiguousarray(pieces[orders])
            _block_kernels.remodulate(
                own, grid.length, phase, model.orders[orders], model.shaft[orders], samples.start, wave
            )
        waves *= grid.taper(self._knots, samples)
        return waves
