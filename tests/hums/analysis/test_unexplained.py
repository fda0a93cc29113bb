"""Lines that a drawing does not explain: a neighbour's family, mains, and what the drawing does explain."""

from dataclasses import replace

import numpy as np
import pytest

import hums
from hums.analysis.evidence import Setting
from hums.analysis.unexplained import Drawn, PulseVariation, drawn_orders, not_named, unexplained_lines, unlike_drawing
from hums.gearbox.defect_orders import defects
from hums.gearbox.model import load_gearbox
from signals import amplitude_spectrum

SPEED_HZ = 20.0
SETTING = Setting(shafts=(1.0, 0.343), speed_hz=SPEED_HZ)
DRAWN = Drawn(shafts=(0.343, 1.0), meshes=(6.522, 23.0), bearings=(3.585,), planets=(), tolerance=0.0, slip=0.02)
TURNS = np.arange(2**15) / 256  # 128 turns


def spectrum_of(*lines):
    x = 1e-3 * np.random.default_rng(5).standard_normal(TURNS.size)
    for order, amplitude in lines:
        x += amplitude * np.cos(2 * np.pi * order * TURNS + order)
    return amplitude_spectrum(x, rate=256.0)


def unexplained(*lines, setting=SETTING):
    return unexplained_lines(spectrum_of(*lines), DRAWN, setting, channel="x", units="g")[0]


def test_what_the_drawing_makes_is_explained():
    own = [(1.0, 0.1), (0.686, 0.1), (23.0, 1.0), (46.0, 0.5), (22.0, 0.2), (23.343, 0.1), (6.522, 0.3), (5.522, 0.1)]
    assert unexplained(*own) == []


def test_a_line_that_stands_alone_is_listed_with_its_frequency():
    (line,) = unexplained((23.0, 1.0), (16.65, 0.2))
    assert line.order == pytest.approx(16.65, abs=1e-3)
    assert line.frequency_hz == pytest.approx(333.0, abs=0.02)
    assert line.amplitude == pytest.approx(0.2, rel=0.01)
    assert line.might_be == ""
    assert np.isnan(line.spacing)


def test_mains_are_no_other_machine_where_the_speed_is_steady():
    hum = [(2.5, 0.1), (5.0 + 1e-4, 0.1), (7.5, 0.05)]  # 50, 100 and 150 Hz
    assert unexplained(*hum) == []
    assert len(unexplained(*hum, setting=Setting(shafts=SETTING.shafts, speed_hz=SPEED_HZ, speed_range_hz=5.0))) == 2


def test_a_neighbour_is_a_family_of_its_own():
    neighbour = [(1.2345 * k, 0.1) for k in (1, 2, 3, 31, 30, 32)]
    lines = unexplained((23.0, 1.0), *neighbour)
    np.testing.assert_allclose([line.spacing for line in lines], 1.2345, atol=1e-3)
    assert all("another machine, or a component missing from the drawing" in line.might_be for line in lines)


def test_a_family_of_a_race_is_called_that():
    lines = unexplained(*[(3.6 * k, 0.1) for k in (1, 2, 3, 4, 6, 7)])
    assert lines
    assert all("a bearing's defect of order 3.585" in line.might_be for line in lines)


@pytest.mark.parametrize("per_turn", [1, 8])
def test_sidebands_of_a_coarsely_sampled_tachometer_are_told_from_other_lines(per_turn):
    """The true turns at even turns by pulses at whole fifths of a millisecond carry the lines."""
    speed_hz, number = 20.013, np.arange(128 * per_turn + 1)
    times_s = np.ceil(5000 * number / per_turn / speed_hz) / 5000
    turns = speed_hz * np.interp(TURNS, number / per_turn, times_s)
    x = 0.2 * np.random.default_rng(5).standard_normal(TURNS.size)
    for order, size in ((23.0, 1.0), (46.0, 0.5), (16.65, 0.3)):
        x += size * np.cos(2 * np.pi * order * turns)
    pulses = PulseVariation.of(times_s, number / per_turn, 2e-4 / np.sqrt(12))
    spectrum = amplitude_spectrum(x, rate=256.0)
    before, _ = unexplained_lines(spectrum, DRAWN, SETTING, channel="x", units="g")
    after, made = unexplained_lines(spectrum, DRAWN, SETTING, channel="x", units="g", pulses=pulses)
    assert len(before) > 4
    assert made == len(before) - 1 == len(before) - len(after)
    assert after[0].order == pytest.approx(16.65, abs=1e-2)
    even = PulseVariation.of(number / per_turn / speed_hz, number / per_turn, 1e-9)  # makes none of them
    assert unexplained_lines(spectrum, DRAWN, SETTING, channel="x", units="g", pulses=even)[1] == 0


OWN = [(1.0, 0.1), (23.0, 1.0), (46.0, 0.4), (6.522, 0.3)]


def test_another_machines_meshes_do_not_look_like_the_drawing():
    assert unlike_drawing([spectrum_of(*OWN)], DRAWN, SETTING) == ""
    other = [(1.0, 0.1), (29.0, 1.0), (58.0, 0.4), (23.0, 0.05)]
    why = unlike_drawing([spectrum_of(*other)], DRAWN, SETTING)
    assert "the line at 29.000 orders" in why
    assert "20 times as large as any mesh line" in why
    # one sensor that looks like the drawing is enough, and without a mesh nothing can be doubted
    assert unlike_drawing([spectrum_of(*other), spectrum_of(*OWN)], DRAWN, SETTING) == ""
    bare = Drawn(shafts=(1.0,), meshes=(), bearings=(), planets=(), tolerance=0.0, slip=0.02)
    assert unlike_drawing([spectrum_of(*other)], bare, SETTING) == ""


def test_any_harmonic_of_a_drawn_mesh_that_a_resonance_carries_is_its_own():
    carried = [(23.0, 0.05), (6.522, 0.03), (8 * 6.522, 0.3), (9 * 6.522, 1.0), (10 * 6.522, 0.2), (18 * 6.522, 0.2)]
    assert unlike_drawing([spectrum_of(*carried)], DRAWN, SETTING) == ""
    beside = [(order + 0.2 * (amplitude == 1.0), amplitude) for order, amplitude in carried]
    assert "the line at 58.898 orders" in unlike_drawing([spectrum_of(*beside, (117.796, 0.4))], DRAWN, SETTING)


def drawing(**changed):
    return replace(DRAWN, **changed)


def test_a_mesh_where_a_shaft_has_its_lines_is_no_mark_of_the_drawing():
    other = [(1.0, 0.5), (29.0, 1.0), (58.0, 0.4)]
    why = unlike_drawing([spectrum_of(*other)], drawing(meshes=(1.0, 23.0)), SETTING)
    assert "the line at 29.000 orders" in why
    assert "larger than any mesh line" in why


def test_a_second_harmonic_above_its_first_and_the_range_is_strange():
    other = [(40.0, 0.6), (80.0, 1.0), (23.0, 0.05)]
    assert "the line at 80.000 orders" in unlike_drawing([spectrum_of(*other)], DRAWN, SETTING)


def test_many_races_near_to_any_line_explain_none_by_chance():
    races = tuple(3.1 + 0.17 * k for k in range(12))
    other = [(29.0, 1.0), (58.0, 0.4), (29.0 - races[4], 0.5), (29.0 + races[4] + 0.05, 0.5), (23.0, 0.05)]
    assert "the line at 29.000 orders" in unlike_drawing([spectrum_of(*other)], drawing(bearings=races), SETTING)


def test_planets_that_pass_are_no_other_gearbox():
    # an assembly whose mesh line itself vanishes: sidebands at multiples of the carrier's order, some times the mesh
    passed = [(harmonic * 23.0 + k * 0.25, 1.0 / harmonic) for harmonic in (1, 2, 3) for k in (-7, -4, -1, 2, 5, 8)]
    planetary = drawing(planets=((23.0, 0.25, 3),))
    assert unlike_drawing([spectrum_of(*passed)], planetary, SETTING) == ""


def test_a_mesh_of_planets_out_of_phase_stands_beside_its_order():
    # McFadden and Smith 1985: the ring's 82 teeth are no multiple of three planets, so that turns of the carrier
    # 81 and 84 of the first harmonic, 162 and 165 of the second are heard, and the mesh itself is not
    planetary = drawing(planets=((82 * 0.25, 0.25, 3),), meshes=(82 * 0.25,))
    heard = [(81 * 0.25, 1.0), (84 * 0.25, 0.1), (162 * 0.25, 0.4)]
    assert unlike_drawing([spectrum_of(*heard)], planetary, SETTING) == ""


def test_planets_of_a_drawing_are_counted_with_their_carrier():
    rows = defects(load_gearbox("planetary-27-36-99"))
    drawn = drawn_orders(rows, tolerance=0.0, slip=0.02)
    carrier = 27 / (27 + 99)  # Willis, the ring at rest
    assert drawn.planets == ((pytest.approx(99 * carrier), pytest.approx(carrier), 3),)


def test_harmonics_of_a_named_bearing_are_explained_by_it():
    heard = [(k * 3.59, 0.1) for k in (1, 2, 3, 5, 7)]
    lines = unexplained((23.0, 1.0), *heard, (16.65, 0.2))
    left = not_named(lines, [3.59], bin_width=1 / 128)
    assert [round(line.order, 2) for line in left] == [16.65]
    assert not_named(lines, [], bin_width=1 / 128) == lines


def test_a_family_is_guessed_to_be_the_bearing_of_the_lowest_multiple():
    cage_and_race = drawing(bearings=(0.3983, 3.585))
    heard = [(k * 3.585, 0.1) for k in range(5, 15)]
    lines, _ = unexplained_lines(spectrum_of(*heard), cage_and_race, SETTING, channel="x", units="g")
    assert lines
    assert all("order 3.585" in line.might_be for line in lines)


@pytest.mark.parametrize(("own", "mains", "claimed"), [(0.0, 0.02, False), (0.003, 0.003, True)])
def test_what_the_mains_leave_while_the_speed_passes_them_is_no_sideband_and_has_a_source(own, mains, claimed):
    times_s = np.arange(40_000) / 4000
    turns = 24.3 * times_s + 21 * np.exp(-times_s / 1.5)  # 10 to 24.3 rev/s, where 150 Hz is order 6.173
    mesh, gear = 19 * 23 / 67, 23 / 67
    lines = 0.1 * np.cos(2 * np.pi * mesh * turns) + own * np.cos(2 * np.pi * (mesh - gear) * turns)  # order 6.179
    lines += mains * np.cos(2 * np.pi * 150 * times_s) + np.random.default_rng(1).normal(0, 0.01, times_s.size)
    pulses = np.interp(np.arange(21, turns[-1]), turns, times_s)
    angle = hums.PulseTimes(times_s=pulses, shaft="input", pulses_per_rev=1)
    record = hums.make_record({"a": lines}, rate_hz=4000, units="g", angle=angle)
    settings = hums.AnalysisSettings(envelope_band_hz=None)
    analysis = hums.analyze(record, load_gearbox("two-stage"), settings=settings)
    table = hums.line_table(analysis, "order_spectrum")
    place = (table["component"] == "stage 2/intermediate") & (table["sideband"] == -1) & (table["harmonic"] == 1)
    assert table[place]["claimed"].tolist() == [claimed]
    sources = set(hums.unexplained_table(analysis)["might_be"])
    assert sources == (set() if claimed else {"mains, 3 x 50 Hz"})
