"""Detectability of faults, the signal-to-noise ratio of the matched filter, against closed forms."""

import numpy as np
import pytest
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate

RATE_HZ = 5000.0
BASE = {
    **TWO_STAGE,
    "rate_hz": RATE_HZ,
    "excitation": {"harmonics": 1},
    "resonance": {"frequency_hz": 1800, "damping_ratio": 0.03},
    "noise": {"rms": 0.2},
    "sensor": [{"name": name, "on": "input bearing", "units": "g"} for name in ("a", "b")],
}
IMBALANCE = {"kind": "imbalance", "component": "input", "size_mm": 0.1}
INNER = {"kind": "inner_race", "component": "intermediate bearing", "size_mm": 0.5}


def labels(*faults, **changes):
    made = simulate(Scene.from_mapping({**BASE, "fault": list(faults), **changes}), seed=2, detectability=True)
    return made["truth_fault_detectability_db"]


def test_an_imbalance_is_as_detectable_as_its_line():
    found = labels(IMBALANCE)
    # 0.1 g at the first sensor for one second: n A^2 / (2 s^2)
    assert found.values[0, 0] == pytest.approx(10 * np.log10(5000 * 0.1**2 / (2 * 0.2**2)), abs=1e-9)
    larger = labels({**IMBALANCE, "size_mm": 0.2}, noise={"rms": 0.1})
    assert_allclose(larger.values - found.values, 10 * np.log10(4 * 4), atol=1e-9)
    assert np.all(labels(IMBALANCE, noise={"rms": 0}).values == np.inf)


def test_the_beginning_of_a_record_stands_for_all_of_it():
    scene = Scene.from_mapping({**BASE, "fault": [IMBALANCE]})
    record, name = simulate(scene, seed=2, detectability=0.5), "truth_fault_detectability_db"
    assert record.drop_vars(name).identical(simulate(scene, seed=2))
    # of the line of the imbalance again, in whole turns of the shaft
    assert record[name].values[0, 0] == pytest.approx(10 * np.log10(5000 * 0.1**2 / (2 * 0.2**2)), abs=1e-9)


@pytest.mark.parametrize("length_s", [-1.0, np.nan, np.inf])
def test_a_length_that_is_none_is_refused(length_s):
    with pytest.raises(SceneError, match=r"detectability = .* must be true, false, or a length in s"):
        simulate(Scene.from_mapping(BASE), seed=2, detectability=length_s)


def test_each_fault_has_its_own_label_whatever_stands_beside_it():
    both, alone = labels(IMBALANCE, INNER), labels(IMBALANCE)
    assert both.dims == ("truth_channel", "truth_fault")
    assert_allclose(both.values[:, 0], alone.values[:, 0], atol=1e-9)
    # the second is drawn as the second: what the record of both has more than that of the first
    made = [
        simulate(Scene.from_mapping({**BASE, "noise": {"rms": 0}, "fault": faults}), seed=2)["a"].values
        for faults in ([IMBALANCE, INNER], [IMBALANCE])
    ]
    expected = 10 * np.log10(np.sum((made[0] - made[1]) ** 2) / 0.2**2)
    assert both.values[0, 1] == pytest.approx(expected, abs=1e-6)


def test_a_wandering_level_weights_each_instant_by_the_inverse_of_its_variance():
    scene = Scene.from_mapping(
        {**BASE, "fault": [IMBALANCE], "imperfections": {"noise": {"std_db": 6, "time_scale_s": 0.1}}}
    )
    made = simulate(scene, seed=2, detectability=True)
    clean = [
        simulate(scene.changed(noise={"rms": 0}, faults=faults), seed=2)["a"].values for faults in (scene.faults, ())
    ]
    level_db = np.interp(made["time"], made["truth_time"], made["truth_noise_level"])
    expected = 10 * np.log10(np.sum((clean[0] - clean[1]) ** 2 / (0.2**2 * 10 ** (level_db / 10))))
    # the truth has an instant each 50 ms, the level a knot each 10 ms: steps of 2.6 dB, averaged over a hundred knots
    assert made["truth_fault_detectability_db"].values[0, 0] == pytest.approx(expected, abs=1.5)
    assert abs(expected - labels(IMBALANCE).values[0, 0]) > 0.5  # than with an even level
