"""Transfer function from bearing forces to a channel: housing on its mounts, path and measurement chain.

H(s) = s^2 / (m (s^2 + 2 zeta w s + w^2)) prod_i p_i / (p_i - s)

What moves the housing otherwise than a rigid body passes a high pass as well, s^2 / (s^2 + sqrt(2) v s + v^2): below v,
near its first own mode, a housing is rigid, and forces inside of it that balance do not move it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from data_synth.operation.shaft_angle import Array
from data_synth.scene.scene import SceneError
from data_synth.scene.sensors import Mode, Sensor
from data_synth.transfer.acquisition import linear_chain
from data_synth.transfer.paths import mode_pole

# ---- Response of a transfer function, given by poles and residues, to a sampled input, in time and in blocks ---------
#     H(s) = direct + sum_i residue_i / (s - p_i)
#
# One recursion for each pole. The input is linear between samples, whose spectrum is that of the samples times
# ``sinc^2``; this is compensated by the first terms of ``1 / sinc^2(x / 2) = 1 + s^2 / 3 + 8 s^4 / 45 + ...``, ``s =
# sin(x / 2)``, so H is exact to 1e-4 up to a tenth of the rate and to 5e-3 up to a fifth.


ComplexArray = NDArray[np.complex128]

AHEAD = 2  # samples of the input that a response needs beyond itself
CORRECTION = np.array([1 / 90, -1 / 12 - 4 / 90, 1 + 2 / 12 + 6 / 90, -1 / 12 - 4 / 90, 1 / 90])


def step_weights(poles: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the integrals of ``exp(p (1 - s))`` over a step, weighted with s and 1 - s, for poles (p,) per step."""
    whole = np.where(np.abs(poles) < 1e-4, 1 + poles / 2 + poles**2 / 6, np.expm1(poles) / poles)  # noqa: PLR2004
    late = np.where(
        np.abs(poles) < 1e-2,  # noqa: PLR2004 - beyond, the difference keeps its digits
        1 / 2 + poles / 6 + poles**2 / 24 + poles**3 / 120 + poles**4 / 720 + poles**5 / 5040,
        (whole - 1) / poles,
    )
    return late, whole - late


class PoleFilter:
    """A transfer function with its state; in the steady state of its first sample at the beginning.

    Parameters
    ----------
    poles, residues : (p,) complex array
        In rad s-1; one of each conjugate pair, with twice its residue; the real part is the response.
    direct : float
        Direct feedthrough.
    rate_hz : float
    """

    def __init__(self, *, poles: ComplexArray, residues: ComplexArray, direct: float, rate_hz: float) -> None:
        self._poles, self._residues, self._direct = poles, residues, direct
        self._decay = np.exp(poles / rate_hz)
        late, early = step_weights(poles / rate_hz)
        self._weights_new, self._weights_old = residues / rate_hz * late, residues / rate_hz * early
        self._states: ComplexArray | None = None
        self._input_history = self._direct_history = np.empty(0)

    def push(self, samples: Array, *, at_once: Array | None = None) -> Array:
        """Return the response (n,) to the next samples (n,), delayed by `AHEAD` samples.

        The input of the direct feedthrough may be given apart in `at_once`, (n,), where `samples` are smoothed. The
        first two samples of all are the response to a constant input.
        """
        from data_synth.transfer._acquisition_kernels import add_pole_responses  # noqa: PLC0415

        if self._states is None:
            # at rest under the first sample: what it has driven each pole to
            self._states = np.asarray(-self._residues / self._poles * samples[0])
            self._input_history = np.full(2 * AHEAD + 1, samples[0])
            self._direct_history = np.full(AHEAD, samples[0])
        joined = np.concatenate([self._input_history, samples])
        self._input_history = joined[-2 * AHEAD - 1 :]
        direct = np.concatenate([self._direct_history, samples if at_once is None else at_once])
        self._direct_history = direct[-AHEAD:]
        corrected = np.convolve(joined, CORRECTION, mode="valid")
        out = self._direct * direct[:-AHEAD]  # what passes at once needs no line between samples
        add_pole_responses(out, corrected, self._decay, self._weights_new, self._weights_old, self._states)
        return out


# ---- Housing ---------------------------------------------------------------------------------------------------------


_APART = 1e-6
_FLAT = math.sqrt(0.5)  # damping ratio of a Butterworth filter of second order
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
        Of the force.
    channel_rate_hz : float
        Of the channel, which its anti-aliasing filter follows.
    rigid_below_hz : float or None
        v / 2 pi of the high pass; None for none.
    """

    def __init__(
        self,
        *,
        mass_kg: float,
        mounts: Mode,
        path: Mode | None,
        sensor: Sensor,
        rate_hz: float,
        channel_rate_hz: float,
        rigid_below_hz: float | None = None,
    ) -> None:
        chain = linear_chain(sensor, rate_hz=channel_rate_hz)
        mount = mode_pole(mounts)
        passed = [mode_pole(path), mode_pole(path).conjugate()] if path is not None else []
        self._low_pass = np.array([*passed, *chain.poles], dtype=np.complex128)
        elastic = [] if rigid_below_hz is None else [mode_pole(Mode(frequency_hz=rigid_below_hz, damping_ratio=_FLAT))]
        self._high_pass = np.array([turn for pole in (mount, *elastic) for turn in (pole, pole.conjugate())])
        self._gain = chain.gain / mass_kg / (_STANDARD_GRAVITY if sensor.units == "g" else 1.0)
        every = np.concatenate([self._high_pass, self._low_pass])
        gaps = np.abs(every[:, None] - every) + np.diag(np.full(every.size, np.inf))
        if np.min(gaps / np.abs(every)) < _APART:
            raise SceneError(
                f'sensor "{sensor.name}": mounts, rigid_below_hz, path, resonance or filter of its way coincide; move '
                "one of them by a thousandth."
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
        value = self._gain * s**self._high_pass.size / np.prod([s - pole for pole in self._high_pass], axis=0)
        for pole in self._low_pass:
            value = value * (pole / (pole - s))
        return np.asarray(value)

    def _residue_of(self, every: ComplexArray, index: int) -> complex:
        """Return ``lim (s - p) H(s)`` at the pole with this number."""
        pole, others = every[index], np.delete(every, index)
        return complex(self._gain * pole**self._high_pass.size * np.prod(-self._low_pass) / np.prod(pole - others))
