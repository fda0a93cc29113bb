"""Compiled sweep through a period of forces on a varying stiffness, from one instant to the next."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

_ROUNDS = 2  # of the forces of meshes on each other, at an instant: what they do at once is small beside 1


@compiled
def sweep(
    right: Singles,
    varying: Singles,
    turns: Array,
    pushes: Array,
    outputs: Array,
    at_once: Array,
    run_in: int,
    static: Array,
    found: Singles,
) -> None:
    """Compute ``p = right + varying delta`` of meshes over a period that repeats, delta the deflections by p.

    Where teeth part, their force ``static + delta + p`` is zero instead of having the other sign.

    Parameters
    ----------
    right : (input, mesh, n) array
    varying : (mesh, n) array
    turns : (2, mode) array
        What a step makes of each mode: real and imaginary part, as below.
    pushes : (mesh, 2, mode) array
        What p at the beginning of a step adds to each mode.
    outputs : (mesh, 2, mode) array
        Deflections by each mode.
    at_once : (mesh, mesh) array
        Deflections by p at the same instant, of the modes too.
    run_in : int
        Steps before the first instant, from rest.
    static : (input, mesh) array
        Mean tooth force; zero where teeth never part.
    found : (input, mesh, n) array
        Becomes p.
    """
    inputs, meshes, points = right.shape
    count = turns.shape[1]
    real, imaginary = np.zeros(count), np.zeros(count)
    force, known, eased, eased_by = np.zeros(meshes), np.zeros(meshes), np.zeros(meshes), np.zeros(meshes)
    for row in range(inputs):
        for k in range(count):
            real[k] = 0.0
            imaginary[k] = 0.0
        for i in range(meshes):
            force[i] = 0.0
        here = (points - run_in % points) % points
        for step in range(run_in + points):
            for k in range(count):
                was = real[k]
                real[k] = turns[0, k] * was - turns[1, k] * imaginary[k]
                imaginary[k] = turns[0, k] * imaginary[k] + turns[1, k] * was
            for j in range(meshes):
                for k in range(count):
                    real[k] += pushes[j, 0, k] * force[j]
                    imaginary[k] += pushes[j, 1, k] * force[j]
            for i in range(meshes):
                total = 0.0
                for k in range(count):
                    total += outputs[i, 0, k] * real[k] - outputs[i, 1, k] * imaginary[k]
                eased[i] = 1.0 / (1.0 - varying[i, here] * at_once[i, i])
                known[i] = right[row, i, here] + varying[i, here] * total
                eased_by[i] = total
            for _ in range(_ROUNDS if meshes > 1 else 1):
                for i in range(meshes):
                    total = 0.0
                    for j in range(meshes):
                        if j != i:
                            total += at_once[i, j] * force[j]
                    force[i] = (known[i] + varying[i, here] * total) * eased[i]
                    carried = static[row, i] + eased_by[i] + total
                    if static[row, i] * (carried + (1.0 + at_once[i, i]) * force[i]) < 0:
                        force[i] = -carried / (1.0 + at_once[i, i])
            if step >= run_in:
                for i in range(meshes):
                    found[row, i, here] = force[i]
            here += 1
            if here == points:
                here = 0
