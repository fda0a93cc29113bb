"""Imperfections have the numbers of their standards, and every range has its ends."""

import numpy as np
import pytest

from data_synth.benchmark.conditions import FAULTS, IMPERFECTIONS, Machine, draw_operation, gear_quality, merged
from data_synth.benchmark.gearboxes import draw_gearbox


@pytest.fixture
def machine():
    gearbox = draw_gearbox("g", stages=2, rng=np.random.default_rng(1))
    return Machine(
        gearbox=gearbox,
        operation=draw_operation(gearbox, duration_s=10, rng=np.random.default_rng(2)),
        rng=np.random.default_rng(3),
        rng_of_gearbox=np.random.default_rng(4),
    )


def test_what_belongs_to_the_gearbox_does_not_change_with_the_record(machine):
    other = Machine(**{**vars(machine), "rng": np.random.default_rng(9), "rng_of_gearbox": np.random.default_rng(4)})
    same = Machine(**{**vars(machine), "rng_of_gearbox": np.random.default_rng(4)})
    assert gear_quality(other) == gear_quality(same)
    assert 5 <= gear_quality(other)["imperfections"]["gears"]["grade"] <= 8


def test_tables_merge_and_lists_join(machine):
    table = {"fault": [], "sensor": {"name": "a"}}
    for imperfection in IMPERFECTIONS:
        table = merged(table, imperfection(machine))
    assert table["sensor"]["name"] == "a"
    assert {"anti_alias", "cross_axis"} < table["sensor"].keys()
    of_machine = {"gears", "imbalance", "bearings", "neighbour", "knocks"}
    assert of_machine | {"noise", "electrical", "temperature"} == table["imperfections"].keys()


@pytest.mark.parametrize("name", FAULTS)
def test_severity_goes_from_the_least_size_to_the_greatest(machine, name):
    family = FAULTS[name]
    least, middle, most = (
        family.draw(machine, severity=severity, rng=np.random.default_rng(7)) for severity in (0.0, 0.5, 1.0)
    )
    key = "depth_mm" if name == "crack" else "size_mm"
    assert least["component"] == most["component"]
    assert most[key] / least[key] == pytest.approx(family.sizes[1] / family.sizes[0])
    assert middle[key] == pytest.approx(np.sqrt(least[key] * most[key]))


def test_an_imbalance_has_the_eccentricity_of_its_grade_at_the_top_speed(machine):
    for seed in range(20):
        fault = FAULTS["imbalance"].draw(machine, severity=1.0, rng=np.random.default_rng(seed))
        ratio = machine.gearbox.speed_ratio(fault["component"])
        speed = machine.gearbox.top_rpm * np.pi / 30 * ratio
        assert fault["size_mm"] * speed == pytest.approx(250)
        assert ratio >= 0.3  # the force of a slow shaft is hidden, whatever its eccentricity
        assert 0.1 < fault["rotor_kg"] < 100  # kg of steel


def test_a_fault_of_gears_or_shafts_is_at_any_place_of_the_turn(machine):
    for name in ("crack", "eccentricity", "imbalance"):
        places = [
            FAULTS[name].draw(machine, severity=0.5, rng=np.random.default_rng(seed))["offset_rev"]
            for seed in range(50)
        ]
        assert min(places) < 0.1
        assert max(places) > 0.9
