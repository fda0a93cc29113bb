"""The uncertainty of the tracks is the real one, and a line of constant frequency is no component's."""

import pytest

from data_synth import Scene, load_scene, simulate
from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import verdict_table
from hums.analysis.settings import AnalysisError
from hums.gearbox.model import load_gearbox
from hums.scoring import score

HEALTHY = {
    "gearbox": "two-stage",
    "rate_hz": 6000,
    "duration_s": 4,
    "fidelity": "kinematic",
    "speed": {"link": "input", "rpm": [[0, 1400], [4, 1500]]},
    "torque": {"link": "output", "nm": [[0, 400], [4, 500]]},
    "tachometer": {"link": "input", "pulses_per_rev": 1},
    "noise": {"rms": 0.3},
    "sensor": [{"name": "housing", "on": "input bearing", "direction": [0, 0, 1], "units": "g"}],
}
SETTINGS = AnalysisSettings(false_alarm_probability=0.05, most_tracks=0, pictures=False)
DEMO_SETTINGS = AnalysisSettings(envelope_band_hz=(6000.0, 10000.0), pictures=False)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_uncertainty_of_the_demo_is_the_real_one(seed):
    record = simulate(load_scene("demo"), seed=seed)
    analysis = analyze(record, load_gearbox("two-stage"), settings=DEMO_SETTINGS)
    result = score(analysis, record)
    assert 0.8 < result.normalised_rms < 1.25
    assert result.tracks["std"].median() < 0.05 * result.tracks["true_amplitude"].max()
    verdicts = dict(zip(result.faults["kind"], result.faults["verdict"], strict=True))
    # a single pitch deviation of a sound gear looks like a cracked tooth, so that one record cannot be certain of it
    assert verdicts == {"inner_race": "diagnosed", "tooth": "indicated"}
    assert result.false_findings == ()


def test_a_record_without_truth_has_no_score():
    record = simulate(Scene.from_mapping(HEALTHY | {"duration_s": 1}), seed=0)
    analysis = analyze(record, load_gearbox("two-stage"))
    bare = record.drop_vars([name for name in record.data_vars if str(name).startswith("truth_")])
    with pytest.raises(AnalysisError, match="no truth_amplitude"):
        score(analysis, bare)


def verdict_of_the_outer_race(**changes):
    table = {**HEALTHY, "rate_hz": 20_000, "duration_s": 8, "torque": {"link": "output", "nm": 400}, **changes}
    table |= {"noise": {"rms": 0.03}, "excitation": {"mesh_amplitude": 0.1}}
    record = simulate(Scene.from_mapping(table), seed=2)
    verdicts = verdict_table(analyze(record, load_gearbox("two-stage"), settings=SETTINGS))
    return verdicts.set_index(["component", "kind"]).loc[("input bearing", "outer_race")]


def test_a_neighbour_that_follows_the_clock_is_no_part():
    rpm = 1450
    order = float(Scene.from_mapping(HEALTHY).orders["input bearing", "outer_race"])
    struck = {"speed_hz": 10.0, "impacts_per_rev": order * rpm / 60 / 10.0, "frequency_hz": 5000, "impact_m_s2": 3.0}
    neighbour = {"imperfections": {"neighbour": struck}}
    own = {"fault": [{"kind": "outer_race", "component": "input bearing", "size_mm": 0.5}]}
    steady = {"link": "input", "rpm": rpm}
    wandering = {**steady, "turbulence": {"rms": 6.0, "time_scale_s": 1.0}}  # by 0.4 %
    found = verdict_of_the_outer_race(speed=wandering, **neighbour)
    assert found.verdict == "not judged"
    assert f"its frequency is constant: at {order * rpm / 60:.2f} Hz" in found.doubts
    assert verdict_of_the_outer_race(speed=wandering, **own).verdict == "diagnosed"
    # at a constant speed one record cannot tell them apart
    assert {verdict_of_the_outer_race(speed=steady, **each).verdict for each in (own, neighbour)} == {"diagnosed"}
