"""The page of a turning mechanism: its numbers are those of Python, and it needs nothing but itself."""

import warnings

import numpy as np
import pytest
from browser import show
from gearboxes import VARIED

from hums.drawing import free_links, write_drawing
from hums.gearbox.defect_orders import defects
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning, catalogue, load_gearbox

NAMES = tuple(catalogue())
POSITIONS = 66  # of the sliders, over all these gearboxes


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Write the page of every gearbox of the catalogue."""
    folder = tmp_path_factory.mktemp("pages")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)
        solved = {name: solve_kinematics(load_gearbox(name)) for name in NAMES}
    return {
        name: (kinematics, write_drawing(kinematics, folder / f"{name}.html")) for name, kinematics in solved.items()
    }


@pytest.mark.parametrize("name", VARIED)
def test_numbers_are_those_of_python(browser, pages, name):
    kinematics, page = pages[name]
    assert show(browser, page) == []
    assert browser.get_log("browser") == []
    rng = np.random.default_rng(NAMES.index(name))
    count = -(-POSITIONS // len(VARIED))
    settings = [[round(float(rpm), 3) for rpm in rng.uniform(-3000, 3000, kinematics.dof)] for _ in range(count)]
    answers = browser.execute_script(
        "return arguments[0].map(rpm => JSON.parse(JSON.stringify(setSpeeds(rpm))))", settings
    )
    reference = kinematics.gearbox.reference
    for setting, answer in zip(settings, answers, strict=True):
        speeds = dict(zip(free_links(kinematics), setting, strict=True))
        reference_hz = (
            abs(float(kinematics.relative_speed(reference, seen_from=kinematics.gearbox.frame, speeds=speeds))) / 60
        )
        expected = {(row.component, row.kind): row for row in defects(kinematics, speeds=speeds)}
        assert {(row["component"], row["kind"]) for row in answer["rows"]} == set(expected)
        for row in answer["rows"]:
            known = expected[row["component"], row["kind"]]
            assert row["order"] == pytest.approx(known.order, rel=1e-9)
            assert row["hz"] == pytest.approx(known.order * reference_hz, rel=1e-9)
        vectors = kinematics.vectors(speeds)
        for body, vector in answer["vectors"].items():
            np.testing.assert_allclose(vector, vectors.sel(link=body), atol=1e-9 * abs(vectors).max())


def test_exact_orders(browser, pages):
    kinematics, page = pages["car-differential"]  # two degrees of freedom: orders depend on the speeds
    show(browser, page)
    rows = browser.execute_script("return setSpeeds([28, 26]).rows")
    shown = {(row["component"], row["kind"]): row["exact"] for row in rows}
    known = {(row.component, row.kind): row for row in defects(kinematics, speeds={"cage": 28, "left wheel": 26})}
    assert all(exact == ("" if known[key].exact is None else str(known[key].exact)) for key, exact in shown.items())
    assert shown["drive shaft-cage", "gear_mesh"] == "65"


def test_sliders_move_the_table_and_the_keyboard_moves_them(browser, pages):
    from selenium.webdriver.common.by import By  # noqa: PLC0415
    from selenium.webdriver.common.keys import Keys  # noqa: PLC0415

    show(browser, pages["two-stage"][1])
    slider = browser.find_element(By.CSS_SELECTOR, "input[type=range]")
    slider.send_keys(Keys.ARROW_RIGHT)
    mesh = browser.find_elements(By.CSS_SELECTOR, "#orders tbody tr")[3].text.split()
    assert mesh[-6:-2] == ["23", "23", str(float(f"{1501 * 23 / 60:.7g}")), str(1501 * 23)]
    button = browser.find_element(By.ID, "play")
    before = browser.execute_script("return Object.values(angles)")
    button.send_keys(Keys.ENTER)
    browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(() => arguments[0]()))")
    assert button.get_attribute("aria-pressed") == "true"
    browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(() => arguments[0]()))")
    assert browser.execute_script("return Object.values(angles)") != before


@pytest.mark.parametrize("width", [1280, 400])
def test_fits_the_screen_and_loads_nothing_else(browser, pages, width):
    assert show(browser, pages["planetary-27-36-99"][1], width=width) == []
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width


class TestRefused:
    def test_other_files(self, tmp_path):
        with pytest.raises(ValueError, match=r'has the suffix ".svg"; use .html'):
            write_drawing(load_gearbox("two-stage"), tmp_path / "x.svg")

    def test_too_few_speeds(self, tmp_path):
        with pytest.raises(ValueError, match="needs speeds of 2 links, but 1 are given"):
            write_drawing(load_gearbox("car-differential"), tmp_path / "x.html", speeds_rpm={"cage": 100})

    def test_no_reference(self, tmp_path):
        table = {"name": "pair", "frame": "box", "axes": {"one": ["box", "a"], "two": ["box", "b"]}}
        gearbox = Gearbox.from_mapping(table | {"mesh": [{"teeth": {"a": 20, "b": 41}}]})
        with pytest.raises(GearboxError, match="declares no reference shaft"):
            write_drawing(gearbox, tmp_path / "x.html")
        assert not list(tmp_path.iterdir())


def test_a_name_cannot_end_the_script(tmp_path):
    name = "</script><b>a"
    axes = {"one": ["box", name], "two": ["box", "b"]}
    table = {"name": name, "frame": "box", "reference": name, "axes": axes, "mesh": [{"teeth": {name: 20, "b": 41}}]}
    text = write_drawing(Gearbox.from_mapping(table), tmp_path / "x.html").read_text(encoding="utf-8")
    assert name not in text
    assert text.count("</script>") == 2
