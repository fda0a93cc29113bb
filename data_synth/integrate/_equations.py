"""The equations of motion as compiled code reads them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate._waves import Waves

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Equations(NamedTuple):
    """What kicks ``x' = generator x + drive``, over x = (scaled modal displacements, modal velocities).

    Meshes come first, then what rubs in them: the mesh force times a share that follows the phase, in a direction of
    its own; a table of `stiffnesses` then holds stiffness times share. ``pushes`` and ``seen`` (n, meshes): by what a
    force changes modal velocities, by what scaled displacements deflect its mesh. ``coupling`` (meshes, meshes) is
    ``seen_i M^-1 pushed_j``. ``held`` (meshes,) are the stiffnesses of the constant part, none for what rubs.
    ``backlashes`` and ``backs`` (meshes,): half the gap, and where backs of teeth touch, nowhere for what rubs.
    ``error_of`` (meshes,) says which of `errors` belongs to a mesh, -1 for none. ``stiffness_later`` and
    ``error_later`` (meshes,) say where the further tables of a mesh begin whose teeth change in time, -1 for none: the
    first is at its own number, or at ``error_of``. ``drags`` (drags, n) are rows of modal velocities, with
    ``drag_factors`` (drags,). ``tied`` (2 n,) gives the reference's revolutions from displacements and its speed from
    velocities; of length zero where it turns as prescribed.
    """

    pushes: Array
    seen: Array
    coupling: Array
    stiffnesses: Waves
    errors: Waves
    error_of: Integers
    held: Array
    backlashes: Array
    backs: Array
    cycles: Array
    drags: Array
    drag_factors: Array
    tied: Array
    stiffness_later: Integers
    error_later: Integers
