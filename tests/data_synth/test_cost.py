import sys

import pytest
from gearboxes import SHORT_SCENE

from data_synth import explain, load_plan, load_scene, simulate
from data_synth.scene.scene import catalogue
from hums.cli import main
from hums.records.store import open_record

SCENE = SHORT_SCENE.replace("duration_s = 0.2", "duration_s = 1") + "clipping = { level = 9 }\n"


@pytest.fixture
def synth(monkeypatch, capsys):
    """Run `hums synth ...` and return exit code, standard output and standard error."""

    def command(*words):
        monkeypatch.setattr(sys, "argv", ["hums", "synth", *map(str, words)])
        code = main()
        return code, *capsys.readouterr()

    return command


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def test_every_part_of_the_demo_is_named_with_its_reason():
    told = explain("demo")
    reasons = {(part.name, part.why) for part in told.parts}
    assert ("stage 2", "gear_mesh") in reasons
    assert ("stage 1/pinion", "tooth") in reasons
    assert ("stage 1/pinion", "fault 1, tooth_crack: excites 8000 Hz") in reasons
    assert ("intermediate bearing", "fault 2, inner_race: excites 8000 Hz") in reasons
    assert told.record_bytes == 500_000 * 8
    # 10 s from 1200 to 1500 rpm with corners: trapezoids of the declared speed, in turns
    turns = (2 * (1217.5 + 1285 + 1350 + 1417.5 + 1485)) / 60
    pulses = next(part for part in told.parts if part.name == "tachometer")
    assert abs(int(pulses.what.split()[0]) - turns) <= 1


def test_cost_goes_with_samples_and_lines():
    demo = load_scene("demo")
    short, long = explain(demo.changed(duration_s=1.0)), explain(demo.changed(duration_s=100.0))
    assert sum(part.seconds for part in long.parts) == pytest.approx(100 * sum(part.seconds for part in short.parts))
    assert short.seconds < explain(demo).seconds < long.seconds


def test_the_truth_of_gears_in_motion_is_about_as_large_as_estimated():
    plan = load_plan("benchmark-1")
    numbers = (2, 3)
    estimated = sum(explain(plan.scene(number)).truth_bytes for number in numbers)
    made = sum(simulate(plan.scene(number), seed=plan.seed_of(number))["truth_amplitude"].nbytes for number in numbers)
    # the logarithm of one record's lines scatters by 0.7: 2.7 is two standard deviations of the mean of two
    assert 1 / 2.7 < estimated / made < 2.7


def test_the_truth_of_steady_gears_has_two_instants():
    steady = load_scene("gears-in-motion").changed(duration_s=2.0)
    made = simulate(steady, seed=1)["truth_amplitude"].nbytes
    assert 1 / 2.7 < explain(steady).truth_bytes / made < 2.7  # as above, of one record; 100 times with 20 a second


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # the shipped OH-58 as printed
@pytest.mark.parametrize("name", catalogue())
def test_the_command_explains_and_writes_nothing(synth, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = synth(name, "--explain")
    assert (code, err) == (0, "")
    scene = load_scene(name)
    channels = f"{scene.duration_s:g} s of {len(scene.sensors)} channel{'s' * (len(scene.sensors) > 1)}"
    what = f"{channels} at {scene.rate_hz:g} Hz, {scene.samples} samples each"
    assert out.startswith(f"{scene.gearbox.name}, {scene.fidelity}: {what}\n")
    assert "on one core" in out
    assert not list(tmp_path.iterdir())


def test_explaining_and_writing_go_together(synth, scene, tmp_path):
    code, out, _ = synth(scene, "--explain", "-o", tmp_path / "a.h5", "--by-source", "--phases")
    assert code == 0
    assert "sensor on input bearing" in out
    with open_record(tmp_path / "a.h5") as record:
        assert {"truth_source", "truth_shaft_revolutions", "truth_roller_revolutions"} <= set(record.data_vars)


def test_a_record_is_not_written_over_its_scene(synth, scene):
    code, _, err = synth(scene, "-o", scene)
    assert code == 1
    assert "inputs are never overwritten" in err
    assert scene.read_text(encoding="utf-8") == SCENE


def test_without_a_file_to_write_it_says_so(synth, scene):
    code, _, err = synth(scene)
    assert code == 2
    assert "--out is missing; name the record to write" in err


def test_what_is_kept_beside_the_channels_counts(synth, scene):
    _, alone, _ = synth(scene, "--explain")
    kept = {"by_source": True, "phases": True}
    _, beside, _ = synth(scene, "--explain", "--by-source", "--phases")
    assert beside == f"{explain(scene, **kept)}\n"
    assert beside != alone
    record = simulate(scene, seed=1, **kept)
    histories = [record[name] for name in ("a", "truth_source", "truth_shaft_revolutions", "truth_roller_revolutions")]
    assert explain(scene, **kept).record_bytes == sum(each.nbytes for each in histories)
