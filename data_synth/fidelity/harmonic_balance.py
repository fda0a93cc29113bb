"""Harmonic balance: forces p in meshes whose varying stiffness makes more of them, of the deflections that p makes.

With w the change of stiffness over its mean and G the deflections in stiffnesses per N, ``p - w G p`` is given. A sweep
in time through a period, mode by mode with p linear between instants, has all but a few per cent of p, and again of
what the equations of the lines then leave. The product with w is one of waveforms in angle. Its factor, the deflection,
is smooth where the stiffness jumps. Were the tooth force the factor, of ``1 - k_mean / k``, both would jump, and lines
of a product of jumps converge slowly (Li 1996, J. Opt. Soc. Am. A 13, 1870).
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_synth.fidelity.excitation import Excitation
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

Singles: TypeAlias = NDArray[np.complex64]

_MOST_SWEEPS = 16  # each leaves 2 to 15 per cent
_NO_USE = 0.7  # of what the sweep before left: the stiffness excites vibration that grows
_PART = 0.05  # of the force in a spring: less is not waited for, and modes with less deflect at once
_FAST = 2.5  # rad in a step of a sweep, where the highest line has 2.1: modes that turn faster deflect at once
_LONGEST_RUN_IN = 1 << 15  # steps before the period of a sweep, where modes are hardly damped


@dataclass(frozen=True, kw_only=True)
class Varying:
    """``k / k_mean - 1`` in a period of an order, (mesh, n), and its lines (mesh, k), n / 2 times as large."""

    waves: NDArray[np.float32]
    lines: Singles

    @classmethod
    def of(cls, excitations: list[Excitation], base: Fraction, lines: int) -> "Varying":
        """Return it at so many points that no product of two of so many lines aliases to a third."""
        from scipy.fft import next_fast_len, rfft  # noqa: PLC0415

        points = next_fast_len(3 * lines + 1, real=True)
        waves = np.stack([each.waveform(base, points) for each in excitations]).astype(np.float32)
        return cls(waves=waves, lines=np.asarray(rfft(waves)[:, 1 : lines + 1], dtype=np.complex64))

    def of_meshes(self, meshes: NDArray[np.int_]) -> "Varying":
        """Return that of some meshes."""
        return Varying(waves=self.waves[meshes], lines=self.lines[meshes])

    def times(self, deflections: Singles) -> Singles:
        """Return the lines (input, mesh, k) of its product with deflections whose mean keeps that of tooth forces."""
        from scipy.fft import rfft  # noqa: PLC0415

        waves = self.waves_of(deflections)
        waves *= self.waves
        product = rfft(waves)
        found = product[..., 1 : self.lines.shape[1] + 1]
        found -= product[..., :1] / self.waves.shape[1] * self.lines
        return np.asarray(found, dtype=np.complex64)

    def waves_of(self, lines: Singles) -> NDArray[np.float32]:
        """Return lines (input, mesh, k) as waves (input, mesh, n)."""
        from scipy.fft import irfft  # noqa: PLC0415

        points = self.waves.shape[1]
        spectrum = np.zeros((*lines.shape[:-1], points // 2 + 1), dtype=np.complex64)
        spectrum[..., 1 : lines.shape[-1] + 1] = lines
        return np.asarray(irfft(spectrum, points, overwrite_x=True), dtype=np.float32)


def balanced(
    excitation: Singles,
    start: Singles,
    speed_hz: float,
    *,
    gains: ComplexArray,
    varying_of: Callable[[Fraction, int], Varying],
    modes: "Modes",
    base: Fraction,
    step_hz: float,
    bound: float,
) -> Singles:
    """Return p, (input, mesh, k).

    Parameters
    ----------
    excitation : (input, mesh, k) array
        p without the deflections that p makes.
    start : (input, mesh, k) array
        First guess.
    speed_hz : float
    gains : (mesh, mesh, f) array
        Deflection of a mesh per N of p in another, times k_mean.
    varying_of : callable
        From base and number of lines to the varying stiffness of the meshes.
    modes : Modes
        The same response as a sum over modes.
    base : Fraction
    step_hz : float
        Between the responses.
    bound : float
        Of the residual of each input.
    """
    meshes, lines = excitation.shape[1:]
    place = float(base) * speed_hz / step_hz * np.arange(1, lines + 1)
    number = np.minimum(place.astype(np.int64), gains.shape[2] - 2)
    share = np.minimum(place - number, 1.0)
    gain = ((1 - share) * gains[:, :, number] + share * gains[:, :, number + 1]).astype(np.complex64)
    varying = varying_of(base, lines)

    def remainder(forces: Singles) -> Singles:
        total = gain[:, 0] * forces[:, None, 0]
        for mesh in range(1, meshes):  # in place of einsum, whose loop over lines is three times as slow
            total += gain[:, mesh] * forces[:, None, mesh]
        return np.asarray(forces - varying.times(total))

    found, left, known = start, np.full(excitation.shape[0], np.inf), excitation - remainder(start)
    with np.errstate(over="ignore", invalid="ignore"):  # where the stiffness excites vibration that grows
        for _ in range(_MOST_SWEEPS):
            size = np.linalg.norm(real_rows(known), axis=1)
            if not np.any(size < _NO_USE * left):
                break
            found, left = start, size
            if np.all(left <= bound):
                break
            start = found + modes.swept(known, varying, 1 / (float(base) * speed_hz))
            known = excitation - remainder(start)
    return found


def real_rows(lines: Singles) -> NDArray[np.float32]:
    """Return lines (input, mesh, k) as real vectors (input, n)."""
    return np.asarray(np.ascontiguousarray(lines).reshape(lines.shape[0], -1).view(np.float32))


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Deflections of meshes by p in them, times k_mean, as a sum over modes: the real part, of one of each pair.

    Attributes
    ----------
    poles : (mode,) complex array
        rad/s.
    deflections : (mesh, mode) complex array
    inputs : (mode, mesh) complex array
    """

    poles: ComplexArray
    deflections: ComplexArray
    inputs: ComplexArray

    @property
    def largest(self) -> Array:
        """Largest force in a spring per N of p, (mode,)."""
        sizes = np.max(np.abs(self.deflections), axis=0) * np.max(np.abs(self.inputs), axis=1)
        with np.errstate(divide="ignore"):
            return np.asarray(sizes / (2 * np.abs(self.poles.real)))

    @property
    def highest_hz(self) -> float:
        """Frequency of the highest mode that the stiffness brings into play."""
        return float(np.max(np.abs(self.poles[self.largest > 1]), initial=0.0)) / (2 * np.pi)

    def swept(self, right: Singles, varying: Varying, period_s: float) -> Singles:
        """Return about the p (input, mesh, k) of which ``p - varying delta`` is so much, delta their deflections."""
        from scipy.fft import rfft  # noqa: PLC0415

        from data_synth.fidelity._sweep_kernels import sweep  # noqa: PLC0415

        waves = varying.waves_of(right)
        step_s, poles = period_s / waves.shape[-1], self.poles
        with np.errstate(divide="ignore"):
            rings = np.log(self.largest / _PART)  # until little of a mode is left, in its time
        slow = (rings > 0) & (np.abs(poles) * step_s < _FAST)
        at_once = ((self.deflections[:, ~slow] / -poles[~slow]) @ self.inputs[~slow]).real
        poles, outputs, inputs = poles[slow], self.deflections[:, slow], self.inputs[slow]
        turns = np.exp(poles * step_s)
        after = (turns - 1 - poles * step_s) / (poles**2 * step_s)
        before = (turns - 1) / poles - after
        # a wave that is linear between instants is weaker by this factor, which each mode has at its own frequency
        inputs = inputs / np.sinc(poles.imag * step_s / (2 * np.pi))[:, None] ** 2
        with np.errstate(divide="ignore"):
            run_in = min(np.max(rings[slow] / -poles.real, initial=0.0) / step_s, _LONGEST_RUN_IN)
        found = np.empty_like(waves)
        sweep(
            waves,
            varying.waves,
            _real_and_imaginary(turns),
            _real_and_imaginary((inputs * (before + turns * after)[:, None]).T),
            _real_and_imaginary(outputs),
            np.ascontiguousarray(at_once + ((outputs * after) @ inputs).real),
            int(run_in),
            found,
        )
        return np.asarray(rfft(found)[..., 1 : right.shape[-1] + 1], dtype=np.complex64)


def _real_and_imaginary(values: ComplexArray) -> Array:
    """Return real and imaginary part, (..., 2, mode), of values (..., mode)."""
    return np.ascontiguousarray(np.stack([values.real, values.imag], axis=-2))
