import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate

SCENE = {
    "gearbox": "planetary-27-36-99",
    "rate_hz": 20_000,
    "duration_s": 0.25,
    "fidelity": "kinematic",
    "speed": {"link": "carrier", "rpm": 120},
    "tachometer": {"link": "carrier", "pulses_per_rev": 12, "offset_rev": 0.0},
    "noise": {"rms": 0},
    "excitation": {"shaft_amplitude": 0, "meshes": {"sun-planet": 0}, "harmonics": 2},
    "sensor": [{"name": "a", "on": "ring", "units": "g"}],
}
CARRIER = 27 / 126  # turns of the carrier for one of the sun (Willis)


def record(**changes):
    return simulate(Scene.from_mapping({**SCENE, **changes}), seed=2)


def test_only_lines_that_planets_do_not_cancel_reach_a_sensor_on_the_ring():
    made = record(planet_pass={"half_width_deg": 40, "floor": 0.1})
    heard = np.abs(made["truth_amplitude"].values[0, :, 0]) > 1e-9
    lines = made["truth_order"].values[heard] / CARRIER
    assert_allclose(lines, np.rint(lines), atol=1e-9)
    # three planets alike: whole multiples of three only (McFadden and Smith 1985); 99 is one, its neighbours are not
    assert set(np.rint(lines).astype(int) % 3) == {0}
    assert {96, 99, 102, 198} <= set(np.rint(lines).astype(int))


def test_the_truth_is_what_three_planets_sound_like_one_by_one():
    made, still = record(planet_pass={"half_width_deg": 40, "floor": 0.1}), record()
    turns = 2 * made["time"].values  # of the carrier
    harmonics = [
        still["truth_amplitude"].sel(truth_order=99 * CARRIER * h, method="nearest").values[0, 0] for h in (1, 2)
    ]
    # the turn at which planet 1 stands at the sensor is drawn: find it on a fine grid, then all samples have to agree
    kappa = np.log(2) / (1 - np.cos(np.radians(40)))

    def heard(offset):
        total = np.zeros(turns.size)
        for place in (0, 1 / 3, 2 / 3):
            angle = turns + offset + place
            gain = 0.1 + 0.9 * np.exp(kappa * (np.cos(2 * np.pi * angle) - 1))
            total += gain * sum(
                (z / 3 * np.exp(2j * np.pi * 99 * h * angle)).real for h, z in enumerate(harmonics, start=1)
            )
        return total

    offsets = np.arange(0, 1 / 3, 1 / 99 / 40)
    errors = [np.std(heard(offset) - made["a"].values) for offset in offsets]
    best = offsets[np.argmin(errors)]
    fine = best + np.linspace(-1, 1, 201) / 99 / 40
    errors = [np.std(heard(offset) - made["a"].values) for offset in fine]
    # the grid leaves 2 pi 198 / 99 / 40 / 200 = 0.0016 of the larger harmonic
    assert min(errors) < 2e-3 * np.std(made["a"].values)


def test_a_gearbox_without_planets_has_none_to_pass():
    sensors = [{"name": "a", "on": "input", "units": "g"}]
    plain = {
        "gearbox": "two-stage", "speed": {"link": "input", "rpm": 600}, "sensor": sensors,
        "tachometer": {"link": "input", "pulses_per_rev": 1}, "excitation": {}, "planet_pass": {"half_width_deg": 30},
    }  # fmt: skip
    with pytest.raises(SceneError, match='planets on a ring at rest, but gearbox "two-stage" has none; leave it out'):
        record(**plain)
    with pytest.raises(SceneError, match="half_width_deg"):
        record(planet_pass={"half_width_deg": 180})
