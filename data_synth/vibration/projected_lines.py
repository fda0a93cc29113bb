"""Lines that are projected from the clean signal of gears in motion, and the power that lines leave of it."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.vibration.line_candidates import Candidates
from data_synth.vibration.order_projection import AngleSamples, Projection, Window, sum_of_lines

BELOW_NYQUIST = 0.98
EXPECTED_FLOOR = 5e-5  # of the loudest expected line
FLOOR = 1e-3  # of the loudest line, over time and channels: lines of meshes and of gears with each other
FAULT_FLOOR = 1e-2  # of the loudest line of the same damaged gear
_LEAST = 1e-5  # of the loudest line of all: what the error of the integration makes is no line
_MOST = 8192  # lines, the loudest: those of planet gears with damage, in turn with all others, may be more
_LONGEST_CELLS = 1 << 20  # of a window in steady motion
_SEARCHED = 9  # windows in which lines are looked for
_APART_STEADY = (1.5, 1.0)
"""Periods of the window that two lines of constant amplitude are apart to be fitted together: of nearer candidates that
which is louder alone stands for both. Where that leaves much, it was the wrong one, and nearer ones are fitted."""
_LEFT_STEADY = 1e-3  # of the power
_APART, RIDGE = 1.0, 0.003
"""The same of amplitudes of second degree, and the ridge that keeps their least squares determined. Without it the
condition number is 5 for lines 3.5 periods apart, 300 for 3 and 2e9 for 2.5; lines so far apart leave gaps between
them, and what amplitudes that change within a window put there is lost. Lines 3 periods apart can represent any signal;
nearer ones share it, the ridge preferring amplitudes that change little."""
DEGREE = 2  # of amplitudes in a window
_ALONE = 0.3  # of the floor, by which a candidate is loud where it stands alone
_TRIALS = 17  # intervals between two instants at which windows are compared
_MESH_FIRST = 3.0  # times its size a mesh's line counts beside others: what stands alone in a window is not separated
_LONGEST_SHARE = 1.25  # of which the record is at least as long as the longest window in varying motion
_DETERMINED = 0.01  # of the RMS of a line
_NO_USE = 4.0  # times the least error: shorter windows are worse still
_PERIODS = 0.75  # of the smallest base order: the shortest window that is halved


@dataclass(frozen=True, kw_only=True)
class Lines:
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

    def plus(self, others: "Lines", *, times: float = 1.0) -> "Lines":
        """Return the sum with others that have no window, so many times as large."""
        every = np.union1d(self.chosen, others.chosen)
        changes = np.zeros(every.size)
        changes[np.searchsorted(every, self.chosen)] = self.changes
        return Lines(chosen=every, amplitudes=self.on(every) + times * others.on(every), changes=changes)


def without(lines: Lines, samples: AngleSamples, candidates: Candidates, instants_s: Array) -> AngleSamples:
    """Return samples less lines."""
    if not lines.chosen.size:
        return samples
    signal = sum_of_lines(
        candidates.values[lines.chosen],
        lines.amplitudes,
        instants_s=instants_s,
        revolutions=samples.revolutions,
        times_s=np.arange(samples.signal.shape[1]) / samples.rate_hz,
    )
    return replace(samples, signal=samples.signal - signal)


# ---- constant speed, torque and damage ---------------------------------------------------------------------------


def steady_fit(samples: AngleSamples, candidates: Candidates, instants_s: Array) -> tuple[Lines, float, str]:
    """Return the lines of steady motion, the share of the power that they leave, and a sentence."""
    begins = compared_from(instants_s)
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
    capped = "the loudest " if chosen.size == _MOST else ""
    about = (
        f"{capped}{chosen.size} lines of the steady motion, in a window of {length_rev:.4g} rev: other lines add less "
        f"than 2e-5; {_floors()}; lines nearer than {apart / length_rev:.2g} orders count as one; they leave "
        f"{100 * left:.2g} % of the power"
    )
    repeated = np.repeat(lines, instants_s.size, axis=2)
    return Lines(chosen=chosen, amplitudes=repeated, changes=np.zeros(chosen.size)), left, about


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
    trial: _Trial, halved: _Trial, prior: Lines, *, at: NDArray[np.int_], orders: Array
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


def varying_fit(samples: AngleSamples, candidates: Candidates, instants_s: Array, prior: Lines) -> tuple[Lines, Window]:
    """Return the expected lines and what the signal adds to them and to others, and the window of that.

    What the signal has beside the expected lines is fitted with all lines together in windows of one length, so that
    what one line does not take another does, and the lines add up to the signal even where their split is uncertain.
    Where a line is above the band, nothing is added to it.
    """
    speed_hz, top_hz = samples.speed_hz(instants_s), BELOW_NYQUIST * samples.rate_hz / 2
    samples = replace(samples, top_order=max(samples.top_order, float(candidates.values[-1])))
    samples = without(prior, samples, candidates, instants_s)
    first, last = samples.span_rev
    instants_rev = samples.revolutions(instants_s)
    longest = min((last - first) / _LONGEST_SHARE, _LONGEST_CELLS / 4 / samples.top_order)
    begins = compared_from(instants_s)
    trials = np.union1d(begins, begins + 1)
    loud, sizes = _loud_anywhere(samples, candidates, instants_s, longest)
    # the louder of two stands for both; a mesh also for a neighbour that looks as loud because it is so near
    weight = sizes[loud] * np.where(candidates.ranks[loud] == 0, _MESH_FIRST, 1.0)
    places = np.searchsorted(trials, np.add.outer(begins, [0, 1]))

    def tried(length_rev: float) -> _Trial:
        window = Window(length_rev=length_rev, degree=DEGREE, ridge=RIDGE)
        apart = _APART / length_rev
        chosen = loud[
            np.sort(_separate(candidates.values[loud], weight, np.zeros_like(loud), np.arange(loud.size), apart))
        ]
        projection = Projection(samples=samples, orders=candidates.values[chosen], window=window)
        amplitudes = projection.amplitudes(instants_rev[trials])
        amplitudes *= np.multiply.outer(projection.orders, speed_hz[trials]) <= top_hz
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
    heard = np.multiply.outer(projection.orders, speed_hz) <= top_hz
    amplitudes[:, np.searchsorted(every, best.chosen)] += projection.amplitudes(instants_rev) * heard
    return Lines(chosen=every, amplitudes=amplitudes, changes=relative), best.window


def about_expected(lines: Lines, left: float) -> str:
    """Return a sentence on expected lines, which leave a share of the power."""
    return (
        f"{lines.chosen.size} lines against time, of a quasi-static response and what it lags behind the speed, down "
        f"to {EXPECTED_FLOOR:g} of the loudest; they leave {100 * left:.2g} % of the power"
    )


def about_fit(lines: Lines, window: Window, prior: Lines, *, left: float) -> str:
    """Return a sentence on lines that are not all determined, and leave a share of the power."""
    powers = np.mean(np.abs(lines.amplitudes) ** 2, axis=(0, 2))
    share = 100 * powers[lines.changes < _DETERMINED].sum() / powers.sum()
    return (
        f"{lines.chosen.size} lines against time, {prior.chosen.size} of them by a quasi-static response and what the "
        f"signal without that adds: of second degree in windows of {window.length_rev:.3g} rev, "
        f"fitted together; halving the window changes a line by truth_line_change, lines of {share:.2f} % of the power "
        f"by less than {100 * _DETERMINED:g} %; {_floors()}, each by itself in what is left, expected ones to "
        f"{EXPECTED_FLOOR:g}; of lines nearer than "
        f"{_APART / window.length_rev:.3g} orders the louder has what is added; they leave {100 * left:.2g} % of the "
        "power"
    )


def _loud_anywhere(
    samples: AngleSamples, candidates: Candidates, instants_s: Array, longest_rev: float
) -> tuple[NDArray[np.int_], Array]:
    """Return the rising numbers of candidates that are loud where each stands alone, and the sizes of all."""
    first, last = samples.span_rev
    window = Window(length_rev=min(longest_rev, 2 * (last - first) / _SEARCHED), degree=0)
    centres_rev, instants_rev = _tiles(samples, window.length_rev, 2 * _SEARCHED), samples.revolutions(instants_s)
    # in each window those that are in the band all over it
    sides = np.clip(np.add.outer(centres_rev, np.linspace(-0.5, 0.5, 9) * window.length_rev), *instants_rev[[0, -1]])
    fastest_hz = np.max(np.interp(sides, instants_rev, samples.speed_hz(instants_s)), axis=1)
    highest = BELOW_NYQUIST * samples.rate_hz / 2 / fastest_hz
    sizes, bounds = np.zeros(candidates.values.size), np.unique(np.minimum(highest, candidates.values[-1] + 1))
    for low, high in zip([0.0, *bounds[:-1]], bounds, strict=True):
        some = np.flatnonzero((candidates.values > low) & (candidates.values <= high))
        alone = Projection(samples=samples, orders=candidates.values[some], window=window)
        sizes[some] = np.max(np.sqrt(alone.power(centres_rev[highest >= high])), axis=0)
    return _loud(sizes, candidates.ranks, _ALONE), sizes


# ---- the power that lines leave --------------------------------------------------------------------------------------


def compared_from(instants_s: Array) -> NDArray[np.int_]:
    """Return the numbers of the instants, even in time, from which to the next ones signals are compared."""
    times_s = np.linspace(instants_s[0], instants_s[-2], _TRIALS)
    return np.unique(np.searchsorted(instants_s[:-1], times_s - 1e-9 * instants_s[-1]))


def _left(
    samples: AngleSamples, orders: Array, amplitudes: ComplexArray, *, instants_s: Array, begins: NDArray[np.int_]
) -> float:
    """Return the share of the power that lines (channel, k, begin, 2) leave between instants and the next ones."""
    return share_of_power(*powers(samples, orders, amplitudes, instants_s=instants_s, begins=begins))


def share_of_power(left: Array, whole: Array) -> float:
    """Return the share of all power that is left."""
    return float(left.sum() / max(whole.sum(), np.finfo(float).tiny))


def powers(
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
