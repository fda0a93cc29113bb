"""What a bandwidth implies: the causal filter beside the smoother, the weight, the steady uncertainty."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import solve_discrete_are

from signals.harmonics.bandwidth import Bandwidth

POLES = [1, 2, 3, 4]
# Widths of the causal filter over the smoother's, and its peaks in dB, for narrow bandwidths: the standard jobs.
WIDTH_RATIO = {1: 1.554, 2: 2.565, 3: 3.279, 4: 4.080}
PEAK_DB = {1: 0.0, 2: 2.1, 3: 4.0, 4: 5.2}


def steady_filter(width, poles):
    """Predicted covariance and gain of the filter of one quadrature in noise of unit variance, by scipy.

    The walk counts its differences backwards: the level takes all of them along, and the noise enters everywhere.
    """
    q = Bandwidth(width=width, poles=poles).weight ** -2  # in noise of variance 0.5, of which it has twice as much
    move = np.triu(np.ones((poles, poles)))
    see = np.eye(poles)[:1]
    predicted = solve_discrete_are(move.T, see.T, q * np.ones((poles, poles)), np.eye(1))
    gain = predicted @ see.T / (predicted[0, 0] + 1)
    return move, see, predicted, gain


@pytest.mark.parametrize("poles", POLES)
def test_narrow_causal_filter_is_the_known_one(poles):
    narrow, ratio = Bandwidth(width=1e-7, poles=poles), WIDTH_RATIO[poles]  # printed to three digits
    inside, outside = np.abs(narrow.filter_gain(0.5e-7 * np.array([ratio - 6e-4, ratio + 6e-4])))
    assert inside > np.sqrt(0.5) > outside
    gain = np.abs(narrow.filter_gain(0.5e-7 * np.linspace(0, 3, 3001)))
    assert 20 * np.log10(gain.max()) == pytest.approx(PEAK_DB[poles], abs=0.06)  # printed to one


@pytest.mark.parametrize("poles", POLES)
@pytest.mark.parametrize("width", [1e-9, 1e-17, 1e-40])
def test_bandwidths_below_the_last_digit_of_one_keep_theirs(poles, width):
    """Butterworth's circle: of its radius a, a^2p = q / N, the slowest root has the sine of pi / 2p."""
    radius = np.pi * width * (np.sqrt(2) - 1) ** (-1 / (2 * poles))
    sines = np.sin(np.pi * (2 * np.arange(poles) + 1) / (2 * poles))
    narrow = Bandwidth(width=width, poles=poles)
    # The circle itself is good to its own radius, 5e-9 at the widest.
    assert_allclose(narrow.filter_decay, radius * sines.min(), rtol=1e-8)
    assert np.abs(narrow.filter_gain(0.5 * width * WIDTH_RATIO[poles])) == pytest.approx(np.sqrt(0.5), abs=3e-4)
    std = narrow.isolated_std(0.5, estimator="filter")
    assert_allclose(std**2, radius * sines.sum(), rtol=1e-8)
    assert_allclose(narrow.smoother_gain([0.0, width / 2, 0.1]), [1, np.sqrt(0.5), 0], rtol=1e-8, atol=1e-8)


def test_the_theory_page_prints_the_same_figures():
    page = Path(__file__).parents[3].joinpath("docs", "trackers.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line[:2] == "| " and line[2:3].isdigit()]
    assert {int(p): (float(ratio), float(peak)) for p, ratio, peak in rows} == {
        p: (WIDTH_RATIO[p], PEAK_DB[p]) for p in POLES
    }


@pytest.mark.parametrize("poles", POLES)
@pytest.mark.parametrize("width", [0.01, 0.1, 0.4])
def test_filter_gain_is_that_of_the_steady_kalman_filter(poles, width):
    move, see, _, gain = steady_filter(width, poles)
    offset = np.linspace(0, 0.5, 31)
    z = np.exp(2j * np.pi * offset)
    # filtered[n] = (I - K H) F filtered[n - 1] + K y[n]
    step = (np.eye(poles) - gain @ see) @ move
    expected = [(see @ np.linalg.solve(np.eye(poles) - step / a, gain)).item() for a in z]
    # The Riccati solution of four poles at 0.01 is good to some 1e-10 only.
    assert_allclose(Bandwidth(width=width, poles=poles).filter_gain(offset), expected, atol=1e-8)


@pytest.mark.parametrize("poles", POLES)
@pytest.mark.parametrize("width", [0.01, 0.1, 0.6])
def test_filter_std_solves_the_riccati_equation(poles, width):
    predicted = steady_filter(width, poles)[2][0, 0]
    std = Bandwidth(width=width, poles=poles).isolated_std(0.5, estimator="filter")
    assert_allclose(std, np.sqrt(predicted / (predicted + 1)), rtol=1e-9)


@pytest.mark.parametrize("poles", POLES)
def test_smoother_std_is_that_of_a_dense_problem(poles):
    width, samples, noise = 0.08, 600, 3.0
    band = Bandwidth(width=width, poles=poles)
    q = noise / band.weight**2
    difference = np.diff(np.eye(samples), poles, axis=0)
    covariance = np.linalg.inv(np.eye(samples) / noise + difference.T @ difference / q)
    # The ends, 24 bandwidths away, are forgotten at exp(-2 pi 24 sin(pi / 8)) or faster; rounding: condition 4^p N / q.
    assert_allclose(band.isolated_std(noise / 2) ** 2, covariance[samples // 2, samples // 2], rtol=2e-8)


@given(width=st.floats(1e-6, 1.0), poles=st.integers(1, 4))
def test_weight_and_width_are_inverse(width, poles):
    weight = Bandwidth(width=width, poles=poles).weight
    # At half of the rate the sine is flat: there its argument has half the digits.
    assert_allclose(Bandwidth.from_weight(weight * (1 + 1e-12), poles=poles).width, width, rtol=1e-5)


def test_what_makes_no_bandwidth_is_refused():
    with pytest.raises(ValueError, match=r"width=10 cycles a sample is above 1"):
        Bandwidth(width=10, poles=1)
    with pytest.raises(ValueError, match=r"poles=5 must be a whole number from 1 to 4"):
        Bandwidth(width=0.1, poles=5)
    least = Bandwidth(width=1.0, poles=2).weight
    with pytest.raises(ValueError, match=rf"weight=0.1 with poles=2 .* above {least:.3g}\."):
        Bandwidth.from_weight(0.1, poles=2)
    with pytest.raises(ValueError, match=r"estimator='smother' is unknown"):
        Bandwidth(width=0.1, poles=1).isolated_std(1.0, estimator="smother")
