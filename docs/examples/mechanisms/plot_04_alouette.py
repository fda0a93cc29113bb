"""
The main gearbox of the Alouette III
====================================

A bevel stage, a tail-rotor take-off and two planetary stages in series (Penaud, Alazard and Amiez 2012).
The chart shows the frequency of each order against input speed.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism, speed_order_chart

gearbox = hums.load_gearbox("alouette-iii")
kinematics = hums.solve_kinematics(gearbox)
for link in ("tail", "main shaft", "lower carrier", "upper carrier"):
    print(f"{link:14} {kinematics.rates({'input': 1})[link]} of the input speed")

# %%
figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
draw_mechanism(gearbox, ax=ax)
plt.show()

# %%
orders = hums.defect_orders(kinematics)
meshes = orders[orders.kind == "gear_mesh"]
figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
speed_order_chart(meshes, reference_rpm=(1000, 6000), ax=ax)
plt.show()
