"""A machine with one gross and one small fault on six channels: what one channel shows is not worse for the others."""

import warnings

import numpy as np
import pytest

import hums
from data_synth import load_scene, simulate
from hums.gearbox.model import GearboxWarning


@pytest.fixture(scope="module")
def machine():
    """The scene, and the verdicts on its record with all channels, then with each alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)  # the planets as printed
        scene = load_scene("helicopter")
    record = simulate(scene, seed=1)
    channels = [sensor.name for sensor in scene.sensors]
    alone = [record.drop_vars([other for other in channels if other != name]) for name in channels]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)  # the planets as printed
        tables = [hums.verdict_table(hums.analyze(part, scene.gearbox)) for part in (record, *alone)]
    return scene, [table.set_index(["component", "kind"]) for table in tables]


def test_the_gross_fault_is_diagnosed_and_no_sound_part_is_named(machine):
    scene, (together, *_) = machine
    faults = {(fault.component, fault.kind) for fault in scene.faults}
    named = together.index[together.verdict.isin(["diagnosed", "indicated"])]
    assert set(named) <= faults
    gross = max(scene.faults, key=lambda fault: fault.size_mm)
    assert together.verdict[gross.component, gross.kind] == "diagnosed"


def test_the_small_fault_is_as_improbable_a_false_alarm_as_on_the_median_channel(machine):
    scene, (together, *alone) = machine
    small = min(scene.faults, key=lambda fault: fault.size_mm)
    chances = [table.false_alarm_probability[small.component, small.kind] for table in (together, *alone)]
    assert len(alone) == 6
    assert chances[0] <= np.median(chances[1:])
