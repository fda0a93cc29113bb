"""
From a record to its spectra
============================

The orders of the gearbox are marked in the order spectrum and in the envelope spectrum.
"""

import matplotlib.pyplot as plt

import hums
from data_synth import Scene, simulate
from hums.plots import plot_spectrum

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

analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
figure, (top, bottom) = plt.subplots(2, 1, figsize=(9, 7), layout="constrained")
plot_spectrum(analysis, channel="housing", ax=top)
plot_spectrum(analysis, channel="housing", ax=bottom, spectrum="envelope")
plt.show()
