"""The force of a mesh whose teeth may part: stiffness times what the gap leaves of the deflection."""

import numpy as np
from numpy.typing import ArrayLike

from data_synth.mechanics import Array, Mesh


def beyond_gap(deflection_m: ArrayLike, *, backlash_m: float) -> Array:
    """Return f: the deflection beyond a dead zone of half width `backlash_m`, 0 within, any shape.

    Positive on the flanks that drive, negative on their backs. Without a gap it is the deflection itself: teeth that
    never part.
    """
    deflection = np.asarray(deflection_m, dtype=np.float64)
    return np.asarray(np.sign(deflection) * np.maximum(np.abs(deflection) - backlash_m, 0.0))


def mesh_force(mesh: Mesh, displacement: Array, *, phase_cycles: ArrayLike) -> Array:
    """Return the force between the teeth of a mesh along its line of action, in N.

    ``k(phi) f(g . q - e(phi))``; the bodies feel ``-g`` times it.

    Parameters
    ----------
    mesh : Mesh
    displacement : (..., dof) array
        q.
    phase_cycles : array broadcast against (...)
    """
    phase = np.asarray(phase_cycles, dtype=np.float64)
    error = 0.0 if mesh.error is None else mesh.error(phase)
    deflection = displacement @ mesh.direction - error
    return np.asarray(mesh.stiffness(phase) * beyond_gap(deflection, backlash_m=mesh.backlash_m))
