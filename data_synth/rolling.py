"""Exact position of the parts of a bearing whose defect is struck with slip.

One slip applies to all parts: between two impacts, cage and elements advance by exactly what pure rolling gives them
from one to the next, in proportion to the reference shaft. So their position follows from the impacts.
"""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.profile import Array

if TYPE_CHECKING:
    from hums.orders import BearingOrders

KINDS = ("inner_race", "outer_race", "rolling_element", "cage")


def defect_order(kind: str, rates: "BearingOrders") -> float:
    """Return the impacts of a defect in a revolution of the reference shaft under pure rolling.

    Raises
    ------
    ValueError
        An unknown kind, or one that is never struck.
    """
    if kind not in KINDS:
        raise ValueError(f'kind = "{kind}" is no bearing fault; valid: {", ".join(KINDS)}')
    order = float(getattr(rates, kind))
    if order == 0:
        raise ValueError(f'{kind} of "{rates.name}" is never struck: its parts stand still against each other')
    return order


def signed_cage_order(rates: "BearingOrders") -> float:
    """Return the order of the cage under pure rolling relative to the load zone, signed like those of the rings."""
    return rates.outer_ring + _sense(rates) * rates.cage_to_outer


def _sense(rates: "BearingOrders") -> float:
    """Return the sense of the inner ring's rotation relative to the outer ring, +1 or -1."""
    return math.copysign(1.0, rates.inner_ring - rates.outer_ring)


@dataclass(frozen=True, kw_only=True)
class RollingKinematics:
    """Kinematics of a bearing by the impacts of one defect.

    All turns are seen from the carrier of the bearing, as the load zone is, and signed like those of the reference
    shaft.

    Attributes
    ----------
    kind : {"inner_race", "outer_race", "rolling_element", "cage"}
    rates : BearingOrders
        Orders under pure rolling.
    impacts_rev : (n,) array
        Revolutions of the reference shaft at the impacts, rising: the last before the interval of interest, those in
        it, and the first after it.
    first_number : int
        Number of the first of them: impact 0 is the first within the record, or nearly so.
    place_turns : float
        Place of the defect at revolution zero, in turns from the largest load: that of a ring, or of the cage at impact
        0 for a defect of an element or of the cage.
    """

    kind: str
    rates: "BearingOrders"
    impacts_rev: Array = field(repr=False, metadata={"dims": ("knot",), "units": "rev"})
    first_number: int
    place_turns: float

    def defect_phase(self, revolutions: ArrayLike) -> Array:
        """Return the phase of the defect in cycles (n,): whole at impacts, linear in the shaft's angle between."""
        return np.asarray(
            np.interp(np.asarray(revolutions), self.impacts_rev, self.first_number + np.arange(self.impacts_rev.size))
        )

    def defect_turns(self, revolutions: ArrayLike) -> Array:
        """Return the place of the defect in turns (n,), from the largest load."""
        return self._spot(np.asarray(revolutions, dtype=np.float64), self.defect_phase(revolutions))

    def cage_turns(self, revolutions: ArrayLike) -> Array:
        """Return the turns of the cage (n,): at whole ones element 1 of Z has the largest load."""
        return self._cage(np.asarray(revolutions, dtype=np.float64), self.defect_phase(revolutions))

    def element_turns(self, revolutions: ArrayLike) -> Array:
        """Return the turns (n,) of an element about its own axis, relative to the cage; it meets both races in one."""
        order = defect_order(self.kind, self.rates)
        return np.asarray(self.rates.rolling_element / 2 / order * self.defect_phase(revolutions))

    @property
    def numbers(self) -> NDArray[np.int_]:
        """Numbers of the impacts of interest, (n - 2,)."""
        return self.first_number + 1 + np.arange(self.impacts_rev.size - 2)

    def at_impacts(self) -> tuple[Array, Array]:
        """Return the turns of defect and cage, (n - 2,), at the impacts of interest."""
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
