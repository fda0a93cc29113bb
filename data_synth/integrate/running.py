"""Run a method over a problem, block by block, with steps chosen from the error that is asked for."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from data_synth.integrate.assembled import Assembled, assemble
from data_synth.integrate.problem import Accuracy, Array, Integration, Outcome, Output, Problem, State, Steps
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Method, Refusal

BLOCK = 8192  # samples: what memory holds of a record, whatever its length
_STILL = 1e-3  # of the RMS: what moves less about its mean is judged as if it moved so much
_SAFETY = 0.7  # of the error asked for: a trial's differences are themselves uncertain
_RESOLVED = 2.0  # rad of a mode that a step may turn: beyond, the forces that swing it are sampled too rarely
_HEARD = 0.01  # of a channel: modes with less do not matter to it
_CHANGED = 0.05  # of a channel's RMS, between these steps and finer ones
_FINEST = 31  # times as many steps, to judge by
_JUDGED = 256  # samples


@dataclass(frozen=True, kw_only=True)
class Block:
    """Part of a record: channels (n, channels) at times (n,), and the state at the last of them."""

    times_s: Array
    values: Array
    state: State


def integrate(problem: Problem, *, method: Method, output: Output, tolerance: Steps | Accuracy) -> Integration:
    """Integrate a problem and return the whole record.

    Parameters
    ----------
    problem : Problem
    method : Method
        `Splitting` or `Transition`, or any other that has their three members.
    output : Output
    tolerance : Steps or Accuracy

    Returns
    -------
    Integration
        With `outcome` other than DONE where steps are refused (no values), where the error asked for is out of reach
        (no values), or where the motion leaves all bounds (values up to there); `checked` raises instead.

    Raises
    ------
    ValueError
        Where the method cannot take the problem at all, or maps do not fit the system.
    """
    assembled = assemble(problem)
    readings = Readings.of(assembled, output)
    steps, error, refusal = _steps(readings, method, tolerance)
    if refusal is None:
        refusal = method.refusal(assembled, 1 / (output.rate_hz * steps))
    if refusal is not None:
        return _refused(refusal, output, steps, error)
    blocks = list(_blocks(readings, method, steps, BLOCK))
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
    problem: Problem, *, method: Method, output: Output, tolerance: Steps | Accuracy, block: int = BLOCK
) -> Iterator[Block]:
    """Yield the record in blocks of `block` samples, so that memory does not grow with its length.

    Raises
    ------
    ValueError
        As `integrate` does.
    IntegrationError
        Where `integrate` would return an outcome other than DONE.
    """
    if block < 1:
        raise ValueError(f"block={block}: at least one sample is needed.")
    assembled = assemble(problem)
    readings = Readings.of(assembled, output)
    steps, error, refusal = _steps(readings, method, tolerance)
    refusal = refusal or method.refusal(assembled, 1 / (output.rate_hz * steps))
    if refusal is not None:
        _refused(refusal, output, steps, error).checked()
    for part in _blocks(readings, method, steps, block):
        if not np.isfinite(part.values).all():
            detail = f"The motion left the range of numbers before {part.times_s[-1]:.6g} s."
            _refused(Refusal(outcome=Outcome.DIVERGED, detail=detail), output, steps, error).checked()
        yield part


def _refused(refusal: Refusal, output: Output, steps: int, error: float) -> Integration:
    return Integration(
        times_s=np.zeros(0),
        values=np.zeros((0, output.channels)),
        outcome=refusal.outcome,
        detail=refusal.detail,
        final=None,
        steps_per_sample=steps,
        estimated_error=error,
    )


def samples_of(problem: Problem, rate_hz: float) -> int:
    """Return how many samples lie after the first: a duration of whole samples includes its end."""
    return int(np.floor(problem.duration_s * rate_hz * (1 + 4 * np.finfo(float).eps)))


def _blocks(readings: Readings, method: Method, steps: int, size: int) -> Iterator[Block]:
    a, rate = readings.assembled, readings.output.rate_hz
    x = a.modal(a.problem.start)
    stepper = method.stepper(readings, steps)
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


def _steps(readings: Readings, method: Method, tolerance: Steps | Accuracy) -> tuple[int, float, Refusal | None]:
    """Return steps to a sample, the error expected of them, and why there are none."""
    if isinstance(tolerance, Steps):
        return tolerance.per_sample, float("nan"), _unresolved(readings, method, tolerance.per_sample)
    if method.order is None:
        return 1, 0.0, None
    rate, problem = readings.output.rate_hz, readings.assembled.problem
    count = samples_of(problem, rate)
    trial = min(count, max(64, int(np.ceil(count * tolerance.trial))))
    steps = 1
    while steps < tolerance.most_per_sample and (
        method.refusal(readings.assembled, 1 / (rate * steps)) or _unresolved(readings, method, steps)
    ):
        steps *= 2
    wanted, error = _SAFETY * tolerance.relative, np.inf
    coarse = _trial(readings, method, steps, trial)
    while 2 * steps <= tolerance.most_per_sample:
        fine = _trial(readings, method, 2 * steps, trial)
        error = _difference(coarse, fine, about_mean=tolerance.about_mean) * count / trial
        # the error of the coarse steps is nearly all of the difference; that of half the step is 2^-order of it
        if error <= wanted:
            return steps, error, None
        expected = error / 2**method.order
        if expected <= wanted:
            return 2 * steps, expected, None
        ahead = max(1, int(np.ceil(np.log2(expected / wanted) / method.order))) if np.isfinite(expected) else 1
        coarse, steps = fine, 2 * steps
        if ahead > 1 and steps * 2 ** (ahead - 1) <= tolerance.most_per_sample // 2:
            steps *= 2 ** (ahead - 1)
            coarse = _trial(readings, method, steps, trial)
    detail = (
        f"With {steps} steps to a sample the error of the record would be about {error:.2g}, "
        f"not {tolerance.relative:g}."
    )
    return steps, error, Refusal(outcome=Outcome.TOLERANCE_NOT_REACHED, detail=detail)


def _unresolved(readings: Readings, method: Method, steps: int) -> Refusal | None:
    """Refuse steps over modes that a channel is made of, where steps that resolve them read otherwise."""
    a, rate = readings.assembled, readings.output.rate_hz
    step_s = 1 / (rate * steps)
    turns = a.flow.modes.frequencies * step_s
    if method.order is None or not np.any(turns > _RESOLVED) or method.refusal(a, step_s) is not None:
        return None
    shares = readings.shares() * (turns > _RESOLVED)
    heard = np.max(shares, axis=0, initial=0.0) > _HEARD
    if not heard.any():
        return None
    mode = int(np.argmax(turns * heard))
    # no power of two: kicks in step with a mode are so with half the step as well
    finer = min(int(np.ceil(turns[mode] / _RESOLVED)), _FINEST)
    samples = min(samples_of(a.problem, rate), _JUDGED)
    coarse, fine = (_trial(readings, method, count, samples) for count in (steps, finer * steps))
    changed = _difference(coarse, fine, about_mean=False)
    if changed <= _CHANGED or not np.isfinite(changed):
        return None
    detail = (
        f"A step of {step_s:.3g} s turns the mode at {turns[mode] / step_s:.4g} rad/s by {turns[mode]:.3g} rad, and a "
        f"channel consists of it by {np.max(shares[:, mode]):.2g}: with {finer} times as many it reads otherwise by "
        f"{changed:.2g} of its RMS. {int(np.ceil(turns[mode] / _RESOLVED * steps))} steps to a sample resolve the mode."
    )
    return Refusal(outcome=Outcome.UNRESOLVED_STEP, detail=detail)


def _trial(readings: Readings, method: Method, steps: int, samples: int) -> Array:
    a: Assembled = readings.assembled
    x = a.modal(a.problem.start)
    read = method.stepper(readings, steps).advance(x, 0, samples)
    times_s = a.problem.start_s + (1 + np.arange(samples)) / readings.output.rate_hz
    return readings.channels(read, times_s)


def _difference(coarse: Array, fine: Array, *, about_mean: bool) -> float:
    """Return the RMS difference over the RMS, of the worst channel; infinite where either is not finite."""
    if not (np.isfinite(coarse).all() and np.isfinite(fine).all()):
        return float("inf")
    sizes = np.sqrt(np.mean(fine**2, axis=0))
    if about_mean:
        sizes = np.maximum(np.std(fine, axis=0), _STILL * sizes)
    apart = np.sqrt(np.mean((coarse - fine) ** 2, axis=0))
    moving = sizes > 0
    return float(np.max(apart[moving] / sizes[moving], initial=0.0))
