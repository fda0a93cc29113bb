"""Results of the order trackers: complex amplitudes, standard deviations, innovations; and waveforms made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from signals._validation import checked, positive, whole
from signals.harmonics import _block_kernels
from signals.harmonics._arguments import check_orders
from signals.harmonics.block_grid import pieces_between

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from signals.harmonics.state_space import Complexes, Floats, Indices, Method


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderTracks:
    """Complex amplitudes of shaft orders with their standard deviations, as `track_orders` returns them.

    An order's waveform is `Re{ Z exp(j order phase) }`: `abs(Z)` is its peak amplitude in the unit of the record,
    `angle(Z)` its phase at shaft angle zero; order 0 is real. Results for two-dimensional records have a channel axis.

    Attributes
    ----------
    complex_amplitude
        ([channel,] order, output) array, Z.
    settling_variance
        ([channel,] order, settling) array, mean variance of the real and imaginary part of Z for R = 1 at nodes,
        constant after the last one.
    std_spacing
        Samples between these nodes, the first of which is at the first output.
    orders : (order,) array
        Cycles per revolution of the order's own shaft.
    shafts
        Name of each order's shaft; empty for a single unnamed phase.
    bandwidth : (order,) array
        Full -3 dB width of the steady-state smoother in Hz or orders, as given; its mean if it varies.
    poles
        Number of integrations of the random walk.
    method
        "exact" or "fast": the one that ran.
    error_bound
        Largest error added by "fast"; 0 for "exact". Smoother: relative to the largest amplitude among orders that
        leak into one another (its noise agrees with that of the exact one to a few hundredths of `std`); infinite if,
        with several poles, orders that stay within half a bandwidth of each other leak into orders that are not
        smoothed jointly with them. Filter: relative to the error of the exact filter, noise and lag.
    noise_variance
        ([channel,]) R, as given or as estimated from the record.
    noise_density
        ([channel,] order, interval) array, variance of white noise with the density found on both sides of each order,
        in equal intervals of the record: the basis of `std`. R if it was given or the record shows too little noise.
    noise_freedom
        ([channel,] order or 1, interval) array, degrees of freedom of the estimate `noise_density`; infinite if R
        was given.
    innovation_mean_square
        ([channel,]) mean, after start-up, of the squared innovations over their variances: near 1 if a given R and the
        bandwidths suit the record, 1 by construction if R was estimated, NaN for a channel without samples or before
        the end of start-up. For a smoother, the residuals are used instead.
    clipped_share
        ([channel,]) share of the samples at or beyond `clip_limits`; above 0.05 `std` is a lower bound.
    samples, output_every, first_output
        Length of the record, samples between outputs, sample of the first output.

    Examples
    --------
    The standard deviation far from the ends is that of the theory of one isolated order. It is larger near ends and
    gaps, where orders are too close to be told apart, and where the shaft rests:

    >>> import numpy as np
    >>> from signals.harmonics import Bandwidth, track_orders
    >>> angle = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> tracks = track_orders(angle, phase_rad=angle, orders=[3], bandwidth_hz=10, rate_hz=5000, noise_variance=0.01)
    >>> theory = Bandwidth(width=10 / 5000, poles=1).isolated_std(0.01)
    >>> bool(np.isclose(tracks.std[0, 2500], theory, rtol=0.01))
    True
    """

    complex_amplitude: Complexes = field(metadata={"dims": ("channel", "order", "output"), "units": "signal"})
    settling_variance: Floats = field(metadata={"dims": ("channel", "order", "settling"), "units": "1"})
    orders: Floats = field(metadata={"dims": ("order",), "units": "1"})
    bandwidth: Floats = field(metadata={"dims": ("order",), "units": "as given"})
    shafts: tuple[str, ...]
    poles: int
    method: Method
    error_bound: float
    noise_variance: float | Floats
    noise_density: Floats = field(metadata={"dims": ("channel", "order", "interval"), "units": "signal^2"})
    noise_freedom: Floats = field(metadata={"dims": ("channel", "order", "interval"), "units": "1"})
    innovation_mean_square: float | Floats
    samples: int
    output_every: int
    std_spacing: int
    first_output: int = 0
    clipped_share: float | Floats = 0.0

    @cached_property
    def sample_index(self) -> Indices:
        """(output,) array, sample number of each output."""
        return np.arange(self.first_output, self.samples, self.output_every)

    @cached_property
    def std(self) -> Floats:
        """([channel,] order, output) array, `sqrt(E|Zhat - Z|^2 / 2)`; for order 0 that of the real part."""
        std = np.sqrt(self.settling_variance)
        places = self.first_output + self.std_spacing * np.arange(std.shape[-1])
        return interpolated(std, places, self.sample_index) * np.sqrt(self._at_outputs(self.noise_density))

    def half_width(self, probability: float) -> Floats:
        """Return the half-width of the confidence interval of the real or imaginary part of Z.

        It is `std` times the quantile of Student's t with `noise_freedom` degrees of freedom, and so wider than that of
        a normal distribution if the noise density was estimated from few independent values.

        Parameters
        ----------
        probability
            Probability that the interval contains the true value, between 0 and 1.

        Returns
        -------
        ([channel,] order, output) array, in the unit of the record.

        Examples
        --------
        In a short record, 90 % intervals reach 1.83 rather than 1.64 standard deviations:

        >>> import numpy as np
        >>> from signals.harmonics import track_orders
        >>> x = np.random.default_rng(1).standard_normal(20)
        >>> tracks = track_orders(x, phase_rad=0.5 * np.arange(20), orders=[1], bandwidth_hz=1, rate_hz=100)
        >>> print((tracks.half_width(0.9) / tracks.std)[0, 10].round(2))
        1.83
        """
        from scipy.special import stdtrit  # noqa: PLC0415 - slow to import

        part = positive(probability, name="probability")
        if part >= 1:
            raise ValueError(f"probability={part:g} must lie below 1, where the interval has no end; 0.9 is 90 %.")
        return np.asarray(self.std * self._at_outputs(np.asarray(stdtrit(self.noise_freedom, 0.5 + 0.5 * part))))

    def _at_outputs(self, values: Floats) -> Floats:
        """Return ([channel,] order, output) values from those of intervals."""
        intervals = values.shape[-1]
        return interpolated(values, (np.arange(intervals) + 0.5) * self.samples / intervals, self.sample_index)


def interpolated(values: Floats, places: Floats | Indices, outputs: Indices) -> Floats:
    """Return rows of values at some samples, linearly interpolated to those of the outputs."""
    if outputs.size == 0:
        return values[..., :0]
    return np.asarray(np.apply_along_axis(lambda row: np.interp(outputs, places, row), -1, values))


@checked
def order_waveform(
    tracks: OrderTracks, *, phase_rad: ArrayLike | Mapping[str, ArrayLike], places: Sequence[int] | None = None
) -> Floats:
    """Return the waveform `sum_k Re{ Z_k exp(j order_k phase) }` of some of the tracked orders.

    Parameters
    ----------
    tracks
        Result of `track_orders`; amplitudes between its outputs are interpolated, cubic, or linear for one pole.
    phase_rad
        Shaft angle in rad, as it was given there.
    places
        Indices into `tracks.orders`; all orders by default.

    Returns
    -------
    (sample,) array, or (channel, sample) for tracks of several channels, in the unit of the record.

    Raises
    ------
    ValueError
        An index or a phase does not belong to these tracks.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.harmonics import order_waveform, track_orders
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 1 + 2 * np.cos(3 * phase_rad)  # a mean of 1 and a tone at order 3
    >>> tracks = track_orders(x, phase_rad=phase_rad, orders=[0, 3], bandwidth_hz=2, rate_hz=5000)
    >>> wave = order_waveform(tracks, phase_rad=phase_rad, places=[1])
    >>> print(round(np.std(wave), 3), (x - wave)[[0, 2500]].round(3))  # sqrt(2), and the mean
    1.414 [1. 1.]
    """
    if tracks.first_output > 0 or tracks.sample_index.size == 0:
        raise ValueError(
            f"tracks have {tracks.sample_index.size} outputs from sample {tracks.first_output} on: a later block of "
            "a stream. Waveforms are made from tracks that begin with the record; take those of track_orders."
        )
    named = range(tracks.orders.size) if places is None else places
    chosen = np.array([whole(place, name="places", least=0) for place in named], dtype=np.int64)
    if chosen.max(initial=0) >= tracks.orders.size:
        raise ValueError(
            f"places={chosen.tolist()} must lie between 0 and {tracks.orders.size - 1}; they count the tracked orders."
        )
    own = list(zip(tracks.shafts, tracks.orders.tolist(), strict=True)) if tracks.shafts else tracks.orders
    orders, _, shaft, phases = check_orders(own, phase_rad, samples=tracks.samples)
    amplitude = tracks.complex_amplitude
    amplitude = (amplitude if amplitude.ndim == 3 else amplitude[None])[:, chosen]  # noqa: PLR2004
    waves = np.zeros((len(amplitude), tracks.samples))
    if chosen.size:
        if amplitude.shape[-1] == 1:
            amplitude = np.repeat(amplitude, 2, axis=-1)
        pieces = pieces_between(amplitude, cubic=tracks.poles > 1)
        for pieces_of_channel, wave in zip(pieces, waves, strict=True):
            _block_kernels.remodulate(
                pieces_of_channel, tracks.output_every, np.stack(phases), orders[chosen], shaft[chosen], 0,
                np.empty((2, _block_kernels.PIECE)), wave,
            )  # fmt: skip
    return waves if tracks.complex_amplitude.ndim == 3 else waves[0]  # noqa: PLR2004
