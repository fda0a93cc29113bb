"""Two gears as a scene declares them, one mesh on parallel axes, and a scene in which they vibrate."""


def declared_pair(*, name="pair", teeth=(20, 40), wheel="wheel", module_mm=4, **mesh):
    """Return the table of a gearbox; `mesh` takes further keys of its mesh."""
    return {
        "name": name,
        "frame": "housing",
        "reference": "pinion",
        "axes": {"in": ["housing", "pinion"], "out": ["housing", wheel]},
        "mesh": [
            {
                "name": "mesh",
                "teeth": dict(zip(("pinion", wheel), teeth, strict=True)),
                "module_mm": module_mm,
                "face_width_mm": 30,
                "pressure_angle_deg": 20,
                **mesh,
            }
        ],
    }


PAIR = {
    "gearbox": declared_pair(),
    "rate_hz": 20_000,
    "duration_s": 0.2,
    "fidelity": "dynamic",
    "speed": {"link": "pinion", "rpm": 600},
    "torque": {"link": "wheel", "nm": 300},
    "tachometer": {"link": "pinion", "pulses_per_rev": 12, "offset_rev": 0.03},
    "excitation": {"shaft_amplitude": 0, "harmonics": 4},
    "dynamics": {
        "links": {
            "pinion": {"mass_kg": 5, "inertia_kg_m2": 0.01},
            "wheel": {"mass_kg": 12, "inertia_kg_m2": 0.06},
        },
        "meshes": {"mesh": {"shape": "trapezoid", "stiffness_n_m": 8e7, "error_um": 3}},
        "bearings": {"pinion": {"radial_n_m": 4e7, "damping_s": 1e-5}, "wheel": {"radial_n_m": 6e7}},
        "damping_ratio": 0.05,
        "housing_kg": 15,
        "mounts": {"frequency_hz": 150, "damping_ratio": 0.4},
        "elsewhere": 0.25,
        "rigid_below_hz": 1e-6,  # weights act at every frequency
        "error": 1e-4,
    },
    "noise": {"rms": 0},
    "sensor": [{"name": "a", "on": "pinion", "direction": [0, 0, 2], "units": "m s-2", "anti_alias": "none"}],
}
