"""Drawing of the mechanism of a gearbox: a section through its axes, or the view along them."""

import math
import textwrap
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Wedge
from matplotlib.text import Annotation
from numpy.typing import NDArray

from hums.gearbox.components import Vector
from hums.gearbox.layout import BearingShape, GearShape, Layout, Rod, layout_of, transverse_axes
from hums.gearbox.model import Gearbox
from hums.plots.labels import apply_layout, point_size, spread
from hums.plots.style import FAINT, INK

Array = NDArray[np.float64]
View = Literal["section", "axial"]

_STEEL, _FRAME = "#dfe6ee", "#c3cad3"
_RIM = 0.14  # thickness of the rim of a ring gear over its pitch radius
_TEXT = 7.0  # points


def draw_mechanism(
    gearbox: Gearbox,
    *,
    ax: Axes,
    view: View = "section",
    colours: Mapping[str, str] | None = None,
) -> Axes:
    """Draw the mechanism of a gearbox: gears as pitch circles, shafts, carriers and bearings.

    Dimensions that the gearbox file does not declare are schematic, as stated in the note below the drawing.

    Parameters
    ----------
    gearbox : Gearbox
        From `hums.load_gearbox`.
    ax : matplotlib.axes.Axes
        Axes to draw on; their figure is enlarged if the names need more space.
    view : {"section", "axial"}
        Section through the axes, which shows all parts, or view along parallel axes, which shows pitch circles.
    colours : mapping of component to colour, optional
        Colours of components by the names of `hums.defect_orders`: a bearing, a shaft or link, a mesh (``"stage 1"``,
        drawn as its pitch point), or a gear of a mesh (``"stage 1/pinion"``).

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the axes of an axial view are not parallel, or `colours` names a component that the drawing does not have.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import hums
    >>> from hums.plots import draw_mechanism
    >>> gearbox = hums.load_gearbox("two-stage")
    >>> ax = draw_mechanism(gearbox, ax=Figure().add_subplot(), colours={"input bearing": "red"})
    >>> [text.get_text() for text in ax.texts if "bearing" in text.get_text()]
    ['input bearing', 'intermediate bearing']
    """
    layout, chosen = layout_of(gearbox), dict(colours or {})
    known = _components(layout)
    for name in chosen:
        if name not in known:
            raise ValueError(f'colours: the drawing has no "{name}"; it has {", ".join(sorted(known))}.')
    if view == "axial" and not layout.planar:
        raise ValueError(f'gearbox "{gearbox.name}": view="axial" needs parallel axes; use view="section".')
    drawing = _Drawing(ax, layout, gearbox, chosen)
    if view == "axial":
        drawing.axial()
    else:
        drawing.section()
    ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    ax.margins(0.08)
    ax.set_axis_off()
    notes = "\n".join(line for note in layout.notes for line in textwrap.wrap(note, 46))  # three inches
    ax.set_title(notes, loc="center", ma="left", fontsize=_TEXT, color=INK, y=-0.02, va="top")
    drawing.write_names()
    return ax


def coloured_components(gearbox: Gearbox) -> frozenset[str]:
    """Return the names of components that `draw_mechanism` can colour.

    Examples
    --------
    >>> import hums
    >>> from hums.plots.mechanism_drawing import coloured_components
    >>> sorted(coloured_components(hums.load_gearbox("glinsky-parallel-pair")))[:3]
    ['gear 1', 'gear 1-gear 2', 'gear 1-gear 2/gear 1']
    """
    return _components(layout_of(gearbox))


def _components(layout: Layout) -> frozenset[str]:
    gears = {name for gear in layout.gears for name in _names_of(gear)}
    bodies = {rod.body for rod in layout.rods} | {pair.body for pair in layout.pairs}
    meshes = {point.mesh for point in layout.meshes}
    return frozenset(gears | bodies | meshes | {bearing.name for bearing in layout.bearings})


def _names_of(gear: GearShape) -> tuple[str, ...]:
    """Return the names of a gear, the most specific first."""
    return (*(f"{mesh}/{gear.declared}" for mesh in gear.meshes), gear.declared, gear.link, gear.body)


class _Name(NamedTuple):
    """Name of a part, its position, and its colour if one was given."""

    text: str
    at: Array
    colour: str | None


class _Drawing:
    """The shapes of a layout on Axes, projected onto the drawing plane."""

    def __init__(self, ax: Axes, layout: Layout, gearbox: Gearbox, colours: Mapping[str, str]) -> None:
        self.ax, self.layout, self.colours = ax, layout, colours
        self.across, self.up = np.array(layout.across), np.array(layout.up)
        rigid = next((group for group in gearbox.rigid if gearbox.frame in group), (gearbox.frame,))
        self.frame = {gearbox.frame, *rigid}
        self.labels: list[_Name] = []

    def flat(self, point: Vector | Array) -> Array:
        """Return a point in the drawing plane, (2,)."""
        return np.array([np.dot(point, self.across), np.dot(point, self.up)])

    def given(self, names: Iterable[str]) -> str | None:
        """Return the colour given to a part by one of its names."""
        return next((self.colours[name] for name in names if name in self.colours), None)

    def colour(self, names: Iterable[str], otherwise: str) -> str:
        return self.given(names) or otherwise

    # ---- section ---------------------------------------------------------------------------------------------

    def section(self) -> None:
        """Draw the section, with one copy of each planet."""
        shown = self._shown_planets()
        for rod in self.layout.rods:
            if rod.kind != "arm" or rod.planet in shown:
                self._rod(rod)
        for gear in sorted(self.layout.gears, key=lambda gear: -gear.radius):
            if gear.body in shown:
                self._gear_section(gear)
        for bearing in self.layout.bearings:
            if self._is_shown(bearing, shown):
                self._bearing_section(bearing)
        for point in self.layout.meshes:
            if point.mesh in self.colours:
                self.ax.plot(*self.flat(point.point), "o", ms=6, color=self.colours[point.mesh], zorder=6)

    def _shown_planets(self) -> set[str]:
        """Return the bodies that the section shows: of the copies of a planet, the one closest to its plane."""
        normal = np.cross(self.across, self.up)
        best: dict[tuple[str, int], tuple[float, str]] = {}
        for gear in self.layout.gears:
            depth = abs(float(np.dot(gear.centre, normal))) + float(abs(np.dot(gear.axis, normal)))
            depth = round(depth / max(gear.radius, 1.0), 6)
            key = (gear.declared, gear.teeth)
            if key not in best or depth < best[key][0]:
                best[key] = (depth, gear.body)
        chosen = {body for _, body in best.values()}
        copied = {gear.body for gear in self.layout.gears if gear.declared != gear.link}
        return chosen | {gear.body for gear in self.layout.gears if gear.body not in copied}

    def _is_shown(self, bearing: BearingShape, shown: set[str]) -> bool:
        gears = {gear.link: gear.body for gear in self.layout.gears}
        return all(gears.get(ring, "") in shown or ring not in gears for ring in (bearing.inner, bearing.outer))

    def _rod(self, rod: Rod) -> None:
        points = np.array([self.flat(point) for point in rod.points])
        colour = self.colour((rod.body,), _STEEL)
        for start, end in pairwise(points):
            length = np.linalg.norm(end - start)
            if length > 0:
                aside = rod.radius * np.array([start[1] - end[1], end[0] - start[0]]) / length
                corners = [start + aside, end + aside, end - aside, start - aside]
                self.ax.add_patch(Polygon(corners, closed=True, fc=colour, ec=INK, lw=0.6, zorder=2))
        if rod.kind == "shaft" and not any(gear.link == rod.body for gear in self.layout.gears):
            self.labels.append(_Name(rod.body, points[-1], self.given((rod.body,))))
        if rod.kind == "arm":
            self.labels.append(_Name(rod.body, points[-2:].mean(axis=0), self.given((rod.body,))))

    def _gear_section(self, gear: GearShape) -> None:
        """Draw a cylinder, a cone, or the two halves of a ring."""
        centre, axis = self.flat(gear.centre), self.flat(gear.axis)
        length = float(np.linalg.norm(axis))
        aside = self.flat(transverse_axes(gear.axis, self.layout.normal)[0])
        colour = self.colour(_names_of(gear), _FRAME if gear.body in self.frame else _STEEL)
        style = {"fc": colour, "ec": INK, "lw": 0.8, "zorder": 3, "hatch": "////" if gear.body in self.frame else None}
        in_plane = 1e-6
        if gear.cone_rad:
            along = gear.face * math.cos(gear.cone_rad) * axis
            inner = gear.radius - gear.face * math.sin(gear.cone_rad)
            outline = [centre + gear.radius * aside, centre - along + inner * aside]
            if gear.internal:
                rim = _RIM * gear.radius
                for sign in (1, -1):
                    edge = [centre + sign * gear.radius * aside, centre - along + sign * inner * aside]
                    back = [point + sign * rim * aside for point in reversed(edge)]
                    self.ax.add_patch(Polygon([*edge, *back], closed=True, **style))
            else:
                mirrored = [2 * (centre + np.dot(point - centre, axis) * axis) - point for point in reversed(outline)]
                self.ax.add_patch(Polygon([*outline, *mirrored], closed=True, **style))
        else:
            half = gear.face / 2 * axis if length > in_plane else 0 * axis
            bounds = [(gear.radius, (1 + _RIM) * gear.radius), (-gear.radius, -(1 + _RIM) * gear.radius)]
            for low, high in bounds if gear.internal else [(-gear.radius, gear.radius)]:
                corners = [centre - half + low * aside, centre + half + low * aside]
                corners += [centre + half + high * aside, centre - half + high * aside]
                self.ax.add_patch(Polygon(corners, closed=True, **style))
        place = centre + (1 + _RIM / 2) * gear.radius * aside if gear.internal else centre
        self.labels.append(_Name(f"{gear.link}  {gear.teeth}", place, self.given(_names_of(gear))))

    def _bearing_section(self, bearing: BearingShape) -> None:
        """Draw a bearing as two squares with crosses, above and below its axis."""
        centre, axis = self.flat(bearing.centre), self.flat(bearing.axis)
        aside = self.flat(transverse_axes(bearing.axis, self.layout.normal)[0])
        half = 1.4 * bearing.element_radius
        colour = self.colour((bearing.name,), "white")
        for sign in (1, -1):
            middle = centre + sign * bearing.radius * aside
            corners = [middle + half * (a * axis + b * aside) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            self.ax.add_patch(Polygon(corners, closed=True, fc=colour, ec=INK, lw=0.8, zorder=4))
            for one, two in ((0, 2), (1, 3)):
                self.ax.plot(*np.array([corners[one], corners[two]]).T, color=INK, lw=0.5, zorder=5)
        self.labels.append(_Name(bearing.name, centre - bearing.radius * aside, self.given((bearing.name,))))

    # ---- along the axes --------------------------------------------------------------------------------------

    def axial(self) -> None:
        """Draw the view along the axes: pitch circles with a tick per tooth, the largest behind the others."""
        self.across, self.up = (np.array(axis) for axis in self.layout.axial)
        for gear in sorted(self.layout.gears, key=lambda gear: -gear.radius * (1 + _RIM * gear.internal)):
            self._gear_circle(gear)
        for rod in self.layout.rods:
            if rod.kind == "arm":
                points = np.array([self.flat(point) for point in rod.points])
                colour = self.colour((rod.body,), INK)
                self.ax.plot(*points.T, color=colour, lw=2.0, solid_capstyle="round", zorder=5)
                self.labels.append(_Name(rod.body, points[0] * 0.5 + points[-1] * 0.5, self.given((rod.body,))))
        for bearing in self.layout.bearings:
            centre, colour = self.flat(bearing.centre), self.colour((bearing.name,), FAINT)
            for number in range(bearing.elements):
                angle = 2 * math.pi * number / bearing.elements
                at = centre + bearing.radius * np.array([math.cos(angle), math.sin(angle)])
                self.ax.add_patch(
                    Circle((at[0], at[1]), bearing.element_radius, fc="white", ec=colour, lw=0.8, zorder=6)
                )
            below = centre - np.array([0, bearing.radius])
            self.labels.append(_Name(bearing.name, below, self.given((bearing.name,))))
        for point in self.layout.meshes:
            if point.mesh in self.colours:
                self.ax.plot(*self.flat(point.point), "o", ms=6, color=self.colours[point.mesh], zorder=7)

    def _gear_circle(self, gear: GearShape) -> None:
        x, y = self.flat(gear.centre)
        held = gear.body in self.frame
        colour = self.colour(_names_of(gear), _FRAME if held else _STEEL)
        if gear.internal:
            rim = Wedge(
                (x, y), (1 + _RIM) * gear.radius, 0, 360, width=_RIM * gear.radius, fc=colour, ec=INK, lw=0.8, zorder=3
            )
            self.ax.add_patch(rim)
        else:
            self.ax.add_patch(Circle((x, y), gear.radius, fc=colour, ec=INK, lw=0.8, alpha=0.85, zorder=3))
            self.ax.plot(x, y, "+", color=INK, ms=4, lw=0.6, zorder=4)
        angles = gear.tooth_rad + 2 * math.pi * np.arange(gear.teeth) / gear.teeth
        depth = math.pi * gear.radius / gear.teeth / 2  # a quarter of the pitch on either side of the pitch circle
        ends = gear.radius + np.array([-depth, depth, math.nan])
        e1, e2 = (self.flat(axis) for axis in transverse_axes(gear.axis, self.layout.normal))
        rays = np.cos(angles)[:, None] * e1 + np.sin(angles)[:, None] * e2
        ticks = np.array([x, y]) + ends[None, :, None] * rays[:, None, :]
        self.ax.plot(*ticks.reshape(-1, 2).T, color=INK, lw=0.6, zorder=4)
        place = np.array([x, y + (1 + _RIM / 2) * gear.radius]) if gear.internal else np.array([x, y])
        self.labels.append(_Name(f"{gear.link}  {gear.teeth}", place, self.given(_names_of(gear))))

    # ---- names -----------------------------------------------------------------------------------------------

    def write_names(self) -> None:
        """Write the names in two columns next to the drawing, with leaders, and enlarge the figure if necessary."""
        apply_layout(self.ax)
        least = 0.55 * self.ax.bbox.width  # kept for the mechanism next to long names
        labels = sorted({label.text: label for label in self.labels}.values(), key=lambda label: float(label.at[0]))
        self.ax.plot(*np.array([label.at for label in labels]).T, ".", ls="", ms=3, color=INK, zorder=9)
        # names take space from the drawing and so move its parts: the third pass moves none by a point
        for _ in range(3):
            for name in list(self.ax.texts):
                name.remove()
            left, right = self._column(labels[: len(labels) // 2], -1), self._column(labels[len(labels) // 2 :], 1)
            apply_layout(self.ax)
            highest = point_size(self.ax) * max(sum(map(_height, names)) for names in (left, right))
            self._grow(least - self.ax.bbox.width, highest - self.ax.bbox.height)
            apply_layout(self.ax)

    def _grow(self, width: float, height: float) -> None:
        """Enlarge the figure until these Axes have gained a width and height in display units, where positive."""
        figure, spec = self.ax.figure.canvas.figure, self.ax.get_subplotspec()
        rows, columns = spec.get_gridspec().get_geometry() if spec else (1, 1)
        wide, high = figure.get_size_inches() + np.maximum([columns * width, rows * height], 0.0) / figure.dpi
        figure.set_size_inches(float(wide), float(high))

    def _column(self, labels: list[_Name], side: int) -> list[Annotation]:
        """Write the names of one side in a column, each as close as possible to the height of its part."""
        drawn = self.ax.dataLim
        x = (drawn.x0 if side < 0 else drawn.x1) + side * 0.06 * drawn.width
        leader = {"arrowstyle": "-", "shrinkA": 0, "shrinkB": 0, "relpos": (0.0 if side > 0 else 1.0, 0.5)}
        longest = 24  # characters, above which a name is wrapped
        names = [
            self.ax.annotate(
                textwrap.fill(label.text, len(label.text) // -(-len(label.text) // longest) + 4),
                tuple(label.at),
                xytext=(x, 0),
                textcoords=("data", "axes fraction"),  # which keeps names apart where a later view takes width
                ha="left" if side > 0 else "right",
                ma="left",
                va="center",
                fontsize=_TEXT,
                color=INK,
                zorder=8,
                annotation_clip=False,
                bbox={"fc": label.colour or "white", "ec": "none", "alpha": 0.4 if label.colour else 0.7, "pad": 0.6},
                arrowprops=leader | {"color": label.colour or FAINT, "lw": 1.0 if label.colour else 0.6},
            )
            for label in sorted(labels, key=lambda label: float(label.at[1]))
        ]
        ends = np.array([self.ax.transData.transform(name.xy)[1] for name in names])
        rooms = np.array([_height(name) for name in names]) * point_size(self.ax)
        low, high = self.ax.bbox.y0 + rooms[:1].sum() / 2, self.ax.bbox.y1 - rooms[-1:].sum() / 2
        for name, y in zip(names, spread(ends, gap=(rooms[1:] + rooms[:-1]) / 2, low=low, high=high), strict=True):
            name.set_position((name.get_position()[0], (y - self.ax.bbox.y0) / self.ax.bbox.height))
        return names


def _height(name: Annotation) -> float:
    """Return the height that a name of one or more lines takes in its column, in points."""
    return _TEXT * (1.2 * name.get_text().count("\n") + 1.8)
