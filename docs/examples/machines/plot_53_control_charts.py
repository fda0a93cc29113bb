"""
Control charts of a machine
===========================

The score of a component, record by record: normal for 60 records, then a fault grows by a tenth of a standard
deviation per record. EWMAs with weights 1, 0.2 and 0.05 and a cumulative sum monitor it. The condition index is the
largest EWMA over its limit, at which a healthy machine of one component with a baseline of 30 records raises one alarm
in 10,000 records.
"""

import matplotlib.pyplot as plt
import numpy as np

from hums.fleet.series import limit_table
from signals.monitoring.charts import ChartState, machine_limits

records, began = np.arange(120), 60
growth = 0.1 * np.clip(records - began, 0, None)
scores = np.random.default_rng(1).normal(size=records.size) + growth
limits = machine_limits(limit_table(), np.array([30.0]), 10_000, (0,))
state, charts, index = ChartState.start((1,)), [], []
for score in scores:
    state = state.step(np.array([score]), allowance=limits.allowance)
    charts.append(state.values[:, 0])
    index.append(float(limits.index(state)[0]))
alarm = int(np.argmax(np.array(index) > 1))
print(f"fault from record {began}, alarm at record {alarm}")

figure, (top, bottom) = plt.subplots(2, 1, figsize=(9, 6), sharex=True, layout="constrained")
top.plot(records, scores, ".", color="0.6", label="score")
for name, values in zip(["weight 1", "weight 0.2", "weight 0.05"], np.array(charts).T[:3], strict=True):
    top.plot(records, values, label=name)
top.axvline(began, color="k", linestyle=":")
top.set(ylabel="standard deviations")
top.legend()
bottom.plot(records, index)
bottom.axhline(1, color="tab:red")
bottom.axvline(alarm, color="tab:red", linestyle=":")
bottom.set(xlabel="record", ylabel="condition index")
plt.show()
