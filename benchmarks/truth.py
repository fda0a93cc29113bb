"""How much of each scene's deterministic power its truth covers: python benchmarks/truth.py [FOLDER].

Writes truth.md into FOLDER (default docs/benchmarks).
"""

import time
import tomllib
from collections.abc import Iterator
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from page_files import folder_given, table, write_page

from data_synth import Scene, load_plan, load_scene, simulate

Array = NDArray[np.float64]

SEED = 1
NOTE = """\
Made by `python benchmarks/truth.py`. The signal of all lines in `truth_amplitude`, each Z linear between the instants
of the truth, is compared with the first channel without noise, external sources, clipping and rounding: 1 minus the
power of the difference over the power of the channel, in per cent. `fault`: the same for the contribution of the
faults, from the lines of the faulty and of the healthy record with the same seed; bearings with slip have no lines, and
their contribution is excluded. `lines` counts those of the faulty record. `stated`: by records with gear dynamics, from
all samples: free vibration after a start or a jump, which is not a line, and the shares of the rest, and of the
contribution of damaged teeth, that the lines leave. `size`: bytes of amplitudes over those of the samples, at most 1.
s: CPU time including truth. `benchmark-1` rows: the first record with a damaged gear whose speed is steady to 0.2 %,
varies by 3 %, rises or falls linearly, or steps; and the first of each with a severity of 0.4 to 0.6.

Lines are to leave at most 0.3 % of a record, free vibration aside, and 3 % of a fault. They leave more of both starts
from 1 rpm, where teeth engage so slowly that the gears ring at orders above the highest line, or the speed changes
within the revolutions that resolve neighbouring lines; and of `wijianto`, whose mesh follows time, so that its lines
are at no order of a shaft."""
HEADER = ("scene", "lines", "record, %", "healthy, %", "fault, %", "stated: free, left, fault left, %", "size", "s")
LEFT = ("truth_free", "truth_left", "truth_fault_left")
KINDS = ("steady", "wander", "ramp", "step")
LEAST, MOST = 0.4, 0.6  # severity of a medium fault


def cases() -> Iterator[tuple[str, Scene]]:
    """Yield the scenes that come with the package, and the gears in motion at other speeds and torques."""
    ramp = {"link": "input", "rpm": [[0, 1200], [10, 1500]]}
    gears, demo, planets = load_scene("gears-in-motion"), load_scene("demo"), load_scene("planets-in-motion")
    yield "`demo`, its cracked tooth", demo.changed(faults=demo.faults[:1])
    yield "`run-up`", load_scene("run-up")
    yield "`gears-in-motion`", gears
    yield "`gears-in-motion`, 1200 to 1500 rpm", gears.changed(speed=ramp)
    back = {"link": "input", "rpm": [[0, 900], [5, 1500], [10, 900]]}
    yield "`gears-in-motion`, 900 to 1500 rpm and back", gears.changed(speed=back)
    growth = {"rate_mm_per_s": 0.1, "largest_mm": 1.5}
    growing = gears.changed(faults=(gears.faults[0].changed(depth_mm=0.5, growth=growth),))
    yield "`gears-in-motion`, crack growing from 0.5 to 1.5 mm", growing
    yield "`gears-in-motion`, growing crack, 1200 to 1500 rpm", growing.changed(speed=ramp)
    start, slow = {"link": "input", "rpm": [[0, 1], [4, 1200]]}, {"link": "input", "rpm": [[0, 90], [4, 180]]}
    yield "`gears-in-motion`, a start from 1 to 1200 rpm in 4 s", gears.changed(speed=start, duration_s=4)
    sudden = {"link": "input", "rpm": [[0, 1], [0.1, 1200]]}
    yield "`gears-in-motion`, a start from 1 to 1200 rpm in 0.1 s", gears.changed(speed=sudden, duration_s=2)
    yield "`gears-in-motion`, 90 to 180 rpm in 4 s", gears.changed(speed=slow, duration_s=4)
    step = {"link": "input", "rpm": [[0, 1200], [2, 1200], [2.02, 1320], [4, 1320]]}
    yield "`gears-in-motion`, 1200 to 1320 rpm in 0.02 s", gears.changed(speed=step, duration_s=4)
    narrow = {"link": "input", "rpm": [[0, 1200], [4, 1500]]}
    yield "`gears-in-motion`, 1200 to 1500 rpm, at 14 kHz", gears.changed(speed=narrow, duration_s=4, rate_hz=14_000)
    rubbing = tomllib.loads(gears.to_toml())
    for mesh in rubbing["dynamics"]["meshes"].values():
        mesh["friction_coefficient"] = 0.05
    yield "`gears-in-motion`, 1200 to 1500 rpm, friction 0.05", Scene.from_mapping(rubbing).changed(speed=ramp)
    yield "`gears-in-motion`, 300 to 450 N m", gears.changed(torque={"link": "output", "nm": [[0, 300], [10, 450]]})
    jump = {"link": "output", "steps": [[0, 300], [4.97, 450]]}
    yield "`gears-in-motion`, step from 300 to 450 N m", gears.changed(torque=jump)
    yield "`planets-in-motion`", planets
    up = {"link": "carrier", "rpm": [[0, 100], [10, 240]]}
    yield "`planets-in-motion`, 192 to 240 rpm", planets.changed(speed=up | {"rpm": [[0, 192], [10, 240]]})
    yield "`planets-in-motion`, 100 to 240 rpm", planets.changed(speed=up)
    uneven: dict[str, dict[str, object]] = {"planets": {}, "gears": {}}
    yield "`planets-in-motion`, with gear and planet deviations", planets.changed(speed=up, imperfections=uneven)
    spall = {"kind": "spall", "component": "sun-planet/planet", "size_mm": 0.02, "width_mm": 30}
    yield "`planets-in-motion`, spalled planet tooth, 1 s at 240 rpm", planets.changed(faults=(spall,), duration_s=1)
    yield "`wijianto`", load_scene("wijianto")
    plan = load_plan("benchmark-1").changed(seed=SEED)
    damaged = {*plan.classes[1 : plan.classes.index("imbalance")]}
    for kind, medium in product(KINDS, (False, True)):
        for number in range(plan.records):
            labels = plan.labels(number)
            of_kind = labels["speed_kind"] == kind and labels["class"] in damaged
            if of_kind and (not medium or LEAST < labels["severity"] < MOST):
                about = f"{labels['class']}, severity {labels['severity']:.2f}, torque {labels['torque_kind']}"
                yield f"`benchmark-1`, record {number}, speed {kind}: {about}", plan.scene(number)
                break


def plain(scene: Scene) -> Scene:
    """Return a scene of one channel without what comes from outside and without the nonlinear part of its chain."""
    sensor = scene.sensors[0].changed(clipping=None, quantisation=None, drop_outs=None)
    outside = dict.fromkeys(("electrical", "neighbour", "knocks", "noise", "temperature"))
    imperfections = scene.imperfections.changed(**outside) if scene.imperfections is not None else None
    return scene.changed(noise={"rms": 0.0}, sensors=(sensor,), imperfections=imperfections)


def rebuilt(record: xr.Dataset) -> Array:
    """Return the signal (n,) of all lines of the truth in the first channel."""
    times_s = record["time"].to_numpy()
    shafts = record["truth_shaft_revolutions"]
    revolutions = shafts.sel(truth_shaft=record["truth_speed"].attrs["shaft"]).to_numpy()
    lines = record["truth_amplitude"].isel(truth_channel=0)
    orders, instants_s, amplitudes = lines["truth_order"].to_numpy(), record["truth_time"].to_numpy(), lines.to_numpy()
    signal = np.zeros(times_s.size)
    edges = np.searchsorted(times_s, instants_s)
    edges[-1] = times_s.size
    for number, (first, last) in enumerate(pairwise(edges.tolist())):
        turns = np.multiply.outer(orders, revolutions[first:last])
        turns -= np.rint(turns)
        phase = (2 * np.pi * turns).astype(np.float32)  # to 2e-7, -134 dB
        z = amplitudes[:, number : number + 2].T
        both = z.real @ np.cos(phase) - z.imag @ np.sin(phase)
        share = (times_s[first:last] - instants_s[number]) / (instants_s[number + 1] - instants_s[number])
        signal[first:last] = (1 - share) * both[0] + share * both[1]
    return signal


def explained(found: Array, signal: Array) -> float:
    """Return the share of the power of a signal that is in `found`, per cent."""
    return 100 * (1 - float(np.mean((signal - found) ** 2) / np.mean(signal**2)))


def covered(scene: Scene) -> tuple[xr.Dataset, dict[str, float]]:
    """Return the record of a plain scene, and what its lines explain of it, of its healthy one and of its fault, %.

    With them the size of their amplitudes over that of the samples, and the CPU time of the record in s.
    """
    channel, begun = scene.sensors[0].name, time.process_time()
    record = simulate(scene, seed=SEED, phases=True)
    seconds = time.process_time() - begun
    signal, lines = record[channel].to_numpy(), rebuilt(record)
    found = {"record": explained(lines, signal)}
    if scene.faults:
        sound = simulate(scene.changed(faults=()), seed=SEED, phases=True)
        reference, own = sound[channel].to_numpy(), rebuilt(sound)
        found |= {"healthy": explained(own, reference), "fault": explained(lines - own, signal - reference)}
    return record, found | {"size": record["truth_amplitude"].nbytes / signal.nbytes, "s": seconds}


def row(name: str, scene: Scene) -> list[str]:
    """Return one row of the table."""
    clean = plain(scene)
    simulate(clean.changed(duration_s=1.0), seed=SEED)  # compiles
    record, found = covered(clean)
    stated = ", ".join(f"{100 * record[each].to_numpy()[0]:.2g}" for each in LEFT if each in record)
    shares = [f"{found[each]:.2f}" if each in found else "-" for each in ("record", "healthy", "fault")]
    return [name, str(record.sizes["truth_order"]), *shares, stated or "-", f"{found['size']:.2f}", f"{found['s']:.1f}"]


def main(folder: Path) -> None:
    """Measure every scene and write the page."""
    rows = (row(name, scene) for name, scene in cases())
    write_page(folder / "truth.md", ["# Power covered by the ground truth", "", NOTE, "", *table(HEADER, rows)])


if __name__ == "__main__":
    main(folder_given())
