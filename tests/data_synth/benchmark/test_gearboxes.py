"""The family keeps its design rules, whatever the seed."""

import math

import numpy as np
import pytest

from data_synth.benchmark.gearboxes import draw_bearing, draw_gearbox
from hums import Gearbox, solve_kinematics
from hums.gearbox.bearings import bearing_catalogue

DRAWN = [draw_gearbox(f"g{seed}", stages=1 + seed % 3, rng=np.random.default_rng(seed)) for seed in range(60)]


def test_teeth_are_not_undercut_and_hunt():
    for gearbox in DRAWN:
        for stage in gearbox.stages:
            # a rack of pressure angle a undercuts fewer than 2 / sin^2 a teeth
            assert min(stage.teeth) > 2 / math.sin(math.radians(20)) ** 2
            assert math.gcd(*stage.teeth) == 1


def test_faces_are_three_to_five_circular_pitches_wide():
    for stage in (stage for gearbox in DRAWN for stage in gearbox.stages):
        # widths are rounded to a millimetre
        assert 3 * math.pi * stage.module_mm - 0.5 <= stage.face_width_mm <= 5 * math.pi * stage.module_mm + 0.5


def test_full_torque_loads_the_weakest_stage_and_no_other_more():
    for gearbox in DRAWN:
        loads, torque_nm = [], gearbox.full_torque_nm
        for stage in reversed(gearbox.stages):  # without losses
            force_n = torque_nm / (5e-4 * stage.module_mm * stage.teeth[1])
            loads.append(force_n / (stage.module_mm * stage.face_width_mm))
            torque_nm *= stage.teeth[0] / stage.teeth[1]
        assert 12 * 0.99 <= max(loads) <= 25 * 1.01  # torque is rounded to 0.1 N m


def test_the_table_is_a_gearbox_whose_axes_are_a_centre_distance_apart():
    rng = np.random.default_rng(1)
    for drawn in DRAWN[:6]:
        gearbox = Gearbox.from_mapping(drawn.table({link: draw_bearing(rng) for link in drawn.links}))
        solved = solve_kinematics(gearbox)
        for link in drawn.links:
            ratio = float(abs(solved.relative_speed(link, seen_from="housing")))
            assert ratio == pytest.approx(drawn.speed_ratio(link), rel=1e-12)
        places = {axis.name: np.array(axis.through) for axis in gearbox.axes}
        for stage in drawn.stages:
            assert np.linalg.norm(places[stage.pinion] - places[stage.wheel]) == pytest.approx(stage.centre_mm)


def test_other_numbers_of_stages_are_refused():
    with pytest.raises(ValueError, match=r"stages = 4: the family has gearboxes of 1, 2 or 3"):
        draw_gearbox("g", stages=4, rng=np.random.default_rng(0))


def test_bearings_span_the_published_ones():
    drawn = [draw_bearing(np.random.default_rng(seed)) for seed in range(300)]
    shares = [bearing.element_diameter_mm / bearing.pitch_diameter_mm for bearing in drawn]
    # the family is of ball bearings with one row: self-aligning and roller bearings are fuller, NICE emptier
    others = {"NICE (MFPT)", "SKF 1205 ETN9", "N204 (Seoul)", "30204 (Seoul)", "DIRG B1", "DIRG B2"}
    for published in (each for each in bearing_catalogue() if each.name not in others):
        own = published.element_diameter_mm / published.pitch_diameter_mm
        assert min(shares) < own < max(shares)
        near = [b for b, share in zip(drawn, shares, strict=True) if abs(share - own) < 0.01]
        assert min(b.elements for b in near) <= published.elements <= max(b.elements for b in near)
    assert all(math.pi * b.pitch_diameter_mm > b.elements * b.element_diameter_mm for b in drawn)
