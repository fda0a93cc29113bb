"""Gearboxes of the catalogue that tests of drawings and pictures go through."""

from hums.gearbox.model import catalogue

# pairs, an idler and single planetary stages have what two-stage and planetary-27-36-99 have
_SIMPLE = {"glinsky-idler", "glinsky-parallel-pair", "glinsky-planetary-1", "glinsky-planetary-3", "wijianto-pair"}
VARIED = tuple(name for name in catalogue() if name not in _SIMPLE)
