"""Lines of no shaft, steady and in simple ratios, and steady shafts."""

import numpy as np
import pytest
from scipy.signal import lfilter

from signals.shaft.tacholess import estimate_speed

RATE_HZ, SECONDS = 4096.0, 4.0
DRAWINGS = {
    "a mesh and its shaft": (1, 20, 40, 60),
    "two stages": (0.4, 1, 7.2, 14.4, 21.6, 23, 46, 69),
    "many meshes": (0.17, 0.41, 0.49, 1, 5.69, 8.29, 11.38, 16.07, 16.59, 20, 24.88, 32.13, 40),
}
RATIOS = {"1:2": (1, 2), "2:3": (2, 3), "1:3": (1, 3), "1:2:3": (1, 2, 3)}
# Each kind of record with two drawings: among them are all the rules that tell such lines from a shaft's.
NO_SHAFT = {
    "1:2": ("a mesh and its shaft", "many meshes"),
    "2:3": ("two stages", "many meshes"),
    "1:3": ("a mesh and its shaft", "two stages"),
    "1:2:3": ("a mesh and its shaft", "two stages"),
    "mains": ("two stages", "many meshes"),
    "mains and 1:2": ("a mesh and its shaft", "many meshes"),
    "unrelated": ("a mesh and its shaft", "many meshes"),
    "resonance": ("a mesh and its shaft", "two stages"),
    "noise": ("two stages", "many meshes"),
}


def tones(rng, frequencies):
    t = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    x = rng.standard_normal(t.size)
    for hz in frequencies:
        x = x + 10 ** rng.uniform(-1, 0.7) * np.cos(2 * np.pi * hz * t + rng.uniform(0, 2 * np.pi))
    return x


def resonant_noise(rng):
    x = rng.standard_normal(int(RATE_HZ * SECONDS))
    w = 2 * np.pi * rng.uniform(200, 1800) / RATE_HZ
    r = np.exp(-rng.uniform(0.005, 0.1) * w)
    a = np.array([1, -2 * r * np.cos(w), r * r])
    return x + lfilter([a.sum()], a, x)


def record(kind, rng):
    mains = float(rng.choice([50.0, 60.0])) * np.array([1, 2, 3, 5, 7])
    match kind:
        case "resonance":
            return resonant_noise(rng)
        case "noise":
            return tones(rng, ())
        case "unrelated":
            return tones(rng, rng.uniform(30, 1900, 6))
        case "mains":
            return tones(rng, mains)
        case "mains and 1:2":
            return tones(rng, [*mains, *(rng.uniform(60, 900) * np.array([1, 2]))])
    return tones(rng, rng.uniform(60, 600) * np.array(RATIOS[kind]))


class TestNoShaft:
    @pytest.mark.parametrize("kind", NO_SHAFT)
    def test_is_never_sure(self, kind):
        """Up to half of these were: two listed orders in the ratio of the lines are easily found."""
        for drawing in NO_SHAFT[kind]:
            orders = DRAWINGS[drawing]
            rng = np.random.default_rng([*map(ord, kind + drawing)])
            middle = min(1200 / orders[-1], 40) * rng.uniform(0.5, 1)
            found = estimate_speed(
                record(kind, rng),
                rate_hz=RATE_HZ,
                orders=orders,
                speed_range_hz=(middle * rng.uniform(0.4, 0.9), middle * rng.uniform(1.1, 2.2)),
                max_acceleration_hz_s=float(rng.choice([1.0, 5.0])),
            )
            assert found.status != "ok"
            assert found.phase is None
            assert found.confidence.max() <= 0.5


class TestSteadyShaft:
    """The mesh 20 and its second harmonic alone may be any tone's; sidebands at the shaft's turning are no tone's."""

    @pytest.mark.parametrize(("sidebands", "status"), [(0.0, "ambiguous"), (0.2, "ok")])
    def test_is_known_by_its_sidebands(self, sidebands, status):
        orders = {20 + side: sidebands if side else 1.0 for side in (-2, -1, 0, 1, 2)}
        orders |= {40 + side: sidebands if side else 0.7 for side in (-1, 0, 1)}
        t = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
        x = sum(height * np.cos(2 * np.pi * order * 21.3 * t + order) for order, height in orders.items())
        found = estimate_speed(
            x + np.random.default_rng(1).standard_normal(t.size),
            rate_hz=RATE_HZ,
            orders=(1, 20, 40, 60),
            speed_range_hz=(15, 30),
            max_acceleration_hz_s=2,
        )
        assert found.status == status
        assert np.median(found.speed_hz) == pytest.approx(21.3, rel=1e-3)
