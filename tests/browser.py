"""A page in headless Chromium: its size, its colours, its picture, what it asks for, and what it prints."""

import base64
import io
import json
import os
import shutil

import pytest


def start_browser(profile):
    """Return a driver of headless Chromium, or skip the test; with HUMS_STRICT=1 fail."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        message = "needs chromium and chromedriver (Debian: apt-get install chromium chromium-driver)"
        if os.environ.get("HUMS_STRICT") == "1":
            pytest.fail(message)
        pytest.skip(message)
    from selenium import webdriver  # noqa: PLC0415
    from selenium.webdriver.chrome.service import Service  # noqa: PLC0415

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
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
    driver.get("about:blank")  # the browser's own first page would go on loading on a busy machine
    return driver


def show(driver, page, *, width=1280, height=900, dark=False):
    """Open a page at a width, in light or dark, nothing moving of itself; return what it asked for outside itself."""
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    preferred = {"prefers-color-scheme": "dark" if dark else "light", "prefers-reduced-motion": "reduce"}
    features = [{"name": name, "value": value} for name, value in preferred.items()]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    for log in ("browser", "performance"):
        driver.get_log(log)
    driver.get(page.as_uri())
    messages = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    asked = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    return [url for url in asked if not url.startswith(("data:", "blob:", page.as_uri()))]


def draw_all(driver):
    """Draw all figures of a page, those out of sight too."""
    driver.execute_async_script("const done = arguments[0]; pages.drawAll().then(() => done())")


def drawn_s(driver):
    """Return the seconds from the start of the page until its first figure stands on the screen."""
    script = """
const done = arguments[0];
const wait = () => [...pages.figures.values()].some((figure) => figure.drawn)
  ? requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now())))
  : requestAnimationFrame(wait);
wait();
"""
    return driver.execute_async_script(script) / 1e3


def screenshot(driver, *, whole=False):
    """Return a PNG of what is seen, or of the whole page."""
    size = driver.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
    clip = {"clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}} if whole else {}
    shot = driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": whole, **clip})
    return base64.b64decode(shot["data"])


def printed(driver):
    """Return the page printed on A4, as the bytes of a PDF."""
    options = {"printBackground": True, "preferCSSPageSize": True}
    return base64.b64decode(driver.execute_cdp_cmd("Page.printToPDF", options)["data"])


def text_of(pdf):
    """Return the text of a PDF, its white space as single spaces."""
    from pypdf import PdfReader  # noqa: PLC0415

    return " ".join(" ".join(page.extract_text() for page in PdfReader(io.BytesIO(pdf)).pages).split())


def violations(driver):
    """Return what axe-core finds wrong, as sentences: WCAG 2 at levels A and AA, and its best practices.

    The insides of drawings are taken out for it: each is one image, whose name counts, and thousands of paths that do
    not. What is in order is not described.
    """
    from axe_core_python.base import AXE_SCRIPT  # noqa: PLC0415

    driver.execute_script(AXE_SCRIPT)
    found = driver.execute_async_script(
        "const done = arguments[0];"
        "const drawings = [...document.querySelectorAll('.main-svg')].map((svg) => [svg, [...svg.childNodes]]);"
        "drawings.forEach(([svg]) => svg.replaceChildren());"
        "axe.run({resultTypes: ['violations']}).then((r) => {"
        "  drawings.forEach(([svg, inside]) => svg.replaceChildren(...inside));"
        "  done(r.violations);"
        "})"
    )
    return [f"{one['id']}: {one['help']}: {one['nodes'][0]['html'][:200]}" for one in found]
