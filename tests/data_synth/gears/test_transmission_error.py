"""Where errors bend, so that tables of them are short."""

import numpy as np
import pytest

from data_synth.gears.transmission_error import Eccentricity, PitchError, SumOfErrors


def bends(error, phases):
    """Phases where the second difference of an error, smooth elsewhere, is not small."""
    values = error(phases)
    second = np.abs(np.diff(values, 2))
    return phases[1:-1][second > 0.01 * np.max(second)]


@pytest.mark.parametrize("handover", [0.6, 0.0])
def test_a_pitch_error_bends_at_its_jumps_alone(handover):
    teeth = np.zeros(7)
    teeth[2] = 1e-5
    error = PitchError(teeth_m=teeth, handover=handover)
    assert error.jumps == pytest.approx(sorted({2, 2 + handover, 3, 3 + handover}))
    for phase in bends(error, np.linspace(0, 7, 7001)):
        assert np.min(np.abs(np.array(error.jumps) - phase)) < 0.002


def test_a_sum_has_those_of_its_parts_as_late_as_they_are():
    teeth = np.zeros(3)
    teeth[1] = 1e-5
    runout = Eccentricity(teeth=5, eccentricity_m=1e-6)
    error = SumOfErrors(parts=(PitchError(teeth_m=teeth, handover=0.5), runout), by_cycles=0.25)
    first = np.array([0.75, 1.25, 1.75, 2.25])
    assert error.jumps == pytest.approx(np.sort((first + 3 * np.arange(5)[:, None]).ravel()))


def test_an_even_error_has_none():
    assert PitchError(teeth_m=np.zeros(5), handover=0.5).jumps == ()
    assert SumOfErrors(parts=(Eccentricity(teeth=5, eccentricity_m=1e-6),)).jumps == ()
