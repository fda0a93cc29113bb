"""Lines that are expected of gears in motion: the response to their exciting forces against speed and time."""

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_STENCIL = 0.25  # of the share of speed in which a mode is passed: the step of second differences
_LAGS = 5e-3  # of the loudest line of a family: what others lag behind the speed is below 1e-4 of it


@dataclass(frozen=True, kw_only=True)
class ExpectedLines:
    """Lines at the multiples of an order, from their exciting forces at some speeds.

    Where the speed changes, Z lags behind the steady response by ``(j / 2) (domega / dt) d2Z / domega2``, omega the
    angular frequency of the line: the first of the series of a response to a sweep (Carson and Fry 1937, Bell Syst.
    Tech. J. 16, 513), here with all that a mesh makes of its own vibration as part of the response.

    Attributes
    ----------
    base_order : Fraction
        Order of the first; the others are its multiples.
    forces : (node, input, mesh, k) complex array
        Exciting force in each mesh per unit of each input, at some speeds.
    speeds_hz : (node,) array
        Of the reference in rev s-1.
    slow_hz : float
        With this added, speeds rise by one factor.
    inputs_n : (input, instant) array
        At the instants of the truth: static forces in N, and 1 for what is excited without any, whose forces are in N.
    speed_hz, rates : (instant,) arrays
        Speed of the reference in rev s-1, not below zero, and its rate in rev s-2.
    damping : float
        Least damping ratio of the modes: the share of the speed in which a line passes half the width of one.
    frequency_hz : (f,) array
        Even, from zero.
    transfer : (mesh, channel, f) complex array
        Complex amplitude in each channel per N of exciting force, in single precision as the forces.
    """

    base_order: Fraction
    forces: NDArray[np.complex64] = field(repr=False)
    speeds_hz: Array
    slow_hz: float
    inputs_n: Array = field(repr=False)
    speed_hz: Array = field(repr=False)
    rates: Array = field(repr=False)
    damping: float
    frequency_hz: Array = field(repr=False)
    transfer: NDArray[np.complex64] = field(repr=False)

    @property
    def size(self) -> int:
        """Number of lines."""
        return int(self.forces.shape[-1])

    def amplitudes(self, multiples: NDArray[np.int_], instants: NDArray[np.int_]) -> ComplexArray:
        """Return Z (channel, line, instant) of some multiples of the base order, from 1, at some instants."""
        found = self.steady(multiples, instants)
        sizes = np.max(np.abs(found), axis=(0, 2), initial=0.0)
        loud = np.flatnonzero(sizes > _LAGS * np.max(sizes, initial=0.0))
        turning = (self.rates[instants] != 0) & (self.speed_hz[instants] >= self.speeds_hz[0])
        moving = np.flatnonzero(turning & self.inputs_n[:, instants].any(axis=0))
        if self.speeds_hz.size > 1 and loud.size and moving.size:
            speed, inputs_n = self.speed_hz[instants[moving]], self.inputs_n[:, instants[moving]]
            radians = 2 * np.pi * float(self.base_order) * multiples[loud, None]
            # the width of modes that the speed passes while they ring; where it is not small the series says nothing
            lag = self.rates[instants[moving]] / (radians * (self.damping * speed) ** 2)
            step, bent = _STENCIL * self.damping * speed, -2 * found[:, loud[:, None], moving]
            for side in (-1, 1):
                bent += self._at(multiples[loud], speed + side * step, inputs_n)
            found[:, loud[:, None], moving] -= 0.5j * lag / (1 + lag**2) * bent / _STENCIL**2
        return found

    def steady(self, multiples: NDArray[np.int_], instants: NDArray[np.int_]) -> ComplexArray:
        """Return Z (channel, line, instant) as it were if the speed stayed what it is at each instant."""
        driven = self.inputs_n[:, instants].any(axis=0)
        found = np.zeros((self.transfer.shape[1], multiples.size, instants.size), dtype=np.complex128)
        found[..., driven] = self._at(multiples, self.speed_hz[instants[driven]], self.inputs_n[:, instants[driven]])
        return found

    def _at(self, multiples: NDArray[np.int_], speed: Array, inputs_n: Array) -> ComplexArray:
        from data_synth.vibration._projection_kernels import add_responses  # noqa: PLC0415  - numba is slow to load

        weights = _cubic(speed + self.slow_hz, self.speeds_hz + self.slow_hz)
        shares = (weights[:, None] * inputs_n).reshape(-1, speed.size).astype(np.float32)
        place = np.multiply.outer(float(self.base_order) / self.frequency_hz[1] * multiples, speed)
        total = np.zeros((self.transfer.shape[1], multiples.size, speed.size), dtype=np.complex128)
        for mesh, transfer in enumerate(self.transfer):
            some = self.forces[:, :, mesh, multiples - 1].reshape(shares.shape[0], -1)
            add_responses(transfer, place, some.T @ shares, total)
        return total


def _cubic(speed: Array, nodes: Array) -> Array:
    """Return the weights (node, n) of nodes that rise by one factor at speeds (n,): cubics in the speed's logarithm."""
    if nodes.size == 1:
        return np.ones((1, speed.size))
    place = np.log(np.maximum(speed, nodes[0] / 2) / nodes[0]) / np.log(nodes[1] / nodes[0])
    return lagrange(np.clip(place, -0.5, nodes.size - 0.5), nodes.size)


def lagrange(place: Array, nodes: int) -> Array:
    """Return the weights (node, n) of nodes 0, 1, ... at places (n,): Lagrange's, of the four about each or of all."""
    few = min(4, nodes)
    first = np.clip(np.floor(place).astype(np.int64) - 1, 0, nodes - few)
    weights = np.zeros((nodes, place.size))
    for i in range(few):
        factors = [(place - first - j) / (i - j) for j in range(few) if j != i]
        weights[first + i, np.arange(place.size)] = np.prod(factors, axis=0)
    return weights
