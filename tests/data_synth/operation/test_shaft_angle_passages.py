import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from data_synth.operation.shaft_angle import ShaftAngle, crossings

BACK = ShaftAngle(times_s=np.array([0.0, 4.0]), speeds_hz=np.array([4.0, -4.0]))  # 4 t - t^2, back at zero after 4 s


def test_marks_pass_forth_and_back():
    found = crossings(BACK, per_rev=2, start_s=0.0, stop_s=4.5)
    # 4 t - t^2 = n / 2 has the roots 2 -+ sqrt(4 - n / 2); at 4.5 s the shaft has gone on to -2 rev, held at -4 rev/s
    up = np.arange(8)
    roots = np.sqrt(4 - up / 2)
    expected = np.concatenate([2 - roots, [2.0], (2 + roots)[::-1], 4 + np.arange(1, 5) / 8])
    assert_allclose(found.times_s, expected, rtol=1e-12)
    assert_array_equal(found.numbers, [*up, 8, *up[::-1], -1, -2, -3, -4])
    assert_array_equal(found.directions, [1] * 8 + [-1] * 13)  # at the turning point itself, once


def test_a_shaft_at_rest_passes_nothing_more():
    angle = ShaftAngle(times_s=np.array([0.0, 2.0, 5.0, 6.0]), speeds_hz=np.array([3.0, 0.0, 0.0, 3.0]))
    found = crossings(angle, per_rev=1, start_s=0.0, stop_s=6.0, offset=-1.0)
    # 3 t - 3 t^2 / 4 to revolution 3 at 2 s, where it rests until 5 s, then 3 t^2 / 2
    assert_array_equal(found.numbers, [-1, 0, 1, 2, 3])
    assert_allclose(found.times_s[:3], 2 - np.sqrt((3 - np.arange(3)) / 0.75), atol=1e-12)
    assert_allclose(found.times_s[3:], [5, 5 + np.sqrt(2 / 3)], rtol=1e-12)  # the mark under it, when it moves on


@given(st.lists(st.tuples(st.floats(0.05, 2), st.floats(-30, 30)), min_size=2, max_size=6), st.floats(0.3, 20))
def test_every_mark_is_found_once(pieces, per_rev):
    gaps, speeds = np.array(pieces).T
    angle = ShaftAngle(times_s=np.cumsum(gaps), speeds_hz=speeds)
    stop_s = float(np.sum(gaps)) + 0.5
    found = crossings(angle, per_rev=per_rev, start_s=0.0, stop_s=stop_s, offset=0.37)
    marks = per_rev * angle.revolutions(found.times_s) + 0.37
    # an ulp of the time at the speed, and of the angle
    assert_allclose(marks, found.numbers, atol=1e-10 * (1 + np.max(np.abs(speeds)) * per_rev))
    assert np.all(np.diff(found.times_s) >= 0)
    # brute force: floors of a fine sampling change by one at each mark
    floors = np.floor(per_rev * angle.revolutions(np.linspace(0, stop_s, 20001)) + 0.37)
    assert abs(np.sum(found.directions) - (floors[-1] - floors[0])) <= 1
    assert np.sum(np.abs(np.diff(floors))) <= found.numbers.size


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [({"per_rev": 0}, "per_rev = 0 is not above zero"), ({"stop_s": -1.0}, "stop_s = -1 lies before start_s = 0")],
)
def test_what_makes_no_sense_is_refused(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        crossings(BACK, **{"per_rev": 1, "start_s": 0.0, "stop_s": 1.0, **changes})


def test_a_reversal_between_speeds_whose_product_underflows():
    angle = ShaftAngle(times_s=np.array([0.0, 1.0, 2.0, 3.0]), speeds_hz=np.array([1.0, 1e-200, -1e-200, -1.0]))
    # half a revolution forth in the first second, and back in the last: marks at 1 and 3 eighths pass twice
    found = crossings(angle, per_rev=4, start_s=0.0, stop_s=3.0, offset=-0.5)
    assert_array_equal(found.numbers, [0, 1, 1, 0])
    assert_allclose(angle.turning_points_s(), [1.5])
