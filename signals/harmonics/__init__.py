"""Amplitude and phase of shaft harmonics, sample by sample, each with its uncertainty."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from signals.harmonics.model import OrderTracks as OrderTracks
    from signals.harmonics.model import process_variance as process_variance
    from signals.harmonics.model import smoother_bandwidth as smoother_bandwidth
    from signals.harmonics.tracker import track_orders as track_orders

_HOME = {
    "OrderTracks": "signals.harmonics.model",
    "process_variance": "signals.harmonics.model",
    "smoother_bandwidth": "signals.harmonics.model",
    "track_orders": "signals.harmonics.tracker",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'signals.harmonics' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
