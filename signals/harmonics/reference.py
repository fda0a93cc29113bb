"""The same model on filterpy: slow, transparent, an oracle for the compiled sweeps.

References
----------
.. [1] H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems",
   AIAA J. 3, 1965.
"""

import numpy as np
from filterpy.kalman import KalmanFilter

from signals.harmonics.model import Estimate, Estimator, Floats, HarmonicModel


def track(model: HarmonicModel, x: Floats, *, estimator: Estimator, output_every: int, startup: int) -> Estimate:
    """Filter, and smooth by the recursion of Rauch, Tung and Striebel [1]_, every sample with dense matrices.

    Parameters
    ----------
    model : what is estimated.
    x : (sample,) array, NaN where missing.
    estimator : "smoother" or "filter".
    output_every : samples between outputs.
    startup : first sample whose innovation counts in the statistics.
    """
    columns = model.order_of_column.size
    measurement = np.zeros((x.size, 1, model.state_size))
    measurement[:, 0, :columns] = model.regressors(slice(None))
    # filterpy predicts before each update: the prior is left alone on its way into the first sample.
    transitions = [np.kron(np.triu(np.ones((model.poles, model.poles))), np.eye(columns))] * x.size
    noises = [np.kron(np.ones((model.poles, model.poles)), np.diag(model.walk_variance()))] * x.size
    transitions[0] = np.eye(model.state_size)
    noises[0] = np.zeros_like(noises[0])

    kalman = KalmanFilter(dim_x=model.state_size, dim_z=1)
    kalman.x = np.zeros((model.state_size, 1))
    kalman.P = np.diag(model.prior_variance().ravel())
    kalman.R = np.eye(1)
    # A NaN would poison the state; None is filterpy's missing measurement.
    data = [None if np.isnan(sample) else np.array([[sample]]) for sample in x]
    mean, covariance, predicted, predicted_covariance = kalman.batch_filter(
        data, Fs=transitions, Qs=noises, Hs=list(measurement)
    )
    innovation = x - (measurement @ predicted)[:, 0, 0]
    variance = 1 + (measurement @ predicted_covariance @ measurement.transpose(0, 2, 1))[:, 0, 0]
    if estimator == "smoother":
        mean, covariance, _, _ = kalman.rts_smoother(mean, covariance, Fs=transitions, Qs=noises)

    counts = ~np.isnan(x) & (np.arange(x.size) >= startup)
    return Estimate(
        levels=mean[::output_every, :columns, 0],
        variances=np.diagonal(covariance, axis1=1, axis2=2)[::output_every, :columns],
        innovation_mean_square=float(np.mean(innovation[counts] ** 2 / variance[counts])),
        innovation_log_variance=float(np.mean(np.log(variance[counts]))),
    )
