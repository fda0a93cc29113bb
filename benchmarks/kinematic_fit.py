"""Faults of gears in kinematic scenes beside those of gears in motion: python benchmarks/kinematic_fit.py [FOLDER].

Writes kinematic_fit.md into FOLDER (default docs/benchmarks).
"""

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from page_files import folder_given, table, write_page

from data_synth import Scene
from data_synth.dynamics import solve_modes
from data_synth.simulation import noise_free
from data_synth.vibration.run import scene_system

SEED, TURNS = 1, 20


class Pair(NamedTuple):
    """A pair of spur gears: teeth, module and face width in mm, torque on the pinion, and its speed."""

    teeth: tuple[int, int]
    module_mm: float
    width_mm: float
    torque_nm: float
    rpm: float


PAIRS = (
    Pair((21, 86), 2.0, 20, 60, 1500),
    Pair((25, 61), 4.0, 40, 400, 900),
    Pair((18, 40), 3.0, 30, 150, 2400),
    Pair((30, 45), 5.0, 60, 900, 600),
    Pair((23, 53), 2.5, 35, 120, 3000),
    Pair((20, 20), 6.0, 70, 1200, 450),
    Pair((33, 71), 3.0, 24, 200, 1200),
    Pair((19, 77), 4.0, 60, 500, 1800),
    Pair((28, 37), 3.5, 25, 100, 1000),
    Pair((40, 55), 1.5, 15, 40, 2000),
)
SPEEDS = (0.6, 1.0, 1.3)  # of a pair's speed
KINDS = ("tooth_crack", "chipping", "missing_tooth", "spall", "pitting", "eccentricity", "misalignment", "wear")
NEAR = 0.1  # of a natural frequency in which one of the first three harmonics of the mesh lies: near a resonance
NOTE = """\
A kinematic scene with declared module, face width and torque gives its faults the periodic response of the gears,
relative to the level of the declared mesh; nothing is fitted. Is the contribution of a fault as large as in gear
dynamics?

Made by `python benchmarks/kinematic_fit.py`: pairs of spur gears with a fault of the pinion, at 0.6, 1 and 1.3 times
their speed. The power that the fault adds, faulty minus healthy with the same seed, over that of the healthy channel:
in a kinematic scene, in dB relative to gear dynamics; median, minimum and maximum. `far` is away from
resonances (asked: within 3 dB), and `near` one of them (asked: within 6 dB), with one of the first three mesh harmonics
within 10 % of a natural frequency. `declared`: all pairs, with the illustrative factors of a scene without module and
face width. Cracks are half a module deep, chipped and misaligned faces lack a fifth of their width, missing teeth are
gone from the root, spalls are 0.3 mm deep and span the face, pits cover 4 % of
the flank, run-out is 0.02 mm and wear 0.01 mm."""


def size_of(kind: str, pair: Pair) -> dict[str, float]:
    """Return the size of a fault of a kind, as a scene declares it."""
    share = {"chipping": 0.2 * pair.width_mm, "misalignment": 0.2 * pair.width_mm}
    sizes = share | {"missing_tooth": 2.25 * pair.module_mm, "eccentricity": 0.02, "wear": 0.01}
    if kind == "tooth_crack":
        return {"depth_mm": 0.5 * pair.module_mm}
    return {"size_mm": sizes.get(kind, 0.3)} | ({"width_mm": pair.width_mm} if kind == "spall" else {})


def scene_of(pair: Pair, speed: float, fidelity: str, kind: str | None = None, **factors: float) -> Scene:
    """Return the scene of a pair at a share of its speed, with a fault of its pinion."""
    fault: dict[str, object] = {"kind": kind, "component": "mesh/pinion", "offset_rev": 0.3}
    gearbox = {
        "name": "pair",
        "frame": "housing",
        "reference": "pinion",
        "axes": {link: ["housing", link] for link in ("pinion", "wheel")},
        "mesh": [
            {
                "name": "mesh",
                "teeth": dict(zip(("pinion", "wheel"), pair.teeth, strict=True)),
                "module_mm": pair.module_mm,
                "face_width_mm": pair.width_mm,
                "pressure_angle_deg": 20,
            }
        ],
    }
    table = {
        "gearbox": gearbox,
        "rate_hz": 50_000,
        "duration_s": TURNS * 60 / pair.rpm / speed,
        "fidelity": fidelity,
        "speed": {"link": "pinion", "rpm": pair.rpm * speed},
        "torque": {"link": "pinion", "nm": pair.torque_nm},
        "tachometer": {"link": "pinion", "pulses_per_rev": 8},
        "excitation": {"shaft_amplitude": 0, "mesh_amplitude": 1},
        "noise": {"rms": 0},
        "dynamics": {"load_on": "wheel"},
        "fault": [fault | size_of(kind, pair) | factors] if kind else [],
        "sensor": [{"name": "pinion", "on": "pinion", "direction": [0, 0, 1], "units": "g"}],
    }
    return Scene.from_mapping(table)


def near_resonance(pair: Pair, speed: float) -> bool:
    """Return whether a harmonic of the mesh is near a natural frequency."""
    rate_hz = pair.rpm * speed / 60
    modes_hz = solve_modes(scene_system(scene_of(pair, speed, "dynamic"))(2 * math.pi * rate_hz)).frequencies_hz
    apart = np.divide.outer(pair.teeth[0] * rate_hz * np.arange(1, 4), modes_hz[modes_hz > 0])
    return bool(np.any(np.abs(apart - 1) < NEAR))


def shares_db(pair: Pair, speed: float, fidelity: str, **factors: float) -> dict[str, float]:
    """Return the power that each kind of fault adds over that of the healthy channel, dB."""
    healthy, found = noise_free(scene_of(pair, speed, fidelity), seed=SEED), {}
    for kind in KINDS:
        scene = scene_of(pair, speed, fidelity, kind, **factors)
        added = noise_free(scene, seed=SEED, steps=healthy.steps).signal - healthy.signal
        found[kind] = 10 * math.log10(np.mean(added**2) / np.var(healthy.signal))
    return found


def shown(values: list[float]) -> str:
    """Return the median of values, and their range."""
    return f"{np.median(values):+.1f}, {min(values):+.1f} to {max(values):+.1f}" if values else "-"


def rows() -> Iterator[list[str]]:
    """Yield the rows of the table."""
    columns: dict[str, dict[str, list[float]]] = {kind: {} for kind in KINDS}
    for pair, speed in product(PAIRS, SPEEDS):
        column = "near" if near_resonance(pair, speed) else "far"
        motion = shares_db(pair, speed, "dynamic")
        own, declared = shares_db(pair, speed, "kinematic"), shares_db(pair, speed, "kinematic", amplitude_per_mm=0.2)
        for kind in KINDS:
            columns[kind].setdefault(column, []).append(own[kind] - motion[kind])
            columns[kind].setdefault("declared", []).append(declared[kind] - motion[kind])
    for kind, found in columns.items():
        yield [f"`{kind}`", *(shown(found.get(column, [])) for column in ("far", "near", "declared"))]


def main(folder: Path) -> None:
    """Compare, and write the table."""
    head = ("fault", "far, dB", "near, dB", "declared, dB")
    title = "# Gear faults: kinematic scenes and gear dynamics"
    write_page(folder / "kinematic_fit.md", [title, "", NOTE, "", *table(head, rows())])


if __name__ == "__main__":
    main(folder_given())
