"""Phase error of ways through tachometer pulses, and their time: python benchmarks/tachometer.py [FOLDER].

Writes tachometer.md into FOLDER (default docs/benchmarks). The shaft of the resampling job: 50 (1 + 0.1 sin(pi t)) Hz,
a pulse each turn, a record of a million samples at 51.2 kHz. Errors: in rad over the middle 90 % of 200,001 instants,
times the order. Time as a multiple of `np.interp` at the same instants, medians of five, in one run; building the
curve included.
"""

import statistics
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from page_files import folder_given, table, write_page
from scipy.interpolate import CubicSpline, PchipInterpolator, make_interp_spline
from tracking import clock

from signals.shaft.tachometer import shaft_phase

Array = NDArray[np.float64]
Method = Callable[[Array, Array], Array]

ORDERS = (1, 400)
STOP_S = 1_000_000 / 51_200
INSTANTS = 200_001
JITTER_S = 1e-6
FAULTS = 0.05
REPEATS = 5
LONG = 60_000  # pulses of a long record

NOTE = """\
Made by `python benchmarks/tachometer.py`. A shaft at 50 (1 + 0.1 sin(pi t)) Hz, one pulse per revolution, 19.5 s.
Errors of the shaft angle times the order, in rad, over the middle 90 %; time as a multiple of `np.interp` in the same
run, including construction of the interpolant. Jitter has a standard deviation of 1 us; with faults, 5 % of the pulses
are missing and 5 % spurious, seed 1. Methods that count every pulse are then several revolutions off.

For {pulses:,} pulses with jitter and no faults, computing the phase takes {sound:.2g} times as long as `np.interp` at a
million instants; with two missing pulses and a spurious one, {faulty:.2g} times as long as without."""


def revolutions(times_s: Array) -> Array:
    """Return the angle in closed form."""
    t = times_s.astype(np.longdouble)
    pi = np.arccos(np.longdouble(-1))
    return np.asarray(50 * t + 5 * (1 - np.cos(pi * t)) / pi)


def pulses() -> Array:
    """Return when the shaft passes whole turns, by Newton's method in extended precision."""
    pi = np.arccos(np.longdouble(-1))
    wanted = np.arange(1000, dtype=np.longdouble)
    t = wanted / 50
    for _ in range(6):
        t = t - (50 * t + 5 * (1 - np.cos(pi * t)) / pi - wanted) / (50 + 5 * np.sin(pi * t))
    return t[t < STOP_S].astype(np.float64)


def spoilt(times: Array, rng: np.random.Generator) -> Array:
    """Return the pulses with some missing and some spurious, none within six of the ends."""
    inner = np.arange(6, times.size - 6)
    count = round(FAULTS * times.size)
    lost, cells = rng.choice(inner, count, replace=False), rng.choice(inner, count, replace=False)
    extra = times[cells] + rng.uniform(0.02, 0.98, count) * (times[cells + 1] - times[cells])
    return np.sort(np.concatenate([np.delete(times, lost), extra]))


def of_knots(build: Callable[[Array, Array], Callable[[Array], Array]]) -> Method:
    """Return a method that takes every pulse for a turn."""
    return lambda times, at: build(times, np.arange(times.size, dtype=np.float64))(at)


METHODS: dict[str, Method] = {
    "linear": lambda times, at: np.interp(at, times, np.arange(times.size)),
    "PCHIP": of_knots(PchipInterpolator),
    "cubic spline": of_knots(CubicSpline),
    "quintic spline": of_knots(lambda t, r: make_interp_spline(t, r, k=5)),
    "ours": lambda times, at: shaft_phase(times).revolutions_at(at),
}


def measure() -> list[tuple[str, str, float, float, float]]:
    """Return (pulses, method, RMS and largest error in rad, seconds)."""
    clean = pulses()
    rng = np.random.default_rng(1)
    jittered = clean + JITTER_S * rng.standard_normal(clean.size)
    lists = {"clean": clean, "jitter": jittered, "jitter, faults": spoilt(jittered, rng)}
    at = np.linspace(clean[5], clean[-6], INSTANTS)
    exact = revolutions(at)
    middle = slice(INSTANTS // 20, -(INSTANTS // 20))
    rows = []
    for kind, times in lists.items():
        for name, method in METHODS.items():
            seconds = median_seconds(lambda method=method, times=times: method(times, at))
            error = (2 * np.pi * (method(times, at) - exact)).astype(np.float64)[middle]
            rms = float(np.sqrt(np.mean(error**2)))
            rows.append((kind, name, rms, float(np.max(np.abs(error))), seconds))
    return rows


def median_seconds(run: Callable[[], object]) -> float:
    """Time `run` after it has been compiled."""
    run()
    return statistics.median(clock.seconds(run) for _ in range(REPEATS))


def repair_times() -> tuple[float, float]:
    """Return the time of a long list over that of `np.interp`, and with three faults over that without."""
    sound = np.arange(LONG) / 50 + 1e-3 * np.sin(np.arange(LONG) / 300)
    sound += JITTER_S * np.random.default_rng(1).standard_normal(LONG)
    extra = sound[LONG * 3 // 4 : LONG * 3 // 4 + 2] @ [0.6, 0.4]
    faulty = np.sort(np.append(np.delete(sound, [LONG // 60, LONG // 2]), extra))
    instants, numbers = np.linspace(sound[0], sound[-1], 1_000_000), np.arange(LONG, dtype=np.float64)
    unit = median_seconds(lambda: np.interp(instants, sound, numbers))
    clean = median_seconds(lambda: shaft_phase(sound))
    return clean / unit, median_seconds(lambda: shaft_phase(faulty)) / clean


def main(folder: Path) -> None:
    """Measure, and write the table."""
    rows = measure()
    unit = next(seconds for kind, name, _, _, seconds in rows if (kind, name) == ("clean", "linear"))
    head = [name for order in ORDERS for name in (f"RMS, order {order}", f"largest, order {order}")]
    sound, faulty = repair_times()
    note = NOTE.format(pulses=LONG, sound=sound, faulty=faulty)
    cells = (
        (kind, name, *(f"{order * each:.1e}" for order in ORDERS for each in (rms, largest)), f"{seconds / unit:.2g}")
        for kind, name, rms, largest, seconds in rows
    )
    lines = ["# Tachometer: from pulses to angle", "", note, "", *table(("pulses", "method", *head, "time"), cells)]
    write_page(folder / "tachometer.md", lines)


if __name__ == "__main__":
    main(folder_given())
