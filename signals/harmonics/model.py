"""What the trackers estimate: harmonics of shaft angles whose complex amplitudes drift slowly.

The record is `y[n] = sum_k Re{ Z_k[n] exp(j order_k phase_k[n]) } + v[n]` with white noise v of variance R:
one real measurement a sample, `cos` on the real and `-sin` on the imaginary parts. Each of these quadratures
is a `poles`-fold integrated random walk: its `poles`-th backward difference w is white with variance q. The
state, (level, first difference, ...), is moved on by an upper triangle of ones and driven by a vector of
ones times w.

How q follows from the bandwidth is told in `bandwidth`. All but the scale of the uncertainty depends on q / R
only, so the estimators work with R = 1.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

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
    def nonzero(self) -> Indices:
        """Indices of the non-zero orders: those with an imaginary part."""
        return np.flatnonzero(self.orders)

    @cached_property
    def order_of_column(self) -> Indices:
        """Index of the order each column belongs to."""
        return np.concatenate([np.arange(self.orders.size), self.nonzero])

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
        return np.concatenate([np.cos(angle), -np.sin(angle[:, self.nonzero])], axis=1)

    def process_noise(self, samples: slice = slice(None), *, step: float = 1.0) -> Floats:
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
        z[self.nonzero] += 1j * levels[:, self.orders.size :].T
        return z

    def variance(self, variances: Floats) -> Floats:
        """(order, output) means over the quadratures of (output, column) variances."""
        mean = variances[:, : self.orders.size].T.copy()
        mean[self.nonzero] += variances[:, self.orders.size :].T
        mean[self.nonzero] /= 2
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
    innovations : where asked for, stretches of them: (channel, sample) over their standard deviations, and (sample,)
        variances, 0 where missing.
    std_spacing : samples from one variance to the next where they are not those of outputs but of nodes, the last one
        after the last sample: standard deviations are linear in between.
    """

    amplitude: Complexes
    variance: Floats
    innovation_mean_square: Floats
    innovation_log_variance: float
    innovation_autocorrelation: Floats
    innovation_samples: int
    error_bound: float = 0.0
    innovations: list[tuple[Floats, Floats]] | None = None
    std_spacing: int | None = None


def lost(model: HarmonicModel, method: Method) -> FloatingPointError:
    """Return what is raised where a covariance has lost its digits."""
    return FloatingPointError(
        f"method={method!r}: the covariance is not positive definite in double precision, with poles={model.poles}, "
        f"a narrowest bandwidth of {model.bandwidth.max(axis=1).min():.3g} cycles a sample and a prior of "
        f"{model.prior_std:.3g} standard deviations of the noise; take fewer poles, a lower rate, a wider bandwidth or "
        "a smaller initial_std."
    )


_Values = TypeVar("_Values", bound=NDArray[Any])


@dataclass(frozen=True, kw_only=True, eq=False)
class Patterns:
    """The patterns of missing samples in a record, and the way from what was found for each back to its channels.

    Attributes
    ----------
    record : (channel, sample) array, NaN where a sample is missing.
    seen : (sample,) arrays, one for each pattern, where its samples are there.
    of_channel : (channel,) array, the number of the pattern each has.
    """

    record: Floats
    seen: list[NDArray[np.bool_]]
    of_channel: Indices

    @classmethod
    def of(cls, record: Floats) -> "Patterns":
        """Find the patterns of a record."""
        numbers: dict[bytes, int] = {}
        masks: list[NDArray[np.bool_]] = []
        of_channel = np.empty(len(record), dtype=np.int64)
        for channel, values in enumerate(record):
            whole = not np.isnan(values.max())
            seen = np.ones(values.size, dtype=np.bool_) if whole else ~np.isnan(values)
            key = b"" if whole else seen.tobytes()
            if key not in numbers:
                numbers[key] = len(masks)
                masks.append(seen)
            of_channel[channel] = numbers[key]
        return cls(record=record, seen=masks, of_channel=of_channel)

    @property
    def first_channels(self) -> list[int]:
        """The first channel of each pattern."""
        return [self.of_channel.tolist().index(number) for number in range(len(self.seen))]

    @property
    def records(self) -> list[Floats]:
        """The channels of each pattern."""
        if len(self.seen) == 1:
            return [self.record]
        return [self.record[self.of_channel == number] for number in range(len(self.seen))]

    def joined(self, parts: list[_Values]) -> _Values:
        """(channel, ...) array from those of the channels of each pattern."""
        return parts[0] if len(parts) == 1 else np.concatenate(parts)[self._place]  # type: ignore[return-value]

    def shared(self, parts: list[_Values]) -> _Values:
        """(channel, ...) array of what all channels of a pattern have in common; a view where they all do."""
        if len(parts) == 1:
            one = parts[0][None]
            return one if self.of_channel.size == 1 else np.broadcast_to(one, (self.of_channel.size, *one.shape[1:]))  # type: ignore[return-value]
        return np.stack(parts)[self.of_channel]  # type: ignore[return-value]

    @cached_property
    def _place(self) -> Indices:
        return np.argsort(np.argsort(self.of_channel, kind="stable"))
