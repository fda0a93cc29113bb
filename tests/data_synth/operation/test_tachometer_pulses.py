import numpy as np
import pytest
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate
from data_synth.operation.shaft_angle import ShaftAngle
from data_synth.operation.tachometer_pulses import recorded_pulses
from data_synth.scene.operation import Tachometer
from hums.records.validation import check_record

ANGLE = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([10.0]), datum_rev=0.005)


def recorded(seed=0, stop_s=100.0, **spoilt):
    declared = {"link": "input", "pulses_per_rev": 4, **spoilt}
    tachometer = Tachometer.model_validate(declared)
    return recorded_pulses(ANGLE, tachometer, turns_per_rev=2.0, stop_s=stop_s, rng=np.random.default_rng(seed))


def test_a_sound_tachometer_is_exact():
    pulses = recorded()
    assert_allclose(pulses.times_s, 0.0005 + np.arange(8000) / 80, rtol=1e-14)
    assert_allclose(pulses.marks_s, pulses.times_s, atol=0)
    assert pulses.missed.size == pulses.spurious_s.size == 0


def test_missing_pulses_are_those_it_names():
    pulses = recorded(missing={"share": 0.1})
    assert_allclose(np.delete(pulses.marks_s, pulses.missed.astype(int)), pulses.times_s, atol=0)
    # 8000 marks: 800 missed, give or take 4 x sqrt(720)
    assert abs(pulses.missed.size - 800) < 108
    assert 0 not in pulses.missed


def test_spurious_pulses_come_at_their_rate_and_are_named():
    pulses = recorded(spurious={"per_second": 5.0})
    assert_allclose(np.union1d(pulses.marks_s, pulses.spurious_s), pulses.times_s, atol=0)
    assert abs(pulses.spurious_s.size - 500) < 90  # Poisson: 4 x sqrt(500)


def test_the_box_is_late_and_its_clock_gains():
    pulses = recorded(delay_s=2e-3, clock_ppm=50.0, missing={"share": 0.1})
    passed = np.delete(pulses.marks_s, pulses.missed.astype(int))
    assert_allclose(pulses.times_s, 2e-3 + (1 + 50e-6) * passed, rtol=1e-14)  # 5 ms in the 100 s of the record


def test_jitter_keeps_lines_where_slip_melts_them():
    # dynamics.md: independent errors of sigma periods leave exp(-(2 pi k sigma)^2) of the power of line k
    period_s, sigma = 1 / 80, 0.01
    pulses = recorded(jitter={"std_s": sigma * period_s})
    k = np.array([5, 10, 20])
    lines = np.mean(np.exp(2j * np.pi * np.outer(k, pulses.times_s / period_s)), axis=1)
    # a quadrature of the mean of 8000 phasors errs by at most 1 / sqrt(16000); four times that
    assert_allclose(np.abs(lines), np.exp(-((2 * np.pi * k * sigma) ** 2) / 2), atol=4 / np.sqrt(16000))


def test_uneven_marks_repeat_every_turn():
    pulses = recorded(uneven={"deg": [1.0, 3.0, -2.0, 1.0]})
    # errors count from the first mark, in degrees of a shaft that makes 20 turns a second
    off_s = (pulses.times_s - (0.0005 + np.arange(8000) / 80)) * 20 * 360
    assert_allclose(off_s.reshape(-1, 4), [[0.0, 2.0, -3.0, 0.0]] * 2000, atol=1e-7)
    drawn = recorded(uneven={"std_deg": 0.5})
    pattern = ((drawn.times_s - (0.0005 + np.arange(8000) / 80)) * 7200).reshape(-1, 4)
    assert_allclose(pattern, pattern[:1] * np.ones((2000, 1)), atol=1e-7)
    assert pattern[0, 0] == pytest.approx(0, abs=1e-9)
    assert np.all(pattern[0, 1:] != 0)


def test_a_spoilt_tachometer_makes_a_record_with_its_truth():
    tachometer = {
        "link": "input", "pulses_per_rev": 8, "missing": {"share": 0.05}, "spurious": {"per_second": 20},
        "jitter": {"std_s": 1e-6}, "uneven": {"std_deg": 0.2},
    }  # fmt: skip
    table = TWO_STAGE | {"speed": {"link": "input", "rpm": 900}}
    sound = simulate(Scene.from_mapping({**table, "tachometer": {"link": "input", "pulses_per_rev": 8}}), seed=1)
    spoilt = simulate(Scene.from_mapping({**table, "tachometer": tachometer}), seed=1)
    check_record(spoilt)
    assert_allclose(spoilt["a"].values, sound["a"].values, atol=0)  # the machine does not know
    assert spoilt["truth_marks"].values[0] == sound["tachometer"].values[0]
    assert spoilt["tachometer"].size == 120 - spoilt["truth_missed_marks"].size + spoilt["truth_spurious_pulses"].size
    assert "truth_marks" not in sound


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"missing": {"share": 1.0}}, "missing.share = 1.0"),
        ({"uneven": {"std_deg": 8.0}}, "allows marks 90 degrees apart to change order; keep it below 5.625"),
        ({"uneven": {"deg": [0, 1]}}, "uneven.deg has 2 numbers for pulses_per_rev = 4"),
        ({"uneven": {"deg": [0, 100, 0, 0]}}, "changes the order of marks 90 degrees apart"),
        ({"uneven": {}}, "give either std_deg"),
    ],
)
def test_marks_that_make_no_sense_are_refused(change, sentence):
    with pytest.raises(SceneError) as caught:
        Scene.from_mapping(TWO_STAGE | {"tachometer": {"link": "input", "pulses_per_rev": 4, **change}})
    assert sentence in str(caught.value)
