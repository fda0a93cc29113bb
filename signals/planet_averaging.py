"""Averages of one planet or of the sun from a sensor on the ring, teeth in their order.

A planet is heard well only while it passes the sensor. Which of its teeth then meshes with the ring follows from the
numbers of teeth: between two passes Z_ring teeth went by, so pass n shows tooth ``n Z_ring mod Z_planet``. A window
about each pass keeps a few teeth, which are added where they belong on the planet; after
``Z_planet / gcd(Z_ring, Z_planet)`` passes the sequence begins anew. Sources: McFadden & Howard 1990 (Aeronautical
Research Laboratory, Propulsion Report 183); McFadden 1991 ("A technique for calculating the time domain averages of
the vibration of the individual planet gears and the sun gear in an epicyclic gearbox", J. Sound Vib. 144(1),
163-172); McFadden 1994 (the same with windows, J. Vib. Acoust. 116(2), 179-187).

The ring stands still, and angles are those of the carrier. Other planets are kept out only as far as the path from
ring to sensor does it: what passes through the window from them stays in the average.
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

_UNHEARD = 1e-9  # of the largest weight: rounding at the foot of a window


@dataclass(frozen=True, kw_only=True)
class WindowedAverage(SynchronousAverage):
    """One revolution of a planet or of the sun, relative to the carrier, gathered pass by pass.

    ``revolutions`` counts how many times the whole sequence of teeth was gone through, ``passes`` how many passes
    that took, ``weights`` the window weight each angle received; the standard error is from the scatter between
    sequences. Tooth 0 is centred on angle zero.
    """

    weights: Array = field(metadata={"dims": ("angle",), "units": "1"})
    teeth: int
    passes: int
    window: PassWindow

    @property
    def by_tooth(self) -> Array:
        """The average tooth by tooth, (teeth, samples a tooth); tooth k from half a tooth before its middle on."""
        per_tooth = self.values.size // self.teeth
        return np.roll(self.values, per_tooth // 2).reshape(self.teeth, per_tooth)


def planet_average(
    signal: AngularSignal, *, teeth: PlanetaryTeeth, planet: int, first_pass_rev: float, window: PassWindow
) -> WindowedAverage:
    """Average one planet over its revolution relative to the carrier (McFadden 1991, 1994).

    Parameters
    ----------
    signal : AngularSignal
        A sensor on the ring or housing, over the carrier's angle; a whole number of samples to a ring tooth.
    teeth : PlanetaryTeeth
    planet : int
        Which, from 0.
    first_pass_rev : float
        A carrier angle, in revolutions, at which planet 0 passes the sensor; `pass_angle` finds one.
    window : PassWindow
        At least as wide as the greatest common divisor of ring and planet teeth, or some teeth are never heard.

    Returns
    -------
    WindowedAverage
        Tooth 0 is the one at the sensor at the pass of ``first_pass_rev - positions_rev[planet]``.

    Raises
    ------
    ValueError
        A record shorter than one whole sequence of teeth, a grid that does not fit the teeth, or a window so
        narrow that teeth are missing.
    """
    which = whole(planet, name="planet", least=0, most=teeth.planets - 1)
    first = number(first_pass_rev, name="first_pass_rev") - float(teeth.positions_rev[which])
    gear = _Gear(name="planet", teeth=teeth.planet, ring=teeth.ring)
    return _average(signal, gear, [_gather(signal, gear, pass_rev=first, at_pass=0, window=window)], window)


def sun_average(
    signal: AngularSignal, *, teeth: PlanetaryTeeth, first_pass_rev: float, window: PassWindow
) -> WindowedAverage:
    """Average the sun over its revolution relative to the carrier, heard through every planet in turn.

    Planet by planet as in `planet_average`; a planet at place p meshes with the sun ``(ring + sun) p`` teeth behind
    planet 0, so the averages of the planets are turned onto each other before they are averaged (McFadden 1991).

    Parameters
    ----------
    signal, teeth, first_pass_rev, window
        As in `planet_average`, the sun taking the planet's place.

    Returns
    -------
    WindowedAverage
        Tooth 0 is the one in mesh with planet 0 at `first_pass_rev`.
    """
    first = number(first_pass_rev, name="first_pass_rev")
    gear = _Gear(name="sun", teeth=teeth.sun, ring=teeth.ring)
    heard = [
        _gather(
            signal,
            gear,
            pass_rev=first - float(place),
            at_pass=-int(place * (teeth.ring + teeth.sun)),
            window=window,
        )
        for place in teeth.positions_rev
    ]
    return _average(signal, gear, heard, window)


@dataclass(frozen=True, kw_only=True)
class _Gear:
    name: str
    teeth: int
    ring: int

    @property
    def reset(self) -> int:
        return self.teeth // math.gcd(self.ring, self.teeth)


@dataclass(frozen=True, kw_only=True)
class _Turns:
    """A gear's revolution as each sequence shows it, (sequences, angles), and the weights over all of them."""

    values: Array
    weights: Array


def _gather(signal: AngularSignal, gear: _Gear, *, pass_rev: float, at_pass: int, window: PassWindow) -> _Turns:
    """Return the gear's revolution as each whole sequence of passes shows it.

    `at_pass` is the tooth at the sensor at the carrier angle `pass_rev`.
    """
    values = real_vector(signal.values, name="the angular signal")
    per_tooth = _samples_per_tooth(signal, gear, window)
    per_rev, reset, angles = signal.samples_per_rev, gear.reset, gear.teeth * per_tooth
    middle = (pass_rev - signal.start_rev) * per_rev  # in samples
    nearest = round(middle)
    reach = math.ceil(window.width_teeth / 2 * per_tooth) + 1
    steps = np.arange(-reach, reach + 1)
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
    place = (np.repeat(np.arange(sequences), reset)[:, None] * angles + angle).ravel()
    heard = (weight * values[from_zero + nearest]).ravel()
    shape = (sequences, angles)
    weights = np.bincount(angle[:reset].ravel(), weights=np.tile(weight, reset), minlength=angles)
    if np.any(weights <= _UNHEARD * weights.max()):
        raise ValueError(
            f"a window of {window.width_teeth:g} teeth leaves parts of the {gear.name} unheard: only every "
            f"{gear.teeth // reset}th of its teeth is ever met right at the sensor; widen the window beyond that."
        )
    sums = np.bincount(place, weights=heard, minlength=sequences * angles).reshape(shape)
    return _Turns(
        values=_turned(sums / weights, nearest - middle), weights=np.asarray(weights * sequences, dtype=np.float64)
    )


def _samples_per_tooth(signal: AngularSignal, gear: _Gear, window: PassWindow) -> int:
    per_rev, ring = signal.samples_per_rev, gear.ring
    if per_rev % ring:
        raise ValueError(
            f"{per_rev} samples a carrier revolution are not a whole number to each of {ring} ring teeth; resample "
            f"at a multiple of {ring}, as samples_per_rev={ring * math.ceil(per_rev / ring)}."
        )
    if window.width_teeth > ring:
        raise ValueError(f"a window of {window.width_teeth:g} teeth overlaps itself on {ring} ring teeth; narrow it.")
    return per_rev // ring


def _turned(turns: Array, late: float) -> Array:
    """Turn periodic rows that were sampled a part of a sample late, exactly below half the sampling rate."""
    if late == 0:
        return turns
    lines = fft.rfft(turns, axis=1)
    lines *= np.exp(-2j * np.pi * late / turns.shape[1] * np.arange(lines.shape[1]))
    return np.asarray(fft.irfft(lines, turns.shape[1], axis=1), dtype=np.float64)


def _average(signal: AngularSignal, gear: _Gear, heard: list[_Turns], window: PassWindow) -> WindowedAverage:
    """Average over the planets a gear was heard through, then over the sequences that all of them have."""
    count = min(turns.values.shape[0] for turns in heard)
    rows = np.mean([turns.values[:count] for turns in heard], axis=0)
    weights = np.sum([turns.weights * (count / turns.values.shape[0]) for turns in heard], axis=0)
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
        passes=count * gear.reset * len(heard),
        window=window,
    )
