"""The speed law of the resampling job: a shaft whose speed swings, with its angle in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

PI = np.arccos(np.longdouble(-1))


def revolutions(times_s):
    """Integral of 50 (1 + 0.1 sin(pi t)) Hz, in extended precision."""
    t = np.asarray(times_s, dtype=np.longdouble)
    return 50 * t + 5 * (1 - np.cos(PI * t)) / PI


def speed_hz(times_s):
    return 50 * (1 + 0.1 * np.sin(np.pi * np.asarray(times_s)))


def times_at(revs):
    """Newton's method on the closed form, in extended precision.

    Started within 0.07 s at 45 to 55 Hz the error is squared and divided by 6 s each time: 1e-3, 1e-7, 1e-15, done.
    """
    wanted = np.asarray(revs, dtype=np.longdouble)
    t = wanted / 50
    for _ in range(5):
        t = t - (revolutions(t) - wanted) / (50 + 5 * np.sin(PI * t))
    return t.astype(np.float64)


@pytest.fixture(scope="session")
def swinging():
    """50 (1 + 0.1 sin(pi t)) Hz: `revolutions(t)`, `speed_hz(t)`, `times_at(revolutions)`."""
    return SimpleNamespace(revolutions=revolutions, speed_hz=speed_hz, times_at=times_at)


@pytest.fixture(scope="session")
def middle():
    """The middle 90 % of an array, where the standard jobs are judged."""
    return lambda values: values[values.size // 20 : -(values.size // 20)]
