"""Signal processing on arrays: shaft phase, angular resampling, spectra, envelopes, order trackers.

NumPy in, frozen dataclasses of NumPy out. Nothing here knows of gearboxes, files or plots.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from signals.angle.averaging import CombAdvice as CombAdvice
    from signals.angle.averaging import HuntingPeriod as HuntingPeriod
    from signals.angle.averaging import RunningAverage as RunningAverage
    from signals.angle.averaging import SynchronousAverage as SynchronousAverage
    from signals.angle.averaging import comb_gain as comb_gain
    from signals.angle.averaging import hunting_period as hunting_period
    from signals.angle.averaging import quietest_revolutions as quietest_revolutions
    from signals.angle.averaging import synchronous_average as synchronous_average
    from signals.angle.planets import PassAngle as PassAngle
    from signals.angle.planets import PassWindow as PassWindow
    from signals.angle.planets import PlanetaryTeeth as PlanetaryTeeth
    from signals.angle.planets import WindowedAverage as WindowedAverage
    from signals.angle.planets import pass_angle as pass_angle
    from signals.angle.planets import planet_average as planet_average
    from signals.angle.planets import sun_average as sun_average
    from signals.angle.residual import DifferenceSignal as DifferenceSignal
    from signals.angle.residual import MeshBand as MeshBand
    from signals.angle.residual import RegularSignal as RegularSignal
    from signals.angle.residual import ResidualSignal as ResidualSignal
    from signals.angle.residual import difference_signal as difference_signal
    from signals.angle.residual import mesh_band as mesh_band
    from signals.angle.residual import regular_signal as regular_signal
    from signals.angle.residual import residual_signal as residual_signal
    from signals.demodulation.band_selection import Band as Band
    from signals.demodulation.band_selection import choose_band as choose_band
    from signals.demodulation.envelope import envelope_order_spectrum as envelope_order_spectrum
    from signals.demodulation.envelope import envelope_spectrum as envelope_spectrum
    from signals.demodulation.envelope import stream_envelope as stream_envelope
    from signals.demodulation.kurtogram import Kurtogram as Kurtogram
    from signals.demodulation.kurtogram import SpectralKurtosis as SpectralKurtosis
    from signals.demodulation.kurtogram import fast_kurtogram as fast_kurtogram
    from signals.demodulation.kurtogram import spectral_kurtosis as spectral_kurtosis
    from signals.demodulation.separation import CepstrumPrewhitening as CepstrumPrewhitening
    from signals.demodulation.separation import DiscreteRandomSeparation as DiscreteRandomSeparation
    from signals.demodulation.separation import LinearPrediction as LinearPrediction
    from signals.demodulation.separation import PredictionOrders as PredictionOrders
    from signals.demodulation.separation import SeparatedSignal as SeparatedSignal
    from signals.demodulation.separation import cepstrum_prewhitening as cepstrum_prewhitening
    from signals.demodulation.separation import discrete_random_separation as discrete_random_separation
    from signals.demodulation.separation import linear_prediction as linear_prediction
    from signals.demodulation.separation import prediction_orders as prediction_orders
    from signals.harmonics import OrderTracks as OrderTracks
    from signals.harmonics import harmonic_model as harmonic_model
    from signals.harmonics import track_orders as track_orders
    from signals.harmonics.bandwidth_selection import likely_bandwidth as likely_bandwidth
    from signals.health import SensorHealth as SensorHealth
    from signals.health import sensor_health as sensor_health
    from signals.indicators import INDICATORS as INDICATORS
    from signals.indicators import VarianceHistory as VarianceHistory
    from signals.resampling.angular_stream import AngularStream as AngularStream
    from signals.resampling.angular_stream import angular_blocks as angular_blocks
    from signals.resampling.resampling import AngularSignal as AngularSignal
    from signals.resampling.resampling import TimeSignal as TimeSignal
    from signals.resampling.resampling import angular_resample as angular_resample
    from signals.resampling.resampling import time_resample as time_resample
    from signals.shaft.declared_speed import DeclaredSpeed as DeclaredSpeed
    from signals.shaft.declared_speed import refine_declared_speed as refine_declared_speed
    from signals.shaft.phase import ShaftPhase as ShaftPhase
    from signals.shaft.phase import constant_speed as constant_speed
    from signals.shaft.phase_demodulation import RefinedPhase as RefinedPhase
    from signals.shaft.phase_demodulation import refine_phase as refine_phase
    from signals.shaft.pulse_repair import PulseRepairs as PulseRepairs
    from signals.shaft.pulses import PulseTrain as PulseTrain
    from signals.shaft.pulses import QuadratureEdges as QuadratureEdges
    from signals.shaft.pulses import pulse_times as pulse_times
    from signals.shaft.pulses import quadrature_direction as quadrature_direction
    from signals.shaft.tacholess import SpeedEstimate as SpeedEstimate
    from signals.shaft.tacholess import estimate_speed as estimate_speed
    from signals.shaft.tachometer import shaft_phase as shaft_phase
    from signals.spectra.cyclostationary import CyclicSpectrum as CyclicSpectrum
    from signals.spectra.cyclostationary import SpectralCorrelation as SpectralCorrelation
    from signals.spectra.cyclostationary import enhanced_envelope_spectrum as enhanced_envelope_spectrum
    from signals.spectra.cyclostationary import improved_envelope_spectrum as improved_envelope_spectrum
    from signals.spectra.cyclostationary import spectral_correlation as spectral_correlation
    from signals.spectra.integration import Integrated as Integrated
    from signals.spectra.integration import displacement as displacement
    from signals.spectra.integration import velocity as velocity
    from signals.spectra.lines import Line as Line
    from signals.spectra.lines import find_line as find_line
    from signals.spectra.order_map import OrderMap as OrderMap
    from signals.spectra.order_map import map_orders as map_orders
    from signals.spectra.spectra import AmplitudeSpectrum as AmplitudeSpectrum
    from signals.spectra.spectra import AveragedSpectrum as AveragedSpectrum
    from signals.spectra.spectra import amplitude_spectrum as amplitude_spectrum
    from signals.spectra.spectra import averaged_order_spectrum as averaged_order_spectrum
    from signals.spectra.spectra import averaged_spectrum as averaged_spectrum
    from signals.spectra.spectra import order_spectrum as order_spectrum

_HOME = {
    "AmplitudeSpectrum": "signals.spectra.spectra",
    "AngularSignal": "signals.resampling.resampling",
    "AngularStream": "signals.resampling.angular_stream",
    "AveragedSpectrum": "signals.spectra.spectra",
    "Band": "signals.demodulation.band_selection",
    "CepstrumPrewhitening": "signals.demodulation.separation",
    "CombAdvice": "signals.angle.averaging",
    "CyclicSpectrum": "signals.spectra.cyclostationary",
    "DifferenceSignal": "signals.angle.residual",
    "DiscreteRandomSeparation": "signals.demodulation.separation",
    "HuntingPeriod": "signals.angle.averaging",
    "INDICATORS": "signals.indicators",
    "Integrated": "signals.spectra.integration",
    "Kurtogram": "signals.demodulation.kurtogram",
    "Line": "signals.spectra.lines",
    "LinearPrediction": "signals.demodulation.separation",
    "MeshBand": "signals.angle.residual",
    "OrderMap": "signals.spectra.order_map",
    "OrderTracks": "signals.harmonics",
    "PassAngle": "signals.angle.planets",
    "PassWindow": "signals.angle.planets",
    "PlanetaryTeeth": "signals.angle.planets",
    "PredictionOrders": "signals.demodulation.separation",
    "PulseRepairs": "signals.shaft.pulse_repair",
    "PulseTrain": "signals.shaft.pulses",
    "QuadratureEdges": "signals.shaft.pulses",
    "RefinedPhase": "signals.shaft.phase_demodulation",
    "RegularSignal": "signals.angle.residual",
    "ResidualSignal": "signals.angle.residual",
    "RunningAverage": "signals.angle.averaging",
    "SensorHealth": "signals.health",
    "SeparatedSignal": "signals.demodulation.separation",
    "ShaftPhase": "signals.shaft.phase",
    "SpectralCorrelation": "signals.spectra.cyclostationary",
    "SpectralKurtosis": "signals.demodulation.kurtogram",
    "DeclaredSpeed": "signals.shaft.declared_speed",
    "harmonic_model": "signals.harmonics",
    "refine_declared_speed": "signals.shaft.declared_speed",
    "SpeedEstimate": "signals.shaft.tacholess",
    "SynchronousAverage": "signals.angle.averaging",
    "TimeSignal": "signals.resampling.resampling",
    "VarianceHistory": "signals.indicators",
    "WindowedAverage": "signals.angle.planets",
    "amplitude_spectrum": "signals.spectra.spectra",
    "angular_blocks": "signals.resampling.angular_stream",
    "angular_resample": "signals.resampling.resampling",
    "averaged_order_spectrum": "signals.spectra.spectra",
    "averaged_spectrum": "signals.spectra.spectra",
    "cepstrum_prewhitening": "signals.demodulation.separation",
    "choose_band": "signals.demodulation.band_selection",
    "comb_gain": "signals.angle.averaging",
    "constant_speed": "signals.shaft.phase",
    "difference_signal": "signals.angle.residual",
    "discrete_random_separation": "signals.demodulation.separation",
    "displacement": "signals.spectra.integration",
    "enhanced_envelope_spectrum": "signals.spectra.cyclostationary",
    "envelope_order_spectrum": "signals.demodulation.envelope",
    "envelope_spectrum": "signals.demodulation.envelope",
    "estimate_speed": "signals.shaft.tacholess",
    "fast_kurtogram": "signals.demodulation.kurtogram",
    "find_line": "signals.spectra.lines",
    "hunting_period": "signals.angle.averaging",
    "improved_envelope_spectrum": "signals.spectra.cyclostationary",
    "likely_bandwidth": "signals.harmonics.bandwidth_selection",
    "linear_prediction": "signals.demodulation.separation",
    "map_orders": "signals.spectra.order_map",
    "mesh_band": "signals.angle.residual",
    "order_spectrum": "signals.spectra.spectra",
    "pass_angle": "signals.angle.planets",
    "planet_average": "signals.angle.planets",
    "prediction_orders": "signals.demodulation.separation",
    "pulse_times": "signals.shaft.pulses",
    "quadrature_direction": "signals.shaft.pulses",
    "quietest_revolutions": "signals.angle.averaging",
    "refine_phase": "signals.shaft.phase_demodulation",
    "regular_signal": "signals.angle.residual",
    "residual_signal": "signals.angle.residual",
    "sensor_health": "signals.health",
    "shaft_phase": "signals.shaft.tachometer",
    "spectral_correlation": "signals.spectra.cyclostationary",
    "spectral_kurtosis": "signals.demodulation.kurtogram",
    "stream_envelope": "signals.demodulation.envelope",
    "sun_average": "signals.angle.planets",
    "synchronous_average": "signals.angle.averaging",
    "time_resample": "signals.resampling.resampling",
    "track_orders": "signals.harmonics",
    "velocity": "signals.spectra.integration",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'signals' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
