"""Impacts of a rolling-element bearing fault: their times, scattered by slip, and forces, by the load at the defect."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.operation.shaft_angle import Array

if TYPE_CHECKING:
    from hums.gearbox.bearing_catalogue import BearingOrders

_AT_REST = 1e-9  # order of a ring relative to the load zone below which it is at rest: rounding


# ---- Slip of a rolling bearing: impacts at independent random intervals ----------------------------------------------
# The impacts have no exact period: their timing error is a random walk (Antoni and Randall 2003, J. Vib. Acoust. 125,
# 282-289).


_BLOCK = 4096  # intervals drawn at once


class SlipModel(Protocol):
    """Mean and scatter of the intervals between impacts: `Slip`, or a declared fault."""

    @property
    def mean_slip(self) -> float:
        """Relative reduction of the mean rate below that of pure rolling."""

    @property
    def slip_std(self) -> float:
        """Standard deviation of an interval over the mean interval."""


@dataclass(frozen=True, kw_only=True)
class Slip:
    """Slip as a renewal process: independent Gaussian intervals ``(1 + slip_std g) / (order (1 - mean_slip))``.

    At harmonic k of their mean rate, the power spectral density of the impacts divided by that rate is
    ``coth((2 pi k slip_std)^2 / 4)``: lines broaden into the background as k grows (Antoni and Randall 2003).

    Attributes
    ----------
    mean_slip : float
        Relative reduction of the mean rate below that of pure rolling, below 1.
    slip_std : float
        Standard deviation of an interval relative to the mean interval, 0 to 0.1.

    Raises
    ------
    ValueError
        If a value is out of range.

    Examples
    --------
    >>> from data_synth.bearings.impacts import Slip
    >>> Slip(slip_std=0.02).slip_std
    0.02
    """

    mean_slip: float = 0.0
    slip_std: float = 0.01

    def __post_init__(self) -> None:
        if not 0 <= self.slip_std <= 0.1:  # noqa: PLR2004
            raise ValueError(f"slip_std = {self.slip_std:g} must be 0 to 0.1, so that impacts stay in order")
        if not self.mean_slip < 1:
            raise ValueError(f"mean_slip = {self.mean_slip:g} must be below 1, where the bearing no longer rolls")


def renewal_process(
    *,
    order: float,
    slip: SlipModel,
    span_rev: tuple[float, float],
    rng: np.random.Generator,
    since_rev: float | None = None,
) -> tuple[Array, int]:
    """Draw the angles of the reference shaft at which a defect is struck.

    Parameters
    ----------
    order : float
        Impacts per revolution of the reference shaft under pure rolling.
    slip : Slip or SlipModel
    span_rev : (float, float)
        First and last angle of interest, in rev.
    rng : numpy.random.Generator
    since_rev : float, optional
        Angle in rev from which impacts before the span are drawn too; those within the span do not depend on it.

    Returns
    -------
    revolutions : (n,) array
        Angles in rev, increasing: the last impact before the span (or before `since_rev`), all later ones up to its
        end, and the first after it.
    first : int
        Number of the first of them; impact 0 is the first within the span.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.bearings.impacts import Slip, renewal_process
    >>> rng = np.random.default_rng(1)
    >>> impacts, first = renewal_process(order=4, slip=Slip(slip_std=0), span_rev=(0, 1), rng=rng)
    >>> impacts.size, first, np.diff(impacts).round(9).tolist()
    (6, -1, [0.25, 0.25, 0.25, 0.25, 0.25])
    """
    first, last = span_rev
    interval = 1 / (order * (1 - slip.mean_slip))
    begin, elapsed = first - interval * rng.random(), 0.0
    drawn = [np.array([begin])]
    while begin + interval * elapsed <= last:
        counted = elapsed + np.cumsum(1 + slip.slip_std * rng.standard_normal(_BLOCK))
        elapsed = float(counted[-1])
        drawn.append(begin + interval * counted)
    impacts = np.concatenate(drawn)
    within = np.searchsorted(impacts, first), np.searchsorted(impacts, last, side="right")
    impacts = impacts[max(int(within[0]) - 1, 0) : int(within[1]) + 1]
    before = (
        _impacts_before(impacts[0], interval, slip, since_rev, rng.spawn(1)[0])
        if since_rev is not None
        else np.empty(0)
    )
    return np.concatenate([before, impacts]), -1 - before.size


def _impacts_before(
    begin: float, interval: float, slip: SlipModel, since_rev: float, rng: np.random.Generator
) -> Array:
    """Return the impacts before `begin`, increasing, back to the last one before `since_rev`."""
    drawn, begin = [np.empty(0)], float(begin)
    while begin >= since_rev:
        drawn.insert(0, begin - interval * np.cumsum(1 + slip.slip_std * rng.standard_normal(_BLOCK))[::-1])
        begin = float(drawn[0][0])
    impacts = np.concatenate(drawn)
    return impacts[max(int(np.searchsorted(impacts, since_rev)) - 1, 0) :]


# ---- Stribeck's distribution of the bearing load over the elements ---------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LoadZone:
    """Stribeck's load on an element relative to the maximum: ``max(0, 1 - (1 - cos psi) / (2 eps)) ** exponent``.

    psi is the angle from the middle of the load zone (Harris 2001, Rolling Bearing Analysis).

    Attributes
    ----------
    distribution : float
        Load distribution factor eps, above 0 and at most 1: 0.5 where half the ring is loaded, less with clearance,
        more under preload.
    exponent : float
        3/2 for balls (point contact), 10/9 for rollers (line contact).

    Raises
    ------
    ValueError
        If `distribution` is out of range.

    Examples
    --------
    >>> from data_synth.bearings.impacts import LoadZone
    >>> LoadZone().share([0.0, 3.0]).tolist()
    [1.0, 0.0]
    """

    distribution: float = 0.5
    exponent: float = 1.5

    def __post_init__(self) -> None:
        if not 0 < self.distribution <= 1:
            raise ValueError(f"distribution = {self.distribution:g} must be above 0 and at most 1")

    def share(self, angle_rad: ArrayLike) -> Array:
        """Return the load relative to its maximum at angles (n,) in rad from the middle of the zone."""
        lowered = (1 - np.cos(np.asarray(angle_rad, dtype=np.float64))) / (2 * self.distribution)
        return np.asarray(np.maximum(0.0, 1 - lowered) ** self.exponent)


# ---- Exact position of the parts of a bearing with slip --------------------------------------------------------------
# All parts slip together: from one impact to the next, cage and elements advance exactly as far as under pure rolling,
# in proportion to the reference shaft. Their positions therefore follow from the impacts.


KINDS = ("inner_race", "outer_race", "rolling_element", "cage")


def defect_order(kind: str, rates: "BearingOrders") -> float:
    """Return the number of impacts of a defect per revolution of the reference shaft under pure rolling.

    Raises
    ------
    ValueError
        If `kind` is unknown or such a defect is never struck.
    """
    if kind not in KINDS:
        raise ValueError(f'kind = "{kind}" is not a bearing fault; valid: {", ".join(KINDS)}')
    order = float(getattr(rates, kind))
    if order == 0:
        raise ValueError(f'{kind} of "{rates.name}" is never struck: its parts do not move relative to each other')
    return order


def signed_cage_order(rates: "BearingOrders") -> float:
    """Return the order of the cage under pure rolling, seen from the bearing's carrier and signed like the rings'."""
    return rates.outer_ring + _sense(rates) * rates.cage_to_outer


def _sense(rates: "BearingOrders") -> float:
    """Return the direction of the inner ring's rotation relative to the outer ring, +1 or -1."""
    return math.copysign(1.0, rates.inner_ring - rates.outer_ring)


@dataclass(frozen=True, kw_only=True)
class RollingKinematics:
    """Kinematics of a bearing, given the impacts of one defect.

    All angles are seen from the bearing's carrier, like the load zone, and signed like those of the reference shaft.

    Attributes
    ----------
    kind : {"inner_race", "outer_race", "rolling_element", "cage"}
    rates : BearingOrders
        Orders under pure rolling.
    impacts_rev : (n,) array
        Angles of the reference shaft at the impacts, increasing: the last before the interval of interest, those in
        it, and the first after it.
    first_number : int
        Number of the first of them; impact 0 is (nearly) the first within the record.
    place_turns : float
        Position of the defect in rev from the maximum load: at revolution zero for a ring, at impact 0 for an element
        or the cage.
    """

    kind: str
    rates: "BearingOrders"
    impacts_rev: Array = field(repr=False, metadata={"dims": ("knot",), "units": "rev"})
    first_number: int
    place_turns: float

    def defect_phase(self, revolutions: ArrayLike) -> Array:
        """Return the phase of the defect (n,) in cycles: a whole number at impacts, linear in shaft angle between."""
        return np.asarray(
            np.interp(np.asarray(revolutions), self.impacts_rev, self.first_number + np.arange(self.impacts_rev.size))
        )

    def cage_turns(self, revolutions: ArrayLike) -> Array:
        """Return the angle of the cage (n,) in rev; at whole revolutions element 1 of Z carries the largest load."""
        return self._cage(np.asarray(revolutions, dtype=np.float64), self.defect_phase(revolutions))

    def element_turns(self, revolutions: ArrayLike) -> Array:
        """Return the angle (n,) in rev of an element about its own axis, relative to the cage."""
        order = defect_order(self.kind, self.rates)
        return np.asarray(self.rates.rolling_element / 2 / order * self.defect_phase(revolutions))

    @property
    def numbers(self) -> NDArray[np.int_]:
        """Numbers of the impacts within the interval of interest, (n - 2,)."""
        return self.first_number + 1 + np.arange(self.impacts_rev.size - 2)

    def at_impacts(self) -> tuple[Array, Array]:
        """Return the angles of defect and cage in rev, (n - 2,) each, at the impacts of interest."""
        revolutions, number = self.impacts_rev[1:-1], self.numbers
        return self._spot(revolutions, number), self._cage(revolutions, number)

    def _spot(self, revolutions: Array, defect_phase: ArrayLike) -> Array:
        if self.kind == "outer_race":
            return np.asarray(self.place_turns + self.rates.outer_ring * revolutions)
        if self.kind == "inner_race":
            return np.asarray(self.place_turns + self.rates.inner_ring * revolutions)
        cage = signed_cage_order(self.rates)
        advance = 1.0 if self.kind == "cage" else abs(cage) / self.rates.rolling_element
        return np.asarray(self.place_turns + math.copysign(advance, cage) * np.asarray(defect_phase))

    def _cage(self, revolutions: Array, defect_phase: ArrayLike) -> Array:
        spot, sense = self._spot(revolutions, defect_phase), _sense(self.rates)
        ahead = {"outer_race": sense, "inner_race": -sense}.get(self.kind, 0.0)
        return np.asarray(spot + ahead * np.asarray(defect_phase) / self.rates.elements) if ahead else spot


# ---- Impacts ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class BearingImpacts:
    """Impacts of one bearing defect, and the exact position of the rolling elements.

    Attributes
    ----------
    revolutions : (n,) array
        Angle of the reference shaft in rev, increasing.
    weights : (n,) array
        Relative force: 1 in the middle of the load zone.
    cage_turns : (n,) array
        Angle of the cage in rev from the middle of the load zone, seen from the bearing's carrier. Element 1 of Z is
        there at whole revolutions (for a race defect it is the element that strikes, so the angle is ambiguous by
        multiples of 1/Z rev).
    rolling : RollingKinematics
        Position of the parts of the bearing at any angle of the reference shaft.
    rate : float
        True mean impacts per revolution in the record; NaN for fewer than two impacts.
    """

    revolutions: Array = field(metadata={"dims": ("impact",), "units": "rev"})
    weights: Array = field(metadata={"dims": ("impact",), "units": "1"})
    cage_turns: Array = field(metadata={"dims": ("impact",), "units": "rev"})
    rolling: RollingKinematics
    rate: float


def bearing_impacts(
    kind: str,
    *,
    rates: "BearingOrders",
    slip: SlipModel,
    zone: LoadZone,
    span_rev: tuple[float, float],
    rng: np.random.Generator,
    place_turns: float = 0.0,
    inner_share: float = 1.0,
    zone_order: float = 0.0,
    since_rev: float | None = None,
) -> BearingImpacts:
    """Draw the impacts of a defect, their force and the exact position of the cage.

    Each passing element strikes a defect of the outer ring under the load at that position, and one of the inner ring
    likewise, whose position rotates with the ring. A defect of an element strikes both races once per revolution of
    the element, under the load at its position. A broken cage strikes once per revolution, whatever the load.

    Parameters
    ----------
    kind : {"inner_race", "outer_race", "rolling_element", "cage"}
    rates : BearingOrders
        Orders of the bearing.
    slip : Slip or SlipModel
    zone : LoadZone
    span_rev : (float, float)
        First and last angle of the reference shaft, in rev.
    rng : numpy.random.Generator
    place_turns : float
        Position at revolution zero, in rev from the middle of the load zone, of a defect of the outer ring or of an
        inner ring at rest in the zone. For another inner ring or an element it is drawn.
    inner_share : float
        For a defect of an element: force of an impact on the inner race relative to one on the outer race, both at the
        housing.
    zone_order : float
        Order at which the load zone rotates, seen from the bearing's carrier: 0 under weight or tooth forces, that of
        the shaft under imbalance.
    since_rev : float, optional
        Angle in rev from which impacts before the span are drawn too; those within the span do not depend on it.

    Returns
    -------
    BearingImpacts

    Raises
    ------
    ValueError
        If `kind` is unknown or such a defect is never struck.
    """
    order = defect_order(kind, rates)
    initial_turns = rng.random()
    revolutions, first_number = renewal_process(order=order, slip=slip, span_rev=span_rev, rng=rng, since_rev=since_rev)
    rolling = RollingKinematics(
        kind=kind,
        rates=rates,
        impacts_rev=revolutions,
        first_number=first_number,
        place_turns=place_turns if kind == "outer_race" or rests_in_zone(kind, rates, zone_order) else initial_turns,
    )
    impacts_rev = revolutions[1:-1]
    place, cage_turns = rolling.at_impacts()
    weights = (
        np.ones(impacts_rev.size) if kind == "cage" else zone.share(2 * np.pi * (place - zone_order * impacts_rev))
    )
    if kind == "rolling_element":
        weights = weights * np.where(rolling.numbers % 2, inner_share, 1.0)
    span = impacts_rev[-1] - impacts_rev[0] if impacts_rev.size > 1 else math.nan
    return BearingImpacts(
        revolutions=impacts_rev,
        weights=weights,
        cage_turns=cage_turns,
        rolling=rolling,
        rate=float((impacts_rev.size - 1) / span),
    )


def rests_in_zone(kind: str, rates: "BearingOrders", zone_order: float) -> bool:
    """Return whether the defect is on an inner ring at rest in the load zone, such as that on a planet pin."""
    return kind == "inner_race" and abs(rates.inner_ring - zone_order) < _AT_REST


def passage_revolutions(
    kind: str,
    *,
    rates: "BearingOrders",
    size_m: float,
    pitch_diameter_m: float,
    element_diameter_m: float,
    contact_angle_rad: float = 0.0,
) -> float:
    """Return the rotation of the reference shaft in rev while a contact passes a spall of length `size_m`.

    ``size / (pi D / 2 (1 - (d cos a / D)^2) relative)``: under pure rolling the contact moves at the same speed over
    outer race, inner race and element; `relative` is the order of one ring relative to the other. For an element that
    bridges the spall, entry to impact takes half of it (Sawalhi and Randall 2011, Mech. Syst. Signal Process. 25,
    846-870).

    Raises
    ------
    ValueError
        If the spall is so long that the next element enters before the previous one has left.
    """
    along = element_diameter_m * math.cos(contact_angle_rad) / pitch_diameter_m
    travel_m = math.pi * pitch_diameter_m / 2 * (1 - along**2) * rates.relative  # of the contact per revolution
    turned = size_m / travel_m
    soonest = 1 / defect_order(kind, rates)
    if not turned < soonest:
        raise ValueError(
            f'size_m = {size_m:g} takes {turned:g} rev to pass, but {kind} of "{rates.name}" is struck every '
            f"{soonest:g} rev; keep it below {soonest * travel_m:g}"
        )
    return turned
