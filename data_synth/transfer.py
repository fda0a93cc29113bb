"""Transfer paths from force to accelerometer, modal or measured.

The response through a modal path follows from its poles (`data_synth.sensors.path_residues`). A measured path becomes
a causal FIR filter of the length it needs, with the least delay it allows, and works block after block in constant
memory.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.profile import Array

ComplexArray = NDArray[np.complex128]

_DECAYED = 1e-12  # of its initial amplitude


def _finite(values: ArrayLike) -> Array:
    """Return values as an array; raise ValueError for NaN or infinity, whose response would never end."""
    given = np.asarray(values, dtype=np.float64)
    if not np.all(np.isfinite(given)):
        raise ValueError("a force or an instant is NaN or infinite, which a path would never forget; mend it before")
    return given


@dataclass(frozen=True, kw_only=True)
class ModalPath:
    """A sum of damped modes: ``H(w) = sum_r A_r / (j w - p_r) + conj(A_r) / (j w - conj(p_r))``.

    ``p = -zeta w_n + j w_n sqrt(1 - zeta^2)``. The response to an impulse of 1 N s is ``2 Re sum_r A_r exp(p_r t)``.

    Attributes
    ----------
    frequencies_hz : (r,) array
        Undamped natural frequencies.
    damping_ratios : (r,) array
        Between 0 and 1.
    residues : (r,) complex array
        A_r, in response per N s. For a displacement they are ``-j phi_i phi_j / (2 m w_d)``.
    """

    frequencies_hz: Array = field(metadata={"dims": ("mode",), "units": "Hz"})
    damping_ratios: Array = field(metadata={"dims": ("mode",), "units": "1"})
    residues: ComplexArray = field(metadata={"dims": ("mode",), "units": "response N-1 s-1"})

    def __post_init__(self) -> None:
        shapes = {np.shape(part) for part in (self.frequencies_hz, self.damping_ratios, self.residues)}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            raise ValueError(f"frequencies, damping ratios and residues have shapes {sorted(shapes)}; give one of each")
        if not np.all(np.asarray(self.frequencies_hz) > 0):
            raise ValueError("frequencies_hz has to be above zero throughout")
        damped = np.asarray(self.damping_ratios)
        if not np.all((damped > 0) & (damped < 1)):
            raise ValueError("damping_ratios have to lie between 0 and 1: without damping a path never forgets")

    @property
    def poles(self) -> ComplexArray:
        """The poles p_r in rad s-1, (r,)."""
        natural, zeta = 2 * np.pi * np.asarray(self.frequencies_hz), np.asarray(self.damping_ratios)
        return natural * (-zeta + 1j * np.sqrt(1 - zeta**2))

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return H at `frequency_hz`, of any shape."""
        return self.at(2j * np.pi * np.asarray(frequency_hz, dtype=np.float64))

    def at(self, s: ArrayLike) -> ComplexArray:
        """Return H at `s` in rad s-1, of any shape."""
        at = np.asarray(s, dtype=np.complex128)[..., None]
        parts = self.residues / (at - self.poles) + np.conj(self.residues) / (at - np.conj(self.poles))
        return np.asarray(np.sum(parts, axis=-1))

    def impulse(self, times_s: ArrayLike) -> Array:
        """Return the response (n,) to 1 N s at time zero; nothing before."""
        times = np.asarray(times_s, dtype=np.float64)
        response = np.exp(np.multiply.outer(np.maximum(times, 0.0), self.poles)) @ np.asarray(self.residues)
        return np.where(times >= 0, 2 * response.real, 0.0)

    def ringing_time_s(self) -> float:
        """Return the time after which an impulse response has decayed to 1e-12."""
        return float(math.log(_DECAYED) / np.max(self.poles.real))


@dataclass(frozen=True, kw_only=True)
class MeasuredPath:
    """A measured frequency response: linear between its lines, in real and imaginary part, and zero outside them.

    Attributes
    ----------
    frequencies_hz : (n,) array
        Rising, not negative. A phase that changes by more than a radian from line to line is too coarse to interpolate.
    values : (n,) complex array
        Response per force.
    """

    frequencies_hz: Array = field(metadata={"dims": ("frequency",), "units": "Hz"})
    values: ComplexArray = field(metadata={"dims": ("frequency",), "units": "response N-1"})

    def __post_init__(self) -> None:
        frequencies, values = np.asarray(self.frequencies_hz), np.asarray(self.values)
        if frequencies.ndim != 1 or frequencies.shape != values.shape or frequencies.size < 2:  # noqa: PLR2004
            raise ValueError(
                f"frequencies and values have shapes {frequencies.shape} and {values.shape}; give two alike"
            )
        if not np.all(np.isfinite(frequencies)) or not np.all(np.isfinite(values)):
            raise ValueError("frequencies_hz or values holds NaN or infinity; cut or mend those lines")
        if frequencies[0] < 0 or np.any(np.diff(frequencies) <= 0):
            raise ValueError("frequencies_hz has to rise from 0 or above; sort the lines")

    def ringing_time_s(self) -> float:
        """Return the length of the impulse response of a piecewise-linear spectrum: one over its line spacing."""
        return float(1 / np.min(np.diff(self.frequencies_hz)))

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return H at `frequency_hz`, of any shape."""
        at = np.asarray(frequency_hz, dtype=np.float64)
        real, imaginary = (
            np.interp(at, self.frequencies_hz, part, left=0.0, right=0.0)
            for part in (np.real(self.values), np.imag(self.values))
        )
        return np.asarray(real + 1j * imaginary)

    def fir(self, *, rate_hz: float, taps: int, leakage: float = 1e-3) -> "FirPath":
        """Return the path as a causal FIR filter at `rate_hz`.

        The impulse response is the inverse transform of H; its part before time zero, which exists because H ends at
        half the rate or at its last line, is kept by a delay: the fewest samples that leave out no more than `leakage`
        of its RMS. What comes after `taps` is cut off.

        Parameters
        ----------
        rate_hz : float
        taps : int
            Length of the filter.
        leakage : float
            Between 0 and 1.

        Raises
        ------
        ValueError
            A filter too short to hold the response to the same `leakage`: with what it leaves out.
        """
        if taps < 2 or not 0 < leakage < 1:  # noqa: PLR2004
            raise ValueError(f"taps = {taps} and leakage = {leakage:g}: 2 or more, and between 0 and 1, are needed")
        spacing = float(np.min(np.diff(self.frequencies_hz)))
        count = 1 << math.ceil(math.log2(max(4 * taps, 2 * rate_hz / spacing)))
        lines = self.response(np.arange(count // 2 + 1) * rate_hz / count)
        impulse_response = np.fft.irfft(lines, n=count)
        energy = impulse_response**2
        early = np.cumsum(energy[::-1])[: count // 2]  # in the samples before zero, from the last on: -1, -2, ...
        ahead = np.concatenate([[early[-1]], early[-1] - early])  # what a delay of 0, 1, 2, ... leaves out
        total = float(np.sum(energy))
        delay = int(np.argmax(ahead <= leakage**2 * total))
        kept = np.roll(impulse_response, delay)[:taps]
        left = math.sqrt(max(0.0, 1 - float(np.sum(kept**2)) / total)) if total else 0.0
        if left > 2 * leakage:
            raise ValueError(
                f"taps = {taps} leave out {left:.2g} of the response, more than twice leakage = {leakage:g}; "
                "give more taps"
            )
        return FirPath(taps=kept, delay_s=delay / rate_hz, left_out=left)


@dataclass(frozen=True, kw_only=True)
class FirPath:
    """A causal FIR filter that approximates a measured path.

    Attributes
    ----------
    taps : (n,) array
        Impulse response.
    delay_s : float
        Its delay.
    left_out : float
        RMS of the part left out, over that of the whole impulse response.
    """

    taps: Array = field(metadata={"dims": ("tap",), "units": "response N-1"})
    delay_s: float
    left_out: float

    def filter(self) -> "FirFilter":
        """Return the filter, at rest."""
        return FirFilter(self.taps)


class FirFilter:
    """A `FirPath` with its state: overlap-add by FFT."""

    def __init__(self, taps: Array) -> None:
        self._taps = taps
        self._tail = np.zeros(taps.size - 1)

    def push(self, force: ArrayLike) -> Array:
        """Return the response (n,) to the next n samples of the force."""
        from scipy.signal import oaconvolve  # noqa: PLC0415

        samples = _finite(force)
        if not samples.size:
            return np.empty(0)
        response = oaconvolve(samples, self._taps)
        response[: self._tail.size] += self._tail
        self._tail = response[samples.size :].copy()
        return np.asarray(response[: samples.size])
