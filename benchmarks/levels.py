"""Levels of the same scenes as linear response and in time: python benchmarks/levels.py [FOLDER].

Writes levels.md into FOLDER (default docs/benchmarks).
"""

import math
import sys
from pathlib import Path

import numpy as np
from fidelity import cases, in_time, linear

from data_synth import Scene, load_scene

DURATION_S = 0.3
NOTE = """\
Made by `python benchmarks/levels.py`: RMS of the channel over the first {duration:g} s, healthy or faulty as named,
without noise, and in brackets dB over `dynamic`. Planets, whose ways to a sensor turn, have no linear response; a scene
whose `fidelity` is `kinematic` is as loud as it declares."""


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
    """Return the row of a scene."""
    here = scene.changed(duration_s=DURATION_S)
    full, cell = float(np.std(in_time(here, None)[0])), ""
    if not scene.gearbox.copied:
        rms = float(np.std(linear(here)[0]))
        cell = f"{rms:.3g} ({20 * math.log10(rms / full) + 0.0:+.1f})"
    return f"| {name}, {scene.sensors[0].units} | {cell} | {full:.3g} |"


def main(folder: Path) -> int:
    """Simulate, and write the table."""
    lines = ["# Levels of one scene as linear response and in time", "", NOTE.format(duration=DURATION_S), ""]
    lines += ["| scene | linear response | dynamic |", "|---|---|---|"]
    lines += [row(name, scene) for name, scene in scenes().items()]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "levels.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "benchmarks"))
