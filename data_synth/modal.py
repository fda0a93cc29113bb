"""Natural frequencies and mode shapes of a gearbox, and what kind of motion each is.

Stiffnesses of real gearboxes differ by many powers of ten, and the sum of their matrices keeps only those digits of
the soft ones that the stiff ones leave. So the matrices are not summed: with the springs as rows,
``K = B' diag(k) B``, the frequencies are the singular values of ``diag(sqrt k) B L^-T``, M = L L', and one-sided
Jacobi rotations find each of them to its own relative precision, whatever the scales of the rows (Drmac and Veselic
2008, SIAM J. Matrix Anal. Appl. 29: LAPACK's gejsv).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import linalg

from data_synth.mechanics import SPACE, Array, System

_RANK = 1e-9  # rows of unit length that depend on each other leave singular values of rounding
_ZERO = 1e-10  # of the largest squared frequency, where there are no springs to tell
_PURE = 1e-6  # of the kinetic energy: what the other kind of motion may have
_HIGH_ACCURACY = 2  # gejsv's joba = "F": rows and columns of any scale


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Undamped modes, rising in frequency.

    Attributes
    ----------
    frequencies_hz : (mode,) array
        Exactly zero for motions that strain nothing.
    shapes : (dof, mode) array
        ``shapes' M shapes = 1``.
    kinds : tuple of str
        "rigid", "rotational", "translational", "planet" or "mixed"; see `solve_modes`.
    names : tuple of str
        Degrees of freedom.
    """

    frequencies_hz: Array = field(metadata={"dims": ("mode",), "units": "Hz"})
    shapes: Array = field(metadata={"dims": ("dof", "mode"), "units": "kg-1/2"})
    kinds: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def angular(self) -> Array:
        """Frequencies in rad/s, (mode,)."""
        return np.asarray(2 * np.pi * self.frequencies_hz)


def solve_modes(system: System, *, planets: Sequence[str] = (), mesh_stiffness: Sequence[float] | None = None) -> Modes:
    """Return the modes of a system at rest, its meshes closed.

    A mode is *rotational* where no central body (one that is no planet) leaves its place, *translational* where none of
    them turns, *planet* where none of them moves at all, and *mixed* otherwise, a part in a million of the
    kinetic energy allowed. With planets alike and evenly spaced, no mode is mixed (Lin and Parker 1999, J. Vib. Acoust.
    121). Damping and gyroscopic terms are left out; see `data_synth.campbell`.

    Parameters
    ----------
    system : System
    planets : sequence of str
        Names of the bodies that are planets.
    mesh_stiffness : sequence of float
        N/m for each mesh; the means if left out.

    Returns
    -------
    Modes
    """
    constants = [mesh.stiffness.mean for mesh in system.meshes] if mesh_stiffness is None else mesh_stiffness
    bodies = {body for body, _ in places(system)}
    missing = [name for name in planets if name not in bodies]
    if missing:
        raise ValueError(f'planets names "{missing[0]}", which is not one of {", ".join(sorted(bodies))}.')
    angular, shapes = mode_pairs(system, constants)
    kinds = tuple(
        "rigid" if rate == 0 else _kind(system, shape, planets) for rate, shape in zip(angular, shapes.T, strict=True)
    )
    return Modes(frequencies_hz=angular / (2 * np.pi), shapes=shapes, kinds=kinds, names=system.names)


def mode_pairs(system: System, mesh_stiffness: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return frequencies in rad/s, rising, and mass-normalised shapes (dof, mode), meshes at given stiffnesses."""
    lower = np.asarray(np.linalg.cholesky(system.mass), dtype=np.float64)
    if system.springs or not system.stiffness.any():
        angular, turned = _from_rows(*_rows(system, mesh_stiffness), lower)
    else:
        total = system.stiffness.copy()
        for mesh, value in zip(system.meshes, mesh_stiffness, strict=True):
            total += value * np.outer(mesh.direction, mesh.direction)
        inverse = linalg.solve_triangular(lower, np.eye(system.dof), lower=True)
        squares, turned = np.linalg.eigh(inverse @ total @ inverse.T)
        angular = np.sqrt(np.where(squares > _ZERO * squares[-1], squares, 0.0))
    return angular, np.asarray(linalg.solve_triangular(lower.T, turned, lower=False))


def places(system: System) -> tuple[tuple[str, str], ...]:
    """Return body and motion of each degree of freedom, told by the end of its name."""
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
    """Return a system whose damping gives every mode (at mean mesh stiffness) a ratio of critical damping.

    ``C = M phi diag(2 zeta omega) phi' M``; replaces what damping there was.

    Parameters
    ----------
    system : System
    ratio : float or sequence of one a mode
        zeta, rising in frequency.
    """
    angular, shapes = mode_pairs(system, [mesh.stiffness.mean for mesh in system.meshes])
    heavy = system.mass @ shapes
    return replace(system, damping=np.asarray((heavy * (2 * np.asarray(ratio) * angular)) @ heavy.T))


def _rows(system: System, mesh_stiffness: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return the directions and constants of all springs and meshes that have a stiffness."""
    pairs = [(spring.direction, spring.stiffness) for spring in system.springs]
    pairs += [(mesh.direction, float(value)) for mesh, value in zip(system.meshes, mesh_stiffness, strict=True)]
    negative = [value for _, value in pairs if value < 0]
    if negative:
        raise ValueError(f"a stiffness of {negative[0]:g} N/m is negative; springs and meshes need 0 or more.")
    kept = [(row, value) for row, value in pairs if value > 0]
    rows = np.array([row for row, _ in kept]).reshape(len(kept), system.dof)
    return rows, np.array([value for _, value in kept])


def _from_rows(rows: Array, constants: Array, lower: Array) -> tuple[Array, Array]:
    """Return rising frequencies and orthonormal shapes in ``L' q``, those that strain nothing at zero."""
    size = lower.shape[0]
    turned = linalg.solve_triangular(lower, rows.T, lower=True).T if rows.size else np.zeros((0, size))
    lengths = np.linalg.norm(turned, axis=1)
    free = size - int(np.linalg.matrix_rank(turned / lengths[:, None], tol=_RANK)) if rows.size else size
    strained = np.zeros((max(size, turned.shape[0]), size))
    strained[: turned.shape[0]] = np.sqrt(constants)[:, None] * turned
    # stiff rows first, so that elimination never mixes them into softer ones
    order = np.argsort(-np.linalg.norm(strained, axis=1), kind="stable")
    values, _, right, work, _, info = linalg.lapack.dgejsv(strained[order], joba=_HIGH_ACCURACY, jobu=3, jobv=0)
    if info:
        raise ArithmeticError(f"the Jacobi rotations of {size} modes did not converge (gejsv: info = {info}).")
    angular = values[::-1] * (work[0] / work[1])
    angular[:free] = 0.0
    return angular, right[:, ::-1]


def _kind(system: System, shape: Array, planets: Sequence[str]) -> str:
    """Classify a shape by the kinetic energy of the central bodies' translation and rotation."""
    energy = shape * (system.mass @ shape)  # adds up to 1
    central = [
        (motion, part) for (body, motion), part in zip(places(system), energy, strict=True) if body not in planets
    ]
    turning = sum(part for motion, part in central if motion == "rotation")
    moving = sum(part for motion, part in central if motion != "rotation")
    if planets and max(turning, moving) < _PURE:
        return "planet"
    if moving < _PURE:
        return "rotational"
    return "translational" if turning < _PURE else "mixed"
