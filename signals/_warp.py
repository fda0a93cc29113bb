"""A record on one even grid, block by block, onto another even grid that a rising function maps it to.

The function is q(n): the place of sample n counted in steps of the output grid. Its slope a(n) = dq/dn is also the
output rate over the input rate. With g the windowed sinc of `_windowed_sinc`,

    where a >= 1    y[m] = sum_n x[n] g(n(m) - n),            n(m) the inverse of q: the cut is at half the input rate
    where a < 1     y[m] = sum_n a(n) x[n] g(m - q(n)),                       it is at half the output rate

The second sum is the integral of the record against a filter that is fixed on the output grid, however unevenly the
samples fall on it; where a = 1 both are the same. It is not taken output by output: a filter that is a polynomial on
each step of the output grid needs no more of the samples than their moments there. Each sample is read once, however
many lie in a step, and nothing of a long record has to be kept.

Beyond its ends the record is taken to be nothing, and each output is divided by the share of the filter that lies on
the record. The first sample is taken off before and put back after: a large mean costs no accuracy.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array, Samples
from signals._track import NODE_STEP, Track
from signals._windowed_sinc import HALF_WIDTH, MOMENTS, step_polynomials, step_response, weight_rows

Method = Literal["sinc", "cubic", "linear"]
METHODS: tuple[Method, ...] = get_args(Method)
FEWEST = {"sinc": 2, "cubic": 4, "linear": 2}  # samples

_REACH = {"sinc": (HALF_WIDTH - 1, HALF_WIDTH), "cubic": (1, 2), "linear": (0, 1)}  # samples before and after a place
_HALO = HALF_WIDTH + 1  # samples kept on either side of those worked on
_CHUNK = 15 * 1024  # samples worked on at once, or outputs where those are more
_SPARE = 8  # steps that the kernel reads beyond the last output's

Flags = NDArray[np.bool_]
Outputs = tuple[Array, Flags]  # values, and whether their filter reaches beyond what is known


@dataclass(frozen=True, kw_only=True)
class Map:
    """Where the samples of the record lie on the output grid.

    Attributes
    ----------
    outward : q of the samples.
    inward : places of the outputs among the samples, where that is the function known; else found from `outward`.
    outputs : how many there can be.
    least_slope, largest_slope : of q.
    known : q between which the map is known, and not reflected.
    slack : of q, by which an output may lie beyond the record's end.
    """

    outward: Track
    outputs: int
    least_slope: float
    largest_slope: float
    known: tuple[float, float]
    slack: float
    inward: Track | None = None


class Warp:
    """The record so far, reduced to what later outputs need of it. Chunks are counted from its first sample."""

    def __init__(self, grid: Map, *, method: Method) -> None:
        self._grid, self._method = grid, method
        self._folds = method == "sinc" and grid.least_slope < 1
        self._chunk = max(NODE_STEP, int(_CHUNK / max(1.0, grid.largest_slope)) // NODE_STEP * NODE_STEP)
        self._level: float | None = None
        self._samples = np.zeros(_HALO)  # less the level, from sample `_at - _HALO` on
        self._at = 0
        self._values, self._cuts = np.empty(0), np.empty(0)  # outputs from `_given` on
        self._beyond: Flags = np.empty(0, dtype=bool)
        self._given = 0
        self._moments = np.zeros((2 * HALF_WIDTH, MOMENTS))  # of the steps from `_given - HALF_WIDTH` on
        self._used = 0  # of those, the others are zero
        self._ends = (-np.inf, np.inf)  # of the record on the output grid

    def push(self, x: Samples) -> Outputs:
        """Take more of the record; return the outputs this completes, and which of them reach beyond its start."""
        return _joined(self._pushed(x))

    def finish(self) -> Outputs:
        """Return the outputs left, and which of them reach beyond an end of the record."""
        return self._advance(np.concatenate([self._samples, np.zeros(_HALO)]), ended=True)

    def whole(self, x: Samples) -> Outputs:
        """Take all of the record at once; return all outputs."""
        return _joined([*self._pushed(x), self.finish()])

    def _pushed(self, x: Samples) -> list[Outputs]:
        if self._level is None and x.size:
            finite = x[:1] if np.isfinite(x[0]) else x[np.isfinite(x)]
            self._level = float(finite[0]) if finite.size else None
        parts, width = [], self._chunk + 2 * _HALO
        for begin in range(0, x.size, self._chunk):
            self._samples = np.concatenate([self._samples, x[begin : begin + self._chunk]])
            if self._samples.size >= width:
                parts.append(self._advance(self._samples[:width], ended=False))
                self._samples = self._samples[self._chunk :]
        return parts

    @property
    def samples_seen(self) -> int:
        """How many samples were pushed."""
        return self._at + self._samples.size - _HALO

    def _advance(self, samples: Array, *, ended: bool) -> Outputs:
        """Work on `samples` without the halo on either side."""
        count = samples.size - 2 * _HALO
        samples = samples - (self._level or 0.0)
        q, slopes = self._grid.outward.at(self._at - _HALO, self._at + count + _HALO)
        # outputs that fold need moments; q gains a step a sample where its slope is one, so the halo reaches them all
        moments = self._folds and float(slopes.min()) < 1
        within = slice(_HALO, _HALO + count + (not ended))  # with one to interpolate towards
        q, slopes = q[within], slopes[within]
        if self._at == 0:
            samples[:_HALO] = 0
            self._ends = (float(q[0] - slopes[0] / 2), np.inf)
        if ended:
            samples[-_HALO:] = 0
            self._ends = (self._ends[0], float(q[-1] + slopes[-1] / 2))
        self._interpolate(samples, q, slopes, ended=ended)
        ready = self._values.size
        if moments:
            self._gather(samples[_HALO : _HALO + count], q, slopes)
        if self._folds and not ended:
            ready = min(ready, int(np.floor(q[-1])) - HALF_WIDTH + 1 - self._given)
        self._at += count
        return self._release(max(ready, 0), ended=ended)

    def _interpolate(self, samples: Array, q: Array, slopes: Array, *, ended: bool) -> None:
        """Queue the outputs that lie among these samples, those to be folded still without a value."""
        from signals import _resampling_kernel as kernel  # noqa: PLC0415

        first = self._given + self._values.size
        stop = int(np.floor(q[-1] + self._grid.slack)) + 1 if ended else int(np.ceil(q[-1]))
        places, cuts = self._placed(q, slopes, first, max(first, min(stop, self._grid.outputs)))
        places += _HALO
        values, beyond = np.empty(places.size), np.zeros(places.size, dtype=bool)
        least, most = max(_HALO - self._at, 0), samples.size - 1 - (_HALO if ended else 0)
        if self._method == "sinc":
            kernel.interpolate(samples, places, cuts, weight_rows(), values)
        else:
            (kernel.linear if self._method == "linear" else kernel.cubic)(samples, places, least, most, values)
        if ended or self._at == 0:
            before, after = _REACH[self._method]
            beyond = (np.floor(places) - before < least) | (np.ceil(places) + after - 1 > most)
            if self._method == "sinc" and beyond.any():
                there = ((np.arange(samples.size) >= least) & (np.arange(samples.size) <= most)).astype(np.float64)
                share = np.empty(np.count_nonzero(beyond))
                kernel.interpolate(there, places[beyond], np.ones(share.size), weight_rows(), share)
                values[beyond] /= share
        self._values = np.concatenate([self._values, values])
        self._cuts = np.concatenate([self._cuts, cuts])
        self._beyond = np.concatenate([self._beyond, beyond])

    def _placed(self, q: Array, slopes: Array, first: int, stop: int) -> tuple[Array, Array]:
        """Places of the outputs from `first` to `stop` among the samples worked on, and where their cut lies."""
        from signals._resampling_kernel import places_of  # noqa: PLC0415

        if self._grid.inward is None:
            places, cuts = np.empty(stop - first), np.empty(stop - first)
            places_of(q, slopes, float(first), places, cuts)
        else:
            places, pace = self._grid.inward.at(first, stop) if stop > first else (np.empty(0), np.empty(0))
            places = np.clip(places - self._at, 0, q.size - 1)
            with np.errstate(divide="ignore"):
                cuts = 1 / pace
        return places, cuts if self._folds else np.maximum(cuts, 1.0)

    def _gather(self, x: Array, q: Array, slopes: Array) -> None:
        """Add samples to the moments of the steps they lie in."""
        from signals._resampling_kernel import gather  # noqa: PLC0415

        top = max(self._given + self._values.size, min(int(q[-1]), self._grid.outputs))
        self._used = max(self._used, top - self._given + 2 * HALF_WIDTH + _SPARE)
        self._hold(self._used)
        first = self._given - HALF_WIDTH
        gather(x, q[: x.size], slopes[: x.size], first, self._moments[: self._used])

    def _hold(self, steps: int) -> None:
        if steps > self._moments.shape[0]:
            self._moments = np.concatenate([self._moments, np.zeros((steps - self._moments.shape[0], MOMENTS))])

    def _release(self, ready: int, *, ended: bool) -> Outputs:
        """Hand over the first `ready` outputs of the queue, folded where their cut asks for it."""
        values, beyond = self._values[:ready], self._beyond[:ready]
        if self._folds and ready:
            if np.any(self._cuts[:ready] < 1):
                self._fold(values, self._cuts[:ready], beyond, ended=ended)
            kept = self._moments[ready : self._used].copy()
            self._moments[: self._used] = 0
            self._used = kept.shape[0]
            self._moments[: self._used] = kept
        self._values, self._cuts, self._beyond = self._values[ready:], self._cuts[ready:], self._beyond[ready:]
        self._given += ready
        values += self._level or 0.0
        return values, beyond

    def _fold(self, values: Array, cuts: Array, beyond: Flags, *, ended: bool) -> None:
        """Replace the values whose cut lies below that of the record by the filter over the moments."""
        from signals._resampling_kernel import weigh  # noqa: PLC0415

        self._hold(values.size + 2 * HALF_WIDTH + _SPARE)
        weigh(self._moments, step_polynomials(), cuts, values)
        low, high = self._ends
        clear = max(low, self._grid.known[0]) + HALF_WIDTH, min(high, self._grid.known[1]) - HALF_WIDTH
        if clear[0] <= self._given and self._given + values.size - 1 <= clear[1]:
            return
        place = self._given + np.arange(values.size, dtype=np.float64)
        outside = (cuts < 1) & ((place < clear[0]) | (place > clear[1]))
        near = place[outside]
        values[outside] /= step_response(near - low) - (step_response(near - high) if ended else 0.0)
        beyond[outside] = True


def _joined(parts: list[Outputs]) -> Outputs:
    """Put outputs one after the other."""
    if not parts:
        return np.empty(0), np.empty(0, dtype=bool)
    return np.concatenate([values for values, _ in parts]), np.concatenate([beyond for _, beyond in parts])
