"""Whether a record looks like the gearbox that it is analysed with.

Meshes are the surest marks of a gearbox: exact orders, harmonics, and more power than anything else it makes. Where a
line of the record is no mesh of the drawing, belongs to harmonics as a mesh does, and stands far above every mesh that
is drawn, the drawing is another machine's, or its reference or the pulses per revolution are wrong. Nothing can then be
said about its parts.

Many lines of a drawing lie so densely that one of them is near to any line. So a mesh of the drawing counts only away
from shafts, and away from sidebands of a larger strange line; and sidebands of passing planets or multiples of a race
explain a line only where more of its neighbours stand in the same comb than lines at random would.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from hums.analysis.evidence import Setting
from hums.analysis.thresholds import MATCH_BINS, STRANGE_FACTOR, UNEXPLAINED_RATIO
from hums.analysis.unexplained import Drawn, flanks, on_mains
from signals.spectra.peaks import spectral_peaks
from signals.spectra.spectra import AmplitudeSpectrum

__all__ = ["unlike_drawing"]

_MESH_HARMONICS = 6
_SHAFT_HARMONICS = 4  # imbalance, misalignment, looseness, a coupling's jaws
_PASSES = 12  # of a carrier: sidebands of planets that pass stand above their own mesh line
_FEWEST_ORDERS = 5.0  # no gear has fewer teeth
_HARMONICS = (2, 3)
_SIDEBANDS = 3  # of a strange mesh, spaced by the reference: run-out and pitch deviations
_STRIKES = 6  # multiples of a race's order on either side: a resonance carries as many at a similar size
_SIMILAR = 4.0  # lines of a comb that a resonance carries
_CHANCE = 1e-3
_BY_CHANCE = (
    0.3  # of a harmonic: above it the lines are so many, as of strikes while the speed changes, that any has one
)

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
    if not peaks.position.size:
        return ""
    kept = ~flanks(peaks.position, peaks.amplitude, spectrum.bin_width)
    orders, sizes = peaks.position[kept], peaks.amplitude[kept]
    width = MATCH_BINS * spectrum.bin_width

    def at(places: Numbers, relative: float = 0.0) -> NDArray[np.bool_]:
        reach = np.maximum(width, np.maximum(relative, drawn.tolerance) * places)
        near: NDArray[np.bool_] = (np.abs(orders[:, None] - places) <= reach).any(axis=1)
        return near

    shafts = at(np.outer(drawn.shafts, np.arange(1, _SHAFT_HARMONICS + 1)).ravel())
    meshes = np.outer(drawn.meshes, np.arange(1, _MESH_HARMONICS + 1)).ravel()
    own = at(meshes)
    floor = float(np.median(peaks.background))
    others = ~own & ~shafts & (orders > _FEWEST_ORDERS) & ~on_mains(orders, setting, width)
    strange = np.flatnonzero(others & (sizes > STRANGE_FACTOR * UNEXPLAINED_RATIO * floor))
    lines = _Lines(orders=orders, sizes=sizes, drawn=drawn, meshes=meshes, width=width)
    place = next(
        (
            place
            for place in strange[np.argsort(-sizes[strange])]
            if lines.of_a_mesh(place) and not lines.explained(place)
        ),
        None,
    )
    if place is None:
        return ""
    order, size = float(orders[place]), float(sizes[place])
    beside = np.abs(np.abs(orders - order)[:, None] - np.arange(1, _SIDEBANDS + 1)) <= width  # of the reference
    largest_own = float(sizes[own & ~shafts & ~(beside.any(axis=1) & (sizes < size))].max(initial=0.0))
    if size < STRANGE_FACTOR * largest_own:
        return ""
    than = f"{size / largest_own:.0f} times the largest mesh line of the drawing" if largest_own else "alone"
    return (
        f"this does not look like that gearbox: the line at {order:.3f} orders, which has harmonics as a mesh has and "
        f"is no mesh of the drawing, stands {than}; check the drawing, its reference, and the pulses per revolution"
    )


@dataclass(frozen=True, kw_only=True)
class _Lines:
    """Lines of a spectrum, and what of a drawing makes combs of them: planets that pass, strikes on a race."""

    orders: Numbers
    sizes: Numbers
    drawn: Drawn
    meshes: Numbers
    width: float

    def of_a_mesh(self, place: int) -> bool:
        """Return whether a line has harmonics, or is one, where lines at random would seldom stand."""
        order = self.orders[place]
        others = self.orders[self.sizes > self.sizes[place] / _SIMILAR**2]
        density = max(1, others.size - 1) / float(self.orders[-1])
        near = [np.abs(others - k * order) <= self.width for k in _HARMONICS]
        near += [np.abs(k * others - order) <= self.width for k in _HARMONICS]
        tried = 2 * self.width * sum((k * order <= self.orders[-1]) + 1 / k for k in _HARMONICS)
        return bool(np.any(near)) and -math.expm1(-density * tried) <= _BY_CHANCE

    def explained(self, place: int) -> bool:
        """Return whether a line is a sideband of passing planets, or rung by strikes."""
        order, resolved = self.orders[place], 2 * self.width
        races = [race for race in self.drawn.bearings if race > resolved]
        for carrier in self.drawn.carriers:
            sidebands = self.meshes[:, None] + carrier * np.arange(-_PASSES, _PASSES + 1)
            if (np.abs(sidebands - order) > self.width).all():
                continue
            # sidebands that are not resolved are one broad line about the mesh
            if carrier <= resolved or self._one_of(place, carrier, members=_PASSES, slip=0.0) <= _CHANCE:
                return True
        chances = [self._one_of(place, race, members=_STRIKES, slip=self.drawn.slip) for race in races]
        return min(chances, default=1.0) * len(races) <= _CHANCE and bool(races)

    def _one_of(self, place: int, spacing: float, *, members: int, slip: float) -> float:
        """Return the chance that as many of a line's neighbours in a comb have one of the lines of similar size.

        The other similar lines might be anywhere, `members` neighbours on either side.
        """
        order = self.orders[place]
        similar = self.orders[self.sizes > self.sizes[place] / _SIMILAR]
        multiples = np.concatenate([np.arange(-members, 0), np.arange(1, members + 1)])
        multiples = multiples[order + multiples * spacing > 0]
        reach = self.width + slip * spacing * np.abs(multiples)
        held = int((np.abs(similar[:, None] - order - spacing * multiples) <= reach).any(axis=0).sum())
        density = max(1, similar.size - 1 - held) / float(self.orders[-1])
        return float(bdtrc(held - 1, multiples.size, min(1.0, float(np.mean(2 * reach * density))))) if held else 1.0
