"""Active degrees of freedom of a gearbox at a level of fidelity, and the constraints on the others.

A degree of freedom that is not active is fixed or, for a body on a carrier, constrained to the carrier as by a rigid
bearing: so a planet with rotation alone moves with its carrier.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from data_synth.dynamics.assembly import Assembly
from data_synth.dynamics.system import Array, Coordinates, Mesh, Spring, System

LEVELS = ("torsional", "lateral", "full")
_ACROSS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_UPRIGHT = 1 - 1e-9
_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class ActiveDofs:
    """The active degrees of freedom, with the system reduced to them.

    Attributes
    ----------
    system : System
        Equations of motion of the active degrees of freedom. The centripetal stiffness of a rotating frame, of relative
        size ``(Omega / omega)^2``, is left out, as it would make free rotations unstable; gyroscopic terms are in it.
    numbers : (k,) array
        Numbers of the active degrees of freedom among all.
    constraint : (dof, dof) array
        All degrees of freedom as linear functions of each other: the identity but for constrained ones.
    """

    system: System
    numbers: Array = field(repr=False)
    constraint: Array = field(repr=False)

    @property
    def expansion(self) -> Array:
        """All degrees of freedom per active one, (dof, k)."""
        return np.asarray(self.constraint[:, self.numbers])


def active_dofs_of(whole: Assembly, levels: Mapping[str, str]) -> ActiveDofs:
    """Return the active degrees of freedom of a gearbox at these levels of fidelity.

    Parameters
    ----------
    whole : Assembly
        Assembled in the plane or in space.
    levels : mapping of mesh to "torsional", "lateral" or "full"
        A body has the motions of the highest level of its meshes, a carrier those of its planets. Where axes cross,
        lateral motion is translation in all three directions, and full motion has tilt as well.
    """
    coordinates = whole.coordinates
    constraint, numbers = np.eye(len(coordinates.names)), []
    highest = _highest(whole, levels)
    has_crossed_axes = any(abs(body.axis[2]) < _UPRIGHT for body in whole.bodies)
    lateral = ("x", "y", "z", "rotation") if has_crossed_axes else ("x", "y", "rotation")
    motions_of_level = {"torsional": ("rotation",), "lateral": lateral, "full": None}
    for name in _carriers_first(whole):
        body, carrier = coordinates.bodies[name], _carrier_of(whole, name)
        motions = motions_of_level[LEVELS[highest.get(name, 0)]]
        for motion in body.motions:
            number = coordinates.index[name, motion]
            if motions is None or motion in motions:
                numbers.append(number)
            elif carrier is not None:
                row = _constraint_row(coordinates, name, motion, carrier)
                constraint[number] = row @ constraint
    chosen = np.unique(numbers)
    return ActiveDofs(
        system=_reduced_system(whole, constraint[:, chosen], chosen), numbers=chosen, constraint=constraint
    )


def _highest(whole: Assembly, levels: Mapping[str, str]) -> dict[str, int]:
    """Return the number of the highest level of each body, or piece of one."""
    parts = whole.parts
    found: dict[str, int] = {}
    for contact in parts.contacts:
        for link in contact.links:
            body = parts.body(link)
            joint = parts.kinematics.joints.get(body)
            pieces = [parts.piece(body, contact.carrier)]
            if joint is not None and joint.carried_by == contact.carrier != parts.frame:
                pieces.append(parts.piece(contact.carrier, contact.carrier))
            for name in pieces:
                found[name] = max(found.get(name, 0), LEVELS.index(levels[contact.mesh]))
    return found


def _carrier_of(whole: Assembly, name: str) -> str | None:
    """Return the carrier of a body, or its piece; None where that is the frame."""
    joint = whole.parts.kinematics.joints.get(name)
    if joint is None or joint.carried_by == whole.parts.frame:
        return None
    return whole.parts.piece(joint.carried_by, joint.carried_by)


def _carriers_first(whole: Assembly) -> list[str]:
    """Return the names of all bodies, each after its carrier."""
    remaining, found = [body.name for body in whole.bodies], list[str]()
    while remaining:
        ready = [name for name in remaining if (carrier := _carrier_of(whole, name)) is None or carrier in found]
        found += ready
        remaining = [name for name in remaining if name not in ready]
    return found


def _constraint_row(coordinates: Coordinates, name: str, motion: str, carrier: str) -> Array:
    """Return the row (dof,) of a motion of a body that is rigidly connected to its carrier."""
    body = coordinates.bodies[name]
    if motion in _ACROSS:
        return coordinates.displacement_row(carrier, body.centre_m, _ACROSS[motion])
    return coordinates.rotation_row(carrier, body.rotation_axis(motion))


def _reduced_system(whole: Assembly, expansion: Array, chosen: Array) -> System:
    """Return the system with ``q = expansion r``: mass ``expansion' M expansion`` and so on."""
    system = whole.system
    plain = np.array_equal(expansion, np.eye(len(system.names))[:, chosen])

    def square(matrix: Array) -> Array:
        if plain:
            return np.asarray(matrix[np.ix_(chosen, chosen)])
        return np.asarray(expansion.T @ matrix @ expansion)

    def row(direction: Array) -> Array:
        found = direction @ expansion
        return np.asarray(np.where(np.abs(found) > _ROUNDING * np.max(np.abs(direction)), found, 0.0))

    mass = square(system.mass)
    springs = tuple(replace(spring, direction=row(spring.direction)) for spring in whole.springs)
    springs = tuple(spring for spring in springs if spring.direction.any())
    gyroscopic = np.zeros(mass.shape) if system.gyroscopic is None else square(system.gyroscopic)
    gyroscopic = (gyroscopic - gyroscopic.T) / 2
    size = chosen.size
    return System(
        mass=(mass + mass.T) / 2,
        damping=_sum(size, [(spring.damping, spring) for spring in springs]),
        stiffness=_sum(size, [(spring.stiffness, spring) for spring in springs]),
        gyroscopic=gyroscopic if gyroscopic.any() else None,
        meshes=tuple(mesh.in_coordinates(row) for mesh in system.meshes),
        names=tuple(system.names[number] for number in chosen),
        springs=springs,
    )


def _sum(size: int, pairs: list[tuple[float, Spring | Mesh]]) -> Array:
    """Return the sum of ``constant g g'``, (size, size)."""
    total = np.zeros((size, size))
    for constant, joined in pairs:
        total += constant * np.outer(joined.direction, joined.direction)
    return total
