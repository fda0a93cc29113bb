"""Stretches of time over which every mesh stiffness is constant, and the power series of what acts in them."""

import math

import numpy as np

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.problem import Array, TiedTo

_ROUNDING = 1e-17  # of the state: terms of the power series below it change no digit
_SHORTEST = 0.5  # of the fastest motion's rad: over so short a stretch the power series is as exact as numbers are


def rungs(a: Assembled, unit_s: float) -> tuple[int, int]:
    """Return how often to halve a unit until the power series takes over, and its terms, whatever stiffness holds."""
    fastest = np.sqrt(np.max(a.flow.modes.frequencies, initial=1.0) ** 2 + a.swing) + np.linalg.norm(a.flow.damping, 2)
    rungs = max(0, int(np.ceil(np.log2(fastest * unit_s / _SHORTEST))))
    left, terms = fastest * unit_s / 2**rungs, 1
    while left**terms / math.factorial(terms) > _ROUNDING:
        terms += 1
    return rungs, terms


def switching(a: Assembled, start_s: float, stop_s: float) -> tuple[Array, Array]:
    """Return switching instants within (start, stop) and stiffnesses (switches + 1, meshes) between them."""
    turning, meshes = a.problem.turning, a.problem.system.meshes
    assert not isinstance(turning, TiedTo)  # noqa: S101
    begin, end = turning.revolutions(np.array([start_s, stop_s]))
    instants = [np.zeros(0)]
    for mesh in meshes:
        low, high = sorted((begin * mesh.cycles_per_rev, end * mesh.cycles_per_rev))
        period = mesh.stiffness.period
        for jump in mesh.stiffness.jumps:
            phases = jump + period * np.arange(np.floor((low - jump) / period), np.ceil((high - jump) / period) + 1)
            phases = phases[(phases > low) & (phases < high)]
            instants.append(turning.times(phases / mesh.cycles_per_rev))
    switches = np.unique(np.concatenate(instants))
    switches = switches[(switches > start_s) & (switches < stop_s)]
    edges = np.concatenate([[start_s], switches, [stop_s]])
    between = turning.revolutions((edges[1:] + edges[:-1]) / 2)
    values = [mesh.stiffness(mesh.cycles_per_rev * between) for mesh in meshes]
    return switches, np.array(values, dtype=np.float64).reshape(len(meshes), between.size).T


def columns(matrices: Array) -> Array:
    """Return the columns of matrices (k, rows, columns) below each other, (columns, k rows)."""
    return np.ascontiguousarray(np.moveaxis(matrices, 2, 0)).reshape(matrices.shape[2], -1)


def series(generator: Array, drive: Array, time_s: float, terms: int) -> tuple[Array, Array]:
    """Return ``(generator time)^k / k!`` for k = 1, 2, ..., and what the drive adds to each term."""
    rate, push = generator * time_s, drive * time_s
    powers, gains = [rate], [push]
    for k in range(2, terms + 1):
        powers.append(rate @ powers[-1] / k)
        gains.append(rate @ gains[-1] / k)
    return np.stack(powers), np.stack(gains)
