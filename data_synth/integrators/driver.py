"""Time integration of a problem, block by block, with the step size chosen from the tolerated error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from data_synth.integrators.modal_problem import assemble
from data_synth.integrators.problem import Accuracy, Integration, IntegrationError, Outcome, Steps
from data_synth.integrators.readings import Readings
from data_synth.integrators.splitting import Stepper, refusal

if TYPE_CHECKING:
    from collections.abc import Iterator

    from data_synth.integrators.problem import Array, Output, Problem, State

BLOCK = 8192  # samples in memory at a time, whatever the length of the record
_ORDER = 4  # of the error in the step size where motion is smooth; half of it where teeth part
_MIN_ALTERNATING = 1e-3  # of the RMS: an alternating part below this is taken to be as large as this
_SAFETY = 0.7  # of the tolerated error: the error estimate of a trial is itself uncertain
_MAX_ROTATION = 2.0  # rad of a mode in a step: beyond, the forces that excite it are sampled too rarely
_MIN_SHARE = 0.01  # of a channel: modes with a smaller share of it need not be resolved
_MAX_CHANGE = 0.05  # of a channel's RMS, between these steps and finer ones
_MAX_REFINEMENT = 31  # times as many steps, for the comparison
_COMPARED_SAMPLES = 256


@dataclass(frozen=True, kw_only=True)
class Block:
    """Part of an integrated record.

    Attributes
    ----------
    times_s : (n,) array
        Sample times in s.
    values : (n, channels) array
        Output channels.
    state : State
        State at the last sample.

    Examples
    --------
    A mass of 1 kg under 1 N has the velocity 1 m/s after 1 s:

    >>> import numpy as np
    >>> from data_synth.dynamics import (
    ...     Body, Load, Output, Problem, ShaftAngle, Steps, build_system, integrate_blocks,
    ... )
    >>> free = build_system([Body(name="mass", mass_kg=1.0, motions=("x",))], [])
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=free, reference=steady, load=Load(constant=np.ones(1)), duration_s=2.0)
    >>> output = Output(rate_hz=10.0, displacement=np.eye(1))
    >>> run = integrate_blocks(problem, output=output, tolerance=Steps(per_sample=1), block=11)
    >>> first = next(run)
    >>> first.times_s[-1].item(), first.state.velocity.round(9).tolist()
    (1.0, [1.0])
    """

    times_s: Array
    values: Array
    state: State


def integrate(problem: Problem, *, output: Output, tolerance: Steps | Accuracy) -> Integration:
    """Integrate the equations of motion of a problem by exponential splitting and return the whole record.

    The method is of fourth order where motion is smooth, of second where teeth lose contact
    (`data_synth.integrators.splitting`).

    Parameters
    ----------
    problem : Problem
        System, reference angle, load, initial state and duration.
    output : Output
        Channels and sampling rate.
    tolerance : Steps or Accuracy
        Number of steps to a sample, or a bound on the error from which it follows.

    Returns
    -------
    Integration
        Its `outcome` is other than DONE where the step size is refused or the tolerated error is out of reach (no
        values), or where the motion diverges (values up to there); `Integration.checked` raises instead.

    Raises
    ------
    ValueError
        If the matrices are not symmetric, or the output maps do not fit the system.

    Examples
    --------
    An oscillator of 2 rad/s released from 1 m moves as ``cos 2 t``:

    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Output, Problem, ShaftAngle, State, Steps, System, integrate
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
    >>> found = integrate(problem, output=output, tolerance=Steps(per_sample=1))
    >>> bool(np.allclose(found.values[:, 0], np.cos(2 * found.times_s), atol=1e-12))
    True
    """
    readings = Readings.of(assemble(problem), output)
    try:
        steps, error = _steps(readings, tolerance)
    except IntegrationError as refused:
        return Integration(
            times_s=np.zeros(0),
            values=np.zeros((0, output.channels)),
            outcome=refused.outcome,
            detail=refused.detail,
            final=None,
            steps_per_sample=0,
        )
    blocks = list(_blocks(readings, steps, BLOCK))
    done = Integration(
        times_s=np.concatenate([block.times_s for block in blocks]),
        values=np.concatenate([block.values for block in blocks]),
        outcome=Outcome.DONE,
        detail=f"{steps} steps to a sample.",
        final=blocks[-1].state,
        steps_per_sample=steps,
        estimated_error=error,
    )
    if np.isfinite(done.values).all():
        return done
    count = int(np.argmin(np.isfinite(done.values).all(axis=1)))
    return replace(
        done,
        times_s=done.times_s[:count],
        values=done.values[:count],
        outcome=Outcome.DIVERGED,
        detail=f"The motion left the range of numbers at {done.times_s[count]:.6g} s, {steps} steps to a sample.",
        final=None,
    )


def integrate_blocks(
    problem: Problem, *, output: Output, tolerance: Steps | Accuracy, block: int = BLOCK
) -> Iterator[Block]:
    """Integrate the equations of motion of a problem and yield the record in blocks, in bounded memory.

    Parameters
    ----------
    problem, output, tolerance
        As for `integrate`.
    block : int
        Samples to a block.

    Yields
    ------
    Block

    Raises
    ------
    ValueError
        As `integrate` does.
    IntegrationError
        Where `integrate` would return an outcome other than DONE.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Output, Problem, ShaftAngle, State, Steps, System, integrate_blocks
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
    >>> blocks = integrate_blocks(problem, output=output, tolerance=Steps(per_sample=1), block=20)
    >>> [part.values.shape for part in blocks]  # 51 samples, the end included
    [(20, 1), (20, 1), (11, 1)]
    """
    if block < 1:
        raise ValueError(f"block={block}: at least one sample is needed.")
    readings = Readings.of(assemble(problem), output)
    steps, _ = _steps(readings, tolerance)
    for part in _blocks(readings, steps, block):
        if not np.isfinite(part.values).all():
            detail = f"The motion left the range of numbers before {part.times_s[-1]:.6g} s."
            raise IntegrationError(Outcome.DIVERGED, detail)
        yield part


def steps_to_a_sample(problem: Problem, *, output: Output, tolerance: Accuracy) -> int:
    """Return the number of steps to a sample that `integrate` takes.

    Raises
    ------
    IntegrationError
        Where no number will do.

    Examples
    --------
    A mass under a constant force moves in the exact flow, so that one step is enough:

    >>> import numpy as np
    >>> from data_synth.dynamics import Accuracy, Body, Load, Output, Problem, ShaftAngle, build_system
    >>> from data_synth.integrators.driver import steps_to_a_sample
    >>> free = build_system([Body(name="mass", mass_kg=1.0, motions=("x",))], [])
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=free, reference=steady, load=Load(constant=np.ones(1)), duration_s=2.0)
    >>> output = Output(rate_hz=10.0, displacement=np.eye(1))
    >>> steps_to_a_sample(problem, output=output, tolerance=Accuracy(relative=1e-3))
    1
    """
    steps, _ = _steps(Readings.of(assemble(problem), output), tolerance)
    return steps


def samples_of(problem: Problem, rate_hz: float) -> int:
    """Return the number of samples after the first; a duration of whole sample intervals includes its end."""
    return int(np.floor(problem.duration_s * rate_hz * (1 + 4 * np.finfo(float).eps)))


def _blocks(readings: Readings, steps: int, size: int) -> Iterator[Block]:
    a, rate = readings.assembled, readings.output.rate_hz
    x = a.modal(a.problem.start)
    stepper = Stepper.of(readings, steps)
    count, first = samples_of(a.problem, rate), 0
    read = readings.at(x, a.problem.start_s)
    times_s = np.full(1, a.problem.start_s)
    while True:
        more = min(size - read.shape[0], count - first)
        if more > 0:
            new, at = stepper.advance(x, first, more), a.problem.start_s + (first + 1 + np.arange(more)) / rate
            read = np.concatenate([read, new]) if read.size else new
            times_s = np.concatenate([times_s, at]) if times_s.size else at
            first += more
        yield Block(times_s=times_s, values=readings.channels(read, times_s), state=a.physical(x))
        if first >= count or not np.isfinite(x).all():
            return
        read, times_s = np.empty((0, read.shape[1])), np.empty(0)


def _steps(readings: Readings, tolerance: Steps | Accuracy) -> tuple[int, float]:
    """Return steps to a sample and the estimated error; IntegrationError where no number of steps will do."""
    if isinstance(tolerance, Accuracy):
        steps, error = _enough_steps(readings, tolerance)
        refused = refusal(readings.assembled, 1 / (readings.output.rate_hz * steps))
    else:
        steps, error = tolerance.per_sample, float("nan")
        refused = _too_coarse(readings, steps)
    if refused is not None:
        raise refused
    return steps, error


def _enough_steps(readings: Readings, tolerance: Accuracy) -> tuple[int, float]:
    """Return the same from runs over the beginning of the record with several numbers of steps."""
    count = samples_of(readings.assembled.problem, readings.output.rate_hz)
    trial = min(count, max(64, math.ceil(count * tolerance.trial)))
    runs: dict[int, Array] = {}

    def difference(coarse: int, fine: int) -> float:
        """Return the difference between two numbers of steps, over the whole record, over the RMS of its channels."""
        for number in (coarse, fine):
            if number not in runs:
                runs[number] = _trial_run(readings, number, trial)
        return _difference(runs[coarse], runs[fine], about_mean=tolerance.about_mean) * count / trial

    steps = 1
    while steps < tolerance.max_per_sample and _too_coarse(readings, steps):
        steps *= 2
    tolerated, error, expected = _SAFETY * tolerance.relative, np.inf, np.inf
    while 2 * steps <= tolerance.max_per_sample:
        # the coarse steps have nearly all of the difference as their error
        error = difference(steps, 2 * steps)
        if error <= tolerated:
            return steps, error
        expected = error / 2**_ORDER
        if error / 2 ** (_ORDER / 2) <= tolerated:
            enough = math.ceil(steps * (error / tolerated) ** (2 / _ORDER))
            near = difference(enough, 2 * steps) if enough < 2 * steps else np.inf
            return (enough, near) if near <= tolerated else (2 * steps, expected)
        ahead = math.ceil(np.log2(expected / tolerated) / _ORDER) if np.isfinite(expected) else 1
        steps *= 2
        if ahead > 1 and steps * 2 ** (ahead - 1) <= tolerance.max_per_sample // 2:
            steps *= 2 ** (ahead - 1)
    if expected <= tolerated:
        return steps, expected
    raise IntegrationError(
        Outcome.TOLERANCE_NOT_REACHED,
        f"With {steps} steps to a sample the error of the record would be about {error:.2g}, "
        f"not {tolerance.relative:g}.",
    )


def _too_coarse(readings: Readings, steps: int) -> IntegrationError | None:
    """Refuse steps, also where they do not resolve a mode of a channel and finer steps change that channel."""
    a, rate = readings.assembled, readings.output.rate_hz
    step_s = 1 / (rate * steps)
    refused = refusal(a, step_s)
    rotations = a.flow.modes.frequencies * step_s
    if refused is not None or not np.any(rotations > _MAX_ROTATION):
        return refused
    shares = readings.shares() * (rotations > _MAX_ROTATION)
    relevant = np.max(shares, axis=0, initial=0.0) > _MIN_SHARE
    if not relevant.any():
        return None
    mode = int(np.argmax(rotations * relevant))
    # no power of two: steps that alias a mode to rest do so with half the step as well
    finer = min(int(np.ceil(rotations[mode] / _MAX_ROTATION)), _MAX_REFINEMENT)
    samples = min(samples_of(a.problem, rate), _COMPARED_SAMPLES)
    coarse, fine = (_trial_run(readings, count, samples) for count in (steps, finer * steps))
    changed = _difference(coarse, fine, about_mean=False)
    if changed <= _MAX_CHANGE or not np.isfinite(changed):
        return None
    return IntegrationError(
        Outcome.UNRESOLVED_STEP,
        f"A step of {step_s:.3g} s turns the mode at {rotations[mode] / step_s:.4g} rad/s by {rotations[mode]:.3g} "
        f"rad, and its share in a channel is {np.max(shares[:, mode]):.2g}, which {finer} times as many steps change "
        f"by {changed:.2g} of its RMS. {int(np.ceil(rotations[mode] / _MAX_ROTATION * steps))} steps to a sample "
        "resolve the mode.",
    )


def _trial_run(readings: Readings, steps: int, samples: int) -> Array:
    """Return the channels of the first samples."""
    a = readings.assembled
    x = a.modal(a.problem.start)
    read = Stepper.of(readings, steps).advance(x, 0, samples)
    times_s = a.problem.start_s + (1 + np.arange(samples)) / readings.output.rate_hz
    return readings.channels(read, times_s)


def _difference(coarse: Array, fine: Array, *, about_mean: bool) -> float:
    """Return RMS difference over RMS of the worst channel; infinite where a value is not finite."""
    if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
        return float("inf")
    sizes = np.sqrt(np.mean(fine**2, axis=0))
    if about_mean:
        sizes = np.maximum(np.std(fine, axis=0), _MIN_ALTERNATING * sizes)
    differences = np.sqrt(np.mean((coarse - fine) ** 2, axis=0))
    moving = sizes > 0
    return float(np.max(differences[moving] / sizes[moving], initial=0.0))
