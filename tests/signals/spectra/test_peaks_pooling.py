"""Pooled spectra: the law of a line's power, the scatter that is left, and false alarms of noise."""

import numpy as np
import pytest

from signals.spectra.lines import find_line
from signals.spectra.peaks import pooled_spectrum
from signals.spectra.spectra import amplitude_spectrum

SIZE, RATE = 512, 64.0  # eight revolutions


def pooled(each):
    return pooled_spectrum(each[0], power=sum(one.amplitude**2 for one in each), count=len(each))


def spectra(count, rng, *, amplitude=0.0, order=10.0):
    turns = np.arange(SIZE) / RATE
    lines = amplitude * np.cos(2 * np.pi * (order * turns + rng.uniform(size=(count, 1))))
    return [amplitude_spectrum(row, rate=RATE) for row in lines + rng.normal(size=(count, SIZE))]


@pytest.mark.parametrize("count", [9, 100])
def test_the_noise_that_is_left_falls_with_the_root_of_their_number(count):
    rng = np.random.default_rng(count)
    away = slice(200, -200)
    noise = np.mean(pooled(spectra(count, rng)).amplitude[away] ** 2)
    mean = 4 * 1.5 / SIZE  # power of white noise of variance one in a line of a Hann window: 4 ENBW / n
    # some 130 independent bins are averaged, the power of each with a scatter of 1 / sqrt(K); what falls below zero is
    # raised to the floor, which lifts the mean of what is left, K^-1/2 with a scatter as large, by 8 % (Gaussian)
    scatter = 1 / np.sqrt(130 * count)
    assert noise == pytest.approx(1.08 * mean / np.sqrt(count), abs=4 * mean * scatter)


def test_a_line_keeps_its_power():
    rng = np.random.default_rng(3)
    found = pooled(spectra(400, rng, amplitude=0.3))
    power = find_line(found, expected=10.0, tolerance=0.2, background_width=4).amplitude ** 2
    mean = 4 * 1.5 / SIZE
    # A^2 + N / 10 (a tenth of the noise is left at 400), and the scatter of a mean of noncentral chi-squares
    std = np.sqrt((2 * 0.09 * mean + mean**2) / 400)
    assert power == pytest.approx(0.09 + 0.1 * mean, abs=5 * std)


@pytest.mark.parametrize("count", [4, 40])
def test_noise_raises_no_more_false_alarms_than_stated(count):
    rng = np.random.default_rng(count)
    found = []
    for _ in range(30):
        whole = pooled(spectra(count, rng))
        orders = np.arange(5.0, 28, 2)
        found += [find_line(whole, expected=order, tolerance=0.3, background_width=4) for order in orders]
    probabilities = np.array([line.false_alarm_probability for line in found])
    # binomial: 360 searches at one in 20
    assert np.mean(probabilities < 0.05) < 0.05 + 3 * np.sqrt(0.05 / probabilities.size)


def test_what_cannot_be_pooled():
    (one,) = spectra(1, np.random.default_rng(0))
    with pytest.raises(ValueError, match="power has 7 lines"):
        pooled_spectrum(one, power=np.ones(7), count=2)
