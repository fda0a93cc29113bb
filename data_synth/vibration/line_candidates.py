"""Orders at which gears in motion may have lines, as the drawing gives them.

They are harmonics of every mesh, of every damaged gear, and of every gear with pitch deviations, with sidebands at the
passes of planets, and what two meshes, or in steady motion damaged gears as well, make with each other.
"""

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.imperfect_parts import imperfections_of
from data_synth.kinematic.planet_pass import pass_orders
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import Scene
from data_synth.sources.families import mesh_name

_MIXED = 4  # multiples of one order beside those of another


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
        0 of meshes, 1 of damaged gears, 2 of pitch deviations and of what two others make: where a window cannot
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

    def places(self, others: "Candidates") -> NDArray[np.int_]:
        """Return the numbers here of others that are all among these."""
        return np.searchsorted(self.numbers, others.numbers * int(others.unit / self.unit))


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
    meshes, teeth = scene.exact_orders("gear_mesh"), turn_orders(scene)
    damaged = dict.fromkeys(fault.component for fault in scene.faults if fault.component in teeth)
    bases = [(order, 0, mesh, mesh, "gear_mesh") for mesh, order in meshes.items()]
    bases += [(teeth[name], 1, mesh_name(name), name, "tooth") for name in damaged]
    uneven = [name for name in teeth if name not in damaged and imperfections_of(scene).gears is not None]
    bases += [(teeth[name], 2, mesh_name(name), name, "pitch_deviation") for name in uneven]
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
    # what vibrates in one mesh makes forces in others, whose planets pass the sensors too: those of its own come first
    carriers = [each for each in dict.fromkeys(passes.values()) if each[1]]
    for own in (True, False):
        for order, rank, mesh, component, kind in bases:
            for carrier, sides in [passes[mesh]] if own else carriers:
                harmonics = np.arange(int((top + sides * float(carrier)) / float(order)) + 1)
                add(_multiples(order / unit, harmonics, carrier / unit, sides), rank, component, kind)
                spacing += [float(order), *([float(carrier)] if sides else [])]
    for (order, rank, _, component, kind), (beside, other, *_rest) in permutations(bases, 2):
        if max(rank, other) <= (1 if mixed else 0):
            harmonics = np.arange(int((top + _MIXED * float(beside)) / float(order)) + 1)
            sums = _multiples(order / unit, harmonics, beside / unit, _MIXED)
            for carrier, sides in carriers if rank == other == 0 and order != beside else ():
                add(np.add.outer(sums, np.arange(-sides, sides + 1) * int(carrier / unit)), 2, component, kind)
            add(sums, 2, component, kind)
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


def turn_orders(scene: Scene) -> dict[str, Fraction]:
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
