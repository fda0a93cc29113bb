"""Mesh stiffness as the sum of tooth pairs that enter one after the other, each with a stiffness of its own."""

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
_NO_CONTACT = 1e20  # m/N: the pair is not in contact
_EDGE_OFFSET = 1e-12  # cycles: either side of an edge


class ToothFault(Protocol):
    """A fault of one tooth, by its effect on the compliance of the pair."""

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return the added compliance of a pair whose tooth `gear` (0 or 1) is faulty, (n,) m/N; inf: no contact."""

    def jump_phases(self, pair: ToothPair, gear: int) -> tuple[float, ...]:
        """Return phases after the pair entered at which that jumps."""


@dataclass(frozen=True, kw_only=True)
class DamagedTooth:
    """A faulty tooth of a gear.

    Attributes
    ----------
    gear : 0 or 1
        The driving or the driven gear.
    tooth : int
        Number of the tooth; it enters at this phase, and again after a revolution of its gear.
    fault : ToothFault
    """

    gear: int
    tooth: int
    fault: ToothFault


@dataclass(frozen=True, kw_only=True)
class TeethInMesh:
    """Mesh stiffness of all pairs in contact; pair p enters at phase p and leaves a contact ratio later.

    Built by `teeth_in_mesh`.

    Attributes
    ----------
    contact_ratio : float
    path_cycles : (n,) array
        Phases after a pair entered, from 0 to the contact ratio; a discontinuity has one on either side.
    compliance : (n,) array
        Of a healthy pair, m/N.
    damaged : tuple of (teeth, tooth, jump phases, (n,) array)
        For each damaged tooth: number of teeth of its gear, its number, phases of discontinuities, added compliance.
    """

    contact_ratio: float
    path_cycles: Array = field(metadata={"dims": ("path",), "units": "cycles"})
    compliance: Array = field(metadata={"dims": ("path",), "units": "m/N"})
    damaged: tuple[tuple[int, int, tuple[float, ...], Array], ...] = ()
    constant_between_jumps: bool = field(default=False, init=False)
    harmonics: ComplexArray | None = field(default=None, init=False)

    @property
    def period(self) -> int:
        """Period in cycles: the teeth of the damaged gear; their least common multiple where both gears are damaged."""
        return math.lcm(*(teeth for teeth, *_ in self.damaged)) if self.damaged else 1

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Phases of discontinuities: where a pair enters or leaves, or a fault begins or ends."""
        leaves = self.contact_ratio % 1
        found = {cycle + at for cycle in range(self.period) for at in (0.0, leaves)}
        for teeth, tooth, jump_phases, _ in self.damaged:
            for turn in range(self.period // teeth):
                found |= {(turn * teeth + tooth + edge) % self.period for edge in jump_phases}
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
            for teeth, tooth, _, fault_compliance in self.damaged:
                here = np.remainder(newest - older - tooth, teeth) == 0
                compliance += np.where(here, np.interp(since, self.path_cycles, fault_compliance), 0.0)
            total += np.where(since < self.contact_ratio, 1 / compliance, 0.0)
        return np.where(total > 1 / np.sqrt(_NO_CONTACT), total, 0.0)


def teeth_in_mesh(
    pair: ToothPair, *, damaged: Sequence[DamagedTooth] = (), teeth: tuple[int, int] | None = None
) -> TeethInMesh:
    """Return the mesh stiffness by strain energy, its teeth healthy or damaged.

    Pairs share the load as parallel springs; their coupling through the body of the gear is neglected, as usual.

    Parameters
    ----------
    pair : ToothPair
    damaged : sequence of DamagedTooth
    teeth : pair of int
        Numbers of teeth of the gears, where the pair is the virtual one of bevel gears.

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
    jump_phases = [tuple(at for at in item.fault.jump_phases(pair, item.gear) if 0 < at < ratio) for item in damaged]
    sides = [at + side for found in jump_phases for at in found for side in (-_EDGE_OFFSET, _EDGE_OFFSET)]
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
                np.minimum(item.fault.added_compliance(pair, item.gear, path), _NO_CONTACT),
            )
            for item, found in zip(damaged, jump_phases, strict=True)
        ),
    )


def helical(stiffness: Stiffness, *, overlap_ratio: float, harmonics: int) -> Fourier:
    """Return the stiffness of a helical mesh whose thin transverse slices are spur gears with this stiffness.

    Slices enter one after the other over `overlap_ratio` cycles, so harmonic h is multiplied by ``sinc(h eps / period)
    exp(-j pi h eps / period)``: an integer overlap ratio leaves a healthy mesh only its mean.

    Parameters
    ----------
    stiffness : Stiffness
        Of the whole face, were it a spur gear.
    overlap_ratio : float
        ``b sin(beta) / (pi m_n)``; `GearPair.overlap_ratio`.
    harmonics : int
        Number of terms, of the period of `stiffness`.
    """
    spur = fourier_series(stiffness, harmonics=harmonics)
    turns = np.arange(1, harmonics + 1) * overlap_ratio / spur.period
    return Fourier(
        mean=spur.mean, harmonics=spur.harmonics * np.sinc(turns) * np.exp(-1j * np.pi * turns), period=spur.period
    )
