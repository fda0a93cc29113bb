"""What damage of a shaft adds: lines at its own turns, and the forces that make them.

Imbalance pulls with the square of the speed; a bow and a misaligned coupling push by their stiffness, whatever the
speed, the coupling mostly twice a turn.
"""

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.combs import HarmonicFamily
from data_synth.profile import Array

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class ShaftExcitation:
    """A force that turns with a shaft: ``Re sum_k size shares_k (speed / at_speed)^power exp(2 pi j k turns)``.

    Attributes
    ----------
    coefficients : (k,) complex array
        Of the lines at 1, 2, ... k times the turns, in phase and size.
    speed_exponent : int
        How the force grows with speed.
    """

    coefficients: ComplexArray = field(metadata={"dims": ("harmonic",), "units": "1"})
    speed_exponent: int

    def force(
        self, turns: ArrayLike, *, speed_hz: ArrayLike, size_n: float, reference_speed_hz: float, twist: float = 0.0
    ) -> Array:
        """Return the force (n,) in N at `turns` (n,) of the shaft, `size_n` at `reference_speed_hz`.

        `twist`, in turns, is where on the shaft the direction lies that is asked for: 0 for x, 1/4 for y.
        """
        angle = 2 * np.pi * (np.asarray(turns, dtype=np.float64) - twist)
        number = np.arange(1, self.coefficients.size + 1)
        waves = np.exp(1j * np.multiply.outer(angle, number)) @ self.coefficients
        growth = np.abs(np.asarray(speed_hz, dtype=np.float64) / reference_speed_hz) ** self.speed_exponent
        return np.asarray(size_n * growth * waves.real)


def imbalance(*, phase_rad: float = 0.0) -> ShaftExcitation:
    """Return a mass off the axis: once a turn, with the square of the speed, heavy at `phase_rad` from the datum."""
    return ShaftExcitation(coefficients=np.array([np.exp(-1j * phase_rad)]), speed_exponent=2)


def bent_shaft(*, phase_rad: float = 0.0, twice: float = 0.2) -> ShaftExcitation:
    """Return a bow held by the bearings: once a turn, `twice` as much of it twice, whatever the speed."""
    return ShaftExcitation(coefficients=np.exp(-1j * phase_rad * np.array([1, 2])) * [1, twice], speed_exponent=0)


def shaft_misalignment(*, phase_rad: float = 0.0, once: float = 0.4, thrice: float = 0.1) -> ShaftExcitation:
    """Return a coupling out of line: twice a turn, and shares of it once and three times, whatever the speed."""
    return ShaftExcitation(
        coefficients=np.exp(-1j * phase_rad * np.array([1, 2, 3])) * [once, 1, thrice], speed_exponent=0
    )


def imbalance_force_n(*, mass_kg: float, eccentricity_m: float, speed_hz: float) -> float:
    """Return ``m e w^2``: what `imbalance` needs as its size at `speed_hz` (rev s-1)."""
    return mass_kg * eccentricity_m * (2 * np.pi * speed_hz) ** 2


def shaft_fault_family(
    excitation: ShaftExcitation,
    *,
    component: str,
    order: Fraction,
    amplitude: ArrayLike,
    reference_speed_hz: float,
    offset: float = 0.0,
) -> HarmonicFamily:
    """Return the lines a faulty shaft adds at multiples of its own order, and at no other.

    Parameters
    ----------
    excitation : ShaftExcitation
    component : str
        The shaft, in the words of the defect orders.
    order : Fraction
        Turns of the shaft for one of the reference.
    amplitude : float or (instant,) array
        Amplitude at the sensor, at `reference_speed_hz`, of a coefficient of 1: one number, or one for each instant of
        the truth where the fault grows.
    reference_speed_hz : float
        Speed of the reference shaft, rev s-1.
    offset : float
        Turns of the shaft at revolution zero.
    """
    number = np.arange(1, excitation.coefficients.size + 1)
    lines = excitation.coefficients * np.exp(2j * np.pi * offset * number)
    return HarmonicFamily(
        component=component,
        kind="shaft",
        source=component,
        base_order=order,
        coefficients=np.multiply.outer(lines, np.asarray(amplitude, dtype=np.float64)),
        load_dependent=False,
        speed_exponent=excitation.speed_exponent,
        reference_speed_hz=reference_speed_hz,
    )
