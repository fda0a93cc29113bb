"""
How many revolutions to average
===============================

Averaging over integer numbers of revolutions of both gears cancels the mate of a gear. `quietest_revolutions` returns
the number with the smallest remainder.
"""

from fractions import Fraction

import matplotlib.pyplot as plt
import numpy as np

import signals

mate = Fraction(21, 41)  # revolutions of the mate per revolution of the gear
advice = signals.quietest_revolutions([mate], most=100)
print("average over", advice.revolutions, "revolutions")

numbers = np.arange(1, 101)
gains = [abs(float(signals.comb_gain([float(mate)], revolutions=int(number))[0])) for number in numbers]
figure, ax = plt.subplots(layout="constrained")
ax.semilogy(numbers, np.maximum(gains, 1e-6))
ax.axvline(advice.revolutions, color="tab:red", linestyle=":")
ax.set(xlabel="revolutions averaged", ylabel="remainder of the mate's order")
plt.show()
