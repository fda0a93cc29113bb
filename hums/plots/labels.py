"""Placement of labels without overlap.

Extents are in display units of the Axes in its present layout.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from matplotlib.transforms import Bbox


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
    """Occupied rectangles, and the overlap of further ones with them."""

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


def spread(positions: np.ndarray, *, gap: float, low: float, high: float) -> np.ndarray:
    """Return ascending positions at least `gap` apart in [low, high], nearest to the given ones in least squares.

    After subtraction of the gaps this is isotonic regression, solved by pooling adjacent violators.
    """
    steps = gap * np.arange(positions.size)
    pools: list[list[float]] = []  # mean, count
    for value in positions - steps:
        pools.append([float(value), 1])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            mean, count = pools.pop()
            pools[-1] = [(pools[-1][0] * pools[-1][1] + mean * count) / (pools[-1][1] + count), pools[-1][1] + count]
    flat = np.repeat([mean for mean, _ in pools], [int(count) for _, count in pools])
    moved: np.ndarray = np.clip(flat, low, max(low, high - gap * (positions.size - 1))) + steps
    return moved


def _overlap(one: Bbox, other: Bbox) -> float:
    wide = min(one.x1, other.x1) - max(one.x0, other.x0)
    high = min(one.y1, other.y1) - max(one.y0, other.y0)
    return float(max(wide, 0.0) * max(high, 0.0))
