"""What a damaged planet does to an envelope is not taken for damage of a sound bearing."""

from fractions import Fraction

import pytest

from data_synth import Scene, simulate
from hums.analysis.analyze import AnalysisSettings, analyze
from hums.analysis.detection import LineAssessor
from hums.analysis.lines import ENVELOPE, ExpectedLine, MeasuredLine, SearchPlan, expected_lines
from hums.analysis.result import findings_table, line_table
from hums.gearbox.bearing_orders import BearingOrders
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, load_gearbox
from signals.spectra.lines import Line

BIN = 0.01
TOOTH_RATE = Fraction(33, 13)  # 99 teeth of the ring pass a planet's 39 at one turn of the carrier: 99 / 39
GEARBOX = {
    "name": "wind",
    "frame": "housing",
    "reference": "carrier",
    "rigid": [["housing", "ring"], ["sun", "wheel"]],
    "axes": {
        "main": ["housing", "carrier", "sun", "ring"],
        "planet": {"links": ["carrier", "planet"], "copies": 3},
        "hss": ["housing", "hss"],
    },
    "mesh": [
        {"name": "planetary sun", "teeth": {"sun": 21, "planet": 39}},
        {"name": "planetary ring", "teeth": {"planet": 39, "ring": -99}},
        {"name": "hs stage", "teeth": {"wheel": 97, "hss": 23}},
    ],
    "bearing": [
        {
            "names": ["hss bearing"],
            "inner_ring": "hss",
            "outer_ring": "housing",
            "elements": 15,
            "element_diameter_mm": 20,
            "pitch_diameter_mm": 120,
            "contact_angle_deg": 15,
        }
    ],
}
SPALLED_PLANET = {
    "rate_hz": 25600,
    "duration_s": 12,
    "fidelity": "kinematic",
    "speed": {"link": "hss", "rpm": [[0, 1400], [12, 1520]]},
    "torque": {"link": "hss", "nm": [[0, 800], [12, 1000]]},
    "tachometer": {"link": "hss", "pulses_per_rev": 4},
    "excitation": {"shaft_amplitude": 0.05, "mesh_amplitude": 0.5, "harmonics": 3, "decay": 0.5},
    "resonance": {"frequency_hz": 6000, "damping_ratio": 0.03},
    "noise": {"rms": 0.1},
    "fault": [{"kind": "spall", "component": "planetary sun/planet", "size_mm": 2.0}],
    "sensor": [{"name": "ring", "on": "ring", "units": "g"}],
}
CAGE = 4 * float(TOOTH_RATE)  # half a percent beside the cage of the bearing, within its slip
BEARING = BearingOrders(
    name="b",
    relative=24.1,
    inner_ring=24.1,
    outer_ring=0.0,
    inner_race=209.8,
    outer_race=151.7,
    rolling_element=140.8,
    cage=10.11,
    cage_to_outer=10.11,
    elements=15,
)


def line(component, kind, order, snr, *, harmonic=1, fundamental=False):
    expected = ExpectedLine(
        component=component,
        kind=kind,
        harmonic=harmonic,
        sideband=0,
        order=order,
        tolerance=0.0 if kind == "tooth" else 0.1,
        spectrum=ENVELOPE,
        fundamental=fundamental,
    )
    found = Line(
        expected=order,
        found=order,
        amplitude=snr,
        amplitude_std=0.5,
        background=1.0,
        leakage=0.0,
        false_alarm_probability=1e-9,
    )
    return MeasuredLine(expected=expected, channel="x", units="g", bin_width=BIN, line=found)


def comb(snr):
    return [line("m/planet", "tooth", k * float(TOOTH_RATE), snr, harmonic=k) for k in (1, 2, 3)]


def test_tooth_rates_that_are_no_shafts_own_are_looked_for_in_the_envelope():
    plan = SearchPlan(harmonics=2, sidebands=1, slip=0.02, speed_tolerance=0.0, envelope=True)
    expected = expected_lines(solve_kinematics(Gearbox.from_mapping(GEARBOX)), plan)
    teeth = [w for w in expected if w.spectrum == ENVELOPE and w.kind in {"tooth", "planet_tooth"}]
    # sun against carrier 40/7 - 1 = 33/7, met by three planets; ring 3; either flank of a planet 2 x 33/13
    rates = [Fraction(99, 7), TOOTH_RATE, Fraction(3), 2 * TOOTH_RATE]
    assert [w.order for w in teeth if w.harmonic == 1] == pytest.approx([float(rate) for rate in rates], rel=1e-12)
    assert not any(w.fundamental for w in teeth)


def test_gears_about_fixed_axes_add_no_line():
    plan = SearchPlan(harmonics=3, sidebands=3, slip=0.02, speed_tolerance=0.0, envelope=True)
    expected = expected_lines(solve_kinematics(load_gearbox("two-stage")), plan)
    assert not any(w.spectrum == ENVELOPE and w.kind in {"tooth", "planet_tooth"} for w in expected)


@pytest.mark.parametrize(("kind", "order", "multiple"), [("cage", CAGE, 4), ("outer_race", 59 * float(TOOTH_RATE), 59)])
def test_multiples_of_a_stronger_tooth_rate_are_no_bearing(kind, order, multiple):
    assessed = LineAssessor({"b": BEARING}, 0.01).assess([line("b", kind, order, 42.0, fundamental=True), *comb(40.0)])
    assert not assessed[0].significant
    assert assessed[0].explained_by == f"harmonic {multiple} of m/planet tooth"


@pytest.mark.parametrize(("bins", "explained"), [(3.9, False), (4.1, True)])
def test_a_comb_that_the_record_does_not_resolve_explains_nothing(bins, explained):
    # every order is within two bins of a multiple of less than four
    rate = bins * BIN
    slow = [line("m/planet", "tooth", k * rate, 40.0, harmonic=k) for k in (1, 2, 3)]
    own = line("b", "outer_race", 90 * rate, 42.0, fundamental=True)
    (assessed, *_) = LineAssessor({"b": BEARING}, 0.01).assess([own, *slow])
    assert bool(assessed.explained_by) == explained


def test_beside_a_multiple_or_above_the_teeth_a_bearing_line_stands():
    beside = line("b", "cage", CAGE + 2.5 * BIN, 42.0, fundamental=True)
    stronger = line("b", "cage", CAGE, 121.0, fundamental=True)  # more than three times as high as lines of 40
    for own in (beside, stronger):
        assert LineAssessor({"b": BEARING}, 0.01).assess([own, *comb(40.0)])[0].significant


def test_a_spalled_planet_leaves_a_sound_bearing_alone():
    gearbox = Gearbox.from_mapping(GEARBOX)
    record = simulate(Scene.from_mapping(SPALLED_PLANET | {"gearbox": GEARBOX}), seed=1)
    analysis = analyze(record, gearbox, settings=AnalysisSettings(most_tracks=0))
    assert set(findings_table(analysis)["component"]) == {"planetary sun/planet"}
    assert set(findings_table(analysis)["kind"]) == {"tooth"}
    lines = line_table(analysis, ENVELOPE)
    cage = lines[(lines["kind"] == "cage") & (lines["harmonic"] == 1)].iloc[0]
    tellers = {"harmonic 4 of planetary sun/planet tooth", "harmonic 2 of planet planet tooth"}  # one order
    assert cage["explained_by"] in tellers
