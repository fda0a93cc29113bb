"""
Gears of a Ravigneaux set
=========================

Two degrees of freedom: fixing one link after the other gives the gears of an automatic transmission.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import mechanism_graph

kinematics = hums.solve_kinematics(hums.load_gearbox("ravigneaux"))
for held, driver in [("large sun", "small sun"), ("carrier", "small sun"), ("carrier", "large sun")]:
    ring = kinematics.rates({held: 0, driver: 1})["ring"]
    print(f"{held} held, {driver} drives: ratio {1 / ring}")

figure, ax = plt.subplots(figsize=(7, 5), layout="constrained")
mechanism_graph(kinematics, ax=ax)
plt.show()
