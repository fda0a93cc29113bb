"""Spectrum of a whole record in the angle of a shaft, where its lines are as sharp as the record allows.

Over hundreds of turns a bin is some thousandths of an order. There a line of the shaft stands in the bin of its order;
that of another machine, or a sideband that a wrong speed takes for a mesh, is beside it, and along a wrong path it is
smeared (Fyfe and Munck 1997, "Analysis of computed order tracking").

Any one line may be any one order. What speaks for a speed is therefore the level of all lines beside the strongest; its
rivals are the speeds at which the strongest line is another order: octaves, neighbours among close orders, ratios of
gears. Whole orders below ten and those of slower shafts, which a line of low frequency of any machine may be, count
only where no other order stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

from signals.shaft._line_likelihood import lowest_band
from signals.shaft._speed_search import SAME_SPEED, is_low

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals._validation import Array
    from signals.shaft.phase import ShaftPhase

_SAMPLES = 2.5  # per turn of the highest order
_MARGIN_ORDERS = 2.0
_REACH_BINS = 1.5  # a mode that the line crosses turns it by half a turn, which is half a bin, and widens it
_AROUND_BINS = 81
_LOWEST_BIN = 4
# over the noise: three bins of noise exceed it once in 7000. At 12 dB, 30 orders would once in 10^5 records
_NOISE_DB = 10.0


@dataclass(frozen=True, kw_only=True)
class SharpLines:
    """Sum of the levels of all lines beside the strongest, in dB above the highest noise, of a speed and its rivals.

    `rival` is the largest sum of a speed at which the strongest line is another order.
    """

    joint: float
    rival: float


def of_shafts(orders: Array) -> NDArray[np.bool_]:
    """Return whether each order is a whole one below ten, or of a slower shaft."""
    return np.asarray(is_low(orders) | (orders < 1))


def sharp_lines(
    signal: Array, rate: float, phase: ShaftPhase, orders: Array, *, range_hz: tuple[float, float]
) -> SharpLines:
    """Return what stands in the bins of the orders over the whole of a phase, and of the strongest line's readings."""
    top = min(float(orders[-1]), rate / 2 / _fastest_hz(phase))
    values, per_rev = in_angle(signal, rate, phase, top)
    turns = values.size / per_rev
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(values.size) + 0.5) / values.size)
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    noise = np.maximum(median_filter(power, _AROUND_BINS) / np.log(2), 1e-20 * power.max() + np.finfo(float).tiny)
    ratio = power / noise
    own = _levels(ratio, orders * turns, top * turns)
    meshes = ~of_shafts(orders)
    counted = meshes if own[meshes].any() else np.ones(orders.size, dtype=np.bool_)
    strongest = orders[counted][np.argmax(own[counted])]
    speed_hz = float(np.ptp(phase.revolutions) / np.ptp(phase.times_s))
    ratios = strongest / orders[counted]
    within = (ratios * speed_hz > range_hz[0]) & (ratios * speed_hz < range_hz[1]) & (np.abs(ratios - 1) > SAME_SPEED)
    others = (_joint(_levels(ratio, orders[counted] * other * turns, top * turns)) for other in ratios[within])
    return SharpLines(joint=_joint(own[counted]), rival=max(others, default=0.0))


def _levels(ratio: Array, at: Array, top: float) -> Array:
    """Return the level in dB above the highest noise at each place in bins, zero below, and for a stronger one's skirt.

    `ratio` is the power over the noise.
    """
    bins = np.rint(at[:, None] + np.array([-1.0, 0.0, 1.0])).astype(np.int64)
    known = (np.abs(bins - at[:, None]) <= _REACH_BINS) & (bins >= _LOWEST_BIN) & (bins <= min(top, ratio.size - 1))
    highest = np.where(known, ratio[np.where(known, bins, 0)], 0.0).max(axis=1)
    skirt = np.maximum(2 * _REACH_BINS, 1 + np.cbrt(np.sqrt(highest) / np.pi))  # as `leakage_bins` of a search
    apart = np.abs(at[:, None] - at)
    number = np.arange(at.size)
    stronger = (highest > highest[:, None]) | ((highest == highest[:, None]) & (number < number[:, None]))
    beside = (stronger & (apart <= skirt)).any(axis=1)
    return np.where(beside, 0.0, np.maximum(10 * np.log10(np.maximum(highest, 1e-9)) - _NOISE_DB, 0.0))


def _joint(levels: Array) -> float:
    """Return the sum of all levels beside the highest."""
    return float(levels.sum() - levels.max(initial=0.0))


def in_angle(signal: Array, rate: float, phase: ShaftPhase, order: float) -> tuple[Array, float]:
    """Return the record evenly sampled in angle up to an order, and the samples per revolution."""
    samples, per_rev = sampled(signal, rate, order, _fastest_hz(phase))
    return np.asarray(samples(phase.times_at(even_angles(phase, per_rev)))), per_rev


def sampled(signal: Array, rate: float, order: float, fastest_hz: float) -> tuple[CubicSpline, float]:
    """Return a spline through the band of the orders, and the samples per revolution that they need."""
    top = order + _MARGIN_ORDERS
    band, band_rate = lowest_band(signal, rate_hz=rate, top_hz=min(top * fastest_hz, rate / 2))
    return CubicSpline(np.arange(band.size) / band_rate, band), _SAMPLES * top


def even_angles(phase: ShaftPhase, per_rev: float) -> Array:
    """Return even angles over a phase, in revolutions."""
    return np.arange(phase.revolutions[0], phase.revolutions[-1], 1 / per_rev)


def _fastest_hz(phase: ShaftPhase) -> float:
    """Return the highest speed between two times of a phase."""
    return float((np.diff(phase.revolutions) / np.diff(phase.times_s)).max())
