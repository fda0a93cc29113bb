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
from hums import readers
from signals import harmonics, indicators

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

RATE_HZ = 2048
COUNT = 6144
SPEED_HZ = 8.0
SCENE = """\
gearbox = "two-stage"
rate_hz = 2000
duration_s = 1
fidelity = "kinematic"
speed = { link = "input", rpm = 600 }
tachometer = { link = "input", pulses_per_rev = 1 }
resonance = { frequency_hz = 500, damping_ratio = 0.05 }
sensor = [{ name = "vib", on = "output", units = "g" }]
"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A valid call: function and arguments, and other arguments that a call may have besides."""

    function: Callable[..., Any]
    arguments: Mapping[str, Any]
    also: Mapping[str, Any] = field(default_factory=dict)
    positional: tuple[str, ...] = ()  # of `arguments`, those that have no keyword


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
        function=signals.amplitude_spectrum,
        arguments={"values": x, "rate": RATE_HZ},
        also={"window": "hann", "padding": 2, "maximum": 500.0, "start": 1.0},
    )
    yield Case(
        function=signals.averaged_spectrum,
        arguments={"values": x, "rate": RATE_HZ, "segment": 512},
        also={"overlap": 0.5, "window": "hann", "scaling": "peak", "confidence": 0.9, "maximum": 500.0},
    )
    yield Case(
        function=signals.angular_resample,
        arguments={"x": x, **rate, "phase": p, "samples_per_rev": 64},
        also={"start_s": 0.5, "revolutions": 4, "method": "sinc", "missing": "mark"},
    )
    yield Case(
        function=signals.angular_blocks,
        arguments={"blocks": blocks, **rate, "phase": p, "samples_per_rev": 64},
        also={"start_s": 0.5, "method": "sinc", "missing": "mark", "block_size": 1000},
    )
    yield Case(function=signals.cepstrum_prewhitening, arguments={"x": x})
    yield Case(
        function=signals.choose_band,
        arguments={"x": x, **rate},
        also={"levels": 3, "modulation_hz": 30.0, "measure": "kurtosis"},
    )
    yield Case(function=signals.discrete_random_separation, arguments={"x": x, "window_length": 256, "delay": 512})
    for integrate, to in ((signals.velocity, "mm s-1"), (signals.displacement, "um")):
        yield Case(
            function=integrate,
            arguments={"x": x, **rate, "units": "g"},
            also={"to": to, "band_hz": (10.0, 500.0), "taper": 0.25},
        )
    yield Case(
        function=signals.envelope_order_spectrum,
        arguments={"x": x, **rate, **band, "phase": p, "samples_per_rev": 64},
        also={"start_s": 0.1, "max_order": 20.0, "squared": True, "relative": True},
    )
    yield Case(
        function=signals.envelope_spectrum,
        arguments={"x": x, **rate, **band},
        also={"squared": True, "relative": True, "maximum_hz": 100.0},
    )
    yield Case(
        function=signals.stream_envelope,
        arguments={"blocks": blocks, **rate, **band},
        also={"transition_hz": 50.0},
    )
    yield Case(
        function=signals.estimate_speed,
        arguments={
            "x": x, **rate, "orders": [1.0, 12.0, 13.0], "speed_range_hz": (6.0, 11.0), "max_acceleration_hz_s": 0.5,
        },
        also={"frame_s": 0.5, "start_s": 1.0},
    )  # fmt: skip
    yield Case(function=signals.fast_kurtogram, arguments={"x": x, **rate}, also={"levels": 3, "with_negentropy": True})
    yield Case(
        function=signals.spectral_kurtosis,
        arguments={"x": x, **rate, "window_length": 128},
        also={"window": "hann", "overlap": 0.5},
    )
    yield Case(
        function=signals.spectral_correlation,
        arguments={"x": x, **rate, "max_cyclic_hz": 60.0},
        also={"window_length": 128},
    )
    yield Case(function=signals.linear_prediction, arguments={"x": x, "order": 20})
    yield Case(function=signals.prediction_orders, arguments={"x": x, "most": 30})
    yield Case(
        function=signals.refine_phase,
        arguments={"x": x, **rate, "phase": p, "orders": [1.0, 12.0], "tolerance": 0.01},
        also={"window_rev": 5.0, "start_s": 0.0},
    )
    yield Case(
        function=signals.refine_declared_speed,
        arguments={"x": x, **rate, "speed_hz": 8.1, "orders": [1.0, 12.0, 13.0], "tolerance": 0.03},
    )
    yield Case(function=signals.sensor_health, arguments={"x": x, **rate, "units": "g"})
    angle = 2 * np.pi * SPEED_HZ * np.arange(COUNT) / RATE_HZ
    tracked = {"x": x, "phase_rad": angle, "orders": [1.0, 12.0]}
    yield Case(
        function=signals.track_orders,
        arguments={**tracked, "bandwidth_hz": 1.0, **rate},
        also={
            "poles": 2, "estimator": "filter", "method": "auto", "output_every": 4, "rtol": 1e-2,
            "noise_variance": 1e4, "initial_std": 1e3, "phase_std_rad": 0.01, "innovations": True,
        },
    )  # fmt: skip
    modelled = {"phase_rad": angle, "orders": [1.0, 12.0], "bandwidth_hz": 1.0, **rate, "noise_variance": 1e4}
    yield Case(function=signals.harmonic_model, arguments=modelled, also={"poles": 2, "initial_std": 1e3})
    yield Case(
        function=signals.likely_bandwidth,
        arguments={**tracked, **rate, "largest_bandwidth_hz": 4.0},
        also={"poles": 2, "noise_variance": 1e4},
    )
    yield Case(
        function=harmonics.track_slipping_order,
        arguments={
            "x": x, "phase_rad": angle, "order": 12.0, "largest_slip": 0.01, "slip_change_per_rev": 1e-3,
            "bandwidth_orders": 0.1, **rate,
        },
        also={"harmonics": 2, "estimator": "filter", "output_every": 8, "noise_variance": 1e4, "most_iterations": 20},
    )  # fmt: skip
    yield Case(
        function=harmonics.vold_kalman_filter,
        arguments={**tracked, "weight": 500.0, "poles": 1, **rate},
        also={"output_every": 4},
    )
    for indicator in (indicators.rms, indicators.peak, indicators.crest_factor, indicators.kurtosis):
        yield Case(function=indicator, arguments={"x": x})
    yield Case(function=indicators.teager_energy, arguments={"x": x})


def tachometer_cases() -> Iterator[Case]:
    """Yield the functions of tachometers and shafts."""
    wave, rate = tachometer(), {"rate_hz": RATE_HZ}
    yield Case(
        function=signals.pulse_times,
        arguments={"waveform": wave, **rate},
        also={"start_s": 1.0, "edge": "falling", "min_interval_s": 0.01, "on_gap": "mark"},
    )
    yield Case(
        function=signals.quadrature_direction,
        arguments={"first": wave, "second": np.roll(wave, 64), **rate},
        also={"start_s": 1.0},
    )
    yield Case(
        function=signals.shaft_phase,
        arguments={"times_s": np.arange(60) / SPEED_HZ},
        also={
            "pulses_per_rev": 2, "on_fault": "refuse", "direction": -1, "delay_s": 0.01, "bandwidth_hz": 0.5,
            "bandwidth_orders": 0.1, "standstill_s": 3.0,
        },
    )  # fmt: skip
    yield Case(function=signals.constant_speed, arguments={"speed_hz": 8.0, "start_s": 0.0, "stop_s": 3.0})
    yield Case(function=signals.comb_gain, arguments={"orders": np.array([0.5, 1.25, 3.0]), "revolutions": 10})
    yield Case(function=signals.hunting_period, arguments={"teeth": 21, "mate_teeth": 86})
    yield Case(function=signals.quietest_revolutions, arguments={"orders": [Fraction(21, 86), 3.6], "most": 100})
    law = {"orders": [3.0], "rate": 1000.0, "poles": 2, "noise_variance": 1.0}
    yield Case(function=harmonics.isolated_std, arguments={**law, "bandwidth": 2.0}, also={"estimator": "filter"})
    yield Case(function=harmonics.process_variance, arguments={**law, "bandwidth": 2.0})
    yield Case(function=harmonics.smoother_bandwidth, arguments={**law, "process_variance": 1e-9})


def angle_cases() -> Iterator[Case]:
    """Yield the functions of a record over angle and of synchronous averages."""
    signal, parts = angular(), _parts()
    yield Case(
        function=signals.averaged_order_spectrum,
        arguments={"signal": signal, "revolutions": 4},
        also={"overlap": 0.5, "window": "hann", "scaling": "peak", "confidence": 0.9, "max_order": 20.0},
    )
    yield Case(
        function=signals.map_orders,
        arguments={"signal": signal, "revolutions": 4},
        also={"overlap": 0.5, "window": "hann", "scaling": "peak", "max_order": 20.0, "phase": phase()},
    )
    yield Case(
        function=signals.order_spectrum,
        arguments={"signal": signal},
        also={"window": "hann", "padding": 2, "max_order": 20.0},
    )
    yield Case(
        function=signals.time_resample,
        arguments={"signal": signal, "phase": phase(), "rate_hz": 1000.0},
        also={"start_s": 0.5, "method": "sinc", "missing": "mark"},
    )
    yield Case(
        function=signals.synchronous_average,
        arguments={"signal": signal},
        also={"ratio": Fraction(2, 3), "revolutions": 6, "samples_per_rev": 72, "datum_rev": 0.25},
    )
    teeth = signals.PlanetaryTeeth(ring=12, planet=3, sun=6, planets=3)
    rev = np.arange(30 * 72) / 72
    passing = np.sqrt(1 + np.cos(2 * np.pi * 3 * (rev - 0.1))) * np.random.default_rng(1).standard_normal(rev.size)
    carrier = signals.AngularSignal(values=passing, samples_per_rev=72, start_rev=0.0, passband_orders=30.0)
    yield Case(function=signals.pass_angle, arguments={"signal": carrier, "teeth": teeth})
    window = {"window": signals.PassWindow.hann(8), "first_pass_rev": 0.25}
    yield Case(function=signals.planet_average, arguments={"signal": signal, "teeth": teeth, "planet": 0, **window})
    yield Case(function=signals.sun_average, arguments={"signal": signal, "teeth": teeth, **window})
    average = {"average": parts["average"]}
    combs = {"teeth": 12, "harmonics": 2, "shaft_orders": (1, 2)}
    yield Case(function=signals.residual_signal, arguments={**average, **combs}, also={"max_order": 30})
    yield Case(
        function=signals.difference_signal, arguments={**average, **combs}, also={"max_order": 30, "sidebands": 2}
    )
    yield Case(function=signals.regular_signal, arguments={**average, "left": parts["difference"]})
    yield Case(function=signals.mesh_band, arguments={**average, "mesh_order": 12, "sidebands": 4})
    yield Case(
        function=signals.find_line,
        arguments={"spectrum": parts["spectrum"], "expected": 12.0},
        also={"tolerance": 0.01, "background_width": 1.0, "closer": 0.5},
    )
    correlation = signals.spectral_correlation(waveform(), rate_hz=RATE_HZ, max_cyclic_hz=60.0)
    yield Case(function=signals.enhanced_envelope_spectrum, arguments={"correlation": correlation})
    yield Case(
        function=signals.improved_envelope_spectrum,
        arguments={"correlation": correlation, "band_hz": (400.0, 800.0)},
    )
    angle = 2 * np.pi * SPEED_HZ * np.arange(COUNT) / RATE_HZ
    tracks = signals.track_orders(waveform(), phase_rad=angle, orders=[1.0, 12.0], bandwidth_hz=1.0, rate_hz=RATE_HZ)
    yield Case(
        function=harmonics.order_waveform, arguments={"tracks": tracks, "phase_rad": angle}, also={"places": [0]}
    )
    yield Case(
        function=harmonics.residual_record,
        arguments={"x": waveform(), "tracks": tracks, "phase_rad": angle},
        also={"places": [0]},
    )
    for name in ("amplitude_modulation", "amplitude_modulation_kurtosis", "frequency_modulation", "phase_modulation",
                 "frequency_modulation_kurtosis", "narrowband_kurtosis"):  # fmt: skip
        yield Case(function=getattr(indicators, name), arguments={"band": parts["band"]})
    for name in ("fm4", "m6a", "m8a"):
        yield Case(function=getattr(indicators, name), arguments={"difference": parts["difference"]})
    yield Case(
        function=indicators.energy_ratio,
        arguments={"difference": parts["difference"], "regular": parts["regular"]},
    )
    yield Case(function=indicators.energy_operator, arguments={"residual": parts["residual"]})
    yield Case(function=indicators.na4, arguments={"residual": parts["residual"], "history": parts["history"]})
    history = signals.VarianceHistory().update(parts["band"])
    yield Case(function=indicators.nb4, arguments={"band": parts["band"], "history": history})
    for name in ("so1", "so2", "so3"):
        yield Case(function=getattr(indicators, name), arguments=average)
    yield Case(function=indicators.shaft_order, arguments={**average, "order": 1})
    for name in ("sideband_index", "sideband_level_factor"):
        yield Case(function=getattr(indicators, name), arguments={**average, "teeth": 12})
    yield Case(function=indicators.fm0, arguments={**average, "teeth": 12, "harmonics": 2})
    ring = {"ring_teeth": 12, "planets": 3, "harmonic": 1, "sidebands": 3}
    for name in ("carrier_sidebands", "carrier_sideband_ratio"):
        yield Case(function=getattr(indicators, name), arguments={**average, **ring})
    yield Case(
        function=indicators.defect_energy,
        arguments={
            "spectrum": parts["spectrum"], "order": 12.0, "harmonics": 2, "tolerance": 0.01, "background_width": 1.0,
        },
    )  # fmt: skip


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
        function=hums.analyze,
        arguments={"record": record, "gearbox": box},
        also={"settings": hums.AnalysisSettings(envelope_band_hz=None), "baseline": analysis},
    )
    yield Case(
        function=hums.analyze_fleet,
        arguments={"sources": [str(folder / "record.h5")], "gearbox": box, "folder": str(folder / "fleet")},
        also={"settings": hums.AnalysisSettings(most_tracks=0), "workers": hums.Serial()},
    )
    volts = hums.Channel(values=waveform(), units="V", sensitivity=0.1, measures="g")
    uncalibrated = hums.make_record({"housing": volts}, rate_hz=2048.0, angle=hums.UnknownAngle())
    yield Case(function=hums.calibrated, arguments={"record": uncalibrated})
    yield Case(function=hums.collisions, arguments={"table": table, "revolutions": 100.0})
    yield Case(
        function=hums.convert,
        arguments={"source": str(folder / "log.csv"), "channels": ["vib"], "units": "g", "rate_hz": 100.0,
                   "shaft": "input", "shaft_rpm": 600.0},
        also={"scale": 2.0, "machine": "a", "recorded_at": "2020-01-01T00:00:00Z"},
    )  # fmt: skip
    yield Case(function=hums.dataset_record, arguments={"folder": str(folder / "dataset"), "number": 0})
    yield Case(
        function=hums.defect_orders,
        arguments={"gearbox": box},
        also={"reference": "input", "speeds": {"input": 10.0}, "element_formula": "usual"},
    )
    yield Case(function=hums.join_snapshots, arguments={"records": [record, record]})
    snapshots = hums.join_snapshots([record, record])
    yield Case(function=hums.snapshot_record, arguments={"record": snapshots, "number": 1})
    yield Case(function=hums.derive_verdicts, arguments={"analysis": analysis})
    tables = (hums.findings_table, hums.health_table, hums.indicator_table, hums.unexplained_table, hums.verdict_table)
    for tabulate in (*tables, hums.summary):
        yield Case(function=tabulate, arguments={"analysis": analysis})
    yield Case(function=hums.line_table, arguments={"analysis": analysis, "name": "order_spectrum"})
    levels = [[0, 1, 2], [1, 0, 0], [2, 0, 0]]
    adjacency = np.array([[0, 0, 0], [0, 0, 20], [0, 40, 0]])
    yield Case(
        function=hums.from_adjacency_table,
        arguments={"T": adjacency, "levels": levels, "frame": 0},
        also={"names": ["a", "b", "c"], "reference": 1, "name": "pair"},
    )
    yield Case(function=hums.load_gearbox, arguments={"name_or_path": "two-stage"})
    short = record.isel(time=slice(400))
    yield Case(function=hums.join_snapshots, arguments={"records": [short, short]})
    yield Case(function=hums.snapshot_record, arguments={"record": hums.join_snapshots([short, short]), "number": 1})
    yield Case(
        function=hums.make_record,
        arguments={
            "channels": {"housing": waveform()}, "rate_hz": 2048.0, "units": "g", "angle": hums.UnknownAngle(),
        },
        also={"machine": "a", "recorded_at": "2020-01-01T00:00:00Z", "start_s": 1.0, "attrs": {"note": "b"}},
    )  # fmt: skip
    yield from part_cases()
    yield Case(function=hums.open_analysis, arguments={"path": str(folder / "analysis.h5")})
    yield Case(function=hums.open_dataset, arguments={"folder": str(folder / "dataset")})
    yield Case(function=hums.open_record, arguments={"path": str(folder / "record.h5")})
    yield Case(function=hums.order_families, arguments={"table": table, "harmonics": 2, "sidebands": 1})
    yield Case(function=hums.save_analysis, arguments={"analysis": analysis, "path": str(folder / "copy.h5")})
    yield Case(function=hums.save_record, arguments={"record": record, "path": str(folder / "copy.h5")})
    yield Case(function=hums.score, arguments={"analysis": analysis, "record": simulated})
    yield Case(function=hums.solve_kinematics, arguments={"gearbox": box}, also={"fixed": ["input"]})
    yield Case(
        function=hums.solve_torques,
        arguments={"kinematics": kinematics, "torques": {"input": 10.0, "output": None}},
        also={"speeds": {"input": 10.0}, "mesh_efficiency": 0.98},
    )
    work_file = folder / "work.csv"
    work_file.write_text("date,component\n2026-03-01,input bearing\n", encoding="utf-8")
    yield Case(function=hums.read_maintenance, arguments={"path": str(work_file)})
    yield Case(function=readers.read_file, arguments={"path": str(folder / "log.csv")}, also={"most_bytes": 10_000})
    yield Case(
        function=hums.watch,
        arguments={"analysis": analysis, "state": str(folder / "mill.state")},
        also={"settings": hums.MonitorSettings(), "work": hums.read_maintenance(work_file)},
    )
    yield Case(function=hums.write_report, arguments={"analysis": analysis, "folder": str(folder / "report")})
    yield Case(function=data_synth.explain, arguments={"scene": scene})
    yield Case(function=data_synth.load_plan, arguments={"name_or_path": str(plan_file)})
    yield Case(function=data_synth.load_scene, arguments={"name_or_path": str(scene_file)})
    yield Case(
        function=data_synth.make_dataset,
        arguments={"plan": str(plan_file), "folder": str(folder / "other")},
        also={"workers": hums.Serial()},
    )
    yield Case(function=data_synth.simulate, arguments={"scene": scene, "seed": 1}, also={"by_source": True})


def part_cases() -> Iterator[Case]:
    """Yield the classes of which records are made: what they take is checked when a record is made of them."""
    x = waveform()[:1000]

    def channel(**given: Any) -> object:  # noqa: ANN401
        return hums.make_record({"a": hums.Channel(**given)}, rate_hz=1000.0, angle=hums.UnknownAngle())

    def angle_of(kind: Callable[..., Any]) -> Callable[..., object]:
        return lambda **given: hums.make_record({"a": x}, rate_hz=1000.0, units="g", angle=kind(**given))

    yield Case(
        function=_called(channel, "Channel"),
        arguments={"values": x, "units": "V"},
        also={
            "rate_hz": 500.0, "sensitivity": 0.1, "measures": "g", "calibration_factor": 1.1, "delay_s": 1e-3,
            "sensor": "S 1", "direction": [1.0, 0.0, 0.0],
        },
    )  # fmt: skip
    yield Case(
        function=_called(angle_of(hums.PulseTimes), "PulseTimes"),
        arguments={"times_s": np.arange(9) / SPEED_HZ, "shaft": "input", "pulses_per_rev": 1},
        also={"name": "encoder"},
    )
    yield Case(
        function=_called(angle_of(hums.TachometerWaveform), "TachometerWaveform"),
        arguments={"values": tachometer()[:1000], "shaft": "input", "pulses_per_rev": 1},
        also={"units": "V", "name": "encoder", "rate_hz": 1000.0, "full_scale": 10.0},
    )
    yield Case(function=_called(angle_of(hums.NominalSpeed), "NominalSpeed"), arguments={"rpm": 600.0, "shaft": "in"})


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
