"""Bandwidth, process noise and Vold-Kalman weight, equivalent to one another, and the gains that follow from them.

For a quadrature whose `poles`-th difference is white with variance q, in white noise of variance N, the steady-state
smoother has the gain `H(w) = 1 / (1 + (N / q) x^poles)`, where `x = (2 sin(w / 2))^2`, w in rad per sample [1]_.
The bandwidth is the full width, from one side of the line to the other, between the points `w = pi bandwidth`
(bandwidth in cycles per sample) where H has fallen to 1 / sqrt(2).

The poles of H lie where x is one of the roots c of `c^poles = -q / N`, each at a pair z, 1 / z of
`(1 - z)^2 = -c z`. With the z inside the unit circle the spectrum of the record factors, and the causal
steady-state filter passes `1 - prod z (e^jw - 1) / (e^jw - z)` [2]_. For narrow bandwidths this is
`1 - s^p / B_p(s)`, B_p the Butterworth polynomial of degree p. Its innovations have variance N / prod z, its error
N (1 - prod z), that of the smoother N times the mean of H over w.

N is 2 R for an order above 0 in noise of variance R, whose two quadratures share every sample, and R for order 0.

References
----------
.. [1] H. Vold, J. Leuridan, "High resolution order tracking at extreme slew rates, using Kalman tracking
   filters", SAE 931288, 1993.
.. [2] T. Kailath, A. H. Sayed, B. Hassibi, *Linear Estimation*, Prentice Hall 2000, chapters 6 and 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from signals._validation import choice, positive, whole

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
HALF_POWER = np.sqrt(2) - 1
MOST_POLES = 4


@dataclass(frozen=True, kw_only=True)
class Bandwidth:
    """The bandwidth of an order's amplitude, with the gains of the smoother and the causal filter that have it.

    Attributes
    ----------
    width
        Full -3 dB width of the steady-state smoother for one isolated non-zero order, cycles per sample.
    poles
        Number of integrations of the random walk, 1 to 4.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.harmonics import Bandwidth
    >>> band = Bandwidth(width=0.01, poles=2)
    >>> print(band.smoother_gain([0, 0.005]).round(4))  # 1 on the order, -3 dB half a width from it
    [1.     0.7071]
    >>> print(np.abs(band.filter_gain(0)).round(4))
    1.0
    """

    width: float
    poles: int

    def __post_init__(self) -> None:
        whole(self.poles, name="poles", least=1, most=MOST_POLES)
        if positive(self.width, name="width") > 1:
            raise ValueError(
                f"width={self.width:g} cycles a sample is above 1: half of the rate, on either side of the line; "
                "a width in Hz is to be divided by the rate."
            )

    @classmethod
    def from_weight(cls, weight: float, *, poles: int) -> Bandwidth:
        """Return the bandwidth of the Vold-Kalman filter with a weight r.

        The Vold-Kalman filter of the second generation minimises, over the envelopes Z of all orders together,
        `sum |r D^p Z|^2 + sum |2 x - sum Z exp(j order phase)|^2` with weights r, D^p the p-th difference [1]_, [2]_.
        The exact smoother does the same with the real record in place of the complex one, so that orders are also
        separated from the images at minus their frequencies; its weights are r^2 = N / q.

        References
        ----------
        .. [1] H. Vold, M. Mains, J. Blough, "Theoretical foundations for high performance order tracking with the
           Vold-Kalman tracking filter", SAE 972007, 1997.
        .. [2] J. Tuma, "Setting the passband width in the Vold-Kalman order tracking filter", 12th Int. Congress on
           Sound and Vibration, Lisbon 2005.

        Examples
        --------
        With one pole and a large weight the bandwidth is `sqrt(sqrt(2) - 1) / (pi weight)`, at 5000 Hz here 2.05 Hz:

        >>> import numpy as np
        >>> from signals.harmonics import Bandwidth, track_orders
        >>> width_hz = 5000 * Bandwidth.from_weight(500, poles=1).width
        >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
        >>> x = 2 * np.cos(3 * phase_rad)
        >>> tracks = track_orders(x, phase_rad=phase_rad, orders=[3], bandwidth_hz=width_hz, rate_hz=5000)
        >>> print(tracks.bandwidth.round(2), np.abs(tracks.complex_amplitude[:, 2500]).round(3))
        [2.05] [2.]
        """
        least = cls(width=1.0, poles=poles).weight
        if positive(weight, name="weight") < least:
            raise ValueError(
                f"weight={weight:g} with poles={poles} passes even half of the rate with less than 3 dB, so it has "
                f"no bandwidth; choose a weight above {least:.3g}."
            )
        return cls(width=float(np.arcsin((least / weight) ** (1 / poles))) * 2 / np.pi, poles=poles)

    @property
    def weight(self) -> float:
        """Weight r of the Vold-Kalman filter with this bandwidth: `r^2 = N / q`, which gives the process noise q."""
        return float(variance_ratio(self.width, self.poles) ** -0.5)

    def smoother_gain(self, offset: ArrayLike) -> Floats:
        """Return the real gain of the smoother for an envelope at `offset` from the order, in cycles per sample."""
        sine = np.sin(np.pi * np.asarray(offset, dtype=np.float64)) / np.sin(0.5 * np.pi * self.width)
        with np.errstate(over="ignore"):  # far off a narrow band nothing is passed
            return np.asarray(1 / (1 + HALF_POWER * sine ** (2 * self.poles)))

    def isolated_std(self, noise_variance: float, *, estimator: Literal["smoother", "filter"] = "smoother") -> float:
        """Return the steady-state standard deviation of the amplitude of an isolated order above 0.

        `OrderTracks.std` has this value far from the ends of a record without gaps, averaged over cycles of the order;
        that of order 0, which has half of N, is smaller by sqrt(2).

        Parameters
        ----------
        noise_variance
            Variance R of the white noise in the record, in its unit squared.
        estimator
            "smoother" uses all samples, "filter" only those up to the output.

        Returns
        -------
        float
            Standard deviation of the real part, which equals that of the imaginary part, in the unit of the record.

        Examples
        --------
        A narrow band with one pole passes noise of variance `2 R pi width / (2 sqrt(sqrt(2) - 1))`:

        >>> from signals.harmonics import Bandwidth
        >>> round(Bandwidth(width=0.001, poles=1).isolated_std(1.0), 4)
        0.0699
        """
        choice(estimator, name="estimator", choices=("smoother", "filter"))
        c, u = self._factors
        passed = -np.expm1(_log_radius(u).sum()) if estimator == "filter" else np.mean(c / (c - 2 * u)).real
        return float(np.sqrt(2 * positive(noise_variance, name="noise_variance") * passed))

    @cached_property
    def _factors(self) -> tuple[Complexes, Complexes]:
        """(pole,) roots c of `c^poles = -q / N` and, to full relative precision, u = 1 - z of the z inside the circle.

        These are the causal filter's closed-loop poles; `u^2 - c u + c = 0`.
        """
        corner = (2 * np.sin(0.5 * np.pi * self.width)) ** 2
        turn = np.exp(1j * np.pi * (2 * np.arange(self.poles) + 1) / self.poles)
        c = corner * HALF_POWER ** (-1 / self.poles) * turn
        root = np.sqrt(c * (c - 4))
        pair = np.stack([(c - root) / 2, (c + root) / 2])
        # |1 - u| < 1, without the cancellation near 1
        inside = 2 * pair.real > np.abs(pair) ** 2
        return c, np.where(inside[1], pair[1], pair[0])

    def filter_gain(self, offset: ArrayLike) -> Complexes:
        """Return the complex gain of the steady-state causal filter with the same process noise, as `smoother_gain`.

        For narrow bandwidths it is 3 dB down at 1.554, 2.565, 3.279 and 4.080 times the smoother's offset, and peaks at
        0, 2.1, 4.0 and 5.2 dB next to the order, for 1 to 4 poles.
        """
        _, u = self._factors
        ahead = np.expm1(2j * np.pi * np.asarray(offset, dtype=np.float64))[..., None]
        return np.asarray(1 - np.prod((1 - u) * ahead / (ahead + u), axis=-1))

    @cached_property
    def filter_shares(self) -> Floats:
        """(pole,) steady-state Kalman gains of the level and its differences.

        With `u_i = 1 - z_i` of its closed-loop poles and `e_j` their elementary symmetric polynomials, they solve
        `sum_(i >= j) C(i - 1, i - j) k_i = e_j`: the coefficients of the characteristic polynomial in z - 1.
        """
        symmetric = np.poly(-self._factors[1])[1:].real
        shares = np.zeros(self.poles)
        for j in range(self.poles - 1, -1, -1):
            shares[j] = symmetric[j] - sum(comb(i, i - j) * shares[i] for i in range(j + 1, self.poles))
        return shares

    @cached_property
    def filter_decay(self) -> float:
        """Decay rate per sample of the slowest closed-loop pole of the causal filter: one over its time constant."""
        return float(-_log_radius(self._factors[1]).max())


def quadrature_noise(orders: Floats, noise_variance: float) -> Floats:
    """Return N of each order: R for the mean, 2 R for any other."""
    return np.where(orders == 0.0, 1.0, 2.0) * noise_variance


def variance_ratio(width: ArrayLike, poles: int) -> Floats:
    """Return q / N for a width in cycles per sample."""
    sine = np.sin(0.5 * np.pi * np.asarray(width, dtype=np.float64))
    return np.asarray((2 * sine) ** (2 * poles) / HALF_POWER)


def _log_radius(u: Complexes) -> Floats:
    """Return the logarithm of `abs(1 - u)`, to full relative precision where u is small."""
    return np.asarray(0.5 * np.log1p(np.abs(u) ** 2 - 2 * u.real))
