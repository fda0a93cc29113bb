"""Windowed synchronous averages of one planet or of the sun from a sensor on the ring.

The vibration of a planet reaches the sensor mainly while the planet passes it. The tooth in mesh follows from the
numbers of teeth: at pass n it is tooth ``n Z_ring mod Z_planet``. A window about each pass selects a few teeth, which
are averaged at their angle on the planet; after ``Z_planet / gcd(Z_ring, Z_planet)`` passes the sequence repeats.
Sources: McFadden & Howard 1990 (Aeronautical Research Laboratory, Propulsion Report 183); McFadden 1991 ("A technique
for calculating the time domain averages of the vibration of the individual planet gears and the sun gear in an
epicyclic gearbox", J. Sound Vib. 144(1), 163-172); McFadden 1994 (the same with windows, J. Vib. Acoust. 116(2),
179-187).

The ring is fixed, and angles are those of the carrier. Other planets are attenuated only by their transfer path: their
contribution within the window remains in the average.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._validation import Array, checked, number, positive, real_vector, whole
from signals.angle.averaging import SynchronousAverage

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from signals.resampling.resampling import AngularSignal


# ---- Planet passes of a sensor on the ring of a planetary stage: tooth sequences, windows and the pass angle ---------
# The ring is fixed, and angles are those of the carrier, in revolutions. Between two passes of a planet Z_ring teeth
# mesh, so that tooth ``n Z_ring mod Z_planet`` of the planet is in mesh at the sensor at pass n (McFadden & Howard
# 1990, Aeronautical Research Laboratory, Propulsion Report 183).


@dataclass(frozen=True, kw_only=True)
class PlanetaryTeeth:
    """Numbers of teeth of a planetary stage with a fixed ring, and the positions of its planets.

    Attributes
    ----------
    ring, planet, sun : int
        Numbers of teeth.
    planets : int
        Number of planets.
    positions_rev : tuple of Fraction
        Angle of each planet ahead of planet 0, in the carrier's direction of rotation and in revolutions; default:
        evenly spaced. Each must be a multiple of ``1 / (ring + sun)``, the assembly condition.

    Raises
    ------
    ValueError
        Too few teeth, or positions that violate the assembly condition.

    Examples
    --------
    >>> from signals import PlanetaryTeeth
    >>> teeth = PlanetaryTeeth(ring=99, planet=39, sun=21, planets=3)
    >>> teeth.planet_reset, teeth.planet_sequence[:4]
    (13, (0, 21, 3, 24))
    """

    ring: int
    planet: int
    sun: int
    planets: int
    positions_rev: tuple[Fraction, ...] = ()

    def __post_init__(self) -> None:
        """Check teeth and positions; default to even spacing."""
        for name in ("ring", "planet", "sun"):
            whole(getattr(self, name), name=name, least=3)
        whole(self.planets, name="planets", least=1)
        places = self.positions_rev or tuple(Fraction(k, self.planets) for k in range(self.planets))
        if len(places) != self.planets or places[0] != 0:
            raise ValueError(
                f"positions_rev={self.positions_rev} must hold a position for each of {self.planets} planets, 0 first."
            )
        for place in places:
            if (place * (self.ring + self.sun)).denominator != 1:
                raise ValueError(
                    f"a planet {place} of a revolution ahead cannot be assembled between {self.ring} and {self.sun} "
                    f"teeth: positions_rev must be multiples of 1/{self.ring + self.sun}; give exact Fractions."
                )
        object.__setattr__(self, "positions_rev", places)

    @property
    def planet_reset(self) -> int:
        """Hunting-tooth period of planet and ring at the sensor, in carrier revolutions."""
        return self.planet // math.gcd(self.ring, self.planet)

    @property
    def sun_reset(self) -> int:
        """Carrier revolutions after which the same sun tooth again meshes with a planet at the sensor."""
        return self.sun // math.gcd(self.ring, self.sun)

    @property
    def planet_sequence(self) -> tuple[int, ...]:
        """Tooth of a planet in mesh with the ring at the sensor, for each pass, (planet_reset,)."""
        return tuple(n * self.ring % self.planet for n in range(self.planet_reset))

    @property
    def sun_sequence(self) -> tuple[int, ...]:
        """Tooth of the sun in mesh with a planet at the sensor, for each pass, (sun_reset,).

        It is for planet 0; for a planet at position p subtract ``(ring + sun) p``, modulo the number of sun teeth.
        """
        return tuple(n * self.ring % self.sun for n in range(self.sun_reset))


@dataclass(frozen=True, kw_only=True)
class PassWindow:
    """Tukey window about a planet pass, in teeth: flat, with cosine tapers at both ends.

    Without a taper it is rectangular; with one of half the width, a Hann window. Windows one tooth apart add up to the
    constant ``width - taper`` if both are whole numbers (for a Hann window, if the width is).

    Attributes
    ----------
    width_teeth : float
        Full width in teeth.
    taper_teeth : float
        Length of either taper in teeth, at most half the width.

    Raises
    ------
    ValueError
        A width that is not positive, or a taper outside 0 to half the width.

    Examples
    --------
    >>> from signals import PassWindow
    >>> PassWindow.hann(4).weight([-2, -1, 0, 1]).round(6).tolist()
    [0.0, 0.5, 1.0, 0.5]
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
        """Return a Hann window, a raised cosine (McFadden 1994)."""
        return cls(width_teeth=width_teeth, taper_teeth=width_teeth / 2)

    @classmethod
    def tukey(cls, width_teeth: float, *, taper_teeth: float) -> PassWindow:
        """Return a window with cosine tapers of `taper_teeth` at either end."""
        return cls(width_teeth=width_teeth, taper_teeth=taper_teeth)

    def weight(self, teeth: ArrayLike) -> Array:
        """Return the weights (m,) at `teeth` (m,) from the pass, including the lower edge but not the upper."""
        offset = np.asarray(teeth, dtype=np.float64)
        half = self.width_teeth / 2
        inside = (offset >= -half) & (offset < half)
        if self.taper_teeth == 0:
            return inside.astype(np.float64)
        into = np.clip((half - np.abs(offset)) / self.taper_teeth, 0.0, 1.0)
        return np.where(inside, 0.5 - 0.5 * np.cos(np.pi * into), 0.0)


@dataclass(frozen=True, kw_only=True)
class PassAngle:
    """A carrier angle at which planet 0 passes the sensor, with its standard deviation.

    Attributes
    ----------
    first_pass_rev : float
        The angle in revolutions; for evenly spaced planets, any of which may be planet 0, it lies below
        ``1 / planets``.
    std_rev : float
        Standard deviation in revolutions, from the scatter between revolutions.
    modulation : float
        Amplitude of the power modulation by the planets over the mean power.

    Examples
    --------
    >>> from signals import PassAngle
    >>> PassAngle(first_pass_rev=0.1, std_rev=0.002, modulation=0.8).first_pass_rev
    0.1
    """

    first_pass_rev: float
    std_rev: float
    modulation: float


@checked
def pass_angle(signal: AngularSignal, *, teeth: PlanetaryTeeth) -> PassAngle:
    """Estimate the carrier angle of the planet passes from the modulation of the vibration power.

    The power over carrier angle is correlated with a pulse at the position of each planet, for harmonics 1 to the
    number of planets; the result is the angle of the largest correlation, with a standard deviation from the scatter
    between carrier revolutions. D'Elia, Mucchi & Dalpiaz ("On the time synchronous average in planetary gearboxes") use
    the power of the average of the ring instead.

    Parameters
    ----------
    signal : AngularSignal
        Signal of a sensor on the ring over the angle of the carrier, preferably band-pass filtered about the mesh
        order. The vibration of a planet is assumed to be largest when it is nearest. Unequal planets at uneven
        positions bias the angle by a fraction of the unevenness, which the standard deviation does not include.
    teeth : PlanetaryTeeth
        Number and positions of the planets.

    Returns
    -------
    PassAngle

    Raises
    ------
    ValueError
        Fewer than two revolutions, or no significant modulation of the power by the planets.

    Examples
    --------
    Three planets, one of which passes the sensor at 0.1 revolutions:

    >>> import numpy as np
    >>> from signals import AngularSignal, PlanetaryTeeth, pass_angle
    >>> rev = np.arange(30 * 792) / 792
    >>> x = np.sqrt(1 + np.cos(2 * np.pi * 3 * (rev - 0.1))) * np.random.default_rng(1).standard_normal(rev.size)
    >>> signal = AngularSignal(values=x, samples_per_rev=792, start_rev=0.0, passband_orders=348.0)
    >>> found = pass_angle(signal, teeth=PlanetaryTeeth(ring=99, planet=39, sun=21, planets=3))
    >>> bool(abs(found.first_pass_rev - 0.1) < 0.01)
    True
    """
    values = real_vector(signal.values, name="the angular signal")
    count, per_rev = signal.revolutions, signal.samples_per_rev
    if count < 2:  # noqa: PLR2004
        raise ValueError(
            f"carrier revolutions: {count}; the standard deviation is that of their scatter, so give at least two."
        )
    power = ((values - values.mean()) ** 2)[: count * per_rev].reshape(count, per_rev)
    harmonic = np.arange(1, teeth.planets + 1)
    lines = np.asarray(fft.rfft(power, axis=1))[:, harmonic] / per_rev
    positions = np.array([float(position) for position in teeth.positions_rev])
    # a planet ahead by p passes earlier by p; angles are relative to the start of the signal
    pulses = np.exp(2j * np.pi * harmonic[:, None] * (positions + signal.start_rev)).sum(axis=1)
    weighted = lines * np.conj(pulses)
    angle = _angle_of_maximum(weighted.mean(axis=0), harmonic)
    shifted = weighted * np.exp(2j * np.pi * harmonic * angle)
    slope = -(2 * np.pi * harmonic * shifted.imag).sum(axis=1)
    curvature = (4 * np.pi**2 * harmonic**2 * shifted.real).sum(axis=1).mean()
    std = float(slope.std(ddof=1) / math.sqrt(count) / curvature)
    if not 0 <= std < 1 / (2 * np.pi * teeth.planets * 3):
        raise ValueError(
            f"the power over the carrier angle is not modulated by {teeth.planets} planets: their passes would be "
            f"known only to {std:.2g} revolutions; give more revolutions, a band about the mesh, or first_pass_rev "
            "itself."
        )
    size = np.sum(np.abs(pulses) ** 2) * power.mean()
    even = all(position == Fraction(k, teeth.planets) for k, position in enumerate(teeth.positions_rev))
    return PassAngle(
        first_pass_rev=angle % (1 / teeth.planets if even else 1.0),
        std_rev=std,
        modulation=float(2 * shifted.real.sum(axis=1).mean() / size * teeth.planets),
    )


def _angle_of_maximum(lines: NDArray[np.complex128], harmonic: NDArray[np.int64]) -> float:
    """Return the angle in revolutions where ``Re sum lines exp(2 pi j harmonic angle)`` is largest."""
    fine = 64 * int(harmonic[-1])
    grid = np.arange(fine) / fine
    angle = float(grid[np.argmax((np.exp(2j * np.pi * np.outer(grid, harmonic)) @ lines).real)])
    for _ in range(6):  # Newton's method, from within 1/128 of a period
        shifted = lines * np.exp(2j * np.pi * harmonic * angle)
        curvature = (2 * np.pi * harmonic**2 * shifted.real).sum()
        if curvature > 0:
            angle -= float((harmonic * shifted.imag).sum() / curvature)
    return angle


# ---- Planets ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class WindowedAverage(SynchronousAverage):
    """One revolution of a planet or of the sun, relative to the carrier, averaged over planet passes.

    Attributes
    ----------
    values, standard_error, ratio, start_rev, passband_orders
        As in `SynchronousAverage`; the standard error is based on the scatter between tooth sequences. Tooth 0 is
        centred on angle zero.
    revolutions : int
        Number of whole tooth sequences averaged.
    weights : (angle,) array
        Sum of the window weights at each angle.
    teeth : int
        Number of teeth of the gear.
    passes : int
        Number of planet passes averaged.
    window : PassWindow
        Window about each pass.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal, PassWindow, PlanetaryTeeth, planet_average
    >>> teeth = PlanetaryTeeth(ring=99, planet=39, sun=21, planets=3)
    >>> signal = AngularSignal(values=np.ones(30 * 792), samples_per_rev=792, start_rev=0.0, passband_orders=348.0)
    >>> average = planet_average(signal, teeth=teeth, planet=0, first_pass_rev=0.5, window=PassWindow.hann(6))
    >>> average.revolutions, average.passes, average.by_tooth.shape
    (2, 26, (39, 8))
    """

    weights: Array = field(metadata={"dims": ("angle",), "units": "1"})
    teeth: int
    passes: int
    window: PassWindow

    @property
    def by_tooth(self) -> Array:
        """Average by tooth, (teeth, samples per tooth); each row starts half a tooth before the middle of its tooth."""
        per_tooth = self.values.size // self.teeth
        return np.roll(self.values, per_tooth // 2).reshape(self.teeth, per_tooth)


@checked
def planet_average(
    signal: AngularSignal, *, teeth: PlanetaryTeeth, planet: int, first_pass_rev: float, window: PassWindow
) -> WindowedAverage:
    """Return the average of one planet over its revolution relative to the carrier (McFadden 1991, 1994).

    Parameters
    ----------
    signal : AngularSignal
        Signal of a sensor on the ring or housing over the angle of the carrier, with a whole number of samples per ring
        tooth.
    teeth : PlanetaryTeeth
        Numbers of teeth of the stage.
    planet : int
        Index of the planet, from 0.
    first_pass_rev : float
        A carrier angle, in revolutions, at which planet 0 passes the sensor; `pass_angle` estimates one.
    window : PassWindow
        Its width in teeth must be at least the greatest common divisor of ring and planet teeth, to cover all teeth.

    Returns
    -------
    WindowedAverage
        Tooth 0 is the one at the sensor at the pass at ``first_pass_rev - positions_rev[planet]``.

    Raises
    ------
    ValueError
        A record shorter than one whole sequence of teeth, a grid that does not fit the teeth, or a window so narrow
        that teeth are missed.

    Examples
    --------
    A signal locked to the teeth of planet 0, which passes at 0.5 revolutions of the carrier, is recovered:

    >>> import numpy as np
    >>> from signals import AngularSignal, PassWindow, PlanetaryTeeth, planet_average
    >>> teeth = PlanetaryTeeth(ring=99, planet=39, sun=21, planets=3)
    >>> planet_angle = 2 * np.pi * 99 / 39 * (np.arange(30 * 792) / 792 - 0.5)
    >>> x = np.cos(5 * planet_angle)
    >>> signal = AngularSignal(values=x, samples_per_rev=792, start_rev=0.0, passband_orders=348.0)
    >>> average = planet_average(signal, teeth=teeth, planet=0, first_pass_rev=0.5, window=PassWindow.hann(6))
    >>> bool(np.allclose(average.values, np.cos(5 * 2 * np.pi * np.arange(312) / 312)))
    True
    """
    which = whole(planet, name="planet", least=0, most=teeth.planets - 1)
    first = number(first_pass_rev, name="first_pass_rev") - float(teeth.positions_rev[which])
    gear = _Gear(name="planet", teeth=teeth.planet, ring=teeth.ring)
    return _average(signal, gear, [_gather(signal, gear, pass_rev=first, at_pass=0, window=window)], window)


@checked
def sun_average(
    signal: AngularSignal, *, teeth: PlanetaryTeeth, first_pass_rev: float, window: PassWindow
) -> WindowedAverage:
    """Return the average of the sun over its revolution relative to the carrier, from the passes of all planets.

    A planet at position p meshes with the sun ``(ring + sun) p`` teeth behind planet 0; the averages over the passes of
    each planet are shifted by this number and averaged (McFadden 1991).

    Parameters
    ----------
    signal, teeth, first_pass_rev, window
        As in `planet_average`, with the teeth of the sun instead of those of the planet.

    Returns
    -------
    WindowedAverage
        Tooth 0 is the one in mesh with planet 0 at `first_pass_rev`.

    Raises
    ------
    ValueError
        As `planet_average`.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal, PassWindow, PlanetaryTeeth, sun_average
    >>> teeth = PlanetaryTeeth(ring=99, planet=39, sun=21, planets=3)
    >>> sun_angle = 2 * np.pi * 99 / 21 * (np.arange(30 * 792) / 792 - 0.5)
    >>> x = np.cos(4 * sun_angle)
    >>> signal = AngularSignal(values=x, samples_per_rev=792, start_rev=0.0, passband_orders=348.0)
    >>> average = sun_average(signal, teeth=teeth, first_pass_rev=0.5, window=PassWindow.hann(6))
    >>> average.revolutions
    4
    """
    first = number(first_pass_rev, name="first_pass_rev")
    gear = _Gear(name="sun", teeth=teeth.sun, ring=teeth.ring)
    by_planet = [
        _gather(
            signal,
            gear,
            pass_rev=first - float(position),
            at_pass=-int(position * (teeth.ring + teeth.sun)),
            window=window,
        )
        for position in teeth.positions_rev
    ]
    return _average(signal, gear, by_planet, window)


@dataclass(frozen=True, kw_only=True)
class _Gear:
    """The averaged gear: its name, its number of teeth and that of the ring."""

    name: str
    teeth: int
    ring: int

    @property
    def reset(self) -> int:
        """Passes in a tooth sequence."""
        return self.teeth // math.gcd(self.ring, self.teeth)


def _gather(
    signal: AngularSignal, gear: _Gear, *, pass_rev: float, at_pass: int, window: PassWindow
) -> tuple[Array, Array]:
    """Return the revolution of the gear from each tooth sequence, (sequences, angles), and the sums of weights.

    Tooth `at_pass` is at the sensor at the carrier angle `pass_rev`.
    """
    values = real_vector(signal.values, name="the angular signal")
    per_tooth = _samples_per_tooth(signal, gear, window)
    per_rev, reset, angles = signal.samples_per_rev, gear.reset, gear.teeth * per_tooth
    middle = (pass_rev - signal.start_rev) * per_rev  # in samples
    if not abs(middle) <= 1e6 * values.size:  # beyond 1e6 record lengths, angles lose the precision of a tooth
        raise ValueError(
            f"first_pass_rev={pass_rev:g} is far from the signal, which starts at {signal.start_rev:g} rev; give a "
            "pass within it or near it."
        )
    nearest = round(middle)
    half = math.ceil(window.width_teeth / 2 * per_tooth) + 1
    steps = np.arange(-half, half + 1)
    weight = window.weight((steps + (nearest - middle)) / per_tooth)
    steps, weight = steps[weight > 0], weight[weight > 0]
    earliest = -((nearest + steps[0]) // per_rev)
    passes = max(0, (values.size - 1 - nearest - steps[-1]) // per_rev - earliest + 1)
    sequences = int(passes // reset)
    if not sequences:
        raise ValueError(
            f"the record holds {passes} complete passes of a planet, but each {gear.name} tooth is at the sensor only "
            f"once in {reset}; record {reset + 1} carrier revolutions or more."
        )
    from_zero = (earliest + np.arange(sequences * reset))[:, None] * per_rev + steps
    angle = (from_zero + at_pass * per_tooth) % angles
    index = (np.repeat(np.arange(sequences), reset)[:, None] * angles + angle).ravel()
    weighted = (weight * values[from_zero + nearest]).ravel()
    shape = (sequences, angles)
    weights = np.bincount(angle[:reset].ravel(), weights=np.tile(weight, reset), minlength=angles)
    if np.any(weights <= 1e-9 * weights.max()):  # rounding at the ends of a window
        raise ValueError(
            f"a window of {window.width_teeth:g} teeth does not cover the whole {gear.name}: only every "
            f"{gear.teeth // reset}th of its teeth is ever in mesh at the sensor; widen the window beyond that."
        )
    sums = np.bincount(index, weights=weighted, minlength=sequences * angles).reshape(shape)
    return _delayed(sums / weights, nearest - middle), np.asarray(weights * sequences, dtype=np.float64)


def _samples_per_tooth(signal: AngularSignal, gear: _Gear, window: PassWindow) -> int:
    """Return the samples per ring tooth, or raise where they are not whole or the window is wider than the ring."""
    per_rev, ring = signal.samples_per_rev, gear.ring
    if per_rev % ring:
        raise ValueError(
            f"{per_rev} samples per carrier revolution are not a multiple of {ring} ring teeth; resample with, say, "
            f"samples_per_rev={ring * math.ceil(per_rev / ring)}."
        )
    if window.width_teeth > ring:
        raise ValueError(
            f"width_teeth={window.width_teeth:g} is wider than the ring of {ring} teeth; narrow the window."
        )
    return per_rev // ring


def _delayed(turns: Array, delay: float) -> Array:
    """Delay periodic rows by a fraction of a sample, by a phase shift of their Fourier transform."""
    if delay == 0:
        return turns
    lines = fft.rfft(turns, axis=1)
    lines *= np.exp(-2j * np.pi * delay / turns.shape[1] * np.arange(lines.shape[1]))
    return np.asarray(fft.irfft(lines, turns.shape[1], axis=1), dtype=np.float64)


def _average(
    signal: AngularSignal, gear: _Gear, by_planet: list[tuple[Array, Array]], window: PassWindow
) -> WindowedAverage:
    """Return the average over the planets, then over the sequences that all of them have."""
    count = min(len(values) for values, _ in by_planet)
    rows = np.mean([values[:count] for values, _ in by_planet], axis=0)
    weights = np.sum([weights * (count / len(values)) for values, weights in by_planet], axis=0)
    ratio = Fraction(gear.ring, gear.teeth)
    spread = rows.std(axis=0, ddof=1) if count > 1 else np.full(rows.shape[1], np.nan)
    return WindowedAverage(
        values=rows.mean(axis=0),
        standard_error=spread / math.sqrt(count),
        revolutions=count,
        ratio=ratio,
        start_rev=signal.start_rev,
        passband_orders=signal.passband_orders / float(ratio),
        weights=weights,
        teeth=gear.teeth,
        passes=count * gear.reset * len(by_planet),
        window=window,
    )
