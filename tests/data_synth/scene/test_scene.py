import pytest

from data_synth import Scene, SceneError, load_scene, simulate
from data_synth.scene.scene import catalogue

PLAN = """
gearbox = "two-stage"
rate_hz = 50000
duration_s = 10
fidelity = "kinematic"          # or dynamic, auto
speed  = { link = "input", rpm = [[0, 600], [10, 1200]] }     # s, rpm; or csv = "..."
torque = { link = "output", nm = [[0, 500]] }
tachometer = { link = "input", pulses_per_rev = 1 }
[[fault]]
kind = "tooth_crack"
component = "stage 1/pinion"
depth_mm = 1.5
[[sensor]]
name = "input vertical"
on = "input bearing"
direction = [0, 0, 1]
units = "g"
"""  # the example of the house plan, word for word


@pytest.fixture
def write(tmp_path):
    def to_file(text):
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return to_file


def test_the_plan_s_example_is_read_and_simulated(write):
    scene = load_scene(write(PLAN))
    assert scene.gearbox.name == "two-stage"
    assert scene.speed.rpm == ((0.0, 600.0), (10.0, 1200.0))
    assert scene.samples == 500_000
    record = simulate(scene.changed(duration_s=0.3), seed=0)
    assert record["input vertical"].attrs["units"] == "g"
    assert list(record["truth_fault_component"].values) == ["stage 1/pinion"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"kinematic" ', '"cinematic" ', "fidelity = 'cinematic': input should be 'kinematic', 'dynamic' or 'auto'"),
        ('gearbox = "two-stage"', 'gearbox = "tow-stage"', 'gearbox of the catalogue; did you mean "two-stage"?'),
        ('"tooth_crack"', '"tooth_crak"', 'fault: number 1: kind = "tooth_crak" is not known; valid: tooth_crack, in'),
        ('kind = "tooth_crack"', "", "fault: number 1: kind is missing; valid: tooth_crack, inner_race"),
        (
            '"stage 1/pinion"',
            '"pinion"',
            (
                'fault 1: tooth_crack has no component "pinion"; valid: "stage 1/pinion", "stage 1/intermediate", '
                '"stage 2/intermediate", "stage 2/output"'
            ),
        ),
        (
            'kind = "tooth_crack"\ncomponent = "stage 1/pinion"\ndepth_mm',
            'kind = "cage"\ncomponent = "stage 1/pinion"\nsize_mm',
            'cage has no component "stage 1/pinion"; valid: "input bearing", "intermediate bearing"',
        ),
        ("depth_mm", "dept_mm", 'unknown key "dept_mm"; did you mean "depth_mm"?'),
        ("depth_mm = 1.5", "depth_mm = -1", "depth_mm = -1"),
        ("depth_mm = 1.5", "", "depth_mm is missing"),
        (
            'on = "input bearing"',
            'on = "imput bearing"',
            (
                'sensor "input vertical" is on "imput bearing", which is not a bearing, link or mesh of gearbox '
                '"two-stage"; did you mean "input bearing"?'
            ),
        ),
        ('units = "g"', 'units = "m/s2"', "sensor.1.units = 'm/s2': input should be 'g' or 'm s-2'"),
        ('speed  = { link = "input"', 'speed = { link = "imput"', 'speed names the link "imput"; did you mean "input"'),
        ('torque = { link = "output"', 'torque = { link = "x"', 'torque names the link "x"; valid: '),
        ('tachometer = { link = "input"', 'tachometer = { link = "housing"', '"housing", which does not turn'),
        ("[10, 1200]", "[0, 1200]", "speed.rpm: the times must rise, but 0 s follows 0 s; sort the knots"),
        ("[10, 1200]", "[10, 0]", "speed: rpm = 0 at some time, but the shaft must turn"),
        ("[10, 1200]", "[10, true]", "speed.rpm.2.2 = True"),
        (
            "pulses_per_rev = 1",
            "pulses_per_rev = 2, offset_rev = 0.5",
            "must be below the pulse spacing",
        ),
        ("rate_hz = 50000", "rate_hz = 16000", "resonance.frequency_hz = 8000 is not below half of rate_hz = 16000"),
        ("rate_hz = 50000", "rate_hz = true", "rate_hz = True"),
    ],
)
def test_what_is_wrong_reads_as_a_sentence(write, old, new, sentence):
    assert old in PLAN
    with pytest.raises(SceneError) as caught:
        load_scene(write(PLAN.replace(old, new, 1)))
    assert sentence in str(caught.value)


def test_sensors_have_their_own_names_and_one_unit(write):
    sensor = PLAN[PLAN.index("[[sensor]]") :]
    with pytest.raises(SceneError, match='two sensors are named "input vertical"'):
        load_scene(write(PLAN + sensor))
    other = sensor.replace('"g"', '"m s-2"').replace("vertical", "axial")
    with pytest.raises(SceneError, match='sensor "input axial" has units "m s-2" and "input vertical" "g"'):
        load_scene(write(PLAN + other))


def test_a_gearbox_without_reference_or_with_two_freedoms_is_refused():
    table = {
        "gearbox": {"name": "box", "frame": "housing", "axes": {"main": ["housing", "a"]}},
        "rate_hz": 1000,
        "duration_s": 1,
        "fidelity": "kinematic",
        "speed": {"link": "a", "rpm": 600},
        "tachometer": {"link": "a", "pulses_per_rev": 1},
        "sensor": [{"name": "x", "on": "a", "units": "g"}],
    }
    with pytest.raises(SceneError, match='gearbox "box" declares no reference shaft for orders'):
        Scene.from_mapping(table)
    loose = {**table["gearbox"], "reference": "a", "axes": {"main": ["housing", "a", "b"]}}
    with pytest.raises(SceneError, match="2 degrees of freedom"):
        Scene.from_mapping({**table, "gearbox": loose, "speed": {"link": "b", "rpm": 600}})


def test_a_gearbox_file_is_found_beside_the_scene(write, tmp_path):
    (tmp_path / "own.toml").write_text(
        'frame = "f"\nreference = "a"\n[axes]\nm = ["f", "a"]\n[[mesh]]\nteeth = { a = 20 }\ncarrier = "f"\n',
        encoding="utf-8",
    )
    text = PLAN[: PLAN.index("[[fault]]")] + PLAN[PLAN.index("[[sensor]]") :]
    text = text.replace("two-stage", "own.toml").replace('link = "input"', 'link = "a"')
    text = text.replace('"output"', '"a"').replace('"input bearing"', '"a-unknown"')
    assert load_scene(write(text)).gearbox.name == "own"


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # the shipped OH-58 as printed
def test_the_written_scene_reads_back_as_itself(tmp_path):
    for name in catalogue():
        scene = load_scene(name)
        path = tmp_path / "back.toml"
        path.write_text(scene.to_toml(), encoding="utf-8")
        assert load_scene(path) == scene


def test_an_unknown_scene_is_told_apart_from_a_missing_file():
    with pytest.raises(SceneError, match=r'"demmo" is neither .* of the catalogue; did you mean "demo"'):
        load_scene("demmo")
    with pytest.raises(SceneError, match="there is no such file"):
        load_scene("missing.toml")


RPM = "rpm = [[0, 600], [10, 1200]]"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [("0,600\n1,fast\n", "not have the columns s, rpm"), (None, "cannot be read")],
)
def test_speed_from_a_table_beside_the_scene(write, tmp_path, content, sentence):
    text = PLAN.replace(RPM, 'csv = "speed.csv"')
    (tmp_path / "speed.csv").write_text("time_s,rpm\n0,600\n2.5,900\n")
    assert load_scene(write(text)).speed.rpm == ((0.0, 600.0), (2.5, 900.0))
    (tmp_path / "speed.csv").write_text(content) if content else (tmp_path / "speed.csv").unlink()
    with pytest.raises(SceneError, match=sentence):
        load_scene(write(text))


def test_a_folder_of_the_same_name_does_not_hide_the_catalogue(tmp_path, monkeypatch):
    (tmp_path / "demo").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_scene("demo").gearbox.name == "two-stage"
