"""What a damaged planet does to an envelope is not taken for damage of a sound bearing."""

from fractions import Fraction

import pytest

from data_synth import Scene, simulate
from hums.analysis.expected_lines import ENVELOPE, SearchPlan, expected_lines
from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import findings_table, line_table
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, load_gearbox

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


def test_a_spalled_planet_leaves_a_sound_bearing_alone():
    gearbox = Gearbox.from_mapping(GEARBOX)
    record = simulate(Scene.from_mapping(SPALLED_PLANET | {"gearbox": GEARBOX}), seed=1)
    analysis = analyze(record, gearbox, settings=AnalysisSettings(most_tracks=0, pictures=False))
    assert set(findings_table(analysis)["component"]) == {"planetary sun/planet"}
    assert set(findings_table(analysis)["kind"]) == {"tooth"}
    lines = line_table(analysis, ENVELOPE)
    cage = lines[(lines["kind"] == "cage") & (lines["harmonic"] == 1)].iloc[0]
    assert cage["explained_by"] == "it is 4 times the order 2.538 of a shaft or tooth"  # that of the planet's contacts
