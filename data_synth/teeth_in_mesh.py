"""Mesh stiffness from pairs of teeth that enter one after the other, each with a stiffness of its own."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from data_synth.mesh import Array, ComplexArray, Fourier, Stiffness, fourier_series, quadrature
from data_synth.tooth_stiffness import ToothPair

_POINTS = 257  # along the path of contact: linear between them to 1e-5 of the stiffness
_OPEN = 1e20  # m/N: nothing carries there
_BESIDE = 1e-12  # cycles: either side of an edge


class ToothFault(Protocol):
    """What is wrong with one tooth."""

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return what it adds to the compliance of a pair whose tooth `gear` (0 or 1) has it, (n,) m/N; inf: open."""

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:
        """Return phases after the pair entered at which that jumps."""


@dataclass(frozen=True, kw_only=True)
class DamagedTooth:
    """A fault on one tooth.

    Attributes
    ----------
    gear : 0 or 1
    tooth : int
        Number of the tooth; it enters at this phase, and again after a turn of its gear.
    fault : ToothFault
    """

    gear: int
    tooth: int
    fault: ToothFault


@dataclass(frozen=True, kw_only=True)
class TeethInMesh:
    """The stiffness of all pairs in contact; pair p enters at phase p and leaves a contact ratio later.

    Build one with `teeth_in_mesh`.

    Attributes
    ----------
    contact_ratio : float
    path_cycles : (n,) array
        Phases after a pair entered, from 0 to the contact ratio; an edge stands there twice.
    compliance : (n,) array
        Of a healthy pair, m/N.
    damaged : tuple of (teeth, tooth, edges, (n,) array)
        For each damaged tooth: how many its gear has, its number, the phases where its stiffness jumps, what it adds.
    """

    contact_ratio: float
    path_cycles: Array = field(metadata={"dims": ("path",), "units": "cycles"})
    compliance: Array = field(metadata={"dims": ("path",), "units": "m/N"})
    damaged: tuple[tuple[int, int, tuple[float, ...], Array], ...] = ()
    constant_between_jumps: bool = field(default=False, init=False)
    harmonics: ComplexArray | None = field(default=None, init=False)

    @property
    def period(self) -> int:
        """Cycles of a turn of the gear with a damaged tooth; until the same teeth meet, where both gears have one."""
        return math.lcm(*(teeth for teeth, *_ in self.damaged)) if self.damaged else 1

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which a pair enters or leaves, or a fault begins or ends."""
        leaves = self.contact_ratio % 1
        found = {cycle + at for cycle in range(self.period) for at in (0.0, leaves)}
        for teeth, tooth, edges, _ in self.damaged:
            for turn in range(self.period // teeth):
                found |= {(turn * teeth + tooth + edge) % self.period for edge in edges}
        return tuple(sorted(found))

    @cached_property
    def mean(self) -> float:
        """Mean over a period in N/m."""
        phases, weights = quadrature(self)
        return float(weights @ self(phases)) / self.period

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return N/m at phases in mesh cycles, any shape."""
        phase = np.asarray(phase_cycles, dtype=np.float64)
        newest = np.floor(phase)
        total = np.zeros_like(phase)
        for older in range(math.ceil(self.contact_ratio)):
            since = phase - newest + older
            compliance = np.interp(since, self.path_cycles, self.compliance)
            for teeth, tooth, _, added in self.damaged:
                here = np.remainder(newest - older - tooth, teeth) == 0
                compliance += np.where(here, np.interp(since, self.path_cycles, added), 0.0)
            total += np.where(since < self.contact_ratio, 1 / compliance, 0.0)
        return np.where(total > 1 / np.sqrt(_OPEN), total, 0.0)


def teeth_in_mesh(
    pair: ToothPair, *, damaged: Sequence[DamagedTooth] = (), teeth: tuple[int, int] | None = None
) -> TeethInMesh:
    """Return the stiffness of a mesh by strain energy, its teeth healthy or damaged.

    Pairs share the load as springs side by side; that they also share the body of their gear is left out, as usual.

    Parameters
    ----------
    pair : ToothPair
    damaged : sequence of DamagedTooth
    teeth : pair of int
        How many the gears have, where the pair is but the virtual one of bevel gears.

    Raises
    ------
    ValueError
        A gear other than 0 and 1, or a tooth that its gear does not have.
    """
    ratio = pair.gears.contact_ratio
    counts = [abs(count) for count in teeth or pair.gears.teeth]
    for item in damaged:
        if item.gear not in (0, 1) or not 0 <= item.tooth < counts[item.gear]:
            raise ValueError(
                f"gear = {item.gear}, tooth = {item.tooth}: gears are 0 and 1, and teeth count from 0 to "
                f"{', '.join(str(count - 1) for count in counts)}."
            )
    edges = [tuple(at for at in item.fault.edges(pair, item.gear) if 0 < at < ratio) for item in damaged]
    sides = [at + side for found in edges for at in found for side in (-_BESIDE, _BESIDE)]
    path = np.unique(np.concatenate([np.linspace(0, ratio, _POINTS), np.array(sides)]))
    return TeethInMesh(
        contact_ratio=ratio,
        path_cycles=path,
        compliance=pair.compliance(path),
        damaged=tuple(
            (
                counts[item.gear],
                item.tooth,
                found,
                np.minimum(item.fault.added_compliance(pair, item.gear, path), _OPEN),
            )
            for item, found in zip(damaged, edges, strict=True)
        ),
    )


def helical(stiffness: Stiffness, *, overlap_ratio: float, harmonics: int) -> Fourier:
    """Return the stiffness of a helical mesh whose thin slices are spur gears with this one.

    Slices enter one after the other over `overlap_ratio` cycles, so harmonic h is multiplied by ``sinc(h eps / period)
    exp(-j pi h eps / period)``: a whole overlap ratio leaves a healthy mesh with its mean alone.

    Parameters
    ----------
    stiffness : Stiffness
        Of the whole face, were it a spur gear.
    overlap_ratio : float
        ``b sin(beta) / (pi m_n)``; `GearPair.overlap_ratio`.
    harmonics : int
        Kept, of the period of `stiffness`.
    """
    spur = fourier_series(stiffness, harmonics=harmonics)
    turns = np.arange(1, harmonics + 1) * overlap_ratio / spur.period
    return Fourier(
        mean=spur.mean, harmonics=spur.harmonics * np.sinc(turns) * np.exp(-1j * np.pi * turns), period=spur.period
    )
