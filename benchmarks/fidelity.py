"""Time against error of every fidelity of a scene: python benchmarks/fidelity.py [FOLDER].

Writes fidelity.md and fidelity.svg into FOLDER (default docs/benchmarks).
"""

import os
import sys

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

import math
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_synth import Plan, Scene, load_scene, make_dataset, simulate
from data_synth.dynamics.active_dofs import LEVELS
from data_synth.fidelity.choice import KINEMATIC, LADDER, decided, forget
from data_synth.plan import parse_plan
from data_synth.scene.gear_dynamics import Dynamics
from hums.plots import save_figure
from hums.records.store import save_record

Array = NDArray[np.float64]

DURATION_S, REPEATS = 0.5, 3
LONG_S, RECORDS = 10.0, 30
NOTE = """\
Made by `python benchmarks/fidelity.py`, one thread. Each scene is {duration:g} s of one channel at 50 kHz, without
noise, at every fidelity; error: RMS of the difference from `full` over the RMS, in dB, which includes what steps may
err by ({error:g}). Time: of the processor, median of {repeats}, truth included; compiling is not. `kinematic` are the
lines of the linear response; `auto` has a time for its first record, with its decision, and one for those that follow
from that scene."""
TARGETS_NOTE = """\
The demo's gearbox with its cracked tooth, {long:g} s at 50 kHz, truth and writing included, one thread: `kinematic` is
asked to be 50 times as fast as real time, `lateral` 10 times."""
RECORDS_NOTE = """\
Such records of 1 s at `auto`, in a dataset of {records}: {seconds:.2f} s each, so 1,000 of them in {all:.0f} s on two
cores; asked: 120."""
PLAN = """\
scene = "gears-in-motion"
records = {records}
seed = 1
change = {{ duration_s = 1, fidelity = "auto" }}
"""

GEOMETRY = {
    "stage 1": {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20},
    "stage 2": {"module_mm": 4, "face_width_mm": 40, "pressure_angle_deg": 20},
}
EVEN = {name: {"shape": "constant", "error_um": 2.0} for name in GEOMETRY}
STIFF = {"radial_n_m": 1e11, "axial_n_m": 1e11, "tilt_nm_rad": 1e8}


def demo(
    meshes: Mapping[str, Mapping[str, object]] | None = None, *, faults: tuple[Any, ...] = (), **dynamics: object
) -> Scene:
    """Return the two-stage demo with gears that vibrate."""
    scene = load_scene("gears-in-motion")
    geometry = {name: {**GEOMETRY[name], **(meshes or {}).get(name, {})} for name in GEOMETRY}
    table = Dynamics.model_validate({"meshes": geometry, **dynamics})
    return _bare(scene.changed(faults=faults, dynamics=table))


def _bare(scene: Scene) -> Scene:
    return scene.changed(
        fidelity="auto",
        duration_s=DURATION_S,
        noise=scene.noise.changed(rms=0.0),
        excitation=scene.excitation.changed(shaft_amplitude=0.0),
    )


def helical() -> Scene:
    """Return the first stage with a helix, its sensor slanting along the shaft."""
    table = load_scene("gears-in-motion").model_dump(mode="json", by_alias=True, exclude_none=True)
    mesh = {**table["gearbox"]["mesh"][0], **GEOMETRY["stage 1"], "helix_angle_deg": 15, "hand": "right"}
    gearbox = {
        "name": "helical pair",
        "frame": "housing",
        "reference": "pinion",
        "axes": {"in": ["housing", "pinion"], "out": ["housing", "intermediate"]},
        "mesh": [mesh],
    }
    table |= {
        "gearbox": gearbox,
        "speed": {"link": "pinion", "rpm": 1500},
        "torque": {"link": "intermediate", "nm": 150},
        "tachometer": {"link": "pinion", "pulses_per_rev": 1},
        "dynamics": {},
        "fault": [],
        "sensor": [{**table["sensor"][0], "on": "pinion", "direction": [1, 0, 1]}],
    }
    return _bare(Scene.from_mapping(table))


def cases() -> dict[str, Scene]:
    """Return the scenes by name."""
    crack, chip = (
        {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 1.5},
        {"kind": "chipping", "component": "stage 2/output", "size_mm": 2.0},
    )
    smooth = {name: {"shape": "trapezoid"} for name in GEOMETRY}
    quiet = {"stage 2": {"shape": "constant", "error_um": 1e-6}}
    low = {"path": {"frequency_hz": 1500, "damping_ratio": 0.7}}
    bearings = dict.fromkeys(("input bearing", "intermediate bearing", "output"), STIFF)
    damped = demo(smooth, bearings=bearings, damping_ratio=0.3, floor_db=-24.0)
    return {
        "two-stage demo": demo(),
        "with a cracked tooth": _with_faults(demo(), crack),
        "with a chipped and a cracked tooth": _with_faults(demo(), crack, chip),
        "a second stage hardly heard": demo(quiet, floor_db=-36.0),
        "even teeth with errors": demo(EVEN),
        "stiff bearings, heavy damping": damped.changed(**low),
        "helical pair": helical(),
    }


def _with_faults(scene: Scene, *faults: Mapping[str, object]) -> Scene:
    table = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    return Scene.from_mapping({**table, "fault": list(faults)})


def at(scene: Scene, level: str) -> Scene:
    """Return a scene with all of its stages at one fidelity."""
    assert scene.dynamics is not None  # noqa: S101 - of a scene whose gears vibrate
    if level != KINEMATIC:
        return scene.changed(fidelity=level)
    declared = dict(scene.dynamics.meshes)
    meshes = {m.name: scene.dynamics.mesh(m.name).changed(fidelity=KINEMATIC) for m in scene.gearbox.meshes}
    return scene.changed(fidelity="full", dynamics=scene.dynamics.changed(meshes=tuple((declared | meshes).items())))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One fidelity of a scene: s for a record, s for the first of "auto", and dB from the full motion."""

    level: str
    seconds: float
    first_s: float
    decibels: float
    chosen: str = ""


def measure(scene: Scene, *, repeats: int = REPEATS) -> list[Row]:
    """Return a row for each fidelity, the full motion last."""
    wanted, rows = np.zeros(0), []
    for level in ("full", "lateral", "torsional", KINEMATIC, "auto"):
        here = at(scene, level)
        forget()
        first_s, _ = timed(partial(channels, here), 1) if level == "auto" else (0.0, wanted)
        seconds, found = timed(partial(channels, here), repeats)
        wanted = found if level == "full" else wanted
        chosen = decided(here).name if level == "auto" else ""
        rows.append(Row(level=level, seconds=seconds, first_s=first_s, decibels=apart_db(found, wanted), chosen=chosen))
    return rows[::-1]


def channels(scene: Scene) -> Array:
    """Return the channels (sensor, n) of a record."""
    record = simulate(scene, seed=1)
    return np.stack([record[sensor.name].values for sensor in scene.sensors])


def timed(call: Callable[[], Array], repeats: int) -> tuple[float, Array]:
    """Return the median time of the processor in s, and what comes of it."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        values = call()
        seconds.append(time.process_time() - start)
    return statistics.median(seconds), values


def apart_db(found: Array, wanted: Array) -> float:
    """Return by how much the worst channel is apart, in dB."""
    ratio = float(np.max(np.std(found - wanted, axis=1) / np.std(wanted, axis=1)))
    return 20 * math.log10(ratio) if ratio > 0 else -math.inf


def targets() -> list[str]:
    """Return how fast records of ten seconds are made and written."""
    scene = load_scene("gears-in-motion").changed(duration_s=LONG_S)
    lines = ["| fidelity | seconds | times real time | asked |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        for level, asked in ((KINEMATIC, "50"), ("lateral", "10"), ("auto", "")):
            here, path = scene.changed(fidelity=level), Path(folder) / "record.h5"

            def call(scene: Scene = here, path: Path = path) -> Array:
                save_record(simulate(scene, seed=1), path)
                return np.zeros(0)

            timed(call, 1)
            seconds, _ = timed(call, REPEATS)
            lines.append(f"| {level} | {seconds:.2f} | {LONG_S / seconds:.0f} | {asked} |")
        plans = [parse_plan(PLAN.format(records=records)) for records in (2, RECORDS)]
        few, many = (timed(partial(dataset, plan, Path(folder) / str(plan.records)), 1)[0] for plan in plans)
    seconds = (many - few) / (RECORDS - 2)
    return [*lines, "", RECORDS_NOTE.format(records=RECORDS, seconds=seconds, all=500 * seconds)]


def dataset(plan: Plan, folder: Path) -> Array:
    """Make a dataset in this process."""
    make_dataset(plan, folder)
    return np.zeros(0)


def main(folder: Path) -> int:
    """Measure, and write the tables and the picture."""
    scenes = cases()
    for scene in scenes.values():  # compiled before it is timed
        for level in (KINEMATIC, "full"):
            channels(at(scene.changed(duration_s=0.2), level))
    measured = {name: measure(scene) for name, scene in scenes.items()}
    error = Dynamics().error
    lines = ["# Fidelity: time against error", ""]
    lines += [NOTE.format(duration=DURATION_S, repeats=REPEATS, error=error), "", "![time against error](fidelity.svg)"]
    for name, rows in measured.items():
        lines += ["", f"## {name[0].upper()}{name[1:]}", "", "| fidelity | s | error, dB |", "|---|---|---|"]
        for row in rows:
            took = f"{row.seconds:.3f}" + (f" (first {row.first_s:.3f})" if row.chosen else "")
            what = f"auto: {row.chosen}, floor {_floor_db(scenes[name]):g}" if row.chosen else row.level
            lines.append(f"| {what} | {took} | {'reference' if row.level == 'full' else _db(row.decibels)} |")
    lines += ["", "## Ten seconds", "", TARGETS_NOTE.format(long=LONG_S), "", *targets()]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fidelity.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    save_figure(lambda ax: draw(ax, measured), folder / "fidelity.svg", width=8.0, height=4.6)
    return 0


def _floor_db(scene: Scene) -> float:
    assert scene.dynamics is not None  # noqa: S101 - of a scene whose gears vibrate
    return scene.dynamics.floor_db


def _db(decibels: float) -> str:
    return f"{decibels:.0f}" if decibels > EXACT_DB else "none"


EXACT_DB = -100.0
TICKS_S = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
MARKS = {KINEMATIC: "o", "torsional": "s", "lateral": "^", "full": "D"}


def draw(ax: Any, measured: Mapping[str, list[Row]]) -> None:  # noqa: ANN401
    """Draw one line for each scene through its fidelities, what `auto` takes ringed."""
    for number, (name, rows) in enumerate(measured.items()):
        colour, by_level = f"C{number}", {row.level: row for row in rows}
        path = [by_level[level] for level in LADDER if level in by_level]
        heights = [max(row.decibels, EXACT_DB) for row in path]
        ax.plot([row.seconds for row in path], heights, color=colour, lw=0.8, alpha=0.6)
        for row, height in zip(path, heights, strict=True):
            ax.plot(row.seconds, height, MARKS[row.level], color=colour, ms=5)
        auto = by_level["auto"]
        at_auto = max(auto.decibels, EXACT_DB)
        ax.plot(auto.seconds, at_auto, "o", ms=12, mfc="none", color=colour, label=name)
    for level in (KINEMATIC, *LEVELS):
        ax.plot([], [], MARKS[level], color="0.4", ms=5, label=level)
    ax.plot([], [], "o", ms=12, mfc="none", color="0.4", label="auto")
    ax.axhline(-40, color="0.7", lw=0.8, ls="--")
    ax.set(xscale="log", xlabel=f"s for {DURATION_S:g} s of record", ylabel="difference from full, dB")
    ax.set_xticks(TICKS_S, [f"{tick:g}" for tick in TICKS_S])
    ax.minorticks_off()
    ax.set_ylim(EXACT_DB - 8, 40)
    ax.set_yticks([20, 0, -20, -40, -60, -80, EXACT_DB], ["20", "0", "-20", "-40", "-60", "-80", "none"])
    ax.legend(fontsize=7, markerscale=0.7, labelspacing=0.8, loc="center left", bbox_to_anchor=(1.0, 0.5))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "benchmarks"))
