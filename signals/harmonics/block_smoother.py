"""The block smoother: the record is condensed to moments of blocks, and smoothed at the nodes between them.

Between nodes an amplitude is a polynomial of as many terms as its random walk has poles (one pole: constant under a
triangular weight over two blocks). A few moments of a block, sums of its samples times powers of their place (see
`_block_kernels`), hold all information for the smoother over the nodes. The error is of second order in (bandwidth
times block): at the edge of the band (pi bandwidth block)^2 / 12 of an envelope. Changes within a block leak into other
orders by no more, since the spectrum of a triangular weight has double zeros where images fold. Between nodes the
result is interpolated, cubic or, for one pole, linear.

There are two settings. *Fast*: long blocks; orders with negligible leakage are smoothed each alone, the others in
groups. *Exact*: short blocks and all orders jointly, with an error below a few thousandths of `std`, zero with blocks
of one sample. See `docs/trackers.md`.
"""

from math import pi, sqrt

import numpy as np

from signals.harmonics.block_grid import Grid, at_outputs, pieces_between
from signals.harmonics.coupling import Joint, Smoothed, smooth_coupled, smooth_jointly
from signals.harmonics.state_space import Estimate, Flags, Floats, HarmonicModel, Innovations

FEWEST_BLOCKS = 64
# A one-pole walk moves as much within a block as the noise of the block: measured, at this part of 1 / bandwidth the
# estimates lie a hundredth of `std` from the exact ones.
LONGEST_ONE_POLE = 1 / 200
# Samples whose residuals are summed up, in evenly spread segments: enough to estimate the noise variance to 1.1 %.
RESIDUAL_SAMPLES = 1 << 14
SEGMENTS = 16
# Neighbours that leak more are coupled, whatever tolerance is given: to subtract more of them later costs more.
LARGEST_LEAK = 1e-3
# Part of 1 / bandwidth in a block of the exact setting, with one pole and with more: measured with amplitudes that walk
# as the model says, estimates are then within 1e-3 of `std` (root mean square) of those of single samples.
LONGEST_EXACT = 1 / 150, 1 / 64
# What moving amplitudes may lose between nodes in the exact setting, as a part of `std`: the error measured is up to
# twice as large.
LARGEST_DROOP = 1.2e-3


def block_length(model: HarmonicModel, samples: int, rtol: float) -> int:
    """Return how many samples a block may hold for an error of `rtol` at the edge of the widest band."""
    part = sqrt(12 * rtol) / pi
    if model.poles == 1:
        part = min(part, LONGEST_ONE_POLE)
    return max(1, min(int(part / model.bandwidth.max()), samples // FEWEST_BLOCKS))


def scattered_share(seen: Flags, length: int) -> float:
    """Return the share of the samples that are missing in gaps shorter than a block.

    Where such gaps are synchronous with a shaft, as those of a clipped waveform are, orders leak into one another by up
    to this share.
    """
    edges = np.flatnonzero(np.diff(seen, prepend=True, append=True))
    gaps = edges[1::2] - edges[::2]
    return float(gaps[gaps < length].sum() / seen.size)


def fast(model: HarmonicModel, x: Floats, seen: Flags, *, rtol: float, output_every: int, startup: int) -> Estimate:
    """Smooth all channels of a (channel, sample) record, NaN where not `seen`, (sample,), in long blocks.

    Orders that leak into one another by more than `rtol`, or `LARGEST_LEAK`, are smoothed jointly.
    Residuals count in the statistics from sample `startup` on.
    """
    length, tolerance = block_length(model, seen.size, rtol), min(rtol, LARGEST_LEAK)
    if length == 1:
        return exact(model, x, seen, output_every=output_every, startup=startup)
    grid = Grid(model=model, x=x, seen=seen, length=length, tolerance=tolerance)
    smoothed, left = smooth_coupled(grid)
    droop = (pi * model.bandwidth.max() * length) ** 2 / 12  # of an amplitude at the edge of the widest band
    bound = max(droop, scattered_share(seen, length), tolerance, left)
    return estimated(grid, smoothed, residuals(grid, smoothed, startup), output_every=output_every, error_bound=bound)


def exact(
    model: HarmonicModel,
    x: Floats,
    seen: Flags,
    *,
    output_every: int,
    startup: int,
    noise_variance: float | None = None,
) -> Estimate:
    """Smooth all channels of a record in short blocks, all orders together.

    Parameters as for `fast`; `noise_variance` is R, None where it is estimated.
    """
    length = exact_length(model, seen.size)
    while True:
        grid = Grid(model=model, x=x, seen=seen, length=length)
        smoothed, nodes = Smoothed.empty(grid), slice(0, grid.nodes)
        joint = Joint(np.arange(model.orders.size), nodes, nodes)
        smooth_jointly(grid, joint, grid.at_nodes(grid.moments), smoothed)
        innovations = residuals(grid, smoothed, startup)
        std = np.sqrt(innovations.mean_square if noise_variance is None else np.full(len(x), noise_variance))
        # A triangular weight takes a twelfth of its second difference off an envelope: root mean square, over `std`.
        bend = np.sum(np.abs(np.diff(smoothed.levels, 2)) ** 2, axis=-1) / max(grid.nodes - 2, 1)
        loss, noise = np.sqrt(bend) / 12, np.sqrt(smoothed.variances.mean(axis=1)) * std[:, None]
        lost = float(np.max(np.divide(loss, noise, out=np.zeros_like(noise), where=noise > 0)))
        if length == 1 or lost <= LARGEST_DROOP:
            return estimated(grid, smoothed, innovations, output_every=output_every, error_bound=0.0)
        # The loss grows with the square of the length.
        length = max(1, min(int(length * sqrt(LARGEST_DROOP / lost)), length - 1))


def exact_length(model: HarmonicModel, samples: int | None = None) -> int:
    """Return the samples in a block of the exact setting, before amplitudes are known; None where they go on."""
    # Longer ones gain little: the products of their columns cost more than the chain.
    most = 6 * model.state_size
    most = most if samples is None else min(most, samples // FEWEST_BLOCKS)
    return max(1, min(int(LONGEST_EXACT[model.poles > 1] / model.bandwidth.max()), most))


def estimated(
    grid: Grid, smoothed: Smoothed, innovations: Innovations, *, output_every: int, error_bound: float
) -> Estimate:
    """Return the estimate at the outputs."""
    amplitude = at_outputs(smoothed.levels, grid, every=output_every)
    return Estimate(
        amplitude=amplitude, variance=smoothed.variances, innovations=innovations, std_spacing=grid.length,
        error_bound=error_bound,
    )  # fmt: skip


def residuals(grid: Grid, smoothed: Smoothed, startup: int) -> Innovations:
    """Return statistics of the residuals in segments of the record from sample `startup` on.

    Where the model holds, the variance of a residual is R less that of the fitted waveform, the trace of the joint
    covariance of the amplitudes times their regressors.
    """
    model = grid.model
    pieces = pieces_between(smoothed.levels, cubic=model.poles > 1)
    explained = smoothed.explained.sum(axis=0)
    # With one pole half of a node's samples lie on either side, else all before it.
    explained = (explained[:-1] + explained[1:]) / 2 if model.poles == 1 else explained[1:]
    at_once, first = RESIDUAL_SAMPLES // SEGMENTS, min(-(-startup // grid.length), grid.blocks - 1)
    count = min(-(-at_once // grid.length), grid.blocks - first)
    found, lost, orders = Innovations(np.zeros(len(grid.x))), 0.0, np.arange(model.orders.size)
    for start in np.unique(np.linspace(first, grid.blocks - count, SEGMENTS).astype(np.int64)).tolist():
        begin, end = start * grid.length, min((start + count) * grid.length, grid.samples)
        samples = slice(begin, min(begin + at_once, end))
        rest = grid.x[:, samples] - grid.waveforms(pieces, orders, samples)
        found.add(np.where(grid.seen[samples], rest, 0.0), grid.seen[samples])
        lost += float(explained[start : start + count].sum()) * (samples.stop - begin) / (end - begin)
    found.square /= max(found.count - lost, 1.0) / max(found.count, 1)
    return found
