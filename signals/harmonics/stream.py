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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import whole
from signals.harmonics._stored import array
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.inputs import (
    MOST_TURN,
    check_bandwidth,
    check_initial_std,
    check_noise_variance,
    check_orders,
    check_record,
)
from signals.harmonics.model import PRIOR_STD, BandwidthUnits, Floats, HarmonicModel, Order
from signals.harmonics.running import Outputs, Running
from signals.harmonics.tracks import OrderTracks


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
            _BANDWIDTH[self._width.units][0]: self._width.given,
            _BANDWIDTH[self._width.units][1]: rate_hz if self._width.units == "hz" else samples_per_rev,
            "poles": self._model.poles,
            "initial_std": float(std),
            "lag": 0 if self._lag is None else self._lag,
            "output_every": self._every,
        }
        self._one = True
        self._running: Running | None = None
        self._last_phase = np.full(self._shafts(), np.nan)

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
        block = self._check_block(x)
        names = self._names or ("",) * self._model.orders.size
        orders = [(s, o) if s else o for s, o in zip(names, self._model.orders.tolist(), strict=True)]
        *_, angles = check_orders(orders, phase_rad, samples=block.shape[1])
        phase = np.stack(angles)
        self._check_continuity(phase)
        self._last_phase = phase[:, -1].copy()
        if self._running is None:
            self._one = np.ndim(x) == 1
            self._running = self._begun(len(block))
        return self._tracks(self._running, self._running.done, self._running.take(block, phase))

    def finish(self) -> OrderTracks:
        """Return the outputs that a lag still keeps back: the stream has ended."""
        if self._running is None:
            raise ValueError("finish() before any update(): the stream is empty; pass its samples to update() first.")
        return self._tracks(self._running, self._running.done, self._running.finish())

    def state(self) -> dict[str, Any]:
        """Return all there is to know to go on later: numbers, strings and arrays under plain names.

        `numpy.savez(path, **tracker.state())` keeps it; `OrderTracker.from_state(numpy.load(path))` goes on from there.
        """
        kept = {f"setting_{name}": value for name, value in self._settings.items()}
        kept |= {"one_channel": self._one, "channels": 0, "last_phase": self._last_phase.copy()}
        return kept if self._running is None else kept | {"channels": len(self._running.x)} | self._running.stored()

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
        tracker._one, channels = bool(array(state, "one_channel", ())), int(array(state, "channels", ()))
        tracker._last_phase = array(state, "last_phase", (tracker._shafts(),)).astype(np.float64)
        if channels:
            tracker._running = tracker._begun(channels)
            tracker._running.restore(state)
        return tracker

    def _begun(self, channels: int) -> Running:
        return Running.begin(self._model, channels=channels, shafts=self._shafts(), lag=self._lag, every=self._every)

    def _shaft_names(self) -> list[str]:
        """Names of the shafts in the order in which the model counts them."""
        return list(dict.fromkeys(self._names)) or [""]

    def _shafts(self) -> int:
        return len(self._shaft_names())

    def _check_block(self, x: ArrayLike) -> Floats:
        block = check_record(x)
        channels = len(block) if self._running is None else len(self._running.x)
        if self._running is not None and (len(block) != channels or (np.ndim(x) == 1) != self._one):
            raise ValueError(
                f"x has shape {np.shape(x)}, but the stream began with "
                f"{'one plain channel' if self._one else f'{channels} channels'}; pass blocks of the same channels."
            )
        missing = np.isnan(block)
        if not (missing == missing[0]).all():
            raise ValueError(
                "x misses different samples in different channels; a stream's channels share one covariance: mark a "
                "sample missing in all of them, or use one OrderTracker for each."
            )
        return block

    def _check_continuity(self, phase: Floats) -> None:
        for number, name in enumerate(self._shaft_names()):
            highest = self._model.orders[self._model.shaft == number].max()
            jump = phase[number, 0] - self._last_phase[number]
            if highest * abs(jump) > MOST_TURN:
                label = f"phase_rad[{name!r}]" if name else "phase_rad"
                raise ValueError(
                    f"{label} jumps by {jump:.4g} rad from the last block to this one, "
                    f"order {highest:g} by more than pi; go on from the last block's angle, "
                    f"{self._last_phase[number]:.6g} rad."
                )

    def _tracks(self, running: Running, first: int, parts: list[Outputs]) -> OrderTracks:
        """Return the tracks of the samples from `first` up to those done."""
        channels, innovations = len(running.x), running.innovations
        found = Outputs.joined(parts, channels=channels, orders=self._model.orders.size)
        none = 0.0 if innovations.count else np.nan
        correlation = innovations.autocorrelation + none
        growth = np.exp(innovations.mean_log_variance) + none
        one = self._one
        return OrderTracks(
            complex_amplitude=found.amplitude[0] if one else found.amplitude,
            settling_variance=found.variance if one else np.broadcast_to(found.variance, found.amplitude.shape),
            flags=found.flags if one else np.broadcast_to(found.flags, found.amplitude.shape),
            unresolved=running.watch.unresolved,
            orders=self._model.orders,
            shafts=self._names,
            bandwidth=self._width.given,
            bandwidth_units=self._width.units,
            bandwidth_cycles=self._width.cycles[:, 0],
            poles=self._model.poles,
            estimator="filter" if self._lag is None else "smoother",
            method="exact",
            error_bound=0.0,
            noise_variance=self._noise if one else np.full(channels, self._noise),
            innovation_variance=self._noise * growth if one else np.full(channels, self._noise * growth),
            innovation_mean_square=_own(innovations.mean_square / self._noise + none, one=one),
            innovation_autocorrelation=correlation[0] if one else correlation,
            whiteness=_own(np.mean(correlation**2, axis=1) * innovations.count, one=one),
            samples=running.done,
            output_every=self._every,
            first_output=first + -first % self._every,
        )


_BANDWIDTH: dict[BandwidthUnits, tuple[str, str]] = {
    "hz": ("bandwidth_hz", "rate_hz"),
    "orders": ("bandwidth_orders", "samples_per_rev"),
}


def _own(values: Floats, *, one: bool) -> float | Floats:
    return float(values[0]) if one else values


def _at_rest(orders: object) -> ArrayLike | Mapping[str, ArrayLike]:
    """Return an angle for every shaft that the orders name, so that they can be checked before there is any."""
    pairs = orders if np.iterable(orders) and not isinstance(orders, str | bytes | Mapping) else []
    names = [pair[0] for pair in pairs if isinstance(pair, tuple | list) and pair and isinstance(pair[0], str)]
    return {name: [0.0] for name in names} or [0.0]
