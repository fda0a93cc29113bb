"""A line that follows the shaft, and one that follows the clock, while the speed wanders, stands, or runs up."""

import numpy as np
import pytest

from signals.demodulation.time_or_angle import power_in_time_and_angle

RATE_HZ, SPEED_HZ, ORDER = 800.0, 20.0, 3.3
TIMES_S = np.arange(8000) / RATE_HZ


def wandering(share, seed=1):
    """Return revolutions of a shaft whose speed wanders within a second by a share of it."""
    steps = np.random.default_rng(seed).standard_normal(TIMES_S.size)
    slow = np.exp(-np.arange(4000) / RATE_HZ)
    speed = np.convolve(steps, slow)[: TIMES_S.size]
    return np.cumsum(SPEED_HZ * (1 + share * speed / speed.std())) / RATE_HZ


def struck(cycles, noise=0.5):
    """Return an envelope of strikes, one a cycle, in noise."""
    comb = sum(np.cos(2 * np.pi * k * cycles) / k for k in (1, 2, 3))
    return 1 + 0.3 * comb + noise * np.abs(np.random.default_rng(2).standard_normal(TIMES_S.size))


def power(envelope, turns):
    return power_in_time_and_angle(envelope, rate_hz=RATE_HZ, revolutions=turns, order=ORDER)


def ratio(envelope, turns):
    found = power(envelope, turns)
    return found.in_time / found.in_angle, found.frequency_hz


@pytest.mark.parametrize("share", [0.002, 0.005])
@pytest.mark.parametrize("off", [0.0, 0.004])
def test_another_machine_follows_the_clock(share, off):
    hz = ORDER * SPEED_HZ * (1 + off * share / 0.005)
    found, frequency_hz = ratio(struck(hz * TIMES_S), wandering(share))
    assert found > 1.5
    assert frequency_hz == pytest.approx(hz, abs=0.02)
    of = power(struck(hz * TIMES_S), wandering(share))
    assert of.left_in_angle == pytest.approx(of.in_angle, rel=0.3)


@pytest.mark.parametrize("share", [0.002, 0.005])
@pytest.mark.parametrize("slip", [0.0, 0.002])
def test_a_part_follows_the_shaft(share, slip):
    turns = wandering(share)
    strayed = slip * np.cumsum(np.random.default_rng(3).standard_normal(TIMES_S.size))  # cycles, of each strike
    found, _ = ratio(struck(ORDER * turns + strayed), turns)
    assert found < 0.8


def test_a_load_that_steps_is_no_line():
    turns, level = wandering(0.003), np.where(TIMES_S > 4, 3.0, 1.0)
    for cycles in (ORDER * turns, ORDER * SPEED_HZ * TIMES_S):
        plain, stepped = (ratio(struck(cycles) * gain, turns)[0] for gain in (1.0, level))
        assert stepped == pytest.approx(plain, rel=0.1)


def test_another_machine_is_a_line_at_each_of_two_speeds():
    turns = np.cumsum(np.where(TIMES_S < 5.5, 17.0, 23.0)) / RATE_HZ
    others = power(struck(17.0 * ORDER * TIMES_S), turns)  # in angle at 3.3 orders until 5.5 s
    assert others.in_time > 2 * others.in_angle
    assert others.left_in_angle == pytest.approx(others.in_angle, rel=0.1)
    assert others.frequency_hz == pytest.approx(17.0 * ORDER, abs=0.02)
    own, _ = ratio(struck(ORDER * turns), turns)  # and what follows the shaft, in time, at 56 Hz until then
    assert own < 0.5
    # a larger line of another machine in between, at no speed of the shaft, is none of the part's
    between = struck(ORDER * turns) + np.cos(2 * np.pi * 20.0 * ORDER * TIMES_S)
    beside = power(between, turns)
    assert beside.in_time > 1.5 * beside.in_angle
    assert beside.left_in_angle < 0.1 * beside.in_angle


def test_a_gap_is_no_line():
    turns = wandering(0.005)
    whole, gap = struck(ORDER * turns), (TIMES_S > 2) & (TIMES_S < 3)
    noise = 1e-6 * np.random.default_rng(4).standard_normal(TIMES_S.size)
    cut = power(np.where(gap, noise, whole), turns)
    assert cut.in_angle == pytest.approx(power(whole, turns).in_angle, rel=0.4)  # a tenth is lost
    assert cut.in_time < 0.8 * cut.in_angle


def test_a_run_up_is_too_far():
    turns = 10 * TIMES_S + 1.8 * TIMES_S**2
    found = power(struck(ORDER * turns), turns)
    assert np.isnan(found[1:]).all()
    assert found.in_angle > 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"revolutions": TIMES_S[:-1]}, "give 8000 rising ones"),
        ({"revolutions": 0 * TIMES_S}, "rising ones, one for each sample"),
        ({"envelope": TIMES_S[:500], "revolutions": TIMES_S[:500]}, "500 values; at least 512"),
    ],
)
def test_what_is_refused(change, said):
    given = {"envelope": 1 + TIMES_S, "rate_hz": RATE_HZ, "revolutions": TIMES_S, "order": ORDER} | change
    with pytest.raises(ValueError, match=said):
        power_in_time_and_angle(given.pop("envelope"), **given)
