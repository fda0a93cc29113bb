"""Geometry of a pair of involute gears on parallel axes, and its mesh stiffness by ISO 6336-1."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

_N_PER_MM_UM = 1e9  # N/(mm um) in N/m for a metre of face
_MAX_ITERATIONS = 60


@dataclass(frozen=True, kw_only=True)
class GearPair:
    """Geometry of an involute gear pair on parallel axes, with the signs and formulas of ISO 21771.

    Attributes
    ----------
    teeth : pair of int
        Numbers of teeth; the second negative for an internal gear.
    module_m : float
        Normal module in m.
    face_width_m : float
        Common face width in m.
    pressure_angle_rad, helix_angle_rad : float
        Normal pressure angle, below pi/4, and helix angle, below pi/3, at the reference cylinder, both unsigned.
    profile_shift : pair of float
        Profile shift coefficients.
    addendum, dedendum : float
        Of the basic rack, in modules.

    Raises
    ------
    ValueError
        If a length is not positive, an angle is out of range, or the numbers of teeth give no pair.

    Examples
    --------
    >>> import math
    >>> from data_synth.dynamics import GearPair
    >>> pair = GearPair(teeth=(62, 62), module_m=2e-3, face_width_m=0.02, pressure_angle_rad=math.radians(20))
    >>> round(pair.contact_ratio, 4), round(pair.centre_distance_m, 6)
    (1.7898, 0.124)
    """

    teeth: tuple[int, int]
    module_m: float
    face_width_m: float
    pressure_angle_rad: float
    helix_angle_rad: float = 0.0
    profile_shift: tuple[float, float] = (0.0, 0.0)
    addendum: float = 1.0
    dedendum: float = 1.25

    def __post_init__(self) -> None:
        require([("module_m", self.module_m), ("face_width_m", self.face_width_m)])
        if not 0 < self.pressure_angle_rad < math.pi / 4 or not 0 <= self.helix_angle_rad < math.pi / 3:
            raise ValueError(
                f"pressure_angle_rad = {self.pressure_angle_rad!r} must be above 0 and below pi/4, and helix_angle_rad "
                f"= {self.helix_angle_rad!r} at least 0 and below pi/3."
            )
        one, two = self.teeth
        if one < 1 or two == 0 or one + two == 0 or -one < two < 0:
            raise ValueError(
                f"teeth = {self.teeth}: the first gear must be external (positive); an internal second gear (negative) "
                "must have more teeth than the first."
            )

    @cached_property
    def transverse_angle_rad(self) -> float:
        """Transverse pressure angle at the reference circles, rad."""
        return math.atan(math.tan(self.pressure_angle_rad) / math.cos(self.helix_angle_rad))

    @cached_property
    def working_angle_rad(self) -> float:
        """Transverse working pressure angle in rad: ``inv a_w = inv a_t + 2 tan a_n sum x / sum z``."""
        shift, start = sum(self.profile_shift), self.transverse_angle_rad
        if shift == 0:
            return start
        target = _involute(start) + 2 * math.tan(self.pressure_angle_rad) * shift / sum(self.teeth)
        if target <= 0:
            raise ValueError(
                f"profile_shift = {self.profile_shift}: such gears have no common pitch point; increase the sum."
            )
        angle = math.atan(math.cbrt(3 * target) + target)  # above the root, from where Newton's method descends
        for _ in range(_MAX_ITERATIONS):
            angle -= (_involute(angle) - target) / math.tan(angle) ** 2
        return angle

    @cached_property
    def base_helix_rad(self) -> float:
        """Helix angle at the base cylinder, rad."""
        return math.asin(math.sin(self.helix_angle_rad) * math.cos(self.pressure_angle_rad))

    @cached_property
    def reference_radii_m(self) -> tuple[float, float]:
        """Radii of the reference circles, both positive."""
        half = self.module_m / math.cos(self.helix_angle_rad) / 2
        return self.teeth[0] * half, abs(self.teeth[1]) * half

    @cached_property
    def base_radii_m(self) -> tuple[float, float]:
        """Radii of the base circles, both positive."""
        one, two = self.reference_radii_m
        return one * math.cos(self.transverse_angle_rad), two * math.cos(self.transverse_angle_rad)

    @cached_property
    def working_radii_m(self) -> tuple[float, float]:
        """Radii of the working pitch circles, both positive."""
        one, two = self.base_radii_m
        return one / math.cos(self.working_angle_rad), two / math.cos(self.working_angle_rad)

    @property
    def centre_distance_m(self) -> float:
        """Centre distance."""
        one, two = self.working_radii_m
        return one + two if self.teeth[1] > 0 else two - one

    @cached_property
    def tip_radii_m(self) -> tuple[float, float]:
        """Radii of the tip circles; that of an internal gear is smaller than its reference circle."""
        one, two = self.reference_radii_m
        outside = math.copysign(1.0, self.teeth[1])
        x = self.profile_shift
        return (
            one + (self.addendum + x[0]) * self.module_m,
            two + outside * (self.addendum + x[1]) * self.module_m,
        )

    @property
    def base_pitch_m(self) -> float:
        """Transverse base pitch."""
        return 2 * math.pi * self.base_radii_m[0] / self.teeth[0]

    @cached_property
    def path_m(self) -> tuple[float, float]:
        """Start and end of contact on the line of action in m from its tangent point on the first base circle."""
        tips = [_tangent(tip, base) for tip, base in zip(self.tip_radii_m, self.base_radii_m, strict=True)]
        between = self.centre_distance_m * math.sin(self.working_angle_rad)
        begin = between - tips[1] if self.teeth[1] > 0 else tips[1] - between
        return begin, tips[0]

    @cached_property
    def pitch_point_cycles(self) -> float:
        """Mesh cycles from the entry of a pair of teeth to its contact at the pitch point."""
        pitch_point = self.base_radii_m[0] * math.tan(self.working_angle_rad)
        return (pitch_point - self.path_m[0]) / self.base_pitch_m

    def thickness_pitches(self, gear: int) -> float:
        """Return tooth thickness over pitch on the working pitch circle of gear 0 or 1, external and without backlash.

        ``1/2 + (2 x tan a_n + z (inv a_t - inv a_w)) / pi``: one half without profile shift (ISO 21771:2007).
        """
        grown = 2 * self.profile_shift[gear] * math.tan(self.pressure_angle_rad)
        rolled = _involute(self.transverse_angle_rad) - _involute(self.working_angle_rad)
        return 0.5 + (grown + self.teeth[gear] * rolled) / math.pi

    @property
    def least_backlash_m(self) -> float:
        """Recommended minimum normal backlash in m: 2/3 (0.06 mm + 0.0005 a + 0.03 m_n) (ISO/TR 10064-2:1996)."""
        return (0.06e-3 + 0.0005 * self.centre_distance_m + 0.03 * self.module_m) * 2 / 3

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio, the length of the path of contact over the base pitch (ISO 21771, sec. 6)."""
        begin, end = self.path_m
        return (end - begin) / self.base_pitch_m

    @property
    def overlap_ratio(self) -> float:
        """Overlap ratio of a helical pair, ``b sin(beta) / (pi m_n)``."""
        return self.face_width_m * math.sin(self.helix_angle_rad) / (math.pi * self.module_m)

    @property
    def rack_factor(self) -> float:
        """C_B of ISO 6336-1, ``(1 + 0.5 (1.2 - h_fP / m)) (1 - 0.02 (20 deg - alpha_n))``."""
        angle = math.degrees(self.pressure_angle_rad)
        return (1 + 0.5 * (1.2 - self.dedendum)) * (1 - 0.02 * (20 - angle))

    def single_stiffness(self, *, rack_factor: float | None = None) -> float:
        """Return the single stiffness c' of ISO 6336-1:2006, method B, for solid steel discs, N/m per metre of face.

        ``c' = 0.8 C_B cos(beta) / q'`` with ``q' = 0.04723 + 0.15551 / z_n1 + 0.25791 / z_n2 - 0.00635 x1
        - 0.11654 x1 / z_n1 - 0.00193 x2 - 0.24188 x2 / z_n2 + 0.00529 x1^2 + 0.00182 x2^2`` in mm um / N and
        ``z_n = z / cos^3 beta``; an internal gear counts as a rack.

        Parameters
        ----------
        rack_factor : float or None
            C_B; None: `rack_factor` of the pair's basic rack.
        """
        x1, x2 = self.profile_shift
        inverse = [math.cos(self.helix_angle_rad) ** 3 / teeth if teeth > 0 else 0.0 for teeth in self.teeth]
        compliance = (
            0.04723
            + 0.15551 * inverse[0]
            + 0.25791 * inverse[1]
            - 0.00635 * x1
            - 0.11654 * x1 * inverse[0]
            - 0.00193 * x2
            - 0.24188 * x2 * inverse[1]
            + 0.00529 * x1**2
            + 0.00182 * x2**2
        )
        factor = self.rack_factor if rack_factor is None else rack_factor
        return 0.8 * factor * math.cos(self.helix_angle_rad) / compliance * _N_PER_MM_UM

    def mean_stiffness(self, *, rack_factor: float | None = None) -> float:
        """Return the mean mesh stiffness of ISO 6336-1 along the transverse line of action, N/m.

        ``c_gamma_alpha = c' (0.75 epsilon_alpha + 0.25)`` times the face width, valid for at least 100 N per mm of
        face width and ``epsilon_alpha > 1.2``. `rack_factor` is that of `single_stiffness`.
        """
        pairs = 0.75 * self.contact_ratio + 0.25
        return self.single_stiffness(rack_factor=rack_factor) * pairs * self.face_width_m


def _involute(angle: float) -> float:
    """Return the involute function ``tan(angle) - angle``."""
    return math.tan(angle) - angle


def _tangent(radius: float, base: float) -> float:
    """Return the length of the tangent to the base circle from a point at a radius."""
    if radius < base:
        raise ValueError(
            f"the tip radius, {1e3 * radius:.4g} mm, is below the base radius, {1e3 * base:.4g} mm, where there is no "
            "involute; lower the addendum or shift the profile."
        )
    return math.sqrt(radius**2 - base**2)


def require(values: Iterable[tuple[str, float]]) -> None:
    """Raise ValueError for the first of some named values that is not a positive finite number."""
    for name, value in values:
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} = {value!r} must be a finite number above 0.")
