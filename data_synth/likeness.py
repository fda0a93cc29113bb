"""Error of reduced models against the full motion, predicted from their linear responses without integration."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from data_synth.combs import ComplexArray
from data_synth.mesh_response import Response, ToothForces
from data_synth.profile import Array


@dataclass(frozen=True, kw_only=True)
class LinearPrediction:
    """Powers in the channels, (sensor,) in squares of their units, means over some instants of the scene.

    Attributes
    ----------
    whole : Response
        Linear response of the full motion.
    forces : mapping of mesh to ToothForces
        Exciting force of each mesh.
    instants : tuple of int
        Numbers of the instants of the truth.
    """

    whole: Response
    forces: Mapping[str, ToothForces] = field(repr=False)
    instants: tuple[int, ...]

    @cached_property
    def line_power(self) -> dict[str, Array]:
        """Power of the lines of each mesh."""
        return {name: self._power(name, lambda lines_of_mesh, _force, _instant: lines_of_mesh) for name in self.forces}

    @cached_property
    def parametric_error(self) -> dict[str, Array]:
        """Power of the parametric excitation, which the linear response lacks: deflection times varying stiffness."""
        return {name: self._power(name, self._parametric_lines) for name in self.forces}

    @property
    def total_power(self) -> Array:
        """Power of the lines of all meshes."""
        return np.asarray(np.sum([*self.line_power.values()], axis=0))

    @property
    def linear(self) -> bool:
        """Whether every stiffness is constant and no mesh has backlash."""
        constant = all(np.ptp(force.stiffness) <= 1e-12 * np.max(force.stiffness) for force in self.forces.values())
        return constant and all(mesh.backlash_m == 0 for mesh in self.whole.motion.system.meshes)

    def motion_error(self, name: str, other: Response) -> Array:
        """Return the power of the difference between the lines of a mesh in this motion and in another."""
        number = other.number(name)

        def difference(lines_of_mesh: ComplexArray, force: ToothForces, instant: int) -> ComplexArray:
            return np.asarray(
                other.channels(number, self._frequencies_hz(force, instant)) * force.at(instant) - lines_of_mesh
            )

        return self._power(name, difference)

    def _parametric_lines(self, _lines_of_mesh: ComplexArray, force: ToothForces, instant: int) -> ComplexArray:
        number, frequencies = self.whole.number(force.mesh), self._frequencies_hz(force, instant)
        deflection = self.whole.deflection(number, frequencies) * force.at(instant)
        remainder = force.parametric_force(deflection, instant, mean=float(self.whole.means[number]))
        return np.asarray(self.whole.channels(number, frequencies) * remainder)

    def _power(self, name: str, lines: Callable[[ComplexArray, ToothForces, int], ComplexArray]) -> Array:
        force, number = self.forces[name], self.whole.number(name)
        powers = []
        for instant in self.instants:
            lines_of_mesh = self.whole.channels(number, self._frequencies_hz(force, instant)) * force.at(instant)
            powers.append(np.sum(np.abs(lines(lines_of_mesh, force, instant)) ** 2, axis=1) / 2)
        return np.asarray(np.mean(powers, axis=0))

    def _frequencies_hz(self, force: ToothForces, instant: int) -> Array:
        return np.asarray(force.orders * self.whole.motion.stage.speed_hz[instant])
