"""Angular resampling: from samples over time to samples over shaft angle, band-limited in orders, and back.

Where the shaft turns slowly the record contains orders above half the angular sampling rate, which must be filtered out
before they alias. The filter is a Kaiser-windowed sinc with 32 zero crossings on either side (`_engine`). Relative to
half the coarser rate, its passband ends at 0.88 (amplitude error below 2e-6), its gain is one half at 1, and its
stopband begins at 1.12 (attenuation above 100 dB), so that nothing aliases into the passband. Where the angle grid is
the coarser one, the filter is fixed in orders, however fast the speed changes.

Two cheaper methods have no anti-alias filter. For a tone of w rad per sample, w small, their RMS error relative to the
tone is

    "linear"    w^2 / sqrt(120) = 0.091 w^2         9e-3 at 20 samples per cycle, 9e-5 at 200
    "cubic"     0.0168 w^4                          1.6e-4 at 20 samples per cycle, 1.6e-8 at 200
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from signals._validation import Array, Missing, checked, choice, number, positive, samples, whole
from signals.resampling._engine import FEWEST, METHODS, NODE_STEP, Flags, Map, Method, Track, Warp
from signals.shaft.phase import refuse_rest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from signals.shaft.phase import ShaftPhase

PASSBAND = 0.88  # of half the coarser rate

_ROUNDING = 1e-9  # revolutions


@dataclass(frozen=True, kw_only=True)
class AngularSignal:
    """A record sampled at uniform steps of shaft angle, in whole revolutions.

    Attributes
    ----------
    values : (n,) array
        Samples, in the unit of the record.
    samples_per_rev : int
        Samples per revolution.
    start_rev : float
        Angle of the first sample in revolutions.
    passband_orders : float
        Highest order within the passband of the anti-alias filter at every speed.
    unsettled : (int, int)
        Number of values at the start and at the end whose filter extends beyond the record or the phase.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> signal = AngularSignal(values=np.zeros(64), samples_per_rev=16, start_rev=3.0, passband_orders=7.0)
    >>> signal.revolutions, float(signal.angle_rad[8] / np.pi)
    (4, 7.0)
    """

    values: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    samples_per_rev: int
    start_rev: float
    passband_orders: float
    unsettled: tuple[int, int] = (0, 0)

    @property
    def revolutions(self) -> int:
        """Number of whole revolutions."""
        return int(self.values.size // self.samples_per_rev)

    @property
    def angle_rad(self) -> Array:
        """Shaft angle of each sample, (n,), in rad."""
        return 2 * np.pi * (self.start_rev + np.arange(self.values.size) / self.samples_per_rev)


@dataclass(frozen=True, kw_only=True)
class TimeSignal:
    """A record sampled at uniform steps of time.

    Attributes
    ----------
    values : (n,) array
        Samples, in the unit of the record.
    rate_hz, start_s : float
        Sampling rate in Hz and time of the first sample in s.
    passband_hz : float
        Highest frequency in Hz within the passband of the anti-alias filter at every speed.
    unsettled : (int, int)
        Number of values at the start and at the end whose filter extends beyond the record or the phase.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import TimeSignal
    >>> signal = TimeSignal(values=np.zeros(3), rate_hz=100.0, start_s=2.0, passband_hz=44.0)
    >>> signal.times_s.tolist()
    [2.0, 2.01, 2.02]
    """

    values: Array = field(metadata={"dims": ("time",), "units": "as the record"})
    rate_hz: float
    start_s: float
    passband_hz: float
    unsettled: tuple[int, int] = (0, 0)

    @property
    def times_s(self) -> Array:
        """Time of each sample, (n,), in s."""
        return self.start_s + np.arange(self.values.size) / self.rate_hz


@checked
def angular_resample(
    x: ArrayLike,
    *,
    rate_hz: float,
    phase: ShaftPhase,
    samples_per_rev: int,
    start_s: float = 0.0,
    revolutions: int | None = None,
    method: Method = "sinc",
    missing: Missing = "refuse",
) -> AngularSignal:
    """Resample a record at uniform steps of shaft angle, from its first whole revolution to its last.

    Parameters
    ----------
    x : (n,) array
        Samples over time, any unit.
    rate_hz : float
        Sampling rate in Hz.
    phase : ShaftPhase
        Angle of the shaft on the same clock.
    samples_per_rev : int
        Output samples per revolution. The passband, ``passband_orders``, is 0.44 times this or, if less, 0.44 times the
        samples per revolution of the record at its highest speed.
    start_s : float
        Time of the first sample in s.
    revolutions : int, optional
        Number of revolutions; default: all that the record and the phase share.
    method : "sinc", "cubic" or "linear"
        Windowed sinc, cubic through four samples, or linear interpolation. The last two have no anti-alias filter.
    missing : "refuse" or "mark"
        Whether values that are not finite raise, or turn every output whose filter includes one into NaN.

    Returns
    -------
    AngularSignal
        For a shaft whose angle decreases, its negative is the angle, so that the samples are in order of time.

    Raises
    ------
    ValueError
        A record shorter than one revolution, values that are not finite, or a shaft that stands still or reverses
        within the record.

    Notes
    -----
    Where the filter extends beyond the record, the weights on the record are normalised to a sum of one, so that a
    constant is preserved up to the ends; ``unsettled`` counts these values.

    Examples
    --------
    A tone of order 3 on a shaft that accelerates from 10 Hz to 30 Hz has the same amplitude in every revolution:

    >>> import numpy as np
    >>> from signals import ShaftPhase, angular_resample
    >>> t = np.arange(8000) / 4000
    >>> rev = 10 * t + 5 * t**2
    >>> phase = ShaftPhase(times_s=t[::100], revolutions=rev[::100])
    >>> turns = angular_resample(np.cos(2 * np.pi * 3 * rev), rate_hz=4000, phase=phase, samples_per_rev=64)
    >>> lines = 2 * np.fft.rfft(turns.values.reshape(-1, 64), axis=1)[1:-1] / 64
    >>> bool(np.allclose(lines[:, 3], 1.0, atol=1e-4))
    True
    """
    given: dict[str, Any] = {"revolutions": revolutions, "method": method, "missing": missing}
    (signal,) = angular_resample_all(
        [x], rate_hz=rate_hz, phase=phase, samples_per_rev=samples_per_rev, start_s=start_s, **given
    )
    return signal


def angular_resample_all(
    x: Sequence[ArrayLike],
    *,
    rate_hz: float,
    phase: ShaftPhase,
    samples_per_rev: int,
    start_s: float = 0.0,
    revolutions: int | None = None,
    method: Method = "sinc",
    missing: Missing = "refuse",
    highest_hz: float | None = None,
) -> list[AngularSignal]:
    """Resample several records with the same sample times as `angular_resample` does one, computing their angles once.

    Parameters
    ----------
    x : sequence of (n,) arrays
        Samples over time, any unit, of equal length.
    rate_hz, phase, samples_per_rev, start_s, revolutions, method, missing
        As in `angular_resample`.
    highest_hz : float, optional
        Frequency in Hz above which the records contain nothing. They are not filtered if nothing aliases into the
        passband.

    Returns
    -------
    list of AngularSignal
        One for each record.

    Raises
    ------
    ValueError
        As `angular_resample`.
    """
    choice(method, name="method", choices=METHODS)
    rate, start_s = positive(rate_hz, name="rate_hz"), number(start_s, name="start_s")
    signals = [samples(row, missing=missing, minimum=FEWEST[method], rate_hz=rate, start_s=start_s) for row in x]
    per_rev = whole(samples_per_rev, name="samples_per_rev", least=2)
    stop_s = start_s + (signals[0].size - 1) / rate
    phase = forwards(phase)
    refuse_rest(phase.times_s, phase.revolutions, start_s=start_s, stop_s=stop_s, rate_hz=rate)
    first, count = whole_revolutions(phase, start_s=start_s, stop_s=stop_s)
    if revolutions is not None:
        count = whole(revolutions, name="revolutions", least=1, most=count)
    grid = angle_map(phase, rate_hz=rate, start_s=start_s, samples_per_rev=per_rev, first=first, revolutions=count)
    rows = signals[0][None] if len(signals) == 1 else np.stack(signals)
    passband = passband_orders(grid, per_rev)
    slowest_hz = grid.least_slope * rate / per_rev
    folds = highest_hz is None or highest_hz / slowest_hz > per_rev - passband
    values, beyond = Warp(grid, method=method, rows=len(rows), folds=folds).whole(rows)
    return [
        AngularSignal(
            values=row,
            samples_per_rev=per_rev,
            start_rev=first,
            passband_orders=passband,
            unsettled=unsettled(beyond),
        )
        for row in values
    ]


@checked
def time_resample(
    signal: AngularSignal,
    *,
    phase: ShaftPhase,
    rate_hz: float,
    start_s: float | None = None,
    method: Method = "sinc",
    missing: Missing = "refuse",
) -> TimeSignal:
    """Resample an angular signal at uniform steps of time, the inverse of `angular_resample`.

    Frequencies above half of `rate_hz` are filtered out before they alias. Ends are treated as in `angular_resample`.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the shaft.
    phase : ShaftPhase
        Angle of the shaft; it must cover the revolutions of the signal.
    rate_hz : float
        Output sampling rate in Hz.
    start_s : float, optional
        Time in s of the first output, within the signal; default: the time of its first sample.
    method, missing
        As in `angular_resample`.

    Returns
    -------
    TimeSignal
        Up to the last time within the signal. The passband, ``passband_hz``, is 0.44 times `rate_hz` or, if less, 0.44
        times the samples per second of the signal at the lowest speed.

    Raises
    ------
    ValueError
        Revolutions outside the phase, a start outside the signal, a rate in a mistaken unit, values that are not
        finite, or a shaft that stands still or reverses within the signal.

    Examples
    --------
    Order 2 of a shaft at 25 Hz is a tone of 50 Hz:

    >>> import numpy as np
    >>> from signals import AngularSignal, constant_speed, time_resample
    >>> angle = 2 * np.pi * np.arange(100 * 64) / 64
    >>> signal = AngularSignal(values=np.cos(2 * angle), samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    >>> x = time_resample(signal, phase=constant_speed(25.0, start_s=0.0, stop_s=4.0), rate_hz=1000.0)
    >>> bool(np.allclose(x.values[100:-100], np.cos(2 * np.pi * 50 * x.times_s[100:-100]), atol=1e-5))
    True
    """
    choice(method, name="method", choices=METHODS)
    rate, per_rev = positive(rate_hz, name="rate_hz"), signal.samples_per_rev
    phase = forwards(phase)
    x = samples(signal.values, missing=missing, minimum=FEWEST[method])
    ends = signal.start_rev, signal.start_rev + (x.size - 1) / per_rev
    begin, end = _span_s(phase, *ends)
    refuse_rest(phase.times_s, phase.revolutions, start_s=begin, stop_s=end)
    start = begin if start_s is None else float(start_s)
    if not begin - _ROUNDING <= start <= end:
        raise ValueError(f"start_s={start:g} s lies outside the signal, {begin:g} to {end:g} s; start within it.")
    most_outputs = 1000  # per input: more suggests a mistaken unit
    if not 1 <= (end - begin) * rate <= most_outputs * x.size:
        raise ValueError(
            f"rate_hz={rate:g} would turn {x.size} samples into {(end - begin) * rate:.3g}; give a rate in Hz that "
            f"makes at least one and at most {most_outputs} times as many."
        )
    speeds = _speeds(phase, begin, end, points=x.size // NODE_STEP)
    slowest = max(float(speeds.min()), 1e-9 * float(speeds.max()))  # at rest dt/d(angle) is infinite

    def time_at(revolutions: Array) -> Array:
        times = phase.times_at(revolutions, at_rest="departure")
        within = revolutions <= ends[1] + _ROUNDING
        return np.where(within, np.minimum(times, end), times)  # the signal ends before a standstill at its end

    def time_per_rev(revolutions: Array) -> Array:
        return 1 / np.maximum(phase.speed_hz(time_at(revolutions)), slowest)

    known = phase.revolutions[[0, -1]]
    grid = Map(
        outward=Track(
            value=time_at,
            slope=time_per_rev,
            start=float(known[0]),
            stop=float(known[1]),
            origin=signal.start_rev,
            spacing=1 / per_rev,
            offset=start,
            scale=rate,
        ),
        inward=Track(
            value=phase.revolutions_at,
            slope=phase.speed_hz,
            start=phase.start_s,
            stop=phase.stop_s,
            origin=start,
            spacing=1 / rate,
            offset=signal.start_rev,
            scale=per_rev,
        ),
        outputs=int(np.floor((end - start) * rate + _ROUNDING)) + 1,
        least_slope=rate / (per_rev * float(speeds.max())),
        largest_slope=rate * (end - begin) / x.size,
        known=((phase.start_s - start) * rate, (phase.stop_s - start) * rate),
        slack=_ROUNDING * rate,
    )
    (values,), beyond = Warp(grid, method=method).whole(x[None])
    return TimeSignal(
        values=values,
        rate_hz=rate,
        start_s=start,
        passband_hz=float(PASSBAND / 2 * min(rate, per_rev * speeds.min())),
        unsettled=unsettled(beyond),
    )


def forwards(phase: ShaftPhase) -> ShaftPhase:
    """Return the phase, negated if its angle decreases; raise ValueError if the shaft reverses."""
    return phase if phase.direction > 0 else phase.scaled(-1)


def whole_revolutions(phase: ShaftPhase, *, start_s: float, stop_s: float) -> tuple[float, int]:
    """Return the first whole revolution (counted from the phase's first knot) in a span, and their number.

    Raise ValueError if there is none.
    """
    begin, end = max(start_s, phase.start_s), min(stop_s, phase.stop_s)
    span = 0.0
    if end > begin:
        at_begin, at_end = phase.revolutions_at(np.array([begin, end]))
        base = float(phase.revolutions[0])
        first = base + np.ceil(at_begin - base - _ROUNDING)
        span = at_end - first
    if span < 1 - _ROUNDING:
        raise ValueError(
            f"the record from {start_s:g} to {stop_s:g} s holds no whole revolution of the shaft (its phase is known "
            f"from {phase.start_s:g} to {phase.stop_s:g} s); record longer, or check sampling rate and tachometer."
        )
    return float(first), int(np.floor(span + _ROUNDING))


def angle_map(
    phase: ShaftPhase, *, rate_hz: float, start_s: float, samples_per_rev: int, first: float, revolutions: int
) -> Map:
    """Return the map from the samples of a record to the angle grid of `revolutions` starting at `first`."""
    begin, end = _span_s(phase, first, first + revolutions)
    most_samples = 10**10  # more than a day at 100 kHz suggests a mistaken unit
    if (end - begin) * rate_hz > most_samples:
        raise ValueError(
            f"rate_hz={rate_hz:g} amounts to {(end - begin) * rate_hz:.3g} samples in the {end - begin:g} s of the "
            "phase; correct the rate, or limit the phase to the record."
        )
    speeds = _speeds(phase, begin, end, points=int((end - begin) * rate_hz) // NODE_STEP)
    edges = phase.revolutions_at(np.array([phase.start_s, phase.stop_s]))
    return Map(
        outward=Track(
            value=phase.revolutions_at,
            slope=phase.speed_hz,
            start=phase.start_s,
            stop=phase.stop_s,
            origin=start_s,
            spacing=1 / rate_hz,
            offset=first,
            scale=samples_per_rev,
        ),
        outputs=revolutions * samples_per_rev,
        least_slope=samples_per_rev * float(speeds.min()) / rate_hz,
        largest_slope=samples_per_rev * float(speeds.max()) / rate_hz,
        known=(float(edges[0] - first) * samples_per_rev, float(edges[1] - first) * samples_per_rev),
        slack=_ROUNDING * samples_per_rev,
    )


def _span_s(phase: ShaftPhase, first: float, last: float) -> tuple[float, float]:
    """Return the times at which a shaft leaves one angle and reaches another."""
    begin, end = phase.times_at([first], at_rest="departure"), phase.times_at([last], at_rest="arrival")
    return float(begin[0]), float(end[0])


def _speeds(phase: ShaftPhase, begin: float, end: float, *, points: int) -> Array:
    return phase.speed_hz(np.clip(np.linspace(begin, end, points + 2), phase.start_s, phase.stop_s))


def passband_orders(grid: Map, samples_per_rev: int) -> float:
    """Return the highest order in the passband at every speed."""
    return PASSBAND / 2 * samples_per_rev * min(1.0, 1 / grid.largest_slope)


def unsettled(beyond: Flags) -> tuple[int, int]:
    """Count the flags set at the start and at the end."""
    if beyond.all():
        return beyond.size, beyond.size
    return int(np.argmin(beyond)), int(np.argmin(beyond[::-1]))
