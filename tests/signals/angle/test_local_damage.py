"""One damaged tooth against noise, sound teeth that differ, levels that change, and impacts at random."""

from functools import partial

import numpy as np
import pytest

from signals import AngularSignal
from signals.angle.local_damage import folded, local_damage
from signals.angle.residual_energies import (
    BandEnergies,
    mesh_contrast,
    residual_energies,
    whitened_residual,
)

TEETH, CELLS, TURNS, BANDS = 20, 40, 64, 2


def judged(turns, *, teeth=TEETH, stated=10.0, **fold):
    """Judge energies (band, turn, cell) of a gear that turns as the reference does."""
    bands, _, cells = turns.shape
    energies = BandEnergies(
        values=turns.reshape(bands, -1), samples_per_rev=float(cells), start_rev=0.0, edges=np.arange(bands + 1.0)
    )
    return local_damage(folded(energies, order=1, teeth=teeth, **fold), stated=stated)


def noise(rng, *, turns=TURNS):
    """Squared envelope of Gaussian noise, by independent samples."""
    return rng.exponential(size=(BANDS, turns, CELLS))


@pytest.mark.parametrize("turns", [4, 8, TURNS])
def test_a_damaged_tooth_stands_out_more_than_noise_or_sound_teeth_that_differ(turns):
    # pitch deviations: an energy of its own for each tooth, that of two Gaussian quadratures, in every turn
    sound, damaged = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        tooth = np.repeat(rng.exponential(size=TEETH), CELLS // TEETH)
        sound += [judged(noise(rng, turns=turns)).strength, judged((1 + tooth) * noise(rng, turns=turns)).strength]
        struck = noise(rng, turns=turns)
        struck[:, :, 8:10] *= 20
        damaged.append(judged(struck).strength)
    assert max(sound) < np.quantile(damaged, 0.1)


@pytest.mark.parametrize("turns", [16, 100])
def test_nine_in_ten_teeth_of_the_least_rise_are_as_strong_as_stated(turns):
    rng = np.random.default_rng(4)
    found = []
    for _ in range(60):
        least = judged(noise(rng, turns=turns)).least_rise
        one_band = noise(rng, turns=turns)
        one_band[1, :, 8:10] *= least
        found.append(judged(one_band).strength >= 10.0)
    # of 60 at 0.9, a binomial is below 46 in one of a thousand
    assert sum(found) >= 46
    # and the statement is not idle: a quarter of that rise is not enough
    halved = noise(rng, turns=turns)
    halved[1, :, 8:10] *= 1 + (least - 1) / 4
    assert judged(halved).strength < 10.0


@pytest.mark.parametrize("tooth", [0, 19])
def test_one_damaged_tooth_is_found_where_it_is(tooth):
    turns = noise(np.random.default_rng(3))
    turns[1, :, 2 * tooth : 2 * tooth + 2] *= 8
    found = judged(turns)
    assert found.strength > 8
    assert found.band == 1
    assert abs((found.position_rev * TEETH - tooth - 0.5 + TEETH / 2) % TEETH - TEETH / 2) < 0.6
    assert 4 < found.rise < 8  # the floor of the logarithm and the projection lower it


def test_a_planet_that_meets_sun_and_ring_is_compared_with_its_sound_teeth():
    turns = noise(np.random.default_rng(23))
    turns[:, :, 4:6] *= 8
    turns[:, :, 24:26] *= 8  # half a turn later
    once, twice = (judged(turns, contacts=contacts) for contacts in (1, 2))
    assert twice.strength > 3 * once.strength


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
    assert changed.strength == pytest.approx(plain.strength, rel=1e-6)


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
    """At one place, in an eighth of the record alone: the standard error over blocks is part of the scatter."""
    turns[:, :8, 20:22] = 1e3


@pytest.mark.parametrize(
    "raise_energy", [modulated, shared, partial(struck, rate=0.05), partial(struck, rate=0.5), burst]
)
def test_what_is_no_tooth(raise_energy):
    turns = noise(np.random.default_rng(5))
    raise_energy(turns)
    assert judged(turns).strength < 6


def test_a_drop_out_changes_little():
    turns = noise(np.random.default_rng(9))
    turns[:, :, 12:14] *= 4
    whole = judged(turns)
    turns[:, 10:14] = 0.0
    assert judged(turns).strength == pytest.approx(whole.strength, rel=0.2)


def test_energies_that_do_not_scatter_show_no_tooth():
    assert judged(np.ones((BANDS, TURNS, CELLS))).strength == pytest.approx(0.0, abs=1e-9)


def test_samples_left_out_leave_no_tooth():
    turns = noise(np.random.default_rng(10))
    turns[:, :, 12:14] *= 6
    keep = np.ones(turns.shape[1:], dtype=bool)
    keep[:, 11:15] = False
    assert judged(turns, keep=keep.ravel()).strength < 6


def test_too_few_turns_are_refused():
    with pytest.raises(ValueError, match="3 gear revolutions are too few to judge one tooth; record 4 or more"):
        judged(noise(np.random.default_rng(0), turns=3))


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
