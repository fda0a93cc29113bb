"""Explaining a long scene costs no more than a short one and is as true; what is too large is refused."""

import math
import re
import sys
import tracemalloc

import pytest
from counting import calls, recorded

from data_synth import SceneError, cost, explain, load_scene, simulate
from data_synth.cost import free_memory_bytes, refuse_too_large
from hums.cli import main

DAY_S = 86400.0


def scenes():
    demo, run_up = load_scene("demo"), load_scene("run-up")
    growth = {"rate_mm_per_s": 0.02, "exponent": 3.0, "largest_mm": 3.0}
    # 0.503 Hz: no whole number of knots, which rounding could make one more
    gusts = {"rms": 15.0, "time_scale_s": 2.0, "highest_hz": 0.503}
    return {
        "knots": demo.changed(duration_s=60.0, speed=demo.speed.changed(rpm=((0.0, 600.0), (50.0, 1500.0)))),
        "steps": demo.changed(
            duration_s=60.0, speed=demo.speed.changed(rpm=None, steps=((0.0, 900.0), (40.0, 1400.0)), rise_s=3.0)
        ),
        "turbulence": demo.changed(duration_s=60.0, speed=demo.speed.changed(turbulence=gusts)),
        "growth": demo.changed(duration_s=60.0, faults=(demo.faults[0].changed(growth=growth), demo.faults[1])),
        "run-up": run_up.changed(duration_s=60.0),
    }


@pytest.mark.parametrize("name", scenes())
def test_a_long_scene_has_the_events_and_lines_of_its_parts(name, monkeypatch):
    scene = scenes()[name]
    told = explain(scene)
    monkeypatch.setattr(cost, "_OPENING_S", math.inf)
    whole = explain(scene)
    assert told.truth_bytes == pytest.approx(whole.truth_bytes, rel=0.01)
    for mine, its in zip(told.parts, whole.parts, strict=True):
        assert (mine.name, mine.why, mine.seconds) == (its.name, its.why, its.seconds)
        if "pulses" in its.what or "impacts" in its.what:
            # whole events at both ends of the opening, which is a sixth of the scene or less; three digits are printed
            numbers = [float(re.search(r"[\d.e+]+", each.what)[0]) for each in (mine, its)]
            assert numbers[0] == pytest.approx(numbers[1], rel=0.005, abs=10)
        else:
            assert mine.what == its.what


@pytest.mark.parametrize("name", ["demo", "run-up"])
def test_a_day_is_explained_with_the_work_of_minutes_and_in_little_memory(name, monkeypatch):
    day, minutes = (load_scene(name).changed(duration_s=duration_s) for duration_s in (DAY_S, 100.0))
    explain(day)  # whatever is imported and cached on the first call
    staged_ones = recorded(monkeypatch, cost, "prepare_scene")
    work = {scene.duration_s: calls(lambda scene=scene: explain(scene)) for scene in (minutes, day)}
    # 864 times as long: all its pulses and impacts would be as many times more
    assert work[DAY_S] < 1.5 * work[100.0]
    assert staged_ones
    assert all(scene.duration_s <= 10.0 for (scene, *_), _ in staged_ones)
    tracemalloc.start()
    told = explain(day)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert told.record_bytes == DAY_S * 50000 * 8
    assert peak < 20e6  # 2 MB measured; the record has 35 GB


def test_a_slow_shaft_is_explained_by_several_of_its_pulses():
    demo = load_scene("demo")
    slow = demo.changed(duration_s=3600.0, speed=demo.speed.changed(rpm=((0.0, 1.0),)), faults=())
    pulses = next(part for part in explain(slow).parts if part.name == "tachometer").what
    assert abs(float(pulses.split()[1]) - 60) <= 60 / 16


def test_a_rate_too_low_for_a_long_scene_is_refused():
    demo = load_scene("demo").changed(duration_s=DAY_S, rate_hz=17000.0)
    with pytest.raises(SceneError, match="rate_hz = 17000 is not above"):
        explain(demo.changed(excitation={"harmonics": 20}))


def test_a_record_that_fits_nowhere_is_refused_with_the_numbers(monkeypatch, capsys, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(load_scene("demo").changed(duration_s=100 * DAY_S).to_toml(), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["hums", "synth", str(path), "-o", str(tmp_path / "a.h5")])
    assert main() == 1
    error = capsys.readouterr().err
    assert "the record has 1 row of 432000000000 samples and needs" in error
    assert "shorten it to about" in error
    assert not (tmp_path / "a.h5").exists()


def test_the_limit_is_what_is_free(monkeypatch, tmp_path):
    scene = load_scene("demo").changed(duration_s=300.0)  # 120 MB of samples
    refuse_too_large(scene, tmp_path / "a.h5")
    monkeypatch.setattr("data_synth.cost.free_memory_bytes", lambda: 150_000_000)
    with pytest.raises(SceneError, match=r"GB of memory, but 0\.15 GB are free; shorten it to about"):
        refuse_too_large(scene, tmp_path / "a.h5")
    monkeypatch.setattr("data_synth.cost.free_memory_bytes", lambda: 500_000_000)
    refuse_too_large(scene, tmp_path / "a.h5")
    # three shafts, two meshes and two faults beside the channel
    with pytest.raises(SceneError, match=r"8 rows of 15000000 samples"):
        refuse_too_large(scene, tmp_path / "a.h5", by_source=True)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 100_000_000}))
    with pytest.raises(SceneError, match=r"needs 0\.221 GB on the disk of"):
        refuse_too_large(scene, tmp_path / "a.h5")


def test_simulate_refuses_what_the_command_refuses(monkeypatch):
    with pytest.raises(SceneError, match=r"has 1 row of 432000000000 samples and needs .* GB of memory, but"):
        simulate(load_scene("demo").changed(duration_s=100 * DAY_S), seed=1)
    # 120 MB of samples, eleven times as much while the lines of the gears are projected, the rest for these
    scene = load_scene("gears-in-motion").changed(duration_s=300.0)
    monkeypatch.setattr("data_synth.cost.free_memory_bytes", lambda: 250_000_000)
    with pytest.raises(SceneError, match=r"needs 1\.\d* GB of memory, but 0\.25 GB are free"):
        simulate(scene, seed=1)
    with pytest.raises(SceneError, match=r"has 13 rows of"):  # 4 links and 4 rollers' and cages' angles too
        simulate(scene, seed=1, phases=True, by_source=True)


def test_free_memory_is_less_than_the_machine_has():
    free = free_memory_bytes()
    assert free is None or 1e6 < free < 1e14
