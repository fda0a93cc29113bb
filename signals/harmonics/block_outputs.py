"""Outputs of a record whose nodes are smoothed from the last to the first, stretch by stretch."""

from dataclasses import dataclass, field

import numpy as np

from signals.harmonics._information_smoother import SmoothedChain
from signals.harmonics.grid import Grid, evaluated, pieces_between
from signals.harmonics.model import Complexes, Floats

# Nodes of the stretch after that a cubic reaches: the first of them, and one more on either side of the next block.
AHEAD = 3


@dataclass(eq=False)
class BlockOutputs:
    """What there is of them so far, in memory that does not grow with the nodes where outputs are fewer.

    Attributes
    ----------
    grid : the record.
    every : samples between outputs.
    amplitude : (channel, order, output) array.
    variance : (order, output) array; (order, node) where there are more outputs than nodes.
    bend : (channel, order) array, sum of the squared second differences of the amplitudes at the nodes.
    """

    grid: Grid
    every: int
    amplitude: Complexes
    variance: Floats
    bend: Floats
    _levels: Complexes = field(repr=False)
    _variances: Floats = field(repr=False)
    _emitted: int = field(repr=False)

    @classmethod
    def empty(cls, grid: Grid, *, every: int) -> "BlockOutputs":
        """Return the outputs before any stretch is smoothed."""
        channels, orders = len(grid.x), grid.model.orders.size
        outputs = -(-grid.samples // every)
        known = grid.nodes if every <= grid.length else outputs
        return cls(
            grid=grid,
            every=every,
            amplitude=np.empty((channels, orders, outputs), dtype=np.complex128),
            variance=np.empty((orders, known)),
            bend=np.zeros((channels, orders)),
            _levels=np.empty((channels, orders, 0), dtype=np.complex128),
            _variances=np.empty((orders, 0)),
            _emitted=grid.blocks,
        )

    def take(self, nodes: slice, smoothed: SmoothedChain) -> None:
        """Fill the outputs that a stretch and the one after it determine."""
        grid, model, length = self.grid, self.grid.model, self.grid.length
        own = [model.amplitude(smoothed.levels[:, :, channel]) for channel in range(len(grid.x))]
        levels = np.concatenate([np.stack(own), self._levels], axis=-1)
        variances = np.concatenate([model.variance(smoothed.variances), self._variances], axis=-1)
        count = nodes.stop - nodes.start
        self.bend += np.sum(np.abs(np.diff(levels[..., : count + 2], 2, axis=-1)) ** 2, axis=-1)
        if self.every <= length:
            self.variance[:, nodes] = variances[:, :count]
        else:
            first, last = (-(-node * length // self.every) for node in (nodes.start, nodes.stop))
            here = np.arange(first, min(last, self.amplitude.shape[-1])) * self.every
            at = length * np.arange(nodes.start, nodes.start + variances.shape[1])
            for k, values in enumerate(np.sqrt(variances)):  # as `OrderTracks.std` does it between nodes
                self.variance[k, first:last] = np.interp(here, at, values) ** 2
        begin, end = nodes.start + (nodes.start > 0), self._emitted
        if begin < end:
            pieces = pieces_between(levels, cubic=model.poles > 1)[:, :, begin - nodes.start : end - nodes.start]
            first = -(-begin * length // self.every)
            last = self.amplitude.shape[-1] if end == grid.blocks else -(-end * length // self.every)
            skip = first * self.every - begin * length
            self.amplitude[..., first:last] = evaluated(pieces, length, self.every, skip, last - first)
            self._emitted = begin
        self._levels, self._variances = levels[..., :AHEAD].copy(), variances[:, :AHEAD].copy()

    def droop(self, noise_std: Floats) -> float:
        """Return what moving amplitudes lose between nodes, as a part of `std`: root mean square, of the worst order.

        A triangular weight takes a twelfth of its second difference off an envelope.

        Parameters
        ----------
        noise_std : (channel,) array.
        """
        lost = np.sqrt(self.bend / max(self.grid.nodes - 2, 1)) / 12
        std = np.sqrt(self.variance.mean(axis=1)) * noise_std[:, None]
        return float(np.max(np.divide(lost, std, out=np.zeros_like(lost), where=std > 0)))
