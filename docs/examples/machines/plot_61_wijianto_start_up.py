"""
Wijianto's gear pair: figures of the paper
==========================================

Figures 3 to 10 of the paper, from the scene ``wijianto``: 75 N m on the pinion, a load proportional to the square of
speed, starting from rest. The paper prints a top speed of 132.3 rad/s, and a ripple of about 110 Hz.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline

from data_synth import load_scene, simulate
from data_synth.dynamics import Rectangular, fourier_series

scene = load_scene("wijianto")
dynamics = scene.dynamics
mesh = dynamics.mesh("mesh")
constant = dynamics.changed(meshes=(("mesh", mesh.changed(shape="constant", step_n_m=None, contact_ratio=None)),))
cases = {
    "constant stiffness": constant,
    "damping ratio 0.02": constant.changed(damping_ratio=0.02),
    "damped, varying stiffness": dynamics.changed(damping_ratio=0.02),
}
records = {name: simulate(scene.changed(dynamics=case), seed=0, mechanics=True) for name, case in cases.items()}

record = records["constant stiffness"]
times_s = record["time"].values
speed = -2 * np.pi * record["truth_link_speed"].sel(truth_link="gear").values  # rad/s; the gear rotates backwards
# displacement of the gear along the paper's x: its bearing force along the line of action over 1e8 N/m
pressed_n = record["truth_bearing_force"].sel(truth_support=["gear, y", "gear, z"]).values
along = -np.array([0.342020143, 0.939692621])
velocity = CubicSpline(times_s, along @ pressed_n / 1e8).derivative()(times_s)
error_mm = {name: 1e3 * each["truth_transmission_error"].values[0] for name, each in records.items()}
print(f"{speed[-1]:.1f} rad/s after 2 s; largest transmission error {error_mm['constant stiffness'].max():.4f} mm")

figure, axes = plt.subplots(4, 2, figsize=(8, 9), layout="constrained")


def plot(number, title, values, *, between=(0.0, 2.0), **style):
    """Plot one figure of the paper."""
    shown = (times_s >= between[0]) & (times_s <= between[1])
    where = axes.ravel()[number - 3]
    where.plot(times_s[shown], values[shown], rasterized=True, **style)
    where.set_title(f"{number}: {title}", fontsize=8, loc="left")
    where.set_xlabel("s", fontsize=7, labelpad=1)
    return where


plot(3, "gear body velocity, mm/s", 1e3 * velocity, linewidth=0.3)
plot(4, "the same, zoom", 1e3 * velocity, between=(0.3, 0.4))
plot(5, "gear angular velocity, rad/s", speed)
plot(6, "the same, zoom", speed, between=(0.3, 0.4))
settled_mm = 1e3 * 75 / 0.064407457 * (1 / 1e6 + 2 / 1e8)
plot(7, "transmission error, mm", error_mm["constant stiffness"], linewidth=0.5).axhline(
    settled_mm, color="0.5", ls="--"
)
rectangle, cycles = Rectangular(low=1e6 - 0.4 * 6e5, high=1e6 + 0.6 * 6e5, duty=0.4), np.linspace(0, 4, 1601)
for stiffness in (rectangle, fourier_series(rectangle, harmonics=20)):
    axes[2, 1].plot(cycles / 1326.4 * 1e6, 1e-6 * stiffness(cycles))
axes[2, 1].set_title("8: mesh stiffness, MN/m, and 20 terms of eq. 12", fontsize=8, loc="left")
axes[2, 1].set_xlabel("µs", fontsize=7, labelpad=1)
period = plot(9, "one period of the angular velocity, rad/s", speed, between=(0.49, 0.515))
for time_s in (0.497, 0.506):
    period.axvline(time_s, color="0.5", ls="--")
for name, values in error_mm.items():
    last = plot(10, "transmission error, mm", values, between=(0.0, 1.0), linewidth=0.5, label=name)
last.set_ylim(0, 2.6)
last.legend(fontsize=6, frameon=False, loc="upper right")
inner = last.inset_axes([0.5, 0.05, 0.42, 0.18])
for colour, name in (("C2", "damped, varying stiffness"), ("C1", "damping ratio 0.02")):
    inner.plot(times_s[-60:], error_mm[name][-60:], color=colour)
inner.set_title("the last 3 ms", fontsize=6, pad=2)
inner.set_xticks([])
inner.tick_params(labelsize=5)
plt.show()
