"""Order-domain projection: complex amplitudes of given orders in a signal, from a smooth window in shaft angle.

In each window of angle the signal is fitted, by weighted least squares, with lines whose amplitudes are polynomials in
angle (local polynomial regression, Fan and Gijbels 1996); lines that the window does not separate are fitted together.
The weight is a four-term cosine window (Nuttall 1981, -98 dB), so lines four and more of its periods apart are
orthogonal. Sums over samples become discrete Fourier transforms in angle: samples are spread on an even grid by the
kernel ``exp(beta (sqrt(1 - z^2) - 1))``, which does not alias at any speed, and orders are interpolated between the
lines of the transform by the same kernel (Barnett, Magland and af Klinteberg 2019).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebval
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_NUTTALL = (0.3635819, -0.4891775, 0.1365995, -0.0106411)
_SEPARATED = 4.5  # periods of the window: lines farther apart are orthogonal to -90 dB
_FINER = 1.5  # cells to a sample at the Nyquist rate
_SPREAD = 9  # cells of the kernel: its aliases are below 1e-6
_BETA = 2.0 * _SPREAD
_NODES, _WEIGHTS = leggauss(96)
_FEWEST = 64  # cells of a window
_CELLS = 1 << 22  # of all windows that are transformed at once, over their channels
_NEAR = 0.125  # of a window: instants nearer than this share one
_BLOCK = 65536  # samples


@dataclass(frozen=True, kw_only=True)
class AngleSamples:
    """Samples over the angle of the reference shaft, which rises.

    Attributes
    ----------
    signal : (channel, n) array
    rate_hz : float
    revolutions, speed_hz : callable
        Angle in rev and speed in rev s-1, none below zero, at times in s (n,).
    """

    signal: Array
    rate_hz: float
    revolutions: Callable[[Array], Array]
    speed_hz: Callable[[Array], Array]

    @cached_property
    def span_rev(self) -> tuple[float, float]:
        """Angle of the first and behind the last sample."""
        first, last = self.revolutions(np.array([0.0, self.signal.shape[1] / self.rate_hz]))
        return float(first), float(last)

    def spread(self, cells_per_rev: float, first: int, count: int) -> Array:
        """Return the signal times ``d angle`` on cells `first` ... of an even grid of angle, (channel, count)."""
        half = _SPREAD / 2 + 1
        begin, end = (self._sample(cell / cells_per_rev) for cell in (first - half, first + count + half))
        grid = np.zeros((self.signal.shape[0], count + 2 * _SPREAD))
        for start in range(begin, end, _BLOCK):
            numbers = np.arange(start, min(start + _BLOCK, end))
            times_s = numbers / self.rate_hz
            at = self.revolutions(times_s) * cells_per_rev - first + _SPREAD
            steps = self.speed_hz(times_s) * cells_per_rev / self.rate_hz
            nearest = np.rint(at).astype(np.int64)
            for offset in range(-(_SPREAD // 2), _SPREAD // 2 + 1):
                cells = nearest + offset
                inside = (cells >= 0) & (cells < grid.shape[1])
                share = np.where(inside, steps * _kernel(at - cells), 0.0)
                cells = np.where(inside, cells, 0)
                low = int(cells.min())
                for row, values in zip(grid, self.signal[:, start : start + numbers.size], strict=True):
                    added = np.bincount(cells - low, weights=share * values)
                    row[low : low + added.size] += added
        return grid[:, _SPREAD:-_SPREAD]

    def _sample(self, revolutions: float) -> int:
        """Return the number of the first sample at or behind an angle, by bisection."""
        low, high = 0, self.signal.shape[1]
        while low < high:
            middle = (low + high) // 2
            if float(self.revolutions(np.array([middle / self.rate_hz]))[0]) < revolutions:
                low = middle + 1
            else:
                high = middle
        return low


def _kernel(cells: Array) -> Array:
    """Return the spreading kernel at a distance in cells."""
    return np.asarray(np.exp(_BETA * (np.sqrt(np.maximum(1 - (2 * cells / _SPREAD) ** 2, 0.0)) - 1)))


def _kernel_response(cycles_per_cell: Array) -> Array:
    """Return the Fourier transform of the kernel."""
    at = _SPREAD / 2 * _NODES
    phases = 2 * np.pi * np.multiply.outer(np.asarray(cycles_per_cell), at)
    return np.asarray(np.cos(phases) @ (_WEIGHTS * _SPREAD / 2 * _kernel(at)))


@dataclass(frozen=True, kw_only=True)
class Window:
    """Window of a projection: its length in rev, and the degree of the amplitudes in angle within it."""

    length_rev: float
    degree: int

    @property
    def separated(self) -> float:
        """Difference of orders beyond which two lines are orthogonal."""
        return _SEPARATED / self.length_rev

    def weights(self, position: Array) -> Array:
        """Return ``w(u) u^d`` for d = 0 ... 2 degree, (2 degree + 1, n), at positions u from -1/2 to 1/2 (n,)."""
        shape = chebval(np.cos(2 * np.pi * (position + 0.5)), _NUTTALL)
        return np.asarray(shape * np.power.outer(position, np.arange(2 * self.degree + 1)).T)

    def normal_matrix(self, orders: Array) -> tuple[int, ComplexArray]:
        """Return the bandwidth and the diagonals of the normal matrix of lines at rising signed orders (k,).

        Unknowns are ordered by line, then by degree; lines farther apart than twice `separated` have no entry. The
        diagonals (2 bandwidth + 1, unknowns) are stored as `scipy.linalg.solve_banded` takes them.
        """
        size, reach = self.degree + 1, 2 * self.separated
        neighbours = int(np.max(np.searchsorted(orders, orders + reach) - np.arange(orders.size))) - 1
        band = (neighbours + 1) * size - 1
        diagonals = np.zeros((2 * band + 1, orders.size * size), dtype=np.complex128)
        at = _NODES / 2
        quadrature = (self.weights(at) * _WEIGHTS / 2).T
        for ahead in range(neighbours + 1):
            row = np.arange(orders.size - ahead)
            apart = self.length_rev * (orders[row + ahead] - orders[row])
            moments = np.exp(2j * np.pi * np.multiply.outer(apart, at)) @ quadrature
            moments[apart >= 2 * _SEPARATED] = 0
            for d in range(size):
                for e in range(size):
                    above = ahead * size + e - d
                    diagonals[band - above, (row + ahead) * size + e] = moments[:, d + e]
                    diagonals[band + above, row * size + d] = moments[:, d + e].conj()
        return band, diagonals


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Projection of a signal on lines at given orders, in windows of one length.

    Attributes
    ----------
    samples : AngleSamples
    orders : (k,) array
        Rising, above zero.
    window : Window
        Not longer than the signal.
    """

    samples: AngleSamples
    orders: Array
    window: Window

    def amplitudes(self, instants_rev: Array) -> ComplexArray:
        """Return Z (channel, k, i) at angles (i,), ``x = Re{Z exp(2 pi j order angle)}``.

        Near the ends of the signal windows stay within it, and their polynomials are taken off the middle; so are those
        of instants nearer than an eighth of a window, which share one.
        """
        hop, (first, last) = _NEAR * self.window.length_rev, self.samples.span_rev
        half = self.window.length_rev / 2
        centres_rev = np.clip(np.rint(instants_rev / hop) * hop, first + half, max(first + half, last - half))
        centres_rev, which = np.unique(centres_rev, return_inverse=True)
        found = np.empty((self.samples.signal.shape[0], self.orders.size, instants_rev.size), dtype=np.complex128)
        for begin, middle_rev, coefficients in self._coefficients(centres_rev):
            here = np.flatnonzero((which >= begin) & (which < begin + middle_rev.size))
            position = (instants_rev[here] - middle_rev[which[here] - begin]) / self.window.length_rev
            powers = np.power.outer(position, np.arange(self.window.degree + 1))
            found[:, :, here] = np.einsum("icdk,id->cki", coefficients[which[here] - begin], powers)
        return found

    def power(self, centres_rev: Array) -> Array:
        """Return the mean of ``|Z|^2`` (channel, k) in windows about centres (i,), each line taken to stand alone."""
        alone = replace(self, window=replace(self.window, degree=0))
        total = np.zeros((self.samples.signal.shape[0], self.orders.size))
        for moments, _ in alone._moments(centres_rev):  # noqa: SLF001 - its own class
            total += np.sum(np.abs(2 * moments[:, :, 0, 1:] / _NUTTALL[0]) ** 2, axis=0)
        return np.asarray(total / centres_rev.size)

    def mean(self, centres_rev: Array) -> ComplexArray:
        """Return the mean Z (channel, k) of windows about centres (i,)."""
        parts = [np.sum(part[:, :, 0], axis=0) for _, _, part in self._coefficients(centres_rev)]
        return np.asarray(np.sum(parts, axis=0) / centres_rev.size)

    def _coefficients(self, centres_rev: Array) -> Iterator[tuple[int, Array, ComplexArray]]:
        """Yield the number of the first window, the middles, and Z in powers of u, (window, channel, degree, k)."""
        begin = 0
        for moments, middle_rev in self._moments(centres_rev):
            turn = np.exp(-2j * np.pi * np.remainder(np.multiply.outer(middle_rev, self.orders), 1.0))
            yield begin, middle_rev, 2 * self._solved(moments) * turn[:, None, None, :]
            begin += middle_rev.size

    def _moments(self, centres_rev: Array) -> Iterator[tuple[ComplexArray, Array]]:
        """Yield ``mean of w u^d x exp(-2 pi j order (angle - middle))``, (window, channel, degree, 1 + k), and middles.

        The first order is zero.
        """
        from scipy.fft import next_fast_len, rfft  # noqa: PLC0415

        per_rev = max(2 * _FINER * float(self.orders[-1]), _FEWEST / self.window.length_rev)
        cells, channels = int(self.window.length_rev * per_rev), self.samples.signal.shape[0]
        padded = int(next_fast_len(math.ceil(_FINER * cells), real=True))
        from_middle = np.arange(cells) - (cells - 1) / 2
        rows = self.window.weights(from_middle / cells)[: self.window.degree + 1]
        table = np.linspace(0, 0.35, 4097)  # linear between them to 1e-8
        rows /= cells * np.interp(np.abs(from_middle) / padded, table, _kernel_response(table))
        columns = self._columns(per_rev, cells, padded)
        starts = np.rint(centres_rev * per_rev - (cells - 1) / 2).astype(np.int64)
        at_once = max(1, _CELLS // (padded * channels * (self.window.degree + 1)))
        for begin in range(0, starts.size, at_once):
            here = starts[begin : begin + at_once]
            windows = np.empty((here.size, channels, cells))
            for run in np.split(np.arange(here.size), np.flatnonzero(np.diff(here) > cells) + 1):
                first = int(here[run[0]])
                grid = self.samples.spread(per_rev, first, int(here[run[-1]]) - first + cells)
                for number in run:
                    windows[number] = grid[:, here[number] - first : here[number] - first + cells]
            spectra = rfft(windows[:, :, None, :] * rows, n=padded, axis=-1)
            moments = np.zeros((*spectra.shape[:-1], 1 + self.orders.size), dtype=np.complex128)
            for column, weight, negative in columns:
                picked = spectra[..., column]
                moments += weight * np.where(negative, np.conj(picked), picked)
            yield moments, np.asarray((here + (cells - 1) / 2) / per_rev, dtype=np.float64)

    def _columns(
        self, per_rev: float, cells: int, padded: int
    ) -> list[tuple[NDArray[np.int64], ComplexArray, NDArray[np.bool_]]]:
        """Return, for each cell of the kernel, a number of the transform for each order, its weight, and its sign."""
        cycles = np.concatenate([[0.0], self.orders]) / per_rev
        at = cycles * padded
        columns: list[tuple[NDArray[np.int64], ComplexArray, NDArray[np.bool_]]] = []
        for offset in range(-(_SPREAD // 2), _SPREAD // 2 + 1):
            number: NDArray[np.int64] = np.rint(at).astype(np.int64) + offset
            turn = np.exp(2j * np.pi * np.remainder(number * ((cells - 1) / 2) / padded, 1.0))
            weight = np.asarray(_kernel(at - number) * turn / _kernel_response(cycles), dtype=np.complex128)
            columns.append((np.abs(number), weight, np.asarray(number < 0)))
        return columns

    def _solved(self, moments: ComplexArray) -> ComplexArray:
        """Return half of Z in powers of u from the normal equations, (window, channel, degree, k)."""
        from scipy.linalg import solve_banded  # noqa: PLC0415

        signed = np.concatenate([-self.orders[::-1], [0.0], self.orders])
        size, count = self.window.degree + 1, self.orders.size
        solved = np.empty((*moments.shape[:-1], count), dtype=np.complex128)
        groups = np.split(np.arange(signed.size), np.flatnonzero(np.diff(signed) > self.window.separated) + 1)
        single = np.array([group[0] for group in groups if group.size == 1 and group[0] > count], dtype=np.int64)
        alone = solve_banded(
            (size - 1, size - 1), self.window.normal_matrix(np.zeros(1))[1], np.eye(size, dtype=np.complex128)
        )
        solved[..., single - count - 1] = np.einsum("de,wcek->wcdk", alone, moments[..., single - count])
        for group in groups:
            if group.size == 1 or group[-1] <= count:
                continue
            of_group = moments[..., np.abs(group - count)]
            right = np.where(group < count, np.conj(of_group), of_group)  # (window, channel, degree, group)
            right = np.moveaxis(right, -1, -2).reshape(*moments.shape[:2], -1)
            band, diagonals = self.window.normal_matrix(signed[group])
            left = solve_banded((band, band), diagonals, right.reshape(-1, right.shape[-1]).T)
            unknowns = left.T.reshape(*moments.shape[:2], group.size, size)
            kept = group > count
            solved[..., group[kept] - count - 1] = np.moveaxis(unknowns, -1, -2)[..., kept]
        return solved
