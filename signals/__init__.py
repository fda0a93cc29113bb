"""Signal processing on arrays: shaft phase, angular resampling, spectra, envelopes, order trackers.

NumPy in, frozen dataclasses of NumPy out. Nothing here knows of gearboxes, files or plots.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from signals.averaging import SynchronousAverage as SynchronousAverage
    from signals.averaging import residual_signal as residual_signal
    from signals.averaging import synchronous_average as synchronous_average
    from signals.envelope import envelope_order_spectrum as envelope_order_spectrum
    from signals.harmonics import OrderTracks as OrderTracks
    from signals.harmonics import track_orders as track_orders
    from signals.harmonics.likelihood import likely_bandwidth as likely_bandwidth
    from signals.lines import Line as Line
    from signals.lines import find_line as find_line
    from signals.phase import ShaftPhase as ShaftPhase
    from signals.phase import constant_speed as constant_speed
    from signals.resampling import AngularSignal as AngularSignal
    from signals.resampling import angular_resample as angular_resample
    from signals.spectra import AmplitudeSpectrum as AmplitudeSpectrum
    from signals.spectra import amplitude_spectrum as amplitude_spectrum
    from signals.spectra import order_spectrum as order_spectrum
    from signals.tachometer import PulseTrain as PulseTrain
    from signals.tachometer import pulse_times as pulse_times
    from signals.tachometer import shaft_phase as shaft_phase

_HOME = {
    "AmplitudeSpectrum": "signals.spectra",
    "AngularSignal": "signals.resampling",
    "Line": "signals.lines",
    "OrderTracks": "signals.harmonics",
    "PulseTrain": "signals.tachometer",
    "ShaftPhase": "signals.phase",
    "SynchronousAverage": "signals.averaging",
    "amplitude_spectrum": "signals.spectra",
    "angular_resample": "signals.resampling",
    "constant_speed": "signals.phase",
    "envelope_order_spectrum": "signals.envelope",
    "find_line": "signals.lines",
    "likely_bandwidth": "signals.harmonics.likelihood",
    "order_spectrum": "signals.spectra",
    "pulse_times": "signals.tachometer",
    "residual_signal": "signals.averaging",
    "shaft_phase": "signals.tachometer",
    "synchronous_average": "signals.averaging",
    "track_orders": "signals.harmonics",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'signals' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
