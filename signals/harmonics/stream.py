"""Track shaft orders of a record that arrives in blocks, in memory that does not grow with its length.

Without a lag this is the causal Kalman filter of `track_orders(..., estimator="filter", method="exact")`. With a lag it
is a fixed-lag smoother: once a segment of `lag` samples and a second one have arrived, both are smoothed as by
`track_orders(..., method="exact")`, given the information of all earlier samples, and the outputs of the first are
returned. Each uses `lag` to `2 lag` later samples; further ones would change it by some `std exp(-decay lag)`, with the
slowest decay in the smoother's response, `decay = sin(pi / (2 poles)) (sqrt(2) - 1)^(-1 / (2 poles)) pi bandwidth /
rate`: for one pole 4.9 bandwidth / rate, for four 1.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from signals._validation import whole
from signals.harmonics import _arguments
from signals.harmonics._information_smoother import Information, NodeChain, information_at_end, smooth_chain
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.block_grid import Grid, at_outputs
from signals.harmonics.block_smoother import exact_length
from signals.harmonics.coupling import by_order, chain_together
from signals.harmonics.innovations import Innovations, statistics
from signals.harmonics.kalman_filter import FilterState, filter_on
from signals.harmonics.separability import FlagArray, distances, flag_close, flag_gaps, output_range, unresolved_pairs
from signals.harmonics.state_space import PRIOR_STD, Flags, Floats, HarmonicModel, Indices, Order, Patterns, lost
from signals.harmonics.tracker import squeeze
from signals.harmonics.tracking_results import OrderTracks, UnresolvedPair

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

# Least number of segments, over which speeds are averaged, in one over the largest bandwidth.
SEGMENTS = 4
# Smallest bandwidth in cycles per sample for flags: below it, 1 / bandwidth overflows a count of samples.
NARROWEST = 2.0**-48


@dataclass(kw_only=True, eq=False)
class StreamFlags:
    """What the flags of later outputs need of the samples so far."""

    end: int  # sample at which the last whole segment ended
    phase: Floats  # (shaft,) angles in rad at that sample
    frequency: Floats  # (order,) means of that segment in cycles a sample
    flags: FlagArray  # (order,) of that segment
    # (order, order) arrays, filled above the diagonal: turns of one order relative to another so far, and samples in
    # which they were within half a bandwidth.
    turns: Floats
    together: Floats
    first_seen: float  # the first observed sample; infinite before it
    missing: Indices  # missing samples, as far back as later outputs depend on them

    @classmethod
    def begin(cls, model: HarmonicModel, *, shafts: int) -> StreamFlags:
        """Return the state before the first sample, with every shaft at rest."""
        orders = model.orders.size
        rest = np.zeros((orders, 1))
        flags = flag_close(np.full((orders, 1), orders > 1), model.orders, rest, model.bandwidth)[:, 0]
        return cls(
            end=0, phase=np.full(shafts, np.nan), frequency=rest[:, 0], flags=flags, turns=np.zeros((orders, orders)),
            together=np.zeros((orders, orders)), first_seen=np.inf, missing=np.empty(0, dtype=np.int64),
        )  # fmt: skip

    @property
    def unresolved(self) -> tuple[UnresolvedPair, ...]:
        """Pairs of orders not separable so far, and their share of the samples: 1 until they are a turn apart."""
        return unresolved_pairs(np.triu(np.where(self.turns < 1, 1.0, self.together / max(self.end, 1)), k=1))

    def update(
        self, model: HarmonicModel, outputs: Indices, phase: Floats, seen: Flags, first: int, count: int,
        lag: int | None,
    ) -> FlagArray:  # fmt: skip
        """Update with `count` samples, all where a stream with a lag has ended; return the (order, output) flags.

        Given are the sample numbers of the outputs, the (shaft, sample) angles and whether each sample is observed, of
        the samples from `first` on and of the later ones that the outputs depend on. A filter's `lag` is None.
        """
        if first == 0:
            self.phase = phase[:, 0].copy()
        stop, last = first + count, first + seen.size - 1
        length = max(1.0, 1 / (SEGMENTS * max(float(model.bandwidth.max()), NARROWEST)))
        length = 1 << int(np.log2(min(length, lag or length)))
        steady = np.arange(length * max(self.end // length, 1), last + 1, length)
        ends = np.append(1 << np.arange(length.bit_length() - 1), steady)
        ends = ends[(ends > self.end) & (ends <= last)]
        if lag is not None:
            ends = np.union1d(ends, last) if stop > last > self.end else ends
            ends = ends[: np.searchsorted(ends, stop) + 1]
        # A filter's output has the flags of the last segment that has ended by then, else of the first one after it.
        place = np.searchsorted(np.append(self.end, ends), outputs, side="right") - (lag is None)
        flags = self.flags[:, None]
        if ends.size:
            flags = np.concatenate([flags, self._update_segments(model, ends, phase[:, ends - first])], axis=1)
        self.flags, found = flags[:, -1].copy(), flags[:, np.minimum(place, flags.shape[1] - 1)]
        if seen.any():
            self.first_seen = min(self.first_seen, float(first + seen.argmax()))
        reach = output_range(np.maximum(model.bandwidth, NARROWEST))
        farthest = ceil(float(reach.max()))
        start = max(first - farthest, 0) if self.missing.size or not seen.all() else first
        if lag is not None or start < first or first < self.first_seen + farthest:
            window = np.concatenate([np.ones(first - start, dtype=np.bool_), seen])
            window[self.missing - start] = False
            flag_gaps(found, outputs - start, reach, window, first=self.first_seen - start, later=lag is not None)
        missing = np.concatenate([self.missing, first + np.flatnonzero(~seen[:count])])
        self.missing = missing[missing >= stop - farthest]
        return found

    def _update_segments(self, model: HarmonicModel, ends: Indices, phase: Floats) -> FlagArray:
        """Update with whole segments, given the (shaft, segment) angles at their ends; return their flags."""
        lengths = np.diff(ends, prepend=self.end).astype(np.float64)
        speed = np.diff(phase, prepend=self.phase[:, None]) / (2 * np.pi * lengths)
        frequency = np.concatenate([self.frequency[:, None], model.orders[:, None] * speed[model.shaft]], axis=1)
        close = np.zeros((len(frequency), ends.size), dtype=np.bool_)
        width = model.bandwidth[:, 0]
        for k in range(len(close) - 1):
            rest = slice(k + 1, None)
            distance = distances(frequency[k], frequency[rest], both_sides=False)[:, 1:]
            near = distance < np.maximum(width[k], width[rest])[:, None] / 2
            turns = self.turns[k, rest, None] + np.cumsum(distance * lengths, axis=1)
            self.together[k, rest] += near @ lengths
            self.turns[k, rest] = turns[:, -1]
            near_each = near | (turns < 1)
            close[k] |= near_each.any(axis=0)
            close[rest] |= near_each
        self.end, self.phase, self.frequency = int(ends[-1]), phase[:, -1].copy(), frequency[:, -1].copy()
        return flag_close(close, model.orders, frequency[:, 1:], model.bandwidth)


# (channel, order, output) amplitudes, (order, output) variances and flags.
Outputs = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]
AS_RETURNED = "pass what OrderTracker.state() returned, or what numpy.load made of it."


@dataclass
class Progress:
    """State of the estimator between two blocks; outputs of the first `state.count` samples are returned."""

    one_channel: bool  # blocks are (sample,) arrays
    last_phase: Floats  # (shaft,) angles in rad at the last sample
    x: Floats  # (channel, sample), samples received and not yet smoothed
    phase: Floats  # (shaft, sample) angles in rad of these
    known_matrix: Floats  # `Information` on the amplitudes at the first of them, from all samples before
    known_vector: Floats
    state: FilterState  # of the covariance filter there
    innovations: Innovations  # sums over those of the earlier samples
    flags: StreamFlags


class OrderTracker:
    """Kalman filter or fixed-lag smoother of shaft orders for a record that arrives in blocks.

    Parameters
    ----------
    orders
        Orders in cycles per revolution, one number each, or (shaft, order) pairs. Order 0 is the mean.
    noise_variance
        Variance R of the white noise in the record, in its unit squared.
    bandwidth_hz, bandwidth_orders
        Full -3 dB width of the smoother, one for all orders or one each: in Hz, with `rate_hz`, or in cycles per
        revolution, with `samples_per_rev`.
    rate_hz, samples_per_rev, poles, initial_std, output_every
        As for `track_orders`.
    lag
        None for the causal filter; else the least number of later samples that the smoother uses for an output.

    Examples
    --------
    A tone of amplitude 2 in two blocks; between them the state could be saved with `numpy.savez`:

    >>> import numpy as np
    >>> from signals.harmonics import OrderTracker
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 2 * np.cos(3 * phase_rad)
    >>> tracker = OrderTracker(orders=[3], noise_variance=0.01, bandwidth_hz=10, rate_hz=5000, output_every=1000)
    >>> first = tracker.update(x[:2500], phase_rad=phase_rad[:2500])
    >>> second = OrderTracker.from_state(tracker.state()).update(x[2500:], phase_rad=phase_rad[2500:])
    >>> print(second.sample_index, np.abs(second.complex_amplitude).round(3))
    [3000 4000] [[2. 2.]]
    """

    def __init__(
        self,
        *,
        orders: Sequence[Order] | NDArray[np.float64],
        noise_variance: float,
        bandwidth_hz: ArrayLike | None = None,
        bandwidth_orders: ArrayLike | None = None,
        rate_hz: float | None = None,
        samples_per_rev: float | None = None,
        poles: int = 1,
        initial_std: float | None = None,
        lag: int | None = None,
        output_every: int = 1,
    ) -> None:
        self._noise = _arguments.check_noise_variance(noise_variance)
        std = PRIOR_STD * np.sqrt(self._noise) if initial_std is None else initial_std
        pairs = [item for item in orders if isinstance(item, tuple | list) and item] if np.iterable(orders) else []
        # Zero angles, so that orders are checked before angles are known.
        rest = {pair[0]: [0.0] for pair in pairs if isinstance(pair[0], str)} or [0.0]
        numbers, self._names, shaft, _ = _arguments.check_orders(orders, rest, samples=1)
        self._orders = list(zip(self._names, numbers.tolist(), strict=True)) if self._names else numbers
        self._shafts = list(dict.fromkeys(self._names)) or [""]
        if bandwidth_orders is not None and rate_hz is not None and bandwidth_hz is None:
            raise ValueError(
                "bandwidth_orders with rate_hz: the speed of samples to come is not known; pass bandwidth_hz, or "
                "samples_per_rev for a record sampled in angle."
            )
        given = np.asarray(bandwidth_hz if bandwidth_orders is None else bandwidth_orders)
        if given.ndim > 1:
            raise ValueError(
                f"bandwidth of shape {given.shape}: a stream's does not vary in time; pass one number, or one an order."
            )
        self._width = _arguments.check_bandwidth(
            bandwidth_hz=bandwidth_hz, bandwidth_orders=bandwidth_orders, rate_hz=rate_hz,
            samples_per_rev=samples_per_rev, shaft=shaft, phases=(np.zeros(2),),
        )  # fmt: skip
        self._model = HarmonicModel(
            orders=numbers, shaft=shaft, phases=(), bandwidth=self._width.cycles,
            poles=whole(poles, name="poles", least=1, most=MOST_POLES),
            prior_std=_arguments.check_initial_std(std, noise=self._noise),
        )  # fmt: skip
        self._lag = None if lag is None else whole(lag, name="lag", least=1)
        self._every = whole(output_every, name="output_every", least=1)
        self._settings: dict[str, Any] = {
            "orders": numbers, "shafts": np.array(self._names, dtype=np.str_), "noise_variance": self._noise,
            f"bandwidth_{self._width.units}": self._width.given, "poles": self._model.poles, "initial_std": float(std),
            "lag": self._lag or 0, "output_every": self._every,
        }  # fmt: skip
        self._settings |= {"rate_hz": rate_hz} if self._width.units == "hz" else {"samples_per_rev": samples_per_rev}
        longest = 1 if self._lag is None else min(exact_length(self._model), self._lag)
        fitting = (length for length in range(longest, longest // 2, -1) if (self._lag or 1) % length == 0)
        self._block = next(fitting, longest)  # samples in a block of the smoother
        self._segment = self._block * ceil((self._lag or 1) / self._block)
        self._progress: Progress | None = None

    def update(self, x: ArrayLike, *, phase_rad: ArrayLike | Mapping[str, ArrayLike]) -> OrderTracks:
        """Update with the next samples and return the outputs that are due.

        Parameters
        ----------
        x : (sample,) array
            Or (channel, sample); as many channels in every block. NaN marks a missing sample, in all channels at once.
        phase_rad : (sample,) array
            Shaft angle in rad that continues that of the last block, or a mapping from shaft name to such an array.

        Returns
        -------
        OrderTracks
            `sample_index` counts from the start of the stream; innovations and `unresolved` pairs are those of all
            samples so far. Flags use mean speeds over segments of at most a quarter of 1 / bandwidth, in a filter of
            the last whole segment; orders are not separable until a turn apart. With a lag, the last later sample
            that an output uses counts as an end of the record.
        """
        block, phase = self._check_block(x, phase_rad)
        if self._progress is None:
            self._progress = self._begin(len(block), one_channel=np.ndim(x) == 1)
        now, found = self._progress, []
        now.last_phase = phase[:, -1].copy()
        if self._lag is None:
            return self._tracks(now, [self._filter(now, block, phase, block.shape[1])])
        for begin in range(0, block.shape[1], self._segment):
            # At most a segment at a time, so that fewer than three segments are ever stored.
            span = slice(begin, begin + self._segment)
            now.x, now.phase = (np.hstack(pair) for pair in ((now.x, block[:, span]), (now.phase, phase[:, span])))
            if now.x.shape[1] >= 2 * self._segment:
                found.append(self._smooth(now, self._segment, known=2 * self._segment))
        return self._tracks(now, found)

    def finish(self) -> OrderTracks:
        """Return the outputs still due when the stream has ended: with a lag, those of its last samples."""
        if self._progress is None:
            raise ValueError("finish() before any update(): the stream is empty; pass its samples to update() first.")
        now, waiting = self._progress, self._progress.x.shape[1]
        return self._tracks(now, [self._smooth(now, waiting, known=waiting)] if waiting else [])

    def state(self) -> dict[str, Any]:
        """Return the state of the stream as numbers, strings and arrays under plain names.

        `numpy.savez(path, **tracker.state())` saves it; `OrderTracker.from_state(numpy.load(path))` continues.
        """
        kept = {f"setting_{name}": value for name, value in self._settings.items()} | {"channels": 0}
        if self._progress is not None:
            kept["channels"] = len(self._progress.x)
            kept |= {key: np.copy(getattr(holder, name)) for holder, name, key in _numbers(self._progress)}
        return kept

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> OrderTracker:
        """Return a tracker that continues the stream of a saved `state()`."""
        settings: dict[str, Any] = {key[8:]: np.asarray(state[key])[()] for key in state if key.startswith("setting_")}
        missing = {"shafts", "orders", "noise_variance", "lag"} - set(settings)
        if missing:
            raise ValueError(f"state lacks {', '.join(f'setting_{name}' for name in sorted(missing))}: {AS_RETURNED}")
        shafts, orders, lag = (settings.pop(name).tolist() for name in ("shafts", "orders", "lag"))
        tracker = cls(orders=list(zip(shafts, orders, strict=True)) if shafts else orders, lag=lag or None, **settings)
        if channels := int(_array(state, "channels", ())):
            tracker._progress = tracker._begin(channels, one_channel=True)
            waiting = np.size(state.get("x", ())) // channels
            shapes = {"x": (channels, None), "phase": (len(tracker._shafts), waiting), "flags_missing": (None,)}
            for holder, name, key in _numbers(tracker._progress):
                like = np.asarray(getattr(holder, name))
                value = _array(state, key, shapes.get(key, like.shape)).astype(like.dtype)
                setattr(holder, name, value if value.ndim else value.item())
        return tracker

    def _begin(self, channels: int, *, one_channel: bool) -> Progress:
        """Return the state before the first sample."""
        model, shafts = self._model, len(self._shafts)
        known = Information.prior(model.prior_variance(step=self._block), channels)
        return Progress(
            one_channel=one_channel, last_phase=np.full(shafts, np.nan), x=np.empty((channels, 0)),
            phase=np.empty((shafts, 0)), known_matrix=known.matrix, known_vector=known.vector,
            state=FilterState.prior(model, channels=channels), innovations=Innovations.none(channels=channels),
            flags=StreamFlags.begin(model, shafts=shafts),
        )  # fmt: skip

    def _check_block(self, x: ArrayLike, phase_rad: ArrayLike | Mapping[str, ArrayLike]) -> tuple[Floats, Floats]:
        """Return (channel, sample) and (shaft, sample) arrays that continue the last block, or refuse them."""
        block, now = _arguments.check_record(x), self._progress
        if now is not None and (len(block) != len(now.x) or (np.ndim(x) == 1) != now.one_channel):
            began = "one plain channel" if now.one_channel else f"{len(now.x)} channels"
            raise ValueError(
                f"x has shape {np.shape(x)}, but the stream began with {began}; pass blocks of the same channels."
            )
        missing = np.isnan(block)
        if not (missing == missing[0]).all():
            raise ValueError(
                "x misses different samples in different channels; a stream's channels share one covariance: mark a "
                "sample missing in all of them, or use one OrderTracker for each."
            )
        *_, angles = _arguments.check_orders(self._orders, phase_rad, samples=block.shape[1])
        last_phase = np.full(len(angles), np.nan) if now is None else now.last_phase
        for number, (name, last) in enumerate(zip(self._shafts, last_phase.tolist(), strict=True)):
            highest, jump = self._model.orders[self._model.shaft == number].max(), angles[number][0] - last
            if highest * abs(jump) > _arguments.MOST_TURN:
                raise ValueError(
                    f"{f'phase_rad[{name!r}]' if name else 'phase_rad'} jumps by {jump:.4g} rad from the last block to "
                    f"this one, order {highest:g} by more than pi; go on from the last block's angle, {last:.6g} rad."
                )
        return block, np.stack(angles)

    def _filter(self, now: Progress, x: Floats, phase: Floats, samples: int) -> Outputs:
        """Filter the first of these samples; later ones, where given, count for the flags alone."""
        model, first = self._model, now.state.count
        outputs = np.arange(first + -first % self._every, first + samples, self._every)
        amplitude, variances = filter_on(
            replace(model, phases=tuple(phase[:, :samples])), x[:, :samples], now.state, now.innovations,
            output_every=self._every, startup=ceil(1 / float(model.bandwidth.min())) + model.state_size,
        )  # fmt: skip
        flags = now.flags.update(model, outputs, phase, ~np.isnan(x[0]), first, samples, self._lag)
        return amplitude, variances, flags

    def _smooth(self, now: Progress, samples: int, *, known: int) -> Outputs:
        """Smooth the first of the stored samples, using the first `known` of them, and drop the smoothed ones."""
        model, size, skip = self._model, self._model.orders.size, -now.state.count % self._every

        def chain(stop: int) -> tuple[Grid, NodeChain]:
            """Return the stored samples up to `stop` in blocks, and their chain."""
            x, phases = now.x[:, :stop], tuple(now.phase[:, :stop])
            grid = Grid(model=replace(model, phases=phases), x=x, seen=~np.isnan(x[0]), length=self._block)
            before = Information(now.known_matrix, now.known_vector).copy()
            return grid, chain_together(grid, np.arange(size), slice(0, grid.nodes), None, (before, before.none()))

        grid, nodes = chain(known)
        try:
            smoothed = smooth_chain(nodes, first=0)
        except np.linalg.LinAlgError as error:
            raise lost(model, "exact") from error
        levels, variances = by_order(model, smoothed)
        amplitude = at_outputs(levels, grid, every=self._every, skip=skip, samples=samples)
        outputs, places = np.arange(skip, samples, self._every), self._block * np.arange(grid.nodes)
        variance = np.stack([np.interp(outputs, places, std) ** 2 for std in np.sqrt(variances)])
        if samples < known:
            now.known_matrix, now.known_vector = information_at_end(chain(samples)[1])
        *_, flags = self._filter(now, now.x[:, :known], now.phase[:, :known], samples)
        now.x, now.phase = now.x[:, samples:].copy(), now.phase[:, samples:].copy()
        return amplitude, variance, flags

    def _tracks(self, now: Progress, parts: list[Outputs]) -> OrderTracks:
        """Return the tracks of some parts of outputs, which end with the last output so far."""
        model, sums, channels = self._model, now.innovations, len(now.x)
        none = np.empty((model.orders.size, 0))
        nothing = (np.empty((channels, model.orders.size, 0), dtype=np.complex128), none, none.astype(np.uint8))
        amplitude, variance, flags = (np.concatenate(part, axis=-1) for part in zip(nothing, *parts, strict=True))
        patterns = Patterns(record=now.x, seen=[], of_channel=np.zeros(channels, dtype=np.int64))
        found = statistics(patterns, [sums.estimate(amplitude, variance)], self._noise) | {
            "complex_amplitude": amplitude
        }
        found |= {"settling_variance": patterns.shared([variance]), "flags": patterns.shared([flags])}
        return OrderTracks(
            **{name: squeeze(value, now.one_channel) for name, value in found.items()},
            unresolved=now.flags.unresolved, orders=model.orders, shafts=self._names, bandwidth=self._width.given,
            bandwidth_units=self._width.units, bandwidth_cycles=self._width.cycles[:, 0], poles=model.poles,
            estimator="filter" if self._lag is None else "smoother", method="exact", error_bound=0.0,
            samples=now.state.count, output_every=self._every,
            first_output=self._every * (-(-now.state.count // self._every) - amplitude.shape[-1]),
        )  # fmt: skip


def _numbers(holder: object, prefix: str = "") -> Iterator[tuple[object, str, str]]:
    """Yield the object, attribute name and key of every number and array in a state."""
    for name, value in list(vars(holder).items()):
        if isinstance(value, int | float | np.ndarray):
            yield holder, name, prefix + name
        elif value is not None:
            yield from _numbers(value, f"{prefix}{name}_")


def _array(state: Mapping[str, Any], key: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return a copy of an array of numbers in a state, or refuse one of another shape; None stands for any length."""
    if key not in state:
        raise ValueError(f"state lacks {key!r}: {AS_RETURNED}")
    value = np.array(state[key])
    fits = value.ndim == len(shape) and all(n in (None, m) for m, n in zip(value.shape, shape, strict=True))
    if not fits or value.dtype.kind not in "biuf":
        needed = str(tuple("any" if n is None else n for n in shape)).replace("'", "")
        raise ValueError(
            f"state[{key!r}] has shape {value.shape} and type {value.dtype}; needed numbers of shape {needed}: "
            f"{AS_RETURNED}"
        )
    return value
