"""Where rolling elements are while a defect is struck with slip, against the kinematics of bearings; how hard it is."""

import numpy as np
import pytest
from gearboxes import TWO_STAGE, held_planetary
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate

RATE = 16_000
BEARING = "intermediate bearing"
SCENE = {
    **TWO_STAGE,
    "rate_hz": RATE,
    "duration_s": 2.0,
    "speed": {"link": "input", "rpm": [[0, 1400], [2, 1500]]},
    "resonance": {"frequency_hz": 3000, "damping_ratio": 0.1},
    "excitation": {"shaft_amplitude": 0, "mesh_amplitude": 0},
}
SHAFT = -23 / 67  # of the bearing's, against the input


def made(*faults, seed=3, **changes):
    return simulate(Scene.from_mapping(SCENE | {"fault": list(faults)} | changes), seed=seed, phases=True)


def fault(kind, **more):
    return {"kind": kind, "component": BEARING, "size_mm": 1.0, **more}


def geometry():
    bearings = Scene.from_mapping(SCENE).gearbox.bearings
    (bearing,) = (declared for declared in bearings if BEARING in declared.names)
    ratio = bearing.element_diameter_mm / bearing.pitch_diameter_mm
    return bearing.elements, ratio, ratio * np.cos(np.radians(bearing.contact_angle_deg))


def at_impacts(record, part, *, of="roller", number=1):
    name = f"{BEARING}/{part}" if of == "roller" else part
    phases = record[f"truth_{of}_revolutions"].sel({f"truth_{of}": name}).values
    return np.interp(record[f"truth_impact_times_{number}"].values, record["time"].values, phases)


KINDS = ("inner_race", "outer_race", "rolling_element", "cage")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("slip", [{"slip_std": 0.0}, {"slip_std": 0.02, "mean_slip": 0.05}])
def test_impacts_fall_at_whole_turns_of_the_stated_phase(kind, slip):
    record = made(fault(kind, **slip))
    struck = at_impacts(record, f"{kind} strike")
    # an impact between two samples bends the phase between them: by the slip, of a turn in 16000 / 130 samples
    assert_allclose(struck, np.round(struck), atol=3e-4)
    assert_allclose(np.diff(np.round(struck)), 1, atol=0)
    # so does what strikes: an element at the spot of a race, a spot of an element at either race, the cage
    elements, _, _ = geometry()
    cage, element = at_impacts(record, "cage"), at_impacts(record, "element")
    ring = at_impacts(record, "intermediate", of="shaft")
    turns = {"outer_race": elements * cage, "inner_race": elements * (ring - cage), "rolling_element": 2 * element}
    mine = turns.get(kind, cage)
    assert_allclose(np.abs(np.diff(mine)), 1, atol=6e-4)
    if kind == "outer_race":  # a spot in the middle of the load zone
        assert_allclose(mine, np.round(mine), atol=3e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_on_average_the_cage_slips_as_declared(kind):
    elements, ratio, along = geometry()
    record = made(fault(kind, slip_std=0.0, mean_slip=0.04))
    shaft, turned = (
        np.ptp(record[f"truth_{what}_revolutions"].sel({f"truth_{what}": name}).values)
        for what, name in (("shaft", "intermediate"), ("roller", f"{BEARING}/cage"))
    )
    rolling = (1 - along) / 2
    expected = {"inner_race": 1 - 0.96 * (1 - rolling), "rolling_element": 0.96 * rolling}.get(kind, 0.96 * rolling)
    # phases at the ends of the record
    assert turned / shaft == pytest.approx(expected, rel=1e-9)
    phases = record["truth_roller_revolutions"].sel(truth_roller=[f"{BEARING}/cage", f"{BEARING}/element"]).values
    spin = (1 - along**2) / ratio / 2
    # between two strikes cage and elements go on as in pure rolling
    assert np.ptp(phases[1]) / shaft == pytest.approx(0.96 * spin, rel=1e-9)
    # the inner ring turns backwards, and so does the cage
    assert phases[0, -1] < phases[0, 0]
    assert elements * turned > 10


def test_two_defects_of_a_bearing_have_a_phase_each():
    record = made(fault("outer_race", slip_std=0.02), fault("inner_race", slip_std=0.02))
    rollers = [str(name) for name in record["truth_roller"].values]
    assert rollers[:4] == [
        f"{BEARING}/{part}" for part in ("cage", "element", "outer_race strike", "inner_race strike")
    ]
    struck = at_impacts(record, "inner_race strike", number=2)
    assert_allclose(struck, np.round(struck), atol=3e-4)


@pytest.mark.slow
def test_lines_melt_in_scenes_as_renewal_theory_says():
    # coth((2 pi k sigma)^2 / 4) at sigma = 1 %: 40.54, 10.165, 2.663. 10 scenes, 900 trains of 1000 impacts
    slow = SCENE | {"rate_hz": 1300, "resonance": {"frequency_hz": 500, "damping_ratio": 0.5}, "duration_s": 2000.0}
    slow |= {"speed": {"link": "input", "rpm": 1500}, "excitation": SCENE["excitation"] | {"harmonics": 1}}
    elements, _, along = geometry()
    rate_hz = 25 * -SHAFT * elements * (1 - along) / 2
    power = {5: [], 10: [], 20: []}
    for seed in range(10):
        record = simulate(Scene.from_mapping(slow | {"fault": [fault("outer_race", slip_std=0.01)]}), seed=seed)
        turns = record["truth_impact_times_1"].values * rate_hz
        for train in np.split(turns[: turns.size // 1000 * 1000], turns.size // 1000):
            for line, found in power.items():
                found.append(np.abs(np.sum(np.exp(-2j * np.pi * line * train))) ** 2 / train.size)
    assert len(power[5]) > 900
    for line, expected in {5: 40.54, 10: 10.165, 20: 2.663}.items():
        # 900 values of a chi-square with two degrees of freedom: 3.3 %, 4 of that; trains are too short by 4 % at most
        assert np.mean(power[line]) == pytest.approx(expected, rel=0.15)


# ---- how hard it strikes -----------------------------------------------------------------------------------------


def heard(kind, **more):
    """The largest sample after each impact, which a ringing of a tenth of damping reaches in a sixth of a period."""
    record = made(fault(kind, **more), rate_hz=64_000, speed={"link": "input", "rpm": 1500})
    at = np.ceil(record["truth_impact_times_1"].values * 64_000).astype(int)
    return record, np.array([np.max(np.abs(record["a"].values[i : i + 16])) for i in at[at < 127_000]])


def test_the_place_of_a_spot_of_the_outer_ring_says_its_load():
    full, _ = (heard("outer_race", slip_std=0.0, **more)[1][5] for more in ({}, {}))
    # Stribeck: 1 - (1 - cos 40 deg) / (2 e), to the power of the contact
    for exponent in (1.5, 10 / 9):
        aside = heard("outer_race", slip_std=0.0, place_deg=40, load_distribution=0.4, load_exponent=exponent)[1][5]
        share = (1 - (1 - np.cos(np.radians(40))) / 0.8) ** exponent
        # of samples a 21st of a period apart the largest is known to (pi / 21)^2 / 2
        assert aside / full == pytest.approx(share, rel=0.02)


def test_strikes_of_an_element_on_the_inner_race_are_as_hard_as_declared():
    more = {"slip_std": 0.0, "load_distribution": 1.0}
    _, sizes = heard("rolling_element", inner_share=0.25, **more)
    _, alike = heard("rolling_element", **more)
    shares = sizes[3:60] / alike[3:60]
    on_outer = shares > 0.6
    # every other one; the ringing of the last, 3 % of it, is in each
    assert np.all(on_outer[1:] != on_outer[:-1])
    assert_allclose(np.median(shares[on_outer]), 1, atol=0.05)
    assert_allclose(np.median(shares[~on_outer]), 0.25, atol=0.05)


def test_a_load_that_turns_with_the_ring_beats_a_spot_of_it_alike():
    def swing(**more):
        sizes = heard("inner_race", slip_std=0.0, load_distribution=1.0, **more)[1][3:]
        return np.ptp(sizes) / np.max(sizes)

    assert swing() > 0.5
    assert swing(load_turns_with="intermediate") < 0.05


def test_an_element_drops_into_a_spall_before_it_strikes():
    record, _ = heard("outer_race", slip_std=0.0, entry_share=-0.4, size_mm=2.0)
    is_entry, impacts = record["truth_entry_times_1"].values, record["truth_impact_times_1"].values
    # half of the spall at the speed of the contact: the cage's, on the circle of the race
    bearing = next(b for b in Scene.from_mapping(SCENE).gearbox.bearings if BEARING in b.names)
    _, _, along = geometry()
    cage_hz = 25 * -SHAFT * (1 - along) / 2
    race_mm = np.pi * bearing.pitch_diameter_mm * (1 + along)
    assert_allclose(impacts[1:20] - is_entry[1:20], 1.0 / (race_mm * cage_hz), rtol=1e-9)
    plain, _ = heard("outer_race", slip_std=0.0, size_mm=2.0)
    assert np.array_equal(plain["truth_impact_times_1"].values, impacts)
    times = np.arange(128_000) / 64_000
    natural = 2 * np.pi * 3000
    damped = natural * np.sqrt(1 - 0.01)

    def ring(at_s):
        late = np.maximum(times - at_s, 0)
        return np.exp(-0.1 * natural * late) * np.sin(damped * late)

    added = record["a"].values - plain["a"].values
    # entries before the record have died away
    expected = -0.4 * 2.0 * sum(ring(at) for at in is_entry)
    assert_allclose(added[6400:], expected[6400:], atol=1e-9)
    grown = made(fault("outer_race", entry_share=-0.4, growth={"rate_mm_per_s": 1.0, "largest_mm": 3.0}))
    ahead = grown["truth_impact_times_1"].values[1:] - grown["truth_entry_times_1"].values[1:]
    assert ahead[-1] / ahead[0] == pytest.approx(3 * 1400 / 1500, rel=0.05)


def test_an_impact_may_press_as_long_as_a_share_of_the_spall_is_passed():
    more = {"slip_std": 0.0, "size_mm": 1.2}
    plain, pressed = (heard("outer_race", **more, **share)[0] for share in ({}, {"pulse_share": 0.25}))
    impacts = plain["truth_impact_times_1"].values
    assert np.array_equal(pressed["truth_impact_times_1"].values, impacts)
    # the spall at the speed of the contact, as of an entry
    _, _, along = geometry()
    lasting = 0.25 * 1.2 / (np.pi * 62 * (1 + along) * 25 * -SHAFT * (1 - along) / 2)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    times = np.arange(128_000) / 64_000
    natural = 2 * np.pi * 3000
    at = impacts[20]
    near = (times > at - 1e-4) & (times < at + lasting + 2e-3)
    expected = np.zeros(near.sum())
    for struck in impacts[10:21]:  # the mean ringing over the time it presses, panel by panel where it begins
        since = times[near] - struck
        end = np.clip(since, 0, lasting)
        ages = since[:, None] - end[:, None] * (nodes + 1) / 2
        ring = np.exp(-0.1 * natural * ages) * np.sin(natural * np.sqrt(1 - 0.01) * ages) * (ages > 0)
        expected += 1.2 * (ring @ weights) / 2 * end / lasting
    assert_allclose(pressed["a"].values[near], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (fault("cage", place_deg=10.0), "place_deg applies to inner_race and outer_race, not to cage"),
        (fault("outer_race", inner_share=0.5), "inner_share applies to rolling_element"),
        (fault("cage", entry_share=-0.5), "entry_share applies to inner_race and outer_race, not to cage"),
        (fault("cage", load_distribution=0.4), "load_distribution applies to inner_race, outer_race and"),
        (fault("inner_race", place_deg=30.0), "applies to a ring at rest in its load zone, but the inner ring of"),
        (fault("outer_race", entry_share=-0.5, size_mm=40.0), r"40 mm extends to the next contact, 17\.2 mm away"),
        (fault("outer_race", load_turns_with="output shaft"), 'load_turns_with names "output shaft"; did you mean'),
    ],
)
def test_what_makes_no_sense_is_refused(change, sentence):
    with pytest.raises(SceneError, match=sentence):
        made(change)


def test_an_entry_needs_a_geometry():
    gearbox = Scene.from_mapping(SCENE).gearbox.model_dump(mode="json", by_alias=True, exclude_none=True)
    for bearing in gearbox["bearing"]:
        for key in ("elements", "element_diameter_mm", "pitch_diameter_mm", "contact_angle_deg"):
            bearing.pop(key, None)
        bearing["multiples"] = {"inner": 7.1, "outer": 4.9, "element_spin": 2.6, "cage": 0.41}
    with pytest.raises(SceneError, match='entry_share needs the geometry of "intermediate bearing"'):
        made(fault("outer_race", entry_share=-0.5), gearbox=gearbox)


PLANETARY = held_planetary(24, 36, 96) | {
    "bearing": [
        {"names": ["planet bearing"], "inner_ring": "carrier", "outer_ring": "planet", "elements": 9,
         "element_diameter_mm": 4.7, "pitch_diameter_mm": 25.5},
    ],
}  # fmt: skip


def pin(**more):
    """What a spall of the inner race on a planet's pin adds to the record, RMS, for some seeds."""
    found = []
    for seed in range(6):
        scene = Scene.from_mapping(
            {
                **SCENE, "gearbox": PLANETARY, "duration_s": 0.5, "speed": {"link": "sun", "rpm": 1200},
                "tachometer": {"link": "sun", "pulses_per_rev": 1},
                "sensor": [{"name": "a", "on": "ring", "units": "g"}],
                "fault": [{"kind": "inner_race", "component": "planet bearing", "size_mm": 1.0, **more}],
            }
        )  # fmt: skip
        faulty, sound = (simulate(each, seed=seed)["a"].values for each in (scene, scene.changed(faults=())))
        found.append(np.std(faulty - sound))
    return np.array(found)


def test_an_inner_race_at_rest_is_struck_where_it_is_placed():
    middle, edge, beyond = (pin(place_deg=degrees, slip_std=0.0) for degrees in (0, 60, 180))
    assert np.all(middle > 1.5 * edge)
    assert np.all(edge > 0)
    assert np.all(beyond == 0)
    assert np.all(pin() > 0)  # the middle of the zone where no place is given
