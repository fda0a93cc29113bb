"""The fast smoother: the record condensed to a grid of knots, and smoothed there.

Each knot sums up the samples round it, weighted by a hat over two blocks (see `_block_kernels`), as if amplitudes
stood still under a hat: what a Kalman chain over the knots needs to know of them. Hats add up to one, so that every
sample counts once. The error is of second order in (bandwidth times block): hats flatten an envelope at the edge of
the band by (pi bandwidth block)^2 / 12, and what moves under a hat leaks into other orders only by that much, since
the spectrum of a hat has double zeros where images fold. Between knots amplitudes are cubic (linear for one pole,
whose envelopes have no slope).

Orders that do not disturb one another share small chains; those that do are smoothed together, with the sums of
their products. See `docs/trackers.md`.
"""

from dataclasses import dataclass
from math import ceil, inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _block_kernels
from signals.harmonics.coupling import Levels, couple, smooth_apart
from signals.harmonics.grid import Grid, pieces_between
from signals.harmonics.model import LAGS, Estimate, Floats, HarmonicModel, Indices
from signals.harmonics.separability import Closeness

FEWEST_BLOCKS = 64
# A one-pole walk moves as much within a block as a block's own noise tells: measured, at this part of 1 / bandwidth
# the estimates lie a hundredth of `std` from the exact ones.
LONGEST_ONE_POLE = 1 / 200
# Samples whose residuals are summed up, in evenly spread stretches: enough to tell the noise variance to 0.6 %.
RESIDUAL_SAMPLES = 1 << 16
STRETCHES = 16


def block_length(model: HarmonicModel, samples: int, rtol: float) -> int:
    """Return how many samples a block may hold for an error of `rtol` at the edge of the widest band."""
    part = sqrt(12 * rtol) / pi
    if model.poles == 1:
        part = min(part, LONGEST_ONE_POLE)
    return max(1, min(int(part / model.bandwidth.max()), samples // FEWEST_BLOCKS))


def droop(model: HarmonicModel, length: int) -> float:
    """Return how much of an amplitude at the edge of the widest band blocks of this length take away."""
    return float((pi * model.bandwidth.max() * length) ** 2 / 12)


def scattered_share(seen: NDArray[np.bool_], length: int) -> float:
    """Return the part of the samples that are missing in gaps shorter than a block.

    Where such gaps keep in step with a shaft, as those of a clipped waveform do, orders no longer average out of one
    another under a hat: up to so much of one gets into others.
    """
    edges = np.flatnonzero(np.diff(seen, prepend=True, append=True))
    gaps = edges[1::2] - edges[::2]
    return float(gaps[gaps < length].sum() / seen.size)


def blurs(model: HarmonicModel) -> bool:
    """Say whether blocks tell some orders apart better than the record does.

    Lines that stay within half a bandwidth of each other differ in what an amplitude with slopes may do, too. Under a
    hat amplitudes stand still, and so what tells the lines apart there is taken for sure.
    """
    if model.poles == 1:
        return False
    kept, _ = _one_of_each(model)
    return Closeness(model.subset(kept), model.phases[0].size).dwell()


def fast(
    model: HarmonicModel,
    x: Floats,
    seen: NDArray[np.bool_],
    *,
    length: int,
    output_every: int,
    startup: int,
    coupled: bool,
    tolerance: float,
) -> Estimate:
    """Smooth all channels of a record.

    Parameters
    ----------
    model : what is estimated.
    x : (channel, sample) array, NaN where missing.
    seen : (sample,) array, whether the sample is there, in all channels alike.
    length : samples in a block.
    output_every : samples between outputs.
    startup : first sample whose residual and innovation count in the statistics.
    coupled : whether orders that disturb one another are smoothed together; if not, each is smoothed on its own.
    tolerance : part of an amplitude that a neighbour may disturb without being coupled.
    """
    kept, member = _one_of_each(model) if coupled else (np.arange(model.orders.size), np.arange(model.orders.size))
    one_each = model if kept.size == member.size else model.subset(kept)
    grid = Grid(model=one_each, x=x, seen=seen, length=length, tolerance=tolerance, shared=np.bincount(member))
    levels, variances, log_variances = smooth_apart(grid, startup // length)
    bound = max(droop(model, length), scattered_share(seen, length))
    if coupled:
        closeness = Closeness(one_each, grid.samples)
        left = couple(grid, closeness, startup // length, levels, variances, log_variances)
        bound = inf if model.poles > 1 and closeness.dwell() else max(bound, tolerance, left)
    pieces = pieces_between(levels, cubic=model.poles > 1)
    mean_square, autocorrelation = _residuals(grid, pieces, variances.sum(axis=0), startup)
    if kept.size < member.size:
        levels, variances = _shared_out(grid, member, levels, variances)
        pieces = pieces_between(levels, cubic=model.poles > 1)
    outputs = ceil(grid.samples / output_every)
    amplitudes = np.empty((*levels.shape[:2], outputs), dtype=np.complex128)
    for channel, values in enumerate(amplitudes):
        _block_kernels.evaluate_complex(pieces[channel], length, output_every, values.view(np.float64))
    return BlockEstimate(
        amplitude=amplitudes,
        variance=variances,
        length=length,
        innovation_mean_square=mean_square,
        innovation_log_variance=float(log_variances.sum()) / max(int(np.count_nonzero(grid.seen[startup:])), 1),
        innovation_autocorrelation=autocorrelation,
        innovation_samples=min(RESIDUAL_SAMPLES, grid.samples - startup),
        error_bound=bound,
    )


def _one_of_each(model: HarmonicModel) -> tuple[Indices, Indices]:
    """Return one order of each set that is one and the same, and the place of each order's set among these.

    All that a record tells of such twins is their sum: a walk of its own, whose variances are theirs added up.
    """
    kept: list[int] = []
    named: dict[tuple[float, int], list[int]] = {}
    member = np.empty(model.orders.size, dtype=np.int64)
    for k, name in enumerate(zip(model.orders.tolist(), model.shaft.tolist(), strict=True)):
        known = named.setdefault(name, [])
        twin = [place for place in known if np.array_equal(model.bandwidth[k], model.bandwidth[kept[place]])]
        member[k] = twin[0] if twin else len(kept)
        if not twin:
            known.append(len(kept))
            kept.append(k)
    return np.array(kept), member


def _shared_out(grid: Grid, member: Indices, levels: Levels, variances: Floats) -> tuple[Levels, Floats]:
    """Give every twin its part of the sum, and the variance of what no data tell of it.

    Alike as they are, each is an even part of their sum and a rest that is independent of it.
    """
    count = grid.shared[member]
    shared = variances[member] / count[:, None] ** 2
    for k in np.flatnonzero(count > 1):
        shared[k] += (1 - 1 / count[k]) * grid.unseen_variance(member[k])
    return levels[:, member] / count[:, None], shared


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockEstimate(Estimate):
    """An estimate whose variances, (order, knot), are known at the first sample of every block and after the last.

    Attributes
    ----------
    length : samples in a block.
    """

    length: int

    @property
    def std_spacing(self) -> int:
        """Samples from one knot to the next: standard deviations are linear in between."""
        return self.length


def _residuals(grid: Grid, pieces: Floats, explained: Floats, startup: int) -> tuple[Floats, Floats]:
    """Mean square and autocorrelation of what the amplitudes leave of stretches of the record.

    Where the model holds, the variance of a residual is R less that of the fitted waveform, which is the sum of the
    variances of the amplitudes.

    Parameters
    ----------
    grid : the record.
    pieces : (channel, order, block, 2, 4) array.
    explained : (knot,) array, sum of the variances of all amplitudes where R = 1.
    startup : first sample that counts.

    Returns
    -------
    mean_square : (channel,) array, an estimate of R.
    autocorrelation : (channel, lag) array, at lags from one sample on.
    """
    channels, model = len(grid.x), grid.model
    length = min(RESIDUAL_SAMPLES // STRETCHES, grid.samples - startup)
    starts = np.unique(np.linspace(startup, grid.samples - length, STRETCHES).astype(np.int64))
    products, left = np.zeros((channels, LAGS + 1)), 0.0
    for start in starts:
        samples = slice(int(start), int(start) + length)
        seen = grid.seen[samples]
        knots = (np.arange(samples.start, samples.stop)[seen] / grid.length).round().astype(np.int64)
        left += float(np.sum(1 - explained[knots].clip(max=0.5)))
        phase = grid.model.phase(samples)
        for channel in range(channels):
            wave = np.zeros(length)
            _block_kernels.remodulate(
                pieces[channel], grid.length, phase, model.orders, model.shaft, samples.start, wave
            )
            rest = np.where(seen, grid.x[channel, samples] - wave, 0.0)
            for lag in range(min(LAGS + 1, length)):
                products[channel, lag] += rest[lag:] @ rest[: length - lag]
    power = products[:, :1]
    autocorrelation = np.divide(products[:, 1:], power, out=np.zeros((channels, LAGS)), where=power > 0)
    return power[:, 0] / max(left, 1.0), autocorrelation
