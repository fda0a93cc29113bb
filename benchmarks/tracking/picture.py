"""Time against error, one panel a job."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import NullLocator
from matplotlib.transforms import Bbox

from hums.plots.labels import LabelSpace, apply_layout, point_size
from hums.plots.style import FAINT, INK, LINE, MARK
from tracking.measuring import Row
from tracking.settings import DECIMATED, Kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LARGEST = 0.3  # error drawn
COLUMNS = 2

COLOURS: dict[Kind, str] = {"smoother": LINE, "filter": MARK, "peer": FAINT}


def draw(rows: Sequence[Row], ax: "Axes") -> None:
    """Draw one panel a job, of those with errors in the range, in place of the Axes."""
    figure = ax.figure
    ax.remove()
    inside = [row for row in rows if row.error <= LARGEST]
    names = list(dict.fromkeys(row.job.name for row in inside or rows))
    shown = [[row for row in inside if row.job.name == name] for name in names]
    panels = figure.subplots(-(-len(names) // COLUMNS), COLUMNS, squeeze=False).ravel()
    for panel in panels[len(names) :]:
        panel.remove()
    panels = panels[: len(names)]
    for panel, name, mine in zip(panels, names, shown, strict=True):
        _panel(mine, panel)
        panel.set_title(name, loc="left", color=INK)
        panel.set(xlabel="time, multiples of an rfft", ylabel="error")
    legend = f"filled: every {DECIMATED} samples; open: all\ndotted: best of all, and of the causal"
    panels[0].text(1, 1, legend, fontsize=6, color=INK, va="top", ha="right", transform=panels[0].transAxes)
    apply_layout(panels[0])
    for panel, mine in zip(panels, shown, strict=True):
        _label(mine, panel)


def _panel(rows: Sequence[Row], panel: "Axes") -> None:
    panel.set(xscale="log", yscale="log")
    ticks = (0.015, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2)
    panel.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.yaxis.set_minor_locator(NullLocator())
    panel.margins(x=0.22, y=0.12)
    for mine in _lines(rows):
        colour = COLOURS[mine[0].setting.kind]
        face = "white" if mine[0].setting.outputs == "all" else colour
        at = [row.time for row in mine], [row.error for row in mine]
        panel.plot(*at, "o-", color=colour, markerfacecolor=face, markersize=4, linewidth=1, zorder=3)
    for among in (rows, [row for row in rows if row.setting.family.startswith("filter")]):
        front: list[Row] = []
        for row in sorted(among, key=lambda row: (row.time, row.error)):
            if not front or row.error < front[-1].error:
                front.append(row)
        corners = [row.time for row in front], [row.error for row in front]
        panel.plot(*corners, drawstyle="steps-post", color=INK, linewidth=0.6, linestyle=":", zorder=1)
    panel.set(xlim=panel.get_xlim(), ylim=panel.get_ylim())  # as the points have it, whatever is drawn to name them


def _lines(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows that differ in their tolerance only, quickest first, for each label."""
    labels = dict.fromkeys(row.setting.label for row in rows)
    return [sorted((row for row in rows if row.setting.label == name), key=lambda row: row.time) for name in labels]


def _label(rows: Sequence[Row], panel: "Axes") -> None:
    """Name every line at a place that is still free, with a thread to it where that is not beside a point."""
    pixel = point_size(panel)
    where = {id(row): panel.transData.transform((row.time, row.error)) for row in rows}
    space = LabelSpace(inside=panel.get_window_extent())
    for x, y in where.values():
        space.occupy(Bbox.from_extents(x - 2.5 * pixel, y - 2.5 * pixel, x + 2.5 * pixel, y + 2.5 * pixel))
    back = panel.transData.inverted()
    for mine in _lines(rows):
        colour = INK if mine[0].setting.kind == "peer" else COLOURS[mine[0].setting.kind]
        named = f" {mine[0].setting.label.removesuffix(', all')} "  # open marks say "all"; spaces keep names apart
        text = panel.text(1, 1, named, fontsize=6, color=colour, va="center", ha="center", zorder=4)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.2})  # an outline of letters fills a megabyte
        text.set_in_layout(False)
        half = np.array([text.get_window_extent().width, text.get_window_extent().height]) / 2
        places = []
        for away in (4, 8, 13, 19, 26, 34):
            for x, y in (where[id(mine[0])], where[id(mine[-1])]):
                right, up = half + away * pixel
                slants = [(side, level) for level in (up, -up) for side in (0, right / 2, -right / 2, right, -right)]
                places += [(x + dx, y + dy) for dx, dy in [(right, 0), (-right, 0), *slants]]
        space.place_text(text, [tuple(back.transform(place)) for place in places])
        box = text.get_window_extent()
        threads = [(start, np.clip(start, box.min, box.max)) for start in (where[id(mine[0])], where[id(mine[-1])])]
        start, end = min(threads, key=lambda thread: float(np.linalg.norm(thread[1] - thread[0])))
        if np.linalg.norm(end - start) > 6 * pixel:
            panel.plot(*back.transform([start, end]).T, color=colour, linewidth=0.4, zorder=2)
