"""Where text goes: rendered extents, and places that are still free.

Extents are in display units of the Axes as it is laid out when it is drawn on.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from matplotlib.transforms import Bbox


def settle(ax: Axes) -> None:
    """Run the layout of the figure, so that extents are those of the drawing to come."""
    figure = ax.figure.canvas.figure
    engine = figure.get_layout_engine()
    if engine is None:
        figure.draw_without_rendering()
    else:  # a third of the time of a drawing
        engine.execute(figure)


def points(ax: Axes) -> float:
    """Return the display units in one typographic point."""
    return float(ax.figure.dpi) / 72


class Board:
    """The rectangles that are taken, and whether another one is free."""

    def __init__(self, taken: Iterable[Bbox] = (), *, inside: Bbox | None = None) -> None:
        self._taken = list(taken)
        self._inside = inside

    def free(self, box: Bbox) -> bool:
        """Whether a rectangle lies inside the board and overlaps nothing on it."""
        return self.trouble(box) == 0

    def trouble(self, box: Bbox) -> float:
        """Area of a rectangle that overlaps others or leaves the board."""
        area = sum(_overlap(box, other) for other in self._taken)
        if self._inside is not None:
            area += box.width * box.height - _overlap(box, self._inside)
        return float(area) if area > 1e-6 else 0.0  # noqa: PLR2004

    def take(self, box: Bbox) -> None:
        """Mark a rectangle as taken."""
        self._taken.append(box)

    def put(self, text: Text, places: Sequence[tuple[float, float]]) -> int:
        """Move a text to the first free place of `places`, in its own coordinates; to the least bad if none is.

        Returns the number of the place.
        """
        troubles = []
        for number, place in enumerate(places):
            text.set_position(place)
            troubles.append(self.trouble(text.get_window_extent()))
            if troubles[number] == 0:
                break
        best = int(np.argmin(troubles))
        text.set_position(places[best])
        self.take(text.get_window_extent())
        return best


def spread(wanted: np.ndarray, *, gap: float, low: float, high: float) -> np.ndarray:
    """Move ascending positions as little as possible (least squares) until all are `gap` apart in [low, high].

    With the gaps taken out the answer is the nearest non-decreasing sequence: neighbours that are out of order
    are pooled to their mean.
    """
    steps = gap * np.arange(wanted.size)
    pools: list[list[float]] = []  # mean, count
    for value in wanted - steps:
        pools.append([float(value), 1])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            mean, count = pools.pop()
            pools[-1] = [(pools[-1][0] * pools[-1][1] + mean * count) / (pools[-1][1] + count), pools[-1][1] + count]
    flat = np.repeat([mean for mean, _ in pools], [int(count) for _, count in pools])
    moved: np.ndarray = np.clip(flat, low, max(low, high - gap * (wanted.size - 1))) + steps
    return moved


def _overlap(one: Bbox, other: Bbox) -> float:
    wide = min(one.x1, other.x1) - max(one.x0, other.x0)
    high = min(one.y1, other.y1) - max(one.y0, other.y0)
    return float(max(wide, 0.0) * max(high, 0.0))
