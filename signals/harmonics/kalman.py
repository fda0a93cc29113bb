"""Complex amplitudes of shaft harmonics by Kalman filter and smoother.

`exact` takes every sample in turn. `fast` first condenses each short block of samples into one measurement a
quadrature, taking the amplitudes as constant over the block, and smooths those. Both run the same two sweeps,
a covariance filter forward and an information filter backward, which meet at the outputs. They meet stretch
by stretch, so that memory beyond the outputs grows with the square root of the record.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._chain import Chain, filter_chain, smooth_chain
from signals.harmonics.model import Estimate, Estimator, Floats, HarmonicModel

# A block of the fast method lasts this fraction of 1 / bandwidth, and a record has at least so many blocks.
BLOCK = 1 / 200
FEWEST_BLOCKS = 64
SAMPLES_AT_ONCE = 1 << 15


def exact(model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int) -> Estimate:
    """Filter or smooth sample by sample.

    A sample costs (poles columns)^2 operations forward and columns times that backward.

    Parameters
    ----------
    model : what is estimated.
    x : (sample,) array, NaN where missing.
    estimator : "smoother" or "filter".
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    """
    track = smooth_chain if estimator == "smoother" else filter_chain
    wanted = np.zeros(x.size, dtype=np.bool_)
    wanted[::output_every] = True
    # The samples are copied because a kernel would be compiled anew for a read-only array.
    chain = Chain(
        measurements=lambda span: (model.regressors(span)[:, None, :], x[span, None].copy()),
        walk_variance=model.walk_variance(),
        prior_variance=model.prior_variance(),
        wanted=wanted,
    )
    levels, variances, tally = track(chain, startup)
    return Estimate(
        levels=levels,
        variances=variances,
        innovation_mean_square=tally.square / tally.count,
        innovation_log_variance=tally.log_variance / tally.count,
    )


def fast(model: HarmonicModel, x: Floats, *, output_every: int, startup: int) -> Estimate:
    """Smooth over short blocks of samples, each condensed to what it says of constant amplitudes.

    The walk takes one step a block; its variance follows from the bandwidth as for single samples, with one
    block-th of the noise. Interpolation between block centres errs by the square of (envelope frequency times
    block length). What an amplitude does within a block leaks into the orders by about that product itself,
    but with the phase of the sums and differences of two orders, which the smoother averages out unless one
    of these frequencies passes a multiple of the block rate.

    Parameters
    ----------
    model : what is estimated.
    x : (sample,) array, NaN where missing.
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    """
    blocks = ceil(x.size / block_length(model, x.size))
    edges = np.linspace(0, x.size, blocks + 1).round().astype(np.int64)
    rows, data, residuals = _condense(model, x, edges)
    between = _Between.centres(edges, np.arange(0, x.size, output_every))
    chain = Chain(
        measurements=lambda span: (rows[span], data[span]),
        walk_variance=model.walk_variance(step=x.size / blocks),
        prior_variance=model.prior_variance(step=x.size / blocks),
        wanted=between.wanted,
    )
    first = int(np.searchsorted(edges, startup, side="right")) - 1
    levels, variances, tally = smooth_chain(chain, first)
    count = np.count_nonzero(~np.isnan(x[edges[first] :]))
    # A plain random walk stands still beyond its last datum; a slope goes on, and so does uncertainty.
    return Estimate(
        levels=between.interpolate(levels, extrapolate=model.poles > 1),
        variances=between.interpolate(variances, extrapolate=True),
        innovation_mean_square=(tally.square + float(residuals[first:].sum())) / count,
        innovation_log_variance=tally.log_variance / count,
    )


def block_length(model: HarmonicModel, samples: int) -> int:
    """Return how many samples the fast method condenses into one block."""
    return max(1, min(int(BLOCK / model.bandwidth.max()), samples // FEWEST_BLOCKS))


def _condense(model: HarmonicModel, x: Floats, edges: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """Replace each block's samples by one measurement a column that say the same of constant amplitudes.

    With the block's regressors A, `[A x]^T [A x] = L L^T`: the first columns of L are the rows, its last row
    holds the data and, at the end, the root of the sum of squares that no amplitude explains.

    Returns
    -------
    rows, data, residuals : (block, column, column), (block, column) and (block,) arrays.
    """
    columns = model.order_of_column.size
    longest = int(np.diff(edges).max())
    scale = float(np.sqrt(np.nanmean(x**2))) or 1.0
    # A whisper of "all is zero" keeps L real where a block is missing or too short to tell orders apart.
    whisper = 1e-13 * longest * np.eye(columns + 1)
    factors = np.empty((edges.size - 1, columns + 1, columns + 1))
    at_once = max(1, SAMPLES_AT_ONCE // longest)
    for start in range(0, edges.size - 1, at_once):
        stop = min(start + at_once, edges.size - 1)
        sample = edges[start:stop, None] + np.arange(longest)
        inside = sample < edges[start + 1 : stop + 1, None]
        sample = np.minimum(sample, x.size - 1)
        inside &= ~np.isnan(x[sample])
        a = np.empty((stop - start, longest, columns + 1))
        a[..., :columns] = model.regressors(sample)
        a[..., columns] = x[sample] / scale
        a[~inside] = 0.0
        factors[start:stop] = np.linalg.cholesky(a.transpose(0, 2, 1) @ a + whisper)
    rows = np.ascontiguousarray(factors[:, :columns, :columns].transpose(0, 2, 1))
    return rows, scale * factors[:, columns, :columns], (scale * factors[:, columns, columns]) ** 2


@dataclass(frozen=True, kw_only=True, eq=False)
class _Between:
    """Where outputs lie between block centres.

    Attributes
    ----------
    wanted : (block,) array, the blocks next to an output.
    left, right : (output,) arrays, which of the wanted blocks these are.
    weight : (output,) array, of the right one; outside 0 to 1 before the first centre and after the last.
    """

    wanted: NDArray[np.bool_]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    weight: Floats

    @classmethod
    def centres(cls, edges: NDArray[np.int64], at: NDArray[np.int64]) -> "_Between":
        """Place the samples `at` between the centres of the blocks with these edges."""
        centres = (edges[:-1] + edges[1:] - 1).astype(np.float64) / 2
        right = np.searchsorted(centres, at).clip(min(1, centres.size - 1), centres.size - 1)
        left = np.maximum(right - 1, 0)
        wanted = np.zeros(centres.size, dtype=np.bool_)
        wanted[left] = wanted[right] = True
        place = np.cumsum(wanted) - 1
        # Only a single block has no distance to its neighbour.
        weight = (at - centres[left]) / np.maximum(centres[right] - centres[left], 1.0)
        return cls(wanted=wanted, left=place[left], right=place[right], weight=weight)

    def interpolate(self, values: Floats, *, extrapolate: bool) -> Floats:
        """(output, column) values, linear in those of the wanted blocks; held beyond them or carried on."""
        weight = self.weight if extrapolate else self.weight.clip(0.0, 1.0)
        columns = [(1 - weight) * column[self.left] + weight * column[self.right] for column in values.T]
        return np.stack(columns, axis=1)
