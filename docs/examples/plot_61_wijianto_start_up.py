"""
Wijianto's gear pair: start-up
==============================

75 N m on the pinion, a load proportional to the square of speed, starting from rest. The paper prints a top speed of
132.3 rad/s, and a ripple of about 110 Hz.
"""

import matplotlib.pyplot as plt
import numpy as np

from data_synth.dynamics import (
    Body,
    Constant,
    GearMesh,
    Load,
    Output,
    Problem,
    ShaftAngle,
    Steps,
    Support,
    build_system,
    integrate,
)

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


load = Load(constant=np.array([0, 75.0, 0, 0]), quadratic_drag=np.array([0, 0, 0, 0.0075]))
rows = Output(  # speed of the gear in rad/s, deflection of the mesh in m
    rate_hz=20e3,
    displacement=np.array([[0, 0, 0, 0], [0, R1, 0, -R2]]),
    velocity=np.array([[0, 0, 0, 1], [0, 0, 0, 0]]),
)
steady = ShaftAngle(times_s=np.zeros(1), speeds_hz=np.array([8334 / (2 * np.pi)]))
problem = Problem(system=pair(Constant(mean=1e6)), reference=steady, load=load, duration_s=2.0)
found = integrate(problem, output=rows, tolerance=Steps(per_sample=4))
speed, deflection = found.values.T
print(f"{speed[-1]:.2f} rad/s after 2 s")

figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
top.plot(found.times_s, speed)
top.set(ylabel="speed of the gear, rad/s")
bottom.plot(found.times_s, 1e3 * deflection, linewidth=0.5)
bottom.set(xlabel="time, s", ylabel="transmission error, mm")
plt.show()
