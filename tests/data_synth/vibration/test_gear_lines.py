"""Lines of gears in motion: how much of the clean signal they are, and whether a tracker finds them."""

from functools import cache

import numpy as np
import pytest
from moving_pair import SEED, scene
from numpy.testing import assert_allclose
from truth import rebuilt

from data_synth import Scene, load_scene, simulate
from hums.records.validation import check_record
from signals import track_orders


def explained(found, signal):
    return 1 - np.mean((signal - found) ** 2) / np.mean(signal**2)


@cache
def clean(declared, seed=SEED):
    """Return the record of a scene without noise, to be read only."""
    return simulate(declared.changed(noise={"rms": 0}), seed=seed, phases=True)


def test_lines_are_the_signal_of_the_shipped_gears_and_of_their_fault():
    # the period of the two-stage gearbox is 67 turns of its input, 2.68 s
    cracked = load_scene("gears-in-motion").changed(duration_s=2.7)
    faulty, healthy = clean(cracked), clean(cracked.changed(faults=()))
    name = cracked.sensors[0].name
    signals, lines = [made[name].values for made in (faulty, healthy)], [rebuilt(made) for made in (faulty, healthy)]
    assert explained(lines[0], signals[0]) > 0.99
    assert explained(lines[1], signals[1]) > 0.99
    assert explained(lines[0] - lines[1], signals[0] - signals[1]) > 0.95
    assert {"gear_mesh", "tooth"} <= set(faulty["truth_kind"].values)
    assert "tooth" not in healthy["truth_kind"].values
    assert 322 in faulty["truth_order"].values  # the loudest, at 14 times the first mesh
    check_record(faulty)


def test_lines_follow_damage_that_grows():
    growth = {"rate_mm_per_s": 0.5, "largest_mm": 1.5}
    crack = {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 0.5, "growth": growth}
    speed = {"link": "input", "rpm": [[0, 1400], [2, 1500]]}
    grown = load_scene("gears-in-motion").changed(duration_s=2.0, speed=speed, faults=(crack,))
    faulty, healthy = clean(grown), clean(grown.changed(faults=()))
    name = grown.sensors[0].name
    added, found = faulty[name].values - healthy[name].values, rebuilt(faulty) - rebuilt(healthy)
    assert explained(found, added) > 0.99
    third = added.size // 3
    sizes = [np.std(each[part]) for each in (added, found) for part in (slice(0, third), slice(-third, None))]
    assert sizes[1] > 2 * sizes[0]  # it grows
    assert_allclose(sizes[2:], sizes[:2], rtol=0.15)


def test_lines_of_a_short_steady_record_are_told_apart_as_far_as_it_lets_them_be():
    """Sums of the orders of planets and gears lie within 1.5 periods of the 3 s beside lines that there are."""
    runout = {"kind": "eccentricity", "component": "sun-planet/sun", "size_mm": 0.05}
    record = clean(load_scene("planets-in-motion").changed(duration_s=3.0, faults=(runout,)))
    assert explained(rebuilt(record), record["ring"].values) > 0.999
    assert 0 < record["truth_left"].item() < 1e-3


def test_lines_that_leave_the_band_as_the_speed_rises_are_known_until_then():
    rising = {"link": "input", "rpm": [[0, 1200], [4, 1500]]}
    sound = load_scene("gears-in-motion").changed(faults=(), duration_s=4.0, rate_hz=14_000, speed=rising)
    record = clean(sound)
    assert explained(rebuilt(record), record[sound.sensors[0].name].values) > 0.998


def test_pitch_deviations_of_sound_gears_have_lines():
    even = scene(duration_s=1.6, noise={"rms": 0})
    uneven = even.changed(imperfections={"gears": {"runout_um": 20, "single_pitch_um": 6}})
    record = simulate(uneven, seed=SEED, phases=True)
    assert explained(rebuilt(record), record["a"].values) > 0.99
    assert "pitch_deviation" in record["truth_kind"].values
    without = simulate(even, seed=SEED)
    assert "pitch_deviation" not in without["truth_kind"].values


RUN = {"speed": {"link": "pinion", "rpm": [[0, 500], [3, 900]]}, "duration_s": 3.0}


@pytest.fixture(scope="module")
def run_through_resonance():
    return simulate(scene(**RUN), seed=SEED, phases=True)


def test_a_tracker_finds_the_lines_of_a_run_through_a_resonance(run_through_resonance):
    record = run_through_resonance
    turns = record["truth_shaft_revolutions"].sel(truth_shaft="pinion").values
    lines = record["truth_amplitude"].isel(truth_channel=0)
    sizes = np.abs(lines.values)
    loud = lines["truth_order"].values[sizes.max(axis=1) > 0.05 * sizes.max()]
    rises = sizes.max(axis=1) / sizes.min(axis=1)
    assert rises[np.isin(lines["truth_order"].values, loud)].max() > 10  # some line passes a resonance
    tracks = track_orders(
        record["a"].values, phase_rad=2 * np.pi * turns, orders=loud, bandwidth_hz=8.0, rate_hz=20_000.0, poles=2
    )
    truth = lines.sel(truth_order=loud)
    inner = (truth["truth_time"] > 0.3) & (truth["truth_time"] < 2.7)  # a smoother has less to go by at the ends
    at = np.rint(truth["truth_time"].values[inner] * 20_000).astype(int)
    error = tracks.complex_amplitude[:, at] - truth.values[:, inner]
    # a line changes by a tenth of itself in 1 / bandwidth: the smoother's own blur, and the lines beside those tracked
    assert np.sqrt(np.mean(np.abs(error) ** 2)) < 0.02 * np.sqrt(np.mean(np.abs(truth.values[:, inner]) ** 2))


def test_what_rings_after_a_jump_of_the_torque_is_no_line_and_the_record_says_how_much_of_it_that_is():
    loads = {"link": "gear", "steps": [[0, 90], [1.03, 130]]}
    record = clean(scene(duration_s=2.0, torque=loads))
    times_s = record["time"].values
    free = record["truth_free"].item()
    left = record["truth_left"].item() * (1 - free)
    # both follow the jump and so are correlated: the root of their sum's power is within the sum of their roots
    outside = np.sqrt(1 - explained(rebuilt(record), record["a"].values))
    assert outside == pytest.approx(np.sqrt(free), abs=1.05 * np.sqrt(left))
    assert record["truth_left"].item() < 3e-3
    settled = (times_s < 0.9) | (times_s > 1.2)
    error = (rebuilt(record) - record["a"].values)[settled]
    assert np.mean(error**2) < 3e-3 * np.mean(record["a"].values[settled] ** 2)


def test_a_small_fault_has_its_lines_far_below_the_record_s_and_a_record_says_what_they_leave():
    fault = {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 0.02}
    speed = {"link": "input", "rpm": [[0, 1200], [3, 1290]]}
    cracked = load_scene("gears-in-motion").changed(duration_s=3.0, speed=speed, faults=(fault,))
    faulty, sound = clean(cracked), clean(cracked.changed(faults=()))
    name = cracked.sensors[0].name
    added = faulty[name].values - sound[name].values
    assert np.mean(added**2) < 1e-5 * np.mean(sound[name].values ** 2)
    left = 1 - explained(rebuilt(faulty) - rebuilt(sound), added)
    assert left < 0.03
    assert faulty["truth_fault_left"].item() == pytest.approx(left, abs=0.02)
    assert "truth_fault_left" not in sound


def cracked_planet_below_bevel_gears():
    """48 dB below the record; no line of it stands apart from all others."""
    teeth = {"face_width_mm": 30, "pressure_angle_deg": 20}
    modules = {"bevel": 2.5, "sun-planet": 2.5, "planet-ring": 2.5 * 31 / 32}
    return Scene.from_mapping(
        {
            "gearbox": "oh-58",
            "rate_hz": 12000,
            "duration_s": 0.4,
            "fidelity": "dynamic",
            "speed": {"link": "input", "rpm": 3600},
            "torque": {"link": "carrier", "nm": 300},
            "noise": {"rms": 0.0},
            "excitation": {"shaft_amplitude": 0.0},
            "dynamics": {
                "damping_ratio": 0.04,
                "meshes": {name: {"module_mm": module, **teeth} for name, module in modules.items()},
            },
            "tachometer": {"link": "input", "pulses_per_rev": 1},
            "path": {"frequency_hz": 3000, "damping_ratio": 0.1},
            "sensor": [{"name": "a", "on": "ring", "direction": [1, 0, 0], "units": "m s-2"}],
            "fault": [{"kind": "tooth_crack", "component": "sun-planet/planet", "depth_mm": 1.5}],
        }
    )


@pytest.mark.filterwarnings("ignore::hums.GearboxWarning")
def test_of_more_lines_than_a_short_record_has_room_for_the_loudest_are_kept_and_it_says_what_they_leave():
    damaged = cracked_planet_below_bevel_gears()
    record, sound = clean(damaged), clean(damaged.changed(faults=()))
    channel = record["truth_channel"].values[0]
    assert record["truth_amplitude"].nbytes <= record[channel].nbytes
    added = record[channel].to_numpy() - sound[channel].to_numpy()
    left = 1 - explained(rebuilt(record) - rebuilt(sound), added)
    assert 0 < left < 0.5
    assert record["truth_fault_left"].item() == pytest.approx(left, rel=0.3)
