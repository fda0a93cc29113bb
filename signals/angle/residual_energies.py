"""Energies of what meshes leave: a signal over angle without their harmonics, in bands of orders and between meshes.

The harmonics of all meshes are removed with what stands close beside them: run-out, load, planet passes. What a damaged
tooth adds is short and so wide in order, and stays. `signals.angle.local_damage` judges the teeth by it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._median import median
from signals._validation import Array, positive, whole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from fractions import Fraction

    from numpy.typing import NDArray

    from signals.resampling.resampling import AngularSignal

_HARMONICS = 40  # of each mesh removed; a mesh has no measurable ones beyond
_NEAR_MESH = 0.25  # of the mesh order: half of all lines are nearer to a harmonic, half of them farther from it


@dataclass(frozen=True, kw_only=True)
class BandEnergies:
    """Squared envelopes of the residual in bands of orders, over the angle of a reference shaft.

    Attributes
    ----------
    values : (band, n) array
        Squared envelope, in the square of the record's unit.
    samples_per_rev : float
        Samples per revolution of the reference.
    start_rev : float
        Angle of the first sample, revolutions of the reference.
    edges : (band + 1,) array
        Limits of the bands, orders of the reference.
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
        Of each mesh order, in orders of the reference, how far on either side of each harmonic is removed. At most a
        quarter of the mesh order is.
    lowest_order : float
        Below it everything is removed: shafts.
    bands : int
        Number of bands.
    transform : (m // 2 + 1,) array, optional
        The `tapered_transform` of the signal, where it is known.

    Returns
    -------
    BandEnergies

    Raises
    ------
    ValueError
        No order above `lowest_order`.

    Examples
    --------
    A mesh of order 20 with run-out leaves nothing but rounding:

    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import residual_energies
    >>> angle = 2 * np.pi * np.arange(64 * 128) / 128
    >>> x = (1 + 0.3 * np.cos(angle)) * np.cos(20 * angle)
    >>> signal = AngularSignal(values=x, samples_per_rev=128, start_rev=0.0, passband_orders=56.0)
    >>> bool(residual_energies(signal, meshes={20.0: 2.5}, lowest_order=3.0).values.max() < 1e-20)
    True
    """
    count, low = whole(bands, name="bands", least=1), positive(lowest_order, name="lowest_order")
    size, top = signal.values.size, signal.passband_orders
    if low >= top:
        raise ValueError(f"lowest_order={low:g} is not below {top:g}, the highest order of the signal; sample faster.")
    lines = tapered_transform(signal) if transform is None else transform
    padded = _padded(size)
    per_order = padded / signal.samples_per_rev
    left_out = _of_meshes(lines.size, per_order, meshes)
    edges = np.linspace(low, top, count + 1)
    bins = np.rint(edges * per_order).astype(int)
    length = fft.next_fast_len(2 * int(np.diff(bins).max()))  # the square of a band is twice as wide
    energies = np.empty((count, length))
    for band in range(count):
        part = np.zeros(length, dtype=np.complex128)
        own = slice(bins[band], bins[band + 1])
        np.copyto(part[: own.stop - own.start], lines[own], where=~left_out[own])
        analytic = fft.ifft(part, overwrite_x=True)
        np.square(analytic.real, out=energies[band])
        energies[band] += np.square(analytic.imag)
        energies[band] *= (2 * length / padded) ** 2
    values = energies[:, : math.ceil(length * size / padded)]
    return BandEnergies(values=values, samples_per_rev=length / per_order, start_rev=signal.start_rev, edges=edges)


def whitened_residual(
    signal: AngularSignal,
    *,
    meshes: Mapping[float, float],
    edges: Array,
    transform: NDArray[np.complex128] | None = None,
) -> AngularSignal:
    """Return a signal without its mesh harmonics, its bands scaled to the same power.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference.
    meshes, transform
        As in `residual_energies`.
    edges : (band + 1,) array
        Limits of the bands, orders of the reference; what lies outside of them is removed.

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
    lines = tapered_transform(signal) if transform is None else transform
    size = signal.values.size
    padded = _padded(size)
    per_order = padded / signal.samples_per_rev
    left_out = _of_meshes(lines.size, per_order, meshes)
    bins = np.rint(np.asarray(edges) * per_order).astype(int)
    white = np.zeros_like(lines)
    for low, high in itertools.pairwise(bins.tolist()):
        np.copyto(white[low:high], lines[low:high], where=~left_out[low:high])
        power = 2 * float(np.sum(white[low:high].real ** 2 + white[low:high].imag ** 2)) / (padded * size)
        if power > 0:
            white[low:high] /= math.sqrt(power)
    return replace(signal, values=fft.irfft(white, padded)[:size])


def tapered_transform(signal: AngularSignal) -> NDArray[np.complex128]:
    """Return the discrete Fourier transform of a signal without its mean, its ends tapered by up to a revolution.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference.

    Returns
    -------
    (m // 2 + 1,) array
        In the unit of the signal, not scaled; of the signal with zeros behind it, up to the next length m without large
        prime factors, whose transform would take several times as long.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import tapered_transform
    >>> x = np.cos(2 * np.pi * 5 * np.arange(1024) / 64)
    >>> signal = AngularSignal(values=x, samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    >>> int(np.argmax(np.abs(tapered_transform(signal)))) / 16  # of 16 turns
    5.0
    """
    size = signal.values.size
    values = signal.values - signal.values.mean()
    ramp = min(signal.samples_per_rev, size // 8)  # the ends do not meet: without a taper they ring in every band
    taper = np.sin(0.5 * np.pi * (np.arange(ramp) + 0.5) / ramp) ** 2
    values[:ramp] *= taper
    values[size - ramp :] *= taper[::-1]
    return np.asarray(fft.rfft(values, _padded(size)))


def _padded(size: int) -> int:
    """Return the samples of a transform of `size` samples and zeros."""
    return int(fft.next_fast_len(size, real=True))


def _of_meshes(size: int, per_order: float, meshes: Mapping[float, float]) -> NDArray[np.bool_]:
    """Return which of `size` lines, `per_order` of them in an order, are harmonics of meshes or stand beside them."""
    on = np.zeros(size, dtype=bool)
    for mesh, spread in meshes.items():
        width = min(spread, mesh / 4)
        for harmonic in range(1, min(_HARMONICS, int((size / per_order + width) / mesh)) + 1):
            first, last = (round((harmonic * mesh + side) * per_order) for side in (-width, width))
            on[first : last + 1] = True
    return on


def mesh_contrast(
    signal: AngularSignal,
    *,
    order: Fraction | float,
    teeth: Sequence[float],
    meshes: Mapping[float, float],
    lowest_order: float,
    transform: NDArray[np.complex128] | None = None,
) -> Array:
    """Return how much more power the multiples of a shaft have near the harmonics of each mesh than between them.

    A damaged tooth modulates the mesh of its own gear, in amplitude and phase, for about one tooth: sidebands at
    multiples of the shaft, which fall off within half of the mesh order from its harmonics (Randall 1982, J. Mech. Des.
    104, 259-267). Of two gears of one shaft, whose teeth cannot be told apart by their place in the turn, it is large
    for the one that is modulated. Impacts alone are as strong between the harmonics as near them: about 1 for both.

    Parameters
    ----------
    signal : AngularSignal
        Samples over the angle of the reference, no fewer than two turns of the shaft.
    order : Fraction or float
        Turns of the shaft per revolution of the reference.
    teeth : sequence of float
        Teeth of each gear of the shaft: its mesh has the order ``teeth * order``.
    meshes, lowest_order, transform
        What is left out, and the transform where it is known, as in `residual_energies`.

    Returns
    -------
    (gear,) array
        Mean power, above that of the noise, of the multiples within a quarter of the mesh order from its harmonics,
        over that of the others; NaN where the order range lacks one of the two, 0 where there is only noise.

    Examples
    --------
    A tooth of 30, on a shaft with a second gear of 17 teeth:

    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.residual_energies import mesh_contrast
    >>> turn = np.arange(64 * 256) / 256
    >>> bump = np.exp(-0.5 * (((turn + 0.5) % 1 - 0.5) * 30 / 0.6) ** 2)
    >>> x = (1 - 0.3 * bump) * np.cos(2 * np.pi * 30 * turn) + np.cos(2 * np.pi * 17 * turn)
    >>> signal = AngularSignal(values=x, samples_per_rev=256, start_rev=0.0, passband_orders=100.0)
    >>> given = {"order": 1, "meshes": {30.0: 2.5, 17.0: 2.5}, "lowest_order": 3.0}
    >>> own, other = mesh_contrast(signal, teeth=(30, 17), **given)
    >>> bool(own > 3 * other)
    True
    """
    rate, pitches = positive(order, name="order"), [positive(one, name="teeth") for one in teeth]
    lines = tapered_transform(signal) if transform is None else transform
    power = lines.real**2 + lines.imag**2
    per_order = _padded(signal.values.size) / signal.samples_per_rev
    left_out = _of_meshes(power.size, per_order, meshes)
    spacing = rate * per_order  # lines between multiples of the shaft
    highest = int(min(signal.passband_orders * per_order, power.size - spacing) / spacing)
    number = np.arange(max(1, math.ceil(max(lowest_order / rate, min(pitches) / 2))), highest + 1)
    at = np.rint(number * spacing).astype(int)
    apart = max(1, round(spacing / 4))
    between = np.arange(apart, max(apart + 1, round(3 * spacing / 4)))
    noise = median(power[at[:, None] + between]) / math.log(2) if at.size else np.empty(0)
    above = np.maximum(power[at] - noise, 0.0)
    return np.array([_contrast(above, number / pitch, ~left_out[at]) for pitch in pitches])


def _contrast(power: Array, harmonic: Array, counted: NDArray[np.bool_]) -> float:
    """Return the mean power of lines near whole harmonics of a mesh over that of the others."""
    counted = counted & (harmonic >= 2 * _NEAR_MESH)  # as many are near the first one as are not
    near = np.abs(harmonic - np.rint(harmonic)) < _NEAR_MESH
    if not ((counted & near).any() and (counted & ~near).any()):
        return math.nan
    mean_near, mean_between = float(power[counted & near].mean()), float(power[counted & ~near].mean())
    if mean_between > 0:
        return mean_near / mean_between
    return math.inf if mean_near > 0 else 0.0
