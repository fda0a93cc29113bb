"""Sidebands of forces whose routes to the sensors turn with planet carriers.

What the angle of a carrier multiplies, the cosines of a rotating direction and the pass window of a planet, is a sum of
``exp(1j j angle)``: where a reading has a line at some order, a route has lines at that plus j times the carrier's.
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.vibration.sensor_forces import PassingMesh, SensorForces

_WAVES = {1: (0.5, -0.5j), -1: (0.5, 0.5j)}  # of a cosine and a sine, by exp(1j angle) and exp(-1j angle)


@dataclass(frozen=True, kw_only=True)
class Sideband:
    """What the routes have of readings at an order beside that of the readings.

    Attributes
    ----------
    shift : Fraction
        Signed order that is added to that of a reading.
    gains : (route, reading) complex array
        Of a line of the readings, at any order.
    static_gains : (route, reading) complex array
        Of the static part of the readings, which a pass window does not modulate.
    static_n : (route, instant) complex array
        Beside that: the static forces of passing meshes, in N.
    """

    shift: Fraction
    gains: ComplexArray = field(repr=False)
    static_gains: ComplexArray = field(repr=False)
    static_n: ComplexArray = field(repr=False)

    @classmethod
    def empty(cls, shift: Fraction, sensor_forces: SensorForces, *, readings: int) -> "Sideband":
        """Return one of which the routes have nothing."""
        routes, instants = len(sensor_forces.routes), sensor_forces.stage.instants_s.size
        gains, static_gains = np.zeros((2, routes, readings), dtype=np.complex128)
        static_n = np.zeros((routes, instants), dtype=np.complex128)
        return cls(shift=shift, gains=gains, static_gains=static_gains, static_n=static_n)


def sidebands_of(sensor_forces: SensorForces, *, readings: int) -> tuple[Sideband, ...]:
    """Return what routes have of readings at each sum of their order and multiples of that of a carrier.

    Without planets that is one, at the same order, each route having its own reading.
    """
    ratio = sensor_forces.stage.scene.ratio
    own = Sideband.empty(Fraction(0), sensor_forces, readings=readings)
    own.gains[...] = own.static_gains[...] = np.eye(*own.gains.shape)
    found = {own.shift: own}

    def at(carrier: str, side: int) -> tuple[Sideband, complex]:
        """Return a sideband of a carrier, and the phasor of its angle at revolution zero."""
        speed_ratio, offset = sensor_forces.carriers[carrier]
        shift = side * abs(ratio(carrier)) * (1 if speed_ratio > 0 else -1)
        if shift not in found:
            found[shift] = Sideband.empty(shift, sensor_forces, readings=readings)
        return found[shift], cmath.rect(1, math.tau * side * offset)

    for turning in sensor_forces.rotating:
        for side, waves in _WAVES.items():
            band, turned = at(turning.carrier, side)
            for gains in (band.gains, band.static_gains):
                gains[turning.route, [turning.first, turning.second]] += np.array(waves) * turned
    for passing in sensor_forces.passing:
        _add_passing(passing, sensor_forces, at)
    return tuple(found.values())


def _add_passing(
    passing: PassingMesh, sensor_forces: SensorForces, at: Callable[[str, int], tuple[Sideband, complex]]
) -> None:
    """Add the force of a ring mesh to the sidebands of its carrier."""
    assert sensor_forces.window is not None  # noqa: S101 - planets pass by it
    lines = sensor_forces.window.coefficients()
    for side in range(1 - lines.size, lines.size):
        band, turned = at(passing.carrier, side)
        turned *= passing.weight * cmath.rect(1, side * passing.place_rad)
        band.gains[passing.route, passing.reading] += lines[abs(side)] * turned
    for side, (cosine, sine) in {0: (0.0, 0.0), **_WAVES}.items():
        band, turned = at(passing.carrier, side)
        turned *= cosine * passing.first + sine * passing.second + (0.0 if side else passing.axial)
        if passing.rigid:
            band.gains[passing.route, passing.reading] -= passing.rigid * turned
        elif passing.contact in sensor_forces.static_n:
            band.static_n[passing.route] += passing.weight * turned * sensor_forces.static_n[passing.contact]
