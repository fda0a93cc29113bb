"""Campbell diagram: natural frequencies and damping ratios over speed, and critical speeds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from data_synth.modal import undamped_modes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from data_synth.mechanics import Array, System
    from data_synth.mesh import ComplexArray

_OVERDAMPED = 1e-9  # of the magnitude: eigenvalues with a smaller imaginary part do not oscillate
_RIGID = 1e-7  # of the largest magnitude: a double zero is found to half the digits


@dataclass(frozen=True, kw_only=True)
class Campbell:
    """Natural frequencies and damping ratios over speed, rising in frequency at every speed.

    Attributes
    ----------
    speeds_rad_s : (speed,) array
        Speed of the reference shaft in rad/s.
    frequencies_hz : (speed, mode) array
        Damped natural frequencies in Hz; zero for rigid-body and overdamped motions.
    damping_ratios : (speed, mode) array
        Fractions of critical damping; NaN for rigid-body and overdamped motions.
    orders : tuple of float
        Mesh orders of the system at its last speed, cycles per revolution of the reference.

    Examples
    --------
    >>> from data_synth.campbell import campbell
    >>> from data_synth.elements import Support
    >>> from data_synth.mechanics import Body, build_system
    >>> gear = Body(name="gear", mass_kg=2.0, motions=("x",))
    >>> hold = Support(between=("gear", None), x=2e6, damping_s=4e-5)  # zeta = damping_s omega / 2
    >>> diagram = campbell(lambda _: build_system([gear], [hold]), speeds_rad_s=[0.0, 100.0])
    >>> round(float(diagram.damping_ratios[0, 0]), 6)
    0.02
    """

    speeds_rad_s: Array = field(metadata={"dims": ("speed",), "units": "rad/s"})
    frequencies_hz: Array = field(metadata={"dims": ("speed", "mode"), "units": "Hz"})
    damping_ratios: Array = field(metadata={"dims": ("speed", "mode"), "units": "1"})
    orders: tuple[float, ...]

    def critical_speeds(self, order: float) -> Array:
        """Return the critical speeds of an order: where ``order x speed`` equals a natural frequency.

        Parameters
        ----------
        order : float
            Cycles of the excitation per revolution of the reference.

        Returns
        -------
        (n,) array
            Speeds of the reference in rad/s, rising; interpolated linearly between ``speeds_rad_s``.

        Examples
        --------
        An excitation of order 20 meets a natural frequency of 1000 rad/s at 50 rad/s:

        >>> import numpy as np
        >>> from data_synth.campbell import campbell
        >>> from data_synth.elements import Support
        >>> from data_synth.mechanics import Body, build_system
        >>> gear = Body(name="gear", mass_kg=2.0, motions=("x",))
        >>> system = build_system([gear], [Support(between=("gear", None), x=2e6)])
        >>> diagram = campbell(lambda _: system, speeds_rad_s=[0.0, 200.0])
        >>> np.round(diagram.critical_speeds(20), 6).tolist()
        [50.0]
        """
        excitation_hz = order * self.speeds_rad_s / (2 * np.pi)
        found: list[float] = []
        for frequencies in self.frequencies_hz.T:
            above = frequencies - excitation_hz
            for left in np.flatnonzero((above[:-1] > 0) != (above[1:] > 0)):
                if frequencies[left] > 0 or frequencies[left + 1] > 0:
                    share = above[left] / (above[left] - above[left + 1])
                    step = self.speeds_rad_s[left + 1] - self.speeds_rad_s[left]
                    found.append(float(self.speeds_rad_s[left] + share * step))
        return np.array(sorted(found))


def campbell(system_at: Callable[[float], System], *, speeds_rad_s: Sequence[float] | Array) -> Campbell:
    """Return natural frequencies and damping ratios over speed, every mesh in contact at its mean stiffness.

    Parameters
    ----------
    system_at : callable
        From the speed of the reference in rad/s to the system assembled for it, with its gyroscopic terms.
    speeds_rad_s : (speed,) sequence of float
        Speeds of the reference in rad/s, rising.

    Returns
    -------
    Campbell

    Examples
    --------
    The tilting of a disc on an isotropic bearing splits into backward and forward whirl,
    ``s^2 -+ (J Omega / I) s - k / I = 0``; a thin disc has J = 2 I:

    >>> import numpy as np
    >>> from data_synth.campbell import campbell
    >>> from data_synth.elements import Support
    >>> from data_synth.mechanics import Body, build_system
    >>> hold = Support(between=("disc", None), tilt_x=1e4, tilt_y=1e4)
    >>> disc = Body(
    ...     name="disc", inertia_kgm2=0.02, tilt_inertia_kgm2=0.01, motions=("tilt x", "tilt y"), speed_ratio=1.0
    ... )
    >>> diagram = campbell(lambda speed: build_system([disc], [hold], speed_rad_s=speed), speeds_rad_s=[0.0, 750.0])
    >>> np.round(2 * np.pi * diagram.frequencies_hz, 6).tolist()  # 1000 rad/s at rest
    [[1000.0, 1000.0], [500.0, 2000.0]]
    """
    speeds = np.asarray(speeds_rad_s, dtype=np.float64)
    systems = [system_at(speed) for speed in speeds.tolist()]
    pairs = [_frequencies_and_ratios(eigenvalues(system)) for system in systems]
    return Campbell(
        speeds_rad_s=speeds,
        frequencies_hz=np.array([frequencies for frequencies, _ in pairs]),
        damping_ratios=np.array([ratios for _, ratios in pairs]),
        orders=tuple(dict.fromkeys(mesh.cycles_per_rev for mesh in systems[-1].meshes)),
    )


def eigenvalues(system: System) -> ComplexArray:
    """Return all eigenvalues of ``M s^2 + (C + G) s + K``, meshes at their mean stiffness.

    Without damping and gyroscopic terms they are ``+- j omega`` of the undamped modes, to their own relative precision;
    otherwise those of the state matrix, to the precision of the largest.

    Parameters
    ----------
    system : System

    Returns
    -------
    (2 dof,) complex array
        In rad/s.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.campbell import eigenvalues
    >>> from data_synth.elements import Support
    >>> from data_synth.mechanics import Body, build_system
    >>> gear = Body(name="gear", mass_kg=1.0, motions=("x",))
    >>> values = eigenvalues(build_system([gear], [Support(between=("gear", None), x=25.0, damping_s=0.24)]))
    >>> np.round(np.sort_complex(values), 6).tolist()  # s^2 + 6 s + 25 = 0
    [(-3-4j), (-3+4j)]
    """
    velocity = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    if not velocity.any() and system.springs:
        angular, _ = undamped_modes(system, [mesh.stiffness.mean for mesh in system.meshes])
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


def _frequencies_and_ratios(values: ComplexArray) -> tuple[Array, Array]:
    """Return damped natural frequencies in Hz and damping ratios, one for each conjugate pair of eigenvalues."""
    size = np.abs(values)
    oscillating = (np.abs(values.imag) > _OVERDAMPED * size) & (size > _RIGID * size.max())
    upper = values[oscillating & (values.imag > 0)]
    upper = upper[np.argsort(upper.imag, kind="stable")]
    rest = values.size // 2 - upper.size
    frequencies = np.concatenate([np.zeros(rest), upper.imag / (2 * np.pi)])
    return frequencies, np.concatenate([np.full(rest, np.nan), -upper.real / np.abs(upper)])
