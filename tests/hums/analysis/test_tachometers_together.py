"""Several tachometers of one record: true ones on shafts of known motion agree, wrong ones are named."""

import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hums
from hums.analysis.reference_angle import prepare_machine
from hums.analysis.settings import AnalysisSettings

RATE_HZ, SECONDS = 4000, 6.0
GEARBOX = hums.load_gearbox("two-stage")
OUTPUT = float(abs(hums.solve_kinematics(GEARBOX).rates({"input": Fraction(1)})["output"]))


def pulses(per_rev, *, start_hz=20.0, stop_hz=20.0, ratio=1.0, late_s=0.0, jitter_s=0.0, seed=0):
    """Pulse times of a shaft that turns `ratio` times as fast as the input, whose speed rises evenly."""
    rise = (stop_hz - start_hz) / SECONDS
    turns = np.arange(0.3, (start_hz + stop_hz) / 2 * SECONDS * ratio * per_rev) / per_rev / ratio
    times = 2 * turns / (start_hz + np.sqrt(start_hz**2 + 2 * rise * turns))
    return times + late_s + jitter_s * np.random.default_rng(seed).standard_normal(times.size)


def tachometer(name, times_s, *, shaft="input", per_rev=1):
    return hums.PulseTimes(times_s=times_s, shaft=shaft, pulses_per_rev=per_rev, name=name)


def record(*tachometers):
    noise = np.random.default_rng(1).standard_normal(int(SECONDS * RATE_HZ))
    return hums.make_record({"housing": noise}, rate_hz=RATE_HZ, units="g", angle=list(tachometers))


def source(*tachometers, **options):
    return prepare_machine(record(*tachometers), GEARBOX, AnalysisSettings(**options)).source


@given(
    start_hz=st.floats(10, 40),
    stop_hz=st.floats(10, 40),
    per_rev=st.sampled_from([8, 60, 480]),
    jitter_s=st.sampled_from([0.0, 1e-6, 2e-5]),
)
@settings(max_examples=25, deadline=None)
@pytest.mark.compiles
def test_true_ones_agree_and_the_better_one_is_taken(start_hz, stop_hz, per_rev, jitter_s):
    law = {"start_hz": start_hz, "stop_hz": stop_hz}
    coarse = tachometer("coarse", pulses(1, **law, jitter_s=10 * jitter_s + 1e-7))
    fine = tachometer("fine", pulses(per_rev, **law, ratio=OUTPUT, jitter_s=jitter_s), shaft="output", per_rev=per_rev)
    found = source(coarse, fine)
    assert found.contradiction == ""
    if per_rev * OUTPUT > 2:
        assert found.tachometer == "fine"
    assert source(coarse, fine, tachometer="coarse").tachometer == "coarse"


@pytest.mark.parametrize("off", [1.0, 1.03])
def test_a_ratio_that_is_wrong_by_three_per_cent_shows_in_a_few_turns_of_a_slow_shaft(off):
    slow = tachometer("slow", pulses(1, ratio=OUTPUT * off), shaft="output")
    assert ("contradict" in source(tachometer("fast", pulses(1)), slow).contradiction) == (off != 1)


@given(factor=st.sampled_from([2, 3, 4]), start_hz=st.floats(15, 40), stop_hz=st.floats(15, 40))
@settings(max_examples=15, deadline=None)
@pytest.mark.compiles
def test_a_wrong_number_of_pulses_is_named_with_both_speeds(factor, start_hz, stop_hz):
    law = {"start_hz": start_hz, "stop_hz": stop_hz}
    wrong = tachometer("in", pulses(1, **law), per_rev=factor)
    right = tachometer("out", pulses(8, **law, ratio=OUTPUT), shaft="output", per_rev=8)
    said = source(wrong, right).contradiction
    assert 'tachometers "in" (input) and "out" (output) contradict each other' in said
    assert f"a ratio of {1 / factor:.2g}" in said


def test_a_tooth_more_in_the_drawing_is_a_contradiction():
    one = tachometer("in", pulses(1))
    other = tachometer("out", pulses(8, ratio=OUTPUT * 56 / 57), shaft="output", per_rev=8)
    assert "contradict each other" in source(one, other).contradiction


@pytest.mark.parametrize("late_s", [0.005, 0.03, 0.1])
def test_a_delay_in_a_run_up_is_found(late_s):
    law = {"start_hz": 10.0, "stop_hz": 30.0, "jitter_s": 1e-5}
    late = tachometer("b", pulses(1, **law, late_s=late_s, seed=1))
    said = source(tachometer("a", pulses(1, **law)), late).contradiction
    found = re.search(r'"b" is ([0-9.]+) ms later than "a" \(standard deviation ([0-9.]+) ms\)', said)
    assert abs(float(found[1]) - 1e3 * late_s) < 5 * float(found[2]) + 0.1


def test_no_part_is_called_sound_under_a_contradiction():
    analysis = hums.analyze(record(tachometer("a", pulses(1)), tachometer("b", pulses(2))), GEARBOX)
    parts = hums.verdict_table(analysis)
    assert set(parts.verdict) == {"not judged"}
    notes = [note for note in hums.summary(analysis)["notes"] if "contradict" in note]
    assert len(notes) == 1
    assert '"a"' in notes[0]
    assert '"b"' in notes[0]
