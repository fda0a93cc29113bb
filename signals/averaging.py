"""The time synchronous average of a shaft, and what is left when its regular part is taken out."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from signals._checks import Array, real_vector
from signals.resampling import AngularSignal


@dataclass(frozen=True, kw_only=True)
class SynchronousAverage:
    """One revolution, averaged over many: what repeats with the shaft stays, the rest falls as 1/sqrt(N)."""

    values: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    standard_error: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    revolutions: int

    @property
    def complex_amplitude(self) -> NDArray[np.complex128]:
        """Complex peak amplitude at every whole order, (samples_per_rev // 2 + 1,); order 0 is the mean."""
        lines = np.asarray(fft.rfft(self.values), dtype=np.complex128) / self.values.size
        lines[1 : (self.values.size + 1) // 2] *= 2  # half the sampling rate has no mirror image
        return lines


def synchronous_average(signal: AngularSignal) -> SynchronousAverage:
    """Average an angular signal over its revolutions (Braun 1975; McFadden 1987).

    Parameters
    ----------
    signal : AngularSignal
        Whole revolutions of the shaft to average over.

    Returns
    -------
    SynchronousAverage
        `values` (samples_per_rev,) and their standard error.
    """
    turns = signal.values.reshape(signal.revolutions, signal.samples_per_rev)
    spread = turns.std(axis=0, ddof=1) if signal.revolutions > 1 else np.full(signal.samples_per_rev, np.nan)
    return SynchronousAverage(
        values=turns.mean(axis=0),
        standard_error=spread / np.sqrt(signal.revolutions),
        revolutions=signal.revolutions,
    )


def residual_signal(average: SynchronousAverage, *, removed_orders: Iterable[int], max_order: int) -> Array:
    """Return the average without its mean, the `removed_orders`, and everything above `max_order`.

    What a local tooth fault does to one part of the revolution remains (Stewart 1977).
    """
    lines = np.asarray(fft.rfft(real_vector(average.values, name="the average")))
    lines[0] = 0
    lines[max_order + 1 :] = 0
    for order in removed_orders:
        if 0 <= order < lines.size:
            lines[order] = 0
    return np.asarray(fft.irfft(lines, average.values.size), dtype=np.float64)
