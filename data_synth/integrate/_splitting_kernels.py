"""Compiled steps of the exponential splitting: exact flow of the constant part, rank-one kicks by the meshes."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside
from data_synth.integrate._equations import Equations
from data_synth.integrate._wave_kernels import SHORT, integrals_at, legendre, legendre_short, value_at
from data_synth.integrate._waves import Waves

Array = NDArray[np.float64]


@compiled_inside
def dead_zone(deflection: float, half_gap: float) -> tuple[float, float]:
    """Return how far teeth are pressed together, negative on the back flanks, and 1 in contact, else 0."""
    if half_gap <= 0.0:
        return deflection, 1.0
    if deflection > half_gap:
        return deflection - half_gap, 1.0
    if deflection < -half_gap:
        return deflection + half_gap, 1.0
    return 0.0, 0.0


@compiled_inside
def flow_by_modes(x: Array, blocks: Array, pushes: Array, impulses: Array, seen: Array, delta: Array) -> None:
    """Take mesh impulses from the velocities, apply one 2 by 2 block a mode, and leave the new deflections."""
    size, meshes = pushes.shape
    for m in range(meshes):
        delta[m] = 0.0
    for i in range(size):
        a, b = x[i], x[size + i]
        for m in range(meshes):
            b -= pushes[i, m] * impulses[m]
        c = blocks[i, 0] * a + blocks[i, 1] * b + blocks[i, 4]
        x[i] = c
        x[size + i] = blocks[i, 2] * a + blocks[i, 3] * b + blocks[i, 5]
        for m in range(meshes):
            delta[m] += seen[i, m] * c


@compiled_inside
def flow_at_once(
    x: Array, other: Array, columns: Array, pushes: Array, impulses: Array, seen: Array, delta: Array
) -> None:
    """Do the same by a full propagator, whose columns and, last, what the drive adds are the rows of `columns`."""
    size = pushes.shape[0]
    push(x, pushes, impulses)
    for i in range(2 * size):
        other[i] = columns[2 * size, i]
    for j in range(2 * size):
        column, factor = columns[j], x[j]
        for i in range(2 * size):
            other[i] += column[i] * factor
    for i in range(2 * size):
        x[i] = other[i]
    deflect(x, seen, delta)


@compiled_inside
def drag_for(x: Array, size: int, time: float, drags: Array, factors: Array, forward: bool) -> None:
    """Let ``v' = -(c / m) v abs(v)`` act for a time, exactly, on each dragged velocity."""
    count = factors.size
    for n in range(count):
        d = n if forward else count - 1 - n
        row = drags[d]
        speed = inverse_mass = 0.0
        for i in range(size):
            speed += row[i] * x[size + i]
            inverse_mass += row[i] * row[i]
        slower = speed / (1.0 + factors[d] * inverse_mass * abs(speed) * time)
        change = (slower - speed) / inverse_mass
        for i in range(size):
            x[size + i] += row[i] * change


@compiled_inside
def push(x: Array, pushes: Array, impulses: Array) -> None:
    """Take mesh impulses from the modal velocities."""
    size, meshes = pushes.shape
    for i in range(size):
        for m in range(meshes):
            x[size + i] -= pushes[i, m] * impulses[m]


@compiled_inside
def deflect(x: Array, seen: Array, delta: Array) -> None:
    """Leave the deflections of all meshes."""
    for m in range(delta.size):
        delta[m] = 0.0
        for i in range(seen.shape[0]):
            delta[m] += seen[i, m] * x[i]


@compiled_inside
def moments_of_step(
    waves: Waves, which: int, begin: float, end: float, at_start: Array, at_stop: Array, first: bool
) -> tuple[float, float, float]:
    """Return the Legendre coefficients of a stiffness over a step; its integrals at the end go on to the next."""
    if abs(end - begin) < SHORT:
        at_stop[which, 0] = np.nan
        return legendre_short(waves, which, begin, end)
    if first or np.isnan(at_start[which, 0]):
        at_start[which, 0], at_start[which, 1], at_start[which, 2] = integrals_at(waves, which, begin)
    at_stop[which, 0], at_stop[which, 1], at_stop[which, 2] = integrals_at(waves, which, end)
    return legendre(
        waves,
        which,
        begin,
        end,
        (at_start[which, 0], at_start[which, 1], at_start[which, 2]),
        (at_stop[which, 0], at_stop[which, 1], at_stop[which, 2]),
    )


@compiled
def split_steps(
    x: Array,
    readings: Array,
    rows: Array,
    constant: Array,
    per_sample: int,
    step: float,
    classical: bool,
    half: Array,
    equations: Equations,
    tied_speed: Array,
    revolutions: Array,
    loads: Array,
) -> None:
    """Advance x through all samples of a block and read it at each.

    Per step the meshes kick at both ends and in the middle. Their strengths are integrals of the stiffness times the
    quadratic polynomials of Lagrange through these nodes, exact across jumps; the middle one also holds the
    commutator of two mesh forces: h^3 times a quadratic form of their Legendre coefficients.
    `half` holds a row (6,) a mode where `classical`, else what `flow_at_once` takes; both over half a step.
    """
    pushes, seen, tied, cycles = equations.pushes, equations.seen, equations.tied, equations.cycles
    stiffnesses, coupling, means = equations.stiffnesses, equations.coupling, equations.stiffnesses.means
    drags, drag_factors, error_of = equations.drags, equations.drag_factors, equations.error_of
    size, meshes = pushes.shape
    other = np.empty(2 * size)
    a0, a1, a2 = np.empty(meshes), np.empty(meshes), np.empty(meshes)
    delta, impulse = np.zeros(meshes), np.zeros(meshes)
    pressed, touching = np.zeros(meshes), np.zeros(meshes)
    at_start, at_stop = np.zeros((meshes, 3)), np.zeros((meshes, 3))
    sixth, two_thirds, cube = step / 6, step * 2 / 3, step**3
    deflect(x, seen, delta)
    for sample in range(readings.shape[0]):
        for sub in range(per_sample):
            number = sample * per_sample + sub
            if tied.size:
                start = speed = 0.0
                for i in range(size):
                    start += tied[i] * x[i]
                    speed += tied[size + i] * x[size + i]
                stop = start + step * (speed + 0.5 * (speed - tied_speed[0]))
                tied_speed[0] = speed
            else:
                start, stop = revolutions[number], revolutions[number + 1]
            for m in range(meshes):
                a0[m], a1[m], a2[m] = moments_of_step(
                    stiffnesses, m, cycles[m] * start, cycles[m] * stop, at_start, at_stop, number == 0 or tied.size > 0
                )
                at_start[m, 0], at_start[m, 1], at_start[m, 2] = at_stop[m, 0], at_stop[m, 1], at_stop[m, 2]
            for node in range(3):
                if node == 1 or node == 2:  # noqa: PLR1714, PLR2004
                    if classical:
                        flow_by_modes(x, half, pushes, impulse, seen, delta)
                    else:
                        flow_at_once(x, other, half, pushes, impulse, seen, delta)
                weight = two_thirds if node == 1 else sixth
                if node < 2:  # noqa: PLR2004
                    drag_for(x, size, two_thirds / 2 if node == 1 else sixth, drags, drag_factors, True)
                for m in range(meshes):
                    gap = delta[m]
                    if error_of[m] >= 0:
                        gap -= value_at(
                            equations.errors, error_of[m], cycles[m] * (start + 0.5 * node * (stop - start))
                        )
                    pressed[m], touching[m] = dead_zone(gap, equations.backlashes[m])
                    share = a0[m] - 0.2 * a2[m] if node == 1 else a0[m] + (node - 1) * a1[m] + 0.4 * a2[m]
                    impulse[m] = weight * (share * pressed[m] - means[m] * delta[m])
                if node == 1:
                    for i in range(meshes):
                        g0 = a0[i] * touching[i] - means[i]
                        g1, g2 = a1[i] * touching[i], a2[i] * touching[i]
                        for j in range(meshes):
                            f0 = a0[j] * pressed[j] - means[j] * delta[j]
                            f1, f2 = a1[j] * pressed[j], a2[j] * pressed[j]
                            form = (f0 * g0) / 36 - (f0 * g2 + f2 * g0 + f1 * g1) / 180 - f2 * g2 / 3150
                            impulse[i] -= cube * coupling[i, j] * form
                if loads.shape[0]:
                    load = loads[2 * number + node]
                    for i in range(size):
                        x[size + i] += weight * load[i]
                if node == 1 and drag_factors.size:
                    push(x, pushes, impulse)
                    drag_for(x, size, two_thirds / 2, drags, drag_factors, False)
                    for m in range(meshes):
                        impulse[m] = 0.0
            push(x, pushes, impulse)
            drag_for(x, size, sixth, drags, drag_factors, False)
        for r in range(rows.shape[0]):
            row = rows[r]
            total = constant[r]
            for i in range(2 * size):
                total += row[i] * x[i]
            readings[sample, r] = total
