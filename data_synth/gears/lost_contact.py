"""Load sharing between pairs of teeth under a static load where one has lost material or stiffness.

Pairs in contact share the static force F as springs k_i, each with a gap g_i equal to the material lost there:

    F = sum_i k_i max(0, d - g_i)

so a pair carries load only where its gap is less than the deflection d at which the others carry all of F. The loaded
pairs give the mesh the stiffness ``k = sum k_i`` and the transmission error ``e = sum k_i g_i / k``. A pair that has
lost material over part of its face is two springs, one of them without a gap. If only one pair is on the path of
contact, it deflects no further than to the point where a neighbour makes contact off the path, at the tip of a tooth;
the gap there is the separation of the flanks (`separation_m`).

References
----------
R. W. Munro, L. Morrish, D. Palmer, Gear transmission error outside the normal path of contact due to corner and top
contact, Proc. IMechE C 213 (1999): contact off the path. A. Flodin, S. Andersson, Simulation of mild wear in spur
gears, Wear 207 (1997) 16-23: wear by Archard's law, none at the pitch point. The parabola on which a flank drops into a
gap between two edges is elementary geometry.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from data_synth.gears.geometry import GearPair
from data_synth.gears.mesh_stiffness import Array
from data_synth.gears.tooth_compliance import DamagedTooth, ToothPair
from data_synth.gears.transmission_error import ProfileError, TransmissionError

_POINTS = 1025  # along the path of contact
_NEAR_PATH = 1e-3  # base pitches
_FAR_M = 1.0  # a gap that no deflection closes
_STEEP = 0.03  # of the range of the error, between neighbouring points: such points are all knots
_EDGE = 1e-9  # cycles: either side of the end of contact
_SLICES = 32  # of a crowned face
_NEAR_BASE = 0.1  # of the radius of curvature at the pitch point: specific sliding is unbounded at the base circle

Gap = Callable[[Array], Array]
"""Material lost along the line of action in m, `since` (n,) cycles after the pair entered."""


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Result of load sharing while one pair is damaged.

    Attributes
    ----------
    pair_n_m : (n,) array
        Stiffness in N/m of the pair, 0 where it is unloaded, or of the neighbour that makes contact off the path
        instead.
    error_m : (n,) array
        Transmission error e of the loaded pairs, m.
    deflection_m : (n,) array
        Static deflection d, m.
    """

    pair_n_m: Array = field(metadata={"dims": ("path",), "units": "N/m"})
    error_m: Array = field(metadata={"dims": ("path",), "units": "m"})
    deflection_m: Array = field(metadata={"dims": ("path",), "units": "m"})


@dataclass(frozen=True, kw_only=True)
class LoadSharing:
    """Pairs of teeth under a static force.

    Attributes
    ----------
    gears : GearPair
    pair_compliance : callable
        Compliance of a healthy pair in m/N as a function of the cycles (n,) since it entered.
    static_n : float
        Static force along the line of action, N.
    most_m : float
        Upper limit of a gap, m: the backlash, where declared.
    teeth : ToothPair or None
        The teeth, where the stiffness follows from their strain energy.
    scale : float
        Factor of their compliance.
    modification : FlankModification or None
        Flank modification of all pairs.
    """

    gears: GearPair
    pair_compliance: Callable[[Array], Array] = field(repr=False)
    static_n: float
    most_m: float = math.inf
    teeth: ToothPair | None = field(default=None, repr=False)
    scale: float = 1.0
    modification: "FlankModification | None" = None

    def shared(
        self,
        since: ArrayLike,
        *,
        gap: Gap,
        gap_share: float = 1.0,
        softer: Gap | None = None,
        others: Gap | None = None,
        others_share: float = 1.0,
    ) -> "Shared":
        """Return how the pairs share the static force while one of them is damaged.

        Parameters
        ----------
        since : (n,) array
            Cycles since the damaged pair entered.
        gap : callable
            Its gap.
        gap_share : float
            Share of its face width that has the gap.
        softer : callable or None
            Compliance added by its damage, m/N.
        others : callable or None
            Gap of all other pairs; None: they are healthy.
        others_share : float
            Share of the face width over which they are in contact.
        """
        at = np.asarray(since, dtype=np.float64)
        healthy, relief = 1 / self.pair_compliance(at), self.relief_m(at)
        own = healthy if softer is None else 1 / (1 / healthy + softer(at))
        springs, gaps = [gap_share * own, (1 - gap_share) * own], [np.minimum(gap(at) + relief, self.most_m), relief]
        count, alone = math.ceil(self.gears.contact_ratio), np.ones(at.size, dtype=np.bool_)
        for number in (*range(-count, 0), *range(1, count + 1)):
            place = at + number
            on_path = (place >= 0) & (place < self.gears.contact_ratio)
            clipped = np.clip(place, 0.0, self.gears.contact_ratio)
            springs.append(np.where(on_path, others_share / self.pair_compliance(clipped), 0.0))
            gaps.append(self.relief_m(clipped) + (others(clipped) if others is not None else 0.0))
            alone &= ~on_path
        carrying, error, deflection = self._carried(np.array(springs), np.array(gaps))
        # a pair alone on the path carries everything, or a neighbour off the path does, whichever deflects less
        off_path = np.minimum(self.off_path_m(at, others), self.most_m)
        instead = alone & (off_path + self.static_n / (others_share * healthy) < deflection)
        return Shared(
            pair_n_m=np.where(instead, others_share * healthy, carrying[:2].sum(axis=0)),
            error_m=np.where(instead, off_path, error),
            deflection_m=np.where(instead, off_path + self.static_n / (others_share * healthy), deflection),
        )

    def relief_m(self, since: Array) -> Array:
        """Return the tip relief (n,) of a pair in m; zero without modification."""
        return np.zeros(since.shape) if self.modification is None else self.modification.relief_m(self.gears, since)

    def _carried(self, springs: Array, gaps: Array) -> tuple[Array, Array, Array]:
        """Return the loaded springs (m, n), their transmission error (n,) and the static deflection (n,).

        The force is the maximum of ``sum k_i (d - g_i)`` over all sets of springs, so the deflection is the minimum
        over all sets, reached by a set of the smallest gaps. Crowned flanks are slices, each with its own gap.
        """
        if self.modification is not None:
            gaps = (gaps + self.modification.slices_m[:, None, None]).reshape(-1, gaps.shape[1])
            springs = np.tile(springs / _SLICES, (_SLICES, 1))
        order = np.argsort(gaps, axis=0)
        stiffness = np.cumsum(np.take_along_axis(springs, order, axis=0), axis=0)
        pulls = np.cumsum(np.take_along_axis(springs * gaps, order, axis=0), axis=0)
        every = np.divide(self.static_n + pulls, stiffness, out=np.full(gaps.shape, np.inf), where=stiffness > 0)
        sunk = np.min(every, axis=0)
        carrying = np.where(gaps <= (1 + 1e-12) * sunk, springs, 0.0)
        total = np.sum(carrying, axis=0)
        error = np.divide(np.sum(carrying * gaps, axis=0), total, out=sunk.copy(), where=total > 0)
        if self.modification is not None:
            carrying = carrying.reshape(_SLICES, -1, carrying.shape[1]).sum(axis=0)
        return carrying, error, sunk

    def off_path_m(self, since: Array, others: Gap | None = None) -> Array:
        """Return the gap (n,) in m of the neighbour nearest to contact off the path."""
        ends = np.array([0.0, self.gears.contact_ratio])
        entering, leaving = self.relief_m(ends) + (others(ends) if others is not None else 0.0)
        ahead = np.maximum(since + 1 - self.gears.contact_ratio, 0.0)
        behind = np.maximum(1 - since, 0.0)
        nearest: Array = np.minimum(
            leaving + separation_m(self.gears, ahead, leaving=True),
            entering + separation_m(self.gears, behind, leaving=False),
        )
        return nearest


def separation_m(gears: GearPair, beyond_cycles: ArrayLike, *, leaving: bool) -> Array:
    """Return the separation of a pair along the line of action beyond the ends of the path of contact.

    The tip of one gear parts from the flank of the other: that of the first gear after the pair leaves, that of the
    second before it enters. At the radius of the tip the other flank is ahead by an angle; the separation is this angle
    times the base radius of that flank's gear.

    Parameters
    ----------
    gears : GearPair
    beyond_cycles : (n,) array
        Cycles after the end of contact, or before its start.
    leaving : bool
        Whether it is the end.

    Returns
    -------
    (n,) array
        m.

    Examples
    --------
    A tenth of a base pitch off the path, teeth of module 3 mm are about 12 um apart:

    >>> import math
    >>> from data_synth.gears.geometry import GearPair
    >>> from data_synth.gears.lost_contact import separation_m
    >>> pair = GearPair(teeth=(23, 67), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=math.radians(20))
    >>> f"{1e6 * separation_m(pair, 0.1, leaving=True):.1f} um"
    '12.3 um'
    """
    tip, flank = (0, 1) if leaving else (1, 0)
    path = np.asarray(beyond_cycles, dtype=np.float64) * gears.base_pitch_m
    bases, outer = gears.base_radii_m, gears.tip_radii_m[tip]
    # centre of the flank's gear, from that of the tip's gear towards the pitch point
    centre = gears.centre_distance_m * (-1.0 if gears.teeth[1] < 0 and tip == 0 else 1.0)
    start = abs(math.acos(bases[tip] / outer) - gears.working_angle_rad)

    def tip_seen_from_flank(travel: Array) -> tuple[Array, Array]:
        """Return the angle of the tip about the flank's gear and the involute angle at the tip's radius."""
        turned = start + travel / bases[tip]
        across, along = outer * np.sin(turned), np.abs(centre - outer * np.cos(turned))
        cosine = np.minimum(bases[flank] / np.hypot(across, along), 1.0)
        return np.arctan2(across, along) - travel / bases[flank], np.sqrt(1 / cosine**2 - 1) - np.arccos(cosine)

    (turn, roll), (begin, at) = tip_seen_from_flank(path), tip_seen_from_flank(np.zeros(()))
    # close to the path the flank rotates with the tip to first order, which tells which flank it is
    (near, rolled) = tip_seen_from_flank(np.asarray(_NEAR_PATH * gears.base_pitch_m))
    sign = 1.0 if abs(near - begin + rolled - at) < abs(near - begin - rolled + at) else -1.0
    return np.asarray(bases[flank] * np.abs(turn - begin + sign * (roll - at)))


@dataclass(frozen=True, kw_only=True)
class FlankModification:
    """Tip relief and crowning of all teeth of a pair of gears.

    Attributes
    ----------
    relief_tip_m : float
        Relief in m at each tip along the line of action, linear from its start (Harris 1958, Proc. IMechE 172, 87).
    relief_pitches : float or None
        Length of the relief along the path of contact, in base pitches. None: "long" relief, from the highest point of
        single-tooth contact to the tip; with a relief of ``F / k`` of a pair it makes the deflection constant under the
        force F.
    crowning_m : float
        Relief in m at both ends of the face width, parabolic across it.
    """

    relief_tip_m: float = 0.0
    relief_pitches: float | None = None
    crowning_m: float = 0.0

    @property
    def slices_m(self) -> Array:
        """Gaps in m of equal slices of half the face width."""
        return self.crowning_m * ((np.arange(_SLICES) + 0.5) / _SLICES) ** 2

    def relief_m(self, gears: GearPair, since: Array) -> Array:
        """Return the tip relief (n,) of a pair in m, `since` (n,) cycles after it entered."""
        ratio = gears.contact_ratio
        length = self.relief_pitches or min(ratio - 1, ratio / 2)
        return np.asarray(self.relief_tip_m * np.maximum(1 - np.minimum(since, ratio - since) / length, 0.0))


# ---- Gaps: material lost from the flank of one tooth against the cycles since its pair entered -----------------------


def _curvature_radii_m(pair: GearPair, since: Array) -> tuple[Array, Array]:
    """Return the radii of curvature of both flanks at contact, (n,) in m; that of an internal gear is negative."""
    on_path = pair.path_m[0] + since * pair.base_pitch_m
    whole = pair.centre_distance_m * math.sin(pair.working_angle_rad)
    second = whole - on_path if pair.teeth[1] > 0 else -(whole + on_path)
    return on_path, second


def spall_gap(pair: GearPair, gear: int, *, depth_m: float, length_pitches: float, across: bool = True) -> Gap:
    """Return the gap of a spall in the middle of the path of contact, on the flank of one gear.

    The flanks carry load beside a spall narrower than the face width, whose gap is its depth. Into a spall across the
    whole face width, the mating flank, of relative radius of curvature rho, drops over its edges by ``(L / 2 - |s|)^2 /
    (2 rho)`` at a distance s from the middle, so by ``L^2 / (8 rho)`` in the middle, limited to the depth. The length L
    on the flank is that on the path of contact times the flank's radius of curvature over the base radius, by which the
    contact moves faster on the flank.

    Parameters
    ----------
    pair : GearPair
    gear : int
        0 or 1: whose tooth it is.
    depth_m : float
    length_pitches : float
        Length along the path of contact, in base pitches.
    across : bool
        Whether it spans the face width.
    """
    middle = pair.contact_ratio / 2
    own, other = (float(part) for part in _curvature_radii_m(pair, np.array(middle))[:: 1 if gear == 0 else -1])
    relative = abs(1 / (1 / own + 1 / other))
    scale = abs(own) / pair.base_radii_m[gear] * pair.base_pitch_m

    def gap(since: Array) -> Array:
        from_edge = np.maximum(length_pitches / 2 - np.abs(since - middle), 0.0) * scale
        return np.minimum(depth_m, from_edge**2 / (2 * relative)) if across else np.where(from_edge > 0, depth_m, 0.0)

    return gap


def pitted_share(pair: GearPair, *, length_pitches: float) -> float:
    """Return the share of the face width of a spall of given length that covers 4 % of the active flank.

    That is the criterion for pitting of case-hardened teeth in the test of FVA information sheet 2/IV (1997).
    """
    return 0.04 * pair.contact_ratio / length_pitches


def broken_tip_gap(pair: GearPair, gear: int, *, height_m: float) -> Gap:
    """Return the gap of a tooth with a height broken off its tip: zero on the remaining flank, unbounded beyond."""
    radius = pair.tip_radii_m[gear] - math.copysign(height_m, pair.teeth[gear])
    base, (begin, _) = pair.base_radii_m[gear], pair.path_m
    reach = math.sqrt(max(radius**2 - base**2, 0.0))
    if gear == 0:
        left = (reach - begin) / pair.base_pitch_m
        return lambda since: np.where(since < left, 0.0, _FAR_M)
    between = pair.centre_distance_m * math.sin(pair.working_angle_rad)
    entered = (between - reach if pair.teeth[1] > 0 else reach - between) - begin
    return lambda since: np.where(since > entered / pair.base_pitch_m, 0.0, _FAR_M)


def wear_gap(pair: GearPair, gear: int, *, depth_m: float) -> Gap:
    """Return the gap of a worn flank: Archard's depth, zero at the pitch point and `depth_m` at most.

    A point of a flank rolling at the speed u against one at v slides by ``2 a |u - v| / u`` in each contact of half
    width a (Flodin and Andersson 1997). Its load is taken as constant, since a worn pair sheds load to others. Sliding
    is unbounded at the base circle; below a tenth of the radius of curvature at the pitch point it is limited.
    """

    def sliding(since: Array) -> Array:
        one, two = (np.abs(part) for part in _curvature_radii_m(pair, since))
        pitch = np.array(pair.base_radii_m) * math.tan(pair.working_angle_rad)
        speeds = one / pair.base_radii_m[0], two / pair.base_radii_m[1]
        own, other = speeds if gear == 0 else speeds[::-1]
        floor = _NEAR_BASE * pitch[gear] / pair.base_radii_m[gear]
        return np.asarray(np.abs(own - other) / np.maximum(own, floor))

    most = float(np.max(sliding(np.linspace(0, pair.contact_ratio, _POINTS))))
    return lambda since: depth_m * sliding(since) / most


# ---- Effect of a gap on the mesh -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LostContact:
    """Damage to one tooth, or equally to all teeth of a gear: lost load and transmission error.

    It is a `data_synth.gears.tooth_compliance.ToothFault`.

    Attributes
    ----------
    sharing : LoadSharing
    gap : callable
    gap_share : float
        Share of the face width that has the gap.
    face_share : float
        Share of the face width in contact; stiffness is proportional to it.
    others_share : float
        The same for the neighbours.
    added : callable or None
        Compliance added to the pair, m/N.
    every : bool
        Whether all teeth of the gear are alike.
    modified : bool
        Whether this is the flank modification itself, compared with unmodified involutes.
    """

    sharing: LoadSharing
    gap: Gap = field(default=np.zeros_like, repr=False)
    gap_share: float = 1.0
    face_share: float = 1.0
    others_share: float = 1.0
    added: Gap | None = field(default=None, repr=False)
    every: bool = False
    modified: bool = False

    def _softer(self, since: Array) -> Array:
        with np.errstate(divide="ignore"):
            softer = np.asarray((np.divide(1.0, self.face_share) - 1) * self.sharing.pair_compliance(since))
        return softer if self.added is None else softer + self.added(since)

    def _at(self, since: Array) -> Shared:
        others = self.gap if self.every else None
        return self.sharing.shared(
            since,
            gap=self.gap,
            gap_share=self.gap_share,
            softer=self._softer,
            others=others,
            others_share=self.others_share,
        )

    @cached_property
    def _path(self) -> tuple[Array, Shared, Shared]:
        """Return phases (n,) since the pair entered, and load sharing there with and without the fault."""
        ratio = self.sharing.gears.contact_ratio
        # on either side of where a pair enters or leaves and the load jumps
        ends = [end for whole in range(math.ceil(ratio) + 1) for end in (float(whole), ratio - whole)]
        sides = [end + side for end in ends for side in (-_EDGE, _EDGE)]
        since = np.unique(np.clip([*np.linspace(0, ratio, _POINTS), *sides], 0.0, ratio - _EDGE))
        sound = replace(self.sharing, modification=None) if self.modified else self.sharing
        return since, self._at(since), sound.shared(since, gap=np.zeros_like)

    @cached_property
    def _changes(self) -> tuple[int, ...]:
        """Indices of the points after which the pair takes up or sheds load."""
        since, *both = self._path
        shares = [shared.pair_n_m * self.sharing.pair_compliance(since) for shared in both]
        return tuple(np.flatnonzero(np.max(np.abs(np.diff(shares)), axis=0) > _STEEP).tolist())

    def jump_phases(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002 - as other faults
        """Return phases after the pair entered at which its stiffness jumps."""
        since = self._path[0]
        return tuple(float(since[at] + since[at + 1]) / 2 for at in self._changes)

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return the added compliance (n,) of the pair in m/N; inf where it is unloaded."""
        since, *both = self._path
        edges = np.array(self.jump_phases(pair, gear))
        # interpolate within the segments between jumps only
        found, segment = np.empty((2, *phase_cycles.shape)), np.searchsorted(edges, phase_cycles, side="right")
        of = np.searchsorted(edges, since, side="right")
        for row, shared in zip(found, both, strict=True):
            for number in np.unique(segment):
                here, known = segment == number, of == number
                share = shared.pair_n_m * self.sharing.pair_compliance(since)
                row[here] = np.interp(phase_cycles[here], since[known], share[known])
        with np.errstate(divide="ignore", invalid="ignore"):
            more = (1 / found[0] - 1 / found[1]) * self.sharing.pair_compliance(phase_cycles)
        return np.where(found[1] == 0, 0.0, more)  # a pair that is unloaded anyway loses nothing

    def error(self, *, teeth: int, first: int, stiffness_too: bool) -> "PairError":
        """Return the transmission error caused by the gap.

        Parameters
        ----------
        teeth : int
            Number of teeth of the gear.
        first : int
            Phase at which the tooth enters, cycles.
        stiffness_too : bool
            Whether the mesh stiffness itself drops where the pair is unloaded; otherwise the error includes that part
            of the static deflection.
        """
        since, shared, sound = self._path
        error = shared.error_m - sound.error_m if stiffness_too else shared.deflection_m - sound.deflection_m
        if self.every:  # in each cycle the pair that entered last represents all
            since, error = (part[since < 1] for part in (since, error))
        kept = np.arange(since.size) % 8 == 0  # knots, where it is smooth
        kept[[0, -1]] = True
        steep = np.abs(np.diff(error)) > _STEEP * np.ptp(error)
        steep[[at for at in self._changes if at < steep.size]] = True
        kept[:-1] |= steep
        kept[1:] |= steep
        return PairError(
            period=1 if self.every else teeth, first=first % teeth, knots_cycles=since[kept], error_m=error[kept]
        )


def modified_teeth(sharing: LoadSharing | None) -> list[DamagedTooth]:
    """Return the change of pair stiffness by flank modification as a fault of all teeth; empty without modification."""
    if sharing is None or sharing.modification is None:
        return []
    return [DamagedTooth(gear=0, tooth=None, fault=LostContact(sharing=sharing, every=True, modified=True))]


def modification_errors(
    sharing: LoadSharing | None, *, stiffness_too: bool, overlap_ratio: float
) -> list[TransmissionError]:
    """Return the transmission errors of modified flanks; for helical gears a series, the mean over the face width."""
    if sharing is None or sharing.modification is None:
        return []
    own = LostContact(sharing=sharing, every=True, modified=True)
    error = own.error(teeth=1, first=0, stiffness_too=stiffness_too)
    if not overlap_ratio:
        return [error]
    lines = np.fft.rfft(error(np.arange(_POINTS) / _POINTS)) / _POINTS
    harmonics = np.arange(1, 9)
    turns = harmonics * overlap_ratio
    return [ProfileError(harmonics_m=2 * lines[harmonics] * np.sinc(turns) * np.exp(-1j * np.pi * turns))]


@dataclass(frozen=True, kw_only=True)
class PairError:
    """Transmission error while one pair of teeth is in contact, linear between knots and zero elsewhere.

    Attributes
    ----------
    period : int
        Period in mesh cycles; 1: all teeth are alike.
    first : int
        Phase at which the pair enters, cycles.
    knots_cycles : (n,) array
        Cycles since it entered, increasing from zero.
    error_m : (n,) array
        Error at the knots, m.
    """

    period: int
    first: int
    knots_cycles: Array = field(metadata={"dims": ("knot",), "units": "cycles"})
    error_m: Array = field(metadata={"dims": ("knot",), "units": "m"})

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases in [0, period), increasing, at which its slope changes."""
        return tuple(np.unique(np.remainder(self.knots_cycles + self.first, self.period)).tolist())

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the error in m at phases in mesh cycles, any shape."""
        phase = np.asarray(phase_cycles, dtype=np.float64) - self.first
        total, within = np.zeros_like(phase), np.remainder(phase, self.period)
        right = 0.0 if self.period > 1 else None  # all alike: the next pair takes over
        for earlier in range(math.ceil(float(self.knots_cycles[-1]) / self.period)):
            total += np.interp(within + earlier * self.period, self.knots_cycles, self.error_m, right=right)
        return total


def closed_cycles(rows: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """Return rows of mesh cycles and measured error unchanged; raise ValueError if they cannot be periodic."""
    (first, begin), (last, end) = rows[0], rows[-1]
    if first or last < 1 or last % 1 or begin != end:
        raise ValueError(
            f"goes from {begin:g} at {first:g} to {end:g} at {last:g} cycles; let it begin at 0 cycles and return to "
            "its first value after a whole number of them"
        )
    return rows


def declared_errors(error_m: float, measured_um: tuple[tuple[float, float], ...] | None) -> list[TransmissionError]:
    """Return the errors of a mesh: a first harmonic of amplitude `error_m`, and rows of mesh cycles and error in um."""
    found: list[TransmissionError] = [ProfileError(harmonics_m=np.array([error_m + 0j]))] if error_m else []
    if measured_um is not None:
        cycles, error_um = np.array(measured_um).T
        found.append(PairError(period=round(cycles[-1]), first=0, knots_cycles=cycles, error_m=1e-6 * error_um))
    return found
