"""Gearboxes of the catalogue that tests of drawings and pictures go through, and planetary stages of several tests."""

from hums.gearbox.model import catalogue

# pairs, an idler and single planetary stages have what two-stage and planetary-27-36-99 have
_SIMPLE = {"glinsky-idler", "glinsky-parallel-pair", "glinsky-planetary-1", "glinsky-planetary-3", "wijianto-pair"}
VARIED = tuple(name for name in catalogue() if name not in _SIMPLE)

# free but for the frame: sun, ring and carrier on one line
PLANETARY = {
    "frame": "housing",
    "reference": "sun",
    "axes": {
        "main": ["housing", "sun", "ring", "carrier"],
        "planet": {"links": ["carrier", "planet"], "copies": 3},
    },
    "mesh": [{"teeth": {"sun": 27, "planet": 36}}, {"teeth": {"planet": 36, "ring": -99}}],
}
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
