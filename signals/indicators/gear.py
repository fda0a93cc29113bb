"""Indicators of a gear, each on the one signal it was defined on.

Sources, named below by author: Stewart (1977), "Some useful data analysis techniques for gearbox diagnostics",
Southampton MHM/R/10/77. Zakrajsek, Townsend & Decker (1993), "An analysis of gear fault detection methods as applied to
pitting fatigue failure data", NASA TM-105950. Martin (1989), "Statistical moment analysis as a means of surface damage
detection", 7th IMAC, 1016-1021. Lebold et al. (2000), "Review of vibration analysis methods for gearbox diagnostics and
prognostics", MFPG 54, 623-634. Večeř, Kreidl & Šmíd (2005), "Condition indicators for gearbox condition monitoring
systems", Acta Polytechnica 45(6).

The examples start from what the docstring of `signals.indicators` defines.
"""

import numpy as np

from signals._validation import Array, checked, whole
from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import DifferenceSignal, MeshBand, RegularSignal, ResidualSignal
from signals.indicators._kinds import expect
from signals.indicators.shaft import line_amplitude
from signals.indicators.statistics import normalized_moment, teager_energy
from signals.indicators.variance_history import VarianceHistory


@checked
def fm0(average: SynchronousAverage, *, teeth: int, harmonics: int) -> float:
    """Return the peak-to-peak value of the average over the sum of its mesh harmonics (Stewart; Zakrajsek).

    Major faults of the mesh raise it: a broken tooth raises the peaks, heavy wear lowers the mesh harmonics.

    Parameters
    ----------
    average : SynchronousAverage
        Of the gear's shaft.
    teeth : int
        Teeth of the gear.
    harmonics : int
        Number of mesh harmonics in the sum.

    Raises
    ------
    ValueError
        An average without these harmonics.

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
        raise ValueError(f"FM0: the average holds none of the {count} harmonics of {mesh} teeth; check the teeth.")
    return float(np.ptp(average.values)) / total


@checked
def fm4(difference: DifferenceSignal) -> float:
    """Return the kurtosis of the difference signal (Stewart; Zakrajsek): 3 for noise, more where one tooth stands out.

    Its standard deviation for n independent Gaussian samples is sqrt(24 / n). It falls again when the damage spreads.

    Parameters
    ----------
    difference : DifferenceSignal
        The average without mesh harmonics, their first sidebands and shaft orders.

    Examples
    --------
    A sine that is no mesh harmonic, far below the 3 of noise:

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

    Examples
    --------
    A sine that is no mesh harmonic, far below the 15 of noise:

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

    Examples
    --------
    A sine that is no mesh harmonic, far below the 105 of noise:

    >>> from signals.indicators import m8a
    >>> round(m8a(difference), 6)
    4.375
    """
    return _moment(difference, order=8, name="M8A")


@checked
def na4(residual: ResidualSignal, *, history: VarianceHistory) -> float:
    """Return the fourth moment of the residual signal over the squared mean variance of its history (Zakrajsek).

    It rises with damage and goes on rising as the damage spreads, which FM4 does not. Where all records have one
    variance it is the kurtosis. A frozen history makes it NA4* (Decker, Handschuh & Zakrajsek 1994, NASA TM-106553).

    Parameters
    ----------
    residual : ResidualSignal
        The average without mesh harmonics and shaft orders.
    history : VarianceHistory
        Of this and the earlier records: ``history = history.update(residual)`` first.

    Raises
    ------
    ValueError
        A history without a record, of another kind of signal or of constant signals.

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

    Heavy, uniform wear raises it: energy moves from the mesh harmonics to the rest of the spectrum.

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
            f"{regular.samples_per_rev} in the regular one; both come from one average."
        )
    below = float(np.std(regular.values))
    if below == 0:
        raise ValueError("the energy ratio: the regular signal is zero; check the teeth and shaft orders.")
    return float(np.std(difference.values)) / below


@checked
def energy_operator(residual: ResidualSignal) -> float:
    """Return the kurtosis of the residual signal's Teager energy (Ma 1995, MFPG 49; Lebold).

    The Teager energy grows with amplitude and frequency, so a short impact of high frequency stands out.

    Parameters
    ----------
    residual : ResidualSignal
        The average without mesh harmonics and shaft orders.

    Raises
    ------
    ValueError
        A residual of zeros.

    Examples
    --------
    The Teager energy of two tones is a mean and a sine at their beat frequency, which has kurtosis 1.5:

    >>> from signals.indicators import energy_operator
    >>> two_tones = average_of(np.cos(7 * angle) + np.cos(9 * angle))
    >>> residual = residual_signal(two_tones, teeth=20, harmonics=1, shaft_orders=[1, 2])
    >>> round(energy_operator(residual), 2)
    1.5
    """
    expect(residual, ResidualSignal, indicator="the energy operator")
    largest = float(np.max(np.abs(residual.values)))
    if largest == 0:
        raise ValueError("the energy operator of a residual of zeros is not defined.")
    return normalized_moment(teager_energy(residual.values / largest), order=4, name="the energy operator")


@checked
def sideband_index(average: SynchronousAverage, *, teeth: int) -> float:
    """Return the mean amplitude of the first sidebands of the mesh, in the unit of the record (Večeř).

    Eccentricity, a bent shaft or one bad tooth modulate the mesh once a revolution.

    Parameters
    ----------
    average : SynchronousAverage
        Of the gear's shaft.
    teeth : int
        Teeth of the gear.

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
    """Return the sum of the first sidebands' amplitudes over the standard deviation of the average (Lebold; Večeř).

    Misalignment, a bent shaft or a single bad tooth raise it.

    Parameters
    ----------
    average : SynchronousAverage
        Of the gear's shaft.
    teeth : int
        Teeth of the gear.

    Raises
    ------
    ValueError
        A constant average.

    Examples
    --------
    >>> from signals.indicators import sideband_level_factor
    >>> round(sideband_level_factor(modulated, teeth=20), 4)  # 0.2 / sqrt(0.51)
    0.2801
    """
    expect(average, SynchronousAverage, indicator="the sideband level factor")
    level = float(np.std(average.values))
    if level == 0:
        raise ValueError("the sideband level factor of an average that is constant is not defined; check the sensor.")
    return _first_sidebands(average, teeth) / level


def over_history(values: Array, history: VarianceHistory, signal: ResidualSignal | MeshBand, *, name: str) -> float:
    """Return the fourth central moment of `values` over the squared mean variance of `history`."""
    if not isinstance(history, VarianceHistory):
        raise TypeError(f"{name} takes history=VarianceHistory(...), not a {type(history).__name__}.")
    if not history.records:
        raise ValueError(f"{name}: the history holds no record yet; update it with this one first.")
    history.variance_of(signal)  # refuses one of another kind
    if history.mean_variance == 0:
        raise ValueError(f"{name}: the history holds nothing but constant signals; check the sensor.")
    return float(np.mean(((values - values.mean()) / np.sqrt(history.mean_variance)) ** 4))


def _moment(difference: DifferenceSignal, *, order: int, name: str) -> float:
    """Return a normalised moment of the difference signal, or refuse another signal."""
    expect(difference, DifferenceSignal, indicator=name)
    return normalized_moment(difference.values, order=order, name=name)


def _first_sidebands(average: SynchronousAverage, teeth: int) -> float:
    """Return the sum of the amplitudes at one order below and above the mesh order."""
    mesh = whole(teeth, name="teeth", least=2)
    return line_amplitude(average, mesh - 1) + line_amplitude(average, mesh + 1)
