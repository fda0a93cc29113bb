"""Data classes of a time integration: problem, output and result."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.dynamics.system import System

Array = NDArray[np.float64]


class ReferenceAngle(Protocol):
    """Prescribed angle of the reference shaft over time, such as `data_synth.operation.shaft_angle.ShaftAngle`."""

    def revolutions(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at times in s (n,)."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """External forces: ``F(t) = constant + varying(t) - quadratic_drag v abs(v)``, elementwise.

    Attributes
    ----------
    constant : (dof,) array
        N and N m.
    quadratic_drag : (dof,) array or None
        N s2/m2 and N m s2/rad2, not negative; that of a fan or a propeller, for example.
    varying : callable or None
        Takes times (n,) in s; returns forces (n, dof) in N and N m or, with `directions`, their factors (n, k).
    directions : (k, dof) array or None
        Forces for which `varying` returns the factors; fewer forces than degrees of freedom save time.

    Examples
    --------
    A driving torque of 75 N m and a load proportional to the square of the speed:

    >>> import numpy as np
    >>> from data_synth.dynamics import Load
    >>> load = Load(constant=np.array([75.0, 0.0]), quadratic_drag=np.array([0.0, 0.0075]))
    >>> load.varying is None
    True
    """

    constant: Array = field(metadata={"dims": ("dof",), "units": "N or N m"})
    quadratic_drag: Array | None = None
    varying: Callable[[Array], Array] | None = None
    directions: Array | None = None

    def varying_at(self, times_s: Array) -> Array:
        """Return the varying forces (n, dof) at times (n,) in s; zero if there are none."""
        if self.varying is None:
            return np.zeros((times_s.size, self.constant.size))
        values = np.asarray(self.varying(times_s))
        return values if self.directions is None else np.asarray(values @ self.directions)


@dataclass(frozen=True, kw_only=True)
class State:
    """Displacements and velocities of all degrees of freedom at one instant.

    Attributes
    ----------
    displacement : (dof,) array
        m and rad.
    velocity : (dof,) array
        m/s and rad/s.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import State
    >>> State(displacement=np.array([1e-3]), velocity=np.zeros(1)).displacement.tolist()
    [0.001]
    """

    displacement: Array = field(metadata={"dims": ("dof",), "units": "m or rad"})
    velocity: Array = field(metadata={"dims": ("dof",), "units": "m/s or rad/s"})


@dataclass(frozen=True, kw_only=True)
class Problem:
    """An initial value problem of the equations of motion.

    Attributes
    ----------
    system : System
        Equations of motion.
    reference : ReferenceAngle
        Prescribed angle of the reference shaft, which determines the mesh phases.
    load : Load
        External forces.
    duration_s : float
        Duration in s.
    start : State or None
        Initial state; at rest without displacement if left out.
    start_s : float
        Initial time in s.
    shifts : tuple of (time in s, State)
        Increment of the state at the sample nearest to each time, for example so that a load step excites no free
        vibration.

    Raises
    ------
    ValueError
        If the duration is not positive, an array does not fit the system, or a drag is negative.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import Load, Problem, ShaftAngle, System
    >>> one = np.eye(1)
    >>> system = System(mass=one, damping=0 * one, stiffness=4 * one, meshes=(), names=("mass x",))
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([25.0]))  # 25 Hz from 0 s on
    >>> problem = Problem(system=system, reference=steady, load=Load(constant=np.zeros(1)), duration_s=1.0)
    >>> problem.reference.revolutions([0.5]).tolist()
    [12.5]
    """

    system: System
    reference: ReferenceAngle
    load: Load
    duration_s: float
    start: State | None = None
    start_s: float = 0.0
    shifts: tuple[tuple[float, State], ...] = ()

    def __post_init__(self) -> None:
        dof = len(self.system.names)
        if not (np.isfinite(self.duration_s) and self.duration_s > 0):
            raise ValueError(f"duration_s = {self.duration_s} must be finite and above zero.")
        drag = self.load.quadratic_drag
        start = self.start or State(displacement=np.zeros(dof), velocity=np.zeros(dof))
        for name, value in (
            ("load.constant", self.load.constant),
            ("load.quadratic_drag", np.zeros(dof) if drag is None else drag),
            ("start.displacement", start.displacement),
            ("start.velocity", start.velocity),
        ):
            if np.shape(value) != (dof,) or not np.all(np.isfinite(value)):
                raise ValueError(f"{name} = {value} must hold {dof} finite numbers, one per degree of freedom.")
        if drag is not None and np.any(drag < 0):
            raise ValueError(f"load.quadratic_drag = {drag} must not be negative, which would supply energy.")


@dataclass(frozen=True, kw_only=True)
class Output:
    """Output channels, sums of linear maps of motion and mesh forces, and their sampling rate.

    Attributes
    ----------
    rate_hz : float
        Sampling rate in Hz; samples are at ``start_s + i / rate_hz``, i = 0, 1, ...
    displacement, velocity : (channels, dof) arrays or None
        Maps of the motion.
    mesh_force : (channels, meshes) array or None
        Map of the elastic force in each mesh, ``k f(g . q - e)`` in N.
    weighted_mesh_force : (channels, meshes) array or None
        Map of the mean of that force with a triangular weight (linear B-spline) over the last two sample intervals,
        centred at the previous sample; the force is assumed constant before the start. Jumps of the stiffness alias
        far less in it than in samples of the force.

    Raises
    ------
    ValueError
        If the rate is not positive, there is no map, or the maps differ in their number of channels.

    Examples
    --------
    The extension of a spring between two degrees of freedom, and the velocity of the first:

    >>> import numpy as np
    >>> from data_synth.dynamics import Output
    >>> Output(
    ...     rate_hz=1000.0,
    ...     displacement=np.array([[1.0, -1.0], [0.0, 0.0]]),
    ...     velocity=np.array([[0.0, 0.0], [1.0, 0.0]]),
    ... ).channels
    2
    """

    rate_hz: float
    displacement: Array | None = None
    velocity: Array | None = None
    mesh_force: Array | None = None
    weighted_mesh_force: Array | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"rate_hz = {self.rate_hz} must be finite and above zero.")
        shapes = {np.shape(m)[0] for m in self.maps.values()}
        if len(shapes) != 1:
            raise ValueError(
                f"the maps {[*self.maps]} must each have one row per channel, but have {sorted(shapes)} rows; give at "
                "least one map, and as many rows to all."
            )

    @property
    def maps(self) -> dict[str, Array]:
        """The maps that are given, by name."""
        names = ("displacement", "velocity", "mesh_force", "weighted_mesh_force")
        named = {name: getattr(self, name) for name in names}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(next(iter(self.maps.values())).shape[0])


class IntegrationError(ArithmeticError):
    """An integration that failed: the reason with its figures (`detail`), and the remedy.

    Examples
    --------
    `integrate` and `integrate_blocks` raise it:

    >>> from data_synth.dynamics import IntegrationError
    >>> print(IntegrationError("A step of 0.1 s is unstable."))
    A step of 0.1 s is unstable. To do: take more steps per sample.
    """

    def __init__(self, detail: str, remedy: str = "take more steps per sample") -> None:
        super().__init__(detail, remedy)
        self.detail, self.remedy = detail, remedy

    def __str__(self) -> str:
        return f"{self.detail} To do: {self.remedy}."


@dataclass(frozen=True, kw_only=True)
class Integration:
    """Result of a time integration.

    Attributes
    ----------
    times_s : (n,) array
        Sample times in s.
    values : (n, channels) array
        Channels in the units of their maps.
    final : State
        State at the last sample.

    Examples
    --------
    A mass of 1 kg under a force of 1 N moves as t^2 / 2:

    >>> import numpy as np
    >>> from data_synth.dynamics import (
    ...     Body, Load, Output, Problem, ShaftAngle, build_system, integrate,
    ... )
    >>> free = build_system([Body(name="mass", mass_kg=1.0, motions=("x",))], [])
    >>> steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1))
    >>> problem = Problem(system=free, reference=steady, load=Load(constant=np.ones(1)), duration_s=2.0)
    >>> output = Output(rate_hz=10.0, displacement=np.eye(1))
    >>> found = integrate(problem, output=output, steps=1)
    >>> found.values.shape, round(float(found.values[-1, 0]), 9)
    ((21, 1), 2.0)
    """

    times_s: Array = field(metadata={"dims": ("time",), "units": "s"})
    values: Array = field(metadata={"dims": ("time", "channel"), "units": "of the maps"})
    final: State
