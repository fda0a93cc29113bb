"""Lines of gears in motion: their orders, and their complex amplitudes against time, projected from the clean signal.

Of the orders that the drawing gives (`data_synth.vibration.line_candidates`) those that are loud are kept. In varying
motion the lines that are expected of the drive and the drawing are the signal but for a small part; where they are not,
a projection finds what is left without them.
"""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.expected_response import ExpectedLines
from data_synth.vibration.free_vibration import FreeVibration, Modes, Span, free_vibration, ringing_spans
from data_synth.vibration.line_candidates import Candidates, candidates_of
from data_synth.vibration.order_projection import AngleSamples, Projection, Window, sum_of_lines

FLOOR = 1e-3  # of the loudest line, over time and channels: lines of meshes and of gears with each other
FAULT_FLOOR = 1e-2  # of the loudest line of the same damaged gear
LOWER_SPEEDS = 6.0  # times the highest order at the highest speed are expected lines of lower speeds, at most
EXPECTED_FLOOR = 5e-5  # of the loudest expected line
_LEAST = 1e-5  # of the loudest line of all: what the error of the integration makes is no line
_MOST = 2048  # lines
_STEADY = 1e-12  # of the speed: what rounding may change
_BELOW_NYQUIST = 0.98
_LONGEST_CELLS = 1 << 20  # of a window in steady motion
_SEARCHED = 9  # windows in which lines are looked for
_APART_STEADY = (1.5, 1.0)
"""Periods of the window that two lines of constant amplitude are apart to be fitted together: of nearer candidates that
which is louder alone stands for both. Where that leaves much, it was the wrong one, and nearer ones are fitted."""
_LEFT_STEADY = 1e-3  # of the power
_APART, _RIDGE = 1.0, 0.003
"""The same of amplitudes of second degree, and the ridge that keeps their least squares determined. Without it the
condition number is 5 for lines 3.5 periods apart, 300 for 3 and 2e9 for 2.5; lines so far apart leave gaps between
them, and what amplitudes that change within a window put there is lost. Lines 3 periods apart can represent any signal;
nearer ones share it, the ridge preferring amplitudes that change little."""
_DEGREE = 2  # of amplitudes in a window
_ALONE = 0.3  # of the floor, by which a candidate is loud where it stands alone
_TRIALS = 17  # intervals between two instants at which windows are compared
_LOOKED = 51  # instants at which expected lines are looked for
_MESH_FIRST = 3.0  # times its size a mesh's line counts beside others: what stands alone in a window is not separated
_LONGEST_SHARE = 1.25  # of which the record is at least as long as the longest window in varying motion
_DETERMINED = 0.01  # of the RMS of a line
_SMALL = 0.05
"""Of the power: what expected lines may leave of it. Windows that find more elsewhere in sound than in damaged gears
make more of it than a fault has."""
_USELESS = 0.9  # of the power: lines that leave more of it are not what is there, and may be anything in between
_RINGS, _SELDOM = 0.5, 0.125
"""Of the power, what expected lines may leave of it in few places, such a share of them: it rings, and is none."""
_RUNG = 0.01  # of the power after a jump, from which what rings there is stated
_STARTS = 2.0  # times the speed
_NO_USE = 4.0  # times the least error: shorter windows are worse still
_PERIODS = 0.75  # of the smallest base order: the shortest window that is halved


@dataclass(frozen=True, kw_only=True)
class GearLine:
    """A line of gears in motion.

    Attributes
    ----------
    order : Fraction
    component, kind : str
    amplitude : (channel, instant) complex array
    change : float
        RMS over time of what halving the window changes, over the RMS of the line; zero where Z has no window, in
        steady motion and of a line that is only what is expected. Where the window does not separate an expected line
        from a neighbour, all that the projection adds to the neighbour; 1 where half the window does not separate a
        line that is not expected.
    """

    order: Fraction
    component: str
    kind: str
    amplitude: ComplexArray
    change: float


@dataclass(frozen=True, kw_only=True)
class GearLines:
    """Lines of gears in motion, by rising order, a sentence about their error, and what rings beside them."""

    lines: tuple[GearLine, ...]
    about: str
    ringing: FreeVibration | None = None


def gear_lines(
    prepared: PreparedScene,
    signal: Array,
    *,
    expected: Callable[[], tuple[ExpectedLines, ...]] = tuple,
    modes: Callable[[], Modes] | None = None,
) -> GearLines:
    """Return the loud lines in the channels of gears in motion, (channel, n), at the instants of the truth.

    At constant speed, torque and damage the window is the whole record, and Z is constant. Else Z is that of the
    expected lines, which has no window. Where they leave more than 5 % of the power, and not in few places, as what
    rings after a step does, or anything where damage grows at constant speed and torque, what the signal without them
    adds to all lines is fitted as well: polynomials of second degree in angle within windows; their length is that, of
    several, with the least error: the share of the lines' power that is in lines which half the window changes by 1 %
    or more, plus the share of what the expected lines leave of the signal that all lines leave. The former alone would
    have long windows where all that a projection adds is below 1 %.

    Where the natural `modes` ring, after a jump of speed or torque or of its rate, or anywhere if expected lines leave
    more than 5 % of the power there, that is stated beside the lines; nothing is projected where both leave less.
    """
    scene, angle = prepared.scene, prepared.drive.angle
    turning = np.sign(prepared.speed_hz[prepared.speed_hz != 0])
    if not turning.size or np.ptp(turning) or not signal.any():
        return GearLines(lines=(), about="left out: the shaft turns back, or nothing moves")
    sign = float(turning[0])
    top = _BELOW_NYQUIST * scene.rate_hz / 2 / angle.top_speed_hz(0.0, scene.duration_s)
    samples = AngleSamples(
        signal=signal,
        rate_hz=scene.rate_hz,
        revolutions=lambda times_s: sign * angle.revolutions(times_s),
        speed_hz=lambda times_s: np.maximum(sign * angle.speed_hz(times_s), 0.0),
        top_order=top,
    )
    steady, ringing = is_steady(prepared), None
    fastest, slowest = (float(each(np.abs(prepared.speed_hz[prepared.speed_hz != 0]))) for each in (np.max, np.min))
    candidates = candidates_of(scene, top=top * min(fastest / slowest, LOWER_SPEEDS), mixed=steady)
    if steady:
        chosen, amplitudes, changes, about = _steady_fit(samples, candidates, prepared.instants_s)
    else:
        prior = _prior(expected(), candidates, speeds=prepared.speed_hz, channels=signal.shape[0])
        # at constant speed and torque, sound gears have projected lines: of growing damage the difference counts
        most = 0.0 if _drive_is_steady(prepared) else _SMALL
        drive = _Drive(
            changes_s=_changes_s(scene),
            instants_s=prepared.instants_s,
            speed_hz=np.abs(prepared.speed_hz),
            modes=None if _drive_is_steady(prepared) else modes,
        )
        found, ringing, about = _varying_lines(samples, candidates, drive, prior, most=most)
        chosen, amplitudes, changes = found.chosen, found.amplitudes, found.changes
    if sign < 0:
        amplitudes = amplitudes.conj()
    lines = tuple(
        GearLine(
            order=candidates.order(number),
            component=candidates.sources[number][0],
            kind=candidates.sources[number][1],
            amplitude=amplitudes[:, row],
            change=float(changes[row]),
        )
        for row, number in enumerate(chosen.tolist())
    )
    return GearLines(lines=lines, about=about, ringing=ringing)


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


# ---- constant speed, torque and damage ---------------------------------------------------------------------------


def _steady_fit(
    samples: AngleSamples, candidates: Candidates, instants_s: Array
) -> tuple[NDArray[np.int_], ComplexArray, Array, str]:
    """Return the numbers of the kept candidates, Z (channel, line, instant), no changes, and a sentence."""
    begins = _begins(instants_s)
    first, last = samples.span_rev
    length_rev = min(last - first, _LONGEST_CELLS / 4 / float(candidates.values[-1]))
    window = Window(length_rev=length_rev, degree=0)
    centres_rev = _tiles(samples, length_rev, np.inf)

    def fitted(chosen: NDArray[np.int_]) -> ComplexArray:
        return Projection(samples=samples, orders=candidates.values[chosen], window=window).mean(centres_rev)[..., None]

    tried = []
    for apart in _APART_STEADY:
        chosen, lines = _above_floor(_loud_alone(samples, candidates, window, apart), candidates.ranks, fitted)
        ends = np.broadcast_to(lines[..., None], (*lines.shape[:2], begins.size, 2))
        left = _left(samples, candidates.values[chosen], ends, instants_s=instants_s, begins=begins)
        tried.append((left, apart, chosen, lines))
        if left < _LEFT_STEADY:
            break
    left, apart, chosen, lines = min(tried, key=lambda each: each[0])
    about = (
        f"{chosen.size} lines of the steady motion, in a window of {length_rev:.4g} rev: other lines add less than "
        f"2e-5; {_floors()}; lines nearer than {apart / length_rev:.2g} orders count as one; they leave "
        f"{100 * left:.2g} % of the power"
    )
    return chosen, np.repeat(lines, instants_s.size, axis=2), np.zeros(chosen.size), about


def _tiles(samples: AngleSamples, length_rev: float, most: float) -> Array:
    """Return the middles of windows that cover the signal, the last of them at its end, evenly thinned to `most`."""
    first, last = samples.span_rev
    count = max(1, int(min(np.ceil((last - first) / length_rev - 1e-9) * 2 - 1, most)))
    return np.asarray(np.linspace(first + length_rev / 2, max(first + length_rev / 2, last - length_rev / 2), count))


def _floors() -> str:
    return f"down to {FLOOR:g} of the loudest line, and for a damaged gear to {FAULT_FLOOR:g} of the loudest of its own"


def _loud_alone(samples: AngleSamples, candidates: Candidates, window: Window, apart: float) -> NDArray[np.int_]:
    """Return the numbers of candidates that are loud where each stands alone, and `apart` periods from each other."""
    everywhere = Projection(samples=samples, orders=candidates.values, window=window)
    sizes = np.max(np.sqrt(everywhere.power(_tiles(samples, window.length_rev, _SEARCHED))), axis=0)
    loud = _loud(sizes, candidates.ranks, _ALONE)
    return np.sort(_separate(candidates.values, sizes, candidates.ranks, loud, apart / window.length_rev))


def _above_floor(
    chosen: NDArray[np.int_], ranks: NDArray[np.int_], lines_of: Callable[[NDArray[np.int_]], ComplexArray]
) -> tuple[NDArray[np.int_], ComplexArray]:
    """Return those of chosen lines that are loud, and their Z (channel, line, instant) as `lines_of` gives them.

    Twice: once more without those that were only the leakage of their neighbours.
    """
    for _ in range(2):
        lines = lines_of(chosen)
        sizes = np.max(np.abs(lines), axis=(0, 2))
        loud = _loud(sizes, ranks[chosen], 1.0)
        loud = np.sort(loud[np.argsort(-sizes[loud], kind="stable")[:_MOST]])
        if loud.size == chosen.size:
            break
        chosen, lines = chosen[loud], lines[:, loud]
    return chosen, lines


def _loud(sizes: Array, ranks: NDArray[np.int_], share: float) -> NDArray[np.int_]:
    """Return the numbers of sizes above a share of their floors."""
    floors = np.full(sizes.size, FLOOR * np.max(sizes, initial=0.0))
    of_fault = ranks == 1
    floors[of_fault] = max(
        FAULT_FLOOR * float(np.max(sizes[of_fault], initial=0.0)), _LEAST * float(np.max(sizes, initial=0.0))
    )
    floors[of_fault] = np.minimum(floors[of_fault], FLOOR * np.max(sizes, initial=0.0))
    return np.flatnonzero((sizes > share * floors) & (sizes > 0))


def _separate(
    orders: Array, sizes: Array, ranks: NDArray[np.int_], numbers: NDArray[np.int_], apart: float
) -> NDArray[np.int_]:
    """Return the numbers of lines that are at least `apart`, zero included: lower ranks first, then larger sizes."""
    kept, taken = [0.0], list[int]()  # the mean is fitted with them
    for number in numbers[np.lexsort((-sizes[numbers], ranks[numbers]))].tolist():
        order = float(orders[number])
        place = bisect_left(kept, order)
        if order - kept[place - 1] >= apart and (place == len(kept) or kept[place] - order >= apart):
            kept.insert(place, order)
            taken.append(number)
    return np.array(taken, dtype=np.int64)


# ---- varying speed, torque or damage ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Lines:
    """Lines: rising numbers of candidates, Z (channel, line, instant), and `GearLine.change` (line,)."""

    chosen: NDArray[np.int_]
    amplitudes: ComplexArray
    changes: Array

    def on(self, numbers: NDArray[np.int_]) -> ComplexArray:
        """Return Z (channel, line, instant) of some candidates: zero of those that it does not have."""
        found = np.zeros((self.amplitudes.shape[0], numbers.size, self.amplitudes.shape[2]), dtype=np.complex128)
        here = np.isin(self.chosen, numbers)
        found[:, np.searchsorted(numbers, self.chosen[here])] = self.amplitudes[:, here]
        return found


def _prior(expected: tuple[ExpectedLines, ...], candidates: Candidates, *, speeds: Array, channels: int) -> _Lines:
    """Return the expected lines that are candidates and loud."""
    few = np.unique(np.linspace(0, speeds.size - 1, _LOOKED).round().astype(int))
    found = np.zeros((channels, candidates.numbers.size, few.size), dtype=np.complex128)
    places = list[tuple[NDArray[np.int_], NDArray[np.int_]]]()
    for family in expected:
        step = family.base_order / candidates.unit  # of candidates, only multiples of its denominator may be
        multiples = np.arange(step.denominator, family.size + 1, step.denominator)
        numbers = multiples // step.denominator * step.numerator
        place = np.minimum(np.searchsorted(candidates.numbers, numbers), candidates.numbers.size - 1)
        there = candidates.numbers[place] == numbers
        places.append((multiples[there], place[there]))
        found[:, place[there]] += family.steady(multiples[there], few)
    sizes = np.max(np.abs(found), axis=(0, 2))
    # one floor for all: where sound and damaged gears have the same lines, those below it cancel in the difference
    chosen = np.flatnonzero(sizes > EXPECTED_FLOOR * np.max(sizes, initial=0.0))
    amplitudes, every = np.zeros((channels, chosen.size, speeds.size), dtype=np.complex128), np.arange(speeds.size)
    for family, (multiples, place) in zip(expected, places, strict=True):
        here = np.isin(place, chosen)
        amplitudes[:, np.searchsorted(chosen, place[here])] += family.amplitudes(multiples[here], every)
    return _Lines(chosen=chosen, amplitudes=amplitudes, changes=np.zeros(chosen.size))


@dataclass(frozen=True, kw_only=True)
class _Drive:
    """What may let modes ring.

    Attributes
    ----------
    changes_s : (i,) array
        Times at which speed or torque, or the rate of one, jumps.
    instants_s, speed_hz : (instant,) arrays
        Of the truth, and the speed of the reference, not below zero.
    modes : callable, or None
        Gives the natural modes; None: none of them rings.
    """

    changes_s: Array
    instants_s: Array
    speed_hz: Array
    modes: Callable[[], Modes] | None

    def starts(self) -> bool:
        """Return whether the speed rises by a factor while modes ring: resonances are passed, and ring on."""
        if self.modes is None:
            return False
        later_hz = np.interp(self.instants_s + self.modes().longest_s, self.instants_s, self.speed_hz)
        return bool(np.any(later_hz > _STARTS * self.speed_hz))


def _changes_s(scene: Scene) -> Array:
    """Return the times in s at which speed or torque, or the rate of one, jumps; a start is one."""
    histories = [np.array(each.knots)[:, 0] for each in (scene.speed, scene.torque) if each and len(each.knots) > 1]
    knots = [each for each in histories if each.size <= scene.truth_times]  # a measured history is knots alone
    starts = [np.zeros(1)] if scene.speed.run_up is not None else []
    times_s = np.unique(np.concatenate([*starts, *knots, np.zeros(0)]))
    return np.asarray(times_s[((times_s > 0) | bool(starts)) & (times_s >= 0) & (times_s < scene.duration_s)])


def _varying_lines(
    samples: AngleSamples, candidates: Candidates, drive: _Drive, prior: _Lines, *, most: float
) -> tuple[_Lines, FreeVibration | None, str]:
    """Return the lines of a signal, of which `prior` are expected, what rings, and a sentence.

    The expected lines alone, where they, or they and what rings, leave at most a share of the power.
    """
    instants_s, begins = drive.instants_s, _begins(drive.instants_s)
    places = np.add.outer(begins, [0, 1])

    ends = prior.amplitudes[:, :, places]
    left, whole = _powers(samples, candidates.values[prior.chosen], ends, instants_s=instants_s, begins=begins)
    alone = _share(left, whole)
    everywhere = alone > most and not (alone < _RINGS and np.mean(left > most * whole) <= _SELDOM)
    starts = everywhere and drive.starts()
    fair = _where_fair(samples, candidates, instants_s, prior) if starts else prior
    ringing, after = None, 0.0
    if starts or not everywhere:
        ringing, after = _ringing(samples, candidates, drive, fair, everywhere=starts)
        after /= max(float(np.sum(samples.signal**2)), np.finfo(float).tiny)
    if everywhere and (ringing is None or after > most):
        if alone > _USELESS:  # resonances are passed too fast for the lines that are expected
            prior = _Lines(chosen=prior.chosen[:0], amplitudes=prior.amplitudes[:, :0], changes=prior.changes[:0])
        fitted, window = _varying_fit(samples, candidates, instants_s, prior)
        return fitted, None, _about_fit(fitted, window, prior)
    share = after if everywhere else alone + after
    rung = "" if ringing is None else f"; beside them {ringing.frequencies_hz.size} modes ring (truth_ringing)"
    about = (
        f"{prior.chosen.size} lines against time, of a quasi-static response and what it lags behind the speed, down "
        f"to {EXPECTED_FLOOR:g} of the loudest{rung}; they leave {100 * share:.2g} % of the power"
    )
    return fair, ringing, about


def _where_fair(samples: AngleSamples, candidates: Candidates, instants_s: Array, prior: _Lines) -> _Lines:
    """Return lines without amplitude about instants between which they leave more than there is.

    So they do where the speed passes a resonance faster than it rings, as in a start: it never has their amplitude.
    """
    pairs = np.lib.stride_tricks.sliding_window_view(prior.amplitudes, 2, axis=2)
    orders, every = candidates.values[prior.chosen], np.arange(instants_s.size - 1)
    left, whole = _powers(samples, orders, pairs, instants_s=instants_s, begins=every)
    fair = np.ones(instants_s.size)
    unfair = np.flatnonzero(left > whole)
    fair[unfair] = fair[unfair + 1] = 0.0
    return replace(prior, amplitudes=prior.amplitudes * fair)


def _ringing(
    samples: AngleSamples, candidates: Candidates, drive: _Drive, prior: _Lines, *, everywhere: bool
) -> tuple[FreeVibration | None, float]:
    """Return the free vibration after changes, or everywhere, and the sum of squares that is left there.

    Only where expected lines leave a hundredth of the power.
    """
    if drive.modes is None or not (everywhere or drive.changes_s.size):
        return None, 0.0
    modes, instants_s = drive.modes(), drive.instants_s
    count, rate_hz, spans, least = samples.signal.shape[1], samples.rate_hz, list[Span](), 0.0
    for first, end in ringing_spans(drive.changes_s, modes, samples=count, rate_hz=rate_hz, everywhere=everywhere):
        begin, last = np.searchsorted(instants_s, [first / rate_hz, (end - 1) / rate_hz])
        near = slice(max(int(begin) - 1, 0), int(last) + 1)
        lines = sum_of_lines(
            candidates.values[prior.chosen],
            prior.amplitudes[:, :, near],
            instants_s=instants_s[near],
            revolutions=samples.revolutions,
            times_s=np.arange(first, end) / rate_hz,
        )
        left = samples.signal[:, first:end] - lines
        if np.sum(left**2) > _RUNG * np.sum(samples.signal[:, first:end] ** 2):
            spans.append(Span(first=first, left=left))
        else:
            least += float(np.sum(left**2))
    found = free_vibration(spans, modes, rate_hz=rate_hz, top_hz=_BELOW_NYQUIST * rate_hz / 2) if spans else None
    return found, least + (found.left if found else sum(float(np.sum(span.left**2)) for span in spans))


def _begins(instants_s: Array) -> NDArray[np.int_]:
    """Return the numbers of the instants, even in time, from which to the next ones signals are compared."""
    times_s = np.linspace(instants_s[0], instants_s[-2], _TRIALS)
    return np.unique(np.searchsorted(instants_s[:-1], times_s - 1e-9 * instants_s[-1]))


def _left(
    samples: AngleSamples, orders: Array, amplitudes: ComplexArray, *, instants_s: Array, begins: NDArray[np.int_]
) -> float:
    """Return the share of the power that lines (channel, k, begin, 2) leave between instants and the next ones."""
    return _share(*_powers(samples, orders, amplitudes, instants_s=instants_s, begins=begins))


def _share(left: Array, whole: Array) -> float:
    """Return the share of all power that is left."""
    return float(left.sum() / max(whole.sum(), np.finfo(float).tiny))


def _powers(
    samples: AngleSamples, orders: Array, amplitudes: ComplexArray, *, instants_s: Array, begins: NDArray[np.int_]
) -> tuple[Array, Array]:
    """Return the sums of squares (begin,) that lines (channel, k, begin, 2) leave up to the next instants, and all."""
    times_s = np.arange(samples.signal.shape[1]) / samples.rate_hz
    left, whole = np.zeros((2, begins.size))
    edges = np.searchsorted(times_s, instants_s)
    for number, begin in enumerate(begins.tolist()):
        here = slice(*edges[begin : begin + 2])
        found = sum_of_lines(
            orders,
            amplitudes[:, :, number],
            instants_s=instants_s[begin : begin + 2],
            revolutions=samples.revolutions,
            times_s=times_s[here],
        )
        left[number] = np.sum((samples.signal[:, here] - found) ** 2)
        whole[number] = np.sum(samples.signal[:, here] ** 2)
    return left, whole


@dataclass(frozen=True, kw_only=True)
class _Trial:
    """What a projection in windows of one length adds to the expected lines, at the trial instants.

    Attributes
    ----------
    window : Window
    chosen : (line,) int array
        Rising numbers of candidates.
    amplitudes : (channel, line, trial) complex array
    left : float
        Power between some of the instants without all lines, over that without the expected ones.
    """

    window: Window
    chosen: NDArray[np.int_]
    amplitudes: ComplexArray
    left: float

    def of(self, numbers: NDArray[np.int_]) -> ComplexArray:
        """Return what it adds to some candidates, (channel, line, trial): zero to those that it does not have."""
        place = np.minimum(np.searchsorted(self.chosen, numbers), self.chosen.size - 1)
        return np.asarray(self.amplitudes[:, place] * (self.chosen[place] == numbers)[:, None])


def _changes(
    trial: _Trial, halved: _Trial, prior: _Lines, *, at: NDArray[np.int_], orders: Array
) -> tuple[Array, float]:
    """Return by how much half the window changes each line, over its RMS, and the share of power that is undetermined.

    Lines are those of the trial and the expected ones, rising. An expected line that the trial does not separate may
    have all that it adds to the nearest line.
    """
    every = np.union1d(trial.chosen, prior.chosen)
    whole, errors = trial.of(every), trial.of(every) - halved.of(every)
    whole[:, np.searchsorted(every, prior.chosen)] += prior.amplitudes[:, :, at]
    apart = np.flatnonzero(~np.isin(every, trial.chosen))
    if apart.size:
        own = orders[trial.chosen]
        after = np.clip(np.searchsorted(own, orders[every[apart]]), 1, max(own.size - 1, 1))
        nearer = after - (
            orders[every[apart]] - own[after - 1] < own[np.minimum(after, own.size - 1)] - orders[every[apart]]
        )
        errors[:, apart] = trial.amplitudes[:, np.minimum(nearer, own.size - 1)]
    # of all instants alike: the first and the last interval stand for half as many
    weights = np.where((at <= 1) | (at >= at[-1] - 1), 0.5, 1.0)
    squares = [np.sum(np.abs(part) ** 2 @ weights, axis=0) for part in (errors, whole)]
    changes = np.sqrt(squares[0] / np.maximum(squares[1], np.finfo(float).tiny))
    power = float(squares[1].sum())
    return changes, float(squares[1][changes >= _DETERMINED].sum()) / power if power else 1.0


def _varying_fit(
    samples: AngleSamples, candidates: Candidates, instants_s: Array, prior: _Lines
) -> tuple[_Lines, Window]:
    """Return the expected lines and what the signal adds to them and to others, and the window of that.

    What the signal has beside the expected lines is fitted with all lines together in windows of one length, so that
    what one line does not take another does, and the lines add up to the signal even where their split is uncertain.
    """
    if prior.chosen.size:
        expected = sum_of_lines(
            candidates.values[prior.chosen],
            prior.amplitudes,
            instants_s=instants_s,
            revolutions=samples.revolutions,
            times_s=np.arange(samples.signal.shape[1]) / samples.rate_hz,
        )
        samples = replace(samples, signal=samples.signal - expected)
    first, last = samples.span_rev
    instants_rev = samples.revolutions(instants_s)
    longest = min((last - first) / _LONGEST_SHARE, _LONGEST_CELLS / 4 / samples.top_order)
    begins = _begins(instants_s)
    trials = np.union1d(begins, begins + 1)
    loud, sizes = _loud_anywhere(samples, candidates, longest)
    # the louder of two stands for both; a mesh also for a neighbour that looks as loud because it is so near
    weight = sizes[loud] * np.where(candidates.ranks[loud] == 0, _MESH_FIRST, 1.0)
    places = np.searchsorted(trials, np.add.outer(begins, [0, 1]))

    def tried(length_rev: float) -> _Trial:
        window = Window(length_rev=length_rev, degree=_DEGREE, ridge=_RIDGE)
        apart = _APART / length_rev
        chosen = loud[
            np.sort(_separate(candidates.values[loud], weight, np.zeros_like(loud), np.arange(loud.size), apart))
        ]
        projection = Projection(samples=samples, orders=candidates.values[chosen], window=window)
        amplitudes = projection.amplitudes(instants_rev[trials])
        left = _left(samples, projection.orders, amplitudes[:, :, places], instants_s=instants_s, begins=begins)
        return _Trial(window=window, chosen=chosen, amplitudes=amplitudes, left=left)

    trial, best, least = tried(longest), None, np.inf
    while best is None or trial.window.length_rev >= _PERIODS / candidates.spacing:
        halved = tried(trial.window.length_rev / 2)
        changes, undetermined = _changes(trial, halved, prior, at=trials, orders=candidates.values)
        error = undetermined + trial.left
        if best is None or error < least:
            best, relative, least = trial, changes, error
        if error > _NO_USE * least:
            break
        trial = halved
    projection = Projection(samples=samples, orders=candidates.values[best.chosen], window=best.window)
    every = np.union1d(best.chosen, prior.chosen)
    amplitudes = prior.on(every)
    amplitudes[:, np.searchsorted(every, best.chosen)] += projection.amplitudes(instants_rev)
    return _Lines(chosen=every, amplitudes=amplitudes, changes=relative), best.window


def _about_fit(lines: _Lines, window: Window, prior: _Lines) -> str:
    """Return a sentence on lines that are not all determined."""
    powers = np.mean(np.abs(lines.amplitudes) ** 2, axis=(0, 2))
    share = 100 * powers[lines.changes < _DETERMINED].sum() / powers.sum()
    return (
        f"{lines.chosen.size} lines against time, {prior.chosen.size} of them by a quasi-static response and what the "
        f"signal without that adds: of second degree in windows of {window.length_rev:.3g} rev, "
        f"fitted together; halving the window changes a line by truth_line_change, lines of {share:.2f} % of the power "
        f"by less than {100 * _DETERMINED:g} %; {_floors()}, each by itself in what is left, expected ones to "
        f"{EXPECTED_FLOOR:g}; of lines nearer than "
        f"{_APART / window.length_rev:.3g} orders the louder has what is added"
    )


def _loud_anywhere(samples: AngleSamples, candidates: Candidates, longest_rev: float) -> tuple[NDArray[np.int_], Array]:
    """Return the rising numbers of candidates that are loud where each stands alone, and the sizes of all."""
    first, last = samples.span_rev
    window = Window(length_rev=min(longest_rev, 2 * (last - first) / _SEARCHED), degree=0)
    everywhere = Projection(
        samples=samples, orders=candidates.values[candidates.values < samples.top_order], window=window
    )
    sizes = np.zeros(candidates.values.size)
    sizes[: everywhere.orders.size] = np.max(
        np.sqrt(everywhere.power(_tiles(samples, window.length_rev, 2 * _SEARCHED))), axis=0
    )
    return _loud(sizes, candidates.ranks, _ALONE), sizes
