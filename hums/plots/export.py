"""Figures as SVG text or as files, from a function that draws on Axes."""

from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import IO, Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter, LogFormatterMathtext

from hums.plots.labels import apply_layout
from hums.plots.style import FAINT, INK, power_of_ten
from hums.records.outputs import atomic_write, check_outputs
from signals._validation import plain_text

_STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",  # text stays text, for searching, copying and screen readers
    "svg.hashsalt": "hums",
    "text.parse_math": False,  # dollar signs in names are literal; powers of ten are written in superscript characters
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
# Dates and versions are left out, so that equal figures give identical files.
_METADATA: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
_DPI = 160  # of PNG; SVG and PDF are vector graphics


def svg(draw: Callable[[Axes], object], *, width: float = 6.4, height: float = 3.4) -> str:
    """Return a figure as an SVG element, to be embedded in HTML.

    Parameters
    ----------
    draw : function of one matplotlib Axes
        Draws the figure.
    width, height : float
        Size in inches.

    Returns
    -------
    str
        The ``<svg>`` element, identical in every run.

    Examples
    --------
    >>> from hums.plots import svg
    >>> svg(lambda ax: ax.plot([0, 1], [0, 1]))[:4]
    '<svg'
    """
    text = StringIO()
    _save(draw, text, kind="svg", width=width, height=height)
    page = text.getvalue()
    return page[page.index("<svg") :]


def save_figure(
    draw: Callable[[Axes], object], path: str | Path, *, width: float = 6.4, height: float = 3.4, force: bool = False
) -> Path:
    """Write a figure to a ``.svg``, ``.png`` or ``.pdf`` file and return its path.

    Parameters
    ----------
    draw : function of one matplotlib Axes
        Draws the figure.
    path : str or Path
        File to write; its suffix selects the format. An existing file is replaced only when the new one is complete.
    width, height : float
        Size in inches.
    force : bool
        Whether to overwrite a file that another program wrote.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ValueError
        If the suffix is not one of these, a size is not positive, or, without `force`, another program wrote the file.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from hums.plots import save_figure
    >>> with TemporaryDirectory() as folder:
    ...     path = save_figure(lambda ax: ax.plot([0, 1], [0, 1]), f"{folder}/line.svg")
    ...     print(path.name, path.stat().st_size > 0)
    line.svg True
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _METADATA:
        raise ValueError(f'"{path}" has the suffix "{path.suffix}"; use .svg, .png or .pdf.')
    if not (width > 0 and height > 0):
        raise ValueError(f"width = {width:g}, height = {height:g}: give the figure a positive size in inches.")
    check_outputs([path], force=force)
    with atomic_write(path) as part, part.open("wb") as file:
        _save(draw, file, kind=kind, width=width, height=height)
    return path


def _save(draw: Callable[[Axes], object], file: IO[Any], *, kind: str, width: float, height: float) -> None:
    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(width, height), layout="constrained", dpi=_DPI)  # that of the file, for equal widths
        FigureCanvasAgg(figure)  # keeps its renderer; without it, measuring a text makes a new one
        ax = figure.add_subplot()
        draw(ax)
        for axis in (axis for drawn in figure.axes for axis in (drawn.xaxis, drawn.yaxis)):
            if isinstance(axis.get_major_formatter(), LogFormatterMathtext):  # whose labels would show dollar signs
                axis.set_major_formatter(lambda value, _: power_of_ten(value))
                axis.set_minor_formatter(LogFormatter())
        if ax in figure.axes:  # not replaced by `draw`
            apply_layout(ax)
            figure.set_layout_engine(None)  # it would run twice more, and draw twice
        for text in figure.findobj(Text):
            text.set_text(plain_text(text.get_text(), keep="\n"))  # other control characters are invalid in XML
        figure.savefig(file, format=kind, metadata=_METADATA[kind], dpi=_DPI)
