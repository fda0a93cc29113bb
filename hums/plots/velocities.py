"""Angular velocity vectors of the links of a mechanism, as in Penaud, Alazard and Amiez (2012, figure 5)."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from hums.gearbox.kinematics import Kinematics
from hums.plots.labels import LabelSpace, apply_layout, point_size
from hums.plots.style import FAINT, INK, LINE, MARK, minus

_SAME = 1e-9  # of the fastest link


@dataclass(frozen=True, kw_only=True)
class _Arrow:
    """One arrow in the complex plane for all links of equal velocity; `line` is its direction if it is radial."""

    names: tuple[str, ...]
    start: complex
    end: complex
    seen_from: str | None = None
    line: complex | None = None

    @property
    def vector(self) -> complex:
        return self.end - self.start


def velocity_diagram(kinematics: Kinematics, speeds: Mapping[str, float | Fraction] | None = None, *, ax: Axes) -> Axes:
    """Draw the angular velocity vectors of all links in the plane of their axes.

    Solid arrows are velocities relative to the frame, dashed ones those of planets relative to their carrier. The
    number at an arrow is its length, signed if all arrows are parallel. Collinear arrows are drawn side by side, links
    of equal velocity share an arrow, and the title lists the links at rest.

    Parameters
    ----------
    kinematics : Kinematics
        Result of `solve_kinematics`.
    speeds : mapping of link name to speed, optional
        Speeds in rpm, as for `Kinematics.velocities`. Default: ratios, with 1 for the gearbox's reference.
    ax : matplotlib.axes.Axes
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    GearboxError
        If an axis is not in the x-y plane; `Kinematics.vectors` returns the vectors in space.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import hums
    >>> from hums.plots import velocity_diagram
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("wijianto-pair"))
    >>> ax = velocity_diagram(kinematics, {"pinion": 700}, ax=Figure().add_subplot())
    >>> [text.get_text() for text in ax.texts if text.get_text()]  # 700 * 36 / 63
    ['pinion  700', 'gear  −400']
    """
    table = kinematics.velocities(speeds)
    velocity = dict(zip(kinematics.links, table.to_numpy().tolist(), strict=True))
    arrows = _arrows(kinematics, velocity)
    lines = {arrow.line for arrow in arrows}
    unit = lines.pop() if len(lines) == 1 else None  # if all are collinear
    turn = unit.conjugate() if unit else 1.0 + 0.0j
    shifts = [-1j * row for row in range(len(arrows))] if unit else _lanes(arrows)
    starts = [arrow.start * turn + shift for arrow, shift in zip(arrows, shifts, strict=True)]
    ends = [arrow.end * turn + shift for arrow, shift in zip(arrows, shifts, strict=True)]
    (_prepare_rows if unit else _prepare_plane)(ax, np.array([0j, *starts, *ends]))
    of = f"revolutions per revolution of {kinematics.gearbox.reference}" if speeds is None else "rpm"
    ax.set_xlabel(f"angular velocity along {_along(unit or 1.0)}, {of}")
    if not unit:
        ax.set_ylabel("angular velocity along y")
    for arrow, start, end in zip(arrows, starts, ends, strict=True):
        style = {
            "arrowstyle": "-|>,head_width=0.22,head_length=0.5",
            "linestyle": (0, (4, 2.5)) if arrow.seen_from else "-",
            "color": MARK if arrow.seen_from else LINE,
            "lw": 1.4,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        tail = (start.real, start.imag)
        ax.annotate("", (end.real, end.imag), tail, arrowprops=style, zorder=3, annotation_clip=False)
    fastest = max(map(abs, velocity.values()))
    resting = ", ".join(link for link, value in velocity.items() if abs(value) <= _SAME * fastest)
    ax.set_title(f"at rest: {resting}", loc="left", fontsize=8, color=INK)
    if unit:
        _name_rows(arrows, starts, ends, unit=unit, ax=ax)
    else:
        _name_tips(arrows, starts, ends, ax=ax)
    return ax


def _arrows(kinematics: Kinematics, velocity: Mapping[str, complex]) -> list[_Arrow]:
    """Return the arrows of all rotating links, each planet's followed by that relative to its carrier."""
    small = _SAME * max(map(abs, velocity.values()))
    carrier = {
        link: kinematics.joints[body].carried_by
        for link, body in kinematics.bodies.items()
        if body in kinematics.joints
    }
    arrows: list[_Arrow] = []

    def add(name: str, start: complex, end: complex, seen_from: str | None) -> None:
        if abs(end - start) <= small:
            return
        for number, other in enumerate(arrows):
            if abs(other.end - end) + abs(other.start - start) <= small and other.seen_from == seen_from:
                arrows[number] = _Arrow(**{**vars(other), "names": (*other.names, name)})
                return
        direction = (end - start) / abs(end - start)
        direction = -direction if (round(direction.real, 9), direction.imag) < (0, 0) else direction
        through = abs((start * direction.conjugate()).imag) <= small
        line = complex(round(direction.real, 9), round(direction.imag, 9)) if through else None
        arrows.append(_Arrow(names=(name,), start=start, end=end, seen_from=seen_from, line=line))

    for link, value in velocity.items():
        add(link, 0j, value, None)
        if link in carrier and abs(velocity[carrier[link]]) > small:
            add(link, velocity[carrier[link]], value, carrier[link])
    return arrows


def _lanes(arrows: list[_Arrow]) -> list[complex]:
    """Return offsets that separate collinear arrows, with the longest in the middle.

    An arrow at whose tip another starts has no offset, so that the two meet.
    """
    shifts = [0j] * len(arrows)
    step = 0.05 * max((abs(arrow.vector) for arrow in arrows), default=0.0)
    met = [arrow.start for arrow in arrows if arrow.line is None]
    for line in dict.fromkeys(arrow.line for arrow in arrows if arrow.line is not None):
        mine = [number for number, arrow in enumerate(arrows) if arrow.line == line]
        mine.sort(key=lambda number: (arrows[number].end not in met, -abs(arrows[number].end)))
        for rank, number in enumerate(mine):
            lane = (rank + 1) // 2 * (-1 if rank % 2 else 1)
            shifts[number] = 1j * line * step * lane
    return shifts


def _prepare_rows(ax: Axes, at: np.ndarray) -> None:
    ax.axvline(0, color=FAINT, lw=0.8, zorder=1)
    ax.set(xlim=(at.real.min(), at.real.max()), ylim=(at.imag.min() - 0.7, 0.7), yticks=[])
    ax.spines["left"].set_visible(False)


def _prepare_plane(ax: Axes, at: np.ndarray) -> None:
    """Set limits of equal scale in both directions that fill the Axes, with a margin for labels."""
    ax.axvline(0, color=FAINT, lw=0.8, zorder=1)
    ax.axhline(0, color=FAINT, lw=0.8, zorder=1)
    low = np.array([at.real.min(), at.imag.min()])
    high = np.array([at.real.max(), at.imag.max()])
    middle, half = (low + high) / 2, (high - low) / 2 + np.array([0.3, 0.16]) * ((high - low).max() or 1.0)
    ax.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    apply_layout(ax)
    shape = ax.bbox.width / ax.bbox.height
    half = np.maximum(half, [half[1] * shape, half[0] / shape])
    ax.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    ax.set_aspect("equal", adjustable="box")


def _name_rows(arrows: list[_Arrow], starts: list[complex], ends: list[complex], *, unit: complex, ax: Axes) -> None:
    """Write labels next to the arrow tips, and widen the limits to hold them."""
    texts = []
    for arrow, start, end in zip(arrows, starts, ends, strict=True):
        forward = end.real > start.real
        side = {"xytext": (5.0 if forward else -5.0, 0.0), "ha": "left" if forward else "right"}
        texts.append(_write(arrow, (arrow.vector * unit.conjugate()).real, end, side, ax=ax))
    for _ in range(4):  # wider limits make names wider in turn
        apply_layout(ax)
        boxes = [ax.transData.inverted().transform(text.get_window_extent()) for text in texts]
        low, high = ax.get_xlim()
        ax.set_xlim(min(low, *(box[0, 0] for box in boxes)), max(high, *(box[1, 0] for box in boxes)))


def _name_tips(arrows: list[_Arrow], starts: list[complex], ends: list[complex], *, ax: Axes) -> None:
    """Write labels in free space near the tips of arrows, or near the middle of those that do not start at 0."""
    apply_layout(ax)
    space, unit = LabelSpace(inside=ax.bbox), point_size(ax)
    for start, end in zip(starts, ends, strict=True):
        (x0, y0), (x1, y1) = ax.transData.transform([(z.real, z.imag) for z in (start, end)])
        for share in np.linspace(0, 1, max(2, int(np.hypot(x1 - x0, y1 - y0) / (2 * unit)))):
            half = (4 if share > 1 - 8 * unit / max(np.hypot(x1 - x0, y1 - y0), 1) else 1.5) * unit
            x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            space.occupy(Bbox([[x - half, y - half], [x + half, y + half]]))
    for number in sorted(range(len(arrows)), key=lambda n: -abs(ends[n])):
        arrow, start, end = arrows[number], starts[number], ends[number]
        tip = arrow.line is not None
        middle = {"xytext": (0.0, 0.0), "ha": "center"}
        text = _write(arrow, abs(arrow.vector), end if tip else (start + end) / 2, middle, ax=ax)
        extent = text.get_window_extent()
        size = np.array([extent.width, extent.height]) / 2 / unit
        outwards = np.angle(end - start) - (0 if tip else np.pi / 2)
        turns = np.array([0, 0.5, -0.5, 1, -1, 1.3, -1.3, 1.57, -1.57, 1.9, -1.9, 2.2, -2.2, 3.14])
        space.place_text(
            text, [_centre_at(size, outwards + angle, gap) for gap in (6, 10, 16, 26, 38, 52) for angle in turns]
        )


def _write(arrow: _Arrow, size: float, at: complex, style: dict[str, Any], *, ax: Axes) -> Annotation:
    """Write the links and speed of an arrow."""
    separator = "\n" if style["ha"] == "center" else " "  # beside a tip a short name finds a place sooner
    seen = f"{separator}relative to {arrow.seen_from}" if arrow.seen_from else ""
    return ax.annotate(
        f"{_joined(arrow.names)}{seen}  {minus(f'{size:.5g}')}",
        (at.real, at.imag),
        textcoords="offset points",
        va="center",
        fontsize=7.5,
        color=MARK if arrow.seen_from else LINE,
        annotation_clip=False,
        # hides the lines through zero; an outline would turn text into paths
        bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 0.4},
        **style,
    )


def _centre_at(half: np.ndarray, angle: float, gap: float) -> tuple[float, float]:
    """Return the centre of a text that touches a circle of radius `gap` at an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return float(c * gap + np.round(c, 1) * half[0]), float(s * gap + np.round(s, 1) * half[1])


def _joined(names: tuple[str, ...]) -> str:
    """Return the names, with numbered copies merged: planet 1, 2, 3."""
    written: list[str] = []
    last = ""
    for name in names:
        stem, _, number = name.rpartition(" ")
        written.append(number if stem and stem == last and number.isdigit() else name)
        last = stem
    return ", ".join(written)


def _along(unit: complex) -> str:
    if abs(unit - 1) < _SAME:
        return "x"
    return "y" if abs(unit - 1j) < _SAME else f"({unit.real:.3g}, {unit.imag:.3g}, 0)"
