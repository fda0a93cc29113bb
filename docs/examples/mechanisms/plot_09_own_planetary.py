"""
Declare a planetary stage
=========================

A gearbox is a mapping, in Python or in a TOML file. The ring is fixed to the housing by `rigid`; as an internal gear,
it has a negative number of teeth.
"""

import matplotlib.pyplot as plt

import hums
from hums.plots import draw_mechanism

gearbox = hums.Gearbox.from_mapping(
    {
        "name": "my stage",
        "frame": "housing",
        "reference": "sun",
        "rigid": [["housing", "ring"]],
        "axes": {
            "main": ["housing", "sun", "ring", "carrier"],
            "planet": {"links": ["carrier", "planet"], "copies": 3},
        },
        "mesh": [{"teeth": {"sun": 21, "planet": 39}}, {"teeth": {"planet": 39, "ring": -99}}],
    }
)
orders = hums.defect_orders(gearbox)
print(orders[["component", "kind", "order", "exact", "sources"]].to_string(index=False))

figure, ax = plt.subplots(figsize=(7, 5), layout="constrained")
draw_mechanism(gearbox, ax=ax, view="axial")
plt.show()
