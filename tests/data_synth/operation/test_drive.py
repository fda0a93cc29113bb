"""Tooth load relative to full load."""

import tomllib

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, load_scene
from data_synth.operation.drive import build_drive

RNG = np.random.default_rng(0)


def load(torque):
    declared = load_scene("demo").changed(torque={"link": "output", **torque})
    return build_drive(declared, datum_turn=0.0, speed_rng=RNG, torque_rng=RNG).load([0.0, 10.0])


def test_load_is_relative_to_full_load():
    assert_allclose(load({"nm": [[0, 100], [10, 400]], "unloaded_share": 0.2}), [0.4, 1.0])
    assert_allclose(load({"nm": [[0, 100], [10, 400]], "unloaded_share": 0.2, "full_load_nm": 200}), [0.6, 1.8])


def test_without_torque_the_unloaded_share_is_left():
    assert_allclose(load({"nm": 0, "unloaded_share": 0.2}), 0.2)
    assert_allclose(load({"nm": 0, "unloaded_share": 0.2, "full_load_nm": 200}), 0.2)


def test_turbulence_about_zero_needs_full_load():
    turbulence = {"rms": 5, "time_scale_s": 1}
    with pytest.raises(SceneError, match="turbulence about nm = 0 has no full load as a reference; give full_load_nm"):
        Scene.from_mapping(table_with({"link": "output", "nm": 0, "turbulence": turbulence}))
    assert np.all(load({"nm": 0, "turbulence": turbulence, "full_load_nm": 200}) >= 0.3)


def table_with(torque):
    return tomllib.loads(load_scene("demo").to_toml()) | {"torque": torque}
