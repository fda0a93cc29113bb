import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.bearings.impacts import (
    LoadZone,
    Slip,
    bearing_impacts,
    passage_revolutions,
)
from hums.gearbox.bearing_catalogue import BearingOrders

# 12 balls of 7.12 mm on 38.5 mm, 0 deg, inner ring turning: published per turn of the shaft
BALLS = 12
DIAMETERS = {"element_diameter_m": 7.12e-3, "pitch_diameter_m": 38.5e-3}
BPFO, BPFI, BSF, FTF = 4.890390, 7.109610, 2.611184, 0.407532


def rates(*, inner=1.0, outer=0.0):
    relative = inner - outer
    return BearingOrders(
        name="b",
        relative=abs(relative),
        inner_ring=inner,
        outer_ring=outer,
        inner_race=BPFI * abs(relative),
        outer_race=BPFO * abs(relative),
        rolling_element=2 * BSF * abs(relative),
        cage=abs(outer + FTF * relative),
        cage_to_outer=FTF * abs(relative),
        elements=BALLS,
    )


def strikes(kind, *, zone=None, **changes):
    settings = {"rates": rates(), "slip": Slip(slip_std=0.0), "zone": zone or LoadZone(), "span_rev": (0.0, 400.0)}
    return bearing_impacts(kind, rng=np.random.default_rng(0), **{**settings, **changes})


def test_the_cage_turns_back_where_the_outer_ring_drives():
    turning = rates(inner=0.0, outer=-1.0)
    for kind in ("outer_race", "inner_race", "rolling_element", "cage"):
        found = strikes(kind, rates=turning)
        assert np.polyfit(found.revolutions, found.cage_turns, 1)[0] == pytest.approx(-(1 - FTF), rel=3e-6)


def test_each_part_is_loaded_where_it_is():
    zone = LoadZone(distribution=0.25)  # 60 deg to either side
    # an outer race at rest: the load of its place, from psi = 30 deg of 60
    placed = strikes("outer_race", zone=zone, place_turns=30 / 360)
    load = (1 - (1 - math.cos(math.radians(30))) / (1 - math.cos(math.radians(60)))) ** 1.5
    assert_allclose(placed.weights, load, rtol=1e-12)
    # an inner race: 60 deg either way of a turn is a third of its strikes; one with the ring
    inner = strikes("inner_race", zone=zone)
    assert np.mean(inner.weights > 0) == pytest.approx(1 / 3, abs=0.01)
    line = np.abs(np.mean(inner.weights * np.exp(-2j * np.pi * inner.revolutions)))
    assert line > 0.5 * np.mean(inner.weights)
    # an element: with the cage, both races struck
    element = strikes("rolling_element", zone=zone, inner_share=0.4)
    assert_allclose(element.weights[::2], zone.share(2 * np.pi * element.cage_turns[::2]), atol=1e-12)
    assert_allclose(element.weights[1::2], 0.4 * zone.share(2 * np.pi * element.cage_turns[1::2]), atol=1e-12)
    assert_allclose(strikes("cage", zone=zone).weights, 1)


def test_the_load_zone_of_rollers_with_clearance():
    edge = math.cos(math.radians(70))
    zone = LoadZone(distribution=(1 - edge) / 2, exponent=10 / 9)
    assert_allclose(zone.share(np.radians([0, 70, -70, 120])), [1, 0, 0, 0], atol=1e-12)
    # by geometry: the deflection is d cos psi less the clearance that leaves none at 70 deg
    psi = np.radians([20, 50])
    assert_allclose(zone.share(psi), ((np.cos(psi) - edge) / (1 - edge)) ** (10 / 9), rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Slip(slip_std=0.3), "slip_std = 0.3"),
        (lambda: Slip(mean_slip=1.0), "mean_slip = 1 must be below 1"),
        (lambda: LoadZone(distribution=1.5), "distribution = 1.5 must be above 0"),
        (lambda: strikes("ball"), 'kind = "ball" is not a bearing fault'),
        (lambda: strikes("outer_race", rates=rates(inner=0.0)), "is never struck"),
        # pi 38.5 / 2 (1 - 0.0342) / 7.1096 mm
        (lambda: passage_revolutions("inner_race", rates=rates(), size_m=9e-3, **DIAMETERS), "keep it below 0.00821"),
    ],
)
def test_what_makes_no_sense_is_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()
