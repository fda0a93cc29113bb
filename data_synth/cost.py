"""Sources, lines and cost of a scene, with reasons, before it is simulated."""

import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from data_synth.fidelity.choice import Choice, chosen, with_gear_lines
from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.operation.drive import build_drive
from data_synth.scene.faults import Fault
from data_synth.scene.random_streams import random_stream
from data_synth.scene.scene import Scene, SceneError, load_scene
from data_synth.sources.families import ratio_of, turning_ratios
from data_synth.sources.impact_responses import impact_lines
from data_synth.sources.prepared import PreparedScene, check_rate, prepare_scene, truth_instants
from data_synth.vibration.gear_lines import candidates_of
from data_synth.vibration.run import Motion, contacts_in, motion_of
from hums.gearbox.components import count
from signals._validation import checked

# Seconds on one core of a 2020s server: 0.3 to 1.1 times the processor time of 12 records of six kinematic scenes.
_SETUP_S = 0.07  # including the file
_PER_LINE, _PER_CHANNEL = 0.5e-9, 60e-9  # s per sample, for a line in a channel, and for noise, impacts and writing
_TEETH_S = 0.3  # s for the teeth of vibrating gears; per time step, its degrees of freedom and pairs of meshes:
_PER_STEP, _PER_DEGREE, _PER_PAIR = 0.09e-6, 0.018e-6, 0.02e-6
_PER_PROJECTED = 1.4e-6  # s per sample and channel, for the lines of gears in motion
_PROJECTED = 15
"""Number of significant lines of gears in motion over the root of the number of candidate orders: the mean over 24
records of `benchmark-1`, either half of which predicts the mean of the other to within 15 %. A single record is within
a factor of two to four, since the significant lines depend on resonances."""
_OPENING_S, _FEWEST_PULSES = 10.0, 16.0  # in which impacts and pulses of a longer scene are counted
BYTES = 8  # per sample in memory
_LINE_COPIES, _FIXED_BYTES = 3, 40_000_000  # measured in addition to the channels of the demo of 1 s to 200 s
_GEAR_COPIES = 11  # of a channel, while the lines of gears in motion are projected


@dataclass(frozen=True, kw_only=True)
class Part:
    """One source, sensor or model of a scene: its size, its reason, and its cost; what the scene states is left out.

    Attributes
    ----------
    name, what, why : str
        Component, size and reason, as printed in the table.
    seconds : float
        Estimated time in s to simulate it.

    Examples
    --------
    >>> import data_synth
    >>> data_synth.explain("demo").parts[1].what
    'input up to 1500 rpm'
    """

    name: str
    what: str
    why: str
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Contents and cost of a scene; ``print`` shows it as a table.

    Attributes
    ----------
    title : str
        Gearbox, fidelity, duration, channels and sampling rate.
    parts : tuple of Part
        Sources, sensors and models, one per row of the table.
    seconds : float
        Estimated time in s to simulate and write it on one core.
    record_bytes, truth_bytes, working_bytes : int
        Estimated memory in bytes of the channels, of their truth, and of everything else at the same time.

    Examples
    --------
    See `data_synth.explain`, which returns it.
    """

    title: str
    parts: tuple[Part, ...]
    seconds: float
    record_bytes: int
    truth_bytes: int
    working_bytes: int

    def __str__(self) -> str:
        """Return a table for people."""
        widths = [max(len(getattr(part, column)) for part in self.parts) for column in ("name", "what")]
        rows = [
            f"  {part.name:<{widths[0]}}  {part.what:<{widths[1]}}  {part.why}"
            + (f"  ({part.seconds * 1e3:.0f} ms)" if part.seconds else "")
            for part in self.parts
        ]
        cost = (
            f"about {self.seconds:.2g} s on one core, {self.record_bytes / 1e6:.3g} MB of samples, "
            f"{self.truth_bytes / 1e6:.3g} MB of truth, "
            f"{self.working_bytes / 1e6:.3g} MB of working memory"
        )
        return "\n".join([self.title, *rows, cost])


@checked
def explain(
    scene: Scene | str | Path, *, by_source: bool = False, phases: bool = False, mechanics: bool = False
) -> Explanation:
    """Return the sources, lines and estimated cost of a scene without simulating it.

    Events are counted in the first ten seconds, or 16 tachometer pulses, and multiplied by the ratio of revolutions.

    Parameters
    ----------
    scene : Scene, path or catalogue name
        The scene.
    by_source, phases, mechanics : bool
        As in `simulate`; the additional data count as part of the record.

    Returns
    -------
    Explanation

    Raises
    ------
    SceneError
        A scene that cannot be simulated, as in `simulate`.

    Examples
    --------
    The demo scene has one channel of 10 s at 50 kHz, 8 bytes per sample:

    >>> import data_synth
    >>> data_synth.explain("demo").record_bytes == 10 * 50_000 * 8
    True
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    samples, channels, vibrating = declared.samples, len(declared.sensors), 0
    stage, longer = _with_opening(declared)
    if declared.fidelity == "kinematic":
        why = "kinematic: amplitudes are declared, so no mass, stiffness or resonance of a gear is simulated"
        gears: tuple[Part, ...] = (Part(name="fidelity", what="phases and modulations", why=why),)
        projected, instants_of_truth, digits = 0, declared.truth_times, 2 * BYTES
    else:
        motion = motion_of(stage)
        choice = chosen(motion)
        gears, vibrating = (
            tuple(_gears(motion, choice)),
            _GEAR_COPIES * BYTES * samples * channels * (not choice.linear),
        )
        stage = with_gear_lines(stage, motion, choice)
        top = declared.rate_hz / 2 / stage.drive.angle.top_speed_hz(0.0, declared.duration_s)
        candidates = 0 if choice.linear else candidates_of(declared, top=top)[0].size
        instants_of_truth = truth_instants(declared, stage.drive).size
        projected = min(candidates, round(_PROJECTED * math.sqrt(candidates)), samples // instants_of_truth)
        digits = 2 * BYTES if choice.linear else BYTES  # lines of vibrating gears have single precision
    lines = sum(amplitudes[:, :, 0].size for amplitudes in stage.amplitudes) + channels * projected
    lines += sum(amplitudes[:, :, 0].size for _, _, amplitudes in impact_lines(stage))
    instants = stage.pulses.times_s.size + sum(train.revolutions.size for _, train in stage.trains)
    amplitudes, events = digits * lines * instants_of_truth, round(BYTES * longer * instants)
    rows = channels + _further_rows(declared, phases=phases, mechanics=mechanics)
    rows += channels * (len(stage.sources) + (declared.fidelity != "kinematic")) if by_source else 0
    record_bytes = rows * samples * BYTES
    parts = (*gears, *_parts(stage, declared, longer))
    return Explanation(
        title=(
            f"{declared.gearbox.name}, {declared.fidelity}: {declared.duration_s:g} s of {count(channels, 'channel')} "
            f"at {declared.rate_hz:g} Hz, {samples} samples each"
        ),
        parts=parts,
        seconds=_SETUP_S + sum(part.seconds for part in parts),
        record_bytes=record_bytes,
        truth_bytes=amplitudes + events,
        working_bytes=_LINE_COPIES * amplitudes + events + vibrating + _FIXED_BYTES,
    )


def _with_opening(scene: Scene) -> tuple[PreparedScene, float]:
    """Return a scene with the impacts and pulses of its opening only, and its revolutions over those of the latter.

    Growth is accelerated, so that all lines are those of the scene.
    """
    rng_for = partial(random_stream, 0)
    if scene.duration_s <= _OPENING_S:
        return prepare_scene(scene, rng_for=rng_for), 1.0
    drive = build_drive(scene, datum_turn=0.0, speed_rng=rng_for("speed"), torque_rng=rng_for("torque"))
    turned = float(drive.angle.revolutions([scene.duration_s])[0])
    few = _FEWEST_PULSES / scene.tachometer.pulses_per_rev / ratio_of(scene, scene.tachometer.link)
    opening_s = max(_OPENING_S, float(drive.angle.times([few])[0])) if few < turned else scene.duration_s
    faults = tuple(_growing_faster(fault, scene.duration_s / opening_s) for fault in scene.faults)
    opening = scene.changed(duration_s=opening_s, faults=faults)
    stage = prepare_scene(opening, rng_for=rng_for)
    check_rate(scene, stage.families, drive)
    instants_s = np.linspace(0.0, scene.duration_s, stage.instants_s.size)
    speed_hz = drive.angle.speed_hz(instants_s)
    stage = replace(stage, scene=scene, drive=drive, instants_s=instants_s, speed_hz=speed_hz)
    return stage, turned / float(drive.angle.revolutions([opening_s])[0])


def _growing_faster(fault: Fault, factor: float) -> Fault:
    law = fault.growth
    return fault if law is None else fault.changed(growth=law.changed(rate_mm_per_s=law.rate_mm_per_s * factor))


def _parts(stage: PreparedScene, scene: Scene, longer: float) -> Iterator[Part]:
    """Yield the parts of a scene other than its gears; its impacts and pulses are `longer` times as many."""
    top = stage.drive.angle.top_speed_hz(0.0, stage.scene.duration_s)
    yield Part(
        name="speed",
        what=f"{scene.gearbox.reference} up to {60 * top:.5g} rpm",
        why=f"sampling rate covers orders up to {scene.rate_hz / 2 / top:.4g}",
    )
    samples = scene.samples * len(scene.sensors)
    for family in stage.families:
        first = float(family.orders[int(np.argmax(family.nonzero))])
        yield Part(
            name=family.component,
            what=f"{count(int(family.nonzero.sum()), 'line')} from order {first:.6g}",
            why=family.kind,
            seconds=samples * _PER_LINE * family.coefficients.shape[0],
        )
    for number, train in stage.trains:
        yield _struck(stage, scene, number, train, longer)
    for sensor in scene.sensors:
        yield Part(
            name=sensor.name, what=f"sensor on {sensor.on}", why="noise, chain", seconds=scene.samples * _PER_CHANNEL
        )
    pulses = _counted(stage.pulses.times_s.size, longer, f"pulses of {scene.tachometer.link}")
    yield Part(name="tachometer", what=pulses, why="the first is phase zero")


def _struck(stage: PreparedScene, scene: Scene, number: int, train: ImpactTrain, longer: float) -> Part:
    """Return a train of impacts as a part."""
    what = _counted(train.revolutions.size, longer, "entries" if train.is_entry else "impacts")
    by_paths = all((train.source, sensor.name) in stage.paths for sensor in scene.sensors)
    rings = "measured transfer paths" if by_paths else f"excites {scene.resonance.frequency_hz:g} Hz"
    why = f"fault {number + 1}, {scene.faults[number].kind}: {rings}"
    return Part(name=train.component, what=what, why=why)


def _counted(number: int, longer: float, things: str) -> str:
    return f"{number} {things}" if longer == 1 else f"about {number * longer:.3g} {things}"


def _gears(motion: Motion, choice: Choice) -> Iterator[Part]:
    """Yield the model of the gears and the teeth of each mesh as parts."""
    scene, dof, meshes = motion.stage.scene, motion.system.dof, motion.system.meshes
    if choice.linear:
        yield Part(name="fidelity", what="lines of the linear response", why=str(choice), seconds=_TEETH_S)
    else:
        steps = motion.steps() * motion.oversampling
        running = scene.samples + motion.settling_time_s * scene.rate_hz
        yield Part(
            name="fidelity",
            what=f"{dof} degrees of freedom, {count(steps, 'step')} per sample",
            why=f"{choice}; error below {motion.error:g}",
            seconds=_TEETH_S
            + running * steps * (_PER_STEP + _PER_DEGREE * dof + _PER_PAIR * len(meshes) ** 2)
            + scene.samples * len(scene.sensors) * _PER_PROJECTED,
        )
    for mesh in scene.gearbox.meshes:
        stiffness = meshes[contacts_in(motion.system, mesh.name)[0]].stiffness
        yield Part(name=mesh.name, what=f"teeth, mean {stiffness.mean:.4g} N/m", why="gears in mesh")


# ---- Check before a simulation that the record fits into memory and onto the disk ------------------------------------


_SMALL_BYTES = 100_000_000  # available on any machine, so that smaller records are not checked
_MEMINFO, _CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def _further_rows(scene: Scene, *, phases: bool, mechanics: bool) -> int:
    """Return the number of sampled histories that a record holds in addition to its channels."""
    rows = 0
    if phases:
        rows += len(turning_ratios(scene))
        rows += 2 * sum(len(bearing.names) for bearing in scene.gearbox.bearings)
    if mechanics:
        rows += 4 * len(scene.gearbox.links) + 5 * len(scene.kinematics.contacts)
    return rows


def refuse_too_large(
    scene: Scene | str | Path,
    out: Path | None = None,
    *,
    by_source: bool = False,
    phases: bool = False,
    mechanics: bool = False,
) -> None:
    """Raise SceneError for a scene whose record exceeds the free memory or disk space.

    Parameters
    ----------
    scene : Scene, path or catalogue name
        The scene.
    out : Path, optional
        Where the record will be written; by default only memory is checked.
    by_source, phases, mechanics : bool
        As in `simulate`.

    Raises
    ------
    SceneError
        With the space required, the space free, and the duration that would fit.
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    rows = len(declared.sensors) + _further_rows(declared, phases=phases, mechanics=mechanics)
    if not by_source and rows * declared.samples * BYTES <= _SMALL_BYTES:
        return
    told = explain(declared, by_source=by_source, phases=phases, mechanics=mechanics)
    rows = told.record_bytes // (declared.samples * BYTES)
    places = [(told.record_bytes + told.working_bytes, free_memory_bytes(), "of memory")]
    if out is not None:
        folder = next(parent for parent in out.absolute().parents if parent.exists())
        places.append(
            (told.record_bytes + told.truth_bytes, shutil.disk_usage(folder).free, f"on the disk of {folder}")
        )
    for need, free, where in places:
        if free is not None and need > free:
            raise SceneError(
                f"duration_s = {declared.duration_s:g}: the record has {count(rows, 'row')} of {declared.samples} "
                f"samples and needs {need / 1e9:.3g} GB {where}, but {free / 1e9:.3g} GB are free; shorten it to about "
                f"{0.9 * declared.duration_s * free / need:.2g} s, lower rate_hz, or make several records."
            )


def free_memory_bytes() -> int | None:
    """Return the memory available to this process in bytes; None if the system does not report it."""
    if _MEMINFO.exists():
        rows = dict(line.split(":", 1) for line in _MEMINFO.read_text(encoding="utf-8").splitlines())
        free = int(rows["MemAvailable"].split()[0]) * 1024
    elif "SC_PHYS_PAGES" in getattr(os, "sysconf_names", {}):
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    else:
        return None
    limit, used = _CGROUP / "memory.max", _CGROUP / "memory.current"
    if limit.exists() and used.exists() and (text := limit.read_text(encoding="utf-8").strip()).isdigit():
        free = min(free, max(0, int(text) - int(used.read_text(encoding="utf-8"))))
    return free
