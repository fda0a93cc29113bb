"""The fleet's page in the browser: worst first, its figures, and five years of many machines."""

import copy
import html
import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from browser import draw_all, drawn_s, printed, show, text_of, violations
from fleets import FIRST, HEALTHY, PINION, followed, kept, observed

from hums.fleet.fleet_page import write_page
from hums.fleet.monitor import Alarm, MachineState
from hums.fleet.watched_machines import MachineHistory
from hums.pages.page import stand_alone_page

RECORDS, MACHINES = 1_826, 6  # five years of days


def content(page, figure):
    """The data of a figure in the page's text."""
    found = re.search(rf'id="figure-{figure}".*?application/json">(.*?)</script>', page, re.DOTALL)
    return json.loads(found.group(1))


@pytest.fixture(scope="module")
def failing():
    """A machine whose pinion fails."""
    seen = [*HEALTHY, *(observed(number, **PINION) for number in range(40, 50))]
    history = MachineHistory(state=MachineState(machine="mill", settings=followed([])[0].settings))
    history.follow([kept(one, growth=1 + 9 * (number >= 40)) for number, one in enumerate(seen)], ())
    return history


@pytest.fixture(scope="module")
def long(failing, tmp_path_factory):
    """Machines with a record a day for five years, one of which fails; indices are drawn, not judged."""
    rng = np.random.default_rng(1)
    worst, first = failing, kept(HEALTHY[-1])
    histories = [worst]
    names = [name for name in worst.last.index if not name.startswith("sensor")]
    days = [(FIRST.replace(year=2021) + np.timedelta64(day, "D").item()).isoformat() for day in range(RECORDS)]
    for number in range(MACHINES - 1):
        history = copy.copy(worst)
        history.state = copy.copy(worst.state)
        history.state.machine, history.state.alarms = f"mill {number}", {}
        history.state.alarms = {name: Alarm() for name in worst.state.alarms}
        history.alarms, index = [], rng.uniform(0, 0.6, (RECORDS, len(names))).tolist()
        history.records = [
            {
                "seen": replace(first, record=f"{number}/{day}", recorded_at=days[day]),
                "why": "",
                "index": dict(zip(names, row, strict=True)),
                "scores": {},
            }
            for day, row in enumerate(index)
        ]
        history.last = copy.copy(worst.last)
        object.__setattr__(history.last, "index", history.records[-1]["index"])
        histories.append(history)
    path = tmp_path_factory.mktemp("fleet") / "fleet.html"
    write_page(histories, path)
    return path


def test_the_worst_is_first_and_its_figures_say_why(failing, tmp_path):
    history = failing
    quiet = copy.copy(history)
    quiet.state = MachineState(machine="fan")
    quiet.records, quiet.alarms, quiet.last = history.records[:1], [], None
    write_page([quiet, history], tmp_path / "fleet.html", gearbox="two-stage")
    page = (tmp_path / "fleet.html").read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="machine-\d">(\w+) ', page) == ["mill", "fan"]
    health = content(page, "machine-0-health")["data"]
    assert health["components"][0]["name"] == "stage 1/pinion"
    assert health["components"][0]["y"]["shape"] == [30]  # of 50 records 20 are the baseline
    assert health["baseline"] == [0.0, 19.0]
    (alarm,) = history.alarms
    assert health["alarms"]["x"] == [float(alarm["record"].removeprefix("record "))]
    lines = content(page, "machine-0-lines")["data"]
    assert lines["first"]["x"] == lines["last"]["x"] != lines["first"]["y"] != lines["last"]["y"]
    panels = content(page, "machine-0-drivers")["data"]["panels"]
    assert len(panels) == 6
    assert "Its baseline is being learned: 0 records so far." in page
    assert re.search(r"stage 1/pinion: .* times normal, since 2026-04-10.*; inspect\.", page)
    assert 'href="reports' not in page
    history.last.drivers["stage 1/pinion"] = ("a", "fm0", 30.0, 4123.4)
    write_page([history], tmp_path / "far.html")
    assert "fm0 of a 4,123 times normal" in (tmp_path / "far.html").read_text(encoding="utf-8")
    quiet.state = MachineState(machine="é" * 5000)
    write_page([quiet], tmp_path / "long.html")  # no folder has such a name
    assert "<td>1</td><td>0.037</td>" in page  # one alarm; a record a day at one false alarm in 10,000 records


def test_why_a_machine_is_not_monitored(tmp_path):
    history = MachineHistory(state=MachineState(machine="mill", settings=followed([])[0].settings))
    hovering = replace(kept(observed(40)), regime="hover", record="Test 40", recorded_at="")
    history.follow([*map(kept, HEALTHY), hovering], ())
    write_page([history], tmp_path / "fleet.html")
    page = html.unescape((tmp_path / "fleet.html").read_text(encoding="utf-8"))
    assert "Not monitored since Test 40: regime 'hover' is not in the baseline." in page


def test_a_report_beside_the_page_is_linked(failing, tmp_path):
    history = failing
    report = tmp_path / "reports" / f"mill {history.alarms[0]['record']}" / "report.html"
    report.parent.mkdir(parents=True)
    report.touch()
    write_page([history], tmp_path / "fleet.html")
    assert 'href="reports/mill%20record%2' in (tmp_path / "fleet.html").read_text(encoding="utf-8")


def test_five_years_of_many_machines_in_the_browser(browser, long):
    library = len(stand_alone_page(title="", body=""))
    assert long.stat().st_size - library < 0.5e6 * MACHINES  # twenty machines: 10 MB and the library
    assert show(browser, long) == []
    seconds, size_mb = drawn_s(browser), long.stat().st_size / 1e6
    sys.stdout.write(f"opened and drawn in {seconds:.2f} s, {size_mb:.1f} MB\n")
    browser.execute_async_script("setTimeout(arguments[0], 200)")
    drawn = browser.execute_script("return [...pages.figures.values()].map((figure) => figure.drawn)")
    assert len(drawn) == 3 * MACHINES
    assert sum(drawn) <= 6  # what is out of sight waits
    assert browser.get_log("browser") == []
    assert violations(browser) == []


def test_fifty_machines_are_on_one_screen_the_most_urgent_first(browser, failing, tmp_path):
    worst = failing
    quiet = MachineHistory(state=MachineState(machine="", settings=worst.state.settings))
    quiet.follow(map(kept, HEALTHY), ())
    histories = [worst]
    for number in range(49):
        one = copy.copy(quiet)
        one.state = copy.copy(quiet.state)
        one.state.machine = f"conveyor {number}"
        histories.insert(0, one)
    write_page(histories, tmp_path / "fleet.html")
    browser.set_window_size(1400, 1000)
    assert show(browser, tmp_path / "fleet.html", width=1400) == []
    rows = "return [...document.querySelectorAll('#machines tbody tr')].map((row) => "
    assert browser.execute_script(rows + "row.cells[0].innerText)")[0] == "mill"
    bottoms = browser.execute_script(rows + "row.getBoundingClientRect().bottom)")
    assert len(bottoms) == 50
    assert max(bottoms) <= 1000
    # the line of the failing machine ends above the limit, half way up; that of a healthy one stays below
    ends = browser.execute_script(rows + "row.querySelector('polyline').points).map((p) => p[p.length - 1].y)")
    assert ends[0] < 8 < min(ends[1:])


def test_every_width_light_dark_and_paper(browser, failing, tmp_path):
    history = failing
    write_page([history], tmp_path / "fleet.html")
    for width, dark in ((1280, False), (400, True)):
        assert show(browser, tmp_path / "fleet.html", width=width, dark=dark) == []
        draw_all(browser)
        assert browser.get_log("browser") == []
        assert violations(browser) == []
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        cut = (
            "return [...document.querySelectorAll('.scroll')].filter((box) => box.scrollWidth > box.clientWidth).length"
        )
        assert browser.execute_script(cut) == 0  # no table is cut
    text = text_of(printed(browser))
    assert "Indicators: stage 1/pinion" in text
    assert "condition index" in text
