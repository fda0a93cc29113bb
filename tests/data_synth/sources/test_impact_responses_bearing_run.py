"""Scenes with a bearing that moves, against its equations of motion written down anew and solved by scipy."""

import tracemalloc
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from data_synth import Scene, SceneError, explain, simulate

RATE, RING_HZ, ZETA = 8000, 1800.0, 0.05
BEARING, BALLS, BALL_M, PITCH_M = "intermediate bearing", 13, 9e-3, 62e-3
FAULT = {
    "kind": "outer_race",
    "component": BEARING,
    "size_mm": 0.5,
    "slip_std": 0.01,
    "five_dof": {"load_n": 300.0, "contact_n_m": 4e9, "clearance_um": 1.0},
}
WAY_HZ, WAY_ZETA = 1200.0, 0.08
WAY = {
    "source": BEARING,
    "sensor": "b",
    "units": "m s-2",
    "modes": [{"frequency_hz": WAY_HZ, "damping_ratio": WAY_ZETA, "gain": 0.02}],
}
SCENE = {
    "gearbox": "two-stage",
    "rate_hz": RATE,
    "duration_s": 0.22,
    "fidelity": "kinematic",
    "speed": {"link": "input", "rpm": 1500},
    "torque": {"link": "output", "nm": [[0, 300], [0.22, 400]], "unloaded_share": 0.2},
    "tachometer": {"link": "input", "pulses_per_rev": 1},
    "noise": {"rms": 0},
    "resonance": {"frequency_hz": RING_HZ, "damping_ratio": ZETA},
    "excitation": {"shaft_amplitude": 0, "mesh_amplitude": 0},
    "transfer": [WAY],
    "sensor": [{"name": name, "on": "input bearing", "units": "m s-2", "anti_alias": "none"} for name in ("a", "b")],
}


def made(fault, *, seed=3, **changes):
    return simulate(Scene.from_mapping(SCENE | {"fault": [FAULT | fault]} | changes), seed=seed, phases=True)


def solved(record, kind, size_m):
    """Resonator's acceleration, and the force on the pedestal four times as densely, from rest at time zero."""
    depth, ball = size_m**2 / (4 * BALL_M), BALL_M / 2
    width = size_m / {"outer_race": (PITCH_M + BALL_M) / 2, "inner_race": (PITCH_M - BALL_M) / 2}.get(kind, ball)
    times = record["time"].values
    rollers = record["truth_roller_revolutions"]
    cage, strike = (rollers.sel(truth_roller=f"{BEARING}/{name}").values for name in ("cage", f"{kind} strike"))
    k_r = 0.5 * (2 * np.pi * RING_HZ) ** 2
    c_r = 2 * ZETA * 0.5 * 2 * np.pi * RING_HZ
    numbers = np.arange(BALLS)

    def forces(t, y):
        at, struck = np.interp(t, times, cage), np.interp(t, times, strike)
        # angles from straight down, where the load is greatest
        psi = 2 * np.pi * (at + numbers / BALLS)
        if kind == "rolling_element":  # ball 0, twice in its turn
            off = np.where(numbers == 0, np.pi * (struck - np.round(struck)), 9.0)
        else:  # the ball that is nearest to the spot is a part of a ball pitch from it
            # the inner ring goes on by a ball pitch less the cage from strike to strike, backwards
            spot = {"outer_race": 0.0, "inner_race": at - struck / BALLS}[kind]
            off = np.angle(np.exp(1j * (psi - 2 * np.pi * spot)))
        hollow = np.where(np.abs(off) < width / 2, depth * np.cos(np.pi * off / width), 0.0)
        # down is -y, across is x
        nx, ny = np.sin(psi), -np.cos(psi)
        pressed = (y[0] - y[2]) * nx + (y[1] - y[3]) * ny - 1e-6 - hollow
        force = 4e9 * np.maximum(pressed, 0) ** 1.5
        return np.array([force @ nx, force @ ny])

    def slope(t, y):
        push = forces(t, y)
        load = 300 * (0.2 + 0.8 * (300 + 100 * t / 0.22) / 400)
        ring = k_r * (y[3] - y[4]) + c_r * (y[8] - y[9])
        shaft = (np.array([0, -load]) - push - 800 * y[5:7] - 1e5 * y[:2]) / 3
        pedestal = (push - 2500 * y[7:9] - 1.5e7 * y[2:4] - [0, ring]) / 7
        return np.concatenate([y[5:], shaft, pedestal, [ring / 0.5]])

    grid = np.arange(4 * times.size) / (4 * RATE)
    y = solve_ivp(slope, (0, grid[-1]), np.zeros(10), t_eval=grid, rtol=1e-6, atol=1e-12, max_step=1e-4).y
    ring = (k_r * (y[3] - y[4]) + c_r * (y[8] - y[9])) / 0.5
    return ring[::4], np.array([forces(t, state)[1] for t, state in zip(grid, y.T, strict=True)]), grid


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["outer_race", "inner_race", "rolling_element"])
def test_a_scene_s_bearing_moves_by_its_equations(kind):
    size_mm = 0.5 if kind != "rolling_element" else 0.3
    record = made({"kind": kind, "size_mm": size_mm}, duration_s=0.15)
    acceleration, force, grid = solved(record, kind, 1e-3 * size_mm)
    # the start from rest, gone by then to exp(-133 / s x 0.07 s) = 1e-4
    after = slice(round(0.07 * RATE), None)
    largest = np.max(np.abs(acceleration[after]))
    # what is between two samples of the truth's phases, and how densely the record is stepped
    assert_allclose(record["a"].values[after], acceleration[after], atol=2e-3 * largest)
    # a way of its own passes the force on the pedestal
    natural = 2 * np.pi * WAY_HZ
    system = ([0.02 * natural**2], [1, 2 * WAY_ZETA * natural, natural**2])
    expected = lsim(system, force, grid)[1][::4][after]
    # the oracle's force is linear between its points
    assert_allclose(record["b"].values[after], expected, atol=5e-3 * np.max(np.abs(expected)))


@cache
def heard(kind, size_mm, **_):
    return made({"kind": kind, "size_mm": size_mm})


def test_a_spall_is_heard_more_the_larger_it_is_until_an_element_is_let_off():
    for kind in ("outer_race", "inner_race", "rolling_element"):
        sizes = [np.std(heard(kind, size_mm)["a"].values) for size_mm in (0.1, 0.2, 0.4)]
        assert sizes[0] < sizes[1] < sizes[2]


def test_a_spall_that_grows_begins_as_the_small_and_ends_as_the_large():
    growth = {"law": "linear", "rate_mm_per_s": 0.7, "largest_mm": 0.3}
    small, large = heard("outer_race", 0.2)["a"].values, heard("outer_race", 0.3)["a"].values
    grown = made({"size_mm": 0.2, "growth": growth})["a"].values
    begin, end = slice(0, round(0.02 * RATE)), slice(round(0.18 * RATE), None)
    # it has grown by 7 % in that time, and amplitudes with its square
    assert_allclose(np.std(grown[begin]), np.std(small[begin]), rtol=0.2)
    assert_allclose(grown[end], large[end], atol=0.02 * np.max(np.abs(large)))


def test_impacts_are_those_of_the_scene_without_it():
    # who moves does not change when it is struck
    plain = simulate(Scene.from_mapping(SCENE | {"fault": [FAULT | {"five_dof": None}]}), seed=3)
    assert np.array_equal(heard("outer_race", 0.5)["truth_impact_times_1"], plain["truth_impact_times_1"])


def test_its_acceleration_is_one_of_the_sources_and_passes_the_chain():
    chained = [SCENE["sensor"][0] | {"units": "g", "sensitivity": {"value": 0.1, "units": "V"}}]
    record = simulate(
        Scene.from_mapping(SCENE | {"fault": [FAULT], "sensor": chained, "transfer": []}), seed=3, by_source=True
    )
    source = record["truth_source"].sel(truth_source_name=f"{BEARING}, outer_race").values[0]
    assert_allclose(source, record["a"].values, atol=1e-15)
    assert_allclose(record["a"].values, 0.1 / 9.80665 * heard("outer_race", 0.5)["a"].values, atol=1e-12)


def test_a_filter_of_the_sensor_filters_it():
    natural = 2 * np.pi * 700.0
    low = [SCENE["sensor"][0] | {"anti_alias": {"frequency_hz": 700.0, "order": 1}}]
    record = made({}, sensor=low, transfer=[])
    plain = heard("outer_race", 0.5)["a"].values
    spectrum, filtered = np.fft.rfft(np.hanning(plain.size) * plain), np.fft.rfft(np.hanning(plain.size) * record["a"])
    frequency = np.fft.rfftfreq(plain.size, 1 / RATE)
    mid = (frequency > 100) & (frequency < 3000)
    expected = spectrum[mid] / (1 + 2j * np.pi * frequency[mid] / natural)
    # the window passes the filter with its edges: a few parts in a thousand of the largest line
    assert_allclose(filtered[mid], expected, atol=5e-3 * np.max(np.abs(expected)))


def test_it_is_heard_alike_beside_gears_that_vibrate():
    vibrating = SCENE | {
        "fidelity": "torsional",
        "transfer": [],
        "dynamics": {
            "meshes": {
                "stage 1": {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20, "shape": "constant"},
                "stage 2": {"module_mm": 4, "face_width_mm": 40, "pressure_angle_deg": 20, "shape": "constant"},
            }
        },
        "sensor": [SCENE["sensor"][0] | {"direction": [0, 0, 1]}],
    }
    sound, faulty = (
        simulate(Scene.from_mapping(vibrating | {"fault": faults}), seed=3)["a"].values for faults in ([], [FAULT])
    )
    largest = np.max(np.abs(sound))
    assert_allclose(faulty - sound, heard("outer_race", 0.5)["a"].values, atol=1e-9 * largest)


@pytest.mark.slow
def test_what_is_in_memory_beside_the_channels_does_not_grow_with_the_record():
    measured = {
        "source": "intermediate",
        "sensor": "a",
        "units": "g",
        "lines": [[f, 0.01, 0] for f in range(0, 3000, 9)],
    }
    impacts = FAULT | {"kind": "inner_race", "component": "input bearing", "five_dof": None, "pulse_share": 0.2}
    quiet = measured | {"source": "input bearing", "lines": [[0, 0, 0], *measured["lines"][1:], [3100, 0, 0]]}
    table = SCENE | {"fault": [FAULT, impacts], "torque": None, "transfer": [WAY, measured, quiet], "rate_hz": 20_000}
    beside = []
    for duration_s in (6.0, 12.0):
        scene = Scene.from_mapping(table | {"duration_s": duration_s})
        tracemalloc.start()
        simulate(scene, seed=1)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        beside.append(peak - 2 * 8 * scene.samples)
    # one more array as long as a channel would be 1 MB, and one of the steps of the bearing 4 MB
    assert beside[1] - beside[0] < 5e5


def test_what_will_be_built_is_told():
    told = explain(Scene.from_mapping(SCENE | {"fault": [FAULT]}))
    (part,) = (part for part in told.parts if part.what.startswith("5 degrees of freedom"))
    assert "five_dof, its resonator rings 1800 Hz" in part.why
    assert part.seconds > 0
    assert "way of its own to b" in str(told)


def test_stiffer_contacts_take_shorter_steps():
    stiff = FAULT["five_dof"] | {"contact_n_m": 4e13}
    soft_steps, stiff_steps = (
        next(
            part.what
            for part in explain(Scene.from_mapping(SCENE | {"fault": [FAULT | {"five_dof": of}]})).parts
            if "5 degrees" in part.what
        )
        for of in (FAULT["five_dof"], stiff)
    )
    steps = [int(what.split(", ")[1].split()[0]) for what in (soft_steps, stiff_steps)]
    assert steps[1] > 3 * steps[0]


@pytest.mark.parametrize(
    ("fault", "changes", "sentence"),
    [
        ({"size_mm": 20.0}, {}, "outer_race of .* 20 mm reach from one contact to the next"),
        ({}, {"sampling_jitter": {"std_s": 1e-7}}, "sampling_jitter does not go with a bearing with five_dof"),
        ({"five_dof": {"load_n": -1}}, {}, "load_n"),
    ],
)
def test_bearings_that_cannot_move_are_refused(fault, changes, sentence):
    with pytest.raises(SceneError, match=sentence):
        made(fault, **changes)
