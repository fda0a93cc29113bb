"""Compiled steps of the exponential splitting: exact flow of the constant part, rank-one impulses by the meshes.

Each operation is rounded as written, and no array is allocated in parts that are compiled into others.
"""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside
from data_synth.integrators._periodic_kernels import SHORT, integrals_at, legendre, legendre_short, value_at
from data_synth.integrators.modal_problem import Equations
from data_synth.integrators.periodic_tables import Waves

Array = NDArray[np.float64]

C00, C02, C22 = 1 / 36, 1 / 180, 1 / 3150  # of the commutator
M0, M2 = 1 / 24, 1 / 480  # of the correction of the middle deflection


@compiled_inside
def dead_zone(deflection: float, half_gap: float, back_half_gap: float) -> tuple[float, float]:
    """Return the elastic compression of the teeth, negative on the back flanks, and 1 in contact, else 0."""
    if half_gap <= 0.0:
        return deflection, 1.0
    if deflection > half_gap:
        return deflection - half_gap, 1.0
    if deflection < -back_half_gap:
        return deflection + back_half_gap, 1.0
    return 0.0, 0.0


@compiled_inside
def modal_flow(
    x: Array, blocks: Array, force_columns: Array, impulses: Array, deflection_rows: Array, delta: Array
) -> None:
    """Apply mesh impulses, propagate each mode by its 2 by 2 block, and compute the new deflections."""
    size, meshes = force_columns.shape
    for m in range(meshes):
        delta[m] = 0.0
    for i in range(size):
        a, b = x[i], x[size + i]
        for m in range(meshes):
            b -= force_columns[i, m] * impulses[m]
        c = blocks[i, 0] * a + blocks[i, 1] * b + blocks[i, 4]
        x[i] = c
        x[size + i] = blocks[i, 2] * a + blocks[i, 3] * b + blocks[i, 5]
        for m in range(meshes):
            delta[m] += deflection_rows[i, m] * c


@compiled_inside
def coupled_flow(
    x: Array, other: Array, columns: Array, force_columns: Array, impulses: Array, deflection_rows: Array, delta: Array
) -> None:
    """Do the same with a full propagator; the rows of `columns` are its columns and, last, the part of the load."""
    size = force_columns.shape[0]
    apply_impulses(x, force_columns, impulses)
    for i in range(2 * size):
        other[i] = columns[2 * size, i]
    for j in range(2 * size):
        column, factor = columns[j], x[j]
        for i in range(2 * size):
            other[i] += column[i] * factor
    for i in range(2 * size):
        x[i] = other[i]
    compute_deflections(x, deflection_rows, delta)


@compiled_inside
def apply_drag(x: Array, time: float, drags: Array, factors: Array, inverse_masses: Array, forward: bool) -> None:
    """Integrate ``v' = -(c / m) v abs(v)`` exactly over a time for each velocity with drag."""
    count, size = drags.shape
    for n in range(count):
        d = n if forward else count - 1 - n
        row = drags[d]
        speed = 0.0
        for i in range(size):
            speed += row[i] * x[size + i]
        braked = factors[d] * abs(speed) * time
        change = -speed * braked / (1.0 + inverse_masses[d] * braked)
        for i in range(size):
            x[size + i] += row[i] * change


@compiled_inside
def apply_impulses(x: Array, force_columns: Array, impulses: Array) -> None:
    """Subtract mesh impulses from the modal velocities."""
    size, meshes = force_columns.shape
    for i in range(size):
        for m in range(meshes):
            x[size + i] -= force_columns[i, m] * impulses[m]


@compiled_inside
def compute_deflections(x: Array, deflection_rows: Array, delta: Array) -> None:
    """Compute the deflections of all meshes."""
    for m in range(delta.size):
        delta[m] = 0.0
        for i in range(deflection_rows.shape[0]):
            delta[m] += deflection_rows[i, m] * x[i]


@compiled_inside
def history_tables(first: int, later: int, position: float) -> tuple[int, int, float]:
    """Return the tables before and after a position in the history of a mesh, and the weight of the second.

    Instant 0 has table `first`, instant 1 table `later`, the next ones follow; `later` below zero: nothing changes.
    """
    if later < 0:
        return first, first, 0.0
    number = int(position)
    share = position - number
    before = first if number == 0 else later + number - 1
    return before, before if share == 0.0 else later + number, share


@compiled_inside
def interpolated(waves: Waves, now: int, then: int, share: float, phase: float) -> float:
    """Return the value interpolated between two tables, by the weight of the second."""
    value = 0.0
    table, part = now, 1.0 - share
    while True:
        value += part * value_at(waves, table, phase)
        if table == then:
            break
        table, part = then, share
    return value


@compiled_inside
def legendre_of_step(
    waves: Waves, which: int, begin: float, end: float, at_start: Array, at_stop: Array, first: bool
) -> tuple[float, float, float]:
    """Return the Legendre coefficients of a stiffness over a step; its integrals at the end are kept for the next."""
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


@compiled_inside
def triangular_weights(node: int, sub: int, per_sample: int, a0: float, a1: float, a2: float) -> tuple[float, float]:
    """Return how much the compression at a node of a step adds to the triangular means of a mesh force.

    The first weight is for the rising half of the triangle, the second for both halves, whose sum is constant. They
    come from the integrals over the step of the stiffness, with Legendre coefficients a0 to a2, times the quadratic
    Lagrange polynomial of node 0, 1 or 2 (x = -1, 0 and 1), and of the same times x. `sub` counts the steps of the
    sample.
    """
    if node == 1:
        moment, first_moment = (a0 - 0.2 * a2) * 2 / 3, a1 * 2 / 15
    else:
        side = node - 1
        moment, first_moment = (a0 + side * a1 + 0.4 * a2) / 6, side * (a0 / 6 + a2 / 15) + a1 / 10
    return (moment * (sub + 0.5) + 0.5 * first_moment) / per_sample**2, moment / per_sample


@compiled
def split_steps(
    x: Array,
    outputs: Array,
    rows: Array,
    constant: Array,
    per_sample: int,
    step: float,
    classical: bool,
    half: Array,
    equations: Equations,
    coupled_speed: Array,
    revolutions: Array,
    loads: Array,
    history_positions: Array,
    weighted_forces: Array,
    next_weighted: Array,
) -> None:
    """Propagate x over all samples of a block and compute the outputs at each.

    In each step the meshes act by impulses at both ends and in the middle. They are integrals of the stiffness times
    the quadratic Lagrange polynomials through these nodes, exact across jumps; the middle one also has the commutator
    of two mesh forces: h^3 times a quadratic form of their Legendre coefficients.
    The deflection at the middle node lacks `correction`, the effect of the forces until then beyond the impulse at the
    start: over a step it cancels, but weighted mesh forces need it.
    `half` holds a row (6,) for each mode where `classical`, else the argument of `coupled_flow`; both over half a step.
    `history_positions` (steps, meshes) are those in the histories of the meshes; (0, meshes) where none has one.
    `weighted_forces` (samples, 2 meshes) receives the force of each mesh under the triangular weight, then the force
    at the sample; `next_weighted` (meshes,) is the known part of the next weighted force; (0, 2 meshes) where the
    output has none. All cases share one compilation: absent parts are empty arrays.
    """
    force_columns, deflection_rows, reference_row, cycles = (
        equations.force_columns,
        equations.deflection_rows,
        equations.reference_row,
        equations.cycles,
    )
    stiffnesses, coupling, means = equations.stiffnesses, equations.coupling, equations.mean_stiffnesses
    drags, drag_factors, error_of = equations.drags, equations.drag_factors, equations.error_of
    offsets, backlashes, back_half_gaps = equations.offsets, equations.backlashes, equations.back_half_gaps
    error_tables, later_errors = equations.errors, equations.later_errors
    later_stiffnesses = equations.later_stiffnesses
    size, meshes = force_columns.shape
    other = np.empty(2 * size)
    a0, a1, a2 = np.empty(meshes), np.empty(meshes), np.empty(meshes)
    delta, impulse = np.zeros(meshes), np.zeros(meshes)
    errors = np.zeros((3, meshes))
    compression, contact, correction = np.zeros(meshes), np.zeros(meshes), np.zeros(meshes)
    tables, inverse_masses = stiffnesses.means.size, np.empty(drag_factors.size)
    for d in range(drag_factors.size):
        inverse_masses[d] = np.sum(drags[d] * drags[d])
    at_start, at_stop = np.full((tables, 3), np.nan), np.full((tables, 3), np.nan)
    changing, weighting = history_positions.shape[0] > 0, weighted_forces.shape[0] > 0
    sixth, two_thirds, cube = step / 6, step * 2 / 3, step**3
    stop = 0.0
    compute_deflections(x, deflection_rows, delta)
    for sample in range(outputs.shape[0]):
        if weighting:
            for m in range(next_weighted.size):
                weighted_forces[sample, m] = next_weighted[m]
                next_weighted[m] = 0.0
        for sub in range(per_sample):
            number = sample * per_sample + sub
            # Angle of the reference at both ends of the step; a coupled one by the Adams-Bashforth formula of order 2
            if reference_row.size:
                start = speed = 0.0
                for i in range(size):
                    start += reference_row[i] * x[i]
                    speed += reference_row[size + i] * x[size + i]
                stop = start + step * (speed + 0.5 * (speed - coupled_speed[0]))
                coupled_speed[0] = speed
            else:
                start, stop = revolutions[number], revolutions[number + 1]
            # Legendre coefficients of each mesh stiffness over the step
            for m in range(meshes):
                begin, end = cycles[m] * start, cycles[m] * stop
                position = history_positions[number, m] if changing else 0.0
                now, then, share = history_tables(m, later_stiffnesses[m], position)
                a0[m] = a1[m] = a2[m] = 0.0
                table, part = now, 1.0 - share
                while True:
                    b0, b1, b2 = legendre_of_step(
                        stiffnesses, table, begin, end, at_start, at_stop, reference_row.size > 0
                    )
                    a0[m] += part * b0
                    a1[m] += part * b1
                    a2[m] += part * b2
                    for i in range(3):
                        at_start[table, i] = at_stop[table, i]
                    if table == then:
                        break
                    table, part = then, share
            # Transmission errors at the nodes: start, middle and end of the step
            for m in range(meshes):
                if error_of[m] >= 0:
                    position = history_positions[number, m] if changing else 0.0
                    now, then, share = history_tables(error_of[m], later_errors[m], position)
                    known = 0
                    if number > 0 and reference_row.size == 0 and later_errors[m] < 0:
                        errors[0, m], known = errors[2, m], 1  # that of the end of the step before
                    for node in range(known, 3):
                        turned = start if node == 0 else stop if node == 2 else 0.5 * (start + stop)  # noqa: PLR2004
                        errors[node, m] = interpolated(error_tables, now, then, share, cycles[m] * turned)
            # Impulse, half a step of exact flow, impulse, half a step, impulse
            for node in range(3):
                if node == 1 or node == 2:  # noqa: PLR1714, PLR2004
                    if classical:
                        modal_flow(x, half, force_columns, impulse, deflection_rows, delta)
                    else:
                        coupled_flow(x, other, half, force_columns, impulse, deflection_rows, delta)
                weight = two_thirds if node == 1 else sixth
                if node < 2:  # noqa: PLR2004
                    apply_drag(x, two_thirds / 2 if node == 1 else sixth, drags, drag_factors, inverse_masses, True)
                for m in range(meshes):
                    gap = delta[m] - errors[node, m]
                    compression[m], contact[m] = dead_zone(gap, backlashes[m], back_half_gaps[m])
                    strength = a0[m] - 0.2 * a2[m] if node == 1 else a0[m] + (node - 1) * a1[m] + 0.4 * a2[m]
                    impulse[m] = weight * (strength * compression[m] - means[m] * (delta[m] - offsets[m]))
                    if weighting:
                        correction[m] = 0.0
                if node == 1:  # commutator of two mesh forces
                    for i in range(meshes):
                        g0 = a0[i] * contact[i] - means[i]
                        g1, g2 = a1[i] * contact[i], a2[i] * contact[i]
                        for j in range(meshes):
                            f0 = a0[j] * compression[j] - means[j] * (delta[j] - offsets[j])
                            f1, f2 = a1[j] * compression[j], a2[j] * compression[j]
                            form = C00 * (f0 * g0) - C02 * (f0 * g2 + f2 * g0 + f1 * g1) - C22 * f2 * g2
                            impulse[i] -= cube * coupling[i, j] * form
                            if weighting:
                                correction[i] += step * step * coupling[i, j] * (M0 * f0 - M2 * f2) * contact[i]
                if weighting:
                    for m in range(next_weighted.size):
                        rising_weight, both_weights = triangular_weights(node, sub, per_sample, a0[m], a1[m], a2[m])
                        next_weighted[m] += rising_weight * (compression[m] - correction[m])
                        weighted_forces[sample, m] += (both_weights - rising_weight) * (compression[m] - correction[m])
                if loads.shape[0]:
                    for i in range(size):
                        x[size + i] += weight * loads[2 * number + node, i]
                if node == 1 and drag_factors.size:
                    apply_impulses(x, force_columns, impulse)
                    apply_drag(x, two_thirds / 2, drags, drag_factors, inverse_masses, False)
                    for m in range(meshes):
                        impulse[m] = 0.0
            apply_impulses(x, force_columns, impulse)
            apply_drag(x, sixth, drags, drag_factors, inverse_masses, False)
        if weighting:
            for m in range(next_weighted.size):
                position = history_positions[(sample + 1) * per_sample - 1, m] if changing else 0.0
                now, then, share = history_tables(m, later_stiffnesses[m], position)
                strength = interpolated(stiffnesses, now, then, share, cycles[m] * stop)
                weighted_forces[sample, next_weighted.size + m] = strength * compression[m]
        for r in range(rows.shape[0]):
            total = constant[r]
            for i in range(2 * size):
                total += rows[r, i] * x[i]
            outputs[sample, r] = total
