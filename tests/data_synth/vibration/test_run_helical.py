"""Helical gears that vibrate: forces, frequencies and motion against equations written down anew here."""

from functools import partial

import numpy as np
import pytest
from declared_pair import PAIR, declared_pair
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from data_synth import Scene, simulate
from data_synth.scene.random_streams import random_stream
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.run import motion_of, prepare_gears

HELIX, NORMAL = np.radians(15), np.radians(20)
TEETH, MODULE = np.array([20, 40]), 4e-3
PITCH_RADII = MODULE * TEETH / np.cos(HELIX) / 2
MASS, POLAR = np.array([5.0, 12.0]), np.array([0.01, 0.06])
RADIAL, AXIAL, TILTING = np.array([4e7, 6e7]), np.array([3e7, 5e7]), np.array([2e5, 4e5])
MESH, LOAD = 3e8, np.array([150.0, 300.0])
SEED = 3


def scene(fidelity="dynamic", *, hand="right", shape="constant", direction=(0, 0, 1), **changes):
    dynamics = {
        **PAIR["dynamics"],
        "meshes": {"mesh": {"shape": shape, "stiffness_n_m": MESH, "error_um": 3}},
        "bearings": {
            "pinion": {"radial_n_m": 4e7, "axial_n_m": 3e7, "tilt_nm_rad": 2e5},
            "wheel": {"radial_n_m": 6e7, "axial_n_m": 5e7, "tilt_nm_rad": 4e5},
        },
        "elsewhere": 0.0,
    }
    helical = {
        "gearbox": declared_pair(name="helical pair", helix_angle_deg=15, hand=hand),
        "fidelity": fidelity,
        "dynamics": dynamics,
        "sensor": [PAIR["sensor"][0] | {"direction": list(direction)}],
    }
    return Scene.from_mapping({**PAIR, **helical, **changes})


def ready(declared):
    stage = prepare_scene(declared, rng_for=partial(random_stream, SEED))
    return stage, prepare_gears(stage)


def motion(declared):
    stage, _ = ready(declared)
    return motion_of(stage)


def normal(sign=1.0):
    """The line of action in x (to the wheel), y and z; its part across the shafts is of unit length."""
    transverse, base = np.arctan(np.tan(NORMAL) / np.cos(HELIX)), np.arcsin(np.sin(HELIX) * np.cos(NORMAL))
    return np.array([np.sin(transverse), np.cos(transverse), sign * np.tan(base)])


def direction(sign=1.0):
    """Deflection by x, y, z, both tilts and the turn of either gear, its pitch point on the line of centres."""
    rows = [np.concatenate([part * normal(sign), r * np.cross([1, 0, 0], normal(sign))]) for part, r in _SIDES]
    return np.concatenate(rows)


_SIDES = ((1, PITCH_RADII[0]), (-1, PITCH_RADII[1]))


def matrices():
    """Mass, stiffness, damping and gyroscopic matrix, put together by hand."""
    disc = 7850 * np.pi * PITCH_RADII**2 * 0.03  # tilts are those of steel discs, as nothing else is declared
    tilt = disc * PITCH_RADII**2 / 4 + disc * 0.03**2 / 12
    inertia = np.array([[m, m, m, t, t, p] for m, t, p in zip(MASS, tilt, POLAR, strict=True)]).ravel()
    spring = np.array([[r, r, a, b, b, 0] for r, a, b in zip(RADIAL, AXIAL, TILTING, strict=True)]).ravel()
    g = direction(-1.0)
    stiffness = np.diag(spring) + MESH * np.outer(g, g)
    squares, shapes = eigh(stiffness, np.diag(inertia))
    heavy = inertia[:, None] * shapes
    damping = heavy * (2 * 0.05 * np.sqrt(np.maximum(squares, 0))) @ heavy.T
    gyroscopic = np.zeros((12, 12))
    for first, spin in ((3, 2 * np.pi * 10 * POLAR[0]), (9, -2 * np.pi * 5 * POLAR[1])):
        gyroscopic[first, first + 1], gyroscopic[first + 1, first] = spin, -spin
    return np.diag(inertia), stiffness, damping, gyroscopic


@pytest.mark.parametrize(("hand", "sign"), [("right", -1), ("left", 1)])
def test_the_axial_force_at_rest_is_the_tangential_one_times_the_tangent_of_the_helix(hand, sign):
    for way, number in (((0, 0, 1), 1), ((0, 1, 0), 0), ((1, 0, 0), 2)):
        ready_ = motion(scene(hand=hand, direction=way))
        held = ready_.problem(0.0, 1.0).start.displacement
        force = np.sum(ready_.output.displacement @ held)  # as on a rigid and as on an elastic housing
        tangential = LOAD[0] / PITCH_RADII[0]
        radial = tangential * np.tan(NORMAL) / np.cos(HELIX)
        expected = [radial, tangential, sign * tangential * np.tan(HELIX)][number]
        assert abs(force) == pytest.approx(abs(expected), rel=1e-9)
        if number == 2:
            assert np.sign(force) == np.sign(expected) * np.sign(_tangential(hand))


def _tangential(hand):
    ready_ = motion(scene(hand=hand))
    return np.sum(ready_.output.displacement @ ready_.problem(0.0, 1.0).start.displacement)


def test_lines_of_the_linear_response_are_those_of_twelve_equations():
    mass, stiffness, damping, gyroscopic = matrices()
    w, mounts = 2 * np.pi * 200, 2 * np.pi * 150
    q = np.linalg.solve(stiffness - w**2 * mass + 1j * w * (damping + gyroscopic), MESH * 3e-6 * direction(-1.0))
    housing = -(w**2) / 15 / (mounts**2 - w**2 + 2j * 0.4 * mounts * w)
    sensors = [
        {"name": str(way), "on": "pinion", "direction": way, "units": "m s-2"}
        for way in ([0, 0, 1], [1, 0, 0], [0, 1, 0])
    ]
    record = simulate(scene("auto", sensor=sensors), seed=SEED)
    assert record.attrs["truth_fidelity"].startswith("linear response: the models differ by nothing")
    found = record["truth_amplitude"].sel(truth_order=20).values[:, 0]
    expected = np.array([q[1] * 4e7, q[2] * 3e7, q[0] * 4e7]) * housing
    assert_allclose(np.abs(found), np.abs(expected), rtol=1e-8)
    assert_allclose(np.angle(found / found[0]), np.angle(expected / expected[0]), atol=1e-8)
