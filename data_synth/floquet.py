"""Stability of a gearbox under its own mesh stiffness: Floquet's multipliers at constant speed.

Over one period of all meshes the state returns as ``z(T) = P z(0)``; the motion is unbounded where an eigenvalue of P,
a multiplier, lies outside of the unit circle. Where every stiffness is constant between its jumps and nothing damps
or turns the motion, P is a product of exact transitions: in the modes of each stretch, cosines and sines. Otherwise a
product of exponentials, exact again between jumps, else of fourth order in their length (the commutator-free method
of Blanes and Moan 2006, Appl. Numer. Math. 56) and refined until it rests.

The state is taken in the modes of mean stiffness, velocities over their frequency: motions that strain nothing are left
out, as their double multiplier of 1 would be found to half the digits only, and all others count alike, however stiff.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from data_synth._exponentials import chained, exponentials
from data_synth.mechanics import Array, System
from data_synth.mesh import ComplexArray
from data_synth.modal import mode_pairs

_DENOMINATOR = 100_000
_RATIO = 1e-12
_SIXTH = math.sqrt(3) / 6
_FEW, _MOST = 32, 8192  # steps a period at first, and at last
_STILL = 1e-9  # of the largest entry of P, between two refinements
_TAME = 1e-6  # growth a period that rounding explains


@dataclass(frozen=True, kw_only=True)
class Multipliers:
    """Floquet multipliers at one speed.

    Attributes
    ----------
    period_s : float
        After which all meshes repeat.
    multipliers : (2 mode,) complex array
        Largest first; motions that strain nothing are left out.
    monodromy : (2 mode, 2 mode) array
        P, displacements before velocities, in the modes of mean stiffness.
    """

    period_s: float
    multipliers: ComplexArray = field(metadata={"dims": ("state",), "units": "1"})
    monodromy: Array = field(metadata={"dims": ("state", "state"), "units": "1"})

    @property
    def largest(self) -> float:
        """Magnitude of the largest multiplier: above 1 the motion grows by this factor a period."""
        return float(np.abs(self.multipliers[0]))


@dataclass(frozen=True, kw_only=True)
class StabilityMap:
    """Largest multiplier over speed, and over a parameter.

    Attributes
    ----------
    speeds_rad_s : (speed,) array
        Of the reference.
    parameters : (parameter,) array
    growth : (parameter, speed) array
        Magnitude of the largest multiplier a period.
    """

    speeds_rad_s: Array = field(metadata={"dims": ("speed",), "units": "rad/s"})
    parameters: Array = field(metadata={"dims": ("parameter",), "units": ""})
    growth: Array = field(metadata={"dims": ("parameter", "speed"), "units": "1"})

    @property
    def unstable(self) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
        """Where the motion grows by more than rounding explains, (parameter, speed)."""
        return np.asarray(self.growth > 1 + _TAME)


@dataclass(frozen=True, kw_only=True)
class Tongue:
    """An interval of speeds of the reference, rad/s, in which motion grows; `growth` is the most that was met."""

    low_rad_s: float
    high_rad_s: float
    growth: float


def floquet(system: System, *, speed_rad_s: float) -> Multipliers:
    """Return the Floquet multipliers of a system at constant speed.

    Meshes are linear, as if closed by load, and what rubs in them counts; transmission errors and forces do not matter.

    Parameters
    ----------
    system : System
    speed_rad_s : float
        Of the reference; a mesh turns through ``cycles_per_rev`` cycles in each of its revolutions.

    Raises
    ------
    ValueError
        A speed that is not positive, no mesh, or meshes that never repeat together.
    ArithmeticError
        A monodromy matrix that 8192 steps a period have not settled.
    """
    if not (math.isfinite(speed_rad_s) and speed_rad_s > 0):
        raise ValueError(f"speed_rad_s = {speed_rad_s!r} has to be a finite number above 0.")
    return _Periodic(system).multipliers(speed_rad_s)


def stability_map(
    system_of: Callable[[float], System], *, parameters: Sequence[float] | Array, speeds_rad_s: Sequence[float] | Array
) -> StabilityMap:
    """Return the largest multiplier over speeds, for every value of a parameter.

    Parameters
    ----------
    system_of : callable
        From a parameter (damping ratio, contact ratio, load, ...) to a system.
    parameters, speeds_rad_s : sequence of float
    """
    speeds = np.asarray(speeds_rad_s, dtype=np.float64)
    periodic = (_Periodic(system_of(value)) for value in parameters)
    growth = [[one.multipliers(speed).largest for speed in speeds.tolist()] for one in periodic]
    return StabilityMap(
        speeds_rad_s=speeds, parameters=np.asarray(parameters, dtype=np.float64), growth=np.array(growth)
    )


def instability_tongues(system: System, *, speeds_rad_s: Sequence[float] | Array) -> tuple[Tongue, ...]:
    """Return the intervals of speed in which motion grows, their ends bisected to 1e-10 of the speed.

    A tongue that lies between two of `speeds_rad_s` is not seen. Principal ones stand where the mesh frequency is twice
    a natural frequency, or the sum of two, over a whole number.

    Parameters
    ----------
    system : System
    speeds_rad_s : sequence of float
        Rising; where to look.
    """
    speeds, periodic = [float(speed) for speed in speeds_rad_s], _Periodic(system)
    growth = [periodic.multipliers(speed).largest for speed in speeds]
    grows = [value > 1 + _TAME for value in growth]

    def edge(stable: float, unstable: float) -> float:
        while abs(unstable - stable) > 1e-10 * unstable:
            middle = (stable + unstable) / 2
            inside = periodic.multipliers(middle).largest > 1 + _TAME
            stable, unstable = (stable, middle) if inside else (middle, unstable)
        return unstable

    tongues, start = [], 0
    for number in range(1, len(speeds) + 1):
        if number < len(speeds) and grows[number] == grows[start]:
            continue
        if grows[start]:
            low = edge(speeds[start - 1], speeds[start]) if start else speeds[0]
            high = edge(speeds[number], speeds[number - 1]) if number < len(speeds) else speeds[-1]
            tongues.append(Tongue(low_rad_s=low, high_rad_s=high, growth=max(growth[start:number])))
        start = number
    return tuple(tongues)


class _Periodic:
    """A system in the modes of its mean stiffness, and how its meshes change over one period."""

    def __init__(self, system: System) -> None:
        if not system.meshes:
            raise ValueError("the system has no mesh, so nothing changes with phase; use solve_modes.")
        self.system = system
        angular, shapes = mode_pairs(system, [mesh.stiffness.mean for mesh in system.meshes])
        kept = angular > 0
        velocity = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
        free = shapes[:, ~kept]
        if np.abs(free.T @ velocity).max(initial=0.0) + np.abs(velocity @ free).max(initial=0.0) > 0:
            kept = np.ones_like(kept)  # a damper that a rigid motion meets couples it to the others
        self.shapes, self.velocity = shapes[:, kept], shapes[:, kept].T @ velocity @ shapes[:, kept]
        self.angular = angular[kept]
        self.scale = np.where(self.angular > 0, self.angular, self.angular[self.angular > 0].min(initial=1.0))
        self.turns = _turns(system)
        self.exact = all(mesh.stiffness.constant_between_jumps and not mesh.friction for mesh in system.meshes)
        self.breaks = self._breaks()
        self.free_vibration = self.exact and not self.velocity.any() and bool(np.all(self.angular > 0))
        self.pieces = [self._modes_at(part) for part in self._middles()] if self.free_vibration else []

    def _breaks(self) -> Array:
        """Return the turns of the reference, from 0 to the end of the period, between which nothing jumps."""
        found = {0.0, float(self.turns)}
        for mesh in self.system.meshes:
            corners = (*mesh.stiffness.jumps, *getattr(mesh.stiffness, "corners", ()))
            rubs = {jump for rub in mesh.friction for jump in rub.share.jumps}
            corners += tuple(jump + cycle for cycle in range(mesh.stiffness.period) for jump in rubs)
            period = mesh.stiffness.period / mesh.cycles_per_rev
            for repeat in range(round(float(self.turns) / period)):
                found |= {corner / mesh.cycles_per_rev + repeat * period for corner in corners}
        points = np.array(sorted(found))
        return np.asarray(points[np.concatenate([[True], np.diff(points) > _RATIO * points[-1]])])

    def _middles(self) -> Array:
        return np.asarray((self.breaks[1:] + self.breaks[:-1]) / 2)

    def _constants(self, turns: float) -> list[float]:
        return [float(mesh.stiffness(mesh.cycles_per_rev * turns)) for mesh in self.system.meshes]

    def _modes_at(self, turns: float) -> tuple[Array, Array]:
        """Return frequencies and shapes of one stretch, in the modes of mean stiffness."""
        angular, shapes = mode_pairs(self.system, self._constants(turns))
        return angular, np.asarray(self.shapes.T @ self.system.mass @ shapes)

    def multipliers(self, speed: float) -> Multipliers:
        """Return the multipliers at a speed in rad/s."""
        second = 2 * math.pi / speed  # a turn of the reference
        if self.free_vibration:
            product = self._exact(second)
        elif self.exact:
            product = self._product(second, 0)
        else:
            product = self._refined(second)
        values = np.asarray(np.linalg.eigvals(product), dtype=np.complex128)
        return Multipliers(
            period_s=float(self.turns) * second,
            multipliers=values[np.argsort(-np.abs(values), kind="stable")],
            monodromy=product,
        )

    def _exact(self, second: float) -> Array:
        size = self.angular.size
        product, down = np.eye(2 * size), self.scale[:, None]
        for (angular, turn), stretch in zip(self.pieces, np.diff(self.breaks) * second, strict=True):
            cosine = (turn * np.cos(angular * stretch)) @ turn.T
            sine = (turn * (stretch * np.sinc(angular * stretch / np.pi))) @ turn.T
            pull = (turn * (-angular * np.sin(angular * stretch))) @ turn.T
            step = np.block([[cosine, sine * self.scale], [pull / down, cosine * self.scale / down]])
            product = step @ product
        return product

    def _refined(self, second: float) -> Array:
        steps, before = _FEW, None
        while steps <= _MOST:
            product = self._product(second, steps)
            if before is not None and np.abs(product - before).max() < _STILL * max(1.0, np.abs(product).max()):
                return product
            steps, before = 2 * steps, product
        raise ArithmeticError(
            f"{_MOST} steps a period have not settled the monodromy matrix to {_STILL:g}; see whether a stiffness "
            "jumps without saying so in `jumps`."
        )

    def _product(self, second: float, steps: int) -> Array:
        """Return the product of exponentials; `steps` a period, or one each stretch where that is exact."""
        rates, product = self._mean_rate() / 2, np.eye(2 * self.angular.size)
        first, other = 0.25 + _SIXTH, 0.25 - _SIXTH
        for start, stop in zip(self.breaks[:-1].tolist(), self.breaks[1:].tolist(), strict=True):
            count = max(1, math.ceil(steps * (stop - start) / float(self.turns)))
            length = (stop - start) / count
            middles = start + (np.arange(count) + 0.5) * length
            early, late = (self._departures(middles + sign * _SIXTH * length) for sign in (-1, 1))
            halves = np.stack([rates + first * early + other * late, rates + other * early + first * late], axis=1)
            product = chained(exponentials(length * second * halves.reshape(-1, *rates.shape))) @ product
        return np.asarray(product)

    def _mean_rate(self) -> Array:
        """Return A of ``z' = A z`` at mean stiffness."""
        size = self.angular.size
        rates = np.zeros((2 * size, 2 * size))
        rates[:size, size:] = np.diag(self.scale)
        rates[size:, :size] = -np.diag(self.angular**2 / self.scale)
        rates[size:, size:] = -self.velocity * self.scale / self.scale[:, None]
        return rates

    def _departures(self, turns: Array) -> Array:
        """Return what the meshes add to A where they are off their means, (turn, 2 mode, 2 mode)."""
        size = self.angular.size
        change = np.zeros((turns.size, 2 * size, 2 * size))
        for mesh in self.system.meshes:
            reach, phase = self.shapes.T @ mesh.direction, mesh.cycles_per_rev * turns
            stiffness = mesh.stiffness(phase)
            off = stiffness - mesh.stiffness.mean
            change[:, size:, :size] -= off[:, None, None] * np.outer(reach / self.scale, reach)
            for rub in mesh.friction:
                pull = self.shapes.T @ rub.direction / self.scale
                change[:, size:, :size] += (stiffness * rub.share(phase))[:, None, None] * np.outer(pull, reach)
        return change


def _turns(system: System) -> Fraction:
    """Return the turns of the reference after which every mesh repeats."""
    turns = Fraction(0)
    for mesh in system.meshes:
        ratio = Fraction(mesh.cycles_per_rev).limit_denominator(_DENOMINATOR)
        if ratio <= 0 or abs(float(ratio) / mesh.cycles_per_rev - 1) > _RATIO:
            raise ValueError(
                f'mesh "{mesh.name}": cycles_per_rev = {mesh.cycles_per_rev!r} is no ratio of whole numbers below '
                f"{_DENOMINATOR}, so the meshes have no common period; give it as teeth define it."
            )
        own = mesh.stiffness.period / ratio
        turns = own if not turns else _common(turns, own)
    return turns


def _common(one: Fraction, other: Fraction) -> Fraction:
    """Return the least common multiple of two fractions."""
    numerator = math.lcm(one.numerator * other.denominator, other.numerator * one.denominator)
    return Fraction(numerator, one.denominator * other.denominator)
