"""The door to the trackers: checks what comes in, picks the method, scales what comes out."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import choice, positive, whole
from signals.harmonics.kalman import block_length, exact, fast
from signals.harmonics.model import (
    MOST_POLES,
    PRIOR_STD,
    Estimate,
    Estimator,
    Floats,
    HarmonicModel,
    Method,
    Order,
    OrderTracks,
    check_bandwidth,
    check_orders,
    check_samples,
)

# With fewer samples a block, condensing them gains nothing.
SHORTEST_BLOCK = 12
# Multiplications, about a third of a nanosecond each, that the exact method may take where "auto" chooses.
EXACT_WORK = 3e9


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
    noise_variance: float | None = None,
    initial_std: float | None = None,
) -> OrderTracks:
    """Estimate the complex amplitudes of all orders together, each output with its standard deviation.

    Orders are told apart by what they do to the record: close and crossing ones share out their energy, and
    `std` grows where they cannot be told apart.

    Parameters
    ----------
    x : (sample,) array, the record in any unit; NaN marks a missing sample.
    phase_rad : (sample,) array, shaft angle in rad, or a mapping from shaft name to such an array.
    orders : cycles per revolution, one number an order; with a mapping, (shaft, order) pairs. 0 is the mean.
    bandwidth_hz : full -3 dB width of the smoother in Hz, one for all orders or one each; with `rate_hz`.
    bandwidth_orders : the same in cycles per revolution; with `samples_per_rev`.
    rate_hz : samples per second.
    samples_per_rev : samples per revolution, for a record sampled in angle.
    poles : 1 to 4, how many times the amplitudes' random walk is integrated: more make a flatter passband
        with steeper sides.
    estimator : "smoother" uses all samples for each output; "filter" this one and those before it, and at the
        same `bandwidth` is wider.
    method : "exact" takes every sample in turn. "fast", smoother only, condenses blocks of a 200th of
        1 / (widest bandwidth) and interpolates linearly between their centres; in noise it differs from exact by
        about a hundredth of `std`, and for an envelope at the edge of the bandwidth by 1/400 of it at worst,
        by some 1e-4 in most records. "reference" is exact, on filterpy, hundreds of times slower. "auto" takes
        exact where that lasts about a second or blocks would be too short, else fast. The result says which.
    output_every : samples from one output to the next. An exact output costs as much as five samples.
    noise_variance : variance R of the white noise in `x`; estimated from the innovations unless given.
    initial_std : standard deviation of each part of an amplitude about zero before the first sample, in the unit
        of `x`; needs `noise_variance`. Of the i-th difference it is `initial_std (2 pi bandwidth / rate)^i`.
        Default 1000 standard deviations of the noise: it no longer matters a few samples on.

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
    record = check_samples(x)
    order_numbers, shafts, phases = check_orders(orders, phase_rad, samples=record.size)
    bandwidth, rate, units = check_bandwidth(
        bandwidth_hz=bandwidth_hz,
        bandwidth_orders=bandwidth_orders,
        rate_hz=rate_hz,
        samples_per_rev=samples_per_rev,
        orders=order_numbers.size,
    )
    choice(estimator, name="estimator", choices=("smoother", "filter"))
    choice(method, name="method", choices=("auto", "exact", "fast", "reference"))
    model = HarmonicModel(
        orders=order_numbers,
        phases=phases,
        bandwidth=bandwidth / rate,
        poles=whole(poles, name="poles", least=1, most=MOST_POLES),
        prior_std=_prior_std(initial_std, noise_variance),
    )
    every = whole(output_every, name="output_every", least=1)
    startup = _startup(model, record, estimate_noise=noise_variance is None)
    chosen = _choose(method, model, record.size, estimator=estimator, output_every=every)
    estimate = _run(chosen, model, record, estimator=estimator, output_every=every, startup=startup)
    noise = estimate.innovation_mean_square if noise_variance is None else float(noise_variance)
    return OrderTracks(
        complex_amplitude=model.amplitude(estimate.levels),
        std=model.std(estimate.variances) * np.sqrt(noise),
        sample_index=np.arange(0, record.size, every),
        orders=order_numbers,
        shafts=shafts,
        bandwidth=bandwidth,
        bandwidth_units=units,
        poles=model.poles,
        estimator=estimator,
        method=chosen,
        noise_variance=noise,
        innovation_variance=noise * float(np.exp(estimate.innovation_log_variance)),
        innovation_mean_square=1.0 if noise_variance is None else estimate.innovation_mean_square / noise,
    )


def _prior_std(initial_std: float | None, noise_variance: float | None) -> float:
    """Return the prior's standard deviation in those of the noise."""
    noise = None if noise_variance is None else positive(noise_variance, name="noise_variance")
    if initial_std is None:
        return PRIOR_STD
    std = positive(initial_std, name="initial_std")
    if noise is None:
        raise ValueError(
            f"initial_std={std:g} weighs against the noise, whose variance is not given; "
            "pass noise_variance too, or neither."
        )
    return float(std / np.sqrt(noise))


def _startup(model: HarmonicModel, x: Floats, *, estimate_noise: bool) -> int:
    """First sample whose innovation counts: after the smoother's memory, or halfway in a short record."""
    observed = np.flatnonzero(~np.isnan(x))
    needed = 2 * model.state_size
    if estimate_noise and observed.size < needed:
        raise ValueError(
            f"x has {observed.size} observed samples; to estimate the noise beside {model.orders.size} orders "
            f"with poles={model.poles}, {needed} are needed: pass noise_variance, or more samples."
        )
    memory = ceil(1 / model.bandwidth.min()) + model.state_size
    return int(observed[min(memory, observed.size // 2)])


def _choose(
    method: Method | Literal["auto"],
    model: HarmonicModel,
    samples: int,
    *,
    estimator: Estimator,
    output_every: int,
) -> Method:
    if method == "fast" and estimator == "filter":
        raise ValueError(
            'method="fast" with estimator="filter": a block holds samples after the output, so its estimate '
            'is not causal; use method="exact" or estimator="smoother".'
        )
    if method != "auto":
        return method
    # Measured: an output costs what five samples do, and every sample its share of the trigonometry.
    work = (samples + 5 * samples / output_every) * (1000 + model.order_of_column.size * model.state_size**2)
    short = block_length(model, samples) < SHORTEST_BLOCK
    return "exact" if estimator == "filter" or work <= EXACT_WORK or short else "fast"


def _run(
    method: Method, model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int
) -> Estimate:
    try:
        if method == "fast":
            estimate = fast(model, x, output_every=output_every, startup=startup)
        elif method == "exact":
            estimate = exact(model, x, estimator=estimator, output_every=output_every, startup=startup)
        else:
            from signals.harmonics import reference  # noqa: PLC0415  (filterpy is for the oracle alone)

            estimate = reference.track(model, x, estimator=estimator, output_every=output_every, startup=startup)
    except np.linalg.LinAlgError as error:
        raise _lost(method, model) from error
    if not np.all(estimate.variances > 0):
        raise _lost(method, model)
    return estimate


def _lost(method: Method, model: HarmonicModel) -> FloatingPointError:
    return FloatingPointError(
        f"method={method!r}: the covariance is not positive definite in double precision, with poles={model.poles}, "
        f"a narrowest bandwidth of {model.bandwidth.min():.3g} cycles a sample and a prior of {model.prior_std:.3g} "
        "standard deviations of the noise; take fewer poles, a lower rate, a wider bandwidth or a smaller "
        "initial_std."
    )
