"""Order map: amplitude and phase of each order against shaft revolutions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from signals._transforms import window_of, without_mean
from signals._validation import Array, checked, real_vector, whole
from signals.spectra.spectra import hop_of, last_order, scaled_power, transformed

if TYPE_CHECKING:
    from signals.resampling.resampling import AngularSignal
    from signals.shaft.phase import ShaftPhase


@dataclass(frozen=True, kw_only=True)
class OrderMap:
    """Order spectra of successive segments of whole revolutions.

    A line on the grid of orders is ``value cos(order angle + phase_rad)``, so that the phase of a line locked to the
    shaft is constant.

    Attributes
    ----------
    order : (order,) array
        Orders, in cycles per revolution.
    revolution : (row,) array
        Angle of the middle of each segment in revolutions.
    time_s, speed_hz : (row,) arrays or None
        Time in s and speed in Hz at that angle; None without a phase.
    value : (row, order) array
        Peak amplitude.
    phase_rad : (row, order) array
        Phase in rad at the tachometer's datum.
    turns : int
        Revolutions per segment.
    bin_width, resolution, noise_bandwidth : float
        Reciprocal of `turns`, full -3 dB width and equivalent noise bandwidth of the Hann window, in orders.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal, map_orders
    >>> signal = AngularSignal(values=np.zeros(64 * 20), samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    >>> order_map = map_orders(signal, revolutions=4, overlap=0.5)
    >>> order_map.value.shape, order_map.revolution[:3].tolist()
    ((9, 113), [2.0, 4.0, 6.0])
    """

    order: Array = field(metadata={"dims": ("order",), "units": "cycles per revolution"})
    revolution: Array = field(metadata={"dims": ("row",), "units": "rev"})
    time_s: Array | None = field(metadata={"dims": ("row",), "units": "s"})
    speed_hz: Array | None = field(metadata={"dims": ("row",), "units": "Hz"})
    value: Array = field(metadata={"dims": ("row", "order"), "units": "as the record, peak"})
    phase_rad: Array = field(metadata={"dims": ("row", "order"), "units": "rad"})
    turns: int
    bin_width: float
    resolution: float
    noise_bandwidth: float


@checked
def map_orders(
    signal: AngularSignal,
    *,
    revolutions: int,
    overlap: float = 0.5,
    max_order: float | None = None,
    phase: ShaftPhase | None = None,
) -> OrderMap:
    """Return the spectrum over orders of each segment of whole revolutions, with its angle, time and speed.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the shaft; their mean is removed once, over the whole record.
    revolutions : int
        Revolutions per segment; the resolution with the Hann window is about ``1.44 / revolutions``.
    overlap : float
        Fraction of a segment that the next one shares, from 0 to below 1.
    max_order : float, optional
        Highest order of the map; default and upper limit: the passband of the signal.
    phase : ShaftPhase, optional
        Angle of the shaft over time, from which the time and speed of each row are computed.

    Returns
    -------
    OrderMap

    Raises
    ------
    ValueError
        More revolutions per segment than the signal has, an overlap outside 0 to 1, or revolutions outside the
        phase.

    Examples
    --------
    Order 7 of amplitude 2, in sine phase at the datum (-90 degrees), is the same in every row:

    >>> import numpy as np
    >>> from signals import AngularSignal, map_orders
    >>> angle = 2 * np.pi * np.arange(64 * 20) / 64
    >>> signal = AngularSignal(values=2 * np.sin(7 * angle), samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    >>> order_map = map_orders(signal, revolutions=4)
    >>> column = np.argmin(np.abs(order_map.order - 7))
    >>> bool(np.allclose(order_map.value[:, column], 2)), bool(np.allclose(order_map.phase_rad[:, column], -np.pi / 2))
    (True, True)
    """
    turns = whole(revolutions, name="revolutions", least=1, most=signal.revolutions)
    rate, length = signal.samples_per_rev, turns * signal.samples_per_rev
    shape, hop = window_of("hann", length), hop_of(length, overlap)
    order = np.arange(length // 2 + 1) / turns
    kept = int(np.searchsorted(order, last_order(signal, max_order), side="right"))
    values = real_vector(signal.values, name="the signal", minimum=4)
    lines = np.concatenate([part[:, :kept] for part in transformed(without_mean(values), shape, hop)])
    start = signal.start_rev + np.arange(len(lines)) * (hop / rate)
    middle = np.asarray(start + turns / 2, dtype=np.float64)
    times = None if phase is None else phase.times_at(middle)
    return OrderMap(
        order=order[:kept],
        revolution=middle,
        time_s=times,
        speed_hz=None if phase is None or times is None else phase.speed_hz(times),
        value=scaled_power(np.abs(lines) ** 2, shape, rate=rate, scaling="peak"),
        phase_rad=np.angle(lines * np.exp(-2j * np.pi * np.mod(np.outer(start, order[:kept]), 1.0))),
        turns=turns,
        bin_width=1 / turns,
        resolution=shape.width_bins / turns,
        noise_bandwidth=shape.noise_bandwidth_bins / turns,
    )
