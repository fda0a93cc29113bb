"""The same model on filterpy: slow and transparent, an independent check of the compiled estimators.

References
----------
.. [1] H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems",
   AIAA J. 3, 1965.
"""

import numpy as np
from filterpy.kalman import KalmanFilter

from signals.harmonics.state_space import LAGS, Estimate, Estimator, Floats, HarmonicModel


def track(model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int) -> Estimate:
    """Filter, and smooth by the recursion of Rauch, Tung and Striebel [1]_, every sample with dense matrices.

    Parameters as for `kalman_filter.covariance_filter`; `estimator` is "smoother" or "filter".
    """
    columns = model.order_of_column.size
    channels, samples = x.shape
    measurement = np.zeros((samples, 1, model.state_size))
    measurement[:, 0, :columns] = model.regressors(slice(None))
    q = np.broadcast_to(model.process_noise(), (samples, columns))
    # filterpy predicts before each update: the first transition is the identity without process noise.
    transitions = [np.kron(np.triu(np.ones((model.poles, model.poles))), np.eye(columns))] * samples
    ones = np.ones((model.poles, model.poles))
    noises = [np.kron(ones, np.diag(before)) for before in q[[0, *range(samples - 1)]]]
    transitions[0] = np.eye(model.state_size)
    noises[0] = np.zeros_like(noises[0])

    tracks, squares, products = [], [], []
    for values in x:
        kalman = KalmanFilter(dim_x=model.state_size, dim_z=1)
        kalman.x = np.zeros((model.state_size, 1))
        kalman.P = np.diag(model.prior_variance().ravel())
        kalman.R = np.eye(1)
        # None is filterpy's missing measurement.
        data = [None if np.isnan(sample) else np.array([[sample]]) for sample in values]
        mean, covariance, predicted, predicted_covariance = kalman.batch_filter(
            data, Fs=transitions, Qs=noises, Hs=list(measurement)
        )
        innovation = values - (measurement @ predicted)[:, 0, 0]
        variance = 1 + (measurement @ predicted_covariance @ measurement.transpose(0, 2, 1))[:, 0, 0]
        if estimator == "smoother":
            mean, covariance, _, _ = kalman.rts_smoother(mean, covariance, Fs=transitions, Qs=noises)
        counts = ~np.isnan(values) & (np.arange(samples) >= startup)
        whitened = np.where(counts, innovation / np.sqrt(variance), 0.0)
        tracks.append(model.amplitude(mean[::output_every, :columns, 0]))
        squares.append(np.sum(whitened**2) / max(np.count_nonzero(counts), 1))
        products.append([whitened[lag:] @ whitened[: samples - lag] for lag in range(min(LAGS + 1, samples))])
    correlations = np.zeros((channels, LAGS + 1))
    correlations[:, : len(products[0])] = products
    power = correlations[:, :1]
    return Estimate(
        amplitude=np.stack(tracks),
        variance=model.variance(np.diagonal(covariance, axis1=1, axis2=2)[::output_every, :columns]),
        innovation_mean_square=np.array(squares),
        innovation_log_variance=float(np.mean(np.log(variance[counts]))) if counts.any() else 0.0,
        innovation_autocorrelation=np.divide(
            correlations[:, 1:], power, out=np.zeros((channels, LAGS)), where=power > 0
        ),
        innovation_samples=int(np.count_nonzero(counts)),
    )
