"""Time integration of a bearing in a scene, build_drive by its speed and load, in blocks of bounded memory."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from data_synth.bearing_dynamics import BearingModel, integrate_bearing
from data_synth.bearing_faults import bearing_fault, bearing_model, settling_time_s, shaft_load_n, zone_order
from data_synth.bearings import BearingImpacts
from data_synth.faults import ImpactTrain
from data_synth.profile import Array
from data_synth.scene import SceneError
from data_synth.stage import PreparedScene

_PER_RADIAN = (
    2.5  # steps to a radian of the fastest mode: the classical Runge-Kutta method then loses 1e-5 of it in a step
)
_BLOCK = 16384  # steps in memory at a time
_GROWS_S = 0.01  # between updates of the size of a growing spall
_DOWN = 0.25  # of a revolution


@dataclass(frozen=True, kw_only=True)
class BearingSimulation:
    """A bearing model of a scene, ready to be integrated.

    Attributes
    ----------
    stage : PreparedScene
    number : int
        Number of its fault, from 0.
    impacts : BearingImpacts
    per_sample : int
        Integration steps to a sample of the channels.
    settling_steps : int
        Steps before time zero, in which the transient of the start from rest decays.
    """

    stage: PreparedScene
    number: int
    impacts: BearingImpacts
    per_sample: int
    settling_steps: int

    def blocks(self, *, steps: int) -> Iterator[dict[str, Array]]:
        """Yield acceleration and force of the pedestal, from `settling_steps` steps before time zero, `steps` in all.

        ``acceleration`` (n,) of its resonator, upwards in m s-2; ``force`` (n,) of the elements on it, upwards in N.

        Raises
        ------
        SceneError
            If the integration diverges.
        """
        scene, state = self.stage.scene, None
        step_s = 1 / (self.per_sample * scene.rate_hz)
        fault = bearing_fault(scene, self.number)
        grows = math.ceil(_GROWS_S / step_s) if fault.growth is not None else _BLOCK
        for begin in range(-self.settling_steps, steps - self.settling_steps, block := min(grows, _BLOCK)):
            count = min(block, steps - self.settling_steps - begin)
            middle_s = max((begin + count / 2) * step_s, 0.0)
            model = bearing_model(scene, fault, size_mm=fault.size_mm * float(fault.relative_size(middle_s)))
            cage, spot, load_n = self._driven((begin + np.arange(2 * count + 1) / 2) * step_s)
            try:
                motion = integrate_bearing(
                    model, cage_turns=cage, defect_turns=spot, load_n=load_n, step_s=step_s, state=state
                )
            except ValueError as caught:
                raise SceneError(
                    f"fault {self.number + 1}: the bearing cannot be followed in time: {caught}."
                ) from None
            state, shaft = motion.state, model.shaft
            force = load_n[1, :-1:2] - shaft.mass_kg * motion.acceleration_m_s2[:-1, 1]
            force -= shaft.damping_n_s_m * motion.velocity_m_s[:-1, 1]
            force -= shaft.stiffness_n_m * motion.displacement_m[:-1, 1]
            yield {"acceleration": np.ascontiguousarray(motion.acceleration_m_s2[:-1, 4]), "force": force}

    def _driven(self, times_s: Array) -> tuple[Array, Array, Array]:
        """Return revolutions of cage and defect (n,), and the load in N (2, n)."""
        stage, rolling = self.stage, self.impacts.rolling
        fault = bearing_fault(stage.scene, self.number)
        times = np.clip(times_s, stage.drive.start_s, stage.scene.duration_s)
        revolutions = stage.drive.angle.revolutions(times)
        on_element = fault.kind == "rolling_element"
        spot = rolling.defect_phase(revolutions) / 2 if on_element else rolling.defect_turns(revolutions) - _DOWN
        zone = zone_order(stage.scene, fault) * revolutions - _DOWN
        load_n = shaft_load_n(fault, load=stage.drive.load(times), turns=zone)
        return rolling.cage_turns(revolutions) - _DOWN, spot, load_n


def bearing_simulation(stage: PreparedScene, number: int, train: ImpactTrain) -> BearingSimulation:
    """Return the bearing model of fault `number` (from 0), at rest, rolling as the impacts of `train` do."""
    scene = stage.scene
    fault = bearing_fault(scene, number)
    assert fault.five_dof is not None and train.bearing is not None  # noqa: S101, PT018 - only such bearings run
    model = bearing_model(scene, fault, size_mm=fault.size_mm)
    steps = steps_per_sample(model, force_n=fault.five_dof.load_n, rate_hz=scene.rate_hz)
    settling_steps = math.ceil(settling_time_s(scene, fault) * scene.rate_hz) * steps
    return BearingSimulation(
        stage=stage, number=number, impacts=train.bearing, per_sample=steps, settling_steps=settling_steps
    )


def steps_per_sample(model: BearingModel, *, force_n: float, rate_hz: float) -> int:
    """Return the integration steps to a sample for a bearing under a load."""
    return max(2, math.ceil(_PER_RADIAN * model.highest_rad_s(force_n) / rate_hz))
