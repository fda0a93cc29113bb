"""What the trackers estimate: harmonics of shaft angles whose complex amplitudes drift slowly.

The record is `y[n] = sum_k Re{ Z_k[n] exp(j order_k phase_k[n]) } + v[n]` with white noise v of variance R:
one real measurement a sample, `cos` on the real and `-sin` on the imaginary parts. Each of these quadratures
is a `poles`-fold integrated random walk: its `poles`-th backward difference w is white with variance q. The
state, (level, first difference, ...), is moved on by an upper triangle of ones and driven by a vector of
ones times w.

Averaged over a turn, a quadrature of a non-zero order sees the noise 2 R; the mean (order 0) has one
observable quadrature, which sees R. With N for either, the steady-state smoother of an isolated order
multiplies the envelope by `H(w) = 1 / (1 + (N / q) (2 sin(w / 2))^(2 poles))`, w in rad a sample: the envelope
filter of Vold and Leuridan [1]_. The bandwidth is its full width, from one side of the line to the other,
between the points where H has fallen to 1 / sqrt(2). They lie at `w = pi bandwidth / rate`, so
`q = N (2 sin(pi bandwidth / (2 rate)))^(2 poles) / (sqrt(2) - 1)`. All but the scale of the uncertainty
depends on q / R only, so the estimators work with R = 1.

References
----------
.. [1] H. Vold, J. Leuridan, "High resolution order tracking at extreme slew rates, using Kalman tracking
   filters", SAE 931288, 1993.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import nearest, number, positive

Floats = NDArray[np.float64]
Order = tuple[str, float] | float
Estimator = Literal["smoother", "filter"]
Method = Literal["exact", "fast", "reference"]
BandwidthUnits = Literal["hz", "orders"]

HALF_POWER = np.sqrt(2) - 1
MOST_POLES = 4
# Standard deviations of the noise: wide enough to be forgotten at once (over m samples it moves an amplitude
# by 2e-6 / m of itself), narrow enough that its square does not drown what follows in rounding.
PRIOR_STD = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderTracks:
    """Complex amplitudes of shaft harmonics and how sure they are.

    The harmonic is `Re{ Z exp(j order phase) }`: `abs(Z)` is its peak amplitude in the units of the record,
    `angle(Z)` its phase where the shaft's phase is zero. The amplitude of order 0, the mean, is real.

    Attributes
    ----------
    complex_amplitude : (order, output) array, Z.
    std : (order, output) array, `sqrt(E|Zhat - Z|^2 / 2)`; for order 0 that of the real part.
    sample_index : (output,) array, the sample each output belongs to.
    orders : (order,) array, cycles per revolution of the order's own shaft.
    shafts : name of each order's shaft; empty where one unnamed phase was given.
    bandwidth : (order,) array, full -3 dB width of the steady-state smoother, as given.
    bandwidth_units : "hz" or "orders".
    poles : how many times the random walk is integrated.
    estimator : "smoother" (all samples) or "filter" (this sample and those before it).
    method : "exact", "fast" or "reference": the one that ran.
    noise_variance : R, as given or as estimated from the innovations.
    innovation_variance : R times the geometric mean, after start-up, of the variance of the innovation (the
        error of the prediction of the next sample) where R = 1.
    innovation_mean_square : mean, after start-up, of the squared innovations over their variances: near 1
        when a given R and the bandwidths suit the record, 1 by construction where R was estimated.
    """

    complex_amplitude: NDArray[np.complex128] = field(metadata={"dims": ("order", "output"), "units": "signal"})
    std: Floats = field(metadata={"dims": ("order", "output"), "units": "signal"})
    sample_index: NDArray[np.int64] = field(metadata={"dims": ("output",), "units": "1"})
    orders: Floats = field(metadata={"dims": ("order",), "units": "1"})
    bandwidth: Floats = field(metadata={"dims": ("order",), "units": "as bandwidth_units"})
    bandwidth_units: BandwidthUnits
    shafts: tuple[str, ...]
    poles: int
    estimator: Estimator
    method: Method
    noise_variance: float
    innovation_variance: float
    innovation_mean_square: float


def process_variance(
    *, orders: ArrayLike, bandwidth: ArrayLike, rate: float, poles: int, noise_variance: float
) -> Floats:
    """Variance of the white `poles`-th difference that gives the smoother a bandwidth.

    Parameters
    ----------
    orders : (order,) array; only whether an order is zero matters.
    bandwidth : (order,) array or number, full -3 dB width of the smoother, in Hz or in orders.
    rate : samples per second (bandwidth in Hz) or per revolution (bandwidth in orders).
    poles : how many times the random walk is integrated.
    noise_variance : variance R of the white noise in the record, signal units squared.

    Returns
    -------
    (order,) array, q of each quadrature in signal units squared per sample.
    """
    sine = np.sin(0.5 * np.pi * np.asarray(bandwidth, dtype=np.float64) / rate)
    return np.asarray(_noise_seen(orders, noise_variance) * (2 * sine) ** (2 * poles) / HALF_POWER)


def smoother_bandwidth(
    *, orders: ArrayLike, process_variance: ArrayLike, rate: float, poles: int, noise_variance: float
) -> Floats:
    """Full -3 dB width of the smoother that a white `poles`-th difference of this variance gives.

    The inverse of the function `process_variance`, where the parameters are explained.

    Returns
    -------
    (order,) array in the units of `rate`; NaN where even half of the rate is passed with less than 3 dB.
    """
    ratio = np.asarray(process_variance) / _noise_seen(orders, noise_variance)
    sine = 0.5 * (HALF_POWER * ratio) ** (0.5 / poles)
    width = np.arcsin(np.minimum(sine, 1.0)) * (2 * rate / np.pi)
    return np.where(sine <= 1.0, width, np.nan)


def _noise_seen(orders: ArrayLike, noise_variance: float) -> Floats:
    return np.where(np.asarray(orders, dtype=np.float64) == 0.0, 1.0, 2.0) * noise_variance


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicModel:
    """The state-space model with R = 1, one state column per observable quadrature.

    Columns are the real parts of all orders, then the imaginary parts of the non-zero ones.

    Attributes
    ----------
    orders : (order,) array, cycles per revolution.
    phases : for each order, the (sample,) array of its shaft's angle in rad.
    bandwidth : (order,) array, full -3 dB width of the smoother in cycles a sample.
    poles : how many times the random walk is integrated.
    prior_std : standard deviation of a quadrature before the first sample, in those of the noise.
    """

    orders: Floats
    phases: tuple[Floats, ...]
    bandwidth: Floats
    poles: int
    prior_std: float

    @property
    def turning(self) -> NDArray[np.int64]:
        """Indices of the non-zero orders: those with an imaginary part."""
        return np.flatnonzero(self.orders)

    @property
    def order_of_column(self) -> NDArray[np.int64]:
        """Index of the order each column belongs to."""
        return np.concatenate([np.arange(self.orders.size), self.turning])

    @property
    def state_size(self) -> int:
        """Numbers in the state."""
        return self.poles * self.order_of_column.size

    def regressors(self, samples: slice | NDArray[np.int64]) -> Floats:
        """Return what multiplies the levels in these samples: an array of their shape by column."""
        angle = np.stack([o * p[samples] for o, p in zip(self.orders, self.phases, strict=True)], axis=-1)
        return np.concatenate([np.cos(angle), -np.sin(angle[..., self.turning])], axis=-1)

    def walk_variance(self, *, step: float = 1.0) -> Floats:
        """(column,) array: q of a walk that takes one step for every `step` samples, same bandwidth."""
        q = process_variance(
            orders=self.orders,
            bandwidth=self.bandwidth * step,
            rate=1.0,
            poles=self.poles,
            noise_variance=1.0 / step,
        )
        return q[self.order_of_column]

    def prior_variance(self, *, step: float = 1.0) -> Floats:
        """(pole, column) array: of the levels and, smaller with the bandwidth, of their differences."""
        power = 2 * np.arange(self.poles)[:, None]
        turn = 2 * np.pi * step * self.bandwidth[self.order_of_column]
        return np.asarray(self.prior_std**2 * turn**power)

    def amplitude(self, levels: Floats) -> NDArray[np.complex128]:
        """(order, output) complex amplitudes of (output, column) levels."""
        z = levels[:, : self.orders.size].T.astype(np.complex128)
        z[self.turning] += 1j * levels[:, self.orders.size :].T
        return z

    def std(self, variances: Floats) -> Floats:
        """(order, output) standard deviations of (output, column) variances, mean over the quadratures."""
        mean = variances[:, : self.orders.size].T.copy()
        mean[self.turning] += variances[:, self.orders.size :].T
        mean[self.turning] /= 2
        return np.sqrt(mean)


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What a method makes of a `HarmonicModel` and a record, for noise of unit variance.

    Attributes
    ----------
    levels : (output, column) array.
    variances : (output, column) array.
    innovation_mean_square : mean of the squared innovations over their variances, after start-up.
    innovation_log_variance : mean of the logarithm of these variances.
    """

    levels: Floats
    variances: Floats
    innovation_mean_square: float
    innovation_log_variance: float


def check_samples(x: ArrayLike) -> Floats:
    """Return the record as a (sample,) array of floats, NaN where a sample is missing, or refuse it."""
    values = _real_array("x", x)
    observed = ~np.isnan(values)
    if not observed.any():
        raise ValueError(
            f"x has {values.size} samples, all of them missing (NaN); at least one observed sample is needed."
        )
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        raise ValueError(
            f"x[{infinite[0]}]={values[infinite[0]]} (and {infinite.size - 1} more) is infinite; "
            "samples must be finite, or NaN where missing: mark bad samples as NaN."
        )
    return values


def check_orders(
    orders: Sequence[Order] | NDArray[np.float64],
    phase_rad: ArrayLike | Mapping[str, ArrayLike],
    *,
    samples: int,
) -> tuple[Floats, tuple[str, ...], tuple[Floats, ...]]:
    """Return the orders, their shafts' names (none for a single phase) and their phases, one an order."""
    if isinstance(orders, str | bytes | Mapping) or not np.iterable(orders):
        raise ValueError(f"orders={orders!r}: needed a sequence of orders, such as [1, 2, 36].")
    if len(orders) == 0:
        raise ValueError("orders is empty; name at least one order to track, such as orders=[1].")
    if isinstance(phase_rad, Mapping):
        pairs = [_shaft_and_order(item, phase_rad) for item in orders]
        angles = {name: _phase(f"phase_rad[{name!r}]", phase_rad[name], samples) for name, _ in pairs}
    else:
        pairs = [("", _order(item)) for item in orders]
        angles = {"": _phase("phase_rad", phase_rad, samples)}
    _check_distinct(pairs)
    _check_below_half_rate(pairs, angles)
    names = tuple(name for name, _ in pairs) if isinstance(phase_rad, Mapping) else ()
    return np.array([order for _, order in pairs]), names, tuple(angles[name] for name, _ in pairs)


def check_bandwidth(
    *,
    bandwidth_hz: ArrayLike | None,
    bandwidth_orders: ArrayLike | None,
    rate_hz: float | None,
    samples_per_rev: float | None,
    orders: int,
) -> tuple[Floats, float, BandwidthUnits]:
    """Return the (order,) bandwidths, the rate that goes with them and the bandwidths' units."""
    given = {
        "bandwidth_hz": bandwidth_hz,
        "bandwidth_orders": bandwidth_orders,
        "rate_hz": rate_hz,
        "samples_per_rev": samples_per_rev,
    }
    names = [name for name, value in given.items() if value is not None]
    if names not in (["bandwidth_hz", "rate_hz"], ["bandwidth_orders", "samples_per_rev"]):
        raise ValueError(
            f"bandwidth and rate: {', '.join(names) or 'none'} given; needed either bandwidth_hz with rate_hz or "
            "bandwidth_orders with samples_per_rev: pass one whole pair and leave the other out."
        )
    rate = positive(given[names[1]], name=names[1])
    width = np.atleast_1d(_real_array(names[0], given[names[0]], dims=(0, 1)))
    if width.size not in (1, orders):
        raise ValueError(
            f"{names[0]} has {width.size} values for {orders} orders; pass one number for all, or one each."
        )
    for value in width:
        if not 0 < value < rate / 2:
            raise ValueError(
                f"{names[0]}={value:g} must be above 0 and below {rate / 2:g}, half of {names[1]}={rate:g}; "
                "choose one in between."
            )
    units: BandwidthUnits = "hz" if names[0] == "bandwidth_hz" else "orders"
    return np.broadcast_to(width, orders).copy(), rate, units


def _real_array(name: str, value: ArrayLike | None, *, dims: tuple[int, ...] = (1,)) -> Floats:
    array = np.asarray(value)
    if array.dtype == object:
        # Fractions arrive as objects; anything else that is not a number is caught here by name.
        array = np.array([number(item, name=name) for item in array.flat]).reshape(array.shape)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} holds {array.dtype} values; real numbers are needed.")
    if array.ndim not in dims:
        raise ValueError(
            f"{name} has shape {array.shape}; needed {'a number or ' if 0 in dims else ''}one dimension: "
            f"pass {name} as a plain sequence of numbers."
        )
    if array.size == 0:
        raise ValueError(f"{name} is empty; at least one value is needed.")
    return np.ascontiguousarray(array, dtype=np.float64)


def _phase(name: str, value: ArrayLike, samples: int) -> Floats:
    phase = _real_array(name, value)
    if phase.size != samples:
        raise ValueError(f"{name} has {phase.size} values for {samples} samples of x; give one angle per sample.")
    bad = np.flatnonzero(~np.isfinite(phase))
    if bad.size:
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


def _label(shaft: str, order: float) -> str:
    return f"order {order:g} of {shaft!r}" if shaft else f"order {order:g}"


def _check_distinct(pairs: list[tuple[str, float]]) -> None:
    seen = set()
    for shaft, order in pairs:
        # Order 0 of any shaft is the same mean.
        key = (shaft, order) if order else ("", 0.0)
        if key in seen:
            raise ValueError(f"{_label(shaft, order)} is listed twice; one line cannot be shared out: list it once.")
        seen.add(key)


def _check_below_half_rate(pairs: list[tuple[str, float]], phases: Mapping[str, Floats]) -> None:
    advance = {shaft: _fastest(phase) for shaft, phase in phases.items()}
    for shaft, order in pairs:
        step, at = advance[shaft]
        if order * step > np.pi:
            raise ValueError(
                f"{_label(shaft, order)} turns by {order * step:.4g} rad between samples {at} and {at + 1}; more "
                "than pi is above half of the rate: drop the order, raise the rate, or mend the phase there."
            )


def _fastest(phase: Floats) -> tuple[float, int]:
    """Return the largest turn between neighbouring samples and where it starts."""
    if phase.size == 1:
        return 0.0, 0
    step = np.diff(phase)
    np.abs(step, out=step)
    at = int(step.argmax())
    return float(step[at]), at
