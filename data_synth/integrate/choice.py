"""Which integrator a problem takes: exact transitions where they are exact, else splitting."""

from dataclasses import dataclass

from data_synth.integrate.exact import Transition, obstacles
from data_synth.integrate.problem import Problem
from data_synth.integrate.splitting import Splitting
from data_synth.integrate.stepping import Method


@dataclass(frozen=True, kw_only=True)
class MethodChoice:
    """A method, and in words why it is taken."""

    method: Method
    reason: str


def method_for(problem: Problem) -> MethodChoice:
    """Return the integrator for a problem.

    Exact transitions have no error of steps. For the same record they take less than half the time of splitting, and
    where teeth part about the same (docs/benchmarks/integrators.md). So they are taken wherever every mesh stiffness is
    constant between jumps and what acts is constant, with at most three gaps. The reason names the first thing that
    stands in their way.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.integrate import Load, Problem, method_for
    >>> from data_synth.mechanics import Mesh, System
    >>> from data_synth.mesh import Rectangular
    >>> from data_synth.profile import ShaftAngle
    >>> mesh = Mesh(name="m", direction=np.ones(1), stiffness=Rectangular(low=1.0, high=2.0, duty=0.4))
    >>> zero = np.zeros((1, 1))
    >>> system = System(mass=np.eye(1), damping=zero, stiffness=zero, meshes=(mesh,), names=("x",))
    >>> turning = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=system, turning=turning, load=Load(constant=np.ones(1)), duration_s=1.0)
    >>> method_for(problem).method
    Transition()
    """
    found = obstacles(problem)
    if found:
        return MethodChoice(method=Splitting(), reason=found[0])
    return MethodChoice(method=Transition(), reason="every stiffness is constant between jumps, and so is the load")
