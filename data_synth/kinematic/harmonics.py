"""Families of harmonics of a base order, and their sum as a signal.

In a kinematic scene each shaft and each mesh is a periodic source in the angle of the reference shaft, with harmonics
of declared amplitudes and random phases. A healthy source is not modulated and has no sidebands.
"""

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.operation.shaft_angle import Array

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class HarmonicFamily:
    """Harmonics of a source that is periodic in the angle of the reference shaft.

    Attributes
    ----------
    component, kind : str
        The source, as named by the defect orders.
    source : str
        Source of the transfer functions to the sensors; families with the same source share their gains.
    base_order : Fraction
        Order of the first harmonic.
    coefficients : (k,) or (k, instant) complex array
        Peak amplitude and phase of harmonics 1 to k of `base_order`, in the units of the sensors, with one column for
        each instant of the truth if the source changes.
    load_dependent : bool
        Whether the amplitude is proportional to the tooth load.
    speed_exponent : float
        Exponent of the speed in the amplitude, 2 for an imbalance.
    reference_speed_hz : float
        Speed of the reference shaft in rev s-1 to which speed-dependent `coefficients` refer.
    force : RotatingForce or None
        Force on the housing, for which `coefficients` are the accelerations of its free mass.
    """

    component: str
    kind: str
    source: str
    base_order: Fraction
    coefficients: ComplexArray
    load_dependent: bool
    speed_exponent: float = 0.0
    reference_speed_hz: float = 1.0
    force: "RotatingForce | None" = None

    def later(self, turns: int) -> "HarmonicFamily":
        """Return the family a whole number of revolutions of the reference shaft later."""
        if not turns:
            return self
        phases = [float(turns * order % 1) for order in self.orders]
        return replace(self, coefficients=(self.coefficients.T * np.exp(2j * np.pi * np.array(phases))).T)

    @property
    def orders(self) -> list[Fraction]:
        """Exact orders of all harmonics."""
        return [multiple * self.base_order for multiple in range(1, self.coefficients.shape[0] + 1)]

    @property
    def nonzero(self) -> NDArray[np.bool_]:
        """Whether each harmonic is non-zero at some instant, (k,)."""
        return np.asarray(np.any(np.atleast_2d(self.coefficients.T) != 0, axis=0))


@dataclass(frozen=True, kw_only=True)
class RotatingForce:
    """A force across the axis of a link, on its bearings: ``Re(b exp(j theta))`` for an amplitude of 1.

    Attributes
    ----------
    link : str
        The rotating link.
    direction : (3,) complex array
        b, in the axes of the gearbox.
    """

    link: str
    direction: ComplexArray

    @classmethod
    def across(cls, link: str, *, axis: Array, sense: float) -> "RotatingForce":
        """Return the force that rotates about an axis (3,), a unit vector, in the direction of the sign of `sense`."""
        away = np.eye(3)[int(np.argmin(np.abs(axis)))]
        first = np.cross(axis, away)
        first /= np.linalg.norm(first)
        return cls(link=link, direction=first - 1j * math.copysign(1.0, sense) * np.cross(axis, first))


def common_base(first: Fraction, second: Fraction) -> Fraction:
    """Return the largest order of which both orders are integer multiples."""
    (p, q), (r, s) = first.as_integer_ratio(), second.as_integer_ratio()
    return Fraction(math.gcd(p * s, r * q), q * s)


def add_lines(
    signal: Array, amplitudes: ComplexArray, *, base_order: Fraction, revolutions: Array, position: Array
) -> None:
    """Add ``Re sum_k Z_k exp(j 2 pi k base_order revolutions)`` to a signal, Z linear between its instants.

    Parameters
    ----------
    signal : (channel, n) array
        Signal, modified in place.
    amplitudes : (channel, k, instant) complex array
        Z of harmonics 1 to k of `base_order`.
    base_order : Fraction
        Order of the first harmonic.
    revolutions : (n,) array
        Angle of the reference shaft at the samples, in rev.
    position : (n,) array
        Times of the samples in units of the spacing of the instants: 2.5 is halfway between the third and the fourth.
    """
    from data_synth.kinematic._harmonics_kernels import add_series  # noqa: PLC0415 - loads numba

    last = amplitudes.shape[2] - 2
    first, final = (min(max(int(place), 0), last) for place in (position[0], position[-1]))
    inner = np.searchsorted(position, np.arange(first + 1, final + 1))
    edges = np.concatenate([[0], inner, [position.size]]).astype(np.int64)
    turns = float(base_order) * revolutions
    turns -= np.floor(turns)
    for channel, lines in zip(signal, amplitudes, strict=True):
        instants = lines.T[first : final + 2]
        real, imaginary = np.ascontiguousarray(instants.real), np.ascontiguousarray(instants.imag)
        add_series(channel, real, imaginary, turns, position - first, edges)


# ---- Shaft faults ----------------------------------------------------------------------------------------------------
# The force of an imbalance is proportional to the square of speed; a bent shaft and a misaligned coupling act through
# their stiffness, independent of speed, the coupling mainly at the second harmonic.


_HARMONICS = {"imbalance": ([1.0], 2.0), "bent_shaft": ([1.0, 0.2], 0.0), "shaft_misalignment": ([0.4, 1.0, 0.1], 0.0)}
"""Relative amplitudes of the harmonics 1, 2, ... of the shaft, and the exponent of the speed."""


def shaft_fault_family(
    kind: str, *, component: str, order: Fraction, amplitude: ArrayLike, reference_speed_hz: float, offset: float = 0.0
) -> HarmonicFamily:
    """Return the harmonics that a shaft fault adds, at multiples of the order of the shaft.

    Parameters
    ----------
    kind : str
        Kind of fault, as declared in a scene.
    component : str
        The shaft, as named by the defect orders.
    order : Fraction
        Revolutions of the shaft per revolution of the reference.
    amplitude : float or (instant,) array
        Amplitude at the sensor of its largest harmonic at `reference_speed_hz`, or one for each instant of the truth if
        the fault grows.
    reference_speed_hz : float
        Speed of the reference shaft in rev s-1.
    offset : float
        Revolutions of the shaft at revolution zero.
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
