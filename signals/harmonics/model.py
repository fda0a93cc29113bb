"""What the trackers estimate: harmonics of shaft angles whose complex amplitudes drift slowly.

The record is `y[n] = sum_k Re{ Z_k[n] exp(j order_k phase_k[n]) } + v[n]` with white noise v of variance R:
one real measurement a sample, `cos` on the real and `-sin` on the imaginary parts. Each of these quadratures
is a `poles`-fold integrated random walk: its `poles`-th backward difference w is white with variance q. The
state, (level, first difference, ...), is moved on by an upper triangle of ones and driven by a vector of
ones times w.

How q follows from the bandwidth is told in `bandwidth`. All but the scale of the uncertainty depends on q / R
only, so the estimators work with R = 1.
"""

from dataclasses import dataclass, field
from enum import IntFlag
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._phasors import PhasorPlan
from signals.harmonics.bandwidth import process_variance

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Indices = NDArray[np.int64]
Order = tuple[str, float] | float
Estimator = Literal["smoother", "filter"]
Method = Literal["exact", "fast", "reference"]
BandwidthUnits = Literal["hz", "orders"]

# Standard deviations of the noise: wide enough to be forgotten at once (over m samples it moves an amplitude
# by 2e-6 / m of itself), narrow enough that its square does not drown what follows in rounding.
PRIOR_STD = 1e3
LAGS = 20  # of the autocorrelation of the innovations


class OutputFlag(IntFlag):
    """Why an output says less than its neighbours; combined where several hold."""

    NONE = 0
    NEAR_END = 1  # within half of 1 / bandwidth of the first sample or, smoother only, of the last
    NEAR_GAP = 2  # so near to missing samples that a quarter or more of what should tell it is not there
    NOT_SEPARABLE = 4  # within half a bandwidth of another order, or less than a turn from it in the whole record
    ONE_QUADRATURE = 8  # within half a bandwidth of its own image: the shaft at rest, or the order at half the rate


class UnresolvedPair(NamedTuple):
    """Two orders, by their places, that lie within half a bandwidth of each other for a share of the record."""

    first: int
    second: int
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderTracks:
    """Complex amplitudes of shaft harmonics and how sure they are.

    The harmonic is `Re{ Z exp(j order phase) }`: `abs(Z)` is its peak amplitude in the units of the record,
    `angle(Z)` its phase where the shaft's phase is zero. The amplitude of order 0, the mean, is real. A record
    of several channels gives a leading axis `channel`; one of a single dimension gives none.

    Attributes
    ----------
    complex_amplitude : ([channel,] order, output) array, Z.
    settling_variance : ([channel,] order, settling) array, mean variance of the two parts of an amplitude where R = 1,
        of the first outputs: it has settled at the last of these. Of all outputs, but for a filter with settled
        gains; for the fast smoother at its knots.
    std_spacing : samples from one of these to the next where they are those at knots; None where of outputs.
    angle_std : (order, output or 1) array, standard deviation of `order phase_rad`; None where that is taken as known.
    flags : (order, output) array of `OutputFlag`.
    orders : (order,) array, cycles per revolution of the order's own shaft.
    shafts : name of each order's shaft; empty where one unnamed phase was given.
    bandwidth : (order,) array, full -3 dB width of the steady-state smoother, as given; the mean where it varies.
    bandwidth_units : "hz" or "orders".
    unresolved : the pairs of orders, by their places, that are not separable with this bandwidth and length.
    poles : how many times the random walk is integrated.
    estimator : "smoother" (all samples) or "filter" (this sample and those before it).
    method : "exact", "fast" or "reference": the one that ran.
    error_bound : what "fast" may add or take; 0 for the others. The smoother: as a part of the largest amplitude among
        those that disturb one another; infinite where lines stay within half a bandwidth of each other and poles are
        several: `std`, too, is too small there. The filter: as a part of the exact filter's own error, noise and lag.
    noise_variance : ([channel,]) R, as given or as estimated from the record.
    innovation_variance : ([channel,]) R times the geometric mean, after start-up, of the variance of the innovation
        (the error of the prediction of the next sample) where R = 1.
    innovation_mean_square : ([channel,]) mean, after start-up, of the squared innovations over their variances: near
        1 when a given R and the bandwidths suit the record, 1 by construction where R was estimated.
    innovation_autocorrelation : ([channel,] lag) array, of the innovations at lags from one sample on; "fast" takes
        the smoother's residuals instead.
    whiteness : ([channel,]) mean of the squared autocorrelation times the samples it was taken from: near 1 where
        the innovations are white, above where the record holds lines or bands that no order explains.
    samples : how many samples the record has.
    output_every : samples from one output to the next.
    first_output : the sample of the first output.
    innovations : ([channel,] sample) array where asked for: what each sample adds to its prediction from those before
        it, in the unit of the record; NaN where it is missing.
    normalised_innovation_squared : of the same shape: their squares over their variances. Where the model holds, each
        is a draw of chi squared with one degree of freedom.
    """

    complex_amplitude: Complexes = field(metadata={"dims": ("channel", "order", "output"), "units": "signal"})
    settling_variance: Floats = field(metadata={"dims": ("channel", "order", "settling"), "units": "1"})
    flags: NDArray[np.uint8] = field(metadata={"dims": ("order", "output"), "units": "1"})
    orders: Floats = field(metadata={"dims": ("order",), "units": "1"})
    bandwidth: Floats = field(metadata={"dims": ("order",), "units": "as bandwidth_units"})
    innovation_autocorrelation: Floats = field(metadata={"dims": ("channel", "lag"), "units": "1"})
    bandwidth_units: BandwidthUnits
    shafts: tuple[str, ...]
    unresolved: tuple[UnresolvedPair, ...]
    poles: int
    estimator: Estimator
    method: Method
    error_bound: float
    noise_variance: float | Floats
    innovation_variance: float | Floats
    innovation_mean_square: float | Floats
    whiteness: float | Floats
    samples: int
    output_every: int
    first_output: int = 0
    std_spacing: int | None = None
    angle_std: Floats | None = field(default=None, metadata={"dims": ("order", "output"), "units": "rad"})
    innovations: Floats | None = field(default=None, metadata={"dims": ("channel", "sample"), "units": "signal"})
    normalised_innovation_squared: Floats | None = field(
        default=None, metadata={"dims": ("channel", "sample"), "units": "1"}
    )

    @cached_property
    def sample_index(self) -> Indices:
        """(output,) array, the sample each output belongs to."""
        return np.arange(self.first_output, self.samples, self.output_every)

    @cached_property
    def std(self) -> Floats:
        """([channel,] order, output) array, `sqrt(E|Zhat - Z|^2 / 2)`; for order 0 that of the real part.

        Made from `settling_variance`, the noise and `angle_std` when it is first asked for.
        """
        known = self.settling_variance * np.asarray(self.noise_variance)[..., None, None]
        std = _spread(np.sqrt(known, out=known), self.std_spacing, self.sample_index)
        if self.angle_std is not None:
            np.sqrt(std**2 + (self.angle_std * np.abs(self.complex_amplitude)) ** 2 / 2, out=std)
        return std


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicModel:
    """The state-space model with R = 1, one state column per observable quadrature.

    Columns are the real parts of all orders, then the imaginary parts of the non-zero ones.

    Attributes
    ----------
    orders : (order,) array, cycles per revolution.
    shaft : (order,) array, which phase each order counts.
    phases : for each shaft, the (sample,) array of its angle in rad.
    bandwidth : (order, sample) array, or (order, 1) where it is constant: full -3 dB width of the smoother in cycles
        a sample.
    poles : how many times the random walk is integrated.
    prior_std : standard deviation of a quadrature before the first sample, in those of the noise.
    """

    orders: Floats
    shaft: Indices
    phases: tuple[Floats, ...]
    bandwidth: Floats
    poles: int
    prior_std: float

    @cached_property
    def turning(self) -> Indices:
        """Indices of the non-zero orders: those with an imaginary part."""
        return np.flatnonzero(self.orders)

    @cached_property
    def order_of_column(self) -> Indices:
        """Index of the order each column belongs to."""
        return np.concatenate([np.arange(self.orders.size), self.turning])

    @cached_property
    def plan(self) -> PhasorPlan:
        """How to make the phasors of all orders."""
        return PhasorPlan.of(self.orders, self.shaft)

    @property
    def state_size(self) -> int:
        """Numbers in the state."""
        return self.poles * self.order_of_column.size

    def subset(self, orders: Indices) -> "HarmonicModel":
        """Return the model of some of the orders."""
        return HarmonicModel(
            orders=self.orders[orders],
            shaft=self.shaft[orders],
            phases=self.phases,
            bandwidth=self.bandwidth[orders],
            poles=self.poles,
            prior_std=self.prior_std,
        )

    def phase(self, samples: slice | Indices) -> Floats:
        """(shaft, sample) array of angles in rad."""
        if len(self.phases) == 1:
            return self.phases[0][None, samples]  # nothing is copied
        return np.stack([phase[samples] for phase in self.phases])

    def regressors(self, samples: slice | Indices) -> Floats:
        """(sample, column) array of what multiplies the levels in these samples."""
        angle = self.orders * self.phase(samples)[self.shaft].T
        return np.concatenate([np.cos(angle), -np.sin(angle[:, self.turning])], axis=1)

    def walk_variance(self, samples: slice = slice(None), *, step: float = 1.0) -> Floats:
        """(sample or 1, column) array: q of a walk that takes one step for every `step` samples, same bandwidth."""
        bandwidth = self.bandwidth if self.bandwidth.shape[1] == 1 else self.bandwidth[:, samples]
        # A band as wide as the rate of the steps lets everything through; so does any wider one.
        q = process_variance(
            orders=self.orders[:, None],
            bandwidth=np.minimum(bandwidth * step, 1.0),
            rate=1.0,
            poles=self.poles,
            noise_variance=1.0 / step,
        )
        return np.ascontiguousarray(q[self.order_of_column].T)

    def prior_variance(self, *, step: float = 1.0) -> Floats:
        """(pole, column) array: of the levels and, smaller with the bandwidth, of their differences."""
        power = 2 * np.arange(self.poles)[:, None]
        turn = 2 * np.pi * step * self.bandwidth.max(axis=1)[self.order_of_column]
        return np.asarray(self.prior_std**2 * turn**power)

    def amplitude(self, levels: Floats) -> Complexes:
        """(order, output) complex amplitudes of (output, column) levels."""
        z = levels[:, : self.orders.size].T.astype(np.complex128)
        z[self.turning] += 1j * levels[:, self.orders.size :].T
        return z

    def variance(self, variances: Floats) -> Floats:
        """(order, output) means over the quadratures of (output, column) variances."""
        mean = variances[:, : self.orders.size].T.copy()
        mean[self.turning] += variances[:, self.orders.size :].T
        mean[self.turning] /= 2
        return mean


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What a method makes of a `HarmonicModel` and a record, for noise of unit variance.

    Attributes
    ----------
    amplitude : (channel, order, output) array.
    variance : (order, output) array, mean over the quadratures; the last one is that of all outputs after it.
    innovation_mean_square : (channel,) array, mean of the squared innovations over their variances, after start-up.
    innovation_log_variance : mean of the logarithm of these variances.
    innovation_autocorrelation : (channel, lag) array.
    innovation_samples : how many samples it was taken from.
    error_bound : part of an amplitude by which the estimate may be off; of its own error, for a settled filter.
    innovations : (channel, sample) array, over their standard deviations, 0 where missing; where asked for.
    innovation_roots : (sample,) array, one over these standard deviations, 0 where missing; where asked for.
    """

    amplitude: Complexes
    variance: Floats
    innovation_mean_square: Floats
    innovation_log_variance: float
    innovation_autocorrelation: Floats
    innovation_samples: int
    error_bound: float = 0.0
    innovations: Floats | None = None
    innovation_roots: Floats | None = None

    @property
    def std_spacing(self) -> int | None:
        """Samples from one variance to the next where they are not those of outputs."""
        return None


def _spread(values: Floats, spacing: int | None, sample_index: Indices) -> Floats:
    """Return standard deviations at all outputs: linear between those `spacing` samples apart, or the last one held."""
    if spacing is None:
        return _held(values, sample_index.size)
    from signals.harmonics._block_kernels import evaluate  # noqa: PLC0415  (for the fast smoother alone)

    pieces = np.zeros((*values.shape[:-1], values.shape[-1] - 1, 4))
    pieces[..., 0], pieces[..., 1] = values[..., :-1], np.diff(values)
    spread = np.empty((*values.shape[:-1], sample_index.size))
    every = int(sample_index[1]) if sample_index.size > 1 else 1
    evaluate(pieces.reshape(-1, *pieces.shape[-2:]), spacing, every, spread.reshape(-1, sample_index.size))
    return spread


def _held(values: Floats, outputs: int) -> Floats:
    """Return values of the first outputs, along the last axis, with the last one held for the outputs after them."""
    after = outputs - values.shape[-1]
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, after)], mode="edge") if after else values


def lost(model: HarmonicModel, method: Method) -> FloatingPointError:
    """Return what is raised where a covariance has lost its digits."""
    return FloatingPointError(
        f"method={method!r}: the covariance is not positive definite in double precision, with poles={model.poles}, "
        f"a narrowest bandwidth of {model.bandwidth.max(axis=1).min():.3g} cycles a sample and a prior of "
        f"{model.prior_std:.3g} standard deviations of the noise; take fewer poles, a lower rate, a wider bandwidth or "
        "a smaller initial_std."
    )
