"""Angle of the reference shaft and tooth load against time, as declared in a scene."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from data_synth.operation.piecewise import Kaimal, PiecewiseLinear, fluctuation, sum_of
from data_synth.operation.run_up import PolynomialAngle, run_up
from data_synth.operation.shaft_angle import Array, ShaftAngle
from data_synth.scene.operation import TimeHistory
from data_synth.scene.scene import Scene, SceneError

_RPM = 60.0


ReferenceAngle = ShaftAngle | PolynomialAngle
"""The angle of the reference shaft, which does not reverse, as a function of time."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Angle of the reference shaft, and torque, against time.

    Attributes
    ----------
    angle : ShaftAngle or PolynomialAngle
        Angle of the reference shaft, with revolution zero at the first mark of the tachometer.
    torque : PiecewiseLinear or None
        Torque in N m on the link named in the scene.
    unloaded_share : float
        Tooth load without torque, relative to full load.
    full_load_nm : float
        Torque at full load in N m; 0 if the torque is 0 throughout.
    start_s : float
        Time in s from which the angle is known.
    """

    angle: ReferenceAngle
    torque: PiecewiseLinear | None = None
    unloaded_share: float = 0.0
    full_load_nm: float = 1.0
    start_s: float = -np.inf

    def load(self, times_s: ArrayLike) -> Array:
        """Return the tooth load at `times_s` (n,) relative to full load: ``u + (1 - u) abs(T) / T_full``."""
        times = np.asarray(times_s, dtype=np.float64)
        if self.torque is None:
            return np.ones_like(times)
        if not self.full_load_nm:
            return np.full_like(times, self.unloaded_share)
        relative = np.abs(self.torque.at(times)) / self.full_load_nm
        return np.asarray(self.unloaded_share + (1 - self.unloaded_share) * relative)


def build_drive(
    scene: Scene, *, datum_turn: float, speed_rng: np.random.Generator, torque_rng: np.random.Generator
) -> Drive:
    """Return the drive of a scene.

    Parameters
    ----------
    scene : Scene
    datum_turn : float
        Revolutions of the tachometer link from time zero to its first mark.
    speed_rng, torque_rng : numpy.random.Generator
        Generators for turbulence.

    Raises
    ------
    SceneError
        Turbulence or a load that stops or reverses the shaft.
    """
    torque = _time_history(scene.torque, scene, torque_rng) if scene.torque is not None else None
    datum = datum_turn / float(abs(scene.ratio(scene.tachometer.link)))
    if scene.speed.run_up is None:
        turns = float(abs(scene.ratio(scene.speed.link))) * _RPM
        speed = _time_history(scene.speed, scene, speed_rng)
        angle = ShaftAngle(times_s=speed.times_s, speeds_hz=speed.values / turns, datum_rev=datum)
        if angle.speeds_hz.min() <= 0:
            raise SceneError("speed.turbulence stops the shaft; reduce its rms.")
        return _with_torque(Drive(angle=angle), scene, torque)
    return _with_torque(Drive(angle=replace(_run_up_angle(scene, torque), datum_rev=datum), start_s=0.0), scene, torque)


def _with_torque(drive: Drive, scene: Scene, torque: PiecewiseLinear | None) -> Drive:
    if scene.torque is None:
        return drive
    full = scene.torque.full_load_nm or max(abs(nm) for _, nm in scene.torque.rows)
    return replace(drive, torque=torque, unloaded_share=scene.torque.unloaded_share, full_load_nm=full)


def _time_history(history: TimeHistory, scene: Scene, rng: np.random.Generator) -> PiecewiseLinear:
    times, values = np.array(history.knots).T
    declared = PiecewiseLinear(times_s=times, values=values)
    if history.turbulence is None:
        return declared
    gusts = history.turbulence
    spectrum = Kaimal(rms=gusts.rms, time_scale_s=gusts.time_scale_s)
    drawn = fluctuation(spectrum, duration_s=scene.duration_s, highest_hz=gusts.highest_hz, rng=rng)
    return sum_of(declared, drawn)


def _run_up_angle(scene: Scene, torque: PiecewiseLinear | None) -> PolynomialAngle:
    law, declared = scene.speed.run_up, scene.torque
    if law is None or declared is None or torque is None:  # checked by the scene
        raise SceneError("a run-up needs speed.run_up and torque; declare both.")
    to_reference = float(abs(scene.ratio(scene.speed.link)))
    # the power of a torque is the same at any link
    brought = torque.scaled(float(abs(scene.ratio(declared.link))) / to_reference)
    of_link = run_up(brought, law, duration_s=scene.duration_s)
    lowest = float(np.min(of_link.speed_hz(np.linspace(0.0, scene.duration_s, 1001))))
    if lowest < 0:
        raise SceneError(
            f"speed.run_up: the load reverses the shaft, to {lowest * _RPM:.3g} rpm; raise the torque or lower "
            "the load."
        )
    return of_link.scaled(1 / to_reference)
