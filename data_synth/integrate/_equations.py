"""The equations of motion as compiled code reads them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate._waves import Waves

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Equations(NamedTuple):
    """``x' = generator x + drive`` over x = (scaled modal displacements, modal velocities), and what kicks it.

    ``pushes`` and ``seen`` (n, meshes): by what a mesh force changes modal velocities, by what scaled displacements
    deflect a mesh. ``coupling`` (meshes, meshes) is ``g_i M^-1 g_j``. ``error_of`` (meshes,) says which of `errors`
    belongs to a mesh, -1 for none. ``drags`` (drags, n) are rows of modal velocities, with ``drag_factors`` (drags,).
    ``tied`` (2 n,) gives the reference's revolutions from displacements and its speed from velocities; of length zero
    where it turns as prescribed.
    """

    generator: Array
    drive: Array
    pushes: Array
    seen: Array
    coupling: Array
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    backlashes: Array
    cycles: Array
    drags: Array
    drag_factors: Array
    tied: Array
