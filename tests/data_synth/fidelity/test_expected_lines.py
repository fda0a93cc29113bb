"""Expected lines against the lines of gears that were integrated in time, at constant speed and load."""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from moving_pair import SEED, motion, scene, stage_of
from truth import explained, rebuilt

from data_synth import load_scene, simulate
from data_synth.fidelity.expected_lines import _balanced, _Modes, _Varying, expected_lines
from data_synth.vibration.gear_lines import gear_lines
from data_synth.vibration.order_projection import AngleSamples, Projection, Window, sum_of_lines
from data_synth.vibration.run import motion_of, prepare_gears

UNEVEN = {"imperfections": {"gears": {"runout_um": 20, "single_pitch_um": 6}}}
LONG = {"duration_s": 6.3, "speed": {"link": "pinion", "rpm": 600}}  # 63 turns of the pinion, after which all repeats
# one mode at 2 kHz, among mesh harmonics 360 Hz apart that the stiffness couples; there are 27, whether it jumps or not
ERRORS = {"constant": 3e-4, "trapezoid": 2e-4, "teeth": 3e-3}


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

    The error, 0.018, is of lines at sums of orders of an uneven gear and the mesh on other shafts, which are left out.
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
    assert np.linalg.norm(expected - lines.values) < 0.025 * np.linalg.norm(lines.values)


def test_lines_above_the_band_at_the_highest_speed_have_their_truth_at_lower_ones():
    """Harmonics 21 and 22 of the mesh are in the band at 600 rpm, not at 900; they are 60 dB below the loudest."""
    rising = {"link": "pinion", "rpm": [[0, 600], [3, 600], [3.3, 900], [6.3, 900]]}
    declared = scene(duration_s=6.3, speed=rising, mesh={"shape": "teeth"})
    at_first = simulate(scene(mesh={"shape": "teeth"}, **LONG), seed=SEED)["truth_amplitude"].isel(truth_channel=0)
    lines = simulate(declared, seed=SEED)["truth_amplitude"].isel(truth_channel=0)
    orders = [36.0 * 21, 36.0 * 22]
    assert min(orders) * 15 > declared.rate_hz / 2 > max(orders) * 10
    own, expected = (
        each.sel(truth_order=orders, method="nearest", tolerance=1e-6).isel(truth_time=0).values
        for each in (lines, at_first)
    )
    assert np.linalg.norm(own - expected) < 0.1 * np.linalg.norm(expected)


def test_gears_that_nothing_excites_have_no_expected_lines():
    assert expected_lines(motion(scene(mesh={"shape": "constant", "error_um": 0}))) == ()


def test_planets_have_no_expected_lines():
    planets = load_scene("planets-in-motion")
    stage = stage_of(planets)
    gears = prepare_gears(stage)
    assert expected_lines(motion_of(stage, gears, levels=dict.fromkeys(gears.meshes.values(), "lateral"))) == ()


@pytest.mark.parametrize("rpm", [[[0, 500], [3, 900]], [[0, 500], [3, 900], [6, 500]]], ids=["up", "up and down"])
def test_expected_lines_are_the_signal_of_a_run_through_a_resonance(rpm):
    declared = scene(duration_s=rpm[-1][0], speed={"link": "pinion", "rpm": rpm}, mesh={"shape": "trapezoid"}, **UNEVEN)
    record = simulate(declared, seed=SEED, phases=True)
    lines = record["truth_amplitude"].isel(truth_channel=0)
    times_s = record["time"].values
    turns = record["truth_shaft_revolutions"].sel(truth_shaft="pinion").values
    signal = sum_of_lines(
        lines["truth_order"].values,
        lines.values[None],
        instants_s=record["truth_time"].values,
        revolutions=lambda at_s: np.interp(at_s, times_s, turns),
        times_s=times_s,
    )[0]
    # 8e-6; 4e-5 without what the lines lag behind the speed
    assert np.mean((signal - record["a"].values) ** 2) < 2e-5 * np.mean(record["a"].values ** 2)
    assert "truth_line_change" not in record  # no line has a window


def test_lines_differ_on_the_way_up_and_down_through_a_resonance_by_what_lags_behind_the_speed():
    """The signal's own lines, whose windows know nothing of what is expected, are and differ as much.

    To an eighth of what they differ by: a mesh's line that lags makes others lag by more or less than their own order.
    """
    declared = scene(duration_s=6.0, speed={"link": "pinion", "rpm": [[0, 500], [3, 900], [6, 500]]})
    moving = motion(declared)
    signal, angle = np.concatenate([*moving.channels(samples=declared.samples)], axis=1), moving.stage.drive.angle
    stated = gear_lines(stage_of(declared), signal, expected=partial(expected_lines, moving)).lines
    truth = np.stack([line.amplitude[0] for line in stated])
    sizes = np.max(np.abs(truth), axis=1)
    loud = truth[sizes > 0.01 * sizes.max()]
    assert np.max(np.max(np.abs(loud), axis=1) / np.min(np.abs(loud), axis=1)) > 10  # some line passes a resonance
    samples = AngleSamples(
        signal=signal,
        rate_hz=declared.rate_hz,
        revolutions=angle.revolutions,
        speed_hz=angle.speed_hz,
        top_order=declared.rate_hz / 2 / angle.top_speed_hz(0.0, 6.0),
    )
    orders = np.array([float(line.order) for line in stated])[sizes > 0.01 * sizes.max()]
    projection = Projection(samples=samples, orders=orders, window=Window(length_rev=0.5, degree=2))
    instants_s = moving.stage.instants_s
    assert np.allclose(instants_s, 6 - instants_s[::-1])
    inner = np.abs(instants_s % 3 - 1.5) < 1.3  # beside the ends and the corner, over which windows reach
    found = projection.amplitudes(angle.revolutions(instants_s))[0]
    assert np.linalg.norm((found - loud)[:, inner]) < 0.001 * np.linalg.norm(loud[:, inner])
    lag, own = ((each - each[:, ::-1])[:, inner] for each in (loud, found))
    assert np.linalg.norm(lag) > 0.005 * np.linalg.norm(loud)
    assert np.linalg.norm(lag - own) < 0.15 * np.linalg.norm(own)


STEP_HZ, SPEED_HZ = 0.5, 5.0


def balance_of_one_mode(lines, *, varying, damping):
    """Exciting force of two lines on one mode at 200 Hz, static gain -1, at base order 1; p, and its dense solution."""
    pole = 2 * np.pi * 200 * (-damping + 1j * np.sqrt(1 - damping**2))
    residue = -(abs(pole) ** 2) / (2j * pole.imag)  # of -w^2 / (s^2 + 2 damping w s + w^2)
    s = 2j * np.pi * STEP_HZ * np.arange(4096)
    gains = residue / (s - pole) - residue / (s - pole.conjugate())
    spectrum = np.zeros(lines, dtype=np.complex64)
    spectrum[[4, 9]] = 1 + 1j, -2
    points = 3 * lines + 3
    coefficients = np.zeros(points // 2 + 1, dtype=np.complex64)
    coefficients[1 : varying.size + 1] = varying * points / 2
    waves = np.fft.irfft(coefficients, points)[None].astype(np.float32)
    found = _balanced(
        spectrum[None, None],
        np.zeros((1, 1, lines), dtype=np.complex64),
        SPEED_HZ,
        gains=gains[None, None],
        varying_of=lambda _base, count: _Varying(waves=waves, lines=coefficients[None, 1 : count + 1]),
        modes=_Modes(
            poles=np.array([pole]), deflections=np.array([[2 * residue]]), inputs=np.ones((1, 1), dtype=complex)
        ),
        base=Fraction(1),
        step_hz=STEP_HZ,
        bound=1e-5,
    )[0, 0]
    # coefficients of exp(j n theta), n from -lines to lines, none at zero
    n = np.r_[-lines:0, 1 : lines + 1]
    two_sided = np.zeros(4 * lines + 1, dtype=complex)
    two_sided[2 * lines + 1 : 2 * lines + 1 + varying.size] = varying / 2
    two_sided += two_sided[::-1].conj()
    v = two_sided[np.subtract.outer(n, n) + 2 * lines]
    v = v - np.outer(two_sided[n + 2 * lines], two_sided[2 * lines - n])  # the mean force stays
    one_sided = gains[(np.arange(1, lines + 1) * SPEED_HZ / STEP_HZ).astype(int)]
    gain = np.concatenate([one_sided[::-1].conj(), one_sided])
    right = np.concatenate([spectrum[::-1].conj(), spectrum]) / 2
    return found, 2 * np.linalg.solve(np.eye(2 * lines) - v * gain, right)[lines:]


@pytest.mark.parametrize("damping", [0.01, 0.05, 0.5])
def test_sweeps_find_the_dense_solution(damping):
    """Of lines up to three times the frequency of the mode, which the stiffness couples."""
    found, dense = balance_of_one_mode(120, varying=np.array([0.1j, 0, 0.05, 0, 0.15]), damping=damping)
    assert np.linalg.norm(found - dense) < 1e-4 * np.linalg.norm(dense)
    assert np.linalg.norm(dense) > 1.05 * np.sqrt(6)  # the stiffness makes lines of its own


@pytest.mark.parametrize("share", [0.4, 0.6])  # squares of the first leave the range of numbers, then all
def test_a_stiffness_that_excites_vibration_which_grows_has_lines_within_the_range_of_numbers(share):
    """At twice the mode's frequency, 80 orders, with 1 % of damping: no motion is periodic."""
    varying = np.zeros(80, dtype=complex)
    varying[-1] = share
    found, _ = balance_of_one_mode(120, varying=varying, damping=0.01)
    assert np.isfinite(found).all()


@pytest.mark.parametrize(
    ("rpm", "record", "fault"),
    [
        ([[0, 60], [4, 180]], 99.9, 99.5),  # 100.00, 99.91: slow all along
        ([[0, 15], [1, 400]], 99, 90),  # 99.45, 94.25: a start, the fault 34 dB below the record
        ([[0, 500], [0.5, 500], [0.51, 600], [1, 600]], 95, 98),  # 96.34, 99.45: what rings after the step is no line
    ],
    ids=["slow", "start", "step"],
)
def test_expected_lines_have_the_fault_where_speed_is_low_or_changes_fast(rpm, record, fault):
    crack = {"kind": "tooth_crack", "component": "mesh/pinion", "depth_mm": 1.0}
    declared = scene(
        duration_s=rpm[-1][0],
        speed={"link": "pinion", "rpm": rpm},
        tachometer={"link": "pinion", "pulses_per_rev": 60},
        mesh={"shape": "teeth"},
        dynamics={"error": 1e-4},
        faults=(crack,),
    )
    damaged, sound = (simulate(each, seed=SEED, phases=True) for each in (declared, declared.changed(faults=())))
    signal, lines = damaged["a"].to_numpy(), rebuilt(damaged)
    assert explained(lines, signal) > record
    assert explained(lines - rebuilt(sound), signal - sound["a"].to_numpy()) > fault
