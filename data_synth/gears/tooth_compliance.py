"""Stiffness of a spur gear mesh from the strain energy of its teeth.

A tooth is a cantilever from its root circle. A load F at a point of the involute, at the load angle b to the normal of
the tooth's centre line, stores energy in bending, shear and compression of the tooth, in the gear body and in the
contact. Each is ``F^2 / 2k``, so the compliances add up:

    1/k_b = int (cos b (y_F - y) - x_F sin b)^2 / (E I) dy,   1/k_s = int 1.2 cos^2 b / (G A) dy,
    1/k_a = int sin^2 b / (E A) dy,   k_h = pi E L / (4 (1 - nu^2))

with x half the thickness at the height y, ``A = 2 x L`` and ``I = 2 x^3 L / 3``.

References
----------
D. C. H. Yang, J. Y. Lin, Hertzian damping, tooth friction and bending elasticity in gear impact dynamics, J. Mech.
Transm. Autom. Des. 109 (1987): the method. X. Tian (2004): shear. H. Ma, R. Song, X. Pang, B. Wen, Time-varying mesh
stiffness calculation of cracked spur gears, Eng. Fail. Anal. 44 (2014): root circle and fillet. P. Sainsot, P. Velex,
O. Duverger, Contribution of gear body to tooth deflections, J. Mech. Des. 126 (2004) 748-752: the body.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.gears.geometry import GearPair, require
from data_synth.gears.mesh_stiffness import Array, Fourier, Stiffness, fourier_series, quadrature

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_SAINSOT = {
    "L": (-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045),
    "M": (60.111e-5, 28.1e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086),
    "P": (-50.952e-5, 185.5e-3, 0.0538e-4, 53.3e-3, 0.2895, 0.9236),
    "Q": (-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904),
}
_BISECTIONS = 60


@dataclass(frozen=True, kw_only=True)
class CrackedSection:
    """The cracked half of a tooth: from the height `tip_m` upwards its thickness is at most `remaining_m`.

    Below the centre line of the tooth `remaining_m` is negative.
    """

    remaining_m: float
    tip_m: float

    def __call__(self, heights: Array, halves: Array) -> Array:
        """Return the remaining half thickness at heights, (n,) m, given the healthy one."""
        # further up, where the other half is thinner than the crack is deep, nothing would be left: a hundredth is
        return np.where(heights < self.tip_m, halves, np.maximum(np.minimum(halves, self.remaining_m), -0.99 * halves))


@dataclass(frozen=True, kw_only=True)
class Tooth:
    """One tooth of a spur gear cut by a rack with rounded tips, and the gear body under it.

    The fillet is the path of the rack's tip rounding, whose radius is the tip clearance over ``1 - sin(alpha)``; it
    meets the involute tangentially at the form circle.

    Attributes
    ----------
    teeth : int
    module_m, face_width_m, pressure_angle_rad : float
    bore_radius_m : float
        Radius at which the body is held on its shaft.
    addendum, clearance : float
        In modules.
    root_half_angle_rad : float or None
        Half the angle of the tooth at its root circle, in which the body's compliance is expressed. That of the fillet
        itself if left out. (The usual expression ``(pi/2 + 2 tan(alpha) (h - rho) + 2 rho / cos(alpha)) / z`` lacks the
        clearance beside the addendum h, and makes the pair of the tests 2.5 % softer.)
    young_pa, poisson : float
    """

    teeth: int
    module_m: float
    face_width_m: float
    pressure_angle_rad: float
    bore_radius_m: float
    addendum: float = 1.0
    clearance: float = 0.25
    root_half_angle_rad: float | None = None
    young_pa: float = 206e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        require(
            [
                ("module_m", self.module_m),
                ("face_width_m", self.face_width_m),
                ("bore_radius_m", self.bore_radius_m),
                ("teeth", self.teeth),
            ]
        )
        if not self.bore_radius_m < self.root_radius_m:
            raise ValueError(
                f"bore_radius_m = {self.bore_radius_m:.7g} is not below the root radius, {self.root_radius_m:.7g} m."
            )
        if self.radius_m * math.sin(self.pressure_angle_rad) ** 2 < self.addendum * self.module_m:
            least = 2 * self.addendum / math.sin(self.pressure_angle_rad) ** 2
            raise ValueError(
                f"teeth = {self.teeth}: below {least:.3g} teeth the rack cuts away the foot of the involute, which is "
                "not modelled here; use the mean stiffness of GearPair."
            )

    @property
    def radius_m(self) -> float:
        """Radius of the reference circle."""
        return self.module_m * self.teeth / 2

    @property
    def base_radius_m(self) -> float:
        """Radius of the base circle."""
        return self.radius_m * math.cos(self.pressure_angle_rad)

    @property
    def root_radius_m(self) -> float:
        """Radius of the root circle."""
        return self.radius_m - (self.addendum + self.clearance) * self.module_m

    @property
    def form_angle_rad(self) -> float:
        """Pressure angle where the involute begins."""
        slope = math.tan(self.pressure_angle_rad) - self.addendum * self.module_m / (
            self.base_radius_m * math.sin(self.pressure_angle_rad)
        )
        return math.atan(slope)

    @property
    def _base_half_angle(self) -> float:
        angle = self.pressure_angle_rad
        return math.pi / (2 * self.teeth) + math.tan(angle) - angle

    @property
    def _rack_tip(self) -> tuple[float, float, float]:
        """Radius of the rack's tip rounding, depth of its centre, and its offset from the centre line of the tooth."""
        angle, module = self.pressure_angle_rad, self.module_m
        radius = self.clearance * module / (1 - math.sin(angle))
        centre_depth = (self.addendum + self.clearance) * module - radius
        return radius, centre_depth, math.pi * module / 4 + centre_depth * math.tan(angle) + radius / math.cos(angle)

    @cached_property
    def _whole_fillet(self) -> tuple[Array, Array, Array]:
        """Half thicknesses, heights and weights at the nodes of the whole fillet."""
        return self._fillet(math.pi / 2, self.pressure_angle_rad)

    def _cut_fillet(self, height: float) -> tuple[Array, Array, Array]:
        """Return those nodes in two intervals that meet at a height, where a crack begins."""
        root, top = math.pi / 2, self.pressure_angle_rad
        low, high = root, top
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.fillet_at(np.array(middle))[1] < height else (low, middle)
        parts = zip(self._fillet(root, low), self._fillet(low, top), strict=True)
        half, heights, weights = (np.concatenate(pair) for pair in parts)
        return half, heights, weights

    def _fillet(self, start: float, stop: float) -> tuple[Array, Array, Array]:
        """Return half thicknesses, heights and weights in dy at the nodes of a part of the fillet, (n,) each."""
        slope, weight = _interval(start, stop)
        half, height, rate = self.fillet_at(slope)
        return half, height, weight * rate

    def fillet_at(self, slope: Array) -> tuple[Array, Array, Array]:
        """Return half thickness, height and its derivative by the rack tip's slope, pi/2 at the root, alpha on top."""
        radius, centre_depth, centre_offset = self._rack_tip
        turn, turn_rate = (
            (centre_depth / np.tan(slope) + centre_offset) / self.radius_m,
            -centre_depth / np.sin(slope) ** 2 / self.radius_m,
        )
        trace_radius, reach_rate = (
            centre_depth / np.sin(slope) + radius,
            -centre_depth * np.cos(slope) / np.sin(slope) ** 2,
        )
        half = self.radius_m * np.sin(turn) - trace_radius * np.cos(slope - turn)
        height = self.radius_m * np.cos(turn) - trace_radius * np.sin(slope - turn)
        rate = (
            -self.radius_m * np.sin(turn) * turn_rate
            - reach_rate * np.sin(slope - turn)
            - trace_radius * np.cos(slope - turn) * (1 - turn_rate)
        )
        return half, height, rate

    def involute_at(self, load_angle: Array) -> tuple[Array, Array, Array]:
        """Return half thickness, height and its derivative by the load angle b at that point."""
        base, swept = self.base_radius_m, load_angle + self._base_half_angle
        half = base * (swept * np.cos(load_angle) - np.sin(load_angle))
        height = base * (swept * np.sin(load_angle) + np.cos(load_angle))
        return half, height, base * swept * np.cos(load_angle)

    def compliance(self, angle_rad: Array, *, remaining: CrackedSection | None = None) -> Array:
        """Return the compliance of tooth and body under loads at pressure angles on the involute, (n,) m/N.

        `remaining` gives the remaining thickness of the cracked loaded half; compression closes the crack.
        """
        load_angle = np.tan(np.atleast_1d(angle_rad)) - self._base_half_angle
        return self._beam(load_angle[:, None], remaining) + self._body(load_angle)

    def lever_arm_m(self, angle_rad: Array, *, height_m: float) -> Array:
        """Return the lever arm of loads at pressure angles on the involute about a height of the centre line, (n,)."""
        load_angle = np.tan(np.atleast_1d(angle_rad)) - self._base_half_angle
        at_half, at_height, _ = self.involute_at(load_angle)
        return np.asarray(np.cos(load_angle) * (at_height - height_m) - at_half * np.sin(load_angle))

    def _beam(self, load_angle: Array, remaining: CrackedSection | None) -> Array:
        """Return the compliance of the tooth alone, (n,), for load angles (n, 1)."""
        at_half, at_height, _ = self.involute_at(load_angle)
        nodes, weights = _interval(math.tan(self.form_angle_rad) - self._base_half_angle, load_angle)
        above = self.involute_at(nodes)
        foot = self._whole_fillet if remaining is None else self._cut_fillet(remaining.tip_m)
        feet = [np.broadcast_to(part, (load_angle.shape[0], part.size)) for part in foot]
        half, height = (np.hstack([below, on]) for below, on in zip(feet[:2], above[:2], strict=True))
        steps = np.hstack([feet[2], weights * above[2]])
        width = half + half if remaining is None else half + remaining(height, half)
        shear = self.young_pa / (2 * (1 + self.poisson))
        arm = np.cos(load_angle) * (at_height - height) - at_half * np.sin(load_angle)
        stored = (
            12 * arm**2 / (self.young_pa * width**3)
            + 1.2 * np.cos(load_angle) ** 2 / (shear * width)
            + np.sin(load_angle) ** 2 / (self.young_pa * 2 * half)
        )
        return np.asarray(np.sum(steps * stored, axis=1) / self.face_width_m)

    def _body(self, load_angle: Array) -> Array:
        """Return the compliance of the gear body (Sainsot, Velex and Duverger 2004, eq. 4 to 8)."""
        theta = self.root_half_angle_rad or self._rack_tip[2] / self.radius_m
        ratio = self.root_radius_m / self.bore_radius_m
        value = {
            name: a / theta**2 + b * ratio**2 + c * ratio / theta + d / theta + e * ratio + f
            for name, (a, b, c, d, e, f) in _SAINSOT.items()
        }
        up = (self.involute_at(load_angle)[1] - self.root_radius_m) / (2 * self.root_radius_m * theta)
        shape = value["L"] * up**2 + value["M"] * up + value["P"] * (1 + value["Q"] * np.tan(load_angle) ** 2)
        return np.asarray(np.cos(load_angle) ** 2 / (self.young_pa * self.face_width_m) * shape)


def hertz_stiffness(*, young_pa: float, poisson: float, width_m: float) -> float:
    """Return ``pi E L / (4 (1 - nu^2))``, the contact stiffness of two equal cylinders, N/m (Yang and Sun 1985)."""
    return math.pi * young_pa * width_m / (4 * (1 - poisson**2))


@dataclass(frozen=True, kw_only=True)
class ToothPair:
    """A driving and a driven tooth in contact.

    Attributes
    ----------
    gears : GearPair
        Spur gears. The teeth of a ring gear count as external teeth of a wheel with as many, in contact at the same
        height over the reference circle: as ISO 6336-1 has it, nearly those of a rack. Where they would touch the
        planet's fillet, below its involute, they are taken to be relieved.
    bore_radii_m : pair of float
    young_pa, poisson : float
    """

    gears: GearPair
    bore_radii_m: tuple[float, float]
    young_pa: float = 206e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        pair = self.gears
        if pair.helix_angle_rad or any(pair.profile_shift):
            raise ValueError(
                f"teeth = {pair.teeth}, helix_angle_rad = {pair.helix_angle_rad:g}, profile_shift = "
                f"{pair.profile_shift}: strain energy is worked out for spur gears without shift; "
                "use GearPair.mean_stiffness, or the spur gear and `helical`."
            )
        begins = math.atan(pair.path_m[0] / pair.base_radii_m[0])
        if begins < self.teeth[0].form_angle_rad - 1e-9 and pair.teeth[1] > 0:
            raise ValueError(f"teeth = {pair.teeth}: contact begins below the involute of the first gear.")

    @cached_property
    def teeth(self) -> tuple[Tooth, Tooth]:
        """The driving and the driven tooth."""
        pair = self.gears
        one, two = (
            Tooth(
                teeth=abs(count),
                module_m=pair.module_m,
                face_width_m=pair.face_width_m,
                pressure_angle_rad=pair.pressure_angle_rad,
                bore_radius_m=bore,
                addendum=pair.addendum,
                clearance=pair.dedendum - pair.addendum,
                young_pa=self.young_pa,
                poisson=self.poisson,
            )
            for count, bore in zip(pair.teeth, self.bore_radii_m, strict=True)
        )
        return one, two

    def angles_rad(self, phase_cycles: Array) -> tuple[Array, Array]:
        """Return the pressure angles of the contact on either tooth, `phase_cycles` (n,) after the pair entered."""
        begin, _ = self.gears.path_m
        on_path = begin + np.asarray(phase_cycles) * self.gears.base_pitch_m
        if self.gears.teeth[1] < 0:
            return self._angles_in_ring(on_path)
        whole = sum(self.gears.base_radii_m) * math.tan(self.gears.working_angle_rad)
        one, two = self.gears.base_radii_m
        return np.arctan(on_path / one), np.arctan((whole - on_path) / two)

    def _angles_in_ring(self, on_path: Array) -> tuple[Array, Array]:
        """Return the pressure angles on a planet, and on the wheel that stands for its ring."""
        gears, (planet, wheel) = self.gears, self.teeth
        base = gears.base_radii_m[1]
        radius = np.hypot(base, on_path + gears.centre_distance_m * math.sin(gears.working_angle_rad))
        outwards = 2 * gears.reference_radii_m[1] - radius
        own = np.maximum(np.arctan(on_path / gears.base_radii_m[0]), planet.form_angle_rad)
        return own, np.maximum(np.arccos(np.minimum(base / outwards, 1.0)), wheel.form_angle_rad)

    @property
    def hertz(self) -> float:
        """Contact stiffness, N/m."""
        return hertz_stiffness(young_pa=self.young_pa, poisson=self.poisson, width_m=self.gears.face_width_m)

    def compliance(self, phase_cycles: Array) -> Array:
        """Return the compliance of the pair, `phase_cycles` (n,) after it entered, m/N."""
        pairs = zip(self.teeth, self.angles_rad(phase_cycles), strict=True)
        return np.asarray(1 / self.hertz + sum(tooth.compliance(angle) for tooth, angle in pairs))


def _interval(start: float, stop: float | Array) -> tuple[Array, Array]:
    """Return Gauss-Legendre nodes and weights from `start` to `stop`, a row for each (n, 1)."""
    half = (stop - start) / 2
    return start + half * (1 + _NODES), half * _WEIGHTS


# ---- Mesh stiffness as the sum of tooth pairs that enter one after the other, each with a stiffness of its own -------


_POINTS = 257  # along the path of contact: linear between them to 1e-5 of the stiffness
_NO_CONTACT = 1e20  # m/N: the pair is not in contact
_EDGE_OFFSET = 1e-12  # cycles: either side of an edge


class ToothFault(Protocol):
    """A fault of one tooth, by its effect on the compliance of the pair."""

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return the added compliance of a pair whose tooth `gear` (0 or 1) is faulty, (n,) m/N; inf: no contact."""

    def jump_phases(self, pair: ToothPair, gear: int) -> tuple[float, ...]:
        """Return phases after the pair entered at which that jumps."""


@dataclass(frozen=True, kw_only=True)
class DamagedTooth:
    """A faulty tooth of a gear.

    Attributes
    ----------
    gear : 0 or 1
        The driving or the driven gear.
    tooth : int or None
        Number of the tooth; it enters at this phase, and again after a revolution of its gear. None: all teeth alike.
    fault : ToothFault
    """

    gear: int
    tooth: int | None
    fault: ToothFault


@dataclass(frozen=True, kw_only=True)
class TeethInMesh:
    """Mesh stiffness of all pairs in contact; pair p enters at phase p and leaves a contact ratio later.

    Built by `teeth_in_mesh`.

    Attributes
    ----------
    contact_ratio : float
    path_cycles : (n,) array
        Phases after a pair entered, from 0 to the contact ratio; a discontinuity has one on either side.
    compliance : (n,) array
        Of a healthy pair, m/N.
    damaged : tuple of (teeth, tooth, jump phases, (n,) array)
        For each damaged tooth: number of teeth of its gear, its number, phases of discontinuities, added compliance.
    """

    contact_ratio: float
    path_cycles: Array = field(metadata={"dims": ("path",), "units": "cycles"})
    compliance: Array = field(metadata={"dims": ("path",), "units": "m/N"})
    damaged: tuple[tuple[int, int, tuple[float, ...], Array], ...] = ()

    @property
    def period(self) -> int:
        """Period in cycles: the teeth of the damaged gear; their least common multiple where both gears are damaged."""
        return math.lcm(*(teeth for teeth, *_ in self.damaged)) if self.damaged else 1

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Phases of discontinuities: where a pair enters or leaves, or a fault begins or ends."""
        leaves = self.contact_ratio % 1
        found = {cycle + at for cycle in range(self.period) for at in (0.0, leaves)}
        for teeth, tooth, jump_phases, _ in self.damaged:
            for turn in range(self.period // teeth):
                found |= {(turn * teeth + tooth + edge) % self.period for edge in jump_phases}
        return tuple(sorted(found))

    @cached_property
    def mean(self) -> float:
        """Mean over a period in N/m."""
        phases, weights = quadrature(self)
        return float(weights @ self(phases)) / self.period

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return N/m at phases in mesh cycles, any shape."""
        phase = np.asarray(phase_cycles, dtype=np.float64)
        newest = np.floor(phase)
        total, path = np.zeros_like(phase), self.path_cycles
        for older in range(math.ceil(self.contact_ratio)):
            since = phase - newest + older
            compliance = np.asarray(np.interp(since, path, self.compliance))
            if self.damaged:
                knot = np.clip(np.searchsorted(path, since, side="right") - 1, 0, path.size - 2)
                share = np.clip((since - path[knot]) / (path[knot + 1] - path[knot]), 0.0, 1.0)
            for row_of_tooth, added in self._damaged_gears:
                row = row_of_tooth[np.remainder(newest - older, row_of_tooth.size).astype(np.intp)]
                compliance += (1 - share) * added[row, knot] + share * added[row, knot + 1]
            total += np.where(since < self.contact_ratio, 1 / compliance, 0.0)
        return np.where(total > 1 / np.sqrt(_NO_CONTACT), total, 0.0)

    @cached_property
    def _damaged_gears(self) -> list[tuple[NDArray[np.intp], Array]]:
        """For each number of teeth: the row of each tooth, and added compliance (row, n), none in row 0."""
        gears = []
        for teeth in dict.fromkeys(count for count, *_ in self.damaged):
            added = dict[int, Array]()
            for count, tooth, _, more in self.damaged:
                if count == teeth:
                    added[tooth] = added.get(tooth, np.zeros_like(more)) + more
            rows = np.zeros(teeth, dtype=np.intp)
            rows[[*added]] = np.arange(1, len(added) + 1)
            gears.append((rows, np.stack([np.zeros_like(self.compliance), *added.values()])))
        return gears


def teeth_in_mesh(
    pair: ToothPair, *, damaged: Sequence[DamagedTooth] = (), teeth: tuple[int, int] | None = None
) -> TeethInMesh:
    """Return the mesh stiffness by strain energy, its teeth healthy or damaged.

    Pairs share the load as parallel springs; their coupling through the body of the gear is neglected, as usual.

    Parameters
    ----------
    pair : ToothPair
    damaged : sequence of DamagedTooth
    teeth : pair of int
        Numbers of teeth of the gears, where the pair is the virtual one of bevel gears.

    Raises
    ------
    ValueError
        A gear other than 0 and 1, or a tooth that its gear does not have.
    """
    ratio = pair.gears.contact_ratio
    counts = [abs(count) for count in teeth or pair.gears.teeth]
    for item in damaged:
        if item.gear not in (0, 1) or not (item.tooth is None or 0 <= item.tooth < counts[item.gear]):
            raise ValueError(
                f"gear = {item.gear}, tooth = {item.tooth}: gears are 0 and 1, and teeth count from 0 to "
                f"{', '.join(str(count - 1) for count in counts)}."
            )
    jump_phases = [tuple(at for at in item.fault.jump_phases(pair, item.gear) if 0 < at < ratio) for item in damaged]
    sides = [at + side for found in jump_phases for at in found for side in (-_EDGE_OFFSET, _EDGE_OFFSET)]
    path = np.unique(np.concatenate([np.linspace(0, ratio, _POINTS), np.array(sides)]))
    return TeethInMesh(
        contact_ratio=ratio,
        path_cycles=path,
        compliance=_compliance_on(pair, path.tobytes()),
        damaged=tuple(
            (
                1 if item.tooth is None else counts[item.gear],
                item.tooth or 0,
                found,
                np.minimum(item.fault.added_compliance(pair, item.gear, path), _NO_CONTACT),
            )
            for item, found in zip(damaged, jump_phases, strict=True)
        ),
    )


@lru_cache(maxsize=64)
def _compliance_on(pair: ToothPair, path: bytes) -> Array:
    """Return the compliance of a healthy pair: a scene asks for that of the same teeth a dozen times."""
    found = pair.compliance(np.frombuffer(path))
    found.setflags(write=False)
    return found


def helical(stiffness: Stiffness, *, overlap_ratio: float, harmonics: int) -> Fourier:
    """Return the stiffness of a helical mesh whose thin transverse slices are spur gears with this stiffness.

    Slices enter one after the other over `overlap_ratio` cycles, so harmonic h is multiplied by ``sinc(h eps / period)
    exp(-j pi h eps / period)``: an integer overlap ratio leaves a healthy mesh only its mean.

    Parameters
    ----------
    stiffness : Stiffness
        Of the whole face, were it a spur gear.
    overlap_ratio : float
        ``b sin(beta) / (pi m_n)``; `GearPair.overlap_ratio`.
    harmonics : int
        Number of terms, of the period of `stiffness`.
    """
    spur = fourier_series(stiffness, harmonics=harmonics)
    turns = np.arange(1, harmonics + 1) * overlap_ratio / spur.period
    return Fourier(
        mean=spur.mean, harmonics=spur.harmonics * np.sinc(turns) * np.exp(-1j * np.pi * turns), period=spur.period
    )
