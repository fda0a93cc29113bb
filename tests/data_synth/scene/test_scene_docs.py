"""Every scene of docs/scenes.md runs, and nothing that a scene or its record can hold is missing there."""

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from data_synth import load_scene, simulate
from data_synth.scene.faults import FAULT_KINDS
from data_synth.scene.scene import Scene
from hums.gearbox.model import Gearbox

PAGE = (Path(__file__).parents[3] / "docs" / "scenes.md").read_text(encoding="utf-8")
SCENES = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)


def models(model, found):
    """Collect a model and all that its fields are made of, the gearbox left out: its file has its own page."""
    if model in found or model is Gearbox:
        return found
    found.add(model)
    for field in model.model_fields.values():
        todo = [field.annotation]
        while todo:
            part = todo.pop()
            if isinstance(part, type) and issubclass(part, BaseModel):
                models(part, found)
            todo += getattr(part, "__args__", ())
    return found


def test_the_page_has_scenes():
    assert len(SCENES) == 7


@pytest.mark.parametrize("number", range(len(SCENES)))
def test_a_scene_runs_and_its_truth_is_explained(number, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENES[number], encoding="utf-8")
    scene = load_scene(path)
    record = simulate(scene.changed(duration_s=0.4), seed=1, by_source=True, phases=True)
    assert all(record[sensor.name].size == round(0.4 * scene.rate_hz) for sensor in scene.sensors)
    told = {re.sub(r"_\d+$", "_1", str(name)) for name in record.data_vars if str(name).startswith("truth_")}
    attrs = {name for name in record.attrs if name.startswith("truth_")}
    assert {name for name in told | attrs if f"`{name}`" not in PAGE} == set()


def test_every_key_kind_and_fidelity_is_named():
    found = models(Scene, set())
    assert {"Scene", "Turbulence", "Growth", "DropOuts", "MeshDynamics", "SensorWeights"} <= {m.__name__ for m in found}
    keys = {field.alias or name for model in found for name, field in model.model_fields.items()}
    words = set(re.findall(r"\w+", PAGE))
    assert (keys | {*FAULT_KINDS} | {"kinematic", "dynamic", "auto"}) - words == set()
