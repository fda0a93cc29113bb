"""The report in a real browser: nothing is fetched, nothing complains, every figure is seen."""

import base64
import json
import os
import re
import shutil

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from hums.analysis.analyze import AnalysisSettings, analyze
from hums.analysis.result import group, indicator_table, open_analysis
from hums.gearbox.model import load_gearbox
from hums.records.record import Channel, PulseTimes, make_record
from hums.report import render, write_report
from signals.indicators import INDICATORS

RATE_HZ, SPEED_HZ, SECONDS = 5000.0, 20.0, 6.0
FILES = {"report.html", "analysis.h5", "orders.csv", "indicators.csv", "summary.json"}


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
    settings = AnalysisSettings(envelope_band_hz=(1200.0, 2200.0))
    return analyze(record, load_gearbox("two-stage"), settings=settings)


@pytest.fixture(scope="module")
def page(analysis, tmp_path_factory):
    return write_report(analysis, tmp_path_factory.mktemp("report"))


def test_files_of_a_report(page):
    assert {path.name for path in page.parent.iterdir()} == FILES
    facts = json.loads((page.parent / "summary.json").read_text())
    assert facts["schema"] == "hums-summary/1"
    header = (page.parent / "orders.csv").read_text().splitlines()[0].split(",")
    assert {"component", "kind", "order", "order_found", "amplitude", "spectrum"} <= set(header)


def test_report_is_made_from_the_analysis_alone(page):
    with open_analysis(page.parent / "analysis.h5") as reopened:
        assert render(reopened) == page.read_text(encoding="utf-8")


def test_names_are_escaped(page):
    text = page.read_text()
    assert "Mill &amp; drive" in text
    assert "<vertical>" not in text


def test_health_band_and_indicators_are_shown(analysis, page):
    text = page.read_text()
    assert '<td class="t ok">ok</td>' in text
    assert "Band 1200 to 2200 Hz, as given." in text
    table = indicator_table(analysis)
    assert set(INDICATORS) - {"carrier_sideband_ratio"} <= set(table["indicator"])  # it has no planets
    row = table[(table["indicator"] == "fm4") & (table["component"] == "stage 1/pinion")].iloc[0]
    cells = re.search(r'<td class="t">FM4</td>(.*?)</tr>', text, flags=re.DOTALL).group(1)
    assert f">{row['value']:.3g}</td>" in cells
    saved = pd.read_csv(page.parent / "indicators.csv")
    np.testing.assert_allclose(saved["value"], table["value"], rtol=1e-12)


def test_a_chosen_band_is_shown_with_its_reason(analysis):
    tree = analysis.copy()
    envelope = group(tree, "envelope")
    envelope["band_chosen"][:] = 1
    envelope["band_why"] = ("channel", ["1200-2200 Hz: its steady kurtosis of 3 is the highest of 9 bands."])
    envelope["band_doubts_json"] = ("channel", [json.dumps(["Nothing repeats regularly."])])
    tree["envelope"] = xr.DataTree(envelope)
    caption = "Band 1200 to 2200 Hz, chosen from the record. 1200-2200 Hz: its steady kurtosis of 3 is the highest of 9"
    text = render(tree)
    assert caption in text
    assert "Nothing repeats regularly." in text


def test_a_report_over_a_file_is_refused(analysis, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(ValueError, match="is a file; name a folder"):
        write_report(analysis, tmp_path / "taken")


def test_a_failed_write_leaves_the_old_report(analysis, page, tmp_path, monkeypatch):
    before = page.read_bytes()
    page = shutil.copytree(page.parent, tmp_path, dirs_exist_ok=True) / page.name
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write_report(analysis, tmp_path)
    assert page.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == FILES


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        message = "needs chromium and chromedriver (Debian: apt-get install chromium chromium-driver)"
        if os.environ.get("HUMS_STRICT") == "1":
            pytest.fail(message)
        pytest.skip(message)
    from selenium import webdriver  # noqa: PLC0415
    from selenium.webdriver.chrome.service import Service  # noqa: PLC0415

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    profile = tmp_path_factory.mktemp("profile")
    for argument in (
        "headless",
        "no-sandbox",
        "disable-gpu",
        "no-first-run",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
        f"user-data-dir={profile}",
    ):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    yield driver
    driver.quit()


@pytest.mark.parametrize("width", [1280, 400])
def test_report_in_the_browser(browser, page, width):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    browser.get_log("performance")
    browser.get(page.as_uri())
    assert browser.get_log("browser") == []
    requests = [
        json.loads(entry["message"])["message"]["params"]["request"]["url"]
        for entry in browser.get_log("performance")
        if json.loads(entry["message"])["message"]["method"] == "Network.requestWillBeSent"
    ]
    outside = [url for url in requests if not url.startswith(("data:", page.as_uri()))]
    assert outside == []
    figures = browser.find_elements("css selector", "figure svg")
    assert len(figures) == 4  # speed, order spectrum, envelope, tracks
    for figure in figures:
        box = figure.rect
        assert figure.is_displayed()
        assert box["width"] > 0.85 * min(width, 800) - 32
        assert box["height"] > 100
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
    overflow = browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth")
    assert overflow <= 0
    # ink: a blank figure would be one colour
    shot = base64.b64decode(browser.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True})["data"])
    assert len(shot) > 20_000
