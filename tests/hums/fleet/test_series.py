import math

import numpy as np
import pytest

from hums.fleet.series import INDICATOR, LINE, Series, component_parts, joint_names, layout_of, named, series_of
from signals.monitoring.health import fused_scores


def line(harmonic, amplitude, snr):
    return ["a", "envelope", "bearing", "inner_race", harmonic, 0, "g", 1.0, amplitude, snr, 1]


def lines_of(rows):
    return named(rows, len(LINE), 4)


def found_in(indicators, lines):
    return series_of(named(indicators, len(INDICATOR), 1), lines_of(lines))


def test_logarithms_of_indicators_and_of_the_mean_square_of_lines():
    found = found_in(
        [["a", "bearing", "inner_race", "defect_energy", "g2", 4.0], ["a", "gear", "gear", "fm4", "1", -1.0]],
        [line(1, 3.0, 30.0), line(2, 4.0, 40.0), line(3, math.nan, 1.0)],
    )
    found = {key.indicator: (value, key.power) for key, value in zip(found.keys, found.values, strict=True)}
    assert found == {
        "defect_energy": (pytest.approx(math.log(4)), 2),
        "envelope line_level": (pytest.approx(math.log(math.sqrt(12.5))), 1),
        "envelope line_over_background": (pytest.approx(math.log(math.sqrt(1250))), 0),
    }


def test_bearings_of_the_same_orders_are_one_component():
    equal, other = ("drive end", "free end"), "third"
    orders = dict.fromkeys(equal, 4.5) | {other: 5.5}
    lines = [
        ["a", "envelope", name, "inner_race", harmonic, 0, "g", harmonic * order, 1.0, 2.0, 1]
        for name, order in orders.items()
        for harmonic in (1, 2)
    ]
    indicators = [["a", name, "inner_race", "defect_energy", "g2", 4.0] for name in orders]
    joint = "one of drive end, free end"
    assert joint_names(lines_of(lines)) == dict.fromkeys(equal, joint)
    keys = found_in(indicators, lines).keys
    assert {key.component for key in keys} == {joint, other}
    assert len(keys) == 6
    assert component_parts(joint) == (joint, *equal)
    lines[1][7] = 9.01  # a harmonic apart: they can be told apart
    assert joint_names(lines_of(lines)) == {}


def test_impacts_once_per_revolution_are_of_a_shaft_or_a_tooth_of_its_gears():
    orders = {("input", "shaft", 1, 0): 1.0, ("pinion", "tooth", 1, -1): 22.0, ("pinion", "tooth", 1, 1): 24.0}
    orders |= {("output", "shaft", 1, 0): 0.4, ("fan", "shaft", 1, 0): 1.5}
    orders |= {("wheel", "tooth", 1, -1): 22.6, ("wheel", "tooth", 1, 1): 23.4, ("rim", "tooth", 1, 1): 5.4}
    orders |= {("rim", "tooth", 1, -1): 4.6}
    lines = [
        ["a", spectrum, *key, "g", order, 1.0, 2.0, 1]
        for key, order in orders.items()
        for spectrum in (("order_spectrum", "envelope") if key[1] == "shaft" else ("order_spectrum",))
    ]
    found = {(key.component, key.indicator.split()[0]) for key in found_in([], lines).keys}
    assert {name for name, spectrum in found if spectrum == "envelope"} == {
        *("one of input, pinion", "one of output, rim, wheel", "fan"),
    }
    assert {name for name, spectrum in found if spectrum == "order_spectrum"} == {
        *("input", "output", "fan", "pinion", "wheel", "rim"),
    }


def test_what_few_samples_set_is_watched_apart_from_the_level_of_the_signal():
    keys = tuple(
        Series(channel="a", component="record", kind="channel", indicator=name, unit=unit)
        for name, unit in (("kurtosis", "1"), ("peak", "g"), ("rms", "g"))
    )
    names, _, layout = layout_of(keys)
    assert names == ("record", "record (impulses)")
    assert [[kind.tolist() for kind in kinds] for kinds in layout.components] == [[[2]], [[0, 1]]]


def test_how_far_one_tooth_stands_out_is_scored_with_the_teeth_and_not_with_the_gear():
    def key(kind, indicator):
        return Series(channel="a", component="pinion", kind=kind, indicator=indicator, unit="1")

    gear = [key("gear", f"statistic {number}") for number in range(9)]
    keys = (*gear, key("gear", "tooth_outlier"), key("tooth", "order_spectrum line_over_background"))
    (_, _, layout) = layout_of(keys)
    departures = np.zeros((1, len(keys)))
    departures[0, 9] = 8.0  # what a spall raises
    assert fused_scores(departures, layout) == pytest.approx(np.array([[8.0]]))  # 2 among the gear's four largest


def test_the_evidence_of_each_part_of_a_bearing_is_a_score_of_its_own():
    keys = tuple(
        sorted(
            Series(channel=channel, component="bearing", kind=kind, indicator=indicator, unit="1")
            for channel in "ab"
            for kind in ("inner_race", "outer_race")
            for indicator in ("defect_energy_ratio", "modulation")
        )
    )
    names, _, layout = layout_of(keys)
    assert (names, layout.groups) == (("bearing",) * 3, (0, 1, 1))
    departures = np.array([3.0 * (key.kind == "outer_race" and key.indicator == "modulation") for key in keys])
    assert fused_scores(departures, layout) == pytest.approx(np.array([3.0, 0.0, 3.0]))
