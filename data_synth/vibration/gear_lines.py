"""Lines of gear dynamics: orders, and complex amplitudes against time, by projection of the noise-free signal.

Candidates are the harmonics of every mesh, of every damaged gear, and of every gear with pitch deviations, with
sidebands at the planet pass orders, and the intermodulation of two meshes.
The strongest of them are retained. Damaged teeth have separate lines, of the difference from the same gears with sound
teeth. The remainder between the lines is stated as a share of the power.
"""

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.kinematic.planet_pass import pass_orders
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene
from data_synth.sources.families import mesh_name
from data_synth.sources.impact_responses import BELOW_NYQUIST
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.order_projection import projection

# ---- Orders at which gears may have lines ------------------------------------------------------------------------


_MIXED = 4  # intermodulation: multiples of one order about those of another
_Base = tuple[Fraction, str, str, str]


def candidates_of(scene: Scene, *, top: float) -> tuple[Array, list[tuple[str, str]]]:
    """Return the candidate orders (k,) below `top` of the lines of a scene's gears, with (component, kind) of each.

    Orders are increasing and correctly rounded.
    """
    bases, passes = _bases_of(scene)
    unit = _unit_of(bases, passes)
    found: dict[int, tuple[str, str]] = {}

    def add(numbers: NDArray[np.int64], component: str, kind: str) -> None:
        sizes = np.abs(numbers.ravel())
        for number in sizes[(sizes > 0) & (sizes <= top / unit)].tolist():
            found.setdefault(number, (component, kind))

    # vibration of one mesh causes forces in others, whose planets pass the sensors too; its own come first
    carriers = [each for each in dict.fromkeys(passes.values()) if each[1]]
    for own in (True, False):
        for order, mesh, component, kind in bases:
            for carrier, sides in [passes[mesh]] if own else carriers:
                harmonics = np.arange(int((top + sides * float(carrier)) / float(order)) + 1)
                add(_multiples(order / unit, harmonics, carrier / unit, sides), component, kind)
    for (order, mesh, *_), (partner, *_) in permutations((base for base in bases if base[-1] == "gear_mesh"), 2):
        harmonics = np.arange(int((top + _MIXED * float(partner)) / float(order)) + 1)
        sums = _multiples(order / unit, harmonics, partner / unit, _MIXED)
        for carrier, sides in carriers if order != partner else ():
            add(np.add.outer(sums, np.arange(-sides, sides + 1) * int(carrier / unit)), mesh, "gear_mesh")
        add(sums, mesh, "gear_mesh")
    numbers = sorted(found)
    orders = np.array(numbers, dtype=np.int64) * unit.numerator / unit.denominator
    return orders, [found[number] for number in numbers]


def _unit_of(bases: list[_Base], passes: dict[str, tuple[Fraction, int]]) -> Fraction:
    """Return the order of which all candidates are integer multiples, at which steady motion repeats."""
    orders = [*(base[0] for base in bases), *(carrier for carrier, _ in passes.values())]
    return Fraction(1, math.lcm(*(order.denominator for order in orders)))


def _bases_of(scene: Scene) -> tuple[list[_Base], dict[str, tuple[Fraction, int]]]:
    """Return (order, mesh, component, kind) of each periodic source, and the planet pass orders by mesh.

    A line with several sources is assigned to the first.
    """
    meshes, teeth = scene.exact_orders("gear_mesh"), _turn_orders(scene)
    damaged = dict.fromkeys(fault.component for fault in scene.faults if fault.component in teeth)
    bases = [(order, mesh, mesh, "gear_mesh") for mesh, order in meshes.items()]
    bases += [(teeth[name], mesh_name(name), name, "tooth") for name in damaged]
    uneven = [name for name in teeth if name not in damaged and imperfections_of(scene).gears is not None]
    bases += [(teeth[name], mesh_name(name), name, "pitch_deviation") for name in uneven]
    return bases, {mesh: pass_orders(scene, mesh) for mesh in meshes}


def _multiples(order: Fraction, harmonics: NDArray[np.int64], partner: Fraction, sides: int) -> NDArray[np.int64]:
    """Return integer multiples of an order with sidebands at multiples of another, (harmonic, side)."""
    return np.asarray(np.add.outer(harmonics * int(order), np.arange(-sides, sides + 1) * int(partner)), dtype=np.int64)


def _turn_orders(scene: Scene) -> dict[str, Fraction]:
    """Return the order at which the same tooth of each gear meets its mates again.

    A sensor sees planets differently: a tooth of a sun or ring repeats once it has met all of them.
    """
    meshes = scene.exact_orders("gear_mesh")
    return {
        f"{mesh.name}/{gear.link}": meshes[mesh.name] / abs(gear.teeth)
        for mesh in scene.gearbox.meshes
        if mesh.name in meshes
        for gear in mesh.gears
    }


# ---- Their amplitudes -------------------------------------------------------------------------------------------


_STEADY = 1e-12  # of the speed: variation due to rounding
_FEWEST_TURNS = 16  # that determine the lines of a steady motion, if its period is shorter
_SLOW = 0.3  # of the top speed: lines of lower speeds are weak


class Line(NamedTuple):
    """Contribution of one source to the line at one order, correctly rounded: Z (channel, instant)."""

    order: float
    component: str
    kind: str
    amplitude: ComplexArray


@dataclass(frozen=True, kw_only=True)
class GearLines:
    """Lines of gears in motion.

    Attributes
    ----------
    lines : tuple of Line
        Those of sound teeth, then the contributions of damage, which may have the same orders.
    left, fault_left : (channel,) array or None
        Share of the power outside the lines: of sound teeth, and of the contribution of damaged teeth.
    free : (channel,) array or None
        Share of the power that is free vibration.
    about : str
        Resolution of the lines, in words.
    """

    lines: tuple[Line, ...] = ()
    left: Array | None = None
    fault_left: Array | None = None
    free: Array | None = None
    about: str


def gear_lines(prepared: PreparedScene, signal: Array, *, sound: Array | None = None) -> GearLines:
    """Return the significant lines of gear dynamics in the channels at the instants of the truth.

    At constant speed, torque and damage Z is constant, otherwise linear between instants.

    Parameters
    ----------
    prepared : PreparedScene
    signal : (channel, n) array
        Contribution of gear dynamics to the channels, without free vibration.
    sound : (channel, n) array or None
        The same with sound teeth if some are damaged: at least its first `samples_compared`.
    """
    scene, turning = prepared.scene, np.sign(prepared.speed_hz[prepared.speed_hz != 0])
    if not turning.size or np.ptp(turning):
        return GearLines(about="omitted: the shaft reverses, or nothing moves")
    others = sum(int(np.count_nonzero(family.nonzero)) for family in prepared.families)
    most = max(0, scene.samples // prepared.instants_s.size - others)  # in eight bytes each, at most as many as samples
    healthy = scene.changed(faults=())
    teeth = _lines_in(prepared, signal if sound is None else sound, scene=healthy, most=most // 2)
    if sound is None:
        return teeth
    added = _lines_in(prepared, signal[:, : sound.shape[1]] - sound, scene=scene, most=most - len(teeth.lines))
    return GearLines(
        lines=teeth.lines + added.lines,
        left=teeth.left,
        fault_left=added.left,
        about=f"{teeth.about}; contribution of damage: {added.about}",
    )


def samples_compared(prepared: PreparedScene, scene: Scene) -> int:
    """Return the number of samples that determine the lines: one period of steady motion, else all."""
    whole = scene.samples
    if not is_steady(prepared, scene):
        return whole
    speed_hz = float(np.max(np.abs(prepared.speed_hz)))
    turns = max(1 / float(_unit_of(*_bases_of(scene))), _FEWEST_TURNS)
    return min(whole, math.ceil(turns / speed_hz * scene.rate_hz)) if speed_hz else whole


def is_steady(prepared: PreparedScene, scene: Scene) -> bool:
    """Return whether speed, torque and tooth damage of a scene are constant."""
    teeth, torque = scene.exact_orders("tooth"), prepared.drive.torque
    return (
        bool(np.ptp(prepared.speed_hz) <= _STEADY * np.max(np.abs(prepared.speed_hz)))
        and (torque is None or not np.ptp(torque.values))
        and not any(fault.growth is not None and fault.component in teeth for fault in scene.faults)
    )


def _lines_in(prepared: PreparedScene, signal: Array, *, scene: Scene, most: int) -> GearLines:
    """Return the lines of a signal at the orders of a scene, at most so many."""
    angle, steady = prepared.drive.angle, is_steady(prepared, scene)
    signal = signal[:, : samples_compared(prepared, scene)]
    revolutions = angle.revolutions(np.arange(signal.shape[1]) / prepared.scene.rate_hz)
    sign = 1.0 if revolutions[-1] > revolutions[0] else -1.0
    speed_hz = np.abs(angle.speed_hz(np.arange(signal.shape[1]) / prepared.scene.rate_hz))
    known = BELOW_NYQUIST * prepared.scene.rate_hz / 2 / np.maximum(speed_hz, _SLOW * np.max(speed_hz))
    orders, sources = candidates_of(scene, top=float(np.max(known)))
    found = projection(
        signal,
        sign * revolutions,
        orders,
        at_rev=sign * angle.revolutions(prepared.instants_s),
        top_order=known,
        steady=steady,
        most=most,
    )
    amplitudes = found.amplitudes if sign > 0 else found.amplitudes.conj()
    lines = tuple(
        Line(float(orders[place]), component, kind, amplitude)
        for place, amplitude in zip(found.chosen.tolist(), amplitudes.swapaxes(0, 1), strict=True)
        for component, kind in [sources[place]]
    )
    full = ", as many as the size of the samples admits" if len(lines) == most else ""
    about = (
        f"{len(lines)} lines{full}, fitted together in intervals of {found.interval_rev:.3g} rev; those nearer than "
        f"{1 / found.interval_rev:.2g} orders are not told apart; they leave "
        f"{100 * np.max(found.left, initial=0.0):.2g} % of the power"
    )
    return GearLines(lines=lines, left=found.left, about=about)
