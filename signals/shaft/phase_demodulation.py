"""Refinement of a shaft's phase by phase demodulation of its harmonics.

Demodulated by ``exp(-j 2 pi h phi)`` with the approximate phase ``phi`` (revolutions), order ``h`` becomes a slowly
varying complex amplitude, whose phase over ``2 pi h`` is the error of ``phi``. Windows are defined over angle: the
transform of a Hann window of R revolutions has zeros at 2 / R orders and at multiples of 1 / R beyond, so that other
whole orders, including sidebands of the same shaft, do not disturb a steady line. All orders estimate the same error;
they are averaged with their Fisher information ``(2 pi h)^2 2 snr_h``, the phase is corrected, and the demodulation
repeated. Urbanek, Barszcz & Antoni (2013) combine two such steps; Peeters et al. (2019) compare methods.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import fdtri

from signals._validation import Array, checked, number, positive, real_vector
from signals.shaft._speed_search import lowest_band
from signals.shaft.phase import ShaftPhase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

OVERLAP = 4  # hops per window, as in the kernel
_FIRST_REV, _LAST_REV = 2.0, 6.0
_COSINE = np.cos(2 * np.pi * np.arange(1025) / 1024)


@dataclass(frozen=True, kw_only=True)
class RefinedPhase:
    """A phase refined from harmonics, with standard deviations.

    The phase is determined up to a constant, and up to a phase change of the transfer path common to all orders.

    Attributes
    ----------
    status : {"ok", "not found"}
        Whether the orders rise above the noise.
    phase : ShaftPhase or None
        The refined phase; None if not found.
    times_s, speed_hz, std_hz : (window,) arrays
        Times in s of the windows, speed in Hz and its standard deviation, from the background noise of the lines and
        the disagreement between orders.
    phase_std_rev : (window,) array
        Standard deviation of the phase in revolutions.
    orders : (order,) array
        Orders used.
    snr : (window, order) array
        Ratio of line to noise power in each window.
    prominence : (order,) array
        Ratio of the mean power of each line to that of its background.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import constant_speed, refine_phase
    >>> noise = np.random.default_rng(1).standard_normal(4000)
    >>> phase = constant_speed(20.0, start_s=0.0, stop_s=4.0)
    >>> refine_phase(noise, rate_hz=1000, phase=phase, orders=[3], tolerance=0.01).status
    'not found'
    """

    status: Literal["ok", "not found"]
    phase: ShaftPhase | None
    times_s: Array = field(metadata={"dims": ("window",), "units": "s"})
    speed_hz: Array = field(metadata={"dims": ("window",), "units": "Hz"})
    std_hz: Array = field(metadata={"dims": ("window",), "units": "Hz"})
    phase_std_rev: Array = field(metadata={"dims": ("window",), "units": "rev"})
    orders: Array = field(metadata={"dims": ("order",), "units": "1"})
    snr: Array = field(metadata={"dims": ("window", "order"), "units": "1"})
    prominence: Array = field(metadata={"dims": ("order",), "units": "1"})


@dataclass(frozen=True, kw_only=True)
class _Pass:
    """Result of one demodulation, in windows at uniform steps of angle."""

    phase: ShaftPhase
    centres_rev: Array
    correction: Array
    variance: Array
    information: Array
    orders: Array
    snr: Array
    prominence: Array


@checked
def refine_phase(
    x: ArrayLike,
    *,
    rate_hz: float,
    phase: ShaftPhase,
    orders: Sequence[float],
    tolerance: float,
    window_rev: float = _LAST_REV,
    start_s: float = 0.0,
) -> RefinedPhase:
    """Refine an approximate phase, such as a declared constant speed, by demodulating the shaft's orders.

    Parameters
    ----------
    x : (n,) array
        Vibration, any unit; finite.
    rate_hz : float
        Sampling rate in Hz.
    phase : ShaftPhase
        The approximate phase; the part of the record within it is used.
    orders : sequence of float
        Orders of that shaft that the vibration may contain. Those below the noise have no weight; those near half the
        sampling rate at top speed are left out of the result.
    tolerance : float
        Largest relative error of the speed of `phase`. The first pass uses only the unambiguous orders, those below
        0.175 / tolerance; later passes use all.
    window_rev : float
        Length in revolutions of the windows of the final passes, over which changes of speed are averaged.
    start_s : float
        Time of the first sample in s.

    Returns
    -------
    RefinedPhase
        With status "not found" and no phase if the orders do not rise above their background noise.

    Raises
    ------
    ValueError
        No order low enough for the tolerance or the sampling rate, a shaft that stands still or reverses, or record and
        phase that share less than two windows.

    Examples
    --------
    A shaft at 20.1 Hz, declared as 20 Hz:

    >>> import numpy as np
    >>> from signals import constant_speed, refine_phase
    >>> t = np.arange(8000) / 1000
    >>> x = np.sin(2 * np.pi * 3 * 20.1 * t) + 0.1 * np.random.default_rng(1).standard_normal(t.size)
    >>> rough = constant_speed(20.0, start_s=0.0, stop_s=8.0)
    >>> refined = refine_phase(x, rate_hz=1000, phase=rough, orders=[3], tolerance=0.01)
    >>> refined.status, round(float(refined.phase.speed_hz([4.0])[0]), 1)
    ('ok', 20.1)
    """
    signal = real_vector(x, name="the signal", minimum=16)
    rate = positive(rate_hz, name="rate_hz")
    tolerance = positive(tolerance, name="tolerance")
    window = positive(window_rev, name="window_rev")
    listed = listed_orders(orders)
    # an order may be off by 0.35 bins of the window before its phase becomes ambiguous
    highest = 0.35 / (_FIRST_REV * tolerance)  # unambiguous order in the first pass
    if listed[0] > highest:
        raise ValueError(
            f"the lowest order, {listed[0]:g}, exceeds {highest:.3g}, the highest that is unambiguous with a speed "
            f"known to within {tolerance:g}; give lower orders, or find the speed first (`estimate_speed`)."
        )
    first, last = _within(signal.size, rate, phase, start_s)
    shared = np.diff(phase.revolutions_at(start_s + np.array([first, last - 1]) / rate))[0]
    if shared < 2 * window:
        raise ValueError(
            f"the phase and the record share {shared:.3g} revolutions; windows of {window:g} require {2 * window:g}. "
            "Record longer, reduce window_rev, or negate a phase that decreases."
        )
    part_start = start_s + first / rate
    knots = np.linspace(part_start, start_s + (last - 1) / rate, 512)
    top = float(phase.speed_hz(knots).max())
    usable = listed[(listed + 2) * top * (1 + tolerance) < rate / 2]
    if not usable.size:
        raise ValueError(
            f"the lowest order, {listed[0]:g}, lies at {listed[0] * top:.4g} Hz at top speed, too close to half the "
            f"sampling rate, {rate / 2:g} Hz; give lower orders, or sample faster."
        )
    if window * usable[-1] < 1:
        raise ValueError(
            f"window_rev={window:g} is shorter than one cycle of the highest order, {usable[-1]:g}; give "
            f"{1 / usable[-1]:.3g} revolutions or more."
        )
    band, band_rate = lowest_band(signal[first:last], rate_hz=rate, top_hz=(usable[-1] + 2) * top * (1 + tolerance))
    times = part_start + np.arange(band.size) / band_rate
    step = _one_pass(band, times, phase, usable[usable <= highest], window_rev=min(_FIRST_REV, window))
    for _ in range(3):  # three passes with the last window
        step = _one_pass(band, times, _smooth(_corrected(step), window_rev=window), usable, window_rev=window)
    return _result(step)


def listed_orders(orders: Sequence[float]) -> Array:
    """Return the distinct orders, sorted; raise ValueError if there is none, or one not plausible for a shaft."""
    if not len(orders):
        raise ValueError("orders is empty; list the orders of the shaft that the vibration may contain, as of meshes.")
    found, least = np.unique([positive(order, name="an order") for order in orders]), 1e-6
    for order in found[[0, -1]]:
        if not least <= order <= 1 / least:
            raise ValueError(
                f"order {order:g} is not plausible for a shaft; list orders from {least:g} to {1 / least:g}."
            )
    return found


def _within(samples: int, rate: float, phase: ShaftPhase, start_s: float) -> tuple[int, int]:
    """Return the first sample within the phase and that after the last, or raise where they do not overlap."""
    start_s = number(start_s, name="start_s")
    first = max(0, int(np.ceil((phase.start_s - start_s) * rate - 1e-6)))
    last = min(samples, int(np.floor((phase.stop_s - start_s) * rate + 1e-6)) + 1)
    if last - first < 16:  # noqa: PLR2004
        raise ValueError(
            f"the record, {start_s:g} to {start_s + (samples - 1) / rate:g} s, and the phase, {phase.start_s:g} to "
            f"{phase.stop_s:g} s, do not overlap; check start_s."
        )
    return first, last


def _one_pass(signal: Array, times: Array, phase: ShaftPhase, orders: Array, *, window_rev: float) -> _Pass:
    """Demodulate all orders with a phase; return its correction and the background noise of the lines."""
    from signals.shaft._kernels import demodulate  # noqa: PLC0415

    clipped = np.clip(times, phase.start_s, phase.stop_s)
    revolutions = phase.revolutions_at(clipped)
    first, last = revolutions[0] + window_rev / 2, revolutions[-1] - window_rev / 2
    count = max(int((last - first) / (window_rev / OVERLAP)), 5) + 1
    hop = (last - first) / (count - 1)
    # a distance at which these windows have a zero for the line itself, and the final ones also for its neighbours
    aside = 0.5 * np.ceil(OVERLAP / window_rev) if window_rev < OVERLAP else 0.5
    beside = np.concatenate([np.abs(orders - aside), orders + aside])
    re, im = demodulate(signal, revolutions, np.concatenate([orders, beside]), first, hop, count, _COSINE)
    amplitude = re + 1j * im
    lines, around = amplitude[:, : orders.size], np.abs(amplitude[:, orders.size :]) ** 2
    noise = _running_mean(around[:, : orders.size] + around[:, orders.size :]) / 2
    noise = np.maximum(noise, 1e-20 * np.abs(lines).max(initial=0.0) ** 2 + np.finfo(float).tiny)
    power = np.abs(lines) ** 2
    snr = np.maximum(_running_mean(power) / noise - 1, 0.0)
    correction, variance, information = _speed_error(lines, snr, orders, lag_rev=2 * hop)
    return _Pass(
        phase=phase,
        centres_rev=first + hop * np.arange(count),
        correction=correction,
        variance=variance,
        information=information,
        orders=orders,
        snr=snr,
        prominence=power.mean(axis=0) / noise.mean(axis=0),
    )


def _running_mean(values: Array) -> Array:
    """Return the mean over nine successive windows, (windows, orders), fewer at the ends."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    index = np.arange(values.shape[0])
    snr_windows = 9  # averaged
    low = np.maximum(index - snr_windows // 2, 0)
    high = np.minimum(index + snr_windows // 2 + 1, index.size)
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def _speed_error(
    lines: NDArray[np.complex128], snr: Array, orders: Array, *, lag_rev: float
) -> tuple[Array, Array, Array]:
    """Return the relative error of the speed in every window, its variance, and the information on the phase.

    The phase increment of each order over two hops, averaged over three such spans, is divided by the order. Orders
    that disagree with the rest by more than their noise are down-weighted (Cauchy weights, three iterations); the
    remaining disagreement increases the variance and reduces the information by the same factor.
    """
    steps = lines[2:] * lines[:-2].conj()
    steps = np.concatenate([steps[:1], steps, steps[-1:]])
    padded = np.concatenate([steps[:1], steps, steps[-1:]])
    error = np.angle(padded[:-2] + 2 * padded[1:-1] + padded[2:]) / (2 * np.pi * orders * lag_rev)
    information = (2 * np.pi * orders) ** 2 * 2 * snr
    # the variance of (-1, -2, 0, 2, 1) / 4 times the phases of successive windows, whose noise correlates by 0.66, 1/6
    # and 0.007, is 0.868; the noise left by the smoothing between passes adds as much again (measured)
    difference_variance = 1.74
    precision = information * lag_rev**2 / difference_variance + 1e-12
    weights = precision
    for _ in range(3):
        mean = (weights * error).sum(axis=1) / weights.sum(axis=1)
        squared = (error - mean[:, None]) ** 2 * precision
        weights = precision / (1 + squared / 9)
    total = weights.sum(axis=1)
    spread = np.ones(1)
    if orders.size > 1:
        spread = (weights * (error - mean[:, None]) ** 2).sum(axis=1, keepdims=True) / (orders.size - 1)
        spread = np.maximum(_running_mean(spread)[:, 0], 1.0)
    return mean, spread / total, information.sum(axis=1) / spread


def _corrected(step: _Pass) -> ShaftPhase:
    """Return the phase with the integrated correction, which is constant beyond the centres of the outer windows."""
    hop = step.centres_rev[1] - step.centres_rev[0]
    before = int(np.floor((step.centres_rev[0] - step.phase.revolutions[0]) / hop + 1e-6))
    after = int(np.floor((step.phase.revolutions[-1] - step.centres_rev[-1]) / hop + 1e-6))
    knots = step.centres_rev[0] + hop * np.arange(-before, step.centres_rev.size + after)
    ends = step.phase.revolutions[[0, -1]]
    knots = np.concatenate([ends[:1], knots[(knots > ends[0] + hop / 2) & (knots < ends[1] - hop / 2)], ends[1:]])
    error = np.interp(knots, step.centres_rev, step.correction)
    moved = np.concatenate([[0.0], np.cumsum((error[1:] + error[:-1]) / 2 * np.diff(knots))])
    return ShaftPhase(times_s=step.phase.times_at(knots), revolutions=knots + moved)


def _smooth(phase: ShaftPhase, *, window_rev: float) -> ShaftPhase:
    """Return the phase without speed changes shorter than a window, which the next pass could not correct."""
    from scipy.signal import savgol_filter  # noqa: PLC0415

    hop = window_rev / OVERLAP
    first, last = phase.revolutions[[0, -1]]
    revolutions = np.linspace(first, last, max(int((last - first) / hop), 2 * OVERLAP) + 1)
    times = phase.times_at(revolutions)
    # local parabolas preserve a constant acceleration, also at the ends
    smoothed = savgol_filter(times, 2 * 3 + 1, 2, mode="interp")  # 3 hops on either side
    return ShaftPhase(times_s=smoothed, revolutions=revolutions)


def _result(step: _Pass) -> RefinedPhase:
    """Return the result of the last pass."""
    found = bool(np.any(step.prominence > _least_prominence(step)))
    phase_std = 1 / np.sqrt(np.maximum(step.information, 1e-12))
    phase = _corrected(step)
    times = step.phase.times_at(step.centres_rev)
    speed = phase.speed_hz(np.clip(times, phase.start_s, phase.stop_s))
    return RefinedPhase(
        status="ok" if found else "not found",
        phase=replace(phase, jitter_s=float(np.median(phase_std / speed))) if found else None,
        times_s=times,
        speed_hz=speed,
        std_hz=speed * np.sqrt(step.variance),
        phase_std_rev=phase_std,
        orders=step.orders,
        snr=step.snr,
        prominence=step.prominence,
    )


def _least_prominence(step: _Pass) -> float:
    """Return the prominence that noise exceeds in one record in a thousand, a quantile of F, but at least three.

    Every second window is taken as independent; the noise is measured on both sides of each line.
    """
    windows = (step.centres_rev.size + 1) // 2
    false_alarm = 1e-3
    # at least 3.0, the ratio of the mean power of a line to that of its background
    return max(3.0, float(fdtri(2 * windows, 4 * windows, 1 - false_alarm / step.orders.size)))
