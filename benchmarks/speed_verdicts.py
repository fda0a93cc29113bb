"""Verdicts on speed without a tachometer: python benchmarks/speed_verdicts.py [--records N] [--first N] [FOLDER].

Writes speed_verdicts.md into FOLDER (default docs/benchmarks): how many records of each drive are "ok", "ambiguous" or
"not found", how many "ok" ones are wrong, and how many of those with two clear lines are "ok". The records are made
here, in a few lines, and share nothing with `data_synth` or the estimator but the orders of the drawing.
"""

import argparse
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hums import defect_orders, load_gearbox, solve_kinematics
from signals.shaft.tacholess import SpeedEstimate, estimate_speed

Floats = NDArray[np.float64]

RATE_HZ = 8192.0
SECONDS = 6.0
ACCELERATION_HZ_S = 5.0
HARMONICS = 3
WRONG = 0.005  # of the speed
CLEAR_DB = 10.0
WINDOW_REV = 32  # of the spectrum in which a line has its background

# Gearboxes and drives that the constants of the search were chosen on, and those that score.
PARTS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "tuning": (("two-stage", "oh-58"), ("constant", "ramp", "turbulence")),
    "scoring": (
        ("wind-turbine-3-stage", "planetary-27-36-99", "alouette-iii", "wijianto-pair"),
        ("slow swing", "steps", "run-up 1:2", "constant with turbulence"),
    ),
}

NOTE = """\
Made by `python benchmarks/speed_verdicts.py --records {records} --first {first}`, one thread, gearboxes
{gearboxes}.
Records of {seconds:g} s at {rate:g} Hz: meshes of the drawing with {harmonics} harmonics of random heights and
sidebands, shafts up to order three, through two random resonances, in coloured noise; mains hum in half, another
machine's family in a third. The range searched is 1:2 to 1:5 about the speed. Wrong: "ok", and the median or one in
twenty of the speeds is more than {wrong:.1%} or {rough:.1%} off. Clear: at least two of the orders searched stand
{clear:g} dB above their background in a spectrum over {window} turns."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """A record, what is searched in it, and its true speed at every sample."""

    drive: str
    samples: Floats
    orders: tuple[float, ...]
    range_hz: tuple[float, float]
    speed_hz: Floats


def _smooth_noise(rng: np.random.Generator, n: int, cutoff_hz: float) -> Floats:
    a = np.exp(-2 * np.pi * cutoff_hz / RATE_HZ)
    y = lfilter([1 - a], [1, -a], lfilter([1 - a], [1, -a], rng.standard_normal(n + n // 2)))[n // 2 :]
    return np.asarray(y / y.std())


def _steps(rng: np.random.Generator, t: Floats) -> Floats:
    levels = 1 + 0.04 * rng.uniform(-1, 1, 4)
    return np.interp(
        t, np.repeat(np.arange(1, 4), 2) * SECONDS / 4 + np.tile([-0.3, 0.3], 3), np.repeat(levels, 2)[1:-1]
    )


DRIVES: Mapping[str, Callable[[np.random.Generator, Floats], Floats]] = {
    "constant": lambda _, t: np.ones(t.size),
    "ramp": lambda rng, t: 1 + rng.uniform(-0.3, 0.3) * (t / SECONDS - 0.5),
    "turbulence": lambda rng, t: 1 + 0.01 * _smooth_noise(rng, t.size, 0.3),
    "slow swing": lambda rng, t: 1 + 0.03 * np.sin(2 * np.pi * rng.uniform(0.1, 0.3) * t + rng.uniform(0, 6)),
    "steps": _steps,
    "run-up 1:2": lambda _, t: 0.7 + 0.6 * t / SECONDS,
    "constant with turbulence": lambda rng, t: 1 + 0.002 * _smooth_noise(rng, t.size, 0.5),
}


def _mode(x: Floats, hz: float, damping: float) -> Floats:
    w, r = 2 * np.pi * hz / RATE_HZ, np.exp(-damping * 2 * np.pi * hz / RATE_HZ)
    a = np.array([1, -2 * r * np.cos(w), r * r])
    return np.asarray(lfilter([a.sum()], a, x))


@cache
def _orders(gearbox: str) -> tuple[list[float], list[float], float]:
    """Return the orders of meshes and shafts of the drawing, and a speed of its reference at which they are heard."""
    table = defect_orders(solve_kinematics(load_gearbox(gearbox)))
    meshes = sorted(set(table.loc[table.kind == "gear_mesh", "order"].astype(float)))
    shafts = sorted(set(table.loc[table.kind == "shaft", "order"].astype(float)))
    return meshes, shafts, float(np.clip(700.0 / meshes[-1], 2.0, 40.0))


def made(gearbox: str, drive: str, seed: int) -> Record:  # noqa: C901 - a list of what a record holds
    """Return a record of a gearbox under a drive."""
    rng = np.random.default_rng([seed, *map(ord, gearbox + drive)])
    meshes, shafts, middle = _orders(gearbox)
    t = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    speed = middle * rng.uniform(0.8, 1.25) * DRIVES[drive](rng, t)
    # within the acceleration searched
    turns = np.cumsum(speed) / RATE_HZ
    x = np.zeros(t.size)
    load = 1 + rng.uniform(0, 0.3) * _smooth_noise(rng, t.size, 0.5)

    def add(order: float, height: float) -> None:
        nonlocal x
        if 0 < order * speed.max() < 0.45 * RATE_HZ:
            x = x + height * np.cos(2 * np.pi * order * turns + rng.uniform(0, 2 * np.pi))

    for mesh in meshes:
        for harmonic in range(1, HARMONICS + 1):
            height = 10 ** rng.uniform(-1.2, 0) / harmonic
            add(mesh * harmonic, height)
            for shaft in shafts:
                for side in (-2, -1, 1, 2):
                    add(mesh * harmonic + side * shaft, height * rng.uniform(0.02, 0.4) / abs(side))
    for shaft in shafts:
        for harmonic in (1, 2, 3):
            add(shaft * harmonic, 10 ** rng.uniform(-2.3, -0.7) / harmonic)
    x = x * load
    x = x + sum(_mode(x, rng.uniform(300, 3000), rng.uniform(0.02, 0.1)) for _ in range(2))
    noise = rng.standard_normal(t.size)
    noise = noise + rng.uniform(0, 1) * _mode(noise, rng.uniform(500, 3000), rng.uniform(0.03, 0.1))
    x = x + noise * (x.std() / noise.std() * 10 ** (rng.uniform(-10, 15) / 20))
    if rng.random() < 0.5:  # noqa: PLR2004
        mains = rng.choice([50.0, 60.0])
        for harmonic in (1, 2, 3, 5, 7):
            hum = 10 ** rng.uniform(-1.5, -0.3) / harmonic * x.std()
            x = x + hum * np.cos(2 * np.pi * mains * harmonic * t + rng.uniform(0, 2 * np.pi))
    if rng.random() < 1 / 3:
        other = rng.uniform(5, 60)
        for harmonic in range(1, 5):
            x = x + 10 ** rng.uniform(-1.3, -0.3) * x.std() * np.cos(2 * np.pi * other * harmonic * t + harmonic)
    low = float(speed.min()) * rng.uniform(0.4, 0.9)
    high = float(speed.max()) * rng.uniform(1.1, 2.2)
    listed = {harmonic * mesh for mesh in meshes for harmonic in range(1, HARMONICS + 1)} | set(shafts)
    orders = tuple(sorted(order for order in listed if order <= RATE_HZ / 2 / low))
    return Record(drive=drive, samples=x, orders=orders, range_hz=(low, high), speed_hz=speed)


def clear_lines(record: Record) -> int:
    """Count the orders searched that stand clear of their background, by the true angle."""
    turns = np.cumsum(record.speed_hz) / RATE_HZ
    per_turn = 2 ** int(np.ceil(np.log2(RATE_HZ / record.speed_hz.min())))
    even = np.interp(np.arange(turns[0], turns[-1], 1 / per_turn), turns, record.samples)
    window = min(WINDOW_REV, int(turns[-1] / 2)) * per_turn
    rows = np.lib.stride_tricks.sliding_window_view(even, window)[:: window // 2]
    power = np.mean(np.abs(np.fft.rfft(rows * np.hanning(window), axis=1)) ** 2, axis=0)
    per_order, count = window // per_turn, 0
    for order in record.orders:
        if order * record.speed_hz.max() > RATE_HZ / 2:
            continue
        at = round(order * per_order)
        beside = np.concatenate([power[max(at - 40, 4) : max(at - 2, 4)], power[at + 3 : at + 41]])
        count += power[max(at - 1, 0) : at + 2].max() > 10 ** (CLEAR_DB / 10) * np.median(beside)
    return count


def is_wrong(found: SpeedEstimate, record: Record) -> bool:
    """Return whether an "ok" speed is not the true one."""
    true = np.interp(found.times_s, np.arange(record.speed_hz.size) / RATE_HZ, record.speed_hz)
    off = np.abs(found.speed_hz / true - 1)[np.isfinite(found.speed_hz)]
    return bool(np.median(off) > WRONG or np.quantile(off, 0.95) > 4 * WRONG)


def estimate(record: Record) -> SpeedEstimate:
    """Return the estimate, as an analysis asks for it."""
    return estimate_speed(
        record.samples,
        rate_hz=RATE_HZ,
        orders=record.orders,
        speed_range_hz=record.range_hz,
        max_acceleration_hz_s=max(ACCELERATION_HZ_S, 1.2 * float(np.abs(np.gradient(record.speed_hz)).max()) * RATE_HZ),
    )


def rows(part: str, records: int, *, first: int = 0, show: bool = False) -> Iterator[dict[str, Any]]:
    """Yield a row for each drive of a part."""
    gearboxes, drives = PARTS[part]
    for drive in drives:
        row = dict.fromkeys(("ok", "ambiguous", "not found", "wrong", "clear", "clear and ok"), 0)
        for number in range(first, first + records):
            gearbox = gearboxes[number % len(gearboxes)]
            record = made(gearbox, drive, number)
            found, clear = estimate(record), clear_lines(record) >= 2  # noqa: PLR2004
            row[found.status] += 1
            wrong = found.status == "ok" and is_wrong(found, record)
            row["wrong"] += wrong
            row["clear"] += clear
            row["clear and ok"] += clear and found.status == "ok"
            if show and (wrong or (clear and found.status != "ok")):
                print(  # noqa: T201
                    drive,
                    gearbox,
                    number,
                    found.status,
                    getattr(found, "reason", ""),
                    "WRONG" if wrong else "",
                    flush=True,
                )
        yield {"drive": drive, "records": records, **row}


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default=Path(__file__).parents[1] / "docs" / "benchmarks", type=Path)
    parser.add_argument("--records", type=int, default=40, help="records of each drive")
    parser.add_argument("--first", type=int, default=0, help="number of the first record, which seeds it")
    parser.add_argument("--part", default="scoring", choices=tuple(PARTS))
    parser.add_argument("--show", action="store_true", help="also print the records that fall short")
    given = parser.parse_args()
    found = list(rows(given.part, given.records, first=given.first, show=given.show))
    table = ["| " + " | ".join(found[0]) + " |", "|" + " --- |" * len(found[0])]
    table += ["| " + " | ".join(str(value) for value in row.values()) + " |" for row in found]
    print("\n".join(table))  # noqa: T201
    note = NOTE.format(
        records=given.records,
        first=given.first,
        gearboxes=", ".join(PARTS[given.part][0]),
        seconds=SECONDS,
        rate=RATE_HZ,
        harmonics=HARMONICS,
        wrong=WRONG,
        rough=4 * WRONG,
        clear=CLEAR_DB,
        window=WINDOW_REV,
    )
    page = "\n\n".join(["# Verdicts on speed without a tachometer", note, "\n".join(table)])
    (given.folder / "speed_verdicts.md").write_text(page + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
