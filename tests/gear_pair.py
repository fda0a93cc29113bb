"""The gear pair of Wijianto's model, four degrees of freedom, as the tests of integrators and their benchmark take it.

q = r1 theta1 - r2 theta2 is positive where the pinion drives; numbers of the set are those with which the natural
frequencies round to every printed one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from data_synth.dynamics.system import Mesh, System
from data_synth.integrators.problem import Load, Output, Problem
from data_synth.operation.shaft_angle import ShaftAngle

MASSES = np.array([5.4221023337128938, 0.011246309345072218, 16.605188396995737, 0.10547808100593123])
RADII = (0.064407457476496844, 0.11271305058386948)
DIRECTION = np.array([-1.0, RADII[0], 1.0, -RADII[1]])
MEAN = 1e6
MESH_RAD_S = 8334.0
PERIOD_S = 2 * np.pi / MESH_RAD_S
TORQUE_NM = 75.0
DRAG = 0.0075
TOP_RAD_S = np.sqrt(1.75 * TORQUE_NM / DRAG)
LINEAR_DRAG = 131.25 / TOP_RAD_S
NAMES = ("pinion x", "pinion rotation", "gear x", "gear rotation")


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Any stiffness over the phase."""

    value: Callable[[np.ndarray], np.ndarray]
    mean: float = MEAN
    period: int = 1
    jumps: tuple[float, ...] = ()
    harmonics: None = None

    def __call__(self, phase_cycles):
        """Return N/m."""
        return self.value(np.asarray(phase_cycles, dtype=np.float64))


def rectangle(low=0.76e6, high=1.36e6, duty=0.4):
    """Return a stiffness that is high for the first part of its cycle."""
    return Curve(
        value=lambda p: np.where(np.mod(p, 1) < duty, high, low),
        mean=duty * high + (1 - duty) * low,
        jumps=(0.0, duty),
    )


def constant(stiffness=MEAN):
    """Return the same stiffness everywhere."""
    return Curve(value=lambda p: np.full(np.shape(p), stiffness), mean=stiffness)


def ten_harmonics():
    """Return the first ten harmonics of the rectangle."""
    h = np.arange(1, 11)
    c = 0.6e6 * (1 - np.exp(-0.8j * np.pi * h)) / (1j * np.pi * h)
    return Curve(value=lambda p: MEAN + np.real(np.exp(2j * np.pi * np.multiply.outer(p, h)) @ c))


def pair(stiffness, *, bearings=1e8, damping=None, backlash_m=0.0, error=None, direction=DIRECTION):
    """Return the system with one mesh."""
    mesh = Mesh(name="pair", direction=direction, stiffness=stiffness, backlash_m=backlash_m, error=error)
    return System(
        mass=np.diag(MASSES),
        damping=np.zeros((4, 4)) if damping is None else damping,
        stiffness=np.diag([bearings, 0, bearings, 0]),
        meshes=(mesh,),
        names=NAMES,
    )


def turning(mesh_rad_s=MESH_RAD_S):
    """Return a reference that passes one mesh cycle a revolution, at constant speed."""
    return ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([mesh_rad_s / (2 * np.pi)]))


def driven(system, *, duration_s, drag=0.0, torque_nm=TORQUE_NM, **settings):
    """Return the pair driven by a torque on the pinion."""
    load = Load(constant=np.array([0, torque_nm, 0, 0]), quadratic_drag=np.array([0, 0, 0, drag]) if drag else None)
    return Problem(**{"reference": turning()} | settings, system=system, load=load, duration_s=duration_s)


def output(rate_hz):
    """Read q, x2' and w2."""
    q = np.zeros((3, 4))
    q[0, [1, 3]] = RADII[0], -RADII[1]
    v = np.zeros((3, 4))
    v[1, 2] = v[2, 3] = 1
    return Output(rate_hz=rate_hz, displacement=q, velocity=v)


def state_output(rate_hz):
    """Read x1, x2, q, x2', w2: the entries of the state oracles."""
    q, v = np.zeros((5, 4)), np.zeros((5, 4))
    q[0, 0] = q[1, 2] = 1
    q[2, [1, 3]] = RADII[0], -RADII[1]
    v[3, 2] = v[4, 3] = 1
    return Output(rate_hz=rate_hz, displacement=q, velocity=v)


def worst(values, reference):
    """Return the RMS of the difference over the RMS, of the worst channel."""
    return float(np.max(np.sqrt(np.mean((values - reference) ** 2, axis=0) / np.mean(reference**2, axis=0))))


def by_scipy(problem, read, *, relative=1e-9, absolute=1e-14, method="DOP853", teeth=None):
    """Read displacements and velocities of the equations as `data_synth.dynamics.system` writes them, solved by scipy.

    It knows nothing of modes, jumps or contacts, and finds its way by making its steps smaller. `teeth` gives stiffness
    and error of meshes at a time in s, in place of their own.
    """
    system, load, turns = problem.system, problem.load, problem.reference
    dof = len(system.names)
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    drag = np.zeros(dof) if load.quadratic_drag is None else load.quadratic_drag

    def rates(t, y):
        q, v = y[:dof], y[dof:]
        angle = turns.revolutions([t])[0]
        force = load.constant - damping @ v - system.stiffness @ q - drag * v * np.abs(v)
        if load.varying is not None:
            force = force + load.varying(np.array([t]))[0]
        for mesh in system.meshes:
            phase = mesh.cycles_per_rev * angle
            own = mesh.stiffness(phase), 0.0 if mesh.error is None else mesh.error(phase)
            stiffness, error = own if teeth is None else teeth(t)
            delta = mesh.direction @ q - error
            pressed = stiffness * (delta - min(max(delta, -mesh.backlash_m), mesh.backlash_m))
            force = force - mesh.direction * pressed
            driving = max(pressed, 0.0) if mesh.backlash_m > 0 else pressed
            for rub in mesh.friction:
                force = force + rub.direction * (driving * rub.factor(phase))
        return np.concatenate([v, np.linalg.solve(system.mass, force)])

    times_s = problem.start_s + np.arange(round(problem.duration_s * read.rate_hz) + 1) / read.rate_hz
    # no solver may step over a mesh cycle unseen
    fastest = np.max(np.abs(np.diff(turns.revolutions(times_s)))) * read.rate_hz
    longest = 0.25 / (fastest * max(mesh.cycles_per_rev for mesh in system.meshes))
    start = np.zeros(2 * dof)
    if problem.start is not None:
        start = np.concatenate([problem.start.displacement, problem.start.velocity])
    settings = {"rtol": relative, "atol": absolute, "max_step": longest}
    found = solve_ivp(rates, (times_s[0], times_s[-1]), start, method=method, t_eval=times_s, **settings)
    assert found.success, found.message
    values = 0.0
    for rows, states in ((read.displacement, found.y[:dof]), (read.velocity, found.y[dof:])):
        values = values if rows is None else values + states.T @ rows.T
    return values


def by_exponentials(problem, read):
    """Read displacements and velocities of stiffness that is constant between jumps, by `expm` from jump to jump."""
    system, turns, dof = problem.system, problem.reference, len(problem.system.names)
    times_s = problem.start_s + np.arange(round(problem.duration_s * read.rate_hz) + 1) / read.rate_hz
    jumps_s = []
    for mesh in system.meshes:
        first, last = mesh.cycles_per_rev * turns.revolutions(times_s[[0, -1]])
        phases = np.add.outer(np.arange(np.floor(first), np.ceil(last)), mesh.stiffness.jumps).ravel()
        jumps_s.append(turns.times(phases[(phases > first) & (phases < last)] / mesh.cycles_per_rev))
    edges = np.union1d(times_s, np.concatenate(jumps_s))
    y, states = np.append(np.zeros(2 * dof), 1.0), [np.zeros(2 * dof)]
    for start, stop in pairwise(edges):
        rates = np.zeros((2 * dof + 1, 2 * dof + 1))
        stiffness = system.stiffness.astype(float)
        for mesh in system.meshes:
            phase = mesh.cycles_per_rev * turns.revolutions([(start + stop) / 2])
            stiffness += mesh.stiffness(phase)[0] * np.outer(mesh.direction, mesh.direction)
        rates[:dof, dof:-1] = np.eye(dof)
        rates[dof:-1] = np.linalg.solve(
            system.mass, np.column_stack([-stiffness, -system.damping, problem.load.constant])
        )
        y = expm(rates * (stop - start)) @ y
        states.append(y[:-1])
    states = np.array(states)[np.searchsorted(edges, times_s)]
    return states[:, :dof] @ read.displacement.T + states[:, dof:] @ read.velocity.T
