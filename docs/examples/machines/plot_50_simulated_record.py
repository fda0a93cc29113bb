"""
A record with ground truth
==========================

A record is simulated from a scene; the ground truth is stored with the samples.
"""

import matplotlib.pyplot as plt

from data_synth import Scene, simulate

scene = Scene.from_mapping(
    {
        "gearbox": "two-stage",
        "rate_hz": 20000,
        "duration_s": 4,
        "fidelity": "kinematic",
        "speed": {"link": "input", "rpm": [[0, 1200], [4, 1500]]},
        "tachometer": {"link": "input", "pulses_per_rev": 1},
        "excitation": {"shaft_amplitude": 0.1, "mesh_amplitude": 0.9, "harmonics": 3},
        "noise": {"rms": 0.3},
        "path": {"frequency_hz": 2200, "damping_ratio": 0.1},
        "resonance": {"frequency_hz": 6000, "damping_ratio": 0.03},
        "fault": [{"kind": "inner_race", "component": "intermediate bearing", "size_mm": 2.0}],
        "sensor": [{"name": "housing", "on": "input bearing", "units": "g"}],
    }
)
record = simulate(scene, seed=1)

print(record)

figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
ax.plot(record.time[:4000], record["housing"][:4000], linewidth=0.6)
ax.set(xlabel="time, s", ylabel="acceleration, g")
plt.show()
