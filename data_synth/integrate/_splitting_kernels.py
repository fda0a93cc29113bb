"""Compiled steps of the exponential splitting: exact flow of the constant part, rank-one kicks by the meshes."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside
from data_synth.integrate._equations import Equations
from data_synth.integrate._wave_kernels import SHORT, integrals_at, legendre, legendre_short, value_at
from data_synth.integrate._waves import Waves

Array = NDArray[np.float64]

BOTH, CROSSED, BENT = 1 / 36, 1 / 180, 1 / 3150  # of the commutator
EVEN, BULGE = 1 / 24, 1 / 480  # of what the middle lacks


@compiled_inside
def dead_zone(deflection: float, half_gap: float, back: float) -> tuple[float, float]:
    """Return how far teeth are pressed together, negative on the back flanks, and 1 in contact, else 0."""
    if half_gap <= 0.0:
        return deflection, 1.0
    if deflection > half_gap:
        return deflection - half_gap, 1.0
    if deflection < -back:
        return deflection + back, 1.0
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
def drag_for(x: Array, time: float, drags: Array, factors: Array, inverse_masses: Array, forward: bool) -> None:
    """Let ``v' = -(c / m) v abs(v)`` act for a time, exactly, on each dragged velocity."""
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
def tables_at(first: int, later: int, stage: float) -> tuple[int, int, float]:
    """Return the tables of the stages before and after a place in the course of a mesh, and where between them it is.

    Stage 0 is table `first`, stage 1 table `later`, the next ones follow; `later` below zero: nothing changes.
    """
    if later < 0:
        return first, first, 0.0
    number = int(stage)
    share = stage - number
    before = first if number == 0 else later + number - 1
    return before, before if share == 0.0 else later + number, share


@compiled_inside
def between(waves: Waves, now: int, then: int, share: float, phase: float) -> float:
    """Return the value between two tables, by the share of the second."""
    value = 0.0
    table, part = now, 1.0 - share
    while True:
        value += part * value_at(waves, table, phase)
        if table == then:
            break
        table, part = then, share
    return value


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


@compiled_inside
def under_hats(node: int, sub: int, per_sample: int, a0: float, a1: float, a2: float) -> tuple[float, float]:
    """Return by what the deflection at a node counts in the hat that rises here, and in that and the one that falls.

    The integrals over a step of a stiffness, of Legendre coefficients a, times the quadratic polynomials of Lagrange
    through both ends and the middle, x = -1, 0 and 1; and of the same times x.
    """
    if node == 1:
        mean, slant = (a0 - 0.2 * a2) * 2 / 3, a1 * 2 / 15
    else:
        side = node - 1
        mean, slant = (a0 + side * a1 + 0.4 * a2) / 6, side * (a0 / 6 + a2 / 15) + a1 / 10
    return (mean * (sub + 0.5) + 0.5 * slant) / per_sample**2, mean / per_sample


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
    stages: Array,
    felt: Array,
    coming: Array,
) -> None:
    """Advance x through all samples of a block and read it at each.

    Per step the meshes kick at both ends and in the middle. Their strengths are integrals of the stiffness times the
    quadratic polynomials of Lagrange through these nodes, exact across jumps; the middle one also holds the
    commutator of two mesh forces: h^3 times a quadratic form of their Legendre coefficients.
    The middle node's deflection lacks `short`, what forces do until then beyond the kick at the start: over the step
    that evens out, but where a force is felt it is set right.
    `half` holds a row (6,) a mode where `classical`, else what `flow_at_once` takes; both over half a step.
    `stages` (steps, meshes) says where in their course meshes are that change in time; (0, meshes) where none does.
    `felt` (samples, 2 meshes) takes the force of each mesh weighted with a hat from two samples ago to now, then the
    force now, and `coming` (meshes,) what is felt of the next hat, in which the force now counts most; (0, 2 meshes)
    where nobody asks. All cases share one compilation: absent parts are empty arrays.
    """
    pushes, seen, tied, cycles = equations.pushes, equations.seen, equations.tied, equations.cycles
    stiffnesses, coupling, means = equations.stiffnesses, equations.coupling, equations.held
    drags, drag_factors, error_of = equations.drags, equations.drag_factors, equations.error_of
    size, meshes = pushes.shape
    other = np.empty(2 * size)
    a0, a1, a2 = np.empty(meshes), np.empty(meshes), np.empty(meshes)
    delta, impulse = np.zeros(meshes), np.zeros(meshes)
    errors = np.zeros((3, meshes))
    pressed, touching, short = np.zeros(meshes), np.zeros(meshes), np.zeros(meshes)
    tables, inverse_masses = stiffnesses.means.size, np.empty(drag_factors.size)
    for d in range(drag_factors.size):
        inverse_masses[d] = np.sum(drags[d] * drags[d])
    at_start, at_stop = np.full((tables, 3), np.nan), np.full((tables, 3), np.nan)
    changing, hearing = stages.shape[0] > 0, felt.shape[0] > 0
    sixth, two_thirds, cube = step / 6, step * 2 / 3, step**3
    stop = 0.0
    deflect(x, seen, delta)
    for sample in range(readings.shape[0]):
        if hearing:
            for m in range(coming.size):
                felt[sample, m] = coming[m]
                coming[m] = 0.0
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
                begin, end = cycles[m] * start, cycles[m] * stop
                stage = stages[number, m] if changing else 0.0
                now, then, share = tables_at(m, equations.stiffness_later[m], stage)
                a0[m] = a1[m] = a2[m] = 0.0
                table, part = now, 1.0 - share
                while True:
                    b0, b1, b2 = moments_of_step(stiffnesses, table, begin, end, at_start, at_stop, tied.size > 0)
                    a0[m] += part * b0
                    a1[m] += part * b1
                    a2[m] += part * b2
                    for i in range(3):
                        at_start[table, i] = at_stop[table, i]
                    if table == then:
                        break
                    table, part = then, share
            for m in range(meshes):
                if error_of[m] >= 0:
                    stage = stages[number, m] if changing else 0.0
                    now, then, share = tables_at(error_of[m], equations.error_later[m], stage)
                    for node in range(3):
                        phase = cycles[m] * (start + 0.5 * node * (stop - start))
                        errors[node, m] = between(equations.errors, now, then, share, phase)
            for node in range(3):
                if node == 1 or node == 2:  # noqa: PLR1714, PLR2004
                    if classical:
                        flow_by_modes(x, half, pushes, impulse, seen, delta)
                    else:
                        flow_at_once(x, other, half, pushes, impulse, seen, delta)
                weight = two_thirds if node == 1 else sixth
                if node < 2:  # noqa: PLR2004
                    drag_for(x, two_thirds / 2 if node == 1 else sixth, drags, drag_factors, inverse_masses, True)
                for m in range(meshes):
                    gap = delta[m] - errors[node, m]
                    pressed[m], touching[m] = dead_zone(gap, equations.backlashes[m], equations.backs[m])
                    strength = a0[m] - 0.2 * a2[m] if node == 1 else a0[m] + (node - 1) * a1[m] + 0.4 * a2[m]
                    impulse[m] = weight * (strength * pressed[m] - means[m] * delta[m])
                    if hearing:
                        short[m] = 0.0
                if node == 1:
                    for i in range(meshes):
                        g0 = a0[i] * touching[i] - means[i]
                        g1, g2 = a1[i] * touching[i], a2[i] * touching[i]
                        for j in range(meshes):
                            f0 = a0[j] * pressed[j] - means[j] * delta[j]
                            f1, f2 = a1[j] * pressed[j], a2[j] * pressed[j]
                            form = BOTH * (f0 * g0) - CROSSED * (f0 * g2 + f2 * g0 + f1 * g1) - BENT * f2 * g2
                            impulse[i] -= cube * coupling[i, j] * form
                            if hearing:
                                short[i] += step * step * coupling[i, j] * (EVEN * f0 - BULGE * f2) * touching[i]
                if hearing:
                    for m in range(coming.size):
                        rising, whole = under_hats(node, sub, per_sample, a0[m], a1[m], a2[m])
                        coming[m] += rising * (pressed[m] - short[m])
                        felt[sample, m] += (whole - rising) * (pressed[m] - short[m])
                if loads.shape[0]:
                    load = loads[2 * number + node]
                    for i in range(size):
                        x[size + i] += weight * load[i]
                if node == 1 and drag_factors.size:
                    push(x, pushes, impulse)
                    drag_for(x, two_thirds / 2, drags, drag_factors, inverse_masses, False)
                    for m in range(meshes):
                        impulse[m] = 0.0
            push(x, pushes, impulse)
            drag_for(x, sixth, drags, drag_factors, inverse_masses, False)
        if hearing:
            for m in range(coming.size):
                stage = stages[(sample + 1) * per_sample - 1, m] if changing else 0.0
                now, then, share = tables_at(m, equations.stiffness_later[m], stage)
                strength = between(stiffnesses, now, then, share, cycles[m] * stop)
                felt[sample, coming.size + m] = strength * pressed[m]
        for r in range(rows.shape[0]):
            row = rows[r]
            total = constant[r]
            for i in range(2 * size):
                total += row[i] * x[i]
            readings[sample, r] = total
