"""Signal processing on arrays: shaft phase, angular resampling, spectra, envelopes, order trackers.

NumPy in, frozen dataclasses of NumPy out. Nothing here knows of gearboxes, files or plots.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from signals.averaging import RunningAverage as RunningAverage
    from signals.averaging import SynchronousAverage as SynchronousAverage
    from signals.averaging import synchronous_average as synchronous_average
    from signals.bands import Band as Band
    from signals.bands import choose_band as choose_band
    from signals.combs import CombAdvice as CombAdvice
    from signals.combs import HuntingPeriod as HuntingPeriod
    from signals.combs import comb_gain as comb_gain
    from signals.combs import hunting_period as hunting_period
    from signals.combs import quietest_revolutions as quietest_revolutions
    from signals.cyclostationary import CyclicSpectrum as CyclicSpectrum
    from signals.cyclostationary import SpectralCorrelation as SpectralCorrelation
    from signals.cyclostationary import enhanced_envelope_spectrum as enhanced_envelope_spectrum
    from signals.cyclostationary import improved_envelope_spectrum as improved_envelope_spectrum
    from signals.cyclostationary import spectral_correlation as spectral_correlation
    from signals.envelope import envelope_order_spectrum as envelope_order_spectrum
    from signals.envelope import envelope_spectrum as envelope_spectrum
    from signals.envelope import stream_envelope as stream_envelope
    from signals.harmonics import OrderTracks as OrderTracks
    from signals.harmonics import track_orders as track_orders
    from signals.harmonics.likelihood import likely_bandwidth as likely_bandwidth
    from signals.health import SensorHealth as SensorHealth
    from signals.health import sensor_health as sensor_health
    from signals.indicators import INDICATORS as INDICATORS
    from signals.indicators import VarianceHistory as VarianceHistory
    from signals.integration import Integrated as Integrated
    from signals.integration import displacement as displacement
    from signals.integration import velocity as velocity
    from signals.kurtogram import Kurtogram as Kurtogram
    from signals.kurtogram import SpectralKurtosis as SpectralKurtosis
    from signals.kurtogram import fast_kurtogram as fast_kurtogram
    from signals.kurtogram import spectral_kurtosis as spectral_kurtosis
    from signals.lines import Line as Line
    from signals.lines import find_line as find_line
    from signals.order_map import OrderMap as OrderMap
    from signals.order_map import map_orders as map_orders
    from signals.phase import ShaftPhase as ShaftPhase
    from signals.phase import constant_speed as constant_speed
    from signals.phase_demodulation import RefinedPhase as RefinedPhase
    from signals.phase_demodulation import refine_phase as refine_phase
    from signals.planet_averaging import WindowedAverage as WindowedAverage
    from signals.planet_averaging import planet_average as planet_average
    from signals.planet_averaging import sun_average as sun_average
    from signals.planet_passes import PassAngle as PassAngle
    from signals.planet_passes import PassWindow as PassWindow
    from signals.planet_passes import PlanetaryTeeth as PlanetaryTeeth
    from signals.planet_passes import pass_angle as pass_angle
    from signals.pulses import PulseTrain as PulseTrain
    from signals.pulses import pulse_times as pulse_times
    from signals.quadrature import QuadratureEdges as QuadratureEdges
    from signals.quadrature import quadrature_direction as quadrature_direction
    from signals.repairs import PulseRepairs as PulseRepairs
    from signals.resampling import AngularSignal as AngularSignal
    from signals.resampling import TimeSignal as TimeSignal
    from signals.resampling import angular_resample as angular_resample
    from signals.resampling import time_resample as time_resample
    from signals.resampling_stream import AngularStream as AngularStream
    from signals.resampling_stream import angular_blocks as angular_blocks
    from signals.residues import DifferenceSignal as DifferenceSignal
    from signals.residues import MeshBand as MeshBand
    from signals.residues import RegularSignal as RegularSignal
    from signals.residues import ResidualSignal as ResidualSignal
    from signals.residues import difference_signal as difference_signal
    from signals.residues import mesh_band as mesh_band
    from signals.residues import regular_signal as regular_signal
    from signals.residues import residual_signal as residual_signal
    from signals.separation import CepstrumPrewhitening as CepstrumPrewhitening
    from signals.separation import DiscreteRandomSeparation as DiscreteRandomSeparation
    from signals.separation import LinearPrediction as LinearPrediction
    from signals.separation import PredictionOrders as PredictionOrders
    from signals.separation import SeparatedSignal as SeparatedSignal
    from signals.separation import cepstrum_prewhitening as cepstrum_prewhitening
    from signals.separation import discrete_random_separation as discrete_random_separation
    from signals.separation import linear_prediction as linear_prediction
    from signals.separation import prediction_orders as prediction_orders
    from signals.smoothing import PhaseSmoothing as PhaseSmoothing
    from signals.spectra import AmplitudeSpectrum as AmplitudeSpectrum
    from signals.spectra import AveragedSpectrum as AveragedSpectrum
    from signals.spectra import amplitude_spectrum as amplitude_spectrum
    from signals.spectra import averaged_order_spectrum as averaged_order_spectrum
    from signals.spectra import averaged_spectrum as averaged_spectrum
    from signals.spectra import order_spectrum as order_spectrum
    from signals.speed import SpeedEstimate as SpeedEstimate
    from signals.speed import estimate_speed as estimate_speed
    from signals.tachometer import shaft_phase as shaft_phase

_HOME = {
    "AmplitudeSpectrum": "signals.spectra",
    "AngularSignal": "signals.resampling",
    "AngularStream": "signals.resampling_stream",
    "AveragedSpectrum": "signals.spectra",
    "Band": "signals.bands",
    "CepstrumPrewhitening": "signals.separation",
    "CombAdvice": "signals.combs",
    "CyclicSpectrum": "signals.cyclostationary",
    "DifferenceSignal": "signals.residues",
    "DiscreteRandomSeparation": "signals.separation",
    "HuntingPeriod": "signals.combs",
    "INDICATORS": "signals.indicators",
    "Integrated": "signals.integration",
    "Kurtogram": "signals.kurtogram",
    "Line": "signals.lines",
    "LinearPrediction": "signals.separation",
    "MeshBand": "signals.residues",
    "OrderMap": "signals.order_map",
    "OrderTracks": "signals.harmonics",
    "PassAngle": "signals.planet_passes",
    "PassWindow": "signals.planet_passes",
    "PhaseSmoothing": "signals.smoothing",
    "PlanetaryTeeth": "signals.planet_passes",
    "PredictionOrders": "signals.separation",
    "PulseRepairs": "signals.repairs",
    "PulseTrain": "signals.pulses",
    "QuadratureEdges": "signals.quadrature",
    "RefinedPhase": "signals.phase_demodulation",
    "RegularSignal": "signals.residues",
    "ResidualSignal": "signals.residues",
    "RunningAverage": "signals.averaging",
    "SensorHealth": "signals.health",
    "SeparatedSignal": "signals.separation",
    "ShaftPhase": "signals.phase",
    "SpectralCorrelation": "signals.cyclostationary",
    "SpectralKurtosis": "signals.kurtogram",
    "SpeedEstimate": "signals.speed",
    "SynchronousAverage": "signals.averaging",
    "TimeSignal": "signals.resampling",
    "VarianceHistory": "signals.indicators",
    "WindowedAverage": "signals.planet_averaging",
    "amplitude_spectrum": "signals.spectra",
    "angular_blocks": "signals.resampling_stream",
    "angular_resample": "signals.resampling",
    "averaged_order_spectrum": "signals.spectra",
    "averaged_spectrum": "signals.spectra",
    "cepstrum_prewhitening": "signals.separation",
    "choose_band": "signals.bands",
    "comb_gain": "signals.combs",
    "constant_speed": "signals.phase",
    "difference_signal": "signals.residues",
    "discrete_random_separation": "signals.separation",
    "displacement": "signals.integration",
    "enhanced_envelope_spectrum": "signals.cyclostationary",
    "envelope_order_spectrum": "signals.envelope",
    "envelope_spectrum": "signals.envelope",
    "estimate_speed": "signals.speed",
    "fast_kurtogram": "signals.kurtogram",
    "find_line": "signals.lines",
    "hunting_period": "signals.combs",
    "improved_envelope_spectrum": "signals.cyclostationary",
    "likely_bandwidth": "signals.harmonics.likelihood",
    "linear_prediction": "signals.separation",
    "map_orders": "signals.order_map",
    "mesh_band": "signals.residues",
    "order_spectrum": "signals.spectra",
    "pass_angle": "signals.planet_passes",
    "planet_average": "signals.planet_averaging",
    "prediction_orders": "signals.separation",
    "pulse_times": "signals.pulses",
    "quadrature_direction": "signals.quadrature",
    "quietest_revolutions": "signals.combs",
    "refine_phase": "signals.phase_demodulation",
    "regular_signal": "signals.residues",
    "residual_signal": "signals.residues",
    "sensor_health": "signals.health",
    "shaft_phase": "signals.tachometer",
    "spectral_correlation": "signals.cyclostationary",
    "spectral_kurtosis": "signals.kurtogram",
    "stream_envelope": "signals.envelope",
    "sun_average": "signals.planet_averaging",
    "synchronous_average": "signals.averaging",
    "time_resample": "signals.resampling",
    "track_orders": "signals.harmonics",
    "velocity": "signals.integration",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'signals' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
