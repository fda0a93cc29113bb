"""The fast smoother: the record condensed to a grid of knots, and smoothed there.

Between knots an amplitude is taken for a polynomial of as many terms as its walk has poles (one pole: for steady under
a hat over two blocks). What the samples of a block say of it is a few moments, sums of them times powers of their
place (see `_block_kernels`), and what a Kalman chain over the knots needs to know. So a walk that grows without bound,
as several poles let it, is followed as well as one that stands still. The error is of second order in (bandwidth times
block): at the edge of the band (pi bandwidth block)^2 / 12 of an envelope, and what moves within a block leaks into
other orders only by that much, since the spectrum of what a knot weighs has double zeros where images fold. Between
knots the result is cubic (linear for one pole, whose envelopes have no slope).

Orders that do not disturb one another share small chains; those that do are smoothed together, with the moments of
their products. See `docs/trackers.md`.
"""

from dataclasses import dataclass
from math import ceil, inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from signals._memory import room
from signals.harmonics import _block_kernels
from signals.harmonics.coupling import couple
from signals.harmonics.grid import Grid, pieces_between
from signals.harmonics.model import LAGS, Estimate, Floats, HarmonicModel, Indices
from signals.harmonics.separability import Closeness
from signals.harmonics.smoothing import Levels, Smoothed, smooth_apart

FEWEST_BLOCKS = 64
# A one-pole walk moves as much within a block as a block's own noise tells: measured, at this part of 1 / bandwidth
# the estimates lie a hundredth of `std` from the exact ones.
LONGEST_ONE_POLE = 1 / 200
# Samples whose residuals are summed up, in evenly spread stretches: enough to tell the noise variance to 0.6 %.
RESIDUAL_SAMPLES = 1 << 16
STRETCHES = 16
# Variances change over blocks, if so fast: one sample in so many stands for the others.
SPARSE = 16
# Neighbours that leak more are coupled, whatever tolerance is given: to take more of them out later costs more.
LARGEST_LEAK = 1e-3
# Where a tolerance of the largest amplitude is more than this part of a standard deviation, orders are kept out of one
# another by what they are found to be.
SMALL_PART = 0.3


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
    """Say whether lines stay so close that blocks may not have the digits to tell them apart.

    Those within half a bandwidth of each other differ in little but what amplitudes with slopes may do, too.
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
    tolerance : part of an amplitude that a neighbour may disturb without being coupled, `LARGEST_LEAK` at the most.
    """
    tolerance = min(tolerance, LARGEST_LEAK)
    kept, member = _one_of_each(model) if coupled else (np.arange(model.orders.size), np.arange(model.orders.size))
    one_each = model if kept.size == member.size else model.subset(kept)
    grid = Grid(model=one_each, x=x, seen=seen, length=length, tolerance=tolerance, shared=np.bincount(member))
    smoothed = smooth_apart(grid, startup // length)
    bound = max(droop(model, length), scattered_share(seen, length))
    coupling = None
    if coupled:
        closeness = Closeness(one_each, grid.samples)
        coupling = couple(grid, closeness, smoothed)
        bound = max(bound, tolerance, coupling.left if coupling else 0.0)
        if coupling and model.poles > 1 and closeness.dwell():
            bound = inf  # what others leave in their difference does not fade in a memory
    pieces, residuals = _explained(grid, smoothed, startup)
    if coupling and _towers(smoothed, residuals[0], tolerance):
        coupling.mend_all(smoothed)
        pieces, residuals = _explained(grid, smoothed, startup)
    mean_square, autocorrelation, counted = residuals
    observed = int(np.count_nonzero(grid.seen[startup:]))
    levels, variances = smoothed.levels, smoothed.variances
    if kept.size < member.size:
        levels, variances = _shared_out(grid, member, levels, variances)
        pieces = pieces_between(levels, cubic=model.poles > 1)
    amplitudes = room(*levels.shape[:2], 2 * ceil(grid.samples / output_every)).view(np.complex128)
    for channel, values in enumerate(amplitudes):
        _block_kernels.evaluate_complex(pieces[channel], length, output_every, values.view(np.float64))
    return BlockEstimate(
        amplitude=amplitudes,
        variance=variances,
        length=length,
        innovation_mean_square=mean_square,
        innovation_log_variance=float(smoothed.log_variances.sum()) / max(observed, 1),
        innovation_autocorrelation=autocorrelation,
        innovation_samples=min(counted, observed),
        error_bound=bound,
    )


def _explained(grid: Grid, smoothed: Smoothed, startup: int) -> tuple[Floats, tuple[Floats, Floats, int]]:
    """Return amplitudes between the knots, and what `_residuals` makes of them."""
    pieces = pieces_between(smoothed.levels, cubic=grid.model.poles > 1)
    return pieces, _residuals(grid, pieces, smoothed.variances.sum(axis=0), startup)


def _towers(smoothed: Smoothed, noise: Floats, tolerance: float) -> bool:
    """Say whether a tolerance of the largest amplitude is more than a small part of the least standard deviation."""
    std = np.sqrt(smoothed.variances.min() * noise)
    largest = np.abs(smoothed.levels).max(axis=(1, 2))
    return bool(np.any(tolerance * largest > SMALL_PART * std))


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


def _residuals(grid: Grid, pieces: Floats, explained: Floats, startup: int) -> tuple[Floats, Floats, int]:
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
    counted : how many residuals; more than samples where stretches overlap.
    """
    channels, model = len(grid.x), grid.model
    length = min(RESIDUAL_SAMPLES // STRETCHES, grid.samples - startup)
    starts = np.unique(np.linspace(startup, grid.samples - length, STRETCHES).astype(np.int64))
    products, left, counted = np.zeros((channels, LAGS + 1)), 0.0, 0
    for start in starts:
        samples = slice(int(start), int(start) + length)
        seen = grid.seen[samples]
        there = np.flatnonzero(seen)
        counted += there.size
        knots = ((samples.start + there[::SPARSE]) / grid.length).round().astype(np.int64)
        left += there.size * float(np.mean(1 - explained[knots].clip(max=0.5))) if there.size else 0.0
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
    return power[:, 0] / max(left, 1.0), autocorrelation, counted
