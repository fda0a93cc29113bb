import hashlib
import os
import subprocess
import sys
import tracemalloc
from functools import cache

import numpy as np
import pytest
from counting import calls
from gearboxes import TWO_STAGE, without_sizes
from numpy.testing import assert_allclose

from data_synth import Scene, load_scene, simulate
from data_synth.scene.faults import FAULT_KINDS
from hums.records.store import save_record

BASE = {
    **TWO_STAGE,
    "gearbox": without_sizes("two-stage"),
    "duration_s": 0.5,
    "speed": {"link": "input", "rpm": [[0, 1500], [0.5, 1530]]},
    "sensor": [{"name": name, "on": "input bearing", "units": "g"} for name in ("a", "b")],
}
GEAR = ["tooth_crack", "chipping", "missing_tooth", "spall", "pitting", "eccentricity", "misalignment", "wear"]
SHAFT = ["imbalance", "bent_shaft", "shaft_misalignment"]
ALL_ROUND = {"eccentricity", "misalignment", "wear"}


def fault_of(kind, **more):
    size = "depth_mm" if kind == "tooth_crack" else "size_mm"
    where = "stage 1/pinion" if kind in GEAR else "intermediate" if kind in SHAFT else "intermediate bearing"
    return {"kind": kind, "component": where, size: 1.0, **more}


def record(*faults, seed=4, **changes):
    return simulate(Scene.from_mapping({**BASE, "fault": list(faults), **changes}), seed=seed, by_source=True)


def rebuilt(made, channel):
    """The signal of the listed lines, from the truth and the exact angle of a speed that rises evenly."""
    times, instants = made["time"].values, made["truth_time"].values
    turns = 25 * times + 0.5 * times**2  # 1 rev/s in 1 s
    turns -= turns[0] - made["truth_revolutions"].values[0]
    signal = np.zeros(times.size)
    for order, z in zip(
        made["truth_order"].values, made["truth_amplitude"].sel(truth_channel=channel).values, strict=True
    ):
        z_now, angle_rad = np.interp(times, instants, z), 2 * np.pi * order * turns
        signal += z_now.real * np.cos(angle_rad) - z_now.imag * np.sin(angle_rad)
    return signal


@cache
def healthy():
    return record(rate_hz=30_000)["a"]


@pytest.mark.parametrize("kind", [*GEAR, *SHAFT])
@pytest.mark.parametrize("grows", [False, True])
def test_the_lines_of_every_fault_are_the_truth_s(kind, grows):
    growth = {"growth": {"rate_mm_per_s": 2.0, "largest_mm": 1.8}} if grows else {}
    silent = {"impact_per_mm": 0} if kind in GEAR else {}
    made = record(fault_of(kind, **growth, **silent), rate_hz=30_000)
    assert_allclose(made["b"].values, rebuilt(made, "b"), atol=1e-11)
    assert str(made["truth_fault_kind"].values[0]) == kind
    assert np.std(made["a"].values - healthy().values) > 1e-3
    grown = np.minimum(1 + 2 * grows * made["truth_time"].values, 1.8)
    assert_allclose(made["truth_fault_size"].values[0], grown, rtol=1e-12)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_faults_strike_and_their_impacts_go_with_their_size(kind):
    growth = {"rate_mm_per_s": 2.0, "exponent": 2, "largest_mm": 9.0}
    still, grown = record(fault_of(kind)), record(fault_of(kind, growth=growth))
    if kind in SHAFT or kind in ALL_ROUND:
        assert "truth_impact_times_1" not in still
        return
    struck = still["truth_impact_times_1"].values
    assert np.all(np.diff(struck) > 0)
    assert_allclose(grown["truth_impact_times_1"].values, struck, atol=0)
    if kind == "outer_race":  # nothing but impacts of one size each: the first at exp(0), the last at e
        source = still["truth_source_name"].values == "intermediate bearing, outer_race"
        before, after = (made["truth_source"].values[0, source][0] for made in (still, grown))
        last = int(np.ceil(struck[-2] * 20_000))
        ratio = np.max(np.abs(after[last : last + 9])) / np.max(np.abs(before[last : last + 9]))
        assert ratio == pytest.approx(np.exp(struck[-2] / 0.5), rel=1e-3)


def test_sources_add_up_to_the_clean_signal_and_the_phases_are_those_of_the_gears():
    scene = Scene.from_mapping({**BASE, "fault": [fault_of("inner_race"), fault_of("tooth_crack")]})
    made = simulate(scene, seed=4, by_source=True, phases=True)
    assert_allclose(made["truth_source"].sum("truth_source_name").values[1], made["b"].values, atol=1e-12)
    assert made["truth_source"].sizes["truth_source_name"] == 7
    shafts = made["truth_shaft_revolutions"]
    times = made["time"].values
    turned = 25 * times + 0.5 * times**2
    assert_allclose(shafts.sel(truth_shaft="input").values + made["tachometer"].values[0] * 0, shafts.values[0], atol=0)
    first = shafts.sel(truth_shaft="input").values
    assert_allclose(first - first[0], turned, atol=1e-12)
    assert_allclose(shafts.sel(truth_shaft="intermediate").values, -23 / 67 * first, rtol=1e-12)
    # 9 elements of 12.7 on 60.5 mm: the cage turns (1 - d/D)/2 a turn, an element (D/d)(1 - (d/D)^2)/2
    rollers = made["truth_roller_revolutions"]
    ratio = 12.7 / 60.5
    assert_allclose(rollers.sel(truth_roller="input bearing/cage").values, first * (1 - ratio) / 2, rtol=1e-12)
    spin = (1 - ratio**2) / ratio / 2
    assert_allclose(rollers.sel(truth_roller="input bearing/element").values, first * spin, rtol=1e-12)


def test_by_source_and_phases_change_nothing_else():
    scene = Scene.from_mapping({**BASE, "fault": [fault_of("inner_race")]})
    bare, whole = simulate(scene, seed=4), simulate(scene, seed=4, by_source=True, phases=True)
    for name in bare.variables:
        assert bare[name].values.tobytes() == whole[name].values.tobytes(), name


def test_blocks_leave_no_seam():
    # 200000 samples are three blocks and a bit
    made = record(rate_hz=400_000)
    assert_allclose(made["a"].values, rebuilt(made, "a"), atol=1e-11)


SPOILT = """
import hashlib, sys
from data_synth import load_scene, simulate
scene = load_scene("demo")
table = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
table["duration_s"] = 0.1
table["speed"]["turbulence"] = {"rms": 5, "time_scale_s": 0.2}
table["tachometer"] |= {"missing": {"share": 0.1}, "spurious": {"per_second": 20}, "jitter": {"std_s": 1e-6}}
table["sensor"][0] |= {
    "cross_axis": {"share": 0.05}, "resonance": {"frequency_hz": 22000, "damping_ratio": 0.02},
    "anti_alias": {"frequency_hz": 18000},
    "quantisation": {"bits": 16, "full_scale": 50},
    "drop_outs": {"per_second": 20, "duration_s": 0.01, "reads": "zero"},
}
from data_synth import Scene
record = simulate(Scene.from_mapping(table), seed=11, by_source=True, phases=True)
digest = hashlib.sha256()
for name in sorted(record.variables, key=str):
    digest.update(str(name).encode()); digest.update(record[name].values.tobytes())
found = digest.hexdigest()
"""


def test_same_scene_and_seed_same_bytes_in_any_process():
    here = {}
    exec(SPOILT, here)  # noqa: S102 - what the other process runs
    hashing = "77" if os.environ.get("PYTHONHASHSEED") != "77" else "78"
    environment = os.environ | {"PYTHONHASHSEED": hashing, "OMP_NUM_THREADS": "2", "NUMBA_NUM_THREADS": "2"}
    run = subprocess.run(
        [sys.executable, "-c", f"{SPOILT}\nprint(found)"], capture_output=True, text=True, check=True, env=environment
    )
    assert run.stdout.strip() == here["found"]
    assert len(here["found"]) == len(hashlib.sha256().hexdigest())


def test_a_longer_demo_is_made_and_written_with_hardly_more_calls(tmp_path):
    """What is done for each sample is done in compiled code or by numpy for many at once."""
    demo, work = load_scene("demo"), {}
    for duration_s in (1.0, 3.0):
        scene = demo.changed(duration_s=duration_s, speed=demo.speed.changed(rpm=((0.0, 1200.0),)))

        def made(scene=scene):
            save_record(simulate(scene, seed=1), tmp_path / "record.h5")

        made()  # compiles and imports
        work[duration_s] = calls(made)
    # two seconds more have 100,000 samples, and some dozens of pulses, impacts and blocks on the way to the disk
    assert work[3.0] - work[1.0] < demo.rate_hz / 50


def test_what_is_in_memory_beside_the_channels_does_not_grow_with_the_record():
    table = {
        **BASE,
        "rate_hz": 100_000,
        "sensor": [{**BASE["sensor"][0], "clipping": {"level": 1}, "quantisation": {"bits": 16, "full_scale": 2}}],
        "noise": {"rms": 0.1},
        "fault": [fault_of("inner_race")],
    }
    beside = []
    for duration in (2.0, 8.0):
        scene = Scene.from_mapping({**table, "duration_s": duration})
        tracemalloc.start()
        simulate(scene, seed=1)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        beside.append(peak - 8 * scene.samples)
    # truth and impacts grow by some kilobytes a second; copies of 600,000 samples more would by 4.8 MB
    assert beside[1] - beside[0] < 8e5


def test_links_whose_axis_turns_in_space_have_no_angle():
    scene = Scene.from_mapping(
        {
            "gearbox": "nelson-bevel-planet", "rate_hz": 5000, "duration_s": 0.5, "fidelity": "kinematic",
            "speed": {"link": "ring", "rpm": 1200}, "tachometer": {"link": "ring", "pulses_per_rev": 1},
            "sensor": [{"name": "a", "on": "ring", "units": "g"}],
        }
    )  # fmt: skip
    made = simulate(scene, seed=1, phases=True, mechanics=True)
    turning = set(made["truth_shaft"].values)
    assert "ring" in turning
    assert "planet" not in turning
    assert set(made["truth_link"].values) == turning
