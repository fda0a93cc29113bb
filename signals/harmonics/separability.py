"""Frequency distances between orders, and the flags of outputs near others, gaps or the ends of the record."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signals.harmonics.bandwidth import Bandwidth
from signals.harmonics.state_space import Estimator, Flags, Floats, HarmonicModel, Indices
from signals.harmonics.tracking_results import OutputFlag

Gain = Callable[[Bandwidth, Floats], Floats]
FlagArray = NDArray[np.uint8]

_NEAR_END, _NEAR_GAP = np.uint8(OutputFlag.NEAR_END), np.uint8(OutputFlag.NEAR_GAP)
_NOT_SEPARABLE, _ONE_QUADRATURE = np.uint8(OutputFlag.NOT_SEPARABLE), np.uint8(OutputFlag.ONE_QUADRATURE)

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
        return cls.between(model, edges, model.phase(np.minimum(edges, samples - 1)), width)

    @classmethod
    def between(cls, model: HarmonicModel, edges: Indices, angle: Floats, width: Floats) -> "Closeness":
        """Return those between edges with these (shaft, edge) angles, given (order, segment or 1) bandwidths."""
        frequency = model.orders[:, None] * (np.diff(angle) / (2 * np.pi * np.diff(edges)))[model.shaft]
        return cls(model, edges, frequency, np.broadcast_to(width, frequency.shape))

    def within(self, samples: slice) -> "Closeness":
        """Return the same for the segments that a range of samples touches."""
        first, last = (np.searchsorted(self.edges[:-1], [samples.start, samples.stop - 1], side="right") - 1).tolist()
        own = slice(first, last + 1)
        return Closeness(self.model, self.edges[first : last + 2], self.frequency[:, own], self.bandwidth[:, own])

    @property
    def lengths(self) -> Floats:
        """(segment,) array, samples in each."""
        return (self.edges[1:] - self.edges[:-1]).astype(np.float64)

    @cached_property
    def nearest(self) -> Floats:
        """(order, order) array, least distances to the others, and on the diagonal to the order's own image."""
        distance = np.diag(distances_to_images(self.model.orders, self.frequency).min(axis=1))
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

    def dwell(self) -> bool:
        """Return whether two orders stay within half a bandwidth of each other for 1 / bandwidth or longer."""
        for k in range(1, len(self.frequency)):
            near = np.flatnonzero(self.nearest[k, :k] < self.bandwidth.max() / 2)
            if near.size:
                width = np.maximum(self.bandwidth[k], self.bandwidth[near])
                close = distances(self.frequency[k], self.frequency[near]) < width / 2
                duration = np.cumsum(np.where(close, width * self.lengths, 0.0), axis=1)
                since = duration - np.maximum.accumulate(np.where(close, 0.0, duration), axis=1)
                if np.any(since >= 1):
                    return True
        return False

    def flag(self, turns: Floats) -> FlagArray:
        """Return (order, segment) flags: NOT_SEPARABLE, and ONE_QUADRATURE near the order's own image.

        Orders are not separable within half a bandwidth of one another, or until they are a turn apart: (order, order)
        turns of one relative to another, filled above the diagonal, are those of earlier segments, and grow by these.
        """
        close = np.zeros(self.frequency.shape, dtype=np.bool_)
        samples, widest = self.lengths.sum(), self.bandwidth.max(axis=1)
        for k in range(len(close) - 1):
            reach = np.maximum(np.maximum(widest[k], widest[k + 1 :]) / 2, 1 / samples)
            is_near = self.nearest[k, k + 1 :] < reach
            near, far = k + 1 + np.flatnonzero(is_near), k + 1 + np.flatnonzero(~is_near)
            turns[k, far] += 1
            if near.size:
                distance = distances(self.frequency[k], self.frequency[near])
                turns[k, near] += distance @ self.lengths
                near_each = distance < np.maximum(self.bandwidth[k], self.bandwidth[near]) / 2
                near_each |= (turns[k, near] < 1)[:, None]
                close[k] |= near_each.any(axis=0)
                close[near] |= near_each
        at_image = distances_to_images(self.model.orders, self.frequency) < self.bandwidth / 2
        return np.asarray(_NOT_SEPARABLE * close | _ONE_QUADRATURE * at_image)


def distances_to_images(orders: Floats, frequency: Floats) -> Floats:
    """Return (order, segment) distances from the order's own image, in cycles per sample; infinite for the mean."""
    twice = 2 * frequency
    distance = np.abs(twice - np.rint(twice))
    distance[orders == 0] = np.inf
    return np.asarray(distance)


def flag_outputs(closeness: Closeness, seen: Flags, *, every: int, estimator: Estimator) -> FlagArray:
    """Return (order, output) flags of a record's outputs.

    `seen`, (sample,), is true where samples are observed; outputs are `every` samples apart. A "filter" uses no later
    samples.
    """
    samples = seen.size
    outputs = np.arange(0, samples, every)
    orders = len(closeness.frequency)
    flags = closeness.flag(np.zeros((orders, orders)))
    found = np.zeros((orders, outputs.size), dtype=np.uint8)
    places = np.searchsorted(outputs, np.append(closeness.edges[:-1], samples))
    for segment in np.flatnonzero(flags.any(axis=0)):
        found[:, places[segment] : places[segment + 1]] = flags[:, segment, None]
    bandwidth = closeness.model.bandwidth
    reach = output_range(np.maximum(bandwidth if bandwidth.shape[1] == 1 else bandwidth[:, ::every], 0.5 / samples))
    first = int(seen.argmax()) if seen.any() else samples
    flag_gaps(found, outputs, reach, seen, first=first, later=estimator == "smoother")
    return found


def output_range(bandwidth: Floats) -> Floats:
    """Return half of 1 / bandwidth in samples, at least one: the range of samples that determine an output."""
    return np.asarray(np.maximum(0.5 / bandwidth, 1.0))


def flag_gaps(flags: FlagArray, outputs: Indices, reach: Floats, seen: Flags, *, first: float, later: bool) -> None:
    """Add NEAR_END and NEAR_GAP to (order, output) flags.

    The (output,) outputs are ascending indices into `seen`, (sample,), which is true where observed; `first` is the
    index of the record's first observed sample, negative where it came before these. The reach, (order, 1 or output),
    is that of `output_range`; `later` says whether outputs use later samples too.
    """
    if not outputs.size:
        return
    last = np.inf if not later else seen.size - 1 - int(seen[::-1].argmax()) if seen.any() else -1
    bounds = np.minimum([first + reach[:, 0], last - reach[:, -1]], outputs[-1] + 1.0)
    # As integers: for floats all outputs would be converted.
    for row, (start, stop) in zip(flags, np.searchsorted(outputs, np.ceil(bounds).astype(np.int64)).T, strict=True):
        row[:start] |= _NEAR_END
        row[stop:] |= _NEAR_END
    if seen.all():
        return
    before = np.concatenate([[0], np.cumsum(seen)])
    for k, half in enumerate(reach):
        span = half.astype(np.int64)
        begin, end = np.maximum(outputs - span, 0), np.minimum(outputs + (span if later else 0) + 1, seen.size)
        flags[k] |= _NEAR_GAP * (before[end] - before[begin] <= 0.75 * (end - begin))


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
    reached = (linked | np.eye(len(linked), dtype=np.bool_)).astype(np.float64)
    for _ in range(len(linked).bit_length()):  # each time over paths of twice as many links
        reached = (reached @ reached > 0).astype(np.float64)
    first = reached.argmax(axis=1)
    groups = (np.flatnonzero(first == number) for number in np.unique(first))
    return [group for group in groups if linked[group].any()]
