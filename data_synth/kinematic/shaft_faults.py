"""Shaft faults: the harmonics of the shaft they add, and the forces that cause them.

The force of an imbalance is proportional to the square of speed; a bent shaft and a misaligned coupling act through
their stiffness, independent of speed, the coupling mostly at the second harmonic.
"""

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.kinematic.harmonics import HarmonicFamily
from data_synth.operation.shaft_angle import Array

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class ShaftExcitation:
    """A force rotating with a shaft: ``Re sum_k size c_k (speed / reference speed)^exponent exp(2 pi j k turns)``.

    Attributes
    ----------
    coefficients : (k,) complex array
        c_k of the harmonics 1, 2, ... k of the shaft.
    speed_exponent : int
        Exponent of the speed in the force.
    """

    coefficients: ComplexArray = field(metadata={"dims": ("harmonic",), "units": "1"})
    speed_exponent: int

    def force(
        self, turns: ArrayLike, *, speed_hz: ArrayLike, size_n: float, reference_speed_hz: float, twist: float = 0.0
    ) -> Array:
        """Return the force (n,) in N at `turns` (n,) of the shaft, `size_n` at `reference_speed_hz`.

        `twist`, in turns, is the direction on the shaft: 0 for x, 1/4 for y.
        """
        angle = 2 * np.pi * (np.asarray(turns, dtype=np.float64) - twist)
        number = np.arange(1, self.coefficients.size + 1)
        waves = np.exp(1j * np.multiply.outer(angle, number)) @ self.coefficients
        growth = np.abs(np.asarray(speed_hz, dtype=np.float64) / reference_speed_hz) ** self.speed_exponent
        return np.asarray(size_n * growth * waves.real)


def imbalance(*, phase_rad: float = 0.0) -> ShaftExcitation:
    """Return the force of an imbalance at `phase_rad` from the datum: first harmonic, square of the speed."""
    return ShaftExcitation(coefficients=np.array([np.exp(-1j * phase_rad)]), speed_exponent=2)


def bent_shaft(*, phase_rad: float = 0.0, twice: float = 0.2) -> ShaftExcitation:
    """Return the force of a bent shaft: first harmonic, and `twice` as much at the second, independent of speed."""
    return ShaftExcitation(coefficients=np.exp(-1j * phase_rad * np.array([1, 2])) * [1, twice], speed_exponent=0)


def shaft_misalignment(*, phase_rad: float = 0.0, once: float = 0.4, thrice: float = 0.1) -> ShaftExcitation:
    """Return the force of a misaligned coupling: mostly the second harmonic, independent of speed."""
    return ShaftExcitation(
        coefficients=np.exp(-1j * phase_rad * np.array([1, 2, 3])) * [once, 1, thrice], speed_exponent=0
    )


def imbalance_force_n(*, mass_kg: float, eccentricity_m: float, speed_hz: float) -> float:
    """Return ``m e w^2`` in N at `speed_hz` (rev s-1), the size of `imbalance`."""
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
    """Return the harmonics that a shaft fault adds, at multiples of the shaft's order.

    Parameters
    ----------
    excitation : ShaftExcitation
    component : str
        The shaft, as the defect orders name it.
    order : Fraction
        Revolutions of the shaft for one of the reference.
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
