"""Methods that the project does not ship, in plain loops over one gear pair: peers for the page on integrators.

The pair is that of the tests: x1, theta1, x2, theta2 with diagonal masses, dampers and bearings, one mesh along `g`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np
from gear_pair import DIRECTION, MASSES, TORQUE_NM
from numpy.typing import NDArray
from scipy.integrate import DOP853

Array = NDArray[np.float64]

BEARINGS = np.array([1e8, 0.0, 1e8, 0.0])
TORQUES = np.array([0.0, TORQUE_NM, 0.0, 0.0])


@dataclass(frozen=True)
class Explicit:
    """Butcher's tableau of an explicit method."""

    matrix: Array
    weights: Array
    nodes: Array


RK4 = Explicit(np.diag([0.5, 0.5, 1.0], -1), np.array([1.0, 2.0, 2.0, 1.0]) / 6, np.array([0.0, 0.5, 0.5, 1.0]))
DORMAND_PRINCE_8 = Explicit(np.array(DOP853.A), np.array(DOP853.B), np.array(DOP853.C))


@dataclass(frozen=True)
class Pair:
    """The equations: a compiled stiffness over time, what damps (4,), a quadratic load on the gear, half the gap."""

    stiffness: Callable[[float], float]
    damping: Array
    drag: float = 0.0
    half_gap_m: float = 0.0

    @property
    def system(self) -> tuple[Array, Array, Array, Array]:
        """Matrix (8, 8), drive (8,), what a mesh force takes (8,), and the row (8,) of its deflection."""
        matrix, drive, push, seen = np.zeros((8, 8)), np.zeros(8), np.zeros(8), np.zeros(8)
        matrix[:4, 4:] = np.eye(4)
        matrix[4:, :4] = -np.diag(BEARINGS / MASSES)
        matrix[4:, 4:] = -np.diag(self.damping / MASSES)
        drive[4:], push[4:], seen[:4] = TORQUES / MASSES, DIRECTION / MASSES, DIRECTION
        return matrix, drive, push, seen

    @cached_property
    def rates(self) -> Callable[..., None]:
        """Compiled rates of (displacements, velocities) at a time, with the stiffness of `ahead` seconds later.

        By full matrices, known when it runs, as a method for any system would have them.
        """
        stiffness, drag, half_gap, mass = self.stiffness, self.drag, self.half_gap_m, MASSES[3]

        @numba.njit(fastmath=True)
        def rates(system: tuple[Array, Array, Array, Array], y: Array, t: float, ahead: float, out: Array) -> None:
            matrix, drive, push, seen = system
            deflection = 0.0
            for i in range(y.size):
                deflection += seen[i] * y[i]
            force = stiffness(t + ahead) * (deflection - min(max(deflection, -half_gap), half_gap))
            for i in range(y.size):
                total = drive[i] - push[i] * force
                for j in range(y.size):
                    total += matrix[i, j] * y[j]
                out[i] = total
            out[7] -= drag * y[7] * abs(y[7]) / mass

        return rates  # type: ignore[no-any-return]

    @cached_property
    def odeint_rates(self) -> Callable[[Array, float], Array]:
        """The same for `scipy.integrate.odeint`, written out for the pair: the baseline is as quick as can be."""
        stiffness, damping, drag, half_gap = self.stiffness, self.damping, self.drag, self.half_gap_m
        g, masses, bearings, torques = DIRECTION, MASSES, BEARINGS, TORQUES

        @numba.njit(fastmath=True)
        def rates(y: Array, t: float) -> Array:
            deflection = g[0] * y[0] + g[1] * y[1] + g[2] * y[2] + g[3] * y[3]
            force = stiffness(t) * (deflection - min(max(deflection, -half_gap), half_gap))
            out = np.empty(8)
            for i in range(4):
                out[i] = y[4 + i]
                out[4 + i] = (torques[i] - bearings[i] * y[i] - damping[i] * y[4 + i] - g[i] * force) / masses[i]
            out[7] -= drag * y[7] * abs(y[7]) / masses[3]
            return out

        return rates  # type: ignore[no-any-return]


@numba.njit(fastmath=True)
def runge_kutta(
    rates: Any,  # noqa: ANN401
    system: tuple[Array, Array, Array, Array],
    edges: Array,
    matrix: Array,
    weights: Array,
    nodes: Array,
    aligned: bool,
) -> Array:
    """Return the states (edges, 8) from rest, one step from edge to edge.

    With `aligned` no edge lies across a jump of the stiffness, and each stage takes that of the middle of its step:
    at the edge itself rounding would decide between before and after.
    """
    states, slopes, y = np.zeros((edges.size, 8)), np.empty((weights.size, 8)), np.empty(8)
    for n in range(edges.size - 1):
        step = edges[n + 1] - edges[n]
        for s in range(weights.size):
            y[:] = states[n]
            for earlier in range(s):
                if matrix[s, earlier] != 0.0:
                    for i in range(8):
                        y[i] += step * matrix[s, earlier] * slopes[earlier, i]
            rates(system, y, edges[n] + nodes[s] * step, (0.5 - nodes[s]) * step if aligned else 0.0, slopes[s])
        for i in range(8):
            total = 0.0
            for s in range(weights.size):
                total += weights[s] * slopes[s, i]
            states[n + 1, i] = states[n, i] + step * total
    return states


def explicit(pair: Pair, method: Explicit, *, times_s: Array, steps: int, jumps_s: Array | None = None) -> Array:
    """Return the states (times, 8) of even `times_s`, `steps` steps apart, and further edges at jumps where given."""
    even = np.linspace(times_s[0], times_s[-1], steps * (times_s.size - 1) + 1)
    edges, at = even, np.arange(0, even.size, steps)
    if jumps_s is not None:
        edges = np.union1d(even, jumps_s[(jumps_s > times_s[0]) & (jumps_s < times_s[-1])])
        at = np.searchsorted(edges, even[::steps])
    return np.asarray(
        runge_kutta(pair.rates, pair.system, edges, method.matrix, method.weights, method.nodes, jumps_s is not None)[
            at
        ]
    )


@numba.njit(fastmath=True)
def alpha_states(
    stiffness: Any,  # noqa: ANN401
    damping: Array,
    drag: float,
    half_gap: float,
    step: float,
    count: int,
    coefficients: tuple[float, float, float, float],
) -> Array:
    """Return the states (count + 1, 8) from rest by the generalised-alpha method, matrices diagonal."""
    alpha_m, alpha_f, beta, gamma = coefficients
    left = 1.0 - alpha_f
    inverse = 1 / ((1 - alpha_m) * MASSES + left * (gamma * step * damping + beta * step * step * BEARINGS))
    reach = beta * step * step * left * np.sum(DIRECTION * DIRECTION * inverse)
    y, v, a, force = np.zeros(4), np.zeros(4), TORQUES / MASSES, 0.0
    states = np.zeros((count + 1, 8))
    for n in range(count):
        y_known = y + step * v + step * step * (0.5 - beta) * a
        v_known = v + step * (1 - gamma) * a
        right = TORQUES - alpha_m * MASSES * a - damping * (left * v_known + alpha_f * v)
        right -= BEARINGS * (left * y_known + alpha_f * y) + alpha_f * DIRECTION * force
        speed = v[3] + step * left * a[3]  # extrapolated: of second order like the method
        right[3] -= drag * speed * abs(speed)
        known = np.sum(DIRECTION * (y_known + beta * step * step * inverse * right))
        k, delta = stiffness((n + 1) * step), known
        for _ in range(30):  # Newton's method on the deflection
            pressed = delta - min(max(delta, -half_gap), half_gap)
            slope = 0.0 if pressed == 0.0 else k
            change = (delta - known + reach * k * pressed) / (1 + reach * slope)
            delta -= change
            if abs(change) <= 1e-15 * abs(delta):
                break
        force = k * (delta - min(max(delta, -half_gap), half_gap))
        a = inverse * (right - left * DIRECTION * force)
        y = y_known + beta * step * step * a
        v = v_known + gamma * step * a
        states[n + 1, :4], states[n + 1, 4:] = y, v
    return states


def generalised_alpha(pair: Pair, *, times_s: Array, steps: int, spectral_radius: float | None = None) -> Array:
    """Return the states (times, 8) (Chung and Hulbert 1993, J. Appl. Mech. 60, 371, eqs 17, 20, 25).

    Without a spectral radius it is Newmark's method of constant average acceleration.
    """
    coefficients = 0.0, 0.0, 0.25, 0.5
    if spectral_radius is not None:
        alpha_m = (2 * spectral_radius - 1) / (spectral_radius + 1)
        alpha_f = spectral_radius / (spectral_radius + 1)
        coefficients = alpha_m, alpha_f, (1 - alpha_m + alpha_f) ** 2 / 4, 0.5 - alpha_m + alpha_f
    step, count = (times_s[1] - times_s[0]) / steps, steps * (times_s.size - 1)
    states = alpha_states(pair.stiffness, pair.damping, pair.drag, pair.half_gap_m, step, count, coefficients)
    return np.asarray(states[::steps])
