"""Frequency distances between orders, and which of them leak into one another."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.state_space import Flags, Floats, HarmonicModel, Indices

Gain = Callable[[Bandwidth, Floats], Floats]

# In cycles per sample: a sign change between two larger distances is the fold at half the rate, not a crossing.
NEAR = 0.25
# Segments of the record over which speeds are averaged when orders are compared; fewer for more orders than these.
SEGMENTS = 512
ORDERS_OF_ALL = 40


def distances(one: Floats, others: Floats) -> Floats:
    """Return (..., segment) distances in cycles per sample from an order to others or their images; 0 at crossings.

    From the frequencies of the order, (segment,) or (..., segment), and of the others, in the same unit. A crossing
    counts in the segments before and after it.
    """
    nearest = np.full(np.broadcast_shapes(one.shape, others.shape), 0.5)
    for apart in (others - one, others + one):
        folded = apart - np.rint(apart)
        size = np.abs(folded)
        np.minimum(nearest, size, out=nearest)
        crossed = (folded[..., :-1] * folded[..., 1:] < 0) & (np.maximum(size[..., :-1], size[..., 1:]) < NEAR)
        nearest[..., 1:][crossed] = 0.0
        nearest[..., :-1][crossed] = 0.0
    return nearest


@dataclass(frozen=True, eq=False)
class Closeness:
    """Frequency distances of every order from the others and from its own image, segment by segment.

    An order of a real record has an image at minus its frequency, and both repeat at every multiple of the rate; the
    distance is that to the nearest of these.

    Attributes
    ----------
    model : of the orders.
    edges : (segment + 1,) array, first samples of the segments and the end of the last one.
    frequency : (order, segment) array, cycles per sample.
    bandwidth : (order, segment) array, cycles per sample.
    """

    model: HarmonicModel
    edges: Indices
    frequency: Floats
    bandwidth: Floats

    @classmethod
    def of(cls, model: HarmonicModel) -> "Closeness":
        """Return the distances in a record whose phases the model has."""
        samples = model.phases[0].size
        most = max(SEGMENTS * ORDERS_OF_ALL // max(model.orders.size, ORDERS_OF_ALL), 1)
        segments = max(min(most, samples - 1), 1)
        edges = np.arange(segments + 1) * max(samples - 1, 1) // segments
        middle = (edges[:-1] + edges[1:]) // 2
        width = model.bandwidth if model.bandwidth.shape[1] == 1 else model.bandwidth[:, middle]
        frequency = np.diff(model.turns(np.minimum(edges, samples - 1))) / np.diff(edges)
        return cls(model, edges, frequency, np.broadcast_to(width, frequency.shape))

    def within(self, samples: slice) -> "Closeness":
        """Return the same for the segments that a range of samples touches."""
        first, last = (np.searchsorted(self.edges[:-1], [samples.start, samples.stop - 1], side="right") - 1).tolist()
        own = slice(first, last + 1)
        return Closeness(self.model, self.edges[first : last + 2], self.frequency[:, own], self.bandwidth[:, own])

    @cached_property
    def nearest(self) -> Floats:
        """(order, order) array, least distances to the others, and on the diagonal to the order's own image."""
        twice = 2 * self.frequency
        at_image = np.abs(twice - np.rint(twice)).min(axis=1)
        distance = np.diag(np.where(self.model.orders == 0, np.inf, at_image))
        for k in range(1, len(distance)):
            distance[k, :k] = distance[:k, k] = distances(self.frequency[k], self.frequency[:k]).min(axis=1)
        return distance

    def received(self, gain: Gain, amplitude: Floats, *, least: float = 0.0) -> Floats:
        """Return (order, order) leakage: the amplitude of another order, or of its own image, in an order's estimate.

        From the (order,) amplitudes, and the gain of the estimator of a bandwidth, of at least `least`, at distances in
        cycles per sample.
        """
        received = np.empty((len(self.frequency), len(self.frequency)))
        widths, group = np.unique(self.bandwidth.max(axis=1), return_inverse=True)
        for number, width in enumerate(widths.tolist()):
            rows = np.flatnonzero(group.ravel() == number)
            band = Bandwidth(width=min(max(width, least), 1.0), poles=self.model.poles)
            received[rows] = gain(band, np.minimum(self.nearest[rows], 0.5))
        received *= amplitude
        mean = np.flatnonzero(self.model.orders == 0)
        received[mean, mean] = 0.0
        return received

    @cached_property
    def ripple(self) -> float:
        """Error of steady-state gains, as a part of the exact filter's error.

        Other orders, and an order's own image, modulate its gain, each by the causal filter's gain at its least
        distance in the record and at a beat frequency of its own: their squares add up. With more poles the closed loop
        is closer to instability. Measured with random walks of 2 to 20 equidistant orders, the estimates differed by
        0.4 to 0.75 of this; from 1 on they may grow without bound.
        """
        ones = np.ones(self.model.orders.size)
        received = self.received(lambda band, distance: np.abs(band.filter_gain(distance)), ones)
        return sqrt(self.model.poles + 1) * float(np.linalg.norm(received, axis=1).max())

    def dwell(self) -> bool:
        """Return whether two orders stay within half a bandwidth of each other for 1 / bandwidth or longer."""
        for k in range(1, len(self.frequency)):
            near = np.flatnonzero(self.nearest[k, :k] < self.bandwidth.max() / 2)
            if near.size:
                width = np.maximum(self.bandwidth[k], self.bandwidth[near])
                close = distances(self.frequency[k], self.frequency[near]) < width / 2
                duration = np.cumsum(np.where(close, width * np.diff(self.edges), 0.0), axis=1)
                since = duration - np.maximum.accumulate(np.where(close, 0.0, duration), axis=1)
                if np.any(since >= 1):
                    return True
        return False


def leaks(received: Floats, amplitude: Floats) -> Floats:
    """Return (order, order) leakage relative to each order's own amplitude, (order,)."""
    own = amplitude[:, None]
    return np.divide(received, own, out=np.where(received > 0, np.inf, 0.0), where=own > 0)


def coupled(received: Floats, amplitude: Floats, tolerance: float) -> list[Indices]:
    """Return the groups of orders with a relative leakage above `tolerance`, single ones for their image."""
    disturbed = leaks(received, amplitude) > tolerance
    return components(disturbed | disturbed.T)


def left_over(received: Floats, amplitude: Floats, groups: list[Indices]) -> float:
    """Return the largest leakage from outside an order's group, relative to the largest amplitude.

    Parameters as for `leaks`. It counts twice, since an order's image may be hardly farther off.
    """
    part = received.copy()
    for group in groups:
        part[np.ix_(group, group)] = 0.0
    largest = float(amplitude.max())
    return 2 * float(part.sum(axis=1).max()) / largest if largest > 0 else 0.0


def components(linked: Flags) -> list[Indices]:
    """Return the connected components of a graph, as index arrays; isolated nodes only with a link to themselves."""
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415 - slow to import

    count, label = connected_components(linked, directed=False)
    groups = (np.flatnonzero(label == number) for number in range(count))
    return [group for group in groups if linked[group].any()]
