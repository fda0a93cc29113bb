"""Time integrators: a problem, a method, what to read and how exactly, and what came of it."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from data_synth.integrate.choice import MethodChoice as MethodChoice
    from data_synth.integrate.choice import method_for as method_for
    from data_synth.integrate.exact import Transition as Transition
    from data_synth.integrate.problem import Accuracy as Accuracy
    from data_synth.integrate.problem import CoupledReference as CoupledReference
    from data_synth.integrate.problem import Integration as Integration
    from data_synth.integrate.problem import IntegrationError as IntegrationError
    from data_synth.integrate.problem import Load as Load
    from data_synth.integrate.problem import Outcome as Outcome
    from data_synth.integrate.problem import Output as Output
    from data_synth.integrate.problem import Problem as Problem
    from data_synth.integrate.problem import State as State
    from data_synth.integrate.problem import Steps as Steps
    from data_synth.integrate.running import Block as Block
    from data_synth.integrate.running import integrate as integrate
    from data_synth.integrate.running import integrate_blocks as integrate_blocks
    from data_synth.integrate.shooting import PeriodicState as PeriodicState
    from data_synth.integrate.shooting import periodic_state as periodic_state
    from data_synth.integrate.splitting import Splitting as Splitting

_HOME = {
    "Accuracy": "data_synth.integrate.problem",
    "Block": "data_synth.integrate.running",
    "MethodChoice": "data_synth.integrate.choice",
    "Integration": "data_synth.integrate.problem",
    "IntegrationError": "data_synth.integrate.problem",
    "Load": "data_synth.integrate.problem",
    "Outcome": "data_synth.integrate.problem",
    "Output": "data_synth.integrate.problem",
    "PeriodicState": "data_synth.integrate.shooting",
    "Problem": "data_synth.integrate.problem",
    "Splitting": "data_synth.integrate.splitting",
    "State": "data_synth.integrate.problem",
    "Steps": "data_synth.integrate.problem",
    "CoupledReference": "data_synth.integrate.problem",
    "Transition": "data_synth.integrate.exact",
    "integrate": "data_synth.integrate.running",
    "integrate_blocks": "data_synth.integrate.running",
    "method_for": "data_synth.integrate.choice",
    "periodic_state": "data_synth.integrate.shooting",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'data_synth.integrate' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
