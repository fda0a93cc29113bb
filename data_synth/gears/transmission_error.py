"""Transmission errors: departure of a rigid, unloaded mesh from conjugate motion along its line of action.

An error e(phase) is subtracted from the deflection of a mesh. Phases are in mesh cycles; the error of a gear has a
period of as many cycles as it has teeth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from data_synth.gears.mesh_stiffness import Array, ComplexArray

_NEAR = 1e-9  # cycles: phases nearer than this are one


class TransmissionError(Protocol):
    """Departure from conjugate motion along the line of action, m."""

    @property
    def period(self) -> int:
        """Mesh cycles after which it repeats."""

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the error in m at phases in mesh cycles, any shape."""


@dataclass(frozen=True, kw_only=True)
class ProfileError:
    """An error common to all teeth of a gear (relief, wear, pressure angle), given by its mesh harmonics.

    ``e = Re sum_h harmonics_m[h - 1] exp(2j pi h phase)``, with `harmonics_m` (h,) complex in m.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.dynamics import ProfileError
    >>> (1e6 * ProfileError(harmonics_m=np.array([3e-6]))([0.0, 0.25, 0.5])).round(9).tolist()  # 3 um cos(2 pi phase)
    [3.0, 0.0, -3.0]
    """

    harmonics_m: ComplexArray = field(metadata={"dims": ("harmonic",), "units": "m"})
    period: int = field(default=1, init=False)

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the error in m at phases in mesh cycles, any shape."""
        turn = np.exp(2j * np.pi * np.asarray(phase_cycles, dtype=np.float64))
        total = np.zeros_like(turn)
        for value in np.asarray(self.harmonics_m)[::-1]:
            total = (total + value) * turn
        return np.asarray(total.real)


@dataclass(frozen=True, kw_only=True)
class PitchError:
    """Cumulative pitch error of each tooth of a gear.

    Attributes
    ----------
    teeth_m : (z,) array
        Cumulative pitch error of each tooth along the line of action, m; tooth j enters at phase j.
    handover : float
        Fraction of the cycle, from the entry of a pair, over which the error passes linearly from one tooth to the
        next, 0 to 1: ``contact ratio - 1`` for contact ratios below 2. 0: it jumps.

    Raises
    ------
    ValueError
        If `handover` is out of range.

    Examples
    --------
    >>> from data_synth.gears.transmission_error import PitchError
    >>> (1e6 * PitchError(teeth_m=[0.0, 4e-6, 0.0], handover=0.5)([1.25, 1.75])).round(9).tolist()
    [2.0, 4.0]
    """

    teeth_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    handover: float

    def __post_init__(self) -> None:
        if not 0 <= self.handover <= 1:
            raise ValueError(f"handover = {self.handover!r} cycles must be between 0 and 1.")

    @property
    def period(self) -> int:
        """The number of teeth."""
        return int(np.size(self.teeth_m))

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which it or its slope jumps: the ends of each transition to a tooth with a different error."""
        differing = np.flatnonzero(np.asarray(self.teeth_m) != np.roll(self.teeth_m, 1)).astype(np.float64)
        return tuple(np.unique(np.remainder([differing, differing + self.handover], self.period)).tolist())

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the error in m at phases in mesh cycles, any shape."""
        phase, teeth = np.asarray(phase_cycles, dtype=np.float64), np.asarray(self.teeth_m, dtype=np.float64)
        whole = np.floor(phase)
        tooth = whole.astype(np.int64) % teeth.size
        share = np.minimum((phase - whole) / self.handover, 1.0) if self.handover else np.ones_like(phase)
        return np.asarray(share * teeth[tooth] + (1 - share) * teeth[tooth - 1])


@dataclass(frozen=True, kw_only=True)
class Eccentricity:
    """Eccentricity of a gear: ``e = eccentricity_m sin(2 pi phase / teeth + phase_rad)``.

    The error is the component of the base circle's displacement along the line of action, so its amplitude is the
    eccentricity itself.

    Examples
    --------
    >>> from data_synth.gears.transmission_error import Eccentricity
    >>> (1e6 * Eccentricity(teeth=20, eccentricity_m=10e-6)([0, 5, 10])).round(9).tolist()
    [0.0, 10.0, 0.0]
    """

    teeth: int
    eccentricity_m: float
    phase_rad: float = 0.0

    @property
    def period(self) -> int:
        """The number of teeth."""
        return self.teeth

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the error in m at phases in mesh cycles, any shape."""
        turn = 2 * np.pi / self.teeth * np.asarray(phase_cycles, dtype=np.float64) + self.phase_rad
        return np.asarray(self.eccentricity_m * np.sin(turn))


@dataclass(frozen=True, kw_only=True)
class SumOfErrors:
    """Sum of several errors of either gear, shifted in phase: ``sum part(phase + by_cycles)``."""

    parts: tuple[TransmissionError, ...]
    by_cycles: float = 0.0

    @property
    def period(self) -> int:
        """The least common multiple of its parts' periods."""
        return math.lcm(*(part.period for part in self.parts))

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which a part or its slope jumps."""
        period, found = self.period, [np.zeros(0)]
        for part in self.parts:
            own = np.asarray(getattr(part, "jumps", ()), dtype=np.float64) - self.by_cycles
            found.append((own + part.period * np.arange(period // part.period)[:, None]).ravel() % period)
        every = np.sort(np.concatenate(found))
        apart = np.diff(every, prepend=-1.0) > _NEAR
        return tuple(every[apart & (every < period - _NEAR)].tolist())

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the error in m at phases in mesh cycles, any shape."""
        phase = np.asarray(phase_cycles, dtype=np.float64) + self.by_cycles
        return np.asarray(sum((part(phase) for part in self.parts), np.zeros_like(phase)))
