"""Choice of the integrator: exact transition matrices where the problem allows them, else splitting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from data_synth.integrators.exact_transition import Transition, obstacles
from data_synth.integrators.splitting import Splitting

if TYPE_CHECKING:
    from data_synth.integrators.method import Method
    from data_synth.integrators.problem import Problem


@dataclass(frozen=True, kw_only=True)
class MethodChoice:
    """An integrator with the reason of its choice.

    Attributes
    ----------
    method : Method
        `Transition` or `Splitting`.
    reason : str
        A phrase for a report.

    Examples
    --------
    A load that varies over time excludes exact transition matrices:

    >>> import numpy as np
    >>> from data_synth.dynamics import Body, Load, Problem, ShaftAngle, build_system, method_for
    >>> free = build_system([Body(name="mass", mass_kg=1.0, motions=("x",))], [])
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> load = Load(constant=np.zeros(1), varying=lambda times_s: np.sin(times_s)[:, None])
    >>> choice = method_for(Problem(system=free, reference=steady, load=load, duration_s=1.0))
    >>> choice.method, choice.reason
    (Splitting(), 'the load varies')
    """

    method: Method
    reason: str


def method_for(problem: Problem) -> MethodChoice:
    """Return the integrator for a problem, and why.

    Exact transition matrices have no discretisation error. For the same record they take less than half the time of
    splitting, and about the same where teeth lose contact (docs/benchmarks/integrators.md). So they are taken wherever
    every mesh stiffness is constant between its jumps, the load is constant, and at most three meshes have backlash.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    MethodChoice
        Its reason names the first property of the problem that excludes exact transitions.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Mesh, Problem, Rectangular, ShaftAngle, System, method_for
    >>> mesh = Mesh(name="m", direction=np.ones(1), stiffness=Rectangular(low=1.0, high=2.0, duty=0.4))
    >>> zero = np.zeros((1, 1))
    >>> system = System(mass=np.eye(1), damping=zero, stiffness=zero, meshes=(mesh,), names=("x",))
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=system, reference=steady, load=Load(constant=np.ones(1)), duration_s=1.0)
    >>> method_for(problem).method
    Transition()
    """
    found = obstacles(problem)
    if found:
        return MethodChoice(method=Splitting(), reason=found[0])
    return MethodChoice(method=Transition(), reason="every stiffness is constant between jumps, and so is the load")
