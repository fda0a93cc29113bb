"""Windowed synchronous averages of one planet or of the sun from a sensor on the ring.

The vibration of a planet reaches the sensor mainly while the planet passes it. The tooth in mesh follows from the
numbers of teeth: at pass n it is tooth ``n Z_ring mod Z_planet``. A window about each pass keeps a few teeth, which
are added at their angle on the planet; after ``Z_planet / gcd(Z_ring, Z_planet)`` passes the sequence repeats.
Sources: McFadden & Howard 1990 (Aeronautical Research Laboratory, Propulsion Report 183); McFadden 1991 ("A technique
for calculating the time domain averages of the vibration of the individual planet gears and the sun gear in an
epicyclic gearbox", J. Sound Vib. 144(1), 163-172); McFadden 1994 (the same with windows, J. Vib. Acoust. 116(2),
179-187).

The ring is fixed, and angles are those of the carrier. Other planets are attenuated only by their transfer path: what
they contribute within the window remains in the average.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._checks import Array, number, real_vector, whole
from signals.averaging import SynchronousAverage

if TYPE_CHECKING:
    from signals.planet_passes import PassWindow, PlanetaryTeeth
    from signals.resampling import AngularSignal

_LEAST_WEIGHT = 1e-9  # of the largest: less is rounding at the ends of a window


@dataclass(frozen=True, kw_only=True)
class WindowedAverage(SynchronousAverage):
    """One revolution of a planet or of the sun, relative to the carrier, averaged over planet passes.

    Attributes
    ----------
    values, standard_error, ratio, start_rev, passband_orders
        As in `SynchronousAverage`; the standard error is from the scatter between tooth sequences. Tooth 0 is centred
        on angle zero.
    revolutions : int
        Number of whole tooth sequences averaged.
    weights : (angle,) array
        Sum of the window weights at each angle.
    teeth : int
        Teeth of the gear.
    passes : int
        Number of planet passes averaged.
    window : PassWindow
        The window.

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
        """The average by tooth, (teeth, samples per tooth); each tooth begins half a tooth before its middle."""
        per_tooth = self.values.size // self.teeth
        return np.roll(self.values, per_tooth // 2).reshape(self.teeth, per_tooth)


def planet_average(
    signal: AngularSignal, *, teeth: PlanetaryTeeth, planet: int, first_pass_rev: float, window: PassWindow
) -> WindowedAverage:
    """Average one planet over its revolution relative to the carrier (McFadden 1991, 1994).

    Parameters
    ----------
    signal : AngularSignal
        A sensor on the ring or housing, over the angle of the carrier; a whole number of samples per ring tooth.
    teeth : PlanetaryTeeth
        Teeth of the stage.
    planet : int
        Index of the planet, from 0.
    first_pass_rev : float
        A carrier angle, in revolutions, at which planet 0 passes the sensor; `pass_angle` estimates one.
    window : PassWindow
        At least as wide, in teeth, as the greatest common divisor of ring and planet teeth, to cover all teeth.

    Returns
    -------
    WindowedAverage
        Tooth 0 is the one at the sensor at the pass of ``first_pass_rev - positions_rev[planet]``.

    Raises
    ------
    ValueError
        A record shorter than one whole sequence of teeth, a grid that does not fit the teeth, or a window so
        narrow that teeth are missing.

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


def sun_average(
    signal: AngularSignal, *, teeth: PlanetaryTeeth, first_pass_rev: float, window: PassWindow
) -> WindowedAverage:
    """Average the sun over its revolution relative to the carrier, from the passes of all planets.

    A planet at position p meshes with the sun ``(ring + sun) p`` teeth behind planet 0; the averages over the passes of
    each planet are shifted by this and averaged (McFadden 1991).

    Parameters
    ----------
    signal, teeth, first_pass_rev, window
        As in `planet_average`, with the teeth of the sun instead of the planet.

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
    """The averaged gear: its name, its teeth and those of the ring."""

    name: str
    teeth: int
    ring: int

    @property
    def reset(self) -> int:
        """Passes in a tooth sequence."""
        return self.teeth // math.gcd(self.ring, self.teeth)


@dataclass(frozen=True, kw_only=True)
class _Turns:
    """A gear's revolution from each tooth sequence, (sequences, angles), and the sums of weights, (angles,)."""

    values: Array
    weights: Array


def _gather(signal: AngularSignal, gear: _Gear, *, pass_rev: float, at_pass: int, window: PassWindow) -> _Turns:
    """Return the gear's revolution from each whole tooth sequence.

    `at_pass` is the tooth at the sensor at the carrier angle `pass_rev`.
    """
    values = real_vector(signal.values, name="the angular signal")
    per_tooth = _samples_per_tooth(signal, gear, window)
    per_rev, reset, angles = signal.samples_per_rev, gear.reset, gear.teeth * per_tooth
    middle = (pass_rev - signal.start_rev) * per_rev  # in samples
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
            f"{passes} passes of a planet lie whole in the record, but each {gear.name} tooth comes to the sensor only "
            f"once in {reset}; record {reset + 1} carrier revolutions or more."
        )
    from_zero = (earliest + np.arange(sequences * reset))[:, None] * per_rev + steps
    angle = (from_zero + at_pass * per_tooth) % angles
    index = (np.repeat(np.arange(sequences), reset)[:, None] * angles + angle).ravel()
    weighted = (weight * values[from_zero + nearest]).ravel()
    shape = (sequences, angles)
    weights = np.bincount(angle[:reset].ravel(), weights=np.tile(weight, reset), minlength=angles)
    if np.any(weights <= _LEAST_WEIGHT * weights.max()):
        raise ValueError(
            f"a window of {window.width_teeth:g} teeth does not cover the whole {gear.name}: only every "
            f"{gear.teeth // reset}th of its teeth is ever in mesh at the sensor; widen the window beyond that."
        )
    sums = np.bincount(index, weights=weighted, minlength=sequences * angles).reshape(shape)
    return _Turns(
        values=_delayed(sums / weights, nearest - middle), weights=np.asarray(weights * sequences, dtype=np.float64)
    )


def _samples_per_tooth(signal: AngularSignal, gear: _Gear, window: PassWindow) -> int:
    """Return the samples per ring tooth, or raise where they are not whole or the window is wider than the ring."""
    per_rev, ring = signal.samples_per_rev, gear.ring
    if per_rev % ring:
        raise ValueError(
            f"{per_rev} samples a carrier revolution are not a whole number to each of {ring} ring teeth; resample "
            f"at a multiple of {ring}, as samples_per_rev={ring * math.ceil(per_rev / ring)}."
        )
    if window.width_teeth > ring:
        raise ValueError(f"a window of {window.width_teeth:g} teeth overlaps itself on {ring} ring teeth; narrow it.")
    return per_rev // ring


def _delayed(turns: Array, delay: float) -> Array:
    """Delay periodic rows by a fraction of a sample, by a phase shift of their Fourier transform."""
    if delay == 0:
        return turns
    lines = fft.rfft(turns, axis=1)
    lines *= np.exp(-2j * np.pi * delay / turns.shape[1] * np.arange(lines.shape[1]))
    return np.asarray(fft.irfft(lines, turns.shape[1], axis=1), dtype=np.float64)


def _average(signal: AngularSignal, gear: _Gear, by_planet: list[_Turns], window: PassWindow) -> WindowedAverage:
    """Average over the planets, then over the sequences that all of them have."""
    count = min(turns.values.shape[0] for turns in by_planet)
    rows = np.mean([turns.values[:count] for turns in by_planet], axis=0)
    weights = np.sum([turns.weights * (count / turns.values.shape[0]) for turns in by_planet], axis=0)
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
