"""Time against error of gears that vibrate: python benchmarks/fidelity.py [FOLDER].

Writes fidelity.md and fidelity.svg into FOLDER (default docs/benchmarks).
"""

import os

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from page_files import folder_given, table, write_page

from data_synth import Scene, load_scene
from data_synth.fidelity.choice import Choice, chosen, with_gear_lines
from data_synth.scene.gear_dynamics import Dynamics
from data_synth.scene.random_streams import random_stream
from data_synth.simulation import noise_free
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.run import Motion, motion_of
from hums.plots import save_figure

Array = NDArray[np.float64]

DURATION_S, REPEATS = 0.5, 3
STEPS, REFERENCE = (1, 2, 4), 16  # to an integrated sample
NOTE = """\
Made by `python benchmarks/fidelity.py`, one thread. Each scene is {duration:g} s of one channel at 50 kHz, without
noise. Error: RMS of the difference from `dynamic` with {reference} steps per sample, over the RMS, in dB. `kinematic`
has declared amplitudes and random phases: its level is set to that of `dynamic`, its waveform is another. Time: CPU
time, median of {repeats}, without ground truth, compilation and the decision of `auto`, whose time is given in its row.
A sample is one of the integration, at {oversampling} times the rate of the record; `dynamic` alone takes the steps that
`dynamics.error`, {error:g}, requires."""

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
        "a second stage of low level": demo(quiet, floor_db=-36.0),
        "constant stiffness, tooth errors": demo(EVEN),
        "stiff bearings, heavy damping": damped.changed(**low),
        "helical pair": helical(),
    }


def _with_faults(scene: Scene, *faults: Mapping[str, object]) -> Scene:
    table = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    return Scene.from_mapping({**table, "fault": list(faults)})


@dataclass(frozen=True, kw_only=True)
class Row:
    """One way to render a scene: s for a record, and dB from fine steps."""

    name: str
    seconds: float
    decibels: float


def measure(scene: Scene, *, repeats: int = REPEATS) -> list[Row]:
    """Return a row for the decision, for what it takes, the linear response, and each number of steps."""
    wanted = in_time(scene, REFERENCE)
    motion = motion_in(scene)
    choice = chosen(motion)
    decision_s, _ = timed(lambda: np.array([chosen(motion).linear]), repeats)
    ways: dict[str, Callable[[], Array]] = {"kinematic": partial(kinematic, scene, np.std(wanted, axis=1))}
    ways["linear response"] = partial(linear, scene)
    ways |= {f"dynamic, {steps} per sample": partial(in_time, scene, steps) for steps in STEPS}
    ways["dynamic"] = partial(in_time, scene, None)
    rows = []
    for name, call in ways.items():
        seconds, found = timed(call, repeats)
        rows.append(Row(name=name, seconds=seconds, decibels=apart_db(found, wanted)))
    taken = rows[1] if choice.linear else rows[-1]
    name = f"auto: {choice}; decided in {1e3 * decision_s:.1f} ms"
    return [Row(name=name, seconds=taken.seconds + decision_s, decibels=taken.decibels), *rows]


def motion_in(scene: Scene) -> Motion:
    """Return the motion of a scene's gears."""
    stage = prepare_scene(scene, rng_for=partial(random_stream, 1))
    return motion_of(stage)


def kinematic(scene: Scene, level: Array) -> Array:
    """Return the channels (sensor, n) of the kinematic scene, whose amplitudes are declared, at a level (sensor,)."""
    found = noise_free(scene.changed(fidelity="kinematic"), seed=1).signal
    return np.asarray(found * (level / np.std(found, axis=1))[:, None])


def linear(scene: Scene) -> Array:
    """Return the channels (sensor, n) of the linear response, whatever it lacks."""
    motion, found = motion_in(scene), np.zeros((len(scene.sensors), scene.samples))
    with_gear_lines(motion.stage, motion, Choice(linear=True, why="")).add_lines(found)
    return found


def in_time(scene: Scene, steps: int | None) -> Array:
    """Return the channels (sensor, n) of the motion in time, with some steps per sample or as many as its error."""
    return noise_free(scene.changed(fidelity="dynamic"), seed=1, steps=steps).signal


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


def main(folder: Path) -> None:
    """Measure, and write the tables and the picture."""
    scenes = cases()
    for scene in scenes.values():  # compiled before it is timed
        in_time(scene.changed(duration_s=0.2), None)
    measured = {name: measure(scene) for name, scene in scenes.items()}
    note = NOTE.format(
        duration=DURATION_S,
        repeats=REPEATS,
        reference=REFERENCE,
        error=Dynamics().error,
        oversampling=motion_in(demo()).oversampling,
    )
    lines = ["# Gear dynamics: time against error", "", note, "", "![time against error](fidelity.svg)", ""]
    for name, rows in measured.items():
        cells = ((row.name, f"{row.seconds:.3f}", f"{row.decibels:.0f}") for row in rows)
        lines += [f"## {name[0].upper()}{name[1:]}", "", *table(("model", "s", "error, dB"), cells)]
    write_page(folder / "fidelity.md", lines)
    save_figure(lambda ax: draw(ax, measured), folder / "fidelity.svg", width=8.0, height=4.6)


TICKS_S = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def draw(ax: Any, measured: Mapping[str, list[Row]]) -> None:  # noqa: ANN401
    """Draw each scene's kinematic and linear response, and a line through numbers of steps; ringed: `auto`."""
    for number, (name, (auto, declared, linear_response, *in_steps, own)) in enumerate(measured.items()):
        colour = f"C{number}"
        ax.plot(declared.seconds, declared.decibels, "^", color=colour, ms=5)
        ax.plot(linear_response.seconds, linear_response.decibels, "o", color=colour, ms=5)
        ax.plot([row.seconds for row in in_steps], [row.decibels for row in in_steps], "d-", color=colour, lw=0.8, ms=4)
        taken = own if auto.decibels == own.decibels else linear_response
        ax.plot(taken.seconds, taken.decibels, "o", ms=12, mfc="none", color=colour, label=name)
    ax.plot([], [], "^", color="0.4", ms=5, label="kinematic")
    ax.plot([], [], "o", color="0.4", ms=5, label="linear response")
    ax.plot([], [], "d-", color="0.4", ms=4, lw=0.8, label=f"dynamic, {', '.join(map(str, STEPS))} steps per sample")
    ax.plot([], [], "o", ms=12, mfc="none", color="0.4", label="auto")
    ax.axhline(-40, color="0.7", lw=0.8, ls="--", label="difference that auto allows by default")
    ax.set(xscale="log", xlabel=f"CPU s per {DURATION_S:g} s of record", ylabel="difference from fine steps, dB")
    ax.set_xticks(TICKS_S, [f"{tick:g}" for tick in TICKS_S])
    ax.minorticks_off()
    ax.legend(fontsize=7, markerscale=0.7, labelspacing=0.8, loc="center left", bbox_to_anchor=(1.0, 0.5))


if __name__ == "__main__":
    main(folder_given())
