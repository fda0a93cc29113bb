import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from data_synth.bearings.five_dof import BearingModel, Spall, Support, integrate_bearing

# 12 balls of 7.12 mm on 38.5 mm, inner ring turning: published per turn of the shaft
BPFO, FTF, BALLS = 4.890390, 0.407532, 12
MODEL = BearingModel(
    elements=BALLS,
    contact_n_m=8e9,
    clearance_m=2e-6,
    shaft=Support(mass_kg=3.0, damping_n_s_m=800.0, stiffness_n_m=1e5),
    pedestal=Support(mass_kg=7.0, damping_n_s_m=2500.0, stiffness_n_m=1.5e7),
    resonator=Support.resonant(mass_kg=0.5, frequency_hz=6000.0, damping_ratio=0.04),
)
LOAD = (0.0, -400.0)


def moved(model=MODEL, *, seconds=0.05, step_s=1e-5, speed_hz=30.0, state=None, begin=0, load=LOAD, ring=1.0):
    half = (begin + np.arange(2 * round(seconds / step_s) + 1)) * step_s / 2
    return integrate_bearing(
        model,
        cage_turns=FTF * speed_hz * half,
        defect_turns=ring * speed_hz * half,
        load_n=load,
        step_s=step_s,
        state=state,
    )


def test_the_motion_is_that_of_the_equations():
    # the equations once more, in vectors, by another method and a hundred times more closely
    spalled = replace(MODEL, spall=Spall(of="ring", middle_rad=4.5, width_rad=0.15, depth_m=2e-6))
    found = moved(spalled, seconds=0.01, step_s=2e-6)  # a ball passes the hollow every 6.8 ms

    def slope(time, y):
        x, v = y[:5], y[5:]
        phi = 2 * np.pi * (FTF * 30 * time + np.arange(BALLS) / BALLS)
        off = np.angle(np.exp(1j * (phi - 4.5 - 2 * np.pi * 30 * time)))
        hollow = np.where(np.abs(off) < 0.075, 2e-6 * np.cos(np.pi * off / 0.15), 0)
        delta = (x[0] - x[2]) * np.cos(phi) + (x[1] - x[3]) * np.sin(phi) - 2e-6 - hollow
        force = 8e9 * np.maximum(delta, 0) ** 1.5
        push = np.array([force @ np.cos(phi), force @ np.sin(phi)])
        k_r, c_r = 0.5 * (2 * np.pi * 6000) ** 2, 2 * 0.04 * 0.5 * 2 * np.pi * 6000
        ring = k_r * (x[3] - x[4]) + c_r * (v[3] - v[4])
        shaft = (np.array(LOAD) - push - 800 * v[:2] - 1e5 * x[:2]) / 3
        pedestal = (push - 2500 * v[2:4] - 1.5e7 * x[2:4] - [0, ring]) / 7
        return np.concatenate([v, shaft, pedestal, [ring / 0.5]])

    times = np.linspace(0, 0.01, 101)
    exact = solve_ivp(slope, (0, 0.01), np.zeros(10), t_eval=times, rtol=1e-9, atol=1e-14, max_step=5e-6).y.T
    largest = np.max(np.abs(exact[:, :5]), axis=0)
    assert_allclose(found.displacement_m[::50] / largest, exact[:, :5] / largest, atol=2e-5)
    # contacts open and close, and hollows begin: kinks that cost the method its order, hence 2e-5. Newton's third law:
    push = 3 * found.acceleration_m_s2[:, 0] + 800 * found.velocity_m_s[:, 0] + 1e5 * found.displacement_m[:, 0]
    angles = 2 * np.pi * (FTF * 30 * np.arange(5001)[:, None] * 2e-6 + np.arange(BALLS) / BALLS)
    assert_allclose(-push, np.sum(found.contact_n * np.cos(angles), axis=1), atol=1e-9)


def test_the_method_is_of_order_four_while_contacts_stay_closed():
    # under preload no contact opens, so the equations are smooth
    tight = replace(MODEL, clearance_m=-2e-5)
    ends = [moved(tight, seconds=0.004, step_s=step).state for step in (1e-5, 5e-6, 2.5e-6)]
    errors = np.linalg.norm((ends[0] - ends[1])[:5]), np.linalg.norm((ends[1] - ends[2])[:5])
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)


def test_at_rest_the_load_is_shared_as_hertz_says():
    # one ball right below, nothing turning: sum k (d cos psi - c) ** 1.5 cos psi = W less what the shaft's spring takes
    half = 2 * round(2.0 / 2e-5) + 1
    found = integrate_bearing(
        MODEL, cage_turns=np.full(half, 0.75), defect_turns=np.zeros(half), load_n=LOAD, step_s=2e-5
    )
    psi = 2 * np.pi * np.arange(BALLS) / BALLS

    def carried(deflection):
        return np.sum(8e9 * np.maximum(deflection * np.cos(psi) - 2e-6, 0) ** 1.5 * np.cos(psi))

    # the pedestal sinks by the force over its spring; the shaft's own spring takes its share
    def missing(deflection):
        force = carried(deflection)
        return 400 - 1e5 * (deflection + force / 1.5e7) - force

    deflection = brentq(missing, 0, 1e-3, xtol=1e-16)
    y = found.displacement_m[-1]
    assert y[3] - y[1] == pytest.approx(deflection, rel=1e-9)
    assert y[4] == pytest.approx(y[3], rel=1e-9)
    assert_allclose(found.contact_n[-1], 8e9 * np.maximum(deflection * np.cos(psi) - 2e-6, 0) ** 1.5, atol=1e-6)


def test_without_clearance_the_largest_load_is_stribeck_s():
    # published: Q_max = 4.37 W / Z for balls without clearance
    many = replace(
        MODEL,
        elements=48,
        clearance_m=0.0,
        shaft=Support(mass_kg=3.0, damping_n_s_m=800.0, stiffness_n_m=0.0),
    )
    half = 2 * round(1.0 / 2e-5) + 1
    found = integrate_bearing(
        many, cage_turns=np.full(half, 0.75), defect_turns=np.zeros(half), load_n=LOAD, step_s=2e-5
    )
    assert np.max(found.contact_n[-1]) * 48 / 400 == pytest.approx(4.37, abs=0.005)


def spectrum(signal, step_s):
    tapered = np.hanning(signal.size) * (signal - signal.mean())
    return np.fft.rfftfreq(signal.size, step_s), np.abs(np.fft.rfft(tapered)) * 4 / signal.size


def test_a_spall_of_the_outer_race_is_heard_in_the_resonator_at_its_rate():
    step, speed = 1e-5, 30.0
    spalled = replace(MODEL, spall=Spall(of="ring", middle_rad=-np.pi / 2, width_rad=0.1, depth_m=3e-6))
    sound, faulty = (
        moved(model, seconds=1.2, step_s=step, speed_hz=speed, ring=0.0).acceleration_m_s2[20_000:, 4]
        for model in (MODEL, spalled)
    )
    assert np.std(faulty) > 3 * np.std(sound)
    # the square of the ringing repeats with the passing of balls
    frequency, lines = spectrum(faulty**2, step)
    near = (frequency > 20) & (frequency < 1.5 * BPFO * speed)
    # 1 s of record: a line is known to half a bin
    assert frequency[near][np.argmax(lines[near])] == pytest.approx(BPFO * speed, abs=0.6)


@pytest.mark.compiles
def test_blocks_make_one_motion():
    whole = moved(seconds=0.03)
    first = moved(seconds=0.01)
    second = moved(seconds=0.02, state=first.state, begin=2000)
    assert_allclose(second.displacement_m, whole.displacement_m[1000:], rtol=0, atol=1e-15)
    assert np.array_equal(first.displacement_m[-1], second.displacement_m[0])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: moved(step_s=1e-3), "step_s = 0.001 is not stable"),
        (lambda: moved(load=(0, 0, 1)), r"load_n has shape \(3,\)"),
        (
            lambda: integrate_bearing(
                MODEL, cage_turns=np.zeros(4), defect_turns=np.zeros(4), load_n=LOAD, step_s=1e-5
            ),
            r"give 2 m \+ 1 of each",
        ),
        (lambda: Support(mass_kg=0, damping_n_s_m=0, stiffness_n_m=1), "a mass above zero"),
    ],
)
def test_what_makes_no_sense_is_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()
