"""Slip of a rolling bearing: impacts with independent random intervals, whose errors add up.

The impacts have no exact period: their times deviate like a random walk (Antoni and Randall 2003, J. Vib. Acoust. 125,
282-289).
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from data_synth.profile import Array

_BLOCK = 4096  # intervals drawn at once


class SlipModel(Protocol):
    """Mean and scatter of the intervals between impacts: `Slip`, or a declared fault."""

    @property
    def mean_slip(self) -> float:
        """Relative reduction of the mean rate below that of pure rolling."""

    @property
    def slip_std(self) -> float:
        """Standard deviation of an interval over the mean interval."""


@dataclass(frozen=True, kw_only=True)
class Slip:
    """Slip as a renewal process: independent Gaussian intervals ``(1 + slip_std g) / (order (1 - mean_slip))``.

    The power spectral density of the impacts at harmonic k of their mean rate is, over that rate, the hyperbolic
    cotangent of ``(2 pi k slip_std)^2 / 4``: lines broaden into the background as k grows.
    """

    mean_slip: float = 0.0
    slip_std: float = 0.01

    def __post_init__(self) -> None:
        if not 0 <= self.slip_std <= 0.1:  # noqa: PLR2004
            raise ValueError(f"slip_std = {self.slip_std:g}: 0 to 0.1 keeps impacts in their order; lower it")
        if not self.mean_slip < 1:
            raise ValueError(f"mean_slip = {self.mean_slip:g}: at 1 nothing rolls; keep it below")


def renewal_process(
    *,
    order: float,
    slip: SlipModel,
    span_rev: tuple[float, float],
    rng: np.random.Generator,
    since_rev: float | None = None,
) -> tuple[Array, int]:
    """Draw the angles of the reference shaft at which a defect is struck.

    Parameters
    ----------
    order : float
        Impacts per revolution of the reference shaft under pure rolling.
    slip : Slip or alike
    span_rev : (float, float)
        First and last revolution of interest.
    rng : numpy.random.Generator
    since_rev : float, optional
        Revolution from which earlier impacts are drawn too; those within the span do not depend on it.

    Returns
    -------
    revolutions : (n,) array
        Rising: the last impact before the interval, those in it, and the first after it.
    first : int
        Number of the first of them: the first within the span has number 0.
    """
    first, last = span_rev
    interval = 1 / (order * (1 - slip.mean_slip))
    begin, elapsed = first - interval * rng.random(), 0.0
    drawn = [np.array([begin])]
    while begin + interval * elapsed <= last:
        counted = elapsed + np.cumsum(1 + slip.slip_std * rng.standard_normal(_BLOCK))
        elapsed = float(counted[-1])
        drawn.append(begin + interval * counted)
    impacts = np.concatenate(drawn)
    within = np.searchsorted(impacts, first), np.searchsorted(impacts, last, side="right")
    impacts = impacts[max(int(within[0]) - 1, 0) : int(within[1]) + 1]
    before = (
        _impacts_before(impacts[0], interval, slip, since_rev, rng.spawn(1)[0])
        if since_rev is not None
        else np.empty(0)
    )
    return np.concatenate([before, impacts]), -1 - before.size


def _impacts_before(
    begin: float, interval: float, slip: SlipModel, since_rev: float, rng: np.random.Generator
) -> Array:
    """Return the impacts before `begin`, rising, back to the last one before `since_rev`."""
    drawn, begin = [np.empty(0)], float(begin)
    while begin >= since_rev:
        drawn.insert(0, begin - interval * np.cumsum(1 + slip.slip_std * rng.standard_normal(_BLOCK))[::-1])
        begin = float(drawn[0][0])
    impacts = np.concatenate(drawn)
    return impacts[max(int(np.searchsorted(impacts, since_rev)) - 1, 0) :]
