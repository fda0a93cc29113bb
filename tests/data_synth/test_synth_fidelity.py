"""Which motions are simulated, per stage and chosen."""

from functools import partial

import numpy as np
import pytest

from data_synth import SceneError, explain, load_scene, simulate
from data_synth.dynamics import Dynamics
from data_synth.fidelity import chosen
from data_synth.motion import motion_of, prepared
from data_synth.simulation import random_stream
from data_synth.stage import staged

GEOMETRY = {
    "stage 1": {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20},
    "stage 2": {"module_mm": 4, "face_width_mm": 40, "pressure_angle_deg": 20},
}
# stiff to what gears do, 170 times a mesh; so heavily damped that it matters little how far resonances still move
HELD = {"radial_n_m": 1e11, "axial_n_m": 1e11, "tilt_nm_rad": 1e8}
STIFF = {"input bearing": HELD, "intermediate bearing": HELD, "output": HELD}
SMOOTH = {"stage 1": {"shape": "trapezoid"}, "stage 2": {"shape": "trapezoid"}}
DEMO = load_scene("gears-in-motion").changed(duration_s=0.5, faults=())


def demo(fidelity="auto", *, meshes=None, **dynamics):
    geometry = {name: {**GEOMETRY[name], **(meshes or {}).get(name, {})} for name in GEOMETRY}
    table = Dynamics.model_validate({"meshes": geometry, "decide_s": 0.1, **dynamics})
    return DEMO.changed(fidelity=fidelity, dynamics=table)


def choice_of(scene):
    stage = staged(scene, draws=partial(random_stream, 1))
    gears = prepared(stage)
    choice = chosen(stage, gears)
    return choice, motion_of(stage, gears, levels=choice.levels, springs=choice.springs)


def channel(scene):
    return simulate(scene.changed(noise=scene.noise.changed(rms=0.0)), seed=1)["input vertical"].values


def heard_low(scene):
    return scene.changed(path={"frequency_hz": 1500, "damping_ratio": 0.7})


def test_bearings_that_do_not_give_need_rotations_only():
    rigid = demo(bearings=STIFF, meshes=SMOOTH, damping_ratio=0.3, floor_db=-24.0, decide_s=0.03)
    choice, motion = choice_of(heard_low(rigid))
    assert choice.name == "torsional"
    assert motion.system.names == ("input rotation", "intermediate rotation", "output rotation")
    assert [name for name, _ in choice.tried] == ["torsional"]
    assert choice.tried[0][1] <= -24


def test_bearings_that_give_need_motions_in_the_plane():
    choice, motion = choice_of(demo())
    assert set(choice.levels.values()) == {"lateral"}
    assert motion.system.dof == 9
    assert choice.tried[0][0] == "torsional"
    assert all(decibels > -40 for _, decibels in choice.tried[:-1])
    assert choice.tried[-1][1] <= -40
    assert choice.springs == ()


def test_what_is_chosen_is_within_the_floor_of_the_full_motion():
    wanted = channel(demo("full"))
    found = channel(demo())
    # the piece that decides is the first fifth; the rest of a steady scene is like it
    assert np.std(found - wanted) < 10 ** (-40 / 20) * np.std(wanted)
    assert np.std(channel(demo("torsional")) - wanted) > 10 ** (-40 / 20) * np.std(wanted)


def test_teeth_that_no_sensor_hears_are_left_out():
    # a second stage whose stiffness hardly changes: the mean of a thousand times the load's own
    quiet = demo(meshes={"stage 2": {"shape": "constant", "error_um": 1e-6}})
    choice, motion = choice_of(quiet)
    assert choice.springs == ("stage 2",)
    assert motion.system.meshes[1].error is None
    assert motion.system.meshes[0].stiffness.period == 1
    loud, _ = choice_of(demo(meshes={"stage 2": {"shape": "constant", "error_um": 5.0}}))
    assert loud.springs == ()


def test_each_stage_may_have_its_own_fidelity():
    choice, motion = choice_of(demo("lateral", meshes={"stage 2": {"fidelity": "torsional"}}))
    assert choice.name == "stage 1 lateral, stage 2 torsional"
    moving = [name for name in motion.system.names if not name.endswith("rotation")]
    assert moving == ["input x", "input y", "intermediate x", "intermediate y"]
    mixed, lateral, torsional = (
        channel(
            heard_low(
                demo(
                    fidelity,
                    meshes={name: {**SMOOTH[name], **(own or {}).get(name, {})} for name in SMOOTH},
                    bearings={**STIFF, "input bearing": {"radial_n_m": 3e8}},
                    damping_ratio=0.3,
                    # forces of the second stage would cancel out, and leave only what differs
                    hearing=({"sensor": "input vertical", "links": {"intermediate": 0.3, "output": 0}},),
                ).changed(duration_s=0.1)
            )
        )
        for fidelity, own in (
            ("lateral", {"stage 2": {"fidelity": "torsional"}}),
            ("lateral", None),
            ("torsional", None),
        )
    )
    # only the bearing of the input gives, so holding the output changes little, and holding all of them much
    assert np.std(mixed - lateral) < 0.04 * np.std(lateral)
    assert np.std(torsional - lateral) > 0.3 * np.std(lateral)


def test_a_stage_has_no_more_than_its_scene():
    with pytest.raises(SceneError, match='"stage 1" has fidelity = "full", more than the scene\'s "lateral"'):
        choice_of(demo("lateral", meshes={"stage 1": {"fidelity": "full"}}))


def test_explain_says_what_was_chosen_and_why():
    told = explain(demo())
    part = next(part for part in told.parts if part.name == "fidelity")
    assert part.what.startswith("9 degrees of freedom")
    assert part.why.startswith("lateral: within -40 dB of full (from full: torsional ")
    quiet = explain(demo(meshes={"stage 2": {"shape": "constant", "error_um": 1e-6}}))
    assert 'teeth of "stage 2" left out, below the floor' in str(quiet)
    assert "no sensor hears its teeth above the floor" in str(quiet)
    assert "lateral, as declared" in str(explain(demo("lateral")))
