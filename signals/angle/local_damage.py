"""Local damage of one gear: energy that recurs once per revolution, at one tooth, throughout the record.

A damaged tooth causes a short, wide-band disturbance each time it meshes. The harmonics of all meshes and the lines
close to them (run-out, load, planet passes) are removed from the signal over angle, which is then split into bands of
orders. The energy of each band is folded by the revolutions of the gear. Its logarithm relative to that revolution,
which does not depend on slow changes with load or speed, is averaged over blocks of revolutions. Logarithms turn
multiplicative modulation (the path past a planet, the shape of a mesh) into additive modulation, which is then
projected out, and limit the influence of any single impact.

Two null hypotheses must both be rejected. The first: nothing repeats with the revolution of this gear. The blocks are
rotated against each other at random (a permutation test, exact if blocks are exchangeable under rotation, with the
sequential stopping of Besag & Clifford 1991, Biometrika 78, 301-304); with only two or three revolutions the waveform
is tested instead (`repeated_waveform`). The second: the tooth differs from the others no more than they do from each
other, since the pitch deviations of a healthy gear repeat as well. In a band of sidebands a Gaussian deviation of each
tooth has two Gaussian quadratures, so that the energies of healthy teeth are exponential above their common part. Their
scale is estimated in two ways, from other teeth equivalent to m independent values. If their scatter is mostly noise,
their standard deviation is sharp; that of exponentials scatters twice as much as a mean, so that the excess over their
mean in this unit has a tail bounded by F(2, m). If the teeth differ, one or two large ones dominate the standard
deviation, and with few teeth no evidence remains; their mean above the lowest is then the sufficient statistic, and the
excess over the lowest in this unit is F(2, 2 m - 2), exactly, whatever their common part. The two probabilities are
combined by their geometric mean times e, which is valid under any dependence (Vovk & Wang 2020, Biometrika 107,
791-808).

The disturbance of a damaged tooth is short and therefore wide in order: it appears at one angle in many bands. The
probabilities of the bands at one angle are multiplied, and a tooth may repeat in one band and stand out in another.
Pitch deviations of healthy teeth cause sidebands in several bands: where the other teeth differ in the same way in each
band, the bands count as fewer (Brown 1975, Biometrics 31, 987-992, with the mean correlation of the others).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft, special

from signals._transforms import median
from signals._validation import Array, positive, whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from numpy.typing import NDArray

    from signals.angle.residual_energies import BandEnergies
    from signals.resampling.resampling import AngularSignal

FEWEST_TURNS = 2
"""Fewest gear revolutions in which anything can repeat."""

PERMUTED_TURNS = 4
"""Fewest gear revolutions for the permutation test: rotations of fewer blocks repeat too often by chance."""

_WIDTHS = (1, 2, 4, 8)  # cells
_FIRST = 99  # rotations drawn before the permutation test may stop
_LEAST_TAIL = 1e-30  # of one band, so that its logarithm is finite where the others do not scatter at all
_RISES = np.geomspace(1.0, 1e6, 121)  # interpolation grid, up to 60 dB


@dataclass(frozen=True, kw_only=True)
class FoldedEnergies:
    """Logarithm of band energies folded over the revolutions of a gear, each relative to its revolution.

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
    """Return the mean log energy by block and cell, each revolution relative to its geometric mean."""
    there = seen > 0
    energy = np.where(there, sums / np.maximum(seen, 1), np.nan)
    total = sums.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    sound = total > 1e-6 * np.median(total)  # a revolution with less energy is a drop-out
    logs = np.log(np.maximum(np.where(there, energy, 1.0), 1e-12 * np.median(total) + 1e-300))
    level = np.exp(np.where(there, logs, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1))
    # 0.1 of the geometric mean energy of the revolution bounds the logarithm from below
    relative = np.where(there & sound[:, None], np.log(np.where(there, energy, 1.0) / level[:, None] + 0.1), 0.0)
    count = np.add.reduceat((there & sound[:, None]).astype(float), edges, axis=0)
    means = np.add.reduceat(relative, edges, axis=0) / np.maximum(count, 1)
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
    """How local and how repeatable the energy over the revolution of a gear is.

    Attributes
    ----------
    probability : float
        The larger of `repeats` and `local`.
    repeats : float
        Probability that randomly rotated blocks repeat as well as the peak, in any band at any angle; at least
        ``1 / (rotations + 1)``. It is 1 for fewer revolutions than `PERMUTED_TURNS`, where `repeated_waveform` applies.
    differing : float
        Smallest `repeats` of all bands: whether anything repeats with the revolution, at one tooth or several.
    local : float
        Probability that among teeth with exponential energies, with the band-to-band correlation of the other teeth,
        one is as extreme in all bands together, over all angles and widths.
    statistic : float
        Largest ratio of the mean over blocks to its standard error within a tooth of the peak, over all bands.
    outlier : float
        Energy of the peak above the mean of the other places, in their standard deviations.
    rise : float
        Ratio of the energy of the peak to that of the other places, as geometric means over revolutions; a large rise
        is underestimated, since the logarithm is bounded.
    least_rise : float
        Rise in one band alone, in whichever shows it least, at which `local` would reach the stated probability; inf if
        none would.
    position_rev, width_rev : float
        Middle of the peak, from 0 to 1 revolution of the gear, and its width.
    band : int
        Index of the band in which the peak stands out most.
    turns : int
        Number of gear revolutions used.
    """

    probability: float = 1.0
    repeats: float = 1.0
    differing: float = 1.0
    local: float
    statistic: float
    outlier: float
    rise: float
    least_rise: float = math.inf
    position_rev: float
    width_rev: float
    band: int
    turns: int


def local_damage(
    energies: FoldedEnergies, *, rotations: int, rng: np.random.Generator, stated: float = 1e-3
) -> LocalDamage:
    """Test one gear for one damaged tooth.

    Parameters
    ----------
    energies : FoldedEnergies
        From `folded`.
    rotations : int
        Largest number of random rotations of the blocks, at least 99; the smallest probability is
        ``1 / (rotations + 1)``.
    rng : numpy.random.Generator
        Source of the rotations.
    stated : float
        Value of `local` for which `least_rise` is computed.

    Returns
    -------
    LocalDamage
        For the place and width of smallest probability.

    Raises
    ------
    ValueError
        Fewer than 99 rotations.

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
    >>> found = local_damage(folded(energies, order=1, teeth=20), rotations=999, rng=rng)
    >>> found.probability, abs(found.position_rev - 42 / 80) < 0.02
    (0.001, True)
    """
    most = whole(rotations, name="rotations", least=_FIRST)
    smoothed = [_smoothed(energies.values, width) for width in _WIDTHS]
    observed = np.stack([_t_statistic(values) for values in smoothed]).max(axis=(0, 1))  # by cell
    places, compared = [], []
    for values, width in zip(smoothed, _WIDTHS, strict=True):
        there, others = _at_peaks(values.mean(axis=-2), observed, width, energies)
        places += there
        compared += [others.row(peak) for peak in range(len(there))]
    if energies.turns < PERMUTED_TURNS:
        best = min(range(len(places)), key=lambda at: (places[at].local, -places[at].statistic))
        return replace(places[best], least_rise=compared[best].least_rise(stated))
    unlikely = 0.5  # a peak with a larger probability stands out on no gear, so that few rotations suffice
    worthwhile = min(place.local for place in places) < unlikely
    null = _rotated_maxima(smoothed, most if worthwhile else _FIRST, float(observed.max()), rng)

    def repeats(statistic: float) -> float:
        return float((1 + np.count_nonzero(null >= statistic)) / (1 + null.size))

    differing = repeats(float(observed.max()))
    chances = [repeats(place.statistic) for place in places]

    def evidence(at: int) -> tuple[float, float, float]:
        return max(chances[at], places[at].local), places[at].local, -places[at].statistic

    best = min(range(len(places)), key=evidence)
    return replace(
        places[best],
        repeats=chances[best],
        differing=differing,
        probability=evidence(best)[0],
        least_rise=compared[best].least_rise(stated),
    )


def _at_peaks(
    curves: Array, statistics: Array, width: int, energies: FoldedEnergies
) -> tuple[list[LocalDamage], _Others]:
    """Return the result at the highest peak of each band, averaged over `width` cells, before any rotation.

    The second result holds the other places with which each peak was compared.
    """
    bands, cells = curves.shape
    peaks = np.unique(curves.argmax(axis=1))
    pitch = max(1, math.ceil(cells / energies.teeth))
    distance = np.abs((np.arange(cells) - peaks[:, None] + cells // 2) % cells - cells // 2)
    # 2.5 teeth on either side of the peak are not compared, since pits spread and the mesh rings; at most a sixth
    away = distance > max(pitch, width, min(round(2.5 * pitch), cells // 6))
    for contact in range(1, energies.contacts):
        away &= np.roll(distance, round(contact * cells / energies.contacts), axis=1) > max(pitch, width)
    fewest_others = 3  # cells from which a scatter can be estimated
    if np.count_nonzero(away[0]) < fewest_others:  # the same number for each peak
        away[:] = True  # too coarse to resolve a tooth: compare with all cells
    count = int(np.count_nonzero(away[0]))
    others = np.broadcast_to(away[:, None], (peaks.size, bands, cells))
    curves = np.broadcast_to(curves, others.shape)
    # a high peak leaks into the smooth orders, which would lower the others; each iteration leaves a third of the
    # leakage
    for _ in range(4):
        highest = np.where(others, curves, -np.inf).max(axis=-1, keepdims=True)
        clipped = np.where(others, curves, np.minimum(curves, highest))
        curves = curves - _common_part(clipped, energies.teeth, energies.smooth_orders)
    energy = np.exp(curves)
    compared = energy[others].reshape(peaks.size, bands, count)
    mean, spread, lowest = compared.mean(axis=-1), compared.std(axis=-1, ddof=1), compared.min(axis=-1)
    independent = _independent(np.where(others, energy - mean[..., None], 0.0), count, pitch=pitch, width=width)
    alike = np.divide(
        compared - mean[..., None], spread[..., None], out=np.zeros_like(compared), where=spread[..., None] > 0
    )
    # mean correlation between bands over the other places, from the variance of their sum
    shared = (np.sum(alike.sum(axis=1) ** 2, axis=-1) / (count - 1) / bands - 1) / max(1, bands - 1)
    at_peak = energy[np.arange(peaks.size), :, peaks]
    of_others = _Others(
        mean=mean,
        spread=spread,
        lowest=lowest,
        scale=(mean - lowest) * independent / (independent - 1),
        independent=independent,
        counted=1 + (bands - 1) * np.clip(shared, 0.0, 1.0),
    )
    local, best = of_others.local(at_peak)
    outlier = of_others.outlier(at_peak)
    found = []
    for row, peak in enumerate(peaks.tolist()):
        band = int(best[row])
        found.append(
            LocalDamage(
                local=float(local[row]),
                statistic=float(statistics[distance[row] <= pitch].max()),
                outlier=float(outlier[row, band]),
                rise=float(at_peak[row, band] / mean[row, band]),
                position_rev=((peak + width / 2) / cells) % 1.0,
                width_rev=width / cells,
                band=band,
                turns=energies.turns,
            )
        )
    return found, of_others


@dataclass(frozen=True, kw_only=True)
class _Others:
    """Statistics of the energies of the other places with which peaks are compared, (peak, band) each.

    `scale` is that of an exponential above the lowest, `counted` (peak,) the number of bands that count as one.
    """

    mean: Array
    spread: Array
    lowest: Array
    scale: Array
    independent: Array
    counted: Array

    def outlier(self, energy: Array) -> Array:
        """Return the excess of an energy (peak, band) over the mean in standard deviations."""
        return _over(energy - self.mean, self.spread)

    def local(self, energy: Array) -> tuple[Array, NDArray[np.integer]]:
        """Return the probability (peak,) of energies as high as (peak, band), and the band of each peak that counts."""
        bands = energy.shape[-1]
        # by the standard deviation of the others, and by their mean above the lowest: (2, peak, band)
        by_spread = _tail(1 + self.outlier(energy), self.independent / 2)
        by_mean = _tail(_over(energy - self.lowest, self.scale), self.independent - 1)
        tails = np.maximum(np.stack([by_spread, by_mean]), _LEAST_TAIL)
        together = special.gammaincc(bands / self.counted, -np.log(tails).sum(axis=-1) / self.counted)
        # a tooth may stand out in all bands or in one: the better of two tests counts
        either = 2 * np.minimum(together, bands * tails.min(axis=-1))
        best = tails.prod(axis=0).argmin(axis=-1)
        independent = np.broadcast_to(self.independent, energy.shape)
        looks = (np.take_along_axis(independent, best[:, None], axis=-1)[:, 0] + 1) * len(_WIDTHS)
        return np.minimum(1.0, math.e * np.sqrt(np.minimum(1.0, either * looks).prod(axis=0))), best

    def row(self, peak: int) -> _Others:
        """Return the statistics of one peak."""
        return _Others(**{one.name: getattr(self, one.name)[peak : peak + 1] for one in fields(self)})

    def least_rise(self, stated: float) -> float:
        """Return the ratio to the mean, in whichever one band alone, at which a peak is as improbable as stated."""
        alone = self.mean * (1 + (_RISES[:, None, None] - 1) * np.eye(self.mean.size))  # (rise, raised band, band)
        local = self.local(alone.reshape(-1, self.mean.size))[0].reshape(_RISES.size, -1).max(axis=1)
        rarity = -np.log(np.maximum(local, _LEAST_TAIL))
        return float(np.exp(np.interp(-math.log(max(stated, _LEAST_TAIL)), rarity, np.log(_RISES), right=math.inf)))


def _over(excess: Array, scale: Array) -> Array:
    """Return an excess in units of a scale, infinite if there is no scatter but an excess."""
    excess, scale = np.broadcast_arrays(excess, scale)
    return np.asarray(np.divide(excess, scale, out=np.where(excess > 0, np.inf, 0.0), where=scale > 0))


def _tail(ratio: Array | float, freedom: Array | float) -> Array:
    """Return the probability that F(2, 2 freedom), an exponential over its estimated scale, exceeds a ratio."""
    return np.asarray((1 + np.maximum(0.0, ratio) / freedom) ** -np.asarray(freedom))


def _independent(deviations: Array, count: int, *, pitch: int, width: int) -> Array:
    """Return the number of independent values in each (..., cell) curve, from its correlation within a tooth.

    A healthy tooth differs from its neighbours over its whole pitch, noise from cell to cell.
    """
    power = np.asarray(np.sum(deviations**2, axis=-1))
    alike = np.zeros(power.shape)
    for lag in range(1, max(pitch, width)):
        products = np.sum(deviations * np.roll(deviations, lag, axis=-1), axis=-1)
        alike += np.maximum(0.0, np.divide(products, power, out=np.zeros(power.shape), where=power > 0))
    return np.where(power > 0, np.maximum(2.0, count / (1 + 2 * alike)), float(count))


def _smoothed(values: Array, width: int) -> Array:
    """Return circular means over `width` cells, starting at each cell."""
    return np.asarray(sum(np.roll(values, -shift, axis=-1) for shift in range(width)) / width)


def _t_statistic(values: Array) -> Array:
    """Return the ratio of the mean over blocks to its standard error, at least the median one, (band, cell)."""
    blocks = values.shape[-2]
    mean = values.mean(axis=-2)
    error = values.std(axis=-2, ddof=1) / math.sqrt(blocks)
    return np.asarray(mean / np.maximum(error, median(error)[..., None] + 1e-300))


def _rotated_maxima(smoothed: Sequence[Array], most: int, observed: float, rng: np.random.Generator) -> Array:
    """Return the largest statistic of each random rotation of the blocks, few where many exceed the observed one."""
    from signals.angle._local_damage_kernels import rotated_maxima  # noqa: PLC0415 - loads numba

    blocks, cells = smoothed[0].shape[-2:]
    # in single precision, in half the time: statistics rarely tie to six digits
    rows = [np.concatenate([band, band], axis=-1, dtype=np.float32) for values in smoothed for band in values]
    found = np.empty(0)
    while found.size < most:
        maxima = np.zeros(min(_FIRST, most - found.size))  # the mean over cells is zero, so the largest is not negative
        shifts = rng.integers(0, cells, size=(maxima.size, blocks))
        for row in rows:
            rotated_maxima(row, shifts, maxima)
        found = np.append(found, maxima)
        exceeded = np.cumsum(found >= observed)
        at_which_it_stops = 8
        enough = np.flatnonzero((exceeded >= at_which_it_stops) & (np.arange(found.size) >= _FIRST - 1))
        if enough.size:
            return found[: enough[0] + 1]
    return found


# ---- Whether the waveform at one tooth repeats from turn to turn, in records of two or three turns -------------------
# Energies of so few revolutions repeat by chance: two impacts coincide in one of a hundred rotations of two revolutions
# of a hundred teeth. A damaged tooth also repeats its waveform, to within a cycle of the highest order, of which a
# revolution has thousands. The signal around the tooth is correlated with the whole revolutions at every rotation (a
# permutation test, exact if revolutions are exchangeable under rotation; the cross-correlation is the matched filter of
# one revolution for the other: Turin 1960, IRE Trans. Inf. Theory 6, 311-329). Random impacts do not repeat as
# precisely, nor do those of a shaft or race whose revolutions are not commensurate with the gear's.


def repeated_waveform(
    signal: AngularSignal,
    *,
    order: Fraction | float,
    teeth: float,
    position_rev: float,
    keep: NDArray[np.bool_] | None = None,
) -> float:
    """Return the probability that randomly rotated revolutions repeat the waveform at one tooth as well.

    Parameters
    ----------
    signal : AngularSignal
        Residual over the angle of the reference, with bands of equal power (`whitened_residual`).
    order : Fraction or float
        Revolutions of the gear per revolution of the reference.
    teeth : float
        Teeth that pass per revolution of the gear.
    position_rev : float
        Place of the tooth, in revolutions of the gear from angle zero of the reference.
    keep : (k,) bool array, optional
        Parts of the record to use, equally long; default: all.

    Returns
    -------
    float
        At least the reciprocal of the number of distinguishable places per revolution.

    Raises
    ------
    ValueError
        Fewer than two whole revolutions of the gear.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.local_damage import repeated_waveform
    >>> rng = np.random.default_rng(0)
    >>> x = rng.normal(size=2 * 8192)
    >>> at_tooth = 8 * rng.normal(size=50)
    >>> x[3000:3050] += at_tooth
    >>> x[8192 + 3000 : 8192 + 3050] += at_tooth
    >>> signal = AngularSignal(values=x, samples_per_rev=8192, start_rev=0.0, passband_orders=4000.0)
    >>> repeated_waveform(signal, order=1, teeth=80, position_rev=3025 / 8192) < 0.001
    True
    """
    rate, pitch = positive(order, name="order"), positive(teeth, name="teeth")
    begin, per_turn = rate * signal.start_rev, signal.samples_per_rev / rate
    first = math.ceil(begin - 1e-9)
    turns = math.floor(begin + signal.values.size / per_turn + 1e-9) - first
    if turns < 2:  # noqa: PLR2004
        raise ValueError(f"{max(turns, 0)} gear revolutions cannot repeat; record two or more.")
    start = max(0, round((first - begin) * per_turn))
    values = signal.values[start : start + round(turns * per_turn)]
    if keep is not None:
        values = values * keep[(start + np.arange(values.size)) * keep.size // signal.values.size]
    place = np.arange(values.size) / per_turn
    # one tooth on either side covers the contact itself and the ringing after it
    at_tooth = np.abs((place - position_rev + 0.5) % 1.0 - 0.5) < 1 / pitch
    spectra = np.conj(fft.rfft(values * at_tooth)) * fft.rfft(values)
    correlation = fft.irfft(spectra, values.size)  # circular over whole revolutions, so that each rotation is complete
    # samples by which a repetition may be off: a cycle of the highest order, the accuracy of shaft angles
    reach = 2
    step = 2 * reach + 1
    either = int(per_turn / 2) // step  # distinguishable rotations by up to half a revolution either way
    lags = round(per_turn) + np.arange(-reach - either * step, reach + either * step + 1)
    highest = correlation[lags % values.size].reshape(-1, step).max(axis=1)
    # the actual rotation is one of them
    return float(np.count_nonzero(highest >= highest[either]) / highest.size)
