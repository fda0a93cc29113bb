"""
Build your own Kalman filter
============================

`signals.harmonic_model` returns the matrices of the tracker's state-space model, and a filterpy filter based on them,
for cases that `track_orders` does not cover: here, a known noise variance for each sample.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 500
t = np.arange(4 * rate_hz) / rate_hz
phase_rad = 2 * np.pi * (5 * t + t**2)
truth = 1 + 0.3 * np.sin(2 * np.pi * 0.3 * t)
noise_std = np.where((t > 1.5) & (t < 2.5), 2.0, 0.2)  # known, for instance from a second sensor
y = truth * np.cos(3 * phase_rad) + noise_std * np.random.default_rng(1).standard_normal(t.size)

settings = {"phase_rad": phase_rad, "orders": [0, 1, 3], "bandwidth_hz": 1.5, "rate_hz": rate_hz}
settings["noise_variance"] = 0.04
model = signals.harmonic_model(**settings)
steady, own = model.as_filterpy(), model.as_filterpy()
steady_z, own_z = [], []
for n in range(t.size):
    for kalman, found, variance in ((steady, steady_z, None), (own, own_z, noise_std[n] ** 2)):
        kalman.update(y[n], R=variance, H=model.H(n))
        found.append(model.amplitude(kalman.x[:, 0])[2, 0])
        kalman.predict()

# %%
# With the noise variance of the model, filterpy and the compiled filter, which always tracks order 0, agree.
tracks = signals.track_orders(y, **settings, estimator="filter", method="exact")
print("largest difference:", f"{np.max(np.abs(tracks.complex_amplitude[2] - steady_z)):.1e}")

# %%
# A filter with the variance of each sample gives little weight to noisy ones.
figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
ax.plot(t, np.abs(tracks.complex_amplitude[2]), label="track_orders")
ax.plot(t, np.abs(own_z), label="with the variance of each sample")
ax.plot(t, truth, "k--", linewidth=0.8, label="true")
ax.set(xlabel="time, s", ylabel="amplitude of order 3", ylim=(0, 2))
ax.legend()
plt.show()
