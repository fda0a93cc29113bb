"""Natural frequencies and mode shapes of a gearbox, and the kind of motion of each mode.

Stiffnesses of real gearboxes differ by many powers of ten, and the sum of their matrices keeps only those digits of
the soft springs that the stiff ones leave. So the matrices are not summed: with the springs as rows,
``K = B' diag(k) B``, the frequencies are the singular values of ``diag(sqrt k) B L^-T``, M = L L', and one-sided
Jacobi rotations find each of them to its own relative precision, whatever the scales of the rows (Drmac and Veselic
2008, SIAM J. Matrix Anal. Appl. 29: LAPACK's gejsv).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from data_synth.mechanics import SPACE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from data_synth.mechanics import Array, System

_RANK_TOLERANCE = 1e-9  # dependent rows of unit length leave singular values of the order of rounding
_RIGID = 1e-10  # of the largest squared frequency: a mode below it is rigid, where no springs decide
_PURE = 1e-6  # of the kinetic energy: what a pure rotation or translation may have of the other kind
_HIGH_ACCURACY = 2  # gejsv's joba = "F": rows and columns of any scale


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Undamped modes, in order of rising frequency.

    Attributes
    ----------
    frequencies_hz : (mode,) array
        Natural frequencies in Hz; exactly zero for rigid-body modes.
    shapes : (dof, mode) array
        Mode shapes in kg^-1/2 (rotations: kg^-1/2 m^-1), normalised by mass: ``shapes' M shapes = 1``.
    kinds : tuple of str
        "rigid", "rotational", "translational", "planet" or "mixed"; see `solve_modes`.
    names : tuple of str
        Degrees of freedom, one for each row of `shapes`.

    Examples
    --------
    >>> from data_synth.elements import Support
    >>> from data_synth.mechanics import Body, build_system
    >>> from data_synth.modal import solve_modes
    >>> gear = Body(name="gear", mass_kg=4.0, motions=("x",))
    >>> modes = solve_modes(build_system([gear], [Support(between=("gear", None), x=1e6)]))
    >>> float(modes.shapes[0, 0] ** 2)  # 1 / m
    0.25
    """

    frequencies_hz: Array = field(metadata={"dims": ("mode",), "units": "Hz"})
    shapes: Array = field(metadata={"dims": ("dof", "mode"), "units": "kg-1/2"})
    kinds: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def angular(self) -> Array:
        """Natural frequencies in rad/s, (mode,)."""
        return np.asarray(2 * np.pi * self.frequencies_hz)


def solve_modes(system: System, *, planets: Sequence[str] = (), mesh_stiffness: Sequence[float] | None = None) -> Modes:
    """Return the undamped modes of a system at rest, with every mesh in contact.

    A mode is *rotational* where no central body (one that is no planet) is displaced, *translational* where none of
    them rotates, *planet* where none of them moves at all, and *mixed* otherwise, a part in a million of the
    kinetic energy allowed. With equal, evenly spaced planets no mode is mixed (Lin and Parker 1999, J. Vib. Acoust.
    121). Damping and gyroscopic terms are left out; see `data_synth.campbell`.

    Parameters
    ----------
    system : System
        Equations of motion, from `data_synth.assembly.assemble` or `data_synth.mechanics.build_system`.
    planets : sequence of str
        Names of the bodies that are planets, for the kinds of mode only.
    mesh_stiffness : sequence of float, optional
        Stiffness of each mesh in N/m, in the order of ``system.meshes``; the mean of each over the mesh phase if left
        out.

    Returns
    -------
    Modes

    Raises
    ------
    ValueError
        If `planets` names a body that the system lacks, a mesh or spring has a negative stiffness, or the name of a
        degree of freedom does not end in its motion.

    Examples
    --------
    Two rotors on a shaft have a rigid rotation and one torsional mode, ``omega^2 = k (1 / J1 + 1 / J2)``:

    >>> import numpy as np
    >>> from data_synth.elements import Coupling
    >>> from data_synth.mechanics import Body, build_system
    >>> from data_synth.modal import solve_modes
    >>> motor = Body(name="motor", inertia_kgm2=1.0, motions=("rotation",))
    >>> fan = Body(name="fan", inertia_kgm2=2.0, motions=("rotation",))
    >>> shaft = Coupling(motions={("motor", "rotation"): 1.0, ("fan", "rotation"): -1.0}, stiffness=600.0)
    >>> modes = solve_modes(build_system([motor, fan], [shaft]))
    >>> np.round(modes.angular, 6).tolist(), modes.kinds
    ([0.0, 30.0], ('rigid', 'rotational'))
    """
    constants = [mesh.stiffness.mean for mesh in system.meshes] if mesh_stiffness is None else mesh_stiffness
    bodies = {body for body, _ in body_motions(system)}
    missing = [name for name in planets if name not in bodies]
    if missing:
        raise ValueError(f'planets names "{missing[0]}", which is not one of {", ".join(sorted(bodies))}.')
    angular, shapes = undamped_modes(system, constants)
    kinds = tuple(
        "rigid" if rate == 0 else _kind(system, shape, planets) for rate, shape in zip(angular, shapes.T, strict=True)
    )
    return Modes(frequencies_hz=angular / (2 * np.pi), shapes=shapes, kinds=kinds, names=system.names)


def undamped_modes(system: System, mesh_stiffness: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return rising natural frequencies in rad/s and mass-normalised shapes (dof, mode) at given mesh stiffnesses."""
    lower = np.asarray(np.linalg.cholesky(system.mass), dtype=np.float64)
    if system.springs or not system.stiffness.any():
        angular, vectors = _singular_pairs(*_springs_and_meshes(system, mesh_stiffness), lower)
    else:
        total = system.stiffness.copy()
        for mesh, value in zip(system.meshes, mesh_stiffness, strict=True):
            total += value * np.outer(mesh.direction, mesh.direction)
        inverse = linalg.solve_triangular(lower, np.eye(system.dof), lower=True)
        squares, vectors = np.linalg.eigh(inverse @ total @ inverse.T)
        angular = np.sqrt(np.where(squares > _RIGID * squares[-1], squares, 0.0))
    return angular, np.asarray(linalg.solve_triangular(lower.T, vectors, lower=False))


def body_motions(system: System) -> tuple[tuple[str, str], ...]:
    """Return body and motion of each degree of freedom, read from its name: "sun tilt x" is ("sun", "tilt x")."""
    found = []
    for name in system.names:
        motion = next((motion for motion in SPACE if name.endswith(f" {motion}")), "")
        if not motion:
            raise ValueError(f'the name "{name}" does not end in one of {", ".join(SPACE)}.')
        # "tilt x" ends in " x" as well
        motion = f"tilt {motion}" if name.endswith(f" tilt {motion}") else motion
        found.append((name.removesuffix(f" {motion}"), motion))
    return tuple(found)


def with_modal_damping(system: System, *, ratio: float | Sequence[float]) -> System:
    """Return a system whose damping gives every mode, at mean mesh stiffness, a ratio of critical damping.

    ``C = M phi diag(2 zeta omega) phi' M``, phi the mass-normalised shapes.

    Parameters
    ----------
    system : System
        Equations of motion; their damping matrix is replaced.
    ratio : float or sequence of one per mode
        zeta, dimensionless, in order of rising frequency.

    Returns
    -------
    System

    Examples
    --------
    >>> from data_synth.elements import Support
    >>> from data_synth.mechanics import Body, build_system
    >>> from data_synth.modal import with_modal_damping
    >>> gear = Body(name="gear", mass_kg=4.0, motions=("x",))
    >>> system = build_system([gear], [Support(between=("gear", None), x=1e6)])
    >>> damped = with_modal_damping(system, ratio=0.03)
    >>> round(float(damped.damping[0, 0]), 6)  # 2 zeta sqrt(k m), N s/m
    120.0
    """
    angular, shapes = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
    momentum = system.mass @ shapes
    return replace(system, damping=np.asarray((momentum * (2 * np.asarray(ratio) * angular)) @ momentum.T))


def _springs_and_meshes(system: System, mesh_stiffness: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return the directions and constants of all springs and meshes whose stiffness is not zero."""
    pairs = [(spring.direction, spring.stiffness) for spring in system.springs]
    pairs += [(mesh.direction, float(value)) for mesh, value in zip(system.meshes, mesh_stiffness, strict=True)]
    negative = [value for _, value in pairs if value < 0]
    if negative:
        raise ValueError(f"a stiffness of {negative[0]:g} N/m is negative; springs and meshes need 0 or more.")
    stiff = [(row, value) for row, value in pairs if value > 0]
    rows = np.array([row for row, _ in stiff]).reshape(len(stiff), system.dof)
    return rows, np.array([value for _, value in stiff])


def _singular_pairs(rows: Array, constants: Array, lower: Array) -> tuple[Array, Array]:
    """Return rising frequencies and orthonormal vectors in ``L' q``, rigid-body modes at exactly zero."""
    size = lower.shape[0]
    weighted = linalg.solve_triangular(lower, rows.T, lower=True).T if rows.size else np.zeros((0, size))
    lengths = np.linalg.norm(weighted, axis=1)
    rank = int(np.linalg.matrix_rank(weighted / lengths[:, None], tol=_RANK_TOLERANCE)) if rows.size else 0
    matrix = np.zeros((max(size, weighted.shape[0]), size))
    matrix[: weighted.shape[0]] = np.sqrt(constants)[:, None] * weighted
    # stiff rows first, so that elimination never mixes them into softer ones
    order = np.argsort(-np.linalg.norm(matrix, axis=1), kind="stable")
    values, _, right, work, _, info = linalg.lapack.dgejsv(matrix[order], joba=_HIGH_ACCURACY, jobu=3, jobv=0)
    if info:
        raise ArithmeticError(f"the Jacobi rotations of {size} modes did not converge (gejsv: info = {info}).")
    angular = values[::-1] * (work[0] / work[1])
    angular[: size - rank] = 0.0
    return angular, right[:, ::-1]


def _kind(system: System, shape: Array, planets: Sequence[str]) -> str:
    """Classify a shape by the kinetic energy of the central bodies' translation and rotation."""
    energy = shape * (system.mass @ shape)  # adds up to 1
    central = [
        (motion, part) for (body, motion), part in zip(body_motions(system), energy, strict=True) if body not in planets
    ]
    rotation = sum(part for motion, part in central if motion == "rotation")
    translation = sum(part for motion, part in central if motion != "rotation")
    if planets and max(rotation, translation) < _PURE:
        return "planet"
    if translation < _PURE:
        return "rotational"
    return "translational" if rotation < _PURE else "mixed"
