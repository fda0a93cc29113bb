"""
The defect orders of a gearbox
==============================

Every contact repeats a fixed number of times per revolution of the reference shaft. Where teeth alone define that
number, it is an exact fraction.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism

gearbox = hums.load_gearbox("two-stage")
orders = hums.defect_orders(gearbox)
print(orders[["component", "kind", "order", "exact"]].to_string(index=False))

# %%
figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
draw_mechanism(gearbox, ax=ax, colours={"input bearing": "tab:red"})
plt.show()
