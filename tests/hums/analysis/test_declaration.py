"""What is said of a sound drive whose speed, tachometer or drawing is declared wrongly: never that all is sound."""

import re

import numpy as np
import pytest

import hums

RATE_HZ, SECONDS = 6000, 10
GEARBOX = hums.load_gearbox("two-stage")
SETTINGS = hums.AnalysisSettings(most_tracks=0, pictures=False)
TEETH = (23, 23 * 19 / 67)  # orders of the two meshes
SHAFTS = (1, 23 / 67, 23 * 19 / 67 / 61)


def turns_at(times_s: np.ndarray, *, change: float) -> np.ndarray:
    """Return the turns of a shaft at 20 Hz on average, whose speed rises by this share over the record."""
    return 20 * (times_s * (1 - change / 2) + change * times_s**2 / (2 * SECONDS))


def vibration(*, change: float = 0.0, seed: int = 0) -> np.ndarray:
    """Return lines of shafts and meshes in noise, in the phase of their shaft."""
    t = np.arange(RATE_HZ * SECONDS) / RATE_HZ
    turns, rng = turns_at(t, change=change), np.random.default_rng(seed)
    x = rng.normal(0, 0.5, t.size)
    for orders, sizes in ((TEETH, (1.0, 0.5, 0.25)), (SHAFTS, (0.2, 0.1))):
        for order in orders:
            for harmonic, size in enumerate(sizes, start=1):
                x += size * np.cos(2 * np.pi * (harmonic * order * turns + rng.uniform()))
    return x


def pulses(*, change: float = 0.0, per_rev: int = 1, late_s: float = 0.0, declared: int = 1) -> hums.PulseTimes:
    t = np.linspace(0, SECONDS, 100_001)
    at = np.interp(np.arange(1, 20 * SECONDS * per_rev) / per_rev, turns_at(t, change=change), t)
    return hums.PulseTimes(times_s=at + late_s, shaft="input", pulses_per_rev=declared)


def analysed(x: np.ndarray, angle: object) -> hums.Analysis:
    record = hums.make_record({"case": x}, rate_hz=RATE_HZ, units="g", angle=angle)
    return hums.analyze(record, GEARBOX, settings=SETTINGS)


def sound_parts(analysis: hums.Analysis) -> int:
    return int((hums.verdict_table(analysis)["verdict"] == "nothing found").sum())


@pytest.mark.parametrize("change", [0.0, 0.4])
def test_the_right_declaration_is_confirmed(change):
    analysis = analysed(vibration(change=change), pulses(change=change))
    assert sound_parts(analysis) > 0
    assert not [note for note in hums.summary(analysis)["notes"] if "contradict" in note or "confirm" in note]


@pytest.mark.parametrize(("true", "declared"), [(1, 2), (4, 1), (3, 2), (3, 4)])
def test_a_wrong_number_of_pulses_is_named_with_the_right_one(true, declared):
    analysis = analysed(vibration(), pulses(per_rev=true, declared=declared))
    assert sound_parts(analysis) == 0
    assert f"pulses_per_rev={true} in place of {declared}" in hums.summary(analysis)["notes"][0]


def test_pulses_of_another_shaft_are_named_with_it():
    angle = hums.PulseTimes(times_s=pulses().times_s, shaft="intermediate", pulses_per_rev=1)
    analysis = analysed(vibration(), angle)
    assert sound_parts(analysis) == 0
    assert 'is that of "input"' in hums.summary(analysis)["notes"][0]


@pytest.mark.parametrize("off", [-0.08, 0.05])
def test_a_nominal_speed_some_per_cent_off_is_replaced_by_that_of_the_lines(off):
    analysis = analysed(vibration(), hums.NominalSpeed(rpm=1200 * (1 + off), shaft="input"))
    assert float(analysis["speed"]["speed_hz"].mean()) == pytest.approx(20, rel=1e-3)
    assert "is declared as" in hums.summary(analysis)["notes"][0]


@pytest.mark.parametrize("late_s", [0.03, -0.1])
def test_the_delay_of_a_tachometer_shows_in_a_run_up(late_s):
    analysis = analysed(vibration(change=0.4), pulses(change=0.4, late_s=late_s))
    assert sound_parts(analysis) == 0
    found = re.search(r"a tachometer that is ([\d.]+) ms (late|early)", hums.summary(analysis)["notes"][0])
    assert found is not None
    assert float(found[1]) == pytest.approx(1000 * abs(late_s), rel=0.15)
    assert found[2] == ("late" if late_s > 0 else "early")


@pytest.mark.parametrize("change", [0.0, 0.4])
def test_a_clock_that_is_off_is_named(change):
    angle = pulses(change=change)
    angle = hums.PulseTimes(times_s=angle.times_s * 1.002, shaft="input", pulses_per_rev=1)
    analysis = analysed(vibration(change=change), angle)
    assert sound_parts(analysis) == 0
    found = re.search(r"a clock that is (\d+) ppm off", hums.summary(analysis)["notes"][0])
    assert found is not None
    assert float(found[1]) == pytest.approx(2000, rel=0.25)  # in a run-up a clock is a delay that grows, too


def test_a_tachometer_is_not_doubted_where_a_second_shows_few_lines():
    """In twenty turns the lines of the second mesh and of slow shafts are not apart."""
    t = np.arange(RATE_HZ) / RATE_HZ
    x = np.random.default_rng(1).normal(0, 0.5, t.size)
    for order, size in ((23, 0.2), (46, 0.1)):
        x += size * np.cos(2 * np.pi * order * turns_at(t, change=0.0))
    angle = pulses()
    angle = hums.PulseTimes(times_s=angle.times_s[angle.times_s < 1], shaft="input", pulses_per_rev=1)
    assert not [note for note in hums.summary(analysed(x, angle))["notes"] if "confirm" in note or "lines of" in note]


def test_nothing_is_sound_at_a_nominal_speed_in_noise_alone():
    noise = np.random.default_rng(0).normal(size=RATE_HZ * SECONDS)
    analysis = analysed(noise, hums.NominalSpeed(rpm=1200, shaft="input"))
    assert sound_parts(analysis) == 0
    assert "do not confirm the speed of input" in hums.summary(analysis)["notes"][0]


def test_a_wrong_number_of_teeth_leaves_the_parts_behind_it_unjudged():
    """The wheel turns the second pinion, whose mesh then is where the record has no line; the first mesh is right."""
    wheel = hums.load_gearbox("two-stage").model_dump(mode="json", exclude_defaults=True)
    wheel["meshes"][0]["gears"][1]["teeth"] += 1
    record = hums.make_record({"case": vibration()}, rate_hz=RATE_HZ, units="g", angle=pulses())
    analysis = hums.analyze(record, hums.Gearbox.model_validate(wheel), settings=SETTINGS)
    assert 'No line of mesh "stage 2"' in hums.summary(analysis)["notes"][0]
    verdicts = hums.verdict_table(analysis)
    sound = set(verdicts["component"][verdicts["verdict"] == "nothing found"])
    assert sound == {"stage 1/pinion"}  # the line of the damaged race might be that of "input bearing" with other data


def stage(sun: int, planet: int, ring: int) -> hums.Gearbox:
    """Return a stage of three evenly spaced planets with a bearing of its carrier."""
    bearing = {"elements": 25, "element_diameter_mm": 5, "pitch_diameter_mm": 54, "contact_angle_deg": 15}
    return hums.Gearbox.from_mapping(
        {
            "name": "stage",
            "frame": "housing",
            "reference": "sun",
            "rigid": [["housing", "ring"]],
            "axes": {
                "main": ["housing", "sun", "ring", "carrier"],
                "planet": {"links": ["carrier", "planet"], "copies": 3},
            },
            "mesh": [{"teeth": {"sun": sun, "planet": planet}}, {"teeth": {"planet": planet, "ring": -ring}}],
            "bearing": [{"names": ["carrier bearing"], "inner_ring": "carrier", "outer_ring": "housing", **bearing}],
        }
    )


@pytest.mark.parametrize(("teeth", "sides"), [((27, 36, 99), (0,)), ((20, 31, 82), (-1, 2))])
def test_a_stage_is_judged_where_its_mesh_or_the_passes_next_to_it_show(teeth, sides):
    t = np.arange(RATE_HZ * SECONDS) / RATE_HZ
    turns, carrier = turns_at(t, change=0.0), teeth[0] / (teeth[0] + teeth[2])
    shaft = np.random.default_rng(0).normal(0, 0.5, t.size)
    shaft += 0.2 * sum(np.cos(2 * np.pi * harmonic * turns) for harmonic in (1, 2, 3))
    # of three planets, only orders of the carrier that are multiples of three remain
    mesh = sum(np.cos(2 * np.pi * (teeth[2] + side) * carrier * turns + side) for side in sides)
    angle = hums.PulseTimes(times_s=pulses().times_s, shaft="sun", pulses_per_rev=1)
    records = [hums.make_record({"case": x}, rate_hz=RATE_HZ, units="g", angle=angle) for x in (shaft + mesh, shaft)]
    analyses = [hums.analyze(record, stage(*teeth), settings=SETTINGS) for record in records]
    assert sound_parts(analyses[0]) > 0
    assert sound_parts(analyses[1]) == 0
