"""Order-domain projection: complex amplitudes of given orders in a signal, from a smooth window in shaft angle.

In each window of angle the signal is fitted, by weighted least squares, with lines whose amplitudes are polynomials in
angle (local polynomial regression, Fan and Gijbels 1996); lines that the window does not separate are fitted together.
The weight is a cosine window (Nuttall 1981), so lines four and more of its periods apart are orthogonal: of four terms
(-98 dB) where amplitudes are constant, else of three (-71 dB), which is wider, so that lines may be nearer and
polynomials are better known at the ends of a record. Sums over samples become discrete Fourier transforms in angle:
samples are spread on an even grid by the kernel ``exp(beta (sqrt(1 - z^2) - 1))``, which does not alias at any speed,
and orders are interpolated between the lines of the transform by the same kernel (Barnett, Magland and af Klinteberg
2019).
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebval
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_NUTTALL = {3: (0.4243801, -0.4973406, 0.0782793), 4: (0.3635819, -0.4891775, 0.1365995, -0.0106411)}
_BESIDE = 0.5  # periods of the window beyond its main lobe, of as many as it has terms: lines farther are orthogonal
_FINER = 1.5  # cells to a sample at the Nyquist rate
_SPREAD = 9  # cells of the kernel: its aliases are below 1e-6
_BETA = 2.0 * _SPREAD
_NODES, _WEIGHTS = leggauss(96)
_POINTS = 48  # of Gauss's rule over a window: exact to rounding for lines up to 9 periods apart
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
    top_order : float
        Highest order that is projected.
    """

    signal: Array
    rate_hz: float
    revolutions: Callable[[Array], Array]
    speed_hz: Callable[[Array], Array]
    top_order: float

    @cached_property
    def span_rev(self) -> tuple[float, float]:
        """Angle of the first and behind the last sample."""
        first, last = self.revolutions(np.array([0.0, self.signal.shape[1] / self.rate_hz]))
        return float(first), float(last)

    @property
    def cells_per_rev(self) -> float:
        """Cells of the grid to a revolution."""
        return 2 * _FINER * self.top_order

    @cached_property
    def grid(self) -> tuple[int, Array]:
        """Number of the first cell of an even grid of angle, and signal times ``d angle`` on it, (channel, cell)."""
        first, last = self.span_rev
        begin = math.floor(first * self.cells_per_rev) - _SPREAD
        grid = np.zeros((self.signal.shape[0], math.ceil(last * self.cells_per_rev) + _SPREAD + 1 - begin))
        for start in range(0, self.signal.shape[1], _BLOCK):
            here = slice(start, min(start + _BLOCK, self.signal.shape[1]))
            times_s = np.arange(here.start, here.stop) / self.rate_hz
            at = self.revolutions(times_s) * self.cells_per_rev - begin
            steps = self.speed_hz(times_s) * self.cells_per_rev / self.rate_hz
            nearest = np.rint(at).astype(np.int64)
            low = int(nearest[0]) - _SPREAD // 2
            for offset in range(-(_SPREAD // 2), _SPREAD // 2 + 1):
                share = steps * _kernel(at - (nearest + offset))
                for row, values in zip(grid, self.signal[:, here], strict=True):
                    added = np.bincount(nearest + offset - low, weights=share * values)
                    row[low : low + added.size] += added
        return begin, grid


def _kernel(cells: Array) -> Array:
    """Return the spreading kernel at a distance in cells."""
    return np.asarray(np.exp(_BETA * (np.sqrt(np.maximum(1 - (2 * cells / _SPREAD) ** 2, 0.0)) - 1)))


_RESPONSE_AT = np.linspace(0, 0.35, 4097)  # cycles per cell; linear between them to 1e-8
_RESPONSE = np.cos(np.pi * _SPREAD * np.multiply.outer(_RESPONSE_AT, _NODES)) @ (
    _WEIGHTS * _SPREAD / 2 * _kernel(_SPREAD / 2 * _NODES)
)


def _kernel_response(cycles_per_cell: Array) -> Array:
    """Return the Fourier transform of the kernel."""
    return np.asarray(np.interp(np.abs(cycles_per_cell), _RESPONSE_AT, _RESPONSE))


@dataclass(frozen=True, kw_only=True)
class Window:
    """Window of a projection: its length in rev, and the degree of the amplitudes in angle within it."""

    length_rev: float
    degree: int

    @property
    def terms(self) -> int:
        """Number of terms of the weight."""
        return 4 if self.degree == 0 else 3

    @property
    def separated(self) -> float:
        """Difference of orders beyond which two lines are orthogonal."""
        return (self.terms + _BESIDE) / self.length_rev

    def weights(self, position: Array) -> Array:
        """Return ``w(u) u^d`` for d = 0 ... 2 degree, (2 degree + 1, n), at positions u from -1/2 to 1/2 (n,)."""
        shape = chebval(np.cos(2 * np.pi * (position + 0.5)), _NUTTALL[self.terms])
        return np.asarray(shape * np.vander(position, 2 * self.degree + 1, increasing=True).T)

    def normal_matrix(self, orders: Array) -> ComplexArray:
        """Return the lower diagonals of the normal matrix of lines at rising signed orders (k,), as scipy takes them.

        Unknowns are ordered by line, then by degree; lines farther apart than twice `separated` have no entry.
        """
        size, reach = self.degree + 1, 2 * self.separated
        neighbours = int(np.max(np.searchsorted(orders, orders + reach) - np.arange(orders.size))) - 1
        diagonals = np.zeros(((neighbours + 1) * size, orders.size * size), dtype=np.complex128)
        at, share = leggauss(_POINTS)
        at, share = at[at > 0] / 2, share[at > 0]  # even in u, or odd
        quadrature = (self.weights(at) * share).T
        for ahead in range(neighbours + 1):
            row = np.arange(orders.size - ahead)
            apart = orders[row + ahead] - orders[row]
            turns = 2 * np.pi * self.length_rev * np.multiply.outer(apart, at)
            even, odd = (
                np.where(apart < reach, part.T, 0.0)
                for part in (np.cos(turns) @ quadrature, np.sin(turns) @ quadrature)
            )
            for d in range(size):
                for e in range(0 if ahead else d, size):
                    moment = even[d + e] if (d + e) % 2 == 0 else -1j * odd[d + e]
                    diagonals[ahead * size + e - d, row * size + d] = moment
        return diagonals


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Weighted sums over windows of a signal, from which amplitudes of lines follow.

    Attributes
    ----------
    window : Window
    orders : (k,) array
        Rising, above zero.
    middle_rev : (i,) array
        Middles of the windows.
    values : (i, channel, degree + 1, 1 + k) complex array
        Mean of ``w u^d x exp(-2 pi j order (angle - middle))``; the first order is zero.
    """

    window: Window
    orders: Array
    middle_rev: Array
    values: ComplexArray

    @classmethod
    def joined(cls, parts: Iterable["Moments"]) -> "Moments":
        """Return the moments of all windows of a projection."""
        first, *others = parts
        every = [first, *others]
        return replace(
            first,
            middle_rev=np.concatenate([part.middle_rev for part in every]),
            values=np.concatenate([part.values for part in every]),
        )

    def of(self, numbers: NDArray[np.int_], *, degree: int) -> "Moments":
        """Return the moments of these lines alone, by their rising numbers, for a lower degree above 0 or the same."""
        with_zero = np.concatenate([[0], 1 + numbers])
        return replace(
            self,
            window=replace(self.window, degree=degree),
            orders=self.orders[numbers],
            values=self.values[:, :, : degree + 1, with_zero],
        )

    def coefficients(self) -> ComplexArray:
        """Return Z in powers of u, (i, channel, degree, k), of all lines by least squares in each window."""
        from scipy.linalg import cho_solve_banded, cholesky_banded  # noqa: PLC0415

        # lines at negative orders as far as they reach those at positive ones, and the mean, are fitted with the others
        images = self.orders[self.orders < 2 * self.window.separated][::-1]
        signed = np.concatenate([-images, [0.0], self.orders])
        size, count = self.window.degree + 1, self.values.shape[0] * self.values.shape[1]
        right = np.concatenate([np.conj(self.values[..., images.size : 0 : -1]), self.values], axis=-1)
        right = np.moveaxis(right.reshape(count, size, signed.size), 0, -1)  # (degree, line, window and channel)
        right = np.moveaxis(right, 0, 1).reshape(signed.size * size, count)
        factor = cholesky_banded(self.window.normal_matrix(signed), lower=True, check_finite=False)
        solved = cho_solve_banded((factor, True), right, overwrite_b=True, check_finite=False)
        found = solved.reshape(signed.size, size, count)[images.size + 1 :].T  # (window and channel, degree, line)
        turn = np.exp(-2j * np.pi * np.remainder(np.multiply.outer(self.middle_rev, self.orders), 1.0))
        return np.asarray(2 * found.reshape(*self.values.shape[:-1], -1) * turn[:, None, None, :])


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Projection of a signal on lines at given orders, in windows of one length.

    Attributes
    ----------
    samples : AngleSamples
    orders : (k,) array
        Rising, above zero, up to the top order of the samples.
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
        centres_rev, which = self.windows_about(instants_rev)
        return amplitudes_of(self.moments(centres_rev), instants_rev, which)

    def windows_about(self, instants_rev: Array) -> tuple[Array, NDArray[np.int_]]:
        """Return the rising middles of windows for angles (i,), and the number (i,) of that of each angle."""
        hop, (first, last) = _NEAR * self.window.length_rev, self.samples.span_rev
        half = self.window.length_rev / 2
        centres_rev = np.clip(np.rint(instants_rev / hop) * hop, first + half, max(first + half, last - half))
        return np.unique(centres_rev, return_inverse=True)

    def power(self, centres_rev: Array) -> Array:
        """Return the mean of ``|Z|^2`` (channel, k) in windows about centres (i,), each line taken to stand alone."""
        total = np.zeros((self.samples.signal.shape[0], self.orders.size))
        for part in replace(self, window=replace(self.window, degree=0)).moments(centres_rev):
            total += np.sum(np.abs(2 * part.values[:, :, 0, 1:] / _NUTTALL[4][0]) ** 2, axis=0)
        return np.asarray(total / centres_rev.size)

    def mean(self, centres_rev: Array) -> ComplexArray:
        """Return the mean Z (channel, k) of windows about centres (i,)."""
        parts = [np.sum(part.coefficients()[:, :, 0], axis=0) for part in self.moments(centres_rev)]
        return np.asarray(np.sum(parts, axis=0) / centres_rev.size)

    def moments(self, centres_rev: Array) -> Iterator[Moments]:
        """Yield the moments of windows about centres (i,), some at a time."""
        from scipy.fft import next_fast_len, rfft  # noqa: PLC0415

        per_rev, (begin, grid) = self.samples.cells_per_rev, self.samples.grid
        cells = int(self.window.length_rev * per_rev)
        padded = int(next_fast_len(math.ceil(_FINER * cells), real=True))
        from_middle = np.arange(cells) - (cells - 1) / 2
        rows = self.window.weights(from_middle / cells)[: self.window.degree + 1]
        rows /= cells * _kernel_response(from_middle / padded)
        columns = self._columns(per_rev, cells, padded)
        starts = np.rint(centres_rev * per_rev - (cells - 1) / 2).astype(np.int64)
        at_once = max(1, _CELLS // (padded * grid.shape[0] * rows.shape[0]))
        for here in np.split(starts, range(at_once, starts.size, at_once)):
            windows = np.stack([grid[:, start - begin : start - begin + cells] for start in here])
            spectra = rfft(windows[:, :, None, :] * rows, n=padded, axis=-1)
            values = np.zeros((*spectra.shape[:-1], 1 + self.orders.size), dtype=np.complex128)
            for column, weight, negative in columns:
                picked = spectra[..., column]
                picked[..., negative] = picked[..., negative].conj()
                values += weight * picked
            middle_rev = np.asarray((here + (cells - 1) / 2) / per_rev, dtype=np.float64)
            yield Moments(window=self.window, orders=self.orders, middle_rev=middle_rev, values=values)

    def _columns(
        self, per_rev: float, cells: int, padded: int
    ) -> list[tuple[NDArray[np.int64], ComplexArray, NDArray[np.int_]]]:
        """Return, for each cell of the kernel, a number of the transform for each order, its weight, and conjugates."""
        cycles = np.concatenate([[0.0], self.orders]) / per_rev
        at, response = cycles * padded, _kernel_response(cycles)
        columns: list[tuple[NDArray[np.int64], ComplexArray, NDArray[np.int_]]] = []
        for offset in range(-(_SPREAD // 2), _SPREAD // 2 + 1):
            number: NDArray[np.int64] = np.rint(at).astype(np.int64) + offset
            turn = np.exp(2j * np.pi * np.remainder(number * ((cells - 1) / 2) / padded, 1.0))
            weight = np.asarray(_kernel(at - number) * turn / response, dtype=np.complex128)
            columns.append((np.abs(number), weight, np.flatnonzero(number < 0)))
        return columns


def amplitudes_of(parts: Iterable[Moments], instants_rev: Array, which: NDArray[np.int_]) -> ComplexArray:
    """Return Z (channel, k, i) at angles (i,) from windows, of which `which` (i,) has the number for each."""
    found, begin = [], 0
    for part in parts:
        here = np.flatnonzero((which >= begin) & (which < begin + part.middle_rev.size))
        position = (instants_rev[here] - part.middle_rev[which[here] - begin]) / part.window.length_rev
        powers = np.vander(position, part.window.degree + 1, increasing=True)
        found.append((here, np.einsum("icdk,id->cki", part.coefficients()[which[here] - begin], powers)))
        begin += part.middle_rev.size
    amplitudes = np.empty((*found[0][1].shape[:2], instants_rev.size), dtype=np.complex128)
    for here, values in found:
        amplitudes[:, :, here] = values
    return amplitudes
