"""
Wijianto's gear pair: stability
===============================

Varying stiffness causes parametric instability near twice a natural frequency. The map shows the largest Floquet
multiplier over speed, at one mesh cycle per revolution, and contact ratio.
"""

import matplotlib.pyplot as plt
import numpy as np

from data_synth.dynamics import Body, GearMesh, Rectangular, Support, build_system, stability_map
from hums.plots import plot_stability_map

R1, R2 = 0.064407457476496844, 0.11271305058386948  # m


def pair(stiffness):
    """Return the pair: motion along the line of action, and rotation, of both gears."""
    pinion = Body(name="pinion", mass_kg=5.4221, inertia_kgm2=0.011246, motions=("x", "rotation"))
    gear = Body(
        name="gear",
        mass_kg=16.6052,
        inertia_kgm2=0.105478,
        motions=("x", "rotation"),
        centre_m=(0, R1 + R2, 0),
        axis=(0, 0, -1),
    )
    bearings = [Support(between=(name, None), x=1e8) for name in ("pinion", "gear")]
    mesh = GearMesh(name="mesh", gears=("pinion", "gear"), direction=(1, 0, 0), point_m=(0, R1, 0), stiffness=stiffness)
    return build_system([pinion, gear], [*bearings, mesh])


def at_ratio(ratio):
    """Return the pair for a contact ratio, with a mean of 1e6 N/m and a step of 9e5 N/m."""
    duty = ratio - 1
    return pair(Rectangular(low=1e6 - duty * 9e5, high=1e6 + (1 - duty) * 9e5, duty=duty))


ratios, mesh_rad_s = np.linspace(1.05, 1.95, 13), np.linspace(300, 3600, 80)
growth = stability_map(at_ratio, parameters=ratios, speeds_rad_s=mesh_rad_s)
figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
plot_stability_map(growth, ax=ax, parameter="contact ratio")
plt.show()
