"""What is integrated, what is asked of it, how exactly, and what came of it: four kinds of frozen objects."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.mechanics import System

Array = NDArray[np.float64]


class Turning(Protocol):
    """Angle of the reference shaft over time, as `data_synth.profile.ShaftAngle` knows it."""

    def revolutions(self, times_s: ArrayLike) -> Array:
        """Return the angle in revolutions at times in s (n,)."""

    def times(self, revolutions: ArrayLike) -> Array:
        """Return the times in s at which the shaft reaches revolutions (n,)."""


@dataclass(frozen=True, kw_only=True)
class TiedTo:
    """The reference turns with a degree of freedom, so meshes feel its vibration: revolutions = q * rev_per_unit."""

    name: str
    rev_per_unit: float = 1 / (2 * np.pi)


@dataclass(frozen=True, kw_only=True)
class Load:
    """What acts from outside: ``F(t) = constant + varying(t) - quadratic_drag v abs(v)``, entry by entry.

    Attributes
    ----------
    constant : (dof,) array
        N and N m.
    quadratic_drag : (dof,) array or None
        N s2/m2 and N m s2/rad2, none below zero.
    varying : callable or None
        From times in s (n,) to forces (n, dof).
    """

    constant: Array = field(metadata={"dims": ("dof",), "units": "N or N m"})
    quadratic_drag: Array | None = None
    varying: Callable[[Array], Array] | None = None


@dataclass(frozen=True, kw_only=True)
class State:
    """Displacements and velocities (dof,), in m, rad, m/s, rad/s."""

    displacement: Array = field(metadata={"dims": ("dof",), "units": "m or rad"})
    velocity: Array = field(metadata={"dims": ("dof",), "units": "m/s or rad/s"})


@dataclass(frozen=True, kw_only=True)
class Problem:
    """An initial value problem: a system, how its reference turns, its load, its start, and for how long."""

    system: System
    turning: Turning | TiedTo
    load: Load
    duration_s: float
    start: State | None = None
    start_s: float = 0.0

    def __post_init__(self) -> None:
        dof = len(self.system.names)
        if not (np.isfinite(self.duration_s) and self.duration_s > 0):
            raise ValueError(f"duration_s={self.duration_s} must be finite and above zero.")
        drag = self.load.quadratic_drag
        start = self.start or State(displacement=np.zeros(dof), velocity=np.zeros(dof))
        for name, value in (
            ("load.constant", self.load.constant),
            ("load.quadratic_drag", np.zeros(dof) if drag is None else drag),
            ("start.displacement", start.displacement),
            ("start.velocity", start.velocity),
        ):
            if np.shape(value) != (dof,) or not np.all(np.isfinite(value)):
                raise ValueError(f"{name}={value} must hold {dof} finite numbers, one per degree of freedom.")
        if drag is not None and np.any(drag < 0):
            raise ValueError(f"load.quadratic_drag={drag} feeds energy in where it is below zero; give the magnitude.")
        if isinstance(self.turning, TiedTo) and self.turning.name not in self.system.names:
            raise ValueError(
                f"the reference is tied to {self.turning.name!r}, which is none of {', '.join(self.system.names)}."
            )


@dataclass(frozen=True, kw_only=True)
class Output:
    """Channels, each any linear map of motion and mesh forces, at any rate: the sum of the maps that are given.

    Attributes
    ----------
    rate_hz : float
        Samples lie at ``start_s + i / rate_hz``, i = 0, 1, ...
    displacement, velocity, acceleration : (channels, dof) arrays or None
    mesh_force : (channels, meshes) array or None
        Of the elastic force in each mesh, ``k f(g . q - e)`` in N.
    hat_mesh_force : (channels, meshes) array or None
        Of that force weighted with a hat, from nothing two samples ago over all at the one before to nothing now; the
        force is taken to have been the same before the start. Jumps of the stiffness alias far less in it than in
        values at samples.
    """

    rate_hz: float
    displacement: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    mesh_force: Array | None = None
    hat_mesh_force: Array | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"rate_hz={self.rate_hz} must be finite and above zero.")
        shapes = {np.shape(m)[0] for m in self.maps.values()}
        if len(shapes) != 1:
            raise ValueError(f"the maps {[*self.maps]} need one row per channel each; they have {sorted(shapes)}.")

    @property
    def maps(self) -> dict[str, Array]:
        """The maps that are given, by name."""
        names = ("displacement", "velocity", "acceleration", "mesh_force", "hat_mesh_force")
        named = {name: getattr(self, name) for name in names}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def channels(self) -> int:
        """How many there are."""
        return int(next(iter(self.maps.values())).shape[0])


@dataclass(frozen=True, kw_only=True)
class Steps:
    """A fixed number of steps to each sample of the output."""

    per_sample: int

    def __post_init__(self) -> None:
        if self.per_sample < 1:
            raise ValueError(f"per_sample={self.per_sample}: at least one step is needed to each sample.")


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """As many steps as keep the RMS error of every channel below `relative` of its RMS, judged on a trial stretch.

    The trial is the first `trial` of the record, run with steps of one size and of half of it; phase errors grow
    with time, so what they differ by is scaled up to the whole record. With `about_mean` the RMS is that about the
    mean, no less than a thousandth of the other: of channels that are heard without their mean.
    """

    relative: float
    trial: float = 0.04
    most_per_sample: int = 256
    about_mean: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.relative < 1 or not 0 < self.trial <= 1:
            raise ValueError(f"relative={self.relative} and trial={self.trial} must lie between zero and one.")


class Outcome(Enum):
    """How an integration ended; the value says what to do."""

    DONE = "nothing to do"
    UNSTABLE_STEP = "take more steps to a sample"
    UNRESOLVED_STEP = "take more steps to a sample, so that each mesh cycle and each mode is resolved"
    TOLERANCE_NOT_REACHED = "ask for less, or allow more steps to a sample (most_per_sample)"
    NOT_CONVERGED = "start nearer to a solution, or follow it from a case that converges in smaller changes"
    DIVERGED = "check the load and the damping: the motion itself grows, or take more steps to a sample"


class IntegrationError(ArithmeticError):
    """An integration that did not end well, with its outcome's numbers and remedy."""


@dataclass(frozen=True, kw_only=True)
class Integration:
    """What came of it.

    Attributes
    ----------
    times_s : (n,) array
    values : (n, channels) array
        Empty where the steps were refused.
    outcome : Outcome
    detail : str
        The numbers behind the outcome.
    final : State or None
        Where the motion stood at the last sample.
    steps_per_sample : int
    estimated_error : float
        Of the worst channel, relative to its RMS; NaN where the number of steps was given.
    """

    times_s: Array = field(metadata={"dims": ("time",), "units": "s"})
    values: Array = field(metadata={"dims": ("time", "channel"), "units": "of the maps"})
    outcome: Outcome
    detail: str
    final: State | None
    steps_per_sample: int
    estimated_error: float = float("nan")

    def checked(self) -> "Integration":
        """Return this, or raise IntegrationError with what went wrong and what to do."""
        if self.outcome is not Outcome.DONE:
            raise IntegrationError(f"{self.detail} To do: {self.outcome.value}.")
        return self
