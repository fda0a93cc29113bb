"""Kinematic factors fitted to gears in motion, at loads, sizes and speeds at which they were not fitted."""

from functools import cache
from typing import get_args

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.kinematic_fit import DamageRuns, fit_factors
from data_synth.scene.faults import GEAR_FAULTS
from data_synth.simulation import noise_free

TEETH = (23, 40)
SCENE = {
    "gearbox": {
        "name": "pair",
        "frame": "housing",
        "reference": "pinion",
        "axes": {"in": ["housing", "pinion"], "out": ["housing", "wheel"]},
        "mesh": [{"name": "mesh", "teeth": {"pinion": TEETH[0], "wheel": TEETH[1]}}],
    },
    "rate_hz": 20_000,
    "tachometer": {"link": "pinion", "pulses_per_rev": 12},
    "resonance": {"frequency_hz": 2500, "damping_ratio": 0.05},
    "noise": {"rms": 0},
    "dynamics": {
        "mounts": {"frequency_hz": 150, "damping_ratio": 0.5},
        "damping_ratio": 0.06,
        "error": 0.02,
        "meshes": {"mesh": {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20}},
    },
    "sensor": [{"name": "a", "on": "pinion", "direction": [0, 0, 1], "units": "g", "anti_alias": "none"}],
}
TURNS, SEED = 3, 1
# sizes that are fitted, at 200 N m and 1200 rpm; and four scenes: N m, rpm, mm
CASES = {
    "tooth_crack": ((1, 3), ((80, 1200, 1.5), (300, 900, 2.5), (120, 1400, 2.5))),
    "spall": ((0.003, 0.02), ((80, 1200, 0.004), (300, 900, 1.0), (120, 1400, 1.0))),
    "chipping": ((3, 12), ((80, 1200, 4.0), (300, 900, 10.0), (120, 1400, 10.0))),
    "missing_tooth": ((6, 7), ((80, 1200, 6.5), (300, 900, 8.0), (120, 1400, 8.0))),
    "pitting": ((0.003, 0.02), ((80, 1200, 0.004), (300, 900, 1.0), (120, 1400, 1.0))),
    "eccentricity": ((0.02, 0.1), ((80, 1200, 0.05), (300, 900, 0.15), (120, 1400, 0.15))),
    "misalignment": ((3, 12), ((80, 1200, 4.0), (300, 900, 10.0), (120, 1400, 10.0))),
    "wear": ((0.002, 0.004, 0.008), ((120, 1200, 0.003), (300, 900, 0.006), (150, 1400, 0.006))),
}
QUICK = ("tooth_crack", "spall")
AT_ALL_SPEEDS = "spall"  # of a fit; the others, which differ in their damage alone, are fitted at three
# a resonance of the pair: 1600 rpm, where 23 teeth meet at 613 Hz
RESONANCE = {
    "tooth_crack": (150, 1600, 1.5),
    "spall": (150, 1600, 0.004),
    "chipping": (150, 1600, 5.0),
    "missing_tooth": (150, 1600, 6.5),
    "pitting": (150, 1600, 0.004),
    "eccentricity": (150, 1600, 0.05),
    "misalignment": (150, 1600, 8.0),
    "wear": (150, 1600, 0.006),
}


# another pair: coarser, wider, of more teeth and a greater pressure angle; fitted at 600 N m and 900 rpm
OTHER_TEETH = (31, 52)
OTHER_SCENE = {
    **SCENE,
    "gearbox": {
        **SCENE["gearbox"],
        "mesh": [{"name": "mesh", "teeth": {"pinion": OTHER_TEETH[0], "wheel": OTHER_TEETH[1]}}],
    },
    "dynamics": {
        **SCENE["dynamics"],
        "meshes": {"mesh": {"module_mm": 5, "face_width_mm": 40, "pressure_angle_deg": 25}},
    },
}
# a natural frequency of it is 356 Hz, and at 700 rpm 31 teeth meet at 362 Hz: the last of each is near a resonance
OTHER_CASES = {
    "tooth_crack": ((1.5, 5), ((240, 900, 2.5), (360, 1000, 4.0), (900, 700, 4.0))),
    "spall": ((0.004, 0.03), ((240, 900, 0.006), (360, 1000, 1.0), (900, 700, 1.0))),
}


def scene(torque_nm, rpm, *faults, fidelity="lateral", of=SCENE):
    return Scene.from_mapping(
        {
            **of,
            "fidelity": fidelity,
            "torque": {"link": "wheel", "nm": torque_nm},
            "speed": {"link": "pinion", "rpm": rpm},
            "duration_s": TURNS * 60 / rpm,
            "fault": [*faults],
        }
    )


def fault(kind, size_mm):
    size = {"depth_mm" if kind == "tooth_crack" else "size_mm": size_mm}
    return {"kind": kind, "component": "mesh/pinion", **size}


@cache
def healthy_channel(torque_nm, rpm, fidelity, teeth):
    """The same for all faults of a pair of gears."""
    of = {TEETH: SCENE, OTHER_TEETH: OTHER_SCENE}[teeth]
    return channel(scene(torque_nm, rpm, fidelity=fidelity, of=of))


def channel(made):
    """Return the channel, of gears in motion without the truth that a record has beside it."""
    if made.fidelity == "kinematic":
        return simulate(made, seed=SEED)["a"].values
    return noise_free(made, seed=SEED).signal[0]


def fit_at(monkeypatch, speeds, *args, **keys):
    """Return a fit at these shares of the scene's speed instead of eight."""
    monkeypatch.setattr("data_synth.kinematic_fit._SPEEDS", speeds)
    return fit_factors(*args, **keys, seed=SEED)


def residual_peak(torque_nm, rpm, table, *, fidelity, of):
    """Peak of the synchronous average over turns of the pinion, faulty minus healthy."""
    faulty = channel(scene(torque_nm, rpm, table, fidelity=fidelity, of=of))
    healthy = healthy_channel(torque_nm, rpm, fidelity, tuple(of["gearbox"]["mesh"][0]["teeth"].values()))
    turn = SCENE["rate_hz"] * 60 / rpm
    at = np.arange(int(turn))
    # straight lines between samples would take up to 2 dB from lines of 5 kHz
    added = CubicSpline(np.arange(faulty.size), faulty - healthy)
    return np.max(np.abs(np.mean([added(at + number * turn) for number in range(1, TURNS)], axis=0)))


def apart_db(fit, torque_nm, rpm, size_mm, *, of=SCENE):
    table = fit.table(size_mm=size_mm, torque_nm=torque_nm, rpm=rpm)
    moving = residual_peak(torque_nm, rpm, fault(fit.kind, size_mm), fidelity="lateral", of=of)
    struck = residual_peak(torque_nm, rpm, table, fidelity="kinematic", of=of)
    return 20 * np.log10(struck / moving)


def test_every_kind_of_gear_fault_is_fitted():
    kinds = [get_args(model.model_fields["kind"].annotation) for model in get_args(GEAR_FAULTS)]
    assert set(CASES) == set(RESONANCE) == {kind for (kind,) in kinds}


@pytest.mark.parametrize(
    "kind", [kind if kind in QUICK else pytest.param(kind, marks=pytest.mark.slow) for kind in CASES]
)
def test_kinematic_peaks_are_those_of_motion_where_they_were_not_fitted(kind, monkeypatch):
    sizes_mm, cases = CASES[kind]
    fitted = scene(200, 1200, fault(kind, 1.0))
    if kind == AT_ALL_SPEEDS:
        fit = fit_factors(fitted, sizes_mm=sizes_mm, seed=SEED)
    else:
        fit = fit_at(monkeypatch, (0.7, 1.0, 1.3), fitted, sizes_mm=sizes_mm)
    found = [apart_db(fit, *case) for case in cases]
    assert np.max(np.abs(found)) < 3, found
    assert abs(apart_db(fit, *RESONANCE[kind])) < 6
    # static deflection is linear in the load; the drop into a spall is its own depth
    if kind == "tooth_crack":
        assert fit.load_exponent == pytest.approx(1, abs=0.05)
        assert fit.size_exponent > 1.3  # a cantilever: compliance rises faster than the crack
    if kind == "spall":
        assert fit.load_exponent == pytest.approx(0, abs=0.15)
        assert fit.largest_effect_mm == pytest.approx(0.015, rel=0.1)  # L^2 / (8 rho), by hand


@pytest.mark.slow
@pytest.mark.parametrize("kind", OTHER_CASES)
def test_another_pair_of_gears_is_fitted_as_well(kind, monkeypatch):
    sizes_mm, (*cases, resonance) = OTHER_CASES[kind]
    fitted = scene(600, 900, fault(kind, 1.0), of=OTHER_SCENE)
    fit = fit_at(monkeypatch, (0.7, 1.0, 1.3), fitted, sizes_mm=sizes_mm)
    found = [apart_db(fit, *case, of=OTHER_SCENE) for case in cases]
    assert np.max(np.abs(found)) < 3, found
    assert abs(apart_db(fit, *resonance, of=OTHER_SCENE)) < 6


@pytest.mark.slow
def test_a_damaged_sun_among_planets_is_fitted(monkeypatch):
    # it meets planets in turn, which pass the sensor; two speeds tell its power of the speed
    shipped = load_scene("planets-in-motion")
    planets = shipped.changed(
        faults=({**fault("spall", 1.0), "component": "sun-planet/sun"},),
        dynamics=shipped.dynamics.changed(error=0.02),  # as the scenes above: half the time
    )
    fit = fit_at(monkeypatch, (0.7, 1.2), planets, sizes_mm=(0.005, 0.02))
    runs = DamageRuns(planets, planets.faults[0], seed=SEED)
    table = fit.table(size_mm=0.01, torque_nm=0.7 * fit.torque_nm, rpm=0.85 * fit.rpm)
    peaks = [
        runs.peak(fidelity, each, load=0.7, speed=0.85)
        for fidelity, each in (("kinematic", table), ("lateral", runs.of_size(0.01)))
    ]
    assert abs(20 * np.log10(peaks[0] / peaks[1])) < 3


def test_a_crack_and_a_chipped_face_of_one_size_are_not_the_same():
    one, other = (
        simulate(scene(200, 1200, fault(kind, 1.0), fidelity="kinematic"), seed=SEED)["a"].values
        for kind in ("tooth_crack", "chipping")
    )
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(
    ("faults", "sizes", "words"),
    [
        ((), (1, 2), "0 faults"),
        (({**fault("imbalance", 0.1), "component": "pinion"},), (1, 2), "a fit needs one fault of a gear"),
        ((fault("spall", 0.1),), (1, 1), "two different sizes"),
    ],
)
def test_what_cannot_be_fitted_is_refused(faults, sizes, words):
    with pytest.raises(SceneError, match=words):
        fit_factors(scene(200, 1200, *faults), sizes_mm=sizes)
