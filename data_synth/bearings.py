"""Rolling-element bearing faults: when a defect is struck, and how hard.

Intervals between impacts are independent, so the error of their times grows like that of a random walk and
the train has no exact period (Antoni and Randall 2003, J. Vib. Acoust. 125, 282-289). Where the defect turns
through the load zone, impacts follow the load distribution of Stribeck with an exponent 3/2 for point contact.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from data_synth.profile import Array
from data_synth.scene import BearingFault
from hums.orders import BearingOrders

_POINT_CONTACT = 1.5
_SPARE_DEVIATIONS = 10  # draw enough intervals that the span is covered but for odds of 1e-23


def impact_revolutions(
    *, order: float, fault: BearingFault, span_rev: tuple[float, float], rng: np.random.Generator
) -> Array:
    """Draw where on the reference shaft's angle the defect is struck.

    Parameters
    ----------
    order : float
        Impacts per revolution of the reference under pure rolling.
    fault : BearingFault
        States the slip.
    span_rev : (float, float)
        First and last revolution of interest.
    rng : numpy.random.Generator

    Returns
    -------
    (n,) array
        Revolutions, rising, within the span; intervals ``(1 + slip_std g) / (order (1 - mean_slip))``.
    """
    first, last = span_rev
    interval = 1 / (order * (1 - fault.mean_slip))
    expected = (last - first) / interval
    count = math.ceil(expected + _SPARE_DEVIATIONS * fault.slip_std * math.sqrt(expected)) + 2
    begin = first - interval * rng.random()
    struck = begin + interval * np.cumsum(1 + fault.slip_std * rng.standard_normal(count))
    return np.asarray(struck[(struck >= first) & (struck <= last)])


def load_zone_order(kind: str, rates: BearingOrders) -> float:
    """Return how often the struck part passes through the load zone, in orders; 0 where it stays in it."""
    turning = {"inner_race": rates.inner_ring, "outer_race": rates.outer_ring, "rolling_element": rates.cage}
    return abs(turning.get(kind, 0.0))


def stribeck_load(angle_rad: ArrayLike, *, distribution: float) -> Array:
    """Return the load on an element relative to the largest: ``max(0, 1 - (1 - cos psi) / (2 eps)) ** 1.5``.

    Parameters
    ----------
    angle_rad : (n,) array
        psi, from the middle of the load zone, in rad.
    distribution : float
        eps: 0.5 where half of the ring carries, less with clearance, more with preload.
    """
    lowered = (1 - np.cos(np.asarray(angle_rad, dtype=np.float64))) / (2 * distribution)
    return np.asarray(np.maximum(0.0, 1 - lowered) ** _POINT_CONTACT)


def impact_weights(revolutions: Array, *, order: float, fault: BearingFault, rng: np.random.Generator) -> Array:
    """Return the relative force of impacts at `revolutions` (n,) of a part that passes the load at `order`."""
    if order == 0:
        return np.ones_like(revolutions)
    angle = 2 * np.pi * (order * revolutions + rng.random())
    return stribeck_load(angle, distribution=fault.load_distribution)
