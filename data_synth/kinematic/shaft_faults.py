"""Shaft faults: the harmonics of the shaft that they add.

The force of an imbalance is proportional to the square of speed; a bent shaft and a misaligned coupling act through
their stiffness, independent of speed, the coupling mostly at the second harmonic.
"""

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from data_synth.kinematic.harmonics import HarmonicFamily

_HARMONICS = {"imbalance": ([1.0], 2.0), "bent_shaft": ([1.0, 0.2], 0.0), "shaft_misalignment": ([0.4, 1.0, 0.1], 0.0)}
"""Relative amplitudes of the harmonics 1, 2, ... of the shaft, and the exponent of the speed."""


def shaft_fault_family(
    kind: str, *, component: str, order: Fraction, amplitude: ArrayLike, reference_speed_hz: float, offset: float = 0.0
) -> HarmonicFamily:
    """Return the harmonics that a shaft fault adds, at multiples of the shaft's order.

    Parameters
    ----------
    kind : str
        As a scene declares it.
    component : str
        The shaft, as the defect orders name it.
    order : Fraction
        Revolutions of the shaft for one of the reference.
    amplitude : float or (instant,) array
        Amplitude at the sensor, at `reference_speed_hz`, of its largest harmonic: one number, or one for each instant
        of the truth where the fault grows.
    reference_speed_hz : float
        Speed of the reference shaft, rev s-1.
    offset : float
        Turns of the shaft at revolution zero.
    """
    relative, speed_exponent = _HARMONICS[kind]
    lines = np.array(relative) * np.exp(2j * np.pi * offset * np.arange(1, len(relative) + 1))
    return HarmonicFamily(
        component=component,
        kind="shaft",
        source=component,
        base_order=order,
        coefficients=np.multiply.outer(lines, np.asarray(amplitude, dtype=np.float64)),
        load_dependent=False,
        speed_exponent=speed_exponent,
        reference_speed_hz=reference_speed_hz,
    )
