"""From the forces of bearings to a channel: the housing on its mounts, the path, and the sensor's chain, in time.

    H(s) = s^2 / (m (s^2 + 2 zeta w s + w^2)) prod_i p_i / (p_i - s)

as a sum of exponentials, one recursion a pole. A force that is linear between samples has the spectrum of its samples
times ``sinc^2``; samples are corrected for that beforehand by the first terms of ``1 / sinc^2(x / 2) = 1 + s^2 / 3 +
8 s^4 / 45 + ...``, ``s = sin(x / 2)``, so H is true to 1e-4 up to a tenth of the rate and to 5e-3 up to a fifth.
"""

import numpy as np
from numpy.typing import NDArray

from data_synth.chain import Mode, Sensor
from data_synth.path import ring_pole
from data_synth.profile import Array
from data_synth.scene import SceneError
from data_synth.sensors import linear_chain

ComplexArray = NDArray[np.complex128]

AHEAD = 2  # samples of the force that a response needs beyond itself
_CORRECTION = np.array([1 / 90, -1 / 12 - 4 / 90, 1 + 2 / 12 + 6 / 90, -1 / 12 - 4 / 90, 1 / 90])
_APART = 1e-6
_STANDARD_GRAVITY = 9.80665


class Housing:
    """A force in N becomes a channel, block after block; before its first sample it was as it is there for ever.

    Parameters
    ----------
    mass_kg : float
    mounts : Mode
    path : Mode or None
        What the scene lets lines pass.
    sensor : Sensor
    rate_hz : float
    """

    def __init__(self, *, mass_kg: float, mounts: Mode, path: Mode | None, sensor: Sensor, rate_hz: float) -> None:
        chain = linear_chain(sensor)
        mount = ring_pole(mounts)
        passed = [ring_pole(path), ring_pole(path).conjugate()] if path is not None else []
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
        self._poles = every[kept]
        residues = np.array([self._residue(every, index) for index in np.flatnonzero(kept).tolist()])
        self._residues = residues * np.where(self._poles.imag > 0, 2, 1)
        self._direct = 0.0 if self._low_pass.size else self._gain
        self._weights(rate_hz)
        self._states: ComplexArray | None = None
        self._kept = np.empty(0)

    def response(self, frequency_hz: Array) -> ComplexArray:
        """Return H at frequencies, any shape, in the channel's units for one N."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        value = self._gain * s**2 / np.prod([s - pole for pole in self._mounts], axis=0)
        for pole in self._low_pass:
            value = value * (pole / (pole - s))
        return np.asarray(value)

    def push(self, force: Array) -> Array:
        """Return the response (n,) that the next samples (n,) of the force allow: it lags them by `AHEAD`.

        The first two samples of all are the response to a force that has been constant.
        """
        from scipy.signal import lfilter  # noqa: PLC0415

        if self._states is None:
            # at rest under the first force: what it has driven each pole to
            self._states = np.asarray(-self._residues / self._poles * force[0])
            self._kept = np.full(2 * AHEAD + 1, force[0])
        joined = np.concatenate([self._kept, force])
        self._kept = joined[-2 * AHEAD - 1 :]
        corrected = np.convolve(joined, _CORRECTION, mode="valid")
        now, before = corrected[1:], corrected[:-1]
        out = self._direct * joined[AHEAD + 1 : -AHEAD]  # what passes at once needs no line between samples
        for index, carry in enumerate(self._carry):
            fed = self._new[index] * now + self._old[index] * before
            state = np.array([carry * self._states[index]])
            ringing, _ = lfilter([1.0], [1.0, -carry], fed, zi=state)
            self._states[index] = ringing[-1]
            out = out + ringing.real
        return np.asarray(out)

    def _residue(self, every: ComplexArray, index: int) -> complex:
        """Return ``lim (s - p) H(s)`` at the pole with this number."""
        pole, others = every[index], np.delete(every, index)
        return complex(self._gain * pole**2 * np.prod(-self._low_pass) / np.prod(pole - others))

    def _weights(self, rate_hz: float) -> None:
        poles = self._poles / rate_hz
        self._carry = np.exp(poles)
        whole = np.where(np.abs(poles) < 1e-4, 1 + poles / 2 + poles**2 / 6, np.expm1(poles) / poles)  # noqa: PLR2004
        late = np.where(
            np.abs(poles) < 1e-2,  # noqa: PLR2004 - beyond, the difference keeps its digits
            1 / 2 + poles / 6 + poles**2 / 24 + poles**3 / 120 + poles**4 / 720 + poles**5 / 5040,
            (whole - 1) / poles,
        )
        self._new, self._old = self._residues / rate_hz * late, self._residues / rate_hz * (whole - late)
