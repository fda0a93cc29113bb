"""The code of two pages runs as printed; its results make their tables and pictures."""

import re

import numpy as np
import pages
import pytest

# printed with other parameters than given, or found by steps in speed
ROUGH = {
    "3 planets, rotational modes, Hz": 0.07,
    "3 planets, translational modes, Hz": 0.07,
    "4 planets, rotational modes, Hz": 0.07,
    "4 planets, translational modes, Hz": 0.28,
    "speeds with two motions, steps of 0.01": 0.01,
}


@pytest.fixture(scope="module")
def dynamics():
    return pages.run(pages.DOCS / "dynamics.md")


def test_the_code_of_the_page_on_physics_runs_and_meets_its_numbers():
    assert pages.run(pages.TABLES[1])  # which asserts them; pages outside of docs/benchmarks run when they are built


def test_known_numbers_are_met(dynamics):
    assert {*ROUGH} < {quantity for quantity, *_ in dynamics["known"]}
    for quantity, _, known, ours in dynamics["known"]:
        text = [repr(value).split("e") for value in known]
        unit = [10.0 ** (int((more or ["0"])[0]) - len(digits.partition(".")[2])) for digits, *more in text]
        # half a unit of the last digit, or the 3e-11 that rounding costs the smallest state over 2652 periods, doubled
        bound = np.maximum(ROUGH.get(quantity, 0.51 * np.array(unit)), 6e-11 * np.abs(known))
        assert np.all(np.abs(np.array(ours) - known) <= bound), quantity


def test_the_table_is_that_of_the_code(dynamics):
    page = (pages.DOCS / "dynamics.md").read_text(encoding="utf-8")
    (written,) = re.findall(r"<!-- numbers -->\n(.*?)\n<!-- end", page, flags=re.DOTALL)
    rows, ours = (
        [line.split(" | ") for line in text.splitlines()] for text in (written, pages.table(dynamics["known"]))
    )
    assert [row[:3] for row in rows] == [row[:3] for row in ours]
    for row, own in zip(rows[2:], ours[2:], strict=True):
        numbers = [[float(number.strip(" |")) for number in cells[3].split(",")] for cells in (row, own)]
        np.testing.assert_allclose(*numbers, rtol=1e-10)  # rounding differs between machines


def test_its_pictures_are_drawn_and_there(dynamics, tmp_path):
    page = (pages.DOCS / "dynamics.md").read_text(encoding="utf-8")
    for name, (draw, width, height) in pages.DYNAMICS.items():
        file = tmp_path / f"{name}.png"
        pages.picture(file, lambda figure, draw=draw: draw(figure, dynamics), width=width, height=height)
        assert file.stat().st_size > 5_000
        assert f"](pages/{name}.svg)" in page
        assert (pages.DOCS / "pages" / f"{name}.svg").exists()
