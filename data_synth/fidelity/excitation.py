"""Exciting forces of meshes without vibration, and their families of lines.

Families are the multiples of one order; those of a varying stiffness at such multiples couple them.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.system import Mesh
from data_synth.gears.transmission_error import SumOfErrors, TransmissionError
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_POINTS = 16  # to a period of the highest line
_FEWEST = 256  # points to a mesh cycle
_BESIDE = 1e-9  # of a period: beside a jump


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Lines of the exciting force of a mesh without vibration.

    Attributes
    ----------
    order : Fraction
        Of the mesh.
    cycles : int
        Period of its stiffness.
    varying : (k,) complex array
        Lines of ``k / k_mean - 1``.
    errors_n : mapping of cycles to (k,) complex array
        Lines of ``-k_mean e`` by the period of the parts of e.
    """

    order: Fraction
    cycles: int
    varying: ComplexArray
    errors_n: dict[int, ComplexArray]

    @classmethod
    def of(cls, mesh: Mesh, order: Fraction, *, top: float) -> "Excitation":
        """Return the lines of a mesh up to an order."""
        mean, cycles = mesh.stiffness.mean, int(mesh.stiffness.period)

        def sampled(values: Callable[[Array], Array], jumps: Array, period: int) -> Array:
            # to a mesh cycle as many for sound and for damaged gears, so that only damage makes them different
            points = period * max(_FEWEST, 1 << (_POINTS * math.ceil(top / float(order)) - 1).bit_length())
            known = values((np.arange(points) + 0.5) * period / points)
            # where it jumps, the mean about the point: as exact as without the jump
            share, cell = np.modf(np.remainder(jumps / period, 1.0) * points)
            before, after = (values(jumps + side * _BESIDE * period) for side in (-1, 1))
            np.add.at(known, cell.astype(int), (np.round(share) - share) * (after - before))
            return known

        def lines_of(known: Array, period: int, by_cycles: float) -> ComplexArray:
            lines = max(1, math.floor(top / float(order) * period))
            turned = np.exp(2j * np.pi * by_cycles / period * np.arange(1, lines + 1))
            return np.asarray(spectral_lines(known, lines) * turned)

        # contacts of planets at the same phases of their teeth, then shifted: where lines cancel, their errors do
        by_cycles = getattr(mesh.stiffness, "by_cycles", 0.0)
        jumps = np.array(mesh.stiffness.jumps) + by_cycles
        varying = sampled(lambda phases: mesh.stiffness(phases - by_cycles) / mean, jumps, cycles)
        alike, errors_n = dict[tuple[int, float], Array](), dict[int, ComplexArray]()
        for part, late in _parts_of(mesh.error):
            known = sampled(part, np.array(getattr(part, "jumps", ())), int(part.period))
            alike[int(part.period), late] = alike.get((int(part.period), late), 0.0) + known
        for (period, late), known in alike.items():
            errors_n[period] = errors_n.get(period, 0.0) - mean * lines_of(known, period, late)
        return cls(order=order, cycles=cycles, varying=lines_of(varying, cycles, by_cycles), errors_n=errors_n)

    def waveform(self, base: Fraction, points: int) -> Array:
        """Return ``k / k_mean - 1`` (points,) in a period of an order, of its lines at multiples of that."""
        step = self.order / self.cycles / base
        lines, every = self.varying[step.denominator - 1 :: step.denominator], step.numerator
        lines = lines[: (points - 1) // 2 // every]
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex64)
        spectrum[every : every * lines.size + 1 : every] = points / 2 * lines
        return np.asarray(np.fft.irfft(spectrum, points), dtype=np.float32)


def _parts_of(error: TransmissionError | None, by_cycles: float = 0.0) -> Iterator[tuple[TransmissionError, float]]:
    """Yield the parts of an error, each of which has a period of its own, and the cycles by which it is shifted."""
    if isinstance(error, SumOfErrors):
        for part, by in zip(error.parts, error.by_cycles or (0.0,) * len(error.parts), strict=True):
            yield from _parts_of(part, by_cycles + by)
    elif error is not None:
        yield error, by_cycles


@dataclass(frozen=True, kw_only=True)
class Family:
    """Lines at the multiples of an order, (input, mesh, k), that the stiffness couples.

    Of ``-k_mean e`` in N, the first input, and of ``k / k_mean - 1``, per N of the static force of each mesh.
    """

    base: Fraction
    lines: NDArray[np.complex64]
    sign: int = 1


def families_of(excitations: list[Excitation], teeth: tuple[Fraction, ...], *, top: float) -> list[Family]:
    """Return the families of the excitation.

    Harmonics of a mesh are among the multiples of an order that it shares with the mesh on its shaft, which has the
    lines at sums of both; a damaged tooth beside that shaft has a family with the harmonics of its mesh, whose
    vibration its stiffness changes as well. What these are without the damage is subtracted.
    """
    orders = [mesh.order for mesh in excitations]
    shared = [
        _common(one, other)
        for one, other in combinations(dict.fromkeys(orders), 2)
        if any((one / order).denominator == (other / order).denominator == 1 for order in teeth)
    ]
    damaged = [
        (number, order)
        for number, mesh in enumerate(excitations)
        for order in dict.fromkeys(teeth)
        if mesh.cycles > 1 and (order * mesh.cycles / mesh.order).denominator == (mesh.order / order).denominator == 1
    ]
    bases = dict.fromkeys([*shared, *(order for _, order in damaged), *orders])

    def home(order: Fraction) -> Fraction:
        """Return the base whose multiples the harmonics of a mesh are among."""
        within = [base for base in bases if (order / base).denominator == 1]
        return max(within, key=lambda base: (sum((each / base).denominator == 1 for each in orders), -base))

    found: dict[tuple[Fraction, int], NDArray[np.complex64]] = {}

    def add(base: Fraction, row: int, number: int, order: Fraction, lines: ComplexArray, sign: int = 1) -> None:
        shape = (1 + len(orders), len(orders), math.floor(top / base))
        every = int(order / base)
        some = found.setdefault((base, sign), np.zeros(shape, dtype=np.complex64))[row, number, every - 1 :: every]
        some += lines[: some.size]

    for number, mesh in enumerate(excitations):
        own = [(1 + number, mesh.varying[mesh.cycles - 1 :: mesh.cycles])]
        for cycles, lines in mesh.errors_n.items():
            own.append((0, lines[cycles - 1 :: cycles]))
            if cycles > 1:
                beside = lines.copy()
                beside[cycles - 1 :: cycles] = 0
                add(mesh.order / cycles, 0, number, mesh.order / cycles, beside)
        of_mesh = home(mesh.order)
        for row, lines in own:
            add(of_mesh, row, number, mesh.order, lines)
        for order in (order for of, order in damaged if of == number):
            step = int(order * mesh.cycles / mesh.order)
            lines, every = mesh.varying[step - 1 :: step].copy(), int(mesh.order / order)
            lines[every - 1 :: every] = 0
            add(order, 1 + number, number, order, lines)
            if of_mesh != order:
                for row, harmonics in own:
                    add(order, row, number, mesh.order, harmonics)
                    add(mesh.order, row, number, mesh.order, harmonics, -1)
    return [Family(base=base, lines=lines, sign=sign) for (base, sign), lines in found.items() if lines.any()]


def _common(one: Fraction, other: Fraction) -> Fraction:
    """Return the largest order of which both are multiples."""
    return Fraction(
        math.gcd(one.numerator * other.denominator, other.numerator * one.denominator),
        one.denominator * other.denominator,
    )


def spectral_lines(values: Array, count: int) -> ComplexArray:
    """Return the first lines (count,) of values at equidistant phases of a period, half a step from its ends."""
    cycles = np.arange(1, count + 1) / values.size
    return np.asarray(np.fft.rfft(values)[1 : count + 1] * (2 / values.size) * np.exp(-1j * np.pi * cycles))
