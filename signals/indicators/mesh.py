"""Indicators of a mesh harmonic with its sidebands: amplitude and phase modulation over the revolution.

McFadden (1986), "Detecting fatigue cracks in gears by amplitude and phase demodulation of the meshing vibration",
J. Vib. Acoust. 108(2), 165-170: the mesh lags and weakens while a cracked tooth is in contact. Bechhoefer & Kingsley
(2009), "A review of time synchronous average algorithms", Annual Conference of the PHM Society.

Signals that are constant or zero raise ValueError. The examples use the signals defined in the docstring of
`signals.indicators`.
"""

import numpy as np
from scipy import fft

from signals._validation import Array, checked
from signals.angle.residual import MeshBand
from signals.indicators.gear import over_history
from signals.indicators.statistics import VarianceHistory, expect, normalized_moment


@checked
def narrowband_kurtosis(band: MeshBand) -> float:
    """Return the kurtosis of the band as a real signal: 1.5 for an unmodulated mesh (Bechhoefer & Kingsley 2009).

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.

    Examples
    --------
    >>> from signals.indicators import narrowband_kurtosis
    >>> mesh = mesh_band(average_of(np.cos(20 * angle)), mesh_order=20, sidebands=8)
    >>> round(narrowband_kurtosis(mesh), 6)
    1.5
    """
    expect(band, MeshBand, indicator="the narrowband kurtosis")
    return normalized_moment(band.values, order=4, name="the narrowband kurtosis")


@checked
def nb4(band: MeshBand, *, history: VarianceHistory) -> float:
    """Return the fourth moment of the envelope of the band over the squared mean variance of its history.

    Zakrajsek, Handschuh & Decker (1994), "Application of fault detection techniques to spiral bevel gear fatigue data",
    NASA TM-106467. At a few damaged teeth the load drops, and with it the envelope.

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.
    history : VarianceHistory
        History of this and the previous records: ``history = history.update(band)`` first. If frozen, this is NB4*.

    Raises
    ------
    ValueError
        A history without a record, of another kind of signal, or of constant envelopes only.

    Examples
    --------
    >>> from signals.indicators import VarianceHistory, nb4
    >>> round(nb4(band, history=VarianceHistory().update(band)), 6)  # the kurtosis of a sine
    1.5
    """
    expect(band, MeshBand, indicator="NB4")
    return over_history(band.amplitude, history, band, name="NB4")


@checked
def amplitude_modulation(band: MeshBand) -> float:
    """Return the depth of the amplitude modulation, m for a mesh of ``1 + m cos`` (McFadden 1986).

    It is sqrt(2) times the RMS of the envelope about its mean, over that mean, and so defined for any modulation.

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.

    Raises
    ------
    ValueError
        A band of zeros.

    Examples
    --------
    >>> from signals.indicators import amplitude_modulation
    >>> round(amplitude_modulation(band), 6)
    0.2
    """
    expect(band, MeshBand, indicator="the amplitude modulation")
    mean = float(band.amplitude.mean())
    if mean == 0:
        raise ValueError("the amplitude modulation of a band of zeros is not defined; check the teeth and the sensor.")
    return float(np.sqrt(2) * np.std(band.amplitude) / mean)


@checked
def amplitude_modulation_kurtosis(band: MeshBand) -> float:
    """Return the kurtosis of the envelope: 1.5 for a sine, high for a single tooth (Bechhoefer & Kingsley 2009).

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.

    Examples
    --------
    >>> from signals.indicators import amplitude_modulation_kurtosis
    >>> round(amplitude_modulation_kurtosis(band), 6)
    1.5
    """
    expect(band, MeshBand, indicator="the kurtosis of the amplitude modulation")
    return normalized_moment(band.amplitude, order=4, name="the kurtosis of the amplitude modulation")


@checked
def phase_modulation(band: MeshBand) -> float:
    """Return the index of the phase modulation in rad, b for a mesh of phase ``b sin`` (McFadden 1986).

    It is sqrt(2) times the RMS of the phase; divided by the order of the harmonic it is an angle of the shaft.

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.

    Raises
    ------
    ValueError
        A band whose phase slips, because a sideband exceeds the mesh harmonic.

    Examples
    --------
    >>> from signals.indicators import phase_modulation
    >>> round(phase_modulation(phase_modulated_band), 6)
    0.1
    """
    expect(band, MeshBand, indicator="the phase modulation")
    return float(np.sqrt(2) * np.std(_phase(band)))


@checked
def frequency_modulation(band: MeshBand) -> float:
    """Return the relative frequency deviation of the mesh, ``b k / order`` for a phase ``b sin(k angle)``.

    It is sqrt(2) times the RMS of the derivative of the phase with respect to the shaft angle, over the mesh order.

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.

    Raises
    ------
    ValueError
        A band whose phase slips, or whose amplitude passes through zero.

    Examples
    --------
    >>> from signals.indicators import frequency_modulation
    >>> round(frequency_modulation(phase_modulated_band), 6)  # 0.1 / 20
    0.005
    """
    expect(band, MeshBand, indicator="the frequency modulation")
    return float(np.sqrt(2) * np.std(_rate(band)) / band.mesh_order)


@checked
def frequency_modulation_kurtosis(band: MeshBand) -> float:
    """Return the kurtosis of the derivative of the phase: 1.5 for a sine (Bechhoefer & Kingsley 2009).

    Parameters
    ----------
    band : MeshBand
        A mesh harmonic with its sidebands.

    Raises
    ------
    ValueError
        As `frequency_modulation`, or a constant derivative.

    Examples
    --------
    >>> from signals.indicators import frequency_modulation_kurtosis
    >>> round(frequency_modulation_kurtosis(phase_modulated_band), 6)
    1.5
    """
    expect(band, MeshBand, indicator="the kurtosis of the frequency modulation")
    return normalized_moment(_rate(band), order=4, name="the kurtosis of the frequency modulation")


def _phase(band: MeshBand) -> Array:
    """Return the phase in rad, or raise ValueError if it does not return to its start after one revolution."""
    phase = band.phase_rad
    turns = round((phase[-1] - phase[0]) / (2 * np.pi))
    if turns:
        raise ValueError(
            f"the phase of mesh order {band.mesh_order} slips by {turns} cycles per revolution: a sideband is stronger "
            "than the mesh, so there is no carrier to demodulate. Use another harmonic."
        )
    return phase


def _rate(band: MeshBand) -> Array:
    """Return the derivative of the phase with respect to the shaft angle, less the mesh order."""
    _phase(band)
    weight = band.amplitude**2
    if np.min(weight) <= np.finfo(np.float64).tiny:
        raise ValueError(
            f"the amplitude of mesh order {band.mesh_order} passes through zero, where it has no phase; use another "
            "harmonic."
        )
    orders = fft.fftfreq(band.analytic.size, 1 / band.analytic.size)
    slope = fft.ifft(1j * orders * fft.fft(band.analytic))
    return np.asarray((np.conj(band.analytic) * slope).imag / weight - band.mesh_order)
