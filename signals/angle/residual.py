"""Residual, difference and regular signals of a time synchronous average, and its mesh band for demodulation.

The regular signal of a healthy gear consists of the harmonics of its mesh and of its shaft; without them the small
signal of a local tooth fault stands out. Each kind of signal has its own type, so that an indicator cannot be computed
from a signal for which it is not defined.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._validation import Array, checked, real_vector, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from signals.angle.averaging import SynchronousAverage


@dataclass(frozen=True, kw_only=True)
class _Part:
    """One revolution of part of an average, and the whole orders removed from it."""

    values: Array = field(metadata={"dims": ("angle",), "units": "as the record"})
    removed_orders: tuple[int, ...]

    @property
    def samples_per_rev(self) -> int:
        """Number of angles per revolution."""
        return int(self.values.size)

    @property
    def remaining_orders(self) -> tuple[int, ...]:
        """Whole orders not removed, up to half the samples per revolution."""
        removed = set(self.removed_orders)
        return tuple(order for order in range(self.values.size // 2 + 1) if order not in removed)


@dataclass(frozen=True, kw_only=True)
class ResidualSignal(_Part):
    """A synchronous average without mean, mesh harmonics and shaft orders; the sidebands remain.

    Attributes
    ----------
    values : (angle,) array
        One revolution, in the unit of the record.
    removed_orders : tuple of int
        Orders removed, including those above `max_order`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import ResidualSignal
    >>> ResidualSignal(values=np.zeros(8), removed_orders=(0, 2)).remaining_orders
    (1, 3, 4)
    """


@dataclass(frozen=True, kw_only=True)
class DifferenceSignal(_Part):
    """A residual signal without the sidebands next to each mesh harmonic.

    Attributes
    ----------
    values : (angle,) array
        One revolution, in the unit of the record.
    removed_orders : tuple of int
        Orders removed, including those above `max_order`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import DifferenceSignal
    >>> DifferenceSignal(values=np.zeros(8), removed_orders=(0, 1, 2, 3)).remaining_orders
    (4,)
    """


@dataclass(frozen=True, kw_only=True)
class RegularSignal(_Part):
    """The part of an average removed to obtain its residual or difference signal.

    Attributes
    ----------
    values : (angle,) array
        One revolution, in the unit of the record.
    removed_orders : tuple of int
        Orders not in it: those of the residual or difference signal.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import RegularSignal
    >>> RegularSignal(values=np.zeros(8), removed_orders=(1, 3)).remaining_orders
    (0, 2, 4)
    """


@dataclass(frozen=True, kw_only=True)
class MeshBand:
    """One mesh harmonic and its sidebands, as an analytic signal over one revolution.

    Attributes
    ----------
    analytic : (angle,) complex array
        ``sum_k Z_k exp(j k angle)`` over ``remaining_orders``, where Z_k are complex peak amplitudes.
    mesh_order : int
        Order of the mesh harmonic.
    sidebands : int
        Number of sidebands on either side.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import MeshBand
    >>> angle = 2 * np.pi * np.arange(256) / 256
    >>> band = MeshBand(analytic=3 * np.exp(1j * (30 * angle + 0.2)), mesh_order=30, sidebands=4)
    >>> round(float(band.amplitude[7]), 6), round(float(band.phase_rad[7]), 6), band.remaining_orders[0]
    (3.0, 0.2, 26)
    """

    analytic: NDArray[np.complex128] = field(metadata={"dims": ("angle",), "units": "as the record"})
    mesh_order: int
    sidebands: int

    @property
    def values(self) -> Array:
        """Band as a real signal, (samples_per_rev,)."""
        return np.ascontiguousarray(self.analytic.real)

    @property
    def amplitude(self) -> Array:
        """Envelope of the band, the amplitude modulation of the mesh harmonic, (samples_per_rev,)."""
        return np.abs(self.analytic)

    @property
    def phase_rad(self) -> Array:
        """Phase modulation: phase of the band less ``mesh_order`` times the angle, (samples_per_rev,), in rad.

        Unwrapped, between -pi and pi at angle zero.
        """
        angle = 2 * np.pi * np.arange(self.analytic.size) / self.analytic.size
        return np.unwrap(np.angle(self.analytic * np.exp(-1j * self.mesh_order * angle)))

    @property
    def samples_per_rev(self) -> int:
        """Number of angles per revolution."""
        return int(self.analytic.size)

    @property
    def remaining_orders(self) -> tuple[int, ...]:
        """Orders of the band: the mesh harmonic and its sidebands."""
        return tuple(range(self.mesh_order - self.sidebands, self.mesh_order + self.sidebands + 1))

    @property
    def removed_orders(self) -> tuple[int, ...]:
        """All other orders, up to half the samples per revolution."""
        kept = set(self.remaining_orders)
        return tuple(order for order in range(self.analytic.size // 2 + 1) if order not in kept)


@checked
def residual_signal(
    average: SynchronousAverage,
    *,
    teeth: int | Iterable[int],
    harmonics: int,
    shaft_orders: Iterable[int],
    max_order: int | None = None,
) -> ResidualSignal:
    """Return an average without mean, shaft orders and mesh harmonics (Stewart 1977, Southampton report MHM/R/10/77).

    Parameters
    ----------
    average : SynchronousAverage
        Average of the shaft that carries the gears.
    teeth : int or iterable of int
        Number of teeth of every gear on the averaged shaft.
    harmonics : int
        Number of mesh harmonics of each gear to remove, including the fundamental.
    shaft_orders : iterable of int
        Orders of the shaft to remove in addition to the mean, such as 1 for unbalance and 2 for misalignment.
    max_order : int, optional
        Highest order retained; default: the highest in the passband of the average.

    Returns
    -------
    ResidualSignal

    Raises
    ------
    ValueError
        No gear, or no order remaining.

    Examples
    --------
    Mesh order 8 and shaft order 1 are removed, the sideband at order 9 remains:

    >>> import numpy as np
    >>> from signals import SynchronousAverage, residual_signal
    >>> angle = 2 * np.pi * np.arange(64) / 64
    >>> sideband = 0.1 * np.cos(9 * angle)
    >>> average = SynchronousAverage(
    ...     values=np.cos(angle) + np.cos(8 * angle) + sideband, standard_error=np.zeros(64), revolutions=20
    ... )
    >>> residual = residual_signal(average, teeth=8, harmonics=3, shaft_orders=[1])
    >>> bool(np.allclose(residual.values, sideband))
    True
    """
    removed = _removed_orders(average, teeth, harmonics, shaft_orders, 0, max_order)
    return ResidualSignal(values=_without(average, removed), removed_orders=removed)


@checked
def difference_signal(
    average: SynchronousAverage,
    *,
    teeth: int | Iterable[int],
    harmonics: int,
    shaft_orders: Iterable[int],
    sidebands: int = 1,
    max_order: int | None = None,
) -> DifferenceSignal:
    """Return an average without mean, shaft orders, mesh harmonics and the sidebands next to them.

    FM4 (Stewart 1977), M6A and M8A (Martin 1989, MFPG 44) are defined on this signal, which was named by Lebold et al.
    (2000, "Review of vibration analysis methods for gearbox diagnostics and prognostics", MFPG 54).

    Parameters
    ----------
    average, teeth, harmonics, shaft_orders, max_order
        As in `residual_signal`.
    sidebands : int
        Number of sidebands on either side of each mesh harmonic to remove.

    Returns
    -------
    DifferenceSignal

    Raises
    ------
    ValueError
        As `residual_signal`, or fewer than one sideband.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import SynchronousAverage, difference_signal
    >>> angle = 2 * np.pi * np.arange(64) / 64
    >>> average = SynchronousAverage(
    ...     values=np.cos(8 * angle) + np.cos(9 * angle), standard_error=np.zeros(64), revolutions=20
    ... )
    >>> difference = difference_signal(average, teeth=8, harmonics=3, shaft_orders=[1])
    >>> bool(np.allclose(difference.values, 0))
    True
    """
    side = whole(sidebands, name="sidebands", least=1)
    removed = _removed_orders(average, teeth, harmonics, shaft_orders, side, max_order)
    return DifferenceSignal(values=_without(average, removed), removed_orders=removed)


@checked
def regular_signal(average: SynchronousAverage, *, left: ResidualSignal | DifferenceSignal) -> RegularSignal:
    """Return the regular signal of an average: the average less its residual or difference signal.

    Parameters
    ----------
    average : SynchronousAverage
        The average from which `left` was computed.
    left : ResidualSignal or DifferenceSignal
        Its residual or difference signal.

    Returns
    -------
    RegularSignal

    Raises
    ------
    ValueError
        Signals of different lengths.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import SynchronousAverage, regular_signal, residual_signal
    >>> angle = 2 * np.pi * np.arange(64) / 64
    >>> average = SynchronousAverage(
    ...     values=np.cos(8 * angle) + np.cos(9 * angle), standard_error=np.zeros(64), revolutions=20
    ... )
    >>> residual = residual_signal(average, teeth=8, harmonics=1, shaft_orders=[1])
    >>> bool(np.allclose(regular_signal(average, left=residual).values, np.cos(8 * angle)))
    True
    """
    if left.samples_per_rev != average.samples_per_rev:
        raise ValueError(
            f"left has {left.samples_per_rev} samples per revolution, the average {average.samples_per_rev}; give the "
            "average from which left was computed."
        )
    whole_signal = real_vector(average.values, name="the average")
    return RegularSignal(values=np.asarray(whole_signal - left.values), removed_orders=left.remaining_orders)


@checked
def mesh_band(average: SynchronousAverage, *, mesh_order: int, sidebands: int) -> MeshBand:
    """Return one mesh harmonic with its sidebands as an analytic signal (McFadden 1986, J. Vib. Acoust. 108, 165-170).

    Parameters
    ----------
    average : SynchronousAverage
        Average of the shaft that carries the gear.
    mesh_order : int
        Order of the harmonic, a multiple of the number of teeth.
    sidebands : int
        Number of sidebands retained on either side: fewer than half the teeth, so as not to overlap the next harmonic.

    Returns
    -------
    MeshBand

    Raises
    ------
    ValueError
        A band that includes order zero or leaves the passband of the average.

    Examples
    --------
    A mesh of 20 teeth, amplitude modulated by 30 % once per revolution:

    >>> import numpy as np
    >>> from signals import SynchronousAverage, mesh_band
    >>> angle = 2 * np.pi * np.arange(128) / 128
    >>> x = (1 + 0.3 * np.cos(angle)) * np.cos(20 * angle)
    >>> band = mesh_band(
    ...     SynchronousAverage(values=x, standard_error=np.zeros(128), revolutions=9), mesh_order=20, sidebands=5
    ... )
    >>> bool(np.allclose(band.amplitude, 1 + 0.3 * np.cos(angle)))
    True
    """
    values = real_vector(average.values, name="the average", minimum=4)
    last = _last_order(average)
    side = whole(sidebands, name="sidebands", least=1)
    centre = whole(mesh_order, name="mesh_order", least=1)
    if centre - side < 1 or centre + side > last:
        raise ValueError(
            f"the band of {side} sidebands about order {centre} extends from {centre - side} to {centre + side}, but "
            f"must lie between 1 and {last}, the end of the passband of the average; take fewer sidebands, or more "
            "samples per revolution."
        )
    lines = fft.fft(values)
    band = np.zeros_like(lines)
    band[centre - side : centre + side + 1] = 2 * lines[centre - side : centre + side + 1]
    return MeshBand(analytic=np.asarray(fft.ifft(band)), mesh_order=centre, sidebands=side)


def _last_order(average: SynchronousAverage) -> int:
    """Return the highest order in the passband of an average that lies below half its samples per revolution."""
    return int(min(average.passband_orders, (average.values.size - 1) // 2))


def _removed_orders(
    average: SynchronousAverage,
    teeth: int | Iterable[int],
    harmonics: int,
    shaft_orders: Iterable[int],
    sidebands: int,
    max_order: int | None,
) -> tuple[int, ...]:
    """Return the sorted orders of the mean, the shaft, the mesh harmonics with sidebands, and those above the last."""
    top = average.values.size // 2
    gears = list(teeth) if isinstance(teeth, Iterable) else [teeth]
    last = _last_order(average) if max_order is None else whole(max_order, name="max_order", least=1)
    removed = {0, *range(last + 1, top + 1)}
    removed.update(whole(order, name="a shaft order", least=0) for order in shaft_orders)
    count = whole(harmonics, name="harmonics", least=1)
    if not gears:
        raise ValueError("teeth is empty; give the number of teeth of every gear on the averaged shaft.")
    for gear in gears:
        mesh = whole(gear, name="teeth", least=2)
        for harmonic in range(1, min(count, (top + sidebands) // mesh) + 1):
            removed.update(range(harmonic * mesh - sidebands, harmonic * mesh + sidebands + 1))
    found = tuple(sorted(order for order in removed if 0 <= order <= top))
    if len(found) == top + 1:
        raise ValueError(
            f"all {top + 1} orders of the average of {average.values.size} samples are removed; to retain orders "
            "between the mesh harmonics, take more samples per revolution, or remove fewer shaft orders and sidebands."
        )
    return found


def _without(average: SynchronousAverage, orders: tuple[int, ...]) -> Array:
    values = real_vector(average.values, name="the average", minimum=4)
    lines = np.asarray(fft.rfft(values))
    lines[list(orders)] = 0
    return np.asarray(fft.irfft(lines, values.size), dtype=np.float64)
