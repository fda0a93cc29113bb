"""The state-space model of the trackers as matrices, and on filterpy: slow and transparent, a check of all others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from filterpy.kalman import KalmanFilter

from signals._validation import checked, positive
from signals.harmonics import _arguments

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from signals.harmonics.state_space import Complexes, Floats, HarmonicModel, Order


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicMatrices:
    """The linear state-space model of shaft orders: ``x[n+1] = F x[n] + w[n]``, ``y[n] = H[n] x[n] + v[n]``.

    The state holds the levels of all quadratures, real parts of all orders and then imaginary parts of those above
    zero, then their first differences, and so on to `poles`.

    Attributes
    ----------
    F : (state, state) array
        Transition from one sample to the next.
    R : float
        Variance of v.
    P0 : (state, state) array
        Covariance of the first state, whose mean is zero.

    Examples
    --------
    >>> from signals.harmonics import harmonic_model
    >>> model = harmonic_model(phase_rad=[0.0, 0.5], orders=[2], bandwidth_hz=1, rate_hz=100, noise_variance=1, poles=2)
    >>> print(model.F)
    [[1. 0. 1. 0.]
     [0. 1. 0. 1.]
     [0. 0. 1. 0.]
     [0. 0. 0. 1.]]
    """

    F: Floats
    R: float
    P0: Floats
    _model: HarmonicModel

    def H(self, sample: int) -> Floats:  # noqa: N802 - as in the textbooks
        """Return the measurement matrix (1, state) at a sample."""
        found = np.zeros((1, len(self.F)))
        found[:, : self._model.order_of_column.size] = self._model.regressors(np.array([sample]))[:, 0]
        return found

    def Q(self, sample: int = 0) -> Floats:  # noqa: N802
        """Return the covariance (state, state) of w at a sample; the same for all where the bandwidth is constant."""
        noise = self._model.process_noise(slice(sample, sample + 1))[0]
        return np.asarray(self.R * np.kron(np.ones((self._model.poles, self._model.poles)), np.diag(noise)))

    def amplitude(self, x: Floats) -> Complexes:
        """Return the complex amplitudes (order, n) of states (n, state), ``y = Re sum Z exp(j order phase)``."""
        return self._model.amplitude(np.atleast_2d(x)[:, : self._model.order_of_column.size])

    def as_filterpy(self) -> KalmanFilter:
        """Return a filter before the first sample: for sample n ``update(y[n], H=H(n))``, then ``predict(Q=Q(n))``."""
        kalman = KalmanFilter(dim_x=len(self.F), dim_z=1)
        kalman.x = np.zeros((len(self.F), 1))
        kalman.P, kalman.F, kalman.Q, kalman.R = self.P0.copy(), self.F.copy(), self.Q(), np.array([[self.R]])
        kalman.H = self.H(0)
        return kalman


@checked
def harmonic_model(
    *,
    phase_rad: ArrayLike | Mapping[str, ArrayLike],
    orders: Sequence[Order] | NDArray[np.float64],
    noise_variance: float,
    bandwidth_hz: ArrayLike | None = None,
    bandwidth_orders: ArrayLike | None = None,
    rate_hz: float | None = None,
    samples_per_rev: float | None = None,
    poles: int = 1,
    initial_std: float | None = None,
) -> HarmonicMatrices:
    """Return the model of `track_orders` as matrices, for a Kalman filter of one's own.

    Its filter tracks the mean as well: name order 0 to have the same estimates.

    Parameters
    ----------
    phase_rad, orders, bandwidth_hz, bandwidth_orders, rate_hz, samples_per_rev, poles, noise_variance, initial_std
        As for `signals.harmonics.track_orders`.

    Returns
    -------
    HarmonicMatrices

    Raises
    ------
    ValueError
        As `signals.harmonics.track_orders` does.

    Examples
    --------
    A tone of amplitude 2, filtered by filterpy step by step:

    >>> import numpy as np
    >>> from signals.harmonics import harmonic_model
    >>> phase_rad = 2 * np.pi * 25 * np.arange(1000) / 1000
    >>> y = 2 * np.cos(3 * phase_rad)
    >>> model = harmonic_model(phase_rad=phase_rad, orders=[1, 3], bandwidth_hz=2, rate_hz=1000, noise_variance=1e-4)
    >>> kalman = model.as_filterpy()
    >>> for n in range(1000):
    ...     kalman.update(y[n], H=model.H(n))
    ...     z = model.amplitude(kalman.x[:, 0])
    ...     kalman.predict()
    >>> print(np.abs(z[:, 0]).round(3))
    [0. 2.]
    """
    phases_of = phase_rad.values() if isinstance(phase_rad, Mapping) else [phase_rad]
    samples = min((np.shape(each)[0] for each in phases_of if np.ndim(each)), default=0)
    noise = positive(noise_variance, name="noise_variance")
    model, *_ = _arguments.check_model(
        orders=orders, phase_rad=phase_rad, samples=samples, noise_variance=noise, initial_std=initial_std,
        poles=poles, bandwidth_hz=bandwidth_hz, bandwidth_orders=bandwidth_orders, rate_hz=rate_hz,
        samples_per_rev=samples_per_rev,
    )  # fmt: skip
    return HarmonicMatrices(
        F=np.asarray(np.kron(np.tri(model.poles).T, np.eye(model.order_of_column.size)), dtype=np.float64),
        R=noise,
        P0=noise * np.diag(model.prior_variance().ravel()),
        _model=model,
    )
