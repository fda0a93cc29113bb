"""Statistics of innovations and residuals: mean square, variance, autocorrelation."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.harmonics.inputs import SMALLEST
from signals.harmonics.model import LAGS, Complexes, Estimate, Floats, Patterns


@dataclass
class Innovations:
    """Sums over the innovations that count.

    Attributes
    ----------
    square : (channel,) array, of their squares over their variances.
    log_variance : of the logarithms of their variances.
    count : how many.
    products : (channel, LAGS) array, of the products of two that lie 1, 2, ... samples apart.
    pairs : (LAGS,) array, how many of these.
    recent : (channel, LAGS) array, the last ones over their standard deviations, 0 where missing.
    recent_seen : (LAGS,) array, 1.0 where there is one.
    kept : stretches of all of them, (channel, sample) over their standard deviations, and (sample,) variances, 0 where
        missing; None unless they are wanted.
    """

    square: Floats
    products: Floats
    pairs: Floats
    recent: Floats
    recent_seen: Floats
    log_variance: float = 0.0
    count: int = 0
    kept: list[tuple[Floats, Floats]] | None = field(default=None)

    @classmethod
    def none(cls, *, channels: int, keep: bool = False) -> "Innovations":
        """Return sums over nothing."""
        return cls(
            square=np.zeros(channels),
            products=np.zeros((channels, LAGS)),
            pairs=np.zeros(LAGS),
            recent=np.zeros((channels, LAGS)),
            recent_seen=np.zeros(LAGS),
            kept=[] if keep else None,
        )

    @property
    def mean_square(self) -> Floats:
        """(channel,) array."""
        return self.square / max(self.count, 1)

    @property
    def mean_log_variance(self) -> float:
        """Mean of the logarithms of the variances."""
        return self.log_variance / max(self.count, 1)

    @property
    def autocorrelation(self) -> Floats:
        """(channel, LAGS) array; 0 where there is none."""
        mean = self.mean_square[:, None]
        scale = np.maximum(self.pairs, 1.0) * np.where(mean > 0.0, mean, 1.0)
        return np.asarray(self.products / scale)

    def estimate(self, amplitude: Complexes, variance: Floats, **more: Any) -> Estimate:  # noqa: ANN401
        """Return an estimate with these statistics."""
        return Estimate(
            amplitude=amplitude,
            variance=variance,
            innovation_mean_square=self.mean_square,
            innovation_log_variance=self.mean_log_variance,
            innovation_autocorrelation=self.autocorrelation,
            innovation_samples=self.count,
            innovations=self.kept,
            **more,
        )

    def separate(self) -> None:
        """Take no products of what follows with what was."""
        self.recent[:] = self.recent_seen[:] = 0.0

    def add(self, innovations: Floats, variances: Floats, *, skip: int = 0) -> None:
        """Count a stretch but for its first samples.

        Parameters
        ----------
        innovations : (channel, sample) array, over their standard deviations, 0 where missing.
        variances : (sample,) array, 0 where missing.
        skip : how many do not count.
        """
        if self.kept is not None:
            self.kept.append((innovations, variances))
        innovations, variances = innovations[:, max(skip, 0) :], variances[max(skip, 0) :]
        if variances.size == 0:
            return
        seen = variances > 0
        whole = bool(seen.all())
        self.square += np.einsum("cn,cn->c", innovations, innovations)
        self.log_variance += float(np.log(variances if whole else variances[seen]).sum())
        self.count += int(np.count_nonzero(seen))
        joined = np.ascontiguousarray(np.concatenate([self.recent, innovations], axis=1))
        known = np.concatenate([self.recent_seen, seen])
        stop, size = joined.shape[1], variances.size
        for lag in range(1, LAGS + 1):
            early = slice(LAGS - lag, stop - lag)
            # No BLAS: its threads take longer to start than such a product does.
            self.products[:, lag - 1] += np.einsum("cn,cn->c", joined[:, LAGS:], joined[:, early])
        if whole and size >= LAGS:  # all pairs within, and those with what is known before
            self.pairs += size - np.arange(1, LAGS + 1) + np.cumsum(self.recent_seen[::-1])
        else:
            self.pairs += [np.sum(known[LAGS:] * known[LAGS - lag : stop - lag]) for lag in range(1, LAGS + 1)]
        self.recent, self.recent_seen = joined[:, -LAGS:].copy(), known[-LAGS:].copy()


def statistics(patterns: Patterns, estimates: list[Estimate], given: float | None) -> dict[str, Any]:
    """Return the fields of `OrderTracks` on noise and innovations, (channel, ...) arrays.

    Parameters
    ----------
    patterns : of missing samples.
    estimates : one for each of them.
    given : variance of the noise; None where the estimates' own is to be taken.
    """
    counts = patterns.shared([np.array(float(estimate.innovation_samples)) for estimate in estimates])
    none = np.where(counts > 0, 0.0, np.nan)
    mean_square = patterns.joined([estimate.innovation_mean_square for estimate in estimates])
    noise = mean_square.astype(np.float64) if given is None else np.full(counts.size, float(given))
    if given is None:
        _check_not_faint(patterns.record, noise)
    growth = np.exp(patterns.shared([np.array(estimate.innovation_log_variance) for estimate in estimates]))
    autocorrelation = patterns.joined([estimate.innovation_autocorrelation for estimate in estimates])
    found = {
        "noise_variance": noise,
        "innovation_variance": noise * growth + none,
        "innovation_mean_square": np.ones(noise.size) if given is None else mean_square / noise + none,
        "innovation_autocorrelation": autocorrelation + none[:, None],
        "whiteness": np.mean(autocorrelation**2, axis=1) * counts + none,
    }
    kept = [estimate.innovations for estimate in estimates if estimate.innovations is not None]
    if not kept:
        return found
    scaled = patterns.joined([_joined([part[0] for part in parts]) for parts in kept])
    variances = patterns.shared([_joined([part[1] for part in parts]) for parts in kept])
    seen = variances > 0
    return found | {
        "innovations": np.where(seen, scaled * np.sqrt(variances), np.nan),
        "normalised_innovation_squared": np.where(seen, scaled**2 / noise[:, None], np.nan),
    }


def _joined(parts: list[Floats]) -> Floats:
    return np.concatenate(parts, axis=-1)


def _check_not_faint(record: NDArray[np.float64], noise: Floats) -> None:
    """Refuse numbers whose squares, and with them the noise, are lost below the smallest that doubles have."""
    for channel in np.flatnonzero(noise < SMALLEST**2):
        values = record[channel]
        largest = max(np.fmax.reduce(values), -np.fmin.reduce(values))
        if 0 < largest < SMALLEST:
            raise ValueError(
                f"x reaches no more than {largest:.3g} in channel {channel}, whose square is too small to estimate "
                "the noise from; scale the record to another unit."
            )
