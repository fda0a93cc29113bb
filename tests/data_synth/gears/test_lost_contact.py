"""Contact that pairs of teeth lose, against involutes drawn point by point, statics and limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from data_synth.gears.geometry import GearPair
from data_synth.gears.lost_contact import (
    FlankModification,
    LoadSharing,
    LostContact,
    separation_m,
    spall_gap,
    wear_gap,
)

PAIR = GearPair(teeth=(23, 67), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=math.radians(20))
RING = GearPair(teeth=(31, -82), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=math.radians(20))
RATIO, ONE = PAIR.contact_ratio, 3e8  # N/m of a pair, the same all along its path
FORCE = 1500.0
SHARING = LoadSharing(gears=PAIR, pair_compliance=lambda since: np.full(np.shape(since), 1 / ONE), static_n=FORCE)
ALONE = (RATIO - 1 + 1) / 2  # the middle of the path where a pair is alone


def involute(base, roll):
    """Point of an involute that begins on the x axis, anticlockwise."""
    return base * (np.cos(roll) + roll * np.sin(roll)), base * (np.sin(roll) - roll * np.cos(roll))


@pytest.mark.parametrize("beyond", [0.05, 0.2, 0.4])
def test_flanks_part_beyond_the_path_as_drawn_involutes_do(beyond):
    # gear one at the origin, two at (a, 0); as the driver turns its tip, how far must the wheel turn to be touched?
    (one, two), a, tip = PAIR.base_radii_m, PAIR.centre_distance_m, PAIR.tip_radii_m[0]
    start = math.acos(one / tip) - PAIR.working_angle_rad
    travel = beyond * PAIR.base_pitch_m

    def wheel_at(angle):
        """Turn of the wheel's flank through the tip, where that is at an angle."""
        x, y = a - tip * math.cos(angle), tip * math.sin(angle)
        radius = math.hypot(x, y)
        roll = brentq(lambda t: math.hypot(*involute(two, t)) - radius, 0, 2)
        px, py = involute(two, roll)
        # the driver pushes it from behind, where teeth grow thinner outwards
        return math.atan2(y, x) - math.atan2(py, px)

    turned = wheel_at(start + travel / one) - wheel_at(start)
    expected = abs(two * turned - travel)
    assert_allclose(
        separation_m(PAIR, beyond, leaving=True), expected, rtol=1e-8
    )  # of microns, by differences of radii


@pytest.mark.parametrize("pair", [PAIR, RING])
@pytest.mark.parametrize("leaving", [True, False])
def test_flanks_part_with_the_square_of_the_way_from_the_path(pair, leaving):
    # conjugate flanks: no first order; so ten times the way is about a hundred times the gap
    small, large = separation_m(pair, [1e-3, 1e-2], leaving=leaving)
    assert large / small == pytest.approx(100, rel=0.1)
    assert separation_m(pair, 0.0, leaving=leaving) == 0


def test_a_flank_sinks_into_a_spall_as_a_wheel_into_a_gap():
    # on the pinion, in the middle of the path: curvature radii by the law of the base tangent
    length, middle = 0.3, RATIO / 2
    own = PAIR.path_m[0] + middle * PAIR.base_pitch_m
    other = PAIR.centre_distance_m * math.sin(math.radians(20)) - own
    on_flank = length * PAIR.base_pitch_m * own / PAIR.base_radii_m[0]
    wheel = own * other / (own + other)
    sunk = wheel - math.sqrt(wheel**2 - on_flank**2 / 4)  # a circle over a chord
    gap = spall_gap(PAIR, 0, depth_m=1.0, length_pitches=length)
    assert gap(np.array([middle]))[0] == pytest.approx(sunk, rel=2e-3)  # the parabola of the circle
    assert np.all(gap(middle + np.array([-0.151, 0.151, 0.6])) == 0)
    assert spall_gap(PAIR, 0, depth_m=2e-6, length_pitches=length)(np.array([middle]))[0] == 2e-6


def test_wear_is_none_where_nothing_slides_and_most_at_an_end():
    pitch_point = (PAIR.base_radii_m[0] * math.tan(math.radians(20)) - PAIR.path_m[0]) / PAIR.base_pitch_m
    for gear in (0, 1):
        gap = wear_gap(PAIR, gear, depth_m=5e-5)
        assert gap(np.array([pitch_point]))[0] == pytest.approx(0, abs=1e-12)
        depths = gap(np.linspace(0, RATIO, 1025))
        assert np.max(depths) == pytest.approx(5e-5)
        assert np.argmax(depths) == (0 if gear == 0 else 1024)  # the foot of either
        assert np.all(np.diff(depths[np.linspace(0, RATIO, 1025) > pitch_point]) > 0)


@pytest.mark.parametrize(("gap_um", "lost"), [(1.0, False), (4.9, False), (5.1, True), (1e3, True)])
def test_a_pair_carries_until_the_other_takes_all(gap_um, lost):
    # the other pair deflects by F / k = 5 um under all of the load
    shared = SHARING.shared(np.array([0.2]), gap=lambda since: np.full(since.shape, 1e-6 * gap_um))
    assert (shared.pair_n_m[0] == 0) == lost
    d, g = shared.deflection_m[0], 1e-6 * gap_um
    assert ONE * d + (0 if lost else ONE * (d - g)) == pytest.approx(FORCE, rel=1e-12)  # the balance of forces
    assert shared.error_m[0] == pytest.approx(0 if lost else g / 2, abs=1e-15)


def test_a_pair_alone_sinks_until_a_neighbour_off_the_path_carries():
    off = float(SHARING.off_path_m(np.array([ALONE]))[0])
    for gap, expected in ((1e-6, 1e-6), (1.0, off)):
        shared = SHARING.shared(np.array([ALONE]), gap=lambda since, gap=gap: np.full(since.shape, gap))
        assert shared.error_m[0] == pytest.approx(expected)
        assert shared.pair_n_m[0] == pytest.approx(ONE)
    bounded = LoadSharing(gears=PAIR, pair_compliance=SHARING.pair_compliance, static_n=FORCE, most_m=3e-6)
    assert bounded.shared(np.array([ALONE]), gap=np.ones_like).error_m[0] == 3e-6


def test_a_narrow_spall_takes_its_width_from_the_stiffness_and_displaces_nothing():
    gap = spall_gap(PAIR, 0, depth_m=5e-5, length_pitches=0.3, across=False)
    # loaded so little that no neighbour carries off the path
    lost = LostContact(sharing=replace(SHARING, static_n=100.0), gap=gap, gap_share=0.25)
    since = RATIO / 2 + np.array([-0.4, -0.16, -0.14, 0.0, 0.14, 0.16])
    assert_allclose(lost.added_compliance(None, 0, since) * ONE, [0, 0, 1 / 3, 1 / 3, 1 / 3, 0], atol=1e-9)
    assert np.all(lost.error(teeth=23, first=0, stiffness_too=True)(since) == 0)
    half = LostContact(sharing=SHARING, face_share=0.5)  # and a chipped one alike, all along the path
    assert_allclose(half.added_compliance(None, 0, np.array([0.1, 0.3, 1.5])), 1 / ONE, rtol=1e-12)


@pytest.mark.parametrize("depth_um", [1.0, 2.0, 30.0])
def test_what_is_in_a_shallow_spall_carries_as_statics_says(depth_um):
    shared = SHARING.shared(
        np.array([0.2, ALONE]), gap=lambda since: np.full(since.shape, 1e-6 * depth_um), gap_share=0.4
    )
    for others, d in zip((ONE, 0.0), shared.deflection_m, strict=True):
        carried = others * d + ONE * (0.6 * d + 0.4 * max(d - 1e-6 * depth_um, 0.0))
        assert carried == pytest.approx(FORCE, rel=1e-9)


def test_the_error_is_that_of_its_pair_and_comes_again_after_a_turn():
    lost = LostContact(sharing=SHARING, gap=spall_gap(PAIR, 0, depth_m=3e-6, length_pitches=0.2))
    error = lost.error(teeth=23, first=5, stiffness_too=True)
    assert error.period == 23
    at = 5 + RATIO / 2
    assert_allclose(error([at, at + 23, at - 23, at + 1, at + 11]), [3e-6, 3e-6, 3e-6, 0, 0], atol=1e-18)
    worn = LostContact(sharing=SHARING, gap=wear_gap(PAIR, 0, depth_m=3e-6), every=True)
    error = worn.error(teeth=23, first=5, stiffness_too=True)
    phases = np.linspace(0, 1, 50)
    assert error.period == 1
    assert_allclose(error(phases), error(phases + 7), atol=1e-18)
    # where both carry, half of the sum of their gaps: stiffness is equal
    gap = wear_gap(PAIR, 0, depth_m=3e-6)
    assert_allclose(error([0.3]), (gap(np.array([0.3])) + gap(np.array([1.3]))) / 2, rtol=1e-3)


def test_what_stiffness_does_not_lose_the_error_has():
    # the static deflection is the same, whether the lost pair is missing in k or is a part of e
    gap = spall_gap(PAIR, 0, depth_m=1.0, length_pitches=0.9)
    lost, since = LostContact(sharing=SHARING, gap=gap), np.linspace(0.305, 1.405, 12)
    added = lost.added_compliance(None, 0, since)
    pairs = np.where((since < RATIO - 1) | (since > 1), ONE, 0.0)
    stiffness = pairs + 1 / (1 / ONE + added)
    with_loss = FORCE / stiffness + lost.error(teeth=23, first=0, stiffness_too=True)(since)
    healthy = FORCE / (pairs + ONE)
    assert_allclose(with_loss, healthy + lost.error(teeth=23, first=0, stiffness_too=False)(since), atol=2e-7)


# ---- flanks that are no involutes on purpose -----------------------------------------------------------------------


@pytest.mark.parametrize("crowning_um", [2.0, 8.0, 40.0])
def test_a_crowned_face_deflects_by_the_integral_over_it(crowning_um):
    crown, d = 1e-6 * crowning_um, SHARING.static_n / ONE
    shared = replace(SHARING, modification=FlankModification(crowning_m=crown)).shared(
        np.array([ALONE]), gap=np.zeros_like
    )
    # k (d - C / 3) where all of the face carries, else k d sqrt(d / C) 2 / 3
    whole = d + crown / 3
    part = (1.5 * d * math.sqrt(crown)) ** (2 / 3)
    off = SHARING.off_path_m(np.array([ALONE]))[0] + d  # unless a neighbour carries off the path
    expected = min(whole if whole > crown else part, off)
    assert shared.deflection_m[0] == pytest.approx(expected, rel=2e-3)  # of 32 slices
