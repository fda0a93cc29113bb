"""Indicators of a planet carrier: which sidebands of the ring's mesh there are, and which there should not be."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array, whole
from signals.averaging import SynchronousAverage
from signals.indicators._kinds import expect
from signals.indicators.shaft import line_amplitude


@dataclass(frozen=True, kw_only=True)
class CarrierSidebands:
    """Lines about one harmonic of the ring's mesh, in the average over the carrier."""

    orders: NDArray[np.int64] = field(metadata={"dims": ("line",), "units": "order of the carrier"})
    amplitude: Array = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    planets: int

    @property
    def expected(self) -> NDArray[np.bool_]:
        """Where the order is a multiple of the planets, so that all of them add up, (line,)."""
        return np.asarray(self.orders % self.planets == 0)

    @property
    def ratio(self) -> float:
        """RMS of the lines where equal planets cancel over that of the lines where they add up."""
        expected = float(np.sqrt(np.mean(self.amplitude[self.expected] ** 2)))
        other = float(np.sqrt(np.mean(self.amplitude[~self.expected] ** 2)))
        return other / expected if expected > 0 else np.inf


def carrier_sidebands(
    average: SynchronousAverage, *, ring_teeth: int, planets: int, harmonic: int, sidebands: int
) -> CarrierSidebands:
    """Return the sidebands of a ring mesh, split by whether equal, evenly spaced planets leave them.

    Such planets pass a sensor on the ring with phases that cancel at every order which is no multiple of their number
    (McFadden & Smith 1985, Proc. Instn Mech. Engrs C 199, 65-70). A crack in the carrier or one bad planet makes them
    unequal, and the ratio rises (Keller & Grabill 2003, "Vibration monitoring of UH-60A main transmission planetary
    carrier fault", AHS Forum 59). Planets that are not evenly spaced make it high in a sound gearbox too.

    Parameters
    ----------
    average : SynchronousAverage
        Over revolutions of the carrier.
    ring_teeth : int
        Of the fixed ring: the order of its mesh.
    planets : int
    harmonic : int
        Of the mesh.
    sidebands : int
        How many orders on either side; at least the number of planets.
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


def carrier_sideband_ratio(
    average: SynchronousAverage, *, ring_teeth: int, planets: int, harmonic: int, sidebands: int
) -> float:
    """Return `CarrierSidebands.ratio`; parameters as in `carrier_sidebands`."""
    return carrier_sidebands(
        average, ring_teeth=ring_teeth, planets=planets, harmonic=harmonic, sidebands=sidebands
    ).ratio
