"""Amplitudes and variances between the nodes of a grid, as the smoother finds them: stretch by stretch from the end."""

from dataclasses import dataclass, field

import numpy as np

from signals.harmonics import _block_kernels
from signals.harmonics._information_smoother import SmoothedChain
from signals.harmonics.grid import Grid, pieces_between
from signals.harmonics.model import Complexes, Floats

# Nodes of the stretch after that a cubic reaches: the first of them, and one more on either side of the next block.
AHEAD = 3


def at_outputs(levels: Complexes, grid: Grid, *, every: int, skip: int = 0, samples: int | None = None) -> Complexes:
    """(channel, order, output) amplitudes between the nodes.

    Parameters
    ----------
    levels : (channel, order, node) array.
    grid : of these nodes.
    every, skip : samples from one output to the next, and before the first.
    samples : how many from the first on have outputs; all unless given.
    """
    outputs = len(range(skip, grid.samples if samples is None else samples, every))
    return _evaluated(pieces_between(levels, cubic=grid.model.poles > 1), grid.length, skip, every, outputs)


def _evaluated(pieces: Floats, length: int, skip: int, every: int, outputs: int) -> Complexes:
    """(channel, order, output) values of (channel, order, block, 2, 4) pieces."""
    channels, orders = pieces.shape[:2]
    values = np.empty((channels * orders, 2 * outputs))
    _block_kernels.evaluate(np.ascontiguousarray(pieces.reshape(-1, *pieces.shape[2:])), length, skip, every, values)
    return values.view(np.complex128).reshape(channels, orders, -1)


@dataclass(eq=False)
class BlockOutputs:
    """Outputs of a record whose nodes are smoothed from the last to the first.

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
            pieces = pieces_between(levels, cubic=model.poles > 1)
            pieces = pieces[:, :, begin - nodes.start : end - nodes.start]
            first = -(-begin * length // self.every)
            last = self.amplitude.shape[-1] if end == grid.blocks else -(-end * length // self.every)
            skip = first * self.every - begin * length
            self.amplitude[..., first:last] = _evaluated(pieces, length, skip, self.every, last - first)
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
