"""Pages that stand alone: arrays come back, peaks stay, figures are drawn in every light and on paper."""

import base64
import hashlib
import json
import re

import numpy as np
import pytest
from browser import draw_all, screenshot, show, violations

from hums.pages.page import Figure, figure_html, least_and_largest, packed, packed_codes, stand_alone_page

COLOURS = "return getComputedStyle(document.body).backgroundColor"


def test_codes_err_by_half_a_step_and_keep_what_is_missing():
    values = np.random.default_rng(0).normal(size=(6, 7))
    values[2, 3] = np.nan
    code = packed_codes(values)
    bytes_ = np.frombuffer(base64.b64decode(code["bdata"]), dtype=np.uint8).reshape(code["shape"])
    missing = np.isnan(values)
    np.testing.assert_array_equal(bytes_ == 255, missing)
    back = code["low"] + code["step"] * bytes_
    assert np.abs(back - values)[~missing].max() <= 0.5 * np.ptp(values[~missing]) / 254 * (1 + 1e-9)


@pytest.mark.parametrize("size", [7, 1000, 1001, 12_345])
def test_the_envelope_of_a_curve_keeps_every_extreme(size):
    curve = np.random.default_rng(size).normal(size=size)
    values, indices = least_and_largest(curve, columns=50)
    assert values.size <= 100
    np.testing.assert_array_equal(values, curve[indices])
    assert np.all(np.diff(indices) > 0)
    step = -(-size // 50)
    for start in range(0, size, step) if size > 100 else ():  # each column holds its own extremes
        inside = values[(indices >= start) & (indices < start + step)]
        assert inside.min() == curve[start : start + step].min()
        assert inside.max() == curve[start : start + step].max()


def test_text_cannot_leave_its_place():
    text = figure_html(Figure(name="a", alt='</script><b>"', traces=[{"name": "</script>"}]))
    assert text.count("</script>") == 1
    content = json.loads(re.search(r'json">(.*?)</script>', text).group(1))
    assert content["traces"][0]["name"] == "</script>"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    rng = np.random.default_rng(0)
    curve = Figure(
        name="curve",
        alt="A curve.",
        traces=[{"type": "scatter", "mode": "lines", "y": packed(rng.normal(size=500)), "line": {"color": "--line"}}],
        layout={"xaxis": {"title": {"text": "legible axis"}}, "yaxis": {"range": [-4, 4]}},
    )
    spot = Figure(name="map", alt="A map.", traces=[{"type": "heatmap", "z": packed_codes(rng.normal(size=(8, 9)))}])
    high = '<div style="height:3000px"></div>'
    body = f"<main><h1>Page</h1>{figure_html(curve, caption='Seen.')}{high}{figure_html(spot)}</main>"
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(stand_alone_page(title="Page", body=body), encoding="utf-8")
    return path


def test_the_policy_allows_the_scripts_of_the_page_and_nothing_from_outside(page):
    text = page.read_text(encoding="utf-8")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)[1]
    allowed = dict(directive.strip().split(" ", 1) for directive in policy.split(";"))
    scripts = re.findall(r'<script(?: type="text/plain" id="plotly")?>(.*?)</script>', text, re.DOTALL)
    digests = {base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts}
    assert set(allowed.pop("script-src").split()) == {f"'sha256-{digest}'" for digest in digests}
    assert allowed["default-src"] == "'none'"
    assert {source for sources in allowed.values() for source in sources.split()} <= {
        "'none'", "'unsafe-inline'", "data:", "blob:",
    }  # fmt: skip


def test_a_page_in_the_browser(browser, page):
    assert show(browser, page) == []
    drawn = "return [...pages.figures.values()].map((figure) => figure.drawn)"
    browser.execute_async_script("setTimeout(arguments[0], 200)")
    assert browser.execute_script(drawn) == [True, False]  # what is out of sight waits
    draw_all(browser)
    assert browser.execute_script(drawn) == [True, True]
    assert browser.get_log("browser") == []
    assert browser.execute_script(COLOURS) == "rgb(255, 255, 255)"
    assert violations(browser) == []
    light = screenshot(browser)
    show(browser, page, dark=True)
    assert browser.execute_script(COLOURS) == "rgb(20, 24, 29)"
    assert violations(browser) == []
    assert screenshot(browser) != light


def test_keys_move_and_zoom(browser, page):
    show(browser, page)
    send = (
        "const canvas = document.querySelector('#figure-curve .canvas'); const key = arguments[0]; canvas.focus();"
        "canvas.dispatchEvent(new KeyboardEvent('keydown', {key, bubbles: true}));"
        "return canvas._fullLayout.xaxis.range"
    )
    browser.execute_async_script("const done = arguments[0]; pages.drawAll().then(done)")
    low, high = browser.execute_script("return document.querySelector('.canvas')._fullLayout.xaxis.range")
    low_then, high_then = browser.execute_script(send, "+")
    assert high_then - low_then == pytest.approx((high - low) / 2)  # a quarter off each side
    right = browser.execute_script(send, "ArrowRight")
    assert right[0] == pytest.approx(low_then + 0.2 * (high_then - low_then))
    assert browser.execute_script(send, "0") == pytest.approx([low, high])
