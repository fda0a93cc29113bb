"""The report in a real browser: nothing is fetched, nothing complains, every figure is seen, on paper, too."""

import json
import re
import shutil
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from browser import draw_all, printed, screenshot, show, text_of, violations
from pypdf import PdfReader

from data_synth import load_scene, simulate
from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import group, indicator_table
from hums.gearbox.model import Gearbox, load_gearbox
from hums.pages.page import stand_alone_page
from hums.records.record import Channel, PulseTimes, make_record
from hums.report import render, write_report
from hums.report.pdf import write_pdf
from hums.report.verdict_strip import with_hz
from signals.indicators import INDICATORS

RATE_HZ, SPEED_HZ, SECONDS = 5000.0, 20.0, 6.0
FILES = {".hums-written", "report.html", "analysis.h5", "orders.csv", "indicators.csv", "tracks.csv", "summary.json"}


@pytest.fixture(scope="module")
def analysis():
    """Return an analysis with every kind of figure: mesh tones, an inner-race train and noise."""
    rng = np.random.default_rng(3)
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    values = rng.normal(0, 0.2, time.size) + 0.8 * np.cos(2 * np.pi * 23 * SPEED_HZ * time)
    burst = np.maximum(np.cos(2 * np.pi * 5.445 * SPEED_HZ * time), 0) ** 8
    values += 0.6 * (1 + 0.5 * np.cos(2 * np.pi * SPEED_HZ * time)) * burst * rng.normal(size=time.size)
    pulses = PulseTimes(times_s=np.arange(0.0, SECONDS, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1)
    record = make_record(
        {"housing <vertical>": Channel(values=values, units="g")}, rate_hz=RATE_HZ, angle=pulses, machine="Mill & drive"
    )
    settings = AnalysisSettings(
        envelope_band_hz=(1200.0, 2200.0), velocity_limits_mm_s=(1.8, 4.5, 11.2), machine_class="by agreement"
    )
    return analyze(record, load_gearbox("two-stage"), settings=settings)


@pytest.fixture(scope="module")
def page(analysis, tmp_path_factory):
    return write_report(analysis, tmp_path_factory.mktemp("report"), baseline=analysis)


def test_files_of_a_report(page):
    assert {path.name for path in page.parent.iterdir()} == FILES
    facts = json.loads((page.parent / "summary.json").read_text())
    assert facts["schema"] == "hums-summary/2"
    header = (page.parent / "orders.csv").read_text().splitlines()[0].split(",")
    assert {"component", "kind", "order", "order_found", "amplitude", "spectrum"} <= set(header)


def test_the_table_of_tracks_has_polar_amplitudes_over_speed(analysis, page):
    table = pd.read_csv(page.parent / "tracks.csv")
    assert set(table["channel"]) == {"housing <vertical>"}
    np.testing.assert_allclose(table["speed_hz"], SPEED_HZ, rtol=1e-4)
    for name, spectrum in (("tracks", "order_spectrum"), ("envelope_tracks", "envelope")):
        tracks, rows = group(analysis, name), table[table["spectrum"] == spectrum]
        turned = rows["amplitude"] * np.exp(1j * np.radians(rows["phase_deg"]))
        np.testing.assert_allclose(turned, tracks["complex_amplitude"].to_numpy().ravel(), rtol=1e-5)
        np.testing.assert_allclose(rows["half_width"], tracks["half_width"].to_numpy().ravel(), rtol=1e-6)
        assert np.all(rows["half_width"] > 1.95 * rows["std"])
        assert set(rows["order"].round(4)) == set(tracks["track_order"].to_numpy().round(4))


def test_names_are_escaped(page):
    text = page.read_text()
    assert "Mill &amp; drive" in text
    assert "<vertical>" not in text


def test_health_band_and_indicators_are_shown(analysis, page):
    text = page.read_text()
    assert '<span class="calm">ok</span>' in text
    assert "Band 1200 to 2200 Hz, as specified." in text
    table = indicator_table(analysis)
    assert set(INDICATORS) - {"carrier_sideband_ratio"} <= set(table["indicator"])  # it has no planets
    row = table[(table["indicator"] == "fm4") & (table["component"] == "stage 1/pinion")].iloc[0]
    cells = re.search(r'<td class="t">FM4</td>(.*?)</tr>', text, flags=re.DOTALL).group(1)
    assert f">{row['value']:.3g}</span>" in cells
    assert f"({row['noise_limit']:.3g})</span>" in cells
    zone = "ABCD"[int(np.searchsorted((1.8, 4.5, 11.2), table.set_index("indicator")["value"]["velocity_rms"]))]
    assert f"Zone {zone}</span> of ISO 20816, by agreement" in text
    saved = pd.read_csv(page.parent / "indicators.csv")
    np.testing.assert_allclose(saved["value"], table["value"], rtol=1e-12)


def test_a_chosen_band_is_shown_with_its_reason(analysis):
    tree = analysis.copy()
    envelope = group(tree, "envelope")
    envelope["band_chosen"][:] = 1
    envelope["band_why"] = ("channel", ["1200-2200 Hz: its steady kurtosis of 3 is the highest of 9 bands."])
    tree["envelope"] = xr.DataTree(envelope)
    caption = "Band chosen from the record: 1200-2200 Hz: its steady kurtosis of 3 is the highest of 9"
    assert caption in render(tree)


def test_a_report_over_a_file_is_refused(analysis, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(ValueError, match="is a file; name a folder"):
        write_report(analysis, tmp_path / "taken")


PAGE_MB = 4.0  # beyond the library
DRAWN = (
    "return [...document.querySelectorAll('.canvas')].map((canvas) => canvas.querySelector('svg.main-svg') !== null)"
)
LABELS = """return [...document.querySelectorAll('#figure-' + arguments[0] + ' .annotation-text')]
    .map((text) => text.getBoundingClientRect()).map((box) => [box.left, box.right]).sort((a, b) => a[0] - b[0])"""
UNFOLD = "document.querySelectorAll('details').forEach((one) => { one.open = true; })"
AXIS = "return document.querySelector('#figure-orders-0 .canvas')._fullLayout.xaxis.range[1]"
CHOOSE = """const tool = document.getElementById('tool-' + arguments[0]); tool.value = arguments[1];
    tool.dispatchEvent(new Event('change', {bubbles: true}));"""
CURSORS = """return document.querySelector('#figure-orders-0 .canvas').layout.shapes
    .filter((shape) => shape.name === 'cursor').map((shape) => shape.x0)"""


def test_the_page_is_small(page):
    library = len(stand_alone_page(title="", body=""))
    assert (page.stat().st_size - library) / 1e6 < PAGE_MB


def drawn_whole(browser, page, *, width, dark):
    """Open the page, draw all of it, and hold it to what holds at every width."""
    assert show(browser, page, width=width, dark=dark) == []
    browser.execute_script(UNFOLD)
    draw_all(browser)
    assert browser.get_log("browser") == []
    drawn = browser.execute_script(DRAWN)
    assert len(drawn) == 13  # three spectra, map, tracks of orders and parts, four gears, kurtogram, waveform and speed
    assert all(drawn)
    for canvas in browser.find_elements("css selector", ".canvas"):
        assert canvas.rect["x"] >= 0
        assert canvas.rect["x"] + canvas.rect["width"] <= width
    assert browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth") <= 0
    assert violations(browser) == []
    assert len(screenshot(browser)) > 20_000  # ink: a blank page would be one colour
    buttons = browser.execute_script(
        "return [...document.querySelectorAll('.modebar-btn')].map((b) => b.dataset.title)"
    )
    assert buttons
    assert not [name for name in buttons if "hare" in name or "loud" in name]  # nothing offers to send data away


def paper_loses_nothing(browser, page):
    text = text_of(printed(browser))
    facts = json.loads((page.parent / "summary.json").read_text())
    for finding in facts["findings"]:
        assert with_hz(finding["evidence"], facts["speed_hz"]["mean"])[:60].lower() in text.lower()
    assert "No bearing is declared on output" in text  # what the drawing lacks
    order = facts["findings"][0]["order_found"]
    assert f"{SPEED_HZ * order:.4g} Hz, {60 * SPEED_HZ * order:.5g} CPM at the mean speed" in text
    for column in ("nominal order", "order found", "amplitude", "level", "units"):  # the whole components table
        assert column in text
    for words in (
        "order, cycles per revolution of input",
        "speed of input, rpm",
        "tooth, counted from the start of the average",
        "Raised by:",
    ):
        assert words in text
    assert "Cursor on" not in text


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium (Debian: apt-get install chromium)")
def test_a_summary_of_six_channels_and_forty_checks_is_printed_on_four_pages(tmp_path):
    scene = load_scene("turbine").changed(duration_s=2.0)
    analysis = analyze(simulate(scene, seed=0), scene.gearbox)
    path = write_pdf(write_report(analysis, tmp_path))
    assert len(PdfReader(path).pages) <= 4
    summary = text_of(path.read_bytes())
    for words in ("high speed bearing generator side, inner race", "Order spectra", "Components", "1 of"):
        assert words in summary
    for words in ("Condition indicators", "Waveforms", "nominal order"):
        assert words not in summary


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium (Debian: apt-get install chromium)")
def test_the_whole_is_printed_on_demand(page, tmp_path):
    whole = text_of(write_pdf(shutil.copy(page, tmp_path), full=True).read_bytes())
    for words in ("Order spectra", "Condition indicators", "Waveforms", "Kurtograms", "nominal order"):
        assert words in whole


def test_report_on_a_narrow_dark_screen_and_from_there_on_paper(browser, page):
    drawn_whole(browser, page, width=400, dark=True)
    drawn_on_white = "return getComputedStyle(document.querySelector('.mechanism')).filter"
    assert "invert" in browser.execute_script(drawn_on_white)
    paper_loses_nothing(browser, page)


def test_report_on_a_desk_with_its_labels_units_and_cursors(browser, page):
    drawn_whole(browser, page, width=1280, dark=False)
    assert browser.execute_script("return getComputedStyle(document.querySelector('.mechanism')).filter") == "none"
    for name in ("orders-0", "envelopes-0"):  # labels stand beside one another
        boxes = browser.execute_script(LABELS, name)
        assert boxes
        assert all(right <= left for (_, right), (left, _) in pairwise(boxes))
    orders = browser.execute_script(AXIS)
    speed_hz = json.loads((page.parent / "summary.json").read_text())["speed_hz"]["mean"]
    browser.execute_script(CHOOSE, "order", "23")
    browser.execute_script(CHOOSE, "harmonics", "2")
    browser.execute_script(CHOOSE, "spacing", "1")
    browser.execute_script(CHOOSE, "sidebands", "1")
    assert sorted(browser.execute_script(CURSORS)) == [22, 23, 24, 45, 46, 47]
    browser.execute_script(CHOOSE, "units", "CPM")
    assert browser.execute_script(AXIS) == pytest.approx(60 * speed_hz * orders)
    assert min(browser.execute_script(CURSORS)) == pytest.approx(22 * 60 * speed_hz)
    for against in ("speed", "Nyquist"):
        browser.execute_script(CHOOSE, "against", against)
    browser.execute_script(CHOOSE, "scale", "dB")
    assert browser.get_log("browser") == []
    readout = browser.find_element("id", "tool-readout").text
    assert f"{23 * speed_hz:.6g}"[:5] in readout


# ---- Four sensors on a run-up, and a gearbox of six gears -----------------------------------------------------------

SIX_GEARS = """
name = "three stages"
frame = "housing"
reference = "input"
[axes]
input = ["housing", "input"]
"first layshaft" = ["housing", "first layshaft"]
"second layshaft" = ["housing", "second layshaft"]
output = ["housing", "output"]
[[mesh]]
teeth = { input = 23, "first layshaft" = 67 }
[[mesh]]
teeth = { "first layshaft" = 19, "second layshaft" = 61 }
[[mesh]]
teeth = { "second layshaft" = 21, output = 64 }
[[bearing]]
names = ["input DE"]
inner_ring = "input"
outer_ring = "housing"
bearing = "SKF 6205-2RS JEM"
"""
PLOTTED = """const canvas = document.querySelector('#figure-' + arguments[0] + ' .canvas');
    return canvas.data.map((trace) => ({name: trace.name, color: trace.line && trace.line.color,
        x0: trace.x0, dx: trace.dx, y: trace.y && Array.from(trace.y),
        z: trace.z && trace.z.map((row) => Math.max(...row.filter(Number.isFinite)))}))"""
TICKS = """return [...document.querySelectorAll(`#figure-${arguments[0]} .xtick text`)]
    .map((tick) => Number(tick.textContent))"""
CLIPPED = """return [...document.querySelectorAll('.scroll')].filter((one) => one.scrollWidth > one.clientWidth)
    .map((one) => one.getAttribute('aria-label') + one.scrollWidth)"""
IN_SIGHT = """return [...document.querySelectorAll('#panel [data-channel]')]
    .filter((one) => one.dataset.channel && one.checkVisibility()).map((one) => one.dataset.channel)"""


@pytest.fixture(scope="module")
def run_up(tmp_path_factory):
    """Return the analysis of four channels, the last of them empty above 1.5 kHz, from 10 to 30 rev/s in 8 s."""
    folder = tmp_path_factory.mktemp("run-up")
    (folder / "gearbox.toml").write_text(SIX_GEARS)
    rng, time = np.random.default_rng(5), np.arange(round(8 * RATE_HZ)) / RATE_HZ
    turns = 10 * time + 1.25 * time**2
    tone = np.cos(2 * np.pi * 23 * turns) + 0.3 * np.cos(2 * np.pi * turns)
    values = [(k + 1) * tone + rng.normal(0, 0.3, time.size) for k in range(4)]
    values[3] = np.fft.irfft(np.where(np.fft.rfftfreq(time.size, 1 / RATE_HZ) < 1500, np.fft.rfft(values[3]), 0))
    channels = {f"a{k}": Channel(values=one, units="m s-2", sensor=f"bearing {k}") for k, one in enumerate(values)}
    whole = np.interp(np.arange(turns[-1]), turns, time)
    record = make_record(
        channels,
        rate_hz=RATE_HZ,
        angle=PulseTimes(times_s=whole, shaft="input", pulses_per_rev=1),
        machine="Mill",
        recorded_at="2026-03-01T10:00:00Z",
        attrs={"site": "hall 2", "analyst": "A. Meyer"},
    )
    return analyze(record, Gearbox.from_toml(folder / "gearbox.toml"))


@pytest.fixture(scope="module")
def several(run_up, tmp_path_factory):
    return write_report(run_up, tmp_path_factory.mktemp("several"))


def test_a_page_says_what_was_measured_where_by_whom_and_in_one_spelling(several):
    text = several.read_text(encoding="utf-8")
    assert several.stat().st_size <= 2.5e6
    assert "<title>Mill, 2026-03-01</title>" in text
    assert "<h1>Mill, 2026-03-01</h1>" in text
    assert "Site: hall 2. Sensors: a0 (bearing 0), a1 (bearing 1)" in text
    assert "Analyst: A. Meyer." in text
    assert "m/s\N{SUPERSCRIPT TWO}" in text
    assert not re.search(r"\bmm? s-[12]\b", text)


def test_empty_cells_of_a_kurtogram_are_explained_where_there_are_some(several):
    said = re.findall(r"0 for Gaussian noise\.( Empty cells: bands with less power)?", several.read_text())
    assert [bool(one) for one in said] == [False, False, False, True]


def test_a_tab_shows_one_sensor_and_details_unfold(browser, several):
    assert show(browser, several, width=1400) == []
    draw_all(browser)
    assert browser.execute_script("return document.documentElement.scrollHeight") < 7000
    assert set(browser.execute_script(IN_SIGHT)) == {"a0"}
    tabs = browser.find_elements("css selector", "[role=tab]")
    assert [tab.text for tab in tabs] == ["a0", "a1", "a2", "a3"]
    tabs[2].click()
    assert set(browser.execute_script(IN_SIGHT)) == {"a2"}
    tabs[2].send_keys("\ue014")  # arrow to the right
    assert set(browser.execute_script(IN_SIGHT)) == {"a3"}
    browser.execute_script(UNFOLD)
    draw_all(browser)
    # of six gears, too, the meaning is read without scrolling
    assert browser.execute_script(CLIPPED) == []
    assert violations(browser) == []
    assert browser.get_log("browser") == []


def teeth_are_numbered_and_finely_sampled(browser):
    for at, teeth in enumerate((23, 67, 19, 61, 21, 64)):
        name = f"averages-{at}"
        drawn = browser.execute_script(PLOTTED, name)[0]
        assert len(drawn["y"]) >= 20 * teeth
        assert drawn["x0"] == 0.5
        assert drawn["x0"] + len(drawn["y"]) * drawn["dx"] == pytest.approx(teeth + 0.5)
        numbers = browser.execute_script(TICKS, name)
        assert min(numbers) == 1
        assert max(numbers) <= teeth


def lines_keep_their_colours(browser):
    colours = {}
    for tab in reversed(range(4)):  # the first stays in sight
        browser.find_elements("css selector", "[role=tab]")[tab].click()
        draw_all(browser)
        for trace in browser.execute_script(PLOTTED, f"tracks-{tab}"):
            if trace["name"]:
                colours.setdefault(trace["name"], set()).add(trace["color"])
    assert len(colours) > 1
    assert all(len(given) == 1 for given in colours.values())


def amplitudes_follow_the_choices(browser, run_up):
    """Amplitudes as chosen, the intervals of tracks and the peaks of maps."""
    peak = {name: browser.execute_script(PLOTTED, name) for name in ("orders-0", "wideband-0", "tracks-0", "maps-0")}
    tracks = group(run_up, "tracks")
    (mesh,) = np.flatnonzero((tracks["track_channel"] == "a0") & (tracks["track_order"] == 23))
    rising = np.argsort(tracks["speed_hz"].to_numpy())
    amplitude, half = np.abs(tracks["complex_amplitude"].to_numpy()[mesh]), tracks["half_width"].to_numpy()[mesh]
    band, line = peak["tracks-0"][:2]
    assert line["name"].startswith("stage") or "order 23" in line["name"]
    every = round(amplitude.size / len(line["y"]))
    shown = amplitude[::every][np.argsort(tracks["speed_hz"].to_numpy()[::every])]
    np.testing.assert_allclose(line["y"], shown, rtol=1e-5)
    np.testing.assert_allclose(
        band["y"][: len(line["y"])], shown + half[::every][rising[rising % every == 0] // every], rtol=1e-3
    )
    browser.execute_script(CHOOSE, "against", "time")
    lines = browser.execute_script(PLOTTED, "maps-0")[0]["z"]
    browser.execute_script(CHOOSE, "units", "Hz")
    np.testing.assert_allclose(
        browser.execute_script(PLOTTED, "maps-0")[0]["z"], lines
    )  # no row loses its largest line
    for name, factor in (("RMS", 0.5**0.5), ("peak-to-peak", 2)):
        browser.execute_script(CHOOSE, "measure", name)
        for figure in ("orders-0", "wideband-0"):
            drawn = browser.execute_script(PLOTTED, figure)[0]["y"]
            np.testing.assert_allclose(drawn, factor * np.array(peak[figure][0]["y"]), rtol=1e-5)


def test_figures_of_several_sensors_on_a_run_up(browser, several, run_up):
    show(browser, several, width=1400)
    browser.execute_script(UNFOLD)
    draw_all(browser)
    teeth_are_numbered_and_finely_sampled(browser)
    lines_keep_their_colours(browser)
    amplitudes_follow_the_choices(browser, run_up)
