"""Lines at the multiples of a base order: what a healthy gearbox says, and how lines are added up.

A kinematic scene moves without vibrating: each shaft and each mesh is one periodic source in the angle of the
reference shaft, with harmonics of declared amplitudes and random phases. Nothing modulates a healthy source,
so it has no sidebands (nor, in a planetary gearbox, the passing of planets).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_synth.profile import Array
from data_synth.scene import Scene

ComplexArray = NDArray[np.complex128]
Draws = Callable[..., np.random.Generator]  # a generator of its own for every word it is called with


@dataclass(frozen=True, kw_only=True)
class Comb:
    """A source that is periodic in the angle of the reference shaft.

    Attributes
    ----------
    component, kind : str
        What speaks, in the words of the defect orders.
    source : str
        From where it travels to the sensors: combs with one source share their gains.
    base : Fraction
        Order of the first line.
    coefficients : (k,) complex array
        Peak amplitude and phase of the lines at 1, 2, ... k times `base`, in the sensors' units.
    loaded : bool
        Whether the amplitude follows the load on the teeth.
    """

    component: str
    kind: str
    source: str
    base: Fraction
    coefficients: ComplexArray
    loaded: bool

    @property
    def orders(self) -> list[Fraction]:
        """Orders of all lines, exact."""
        return [multiple * self.base for multiple in range(1, self.coefficients.size + 1)]


def healthy_combs(scene: Scene, *, draws: Draws) -> list[Comb]:
    """Return one comb for each shaft that turns in the frame and one for each mesh."""
    combs = []
    for kind, amplitude in (
        ("shaft", scene.excitation.shaft_amplitude),
        ("gear_mesh", scene.excitation.mesh_amplitude),
    ):
        for component, order in scene.exact_orders(kind).items():
            harmonics = np.arange(scene.excitation.harmonics)
            turns = draws("phase", kind, component).random(harmonics.size)
            combs.append(
                Comb(
                    component=component,
                    kind=kind,
                    source=component,
                    base=order,
                    coefficients=amplitude * scene.excitation.decay**harmonics * np.exp(2j * np.pi * turns),
                    loaded=kind == "gear_mesh",
                )
            )
    return combs


def common_base(first: Fraction, second: Fraction) -> Fraction:
    """Return the largest order of which both orders are whole multiples."""
    (p, q), (r, s) = first.as_integer_ratio(), second.as_integer_ratio()
    return Fraction(math.gcd(p * s, r * q), q * s)


def add_lines(signal: Array, amplitudes: ComplexArray, *, base: Fraction, revolutions: Array, position: Array) -> None:
    """Add ``Re sum_k Z_k exp(j 2 pi k base revolutions)`` to a signal, Z linear between its instants.

    Parameters
    ----------
    signal : (channel, n) array
        Changed in place.
    amplitudes : (channel, k, instant) complex array
        Z of the lines at 1, 2, ... k times `base`.
    base : Fraction
        Order of the first line.
    revolutions : (n,) array
        Angle of the reference shaft at the samples, in rev.
    position : (n,) array
        Times of the samples counted in instants: 2.5 lies halfway between the third and the fourth.
    """
    last = amplitudes.shape[2] - 1
    edges = [*np.searchsorted(position, np.arange(last)), position.size]
    turn = np.exp(2j * np.pi * np.remainder(float(base) * revolutions, 1.0))
    rises = np.diff(amplitudes, axis=2)
    for instant, (start, stop) in enumerate(pairwise(edges)):
        ends = np.concatenate([amplitudes[:, :, instant], rises[:, :, instant]])
        here, rise = np.split(_series(ends, turn[start:stop]), 2)
        signal[:, start:stop] += here + (position[start:stop] - instant) * rise


def _series(coefficients: ComplexArray, turn: ComplexArray) -> Array:
    """Return ``Re sum_k c_k turn ** k``, k from 1, for rows of coefficients (r, k) at n points: (r, n).

    By Horner's rule and not by a matrix product, whose threads cost more than they save on so small a block.
    """
    total = np.zeros((coefficients.shape[0], turn.size), dtype=np.complex128)
    for column in coefficients.T[::-1]:
        total += column[:, None]
        total *= turn
    return total.real
