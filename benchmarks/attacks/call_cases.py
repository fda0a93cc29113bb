"""A valid call of every function that the packages export, from which `odd_calls` derives its odd ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

import data_synth
import hums
import signals
from attacks.damaged_files import SCENE
from hums import readers
from signals import harmonics, indicators

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

RATE_HZ = 2048
COUNT = 6144
SPEED_HZ = 8.0


@dataclass(frozen=True)
class Case:
    """A valid call: function and arguments, and other arguments that a call may have besides."""

    function: Callable[..., Any]
    arguments: Mapping[str, Any]
    also: Mapping[str, Any] = field(default_factory=dict)


@cache
def waveform() -> NDArray[np.float64]:
    """Return lines, impacts and noise as whole numbers, which every type of 16 bits and more holds exactly."""
    rng = np.random.default_rng(20)
    t = np.arange(COUNT) / RATE_HZ
    x = 900 * np.sin(2 * np.pi * SPEED_HZ * t) + 500 * np.cos(2 * np.pi * 12 * SPEED_HZ * t + 0.3)
    x += 300 * np.cos(2 * np.pi * 13 * SPEED_HZ * t) + 120 * rng.standard_normal(COUNT)
    ring = np.exp(-np.arange(200) / 20) * np.sin(2 * np.pi * 600 * np.arange(200) / RATE_HZ)
    x += 1500 * np.convolve(np.arange(COUNT) % 87 == 0, ring)[:COUNT]
    return np.asarray(np.round(x), dtype=np.float64)


@cache
def tachometer() -> NDArray[np.float64]:
    """Return the sampled signal of a tachometer of one pulse a revolution, in whole numbers."""
    return np.asarray(np.round(1000 * np.sin(2 * np.pi * SPEED_HZ * (np.arange(COUNT) / RATE_HZ - 0.013))))


@cache
def phase() -> signals.ShaftPhase:
    """Return the angle of a shaft through pulses at times that float32 holds exactly."""
    return signals.shaft_phase(np.arange(26) / SPEED_HZ)


@cache
def angular() -> signals.AngularSignal:
    """Return the record over angle."""
    return signals.angular_resample(waveform(), rate_hz=RATE_HZ, phase=phase(), samples_per_rev=72)


@cache
def _parts() -> dict[str, Any]:
    average = signals.synchronous_average(angular())
    residual = signals.residual_signal(average, teeth=12, harmonics=2, shaft_orders=(1, 2))
    difference = signals.difference_signal(average, teeth=12, harmonics=2, shaft_orders=(1, 2))
    return {
        "average": average,
        "residual": residual,
        "difference": difference,
        "regular": signals.regular_signal(average, left=difference),
        "band": signals.mesh_band(average, mesh_order=12, sidebands=4),
        "spectrum": signals.order_spectrum(angular()),
        "history": signals.VarianceHistory().update(residual),
    }


def signal_cases() -> Iterator[Case]:
    """Yield the functions of a waveform."""
    x, rate, p = waveform(), {"rate_hz": RATE_HZ}, phase()
    blocks = tuple(np.split(x, 4))
    band = {"band_hz": (400.0, 800.0)}
    yield Case(
        signals.amplitude_spectrum,
        {"values": x, "rate": RATE_HZ},
        {"window": "hann", "padding": 2, "maximum": 500.0, "start": 1.0},
    )
    yield Case(
        signals.averaged_spectrum,
        {"values": x, "rate": RATE_HZ, "segment": 512},
        {"overlap": 0.5, "window": "hann", "scaling": "peak", "confidence": 0.9, "maximum": 500.0},
    )
    yield Case(
        signals.angular_resample,
        {"x": x, **rate, "phase": p, "samples_per_rev": 64},
        {"start_s": 0.5, "revolutions": 4, "method": "sinc", "missing": "mark"},
    )
    yield Case(
        signals.angular_blocks,
        {"blocks": blocks, **rate, "phase": p, "samples_per_rev": 64},
        {"start_s": 0.5, "method": "sinc", "missing": "mark", "block_size": 1000},
    )
    yield Case(signals.cepstrum_prewhitening, {"x": x})
    yield Case(signals.choose_band, {"x": x, **rate}, {"levels": 3, "modulation_hz": 30.0, "measure": "kurtosis"})
    yield Case(signals.discrete_random_separation, {"x": x, "window_length": 256, "delay": 512})
    for integrate, to in ((signals.velocity, "mm s-1"), (signals.displacement, "um")):
        yield Case(integrate, {"x": x, **rate, "units": "g"}, {"to": to, "band_hz": (10.0, 500.0), "taper": 0.25})
    yield Case(
        signals.envelope_order_spectrum,
        {"x": x, **rate, **band, "phase": p, "samples_per_rev": 64},
        {"start_s": 0.1, "max_order": 20.0, "squared": True, "relative": True},
    )
    yield Case(
        signals.envelope_spectrum, {"x": x, **rate, **band}, {"squared": True, "relative": True, "maximum_hz": 100.0}
    )
    yield Case(signals.stream_envelope, {"blocks": blocks, **rate, **band}, {"transition_hz": 50.0})
    yield Case(
        signals.estimate_speed,
        {"x": x, **rate, "orders": [1.0, 12.0, 13.0], "speed_range_hz": (6.0, 11.0), "max_acceleration_hz_s": 0.5},
        {"start_s": 1.0},
    )
    yield Case(signals.fast_kurtogram, {"x": x, **rate}, {"levels": 3, "with_negentropy": True})
    yield Case(signals.spectral_kurtosis, {"x": x, **rate, "window_length": 128}, {"window": "hann", "overlap": 0.5})
    yield Case(signals.spectral_correlation, {"x": x, **rate, "max_cyclic_hz": 60.0}, {"window_length": 128})
    yield Case(signals.linear_prediction, {"x": x, "order": 20})
    yield Case(signals.prediction_orders, {"x": x, "most": 30})
    yield Case(
        signals.refine_phase,
        {"x": x, **rate, "phase": p, "orders": [1.0, 12.0], "tolerance": 0.01},
        {"window_rev": 5.0, "start_s": 0.0},
    )
    yield Case(
        signals.refine_declared_speed, {"x": x, **rate, "speed_hz": 8.1, "orders": [1.0, 12.0, 13.0], "tolerance": 0.03}
    )
    yield Case(signals.sensor_health, {"x": x, **rate, "units": "g"})
    angle = 2 * np.pi * SPEED_HZ * np.arange(COUNT) / RATE_HZ
    tracked = {"x": x, "phase_rad": angle, "orders": [1.0, 12.0]}
    yield Case(
        signals.track_orders,
        {**tracked, "bandwidth_hz": 1.0, **rate},
        {
            "poles": 2,
            "estimator": "filter",
            "method": "auto",
            "output_every": 4,
            "rtol": 1e-2,
            "noise_variance": 1e4,
            "initial_std": 1e3,
            "phase_std_rad": 0.01,
        },
    )
    modelled = {"phase_rad": angle, "orders": [1.0, 12.0], "bandwidth_hz": 1.0, **rate, "noise_variance": 1e4}
    yield Case(signals.harmonic_model, modelled, {"poles": 2, "initial_std": 1e3})
    yield Case(
        signals.likely_bandwidth, {**tracked, **rate, "largest_bandwidth_hz": 4.0}, {"poles": 2, "noise_variance": 1e4}
    )
    yield Case(
        harmonics.track_slipping_order,
        {
            "x": x,
            "phase_rad": angle,
            "order": 12.0,
            "largest_slip": 0.01,
            "slip_change_per_rev": 1e-3,
            "bandwidth_orders": 0.1,
            **rate,
        },
        {"harmonics": 2, "estimator": "filter", "output_every": 8, "noise_variance": 1e4, "most_iterations": 20},
    )
    yield Case(harmonics.vold_kalman_filter, {**tracked, "weight": 500.0, "poles": 1, **rate}, {"output_every": 4})
    for indicator in (indicators.rms, indicators.peak, indicators.crest_factor, indicators.kurtosis):
        yield Case(indicator, {"x": x})
    yield Case(indicators.teager_energy, {"x": x})


def tachometer_cases() -> Iterator[Case]:
    """Yield the functions of tachometers and shafts."""
    wave, rate = tachometer(), {"rate_hz": RATE_HZ}
    yield Case(
        signals.pulse_times,
        {"waveform": wave, **rate},
        {"start_s": 1.0, "edge": "falling"},
    )
    yield Case(signals.quadrature_direction, {"first": wave, "second": np.roll(wave, 64), **rate}, {"start_s": 1.0})
    yield Case(
        signals.shaft_phase,
        {"times_s": np.arange(60) / SPEED_HZ},
        {
            "pulses_per_rev": 2,
            "direction": -1,
            "delay_s": 0.01,
        },
    )
    yield Case(signals.constant_speed, {"speed_hz": 8.0, "start_s": 0.0, "stop_s": 3.0})
    yield Case(signals.comb_gain, {"orders": np.array([0.5, 1.25, 3.0]), "revolutions": 10})
    yield Case(signals.hunting_period, {"teeth": 21, "mate_teeth": 86})
    yield Case(signals.quietest_revolutions, {"orders": [Fraction(21, 86), 3.6], "most": 100})
    law = {"orders": [3.0], "rate": 1000.0, "poles": 2, "noise_variance": 1.0}
    yield Case(harmonics.isolated_std, {**law, "bandwidth": 2.0}, {"estimator": "filter"})
    yield Case(harmonics.process_variance, {**law, "bandwidth": 2.0})


def angle_cases() -> Iterator[Case]:
    """Yield the functions of a record over angle and of synchronous averages."""
    signal, parts = angular(), _parts()
    yield Case(
        signals.averaged_order_spectrum,
        {"signal": signal, "revolutions": 4},
        {"overlap": 0.5, "window": "hann", "scaling": "peak", "confidence": 0.9, "max_order": 20.0},
    )
    yield Case(
        signals.map_orders,
        {"signal": signal, "revolutions": 4},
        {"overlap": 0.5, "window": "hann", "scaling": "peak", "max_order": 20.0, "phase": phase()},
    )
    yield Case(signals.order_spectrum, {"signal": signal}, {"window": "hann", "padding": 2, "max_order": 20.0})
    yield Case(
        signals.time_resample,
        {"signal": signal, "phase": phase(), "rate_hz": 1000.0},
        {"start_s": 0.5, "method": "sinc", "missing": "mark"},
    )
    yield Case(
        signals.synchronous_average,
        {"signal": signal},
        {"ratio": Fraction(2, 3), "revolutions": 6, "samples_per_rev": 72, "datum_rev": 0.25},
    )
    teeth = signals.PlanetaryTeeth(ring=12, planet=3, sun=6, planets=3)
    rev = np.arange(30 * 72) / 72
    passing = np.sqrt(1 + np.cos(2 * np.pi * 3 * (rev - 0.1))) * np.random.default_rng(1).standard_normal(rev.size)
    carrier = signals.AngularSignal(values=passing, samples_per_rev=72, start_rev=0.0, passband_orders=30.0)
    yield Case(signals.pass_angle, {"signal": carrier, "teeth": teeth})
    window = {"window": signals.PassWindow.hann(8), "first_pass_rev": 0.25}
    yield Case(signals.planet_average, {"signal": signal, "teeth": teeth, "planet": 0, **window})
    yield Case(signals.sun_average, {"signal": signal, "teeth": teeth, **window})
    average = {"average": parts["average"]}
    combs = {"teeth": 12, "harmonics": 2, "shaft_orders": (1, 2)}
    yield Case(signals.residual_signal, {**average, **combs}, {"max_order": 30})
    yield Case(signals.difference_signal, {**average, **combs}, {"max_order": 30, "sidebands": 2})
    yield Case(signals.regular_signal, {**average, "left": parts["difference"]})
    yield Case(signals.mesh_band, {**average, "mesh_order": 12, "sidebands": 4})
    yield Case(
        signals.find_line,
        {"spectrum": parts["spectrum"], "expected": 12.0},
        {"tolerance": 0.01, "background_width": 1.0, "closer": 0.5},
    )
    correlation = signals.spectral_correlation(waveform(), rate_hz=RATE_HZ, max_cyclic_hz=60.0)
    yield Case(signals.enhanced_envelope_spectrum, {"correlation": correlation})
    yield Case(signals.improved_envelope_spectrum, {"correlation": correlation, "band_hz": (400.0, 800.0)})
    angle = 2 * np.pi * SPEED_HZ * np.arange(COUNT) / RATE_HZ
    tracks = signals.track_orders(waveform(), phase_rad=angle, orders=[1.0, 12.0], bandwidth_hz=1.0, rate_hz=RATE_HZ)
    yield Case(harmonics.order_waveform, {"tracks": tracks, "phase_rad": angle}, {"places": [0]})
    yield Case(harmonics.residual_record, {"x": waveform(), "tracks": tracks, "phase_rad": angle}, {"places": [0]})
    for name in ("amplitude_modulation", "amplitude_modulation_kurtosis", "frequency_modulation", "phase_modulation",
                 "frequency_modulation_kurtosis", "narrowband_kurtosis"):  # fmt: skip
        yield Case(getattr(indicators, name), {"band": parts["band"]})
    for name in ("fm4", "m6a", "m8a"):
        yield Case(getattr(indicators, name), {"difference": parts["difference"]})
    yield Case(indicators.energy_ratio, {"difference": parts["difference"], "regular": parts["regular"]})
    yield Case(indicators.energy_operator, {"residual": parts["residual"]})
    yield Case(indicators.na4, {"residual": parts["residual"], "history": parts["history"]})
    history = signals.VarianceHistory().update(parts["band"])
    yield Case(indicators.nb4, {"band": parts["band"], "history": history})
    for name in ("so1", "so2", "so3"):
        yield Case(getattr(indicators, name), average)
    yield Case(indicators.shaft_order, {**average, "order": 1})
    for name in ("sideband_index", "sideband_level_factor"):
        yield Case(getattr(indicators, name), {**average, "teeth": 12})
    yield Case(indicators.fm0, {**average, "teeth": 12, "harmonics": 2})
    ring = {"ring_teeth": 12, "planets": 3, "harmonic": 1, "sidebands": 3}
    for name in ("carrier_sidebands", "carrier_sideband_ratio"):
        yield Case(getattr(indicators, name), {**average, **ring})
    yield Case(
        indicators.defect_energy,
        {"spectrum": parts["spectrum"], "order": 12.0, "harmonics": 2, "tolerance": 0.01, "background_width": 1.0},
    )


def labelled_cases(folder: Path) -> Iterator[Case]:  # noqa: PLR0915 - a list of calls
    """Yield the functions of gearboxes, records and scenes; files go to `folder`."""
    box = hums.load_gearbox("two-stage")
    kinematics = hums.solve_kinematics(box)
    table = hums.defect_orders(box)
    rng = np.random.default_rng(20)
    record = hums.make_record(
        {"housing": rng.normal(size=8000)},
        rate_hz=4000,
        units="g",
        angle=hums.NominalSpeed(rpm=1200, shaft="input"),
    )
    scene_file = folder / "scene.toml"
    scene_file.write_text(SCENE, encoding="utf-8")
    plan_file = folder / "plan.toml"
    table_of_scene = SCENE.replace("gearbox", "[scene]\ngearbox", 1)
    plan_file.write_text(f'records = 1\nseed = 1\nclass = [{{ name = "healthy" }}]\n{table_of_scene}', encoding="utf-8")
    hums.save_record(record, folder / "record.h5")
    text = "time,vib\n" + "\n".join(f"{n / 100},{n % 7}" for n in range(200))
    (folder / "log.csv").write_text(text, encoding="utf-8")
    data_synth.make_dataset(plan_file, folder / "dataset")
    scene = data_synth.load_scene(scene_file)
    simulated = data_synth.simulate(scene, seed=1)
    analysis = hums.analyze(simulated, box)
    hums.save_analysis(analysis, folder / "analysis.h5")
    yield Case(
        hums.analyze,
        {"record": record, "gearbox": box},
        {"settings": hums.AnalysisSettings(envelope_band_hz=None), "baseline": analysis},
    )
    yield Case(
        hums.analyze_fleet,
        {"sources": [str(folder / "record.h5")], "gearbox": box, "folder": str(folder / "fleet")},
        {"settings": hums.AnalysisSettings(most_tracks=0), "workers": hums.Serial()},
    )
    volts = hums.Channel(values=waveform(), units="V", sensitivity=0.1, measures="g")
    uncalibrated = hums.make_record({"housing": volts}, rate_hz=2048.0, angle=hums.UnknownAngle())
    yield Case(hums.calibrated, {"record": uncalibrated})
    yield Case(hums.collisions, {"table": table, "revolutions": 100.0})
    yield Case(
        hums.convert,
        {
            "source": str(folder / "log.csv"),
            "channels": ["vib"],
            "units": "g",
            "rate_hz": 100.0,
            "shaft": "input",
            "shaft_rpm": 600.0,
        },
        {"scale": 2.0, "machine": "a", "recorded_at": "2020-01-01T00:00:00Z"},
    )
    yield Case(hums.dataset_record, {"folder": str(folder / "dataset"), "number": 0})
    yield Case(
        hums.defect_orders,
        {"gearbox": box},
        {"reference": "input", "speeds": {"input": 10.0}},
    )
    yield Case(hums.join_snapshots, {"records": [record, record]})
    snapshots = hums.join_snapshots([record, record])
    yield Case(hums.snapshot_record, {"record": snapshots, "number": 1})
    yield Case(hums.derive_verdicts, {"analysis": analysis})
    tables = (
        hums.findings_table,
        hums.health_table,
        hums.indicator_table,
        hums.track_table,
        hums.unexplained_table,
        hums.verdict_table,
    )
    for tabulate in (*tables, hums.summary):
        yield Case(tabulate, {"analysis": analysis})
    yield Case(hums.line_table, {"analysis": analysis, "name": "order_spectrum"})
    levels = [[0, 1, 2], [1, 0, 0], [2, 0, 0]]
    adjacency = np.array([[0, 0, 0], [0, 0, 20], [0, 40, 0]])
    yield Case(
        hums.from_adjacency_table,
        {"T": adjacency, "levels": levels, "frame": 0},
        {"names": ["a", "b", "c"], "reference": 1, "name": "pair"},
    )
    yield Case(hums.load_gearbox, {"name_or_path": "two-stage"})
    short = record.isel(time=slice(400))
    yield Case(hums.join_snapshots, {"records": [short, short]})
    yield Case(hums.snapshot_record, {"record": hums.join_snapshots([short, short]), "number": 1})
    yield Case(
        hums.make_record,
        {"channels": {"housing": waveform()}, "rate_hz": 2048.0, "units": "g", "angle": hums.UnknownAngle()},
        {"machine": "a", "recorded_at": "2020-01-01T00:00:00Z", "start_s": 1.0, "attrs": {"note": "b"}},
    )
    yield from part_cases()
    yield Case(hums.open_analysis, {"path": str(folder / "analysis.h5")})
    yield Case(hums.open_dataset, {"folder": str(folder / "dataset")})
    yield Case(hums.open_record, {"path": str(folder / "record.h5")})
    yield Case(hums.order_families, {"table": table, "harmonics": 2, "sidebands": 1})
    yield Case(hums.save_analysis, {"analysis": analysis, "path": str(folder / "copy.h5")})
    yield Case(hums.save_record, {"record": record, "path": str(folder / "copy.h5")})
    yield Case(hums.score, {"analysis": analysis, "record": simulated})
    yield Case(hums.solve_kinematics, {"gearbox": box}, {"fixed": ["input"]})
    yield Case(
        hums.solve_torques,
        {"kinematics": kinematics, "torques": {"input": 10.0, "output": None}},
        {"speeds": {"input": 10.0}, "mesh_efficiency": 0.98},
    )
    work_file = folder / "work.csv"
    work_file.write_text("date,component\n2026-03-01,input bearing\n", encoding="utf-8")
    yield Case(hums.read_maintenance, {"path": str(work_file)})
    yield Case(readers.read_file, {"path": str(folder / "log.csv")}, {"most_bytes": 10_000})
    yield Case(
        hums.watch,
        {"analysis": analysis, "state": str(folder / "mill.state")},
        {"settings": hums.MonitorSettings(), "work": hums.read_maintenance(work_file)},
    )
    yield Case(hums.write_report, {"analysis": analysis, "folder": str(folder / "report")})
    yield Case(data_synth.explain, {"scene": scene})
    yield Case(data_synth.load_plan, {"name_or_path": str(plan_file)})
    yield Case(data_synth.load_scene, {"name_or_path": str(scene_file)})
    yield Case(
        data_synth.make_dataset, {"plan": str(plan_file), "folder": str(folder / "other")}, {"workers": hums.Serial()}
    )
    yield Case(data_synth.simulate, {"scene": scene, "seed": 1}, {"by_source": True})


def part_cases() -> Iterator[Case]:
    """Yield the classes of which records are made: what they take is checked when a record is made of them."""
    x = waveform()[:1000]

    def channel(**given: Any) -> object:  # noqa: ANN401
        return hums.make_record({"a": hums.Channel(**given)}, rate_hz=1000.0, angle=hums.UnknownAngle())

    def angle_of(kind: Callable[..., Any]) -> Callable[..., object]:
        return lambda **given: hums.make_record({"a": x}, rate_hz=1000.0, units="g", angle=kind(**given))

    yield Case(
        _called(channel, "Channel"),
        {"values": x, "units": "V"},
        {
            "rate_hz": 500.0,
            "sensitivity": 0.1,
            "measures": "g",
            "calibration_factor": 1.1,
            "delay_s": 1e-3,
            "sensor": "S 1",
            "direction": [1.0, 0.0, 0.0],
        },
    )
    yield Case(
        _called(angle_of(hums.PulseTimes), "PulseTimes"),
        {"times_s": np.arange(9) / SPEED_HZ, "shaft": "input", "pulses_per_rev": 1},
        {"name": "encoder"},
    )
    yield Case(
        _called(angle_of(hums.TachometerWaveform), "TachometerWaveform"),
        {"values": tachometer()[:1000], "shaft": "input", "pulses_per_rev": 1},
        {"units": "V", "name": "encoder", "rate_hz": 1000.0, "full_scale": 10.0},
    )
    yield Case(_called(angle_of(hums.NominalSpeed), "NominalSpeed"), {"rpm": 600.0, "shaft": "in"})


def _called(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a function under the name of a class of `hums.records`."""
    function.__name__, function.__module__ = name, "hums.records.record"
    return function


def all_cases(folder: Path) -> list[Case]:
    """Return a valid call of every exported function."""
    return [*signal_cases(), *tachometer_cases(), *angle_cases(), *labelled_cases(folder)]


def exported() -> set[Callable[..., Any]]:
    """Return the functions that the packages export."""
    packages = (signals, harmonics, indicators, hums, readers, data_synth)
    things = (getattr(package, name) for package in packages for name in package.__all__)
    return {thing for thing in things if callable(thing) and not isinstance(thing, type)}
