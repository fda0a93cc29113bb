"""Lines of gears in motion: their orders, and their complex amplitudes against time, projected from the clean signal.

Of the orders that the drawing gives (`data_synth.vibration.line_candidates`) those that are loud are kept. In varying
motion the lines that are expected of the drive and the drawing are the signal but for a small part; where they are not,
a projection finds what is left without them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.expected_response import ExpectedLines
from data_synth.vibration.line_candidates import Candidates, candidates_of
from data_synth.vibration.order_projection import AngleSamples
from data_synth.vibration.projected_lines import (
    BELOW_NYQUIST,
    EXPECTED_FLOOR,
    Lines,
    about_expected,
    about_fit,
    compared_from,
    powers,
    share_of_power,
    steady_fit,
    varying_fit,
    without,
)

LOWER_SPEEDS = 6.0  # times the highest order at the highest speed are expected lines of lower speeds, at most
_STEADY = 1e-12  # of the speed: what rounding may change
_LOOKED = 51  # instants at which expected lines are looked for
_SMALL = 0.05
"""Of the power: what expected lines may leave of it. Windows that find more elsewhere in sound than in damaged gears
make more of it than a fault has."""
_USELESS = 0.9  # of the power: lines that leave more of it are not what is there, and may be anything in between
_RINGS, _SELDOM = 0.5, 0.125
"""Of the power, what expected lines may leave of it in few places, such a share of them: it rings, and is none."""
_SEPARATED, _BETTER = 1e-5, 0.5
"""Of the power: where steady lines leave more, there may be some that the record does not separate. And of what they
leave, what expected ones may leave to stand for them."""


class GearLine(NamedTuple):
    """A line of gears in motion.

    Attributes
    ----------
    order : float
        Correctly rounded.
    component, kind : str
    amplitude : (channel, instant) complex array
    change : float
        RMS over time of what halving the window changes, over the RMS of the line; zero where Z has no window, in
        steady motion and of a line that is only what is expected. Where the window does not separate an expected line
        from a neighbour, all that the projection adds to the neighbour; 1 where half the window does not separate a
        line that is not expected.
    """

    order: float
    component: str
    kind: str
    amplitude: ComplexArray
    change: float


@dataclass(frozen=True, kw_only=True)
class GearLines:
    """Lines of gears in motion, by rising order, and a sentence about their error."""

    lines: tuple[GearLine, ...]
    about: str


def gear_lines(
    prepared: PreparedScene,
    signal: Array,
    *,
    expected: Callable[[], tuple[ExpectedLines, ...]] = tuple,
    sound: Callable[[], tuple[ExpectedLines, ...]] | None = None,
) -> GearLines:
    """Return the loud lines in the channels of gears in motion, (channel, n), at the instants of the truth.

    At constant speed, torque and damage the window is the whole record, and Z is constant. Where that does not separate
    all lines, as those of a damaged planet, Z is that of the expected lines if they leave less than half as much power.
    Of damaged teeth, for which `sound` gives the lines expected without the damage, it is the difference of both, and
    lines of sound teeth in the rest, if that leaves less.

    Else Z is that of the expected lines, which has no window. Where they leave more than 5 % of the power, and not in
    few places, as what rings after a step does, or anything where damage grows at constant speed and torque, what the
    signal without them adds to all lines is fitted as well: polynomials of second degree in angle within windows; their
    length is that, of several, with the least error: the share of the lines' power that is in lines which half the
    window changes by 1 % or more, plus the share of what the expected lines leave of the signal that all lines leave.
    The former alone would have long windows where all that a projection adds is below 1 %.

    Free vibration, after a jump of speed or torque and in a start, is no line: the sentence has the share of the power
    that lines leave.
    """
    scene, angle = prepared.scene, prepared.drive.angle
    turning = np.sign(prepared.speed_hz[prepared.speed_hz != 0])
    if not turning.size or np.ptp(turning) or not signal.any():
        return GearLines(lines=(), about="left out: the shaft turns back, or nothing moves")
    sign = float(turning[0])
    top = BELOW_NYQUIST * scene.rate_hz / 2 / angle.top_speed_hz(0.0, scene.duration_s)
    samples = AngleSamples(
        signal=signal,
        rate_hz=scene.rate_hz,
        revolutions=lambda times_s: sign * angle.revolutions(times_s),
        speed_hz=lambda times_s: np.maximum(sign * angle.speed_hz(times_s), 0.0),
        top_order=top,
    )
    steady = is_steady(prepared)
    fastest, slowest = (float(each(np.abs(prepared.speed_hz[prepared.speed_hz != 0]))) for each in (np.max, np.min))
    candidates = candidates_of(scene, top=top * min(fastest / slowest, LOWER_SPEEDS), mixed=steady)
    if steady:
        found, _, about = _steady_lines(samples, candidates, prepared, expected, sound)
    else:
        prior = _prior(expected(), candidates, speeds=prepared.speed_hz, channels=signal.shape[0])
        # at constant speed and torque, sound gears have projected lines: of growing damage the difference counts
        unchanging = _drive_is_steady(prepared)
        most = 0.0 if unchanging else _SMALL
        found, about = _varying_lines(samples, candidates, prepared.instants_s, prior, most=most)
    amplitudes = found.amplitudes.conj() if sign < 0 else found.amplitudes
    sources = [candidates.sources[number] for number in found.chosen.tolist()]
    orders, changes = candidates.values[found.chosen].tolist(), found.changes.tolist()
    lines = tuple(
        GearLine(order, component, kind, amplitude, change)
        for order, (component, kind), amplitude, change in zip(
            orders, sources, amplitudes.swapaxes(0, 1), changes, strict=True
        )
    )
    return GearLines(lines=lines, about=about)


def _steady_lines(
    samples: AngleSamples,
    candidates: Candidates,
    prepared: PreparedScene,
    expected: Callable[[], tuple[ExpectedLines, ...]],
    sound: Callable[[], tuple[ExpectedLines, ...]] | None,
) -> tuple[Lines, float, str]:
    """Return the lines of steady motion, the share of the power that they leave, and a sentence.

    What damage adds is as it is expected, and the rest as in the record of sound teeth, if that leaves less.
    """
    instants_s = prepared.instants_s
    found, left, about = steady_fit(samples, candidates, instants_s)
    if left <= _SEPARATED:
        return found, left, about
    prior_of = partial(_prior, candidates=candidates, speeds=prepared.speed_hz, channels=samples.signal.shape[0])
    prior = prior_of(expected())
    if sound is None:
        rest = without(prior, samples, candidates, instants_s)
        alone = float(np.sum(rest.signal**2) / np.sum(samples.signal**2))
        if alone < _BETTER * left:
            return prior, alone, about_expected(prior, alone)
    else:
        added = prior.plus(prior_of(sound()), times=-1.0)
        fewer = candidates_of(prepared.scene.changed(faults=()), top=samples.top_order, mixed=True)
        rest = without(added, samples, candidates, instants_s)
        others, beside, of_others = _steady_lines(rest, fewer, prepared, sound, None)
        if beside < left:
            others = replace(others, chosen=candidates.places(fewer)[others.chosen])
            return others.plus(added), beside, f"what damage adds is expected of the drawing; beside that {of_others}"
    return found, left, about


def is_steady(prepared: PreparedScene) -> bool:
    """Return whether speed, torque and damage of teeth are constant."""
    teeth = prepared.scene.exact_orders("tooth")
    return _drive_is_steady(prepared) and not any(
        fault.growth is not None and fault.component in teeth for fault in prepared.scene.faults
    )


def _drive_is_steady(prepared: PreparedScene) -> bool:
    """Return whether speed and torque are constant."""
    torque = prepared.drive.torque
    steady = bool(np.ptp(prepared.speed_hz) <= _STEADY * np.max(np.abs(prepared.speed_hz)))
    return steady and (torque is None or not np.ptp(torque.values))


# ---- varying speed, torque or damage ---------------------------------------------------------------------------------


def _prior(expected: tuple[ExpectedLines, ...], candidates: Candidates, *, speeds: Array, channels: int) -> Lines:
    """Return the expected lines that are candidates and loud."""
    few = np.unique(np.linspace(0, speeds.size - 1, _LOOKED).round().astype(int))
    found = np.zeros((channels, candidates.numbers.size, few.size), dtype=np.complex128)
    places = list[tuple[ExpectedLines, NDArray[np.int_], NDArray[np.int_]]]()
    for family in expected:
        step, beside = family.base_order / candidates.unit, family.heard.shift / candidates.unit
        # of candidates, only whole multiples of their unit may be
        whole = math.lcm(step.denominator, beside.denominator)
        multiples = np.arange(1, family.size + 1)
        numbers = multiples * int(step * whole) + int(beside * whole)
        multiples, numbers = multiples[numbers % whole == 0], numbers[numbers % whole == 0] // whole
        place = np.minimum(np.searchsorted(candidates.numbers, np.abs(numbers)), candidates.numbers.size - 1)
        there = candidates.numbers[place] == np.abs(numbers)
        for side in (numbers > 0, numbers < 0):  # in each, a candidate has one line
            if np.any(there & side):
                places.append((family, multiples[there & side], place[there & side]))
                found[:, places[-1][2]] += family.steady(places[-1][1], few)
    sizes = np.max(np.abs(found), axis=(0, 2))
    # one floor for all: where sound and damaged gears have the same lines, those below it cancel in the difference
    chosen = np.flatnonzero(sizes > EXPECTED_FLOOR * np.max(sizes, initial=0.0))
    amplitudes, every = np.zeros((channels, chosen.size, speeds.size), dtype=np.complex128), np.arange(speeds.size)
    for family, multiples, place in places:
        here = np.isin(place, chosen)
        amplitudes[:, np.searchsorted(chosen, place[here])] += family.amplitudes(multiples[here], every)
    return Lines(chosen=chosen, amplitudes=amplitudes, changes=np.zeros(chosen.size))


def _varying_lines(
    samples: AngleSamples, candidates: Candidates, instants_s: Array, prior: Lines, *, most: float
) -> tuple[Lines, str]:
    """Return the lines of a signal, of which `prior` are expected, and a sentence.

    The expected lines alone, where they leave at most a share of the power, or more in few places.
    """

    def left_by(lines: Lines) -> tuple[Array, Array]:
        """Return the power between some instants without the lines, and all of it."""
        begins = compared_from(instants_s)
        ends = lines.amplitudes[:, :, np.add.outer(begins, [0, 1])]
        return powers(samples, candidates.values[lines.chosen], ends, instants_s=instants_s, begins=begins)

    left, whole = left_by(prior)
    alone = share_of_power(left, whole)
    if alone <= most or (alone < _RINGS and np.mean(left > most * whole) <= _SELDOM):
        return prior, about_expected(prior, alone)
    if alone > _USELESS:  # resonances are passed too fast for the lines that are expected
        prior = Lines(chosen=prior.chosen[:0], amplitudes=prior.amplitudes[:, :0], changes=prior.changes[:0])
    fitted, window = varying_fit(samples, candidates, instants_s, prior)
    return fitted, about_fit(fitted, window, prior, left=share_of_power(*left_by(fitted)))
