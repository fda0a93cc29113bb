"""The bandwidth under which a record is most likely: how fast each order's amplitude really wanders.

A tracker's `std` is honest when its random walk moves as the amplitude does. All orders are first tracked
together with the largest bandwidth allowed, and each is left alone by subtracting the others. Averages of the
rest, turned to rest with the order's own phase, over blocks of a quarter of 1 / bandwidth, then follow the local
level model: a random walk of variance q a block, seen in noise of known variance. Its exact likelihood is a
product over blocks of a scalar Kalman filter's innovations (Schweppe 1965), here for a grid of q at once.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from signals._checks import Array, positive, real_vector
from signals.harmonics.model import smoother_bandwidth
from signals.harmonics.tracker import track_orders

_BLOCKS_PER_BANDWIDTH = 4
_GRID = np.concatenate([[0.0], np.logspace(-6, 3, 73)])  # q over the noise variance of a block
_SMALLEST = 0.1  # of one over the record: there an amplitude is a constant


def likely_bandwidth(
    x: ArrayLike,
    *,
    phase_rad: ArrayLike,
    orders: Sequence[float],
    samples_per_rev: int,
    noise_variance: ArrayLike,
    largest_bandwidth_orders: float,
) -> Array:
    """Return the most likely one-pole bandwidth of each order, (order,), in orders.

    Parameters
    ----------
    x : (n,) array
        Record over angle, finite.
    phase_rad : (n,) array
    orders : sequence of float
    samples_per_rev : int
    noise_variance : (order,) array
        Variance of the white noise that is as dense as the noise beside each order.
    largest_bandwidth_orders : float
        No bandwidth above this is considered.

    Returns
    -------
    (order,) array
        Between a tenth of one over the record's revolutions and the largest allowed.
    """
    signal = real_vector(x, name="x", minimum=2)
    phase = real_vector(phase_rad, name="phase_rad", minimum=2)
    largest = positive(largest_bandwidth_orders, name="largest_bandwidth_orders")
    block = max(1, round(samples_per_rev / (_BLOCKS_PER_BANDWIDTH * largest)))
    noise = np.broadcast_to(np.asarray(noise_variance, dtype=np.float64), (len(orders),))
    tracks = track_orders(
        signal,
        phase_rad=phase,
        orders=orders,
        bandwidth_orders=min(largest, samples_per_rev / 8),
        samples_per_rev=samples_per_rev,
        output_every=block,
    )
    waves = [
        _wave(amplitude, tracks.sample_index, order * phase)
        for amplitude, order in zip(tracks.complex_amplitude, orders, strict=True)
    ]
    left = signal - np.sum(waves, axis=0)
    smallest = _SMALLEST * samples_per_rev / signal.size
    found = [
        _bandwidth(_levels(left + wave, order * phase, block), variance, block, samples_per_rev)
        for wave, order, variance in zip(waves, orders, noise, strict=True)
    ]
    return np.clip(found, smallest, largest)


def _wave(amplitude: np.ndarray, index: np.ndarray, angle: Array) -> Array:
    """Waveform of one track, its amplitude interpolated between outputs."""
    sample = np.arange(angle.size)
    level = np.interp(sample, index, amplitude.real) + 1j * np.interp(sample, index, amplitude.imag)
    return np.asarray((level * np.exp(1j * angle)).real)


def _levels(signal: Array, angle: Array, block: int) -> np.ndarray:
    """Complex amplitude averaged over each whole block, (block number,)."""
    count = signal.size // block
    at_rest = 2 * signal[: count * block] * np.exp(-1j * angle[: count * block])
    return np.asarray(at_rest.reshape(count, block).mean(axis=1))


def _bandwidth(levels: np.ndarray, noise_variance: float, block: int, samples_per_rev: int) -> float:
    seen = 2 * noise_variance / block  # of each quadrature of a block's level
    likelihood = _log_likelihood(np.stack([levels.real, levels.imag]), seen)
    walk = _GRID[int(np.argmax(likelihood))] * seen / block  # variance a sample
    width = smoother_bandwidth(
        orders=[1.0], process_variance=[walk], rate=samples_per_rev, poles=1, noise_variance=noise_variance
    )
    return float(np.nan_to_num(width[0], nan=np.inf))


def _log_likelihood(levels: Array, noise_variance: float) -> Array:
    """Log likelihood of the local level model for every q of the grid, from a start at the first level."""
    variance = np.full(_GRID.size, noise_variance)
    mean = np.repeat(levels[:, :1], _GRID.size, axis=1)
    total = np.zeros(_GRID.size)
    for level in levels.T[1:]:
        predicted = variance + _GRID * noise_variance
        innovation = predicted + noise_variance
        error = level[:, None] - mean
        total -= np.log(innovation) + np.sum(error**2, axis=0) / (2 * innovation)
        gain = predicted / innovation
        mean = mean + gain * error
        variance = gain * noise_variance
    return total
