"""Free vibration after a start or a jump of the load against a mass on a spring that is set off equilibrium."""

import numpy as np
import pytest
from moving_pair import BASE, INERTIAS, scene
from scipy import signal

from data_synth import load_scene, simulate

STIFF, ZETA = {name: {"radial_n_m": 1e12} for name in ("pinion", "gear")}, 0.01
RIGID = {  # forces of the pinion's bearing move a housing that hangs softly, others do not
    "bearings": STIFF, "elsewhere": 0.0, "rigid_below_hz": 1e-6, "mounts": {"frequency_hz": 5, "damping_ratio": 0.5},
    "damping_ratio": ZETA, "error": 1e-3,
}  # fmt: skip
EVEN = {"shape": "constant", "error_um": 0}
JUMP = {"torque": {"link": "gear", "steps": [[0, 130], [0.1, 150]]}}


def test_a_mass_on_a_spring_set_off_equilibrium_beside_a_line():
    # the teeth are the spring of both inertias at their base radii, and the housing a mass of 15 kg on a softer one
    natural = np.sqrt(2e8 * sum(radius**2 / inertia for radius, inertia in zip(BASE, INERTIAS, strict=True)))
    ratio = 2 * np.pi * 360 / natural  # of the mesh order, at 600 rpm, whose error of 3 um is a line
    line_n = 2e8 * 3e-6 * ratio**2 / (1 - ratio**2)
    mounts = 2 * np.pi * 5
    housing = ([1, 0, 0], [15, 15 * 2 * 0.5 * mounts, 15 * mounts**2])
    times_s = np.arange(0, 0.2, 1e-6)  # after the jump of the static force, to which the teeth swing
    swing = 1 - np.exp(-ZETA * natural * times_s) * np.cos(natural * times_s)
    rung = signal.lsim(housing, 20 / BASE[1] * swing, times_s)[1]
    line = line_n * np.abs(signal.freqs(*housing, 2 * np.pi * 360)[1]).item()
    free, both = np.mean(rung**2) * 0.2 / 0.3, line**2 / 2
    record = simulate(scene(dynamics=RIGID, mesh={**EVEN, "error_um": 3}, **JUMP), seed=1)
    assert record["truth_free"].item() == pytest.approx(free / (free + both), rel=0.01)
    assert record["truth_left"].item() < 1e-3  # the rest is lines


def test_nothing_else_is_all_of_it_and_no_jump_none():
    assert simulate(scene(dynamics=RIGID, mesh=EVEN, **JUMP), seed=1)["truth_free"].item() == pytest.approx(1, abs=0.02)
    assert simulate(scene(dynamics=RIGID, mesh={**EVEN, "error_um": 3}), seed=1)["truth_free"].item() == 0
    declared = load_scene("wijianto")
    mesh = declared.dynamics.mesh("mesh").changed(shape="constant", step_n_m=None, contact_ratio=None)
    started = declared.changed(dynamics=declared.dynamics.changed(meshes=(("mesh", mesh),)))
    assert simulate(started, seed=1)["truth_free"].values == pytest.approx([1, 1], abs=0.02)
