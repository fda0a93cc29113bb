"""Order map: how each order's amplitude and phase go with the turns of the shaft."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, get_args

import numpy as np

from signals._checks import Array, choice, real_vector, whole
from signals._windows import window_of
from signals.spectra import Scaling, hop_of, scaled_power, transformed, without_mean

if TYPE_CHECKING:
    from signals.phase import ShaftPhase
    from signals.resampling import AngularSignal


@dataclass(frozen=True, kw_only=True)
class OrderMap:
    """Spectra over orders of segments that follow each other along the record.

    ``resolution`` is the window's full -3 dB width in orders, ``turns`` the revolutions each row rests on. A line at an
    order on the grid reads ``Re{value exp(j (order angle + phase_rad))}``: a line locked to the shaft keeps its phase.
    """

    order: Array = field(metadata={"dims": ("order",), "units": "cycles per revolution"})
    revolution: Array = field(metadata={"dims": ("row",), "units": "rev"})
    time_s: Array | None = field(metadata={"dims": ("row",), "units": "s"})
    speed_hz: Array | None = field(metadata={"dims": ("row",), "units": "Hz"})
    value: Array = field(metadata={"dims": ("row", "order"), "units": "as the record, or squared per order"})
    phase_rad: Array = field(metadata={"dims": ("row", "order"), "units": "rad"})
    scaling: Scaling
    turns: int
    bin_width: float
    resolution: float
    noise_bandwidth: float
    window: str


def map_orders(
    signal: AngularSignal,
    *,
    revolutions: int,
    overlap: float = 0.5,
    window: str = "hann",
    scaling: Scaling = "peak",
    max_order: float | None = None,
    phase: ShaftPhase | None = None,
) -> OrderMap:
    """Return the spectrum over orders of each segment of whole revolutions, its middle's angle and time.

    Parameters
    ----------
    signal : AngularSignal
        Its mean is removed once, over the whole record.
    revolutions : int
        Turns of a segment; orders closer than `OrderMap.resolution`, about 1.44 over it with the Hann window, merge.
    overlap : float
        Part of a segment that the next one shares, from 0 to below 1.
    window : str
        A window of `scipy.signal`.
    scaling : str
        ``peak`` or ``rms`` amplitude of a line, or power ``density`` per order.
    max_order : float, optional
        Where the map ends; default the signal's passband.
    phase : ShaftPhase, optional
        The shaft's angle over time, for the time and speed of each row.
    """
    turns = whole(revolutions, name="revolutions", least=1, most=signal.revolutions)
    choice(scaling, name="scaling", choices=get_args(Scaling))
    rate, length = signal.samples_per_rev, turns * signal.samples_per_rev
    shape, hop = window_of(window, length), hop_of(length, overlap)
    last = signal.passband_orders if max_order is None else min(max_order, signal.passband_orders)
    order = np.arange(length // 2 + 1) / turns
    kept = int(np.searchsorted(order, last, side="right"))
    values = real_vector(signal.values, name="the signal", minimum=4)
    lines = np.concatenate([some[:, :kept] for some in transformed(without_mean(values), shape, hop)])
    start = signal.start_rev + np.arange(len(lines)) * (hop / rate)
    middle = np.asarray(start + turns / 2, dtype=np.float64)
    times = None if phase is None else phase.times_at(middle)
    return OrderMap(
        order=order[:kept],
        revolution=middle,
        time_s=times,
        speed_hz=None if phase is None or times is None else phase.speed_hz(times),
        value=scaled_power(np.abs(lines) ** 2, shape, rate=rate, scaling=scaling),
        phase_rad=np.angle(lines * np.exp(-2j * np.pi * np.mod(np.outer(start, order[:kept]), 1.0))),
        scaling=scaling,
        turns=turns,
        bin_width=1 / turns,
        resolution=shape.width_bins / turns,
        noise_bandwidth=shape.noise_bandwidth_bins / turns,
        window=window,
    )
