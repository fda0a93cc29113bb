"""Indicators of any waveform (RMS, peak, crest factor, kurtosis), and the variance history of NA4 and NB4."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from signals._validation import Array, Samples, checked, positive, real_samples, real_vector, whole
from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import MeshBand, ResidualSignal

Waveform = ArrayLike | SynchronousAverage


@checked
def rms(x: Waveform) -> float:
    """Return the root mean square about the mean, in the unit of `x`.

    The mean of an accelerometer signal is an offset of the sensor, not vibration.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        Fewer than two samples, or values that are not finite.
    TypeError
        A residual, difference or regular signal or a mesh band, here and in the other indicators of waveforms.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import rms
    >>> round(rms(5 + 2 * np.sin(2 * np.pi * np.arange(100) / 100)), 6)  # 2 / sqrt(2)
    1.414214
    """
    return float(np.sqrt(_mean_power(_centred(_values(x, any_unit=False)), 2)))


@checked
def peak(x: Waveform) -> float:
    """Return the largest deviation from the mean, in the unit of `x`.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        Fewer than two samples, or values that are not finite.

    Examples
    --------
    >>> from signals.indicators import peak
    >>> peak([1.0, 1.0, 1.0, 5.0])
    3.0
    """
    deviations = _centred(_values(x))
    return max(float(deviations.max()), -float(deviations.min()))


@checked
def crest_factor(x: Waveform) -> float:
    """Return the ratio of peak to RMS: sqrt(2) for a sine (Lebold et al. 2000, MFPG 54).

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import crest_factor
    >>> round(crest_factor(np.sin(2 * np.pi * np.arange(100) / 100)), 6)
    1.414214
    """
    scaled = _scaled(_centred(_values(x)), "the crest factor")
    return float(1 / np.sqrt(_mean_power(scaled, 2)))


@checked
def kurtosis(x: Waveform) -> float:
    """Return the fourth moment about the mean over the variance squared: 3 for Gaussian noise, 1.5 for a sine.

    Dyer & Stewart (1978), "Detection of rolling element bearing damage by statistical vibration analysis", J. Mech.
    Des. 100(2), 229-235.

    Parameters
    ----------
    x : (n,) array or SynchronousAverage
        The raw signal, or its average.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import kurtosis
    >>> round(kurtosis(np.sin(2 * np.pi * np.arange(100) / 100)), 6)
    1.5
    """
    return normalized_moment(_values(x), order=4, name="the kurtosis")


def normalized_moment(x: Samples, *, order: int, name: str) -> float:
    """Return the central moment of even `order` of an (n,) array over its variance to the power `order / 2`."""
    scaled = _scaled(_centred(x), name)
    return float(_mean_power(scaled, order) / _mean_power(scaled, 2) ** (order // 2))


@checked
def teager_energy(x: Array) -> Array:
    """Return the Teager energy ``x[i]^2 - x[i-1] x[i+1]`` over one revolution: ``A^2 sin(w)^2`` for a sine.

    Kaiser (1990), "On a simple algorithm to calculate the 'energy' of a signal", ICASSP, 381-384.

    Parameters
    ----------
    x : (n,) array
        One revolution, so that the last sample is followed by the first.

    Returns
    -------
    (n,) array
        In the squared unit of `x`.

    Raises
    ------
    ValueError
        Fewer than three samples, or values that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.indicators import teager_energy
    >>> teager_energy(2 * np.sin(2 * np.pi * np.arange(12) / 12))[:3].round(6)  # w = 30 degrees per sample
    array([1., 1., 1.])
    """
    values = real_vector(x, name="x", minimum=3)
    return np.asarray(values**2 - np.roll(values, 1) * np.roll(values, -1))


def _values(x: Waveform, *, any_unit: bool = True) -> Samples:
    """Return the samples of a raw signal or an average; refuse signals derived from an average."""
    if isinstance(x, SynchronousAverage):
        x = x.values
    elif hasattr(x, "removed_orders"):
        raise TypeError(
            f"this indicator takes the raw signal, an array, or a SynchronousAverage, not a {type(x).__name__}; use "
            "an indicator defined for that signal."
        )
    return real_samples(x, name="the signal", minimum=2, any_unit=any_unit)


def _centred(values: Samples) -> Samples:
    """Return the deviations from the mean, for float32 values in float32, with a relative rounding error of 6e-8."""
    return np.asarray(values - values.mean(dtype=np.float64).astype(values.dtype))


def _mean_power(values: Samples, order: int) -> float:
    """Return the mean of an even power, in blocks, by products, which take a twentieth of the time of `**`."""
    total = 0.0
    block = 2**15
    for first in range(0, values.size, block):
        square = values[first : first + block].astype(np.float64) ** 2
        power = square
        for _ in range(order // 2 - 1):
            power = power * square
        total += float(power.sum())
    return total / values.size


def _scaled(deviations: Samples, name: str) -> Samples:
    """Divide deviations by the largest of them, so that their powers neither overflow nor underflow."""
    largest = max(float(deviations.max()), -float(deviations.min()))
    if largest == 0:
        raise ValueError(f"{name} of a constant signal is not defined; check the sensor.")
    deviations /= deviations.dtype.type(largest)
    return deviations


_MADE_BY = {
    "SynchronousAverage": "synchronous_average",
    "ResidualSignal": "residual_signal",
    "DifferenceSignal": "difference_signal",
    "RegularSignal": "regular_signal",
    "MeshBand": "mesh_band",
    "AmplitudeSpectrum": "envelope_order_spectrum",
}


def expect(signal: object, kind: type, *, indicator: str) -> None:
    """Raise TypeError unless a signal is of the kind for which an indicator is defined."""
    if not isinstance(signal, kind):
        raise TypeError(
            f"{indicator} takes a {kind.__name__}, not a {type(signal).__name__}; compute one with "
            f"signals.{_MADE_BY[kind.__name__]}."
        )


Kind = Literal["residual", "mesh envelope"]


@dataclass(frozen=True, kw_only=True)
class VarianceHistory:
    """Mean variance of the records to date, the denominator of NA4 and NB4; `update` returns a new one.

    For NA4 and NB4 every record updates the mean, so that a persistent fault becomes part of it. NA4* and NB4* retain
    the variance of the healthy gear (Decker, Handschuh & Zakrajsek 1994, NASA TM-106553): freeze the history after
    run-in, or set `limit_std` for automatic freezing.

    Attributes
    ----------
    records : int
        Number of records.
    mean_variance : float
        Mean of their variances, in the squared unit of the signal.
    squares : float
        Sum of squared deviations of the variances from their mean.
    kind : "residual", "mesh envelope" or None
        Signal from which they are computed; None before the first record.
    frozen : bool
        Whether further records leave the history unchanged.
    limit_std : float or None
        If given, the history freezes at the first record after `learning` whose variance exceeds the mean by this many
        standard deviations of the previous variances.
    learning : int
        Number of records before it may freeze automatically.

    Raises
    ------
    ValueError
        A negative number of records, a limit that is not positive, or fewer than two records of learning.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import ResidualSignal
    >>> from signals.indicators import VarianceHistory
    >>> tone = np.cos(2 * np.pi * np.arange(360) / 360)
    >>> history = VarianceHistory()
    >>> for amplitude in (1, 2):  # variances 0.5 and 2
    ...     history = history.update(ResidualSignal(values=amplitude * tone, removed_orders=()))
    >>> history.records, round(history.mean_variance, 6)
    (2, 1.25)
    """

    records: int = 0
    mean_variance: float = 0.0
    squares: float = 0.0
    kind: Kind | None = None
    frozen: bool = False
    limit_std: float | None = None
    learning: int = 10

    def __post_init__(self) -> None:
        whole(self.records, name="records", least=0)
        whole(self.learning, name="learning", least=2)
        if self.limit_std is not None:
            positive(self.limit_std, name="limit_std")

    @property
    def std(self) -> float:
        """Standard deviation of the variances; NaN for fewer than two records."""
        return math.sqrt(self.squares / (self.records - 1)) if self.records > 1 else math.nan

    def update(self, signal: ResidualSignal | MeshBand) -> VarianceHistory:
        """Return the history with one more record, or itself if frozen.

        Raises
        ------
        ValueError
            A signal of a different kind from the previous ones.
        """
        variance = self.variance_of(signal)
        if self.frozen:
            return self
        if (
            self.limit_std is not None
            and self.records >= self.learning
            and variance > self.mean_variance + self.limit_std * self.std
        ):
            return self.freeze()
        records = self.records + 1
        apart = variance - self.mean_variance
        mean = self.mean_variance + apart / records
        return replace(
            self,
            records=records,
            mean_variance=mean,
            squares=self.squares + apart * (variance - mean),
            kind=kind_of(signal),
        )

    def freeze(self) -> VarianceHistory:
        """Return a frozen copy, which further records leave unchanged.

        Raises
        ------
        ValueError
            Before the first record.
        """
        if not self.records:
            raise ValueError("the history holds no record yet; update it with records of the healthy gear first.")
        return replace(self, frozen=True)

    def variance_of(self, signal: ResidualSignal | MeshBand) -> float:
        """Return the variance of `signal`; raise ValueError if it is of a different kind from the previous ones."""
        kind = kind_of(signal)
        if self.kind not in (None, kind):
            raise ValueError(
                f"this history holds the variance of the {self.kind}, not of the {kind}; use one for each indicator."
            )
        return float(np.var(signal.values if isinstance(signal, ResidualSignal) else signal.amplitude))


def kind_of(signal: object) -> Kind:
    """Return the kind of a signal, or raise TypeError."""
    if isinstance(signal, ResidualSignal):
        return "residual"
    if isinstance(signal, MeshBand):
        return "mesh envelope"
    raise TypeError(
        f"a history takes a ResidualSignal (NA4) or a MeshBand (NB4), not a {type(signal).__name__}; see "
        "residual_signal and mesh_band."
    )
