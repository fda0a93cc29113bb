"""
Published velocity ratios compared
==================================

Published values and those of the exact solver for Nelson's bevel planet (Nelson and Cipra 2005; Penaud and
Alazard 2010), the car differential in a corner (Penaud and Alazard 2010) and the Alouette III (Penaud, Alazard and
Amiez 2012). The papers print two to four decimals; the solver gives fractions.
"""

from fractions import Fraction

import matplotlib.pyplot as plt

import hums


def rate(gearbox, link, seen_from, speeds):
    """Return the exact speed of a link relative to another one."""
    kinematics = hums.solve_kinematics(hums.load_gearbox(gearbox))
    return kinematics.relative_speed(link, seen_from=seen_from, speeds=speeds)


corner = {"left wheel": Fraction(26), "right wheel": Fraction(30)}
published = [
    ("Nelson: carrier, ring at 1", 0.625, rate("nelson-bevel-planet", "carrier", "sun", {"ring": 1})),
    ("Nelson: planet against carrier", 0.9375, rate("nelson-bevel-planet", "planet", "carrier", {"ring": 1})),
    ("differential: drive shaft, rad/s", -140, rate("car-differential", "drive shaft", "car", corner)),
    ("differential: planet a against cage", -2.8, rate("car-differential", "planet a", "cage", corner)),
    ("Alouette III: tail", 0.415, rate("alouette-iii", "tail", "housing", {"input": 1})),
    ("Alouette III: upper carrier", 0.0612, rate("alouette-iii", "upper carrier", "housing", {"input": 1})),
]
print(f"{'quantity':38}{'printed':>10}{'exact':>12}{'decimal':>12}")
for quantity, printed, ours in published:
    print(f"{quantity:38}{printed:>10}{ours!s:>12}{float(ours):>12.5f}")
    assert abs(printed - float(ours)) < 5e-4  # half a unit of the last decimal of the coarsest

# %%
# The differences are rounding errors of the printed values.
figure, ax = plt.subplots(figsize=(8, 3.5), layout="constrained")
ax.barh([row[0] for row in published], [printed - float(ours) for _, printed, ours in published])
ax.axvline(0, color="black", lw=0.8)
ax.set(xlabel="printed minus exact", xlim=(-5e-4, 5e-4))
ax.ticklabel_format(axis="x", scilimits=(0, 0))
ax.invert_yaxis()
plt.show()
