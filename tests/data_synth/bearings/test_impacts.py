import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.bearings.impacts import (
    LoadZone,
    Slip,
    bearing_impacts,
    passage_revolutions,
    renewal_process,
)
from data_synth.scene.machine_faults import BearingFault
from hums.gearbox.bearing_catalogue import BearingOrders

# 12 balls of 7.12 mm on 38.5 mm, 0 deg, inner ring turning: published per turn of the shaft
D, PITCH, BALLS = 7.12e-3, 38.5e-3, 12
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


def strikes(kind, *, slip=None, zone=None, span=(0.0, 400.0), seed=0, **changes):
    given = changes.pop("rates", rates())
    return bearing_impacts(
        kind,
        rates=given,
        slip=slip or Slip(slip_std=0.0),
        zone=zone or LoadZone(),
        span_rev=span,
        rng=np.random.default_rng(seed),
        **changes,
    )


def fault(**changes):
    return BearingFault(**{"kind": "inner_race", "component": "input bearing", "size_mm": 1.0, **changes})


def impact_revolutions(*, order, fault, span_rev, rng):
    knots, first = renewal_process(order=order, slip=fault, span_rev=span_rev, rng=rng)
    assert first == -1
    return knots[1:-1]


def test_without_slip_impacts_are_evenly_spaced():
    struck = impact_revolutions(order=5.5, fault=fault(slip_std=0.0), span_rev=(-1, 99), rng=np.random.default_rng(0))
    assert_allclose(np.diff(struck), 1 / 5.5, rtol=1e-10)
    assert struck[0] + 1 < 1 / 5.5
    assert 99 - struck[-1] < 1 / 5.5


def test_slip_accumulates_as_a_random_walk():
    # the n-th impact after the first scatters by sigma sqrt(n) intervals: variance grows in proportion to n
    sigma, order, trains = 0.02, 4.0, 600
    rng = np.random.default_rng(1)
    lags = np.array([1, 16, 256])
    late = []
    for _ in range(trains):
        struck = impact_revolutions(order=order, fault=fault(slip_std=sigma), span_rev=(0, 80), rng=rng)
        late.append((struck[lags] - struck[0]) * order - lags)
    variance = np.mean(np.square(late), axis=0)
    # a variance of 600 normal errors is known to sqrt(2 / 600) = 6 %; 4 of that
    assert_allclose(variance, sigma**2 * lags, rtol=0.24)


@pytest.mark.parametrize("mean_slip", [0.0, 0.05])
def test_the_mean_rate_is_that_of_rolling_less_the_slip(mean_slip):
    given = fault(mean_slip=mean_slip, slip_std=0.01)
    struck = impact_revolutions(order=3.6, fault=given, span_rev=(0, 5000), rng=np.random.default_rng(2))
    # 18000 intervals of 1 %: their mean is known to 0.01 / sqrt(18000) = 7.5e-5; 4 of that
    assert_allclose(1 / np.mean(np.diff(struck)), 3.6 * (1 - mean_slip), rtol=3e-4)


def test_the_load_zone_is_as_wide_as_its_factor_says():
    angle = np.radians([0, 60, 90, 180])
    assert_allclose(LoadZone(distribution=0.5).share(angle), [1, 0.5**1.5, 0, 0], atol=1e-12)
    assert_allclose(LoadZone(distribution=1.0).share(angle), [1, 0.75**1.5, 0.5**1.5, 0], atol=1e-12)


@pytest.mark.parametrize(("line", "expected"), [(5, 40.54), (10, 10.165), (20, 2.663)])
def test_lines_melt_as_renewal_theory_says(line, expected):
    # spectral density of renewal impacts over their rate: coth((2 pi k sigma)^2 / 4), sigma = 1 %
    trains, kept = 1500, 2000
    rng, slip = np.random.default_rng(3), Slip(slip_std=0.01)
    power = np.empty(trains)
    for number in range(trains):
        struck = impact_revolutions(order=1.0, fault=slip, span_rev=(0, kept), rng=rng)
        power[number] = np.abs(np.sum(np.exp(-2j * np.pi * line * struck))) ** 2 / struck.size
    # 1500 values of a chi-square with two degrees of freedom: 2.6 %, 4 of that. A train of 2000 is too short by
    # (expected / 2000) of itself for the line it resolves: 2 % at most
    assert np.mean(power) == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize(
    ("kind", "rate"),
    [("outer_race", BPFO), ("inner_race", BPFI), ("rolling_element", 2 * BSF), ("cage", FTF)],
)
def test_the_cage_turns_as_pure_rolling_says(kind, rate):
    found = strikes(kind)
    assert found.rate == pytest.approx(rate, rel=1e-9)
    # the published rates have seven digits
    slope = np.polyfit(found.revolutions, found.cage_turns, 1)[0]
    assert slope == pytest.approx(FTF, rel=3e-6)


def test_the_cage_turns_back_where_the_outer_ring_drives():
    turning = rates(inner=0.0, outer=-1.0)
    for kind in ("outer_race", "inner_race", "rolling_element", "cage"):
        found = strikes(kind, rates=turning)
        assert np.polyfit(found.revolutions, found.cage_turns, 1)[0] == pytest.approx(-(1 - FTF), rel=3e-6)


def test_the_true_cage_follows_the_slip():
    slip = Slip(mean_slip=0.02, slip_std=0.01)
    found = strikes("outer_race", slip=slip, span=(0, 3000))
    assert_allclose(np.diff(found.cage_turns), 1 / BALLS, rtol=1e-9)  # one ball after the other, whenever
    # 14000 intervals of 1 %: 8.5e-5; 4 of that
    assert found.rate == pytest.approx(0.98 * BPFO, rel=3.4e-4)


def test_same_seed_same_bytes():
    for kind in ("outer_race", "rolling_element"):
        first, again, other = (strikes(kind, slip=Slip(), seed=seed) for seed in (7, 7, 8))
        for part in ("revolutions", "weights", "cage_turns"):
            assert getattr(first, part).tobytes() == getattr(again, part).tobytes()
        assert first.revolutions.tobytes() != other.revolutions.tobytes()


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


def test_a_spall_is_passed_at_the_speed_of_the_contact():
    turned = passage_revolutions("inner_race", rates=rates(), size_m=1e-3, pitch_diameter_m=PITCH, element_diameter_m=D)
    # the contact runs on the outer race with the cage, on the inner with ring less cage, on the ball with its spin;
    # the published rates have six digits behind the point
    assert turned == pytest.approx(1e-3 / (math.pi * (PITCH + D) * FTF), rel=2e-6)
    assert turned == pytest.approx(1e-3 / (math.pi * (PITCH - D) * (1 - FTF)), rel=2e-6)
    assert turned == pytest.approx(1e-3 / (math.pi * D * BSF), rel=2e-6)
    with pytest.raises(ValueError, match=r"keep it below 0.00821"):  # pi 38.5 / 2 (1 - 0.0342) / 7.1096 mm
        passage_revolutions("inner_race", rates=rates(), size_m=9e-3, pitch_diameter_m=PITCH, element_diameter_m=D)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Slip(slip_std=0.3), "slip_std = 0.3"),
        (lambda: Slip(mean_slip=1.0), "mean_slip = 1 must be below 1"),
        (lambda: LoadZone(distribution=1.5), "distribution = 1.5 must be above 0"),
        (lambda: strikes("ball"), 'kind = "ball" is not a bearing fault'),
        (lambda: strikes("outer_race", rates=rates(inner=0.0)), "is never struck"),
    ],
)
def test_what_makes_no_sense_is_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()
