"""Degrees of freedom of a gearbox that teeth and torques excite.

The others are coupled to none of these and stay at rest, so that leaving them out is exact.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.assembly import Assembly
from data_synth.dynamics.system import Array, System, spring_matrices

_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class ExcitedDofs:
    """The degrees of freedom that something excites, with the system reduced to them.

    Attributes
    ----------
    system : System
        Their equations of motion. The centripetal stiffness of a rotating frame, of relative size
        ``(Omega / omega)^2``, is left out, as it would make free rotations unstable; gyroscopic terms are in it.
    numbers : (k,) array
        Their numbers among all degrees of freedom.
    """

    system: System
    numbers: NDArray[np.int_] = field(repr=False)


def excited_dofs_of(whole: Assembly) -> ExcitedDofs:
    """Return the degrees of freedom coupled to a rotation about an axis or to the deflection of a mesh."""
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    system, size = whole.system, len(whole.system.names)
    gyroscopic = np.zeros((size, size)) if system.gyroscopic is None else system.gyroscopic
    coupled = (system.mass != 0) | (gyroscopic != 0)
    excited = np.array([name.endswith(" rotation") for name in system.names])
    pressed = [_without_rounding(mesh.direction) != 0 for mesh in system.meshes]
    for joined in [*pressed, *(_without_rounding(spring.direction) != 0 for spring in whole.springs)]:
        coupled |= np.outer(joined, joined)
    excited |= np.any(pressed, axis=0)
    _, component = connected_components(coupled, directed=False)
    numbers = np.flatnonzero(np.isin(component, component[excited]))
    square = np.ix_(numbers, numbers)

    def reduced(direction: Array) -> Array:
        return _without_rounding(direction)[numbers]

    springs = [replace(spring, direction=reduced(spring.direction)) for spring in whole.springs]
    springs = [spring for spring in springs if spring.direction.any()]
    stiffness, damping = spring_matrices(springs, numbers.size)
    return ExcitedDofs(
        system=System(
            mass=system.mass[square],
            damping=damping,
            stiffness=stiffness,
            gyroscopic=gyroscopic[square] if gyroscopic.any() else None,
            meshes=tuple(mesh.in_coordinates(reduced) for mesh in system.meshes),
            names=tuple(system.names[number] for number in numbers),
            springs=tuple(springs),
        ),
        numbers=numbers,
    )


def _without_rounding(direction: Array) -> Array:
    """Return a direction without what rounding leaves of the products of its geometry."""
    return np.where(np.abs(direction) > _ROUNDING * np.max(np.abs(direction)), direction, 0.0)
