"""Sphinx configuration: ``sphinx-build -j auto -W --keep-going docs docs/_build/html``."""

import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version as installed_version
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "HUMS toolkit"
author = "The HUMS toolkit developers"
project_copyright = author
version = release = installed_version("hums-toolkit")
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # equations without a network
    "numpydoc",
    "myst_parser",
    "sphinx_design",  # cards on the front page
    "sphinx_gallery.gen_gallery",
    "code_blocks",  # runs the code blocks of the pages
    "made_pages",  # pages on which mechanisms turn
]
exclude_patterns = ["_build", "_ext", "_templates", "examples"]
templates_path = ["_templates"]
default_role = "py:obj"

html_theme = "pydata_sphinx_theme"
html_title = "HUMS toolkit"
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_js_files = ["print.js"]
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc", "sg_download_links", "sg_launcher_links"],
}
html_sidebars = {"glossary": [], "validation": [], "mechanisms/index": []}

myst_enable_extensions = ["deflist", "dollarmath", "colon_fence", "substitution"]
myst_substitutions = {"version": version}
myst_heading_anchors = 4

python_maximum_signature_line_length = 88  # longer ones have a parameter a line
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Floats": "Floats"}
autosummary_generate = True
numpydoc_show_class_members = False  # attributes stand in the docstring of the class
numpydoc_xref_param_type = False

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "subsection_order": [f"examples/{group}" for group in ("mechanisms", "signals", "tracking", "machines")],
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": False,
    "show_memory": False,
    "min_reported_time": 0,
    "write_computation_times": False,
    "reference_url": {"hums": None, "signals": None, "data_synth": None},
    "doc_module": ("hums", "signals", "data_synth"),
}

# A page for each package, from what it exports: complete by construction.
API = {
    "signals": "Signal processing: functions of arrays that return frozen dataclasses of arrays.",
    "signals.harmonics": "Amplitude and phase of orders, with their uncertainty.",
    "signals.indicators": "Condition indicators, each with its source.",
    "hums": "Gearboxes, records, analyses, reports and fleets.",
    "hums.plots": "Figures on Matplotlib axes.",
    "data_synth": "Synthetic records with their ground truth.",
    "data_synth.dynamics": "Equations of motion of a gearbox: modes, stability, steady states and time integration.",
}


def _elsewhere(package: str, name: str) -> bool:
    """Whether a name has its page with a sub-package, or with another library (`hums.Analysis`, an alias)."""
    thing = getattr(import_module(package), name)
    home = getattr(thing, "__module__", package)
    if home.split(".")[0] not in {each.split(".")[0] for each in API} and isinstance(thing, type):
        return True
    return any(
        name in import_module(other).__all__ and getattr(import_module(other), name) is thing
        for other in API
        if other.startswith(f"{package}.")
    )


def _topic(package: str, thing: object) -> str:
    """Return what a name belongs to: how the package below this one, or else the module, that defines it begins."""
    home = getattr(thing, "__module__", package).split(".")
    depth = package.count(".") + 2 if home[: package.count(".") + 1] == package.split(".") else 2
    about = import_module(".".join(home[:depth])).__doc__ if len(home) > 1 else None
    return re.split("[:;.,(]", (about or "Data").strip(), maxsplit=1)[0].strip()


def _api_page(package: str, about: str) -> str:
    module = import_module(package)
    elsewhere = sorted(name for name in module.__all__ if _elsewhere(package, name))
    topics: dict[str, list[str]] = {}
    for name in sorted(set(module.__all__) - set(elsewhere), key=str.lower):
        topics.setdefault(_topic(package, getattr(module, name)), []).append(name)
    lines = [package, "=" * len(package), "", about, "", f".. currentmodule:: {package}", ""]
    _, _, examples = (module.__doc__ or "").partition("Examples\n--------\n")
    lines += [examples, ""]
    if elsewhere:
        lines += [f"Also exported: {', '.join(f'``{name}``' for name in elsewhere)}.", ""]
    for topic, names in sorted(topics.items()):
        lines += [topic, "-" * len(topic), "", ".. autosummary::", "   :toctree: generated", ""]
        lines += [*(f"   {name}" for name in names), ""]
    return "\n".join(lines)


def _write_api() -> None:
    folder = HERE / "api"
    folder.mkdir(exist_ok=True)
    names = "\n".join(f"   {package}" for package in API)
    pages = {package: _api_page(package, about) for package, about in API.items()}
    pages["index"] = (
        "Packages\n========\n\n"
        "All public names, with their docstrings. The tests run the examples.\n\n"
        f".. toctree::\n   :maxdepth: 1\n\n{names}\n"
    )
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:  # an unchanged page is not built again
            path.write_text(text, encoding="utf-8")


_write_api()


def _picture_the_demo(app: Sphinx, error: Exception | None) -> None:
    """Replace the picture of the demo's report by that of today's program, where there is a browser to take it."""
    browser, picture = which("chromium"), Path(app.outdir, "_images", "report.png")
    if error or browser is None or not picture.exists():
        return
    with TemporaryDirectory() as folder:
        demo = (sys.executable, "-m", "hums", "demo", "-o", f"{folder}/demo")
        size = ("--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1280,1760")
        then = ("--virtual-time-budget=20000", f"--screenshot={picture}", f"{folder}/demo/report.html")
        for command in (demo, (browser, *size, *then)):
            subprocess.run(command, check=True, capture_output=True)  # noqa: S603


def setup(app: Sphinx) -> None:
    """Let `-j` read pages side by side: the one extension that does not say so copies files when all are written."""
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True
    app.connect("build-finished", _picture_the_demo)
