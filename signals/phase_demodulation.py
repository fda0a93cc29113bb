"""The angle of a shaft from the phase of its own harmonics, starting from a rough idea of its speed.

Demodulated by ``exp(-j 2 pi h phi)`` with the rough phase ``phi`` (revolutions), order ``h`` becomes slow, and what
its phase still turns, over ``2 pi h``, is the error of ``phi``. Windows are cut along the angle: a Hann window of R
revolutions has zeros two bins, 2 / R orders, and more from its line, so all other whole orders about it, sidebands of
the same shaft among them, leave a steady line alone. All orders tell the same error; they are averaged with the
information each holds, ``(2 pi h)^2 2 snr_h`` (Urbanek, Barszcz & Antoni 2013 combine two steps alike; Peeters et al.
2019 compare the ways), and the phase is corrected and demodulated again.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.special import fdtri

from signals._checks import Array, positive, real_vector
from signals._speed_evidence import lowest_band
from signals.phase import ShaftPhase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

OVERLAP = 4  # hops a window, as the kernel has it
_CAPTURE = 0.35  # of one bin of the window: what an order may be off for its phase still to be told
_FIRST_REV, _LAST_REV = 2.0, 6.0
_PROMINENT = 3.0  # least mean power of a line over that beside it
_FALSE_ALARM = 1e-3
_REACH = 3  # hops on either side
_PASSES = 3  # with the last window
_SNR_WINDOWS = 9  # averaged
# of (-1, -2, 0, 2, 1) / 4 times the phases of windows, whose noise is shared by 0.66, 1/6, 0.007 with the next ones:
# 0.868; what smoothing between the passes leaves of their noise adds as much again (measured)
_DIFFERENCE_VARIANCE = 1.74
_COSINE = np.cos(2 * np.pi * np.arange(1025) / 1024)


@dataclass(frozen=True, kw_only=True)
class RefinedPhase:
    """A phase that follows the harmonics, and how sure it is.

    The standard deviations are by the noise beside the lines and by how far the orders disagree. The phase is
    free by a constant, and by what the path from shaft to sensor turns the phase of all orders together.
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
    """One demodulation: windows at even angles, and what their phases say."""

    phase: ShaftPhase
    centres_rev: Array
    correction: Array
    variance: Array
    information: Array
    orders: Array
    snr: Array
    prominence: Array


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
    """Refine a rough phase, such as a declared constant speed, by demodulating the shaft's orders.

    Parameters
    ----------
    x : (n,) array, any unit
        Vibration; finite.
    rate_hz : float
        Samples a second.
    phase : ShaftPhase
        What is known so far; the part of the record within it is used.
    orders : sequence of float
        Orders that the vibration may hold, per revolution of that shaft. Those that do not show count for nothing;
        those near half the sampling rate at top speed are left out, and are not in the result.
    tolerance : float
        How far the speed of `phase` may be off anywhere, as a fraction. The first pass takes orders below
        0.17 / tolerance only, whose lines are not yet mistaken for others; later passes take all.
    window_rev : float
        Length of the last windows in revolutions. Changes of speed within it are averaged.
    start_s : float
        Time of the first sample.

    Returns
    -------
    RefinedPhase
        "not found", without a phase, where the orders do not stand out of the noise beside them.

    Raises
    ------
    ValueError
        No order low enough for the tolerance, or a part of the record shorter than two windows.
    """
    signal = real_vector(x, name="the signal", minimum=16)
    rate = positive(rate_hz, name="rate_hz")
    tolerance = positive(tolerance, name="tolerance")
    window = positive(window_rev, name="window_rev")
    wanted = listed_orders(orders)
    reach = _CAPTURE / (_FIRST_REV * tolerance)
    if wanted[0] > reach:
        raise ValueError(
            f"the lowest order is {wanted[0]:g}, and a speed known within {tolerance:g} tells orders up to {reach:.3g} "
            "from their neighbours; give lower orders, or find the speed first (`estimate_speed`)."
        )
    inside = _within(signal.size, rate, phase, start_s)
    first, last = inside
    turned = np.diff(phase.revolutions_at(start_s + np.array([first, last - 1]) / rate))[0]
    if turned < 2 * window:
        raise ValueError(
            f"the phase and the record share {turned:.3g} revolutions; windows of {window:g} need {2 * window:g}. "
            "Record longer, or shorten window_rev."
        )
    part_start = start_s + first / rate
    knots = np.linspace(part_start, start_s + (last - 1) / rate, 512)
    top = float(phase.speed_hz(knots).max())
    usable = wanted[(wanted + 2) * top * (1 + tolerance) < rate / 2]
    if not usable.size:
        raise ValueError(
            f"the lowest order, {wanted[0]:g}, lies at {wanted[0] * top:.4g} Hz at top speed, too close to half the "
            f"sampling rate, {rate / 2:g} Hz; give lower orders, or a record of a higher rate."
        )
    band, band_rate = lowest_band(signal[first:last], rate_hz=rate, top_hz=(usable[-1] + 2) * top * (1 + tolerance))
    times = part_start + np.arange(band.size) / band_rate
    step = _one_pass(band, times, phase, usable[usable <= reach], window_rev=min(_FIRST_REV, window))
    for _ in range(_PASSES):
        step = _one_pass(band, times, _smooth(_corrected(step), window_rev=window), usable, window_rev=window)
    return _result(step)


def listed_orders(orders: Sequence[float]) -> Array:
    """Return the orders sorted, each once; raise where one is not above zero."""
    return np.unique([positive(float(order), name="an order") for order in orders]) if len(orders) else _no_orders()


def _no_orders() -> Array:
    raise ValueError("orders is empty; list the orders of the shaft that the vibration may hold, mesh orders first.")


def _within(samples: int, rate: float, phase: ShaftPhase, start_s: float) -> tuple[int, int]:
    first = max(0, int(np.ceil((phase.start_s - start_s) * rate - 1e-6)))
    last = min(samples, int(np.floor((phase.stop_s - start_s) * rate + 1e-6)) + 1)
    if last - first < 16:  # noqa: PLR2004
        raise ValueError(
            f"the record, {start_s:g} to {start_s + (samples - 1) / rate:g} s, and the phase, {phase.start_s:g} to "
            f"{phase.stop_s:g} s, do not overlap; check start_s."
        )
    return first, last


def _one_pass(signal: Array, times: Array, phase: ShaftPhase, orders: Array, *, window_rev: float) -> _Pass:
    from signals._speed_kernels import demodulate  # noqa: PLC0415

    clipped = np.clip(times, phase.start_s, phase.stop_s)
    revolutions = phase.revolutions_at(clipped)
    first, last = revolutions[0] + window_rev / 2, revolutions[-1] - window_rev / 2
    count = max(int((last - first) / (window_rev / OVERLAP)), 5) + 1
    hop = (last - first) / (count - 1)
    # where these windows have a zero for the line itself, and the last ones for its neighbours too
    aside = 0.5 * np.ceil(OVERLAP / window_rev) if window_rev < OVERLAP else 0.5
    beside = np.concatenate([np.abs(orders - aside), orders + aside])
    re, im = demodulate(
        signal,
        revolutions,
        np.concatenate([orders, beside]),
        first,
        hop,
        count,
        _COSINE,
    )
    amplitude = re + 1j * im
    lines, around = amplitude[:, : orders.size], np.abs(amplitude[:, orders.size :]) ** 2
    noise = _running_mean(around[:, : orders.size] + around[:, orders.size :]) / 2
    noise = np.maximum(noise, 1e-20 * np.abs(lines).max(initial=0.0) ** 2 + np.finfo(float).tiny)
    power = np.abs(lines) ** 2
    snr = np.maximum(_running_mean(power) / noise - 1, 0.0)
    correction, variance, information = _common_turn(lines, snr, orders, lag_rev=2 * hop)
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
    """Mean over neighbouring windows, (windows, orders), fewer at the ends."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    place = np.arange(values.shape[0])
    low = np.maximum(place - _SNR_WINDOWS // 2, 0)
    high = np.minimum(place + _SNR_WINDOWS // 2 + 1, place.size)
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def _common_turn(
    lines: NDArray[np.complex128], snr: Array, orders: Array, *, lag_rev: float
) -> tuple[Array, Array, Array]:
    """Relative error of the speed in every window, its variance, and the information about the phase.

    The turn of each order over two hops, averaged over three such spans, is divided by its order. Orders that disagree
    with the rest by more than their noise are weighed down (Cauchy's weights), and what disagreement remains widens
    the variance.
    """
    steps = lines[2:] * lines[:-2].conj()
    steps = np.concatenate([steps[:1], steps, steps[-1:]])
    padded = np.concatenate([steps[:1], steps, steps[-1:]])
    turn = np.angle(padded[:-2] + 2 * padded[1:-1] + padded[2:]) / (2 * np.pi * orders * lag_rev)
    information = (2 * np.pi * orders) ** 2 * 2 * snr
    precision = information * lag_rev**2 / _DIFFERENCE_VARIANCE + 1e-12
    weights = precision
    for _ in range(3):
        mean = (weights * turn).sum(axis=1) / weights.sum(axis=1)
        off = (turn - mean[:, None]) ** 2 * precision
        weights = precision / (1 + off / 9)
    total = weights.sum(axis=1)
    spread = np.ones(1)
    if orders.size > 1:
        spread = (weights * (turn - mean[:, None]) ** 2).sum(axis=1, keepdims=True) / (orders.size - 1)
        spread = np.maximum(_running_mean(spread)[:, 0], 1.0)
    return mean, spread / total, information.sum(axis=1)


def _corrected(step: _Pass) -> ShaftPhase:
    """Phase with the correction added up; beyond the outer windows' centres it is carried on."""
    hop = step.centres_rev[1] - step.centres_rev[0]
    more = int(np.floor((step.centres_rev[0] - step.phase.revolutions[0]) / hop + 1e-6))
    after = int(np.floor((step.phase.revolutions[-1] - step.centres_rev[-1]) / hop + 1e-6))
    knots = step.centres_rev[0] + hop * np.arange(-more, step.centres_rev.size + after)
    ends = step.phase.revolutions[[0, -1]]
    knots = np.concatenate([ends[:1], knots[(knots > ends[0] + hop / 2) & (knots < ends[1] - hop / 2)], ends[1:]])
    error = np.interp(knots, step.centres_rev, step.correction)
    moved = np.concatenate([[0.0], np.cumsum((error[1:] + error[:-1]) / 2 * np.diff(knots))])
    return ShaftPhase(times_s=step.phase.times_at(knots), revolutions=knots + moved)


def _smooth(phase: ShaftPhase, *, window_rev: float) -> ShaftPhase:
    """Phase without changes of speed within a window, which the next pass cannot see and could not correct."""
    from scipy.signal import savgol_filter  # noqa: PLC0415

    hop = window_rev / OVERLAP
    first, last = phase.revolutions[[0, -1]]
    revolutions = np.linspace(first, last, max(int((last - first) / hop), 2 * OVERLAP) + 1)
    times = phase.times_at(revolutions)
    # local parabolas: a steady acceleration is kept, at the ends too
    smoothed = savgol_filter(times, 2 * _REACH + 1, 2, mode="interp")
    return ShaftPhase(times_s=smoothed, revolutions=revolutions)


def _result(step: _Pass) -> RefinedPhase:
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
    """Return what noise passes once in a thousand records: a quantile of the F distribution, and at least three.

    Every second window counts as independent; there are two places beside each line.
    """
    windows = (step.centres_rev.size + 1) // 2
    return max(_PROMINENT, float(fdtri(2 * windows, 4 * windows, 1 - _FALSE_ALARM / step.orders.size)))
