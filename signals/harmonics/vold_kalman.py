"""The smoother parametrised by weights: the multi-order Vold-Kalman filter of the second generation.

It minimises, over the envelopes Z of all orders together, `sum |r D^p Z|^2 + sum |2 x - sum Z exp(j order phase)|^2`
with weights r, D^p the p-th difference [1]_, [2]_. The exact smoother does the same with the real record in place of
the complex one, so that orders are also separated from the images at minus their frequencies; its weights are
r^2 = N / q.

References
----------
.. [1] H. Vold, M. Mains, J. Blough, "Theoretical foundations for high performance order tracking with the Vold-Kalman
   tracking filter", SAE 972007, 1997.
.. [2] J. Tuma, "Setting the passband width in the Vold-Kalman order tracking filter", 12th Int. Congress on Sound
   and Vibration, Lisbon 2005.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from signals._validation import checked, real_array
from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.model import Method  # noqa: TC001 - `checked` looks its name up
from signals.harmonics.tracker import track_orders

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.harmonics.model import Order
    from signals.harmonics.tracks import OrderTracks


@checked
def vold_kalman_filter(
    x: ArrayLike,
    *,
    phase_rad: ArrayLike | Mapping[str, ArrayLike],
    orders: Sequence[Order] | NDArray[np.float64],
    weight: ArrayLike,
    poles: int,
    rate_hz: float,
    method: Method | Literal["auto"] = "auto",
    output_every: int = 1,
) -> OrderTracks:
    """Estimate the complex amplitudes of all orders jointly, given Vold-Kalman weights instead of bandwidths.

    Parameters
    ----------
    x, phase_rad, orders, method, output_every
        As for `track_orders`.
    weight
        Weight r of the `poles`-th difference of each envelope, one number or (order,) array; a bandwidth has the weight
        `Bandwidth.weight`.
    poles
        Order of the difference that is kept small, 1 to 4.
    rate_hz
        Sampling rate in Hz, which gives the bandwidths of the result in Hz; the estimates do not depend on it.

    Returns
    -------
    OrderTracks
        With the bandwidths of these weights, in Hz.

    Raises
    ------
    ValueError
        A weight has no bandwidth, or as for `track_orders`.

    Examples
    --------
    With one pole and a large weight the bandwidth is `rate_hz sqrt(sqrt(2) - 1) / (pi weight)`, here 2.05 Hz:

    >>> import numpy as np
    >>> from signals.harmonics import vold_kalman_filter
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 2 * np.cos(3 * phase_rad)
    >>> tracks = vold_kalman_filter(x, phase_rad=phase_rad, orders=[3], weight=500, poles=1, rate_hz=5000)
    >>> print(tracks.bandwidth.round(2), np.abs(tracks.complex_amplitude[:, 2500]).round(3))
    [2.05] [2.]
    """
    weights = real_array(weight, name="weight").astype(np.float64)
    widths = [Bandwidth.from_weight(r, poles=poles).hz(rate_hz) for r in weights.ravel().tolist()]
    return track_orders(
        x, phase_rad=phase_rad, orders=orders, bandwidth_hz=np.reshape(widths, weights.shape), rate_hz=rate_hz,
        poles=poles, method=method, output_every=output_every,
    )  # fmt: skip
