"""A declared speed is refined by lines that clearly show another within its tolerance, and by nothing else."""

from functools import cache

import numpy as np
import pytest
from scipy import io

from signals.shaft.tacholess import refine_declared_speed

RATE_HZ, ORDERS = 4000.0, (1.0, 2.0, 3.0, 23.0, 46.0)
T = np.arange(round(6 * RATE_HZ)) / RATE_HZ


def record(speed_hz, orders=ORDERS, *, height=0.2, seed=0):
    tones = [height * np.cos(2 * np.pi * order * speed_hz * T + order) for order in orders]
    return np.sum(tones, axis=0) + np.random.default_rng(seed).standard_normal(T.size)


def refined(x, *, speed_hz=25.0, tolerance=0.02):
    return refine_declared_speed(x, rate_hz=RATE_HZ, speed_hz=speed_hz, orders=ORDERS, tolerance=tolerance)


@cache
def refined_by_noise(seed):
    return refined(np.random.default_rng(seed).standard_normal(T.size))


@pytest.mark.parametrize("error", [-0.015, -0.004, 0.002, 0.018])
def test_the_lines_show_the_speed(error):
    true = 25.0 / (1 + error)
    found = refined(record(true))
    assert found.refined
    # one step of the speeds tried: half a bin (1 / 3 s, of half of the record) at order 46; the search favours bins
    assert abs(found.speed_hz / true - 1) < 0.5 / 3 / (46 * 25)
    assert set(found.orders) >= {23.0, 46.0}


@pytest.mark.parametrize("height", [2.0, 2000.0])
def test_the_leakage_of_strong_lines_is_no_other_speed(height):
    found = refined(record(24.8, height=height))
    assert found.refined
    assert abs(found.speed_hz / 24.8 - 1) < 0.5 / 3 / (46 * 25)


@pytest.mark.parametrize("seed", range(6))
def test_noise_changes_nothing(seed):
    found = refined_by_noise(seed)
    assert (found.refined, found.speed_hz) == (False, 25.0)


@pytest.mark.parametrize(
    "x",
    [
        record(25.0),
        record(24.75, (2.0,)),  # a line of another machine, or a hum
        record(24.0),  # beyond the tolerance
        record(24.75) + record(25.2),  # two machines
        np.zeros(T.size),
        np.zeros(100),
    ],
    ids=["right", "one line", "beyond", "two", "silence", "short"],
)
def test_what_shows_no_other_speed_clearly_changes_nothing(x):
    found = refined(x)
    assert abs(found.speed_hz / 25.0 - 1) < 1e-4


@pytest.mark.parametrize("name", ["B021_0", "IR014_0"])
def test_harmonics_of_a_measured_motor_show_its_speed(real_data, name):
    data = io.loadmat(real_data / "cwru" / f"{name}.mat")
    x = next(value for key, value in data.items() if key.endswith("DE_time")).ravel()
    stated = next(float(value.ravel()[0]) for key, value in data.items() if key.endswith("RPM")) / 60
    for error in (-0.018, -0.005, 0.0, 0.01, 0.018):
        declared = stated * (1 + error)
        found = refine_declared_speed(x, rate_hz=12000, speed_hz=declared, orders=range(1, 11), tolerance=0.02)
        assert found.speed_hz == pytest.approx(stated, rel=0.002)  # it is stated to 1 rpm, and wanders by a thousandth
        assert 1.0 in found.orders  # twice it may be the mains at 60 Hz


@pytest.mark.parametrize(("name", "share"), [("InnerRaceFault_vload_1", 0.9894), ("OuterRaceFault_vload_1", 0.993)])
def test_a_measured_record(real_data, name, share):
    """Shaft lines of the MFPT rig stand below the declared 25 Hz: peaks of the whole record's spectrum at 4x and 2x."""
    x, rate = mfpt(real_data / "mfpt" / f"{name}.mat")
    found = refine_declared_speed(x, rate_hz=rate, speed_hz=25.0, orders=range(1, 11), tolerance=0.02)
    assert found.refined
    assert abs(found.speed_hz / 25 - share) < 0.002  # half of a bin of 3 s at 2x and 4x is 0.3 and 0.2 % of them


def mfpt(path):
    bearing = io.loadmat(path, squeeze_me=True, struct_as_record=False)["bearing"]
    return np.asarray(bearing.gs, dtype=float), float(bearing.sr)
