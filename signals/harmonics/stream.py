"""Shaft harmonics tracked while the record comes in, block by block, in memory that does not grow.

Without a lag this is the causal Kalman filter of `track_orders(..., estimator="filter", method="exact")`. With one,
outputs come late and smoothed: samples are gathered in segments of `lag`; as soon as a segment is followed by a whole
second one, both are smoothed as `track_orders(..., method="exact")` does it, given the information of all samples
before them [1]_, and the outputs of the first are given. Each uses `lag` to `2 lag` later samples. What the smoother of
the whole record takes from beyond them moves it by some `std exp(-decay lag)`, with the slowest decay in the smoother's
response, `decay = sin(pi / (2 poles)) (sqrt(2) - 1)^(-1 / (2 poles)) pi bandwidth / rate`: for one pole 4.9 bandwidth /
rate, for four 1.3.

References
----------
.. [1] D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters",
   IEEE Trans. Automatic Control 14, 1969.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import whole
from signals.harmonics._information_smoother import Information, NodeChain, carry, smooth_chain
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.blocks import exact_length
from signals.harmonics.grid import Grid, at_outputs
from signals.harmonics.innovations import Innovations, statistics
from signals.harmonics.inputs import (
    MOST_TURN,
    check_bandwidth,
    check_initial_std,
    check_noise_variance,
    check_orders,
    check_record,
)
from signals.harmonics.kalman_filter import FilterState, filter_on
from signals.harmonics.model import PRIOR_STD, Estimate, Floats, HarmonicModel, Order, lost
from signals.harmonics.patterns import Patterns
from signals.harmonics.smoothing import chain_together
from signals.harmonics.stream_flags import StreamFlags
from signals.harmonics.tracker import squeeze
from signals.harmonics.tracks import OrderTracks

# (channel, order, output) amplitudes, (order, output) variances and flags.
Outputs = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]
_Part = TypeVar("_Part")


@dataclass
class Progress:
    """State of the estimator between two blocks; outputs have been given of the first `state.count` samples.

    Attributes
    ----------
    one_channel : whether blocks are (sample,) arrays.
    last_phase : (shaft,) array, angles in rad at the last sample.
    x, phase : (channel, sample) and (shaft, sample) arrays of the samples that wait for the smoother.
    known : information on the amplitudes at the first of these from all samples before.
    state : of the covariance filter there.
    innovations : sums over those of the samples before.
    flags : state of the flags.
    """

    one_channel: bool
    last_phase: Floats
    x: Floats
    phase: Floats
    known: Information
    state: FilterState
    innovations: Innovations
    flags: StreamFlags


class OrderTracker:
    """Complex amplitudes of shaft harmonics from a record that comes in block by block.

    Parameters
    ----------
    orders : cycles per revolution, one number an order, or (shaft, order) pairs. 0 is the mean.
    noise_variance : variance R of the white noise in the record, signal units squared.
    bandwidth_hz : full -3 dB width of the smoother in Hz, one for all orders or one each; with `rate_hz`.
    bandwidth_orders : the same in cycles per revolution; with `samples_per_rev`.
    rate_hz : samples per second.
    samples_per_rev : samples per revolution, for a record sampled in angle.
    poles : 1 to 4, how many times the amplitudes' random walk is integrated.
    initial_std : standard deviation of each part of an amplitude before the first sample, in the unit of the record.
        Default 1000 standard deviations of the noise.
    lag : None for a causal filter; else samples that each output waits for at least, to be smoothed with them.
    output_every : samples from one output to the next.

    Raises
    ------
    ValueError
        An input makes no sense; the sentence says which and what to do.
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
        self._noise = check_noise_variance(noise_variance)
        std = PRIOR_STD * np.sqrt(self._noise) if initial_std is None else initial_std
        numbers, self._names, shaft, _ = check_orders(orders, _at_rest(orders), samples=1)
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
        self._width = check_bandwidth(
            bandwidth_hz=bandwidth_hz,
            bandwidth_orders=bandwidth_orders,
            rate_hz=rate_hz,
            samples_per_rev=samples_per_rev,
            shaft=shaft,
            phases=(np.zeros(2),),
        )
        self._model = HarmonicModel(
            orders=numbers,
            shaft=shaft,
            phases=(),
            bandwidth=self._width.cycles,
            poles=whole(poles, name="poles", least=1, most=MOST_POLES),
            prior_std=check_initial_std(std, noise=self._noise),
        )
        self._lag = None if lag is None else whole(lag, name="lag", least=1)
        self._every = whole(output_every, name="output_every", least=1)
        self._settings: dict[str, Any] = {
            "orders": numbers,
            "shafts": np.array(self._names, dtype=np.str_),
            "noise_variance": self._noise,
            f"bandwidth_{self._width.units}": self._width.given,
            "poles": self._model.poles,
            "initial_std": float(std),
            "lag": self._lag or 0,
            "output_every": self._every,
        }
        self._settings |= {"rate_hz": rate_hz} if self._width.units == "hz" else {"samples_per_rev": samples_per_rev}
        self._block = 1  # samples in a block of the smoother; the segment of a lag is a whole number of these
        if self._lag is not None:
            longest = min(exact_length(self._model), self._lag)
            fitting = (length for length in range(longest, longest // 2, -1) if self._lag % length == 0)
            self._block = next(fitting, longest)
        self._segment = self._block * ceil((self._lag or 1) / self._block)
        self._progress: Progress | None = None

    def update(self, x: ArrayLike, *, phase_rad: ArrayLike | Mapping[str, ArrayLike]) -> OrderTracks:
        """Take the next samples in and return the outputs that are due.

        Parameters
        ----------
        x : (sample,) array, or (channel, sample); as many channels in every block. NaN marks a missing sample, in all
            channels at once.
        phase_rad : (sample,) array, shaft angle in rad, going on from the last block, or a mapping from shaft name to
            such an array.

        Returns
        -------
        OrderTracks
            `sample_index` counts from the start of the stream; what it says of the innovations and the pairs that are
            `unresolved` is of all samples so far. Flags are those that can be given at the time: speeds are means over
            stretches of a quarter of 1 / bandwidth at the most, of which a filter knows the last whole one, and lines
            are not separable while they have not parted by a turn. With a lag, the last sample that an output has
            waited for is an end.
        """
        block, phase = self._check_block(x, phase_rad)
        if self._progress is None:
            self._progress = self._begin(len(block), one_channel=np.ndim(x) == 1)
        now, first = self._progress, self._progress.state.count
        now.last_phase = phase[:, -1].copy()
        if self._lag is None:
            return self._tracks(now, first, [self._filter(now, block, phase, block.shape[1])])
        found = []
        for begin in range(0, block.shape[1], self._segment):
            # No more than a segment at a time, so that what waits stays below three.
            span = slice(begin, begin + self._segment)
            now.x, now.phase = (np.hstack(pair) for pair in ((now.x, block[:, span]), (now.phase, phase[:, span])))
            if now.x.shape[1] >= 2 * self._segment:
                found.append(self._smooth(now, self._segment, known=2 * self._segment))
        return self._tracks(now, first, found)

    def finish(self) -> OrderTracks:
        """Return the outputs that a lag still keeps back: the stream has ended."""
        if self._progress is None:
            raise ValueError("finish() before any update(): the stream is empty; pass its samples to update() first.")
        now, waiting = self._progress, self._progress.x.shape[1]
        return self._tracks(now, now.state.count, [self._smooth(now, waiting, known=waiting)] if waiting else [])

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on later: numbers, strings and arrays under plain names.

        `numpy.savez(path, **tracker.state())` keeps it; `OrderTracker.from_state(numpy.load(path))` goes on from there.
        """
        settings = {f"setting_{name}": value for name, value in self._settings.items()}
        if self._progress is None:
            return settings | {"channels": 0}
        return settings | {"channels": len(self._progress.x)} | _flat(self._progress)

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> "OrderTracker":
        """Return the tracker whose `state()` this was."""
        settings = {key[8:]: np.asarray(state[key]) for key in state if key.startswith("setting_")}
        missing = {"shafts", "orders", "noise_variance", "lag"} - set(settings)
        if missing:
            raise ValueError(
                f"state lacks {', '.join(f'setting_{name}' for name in sorted(missing))}: pass what "
                "OrderTracker.state() returned, or what numpy.load made of it."
            )
        shafts, orders = settings.pop("shafts").tolist(), settings.pop("orders").tolist()
        plain: dict[str, Any] = {key: value if value.ndim else value.item() for key, value in settings.items()}
        plain["lag"] = plain["lag"] or None
        tracker = cls(orders=list(zip(shafts, orders, strict=True)) if shafts else orders, **plain)
        if channels := int(_array(state, "channels", ())):
            waiting = np.size(state.get("x", ())) // channels
            lengths = {"x": (channels, None), "phase": (len(tracker._shafts), waiting), "flags_missing": (None,)}
            tracker._progress = _restored(tracker._begin(channels, one_channel=True), state, lengths)
        return tracker

    def _begin(self, channels: int, *, one_channel: bool) -> Progress:
        """Return the state before the first sample."""
        model, shafts = self._model, len(self._shafts)
        return Progress(
            one_channel=one_channel,
            last_phase=np.full(shafts, np.nan),
            x=np.empty((channels, 0)),
            phase=np.empty((shafts, 0)),
            known=Information.prior(model.prior_variance(step=self._block), channels),
            state=FilterState.prior(model, channels=channels),
            innovations=Innovations.none(channels=channels),
            flags=StreamFlags.begin(model, shafts=shafts),
        )

    def _check_block(self, x: ArrayLike, phase_rad: ArrayLike | Mapping[str, ArrayLike]) -> tuple[Floats, Floats]:
        """Return (channel, sample) and (shaft, sample) arrays that go on from the last block, or refuse them."""
        block, now = check_record(x), self._progress
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
        *_, angles = check_orders(self._orders, phase_rad, samples=block.shape[1])
        last_phase = np.full(len(angles), np.nan) if now is None else now.last_phase
        for number, (name, last) in enumerate(zip(self._shafts, last_phase.tolist(), strict=True)):
            highest, jump = self._model.orders[self._model.shaft == number].max(), angles[number][0] - last
            if highest * abs(jump) > MOST_TURN:
                raise ValueError(
                    f"{f'phase_rad[{name!r}]' if name else 'phase_rad'} jumps by {jump:.4g} rad from the last block to "
                    f"this one, order {highest:g} by more than pi; go on from the last block's angle, {last:.6g} rad."
                )
        return block, np.stack(angles)

    def _filter(self, now: Progress, x: Floats, phase: Floats, samples: int) -> Outputs:
        """Filter the first of these samples and flag their outputs, given the angles of all and which are missing."""
        model, first = self._model, now.state.count
        outputs = np.arange(first + -first % self._every, first + samples, self._every)
        levels = np.empty((outputs.size, len(x), 2 * model.orders.size))
        variances = np.empty((outputs.size, model.orders.size))
        filter_on(
            replace(model, phases=tuple(phase[:, :samples])), x[:, :samples], now.state, now.innovations, levels,
            variances, output_every=self._every, startup=ceil(1 / float(model.bandwidth.min())) + model.state_size,
        )  # fmt: skip
        flags = now.flags.update(model, outputs, phase, ~np.isnan(x[0]), first, samples, self._lag)
        return levels.view(np.complex128).transpose(1, 2, 0), variances.T, flags

    def _smooth(self, now: Progress, samples: int, *, known: int) -> Outputs:
        """Smooth the first of the waiting samples, given those known of them, and let them go."""
        model, skip = self._model, -now.state.count % self._every
        size = model.orders.size

        def chain(stop: int) -> tuple[Grid, NodeChain]:
            """Return waiting samples in blocks, and their chain."""
            x, phases = now.x[:, :stop], tuple(now.phase[:, :stop])
            grid = Grid(
                model=replace(model, phases=phases), x=x, seen=~np.isnan(x[0]), length=self._block, tolerance=0.0,
                shared=np.ones(size, dtype=np.int64),
            )  # fmt: skip
            before = now.known.copy(), now.known.none()
            return grid, chain_together(grid, np.arange(size), slice(0, grid.nodes), None, before)

        grid, nodes = chain(known)
        try:
            smoothed = smooth_chain(nodes, first=0)
        except np.linalg.LinAlgError as error:
            raise lost(model, "exact") from error
        levels = np.stack([model.amplitude(own) for own in np.moveaxis(smoothed.levels, 2, 0)])
        amplitude = at_outputs(levels, grid, every=self._every, skip=skip, samples=samples)
        outputs, places = np.arange(skip, samples, self._every), self._block * np.arange(grid.nodes)
        std = np.sqrt(model.variance(smoothed.variances))
        variance = np.stack([np.interp(outputs, places, own) ** 2 for own in std])
        if samples < known:
            now.known = carry(chain(samples)[1])
        *_, flags = self._filter(now, now.x[:, :known], now.phase[:, :known], samples)
        now.x, now.phase = now.x[:, samples:].copy(), now.phase[:, samples:].copy()
        return amplitude, variance, flags

    def _tracks(self, now: Progress, first: int, parts: list[Outputs]) -> OrderTracks:
        """Return the tracks of the samples from `first` up to those done."""
        model, sums, channels = self._model, now.innovations, len(now.x)
        none = np.empty((model.orders.size, 0))
        nothing = (np.empty((channels, model.orders.size, 0), dtype=np.complex128), none, none.astype(np.uint8))
        amplitude, variance, flags = (np.concatenate(part, axis=-1) for part in zip(nothing, *parts, strict=True))
        estimate = Estimate(
            amplitude=amplitude,
            variance=variance,
            innovation_mean_square=sums.mean_square,
            innovation_log_variance=sums.mean_log_variance,
            innovation_autocorrelation=sums.autocorrelation,
            innovation_samples=sums.count,
        )
        patterns = Patterns(record=now.x, seen=[], of_channel=np.zeros(channels, dtype=np.int64))
        found = {
            "complex_amplitude": amplitude,
            "settling_variance": patterns.shared([variance]),
            "flags": patterns.shared([flags]),
        } | statistics(patterns, [estimate], self._noise)
        return OrderTracks(
            **{name: squeeze(value, now.one_channel) for name, value in found.items()},
            unresolved=now.flags.unresolved,
            orders=model.orders,
            shafts=self._names,
            bandwidth=self._width.given,
            bandwidth_units=self._width.units,
            bandwidth_cycles=self._width.cycles[:, 0],
            poles=model.poles,
            estimator="filter" if self._lag is None else "smoother",
            method="exact",
            error_bound=0.0,
            samples=now.state.count,
            output_every=self._every,
            first_output=first + -first % self._every,
        )


def _at_rest(orders: object) -> ArrayLike | Mapping[str, ArrayLike]:
    """Return an angle for every shaft that the orders name, so that they can be checked before there is any."""
    pairs = orders if np.iterable(orders) and not isinstance(orders, str | bytes | Mapping) else []
    names = [pair[0] for pair in pairs if isinstance(pair, tuple | list) and pair and isinstance(pair[0], str)]
    return {name: [0.0] for name in names} or [0.0]


def _parts(holder: Any) -> dict[str, Any]:  # noqa: ANN401
    fields = holder._asdict() if isinstance(holder, Information) else vars(holder)
    return {name: value for name, value in fields.items() if value is not None}


def _flat(holder: object, prefix: str = "") -> dict[str, Any]:
    """Return copies of the numbers and arrays in an object and in its parts, under the names of both."""
    found: dict[str, Any] = {}
    for name, value in _parts(holder).items():
        number = isinstance(value, int | float | np.ndarray)
        found |= {prefix + name: np.copy(value)} if number else _flat(value, f"{prefix}{name}_")
    return found


def _restored(
    like: _Part, state: Mapping[str, Any], shapes: Mapping[str, tuple[int | None, ...]], prefix: str = ""
) -> _Part:
    """Return what `_flat` made flat: of the types that `like` has, and of its shapes but for those given."""
    found = {}
    for name, value in _parts(like).items():
        key = prefix + name
        if isinstance(value, int | float | np.ndarray):
            array = _array(state, key, shapes.get(key, np.shape(value))).astype(np.asarray(value).dtype)
            found[name] = array if array.ndim else array.item()
        else:
            found[name] = _restored(value, state, shapes, f"{key}_")
    return type(like)(**found)


def _array(state: Mapping[str, Any], key: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return a copy of an array of numbers in a state, or refuse one of another shape; None stands for any length."""
    if key not in state:
        raise ValueError(
            f"state lacks {key!r}: pass what OrderTracker.state() returned, or what numpy.load made of it."
        )
    value = np.array(state[key])
    fits = value.ndim == len(shape) and all(n in (None, m) for m, n in zip(value.shape, shape, strict=True))
    if not fits or value.dtype.kind not in "biuf":
        needed = str(tuple("any" if n is None else n for n in shape)).replace("'", "")
        raise ValueError(
            f"state[{key!r}] has shape {value.shape} and type {value.dtype}; needed numbers of shape {needed}: "
            "pass what OrderTracker.state() returned, unchanged."
        )
    return value
