"""Lines of the exciting forces of meshes against closed forms."""

from fractions import Fraction

import numpy as np
import pytest

from data_synth.dynamics import Mesh, Rectangular
from data_synth.fidelity.excitation import Excitation
from data_synth.gears.mesh_stiffness import Shifted
from data_synth.gears.transmission_error import SumOfErrors


class Teeth:
    """A saw tooth that jumps from 1 um to zero where a cycle begins."""

    period = 1
    jumps = (0.0,)

    def __call__(self, phase_cycles):
        return 1e-6 * np.remainder(phase_cycles, 1.0)


@pytest.mark.parametrize("by_cycles", [0.0, 0.1234567])
def test_a_stiffness_that_jumps_has_its_lines_wherever_it_jumps(by_cycles):
    """To 6.6e-4, with 16 points to a period of the highest."""
    rectangle = Rectangular(low=1.0, high=2.0, duty=0.3)
    mesh = Mesh(name="m", direction=np.ones(1), stiffness=Shifted(of=rectangle, by_cycles=by_cycles))
    found = Excitation.of(mesh, Fraction(20), top=20 * 30).varying
    k = np.arange(1, 31)
    exact = (1 - np.exp(-2j * np.pi * k * 0.3)) / (1j * np.pi * k) * np.exp(2j * np.pi * k * by_cycles) / 1.3
    assert np.linalg.norm(found - exact) < 1e-3 * np.linalg.norm(exact)


def test_errors_within_errors_are_apart_by_their_periods():
    """However deep they are: two equal ones half a cycle apart have no odd lines."""
    late = SumOfErrors(parts=(SumOfErrors(parts=(Teeth(), Teeth()), by_cycles=(0.2, 0.7)),), by_cycles=(0.05,))
    mesh = Mesh(name="m", direction=np.ones(1), stiffness=Rectangular(low=1.0, high=1.0, duty=0.5), error=late)
    found = Excitation.of(mesh, Fraction(20), top=20 * 10).errors_n
    assert list(found) == [1]
    k = np.arange(1, 11)
    exact = -1e-6 * 1j / (np.pi * k) * (np.exp(2j * np.pi * k * 0.25) + np.exp(2j * np.pi * k * 0.75))
    assert np.linalg.norm(found[1] - exact) < 1e-3 * np.linalg.norm(exact)
