"""Condition indicators of a whole analysis: each from the right signal, held to closed forms and to plain numpy."""

import json

import numpy as np
import pytest
from scipy.stats import kurtosis

from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import health_table, indicator_table, open_analysis, save_analysis, summary
from hums.analysis.settings import AnalysisError
from hums.gearbox.defect_orders import defects
from hums.gearbox.model import Gearbox, GearboxWarning, load_gearbox
from hums.records.record import Channel, PulseTimes, make_record

RATE_HZ, SPEED_HZ, SECONDS = 5000.0, 20.0, 8.0
INTERMEDIATE = 23 / 67  # turns of the intermediate shaft to one of the input
BARE = AnalysisSettings(most_tracks=0, envelope_band_hz=None, pictures=False)


def record_of(values, *, units="g", shaft="input", speed_hz=SPEED_HZ, rate_hz=RATE_HZ, name="housing"):
    seconds = values.size / rate_hz
    pulses = PulseTimes(times_s=np.arange(0.0, seconds, 1 / speed_hz), shaft=shaft, pulses_per_rev=1)
    return make_record({name: Channel(values=values, units=units)}, rate_hz=rate_hz, angle=pulses)


def over_turns(function, *, noise=1e-3, seconds=SECONDS, seed=0):
    """Values of a function of the input shaft's turns, with a little noise."""
    turns = SPEED_HZ * np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return function(turns) + np.random.default_rng(seed).normal(0, noise, turns.size)


def cosine(order, amplitude, turns):
    return amplitude * np.cos(2 * np.pi * order * turns)


def value(analysis, component, indicator, *, kind=None):
    table = indicator_table(analysis)
    mine = table[(table["component"] == component) & (table["indicator"] == indicator)]
    mine = mine[mine["kind"] == kind] if kind else mine
    (row,) = mine.itertuples()
    return row


@pytest.fixture(scope="module")
def gearbox():
    return load_gearbox("two-stage")


@pytest.fixture(scope="module")
def modulated(gearbox):
    """Unbalance of two shafts, a mesh modulated by its pinion by 0.4, and a second mesh: all amplitudes known."""

    def sound(turns):
        mesh = (1 + cosine(1, 0.4, turns)) * cosine(23, 0.5, turns) + cosine(46, 0.2, turns) + cosine(69, 0.1, turns)
        mesh = mesh + cosine(19 * INTERMEDIATE, 0.4, turns)  # of the second stage, among the sidebands of the first
        return mesh + cosine(1, 0.3, turns) + cosine(2, 0.05, turns) + cosine(INTERMEDIATE, 0.25, turns)

    values = over_turns(sound)
    return values, analyze(record_of(values), gearbox, settings=BARE)


def test_raw_indicators_are_those_of_numpy(modulated):
    values, analysis = modulated
    assert value(analysis, "record", "rms").value == pytest.approx(values.std(), rel=1e-12)
    assert value(analysis, "record", "peak").value == pytest.approx(np.abs(values - values.mean()).max(), rel=1e-12)
    assert value(analysis, "record", "kurtosis").value == pytest.approx(kurtosis(values, fisher=False), rel=1e-9)


@pytest.mark.parametrize(
    ("component", "indicator", "expected"),
    [
        ("input", "so1", 0.3),
        ("input", "so2", 0.05),
        ("input", "so3", 0.0),
        ("intermediate", "so1", 0.25),
        ("intermediate", "so2", 0.0),
        ("stage 1/pinion", "sideband_index", 0.4 * 0.5 / 2),  # each sideband of 1 + m cos has half of m
        ("stage 1/pinion", "amplitude_modulation", 0.4),
        ("stage 1/pinion", "phase_modulation", 0.0),
        ("stage 1/intermediate", "amplitude_modulation", 0.0),
    ],
)
def test_shafts_and_gears_at_known_amplitudes(modulated, component, indicator, expected):
    # averages of 134 and 46 turns, twice the 67 and the 23 in which all of the other shaft's orders cancel
    assert value(modulated[1], component, indicator).value == pytest.approx(expected, abs=0.002)


def test_fm0_is_peak_to_peak_over_the_mesh(gearbox):
    turns = np.linspace(0, 1, 20001)
    mesh = cosine(23, 0.5, turns) + cosine(46, 0.2, turns)
    values = over_turns(lambda t: cosine(23, 0.5, t) + cosine(46, 0.2, t), noise=1e-6)
    found = value(analyze(record_of(values), gearbox, settings=BARE), "stage 1/pinion", "fm0")
    # the grid of the average misses the summit of order 46 by at most 0.5 %
    assert found.value == pytest.approx(np.ptp(mesh) / 0.7, rel=0.01)
    assert found.takes == "average of 134 revolutions"  # of 159: twice 67, which nulls the other shaft


def test_velocity_as_iso_20816_has_it(gearbox):
    # 0.3 g at 20 Hz: v = a / (2 pi f), in mm/s, over root two
    values = over_turns(lambda t: cosine(1, 0.3, t), noise=1e-6)
    row = value(analyze(record_of(values), gearbox, settings=BARE), "record", "velocity_rms")
    assert row.value == pytest.approx(0.3 * 9.80665 / (2 * np.pi * SPEED_HZ) * 1000 / np.sqrt(2), rel=1e-3)
    assert (row.unit, row.source, row.takes) == ("mm s-1", "ISO 20816-1", "velocity from 10 to 1000 Hz")


def test_a_slow_machine_is_read_from_two_hertz(gearbox):
    values = np.random.default_rng(0).normal(size=200_000)
    slow = record_of(values, speed_hz=5.0)
    row = value(analyze(slow, gearbox, settings=BARE), "record", "velocity_rms")
    assert row.takes == "velocity from 2 to 1000 Hz"


def struck_tooth(turns):
    return 0.4 * np.exp(-(((turns % 1) - 0.5) ** 2) / (2 * 0.004**2)) * cosine(37.3, 1.0, turns % 1)


def test_fm4_shows_one_bad_tooth_and_noise_its_limit(gearbox):
    meshes = lambda turns: cosine(23, 0.5, turns) + cosine(46, 0.2, turns)  # noqa: E731
    sound = analyze(record_of(over_turns(meshes, noise=0.1)), gearbox, settings=BARE)
    struck = analyze(record_of(over_turns(lambda t: meshes(t) + struck_tooth(t), noise=0.1)), gearbox, settings=BARE)
    quiet, loud = (value(one, "stage 1/pinion", "fm4") for one in (sound, struck))
    assert quiet.value < quiet.noise_limit
    assert loud.value > 2 * loud.noise_limit
    # order 80 is kept: 3 + 4 sqrt(24 / 160)
    assert loud.noise_limit == pytest.approx(3 + 4 * np.sqrt(24 / 160))


@pytest.fixture(scope="module")
def values():
    return over_turns(lambda t: cosine(23, 0.5, t) + struck_tooth(t), noise=0.1)


@pytest.fixture(scope="module")
def first(gearbox, values):
    return analyze(record_of(values), gearbox, settings=BARE)


class TestBaseline:
    @staticmethod
    def na4(analysis):
        return value(analysis, "stage 1/pinion", "na4").value

    def test_history_of_records_of_known_scale_in_a_file(self, gearbox, values, first, tmp_path):
        # x, then 2x: fourth moments m and 16 m, mean variances v and (v + 4v) / 2
        save_analysis(first, tmp_path / "analysis.h5")
        with open_analysis(tmp_path / "analysis.h5") as reopened:
            second = analyze(record_of(2 * values), gearbox, settings=BARE, baseline=reopened)
        assert self.na4(second) / self.na4(first) == pytest.approx(16 / 2.5**2, rel=1e-9)
        assert value(second, "stage 1/pinion", "na4").takes.endswith("history of 2 records")

    def test_a_frozen_baseline(self, gearbox, values, first):
        frozen = BARE.changed(freeze_baseline=True)
        second = analyze(record_of(2 * values), gearbox, settings=frozen, baseline=first)
        assert self.na4(second) / self.na4(first) == pytest.approx(16, rel=1e-9)
        assert value(second, "stage 1/pinion", "nb4").takes.endswith("frozen history of 1 record")

    def test_nothing_to_freeze(self, gearbox, values):
        with pytest.raises(AnalysisError, match="there is no baseline to freeze"):
            analyze(record_of(values), gearbox, settings=BARE.changed(freeze_baseline=True))

    def test_a_baseline_in_other_units(self, gearbox, values, first):
        with pytest.raises(AnalysisError, match=r'channel "housing" was in g and is in m s-2 now'):
            analyze(record_of(values, units="m s-2"), gearbox, settings=BARE, baseline=first)
        another = gearbox.model_copy(update={"name": "another"})
        with pytest.raises(AnalysisError, match=f'it is of gearbox "{gearbox.name}", the record of "another"'):
            analyze(record_of(values), another, settings=BARE, baseline=first)

    def test_a_record_as_its_own_baseline(self, gearbox, values):
        record = record_of(values).assign_attrs(recorded_at="2026-11-30T20:00:00Z")
        own = analyze(record, gearbox, settings=BARE)
        with pytest.raises(AnalysisError, match="it is of the record itself, of 2026-11-30T20:00:00Z"):
            analyze(record, gearbox, settings=BARE, baseline=own)


def test_defect_energy_of_a_known_envelope(gearbox):
    # the envelope of A (1 + m cos) has a line of m A: half its square, at the inner race
    race = next(row for row in defects(gearbox) if row.kind == "inner_race")
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    values = 0.8 * (1 + 0.3 * np.cos(2 * np.pi * race.order * SPEED_HZ * time)) * np.cos(2 * np.pi * 1700 * time)
    values += np.random.default_rng(0).normal(0, 0.01, time.size)
    settings = BARE.changed(envelope_band_hz=(1200.0, 2200.0), harmonics=1)
    analysis = analyze(record_of(values), gearbox, settings=settings)
    row = value(analysis, race.component, "defect_energy", kind="inner_race")
    assert row.value == pytest.approx((0.3 * 0.8) ** 2 / 2, rel=0.05)  # a Hann line between two bins loses some
    assert row.unit == "g2"
    modulation = value(analysis, race.component, "modulation", kind="inner_race")
    assert modulation.value == pytest.approx(0.3, rel=0.05)  # the line's depth, far above the background
    assert modulation.unit == "1"


def test_a_value_is_missing_exactly_where_a_sentence_says_why(modulated):
    table = indicator_table(modulated[1])
    assert (table["value"].isna() == (table["withheld"] != "")).all()
    json.dumps(summary(modulated[1]), allow_nan=False)


def test_a_sick_sensor_keeps_its_raw_rms_alone(gearbox):
    values = np.clip(over_turns(lambda t: cosine(23, 1.0, t), noise=0.3), -0.9, 0.9)
    sound = over_turns(lambda t: cosine(23, 1.0, t), noise=0.3, seed=3)
    record = make_record(
        {"cut": Channel(values=values, units="g"), "sound": Channel(values=sound, units="g")},
        rate_hz=RATE_HZ,
        angle=PulseTimes(times_s=np.arange(0, SECONDS, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1),
    )
    analysis = analyze(record, gearbox, settings=BARE)
    verdict = health_table(analysis).set_index("name")
    assert verdict["status"].to_dict() == {"cut": "faulty", "sound": "ok", "tachometer": "ok"}
    assert "It is clipped: it reaches 0.9 g" in verdict.loc["cut", "reasons"]
    table = indicator_table(analysis)
    assert list(table[table["channel"] == "cut"]["indicator"]) == ["rms"]
    assert {"fm4", "so1", "kurtosis"} <= set(table[table["channel"] == "sound"]["indicator"])
    assert any(note.startswith('Channel "cut": faulty') for note in summary(analysis)["notes"])


def planetary_record(*, bad=None, deaf=False, seconds=300.0, rate_hz=1000.0, carrier_hz=1.0):
    """The 27-36-99 stage heard on its ring: each planet is loud as it passes, and one tooth of `bad` clicks there."""
    angle = carrier_hz * np.arange(round(seconds * rate_hz)) / rate_hz  # turns of the carrier
    values = np.zeros(angle.size)
    for planet in range(3):
        away = (angle + planet / 3 + 0.5) % 1 - 0.5  # of the planet from the sensor
        loud = 1.0 if deaf else np.exp(-0.5 * (away / 0.06) ** 2)
        sound = np.cos(2 * np.pi * 99 * angle)
        if planet == bad:
            tooth = (angle * 99 + 18) % 36 - 18  # teeth from the one that clicks, at the ring
            sound = sound + 3 * np.exp(-0.5 * (tooth / 0.3) ** 2) * np.cos(2 * np.pi * 2.5 * tooth)
        values += loud * sound
    values += np.random.default_rng(5).normal(0, 0.1, angle.size)
    return record_of(values, shaft="carrier", speed_hz=carrier_hz, rate_hz=rate_hz, name="ring")


@pytest.fixture(scope="module")
def planetary():
    return load_gearbox("planetary-27-36-99")


def test_the_planet_with_a_bad_tooth_is_named_by_fm4(planetary):
    analysis = analyze(planetary_record(bad=1), planetary, settings=BARE)
    fm4 = [value(analysis, f"planet-ring/planet {number}", "fm4") for number in (1, 2, 3)]
    # even planets are told apart up to which is called the first one
    high = [row.value > row.noise_limit for row in fm4]
    assert sum(high) == 1
    assert not any(row.withheld for row in fm4)
    sound = analyze(planetary_record(), planetary, settings=BARE)
    for name in ("planet-ring/planet 1", "planet-ring/planet 2", "planet-ring/planet 3", "sun-planet/sun"):
        row = value(sound, name, "fm4")
        assert row.value < row.noise_limit


def test_a_sensor_that_does_not_hear_the_planets_pass(planetary):
    row = value(analyze(planetary_record(deaf=True, seconds=60), planetary, settings=BARE), "sun-planet/sun", "fm4")
    assert np.isnan(row.value)
    assert "is not modulated by 3 planets" in row.withheld


def test_a_record_too_short_for_all_planet_teeth(planetary):
    # 36 teeth against 99 come round after 36 / gcd(36, 99) = 4 turns of the carrier
    row = value(analyze(planetary_record(seconds=3.5), planetary, settings=BARE), "planet-ring/planet 1", "fm4")
    assert "once in 4" in row.withheld


def test_equal_planets_leave_few_sidebands_at_the_carrier(planetary):
    sound = value(analyze(planetary_record(seconds=60), planetary, settings=BARE), "carrier", "carrier_sideband_ratio")
    assert sound.kind == "planetary"
    assert sound.value < 0.2


def spaced(copies, spacing_deg=None):
    planet = {"links": ["carrier", "planet"], "copies": copies} | ({"spacing_deg": spacing_deg} if spacing_deg else {})
    return Gearbox.from_mapping(
        {
            "name": "spaced",
            "frame": "housing",
            "reference": "sun",
            "rigid": [["housing", "ring"]],
            "axes": {"main": ["housing", "sun", "ring", "carrier"], "planet": planet},
            "mesh": [{"teeth": {"sun": 27, "planet": 36}}, {"teeth": {"planet": 36, "ring": -99}}],
        }
    )


def test_planets_unevenly_spaced():
    uneven = spaced(3, [0, 360 * 41 / 126, 240])
    row = value(analyze(planetary_record(seconds=20), uneven, settings=BARE), "carrier", "carrier_sideband_ratio")
    assert "unevenly spaced planets" in row.withheld


def test_planets_that_do_not_fit_where_they_are_drawn():
    # (27 + 99) / 4 is not whole: of four even planets two stand half a tooth off, 360 / 252 degrees
    with pytest.warns(GearboxWarning, match="cannot be evenly spaced"):
        four = spaced(4)
    analysis = analyze(planetary_record(seconds=20), four, settings=BARE)
    for component, indicator in (("carrier", "carrier_sideband_ratio"), ("planet-ring/planet 1", "fm4")):
        assert (
            "one is 1.4 degrees off. Give the true positions with spacing_deg"
            in value(analysis, component, indicator).withheld
        )


@pytest.mark.parametrize("name", ["nelson-bevel-planet", "alouette-iii"])
def test_bevel_stages_and_single_planets_have_no_averages(name):
    # one has its planet across its carrier, the other is drawn with one planet, which leaves their number open
    gearbox = load_gearbox(name)
    record = record_of(np.random.default_rng(0).normal(size=40_000), shaft=gearbox.reference)
    assert "planetary" not in set(indicator_table(analyze(record, gearbox, settings=BARE))["kind"])
