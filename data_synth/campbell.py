"""Campbell diagram: natural frequencies and damping over speed, and where an excitation meets them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from data_synth.mechanics import Array, System
from data_synth.mesh import ComplexArray
from data_synth.modal import mode_pairs

_OVERDAMPED = 1e-9  # of the magnitude: eigenvalues with less of an imaginary part do not swing
_AT_REST = 1e-7  # of the largest magnitude: a double zero is found to half the digits


@dataclass(frozen=True, kw_only=True)
class Campbell:
    """Frequencies over speed, rising at every speed.

    Attributes
    ----------
    speeds_rad_s : (speed,) array
        Of the reference.
    frequencies_hz, damping_ratios : (speed, mode) array
        Zero and NaN for motions that do not swing.
    orders : tuple of float
        Mesh orders of the system at its last speed, cycles per revolution of the reference.
    """

    speeds_rad_s: Array = field(metadata={"dims": ("speed",), "units": "rad/s"})
    frequencies_hz: Array = field(metadata={"dims": ("speed", "mode"), "units": "Hz"})
    damping_ratios: Array = field(metadata={"dims": ("speed", "mode"), "units": "1"})
    orders: tuple[float, ...]

    def critical_speeds(self, order: float) -> Array:
        """Return the speeds in rad/s at which ``order x speed`` meets a frequency, linear between speeds, rising."""
        excited = order * self.speeds_rad_s / (2 * np.pi)
        found: list[float] = []
        for frequencies in self.frequencies_hz.T:
            above = frequencies - excited
            for left in np.flatnonzero((above[:-1] > 0) != (above[1:] > 0)):
                if frequencies[left] > 0 or frequencies[left + 1] > 0:
                    share = above[left] / (above[left] - above[left + 1])
                    step = self.speeds_rad_s[left + 1] - self.speeds_rad_s[left]
                    found.append(float(self.speeds_rad_s[left] + share * step))
        return np.array(sorted(found))


def campbell(system_at: Callable[[float], System], *, speeds_rad_s: Sequence[float] | Array) -> Campbell:
    """Return frequencies and damping over speed, the meshes closed at their mean stiffness.

    Parameters
    ----------
    system_at : callable
        From the speed of the reference in rad/s to the system assembled for it, with its gyroscopic terms.
    speeds_rad_s : sequence of float
        Rising.
    """
    speeds = np.asarray(speeds_rad_s, dtype=np.float64)
    systems = [system_at(speed) for speed in speeds.tolist()]
    pairs = [_swinging(eigenvalues(system)) for system in systems]
    return Campbell(
        speeds_rad_s=speeds,
        frequencies_hz=np.array([frequencies for frequencies, _ in pairs]),
        damping_ratios=np.array([ratios for _, ratios in pairs]),
        orders=tuple(dict.fromkeys(mesh.cycles_per_rev for mesh in systems[-1].meshes)),
    )


def eigenvalues(system: System) -> ComplexArray:
    """Return all eigenvalues of ``M s^2 + (C + G) s + K``, meshes at their means, (2 dof,) rad/s.

    Where nothing damps or turns the system they are ``+- j omega`` of its modes, to their own relative precision;
    otherwise those of the state matrix, to the precision of the largest.
    """
    velocity = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    if not velocity.any() and system.springs:
        angular, _ = mode_pairs(system, [mesh.stiffness.mean for mesh in system.meshes])
        return np.concatenate([1j * angular, -1j * angular])
    inverse = np.linalg.inv(np.linalg.cholesky(system.mass))
    stiffness = inverse @ system.mean_stiffness() @ inverse.T
    scale = float(np.sqrt(np.abs(stiffness).max())) or 1.0
    size = system.dof
    rates = np.zeros((2 * size, 2 * size))
    rates[:size, size:] = np.eye(size) * scale
    rates[size:, :size] = -stiffness / scale
    rates[size:, size:] = -inverse @ velocity @ inverse.T
    return np.asarray(np.linalg.eigvals(rates), dtype=np.complex128)


def _swinging(values: ComplexArray) -> tuple[Array, Array]:
    """Return frequencies in Hz and damping ratios, one for each pair of eigenvalues."""
    size = np.abs(values)
    swings = (np.abs(values.imag) > _OVERDAMPED * size) & (size > _AT_REST * size.max())
    upper = values[swings & (values.imag > 0)]
    upper = upper[np.argsort(upper.imag, kind="stable")]
    still = values.size // 2 - upper.size
    frequencies = np.concatenate([np.zeros(still), upper.imag / (2 * np.pi)])
    return frequencies, np.concatenate([np.full(still, np.nan), -upper.real / np.abs(upper)])
