"""Time compression of a long scene, for estimates of cost and fidelity.

Speeds, torques and fault sizes are those of the scene, so lines, top speed and errors are the same; the numbers of
revolutions, pulses and impacts are divided by the compression factor. Fluctuations are also the same, except that
rounding may add a point, and that very long ones lose their fastest part.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from data_synth.operation.drive import build_drive
from data_synth.scene.faults import Fault
from data_synth.scene.operation import Speed, Torque, Turbulence
from data_synth.scene.scene import Scene
from data_synth.sources.families import ratio_of
from data_synth.sources.prepared import PreparedScene

HistoryT = TypeVar("HistoryT", Speed, Torque)

_COMPRESSED_S = 10.0  # duration of a compressed scene
_MIN_PULSES = 16.0  # fewest tachometer pulses, if the scene has as many
_MAX_POINTS = 2**18  # of a fluctuation; one with more loses its fastest part
_POINTS_PER_CYCLE, _SPARE_SCALES = 8, 20  # as `data_synth.operation.piecewise.fluctuation` uses them


def compression_factor(scene: Scene) -> float:
    """Return the factor by which time is compressed: 1 for a scene of ten seconds or less."""
    factor = max(1.0, scene.duration_s / _COMPRESSED_S)
    if factor == 1:
        return factor
    short = compressed(scene, factor)
    rng = np.random.default_rng(0)
    angle = build_drive(short, datum_turn=0.0, speed_rng=rng, torque_rng=rng).angle
    turns = float(angle.revolutions([short.duration_s])[0]) * float(abs(scene.ratio(scene.tachometer.link)))
    return max(1.0, factor * min(1.0, turns * scene.tachometer.pulses_per_rev / _MIN_PULSES))


def compressed(scene: Scene, factor: float) -> Scene:
    """Return the scene with all time histories and growth accelerated by `factor`, and its duration divided by it."""
    if factor == 1:
        return scene
    duration_s = scene.duration_s / factor
    return scene.changed(
        duration_s=duration_s,
        speed=_lighter_run_up(_faster_history(scene.speed, factor, duration_s), factor),
        torque=_faster_history(scene.torque, factor, duration_s) if scene.torque is not None else None,
        faults=tuple(_faster_growth(fault, factor) for fault in scene.faults),
    )


def with_full_duration(stage: PreparedScene, scene: Scene) -> PreparedScene:
    """Return a compressed stage with the scene's own speed, torque and duration, for the simulation of its gears."""
    if scene is stage.scene:
        return stage
    datum_turn = stage.drive.angle.datum_rev * ratio_of(scene, scene.tachometer.link)
    drive = build_drive(
        scene, datum_turn=datum_turn, speed_rng=stage.rng_for("speed"), torque_rng=stage.rng_for("torque")
    )
    instants_s = np.linspace(0.0, scene.duration_s, stage.instants_s.size)
    return replace(stage, scene=scene, drive=drive, instants_s=instants_s)


def _faster_history(history: HistoryT, factor: float, duration_s: float) -> HistoryT:
    values: dict[str, object] = {"rise_s": history.rise_s / factor}
    for key in ("steps", "rpm", "nm"):
        points = getattr(history, key, None)
        if points is not None:
            values[key] = tuple((at_s / factor, value) for at_s, value in points)
    if history.turbulence is not None:
        values["turbulence"] = _faster_turbulence(history.turbulence, factor, duration_s)
    return history.changed(**values)


def _faster_turbulence(turbulence: Turbulence, factor: float, duration_s: float) -> Turbulence:
    scale_s, highest_hz = turbulence.time_scale_s / factor, turbulence.highest_hz * factor
    points = _POINTS_PER_CYCLE * highest_hz * (duration_s + _SPARE_SCALES * scale_s)
    return turbulence.changed(time_scale_s=scale_s, highest_hz=highest_hz * min(1.0, _MAX_POINTS / points))


def _lighter_run_up(speed: Speed, factor: float) -> Speed:
    """Return a run-up with less inertia, which reaches the same speeds sooner under the same torque."""
    if speed.run_up is None:
        return speed
    return speed.changed(run_up=speed.run_up.changed(inertia_kg_m2=speed.run_up.inertia_kg_m2 / factor))


def _faster_growth(fault: Fault, factor: float) -> Fault:
    law = fault.growth
    return fault if law is None else fault.changed(growth=law.changed(rate_mm_per_s=law.rate_mm_per_s * factor))
