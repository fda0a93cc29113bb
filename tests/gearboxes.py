"""Gearboxes of the catalogue that tests of drawings go through, planetary stages of several tests, a short scene."""

from hums.gearbox.model import catalogue, load_gearbox

# pairs, an idler and single planetary stages have what two-stage and planetary-27-36-99 have
_SIMPLE = {"glinsky-idler", "glinsky-parallel-pair", "glinsky-planetary-1", "glinsky-planetary-3", "wijianto-pair"}
VARIED = tuple(name for name in catalogue() if name not in _SIMPLE)


def without_sizes(name):
    """A gearbox of the catalogue as a table, its meshes without dimensions."""
    gearbox = load_gearbox(name)
    none = dict.fromkeys(("module_mm", "face_width_mm", "pressure_angle_deg"))
    bare = gearbox.changed(meshes=tuple(mesh.changed(**none) for mesh in gearbox.meshes))
    return bare.model_dump(mode="json", by_alias=True, exclude_none=True)


def planetary(sun, planet, ring, *, copies, sizes=None, **planets):
    """A stage that is free but for the frame: sun, ring and carrier on one line; `sizes` of all its teeth."""
    return {
        "frame": "housing",
        "reference": "sun",
        "axes": {
            "main": ["housing", "sun", "ring", "carrier"],
            "planet": {"links": ["carrier", "planet"], "copies": copies, **planets},
        },
        "mesh": [
            {"teeth": {"sun": sun, "planet": planet}, **(sizes or {})},
            {"teeth": {"planet": planet, "ring": -ring}, **(sizes or {})},
        ],
    }


def held_planetary(*teeth, copies=3, **more):
    """The stage with its ring at rest."""
    return planetary(*teeth, copies=copies, **more) | {"name": "planetary", "rigid": [["housing", "ring"]]}


PLANETARY = planetary(27, 36, 99, copies=3)
# two gears on each planet, the ring held
STEPPED = {
    "frame": "housing",
    "reference": "sun",
    "rigid": [["housing", "ring"], ["big", "small"]],
    "axes": {
        "main": ["housing", "sun", "ring", "carrier"],
        "planets": {"links": ["carrier", "big", "small"], "copies": 3},
    },
    "mesh": [{"teeth": {"sun": 20, "big": 40}}, {"teeth": {"small": 18, "ring": -78}}],
}
# what scenes of several tests share; each changes what it is about
TWO_STAGE = {
    "gearbox": "two-stage",
    "rate_hz": 20_000,
    "duration_s": 1.0,
    "fidelity": "kinematic",
    "speed": {"link": "input", "rpm": 1500},
    "tachometer": {"link": "input", "pulses_per_rev": 1},
    "noise": {"rms": 0},
    "sensor": [{"name": "a", "on": "input bearing", "units": "g", "anti_alias": "none"}],
}
SHORT_SCENE = """gearbox = "two-stage"
rate_hz = 5000
duration_s = 0.2
fidelity = "kinematic"
speed = { link = "input", rpm = 1200 }
tachometer = { link = "input", pulses_per_rev = 1 }
[[sensor]]
name = "a"
on = "input bearing"
units = "g"
"""
