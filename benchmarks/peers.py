"""The usual ways to do what the trackers do, on what pip installs: each from its own textbook, none on our code.

Each takes a job and a bandwidth in the job's own units, and returns the (order, output) complex amplitudes with the
samples they belong to. The bandwidth is that of the trackers: full -3 dB width, of the smoother for the causal ones.
"""

from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
from jobs import Floats, Job
from numpy.typing import NDArray
from scipy import linalg, signal, sparse

Tracks = tuple[NDArray[np.complex128], Floats]

PRIOR_VARIANCE = 1e6  # of each quadrature before the first sample, in units of the noise
BLOCK = 200  # samples in a sum


def walk_variance(job: Job, bandwidth: float, *, poles: int, block: int = 1) -> float:
    """Variance of the white `poles`-th difference from one block to the next, beside noise of variance 1 a sample."""
    turn = 2 * np.sin(0.5 * np.pi * bandwidth * block / job.rate)
    return float(2 / block * turn ** (2 * poles) / (np.sqrt(2) - 1))


def regressors(job: Job, samples: slice = slice(None)) -> Floats:
    """(sample, 2 orders) array: cosines, then sines turned round."""
    angle = np.stack([job.angle_rad(order)[samples] for order in range(len(job.orders))], axis=1)
    return np.concatenate([np.cos(angle), -np.sin(angle)], axis=1)


def _complex(levels: Floats) -> NDArray[np.complex128]:
    """(order, output) amplitudes of (output, 2 orders) quadratures."""
    half = levels.shape[1] // 2
    return np.asarray((levels[:, :half] + 1j * levels[:, half:]).T)


def demodulated(job: Job, bandwidth: float) -> Tracks:
    """Shift each order to zero and low-pass it forward and backward with a Butterworth filter of order 2.

    Both passes together multiply an envelope of f Hz by `1 / (1 + (f / fc)^4)`.
    """
    corner = 0.5 * bandwidth / (np.sqrt(2) - 1) ** 0.25
    section = signal.butter(2, corner, fs=job.rate, output="sos")
    out = np.empty((len(job.orders), job.samples), dtype=np.complex128)
    for order in range(len(job.orders)):
        out[order] = signal.sosfiltfilt(section, 2 * job.x * np.exp(-1j * job.angle_rad(order)))
    return out, np.arange(job.samples, dtype=np.float64)


def _penalty(steps: int, poles: int) -> list[Floats]:
    """Diagonals of `D^T D` from the main one down, D the `poles`-th difference."""
    difference = sparse.eye_array(steps, format="csr")
    for _ in range(poles):
        difference = difference[1:] - difference[:-1]
    return [np.asarray((difference.T @ difference).diagonal(-d)) for d in range(poles + 1)]


def _centres(blocks: int, block: int) -> Floats:
    return np.arange(blocks, dtype=np.float64) * block + 0.5 * (block - 1)


def vold_kalman_alone(job: Job, bandwidth: float, *, poles: int, block: int = 1) -> Tracks:
    """Solve `(r^2 D^T D + I) Z = 2 x exp(-j theta)` for each order by itself, on means over blocks of samples.

    All orders share one banded Cholesky factor.
    """
    blocks = job.samples // block
    weight = 2 / block / walk_variance(job, bandwidth, poles=poles, block=block)
    band = np.zeros((poles + 1, blocks))
    for offset, diagonal in enumerate(_penalty(blocks, poles)):
        band[offset, : diagonal.size] = weight * diagonal
    band[0] += 1
    right = np.empty((blocks, 2 * len(job.orders)))
    for order in range(len(job.orders)):
        turned = 2 * job.x * np.exp(-1j * job.angle_rad(order))
        mean = turned[: blocks * block].reshape(blocks, block).mean(axis=1)
        right[:, order], right[:, len(job.orders) + order] = mean.real, mean.imag
    return _complex(linalg.solveh_banded(band, right, lower=True)), _centres(blocks, block)


def vold_kalman_coupled(job: Job, bandwidth: float, *, poles: int, block: int = BLOCK) -> Tracks:
    """Solve for all orders together, each constant over a block: `(A^T A + D^T D / q) z = A^T x`, A the regressors."""
    blocks, width = job.samples // block, 2 * len(job.orders)
    moments, right = np.empty((blocks, width, width)), np.empty((blocks, width, 1))
    at_once = max(1, (1 << 15) // block)
    for start in range(0, blocks, at_once):
        part = slice(start, min(start + at_once, blocks))
        samples = slice(part.start * block, part.stop * block)
        rows = regressors(job, samples).reshape(-1, block, width)
        moments[part] = rows.transpose(0, 2, 1) @ rows
        right[part] = rows.transpose(0, 2, 1) @ job.x[samples].reshape(-1, block, 1)
    band = np.zeros((max(poles * width, width - 1) + 1, blocks * width))
    view = band.reshape(-1, blocks, width)
    for row in range(width):
        for column in range(row + 1):
            view[row - column, :, column] = moments[:, row, column]
    weight = 1 / walk_variance(job, bandwidth, poles=poles, block=block)
    for offset, diagonal in enumerate(_penalty(blocks, poles)):
        view[offset * width, : diagonal.size] += weight * diagonal[:, None]
    solved = linalg.solveh_banded(band, right.ravel(), lower=True, overwrite_ab=True)
    return _complex(solved.reshape(blocks, width)), _centres(blocks, block)


@numba.njit(error_model="numpy", fastmath=True, inline="always")
def _covariance_step(row: Floats, datum: float, mean: Floats, covariance: Floats, gain: Floats, walk: float) -> None:
    """Take in one sample, then let the walk take one step: the filter as textbooks print it, plain random walk."""
    gain[:] = 0.0
    for a in range(row.size):
        for b in range(row.size):
            gain[b] += row[a] * covariance[a, b]
    innovation, variance = datum, 1.0
    for a in range(row.size):
        innovation -= row[a] * mean[a]
        variance += row[a] * gain[a]
    share = 1.0 / variance
    for a in range(row.size):
        mean[a] += gain[a] * share * innovation
        part = gain[a] * share
        for b in range(row.size):
            covariance[a, b] -= part * gain[b]
        covariance[a, a] += walk


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _covariance_given(rows: Floats, x: Floats, walk: float, prior: float, levels: Floats) -> None:
    covariance = prior * np.eye(rows.shape[1])
    mean, gain = np.zeros((2, rows.shape[1]))
    for sample in range(x.size):
        _covariance_step(rows[sample], x[sample], mean, covariance, gain, walk)
        levels[sample] = mean


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _covariance_turning(
    phases: Floats, of_order: NDArray[np.int64], orders: Floats, x: Floats, walk: float, prior: float, levels: Floats
) -> None:
    count = orders.size
    covariance = prior * np.eye(2 * count)
    mean, gain, row = np.zeros((3, 2 * count))
    for sample in range(x.size):
        for k in range(count):
            angle = orders[k] * phases[of_order[k], sample]
            row[k], row[count + k] = np.cos(angle), -np.sin(angle)
        _covariance_step(row, x[sample], mean, covariance, gain, walk)
        levels[sample] = mean


def compiled_filter(job: Job, bandwidth: float) -> Tracks:
    """Run the one-pole covariance filter as a compiled loop, sines and cosines in it."""
    phases = job.phase_rad if isinstance(job.phase_rad, Mapping) else {"": job.phase_rad}
    pairs = [order if isinstance(order, tuple) else ("", order) for order in job.orders]
    levels = np.empty((job.samples, 2 * len(pairs)))
    _covariance_turning(
        np.stack(list(phases.values())),
        np.array([list(phases).index(shaft) for shaft, _ in pairs]),
        np.array([order for _, order in pairs]),
        job.x,
        walk_variance(job, bandwidth, poles=1),
        PRIOR_VARIANCE,
        levels,
    )
    return _complex(levels), np.arange(job.samples, dtype=np.float64)


def compiled_filter_given(job: Job, bandwidth: float, *, rows: Floats) -> Tracks:
    """Run the same loop on regressors made beforehand."""
    levels = np.empty(rows.shape)
    _covariance_given(rows, job.x, walk_variance(job, bandwidth, poles=1), PRIOR_VARIANCE, levels)
    return _complex(levels), np.arange(job.samples, dtype=np.float64)


def filterpy_filter(job: Job, bandwidth: float) -> Tracks:
    """Run the one-pole covariance filter on filterpy, predict and update in turn."""
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415

    rows = regressors(job)
    kalman = KalmanFilter(dim_x=rows.shape[1], dim_z=1)
    kalman.P *= PRIOR_VARIANCE
    kalman.Q *= walk_variance(job, bandwidth, poles=1)
    levels = np.empty(rows.shape)
    for sample, row in enumerate(rows):
        if sample:
            kalman.predict()
        kalman.update(job.x[sample], H=row[None])
        levels[sample] = kalman.x[:, 0]
    return _complex(levels), np.arange(job.samples, dtype=np.float64)


def statsmodels_filter(job: Job, bandwidth: float) -> Tracks:
    """Run the one-pole covariance filter on the compiled one of statsmodels, which keeps no covariances."""
    from statsmodels.tsa.statespace import kalman_filter  # noqa: PLC0415

    rows = regressors(job)
    size = rows.shape[1]
    kalman: Any = kalman_filter.KalmanFilter(k_endog=1, k_states=size)
    # Covariances of every sample would fill gigabytes.
    kalman.conserve_memory = (
        kalman_filter.MEMORY_NO_PREDICTED_COV
        | kalman_filter.MEMORY_NO_FILTERED_COV
        | kalman_filter.MEMORY_NO_GAIN
        | kalman_filter.MEMORY_NO_SMOOTHING
        | kalman_filter.MEMORY_NO_STD_FORECAST
    )
    kalman.bind(job.x[:, None])
    kalman["design"] = np.ascontiguousarray(rows.T)[None]
    kalman["transition"] = kalman["selection"] = np.eye(size)
    kalman["state_cov"] = walk_variance(job, bandwidth, poles=1) * np.eye(size)
    kalman["obs_cov"] = np.eye(1)
    kalman.initialize_known(np.zeros(size), PRIOR_VARIANCE * np.eye(size))
    return _complex(kalman.filter().filtered_state.T), np.arange(job.samples, dtype=np.float64)
