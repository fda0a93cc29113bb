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

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import ceil, log, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from signals.harmonics import _block_kernels
from signals.harmonics._information import KnotChain, smooth_knots
from signals.harmonics.bandwidth import HALF_POWER, Bandwidth
from signals.harmonics.model import LAGS, Estimate, Floats, HarmonicModel
from signals.harmonics.separability import Closeness

Indices = NDArray[np.int64]

FEWEST_BLOCKS = 64
# A one-pole walk moves as much within a block as a block's own noise tells: measured, at this part of 1 / bandwidth
# the estimates lie a hundredth of `std` from the exact ones.
LONGEST_ONE_POLE = 1 / 200
# A hat of which less than this is there tells nothing of an order on its own.
SMALLEST_SHARE = 0.6
# Orders smoothed together near ends and gaps, at most, where nearly all disturb one another a little.
MOST_AT_ENDS = 12
# A cut through the record is forgotten by a factor e in a memory: to a few per cent in so many. Of what leaks in
# at an end, which is little, that is enough for a tolerance of 1e-3; a smaller one takes more.
MEMORIES = 3
SAMPLES_AT_ONCE = 1 << 16
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
    grid = _Grid(model=model, x=x, seen=seen, length=length, tolerance=tolerance)
    levels, variances, log_variances = _apart(grid, startup // length)
    if coupled:
        _couple(grid, startup // length, levels, variances, log_variances)
    pieces = pieces_between(levels, cubic=model.poles > 1)
    mean_square, autocorrelation = _residuals(grid, pieces, variances.sum(axis=0), startup)
    outputs = ceil(grid.samples / output_every)
    amplitudes = np.empty((*levels.shape[:2], outputs), dtype=np.complex128)
    _evaluate(pieces, length, output_every, amplitudes.view(np.float64).reshape(*amplitudes.shape, 2))
    spread = np.empty((len(variances), outputs, 1))
    _evaluate(pieces_between(variances, cubic=False), length, output_every, spread)
    return Estimate(
        amplitude=amplitudes,
        variance=spread[..., 0],
        innovation_mean_square=mean_square,
        innovation_log_variance=float(log_variances.sum()) / np.count_nonzero(grid.seen[startup:]),
        innovation_autocorrelation=autocorrelation,
        innovation_samples=min(RESIDUAL_SAMPLES, grid.samples - startup),
        error_bound=max(droop(model, length), tolerance) if coupled else droop(model, length),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """A record in blocks: knots at the first sample of each, and one after the last.

    Attributes
    ----------
    model : what is estimated.
    x : (channel, sample) array, NaN where missing.
    seen : (sample,) array, whether the sample is there.
    length : samples in a block.
    tolerance : part of an amplitude that a neighbour may disturb without being coupled.
    """

    model: HarmonicModel
    x: Floats
    seen: NDArray[np.bool_]
    length: int
    tolerance: float

    @property
    def samples(self) -> int:
        return int(self.x.shape[1])

    @property
    def blocks(self) -> int:
        return -(-self.samples // self.length)

    @property
    def knots(self) -> int:
        return self.blocks + 1

    @property
    def reach(self) -> int:
        """Knots over which ends and gaps are felt: the slowest root of the smoother's response tells how far."""
        poles, narrowest = self.model.poles, float(self.model.bandwidth.max(axis=1).min())
        decay = pi * narrowest * HALF_POWER ** (-0.5 / poles) * sin(0.5 * pi / poles)
        memories = MEMORIES + max(0.0, log(1e-3 / self.tolerance))
        return max(1, int(memories / (decay * self.length)) + 1)

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

    def walk_variance(self, orders: Indices) -> Floats:
        """(knot or 1, column) array for some orders: the walk takes one step a knot."""
        return self.model.subset(orders).walk_variance(slice(0, None, self.length), step=self.length)

    def prior_variance(self, orders: Indices) -> Floats:
        return self.model.subset(orders).prior_variance(step=self.length)

    @cached_property
    def data(self) -> Floats:
        """(order, knot, channel, 2) array, sums under the hats of the record times cos and -sin."""
        sums = np.empty((self.model.orders.size, self.blocks, len(self.x), 4))
        for samples, blocks in self.spans(0, self.blocks):
            x = self.x[:, samples] if self.seen[samples].all() else np.nan_to_num(self.x[:, samples])
            part = np.empty((len(sums), blocks.stop - blocks.start, *sums.shape[2:]))
            plan, phase = self.model.plan, self.model.phase(samples)
            _block_kernels.project(np.ascontiguousarray(x), phase, plan.recipe, plan.row, self.length, part)
            sums[:, blocks] = part
        return at_knots(sums.reshape(*sums.shape[:3], 2, 2).transpose(4, 1, 0, 2, 3)).transpose(1, 0, 2, 3)

    def gram(self, orders: Indices, knots: slice) -> Floats:
        """(knot, column, column) array, sums under the hats of products of the columns of some orders."""
        first, last = max(knots.start - 1, 0), min(knots.stop, self.blocks)
        sums = np.empty((last - first, 2, 2 * orders.size, 2 * orders.size))
        plan = self.model.subset(orders).plan
        for samples, blocks in self.spans(first, last):
            seen = self.seen[samples].astype(np.float64)
            phase = self.model.phase(samples)
            part = sums[blocks.start - first : blocks.stop - first]
            _block_kernels.correlate(seen, phase, plan.recipe, plan.row, self.length, part)
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


def _apart(grid: _Grid, first: int) -> tuple[NDArray[np.complex128], Floats, Floats]:
    """Smooth every order as if it were alone.

    Returns
    -------
    levels : (channel, order, knot) array.
    variances : (order, knot) array.
    log_variances : (order,) array, sums of the log variances of the innovations from knot `first` on.
    """
    model, data = grid.model, grid.data
    weight, offset = grid.weights
    # A hat cut short lets images through: those over the record's ends are left out.
    weight = np.where(weight < SMALLEST_SHARE * grid.length, 0.0, weight)
    weight[0] = weight[grid.samples // grid.length :] = 0.0
    data = data * (weight > 0)[:, None, None]
    knots, channels = data.shape[1:3]
    levels = np.zeros((channels, model.orders.size, knots), dtype=np.complex128)
    variances, log_variances = np.empty((model.orders.size, knots)), np.empty(model.orders.size)
    for group in _alike(model):
        turning = bool(model.orders[group[0]])
        parts = 2 if turning else 1
        lanes = data[group][..., :parts].transpose(1, 0, 2, 3).reshape(knots, 1, -1)
        chain = KnotChain(
            gram=(weight / parts)[:, None, None],
            data=np.ascontiguousarray(lanes),
            offset=offset,
            walk_variance=grid.walk_variance(group[:1])[:, :1].copy(),
            prior_variance=grid.prior_variance(group[:1])[:, :1].copy(),
        )
        found, variance, log_variance = smooth_knots(chain, first=first)
        found = found.reshape(knots, group.size, channels, parts).transpose(2, 1, 0, 3)
        levels[:, group] = found[..., 0] + (1j * found[..., 1] if turning else 0.0)
        variances[group] = variance[:, 0]
        log_variances[group] = parts * log_variance
    return levels, variances, log_variances


def _alike(model: HarmonicModel) -> list[Indices]:
    """Return the groups of orders that share a walk: the same bandwidth, and all or none of them the mean."""
    keys = np.column_stack([model.orders != 0, model.bandwidth])
    _, member = np.unique(keys, axis=0, return_inverse=True)
    return [np.flatnonzero(member.ravel() == number) for number in range(member.max() + 1)]


def _couple(
    grid: _Grid,
    first: int,
    levels: NDArray[np.complex128],
    variances: Floats,
    log_variances: Floats,
) -> None:
    """Smooth together, in place, what the estimates of `_apart` show to disturb one another.

    In the midst of a record, a smoother leaves of its neighbours what its response lets through. Where the record
    ends or has a gap it leaves more, as much as the causal filter would: there more orders are smoothed together.
    """
    amplitude = np.sqrt(np.mean(np.abs(levels) ** 2, axis=(0, 2)))
    closeness = Closeness(grid.model, grid.samples)

    def inside(bandwidth: Bandwidth, distance: Floats) -> Floats:
        return bandwidth.smoother_gain(distance)

    def near_ends(bandwidth: Bandwidth, distance: Floats) -> Floats:
        return np.asarray(np.abs(bandwidth.filter_gain(distance)))

    everywhere = slice(0, grid.knots)
    settled: list[set[int]] = []
    for group in closeness.coupled(inside, amplitude, grid.tolerance):
        levels[:, group], variances[group], log_variances[group] = _together(grid, group, everywhere, first)
        settled.append(set(group.tolist()))
    disturbed = _disturbed(grid)
    groups = closeness.coupled(near_ends, amplitude, grid.tolerance)
    alone = set(range(grid.model.orders.size)) - {int(order) for friends in groups for order in friends}
    for friends in [*groups, *(np.array([order]) for order in sorted(alone))]:
        by_frequency = friends[np.argsort(np.abs(closeness.frequency[friends]).mean(axis=1))]
        for start in range(0, friends.size, MOST_AT_ENDS):
            group = np.sort(by_frequency[start : start + MOST_AT_ENDS])
            if not any(set(group.tolist()) <= known for known in settled):
                _mend(grid, group, disturbed, levels, variances)


def _disturbed(grid: _Grid) -> NDArray[np.bool_]:
    """(knot,) array: whether ends of the record, or samples missing, are felt there."""
    missing = grid.length - grid.weights[0]
    missing[0] = missing[grid.samples // grid.length :] = grid.length
    reach = grid.reach
    before = np.concatenate([[0.0], np.cumsum(missing)])
    place = np.arange(grid.knots)
    near = before[np.minimum(place + reach + 1, grid.knots)] - before[np.maximum(place - reach, 0)]
    return np.asarray(near > grid.tolerance * reach * grid.length)


def _mend(
    grid: _Grid,
    group: Indices,
    disturbed: NDArray[np.bool_],
    levels: NDArray[np.complex128],
    variances: Floats,
) -> None:
    """Smooth a group together, in place, where ends and gaps are felt and as far again, to forget the cut."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], disturbed, [False]])))
    runs = [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
    margin = grid.reach
    joined: list[tuple[int, int]] = []
    for start, stop in runs:
        if joined and start - joined[-1][1] <= 2 * margin:
            joined[-1] = (joined[-1][0], stop)
        else:
            joined.append((start, stop))
    for start, stop in joined:
        first, last = max(start - margin, 0), min(stop + margin, grid.knots)
        found, variance, _ = _together(grid, group, slice(first, last), 0)
        kept = slice(start - first, stop - first)
        levels[:, group, start:stop] = found[..., kept]
        variances[group, start:stop] = variance[:, kept]


def _together(grid: _Grid, group: Indices, knots: slice, first: int) -> tuple[NDArray[np.complex128], Floats, Floats]:
    """Smooth a group of orders jointly: as `_apart`, with the log variance shared out evenly."""
    model = grid.model.subset(group)
    data = grid.data[group, knots].transpose(1, 3, 0, 2)  # knot, part, order, channel
    walk = grid.walk_variance(group)
    chain = KnotChain(
        gram=grid.gram(group, knots),
        data=np.concatenate([data[:, 0], data[:, 1, model.turning]], axis=1),
        offset=grid.weights[1][knots],
        walk_variance=walk if len(walk) == 1 else walk[knots],
        prior_variance=grid.prior_variance(group),
    )
    found, variance, log_variance = smooth_knots(chain, first=first)
    levels = np.stack([model.amplitude(found[:, :, channel]) for channel in range(data.shape[3])])
    return levels, model.variance(variance), np.full(group.size, log_variance / group.size)


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


def _evaluate(pieces: Floats, length: int, every: int, values: Floats) -> None:
    lines = pieces.reshape(-1, *pieces.shape[-3:])
    _block_kernels.evaluate(lines, length, every, values.reshape(len(lines), *values.shape[-2:]))


def _residuals(grid: _Grid, pieces: Floats, explained: Floats, startup: int) -> tuple[Floats, Floats]:
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
    channels, plan = len(grid.x), grid.model.plan
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
            _block_kernels.remodulate(pieces[channel], grid.length, phase, plan.recipe, plan.row, samples.start, wave)
            rest = np.where(seen, grid.x[channel, samples] - wave, 0.0)
            for lag in range(min(LAGS + 1, length)):
                products[channel, lag] += rest[lag:] @ rest[: length - lag]
    power = products[:, :1]
    autocorrelation = np.divide(products[:, 1:], power, out=np.zeros((channels, LAGS)), where=power > 0)
    return power[:, 0] / left, autocorrelation
