"""Figures of a page as JSON for plotly.js, and the page around them.

The script is plotly's cartesian bundle, a third of the whole library. It is published on npm only and included as it is
(``npm pack plotly.js-cartesian-dist-min@4.1.1``). A figure is plain JSON; arrays are base64 of 4-byte floats or of
codes of one or two bytes. Colours such as ``--line`` are those of `page.css`, for light, dark or print.
"""

import base64
import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._validation import plain_text


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of a page.

    Attributes
    ----------
    name : str
        Identifier in the page: letters, digits and hyphens.
    alt : str
        Text alternative: what the figure shows, in a sentence.
    traces : sequence of dict
        Traces of plotly.js; arrays by `packed` or `packed_codes`; ``"--NAME"`` is a colour of ``page.css``.
    layout : mapping
        Layout of plotly.js, which overrides the layout common to all figures.
    title : str
        Title above it.
    height_px : int
        Height on the screen in CSS pixels.
    view, data : str and mapping
        Name and data of a function in ``pages.views`` of the page's script that turns them into traces and layout.

    Examples
    --------
    >>> from hums.pages.page import Figure, packed
    >>> trace = {"type": "scatter", "x": packed([0, 1]), "y": packed([2, 3]), "line": {"color": "--line"}}
    >>> Figure(name="rise", alt="A line that rises from 2 to 3.", traces=[trace]).height_px
    360
    """

    name: str
    alt: str
    traces: Sequence[Mapping[str, Any]] = ()
    layout: Mapping[str, Any] = field(default_factory=dict)
    title: str = ""
    height_px: int = 360
    view: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)


def packed(values: ArrayLike) -> dict[str, Any]:
    """Return a one- or two-dimensional array as base64 of 4-byte floats: 7 digits, NaN included.

    Examples
    --------
    >>> from hums.pages.page import packed
    >>> packed([0.0, 1.0])
    {'dtype': 'f4', 'shape': [2], 'bdata': 'AAAAAAAAgD8='}
    """
    with np.errstate(over="ignore"):  # values beyond 3e38 become infinite, and are drawn as missing
        return _encoded(np.asarray(values).astype("<f4"), "f4")


def packed_codes(values: ArrayLike, *, digits: Literal["u1", "u2"] = "u1") -> dict[str, Any]:
    """Return an array quantised between its minimum and maximum, with the highest code for missing values.

    Parameters
    ----------
    values : array
        One- or two-dimensional.
    digits : {"u1", "u2"}
        One byte, for colour maps: errors up to 0.2 % of the range; or two, for curves: up to 8e-6 of the range.

    Examples
    --------
    >>> from hums.pages.page import packed_codes
    >>> packed_codes([[0.0, 127.0, 254.0]])
    {'dtype': 'u1', 'shape': [1, 3], 'bdata': 'AH/+', 'low': 0.0, 'step': 1.0}
    """
    given, none = np.asarray(values, dtype=np.float64), np.iinfo(digits).max
    finite = np.isfinite(given)
    low = float(given[finite].min()) if finite.any() else 0.0
    step = (float(given[finite].max()) - low) / (none - 1) if finite.any() else 0.0
    codes = np.full(given.shape, none, dtype=f"<{digits}")
    codes[finite] = np.rint((given[finite] - low) / (step or 1.0))
    return _encoded(codes, digits) | {"low": low, "step": step}


def _encoded(values: NDArray[Any], dtype: str) -> dict[str, Any]:
    data = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
    return {"dtype": dtype, "shape": list(values.shape), "bdata": data}


def least_and_largest(values: ArrayLike, *, columns: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the minimum and maximum of each column of a curve, in order of position, and their indices.

    Parameters
    ----------
    values : (n,) array
        Curve to draw.
    columns : int
        Number of columns of equal width. A curve of at most ``2 columns`` values is returned unchanged.

    Returns
    -------
    values, indices : (m,) arrays
        At most ``2 columns`` values, every peak and trough among them.

    Examples
    --------
    >>> from hums.pages.page import least_and_largest
    >>> values, indices = least_and_largest([0, 5, 1, 2, -3, 1], columns=2)
    >>> values.tolist(), indices.tolist()
    ([0.0, 5.0, 2.0, -3.0], [0, 1, 3, 4])
    """
    given = np.asarray(values, dtype=np.float64)
    if given.size <= 2 * columns:
        return given, np.arange(given.size)
    step = -(-given.size // columns)
    starts = np.arange(0, given.size, step)
    padded = np.pad(given, (0, starts.size * step - given.size), mode="edge").reshape(-1, step)
    both = np.sort(np.stack([padded.argmin(axis=1), padded.argmax(axis=1)], axis=1) + starts[:, None], axis=1)
    indices = np.unique(np.minimum(both.ravel(), given.size - 1))
    return given[indices], indices


def figure_html(figure: Figure, *, caption: str = "") -> str:
    """Return the HTML of a figure with its data; `stand_alone_page` adds the script that draws it.

    Parameters
    ----------
    figure : Figure
        Figure to draw.
    caption : str
        Text below it.

    Examples
    --------
    >>> from hums.pages.page import Figure, figure_html
    >>> figure_html(Figure(name="none", alt="Nothing at all."))[:38]
    '<figure class="plot" id="figure-none">'
    """
    content = {
        "traces": list(figure.traces),
        "layout": dict(figure.layout),
        "view": figure.view,
        "data": dict(figure.data),
        "alt": figure.alt,
    }
    above = f'<p class="title">{html.escape(plain_text(figure.title))}</p>' if figure.title else ""
    below = f"<figcaption>{html.escape(plain_text(caption))}</figcaption>" if caption else ""
    return (
        f'<figure class="plot" id="figure-{html.escape(figure.name)}">{above}'
        '<div class="canvas" tabindex="0" role="group" '
        f'aria-label="{html.escape(plain_text(figure.alt))} Arrow keys pan, plus and minus zoom, 0 resets." '
        f'style="height:{figure.height_px}px"></div>'
        f'<script type="application/json">{_json(content)}</script>{below}</figure>'
    )


def _json(content: object) -> str:
    """Return JSON that may stand in a script element."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def page_head(*scripts: str) -> str:
    """Return the first elements of a page's head: generator, and a policy that allows only the page's own scripts.

    Parameters
    ----------
    *scripts : str
        The page's scripts, each exactly as written between its tags.

    Returns
    -------
    str
        HTML. Nothing is loaded from outside, images and fonts are embedded, and no other script runs.

    Examples
    --------
    >>> from hums.pages.page import page_head
    >>> "default-src 'none'" in page_head("pages.begin();")
    True
    """
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        f'<meta charset="utf-8">\n<meta name="generator" content="hums-toolkit">\n'
        f'<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; script-src {allowed}; '
        "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'\">\n"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
    )


def page_environment() -> Any:  # noqa: ANN401 - jinja2 is heavy
    """Return the template environment of all pages, which escapes text, including its control characters."""
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415

    return Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: plain_text(value, keep="\n\t") if type(value) is str else value,
    )


def stand_alone_page(*, title: str, body: str, style: str = "", script: str = "") -> str:
    """Return a self-contained HTML page, which loads no other file.

    Parameters
    ----------
    title : str
        Title of the page.
    body : str
        HTML of the body, with figures by `figure_html`.
    style : str
        Style sheet that follows ``page.css``.
    script : str
        Script that follows ``page.js`` and runs before the figures are drawn; it may add to ``pages.views``.

    Examples
    --------
    >>> from hums.pages.page import stand_alone_page
    >>> page = stand_alone_page(title="Fleet <A>", body="<h1>Fleet</h1>")
    >>> "<title>Fleet &lt;A&gt;</title>" in page, "http:" in page.split("<script")[0]
    (True, False)
    """
    ours = files("hums.pages")
    css = (ours / "page.css").read_text(encoding="utf-8") + style
    js = "\n".join(["", (ours / "page.js").read_text(encoding="utf-8"), script, "pages.begin();\n"])
    plotly = (ours / "plotly-cartesian.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script")
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{page_head(plotly, js)}'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{html.escape(plain_text(title))}</title>\n<style>\n{css}</style>\n</head>\n<body>\n{body}\n"
        f'<script type="text/plain" id="plotly">{plotly}</script>\n<script>{js}</script>\n</body>\n</html>\n'
    )
