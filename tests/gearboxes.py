"""Gearboxes of the catalogue that tests of drawings go through, planetary stages of several tests, a short scene."""

from hums.gearbox.model import catalogue

# pairs, an idler and single planetary stages have what two-stage and planetary-27-36-99 have
_SIMPLE = {"glinsky-idler", "glinsky-parallel-pair", "glinsky-planetary-1", "glinsky-planetary-3", "wijianto-pair"}
VARIED = tuple(name for name in catalogue() if name not in _SIMPLE)


def planetary(sun, planet, ring, *, copies):
    """A stage that is free but for the frame: sun, ring and carrier on one line."""
    return {
        "frame": "housing",
        "reference": "sun",
        "axes": {
            "main": ["housing", "sun", "ring", "carrier"],
            "planet": {"links": ["carrier", "planet"], "copies": copies},
        },
        "mesh": [{"teeth": {"sun": sun, "planet": planet}}, {"teeth": {"planet": planet, "ring": -ring}}],
    }


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
