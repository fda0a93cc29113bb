"""Orders at which gears in motion may have lines, as the drawing gives them.

They are harmonics of every mesh, of every damaged gear, and of every gear with pitch deviations, with sidebands at the
passes of planets, and what two meshes, or in steady motion damaged gears as well, make with each other.
"""

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.kinematic.planet_pass import pass_orders
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene
from data_synth.sources.families import mesh_name

_MIXED = 4  # multiples of one order beside those of another
_Base = tuple[Fraction, int, str, str, str]
_MESH, _DAMAGED, _DEVIATION = range(3)  # a line that several make is that of the first of these


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """Orders (k,) at which lines may be, rising and correctly rounded, and (component, kind) of each."""

    orders: Array
    sources: tuple[tuple[str, str], ...]


def candidates_of(scene: Scene, *, top: float, mixed: bool) -> Candidates:
    """Return the orders below `top` at which the gears of a scene may have lines.

    Parameters
    ----------
    scene : Scene
    top : float
        Highest order.
    mixed : bool
        Whether sums and differences with orders of damaged gears are wanted as well, beside those of two meshes.
    """
    bases, passes = _bases_of(scene)
    unit = _unit_of(bases, passes)
    found: dict[int, tuple[str, str]] = {}

    def add(numbers: NDArray[np.int64], component: str, kind: str) -> None:
        sizes = np.abs(numbers.ravel())
        for number in sizes[(sizes > 0) & (sizes <= top / unit)].tolist():
            found.setdefault(number, (component, kind))

    # what vibrates in one mesh makes forces in others, whose planets pass the sensors too: those of its own come first
    carriers = [each for each in dict.fromkeys(passes.values()) if each[1]]
    for own in (True, False):
        for order, _, mesh, component, kind in bases:
            for carrier, sides in [passes[mesh]] if own else carriers:
                harmonics = np.arange(int((top + sides * float(carrier)) / float(order)) + 1)
                add(_multiples(order / unit, harmonics, carrier / unit, sides), component, kind)
    for (order, rank, _, component, kind), (partner, other, *_rest) in permutations(bases, 2):
        if max(rank, other) <= (_DAMAGED if mixed else _MESH):
            harmonics = np.arange(int((top + _MIXED * float(partner)) / float(order)) + 1)
            sums = _multiples(order / unit, harmonics, partner / unit, _MIXED)
            for carrier, sides in carriers if rank == other == _MESH and order != partner else ():
                add(np.add.outer(sums, np.arange(-sides, sides + 1) * int(carrier / unit)), component, kind)
            add(sums, component, kind)
    numbers = sorted(found)
    orders = np.array(numbers, dtype=np.int64) * unit.numerator / unit.denominator
    return Candidates(orders=orders, sources=tuple(found[number] for number in numbers))


def repetition_order(scene: Scene) -> Fraction:
    """Return the order of which all candidates are whole multiples: steady motion repeats itself at it."""
    return _unit_of(*_bases_of(scene))


def _unit_of(bases: list[_Base], passes: dict[str, tuple[Fraction, int]]) -> Fraction:
    orders = [*(base[0] for base in bases), *(carrier for carrier, _ in passes.values())]
    return Fraction(1, math.lcm(*(order.denominator for order in orders)))


def _bases_of(scene: Scene) -> tuple[list[_Base], dict[str, tuple[Fraction, int]]]:
    """Return (order, rank, mesh, component, kind) of what repeats itself, and the passes of planets by mesh."""
    meshes, teeth = scene.exact_orders("gear_mesh"), _turn_orders(scene)
    damaged = dict.fromkeys(fault.component for fault in scene.faults if fault.component in teeth)
    bases = [(order, _MESH, mesh, mesh, "gear_mesh") for mesh, order in meshes.items()]
    bases += [(teeth[name], _DAMAGED, mesh_name(name), name, "tooth") for name in damaged]
    uneven = [name for name in teeth if name not in damaged and imperfections_of(scene).gears is not None]
    bases += [(teeth[name], _DEVIATION, mesh_name(name), name, "pitch_deviation") for name in uneven]
    return bases, {mesh: pass_orders(scene, mesh) for mesh in meshes}


def _multiples(order: Fraction, harmonics: NDArray[np.int64], partner: Fraction, sides: int) -> NDArray[np.int64]:
    """Return whole multiples of an order, with sidebands at multiples of another, (harmonic, side)."""
    return np.asarray(np.add.outer(harmonics * int(order), np.arange(-sides, sides + 1) * int(partner)), dtype=np.int64)


def _turn_orders(scene: Scene) -> dict[str, Fraction]:
    """Return the order at which each gear meets another, or a planet's mates, by the same tooth again.

    Planets are not alike to a sensor: a tooth of a sun or a ring repeats once it has met all of them.
    """
    meshes = scene.exact_orders("gear_mesh")
    return {
        f"{mesh.name}/{gear.link}": meshes[mesh.name] / abs(gear.teeth)
        for mesh in scene.gearbox.meshes
        if mesh.name in meshes
        for gear in mesh.gears
    }
