"""Dynamics of a bearing: shaft and housing joined by Hertzian contacts, and a resonator on the housing.

Five degrees of freedom, after Sawalhi and Randall (2008, Mech. Syst. Signal Process. 22, 1924-1951): the shaft with the
inner ring in x and y, the pedestal with the outer ring in x and y, and a small mass on the pedestal in y, which stands
for a mode of the housing. The compression of element i at angle phi_i is

``delta_i = (x_s - x_p) cos phi_i + (y_s - y_p) sin phi_i - clearance - spall(phi_i)``

and its force ``k delta ** exponent`` while delta is above zero. Elements have no mass and move with the cage, so slip
enters through the rotation of the cage.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from data_synth.operation.shaft_angle import Array

NAMES = ("shaft x", "shaft y", "pedestal x", "pedestal y", "resonator y")
_STABLE = 2.7  # of the classical Runge-Kutta method: largest step times angular frequency, 2.83, with room to spare


@dataclass(frozen=True, kw_only=True)
class Support:
    """A mass on a spring and a damper.

    Attributes
    ----------
    mass_kg, damping_n_s_m, stiffness_n_m : float
        The mass above zero, the others not negative.
    """

    mass_kg: float
    damping_n_s_m: float
    stiffness_n_m: float

    def __post_init__(self) -> None:
        if not (self.mass_kg > 0 and self.damping_n_s_m >= 0 and self.stiffness_n_m >= 0):
            raise ValueError(f"{self}: a mass above zero, and damping and stiffness not below, are needed")

    @classmethod
    def resonant(cls, *, mass_kg: float, frequency_hz: float, damping_ratio: float) -> "Support":
        """Return a mass with a natural frequency and damping ratio on a fixed base."""
        natural = 2 * math.pi * frequency_hz
        return cls(
            mass_kg=mass_kg,
            damping_n_s_m=2 * damping_ratio * mass_kg * natural,
            stiffness_n_m=mass_kg * natural**2,
        )


@dataclass(frozen=True, kw_only=True)
class Spall:
    """A spall with a half-cosine profile, deepest in the middle.

    Attributes
    ----------
    of : {"ring", "element"}
        On a ring; or on element 1, which meets the outer race at whole turns about its own axis, the inner one between.
    middle_rad : float
        Place on a ring, at turn 0.
    width_rad : float
        From end to end: its length over the radius of its surface.
    depth_m : float
        Lost compression in the middle. An element that bridges the spall sinks in by ``length^2 / (4 d)`` at most, d
        its diameter.
    """

    of: Literal["ring", "element"]
    middle_rad: float = 0.0
    width_rad: float
    depth_m: float


@dataclass(frozen=True, kw_only=True)
class BearingModel:
    """Parameters of a bearing between a shaft and a pedestal.

    Attributes
    ----------
    elements : int
    contact_n_m : float
        k of one element between both races, in N m^-exponent: some 1e9 to 1e10 for steel balls.
    exponent : float
        3/2 for balls, 10/9 for rollers.
    clearance_m : float
        Half the diametral clearance; negative under preload.
    shaft, pedestal, resonator : Support
        The resonator's spring and damper connect it to the pedestal, those of the others to the ground.
    spall : Spall or None
    """

    elements: int
    contact_n_m: float
    exponent: float = 1.5
    clearance_m: float
    shaft: Support
    pedestal: Support
    resonator: Support
    spall: Spall | None = None

    def parameters(self) -> Array:
        """Return masses, dampers, springs, then contact stiffness, exponent and clearance, as the kernel reads them."""
        supports = (self.shaft, self.pedestal, self.resonator)
        return np.array(
            [
                *(support.mass_kg for support in supports),
                *(support.damping_n_s_m for support in supports),
                *(support.stiffness_n_m for support in supports),
                self.contact_n_m,
                self.exponent,
                self.clearance_m,
            ]
        )

    def spall_parameters(self) -> Array:
        """Return the spall as the kernel reads it: type (0 none, 1 ring, 2 element), middle, half width, depth."""
        if self.spall is None:
            return np.zeros(4)
        of = {"ring": 1.0, "element": 2.0}[self.spall.of]
        return np.array([of, self.spall.middle_rad, self.spall.width_rad / 2, self.spall.depth_m])

    def highest_rad_s(self, force_n: float) -> float:
        """Return an upper bound of the natural frequencies in rad s-1 under a load of `force_n` and the preload.

        Impacts in a spall may load a contact further for a moment.
        """
        # one contact that carries all is the stiffest way to do so; under preload all of them push
        compression = (force_n / self.contact_n_m) ** (1 / self.exponent)
        preload = max(-self.clearance_m, 0.0)
        slopes = compression ** (self.exponent - 1) + self.elements * preload ** (self.exponent - 1)
        contact = self.exponent * self.contact_n_m * slopes
        shaft = (self.shaft.stiffness_n_m + 2 * contact) / self.shaft.mass_kg
        pedestal = (
            self.pedestal.stiffness_n_m + 2 * contact + 2 * self.resonator.stiffness_n_m
        ) / self.pedestal.mass_kg
        return math.sqrt(max(shaft, pedestal, 2 * self.resonator.stiffness_n_m / self.resonator.mass_kg))


@dataclass(frozen=True, kw_only=True)
class BearingMotion:
    """The response of a bearing.

    Attributes
    ----------
    displacement_m, velocity_m_s, acceleration_m_s2 : (m + 1, 5) array
        Of shaft x, shaft y, pedestal x, pedestal y, resonator y.
    contact_n : (m + 1, z) array
        Contact force of each element.
    state : (10,) array
        At the last instant: the initial state of the next block.
    """

    displacement_m: Array = field(metadata={"dims": ("time", "freedom"), "units": "m"})
    velocity_m_s: Array = field(metadata={"dims": ("time", "freedom"), "units": "m s-1"})
    acceleration_m_s2: Array = field(metadata={"dims": ("time", "freedom"), "units": "m s-2"})
    contact_n: Array = field(metadata={"dims": ("time", "element"), "units": "N"})
    state: Array = field(metadata={"dims": ("state",), "units": "m, m s-1"})


def integrate_bearing(
    model: BearingModel,
    *,
    cage_turns: ArrayLike,
    defect_turns: ArrayLike,
    load_n: ArrayLike,
    step_s: float,
    state: ArrayLike | None = None,
) -> BearingMotion:
    """Integrate the motion over m steps by the classical Runge-Kutta method of order 4.

    Parameters
    ----------
    model : BearingModel
    cage_turns, defect_turns : (2 m + 1,) array
        Turns of the cage, and of the part with the spall, at half steps: ``0, 1/2, 1, ... m`` steps from the beginning.
        Those of an element are about its own axis.
    load_n : (2, 2 m + 1) array, or (2,)
        Force on the shaft in x and y, its weight included.
    step_s : float
        Length of a step.
    state : (10,) array, optional
        Initial displacements, then velocities: those of the block before. At rest if left out.

    Raises
    ------
    ValueError
        Turns or load of another length, or a step too long to be stable, with the longest that is.
    """
    from data_synth.bearings._five_dof_kernels import runge_kutta  # noqa: PLC0415 - loads numba

    cage, spot = (np.asarray(turns, dtype=np.float64) for turns in (cage_turns, defect_turns))
    if cage.ndim != 1 or cage.shape != spot.shape or cage.size < 3 or cage.size % 2 == 0:  # noqa: PLR2004
        raise ValueError(
            f"cage_turns and spot_turns have shapes {cage.shape} and {spot.shape}; give 2 m + 1 of each, at half steps"
        )
    load = np.asarray(load_n, dtype=np.float64)
    if load.shape not in {(2,), (2, cage.size)}:
        raise ValueError(f"load_n has shape {load.shape}; give (2,) or (2, {cage.size})")
    load = np.ascontiguousarray(np.broadcast_to(load[:, None] if load.ndim == 1 else load, (2, cage.size)))
    force = float(np.max(np.hypot(load[0], load[1])))
    longest = _STABLE / model.highest_rad_s(force)
    if not 0 < step_s <= longest:
        stable = 0.99 * longest  # so that three digits of it are, too
        raise ValueError(f"step_s = {step_s:g} is not stable with this bearing; keep it at {stable:.3g} or below")
    steps = cage.size // 2
    now = np.zeros(10) if state is None else np.array(state, dtype=np.float64)
    motion, acceleration = np.empty((steps + 1, 10)), np.empty((steps + 1, 5))
    contact = np.empty((steps + 1, model.elements))
    turns = (2 * np.pi * np.remainder(cage, 1.0), 2 * np.pi * np.remainder(spot, 1.0))
    runge_kutta(now, *turns, load, step_s, model.parameters(), model.spall_parameters(), motion, acceleration, contact)
    if not np.all(np.isfinite(now)):
        raise ValueError(f"the motion ran away with step_s = {step_s:g}; shorten it")
    return BearingMotion(
        displacement_m=motion[:, :5],
        velocity_m_s=motion[:, 5:],
        acceleration_m_s2=acceleration,
        contact_n=contact,
        state=now,
    )
