from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.kinematic.gear_faults import SIDEBAND_CUTOFF, damage_trains, gear_damage_family
from data_synth.kinematic.harmonics import HarmonicFamily
from data_synth.scene.faults import (
    DIMENSIONS,
    FAULT_KINDS,
    Chipping,
    Eccentricity,
    FaultyGear,
    Misalignment,
    MissingTooth,
    Pitting,
    Spall,
    ToothCrack,
    Wear,
    von_mises_window,
)

TEETH = 23
MESH = np.array([0.5, 0.3j, -0.2]) * np.exp(0.4j)
REV = np.arange(4096) / 4096
GEAR = FaultyGear(teeth=TEETH, face_width_m=0.02, rng=lambda: np.random.default_rng(2))


def declared(model, **fields):
    """Return a fault of the pinion, a millimetre large."""
    kind = model.model_fields["kind"].annotation.__args__[0]
    size = {"depth_mm": 1.0} if model is ToothCrack else {"size_mm": 1.0}
    return model(**{"kind": kind, "component": "stage 1/pinion", **size, **fields})


CRACK, WEAR = declared(ToothCrack), declared(Wear)
LOCAL = {
    "crack": CRACK,
    "spall": declared(Spall),
    "chipping": declared(Chipping),
    "missing tooth": declared(MissingTooth),
}
ROUND = {
    "eccentricity": declared(Eccentricity),
    "misalignment": declared(Misalignment),
    "wear": WEAR,
}
PITTED = {"pitting": declared(Pitting, count=3, spread=6)}
ALL = LOCAL | ROUND | PITTED


def mesh(base_order=TEETH):
    return HarmonicFamily(
        component="stage 1",
        kind="gear_mesh",
        source="stage 1",
        base_order=Fraction(base_order),
        coefficients=MESH,
        load_dependent=True,
    )


def comb_of(fault, *, rise=0.3, lag_rad=0.2, offset=0.15, **changes):
    whole, tooth = changes.get("mesh", mesh()), Fraction(changes.get("tooth", 1))
    return gear_damage_family(
        fault,
        gear=replace(GEAR, teeth=float(whole.base_order / tooth)),
        mesh=whole,
        tooth=tooth,
        offset=offset,
        rise=rise,
        lag_rad=lag_rad,
    )


def signal_of(family):
    """One turn of the gear, line by line."""
    waves = np.exp(2j * np.pi * np.outer([float(order) for order in family.orders], REV))
    return (family.coefficients @ waves).real


@pytest.mark.parametrize("name", ALL)
def test_faulty_less_healthy_is_the_modulation_and_nothing_else(name):
    damage, family = ALL[name], comb_of(ALL[name])
    shape = damage.modulation(REV + 0.15, GEAR)
    change = np.zeros(REV.size)
    for h, value in enumerate(MESH, start=1):
        share = float(damage.harmonic_weights(h))
        modulation = (1 + 0.3 * share * shape) * np.exp(-0.2j * h * shape) - 1
        change += (value * modulation * np.exp(2j * np.pi * TEETH * h * REV)).real
    change -= change.mean()  # the line at order zero is left out
    largest = np.max(np.abs(family.coefficients))
    # each line left out is below the cutoff, and the shapes have some 4 / finest of them on either side of a harmonic
    left_out = 3 * 2 * 4 * TEETH / min(damage.width_pitches(), 1) * SIDEBAND_CUTOFF * largest
    assert_allclose(signal_of(family), change, atol=left_out)
    assert np.max(np.abs(change)) > 20 * left_out or name in ("spall", "pitting")
    assert np.max(np.abs(change)) > 2 * left_out
    assert np.max(np.abs(shape)) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("name", LOCAL)
def test_damage_of_one_tooth_is_heard_while_it_is_in_mesh(name):
    far = np.abs((REV + 0.15 + 0.5) % 1 - 0.5) > 2 / TEETH
    family = comb_of(LOCAL[name], rise=0.5, lag_rad=0.0)
    signal = signal_of(family)
    signal -= np.mean(signal[far])  # what its line at order zero would be, which no accelerometer passes
    assert np.sum(signal[~far] ** 2) > 0.999 * np.sum(signal**2)
    assert np.max(np.abs(signal[far])) < 0.02 * np.max(np.abs(signal))


@pytest.mark.parametrize(("name", "spacings"), [("eccentricity", {1}), ("misalignment", {1, 2}), ("wear", {0})])
def test_damage_all_round_has_the_sidebands_of_its_swing(name, spacings):
    # by amplitude alone, so each swing makes one pair
    family = comb_of(ROUND[name], rise=0.3, lag_rad=0.0)
    at = np.flatnonzero(family.coefficients) + 1
    assert {int(min(abs(order - h * TEETH) for h in (1, 2, 3))) for order in at} == spacings
    assert ROUND[name].impacts(GEAR) == ()


def test_wear_raises_high_harmonics_more():
    family = comb_of(WEAR, rise=0.1, lag_rad=0.0)
    lines = family.coefficients[[TEETH - 1, 2 * TEETH - 1, 3 * TEETH - 1]]
    assert_allclose(lines, MESH * 0.1 * [1, 2, 3], rtol=1e-12)


@pytest.mark.parametrize("span", [(-3, 5), (-2.5, 5.25), (-2.75, 4.75), (0, 2), (0.25, 0.5), (-2.625, -2.625)])
@pytest.mark.parametrize("offset", [Fraction(0), Fraction(1, 4), Fraction(5, 16)])
@pytest.mark.parametrize(
    ("damage", "places"),
    [
        (CRACK, [0.0]),
        (LOCAL["missing tooth"], [0.5]),
        (declared(Spall, length_pitches=0.5), [-0.25, 0.25]),
        (PITTED["pitting"], [place for place, _ in PITTED["pitting"].pits(replace(GEAR, teeth=16))]),
    ],
)
def test_a_record_has_the_strikes_between_its_ends_and_those_at_them(span, offset, damage, places):
    # sixteenths of a turn and eighths of a revolution are exact in binary, so a strike at an end is one at it
    tooth, teeth = Fraction(1, 2), 16
    gear = replace(GEAR, teeth=teeth)
    trains = damage_trains(damage, gear=gear, source="s", tooth=tooth, offset=float(offset), span_rev=span)
    assert len(trains) == len(places)
    first, last = map(Fraction, span)
    for train, place in zip(trains, places, strict=True):
        # the revolutions at which the gear has made n turns, its place counted; among enough of them
        struck = [(n + Fraction(place) / teeth - offset) / tooth for n in range(-20, 20)]
        expected = [float(rev) for rev in struck if first <= rev <= last]
        assert train.revolutions.tolist() == expected
        assert train.amplitudes.size == len(expected)


def test_a_chip_takes_its_share_of_the_face_and_misalignment_as_much_on_the_worst_tooth():
    assert LOCAL["chipping"].damage(0.005, GEAR).contact_fraction[0] == 0.75
    lean = ROUND["misalignment"].damage(0.005, replace(GEAR, teeth=360)).contact_fraction
    assert lean[0] == pytest.approx(0.75)
    assert np.all((lean >= 0.75) & (lean <= 1))


def test_drawn_pits_lie_among_neighbours():
    pitting = declared(Pitting, count=4, spread=6)
    pits = pitting.pits(GEAR)
    assert pits == pitting.pits(GEAR)
    places, shares = zip(*pits, strict=True)
    assert places[0] == 0
    assert len(set(places)) == 4
    assert max(places) <= 5
    assert shares[0] == max(shares)
    assert min(shares) >= 0.5


def test_the_window_is_half_at_half_its_width():
    assert_allclose(von_mises_window([0, 0.02, -0.02, 1.02], width_turns=0.04), [1, 0.5, 0.5, 0.5], rtol=1e-12)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ValueError, match="face width is not declared; give face_width_mm"):
        LOCAL["chipping"].damage(1e-3, replace(GEAR, face_width_m=None))
    with pytest.raises(ValueError, match="count = 4 pitted teeth do not fit"):
        declared(Pitting, count=4, spread=3)
    with pytest.raises(ValueError, match="count"):
        declared(Wear, count=4)
    with pytest.raises(ValueError, match="impact_per_mm applies to damaged teeth, not to a whole gear"):
        declared(Wear, impact_per_mm=0.5)
    # on a gear of few teeth pits come round
    few = replace(GEAR, teeth=3)
    assert np.count_nonzero(PITTED["pitting"].damage(2.0, few).removed_m) <= 3


def test_the_page_on_scenes_states_the_size_of_every_kind():
    page = (Path(__file__).parents[3] / "docs" / "scenes.md").read_text(encoding="utf-8")
    table = page.split("## Faults")[1]
    assert set(DIMENSIONS) == set(FAULT_KINDS)
    for kind, words in DIMENSIONS.items():
        assert f" | {words} | " in table.split(f"| `{kind}` |")[1].splitlines()[0], kind
