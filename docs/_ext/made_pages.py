"""Pages and pictures that the build makes: one for each gearbox of the catalogue, and the diagram of the packages."""

from pathlib import Path

from matplotlib.patches import Rectangle
from sphinx.application import Sphinx
from sphinx.util import logging

from hums.drawing import write_drawing
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import catalogue, load_gearbox
from hums.plots import draw_mechanism, save_figure

logger = logging.getLogger(__name__)
MOST_BYTES = 1_000_000  # of a page on which a mechanism turns

ABOUT = """# Animated mechanisms

Each gearbox of the catalogue, including Glinsky's trains and those of the papers, has a page with sliders for the
independent speeds, velocity vectors, and all defect orders, exact and in Hz. Each page is one offline file;
`hums drawing my-gearbox.toml -o my-gearbox.html` generates one for your gearbox.

"""

# Packages in the columns of a record's way: name -> (column, row, words)
BOXES = {
    "data_synth.scene": (0, 0, "scene, gears"),
    "data_synth.lines": (1, 0, "operation,\nbearings,\nkinematic,\ntransfer"),
    "data_synth.motion": (1, 1, "dynamics,\nintegrators,\nvibration"),
    "data_synth.record": (2, 0, "sources,\nfidelity, truth,\nsimulation"),
    "data_synth.many": (3, 0, "plan,\ndataset,\nbenchmark"),
    "signals.angle": (0, 2, "shaft,\nresampling"),
    "signals.spectra": (1, 2, "angle,\nspectra"),
    "signals.indicators": (2, 2, "demodulation,\nindicators"),
    "signals.harmonics": (3, 2, "harmonics,\nslipping_order,\nhealth,\nmonitoring"),
    "hums.gearbox": (0, 3, "gearbox"),
    "hums.records": (0, 4, "readers,\nrecords"),
    "hums.analysis": (1, 4, "analysis"),
    "hums.fleet": (2, 3, "fleet"),
    "hums.report": (2, 4, "report, plots,\npages,\ndrawing"),
    "hums.cli": (3, 4, "cli"),
}
ARROWS = (
    ("data_synth.scene", "data_synth.lines"),
    ("data_synth.scene", "data_synth.motion"),
    ("data_synth.lines", "data_synth.record"),
    ("data_synth.motion", "data_synth.record"),
    ("data_synth.record", "data_synth.many"),
    ("signals.angle", "signals.spectra"),
    ("signals.spectra", "signals.indicators"),
    ("hums.gearbox", "hums.analysis"),
    ("hums.records", "hums.analysis"),
    ("hums.analysis", "hums.fleet"),
    ("hums.analysis", "hums.report"),
    ("hums.report", "hums.cli"),
    ("hums.fleet", "hums.cli"),
)
GROUPS = {"data_synth": (0, 2, "#e8f0fa"), "signals": (2, 3, "#eaf5ec"), "hums": (3, 5, "#fbf1e4")}
WIDTH, HEIGHT, STEP = 2.3, 0.8, (3.0, 1.0)  # of a box, and from one to the next


def draw_packages(ax) -> None:
    """Draw the packages as boxes, with an arrow from each to those that use its results."""
    ax.set_axis_off()
    ax.set(xlim=(-3.2, 10.4), ylim=(-4.5, 0.5))
    ax.figure.patch.set_facecolor("white")
    for name, (first, end, colour) in GROUPS.items():
        low, high = -(end - 1) * STEP[1] - 0.44, -first * STEP[1] + 0.44
        ax.add_patch(_rectangle(-3.2, low, 13.6, high - low, colour))
        ax.text(-3.1, (low + high) / 2, name, va="center", ha="left", fontsize=9, weight="bold", color="#1a1a1a")
    place = {name: (column * STEP[0], -row * STEP[1]) for name, (column, row, _) in BOXES.items()}
    for name, (x, y) in place.items():
        ax.text(x, y, BOXES[name][2], ha="center", va="center", fontsize=8.5, color="#1a1a1a", zorder=3)
        ax.add_patch(_rectangle(x - WIDTH / 2, y - HEIGHT / 2, WIDTH, HEIGHT, "white", edge="#888888"))
    for before, after in ARROWS:
        (x0, y0), (x1, y1) = place[before], place[after]
        start, end = (x0 + WIDTH / 2, y0), (x1 - WIDTH / 2, y1)
        ax.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": "#555555"}, zorder=2)


def _rectangle(x: float, y: float, width: float, height: float, colour: str, *, edge: str = "none"):
    return Rectangle((x, y), width, height, facecolor=colour, edgecolor=edge, linewidth=0.8, zorder=1)


def make_sources(app: Sphinx) -> None:
    """Write the page that lists the mechanisms with their pictures, and the diagram of the packages."""
    folder = Path(app.srcdir) / "mechanisms"
    folder.mkdir(exist_ok=True)
    rows = []
    for name in sorted(catalogue()):
        gearbox = load_gearbox(name)
        save_figure(
            lambda ax, gearbox=gearbox: draw_mechanism(gearbox, ax=ax), folder / f"{name}.svg", width=6, height=4
        )
        free = solve_kinematics(gearbox).dof
        freedom = f"{free} degree{'s' if free > 1 else ''} of freedom"
        rows.append(
            f"## {gearbox.name}\n\n![{gearbox.name}, drawn from its gearbox file]({name}.svg)\n\n"
            f'`{name}`, {freedom}: <a href="{name}.html">animated page</a>.\n'
        )
    (folder / "index.md").write_text(ABOUT + "\n".join(rows), encoding="utf-8")
    save_figure(draw_packages, folder / "packages.svg", width=7, height=5)


def make_pages(app: Sphinx, exception: Exception | None) -> None:
    """Write the pages beside those that Sphinx makes."""
    if exception or app.builder.format != "html":
        return
    folder = Path(app.outdir) / "mechanisms"
    for name in catalogue():
        size = write_drawing(load_gearbox(name), folder / f"{name}.html").stat().st_size
        if size > MOST_BYTES:
            logger.warning("the page of %s has %d bytes, more than %d", name, size, MOST_BYTES)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("builder-inited", make_sources)
    app.connect("build-finished", make_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
