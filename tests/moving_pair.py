"""Scenes of two gears that vibrate, and their motion, as several tests take them."""

from functools import partial

import numpy as np
from declared_pair import declared_pair

from data_synth import Scene
from data_synth.scene.random_streams import random_stream
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.run import motion_of

SEED = 3
ALPHA = np.radians(20)
MASSES, INERTIAS = (5.4221023337128938, 16.605188396995737), (0.011246309345072218, 0.10547808100593123)
BASE = 0.064407457476496844, 0.11271305058386948  # Wijianto's radii, 36 and 63 teeth, here of the base circles
MODULE_MM = 2e3 * BASE[0] / 36 / np.cos(ALPHA)
SCENE = {
    "gearbox": declared_pair(teeth=(36, 63), wheel="gear", module_mm=MODULE_MM),
    "rate_hz": 20_000,
    "duration_s": 0.3,
    "fidelity": "dynamic",
    "speed": {"link": "pinion", "rpm": 600},
    "torque": {"link": "gear", "nm": 130},
    "tachometer": {"link": "pinion", "pulses_per_rev": 12, "offset_rev": 0.03},
    "excitation": {"shaft_amplitude": 0, "speed_exponent": 1},
    "noise": {"rms": 0},
    "sensor": [{"name": "a", "on": "pinion", "direction": [0, 0, 1], "units": "m s-2", "anti_alias": "none"}],
}
DYNAMICS = {
    "links": {
        name: {"mass_kg": mass, "inertia_kg_m2": inertia}
        for name, mass, inertia in zip(("pinion", "gear"), MASSES, INERTIAS, strict=True)
    },
    "bearings": {"pinion": {"radial_n_m": 1e8}, "gear": {"radial_n_m": 1e8}},
    "meshes": {"mesh": {"shape": "trapezoid", "stiffness_n_m": 2e8, "error_um": 3, "backlash_um": 0}},
    "damping_ratio": 0.05,
    "housing_kg": 15,
    "mounts": {"frequency_hz": 150, "damping_ratio": 0.4},
    "elsewhere": 0.25,
    "rigid_below_hz": 1e-6,  # weights act at every frequency
    "error": 1e-5,
}


def scene(*, dynamics=None, mesh=None, **changes):
    table = DYNAMICS | (dynamics or {})
    table["meshes"] = {"mesh": {**table["meshes"]["mesh"], **(mesh or {})}}
    return Scene.from_mapping({**SCENE, "dynamics": table, **changes})


def stage_of(declared, seed=SEED):
    return prepare_scene(declared, rng_for=partial(random_stream, seed))


def motion(declared, seed=SEED):
    stage = stage_of(declared, seed)
    return motion_of(stage)
