"""Local damage of one gear: energy that returns once a turn, at one tooth, in every part of the record.

One damaged tooth makes a short, wide-band disturbance each time it meshes. The signal over angle is freed of the
harmonics of all meshes and of what stands close beside them (run-out, load, planet passes), and split into bands of
orders. The energy of each band is folded by the turns of the gear, its logarithm taken relative to its turn, so that a
level which changes with load or speed is none of it, and averaged over blocks of turns. Logarithms make a modulation
that multiplies (the path past a planet, the shape of a mesh) one that adds, which is then projected out, and bound
the share of any single impact.

Two tests must both reject. That nothing repeats with this gear's turn: the blocks are turned against one another at
random (a permutation test, exact where blocks are exchangeable under rotation; stopped early as Besag & Clifford 1991,
Biometrika 78, 301-304); of two or three turns the waveform is tested in place (`repeated_waveform`). That
the tooth differs from others no more than they do among themselves, for pitch deviations of a sound gear repeat, too.
In a band of sidebands a Gaussian deviation of each tooth has two Gaussian quadratures, so that the energies of sound
teeth are exponential above what they have in common. Their scale is estimated in two ways, from others that are as m
independent values. Where noise makes most of their scatter, their standard deviation is sharp; that of exponentials
scatters twice as much as a mean, so that the excess over their mean in this unit has a tail bounded by F(2, m). Where
teeth differ, one or two large ones decide it, and few teeth leave no evidence; their mean above the lowest is then the
sufficient statistic, and the excess over the lowest in this unit is F(2, 2 m - 2), exact whatever they have in common.
The two probabilities are combined by their geometric mean times e, which holds whatever their dependence (Vovk & Wang
2020, Biometrika 107, 791-808).

A damaged tooth is short and so wide in order: it stands at one place of the turn in many bands. The probabilities of
the bands at one place are combined by their product, and a tooth may repeat in one band and stand out in another.
Pitch deviations of sound teeth make sidebands in several bands: where the other teeth differ alike from band to band,
the bands count as fewer (Brown 1975, Biometrics 31, 987-992, with the mean correlation of the others).
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
"""Turns of a gear that a judgement needs: in fewer nothing repeats."""

PERMUTED_TURNS = 4
"""Turns from which on energies are rotated at random: rotations of fewer blocks repeat by chance too often."""

_FEWEST_CELLS, _LEAST_CELLS, _MOST_CELLS = 10, 24, 128  # of a turn: needed, aimed at, and most
_WIDTHS = (1, 2, 4, 8)  # cells
_FIRST, _ENOUGH = 99, 8  # rotations drawn before the permutation test may stop, and exceedances at which it does
_LEAST_TAIL = 1e-30  # of one band: its logarithm is finite where others do not scatter at all
_RISES = np.geomspace(1.0, 1e6, 121)  # between which is interpolated; a tooth rings by 60 dB at most


@dataclass(frozen=True, kw_only=True)
class FoldedEnergies:
    """Logarithm of band energies over the turns of a gear, each relative to its turn.

    Attributes
    ----------
    values : (band, block, cell) array
        Mean over the turns of each block; without its mean over cells, the smooth orders of the turn, and what all
        teeth have in common.
    turns : int
        Number of turns.
    teeth : float
        Teeth that pass in a turn.
    smooth_orders : int
        Orders of the turn that were projected out.
    contacts : int
        Times that a tooth meets others in a turn, equally apart.
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
    """Return band energies folded by the turns of a gear.

    Parameters
    ----------
    energies : BandEnergies
        From `residual_energies`.
    order : Fraction or float
        Turns of the gear per revolution of the reference; of a gear in mesh with several planets, meetings of one
        tooth with any of them.
    teeth : float
        Teeth that pass in such a turn.
    keep : (n,) bool array, optional
        Samples to use; default all.
    smooth_orders : int
        Orders of the turn that run-out, misalignment and passing planets modulate, which are projected out. Give 0 for
        a sun, which is folded more than once a turn: a modulation once in its turn does not repeat in a fold.
    contacts : int
        Times that a tooth meets others in such a turn, equally apart: 2 of a planet, between sun and ring. What is
        at the other contacts of a place is not compared with it.

    Returns
    -------
    FoldedEnergies

    Raises
    ------
    ValueError
        Fewer turns than `FEWEST_TURNS`, or fewer samples in a turn than its smooth orders leave room for.

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
        raise ValueError(f"{max(turns, 0)} turns are too few to judge one tooth; record {FEWEST_TURNS} or more.")
    cells = _cells(pitch, per_turn)
    begin, end = np.searchsorted(place + 1e-9, [first, last]).tolist()
    inside = slice(begin, end) if keep is None else begin + np.flatnonzero(keep[begin:end])
    place = place[inside] + 1e-9
    turn = np.floor(place).astype(int)
    cell = np.floor((place - turn) * cells).astype(int)
    index = (turn - first) * cells + np.clip(cell, 0, cells - 1)
    seen = np.bincount(index, minlength=turns * cells).reshape(turns, cells)
    # at least 8 blocks of as many turns, and at most 24; more cost time and no longer sharpen the scatter
    blocks = min(turns, int(np.clip(turns // 2, 8, 24)))
    edges = np.linspace(0, turns, blocks + 1).astype(int)[:-1]
    values = np.empty((bands, blocks, cells))
    for band in range(bands):
        sums = np.bincount(index, weights=energies.values[band][inside], minlength=turns * cells)
        values[band] = _block_means(np.asarray(sums.reshape(turns, cells)), seen, edges)
    values -= _common_part(values, pitch, smooth_orders)
    return FoldedEnergies(values=values, turns=turns, teeth=pitch, smooth_orders=smooth_orders, contacts=contacts)


def _cells(teeth: float, per_turn: float) -> int:
    """Return the number of cells of a turn: whole cells per tooth where the samples allow, so that teeth compare."""
    most = min(_MOST_CELLS, int(per_turn))
    if most < _FEWEST_CELLS:
        raise ValueError(
            f"{per_turn:.1f} samples in a turn cannot show one tooth; sample faster, or lower the number of bands."
        )
    per_tooth = max(1, min(round(_LEAST_CELLS / teeth + 0.5), 8))
    cells = round(teeth * per_tooth)
    while cells > most and per_tooth > 1:
        per_tooth -= 1
        cells = round(teeth * per_tooth)
    return min(cells, most)


def _block_means(sums: Array, seen: NDArray[np.integer], edges: NDArray[np.integer]) -> Array:
    """Return the mean log energy by block and cell, each turn relative to its own geometric mean."""
    there = seen > 0
    energy = np.where(there, sums / np.maximum(seen, 1), np.nan)
    total = sums.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    sound = total > 1e-6 * np.median(total)  # 1e-6 of the median turn's energy: a turn below is a drop-out
    logs = np.log(np.maximum(np.where(there, energy, 1.0), 1e-12 * np.median(total) + 1e-300))
    level = np.exp(np.where(there, logs, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1))
    # 0.1 of a turn's geometric mean energy: bounds the logarithm from below
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
    """Return the (cell, cell) projection on these orders, which is symmetric."""
    taken = np.zeros(cells // 2 + 1, dtype=bool)
    taken[: smooth_orders + 1] = True
    common = np.arange(1, int(taken.size / teeth) + 1) * teeth
    whole_ones = np.rint(common[np.abs(common - np.rint(common)) < 1e-9]).astype(int)  # noqa: PLR2004
    taken[whole_ones[whole_ones < taken.size]] = True
    return np.asarray(fft.irfft(np.where(taken, fft.rfft(np.eye(cells)), 0), cells))


@dataclass(frozen=True, kw_only=True)
class LocalDamage:
    """How local and how repeatable the energy over the turn of a gear is.

    Attributes
    ----------
    probability : float
        The larger of the two below.
    repeats : float
        Probability that blocks turned at random repeat as well as this place does in any band, anywhere; at least
        ``1 / (rotations + 1)``; 1 of fewer turns than `PERMUTED_TURNS`, where `repeated_waveform` tests it.
    differing : float
        The smallest `repeats` of all bands: whether anything repeats with the turn, at one tooth or several.
    local : float
        Probability that among teeth whose energies are exponential, as alike from band to band as those of the others,
        one is that far out in all bands together, of all places and widths.
    statistic : float
        Mean over blocks over its standard error at the peak, the largest of all bands within a tooth of it.
    outlier : float
        Energy of the peak less the mean of the other places, over their standard deviation.
    rise : float
        The peak's energy over that of the other places, of geometric means over turns; what bounds the logarithm makes
        it too small where it is large.
    least_rise : float
        The rise, in all bands alike, at which `local` would be as stated; inf where none would make it.
    position_rev, width_rev : float
        Middle of the peak, 0 to 1 of a turn, and its width.
    band : int
        Band in which the place stands out most.
    turns : int
        Turns used.
    """

    probability: float
    repeats: float
    differing: float
    local: float
    statistic: float
    outlier: float
    rise: float
    least_rise: float
    position_rev: float
    width_rev: float
    band: int
    turns: int


def local_damage(
    energies: FoldedEnergies, *, rotations: int, rng: np.random.Generator, stated: float = 1e-3
) -> LocalDamage:
    """Return the test of one gear for one damaged tooth.

    Parameters
    ----------
    energies : FoldedEnergies
        From `folded`.
    rotations : int
        Most random rotations of the blocks: the smallest probability is ``1 / (rotations + 1)``.
    rng : numpy.random.Generator
        Draws the rotations.
    stated : float
        Value of `local` for which `least_rise` is returned.

    Returns
    -------
    LocalDamage
        At the band with the smallest probability.

    Examples
    --------
    Three times the energy at one of 20 teeth, in 200 turns of exponential noise:

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
    unlikely = 0.5  # probability of the outlier alone above which no healthy machine's gear would be exceeded, either
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
    """Return the outcome at the highest place of each band, averaged over `width` cells, before any rotation.

    With what each place was compared with.
    """
    bands, cells = curves.shape
    peaks = np.unique(curves.argmax(axis=1))
    pitch = max(1, math.ceil(cells / energies.teeth))
    distance = np.abs((np.arange(cells) - peaks[:, None] + cells // 2) % cells - cells // 2)
    # 2.5 teeth on either side of the peak not compared: pits spread, and the mesh rings on; at most a sixth
    away = distance > max(pitch, width, min(round(2.5 * pitch), cells // 6))
    for contact in range(1, energies.contacts):
        away &= np.roll(distance, round(contact * cells / energies.contacts), axis=1) > max(pitch, width)
    fewest_others = 3  # cells besides the peak and its neighbours, of which a scatter can be estimated
    if np.count_nonzero(away[0]) < fewest_others:  # as many for each peak
        away[:] = True  # too coarse for a tooth to stand out: its statistic is that of a cell among all
    count = int(np.count_nonzero(away[0]))
    others = np.broadcast_to(away[:, None], (peaks.size, bands, cells))
    curves = np.broadcast_to(curves, others.shape)
    # 4 times that the smooth orders are estimated again: each leaves a third of the share of the peak
    for _ in range(4):  # a high peak has a share in the smooth orders, which would be missing from the others
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
    # mean correlation of two bands over the others, from the variance of their sum
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
                probability=1.0,
                repeats=1.0,
                differing=1.0,
                local=float(local[row]),
                statistic=float(statistics[distance[row] <= pitch].max()),
                outlier=float(outlier[row, band]),
                rise=float(at_peak[row, band] / mean[row, band]),
                position_rev=((peak + width / 2) / cells) % 1.0,
                width_rev=width / cells,
                band=band,
                turns=energies.turns,
                least_rise=math.inf,
            )
        )
    return found, of_others


@dataclass(frozen=True, kw_only=True)
class _Others:
    """What peaks are compared with: of the energies of the other places, each (peak, band).

    `scale` is that of an exponential above the lowest, `counted` (peak,) the number of bands that count as one.
    """

    mean: Array
    spread: Array
    lowest: Array
    scale: Array
    independent: Array
    counted: Array

    def outlier(self, energy: Array) -> Array:
        """Return by how many standard deviations an energy (peak, band) is above the mean."""
        return _over(energy - self.mean, self.spread)

    def local(self, energy: Array) -> tuple[Array, NDArray[np.integer]]:
        """Return the probability (peak,) of energies as high as (peak, band), and the band of each peak that counts."""
        bands = energy.shape[-1]
        # by the standard deviation of the others, and by their mean above the lowest: (2, peak, band)
        by_spread = _tail(1 + self.outlier(energy), self.independent / 2)
        by_mean = _tail(_over(energy - self.lowest, self.scale), self.independent - 1)
        tails = np.maximum(np.stack([by_spread, by_mean]), _LEAST_TAIL)
        together = special.gammaincc(bands / self.counted, -np.log(tails).sum(axis=-1) / self.counted)
        # a tooth may stand out in all bands, or in one: two tests, of which the better counts
        either = 2 * np.minimum(together, bands * tails.min(axis=-1))
        best = tails.prod(axis=0).argmin(axis=-1)
        independent = np.broadcast_to(self.independent, energy.shape)
        looks = (np.take_along_axis(independent, best[:, None], axis=-1)[:, 0] + 1) * len(_WIDTHS)
        return np.minimum(1.0, math.e * np.sqrt(np.minimum(1.0, either * looks).prod(axis=0))), best

    def row(self, peak: int) -> _Others:
        """Return those of one peak."""
        return _Others(**{one.name: getattr(self, one.name)[peak : peak + 1] for one in fields(self)})

    def least_rise(self, stated: float) -> float:
        """Return how many times the mean a peak must be, in all bands alike, to be as improbable as stated."""
        local, _ = self.local(_RISES[:, None] * self.mean)
        if local[-1] >= stated:
            return math.inf
        return float(np.exp(np.interp(-math.log(stated), -np.log(np.maximum(local, _LEAST_TAIL)), np.log(_RISES))))


def _over(excess: Array, scale: Array) -> Array:
    """Return an excess in units of a scale, infinite where there is no scatter."""
    excess, scale = np.broadcast_arrays(excess, scale)
    return np.asarray(np.divide(excess, scale, out=np.full(excess.shape, np.inf), where=scale > 0))


def _tail(ratio: Array | float, freedom: Array | float) -> Array:
    """Return the probability of F(2, 2 freedom) above a ratio: of an exponential variable over an estimated scale."""
    return np.asarray((1 + np.maximum(0.0, ratio) / freedom) ** -np.asarray(freedom))


def _independent(deviations: Array, count: int, *, pitch: int, width: int) -> Array:
    """Return how many independent values each (..., cell) curve over the turn holds, from its correlation in a tooth.

    A sound tooth that differs from its neighbours does so over its whole pitch, noise from cell to cell.
    """
    power = np.asarray(np.sum(deviations**2, axis=-1))
    alike = np.zeros(power.shape)
    for lag in range(1, max(pitch, width)):
        products = np.sum(deviations * np.roll(deviations, lag, axis=-1), axis=-1)
        alike += np.maximum(0.0, np.divide(products, power, out=np.zeros(power.shape), where=power > 0))
    return np.where(power > 0, np.maximum(2.0, count / (1 + 2 * alike)), float(count))


def _smoothed(values: Array, width: int) -> Array:
    """Return circular means over `width` cells from each cell on."""
    return np.asarray(sum(np.roll(values, -shift, axis=-1) for shift in range(width)) / width)


def _t_statistic(values: Array) -> Array:
    """Return the mean over blocks over its standard error, which is at least the median one: (band, cell)."""
    blocks = values.shape[-2]
    mean = values.mean(axis=-2)
    error = values.std(axis=-2, ddof=1) / math.sqrt(blocks)
    return np.asarray(mean / np.maximum(error, median(error)[..., None] + 1e-300))


def _rotated_maxima(smoothed: Sequence[Array], most: int, observed: float, rng: np.random.Generator) -> Array:
    """Return the largest statistic of each random rotation of the blocks, few where many exceed the observed one."""
    from signals.angle._local_damage_kernels import rotated_maxima  # noqa: PLC0415 - loads numba

    blocks, cells = smoothed[0].shape[-2:]
    # in single precision, in half of the time: by chance a statistic is within some units of its sixth digit
    rows = [np.concatenate([band, band], axis=-1, dtype=np.float32) for values in smoothed for band in values]
    found = np.empty(0)
    while found.size < most:
        maxima = np.zeros(min(_FIRST, most - found.size))  # a mean over cells is nothing: the largest is not negative
        shifts = rng.integers(0, cells, size=(maxima.size, blocks))
        for row in rows:
            rotated_maxima(row, shifts, maxima)
        found = np.append(found, maxima)
        exceeded = np.cumsum(found >= observed)
        enough = np.flatnonzero((exceeded >= _ENOUGH) & (np.arange(found.size) >= _FIRST - 1))
        if enough.size:
            return found[: enough[0] + 1]
    return found


# ---- Whether the waveform at one tooth repeats from turn to turn, in records of two or three turns -------------------
# Energies of so few turns repeat by chance: rotations of two turns of a hundred teeth against one another bring two
# impacts together in one of a hundred cases. A damaged tooth repeats its waveform as well, to a cycle of the highest
# order, and a turn holds thousands of such places. The signal about the tooth is correlated with the whole turns,
# turned against one another by any angle (a permutation test over rotations, exact where turns are exchangeable under
# rotation; cross-correlation is the matched filter of one turn for the other: Turin 1960, IRE Trans. Inf. Theory 6,
# 311-329). Impacts at random do not repeat as precisely, nor do those of a shaft or race whose turns do not fit in the
# gear's.


def repeated_waveform(
    signal: AngularSignal,
    *,
    order: Fraction | float,
    teeth: float,
    position_rev: float,
    keep: NDArray[np.bool_] | None = None,
) -> float:
    """Return the probability that turns rotated at random repeat the waveform at one tooth as well.

    Parameters
    ----------
    signal : AngularSignal
        Residual over the angle of the reference, its bands of equal power (`whitened_residual`).
    order : Fraction or float
        Turns of the gear per revolution of the reference.
    teeth : float
        Teeth that pass in a turn.
    position_rev : float
        Place of the tooth, in turns from the reference's angle zero.
    keep : (k,) bool array, optional
        Parts of the record to use, equally long; default all.

    Returns
    -------
    float
        At least one over the number of places in a turn that can be told apart.

    Raises
    ------
    ValueError
        Fewer whole turns than two.

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
        raise ValueError(f"{max(turns, 0)} turns cannot repeat; record two or more.")
    start = max(0, round((first - begin) * per_turn))
    values = signal.values[start : start + round(turns * per_turn)]
    if keep is not None:
        values = values * keep[(start + np.arange(values.size)) * keep.size // signal.values.size]
    place = np.arange(values.size) / per_turn
    # a tooth on either side of the place: its own contact, and the ringing after it
    at_tooth = np.abs((place - position_rev + 0.5) % 1.0 - 0.5) < 1 / pitch
    spectra = np.conj(fft.rfft(values * at_tooth)) * fft.rfft(values)
    correlation = fft.irfft(spectra, values.size)  # of whole turns, circular: each rotation has as many samples
    # samples by which a repetition may be off: a cycle of the highest order, to which shafts' angles are known
    reach = 2
    step = 2 * reach + 1
    either = int(per_turn / 2) // step  # rotations by up to half a turn, either way, that count as different
    lags = round(per_turn) + np.arange(-reach - either * step, reach + either * step + 1)
    highest = correlation[lags % values.size].reshape(-1, step).max(axis=1)
    # the rotation by whole turns is one of all
    return float(np.count_nonzero(highest >= highest[either]) / highest.size)
