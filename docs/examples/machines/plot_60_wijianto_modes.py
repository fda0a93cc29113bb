"""
Wijianto's gear pair: modes
===========================

Four degrees of freedom; the paper prints 110.17, 392.65 and 687.01 Hz, in addition to the free rotation.
"""

import matplotlib.pyplot as plt

from data_synth.dynamics import Body, Constant, GearMesh, Support, build_system, solve_modes
from hums.plots import plot_mode_shape

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


modes = solve_modes(pair(Constant(mean=1e6)))
print(modes.frequencies_hz.round(2))

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
plot_mode_shape(modes, 1, ax=left)
plot_mode_shape(modes, 2, ax=right)
plt.show()
