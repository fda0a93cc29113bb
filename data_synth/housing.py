"""Transfer function from bearing forces to a channel: housing on its mounts, path and measurement chain.

H(s) = s^2 / (m (s^2 + 2 zeta w s + w^2)) prod_i p_i / (p_i - s)
"""

import numpy as np
from numpy.typing import NDArray

from data_synth.chain import Mode, Sensor
from data_synth.path import mode_pole
from data_synth.pole_filter import PoleFilter
from data_synth.profile import Array
from data_synth.scene import SceneError
from data_synth.sensors import linear_chain

ComplexArray = NDArray[np.complex128]

_APART = 1e-6
_STANDARD_GRAVITY = 9.80665


class Housing(PoleFilter):
    """Filter from a force in N to a channel, block by block; in the steady state of its first sample at the beginning.

    Parameters
    ----------
    mass_kg : float
    mounts : Mode
    path : Mode or None
        The mode of the scene's path.
    sensor : Sensor
    rate_hz : float
    """

    def __init__(self, *, mass_kg: float, mounts: Mode, path: Mode | None, sensor: Sensor, rate_hz: float) -> None:
        chain = linear_chain(sensor)
        mount = mode_pole(mounts)
        passed = [mode_pole(path), mode_pole(path).conjugate()] if path is not None else []
        self._low_pass = np.array([*passed, *chain.poles], dtype=np.complex128)
        self._mounts = np.array([mount, mount.conjugate()])
        self._gain = chain.gain / mass_kg / (_STANDARD_GRAVITY if sensor.units == "g" else 1.0)
        every = np.concatenate([self._mounts, self._low_pass])
        gaps = np.abs(every[:, None] - every) + np.diag(np.full(every.size, np.inf))
        if np.min(gaps / np.abs(every)) < _APART:
            raise SceneError(
                f'sensor "{sensor.name}": mounts, path, resonance or filter of its way coincide; move one of them by a '
                "thousandth."
            )
        kept = every.imag >= 0
        residues = np.array([self._residue_of(every, index) for index in np.flatnonzero(kept).tolist()])
        super().__init__(
            poles=every[kept],
            residues=residues * np.where(every[kept].imag > 0, 2, 1),
            direct=0.0 if self._low_pass.size else self._gain,
            rate_hz=rate_hz,
        )

    def response(self, frequency_hz: Array) -> ComplexArray:
        """Return H at frequencies, any shape, in the channel's units for one N."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        value = self._gain * s**2 / np.prod([s - pole for pole in self._mounts], axis=0)
        for pole in self._low_pass:
            value = value * (pole / (pole - s))
        return np.asarray(value)

    def _residue_of(self, every: ComplexArray, index: int) -> complex:
        """Return ``lim (s - p) H(s)`` at the pole with this number."""
        pole, others = every[index], np.delete(every, index)
        return complex(self._gain * pole**2 * np.prod(-self._low_pass) / np.prod(pole - others))
