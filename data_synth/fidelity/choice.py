"""Fidelity of each mesh of a scene: as declared or, for "auto", the cheapest within a tolerance of the full motion."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np

from data_synth.dynamics.active_dofs import LEVELS
from data_synth.fidelity.linear_response import (
    LinearPrediction,
    check_lines_possible,
    response_of,
    tooth_forces,
    with_lines,
)
from data_synth.fidelity.preview import preview_factor, preview_of, with_full_duration
from data_synth.operation.shaft_angle import Array
from data_synth.scene.random_streams import random_stream
from data_synth.scene.scene import Excitation, GearFault, Noise, Scene, SceneError
from data_synth.sources.prepared import PreparedScene, prepare_scene
from data_synth.vibration.meshes import Gears
from data_synth.vibration.run import Motion, motion_of, prepare_gears

# Models of the meshes of a scene at each level of fidelity: spectral lines, or time integration.


KINEMATIC = "kinematic"
LADDER = (KINEMATIC, *LEVELS)  # from the least to the most


def simulated_motion(stage: PreparedScene, gears: Gears, levels: Mapping[str, str]) -> Motion | None:
    """Return the motion to integrate at these levels; None where no mesh needs time integration."""
    if not set(LEVELS) & set(levels.values()):
        return None
    still = [name for name, level in levels.items() if level not in LEVELS]
    moving = {name: "torsional" if name in still else level for name, level in levels.items()}
    return motion_of(stage, gears, levels=moving, springs=still)


def with_kinematic_lines(stage: PreparedScene, gears: Gears, levels: Mapping[str, str]) -> PreparedScene:
    """Return the stage with the lines of its kinematic meshes and bending rings, from the most detailed motion."""
    kinematic = [name for name, level in levels.items() if level == KINEMATIC]
    if stage.scene.planet_pass is not None and stage.scene.planet_pass.ring is not None:
        stage = stage.with_bending_rings(most_detailed_motion(stage, gears, levels).sensor_forces.ring_loads())
    return with_lines(stage, response_of(most_detailed_motion(stage, gears, levels)), kinematic) if kinematic else stage


def most_detailed_motion(stage: PreparedScene, gears: Gears, levels: Mapping[str, str]) -> Motion:
    """Return the motion in which meshes without time integration have the highest fidelity that the scene allows."""
    most = stage.scene.fidelity if stage.scene.fidelity in LEVELS else "full"
    moving = {name: level if level in LEVELS else most for name, level in levels.items()}
    return motion_of(stage, gears, levels=moving)


# ---- Choice ----------------------------------------------------------------------------------------------------------


_MARGIN_DB = 10.0  # beyond the floor: the linear response decides without a simulation
_SAME_DB = -150.0
_SILENT_DB = -400.0
_COARSE = 8  # values of a stiffness to a period of its highest line
_INSTANTS = 9  # of a scene at which its linear response is evaluated


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A candidate compared with the full motion: difference of its worst channel in dB, simulated or predicted."""

    levels: Mapping[str, str]
    decibels: float
    run: bool

    def __str__(self) -> str:
        """Return as in ``kinematic about -3 dB``."""
        if math.isinf(self.decibels):
            return f"{named(self.levels)} out of the question"
        return f"{named(self.levels)} {'' if self.run else 'about '}{self.decibels:.0f} dB"


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The fidelity of each mesh.

    Attributes
    ----------
    levels : mapping of mesh to one of `LADDER`
        "kinematic": the lines of the linear response; else time integration.
    tried : tuple of Trial
        All candidates compared with the full motion; none where `floor_db` is None.
    floor_db : float or None
        Tolerated difference; None where the scene declares its fidelity.
    """

    levels: Mapping[str, str]
    tried: tuple[Trial, ...] = ()
    floor_db: float | None = None

    @property
    def name(self) -> str:
        """Return the levels in words."""
        return named(self.levels)

    @property
    def decibels(self) -> float:
        """Difference of the worst channel from the full motion in dB."""
        return next((trial.decibels for trial in self.tried if trial.levels == self.levels), _SILENT_DB)

    def __str__(self) -> str:
        """Return the choice and its reason as text."""
        if self.floor_db is None:
            return f"{self.name}, as declared"
        uniform = ", ".join(str(trial) for trial in self.tried if len(set(trial.levels.values())) == 1)
        apart = "nothing is lost" if self.decibels < _SAME_DB else f"apart by {self.decibels:.0f} dB"
        return f"{self.name}: within {self.floor_db:g} dB of full, {apart} (from full: {uniform or 'nothing'})"


def named(levels: Mapping[str, str]) -> str:
    """Return the levels as text: ``lateral``, or ``stage 1 lateral, stage 2 torsional`` where stages differ."""
    if len(set(levels.values())) == 1:
        return next(iter(levels.values()))
    return ", ".join(f"{mesh} {level}" for mesh, level in levels.items())


def chosen(stage: PreparedScene, gears: Gears) -> Choice:
    """Return the fidelity of each mesh of a scene.

    With "auto", equal levels for all stages are compared with the full motion, kinematic first; the first whose worst
    channel differs by less than `floor_db`, RMS of the difference over RMS, is chosen. A stage that declares a fidelity
    keeps it.

    The linear response decides where it can: a candidate that differs by 10 dB more than the floor at instants all
    over the scene is rejected, and one equal to the full motion is accepted. Others are simulated over the first
    `decide_s` of the scene.

    Raises
    ------
    SceneError
        If a stage declares a higher fidelity than the scene, or the scene cannot be integrated.
    """
    scene = stage.scene
    if scene.fidelity != "auto":
        return _as_declared(scene)
    own = _declared(scene)
    floor_db = scene.dynamics_or_default.floor_db
    top = {name: level or "full" for name, level in own.items()}
    comparison = _Comparison(stage=stage, gears=gears, top=top)
    tried: list[Trial] = []
    for common in (KINEMATIC, "lateral"):
        levels = {name: level or common for name, level in own.items()}
        if levels != top:
            tried.append(comparison.compare(levels))
            if tried[-1].decibels <= floor_db:
                return Choice(levels=levels, tried=tuple(tried), floor_db=floor_db)
    return Choice(levels=top, tried=tuple(tried), floor_db=floor_db)


def decided(scene: Scene) -> Choice:
    """Return the fidelity of each mesh of a scene, independent of its seed: `chosen` for its gears and seed 0.

    Scenes with equal gears, sensors, speed and torque share the cached result.
    """
    if scene.fidelity != "auto":
        return _as_declared(scene)
    gears = tuple(fault for fault in scene.faults if isinstance(fault, GearFault))
    return _decided(scene.model_copy(update={"faults": gears, "noise": Noise(), "excitation": Excitation()}))


@lru_cache(maxsize=64)
def _decided(scene: Scene) -> Choice:
    stage = with_full_duration(
        prepare_scene(preview_of(scene, preview_factor(scene)), rng_for=partial(random_stream, 0)), scene
    )
    return chosen(stage, prepare_gears(stage))


def forget() -> None:
    """Clear the cache of `decided`, as before a measurement of time."""
    _decided.cache_clear()


def _declared(scene: Scene) -> dict[str, str | None]:
    """Return the fidelity that each mesh declares for itself."""
    return {mesh.name: scene.dynamics_or_default.mesh(mesh.name).fidelity for mesh in scene.gearbox.meshes}


def _as_declared(scene: Scene) -> Choice:
    """Return the fidelities of a scene that does not leave them open."""
    levels = {mesh.name: scene.fidelity_of(mesh.name) for mesh in scene.gearbox.meshes}
    for mesh, level in levels.items():
        if LADDER.index(level) > LADDER.index(scene.fidelity):
            raise SceneError(
                f'dynamics.meshes: "{mesh}" has fidelity = "{level}", more than the scene\'s "{scene.fidelity}"; write '
                f'fidelity = "{level}" for the scene, and less for the other stages.'
            )
    return Choice(levels=levels)


@dataclass(frozen=True, kw_only=True)
class _Comparison:
    """Comparison of candidates with `top`, the highest levels that the scene allows."""

    stage: PreparedScene
    gears: Gears
    top: Mapping[str, str]

    def compare(self, levels: Mapping[str, str]) -> Trial:
        """Return a candidate with its difference from the full motion."""
        try:
            estimate_db = self._linear_estimate(levels)
            if estimate_db is None:
                return Trial(
                    levels=levels, decibels=_difference_db(self._channels(levels), self._reference_channels), run=True
                )
        except SceneError:  # as of a sensor along the shafts, where a lower level has no force
            estimate_db = math.inf
        return Trial(levels=levels, decibels=estimate_db, run=False)

    def _linear_estimate(self, levels: Mapping[str, str]) -> float | None:
        """Return the predicted difference in dB where it is decisive; None where a simulation is needed."""
        if any(level == KINEMATIC and name in self._no_lines for name, level in levels.items()):
            return math.inf
        prediction, floor_db = self._linear_prediction, self.stage.scene.dynamics_or_default.floor_db
        if prediction is None:
            return None
        estimate_db, motion = self._predicted(prediction, levels, floor_db)
        # motions that are left out follow by linear equations, which lack what they do to a stiffness that varies
        whole = motion is not None and motion.sensor_forces.structure is None
        same = prediction.linear or (whole and all(level in LEVELS for level in levels.values()))
        return estimate_db if estimate_db > floor_db + _MARGIN_DB or (same and estimate_db < _SAME_DB) else None

    # ---- as linear systems

    @cached_property
    def _whole(self) -> Motion:
        return most_detailed_motion(self.stage, self.gears, self.top)

    @cached_property
    def _no_lines(self) -> set[str]:
        """Names of the meshes that cannot be kinematic."""
        found = set()
        for name in self.top:
            try:
                check_lines_possible(self._whole, name)
            except SceneError:
                found.add(name)
        return found

    @cached_property
    def _linear_prediction(self) -> LinearPrediction | None:
        """Prediction from linear responses; None with planets, whose routes to sensors rotate, and with friction."""
        if self._whole.sensor_forces.rotate or any(mesh.friction for mesh in self._whole.system.meshes):
            return None
        last = self.stage.instants_s.size - 1
        steady = np.ptp(self.stage.speed_hz) == 0 and np.ptp(self.stage.load) == 0
        instants = (0,) if steady else tuple(np.unique(np.linspace(0, last, _INSTANTS).round().astype(int)).tolist())
        forces = {name: tooth_forces(self._whole, name, points=_COARSE) for name in self.top}
        return LinearPrediction(whole=response_of(self._whole), forces=forces, instants=instants)

    def _predicted(
        self, prediction: LinearPrediction, levels: Mapping[str, str], floor_db: float
    ) -> tuple[float, Motion | None]:
        """Return the predicted error in dB, above `floor_db` only a lower bound, and the motion where it was needed."""
        error_power = np.zeros(len(self.stage.scene.sensors))
        for name, level in levels.items():
            if level == KINEMATIC != self.top[name]:
                error_power += prediction.parametric_error[name]
        motion = (
            simulated_motion(self.stage, self.gears, levels)
            if _ratio_db(error_power, prediction.total_power) < floor_db
            else None
        )
        if motion is not None:
            response = response_of(motion)
            for name in [name for name, level in levels.items() if level in LEVELS]:
                error_power += prediction.motion_error(name, response)
        return _ratio_db(error_power, prediction.total_power), motion

    # ---- in time

    @cached_property
    def _reference_channels(self) -> Array:
        return self._channels(self.top)

    @cached_property
    def _trial_stage(self) -> PreparedScene:
        """The first `decide_s` of the scene, with its gears alone."""
        scene, drive = self.stage.scene, self.stage.drive
        scene = scene.changed(duration_s=min(scene.duration_s, scene.dynamics_or_default.decide_s))
        times_s = np.linspace(0.0, scene.duration_s, scene.truth_times)
        return replace(
            self.stage,
            scene=scene,
            instants_s=times_s,
            speed_hz=drive.angle.speed_hz(times_s),
            load=drive.load(times_s),
            families=(),
            amplitudes=(),
        )

    def _channels(self, levels: Mapping[str, str]) -> Array:
        scene = self._trial_stage.scene
        signal = np.zeros((len(scene.sensors), scene.samples))
        with_kinematic_lines(self._trial_stage, self.gears, levels).add_lines(signal)
        motion = simulated_motion(self._trial_stage, self.gears, levels)
        if motion is not None:
            signal += np.concatenate([*motion.channels(samples=scene.samples)], axis=1)
        return signal


def _difference_db(found: Array, reference: Array) -> float:
    """Return the RMS of the difference over the RMS of the worst channel, in dB."""
    return _ratio_db(np.mean((found - reference) ** 2, axis=1), np.mean(reference**2, axis=1))


def _ratio_db(error_power: Array, total: Array) -> float:
    ratios = np.divide(error_power, total, out=np.full(total.size, np.inf), where=total > 0)
    ratios[error_power == 0] = 0.0
    worst = float(np.max(ratios))
    return max(10 * math.log10(worst), _SILENT_DB) if worst > 0 else _SILENT_DB
