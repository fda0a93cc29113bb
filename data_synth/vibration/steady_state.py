"""Periodic steady states by shooting: fixed points of the map over one period, found by Newton's method."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from data_synth.integrators.driver import integrate
from data_synth.integrators.modal_problem import Assembled, assemble
from data_synth.integrators.problem import Array, Integration, IntegrationError, Output, Problem, State
from data_synth.integrators.splitting import Stepper, refusal

_TOLERANCE = 1e-11  # of the state: its change over a period
_MAX_ITERATIONS = 40


@dataclass(frozen=True, kw_only=True)
class PeriodicState:
    """Periodic motion, up to the common angle that rigid-body rotation adds in each period.

    Attributes
    ----------
    start : State
        State at the start of the period.
    waveform : Integration
        Output channels over one period, both ends included.
    multipliers : (2 n - rigid modes,) complex array
        Floquet multipliers of the linearised map over a period: stable where none exceeds 1 in magnitude.
    iterations : int
        Newton iterations.
    residual : float
        Norm of the change of the state over a period, over the norm of the state.

    Examples
    --------
    At rest on a spring of 100 N/m under 1 N; the multipliers' product is ``exp(-c T / m)`` (Liouville's formula):

    >>> import numpy as np
    >>> from data_synth.dynamics import (
    ...     Body, Load, Output, Problem, ShaftAngle, Support, build_system, periodic_state,
    ... )
    >>> spring = Support(between=("mass", None), x=100.0, damping_s=0.01)  # c = 0.01 s x 100 N/m
    >>> system = build_system([Body(name="mass", mass_kg=1.0, motions=("x",))], [spring])
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=system, reference=steady, load=Load(constant=np.ones(1)), duration_s=0.5)
    >>> output = Output(rate_hz=1.0, displacement=np.eye(1))
    >>> state = periodic_state(problem, output=output, samples=8)
    >>> state.start.displacement.round(9).tolist(), bool(np.isclose(np.prod(state.multipliers), np.exp(-0.5)))
    ([0.01], True)
    """

    start: State
    waveform: Integration
    multipliers: NDArray[np.complex128] = field(metadata={"dims": ("multiplier",), "units": "1"})
    iterations: int
    residual: float

    @property
    def stable(self) -> bool:
        """Whether no multiplier exceeds 1 in magnitude, to 1e-9: the rounding of a free rotation's multiplier 1."""
        return bool(np.all(np.abs(self.multipliers) <= 1 + 1e-9))


def periodic_state(problem: Problem, *, output: Output, samples: int, steps: int = 1) -> PeriodicState:
    """Return the periodic steady state of a problem by shooting: Newton's method on the map over one period.

    Parameters
    ----------
    problem : Problem
        Problem whose duration is the period in s: an integer number of periods of every mesh. Its start, if given, is
        the initial estimate and selects one of several periodic motions; the default is the static equilibrium under
        mean mesh stiffness and drag.
    output : Output
        Channels of the waveform; its rate is replaced by `samples` per period.
    samples : int
        Samples per period.
    steps : int
        Integration steps per sample.

    Returns
    -------
    PeriodicState

    Raises
    ------
    IntegrationError
        If the step size is refused, or Newton's method does not converge.

    Examples
    --------
    A mass on a mesh whose transmission error of 1 um excites it at its natural frequency of 10 rad/s: the amplitude
    is k / (c omega) = 10 um:

    >>> import numpy as np
    >>> from data_synth.dynamics import (
    ...     Constant, Load, Mesh, Output, Problem, ProfileError, ShaftAngle, System, periodic_state,
    ... )
    >>> one, error = np.eye(1), ProfileError(harmonics_m=np.array([1e-6]))
    >>> mesh = Mesh(name="m", direction=np.ones(1), stiffness=Constant(mean=100.0), error=error)
    >>> system = System(mass=one, damping=one, stiffness=0 * one, meshes=(mesh,), names=("mass x",))
    >>> turning = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([10 / (2 * np.pi)]))
    >>> problem = Problem(system=system, reference=turning, load=Load(constant=np.zeros(1)), duration_s=np.pi / 5)
    >>> read = Output(rate_hz=1.0, displacement=one)
    >>> state = periodic_state(problem, output=read, samples=64, steps=2)
    >>> f"{np.ptp(state.waveform.values) / 2:.3e}", state.stable
    ('1.000e-05', True)
    """
    assembled = assemble(problem)
    output = replace(output, rate_hz=samples / problem.duration_s)
    periodic = _periodic_entries(assembled)
    linear = not assembled.equations.drag_factors.size and not np.any(assembled.backlashes > 0)
    refused = refusal(assembled, problem.duration_s / samples / steps)
    if refused is not None:
        raise refused
    start = assembled.modal(problem.start) if problem.start is not None else equilibrium(assembled)
    stepper = partial(Stepper, assembled, output, steps)
    x, residual, jacobian, iterations = _newton(stepper, start, periodic, samples, linear)
    if residual > _TOLERANCE:
        raise IntegrationError(
            f"After {iterations} iterations the state still changes by {residual:.2g} of its norm over a period.",
            "start closer to a solution, or approach it in smaller steps from a case that converges",
        )
    state = assembled.physical(x)
    return PeriodicState(
        start=state,
        waveform=integrate(replace(problem, start=state), output=output, steps=steps),
        multipliers=np.asarray(linalg.eigvals(jacobian), dtype=np.complex128),
        iterations=iterations,
        residual=float(residual),
    )


def _periodic_entries(assembled: Assembled) -> NDArray[np.bool_]:
    """Return which entries of x are periodic: all but the displacements of rigid-body modes."""
    return np.concatenate([assembled.frequencies > 0, np.ones(assembled.size, dtype=bool)])


def equilibrium(assembled: Assembled) -> Array:
    """Return x of steady rotation under the constant load, with mean mesh stiffness, drag and teeth in contact."""
    periodic, size = _periodic_entries(assembled), assembled.size
    drags, drag_factors = assembled.equations.drags, assembled.equations.drag_factors
    generator = assembled.generator[np.ix_(periodic, periodic)]
    rows = assembled.velocity_rows(drags)[:, periodic]
    push = np.vstack([np.zeros((size, drag_factors.size)), drags.T])[periodic]
    drive, z = np.concatenate([np.zeros(size), assembled.drive]), np.zeros(int(periodic.sum()))
    speeds = np.ones(drag_factors.size)
    for _ in range(60):
        # Newton's method; for a single drag it is Heron's square root
        slope = generator - push @ (2 * drag_factors * np.abs(speeds) * rows.T).T
        force = drive[periodic] + push @ (drag_factors * speeds * np.abs(speeds))
        z = linalg.lstsq(slope, -force, cond=1e-13)[0]
        if np.allclose(rows @ z, speeds, rtol=1e-13, atol=0):
            break
        speeds = rows @ z
    x = np.zeros(2 * size)
    x[periodic] = z
    # contact begins at half the backlash: equal forces at a larger deflection
    shifts = assembled.backlashes * np.sign(assembled.deflections @ (x[:size] / assembled.scales))
    forces, w = assembled.deflections.T @ (assembled.means * shifts), assembled.frequencies
    x[:size] += np.divide(forces, w, out=np.zeros(size), where=w > 0)
    return x


def _newton(
    stepper: Callable[[], Stepper], start: Array, periodic: NDArray[np.bool_], samples: int, linear: bool
) -> tuple[Array, float, Array, int]:
    """Return x, its residual, the Jacobian of the map P over a period, and the iterations: solve ``P(z) - z = 0``."""

    def after_period(z: Array) -> Array:
        x = np.zeros(periodic.size)
        x[periodic] = z
        stepper().advance(x, 0, samples)
        return x[periodic]

    def change_over_period(z: Array) -> tuple[Array, float]:
        change = after_period(z) - z
        norm = float(np.linalg.norm(z))
        relative = float(np.linalg.norm(change)) / norm if norm else float(np.linalg.norm(change))
        return change, relative if np.isfinite(relative) else np.inf

    z = start[periodic]
    change, residual = change_over_period(z)
    jacobian = np.zeros((z.size, z.size))
    for iteration in range(1, _MAX_ITERATIONS + 1):
        norm = max(float(np.linalg.norm(z)), 1e-9)
        if iteration == 1 or not linear:
            shift = norm if linear else 1e-7 * norm
            base = change + z
            jacobian = np.column_stack([(after_period(z + shift * e) - base) / shift for e in np.eye(z.size)])
        if residual <= _TOLERANCE * 1e-2 or not np.isfinite(residual):
            break
        step = linalg.lstsq(np.eye(z.size) - jacobian, change, cond=1e-13)[0]
        # backtracking: shorter steps until the residual falls
        factor = 1.0
        while factor > 1e-3:  # noqa: PLR2004
            new_change, new_residual = change_over_period(z + factor * step)
            if new_residual < residual:
                break
            factor /= 2
        else:
            break
        z, change, residual = z + factor * step, new_change, new_residual
    x = np.zeros(periodic.size)
    x[periodic] = z
    return x, residual, jacobian, iteration
