"""Impacts of a rolling-element bearing fault: their times and forces.

The intervals between impacts slip (`data_synth.slip`); the force follows from the load at the defect
(`data_synth.load_zone`).
"""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from data_synth.load_zone import LoadZone
from data_synth.profile import Array
from data_synth.rolling import RollingKinematics, defect_order
from data_synth.slip import SlipModel, renewal_process

if TYPE_CHECKING:
    from hums.orders import BearingOrders


@dataclass(frozen=True, kw_only=True)
class BearingImpacts:
    """Impacts of one bearing defect, and the exact position of the rolling elements.

    Attributes
    ----------
    revolutions : (n,) array
        Of the reference shaft, rising.
    weights : (n,) array
        Relative force: 1 in the middle of the load zone.
    cage_turns : (n,) array
        Rotation of the cage from the middle of the load zone, seen from the carrier of the bearing; element 1 of Z is
        there at whole turns (for a race defect: the element that strikes, so that 1/Z of a turn is ambiguous).
    rolling : RollingKinematics
        Position of the parts of the bearing at any angle of the reference shaft.
    rate : float
        True mean rate in the record: intervals over the revolutions they take; NaN below two impacts.
    expected_rate : float
        Expected impacts a revolution: those of pure rolling less the mean slip.
    """

    revolutions: Array = field(metadata={"dims": ("impact",), "units": "rev"})
    weights: Array = field(metadata={"dims": ("impact",), "units": "1"})
    cage_turns: Array = field(metadata={"dims": ("impact",), "units": "rev"})
    rolling: RollingKinematics
    rate: float
    expected_rate: float


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

    A defect of the outer ring is struck by each element that passes, under the load at its place; one of the inner ring
    likewise, its place rotating with the ring. A defect of an element strikes both races in one revolution of it, under
    the load at its place in the cage. A broken cage strikes once in its revolution, independent of the load.

    Parameters
    ----------
    kind : {"inner_race", "outer_race", "rolling_element", "cage"}
    rates : BearingOrders
        Orders of the bearing.
    slip : Slip or alike
    zone : LoadZone
    span_rev : (float, float)
        First and last revolution of the reference shaft.
    rng : numpy.random.Generator
    place_turns : float
        Place of a defect of the outer ring at revolution zero, in turns from the middle of the load zone. That of a
        defect of the inner ring or of an element is drawn.
    inner_share : float
        Force of an impact on the inner race over one on the outer race, both at the housing (rolling element).
    zone_order : float
        Order of the load zone's rotation, seen from the carrier of the bearing: 0 under weight or tooth forces, that of
        the shaft under an imbalance.
    since_rev : float, optional
        Revolution from which earlier impacts are drawn too; those within the span do not depend on it.

    Raises
    ------
    ValueError
        An unknown kind, or one that is never struck.
    """
    order = defect_order(kind, rates)
    initial_turns = rng.random()
    revolutions, first_number = renewal_process(order=order, slip=slip, span_rev=span_rev, rng=rng, since_rev=since_rev)
    rolling = RollingKinematics(
        kind=kind,
        rates=rates,
        impacts_rev=revolutions,
        first_number=first_number,
        place_turns=place_turns if kind == "outer_race" else initial_turns,
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
        expected_rate=order * (1 - slip.mean_slip),
    )


def passage_revolutions(
    kind: str,
    *,
    rates: "BearingOrders",
    size_m: float,
    pitch_diameter_m: float,
    element_diameter_m: float,
    contact_angle_rad: float = 0.0,
) -> float:
    """Return the rotation of the reference shaft while a contact passes a spall of `size_m`, in revolutions.

    ``size / (pi D / 2 (1 - (d cos a / D)^2) relative)``: under pure rolling the contact moves over the outer race, the
    inner race and the element with the same speed, and `relative` is that of the rings in orders. The time from entry
    to impact is half of it for an element that bridges the spall (Sawalhi and Randall 2011, Mech. Syst. Signal Process.
    25, 846-870).

    Raises
    ------
    ValueError
        A spall so long that the next element enters before the last one has left.
    """
    along = element_diameter_m * math.cos(contact_angle_rad) / pitch_diameter_m
    defect_phase = math.pi * pitch_diameter_m / 2 * (1 - along**2) * rates.relative
    turned = size_m / defect_phase
    soonest = 1 / defect_order(kind, rates)
    if not turned < soonest:
        raise ValueError(
            f'size_m = {size_m:g} takes {turned:g} rev to pass, but {kind} of "{rates.name}" is struck every '
            f"{soonest:g} rev; keep it below {soonest * defect_phase:g}"
        )
    return turned
