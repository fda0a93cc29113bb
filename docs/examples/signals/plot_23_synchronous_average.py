"""
A cracked tooth in the synchronous average
==========================================

Averaging over gear revolutions retains the components locked to its rotation; after removal of the mesh harmonics, one
tooth stands out.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals
from signals.indicators import fm4

teeth, per_rev, revolutions = 21, 256, 100
angle = 2 * np.pi * np.arange(per_rev * revolutions) / per_rev
bump = 0.4 * np.exp(-(((angle % (2 * np.pi)) - 2.0) ** 2) / (2 * 0.1**2)) * np.cos(40 * angle)
x = np.cos(teeth * angle) + bump + np.random.default_rng(1).normal(0, 0.5, angle.size)
signal = signals.AngularSignal(values=x, samples_per_rev=per_rev, start_rev=0.0, passband_orders=112.0)
average = signals.synchronous_average(signal)
residual = signals.residual_signal(average, teeth=teeth, harmonics=4, shaft_orders=[1, 2])
difference = signals.difference_signal(average, teeth=teeth, harmonics=4, shaft_orders=[1, 2], sidebands=1)
print(f"FM4 = {fm4(difference):.1f}; 3 for noise alone")

figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
tooth = np.arange(per_rev) * teeth / per_rev
top.plot(tooth, average.values)
top.set(ylabel="average")
bottom.plot(tooth, residual.values)
bottom.set(xlabel="tooth", ylabel="residual")
plt.show()
