"""Trackers of a record that arrives in blocks: memory does not grow with its length.

It is the causal Kalman filter of `track_orders(..., estimator="filter")`, continued from block to block.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from signals._validation import choice, positive, whole
from signals.harmonics import _arguments
from signals.harmonics.kalman_filter import FilterState, SteadyGains, filter_on
from signals.harmonics.separability import Closeness
from signals.harmonics.tracker import LARGEST_RIPPLE, squeeze, statistics
from signals.harmonics.tracking_results import OrderTracks

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.harmonics.state_space import Floats, Method, Order


class OrderTracker:
    """Causal Kalman filter of shaft orders for a record that arrives in blocks.

    Parameters
    ----------
    orders
        Orders in cycles per revolution, one number each, or (shaft, order) pairs. Order 0 is the mean, which is always
        tracked.
    noise_variance
        Variance R of the white noise in the record, in its unit squared.
    bandwidth_hz, bandwidth_orders
        Full -3 dB width of the smoother, one for all orders or one each: in Hz, with `rate_hz`, or in cycles per
        revolution, with `samples_per_rev`.
    rate_hz, samples_per_rev, poles, initial_std, output_every
        As for `track_orders`.
    method
        "exact", or "fast": steady-state gains once they have settled, in a quarter of the time. Blocks in which
        orders come too close for these are filtered exactly.

    Examples
    --------
    A tone of amplitude 2 in two blocks. A tracker that is pickled goes on later, or elsewhere:

    >>> import pickle
    >>> import numpy as np
    >>> from signals.harmonics import OrderTracker
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 2 * np.cos(3 * phase_rad)
    >>> tracker = OrderTracker(orders=[3], noise_variance=0.01, bandwidth_hz=10, rate_hz=5000, output_every=1000)
    >>> first = tracker.update(x[:2500], phase_rad=phase_rad[:2500])
    >>> second = pickle.loads(pickle.dumps(tracker)).update(x[2500:], phase_rad=phase_rad[2500:])
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
        method: Method = "exact",
        output_every: int = 1,
    ) -> None:
        self._noise = positive(noise_variance, name="noise_variance")
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
        pairs = [item for item in orders if isinstance(item, tuple | list) and item] if np.iterable(orders) else []
        # Zero angles, so that orders are checked before angles are known.
        rest = {pair[0]: [0.0] for pair in pairs if isinstance(pair[0], str)} or [0.0]
        model, self._names, self._width, _ = _arguments.check_model(
            orders=orders, phase_rad=rest, samples=1, noise_variance=self._noise, initial_std=initial_std, poles=poles,
            bandwidth_hz=bandwidth_hz, bandwidth_orders=bandwidth_orders, rate_hz=rate_hz,
            samples_per_rev=samples_per_rev,
        )  # fmt: skip
        self._orders, self._model = tuple(orders), model.with_mean
        self._shafts = list(dict.fromkeys(self._names)) or [""]
        choice(method, name="method", choices=("exact", "fast"))
        self._steady = SteadyGains.of(self._model) if method == "fast" else None
        self._every = whole(output_every, name="output_every", least=1)
        self._state: FilterState | None = None
        self._channels: tuple[int, ...] = ()  # axes of blocks before that of the samples
        self._last_phase = np.full(len(self._shafts), np.nan)
        self._error_bound = 0.0  # of steady-state gains

    def update(self, x: ArrayLike, *, phase_rad: ArrayLike | Mapping[str, ArrayLike]) -> OrderTracks:
        """Update with the next samples and return their outputs.

        Parameters
        ----------
        x : (sample,) array
            Or (channel, sample); as many channels in every block. NaN marks a missing sample, in all channels at once.
        phase_rad : (sample,) array
            Shaft angle in rad that continues that of the last block, or a mapping from shaft name to such an array.

        Returns
        -------
        OrderTracks
            `sample_index` counts from the start of the stream; innovations are those of all samples so far.
        """
        block, phase = self._check_block(x, phase_rad)
        if self._state is None:
            self._state, self._channels = FilterState.prior(self._model, channels=len(block)), np.shape(x)[:-1]
        state, model = self._state, replace(self._model, phases=tuple(phase))
        steady = None
        if self._steady is not None:
            turned = np.column_stack([self._last_phase, phase]) if state.count else phase
            error = Closeness.of(replace(model, phases=tuple(turned))).ripple
            if error <= LARGEST_RIPPLE:
                steady, self._error_bound = self._steady, max(self._error_bound, error)
        orders = len(self._orders)
        estimate = filter_on(
            model, block, state, orders=orders, output_every=self._every, steady=steady,
            startup=model.startup,
        )  # fmt: skip
        self._last_phase = phase[:, -1].copy()
        outputs, found = estimate.amplitude.shape[-1], statistics(estimate, self._noise)
        return OrderTracks(
            **{name: squeeze(value, not self._channels) for name, value in found.items()},
            bandwidth=self._width, orders=model.orders[:orders], shafts=self._names, poles=model.poles,
            method="exact" if self._steady is None else "fast", error_bound=self._error_bound,
            samples=state.count, output_every=self._every,
            std_spacing=estimate.std_spacing,
            first_output=self._every * (-(-state.count // self._every) - outputs),
        )  # fmt: skip

    def _check_block(self, x: ArrayLike, phase_rad: ArrayLike | Mapping[str, ArrayLike]) -> tuple[Floats, Floats]:
        """Return (channel, sample) and (shaft, sample) arrays that continue the last block, or refuse them."""
        block = _arguments.check_record(x)
        if self._state is not None and np.shape(x)[:-1] != self._channels:
            began = f"{self._channels[0]} channels" if self._channels else "one plain channel"
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
        for number, (name, last) in enumerate(zip(self._shafts, self._last_phase.tolist(), strict=True)):
            highest, jump = self._model.orders[self._model.shaft == number].max(), angles[number][0] - last
            if highest * abs(jump) > _arguments.MOST_TURN:
                raise ValueError(
                    f"{f'phase_rad[{name!r}]' if name else 'phase_rad'} jumps by {jump:.4g} rad from the last block to "
                    f"this one, order {highest:g} by more than pi; go on from the last block's angle, {last:.6g} rad."
                )
        return block, np.stack(angles)
