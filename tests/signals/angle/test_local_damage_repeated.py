"""A waveform that repeats at one tooth in two or three turns, against noise, impacts at random, and other shafts."""

import numpy as np
import pytest

from signals import AngularSignal
from signals.angle.local_damage import repeated_waveform

TEETH, PER_TURN, AT = 40, 4000, 1300


def probability(x, *, start_rev=0.0, **given):
    signal = AngularSignal(values=x, samples_per_rev=PER_TURN, start_rev=start_rev, passband_orders=PER_TURN / 2.5)
    position = given.pop("position_rev", AT / PER_TURN)
    return repeated_waveform(signal, order=1, teeth=TEETH, position_rev=position, **given)


def ringing(rng, *, of=60):
    """An impact with a waveform of its own."""
    return 10 * rng.normal(size=of) * np.exp(-np.arange(of) / (of / 4))


def test_impacts_at_random_in_the_same_tooth_repeat_as_seldom_as_stated():
    found = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        x, impact = rng.normal(size=2 * PER_TURN), ringing(rng)
        for turn in range(2):  # the same waveform, at the same tooth, but not at the same place of it
            at = turn * PER_TURN + AT + rng.integers(-PER_TURN // TEETH // 2, PER_TURN // TEETH // 2)
            x[at : at + impact.size] += impact
        found.append(probability(x))
    # five samples of the triangle of differences over two hundred: one in twenty of 200, of which 20 exceed in 0.1 %
    assert np.count_nonzero(np.array(found) <= 0.002) <= 20


def test_noise_alone_is_uniform():
    found = [probability(np.random.default_rng(seed).normal(size=3 * PER_TURN)) for seed in range(200)]
    assert np.count_nonzero(np.array(found) <= 0.05) <= 20  # binomial: exceeded in 0.1 %
    assert np.count_nonzero(np.array(found) <= 0.5) >= 77


@pytest.mark.parametrize("turns", [2.0, 2.4, 3.0, 3.9])
def test_a_damaged_tooth_repeats_whatever_the_record_holds_besides_whole_turns(turns):
    rng = np.random.default_rng(1)
    x, impact = rng.normal(size=int(turns * PER_TURN)), ringing(rng)
    for turn in range(int(turns)):
        x[turn * PER_TURN + AT :][: impact.size] += impact
    assert probability(x) < 2e-3
    begun = x[700:]  # in the midst of a turn: its rest is left out
    if turns - 700 / PER_TURN >= 3:
        assert probability(begun, start_rev=700 / PER_TURN) < 2e-3


def test_a_shaft_whose_turns_do_not_fit_is_no_repetition():
    rng = np.random.default_rng(2)
    x, impact = rng.normal(size=2 * PER_TURN), ringing(rng)
    for at in range(AT, x.size - impact.size, round(PER_TURN / 2.7)):
        x[at : at + impact.size] += impact
    assert probability(x) > 0.01


def test_what_is_left_out_repeats_nowhere():
    rng = np.random.default_rng(3)
    x, impact = rng.normal(size=2 * PER_TURN), ringing(rng)
    for turn in range(2):
        x[turn * PER_TURN + AT :][: impact.size] += impact
    keep = np.ones(2 * 50, dtype=bool)
    keep[[15, 16, 17, 18, 65, 66, 67, 68]] = False
    assert probability(x, keep=keep) > 0.01


def test_one_turn_is_refused():
    with pytest.raises(ValueError, match="1 gear revolutions cannot repeat; record two or more"):
        probability(np.zeros(int(1.9 * PER_TURN)))
