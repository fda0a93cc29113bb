"""
Torques and power through two stages
====================================

Tooth loads by virtual work, with a loss of one per cent per mesh.
"""

import matplotlib.pyplot as plt

import hums

kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
torques = hums.solve_torques(kinematics, {"input": 100.0, "output": None}, mesh_efficiency=0.99)
print(f"efficiency {torques.efficiency:.4f}")

loaded = {link: torque for link, torque in torques.torques_nm.items() if torque}
figure, ax = plt.subplots(layout="constrained")
ax.bar(list(loaded), list(loaded.values()))
ax.set(ylabel="torque on the shaft, N m")
plt.show()
