"""Interpolation of a shaft's angle: a quintic spline, with monotone pieces where it would reverse."""

from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator, PPoly, make_interp_spline

from signals._checks import Array

_DEGREE = 5
_HALVINGS = 4  # of a cell, before its slope is bounded by its Bernstein coefficients
_ROUNDING = 1e-12
_FEWEST = 4  # knots between two broken cells for a spline


def build_curve(
    times: Array, revolutions: Array, *, breaks: NDArray[np.bool_], states: tuple[Array, Array] | None
) -> tuple[PPoly, NDArray[np.bool_]]:
    """Return the curve, and which cells between knots are not splines but monotone pieces ("broken").

    Each run of cells between broken ones has a spline of its own. Cells in which a spline reverses are broken, and the
    splines fitted again, until none reverses.

    Parameters
    ----------
    times, revolutions : (n,) arrays
    breaks : (n - 1,) array
        Cells broken from the start, as those in which the shaft stands.
    states : ((n,), (n,)) arrays, optional
        Speed in rev/s and acceleration in rev/s^2 at the knots, for quintic Hermite cells instead of splines.
    """
    broken = breaks.copy()
    rises = np.diff(revolutions)
    steps = np.diff(times)
    while True:
        for first, last in _spline_runs(broken):
            if last - first + 1 < _FEWEST and last - first + 1 < times.size:
                broken[first:last] = True
        coefficients = np.zeros((_DEGREE + 1, steps.size))
        for first, last in _spline_runs(broken):
            part = slice(first, last + 1)
            if states is None:
                coefficients[:, first:last] = _spline(times[part], revolutions[part])
            else:
                coefficients[:, first:last] = _hermite(times[part], revolutions[part], states[0][part], states[1][part])
        reversed_ = _reverses(coefficients, steps, rises) & ~broken
        if not reversed_.any():
            break
        broken |= reversed_
    return _joined(times, revolutions, coefficients, broken), broken


def _spline_runs(broken: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last knot of each run of cells that are not broken."""
    edges = np.diff(np.concatenate([[True], broken, [True]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges < 0).tolist(), np.flatnonzero(edges > 0).tolist(), strict=True))


def _spline(times: Array, revolutions: Array) -> Array:
    """Return the spline coefficients about the left knot of each cell, highest power first, (6, cells)."""
    degree = 5 if times.size > 5 else (3 if times.size > 3 else 1)  # noqa: PLR2004
    spline = make_interp_spline(times, revolutions, k=degree)
    coefficients = np.zeros((_DEGREE + 1, times.size - 1))
    for power in range(degree + 1):
        coefficients[_DEGREE - power] = spline(times[:-1], nu=power) / factorial(power)
    coefficients[_DEGREE] = revolutions[:-1]
    return coefficients


def _hermite(times: Array, revolutions: Array, speed: Array, acceleration: Array) -> Array:
    """Return the quintic Hermite coefficients of each cell, highest power first, (6, cells)."""
    h = np.diff(times)
    angle = np.diff(revolutions) - (speed[:-1] + acceleration[:-1] * h / 2) * h
    slope = (np.diff(speed) - acceleration[:-1] * h) * h
    bend = np.diff(acceleration) * h**2
    return np.stack(
        [
            (6 * angle - 3 * slope + bend / 2) / h**5,
            (-15 * angle + 7 * slope - bend) / h**4,
            (10 * angle - 4 * slope + bend / 2) / h**3,
            acceleration[:-1] / 2,
            speed[:-1],
            revolutions[:-1],
        ]
    )


def _reverses(coefficients: Array, steps: Array, rises: Array) -> NDArray[np.bool_]:
    """Return whether each cell's slope may have the sign opposite to its rise, or the cell has no rise.

    A polynomial lies between the extremes of its Bernstein coefficients; halving the cells tightens these bounds.
    """
    sign = np.sign(rises)
    powers = np.arange(_DEGREE, 0, -1)
    slope = (powers[:, None] * coefficients[:-1] * steps ** powers[:, None])[::-1] * sign  # of u in 0..1, rising powers
    degree = _DEGREE - 1
    to_bernstein = np.array(
        [
            [factorial(i) / factorial(i - j) * factorial(degree - j) / factorial(degree) if j <= i else 0.0
             for j in range(degree + 1)]
            for i in range(degree + 1)
        ]
    )  # fmt: skip
    bounds = to_bernstein @ slope
    limit = -_ROUNDING * np.abs(bounds).max(axis=0)
    doubtful = np.flatnonzero(bounds.min(axis=0) < limit)
    found = np.zeros(steps.size, dtype=np.bool_)
    pieces = bounds[:, doubtful][:, None]
    for _ in range(_HALVINGS):
        pieces = np.concatenate(_halved(pieces), axis=1)
    found[doubtful] = pieces.min(axis=(0, 1)) < limit[doubtful]
    # a cell without a rise is a standstill, except between opposite directions, where the shaft reverses
    before, after = np.concatenate([[0], sign[:-1]]), np.concatenate([sign[1:], [0]])
    found[(sign == 0) & (before * after >= 0)] = True
    return found


def _halved(bounds: Array) -> tuple[Array, Array]:
    """Return the Bernstein coefficients of both halves (de Casteljau)."""
    left, right = [bounds[0]], [bounds[-1]]
    while bounds.shape[0] > 1:
        bounds = (bounds[:-1] + bounds[1:]) / 2
        left.append(bounds[0])
        right.append(bounds[-1])
    return np.stack(left), np.stack(right[::-1])


def _joined(times: Array, revolutions: Array, coefficients: Array, broken: NDArray[np.bool_]) -> PPoly:
    """Return the curve of the splines, with monotone pieces of continuous slope in the broken cells."""
    if not broken.any():
        return PPoly(coefficients, times, extrapolate=True)
    steps, rises = np.diff(times), np.diff(revolutions)
    slopes = _knot_slopes(times, revolutions, coefficients, broken)
    breakpoints, pieces = [], []
    for cell in range(steps.size):
        if broken[cell]:
            widths, found = _monotone_piece(
                float(revolutions[cell]), float(rises[cell]), float(steps[cell]), *slopes[cell : cell + 2].tolist()
            )
            breakpoints += [float(times[cell]) + w for w in widths]
            pieces += found
        else:
            breakpoints.append(float(times[cell]))
            pieces.append(coefficients[:, cell])
    return PPoly(np.array(pieces).T, np.array([*breakpoints, float(times[-1])]), extrapolate=True)


def _knot_slopes(times: Array, revolutions: Array, coefficients: Array, broken: NDArray[np.bool_]) -> Array:
    """Return the slope at each knot: of the adjacent spline, zero at a standstill, else after Fritsch and Butland."""
    steps, rises = np.diff(times), np.diff(revolutions)
    slopes = np.asarray(PchipInterpolator(times, revolutions).derivative()(times), dtype=np.float64)
    powers = np.arange(_DEGREE, 0, -1)[:, None]
    ends = (powers * coefficients[:-1] * steps ** (powers - 1)).sum(axis=0)
    whole = np.flatnonzero(~broken)
    slopes[whole + 1] = ends[whole]
    slopes[whole] = coefficients[_DEGREE - 1, whole]
    standstill = np.flatnonzero(broken & (rises == 0))
    slopes[standstill] = slopes[standstill + 1] = 0.0
    return slopes


def _monotone_piece(
    start: float, rise: float, step: float, before: float, after: float
) -> tuple[list[float], list[Array]]:
    """Return the times from the left knot at which the pieces of a broken cell begin, and their coefficients.

    The monotone cubic where both slopes are at most three times the mean (Fritsch and Carlson 1980). Else constant
    deceleration, constant speed and constant acceleration, each ramp at most a third of the cell.
    """
    sign = np.sign(rise)
    before, after = max(sign * before, 0.0) * sign, max(sign * after, 0.0) * sign
    mean = rise / step
    if max(abs(before), abs(after)) <= 3 * abs(mean):
        cubic = (before + after - 2 * mean) / step**2
        square = (3 * mean - 2 * before - after) / step
        return [0.0], [np.array([0, 0, cubic, square, before, start])]
    slowing, gaining = (min(step / 3, 2 * rise / (3 * s)) if s else step / 3 for s in (before, after))
    steady = (rise - before * slowing / 2 - after * gaining / 2) / (step - slowing / 2 - gaining / 2)
    ramps = [
        (0.0, slowing, before, steady),
        (slowing, step - gaining, steady, steady),
        (step - gaining, step, steady, after),
    ]
    starts, pieces, angle = [], [], start
    for begin, end, v0, v1 in ramps:
        if end > begin:
            starts.append(begin)
            pieces.append(np.array([0, 0, 0, (v1 - v0) / (2 * (end - begin)), v0, angle]))
            angle += (v0 + v1) / 2 * (end - begin)
    return starts, pieces
