"""What the trackers find: amplitudes, how sure they are, and what to know about each of them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntFlag
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.model import BandwidthUnits, Complexes, Estimator, Floats, Indices, Method


class OutputFlag(IntFlag):
    """Why an output says less than its neighbours; combined where several hold.

    In a stream "the record" is what was known of it when the output came.
    """

    NONE = 0
    NEAR_END = 1  # within half of 1 / bandwidth of the first sample or, smoother only, of the last
    NEAR_GAP = 2  # so near to missing samples that a quarter or more of what should tell it is not there
    NOT_SEPARABLE = 4  # within half a bandwidth of another order, or less than a turn from it in all of the record
    ONE_QUADRATURE = 8  # within half a bandwidth of its own image: the shaft at rest, or the order at half the rate


class UnresolvedPair(NamedTuple):
    """Two orders, by their places, that lie within half a bandwidth of each other for a share of the record."""

    first: int
    second: int
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderTracks:
    """Complex amplitudes of shaft harmonics and their standard deviations.

    The harmonic is `Re{ Z exp(j order phase) }`: `abs(Z)` is its peak amplitude in the units of the record, `angle(Z)`
    its phase where the shaft's phase is zero; real for order 0. A record of two dimensions gives the axis `channel`.

    Attributes
    ----------
    complex_amplitude : ([channel,] order, output) array, Z.
    settling_variance : ([channel,] order, settling) array, mean variance of the two parts of an amplitude where R = 1:
        of all outputs, of the first ones until it has settled, or at nodes `std_spacing` samples apart.
    std_spacing : None where `settling_variance` is that of outputs.
    angle_std : (order, output or 1) array, standard deviation of `order phase_rad`; None where that is taken as known.
    flags : ([channel,] order, output) array of `OutputFlag`; a view where channels miss the same samples.
    orders : (order,) array, cycles per revolution of the order's own shaft.
    shafts : name of each order's shaft; empty where one unnamed phase was given.
    bandwidth : (order,) array, full -3 dB width of the steady-state smoother, as given; the mean where it varies.
    bandwidth_units : "hz" or "orders".
    bandwidth_cycles : (order,) array, the same in cycles a sample.
    unresolved : the pairs of orders, by their places, that are not separable with this bandwidth and length.
    poles : how many times the random walk is integrated.
    estimator : "smoother" (all samples) or "filter" (this sample and those before it).
    method : "exact", "fast" or "reference": the one that ran.
    error_bound : largest error that "fast" adds; 0 for the others. Smoother: as a part of the largest amplitude among
        orders that disturb one another (its noise agrees with the exact one's to some hundredths of `std`); infinite
        where, with several poles, lines stay within half a bandwidth of each other beside orders that are not smoothed
        with them. Filter: as a part of the exact filter's own error, noise and lag.
    noise_variance : ([channel,]) R, as given or as estimated from the record.
    innovation_variance : ([channel,]) R times the geometric mean, after start-up, of the variance of the innovation
        (the error of the prediction of the next sample) where R = 1.
    innovation_mean_square : ([channel,]) mean, after start-up, of the squared innovations over their variances: near
        1 when a given R and the bandwidths suit the record, 1 by construction where R was estimated.
    innovation_autocorrelation : ([channel,] lag) array, of the innovations at lags from one sample on; "fast" takes
        the smoother's residuals instead.
    whiteness : ([channel,]) mean of the squared autocorrelation times the samples it was taken from: near 1 where
        the innovations are white, above where the record holds lines or bands that no order explains. What is said of
        innovations is NaN where none counts: in a channel without a sample, or before start-up is over.
    samples, output_every, first_output : length of the record, distance between outputs and place of the first one.
    innovations : ([channel,] sample) array where asked for: each sample less its prediction from those before it, in
        the unit of the record; NaN where it is missing.
    normalised_innovation_squared : of the same shape: their squares over their variances. Where the model holds, each
        is a draw of chi squared with one degree of freedom.
    """

    complex_amplitude: Complexes = field(metadata={"dims": ("channel", "order", "output"), "units": "signal"})
    settling_variance: Floats = field(metadata={"dims": ("channel", "order", "settling"), "units": "1"})
    flags: NDArray[np.uint8] = field(metadata={"dims": ("channel", "order", "output"), "units": "1"})
    orders: Floats = field(metadata={"dims": ("order",), "units": "1"})
    bandwidth: Floats = field(metadata={"dims": ("order",), "units": "as bandwidth_units"})
    bandwidth_cycles: Floats = field(metadata={"dims": ("order",), "units": "1"})
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
    def causal_bandwidth(self) -> Floats:
        """(order,) array, full -3 dB width of the settled causal filter at the smoother's `bandwidth`, in its units.

        For narrow bandwidths 1.554, 2.565, 3.279 and 4.080 times the smoother's, for 1 to 4 poles. NaN where even half
        of the rate is passed with less than 3 dB.
        """
        return self.bandwidth * self._of_bands(lambda band: band.filter_width_ratio)

    @cached_property
    def causal_peak_db(self) -> Floats:
        """(order,) array, largest gain of the settled causal filter above that of a steady amplitude, in dB.

        For narrow bandwidths 0, 2.1, 4.0 and 5.2 dB, for 1 to 4 poles: beside the line, on either side.
        """
        return self._of_bands(lambda band: band.filter_peak_db)

    def _of_bands(self, figure: Callable[[Bandwidth], float]) -> Floats:
        widths, place = np.unique(self.bandwidth_cycles, return_inverse=True)
        return np.array([figure(Bandwidth(width=width, poles=self.poles)) for width in widths.tolist()])[place]

    @cached_property
    def std(self) -> Floats:
        """([channel,] order, output) array, `sqrt(E|Zhat - Z|^2 / 2)`; for order 0 that of the real part."""
        std: Floats = self.settling_variance * np.asarray(self.noise_variance)[..., None, None]
        np.sqrt(std, out=std)
        outputs, known = self.sample_index, std.shape[-1]
        if self.std_spacing is not None:
            nodes = self.std_spacing * np.arange(known)
            std = np.apply_along_axis(lambda row: np.interp(outputs, nodes, row), -1, std)
        elif known < outputs.size:
            settled = np.broadcast_to(std[..., -1:], (*std.shape[:-1], outputs.size - known))
            std = np.concatenate([std, settled], axis=-1)
        if self.angle_std is not None:
            np.sqrt(std**2 + (self.angle_std * np.abs(self.complex_amplitude)) ** 2 / 2, out=std)
        return std
