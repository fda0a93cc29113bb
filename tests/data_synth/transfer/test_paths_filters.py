from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth.scene.sensors import Sensor
from data_synth.transfer.acquisition import measured_filter
from data_synth.transfer.housing import step_weights
from data_synth.transfer.paths import AnalogFilter, MeasuredPath, ModalPath

RATE = 20_000.0
PATH = ModalPath(
    frequencies_hz=np.array([800.0, 3000.0]),
    damping_ratios=np.array([0.02, 0.05]),
    residues=np.array([1.0 - 2.0j, 0.5j]),
)


@pytest.mark.parametrize("pole", [-1e-9 + 3e-9j, -5e-5 + 8e-5j, -2e-3 + 5e-3j, -0.01 + 0.2j, -1.0 + 2.0j])
def test_weights_of_a_step_keep_their_digits(pole):
    late, early = step_weights(np.array([pole]))
    # the integral of exp(p (1 - s)) s and (1 - s) over a step, by 20 points of Gauss
    nodes, weights = np.polynomial.legendre.leggauss(20)
    s, w = (nodes + 1) / 2, weights / 2
    wave = np.exp(pole * (1 - s))
    assert late[0] == pytest.approx(np.sum(w * wave * s), rel=1e-12)
    assert early[0] == pytest.approx(np.sum(w * wave * (1 - s)), rel=1e-12)


def blocks(data, sizes):
    edges = np.cumsum([0, *sizes, len(data)])
    return [data[a:b] for a, b in pairwise(edges) if a < len(data)]


SMOOTH = ModalPath(
    frequencies_hz=PATH.frequencies_hz, damping_ratios=PATH.damping_ratios, residues=np.array([-2j, -1j])
)


def measured(spacing=2.0, highest=10_000.0, path=PATH, delay=0.0):
    frequency = np.arange(0, highest + spacing / 2, spacing)
    return MeasuredPath(
        frequencies_hz=frequency, values=path.response(frequency) * np.exp(-2j * np.pi * frequency * delay)
    )


def filter_of(path):
    sensor = Sensor.model_validate({"name": "a", "on": "b", "units": "g"})
    return measured_filter(path, AnalogFilter(), rate_hz=RATE, sensor=sensor)


def test_a_measured_path_responds_as_it_was_measured():
    # displacement-like, so that little is lost at half the rate: residues -j alike
    fir = filter_of(measured(path=SMOOTH))
    assert 0 <= fir.delay_s < 30 / RATE
    frequency = np.array([100.0, 790.0, 1500.0, 3000.0, 6000.0])
    waves = np.exp(-2j * np.pi * np.outer(frequency, np.arange(fir.taps.size) / RATE))
    found = waves @ fir.taps * np.exp(2j * np.pi * frequency * fir.delay_s)
    largest = np.max(np.abs(SMOOTH.response([790.0])))
    # a line of 2 Hz against a half width of 16 Hz: interpolated to (2 / 16)^2 / 8 = 0.2 % of the peak
    assert_allclose(found, SMOOTH.response(frequency), atol=4e-3 * largest)


def test_a_path_with_a_travel_time_needs_no_further_delay():
    late = filter_of(measured(path=SMOOTH, delay=0.002))
    assert late.delay_s == 0
    at_once = filter_of(measured(path=SMOOTH))
    # the transform of the two is the same, 40 samples apart
    shift = 40 - round(at_once.delay_s * RATE)
    size = min(late.taps.size - shift, at_once.taps.size)
    assert_allclose(late.taps[shift:][:size], at_once.taps[:size], atol=5e-3 * np.max(late.taps))


def test_filters_by_taps_are_convolutions_in_blocks():
    fir = filter_of(measured())
    force = np.random.default_rng(2).standard_normal(4000)
    expected = np.convolve(force, fir.taps)[:4000]
    found = np.concatenate([fir.push(block) for block in blocks(force, [1, 0, 700, 2000])])
    assert_allclose(found, expected, atol=1e-10)


def test_nothing_lies_outside_of_what_was_measured():
    path = MeasuredPath(frequencies_hz=np.array([100.0, 200.0]), values=np.array([1.0, 1j]))
    assert_allclose(path.response([50, 100, 150, 200, 250]), [0, 1, 0.5 + 0.5j, 1j, 0])
