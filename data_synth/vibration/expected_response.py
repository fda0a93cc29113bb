"""Lines that are expected of gears in motion: the response to their exciting forces against speed and time."""

from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_STENCIL = 0.25  # of the share of speed in which a mode is passed: the step of second differences
_LAGS = 5e-3  # of the loudest line of a family: what others lag behind the speed is below 1e-4 of it


@dataclass(frozen=True, kw_only=True)
class Hearing:
    """What the channels have of exciting forces at an order beside that of the forces, between even frequencies.

    Attributes
    ----------
    shift : Fraction
        Signed order that is added to that of a force.
    frequency_hz : (f,) array
        Even, from zero.
    readings : (mesh, reading, f) complex array
        Of the forces in the routes to the sensors, per N of exciting force.
    gains : (route, reading) complex array
        Of a reading in the routes.
    channels : (route,) int array
        Channel of each route.
    routes : (route, f) complex array
        Complex amplitude in that channel per N in the route.
    """

    shift: Fraction
    frequency_hz: Array = field(repr=False)
    readings: NDArray[np.complex64] = field(repr=False)
    gains: NDArray[np.complexfloating] = field(repr=False)
    channels: NDArray[np.int_]
    routes: NDArray[np.complex64] = field(repr=False)

    def of_meshes(self, meshes: NDArray[np.int_]) -> "Hearing":
        """Return that of forces in some meshes."""
        return replace(self, readings=self.readings[meshes])

    @property
    def count(self) -> int:
        """Number of channels."""
        return int(np.max(self.channels)) + 1

    @cached_property
    def unshifted(self) -> NDArray[np.complex64]:
        """Complex amplitude in the channels per N of exciting force at the same order, (mesh, channel, f)."""
        found = np.zeros((self.readings.shape[0], self.count, self.frequency_hz.size), dtype=np.complex64)
        for place, route in enumerate(self._felt_in):
            found[:, self.channels[route]] += self._felt[:, place] * self.routes[route]
        return found

    @cached_property
    def _felt_in(self) -> NDArray[np.int_]:
        """Routes in which there is a force."""
        return np.flatnonzero(self.gains.any(axis=1))

    @cached_property
    def _felt(self) -> NDArray[np.complex64]:
        """Force in these routes per N of exciting force, (mesh, route, f)."""
        return np.asarray(self.gains[self._felt_in].astype(np.complex64) @ self.readings)

    def of(self, forces: list[NDArray[np.complex64]], orders: Array, speed: Array) -> ComplexArray:
        """Return Z (channel, line, instant) of forces (line, instant) in each mesh, at their orders (line,).

        Where the sum of an order and the shift is negative, Z is that at the positive order.
        """
        from data_synth.vibration._projection_kernels import add_responses  # noqa: PLC0415  - numba is slow to load

        at = np.multiply.outer(orders / self.frequency_hz[1], speed)
        total = np.zeros((self.count, *at.shape), dtype=np.complex128)
        if not self.shift:
            for transfer, force in zip(self.unshifted, forces, strict=True):
                add_responses(transfer, at, force, total)
            return total
        felt = np.zeros((self._felt_in.size, *at.shape), dtype=np.complex128)
        for transfer, force in zip(self._felt, forces, strict=True):
            add_responses(transfer, at, force, felt)
        beside = np.multiply.outer((orders + float(self.shift)) / self.frequency_hz[1], speed)
        felt = np.where(beside < 0, felt.conj(), felt).astype(np.complex64)
        for route, force in zip(self._felt_in, felt, strict=True):
            channel = self.channels[route]
            add_responses(self.routes[route : route + 1], np.abs(beside), force, total[channel : channel + 1])
        return total


@dataclass(frozen=True, kw_only=True)
class ExpectedLines:
    """Lines at the multiples of an order, from their exciting forces at some speeds.

    Where the speed changes, Z lags behind the steady response by ``(j / 2) (domega / dt) d2Z / domega2``, omega the
    angular frequency of the line: the first of the series of a response to a sweep (Carson and Fry 1937, Bell Syst.
    Tech. J. 16, 513), here with all that a mesh makes of its own vibration as part of the response.

    Attributes
    ----------
    base_order : Fraction
        Lines are at its multiples, from the first.
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
    heard : Hearing
        What the channels have of the exciting forces.
    """

    base_order: Fraction
    forces: NDArray[np.complex64] = field(repr=False)
    speeds_hz: Array
    slow_hz: float
    inputs_n: Array = field(repr=False)
    speed_hz: Array = field(repr=False)
    rates: Array = field(repr=False)
    damping: float
    heard: Hearing = field(repr=False)

    @property
    def size(self) -> int:
        """Number of lines."""
        return int(self.forces.shape[-1])

    def orders(self, multiples: NDArray[np.int_]) -> Array:
        """Return the orders of exciting forces."""
        return np.multiply(multiples, float(self.base_order), dtype=np.float64)

    def amplitudes(self, multiples: NDArray[np.int_], instants: NDArray[np.int_]) -> ComplexArray:
        """Return Z (channel, line, instant) of some multiples of the base order, from 1, at some instants."""
        found = self.steady(multiples, instants)
        sizes = np.max(np.abs(found), axis=(0, 2), initial=0.0)
        loud = np.flatnonzero(sizes > _LAGS * np.max(sizes, initial=0.0))
        turning = (self.rates[instants] != 0) & (self.speed_hz[instants] >= self.speeds_hz[0])
        moving = np.flatnonzero(turning & self.inputs_n[:, instants].any(axis=0))
        if self.speeds_hz.size > 1 and loud.size and moving.size:
            speed, inputs_n = self.speed_hz[instants[moving]], self.inputs_n[:, instants[moving]]
            radians = 2 * np.pi * self.orders(multiples[loud, None])
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
        found = np.zeros((self.heard.count, multiples.size, instants.size), dtype=np.complex128)
        found[..., driven] = self._at(multiples, self.speed_hz[instants[driven]], self.inputs_n[:, instants[driven]])
        return found

    def _at(self, multiples: NDArray[np.int_], speed: Array, inputs_n: Array) -> ComplexArray:
        weights = _cubic(speed + self.slow_hz, self.speeds_hz + self.slow_hz)
        shares = (weights[:, None] * inputs_n).reshape(-1, speed.size).astype(np.float32)
        forces = [
            self.forces[:, :, mesh, multiples - 1].reshape(shares.shape[0], -1).T @ shares
            for mesh in range(self.forces.shape[2])
        ]
        return self.heard.of(forces, self.orders(multiples), speed)


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
