"""Checks of the trackers' arguments: records, phases, orders, bandwidths."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._validation import nearest, number, positive, real_array, whole, writable
from signals.harmonics.bandwidth import MOST_POLES
from signals.harmonics.state_space import PRIOR_STD, Floats, HarmonicModel, Indices, Order

SAMPLES_AT_ONCE = 1 << 15  # so that temporary arrays stay in the cache
# Largest turn between samples in rad. Half the rate itself is allowed; angles of exactly that round to either side.
MOST_TURN = np.pi * (1 + 1e-9)
# Sums of squares of numbers outside this range over- or underflow.
SMALLEST, LARGEST = 1e-120, 1e120
# In cycles per sample: the squares of smaller bandwidths underflow.
NARROWEST = 1e-100


def check_record(x: ArrayLike, *, smallest: float = 0.0) -> Floats:
    """Return the record as a (channel, sample) array of floats, NaN where a sample is missing, or refuse it.

    Where the noise is to be estimated, a channel must reach `SMALLEST`, or be zero.
    """
    values = np.atleast_2d(_real_array("x", x, dims=(1, 2)))
    largest = np.fmax(np.fmax.reduce(values, axis=1), -np.fmin.reduce(values, axis=1))  # NaN where all are missing
    if np.isinf(largest).any():
        infinite = np.argwhere(np.isinf(values))
        place = ", ".join(map(str, infinite[0][-np.ndim(x) :].tolist()))
        raise ValueError(
            f"x[{place}]={values[tuple(infinite[0])]} (and {len(infinite) - 1} more) is infinite; "
            "samples must be finite, or NaN where missing: mark bad samples as NaN."
        )
    lost = np.flatnonzero((largest > LARGEST) | ((largest > 0) & (largest < smallest)))
    if lost.size:
        raise ValueError(
            f"x{f'[{lost[0]}]' if np.ndim(x) > 1 else ''} reaches {largest[lost[0]]:.3g}, whose square is lost in "
            f"double precision; scale the record to a unit in which it reaches between {SMALLEST:g} and {LARGEST:g}, "
            "or mark bad samples as NaN."
        )
    return values


def check_channel(x: ArrayLike, *, smallest: float = 0.0) -> Floats:
    """Return a record of one channel, some of it observed, as a (sample,) array, or refuse it, as `check_record`."""
    channels = check_record(x, smallest=smallest)
    if len(channels) > 1:
        raise ValueError(f"x has {len(channels)} channels; each has estimates of its own: pass one channel at a time.")
    if np.isnan(channels).all():
        raise ValueError(f"x has {channels.size} samples, all of them missing (NaN); at least one is needed.")
    return np.asarray(channels[0])


def check_orders(
    orders: Sequence[Order] | NDArray[np.float64], phase_rad: ArrayLike | Mapping[str, ArrayLike], *, samples: int
) -> tuple[Floats, tuple[str, ...], Indices, tuple[Floats, ...]]:
    """Check orders and phases.

    Returns (order,) orders, the names of their shafts (none for a single phase), (order,) indices of their phases, and
    (sample,) phases in rad, one for each shaft that has an order.
    """
    if isinstance(orders, str | bytes | Mapping) or not np.iterable(orders):
        raise ValueError(f"orders={orders!r}: needed a sequence of orders, such as [1, 2, 36].")
    if len(orders) == 0:
        raise ValueError("orders is empty; name at least one order to track, such as orders=[1].")
    if isinstance(phase_rad, Mapping):
        pairs = [_shaft_and_order(item, phase_rad) for item in orders]
        angles = {name: check_phase(f"phase_rad[{name!r}]", phase_rad[name], samples) for name in dict(pairs)}
    else:
        pairs = [("", _order(item)) for item in orders]
        angles = {"": check_phase("phase_rad", phase_rad, samples)}
    for name, phase in angles.items():
        highest = max(order for shaft, order in pairs if shaft == name)
        check_below_half_rate(f"order {highest:g}{f' of {name!r}' if name else ''}", highest, phase)
    names = tuple(name for name, _ in pairs) if isinstance(phase_rad, Mapping) else ()
    place = {name: number for number, name in enumerate(angles)}
    shaft = np.array([place[name] for name, _ in pairs])
    return np.array([order for _, order in pairs]), names, shaft, tuple(angles.values())


def check_bandwidth(*, shaft: Indices, phases: tuple[Floats, ...], **given: ArrayLike | None) -> tuple[Floats, Floats]:
    """Return the bandwidth of each order, or refuse it; `shaft` and `phases` as `check_orders` returns them.

    Given are, under the names of the caller, a bandwidth in Hz, one in orders, `rate_hz` and `samples_per_rev`, two of
    them None. Returned is the bandwidth in cycles per sample, (order, 1), or (order, sample) where it varies; and as
    the results state it, the (order,) means in the given unit.
    """
    in_hz, in_orders, *_ = given
    names = [name for name, value in given.items() if value is not None]
    if names == [in_hz, "samples_per_rev"]:
        raise ValueError(
            f"{in_hz} with samples_per_rev: a record over angle does not tell its speed; pass {in_orders}, "
            f"which is {in_hz} / shaft speed in Hz, a (1, n) array where the speed varies."
        )
    if names not in ([in_hz, "rate_hz"], [in_orders, "samples_per_rev"], [in_orders, "rate_hz"]):
        raise ValueError(
            f"bandwidth and rate: {', '.join(names) or 'none'} given; needed {in_hz} with rate_hz, or "
            f"{in_orders} with samples_per_rev or rate_hz: pass one of these pairs and leave the others out."
        )
    bandwidth, rate = names
    per_sample = positive(given[rate], name=rate)
    width = _width(given[bandwidth], bandwidth, orders=shaft.size, samples=phases[0].size)
    by_speed = names == [in_orders, "rate_hz"]
    steps = [np.gradient(phase) if phase.size > 1 else np.zeros(1) for phase in phases] if by_speed else []
    cycles = width * (np.abs(np.stack(steps)) / (2 * np.pi))[shaft] if by_speed else width / per_sample
    _check_range(width, cycles, names=(bandwidth, rate), rate=None if by_speed else per_sample)
    return cycles, width.mean(axis=1)


def _width(value: ArrayLike | None, name: str, *, orders: int, samples: int) -> Floats:
    """Return a bandwidth as an (order, 1 or sample) array, or refuse its shape."""
    width = _real_array(name, value, dims=(0, 1, 2))
    if width.ndim < 2:  # noqa: PLR2004
        return per_order(width, name, orders=orders)[:, None]
    if width.shape not in ((1, samples), (orders, samples)):
        raise ValueError(
            f"{name} has shape {width.shape} for {orders} orders and {samples} samples; a bandwidth that varies in "
            f"time needs the shape (1, {samples}) for all orders alike, or ({orders}, {samples})."
        )
    return np.repeat(width, orders, axis=0) if len(width) != orders else width


def per_order(value: ArrayLike | None, name: str, *, orders: int) -> Floats:
    """Return one number for all orders, or one each, as an (order,) array, or refuse its shape."""
    values = _real_array(name, value, dims=(0, 1))
    if values.size not in (1, orders):
        raise ValueError(f"{name} has {values.size} values for {orders} orders; pass one number for all, or one each.")
    return np.resize(values, orders)


def _check_range(width: Floats, cycles: Floats, *, names: tuple[str, str], rate: float | None) -> None:
    """Refuse bandwidths that are not positive, above half of the rate, or too small for double precision."""
    if not np.isfinite(width).all():
        raise ValueError(f"{names[0]} has values that are not finite; give bandwidths below half of the rate.")
    good = (width > 0 if width.shape[1] == 1 else width >= 0) & (cycles < 0.5)  # noqa: PLR2004
    if not good.all():
        order, sample = np.argwhere(~good)[0]
        value = width[order, min(sample, width.shape[1] - 1)]
        below = (
            f"{rate / 2:g}, half of {names[1]}={rate:g}"
            if rate is not None
            else f"{0.5 / cycles[order, sample] * value:g}, half of the rate at the speed of sample {sample}"
            if value > 0
            else "half of the rate"
        )
        raise ValueError(f"{names[0]}={value:g} must be above 0 and below {below}; choose one in between.")
    widest = cycles.max(axis=1)
    if widest.min() < NARROWEST:
        raise ValueError(
            f"{names[0]} is {widest.min():g} cycles a sample at most for order number {int(widest.argmin())}; it must "
            f"reach {NARROWEST:g} somewhere: choose a wider one, or is the shaft at rest?"
        )


def check_model(
    *, orders: Sequence[Order] | NDArray[np.float64], phase_rad: ArrayLike | Mapping[str, ArrayLike], samples: int,
    noise_variance: object, initial_std: object, poles: int, **bandwidth: ArrayLike | None,
) -> tuple[HarmonicModel, tuple[str, ...], Floats, float | None]:  # fmt: skip
    """Return the model, the shafts' names, the bandwidths as results state them and R, or refuse what is wrong."""
    numbers, names, shaft, phases = check_orders(orders, phase_rad, samples=samples)
    cycles, means = check_bandwidth(shaft=shaft, phases=phases, **bandwidth)
    noise = None if noise_variance is None else positive(noise_variance, name="noise_variance")
    prior = PRIOR_STD
    if initial_std is not None:
        std = positive(initial_std, name="initial_std")
        if noise is None:
            raise ValueError(
                f"initial_std={std:g} weighs against the noise, whose variance is not given; pass noise_variance too, "
                "or neither."
            )
        prior = float(std / np.sqrt(noise))
        if not SMALLEST < prior < LARGEST:
            raise ValueError(
                f"initial_std={std:g} is {prior:g} standard deviations of the noise; doubles keep the digits between "
                f"{SMALLEST:g} and {LARGEST:g} of them: choose one in between."
            )
    model = HarmonicModel(
        orders=numbers, shaft=shaft, phases=phases, bandwidth=cycles,
        poles=whole(poles, name="poles", least=1, most=MOST_POLES), prior_std=prior,
    )  # fmt: skip
    return model, names, means, noise


def _real_array(name: str, value: ArrayLike | None, *, dims: tuple[int, ...] = (1,)) -> Floats:
    array = real_array(value, name=name)  # type: ignore[arg-type]
    if array.ndim not in dims:
        raise ValueError(
            f"{name} has shape {array.shape}; needed {'a number or ' if 0 in dims else ''}"
            f"{'one or two dimensions' if 2 in dims else 'one dimension'}: pass {name} as a plain sequence of numbers"  # noqa: PLR2004
            f"{', or one row a channel' if dims == (1, 2) else ''}."
        )
    if array.size == 0:
        raise ValueError(f"{name} is empty; at least one value is needed.")
    return writable(np.ascontiguousarray(array, dtype=np.float64))


def check_phase(name: str, value: ArrayLike, samples: int) -> Floats:
    """Return the (sample,) array of an angle in rad, or refuse it."""
    phase = _real_array(name, value)
    if phase.size != samples:
        raise ValueError(f"{name} has {phase.size} values for {samples} samples of x; give one angle per sample.")
    if not max(phase.max(), -phase.min()) < np.inf:
        bad = np.flatnonzero(~np.isfinite(phase))
        raise ValueError(
            f"{name}[{bad[0]}]={phase[bad[0]]} (and {bad.size - 1} more) is not finite; the angle must be known "
            "at every sample, missing samples included: interpolate it."
        )
    return phase


def _order(item: object) -> float:
    if isinstance(item, tuple):
        raise ValueError(  # noqa: TRY004
            f"order {item!r} names a shaft, but phase_rad is one array; pass a mapping from shaft to phase."
        )
    order = number(item, name="order")
    if order < 0:
        raise ValueError(
            f"order={order:g} is negative; a real record has the same line at {-order:g}, conjugated: track that one."
        )
    return order


def _shaft_and_order(item: object, phases: Mapping[str, ArrayLike]) -> tuple[str, float]:
    if not (isinstance(item, tuple | list) and len(item) == 2 and isinstance(item[0], str)):  # noqa: PLR2004
        raise ValueError(
            f"order {item!r} names no shaft, but phase_rad is a mapping; give (shaft, order) pairs, such as "
            f"({next(iter(phases), 'shaft')!r}, 1)."
        )
    if item[0] not in phases:
        raise ValueError(
            f"order {item!r}: no phase for shaft {item[0]!r}; phase_rad has {', '.join(map(str, phases)) or 'none'}."
            f"{nearest(item[0], [str(name) for name in phases])}"
        )
    return item[0], _order(item[1])


def check_below_half_rate(name: str, order: float, phase: Floats) -> None:
    """Refuse an order, called `name` in the message, that turns by more than pi between two samples."""
    parts = (phase[first : first + SAMPLES_AT_ONCE + 1] for first in range(0, phase.size - 1, SAMPLES_AT_ONCE))
    turn = order * max((float(np.abs(np.diff(part)).max()) for part in parts), default=0.0)
    if turn > MOST_TURN:
        at = int(np.abs(np.diff(phase)).argmax())
        raise ValueError(
            f"{name} turns by {turn:.4g} rad between samples {at} and {at + 1}; more than pi is above half of the "
            "rate: drop it, raise the rate, or mend the phase there."
        )
