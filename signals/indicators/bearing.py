"""Indicators of a bearing: energy at its defect lines in the spectrum of an envelope."""

from dataclasses import dataclass, field

import numpy as np

from signals._checks import Array, positive, whole
from signals.indicators._kinds import expect
from signals.spectra import AmplitudeSpectrum

_LOBE_BINS = 3.0  # of a Hann line on either side
_FEWEST = 8  # points of background


@dataclass(frozen=True, kw_only=True)
class DefectEnergy:
    """Energy of one defect's lines: half their squared peak amplitudes, in the squared unit of the spectrum.

    ``background`` is what as many lines of the surroundings' median height would hold.
    """

    orders: Array = field(metadata={"dims": ("harmonic",), "units": "as the axis"})
    amplitude: Array = field(metadata={"dims": ("harmonic",), "units": "as the spectrum, peak"})
    background: float

    @property
    def energy(self) -> float:
        """Sum over the harmonics of half their squared peak amplitude."""
        return float(np.sum(self.amplitude**2) / 2)

    @property
    def ratio(self) -> float:
        """Energy over that of the background: a few where there is no line, since each is the largest of its band."""
        return self.energy / self.background if self.background > 0 else np.inf


def defect_energy(
    spectrum: AmplitudeSpectrum, *, order: float, harmonics: int, tolerance: float, surroundings: float
) -> DefectEnergy:
    """Return the energy at a defect's lines in an envelope's spectrum.

    After McFadden & Smith (1984), "Model for the vibration produced by a single point defect in a rolling element
    bearing", J. Sound Vib. 96(1), 69-82; of the squared envelope: Randall & Antoni (2011), "Rolling element bearing
    diagnostics - a tutorial", Mech. Syst. Signal Process. 25(2), 485-520.

    Parameters
    ----------
    spectrum : AmplitudeSpectrum
        Of an envelope or squared envelope, over orders or frequency: `envelope_order_spectrum`, `envelope_spectrum`.
    order : float
        Of the defect, in the axis' unit: BPFO, BPFI, twice BSF, FTF.
    harmonics : int
        How many lines, the fundamental being the first.
    tolerance : float
        How far from ``order`` the fundamental may lie, relative: rolling elements slip, some 0.01 to 0.02.
    surroundings : float
        How far on either side of a line the background reaches, in the axis' unit.

    Returns
    -------
    DefectEnergy

    Raises
    ------
    ValueError
        Lines beyond the end of the spectrum, or too little beside them.
    """
    expect(spectrum, AmplitudeSpectrum, indicator="the defect energy")
    first = positive(order, name="order")
    count = whole(harmonics, name="harmonics", least=1)
    slack = positive(tolerance, name="tolerance")
    reach = positive(surroundings, name="surroundings")
    last = count * first * (1 + slack)
    if last > spectrum.axis[-1]:
        raise ValueError(
            f"harmonic {count} of {first:g} reaches to {last:g}, beyond the end of the spectrum, "
            f"{spectrum.axis[-1]:g}; take fewer harmonics."
        )
    found = [
        _line(spectrum, k * first, max(k * first * slack, spectrum.bin_width / 2), reach) for k in range(1, count + 1)
    ]
    orders, amplitude, level = (np.array(column) for column in zip(*found, strict=True))
    return DefectEnergy(orders=orders, amplitude=amplitude, background=float(np.sum(level**2) / 2))


def _line(spectrum: AmplitudeSpectrum, centre: float, half: float, reach: float) -> tuple[float, float, float]:
    """Return where the largest point of a band lies, its height, and the median height beside the band."""
    axis, amplitude = spectrum.axis, spectrum.amplitude
    low, high = np.searchsorted(axis, [centre - half, centre + half])
    top = int(low) + int(np.argmax(amplitude[low : max(high, low + 1)]))
    lobe = _LOBE_BINS * spectrum.bin_width
    beside = (np.abs(axis - centre) <= reach) & (np.abs(axis - centre) > half + lobe) & (axis > lobe)
    if np.count_nonzero(beside) < _FEWEST:
        raise ValueError(
            f"only {np.count_nonzero(beside)} points of the spectrum lie within {reach:g} of the line at {centre:g}, "
            "too few to tell its background; widen the surroundings or record longer."
        )
    return float(axis[top]), float(amplitude[top]), float(np.median(amplitude[beside]))
