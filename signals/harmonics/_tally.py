"""What the innovations of a filter sum up to: their squares, the logarithms of their variances, their products."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums

Floats = NDArray[np.float64]

LAGS = 20  # a multiple of four
_LAG = np.arange(1, LAGS + 1)
# Factors whose product is taken before its logarithm.
_FACTORS = 16
# Steps correlated at a time: they stay in the nearest cache.
_PIECE = 1024


@dataclass
class Tally:
    """Sums over the innovations that count.

    Attributes
    ----------
    square : (channel,) array, of their squares over their variances.
    log_variance : of the logarithms of their variances.
    count : how many.
    products : (channel, lag) array, of the products of two that lie 1, 2, ... steps apart.
    pairs : (lag,) array, how many of these.
    recent, recent_seen : (LAGS, row, channel) and (LAGS, row) arrays, the last innovations and 1.0 where there is one.
    kept, kept_roots : all of them, and one over their standard deviations where R = 1, 0 where missing: (step, row,
        channel) and (step, row) arrays in order, where asked for.
    """

    square: Floats
    products: Floats
    pairs: Floats
    recent: Floats
    recent_seen: Floats
    log_variance: float = 0.0
    count: int = 0
    kept: list[Floats] | None = None
    kept_roots: list[Floats] | None = None

    @classmethod
    def empty(cls, *, channels: int, keep: bool = False) -> "Tally":
        """Return a tally of nothing."""
        return cls(
            square=np.zeros(channels),
            products=np.zeros((channels, LAGS)),
            pairs=np.zeros(LAGS),
            recent=np.zeros((LAGS, 1, channels)),
            recent_seen=np.zeros((LAGS, 1)),
            kept=[] if keep else None,
            kept_roots=[] if keep else None,
        )

    @property
    def mean_square(self) -> Floats:
        """(channel,) array."""
        return self.square / max(self.count, 1)

    @property
    def autocorrelation(self) -> Floats:
        """(channel, lag) array; 0 where there is none."""
        mean = self.mean_square[:, None]
        scale = np.maximum(self.pairs, 1.0) * np.where(mean > 0.0, mean, 1.0)
        return np.asarray(self.products / scale)

    def forget(self) -> None:
        """Take no products of what comes with what was."""
        self.recent[:] = self.recent_seen[:] = 0.0

    def add(self, innovations: Floats, roots: Floats, *, skip: int) -> None:
        """Count a stretch but for its first `skip` steps, as the filter left it."""
        if self.kept is not None and self.kept_roots is not None:
            self.kept.append(innovations.copy())
            self.kept_roots.append(roots.copy())
        innovations, roots = innovations[max(skip, 0) :], roots[max(skip, 0) :]
        if len(innovations) == 0:
            return
        if self.count == 0:
            self.recent = np.zeros((LAGS, *innovations.shape[1:]))
            self.recent_seen = np.zeros((LAGS, innovations.shape[1]))
        joined = np.concatenate([self.recent, innovations])
        logarithm, count = _count(innovations, roots, self.square)
        self.log_variance += logarithm
        self.count += count
        if count == roots.size and self.recent_seen.all():
            self.pairs += count
        elif count == roots.size and len(roots) >= LAGS and not self.recent_seen.any():
            self.pairs += roots.shape[1] * (len(roots) - _LAG)
            self.recent_seen = np.ones_like(self.recent_seen)
        else:
            seen = np.concatenate([self.recent_seen, (roots != 0.0).astype(np.float64)])
            # A pair is a product of ones.
            _correlate(np.ascontiguousarray(seen.T)[None], self.pairs[None])
            self.recent_seen = seen[-LAGS:].copy()
        _correlate(np.ascontiguousarray(joined.transpose(2, 1, 0)), self.products)
        self.recent = joined[-LAGS:].copy()


@compiled_sums
def _count(innovations: Floats, roots: Floats, square: Floats) -> tuple[float, int]:
    """Add the squares to `square`; return the sum of log variances and the number of innovations."""
    logarithm, missing = 0.0, 0
    flat = roots.reshape(roots.size)
    values = innovations.reshape(roots.size, square.size)
    for start in range(0, flat.size, _FACTORS):
        product = 1.0
        for i in range(start, min(start + _FACTORS, flat.size)):
            if flat[i] == 0.0:
                missing += 1
            else:
                product *= flat[i]
        logarithm -= 2.0 * np.log(product)
    for k in range(square.size):
        total = 0.0
        for i in range(flat.size):
            total += values[i, k] * values[i, k]
        square[k] += total
    return logarithm, flat.size - missing


@compiled_sums
def _correlate(innovations: Floats, products: Floats) -> None:
    """Add products at each lag of (channel, row, step) innovations, the first LAGS steps being counted."""
    channels, rows, steps = innovations.shape
    for k in range(channels):
        for row in range(rows):
            values = innovations[k, row]
            for first in range(LAGS, steps, _PIECE):
                late = values[first : min(first + _PIECE, steps)]
                for lag in range(1, LAGS + 1, 4):
                    # Four lags at a time: what is loaded of the late ones serves all.
                    early = values[first - lag - 3 :]
                    s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0
                    for i in range(late.size):
                        s1 += late[i] * early[i + 3]
                        s2 += late[i] * early[i + 2]
                        s3 += late[i] * early[i + 1]
                        s4 += late[i] * early[i]
                    products[k, lag - 1] += s1
                    products[k, lag] += s2
                    products[k, lag + 1] += s3
                    products[k, lag + 2] += s4
