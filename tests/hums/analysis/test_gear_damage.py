"""Gears of synthetic records: the right one is named, and none of a sound machine whose load and speed change."""

import re
from dataclasses import replace

import numpy as np
import pytest

from data_synth import Scene, simulate
from hums import AnalysisSettings, PulseTimes, load_gearbox, make_record
from hums.analysis.gear_damage import GearJudgement, gear_damage, gear_verdicts
from hums.analysis.segments import segmented
from hums.analysis.thresholds import GRAVE_RISE, SELDOM_SOUND

RATE_HZ = 12000
RINGING = {"resonance": {"frequency_hz": 3500, "damping_ratio": 0.05}, "rate_hz": RATE_HZ, "fidelity": "kinematic"}
PLANETARY = RINGING | {
    "gearbox": "planetary-27-36-99",
    "duration_s": 12,
    "speed": {"link": "sun", "rpm": 1120},
    "tachometer": {"link": "sun", "pulses_per_rev": 1},
    "planet_pass": {"half_width_deg": 40, "floor": 0.1},
    "noise": {"rms": 0.5},
    "sensor": [{"name": "a", "on": "ring", "units": "m s-2"}],
}
TWO_STAGE = RINGING | {
    "gearbox": "two-stage",
    "duration_s": 10,
    "speed": {"link": "input", "rpm": [[0, 700], [10, 1500]]},
    "torque": {"link": "output", "steps": [[0, 150], [3, 500], [6, 150]], "rise_s": 0.3},
    "tachometer": {"link": "input", "pulses_per_rev": 1},
    "excitation": {"meshes": {"stage 1": 0.6, "stage 2": 0.3}, "harmonics": 4},
    "noise": {"rms": 0.05},
    "sensor": [{"name": "a", "on": "input bearing", "units": "g"}],
}


def judged(scene, *, seed=1, stop=None, clip=np.inf):
    record = simulate(Scene.from_mapping(scene), seed=seed)
    if stop is not None:
        record = record.isel(time=slice(stop))
    return judged_record(record.assign(a=record["a"].clip(-clip, clip)), scene["gearbox"])


def judged_record(record, gearbox):
    (segment,) = segmented(record, load_gearbox(gearbox), AnalysisSettings()).channels["a"].segments
    return gear_damage(segment, false_alarm_probability=0.01)


def crack(component, depth_mm):
    return {"fault": [{"kind": "tooth_crack", "component": component, "depth_mm": depth_mm}]}


def named(rows):
    return [row for row in rows if row.probability <= 0.01 and not row.explained_by]


@pytest.mark.parametrize("component", ["sun-planet/sun", "planet-ring/planet"])
def test_the_cracked_gear_of_a_planetary_stage_is_the_only_one_named(component):
    (found,) = named(judged(PLANETARY | crack(component, 2.0)))
    assert component in (found.component, *found.also)
    assert found.turns > 100
    assert found.amplitude > 0.1  # m s-2, about the noise in the band


@pytest.mark.parametrize("component", ["stage 1/intermediate", "stage 2/output"])
def test_the_cracked_gear_on_a_fixed_axis_is_the_only_one_named(component):
    (found,) = named(judged(TWO_STAGE | crack(component, 1.5)))
    assert component in (found.component, *found.also)


def test_gears_on_one_shaft_are_not_told_apart():
    (found,) = named(judged(TWO_STAGE | crack("stage 2/intermediate", 1.0)))
    assert {found.component, *found.also} == {"stage 1/intermediate", "stage 2/intermediate"}
    finding = gear_verdicts([found], false_alarm_probability=0.01)[0]
    # no mesh is modulated, as by a knock of the shaft
    alike = {"stage 1/intermediate", "stage 2/intermediate", "a loose part on intermediate"}
    assert {finding.component, *finding.alike.split(" or ")} == alike


@pytest.mark.parametrize(("own", "other"), [(0, 1), (1, 0)])
def test_the_gear_whose_mesh_is_modulated_comes_before_another_of_its_shaft(own, other):
    # amplitude and phase of one mesh change for a tooth (Randall 1982); 23/67 and 19/61 teeth, input at 25 Hz
    gears, rng, rate_hz = ("stage 1/intermediate", "stage 2/intermediate"), np.random.default_rng(3), 10000
    time_s = np.arange(8 * rate_hz) / rate_hz
    turn = 25 * 23 / 67 * time_s
    x = 0.5 * rng.standard_normal(turn.size)
    for gear, teeth in enumerate((67, 19)):
        bump = (gear == own) * np.exp(-0.5 * (((turn + 0.6) % 1 - 0.5) * teeth / 0.6) ** 2)
        x += (1 - 0.5 * bump) * sum(np.cos(2 * np.pi * k * teeth * turn + k * bump) / k for k in (1, 2, 3))
    pulses = np.arange(int(turn[-1]) + 1) / (25 * 23 / 67)
    angle = PulseTimes(times_s=pulses, shaft="intermediate", pulses_per_rev=1)
    record = make_record({"a": x}, rate_hz=rate_hz, units="g", angle=angle)
    found = named(judged_record(record, "two-stage"))
    assert (found[0].component, found[0].also) == (gears[own], (gears[other],))
    alone, both = (
        gear_verdicts([row], false_alarm_probability=0.01)[0].next_step
        for row in (replace(found[0], rivals=()), replace(found[0], rivals=(gears[other],)))
    )
    number, teeth = map(int, re.search(r"near tooth (\d+) of (\d+)", alone).groups())
    assert abs(number - 0.9 * teeth) < 2  # in mesh 0.9 of a turn after the pulse
    assert gears[other] not in alone
    assert gears[other] in both


@pytest.mark.parametrize("scene", [PLANETARY, TWO_STAGE], ids=["planetary", "two-stage"])
def test_no_gear_of_a_sound_machine_is_named(scene):
    rows = judged(scene)
    assert not any(row.not_judged for row in rows)
    assert not named(rows)


def test_two_cracked_gears_are_both_named():
    fault = [*crack("stage 1/pinion", 1.0)["fault"], *crack("stage 2/output", 1.0)["fault"]]
    assert {row.component for row in named(judged(TWO_STAGE | {"fault": fault}))} == {
        "stage 1/pinion",
        "stage 2/output",
    }


def test_a_short_record_and_a_sick_sensor_are_not_judged():
    rows = judged(TWO_STAGE | crack("stage 1/pinion", 1.0), stop=RATE_HZ // 5)
    assert all("revolutions are too few" in row.not_judged for row in rows)
    assert all(row.not_judged and row.probability == 1 for row in rows)
    assert {row.not_judged for row in judged(TWO_STAGE | {"duration_s": 2}, clip=0.2)} == {"the sensor is faulty"}


def test_few_turns_name_a_tooth_that_stands_out_and_call_none_sound():
    rows = judged(TWO_STAGE | crack("stage 1/pinion", 1.0), stop=RATE_HZ // 2)
    few = [row for row in rows if not row.not_judged and row.turns < 8]
    assert few
    verdicts = gear_verdicts([replace(row, probability=1.0) for row in few], false_alarm_probability=0.01)
    assert {one.verdict for one in verdicts} == {"not judged"}
    assert all(
        one.doubts.startswith(f"too short: in {row.turns} revolutions") for one, row in zip(verdicts, few, strict=True)
    )
    (named,) = gear_verdicts([replace(few[0], probability=0.001)], false_alarm_probability=0.01)
    assert named.verdict == "indicated"


@pytest.mark.parametrize(("share", "verdict"), [(0.99, "not judged"), (1.01, "nothing found")])
def test_a_tooth_that_stands_out_more_than_in_most_healthy_machines_is_not_called_sound(share, verdict):
    row = GearJudgement(
        channel="a",
        units="g",
        component="stage 1/pinion",
        order=1.0,
        teeth=20,
        turns=100,
        probability=share * SELDOM_SOUND,
    )
    (one,) = gear_verdicts([row], false_alarm_probability=0.01)
    assert one.verdict == verdict
    assert ("as pits or large pitch deviations do" in one.doubts) == (verdict == "not judged")


@pytest.mark.parametrize(("share", "verdict"), [(1.01, "not judged"), (0.99, "nothing found")])
def test_a_gear_of_which_only_a_gravely_damaged_tooth_would_stand_out_is_not_called_sound(share, verdict):
    row = GearJudgement(
        channel="a",
        units="g",
        component="sun-planet/sun",
        order=3.0,
        teeth=21,
        turns=100,
        least_rise=share * GRAVE_RISE,
    )
    (one,) = gear_verdicts([row], false_alarm_probability=0.01)
    assert one.verdict == verdict
    assert ("are too few" in one.doubts) == (verdict == "not judged")


def test_a_pitted_gear_is_not_called_sound():
    pitted = {"kind": "pitting", "component": "stage 1/pinion", "size_mm": 1.0}
    rows = judged(TWO_STAGE | {"fault": [pitted]})
    verdicts = {one.component: one.verdict for one in gear_verdicts(rows, false_alarm_probability=0.01)}
    assert verdicts["stage 1/pinion"] in {"not judged", "indicated"}
    assert verdicts["stage 2/output"] == "nothing found"
