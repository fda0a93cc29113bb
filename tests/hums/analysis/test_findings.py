"""The rule on hand-made lines: what is claimed, what is a shadow, what is certain."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hums.analysis.detection import LineAssessor, implied_cage
from hums.analysis.evidence import (
    BandEvidence,
    PartEvidence,
    Setting,
    _explanation,
    _of_a_stronger_part,
    _Others,
    bearing_evidence,
)
from hums.analysis.findings import Finding, bearing_verdicts
from hums.analysis.findings import findings as named
from hums.analysis.healthy_machines import HealthyMachines
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM, ExpectedLine, MeasuredLine
from hums.gearbox.bearing_orders import BearingOrders
from signals.spectra.lines import Line

BIN = 0.01
# 9 elements, cage 0.4 of the shaft: inner 5.4, outer 3.6
BEARING = BearingOrders(
    name="b",
    relative=1.0,
    inner_ring=1.0,
    outer_ring=0.0,
    inner_race=5.4,
    outer_race=3.6,
    rolling_element=4.75,
    cage=0.4,
    cage_to_outer=0.4,
    elements=9,
)
ASSESSOR = LineAssessor({"b": BEARING}, 0.01)


def line(
    kind,
    found,
    snr,
    *,
    component="b",
    harmonic=1,
    sideband=0,
    spectrum=ENVELOPE,
    fundamental=True,
    p=None,
    leakage=0.0,
    spacing=0.0,
    level=20.0,
):
    chance = (1e-9 if snr > 4 else 0.5) if p is None else p
    return MeasuredLine(
        expected=ExpectedLine(
            component=component,
            kind=kind,
            harmonic=harmonic,
            sideband=sideband,
            order=found,
            tolerance=0.1,
            spectrum=spectrum,
            spacing=spacing,
            fundamental=fundamental,
        ),
        channel="x",
        units="g",
        bin_width=BIN,
        line=Line(
            expected=found,
            found=found,
            amplitude=snr,
            amplitude_std=0.5,
            background=1.0,
            leakage=leakage,
            false_alarm_probability=chance,
        ),
        level=level if spectrum == ENVELOPE else 0.0,
    )


LIBRARY = HealthyMachines(records=9999, parts=9999, strengths=(0.005,))
SETTING = Setting(shafts=(1.0,), speed_hz=17.0, speed_range_hz=1.0)


def judged(assessed, *, faulty=(), others=(), noise=0.02, library=LIBRARY):
    """Verdicts of what one band of each channel shows; `others` are peaks beside the assessed lines: order, depth.

    `noise` is the background of the peaks over their depth.
    """
    evidence = []
    for channel in dict.fromkeys(one.measured.channel for one in assessed):
        own = [one for one in assessed if one.measured.channel == channel]
        seen = [(one.measured.line.found, one.measured.depth) for one in own if one.measured.line.snr > 4] + [*others]
        orders, depths = np.array(sorted(seen)).reshape(-1, 2).T
        band = BandEvidence(
            band_hz=(1e3, 2e3),
            lines=own,
            orders=orders,
            depths=depths,
            backgrounds=noise * depths,
            bin_width=BIN,
        )
        bearings = {name: replace(BEARING, name=name) for name in ("b", "c")}
        evidence += bearing_evidence([band], bearings, SETTING)
    return bearing_verdicts(evidence, false_alarm_probability=0.01, faulty=faulty, library=library)


def findings(assessed, **given):
    return named(judged(assessed, **given))


def claims(*lines):
    return [assessed.significant for assessed in ASSESSOR.assess(lines)]


def test_noise_is_not_claimed():
    assert claims(line("inner_race", 5.4, 2.0)) == [False]


def test_false_alarm_probability_counts_every_fundamental():
    # 0.002 alone is below 0.01; among ten lines that can raise a finding it is 0.0198
    single = line("inner_race", 5.4, 9.0, p=0.002)
    assert claims(single) == [True]
    assert claims(single, *[line("shaft", 30 + i, 1.0, fundamental=False) for i in range(9)])[0]
    assert not claims(single, *[line("cage", 30 + i, 1.0) for i in range(9)])[0]


@pytest.mark.parametrize(
    ("kind", "order", "by"),
    [
        ("rolling_element", 4.8, "12 times the cage rate"),
        ("cage", 0.4, "1 times the cage rate"),
        ("outer_race", 3.6, "9 times the cage rate"),
        ("rolling_element", 4.4, "11 times the cage rate"),
        ("rolling_element", 10.8, "harmonic 2"),
        ("rolling_element", 7.4, "sideband \\+2"),
    ],
)
def test_shadows_of_an_inner_race_line(kind, order, by):
    assessed = ASSESSOR.assess([line("inner_race", 5.4, 60.0), line(kind, order, 8.0)])
    assert [entry.significant for entry in assessed] == [True, False]
    assert re.search(by, assessed[1].explained_by)


def test_no_shadow_two_and_a_half_bins_away():
    assert claims(line("inner_race", 5.4, 60.0), line("rolling_element", 4.8 + 2.5 * BIN, 21.0)) == [True, True]


def test_what_is_below_a_third_of_another_defect_of_the_bearing_is_hidden_by_it():
    assessed = ASSESSOR.assess([line("inner_race", 5.4, 60.0), line("rolling_element", 4.8 + 2.5 * BIN, 19.0)])
    assert [entry.significant for entry in assessed] == [True, False]
    assert assessed[1].explained_by == "hidden by b inner race, 3 times as large"


def test_the_flank_outside_of_the_searched_range_is_no_line():
    flank = line("inner_race", 5.4, 9.0)
    (assessed,) = ASSESSOR.assess([replace(flank, line=replace(flank.line, at_edge=True))])
    assert (assessed.significant, assessed.explained_by) == (
        False,
        "the flank of what stands outside of the searched range",
    )


def test_every_band_that_was_searched_counts():
    # 0.0005 in one band is below 0.01; in thirty it is 0.0149
    single = line("inner_race", 5.4, 9.0, p=0.0005)
    assert claims(single) == [True]
    assert claims(replace(single, searches=30)) == [False]


def test_comparable_lines_on_both_races_are_rivals_and_not_certain():
    assessed = ASSESSOR.assess(
        [
            line("inner_race", 5.4, 10.0),
            line("outer_race", 3.6, 9.0),
            line("inner_race", 10.8, 7.0, harmonic=2, fundamental=False),
        ]
    )
    found = findings(assessed)
    assert {(f.kind, f.verdict) for f in found} == {("inner_race", "indicated"), ("outer_race", "indicated")}
    assert all("of similar size" in f.evidence for f in found)


def test_damage_may_ring_in_either_half_of_the_range():
    # 6 of a background of 1 over a level of 100 is 6 %, over one of 40 it is 15 %; a narrower band decides nothing
    def detectable(*levels):
        bands = [
            BandEvidence(
                band_hz=(1e3 * number, 1e3 * (number + width)),
                lines=ASSESSOR.assess([line("inner_race", 5.4, 2.0, level=level)]),
                orders=np.zeros(0),
                depths=np.zeros(0),
                backgrounds=np.zeros(0),
                bin_width=BIN,
            )
            for number, (level, width) in enumerate(levels)
        ]
        (part,) = bearing_evidence(bands, {"b": BEARING}, SETTING)
        return part.detectable_depth

    assert detectable((100.0, 1.0), (40.0, 1.0)) == pytest.approx(0.15)
    assert detectable((100.0, 1.0), (40.0, 0.5)) == pytest.approx(0.06)


def test_a_supported_strong_line_is_diagnosed():
    assessed = ASSESSOR.assess(
        [line("inner_race", 5.4, 10.0), line("inner_race", 6.4, 7.0, sideband=1, fundamental=False)]
    )
    (found,) = findings(assessed)
    assert found.verdict == "diagnosed"
    assert "sideband +1" in found.evidence


def test_what_a_faulty_sensor_shows_is_not_judged():
    strong = [line("inner_race", 5.4, 10.0), line("inner_race", 6.4, 7.0, sideband=1, fundamental=False)]
    assessed = ASSESSOR.assess(strong)
    assert {one.verdict for one in findings(assessed)} == {"diagnosed"}
    (found,) = judged(assessed, faulty=["x"])
    assert found.verdict == "not judged"
    assert "the sensor is faulty" in found.evidence


def test_what_a_deeper_line_explains_is_hidden_by_it():
    # a turn of the shaft above 3.4, which no part of the bearing makes
    inner = [line("inner_race", 5.4, 10.0), line("inner_race", 10.8, 7.0, harmonic=2, fundamental=False)]
    assessed = ASSESSOR.assess(inner)
    (found,) = judged(assessed, others=[(4.4, 0.9)])
    assert found.verdict == "not judged"
    assert "sideband +1 x 1 of the line at 4.400" in found.evidence
    (shallow,) = judged(assessed, others=[(4.4, 0.3)])
    assert shallow.verdict == "diagnosed"
    (harmonic,) = judged(assessed, others=[(2.7, 0.9)])
    assert "2 times the line at 2.700" in harmonic.evidence


@pytest.mark.parametrize(("order", "hidden"), [(0.4, False), (0.8, False), (0.45, True), (1.6, True)])
def test_the_cage_that_carries_an_element_hides_it_not(order, hidden):
    # a turn of the shaft above or below each: the cage's own line and harmonic modulate the element's by themselves
    bearing = replace(BEARING, rolling_element=order + 1.0)
    lines = ASSESSOR.assess([line("rolling_element", order + 1.0, 10.0)])
    band = silent_band(
        lines, orders=np.array([order, order + 1.0]), depths=np.array([0.9, 0.5]), backgrounds=np.full(2, 0.01)
    )
    (part,) = bearing_evidence([band], {"b": bearing}, SETTING)
    assert bool(part.hidden_by) == hidden


@pytest.mark.parametrize(("double", "verdict"), [(0.2, "indicated"), (0.5, "not judged")])
def test_a_sideband_as_deep_as_its_race_does_not_hide_it(double, verdict):
    # a load zone of half a turn makes the sideband at 4.4 nearly as deep as the race at 5.4; their doubles tell
    inner = [line("inner_race", 5.4, 10.0), line("inner_race", 10.8, 7.0, harmonic=2, fundamental=False)]
    (found,) = judged(ASSESSOR.assess(inner), others=[(4.4, 0.51), (8.8, double)])
    assert found.verdict == verdict
    assert "4.400" in found.doubts


def test_a_comb_of_a_slow_shaft_is_no_race():
    # 5.4 is 36 times 0.15: a tooth that strikes once a turn of that shaft makes every multiple, a race few
    band = BandEvidence(
        band_hz=(1e3, 2e3),
        lines=ASSESSOR.assess([line("outer_race", 5.4, 10.0)]),
        orders=np.array([*(0.15 * np.arange(1, 11)), 5.4]),
        depths=np.full(11, 0.5),
        backgrounds=np.full(11, 0.01),
        bin_width=BIN,
    )
    setting = Setting(shafts=(0.15, 1.0), speed_hz=17.0, speed_range_hz=1.0)
    (part,) = bearing_evidence([band], {"b": BEARING}, setting)
    assert part.hidden_by == "it is 36 times the order 0.15 of a shaft, of whose multiples most stand out"
    few = replace(
        band,
        orders=np.array([0.15, 0.3, 5.25, 5.4, 5.55]),
        depths=np.full(5, 0.5),
        backgrounds=np.full(5, 0.01),
    )
    (part,) = bearing_evidence([few], {"b": BEARING}, setting)
    assert not part.hidden_by.endswith("most stand out")


INNER = (line("inner_race", 5.4, 10.0), line("inner_race", 6.4, 7.0, sideband=1, fundamental=False))


@pytest.mark.parametrize(
    ("order", "depth", "noise", "verdict"),
    [
        (7.1, 0.9, 0.02, "not judged"),
        (0.15, 0.9, 0.02, "diagnosed"),  # slower than any part: the level changes
        (
            7.1,
            0.9,
            0.2,
            "diagnosed",
        ),  # 5 times its background: 0.9 * 25 / (25 + 64) = 0.25, the race 0.5 * 100 / 164 = 0.30
        (7.1, 0.3, 0.02, "diagnosed"),
    ],
)
def test_where_a_stronger_line_is_of_something_else_a_race_may_be_as_well(order, depth, noise, verdict):
    (found,) = judged(ASSESSOR.assess(INNER), others=[(order, depth)], noise=noise)
    assert found.verdict == verdict
    if found.verdict == "not judged":
        assert "the line at 7.100 orders, which nothing explains, is stronger (90.0%)" in found.evidence


def test_lines_of_both_races_alike_name_neither_unless_they_are_deep():
    def verdicts(level):
        both = [
            line("inner_race", 5.4, 12.0, level=level),
            line("inner_race", 6.4, 9.0, sideband=1, fundamental=False, level=level),
            line("outer_race", 3.6, 11.0, level=level),
            line("outer_race", 7.2, 9.0, harmonic=2, fundamental=False, level=level),
        ]
        return {one.kind: one for one in judged(ASSESSOR.assess(both))}

    shallow = verdicts(100.0)  # 12 % and 11 %
    assert {one.verdict for one in shallow.values()} == {"not judged"}
    assert "the line of the outer race is of similar size (11.0%)" in shallow["inner_race"].evidence
    assert shallow["inner_race"].least_change == "indicated from a modulation of 30% on (now 12.0%)"
    assert {one.verdict for one in verdicts(20.0).values()} == {"indicated"}  # 60 % and 55 %


def test_a_record_that_would_not_show_damage_names_only_what_is_deeper():
    # six times a background of 1 over a level of 40 is 15 %, over 100 it is 6 %, over 12 it is 50 %
    def inner(depth, level):
        lines = [
            line("inner_race", 5.4, depth * level, level=level),
            line("inner_race", 6.4, 0.5 * depth * level, sideband=1, fundamental=False, level=level),
        ]
        (found,) = judged(ASSESSOR.assess(lines))
        return found

    assert inner(0.2, 100.0).verdict == "diagnosed"
    short = inner(0.2, 40.0)  # a record 1.5^2 times as long would show 10 %: of this one 22.5 % are asked
    assert short.verdict == "not judged"
    assert "by 20%, but only a modulation by 15% would stand out" in short.evidence
    assert short.least_change == "indicated from a modulation of 22% on, or in a record 2.2 times as long"
    assert inner(0.24, 40.0).verdict == "diagnosed"
    assert inner(0.8, 12.0).verdict == "diagnosed"  # three times the least damage is enough, where 50 % would show


def test_a_line_alone_counts_a_quarter_where_its_harmonic_would_show():
    (seen,) = findings(ASSESSOR.assess([line("outer_race", 3.6, 20.0)]))  # no harmonic in reach of the band
    sine = [line("outer_race", 3.6, 20.0), line("outer_race", 7.25, 2.0, harmonic=2, fundamental=False)]
    (alone,) = findings(ASSESSOR.assess(sine))
    assert seen.strength == pytest.approx(4 * alone.strength)


def test_a_line_of_the_mains_is_no_race():
    setting = replace(SETTING, speed_hz=100 / 3.6, speed_range_hz=0.0)
    assessed = ASSESSOR.assess([line("outer_race", 3.6, 10.0)])
    band = BandEvidence(
        band_hz=(1e3, 2e3),
        lines=assessed,
        orders=np.array([3.6]),
        depths=np.array([0.5]),
        backgrounds=np.array([0.01]),
        bin_width=BIN,
    )
    (part,) = bearing_evidence([band], {"b": BEARING}, setting)
    assert part.hidden_by == "100.00 Hz is 2 times mains of 50 Hz"
    (part,) = bearing_evidence([band], {"b": BEARING}, replace(setting, speed_range_hz=1.0))
    assert not part.hidden_by


@pytest.mark.parametrize(
    ("third", "bin_width", "hidden"), [(10.8, 2 * BIN, True), (10.73, 2 * BIN, False), (10.77, BIN, True)]
)
def test_a_race_near_the_mains_is_told_by_its_harmonics(third, bin_width, hidden):
    # 3.6 and 3.577 orders are both within a short record's resolution of 100 Hz; three times the second is not 300 Hz.
    # In a longer one fewer lines than one in fifty are so near by chance: that is enough
    setting = replace(SETTING, speed_hz=100 / 3.6, speed_range_hz=0.0)
    race = [of_order(3.6, third / 3), of_order(10.8, third, harmonic=3)]
    band = BandEvidence(
        band_hz=(1e3, 2e3),
        lines=ASSESSOR.assess(race),
        orders=np.array([third / 3, third]),
        depths=np.array([1.0, 1.0]),
        backgrounds=np.array([0.01, 0.01]),
        bin_width=bin_width,
    )
    (part,) = bearing_evidence([band], {"b": BEARING}, setting)
    assert part.hidden_by.endswith("is 2 times mains of 50 Hz") == hidden


@pytest.mark.parametrize(("level", "verdict"), [(150.0, "not judged"), (400.0, "nothing found")])
def test_a_part_beside_whose_line_damage_would_not_be_seen_is_not_called_sound(level, verdict):
    # a tooth's strikes explain the line at the race's place, 30 over a level of 150: the race may strike, too
    tooth = [
        line("tooth", 3.6 * k, 40.0, component="m/p", harmonic=k, fundamental=False, level=level) for k in (1, 2, 3)
    ]
    (found,) = judged(ASSESSOR.assess([line("outer_race", 3.6, 30.0, level=level), *tooth]))
    assert found.verdict == verdict
    assert "harmonic 1 of m/p tooth" in found.doubts


def test_a_record_that_would_not_show_a_defect_is_not_judged():
    # 2, and 1.645 deviations of 0.5 above it: 2.82 of a level of 20 are 14.1 %, of 50 5.6 %, of 60 4.7 %
    (short,) = judged(ASSESSOR.assess([line("inner_race", 5.4, 2.0)]))
    assert short.verdict == "not judged"
    assert "a modulation by 14.1% may be there unseen" in short.evidence
    # between 5 and 10 % it would not be diagnosed, but a longer record would show it
    (early,) = judged(ASSESSOR.assess([line("inner_race", 5.4, 2.0, level=50.0)]))
    assert early.verdict == "not judged"
    assert "a modulation by 5.6% may be there unseen, where damage may be indicated from 5% on" in early.evidence
    (clean,) = judged(ASSESSOR.assess([line("inner_race", 5.4, 2.0, level=60.0)]))
    assert clean.verdict == "nothing found"
    # what noise makes in one record of ten may be damage: six times a background of 1 are 10 % of 60, 4 % of 150
    (hint,) = judged(ASSESSOR.assess([line("inner_race", 5.4, 2.0, level=60.0, p=0.1)]))
    assert hint.verdict == "not judged"
    (clean,) = judged(ASSESSOR.assess([line("inner_race", 5.4, 2.0, level=150.0, p=0.1)]))
    assert clean.verdict == "nothing found"


@pytest.mark.parametrize("seen", [0.5, 1.0, 2.0, 4.0])
def test_a_deeper_line_would_have_been_larger_in_19_of_20_records(seen):
    (part,) = bearing_evidence([silent_band(ASSESSOR.assess([line("inner_race", 5.4, seen)]))], {"b": BEARING}, SETTING)
    rng = np.random.default_rng(3)
    noise = 0.5 * (rng.standard_normal(100_000) + 1j * rng.standard_normal(100_000))
    as_small = np.mean(np.abs(20 * part.possible_depth + noise) <= seen)
    assert as_small <= 0.05 + 3 * 0.0007  # the deviation of a share of 0.05 of 100,000
    assert as_small > 0.005  # and not by far


def silent_band(lines, **given):
    none = np.zeros(0)
    return BandEvidence(
        **{"band_hz": (1e3, 2e3), "orders": none, "depths": none, "backgrounds": none} | given,
        lines=lines,
        bin_width=BIN,
    )


def test_a_spot_that_turns_has_sidebands():
    harmonic = line("inner_race", 10.8, 7.0, harmonic=2, fundamental=False)
    (bare,) = findings(ASSESSOR.assess([line("inner_race", 5.4, 10.0), harmonic]))
    beside = line("inner_race", 6.4, 7.0, sideband=1, fundamental=False)
    (whole,) = findings(ASSESSOR.assess([line("inner_race", 5.4, 10.0), harmonic, beside]))
    assert bare.verdict == "indicated"
    assert "no sideband shows it passing the load zone" in bare.evidence
    assert whole.strength == pytest.approx(4 * bare.strength)


def test_a_verdict_turns_smoothly_with_the_strength():
    library = HealthyMachines(records=999, parts=999, strengths=tuple(np.linspace(0.5, 0.01, 400)))
    chances = [library.probability(s) for s in np.linspace(0.001, 0.6, 2000)]
    steps = np.abs(np.diff(np.log(chances)))
    assert np.all(np.diff(chances) <= 0)
    assert steps[5:1600].max() < 0.5  # from one strength of the library to the next it is halved at most


@pytest.mark.parametrize(
    ("lines", "doubt"),
    [
        ([line("outer_race", 3.6, 10.0)], "no harmonic or sideband supports it"),
        (
            [
                line("inner_race", 5.4, 9.0, level=100.0),
                line("inner_race", 10.8, 5.0, harmonic=2, fundamental=False, level=100.0),
            ],
            "it modulates the band by only 9.0%",
        ),
    ],
)
def test_doubts_are_said(lines, doubt):
    (found,) = findings(ASSESSOR.assess(lines))
    assert found.verdict == "indicated"
    assert doubt in found.evidence


@pytest.mark.parametrize(
    ("nominal", "order", "off"),
    [
        (5.4, 5.346, ", -1.0%"),  # 0.99 of it
        (5.4, 5.4972, ", +1.8%"),
        (0.4, 0.404, ", +1.0%"),
        (200.0, 199.0, ", -0.5%"),
        (200.0, 200.2, ", +0.1%"),
        (200.0, 200.09, ""),  # 0.045 %, which one decimal does not show
        (5.4, 5.4, ""),
    ],
)
def test_the_evidence_says_in_per_cent_how_far_a_line_lies_from_nominal(nominal, order, off):
    found = line("inner_race", order, 10.0)
    found = replace(found, expected=replace(found.expected, order=nominal))
    (finding,) = findings(ASSESSOR.assess([found]))
    assert finding.evidence.startswith(
        f"envelope line at {order:.3f} orders (nominal {nominal:.3f}{off}), 10 g, 10.0 times its surroundings"
    )
    assert finding.order_found == order


def test_a_harmonic_alone_raises_nothing():
    lone = line("outer_race", 7.2, 20.0, harmonic=2, fundamental=False)
    assert claims(line("outer_race", 3.6, 1.0), lone) == [False, False]


def test_a_harmonic_at_the_wrong_spacing_is_no_support():
    # 2 x 5.4 = 10.8; harmonic 2 may be off by two bins for each of its orders, 0.04
    assert claims(line("inner_race", 5.4, 10.0), line("inner_race", 10.85, 8.0, harmonic=2, fundamental=False)) == [
        True,
        False,
    ]


def tooth(order, snr, *, sideband):
    return line("tooth", order, snr, component="m/g", sideband=sideband, spectrum=ORDER_SPECTRUM)


def test_a_sideband_on_a_shaft_harmonic_still_counts_but_low_ones_do_not():
    shaft = line("shaft", 1.0, 30.0, component="s", spectrum=ORDER_SPECTRUM, fundamental=False)
    assert claims(shaft, tooth(21.0, 10.0, sideband=1)) == [True, True]
    assert claims(shaft, tooth(3.0, 10.0, sideband=1)) == [True, False]


def test_implied_cage():
    assert implied_cage(BEARING, "outer_race", 3.6) == pytest.approx(0.4)
    assert implied_cage(BEARING, "inner_race", 5.4) == pytest.approx(0.4)


def test_a_trace_of_a_much_larger_line_names_nothing():
    # two channels: the shadow rule looks at one, the comparison at both
    other = replace(line("inner_race", 5.4, 90.0), channel="y")
    assessed = ASSESSOR.assess([other, line("rolling_element", 4.75, 9.0)])
    found = {finding.kind: finding for finding in judged(assessed)}
    assert found["rolling_element"].verdict == "not judged"
    assert "10 times as large, of which this may be a trace" in found["rolling_element"].evidence
    assert found["inner_race"].verdict == "indicated"


def test_the_flank_of_a_stronger_line_is_explained():
    (assessed,) = ASSESSOR.assess([line("inner_race", 5.4, 9.0, leakage=5.0)])
    assert (assessed.significant, assessed.explained_by) == (False, "the flank of a stronger line beside it")
    (assessed,) = ASSESSOR.assess([line("inner_race", 5.4, 9.0, leakage=4.0)])
    assert assessed.significant


def test_a_line_that_two_fundamentals_would_make_supports_neither():
    # 10.8 is twice the inner and three times the outer race
    shared = line("inner_race", 10.8, 8.0, harmonic=2, fundamental=False)
    assessed = ASSESSOR.assess([line("inner_race", 5.4, 10.0), line("outer_race", 3.6, 9.0), shared])
    assert [entry.significant for entry in assessed] == [True, True, False]
    assert all("no harmonic or sideband supports it" in f.evidence for f in findings(assessed))


def test_natural_sidebands_of_a_planetary_stage():
    assessor = LineAssessor({}, 0.01, {"m/g": (3.0,)})
    spaced = line("tooth", 96.0, 50.0, component="m/g", sideband=-1, spacing=3.0, spectrum=ORDER_SPECTRUM)
    off = line("tooth", 97.0, 50.0, component="m/g", sideband=-1, spacing=2.0, spectrum=ORDER_SPECTRUM)
    assert [entry.significant for entry in assessor.assess([spaced, off])] == [False, True]


def test_a_damaged_element_explains_what_its_cage_makes_and_its_own_harmonics():
    # its second harmonic, the cage's line and what the cage modulates may each stand higher than the fundamental
    element = [
        line("rolling_element", 4.75, 14.0),
        line("rolling_element", 9.5, 14.5, harmonic=2, fundamental=False),
        line("rolling_element", 4.35, 14.0, sideband=-1, fundamental=False),
    ]
    others = [line("cage", 0.4, 17.0), line("inner_race", 5.55, 9.0)]
    other_bearing = replace(BEARING, name="c")
    same_place = line("outer_race", 9.5, 14.5, component="c")
    assessed = LineAssessor({"b": BEARING, "c": other_bearing}, 0.01).assess([*element, *others, same_place])
    assert [entry.significant for entry in assessed] == [True, True, True, False, False, False]
    assert assessed[3].explained_by == "the cage's rate, at which it takes b rolling element through the load zone"
    assert assessed[4].explained_by.startswith("sideband +2 x 0.4 of harmonic 1")
    assert assessed[5].explained_by == "harmonic 2 of b rolling element"
    assert {finding.verdict for finding in findings(assessed)} == {"diagnosed"}


def test_a_damaged_cage_is_no_damaged_element():
    cage = [line("cage", 0.4, 17.0), line("cage", 0.8, 12.0, harmonic=2, fundamental=False)]
    assessed = ASSESSOR.assess([*cage, line("rolling_element", 4.75, 9.0)])
    assert [entry.significant for entry in assessed] == [True, True, True]


def test_lines_of_the_cage_beside_an_outer_race_are_its_own():
    outer = [line("outer_race", 3.6, 14.0), line("outer_race", 7.2, 9.0, harmonic=2, fundamental=False)]
    assessed = ASSESSOR.assess([*outer, line("cage", 0.4, 9.0), line("cage", 0.43, 9.0)])
    assert assessed[2].explained_by == "1 times the cage rate implied by b outer race"
    assert assessed[3].explained_by == "the cage's rate, at which elements that are not alike modulate b outer race"
    (found,) = findings(assessed)
    assert (found.kind, found.verdict) == ("outer_race", "diagnosed")


def test_a_cage_is_never_certain():
    cage = [line("cage", 0.4, 17.0), line("cage", 0.8, 12.0, harmonic=2, fundamental=False)]
    (found,) = findings(ASSESSOR.assess(cage))
    assert (found.verdict, "damage of a rolling element makes this line, too" in found.evidence) == ("indicated", True)


def test_lines_of_the_shaft_beside_an_inner_race_are_no_comb_of_the_cage():
    # 4.4 is a shaft's turn below the inner race and eleven times the cage's as well
    inner = [line("inner_race", 5.4, 14.0), line("inner_race", 6.4, 9.0, sideband=1, fundamental=False)]
    (found,) = findings(ASSESSOR.assess([*inner, line("rolling_element", 4.4, 9.0)]))
    assert (found.kind, found.verdict) == ("inner_race", "diagnosed")


def test_a_comb_of_impacts_once_a_turn_of_a_slow_shaft_is_no_bearing():
    # three harmonics of the shaft, none as high as the line that happens to lie on its 42nd
    shaft = [
        line("shaft", 0.107 * harmonic, 4.5, component="s", harmonic=harmonic, fundamental=False)
        for harmonic in (1, 2, 3)
    ]
    assessed = ASSESSOR.assess([*shaft, line("rolling_element", 42 * 0.107, 5.2)])
    assert assessed[-1].explained_by == "harmonic 42 of s shaft"


def shaft_comb(*amplitudes, spacing=1.0):
    return [
        line("shaft", spacing * number, amplitude, component="s", harmonic=number, fundamental=False)
        for number, amplitude in enumerate(amplitudes, start=1)
    ]


def test_the_load_zone_of_a_race_is_no_comb_of_impacts():
    # A spot carried through a load zone cos^1.5 has weights of 0.82, 0.43 and 0.09 at one to three turns, over the line
    # of the race, which slip has lowered here by a fifth. Impacts have equal ones.
    race = line("inner_race", 5.4, 16.0)
    zone = ASSESSOR.assess([*shaft_comb(16.4, 8.6, 1.8, spacing=0.9), race])
    assert (zone[-1].significant, zone[-1].explained_by) == (True, "")
    impacts = ASSESSOR.assess([*shaft_comb(16.4, 16.0, 15.0, spacing=0.9), race])
    assert impacts[-1].explained_by == "harmonic 6 of s shaft"


@pytest.mark.parametrize(("third", "kind"), [(1.8, "rolling_element"), (24.0, "cage")])
def test_a_cage_makes_an_element_line_only_by_impacts(third, kind):
    # 4.8 is twelve times the cage; the cage's lines are the highest
    cage = [
        line("cage", 0.4, 25.0),
        line("cage", 0.8, 25.0 if third > 9 else 9.0, harmonic=2, fundamental=False),
        line("cage", 1.2, third, harmonic=3, fundamental=False),
    ]
    assessed = ASSESSOR.assess([*cage, line("rolling_element", 4.8, 20.0)])
    alone = [one.measured.expected.kind for one in assessed if one.significant and one.measured.expected.fundamental]
    assert alone == [kind]


def of_order(nominal, found, kind="outer_race", *, component="b", snr=20.0, harmonic=1):
    made = line(kind, found, snr, component=component, harmonic=harmonic, fundamental=harmonic == 1)
    return replace(made, expected=replace(made.expected, order=nominal))


def test_a_peak_within_the_slip_of_two_parts_is_of_the_nearer_one():
    # nominal orders of 3.66 and 3.60 both have 3.602 within 2 %
    own = [of_order(3.6, 3.602, component="c"), of_order(7.2, 7.204, component="c", snr=9.0, harmonic=2)]
    farther = [of_order(3.66, 3.602), of_order(7.32, 7.204, snr=9.0, harmonic=2)]
    for lines in ([*farther, *own], [*own, *farther]):
        (found,) = findings(ASSESSOR.assess(lines))
        assert (found.component, found.verdict) == ("c", "diagnosed")  # 0.1 and 1.6 % off


def test_a_peak_between_two_nominal_orders_is_not_certain():
    nearer = [of_order(3.6, 3.602, component="c"), of_order(7.2, 7.204, component="c", snr=9.0, harmonic=2)]
    (found,) = findings(ASSESSOR.assess([of_order(3.612, 3.602), *nearer]))  # 0.3 % off
    assert (found.component, found.verdict) == ("c", "indicated")
    assert "the outer race of b, of order 3.612, may make this line, too" in found.doubts


@pytest.mark.parametrize("lines", [("b", "c"), ("c", "b")])
def test_equal_bearings_are_named_together(lines):
    # two of the same bearing on one shaft: nothing in the record tells one from the other
    made = [
        one
        for name in lines
        for one in (of_order(3.6, 3.6, component=name), of_order(7.2, 7.2, component=name, snr=9.0, harmonic=2))
    ]
    every = judged(ASSESSOR.assess(made))
    assert sorted(one.verdict for one in every) == ["indicated", "not judged"]
    (found,) = named(every)
    (other,) = {"b", "c"} - {found.component}
    assert f"it may be {other}, which has the same orders" in found.doubts
    assert found.next_step == f"Inspect {found.component} and {other}."


def test_a_damaged_element_explains_the_cage_of_an_equal_bearing():
    # nothing tells which of two equal bearings has the damaged element, and neither cage is damaged
    made = [
        one
        for name in ("b", "c")
        for one in (
            of_order(4.75, 4.75, "rolling_element", component=name),
            of_order(9.5, 9.5, "rolling_element", component=name, snr=9.0, harmonic=2),
            of_order(0.4, 0.4, "cage", component=name, snr=9.0),
        )
    ]
    twins = LineAssessor({"b": BEARING, "c": replace(BEARING, name="c")}, 0.01)
    found = findings(twins.assess(made))
    assert [(one.kind, one.verdict) for one in found] == [("rolling_element", "indicated")]


@pytest.mark.parametrize(("element", "verdict"), [(30.0, "not judged"), (5.0, "indicated")])
def test_an_element_explains_its_cage_in_another_band(element, verdict):
    strikes = [of_order(4.75, 4.75, "rolling_element", snr=element), line("rolling_element", 4.35, 8.0, sideband=-1)]
    strikes[1] = replace(strikes[1], expected=replace(strikes[1].expected, fundamental=False))
    cage = [of_order(0.4, 0.4, "cage", snr=14.0), of_order(0.8, 0.8, "cage", snr=9.0, harmonic=2)]
    bands = [
        BandEvidence(
            band_hz=(place, place + 1e3),
            lines=ASSESSOR.assess(lines),
            orders=np.array(orders),
            depths=np.array([0.5] * len(orders)),
            backgrounds=np.array([0.01] * len(orders)),
            bin_width=BIN,
        )
        for place, lines, orders in ((1e3, strikes, [4.35, 4.75]), (2e3, cage, [0.4, 0.8]))
    ]
    parts = bearing_evidence(bands, {"b": BEARING}, SETTING)
    found = {one.kind: one for one in bearing_verdicts(parts, false_alarm_probability=0.01, library=LIBRARY)}
    assert found["cage"].verdict == verdict


@pytest.mark.parametrize("snr", [15.0, 41.0])
def test_a_multiple_of_another_bearings_line_is_not_named(snr):
    # 18.015 is five times 3.603 of b, whose line is deeper or as deep in noise, and within slip of c's element
    strong = [of_order(3.6, 3.603, snr=40.0), of_order(7.2, 7.206, snr=20.0, harmonic=2)]
    weak = of_order(5 * 3.6 * 1.005, 5 * 3.603, "rolling_element", component="c", snr=snr)
    every = {(one.component, one.kind): one for one in judged(ASSESSOR.assess([*strong, weak]))}
    assert every["b", "outer_race"].verdict == "diagnosed"
    assert every["c", "rolling_element"].verdict == "not judged"
    assert "it is 5 times the line of outer race of b at 3.603" in every["c", "rolling_element"].doubts


@pytest.mark.parametrize(("beside", "verdict"), [(2.0, "diagnosed"), (6.0, "indicated")])
def test_a_rival_is_one_where_the_part_shows(beside, verdict):
    """Strikes on the race and of the element ring the same structure: a line of a band of its own is another source's.

    The element's line modulates the second band by 30 %; in the first, where the race's modulates by 60 %, it stands at
    10 % in noise, or at 30 %.
    """
    inner = [line("inner_race", 5.4, 12.0), line("inner_race", 6.4, 7.0, sideband=1, fundamental=False)]
    inner.append(line("inner_race", 10.8, 7.0, harmonic=2, fundamental=False))
    first = ASSESSOR.assess([*inner, line("rolling_element", 4.75, beside)])
    second = ASSESSOR.assess([line("rolling_element", 4.75, 6.0), line("inner_race", 5.4, 1.0)])
    bands = []
    for number, lines in enumerate((first, second)):
        seen = [(one.measured.line.found, one.measured.depth) for one in lines if one.measured.line.snr > 4]
        orders, depths = np.array(sorted(seen)).T
        bands.append(
            BandEvidence(
                band_hz=(1e3 * number, 1e3 * (number + 1)),
                lines=lines,
                orders=orders,
                depths=depths,
                backgrounds=0.02 * depths,
                bin_width=BIN,
            )
        )
    evidence = bearing_evidence(bands, {"b": BEARING}, SETTING)
    found = {one.kind: one for one in bearing_verdicts(evidence, false_alarm_probability=0.01, library=LIBRARY)}
    assert found["inner_race"].verdict == verdict
    assert ("of similar size" in found["inner_race"].doubts) == (verdict == "indicated")


@pytest.mark.parametrize(("off", "verdict"), [(-0.018, "diagnosed"), (0.005, "diagnosed"), (0.018, "indicated")])
def test_no_element_spins_faster_than_it_rolls(off, verdict):
    at = 4.75 * (1 + off)
    made = [of_order(4.75, at, "rolling_element"), of_order(9.5, 2 * at, "rolling_element", snr=9.0, harmonic=2)]
    made.append(line("rolling_element", at + 0.4, 9.0, sideband=1, fundamental=False))
    (found,) = findings(ASSESSOR.assess(made))
    assert found.verdict == verdict
    assert ("no element spins as fast" in found.doubts) == (verdict == "indicated")


@pytest.mark.parametrize(("race", "depth", "verdict"), [(4.0, 0.3, "not judged"), (4.0, 0.7, "indicated")])
def test_a_race_at_a_multiple_of_a_shaft_needs_more_than_shafts_make(race, depth, verdict):
    # four turns of the shaft, whose other multiples do not stand; sound machines show lines of up to 0.5 there
    made = [of_order(race, race, snr=40.0), of_order(2 * race, 2 * race, snr=30.0, harmonic=2)]
    made = [replace(one, level=40.0 / depth) for one in made]
    band = BandEvidence(
        band_hz=(1e3, 2e3),
        lines=ASSESSOR.assess(made),
        orders=np.array([race, 2 * race]),
        depths=np.array([depth, 0.75 * depth]),
        backgrounds=np.full(2, 0.01),
        bin_width=BIN,
    )
    evidence = bearing_evidence([band], {"b": BEARING}, SETTING)
    sound = HealthyMachines(records=9999, parts=9999, strengths=(0.5, 0.5))
    (found,) = bearing_verdicts(evidence, false_alarm_probability=2e-4, library=LIBRARY, at_shafts=sound)
    assert found.verdict == verdict
    assert "it stands at 4 times the order 1 of a shaft" in found.doubts


@pytest.mark.parametrize(("standing", "hidden"), [((1, 5, 7), False), (range(1, 11), True)])
def test_the_turns_of_a_race_are_no_comb_of_its_shaft(standing, hidden):
    # the inner race at six turns of the shaft that carries it through the load zone: 1, and 5 and 7 as sidebands
    orders = 0.9 * np.array(sorted({*standing, 6}))
    band = BandEvidence(
        band_hz=(1e3, 2e3),
        lines=ASSESSOR.assess([line("inner_race", 5.4, 10.0)]),
        orders=orders,
        depths=np.full(orders.size, 0.5),
        backgrounds=np.full(orders.size, 0.01),
        bin_width=BIN,
    )
    (part,) = bearing_evidence([band], {"b": BEARING}, Setting(shafts=(0.9,), speed_hz=17.0, speed_range_hz=1.0))
    assert ("6 times the order 0.9 of a shaft" in part.hidden_by) == hidden


@pytest.mark.parametrize(
    ("mesh", "hidden"),
    [
        (2.7, "2 times the order 2.7 of a mesh"),
        (2.7 + 0.4 * BIN, ""),  # near, but meshes do not slip
        (5.4 / 11, ""),  # of the eleventh healthy machines show nothing, and of a fast comb some line is near
        (0.0, ""),
    ],
)
def test_meshes_beat_at_their_multiples(mesh, hidden):
    seen = [line("inner_race", 5.4, 10.0)]
    band = BandEvidence(
        band_hz=(1e3, 2e3),
        lines=ASSESSOR.assess(seen),
        orders=np.array([5.4, 10.8]),
        depths=np.full(2, 0.5),
        backgrounds=np.full(2, 0.01),
        bin_width=BIN,
    )
    setting = Setting(shafts=(1.0,), meshes=(mesh, 23.0) if mesh else (), speed_hz=17.0)
    (part,) = bearing_evidence([band], {"b": BEARING}, setting)
    assert hidden in part.hidden_by
    assert bool(part.hidden_by) == bool(hidden)
    (part,) = bearing_evidence([band], {"b": BEARING}, replace(setting, measured=False))
    assert not part.hidden_by


@pytest.mark.parametrize(("deep", "hidden"), [(0.6, False), (0.3, True)])
def test_a_line_is_compared_with_what_it_is_in_the_same_band(deep, hidden):
    # 4.824, at 32 turns of a slow shaft, is a sideband of 4.53, two turns below, if that is the deeper one in its band
    setting = Setting(shafts=(0.15,), speed_hz=17.0, speed_range_hz=1.0)
    (own,) = ASSESSOR.assess([replace(of_order(4.824, 4.824, "rolling_element", snr=12.0), level=50.0)])
    unclaimed = replace(own, significant=False, explained_by="leakage")
    bands = [
        BandEvidence(
            band_hz=(place, place + 1e3),
            lines=[one],
            orders=np.array(orders),
            depths=np.array(depths),
            backgrounds=np.full(len(orders), 0.01),
            bin_width=BIN,
        )
        for place, one, orders, depths in (
            (1e3, own, [4.824], [0.24]),
            (2e3, unclaimed, [4.53, 4.824], [0.39, deep]),
        )
    ]
    (part,) = bearing_evidence(bands, {"b": BEARING}, setting)
    assert ("sideband" in part.hidden_by) == hidden


@pytest.mark.parametrize(("harmonic", "verdict"), [(0.05, "diagnosed"), (0.15, "indicated")])
def test_of_lines_spaced_by_the_shaft_the_one_with_the_larger_harmonic_is_the_one_that_is_modulated(harmonic, verdict):
    # a comb 3.4, 4.4, 5.4, 6.4, 7.4 whose line at 5.4 is deepest; one at 6.4 nearly so, whose double may stand out more
    lines = [
        line("inner_race", 5.4, 30.0, level=100.0),
        line("inner_race", 10.8, 8.0, harmonic=2, fundamental=False, level=100.0),
    ]
    beside = [(3.4, 0.2), (4.4, 0.24), (6.4, 0.28), (7.4, 0.2), (12.8, harmonic)]
    (found,) = [one for one in judged(ASSESSOR.assess(lines), others=beside) if one.kind == "inner_race"]
    assert found.verdict == verdict
    assert ("the line at 6.400, of which it would be a sideband" in found.doubts) == (verdict == "indicated")


def test_a_damaged_tooth_comes_before_a_bearing_as_shallow_as_sound_ones():
    def finding(component, kind, depth=np.nan, verdict="indicated"):
        return Finding(
            component=component,
            kind=kind,
            channel="a",
            verdict=verdict,
            evidence="",
            false_alarm_probability=0.001,
            snr=10.0,
            order_found=1.0,
            amplitude=1.0,
            units="g",
            strength=10.0 if kind == "tooth" else depth,
            depth=depth,
        )

    every = [
        finding("shallow", "outer_race", 0.09),
        finding("gear", "tooth"),
        finding("deep", "cage", 0.11),
        finding("sure", "inner_race", 0.11, verdict="diagnosed"),
    ]
    assert [one.component for one in named(every)] == ["sure", "deep", "gear", "shallow"]


@pytest.mark.parametrize(
    ("found", "sidebands", "hidden"), [(0.314, 2, True), (0.157, 2, True), (0.314, 0, False), (0.36, 2, False)]
)
def test_the_rates_of_a_cage_that_takes_a_damaged_element_round_are_no_part_of_another_bearing(
    found, sidebands, hidden
):
    alike = {"channel": "a", "units": "g", "amplitude": 1.0, "snr": 60.0, "bin_width": 0.007}
    alike |= {"band_low_hz": 6200.0, "band_high_hz": 7400.0}
    element = PartEvidence(
        component="b",
        kind="rolling_element",
        order=2.17,
        found=2.17,
        depth=1.3,
        strength=1.9,
        sidebands=sidebands,
        **alike,
    )
    other = PartEvidence(
        component="c", kind="rolling_element", order=found, found=found, depth=0.7, strength=0.7, **alike
    )
    bearings = {"b": replace(BEARING, name="b", cage=0.157), "c": replace(BEARING, name="c")}
    text = _of_a_stronger_part(other, [element, other], bearings)
    assert ("cage takes b rolling element round" in text) == hidden
    assert not _of_a_stronger_part(element, [element, other], bearings)


@pytest.mark.parametrize(("second", "hidden"), [(0.22, False), (0.62, True)])
def test_a_cage_is_no_sideband_of_its_own_harmonic(second, hidden):
    # three times 0.224, two sidebands of a shaft of 0.268 below it, is 0.136: within the width of the line at 0.112
    setting = Setting(shafts=(1.0, 0.268), speed_hz=20.0)
    others = _Others(
        [
            BandEvidence(
                band_hz=(1e3, 2e3),
                lines=[],
                orders=np.array([0.112, 0.224]),
                depths=np.array([0.2, second]),
                backgrounds=np.array([1e-3, 1e-3]),
                bin_width=0.0119,
            )
        ],
        setting,
    )
    why = _explanation(0.112, 0.2, others, 0)
    assert ("sideband" in why) == hidden  # of a line three times as deep it may be one
