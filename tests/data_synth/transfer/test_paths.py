from fractions import Fraction

import numpy as np
import pytest

from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.scene.sensors import Mode
from data_synth.transfer.paths import impact_line, mode_filter, ringing

MODE = Mode(frequency_hz=3000.0, damping_ratio=0.05)
RINGS = ringing(MODE)


def rung(times_s):
    """The textbook response of a damped mode, by cosines and not by its pole."""
    natural = 2 * np.pi * 3000
    damped = natural * np.sqrt(1 - 0.05**2)
    return np.where(times_s >= 0, np.exp(-0.05 * natural * times_s) * np.sin(damped * times_s), 0.0)


def test_the_lines_of_a_train_hold_in_a_run_up_to_the_stated_error():
    # one turn of a run-up of 1 rev/s per second, sampled evenly in angle and transformed; the ringing is over
    # within a fiftieth of the turn, so the speed at its beginning counts
    named = dict.fromkeys(("component", "kind", "source"), "")
    once_a_turn = ImpactTrain(**named, revolutions=np.zeros(1), amplitudes=np.ones(1), order=Fraction(1), offset=0.0)
    speed, slope, decay = 22.0, 1.0, 1 / (0.05 * 2 * np.pi * 3000)

    def time_of(turns):
        return (np.sqrt(speed**2 + 2 * slope * turns) - speed) / slope

    times = time_of(np.arange(1 << 15) / (1 << 15))
    wave = sum(rung(times - time_of(turn)) for turn in (-2, -1, 0))
    lines = 2 * np.fft.rfft(wave) / times.size
    for harmonic in (5, 23, 100, 136):
        stated = impact_line(once_a_turn, harmonic=harmonic, speed_hz=np.array([speed]), load=np.ones(1), path=RINGS)[0]
        error = abs(lines[harmonic] - stated) / abs(stated)
        assert error < 2 * (slope / speed * decay + 2 * np.pi * harmonic * slope * decay**2)


def test_a_mode_passes_slow_lines_and_turns_them_at_its_frequency():
    assert mode_filter(MODE).response(0.0) == 1
    assert mode_filter(MODE).response(3000.0) == pytest.approx(-1j / (2 * 0.05))
    # far above, -(f_n / f)^2
    assert mode_filter(MODE).response(3e6) == pytest.approx(-1e-6, rel=1e-3)
