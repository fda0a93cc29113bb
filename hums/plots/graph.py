"""Graph of a mechanism, in the style of Penaud, Alazard and Amiez (2012, figures 3 and 7)."""

from collections import Counter
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from hums.gearbox.kinematics import Kinematics
from hums.plots.labels import LabelSpace, apply_layout, point_size
from hums.plots.style import FAINT, INK, TRACK_COLOURS, minus

_SHADE = "#64748b"
_FILL = to_rgba(_SHADE, 0.18)
_DASHES = (0, (4, 2.5))
_SIZE = 8.0  # of names in boxes, in points
_PAD = 0.45  # between a name and its box, of the font's size


@dataclass(frozen=True, kw_only=True)
class _Gears:
    """A gear pair: the vertices of its gears, their teeth, and the vertex of the carrier."""

    ends: tuple[int, int]
    teeth: tuple[int, int | None]
    carrier: int


@dataclass(frozen=True, kw_only=True)
class _Graph:
    """Vertices and edges of the graph; a vertex is a body, or all copies of one."""

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


def mechanism_graph(kinematics: Kinematics, *, ax: Axes) -> Axes:
    """Draw the graph of a mechanism: links, turning pairs by level, and gear pairs with their numbers of teeth.

    A vertex is a link, a set of rigidly connected links, or all copies of a planet. A solid edge is a turning pair, a
    shaded polygon a level of more than two links, and a dashed edge a gear pair with the number of teeth of each gear
    at its end, in the colour of its carrier, the link in which the contact point is at rest. The frame is dark, at the
    bottom. An unknown mate is a question mark.

    The vertices lie on an ellipse, so that no edge passes behind a vertex and no polygon encloses one of another level,
    in an order with few crossings.

    Parameters
    ----------
    kinematics : Kinematics
        Result of `solve_kinematics`.
    ax : matplotlib.axes.Axes
        Axes to draw on; their current size determines the layout, which is the same in every run.

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
    graph = _graph(kinematics)
    colours = {vertex: TRACK_COLOURS[k % len(TRACK_COLOURS)] for k, vertex in enumerate(graph.carriers)}
    ax.set_axis_off()
    _add_legend(graph, colours, ax=ax)
    unit = point_size(ax)
    area = np.array([ax.bbox.width, ax.bbox.height]) / unit
    ax.set(xlim=(0, area[0]), ylim=(0, area[1]))  # one data unit is one typographic point
    texts = _boxes(graph, colours, ax=ax)
    largest = np.max([_extent(text, unit).size for text in texts], axis=0) / unit
    order = _circular_order(graph)
    at = np.empty((len(order), 2))
    angle = 2 * np.pi * np.arange(len(order)) / len(order) - np.pi / 2
    at[order] = area / 2 + (area - largest) / 2 * np.column_stack([np.cos(angle), np.sin(angle)])
    for text, (x, y) in zip(texts, at, strict=True):
        text.set_position((float(x), float(y)))
    space = LabelSpace([_extent(text, unit).padded(2 * unit) for text in texts], inside=ax.bbox.padded(2 * unit))
    for _, members in graph.polygons:
        corners = at[sorted(members, key=order.index)]
        ax.add_patch(Polygon(corners, fc=_FILL, ec=_SHADE, lw=1.0, joinstyle="round", zorder=1))
    for i, j in graph.pairs:
        ax.add_patch(PathPatch(Path(at[[i, j]]), fc="none", ec=INK, lw=1.3, zorder=2))
    curves = _curves(graph, at)
    for gears, curve in zip(graph.gears, curves, strict=True):
        path = Path(curve, [Path.MOVETO, Path.CURVE3, Path.CURVE3])
        ax.add_patch(PathPatch(path, fc="none", ec=colours[gears.carrier], lw=1.3, ls=_DASHES, zorder=2))
    straight = [np.array([at[i], (at[i] + at[j]) / 2, at[j]]) for i, j in graph.pairs]
    lines = [_bezier(curve, np.linspace(0, 1, 41)) for curve in (*curves, *straight)]
    for number, (gears, curve) in enumerate(zip(graph.gears, curves, strict=True)):
        others = np.concatenate([np.empty((0, 2)), *lines[:number], *lines[number + 1 :]])
        for teeth, outward in zip(gears.teeth, (curve, curve[::-1]), strict=True):
            if teeth is not None:
                _write_teeth(teeth, outward, others, colour=colours[gears.carrier], space=space, ax=ax)
    _name_levels(graph, at, space=space, ax=ax)
    return ax


def _graph(kinematics: Kinematics) -> _Graph:
    """Return the vertices, levels and gear pairs of a mechanism."""
    gearbox, bodies, mechanism = kinematics.gearbox, kinematics.bodies, kinematics.mechanism
    together = gearbox.copy_links
    shown: dict[str, str] = {}  # body -> the body drawn for it
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
    axis_names = {name: axis.name for axis in gearbox.axes for name in axis.instances()}
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
    """Return the names of one body, wrapped into lines of about 16 characters."""
    lines = [names[0]]
    for name in names[1:]:
        if len(lines[-1]) + len(name) > 16:  # noqa: PLR2004
            lines.append(f"= {name}")
        else:
            lines[-1] += f" = {name}"
    return "\n".join(lines)


def _add_legend(graph: _Graph, colours: dict[int, str], *, ax: Axes) -> None:
    """Draw the legend below the graph, in as many columns as fit the width of the Axes, and lay out the figure."""
    handles: list[Line2D | Patch] = [Line2D([], [], color=INK, lw=1.3, label="turning pair")]
    if graph.polygons:
        handles.append(Patch(fc=_FILL, ec=_SHADE, label="links on one level"))
    for vertex, colour in colours.items():
        name = graph.labels[vertex].split("\n")[0].split(" = ")[0]
        handles.append(Line2D([], [], color=colour, lw=1.3, ls=_DASHES, label=f"gear pair, carrier: {name}"))
    handles.append(Patch(fc=INK, ec=INK, label="frame, at rest"))
    apply_layout(ax)
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
            break
    apply_layout(ax)


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


def _circular_order(graph: _Graph) -> list[int]:
    """Return the vertices in a circular order with few edge crossings, the frame first.

    Two vertices are swapped, or the order between them is reversed, as long as this gives fewer crossings or, for
    equally many, shorter edges.
    """
    order = list(range(len(graph.labels) + graph.unknown))
    fewest = _crossings(graph, order)
    searching = True
    while searching:
        searching = False
        for i, j in combinations(range(len(order)), 2):
            swapped = [*order[:i], order[j], *order[i + 1 : j], order[i], *order[j + 1 :]]
            turned = [*order[:i], *order[i : j + 1][::-1], *order[j + 1 :]]
            for other in (swapped, turned):
                count = _crossings(graph, other)
                if count < fewest:
                    order, fewest, searching = other, count, True
    first = order.index(graph.frame)
    return order[first:] + order[:first]


def _crossings(graph: _Graph, order: list[int]) -> tuple[int, int]:
    """Return the number of crossings of edges and polygon sides, and the total number of steps they span."""
    place = np.argsort(order)
    rings = [sorted(members, key=order.index) for _, members in graph.polygons]
    sides = [(ring[k - 1], ring[k]) for ring in rings for k in range(len(ring))]
    chords = np.sort(place[np.array([*graph.pairs, *(gears.ends for gears in graph.gears), *sides], dtype=int)])
    first, last = chords.reshape(-1, 2).T
    crossing = (first[:, None] < first) & (first < last[:, None]) & (last[:, None] < last)
    steps = np.minimum(last - first, len(order) - (last - first))
    return int(crossing.sum()), int(steps.sum())


def _curves(graph: _Graph, at: np.ndarray) -> list[np.ndarray]:
    """Return Bezier control points (3, 2) of every gear pair, curved where an edge already joins its vertices."""
    before = Counter(frozenset(pair) for pair in graph.pairs)
    curves = []
    for gears in graph.gears:
        start, end = at[list(gears.ends)]
        bend = 0.3 * before[frozenset(gears.ends)] * (1 if gears.ends[0] < gears.ends[1] else -1)
        before[frozenset(gears.ends)] += 1
        across = np.array([start[1] - end[1], end[0] - start[0]])
        curves.append(np.array([start, (start + end) / 2 + bend * across, end]))
    return curves


def _bezier(curve: np.ndarray, where: np.ndarray) -> np.ndarray:
    t = where[:, None]
    points: np.ndarray = (1 - t) ** 2 * curve[0] + 2 * t * (1 - t) * curve[1] + t**2 * curve[2]
    return points


def _write_teeth(
    teeth: int, curve: np.ndarray, others: np.ndarray, *, colour: str, space: LabelSpace, ax: Axes
) -> None:
    """Write a gear's number of teeth on its edge, as close to the gear as other texts and edges allow."""
    text = ax.text(
        0, 0, minus(str(teeth)), ha="center", va="center", fontsize=7.5, color=colour, weight="bold", zorder=5
    )
    text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])

    def cost(t: float) -> float:
        text.set_position(tuple(_bezier(curve, np.array([t]))[0]))
        extent = text.get_window_extent().padded(point_size(ax))
        low, high = ax.transData.inverted().transform(extent)
        across = np.all((others > low) & (others < high), axis=1)
        return space.overlap_area(extent) + 3.0 * int(np.count_nonzero(across)) + 20 * t

    cost(min(np.linspace(0.08, 0.48, 41).tolist(), key=cost))  # moves the text there
    space.occupy(text.get_window_extent().padded(point_size(ax)))


def _name_levels(graph: _Graph, at: np.ndarray, *, space: LabelSpace, ax: Axes) -> None:
    """Write the names of levels that differ from the names of their links."""
    circles = [(r * np.cos(a), r * np.sin(a)) for r in (0, 6, 12, 18, 24) for a in np.arange(8) * np.pi / 4]
    for name, members in graph.levels:
        said = any(name in graph.labels[vertex] for vertex in members)
        if said and len(members) == 2:  # noqa: PLR2004
            continue
        text = ax.text(0, 0, name, ha="center", va="center", fontsize=7, style="italic", color=_SHADE, zorder=5)
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        x, y = at[list(members)].mean(axis=0)
        space.place_text(text, [(float(x + right), float(y + up)) for right, up in circles])
