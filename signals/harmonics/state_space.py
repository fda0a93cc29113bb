"""The state-space model of the trackers: shaft orders whose complex amplitudes are integrated random walks.

The record is `y[n] = sum_k Re{ Z_k[n] exp(j order_k phase_k[n]) } + v[n]` with white noise v of variance R: one
real measurement a sample, with regressors `cos` for the real and `-sin` for the imaginary parts. Each of these
quadratures is a `poles`-fold integrated random walk: its `poles`-th backward difference w is white with variance q.
The state, (level, first difference, ...), has an upper triangle of ones as transition matrix, and w drives every
part of it. `bandwidth` gives q. All but the scale of the covariance depends on q / R only: the estimators use R = 1.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from signals.harmonics.bandwidth import quadrature_noise, variance_ratio

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Order = tuple[str, float] | float
Estimator = Literal["smoother", "filter"]
Method = Literal["exact", "fast"]

# Prior in standard deviations of the noise: so wide that it biases the amplitude of m samples by 2e-6 / m of itself,
# and so narrow that rounding of its square is negligible.
PRIOR_STD = 1e3
# Angle by which the highest order may differ from a steady turn: the rounding of the angles of long records.
STEADY_RAD = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicModel:
    """The state-space model with R = 1; each column is a quadrature, with a regressor and a random walk.

    Columns are the real parts of all orders, then the imaginary parts of the non-zero ones.
    """

    orders: Floats  # (order,), cycles per revolution
    shaft: Indices  # (order,), index into `phases` of each order's shaft
    phases: tuple[Floats, ...]  # for each shaft, the (sample,) array of its angle in rad
    bandwidth: Floats  # (order, sample), or (order, 1) where constant: -3 dB width of the smoother in cycles per sample
    poles: int  # number of integrations of the random walk
    prior_std: float  # of a quadrature, in standard deviations of the noise

    @cached_property
    def nonzero(self) -> Indices:
        """Indices of the non-zero orders, which have an imaginary part."""
        return np.flatnonzero(self.orders)

    @cached_property
    def order_of_column(self) -> Indices:
        """Index of the order each column belongs to."""
        return np.concatenate([np.arange(self.orders.size), self.nonzero])

    @property
    def state_size(self) -> int:
        """Dimension of the state."""
        return self.poles * self.order_of_column.size

    @property
    def narrowest(self) -> float:
        """Smallest of the orders' bandwidths, each the widest of its record."""
        return float(self.bandwidth.max(axis=1).min())

    @property
    def startup(self) -> int:
        """Samples after which innovations count: one time constant, and as many as the state has numbers."""
        return ceil(1 / self.narrowest) + self.state_size

    @cached_property
    def steady_step(self) -> float | None:
        """Angle of one sample in rad, where it is the same throughout and there is one shaft; None elsewhere."""
        from signals.harmonics._block_kernels import on_line  # noqa: PLC0415 - loads numba

        phase = self.phases[0]
        if len(self.phases) > 1 or phase.size == 1:
            return None
        step, highest = float(phase[-1] - phase[0]) / (phase.size - 1), float(np.abs(self.orders).max(initial=0.0))
        return step if highest == 0 or on_line(phase, step, STEADY_RAD / highest) else None

    @property
    def with_mean(self) -> "HarmonicModel":
        """The model with the mean as its last order, as wide as the narrowest one, if the orders lack it."""
        if not self.orders.all():
            return self
        return replace(
            self, orders=np.append(self.orders, 0.0), shaft=np.append(self.shaft, 0),
            bandwidth=np.concatenate([self.bandwidth, self.bandwidth.min(axis=0, keepdims=True)]),
        )  # fmt: skip

    def subset(self, orders: Indices) -> "HarmonicModel":
        """Return the model of some of the orders."""
        own = {name: getattr(self, name)[orders] for name in ("orders", "shaft", "bandwidth")}
        return replace(self, **own)

    def phase(self, samples: slice | Indices) -> Floats:
        """(shaft, sample) array of angles in rad."""
        if len(self.phases) == 1:
            return self.phases[0][None, samples]  # nothing is copied
        return np.stack([phase[samples] for phase in self.phases])

    def turns(self, samples: Indices) -> Floats:
        """Return the (order, ...) cycles of each order at some samples."""
        return np.asarray(self.orders.reshape(-1, *[1] * samples.ndim) * self.phase(samples)[self.shaft] / (2 * np.pi))

    def regressors(self, samples: slice | Indices) -> Floats:
        """(column, sample) array of regressors: the measurement is their product with the levels."""
        from signals.harmonics._block_kernels import fill_phasors  # noqa: PLC0415 - loads numba

        columns, place = np.empty((self.order_of_column.size + 1, self.phases[0][samples].size)), self.orders.size
        for k, (order, shaft) in enumerate(zip(self.orders.tolist(), self.shaft.tolist(), strict=True)):
            fill_phasors(-order, self.phases[shaft][samples], columns[k], columns[place])
            place += order != 0  # the sine of the mean is overwritten, or left in the row beyond the last
        return columns[:-1]

    def process_noise(self, samples: slice = slice(None), *, step: float = 1.0) -> Floats:
        """(sample or 1, column) array: q of random walks of the same bandwidth with one step in `step` samples."""
        bandwidth = self.bandwidth if self.bandwidth.shape[1] == 1 else self.bandwidth[:, samples]
        # A band as wide as the rate of the steps passes everything, as any wider one would.
        q = quadrature_noise(self.orders, 1.0 / step)[:, None] * variance_ratio(
            np.minimum(bandwidth * step, 1.0), self.poles
        )
        return np.ascontiguousarray(q[self.order_of_column].T)

    def prior_variance(self, *, step: float = 1.0) -> Floats:
        """(pole, column) array: prior variances of the levels and their differences."""
        power = 2 * np.arange(self.poles)[:, None]
        turn = 2 * np.pi * step * self.bandwidth.max(axis=1)[self.order_of_column]
        return np.asarray(self.prior_std**2 * turn**power)

    def amplitude(self, levels: Floats) -> Complexes:
        """(order, output) complex amplitudes of (output, column) levels."""
        z = levels[:, : self.orders.size].T.astype(np.complex128)
        z[self.nonzero] += 1j * levels[:, self.orders.size :].T
        return z

    def variance(self, variances: Floats) -> Floats:
        """(order, output) variances, means over the quadratures, of (output, column) variances."""
        mean = variances[:, : self.orders.size].T.copy()
        mean[self.nonzero] += variances[:, self.orders.size :].T
        mean[self.nonzero] /= 2
        return mean


@dataclass
class Innovations:
    """Sums over normalised innovations, those over their standard deviations."""

    square: Floats  # (channel,), of their squares
    count: int = 0

    @property
    def mean_square(self) -> Floats:
        """(channel,) array, mean square of the normalised innovations."""
        return self.square / max(self.count, 1)

    def add(self, innovations: Floats, seen: Flags, *, skip: int = 0) -> None:
        """Add (channel, sample) normalised innovations, 0 where not `seen`, (sample,), but for the first `skip`."""
        later = innovations[:, max(skip, 0) :]
        self.square += np.einsum("cn,cn->c", later, later)
        self.count += int(np.count_nonzero(seen[max(skip, 0) :]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Estimates of a `HarmonicModel` from a record, with covariances for R = 1."""

    amplitude: Complexes  # (channel, order, output)
    variance: Floats  # (order, node), mean over the quadratures
    innovations: Innovations  # those after start-up
    # Samples between the nodes of `variance`: standard deviations are linear in between, and constant after the last.
    std_spacing: int
    # Largest error relative to an amplitude; of a steady-state filter, relative to the exact filter's error.
    error_bound: float = 0.0


def lost(model: HarmonicModel, method: Method) -> FloatingPointError:
    """Return the error of a covariance that is no longer positive definite."""
    return FloatingPointError(
        f"method={method!r}: the covariance is not positive definite in double precision, with poles={model.poles}, "
        f"a narrowest bandwidth of {model.narrowest:.3g} cycles a sample and a prior of "
        f"{model.prior_std:.3g} standard deviations of the noise; take fewer poles, a lower rate, a wider bandwidth, a "
        "smaller initial_std or, of orders that coincide, one."
    )
