"""Test of the declared angle against the record: speed, pulses per revolution, shaft, synchronous clock.

Under a declaration every shaft and mesh is a family of lines at harmonics of its order, and every bearing one in an
envelope. The significance of a line is the probability ``p`` that an equal window placed at random in the octaves
around it holds a peak as large, converted into evidence against chance by ``e = (1 - p + p ln p) / (p ln^2 p)`` (Vovk
and Wang 2021, "E-values: calibration, combination and applications", the mean over all exponents of their calibrators),
whose mean is one under chance alone. A line that is present with probability ``q`` contributes the factor ``1 - q + q
(2 e - 1)``, and a family, visible with probability `_VISIBLE`, the product of these. Families are multiplied.

The alternatives are: the speed is wrong by an integer factor or the ratio of two shafts, or a nominal one by a few
percent; or the angle lags the shaft or has another clock, so that at varying speed lines shift or spread in proportion
to their order. Modes of a sound transfer path also delay lines, by up to `_PATH_S`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hums.analysis.evidence import BandEvidence
from hums.analysis.reference_angle import Machine
from hums.analysis.unexplained import flanks
from hums.gearbox.defect_orders import BEARING_KINDS
from signals.spectra.peaks import spectral_peaks
from signals.spectra.spectra import AmplitudeSpectrum

CONFIRMED = math.log(20)
"""Evidence above which a declaration is confirmed: odds of twenty against chance."""

CONTRADICTED = math.log(1000)
"""Evidence that an alternative needs, by itself and over the declared one, to be accepted."""

_MESH = (0.95, 0.7, 0.5, 0.35, 0.25, 0.2)  # of a mesh that shows: the share of machines whose harmonic does
_SHAFT = (0.95, 0.6, 0.4, 0.3, 0.25, 0.2)
_BEARING = (0.95, 0.9, 0.7)
_VISIBLE = 0.8  # share of shafts and meshes that show
_DAMAGED = 0.5  # of records: a bearing shows where it is damaged
_MOST_PULSES = 4  # declared or true, for ratios of both
_SPREADS = (0.0, 3e-4, 1e-3, 3e-3)  # of a line, relative to its order
_NOMINAL = 0.1  # relative: how far off a nominal speed may be
_PATH_S = 0.002  # of delay by modes of the path: about 1 / (damping * 2 pi * frequency) of one of 1 kHz and 8 %
_LATE = 0.01  # relative: how far a delay, or the clock, of a tachometer may move lines
_MOST_SPEEDS = 20_000  # that are tried
_SAME_SPEED = 0.005  # relative
_HALF_BINS = 1.0  # half width of a line's window
_TEETH = 3  # by which a tooth number may be wrong
_MULTIPLES = 10  # of a shaft that a damaged tooth shows
_FEWEST_BINS = 8.0  # of an order, below which harmonics of its family are not apart

Numbers = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """Result of testing the declared angle of a record.

    `contradiction` states what the record shows instead, `doubt` why it is inconclusive; both are empty if it is
    confirmed. `explained`: the discrepancy is known, so that the record may resemble another gearbox although the
    declared one is right. `speed_ratio` is the measured speed over the nominal one, 1 if not measured.
    """

    contradiction: str = ""
    doubt: str = ""
    explained: bool = False
    speed_ratio: float = 1.0
    note: str = ""
    """Declared speed, and the speed that the record shows."""
    unseen: str = ""
    """Meshes of which no line stands out, and what to check."""
    unsure: tuple[str, ...] = ()
    """Gears of these meshes, and gears and bearings on their shafts, whose rotation no other line shows."""
    misdrawn: Mapping[str, str] = field(default_factory=dict)
    """Gear and bearings of a shaft that turns as with another tooth number, and what shows that."""


@dataclass(frozen=True, kw_only=True)
class _Peaks:
    """Peaks of a spectrum from 0 to `end`: positions, and sizes over their background."""

    places: Numbers
    sizes: Numbers
    bin_width: float
    end: float

    @classmethod
    def of(cls, spectrum: AmplitudeSpectrum) -> "_Peaks":
        found = spectral_peaks(spectrum)
        own = ~flanks(found.position, found.amplitude, spectrum.bin_width)
        sizes = found.amplitude[own] / np.maximum(found.background[own], np.finfo(float).tiny)
        return cls(places=found.position[own], sizes=sizes, bin_width=spectrum.bin_width, end=float(spectrum.axis[-1]))

    @classmethod
    def of_band(cls, band: BandEvidence) -> "_Peaks":
        sizes = band.depths / np.maximum(band.backgrounds, np.finfo(float).tiny)
        return cls(places=band.orders, sizes=sizes, bin_width=band.bin_width, end=float(max(band.orders, default=0.0)))

    def half(self, orders: Numbers, spread: float) -> Numbers:
        """Return half the width of the windows of lines."""
        return np.maximum(_HALF_BINS * self.bin_width, spread * orders)

    @cached_property
    def rates(self) -> Numbers:
        """Density of peaks at least as large as each, including itself, per order in the octaves around it."""
        margin = 100 * self.bin_width
        low, high = np.maximum(self.places / 2 - margin, 0), np.minimum(2 * self.places + margin, self.end)
        near = (self.places > low[:, None]) & (self.places < high[:, None])
        return np.asarray((near & (self.sizes >= self.sizes[:, None])).sum(axis=1) / (high - low))

    def log_evidence(self, orders: Numbers, half: Numbers, shares: Numbers) -> Numbers:
        """Return the logarithm of the joint evidence of lines, (..., line) to (...,)."""
        first, last = np.searchsorted(self.places, orders - half), np.searchsorted(self.places, orders + half)
        rarest = np.full(orders.shape, np.inf)
        for step in range(int((last - first).max(initial=0))):
            at = np.minimum(first + step, self.rates.size - 1)
            rarest = np.where(first + step < last, np.minimum(rarest, self.rates[at]), rarest)
        return _of_family(-np.expm1(-rarest * 2 * half), shares)


def _of_family(chance: Numbers, shares: Numbers) -> Numbers:
    """Return the logarithm of the joint evidence of lines along the last axis, from the probability of each."""
    p = np.clip(chance, 1e-12, 1 - 1e-6)
    log = np.log(p)
    against_chance = np.where(chance > 1 - 1e-3, 0.5, (1 - p + p * log) / (p * log**2))
    return np.asarray(np.log1p(shares * (2 * against_chance - 2)).sum(axis=-1))


def _if_it_shows(share: float, evidence: float | Numbers) -> Numbers:
    """Return the logarithm of the evidence of a feature that a share of machines shows, from that of its presence."""
    return np.asarray(np.logaddexp(math.log(1 - share), math.log(share) + evidence))


def judged_declaration(
    channels: Sequence[tuple[AmplitudeSpectrum, Sequence[BandEvidence]]],
    machine: Machine,
    *,
    slip: float,
    damaged: Sequence[float] = (),
) -> Declaration:
    """Test the declared angle of a machine against the order spectra and envelopes of its channels.

    Lines at multiples of the orders in `damaged`, those of bearings with a line, show no tooth number.
    """
    comb = _Comb(machine, slip)
    spectra = [
        (_Peaks.of(one), [_Peaks.of_band(band) for band in bands if band.orders.size]) for one, bands in channels
    ]
    if not spectra:
        return Declaration()
    speeds = machine.speeds_hz
    path = _PATH_S * float(np.ptp(speeds)) / speeds.size  # by which modes of a sound machine's path move lines

    def of_lines(ratio: float, spread: float = path) -> float:
        """Return the evidence of shafts and meshes for this ratio of the true speed to the declared one."""
        return max(float(comb.of_lines(peaks, np.array([ratio]), spread)[0]) for peaks, _ in spectra)

    def of_rival(ratio: float) -> float:
        # harmonics of a bearing are also some bearing's at half the speed: they support a rival, but decide none
        lines = of_lines(ratio)
        return lines + min(comb.of_bearings(spectra, ratio), bearings) if lines - shown >= CONFIRMED else -math.inf

    bearings, shown = comb.of_bearings(spectra, 1.0), of_lines(1.0)
    declared = shown + bearings
    nominal = machine.source.declared is not None
    best, words = max((of_rival(ratio), words) for words, ratio in _rivals(machine))
    rival = min(best, best - declared)
    if not nominal and rival >= CONTRADICTED:
        odds = f"{math.exp(min(best - declared, 40.0)):.2g} to 1"
        return Declaration(contradiction=f"the record contradicts the speed: its lines are those of {words} ({odds})")
    spreads = {path: declared} | {wide: of_lines(1.0, wide) + bearings for wide in _SPREADS if wide > path}
    spread = max(spreads, key=spreads.__getitem__)
    # nothing but its own lines says that a nominal speed does not wander
    spreading = min(spreads[spread], spreads[spread] - declared) >= (CONFIRMED if nominal else CONTRADICTED)
    source = machine.source
    weak = declared < CONFIRMED + CONTRADICTED or spreading
    reach = _NOMINAL if nominal else _LATE
    ratio = (
        comb.shown_ratio(spectra, declared, reach=reach, path=path) if weak and (nominal or source.tachometer) else None
    )
    if source.declared is not None and ratio is not None:
        shown, rpm = ratio * source.declared.speed_hz / source.declared.declared_hz, 60 * source.declared.declared_hz
        note = (
            f"The speed of {source.shaft} is declared as {rpm:.5g} rpm, but lines of shafts, meshes and bearings show "
            f"{shown * rpm:.5g} rpm: the record is analysed at that speed."
        )
        return Declaration(speed_ratio=shown, note=note)
    doubt = ""
    known = f'tachometer "{source.tachometer}"' if source.tachometer else "declared" if nominal else "estimated"
    if ratio is not None:
        doubt = _late_words(machine, ratio)
    elif spreading:
        cause = "a tachometer whose delay or clock is wrong" if source.tachometer else "a speed that wanders"
        doubt = f"the lines of shafts and meshes spread over {spread:.2%} of their order, as with {cause}"
    elif rival >= CONFIRMED:
        doubt = f"the lines of the record indicate {words} instead"
    elif declared < (0.0 if source.tachometer else CONFIRMED):  # a tachometer has prior odds of as much
        doubt = (
            f"lines of shafts, meshes and bearings do not confirm the speed of {machine.reference}, "
            f"{machine.mean_speed_hz:.4g} Hz ({known})"
        )
    explained = ratio is not None or spreading or rival >= CONFIRMED
    unseen, unsure = comb.unseen([peaks for peaks, _ in spectra], machine, spread)
    every = [one for peaks, bands in spectra for one in (peaks, *bands)]
    misdrawn = comb.misdrawn(every, machine, spread, damaged)
    return Declaration(doubt=doubt, explained=explained, unseen=unseen, unsure=unsure, misdrawn=misdrawn)


def _rivals(machine: Machine) -> Iterator[tuple[str, float]]:
    """Yield the alternatives to a declaration, in words, with their speed over the declared one."""
    source = machine.source
    orders = {row.component: row.order for row in machine.defect_orders if row.kind == "shaft" and row.order > 0}
    counts = range(1, _MOST_PULSES + 1)
    for factor in sorted({one / other for one in counts for other in counts if one != other}):
        pulses = source.pulses_per_rev / factor
        as_declared = (
            f"pulses_per_rev={pulses:g} in place of {source.pulses_per_rev}"
            if source.tachometer and pulses == round(pulses)
            else f"{factor:.3g} times the speed of {machine.reference}"
        )
        yield as_declared, factor
    for shaft, order in orders.items():
        ratio = orders.get(source.shaft, 0.0) / order
        if ratio and abs(ratio - 1) > _NOMINAL and shaft != source.shaft:
            yield f'a speed that is declared for shaft "{source.shaft}" and is that of "{shaft}"', ratio


def _late_words(machine: Machine, ratio: float) -> str:
    """Return the cause of lines at a ratio of their order: ``delay * (change of speed) / turns``."""
    speeds, words = machine.speeds_hz, f"the lines of shafts and meshes lie at {ratio:.6g} times their order, as with "
    clock = f"a clock that is {1e6 * abs(ratio - 1):.0f} ppm off"
    change = float(speeds[-1] - speeds[0])
    late_s = (ratio - 1) * speeds.size / change if change else math.inf
    if not machine.source.tachometer or abs(late_s) > speeds.size / machine.mean_speed_hz:
        return words + clock
    which = "late" if late_s > 0 else "early"
    return f"{words}a tachometer that is {1000 * abs(late_s):.2g} ms {which} relative to the channel, or {clock}"


def _around(teeth: int) -> list[int]:
    return [teeth + more for more in range(-_TEETH, _TEETH + 1) if more and teeth + more > 0]


class _Comb:
    """Line families of a machine: meshes and shafts in its spectrum, bearings in its envelopes."""

    def __init__(self, machine: Machine, slip: float) -> None:
        rows = machine.defect_orders
        self.slip = slip
        self.meshes = sorted({row.order for row in rows if row.kind == "gear_mesh"}, reverse=True)
        self.shafts = sorted({row.order for row in rows if row.kind == "shaft" and row.order > 0}, reverse=True)
        self.top = max(len(_MESH) * max(self.meshes, default=0.0), len(_SHAFT) * max(self.shafts, default=0.0))
        self.bearings = sorted({row.order for row in rows if row.kind in BEARING_KINDS and row.order > 0})

    def of_lines(self, peaks: _Peaks, ratios: Numbers, spread: float) -> Numbers:
        """Return the logarithm of the evidence of shafts and meshes in an order spectrum, at neighbouring ratios."""
        total = np.zeros(ratios.size)
        for lines, shares in self._families(peaks, float(ratios[0]), spread):
            orders = np.outer(ratios / ratios[0], lines)
            total += _if_it_shows(_VISIBLE, peaks.log_evidence(orders, peaks.half(orders, spread), shares))
        return total

    def _families(self, peaks: _Peaks, ratio: float, spread: float) -> Iterator[tuple[Numbers, Numbers]]:
        """Yield the lines of each mesh and shaft in a spectrum that differ from preceding ones, and their shares."""
        taken = np.zeros(0)
        for order, shares in [*((one, _MESH) for one in self.meshes), *((one, _SHAFT) for one in self.shafts)]:
            lines: Numbers = order * ratio * np.arange(1.0, len(shares) + 1, dtype=np.float64)
            apart = (np.abs(lines[:, None] - taken) > 2 * peaks.half(lines, spread)[:, None]).all(axis=1)
            used = apart & (lines < peaks.end) & (order * ratio >= _FEWEST_BINS * peaks.bin_width)
            if used.any():
                taken = np.concatenate([taken, lines[used]])
                yield lines[used], np.array(shares, dtype=np.float64)[used]

    def unseen(self, spectra: Sequence[_Peaks], machine: Machine, spread: float) -> tuple[str, tuple[str, ...]]:
        """Return the meshes of which no spectrum shows a line, in words, and the parts on shafts known by them alone.

        Where planets pass the sensor, the lines of their mesh are multiples of the passes next to its harmonics, which
        may vanish themselves (McFadden and Smith 1985). Several planets on a carrier at rest are left out.
        """
        rows, turns = machine.defect_orders, np.arange(1.0, 1 + len(_MESH))

        def shown(lines: Numbers, shares: Sequence[float]) -> float:
            return max(
                float(peaks.log_evidence(lines, peaks.half(lines, spread), np.array(shares) * (lines < peaks.end)))
                if _FEWEST_BINS * peaks.bin_width <= lines[0] < peaks.end
                else math.inf  # it is not known
                for peaks in spectra
            )

        carriers = {row.component: row.order for row in rows if row.kind == "shaft"}
        missing: dict[str, float] = {}
        turning = {row.component: [row.order] for row in rows if row.kind == "tooth"}
        unknown = []
        for row in (row for row in rows if row.kind == "gear_mesh"):
            lines, carrier = row.order * turns, carriers.get(row.seen_from, 0.0)
            families, passes = [lines], row.sources * carrier
            if row.sources > 1 and not carrier:
                continue
            if row.sources > 1:
                families += [passes * np.floor(lines / passes + 1e-6), passes * np.ceil(lines / passes - 1e-6)]
            if max(shown(one, _MESH) for one in families) < 0:
                missing[row.component] = row.order
                unknown += [carrier] * bool(carrier)
        on_them = {name: orders for name, orders in turning.items() if name.rpartition("/")[0] in missing}
        seen = [order for order in self.shafts if CONFIRMED <= shown(order * turns, _SHAFT) < math.inf]
        unknown += [order for (order,) in on_them.values()]
        unknown = [order for order in unknown if not np.isclose(order, [1 / machine.ratio, *seen]).any()]
        turning |= {one.name: [abs(one.inner_ring), abs(one.outer_ring)] for one in machine.bearings}
        unsure = {name for name, orders in turning.items() if any(np.isclose(one, unknown).any() for one in orders)}
        names = ", ".join(f'"{name}" ({order:.5g} orders)' for name, order in missing.items())
        words = f"no line of mesh {names} stands out: check the tooth numbers, or measure closer to it"
        return words if missing else "", tuple(sorted(unsure | on_them.keys()))

    def misdrawn(
        self, spectra: Sequence[_Peaks], machine: Machine, spread: float, damaged: Sequence[float]
    ) -> dict[str, str]:
        """Return the gear and the bearings of a shaft that turns as with another tooth number, and what shows that.

        The order of the last shaft of a train moves no mesh. Its lines in spectra and envelopes are compared with those
        of `_TEETH` teeth more or fewer, where these coincide with no other lines of the drawing.
        """
        rows, multiples = machine.defect_orders, np.arange(1.0, 1 + _MULTIPLES)
        meshes = {row.component: row.order for row in rows if row.kind == "gear_mesh"}
        drawn = np.outer([*self.shafts, *meshes.values(), *damaged], np.arange(1, 1 + 3 * _MULTIPLES)).ravel()

        def shown(order: float, others: Numbers) -> float:
            lines, found = order * multiples, [-math.inf]
            for peaks in spectra:
                half = peaks.half(lines, spread)
                used = (np.abs(lines[:, None] - others) > 2 * half[:, None]).all(axis=1) & (lines < peaks.end)
                if order >= _FEWEST_BINS * peaks.bin_width and 2 * used.sum() >= _MULTIPLES:
                    found.append(float(peaks.log_evidence(lines[used], half[used], np.full(used.sum(), 0.5))))
            return max(found)

        turning = {row.component: row.order for row in rows if row.kind == "tooth"}
        for component, order in turning.items():
            gears = np.isclose(order, [*turning.values()]).sum()
            if gears > 1 or np.isclose(order * machine.ratio, 1) or not np.isclose(order, self.shafts).any():
                continue
            teeth = round(meshes[component.rpartition("/")[0]] / order)
            near = [teeth + more for more in range(-_TEETH, _TEETH + 1) if more and teeth + more > 0]
            most, z = max((shown(order * teeth / one, drawn), one) for one in near)
            own = shown(order, drawn[~np.isclose(drawn / order, np.round(drawn / order))])
            if most - math.log(len(near)) >= CONFIRMED and most - own >= CONTRADICTED:
                words = f'as if "{component}" had {z} teeth in place of {teeth}: check its tooth number'
                beside = [one.name for one in machine.bearings if np.isclose(abs(one.relative), order)]
                at = f"lines stand at multiples of {order * teeth / z:.5g} orders, "
                return dict.fromkeys((component, *beside), at + words)
        return {}

    def of_bearings(self, spectra: Sequence[tuple[_Peaks, list[_Peaks]]], ratio: float) -> float:
        """Return the logarithm of the evidence of a damaged bearing in any one of the envelopes of one channel."""
        found = [
            [self._of_bearing(one, order * ratio) for one in bands for order in self.bearings] for _, bands in spectra
        ]
        means = [float(np.logaddexp.reduce(one)) - math.log(len(one)) if one else 0.0 for one in found]
        return max(float(_if_it_shows(_DAMAGED, mean)) for mean in means)

    def shown_ratio(
        self, spectra: Sequence[tuple[_Peaks, list[_Peaks]]], declared: float, *, reach: float, path: float
    ) -> float | None:
        """Return the ratio of the measured to the declared speed within a range; None if uncertain.

        It must be significant for the number of speeds tried, and no other may be as likely.
        """
        finest = min(_HALF_BINS * peaks.bin_width / min(peaks.end, self.top) for peaks, _ in spectra)
        ratios = 1 + np.arange(-reach, reach, max(finest, 2 * reach / _MOST_SPEEDS))
        coarse = np.linspace(1 - reach, 1 + reach, 2 + round(4 * reach / self.slip))
        bearings = [self.of_bearings(spectra, ratio) for ratio in coarse.tolist()]
        of_bearings = np.interp(ratios, coarse, bearings)
        found = {
            spread: of_bearings + np.max([self.of_lines(peaks, ratios, spread) for peaks, _ in spectra], axis=0)
            for spread in _SPREADS
        }
        spread = max(found, key=lambda one: float(found[one].max()))
        total = found[spread]
        best = int(np.argmax(total))
        others = total[np.abs(ratios / ratios[best] - 1) > max(2 * spread, _SAME_SPEED)]
        searched = float(total[best]) - math.log(ratios.size)
        shows = searched >= CONFIRMED and searched - declared >= CONTRADICTED
        another = abs(ratios[best] - 1) > max(spread / 2, path)
        return float(ratios[best]) if shows and another and total[best] - others.max() >= CONFIRMED else None

    def _of_bearing(self, peaks: _Peaks, order: float) -> float:
        """Return the evidence of a component's harmonics: its largest peak within the slip, and multiples of that."""
        shares, within = np.array(_BEARING), np.abs(peaks.places - order) <= peaks.half(np.array(order), self.slip)
        if order > peaks.end or not within.any():
            return float(np.log1p(-shares).sum())
        main = peaks.places[within][np.argmax(peaks.sizes[within])]
        lines = main * np.arange(1.0, shares.size + 1)
        half = peaks.half(lines, 0.0)
        half[0] = max(half[0], self.slip * order)
        used = lines < peaks.end
        return float(peaks.log_evidence(lines[used], half[used], shares[used]))
