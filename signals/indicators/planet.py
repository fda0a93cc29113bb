"""Indicators of a planet carrier: sidebands of the ring mesh, at orders that equal planets cause or cancel.

The examples start from what the docstring of `signals.indicators` defines.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from signals._validation import Array, checked, whole
from signals.angle.averaging import SynchronousAverage
from signals.indicators._kinds import expect
from signals.indicators.shaft import line_amplitude


@dataclass(frozen=True, kw_only=True)
class CarrierSidebands:
    """Amplitudes around one harmonic of the ring mesh, in the average over the carrier, from `carrier_sidebands`.

    Attributes
    ----------
    orders : (line,) array
        Orders of the carrier.
    amplitude : (line,) array
        Peak amplitudes, in the unit of the record.
    planets : int
        Number of planets.

    Examples
    --------
    Lines at orders 39 and 40 about the mesh order 40 of a ring of 40 teeth; three planets add up at multiples of 3:

    >>> from signals.indicators import carrier_sidebands
    >>> average = average_of(np.cos(39 * angle) + 0.5 * np.cos(40 * angle))
    >>> lines = carrier_sidebands(average, ring_teeth=40, planets=3, harmonic=1, sidebands=3)
    >>> lines.amplitude.round(6).tolist(), lines.orders[lines.expected].tolist()  # orders 37 to 43
    ([0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0], [39, 42])
    """

    orders: NDArray[np.int64] = field(metadata={"dims": ("line",), "units": "order of the carrier"})
    amplitude: Array = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    planets: int

    @property
    def expected(self) -> NDArray[np.bool_]:
        """(line,) array, true at multiples of the number of planets, where the planets' contributions add up."""
        return np.asarray(self.orders % self.planets == 0)

    @property
    def ratio(self) -> float:
        """RMS of the amplitudes where equal planets cancel over that where they add up."""
        expected = float(np.sqrt(np.mean(self.amplitude[self.expected] ** 2)))
        other = float(np.sqrt(np.mean(self.amplitude[~self.expected] ** 2)))
        return other / expected if expected > 0 else np.inf


@checked
def carrier_sidebands(
    average: SynchronousAverage, *, ring_teeth: int, planets: int, harmonic: int, sidebands: int
) -> CarrierSidebands:
    """Return the sidebands of a ring mesh at orders that equal, evenly spaced planets cause or cancel.

    Such planets pass a sensor on the ring with phases that cancel at every order that is no multiple of their number
    (McFadden & Smith 1985, Proc. Instn Mech. Engrs C 199, 65-70). A crack in the carrier or one bad planet makes them
    unequal, and the ratio rises (Keller & Grabill 2003, "Vibration monitoring of UH-60A main transmission planetary
    carrier fault", AHS Forum 59). Planets that are not evenly spaced make it high in a healthy gearbox too.

    Parameters
    ----------
    average : SynchronousAverage
        Over revolutions of the carrier.
    ring_teeth : int
        Teeth of the fixed ring: the order of its mesh.
    planets : int
        Number of planets.
    harmonic : int
        Number of the mesh harmonic.
    sidebands : int
        Number of orders on either side; at least the number of planets.

    Returns
    -------
    CarrierSidebands

    Raises
    ------
    ValueError
        Orders below 1 or above the passband of the average.

    Examples
    --------
    Three planets on a ring of 40 teeth give lines at 39 and 42 about the mesh order 40:

    >>> from signals.indicators import carrier_sidebands
    >>> average = average_of(2 * np.cos(39 * angle) + np.cos(42 * angle))
    >>> lines = carrier_sidebands(average, ring_teeth=40, planets=3, harmonic=1, sidebands=3)
    >>> lines.orders[lines.expected].tolist(), round(lines.ratio, 6)
    ([39, 42], 0.0)
    """
    expect(average, SynchronousAverage, indicator="the carrier sideband ratio")
    count = whole(planets, name="planets", least=2)
    side = whole(sidebands, name="sidebands", least=count)
    centre = whole(ring_teeth, name="ring_teeth", least=2) * whole(harmonic, name="harmonic", least=1)
    if centre - side < 1:
        raise ValueError(f"{side} sidebands about order {centre} reach below order 1; take fewer.")
    orders = np.arange(centre - side, centre + side + 1)
    amplitude = np.array([line_amplitude(average, int(order)) for order in orders])
    return CarrierSidebands(orders=orders, amplitude=amplitude, planets=count)


@checked
def carrier_sideband_ratio(
    average: SynchronousAverage, *, ring_teeth: int, planets: int, harmonic: int, sidebands: int
) -> float:
    """Return the RMS of the sidebands that equal planets cancel over that of the others: `CarrierSidebands.ratio`.

    Parameters
    ----------
    average, ring_teeth, planets, harmonic, sidebands
        As for `carrier_sidebands`.

    Examples
    --------
    >>> from signals.indicators import carrier_sideband_ratio
    >>> average = average_of(np.cos(39 * angle) + 0.5 * np.cos(40 * angle))  # RMS 0.5 / sqrt(5) over 1 / sqrt(2)
    >>> round(carrier_sideband_ratio(average, ring_teeth=40, planets=3, harmonic=1, sidebands=3), 4)
    0.3162
    """
    return carrier_sidebands(
        average, ring_teeth=ring_teeth, planets=planets, harmonic=harmonic, sidebands=sidebands
    ).ratio
