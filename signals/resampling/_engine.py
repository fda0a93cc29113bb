"""Streaming resampling between two uniform grids related by an increasing function.

The function is q(n), the position of sample n in steps of the output grid. Its slope a(n) = dq/dn is also the ratio of
the output rate to the input rate. With g the windowed sinc below,

    where a >= 1    y[m] = sum_n x[n] g(n(m) - n),       n(m) the inverse of q: cut-off at half the input rate
    where a < 1     y[m] = sum_n a(n) x[n] g(m - q(n)),                         cut-off at half the output rate

The second sum is the integral of the record times a filter fixed on the output grid, however unevenly the samples lie
on it; for a = 1 the two sums agree. It is computed from moments: the filter is a polynomial on each step of the output
grid, so that only the moments of the samples in that step are needed. Each sample is read once, however many lie in a
step, and a long record need not be held in memory.

Beyond its ends the record is taken as zero, and each output is divided by the sum of the weights on the record. The
first sample is subtracted beforehand and added afterwards, so that a large mean costs no accuracy.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from signals._validation import Array, Samples

# ---- The interpolation filter of angular resampling: a Kaiser-windowed sinc ------------------------------------------
# Its argument is in zero crossings, that is in steps of the coarser of the two grids. With 32 of them on either side
# and beta = 12 its response is within 1.4e-6 of one up to 0.88 of half the coarser rate, one half at half the rate, and
# below -116 dB from 1.12 of it upwards, including the error of the tables below, 4e-7.


HALF_WIDTH = 32  # zero crossings on either side
ROWS = 64  # fractions of a step; cubics through four of them are within 3 / 128 (pi / 64)^4 = 1.4e-7 of the largest
MOMENTS = 8  # of the samples in a step: polynomials of degree 7 follow the filter to 4e-7 of its largest value


def windowed_sinc(u: Array) -> Array:
    """Return the filter at `u` zero crossings from its centre, any shape; zero beyond `HALF_WIDTH`."""
    inside = np.clip(1 - (u / HALF_WIDTH) ** 2, 0, None)
    kaiser_beta = 12.0
    taper = np.i0(kaiser_beta * np.sqrt(inside)) / np.i0(kaiser_beta)
    return np.where(np.abs(u) < HALF_WIDTH, np.sinc(u) * taper, 0.0)


@lru_cache(maxsize=1)
def weight_rows() -> Array:
    """Return the weights of the samples from ``HALF_WIDTH - 1`` before to `HALF_WIDTH` after a position.

    An array (ROWS + 3, 2 HALF_WIDTH); row r is for a position (r - 1) / ROWS of a step after a sample. Each row sums to
    one, so that constants are preserved.
    """
    fraction = np.arange(-1, ROWS + 2)[:, None] / ROWS
    weights = windowed_sinc(fraction - np.arange(1 - HALF_WIDTH, HALF_WIDTH + 1))
    return _aligned(weights / weights.sum(axis=1, keepdims=True))


def _aligned(a: Array) -> Array:
    """Return a copy that begins at a cache line, so that its rows straddle as few lines as possible."""
    cache_line = 64  # bytes
    buffer = np.empty(a.size + cache_line // 8)
    first = -buffer.ctypes.data % cache_line // 8
    aligned = buffer[first : first + a.size].reshape(a.shape)
    aligned[:] = a
    return aligned


@lru_cache(maxsize=1)
def step_polynomials() -> Array:
    """Return the filter as one polynomial per step, (2 HALF_WIDTH, MOMENTS) coefficients of rising powers of v.

    A sample at v = -1 .. 1 across a step, with the output a whole number d of steps after the start of that step, has
    the weight ``windowed_sinc(d - (1 + v) / 2)``. Row i is for ``d = HALF_WIDTH - i``. Fitted at Chebyshev points.
    """
    v = chebyshev.chebpts1(4 * MOMENTS)
    d = np.arange(HALF_WIDTH, -HALF_WIDTH, -1)
    series = chebyshev.chebfit(v, windowed_sinc(d - (1 + v[:, None]) / 2), MOMENTS - 1)
    return _aligned(np.array([chebyshev.cheb2poly(column) for column in series.T]))


@lru_cache(maxsize=1)
def _integral() -> tuple[Array, Array]:
    """Return positions in zero crossings, and the integral of the filter up to each."""
    fine = 64
    u = np.arange(-HALF_WIDTH * fine, HALF_WIDTH * fine + 1) / fine
    middles = windowed_sinc((u[1:] + u[:-1]) / 2)
    ends = windowed_sinc(u)
    pieces = (ends[1:] + 4 * middles + ends[:-1]) / (6 * fine)  # Simpson's rule
    total = np.concatenate([[0.0], np.cumsum(pieces)])
    return u, total / total[-1]


def step_response(u: Array) -> Array:
    """Return the integral of the filter from minus infinity to `u`: from 0 to 1, and 1/2 at 0."""
    places, total = _integral()
    return np.asarray(np.interp(u, places, total))


# ---- Evaluation of an increasing function on an even grid: cubic Hermite between exact nodes, with an error bound ----


NODE_STEP = 64  # points between exact values

Curve = Callable[[Array], Array]


@dataclass(frozen=True, kw_only=True)
class Track:
    """``(value - offset) * scale`` on an even grid of the argument, and its slope per point.

    Between nodes, `NODE_STEP` points apart, it is a Hermite cubic where that is within 1e-8 of the function at one and
    at two thirds of the interval; elsewhere the function is evaluated at every point. Beyond `start` and `stop` the
    function is continued by point reflection about its ends.

    Attributes
    ----------
    value, slope
        The function and its derivative, of an array of arguments from `start` to `stop`.
    origin, spacing
        The argument of point 0 and the step from one point to the next.
    """

    value: Curve
    slope: Curve
    start: float
    stop: float
    origin: float
    spacing: float
    offset: float
    scale: float
    _known: dict[str, tuple[int, Array, Array, NDArray[np.int64]]] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )

    def at(self, first: int, last: int) -> tuple[Array, Array]:
        """Return value and slope at the points from `first` up to, but not including, `last`."""
        from signals.resampling._engine_kernels import hermite  # noqa: PLC0415

        begin, end = first // NODE_STEP, (last - 1) // NODE_STEP + 1
        cell, values, slopes, inexact = self._cells(begin, end)
        skip = first - begin * NODE_STEP
        out, out_slopes = np.empty(last - first), np.empty(last - first)
        there = slice(begin - cell, end - cell + 1)
        hermite(values[there], slopes[there], NODE_STEP, skip, out, out_slopes)
        inexact = inexact[(inexact >= begin) & (inexact < end)]
        if inexact.size:
            points = ((inexact[:, None] - begin) * NODE_STEP - skip + np.arange(NODE_STEP)).ravel()
            points = points[(points >= 0) & (points < out.size)]
            at = (first + points).astype(np.float64)
            out[points], out_slopes[points] = self._values(at), self._slopes(at)
        return out, out_slopes

    def _cells(self, begin: int, end: int) -> tuple[int, Array, Array, NDArray[np.int64]]:
        """Return the first of a run of cells, value and slope at their nodes, and which of them are inexact.

        The run covers `begin` to `end`, and more of the following cells the longer the track has become, since calls of
        the function cost more than values.
        """
        known = self._known.get("last")
        if known is None or not known[0] <= begin < end < known[0] + known[1].size:
            # 1024 cells evaluated at once at most
            nodes = NODE_STEP * np.arange(begin, max(end, min(begin, 1024) + begin) + 1, dtype=np.float64)
            values, slopes = self._values(nodes), self._slopes(nodes)
            known = begin, values, slopes, begin + self._inexact_cells(nodes, values, slopes)
            self._known["last"] = known
        return known

    def _inexact_cells(self, nodes: Array, values: Array, slopes: Array) -> NDArray[np.int64]:
        """Return the cells in which the cubic exceeds the tolerance."""
        rise = np.diff(values)
        early, late = NODE_STEP * slopes[:-1] - rise, rise - NODE_STEP * slopes[1:]
        inexact = np.zeros(rise.size, dtype=bool)
        tolerance = 1e-8  # of a step of the other grid: 3e-8 rad at the end of the band
        for u in (1 / 3, 2 / 3):
            cubic = values[:-1] + u * rise + u * (1 - u) * ((1 - u) * early + u * late)
            inexact |= ~(np.abs(cubic - self._values(nodes[:-1] + u * NODE_STEP)) <= tolerance)
        return np.flatnonzero(inexact)

    def _values(self, points: Array) -> Array:
        inside, passed = self._reflected(points)
        found = self.value(inside)
        if passed is not None:
            low, high = self.value(np.array([self.start, self.stop]))
            found = np.where(passed % 2 == 0, found, low + high - found) + passed * (high - low)
        return (found - self.offset) * self.scale

    def _slopes(self, points: Array) -> Array:
        return np.asarray(self.slope(self._reflected(points)[0]) * (self.scale * self.spacing))

    def _reflected(self, points: Array) -> tuple[Array, Array | None]:
        """Return the arguments reflected into start..stop, and the number of ends passed; None where none is."""
        argument = self.origin + self.spacing * points
        if argument[0] >= self.start and argument[-1] <= self.stop:
            return argument, None
        span = self.stop - self.start
        passed = np.floor((argument - self.start) / span)
        passed[(argument >= self.start) & (argument <= self.stop)] = 0
        shifted = argument - passed * span
        reflected = np.where(passed % 2 == 0, shifted, self.start + self.stop - shifted)
        return np.clip(reflected, self.start, self.stop), passed


# ---- Engine ----------------------------------------------------------------------------------------------------------


Method = Literal["sinc", "cubic", "linear"]
METHODS: tuple[Method, ...] = get_args(Method)
FEWEST = {"sinc": 2, "cubic": 4, "linear": 2}  # samples

_HALO = HALF_WIDTH + 1  # samples kept on either side of a chunk
_PADDING = 8  # steps that the kernel reads beyond the last output's

Flags = NDArray[np.bool_]
Outputs = tuple[Array, Flags]  # (row, n) values, and (n,) whether their filter reaches beyond the record or the map


@dataclass(frozen=True, kw_only=True)
class Map:
    """Positions of the samples of a record on the output grid.

    Attributes
    ----------
    outward
        q, the positions of the samples.
    inward
        Its inverse, the positions of the outputs among the samples, if known; otherwise computed from `outward`.
    outputs
        Largest number of outputs.
    least_slope, largest_slope
        Extremes of the slope of q.
    known
        Extremes of q between which the map is known rather than reflected.
    slack
        Tolerance on q, by which the last output may lie beyond the end of the record.
    """

    outward: Track
    outputs: int
    least_slope: float
    largest_slope: float
    known: tuple[float, float]
    slack: float
    inward: Track | None = None


class Warp:
    """Streaming resampler of one record, or of several with the same sample times: (row, n) arrays.

    If `folds` is false nothing in them would alias into the passband, and they are only interpolated. Chunks are
    counted from the first sample of the record, so that the block sizes do not affect the result.
    """

    def __init__(self, grid: Map, *, method: Method, rows: int = 1, folds: bool = True) -> None:
        self._grid, self._method, self._rows = grid, method, rows
        self._antialias = method == "sinc" and grid.least_slope < 1 and folds
        # 15 * 1024 samples processed at once, or outputs where those are more, of up to 8 rows; fewer for more rows,
        # so that their moments stay in the second-level cache
        at_once = (15 * 1024) / max(1.0, grid.largest_slope) / max(1.0, rows / 8)
        self._chunk = max(NODE_STEP, int(at_once) // NODE_STEP * NODE_STEP)
        self._level = np.full((rows, 1), np.nan)  # the first finite sample of each row, subtracted from all
        self._samples = np.zeros((rows, _HALO))  # from sample `_at - _HALO` on
        self._at = 0
        self._values = np.empty((rows, 0))  # queued outputs, from `_released` on
        self._slopes = np.empty(0)  # and their slopes a
        self._beyond: Flags = np.empty(0, dtype=bool)
        self._released = 0  # number of outputs returned so far
        self._moments = np.zeros((rows, 2 * HALF_WIDTH, MOMENTS))  # of the steps from `_released - HALF_WIDTH` on
        self._used = 0  # number of steps with moments; the others are zero
        self._ends = (-np.inf, np.inf)  # of the record on the output grid

    def push(self, x: Samples) -> Outputs:
        """Process the next samples; return the outputs they complete, and which of them reach beyond the start."""
        return self._joined(self._pushed(x))

    def finish(self) -> Outputs:
        """Return the remaining outputs, and which of them reach beyond an end of the record."""
        return self._advance(np.concatenate([self._samples, np.zeros((self._rows, _HALO))], axis=1), ended=True)

    def whole(self, x: Samples) -> Outputs:
        return self._joined([*self._pushed(x), self.finish()])

    def _pushed(self, x: Samples) -> list[Outputs]:
        for row, level in zip(x, self._level, strict=True):
            if np.isnan(level[0]) and row.size:
                level[0] = row[0] if np.isfinite(row[0]) else next(iter(row[np.isfinite(row)]), np.nan)
        parts, width = [], self._chunk + 2 * _HALO
        for begin in range(0, x.shape[1], self._chunk):
            self._samples = np.concatenate([self._samples, x[:, begin : begin + self._chunk]], axis=1)
            if self._samples.shape[1] >= width:
                parts.append(self._advance(self._samples[:, :width], ended=False))
                self._samples = self._samples[:, self._chunk :]
        return parts

    def _joined(self, parts: list[Outputs]) -> Outputs:
        if not parts:
            return np.empty((self._rows, 0)), np.empty(0, dtype=bool)
        return np.concatenate([values for values, _ in parts], axis=1), np.concatenate([beyond for _, beyond in parts])

    @property
    def samples_seen(self) -> int:
        """Number of samples pushed."""
        return self._at + self._samples.shape[1] - _HALO

    def _advance(self, samples: Array, *, ended: bool) -> Outputs:
        """Process one chunk, given with a halo on either side; return the outputs that are complete."""
        count = samples.shape[1] - 2 * _HALO
        samples = samples - np.nan_to_num(self._level)
        q, slopes = self._grid.outward.at(self._at - _HALO, self._at + count + _HALO)
        # filtered outputs need moments; where a = 1, q rises by one step per sample, so that the halo covers the filter
        moments = self._antialias and float(slopes.min()) < 1
        within = slice(_HALO, _HALO + count + (not ended))  # and the next sample, to interpolate towards
        q, slopes = q[within], slopes[within]
        if self._at == 0:
            samples[:, :_HALO] = 0
            self._ends = (float(q[0] - slopes[0] / 2), np.inf)
        if ended:
            samples[:, -_HALO:] = 0
            self._ends = (self._ends[0], float(q[-1] + slopes[-1] / 2))
        self._interpolate(samples, q, slopes, ended=ended)
        ready = self._slopes.size
        if moments:
            self._add_moments(samples[:, _HALO : _HALO + count], q, slopes)
        if self._antialias and not ended:
            ready = min(ready, int(np.floor(q[-1])) - HALF_WIDTH + 1 - self._released)
        self._at += count
        return self._release(max(ready, 0), ended=ended)

    def _interpolate(self, samples: Array, q: Array, slopes: Array, *, ended: bool) -> None:
        """Queue the outputs among these samples; those with a < 1 get their value in `_release`."""
        from signals.resampling import _engine_kernels as kernel  # noqa: PLC0415

        first = self._released + self._slopes.size
        stop = int(np.floor(q[-1] + self._grid.slack)) + 1 if ended else int(np.ceil(q[-1]))
        positions, slopes_out = self._positions(q, slopes, first, max(first, min(stop, self._grid.outputs)))
        positions += _HALO
        values, beyond = np.zeros((self._rows, positions.size)), np.zeros(positions.size, dtype=bool)
        size = samples.shape[1]
        least, most = max(_HALO - self._at, 0), size - 1 - (_HALO if ended else 0)
        if self._method == "sinc":
            kernel.interpolate(samples, positions, slopes_out, weight_rows(), values)
        else:
            for row, out in zip(samples, values, strict=True):
                (kernel.linear if self._method == "linear" else kernel.cubic)(row, positions, least, most, out)
        support = {"sinc": (HALF_WIDTH - 1, HALF_WIDTH), "cubic": (1, 2), "linear": (0, 1)}  # samples before and after
        if ended or self._at == 0:
            before, after = support[self._method]
            beyond = (np.floor(positions) - before < least) | (np.ceil(positions) + after - 1 > most)
            if self._method == "sinc" and beyond.any():
                on_record = ((np.arange(size) >= least) & (np.arange(size) <= most)).astype(np.float64)
                weight = np.empty((1, np.count_nonzero(beyond)))
                kernel.interpolate(on_record[None], positions[beyond], np.ones(weight.size), weight_rows(), weight)
                values[:, beyond] /= weight
        self._values = np.concatenate([self._values, values], axis=1)
        self._slopes = np.concatenate([self._slopes, slopes_out])
        self._beyond = np.concatenate([self._beyond, beyond])

    def _positions(self, q: Array, slopes: Array, first: int, stop: int) -> tuple[Array, Array]:
        """Return n(m) of the outputs from `first` to `stop`, relative to the chunk, and the slope a at each."""
        from signals.resampling._engine_kernels import invert  # noqa: PLC0415

        if self._grid.inward is None:
            positions, slopes_out = np.empty(stop - first), np.empty(stop - first)
            invert(q, slopes, float(first), positions, slopes_out)
        else:
            positions, inverse_slope = self._grid.inward.at(first, stop) if stop > first else (np.empty(0), np.empty(0))
            positions = np.clip(positions - self._at, 0, q.size - 1)
            with np.errstate(divide="ignore"):
                slopes_out = 1 / inverse_slope
        return positions, slopes_out if self._antialias else np.maximum(slopes_out, 1.0)

    def _add_moments(self, x: Array, q: Array, slopes: Array) -> None:
        """Add samples to the moments of the steps they lie in."""
        from signals.resampling._engine_kernels import add_moments  # noqa: PLC0415

        top = max(self._released + self._slopes.size, min(int(q[-1]), self._grid.outputs))
        self._used = max(self._used, top - self._released + 2 * HALF_WIDTH + _PADDING)
        self._reserve(self._used)
        first = self._released - HALF_WIDTH
        for row, moments in zip(x, self._moments, strict=True):
            add_moments(row, q[: row.size], slopes[: row.size], first, moments[: self._used])

    def _reserve(self, steps: int) -> None:
        """Lengthen the buffer of moments to at least `steps`."""
        missing = steps - self._moments.shape[1]
        if missing > 0:
            self._moments = np.concatenate([self._moments, np.zeros((self._rows, missing, MOMENTS))], axis=1)

    def _release(self, ready: int, *, ended: bool) -> Outputs:
        """Remove the first `ready` outputs from the queue and return them, filtered where a < 1."""
        values, beyond = self._values[:, :ready], self._beyond[:ready]
        if self._antialias and ready:
            if np.any(self._slopes[:ready] < 1):
                self._filter(values, self._slopes[:ready], beyond, ended=ended)
            kept = self._moments[:, ready : self._used].copy()
            self._moments[:, : self._used] = 0
            self._used = kept.shape[1]
            self._moments[:, : self._used] = kept
        self._values, self._slopes, self._beyond = self._values[:, ready:], self._slopes[ready:], self._beyond[ready:]
        self._released += ready
        values += np.nan_to_num(self._level)
        return values, beyond

    def _filter(self, values: Array, slopes_out: Array, beyond: Flags, *, ended: bool) -> None:
        """Set the values with a < 1 to the filter applied to the moments."""
        from signals.resampling._engine_kernels import filter_moments  # noqa: PLC0415

        count = slopes_out.size
        self._reserve(count + 2 * HALF_WIDTH + _PADDING)
        for moments, out in zip(self._moments, values, strict=True):
            filter_moments(moments, step_polynomials(), slopes_out, out)
        low, high = self._ends
        clear = max(low, self._grid.known[0]) + HALF_WIDTH, min(high, self._grid.known[1]) - HALF_WIDTH
        if clear[0] <= self._released and self._released + count - 1 <= clear[1]:
            return
        place = self._released + np.arange(count, dtype=np.float64)
        outside = (slopes_out < 1) & ((place < clear[0]) | (place > clear[1]))
        near = place[outside]
        values[:, outside] /= step_response(near - low) - (step_response(near - high) if ended else 0.0)
        beyond[outside] = True
