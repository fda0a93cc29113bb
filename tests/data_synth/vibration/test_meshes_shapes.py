"""Rectangular and Fourier mesh stiffness of a scene: numbers of Wijianto's gear pair, and the integrator they get."""

import math
import re
import tomllib

import numpy as np
import pytest
from moving_pair import BASE, motion, scene
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate
from data_synth.integrators.problem import Output
from data_synth.vibration.steady_state import periodic_state

# eq. 12 of Wijianto: mean 1e6 N/m, 6e5 from least to most, contact ratio 1.4, 36 x 231.5 = 8334 rad/s
PAPER = {"shape": "rectangular", "stiffness_n_m": 1e6, "step_n_m": 6e5, "contact_ratio": 1.4}
PAPER |= {"error_um": 0, "backlash_um": 0}
STEADY = {
    "speed": {"link": "pinion", "rpm": 231.5 * 30 / math.pi},
    "torque": {"link": "gear", "nm": 1.75 * 75},
}


def ready(mesh, **changes):
    return motion(scene(mesh=mesh, dynamics={"damping_ratio": 1e-13}, **{**STEADY, **changes}))


def test_a_rectangle_has_the_paper_s_numbers_and_the_scene_s_phase():
    stiffness = ready(PAPER).system.meshes[0].stiffness
    phases = np.linspace(0, 1, 1001)
    assert sorted(set(stiffness(phases))) == pytest.approx([0.76e6, 1.36e6])
    rise, fall = sorted(stiffness.jumps) if stiffness(0.0) < 1e6 else sorted(stiffness.jumps)[::-1]
    assert (fall - rise) % 1 == pytest.approx(0.4)
    assert stiffness.mean == pytest.approx(1e6)


def test_lines_of_one_s_own():
    # c cos + s sin at each mesh harmonic, the phase of the mesh left to the scene
    own = {"shape": "fourier", "stiffness_n_m": 1e8, "harmonics_n_m": [[3e6, 0], [0, 2e6]]}
    stiffness = ready({**own, "error_um": 0}).system.meshes[0].stiffness
    one, two = (np.fft.rfft(stiffness(np.arange(64) / 64)) / 32)[1:3]
    assert_allclose(np.abs([one, two]), [3e6, 2e6], rtol=1e-12)
    assert np.angle(two / one**2) == pytest.approx(-np.pi / 2)
    assert stiffness.mean == 1e8


def test_by_default_the_step_is_that_of_one_pair_of_teeth():
    stiffness = ready({"shape": "rectangular", "stiffness_n_m": 2e8, "error_um": 0}).system.meshes[0].stiffness
    low, high = sorted(set(stiffness(np.linspace(0, 1, 101))))
    assert high == pytest.approx(2 * low)


def test_a_rectangle_reaches_the_known_steady_state():
    moving = ready(PAPER)
    rows = np.zeros((1, 6))
    rows[0, [2, 5]] = BASE
    found = periodic_state(
        moving.problem(0.0, 2 * math.pi / 8334),
        output=Output(rate_hz=1.0, displacement=rows),
        samples=2000,
    )
    q = found.waveform.values[:, 0]
    # computed independently, seven and four digits; the load there gives way with speed, by less than the last one
    assert np.mean(q[:-1]) == pytest.approx(1.1868201e-3, abs=6e-11)
    assert np.ptp(q) == pytest.approx(5.899e-6, abs=6e-10)


@pytest.mark.parametrize(
    ("mesh", "sentence"),
    [
        ({"shape": "fourier"}, 'shape = "fourier" needs harmonics'),
        ({"shape": "teeth", "step_n_m": 1e6}, 'step_n_m = 1e.06 has no effect with shape = "teeth"'),
        ({"shape": "constant", "contact_ratio": 1.4}, "contact_ratio = 1.4 has no effect"),
        ({"shape": "rectangular", "harmonics_n_m": [[1, 0]]}, "harmonics_n_m = .* has no effect"),
        ({"shape": "fourier", "harmonics_n_m": [[1, 0]], "step_n_m": 1e6}, "step_n_m .* has no effect"),
        ({"shape": "rectangular", "contact_ratio": 2.0}, "contact_ratio = 2.*a whole number"),
        ({**PAPER, "step_n_m": 3e6}, r"step_n_m = 3000000 .*at most 2500000,"),
        ({"shape": "fourier", "stiffness_n_m": 1e6, "harmonics_n_m": [[2e6, 0]]}, r"falls to -1e\+06 N/m"),
    ],
)
def test_stiffness_that_cannot_be_is_refused(mesh, sentence):
    with pytest.raises(SceneError, match=sentence):
        simulate(scene(mesh={"error_um": 0, **mesh}), seed=1)


def test_the_largest_step_that_the_message_prints_is_accepted():
    ratio = 1.6  # 1e6 / 0.6 is rounded up
    with pytest.raises(SceneError) as caught:
        ready({**PAPER, "contact_ratio": ratio, "step_n_m": 2e6})
    most = float(re.search(r"at most ([\d.e+]+),", str(caught.value))[1])
    assert most > 1e6 / 0.6
    stiffness = ready({**PAPER, "contact_ratio": ratio, "step_n_m": most}).system.meshes[0].stiffness
    assert np.min(stiffness(np.linspace(0, 1, 101))) == 0


def test_the_numbers_survive_the_record():
    own = {"shape": "fourier", "stiffness_n_m": 1e6, "harmonics_n_m": [[1e5, 2e5]]}
    for mesh in (PAPER, own):
        declared = scene(mesh=mesh)
        assert Scene.from_mapping(tomllib.loads(declared.to_toml())) == declared
