"""Scores that grow by different laws until a limit, and how often forecasts of the time until then hold it."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from fleet_analyses import Array

from signals.monitoring.slopes import time_until

LIMIT = 10.0  # standard deviations of the noise
RECORDS = (30, 60, 120)  # seen before the forecast is made
_AHEAD = 8  # times the records seen, after which a course has not reached the limit
LAWS: Mapping[str, Callable[[Array, np.random.Generator], Array]] = {  # of time over that of the straight line
    "line": lambda time, _: time,
    "line, AR(1) noise of 0.5": lambda time, _: time,
    "line, AR(1) noise of 0.9": lambda time, _: time,
    "line and random walk": lambda time, rng: time + _walk(time, rng),
    "saturation": lambda time, rng: rng.uniform(0.8, 2) * -np.expm1(-rng.uniform(1, 3) * time),
    "exponential": lambda time, rng: np.expm1((rate := rng.uniform(2, 5)) * np.minimum(time, 2)) / np.expm1(rate),
    "quadratic": lambda time, _: time**2,
    "steps": lambda time, _: np.floor(6 * time) / 6,
    "line from an onset on": lambda time, rng: np.maximum(0, (time - (on := rng.uniform(0.1, 0.5))) / (1 - on)),
}


def _walk(time: Array, rng: np.random.Generator) -> Array:
    """Return a random walk with 0.1 to 0.4 of the limit as its deviation after the time of the straight line."""
    return rng.uniform(0.1, 0.4) * math.sqrt(time[1]) * np.cumsum(rng.standard_normal(time.size))


def course(law: str, records: int, rng: np.random.Generator) -> tuple[Array, float]:
    """Return the scores (records,) seen, and the number of records after the last until the level reaches the limit.

    A straight line is 40 to 80 % of the way then; courses that have reached the limit are drawn again.
    """
    noise = rng.standard_normal(_AHEAD * records)
    decay = float(law[-3:]) if "AR(1)" in law else 0.0
    for number in range(1, noise.size):
        noise[number] = decay * noise[number - 1] + math.sqrt(1 - decay**2) * noise[number]
    level = LIMIT * LAWS[law](np.arange(noise.size) / records * rng.uniform(0.4, 0.8), rng)
    reached = np.flatnonzero(level >= LIMIT)
    first = float(reached[0]) if reached.size else math.inf
    return course(law, records, rng) if first < records else ((level + noise)[:records], first - records + 1)


def coverage(law: str, count: int) -> tuple[Array, Array, Array]:
    """Return, of forecasts given, whether the interval holds what is true, its width, and how long remains."""
    rows = []
    for number in range(count):
        rng = np.random.default_rng([8, number])
        seen, true = course(law, RECORDS[number % len(RECORDS)], rng)
        found = time_until(LIMIT, seen, np.arange(seen.size, dtype=np.float64), seed=number)
        if not found.reason:
            rows.append((found.low <= true <= found.high, found.high - found.low, true))
    inside, width, remains = np.array(rows).reshape(-1, 3).T
    return inside, width, remains
