"""Gear dynamics: a gearbox as equations of motion, with their modes, stability, steady states and time integrators.

The drawing and its masses and stiffnesses become M, C, G and K(phase) by `assemble`; systems that are no gearbox are
built from bodies and elements by `build_system`. `solve_modes` and `campbell` give natural frequencies, `floquet` and
`stability_map` parametric stability, `periodic_state` the steady response, and `integrate` the response over time.
`docs/dynamics.md` walks through all of it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from data_synth.dynamics.assembly import Assembly as Assembly
    from data_synth.dynamics.assembly import assemble as assemble
    from data_synth.dynamics.elements import Coupling as Coupling
    from data_synth.dynamics.elements import GearMesh as GearMesh
    from data_synth.dynamics.elements import GeneralMesh as GeneralMesh
    from data_synth.dynamics.elements import Shaft as Shaft
    from data_synth.dynamics.elements import Support as Support
    from data_synth.dynamics.modes import Campbell as Campbell
    from data_synth.dynamics.modes import Modes as Modes
    from data_synth.dynamics.modes import campbell as campbell
    from data_synth.dynamics.modes import eigenvalues as eigenvalues
    from data_synth.dynamics.modes import solve_modes as solve_modes
    from data_synth.dynamics.modes import with_modal_damping as with_modal_damping
    from data_synth.dynamics.parts import Inertia as Inertia
    from data_synth.dynamics.parts import MeshProperties as MeshProperties
    from data_synth.dynamics.parts import SupportStiffness as SupportStiffness
    from data_synth.dynamics.stability import Multipliers as Multipliers
    from data_synth.dynamics.stability import StabilityMap as StabilityMap
    from data_synth.dynamics.stability import Tongue as Tongue
    from data_synth.dynamics.stability import floquet as floquet
    from data_synth.dynamics.stability import instability_tongues as instability_tongues
    from data_synth.dynamics.stability import stability_map as stability_map
    from data_synth.dynamics.system import Body as Body
    from data_synth.dynamics.system import FrictionForce as FrictionForce
    from data_synth.dynamics.system import Mesh as Mesh
    from data_synth.dynamics.system import MeshHistory as MeshHistory
    from data_synth.dynamics.system import Spring as Spring
    from data_synth.dynamics.system import System as System
    from data_synth.dynamics.system import build_system as build_system
    from data_synth.gears.geometry import GearPair as GearPair
    from data_synth.gears.mesh_stiffness import Constant as Constant
    from data_synth.gears.mesh_stiffness import Fourier as Fourier
    from data_synth.gears.mesh_stiffness import Rectangular as Rectangular
    from data_synth.gears.mesh_stiffness import Shifted as Shifted
    from data_synth.gears.mesh_stiffness import Trapezoidal as Trapezoidal
    from data_synth.gears.mesh_stiffness import fourier_series as fourier_series
    from data_synth.gears.transmission_error import ProfileError as ProfileError
    from data_synth.integrators.driver import integrate as integrate
    from data_synth.integrators.driver import integrate_blocks as integrate_blocks
    from data_synth.integrators.problem import Accuracy as Accuracy
    from data_synth.integrators.problem import Integration as Integration
    from data_synth.integrators.problem import IntegrationError as IntegrationError
    from data_synth.integrators.problem import Load as Load
    from data_synth.integrators.problem import Outcome as Outcome
    from data_synth.integrators.problem import Output as Output
    from data_synth.integrators.problem import Problem as Problem
    from data_synth.integrators.problem import State as State
    from data_synth.integrators.problem import Steps as Steps
    from data_synth.operation.shaft_angle import ShaftAngle as ShaftAngle
    from data_synth.vibration.steady_state import PeriodicState as PeriodicState
    from data_synth.vibration.steady_state import periodic_state as periodic_state

_MODULES = {
    "data_synth.dynamics.assembly": "Assembly assemble",
    "data_synth.dynamics.elements": "Coupling GearMesh GeneralMesh Shaft Support",
    "data_synth.dynamics.modes": "Campbell Modes campbell eigenvalues solve_modes with_modal_damping",
    "data_synth.dynamics.parts": "Inertia MeshProperties SupportStiffness",
    "data_synth.dynamics.stability": "Multipliers StabilityMap Tongue floquet instability_tongues stability_map",
    "data_synth.dynamics.system": "Body FrictionForce Mesh MeshHistory Spring System build_system",
    "data_synth.gears.geometry": "GearPair",
    "data_synth.gears.mesh_stiffness": "Constant Fourier Rectangular Shifted Trapezoidal fourier_series",
    "data_synth.gears.transmission_error": "ProfileError",
    "data_synth.integrators.driver": "integrate integrate_blocks",
    "data_synth.integrators.problem": "Accuracy Integration IntegrationError Load Outcome Output Problem State Steps",
    "data_synth.operation.shaft_angle": "ShaftAngle",
    "data_synth.vibration.steady_state": "PeriodicState periodic_state",
}
_HOME = {name: module for module, names in _MODULES.items() for name in names.split()}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'data_synth.dynamics' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
