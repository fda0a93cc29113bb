"""Bearing indicator: energy at the harmonics of a defect frequency in an envelope spectrum."""

from dataclasses import dataclass, field

import numpy as np

from signals._validation import Array, checked, positive, whole
from signals.indicators.statistics import expect
from signals.spectra.spectra import AmplitudeSpectrum


@dataclass(frozen=True, kw_only=True)
class DefectEnergy:
    """Energy at the harmonics of a defect frequency and of their background, from `defect_energy`.

    Attributes
    ----------
    orders : (harmonic,) array
        Positions of the harmonics found, in the unit of the axis of the spectrum.
    amplitude : (harmonic,) array
        Their peak amplitudes, in the unit of the spectrum.
    background : float
        Energy of as many lines with the median background amplitude of each harmonic.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.indicators import defect_energy
    >>> envelope = 1 + 0.3 * np.cos(2 * np.pi * 3.6 * np.arange(3600) / 360)  # a line at the order 3.6
    >>> spectrum = amplitude_spectrum(envelope, rate=360)
    >>> found = defect_energy(spectrum, order=3.6, harmonics=1, tolerance=0.02, background_width=2)
    >>> found.orders.round(3).tolist(), found.amplitude.round(3).tolist()
    ([3.6], [0.3])
    """

    orders: Array = field(metadata={"dims": ("harmonic",), "units": "as the axis"})
    amplitude: Array = field(metadata={"dims": ("harmonic",), "units": "as the spectrum, peak"})
    background: float

    @property
    def energy(self) -> float:
        """Sum of half the squared peak amplitudes, in the squared unit of the spectrum."""
        return float(np.sum(self.amplitude**2) / 2)

    @property
    def ratio(self) -> float:
        """Ratio of the energy to that of the background; well above 1 even in noise, since each line is a maximum."""
        return self.energy / self.background if self.background > 0 else np.inf


@checked
def defect_energy(
    spectrum: AmplitudeSpectrum, *, order: float, harmonics: int, tolerance: float, background_width: float
) -> DefectEnergy:
    """Return the energy at the harmonics of a defect frequency in an envelope spectrum.

    Based on McFadden & Smith (1984), "Model for the vibration produced by a single point defect in a rolling element
    bearing", J. Sound Vib. 96(1), 69-82; for the squared envelope on Randall & Antoni (2011), "Rolling element bearing
    diagnostics - a tutorial", Mech. Syst. Signal Process. 25(2), 485-520.

    Parameters
    ----------
    spectrum : AmplitudeSpectrum
        Spectrum of an envelope or squared envelope, from `envelope_order_spectrum` or `envelope_spectrum`.
    order : float
        Defect order or frequency, in the unit of the axis: BPFO, BPFI, twice BSF, or FTF.
    harmonics : int
        Number of harmonics, including the fundamental.
    tolerance : float
        Largest relative deviation from `order`, typically 0.01 to 0.02, since rolling elements slip.
    background_width : float
        Width of the background on either side of a line, in the unit of the axis.

    Returns
    -------
    DefectEnergy

    Raises
    ------
    ValueError
        Harmonics beyond the end of the spectrum, or fewer than eight points of background.

    Examples
    --------
    A line of amplitude 0.3 at the defect order 3.6 has the energy 0.3^2 / 2 = 0.045:

    >>> import numpy as np
    >>> from signals import amplitude_spectrum
    >>> from signals.indicators import defect_energy
    >>> angle = np.arange(3600) / 360  # ten revolutions
    >>> envelope = 1 + 0.3 * np.cos(2 * np.pi * 3.6 * angle)
    >>> spectrum = amplitude_spectrum(envelope, rate=360)
    >>> round(defect_energy(spectrum, order=3.6, harmonics=1, tolerance=0.02, background_width=2).energy, 4)
    0.045
    """
    expect(spectrum, AmplitudeSpectrum, indicator="the defect energy")
    first = positive(order, name="order")
    count = whole(harmonics, name="harmonics", least=1)
    slack = positive(tolerance, name="tolerance")
    reach = positive(background_width, name="background_width")
    last = count * first * (1 + slack)
    if last > spectrum.axis[-1]:
        raise ValueError(
            f"harmonic {count} of {first:g} extends to {last:g}, beyond the end of the spectrum at "
            f"{spectrum.axis[-1]:g}; use fewer harmonics."
        )
    found = [
        _line(spectrum, k * first, max(k * first * slack, spectrum.bin_width / 2), reach) for k in range(1, count + 1)
    ]
    orders, amplitude, level = (np.array(column) for column in zip(*found, strict=True))
    return DefectEnergy(orders=orders, amplitude=amplitude, background=float(np.sum(level**2) / 2))


def _line(spectrum: AmplitudeSpectrum, centre: float, half: float, reach: float) -> tuple[float, float, float]:
    """Return position and amplitude of the largest point of a band, and the median amplitude of its background."""
    begin, end = np.searchsorted(spectrum.axis, [centre - reach - half, centre + reach + half])
    axis, amplitude = spectrum.axis[begin:end], spectrum.amplitude[begin:end]
    low, high = np.searchsorted(axis, [centre - half, centre + half])
    top = int(low) + int(np.argmax(amplitude[low : max(high, low + 1)]))
    lobe = 3.0 * spectrum.bin_width  # half width of the main lobe of a Hann window, plus one bin
    background = (np.abs(axis - centre) <= reach) & (np.abs(axis - centre) > half + lobe) & (axis > lobe)
    fewest = 8  # points of background
    if np.count_nonzero(background) < fewest:
        raise ValueError(
            f"only {np.count_nonzero(background)} points of the spectrum lie within {reach:g} of the line at "
            f"{centre:g}; {fewest} are needed for its background: increase background_width, or record longer."
        )
    return float(axis[top]), float(amplitude[top]), float(np.median(amplitude[background]))
