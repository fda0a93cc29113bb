"""The angle of a declared speed: followed where the lines of shafts and meshes show how it changes, else constant."""

import numpy as np
import pytest

from hums.analysis.reference_angle import prepare_machine
from hums.analysis.settings import AnalysisSettings
from hums.gearbox.model import load_gearbox
from hums.records.record import NominalSpeed, make_record

RATE_HZ, SECONDS, SPEED_HZ = 8000.0, 12.0, 25.0
T = np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
GEARBOX = load_gearbox("two-stage")  # 23 teeth on the input shaft, the reference


def machine(turns, *, lines, rpm=60 * SPEED_HZ, noise=1.0):
    """Return the machine of a record with lines of equal height at these orders, of an input that turns so."""
    values = sum(np.cos(2 * np.pi * order * turns + order) for order in lines)
    values = values + noise * np.random.default_rng(0).standard_normal(T.size)
    angle = NominalSpeed(rpm=rpm, shaft="input")
    record = make_record({"x": values}, rate_hz=RATE_HZ, units="g", angle=angle)
    return prepare_machine(record, GEARBOX, AnalysisSettings())


def wandering(depth, rate_hz):
    """Return the turns of an input whose speed swings by a share of its mean."""
    return SPEED_HZ * (T + depth / (2 * np.pi * rate_hz) * np.sin(2 * np.pi * rate_hz * T))


def error_rev(found, turns):
    """Return the RMS of the error of an angle, up to a constant, in turns."""
    inside = (found.phase.start_s <= T) & (found.phase.stop_s >= T)
    assert inside.mean() > 0.99
    off = found.phase.revolutions_at(T[inside]) - turns[inside]
    return float((off - off.mean()).std())


@pytest.mark.parametrize(("depth", "rate_hz"), [(2e-3, 0.25), (1e-3, 0.5)])
def test_meshes_and_shafts_show_how_a_declared_speed_changes(depth, rate_hz):
    # the swing is depth x speed / (2 pi rate) turns: 0.03 and 0.008 of a turn, 0.7 and 0.18 of a tooth
    turns = wandering(depth, rate_hz)
    found = machine(turns, lines=(1, 2, 23, 46, 69))
    assert found.source.followed
    assert found.phase.nominal  # its lines are still those of a declared speed
    assert error_rev(found, turns) < 0.02 / 23  # a fiftieth of a tooth: the swing within a window of six turns is less


def test_a_speed_that_nothing_shows_stays_constant():
    turns = wandering(2e-3, 0.25)
    found = machine(turns, lines=())
    assert not found.source.followed
    assert np.ptp(found.speeds_hz) < 1e-9 * SPEED_HZ


def test_lines_of_another_speed_are_not_followed():
    # another machine, four per cent faster, which is beyond the tolerance
    found = machine(1.04 * wandering(2e-3, 0.25), lines=(1, 2, 23, 46, 69))
    assert not found.source.followed
