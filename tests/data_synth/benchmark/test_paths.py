"""A path is a rigid body below its modes, and each mode has the peak of its gain."""

import numpy as np
import pytest

from data_synth import Scene
from data_synth.benchmark.gearboxes import draw_bearing, draw_gearbox
from data_synth.benchmark.paths import draw_path
from data_synth.transfer.paths import transfer_paths


@pytest.mark.parametrize("seed", range(5))
def test_far_below_its_modes_it_moves_as_a_rigid_body(seed):
    rng = np.random.default_rng(seed)
    drawn, gearbox = draw_path("p", rng=rng), draw_gearbox("g", stages=3, rng=rng)
    bearings = [f"{link} bearing" for link in gearbox.links]
    scene = Scene.from_mapping(
        {
            "gearbox": gearbox.table({link: draw_bearing(rng) for link in gearbox.links}),
            "rate_hz": 25600,
            "duration_s": 1,
            "fidelity": "kinematic",
            "speed": {"link": "input", "rpm": 1000},
            "tachometer": {"link": "input", "pulses_per_rev": 1},
            "sensor": [{"name": "s", "on": "input bearing", "units": "m s-2"}],
            "transfer": drawn.transfers(bearings, sensor="s"),
        }
    )
    paths = transfer_paths(scene)
    assert {source for source, _ in paths} == {*bearings}
    for path in paths.values():
        assert abs(path.response(0.0)) == pytest.approx(1 / drawn.mass_kg, rel=1e-9)


def test_its_sensor_has_a_mount_between_magnet_and_stud_and_a_gain_near_one():
    drawn = [draw_path("p", rng=np.random.default_rng(seed)).sensor() for seed in range(200)]
    mounts = [each["resonance"]["frequency_hz"] for each in drawn]
    assert 7000 <= min(mounts) < 9000
    assert 25000 < max(mounts) <= 31000
    assert np.std(20 * np.log10([each["gain"] for each in drawn])) == pytest.approx(0.4, rel=0.15)  # 3 of 1 / sqrt(400)


def test_it_has_four_places():
    with pytest.raises(ValueError, match=r"5 bearings, but a path has 4 places; name fewer"):
        draw_path("p", rng=np.random.default_rng(0)).transfers([*"abcde"], sensor="s")
