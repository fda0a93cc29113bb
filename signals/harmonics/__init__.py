"""Amplitude and phase of shaft harmonics, sample by sample, each with its uncertainty."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from signals.harmonics.bandwidth import Bandwidth as Bandwidth
    from signals.harmonics.bandwidth import isolated_std as isolated_std
    from signals.harmonics.bandwidth import process_variance as process_variance
    from signals.harmonics.bandwidth import smoother_bandwidth as smoother_bandwidth
    from signals.harmonics.bandwidth_selection import likely_bandwidth as likely_bandwidth
    from signals.harmonics.reference import HarmonicMatrices as HarmonicMatrices
    from signals.harmonics.reference import harmonic_model as harmonic_model
    from signals.harmonics.stream import OrderTracker as OrderTracker
    from signals.harmonics.tracker import track_orders as track_orders
    from signals.harmonics.tracker import vold_kalman_filter as vold_kalman_filter
    from signals.harmonics.tracking_results import OrderTracks as OrderTracks
    from signals.harmonics.tracking_results import OutputFlag as OutputFlag
    from signals.harmonics.waveform import order_waveform as order_waveform
    from signals.harmonics.waveform import residual_record as residual_record
    from signals.slipping_order.slip_tracking import SlippingTrack as SlippingTrack
    from signals.slipping_order.slip_tracking import track_slipping_order as track_slipping_order

_HOME = {
    "Bandwidth": "signals.harmonics.bandwidth",
    "HarmonicMatrices": "signals.harmonics.reference",
    "OrderTracks": "signals.harmonics.tracking_results",
    "OrderTracker": "signals.harmonics.stream",
    "OutputFlag": "signals.harmonics.tracking_results",
    "SlippingTrack": "signals.slipping_order.slip_tracking",
    "harmonic_model": "signals.harmonics.reference",
    "isolated_std": "signals.harmonics.bandwidth",
    "likely_bandwidth": "signals.harmonics.bandwidth_selection",
    "order_waveform": "signals.harmonics.waveform",
    "process_variance": "signals.harmonics.bandwidth",
    "residual_record": "signals.harmonics.waveform",
    "smoother_bandwidth": "signals.harmonics.bandwidth",
    "track_orders": "signals.harmonics.tracker",
    "track_slipping_order": "signals.slipping_order.slip_tracking",
    "vold_kalman_filter": "signals.harmonics.tracker",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'signals.harmonics' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
