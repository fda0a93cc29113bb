"""
From time to shaft angle
========================

The frequency spectrum of a run-up is smeared; resampled in shaft angle, it has sharp lines.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 8000
t = np.arange(4 * rate_hz) / rate_hz
turns = 10 * t + 2.5 * t**2  # 10 to 30 rev/s
x = np.cos(2 * np.pi * 23 * turns) + 0.5 * np.cos(2 * np.pi * 25 * turns)
x += np.random.default_rng(1).normal(0, 0.5, t.size)
phase = signals.ShaftPhase(times_s=t[::80], revolutions=turns[::80])
angular = signals.angular_resample(x, rate_hz=rate_hz, phase=phase, samples_per_rev=128)

figure, (over_time, over_angle) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
spectrum = signals.amplitude_spectrum(x, rate=rate_hz, maximum=1000)
over_time.plot(spectrum.axis, spectrum.amplitude)
over_time.set(xlabel="frequency, Hz", ylabel="amplitude")
spectrum = signals.order_spectrum(angular, max_order=40)
over_angle.plot(spectrum.axis, spectrum.amplitude)
over_angle.set(xlabel="order", ylabel="amplitude")
plt.show()
