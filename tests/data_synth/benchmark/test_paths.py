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


def test_it_has_four_places():
    with pytest.raises(ValueError, match=r"5 bearings, but a path has 4 places; name fewer"):
        draw_path("p", rng=np.random.default_rng(0)).transfers([*"abcde"], sensor="s")
