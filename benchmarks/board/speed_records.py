"""Records without a tachometer, for the scoreboard's rows on speeds.

They are made here, in a few lines, and share nothing with `data_synth` or the estimator but the orders of the drawing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

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

# Constants of the search were chosen on two-stage and oh-58, at constant speed, in ramps and in turbulence.
GEARBOXES = ("wind-turbine-3-stage", "planetary-27-36-99", "alouette-iii", "wijianto-pair")
VARYING = ("slow swing", "steps", "run-up 1:2", "constant with turbulence")  # speeds


@dataclass(frozen=True, kw_only=True)
class Record:
    """A record, what is searched in it, and its true speed at every sample."""

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
    "slow swing": lambda rng, t: 1 + 0.03 * np.sin(2 * np.pi * rng.uniform(0.1, 0.3) * t + rng.uniform(0, 6)),
    "steps": _steps,
    "run-up 1:2": lambda _, t: 0.7 + 0.6 * t / SECONDS,
    "constant with turbulence": lambda rng, t: 1 + 0.002 * _smooth_noise(rng, t.size, 0.5),
}


def mode(x: Floats, hz: float, damping: float, rate_hz: float = RATE_HZ) -> Floats:
    """Return a signal through a mode, of gain 1 at rest."""
    w, r = 2 * np.pi * hz / rate_hz, np.exp(-damping * 2 * np.pi * hz / rate_hz)
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
    x = x + sum(mode(x, rng.uniform(300, 3000), rng.uniform(0.02, 0.1)) for _ in range(2))
    noise = rng.standard_normal(t.size)
    noise = noise + rng.uniform(0, 1) * mode(noise, rng.uniform(500, 3000), rng.uniform(0.03, 0.1))
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
    return Record(samples=x, orders=orders, range_hz=(low, high), speed_hz=speed)


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
