"""The tables of the page of choices: windows against theory, averages of planets against their waveform."""

import choices
import numpy as np
import pytest
from tracking.clock import Effort

ONCE = Effort(repeats=1, slow_repeats=1)
# coefficients of cosines: Harris (1978), Proc. IEEE 66(1); flat top: D'Antona and Ferrero (2006)
COSINES = {
    "boxcar": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
    "blackmanharris": (0.35875, 0.48829, 0.14128, 0.01168),
    "flattop": (0.21557895, 0.41663158, 0.277263158, 0.083578947, 0.006947368),
}


def cells(lines):
    """The cells of a table by their row's name."""
    return {row[0]: row[1:] for row in (line.strip("| ").split(" | ") for line in lines[2:] if line)}


def leakage(cosines, bins):
    """The transform of a window at a distance from its middle, in bins: a sum of sinc functions, Harris eq. 25."""
    number, weight = np.arange(len(cosines)), np.array(cosines) / cosines[0] / 2
    return abs(np.sum(weight * (np.sinc(bins + number) + np.sinc(bins - number))))


def test_windows_are_those_of_theory():
    found = cells(choices.windows(ONCE))
    assert found.keys() == COSINES.keys()
    for name, cosines in COSINES.items():
        theory = [20 * np.log10(leakage(cosines, away)) for away in choices.AWAY]
        measured = [float(cell) for cell in found[name][: len(theory)]]
        heard = [each > -90 for each in theory]  # dB; below, the line's image at minus its frequency is as large
        assert np.array(measured)[heard] == pytest.approx(np.array(theory)[heard], abs=0.3)
        bandwidth = (1 + np.sum(np.square(cosines)) / cosines[0] ** 2) / 2
        assert float(found[name][len(theory)]) == pytest.approx(bandwidth, rel=0.01)  # of 800,000 values


def test_an_average_over_more_passes_is_nearer_to_the_planet_s_waveform():
    for errors in cells(choices.planets(ONCE)).values():
        few, more, most = (float(cell) for cell in errors[:3])
        assert most < more < few < 1
