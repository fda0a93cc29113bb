"""Friction between teeth in the equations of motion: the sixteen degrees of freedom of Howard's layout."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from gear_pair import MASSES, turning, worst
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from data_synth.dynamics.elements import Coupling, GearMesh, Support
from data_synth.dynamics.modes import solve_modes
from data_synth.dynamics.stability import floquet
from data_synth.dynamics.system import PLANE, Body, MeshHistory, build_system
from data_synth.gears.friction import SlidingFriction
from data_synth.gears.geometry import GearPair
from data_synth.gears.mesh_stiffness import Fourier, Rectangular
from data_synth.integrators.driver import integrate
from data_synth.integrators.problem import Load, Output, Problem
from data_synth.vibration.steady_state import periodic_state

GEARS = GearPair(
    teeth=(36, 63),
    module_m=3.5e-3,
    face_width_m=0.03,
    pressure_angle_rad=math.radians(20),
    helix_angle_rad=math.radians(12),
)
BASE = 0.060363908371477926, 0.10563683965008637  # m
MASS, INERTIA = MASSES[[0, 2]], MASSES[[1, 3]]
WAVE = Fourier(mean=1e9, harmonics=np.array([2e8 - 1e8j, 5e7j, 2e7]))
FRICTION = SlidingFriction(gears=GEARS, coefficient=0.08)
TORQUES = 75.0, 75.0 * 1.75
MESH_HZ = 1300.0
BLOCKS = [f"{side} block {end}" for side in ("pinion", "gear") for end in (1, 2)]


def sixteen(*, friction=FRICTION, stiffness=WAVE, backlash_m=0.0, damping_s=0.0, **mesh):
    """Return the layout: the line of action along y, pinion driving ccw, the gear's rotation as it is driven."""
    rise = math.tan(GEARS.working_angle_rad)
    turns, moves = ("rotation",), ("x", "y")
    bodies = [
        Body(name="motor", inertia_kgm2=4.3e-3, motions=turns),
        Body(name="pinion", mass_kg=MASS[0], inertia_kgm2=INERTIA[0], motions=PLANE),
        Body(
            name="gear",
            mass_kg=MASS[1],
            inertia_kgm2=INERTIA[1],
            motions=PLANE,
            centre_m=(sum(BASE), sum(BASE) * rise, 0),
            axis=(0, 0, -1),
        ),
        Body(name="load", inertia_kgm2=4.5e-3, motions=turns, axis=(0, 0, -1)),
        *(Body(name=name, mass_kg=1.8 if "pinion" in name else 2.5, motions=moves) for name in BLOCKS),
    ]
    elements = [
        *(Support(between=(name.split()[0], name), x=2e8, y=2e8, damping_s=damping_s) for name in BLOCKS),
        *(Support(between=(name, None), x=1e8, y=1e8, damping_s=damping_s) for name in BLOCKS),
        Coupling(
            motions={("motor", "rotation"): 1.0, ("pinion", "rotation"): -1.0}, stiffness=1e5, damping=1e5 * damping_s
        ),
        Coupling(
            motions={("gear", "rotation"): 1.0, ("load", "rotation"): -1.0}, stiffness=1e5, damping=1e5 * damping_s
        ),
        GearMesh(
            name="mesh",
            gears=("pinion", "gear"),
            direction=(0, 1, 0),
            point_m=(BASE[0], BASE[0] * rise, 0),
            stiffness=stiffness,
            backlash_m=backlash_m,
            friction=friction,
            **mesh,
        ),
    ]
    return build_system(bodies, elements)


def started(system, *, duration_s=0.004, **settings):
    """Return the layout loaded from rest."""
    load = np.zeros(16)
    load[system.names.index("motor rotation")] = TORQUES[0]
    load[system.names.index("load rotation")] = -TORQUES[1]
    spin = turning(2 * math.pi * MESH_HZ)
    return Problem(system=system, reference=spin, load=Load(constant=load), duration_s=duration_s, **settings)


def everything(rate_hz):
    """Read displacements and velocities."""
    eye, zero = np.eye(16), np.zeros((16, 16))
    return Output(rate_hz=rate_hz, displacement=np.vstack([eye, zero]), velocity=np.vstack([zero, eye]))


def heard(rate_hz):
    """Read the mesh's deflection and the sideways velocity of both gears."""
    q, v = np.zeros((3, 16)), np.zeros((3, 16))
    names = sixteen().names
    q[0] = sixteen().meshes[0].direction
    v[1, names.index("pinion x")] = v[2, names.index("gear x")] = 1
    return Output(rate_hz=rate_hz, displacement=q, velocity=v)


def run(problem, *, steps=1, rate_hz=200e3, read=everything):
    return integrate(problem, output=read(rate_hz), steps=steps).values


def by_hand(system, *, duration_s, rate_hz, half_gap):
    """The equations of the layout, written out, by Dormand and Prince's method from jump to jump of the friction."""
    at = {name: number for number, name in enumerate(system.names)}
    mass = np.diag(system.mass)

    def accelerations(t, q):
        phase = MESH_HZ * t

        def here(name):
            return q[at[name]]

        deflection = BASE[0] * here("pinion rotation") - BASE[1] * here("gear rotation")
        deflection += here("pinion y") - here("gear y")
        turn = np.exp(2j * np.pi * phase)
        stiffness = 1e9 + ((2e8 - 1e8j) * turn + 5e7j * turn**2 + 2e7 * turn**3).real
        force = stiffness * (deflection - np.clip(deflection, -half_gap, half_gap))
        rubbing = max(force, 0.0) if half_gap else force
        one, two = FRICTION.moment_arms_m(phase)
        side = float(FRICTION.sideways(phase)) * rubbing
        out = np.zeros(16)
        shaft = [
            1e5 * (here("motor rotation") - here("pinion rotation")),
            1e5 * (here("gear rotation") - here("load rotation")),
        ]
        out[at["motor rotation"]] = TORQUES[0] - shaft[0]
        out[at["pinion rotation"]] = shaft[0] - BASE[0] * force + float(one) * rubbing
        out[at["gear rotation"]] = BASE[1] * force - shaft[1] + float(two) * rubbing
        out[at["load rotation"]] = shaft[1] - TORQUES[1]
        # z x y is -x: the driver is pushed there before the pitch point
        out[at["pinion x"]], out[at["gear x"]] = -side, side
        out[at["pinion y"]], out[at["gear y"]] = -force, force
        for name in BLOCKS:
            for way in ("x", "y"):
                gear = f"{name.split()[0]} {way}"
                pull = 2e8 * (here(gear) - here(f"{name} {way}"))
                out[at[gear]] -= pull
                out[at[f"{name} {way}"]] += pull - 1e8 * here(f"{name} {way}")
        return out / mass

    times_s = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    jumps = {(jump + cycle) / MESH_HZ for jump in FRICTION.shares[0].jumps for cycle in range(9)}
    edges = [0.0, *sorted(jump for jump in jumps if 0 < jump < times_s[-1]), times_s[-1]]
    state, found = np.zeros(32), []
    for start, stop in itertools.pairwise(edges):
        inside = times_s[(times_s >= start) & (times_s < stop)]
        path = solve_ivp(
            # a jump belongs to the segment that follows it, as in the model; just before it, what was before
            lambda t, z, stop=stop: np.concatenate([z[16:], accelerations(min(t, stop - 1e-12), z[:16])]),
            (start, stop),
            state,
            method="DOP853",
            t_eval=[*inside, stop],
            rtol=1e-10,
            atol=1e-16,
            max_step=2e-5,
        )
        found.append(path.y.T[:-1])
        state = path.y[:, -1]
    return np.concatenate([*found, state[None]])


def test_the_layout_has_its_printed_modes():
    assert_allclose(GEARS.base_radii_m, BASE, rtol=1e-12)
    printed = "0 383.1702 421.9928 583.1654 683.8766 764.1074 853.7006 1743.455 1743.455 1847.3756 1863.2594"
    printed += " 2054.6815 2054.6815 2254.9353 2371.223 4234.1812"
    modes = solve_modes(sixteen())
    assert_allclose(modes.frequencies_hz, [float(text) for text in printed.split()], atol=5.1e-5)


@pytest.mark.parametrize("half_gap", [0.0, 2e-6])
def test_both_engines_solve_the_equations_of_the_layout(half_gap):
    system = sixteen(backlash_m=half_gap)
    problem = started(system)
    split = run(problem, steps=8)
    written = by_hand(system, duration_s=0.004, rate_hz=200e3, half_gap=half_gap)
    deflections = split[:, :16] @ system.meshes[0].direction
    assert not half_gap or np.min(deflections[200:]) < half_gap  # teeth part after they have met
    # what rubs: without it the sideways motions stay at zero
    assert np.ptp(split[:, system.names.index("pinion x")]) > 1e-7
    # steps of 0.6 us: of contacts in a step 1e-5 is left, else what scipy's tolerance leaves
    assert worst(split, written) < (2e-5 if half_gap else 1e-7)


def test_the_splitting_keeps_its_order_with_friction():
    problem = started(sixteen(damping_s=1e-6), duration_s=0.02)
    fine = run(problem, steps=64, rate_hz=13e3, read=heard)
    errors = [worst(run(problem, steps=steps, rate_hz=13e3, read=heard), fine) for steps in (4, 8, 16)]
    # 2^4, less a fifth for the next order's share, though friction jumps within steps
    assert errors[0] > 12.8 * errors[1] > 12.8**2 * errors[2]


def test_teeth_that_change_rub_with_what_they_have():
    # twice as stiff from the start as the end of a history that has not begun
    history = MeshHistory(
        times_s=np.array([1.0, 2.0]), stiffnesses=(WAVE, replace(WAVE, mean=2e9)), errors=(None, None)
    )
    system = sixteen()
    system = replace(system, meshes=(replace(system.meshes[0], history=history),))
    early = run(started(system, duration_s=0.002))
    # sums in another order: of motions that cancel, 1e-18 m beside 1e-7 m of the gears is left
    assert_allclose(early, run(started(sixteen(), duration_s=0.002)), rtol=1e-12, atol=1e-16)
    late = run(started(system, duration_s=0.002, start_s=2.0))
    stiff = replace(system.meshes[0], stiffness=replace(WAVE, mean=2e9), history=None)
    same = run(started(replace(system, meshes=(stiff,)), duration_s=0.002, start_s=2.0))
    assert worst(late, same) < 1e-5  # flows of different constant parts, by fourth-order steps


def test_floquet_s_multipliers_are_those_of_shooting():
    system = sixteen(stiffness=Rectangular(low=0.7e9, high=1.2e9, duty=0.4), damping_s=1e-5)
    problem = replace(started(system, duration_s=1 / MESH_HZ), load=Load(constant=np.zeros(16)))
    shot = periodic_state(problem, output=heard(1.0), samples=200)
    found = floquet(system, speed_rad_s=2 * math.pi * MESH_HZ).multipliers
    largest = np.sort(np.abs(shot.multipliers[np.abs(np.abs(shot.multipliers) - 1) > 1e-6]))[::-1][:8]
    assert_allclose(np.sort(np.abs(found[np.abs(np.abs(found) - 1) > 1e-6]))[::-1][:8], largest, rtol=1e-6)
    rubless = floquet(sixteen(friction=None, stiffness=system.meshes[0].stiffness, damping_s=1e-5), speed_rad_s=8168.0)
    assert np.max(np.abs(np.abs(found[:8]) - np.abs(rubless.multipliers[:8]))) > 1e-5


def test_friction_of_other_gears_is_refused():
    other = SlidingFriction(gears=replace(GEARS, module_m=4e-3), coefficient=0.08)
    with pytest.raises(ValueError, match=r"passes \"pinion\" at 0\.0603639 m.*base radius of 0\.0689873 m"):
        sixteen(friction=other)
