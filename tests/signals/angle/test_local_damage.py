"""One damaged tooth against noise, sound teeth that differ, levels that change, and impacts at random."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

from signals import AngularSignal
from signals.angle.local_damage import folded, local_damage
from signals.angle.residual_energies import (
    BandEnergies,
    mesh_contrast,
    residual_energies,
    whitened_residual,
)

TEETH, CELLS, TURNS, BANDS = 20, 40, 64, 2


def judged(turns, *, rotations=99, teeth=TEETH, seed=1, stated=None, **fold):
    """Judge energies (band, turn, cell) of a gear that turns as the reference does."""
    bands, _, cells = turns.shape
    energies = BandEnergies(
        values=turns.reshape(bands, -1), samples_per_rev=float(cells), start_rev=0.0, edges=np.arange(bands + 1.0)
    )
    folds, more = folded(energies, order=1, teeth=teeth, **fold), {} if stated is None else {"stated": stated}
    return local_damage(folds, rotations=rotations, rng=np.random.default_rng(seed), **more)


def noise(rng, *, turns=TURNS):
    """Squared envelope of Gaussian noise, by independent samples."""
    return rng.exponential(size=(BANDS, turns, CELLS))


def share_of_the_first(probability, trials):
    """Most of `trials` that a test of that probability names, but for one time in a thousand."""
    return stats.binom.ppf(0.999, trials, probability)


def test_noise_is_named_as_often_as_stated():
    found = [judged(noise(np.random.default_rng(seed))).probability for seed in range(40)]
    assert np.count_nonzero(np.array(found) <= 0.1) <= share_of_the_first(0.1, 40)


@pytest.mark.parametrize("level", [0.05, 1.0])
def test_sound_teeth_that_differ_and_repeat_are_named_as_seldom(level):
    # pitch deviations: an energy of its own for each tooth, that of two Gaussian quadratures, in every turn
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        tooth = np.repeat(rng.exponential(size=TEETH), CELLS // TEETH)
        found.append(judged((level + tooth) * noise(rng)))
    assert np.median([one.repeats for one in found]) <= 0.01
    assert np.count_nonzero([one.probability <= 0.1 for one in found]) <= share_of_the_first(0.1, 30)


def test_pits_on_several_teeth_differ_and_noise_does_not():
    # of noise one gear in a hundred seems to: a binomial of 40 exceeds 3 in one of a thousand
    sound = [judged(noise(np.random.default_rng(seed))) for seed in range(40)]
    assert np.count_nonzero([one.differing <= 0.01 for one in sound]) <= share_of_the_first(0.01, 40)
    pitted = noise(np.random.default_rng(3))
    for tooth in (2, 3, 5):
        pitted[:, :, 2 * tooth : 2 * tooth + 2] *= 3
    assert judged(pitted).differing == 0.01  # none of 99 rotations is as alike


def test_the_least_rise_is_the_one_at_which_the_tooth_is_as_improbable_as_stated():
    # the probability that one rise gives is stated as that of the least: the same rise comes back
    turns = noise(np.random.default_rng(4))
    turns[:, :, 8:10] *= 6
    turns = turns[:1]  # the least rise is that in one band
    found = judged(turns)
    again, strict = (judged(turns, stated=found.local / part) for part in (1, 100))
    assert again.least_rise == pytest.approx(found.rise, rel=0.02)  # interpolated between steps of an eighth
    assert strict.least_rise > again.least_rise


@pytest.mark.parametrize("tooth", [0, 19])
def test_one_damaged_tooth_is_found_where_it_is(tooth):
    turns = noise(np.random.default_rng(3))
    turns[1, :, 2 * tooth : 2 * tooth + 2] *= 8
    found = judged(turns, rotations=999)
    assert found.probability <= 0.001
    assert found.band == 1
    assert abs((found.position_rev * TEETH - tooth - 0.5 + TEETH / 2) % TEETH - TEETH / 2) < 0.6
    assert found.width_rev <= 2 / TEETH
    assert 4 < found.rise < 8  # the floor of the logarithm and the projection lower it


def test_a_tooth_that_repeats_in_one_band_may_stand_out_in_another():
    # band 0: certain to repeat at tooth 7, as others do; band 1: a tooth far out, but in every sixteenth turn alone
    rng = np.random.default_rng(21)
    turns = noise(rng)
    turns[0] *= 0.3 + np.repeat(rng.uniform(size=TEETH), CELLS // TEETH)
    turns[0, :, 14:16] *= 5
    turns[1, ::16, 14:16] *= 1e8
    both, alone = judged(turns, rotations=199), judged(turns[1:], rotations=199)
    assert (both.band, both.repeats) == (1, 0.005)
    assert both.local < 1e-3
    assert alone.probability > 0.1


def test_a_planet_that_meets_sun_and_ring_is_compared_with_its_sound_teeth():
    turns = noise(np.random.default_rng(23))
    turns[:, :, 4:6] *= 8
    turns[:, :, 24:26] *= 8  # half a turn later
    once, twice = (judged(turns, contacts=contacts) for contacts in (1, 2))
    assert twice.outlier > 3 * once.outlier
    assert twice.local < 1e-3 < once.local


def shaft_with_two_gears(rng, *, bump, impact=0.0):
    """64 turns of a shaft with gears of 48 and 31 teeth, a bump of a tooth in the mesh of the first, and an impact."""
    turn = np.arange(64 * 512) / 512
    apart = (turn + 0.5) % 1 - 0.5
    x = (1 - bump * np.exp(-0.5 * (apart * 48 / 0.6) ** 2)) * sum(
        np.cos(2 * np.pi * 48 * k * turn + k) / k for k in (1, 2, 3)
    )
    x += sum(np.cos(2 * np.pi * 31 * k * turn) / k for k in (1, 2, 3)) + 0.1 * rng.standard_normal(turn.size)
    x += impact * np.exp(-((apart * 600) ** 2))  # as short as no tooth's: as strong in all orders
    signal = AngularSignal(values=x, samples_per_rev=512, start_rev=0.0, passband_orders=200.0)
    white = whitened_residual(signal, meshes={48.0: 2.5, 31.0: 2.5}, edges=np.array([3.0, 200.0]))
    return [mesh_contrast(white, order=1, teeth=teeth, position_rev=0.0) for teeth in (48, 31)]


def test_a_modulated_mesh_tells_its_gear_from_another_of_the_shaft():
    # a Gaussian of deviation 0.6 teeth has 15 dB less power at half a mesh order from a harmonic than beside it
    own, other = shaft_with_two_gears(np.random.default_rng(24), bump=0.5)
    assert own > 1.5
    assert other < 1.0


def test_an_impact_modulates_no_mesh():
    # as strong in all orders, of which those that stand beside the harmonics are left out
    assert max(shaft_with_two_gears(np.random.default_rng(25), bump=0.0, impact=3.0)) < 1.0


def test_the_level_of_a_turn_does_not_matter():
    rng = np.random.default_rng(4)
    turns = noise(rng)
    turns[0, :, 12:14] *= 3
    level = np.exp(rng.normal(0, 2, size=(1, TURNS, 1)))
    plain, changed = judged(turns), judged(turns * level)
    assert changed.outlier == pytest.approx(plain.outlier, rel=1e-6)
    assert changed.probability == pytest.approx(plain.probability, rel=1e-6)


def modulated(turns):
    """By a part of itself once a turn."""
    turns *= (1 + 0.6 * np.cos(2 * np.pi * (np.arange(CELLS) + 0.5) / CELLS)) ** 2


def shared(turns):
    """By all teeth."""
    turns[:, :, ::2] *= 10


def struck(turns, rate):
    """In turns and at places at random."""
    rng = np.random.default_rng(7)
    for turn in np.flatnonzero(rng.random(TURNS) < rate):
        turns[:, turn, rng.integers(CELLS)] = 1e4


def burst(turns):
    """At one place, in an eighth of the record alone: consistency over the blocks is part of the statistic."""
    turns[:, :8, 20:22] = 1e3


@pytest.mark.parametrize(
    "raise_energy", [modulated, shared, partial(struck, rate=0.05), partial(struck, rate=0.5), burst]
)
def test_what_is_no_tooth(raise_energy):
    turns = noise(np.random.default_rng(5))
    raise_energy(turns)
    assert judged(turns).probability > 0.01


def test_a_drop_out_changes_little():
    turns = noise(np.random.default_rng(9))
    turns[:, :, 12:14] *= 4
    whole = judged(turns)
    turns[:, 10:14] = 0.0
    assert judged(turns).outlier == pytest.approx(whole.outlier, rel=0.2)


def test_energies_that_do_not_scatter_show_no_tooth():
    found = judged(np.ones((BANDS, TURNS, CELLS)))
    assert (found.local, found.outlier) == (1.0, 0.0)


def test_samples_left_out_leave_no_tooth():
    turns = noise(np.random.default_rng(10))
    turns[:, :, 12:14] *= 6
    keep = np.ones(turns.shape[1:], dtype=bool)
    keep[:, 11:15] = False
    assert judged(turns, keep=keep.ravel()).probability > 0.01


def test_too_few_turns_are_refused():
    with pytest.raises(ValueError, match="1 gear revolutions are too few to judge one tooth; record 2 or more"):
        judged(noise(np.random.default_rng(0), turns=1))


@pytest.mark.parametrize("turns", [2, 3])
def test_turns_too_few_to_be_rotated_show_where_a_tooth_stands_out_and_not_that_it_repeats(turns):
    damaged = noise(np.random.default_rng(15), turns=turns)
    damaged[:, :, 12:14] *= 100
    found = judged(damaged)
    assert found.repeats == found.differing == 1.0
    assert found.local < 0.01
    assert found.position_rev == pytest.approx(13 / CELLS, abs=0.5 / TEETH)


@pytest.mark.parametrize("turns", [4, 7])
def test_few_turns_repeat_by_chance_as_seldom_as_stated(turns):
    # a permutation test is exact for any number of blocks: 5 % of 200, of which a binomial exceeds 20 in 0.1 %
    rng = np.random.default_rng(14)
    found = [judged(noise(rng, turns=turns), rotations=99).repeats <= 0.05 for _ in range(200)]
    assert sum(found) <= 20
    damaged = noise(rng, turns=turns)
    damaged[:, :, 12:14] *= 30
    assert judged(damaged, rotations=999).repeats <= 0.01


def test_too_few_samples_in_a_turn_are_refused():
    with pytest.raises(ValueError, match="samples per gear revolution cannot resolve a tooth"):
        judged(np.ones((1, 32, 8)), teeth=4)


@pytest.mark.parametrize("samples", [64 * 128, 8191])  # the second is prime: its transform has zeros behind it
def test_a_tone_beside_the_mesh_keeps_its_amplitude(samples):
    rev = np.arange(samples) / 128
    x = np.cos(2 * np.pi * 20 * rev) + 0.3 * np.cos(2 * np.pi * 27.25 * rev)
    signal = AngularSignal(values=x, samples_per_rev=128, start_rev=2.0, passband_orders=56.0)
    found = residual_energies(signal, meshes={20.0: 2.5}, lowest_order=3.0, bands=4)
    band = int(np.searchsorted(found.edges, 27.25)) - 1
    middle = slice(found.values.shape[1] // 4, -found.values.shape[1] // 4)  # away from the tapered ends
    assert found.values[band, middle] == pytest.approx(0.3**2, rel=0.02)  # whose sidebands the mesh takes along
    assert np.delete(found.values, band, axis=0)[:, middle].max() < 1e-3 * 0.3**2
    assert found.values.shape[1] / found.samples_per_rev == pytest.approx(samples / 128, abs=1 / found.samples_per_rev)


def test_nothing_above_the_shafts_is_refused():
    signal = AngularSignal(values=np.ones(640), samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    with pytest.raises(ValueError, match="lowest_order=30 is not below 28"):
        residual_energies(signal, meshes={}, lowest_order=30.0)
