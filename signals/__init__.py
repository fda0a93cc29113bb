"""Signal processing on arrays: shaft phase, angular resampling, spectra, envelopes, order trackers.

NumPy in, frozen dataclasses of NumPy out. Nothing here knows of gearboxes, files or plots.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from signals.harmonics import OrderTracks as OrderTracks
    from signals.harmonics import track_orders as track_orders

_HOME = {
    "OrderTracks": "signals.harmonics",
    "track_orders": "signals.harmonics",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'signals' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
