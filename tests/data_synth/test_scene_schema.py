"""The schemas accept what the loaders accept, and refuse what they refuse."""

import copy
import json
import re
import sys
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from data_synth import PlanError, SceneError, load_plan, load_scene
from data_synth.plan import plans
from data_synth.scene.scene import catalogue
from data_synth.scene_schema import plan_schema, scene_schema
from hums.cli import main
from hums.gearbox.model import catalogue as gearboxes
from hums.gearbox.model import gearbox_schema

DOCS = Path(__file__).parents[2] / "docs"
SCENES = {name: path.read_text(encoding="utf-8") for name, path in catalogue().items()} | {
    f"docs {number}": text
    for number, text in enumerate(re.findall(r"```toml\n(.*?)```", (DOCS / "scenes.md").read_text("utf-8"), re.DOTALL))
}
VALIDATOR = Draft202012Validator(scene_schema(gearbox_schema()))


@pytest.mark.parametrize("schema", [scene_schema(gearbox_schema()), plan_schema()])
def test_a_schema_is_a_schema(schema):
    Draft202012Validator.check_schema(schema)
    text = json.dumps(schema)
    assert '"null"' not in text
    assert set(re.findall(r'"#/\$defs/(\w+)"', text)) <= set(schema["$defs"])


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # the shipped OH-58 as printed
@pytest.mark.parametrize("name", SCENES)
def test_scenes_fit_as_written_and_with_every_default_written_out(name, tmp_path):
    assert list(VALIDATOR.iter_errors(tomllib.loads(SCENES[name]))) == []
    (tmp_path / "scene.toml").write_text(SCENES[name], encoding="utf-8")
    scene = tomllib.loads(load_scene(tmp_path / "scene.toml").to_toml())
    written = tomllib.loads(SCENES[name])["gearbox"]  # by hand, in place of its fields
    by_name = isinstance(written, str)
    scene["gearbox"] = tomllib.loads(gearboxes()[written].read_text(encoding="utf-8")) if by_name else written
    assert list(VALIDATOR.iter_errors(scene)) == []


def broken():
    scene = tomllib.loads(SCENES["demo"])
    for path, value in [
        (("fidelity",), "cinematic"),
        (("speed", "steps"), [[0, 900]]),  # a second way of saying it
        (("speed", "rpm"), "fast"),
        (("torque", "unloaded_share"), 2),
        (("excitation", "meshes"), {"stage 1": -0.3}),
        (("excitation", "harmonics"), 0),
        (("fault", 0, "kind"), "crack"),
        (("fault", 0, "dept_mm"), 1),
        (("fault", 1, "growth"), {"largest_mm": 3}),
        (("sensor",), []),
        (("sensor", 0, "units"), "m/s2"),
        (("tachometer", "pulses_per_rev"), 0),
        (("noize",), {"rms": 1}),
        (("transfer",), [{"source": "output", "sensor": "input vertical", "units": "g"}]),
    ]:
        table = copy.deepcopy(scene)
        place = table
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        yield pytest.param(table, id=".".join(map(str, path)))


@pytest.mark.parametrize("table", [*broken()])
def test_schema_and_loader_refuse_alike(table, tmp_path):
    import tomli_w  # noqa: PLC0415

    (tmp_path / "scene.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    with pytest.raises(SceneError):
        load_scene(tmp_path / "scene.toml")
    assert not VALIDATOR.is_valid(table)


def test_plans_fit_and_broken_ones_do_not(tmp_path):
    validator = Draft202012Validator(plan_schema())
    texts = [path.read_text(encoding="utf-8") for path in plans().values()]
    written, machines = re.findall(r"```toml\n(.*?)```", (DOCS / "datasets.md").read_text("utf-8"), re.DOTALL)
    for text in [*texts, written, machines]:
        assert list(validator.iter_errors(tomllib.loads(text))) == []
    wrong = written.replace("records = 60", "records = 0")
    assert wrong != written
    (tmp_path / "plan.toml").write_text(wrong, encoding="utf-8")
    with pytest.raises(PlanError):
        load_plan(tmp_path / "plan.toml")
    assert not validator.is_valid(tomllib.loads(wrong))


@pytest.mark.parametrize(("kind", "key"), [("gearbox", "mesh"), ("scene", "sensor"), ("plan", "class")])
def test_the_command_prints_each(kind, key, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["hums", "schema", kind])
    assert main() == 0
    assert key in json.loads(capsys.readouterr().out)["properties"]


def test_its_help_lists_the_choices(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["hums", "schema", "--help"])
    assert main() == 0
    assert "gearbox, scene, or plan" in " ".join(re.sub("[│\n]", " ", capsys.readouterr().out).split())
