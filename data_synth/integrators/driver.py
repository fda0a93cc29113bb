"""Time integration of a problem block by block, with the step size chosen from the tolerated error."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from data_synth.integrators.modal_problem import Assembled, assemble
from data_synth.integrators.problem import Array, Integration, IntegrationError, Output, Problem
from data_synth.integrators.splitting import Stepper, channel_rows, refusal

BLOCK = 8192  # samples in memory at a time, whatever the length of the record
_MAX_STEPS = 256  # per sample
_LEAST_GAIN = 4.0  # in accuracy of halving the step where teeth separate: the error is of second order
_MIN_ALTERNATING = 1e-3  # of the RMS: lower limit of the alternating part to which errors are referred
_SAFETY = 0.7  # of the tolerated error: the error estimate of a trial is itself uncertain
_MAX_ROTATION = 2.0  # rad of a mode per step: beyond, the forces that excite it are sampled too coarsely
_MIN_SHARE = 0.01  # of a channel: modes with a smaller share need not be resolved
_MAX_CHANGE = 0.05  # of a channel's RMS, between these steps and finer ones
_MAX_REFINEMENT = 31  # factor of the number of steps for the comparison
_COMPARED_SAMPLES = 256


def integrate(problem: Problem, *, output: Output, steps: int) -> Integration:
    """Integrate the equations of motion of a problem by exponential splitting and return the whole record.

    The method is of fourth order where motion is smooth and of second order where teeth lose contact
    (`data_synth.integrators.splitting`).

    Parameters
    ----------
    problem : Problem
        System, reference angle, load, initial state and duration.
    output : Output
        Channels and sampling rate.
    steps : int
        Steps per sample, at least 1; `steps_for_error` returns the number for a bound on the error.

    Returns
    -------
    Integration

    Raises
    ------
    ValueError
        If the matrices are not symmetric, or the output maps do not fit the system.
    IntegrationError
        If the step size is refused, or the motion diverges.

    Examples
    --------
    An oscillator of 2 rad/s released at 1 m moves as ``cos 2 t``:

    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Output, Problem, ShaftAngle, State, System, integrate
    >>> one = np.eye(1)
    >>> system = System(mass=one, damping=0 * one, stiffness=4 * one, meshes=(), names=("mass x",))
    >>> problem = Problem(
    ...     system=system,
    ...     reference=ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1)),
    ...     load=Load(constant=np.zeros(1)),
    ...     duration_s=5.0,
    ...     start=State(displacement=np.ones(1), velocity=np.zeros(1)),
    ... )
    >>> output = Output(rate_hz=10.0, displacement=one)
    >>> found = integrate(problem, output=output, steps=1)
    >>> bool(np.allclose(found.values[:, 0], np.cos(2 * found.times_s), atol=1e-12))
    True
    """
    blocks = list(integrate_blocks(problem, output=output, steps=steps))
    times_s, values = (np.concatenate([getattr(block, part) for block in blocks]) for part in ("times_s", "values"))
    return replace(blocks[-1], times_s=times_s, values=values)


def integrate_blocks(problem: Problem, *, output: Output, steps: int, block: int = BLOCK) -> Iterator[Integration]:
    """Integrate the equations of motion of a problem and yield the record in blocks, with bounded memory.

    Parameters
    ----------
    problem, output, steps
        As for `integrate`.
    block : int
        Samples per block, at least 1.

    Yields
    ------
    Integration
        The result for one block.

    Raises
    ------
    ValueError, IntegrationError
        As `integrate` does.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Output, Problem, ShaftAngle, State, System, integrate_blocks
    >>> one = np.eye(1)
    >>> system = System(mass=one, damping=0 * one, stiffness=4 * one, meshes=(), names=("mass x",))
    >>> problem = Problem(
    ...     system=system,
    ...     reference=ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1)),
    ...     load=Load(constant=np.zeros(1)),
    ...     duration_s=5.0,
    ...     start=State(displacement=np.ones(1), velocity=np.zeros(1)),
    ... )
    >>> output = Output(rate_hz=10.0, displacement=one)
    >>> blocks = integrate_blocks(problem, output=output, steps=1, block=20)
    >>> [part.values.shape for part in blocks]  # 51 samples, the end included
    [(20, 1), (20, 1), (11, 1)]
    """
    for name, value in (("block", block), ("steps", steps)):
        if value < 1:
            raise ValueError(f"{name} = {value} must be at least 1.")
    a, rate_hz = assemble(problem), output.rate_hz
    stepper, x = Stepper(a, output, steps), a.modal(problem.start)
    refused = _too_coarse(a, output, steps)
    if refused is not None:
        raise refused
    shifts = {round((time_s - problem.start_s) * rate_hz): state for time_s, state in problem.shifts}
    values, count, number = stepper.at_start(x), _samples(problem, rate_hz) + 1, 0
    while number < count:
        last = min(number + block, count) - 1
        while (at := number + values.shape[0] - 1) < last:
            until = min([last, *(sample for sample in shifts if sample > at)])
            values = np.concatenate([values, stepper.advance(x, at, until - at)])
            if until in shifts:
                x += a.modal(shifts[until])
        times_s = problem.start_s + np.arange(number, number + values.shape[0]) / rate_hz
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            detail = f"The motion exceeds the range of floating-point numbers at {times_s[np.argmin(finite)]:.6g} s."
            raise IntegrationError(
                detail, "check load and damping, since the motion itself grows, or take more steps per sample"
            )
        yield Integration(times_s=times_s, values=values, final=a.physical(x))
        number, values = number + values.shape[0], values[:0]


def steps_for_error(problem: Problem, *, output: Output, relative: float, trial: int = 4096) -> int:
    """Return the number of steps per sample that keeps the RMS error of every channel within a bound.

    Runs over the first samples with one step size and with half of it are compared. Because phase errors grow with
    time, their difference is scaled up to the whole record.

    Parameters
    ----------
    problem, output
        As for `integrate`.
    relative : float
        RMS error, between 0 and 1, relative to the RMS of the channel about its mean, or to a thousandth of its total
        RMS if that is larger.
    trial : int
        Number of samples that are compared, if the record has more.

    Returns
    -------
    int

    Raises
    ------
    ValueError
        If `relative` is out of range.
    IntegrationError
        If 256 steps per sample do not suffice.

    Examples
    --------
    The motion of a mass under a constant force is integrated exactly, so one step is enough:

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, Load, Output, Problem, ShaftAngle, build_system, steps_for_error
    >>> free = build_system([Body(name="mass", mass_kg=1.0, motions=("x",))], [])
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=free, reference=steady, load=Load(constant=np.ones(1)), duration_s=2.0)
    >>> steps_for_error(problem, output=Output(rate_hz=10.0, displacement=np.eye(1)), relative=1e-3)
    1
    """
    if not 0 < relative < 1:
        raise ValueError(f"relative = {relative} must be above 0 and below 1.")
    assembled, count, steps = assemble(problem), _samples(problem, output.rate_hz), 1
    trial, tolerated = min(count, trial), _SAFETY * relative
    while steps < _MAX_STEPS and _too_coarse(assembled, output, steps):
        steps *= 2
    coarse, error = _trial_run(assembled, output, steps, trial), np.inf
    while 2 * steps <= _MAX_STEPS:
        fine = _trial_run(assembled, output, 2 * steps, trial)
        # nearly all of the difference is the error of the coarse steps; phase errors grow with time
        error = _difference(coarse, fine) * count / trial
        if error <= _LEAST_GAIN * tolerated:
            return steps if error <= tolerated else 2 * steps
        steps, coarse = 2 * steps, fine
    raise IntegrationError(
        f"With {steps} steps per sample the relative error of the record would be about {error / _LEAST_GAIN:.2g}, "
        f"but {relative:g} is asked for.",
        "tolerate a larger error, or raise rate_hz",
    )


def _samples(problem: Problem, rate_hz: float) -> int:
    """Return the number of samples after the first; a duration of whole sample intervals includes its end."""
    return int(np.floor(problem.duration_s * rate_hz * (1 + 4 * np.finfo(float).eps)))


def _too_coarse(assembled: Assembled, output: Output, steps: int) -> IntegrationError | None:
    """Return why steps are refused: unstable, or too coarse for a mode of a channel that finer steps change."""
    a, step_s = assembled, 1 / (output.rate_hz * steps)
    refused = refusal(a, step_s)
    rotations = a.frequencies * step_s
    if refused is not None or not np.any(rotations > _MAX_ROTATION):
        return refused
    shares = _shares(a, output) * (rotations > _MAX_ROTATION)
    relevant = np.max(shares, axis=0, initial=0.0) > _MIN_SHARE
    if not relevant.any():
        return None
    mode = int(np.argmax(rotations * relevant))
    # not a power of two: steps that alias a mode to rest also do so when halved
    finer = min(int(np.ceil(rotations[mode] / _MAX_ROTATION)), _MAX_REFINEMENT)
    samples = min(_samples(a.problem, output.rate_hz), _COMPARED_SAMPLES)
    changed = _difference(*(_trial_run(a, output, count, samples) for count in (steps, finer * steps)))
    if changed <= _MAX_CHANGE or not np.isfinite(changed):
        return None
    return IntegrationError(
        f"A step of {step_s:.3g} s advances the mode at {rotations[mode] / step_s:.4g} rad/s by {rotations[mode]:.3g} "
        f"rad. Its share in a channel is {np.max(shares[:, mode]):.2g}, and {finer} times as many steps change that "
        f"channel by {changed:.2g} of its RMS. {int(np.ceil(rotations[mode] / _MAX_ROTATION * steps))} steps per "
        "sample resolve the mode.",
    )


def _shares(assembled: Assembled, output: Output) -> Array:
    """Return the share of each mode in each channel (channels, modes) after a step of force, with unit norms."""
    a, rows = assembled, channel_rows(assembled, output)
    # after a step of force a mode has the same amplitude in w y and in y'
    amplitude = np.max(np.abs(a.equations.force_columns), axis=1, initial=0.0) / a.scales * (a.frequencies > 0)
    sensitivity = np.hypot(rows[:, : a.size], rows[:, a.size :]) * amplitude
    whole = np.linalg.norm(sensitivity, axis=1, keepdims=True)
    return np.asarray(sensitivity / np.where(whole > 0, whole, 1.0))


def _trial_run(assembled: Assembled, output: Output, steps: int, samples: int) -> Array:
    """Return the channels of the first samples."""
    stepper, x = Stepper(assembled, output, steps), assembled.modal(assembled.problem.start)
    stepper.at_start(x)
    return stepper.advance(x, 0, samples)


def _difference(coarse: Array, fine: Array) -> float:
    """Return the RMS difference over the RMS about the mean in the worst channel; infinite if a value is not finite."""
    if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
        return float("inf")
    sizes = np.maximum(np.std(fine, axis=0), _MIN_ALTERNATING * np.sqrt(np.mean(fine**2, axis=0)))
    differences = np.sqrt(np.mean((coarse - fine) ** 2, axis=0))
    moving = sizes > 0
    return float(np.max(differences[moving] / sizes[moving], initial=0.0))
