"""Harmonic balance: forces p in meshes whose varying stiffness makes more of them, of the deflections that p makes.

With w the change of stiffness over its mean and G the deflections in stiffnesses per N, ``p - w G p`` is given. A sweep
in time through a period, mode by mode with p linear between instants, has all but a few per cent of p, and again of
what the equations of the lines then leave. The product with w is one of waveforms in angle. Its factor, the deflection,
is smooth where the stiffness jumps. Were the tooth force the factor, of ``1 - k_mean / k``, both would jump, and lines
of a product of jumps converge slowly (Li 1996, J. Opt. Soc. Am. A 13, 1870).
"""

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
_LITTLE = 1e-3  # of p: what teeth pull that hardly part
_FLIGHT = 4  # times shorter steps where teeth part
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

    def finer(self, times: int) -> "Varying":
        """Return the same at so many times more points."""
        from scipy.fft import irfft, rfft  # noqa: PLC0415

        waves = times * irfft(rfft(self.waves), times * self.waves.shape[1])
        return Varying(waves=np.asarray(waves, dtype=np.float32), lines=times * self.lines)

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


@dataclass(frozen=True, kw_only=True)
class Balance:
    """The equations of all lines of p at the multiples of an order, at one speed.

    Attributes
    ----------
    gain : (mesh, mesh, k) array
        Deflection of a mesh per N of p in another, times k_mean, at the frequency of each line.
    varying : Varying
    modes : Modes
        The same response as a sum over modes.
    period_s : float
        Of the first line.
    bound : float
        Of the residual of each input.
    """

    gain: Singles
    varying: Varying
    modes: "Modes"
    period_s: float
    bound: float

    @classmethod
    def at(
        cls,
        speed_hz: float,
        *,
        base: Fraction,
        gains: ComplexArray,
        step_hz: float,
        varying: Varying,
        modes: "Modes",
        bound: float,
    ) -> "Balance":
        """Return the equations at a speed of the reference, from gains (mesh, mesh, f), so many Hz from each other."""
        place = float(base) * speed_hz / step_hz * np.arange(1, varying.lines.shape[1] + 1)
        gain = between(gains, place).astype(np.complex64)
        return cls(gain=gain, varying=varying, modes=modes, period_s=1 / (float(base) * speed_hz), bound=bound)

    def deflections(self, forces: Singles) -> Singles:
        """Return the deflections times k_mean, (input, mesh, k), by p."""
        total = self.gain[:, 0] * forces[:, None, 0]
        for mesh in range(1, forces.shape[1]):  # in place of einsum, whose loop over lines is three times as slow
            total += self.gain[:, mesh] * forces[:, None, mesh]
        return np.asarray(total)

    def solved(self, excitation: Singles, start: Singles) -> Singles:
        """Return p (input, mesh, k), from what it is without the deflections that it makes, and a first guess."""

        def missing(forces: Singles) -> Singles:
            return np.asarray(excitation - forces + self.varying.times(self.deflections(forces)))

        found, left, known = start, np.full(excitation.shape[0], np.inf), missing(start)
        with np.errstate(over="ignore", invalid="ignore"):  # where the stiffness excites vibration that grows
            for _ in range(_MOST_SWEEPS):
                size = np.linalg.norm(real_rows(known), axis=1)
                if not np.any(size < _NO_USE * left):
                    break
                found, left = start, size
                if np.all(left <= self.bound):
                    break
                start = found + self.modes.swept(known, self.varying, self.period_s)
                known = missing(start)
        return found

    def parted(
        self, excitation: Singles, forces: Singles, static_n: Array, *, may_part: NDArray[np.bool_]
    ) -> Singles | None:
        """Return p (mesh, k) of teeth that part where they would pull; None where they hardly do, or without bound.

        What parting makes of p is the difference of two sweeps, to a few per cent of it.

        Parameters
        ----------
        excitation, forces : (mesh, k) arrays
            p without the deflections that it makes, and of teeth that pull.
        static_n : (mesh,) array
            Mean tooth force.
        may_part : (mesh,) bool array
            Others hold together.
        """
        mean = static_n * 2 / self.varying.waves.shape[1]  # waves are n / 2 times as small
        vibration = self.varying.waves_of(self.deflections(forces[None]) + forces)[0]
        pulled = np.minimum((vibration + mean[:, None]) * np.sign(mean[:, None]), 0) * may_part[:, None]
        # sums of squares: a norm is a product of BLAS, which waits for threads
        if np.sum(pulled**2) <= _LITTLE**2 * np.sum(real_rows(forces[None]) ** 2) * 2 / vibration.shape[1]:
            return None
        # bodies in free flight, where the spring of a mesh is taken away again, need shorter steps
        finer, mean = self.varying.finer(_FLIGHT), mean * may_part / _FLIGHT
        both = np.stack([excitation, excitation])
        held, free = self.modes.swept(both, finer, self.period_s, static=np.stack([0 * mean, mean]))
        found = forces + free - held
        return np.asarray(found) if np.isfinite(found).all() else None


def between(gains: ComplexArray, place: Array) -> ComplexArray:
    """Return gains (..., f) at places (...) from 0 to f - 1: linear between two, and beyond the last what that is."""
    number = np.minimum(place.astype(np.int64), gains.shape[-1] - 2)
    share = np.minimum(place - number, 1.0)
    return np.asarray((1 - share) * gains[..., number] + share * gains[..., number + 1])


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

    def swept(self, right: Singles, varying: Varying, period_s: float, *, static: Array | None = None) -> Singles:
        """Return about the p (input, mesh, k) of which ``p - varying delta`` is so much, delta their deflections.

        Under static tooth forces (input, mesh), n / 2 times as small, teeth part where they are not zero.
        """
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
            np.zeros(waves.shape[:2]) if static is None else static,
            found,
        )
        return np.asarray(rfft(found)[..., 1 : right.shape[-1] + 1], dtype=np.complex64)


def _real_and_imaginary(values: ComplexArray) -> Array:
    """Return real and imaginary part, (..., 2, mode), of values (..., mode)."""
    return np.ascontiguousarray(np.stack([values.real, values.imag], axis=-2))
