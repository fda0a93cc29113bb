"""External disturbances of a record (electrical lines, a neighbouring machine, knocks), and sensor imperfections.

Lines at constant frequencies or multiples of the motor supply do not follow the angle of the reference shaft and have
their own truth variables.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from data_synth.kinematic.harmonics import ComplexArray, add_lines
from data_synth.kinematic.imperfect_parts import imperfections_of, in_units
from data_synth.operation.shaft_angle import Array
from data_synth.scene.imperfections import Electrical, Inverter, NoiseLevel
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError
from data_synth.scene.sensors import Mode, Sensor
from data_synth.sources.prepared import PreparedScene
from data_synth.transfer.acquisition import BLOCK, add_ringing, linear_chain
from data_synth.transfer.paths import AnalogFilter, ringing, ringing_time_s, sensor_gains

_KNOTS = 10  # per time scale of a varying level, whose steps are then 0.4 dB for a standard deviation of 1 dB

_REFERENCE_C = 23.0  # calibration temperature of sensors
_CONVENTION = "x = Re{Z exp(2 pi j f t)}, peak amplitude"


# ---- Sensors ---------------------------------------------------------------------------------------------------------


def gain_drift(scene: Scene, times_s: Array) -> Array:
    """Return the temperature factor (n,) of the sensitivity of all sensors."""
    declared = imperfections_of(scene).temperature
    if declared is None:
        return np.ones_like(times_s)
    return np.asarray(1 + declared.per_k * (_temperature_c(scene, times_s) - _REFERENCE_C))


def _temperature_c(scene: Scene, times_s: Array) -> Array:
    declared = imperfections_of(scene).temperature
    assert declared is not None  # noqa: S101 - the caller has checked
    return np.asarray(declared.celsius + declared.drift_k_per_h / 3600 * times_s)


def sensor_truth(prepared: PreparedScene) -> dict[str, xr.DataArray]:
    """Return the drawn gains and mounts, temperature and noise level of a scene that has them."""
    declared, scene = imperfections_of(prepared.scene), prepared.scene
    truth = dict[str, xr.DataArray]()

    def add(name: str, values: ArrayLike, units: str, dim: str = "truth_channel") -> None:
        truth[f"truth_{name}"] = xr.DataArray(np.array(values), dims=dim, attrs={"units": units})

    if declared.gains is not None:
        add("gain", [sensor.gain if sensor.gain is not None else 1.0 for sensor in scene.sensors], "1")
    if declared.mounts is not None:
        add("mount", [sensor.resonance.frequency_hz if sensor.resonance else np.nan for sensor in scene.sensors], "Hz")
    if declared.temperature is not None:
        add("temperature", _temperature_c(scene, prepared.instants_s), "degC", "truth_time")
    if declared.noise is not None:
        add("noise_level", noise_level(scene, rng_for=prepared.rng_for)(prepared.instants_s), "dB", "truth_time")
    return truth


def noise_level(scene: Scene, *, rng_for: RandomStreams) -> Callable[[Array], Array]:
    """Return the noise level in dB relative to the declared one, as a function of times (n,) in s.

    It is a stationary Gauss-Markov process at knots a tenth of its time scale apart, linear between them.
    """
    declared = imperfections_of(scene).noise
    if declared is None:
        return np.zeros_like
    knots_s, levels_db = _wander(declared, scene.duration_s, rng_for("imperfection", "noise level"))
    return lambda times_s: np.interp(times_s, knots_s, levels_db)


def _wander(declared: NoiseLevel, duration_s: float, rng: np.random.Generator) -> tuple[Array, Array]:
    from scipy.signal import lfilter  # noqa: PLC0415

    spacing_s = declared.time_scale_s / _KNOTS
    count = math.ceil(duration_s / spacing_s) + 2
    decay = math.exp(-1 / _KNOTS)
    steps = rng.standard_normal(count)
    steps[1:] *= math.sqrt(1 - decay**2)
    return spacing_s * np.arange(count, dtype=np.float64), np.asarray(
        declared.std_db * lfilter([1.0], [1.0, -decay], steps)
    )


# ---- Lines that do not follow the reference shaft --------------------------------------------------------------------


def add_outside_sources(prepared: PreparedScene, signal: Array) -> dict[str, xr.DataArray]:
    """Add neighbour and knocks to the channels (sensor, n), in place; return their truth variables."""
    return _add_neighbour(prepared, signal) | _add_knocks(prepared, signal)


def _add_neighbour(prepared: PreparedScene, signal: Array) -> dict[str, xr.DataArray]:
    declared, scene = imperfections_of(prepared.scene).neighbour, prepared.scene
    if declared is None:
        return {}
    rng = prepared.rng_for("imperfection", "neighbour")
    orders, sizes = [], []
    for k in range(1, declared.harmonics + 1):
        fall = declared.decay ** (k - 1)
        mesh, side = k * declared.teeth, declared.sideband * declared.mesh_m_s2 * fall
        orders += [k, mesh - 1, mesh, mesh + 1]
        sizes += [declared.shaft_m_s2 * fall, side, declared.mesh_m_s2 * fall, side]
    frequencies_hz = declared.speed_hz * np.array(orders, dtype=np.float64)
    _check_below_nyquist(scene, "neighbour", float(np.max(frequencies_hz)))
    at_source = in_units(scene, 1.0) * np.array(sizes) * np.exp(2j * np.pi * rng.random(len(sizes)))
    gains = _gains(prepared, "neighbour")
    lines = np.stack(
        [gain * at_source * chain.response(frequencies_hz) for gain, chain in zip(gains, prepared.chains, strict=True)]
    )
    series = np.zeros((len(lines), max(orders)), dtype=np.complex128)
    for order, line in zip(orders, lines.T, strict=True):
        series[:, order - 1] += line
    _add_series(signal, series, lambda times_s: declared.speed_hz * times_s, rate_hz=scene.rate_hz)
    mode = Mode(frequency_hz=declared.frequency_hz, damping_ratio=declared.damping_ratio)
    rate_hz, before_s = declared.impacts_per_rev * declared.speed_hz, ringing_time_s(mode)
    first = -before_s + rng.random() / rate_hz
    times_s = np.arange(first, scene.duration_s, 1 / rate_hz)
    _add_impacts(prepared, signal, times_s, np.full(times_s.size, declared.impact_m_s2), gains, mode)
    return {
        "truth_neighbour": _line_truth(prepared, lines, "truth_neighbour_frequency", frequencies_hz),
        "truth_neighbour_impacts": xr.DataArray(
            times_s[times_s >= 0], dims="truth_neighbour_impact", attrs={"units": "s"}
        ),
    }


def _add_knocks(prepared: PreparedScene, signal: Array) -> dict[str, xr.DataArray]:
    declared, scene = imperfections_of(prepared.scene).knocks, prepared.scene
    if declared is None:
        return {}
    rng = prepared.rng_for("imperfection", "knocks")
    times_s = np.sort(scene.duration_s * rng.random(rng.poisson(declared.per_second * scene.duration_s)))
    sizes = declared.mean_m_s2 * rng.exponential(size=times_s.size)
    _add_impacts(prepared, signal, times_s, sizes, _gains(prepared, "knocks"), scene.resonance)
    return {
        "truth_knocks": xr.DataArray(times_s, dims="truth_knock", attrs={"units": "s"}),
        "truth_knock_sizes": xr.DataArray(sizes, dims="truth_knock", attrs={"units": "m s-2"}),
    }


def _add_impacts(
    prepared: PreparedScene, signal: Array, times_s: Array, sizes_m_s2: Array, gains: ComplexArray, mode: Mode
) -> None:
    """Add impacts that excite a mode to all channels."""
    for sensor, chain, gain, values in zip(prepared.scene.sensors, prepared.chains, gains, signal, strict=True):
        poles, residues = ringing(mode).then(chain).residues(sensor.name)
        add_ringing(
            values,
            times_s=times_s - chain.skew_s,
            amplitudes=abs(gain) * in_units(prepared.scene, 1.0) * sizes_m_s2,
            poles=poles,
            residues=residues,
            rate_hz=prepared.scene.rate_hz,
        )


def _gains(prepared: PreparedScene, source: str) -> ComplexArray:
    """Draw the gains (sensor,) of a source outside the machine."""
    words = ("imperfection", source)
    return sensor_gains(
        [source], sensors=len(prepared.scene.sensors), rng_for=lambda *more: prepared.rng_for(*words, *more)
    )[source]


def add_electrical(prepared: PreparedScene, signal: Array) -> dict[str, xr.DataArray]:
    """Add mains and inverter lines picked up in the cables to the channels (sensor, n), in place; return their truth.

    They pass through the anti-aliasing filter of each channel, with its response at their frequency, or at that of the
    mean speed if they vary.

    Raises
    ------
    SceneError
        A line at or above half the sampling rate.
    """
    scene = prepared.scene
    declared = imperfections_of(scene).electrical
    if declared is None:
        return {}
    multiples, shares = _electrical_lines(declared)
    output_hz, output_turns = _output(prepared, declared.inverter)
    frequencies_hz = multiples @ np.array([declared.mains_hz, output_hz(True)])
    highest_hz = multiples @ np.array([declared.mains_hz, output_hz(False)])
    _check_below_nyquist(scene, "electrical", float(np.max(np.abs(highest_hz))))
    lines = np.stack(
        [
            in_units(scene, declared.amplitude_m_s2)
            * _scale(sensor)
            * shares
            * np.exp(2j * np.pi * prepared.rng_for("imperfection", "electrical", sensor.name).random(shares.size))
            * _recorder_filter(sensor, rate_hz=prepared.scene.rate_hz).response(frequencies_hz)
            for sensor in scene.sensors
        ]
    )

    def turns(times_s: Array, *, of: Array) -> Array:
        return np.asarray(of[0] * declared.mains_hz * times_s + of[1] * output_turns(times_s))

    for line, of in zip(lines.T, multiples, strict=True):
        _add_series(signal, line[:, None], partial(turns, of=of), rate_hz=scene.rate_hz)
    truth = _line_truth(prepared, lines, "truth_electrical_line", np.arange(shares.size, dtype=np.float64))
    truth.attrs["convention"] = "x = Re{Z exp(2 pi j (m mains_hz t + n output))}, output its turns at the instants"
    truth.attrs["mains_hz"] = declared.mains_hz
    found = {
        "truth_electrical": truth,
        "truth_electrical_multiples": xr.DataArray(
            multiples, dims=("truth_electrical_line", "truth_electrical_source")
        ).assign_coords(truth_electrical_source=["mains", "output"]),
    }
    if declared.inverter is not None:
        found["truth_electrical_output"] = xr.DataArray(
            output_turns(prepared.instants_s), dims="truth_time", attrs={"units": "rev"}
        )
    return found


def _electrical_lines(declared: Electrical) -> tuple[Array, Array]:
    """Return multiples (line, 2) of mains and output, and each amplitude relative to the first mains harmonic."""
    mains = [(k, 0, declared.decay ** (k - 1)) for k in range(1, declared.harmonics + 1)]
    every = np.array([*mains, *(declared.inverter.lines if declared.inverter is not None else ())], dtype=np.float64)
    return every[:, :2], every[:, 2]


def _output(
    prepared: PreparedScene, inverter: Inverter | None
) -> tuple[Callable[[bool], float], Callable[[Array], Array]]:
    """Return the output frequency of an inverter in Hz, its mean or maximum, and its cycles at times (n,)."""
    if inverter is None:
        return (lambda _mean: 0.0), np.zeros_like
    if (constant_hz := inverter.output_hz) is not None:
        return (lambda _mean: constant_hz), lambda times_s: np.asarray(constant_hz * times_s)
    scene, angle = prepared.scene, prepared.drive.angle
    link = inverter.link or str(scene.gearbox.reference)
    if link not in scene.gearbox.links or scene.ratio(link) == 0:
        raise SceneError(
            f'imperfections.electrical.inverter: link = "{link}" is not a rotating link; name that of the motor.'
        )
    per_rev = inverter.pole_pairs * float(abs(scene.ratio(link))) / (1 - inverter.slip)
    speeds = np.array([angle.top_speed_hz(0.0, scene.duration_s), float(np.mean(prepared.speed_hz))])
    return (lambda mean: per_rev * float(speeds[int(mean)])), lambda times_s: per_rev * angle.revolutions(times_s)


def _recorder_filter(sensor: Sensor, *, rate_hz: float) -> AnalogFilter:
    """Return the filter that cable pick-up passes through: only the anti-aliasing filter."""
    return linear_chain(
        sensor.changed(resonance=None, gain=None, sensitivity=None, ac_coupling_hz=None), rate_hz=rate_hz
    )


def _scale(sensor: Sensor) -> float:
    return abs(sensor.sensitivity.value) if sensor.sensitivity is not None else 1.0


def _add_series(signal: Array, coefficients: ComplexArray, turns: Callable[[Array], Array], *, rate_hz: float) -> None:
    """Add ``Re sum_k Z_k exp(2 pi j k turns)``, Z (sensor, k), to the channels (sensor, n), in place in blocks."""
    constant = np.repeat(coefficients[:, :, None], 2, axis=2)
    samples = signal.shape[1]
    for start in range(0, samples, BLOCK):
        here = slice(start, min(start + BLOCK, samples))
        times_s = np.arange(here.start, here.stop) / rate_hz
        add_lines(
            signal[:, here],
            constant,
            base_order=Fraction(1),
            revolutions=turns(times_s),
            position=np.arange(here.start, here.stop) / samples,
        )


def _line_truth(prepared: PreparedScene, lines: ComplexArray, dim: str, at: Array) -> xr.DataArray:
    return xr.DataArray(
        lines,
        dims=("truth_channel", dim),
        coords={dim: at},
        attrs={"units": prepared.scene.sensors[0].channel_units, "convention": _CONVENTION},
    )


def _check_below_nyquist(scene: Scene, table: str, highest_hz: float) -> None:
    if highest_hz >= scene.rate_hz / 2:
        raise SceneError(
            f"imperfections.{table} extends to {highest_hz:g} Hz, which is not below half of rate_hz = "
            f"{scene.rate_hz:g}; reduce its harmonics or raise rate_hz."
        )
