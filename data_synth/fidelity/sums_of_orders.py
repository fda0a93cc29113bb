"""Lines at sums of orders: what a damaged tooth's stiffness makes of vibration with the period of another gear.

Where the deflection of a mesh, or its error, has a line at order ``n b``, the stiffness lines of a damaged tooth, at
multiples of its order a, make forces ``w' (G p_b - e_b)`` at ``n b + m a``: p_b those in the balance of the lines of b,
G the deflections by them, and w' the change of stiffness at orders that are multiples neither of b nor of the mesh's.
What these forces make on the varying stiffness is left out: they are weak beside what the tooth makes of static forces.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from data_synth.fidelity.excitation import Excitation
from data_synth.fidelity.harmonic_balance import Singles, between
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_NONE = 1e-6  # of the mean stiffness: lines below it are rounding
_HEARD = 0.005  # of the largest static force: of weaker deflections times the mean stiffness a tooth makes little
_LOOKED = 5  # speeds at which that is looked at


@dataclass(frozen=True, kw_only=True)
class Deflections:
    """Deflections of all meshes less their errors, times the mean stiffness, at the multiples of an order.

    Attributes
    ----------
    base : Fraction
    meshes : (some,) int array
        In which there are forces p.
    forces : (node, input, some, k) complex array
        p at some speeds.
    errors_n : (input, mesh, k) complex array
        The errors, times the mean stiffness, with the opposite sign.
    gains : (mesh, mesh, f) complex array
        Deflection of a mesh per N of p in another, times the mean stiffness, at even frequencies from zero.
    steps_hz : (node,) array
        The order ``b`` at each speed, in steps of these frequencies.
    """

    base: Fraction
    meshes: NDArray[np.int_]
    forces: Singles = field(repr=False)
    errors_n: Singles = field(repr=False)
    gains: ComplexArray = field(repr=False)
    steps_hz: Array

    def of(self, mesh: int, lines: NDArray[np.int_], nodes: NDArray[np.int_]) -> Singles:
        """Return those of a mesh at some multiples, from 1, and nodes: (node, input, line)."""
        place = np.multiply.outer(self.steps_hz[nodes], lines)
        found = np.tile(self.errors_n[:, mesh, lines - 1], (nodes.size, 1, 1))
        for row, other in enumerate(self.meshes):
            found += between(self.gains[mesh, other], place)[:, None] * self.forces[nodes, :, row][..., lines - 1]
        return found


@dataclass(frozen=True, kw_only=True)
class Sums:
    """Forces in meshes at the multiples of an order plus an offset, (node, input, mesh, k)."""

    base: Fraction
    offset: Fraction
    meshes: tuple[int, ...]
    forces: Singles = field(repr=False)


def sums_of(deflections: Deflections, excitations: Sequence[Excitation], static_n: Array) -> Iterator[Sums]:
    """Yield the forces that the stiffness of damaged teeth makes of deflections.

    Parameters
    ----------
    deflections : Deflections
    excitations : sequence of Excitation
        Of all meshes.
    static_n : (mesh,) array
        Largest static force.
    """
    base, every = deflections.base, np.arange(deflections.forces.shape[0])
    few = np.unique(np.linspace(0, every[-1], _LOOKED).round().astype(int))
    lines = np.arange(1, deflections.forces.shape[-1] + 1)
    found: dict[tuple[Fraction, Fraction], list[tuple[int, Singles]]] = {}
    for mesh, excitation in enumerate(excitations):
        step, stiffness = _of_damage(excitation, base)
        if not step:
            continue
        sizes = np.sum(np.max(np.abs(deflections.of(mesh, lines, few)), axis=0), axis=0)
        # orders that differ by multiples of that of the stiffness make forces at the same orders
        by_rest: dict[Fraction, list[int]] = {}
        for line in lines[sizes > _HEARD * static_n[mesh]].tolist():
            rest = line * base % step
            by_rest.setdefault(min(rest, step - rest), []).append(line)
        for rest, some in by_rest.items():
            known = dict(zip(some, np.moveaxis(deflections.of(mesh, np.array(some), every), -1, 0), strict=True))
            made = _product(stiffness, known, rest=rest / step, base=base / step)
            found.setdefault((step, rest), []).append((mesh, made))
    for (step, rest), parts in found.items():
        meshes, forces = tuple(mesh for mesh, _ in parts), np.stack([made for _, made in parts], axis=2)
        middle = forces.shape[-1] // 2
        above, below = forces[..., middle:], forces[..., middle - 1 :: -1].conj()
        if not rest:
            yield Sums(base=step, offset=rest, meshes=meshes, forces=above[..., 1:])
            continue
        yield Sums(base=step, offset=rest - step, meshes=meshes, forces=above)
        if 2 * rest != step:
            yield Sums(base=step, offset=-rest, meshes=meshes, forces=below)


def _of_damage(excitation: Excitation, base: Fraction) -> tuple[Fraction, ComplexArray]:
    """Return an order and the lines of the stiffness at its multiples; zero of stiffness without damage.

    Without those at harmonics of the mesh and at multiples of another order.
    """
    unit, multiples = excitation.order / excitation.cycles / base, np.arange(1, excitation.varying.size + 1)
    beside = (multiples * unit.numerator % unit.denominator != 0) & (multiples % excitation.cycles != 0)
    there = multiples[beside & (np.abs(excitation.varying) > _NONE)]
    if not there.size:
        return Fraction(0), excitation.varying
    every = math.gcd(*there.tolist())
    lines = np.zeros(there[-1] // every, dtype=np.complex128)
    lines[there // every - 1] = excitation.varying[there - 1]
    return every * excitation.order / excitation.cycles, lines


def _product(stiffness: ComplexArray, deflections: dict[int, Singles], *, rest: Fraction, base: Fraction) -> Singles:
    """Return the lines at ``rest + q``, (..., q), q from -k to k, of stiffness (k,) times deflections at multiples.

    The rest and the order of which they are multiples in units of that of the stiffness.
    """
    from scipy.fft import fft, ifft, irfft, next_fast_len  # noqa: PLC0415

    most = stiffness.size
    points = next_fast_len(3 * most + 2)
    some = next(iter(deflections.values()))
    spectrum = np.zeros((*some.shape, points), dtype=np.complex64)
    for line, amplitudes in deflections.items():
        for order, values in ((line * base, amplitudes), (-line * base, amplitudes.conj())):
            place = order - rest
            if place.denominator == 1 and abs(place) <= most:
                spectrum[..., most + int(place)] += values
    wave = irfft(np.concatenate([[0], stiffness]), points) * (points / 2)
    return np.asarray(fft(ifft(spectrum) * wave, overwrite_x=True)[..., : 2 * most + 1], dtype=np.complex64)
