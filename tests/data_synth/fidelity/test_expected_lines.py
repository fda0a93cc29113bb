"""Expected lines against the lines of gears that were integrated in time, at constant speed and load."""

from fractions import Fraction

import numpy as np
import pytest
from moving_pair import SEED, motion, scene, stage_of

from data_synth import load_scene, simulate
from data_synth.fidelity.expected_lines import expected_lines
from data_synth.vibration.order_projection import sum_of_lines
from data_synth.vibration.run import motion_of, prepare_gears

UNEVEN = {"imperfections": {"gears": {"runout_um": 20, "single_pitch_um": 6}}}
LONG = {"duration_s": 6.3, "speed": {"link": "pinion", "rpm": 600}}  # 63 turns of the pinion, after which all repeats
# one mode at 2 kHz, among mesh harmonics 360 Hz apart that the stiffness couples; where it jumps, what is cut off at
# half the rate falls as 1 over the number of harmonics, of which there are 27
ERRORS = {"constant": 3e-4, "trapezoid": 1e-3, "teeth": 0.03}


def amplitude(families, order):
    """Z of all families at one order and the first instant, in the first channel."""
    multiples = [(family, order / family.base_order) for family in families]
    return sum(
        family.amplitudes(np.array([int(multiple)]), np.array([0]))[0, 0, 0]
        for family, multiple in multiples
        if multiple.denominator == 1
    )


@pytest.mark.parametrize("shape", ERRORS)
def test_expected_lines_are_those_of_an_integration(shape):
    declared = scene(mesh={"shape": shape}, **LONG, **UNEVEN)
    lines = simulate(declared, seed=SEED)["truth_amplitude"].isel(truth_channel=0, truth_time=0)
    families = expected_lines(motion(declared))
    step = declared.exact_orders("gear_mesh")["mesh"] / (36 * 63)
    expected = np.array([amplitude(families, round(order / step) * step) for order in lines["truth_order"].values])
    assert lines.size > 300
    assert np.linalg.norm(expected - lines.values) < ERRORS[shape] * np.linalg.norm(lines.values)


@pytest.mark.parametrize("depth_mm", [None, 1.5])
def test_meshes_and_a_damaged_tooth_are_coupled(depth_mm):
    """Each mesh vibrates on the stiffness of both, its harmonics on that of the damaged tooth.

    The error, 0.028 and 0.032, is of lines at sums of orders of both meshes, which are left out. With the mean
    stiffness of the other mesh it is 0.08 of sound gears; with a crack whose sidebands lack the vibration, 0.07.
    """
    crack = {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": depth_mm}
    declared = load_scene("gears-in-motion").changed(
        duration_s=2.68,  # 67 turns of the input, after which the first stage and the second mesh repeat
        noise={"rms": 0},
        excitation={"shaft_amplitude": 0},
        faults=() if depth_mm is None else (crack,),
        **UNEVEN,
    )
    lines = simulate(declared, seed=SEED)["truth_amplitude"].isel(truth_channel=0, truth_time=0)
    stage = stage_of(declared)
    gears = prepare_gears(stage)
    families = expected_lines(motion_of(stage, gears, levels=dict.fromkeys(gears.meshes.values(), "lateral")))
    repeats = 67 * lines["truth_order"].values
    lines = lines[np.abs(repeats - np.round(repeats)) < 1e-6]
    expected = np.array([amplitude(families, Fraction(round(67 * order), 67)) for order in lines["truth_order"].values])
    assert lines.size > 300
    assert np.linalg.norm(expected - lines.values) < 0.04 * np.linalg.norm(lines.values)


def test_gears_that_nothing_excites_have_no_expected_lines():
    assert expected_lines(motion(scene(mesh={"shape": "constant", "error_um": 0}))) == ()


def test_planets_have_no_expected_lines():
    planets = load_scene("planets-in-motion")
    stage = stage_of(planets)
    gears = prepare_gears(stage)
    assert expected_lines(motion_of(stage, gears, levels=dict.fromkeys(gears.meshes.values(), "lateral"))) == ()


def test_lines_of_a_run_through_a_resonance_are_known_to_one_percent():
    """Halving the window changes what the projection adds, not what is expected."""
    declared = scene(
        duration_s=3.0, speed={"link": "pinion", "rpm": [[0, 500], [3, 900]]}, mesh={"shape": "trapezoid"}, **UNEVEN
    )
    record = simulate(declared, seed=SEED, phases=True)
    lines = record["truth_amplitude"].isel(truth_channel=0)
    power = np.mean(np.abs(lines.values) ** 2, axis=1)
    change = record["truth_line_change"].values
    times_s = record["time"].values
    turns = record["truth_shaft_revolutions"].sel(truth_shaft="pinion").values
    signal = sum_of_lines(
        lines["truth_order"].values,
        lines.values[None],
        instants_s=record["truth_time"].values,
        revolutions=lambda at_s: np.interp(at_s, times_s, turns),
        times_s=times_s,
    )[0]
    # 99.9 % of the power, as of the records of benchmark-1 in docs/benchmarks/truth.md
    assert np.mean((signal - record["a"].values) ** 2) < 1e-3 * np.mean(record["a"].values ** 2)
    assert np.sum(power[change < 0.01]) > 0.9 * np.sum(power)
