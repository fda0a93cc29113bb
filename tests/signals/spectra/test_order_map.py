"""Order maps of signals whose amplitude, phase and order are known in each row."""

import numpy as np
import pytest

from signals.resampling.resampling import AngularSignal, angular_resample
from signals.shaft.phase import ShaftPhase, constant_speed
from signals.spectra.order_map import map_orders

PER_REV = 64


def angular(values_at, revolutions=120, start=5.0):
    turns = start + np.arange(revolutions * PER_REV) / PER_REV
    return AngularSignal(values=values_at(turns), samples_per_rev=PER_REV, start_rev=start, passband_orders=28.16)


class TestTone:
    @pytest.mark.parametrize("overlap", [0.0, 0.5, 0.8])
    def test_amplitude_and_phase_in_every_row(self, overlap):
        signal = angular(lambda u: 3 * np.cos(2 * np.pi * 3.5 * u + 0.8))
        found = map_orders(signal, revolutions=10, overlap=overlap)
        column = np.argmin(np.abs(found.order - 3.5))
        # image 70 bins away: Hann's side lobes are below 1e-5 there
        np.testing.assert_allclose(found.value[:, column], 3, rtol=1e-4)
        np.testing.assert_allclose(found.phase_rad[:, column], 0.8, atol=1e-4)
        np.testing.assert_allclose(np.diff(found.revolution), 10 * (1 - overlap), rtol=1e-9)
        assert found.revolution[0] == 10.0  # starts at 5, rests on ten turns

    def test_noise_bandwidth(self):
        # 1.5 bins of a tenth of an order
        found = map_orders(angular(np.cos), revolutions=10)
        assert found.noise_bandwidth == pytest.approx(0.15, rel=1e-12)


def test_amplitude_and_speed_that_change(swinging):
    rate_hz = 20_000.0
    times = np.arange(120_000) / rate_hz
    turns = swinging.revolutions(times).astype(float)
    signal = (1 + 0.1 * times) * np.cos(2 * np.pi * 6 * turns - 0.5)
    phase = ShaftPhase(times_s=swinging.times_at(np.arange(300)), revolutions=np.arange(300.0))
    over_angle = angular_resample(signal, rate_hz=rate_hz, phase=phase, samples_per_rev=PER_REV)
    found = map_orders(over_angle, revolutions=8, phase=phase, max_order=10)
    assert found.order[-1] == 10
    np.testing.assert_allclose(found.speed_hz, swinging.speed_hz(found.time_s), rtol=1e-4)
    # the height at the middle of each row; its bend over 0.16 s is 1e-4, the resampler's ends a little more
    np.testing.assert_allclose(found.value[2:-2, 48], 1 + 0.1 * found.time_s[2:-2], rtol=2e-3)
    np.testing.assert_allclose(found.phase_rad[2:-2, 48], -0.5, atol=5e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"revolutions": 121}, "revolutions=121 must be a whole number from 1 to 120"),
        ({"overlap": -0.1}, "overlap=-0.1"),
    ],
)
def test_refusals(changes, words):
    with pytest.raises(ValueError, match=words):
        map_orders(angular(np.cos), **({"revolutions": 10} | changes))


def test_rows_beyond_the_phase_are_refused():
    with pytest.raises(ValueError, match="rev"):
        map_orders(angular(np.cos), revolutions=10, phase=constant_speed(50.0, start_s=0.0, stop_s=1.0))
