"""What a scene will build, why, and what that will cost, before a sample is computed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from data_synth.combs import Comb
from data_synth.drive import driven
from data_synth.fidelity import chosen
from data_synth.hastened import factor_of, hastened
from data_synth.motion import motion_of, prepared
from data_synth.scene import Fault, Scene, Sensor, load_scene
from data_synth.simulation import random_stream
from data_synth.stage import Stage, ratio_of, staged

# Seconds on one core of a 2020s server, from runs of the demo and of scenes with many lines; a rough guide elsewhere.
_SETUP_S, _WRITE_S, _WRITE_S_PER_BYTE = 0.02, 0.05, 2e-9
_PER_LINE, _PER_SOURCE, _PER_POLE, _PER_NOISE = 0.5e-9, 8e-9, 5e-9, 12e-9  # s a sample and channel
_TEETH_S, _PER_STEP, _PER_DEGREE = 0.3, 0.3e-6, 0.06e-6  # s for teeth of gears that vibrate, and s a step of time
BYTES = 8  # of a sample in memory
_LINE_COPIES, _FIXED_BYTES = 3, 40_000_000  # what was measured beside the channels of the demo of 1 s to 200 s
_CHAIN = ("cross_axis", "resonance", "sensitivity", "hum", "anti_alias", "clipping", "quantisation", "drop_outs")


@dataclass(frozen=True, kw_only=True)
class Part:
    """One thing that will be built: what it is, why it is there, and its cost in s."""

    name: str
    what: str
    why: str
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What a scene will build.

    Attributes
    ----------
    title : str
    parts : tuple of Part
    seconds : float
        To simulate and write it, on one core; an estimate.
    record_bytes, working_bytes : int
        Of the channels, and of all that is in memory at once beside them.
    """

    title: str
    parts: tuple[Part, ...]
    seconds: float
    record_bytes: int
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
            f"{self.working_bytes / 1e6:.3g} MB beside them"
        )
        return "\n".join([self.title, *rows, cost])


def explain(scene: Scene | str | Path) -> Explanation:
    """Return what a scene will build, why, and what it will cost, in a moment however long the scene is.

    What fluctuates or slips at random is counted in ten seconds of the scene, its course hastened to fit in them.

    Raises
    ------
    SceneError
        For a scene that cannot be simulated, as `simulate` does.
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    draws, faster = partial(random_stream, 0), factor_of(declared)
    stage = staged(hastened(declared, faster), draws=draws)
    parts = tuple(_parts(stage, declared, faster))
    samples, channels = declared.samples, len(declared.sensors)
    record_bytes = samples * channels * BYTES
    return Explanation(
        title=(
            f"{declared.gearbox.name}, {declared.fidelity}: {declared.duration_s:g} s of {channels} channel(s) at "
            f"{declared.rate_hz:g} Hz, {samples} samples each"
        ),
        parts=parts,
        seconds=_SETUP_S + _WRITE_S + _WRITE_S_PER_BYTE * record_bytes + sum(part.seconds for part in parts),
        record_bytes=record_bytes,
        working_bytes=needed_bytes(stage, declared, faster),
    )


def needed_bytes(stage: Stage, scene: Scene, faster: float) -> int:
    """Return what is in memory beside the samples of a scene, from the stage of one in which time goes `faster`."""
    lines = sum(amplitudes[:, :, 0].size for amplitudes in stage.amplitudes)
    instants = stage.pulses.times_s.size + sum(train.revolutions.size for _, train in stage.trains)
    return 2 * BYTES * _LINE_COPIES * lines * scene.truth_times + round(BYTES * faster * instants) + _FIXED_BYTES


def _parts(stage: Stage, scene: Scene, faster: float) -> Iterator[Part]:
    """Yield the parts of a scene, from the stage of one in which time goes `faster`."""
    if scene.fidelity == "kinematic":
        yield Part(
            name="fidelity",
            what="phases and modulations",
            why="kinematic: amplitudes are declared, so no mass, stiffness or resonance of a gear is simulated",
        )
    else:
        yield from _gears(_slowed(stage, scene))
    top = stage.drive.angle.top_speed_hz(0.0, stage.scene.duration_s)
    yield Part(
        name="speed",
        what=f"{scene.gearbox.reference} up to {60 * top:.5g} rpm",
        why=f"orders up to {scene.rate_hz / 2 / top:.4g} fit the sampling rate",
    )
    samples = scene.samples * len(scene.sensors)
    faulty = {fault.component: fault for fault in scene.faults}
    for comb in stage.combs:
        lines = int(comb.present.sum())
        yield Part(
            name=comb.component,
            what=f"{lines} line(s) from order {_first(comb):.6g}",
            why=_why(comb, faulty),
            seconds=samples * (_PER_LINE * comb.coefficients.shape[0] + _PER_SOURCE),
        )
    for number, train in stage.trains:
        poles = sum(2 + chain.poles.size for chain in stage.chains) / 2
        yield Part(
            name=train.component,
            what=_counted(train.revolutions.size, faster, "impacts"),
            why=f"fault {number + 1}, {scene.faults[number].kind}: rings {scene.resonance.frequency_hz:g} Hz",
            seconds=scene.samples * poles * _PER_POLE,
        )
    for sensor in scene.sensors:
        yield Part(
            name=sensor.name, what=f"sensor on {sensor.on}", why=_chain(sensor), seconds=scene.samples * _PER_NOISE
        )
    spoilt = [
        name for name in ("uneven", "missing", "spurious", "jitter") if getattr(scene.tachometer, name) is not None
    ]
    yield Part(
        name="tachometer",
        what=_counted(stage.pulses.times_s.size, faster, f"pulses of {scene.tachometer.link}"),
        why=", ".join(spoilt) or "exact",
    )


def _counted(number: int, faster: float, things: str) -> str:
    return f"{number} {things}" if faster == 1 else f"about {number * faster:.3g} {things}"


def _slowed(stage: Stage, scene: Scene) -> Stage:
    """Return the stage with the scene's own course, by which it is found what of its gears has to be simulated."""
    if scene is stage.scene:
        return stage
    datum_turn = stage.drive.angle.datum_rev * ratio_of(scene, scene.tachometer.link)
    drive = driven(scene, datum_turn=datum_turn, speed_rng=stage.draws("speed"), torque_rng=stage.draws("torque"))
    return replace(stage, scene=scene, drive=drive)


def _gears(stage: Stage) -> Iterator[Part]:
    """Yield which motions are simulated, what is left out, and the meshes."""
    scene = stage.scene
    gears = prepared(stage)
    choice = chosen(stage, gears)
    motion = motion_of(stage, gears, levels=choice.levels, springs=choice.springs)
    steps = motion.steps() * motion.denser
    running = scene.samples + motion.settle_s * scene.rate_hz
    yield Part(
        name="fidelity",
        what=f"{motion.system.dof} degrees of freedom, {steps} step(s) a sample",
        why=f"{choice}, error below {motion.error:g}",
        seconds=_TEETH_S + running * steps * (_PER_STEP + _PER_DEGREE * motion.system.dof),
    )
    for mesh in motion.system.meshes:
        spring = mesh.name in choice.springs
        yield Part(
            name=mesh.name,
            what="a spring" if spring else f"teeth, mean {mesh.stiffness.mean:.4g} N/m",
            why="no sensor hears its teeth above the floor" if spring else f"{choice.levels[mesh.name]} motion",
        )


def _first(comb: Comb) -> float:
    return float(next((order for order, speaks in zip(comb.orders, comb.present, strict=True) if speaks), comb.base))


def _why(comb: Comb, faulty: Mapping[str, Fault]) -> str:
    if comb.kind == "shaft" and comb.coefficients.ndim == 1:
        return "a shaft that turns"
    if comb.kind == "gear_mesh":
        return "gears in mesh"
    return faulty[comb.component].kind if comb.component in faulty else comb.kind


def _chain(sensor: Sensor) -> str:
    parts = [part for part in _CHAIN if getattr(sensor, part) is not None]
    return "noise" + "".join(f", {part}" for part in parts)
