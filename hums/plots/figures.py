"""From a function that draws to a finished figure: SVG text inside a page, or a file."""

from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import IO, Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hums.plots.labels import settle
from hums.plots.style import FAINT, INK
from hums.store import written_beside

_STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "hums",
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
# What would make two runs differ is left out of the file.
_METADATA: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
_DPI = 160  # of PNG; the others are drawn in lines


def svg(draw: Callable[[Axes], object], *, width: float = 6.4, height: float = 3.4) -> str:
    """Return an SVG figure, as text to stand inside a page, of what `draw` puts on its Axes."""
    text = StringIO()
    _save(draw, text, kind="svg", width=width, height=height)
    page = text.getvalue()
    return page[page.index("<svg") :]


def save_figure(draw: Callable[[Axes], object], path: str | Path, *, width: float = 6.4, height: float = 3.4) -> Path:
    """Write what `draw` puts on its Axes to a ``.svg``, ``.png`` or ``.pdf`` file, beside and then renamed.

    Parameters
    ----------
    draw : function of one Axes
    path : str or Path
        Its suffix says what kind of file; a file of that name is replaced.
    width, height : float, inches

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ValueError
        Another suffix, or a size that is not positive; nothing is written.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _METADATA:
        raise ValueError(f'"{path}" ends in "{path.suffix}"; end it in .svg, .png or .pdf.')
    if not (width > 0 and height > 0):
        raise ValueError(f"width = {width:g}, height = {height:g}: give the figure a positive size in inches.")
    with written_beside(path) as part, part.open("wb") as file:
        _save(draw, file, kind=kind, width=width, height=height)
    return path


def _save(draw: Callable[[Axes], object], file: IO[Any], *, kind: str, width: float, height: float) -> None:
    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)  # which keeps its renderer; without, one is made whenever a text is measured
        ax = figure.add_subplot()
        draw(ax)
        if ax in figure.axes:  # else it made room for others
            settle(ax)
            figure.set_layout_engine(None)  # which would run it twice more, and draw twice
        figure.savefig(file, format=kind, metadata=_METADATA[kind], dpi=_DPI)
