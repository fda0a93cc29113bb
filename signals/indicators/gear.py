"""Indicators of a gear, each on the one signal it was defined on.

Sources, named below by author: Stewart (1977), "Some useful data analysis techniques for gearbox diagnostics",
Southampton MHM/R/10/77. Zakrajsek, Townsend & Decker (1993), "An analysis of gear fault detection methods as applied to
pitting fatigue failure data", NASA TM-105950. Martin (1989), "Statistical moment analysis as a means of surface damage
detection", 7th IMAC, 1016-1021. Lebold et al. (2000), "Review of vibration analysis methods for gearbox diagnostics and
prognostics", MFPG 54, 623-634. Večeř, Kreidl & Šmíd (2005), "Condition indicators for gearbox condition monitoring
systems", Acta Polytechnica 45(6).
"""

import numpy as np

from signals._checks import Array, whole
from signals.averaging import SynchronousAverage
from signals.indicators._kinds import expect
from signals.indicators.history import VarianceHistory
from signals.indicators.shaft import line_amplitude
from signals.indicators.statistics import normalized_moment, teager_energy
from signals.residues import DifferenceSignal, MeshBand, RegularSignal, ResidualSignal


def fm0(average: SynchronousAverage, *, teeth: int, harmonics: int) -> float:
    """Return peak to peak of the average over the sum of its mesh harmonics' amplitudes (Stewart; Zakrajsek).

    Major faults of the mesh raise it: a broken tooth raises the peaks, heavy wear lowers the mesh harmonics.

    Parameters
    ----------
    average : SynchronousAverage
    teeth : int
        Of the gear.
    harmonics : int
        Mesh harmonics in the sum.
    """
    expect(average, SynchronousAverage, indicator="FM0")
    mesh = whole(teeth, name="teeth", least=2)
    count = whole(harmonics, name="harmonics", least=1)
    total = sum(line_amplitude(average, mesh * harmonic) for harmonic in range(1, count + 1))
    if total == 0:
        raise ValueError(f"FM0: the average holds none of the {count} harmonics of {mesh} teeth; check the teeth.")
    return float(np.ptp(average.values)) / total


def fm4(difference: DifferenceSignal) -> float:
    """Return the kurtosis of the difference signal (Stewart; Zakrajsek): 3 for noise, more where one tooth stands out.

    Of n independent Gaussian samples it scatters by sqrt(24 / n). It falls back when the damage spreads.
    """
    return _moment(difference, order=4, name="FM4")


def m6a(difference: DifferenceSignal) -> float:
    """Return the sixth moment of the difference signal over its variance cubed (Martin): 15 for noise."""
    return _moment(difference, order=6, name="M6A")


def m8a(difference: DifferenceSignal) -> float:
    """Return the eighth moment of the difference signal over its variance to the fourth (Martin): 105 for noise."""
    return _moment(difference, order=8, name="M8A")


def na4(residual: ResidualSignal, *, history: VarianceHistory) -> float:
    """Return the fourth moment of the residual signal over the squared mean variance of its history (Zakrajsek).

    It rises with damage and goes on rising as the damage spreads, which FM4 does not. Where all records have one
    variance it is the kurtosis. A frozen history makes it NA4* (Decker, Handschuh & Zakrajsek 1994, NASA TM-106553).

    Parameters
    ----------
    residual : ResidualSignal
    history : VarianceHistory
        With this record in it, as it was defined: ``history = history.update(residual)`` first.
    """
    expect(residual, ResidualSignal, indicator="NA4")
    return over_history(residual.values, history, residual, name="NA4")


def energy_ratio(difference: DifferenceSignal, regular: RegularSignal) -> float:
    """Return RMS of the difference signal over that of the regular signal (Swansson 1980; Lebold).

    Heavy, even wear raises it: energy goes from the mesh to everything else.

    Parameters
    ----------
    difference : DifferenceSignal
    regular : RegularSignal
        What was taken out of the average to leave `difference`.
    """
    expect(difference, DifferenceSignal, indicator="the energy ratio")
    expect(regular, RegularSignal, indicator="the energy ratio")
    if difference.samples_per_rev != regular.samples_per_rev:
        raise ValueError(
            f"the energy ratio: {difference.samples_per_rev} samples a revolution in the difference signal and "
            f"{regular.samples_per_rev} in the regular one; both come from one average."
        )
    below = float(np.std(regular.values))
    if below == 0:
        raise ValueError("the energy ratio: the regular signal is nothing; check the teeth and shaft orders.")
    return float(np.std(difference.values)) / below


def energy_operator(residual: ResidualSignal) -> float:
    """Return the kurtosis of the residual's Teager energy round the revolution (Ma 1995, MFPG 49; Lebold).

    The operator weighs amplitude and frequency at once, so a short impact of high frequency stands out.
    """
    expect(residual, ResidualSignal, indicator="the energy operator")
    largest = float(np.max(np.abs(residual.values)))
    if largest == 0:
        raise ValueError("the energy operator of a residual that is nothing is not defined.")
    return normalized_moment(teager_energy(residual.values / largest), order=4, name="the energy operator")


def sideband_index(average: SynchronousAverage, *, teeth: int) -> float:
    """Return the mean amplitude of the first sidebands of the mesh, in the unit of the record (Večeř).

    Eccentricity, a bent shaft or one bad tooth modulate the mesh once a revolution.

    Parameters
    ----------
    average : SynchronousAverage
    teeth : int
        Of the gear on the averaged shaft.
    """
    expect(average, SynchronousAverage, indicator="the sideband index")
    return _first_sidebands(average, teeth) / 2


def sideband_level_factor(average: SynchronousAverage, *, teeth: int) -> float:
    """Return the sum of the first sidebands' amplitudes over the standard deviation of the average (Lebold; Večeř).

    Misalignment, a bent shaft or a single bad tooth raise it. Parameters as in `sideband_index`.
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
    expect(difference, DifferenceSignal, indicator=name)
    return normalized_moment(difference.values, order=order, name=name)


def _first_sidebands(average: SynchronousAverage, teeth: int) -> float:
    mesh = whole(teeth, name="teeth", least=2)
    return line_amplitude(average, mesh - 1) + line_amplitude(average, mesh + 1)
