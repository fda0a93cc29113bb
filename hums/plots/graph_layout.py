"""Layout of a graph: stress minimisation from many random starts, then a local search for readability.

Edges join two vertices; a group of three or more is drawn as a polygon. Lengths are those of the drawing.
The stress is that of Kamada and Kawai (1989), minimised by majorization (Gansner, Koren and North 2004); the
random starts have a fixed seed, so that the layout is the same in every run.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

_STARTS, _KEPT, _TURNS = 60, 4, 12
_MAJORIZATIONS, _MOVES, _SWAPS = 60, 700, 0.15
_SAMPLES = np.linspace(0, 1, 13)
_CLEARANCE = 8.0  # distance from a box below which an edge seems to end there
_FOREIGN_VERTEX = 3.0  # cost, in crossings, of a vertex inside a polygon of which it is no corner
_SHARP = 0.9  # cosine of the angle between edges above which it has a cost
_GAP, _EDGE_LENGTH = (
    16.0,
    58.0,
)  # least distance of boxes; least visible length of an edge, for two numbers


@dataclass(frozen=True, kw_only=True)
class LayoutProblem:
    """A graph to lay out: sizes of its vertices' boxes (n, 2), edges, groups, and the size of the drawing area."""

    sizes: np.ndarray
    edges: tuple[tuple[int, int], ...]
    groups: tuple[tuple[int, ...], ...]
    area: tuple[float, float]

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.sizes)

    @property
    def unit(self) -> float:
        """Edge length at which the vertices fill the area."""
        return float(0.85 * np.sqrt(np.prod(self.area) / self.count))

    @cached_property
    def touching(self) -> np.ndarray:
        """Distances between the centres of two boxes that touch, (n, n, 2)."""
        together: np.ndarray = (self.sizes[:, None] + self.sizes[None]) / 2
        return together

    @cached_property
    def ideal(self) -> np.ndarray:
        """Ideal distance of every pair of vertices in the drawing."""
        lengths: np.ndarray = self.distances[_pairs(self.count)] * self.unit
        return lengths

    @cached_property
    def foreign(self) -> tuple[np.ndarray, ...]:
        """Vertices outside each group."""
        return tuple(np.setdiff1d(np.arange(self.count), group) for group in self.groups)

    @cached_property
    def distances(self) -> np.ndarray:
        """Ideal distances between vertices, followed by the centres of the groups, in edge lengths."""
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


def place(problem: LayoutProblem) -> np.ndarray:
    """Return the positions of the vertices, (n, 2), inside the area."""
    if problem.count == 1:
        return np.array([problem.area]) / 2
    rng = np.random.default_rng(2012)
    layouts = _stress_layouts(problem, rng)
    topology_cost = [_topology_cost(problem, layout) for layout in layouts]
    best, cost = layouts[0], np.inf
    for start in np.argsort(topology_cost, kind="stable")[:_KEPT]:
        turned = [_rotated_to_fit(problem, layouts[start], angle) for angle in np.arange(_TURNS) * 2 * np.pi / _TURNS]
        costs = [_cost(problem, layout) for layout in turned]
        layout, reached = _improve(problem, turned[int(np.argmin(costs))], rng)
        if reached < cost - 1e-9:
            best, cost = layout, reached
    return _stretched(problem, best)


def ring(positions: np.ndarray, group: tuple[int, ...]) -> list[int]:
    """Return the vertices of a group in the order of their angle about its centroid: the corners of its polygon."""
    from_middle = positions[list(group)] - positions[list(group)].mean(axis=0)
    return [group[k] for k in np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0]), kind="stable")]


def inside(where: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) lie inside a polygon (m, 2), by the even-odd rule."""
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


def _stress_layouts(problem: LayoutProblem, rng: np.random.Generator) -> np.ndarray:
    """Minimise sum (|x_i - x_j| / d_ij - 1)^2 from random starts; (starts, n, 2), group centres dropped."""
    ideal = problem.distances
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
    layouts: np.ndarray = x[:, : problem.count]
    return layouts


def _rotated_to_fit(problem: LayoutProblem, layout: np.ndarray, angle: float) -> np.ndarray:
    """Return a layout rotated by `angle` and scaled to the area; the two scales differ by at most 2.2."""
    c, s = np.cos(angle), np.sin(angle)
    turned = layout @ np.array([[c, s], [-s, c]])
    low, high = turned.min(axis=0), turned.max(axis=0)
    area = np.array(problem.area) - problem.sizes.max(axis=0)
    scale = np.maximum(area, 1) / np.maximum(high - low, 0.3)
    scale = np.minimum(scale, 2.2 * scale.min())
    return _clipped(problem, (turned - (low + high) / 2) * scale + np.array(problem.area) / 2)


def _stretched(problem: LayoutProblem, layout: np.ndarray) -> np.ndarray:
    """Return a layout scaled to the area; the two scales differ by at most 1.25."""
    low, high = (layout - problem.sizes / 2).min(axis=0), (layout + problem.sizes / 2).max(axis=0)
    scale = np.array(problem.area) / (high - low)
    scale = np.minimum(scale, 1.25 * scale.min())
    return _clipped(problem, (layout - (low + high) / 2) * scale + np.array(problem.area) / 2)


def _clipped(problem: LayoutProblem, layout: np.ndarray) -> np.ndarray:
    low = problem.sizes / 2
    kept: np.ndarray = np.clip(layout, low, np.maximum(np.array(problem.area) - low, low))
    return kept


def _improve(problem: LayoutProblem, layout: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return a layout of lower cost and its cost, by random moves of one vertex with decreasing step length."""
    cost = _cost(problem, layout)
    for step in np.geomspace(0.35, 0.02, _MOVES):
        moved = layout.copy()
        one, other = rng.integers(problem.count, size=2)
        if rng.random() < _SWAPS:
            moved[[one, other]] = moved[[other, one]]
        else:
            moved[one] += rng.normal(size=2) * step * np.array(problem.area)
        moved = _clipped(problem, moved)
        new = _cost(problem, moved)
        if new < cost:
            layout, cost = moved, new
    return layout, cost


def _topology_cost(problem: LayoutProblem, layout: np.ndarray) -> float:
    """Return the cost that scaling cannot change: crossings, vertices inside foreign polygons, concave corners."""
    rings = [ring(layout, group) for group in problem.groups]
    strays = sum(
        _FOREIGN_VERTEX * _foreign_vertices(layout, corners, others) + _concavity(layout, corners)
        for corners, others in zip(rings, problem.foreign, strict=True)
    )
    return _crossings(layout, _segments(problem, rings)) + strays


def _cost(problem: LayoutProblem, layout: np.ndarray) -> float:
    """Return the cost of a layout: topology, small distances and angles, hidden edges, irregular polygons, stress."""
    rings = [ring(layout, group) for group in problem.groups]
    segments = _segments(problem, rings)
    edges = segments[: len(problem.edges)]
    pairs = _pairs(problem.count)
    spans = np.abs(layout[:, None] - layout[None])
    apart = spans - problem.touching
    close = np.maximum(_GAP - apart.max(axis=2)[pairs], 0) / _GAP
    free = np.linalg.norm(np.maximum(apart[edges[:, 0], edges[:, 1]], 0), axis=1)
    short = np.maximum(_EDGE_LENGTH - free, 0) / _EDGE_LENGTH
    stress = (np.linalg.norm(spans, axis=2)[pairs] / problem.ideal - 1) ** 2
    return float(
        10 * _topology_cost(problem, layout)
        + 8 * (close**2).sum()
        + 4 * (short**2).sum()
        + 5 * _hidden_edges(problem, layout, segments)
        + 5 * _sharp_angles(layout, segments)
        + 4 * sum(_irregularity(layout[corners]) for corners in rings)
        + 2 * stress.mean()
    )


def _segments(problem: LayoutProblem, rings: list[list[int]]) -> np.ndarray:
    """Return the edges and, after them, the sides of the polygons, (m, 2)."""
    sides = [(corners[k - 1], corners[k]) for corners in rings for k in range(len(corners))]
    segments: np.ndarray = np.array([*problem.edges, *sides], dtype=int).reshape(-1, 2)
    return segments


def _crossings(layout: np.ndarray, segments: np.ndarray) -> float:
    """Return the number of crossings of segments without a common vertex."""
    start, end = layout[segments[:, 0]], layout[segments[:, 1]]
    along = end - start

    def side(point: np.ndarray) -> np.ndarray:
        """Return a signed number for the side of each segment (i) on which each point (j) lies."""
        cross: np.ndarray = along[:, [0]] * (point[:, 1] - start[:, [1]]) - along[:, [1]] * (
            point[:, 0] - start[:, [0]]
        )
        return cross

    apart = side(start) * side(end) < -1e-9  # noqa: PLR2004
    shared = (segments[:, None, :, None] == segments[None, :, None, :]).any(axis=(2, 3))
    return float(np.count_nonzero(apart & apart.T & ~shared)) / 2


def _foreign_vertices(layout: np.ndarray, corners: list[int], others: np.ndarray) -> float:
    return float(np.count_nonzero(inside(layout[others], layout[corners])))


def _concavity(layout: np.ndarray, corners: list[int]) -> float:
    """Return the sum over the corners at which a polygon is concave or nearly straight."""
    polygon = layout[corners]
    after = _following(polygon) - polygon
    before = np.concatenate([after[-1:], after[:-1]])
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    length = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return float(np.maximum(0.3 - turn / np.maximum(length, 1e-9), 0).sum())


def _irregularity(polygon: np.ndarray) -> float:
    """Return 1 minus the ratio of a polygon's area to that of the regular one with its perimeter."""
    following = _following(polygon)
    area = abs((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum()) / 2
    length = np.linalg.norm(following - polygon, axis=1).sum()
    regular = 1 / (4 * len(polygon) * np.tan(np.pi / len(polygon)))
    return float(1 - area / (regular * max(length, 1e-9) ** 2))


def _hidden_edges(problem: LayoutProblem, layout: np.ndarray, segments: np.ndarray) -> float:
    """Return the cost of segments that run behind or close to boxes at which they do not end."""
    start, end = layout[segments[:, 0], None], layout[segments[:, 1], None]
    along = start + (end - start) * _SAMPLES[:, None]
    off = np.abs(along[:, :, None] - layout) - problem.sizes / 2
    near = np.clip((_CLEARANCE - off.max(axis=3)) / _CLEARANCE, 0, 1.5)
    for end_number in range(2):
        near[np.arange(len(segments)), :, segments[:, end_number]] = 0
    return float(near.sum()) / 2


def _sharp_angles(layout: np.ndarray, segments: np.ndarray) -> float:
    """Return the cost of pairs of segments that leave a vertex at a small angle."""
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
    """Return the indices of every pair of `count` items."""
    first, second = np.triu_indices(count, 1)
    return first, second
