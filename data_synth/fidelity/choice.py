"""Model of gear dynamics: time integration, or the linear response where it is accurate enough.

The error of the linear response is estimated from that response itself: the product of the vibration of other meshes
and the variation of a stiffness, and the lag of lines behind a varying speed.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from data_synth.fidelity.linear_response import (
    COARSE,
    MIN_STIFFNESS,
    Response,
    ToothForces,
    obstacle,
    period_of,
    response_of,
    tooth_forces,
    with_lines,
)
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import SceneError
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.run import Motion

_INSTANTS = 17  # of a scene at which its linear response is evaluated
_BINS = 512  # of a spectrum, up to the Nyquist frequency
_STEADY = 1e-9  # of a speed or a force: variation due to rounding
_NOTHING_DB = -150.0
_MARGIN_DB, _MODES_PASSED = 3.0, 4.0
"""Margin below the floor for neglected terms; and the ratio of the power of the lag to its value at the instants,
between which the speed may pass modes."""
_Excited = tuple[ToothForces, Array, ComplexArray]
"""A mesh: its exciting force, and frequency in Hz and excitation in N of its lines at all instants, (instant, line)."""
_STENCIL = 0.25  # of the relative half-bandwidth of a mode: the step of second differences


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Whether gears are simulated as lines of their linear response, and why."""

    linear: bool
    why: str

    def __str__(self) -> str:
        """Return the model and the reason."""
        return f"{'linear response' if self.linear else 'dynamic'}: {self.why}"


def chosen(motion: Motion) -> Choice:
    """Return the model of gears: with "auto" their linear response if the models differ by less than `floor_db`.

    The difference is the RMS error of the worst channel over its RMS, estimated at instants throughout the scene.
    """
    scene = motion.stage.scene
    if scene.fidelity != "auto":
        return Choice(linear=False, why="as declared")
    why = obstacle(motion)
    estimate = _Estimate(motion=motion)
    try:
        why = why or ("teeth lose contact" if estimate.teeth_part() else "")
    except SceneError as unstable:
        why = str(unstable).partition(";")[0]
    if why:
        return Choice(linear=False, why=f"{why}, so the response is not linear")
    floor_db = scene.dynamics_or_default.floor_db
    error_db = estimate.error_db()
    apart = f"about {error_db:.0f} dB" if error_db > _NOTHING_DB else "nothing"
    return Choice(
        linear=error_db <= floor_db - _MARGIN_DB, why=f"the models differ by {apart}; {floor_db:g} dB is allowed"
    )


def with_gear_lines(stage: PreparedScene, motion: Motion, choice: Choice) -> PreparedScene:
    """Return the stage with the lines that are not integrated: of bending rings, and of the linear response."""
    if stage.scene.planet_pass is not None and stage.scene.planet_pass.ring is not None:
        stage = stage.with_bending_rings(motion.sensor_forces.ring_loads())
    return with_lines(stage, motion) if choice.linear else stage


@dataclass(frozen=True, kw_only=True)
class _Estimate:
    """Error of the linear response of gears, as mean powers in the channels, (sensor,)."""

    motion: Motion
    _known: dict[int, _Excited] = field(default_factory=dict, init=False)

    @cached_property
    def _response(self) -> Response:
        return response_of(self.motion)

    @cached_property
    def _instants(self) -> list[int]:
        """Indices of instants throughout the scene; one if conditions are constant."""
        stage = self.motion.stage
        if all(np.ptp(each) <= _STEADY * np.max(np.abs(each)) for each in (stage.speed_hz, *self.motion.static_n)):
            return [0]
        return sorted({*np.linspace(0, stage.instants_s.size - 1, _INSTANTS).round().astype(int).tolist()})

    def _excited_by(self, mesh: int) -> _Excited:
        if mesh not in self._known:
            force = tooth_forces(self.motion, self.motion.system.meshes[mesh].name, points=COARSE)
            frequency_hz = np.outer(self.motion.stage.speed_hz[self._instants], force.orders)
            self._known[mesh] = force, frequency_hz, self._response.excitations(force, self._instants).T
        return self._known[mesh]

    @cached_property
    def _meshes(self) -> list[_Excited]:
        return [self._excited_by(mesh) for mesh in range(len(self.motion.system.meshes))]

    @cached_property
    def _transfers(self) -> list[ComplexArray]:
        """Lines in the channels per N of force of each mesh, (sensor, instant, line)."""
        return [self._response.channels(mesh, frequency_hz) for mesh, (_, frequency_hz, _) in enumerate(self._meshes)]

    def _mean(self, lines: list[ComplexArray]) -> Array:
        """Return the power (sensor,) of the lines of all meshes, averaged over the instants."""
        powers = [np.sum(np.abs(each) ** 2, axis=(1, 2)) / 2 for each in lines]
        return np.asarray(np.sum(powers, axis=0) / len(self._instants))

    def teeth_part(self) -> bool:
        """Return whether contact may be lost: with a stiffness near zero, or lines that exceed the static force.

        Meshes that repeat after few cycles have few lines, and come first.
        """
        static_n, meshes = np.abs(self.motion.static_n[:, self._instants]), self.motion.system.meshes
        total, free = np.zeros(static_n.shape), [mesh.backlash_m > 0 for mesh in meshes]
        for mesh in sorted(range(len(meshes)), key=lambda number: period_of(meshes[number])):
            force, frequency_hz, excitation = self._excited_by(mesh)
            if np.min(force.stiffness) < MIN_STIFFNESS * self._response.means[mesh]:
                return True
            lines = self._response.means[:, None, None] * self._response.deflections_by(mesh, frequency_hz) * excitation
            lines[mesh] += excitation  # k (d - e) = k_mean d + q
            total += np.sum(np.abs(lines), axis=2)
            if np.any((total >= static_n)[free]):
                return True
        return False

    def error_db(self) -> float:
        """Return the relative RMS error of the worst channel in dB."""
        both = zip(self._transfers, self._meshes, strict=True)
        power = self._mean([transfer * excitation for transfer, (*_, excitation) in both])
        error = self._lag() + self._other_variation()
        with np.errstate(divide="ignore"):
            ratio = math.sqrt(np.max(error[error > 0] / power[error > 0], initial=0.0))
        # further terms as in a geometric series
        ratio = ratio / (1 - ratio) if ratio < 1 else math.inf
        return 20 * math.log10(ratio) if ratio > 0 else -math.inf

    def _other_variation(self) -> Array:
        """Return the error by the product of a mesh stiffness and the vibration due to other meshes.

        The products may lie at any frequency, so the gain is averaged over all. This is within 1.5 dB of the
        convolution of both spectra.
        """
        scene, found = self.motion.stage.scene, np.zeros(len(self.motion.stage.scene.sensors))
        grid_hz = np.linspace(0.0, scene.rate_hz / 2, _BINS)
        for other, (force, *_) in enumerate(self._meshes):
            gain = np.mean(np.abs(self._response.channels(other, grid_hz)) ** 2, axis=1) * np.var(force.stiffness)
            for mesh, (_, frequency_hz, excitation) in enumerate(self._meshes):
                if mesh != other:
                    deflection = self._response.deflections_by(mesh, frequency_hz)[other] * excitation
                    found += gain * np.sum(np.abs(deflection) ** 2) / 2 / len(self._instants)
        return found

    def _lag(self) -> Array:
        """Return the error by the lag of lines behind a varying speed.

        By ``(j / 2) (domega / dt) d2Z / domega2``, the first term of the response to a sweep (Carson and Fry 1937, Bell
        Syst. Tech. J. 16, 513).
        """
        stage, poles = self.motion.stage, self._response.poles
        if len(self._instants) == 1:
            return np.zeros(len(stage.scene.sensors))
        share, found = _STENCIL * float(np.min(-poles.real / np.abs(poles))), []
        rates, speed_hz = np.gradient(stage.speed_hz, stage.instants_s)[self._instants], stage.speed_hz[self._instants]
        for mesh, (_, frequency_hz, excitation) in enumerate(self._meshes):
            low, high = (self._response.channels(mesh, frequency_hz * factor) for factor in (1 - share, 1 + share))
            late = rates[:, None] / (2 * np.pi * frequency_hz * speed_hz[:, None] * share**2)
            found.append(late / 2 * (low - 2 * self._transfers[mesh] + high) * excitation)
        return _MODES_PASSED * self._mean(found)
