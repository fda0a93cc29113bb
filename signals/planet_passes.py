"""When which tooth of a planetary stage passes the sensor on its ring, and with what weight it is heard.

The ring stands still, and angles are those of the carrier, in revolutions. Between two passes of a planet Z_ring
teeth go by, so pass n shows tooth ``n Z_ring mod Z_planet`` of the planet (McFadden & Howard 1990, Aeronautical
Research Laboratory, Propulsion Report 183).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._checks import Array, number, positive, real_vector, whole

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from signals.resampling import AngularSignal


@dataclass(frozen=True, kw_only=True)
class PlanetaryTeeth:
    """Teeth of a planetary stage with a fixed ring, and where its planets sit on the carrier.

    ``positions_rev`` are the planets' places ahead of planet 0, in the carrier's sense of rotation and in its
    revolutions; without them the planets are evenly spaced. Each must be a whole multiple of
    ``1 / (ring + sun)``, or the planet's teeth would not fit both gears.
    """

    ring: int
    planet: int
    sun: int
    planets: int
    positions_rev: tuple[Fraction, ...] = ()

    def __post_init__(self) -> None:
        """Check teeth and places, and fill in even spacing."""
        for name in ("ring", "planet", "sun"):
            whole(getattr(self, name), name=name, least=3)
        whole(self.planets, name="planets", least=1)
        places = self.positions_rev or tuple(Fraction(k, self.planets) for k in range(self.planets))
        if len(places) != self.planets or places[0] != 0:
            raise ValueError(
                f"positions_rev={self.positions_rev} must give all {self.planets} planets their place, planet 0 at 0."
            )
        for place in places:
            if (place * (self.ring + self.sun)).denominator != 1:
                raise ValueError(
                    f"a planet {place} of a revolution ahead does not fit between {self.ring} and {self.sun} teeth: "
                    f"positions_rev must be multiples of 1/{self.ring + self.sun}; give the true ones as Fractions."
                )
        object.__setattr__(self, "positions_rev", places)

    @property
    def planet_reset(self) -> int:
        """Carrier revolutions after which the same planet teeth pass the sensor again."""
        return self.planet // math.gcd(self.ring, self.planet)

    @property
    def sun_reset(self) -> int:
        """Carrier revolutions after which a planet brings the same sun teeth to the sensor again."""
        return self.sun // math.gcd(self.ring, self.sun)

    @property
    def planet_sequence(self) -> tuple[int, ...]:
        """Which tooth of a planet meshes with the ring at the sensor, pass by pass, (planet_reset,)."""
        return tuple(n * self.ring % self.planet for n in range(self.planet_reset))

    @property
    def sun_sequence(self) -> tuple[int, ...]:
        """Which tooth of the sun meshes with a planet at the sensor, pass by pass, (sun_reset,).

        Counted for planet 0; for a planet at place p subtract ``(ring + sun) p``, modulo the sun's teeth.
        """
        return tuple(n * self.ring % self.sun for n in range(self.sun_reset))


@dataclass(frozen=True, kw_only=True)
class PassWindow:
    """The weight of what is heard so many teeth before and after a pass: flat, with cosine tapers at both ends.

    No taper is the rectangular window, half the width the Hann window, anything between a Tukey window. Windows one
    tooth apart add up to ``width - taper`` everywhere if both are whole numbers (for a Hann window if the width is).
    """

    width_teeth: float
    taper_teeth: float

    def __post_init__(self) -> None:
        """Check that the tapers fit."""
        positive(self.width_teeth, name="width_teeth")
        if not 0 <= number(self.taper_teeth, name="taper_teeth") <= self.width_teeth / 2:
            raise ValueError(
                f"taper_teeth={self.taper_teeth} must lie between 0 and {self.width_teeth / 2:g}, half the width."
            )

    @classmethod
    def rectangular(cls, width_teeth: float) -> PassWindow:
        """Return a window of equal weights (McFadden 1991)."""
        return cls(width_teeth=width_teeth, taper_teeth=0.0)

    @classmethod
    def hann(cls, width_teeth: float) -> PassWindow:
        """Return a raised cosine (McFadden 1994)."""
        return cls(width_teeth=width_teeth, taper_teeth=width_teeth / 2)

    @classmethod
    def tukey(cls, width_teeth: float, *, taper_teeth: float) -> PassWindow:
        """Return a flat window that falls over `taper_teeth` at either end."""
        return cls(width_teeth=width_teeth, taper_teeth=taper_teeth)

    def weight(self, teeth: ArrayLike) -> Array:
        """Return the weight (m,) at `teeth` (m,) from the pass; the lower edge is in, the upper one is not."""
        place = np.asarray(teeth, dtype=np.float64)
        half = self.width_teeth / 2
        inside = (place >= -half) & (place < half)
        if self.taper_teeth == 0:
            return inside.astype(np.float64)
        into = np.clip((half - np.abs(place)) / self.taper_teeth, 0.0, 1.0)
        return np.where(inside, 0.5 - 0.5 * np.cos(np.pi * into), 0.0)


@dataclass(frozen=True, kw_only=True)
class PassAngle:
    """A carrier angle at which planet 0 passes the sensor, and how sure that is.

    With evenly spaced planets it is known up to which planet is called planet 0, and lies below ``1 / planets``.
    ``modulation`` is the swing of the vibration's power with the planets over its mean.
    """

    first_pass_rev: float
    std_rev: float
    modulation: float


def pass_angle(signal: AngularSignal, *, teeth: PlanetaryTeeth) -> PassAngle:
    """Find the carrier angle of the planets' passes from how the vibration swells when one is near.

    The power over carrier angle is correlated with a pulse at every planet's place, over its first harmonics up to the
    number of planets; the angle of largest correlation is returned, with the standard deviation that the scatter
    between carrier revolutions gives it. After D'Elia, Mucchi & Dalpiaz ("On the time synchronous average in planetary
    gearboxes"), who read it from the flow of power in the average of the ring.

    Parameters
    ----------
    signal : AngularSignal
        A sensor on the ring, over the carrier's angle; best of a band about the mesh. Planets are taken to sound
        loudest when nearest. Where some are louder than others and unevenly spaced, the angle leans to the louder ones
        by a part of their unevenness, which its standard deviation does not show.
    teeth : PlanetaryTeeth
        Its number of planets and their places.

    Raises
    ------
    ValueError
        Fewer than two revolutions, or power that swings no more with the planets than by chance.
    """
    values = real_vector(signal.values, name="the angular signal")
    count, per_rev = signal.revolutions, signal.samples_per_rev
    if count < 2:  # noqa: PLR2004
        raise ValueError(f"{count} carrier revolution shows no scatter to judge the passes by; give two or more.")
    power = ((values - values.mean()) ** 2)[: count * per_rev].reshape(count, per_rev)
    harmonic = np.arange(1, teeth.planets + 1)
    lines = np.asarray(fft.rfft(power, axis=1))[:, harmonic] / per_rev
    places = np.array([float(place) for place in teeth.positions_rev])
    # a planet ahead by p passes earlier by p; and angles count from the signal's start
    pulses = np.exp(2j * np.pi * harmonic[:, None] * (places + signal.start_rev)).sum(axis=1)
    weighted = lines * np.conj(pulses)
    angle = _summit(weighted.mean(axis=0), harmonic)
    turned = weighted * np.exp(2j * np.pi * harmonic * angle)
    slope = -(2 * np.pi * harmonic * turned.imag).sum(axis=1)
    bend = (4 * np.pi**2 * harmonic**2 * turned.real).sum(axis=1).mean()
    std = float(slope.std(ddof=1) / math.sqrt(count) / bend)
    if not 0 <= std < 1 / (2 * np.pi * teeth.planets * 3):
        raise ValueError(
            f"the power over the carrier's angle does not swing with {teeth.planets} planets: their passes would be "
            f"known to {std:.2g} revolutions only; give more revolutions, a band about the mesh, or the angle itself."
        )
    size = np.sum(np.abs(pulses) ** 2) * power.mean()
    even = all(place == Fraction(k, teeth.planets) for k, place in enumerate(teeth.positions_rev))
    return PassAngle(
        first_pass_rev=angle % (1 / teeth.planets if even else 1.0),
        std_rev=std,
        modulation=float(2 * turned.real.sum(axis=1).mean() / size * teeth.planets),
    )


def _summit(lines: NDArray[np.complex128], harmonic: NDArray[np.int64]) -> float:
    """Return the angle in revolutions where ``Re sum lines exp(2 pi j harmonic angle)`` is largest."""
    fine = 64 * int(harmonic[-1])
    grid = np.arange(fine) / fine
    angle = float(grid[np.argmax((np.exp(2j * np.pi * np.outer(grid, harmonic)) @ lines).real)])
    for _ in range(6):  # Newton's method, from within 1/128 of a swing
        turned = lines * np.exp(2j * np.pi * harmonic * angle)
        bend = (2 * np.pi * harmonic**2 * turned.real).sum()
        if bend > 0:
            angle -= float((harmonic * turned.imag).sum() / bend)
    return angle
