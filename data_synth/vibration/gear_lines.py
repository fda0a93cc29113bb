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
from data_synth.vibration.order_projection import AngleSamples, Moments, Projection, Window, amplitudes_of

FLOOR = 1e-3  # of the loudest line, over time and channels: lines of meshes and of gears with each other
FAULT_FLOOR = 1e-2  # of the loudest line of the same damaged gear
_LEAST = 1e-5  # of the loudest line of all: what the error of the integration makes is no line
_MOST = 2048  # lines
_STEADY = 1e-12  # of the speed: what rounding may change
_BELOW_NYQUIST = 0.98
_MIXED = 4  # multiples of one order beside those of another
_LONGEST_CELLS = 1 << 20  # of a window in steady motion
_SEARCHED = 9  # windows in which lines are looked for
_APART, _APART_STEADY = 3.0, 1.5
"""Periods of the window that two lines have to be apart to be fitted together. With amplitudes of second degree the
condition number of least squares is 8 for lines 3 periods apart, 900 for 2.5 and 600,000 for 2."""
_DEGREES = (1, 2)
_LONGEST_SHARE = 1.25  # of which the record is at least as long as the longest window in varying motion
_LONGER = 2.0  # times the least change, of windows that need not be longer still
_PERIODS = 1.5  # of the smallest base order: the shortest window tried, where speed changes within a turn or two


@dataclass(frozen=True, kw_only=True)
class GearLine:
    """A line of gears in motion: exact order, component, kind and Z (channel, instant)."""

    order: Fraction
    component: str
    kind: str
    amplitude: ComplexArray


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
    first or second degree in angle within windows, whose degree and length are those, of several, at which halving the
    window changes the lines least.
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
    chosen, amplitudes, about = fit(samples, candidates, instants_rev)
    if sign < 0:
        amplitudes = amplitudes.conj()
    lines = tuple(
        GearLine(
            order=candidates.order(number),
            component=candidates.sources[number][0],
            kind=candidates.sources[number][1],
            amplitude=amplitudes[:, row],
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
) -> tuple[NDArray[np.int_], ComplexArray, str]:
    """Return the numbers of the kept candidates, Z (channel, line, instant), and a sentence."""
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
    return chosen, np.repeat(lines, instants_rev.size, axis=2), about


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
    """A window, the numbers of the candidates that it keeps, and by how much halving it changes their lines.

    `changes` (trial,) are RMS over RMS at the trial instants.
    """

    window: Window
    chosen: NDArray[np.int_]
    changes: Array


def _varying_fit(
    samples: AngleSamples, candidates: Candidates, instants_rev: Array
) -> tuple[NDArray[np.int_], ComplexArray, str]:
    """Return the numbers of the kept candidates, Z (channel, line, instant), and a sentence."""
    first, last = samples.span_rev
    longest = min((last - first) / _LONGEST_SHARE, _LONGEST_CELLS / 4 / float(candidates.values[-1]))
    trials = np.unique(np.linspace(0, instants_rev.size - 1, _SEARCHED).round().astype(int))
    length_rev, fits = min(_PERIODS / candidates.spacing, longest), list[_Fit]()
    least, blurred = np.full(trials.size, np.inf), False
    while length_rev <= longest and not blurred:
        new = _trial_fits(samples, candidates, length_rev, instants_rev[trials])
        now = np.min([fit.changes for fit in new], axis=0)
        blurred = bool(np.all(now > _LONGER * least))
        least = np.minimum(least, now)
        fits += new
        length_rev *= 2
    best = np.argmin([fit.changes for fit in fits], axis=0)
    nearest = best[np.argmin(np.abs(np.arange(instants_rev.size)[:, None] - trials), axis=1)]
    used = np.unique(best).tolist()
    union = np.unique(np.concatenate([fits[number].chosen for number in used]))
    amplitudes = np.zeros((samples.signal.shape[0], union.size, instants_rev.size), dtype=np.complex128)
    for number in used:
        here, fit = np.flatnonzero(nearest == number), fits[number]
        # with the lines that are loud at other times, as far as this window separates them from its own
        own = np.isin(union, fit.chosen).astype(np.float64)
        orders, apart = candidates.values[union], _APART / fit.window.length_rev
        rows = np.sort(_separate(orders, own, np.zeros(union.size, dtype=np.int64), np.arange(union.size), apart))
        projection = Projection(samples=samples, orders=orders[rows], window=fit.window)
        amplitudes[:, rows[:, None], here] = projection.amplitudes(instants_rev[here])
    lengths = [fits[number].window.length_rev for number in used]
    about = (
        f"{union.size} lines against time, of first or second degree in windows of {min(lengths):.3g} to "
        f"{max(lengths):.3g} rev: halving the windows changes them by {np.median(least):.1e}, at most by "
        f"{np.max(least):.1e} of their RMS; {_floors()}; lines nearer than {_APART:g} periods of the window count as "
        "one"
    )
    return union, amplitudes, about


def _trial_fits(
    samples: AngleSamples, candidates: Candidates, length_rev: float, instants_rev: Array
) -> tuple[_Fit, ...]:
    """Return the fits of windows of one length, for each degree, and their changes at instants (i,)."""
    orders, ranks = candidates.values, candidates.ranks
    window = Window(length_rev=length_rev, degree=_DEGREES[-1])
    chosen = _loud_alone(samples, candidates, window, _APART)
    projection = Projection(samples=samples, orders=orders[chosen], window=window)
    centres_rev, which = projection.windows_about(instants_rev)
    moments = Moments.joined(projection.moments(centres_rev))
    half = Projection(
        samples=samples, orders=orders[chosen], window=Window(length_rev=length_rev / 2, degree=_DEGREES[-1])
    )
    half_centres_rev, half_which = half.windows_about(instants_rev)
    half_moments = Moments.joined(half.moments(half_centres_rev))

    def fit_of(degree: int) -> _Fit:
        def lines_of(kept: NDArray[np.int_]) -> ComplexArray:
            return amplitudes_of([moments.of(kept, degree=degree)], instants_rev, which)

        kept, lines = _above_floor(np.arange(chosen.size), ranks[chosen], lines_of)
        sizes = np.max(np.abs(lines), axis=(0, 2))
        # the halved window separates fewer lines: for those below its resolution least squares are undetermined
        own = np.sort(_separate(orders[chosen[kept]], sizes, ranks[chosen[kept]], np.arange(kept.size), 2 * apart))
        halved = amplitudes_of([half_moments.of(kept[own], degree=degree)], instants_rev, half_which)
        difference, size = (np.sum(np.abs(part) ** 2, axis=(0, 1)) for part in (lines[:, own] - halved, lines[:, own]))
        changes = np.sqrt(difference / np.maximum(size, np.finfo(float).tiny))
        return _Fit(window=replace(window, degree=degree), chosen=chosen[kept], changes=changes)

    apart = _APART / length_rev
    return tuple(fit_of(degree) for degree in _DEGREES)
