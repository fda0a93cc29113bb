"""Where the vertices of a graph go: a stress layout from many starts, then small moves towards readability.

Edges join two vertices; a group of three and more is drawn as a polygon. Lengths are those of the drawing.
The stress is that of Kamada and Kawai (1989), minimised by majorization (Gansner, Koren and North 2004); the
random starts have a fixed seed, so a graph is always drawn the same way.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

_STARTS, _KEPT, _TURNS = 60, 4, 12
_MAJORIZATIONS, _MOVES, _SWAPS = 60, 700, 0.15
_SAMPLES = np.linspace(0, 1, 13)
_BESIDE = 8.0  # an edge this close to a box seems to end there
_STRAY = 3.0  # crossings that a vertex inside a foreign polygon, which looks like a corner of it, is as bad as
_SHARP = 0.9  # cosine of an angle between edges that is hard to see
_GAP, _ROOM = 16.0, 58.0  # between boxes, and of an edge outside its boxes, which has to hold two numbers


@dataclass(frozen=True, kw_only=True)
class Sketch:
    """A graph to be placed: the sizes of its vertices' boxes (n, 2), edges, groups, and the room there is."""

    sizes: np.ndarray
    edges: tuple[tuple[int, int], ...]
    groups: tuple[tuple[int, ...], ...]
    room: tuple[float, float]

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.sizes)

    @property
    def unit(self) -> float:
        """Length of an edge where the vertices fill the room."""
        return float(0.85 * np.sqrt(np.prod(self.room) / self.count))

    @cached_property
    def reach(self) -> np.ndarray:
        """How far apart the middles of two boxes are where they touch, (n, n, 2)."""
        together: np.ndarray = (self.sizes[:, None] + self.sizes[None]) / 2
        return together

    @cached_property
    def ideal(self) -> np.ndarray:
        """Ideal distance of every two vertices, in the drawing."""
        lengths: np.ndarray = self.distances[_pairs(self.count)] * self.unit
        return lengths

    @cached_property
    def foreign(self) -> tuple[np.ndarray, ...]:
        """Of each group, the vertices that are not in it."""
        return tuple(np.setdiff1d(np.arange(self.count), group) for group in self.groups)

    @cached_property
    def distances(self) -> np.ndarray:
        """Ideal distances between vertices and, after them, the centres of the groups; edges are 1 long."""
        total = self.count + len(self.groups)
        length = np.full((total, total), np.inf)
        np.fill_diagonal(length, 0)
        for i, j in self.edges:
            length[i, j] = length[j, i] = 1.0
        for number, group in enumerate(self.groups):
            hub = self.count + number
            radius = max(0.6, 0.5 / np.sin(np.pi / len(group)))
            for vertex in group:
                length[hub, vertex] = length[vertex, hub] = radius
        for middle in range(total):
            length = np.minimum(length, length[:, [middle]] + length[[middle], :])
        reached = np.isfinite(length)
        far: np.ndarray = np.where(reached, length, 1.0 + length[reached].max())
        return far


def place(sketch: Sketch) -> np.ndarray:
    """Return the positions of the vertices, (n, 2), inside the room."""
    if sketch.count == 1:
        return np.array([sketch.room]) / 2
    rng = np.random.default_rng(2012)
    layouts = _stress_layouts(sketch, rng)
    tangle = [_tangle(sketch, layout) for layout in layouts]
    best, cost = layouts[0], np.inf
    for start in np.argsort(tangle, kind="stable")[:_KEPT]:
        turned = [_fit(sketch, layouts[start], angle) for angle in np.arange(_TURNS) * 2 * np.pi / _TURNS]
        costs = [_cost(sketch, layout) for layout in turned]
        layout, reached = _improve(sketch, turned[int(np.argmin(costs))], rng)
        if reached < cost - 1e-9:
            best, cost = layout, reached
    return _filled(sketch, best)


def ring(positions: np.ndarray, group: tuple[int, ...]) -> list[int]:
    """Return the vertices of a group in their order round its middle: the corners of its polygon."""
    from_middle = positions[list(group)] - positions[list(group)].mean(axis=0)
    return [group[k] for k in np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0]), kind="stable")]


def inside(where: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) lie inside a polygon (m, 2), by the parity of the sides to their right."""
    x, y = where[:, [0]], where[:, [1]]
    a, b = polygon, _following(polygon)
    rise = b[:, 1] - a[:, 1]
    straddles = (a[:, 1] > y) != (b[:, 1] > y)
    at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / np.where(rise == 0, 1, rise)
    result: np.ndarray = np.count_nonzero(straddles & (x < at), axis=1) % 2 == 1
    return result


def _following(polygon: np.ndarray) -> np.ndarray:
    """Return the corner after each corner."""
    return np.concatenate([polygon[1:], polygon[:1]])  # numpy.roll takes several times as long


def _stress_layouts(sketch: Sketch, rng: np.random.Generator) -> np.ndarray:
    """Minimise sum (|x_i - x_j| / d_ij - 1)^2 from random starts; (starts, n, 2), group centres dropped."""
    ideal = sketch.distances
    total = len(ideal)
    weight = 1 / np.where(ideal > 0, ideal, 1) ** 2
    np.fill_diagonal(weight, 0)
    solve = np.linalg.pinv(np.diag(weight.sum(axis=1)) - weight)
    x = rng.normal(size=(_STARTS, total, 2))
    for _ in range(_MAJORIZATIONS):
        apart = np.linalg.norm(x[:, :, None] - x[:, None], axis=-1)
        pull = -weight * ideal / np.maximum(apart, 1e-9)
        diagonal = np.arange(total)
        pull[:, diagonal, diagonal] = 0
        pull[:, diagonal, diagonal] = -pull.sum(axis=2)
        x = solve @ (pull @ x)
    layouts: np.ndarray = x[:, : sketch.count]
    return layouts


def _fit(sketch: Sketch, layout: np.ndarray, angle: float) -> np.ndarray:
    """Turn a layout and stretch it, not too unevenly, to the room its boxes leave."""
    c, s = np.cos(angle), np.sin(angle)
    turned = layout @ np.array([[c, s], [-s, c]])
    low, high = turned.min(axis=0), turned.max(axis=0)
    room = np.array(sketch.room) - sketch.sizes.max(axis=0)
    scale = np.maximum(room, 1) / np.maximum(high - low, 0.3)
    scale = np.minimum(scale, 2.2 * scale.min())
    return _clipped(sketch, (turned - (low + high) / 2) * scale + np.array(sketch.room) / 2)


def _filled(sketch: Sketch, layout: np.ndarray) -> np.ndarray:
    """Stretch a layout to the room, neither way much more than the other."""
    low, high = (layout - sketch.sizes / 2).min(axis=0), (layout + sketch.sizes / 2).max(axis=0)
    scale = np.array(sketch.room) / (high - low)
    scale = np.minimum(scale, 1.25 * scale.min())
    return _clipped(sketch, (layout - (low + high) / 2) * scale + np.array(sketch.room) / 2)


def _clipped(sketch: Sketch, layout: np.ndarray) -> np.ndarray:
    low = sketch.sizes / 2
    kept: np.ndarray = np.clip(layout, low, np.maximum(np.array(sketch.room) - low, low))
    return kept


def _improve(sketch: Sketch, layout: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Move one vertex at a time, ever less far, and keep what reads better."""
    cost = _cost(sketch, layout)
    for reach in np.geomspace(0.35, 0.02, _MOVES):
        moved = layout.copy()
        one, other = rng.integers(sketch.count, size=2)
        if rng.random() < _SWAPS:
            moved[[one, other]] = moved[[other, one]]
        else:
            moved[one] += rng.normal(size=2) * reach * np.array(sketch.room)
        moved = _clipped(sketch, moved)
        new = _cost(sketch, moved)
        if new < cost:
            layout, cost = moved, new
    return layout, cost


def _tangle(sketch: Sketch, layout: np.ndarray) -> float:
    """Count what no stretching mends: crossings, vertices inside a polygon they are no corner of, dents."""
    rings = [ring(layout, group) for group in sketch.groups]
    strays = sum(
        _STRAY * _intruders(layout, corners, others) + _dents(layout, corners)
        for corners, others in zip(rings, sketch.foreign, strict=True)
    )
    return _crossings(layout, _segments(sketch, rings)) + strays


def _cost(sketch: Sketch, layout: np.ndarray) -> float:
    """Weigh a layout in the room: tangle, what is too close or at too sharp an angle, uneven lengths and shapes."""
    rings = [ring(layout, group) for group in sketch.groups]
    segments = _segments(sketch, rings)
    edges = segments[: len(sketch.edges)]
    pairs = _pairs(sketch.count)
    spans = np.abs(layout[:, None] - layout[None])
    apart = spans - sketch.reach
    close = np.maximum(_GAP - apart.max(axis=2)[pairs], 0) / _GAP
    free = np.linalg.norm(np.maximum(apart[edges[:, 0], edges[:, 1]], 0), axis=1)
    short = np.maximum(_ROOM - free, 0) / _ROOM
    stress = (np.linalg.norm(spans, axis=2)[pairs] / sketch.ideal - 1) ** 2
    return float(
        10 * _tangle(sketch, layout)
        + 8 * (close**2).sum()
        + 4 * (short**2).sum()
        + 5 * _hidden(sketch, layout, segments)
        + 5 * _sharp(layout, segments)
        + 4 * sum(_squeezed(layout[corners]) for corners in rings)
        + 2 * stress.mean()
    )


def _segments(sketch: Sketch, rings: list[list[int]]) -> np.ndarray:
    """Return the edges and, after them, the sides of the polygons, (m, 2)."""
    sides = [(corners[k - 1], corners[k]) for corners in rings for k in range(len(corners))]
    segments: np.ndarray = np.array([*sketch.edges, *sides], dtype=int).reshape(-1, 2)
    return segments


def _crossings(layout: np.ndarray, segments: np.ndarray) -> float:
    start, end = layout[segments[:, 0]], layout[segments[:, 1]]
    along = end - start

    def side(point: np.ndarray) -> np.ndarray:
        """On which side of each segment (i) each point (j) lies."""
        cross: np.ndarray = along[:, [0]] * (point[:, 1] - start[:, [1]]) - along[:, [1]] * (
            point[:, 0] - start[:, [0]]
        )
        return cross

    apart = side(start) * side(end) < -1e-9  # noqa: PLR2004
    shared = (segments[:, None, :, None] == segments[None, :, None, :]).any(axis=(2, 3))
    return float(np.count_nonzero(apart & apart.T & ~shared)) / 2


def _intruders(layout: np.ndarray, corners: list[int], others: np.ndarray) -> float:
    return float(np.count_nonzero(inside(layout[others], layout[corners])))


def _dents(layout: np.ndarray, corners: list[int]) -> float:
    """Sum over the corners where a polygon turns inwards or hardly turns."""
    polygon = layout[corners]
    after = _following(polygon) - polygon
    before = np.concatenate([after[-1:], after[:-1]])
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    length = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return float(np.maximum(0.3 - turn / np.maximum(length, 1e-9), 0).sum())


def _squeezed(polygon: np.ndarray) -> float:
    """How far a polygon is from the regular one: 0 for that, 1 for a line."""
    following = _following(polygon)
    area = abs((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum()) / 2
    length = np.linalg.norm(following - polygon, axis=1).sum()
    regular = 1 / (4 * len(polygon) * np.tan(np.pi / len(polygon)))
    return float(1 - area / (regular * max(length, 1e-9) ** 2))


def _hidden(sketch: Sketch, layout: np.ndarray, segments: np.ndarray) -> float:
    """How much of the segments runs behind, or right beside, boxes they do not end at."""
    start, end = layout[segments[:, 0], None], layout[segments[:, 1], None]
    along = start + (end - start) * _SAMPLES[:, None]
    off = np.abs(along[:, :, None] - layout) - sketch.sizes / 2
    near = np.clip((_BESIDE - off.max(axis=3)) / _BESIDE, 0, 1.5)
    for end_number in range(2):
        near[np.arange(len(segments)), :, segments[:, end_number]] = 0
    return float(near.sum()) / 2


def _sharp(layout: np.ndarray, segments: np.ndarray) -> float:
    """Sum over the pairs of segments that leave a vertex at a small angle."""
    at = np.concatenate([segments[:, 0], segments[:, 1]])
    along = layout[segments[:, 1]] - layout[segments[:, 0]]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    along = np.concatenate([along, -along])
    pairs = _pairs(len(at))
    cosine = (along @ along.T)[pairs]
    together = (at[:, None] == at[None])[pairs]
    return float(((np.maximum(cosine - _SHARP, 0) / (1 - _SHARP)) ** 2 * together).sum())


@lru_cache(maxsize=16)
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Every two of `count` things, once."""
    first, second = np.triu_indices(count, 1)
    return first, second
