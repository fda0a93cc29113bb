"""Lines of gears in motion: their orders, and their complex amplitudes against time, projected from the clean signal.

Candidates are the orders that the drawing gives: harmonics of every mesh, of every damaged gear, and of every gear with
pitch deviations, with sidebands at the passes of planets, and in steady motion what two of the first make with each
other. Those that are loud are kept.
"""

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.kinematic.planet_pass import pass_orders
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene
from data_synth.sources.prepared import PreparedScene, mesh_name
from data_synth.vibration.order_projection import AngleSamples, Moments, Part, Projection, Window

FLOOR = 1e-3  # of the loudest line, over time and channels: lines of meshes and of gears with each other
FAULT_FLOOR = 1e-2  # of the loudest line of the same damaged gear
_LEAST = 1e-5  # of the loudest line of all: what the error of the integration makes is no line
_MOST = 2048  # lines
_STEADY = 1e-12  # of the speed: what rounding may change
_BELOW_NYQUIST = 0.98
_MIXED = 4  # multiples of one order beside those of another
_LONGEST_CELLS = 1 << 20  # of a window in steady motion
_SEARCHED = 9  # windows in which lines are looked for
_APART, _APART_STEADY = 3.5, 1.5
"""Periods of the window that two lines have to be apart to be fitted together. With amplitudes of second degree the
condition number of least squares is 5 for lines 3.5 periods apart, 300 for 3 and 2e9 for 2.5."""
_DEGREE = 2  # of amplitudes in a window
_TRIALS = 17  # instants at which windows are compared
_MESH_FIRST = 3.0  # times its size a mesh's line counts beside others: what stands alone in a window is not separated
_LONGEST_SHARE = 1.25  # of which the record is at least as long as the longest window in varying motion
_DETERMINED = 0.01  # of the RMS of a line
_LONGER = 2.0  # times the least change: windows of which halving changes lines by more everywhere are of no use
_PERIODS = 1.5  # of the smallest base order: the shortest window tried, where speed changes within a turn or two


@dataclass(frozen=True, kw_only=True)
class GearLine:
    """A line of gears in motion.

    Attributes
    ----------
    order : Fraction
    component, kind : str
    amplitude : (channel, instant) complex array
    change : float
        RMS over time of what halving the window changes, over the RMS of the line; infinite where half the window does
        not separate it from its neighbour, zero in steady motion.
    """

    order: Fraction
    component: str
    kind: str
    amplitude: ComplexArray
    change: float


@dataclass(frozen=True, kw_only=True)
class GearLines:
    """Lines of gears in motion, by rising order, and a sentence about their error."""

    lines: tuple[GearLine, ...]
    about: str


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """Orders at which lines may be, rising, with their source and rank.

    Attributes
    ----------
    numbers : (k,) int array
        The orders in units of `unit`.
    unit : Fraction
    sources : tuple of (component, kind)
    ranks : (k,) int array
        0 of meshes, 1 of damaged gears, 2 of pitch deviations and of what two of the first make: where a window cannot
        separate two lines, that of the lower rank stands for both.
    spacing : float
        Smallest order of which all multiples are candidates.
    """

    numbers: NDArray[np.int64]
    unit: Fraction
    sources: tuple[tuple[str, str], ...]
    ranks: NDArray[np.int_]
    spacing: float

    @cached_property
    def values(self) -> Array:
        """The orders as numbers, (k,), correctly rounded."""
        return np.asarray(self.numbers * self.unit.numerator / self.unit.denominator)

    def order(self, number: int) -> Fraction:
        """Return the exact order of a candidate."""
        return int(self.numbers[number]) * self.unit


def candidates_of(scene: Scene, *, top: float, mixed: bool) -> Candidates:
    """Return the orders below `top` at which the gears of a scene may have lines.

    Parameters
    ----------
    scene : Scene
    top : float
        Highest order.
    mixed : bool
        Whether sums and differences of two bases are wanted as well.
    """
    meshes, teeth = scene.exact_orders("gear_mesh"), scene.exact_orders("tooth")
    damaged = dict.fromkeys(fault.component for fault in scene.faults if fault.component in teeth)
    bases = [(order, 0, mesh, mesh, "gear_mesh") for mesh, order in meshes.items()]
    # planets are not alike to a sensor: a tooth of a sun or a ring repeats once it has met all of them
    bases += [(teeth[name] / _planets(scene, mesh_name(name)), 1, mesh_name(name), name, "tooth") for name in damaged]
    uneven = [name for name in teeth if name not in damaged and imperfections_of(scene).gears is not None]
    bases += [
        (teeth[name] / _planets(scene, mesh_name(name)), 2, mesh_name(name), name, "pitch_deviation") for name in uneven
    ]
    passes = {mesh: pass_orders(scene, mesh) for mesh in meshes}
    # whole multiples of one fraction: sums of them are whole numbers
    unit = Fraction(
        1, math.lcm(*(order.denominator for order in [*(base[0] for base in bases), *(c for c, _ in passes.values())]))
    )
    found: dict[int, tuple[int, str, str]] = {}

    def add(numbers: NDArray[np.int64], rank: int, component: str, kind: str) -> None:
        sizes = np.abs(numbers.ravel())
        for number in sizes[(sizes > 0) & (sizes <= top / unit)].tolist():
            found.setdefault(number, (rank, component, kind))

    spacing = []
    for order, rank, mesh, component, kind in bases:
        carrier, sides = passes[mesh]
        harmonics = np.arange(int((top + sides * float(carrier)) / float(order)) + 1)
        add(_multiples(order / unit, harmonics, carrier / unit, sides), rank, component, kind)
        spacing += [float(order), *([float(carrier)] if sides else [])]
    if mixed:
        for (order, rank, _, component, kind), (beside, other, *_rest) in permutations(bases, 2):
            if max(rank, other) <= 1:
                harmonics = np.arange(int((top + _MIXED * float(beside)) / float(order)) + 1)
                add(_multiples(order / unit, harmonics, beside / unit, _MIXED), 2, component, kind)
    orders = sorted(found)
    return Candidates(
        numbers=np.array(orders, dtype=np.int64),
        unit=unit,
        sources=tuple(found[order][1:] for order in orders),
        ranks=np.array([found[order][0] for order in orders], dtype=np.int64),
        spacing=min(spacing, default=1.0),
    )


def _multiples(order: Fraction, harmonics: NDArray[np.int64], beside: Fraction, sides: int) -> NDArray[np.int64]:
    """Return whole multiples of an order, with sidebands at multiples of another, (harmonic, side)."""
    return np.asarray(np.add.outer(harmonics * int(order), np.arange(-sides, sides + 1) * int(beside)), dtype=np.int64)


def _planets(scene: Scene, mesh: str) -> int:
    """Return the number of contacts of a mesh."""
    return sum(contact.mesh == mesh for contact in scene.kinematics.contacts)


def gear_lines(prepared: PreparedScene, signal: Array) -> GearLines:
    """Return the loud lines in the channels of gears in motion, (channel, n), at the instants of the truth.

    At constant speed, torque and damage the window is the whole record, and Z is constant. Else Z is a polynomial of
    second degree in angle within windows; the length of each line's is that, of several, at which halving the window
    changes it least.
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
    steady = _is_steady(prepared)
    candidates = candidates_of(scene, top=top, mixed=steady)
    instants_rev = samples.revolutions(prepared.instants_s)
    fit = _steady_fit if steady else _varying_fit
    chosen, amplitudes, changes, about = fit(samples, candidates, instants_rev)
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
    return GearLines(lines=lines, about=about)


def _is_steady(prepared: PreparedScene) -> bool:
    """Return whether speed, torque and damage of teeth are constant."""
    torque, teeth = prepared.drive.torque, prepared.scene.exact_orders("tooth")
    return (
        bool(np.ptp(prepared.speed_hz) <= _STEADY * np.max(np.abs(prepared.speed_hz)))
        and (torque is None or not np.ptp(torque.values))
        and not any(fault.growth is not None and fault.component in teeth for fault in prepared.scene.faults)
    )


# ---- constant speed, torque and damage ---------------------------------------------------------------------------


def _steady_fit(
    samples: AngleSamples, candidates: Candidates, instants_rev: Array
) -> tuple[NDArray[np.int_], ComplexArray, Array, str]:
    """Return the numbers of the kept candidates, Z (channel, line, instant), no changes, and a sentence."""
    first, last = samples.span_rev
    length_rev = min(last - first, _LONGEST_CELLS / 4 / float(candidates.values[-1]))
    window = Window(length_rev=length_rev, degree=0)
    centres_rev = _tiles(samples, length_rev, np.inf)

    def fitted(chosen: NDArray[np.int_]) -> ComplexArray:
        return Projection(samples=samples, orders=candidates.values[chosen], window=window).mean(centres_rev)[..., None]

    chosen, lines = _above_floor(_loud_alone(samples, candidates, window, _APART_STEADY), candidates.ranks, fitted)
    about = (
        f"{chosen.size} lines of the steady motion, in a window of {length_rev:.4g} rev: other lines add less than "
        f"2e-5; {_floors()}; lines nearer than {_APART_STEADY / length_rev:.2g} orders count as one"
    )
    return chosen, np.repeat(lines, instants_rev.size, axis=2), np.zeros(chosen.size), about


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
    loud = _loud(sizes, candidates.ranks, 0.3)
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
class _Fit:
    """Lines at the trial instants in windows of one length, and by how much halving the windows changes them.

    Attributes
    ----------
    window : Window
    chosen : (line,) int array
        Rising numbers of candidates.
    sizes, changes : (line, trial) arrays
        RMS over channels; changes are infinite for lines that half the window does not separate.
    """

    window: Window
    chosen: NDArray[np.int_]
    sizes: Array
    changes: Array

    @property
    def total_change(self) -> Array:
        """Change of all lines that half the window separates over their RMS, (trial,)."""
        own = np.isfinite(self.changes[:, 0])
        change, size = (np.sum(part[own] ** 2, axis=0) for part in (self.changes, self.sizes))
        return np.asarray(np.sqrt(change / np.maximum(size, np.finfo(float).tiny)))


def _varying_fit(
    samples: AngleSamples, candidates: Candidates, instants_rev: Array
) -> tuple[NDArray[np.int_], ComplexArray, Array, str]:
    """Return the numbers of the kept candidates, Z (channel, line, instant), relative changes, and a sentence.

    Each line has, from trial instant to trial instant, the window of which halving changes it least: as short as its
    curvature asks, and long enough for its nearest neighbour.
    """
    first, last = samples.span_rev
    longest = min((last - first) / _LONGEST_SHARE, _LONGEST_CELLS / 4 / float(candidates.values[-1]))
    trials = np.unique(np.linspace(0, instants_rev.size - 1, _TRIALS).round().astype(int))
    loud, sizes = _loud_anywhere(samples, candidates, longest)
    fits, least, length_rev = list[_Fit](), np.full(trials.size, np.inf), longest
    moments = _trial_moments(samples, candidates.values[loud], length_rev, instants_rev[trials])
    while length_rev >= min(_PERIODS / candidates.spacing, longest):
        halved = _trial_moments(samples, candidates.values[loud], length_rev / 2, instants_rev[trials])
        fit = _trial_fit(candidates, loud, sizes, (moments, halved), trials.size)
        if np.all(fit.total_change > _LONGER * least):
            break
        fits, least = [*fits, fit], np.minimum(least, fit.total_change)
        moments, length_rev = halved, length_rev / 2
    fits = [fit for fit in fits if np.any(fit.total_change <= _LONGER * least)]
    union = np.unique(np.concatenate([fit.chosen for fit in fits]))
    changes = np.full((len(fits), union.size, trials.size), np.inf)
    found = np.zeros_like(changes)
    for number, fit in enumerate(fits):
        rows = np.searchsorted(union, fit.chosen)
        changes[number, rows], found[number, rows] = fit.changes, fit.sizes
    best = np.argmin(changes, axis=0)  # (line, trial); the longest where none can be halved
    least, size = (np.take_along_axis(part, best[None], axis=0)[0] for part in (changes, found))
    weights = np.gradient(trials.astype(np.float64))
    weights[[0, -1]] /= 2
    relative = np.sqrt(least**2 @ weights / np.maximum(size**2 @ weights, np.finfo(float).tiny))
    louder = _loud(np.max(size, axis=1), candidates.ranks[union], 0.3)
    union, best, relative = union[louder], best[louder], relative[louder]
    amplitudes = np.zeros((samples.signal.shape[0], union.size, instants_rev.size), dtype=np.complex128)
    nearest = np.argmin(np.abs(np.arange(instants_rev.size)[:, None] - trials), axis=1)
    for number in np.unique(best).tolist():
        fit, mine = fits[number], best == number  # (line, trial)
        rows = np.flatnonzero(mine.any(axis=1) & np.isin(union, fit.chosen))
        here = np.flatnonzero(mine[rows].any(axis=0)[nearest])
        projection = Projection(samples=samples, orders=candidates.values[fit.chosen], window=fit.window)
        lines = projection.amplitudes(instants_rev[here], np.searchsorted(fit.chosen, union[rows]))
        row, instant = np.nonzero(mine[rows][:, nearest[here]])
        amplitudes[:, rows[row], here[instant]] = lines[:, row, instant]
    kept = _loud(np.max(np.abs(amplitudes), axis=(0, 2)), candidates.ranks[union], 1.0)
    power = np.mean(np.abs(amplitudes[:, kept]) ** 2, axis=(0, 2))
    lengths = [fits[number].window.length_rev for number in np.unique(best[kept]).tolist()]
    share = 100 * power[relative[kept] < _DETERMINED].sum() / power.sum()
    about = (
        f"{kept.size} lines against time, of second degree in windows of {min(lengths):.3g} to {max(lengths):.3g} rev; "
        f"halving its window changes a line by truth_line_change, lines of {share:.2f} % of the power by less than "
        f"{100 * _DETERMINED:g} %; {_floors()}; lines nearer than {_APART:g} periods of the window count as one"
    )
    return union[kept], amplitudes[:, kept], relative[kept], about


def _loud_anywhere(samples: AngleSamples, candidates: Candidates, longest_rev: float) -> tuple[NDArray[np.int_], Array]:
    """Return the rising numbers of candidates that are loud where each stands alone, and the sizes of all."""
    first, last = samples.span_rev
    window = Window(length_rev=min(longest_rev, 2 * (last - first) / _SEARCHED), degree=0)
    everywhere = Projection(samples=samples, orders=candidates.values, window=window)
    sizes = np.max(np.sqrt(everywhere.power(_tiles(samples, window.length_rev, 2 * _SEARCHED))), axis=0)
    return _loud(sizes, candidates.ranks, 0.3), sizes


_PartMoments = list[tuple[Part, Moments]]


def _trial_moments(samples: AngleSamples, orders: Array, length_rev: float, instants_rev: Array) -> _PartMoments:
    """Return the moments of windows of one length at instants (i,)."""
    projection = Projection(samples=samples, orders=orders, window=Window(length_rev=length_rev, degree=_DEGREE))
    return [
        (part, Moments.joined(part.projection.moments(part.centres_rev)))
        for part in projection.parts(instants_rev, blended=False)
    ]


def _trial_fit(
    candidates: Candidates,
    loud: NDArray[np.int_],
    sizes: Array,
    moments: tuple[_PartMoments, _PartMoments],
    trials: int,
) -> _Fit:
    """Return the fit of windows, from the moments of all loud candidates in them and in windows of half the length."""
    orders, window = candidates.values[loud], moments[0][0][1].window

    def separate(apart: float) -> NDArray[np.int_]:
        # the louder of two stands for both; a mesh also for a neighbour that looks as loud because it is so near
        weight = sizes[loud] * np.where(candidates.ranks[loud] == 0, _MESH_FIRST, 1.0)
        return np.sort(_separate(orders, weight, np.zeros_like(loud), np.arange(loud.size), apart))

    def lines_of(parts: _PartMoments, numbers: NDArray[np.int_]) -> ComplexArray:
        lines = np.empty((parts[0][1].values.shape[1], numbers.size, trials), dtype=np.complex128)
        for part, some in parts:
            lines[:, :, part.instants] = part.amplitudes([some.of(numbers)], np.arange(numbers.size))
        return lines

    chosen, fewer = separate(_APART / window.length_rev), separate(2 * _APART / window.length_rev)
    whole, half = lines_of(moments[0], chosen), lines_of(moments[1], fewer)
    _, rows, others = np.intersect1d(chosen, fewer, return_indices=True)
    changes = np.full((chosen.size, trials), np.inf)
    changes[rows] = np.sqrt(np.mean(np.abs(whole[:, rows] - half[:, others]) ** 2, axis=0))
    return _Fit(
        window=replace(window, end=0),
        chosen=loud[chosen],
        sizes=np.sqrt(np.mean(np.abs(whole) ** 2, axis=0)),
        changes=changes,
    )
