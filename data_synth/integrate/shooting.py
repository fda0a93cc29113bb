"""Periodic steady states as fixed points of the map over one period, not by waiting for transients to die."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from data_synth.integrate.assembled import Assembled, assemble
from data_synth.integrate.problem import Array, Integration, Outcome, Output, Problem, State, Steps, TiedTo
from data_synth.integrate.readings import Readings
from data_synth.integrate.running import integrate
from data_synth.integrate.stepping import Method, Stepper

_CLOSE = 1e-11  # of the state: how nearly it must return
_MOST = 40


@dataclass(frozen=True, kw_only=True)
class PeriodicState:
    """A motion that repeats, but for the angle all shafts turn on by.

    Attributes
    ----------
    start : State
        At the start of the period.
    waveform : Integration
        One period, both ends included.
    multipliers : (2 n - rigid modes,) complex array
        Of small disturbances over a period: the motion is stable where none exceeds 1 in magnitude.
    iterations : int
    residual : float
        How far the state comes back from where it began, relative to its size.
    outcome : Outcome
        DONE, NOT_CONVERGED, or why the method refuses the steps.
    detail : str
    """

    start: State
    waveform: Integration
    multipliers: NDArray[np.complex128] = field(metadata={"dims": ("multiplier",), "units": "1"})
    iterations: int
    residual: float
    outcome: Outcome
    detail: str

    @property
    def stable(self) -> bool:
        """Whether disturbances die or stay as they are (to 1e-9, the rounding of a free rotation's multiplier 1)."""
        return bool(np.all(np.abs(self.multipliers) <= 1 + 1e-9))


def periodic_state(
    problem: Problem, *, method: Method, output: Output, samples: int, steps: Steps | None = None
) -> PeriodicState:
    """Find the motion that repeats after `problem.duration_s`.

    Parameters
    ----------
    problem : Problem
        Its duration is the period: a whole number of every mesh's. Its start, where given, is the first guess and says
        to which of several motions to go; else the equilibrium under mean stiffnesses and drags is.
    method : Method
    output : Output
        Its maps; its rate is replaced by `samples` to the period.
    samples : int
    steps : Steps
        Per sample; default one.

    Returns
    -------
    PeriodicState

    Raises
    ------
    ValueError
        For a reference tied to the motion, whose period is not known beforehand, or what `method` cannot take.
    """
    if isinstance(problem.turning, TiedTo):
        raise ValueError("a reference tied to the motion has no period known beforehand; prescribe how it turns.")  # noqa: TRY004
    assembled = assemble(problem)
    output = replace(output, rate_hz=samples / problem.duration_s)
    tolerance = steps or Steps(per_sample=1)
    readings = Readings.of(assembled, output)
    free = _free(assembled)
    refusal = method.refusal(assembled, problem.duration_s / samples / tolerance.per_sample)
    start = assembled.modal(problem.start) if problem.start is not None else equilibrium(assembled)
    x, residual, jacobian, iterations = start, np.inf, np.zeros((0, 0)), 0
    if refusal is None:

        def stepper() -> Stepper:
            return method.stepper(readings, tolerance.per_sample)

        x, residual, jacobian, iterations = _newton(stepper, start, free, samples, _linear(assembled))
    state = assembled.physical(x)
    waveform = integrate(replace(problem, start=state), method=method, output=output, tolerance=tolerance)
    outcome = waveform.outcome if residual <= _CLOSE or refusal is not None else Outcome.NOT_CONVERGED
    if outcome is Outcome.DONE:
        detail = f"The state returns to {residual:.2g} of itself after {iterations} iterations."
    elif outcome is not Outcome.NOT_CONVERGED:
        detail = waveform.detail
    else:
        detail = f"After {iterations} iterations the state still misses itself by {residual:.2g} over a period."
    return PeriodicState(
        start=state,
        waveform=waveform,
        multipliers=np.asarray(linalg.eigvals(jacobian), dtype=np.complex128)
        if jacobian.size
        else np.zeros(0, complex),
        iterations=iterations,
        residual=float(residual),
        outcome=outcome,
        detail=detail,
    )


def _free(assembled: Assembled) -> NDArray[np.bool_]:
    """Return which entries of x must return: all but angles of rigid modes."""
    return np.concatenate([assembled.flow.modes.frequencies > 0, np.ones(assembled.size, dtype=bool)])


def _linear(assembled: Assembled) -> bool:
    return not assembled.drag_factors.size and not np.any(assembled.backlashes > 0)


def equilibrium(assembled: Assembled) -> Array:
    """Return x of steady rotation under the constant load, mean stiffnesses and drags, teeth in contact."""
    free, size = _free(assembled), assembled.size
    generator = assembled.flow.generator[np.ix_(free, free)]
    rows = assembled.velocity_rows(assembled.drags)[:, free]
    push = np.vstack([np.zeros((size, assembled.drag_factors.size)), assembled.drags.T])[free]
    z = np.zeros(int(free.sum()))
    speeds = np.ones(assembled.drag_factors.size)
    for _ in range(60):
        # Newton's method; for a single drag it is Heron's root
        slope = generator - push @ (2 * assembled.drag_factors * np.abs(speeds) * rows.T).T
        held = assembled.flow.drive[free] + push @ (assembled.drag_factors * speeds * np.abs(speeds))
        z = linalg.lstsq(slope, -held, cond=1e-13)[0]
        if np.allclose(rows @ z, speeds, rtol=1e-13, atol=0):
            break
        speeds = rows @ z
    x = np.zeros(2 * size)
    x[free] = z
    shift = np.zeros_like(assembled.backlashes)
    for number, half_gap in enumerate(assembled.backlashes):
        deflection = assembled.deflections[number] @ (x[:size] / assembled.flow.modes.scales)
        shift[number] = half_gap * np.sign(deflection)
    if np.any(shift):
        # contact begins where the gap is closed: the same forces at a larger deflection
        pulls = assembled.deflections.T @ (assembled.means * shift)
        w = assembled.flow.modes.frequencies
        x[:size] += np.divide(pulls, w, out=np.zeros(size), where=w > 0)
    return x


def _newton(
    stepper: Callable[[], Stepper], start: Array, free: NDArray[np.bool_], samples: int, linear: bool
) -> tuple[Array, float, Array, int]:
    """Return x, its residual, the Jacobian of the map over a period, and the iterations it took."""

    def after(z: Array) -> Array:
        x = np.zeros(free.size)
        x[free] = z
        stepper().advance(x, 0, samples)
        return x[free]

    def miss(z: Array) -> tuple[Array, float]:
        apart = after(z) - z
        size = float(np.linalg.norm(z))
        value = float(np.linalg.norm(apart)) / size if size else float(np.linalg.norm(apart))
        return apart, value if np.isfinite(value) else np.inf

    z = start[free]
    apart, residual = miss(z)
    jacobian = np.zeros((z.size, z.size))
    for iteration in range(1, _MOST + 1):
        size = max(float(np.linalg.norm(z)), 1e-9)
        if iteration == 1 or not linear:
            shift = size if linear else 1e-7 * size
            base = apart + z
            jacobian = np.column_stack([(after(z + shift * e) - base) / shift for e in np.eye(z.size)])
        if residual <= _CLOSE * 1e-2 or not np.isfinite(residual):
            break
        change = linalg.lstsq(np.eye(z.size) - jacobian, apart, cond=1e-13)[0]
        share = 1.0
        while share > 1e-3:  # noqa: PLR2004
            new_apart, new_residual = miss(z + share * change)
            if new_residual < residual:
                break
            share /= 2
        else:
            break
        z, apart, residual = z + share * change, new_apart, new_residual
    x = np.zeros(free.size)
    x[free] = z
    return x, residual, jacobian, iteration
