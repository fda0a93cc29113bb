"""The smoother under its usual name: the multi-order Vold-Kalman filter of the second generation.

It minimises, over the envelopes Z of all orders together, `sum |r D^p Z|^2 + sum |2 x - sum Z exp(j order phase)|^2`
with weights r, D^p the p-th difference [1]_, [2]_. The exact smoother does the same with the real record in place of
the complex one, so that the orders' images, at minus their frequencies, are told apart from them too; its weights are
r^2 = N / q.

References
----------
.. [1] H. Vold, M. Mains, J. Blough, "Theoretical foundations for high performance order tracking with the Vold-Kalman
   tracking filter", SAE 972007, 1997.
.. [2] J. Tuma, "Setting the passband width in the Vold-Kalman order tracking filter", 12th Int. Congress on Sound
   and Vibration, Lisbon 2005.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.model import Method, Order
from signals.harmonics.tracker import track_orders
from signals.harmonics.tracks import OrderTracks


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
    """Estimate the complex amplitudes of all orders together, with Vold-Kalman weights instead of bandwidths.

    Parameters
    ----------
    x, phase_rad, orders, method, output_every : as for `track_orders`.
    weight : r of the differences of each envelope, one number or (order,): `Bandwidth.weight` of a bandwidth.
    poles : 1 to 4, which difference of the envelopes is kept small.
    rate_hz : samples per second; the weights do not depend on it, but the bandwidths in the result do.

    Returns
    -------
    OrderTracks
        With the bandwidths of these weights, in Hz.
    """
    weights = np.asarray(weight, dtype=np.float64)
    widths = [Bandwidth.from_weight(r, poles=poles).hz(rate_hz) for r in weights.ravel().tolist()]
    return track_orders(
        x,
        phase_rad=phase_rad,
        orders=orders,
        bandwidth_hz=np.reshape(widths, weights.shape),
        rate_hz=rate_hz,
        poles=poles,
        method=method,
        output_every=output_every,
    )
