"""How likely noise alone has a path of slips with as much power as the one found.

White noise gives a segment's power, over the variance R, the moments E exp(theta power) = det(1 - 2 theta C)^(-1/2)
with C the covariance of the cosines and sines it is taken from: (1 - theta)^-1 for each harmonic that makes many turns
there, more where it makes few. Over all paths Markov's inequality for exp(theta score) with the best theta bounds the
probability of a score. It is the looser the livelier the slip may be.

A measured R is too small now and then: it has the law of a mean of some exponential powers. The bound is averaged
over that.
"""

from math import log

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._slip_record import Demodulated

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_TILTS = np.arange(1, 20) / 20  # theta of the bound
# Of measured R over true. Above the last the bound is taken at the last, which loses little.
_RATIOS = np.geomspace(1e-4, 1.25, 600)


def power_spreads(ones: Demodulated, *, order: float, largest_slip: float) -> Floats:
    """Eigenvalues of C, from a record of ones demodulated at twice as many harmonics.

    Returns
    -------
    (part, slip, 2 harmonics) array, of the parts with samples, without slip and with the largest either way.
    """
    number = np.arange(1, len(ones.sums) + 1)
    spreads = []
    for part in ones.parts:
        count = ones.counts[part].sum()
        if count == 0:
            continue
        lead = ones.angle[part] - ones.angle[part].mean()
        for slip in (-largest_slip, 0.0, largest_slip):
            turned = np.exp(-1j * order * slip * np.outer(number, lead))
            spreads.append(
                np.linalg.eigvalsh(_covariance(np.append(1.0, np.sum(turned * ones.sums[:, part], axis=1) / count)))
            )
    return np.array(spreads).reshape(-1, 3, number.size)


def _covariance(means: Complexes) -> Floats:
    """Mean products of cos(k theta), k = 1 to h, and sin(k theta); from the means of exp(-j m theta), m = 0 to 2 h."""
    k = np.arange(1, means.size // 2 + 1)
    total = means[k[:, None] + k]
    apart = k[:, None] - k
    differ = np.where(apart >= 0, means[np.abs(apart)], np.conj(means[np.abs(apart)]))
    cosines, sines = (differ + total).real / 2, (differ - total).real / 2
    mixed = (differ - total).imag / 2
    return np.asarray(np.block([[cosines, mixed], [mixed.T, sines]]))


def chance(score: float, grid: Floats, change: Floats, *, spreads: Floats, counted: int | None) -> float:
    """Bound the probability that a path through powers of noise reaches this score.

    Parameters
    ----------
    score : power, less half the squared changes of the slip over their variances, of the best path.
    grid : slips searched.
    change : (segment - 1,) array, variances of the slip's changes.
    spreads : as `power_spreads` returns them.
    counted : how many powers of noise R is the mean of; none where it is known.
    """
    logs = _log_moments(spreads)
    if counted is None:
        return float(np.exp(min(0.0, np.min(logs - _TILTS * score + _log_paths(grid, change, _TILTS)))))
    from scipy.special import gammainc  # noqa: PLC0415

    below = gammainc(counted, counted * np.append(_RATIOS[:-1], np.inf))
    tilts = _RATIOS[:, None] * _TILTS
    nodes = np.append(0.0, np.arange(1, 26) / 20)
    # Logarithms of sums of exponentials are convex: chords lie above.
    paths = np.interp(tilts, nodes, _log_paths(grid, change, nodes))
    bounds = np.exp(np.minimum(0.0, np.min(logs - tilts * score + paths, axis=1)))
    return float(min(1.0, below[0] + bounds[:-1] @ np.diff(below)))


def _log_moments(spreads: Floats) -> Floats:
    """Logarithm of E exp(theta power), all segments together, for each theta; infinite beyond the largest."""
    values = np.empty(_TILTS.size)
    for number, tilt in enumerate(_TILTS):
        left = 1 - 2 * tilt * spreads
        seen = left > 0
        each = np.where(seen, np.log(np.where(seen, left, 1.0)), -np.inf).sum(axis=2)
        values[number] = -0.5 * each.min(axis=1).sum()
    return values


def _log_paths(grid: Floats, change: Floats, tilts: Floats) -> Floats:
    """Logarithm of the sum of exp(-theta cost) over all paths, for each theta."""
    apart = (grid[:, None] - grid) ** 2 / 2
    values = np.empty(tilts.size)
    for number, tilt in enumerate(tilts):
        paths, total = np.ones(grid.size), 0.0
        for variance in change:
            paths = np.exp(-tilt * apart / variance) @ paths
            total += log(paths.max())
            paths /= paths.max()
        values[number] = total + log(paths.sum())
    return values
