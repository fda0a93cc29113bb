"""Lines of gears in motion: their orders, and their complex amplitudes against time, projected from the clean signal.

Candidates are the orders that the drawing gives: harmonics of every mesh, of every damaged gear, and of every gear with
pitch deviations, with sidebands at the passes of planets, and in steady motion what two of the first make with each
other. Those that are loud are kept.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.kinematic.planet_pass import pass_orders
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene
from data_synth.sources.prepared import PreparedScene, mesh_name
from data_synth.vibration.order_projection import AngleSamples, Projection, Window

FLOOR = 1e-3  # of the loudest line, over time and channels: lines of meshes and of gears with each other
FAULT_FLOOR = 1e-2  # of the loudest line of the same damaged gear
_LEAST = 1e-5  # of the loudest line of all: what the error of the integration makes is no line
_MOST = 2048  # lines
_STEADY = 1e-12  # of the speed: what rounding may change
_BELOW_NYQUIST = 0.98
_MIXED = 4  # multiples of one order beside those of another
_LONGEST_CELLS = 1 << 20  # of a window in steady motion
_SEARCHED = 16  # windows in which lines are looked for
_APART, _APART_STEADY = 2.0, 1.5  # periods of the window that two lines have to be apart to be fitted together
_LONGEST_SHARE = 1.25  # of which the record is at least as long as the longest window in varying motion
_LONGER = 4.0  # times the power of the least change: twice in amplitude, of windows that need not be longer still
_PERIODS = 6.0  # of the smallest base order: the shortest window tried


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
    orders : tuple of Fraction
    sources : tuple of (component, kind)
    ranks : (k,) int array
        0 of meshes, 1 of damaged gears, 2 of pitch deviations and of what two of the first make: where a window cannot
        separate two lines, that of the lower rank stands for both.
    spacing : float
        Smallest order of which all multiples are candidates.
    """

    orders: tuple[Fraction, ...]
    sources: tuple[tuple[str, str], ...]
    ranks: NDArray[np.int_]
    spacing: float

    @property
    def values(self) -> Array:
        """The orders as numbers, (k,)."""
        return np.array([float(order) for order in self.orders])


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
        orders=tuple(number * unit for number in orders),
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
    second degree in angle within windows whose length is the one, of several, at which halving changes the lines least.
    """
    scene, angle = prepared.scene, prepared.drive.angle
    turning = np.sign(prepared.speed_hz[prepared.speed_hz != 0])
    if not turning.size or np.ptp(turning) or not signal.any():
        return GearLines(lines=(), about="left out: the shaft turns back, or nothing moves")
    sign = float(turning[0])
    samples = AngleSamples(
        signal=signal,
        rate_hz=scene.rate_hz,
        revolutions=lambda times_s: sign * angle.revolutions(times_s),
        speed_hz=lambda times_s: np.maximum(sign * angle.speed_hz(times_s), 0.0),
    )
    top = _BELOW_NYQUIST * scene.rate_hz / 2 / angle.top_speed_hz(0.0, scene.duration_s)
    steady = _is_steady(prepared)
    candidates = candidates_of(scene, top=top, mixed=steady)
    instants_rev = samples.revolutions(prepared.instants_s)
    fit = _steady_fit if steady else _varying_fit
    chosen, amplitudes, about = fit(samples, candidates, instants_rev)
    if sign < 0:
        amplitudes = amplitudes.conj()
    lines = tuple(
        GearLine(
            order=candidates.orders[number],
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
    length_rev = min(last - first, _LONGEST_CELLS / 4 / float(candidates.orders[-1]))
    window = Window(length_rev=length_rev, degree=0)
    centres_rev = _tiles(samples, length_rev, np.inf)

    def fitted(chosen: NDArray[np.int_]) -> ComplexArray:
        return Projection(samples=samples, orders=candidates.values[chosen], window=window).mean(centres_rev)[..., None]

    chosen, lines = _kept(samples, candidates, window, _APART_STEADY, fitted)
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


def _kept(
    samples: AngleSamples,
    candidates: Candidates,
    window: Window,
    apart: float,
    fitted: Callable[[NDArray[np.int_]], ComplexArray],
) -> tuple[NDArray[np.int_], ComplexArray]:
    """Return the numbers of loud candidates, and their lines as `fitted` (channel, line, instant) gives them.

    Twice: once more without those that were only the leakage of their neighbours.
    """
    orders, ranks = candidates.values, candidates.ranks
    everywhere = Projection(samples=samples, orders=orders, window=window)
    centres_rev = _tiles(samples, window.length_rev, _SEARCHED)
    sizes = np.max(np.sqrt(everywhere.power(centres_rev)), axis=0)
    chosen = np.sort(_separate(orders, sizes, ranks, _loud(sizes, ranks, 0.3), apart / window.length_rev))
    for _ in range(2):
        lines = fitted(chosen)
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
    """Return the numbers of lines that are at least `apart`: of lower ranks first, then of larger sizes."""
    kept = np.empty(0)
    taken = []
    for number in numbers[np.lexsort((-sizes[numbers], ranks[numbers]))].tolist():
        place = int(np.searchsorted(kept, orders[number]))
        around = kept[max(place - 1, 0) : place + 1]
        if np.all(np.abs(around - orders[number]) >= apart):
            kept = np.insert(kept, place, orders[number])
            taken.append(number)
    return np.array(taken, dtype=np.int64)


# ---- varying speed, torque or damage ---------------------------------------------------------------------------------


def _varying_fit(
    samples: AngleSamples, candidates: Candidates, instants_rev: Array
) -> tuple[NDArray[np.int_], ComplexArray, str]:
    """Return the numbers of the kept candidates, Z (channel, line, instant), and a sentence."""
    first, last = samples.span_rev
    longest = min((last - first) / _LONGEST_SHARE, _LONGEST_CELLS / 4 / float(candidates.orders[-1]))
    lengths = [min(_PERIODS / candidates.spacing, longest)]
    while 2 * lengths[-1] <= longest:
        lengths.append(2 * lengths[-1])
    trials = np.unique(np.linspace(0, instants_rev.size - 1, _SEARCHED).round().astype(int))
    changes, kept = np.full((len(lengths), trials.size), np.inf), []
    for row, length_rev in enumerate(lengths):
        if row > 1 and np.all(changes[row - 1] > _LONGER * np.min(changes[: row - 1], axis=0)):
            break  # these already blur every line
        window = Window(length_rev=length_rev, degree=2)
        chosen, fitted = _kept(
            samples,
            candidates,
            window,
            _APART,
            partial(_projected, samples, candidates, length_rev, instants_rev[trials]),
        )
        halved = _projected(samples, candidates, length_rev / 2, instants_rev[trials], chosen)
        difference, size = (np.sum(np.abs(part) ** 2, axis=(0, 1)) for part in (fitted - halved, fitted))
        changes[row] = difference / np.maximum(size, np.finfo(float).tiny)
        kept.append(chosen)
    best = np.argmin(changes, axis=0)
    nearest = best[np.argmin(np.abs(np.arange(instants_rev.size)[:, None] - trials), axis=1)]
    union = np.unique(np.concatenate([kept[row] for row in np.unique(best)]))
    amplitudes = np.zeros((samples.signal.shape[0], union.size, instants_rev.size), dtype=np.complex128)
    for row in np.unique(best).tolist():
        here = np.flatnonzero(nearest == row)
        lines = _projected(samples, candidates, lengths[row], instants_rev[here], kept[row])
        amplitudes[:, np.searchsorted(union, kept[row])[:, None], here] = lines
    used = [lengths[row] for row in np.unique(best)]
    change = np.sqrt(np.min(changes, axis=0))
    about = (
        f"{union.size} lines against time, of second degree in windows of {min(used):.3g} to {max(used):.3g} rev: "
        f"halving the windows changes them by {np.median(change):.1e}, at most by {np.max(change):.1e} of their RMS; "
        f"{_floors()}; lines nearer than {_APART:g} periods of the window count as one"
    )
    return union, amplitudes, about


def _projected(
    samples: AngleSamples, candidates: Candidates, length_rev: float, instants_rev: Array, chosen: NDArray[np.int_]
) -> ComplexArray:
    """Return Z (channel, line, instant) of chosen candidates."""
    window = Window(length_rev=length_rev, degree=2)
    return Projection(samples=samples, orders=candidates.values[chosen], window=window).amplitudes(instants_rev)
