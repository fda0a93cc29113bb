"""Transfer from a source to the accelerometer: a mode of the structure, and a gain for each source and sensor.

Shaft and mesh harmonics change slowly, so that the frequency response of the mode applies to them. Impacts are short,
so that the mode responds in time, as ``a exp(-zeta w_n t) sin(w_d t)`` from the exact instant of the impact. That
response is sampled without an anti-aliasing filter; its spectrum falls with the square of frequency, so that aliasing
is about ``2 zeta (f_n / rate) ** 2`` of the peak.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.kinematic.harmonics import HarmonicFamily
from data_synth.operation.shaft_angle import Array
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError
from data_synth.scene.sensors import STANDARD_GRAVITY, Mode, ModeOfPath, Transfer

# ---- Transfer paths from force to accelerometer, modal or measured ---------------------------------------------------
# The response through a modal path follows from its poles (`AnalogFilter.residues`). A measured path becomes a causal
# FIR filter of sufficient length and minimal delay, applied in blocks in constant memory.


ComplexArray = NDArray[np.complex128]

_DECAYED = 1e-12  # of its initial amplitude
_APART = 1e-6  # relative distance below which two poles leave the residues without precision


@dataclass(frozen=True, kw_only=True)
class AnalogFilter:
    """Low-pass filters in series, ``gain prod_i p_i / (p_i - s)``, and high-pass filters, ``prod_j s / (s - q_j)``.

    Attributes
    ----------
    gain : float
        Gain of the low-pass filters at zero frequency.
    poles : (p,) complex array
        Poles p_i in rad s-1, complex ones in pairs.
    coupling : (q,) complex array
        Poles q_j of the high-pass filters in rad s-1, complex ones in pairs.
    skew_s : float
        Time in s by which the channel is sampled later, a factor ``exp(2j pi f skew_s)`` of the frequency response.
    """

    gain: float = 1.0
    poles: ComplexArray = field(
        default_factory=lambda: np.empty(0, np.complex128), metadata={"dims": ("pole",), "units": "rad s-1"}
    )
    coupling: ComplexArray = field(
        default_factory=lambda: np.empty(0, np.complex128), metadata={"dims": ("pole",), "units": "rad s-1"}
    )
    skew_s: float = 0.0

    def then(self, other: "AnalogFilter") -> "AnalogFilter":
        """Return this filter followed by another one."""
        return AnalogFilter(
            gain=self.gain * other.gain,
            poles=np.concatenate([self.poles, other.poles]),
            coupling=np.concatenate([self.coupling, other.coupling]),
            skew_s=self.skew_s + other.skew_s,
        )

    def at(self, s: ArrayLike) -> ComplexArray:
        """Return the transfer function at `s` in rad s-1, of any shape."""
        points = np.asarray(s, dtype=np.complex128)
        passed = np.full(points.shape, self.gain, dtype=np.complex128)
        for pole in self.poles:
            passed = passed * (pole / (pole - points))
        for pole in self.coupling:
            passed = passed * (points / (points - pole))
        return passed

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the frequency response at `frequency_hz`, of any shape."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        return np.asarray(self.at(s) * np.exp(s * self.skew_s))

    @property
    def direct(self) -> float:
        """Direct feedthrough, the gain at infinite frequency."""
        return 0.0 if self.poles.size else self.gain

    def residues(self, sensor: str, *, before: "ModalPath | None" = None) -> tuple[ComplexArray, ComplexArray]:
        """Return the poles (p,) and residues (p,) of the filter, preceded by a modal path `before` if given.

        The impulse response is ``Re sum_p residue exp(pole t)``, with one pole of each conjugate pair and twice its
        residue, plus the direct feedthrough.

        Raises
        ------
        SceneError
            Two nearly equal poles, for which the sum of exponentials loses all precision; `sensor` names the channel.
        """
        ahead = np.empty(0) if before is None else np.concatenate([before.poles, np.conj(before.poles)])
        of_path = np.empty(0) if before is None else np.concatenate([before.residues, np.conj(before.residues)])
        own = np.concatenate([self.poles, self.coupling])
        every = np.concatenate([ahead, own])
        gaps = np.abs(every[:, None] - every) + np.diag(np.full(every.size, np.inf))
        if np.any(gaps < _APART * np.abs(every)):
            near_hz = np.abs(every[np.argmin(np.min(gaps, axis=0))]) / (2 * np.pi)
            raise SceneError(
                f'sensor "{sensor}": two of the modes, filters and mounts on the path to it coincide at {near_hz:.6g} '
                "Hz; change one of them by 0.1 %."
            )
        residues = list(of_path * self.at(ahead))
        for index, pole in enumerate(own):
            poles = np.delete(self.poles, index) if index < self.poles.size else self.poles
            coupling = np.delete(self.coupling, index - self.poles.size) if poles is self.poles else self.coupling
            sign = 1 if poles is self.poles else -1
            residue = sign * pole * replace(self, poles=poles, coupling=coupling).at(pole)
            residues.append(residue if before is None else residue * before.at(pole))
        kept = every.imag >= 0
        return every[kept], np.array(residues, dtype=np.complex128)[kept] * np.where(every[kept].imag > 0, 2, 1)


def mode_filter(mode: Mode) -> AnalogFilter:
    """Return ``1 / (1 - r^2 + 2 j zeta r)``, r = frequency / natural frequency, as a filter."""
    pole = mode_pole(mode)
    return AnalogFilter(poles=np.array([pole, pole.conjugate()]))


def ringing(mode: Mode) -> AnalogFilter:
    """Return the filter whose impulse response is ``exp(-zeta w_n t) sin(w_d t)``."""
    pole = mode_pole(mode)
    return replace(mode_filter(mode), gain=pole.imag / abs(pole) ** 2)


@dataclass(frozen=True, kw_only=True)
class ModalPath:
    """A sum of damped modes: ``H(w) = sum_r A_r / (j w - p_r) + conj(A_r) / (j w - conj(p_r))``.

    ``p = -zeta w_n + j w_n sqrt(1 - zeta^2)``. The response to an impulse of 1 N s is ``2 Re sum_r A_r exp(p_r t)``.

    Attributes
    ----------
    frequencies_hz : (r,) array
        Undamped natural frequencies in Hz.
    damping_ratios : (r,) array
        Damping ratios between 0 and 1.
    residues : (r,) complex array
        A_r in response per N s; for a displacement, ``-j phi_i phi_j / (2 m w_d)``.
    """

    frequencies_hz: Array = field(metadata={"dims": ("mode",), "units": "Hz"})
    damping_ratios: Array = field(metadata={"dims": ("mode",), "units": "1"})
    residues: ComplexArray = field(metadata={"dims": ("mode",), "units": "response N-1 s-1"})

    @property
    def poles(self) -> ComplexArray:
        """Poles p_r in rad s-1, (r,)."""
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

    def ringing_time_s(self) -> float:
        """Return the time in s after which the impulse response has decayed to 1e-12."""
        return float(math.log(_DECAYED) / np.max(self.poles.real))


@dataclass(frozen=True, kw_only=True)
class MeasuredPath:
    """A measured frequency response, linear between its lines in real and imaginary part, and zero outside them.

    Attributes
    ----------
    frequencies_hz : (n,) array
        Frequencies in Hz, rising, not negative; too coarse to interpolate if the phase changes by more than a radian
        between lines.
    values : (n,) complex array
        Response per force.
    """

    frequencies_hz: Array = field(metadata={"dims": ("frequency",), "units": "Hz"})
    values: ComplexArray = field(metadata={"dims": ("frequency",), "units": "response N-1"})

    def ringing_time_s(self) -> float:
        """Return the length in s of the impulse response of a piecewise-linear spectrum, one over its line spacing."""
        return float(1 / np.min(np.diff(self.frequencies_hz)))

    def response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return H at `frequency_hz`, of any shape."""
        at = np.asarray(frequency_hz, dtype=np.float64)
        real, imaginary = (
            np.interp(at, self.frequencies_hz, part, left=0.0, right=0.0)
            for part in (np.real(self.values), np.imag(self.values))
        )
        return np.asarray(real + 1j * imaginary)


class FirFilter:
    """A causal FIR filter that approximates a measured path, with its state (overlap-add by FFT).

    Attributes
    ----------
    taps : (n,) array
        Impulse response.
    delay_s : float
        Its delay in s.
    """

    def __init__(self, taps: Array, *, delay_s: float = 0.0) -> None:
        self.taps, self.delay_s = taps, delay_s
        self._tail = np.zeros(taps.size - 1)

    def push(self, force: Array) -> Array:
        """Return the response (n,) to the next n samples of the force."""
        from scipy.signal import oaconvolve  # noqa: PLC0415

        if not force.size:
            return np.empty(0)
        response = oaconvolve(force, self.taps)
        response[: self._tail.size] += self._tail
        self._tail = response[force.size :].copy()
        return np.asarray(response[: force.size])


TransferPath = ModalPath | MeasuredPath
Path = AnalogFilter | TransferPath


# ---- Paths -----------------------------------------------------------------------------------------------------------


_DECAYED_NEPERS = 30.0  # decay in nepers, to 1e-13 of the amplitude, after which a response has ended


def sensor_gains(sources: list[str], *, sensors: int, rng_for: RandomStreams) -> dict[str, ComplexArray]:
    """Draw the complex gain (sensors,) from each source to each sensor.

    Declared amplitudes are those at the first sensor, whose gain is 1; the other gains are log-uniform between 0.5 and
    2, with a uniform phase. For impacts their magnitude applies.
    """
    gains = {}
    for source in sources:
        octaves, turns = rng_for("gain", source).random((sensors, 2)).T
        gains[source] = np.exp2(2 * octaves - 1) * np.exp(2j * np.pi * turns)
        gains[source][0] = 1.0
    return gains


def line_amplitudes(
    family: HarmonicFamily,
    *,
    gains: ArrayLike,
    speed_hz: Array,
    load: Array,
    path: Path,
) -> ComplexArray:
    """Return Z of a harmonic family at the sensors, (sensor, line, instant), in the units of the sensors.

    Parameters
    ----------
    family : HarmonicFamily
    gains : (sensor,) complex array
    speed_hz, load : (instant,) array
        Speed of the reference shaft in rev s-1, and tooth load relative to full load.
    path : AnalogFilter, ModalPath or MeasuredPath
        Path from the source to the sensors.
    """
    response = path.response(np.outer([float(order) for order in family.orders], speed_hz))
    coefficients = family.coefficients if family.coefficients.ndim > 1 else family.coefficients[:, None]
    at_source = coefficients * response * (load if family.load_dependent else 1.0)
    if family.speed_exponent:
        at_source = at_source * np.abs(speed_hz / family.reference_speed_hz) ** family.speed_exponent
    return np.asarray(np.asarray(gains)[:, None, None] * at_source)


def mode_pole(mode: Mode) -> complex:
    """Return the pole of a mode, ``-zeta w_n + j w_d`` in rad s-1."""
    return 2 * math.pi * mode.frequency_hz * complex(-mode.damping_ratio, math.sqrt(1 - mode.damping_ratio**2))


def ringing_time_s(mode: Mode) -> float:
    """Return the time in s after which the impulse response of a mode has decayed to 1e-13."""
    return _DECAYED_NEPERS / -mode_pole(mode).real


def impact_line(train: ImpactTrain, *, harmonic: ArrayLike, speed_hz: Array, load: Array, path: Path) -> ComplexArray:
    """Return Z (instant,) of a harmonic of a strictly periodic impact train; for harmonics (h, 1), (h, instant).

    It is ``2 a f H(m f) exp(j 2 pi m offset)`` with impacts at rate f through the response H of the path, exact at
    constant speed and load. When f changes at f' per second, the relative error is about ``f' / f`` times the decay
    time ``1 / (zeta w_n)``, plus ``2 pi m f'`` times its square: 1e-4 in a run-up of 1 rev/s per second.
    """
    if train.order is None or not train.amplitudes.any():
        return np.zeros(np.broadcast_shapes(np.shape(harmonic), speed_hz.shape), dtype=np.complex128)
    numbers = np.asarray(harmonic)
    rate = float(train.order) * speed_hz
    turn = np.exp(2j * np.pi * np.remainder(numbers * train.offset, 1.0))
    return np.asarray(2 * train.amplitudes[0] * load * rate * path.response(numbers * rate) * turn)


# ---- Declared transfer paths from sources to sensors, in the units of the sensors ------------------------------------


TransferPaths = dict[tuple[str, str], TransferPath]


def transfer_paths(scene: Scene) -> TransferPaths:
    """Return the declared paths by source and sensor, in the units of the sensors per N."""
    return {(item.source, item.sensor): _transfer_path(item, scene.sensors[0].units) for item in scene.transfers}


def path_of_bearing(scene: Scene, paths: TransferPaths, link: str, sensor: str) -> ModalPath | MeasuredPath | None:
    """Return the declared path to a sensor from a bearing of a link, or of its rigid body; None if there is none."""
    bodies = scene.kinematics.bodies
    for bearing in scene.gearbox.bearings:
        if bodies[link] in [bodies[each] for each in scene.gearbox.ring_links(bearing)]:
            for name in bearing.names:
                if (name, sensor) in paths:
                    return paths[name, sensor]
    return None


def longest_ringing_s(scene: Scene, source: str) -> float:
    """Return the time in s in which the response to an impact at a source decays in every channel."""
    ringing = [path.ringing_time_s() for (of, _), path in transfer_paths(scene).items() if of == source]
    return max([ringing_time_s(scene.resonance), *ringing])


def _transfer_path(transfer: Transfer, units: str) -> TransferPath:
    one = {("m s-2", "g"): 1 / STANDARD_GRAVITY, ("g", "m s-2"): STANDARD_GRAVITY}
    factor = one.get((transfer.units, units), 1.0)
    if transfer.lines is not None:
        hz, real, imaginary = np.array(transfer.lines).T
        return MeasuredPath(frequencies_hz=hz, values=factor * (real + 1j * imaginary))
    modes = transfer.modes or ()
    return ModalPath(
        frequencies_hz=np.array([mode.frequency_hz for mode in modes]),
        damping_ratios=np.array([mode.damping_ratio for mode in modes]),
        residues=factor * np.array([_residue(mode) for mode in modes], dtype=np.complex128),
    )


def _residue(mode: ModeOfPath) -> complex:
    """Return the residue of a mode, or of ``gain w_n^2 / (w_n^2 - w^2 + 2 j zeta w_n w)`` if its gain is declared."""
    if mode.residue is not None:
        return complex(*mode.residue)
    natural = 2 * math.pi * mode.frequency_hz
    return -0.5j * (mode.gain or 0.0) * natural / math.sqrt(1 - mode.damping_ratio**2)
