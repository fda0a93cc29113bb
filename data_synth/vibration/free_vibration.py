"""Free vibration: what natural modes ring with after a jump of torque or speed, a start, or a fast pass of a resonance.

It has the frequencies of the modes at any speed, so it is no line at an order. What the lines leave of the signal is
fitted with amplitudes against time at the natural frequencies, in windows of time as others are in windows of angle
(`data_synth.vibration.order_projection`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from data_synth.dynamics.modes import campbell
from data_synth.dynamics.system import System
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.vibration.order_projection import AngleSamples, Projection, Window, sum_of_lines
from data_synth.vibration.projected_lines import DEGREE, RIDGE

_RUNG_OUT = 1e-3  # of its amplitude, to which a mode has decayed after the time that it rings
_OVERDAMPED = 0.7  # ratio of damping from which nothing rings
_LONGEST = 16.0  # periods of the lowest mode
_WIDTH, _SHARE = 4.0, 1 / 3
"""A mode takes a band as wide as 4 over the window (measured), and all together a third of it at most: of white noise
they take as much, which is less than what they must take to be stated."""
_AT_LEAST = 0.5  # of the power that lines leave, which modes must take to be stated
_INSTANTS = 8  # of a window
_SHORTEST = 4.0  # periods of the lowest mode: of changes nearer to each other the first counts
_NEXT = 2.5  # samples: nearer spans have no zero between them


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Natural modes that may ring.

    Attributes
    ----------
    frequencies_hz : (mode,) array
        Damped natural frequencies, rising.
    longest_s : float
        Time after which the least damped one has decayed to a thousandth; infinite without damping.
    """

    frequencies_hz: Array
    longest_s: float

    @classmethod
    def of(cls, system: System) -> "Modes":
        """Return the modes of a system with its meshes at their mean stiffness."""
        at_rest = campbell(lambda _: system, speeds_rad_s=[0.0])
        frequencies, ratios = at_rest.frequencies_hz[0], at_rest.damping_ratios[0]
        rings = (frequencies > 0) & (ratios < _OVERDAMPED)
        frequencies, ratios = frequencies[rings], ratios[rings]
        slowest = float(np.min(2 * np.pi * frequencies * ratios / np.sqrt(1 - ratios**2), initial=np.inf))
        longest_s = -math.log(_RUNG_OUT) / slowest if slowest > 0 else math.inf
        return cls(frequencies_hz=frequencies, longest_s=longest_s)


@dataclass(frozen=True, kw_only=True)
class FreeVibration:
    """Amplitudes of ringing modes: ``x = Re{Z exp(2 pi j f t)}``, linear between instants.

    Attributes
    ----------
    frequencies_hz : (mode,) array
    times_s : (i,) array
        Rising; Z is zero where nothing rings.
    amplitude : (channel, mode, i) complex array
    left : float
        Sum of squares that it leaves of what lines leave.
    """

    frequencies_hz: Array
    times_s: Array
    amplitude: ComplexArray
    left: float


@dataclass(frozen=True, kw_only=True)
class Span:
    """What lines leave of a signal in a part of it, (channel, n), from sample `first` on."""

    first: int
    left: Array


def ringing_spans(
    changes_s: Array, modes: Modes, *, samples: int, rate_hz: float, everywhere: bool
) -> list[tuple[int, int]]:
    """Return first samples and ends of the parts of a signal in which modes may ring.

    Parameters
    ----------
    changes_s : (i,) array
        Rising times at which speed or torque, or its rate, jumps.
    modes : Modes
    samples : int
    rate_hz : float
    everywhere : bool
        Whether all parts count, not only as long as modes ring after each change.
    """
    if not modes.frequencies_hz.size:
        return []
    firsts, least = list[int](), _SHORTEST / float(modes.frequencies_hz[0]) * rate_hz
    changes = np.ceil(changes_s * rate_hz - 1e-6).astype(int).tolist()
    for each in ([0] if everywhere else []) + changes:
        if not firsts or each - firsts[-1] >= least:
            firsts.append(each)
    rung = samples if everywhere else math.ceil(min(modes.longest_s * rate_hz, samples))
    spans = [(begin, min(begin + rung, end)) for begin, end in pairwise([*firsts, samples])]
    return [(begin, end) for begin, end in spans if end - begin >= least]


def free_vibration(spans: Sequence[Span], modes: Modes, *, rate_hz: float, top_hz: float) -> FreeVibration | None:
    """Return the free vibration in parts of a signal, or None where modes take less than half of what lines leave.

    The window is that, of several, which leaves least: shorter ones follow onsets and decays, longer ones separate
    modes. Modes nearer than a window separates count as one, and those slower than one period of it not at all.

    Parameters
    ----------
    spans : sequence of Span
        By rising time; modes begin to ring at their first samples or later.
    modes : Modes
    rate_hz, top_hz : float
        Sampling rate, and highest frequency of a mode.
    """
    least = _AT_LEAST * sum(float(np.sum(span.left**2)) for span in spans)
    frequencies = modes.frequencies_hz[modes.frequencies_hz < top_hz]
    if not frequencies.size or not least:
        return None
    best, length_s = None, min(span.left.shape[1] for span in spans) / rate_hz
    length_s = min(length_s, _LONGEST / float(frequencies[0]))
    while (apart := _apart(frequencies, 1 / length_s)).size * _WIDTH / length_s < _SHARE * rate_hz / 2 and apart.size:
        window = Window(length_rev=length_s, degree=DEGREE, ridge=RIDGE)
        fits = [_fitted(span, apart, window, rate_hz=rate_hz) for span in spans]
        left = sum(power for _, _, power in fits)
        if left < least:
            least, best = left, (apart, fits)
        length_s /= 2
    return None if best is None else _joined(*best, rate_hz=rate_hz)


def _apart(frequencies: Array, least: float) -> Array:
    """Return rising frequencies at least so far from each other and from zero: the lowest of near ones."""
    kept = [0.0]
    for each in frequencies.tolist():
        if each - kept[-1] >= least:
            kept.append(each)
    return np.array(kept[1:])


def _fitted(span: Span, frequencies: Array, window: Window, *, rate_hz: float) -> tuple[Array, ComplexArray, float]:
    """Return instants, Z (channel, mode, instant), and the sum of squares that is left."""
    count, start_s = span.left.shape[1], span.first / rate_hz
    samples = AngleSamples(
        signal=span.left,
        rate_hz=rate_hz,
        revolutions=lambda times_s: times_s + start_s,  # a turn a second
        speed_hz=np.ones_like,
        top_order=rate_hz / 2,
    )
    times_s = np.arange(count) / rate_hz
    instants_s = np.linspace(0.0, times_s[-1], math.ceil(_INSTANTS * times_s[-1] / window.length_rev) + 1)
    found = Projection(samples=samples, orders=frequencies, window=window).amplitudes(instants_s + start_s)
    rings = sum_of_lines(frequencies, found, instants_s=instants_s, revolutions=samples.revolutions, times_s=times_s)
    return instants_s + start_s, found, float(np.sum((span.left - rings) ** 2))


def _joined(frequencies: Array, fits: list[tuple[Array, ComplexArray, float]], *, rate_hz: float) -> FreeVibration:
    """Return all spans as one: zero from a sample before each to a sample behind it, where no other is."""
    instants, amplitudes, before = list[Array](), list[ComplexArray](), -np.inf
    for number, (instants_s, found, _) in enumerate(fits):
        after = fits[number + 1][0][0] if number + 1 < len(fits) else np.inf
        pads = int(instants_s[0] - before > _NEXT / rate_hz), int(after - instants_s[-1] > _NEXT / rate_hz)
        ends = instants_s[0] - 1 / rate_hz, instants_s[-1] + 1 / rate_hz
        instants.append(np.concatenate([ends[: pads[0]], instants_s, ends[1 : 1 + pads[1]]]))
        amplitudes.append(np.pad(found, [(0, 0), (0, 0), pads]))
        before = instants_s[-1]
    return FreeVibration(
        frequencies_hz=frequencies,
        times_s=np.concatenate(instants),
        amplitude=np.concatenate(amplitudes, axis=2),
        left=sum(power for _, _, power in fits),
    )
