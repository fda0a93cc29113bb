"""Graph of a mechanism, drawn as by Penaud, Alazard and Amiez (2012, figures 3 and 7)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from hums.gearbox.kinematics import Kinematics
from hums.plots.graph_layout import LayoutProblem, inside, place, ring
from hums.plots.labels import LabelSpace, apply_layout, point_size
from hums.plots.style import FAINT, INK, TRACK_COLOURS, minus

_SHADE = "#64748b"
_SIZE = 8.0  # of names in boxes, in points
_PAD = 0.45  # between a name and its box, of the font's size
_BENDS = (0.0, 0.12, -0.12, 0.22, -0.22, 0.35, -0.35, 0.5, -0.5)
_ALONG = np.linspace(0, 1, 41)


@dataclass(frozen=True, kw_only=True)
class _Gears:
    """A gear pair: the vertices of its gears, their teeth, and the vertex of the carrier."""

    ends: tuple[int, int]
    teeth: tuple[int, int | None]
    carrier: int


@dataclass(frozen=True, kw_only=True)
class _Graph:
    """Vertices and edges of the drawing; a vertex is a body, or all copies of one."""

    labels: tuple[str, ...]
    frame: int
    levels: tuple[tuple[str, tuple[int, ...]], ...]
    gears: tuple[_Gears, ...]
    unknown: int

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Turning pairs that are the only one on their level."""
        return tuple((members[0], members[1]) for _, members in self.levels if len(members) == 2)  # noqa: PLR2004

    @property
    def polygons(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Levels of more than two links, by name."""
        return tuple((name, members) for name, members in self.levels if len(members) > 2)  # noqa: PLR2004

    @property
    def carriers(self) -> tuple[int, ...]:
        """Vertices that carry a mesh, the frame last."""
        found = dict.fromkeys(gears.carrier for gears in self.gears)
        return tuple(sorted(found, key=lambda vertex: vertex == self.frame))


def mechanism_graph(kinematics: Kinematics, *, ax: Axes, copies: bool = False) -> Axes:
    """Draw the graph of a mechanism: links, turning pairs by level, and gear pairs with their teeth.

    A vertex is a link, or several links that are rigid with each other. A solid edge is a turning pair, a shaded
    polygon a level of more than two links, and a dashed edge a gear pair with the teeth of each gear at its end, in
    the colour of its carrier, the link in which the contact point is at rest. The frame is dark. An unknown mate is
    a question mark.

    Parameters
    ----------
    kinematics : Kinematics
        Result of `solve_kinematics`.
    ax : matplotlib.axes.Axes
        Axes to draw on; their present size determines the layout, which is the same in every run.
    copies : bool
        Whether each copy of a planet has its own vertex; otherwise one vertex states their number.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import hums
    >>> from hums.plots import mechanism_graph
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("wijianto-pair"))
    >>> ax = mechanism_graph(kinematics, ax=Figure().add_subplot())
    >>> [text.get_text() for text in ax.texts]  # links, then teeth
    ['housing', 'pinion', 'gear', '36', '63']
    """
    graph = _graph(kinematics, copies=copies)
    colours = {vertex: TRACK_COLOURS[k % len(TRACK_COLOURS)] for k, vertex in enumerate(graph.carriers)}
    ax.set_axis_off()
    ax.legend(**_legend(graph, colours), loc="upper center", bbox_to_anchor=(0.5, 0.0), frameon=False, fontsize=7)
    apply_layout(ax)
    _narrow(ax)
    apply_layout(ax)
    unit = point_size(ax)
    width, height = ax.bbox.width / unit, ax.bbox.height / unit
    ax.set(xlim=(0, width), ylim=(0, height))  # one data unit is one typographic point
    texts = _boxes(graph, colours, ax=ax)
    sizes = np.array(
        [[extent.width / unit, extent.height / unit] for extent in (_extent(text, unit) for text in texts)]
    )
    edges = (*graph.pairs, *(gears.ends for gears in graph.gears))
    groups = tuple(members for _, members in graph.polygons)
    at = place(LayoutProblem(sizes=sizes, edges=edges, groups=groups, area=(width, height)))
    for text, position in zip(texts, at, strict=True):
        text.set_position((float(position[0]), float(position[1])))
    space = LabelSpace([_extent(text, unit).padded(2 * unit) for text in texts], inside=ax.bbox.padded(2 * unit))
    corners = [at[ring(at, members)] for members in groups]
    for polygon in corners:
        ax.add_patch(Polygon(polygon, fc=(*_rgb(_SHADE), 0.18), ec=_SHADE, lw=1.0, joinstyle="round", zorder=1))
    curves = _curves(edges, at, sizes, corners)
    for pair in curves[: len(graph.pairs)]:
        ax.add_patch(PathPatch(_path(pair), fc="none", ec=INK, lw=1.3, zorder=2))
    for gears, curve in zip(graph.gears, curves[len(graph.pairs) :], strict=True):
        edge = PathPatch(_path(curve), fc="none", ec=colours[gears.carrier], lw=1.3, zorder=2)
        edge.set_linestyle((0, (4, 2.5)))
        ax.add_patch(edge)
    lines = [_bezier(curve) for curve in curves]
    for gears, curve, line in zip(graph.gears, curves[len(graph.pairs) :], lines[len(graph.pairs) :], strict=True):
        others = [other for other in lines if other is not line]
        for end, teeth in enumerate(gears.teeth):
            if teeth is not None:
                here = curve if end == 0 else curve[::-1]
                _write_teeth(teeth, here, others, colour=colours[gears.carrier], space=space, ax=ax)
    _name_levels(graph, at, space=space, ax=ax)
    return ax


def _graph(kinematics: Kinematics, *, copies: bool) -> _Graph:
    """Return the vertices, levels and gear pairs of a mechanism."""
    gearbox, bodies, mechanism = kinematics.gearbox, kinematics.bodies, kinematics.mechanism
    together = {} if copies else gearbox.copy_links
    shown: dict[str, str] = {}  # body -> the one that is drawn for it
    for link, body in bodies.items():
        first = gearbox.instances(together[link])[0] if link in together else link
        shown.setdefault(body, bodies[first])
    members: dict[str, list[str]] = {body: [] for body in dict.fromkeys(shown.values())}
    for link, body in bodies.items():
        name = together.get(link, link)
        if name not in members[shown[body]]:
            members[shown[body]].append(name)
    number = {body: vertex for vertex, body in enumerate(members)}
    labels = []
    for names in members.values():
        count = gearbox.copied.get(names[0], 1)
        labels.append(_wrapped(names) + (f"\n{count} copies" if names[0] in together.values() else ""))
    levels: dict[tuple[int, ...], str] = {}
    axis_names = {} if copies else {name: axis.name for axis in gearbox.axes for name in axis.instances()}
    for axis, on in mechanism.levels.items():
        levels.setdefault(tuple(dict.fromkeys(number[shown[body]] for body in on)), axis_names.get(axis, axis))
    unknown = 0
    gears: dict[tuple[str, tuple[int, ...]], _Gears] = {}
    for contact in kinematics.contacts:
        ends = [number[shown[bodies[link]]] for link, _ in contact.gears]
        if len(ends) == 1:
            ends.append(len(number) + unknown)
            unknown += 1
        mate = contact.gears[1][1] if len(contact.gears) > 1 else None
        edge = _Gears(
            ends=(ends[0], ends[1]), teeth=(contact.gears[0][1], mate), carrier=number[shown[bodies[contact.carrier]]]
        )
        gears.setdefault((contact.mesh, edge.ends), edge)
    return _Graph(
        labels=tuple(labels),
        frame=number[shown[mechanism.frame]],
        levels=tuple((name, vertices) for vertices, name in levels.items()),
        gears=tuple(gears.values()),
        unknown=unknown,
    )


def _wrapped(names: list[str]) -> str:
    """Return the names of one body, wrapped into lines of some 16 letters."""
    lines = [names[0]]
    for name in names[1:]:
        if len(lines[-1]) + len(name) > 16:  # noqa: PLR2004
            lines.append(f"= {name}")
        else:
            lines[-1] += f" = {name}"
    return "\n".join(lines)


def _legend(graph: _Graph, colours: dict[int, str]) -> dict[str, list[Artist]]:
    handles: list[Artist] = [Line2D([], [], color=INK, lw=1.3, label="turning pair")]
    if graph.polygons:
        handles.append(Patch(fc=(*_rgb(_SHADE), 0.18), ec=_SHADE, label="links on one level"))
    for vertex, colour in colours.items():
        name = graph.labels[vertex].split("\n")[0].split(" = ")[0]
        label = f"gear pair, carrier: {name}"
        handles.append(Line2D([], [], color=colour, lw=1.3, ls=(0, (4, 2.5)), label=label))
    handles.append(Patch(fc=INK, ec=INK, label="frame, at rest"))
    return {"handles": handles}


def _narrow(ax: Axes) -> None:
    """Give the legend as many columns as the figure is wide."""
    legend = ax.get_legend()
    if legend is None:
        return
    handles = legend.legend_handles
    for columns in range(len(handles), 0, -1):
        legend = ax.legend(
            handles=handles,
            ncols=columns,
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            frameon=False,
            fontsize=7,
        )
        if legend.get_window_extent().width <= ax.bbox.width:
            return


def _boxes(graph: _Graph, colours: dict[int, str], *, ax: Axes) -> list[Text]:
    """Return the boxed names of the vertices; carriers have a strong border, the frame is dark."""
    texts = []
    for vertex, label in enumerate((*graph.labels, *["?"] * graph.unknown)):
        known = vertex < len(graph.labels)
        border = colours.get(vertex, INK if known else FAINT)
        box = {
            "boxstyle": f"round,pad={_PAD}",
            "fc": INK if vertex == graph.frame else "white",
            "ec": border,
            "lw": 2.2 if vertex in colours else 0.9,
        }
        ink = "white" if vertex == graph.frame else INK
        texts.append(ax.text(0, 0, label, ha="center", va="center", fontsize=_SIZE, color=ink, bbox=box, zorder=4))
    return texts


def _extent(text: Text, unit: float) -> Bbox:
    """Return the extent of a text with its box, which matplotlib updates only when it draws."""
    return text.get_window_extent().padded(_PAD * _SIZE * unit)


def _curves(
    edges: tuple[tuple[int, int], ...], at: np.ndarray, sizes: np.ndarray, corners: list[np.ndarray]
) -> list[np.ndarray]:
    """Return Bezier control points (3, 2) of every edge, bent where a straight one would meet a box or an edge."""
    chosen: list[np.ndarray] = []
    for i, j in edges:
        others = np.setdiff1d(np.arange(len(at)), [i, j])
        best, least = np.empty(0), np.inf
        for bend in _BENDS:
            span = at[j] - at[i]
            curve = np.array([at[i], (at[i] + at[j]) / 2 + 2 * bend * np.array([-span[1], span[0]]), at[j]])
            line = _bezier(curve)
            off = (np.abs(line[:, None] - at[others]) - sizes[others] / 2).max(axis=2)
            cost = 4 * abs(bend) + 1.5 * float(np.clip(1 - off / 6, 0, 1).sum())
            for other in chosen:
                between = np.linalg.norm(line[:, None] - _bezier(other)[None], axis=2).min(axis=1)
                cost += 0.3 * max(0, int(np.count_nonzero(between[6:-6] < 5)) - 5)  # noqa: PLR2004
            cost += sum(0.03 * int(np.count_nonzero(inside(line, polygon))) for polygon in corners)
            if cost < least - 1e-9:
                best, least = curve, cost
        chosen.append(best)
    return chosen


def _bezier(curve: np.ndarray, where: np.ndarray = _ALONG) -> np.ndarray:
    t = where[:, None]
    points_on: np.ndarray = (1 - t) ** 2 * curve[0] + 2 * t * (1 - t) * curve[1] + t**2 * curve[2]
    return points_on


def _path(curve: np.ndarray) -> Path:
    return Path(curve, [Path.MOVETO, Path.CURVE3, Path.CURVE3])


def _write_teeth(
    teeth: int, curve: np.ndarray, others: list[np.ndarray], *, colour: str, space: LabelSpace, ax: Axes
) -> None:
    """Write a gear's teeth on its edge, as close to the gear as other texts and edges allow."""
    text = ax.text(
        0, 0, minus(str(teeth)), ha="center", va="center", fontsize=7.5, color=colour, weight="bold", zorder=5
    )
    text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
    rest = np.concatenate(others) if others else np.empty((0, 2))
    best, least = (0.0, 0.0), np.inf
    for t in np.linspace(0.08, 0.48, 41):
        x, y = _bezier(curve, np.array([t]))[0]
        text.set_position((x, y))
        extent = text.get_window_extent().padded(point_size(ax))
        box = ax.transData.inverted().transform(extent)
        across = np.all((rest > box[0]) & (rest < box[1]), axis=1)
        cost = space.overlap_area(extent) + 3.0 * np.count_nonzero(across) + 20 * t
        if cost < least:
            best, least = (x, y), cost
    text.set_position(best)
    space.occupy(text.get_window_extent().padded(point_size(ax)))


def _name_levels(graph: _Graph, at: np.ndarray, *, space: LabelSpace, ax: Axes) -> None:
    """Write the names of levels that differ from the names of their links, where there is free space."""
    for name, members in graph.levels:
        said = any(name in graph.labels[vertex] for vertex in members)
        if said and len(members) == 2:  # noqa: PLR2004
            continue
        middle = at[list(members)].mean(axis=0)
        text = ax.text(0, 0, name, ha="center", va="center", fontsize=7, style="italic", color=_SHADE, zorder=5)
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        for x, y in _around(middle):
            text.set_position((x, y))
            if space.free(text.get_window_extent()):
                space.occupy(text.get_window_extent())
                break
        else:
            text.remove()


def _around(middle: np.ndarray) -> Iterator[tuple[float, float]]:
    for radius in (0, 6, 12, 18, 24):
        for angle in np.arange(8 if radius else 1) * np.pi / 4:
            yield float(middle[0] + radius * np.cos(angle)), float(middle[1] + radius * np.sin(angle))


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
