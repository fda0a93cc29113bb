"""Whether a record looks like the gearbox that it is analysed with.

Meshes are the surest marks of a gearbox: exact orders, harmonics, and more power than anything else it makes. Where the
largest line of the record is no mesh of the drawing, has harmonics as a mesh has, and stands far above every mesh that
is drawn, the drawing is another machine's, or its reference or the pulses per revolution are wrong. Nothing can then be
said about its parts.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hums.analysis.evidence import Setting
from hums.analysis.thresholds import MATCH_BINS, STRANGE_FACTOR, UNEXPLAINED_RATIO
from hums.analysis.unexplained import Drawn, on_mains
from signals.spectra.peaks import spectral_peaks
from signals.spectra.spectra import AmplitudeSpectrum

__all__ = ["unlike_drawing"]

_MESH_HARMONICS = 6
_SHAFT_HARMONICS = 4  # imbalance, misalignment, looseness, a coupling's jaws
_PASSES = 12  # of a carrier: sidebands of planets that pass stand above their own mesh line
_FEWEST_ORDERS = 5.0  # no gear has fewer teeth
_HARMONICS = (2, 3)
_SIMILAR = 4.0  # lines of a comb that a resonance carries, one spacing apart

Numbers = NDArray[np.float64]


def unlike_drawing(spectra: Sequence[AmplitudeSpectrum], drawn: Drawn, setting: Setting) -> str:
    """Return why a record does not look like its gearbox, or an empty string.

    Parameters
    ----------
    spectra : sequence of AmplitudeSpectrum
        Order spectra of all channels; one that looks like the drawing is enough.
    drawn : Drawn
    setting : Setting
    """
    if not drawn.meshes or not spectra:
        return ""
    reasons = [_unlike(spectrum, drawn, setting) for spectrum in spectra]
    return reasons[0] if all(reasons) else ""


def _unlike(spectrum: AmplitudeSpectrum, drawn: Drawn, setting: Setting) -> str:
    peaks = spectral_peaks(spectrum, ratio=UNEXPLAINED_RATIO)
    orders, sizes = peaks.position, peaks.amplitude
    if not orders.size:
        return ""
    width = MATCH_BINS * spectrum.bin_width

    def at(places: Numbers, relative: float = 0.0) -> NDArray[np.bool_]:
        reach = np.maximum(width, np.maximum(relative, drawn.tolerance) * places)
        near: NDArray[np.bool_] = (np.abs(orders[:, None] - places) <= reach).any(axis=1)
        return near

    shafts = np.array(drawn.shafts)
    meshes = np.outer(drawn.meshes, np.arange(1, _MESH_HARMONICS + 1)).ravel()
    own = at(meshes)
    largest_own = float(sizes[own].max(initial=0.0))
    passing = np.outer(drawn.carriers, np.arange(1, _PASSES + 1)).ravel()
    offsets = np.concatenate([passing, -passing])
    others = ~own & ~at((meshes[:, None] + offsets).ravel())
    others &= (orders > _FEWEST_ORDERS) & ~on_mains(orders, setting, width)
    others &= ~at(np.outer(shafts, np.arange(1, _SHAFT_HARMONICS + 1)).ravel())
    others &= ~_combs(orders, sizes, np.array(drawn.bearings), drawn.slip, width)
    if not others.any():
        return ""
    place = int(np.argmax(np.where(others, sizes, 0.0)))
    order, size = float(orders[place]), float(sizes[place])
    if size < STRANGE_FACTOR * max(largest_own, float(np.median(peaks.background)) * UNEXPLAINED_RATIO):
        return ""
    if not any((np.abs(orders - k * order) <= k * width).any() for k in _HARMONICS):
        return ""
    than = f"{size / largest_own:.0f} times the largest mesh line of the drawing" if largest_own else "alone"
    return (
        f"this does not look like that gearbox: the line at {order:.3f} orders, which has harmonics as a mesh has and "
        f"is no mesh of the drawing, stands {than}; check the drawing, its reference, and the pulses per revolution"
    )


def _combs(orders: Numbers, sizes: Numbers, spacings: Numbers, slip: float, width: float) -> NDArray[np.bool_]:
    """Return which lines stand in a comb: with a line of similar size one spacing above and one below."""
    among = np.zeros(orders.size, dtype=bool)
    for spacing in spacings[spacings > 2 * width]:
        reach = width + slip * spacing
        both = np.ones(orders.size, dtype=bool)
        for side in (-spacing, spacing):
            near = np.abs(orders[:, None] + side - orders) <= reach
            both &= (near & (sizes > sizes[:, None] / _SIMILAR)).any(axis=1)
        among |= both
    return among
