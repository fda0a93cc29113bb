"""Order-domain projection: complex amplitudes of given orders in a signal, from a smooth window in shaft angle.

In each window of angle the signal is fitted, by weighted least squares, with lines whose amplitudes are polynomials in
angle (local polynomial regression, Fan and Gijbels 1996); lines that the window does not separate are fitted together.
The weight is a cosine window (Nuttall 1981): of four terms (-98 dB) where amplitudes are constant, else the fourth
power of a cosine, whose transform falls by 30 dB an octave. A weak line may stand among lines a thousand times as
strong, so what counts is the transform beyond the lines that are fitted together: -98 dB from ten periods on, against
-71 dB at any distance of the three terms with the lowest side lobes. Sums over samples become discrete Fourier
transforms in angle: samples are spread on an even grid by the kernel ``exp(beta (sqrt(1 - z^2) - 1))``, which does not
alias at any speed (Barnett, Magland and af Klinteberg 2019), and orders are interpolated between the lines of the
transform by the Kaiser-Bessel kernel (Jackson et al. 1991). A factor u in angle is a derivative of the transform, so
the kernel's derivatives give the moments of all degrees from one transform.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.polynomial.chebyshev import cheb2poly
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array

Reals: TypeAlias = NDArray[np.floating[Any]]

_COSINES = {3: (3 / 8, -1 / 2, 1 / 8), 4: (0.3635819, -0.4891775, 0.1365995, -0.0106411)}
_REACH = {3: 10.0, 4: 9.0}  # periods of the window beyond which its transform is below -98 dB
_RISE = 1 / 6  # of a window at an end of the signal, to its largest weight
_REACH_OF_END = 24  # periods of such a window: four of its rise, beyond which its transform is below -81 dB
_FINER = 1.5  # cells to a sample at the Nyquist rate
_SPREAD = 9  # cells of the kernel: its aliases are below 1e-6
_BETA = 2.0 * _SPREAD
_POINTS_OF_KERNEL = 1 << 13  # of a table of a kernel, from its middle to its edge
_NODES, _WEIGHTS = leggauss(96)
_POINTS, _POINTS_OF_END = 48, 128  # of Gauss's rule over a window: 10 digits for lines as far apart as its reach
_POINTS_A_PERIOD = 128  # of a table of the weight's transform: cubic interpolation adds 1e-9
_CELLS = 1 << 19  # of all windows that are transformed at once, over their channels
_GRID = np.float32  # of transforms: their rounding, some 3e-7 of the loudest line, is below the aliases of the kernels
_HOP = 0.25  # of a window, from one to the next: between their middles two of them are blended
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
        from data_synth.vibration._projection_kernels import spread  # noqa: PLC0415  - numba is slow to load

        first, last = self.span_rev
        begin = math.floor(first * self.cells_per_rev) - _SPREAD
        grid = np.zeros((self.signal.shape[0], math.ceil(last * self.cells_per_rev) + _SPREAD + 1 - begin))
        for start in range(0, self.signal.shape[1], _BLOCK):
            here = slice(start, min(start + _BLOCK, self.signal.shape[1]))
            times_s = np.arange(here.start, here.stop) / self.rate_hz
            at = self.revolutions(times_s) * self.cells_per_rev - begin
            steps = self.speed_hz(times_s) * self.cells_per_rev / self.rate_hz
            spread(
                self.signal[:, here] * steps, at, _SPREAD, _kernel(np.linspace(0, _SPREAD / 2, _POINTS_OF_KERNEL)), grid
            )
        return begin, grid.astype(_GRID)


def sum_of_lines(
    orders: Array, amplitudes: ComplexArray, *, instants_s: Array, revolutions: Callable[[Array], Array], times_s: Array
) -> Array:
    """Return the signal (channel, n) of lines whose amplitudes are linear between instants.

    About each instant the lines are a Fourier series of constant amplitude, from a transform as in a projection: orders
    are spread on its lines, and cells of angle interpolated to the samples.

    Parameters
    ----------
    orders : (k,) array
        Above zero.
    amplitudes : (channel, k, i) complex array
    instants_s : (i,) array
        Rising.
    revolutions : callable
        Angle in rev at times in s (n,).
    times_s : (n,) array
        Rising, from the first to the last instant.
    """
    from scipy.fft import irfft, next_fast_len  # noqa: PLC0415

    from data_synth.vibration._projection_kernels import gather, spread  # noqa: PLC0415

    instants_rev, channels = revolutions(instants_s), amplitudes.shape[0]
    per_rev = 2 * _FINER * float(np.max(orders, initial=1.0))
    longest = float(np.max(np.abs(np.diff(instants_rev)))) * per_rev
    cells = int(next_fast_len(math.ceil(2 * _FINER * longest) + 4 * _SPREAD, real=True))
    spreading = _kernel(np.linspace(0, _SPREAD / 2, _POINTS_OF_KERNEL))
    places = orders / per_rev * cells + _SPREAD  # lines below zero are those before
    within = np.minimum(np.arange(cells), cells - np.arange(cells)) / cells
    used = within <= 1 / (2 * _FINER) + _SPREAD / cells
    window = np.zeros(cells)
    window[used] = cells / 2 / _interpolating_response(within[used])
    scaled = amplitudes / _kernel_response(orders / per_rev)[:, None]
    edges = np.searchsorted(times_s, instants_s)
    edges[-1] = times_s.size
    signal = np.zeros((channels, times_s.size))
    for number, at_rev in enumerate(instants_rev):
        lines = np.zeros((channels, cells // 2 + 2 * _SPREAD), dtype=np.complex128)
        turned = scaled[:, :, number] * np.exp(2j * np.pi * np.remainder(orders * at_rev, 1.0))
        spread(turned, places, _SPREAD, _interpolating_kernel()[0], lines)
        folded = lines[:, _SPREAD : _SPREAD + cells // 2 + 1].copy()
        folded[:, : _SPREAD + 1] += lines[:, _SPREAD::-1].conj()
        grid = irfft(folded, n=cells, axis=1) * window
        first, last = max(number - 1, 0), min(number + 1, instants_s.size - 1)
        here = slice(edges[first], edges[last])
        times = times_s[here]
        weights = np.interp(times, instants_s[first : last + 1], (np.arange(first, last + 1) == number).astype(float))
        own = np.zeros((channels, times.size))
        gather(grid, (revolutions(times) - at_rev) * per_rev, weights, _SPREAD, spreading, own)
        signal[:, here] += own
    return signal


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
def _interpolating_kernel() -> Array:
    """Return the Kaiser-Bessel kernel and its first two derivatives, (3, n), from its middle to its edge.

    Linear interpolation between its points is within 2e-7 of the kernel's largest derivative.
    """
    from scipy.special import i0e, i1e  # noqa: PLC0415

    z = np.linspace(0, 1, _POINTS_OF_KERNEL)
    # d/dx of I_n(x) / x^n is I_(n+1)(x) / x^n; at the edge, where x is 0, I_n(x) / x^n is 1 / (2^n n!)
    x = np.maximum(_BETA * np.sqrt(1 - z**2), 0.01)
    scale = np.exp(x - _BETA) / i0e(_BETA)
    zeroth, first = scale * i0e(x), scale * i1e(x) / x
    second = (zeroth - 2 * first) / x**2  # I2 = I0 - 2 I1 / x
    slope = 2 * _BETA / _SPREAD  # of beta z
    return np.stack([zeroth, -slope * _BETA * z * first, slope**2 * ((_BETA * z) ** 2 * second - first)])


def _interpolating_response(cycles_per_line: Reals) -> Reals:
    """Return the Fourier transform of the Kaiser-Bessel kernel, within its pass band."""
    from scipy.special import i0e  # noqa: PLC0415

    root = np.sqrt(_BETA**2 - (np.pi * _SPREAD * cycles_per_line) ** 2)  # above 15: sinh is half of exp
    return np.asarray(np.exp(root - _BETA) / root * (_SPREAD / 2 / float(i0e(_BETA))))


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
    ridge : float
        Share by which the diagonal of the normal matrix is larger (ridge regression, Hoerl and Kennard 1970): this of
        slopes and curvatures, a hundredth of it of the amplitudes in the middle. Lines that the window does not
        separate share the signal, and their amplitudes change little. Larger where that does not determine them.
    """

    length_rev: float
    degree: int
    end: int = 0
    ridge: float = 0.0

    @property
    def terms(self) -> int:
        """Number of terms of the weight."""
        return 4 if self.degree == 0 else 3

    @property
    def reach(self) -> float:
        """Difference of orders beyond which two lines are taken to be orthogonal."""
        return (_REACH_OF_END if self.end else _REACH[self.terms]) / self.length_rev

    def shape(self, position: Reals) -> Reals:
        """Return the weight w (n,) at positions u from -1/2 to 1/2 (n,)."""
        from_end = 0.5 - self.end * position  # at an end, half of a cosine window of twice the length
        cosine = np.cos(np.pi * (1 + from_end)) if self.end else -np.cos(2 * np.pi * position)
        shape = np.zeros_like(position)
        for coefficient in cheb2poly(_COSINES[self.terms])[::-1].tolist():
            shape = shape * cosine + coefficient
        if not self.end:
            return np.asarray(shape)
        rise = np.clip(from_end / _RISE, 0.0, 1.0)
        rise_squared = rise * rise
        return np.asarray(shape * rise_squared**2 * (35 - 84 * rise + rise_squared * (70 - 20 * rise)))

    def normal_matrix(self, orders: Array) -> ComplexArray:
        """Return the lower diagonals of the normal matrix of lines at rising signed orders (k,), as scipy takes them.

        Unknowns are ordered by line, then by degree; lines farther apart than `reach` have no entry.
        """
        size, first = self.degree + 1, np.arange(orders.size)
        count = np.searchsorted(orders, orders + self.reach) - first
        ahead = np.arange(int(np.sum(count))) - np.repeat(np.cumsum(count) - count, count)
        row = np.repeat(first, count)
        # cubic Hermite interpolation: the derivative of a moment is -2 pi j times the next one
        table = _moments_of_weight(replace(self, length_rev=1.0, ridge=0.0))
        at = (orders[row + ahead] - orders[row]) * self.length_rev * _POINTS_A_PERIOD
        point = np.floor(at).astype(np.int64)
        t, slope = at - point, -2j * np.pi / _POINTS_A_PERIOD
        shares = (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2 * slope, t**2 * (3 - 2 * t), t**2 * (t - 1) * slope
        ends = [(table[:, point + side][:-1], table[:, point + side][1:]) for side in (0, 1)]
        moments = sum(share * part for share, part in zip(shares, (*ends[0], *ends[1]), strict=True))
        diagonals = np.zeros((int(np.max(count)) * size, orders.size * size), dtype=np.complex128)
        for d in range(size):
            for e in range(size):
                here = ahead * size + e - d >= 0
                diagonals[(ahead * size + e - d)[here], (row * size + d)[here]] = moments[d + e, here]
            diagonals[0, d::size] *= 1 + (self.ridge if d else self.ridge / 100)
        return diagonals


@cache
def _moments_of_weight(window: Window) -> ComplexArray:
    """Return the moments of the weight of a window of 1 rev, (2 degree + 2, n), at orders ``n / _POINTS_A_PERIOD``."""
    at, share = leggauss(_POINTS_OF_END if window.end else _POINTS)
    at, orders = at / 2, np.arange(math.ceil(window.reach * _POINTS_A_PERIOD) + 2) / _POINTS_A_PERIOD
    quadrature = window.shape(at) * share / 2 * np.vander(at, 2 * window.degree + 2, increasing=True).T
    return np.asarray(quadrature @ np.exp(-2j * np.pi * np.multiply.outer(at, orders)))


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


@dataclass(frozen=True, kw_only=True)
class LeastSquares:
    """Lines at given orders in windows of one length, fitted to moments.

    Attributes
    ----------
    window : Window
    orders : (k,) array
        Rising, above zero.
    """

    window: Window
    orders: Array

    @cached_property
    def _signed(self) -> tuple[int, Array]:
        """Orders that are fitted, and how many of them are negative.

        Lines at negative orders, as far as they reach those at positive ones, and the mean are fitted with the others.
        """
        images = self.orders[self.orders < self.window.reach][::-1]
        return images.size, np.concatenate([-images, [0.0], self.orders])

    @cached_property
    def _factor(self) -> ComplexArray:
        """Cholesky factor of the normal matrix, the same for every window."""
        from data_synth.vibration._projection_kernels import factorise  # noqa: PLC0415  - numba is slow to load

        window = self.window
        while True:
            lower = window.normal_matrix(self._signed[1])
            factorise(lower)
            if np.isfinite(lower[0, -1]):
                return lower
            if not 0 < window.ridge < 1:
                raise np.linalg.LinAlgError("lines too near each other for the window; leave out those that it merges.")
            # of many near lines, entries beyond the reach add up: without them the matrix may be indefinite
            window = replace(window, ridge=10 * window.ridge)

    def coefficients(self, moments: Moments, rows: NDArray[np.int_]) -> ComplexArray:
        """Return Z in powers of u, (i, channel, degree, k), of some lines in each window."""
        from scipy.linalg import cho_solve_banded  # noqa: PLC0415

        (images, signed), values = self._signed, moments.values
        size, count = self.window.degree + 1, values.shape[0] * values.shape[1]
        right = np.concatenate([np.conj(values[..., images:0:-1]), values], axis=-1)
        right = np.moveaxis(right.reshape(count, size, signed.size), 0, -1)  # (degree, line, window and channel)
        right = np.moveaxis(right, 0, 1).reshape(signed.size * size, count)
        solved = cho_solve_banded((self._factor, True), right, overwrite_b=True, check_finite=False)
        found = solved.reshape(signed.size, size, count)[images + 1 + rows].T  # (window and channel, degree, line)
        turn = np.exp(-2j * np.pi * np.remainder(np.multiply.outer(moments.middle_rev, self.orders[rows]), 1.0))
        return np.asarray(2 * found.reshape(*values.shape[:-1], -1) * turn[:, None, None, :])


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

    def amplitudes(self, instants_rev: Array, rows: NDArray[np.int_] | None = None) -> ComplexArray:
        """Return Z (channel, k, i) at angles (i,), ``x = Re{Z exp(2 pi j order angle)}``, of all lines or of some.

        Between the middles of two windows, a quarter of their length apart, Z is blended from one to the other, so that
        what a polynomial misses to third degree cancels; instants within half a window of one of the ends of the signal
        share one that lies there.
        """
        rows = np.arange(self.orders.size) if rows is None else rows
        amplitudes = np.empty((self.samples.signal.shape[0], rows.size, instants_rev.size), np.complex128)
        for part in self.parts(instants_rev):
            amplitudes[:, :, part.instants] = part.amplitudes(part.projection.moments(part.centres_rev), rows)
        return amplitudes

    def parts(self, instants_rev: Array) -> Iterator["Part"]:
        """Yield the parts of a signal for angles (i,): its ends, and all between, as far as they have some."""
        half = self.window.length_rev / 2
        first, last = self.samples.span_rev[0] + half, self.samples.span_rev[1] - half
        ends = np.where(instants_rev < first, -1, np.where(instants_rev > last, 1, 0))
        for end in (-1, 0, 1):
            here = np.flatnonzero(ends == end)
            if not here.size:
                continue
            centres_rev, which = np.array([(first, last)[end > 0]]), np.zeros(here.size, dtype=np.int64)
            share = np.zeros(here.size)
            if not end and last > first:
                hops = math.ceil((last - first) / (_HOP * self.window.length_rev))
                place = (instants_rev[here] - first) / (last - first) * hops
                which = np.minimum(place.astype(np.int64), hops - 1)
                share = place - which
                used, which = np.unique(np.concatenate([which, which + 1]), return_inverse=True)
                centres_rev, which = first + used * (last - first) / hops, which[: here.size]
            yield Part(
                projection=replace(self, window=replace(self.window, end=end)),
                instants=here,
                at_rev=instants_rev[here],
                centres_rev=centres_rev,
                which=which,
                share=share,
            )

    def power(self, centres_rev: Array) -> Array:
        """Return the mean of ``|Z|^2`` (channel, k) in windows about centres (i,), each line taken to stand alone."""
        total = np.zeros((self.samples.signal.shape[0], self.orders.size))
        for part in replace(self, window=replace(self.window, degree=0)).moments(centres_rev):
            total += np.sum(np.abs(2 * part.values[:, :, 0, 1:] / _COSINES[4][0]) ** 2, axis=0)
        return np.asarray(total / centres_rev.size)

    def mean(self, centres_rev: Array) -> ComplexArray:
        """Return the mean Z (channel, k) of windows about centres (i,)."""
        lines = LeastSquares(window=self.window, orders=self.orders)
        rows = np.arange(self.orders.size)
        parts = [np.sum(lines.coefficients(part, rows)[:, :, 0], axis=0) for part in self.moments(centres_rev)]
        return np.asarray(np.sum(parts, axis=0) / centres_rev.size)

    def moments(self, centres_rev: Array) -> Iterator[Moments]:
        """Yield the moments of windows about centres (i,), some at a time."""
        from scipy.fft import next_fast_len, rfft  # noqa: PLC0415

        from data_synth.vibration._projection_kernels import interpolate  # noqa: PLC0415  - numba is slow to load

        per_rev, (begin, grid) = self.samples.cells_per_rev, self.samples.grid
        cells, degree = int(self.window.length_rev * per_rev), self.window.degree
        padded = int(next_fast_len(math.ceil(_FINER * cells), real=True))
        position = ((np.arange(cells) - (cells - 1) / 2) / cells).astype(_GRID)
        weights = self.window.shape(position) / (cells * _interpolating_response(position * (cells / padded)))
        cycles = np.concatenate([[0.0], self.orders]) / per_rev
        middle_turns = (cells - 1) / 2 / padded  # of the phase of the window's middle, from line to line
        derivative = 1j * padded / (2 * np.pi * cells)  # of the transform, for a factor u
        factor = derivative ** np.arange(degree + 1)[:, None] / _kernel_response(cycles)
        starts = np.rint(centres_rev * per_rev - (cells - 1) / 2).astype(np.int64)
        at_once = max(1, _CELLS // (padded * grid.shape[0]))
        for here in np.split(starts, range(at_once, starts.size, at_once)):
            windows = np.stack([grid[:, start - begin : start - begin + cells] for start in here])
            spectra = rfft(windows * weights, n=padded, axis=-1)
            values = np.empty((*spectra.shape[:-1], degree + 1, 1 + self.orders.size), dtype=np.complex128)
            flat = values.reshape(-1, *values.shape[-2:])
            flat_spectra = np.asarray(spectra.reshape(-1, spectra.shape[-1]), dtype=np.complex64)
            interpolate(flat_spectra, cycles * padded, middle_turns, _SPREAD, _interpolating_kernel(), flat)
            values *= factor
            middle_rev = np.asarray((here + (cells - 1) / 2) / per_rev, dtype=np.float64)
            yield Moments(window=self.window, orders=self.orders, middle_rev=middle_rev, values=values)


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
        The number of the window of each, or of the first of two.
    share : (i,) array
        Of the second.
    """

    projection: Projection
    instants: NDArray[np.int_]
    at_rev: Array
    centres_rev: Array
    which: NDArray[np.int_]
    share: Array

    def amplitudes(self, moments: Iterable[Moments], rows: NDArray[np.int_]) -> ComplexArray:
        """Return Z (channel, k, i) of some lines from the moments of the windows, some at a time."""
        channels, begin, lines = self.projection.samples.signal.shape[0], 0, None
        amplitudes = np.zeros((channels, rows.size, self.instants.size), dtype=np.complex128)
        for some in moments:
            lines = lines or LeastSquares(window=some.window, orders=some.orders)
            coefficients, count = lines.coefficients(some, rows), some.middle_rev.size
            for which, weight in ((self.which, 1 - self.share), (self.which + 1, self.share)):
                here = np.flatnonzero((which >= begin) & (which < begin + count) & (weight > 0))
                window = which[here] - begin
                position = (self.at_rev[here] - some.middle_rev[window]) / some.window.length_rev
                powers = weight[here, None] * np.vander(position, some.window.degree + 1, increasing=True)
                amplitudes[:, :, here] += np.einsum("icdk,id->cki", coefficients[window], powers)
            begin += count
        return amplitudes
