"""Systems of gears whose equations or frequencies are published, as several tests take them."""

import math

from gearboxes import held_planetary

from data_synth.dynamics.assembly import Inertia, MeshProperties, SupportStiffness, assemble
from data_synth.dynamics.elements import Coupling, GearMesh, GeneralMesh, Support
from data_synth.dynamics.system import PLANE, Body, build_system
from data_synth.gears.geometry import GearPair
from data_synth.gears.mesh_stiffness import Constant
from hums.gearbox.model import Gearbox

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


def planetary(count, *, teeth=(24, 36, 96), error=None, **changes):
    """Their planetary set as a gearbox: only teeth and base radii are ours, which their parameters leave open."""
    sun, planet, ring = teeth
    pressure, width, module = math.radians(24.6), 0.03, 2e-3
    gearbox = Gearbox.from_mapping(held_planetary(*teeth, copies=count))
    geometry = {
        name: GearPair(teeth=teeth, module_m=module, face_width_m=width, pressure_angle_rad=pressure)
        for name, teeth in {"sun-planet": (sun, planet), "planet-ring": (planet, -ring)}.items()
    }
    half = module / 2 * math.cos(pressure)
    base = {"sun": sun * half, "planet": planet * half, "ring": ring * half}
    base["carrier"] = geometry["sun-planet"].centre_distance_m
    given = {"sun": (0.4, 0.39), "ring": (2.35, 3.0), "carrier": (5.43, 6.29)}
    given |= {f"planet {number + 1}": (0.66, 0.61) for number in range(count)}
    inertias = {
        name: Inertia(mass_kg=mass, inertia_kgm2=inertia * base[name.split()[0]] ** 2)
        for name, (mass, inertia) in given.items()
    }
    settings = {
        "motions": "plane",
        "inertias": inertias,
        "supports": {"ring": SupportStiffness(torsion=1e9 * base["ring"] ** 2)},
        "meshes": {
            name: MeshProperties(geometry=pair, stiffness=Constant(mean=5e8), error=error)
            for name, pair in geometry.items()
        },
        **changes,
    }
    return assemble(gearbox, **settings).system
