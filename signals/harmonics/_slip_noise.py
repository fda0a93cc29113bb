"""The noise beside a slipping line, by the power of cells of order near it that no harmonic reaches.

Where there is nothing but noise these powers are independent and exponentially distributed. Other lines may stand in
some: so only the lower half of them counts, the others for no more than the highest of that half. The mean of such a
sum has the Gamma distribution of as many powers as it counts (Epstein and Sobel 1953 [1]_).

References
----------
.. [1] B. Epstein, M. Sobel, "Life testing", J. American Statistical Association 48, 1953.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from signals.harmonics._slip_record import Demodulated, Line, SlipRecord

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

# In widths, 1 / segment. Under Hann's window cells this far apart are as good as independent, a line this far away
# is 41 dB down and falls off by 18 dB an octave.
_SPACING = 2
_AWAY = 3
_CELLS = 24  # in a segment, for each harmonic
_FEWEST = 16  # in the record
_WANTED = 64  # in the record


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseCells:
    """Where the noise is measured.

    Attributes
    ----------
    harmonic : (cell,) array, number of the nearest harmonic.
    away : (cell,) array, orders from there.
    """

    harmonic: Whole
    away: Floats


def cells_beside(record: SlipRecord, line: Line, *, width: float, segments: int) -> NoiseCells:
    """Choose the cells nearest to the searched bands: not in one, nor near order 0 or half of the rate."""
    fastest = float(np.diff(record.turning).max())
    order = width * np.arange(_AWAY, pi / fastest / width - 1, _SPACING)
    number = np.arange(1, line.harmonics + 1)
    away = order[:, None] - number * line.order
    beyond = np.min(np.abs(away) - number * line.order * line.largest_slip, axis=1)
    good = np.flatnonzero(beyond >= _AWAY * width)
    near = good[np.argsort(beyond[good], kind="stable")]
    near = near[: max(_CELLS * line.harmonics, -(-_WANTED // segments))]
    nearest = np.abs(away[near]).argmin(axis=1)
    return NoiseCells(harmonic=nearest + 1, away=away[near, nearest])


def noise_beside(data: Demodulated, cells: NoiseCells, *, order: float) -> tuple[float, int]:
    """Measure the variance of white noise as dense as that in the cells.

    Returns
    -------
    The variance, and how many powers count: it has the distribution of the mean of so many.
    """
    powers = []
    for part in data.parts:
        angle, counts, turned = data.angle[part], data.counts[part], data.turned[part]
        lead = angle - (angle.max() + angle.min()) / 2
        window = 0.5 + 0.5 * np.cos(lead * (2 * pi / max(np.ptp(lead), 1e-300)))
        seen = window**2 @ counts
        # What is half a gap has cells half as fine: neighbours are not independent, and the line is in some.
        if turned[counts > 0].sum() < turned.sum() / 2 or seen == 0:
            continue
        for k, harmonic in enumerate(data.sums, start=1):
            near = np.exp(-1j * np.outer(cells.away[cells.harmonic == k], lead)) @ (window * harmonic[part])
            powers.append(np.abs(near) ** 2 / seen)
    values = np.sort(np.concatenate(powers)) if powers else np.empty(0)
    if values.size < _FEWEST:
        raise ValueError(
            f"the noise beside order {order:g} shows in {values.size} independent cells of the record, and {_FEWEST} "
            "are needed to tell its variance: take a longer record or fewer harmonics, or pass noise_variance."
        )
    lower = values.size // 2
    noise = float(values[:lower].sum() + (values.size - lower) * values[lower - 1]) / lower
    if noise <= 0:
        raise ValueError(
            f"x shows no noise beside order {order:g} ({values.size} cells were looked at), and without it "
            "nothing can be weighed: pass noise_variance."
        )
    return noise, lower
