"""Compiled steps of explicit Runge-Kutta methods and of the generalised-alpha method."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside
from data_synth.integrate._equations import Equations
from data_synth.integrate._splitting_kernels import dead_zone
from data_synth.integrate._wave_kernels import value_at

Array = NDArray[np.float64]


@compiled_inside
def mesh_force(equations: Equations, m: int, deflection: float, turns: float) -> tuple[float, float]:
    """Return ``k f(delta - e) - kmean delta`` and its slope."""
    phase, gap = equations.cycles[m] * turns, deflection
    if equations.error_of[m] >= 0:
        gap -= value_at(equations.errors, equations.error_of[m], phase)
    pressed, touching = dead_zone(gap, equations.backlashes[m], equations.backs[m])
    stiffness, mean = value_at(equations.stiffnesses, m, phase), equations.held[m]
    return stiffness * pressed - mean * deflection, stiffness * touching - mean


@compiled
def rates(x: Array, out: Array, equations: Equations, turns: float, load: Array) -> None:
    """Right-hand side of the equations over x, by point values of the stiffness."""
    pushes, seen, tied, drags = equations.pushes, equations.seen, equations.tied, equations.drags
    size, meshes = pushes.shape
    for i in range(2 * size):
        row = equations.generator[i]
        total = equations.drive[i]
        for j in range(2 * size):
            total += row[j] * x[j]
        out[i] = total
    if tied.size:
        turns = 0.0
        for i in range(size):
            turns += tied[i] * x[i]
    for m in range(meshes):
        delta = 0.0
        for i in range(size):
            delta += seen[i, m] * x[i]
        force, _ = mesh_force(equations, m, delta, turns)
        for i in range(size):
            out[size + i] -= pushes[i, m] * force
    for d in range(drags.shape[0]):
        speed = 0.0
        for i in range(size):
            speed += drags[d, i] * x[size + i]
        for i in range(size):
            out[size + i] -= drags[d, i] * equations.drag_factors[d] * speed * abs(speed)
    for i in range(load.size):
        out[size + i] += load[i]


@compiled
def runge_kutta_steps(
    x: Array,
    readings: Array,
    rows: Array,
    constant: Array,
    per_sample: int,
    step: float,
    matrix: Array,
    weights: Array,
    equations: Equations,
    turns: Array,
    loads: Array,
) -> None:
    """Advance x by an explicit method with coefficients a (s, s) and b (s,); turns and loads by step and stage."""
    stages, width = weights.size, x.size
    slopes, here = np.empty((stages, width)), np.empty(width)
    for sample in range(readings.shape[0]):
        for sub in range(per_sample):
            number = (sample * per_sample + sub) * stages
            for s in range(stages):
                for i in range(width):
                    here[i] = x[i]
                for earlier in range(s):
                    factor = step * matrix[s, earlier]
                    if factor != 0.0:
                        for i in range(width):
                            here[i] += factor * slopes[earlier, i]
                place = turns[number + s] if turns.size else 0.0
                rates(here, slopes[s], equations, place, loads[number + s] if loads.shape[0] else loads[:0].ravel())
            for s in range(stages):
                for i in range(width):
                    x[i] += step * weights[s] * slopes[s, i]
        for r in range(rows.shape[0]):
            row = rows[r]
            total = constant[r]
            for i in range(width):
                total += row[i] * x[i]
            readings[sample, r] = total


@compiled
def alpha_steps(
    x: Array,
    acceleration: Array,
    readings: Array,
    rows: Array,
    constant: Array,
    per_sample: int,
    step: float,
    coefficients: tuple[float, float, float, float],
    inverse: Array,
    damping: Array,
    scales: Array,
    squares: Array,
    equations: Equations,
    turns: Array,
    loads: Array,
) -> None:
    """Advance by generalised alpha; mesh forces at the end of a step by Newton's method on the deflections.

    `inverse` (n, n) is that of ``(1 - am) I + (1 - af) (gamma h D + beta h^2 w^2)``; `turns` and `loads` are given
    at every edge of a step, the first included.
    """
    alpha_m, alpha_f, beta, gamma = coefficients
    drags, drag_factors, pushes = equations.drags, equations.drag_factors, equations.pushes
    size, meshes = pushes.shape
    drive = equations.drive[size:]
    y, v, a = x[:size] / scales, x[size:].copy(), acceleration.copy()
    left = 1.0 - alpha_f
    sees = np.ascontiguousarray(equations.seen.T) * scales
    back = inverse @ pushes
    reach = beta * step * step * left * (sees @ back)
    force, slope, old_force = np.empty(meshes), np.empty(meshes), np.empty(meshes)
    at_start = sees @ y
    for m in range(meshes):
        old_force[m], _ = mesh_force(equations, m, at_start[m], turns[0])
    for sample in range(readings.shape[0]):
        for sub in range(per_sample):
            number = sample * per_sample + sub
            y_known = y + step * v + step * step * (0.5 - beta) * a
            v_known = v + step * (1.0 - gamma) * a
            right = drive - alpha_m * a
            right -= squares * (left * y_known + alpha_f * y) + damping @ (left * v_known + alpha_f * v)
            right -= alpha_f * (pushes @ old_force)
            if loads.shape[0]:
                right += left * loads[number + 1] + alpha_f * loads[number]
            for d in range(drag_factors.size):
                # at the level of the equations, extrapolated: of second order like the method
                speed = drags[d] @ (v + step * left * a)
                right -= drags[d] * (drag_factors[d] * speed * abs(speed))
            new = inverse @ right
            guess = sees @ (y_known + beta * step * step * new)
            delta = guess.copy()
            for _ in range(30):
                for m in range(meshes):
                    force[m], slope[m] = mesh_force(equations, m, delta[m], turns[number + 1])
                miss = delta - guess + reach @ force
                change = np.linalg.solve(np.eye(meshes) + reach * slope, miss)
                delta -= change
                if np.max(np.abs(change)) <= 1e-15 * np.max(np.abs(delta)) or meshes == 0:
                    break
            for m in range(meshes):
                force[m], slope[m] = mesh_force(equations, m, delta[m], turns[number + 1])
            new -= left * (back @ force)
            y = y_known + beta * step * step * new
            v = v_known + step * gamma * new
            a = new
            old_force[:] = force
        x[:size] = y * scales
        x[size:] = v
        readings[sample] = rows @ x + constant
    acceleration[:] = a
