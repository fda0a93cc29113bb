"""What is left of a synchronous average when its regular part is taken out, with every removed order written down.

A sound gear gives the harmonics of its mesh and of its shaft: the regular signal. Without them a local fault of one
tooth stands out, though it is far smaller. Each signal is a type of its own, so that an indicator that is defined
on one of them cannot be given another.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._checks import Array, real_vector, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals.averaging import SynchronousAverage


@dataclass(frozen=True, kw_only=True)
class _Part:
    values: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    removed_orders: tuple[int, ...]

    @property
    def samples_per_rev(self) -> int:
        """How many angles there are to a revolution."""
        return int(self.values.size)

    @property
    def kept_orders(self) -> tuple[int, ...]:
        """Whole orders that are still in, up to half the samples of a revolution."""
        removed = set(self.removed_orders)
        return tuple(order for order in range(self.values.size // 2 + 1) if order not in removed)


@dataclass(frozen=True, kw_only=True)
class ResidualSignal(_Part):
    """A synchronous average without mean, mesh harmonics and shaft orders; the sidebands are still in."""


@dataclass(frozen=True, kw_only=True)
class DifferenceSignal(_Part):
    """A residual signal without the sidebands next to each mesh harmonic either."""


@dataclass(frozen=True, kw_only=True)
class RegularSignal(_Part):
    """What a residual or difference signal had removed: together they are the average."""


@dataclass(frozen=True, kw_only=True)
class MeshBand:
    """One mesh harmonic and its sidebands, as an analytic signal over one revolution, ready to demodulate.

    ``analytic`` holds ``sum_k Z_k exp(j k angle)`` over ``kept_orders``, Z_k the complex peak amplitudes.
    """

    analytic: NDArray[np.complex128] = field(metadata={"dims": ("angle",), "units": "as the record"})
    mesh_order: int
    sidebands: int

    @property
    def values(self) -> Array:
        """The band as a real signal, (samples_per_rev,)."""
        return np.ascontiguousarray(self.analytic.real)

    @property
    def amplitude(self) -> Array:
        """Envelope of the band: the amplitude modulation of the mesh, (samples_per_rev,)."""
        return np.abs(self.analytic)

    @property
    def phase_rad(self) -> Array:
        """Phase modulation: by how much the mesh leads ``mesh_order`` times the angle, (samples_per_rev,), in rad.

        Continuous from angle to angle, between -pi and pi at angle zero.
        """
        angle = 2 * np.pi * np.arange(self.analytic.size) / self.analytic.size
        return np.unwrap(np.angle(self.analytic * np.exp(-1j * self.mesh_order * angle)))

    @property
    def samples_per_rev(self) -> int:
        """How many angles there are to a revolution."""
        return int(self.analytic.size)

    @property
    def kept_orders(self) -> tuple[int, ...]:
        """Orders of the band: the mesh harmonic and its sidebands."""
        return tuple(range(self.mesh_order - self.sidebands, self.mesh_order + self.sidebands + 1))

    @property
    def removed_orders(self) -> tuple[int, ...]:
        """All other orders, up to half the samples of a revolution."""
        kept = set(self.kept_orders)
        return tuple(order for order in range(self.analytic.size // 2 + 1) if order not in kept)


def residual_signal(
    average: SynchronousAverage,
    *,
    teeth: int | Iterable[int],
    harmonics: int,
    shaft_orders: Iterable[int],
    max_order: int | None = None,
) -> ResidualSignal:
    """Take mean, shaft orders and mesh harmonics out of an average (Stewart 1977, Southampton report MHM/R/10/77).

    Parameters
    ----------
    average : SynchronousAverage
    teeth : int, or several
        Of every gear on the averaged shaft.
    harmonics : int
        How many mesh harmonics of each gear are removed, the fundamental being the first.
    shaft_orders : ints
        Orders of the shaft itself that are removed beside the mean, as 1 for unbalance and 2 for misalignment.
    max_order : int, optional
        The highest order kept; default the highest one that the average passes unchanged.

    Returns
    -------
    ResidualSignal
        ``removed_orders`` names all that is not in it, also those above `max_order`.
    """
    removed = _regular(average, teeth, harmonics, shaft_orders, 0, max_order)
    return ResidualSignal(values=_without(average, removed), removed_orders=removed)


def difference_signal(
    average: SynchronousAverage,
    *,
    teeth: int | Iterable[int],
    harmonics: int,
    shaft_orders: Iterable[int],
    sidebands: int = 1,
    max_order: int | None = None,
) -> DifferenceSignal:
    """Take the sidebands next to each mesh harmonic out of a residual signal too.

    This is the signal of FM4 (Stewart 1977), M6A and M8A (Martin 1989, MFPG 44), named as Lebold et al. do (2000,
    "Review of vibration analysis methods for gearbox diagnostics and prognostics", MFPG 54).

    Parameters
    ----------
    average, teeth, harmonics, shaft_orders, max_order
        As in `residual_signal`.
    sidebands : int
        How many on either side of each mesh harmonic are removed.
    """
    side = whole(sidebands, name="sidebands", least=1)
    removed = _regular(average, teeth, harmonics, shaft_orders, side, max_order)
    return DifferenceSignal(values=_without(average, removed), removed_orders=removed)


def regular_signal(average: SynchronousAverage, *, left: ResidualSignal | DifferenceSignal) -> RegularSignal:
    """Return what was taken out of `average` to leave `left`: ``regular + left == average``, but for rounding."""
    if left.samples_per_rev != average.samples_per_rev:
        raise ValueError(
            f"what is left has {left.samples_per_rev} samples a revolution, the average {average.samples_per_rev}; "
            "give the average it was taken from."
        )
    whole_signal = real_vector(average.values, name="the average")
    return RegularSignal(values=np.asarray(whole_signal - left.values), removed_orders=left.kept_orders)


def mesh_band(average: SynchronousAverage, *, mesh_order: int, sidebands: int) -> MeshBand:
    """Cut one mesh harmonic with its sidebands out of an average (McFadden 1986, J. Vib. Acoust. 108(2), 165-170).

    Parameters
    ----------
    average : SynchronousAverage
    mesh_order : int
        Order of the harmonic: a multiple of the teeth.
    sidebands : int
        How many on either side are kept; fewer than half the teeth keep out of the next harmonic's.

    Raises
    ------
    ValueError
        A band that reaches order zero or leaves the passband of the average.
    """
    values = real_vector(average.values, name="the average", minimum=4)
    last = _last_order(average)
    side = whole(sidebands, name="sidebands", least=1)
    centre = whole(mesh_order, name="mesh_order", least=1)
    if centre - side < 1 or centre + side > last:
        raise ValueError(
            f"the band of {side} sidebands about order {centre} reaches from {centre - side} to {centre + side}, but "
            f"must lie between 1 and {last}, the highest order the average passes; take fewer sidebands, or more "
            "samples a revolution."
        )
    lines = fft.fft(values)
    band = np.zeros_like(lines)
    band[centre - side : centre + side + 1] = 2 * lines[centre - side : centre + side + 1]
    return MeshBand(analytic=np.asarray(fft.ifft(band)), mesh_order=centre, sidebands=side)


def _last_order(average: SynchronousAverage) -> int:
    """Return the highest order that an average passes unchanged, and that has a phase on its grid."""
    return int(min(average.passband_orders, (average.values.size - 1) // 2))


def _regular(
    average: SynchronousAverage,
    teeth: int | Iterable[int],
    harmonics: int,
    shaft_orders: Iterable[int],
    sidebands: int,
    max_order: int | None,
) -> tuple[int, ...]:
    top = average.values.size // 2
    gears = list(teeth) if isinstance(teeth, Iterable) else [teeth]
    last = _last_order(average) if max_order is None else whole(max_order, name="max_order", least=1)
    removed = {0, *range(last + 1, top + 1)}
    removed.update(whole(order, name="a shaft order", least=0) for order in shaft_orders)
    count = whole(harmonics, name="harmonics", least=1)
    if not gears:
        raise ValueError("no gear was named; give the teeth of every gear on the averaged shaft.")
    for gear in gears:
        mesh = whole(gear, name="teeth", least=2)
        for harmonic in range(1, count + 1):
            removed.update(range(harmonic * mesh - sidebands, harmonic * mesh + sidebands + 1))
    found = tuple(sorted(order for order in removed if 0 <= order <= top))
    if len(found) == top + 1:
        raise ValueError(
            f"all {top + 1} orders of the average are removed, nothing is left; the average of "
            f"{average.values.size} samples must hold orders between the mesh harmonics: take more samples a "
            "revolution."
        )
    return found


def _without(average: SynchronousAverage, orders: tuple[int, ...]) -> Array:
    values = real_vector(average.values, name="the average", minimum=4)
    lines = np.asarray(fft.rfft(values))
    lines[list(orders)] = 0
    return np.asarray(fft.irfft(lines, values.size), dtype=np.float64)
