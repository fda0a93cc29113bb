"""Scenes whose gears vibrate, against equations of motion written down anew here."""

import tomllib
from functools import partial

import numpy as np
import pytest
from declared_pair import PAIR, declared_pair
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.gears.geometry import GearPair
from data_synth.scene.random_streams import random_stream
from data_synth.scene.sensors import AntiAlias, Mode, Sensor
from data_synth.simulation import noise_free
from data_synth.sources.prepared import prepare_scene
from data_synth.transfer.housing import AHEAD, PoleFilter, housing_of
from data_synth.vibration.run import motion_of
from hums.records.validation import check_record

DYNAMICS = PAIR["dynamics"]
SEED = 3


def scene(**changes):
    return Scene.from_mapping({**PAIR, **changes})


def with_dynamics(**changes):
    return scene(dynamics={**DYNAMICS, **changes})


def test_steady_motion_has_lines_at_the_mesh_order_and_nowhere_else():
    record = simulate(with_dynamics(error=1e-7), seed=SEED)
    spectrum = np.fft.rfft(record["a"].values) * 2 / 4000  # 0.2 s: 40 mesh cycles
    lines = spectrum[40::40]
    others = np.delete(spectrum, np.arange(0, spectrum.size, 40))
    # the start has died to 1e-7, and each step is the same part of a mesh cycle, so steps cannot beat
    assert np.max(np.abs(others)) < 1e-6 * np.max(np.abs(lines))
    truth = record["truth_amplitude"].values[0, :, 0]
    orders = record["truth_order"].values
    kept = np.rint(orders / 20).astype(int)
    assert_allclose(orders, 20 * kept, rtol=1e-12)
    datum = np.exp(-2j * np.pi * orders * -0.03)
    # -98 dB of side lobes of the lines 40 bins away
    assert_allclose(truth, lines[kept - 1] * datum, atol=3e-5 * np.max(np.abs(lines)))
    # all that is loud has its line: what has none is less than 1e-4 of the power
    assert set(np.flatnonzero(np.abs(lines) > 0.015 * np.max(np.abs(lines)))) <= set(kept - 1)
    assert set(record["truth_kind"].values) == {"gear_mesh"}
    assert record.attrs["truth_fidelity"] == "dynamic: as declared"
    check_record(record)


def test_an_ac_coupling_and_a_skew_take_their_part_of_every_line():
    sensor = {**PAIR["sensor"][0], "ac_coupling_hz": 200.0, "skew_s": 63e-6}
    spectra = [np.fft.rfft(noise_free(made, seed=SEED).signal[0]) for made in (scene(), scene(sensor=[sensor]))]
    hz = 200.0 * np.arange(1, 8)  # the mesh, seven times: 40 bins each
    through, plain = (spectrum[40 * np.arange(1, 8)] for spectrum in (spectra[1], spectra[0]))
    changed = 1j * hz / (1j * hz + 200) * np.exp(2j * np.pi * hz * 63e-6)
    assert_allclose(through, plain * changed, rtol=2e-3, atol=1e-4 * np.max(np.abs(plain)))
    truth = simulate(scene(sensor=[sensor]), seed=SEED)
    assert truth["truth_chain_coupling"].values.tolist() == [200.0]
    assert truth["truth_chain_skew"].values.tolist() == [63e-6]
    unmoved = simulate(scene(), seed=SEED)
    stated = truth["truth_amplitude"].values[0, :3, 0] / unmoved["truth_amplitude"].values[0, :3, 0]
    assert_allclose(stated, changed[:3], rtol=5e-3)


def test_tip_relief_of_the_deflection_silences_gears_at_its_load_alone():
    # Harris 1958; the teeth are equal springs, so that F / k of a pair is all the way the same
    pair = GearPair(teeth=(20, 40), module_m=4e-3, face_width_m=0.04, pressure_angle_rad=np.radians(20))
    deflection_m = 300 / pair.base_radii_m[1] * pair.contact_ratio / 8e7

    def level(nm, **mesh):
        mesh = {"shape": "rectangular", "stiffness_n_m": 8e7, "backlash_um": 400, **mesh}
        made = with_dynamics(meshes={"mesh": mesh}).changed(torque={"link": "wheel", "nm": nm})
        return np.std(noise_free(made, seed=SEED).signal)

    assert level(300, tip_relief_um=1e6 * deflection_m) < 1e-3 * level(300)
    assert level(150, tip_relief_um=1e6 * deflection_m) > 0.1 * level(150)


def test_a_measured_transmission_error_acts_as_its_formula(tmp_path):
    cycles = np.linspace(0, 20, 20 * 64 + 1)  # a turn of the pinion
    rows = np.column_stack([cycles, 3 * np.cos(2 * np.pi * cycles)])
    (tmp_path / "error.csv").write_text("cycles,um\n" + "\n".join(f"{a},{b}" for a, b in rows.tolist()))
    text = with_dynamics(meshes={"mesh": {**MESH, "error_um": 0}}).to_toml()
    (tmp_path / "scene.toml").write_text(text.replace("error_um = 0.0", 'csv = "error.csv"'))
    measured = load_scene(tmp_path / "scene.toml")
    assert Scene.from_mapping(tomllib.loads(measured.to_toml())) == measured
    signals = [noise_free(made, seed=SEED).signal for made in (measured, with_dynamics(meshes={"mesh": MESH}))]
    assert np.std(signals[0] - signals[1]) < 2e-3 * np.std(signals[1])  # chords of 64 to a cycle: (pi / 64)^2 / 2
    with pytest.raises(SceneError, match="let it begin at 0 cycles and return to its first value after a whole number"):
        with_dynamics(meshes={"mesh": {"transmission_error": [[0, 0], [0.5, 1]]}})


MESH = DYNAMICS["meshes"]["mesh"]
TEETH = {
    **DYNAMICS,
    "meshes": {"mesh": {}},
    "damping_ratio": 0.3,
    "mounts": {"frequency_hz": 300, "damping_ratio": 0.7},
}


def test_a_crack_shows_while_its_tooth_is_in_mesh():
    crack = {"kind": "tooth_crack", "component": "mesh/pinion", "depth_mm": 2.0}
    healthy = simulate(scene(dynamics=TEETH), seed=SEED)
    cracked = simulate(scene(dynamics=TEETH, fault=[crack]), seed=SEED)
    difference = np.abs(cracked["a"].values - healthy["a"].values)
    passes = cracked["truth_tooth_passes_1"]
    assert passes.size == 2  # 0.2 s at 10 turns a second
    assert_allclose(np.diff(passes), 0.1, rtol=1e-12)
    half_s = passes.attrs["half_width_rev"] / 10
    assert 2 * half_s == pytest.approx(1.63 / 200, rel=0.05)  # the contact ratio in mesh periods
    since = np.min(np.abs(cracked["time"].values[:, None] - passes.values), axis=1)
    before = cracked["time"].values[:, None] - (passes.values - half_s)
    silent = np.all((before < 0) | (before > 0.05), axis=1)
    # modes of 0.3 of critical have died 40 ms after a pass; what is left: modes are damped by the mean stiffness,
    # which a crack lowers a little
    assert np.max(difference[silent]) < 1e-2 * np.max(difference)
    assert since[np.argmax(difference)] < 2 * half_s
    assert np.max(difference) > 0.02 * np.std(healthy["a"].values)
    assert "truth_impact_times_1" not in cracked


def test_an_eccentric_wheel_puts_sidebands_a_turn_apart():
    fault = scene(fault=[{"kind": "eccentricity", "component": "mesh/wheel", "size_mm": 0.02}]).faults
    healthy, faulty = (simulate(with_dynamics(error=1e-6).changed(faults=faults), seed=SEED) for faults in ((), fault))
    for record, there in ((healthy, False), (faulty, True)):
        spectrum = np.abs(np.fft.rfft(record["a"].values))  # bins of 5 Hz: the wheel turns at 5, teeth meet at 200
        # shafts turn along with most of the runout; healthy gears have what is left of the start, 1e-6, there
        assert (min(spectrum[39], spectrum[41]) > 3e-5 * spectrum[40]) == there


@pytest.mark.parametrize("order", [3, 4])
def test_the_way_from_force_to_channel_has_its_frequency_response(order):
    chain = {
        "anti_alias": AntiAlias(frequency_hz=4000, order=order),
        "resonance": Mode(frequency_hz=9000, damping_ratio=0.05),
    }
    sensor = Sensor(name="a", on="b", units="g", **chain)
    declared = {"housing_kg": 8, "mounts": {"frequency_hz": 30, "damping_ratio": 0.2}}
    way = housing_of(scene(dynamics=declared, path={"frequency_hz": 2500, "damping_ratio": 0.1}), sensor)
    samples = np.arange(30_000)
    for frequency_hz, tolerance in ((40, 1e-7), (500, 1e-6), (2000, 1.2e-4), (4000, 8e-3)):
        s = 2j * np.pi * frequency_hz
        expected = s**2 / 8 / 9.80665
        for pole, ratio in ((30, 0.2), (2500, 0.1), (9000, 0.05)):
            w = 2 * np.pi * pole
            expected *= (1 if pole == 30 else w**2) / (s**2 + 2 * ratio * w * s + w**2)
        for k in range(order):
            pole = 2 * np.pi * 4000 * np.exp(1j * np.pi * (2 * k + order + 1) / (2 * order))
            expected *= -pole / (s - pole)
        assert_allclose(way.response(frequency_hz), expected, rtol=1e-12)
        running = PoleFilter(way, rate_hz=20_000)
        force = np.cos(2 * np.pi * frequency_hz / 20_000 * samples)
        heard = np.concatenate([running.push(part) for part in np.array_split(force, 7)])
        late = samples[20_000:]
        found = np.mean(heard[late] * np.exp(-2j * np.pi * frequency_hz / 20_000 * (late - AHEAD))) * 2
        assert abs(found / expected - 1) < tolerance
    assert_allclose(PoleFilter(way, rate_hz=20_000).push(np.full(100, 5e3)), 0, atol=1e-9)


def test_same_seed_same_bytes_and_a_longer_scene_begins_alike():
    one, again, other = (simulate(scene(), seed=seed) for seed in (1, 1, 2))
    assert all(one[name].values.tobytes() == again[name].values.tobytes() for name in one.variables)
    assert not np.allclose(one["a"].values, other["a"].values, atol=0.1 * np.std(one["a"].values))
    longer = simulate(scene(duration_s=1.0), seed=1)  # several blocks
    assert_allclose(longer["a"].values[:4000], one["a"].values, atol=1e-9 * np.std(one["a"].values))


def test_sources_add_up_and_the_scene_is_written_out():
    unbalanced = {"kind": "imbalance", "component": "wheel", "size_mm": 0.1}
    record = simulate(scene(fault=[unbalanced]), seed=1, by_source=True)
    assert record["truth_source_name"].values[-1] == "gears, motion"
    assert_allclose(record["truth_source"].sum("truth_source_name").values[0], record["a"].values, atol=1e-12)
    back = Scene.from_mapping(tomllib.loads(record.attrs["truth_scene"]))
    assert back == scene(fault=[unbalanced])
    assert simulate(back, seed=1, by_source=True).identical(record)


@pytest.mark.parametrize(
    ("nm", "bound"),
    [
        ([[0, 0], [2, 450]], 1e-3),  # teeth have rattled before time zero
        ([[0, -100], [0.2, 40]], 1e-3),
        # one blow, after which teeth stay in contact: the trial judges forces, of which the blow is a smaller part than
        # of the channels, whose resonance it rings
        ([[0, 0], [0.1, 0], [0.11, 450], [0.3, 450]], 4e-3),
    ],
)
def test_the_error_is_kept_where_teeth_part_and_load_varies(nm, bound):
    gears = load_scene("gears-in-motion").changed(duration_s=0.3, faults=(), noise={"rms": 0})
    table = tomllib.loads(gears.to_toml())
    table["torque"]["nm"] = nm
    found, finer = (
        noise_free(Scene.from_mapping({**table, "dynamics": {**table["dynamics"], "error": error}}), seed=SEED).signal
        for error in (1e-3, 1e-4)
    )
    for values, reference in zip(found, finer, strict=True):
        assert np.std(values - reference) < bound * np.std(reference)


def test_the_declared_mean_stiffness_is_that_of_healthy_teeth():
    crack = {"kind": "tooth_crack", "component": "mesh/pinion", "depth_mm": 2.0}
    dynamics = {**DYNAMICS, "meshes": {"mesh": {"stiffness_n_m": 5e8}}}
    means = []
    for faults in ([], [crack]):
        stage = prepare_scene(scene(dynamics=dynamics, fault=faults), rng_for=partial(random_stream, 1))
        means.append(motion_of(stage).system.meshes[0].stiffness.mean)
    assert means[0] == pytest.approx(5e8, rel=1e-9)
    assert 0.95 * 5e8 < means[1] < 0.9999 * 5e8


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"dynamics": {"meshes": {"mesh": {"stiffness_n_m": -1e8}}}}, "stiffness_n_m.*greater than 0"),
        ({"dynamics": {"bearings": {"pinion": {"radial_n_m": -1.0}}}}, "radial_n_m.*greater than 0"),
        ({"dynamics": {"meshes": {"mash": {}}}}, 'names "mash", which is no mesh of gearbox "pair"'),
        ({"dynamics": {"links": {"wheels": {"mass_kg": 1}}}}, 'links names "wheels".*did you mean "wheel"'),
        ({"torque": None}, "without load there is no mesh force; add torque"),
        ({"torque": {"link": "pinion", "nm": 5}}, "name the link that takes the power out as dynamics.load_on"),
        ({"gearbox": declared_pair(face_width_mm=None)}, 'mesh "mesh" declares no face_width_mm.*, or as dynamics'),
        (
            {"sensor": [{key: PAIR["sensor"][0][key] for key in ("name", "on", "units")}]},
            'sensor "a" needs a direction',
        ),
        (
            {"fault": [{"kind": "tooth_crack", "component": "mesh/pinion", "depth_mm": 2.0}]},
            'a tooth that is softer needs shape = "teeth"',
        ),
    ],
)
def test_what_cannot_vibrate_is_refused(changes, sentence):
    table = {key: value for key, value in {**PAIR, **changes}.items() if value is not None}
    with pytest.raises(SceneError, match=sentence):
        simulate(Scene.from_mapping(table), seed=1)


def test_an_error_that_cannot_be_reached_says_what_a_scene_can_change():
    base = load_scene("gears-in-motion").model_dump(mode="json", by_alias=True, exclude_none=True)
    worn = {"kind": "wear", "component": "stage 1/pinion", "size_mm": 0.01}
    loose = Scene.from_mapping(
        {**base, "duration_s": 0.1, "fault": [worn], "dynamics": {**base["dynamics"], "error": 1e-13}}
    )
    with pytest.raises(SceneError, match=r"cannot be followed in time: .* Raise dynamics\.error or rate_hz; or check"):
        simulate(loose, seed=SEED)
