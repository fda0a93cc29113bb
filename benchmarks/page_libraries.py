"""Compare plotly and bokeh for pages that stand alone: size, speed in headless Chromium, print, accessibility, import.

``pip install plotly bokeh selenium``, then ``python benchmarks/page_libraries.py``; see docs/benchmarks/pages.md.
"""

import base64
import gzip
import importlib.metadata
import json
import math
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

POINTS = 1_000_000
READY = "return window.drawn || null"
TEXTS = """const texts = root => [...root.querySelectorAll('*')].reduce(
    (n, e) => n + (e.tagName === 'text' && e.textContent ? 1 : 0) + (e.shadowRoot ? texts(e.shadowRoot) : 0), 0);
return texts(document)"""  # within the shadow roots that bokeh draws in, too
GIVE_UP_S = 90.0


def plotly_page(x: np.ndarray, y: np.ndarray, *, webgl: bool) -> tuple[str, str]:
    """Return the script of plotly.js and a page that draws one line; the figure is JSON made without plotly."""
    package = importlib.metadata.distribution("plotly").locate_file("plotly/package_data/plotly.min.js")
    script = Path(str(package)).read_text(encoding="utf-8")

    def packed(values: np.ndarray) -> dict[str, str]:
        return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}

    kind = "scattergl" if webgl else "scatter"
    trace = {"type": kind, "mode": "lines", "x": packed(x), "y": packed(y), "line": {"width": 1}}
    page = (
        "<!doctype html><meta charset=utf-8><script>const begun=performance.now()</script>"
        f"<script>{script}</script><div id=plot style='width:1000px;height:400px'></div>"
        f"<script>Plotly.newPlot('plot',[{json.dumps(trace)}],{{}},{{}}).then(()=>{{"
        "window.drawn=performance.now()-begun});"
        "window.zoom=async()=>{const t=performance.now();"
        "await Plotly.relayout('plot',{'xaxis.range':[0.4,0.6]});return performance.now()-t}</script>"
    )
    return script, page


def bokeh_page(x: np.ndarray, y: np.ndarray, *, webgl: bool) -> tuple[str, str]:
    """Return the script of bokeh and a page that draws one line, on canvas with WebGL or as SVG."""
    from bokeh.embed import file_html  # noqa: PLC0415
    from bokeh.plotting import figure  # noqa: PLC0415
    from bokeh.resources import INLINE  # noqa: PLC0415

    plot = figure(width=1000, height=400, output_backend="webgl" if webgl else "svg")
    plot.line(x.astype(np.float32), y.astype(np.float32))
    page = file_html(plot, INLINE, suppress_callback_warning=True)
    hooks = (
        "<script>const begun=performance.now();const wait=()=>window.Bokeh?.documents?.[0]?.is_idle?"
        "window.drawn=performance.now()-begun:setTimeout(wait,5);wait();"
        "window.zoom=async()=>{const t=performance.now();const f=Bokeh.documents[0].roots()[0];"
        "f.x_range.start=0.4;f.x_range.end=0.6;"
        "await new Promise(r=>requestAnimationFrame(()=>requestAnimationFrame(r)));"
        "return performance.now()-t}</script>"
    )
    return "".join(INLINE.js_raw), page.replace("</body>", f"{hooks}</body>")


def measure(page: Path, driver: webdriver.Chrome) -> dict[str, float]:
    """Return seconds until the plot is drawn, seconds for one zoom, and what of it a reader of the document finds."""
    begun = time.monotonic()
    driver.get(page.as_uri())
    while driver.execute_script(READY) is None:
        if time.monotonic() - begun > GIVE_UP_S:
            return {"drawn_s": math.inf}
        time.sleep(0.01)
    drawn = time.monotonic() - begun
    zoom = driver.execute_async_script("const done=arguments[0];window.zoom().then(done)")
    return {"drawn_s": drawn, "zoom_s": zoom / 1000, "svg_texts": driver.execute_script(TEXTS)}


def import_seconds(statement: str) -> float:
    """Return the user time of an import in a fresh interpreter, the least of three."""
    code = f"import os, time; t = time.process_time(); {statement}; print(time.process_time() - t)"
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(3)]  # noqa: S603
    return min(float(run.stdout) for run in runs)


def main() -> None:
    """Print one row for each library and way to draw."""
    rng = np.random.default_rng(0)
    x, y = np.linspace(0, 1, POINTS), rng.normal(size=POINTS).cumsum()
    options = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,900"):
        options.add_argument(argument)
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    with tempfile.TemporaryDirectory() as folder:
        for name, make in (("plotly", plotly_page), ("bokeh", bokeh_page)):
            for webgl in (True, False):
                script, page = make(x, y, webgl=webgl)
                path = Path(folder) / f"{name}.html"
                path.write_text(page, encoding="utf-8")
                sizes = {"script_MB": len(script) / 1e6, "gzipped_MB": len(gzip.compress(script.encode())) / 1e6}
                row = sizes | {"page_MB": len(page) / 1e6} | measure(path, driver)
                shown = ", ".join(f"{k} {v:.3g}" for k, v in row.items())
                sys.stdout.write(f"{name} {importlib.metadata.version(name)}, {'WebGL' if webgl else 'SVG'}: {shown}\n")
    driver.quit()
    for statement in (
        "import importlib.metadata, json",
        "import plotly.graph_objects as go; go.Figure()",
        "import bokeh.plotting, bokeh.embed",
    ):
        sys.stdout.write(f"{statement}: {import_seconds(statement):.2f} s\n")


if __name__ == "__main__":
    main()
