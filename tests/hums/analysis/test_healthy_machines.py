"""The probability over healthy machines against the law it is estimated from."""

from dataclasses import replace

import numpy as np
import pytest

import hums
from hums.analysis.healthy_machines import HealthyMachines, healthy_machines

DRAWS = np.random.default_rng(3).exponential(size=5000)
LIBRARY = HealthyMachines(records=500, parts=DRAWS.size, strengths=tuple(np.sort(DRAWS)[::-1][:400]))
ABOVE = np.linspace(DRAWS.max(), 30, 50)
TAILED = replace(LIBRARY, tail_strengths=tuple(ABOVE), tail_bounds=tuple(np.exp(-ABOVE)))


def test_of_healthy_records_the_share_p_gets_p_or_less():
    records = np.random.default_rng(4).exponential(size=(4000, 10)).max(axis=1)
    chances = np.array([LIBRARY.probability(one, parts=10) for one in records])
    for stated in (0.01, 0.05):
        # the library's own scatter is that of 5 and 25 of its parts: 45 and 20 %
        assert np.mean(chances <= stated) == pytest.approx(stated, rel=0.6)


@pytest.mark.parametrize("alike", [True, False])
def test_channels_are_one_test_whether_they_show_the_same_or_each_its_own(alike):
    records = np.random.default_rng(5).exponential(size=(20_000, 1 if alike else 6)).repeat(6 if alike else 1, axis=1)
    chances = np.array([LIBRARY.probability(first, others=others) for first, *others in records])
    for stated in (0.01, 0.05):
        assert np.mean(chances <= stated) == pytest.approx(stated, rel=0.5)


def test_beyond_the_library_the_probability_falls_with_its_tail():
    assert TAILED.probability(20.0, parts=100) == pytest.approx(100 * np.exp(-20.0), rel=0.05)
    assert LIBRARY.probability(20.0, parts=100) == pytest.approx(1 - (1 - 1 / 5001) ** 100)
    assert LIBRARY.probability(0.0) == TAILED.probability(0.0) == 1.0


@pytest.mark.parametrize(("library", "stated"), [(LIBRARY, (0.004, 0.02, 0.3)), (TAILED, (1e-9, 1e-5, 0.004, 0.3))])
def test_the_strength_at_a_probability_is_its_inverse(library, stated):
    for one in stated:
        strength = library.strength_at(one, parts=4)
        assert library.probability(strength, parts=4) <= one
        assert library.probability(strength * (1 - 1e-6), parts=4) >= one * (1 - 1e-3)
    assert library.strength_at(1e-20) == np.inf


def test_a_gross_race_fault_is_diagnosed_beside_many_sound_bearings():
    found = hums.verdict_table(hums.analyze(gross_inner_race(), machine(further=20), settings=SETTINGS))
    named = found[found.verdict.isin(["diagnosed", "indicated"])]
    assert named[["component", "kind", "verdict"]].to_numpy().tolist() == [["input DE", "inner_race", "diagnosed"]]
    assert named.false_alarm_probability.to_list() == [1 / 2000]


INPUT_HZ, RATE_HZ, SECONDS = 20.0, 20_000, 8
SETTINGS = hums.AnalysisSettings(most_tracks=0, pictures=False)
INNER_ORDER = 9 / 2 * (1 + 8.0 / 39.0)


def gross_inner_race():
    """Impacts at BPFI of the input bearing, carried through the load zone, beside two meshes and noise."""
    rng, t = np.random.default_rng(1), np.arange(RATE_HZ * SECONDS) / RATE_HZ
    count = int(INNER_ORDER * INPUT_HZ * SECONDS) - 2
    times = np.arange(1, count + 1) / (INNER_ORDER * INPUT_HZ) + rng.normal(0, 2e-4, count)
    load = np.clip(np.cos(2 * np.pi * INPUT_HZ * times), 0, None) ** 1.5
    ring = np.exp(-np.arange(120) / 18.0) * np.sin(2 * np.pi * 4200 * np.arange(120) / RATE_HZ)
    x = 3 * np.convolve(np.bincount((times * RATE_HZ).astype(int), load, t.size)[: t.size], ring)[: t.size]
    x += np.sin(2 * np.pi * 19 * INPUT_HZ * t) + 0.5 * np.sin(2 * np.pi * 21 * 19 / 56 * INPUT_HZ * t)
    speed = hums.NominalSpeed(rpm=60 * INPUT_HZ, shaft="input")
    return hums.make_record({"a": x + rng.normal(0, 0.2, t.size)}, rate_hz=RATE_HZ, units="g", angle=speed)


def machine(further):
    """Two stages with a bearing of the input shaft and some more of the others."""

    def bearing(name, shaft, elements, element_mm, pitch_mm):
        rings = {"names": [name], "inner_ring": shaft, "outer_ring": "housing"}
        return rings | {"elements": elements, "element_diameter_mm": element_mm, "pitch_diameter_mm": pitch_mm}

    others = [bearing(f"B{i}", ("layshaft", "output")[i % 2], 8 + i % 7, 5 + 0.11 * i, 46.3) for i in range(further)]
    return hums.Gearbox.model_validate(
        {
            "name": "m",
            "frame": "housing",
            "reference": "input",
            "axes": {name: ["housing", name] for name in ("input", "layshaft", "output")},
            "mesh": [{"teeth": {"input": 19, "layshaft": 56}}, {"teeth": {"layshaft": 21, "output": 74}}],
            "bearing": [bearing("input DE", "input", 9, 8.0, 39.0), *others],
        }
    )


# a score of bearings is a logarithm of odds; a strength of teeth the exponent of a probability
@pytest.mark.parametrize(("parts", "most"), [("bearings", 100), ("teeth", 30)])
def test_the_shipped_library_is_sound(parts, most):
    shipped = healthy_machines(parts)
    assert shipped.records > 200  # so that the half of a stated 0.01, which gears and bearings share, is reached
    assert shipped.parts > shipped.records
    assert list(shipped.strengths) == sorted(shipped.strengths, reverse=True)
    assert all(0 < one < most for one in shipped.strengths)
    rising = [shipped.probability(one, parts=50) for one in np.geomspace(1e-3, 100, 500)]
    assert list(rising) == sorted(rising, reverse=True)
