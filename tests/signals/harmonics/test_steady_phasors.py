"""Phasors of pieces of a record against the library's sines, however steadily the shaft turns."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import _block_kernels
from signals.harmonics._steady_phasors import PIECE, begin_piece, fill_steady, workspace

N = np.arange(5 * PIECE)
ORDERS = np.array([0.0, 0.37, 1.0, 12.3, 54.0, 1.0, 54.0])
SHAFT = np.array([0, 0, 0, 0, 0, 1, 1])
SHAFTS = {
    "at rest": np.full(N.size, 3.0),
    "steady": 1e3 + 2 * np.pi / 512 * N,
    "steady, high": np.pi / 54 * N,
    "running up": 0.03 * N + 2e-9 * N**2,
    "wobbling": 0.03 * N + 1e-4 * np.sin(0.05 * N),
    "wild": 0.03 * N + 0.02 * np.sin(0.3 * N),
    "a step": 0.03 * N + 0.02 * np.maximum(N - 600, 0),
    "reversing": 0.02 * np.abs(N - 700),
}


def phasors(phase, first, last):
    cosine, sine = np.zeros((ORDERS.size, PIECE)), np.zeros((ORDERS.size, PIECE))
    work = workspace(len(phase), ORDERS.size)
    begin_piece(work, phase, first, last)
    fill_steady(work, ORDERS, SHAFT, phase, first, last, cosine, sine)
    assert np.isfinite(cosine).all()
    assert np.isfinite(sine).all()
    return cosine[:, : last - first] + 1j * sine[:, : last - first]


@pytest.mark.parametrize("turning", SHAFTS)
@pytest.mark.parametrize("size", [1, 2, 15, 16, 17, 83, PIECE])
def test_phasors_are_those_of_the_angles(turning, size):
    phase = np.stack([SHAFTS[turning], SHAFTS["steady"]])
    for first in (0, 500, N.size - size):
        expected = np.exp(1j * ORDERS[:, None] * phase[SHAFT, first : first + size])
        # A turn rounds 2e-16, and there are sixteen; angles of up to 6e4 rad are themselves good to 4e-12.
        tolerance = 1e-14 + 2.3e-16 * np.abs(ORDERS[:, None] * phase[SHAFT, first : first + size])
        assert np.all(np.abs(phasors(phase, first, first + size) - expected) < tolerance)


@pytest.mark.parametrize("turning", ["steady", "running up", "wild"])
@pytest.mark.parametrize("length", [7, 100, 300])
@pytest.mark.parametrize("pairs", [1, 2])
def test_moments_are_sums_of_the_record_times_its_phasors(turning, length, pairs):
    rng = np.random.default_rng(0)
    x = rng.standard_normal((2, 1000))
    phase = np.stack([SHAFTS[turning], SHAFTS["steady"]])[:, :1000].copy()
    sums = np.empty((ORDERS.size, -(-1000 // length), pairs * 2, 4))
    _block_kernels.project(x, phase, ORDERS, SHAFT, length, sums)
    angle = ORDERS[:, None] * phase[SHAFT]
    u = np.arange(1000) % length / length
    parts = np.stack([np.cos(angle), u * np.cos(angle), -np.sin(angle), -u * np.sin(angle)])
    starts = np.arange(0, 1000, length)
    x = np.concatenate([u ** (2 * pair) * x for pair in range(pairs)])
    expected = np.add.reduceat(parts[:, :, None] * x, starts, axis=-1)  # part, order, pair channel, block
    # Some hundred terms of order 1, each to the 4e-12 of its angle.
    assert_allclose(sums, expected.transpose(1, 3, 2, 0), rtol=0, atol=1e-10)


@pytest.mark.parametrize("length", [9, 130, 300])
@pytest.mark.parametrize("moments", [2, 3, 5, 7])
def test_products_are_sums_over_the_samples_seen(length, moments):
    rng = np.random.default_rng(1)
    seen = (rng.uniform(size=(1, 700)) > 0.2).astype(float)
    phase = np.stack([SHAFTS["running up"], SHAFTS["wild"]])[:, :700].copy()
    width = 2 * ORDERS.size
    sums = np.empty((-(-700 // length), moments, width, width))
    _block_kernels.correlate(seen, phase, ORDERS, SHAFT, length, sums)
    angle = ORDERS[:, None] * phase[SHAFT]
    columns = seen * np.concatenate([np.cos(angle), -np.sin(angle)])
    u = np.arange(700) % length / length
    for block, start in enumerate(range(0, 700, length)):
        here = slice(start, start + length)
        for moment in range(moments):
            expected = (u**moment * columns)[:, here] @ columns[:, here].T
            assert_allclose(sums[block, moment], expected, rtol=0, atol=1e-10)
