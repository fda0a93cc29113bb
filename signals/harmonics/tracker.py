"""Trackers of a whole record: amplitude and phase of shaft orders, checks, choice of the method."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from signals._validation import checked, choice, positive, real_array, whole
from signals.harmonics import _arguments
from signals.harmonics.block_smoother import block_length, exact, exact_length, fast, scattered_share
from signals.harmonics.kalman_filter import FilterState, SteadyGains, filter_on
from signals.harmonics.noise_density import noise_density
from signals.harmonics.separability import Closeness
from signals.harmonics.state_space import Estimator, HarmonicModel, Method, Order, lost
from signals.harmonics.tracking_results import OrderTracks, interpolated

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.harmonics.state_space import Estimate, Flags, Floats

# With fewer samples a block, condensing them gains nothing.
SHORTEST_BLOCK = 4
# Multiplications, about a third of a nanosecond each, that the exact method may take where "auto" chooses.
EXACT_WORK = 3e8
LARGEST_RTOL = 0.1
# Error of the steady-state gains, as a part of the exact filter's own error, above which they are refused.
LARGEST_RIPPLE = 0.7
# Times, at most, that clipped samples are replaced by their expectations, and change over the noise's std at which they
# stay; outputs in 1 / bandwidth between which amplitudes are taken as straight then; distance of a limit in std beyond
# which double precision loses the variance there.
MOST_FILLINGS, FILLED_RTOL, FILLING_OUTPUTS, FARTHEST = 40, 0.02, 100, 1e4


@checked
def track_orders(
    x: ArrayLike,
    *,
    phase_rad: ArrayLike | Mapping[str, ArrayLike],
    orders: Sequence[Order] | NDArray[np.float64],
    bandwidth_hz: ArrayLike | None = None,
    bandwidth_orders: ArrayLike | None = None,
    rate_hz: float | None = None,
    samples_per_rev: float | None = None,
    poles: int = 1,
    estimator: Estimator = "smoother",
    method: Method | Literal["auto"] = "auto",
    output_every: int = 1,
    rtol: float = 1e-3,
    noise_variance: float | None = None,
    initial_std: float | None = None,
    clip_limits: ArrayLike | None = None,
) -> OrderTracks:
    """Estimate the complex amplitude of every shaft order at every output sample, with its standard deviation.

    A Kalman filter or smoother estimates all orders jointly: close and crossing orders are separated, and `std` grows
    where the record cannot resolve them. `signals.harmonics.state_space` states the model.

    Parameters
    ----------
    x : (sample,) array
        The record in any unit, or (channel, sample) for channels with the same shaft angle. NaN marks a missing sample.
        Channels that miss the same samples share one covariance.
    phase_rad : (sample,) array
        Shaft angle in rad, or a mapping from shaft name to such an array.
    orders
        Orders in cycles per revolution, one number each; with a mapping, (shaft, order) pairs. Order 0 is the mean,
        which the filter always tracks.
    bandwidth_hz
        Full -3 dB width of the smoother in Hz, with `rate_hz`: one number for all orders, one for each, or, if it
        varies, an (order, sample) or (1, sample) array.
    bandwidth_orders
        The same in cycles per revolution of the order's own shaft, with `samples_per_rev`, or with `rate_hz`: then it
        follows the shaft's speed.
    rate_hz
        Sampling rate in Hz.
    samples_per_rev
        Samples per revolution, for a record sampled in angle.
    poles
        Number of integrations of the random walk of the amplitudes, 1 to 4. More make the passband flatter and its
        sides steeper.
    estimator
        "smoother" uses all samples for each output, "filter" only those up to it; at the same `bandwidth` the filter
        passes a wider band.
    method
        "exact" filters sample by sample, or smooths all orders jointly in blocks so short that the RMS error is below
        0.3 % of `std`. "fast" smooths in longer blocks, or filters with steady-state gains once they have settled,
        which requires a constant bandwidth. "auto" selects "exact" if it is quick, if blocks would be too short or are
        broken up by short gaps, or if orders stay within half a bandwidth of each other; otherwise "fast".
        `OrderTracks.method` states which one ran.
    output_every
        Samples from one output to the next.
    rtol
        Largest error of "fast": for the smoother, relative to the amplitude of an envelope at the edge of the
        bandwidth; for a filter selected by "auto", the relative increase in the error of the exact filter.
    noise_variance
        Variance R of white noise in `x`, in its unit squared; by default the noise density around each order is
        estimated from the record.
    initial_std
        Prior standard deviation of the real and imaginary part of each amplitude, in the unit of `x`; requires
        `noise_variance`. For the i-th difference it is `initial_std (2 pi bandwidth / rate)^i`. Default: 1000 standard
        deviations of the noise, a prior without effect after a few samples.
    clip_limits
        Smallest and largest value that the sensor can record, infinite for no limit; only with "smoother". A sample at
        or beyond a limit is treated as censored: it is replaced by its conditional expectation, repeatedly until that
        converges, at about ten times the cost. Marking clipped samples as missing would bias amplitudes towards zero.

    Returns
    -------
    OrderTracks
        Amplitudes, standard deviations and statistics of the innovations.

    Raises
    ------
    ValueError
        An argument is out of range or contradicts another; the message names it and the remedy.
    FloatingPointError
        The covariance is no longer positive definite in double precision.

    Examples
    --------
    A pure tone of amplitude 2 at order 3, and nothing at order 1:

    >>> import numpy as np
    >>> from signals.harmonics import track_orders
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000  # one second at 25 revolutions per second
    >>> x = 2 * np.cos(3 * phase_rad)
    >>> tracks = track_orders(x, phase_rad=phase_rad, orders=[1, 3], bandwidth_hz=2, rate_hz=5000)
    >>> print(np.abs(tracks.complex_amplitude[:, 2500]).round(3))
    [0. 2.]
    """
    record = _arguments.check_record(x, smallest=_arguments.SMALLEST if noise_variance is None else 0.0)
    samples = record.shape[1]
    model, shafts, bandwidth, noise_variance = _arguments.check_model(
        orders=orders, phase_rad=phase_rad, samples=samples, noise_variance=noise_variance, initial_std=initial_std,
        poles=poles, bandwidth_hz=bandwidth_hz, bandwidth_orders=bandwidth_orders, rate_hz=rate_hz,
        samples_per_rev=samples_per_rev,
    )  # fmt: skip
    choice(estimator, name="estimator", choices=("smoother", "filter"))
    choice(method, name="method", choices=("auto", "exact", "fast"))
    rtol = positive(rtol, name="rtol")
    if rtol > LARGEST_RTOL:
        raise ValueError(
            f"rtol={rtol:g} is above {LARGEST_RTOL:g}, where the bound on the error of blocks no longer holds; "
            "choose a smaller one."
        )
    every = whole(output_every, name="output_every", least=1)
    tracked = model if estimator == "smoother" else model.with_mean
    seen, one = ~np.isnan(record), np.ndim(x) == 1
    chosen = _choose(method, tracked, seen, estimator=estimator, rtol=rtol)
    alike = bool((seen == seen[0]).all())

    def track(record: Floats, every: int) -> OrderTracks:
        parts = [
            _tracked(
                tracked, record[rows], noise_variance, orders=model.orders.size,
                name="x" if one else f"x[{rows.start}]", estimator=estimator, method=chosen, every=every, rtol=rtol,
            )
            for rows in ([slice(0, None)] if alike else [slice(channel, channel + 1) for channel in range(len(record))])
        ]  # fmt: skip
        spacing, found = (parts[0][0].std_spacing, parts[0][1]) if alike else _joined(parts, samples)
        return OrderTracks(
            **{name: squeeze(value, one) for name, value in found.items()},
            bandwidth=bandwidth, orders=model.orders, shafts=shafts, poles=model.poles, method=chosen,
            error_bound=max(estimate.error_bound for estimate, _ in parts),
            samples=samples, output_every=every, std_spacing=spacing,
        )  # fmt: skip

    if clip_limits is None:
        return track(record, every)
    if estimator != "smoother":
        raise ValueError('clip_limits with estimator="filter": only the smoother fits them; use estimator="smoother".')
    return _censored(record, model, track, every, clip_limits, known=noise_variance is not None)


def _joined(parts: list[tuple[Estimate, dict[str, Any]]], samples: int) -> tuple[int, dict[str, Any]]:
    """Return the fields of several channels as one, with their variances at the narrowest spacing of nodes."""
    spacing = min(estimate.std_spacing for estimate, _ in parts)
    for estimate, own in parts:
        std, nodes = np.sqrt(own["settling_variance"]), np.arange(0, samples, spacing)
        own["settling_variance"] = interpolated(std, estimate.std_spacing * np.arange(std.shape[-1]), nodes) ** 2
    return spacing, {name: np.concatenate([own[name] for _, own in parts]) for name in parts[0][1]}


def _tracked(
    model: HarmonicModel, record: Floats, noise_variance: float | None, *, orders: int, name: str, estimator: Estimator,
    method: Method, every: int, rtol: float,
) -> tuple[Estimate, dict[str, Any]]:  # fmt: skip
    """Return the estimate of channels that miss the same samples, and the (channel, ...) fields of the first orders."""
    seen = ~np.isnan(record[0])
    startup = _startup(model, seen, noise_variance, name=name)
    try:
        if estimator == "filter":
            state, steady = FilterState.prior(model, channels=len(record)), method == "fast"
            gains, error = (SteadyGains.of(model), Closeness.of(model).ripple) if steady else (None, 0.0)
            estimate = filter_on(model, record, state, orders=orders, output_every=every, startup=startup, steady=gains)
            estimate = replace(estimate, error_bound=error)
        elif method == "fast":
            estimate = fast(model, record, seen, rtol=rtol, output_every=every, startup=startup)
        else:
            estimate = exact(model, record, seen, output_every=every, startup=startup, noise_variance=noise_variance)
    except np.linalg.LinAlgError as error:
        raise lost(model, method) from error
    if not estimate.variance.min() > 0:
        raise lost(model, method)
    found = statistics(estimate, noise_variance)
    if noise_variance is None:
        fitted = model.state_size if estimator == "smoother" else 0  # innovations are independent
        left = estimate.innovations.count * (1 - fitted / max(int(np.count_nonzero(seen)), fitted + 1))
        density = noise_density(record, seen, model, found["noise_variance"], max(left, 1.0))
        found["noise_density"], found["noise_freedom"] = (values[:, :orders] for values in density)
    return estimate, found


def statistics(estimate: Estimate, given: float | None) -> dict[str, Any]:
    """Return the (channel, ...) fields of `OrderTracks`; all channels share variances.

    `given` is the variance R of the noise; None where the mean square of the innovations estimates it.
    """
    channels, mean_square = len(estimate.amplitude), estimate.innovations.mean_square
    variance = estimate.variance
    none = 0.0 if estimate.innovations.count else np.nan
    noise = mean_square if given is None else np.full(channels, float(given))
    return {
        "complex_amplitude": estimate.amplitude,
        "settling_variance": np.broadcast_to(variance, (channels, *variance.shape)),
        "noise_variance": noise,
        "noise_density": np.broadcast_to(noise[:, None, None], (channels, len(variance), 1)),
        "noise_freedom": np.full((channels, 1, 1), np.inf),
        "innovation_mean_square": np.ones(channels) if given is None else mean_square / noise + none,
    }


def _censored(
    record: Floats, model: HarmonicModel, track: Callable[[Floats, int], OrderTracks], output_every: int,
    clip_limits: ArrayLike, *, known: bool,
) -> OrderTracks:  # fmt: skip
    """Track with clipped samples as censored data (Tobit), by expectation and maximisation.

    `track` tracks a (channel, sample) record with outputs some samples apart; `known` is whether R was given.

    References
    ----------
    .. [1] A. P. Dempster, N. M. Laird, D. B. Rubin, "Maximum likelihood from incomplete data via the EM algorithm",
       J. Royal Statistical Society B 39, 1977.
    """
    from scipy.special import erfcx  # noqa: PLC0415 - slow to import

    from signals.harmonics._block_kernels import phasors  # noqa: PLC0415 - loads numba

    limits = real_array(clip_limits, name="clip_limits").astype(np.float64)
    if limits.shape != (2,) or not limits[0] < limits[1]:
        raise ValueError(f"clip_limits={limits.tolist()} must be two numbers, the smaller first; one may be infinite.")
    channel, sample = at = np.nonzero((record <= limits[0]) | (record >= limits[1]))
    bound = record[at]
    side = np.where(bound >= limits[1], 1.0, -1.0)

    def summed(values: Floats) -> Floats:
        return np.asarray(np.bincount(channel, values, minlength=len(record)))

    tracks = track(record, output_every)
    noise, lost = np.atleast_1d(tracks.noise_variance), np.zeros(len(record))
    every = max(1, int(1 / (FILLING_OUTPUTS * model.bandwidth.mean(axis=1).max())))
    waves = phasors(-2 * np.pi * model.turns(sample))
    filled, before, former = record.copy(), bound, np.zeros_like(bound)
    for _ in range(MOST_FILLINGS if bound.size else 0):
        tracks = track(filled, every)
        noise = np.atleast_1d(tracks.noise_variance) + (0.0 if known else noise * lost)
        std = np.sqrt(np.maximum(noise, _arguments.SMALLEST**2))[channel]
        outputs = tracks.complex_amplitude.reshape(len(record), tracks.orders.size, -1)
        low = sample // every
        high, part = np.minimum(low + 1, outputs.shape[-1] - 1), sample / every - low
        amplitude = (1 - part) * outputs[channel, :, low].T + part * outputs[channel, :, high].T
        # Of a standard normal variable beyond a: mean h, the hazard, and variance 1 - h (h - a)
        beyond = np.clip(side * (bound - np.sum(amplitude * waves, axis=0).real) / std, -FARTHEST, FARTHEST)
        hazard = np.sqrt(2 / np.pi) / erfcx(beyond / np.sqrt(2))
        step = bound + side * std * (hazard - beyond) - filled[at]
        lost = summed(1 - hazard * (hazard - beyond)) / record.shape[1]
        # Barzilai and Borwein's step length, from the change of the plain step over the last one taken
        moved = filled[at] - before
        bend = np.maximum(summed(moved * (former - step)), _arguments.SMALLEST)
        length = np.clip(summed(moved**2) / bend, 1, 100)[channel]
        before, former = filled[at], step
        filled[at] = bound + side * np.maximum(side * (before + length * step - bound), 0)
        if np.max(np.abs(step) / std) < FILLED_RTOL:
            break
    if bound.size:
        tracks = track(filled, output_every)
    more, clipped = noise / np.atleast_1d(tracks.noise_variance), summed(np.ones(bound.size)) / record.shape[1]
    one = tracks.complex_amplitude.ndim == 2  # noqa: PLR2004 - without an axis of channels
    return replace(
        tracks, noise_variance=squeeze(noise, one), clipped_share=squeeze(clipped, one),
        noise_density=tracks.noise_density * squeeze((more / (1 - lost))[:, None, None], one),
    )  # fmt: skip


def _startup(model: HarmonicModel, seen: Flags, noise_variance: float | None, *, name: str) -> int:
    """Return the first sample whose innovation counts: after one time constant, or half of a short record."""
    observed, needed = int(np.count_nonzero(seen)), 2 * model.state_size
    if noise_variance is None and observed < needed:
        raise ValueError(
            f"{name} has {observed} observed samples of {seen.size}; to estimate the noise beside {model.orders.size} "
            f"orders with poles={model.poles}, {needed} are needed: pass noise_variance, or more samples"
            f"{'.' if name == 'x' else ', or leave this channel out: without noise it has no std.'}"
        )
    skipped = min(model.startup, observed // 2)
    return skipped if observed in (0, seen.size) else int(np.flatnonzero(seen)[skipped])


def _choose(
    method: Method | Literal["auto"], model: HarmonicModel, seen: Flags, *, estimator: Estimator, rtol: float
) -> Method:
    """Return the method to run on channels of which these samples are seen, or refuse one that cannot do it."""
    samples, closeness = model.phases[0].size, Closeness.of(model)
    if estimator == "filter" and method != "exact":
        unsteady = ""
        if model.bandwidth.shape[1] > 1:
            unsteady = "the bandwidth varies, and the gains with it"
        elif closeness.ripple > LARGEST_RIPPLE:
            unsteady = (
                "orders come so close, to one another, to zero or to half of the rate, that steady-state gains would "
                f"be off by {closeness.ripple:.2g} of the filter's own error, above {LARGEST_RIPPLE:g}"
            )
        if method == "fast" and unsteady:
            raise ValueError(f'method="fast" with estimator="filter": {unsteady}; use method="exact".')
        # Steady-state gains add an independent error, some 0.7 times the ripple: squares add up.
        return "fast" if method == "fast" or not (unsteady or closeness.ripple**2 / 4 > rtol) else "exact"
    if method != "auto":
        return method
    # Measured cost: the phasors, the products of regressors, a smoother cubic in the state a node.
    products = model.order_of_column.size**2 * (2 * model.poles - 1)
    work = samples * (50 * model.orders.size + products + 5 * model.state_size**3 / exact_length(model, samples))
    length = block_length(model, samples, rtol)
    scattered = not seen.all() and max(scattered_share(own, length) for own in seen) > rtol
    blurs = model.poles > 1 and closeness.dwell()  # orders that long blocks may not separate
    return "exact" if work <= EXACT_WORK or length < SHORTEST_BLOCK or scattered or blurs else "fast"


def squeeze(values: Any, one: bool) -> Any:  # noqa: ANN401
    """Return values without their channel axis where `one` says that the record had none."""
    if not one:
        return values
    return values[0] if values.ndim > 1 else float(values[0])
