"""Natural frequencies and mode shapes of a gearbox, and the type of each mode.

Stiffnesses of real gearboxes differ by many orders of magnitude, and in the sum of their matrices soft springs lose
digits to stiff ones. The matrices are therefore not summed: with the springs as rows, ``K = B' diag(k) B``, the natural
frequencies are the singular values of ``diag(sqrt k) B L^-T``, where M = L L', and one-sided Jacobi rotations find each
to high relative accuracy, whatever the scales of the rows (Drmac and Veselic 2008, SIAM J. Matrix Anal. Appl. 29:
LAPACK's gejsv).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy import linalg

from data_synth.dynamics.system import SPACE, Array, System
from data_synth.gears.mesh_stiffness import ComplexArray

_RANK_TOLERANCE = 1e-9  # linearly dependent rows of unit length have singular values at rounding level
_PURE = 1e-6  # of the kinetic energy: allowed share of the other type in a rotational or translational mode
_HIGH_ACCURACY = 2  # gejsv's joba = "F": rows and columns of any scale


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Undamped modes in ascending order of frequency.

    Attributes
    ----------
    frequencies_hz : (mode,) array
        Natural frequencies in Hz; exactly zero for rigid-body modes.
    shapes : (dof, mode) array
        Mass-normalised mode shapes in kg^-1/2 (rotations: kg^-1/2 m^-1): ``shapes' M shapes = 1``.
    kinds : tuple of str
        "rigid", "rotational", "translational", "planet" or "mixed"; see `solve_modes`.
    names : tuple of str
        Degrees of freedom, one per row of `shapes`.

    Examples
    --------
    >>> from data_synth.dynamics import Body, Support, build_system, solve_modes
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


def solve_modes(system: System, *, planets: Sequence[str] = ()) -> Modes:
    """Return the undamped modes of a system at rest, with every mesh in contact at its mean stiffness.

    A mode is *rotational* if no central body (any body but planets) is displaced, *translational* if none rotates,
    *planet* if none moves at all, and *mixed* otherwise, within a millionth of the kinetic energy. With identical,
    evenly spaced planets no mode is mixed (Lin and Parker 1999, J. Vib. Acoust. 121). Damping and gyroscopic terms are
    ignored; `campbell` includes them.

    Parameters
    ----------
    system : System
        Equations of motion, from `data_synth.dynamics.assembly.assemble` or `data_synth.dynamics.system.build_system`.
    planets : sequence of str
        Names of the bodies that are planets; used to classify modes only.

    Returns
    -------
    Modes

    Raises
    ------
    ValueError
        If `planets` names a body not in the system, a mesh or spring has a negative stiffness, or the name of a degree
        of freedom does not end in its motion.

    Examples
    --------
    Two rotors on a shaft have a rigid-body rotation and one torsional mode, ``omega^2 = k (1 / J1 + 1 / J2)``:

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, Coupling, build_system, solve_modes
    >>> motor = Body(name="motor", inertia_kgm2=1.0, motions=("rotation",))
    >>> fan = Body(name="fan", inertia_kgm2=2.0, motions=("rotation",))
    >>> shaft = Coupling(motions={("motor", "rotation"): 1.0, ("fan", "rotation"): -1.0}, stiffness=600.0)
    >>> modes = solve_modes(build_system([motor, fan], [shaft]))
    >>> np.round(modes.angular, 6).tolist(), modes.kinds
    ([0.0, 30.0], ('rigid', 'rotational'))
    """
    bodies = {body for body, _ in body_motions(system)}
    missing = [name for name in planets if name not in bodies]
    if missing:
        raise ValueError(f'planets names "{missing[0]}", which is not one of {", ".join(sorted(bodies))}.')
    angular, shapes = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
    kinds = tuple(
        "rigid" if rate == 0 else _kind(system, shape, planets) for rate, shape in zip(angular, shapes.T, strict=True)
    )
    return Modes(frequencies_hz=angular / (2 * np.pi), shapes=shapes, kinds=kinds, names=system.names)


def undamped_modes(system: System, mesh_stiffness: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return ascending natural frequencies (mode,) in rad/s and mass-normalised shapes (dof, mode).

    `mesh_stiffness` (mesh,) holds the stiffness of each mesh in N/m.
    """
    rows, constants = _springs_and_meshes(system, mesh_stiffness)
    return _modes_by_content(
        system.dof, np.asarray(system.mass, dtype=np.float64).tobytes(), rows.tobytes(), constants.tobytes()
    )


@lru_cache(maxsize=16)  # statics, damping and integration of a record need the same modes a dozen times
def _modes_by_content(dof: int, mass: bytes, rows: bytes, constants: bytes) -> tuple[Array, Array]:
    lower = np.asarray(np.linalg.cholesky(np.frombuffer(mass).reshape(dof, dof)), dtype=np.float64)
    angular, vectors = _singular_pairs(np.frombuffer(rows).reshape(-1, dof), np.frombuffer(constants), lower)
    shapes = np.asarray(linalg.solve_triangular(lower.T, vectors, lower=False))
    angular.flags.writeable = shapes.flags.writeable = False
    return angular, shapes


def body_motions(system: System) -> tuple[tuple[str, str], ...]:
    """Return body and motion of each degree of freedom, read from its name: "sun tilt x" is ("sun", "tilt x")."""
    found = []
    for name in system.names:
        motion = next((motion for motion in SPACE if name.endswith(f" {motion}")), "")
        if not motion:
            raise ValueError(f'the name of the degree of freedom "{name}" must end in one of {", ".join(SPACE)}.')
        # "tilt x" ends in " x" as well
        motion = f"tilt {motion}" if name.endswith(f" tilt {motion}") else motion
        found.append((name.removesuffix(f" {motion}"), motion))
    return tuple(found)


def with_modal_damping(system: System, *, ratio: float | Sequence[float]) -> System:
    """Return a system with a given damping ratio of every mode at mean mesh stiffness.

    ``C = M phi diag(2 zeta omega) phi' M``, with mass-normalised shapes phi.

    Parameters
    ----------
    system : System
        Equations of motion; their damping matrix is replaced.
    ratio : float or sequence of one per mode
        Damping ratio zeta; a sequence in ascending order of frequency.

    Returns
    -------
    System

    Examples
    --------
    >>> from data_synth.dynamics import Body, Support, build_system, with_modal_damping
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
    if not pairs:
        pairs = [(row, 1.0) for row in _factor(system.stiffness)]
    pairs += [(mesh.direction, float(value)) for mesh, value in zip(system.meshes, mesh_stiffness, strict=True)]
    negative = [value for _, value in pairs if value < 0]
    if negative:
        raise ValueError(f"a spring or mesh has the stiffness {negative[0]:g} N/m; it must be 0 or more.")
    stiff = [(row, value) for row, value in pairs if value > 0]
    rows = np.array([row for row, _ in stiff]).reshape(len(stiff), system.dof)
    return rows, np.array([value for _, value in stiff])


def _factor(stiffness: Array) -> Array:
    """Return rows B of ``B' B = K``, by pivoted Cholesky factorisation of K scaled to a unit diagonal.

    With this scaling, soft springs keep their digits beside stiff ones (Demmel and Veselic 1992, SIAM J. Matrix Anal.
    Appl. 13, 1204); negative parts are left out.
    """
    size, diagonal = stiffness.shape[0], np.diag(stiffness)
    unit = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    rounding = 64 * size * np.finfo(float).eps  # of the unit diagonal: a smaller pivot belongs to a rigid mode
    factor, pivots, rank, _ = linalg.lapack.dpstrf(stiffness * unit * unit[:, None], tol=rounding)
    rows = np.zeros((rank, size))
    rows[:, pivots - 1] = np.triu(factor)[:rank]
    return rows / unit


def _singular_pairs(rows: Array, constants: Array, lower: Array) -> tuple[Array, Array]:
    """Return ascending frequencies and orthonormal vectors in ``L' q``, with rigid-body modes at exactly zero."""
    size = lower.shape[0]
    weighted = linalg.solve_triangular(lower, rows.T, lower=True).T if rows.size else np.zeros((0, size))
    lengths = np.linalg.norm(weighted, axis=1)
    rank = int(np.linalg.matrix_rank(weighted / lengths[:, None], tol=_RANK_TOLERANCE)) if rows.size else 0
    matrix = np.zeros((max(size, weighted.shape[0]), size))
    matrix[: weighted.shape[0]] = np.sqrt(constants)[:, None] * weighted
    # stiff rows first, so that elimination does not mix them into softer ones
    order = np.argsort(-np.linalg.norm(matrix, axis=1), kind="stable")
    values, _, right, work, _, info = linalg.lapack.dgejsv(matrix[order], joba=_HIGH_ACCURACY, jobu=3, jobv=0)
    if info:
        raise ArithmeticError(f"Jacobi rotations for {size} modes did not converge (gejsv: info = {info}).")
    angular = values[::-1] * (work[0] / work[1])
    angular[: size - rank] = 0.0
    return angular, right[:, ::-1]


def _kind(system: System, shape: Array, planets: Sequence[str]) -> str:
    """Classify a shape by the translational and rotational kinetic energy of the central bodies."""
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


# ---- Campbell diagram: natural frequencies and damping ratios over speed, and critical speeds ------------------------


_OVERDAMPED = 1e-9  # of the magnitude: eigenvalues with a smaller imaginary part do not oscillate
_RIGID_SHARE = 1e-7  # of the largest magnitude: a double zero is accurate to half the digits


@dataclass(frozen=True, kw_only=True)
class Campbell:
    """Natural frequencies and damping ratios over speed, in ascending order of frequency at every speed.

    Attributes
    ----------
    speeds_rad_s : (speed,) array
        Speed of the reference shaft in rad/s.
    frequencies_hz : (speed, mode) array
        Damped natural frequencies in Hz; zero for rigid-body and overdamped motions.
    damping_ratios : (speed, mode) array
        Damping ratios; NaN for rigid-body and overdamped motions.
    orders : tuple of float
        Mesh orders at the last speed, cycles per revolution of the reference.

    Examples
    --------
    >>> from data_synth.dynamics import Body, Support, build_system, campbell
    >>> gear = Body(name="gear", mass_kg=2.0, motions=("x",))
    >>> hold = Support(between=("gear", None), x=2e6, damping_s=4e-5)  # zeta = damping_s omega / 2
    >>> diagram = campbell(lambda _: build_system([gear], [hold]), speeds_rad_s=[0.0, 100.0])
    >>> round(float(diagram.damping_ratios[0, 0]), 6)
    0.02
    """

    speeds_rad_s: Array = field(metadata={"dims": ("speed",), "units": "rad/s"})
    frequencies_hz: Array = field(metadata={"dims": ("speed", "mode"), "units": "Hz"})
    damping_ratios: Array = field(metadata={"dims": ("speed", "mode"), "units": "1"})
    orders: tuple[float, ...]

    def critical_speeds(self, order: float) -> Array:
        """Return the critical speeds of an order, at which ``order x speed`` equals a natural frequency.

        Parameters
        ----------
        order : float
            Cycles of the excitation per revolution of the reference.

        Returns
        -------
        (n,) array
            Speeds of the reference in rad/s, ascending, interpolated linearly between `speeds_rad_s`.

        Examples
        --------
        An excitation of order 20 coincides with a natural frequency of 1000 rad/s at 50 rad/s:

        >>> import numpy as np
        >>> from data_synth.dynamics import Body, Support, build_system, campbell
        >>> gear = Body(name="gear", mass_kg=2.0, motions=("x",))
        >>> system = build_system([gear], [Support(between=("gear", None), x=2e6)])
        >>> diagram = campbell(lambda _: system, speeds_rad_s=[0.0, 200.0])
        >>> np.round(diagram.critical_speeds(20), 6).tolist()
        [50.0]
        """
        above = self.frequencies_hz - order * self.speeds_rad_s[:, None] / (2 * np.pi)
        before, mode = np.nonzero((above[:-1] > 0) != (above[1:] > 0))
        share = above[before, mode] / (above[before, mode] - above[before + 1, mode])
        crossings = self.speeds_rad_s[before] + share * np.diff(self.speeds_rad_s)[before]
        moving = np.maximum(self.frequencies_hz[:-1], self.frequencies_hz[1:])[before, mode] > 0
        return np.sort(crossings[moving])


def campbell(system_at: Callable[[float], System], *, speeds_rad_s: Sequence[float] | Array) -> Campbell:
    """Return natural frequencies and damping ratios over speed, with every mesh in contact at its mean stiffness.

    Parameters
    ----------
    system_at : callable
        Takes the speed of the reference in rad/s; returns the system assembled for it, with its gyroscopic terms.
    speeds_rad_s : (speed,) sequence of float
        Speeds of the reference in rad/s, ascending.

    Returns
    -------
    Campbell

    Examples
    --------
    The tilting mode of a disc on an isotropic bearing splits into backward and forward whirl, whose frequencies satisfy
    ``s^2 -+ (J Omega / I) s - k / I = 0``; a thin disc has J = 2 I:

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, Support, build_system, campbell
    >>> hold = Support(between=("disc", None), tilt_x=1e4, tilt_y=1e4)
    >>> disc = Body(
    ...     name="disc", inertia_kgm2=0.02, tilt_inertia_kgm2=0.01, motions=("tilt x", "tilt y"), speed_ratio=1.0
    ... )
    >>> diagram = campbell(lambda speed: build_system([disc], [hold], speed_rad_s=speed), speeds_rad_s=[0.0, 750.0])
    >>> np.round(2 * np.pi * diagram.frequencies_hz, 6).tolist()  # 1000 rad/s at rest
    [[1000.0, 1000.0], [500.0, 2000.0]]
    """
    speeds = np.asarray(speeds_rad_s, dtype=np.float64)
    systems = [system_at(speed) for speed in speeds.tolist()]
    pairs = [_frequencies_and_ratios(eigenvalues(system)) for system in systems]
    return Campbell(
        speeds_rad_s=speeds,
        frequencies_hz=np.array([frequencies for frequencies, _ in pairs]),
        damping_ratios=np.array([ratios for _, ratios in pairs]),
        orders=tuple(dict.fromkeys(mesh.cycles_per_rev for mesh in systems[-1].meshes)),
    )


def eigenvalues(system: System) -> ComplexArray:
    """Return all eigenvalues of ``M s^2 + (C + G) s + K``, with meshes at their mean stiffness.

    Without damping and gyroscopic terms they are ``+- j omega`` of the undamped modes, each to high relative accuracy;
    otherwise they are those of the state matrix, accurate relative to the largest.

    Parameters
    ----------
    system : System

    Returns
    -------
    (2 dof,) complex array
        In rad/s.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Body, Support, build_system, eigenvalues
    >>> gear = Body(name="gear", mass_kg=1.0, motions=("x",))
    >>> values = eigenvalues(build_system([gear], [Support(between=("gear", None), x=25.0, damping_s=0.24)]))
    >>> np.round(np.sort_complex(values), 6).tolist()  # s^2 + 6 s + 25 = 0
    [(-3-4j), (-3+4j)]
    """
    velocity = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    if not velocity.any() and system.springs:
        angular, _ = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
        return np.concatenate([1j * angular, -1j * angular])
    inverse = np.linalg.inv(np.linalg.cholesky(system.mass))
    stiffness = inverse @ system.mean_stiffness() @ inverse.T
    scale = float(np.sqrt(np.abs(stiffness).max())) or 1.0
    size = system.dof
    rates = np.zeros((2 * size, 2 * size))
    rates[:size, size:] = np.eye(size) * scale
    rates[size:, :size] = -stiffness / scale
    rates[size:, size:] = -inverse @ velocity @ inverse.T
    return np.asarray(np.linalg.eigvals(rates), dtype=np.complex128)


def _frequencies_and_ratios(values: ComplexArray) -> tuple[Array, Array]:
    """Return damped natural frequencies in Hz and damping ratios, one per conjugate pair of eigenvalues."""
    size = np.abs(values)
    oscillating = (np.abs(values.imag) > _OVERDAMPED * size) & (size > _RIGID_SHARE * size.max())
    upper = values[oscillating & (values.imag > 0)]
    upper = upper[np.argsort(upper.imag, kind="stable")]
    rest = values.size // 2 - upper.size
    frequencies = np.concatenate([np.zeros(rest), upper.imag / (2 * np.pi)])
    return frequencies, np.concatenate([np.full(rest, np.nan), -upper.real / np.abs(upper)])
