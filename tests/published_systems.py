"""Systems of gears whose equations or frequencies are published, as several tests take them."""

import math

from data_synth.dynamics.elements import Coupling, GearMesh, GeneralMesh, Support
from data_synth.dynamics.system import PLANE, Body, build_system
from data_synth.gears.mesh_stiffness import Constant

# the gear pair of Wijianto with exact pitch radii: 36/63 teeth, module 3.5 mm, helix 12 degrees
MASSES = (5.4221023337128938, 16.605188396995737)
INERTIAS = (0.011246309345072218, 0.10547808100593123)
RADII = (0.064407457476496844, 0.11271305058386948)
ALPHA = math.radians(20)


def wijianto(*, bearing=1e8, mesh=None, error=None):
    """Four degrees of freedom: x1, theta1, x2, theta2, the mesh along x with h = (1, -r1, -1, r2)."""
    bodies = [
        Body(name="pinion", mass_kg=MASSES[0], inertia_kgm2=INERTIAS[0], motions=("x", "rotation")),
        Body(
            name="gear",
            mass_kg=MASSES[1],
            inertia_kgm2=INERTIAS[1],
            motions=("x", "rotation"),
            centre_m=(0, sum(RADII), 0),
            axis=(0, 0, -1),
        ),
    ]
    supports = [Support(between=(name, None), x=bearing) for name in ("pinion", "gear")]
    gears = GearMesh(
        name="mesh",
        gears=("pinion", "gear"),
        direction=(1, 0, 0),
        point_m=(0, RADII[0], 0),
        stiffness=mesh or Constant(mean=1e6),
        error=error,
    )
    return build_system(bodies, [*supports, gears])


def chaari():
    bodies = [
        Body(name="pinion", mass_kg=1.8, inertia_kgm2=2.7e-4, motions=PLANE),
        Body(name="motor", inertia_kgm2=4.3e-3, motions=("rotation",)),
        Body(name="gear", mass_kg=2.5, inertia_kgm2=2.7e-3, motions=PLANE),
        Body(name="load", inertia_kgm2=4.5e-3, motions=("rotation",)),
    ]
    base = 20 * 3e-3 / 2 * math.cos(ALPHA), 40 * 3e-3 / 2 * math.cos(ALPHA)
    sine, cosine = math.sin(ALPHA), math.cos(ALPHA)
    mesh = {
        ("pinion", "x"): sine,
        ("pinion", "y"): cosine,
        ("pinion", "rotation"): base[0],
        ("gear", "x"): -sine,
        ("gear", "y"): -cosine,
        ("gear", "rotation"): -base[1],
    }
    joints = [(("motor", "rotation"), ("pinion", "rotation")), (("gear", "rotation"), ("load", "rotation"))]
    return build_system(
        bodies,
        [
            *(Support(between=(name, None), x=1e8, y=1e8) for name in ("pinion", "gear")),
            *(Coupling(motions={one: 1.0, other: -1.0}, stiffness=1e5) for one, other in joints),
            GeneralMesh(name="mesh", motions=mesh, stiffness=Constant(mean=1e8)),
        ],
    )
