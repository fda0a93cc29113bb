"""Residual energies: a signal over angle without its mesh harmonics, in bands of orders.

The harmonics of all meshes are removed with the lines close to them, due to run-out, load and planet passes. The
contribution of a damaged tooth is short, therefore wide in order, and remains; `signals.angle.local_damage` tests it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._transforms import forget_plans
from signals._validation import Array, positive, whole

if TYPE_CHECKING:
    from collections.abc import Mapping
    from fractions import Fraction

    from numpy.typing import NDArray

    from signals.resampling.resampling import AngularSignal


@dataclass(frozen=True, kw_only=True)
class BandEnergies:
    """Squared envelopes of the residual in bands of orders, over the angle of a reference shaft.

    Attributes
    ----------
    values : (band, n) array
        Squared envelopes, in the squared unit of the record.
    samples_per_rev : float
        Samples per revolution of the reference.
    start_rev : float
        Angle of the first sample in revolutions of the reference.
    edges : (band + 1,) array
        Limits of the bands in orders of the reference.
    """

    values: Array = field(metadata={"dims": ("band", "angle")})
    samples_per_rev: float
    start_rev: float
    edges: Array

    @property
    def revolutions(self) -> Array:
        """Angle of each sample, (n,), in revolutions of the reference."""
        return self.start_rev + np.arange(self.values.shape[1]) / self.samples_per_rev


def residual_energies(
    signal: AngularSignal,
    *,
    meshes: Mapping[float, float],
    lowest_order: float,
    bands: int = 8,
    transform: NDArray[np.complex128] | None = None,
) -> BandEnergies:
    """Return the squared envelopes, in equal bands of orders, of a signal without its mesh harmonics.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference.
    meshes : mapping of float to float
        Half width of the range removed around each harmonic, by mesh order, both in orders of the reference; limited to
        a quarter of the mesh order.
    lowest_order : float
        Order below which everything is removed, including the shafts.
    bands : int
        Number of bands.
    transform : (m // 2 + 1,) array, optional
        The `tapered_transform` of the signal, if known.

    Returns
    -------
    BandEnergies

    Raises
    ------
    ValueError
        No order above `lowest_order`.

    Examples
    --------
    A mesh of order 20 with run-out leaves only the leakage of the ends of the record:

    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import residual_energies
    >>> angle = 2 * np.pi * np.arange(64 * 128) / 128
    >>> x = (1 + 0.3 * np.cos(angle)) * np.cos(20 * angle)
    >>> signal = AngularSignal(values=x, samples_per_rev=128, start_rev=0.0, passband_orders=56.0)
    >>> bool(residual_energies(signal, meshes={20.0: 2.5}, lowest_order=3.0).values.max() < 1e-5)
    True
    """
    count, low = whole(bands, name="bands", least=1), positive(lowest_order, name="lowest_order")
    size, top = signal.values.size, signal.passband_orders
    if low >= top:
        raise ValueError(
            f"lowest_order={low:g} is not below {top:g}, the highest order of the signal; lower it, or sample faster."
        )
    lines, left_out, padded = _mesh_lines(signal, meshes, transform)
    per_order = padded / signal.samples_per_rev
    edges = np.linspace(low, top, count + 1)
    bins = np.rint(edges * per_order).astype(int)
    length = fft.next_fast_len(2 * int(np.diff(bins).max()))  # the square of a band is twice as wide
    energies = np.empty((count, length))
    for band in range(count):
        part = np.zeros(length, dtype=np.complex128)
        own = slice(bins[band], bins[band + 1])
        np.copyto(part[: own.stop - own.start], lines[own], where=~left_out[own])
        analytic = fft.ifft(part, overwrite_x=True)
        energies[band] = (2 * length / padded) ** 2 * (analytic.real**2 + analytic.imag**2)
    values = energies[:, : math.ceil(length * size / padded)]
    return BandEnergies(values=values, samples_per_rev=length / per_order, start_rev=signal.start_rev, edges=edges)


def whitened_residual(
    signal: AngularSignal,
    *,
    meshes: Mapping[float, float],
    edges: Array,
    transform: NDArray[np.complex128] | None = None,
) -> AngularSignal:
    """Return a signal without its mesh harmonics, with its bands scaled to the same power.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference.
    meshes, transform
        As in `residual_energies`.
    edges : (band + 1,) array
        Limits of the bands in orders of the reference; orders outside them are removed.

    Returns
    -------
    AngularSignal
        With a mean square of one in each band that has any power.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import whitened_residual
    >>> x = np.random.default_rng(0).normal(size=64 * 128)
    >>> signal = AngularSignal(values=x, samples_per_rev=128, start_rev=0.0, passband_orders=56.0)
    >>> found = whitened_residual(signal, meshes={20.0: 2.5}, edges=np.array([4.0, 30.0, 56.0]))
    >>> round(float(np.mean(found.values**2)), 1)  # of two bands
    2.0
    """
    lines, left_out, padded = _mesh_lines(signal, meshes, transform)
    size = signal.values.size
    bins = np.rint(np.asarray(edges) * (padded / signal.samples_per_rev)).astype(int)
    white = np.zeros_like(lines)
    for low, high in itertools.pairwise(bins.tolist()):
        np.copyto(white[low:high], lines[low:high], where=~left_out[low:high])
        power = 2 * float(np.sum(white[low:high].real ** 2 + white[low:high].imag ** 2)) / (padded * size)
        if power > 0:
            white[low:high] /= math.sqrt(power)
    return replace(signal, values=fft.irfft(white, padded)[:size])


def tapered_transform(signal: AngularSignal) -> NDArray[np.complex128]:
    """Return the discrete Fourier transform of a signal without its mean, its ends tapered over up to a revolution.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference.

    Returns
    -------
    (m // 2 + 1,) array
        In the unit of the signal, unscaled, of the signal zero-padded to the next length m with a fast transform.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import tapered_transform
    >>> x = np.cos(2 * np.pi * 5 * np.arange(1024) / 64)
    >>> signal = AngularSignal(values=x, samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    >>> int(np.argmax(np.abs(tapered_transform(signal)))) / 16  # over 16 revolutions
    5.0
    """
    size = signal.values.size
    values = signal.values - signal.values.mean()
    ramp = min(signal.samples_per_rev, size // 8)  # without a taper the discontinuity at the ends rings in every band
    taper = np.sin(0.5 * np.pi * (np.arange(ramp) + 0.5) / ramp) ** 2
    values[:ramp] *= taper
    values[size - ramp :] *= taper[::-1]
    lines = np.fft.rfft(values, fft.next_fast_len(size, real=True))  # pads without a copy
    forget_plans(size)
    return lines


def _mesh_lines(
    signal: AngularSignal, meshes: Mapping[float, float], transform: NDArray[np.complex128] | None
) -> tuple[NDArray[np.complex128], NDArray[np.bool_], int]:
    """Return the transform of a signal, which of its lines are mesh harmonics or close to one, and its length."""
    lines = tapered_transform(signal) if transform is None else transform
    padded, on = fft.next_fast_len(signal.values.size, real=True), np.zeros(lines.size, dtype=bool)
    per_order = padded / signal.samples_per_rev
    for mesh, spread in meshes.items():
        width = min(spread, mesh / 4)
        # beyond 40 harmonics no mesh has measurable ones
        for harmonic in range(1, min(40, int((on.size / per_order + width) / mesh)) + 1):
            first, last = (round((harmonic * mesh + side) * per_order) for side in (-width, width))
            on[first : last + 1] = True
    return lines, on, padded


def mesh_contrast(residual: AngularSignal, *, order: Fraction | float, teeth: float, position_rev: float) -> float:
    """Return the ratio of the power that a tooth adds near the harmonics of its mesh to that between them.

    A damaged tooth modulates the mesh of its own gear, in amplitude and phase, for about one tooth pitch. The sidebands
    at multiples of the shaft order decay within half the mesh order from its harmonics (Randall 1982, J. Mech. Des.
    104, 259-267). Of two gears on one shaft, whose teeth cannot be distinguished by their angular position, the
    modulated one has the larger ratio. Impacts alone, of a tooth or of a loose part on the shaft, are no stronger near
    the harmonics than between them.

    Parameters
    ----------
    residual : AngularSignal
        From `whitened_residual`, over at least two revolutions of the gear.
    order : Fraction or float
        Revolutions of the gear per revolution of the reference.
    teeth : float
        Teeth of the gear, whose mesh order is ``teeth * order``.
    position_rev : float
        Place of the tooth, 0 to 1 revolution of the gear from angle zero of the reference.

    Returns
    -------
    float
        The power considered is that within four teeth of the place, in excess of three other places; "near" is within a
        quarter of the mesh order from a harmonic. Each harmonic is normalised by the other places and weighted by its
        excess. The ratio is 0 if the place has no excess power or no harmonic is in the order range.

    Examples
    --------
    One of 30 teeth, on a shaft with a second gear of 17 teeth:

    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import mesh_contrast, whitened_residual
    >>> turn = np.arange(64 * 256) / 256
    >>> bump = np.exp(-0.5 * (((turn + 0.5) % 1 - 0.5) * 30 / 0.6) ** 2)
    >>> x = (1 - 0.3 * bump) * np.cos(2 * np.pi * 30 * turn) + np.cos(2 * np.pi * 17 * turn)
    >>> x += np.random.default_rng(0).normal(0, 0.1, turn.size)
    >>> signal = AngularSignal(values=x, samples_per_rev=256, start_rev=0.0, passband_orders=100.0)
    >>> residual = whitened_residual(signal, meshes={30.0: 2.5, 17.0: 2.5}, edges=np.array([3.0, 100.0]))
    >>> own, other = (mesh_contrast(residual, order=1, teeth=teeth, position_rev=0.0) for teeth in (30, 17))
    >>> own > 2 * other
    True
    """
    rate, pitch = positive(order, name="order"), positive(teeth, name="teeth")
    size, padded = residual.values.size, fft.next_fast_len(residual.values.size, real=True)
    turn = rate * (residual.start_rev + np.arange(size) / residual.samples_per_rev) - position_rev
    highest = max(0, int(residual.passband_orders / (rate * pitch) - 0.5))
    # per harmonic: between the previous one and this, near this one, between this and the next; half of all lines are
    # within a quarter of the mesh order from a harmonic
    ends = np.arange(1, highest + 2)[:, None] + (-0.5, -0.25, 0.25)
    starts = np.ceil(ends.ravel()[: 3 * highest + 1] * rate * pitch * padded / residual.samples_per_rev).astype(int)

    other_places = (0.35, 0.5, 0.65)  # revolutions from the tooth

    def gated_power(at: float) -> Array:
        apart = turn - at
        apart -= np.rint(apart)
        # 4 teeth on either side, unless the gates of two places would overlap; a shorter gate smears near and between
        apart /= min(4.0 / pitch, other_places[0] / 2)
        inside = np.flatnonzero(np.abs(apart) < 1)
        gated = np.zeros(size)
        gated[inside] = residual.values[inside] * np.cos(0.5 * np.pi * apart[inside]) ** 2
        lines = fft.rfft(gated, padded)
        below, beside, beyond = np.add.reduceat(lines.real**2 + lines.imag**2, starts)[:-1].reshape(-1, 3).T
        return np.stack([below + beyond, beside], axis=1)

    at_tooth, elsewhere = gated_power(0.0), np.mean([gated_power(place) for place in other_places], axis=0)
    background = elsewhere.mean(axis=1, keepdims=True)
    above = np.divide(np.maximum(at_tooth - elsewhere, 0.0), background, where=background > 0, out=0 * elsewhere)
    between, beside = above.sum(axis=1) @ above
    return float(beside / between) if between > 0 else math.inf if beside > 0 else 0.0
