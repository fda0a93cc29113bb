"""The door to the trackers: checks what comes in, picks the method, scales what comes out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import choice, positive, whole
from signals.harmonics import inputs
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.blocks import block_length, blurs, exact, exact_length, fast, scattered_share
from signals.harmonics.innovations import statistics
from signals.harmonics.kalman_filter import covariance_filter, ripple, steady_state_filter
from signals.harmonics.model import PRIOR_STD, Estimate, Estimator, Floats, HarmonicModel, Method, Order, Patterns, lost
from signals.harmonics.separability import Closeness, flag_outputs
from signals.harmonics.tracks import OrderTracks

# With fewer samples a block, condensing them gains nothing.
SHORTEST_BLOCK = 4
# Multiplications, about a third of a nanosecond each, that the exact method may take where "auto" chooses.
EXACT_WORK = 3e8
LARGEST_RTOL = 0.1
# Part of the exact filter's error by which steady-state gains may lead astray.
LARGEST_RIPPLE = 0.7


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
    coupled: bool = True,
    rtol: float = 1e-3,
    noise_variance: float | None = None,
    initial_std: float | None = None,
    phase_std_rad: ArrayLike | Mapping[str, ArrayLike] | None = None,
    innovations: bool = False,
) -> OrderTracks:
    """Estimate the complex amplitudes of all orders together, each output with its standard deviation.

    Orders are separated by their effect on the record: close and crossing ones share its energy, and `std` grows where
    they cannot be separated.

    Parameters
    ----------
    x : (sample,) array, the record in any unit, or (channel, sample) for several with the same phase; NaN marks a
        missing sample. Channels that miss the same samples share all the work but that on their data; each further
        pattern of missing samples costs as much as a record of its own.
    phase_rad : (sample,) array, shaft angle in rad, or a mapping from shaft name to such an array.
    orders : cycles per revolution, one number an order; with a mapping, (shaft, order) pairs. 0 is the mean.
    bandwidth_hz : full -3 dB width of the smoother in Hz, with `rate_hz`: one for all orders, one each, or, where it
        varies, (order, sample); (1, sample) for all orders alike.
    bandwidth_orders : the same in cycles per revolution of the order's own shaft, with `samples_per_rev`, or with
        `rate_hz`: then it follows the shaft's speed.
    rate_hz : samples per second.
    samples_per_rev : samples per revolution, for a record sampled in angle.
    poles : 1 to 4, how many times the amplitudes' random walk is integrated: more make a flatter passband
        with steeper sides.
    estimator : "smoother" uses all samples for each output; "filter" this one and those before it, and at the
        same `bandwidth` is wider.
    method : "exact" is the filter of every sample; of the smoother it takes blocks so short that a dense solution
        differs by less than 0.3 % of `std` (root mean square), all orders together. "fast" takes longer blocks, and
        fixes the filter's gains once they are steady, which needs a record without gaps and a constant bandwidth.
        "reference" is exact, on filterpy, hundreds of times slower. "auto" takes exact where that is quick, where
        blocks would be too short, short gaps break them up, or lines stay within half a bandwidth of each other, else
        fast. The result says which.
    output_every : samples from one output to the next.
    coupled : False estimates every order on its own, as if there were no others: by the fast smoother only.
    rtol : error that "fast" may make: as a part of the amplitude, for an envelope at the edge of the bandwidth; where
        "auto" chooses a filter, as the part by which the error of the exact one may grow.
    noise_variance : variance R of the white noise in `x`; estimated from the record unless given.
    initial_std : standard deviation of each part of an amplitude about zero before the first sample, in the unit
        of `x`; needs `noise_variance`. Of the i-th difference it is `initial_std (2 pi bandwidth / rate)^i`.
        Default 1000 standard deviations of the noise: it no longer matters a few samples on.
    phase_std_rad : standard deviation of the shaft angle, one number or (sample,), or a mapping as `phase_rad`, of
        errors slow against 1 / bandwidth: carried into `std`, which gains (order phase_std |Z|)^2 / 2 in square.
    innovations : whether the innovations of all samples are wanted; the exact method alone has them.

    Returns
    -------
    OrderTracks

    Raises
    ------
    ValueError
        An input makes no sense; the sentence says which and what to do.
    FloatingPointError
        The covariance lost its digits.
    """
    record = inputs.check_record(x)
    samples = record.shape[1]
    order_numbers, shafts, shaft, phases = inputs.check_orders(orders, phase_rad, samples=samples)
    bandwidth = inputs.check_bandwidth(
        bandwidth_hz=bandwidth_hz, bandwidth_orders=bandwidth_orders, rate_hz=rate_hz,
        samples_per_rev=samples_per_rev, shaft=shaft, phases=phases,
    )  # fmt: skip
    choice(estimator, name="estimator", choices=("smoother", "filter"))
    choice(method, name="method", choices=("auto", "exact", "fast", "reference"))
    model = HarmonicModel(
        orders=order_numbers, shaft=shaft, phases=phases, bandwidth=bandwidth.cycles,
        poles=whole(poles, name="poles", least=1, most=MOST_POLES), prior_std=_prior_std(initial_std, noise_variance),
    )  # fmt: skip
    rtol = positive(rtol, name="rtol")
    if rtol > LARGEST_RTOL:
        raise ValueError(
            f"rtol={rtol:g} is above {LARGEST_RTOL:g}, where the bound on the error of blocks no longer holds; "
            "choose a smaller one."
        )
    task = _Task(
        model=model, estimator=estimator, output_every=whole(output_every, name="output_every", least=1),
        coupled=coupled, rtol=rtol, noise_variance=noise_variance, innovations=innovations,
    )  # fmt: skip
    phase_std = inputs.check_phase_std(phase_std_rad, shafts=shafts, samples=samples)
    phase_every = task.output_every if phase_std is not None and phase_std.shape[1] > 1 else 1
    patterns = Patterns.of(record)
    chosen = _choose(method, task, patterns.seen)
    one = np.ndim(x) == 1
    startups = [
        _startup(task, seen, name="x" if one else f"x[{channel}]")
        for seen, channel in zip(patterns.seen, patterns.first_channels, strict=True)
    ]
    estimates = [_run(chosen, task, *part) for part in zip(patterns.records, patterns.seen, startups, strict=True)]
    flags, pairs = flag_outputs(task.closeness, patterns.seen, every=task.output_every, estimator=estimator)
    return OrderTracks(
        complex_amplitude=squeeze(patterns.joined([estimate.amplitude for estimate in estimates]), one),
        settling_variance=squeeze(patterns.shared([estimate.variance for estimate in estimates]), one),
        std_spacing=estimates[0].std_spacing,
        angle_std=None if phase_std is None else order_numbers[:, None] * phase_std[:, ::phase_every],
        flags=squeeze(patterns.shared(flags), one),
        unresolved=pairs,
        orders=order_numbers,
        shafts=shafts,
        bandwidth=bandwidth.given,
        bandwidth_units=bandwidth.units,
        bandwidth_cycles=bandwidth.cycles.mean(axis=1),
        poles=model.poles,
        estimator=estimator,
        method=chosen,
        error_bound=max(estimate.error_bound for estimate in estimates),
        samples=samples,
        output_every=task.output_every,
        **{name: squeeze(value, one) for name, value in statistics(patterns, estimates, noise_variance).items()},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """What is asked of a method."""

    model: HarmonicModel
    estimator: Estimator
    output_every: int
    coupled: bool
    rtol: float
    noise_variance: float | None
    innovations: bool

    @cached_property
    def closeness(self) -> Closeness:
        """How far orders are from one another."""
        return Closeness(self.model, self.model.phases[0].size)

    @cached_property
    def ripple(self) -> float:
        """How far steady-state gains would lead astray."""
        return ripple(self.closeness)


def _prior_std(initial_std: float | None, noise_variance: float | None) -> float:
    """Return the prior's standard deviation in those of the noise."""
    noise = None if noise_variance is None else inputs.check_noise_variance(noise_variance)
    if initial_std is None:
        return PRIOR_STD
    if noise is None:
        std = positive(initial_std, name="initial_std")
        raise ValueError(
            f"initial_std={std:g} weighs against the noise, whose variance is not given; "
            "pass noise_variance too, or neither."
        )
    return inputs.check_initial_std(initial_std, noise=noise)


def _startup(task: _Task, seen: NDArray[np.bool_], *, name: str) -> int:
    """First sample whose innovation counts: after the smoother's memory, or halfway in a short record."""
    model = task.model
    observed = int(np.count_nonzero(seen))
    needed = 2 * model.state_size
    if task.noise_variance is None and observed < needed:
        raise ValueError(
            f"{name} has {observed} observed samples of {seen.size}; to estimate the noise beside {model.orders.size} "
            f"orders with poles={model.poles}, {needed} are needed: pass noise_variance, or more samples"
            f"{'.' if name == 'x' else ', or leave this channel out: without noise it has no std.'}"
        )
    memory = min(ceil(1 / model.bandwidth.max(axis=1).min()) + model.state_size, observed // 2)
    return memory if observed in (0, seen.size) else int(np.flatnonzero(seen)[memory])


def _choose(method: Method | Literal["auto"], task: _Task, patterns: list[NDArray[np.bool_]]) -> Method:
    model, samples = task.model, task.model.phases[0].size
    if not task.coupled and (task.estimator == "filter" or method in ("exact", "reference")):
        raise ValueError(
            f"coupled=False with estimator={task.estimator!r} and method={method!r}: orders are estimated one by one "
            "by the fast smoother only; leave coupled out, or track one order a call."
        )
    whole = all(seen.all() for seen in patterns)
    unsettled = _never_settles(task, whole=whole) if task.estimator == "filter" and method in ("auto", "fast") else ""
    if method == "fast" and unsettled:
        raise ValueError(f'method="fast" with estimator="filter": {unsettled}; use method="exact".')
    if task.innovations and method in ("fast", "reference"):
        raise ValueError(
            f'innovations=True with method={method!r}, which gives none for each sample; use method="exact".'
        )
    if method != "auto":
        return method
    if task.innovations:
        return "exact"
    if not task.coupled:
        return "fast"
    if task.estimator == "filter":
        # What steady-state gains add to the error, some 0.7 times the ripple, is independent of it: squares add up.
        return "exact" if unsettled or task.ripple**2 / 4 > task.rtol else "fast"
    # Measured: the innovations' filter, the products of columns, and a chain that is cubic in the state at a node.
    products = model.order_of_column.size**2 * (2 * model.poles - 1)
    work = samples * (700 + products + 5 * model.state_size**3 / exact_length(model, samples))
    length = block_length(model, samples, task.rtol)
    scattered = not whole and max(scattered_share(seen, length) for seen in patterns) > task.rtol
    return "exact" if work <= EXACT_WORK or length < SHORTEST_BLOCK or scattered or blurs(model) else "fast"


def _never_settles(task: _Task, *, whole: bool) -> str:
    """Say why the filter's gains never settle, if so."""
    model = task.model
    if not whole:
        return "samples are missing, which opens the covariance again"
    if model.bandwidth.shape[1] > 1:
        return "the bandwidth varies, and the gains with it"
    if task.ripple > LARGEST_RIPPLE:
        return (
            f"orders come so close, to one another, to zero or to half of the rate, that settled gains would be off by "
            f"{task.ripple:.2g} of the filter's own error, above {LARGEST_RIPPLE:g}"
        )
    return ""


def _run(method: Method, task: _Task, x: Floats, seen: NDArray[np.bool_], startup: int) -> Estimate:
    model, every = task.model, task.output_every
    try:
        if method == "fast" and task.estimator == "filter":
            return steady_state_filter(model, x, output_every=every, startup=startup, error_bound=task.ripple)
        if method == "exact" and task.estimator == "filter":
            return covariance_filter(model, x, output_every=every, startup=startup, keep=task.innovations)
        if method == "fast":
            length = block_length(model, seen.size, task.rtol)
            estimate: Estimate = fast(
                model, x, seen, length=length, output_every=every, startup=startup, coupled=task.coupled,
                tolerance=task.rtol,
            )  # fmt: skip
        elif method == "exact":
            estimate = exact(
                model, x, seen, output_every=every, startup=startup, keep=task.innovations,
                noise_variance=task.noise_variance,
            )  # fmt: skip
        else:
            from signals.harmonics import reference  # noqa: PLC0415  (filterpy is for the oracle alone)

            return reference.track(model, x, estimator=task.estimator, output_every=every, startup=startup)
    except np.linalg.LinAlgError as error:
        raise lost(model, method) from error
    if not estimate.variance.min() > 0:
        raise lost(model, method)
    return estimate


def squeeze(values: Any, one: bool) -> Any:  # noqa: ANN401
    """Leave out the axis of channels, where there is one without it."""
    if not one:
        return values
    return values[0] if values.ndim > 1 else float(values[0])
