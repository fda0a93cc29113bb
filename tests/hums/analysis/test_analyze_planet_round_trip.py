"""A planetary gearbox whose gears vibrate, and a tooth of it that cracks: the analysis names it, louder as it grows."""

import numpy as np
import pytest

from data_synth import load_scene
from data_synth.simulation import noise_free
from hums.analysis.analyze import AnalysisSettings, analyze
from hums.analysis.result import findings_table
from hums.records.record import Channel, PulseTimes, make_record

# in 12 turns of the carrier each tooth of the sun meets each planet 49 times
DEMO = load_scene("planets-in-motion").changed(duration_s=3.0)
SETTINGS = AnalysisSettings(most_tracks=0, pictures=False)


def found(component, depth_mm):
    """Return the findings for a crack; none where its depth is 0."""
    crack = DEMO.faults[0].changed(component=component, depth_mm=depth_mm or 1.0)
    scene = DEMO.changed(faults=(crack,) if depth_mm else ())
    values = noise_free(scene, seed=1).signal[0]  # without the truth of a record, which costs more than the signal
    values += np.random.default_rng(1).normal(0, scene.noise.rms, values.size)
    turn_s = 60 / 240  # of the carrier
    angle = PulseTimes(times_s=np.arange(0, scene.duration_s, turn_s), shaft="carrier", pulses_per_rev=1)
    channel = Channel(values=values, units=scene.sensors[0].units)
    record = make_record({scene.sensors[0].name: channel}, rate_hz=scene.rate_hz, angle=angle)
    return findings_table(analyze(record, scene.gearbox, settings=SETTINGS))


@pytest.mark.slow
def test_a_healthy_planetary_raises_no_finding():
    assert found("sun-planet/sun", 0.0).empty


@pytest.mark.slow
def test_a_cracked_tooth_of_the_sun_is_named_and_grows():
    small, large = found("sun-planet/sun", 1.5).iloc[0], found("sun-planet/sun", 4.0).iloc[0]
    for first in (small, large):
        assert (first["component"], first["kind"]) == ("sun-planet/sun", "tooth")
        assert first["false_alarm_probability"] <= 0.01
    assert large["amplitude"] > small["amplitude"]


@pytest.mark.slow
def test_a_cracked_tooth_of_a_planet_is_named():
    # a planet's turn is one component to the analysis, whichever of its flanks is cracked
    first = found("planet-ring/planet", 4.0).iloc[0]
    assert (first["component"], first["kind"]) == ("sun-planet/planet", "tooth")
