"""Declared ways from sources to sensors, against closed forms and Fourier integrals written down anew here."""

import tomllib

import numpy as np
import pytest
import tomli_w
from declared_pair import PAIR
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose
from scipy.signal import freqs

from data_synth import Scene, SceneError, load_scene, simulate

RATE = 20_000
SCENE = {
    **TWO_STAGE,
    "duration_s": 0.5,
    "speed": {"link": "input", "rpm": [[0, 1500], [0.5, 1530]]},
    "sensor": [{"name": name, "on": "input bearing", "units": "m s-2", "anti_alias": "none"} for name in ("a", "b")],
}
SILENT = {"shaft_amplitude": 0, "mesh_amplitude": 0}
# (Hz, damping ratio, gain)
MODES = [(900.0, 0.04, 2.0), (3100.0, 0.02, -0.5)]
TABLE = [{"frequency_hz": f, "damping_ratio": z, "gain": g} for f, z, g in MODES]
# the same by their residues, as modal analysis states them: g w^2 / (2 j w_d)
RESIDUES = [
    {"frequency_hz": f, "damping_ratio": z, "residue": [0.0, -g * np.pi * f / np.sqrt(1 - z**2)]} for f, z, g in MODES
]
BEARING = "intermediate bearing"


def way(source, sensor="b", units="m s-2", **given):
    return {"source": source, "sensor": sensor, "units": units, **(given or {"modes": TABLE})}


def made(*transfers, seed=2, **changes):
    return simulate(Scene.from_mapping({**SCENE, "transfer": list(transfers), **changes}), seed=seed, by_source=True)


def response(frequency_hz):
    """``sum g w^2 / (s^2 + 2 zeta w s + w^2)`` by scipy."""
    s = 2 * np.pi * np.asarray(frequency_hz)
    parts = [freqs([g * (2 * np.pi * f) ** 2], [1, 4 * np.pi * z * f, (2 * np.pi * f) ** 2], s)[1] for f, z, g in MODES]
    return sum(parts)


def impulse(times_s):
    """Its inverse transform, by the textbook: ``g w^2 / w_d exp(-zeta w t) sin(w_d t)``."""
    total = np.zeros_like(times_s)
    for f, z, g in MODES:
        natural, damped = 2 * np.pi * f, 2 * np.pi * f * np.sqrt(1 - z**2)
        late = np.maximum(times_s, 0)
        total += np.where(times_s > 0, g * natural**2 / damped * np.exp(-z * natural * late) * np.sin(damped * late), 0)
    return total


def lines_of(highest_hz=9_900.0, spacing_hz=4.0):
    frequency = np.arange(0, highest_hz, spacing_hz)
    fading = 0.5 * (1 + np.cos(np.pi * np.clip((frequency - 7000) / (highest_hz - 7000), 0, 1)))
    values = fading * response(frequency)
    return [[float(f), float(v.real), float(v.imag)] for f, v in zip(frequency, values, strict=True)]


def integral(lines, times_s):
    """The response at times (n,) to an impact of 1 N s at zero: ``2 Re int H exp(j w t) df``, by brute force."""
    hz, real, imaginary = np.array(lines).T
    grid = np.linspace(0, hz[-1], 8 * hz.size + 1)
    values = np.interp(grid, hz, real) + 1j * np.interp(grid, hz, imaginary)
    return np.array([2 * np.trapezoid(values * np.exp(2j * np.pi * grid * t), grid).real for t in times_s])


@pytest.mark.parametrize(("source", "modes"), [("stage 1", TABLE), ("output", RESIDUES)])
def test_lines_pass_the_modes_of_their_way(source, modes):
    plain, declared = made(), made(way(source, modes=modes))
    mine = np.array([source in name.split(", ")[0] for name in plain["truth_source_name"].values])
    assert mine.sum() == 1
    z, path_residues = (record["truth_amplitude"] for record in (plain, declared))
    own = plain["truth_component"].values == source
    frequency = np.outer(plain["truth_order"].values[own], plain["truth_speed"].values)
    # amplitudes are those at the first sensor, whose gain is 1
    assert_allclose(path_residues.values[1][own], z.values[0][own] * response(frequency), rtol=1e-9)
    assert_allclose(path_residues.values[1][~own], z.values[1][~own], rtol=1e-12)
    assert_allclose(path_residues.values[0], z.values[0], rtol=1e-12)
    others = plain["truth_source"].values[1][~mine].sum(axis=0)
    assert np.std(declared["b"].values - others - declared["truth_source"].values[1][mine][0]) < 1e-12


def test_a_response_in_g_is_told_in_the_units_of_the_sensor():
    z, in_g = (made(way("output", units=units))["truth_amplitude"].values[1] for units in ("m s-2", "g"))
    own = ~np.isclose(z, in_g).all(axis=1)
    assert_allclose(in_g[own], 9.80665 * z[own], rtol=1e-12)


def test_impacts_ring_the_modes_of_their_way():
    # right in the load zone: 0.3 N s each
    struck = [{"kind": "outer_race", "component": BEARING, "size_mm": 1.5, "impact_per_mm": 0.2}]
    plain, record = made(fault=struck, excitation=SILENT), made(way(BEARING), fault=struck, excitation=SILENT)
    at_s = record["truth_impact_times_1"].values
    # a path changes neither impacts nor what the other channel receives of them
    assert np.array_equal(plain["truth_impact_times_1"].values, at_s)
    assert_allclose(plain["a"].values, record["a"].values, rtol=0, atol=1e-12)
    times = np.arange(RATE // 2) / RATE
    expected = 0.3 * sum(impulse(times - t) for t in at_s)
    # what was struck before the record has died away to 1e-9 by then: exp(-0.04 x 2 pi x 900 x 0.1)
    after = times > at_s[0] + 0.1
    assert_allclose(record["b"].values[after], expected[after], atol=1e-8 * np.max(expected))


def test_impacts_on_a_measured_way_are_its_fourier_integral(tmp_path):
    lines = lines_of()
    text = "Hz,real,imaginary\n" + "\n".join(",".join(map(repr, line)) for line in lines)
    (tmp_path / "way.csv").write_text(text, encoding="utf-8")
    scene = SCENE | {
        "transfer": [way(BEARING, csv="way.csv")],
        "fault": [{"kind": "outer_race", "component": BEARING, "size_mm": 1.0, "impact_per_mm": 0.5}],
        "excitation": SILENT,
    }
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(scene), encoding="utf-8")
    record = simulate(load_scene(tmp_path / "scene.toml"), seed=2)
    # the scene in the record needs no file
    again = Scene.from_mapping(tomllib.loads(record.attrs["truth_scene"]))
    assert_allclose(again.transfers[0].lines, lines, rtol=1e-15)
    at_s = record["truth_impact_times_1"].values
    # about the fourth; those before the record have died away
    samples = np.arange(int(at_s[3] * RATE) - 2, int(at_s[3] * RATE) + 60)
    expected = sum(0.5 * integral(lines, samples / RATE - t) for t in at_s[:5])
    # the filter may lack 1e-3 of the root mean square, spread over its length
    assert_allclose(record["b"].values[samples], expected, atol=3e-3 * np.max(np.abs(expected)))


def test_impacts_that_press_for_a_while_pass_modes_and_measured_lines_alike():
    struck = [{"kind": "outer_race", "component": BEARING, "size_mm": 1.0, "pulse_share": 0.2, "impact_per_mm": 0.5}]
    modal, measured, at_once = (
        made(way(BEARING, **given), fault=[fault], excitation=SILENT)["b"].values[RATE // 10 :]
        for given, fault in (
            ({"modes": TABLE}, struck[0]),
            ({"lines": lines_of()}, struck[0]),
            ({"modes": TABLE}, struck[0] | {"pulse_share": 0.0}),
        )
    )
    # the lines fade above 7 kHz, where pulses of 0.2 ms have little
    assert_allclose(measured, modal, atol=0.03 * np.max(np.abs(modal)))
    assert np.std(modal) < 0.9 * np.std(at_once)


def test_a_tooth_s_impacts_have_the_lines_that_the_truth_states_on_any_way():
    steady = {"speed": {"link": "input", "rpm": 1500}, "duration_s": 1.0, "excitation": {"harmonics": 1}}
    crack = {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 1.0, "amplitude_per_mm": 0.01}
    for given in ({"modes": TABLE}, {"lines": lines_of()}):
        record = made(way("stage 1", **given), fault=[crack], **steady)
        turns = 25 * np.arange(RATE) / RATE + record["truth_revolutions"].values[0]
        stated = record["truth_amplitude"]
        orders = stated["truth_order"].values
        whole = [k for k, order in enumerate(orders) if order % 1 == 0]
        for k in (whole[3], whole[10], whole[20]):
            found = 2 * np.mean(record["b"].values * np.exp(-2j * np.pi * orders[k] * turns))
            # 25 turns in a second; other shafts' lines at broken orders leave some of their own in each
            assert abs(found - stated.values[1, k, 0]) < 2e-2 * np.max(np.abs(stated.values[1, whole]))


def test_what_follows_the_sensor_filters_a_way_too():
    chained = [
        SCENE["sensor"][0],
        SCENE["sensor"][1]
        | {
            "anti_alias": {"frequency_hz": 2000, "order": 3},
            "resonance": {"frequency_hz": 5200, "damping_ratio": 0.1},
        },
    ]
    struck = [{"kind": "outer_race", "component": BEARING, "size_mm": 1.0, "impact_per_mm": 0.5}]
    modal, measured = (
        made(way(BEARING, **given), fault=struck, excitation=SILENT, sensor=chained)["b"].values
        for given in ({"modes": TABLE}, {"lines": lines_of()})
    )
    # two ways to the same: by poles, and by a filter of taps; the lines fade above 7 kHz, where the chain lets pass 2 %
    after = slice(RATE // 10, None)
    assert_allclose(measured[after], modal[after], atol=0.01 * np.max(np.abs(modal)))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"transfer": [way("stage 9")]}, r'transfer names the source "stage 9"; did you mean "stage \d"\?'),
        ({"transfer": [way("housing")]}, 'transfer names the source "housing"; valid: .*"?input bearing'),
        ({"transfer": [way("output", sensor="c")]}, 'transfer names the sensor "c"; valid: a, b'),
        ({"transfer": [way("output"), way("output")]}, 'there are two transfers from "output" to "b"; keep one'),
        ({"transfer": [way("output", modes=TABLE, csv="x.csv")]}, "given by modes and csv; keep one"),
        ({"transfer": [{k: v for k, v in way("output").items() if k != "modes"}]}, "give modes, lines or csv"),
        ({"transfer": [way("output", csv="none.csv")]}, "cannot be read"),
        ({"transfer": [way("output", lines=[[5, 1, 0], [4, 1, 0]])]}, "4 Hz follows 5 Hz; sort them"),
        ({"transfer": [way("output", modes=[TABLE[0] | {"residue": [1, 0]}])]}, "both given; keep one"),
    ],
)
def test_ways_that_make_no_sense_are_refused(change, sentence):
    with pytest.raises(SceneError, match=sentence):
        Scene.from_mapping({**SCENE, **change})


def test_lines_too_far_apart_are_refused():
    sparse = [[0.0, 1.0, 0.0], [2000.0, -1.0, 1.0], [9000.0, 0.5, -1.0]]
    struck = [{"kind": "outer_race", "component": BEARING, "size_mm": 1.0}]
    with pytest.raises(SceneError, match='sensor "b": a measured transfer to it does not decay'):
        made(way(BEARING, lines=sparse), fault=struck)


# ---- gears that vibrate ------------------------------------------------------------------------------------------

MOVING = {
    **PAIR,
    "rate_hz": RATE,
    "duration_s": 1.0,
    "speed": {"link": "pinion", "rpm": 1470},
    "torque": {"link": "wheel", "nm": 200},
    "dynamics": {},
    "sensor": [{"name": name, "on": "pinion", "direction": [0, 1, 0], "units": "m s-2"} for name in ("a", "b")],
}
HOUSING_KG, MOUNTS_HZ, MOUNTS_ZETA = 15.0, 30.0, 0.3


def shaken(*transfers, loud, fidelity="dynamic", **changes):
    """Lines at whole multiples of the mesh order, and their Hz, of both channels."""
    dynamics = {
        "rigid_below_hz": 1e-6,  # weights act at every frequency
        "housing_kg": HOUSING_KG,
        "mounts": {"frequency_hz": MOUNTS_HZ, "damping_ratio": MOUNTS_ZETA},
        "sensor_weights": [{"sensor": name, "links": loud} for name in ("a", "b")],
        **({"meshes": {"mesh": {"shape": "constant", "error_um": 3}}, "floor_db": -40.0} if fidelity == "auto" else {}),
        "error": 1e-5,
    }
    record = simulate(
        Scene.from_mapping(
            MOVING | {"dynamics": dynamics, "transfer": list(transfers), "fidelity": fidelity} | changes
        ),
        seed=1,
    )
    # 490 Hz and its multiples, whole in a second; what folds back at 20 kHz falls between them
    hz = 490 * np.arange(1, 10)
    return hz, *(np.fft.rfft(record[name].values)[hz] * 2 / RATE for name in ("a", "b"))


def housing(frequency_hz):
    """``s^2 / (m (s^2 + 2 zeta w s + w^2))`` by scipy."""
    natural = 2 * np.pi * MOUNTS_HZ
    den = [HOUSING_KG, 2 * MOUNTS_ZETA * natural * HOUSING_KG, natural**2 * HOUSING_KG]
    return freqs([1, 0, 0], den, 2 * np.pi * np.asarray(frequency_hz, dtype=float))[1]


@pytest.mark.parametrize("fidelity", ["dynamic", "auto"])
@pytest.mark.parametrize("given", [{"modes": TABLE}, {"lines": lines_of()}], ids=["modes", "lines"])
def test_forces_of_gears_pass_a_way_in_place_of_the_housing(fidelity, given):
    ways = [way(link, **given) for link in ("pinion", "wheel")]
    hz, a, b = shaken(*ways, loud={"pinion": 1, "wheel": 1}, fidelity=fidelity)
    below = hz <= 4000  # where samples are set right to 5e-3, and measured lines hold to their leakage
    expected = (a / housing(hz) * response(hz))[below]
    assert_allclose(b[below], expected, atol=6e-3 * np.max(np.abs(expected)))


def test_what_has_no_way_of_its_own_passes_the_housing():
    only_wheel, only_pinion = ({"pinion": float(n), "wheel": float(1 - n)} for n in (0, 1))
    hz, wheel, _ = shaken(loud=only_wheel)
    _, pinion, _ = shaken(loud=only_pinion)
    _, both, mixed = shaken(way("pinion"), loud={"pinion": 1, "wheel": 1})
    # each run is true to 1e-5
    assert_allclose(both, wheel + pinion, atol=2e-5 * np.max(np.abs(both)))
    below = hz <= 4000
    expected = (wheel + pinion / housing(hz) * response(hz))[below]
    assert_allclose(mixed[below], expected, atol=6e-3 * np.max(np.abs(expected)))


def test_ways_from_teeth_in_motion_are_refused():
    with pytest.raises(SceneError, match='a transfer starts from the mesh "mesh"'):
        shaken(way("mesh"), loud={})


def test_a_sensor_in_motion_reads_a_share_of_what_is_across_it():
    def heard(direction, **more):
        sensors = [MOVING["sensor"][0] | {"direction": direction} | more]
        scene = Scene.from_mapping(MOVING | {"sensor": sensors, "duration_s": 0.2})
        return simulate(scene, seed=1)["a"].values

    up, aside = heard([0, 1, 0]), heard([0, 0, 1])
    skewed = heard([0, 1, 0], cross_axis={"share": 0.1})
    # the shafts lie along x, where nothing moves in a plane: what is left is a part of 0.1 of the motion along z
    added = skewed - up
    share = float(added @ aside / (aside @ aside))
    assert 0 < abs(share) <= 0.1
    assert_allclose(added, share * aside, atol=1e-6 * np.max(np.abs(up)))


def test_a_declared_way_passes_no_static_force():
    scene = load_scene("gears-in-motion").changed(duration_s=0.5, noise={"rms": 0}, faults=())
    sensor = scene.sensors[0].name
    ways = [way(source, sensor, scene.sensors[0].units) for source in ("input", "output")]
    torque = {"link": "output", "nm": [[0, 200], [0.5, 400]]}
    values = simulate(scene.changed(transfers=ways, torque=torque), seed=1)[sensor].values
    thirds = [np.mean(part) for part in np.array_split(values, 3)]
    assert np.max(np.abs(thirds)) < 0.02 * np.std(values)
