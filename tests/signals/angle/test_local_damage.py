"""One damaged tooth against noise, sound teeth that differ, levels that change, and impacts at random."""

import numpy as np
import pytest
from scipy import special, stats

from signals import AngularSignal
from signals.angle.local_damage import _independent, _rotated_maxima, _tail, folded, local_damage
from signals.angle.residual_energies import (
    BandEnergies,
    mesh_contrast,
    residual_energies,
    tapered_transform,
    whitened_residual,
)

TEETH, CELLS, TURNS, BANDS = 20, 40, 64, 2


def judged(turns, *, rotations=99, teeth=TEETH, seed=1):
    """Judge energies (band, turn, cell) of a gear that turns as the reference does."""
    bands, _, cells = turns.shape
    energies = BandEnergies(
        values=turns.reshape(bands, -1), samples_per_rev=float(cells), start_rev=0.0, edges=np.arange(bands + 1.0)
    )
    return local_damage(folded(energies, order=1, teeth=teeth), rotations=rotations, rng=np.random.default_rng(seed))


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


def test_one_exponential_energy_among_others_is_as_far_out_as_stated():
    # whatever its scale and what all have in common: the largest of many draws of `_tail` against their share
    rng = np.random.default_rng(12)
    for others in (10, 40):
        energy = 3 + 0.2 * rng.exponential(size=(20000, others + 1))
        one, rest = energy[:, 0], energy[:, 1:]
        mean, lowest = rest.mean(axis=1), rest.min(axis=1)
        by_spread = _tail(1 + (one - mean) / rest.std(axis=1, ddof=1), others / 2)
        by_mean = _tail((one - lowest) / (mean - lowest) * (others - 1) / others, others - 1)
        for probability in (0.1, 0.01):
            expected = probability * one.size
            # exact above the lowest, where all but one of m + 1 are: within three deviations of a binomial
            above = expected * others / (others + 1)
            assert abs(np.count_nonzero(by_mean <= probability) - above) < 3 * above**0.5
            found = np.count_nonzero(by_spread <= probability)
            assert 0.4 * expected <= found <= share_of_the_first(probability, one.size)


def test_a_tooth_of_few_stands_out_by_the_mean_though_one_other_is_large():
    # eight others, of which a large one decides the standard deviation
    others = np.array([1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.7, 4.0])
    by_spread = _tail(1 + (20 - others.mean()) / others.std(ddof=1), 4)
    scale = (others.mean() - 1) * 8 / 7
    assert _tail((20 - 1) / scale, 7) < by_spread / 5


def test_the_least_rise_is_the_one_at_which_the_tooth_is_as_improbable_as_stated():
    # the probability that one rise gives is stated as that of the least: the same rise comes back
    turns = noise(np.random.default_rng(4))
    turns[:, :, 8:10] *= 6
    turns = np.repeat(turns[:1], 2, axis=0)  # two bands alike: as high in both, as the least rise is
    found = judged(turns)
    energies = BandEnergies(
        values=turns.reshape(2, -1), samples_per_rev=float(CELLS), start_rev=0.0, edges=np.arange(3.0)
    )
    folds = folded(energies, order=1, teeth=TEETH)
    again = local_damage(folds, rotations=99, rng=np.random.default_rng(1), stated=found.local)
    assert again.least_rise == pytest.approx(found.rise, rel=0.02)  # interpolated between steps of an eighth
    strict = local_damage(folds, rotations=99, rng=np.random.default_rng(1), stated=found.local / 100)
    assert strict.least_rise > again.least_rise


def test_the_peak_has_no_share_in_what_it_is_compared_with():
    # without noise but for the second order of the turn: the others are equal, whatever the peak
    angle = 4 * np.pi * (np.arange(CELLS) + 0.5) / CELLS
    turns = np.exp(0.3 * np.cos(angle)) * np.exp(0.3 * np.random.default_rng(13).standard_normal((1, TURNS, CELLS)))
    found = []
    for factor in (10.0, 100.0):
        damaged = turns.copy()
        damaged[:, :, 20:22] *= factor
        found.append(judged(damaged).outlier)
    assert found[1] > 8 * found[0]


@pytest.mark.parametrize("tooth", [0, 7, 19])
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


def test_bands_in_which_sound_teeth_differ_alike_count_as_one():
    # four copies of one band say no more than the band; four independent ones of the same size do
    rng = np.random.default_rng(22)
    one = (0.2 + np.repeat(rng.exponential(size=TEETH), 2)) * rng.exponential(size=(1, TURNS, CELLS)).mean(axis=0)
    one = one * np.exp(0.05 * rng.standard_normal((1, TURNS, CELLS)))
    one[:, :, 10:12] *= 8
    alone, copies = judged(one).local, judged(np.repeat(one, 4, axis=0)).local
    assert alone / 4 < copies < 16 * alone  # a factor for either of two tests, and one for the number of bands
    other = np.repeat(one, 4, axis=0)
    for band in range(1, 4):
        order = rng.permutation(np.r_[0:5, 6:TEETH])
        for to, of in zip(np.r_[0:5, 6:TEETH], order, strict=True):
            other[band, :, 2 * to : 2 * to + 2] = one[0, :, 2 * of : 2 * of + 2]
    assert judged(other).local < copies / 10


def test_a_planet_that_meets_sun_and_ring_is_compared_with_its_sound_teeth():
    turns = noise(np.random.default_rng(23))
    turns[:, :, 4:6] *= 8
    turns[:, :, 24:26] *= 8  # half a turn later
    energies = BandEnergies(
        values=turns.reshape(BANDS, -1), samples_per_rev=float(CELLS), start_rev=0.0, edges=np.arange(BANDS + 1.0)
    )
    once, twice = (
        local_damage(
            folded(energies, order=1, teeth=TEETH, contacts=contacts), rotations=99, rng=np.random.default_rng(1)
        )
        for contacts in (1, 2)
    )
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
    given = {"order": 1, "meshes": {48.0: 2.5, 31.0: 2.5}, "lowest_order": 3.0}
    return mesh_contrast(signal, teeth=(48, 31), **given)


def test_a_modulated_mesh_tells_its_gear_from_another_of_the_shaft():
    own, other = shaft_with_two_gears(np.random.default_rng(24), bump=0.5)
    # a Gaussian of deviation s teeth has power exp(-(2 pi s u)^2) at u mesh orders off the harmonic; two orders
    # beside it are left out, and the next harmonic adds a little
    width = 2 * np.pi * 0.6
    below, all_of_it = (special.erf(width * u) for u in (0.25, 0.5))
    assert own == pytest.approx(below / (all_of_it - below), rel=0.25)
    assert other < own / 3


def test_an_impact_favours_no_gear():
    own, other = shaft_with_two_gears(np.random.default_rng(25), bump=0.0, impact=3.0)
    assert 1 / 1.5 < own < 1.5
    assert 1 / 1.5 < other < 1.5


def test_the_level_of_a_turn_does_not_matter():
    rng = np.random.default_rng(4)
    turns = noise(rng)
    turns[0, :, 12:14] *= 3
    level = np.exp(rng.normal(0, 2, size=(1, TURNS, 1)))
    plain, changed = judged(turns), judged(turns * level)
    assert changed.outlier == pytest.approx(plain.outlier, rel=1e-6)
    assert changed.probability == pytest.approx(plain.probability, rel=1e-6)


def test_modulation_once_a_turn_is_no_tooth():
    angle = 2 * np.pi * (np.arange(CELLS) + 0.5) / CELLS
    assert judged(noise(np.random.default_rng(5)) * (1 + 0.6 * np.cos(angle)) ** 2).probability > 0.01


def test_what_all_teeth_share_is_no_tooth():
    turns = noise(np.random.default_rng(6))
    turns[:, :, ::2] *= 10
    assert judged(turns).probability > 0.01


@pytest.mark.parametrize("rate", [0.05, 0.5])
def test_impacts_at_random_are_no_tooth(rate):
    rng = np.random.default_rng(7)
    turns = noise(rng)
    for turn in np.flatnonzero(rng.random(TURNS) < rate):
        turns[:, turn, rng.integers(CELLS)] = 1e4
    assert judged(turns).probability > 0.01


def test_one_burst_of_impacts_at_one_place_is_no_tooth():
    # in an eighth of the record alone: consistency over the blocks is part of the statistic
    turns = noise(np.random.default_rng(8))
    turns[:, :8, 20:22] = 1e3
    assert judged(turns).probability > 0.01


def test_a_drop_out_changes_little():
    turns = noise(np.random.default_rng(9))
    turns[:, :, 12:14] *= 4
    whole = judged(turns)
    turns[:, 10:14] = 0.0
    assert judged(turns).outlier == pytest.approx(whole.outlier, rel=0.2)


def test_samples_left_out_leave_no_tooth():
    turns = noise(np.random.default_rng(10))
    turns[:, :, 12:14] *= 6
    energies = BandEnergies(
        values=turns.reshape(BANDS, -1), samples_per_rev=float(CELLS), start_rev=0.0, edges=np.arange(3.0)
    )
    keep = np.ones(turns.shape[1:], dtype=bool)
    keep[:, 11:15] = False
    rest = folded(energies, order=1, teeth=TEETH, keep=keep.ravel())
    assert local_damage(rest, rotations=99, rng=np.random.default_rng(0)).probability > 0.01


def test_too_few_turns_are_refused():
    with pytest.raises(ValueError, match="1 turns are too few to judge one tooth; record 2 or more"):
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
    with pytest.raises(ValueError, match="samples in a turn cannot show one tooth"):
        judged(np.ones((1, 32, 8)), teeth=4)


def test_values_equal_over_a_tooth_count_once():
    tooth = np.random.default_rng(11).standard_normal(2000)
    assert _independent(tooth, 2000, pitch=1, width=1) == 2000
    four = np.repeat(tooth, 4)
    # correlation of a boxcar of 4: 1 + 2 (3/4 + 2/4 + 1/4) = 4
    assert _independent(four, four.size, pitch=4, width=1) == pytest.approx(2000, rel=0.05)


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


def test_a_whitened_residual_of_prime_length_keeps_its_length_and_power():
    x = np.random.default_rng(16).standard_normal(8191)
    signal = AngularSignal(values=x, samples_per_rev=128, start_rev=2.0, passband_orders=56.0)
    found = whitened_residual(signal, meshes={20.0: 2.5}, edges=np.array([4.0, 30.0, 56.0]))
    assert found.values.size == 8191
    # one for each of two bands; zeros behind 8,191 samples up to 8,192 take a part of 1e-4 of it
    assert np.mean(found.values**2) == pytest.approx(2.0, rel=1e-3)


def test_nothing_above_the_shafts_is_refused():
    signal = AngularSignal(values=np.ones(640), samples_per_rev=64, start_rev=0.0, passband_orders=28.0)
    with pytest.raises(ValueError, match="lowest_order=30 is not below 28"):
        residual_energies(signal, meshes={}, lowest_order=30.0)


@pytest.mark.parametrize("cells", [30, 31])
def test_rotations_have_the_statistic_of_the_rotated_blocks(cells):
    # (width, band, block, cell); the definition, with the error of the mean from scipy
    values = np.random.default_rng(12).standard_normal((2, 3, 9, cells))
    values -= values.mean(axis=-1, keepdims=True)
    found = _rotated_maxima(list(values), 120, np.inf, np.random.default_rng(13))
    rng = np.random.default_rng(13)
    for largest in found:
        shifts = rng.integers(0, cells, size=9)
        turned = np.stack([np.roll(values[:, :, block], -shift, axis=-1) for block, shift in enumerate(shifts)], axis=2)
        error = stats.sem(turned, axis=2)
        error = np.maximum(error, np.median(error, axis=-1, keepdims=True))
        # sums in single precision: 1e-7 (1 + t^2 / n) with t up to 5 and n = 9, and some of it for each of the two sums
        assert largest == pytest.approx(np.max(turned.mean(axis=2) / error), rel=1e-6)
    assert found.size == 120


def test_rotations_stop_at_the_eighth_that_exceeds():
    values = np.random.default_rng(14).standard_normal((1, 1, 9, 31))
    every = _rotated_maxima(list(values), 400, np.inf, np.random.default_rng(15))
    observed = np.quantile(every, 0.95)
    stopped = _rotated_maxima(list(values), 400, observed, np.random.default_rng(15))
    assert np.count_nonzero(stopped >= observed) == 8
    assert stopped[-1] >= observed
    assert 99 <= stopped.size < 400
    np.testing.assert_array_equal(stopped, every[: stopped.size])


def test_a_known_transform_changes_nothing():
    x = np.random.default_rng(7).standard_normal(64 * 128)
    signal = AngularSignal(values=x, samples_per_rev=128, start_rev=0.0, passband_orders=56.0)
    left_out = {"meshes": {20.0: 2.5, 17.0: 1.0}, "lowest_order": 3.0}
    lines = tapered_transform(signal)
    known = lines.copy()
    energies = residual_energies(signal, **left_out, transform=known)
    assert np.array_equal(energies.values, residual_energies(signal, **left_out).values)
    ratios = [mesh_contrast(signal, order=1, teeth=(20, 17), **left_out, transform=one) for one in (known, None)]
    assert np.array_equal(*ratios)
    assert np.array_equal(known, lines)
