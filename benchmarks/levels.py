"""Levels of the same scenes at every fidelity: python benchmarks/levels.py [FOLDER].

Writes levels.md into FOLDER (default docs/benchmarks).
"""

import math
import sys
from pathlib import Path

import numpy as np
from fidelity import at, cases, channels

from data_synth import Scene, load_scene
from data_synth.fidelity.choice import KINEMATIC

DURATION_S = 0.3
LEVELS = (KINEMATIC, "torsional", "lateral", "full")
NOTE = """\
Made by `python benchmarks/levels.py`: RMS of the channel over the first {duration:g} s, healthy or faulty as named,
without noise, and in brackets dB over `full`. `kinematic` are the lines of the linear response, of which planets
have none; a scene whose own `fidelity` is `kinematic` is as loud as it declares. What `torsional` leaves out,
masses on their bearings, follows its mesh forces by linear equations: exactly, where stiffness is constant; what
remains in light spur gears and planets is the change of stiffness times that motion. Axial motion and tilt of helical
gears follow alike, in `torsional` and `lateral`."""


def scenes() -> dict[str, Scene]:
    """Return the scenes by name."""
    planets = load_scene("planets-in-motion")
    silent = {
        "noise": planets.noise.changed(rms=0.0),
        "excitation": planets.excitation.changed(shaft_amplitude=0.0),
    }
    worn = {"kind": "wear", "component": "sun-planet/sun", "size_mm": 0.02}
    return cases() | {
        "planets in motion": planets.changed(faults=(), **silent),
        "the same with a worn sun": planets.changed(faults=[worn], **silent),
    }


def row(name: str, scene: Scene) -> str:
    """Return the row of a scene, a column for each fidelity."""
    here = scene.changed(duration_s=DURATION_S)
    levels = [level for level in LEVELS if level != KINEMATIC or not scene.gearbox.copied]
    rms = {level: float(np.std(channels(at(here, level))[0])) for level in levels}
    cells = [
        f"{rms[level]:.3g} ({20 * math.log10(rms[level] / rms['full']) + 0.0:+.1f})" if level in rms else ""
        for level in LEVELS
    ]
    return f"| {name}, {scene.sensors[0].units} | " + " | ".join(cells) + " |"


def main(folder: Path) -> int:
    """Simulate, and write the table."""
    lines = ["# Levels of one scene at every fidelity", "", NOTE.format(duration=DURATION_S), ""]
    lines += ["| scene | " + " | ".join(LEVELS) + " |", "|---" * (len(LEVELS) + 1) + "|"]
    lines += [row(name, scene) for name, scene in scenes().items()]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "levels.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "benchmarks"))
