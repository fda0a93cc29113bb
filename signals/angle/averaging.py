"""Time synchronous average (TSA) of a shaft.

Averaging N revolutions is a comb filter (McFadden 1987, "A revised model for the extraction of periodic waveforms by
time domain averaging", Mech. Syst. Signal Process. 1(1), 83-95). Its gain is one at whole orders of the shaft and
``|sin(pi N f) / (N sin(pi f))|`` at any order f, with nulls where N f is whole: the number of revolutions determines
how much of other shafts remains, and `quietest_revolutions` chooses it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from numbers import Rational, Real
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._validation import Array, checked, number, real_vector, whole
from signals.resampling.resampling import AngularSignal, angular_resample
from signals.shaft.phase import ShaftPhase

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray


# ---- Comb filter of synchronous averaging: its gain and the best number of revolutions -------------------------------


@checked
def comb_gain(orders: ArrayLike, *, revolutions: int) -> Array:
    """Return the gain of an average over N revolutions at each order, from 0 to 1.

    ``|sin(pi N f) / (N sin(pi f))|`` (McFadden 1987), one at whole orders.

    Parameters
    ----------
    orders : array of numbers or of Fractions, any shape
        Orders of the averaged shaft. Fractions are reduced exactly, so that their nulls are exactly zero.
    revolutions : int
        N.

    Returns
    -------
    array
        Gains, of the shape of `orders`.

    Raises
    ------
    ValueError
        Orders that are not finite real numbers, or fewer than one revolution.

    Examples
    --------
    A null at 20 revolutions, since 20 times 32.05 is whole; -3.89 dB at 10:

    >>> import numpy as np
    >>> from fractions import Fraction
    >>> from signals import comb_gain
    >>> float(comb_gain(Fraction(641, 20), revolutions=20))
    0.0
    >>> round(float(20 * np.log10(comb_gain(32.05, revolutions=10))), 2)
    -3.89
    """
    count = whole(revolutions, name="revolutions", least=1)
    given = np.asarray(orders)
    if given.dtype.kind not in "iufO":
        raise ValueError(f"orders have type {given.dtype}; give real numbers or Fractions.")
    if given.dtype.kind == "O":
        exact = [_exact(order) for order in given.ravel()]
        fraction = np.array([float(order - round(order)) for order in exact]).reshape(given.shape)
        phase = np.array([float(count * order - round(count * order)) for order in exact]).reshape(given.shape)
    else:
        if not np.all(np.isfinite(given)):
            raise ValueError("some of the orders are not finite; leave them out.")
        given = given.astype(np.float64)
        fraction = given - np.rint(given)
        phase = count * fraction - np.rint(count * fraction)
    least = 1e-150  # distance from a whole order below which the gain is one; the quotient would underflow
    passing = np.abs(fraction) < least
    below = count * np.sin(np.pi * np.where(passing, 0.5, fraction))
    return np.asarray(np.where(passing, 1.0, np.abs(np.sin(np.pi * phase) / below)), dtype=np.float64)


def _exact(order: object) -> Fraction:
    """Return an order as a Fraction; for a float, that of its binary value."""
    if isinstance(order, bool) or not isinstance(order, Real):
        raise ValueError(f"order {order!r} must be a real number or a Fraction.")  # noqa: TRY004
    if not isinstance(order, Rational):
        return Fraction(number(order, name="order"))
    return Fraction(order)


@dataclass(frozen=True, kw_only=True)
class CombAdvice:
    """Number of revolutions to average, and the largest gain of the comb filter over the interfering orders.

    Attributes
    ----------
    revolutions : int
        Number of revolutions.
    gain : float
        Largest gain over the interfering orders, 0 to 1.
    null_every : int or None
        Smallest number of revolutions with an exact null at all of them, as at its multiples; None if an order is a
        float.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from signals import quietest_revolutions
    >>> quietest_revolutions([Fraction(21, 41)], most=100)
    CombAdvice(revolutions=82, gain=0.0, null_every=41)
    """

    revolutions: int
    gain: float
    null_every: int | None


@checked
def quietest_revolutions(orders: Iterable[Fraction | float], *, most: int) -> CombAdvice:
    """Return the number of revolutions whose average attenuates the interfering orders most.

    An order a/b in lowest terms has nulls at multiples of b revolutions, several orders together at multiples of the
    least common multiple. If fewer revolutions are available, or an order is a float, the number whose largest gain is
    smallest is returned; of equal ones the largest number, since noise decreases with it.

    Parameters
    ----------
    orders : iterable of Fraction or float
        Interfering orders of the averaged shaft, as Fractions where teeth define them. A null at the order of a shaft
        is one at its harmonics too, except those that are whole orders.
    most : int
        Largest number of revolutions available.

    Returns
    -------
    CombAdvice

    Raises
    ------
    ValueError
        No order, or a whole one, which repeats with the shaft and is not attenuated by any number of revolutions.

    Examples
    --------
    In a pair of 21 and 41 teeth the mate turns at order 21/41, with nulls at multiples of 41 revolutions:

    >>> from fractions import Fraction
    >>> from signals import quietest_revolutions
    >>> quietest_revolutions([Fraction(21, 41)], most=100).revolutions
    82
    """
    limit = whole(most, name="most", least=1)
    given = list(orders)
    exact = [_exact(order) for order in given]
    if not exact:
        raise ValueError("orders is empty; give at least one interfering order.")
    for order in exact:
        if order.denominator == 1:
            raise ValueError(
                f"order {order} repeats with the averaged shaft, so no number of revolutions removes it; leave it out."
            )
    known = all(isinstance(order, Rational) for order in given)
    every = math.lcm(*(order.denominator for order in exact)) if known else None
    if every is not None and every <= limit:
        return CombAdvice(revolutions=limit // every * every, gain=0.0, null_every=every)
    counts = np.arange(1, limit + 1)
    worst = np.zeros(limit)
    for order in exact:
        fraction = float(order - round(order))
        phase = counts * fraction
        gain = np.abs(np.sin(np.pi * (phase - np.rint(phase))) / (counts * math.sin(math.pi * fraction)))
        worst = np.maximum(worst, gain)
    best = int(limit - 1 - np.argmin(worst[::-1]))
    return CombAdvice(revolutions=best + 1, gain=float(worst[best]), null_every=every)


# ---- Averaging -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SynchronousAverage:
    """One revolution of a shaft, averaged over many.

    Attributes
    ----------
    values : (angle,) array
        Average, in the unit of the record.
    standard_error : (angle,) array
        Standard error of each value, from the scatter between revolutions, taken as independent; NaN for only one.
    revolutions : int
        Number of revolutions averaged.
    ratio : Fraction
        Revolutions of this shaft per revolution of the reference shaft.
    start_rev : float
        Angle of the reference shaft, in revolutions, at the start of the first averaged revolution.
    passband_orders : float
        Highest order of this shaft in the passband.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal, synchronous_average
    >>> angle = 2 * np.pi * np.arange(10 * 64) / 64
    >>> x = 1 + 2 * np.cos(3 * angle)
    >>> signal = AngularSignal(values=x, samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    >>> np.abs(synchronous_average(signal).complex_amplitude[:4]).round(6).tolist()
    [1.0, 0.0, 0.0, 2.0]
    """

    values: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    standard_error: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    revolutions: int
    ratio: Fraction = Fraction(1)
    start_rev: float = 0.0
    passband_orders: float = math.inf

    @property
    def samples_per_rev(self) -> int:
        """Number of angles per revolution."""
        return int(self.values.size)

    @property
    def removed_orders(self) -> tuple[int, ...]:
        """Orders removed from the average: none."""
        return ()

    @property
    def complex_amplitude(self) -> NDArray[np.complex128]:
        """Complex peak amplitude at every whole order, (samples_per_rev // 2 + 1,); order 0 is the mean."""
        lines = np.asarray(fft.rfft(self.values), dtype=np.complex128) / self.values.size
        lines[1 : (self.values.size + 1) // 2] *= 2  # the Nyquist line has no mirror image
        return lines


@checked
def synchronous_average(
    signal: AngularSignal,
    *,
    ratio: Fraction | int = 1,
    revolutions: int | None = None,
    samples_per_rev: int | None = None,
    datum_rev: float | None = None,
) -> SynchronousAverage:
    """Return the time synchronous average of a shaft (Braun 1975; McFadden 1987).

    If a revolution of the shaft is a whole number of samples, they are averaged directly. Otherwise the signal is first
    resampled over the angle of that shaft, and revolutions within 32 samples of the ends are left out.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference shaft.
    ratio : Fraction
        Revolutions of the averaged shaft per revolution of the reference shaft, exact.
    revolutions : int, optional
        Number of revolutions of the averaged shaft, counted from the first; default: all. See `quietest_revolutions`.
    samples_per_rev : int, optional
        Angles of the average; default: the samples of the signal per revolution of this shaft, rounded up.
    datum_rev : float, optional
        Angle of the reference shaft, in revolutions, at which the angle of the averaged shaft is zero; default: that of
        the first sample. Use the same datum for averages of several parts of a record to keep their angles comparable.

    Returns
    -------
    SynchronousAverage
        `values` (samples_per_rev,) and their standard error.

    Raises
    ------
    ValueError
        A ratio that is not exact or not positive, or fewer revolutions in the signal than required.

    Examples
    --------
    The mesh of 21 teeth remains; order 3.5, not a whole order, is nulled by an even number of revolutions:

    >>> import numpy as np
    >>> from signals import AngularSignal, synchronous_average
    >>> angle = 2 * np.pi * np.arange(10 * 64) / 64
    >>> x = np.cos(21 * angle) + np.cos(3.5 * angle)
    >>> average = synchronous_average(
    ...     AngularSignal(values=x, samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    ... )
    >>> average.revolutions, bool(np.allclose(average.values, np.cos(21 * angle[:64])))
    (10, True)
    """
    values = real_vector(signal.values, name="the angular signal")
    ratio = exact_ratio(ratio)
    per_turn = signal.samples_per_rev / ratio
    angles = math.ceil(per_turn) if samples_per_rev is None else samples_per_rev
    per_rev = whole(angles, name="samples_per_rev", least=2)
    datum = Fraction(0 if datum_rev is None else number(datum_rev, name="datum_rev") - signal.start_rev)
    offset = (datum * signal.samples_per_rev) % per_turn
    direct = per_turn == per_rev and offset.denominator == 1
    # half width of the interpolation filter of `angular_resample` in samples; wider on a coarser grid
    margin = 0 if direct else math.ceil(32 * max(1.0, float(per_turn / per_rev)))
    first = offset + per_turn * max(0, math.ceil((margin - offset) / per_turn))
    available = max(0, math.floor((values.size - margin - first) / per_turn))
    count = _count(revolutions, available, values.size, per_turn)
    if direct:
        turns, passband = values[int(first) : int(first) + count * per_rev].reshape(count, per_rev), math.inf
    else:
        turns, passband = _resampled_turns(values, float(first), float(per_turn), count, per_rev)
    spread = turns.std(axis=0, ddof=1) if count > 1 else np.full(per_rev, np.nan)
    return SynchronousAverage(
        values=turns.mean(axis=0),
        standard_error=spread / math.sqrt(count),
        revolutions=count,
        ratio=ratio,
        start_rev=signal.start_rev + float(first / signal.samples_per_rev),
        passband_orders=min(signal.passband_orders / float(ratio), passband),
    )


def exact_ratio(ratio: object) -> Fraction:
    """Return a ratio of shaft speeds above zero as a Fraction, or raise ValueError."""
    if isinstance(ratio, bool) or not isinstance(ratio, Rational):
        raise ValueError(  # noqa: TRY004
            f"ratio={ratio!r} is not exact, and its error would accumulate over the revolutions; "
            "give the teeth, as in Fraction(21, 41)."
        )
    if ratio <= 0:
        raise ValueError(f"ratio={ratio} must be above zero; averages do not depend on the sense of rotation.")
    return Fraction(ratio)


def _count(revolutions: int | None, available: int, samples: int, per_turn: Fraction) -> int:
    """Return the number of revolutions to average, or raise where the signal has fewer."""
    needed = 1 if revolutions is None else whole(revolutions, name="revolutions", least=1)
    if available < needed:
        raise ValueError(
            f"the signal of {samples} samples holds {available} whole revolutions of the shaft at "
            f"{float(per_turn):g} samples each, but {needed} are needed; record longer, or average fewer."
        )
    return available if revolutions is None else needed


def _resampled_turns(values: Array, first: float, per_turn: float, count: int, per_rev: int) -> tuple[Array, float]:
    """Return `count` revolutions starting at sample `first`, (count, per_rev), and the highest order in the passband.

    The sample number serves as time, in which the shaft has a constant speed.
    """
    phase = ShaftPhase(
        times_s=np.array([first, first + count * per_turn]), revolutions=np.array([0.0, count]), nominal=True
    )
    found = angular_resample(values, rate_hz=1.0, phase=phase, samples_per_rev=per_rev, revolutions=count)
    return found.values.reshape(count, per_rev), found.passband_orders


class RunningAverage:
    """Time synchronous average of a record that arrives in blocks, in constant memory.

    Mean and sum of squared deviations are updated as by Chan, Golub & LeVeque (1983, "Algorithms for computing the
    sample variance", Am. Stat. 37(3)), for single revolutions the update of Welford (1962). Block sizes affect only
    rounding.

    Parameters
    ----------
    samples_per_rev : int
        Samples per revolution of the averaged shaft.
    ratio : Fraction
        Revolutions of the averaged shaft per revolution of the reference shaft, for the result.
    passband_orders : float
        Highest order of the averaged shaft in the passband of the record, for the result.

    Raises
    ------
    ValueError
        Fewer than two samples per revolution, or a ratio that is not exact.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import RunningAverage
    >>> running = RunningAverage(samples_per_rev=4)
    >>> running.update([1, 2, 3, 4, 3, 2])
    >>> running.update([1, 0])
    >>> running.average().values.tolist(), running.revolutions
    ([2.0, 2.0, 2.0, 2.0], 2)
    """

    def __init__(self, *, samples_per_rev: int, ratio: Fraction | int = 1, passband_orders: float = math.inf) -> None:
        self.samples_per_rev = whole(samples_per_rev, name="samples_per_rev", least=2)
        self.ratio = exact_ratio(ratio)
        self.passband_orders = passband_orders
        self.revolutions = 0
        self._mean: Array = np.zeros(self.samples_per_rev)
        self._squares: Array = np.zeros(self.samples_per_rev)
        self._rest: Array = np.zeros(0)

    @property
    def waiting(self) -> int:
        """Number of samples of a revolution that is not yet complete and not in the average."""
        return int(self._rest.size)

    def update(self, values: ArrayLike) -> None:
        """Add the next samples over the angle of the averaged shaft, (n,) of any length; they must be finite."""
        block = np.append(self._rest, real_vector(values, name="values", minimum=0))
        turns, rest = np.split(block, [block.size - block.size % self.samples_per_rev])
        self._rest = rest
        if turns.size:
            rows = turns.reshape(-1, self.samples_per_rev)
            mean = rows.mean(axis=0)
            self._combine(rows.shape[0], mean, np.sum((rows - mean) ** 2, axis=0))

    def merge(self, other: RunningAverage) -> None:
        """Add the revolutions of another average of the same shaft.

        Raises
        ------
        ValueError
            Averages of different grids or shafts, or with an incomplete revolution.
        """
        if (other.samples_per_rev, other.ratio) != (self.samples_per_rev, self.ratio):
            raise ValueError(
                f"an average of {other.samples_per_rev} samples per revolution at ratio {other.ratio} cannot be merged "
                f"with one of {self.samples_per_rev} at ratio {self.ratio}; resample both over the same shaft and grid."
            )
        if self.waiting or other.waiting:
            raise ValueError(
                f"{self.waiting} and {other.waiting} samples belong to incomplete revolutions, which merging would "
                "lose; update both averages to whole revolutions first."
            )
        self.passband_orders = min(self.passband_orders, other.passband_orders)
        self._combine(other.revolutions, other._mean, other._squares)

    def average(self) -> SynchronousAverage:
        """Return the average to date; more samples may follow.

        Raises
        ------
        ValueError
            Before the first whole revolution.
        """
        if not self.revolutions:
            raise ValueError(
                f"only {self.waiting} of the {self.samples_per_rev} samples of the first revolution have arrived; "
                "update with more before asking for the average."
            )
        freedom = self.revolutions - 1
        variance = self._squares / freedom if freedom else np.full(self.samples_per_rev, np.nan)
        return SynchronousAverage(
            values=self._mean.copy(),
            standard_error=np.sqrt(variance / self.revolutions),
            revolutions=self.revolutions,
            ratio=self.ratio,
            passband_orders=self.passband_orders,
        )

    def _combine(self, count: int, mean: Array, squares: Array) -> None:
        """Combine mean and sum of squared deviations with those of `count` more revolutions (Chan et al. 1983)."""
        if not count:
            return
        total = self.revolutions + count
        difference = mean - self._mean
        self._mean = self._mean + difference * (count / total)
        self._squares = self._squares + squares + difference**2 * (self.revolutions * count / total)
        self.revolutions = total
