"""Hand-made lines and peaks: what is significant, whose comb explains a line, and what is said of each part."""

from dataclasses import replace

import numpy as np
import pytest

from hums.analysis.combs import Part, Peaks, Setting, claims
from hums.analysis.evidence import BandEvidence, assessed_lines, bearing_evidence
from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM, ExpectedLine, MeasuredLine
from hums.analysis.findings import bearing_verdicts
from hums.analysis.healthy_machines import HealthyMachines
from hums.gearbox.bearing_catalogue import BearingOrders
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
OTHER = replace(BEARING, name="d", inner_race=6.1, outer_race=3.9, rolling_element=5.2, cage=0.39, cage_to_outer=0.39)
BEARINGS = {"b": BEARING, "c": replace(BEARING, name="c"), "d": OTHER}
LIBRARY = HealthyMachines(records=9999, parts=9999, strengths=(0.005,))
SETTING = Setting(shafts=(1.0,), speed_hz=17.0, speed_range_hz=1.0)


def line(
    kind,
    found,
    snr,
    *,
    of="b",
    k=1,
    side=0,
    order=None,
    spacing=0.0,
    level=20.0,
    p=None,
    main=None,
    spectrum="",
    **measured,
):
    """A line of an envelope of this level, over a background of 1; of a tooth `side` is in the order spectrum."""
    spectrum = ORDER_SPECTRUM if kind in {"gear_mesh", "tooth"} and main is None else ENVELOPE
    main = (k == 1 and not side) or spectrum == ORDER_SPECTRUM if main is None else main
    return MeasuredLine(
        expected=ExpectedLine(
            component=of,
            kind=kind,
            harmonic=k,
            sideband=side,
            order=order or found,
            tolerance=0.1,
            spectrum=spectrum,
            spacing=spacing,
            fundamental=main,
        ),
        channel="x",
        units="g",
        bin_width=BIN,
        line=Line(
            **{"leakage": 0.0} | measured,
            expected=found,
            found=found,
            amplitude=snr,
            amplitude_std=0.5,
            background=1.0,
            false_alarm_probability=p or (1e-9 if snr > 4 else 0.5),
        ),
        level=level if spectrum == ENVELOPE else 0.0,
    )


def family(kind, order, snr, higher, *, at=None, of="b", **about):
    """A line and, if they have a level, its second to fifth harmonic."""
    at = at or order
    lines = [line(kind, at, snr, of=of, order=order, **about)]
    return lines + [line(kind, k * at, higher, of=of, order=k * order, k=k, **about) for k in range(2, 6) if higher]


def inner(snr=10.0, second=0.0, sideband=0.0, **about):
    """An inner race with harmonics, and a sideband one turn of the shaft above it."""
    beside = [line("inner_race", 6.4, sideband, side=1, **about)] if sideband else []
    return family("inner_race", 5.4, snr, second, **about) + beside


def outer(snr=10.0, second=9.0, at=None, order=3.6, **about):
    return family("outer_race", order, snr, second, at=at or 3.6, **about)


def element(at=4.75, snr=20.0, second=9.0, **about):
    return family("rolling_element", 4.75, snr, second, at=at, **about)


def cage(snr=17.0, second=12.0):
    return family("cage", 0.4, snr, second)


# ---- What is significant, and what explains a line -------------------------------------------------------------------


def significance(*lines, parts=(), **given):
    """Return the last of some lines as assessed."""
    given = {"false_alarm_probability": 0.01, "healthy_spacings": {}} | given
    return assessed_lines(lines, parts, **given)[-1]


MESH = replace(line("gear_mesh", 20.0, 30.0, of="m"), level=0.0)
# lines; of the last of them, what explains it: None where it is significant, "" where it is not detected or alone
ASSESSED = {
    "noise": ([line("inner_race", 5.4, 2.0)], ""),
    "0.002 once": ([line("inner_race", 5.4, 9.0, p=0.002)], None),
    "0.002 among ten": ([*[line("cage", 30 + n, 1.0) for n in range(9)], line("inner_race", 5.4, 9.0, p=0.002)], ""),
    "0.0005 in one band": ([line("inner_race", 5.4, 9.0, p=0.0005)], None),
    "0.0005 in thirty": ([replace(line("inner_race", 5.4, 9.0, p=0.0005), searches=30)], ""),  # 0.0149
    "edge of the search": ([line("inner_race", 5.4, 9.0, at_edge=True)], "the flank of a peak outside"),
    "harmonic": ([*inner(), line("inner_race", 10.8, 8.0, k=2)], None),
    "harmonic alone": ([line("outer_race", 7.2, 20.0, k=2)], ""),
    "wrong spacing": ([*inner(), line("inner_race", 10.85, 8.0, k=2)], ""),
    "more than half leakage": ([line("tooth", 21.0, 9.0, of="m/g", side=1, leakage=5.0)], "the flank of a stronger"),
    "less than half leakage": ([line("tooth", 21.0, 9.0, of="m/g", side=1, leakage=4.0)], None),
    "sideband of a mesh": ([MESH, line("tooth", 21.0, 10.0, of="m/g", side=1)], None),
    "sideband off its mesh": ([MESH, line("tooth", 21.03, 10.0, of="m/g", side=1, order=21.0)], "off the sidebands of"),
    "sideband at another mesh": ([line("gear_mesh", 21.0, 30.0, of="n"), line("tooth", 21.0, 10.0, of="m/g", side=1)],
        "coincides with n gear mesh"),
}  # fmt: skip


@pytest.mark.parametrize(("lines", "by"), ASSESSED.values(), ids=ASSESSED)
def test_a_line_is_significant_or_explained(lines, by):
    last = significance(*lines)
    assert last.significant == (by is None)
    assert (by or "") in last.explained_by


def test_natural_sidebands_of_a_planetary_stage():
    spaced, off = (line("tooth", at, 50.0, of="m/g", side=-1, spacing=99.0 - at) for at in (96.0, 97.0))
    healthy = {"m/g": (3.0,)}
    assert not significance(spaced, healthy_spacings=healthy).significant
    assert significance(spaced, off, healthy_spacings=healthy).significant


# ---- Whose comb explains a line --------------------------------------------------------------------------------------


def peaks(*placed, background=0.001):
    orders, depths = np.array(sorted(placed)).T
    return Peaks(orders=orders, depths=depths, backgrounds=np.full(orders.size, background), bin_width=BIN)


def comb(order, depth=0.3, spacing=0.0, harmonics=5):
    """Return the peaks of damage that strikes at an order, modulated at a rate."""
    found = [(k * order, depth / k**0.5) for k in range(1, harmonics + 1)]
    return found + [(k * order + side * spacing, depth / 2) for k in (1, 2) for side in (-1, 1) if spacing]


RACE, ELSE = ("b", "outer_race"), ("d", "inner_race")
DRAWN = {RACE: Part(order=3.58, tolerance=0.07), ELSE: Part(order=5.4, tolerance=0.1, spacings=(1.0,))}
SHAFT = Setting(shafts=(1.0,), speed_hz=17.0, speed_range_hz=1.0)
STEADY = replace(SHAFT, speed_hz=100 / 3.58, speed_range_hz=0.0)
# peaks, setting, part, and what explains its line: "" where its own comb does
WHOSE = {
    "its own": (comb(3.58), SHAFT, RACE, ""),
    "with sidebands": (comb(5.4, spacing=1.0), SHAFT, ELSE, ""),
    "off its order": (comb(3.54), SHAFT, RACE, ""),
    "beside a comb of a shaft": ([*comb(3.58), *((k, 0.4) for k in range(1, 20))], SHAFT, RACE, ""),
    "of a shaft": ([(0.36 * k, 0.3) for k in range(1, 31)], replace(SHAFT, shafts=(0.36, 1.0)), ELSE,
        "15 times the order 0.36 of a shaft or tooth"),
    "mains": ([(3.58, 0.3)], STEADY, RACE, "100.00 Hz is 2 times mains of 50 Hz"),
    "mains at a speed that changes": (comb(3.58), replace(STEADY, speed_range_hz=1.0), RACE, ""),
    "harmonic of another machine": (comb(1.79, harmonics=9), SHAFT, RACE, "the lines of 1.790 orders"),
    "sideband of another machine": ([*comb(4.58, 0.6, spacing=1.0), *comb(2.58, 0.4)], SHAFT, RACE,
        "the lines of"),
    "harmonic of a part": (comb(1.8, harmonics=9), SHAFT, ("e", "outer_race"), "the lines of d inner race"),
}  # fmt: skip


@pytest.mark.parametrize(("placed", "setting", "part", "by"), WHOSE.values(), ids=WHOSE)
def test_the_best_comb_explains_a_line(placed, setting, part, by):
    drawn = DRAWN
    if part not in drawn:
        drawn = {ELSE: Part(order=1.8, tolerance=0.03), part: Part(order=5.4, tolerance=0.1)}
    found = claims(peaks(*placed), drawn, setting)[part]
    assert by in found.explained_by
    assert bool(found.explained_by) == bool(by)


def test_the_score_of_a_lone_line_by_hand():
    # one peak of 0.3 at its order, no other within a factor of 1.6; its harmonics would be seen, and are not
    only = Peaks(orders=np.array([3.6, 40.0]), depths=np.array([0.3, 0.3]), backgrounds=np.full(2, 1e-4), bin_width=BIN)
    found = claims(only, {RACE: Part(order=3.618, tolerance=0.07)}, replace(SHAFT, shafts=(7.0,)))[RACE]

    def accident(order, k):  # half a peak in orders from order / 1.6 to 1.6 order, within 2.5 bins on either side
        return max(1e-3, 2 * 2.5 * BIN * k**0.5 * 0.5 / (order * (1.6 - 1 / 1.6)))

    first = np.log(0.95 / accident(3.6, 1))
    # the peak at 40 is no harmonic, but within a factor of 1.6 of none of the four either
    missing = sum(np.log((1 - q) / (1 - accident(3.6 * k, k))) for k, q in ((2, 0.9), (3, 0.7), (4, 0.7), (5, 0.7)))
    strength = 0.3  # a background of 0.0001 takes nothing off
    by_hand = first + missing - (0.018 / 3.618) / 0.005 + 2 * np.log(strength / 0.01)
    assert found.score == pytest.approx(by_hand, abs=1e-3)


def test_a_line_that_two_parts_share_is_that_of_the_better_comb():
    # at 4.3 both may stand; the element would have sidebands, and the race at rest has none
    element = Part(order=4.295, tolerance=0.08, spacings=(0.4,))
    drawn = {("b", "rolling_element"): element, RACE: Part(order=4.32, tolerance=0.08)}
    found = claims(peaks(*comb(4.3)), drawn, SHAFT)
    assert not found[RACE].explained_by
    assert "it coincides with b outer race" in found["b", "rolling_element"].explained_by


def test_what_noise_would_hide_is_not_missing():
    # 4 times the background is a peak: harmonics of a line of 0.02 show from 0.005 on, below a background of 0.004
    part = {RACE: Part(order=3.6, tolerance=0.07)}
    quiet, noisy = (claims(peaks((3.6, 0.02), (30.0, 0.02), background=b), part, SHAFT)[RACE] for b in (1e-5, 4.9e-3))
    assert quiet.score < noisy.score + 2 * np.log(quiet.strength / noisy.strength) - 1


# ---- What is said of each part ---------------------------------------------------------------------------------------


def band(lines, peaks=(), *, noise=0.02, place=1e3, width=1e3, bin_width=BIN):
    """What one band shows: the lines, and peaks (order, depth) besides, their background over their depth."""
    own = [(one.line.found, one.depth) for one in lines if one.line.snr > 4]
    orders, depths = np.array(sorted({*own, *peaks})).reshape(-1, 2).T
    return BandEvidence(
        band_hz=(place, place + width),
        lines=lines,
        orders=orders,
        depths=depths,
        backgrounds=noise * depths,
        bin_width=bin_width,
    )


def judged(lines, peaks=(), *, setting=SETTING, noise=0.02, bin_width=BIN, bearings=BEARINGS, **given):
    """Return the verdict on each part whose line was measured, by component and kind."""
    bands = [band(lines, peaks, noise=noise, bin_width=bin_width)]
    evidence, _ = bearing_evidence(bands, bearings, setting)
    given = {"false_alarm_probability": 0.01, "library": LIBRARY} | given
    return {(one.component, one.kind): one for one in bearing_verdicts(evidence, **given)}


def shown_by(parts):
    """Return a library of 99 healthy parts, of which so many show a score of 20, one of 8, the others none."""
    return HealthyMachines(records=99, parts=99, strengths=(*(20.0,) * parts, 8.0))


INNER, OUTER, ELEMENT, CAGE = ("b", "inner_race"), ("b", "outer_race"), ("b", "rolling_element"), ("b", "cage")
SLOW = Setting(shafts=(0.15, 1.0), speed_hz=17.0, speed_range_hz=1.0)
MAINS = replace(SETTING, speed_hz=100 / 3.6, speed_range_hz=0.0)  # an outer race at twice 50 Hz
BOTH = [*inner(12, 9, 9, level=100.0), *outer(11, level=100.0)]
# lines, what else is given, the part, its verdict, and what is said of it
JUDGED = {
    "supported": (inner(second=7, sideband=7), {}, INNER, "diagnosed", "sideband +1"),
    "faulty sensor": (inner(second=7, sideband=7), {"faulty": ["x"]}, INNER, "not judged", "the sensor is faulty"),
    "alone": (outer(second=0), {}, OUTER, "not judged", "of noise or damage, modulates a band by 49%"),
    "shallow": (inner(9, 5, level=100.0), {}, INNER, "indicated", "it modulates the band by only 9.0%"),
    "no sideband": (inner(second=7), {}, INNER, "indicated", "no sidebands from passing the load zone"),
    "no sideband of a race at rest": (inner(second=7),
        {"bearings": {"b": replace(BEARING, inner_ring=0.0, outer_ring=1.0)}}, INNER, "diagnosed", ""),
    "no sideband of an outer race that turns": (outer(second=7),
        {"bearings": {"b": replace(BEARING, inner_ring=0.0, outer_ring=1.0)}}, OUTER, "indicated",
        "no sidebands from passing the load zone"),
    "harmonic that slip moves": (outer(at=3.53, second=0), {"peaks": [(0.44 * k, 0.9 / k) for k in range(1, 8)]}, OUTER,
        "not judged", "the lines of 0.440 orders"),
    "both races": ([*inner(10, 7), *outer(9, 7)], {}, OUTER, "indicated", "of similar size"),
    "both races, shallow": (BOTH, {}, INNER, "not judged", "the outer race is of similar size (11.0%)"),
    "harmonic of a deeper line": (inner(second=7), {"peaks": [(2.7, 0.9), (8.1, 0.4), (13.5, 0.3)]}, INNER,
        "not judged", "the lines of 2.700 orders"),
    "shallower line": (inner(second=7), {"peaks": [(4.4, 0.3)]}, INNER, "diagnosed", ""),
    "stronger line": (inner(second=7, sideband=7), {"peaks": [(7.1, 0.9)]}, INNER, "diagnosed", ""),
    "change of level": (inner(second=7, sideband=7), {"peaks": [(0.15, 0.9)]}, INNER, "diagnosed", ""),
    "comb of a slow shaft": (outer(at=5.4, order=5.4, second=0),
        {"peaks": [(0.15 * k, 0.5) for k in range(1, 11)], "setting": SLOW}, OUTER, "not judged",
        ""),
    "mains": (outer(second=0), {"setting": MAINS}, OUTER, "not judged", "100.00 Hz is 2 times mains of 50 Hz"),
    "mains at a speed that changes": (outer(), {"setting": replace(MAINS, speed_range_hz=1.0)}, OUTER, "diagnosed",
        ""),
    "tooth": (outer(30, 0, level=150.0), {"peaks": [(3.6 * k, 0.25) for k in range(2, 9)],
        "setting": replace(SETTING, shafts=(1.0, 3.6))}, OUTER, "not judged", "1 times the order 3.6 of a shaft"),
    "unseen": (inner(2), {}, INNER, "not judged", "a modulation of 13.2% may go undetected"),
         # 2 + 1.282 x 0.5 of 20
    "seen to be absent": (inner(2, level=60.0), {}, INNER, "nothing found", ""),
    # a score of 12, which 2 to 3 and 10 to 11 of a hundred healthy parts have
    "rare in health": (inner(30, sideband=9, level=750.0), {"library": shown_by(1)}, INNER, "not judged",
        "too few to call it sound"),
    "common in health": (inner(30, sideband=9, level=750.0), {"library": shown_by(9)}, INNER, "nothing found", ""),
    "cage": (cage(), {}, CAGE, "indicated", "damage to a rolling element also produces this line"),
    "cage of an outer race": ([*outer(14), line("cage", 0.4, 9.0)], {}, OUTER, "diagnosed", ""),
    "nearer of two": ([*outer(20, at=3.602, of="c"), *outer(20, at=3.602, order=3.66)], {}, ("c", "outer_race"),
        "diagnosed", ""),
    "between two": ([*outer(20, at=3.602, of="c"), *outer(20, at=3.602, order=3.612)], {}, ("c", "outer_race"),
        "indicated", "the outer race of b, of order 3.612, may also produce this line"),
    "element that slips": ([*element(4.66), line("rolling_element", 5.06, 9.0, side=1)], {}, ELEMENT, "diagnosed",
        ""),
    "element faster than it rolls": ([*element(4.84), line("rolling_element", 5.24, 9.0, side=1)], {}, ELEMENT,
        "not judged", "may go undetected"),
}  # fmt: skip


@pytest.mark.parametrize(("lines", "given", "part", "verdict", "said"), JUDGED.values(), ids=JUDGED)
def test_a_verdict_and_what_is_said(lines, given, part, verdict, said):
    found = judged(lines, **given)[part]
    assert found.verdict == verdict
    assert said in f"{found.evidence} {found.doubts}"


def test_equal_bearings_are_named_together():
    # two of the same bearing on one shaft: nothing in the record tells one from the other
    found = judged([*outer(20), *outer(20, of="c")])
    assert sorted(one.verdict for one in found.values()) == ["indicated", "not judged"]
    (one,) = (one for one in found.values() if one.verdict == "indicated")
    (other,) = {"b", "c"} - {one.component}
    assert f"it may be {other}, which has the same orders" in one.doubts
    assert one.next_step == f"Inspect {one.component} and {other}."


@pytest.mark.parametrize("seen", [0.5, 1.0, 2.0, 4.0])
def test_a_deeper_line_would_have_been_larger_in_nine_of_ten_records(seen):
    (part,), _ = bearing_evidence([band(inner(seen))], BEARINGS, SETTING)
    rng = np.random.default_rng(3)
    noise = 0.5 * (rng.standard_normal(100_000) + 1j * rng.standard_normal(100_000))
    as_small = np.mean(np.abs(20 * part.possible_depth + noise) <= seen)
    assert as_small <= 0.1 + 3 * 0.00095  # the deviation of a share of 0.1 of 100,000
    assert as_small > 0.01  # and not by far


@pytest.mark.parametrize(("beside", "verdict"), [(2.0, "diagnosed"), (6.0, "indicated")])
def test_a_rival_is_one_where_the_part_shows(beside, verdict):
    """Strikes on the race and of the element ring the same structure: a line of a band of its own is another source's.

    The element's line modulates the second band by 30 %; in the first, where the race's modulates by 60 %, it stands at
    10 % in noise, or at 30 %.
    """
    first = band([*inner(12, 7, 7), line("rolling_element", 4.75, beside)])
    second = band([line("rolling_element", 4.75, 6.0), *inner(1)], place=2e3)
    evidence, _ = bearing_evidence([first, second], BEARINGS, SETTING)
    found = {one.kind: one for one in bearing_verdicts(evidence, false_alarm_probability=0.01, library=LIBRARY)}
    assert found["inner_race"].verdict == verdict
