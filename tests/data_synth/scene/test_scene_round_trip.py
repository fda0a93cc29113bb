"""A scene that was written out is read back as the same scene, and makes the same record, bit for bit."""

import tomllib

import xarray as xr
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from data_synth import Scene, load_scene, simulate

SHARES = st.floats(0.01, 0.9)
GEARS = ["stage 1/pinion", "stage 1/intermediate", "stage 2/intermediate", "stage 2/output"]
BEARINGS = ["input bearing", "intermediate bearing"]
SHAFTS = ["input", "intermediate", "output"]
GROWTHS = st.fixed_dictionaries(
    {"rate_mm_per_s": SHARES, "largest_mm": st.floats(0.2, 0.3)}, optional={"exponent": st.just(3.0)}
)
TURNS = st.floats(0, 0.99)
GEAR_KEYS = {
    "growth": GROWTHS,
    "amplitude_per_mm": SHARES,
    "phase_rad_per_mm": SHARES,
    "impact_per_mm": SHARES,
    "size_exponent": SHARES,
    "load_exponent": SHARES,
    "offset_rev": TURNS,
}
CRACK_KEYS = GEAR_KEYS | {"angle_deg": st.floats(20, 90), "compliance": st.just("fracture_mechanics")}
KINDS = {
    "tooth_crack": (GEARS, "depth_mm", CRACK_KEYS),
    **dict.fromkeys(("chipping", "missing_tooth"), (GEARS, "size_mm", GEAR_KEYS)),
    **dict.fromkeys(("spall", "pitting"), (GEARS, "size_mm", GEAR_KEYS | {"width_mm": SHARES})),
    **dict.fromkeys(("eccentricity", "misalignment", "wear"), (GEARS, "size_mm", {"growth": GROWTHS})),
    "imbalance": (SHAFTS, "size_mm", {"growth": GROWTHS, "rotor_kg": SHARES, "offset_rev": TURNS}),
    "bent_shaft": (SHAFTS, "size_mm", {"growth": GROWTHS, "amplitude_per_mm": SHARES, "offset_rev": TURNS}),
    "shaft_misalignment": (SHAFTS, "size_mm", {"amplitude_per_mm": SHARES, "offset_rev": TURNS}),
    "inner_race": (BEARINGS, "size_mm", {"load_distribution": SHARES, "load_turns_with": st.just("output")}),
    "outer_race": (BEARINGS, "size_mm", {"place_deg": st.floats(0, 90), "entry_share": SHARES, "pulse_share": SHARES}),
    "rolling_element": (BEARINGS, "size_mm", {"growth": GROWTHS, "inner_share": SHARES, "slip_std": st.just(0.02)}),
    "cage": (BEARINGS, "size_mm", {"growth": GROWTHS, "impact_per_mm": SHARES}),
}
IMPERFECTIONS = {
    **dict.fromkeys(("bearings", "neighbour", "knocks", "noise", "mounts", "gains", "temperature"), st.just({})),
    "gears": st.just({"grade": 7}),
    "imbalance": st.fixed_dictionaries({"rotor_kg": SHARES | st.just(dict.fromkeys(SHAFTS, 2.0))}),
    "electrical": st.sampled_from([{}, {"inverter": {"output_hz": 40.0}}, {"inverter": {"link": "input"}}]),
}
SPEEDS = [
    {"link": "input", "rpm": 1485.5},
    {"link": "output", "rpm": [[0, 60], [0.2, 90.5]]},
    {"link": "input", "steps": [[0, 900], [0.1, 1200]]},
    {"link": "input", "rpm": 1500, "turbulence": {"rms": 20.0, "time_scale_s": 0.5}},
]
SENSORS = {
    "anti_alias": st.sampled_from(["none", {"order": 8}]),
    "clipping": st.just({"level": 0.5}),
    "quantisation": st.just({"bits": 12, "full_scale": 10.0}),
    "sensitivity": st.just({"value": 0.1, "units": "V"}),
}


@st.composite
def faults(draw):
    kind = draw(st.sampled_from(sorted(KINDS)))
    components, size, optional = KINDS[kind]
    required = {"kind": st.just(kind), "component": st.sampled_from(components), size: st.floats(0.02, 0.2)}
    return draw(st.fixed_dictionaries(required, optional=optional))


@st.composite
def scenes(draw):
    gears = tomllib.loads(load_scene("gears-in-motion").to_toml())
    gears |= {"fidelity": "kinematic", "duration_s": 0.2, "rate_hz": 20_000.0}
    sensor = gears["sensor"][0] | draw(st.fixed_dictionaries({}, optional=SENSORS))
    drawn = {
        "fault": draw(st.lists(faults(), min_size=1, max_size=3)),
        "imperfections": draw(st.fixed_dictionaries({}, optional=IMPERFECTIONS)),
        "speed": draw(st.sampled_from(SPEEDS)),
        "sensor": [sensor],
    }
    return Scene.from_mapping(gears | drawn)


def read_back(scene):
    return Scene.from_mapping(tomllib.loads(scene.to_toml()))


@given(scenes())
@settings(max_examples=100, deadline=None, phases=[Phase.generate])
def test_a_scene_that_was_written_out_is_read_back(scene):
    assert read_back(scene) == scene


@given(scenes(), st.integers(0, 9))
@settings(max_examples=6, deadline=None, phases=[Phase.generate])
def test_a_scene_that_was_read_back_makes_the_same_record(scene, seed):
    record = simulate(scene, seed=seed)
    again = Scene.from_mapping(tomllib.loads(record.attrs["truth_scene"]))
    xr.testing.assert_identical(simulate(again, seed=seed), record)
