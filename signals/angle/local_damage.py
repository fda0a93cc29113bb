"""Local damage of one gear: energy that recurs once per revolution, at one tooth, throughout the record.

A damaged tooth causes a short, wide-band disturbance each time it meshes. The harmonics of all meshes and the lines
close to them (run-out, load, planet passes) are removed from the signal over angle, which is then split into bands of
orders. The energy of each band is folded by the revolutions of the gear. Relative to that revolution it does not depend
on slow changes with load or speed; the logarithm of one plus it, which limits the influence of any single impact and of
silence, is averaged over blocks of revolutions, and what all teeth share (the path past a planet, the shape of a mesh)
is projected out.

Energy at one place is no damage if it comes by chance, or if the teeth differ anyway, since the pitch deviations of a
healthy gear repeat as well. In each band the logarithm at the place, less the mean over the other places, is therefore
divided by the larger of two kinds of scatter: the standard deviation over the other places, and the standard error of
the place over blocks. The disturbance is short and therefore wide in order, so that it appears at one angle in many
bands: the strength of the evidence is the root sum of squares of these ratios over bands. Deviations of a healthy gear
are alike in neighbouring bands, so that no theory tells how strong they are: that is learned from healthy records.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft, special

from signals._validation import Array, positive

if TYPE_CHECKING:
    from fractions import Fraction

    from numpy.typing import NDArray

    from signals.angle.residual_energies import BandEnergies

FEWEST_TURNS = 4
"""Fewest gear revolutions from whose scatter a standard error can be estimated."""

_WIDTHS = (1, 2)  # cells
_NINE_IN_10 = 1.28  # standard deviations by which a normal variable is below its mean in one of ten cases
_LEAST_SPREAD = 0.01  # of the logarithm: no two teeth are more alike


@dataclass(frozen=True, kw_only=True)
class FoldedEnergies:
    """Logarithm of one plus the energy of bands, folded over the revolutions of a gear and relative to each.

    Attributes
    ----------
    values : (band, block, cell) array
        Mean over the revolutions of each block, without its mean over cells, the smooth orders, and the part common to
        all teeth.
    turns : int
        Number of gear revolutions.
    teeth : float
        Teeth that pass per revolution.
    smooth_orders : int
        Number of orders of the gear that were projected out.
    contacts : int
        Number of evenly spaced contacts of a tooth per revolution.
    """

    values: Array = field(metadata={"dims": ("band", "block", "cell")})
    turns: int
    teeth: float
    smooth_orders: int
    contacts: int = 1


def folded(
    energies: BandEnergies,
    *,
    order: Fraction | float,
    teeth: float,
    keep: NDArray[np.bool_] | None = None,
    smooth_orders: int = 2,
    contacts: int = 1,
) -> FoldedEnergies:
    """Return band energies folded by the revolutions of a gear.

    Parameters
    ----------
    energies : BandEnergies
        From `residual_energies`.
    order : Fraction or float
        Revolutions of the gear per revolution of the reference; for a gear in mesh with several planets, contacts of
        one tooth with any of them.
    teeth : float
        Teeth that pass per such revolution.
    keep : (n,) bool array, optional
        Samples to use; default: all.
    smooth_orders : int
        Number of orders modulated by run-out, misalignment and passing planets, which are projected out. Use 0 for a
        sun, which is folded more than once per revolution, so that its own modulation does not repeat in a fold.
    contacts : int
        Number of evenly spaced contacts of a tooth per such revolution: 2 for a planet, between sun and ring. A place
        is not compared with its other contacts.

    Returns
    -------
    FoldedEnergies

    Raises
    ------
    ValueError
        Fewer revolutions than `FEWEST_TURNS`, or too few samples per revolution to resolve a tooth.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.angle.local_damage import folded
    >>> from signals.angle.residual_energies import BandEnergies
    >>> x = np.random.default_rng(0).exponential(size=(1, 64 * 40))
    >>> energies = BandEnergies(values=x, samples_per_rev=64.0, start_rev=0.0, edges=np.array([1.0, 33.0]))
    >>> folded(energies, order=1, teeth=20).turns
    40
    """
    rate, pitch = positive(order, name="order"), positive(teeth, name="teeth")
    per_turn = energies.samples_per_rev / rate
    bands = energies.values.shape[0]
    place = rate * energies.revolutions
    first, last = math.ceil(place[0] - 1e-9), math.floor(place[-1] + rate / energies.samples_per_rev + 1e-9)
    turns = last - first
    if turns < FEWEST_TURNS:
        raise ValueError(
            f"{max(turns, 0)} gear revolutions are too few to judge one tooth; record {FEWEST_TURNS} or more."
        )
    cells = _cells(pitch, per_turn)
    begin, end = np.searchsorted(place + 1e-9, [first, last]).tolist()
    inside = slice(begin, end) if keep is None else begin + np.flatnonzero(keep[begin:end])
    place = place[inside] + 1e-9
    turn = np.floor(place).astype(int)
    cell = np.floor((place - turn) * cells).astype(int)
    index = (turn - first) * cells + np.clip(cell, 0, cells - 1)
    seen = np.bincount(index, minlength=turns * cells).reshape(turns, cells)
    # 8 to 24 blocks; more cost time without a sharper estimate of the scatter
    blocks = min(turns, int(np.clip(turns // 2, 8, 24)))
    edges = np.linspace(0, turns, blocks + 1).astype(int)[:-1]
    values = np.empty((bands, blocks, cells))
    for band in range(bands):
        sums = np.bincount(index, weights=energies.values[band][inside], minlength=turns * cells)
        values[band] = _block_means(np.asarray(sums.reshape(turns, cells)), seen, edges)
    values -= _common_part(values, pitch, smooth_orders)
    return FoldedEnergies(values=values, turns=turns, teeth=pitch, smooth_orders=smooth_orders, contacts=contacts)


def _cells(teeth: float, per_turn: float) -> int:
    """Return the number of cells per revolution: whole cells per tooth if the samples allow, so that teeth compare."""
    fewest, most = 10, min(128, int(per_turn))
    if most < fewest:
        raise ValueError(
            f"{per_turn:.1f} samples per gear revolution cannot resolve a tooth; sample faster, or reduce the number "
            "of bands."
        )
    per_tooth = max(1, min(round(24 / teeth + 0.5), 8))  # 24 cells per revolution or more, where the samples allow
    cells = round(teeth * per_tooth)
    while cells > most and per_tooth > 1:
        per_tooth -= 1
        cells = round(teeth * per_tooth)
    return min(cells, most)


def _block_means(sums: Array, seen: NDArray[np.integer], edges: NDArray[np.integer]) -> Array:
    """Return the mean of ``log(1 + energy)`` by block and cell, each revolution relative to its mean energy."""
    total = sums.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    there = (seen > 0) & (total > 1e-6 * np.median(total))[:, None]  # drop-outs have less energy
    relative = np.divide(sums, seen * total[:, None], out=np.zeros_like(sums), where=there)
    count = np.add.reduceat(there.astype(float), edges, axis=0)
    means = np.add.reduceat(np.log1p(relative), edges, axis=0) / np.maximum(count, 1)
    overall = means.sum(axis=0) / np.maximum((count > 0).sum(axis=0), 1)
    return np.where(count > 0, means, overall)


def _common_part(values: Array, teeth: float, smooth_orders: int) -> Array:
    """Return the mean, the smooth orders, and the orders that all teeth share."""
    return np.asarray(values @ _common_projection(values.shape[-1], teeth, smooth_orders))


@lru_cache(maxsize=32)
def _common_projection(cells: int, teeth: float, smooth_orders: int) -> Array:
    """Return the symmetric (cell, cell) projection onto these orders."""
    taken = np.zeros(cells // 2 + 1, dtype=bool)
    taken[: smooth_orders + 1] = True
    common = np.arange(1, int(taken.size / teeth) + 1) * teeth
    whole_ones = np.rint(common[np.abs(common - np.rint(common)) < 1e-9]).astype(int)  # noqa: PLR2004
    taken[whole_ones[whole_ones < taken.size]] = True
    return np.asarray(fft.irfft(np.where(taken, fft.rfft(np.eye(cells)), 0), cells))


@dataclass(frozen=True, kw_only=True)
class LocalDamage:
    """How far the energy at one tooth of a gear exceeds that at the others.

    Attributes
    ----------
    strength : float
        Root sum of squares, over bands, of the excess of the logarithm of the energy in units of its scatter.
    rise : float
        Ratio of the energy at the tooth to that at the other places, at least, in the band in which it stands out most:
        the mean logarithm of energies that scatter is below that of their mean.
    least_rise : float
        Ratio in one band alone, in whichever shows it least, at which nine in ten records would reach the strength that
        is stated.
    position_rev : float
        Middle of the peak, from 0 to 1 revolution of the gear.
    band : int
        Index of the band in which the peak stands out most.
    turns : int
        Number of gear revolutions used.
    """

    strength: float
    rise: float
    least_rise: float
    position_rev: float
    band: int
    turns: int


def local_damage(energies: FoldedEnergies, *, stated: float = 10.0) -> LocalDamage:
    """Return how far the most conspicuous tooth of a gear stands out.

    Parameters
    ----------
    energies : FoldedEnergies
        From `folded`.
    stated : float
        Strength for which `least_rise` is computed.

    Returns
    -------
    LocalDamage
        For the place and width of the largest strength, among the highest places of each band.

    Examples
    --------
    Three times the energy at one of 20 teeth, in 200 revolutions of exponential noise:

    >>> import numpy as np
    >>> from signals.angle.local_damage import folded, local_damage
    >>> from signals.angle.residual_energies import BandEnergies
    >>> rng = np.random.default_rng(0)
    >>> x = rng.exponential(size=(200, 80))
    >>> x[:, 40:44] *= 3
    >>> energies = BandEnergies(values=x.reshape(1, -1), samples_per_rev=80.0, start_rev=0.0, edges=np.array([1.0, 41]))
    >>> found = local_damage(folded(energies, order=1, teeth=20))
    >>> found.strength > 5, abs(found.position_rev - 42 / 80) < 0.02
    (True, True)
    """
    found = []
    for width in _WIDTHS:
        highest = _smoothed(energies.values, width).mean(axis=1).argmax(axis=1)
        found += [_at_peak(energies, width, int(peak), stated) for peak in np.unique(highest)]
    return max(found, key=lambda one: one.strength)


def _at_peak(energies: FoldedEnergies, width: int, peak: int, stated: float) -> LocalDamage:
    """Return how far a place of some cells, of which `peak` is the first, stands out from the others."""
    blocks, cells = energies.values.shape[1:]
    smoothed = _smoothed(energies.values, width)
    curves, errors = smoothed.mean(axis=1), smoothed.std(axis=1, ddof=1) / math.sqrt(blocks)
    others = _other_places(energies, width, peak)
    # a high peak leaks into the smooth orders, which would lower the others; each iteration leaves a third of the
    # leakage
    for _ in range(4):
        highest = curves[:, others].max(axis=1, keepdims=True)
        clipped = np.where(others, curves, np.minimum(curves, highest))
        curves = curves - _common_part(clipped, energies.teeth, energies.smooth_orders)
    excess = curves[:, peak] - curves[:, others].mean(axis=1)
    spread = np.maximum(curves[:, others].std(axis=1, ddof=1), _LEAST_SPREAD)
    ratios = np.maximum(excess, 0.0) / np.maximum(spread, errors[:, peak])
    band = int(ratios.argmax())
    return LocalDamage(
        strength=float(np.linalg.norm(ratios)),
        rise=float(2 * np.exp(excess[band]) - 1),
        least_rise=_least_rise((stated + _NINE_IN_10) * float(np.maximum(spread, errors.max(axis=1)).max())),
        position_rev=((peak + width / 2) / cells) % 1.0,
        band=band,
        turns=energies.turns,
    )


def _least_rise(excess: float) -> float:
    """Return the ratio of energies at which the mean of ``log(1 + r e)`` exceeds that at 1, for e of noise.

    With an exponential e it is ``exp(1 / r) E1(1 / r)``; averages over a cell scatter less and exceed it.
    """
    rises = np.geomspace(1.0, 1e6, 200)
    means = np.exp(1 / rises) * special.exp1(1 / rises)
    return float(np.exp(np.interp(excess, means - means[0], np.log(rises), right=math.inf)))


def _other_places(energies: FoldedEnergies, width: int, peak: int) -> NDArray[np.bool_]:
    """Return the cells with which a peak is compared: none near it, or near its other contacts."""
    cells = energies.values.shape[-1]
    pitch = max(1, math.ceil(cells / energies.teeth))
    distance = np.abs((np.arange(cells) - peak + cells // 2) % cells - cells // 2)
    # 2.5 teeth on either side of the peak are not compared, since pits spread and the mesh rings; at most a sixth
    away = distance > max(pitch, width, min(round(2.5 * pitch), cells // 6))
    for contact in range(1, energies.contacts):
        away &= np.roll(distance, round(contact * cells / energies.contacts)) > max(pitch, width)
    return away if np.count_nonzero(away) > 2 else np.ones(cells, dtype=bool)  # noqa: PLR2004  (a scatter needs three)


def _smoothed(values: Array, width: int) -> Array:
    """Return circular means over `width` cells, starting at each cell."""
    return np.asarray(sum(np.roll(values, -shift, axis=-1) for shift in range(width)) / width)
