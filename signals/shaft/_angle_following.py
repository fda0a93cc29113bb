"""Course of a speed followed in the angle domain, where the lines of the right one no longer smear.

An approximate course is integrated to an angle, the record is resampled evenly in it, and the orders are searched again
within a per cent of one, in frames that grow while the course gets better; last, the phase is refined from the
strongest harmonics (`signals.shaft.phase_demodulation`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from signals.shaft._line_likelihood import lowest_band
from signals.shaft._speed_search import SAME_SPEED, most_likely_speeds, search_speeds
from signals.shaft.phase import ShaftPhase
from signals.shaft.phase_demodulation import RefinedPhase, refine_phase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from signals._validation import Array

_FRAMES = 12  # of the longest length in the record: enough to see a line come and go
_MOST_REV = 32.0  # of the longest frame: beyond, no line of a speed that is known to a few bins gets narrower
SHOWS = 3.0  # least log likelihood ratio of an order that shows
_SAMPLES = 2.5  # per turn of the highest order
_MARGIN_ORDERS = 2.0


def in_angle(signal: Array, rate: float, phase: ShaftPhase, order: float) -> tuple[Array, Array, float]:
    """Return the record evenly sampled in angle up to an order, the times of its samples, and samples per turn."""
    top = order + _MARGIN_ORDERS
    band, band_rate = lowest_band(signal, rate_hz=rate, top_hz=min(top * fastest_hz(phase), rate / 2))
    per_rev = _SAMPLES * top
    turns = np.arange(phase.revolutions[0], phase.revolutions[-1], 1 / per_rev)
    times = PchipInterpolator(phase.revolutions, phase.times_s)(turns)
    return CubicSpline(np.arange(band.size) / band_rate, band)(times), times, per_rev


def fastest_hz(phase: ShaftPhase) -> float:
    """Return the highest mean speed between two times of a phase."""
    return float((np.diff(phase.revolutions) / np.diff(phase.times_s)).max())


def followed(signal: Array, rate: float, rough: ShaftPhase, orders: Array) -> ShaftPhase:
    """Return an approximate phase as the orders show it, in frames that grow to 32 revolutions."""
    turns = float(np.ptp(rough.revolutions))
    longest = min(2 * turns / (_FRAMES + 1), _MOST_REV)
    listed = orders[orders * fastest_hz(rough) * (1 + SAME_SPEED) < rate / 2]
    phase, tolerance = rough, SAME_SPEED
    fewest_samples = 64  # of a frame
    for doubling in range(2, -1, -1):  # two doublings of the frame length on the way there
        window = longest / 2**doubling
        if not listed.size or window * _SAMPLES * (listed[-1] + _MARGIN_ORDERS) < fewest_samples:
            continue
        values, _, per_rev = in_angle(signal, rate, phase, float(listed[-1]))
        search = search_speeds(values, per_rev, listed, 1 - tolerance, 1 + tolerance, tolerance / window, window)
        ratio = most_likely_speeds(search.votes, search)
        first, last = phase.revolutions[[0, -1]]
        at = np.concatenate([[first - 1e-6], first + search.evidence.times_s, [last + 1e-6]])
        turned = PchipInterpolator(at, np.concatenate([ratio[:1], ratio, ratio[-1:]])).antiderivative()
        knots = np.linspace(first, last, int(4.0 * (last - first)) + 8)  # four per revolution
        times = PchipInterpolator(phase.revolutions, phase.times_s)(knots)
        phase = ShaftPhase(times_s=times, revolutions=turned(knots))
        # 4.0 bins by which the highest order may still be off in frames of the next length
        tolerance = min(tolerance, 4.0 / (window * float(listed[-1])))
    return phase


def refinements(
    signal: Array, rate: float, phase: ShaftPhase, orders: Array, shown: Array
) -> Iterator[tuple[ShaftPhase, RefinedPhase]]:
    """Yield the refinements of a phase from the orders that show most, one for each length of windows."""
    most_demodulated = 8
    count = min(most_demodulated, max(np.count_nonzero(shown > SHOWS), 1))
    strongest = np.sort(orders[np.argsort(-shown)[:count]])
    turns = float(np.ptp(phase.revolutions))
    # 2.0 bins of the longest frame within which the highest order is known in the end
    tolerance = 2.0 / (min(2 * turns / (_FRAMES + 1), _MOST_REV) * float(orders[-1]))
    sure = 1.5e-3  # largest median std of the refined speed, relative: three of them are within half a per cent
    for window in (6.0, 24.0, 2.0):  # in revolutions
        try:
            refined = refine_phase(
                signal,
                rate_hz=rate,
                phase=phase,
                orders=strongest.tolist(),
                tolerance=tolerance,
                window_rev=min(window, turns / 3),
            )
        except ValueError:  # no order low enough, or too few turns
            continue
        relative = refined.std_hz / refined.speed_hz
        if refined.phase is not None and np.median(relative) < sure and relative.max() < SAME_SPEED:
            yield refined.phase, refined
