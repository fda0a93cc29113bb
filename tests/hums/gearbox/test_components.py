"""Hand-written files beyond any that a hand writes: a sentence, and quickly."""

import pytest

import hums
from data_synth import load_plan

BOX = 'name = "x"\nframe = "box"\nreference = "a"\n[axes]\none = ["box", "a"]\ntwo = ["box", "b"]\n'
BALLS = 'inner_ring = "a"\nouter_ring = "box"\nelements = 8\nelement_diameter_mm = 3\npitch_diameter_mm = 30\n'
PLAN = """\
records = 3
seed = 3
[scene]
gearbox = "two-stage"
rate_hz = 2000
duration_s = 1
fidelity = "kinematic"
speed = { link = "input", rpm = 600 }
tachometer = { link = "input", pulses_per_rev = 1 }
sensor = [{ name = "vib", on = "output", units = "g" }]
"""
LONGEST = 1000  # characters of a message


def teeth(number):
    return f"{BOX}[[mesh]]\nteeth = {{ a = {number}, b = 3 }}\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (teeth("9" * 300), r"teeth = 2\*\*996 or more: input should be less than"),
        (teeth("9" * 5000), "value out of range"),
        (teeth("2020-01-01"), r"teeth = datetime\.date\(2020, 1, 1\): input should be"),
        (f"{BOX}rigid = {'[' * 5000}{']' * 5000}", "over 50 levels deep"),
        (f"rigid = {'[' * 60}{']' * 60}\n{BOX}", "over 50 levels deep"),
        (f"{BOX}[[bearing]]\nnames = [{','.join(map(repr, map(str, range(2000))))}]\n{BALLS}", "at most 1000 items"),
        (BOX.replace('["box", "a"]', '{ links = ["box", "a"], copies = 20000 }'), "copies = 20000: .* equal to 100"),
        (BOX + "".join(f"k{number} = 3\n" for number in range(2000)), r"\(cut\)"),
        (f"{'k' * 50_000} = 3\n{BOX}", "unknown key"),
        ("#" * 1_000_001, "a hand-written file has at most"),
    ],
)
def test_a_gearbox(tmp_path, text, sentence):
    (tmp_path / "box.toml").write_text(text)
    with pytest.raises(hums.GearboxError, match=sentence) as caught:
        hums.load_gearbox(tmp_path / "box.toml")
    assert len(str(caught.value)) < LONGEST


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[[class]]\nname = "h"\n[[class.change.log]]\na = 1\n', "log is the distribution of a value"),
        ('[[class]]\nname = "h"\nchange = { fault = 0.5 }\n', r"fault = 0\.5: give a list in brackets"),
        ('[[class]]\nname = "h"\nchange = { fault = 2020-01-01 }\n', "a scene has no dates or times"),
        ("".join(f'[[class]]\nname = "{number}"\n' for number in range(2000)), "at most 1000 items"),
    ],
)
def test_a_plan(tmp_path, text, sentence):
    (tmp_path / "plan.toml").write_text(PLAN + text)
    with pytest.raises(ValueError, match=sentence) as caught:
        load_plan(tmp_path / "plan.toml")
    assert len(str(caught.value)) < LONGEST


@pytest.mark.parametrize("harmonics", [10**400, 10**7])
def test_more_lines_than_fit(harmonics):
    table = hums.defect_orders(hums.load_gearbox("two-stage"))
    with pytest.raises(ValueError, match="are over 10000000 lines; reduce harmonics"):
        hums.order_families(table, harmonics=harmonics, sidebands=1)
