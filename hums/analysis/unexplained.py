"""Lines of an order spectrum that no component of the drawing explains, and their possible sources.

A peak is explained if it is a multiple of a shaft order, a mesh harmonic or its sideband at the spacing of any shaft, a
multiple of the mains frequency, or the flank of a larger line. The others are listed with their common spacing: a
family of multiples of one order belongs to the bearing with that defect order, or else to another machine or a
component missing from the drawing. If such lines exceed the meshes of the drawing, the record is not of its gearbox.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.signal.windows import blackmanharris
from scipy.special import bdtrc

from hums.analysis.combs import Setting, mains_multiples
from hums.analysis.thresholds import APART_BINS, MATCH_BINS, SHAFT_MULTIPLES, STRANGE_FACTOR, UNEXPLAINED_RATIO
from hums.gearbox.defect_orders import BEARING_KINDS, DefectOrder
from signals.spectra.peaks import spectral_peaks
from signals.spectra.spectra import AmplitudeSpectrum

_FEWEST = 4  # members of a family: three multiples of one order among tens of lines happen by chance
_CHANCE = 1e-3
_LARGE = 20  # lines that are tried as multiples
_MULTIPLES = 60  # of a spacing, up to the third mesh harmonic of a small gear
_SAME = 1e-3  # relative: a spacing and a shaft's order are the same
_PARTS = 5  # of a shaft's order: a family of its multiples may have some of them only
_PEAK_BINS = 0.2  # of a bin, to which the place of a line is known
_SIDEBANDS = 8  # on either side of a mesh harmonic: run-out, pitch deviations, speed that wanders
_MESH_HARMONICS = 12
_MOST = 60  # lines that are listed, the largest first
_LOBE_BINS = 4.0
_AS_MADE = 2.0  # times what pulses make: lines of several carriers add up
_FEWEST_PULSES = 64

Numbers = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Orders that the drawing explains: shafts, meshes, bearing defects with their slip, and meshes of planets.

    `planets` has the order of each mesh of several planets, that of their carrier, and their number.
    """

    shafts: tuple[float, ...]
    meshes: tuple[float, ...]
    bearings: tuple[float, ...]
    planets: tuple[tuple[float, float, int], ...]
    tolerance: float
    slip: float


@dataclass(frozen=True, kw_only=True)
class UnexplainedLine:
    """A line that no component of the drawing explains.

    `frequency_hz` is its order times the mean speed; `spacing` the order of which this and other lines are multiples,
    NaN for a single line; `ratio` its amplitude over the median of its background.
    """

    channel: str
    order: float
    frequency_hz: float
    amplitude: float
    units: str
    ratio: float
    spacing: float
    might_be: str


@dataclass(frozen=True, kw_only=True)
class PulseVariation:
    """Amplitudes in revolutions of the variation of pulse times about uniform rotation, at orders 0 to `last`.

    Coarse sampling of the pulses makes their errors periodic at a steady speed. A line of amplitude A at order c then
    has sidebands of amplitude ``pi c A a`` at the spacing of an order at which the pulse times vary by a. Variations of
    the speed, which the pulses follow, cause none.
    """

    amplitudes: Numbers
    last: float

    @classmethod
    def of(cls, times_s: Numbers, turns: Numbers, jitter_s: float) -> "PulseVariation | None":
        """Return the variation by second differences, at most that of pulses with this jitter; None for few pulses."""
        if turns.size < _FEWEST_PULSES or not (np.diff(turns) > 0).all():
            return None
        even = np.linspace(turns[0], turns[-1], turns.size)
        curved = np.diff(np.interp(even, turns, times_s), 2)
        window = blackmanharris(curved.size, sym=False)
        response = 4 * np.sin(np.pi * np.maximum(np.fft.rfftfreq(curved.size), 1 / curved.size)) ** 2
        found = 2 * np.abs(np.fft.rfft(curved * window)) / window.sum() / response
        turned = float(turns[-1] - turns[0])
        largest = np.minimum(maximum_filter1d(found, 2 * int(_LOBE_BINS) - 3), math.sqrt(2) * jitter_s)
        return cls(amplitudes=largest * turned / float(times_s[-1] - times_s[0]), last=(turns.size - 1) / turned / 2)

    def makes(self, orders: Numbers, amplitudes: Numbers) -> NDArray[np.bool_]:
        """Return which lines are sidebands of larger ones due to this variation."""
        distance = np.abs(orders[:, None] - orders)
        folded = np.abs(distance - 2 * self.last * np.round(distance / (2 * self.last)))
        at = np.rint(folded / self.last * (self.amplitudes.size - 1)).astype(np.int64)
        made = np.where(distance < 3 * self.last, np.pi * orders * amplitudes * self.amplitudes[at], 0.0)
        larger = amplitudes > amplitudes[:, None]
        return np.asarray((larger & (amplitudes[:, None] <= _AS_MADE * made)).any(axis=1))


def unexplained_lines(
    spectrum: AmplitudeSpectrum,
    drawn: Drawn,
    setting: Setting,
    *,
    channel: str,
    units: str,
    pulses: PulseVariation | None = None,
) -> tuple[list[UnexplainedLine], int]:
    """Return the lines that the drawing does not explain, largest first, and the number caused by the tachometer."""
    peaks = spectral_peaks(spectrum, ratio=UNEXPLAINED_RATIO)
    width = MATCH_BINS * spectrum.bin_width
    selected = ~flanks(peaks.position, peaks.amplitude, spectrum.bin_width)
    selected &= ~locked_to_shafts(peaks.position, drawn, width)
    mains = on_mains(peaks.position, setting, width)
    selected &= ~mains
    made = np.zeros_like(selected) if pulses is None else selected & pulses.makes(peaks.position, peaks.amplitude)
    made &= made.sum() >= _FEWEST  # random errors of pulses make a line or two
    left = np.flatnonzero(selected & ~made)
    left = left[np.argsort(-peaks.amplitude[left])][:_MOST]
    orders = peaks.position[left]
    spacings = _families(orders, spectrum.bin_width)
    lines = [
        UnexplainedLine(
            channel=channel,
            order=float(order),
            frequency_hz=float(order * setting.speed_hz),
            amplitude=float(peaks.amplitude[place]),
            units=units,
            ratio=float(peaks.amplitude[place] / max(peaks.background[place], np.finfo(float).tiny)),
            spacing=float(spacing),
            might_be=_guess(float(order), float(spacing), setting, drawn),
        )
        for place, order, spacing in zip(left, orders, spacings, strict=True)
    ]
    return lines, int(made.sum())


def not_named(lines: Sequence[UnexplainedLine], found: Sequence[float], *, bin_width: float) -> list[UnexplainedLine]:
    """Return the lines that are not harmonics of the bearings that a verdict names.

    Parameters
    ----------
    lines : sequence of UnexplainedLine
    found : sequence of float
        Orders at which the named bearings were found, each to a fifth of a bin, as far as a peak is interpolated.
    bin_width : float
        Bin width of the spectrum in orders.
    """

    def is_harmonic(order: float, of: float) -> bool:
        if of <= APART_BINS * bin_width:
            return False
        multiple = max(1, round(order / of))
        reach = min((MATCH_BINS + _PEAK_BINS * multiple) * bin_width, of / 8)  # at most a quarter of all places
        return abs(order - multiple * of) <= reach

    return [line for line in lines if not any(is_harmonic(line.order, of) for of in found)]


def _guess(order: float, spacing: float, setting: Setting, drawn: Drawn) -> str:
    """Return the possible source of a family of lines in words; empty for a single line."""
    if not np.isfinite(spacing):
        return ""
    family = f"{order / spacing:.0f} times {spacing:.4g} orders ({spacing * setting.speed_hz:.4g} Hz)"
    multiples = {race: max(1, round(spacing / race)) for race in drawn.bearings}
    near = [race for race, n in multiples.items() if abs(spacing - n * race) <= drawn.slip * n * race]
    if near:  # nine times a cage is near many a race: the lowest multiple says most
        return f"{family}: a bearing's defect of order {min(near, key=multiples.__getitem__):.4g}"
    for shaft in drawn.shafts:
        for part in range(1, _PARTS + 1):
            multiple = max(1, round(part * spacing / shaft))
            if (
                multiple <= _PARTS
                and abs(part * spacing - multiple * shaft) <= max(drawn.tolerance, _SAME) * multiple * shaft
            ):
                return f"{family}: a shaft of order {shaft:.4g}"
    return f"{family}: another machine, or a component missing from the drawing"


def flanks(orders: Numbers, amplitudes: Numbers, bin_width: float) -> NDArray[np.bool_]:
    """Return which peaks lie within the window skirt of a larger one."""
    reach = _LOBE_BINS * bin_width
    first, last = np.searchsorted(orders, orders - reach), np.searchsorted(orders, orders + reach)
    return np.array(
        [amplitudes[a:b].max() > one for a, b, one in zip(first, last, amplitudes, strict=True)], dtype=bool
    )


def distances(orders: Numbers, places: Numbers) -> Numbers:
    """Return the distance of each order to the nearest of some sorted orders, infinite if there are none."""
    if not places.size:
        return np.full(orders.size, np.inf)
    at = np.searchsorted(places, orders)
    below, above = places[np.maximum(at - 1, 0)], places[np.minimum(at, places.size - 1)]
    return np.minimum(np.abs(orders - below), np.abs(orders - above))


def locked_to_shafts(orders: Numbers, drawn: Drawn, width: float) -> NDArray[np.bool_]:
    """Return which orders lie within a width of a multiple of a shaft, or of a mesh harmonic or its sideband."""
    shafts = np.array([s for s in drawn.shafts if s > 0])
    most = int(orders.max(initial=0.0) / max(shafts.max(initial=1.0), 1e-9)) + SHAFT_MULTIPLES
    own = np.outer(shafts, np.arange(1, most + 1)).ravel()
    offsets = np.concatenate([[0.0], np.outer(shafts, np.arange(1, _SIDEBANDS + 1)).ravel()])
    offsets = np.unique(np.concatenate([offsets, -offsets]))
    meshes = np.outer(drawn.meshes, np.arange(1, _MESH_HARMONICS + 1)).ravel()
    locked = np.sort(np.concatenate([own, (meshes[:, None] + offsets).ravel()]))
    return distances(orders, locked) <= np.maximum(width, drawn.tolerance * orders)


def on_mains(orders: Numbers, setting: Setting, width: float) -> NDArray[np.bool_]:
    """Return which orders are harmonics of the mains frequency, at a steady speed."""
    families = mains_multiples(orders, setting, width * setting.speed_hz)
    return np.asarray(np.any([multiple > 0 for _, multiple in families], axis=0))


def _families(orders: Numbers, bin_width: float) -> Numbers:
    """Return, for each order, the spacing of the family of multiples to which it belongs; NaN if there is none.

    Each of the largest lines over each whole number is tried as a spacing: the larger the number, the more accurate the
    spacing. A family has more members than expected by chance: the probability that as many lines at random orders lie
    within half a bin of its multiples, times the number of spacings tried, is below `_CHANCE`.
    """
    spacings = np.full(orders.size, np.nan)
    tried = np.unique(np.outer(orders[:_LARGE], 1 / np.arange(1, _MULTIPLES + 1)))
    tried = tried[tried > APART_BINS * bin_width]
    free = np.ones(orders.size, dtype=bool)
    while tried.size:
        multiple = np.round(orders / tried[:, None])
        near = np.abs(orders - multiple * tried[:, None]) <= 0.5 * bin_width
        on = free & near & (multiple >= 1) & (multiple <= _MULTIPLES)
        counts = np.count_nonzero(on, axis=1)
        chance = bdtrc(counts - 1, np.count_nonzero(free), bin_width / tried) * tried.size
        best = int(np.argmin(np.where(counts >= _FEWEST, chance, np.inf)))
        if counts[best] < _FEWEST or chance[best] > _CHANCE:
            break
        spacings[on[best]] = tried[best]
        free &= ~on[best]
    return spacings


_LOCKED = {"shaft", "planet_pass", "tooth", "planet_tooth"}


def drawn_orders(rows: Sequence[DefectOrder], *, tolerance: float, slip: float) -> Drawn:
    """Return the orders that the drawing explains, from its defect orders."""
    turning = {row.component: row.order for row in rows if row.kind == "shaft" and row.order > 0}
    planets = {
        (row.order, turning[row.seen_from], row.sources)
        for row in rows
        if row.kind == "gear_mesh" and row.sources > 1 and row.seen_from in turning
    }
    return Drawn(
        shafts=tuple(sorted({row.order for row in rows if row.kind in _LOCKED and row.order > 0})),
        meshes=tuple(sorted({row.order for row in rows if row.kind == "gear_mesh"})),
        bearings=tuple(sorted({row.order for row in rows if row.kind in BEARING_KINDS})),
        planets=tuple(sorted(planets)),
        tolerance=tolerance,
        slip=slip,
    )


# ---- Whether a record looks like the gearbox that it is analysed with -----------------------------------------------
# Meshes are the surest marks of a gearbox: exact orders, harmonics, and more power than anything else it makes. Where
# a line of the record is no mesh of the drawing, belongs to harmonics as a mesh does, and stands far above every mesh
# that is drawn, the drawing is another machine's, or its reference or the pulses per revolution are wrong. Nothing can
# then be said about its parts.
#
# Many lines of a drawing lie so densely that one of them is near to any line. So a mesh of the drawing counts only
# away from shafts.


_SHAFT_HARMONICS = 4  # imbalance, misalignment, looseness, a coupling's jaws
_PASSES = 12  # of a carrier: sidebands of planets that pass stand above their own mesh line
_FEWEST_ORDERS = 5.0  # no gear has fewer teeth
_HARMONICS = (2, 3)
_SIMILAR = 4.0  # lines of a comb that a resonance carries
_BY_CHANCE = 0.3  # of a harmonic: above it lines are so many, as of strikes while the speed changes, that any has one


def unlike_drawing(spectra: Sequence[AmplitudeSpectrum], drawn: Drawn, setting: Setting) -> str:
    """Return why a record does not look like its gearbox, or an empty string.

    Parameters
    ----------
    spectra : sequence of AmplitudeSpectrum
        Order spectra of all channels; one that agrees with the drawing suffices.
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
    selected = ~flanks(peaks.position, peaks.amplitude, spectrum.bin_width)
    orders, sizes = peaks.position[selected], peaks.amplitude[selected]
    width = MATCH_BINS * spectrum.bin_width

    def at(places: Numbers) -> NDArray[np.bool_]:
        reach = np.maximum(width, drawn.tolerance * places)
        return np.asarray((np.abs(orders[:, None] - places) <= reach).any(axis=1))

    shafts = at(np.outer(drawn.shafts, np.arange(1, _SHAFT_HARMONICS + 1)).ravel())
    meshes = np.outer(drawn.meshes, np.arange(1, _MESH_HARMONICS + 1)).ravel()
    own = at(np.concatenate([meshes, _passes(drawn)]))
    floor = float(np.median(peaks.background))
    others = ~own & ~shafts & (orders > _FEWEST_ORDERS) & ~on_mains(orders, setting, width)
    strange = np.flatnonzero(others & (sizes > STRANGE_FACTOR * UNEXPLAINED_RATIO * floor))
    for place in strange[np.argsort(-sizes[strange])]:
        if _of_a_mesh(orders, sizes, place, width):
            break
    else:
        return ""
    order, size = float(orders[place]), float(sizes[place])
    largest_own = float(sizes[own & ~shafts].max(initial=0.0))
    if size < STRANGE_FACTOR * largest_own:
        return ""
    than = f"{size / largest_own:.0f} times as large as any mesh line" if largest_own else "larger than any mesh line"
    return (
        f"the record does not look like this gearbox: the line at {order:.3f} orders has harmonics like a mesh line "
        f"and is {than} of the drawing; check the drawing, its reference, and the pulses per revolution"
    )


def _passes(drawn: Drawn) -> Numbers:
    """Return the planet-pass sidebands, which may exceed their own mesh line.

    Of planets out of phase, the mesh line itself vanishes and only some sidebands remain (McFadden and Smith 1985).
    """
    sides = np.arange(-_PASSES, _PASSES + 1)
    meshes = np.outer(drawn.meshes, np.arange(1, _MESH_HARMONICS + 1)).ravel()
    carriers = sorted({carrier for _, carrier, _ in drawn.planets})
    return np.asarray(np.add.outer(meshes, np.outer(carriers, sides)).ravel())


def _of_a_mesh(orders: Numbers, sizes: Numbers, place: int, width: float) -> bool:
    """Return whether a line has harmonics, or is one, at orders where random lines would seldom lie."""
    order = orders[place]
    others = orders[sizes > sizes[place] / _SIMILAR**2]
    density = max(1, others.size - 1) / float(orders[-1])
    near = [np.abs(others - k * order) <= width for k in _HARMONICS]
    near += [np.abs(k * others - order) <= width for k in _HARMONICS]
    tried = 2 * width * sum((k * order <= orders[-1]) + 1 / k for k in _HARMONICS)
    return bool(np.any(near)) and -math.expm1(-density * tried) <= _BY_CHANCE
