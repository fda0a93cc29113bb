"""
Synchronous average of one planet
=================================

A planet is observed through a window each time it passes the sensor. Different teeth are in mesh at each pass, so all
teeth are covered over time.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

teeth = signals.PlanetaryTeeth(ring=99, planet=39, sun=21, planets=3)
turns = np.arange(60 * 792) / 792  # of the carrier
planet_angle = 2 * np.pi * 99 / 39 * (turns - 0.5)
seen = (1 + np.cos(2 * np.pi * (turns - 0.5))) / 2  # maximum as it passes
x = seen * np.cos(5 * planet_angle) + np.random.default_rng(1).normal(0, 0.5, turns.size)
signal = signals.AngularSignal(values=x, samples_per_rev=792, start_rev=0.0, passband_orders=348.0)
window = signals.PassWindow.hann(6)
average = signals.planet_average(signal, teeth=teeth, planet=0, first_pass_rev=0.5, window=window)

figure, ax = plt.subplots(layout="constrained")
tooth = np.arange(average.values.size) * 39 / average.values.size
ax.plot(tooth, average.values, label="average")
ax.plot(tooth, np.cos(2 * np.pi * 5 * tooth / 39), "--", label="true")
ax.set(xlabel="tooth of the planet", ylabel="amplitude")
ax.legend()
plt.show()
