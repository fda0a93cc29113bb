"""Placement of labels without overlap.

Extents are in display units of the Axes in their current layout.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from hums.plots.style import FAINT

_FONTS = (7.5, 7.0, 6.5, 6.0, 5.5, 5.0)
_LEADER = 24  # points between a line and its name


def apply_layout(ax: Axes) -> None:
    """Run the layout of the figure, so that extents are those of the final drawing."""
    figure = ax.figure.canvas.figure
    engine = figure.get_layout_engine()
    if engine is None:
        figure.draw_without_rendering()
    else:  # takes a third of the time of a drawing
        engine.execute(figure)


def point_size(ax: Axes) -> float:
    """Return the number of display units per typographic point."""
    return float(ax.figure.dpi) / 72


class LabelSpace:
    """Occupied rectangles, and the overlap of others with them."""

    def __init__(self, occupied: Iterable[Bbox] = (), *, inside: Bbox | None = None) -> None:
        self._occupied = list(occupied)
        self._inside = inside

    def free(self, box: Bbox) -> bool:
        """Whether a rectangle lies within the bounds and overlaps no occupied one."""
        return self.overlap_area(box) == 0

    def overlap_area(self, box: Bbox) -> float:
        """Return the area of a rectangle that overlaps occupied ones or lies outside the bounds."""
        area = sum(_overlap(box, other) for other in self._occupied)
        if self._inside is not None:
            area += box.width * box.height - _overlap(box, self._inside)
        return float(area) if area > 1e-6 else 0.0  # noqa: PLR2004

    def occupy(self, box: Bbox) -> None:
        """Add a rectangle to the occupied ones."""
        self._occupied.append(box)

    def place_text(self, text: Text, places: Sequence[tuple[float, float]]) -> int:
        """Move a text to the first free position of `places`, or to the one of least overlap; return its index."""
        overlaps = []
        for number, place in enumerate(places):
            text.set_position(place)
            overlaps.append(self.overlap_area(text.get_window_extent()))
            if overlaps[number] == 0:
                break
        best = int(np.argmin(overlaps))
        text.set_position(places[best])
        self.occupy(text.get_window_extent())
        return best


def spread(positions: np.ndarray, *, gap: float | np.ndarray, low: float, high: float) -> np.ndarray:
    """Return ascending positions at least `gap` apart in [low, high], closest to the given ones in least squares.

    An array of gaps holds the distance from each position to the next. With the gaps subtracted this is isotonic
    regression, solved by pooling adjacent violators.
    """
    steps = np.append(0.0, np.cumsum(np.broadcast_to(gap, max(positions.size - 1, 0))))[: positions.size]
    pools: list[list[float]] = []  # mean, count
    for value in positions - steps:
        pools.append([float(value), 1])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            mean, count = pools.pop()
            pools[-1] = [(pools[-1][0] * pools[-1][1] + mean * count) / (pools[-1][1] + count), pools[-1][1] + count]
    flat = np.repeat([mean for mean, _ in pools], [int(count) for _, count in pools])
    moved: np.ndarray = np.clip(flat, low, max(low, high - steps[-1:].sum())) + steps
    return moved


def name_right_ends(ends: Sequence[tuple[float, str, str]], *, ax: Axes) -> int:
    """Label the right ends of lines without overlap; return the number of labels that fit.

    Parameters
    ----------
    ends : sequence of (float, str, str)
        Ordinate, label and colour of each line, in order of importance: the last are left out if not all fit.
    ax : matplotlib.axes.Axes
        Axes whose current height limits the number of labels.
    """
    right = ax.get_xlim()[1]
    texts = [
        ax.annotate(
            name,
            (right, value),
            xytext=(_LEADER, 0.5),
            textcoords=("offset points", "axes fraction"),
            va="center",
            fontsize=_FONTS[0],
            color=colour,
            arrowprops={"arrowstyle": "-", "relpos": (0.0, 0.5), "color": FAINT, "lw": 0.5, "shrinkA": 1, "shrinkB": 0},
            annotation_clip=False,
        )
        for value, name, colour in ends
    ]
    apply_layout(ax)
    height = float(ax.bbox.height)
    size = next((size for size in _FONTS if 1.22 * size * point_size(ax) * len(texts) <= height), _FONTS[-1])
    gap = 1.22 * size * point_size(ax)
    fitting = max(1, int(height / gap))
    for text in texts[fitting:]:
        text.remove()
    kept = sorted(zip(ends[:fitting], texts, strict=False), key=lambda end: end[0][0])
    at = ax.transData.transform([(right, value) for (value, _, _), _ in kept])[:, 1]
    places = spread(at, gap=gap, low=ax.bbox.y0 + gap / 2, high=ax.bbox.y1 - gap / 2)
    for (_, text), y in zip(kept, places, strict=True):
        text.set_fontsize(size)
        text.set_position((_LEADER, (y - ax.bbox.y0) / height))
    return len(kept)


def _overlap(one: Bbox, other: Bbox) -> float:
    wide = min(one.x1, other.x1) - max(one.x0, other.x0)
    high = min(one.y1, other.y1) - max(one.y0, other.y0)
    return float(max(wide, 0.0) * max(high, 0.0))
