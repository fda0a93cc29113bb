"""Parametric stability of a gearbox with varying mesh stiffness: Floquet multipliers at constant speed.

Over one common period of all meshes the state becomes ``z(T) = P z(0)``; the motion is unbounded if an eigenvalue of
the monodromy matrix P, a Floquet multiplier, lies outside the unit circle. P is a product of matrix exponentials, of
fourth order in the step (the commutator-free method of Blanes and Moan 2006, Appl. Numer. Math. 56) and exact where the
stiffness is constant, refined to convergence.

The state consists of the modal displacements at mean stiffness and the modal velocities over their frequency, so that
all modes have the same scale, however stiff. Rigid-body modes are left out, because their double multiplier of 1 would
be accurate to half the digits only.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial

import numpy as np

from data_synth.dynamics.modes import undamped_modes
from data_synth.dynamics.system import Array, System
from data_synth.gears.mesh_stiffness import ComplexArray

# ---- Matrix exponentials and products of stacks of small matrices, vectorised over the stack -------------------------


_TERMS = 14  # of a series for matrices of norm 1/2: 0.5^15 / 15! is below rounding


def exponentials(matrices: Array) -> Array:
    """Return the exponentials of a stack of matrices (n, m, m) by a Taylor series with scaling and squaring."""
    halvings = max(0, math.ceil(math.log2(2 * float(np.abs(matrices).sum(axis=2).max()) or 1.0)))
    small = matrices / 2**halvings
    total = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape)
    for order in range(_TERMS, 0, -1):
        total = np.eye(matrices.shape[1]) + small @ total / order
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)


def chained(steps: Array) -> Array:
    """Return the product (m, m) of a stack of matrices (n, m, m), the last one leftmost, pair by pair."""
    while len(steps) > 1:
        paired = steps[1::2] @ steps[: len(steps) // 2 * 2 : 2]
        steps = np.concatenate([paired, steps[-1:]]) if len(steps) % 2 else paired
    return np.asarray(steps[0])


# ---- Stability -------------------------------------------------------------------------------------------------------


_MAX_DENOMINATOR = 100_000
_RATIO_TOLERANCE = 1e-12
_GAUSS = math.sqrt(3) / 6  # of a step: distance of the two Gauss-Legendre nodes from its middle
_MIN_STEPS, _MAX_STEPS = 32, 8192  # per period
_CONVERGED = 1e-9  # change between two refinements, relative to the largest entry of P
_ROUNDING = 1e-6  # growth over a period that rounding can cause


@dataclass(frozen=True, kw_only=True)
class Multipliers:
    """Floquet multipliers at one speed.

    Attributes
    ----------
    period_s : float
        Time in s after which all meshes repeat.
    multipliers : (2 mode,) complex array
        Eigenvalues of the monodromy matrix, largest magnitude first, without those of rigid-body modes.
    monodromy : (2 mode, 2 mode) array
        P for modal displacements, then modal velocities over their frequency, at mean stiffness.

    Examples
    --------
    With damping the product of the multipliers is ``exp(-trace(M^-1 C) T)`` (Liouville's formula):

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, GeneralMesh, Rectangular, build_system, floquet
    >>> mass = Body(name="mass", mass_kg=1.0, motions=("x",))
    >>> k = Rectangular(low=0.7, high=1.3, duty=0.5)
    >>> mesh = GeneralMesh(name="mesh", motions={("mass", "x"): 1.0}, stiffness=k, damping=0.04)
    >>> found = floquet(build_system([mass], [mesh]), speed_rad_s=2.0)
    >>> bool(np.isclose(np.prod(found.multipliers), np.exp(-0.04 * found.period_s)))
    True
    """

    period_s: float
    multipliers: ComplexArray = field(metadata={"dims": ("state",), "units": "1"})
    monodromy: Array = field(metadata={"dims": ("state", "state"), "units": "1"})

    @property
    def largest(self) -> float:
        """Magnitude of the largest multiplier; above 1, the factor by which the motion grows per period."""
        return float(np.abs(self.multipliers[0]))


@dataclass(frozen=True, kw_only=True)
class StabilityMap:
    """Magnitude of the largest Floquet multiplier as a function of speed and a parameter.

    Attributes
    ----------
    speeds_rad_s : (speed,) array
        Speed of the reference shaft in rad/s.
    parameters : (parameter,) array
        Values of the parameter, in its own unit.
    growth : (parameter, speed) array
        Magnitude of the largest multiplier: growth of the motion per period.

    Examples
    --------
    An undamped oscillator of 1 rad/s is unstable if its stiffness varies at twice its natural frequency:

    >>> from data_synth.dynamics import Body, Fourier, GeneralMesh, build_system, stability_map
    >>> mass = Body(name="mass", mass_kg=1.0, motions=("x",))
    >>> def system_of(h):
    ...     mesh = GeneralMesh(name="mesh", motions={("mass", "x"): 1.0}, stiffness=Fourier(mean=1.0, harmonics=[h]))
    ...     return build_system([mass], [mesh])
    >>> found = stability_map(system_of, parameters=[0.1], speeds_rad_s=[1.5, 2.0])
    >>> found.unstable.tolist(), found.growth.shape
    ([[False, True]], (1, 2))
    """

    speeds_rad_s: Array = field(metadata={"dims": ("speed",), "units": "rad/s"})
    parameters: Array = field(metadata={"dims": ("parameter",), "units": ""})
    growth: Array = field(metadata={"dims": ("parameter", "speed"), "units": "1"})

    @property
    def unstable(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Whether the motion grows by more than rounding can cause, (parameter, speed)."""
        return np.asarray(self.growth > 1 + _ROUNDING)


@dataclass(frozen=True, kw_only=True)
class Tongue:
    """An instability tongue: a range of speeds in which the motion grows.

    Attributes
    ----------
    low_rad_s, high_rad_s : float
        Ends of the range, speeds of the reference shaft in rad/s.
    growth : float
        Largest magnitude of a multiplier among the speeds of the search.

    Examples
    --------
    The first tongue of ``x'' + (1 + h cos(W t)) x = 0`` is close to ``2 - h / 2 < W < 2 + h / 2``:

    >>> from data_synth.dynamics import Body, Fourier, GeneralMesh, build_system, instability_tongues
    >>> mass, k = Body(name="mass", mass_kg=1.0, motions=("x",)), Fourier(mean=1.0, harmonics=[0.1])
    >>> mesh = GeneralMesh(name="mesh", motions={("mass", "x"): 1.0}, stiffness=k)
    >>> (tongue,) = instability_tongues(build_system([mass], [mesh]), speeds_rad_s=[1.5, 2.0, 2.5])
    >>> round(tongue.low_rad_s, 2), round(tongue.high_rad_s, 2), tongue.growth > 1
    (1.95, 2.05, True)
    """

    low_rad_s: float
    high_rad_s: float
    growth: float


def floquet(system: System, *, speed_rad_s: float) -> Multipliers:
    """Return the Floquet multipliers and the monodromy matrix of a system at constant speed.

    Teeth are assumed to stay in contact; friction between them is included. Transmission errors and forces do not
    affect the stability of this linear system.

    Parameters
    ----------
    system : System
        Equations of motion with at least one mesh.
    speed_rad_s : float
        Speed of the reference shaft in rad/s; a mesh passes through ``cycles_per_rev`` cycles per revolution of it.

    Returns
    -------
    Multipliers

    Raises
    ------
    ValueError
        If the speed is not positive, the system has no mesh, or the meshes have no common period.
    ArithmeticError
        If the monodromy matrix has not converged with 8192 steps per period.

    Examples
    --------
    Meissner's equation, with a stiffness of a^2 for half of a period of pi and b^2 for the other half, has a monodromy
    matrix with the trace ``2 cos(pi a/2) cos(pi b/2) - (a/b + b/a) sin(pi a/2) sin(pi b/2)``; below -2 the motion is
    unstable:

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, GeneralMesh, Rectangular, build_system, floquet
    >>> mass = Body(name="mass", mass_kg=1.0, motions=("x",))
    >>> k = Rectangular(low=0.7, high=1.3, duty=0.5)
    >>> mesh = GeneralMesh(name="mesh", motions={("mass", "x"): 1.0}, stiffness=k)
    >>> found = floquet(build_system([mass], [mesh]), speed_rad_s=2.0)
    >>> round(float(np.trace(found.monodromy)), 6), found.largest > 1
    (-2.089829, True)
    """
    if not (math.isfinite(speed_rad_s) and speed_rad_s > 0):
        raise ValueError(f"speed_rad_s = {speed_rad_s!r} must be a finite number above 0.")
    return _Periodic(system).multipliers(speed_rad_s)


def stability_map(
    system_of: Callable[[float], System], *, parameters: Sequence[float] | Array, speeds_rad_s: Sequence[float] | Array
) -> StabilityMap:
    """Return the magnitude of the largest Floquet multiplier over speed for every value of a parameter.

    Parameters
    ----------
    system_of : callable
        Takes a value of the parameter (damping ratio, contact ratio, load, etc.); returns a system.
    parameters : (parameter,) sequence of float
        Values of the parameter.
    speeds_rad_s : (speed,) sequence of float
        Speeds of the reference shaft in rad/s.

    Returns
    -------
    StabilityMap

    Raises
    ------
    ValueError, ArithmeticError
        As `floquet` does.

    Examples
    --------
    An oscillator of 1 rad/s whose stiffness varies by a fraction h at twice its natural frequency is unstable if the
    damping ratio is below about h / 4:

    >>> from data_synth.dynamics import Body, Fourier, GeneralMesh, build_system, stability_map
    >>> mass = Body(name="mass", mass_kg=1.0, motions=("x",))
    >>> def system_of(ratio):
    ...     k = Fourier(mean=1.0, harmonics=[0.1])
    ...     mesh = GeneralMesh(name="mesh", motions={("mass", "x"): 1.0}, stiffness=k, damping=2 * ratio)
    ...     return build_system([mass], [mesh])
    >>> stability_map(system_of, parameters=[0.024, 0.026], speeds_rad_s=[1.5, 2.0]).unstable.tolist()
    [[False, True], [False, False]]
    """
    speeds = np.asarray(speeds_rad_s, dtype=np.float64)
    periodic = (_Periodic(system_of(value)) for value in parameters)
    growth = [[one.multipliers(speed).largest for speed in speeds.tolist()] for one in periodic]
    return StabilityMap(
        speeds_rad_s=speeds, parameters=np.asarray(parameters, dtype=np.float64), growth=np.array(growth)
    )


def instability_tongues(system: System, *, speeds_rad_s: Sequence[float] | Array) -> tuple[Tongue, ...]:
    """Return the ranges of speed in which the motion is unstable, with ends found by bisection to 1e-10 of the speed.

    A tongue that lies between two neighbouring `speeds_rad_s` is missed. Tongues lie near mesh frequencies equal to
    twice a natural frequency, or the sum of two, divided by an integer.

    Parameters
    ----------
    system : System
        Equations of motion with at least one mesh.
    speeds_rad_s : (speed,) sequence of float
        Speeds of the reference shaft in rad/s of the initial search, ascending.

    Returns
    -------
    tuple of Tongue
        In ascending order of speed.

    Raises
    ------
    ValueError, ArithmeticError
        As `floquet` does.

    Examples
    --------
    ``x'' + (1 + h cos(W t)) x = 0`` is Mathieu's equation, a = 4 / W^2 and q = 2 h / W^2; its first tongue lies between
    the characteristic values b1(q) and a1(q):

    >>> from scipy.special import mathieu_a, mathieu_b
    >>> from data_synth.dynamics import Body, Fourier, GeneralMesh, build_system, instability_tongues
    >>> mass, k = Body(name="mass", mass_kg=1.0, motions=("x",)), Fourier(mean=1.0, harmonics=[0.4])
    >>> mesh = GeneralMesh(name="mesh", motions={("mass", "x"): 1.0}, stiffness=k)
    >>> (tongue,) = instability_tongues(build_system([mass], [mesh]), speeds_rad_s=[1.5, 2.0, 2.5])
    >>> f"{4 / tongue.low_rad_s**2:.5f} {mathieu_a(1, 0.8 / tongue.low_rad_s**2):.5f}"
    '1.24009 1.24009'
    >>> f"{4 / tongue.high_rad_s**2:.5f} {mathieu_b(1, 0.8 / tongue.high_rad_s**2):.5f}"
    '0.83052 0.83052'
    """
    from scipy.optimize import bisect  # noqa: PLC0415 - rarely needed

    speeds, periodic = [float(speed) for speed in speeds_rad_s], _Periodic(system)
    growth = [periodic.multipliers(speed).largest for speed in speeds]
    grows = [value > 1 + _ROUNDING for value in growth]

    def excess(speed: float) -> float:
        return periodic.multipliers(speed).largest - 1 - _ROUNDING

    edge = partial(bisect, excess, rtol=1e-10)

    tongues, start = [], 0
    for number in range(1, len(speeds) + 1):
        if number < len(speeds) and grows[number] == grows[start]:
            continue
        if grows[start]:
            low = edge(speeds[start - 1], speeds[start]) if start else speeds[0]
            high = edge(speeds[number - 1], speeds[number]) if number < len(speeds) else speeds[-1]
            tongues.append(Tongue(low_rad_s=low, high_rad_s=high, growth=max(growth[start:number])))
        start = number
    return tuple(tongues)


class _Periodic:
    """A system in modal coordinates at mean stiffness, and the variation of its meshes over one period."""

    def __init__(self, system: System) -> None:
        if not system.meshes:
            raise ValueError("the system has no mesh, so its stiffness does not vary; use solve_modes.")
        self.system = system
        angular, shapes = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
        kept = angular > 0
        velocity = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
        free = shapes[:, ~kept]
        if np.abs(free.T @ velocity).max(initial=0.0) + np.abs(velocity @ free).max(initial=0.0) > 0:
            kept = np.ones_like(kept)  # damping of a rigid-body motion couples it to the other modes
        self.shapes, self.velocity = shapes[:, kept], shapes[:, kept].T @ velocity @ shapes[:, kept]
        self.angular = angular[kept]
        self.scale = np.where(self.angular > 0, self.angular, self.angular[self.angular > 0].min(initial=1.0))
        self.revolutions = _revolutions(system)
        self.breaks = self._breaks()

    def _breaks(self) -> Array:
        """Return the angles of the reference in rev, from 0 to the end of the period, at which a stiffness jumps."""
        found = {0.0, float(self.revolutions)}
        for mesh in self.system.meshes:
            corners = (*mesh.stiffness.jumps, *getattr(mesh.stiffness, "corners", ()))
            friction = {jump for force in mesh.friction for jump in force.factor.jumps}
            corners += tuple(jump + cycle for cycle in range(mesh.stiffness.period) for jump in friction)
            period = mesh.stiffness.period / mesh.cycles_per_rev
            for repeat in range(round(float(self.revolutions) / period)):
                found |= {corner / mesh.cycles_per_rev + repeat * period for corner in corners}
        points = np.array(sorted(found))
        return np.asarray(points[np.concatenate([[True], np.diff(points) > _RATIO_TOLERANCE * points[-1]])])

    def multipliers(self, speed: float) -> Multipliers:
        """Return the multipliers at a speed in rad/s."""
        period_s = 2 * math.pi / speed  # of the reference shaft
        product = self._refined(period_s)
        values = np.asarray(np.linalg.eigvals(product), dtype=np.complex128)
        return Multipliers(
            period_s=float(self.revolutions) * period_s,
            multipliers=values[np.argsort(-np.abs(values), kind="stable")],
            monodromy=product,
        )

    def _refined(self, period_s: float) -> Array:
        """Return the monodromy matrix, with steps halved until it converges."""
        steps, before = _MIN_STEPS, None
        while steps <= _MAX_STEPS:
            product = self._product(period_s, steps)
            if before is not None and np.abs(product - before).max() < _CONVERGED * max(1.0, np.abs(product).max()):
                return product
            steps, before = 2 * steps, product
        raise ArithmeticError(
            f"the monodromy matrix has not converged to {_CONVERGED:g} with {_MAX_STEPS} steps per period; check that "
            "the `jumps` of every stiffness are complete."
        )

    def _product(self, period_s: float, steps: int) -> Array:
        """Return the product of matrix exponentials of `steps` per period, at least one per interval."""
        product, near, far = np.eye(2 * self.angular.size), 0.25 + _GAUSS, 0.25 - _GAUSS
        for start, stop in zip(self.breaks[:-1].tolist(), self.breaks[1:].tolist(), strict=True):
            count = max(1, math.ceil(steps * (stop - start) / float(self.revolutions)))
            length = (stop - start) / count
            middles = start + (np.arange(count) + 0.5) * length
            early, late = (self._rates(middles + sign * _GAUSS * length) for sign in (-1, 1))
            halves = np.stack([near * early + far * late, far * early + near * late], axis=1)
            product = chained(exponentials(length * period_s * halves.reshape(-1, *product.shape))) @ product
        return np.asarray(product)

    def _rates(self, revolutions: Array) -> Array:
        """Return A of ``z' = A z`` at angles of the reference in rev, (angle, 2 mode, 2 mode)."""
        size = self.angular.size
        rates = np.zeros((revolutions.size, 2 * size, 2 * size))
        rates[:, :size, size:] = np.diag(self.scale)
        rates[:, size:, :size] = -np.diag(self.angular**2 / self.scale)
        rates[:, size:, size:] = -self.velocity * self.scale / self.scale[:, None]
        for mesh in self.system.meshes:
            modal, phase = self.shapes.T @ mesh.direction, mesh.cycles_per_rev * revolutions
            stiffness = mesh.stiffness(phase)
            varying = stiffness - mesh.stiffness.mean
            rates[:, size:, :size] -= varying[:, None, None] * np.outer(modal / self.scale, modal)
            for force in mesh.friction:
                across = self.shapes.T @ force.direction / self.scale
                rates[:, size:, :size] += (stiffness * force.factor(phase))[:, None, None] * np.outer(across, modal)
        return rates


def _revolutions(system: System) -> Fraction:
    """Return the least common multiple of all mesh periods in revolutions of the reference."""
    total = Fraction(0)
    for mesh in system.meshes:
        ratio = Fraction(mesh.cycles_per_rev).limit_denominator(_MAX_DENOMINATOR)
        if ratio <= 0 or abs(float(ratio) / mesh.cycles_per_rev - 1) > _RATIO_TOLERANCE:
            raise ValueError(
                f'mesh "{mesh.name}": cycles_per_rev = {mesh.cycles_per_rev!r} is not a ratio of whole numbers below '
                f"{_MAX_DENOMINATOR}, so the meshes have no common period; compute it from numbers of teeth."
            )
        own = mesh.stiffness.period / ratio
        numerator = math.lcm(total.numerator * own.denominator, own.numerator * total.denominator)
        total = Fraction(numerator, total.denominator * own.denominator) if total else own
    return total
