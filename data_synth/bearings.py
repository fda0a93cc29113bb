"""Rolling-element bearing faults: when a defect is struck, and how hard.

Intervals between impacts are independent, so the error of their times grows like that of a random walk and
the train has no exact period (Antoni and Randall 2003, J. Vib. Acoust. 125, 282-289). Where the defect turns
through the load zone, impacts follow the load distribution of Stribeck with an exponent 3/2 for point contact.

One slip drives all: between two impacts the cage has gone on by exactly what pure rolling gives it from one to the
next, so where the cage truly is follows from the impacts themselves.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from data_synth.profile import Array

if TYPE_CHECKING:
    from hums.orders import BearingOrders

_POINT_CONTACT = 1.5
_BLOCK = 4096  # intervals drawn at once


class Slipping(Protocol):
    """Says how impacts scatter: `Slip`, or a declared fault."""

    @property
    def mean_slip(self) -> float:
        """Share by which the mean rate lies below that of pure rolling."""

    @property
    def slip_std(self) -> float:
        """Standard deviation of an interval over the mean interval."""


@dataclass(frozen=True, kw_only=True)
class Slip:
    """Slip as a renewal process: Gaussian intervals ``(1 + slip_std g) / (order (1 - mean_slip))``, independent.

    The power spectral density of the impacts at harmonic k of their mean rate is, over that rate, the hyperbolic
    cotangent of ``(2 pi k slip_std)^2 / 4``: lines that melt as k grows.
    """

    mean_slip: float = 0.0
    slip_std: float = 0.01

    def __post_init__(self) -> None:
        if not 0 <= self.slip_std <= 0.1:  # noqa: PLR2004
            raise ValueError(f"slip_std = {self.slip_std:g}: 0 to 0.1 keeps impacts in their order; lower it")
        if not self.mean_slip < 1:
            raise ValueError(f"mean_slip = {self.mean_slip:g}: at 1 nothing rolls; keep it below")


@dataclass(frozen=True, kw_only=True)
class LoadZone:
    """Stribeck's distribution: ``(1 - (1 - cos psi) / (2 e)) ** exponent`` within the zone, nothing outside.

    ``e = (1 - cos half_angle) / 2``: 90 degrees without clearance, less with, more under preload. The exponent is 3/2
    for balls and 10/9 for rollers (Harris 2001, Rolling Bearing Analysis).
    """

    half_angle_rad: float = math.pi / 2
    exponent: float = _POINT_CONTACT

    def __post_init__(self) -> None:
        if not 0 < self.half_angle_rad <= math.pi:
            raise ValueError(f"half_angle_rad = {self.half_angle_rad:g} is not above 0 and at most pi")

    @classmethod
    def of(cls, *, distribution: float, exponent: float = _POINT_CONTACT) -> "LoadZone":
        """Return the zone of Stribeck's factor e, above 0 and at most 1: 0.5 where half of the ring carries."""
        return cls(half_angle_rad=math.acos(1 - 2 * distribution), exponent=exponent)

    def share(self, angle_rad: ArrayLike) -> Array:
        """Return the load relative to the largest at `angle_rad` (n,) from the middle of the zone."""
        lowest = (1 - math.cos(self.half_angle_rad)) / 2
        return stribeck_load(angle_rad, distribution=lowest, exponent=self.exponent)


@dataclass(frozen=True, kw_only=True)
class BearingStrikes:
    """Impacts of one bearing defect, and where the rolling elements truly are.

    Attributes
    ----------
    revolutions : (n,) array
        Of the reference shaft, rising.
    weights : (n,) array
        Relative force: 1 in the middle of the load zone.
    cage_turns : (n,) array
        Turn of the cage from the middle of the load zone, as who carries the bearing sees it; element 1 of Z sits there
        (for a race defect: the element that strikes, so 1/Z of a turn is not told apart).
    rate : float
        True mean rate in the record: intervals over the revolutions they take; NaN below two impacts.
    expected_rate : float
        Of the process, in impacts a revolution: that of pure rolling less the mean slip.
    """

    revolutions: Array = field(metadata={"dims": ("impact",), "units": "rev"})
    weights: Array = field(metadata={"dims": ("impact",), "units": "1"})
    cage_turns: Array = field(metadata={"dims": ("impact",), "units": "rev"})
    rate: float
    expected_rate: float


def renewal_blocks(
    *, order: float, slip: Slipping, span_rev: tuple[float, float], rng: np.random.Generator
) -> Iterator[Array]:
    """Draw where on the reference shaft's angle a defect is struck, block after block in constant memory.

    Parameters
    ----------
    order : float
        Impacts per revolution of the reference under pure rolling.
    slip : Slip or alike
    span_rev : (float, float)
        First and last revolution of interest.
    rng : numpy.random.Generator

    Yields
    ------
    (n,) array
        Revolutions, rising, within the span.
    """
    first, last = span_rev
    interval = 1 / (order * (1 - slip.mean_slip))
    begin, elapsed = first - interval * rng.random(), 0.0
    while begin + interval * elapsed <= last:
        counted = elapsed + np.cumsum(1 + slip.slip_std * rng.standard_normal(_BLOCK))
        elapsed = float(counted[-1])
        struck = begin + interval * counted
        yield struck[(struck >= first) & (struck <= last)]


def impact_revolutions(
    *, order: float, fault: Slipping, span_rev: tuple[float, float], rng: np.random.Generator
) -> Array:
    """Return all blocks of `renewal_blocks` as one (n,) array; `fault` states the slip."""
    blocks = renewal_blocks(order=order, slip=fault, span_rev=span_rev, rng=rng)
    return np.concatenate(list(chain([np.empty(0)], blocks)))


def bearing_strikes(
    kind: str,
    *,
    rates: "BearingOrders",
    slip: Slipping,
    zone: LoadZone,
    span_rev: tuple[float, float],
    rng: np.random.Generator,
    place_turns: float = 0.0,
    inner_share: float = 1.0,
) -> BearingStrikes:
    """Draw the impacts of a defect, their force and the true turn of the cage.

    A spot of the outer ring is struck by each element that passes, under the load of its place; one of the inner ring
    likewise, its place turning with the ring. A spot of an element strikes both races in one turn of it, under the load
    of where the cage has carried it. A broken cage knocks once in its turn, whatever the load.

    Parameters
    ----------
    kind : {"inner_race", "outer_race", "rolling_element", "cage"}
    rates : BearingOrders
        Of the bearing, in orders.
    slip : Slip or alike
    zone : LoadZone
    span_rev : (float, float)
        First and last revolution of the reference shaft.
    rng : numpy.random.Generator
    place_turns : float
        Where a spot of the outer ring sits at revolution zero, in turns from the middle of the load zone. Spots of the
        inner ring and of elements begin anywhere.
    inner_share : float
        Force of a strike on the inner race over one on the outer race, as both reach the housing (rolling element).

    Raises
    ------
    ValueError
        An unknown kind, or one that is never struck.
    """
    order = _rate(kind, rates)
    begin_turns = rng.random()
    struck = impact_revolutions(order=order, fault=slip, span_rev=span_rev, rng=rng)
    cage_turns, place = _cage_turns(kind, rates, struck, begin_turns, place_turns)
    weights = np.ones(struck.size) if kind == "cage" else zone.share(2 * np.pi * place)
    if kind == "rolling_element":
        weights = weights * np.where(np.arange(struck.size) % 2, inner_share, 1.0)
    span = struck[-1] - struck[0] if struck.size > 1 else math.nan
    return BearingStrikes(
        revolutions=struck,
        weights=weights,
        cage_turns=cage_turns,
        rate=float((struck.size - 1) / span),
        expected_rate=order * (1 - slip.mean_slip),
    )


def _rate(kind: str, rates: "BearingOrders") -> float:
    known = ("inner_race", "outer_race", "rolling_element", "cage")
    if kind not in known:
        raise ValueError(f'kind = "{kind}" is no bearing fault; valid: {", ".join(known)}')
    order = float(getattr(rates, kind))
    if order == 0:
        raise ValueError(f'{kind} of "{rates.name}" is never struck: its parts stand still against each other')
    return order


def _cage_turns(
    kind: str, rates: "BearingOrders", struck: Array, begin_turns: float, place_turns: float
) -> tuple[Array, Array]:
    """Return the turns of the cage at the impacts, and those of the place that carries the load there."""
    way = math.copysign(1.0, rates.inner_ring - rates.outer_ring)
    number = np.arange(struck.size)
    if kind == "outer_race":
        place = place_turns + rates.outer_ring * struck
        return np.asarray(place + way * number / rates.elements), place
    if kind == "inner_race":
        place = begin_turns + rates.inner_ring * struck
        return np.asarray(place - way * number / rates.elements), place
    cage = rates.outer_ring + way * rates.cage_to_outer
    advance = 1.0 if kind == "cage" else abs(cage) / rates.rolling_element
    turns = np.asarray(begin_turns + math.copysign(advance, cage) * number)
    return turns, turns


def stribeck_load(angle_rad: ArrayLike, *, distribution: float, exponent: float = _POINT_CONTACT) -> Array:
    """Return the load on an element relative to the largest: ``max(0, 1 - (1 - cos psi) / (2 eps)) ** exponent``.

    Parameters
    ----------
    angle_rad : (n,) array
        psi, from the middle of the load zone, in rad.
    distribution : float
        eps: 0.5 where half of the ring carries, less with clearance, more with preload.
    exponent : float
        3/2 for point contact, 10/9 for line contact.
    """
    lowered = (1 - np.cos(np.asarray(angle_rad, dtype=np.float64))) / (2 * distribution)
    return np.asarray(np.maximum(0.0, 1 - lowered) ** exponent)


def passage_revolutions(
    kind: str,
    *,
    rates: "BearingOrders",
    size_m: float,
    pitch_diameter_m: float,
    element_diameter_m: float,
    contact_angle_rad: float = 0.0,
) -> float:
    """Return how far the reference shaft turns while a contact passes a spall of `size_m`, in revolutions.

    ``size / (pi D / 2 (1 - (d cos a / D)^2) relative)``: under pure rolling the contact runs over the outer race, the
    inner race and the element at one and the same speed, and `relative` is that of the rings in orders. From the entry
    into the spall to the impact an element takes half of it when it bridges the spall (Sawalhi and Randall 2011, Mech.
    Syst. Signal Process. 25, 846-870).

    Raises
    ------
    ValueError
        A spall so long that the next element enters before the last has left.
    """
    along = element_diameter_m * math.cos(contact_angle_rad) / pitch_diameter_m
    passed = math.pi * pitch_diameter_m / 2 * (1 - along**2) * rates.relative
    turned = size_m / passed
    soonest = 1 / _rate(kind, rates)
    if not turned < soonest:
        raise ValueError(
            f'size_m = {size_m:g} takes {turned:g} rev to pass, but {kind} of "{rates.name}" is struck every '
            f"{soonest:g} rev; keep it below {soonest * passed:g}"
        )
    return turned


def with_entries(revolutions: Array, weights: Array, *, passage_rev: float, entry_share: float) -> tuple[Array, Array]:
    """Return impacts as pairs, rising: entry into the spall `passage_rev` before the impact, then the impact.

    Parameters
    ----------
    revolutions, weights : (n,) array
    passage_rev : float
        From entry to impact, in revolutions of the reference shaft.
    entry_share : float
        Force of the entry over that of the impact; negative, since there the element drops.

    Returns
    -------
    revolutions, weights : (2 n,) array
    """
    both = np.concatenate([revolutions - passage_rev, revolutions])
    forces = np.concatenate([entry_share * weights, weights])
    rising = np.argsort(both, kind="stable")
    return both[rising], forces[rising]
