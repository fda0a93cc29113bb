"""
Glinsky: a planetary set with one planet
========================================

No link is fixed, so two speeds must be given.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism, velocity_diagram

gearbox = hums.load_gearbox("glinsky-planetary-1")
kinematics = hums.solve_kinematics(gearbox)
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
draw_mechanism(gearbox, ax=left)
velocity_diagram(kinematics, {"sun": 100, "ring": 0}, ax=right)

# %%
# Every speed is an exact fraction of the given ones:
for link, rate in kinematics.rates({"sun": 100, "ring": 0}).items():
    print(f"{link:10} {rate}")
