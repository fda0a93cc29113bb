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
from functools import cache, cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebval
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

_NUTTALL = {3: (0.4243801, -0.4973406, 0.0782793), 4: (0.3635819, -0.4891775, 0.1365995, -0.0106411)}
_BESIDE = (
    0.5  # periods of the window beyond its main lobe, of as many as it has terms; lines twice as far are orthogonal
)
_RISE = 1 / 6  # of a window at an end of the signal, to its largest weight
_REACH_OF_END = 24  # periods of such a window: four of its rise, beyond which its transform is below -70 dB
_FINER = 1.5  # cells to a sample at the Nyquist rate
_SPREAD = 9  # cells of the kernel: its aliases are below 1e-6
_BETA = 2.0 * _SPREAD
_NODES, _WEIGHTS = leggauss(96)
_POINTS, _POINTS_OF_END = 48, 128  # of Gauss's rule over a window: 10 digits for lines as far apart as its reach
_CELLS = 1 << 19  # of all windows that are transformed at once, over their channels
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


@cache
def _gauss(points: int) -> tuple[Array, Array]:
    """Return abscissae from -1 to 1 and weights of Gauss's rule."""
    return leggauss(points)


@dataclass(frozen=True, kw_only=True)
class Window:
    """Window of a projection.

    Attributes
    ----------
    length_rev : float
    degree : int
        Of the amplitudes as polynomials in angle within the window.
    end : int
        0: the weight is zero at both ends of the window. -1, or 1: the window lies at the first, or the last sample of
        a signal, and has its largest weight there, behind a short rise from zero.
    """

    length_rev: float
    degree: int
    end: int = 0

    @property
    def terms(self) -> int:
        """Number of terms of the weight."""
        return 4 if self.degree == 0 else 3

    @property
    def reach(self) -> float:
        """Difference of orders beyond which two lines are taken to be orthogonal."""
        return (_REACH_OF_END if self.end else 2 * (self.terms + _BESIDE)) / self.length_rev

    def weights(self, position: Array) -> Array:
        """Return ``w(u) u^d`` for d = 0 ... 2 degree, (2 degree + 1, n), at positions u from -1/2 to 1/2 (n,)."""
        if self.end:  # half of a cosine window of twice the length
            from_end = 0.5 - self.end * position
            rise = np.clip(from_end / _RISE, 0.0, 1.0)
            shape = chebval(np.cos(np.pi * (1 + from_end)), _NUTTALL[self.terms])
            shape = shape * rise**4 * (35 - 84 * rise + 70 * rise**2 - 20 * rise**3)
        else:
            shape = chebval(np.cos(2 * np.pi * (position + 0.5)), _NUTTALL[self.terms])
        return np.asarray(shape * np.vander(position, 2 * self.degree + 1, increasing=True).T)

    def normal_matrix(self, orders: Array) -> ComplexArray:
        """Return the lower diagonals of the normal matrix of lines at rising signed orders (k,), as scipy takes them.

        Unknowns are ordered by line, then by degree; lines farther apart than `reach` have no entry.
        """
        size, first = self.degree + 1, np.arange(orders.size)
        count = np.searchsorted(orders, orders + self.reach) - first
        ahead = np.arange(int(np.sum(count))) - np.repeat(np.cumsum(count) - count, count)
        row = np.repeat(first, count)
        # orders of a drawing are multiples of a fraction: few of their differences differ
        apart, which = np.unique(np.round(orders[row + ahead] - orders[row], 9), return_inverse=True)
        at, share = _gauss(_POINTS_OF_END if self.end else _POINTS)
        at, quadrature = at / 2, (self.weights(at / 2) * share / 2).T
        moments = (np.exp(-2j * np.pi * self.length_rev * np.multiply.outer(apart, at)) @ quadrature)[which]
        diagonals = np.zeros((int(np.max(count)) * size, orders.size * size), dtype=np.complex128)
        for d in range(size):
            for e in range(size):
                here = ahead * size + e - d >= 0
                diagonals[(ahead * size + e - d)[here], (row * size + d)[here]] = moments[here, d + e]
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
        images = self.orders[self.orders < self.window.reach][::-1]
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

        Instants nearer than an eighth of a window share one; those within half of one of the ends of the signal share
        one that lies there.
        """
        amplitudes = np.empty((self.samples.signal.shape[0], self.orders.size, instants_rev.size), np.complex128)
        for part in self.parts(instants_rev):
            amplitudes[:, :, part.instants] = part.amplitudes(part.projection.moments(part.centres_rev))
        return amplitudes

    def parts(self, instants_rev: Array) -> Iterator["Part"]:
        """Yield the parts of a signal for angles (i,): its ends, and all between, as far as they have some."""
        hop, (first, last) = _NEAR * self.window.length_rev, self.samples.span_rev
        half = self.window.length_rev / 2
        nearest_rev = np.rint(instants_rev / hop) * hop
        ends = np.where(nearest_rev < first + half, -1, np.where(nearest_rev > last - half, 1, 0))
        for end in (-1, 0, 1):
            here = np.flatnonzero(ends == end)
            if here.size:
                about = nearest_rev[here] if not end else np.full(here.size, (first + half, last - half)[end > 0])
                centres_rev, which = np.unique(about, return_inverse=True)
                yield Part(
                    projection=replace(self, window=replace(self.window, end=end)),
                    instants=here,
                    at_rev=instants_rev[here],
                    centres_rev=centres_rev,
                    which=which,
                )

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

        from data_synth.vibration._projection_kernels import interpolate  # noqa: PLC0415  - numba is slow to load

        per_rev, (begin, grid) = self.samples.cells_per_rev, self.samples.grid
        cells = int(self.window.length_rev * per_rev)
        padded = int(next_fast_len(math.ceil(_FINER * cells), real=True))
        from_middle = np.arange(cells) - (cells - 1) / 2
        rows = self.window.weights(from_middle / cells)[: self.window.degree + 1]
        rows /= cells * _kernel_response(from_middle / padded)
        nearest, weights = self._interpolation(per_rev, cells, padded)
        starts = np.rint(centres_rev * per_rev - (cells - 1) / 2).astype(np.int64)
        at_once = max(1, _CELLS // (padded * grid.shape[0] * rows.shape[0]))
        for here in np.split(starts, range(at_once, starts.size, at_once)):
            windows = np.stack([grid[:, start - begin : start - begin + cells] for start in here])
            spectra = rfft(windows[:, :, None, :] * rows, n=padded, axis=-1)
            values = np.empty((*spectra.shape[:-1], 1 + self.orders.size), dtype=np.complex128)
            interpolate(spectra.reshape(-1, spectra.shape[-1]), nearest, weights, values.reshape(-1, values.shape[-1]))
            middle_rev = np.asarray((here + (cells - 1) / 2) / per_rev, dtype=np.float64)
            yield Moments(window=self.window, orders=self.orders, middle_rev=middle_rev, values=values)

    def _interpolation(self, per_rev: float, cells: int, padded: int) -> tuple[NDArray[np.int64], ComplexArray]:
        """Return, for each order, the first number of the transform that the kernel takes, and the weight of each."""
        cycles = np.concatenate([[0.0], self.orders]) / per_rev
        at, response = cycles * padded, _kernel_response(cycles)
        first = np.rint(at).astype(np.int64) - _SPREAD // 2
        numbers = first[:, None] + np.arange(_SPREAD)
        turn = np.exp(2j * np.pi * np.remainder(numbers * ((cells - 1) / 2) / padded, 1.0))
        return first, np.asarray(_kernel(at[:, None] - numbers) * turn / response[:, None], dtype=np.complex128)


@dataclass(frozen=True, kw_only=True)
class Part:
    """Instants of a projection whose windows have one weight.

    Attributes
    ----------
    projection : Projection
    instants : (i,) int array
        Their numbers.
    at_rev : (i,) array
    centres_rev : (window,) array
        Rising.
    which : (i,) int array
        The number of the window of each.
    """

    projection: Projection
    instants: NDArray[np.int_]
    at_rev: Array
    centres_rev: Array
    which: NDArray[np.int_]

    def amplitudes(self, moments: Iterable[Moments]) -> ComplexArray:
        """Return Z (channel, k, i) from the moments of the windows, some at a time."""
        found, begin = [], 0
        for some in moments:
            here = np.flatnonzero((self.which >= begin) & (self.which < begin + some.middle_rev.size))
            which = self.which[here] - begin
            position = (self.at_rev[here] - some.middle_rev[which]) / some.window.length_rev
            powers = np.vander(position, some.window.degree + 1, increasing=True)
            found.append((here, np.einsum("icdk,id->cki", some.coefficients()[which], powers)))
            begin += some.middle_rev.size
        amplitudes = np.empty((*found[0][1].shape[:2], self.instants.size), dtype=np.complex128)
        for here, values in found:
            amplitudes[:, :, here] = values
        return amplitudes
