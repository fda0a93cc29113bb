"""Rotation and defect orders of one bearing, as `hums.gearbox.defect_orders` finds them."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class BearingOrders:
    """Rotation and defect orders of one bearing.

    With pure rolling and Z elements, ``inner_race + outer_race = Z relative`` and ``outer_race = Z cage_to_outer``.

    Attributes
    ----------
    name : str
    relative : float
        Rotation of the rings relative to each other.
    inner_ring, outer_ring, cage : float
        Rotation relative to the load zone, which is fixed in the body that carries the bearing's axis: the frame, or
        the planet carrier for a planet's bearing.
    inner_race, outer_race, rolling_element : float
        Impacts of a defect: BPFI, BPFO and, for both races, 2 BSF.
    cage_to_outer : float
        Rotation of the cage relative to the outer ring.
    elements : int
        Number of rolling elements.
    carried : float
        Rotation of the body that carries the bearing's axis.
    """

    name: str
    relative: float
    inner_ring: float
    outer_ring: float
    inner_race: float
    outer_race: float
    rolling_element: float
    cage: float
    cage_to_outer: float
    elements: int
    carried: float = 0.0
