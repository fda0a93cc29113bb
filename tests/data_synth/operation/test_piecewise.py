import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from data_synth.operation.piecewise import (
    Kaimal,
    PiecewiseLinear,
    fluctuation,
    sum_of,
)

WIND = Kaimal(rms=2.0, time_scale_s=0.5)


def test_sums_keep_corners_and_jumps():
    first = PiecewiseLinear(times_s=np.array([1.0, 1.0, 2.0, 2.0]), values=np.array([1.0, 4.0, 4.0, 2.0]))
    second = PiecewiseLinear(times_s=np.array([0.5, 1.5]), values=np.array([0.0, 10.0]))
    total = sum_of(first, second)
    times = np.array([0, 0.5, 0.999, 1, 1.2, 1.5, 1.999, 2, 3])
    assert_allclose(total.at(times), first.at(times) + second.at(times), rtol=1e-14)
    just_before = np.nextafter([1.0, 2.0], 0)
    assert_allclose(total.at(just_before), first.at(just_before) + second.at(just_before), rtol=1e-12)


def test_the_spectrum_holds_its_variance():
    # over f = u / (1 - u), so the slow tail of the first is integrated to its end
    total, _ = quad(lambda u: float(WIND.density(u / (1 - u))) / (1 - u) ** 2, 0, 1, limit=200)
    assert total == pytest.approx(4.0, rel=1e-6)


def test_a_fluctuation_has_its_spectrum_and_no_more():
    highest, rng, power, runs = 5.0, np.random.default_rng(0), 0.0, 40
    for _ in range(runs):
        drawn = fluctuation(WIND, duration_s=90.0, highest_hz=highest, rng=rng)
        # 90 s and 20 time scales are 100 s at 40 a second, the period: its transform has no leakage when complete,
        # but a record of 90 s leaks, so it is tapered
        taper = np.hanning(drawn.values.size)
        spec = np.abs(np.fft.rfft(taper * drawn.values)) ** 2
        power = power + 2 * spec / (40 * np.sum(taper**2)) / runs
    frequency = np.fft.rfftfreq(drawn.values.size, 1 / 40)
    for low, high in ((0.2, 0.5), (0.5, 1), (1, 2), (2, 4.5)):
        band = (frequency >= low) & (frequency < high)
        # at least 40 x 27 / 1.9 independent lines of 100 % scatter each (the taper joins neighbours): 4.2 %; 4 of that
        assert np.mean(power[band]) == pytest.approx(np.mean(WIND.density(frequency[band])), rel=0.17)
    # a Hann taper leaks as the third power of the distance in lines
    assert np.max(power[frequency > highest + 1]) < 1e-6 * np.max(power)
