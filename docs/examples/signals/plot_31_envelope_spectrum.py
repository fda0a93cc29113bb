"""
Envelope spectrum of impulses
=============================

In the plain spectrum, impulses appear as a hump around the resonance; in the envelope spectrum, as lines at the
impact rate.
"""

import matplotlib.pyplot as plt
import numpy as np

import signals

rate_hz = 20_000
t = np.arange(4 * rate_hz) / rate_hz
ring = np.exp(-1500 * (t % 0.02)) * np.sin(2 * np.pi * 3000 * (t % 0.02))  # 50 impulses per second
x = ring + 0.1 * np.random.default_rng(1).standard_normal(t.size)

band = signals.choose_band(x, rate_hz=rate_hz)
envelope = signals.envelope_spectrum(x, rate_hz=rate_hz, band_hz=(band.low_hz, band.high_hz), maximum_hz=400)
plain = signals.amplitude_spectrum(x, rate=rate_hz)

figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
top.plot(plain.axis, plain.amplitude)
top.axvspan(band.low_hz, band.high_hz, alpha=0.2)
top.set(xlabel="frequency, Hz", ylabel="amplitude")
bottom.plot(envelope.axis, envelope.amplitude)
bottom.set(xlabel="frequency of the squared envelope, Hz", ylabel="amplitude", ylim=(0, None))
plt.show()
