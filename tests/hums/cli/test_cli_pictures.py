"""The commands that draw, in process: which files they write, what they print, and how they fail."""

import math
import re

import pytest

from hums.drawing import free_links
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import catalogue, load_gearbox


def test_drawing_of_all_pictures(run, tmp_path):
    code, out, err = run("drawing", "car-differential", "-o", tmp_path / "pictures")
    assert code == 0
    assert err == "speeds: cage 1500 rpm, left wheel 0 rpm\n"  # two degrees of freedom: what is chosen is said
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {
        "mechanism.svg",
        "velocities.svg",
        "orders.svg",
        "graph.svg",
    }
    assert out.count("wrote") == 4
    assert ">planet a" in (tmp_path / "pictures" / "mechanism.svg").read_text(encoding="utf-8")


def test_drawing_of_one_picture_and_of_a_page(run, tmp_path):
    assert run("drawing", "two-stage", "-o", tmp_path / "v.png", "--picture", "velocities")[0] == 0
    assert (tmp_path / "v.png").read_bytes().startswith(b"\x89PNG")
    assert run("drawing", "two-stage", "-o", tmp_path / "p.html", "--speed", "output=100")[0] == 0
    assert '"link": "output", "rpm": 100.0' in (tmp_path / "p.html").read_text(encoding="utf-8")
    assert run("drawing", "ravigneaux", "--picture", "graph", "-o", tmp_path / "g.svg")[0] == 0
    assert "turning pair" in (tmp_path / "g.svg").read_text(encoding="utf-8")
    code, _, err = run("drawing", "two-stage", "-o", tmp_path / "m.jpg")
    assert (code, "a figure ends in .svg, .png or .pdf" in err, (tmp_path / "m.jpg").exists()) == (2, True, False)


def test_dynamics_of_a_gearbox(run, tmp_path):
    code, out, err = run("dynamics", "wijianto-pair", "-o", tmp_path, "--motions", "torsion")
    assert (code, err) == (0, "")
    assert {path.name for path in tmp_path.iterdir()} == {"modes.svg", "campbell.svg"}
    _, rigid, elastic, assumed, *_ = out.splitlines()
    assert ("rigid" in rigid, "rotational" in elastic) == (True, True)
    # both mode shapes of a torsional pair share their energy as inertia over inertia, r2^2 to r1^2 per unit of J
    assert "gear" in rigid
    assert "rigid shafts" in assumed
    assert "1e+08 N/m" in assumed


def test_dynamics_says_what_it_assumes_for_dimensions_that_are_not_declared(run, tmp_path):
    path = tmp_path / "box.toml"
    path.write_text(
        'name = "box"\nframe = "frame"\nreference = "a"\n[axes]\none = ["frame", "a"]\ntwo = ["frame", "b"]\n'
        '[[mesh]]\nname = "stage"\nteeth = { a = 20, b = 40 }\n'
    )
    code, out, err = run("dynamics", path)
    assert (code, err) == (0, "")
    assert "module_mm 3, face_width_mm 30, pressure_angle_deg 20 where stage declare none" in out
    assert "module_mm" not in run("dynamics", "wijianto-pair")[1]


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")  # planets of the OH-58 are not evenly spaced
def test_every_gearbox_of_the_catalogue_has_dynamics(run):
    for name in catalogue():
        links = free_links(solve_kinematics(load_gearbox(name)))
        given = [word for link in links for word in ("--speed", f"{link}=100")]
        assert run("dynamics", name, *given)[0] == 0, name


def test_meshes_that_repeat_a_constraint(run):
    assert run("orders", "two-stage", "--redundant")[1] == "no mesh is redundant\n"
    out = run("orders", "planetary-27-36-99", "--redundant")[1]
    # one planet fixes all ratios
    assert out == "planet-ring (planet 2 and planet 3): constraint already imposed by the preceding meshes\n"


def test_bearings(run):
    code, out, _ = run("bearings", "Rexnord ZA-2115")
    assert code == 0
    # 16 rollers of 0.331 inch on 2.815 inch at 15.17 degrees: BPFI = 16/2 (1 + 0.331/2.815 cos 15.17 degrees)
    assert re.search(r"Rexnord ZA-2115 +16 +8.407 +71.5 +15.17 +8.908 .* \[1\]\n.*\[1\] Qiu, Lee, Lin", out, re.DOTALL)
    out = run("bearings", "FAG 6205-2RSR")[1]
    assert re.search(r"FAG 6205-2RSR .* 3.572 .* 1.5% +\[1\]\n.*\[1\] Typical of its series, check", out, re.DOTALL)
    assert "TPI 6205" in out
    listed = re.findall(r"^ *(\S+) \(typical\)", run("bearings", "222")[1], re.MULTILINE)
    assert len(listed) > 10
    assert all(name.startswith("222") for name in listed)
    assert "numbers of rolling elements differ" in run("bearings", "6203")[1]
    assert 'no bearing "7000"' in run("bearings", "7000")[2]


def test_orders_in_hz(run):
    _, out, _ = run("orders", "two-stage", "--csv", "--rpm", 1500)
    header, *lines = out.splitlines()
    mesh = dict(zip(header.split(","), next(line for line in lines if "gear_mesh" in line).split(","), strict=True))
    assert (float(mesh["hz"]), float(mesh["cpm"])) == (23 * 1500 / 60, 23 * 1500)
    assert run("orders", "two-stage")[2] == "note: No bearing is declared on output.\n"


def test_stability_of_wijianto(run, tmp_path):
    # undamped, the pair is unstable at mesh frequencies from 1256.6497 to 1502.8244 rad/s, twice the second natural
    # frequency between them (Floquet, fifty digits); the pinion has 36 teeth
    words = ("--stability", "--stability-speeds", 12, "--rpm", 500, "-o", tmp_path)
    code, out, err = run("dynamics", "wijianto", *words)
    assert code == 0
    assert "note" not in err
    (line,) = (line for line in out.splitlines() if "unstable" in line)
    rpm = [float(number) for number in line.partition(":")[2].split(",")]
    mesh_rad_s = [36 * speed * math.pi / 30 for speed in rpm if 36 * speed * math.pi / 30 > 1000]  # above the next one
    assert all(1256.6497 < frequency < 1502.8244 for frequency in mesh_rad_s)
    assert min(abs(frequency - 2 * 692.22774872) for frequency in mesh_rad_s) < 1  # four figures are printed
    assert (tmp_path / "stability.svg").exists()
