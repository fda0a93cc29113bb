"""Synthetic vibration: a declared scene becomes a record with its truth."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from data_synth.cost import explain as explain
    from data_synth.dataset_folder import make_dataset as make_dataset
    from data_synth.draws import PlanError as PlanError
    from data_synth.plan import Plan as Plan
    from data_synth.plan import load_plan as load_plan
    from data_synth.scene.scene import Scene as Scene
    from data_synth.scene.scene import SceneError as SceneError
    from data_synth.scene.scene import load_scene as load_scene
    from data_synth.simulation import simulate as simulate

_HOME = {
    "Plan": "data_synth.plan",
    "PlanError": "data_synth.draws",
    "Scene": "data_synth.scene.scene",
    "SceneError": "data_synth.scene.scene",
    "explain": "data_synth.cost",
    "load_plan": "data_synth.plan",
    "load_scene": "data_synth.scene.scene",
    "make_dataset": "data_synth.dataset_folder",
    "simulate": "data_synth.simulation",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'data_synth' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
