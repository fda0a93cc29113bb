"""Where errors bend, so that tables of them are short."""

import numpy as np
import pytest

from data_synth.gears.transmission_error import Eccentricity, PitchError, SumOfErrors


def test_a_sum_has_those_of_its_parts_as_late_as_they_are():
    teeth = np.zeros(3)
    teeth[1] = 1e-5
    runout = Eccentricity(teeth=5, eccentricity_m=1e-6)
    error = SumOfErrors(parts=(PitchError(teeth_m=teeth, handover=0.5), runout), by_cycles=0.25)
    first = np.array([0.75, 1.25, 1.75, 2.25])
    assert error.jumps == pytest.approx(np.sort((first + 3 * np.arange(5)[:, None]).ravel()))
