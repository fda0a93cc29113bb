"""What the tracks of a record say of its noise and its innovations, channel by channel."""

from typing import Any

import numpy as np

from signals.harmonics.inputs import SMALLEST
from signals.harmonics.model import Estimate, Floats
from signals.harmonics.patterns import Patterns


def of_innovations(patterns: Patterns, estimates: list[Estimate], given: float | None) -> dict[str, Any]:
    """Return the fields of `OrderTracks` on noise and innovations, (channel, ...) arrays; `given` noise unless None."""
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
    if estimates[0].innovations is None:
        return found
    scaled = patterns.joined([_kept(estimate.innovations) for estimate in estimates])
    roots = patterns.shared([_kept(estimate.innovation_roots) for estimate in estimates])
    return found | {
        "innovations": np.divide(scaled, roots, out=np.full(scaled.shape, np.nan), where=roots > 0),
        "normalised_innovation_squared": np.divide(
            scaled**2, noise[:, None], out=np.full(scaled.shape, np.nan), where=roots > 0
        ),
    }


def _kept(values: Floats | None) -> Floats:
    assert values is not None  # noqa: S101  (the exact method was asked for them)
    return values


def _check_not_faint(record: Floats, noise: Floats) -> None:
    """Refuse numbers whose squares, and with them the noise, are lost below the smallest that doubles have."""
    for channel in np.flatnonzero(noise < SMALLEST**2):
        values = record[channel]
        largest = max(np.fmax.reduce(values), -np.fmin.reduce(values))
        if 0 < largest < SMALLEST:
            raise ValueError(
                f"x reaches no more than {largest:.3g} in channel {channel}, whose square is too small to tell the "
                "noise by; scale the record to another unit."
            )
