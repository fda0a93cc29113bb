"""Tachometer pulses and their errors."""

from dataclasses import dataclass, field

import numpy as np

from data_synth.operation.drive import ReferenceAngle
from data_synth.operation.shaft_angle import Array
from data_synth.scene.imperfections import TachometerPickUp
from data_synth.scene.operation import Tachometer


@dataclass(frozen=True, kw_only=True)
class Pulses:
    """Pulses as recorded, and the true passages of the marks.

    Attributes
    ----------
    times_s : (m,) array
        Recorded pulse times in s, rising.
    marks_s : (k,) array
        True times in s at which the marks pass.
    missed : (i,) array
        Indices of the marks without a pulse.
    spurious_s : (j,) array
        Recorded times in s of pulses without a mark.
    """

    times_s: Array = field(metadata={"dims": ("pulse",), "units": "s"})
    marks_s: Array = field(metadata={"dims": ("mark",), "units": "s"})
    missed: Array = field(metadata={"dims": ("miss",), "units": "1"})
    spurious_s: Array = field(metadata={"dims": ("spur",), "units": "s"})


def pulse_times(
    angle: ReferenceAngle,
    *,
    turns_per_rev: float,
    pulses_per_rev: int,
    stop_s: float,
    spacing_error_rev: Array | None = None,
) -> Array:
    """Return the times at which the marks of a tachometer pass, from revolution zero of `angle` to `stop_s`.

    Parameters
    ----------
    angle : ShaftAngle or PolynomialAngle
        Angle of the reference shaft, with revolution zero at the first mark.
    turns_per_rev : float
        Revolutions of the tachometer link per revolution of the reference shaft.
    pulses_per_rev : int
        Marks per revolution of that link.
    stop_s : float
        Time of the last sample in s.
    spacing_error_rev : (pulses_per_rev,) array or None
        Angle by which each mark is behind its even position, in revolutions of the link; the first is 0.

    Returns
    -------
    (m,) array
        Exact times in s.
    """
    last_turn = float(angle.revolutions(stop_s)) * turns_per_rev
    numbers = np.arange(np.floor(last_turn * pulses_per_rev) + 2)
    places = numbers / pulses_per_rev
    if spacing_error_rev is not None:
        places += spacing_error_rev[numbers.astype(np.int64) % pulses_per_rev]
    return angle.times(places[places <= last_turn] / turns_per_rev)


def recorded_pulses(
    angle: ReferenceAngle, tachometer: Tachometer, *, turns_per_rev: float, stop_s: float, rng: np.random.Generator
) -> Pulses:
    """Return the pulses of a tachometer with its declared errors, in the order of its fields."""
    marks = pulse_times(
        angle,
        turns_per_rev=turns_per_rev,
        pulses_per_rev=tachometer.pulses_per_rev,
        stop_s=stop_s,
        spacing_error_rev=_spacing_errors_rev(tachometer, rng),
    )
    seen = np.ones(marks.size, dtype=np.bool_)
    if tachometer.missing is not None:
        seen = rng.random(marks.size) >= tachometer.missing.share
        seen[:1] = True
    extra = np.empty(0)
    if tachometer.spurious is not None and marks.size:
        span_s = stop_s - marks[0]
        extra = marks[0] + span_s * rng.random(rng.poisson(tachometer.spurious.per_second * span_s))
    errors = np.zeros(marks.size + extra.size)
    if tachometer.jitter is not None:
        errors = tachometer.jitter.std_s * rng.standard_normal(errors.size)
    late_s, gains = tachometer.delay_s, 1 + 1e-6 * tachometer.clock_ppm
    extra = late_s + gains * np.sort(extra + errors[marks.size :])
    times = np.unique(np.concatenate([late_s + gains * (marks + errors[: marks.size])[seen], extra]))
    return Pulses(times_s=times, marks_s=marks, missed=np.flatnonzero(~seen).astype(np.float64), spurious_s=extra)


def with_pick_up(
    pulses: Pulses, pick_up: TachometerPickUp, *, mains_hz: float, stop_s: float, rng: np.random.Generator
) -> Pulses:
    """Return pulses with mains pick-up: sinusoidally modulated times, and false pulses at some mains crests.

    A mains sine added to an edge of constant slope shifts its time by a sine.
    """
    turn = rng.random()
    first_s = pulses.marks_s[0] if pulses.marks_s.size else stop_s
    crests_s = (np.arange(np.ceil(first_s * mains_hz - turn), np.floor(stop_s * mains_hz - turn) + 1) + turn) / mains_hz
    extra_s = crests_s[rng.random(crests_s.size) < pick_up.extra_share]
    swing_s = pick_up.jitter_s * np.cos(2 * np.pi * (mains_hz * pulses.times_s - turn))
    spurious_s = np.intersect1d(pulses.times_s, pulses.spurious_s, return_indices=True)[1]
    moved_s = pulses.times_s + swing_s
    return Pulses(
        times_s=np.unique(np.concatenate([moved_s, extra_s])),
        marks_s=pulses.marks_s,
        missed=pulses.missed,
        spurious_s=np.sort(np.concatenate([moved_s[spurious_s], extra_s])),
    )


def _spacing_errors_rev(tachometer: Tachometer, rng: np.random.Generator) -> Array | None:
    """Return the displacement of each mark in revolutions of the link; None if marks are evenly spaced."""
    if tachometer.uneven is None:
        return None
    off_deg = (
        np.array(tachometer.uneven.deg)
        if tachometer.uneven.deg is not None
        else (tachometer.uneven.std_deg or 0.0) * rng.standard_normal(tachometer.pulses_per_rev)
    )
    return np.asarray((off_deg - off_deg[0]) / 360)
