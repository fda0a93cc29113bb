"""Gears run through their resonances and back: trackers agree with the generator's truth, and know how well."""

import numpy as np
import pytest
import resonance


@pytest.fixture(scope="module")
def made():
    return resonance.case(duration_s=12.0)


def test_the_loud_lines_pass_a_resonance_twice(made):
    # the loudest line at least triples on its way, and has its maximum on both of them
    loudest = np.abs(made.truth[np.argmax(np.max(np.abs(made.truth), axis=1))])
    middle = loudest.size // 2
    assert loudest.max() > 3 * np.median(loudest)
    assert loudest[:middle].max() == pytest.approx(loudest[middle:].max(), rel=0.1)


@pytest.fixture(scope="module")
def smoothed(made):
    return resonance.tracked(made, "smoother", 2)


def test_the_smoother_finds_the_truth_and_knows_how_well(made, smoothed):
    _, tracks, std = smoothed
    found, true = tracks[:, made.inside], made.truth[:, made.inside]
    assert resonance.error(found, true) < 0.03  # silence is 1; what the noise leaves here is about 0.02
    # were a track late by a tenth of a second, it would be this wrong on a flank
    late = np.roll(found, round(0.1 * resonance.RATE_HZ / resonance.EVERY), axis=1)
    assert resonance.error(late, true) > 0.1
    difference = found - true
    inside = np.mean(np.abs([difference.real, difference.imag]) < resonance.INSIDE * std[:, made.inside])
    # 95 % if amplitudes were the random walks of the model; that these lines rise and fall together, it does not know
    assert inside > 0.9
