"""Amplitudes of orders by least squares in fifty digits or more, sharing no line with the trackers they judge."""

from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from math import comb

import numpy as np

from signals.harmonics import track_orders

exact_number = np.vectorize(Decimal, otypes=[object])


@dataclass(frozen=True, kw_only=True)
class Case:
    """A record at one sample a second, and what the trackers are told of it."""

    x: np.ndarray
    phase: np.ndarray
    orders: tuple[float, ...]
    bandwidth: float | np.ndarray
    """Of all orders; one for each sample where it varies, (1, n)."""
    poles: int
    noise: float
    initial_std: float
    every: int = 1

    def track(self, method="exact", estimator="smoother", **settings):
        tracks = track_orders(
            self.x, phase_rad=self.phase, orders=self.orders, bandwidth_hz=self.bandwidth, rate_hz=1.0,
            poles=self.poles, noise_variance=self.noise, initial_std=self.initial_std, output_every=self.every,
            method=method, estimator=estimator, **settings,
        )  # fmt: skip
        assert tracks.method == method
        return tracks

    def least_squares_on_the_past(self, sample):
        """The amplitudes at a sample, and their std, as the filter has them: with the mean as an order of its own."""
        orders = self.orders if 0.0 in self.orders else (*self.orders, 0.0)
        upto = slice(sample + 1)
        width = self.bandwidth if np.ndim(self.bandwidth) == 0 else self.bandwidth[:, upto]
        past = replace(self, x=self.x[upto], phase=self.phase[upto], orders=orders, bandwidth=width)
        return (values[: len(self.orders)] for values in past.least_squares([sample]))

    def least_squares(self, outputs=None):
        """Amplitudes and their std (order, output), by default at the outputs of `track`.

        The unknowns are the levels themselves, from `poles - 1` samples before the record on. The squares are those
        of the samples, of the `poles`-th differences, and, at the first sample, of the lower ones, each over its
        variance: a band of equations, eliminated from the first to the last, and of its inverse the diagonal.
        """
        outputs = np.arange(0, self.x.size, self.every) if outputs is None else outputs
        with localcontext() as context:
            # Of these cases those of one and two poles come out in double precision as with a hundred digits; of four
            # poles in narrow bands 50 would lose all.
            context.prec = 50 if self.poles <= 2 else 100
            solved = _solved(*self._equations(), first=min(outputs))
            levels, variances = (values[outputs].astype(float) for values in solved)
        number, turning = len(self.orders), np.flatnonzero(self.orders)
        amplitude, variance = levels[:, :number].T.astype(complex), variances[:, :number].T.copy()
        amplitude[turning] += 1j * levels[:, number:].T
        variance[turning] = (variance[turning] + variances[:, number:].T) / 2
        return amplitude, np.sqrt(variance)

    def _equations(self):
        """Upper band (unknown, offset) of the matrix, right side, and unknowns before the record and a sample."""
        orders, poles = np.array(self.orders), self.poles
        columns = np.concatenate([np.arange(orders.size), np.flatnonzero(orders)])
        angle = orders * self.phase[:, None]
        rows = exact_number(np.concatenate([np.cos(angle), -np.sin(angle[:, orders != 0])], axis=1))
        count = columns.size
        band = exact_number(np.zeros(((poles - 1 + self.x.size) * count, poles * count + 1)))
        right = exact_number(np.zeros(len(band)))

        def add_differences(samples, column, degree, variance):
            signs = [Decimal((-1) ** j * comb(degree, j)) for j in range(degree + 1)]
            for early in range(degree + 1):
                for late in range(early + 1):
                    places = (poles - 1 + samples - early) * count + column
                    band[places, (early - late) * count] += signs[early] * signs[late] / variance

        # As the theory page has it: N = 2 R, R for the mean.
        width = np.broadcast_to(self.bandwidth, (1, self.x.size))[0]
        ratio = (2 * np.sin(np.pi * width[:-1] / 2)) ** (2 * poles) / (np.sqrt(2) - 1)
        for column, order in enumerate(orders[columns]):
            for degree in range(poles):
                start = self.initial_std * (2 * np.pi * float(np.max(self.bandwidth))) ** degree
                add_differences(np.array([0]), column, degree, Decimal(start) ** 2)
            walk = exact_number((2 if order else 1) * self.noise * ratio)
            add_differences(np.arange(1, self.x.size), column, poles, walk)
        seen = np.flatnonzero(~np.isnan(self.x))
        rows, x, noise = rows[seen], exact_number(self.x[seen]), Decimal(self.noise)
        for column in range(count):
            places = (poles - 1 + seen) * count + column
            right[places] += rows[:, column] * x / noise
            for other in range(column, count):
                band[places, other - column] += rows[:, column] * rows[:, other] / noise
        return band, right, (poles - 1) * count, count


def _solved(band, right, before, count, first):
    """(sample, column) solution and diagonal of the inverse, filled in from sample `first` on."""
    size, reach = len(band), band.shape[1] - 1
    right = np.concatenate([right, exact_number(np.zeros(reach))])
    taken = exact_number(np.zeros((reach + 1, reach + 1)))  # by what is eliminated, from the equations that follow
    for i in range(size):
        row = band[i] - taken[0]
        factors = row[1:] / row[0]
        taken[:-1, :-1] = taken[1:, 1:] + factors[:, None] * row[1:]
        right[i + 1 : i + 1 + reach] -= factors * right[i]
        band[i, 0], band[i, 1:] = row[0], factors
    solution, diagonal = exact_number(np.zeros(size + reach)), exact_number(np.zeros(size))
    near = exact_number(np.zeros((reach, reach)))  # the inverse at the unknowns that follow
    for i in range(size - 1, before + first * count - 1, -1):
        pivot, factors = band[i, 0], band[i, 1:]
        solution[i] = right[i] / pivot - factors @ solution[i + 1 : i + 1 + reach]
        beside = -(near @ factors)
        diagonal[i] = 1 / pivot - factors @ beside
        near[1:, 1:] = near[:-1, :-1].copy()
        near[0] = near[:, 0] = np.concatenate([diagonal[i : i + 1], beside[:-1]])
    return solution[before:size].reshape(-1, count), diagonal[before:].reshape(-1, count)
