"""Indicators of shafts, gears and planet carriers, each on the signal for which it was defined.

Sources, named below by author: Stewart (1977), "Some useful data analysis techniques for gearbox diagnostics",
Southampton MHM/R/10/77. Zakrajsek, Townsend & Decker (1993), "An analysis of gear fault detection methods as applied to
pitting fatigue failure data", NASA TM-105950. Martin (1989), "Statistical moment analysis as a means of surface damage
detection", 7th IMAC, 1016-1021. Lebold et al. (2000), "Review of vibration analysis methods for gearbox diagnostics and
prognostics", MFPG 54, 623-634. Večeř, Kreidl & Šmíd (2005), "Condition indicators for gearbox condition monitoring
systems", Acta Polytechnica 45(6).

The examples use the signals defined in the docstring of `signals.indicators`.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from signals._validation import Array, checked, whole
from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import DifferenceSignal, MeshBand, RegularSignal, ResidualSignal
from signals.indicators.statistics import VarianceHistory, expect, normalized_moment, teager_energy


@checked
def shaft_order(average: SynchronousAverage, *, order: int) -> float:
    """Return the peak amplitude of one order of the shaft, in the unit of the record.

    Parameters
    ----------
    average : SynchronousAverage
        Average of that shaft.
    order : int
        1 for unbalance or bow; 2 for misalignment, ovality or a coupling; 3 for a three-jaw coupling or misalignment.

    Raises
    ------
    ValueError
        An order above the passband of the average.

    Examples
    --------
    >>> from signals.indicators import shaft_order
    >>> round(shaft_order(average_of(3 * np.cos(angle) + np.cos(2 * angle)), order=1), 6)
    3.0
    """
    expect(average, SynchronousAverage, indicator=f"SO{order}")
    return line_amplitude(average, order)


@checked
def so1(average: SynchronousAverage) -> float:
    """Return the peak amplitude at order 1 of a shaft's average, in the unit of the record (Večeř et al. 2005).

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.

    Examples
    --------
    >>> from signals.indicators import so1
    >>> round(so1(average_of(2 * np.cos(angle))), 6)
    2.0
    """
    return shaft_order(average, order=1)


@checked
def so2(average: SynchronousAverage) -> float:
    """Return the peak amplitude at order 2 of a shaft's average, in the unit of the record (Večeř et al. 2005).

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.

    Examples
    --------
    >>> from signals.indicators import so2
    >>> round(so2(average_of(2 * np.cos(2 * angle))), 6)
    2.0
    """
    return shaft_order(average, order=2)


@checked
def so3(average: SynchronousAverage) -> float:
    """Return the peak amplitude at order 3 of a shaft's average, in the unit of the record (Večeř et al. 2005).

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.

    Examples
    --------
    >>> from signals.indicators import so3
    >>> round(so3(average_of(2 * np.cos(3 * angle))), 6)
    2.0
    """
    return shaft_order(average, order=3)


def line_amplitude(average: SynchronousAverage, order: int) -> float:
    """Return the peak amplitude of a whole order of an average, or refuse an order above its passband."""
    whole(order, name="order", least=1)
    last = int(min(average.passband_orders, (average.samples_per_rev - 1) // 2))
    if order > last:
        raise ValueError(
            f"order {order} lies above {last}, the highest that this average of {average.samples_per_rev} samples "
            "per revolution resolves; take more samples per revolution."
        )
    return float(abs(average.complex_amplitude[order]))


@checked
def fm0(average: SynchronousAverage, *, teeth: int, harmonics: int) -> float:
    """Return the ratio of the peak-to-peak value of the average to the sum of its mesh harmonics (Stewart; Zakrajsek).

    Major mesh faults increase it: a broken tooth raises the peaks, heavy wear reduces the mesh harmonics.

    Parameters
    ----------
    average : SynchronousAverage
        Average of the shaft of the gear.
    teeth : int
        Number of teeth of the gear.
    harmonics : int
        Number of mesh harmonics in the sum.

    Raises
    ------
    ValueError
        Harmonics that are zero, or above the passband of the average.

    Examples
    --------
    >>> from signals.indicators import fm0
    >>> round(fm0(average_of(3 * np.cos(20 * angle)), teeth=20, harmonics=1), 6)
    2.0
    """
    expect(average, SynchronousAverage, indicator="FM0")
    mesh = whole(teeth, name="teeth", least=2)
    count = whole(harmonics, name="harmonics", least=1)
    total = sum(line_amplitude(average, mesh * harmonic) for harmonic in range(1, count + 1))
    if total == 0:
        raise ValueError(f"FM0: the average has none of the {count} harmonics of teeth={mesh}; check the number.")
    return float(np.ptp(average.values)) / total


@checked
def fm4(difference: DifferenceSignal) -> float:
    """Return the kurtosis of the difference signal (Stewart; Zakrajsek): 3 for noise, more if one tooth stands out.

    Its standard deviation for n independent Gaussian samples is sqrt(24 / n). It falls again as the damage spreads.

    Parameters
    ----------
    difference : DifferenceSignal
        The average without mesh harmonics, their first sidebands and shaft orders.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    A sine between mesh harmonics, far below the 3 of noise:

    >>> from signals.indicators import fm4
    >>> round(fm4(difference), 6)
    1.5
    """
    return _moment(difference, order=4, name="FM4")


@checked
def m6a(difference: DifferenceSignal) -> float:
    """Return the sixth moment of the difference signal over its variance cubed (Martin): 15 for noise.

    Parameters
    ----------
    difference : DifferenceSignal
        The average without mesh harmonics, their first sidebands and shaft orders.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    A sine between mesh harmonics, far below the 15 of noise:

    >>> from signals.indicators import m6a
    >>> round(m6a(difference), 6)
    2.5
    """
    return _moment(difference, order=6, name="M6A")


@checked
def m8a(difference: DifferenceSignal) -> float:
    """Return the eighth moment of the difference signal over its variance to the fourth (Martin): 105 for noise.

    Parameters
    ----------
    difference : DifferenceSignal
        The average without mesh harmonics, their first sidebands and shaft orders.

    Raises
    ------
    ValueError
        A constant signal.

    Examples
    --------
    A sine between mesh harmonics, far below the 105 of noise:

    >>> from signals.indicators import m8a
    >>> round(m8a(difference), 6)
    4.375
    """
    return _moment(difference, order=8, name="M8A")


@checked
def na4(residual: ResidualSignal, *, history: VarianceHistory) -> float:
    """Return the fourth moment of the residual signal over the squared mean variance of its history (Zakrajsek).

    It rises with damage and, unlike FM4, continues to rise as the damage spreads. If all records have the same variance
    it is the kurtosis. With a frozen history it is NA4* (Decker, Handschuh & Zakrajsek 1994, NASA TM-106553).

    Parameters
    ----------
    residual : ResidualSignal
        The average without mesh harmonics and shaft orders.
    history : VarianceHistory
        History of this and the previous records: ``history = history.update(residual)`` first.

    Raises
    ------
    ValueError
        A history without a record, of another kind of signal, or of constant signals only.

    Examples
    --------
    >>> from signals.indicators import VarianceHistory, na4
    >>> round(na4(residual, history=VarianceHistory().update(residual)), 6)  # the kurtosis of a sine
    1.5
    """
    expect(residual, ResidualSignal, indicator="NA4")
    return over_history(residual.values, history, residual, name="NA4")


@checked
def energy_ratio(difference: DifferenceSignal, regular: RegularSignal) -> float:
    """Return the RMS of the difference signal over that of the regular signal (Swansson 1980; Lebold).

    Heavy, uniform wear increases it: energy moves from the mesh harmonics to the rest of the spectrum.

    Parameters
    ----------
    difference : DifferenceSignal
        The average without mesh harmonics, their first sidebands and shaft orders.
    regular : RegularSignal
        The average less `difference`: mesh harmonics, their sidebands and shaft orders.

    Raises
    ------
    ValueError
        Signals of different averages, or a constant regular signal.

    Examples
    --------
    >>> from signals.indicators import energy_ratio
    >>> round(energy_ratio(difference, regular_signal(average, left=difference)), 6)
    0.1
    """
    expect(difference, DifferenceSignal, indicator="the energy ratio")
    expect(regular, RegularSignal, indicator="the energy ratio")
    if difference.samples_per_rev != regular.samples_per_rev:
        raise ValueError(
            f"the energy ratio: {difference.samples_per_rev} samples per revolution in the difference signal and "
            f"{regular.samples_per_rev} in the regular one; derive both from the same average."
        )
    below = float(np.std(regular.values))
    if below == 0:
        raise ValueError("the energy ratio: the regular signal is zero; check the teeth and shaft orders.")
    return float(np.std(difference.values)) / below


@checked
def energy_operator(residual: ResidualSignal) -> float:
    """Return the kurtosis of the Teager energy of the residual signal (Ma 1995, MFPG 49; Lebold).

    The Teager energy increases with amplitude and frequency, so that a short impact of high frequency stands out.

    Parameters
    ----------
    residual : ResidualSignal
        The average without mesh harmonics and shaft orders.

    Raises
    ------
    ValueError
        A residual of zeros, or constant Teager energy.

    Examples
    --------
    The Teager energy of two tones is a constant plus a sine at the beat frequency, with kurtosis 1.5:

    >>> from signals.indicators import energy_operator
    >>> two_tones = average_of(np.cos(7 * angle) + np.cos(9 * angle))
    >>> residual = residual_signal(two_tones, teeth=20, harmonics=1, shaft_orders=[1, 2])
    >>> round(energy_operator(residual), 2)
    1.5
    """
    expect(residual, ResidualSignal, indicator="the energy operator")
    largest = float(np.max(np.abs(residual.values)))
    if largest == 0:
        raise ValueError("the energy operator of a residual of zeros is not defined; check the sensor.")
    return normalized_moment(teager_energy(residual.values / largest), order=4, name="the energy operator")


@checked
def sideband_index(average: SynchronousAverage, *, teeth: int) -> float:
    """Return the mean amplitude of the first sidebands of the mesh, in the unit of the record (Večeř).

    Eccentricity, a bent shaft or one damaged tooth modulates the mesh once per revolution.

    Parameters
    ----------
    average : SynchronousAverage
        Average of the shaft of the gear.
    teeth : int
        Number of teeth of the gear.

    Raises
    ------
    ValueError
        Sidebands above the passband of the average.

    Examples
    --------
    >>> from signals.indicators import sideband_index
    >>> round(sideband_index(modulated, teeth=20), 6)  # each sideband has half of the modulation
    0.1
    """
    expect(average, SynchronousAverage, indicator="the sideband index")
    return _first_sidebands(average, teeth) / 2


@checked
def sideband_level_factor(average: SynchronousAverage, *, teeth: int) -> float:
    """Return the sum of the first sideband amplitudes over the standard deviation of the average (Lebold; Večeř).

    Misalignment, a bent shaft or a single damaged tooth increases it.

    Parameters
    ----------
    average : SynchronousAverage
        Average of the shaft of the gear.
    teeth : int
        Number of teeth of the gear.

    Raises
    ------
    ValueError
        A constant average, or sidebands above its passband.

    Examples
    --------
    >>> from signals.indicators import sideband_level_factor
    >>> round(sideband_level_factor(modulated, teeth=20), 4)  # 0.2 / sqrt(0.51)
    0.2801
    """
    expect(average, SynchronousAverage, indicator="the sideband level factor")
    level = float(np.std(average.values))
    if level == 0:
        raise ValueError("the sideband level factor of a constant average is not defined; check the sensor.")
    return _first_sidebands(average, teeth) / level


def over_history(values: Array, history: VarianceHistory, signal: ResidualSignal | MeshBand, *, name: str) -> float:
    """Return the fourth central moment of `values` over the squared mean variance of `history`."""
    if not isinstance(history, VarianceHistory):
        raise TypeError(f"{name} takes history=VarianceHistory(...), not a {type(history).__name__}.")
    if not history.records:
        raise ValueError(f"{name}: the history holds no record yet; update it with this one first.")
    history.variance_of(signal)  # refuses one of another kind
    if history.mean_variance == 0:
        raise ValueError(f"{name}: the history holds only constant signals; check the sensor.")
    return float(np.mean(((values - values.mean()) / np.sqrt(history.mean_variance)) ** 4))


def _moment(difference: DifferenceSignal, *, order: int, name: str) -> float:
    """Return a normalised moment of the difference signal, or refuse another signal."""
    expect(difference, DifferenceSignal, indicator=name)
    return normalized_moment(difference.values, order=order, name=name)


def _first_sidebands(average: SynchronousAverage, teeth: int) -> float:
    """Return the sum of the amplitudes at one order below and above the mesh order."""
    mesh = whole(teeth, name="teeth", least=2)
    return line_amplitude(average, mesh - 1) + line_amplitude(average, mesh + 1)


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
    Orders 37 to 43 about the mesh order of a ring of 40 teeth; three planets add up at multiples of 3:

    >>> from signals.indicators import carrier_sidebands
    >>> average = average_of(np.cos(39 * angle) + 0.5 * np.cos(40 * angle))
    >>> lines = carrier_sidebands(average, ring_teeth=40, planets=3, harmonic=1, sidebands=3)
    >>> lines.amplitude.round(6).tolist(), lines.orders[lines.expected].tolist()
    ([0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0], [39, 42])
    """

    orders: NDArray[np.int64] = field(metadata={"dims": ("line",), "units": "order of the carrier"})
    amplitude: Array = field(metadata={"dims": ("line",), "units": "as the record, peak"})
    planets: int

    @property
    def expected(self) -> NDArray[np.bool_]:
        """(line,) array, true at multiples of the number of planets, where the contributions of the planets add up."""
        return np.asarray(self.orders % self.planets == 0)

    @property
    def ratio(self) -> float:
        """Ratio of the RMS amplitude where equal planets cancel to that where they add up."""
        expected = float(np.sqrt(np.mean(self.amplitude[self.expected] ** 2)))
        other = float(np.sqrt(np.mean(self.amplitude[~self.expected] ** 2)))
        return other / expected if expected > 0 else np.inf


@checked
def carrier_sidebands(
    average: SynchronousAverage, *, ring_teeth: int, planets: int, harmonic: int, sidebands: int
) -> CarrierSidebands:
    """Return the sidebands of a ring mesh, where equal, evenly spaced planets either add up or cancel.

    Such planets pass a sensor on the ring with phases that cancel at every order that is not a multiple of their number
    (McFadden & Smith 1985, Proc. Instn Mech. Engrs C 199, 65-70). A crack in the carrier or one damaged planet makes
    them unequal, and the ratio rises (Keller & Grabill 2003, "Vibration monitoring of UH-60A main transmission
    planetary carrier fault", AHS Forum 59). With unevenly spaced planets it is high in a healthy gearbox as well.

    Parameters
    ----------
    average : SynchronousAverage
        Average over revolutions of the carrier.
    ring_teeth : int
        Number of teeth of the fixed ring, which is its mesh order.
    planets : int
        Number of planets.
    harmonic : int
        Index of the mesh harmonic, 1 for the fundamental.
    sidebands : int
        Number of orders on either side, at least the number of planets.

    Returns
    -------
    CarrierSidebands

    Raises
    ------
    ValueError
        Orders below 1 or above the passband of the average.

    Examples
    --------
    Three planets on a ring of 40 teeth give lines at orders 39 and 42 about the mesh order 40:

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
        raise ValueError(f"sidebands={side} about order {centre} extend below order 1; use fewer.")
    orders = np.arange(centre - side, centre + side + 1)
    amplitude = np.array([line_amplitude(average, int(order)) for order in orders])
    return CarrierSidebands(orders=orders, amplitude=amplitude, planets=count)


@checked
def carrier_sideband_ratio(
    average: SynchronousAverage, *, ring_teeth: int, planets: int, harmonic: int, sidebands: int
) -> float:
    """Return the ratio of the RMS of the sidebands that equal planets cancel to that of the others.

    It is `CarrierSidebands.ratio`.

    Parameters
    ----------
    average, ring_teeth, planets, harmonic, sidebands
        As in `carrier_sidebands`.

    Raises
    ------
    ValueError
        As `carrier_sidebands`.

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
