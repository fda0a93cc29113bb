"""Compiled steps of the exponential splitting: exact flow of the constant part, impulses by the forces.

Each operation is rounded as written, and functions that are inlined allocate no arrays. Loops replace assignments to
slices, each of which takes half a second to compile.
"""

import numpy as np
from numpy.typing import NDArray

from data_synth.integrators._periodic_kernels import (
    jumps_within,
    legendre,
    legendre_of_product,
    legendre_short,
    value_at,
)
from data_synth.integrators.modal_problem import Equations, StepFlow
from data_synth.integrators.periodic_tables import Array, Waves
from signals._compile import compiled_exactly, compiled_inline

Booleans = NDArray[np.bool_]

C00, C02, C22 = 1 / 36, 1 / 180, 1 / 3150  # coefficients of the commutator
M0, M2 = 1 / 24, 1 / 480  # coefficients of the correction of the middle deflection
TILE = 256  # steps whose teeth are looked up together, so that look-ups need not wait for earlier steps
DEFLECTION, COMPRESSION, CONTACT, IN_FLOW, CORRECTION = range(5)  # current values per mesh


@compiled_inline
def add_product(columns: Array, x: Array, out: Array) -> None:
    """Add the product with a matrix whose columns are the rows of `columns`."""
    for j in range(x.size):
        for i in range(out.size):
            out[i] += columns[j, i] * x[j]


@compiled_inline
def dead_zone(deflection: float, half_gap: float, back_half_gap: float) -> tuple[float, float]:
    """Return the elastic compression of the teeth, negative on the back flanks, and 1 in contact or 0."""
    if half_gap <= 0.0:
        return deflection, 1.0
    if deflection > half_gap:
        return deflection - half_gap, 1.0
    if deflection < -back_half_gap:
        return deflection + back_half_gap, 1.0
    return 0.0, 0.0


@compiled_inline
def let_act(x: Array, impulses: Array, directions: Array) -> None:
    """Apply impulses to the modal velocities and set them to zero."""
    size = directions.shape[1]
    for k in range(impulses.size):
        for i in range(size):
            x[size + i] += directions[k, i] * impulses[k]
        impulses[k] = 0.0


@compiled_inline
def speeds_with_drag(x: Array, drags: Array, speeds: Array) -> None:
    """Compute the speeds with drag."""
    for d in range(speeds.size):
        speeds[d] = 0.0
        for i in range(drags.shape[1]):
            speeds[d] += drags[d, i] * x[drags.shape[1] + i]


@compiled_inline
def brake(
    time: float, speeds: Array, impulses: Array, factors: Array, speed_changes: Array, first: int, forward: bool
) -> None:
    """Integrate ``v' = -(c / m) v abs(v)`` exactly over a time for each speed with drag, and add its impulse.

    The impulse of the first speed has the index `first`.
    """
    count = speeds.size
    for n in range(count):
        d = n if forward else count - 1 - n
        braked = factors[d] * abs(speeds[d]) * time
        change = -speeds[d] * braked / (1.0 + speed_changes[d, first + d] * braked)
        impulses[first + d] += change
        for e in range(count):
            speeds[e] += speed_changes[e, first + d] * change


@compiled_inline
def instant_of(position: float, late: int) -> tuple[int, float]:
    """Return the number of the instant of a history before or, with `late` = 1, after a position, and its weight."""
    before = int(position)
    share = position - before
    return before + late, share if late == 1 else 1.0 - share


@compiled_inline
def interpolated(waves: Waves, first: int, position: float, phase: float) -> float:
    """Return the value at a position in the history of a mesh, of which the table `first` is the first."""
    value = 0.0
    for late in range(2):
        number, part = instant_of(position, late)
        if part > 0.0:
            value += part * value_at(waves, first + number, phase)
    return value


@compiled_exactly
def read_jump(equations: Equations, m: int, begin: float, end: float, position: float, jump: Array) -> None:
    """Fill `jump` (6,) with Legendre coefficients over a step in which the error of a force jumps.

    Those of stiffness times error come first, then those of the error; both are interpolated in the histories.
    """
    for i in range(6):
        jump[i] = 0.0
    for e_late in range(2):
        e_number, e_part = instant_of(position, e_late)
        if e_part == 0.0:
            continue
        error = equations.first_error[m] + e_number
        for k_late in range(2):
            k_number, k_part = instant_of(position, k_late)
            if k_part > 0.0:
                table = equations.first_stiffness[m] + k_number
                product = legendre_of_product(equations.stiffnesses, table, equations.errors, error, begin, end)
                for i in range(3):
                    jump[i] += e_part * k_part * product[i]
        own = legendre_short(equations.errors, error, begin, end)
        for i in range(3):
            jump[3 + i] += e_part * own[i]


@compiled_exactly
def read_teeth(
    equations: Equations, turns: Array, positions: Array, first: int, known: Array,
    stiffness: Array, errors: Array, jumping: Booleans, jumps: Array,
) -> None:  # fmt: skip
    """Look up the teeth over steps that begin and end at `turns` (steps + 1,), in rev of the reference.

    `stiffness` (steps, meshes, 3) receives Legendre coefficients over each step, `errors` (steps, meshes, 3) the
    transmission errors at its beginning, middle and end, and `jumping` (steps, meshes) whether they jump in between; if
    so, `jumps` (steps, meshes, 6) receives the result of `read_jump`. `positions` are those in the histories, from step
    `first` on; `known` is that of `legendre`.
    """
    waves, steps = equations.stiffnesses, turns.size - 1
    for m in range(equations.cycles.size):
        cycles, table, error = equations.cycles[m], equations.first_stiffness[m], equations.first_error[m]
        for step in range(steps):
            begin, end = cycles * turns[step], cycles * turns[step + 1]
            a0, a1, a2 = 0.0, 0.0, 0.0
            for late in range(2):
                number, part = instant_of(positions[first + step, m], late)
                if part > 0.0:
                    b0, b1, b2 = legendre(waves, table + number, begin, end, known)
                    a0, a1, a2 = a0 + part * b0, a1 + part * b1, a2 + part * b2
            stiffness[step, m, 0], stiffness[step, m, 1], stiffness[step, m, 2] = a0, a1, a2
        for step in range(steps):
            jumping[step, m] = False
            if not equations.jumping[m]:
                continue
            begin, end = cycles * turns[step], cycles * turns[step + 1]
            position = positions[first + step, m]
            for late in range(2):
                number, part = instant_of(position, late)
                if part > 0.0 and not jumping[step, m]:
                    jumping[step, m] = jumps_within(equations.errors, error + number, begin, end)
            if jumping[step, m]:
                read_jump(equations, m, begin, end, position, jumps[step, m])
        for step in range(steps):
            start, stop, position = turns[step], turns[step + 1], positions[first + step, m]
            for node in range(3):
                turned = start if node == 0 else stop if node == 2 else 0.5 * (start + stop)  # noqa: PLR2004
                errors[step, m, node] = interpolated(equations.errors, error, position, cycles * turned)


@compiled_inline
def at_node(node: int, a0: float, a1: float, a2: float) -> float:
    """Return the mean over a step of a function weighted by the Lagrange polynomial of node 0, 1 or 2.

    a0 to a2 are the function's Legendre coefficients; the mean may be negative.
    """
    if node == 1:
        return a0 - 0.2 * a2
    return a0 + (node - 1) * a1 + 0.4 * a2


@compiled_inline
def triangular_weights(node: int, sub: int, per_sample: int, a0: float, a1: float, a2: float) -> tuple[float, float]:
    """Return the weights of the compression at a node of a step in the triangular means of a mesh force.

    The first weight is for the rising half of the triangle, the second for both halves, whose sum is constant. They
    are integrals over the step of the stiffness, with Legendre coefficients a0 to a2, times the quadratic Lagrange
    polynomial of node 0, 1 or 2 (x = -1, 0 and 1), and of the same times x. `sub` is the number of the step within the
    sample.
    """
    if node == 1:
        moment, first_moment = (a0 - 0.2 * a2) * 2 / 3, a1 * 2 / 15
    else:
        side = node - 1
        moment, first_moment = (a0 + side * a1 + 0.4 * a2) / 6, side * (a0 / 6 + a2 / 15) + a1 / 10
    return (moment * (sub + 0.5) + 0.5 * first_moment) / per_sample**2, moment / per_sample


@compiled_exactly
def split_steps(
    start: Array,
    outputs: Array,
    rows: Array,
    per_sample: int,
    step: float,
    flow: StepFlow,
    equations: Equations,
    revolutions: Array,
    loads: Array,
    history_positions: Array,
    weighted_forces: Array,
    next_weighted: Array,
) -> None:
    """Propagate x over all samples of a block and compute the outputs at each.

    The exact flow includes the mean stiffness of each mesh, its transmission error and varying loads, as parabolas over
    each step, so that impulses do not grow with an error, however large. The remaining forces act as impulses at both
    ends of a step and in its middle: integrals of the stiffness times the quadratic Lagrange polynomials through these
    nodes, exact across jumps. The middle one also includes the commutator of two mesh forces: h^3 times a quadratic
    form of their Legendre coefficients. Impulses at the end of a step are applied together with those at the beginning
    of the next, except at a sample.

    The deflection at the middle node lacks `correction`, the effect of the forces up to there beyond the impulse at the
    start: it cancels over a step, but weighted mesh forces need it.

    `loads` (2 steps + 1, loads) are the varying loads at the beginning and in the middle of each step, and at the end.
    `history_positions` (steps, meshes) are those in the histories of the meshes. `weighted_forces` (samples, 2 meshes)
    receives the force of each mesh under the triangular weight, then the force at the sample, or is (0, 2 meshes) if
    the output has neither; `next_weighted` (meshes,) is the known part of the next weighted force. All cases share one
    compilation: absent parts are empty arrays.
    """
    deflection_rows, coupling = equations.deflection_rows, equations.coupling
    drags, drag_factors, speed_changes = equations.drags, equations.drag_factors, flow.speed_changes
    columns, added, directions, from_middle = flow.columns, flow.added, flow.directions, flow.from_middle
    size, meshes = deflection_rows.shape
    braked = drag_factors.size
    ends, middles, after = 2 * size, 2 * size + meshes, np.empty(added.size)  # where the deflections are in `after`
    # impulses in the middle of a step; x with the impulses at its beginning and the inputs
    impulse, state, speeds = np.zeros(from_middle.shape[0]), np.zeros(columns.shape[0]), np.zeros(braked)
    for i in range(ends):
        state[i] = start[i]
    x, pending, inputs = state[:ends], state[ends : ends + directions.shape[0]], state[ends + directions.shape[0] :]
    # values of a mesh are adjacent: loops over a few meshes do not benefit from vectors
    force, means = np.zeros((meshes, 5)), equations.mean_stiffnesses
    half_gaps, back_half_gaps, offsets = equations.backlashes, equations.back_half_gaps, equations.offsets
    for m in range(meshes):
        for i in range(size):
            force[m, DEFLECTION] += deflection_rows[i, m] * x[i]
    weighting = weighted_forces.shape[0] > 0
    sixth, two_thirds, cube = step / 6, step * 2 / 3, step**3
    steps = outputs.shape[0] * per_sample
    tile = min(steps, TILE)
    stiffness, errors = np.empty((tile, meshes, 3)), np.empty((tile, meshes, 3))
    jumping, jumps = np.empty((tile, meshes), dtype=np.bool_), np.empty((tile, meshes, 6))
    known = np.empty((equations.stiffnesses.means.size, 3))
    for which in range(known.shape[0]):
        known[which, 0] = np.nan  # no integrals are known
    for number in range(steps):
        sample, sub, here = number // per_sample, number % per_sample, number % tile
        if weighting and sub == 0:
            for m in range(next_weighted.size):
                weighted_forces[sample, m] = next_weighted[m]
                next_weighted[m] = 0.0
        if here == 0:
            some = revolutions[number : min(number + tile, steps) + 1]
            read_teeth(equations, some, history_positions, number, known, stiffness, errors, jumping, jumps)
        for m in range(meshes):
            for node in range(3):
                inputs[3 * m + node] = equations.following[m] * errors[here, m, node]
            if jumping[here, m]:  # the parabola of the same mean and moments
                e0, e1, e2 = jumps[here, m, 3], jumps[here, m, 4], jumps[here, m, 5]
                inputs[3 * m] = equations.following[m] * (e0 - e1 + e2)
                inputs[3 * m + 1] = equations.following[m] * (e0 - 0.5 * e2)
                inputs[3 * m + 2] = equations.following[m] * (e0 + e1 + e2)
        for load in range(loads.shape[1]):
            for node in range(3):
                inputs[3 * (meshes + load) + node] = loads[2 * number + node, load]
        for node in range(3):
            weight, acting = (two_thirds, impulse) if node == 1 else (sixth, pending)
            if node == 0 and braked:
                speeds_with_drag(x, drags, speeds)
                brake(sixth, speeds, pending, drag_factors, speed_changes, meshes, True)
            elif node == 1:
                for i in range(added.size):
                    after[i] = added[i]
                add_product(columns, state, after)
                for m in range(meshes):
                    force[m, DEFLECTION] = after[middles + m]
                for k in range(pending.size):
                    pending[k] = impulse[k] = 0.0
                for d in range(braked):
                    speeds[d] = after[middles + meshes + d]
                brake(two_thirds / 2, speeds, impulse, drag_factors, speed_changes, meshes, True)
            for m in range(meshes):
                deflection = force[m, DEFLECTION]
                force[m, COMPRESSION], force[m, CONTACT] = dead_zone(
                    deflection - errors[here, m, node], half_gaps[m], back_half_gaps[m]
                )
                followed = inputs[3 * m + node]
                strength = at_node(node, stiffness[here, m, 0], stiffness[here, m, 1], stiffness[here, m, 2])
                elastic = strength * force[m, COMPRESSION]
                if jumping[here, m]:
                    jump = jumps[here, m]
                    followed = equations.following[m] * at_node(node, jump[3], jump[4], jump[5])
                    exact = at_node(node, jump[0], jump[1], jump[2])
                    elastic += force[m, CONTACT] * (strength * errors[here, m, node] - exact)
                force[m, IN_FLOW] = means[m] * (deflection - followed - offsets[m])
                acting[m] -= weight * (elastic - force[m, IN_FLOW])
                force[m, CORRECTION] = 0.0
            if node == 1:  # commutator of two mesh forces
                for j in range(meshes):
                    a0, a1, a2 = stiffness[here, j, 0], stiffness[here, j, 1], stiffness[here, j, 2]
                    f0 = a0 * force[j, COMPRESSION] - force[j, IN_FLOW]
                    f1, f2 = a1 * force[j, COMPRESSION], a2 * force[j, COMPRESSION]
                    for i in range(meshes):
                        contact = force[i, CONTACT]
                        g0 = stiffness[here, i, 0] * contact - means[i]
                        g1, g2 = stiffness[here, i, 1] * contact, stiffness[here, i, 2] * contact
                        form = C00 * (f0 * g0) - C02 * (f0 * g2 + f2 * g0 + f1 * g1) - C22 * f2 * g2
                        impulse[i] += cube * coupling[i, j] * form
                        force[i, CORRECTION] += step * step * coupling[i, j] * (M0 * f0 - M2 * f2) * contact
            if weighting:
                for m in range(next_weighted.size):
                    a0, a1, a2 = stiffness[here, m, 0], stiffness[here, m, 1], stiffness[here, m, 2]
                    rising_weight, both_weights = triangular_weights(node, sub, per_sample, a0, a1, a2)
                    compression = force[m, COMPRESSION] - force[m, CORRECTION]
                    rising, both = rising_weight * compression, both_weights * compression
                    if jumping[here, m]:
                        jump, contact, error = jumps[here, m], force[m, CONTACT], errors[here, m, node]
                        exact, both_exact = triangular_weights(node, sub, per_sample, jump[0], jump[1], jump[2])
                        rising += contact * (rising_weight * error - exact)
                        both += contact * (both_weights * error - both_exact)
                    next_weighted[m] += rising
                    weighted_forces[sample, m] += both - rising
            if node != 1:
                continue
            for d in range(braked):
                for k in range(meshes):
                    speeds[d] += speed_changes[d, k] * impulse[k]
            brake(two_thirds / 2, speeds, impulse, drag_factors, speed_changes, meshes, False)
            add_product(from_middle, impulse, after[:middles])
            for i in range(ends):
                x[i] = after[i]
            for m in range(meshes):
                force[m, DEFLECTION] = after[ends + m]
        if braked:
            let_act(x, pending, directions)
            speeds_with_drag(x, drags, speeds)
            brake(sixth, speeds, pending, drag_factors, speed_changes, meshes, False)
        if braked or sub + 1 == per_sample:
            let_act(x, pending, directions)
        if sub + 1 < per_sample:
            continue
        if weighting:
            end = revolutions[number + 1]
            for m in range(next_weighted.size):
                first, position = equations.first_stiffness[m], history_positions[number, m]
                strength = interpolated(equations.stiffnesses, first, position, equations.cycles[m] * end)
                weighted_forces[sample, next_weighted.size + m] = strength * force[m, COMPRESSION]
        for r in range(rows.shape[0]):
            total = 0.0
            for i in range(2 * size):
                total += rows[r, i] * x[i]
            outputs[sample, r] = total
    for i in range(ends):
        start[i] = x[i]
