"""What is said of damaged parts where speed, tachometer, clock or drawing are declared wrongly."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import verdicts
from jobs import Floats
from scipy import io
from scipy.interpolate import CubicSpline

from board.sections import Effort, Section, Task
from board.table import Figure, Row, count_row
from board.verdicts_of_records import DOUBTED
from data_synth import Scene, load_scene, simulate
from hums import (
    AnalysisError,
    Gearbox,
    NominalSpeed,
    PulseTimes,
    analyze,
    findings_table,
    load_gearbox,
    make_record,
    summary,
    verdict_table,
)

OFF = (0.005, 0.01, 0.02, 0.03, 0.05, 0.08)  # of a nominal speed
LATE_S, CLOCK_PPM, THICKER = (0.005, 0.03, 0.1), (200, 2000), (0.02, 0.06)
RATE_HZ, SECONDS = 20_000, 10
SEARCHED = 0.02  # of a nominal speed: how far from it its lines are searched


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A record with its true angle: pulses once a revolution of the reference; `damaged` are components and kinds."""

    x: Floats
    rate_hz: float
    pulses_s: Floats
    gearbox: Gearbox
    damaged: tuple[tuple[str, str], ...]
    other_shaft: str = ""
    ratio: float = 1.0  # of the other shaft's speed to that of the reference

    @property
    def shaft(self) -> str:
        """Reference."""
        return str(self.gearbox.reference)

    def pulses(self, per_rev: float) -> Floats:
        """Return the times of so many pulses a revolution."""
        number = np.arange(self.pulses_s.size, dtype=float)
        at = np.arange(0, number[-1], 1 / per_rev)
        return np.asarray(CubicSpline(number, self.pulses_s)(at))

    def mean_rpm(self) -> float:
        """Mean speed of the reference."""
        return float(60 * (self.pulses_s.size - 1) / (self.pulses_s[-1] - self.pulses_s[0]))


Declared = tuple[Any, Gearbox]  # angle and drawing


def declarations(machine: Machine, law: str) -> Iterator[tuple[str, Declared]]:
    """Yield the wrong declarations of a machine whose speed is constant, wanders or runs up."""
    box, pulses, shaft = machine.gearbox, machine.pulses_s, machine.shaft
    if law == "run-up":
        for late in LATE_S:
            yield f"{1000 * late:g} ms late", (_timed(pulses + late, shaft), box)
        for ppm in CLOCK_PPM:
            yield f"clock {ppm} ppm off", (_timed(pulses * (1 + 1e-6 * ppm), shaft), box)
        return
    for off in OFF:
        yield f"nominal speed {off:+.1%}", (NominalSpeed(rpm=machine.mean_rpm() * (1 + off), shaft=shaft), box)
    if law == "constant":
        for factor in (2, 3, 4):
            yield f"pulses times {factor}", (_timed(pulses, shaft, pulses_per_rev=factor), box)
        yield "pulses over 2", (_timed(machine.pulses(2), shaft), box)
        yield from _of_gears(machine)
        yield from _of_bearings(machine)


def _timed(times_s: Floats, shaft: str, *, pulses_per_rev: int = 1, **more: str) -> PulseTimes:
    return PulseTimes(times_s=times_s, pulses_per_rev=pulses_per_rev, shaft=shaft, **more)


def _of_gears(machine: Machine) -> Iterator[tuple[str, Declared]]:
    box, pulses, other = machine.gearbox, machine.pulses_s, machine.other_shaft
    if other:
        yield "another shaft", (_timed(pulses, other), box)
        first = _timed(pulses, machine.shaft, pulses_per_rev=2, name="in")
        second = _timed(machine.pulses(8 * machine.ratio), other, pulses_per_rev=8, name="out")
        yield "two that contradict", ([first, second], box)
        yield "other teeth", (_timed(pulses, machine.shaft), _other_teeth(box))


def _of_bearings(machine: Machine) -> Iterator[tuple[str, Declared]]:
    box, angle = machine.gearbox, _timed(machine.pulses_s, machine.shaft)
    for bearing in box.bearings:
        if set(bearing.names) & {part for part, _ in machine.damaged}:
            changes = [(f"elements {more:.0%} thicker", _thicker(bearing, more)) for more in THICKER]
            for words, changed in [*changes, ("an element too many", {"elements": bearing.elements + 1})]:
                made = [one.changed(multiples=None, **changed) if one is bearing else one for one in box.bearings]
                yield words, (angle, box.changed(bearings=tuple(made)))
            if machine.other_shaft:
                made = [one.changed(inner_ring=machine.other_shaft) if one is bearing else one for one in box.bearings]
                yield "bearing on another shaft", (angle, box.changed(bearings=tuple(made)))


def _thicker(bearing: Any, more: float) -> dict[str, float]:  # noqa: ANN401
    return {"element_diameter_mm": bearing.element_diameter_mm * (1 + more)}


def _other_teeth(box: Gearbox) -> Gearbox:
    """Return a drawing whose first mesh has a tooth more and one less."""
    first, *others = box.meshes
    pinion, wheel = first.gears
    gears = (pinion.changed(teeth=pinion.teeth + 1), wheel.changed(teeth=wheel.teeth - 1))
    return box.changed(meshes=(first.changed(gears=gears), *others))


# ---- machines --------------------------------------------------------------------------------------------------------

LAWS = ("constant", "wander 0.1 %", "wander 0.3 %", "run-up")


def _swing(law: str) -> float:
    return {"wander 0.1 %": 0.001, "wander 0.3 %": 0.003}.get(law, 0.0)


def _course(law: str, rpm: float, seconds: float) -> list[list[float]]:
    """Return a table of speed against time."""
    if law == "run-up":
        return [[0.0, 0.8 * rpm], [seconds, 1.2 * rpm]]
    times = np.arange(0, seconds + 0.1, 0.2)
    return [[float(t), float(rpm * (1 + _swing(law) * np.sin(2 * np.pi * 0.23 * t)))] for t in times]


def _simulated(scene: Scene, seed: int, **more: Any) -> Machine:  # noqa: ANN401
    record = simulate(scene, seed=seed)
    pulses = next(record[name] for name in record.variables if "pulses_per_rev" in record[name].attrs)
    return Machine(
        x=record[scene.sensors[0].name].to_numpy().astype(np.float64),
        rate_hz=float(scene.rate_hz),
        pulses_s=np.asarray(pulses.to_numpy(), dtype=np.float64),
        gearbox=scene.gearbox,
        **more,
    )


def demo(law: str, seed: int, *, sound: bool) -> Machine:
    """Return the mill drive of the demo: a cracked tooth and a spalled inner race."""
    scene = load_scene("demo")
    scene = scene.changed(
        speed={"link": "input", "rpm": _course(law, 1400, SECONDS)}, **({"faults": ()} if sound else {})
    )
    damaged = () if sound else (("stage 1/pinion", "tooth"), ("intermediate bearing", "inner_race"))
    return _simulated(scene, seed, damaged=damaged, other_shaft="output", ratio=23 / 67 * 19 / 61)


def planetary(law: str, seed: int, *, sound: bool) -> Machine:
    """Return a stage with planets whose sun has a cracked tooth."""
    table = verdicts.planetary_scene(verdicts.STAGES["27/36/99"])
    table["speed"] = {"link": "sun", "rpm": _course(law, float(table["speed"]["rpm"]), verdicts.SECONDS)}
    if sound:
        return _simulated(Scene.from_mapping(table), seed, damaged=())
    table["fault"] = [{"kind": "tooth_crack", "component": "sun-planet/sun", "depth_mm": 2.0}]
    return _simulated(Scene.from_mapping(table), seed, damaged=(("sun-planet/sun", "tooth"),))


def bearing_alone(law: str, seed: int, *, sound: bool) -> Machine:
    """Return a shaft in one bearing with a spalled inner race, in plain numpy: impacts through the load zone."""
    rng = np.random.default_rng([91, seed])
    box = load_gearbox(verdicts.RIGS / "cwru-rig.toml")
    t = np.arange(RATE_HZ * SECONDS) / RATE_HZ
    course = np.array(_course(law, 1500, SECONDS))
    turns = np.cumsum(np.interp(t, course[:, 0], course[:, 1])) / 60 / RATE_HZ
    bearing = box.bearings[0]
    inner = bearing.elements / 2 * (1 + bearing.element_diameter_mm / bearing.pitch_diameter_mm)
    at = np.cumsum(1 + 0.01 * rng.standard_normal(int(inner * turns[-1]) - 2)) / inner
    at = at[at < turns[-1]]
    load = np.clip(np.cos(2 * np.pi * at), 0, None) ** 1.5
    places = np.searchsorted(turns, at)
    ring = np.exp(-np.arange(120) / 18) * np.sin(2 * np.pi * 4200 * np.arange(120) / RATE_HZ)
    x = 3 * (not sound) * np.convolve(np.bincount(places, load, t.size)[: t.size], ring)[: t.size]
    x += 0.05 * np.cos(2 * np.pi * turns) + 0.02 * np.cos(4 * np.pi * turns) + rng.normal(0, 0.2, t.size)
    pulses = np.interp(np.arange(1, np.floor(turns[-1])), turns, t)
    damaged = () if sound else ((bearing.names[0], "inner_race"),)
    return Machine(x=x, rate_hz=RATE_HZ, pulses_s=pulses, gearbox=box, damaged=damaged)


def measured(data: Path) -> Machine:
    """Return a measured record of a spalled inner race at a nominal speed of 900 rpm."""
    held = io.loadmat(data / "hit_self_built" / "IR5_900.mat")
    x = next(value for key, value in held.items() if not key.startswith("__")).ravel().astype(np.float64)
    box = load_gearbox(verdicts.RIGS / "cwru-rig.toml")
    pulses = np.arange(0.01, x.size / 51_200, 60 / 900)
    return Machine(
        x=x, rate_hz=51_200, pulses_s=pulses, gearbox=box, damaged=((box.bearings[0].names[0], "inner_race"),)
    )


MACHINES: Mapping[str, Callable[..., Machine]] = {
    "demo": demo,
    "planetary": planetary,
    "bearing alone": bearing_alone,
}


# ---- what is said ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Said:
    """What is said under one declaration: damaged parts, those that read "nothing found", and wrong ones diagnosed.

    `frame` is the number of parts that read so where angle or teeth are left wrong: no note doubts them, and lines are
    further off than they are searched, as those of bearings are by no delay or clock.
    """

    declaration: str
    damaged: int
    sound: int
    wrong: bool
    frame: int = 0
    quiet: bool
    """Every part reads "nothing found", and no note says more than one of the right declaration would."""


def said(machine: Machine, words: str, declared: Declared) -> Said:
    """Analyse a machine as it is declared; a refusal in a sentence calls nothing sound."""
    angle, box = declared
    try:
        record = make_record({"a": machine.x}, rate_hz=machine.rate_hz, units="g", angle=angle)
        analysis = analyze(record, box, settings=verdicts.SETTINGS)
    except (AnalysisError, ValueError):
        return Said(declaration=words, damaged=len(machine.damaged), sound=0, wrong=False, quiet=False)
    every, found = verdict_table(analysis), findings_table(analysis)
    sound = every[every["verdict"] == "nothing found"]
    clean = set(zip(sound["component"], sound["kind"], strict=True))
    diagnosed = found[found["verdict"] == "diagnosed"]
    wrong = set(zip(diagnosed["component"], diagnosed["kind"], strict=True)) - set(machine.damaged)
    parts = every[every["kind"] != "shaft"]["verdict"]
    notes, used = summary(analysis)["notes"], float(analysis["speed"]["speed_hz"].mean())
    off = abs(60 * used / machine.mean_rpm() - 1) if isinstance(angle, NominalSpeed) else 1.0
    left = off > SEARCHED and "element" not in words and not any(map(DOUBTED.search, notes))
    slight = " late" in words or "clock" in words
    unseen = sound[sound["kind"] == "tooth" if slight else sound["kind"] != "shaft"]
    return Said(
        declaration=words,
        damaged=len(machine.damaged),
        sound=sum(part in clean for part in machine.damaged),
        wrong=bool(wrong),
        frame=left * len(unseen),
        quiet=bool((parts == "nothing found").all()) and not notes,
    )


def matrix(
    name: str, law: str, seed: int, *, only: Sequence[str] = (), data: Path | None = None, sound: bool = False
) -> list[Said]:
    """Return what is said of one machine, damaged or sound, under its wrong declarations, or under some of them."""
    machine = measured(data) if data is not None else MACHINES[name](law, seed, sound=sound)
    every = declarations(machine, law)
    return [said(machine, words, declared) for words, declared in every if not only or words in only]


QUICK = (
    ("demo", "constant", ("pulses times 2", "two that contradict", "nominal speed +3.0%", "other teeth")),
    ("demo", "run-up", ("30 ms late",)),
    ("bearing alone", "constant", ("pulses times 2", "nominal speed +3.0%", "elements 6% thicker")),
    ("bearing alone", "wander 0.3 %", ("nominal speed +2.0%",)),
)


def tasks(effort: Effort) -> list[Task]:
    """Return a task for each machine and law of its speed."""
    if effort.size == "quick":
        found: list[Task] = [partial(matrix, name, law, 1 + effort.first, only=only) for name, law, only in QUICK]
        only: tuple[str, ...] = ("pulses times 2", "nominal speed +5.0%", "an element too many")
    else:
        seeds = effort.numbers(1, 1, 20)
        cases = product(MACHINES, LAWS, seeds, (False, True))
        found = [partial(matrix, name, law, 1 + seed, sound=sound) for name, law, seed, sound in cases]
        only = ()
    if effort.data is not None:
        found.append(partial(matrix, "measured", "constant", 0, only=only, data=effort.data))
    return found


def figures(found: Sequence[list[Said]]) -> dict[str, Figure]:
    """Return the counts over all machines."""
    every = [one for part in found for one in part]
    nominal = [one for one in every if one.declaration.startswith("nominal")]
    others = [one for one in every if not one.declaration.startswith("nominal")]
    return {
        "declared wrongly: speed": Figure(
            value=sum(one.sound for one in nominal), of=sum(one.damaged for one in nominal)
        ),
        "declared wrongly: others": Figure(
            value=sum(one.sound for one in others), of=sum(one.damaged for one in others)
        ),
        "declared wrongly: frame": Figure(value=sum(one.frame for one in every)),
        "declared wrongly: quiet": Figure.share([one.quiet for one in every if one.damaged]),
        "declared wrongly: wrong": Figure.share([one.wrong for one in every if one.damaged]),
    }


NOT_FOUND = 'damaged parts that read "nothing found" where'
SECTION = Section(
    name="wrong declarations",
    rows=(
        count_row("declared wrongly: speed", f"{NOT_FOUND} the nominal speed is 0.5 to 8 % off", "less"),
        count_row("declared wrongly: others", f"{NOT_FOUND} pulses, delay, clock, teeth or bearing are wrong", "less"),
        Row(name="declared wrongly: frame", what='parts that read "nothing found" with angle or teeth still wrong'),
        count_row("declared wrongly: quiet", 'of these records, with every part "nothing found" and no note', "less"),
        count_row("declared wrongly: wrong", "of these records, with a sound part diagnosed", "less"),
    ),
    tasks=tasks,
    figures=figures,
)
