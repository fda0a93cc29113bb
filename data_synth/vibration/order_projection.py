"""Order-domain projection: complex amplitudes of given orders in a signal, as splines of shaft angle.

With a weight w that is zero at both ends and rises smoothly, a signal x has over the angle phi of the reference shaft
the transform ``Y(m) = 2 / P integral w x exp(-2 pi j m phi / P) dphi``. Samples are not equidistant in angle: they are
spread onto an equidistant grid by the kernel ``exp(beta (sqrt(1 - z^2) - 1))``, which does not alias at any speed
(Barnett, Magland and af Klinteberg 2019, SIAM J. Sci. Comput. 41, C479). A line whose amplitude is a spline of the
angle has a narrow transform about its order. All lines are fitted together, by conjugate gradients on the normal
equations (Hestenes and Stiefel 1952, J. Res. NBS 49, 409), preconditioned by the Gram matrix of the splines; early
stopping divides the common part of lines that the record does not resolve among them.
"""

import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_FINER = 1.5  # cells of the grid to a sample at the Nyquist rate of the highest order
_SPREAD = 7  # cells of the kernel: its aliases are below 1e-5
_BETA = 2.0 * _SPREAD
_DEGREE, _FEWEST = 3, 8  # of the splines, and intervals, at least
_BINS = 16  # of a line's transform, to a spline: the rest of it is below 1e-5 of the line
_RISE, _RISE_OF_CONSTANTS = 0.06, 0.05  # of an interval, and of a record, in which the weight rises from zero to one
_APART, _NEARER, _APART_OF_CONSTANTS = 1.0, 0.4, 0.25
"""Least distance of a line from order zero and from every stronger line: in cycles per mean interval, the same where
this leaves too much, and in cycles per record for constant amplitudes. The amplitudes of nearer lines are uncertain,
since they can share what is at their orders. Closer lines of constant amplitude are resolved, but splines at as many
orders would have more coefficients than there are samples."""
_ENOUGH, _ENOUGH_APART, _GAIN = 5e-4, 1e-3, 0.9
"""Share of the power left below which intervals are not shortened, and below which no nearer lines are admitted; and
times as much left: a step that leaves more is the last."""
_UNKNOWNS = 0.65  # coefficients per sample, at most: with more, splines would fit any signal
_LEFT_OUT = 1e-4  # of the power of all lines: total of the weakest
_SHORTEST = 0.25  # of the mean interval: shorter ones need not be resolved by the transform of a line
_FLAT = 0.25  # of an interval: at both ends amplitudes are constant, since half of each spline is outside the record
_REGULAR = 0.03  # of the mean diagonal of the Gram matrix, added to it: conditions the splines at both ends
_STEPS, _SETTLED = 12, 1e-2  # conjugate gradients, at most, and the share of what is left that a last one takes away
_LINES, _BLOCK = 512, 65536  # lines that are transformed at once, and samples


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Lines in a signal.

    Attributes
    ----------
    chosen : (line,) int array
        Increasing indices among the requested orders.
    amplitudes : (channel, line, instant) complex array
        Z, ``x = Re sum Z exp(2 pi j order angle)``.
    left : (channel,) array
        Share of the power outside the lines, over all samples.
    intervals : int
        Number of spline intervals; 0 for constant amplitudes.
    interval_rev : float
        Knot interval of the splines, or length of the record: lines closer than its inverse are not resolved.
    """

    chosen: NDArray[np.int_]
    amplitudes: ComplexArray
    left: Array
    intervals: int
    interval_rev: float


def projection(
    signal: Array,
    revolutions: Array,
    orders: Array,
    *,
    at_rev: Array,
    top_order: float | Array,
    steady: bool,
    most: int | None = None,
) -> Projection:
    """Return the strongest lines of a signal at given orders, at most `most`, without negligible ones.

    Shorter intervals of the splines follow faster changes but resolve fewer lines; they are halved as long as this
    reduces the residual, until it is negligible.

    Parameters
    ----------
    signal : (channel, n) array
    revolutions : (n,) array
        Angle of the reference shaft at the samples, increasing.
    orders : (k,) array
        Positive, increasing.
    at_rev : (instant,) array
        Increasing angles, from the first sample to the last, at which amplitudes are returned. Knots of the splines are
        equidistant in the index of the instant, so that they are dense where instants are.
    top_order : float or (n,) array
        Highest order of the spectrum, lower where the shaft is faster; lines above it are zero.
    steady : bool
        Whether amplitudes are constant.
    """
    finest = 0 if steady else at_rev.size - 1
    spectrum = _Spectrum(signal, revolutions, np.broadcast_to(top_order, revolutions.shape))
    places, halvings = np.flatnonzero(orders < spectrum.top_order), (finest // _FEWEST or 1).bit_length() - 1
    ladder = [finest >> number for number in range(halvings, -1, -1)]
    fitted = partial(_fitted, spectrum, at_rev=at_rev, most=most)

    def halved(apart: float) -> Projection:
        best = fitted(orders[places], ladder[0], apart=apart)
        for intervals in ladder[1:]:
            if np.max(best.left) < _ENOUGH or best.chosen.size * intervals > _UNKNOWNS * revolutions.size:
                break
            found = fitted(orders[places], intervals, apart=apart)
            former, best = best, min(best, found, key=_total_left)
            if _total_left(found) > _GAIN * _total_left(former):
                break
        return best

    best = halved(_APART)
    if not steady and np.max(best.left) > _ENOUGH_APART:
        best = min(best, halved(_NEARER), key=_total_left)
    if 0 < best.chosen.size == most:  # the lines left out had taken parts of those
        found = fitted(orders[places[best.chosen]], best.intervals, apart=_NEARER)
        best = min(best, replace(found, chosen=best.chosen[found.chosen]), key=_total_left)
    from_zero = np.exp(-2j * np.pi * np.remainder(orders[places[best.chosen]] * revolutions[0], 1.0))
    return replace(best, chosen=places[best.chosen], amplitudes=best.amplitudes * from_zero[:, None])


def _total_left(found: Projection) -> float:
    return float(np.sum(found.left))


def _fitted(
    spectrum: "_Spectrum", orders: Array, intervals: int, *, at_rev: Array, most: int | None, apart: float
) -> Projection:
    """Return the lines as splines of so many intervals, with phases that are zero at the first sample."""
    spectrum = replace(spectrum, intervals=intervals)
    interval_rev, apart = spectrum.span_rev / max(intervals, 1), apart if intervals else _APART_OF_CONSTANTS
    some, gaps = _separate(orders, spectrum.power_about(orders, 1 / interval_rev), apart=apart / interval_rev)
    knots_rev, least_rev = at_rev - spectrum.revolutions[0], apart / gaps
    lines = _Lines(
        spectrum=spectrum, orders=orders[some], intervals=intervals, knots_rev=knots_rev, least_rev=least_rev
    )
    coefficients = lines.fitted()
    loud = _loudest(lines.powers(coefficients), most=most)
    coefficients[:, np.setdiff1d(np.arange(some.size), loud)] = 0
    splines = lines.splines(at_rev - spectrum.revolutions[0])
    # with a weight that falls to zero outside the record only, so that what is left includes both ends
    whole = replace(spectrum, margin_rev=interval_rev * (_FLAT if intervals else _RISE_OF_CONSTANTS))
    earlier = np.exp(-2j * np.pi * whole.margin_rev * lines.orders)
    rest = whole.without(replace(lines, spectrum=whole).transform(coefficients * earlier[:, None]))
    power = np.var(spectrum.signal, axis=1)
    return Projection(
        chosen=some[loud],
        amplitudes=np.stack([(splines @ row[loud].T).T for row in coefficients]),
        left=np.divide(np.var(rest, axis=1), power, out=np.zeros_like(power), where=power > 0),
        intervals=intervals,
        interval_rev=interval_rev,
    )


@dataclass(frozen=True)
class _Spectrum:
    """Transform of a weighted signal over angle, in lines of ``1 / period_rev``.

    The weight rises and falls within a fraction of a spline interval or, for constants, of the record; with a margin,
    within that outside the record.
    """

    signal: Array
    revolutions: Array
    known_orders: Array
    intervals: int = 0
    margin_rev: float = 0.0

    @cached_property
    def top_order(self) -> float:
        return float(np.max(self.known_orders))

    @cached_property
    def span_rev(self) -> float:
        return float(self.revolutions[-1] - self.revolutions[0])

    @property
    def rise_rev(self) -> float:
        return self.margin_rev or self.span_rev * (_RISE / self.intervals if self.intervals else _RISE_OF_CONSTANTS)

    @cached_property
    def cells(self) -> int:
        """Number of cells of the grid."""
        from scipy.fft import next_fast_len  # noqa: PLC0415

        whole_rev = self.span_rev + 2 * self.margin_rev
        return int(next_fast_len(math.ceil(whole_rev * self._cells_per_rev) + 2 * _SPREAD, real=True))

    @property
    def _cells_per_rev(self) -> float:
        return 2 * _FINER * self.top_order

    @cached_property
    def period_rev(self) -> float:
        return self.cells / self._cells_per_rev

    def weight(self, angle_rev: Array) -> Array:
        """Return w at angles from the first sample."""
        from_end = np.minimum(angle_rev, self.span_rev - angle_rev) + self.margin_rev
        return np.asarray(np.sin(np.pi / 2 * np.clip(from_end / self.rise_rev, 0.0, 1.0)) ** 2)

    @cached_property
    def factor(self) -> ComplexArray:
        """Y over the Fourier transform of the grid, (m,)."""
        frequency = np.arange(int(self.top_order * self.period_rev) + 1) / self.cells
        response = np.interp(frequency, *_kernel_response())
        return np.asarray(2 / self.period_rev / response * np.exp(2j * np.pi * _SPREAD * frequency))

    def _blocks(self) -> Iterator[tuple[slice, Array, NDArray[np.int64], NDArray[np.float32]]]:
        """Yield samples, their angles from the first, their lowest cells, and their distances from these in cells."""
        for start in range(0, self.revolutions.size, _BLOCK):
            here = slice(start, min(start + _BLOCK, self.revolutions.size))
            angle_rev = self.revolutions[here] - self.revolutions[0]
            at = (angle_rev + self.margin_rev) * self._cells_per_rev + _SPREAD
            lowest = np.rint(at).astype(np.int64) - _SPREAD // 2
            yield here, angle_rev, lowest, (at - lowest).astype(np.float32)

    @cached_property
    def transform(self) -> NDArray[np.complex64]:
        """Y (channel, m)."""
        from scipy.fft import rfft  # noqa: PLC0415

        grid, steps_rev = np.zeros((self.signal.shape[0], self.cells)), np.gradient(self.revolutions)
        for here, angle_rev, lowest, away in self._blocks():
            weighted = self.signal[:, here] * (self.weight(angle_rev) * steps_rev[here])
            first, last = int(lowest[0]), int(lowest[-1]) + 1
            for cell in range(_SPREAD):
                share = _kernel(away - cell)
                for row, values in zip(grid, weighted, strict=True):
                    row[first + cell : last + cell] += np.bincount(lowest - first, weights=share * values)
        return np.stack([(rfft(row)[: self.factor.size] * self.factor).astype(np.complex64) for row in grid])

    def without(self, lines: NDArray[np.complex64]) -> Array:
        """Return the signal (channel, n) less lines of a given transform (channel, m), interpolated at the samples."""
        from scipy.fft import irfft  # noqa: PLC0415

        grid = irfft(lines * (self.cells * self.period_rev / 4 * self.factor.conj()), self.cells, axis=1)
        rest = self.signal.copy()
        for here, _, lowest, away in self._blocks():
            for cell in range(_SPREAD):
                rest[:, here] -= _kernel(away - cell) * grid[:, lowest + cell]
        return rest

    def power_about(self, orders: Array, width: float) -> Array:
        """Return the sum of squares (k,) around orders, tapered to zero at a width."""
        from scipy.ndimage import uniform_filter1d  # noqa: PLC0415

        power, size = np.sum(np.abs(self.transform) ** 2, axis=0), max(1, round(width * self.period_rev))
        about = uniform_filter1d(uniform_filter1d(power, size, mode="constant"), size, mode="constant")
        return np.asarray(about[np.minimum(np.rint(orders * self.period_rev).astype(np.int64), about.size - 1)])


def _kernel(cells: NDArray[Any]) -> NDArray[Any]:
    """Return the spreading kernel at a distance in cells."""
    return np.asarray(np.exp(_BETA * (np.sqrt(np.maximum(1 - (2 * cells / _SPREAD) ** 2, 0.0)) - 1)))


@cache
def _kernel_response() -> tuple[Array, Array]:
    """Return frequencies in cycles per cell and the Fourier transform of the kernel, by Gaussian quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    frequencies = np.linspace(0, 0.5 / _FINER, 4097)
    waves = np.cos(np.pi * _SPREAD * np.multiply.outer(frequencies, nodes))
    return frequencies, waves @ (weights * _SPREAD / 2 * _kernel(_SPREAD / 2 * nodes))


@dataclass(frozen=True, kw_only=True)
class _Lines:
    """Lines at some orders whose amplitudes are splines: coefficients (channel, line, spline) and their transform.

    Each is sampled at `_bins` equidistant angles of the period, times w, relative to the bin nearest to its order,
    around which it has as many bins.
    """

    spectrum: _Spectrum
    orders: Array
    intervals: int
    knots_rev: Array
    least_rev: Array
    _cached: dict[int, tuple[NDArray[np.complex64], NDArray[np.int64]]] = field(default_factory=dict, init=False)

    @property
    def _even(self) -> Array:
        """Positions of the instants in units of intervals."""
        return np.linspace(0.0, self.intervals, self.knots_rev.size)

    def splines(self, angle_rev: Array) -> Any:  # noqa: ANN401 - sparse arrays have no type of their values
        """Return the splines (n, spline), linear between instants, at angles from the first sample, sparse."""
        between = self.knots_rev.size - 1
        if not self.intervals:
            return _b_splines(np.zeros(angle_rev.size), 1, 0)
        places = np.clip(self._even, _FLAT, self.intervals - _FLAT)
        at_instants = _b_splines(places, self.intervals, 1 if self.intervals == between else _DEGREE)
        return _b_splines(np.interp(angle_rev, self.knots_rev, np.arange(between + 1.0)), between, 1) @ at_instants

    @cached_property
    def _weighted(self) -> Any:  # noqa: ANN401
        """Splines times w at the equidistant angles, (bin, spline), sparse."""
        from scipy.fft import next_fast_len  # noqa: PLC0415

        ends_rev = np.interp(np.arange(self.intervals + 1.0), self._even, self.knots_rev)
        shortest = np.min(np.diff(ends_rev), initial=np.inf)
        finest = min(self.spectrum.span_rev / shortest, self.intervals / _SHORTEST)
        bins = int(next_fast_len(math.ceil(_BINS * (max(finest, _FEWEST) + _DEGREE))))
        angle_rev = np.arange(bins) * self.spectrum.period_rev / bins - self.spectrum.margin_rev
        return self.splines(angle_rev).multiply(self.spectrum.weight(angle_rev)[:, None]).astype(np.float32).tocsr()

    @cached_property
    def _factor(self) -> Array:
        """Banded Cholesky factor of the Gram matrix of the splines."""
        from scipy.linalg import cholesky_banded  # noqa: PLC0415

        gram = (self._weighted.T @ self._weighted / self._weighted.shape[0]).astype(np.float64)
        bands = np.zeros((min(_DEGREE, gram.shape[0] - 1) + 1, gram.shape[0]))
        for number, band in enumerate(bands):
            band[: band.size - number] = gram.diagonal(-number)
        bands[0] += _REGULAR * np.mean(bands[0])
        return np.asarray(cholesky_banded(bands, lower=True))

    @cached_property
    def _known(self) -> NDArray[np.bool_]:
        """Whether a line is determined around the centre of each spline, (line, spline).

        It is not where it would alias, or where an interval is too short to resolve it from a stronger line.
        """
        middles = np.arange(self._weighted.shape[1]) - (self._weighted.shape[1] - 1 - self.intervals) / 2
        at_rev = self.spectrum.revolutions[0] + np.interp(middles, self._even, self.knots_rev)
        known = self.orders[:, None] <= np.interp(at_rev, self.spectrum.revolutions, self.spectrum.known_orders)
        if self.intervals:
            inside = np.clip(middles, 0.5, self.intervals - 0.5)
            ends_rev = (np.interp(inside + half, self._even, self.knots_rev) for half in (-0.5, 0.5))
            known &= self.least_rev[:, None] <= -np.subtract(*ends_rev)
        return np.asarray(known)

    def _preconditioned(self, gradient: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return coefficients of lines that each stand alone."""
        from scipy.linalg import cho_solve_banded  # noqa: PLC0415

        rows = np.ascontiguousarray(gradient.reshape(-1, gradient.shape[-1]).T.astype(np.complex128))
        solved = np.ascontiguousarray(cho_solve_banded((self._factor, True), rows.view(np.float64)))
        return np.asarray(solved.view(np.complex128).T.reshape(gradient.shape) * self._known, dtype=np.complex64)

    def _blocks(self) -> Iterator[slice]:
        for start in range(0, self.orders.size, _LINES):
            yield slice(start, min(start + _LINES, self.orders.size))

    def _about(self, here: slice) -> tuple[NDArray[np.complex64], NDArray[np.int64]]:
        """Return the phasors (line, bin) of orders relative to their nearest bin, and the bins around it."""
        if here.start not in self._cached:
            bins, place = self._weighted.shape[0], self.orders[here] * self.spectrum.period_rev
            nearest = np.rint(place).astype(np.int64)
            turned = np.exp(2j * np.pi * np.multiply.outer(place - nearest, np.arange(bins) / bins))
            around = np.fft.fftfreq(bins, 1 / bins).astype(np.int64)
            self._cached[here.start] = turned.astype(np.complex64), np.add.outer(nearest, around) + bins
        return self._cached[here.start]

    def transform(self, coefficients: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return the transform (channel, m) of lines with these coefficients."""
        from scipy.fft import fft  # noqa: PLC0415

        bins, size = self._weighted.shape[0], self.spectrum.factor.size
        found = np.zeros((coefficients.shape[0], size + 2 * bins), dtype=np.complex64)
        for here in self._blocks():
            turned, lines = self._about(here)
            for number, own in enumerate(coefficients[:, here]):
                parts = (fft((self._weighted @ own.T).T * turned, axis=1) / bins).ravel()
                found[number].real += np.bincount(lines.ravel(), weights=parts.real, minlength=found.shape[1])
                found[number].imag += np.bincount(lines.ravel(), weights=parts.imag, minlength=found.shape[1])
        return found[:, bins : bins + size]

    def adjoint(self, transform: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return the adjoint of `transform` of a transform, (channel, line, spline)."""
        from scipy.fft import ifft  # noqa: PLC0415

        bins, splines = self._weighted.shape
        padded = np.pad(transform, ((0, 0), (bins, bins)))
        found = np.empty((transform.shape[0], self.orders.size, splines), dtype=np.complex64)
        for here in self._blocks():
            turned, lines = self._about(here)
            for row, values in zip(found, padded, strict=True):
                row[here] = (self._weighted.T @ (ifft(values[lines], axis=1) * turned.conj()).T).T
        return found * self._known

    def powers(self, coefficients: NDArray[np.complex64]) -> Array:
        """Return the sum of squares of each line, (line,)."""
        squares = [np.mean(np.abs(self._weighted @ row.T) ** 2, axis=0) for row in coefficients]
        return np.asarray(np.sum(squares, axis=0))

    def fitted(self) -> NDArray[np.complex64]:
        """Return the coefficients of all lines together, by preconditioned conjugate gradients."""
        left = self.spectrum.transform.copy()
        gradient = self.adjoint(left)
        found, direction = np.zeros_like(gradient), self._preconditioned(gradient)
        slope, before = np.vdot(gradient, direction).real, np.vdot(left, left).real
        for _ in range(_STEPS if self.orders.size else 0):
            change = self.transform(direction)
            step = slope / np.vdot(change, change).real
            found += step * direction
            left -= step * change
            after = np.vdot(left, left).real
            if before - after < _SETTLED * after:
                break
            gradient = self.adjoint(left)
            preconditioned = self._preconditioned(gradient)
            former, slope, before = slope, np.vdot(gradient, preconditioned).real, after
            direction = preconditioned + slope / former * direction
        return found


def _b_splines(places: Array, intervals: int, degree: int) -> Any:  # noqa: ANN401
    """Return B-splines (n, spline) of a degree with unit intervals from zero at some places, sparse."""
    from scipy.interpolate import BSpline  # noqa: PLC0415
    from scipy.sparse import csr_array  # noqa: PLC0415

    return csr_array(BSpline.design_matrix(places, np.arange(-degree, intervals + degree + 1.0), degree))


def _separate(orders: Array, powers: Array, *, apart: float) -> tuple[NDArray[np.int_], Array]:
    """Return increasing indices of orders at least `apart` from stronger ones and from zero, and their distances."""
    kept, taken = [0.0], dict[int, float]()
    for number in (loudest := _loudest(powers))[np.argsort(-powers[loudest], kind="stable")].tolist():
        order = float(orders[number])
        place = bisect_left(kept, order)
        gap = min([order - kept[place - 1], *(above - order for above in kept[place : place + 1])])
        if gap >= apart:
            kept.insert(place, order)
            taken[number] = gap
    rising = sorted(taken)
    return np.array(rising, dtype=np.int64), np.array([taken[number] for number in rising])


def _loudest(powers: Array, *, most: int | None = None) -> NDArray[np.int_]:
    """Return the increasing indices of all but the weakest lines, which together have a small share of the power."""
    rising = np.argsort(powers, kind="stable")
    weakest = int(np.searchsorted(np.cumsum(powers[rising]), _LEFT_OUT * np.sum(powers)))
    if most is not None:
        weakest = max(weakest, powers.size - most)
    return np.sort(rising[weakest:][powers[rising[weakest:]] > 0])
