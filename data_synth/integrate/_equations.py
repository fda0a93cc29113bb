"""The equations of motion in the form that compiled code takes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate._waves import Waves

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Equations(NamedTuple):
    """Mesh, friction and drag forces on ``x' = generator x + drive``, x = (scaled displacements, velocities) of modes.

    Mesh forces come first, then friction forces: the mesh force times a factor that follows the phase, in a direction
    of its own; their tables in `stiffnesses` hold stiffness times factor.

    ``force_columns`` (n, forces): change of the modal velocities per impulse. ``deflection_rows`` (n, forces):
    deflection of the mesh per scaled displacement. ``coupling`` (forces, forces): ``g_i M^-1 g_j``.
    ``mean_stiffnesses`` (forces,): those in the generator, zero for friction. ``backlashes`` and ``back_half_gaps``
    (forces,): half the backlash towards the driving and the back flank, the latter infinite for friction.
    ``error_of`` (forces,): number of the transmission error in `errors`, -1 for none. ``later_stiffnesses`` and
    ``later_errors`` (forces,): number of the second table of a mesh with a history, -1 for none; the first is at its
    own number, or at ``error_of``. ``drags`` (drags, n): rows of the velocities with drag, and ``drag_factors``
    (drags,). ``reference_row`` (2 n,): revolutions of the reference per displacement and its speed per velocity; empty
    where its angle is prescribed.
    """

    force_columns: Array
    deflection_rows: Array
    coupling: Array
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    mean_stiffnesses: Array
    backlashes: Array
    back_half_gaps: Array
    cycles: Array
    drags: Array
    drag_factors: Array
    reference_row: Array
    later_stiffnesses: Integers
    later_errors: Integers
