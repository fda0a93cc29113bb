"""Velocity and displacement of tones in closed form, the limits of ISO 20816, and what is refused."""

import numpy as np
import pytest

from signals.spectra.integration import displacement, velocity

RATE_HZ = 8192.0
COUNT = 4 * 8192  # four seconds: quarters of a hertz are whole cycles
TIMES = np.arange(COUNT) / RATE_HZ


def acceleration(frequency_hz, amplitude=3.0):
    return amplitude * np.cos(2 * np.pi * frequency_hz * TIMES + 0.7)


class TestTones:
    @pytest.mark.parametrize("frequency", [10.0, 333.75, 1000.0])
    def test_whole_cycles_are_exact(self, frequency):
        x, w = acceleration(frequency), 2 * np.pi * frequency
        v = velocity(x, rate_hz=RATE_HZ, units="m s-2")
        d = displacement(x, rate_hz=RATE_HZ, units="m s-2")
        # closed form: sin / w and -cos / w^2, in mm/s and um; rounding of the transform, raised by (1000 / 10)^2
        np.testing.assert_allclose(v.values, 3e3 / w * np.sin(w * TIMES + 0.7), atol=1e-10 * 3e3 / w)
        np.testing.assert_allclose(d.values, -3e6 / w**2 * np.cos(w * TIMES + 0.7), atol=1e-8 * 3e6 / w**2)
        assert v.rms == pytest.approx(3e3 / w / np.sqrt(2), rel=0.02)  # the settled part need not be whole cycles
        assert (v.units, d.units) == ("mm s-1", "um")

    @pytest.mark.parametrize("frequency", [10.1, 999.1])
    def test_any_cycles_are_exact_where_it_has_settled(self, frequency):
        x, w = acceleration(frequency), 2 * np.pi * frequency
        v, d = (f(x, rate_hz=RATE_HZ, units="m s-2") for f in (velocity, displacement))
        skip = int(np.ceil(v.settling_s * RATE_HZ))
        middle = slice(skip, COUNT - skip)
        assert v.settled.size == COUNT - 2 * skip
        # the accuracy the module states at the end of the settling time, with half as much again
        np.testing.assert_allclose(v.settled, 3e3 / w * np.sin(w * TIMES[middle] + 0.7), atol=3e-4 * 3e3 / w)
        np.testing.assert_allclose(d.settled, -3e6 / w**2 * np.cos(w * TIMES[middle] + 0.7), atol=1.5e-3 * 3e6 / w**2)


class TestUnits:
    @pytest.mark.parametrize(
        ("units", "factor"),
        [("m s-2", 1e3), ("mm s-2", 1.0), ("g", 9806.65)],  # the standard gravity of the third CGPM, 1901
    )
    def test_acceleration_to_velocity(self, units, factor):
        v = velocity(acceleration(50.0, 1.0), rate_hz=RATE_HZ, units=units)
        assert np.abs(v.values).max() == pytest.approx(factor / (2 * np.pi * 50), rel=1e-3)  # a sample off the top

    @pytest.mark.parametrize(("units", "factor"), [("g", 9.80665e6), ("mm s-1", 2 * np.pi * 50 * 1e3)])
    def test_to_displacement(self, units, factor):
        d = displacement(acceleration(50.0, 1.0), rate_hz=RATE_HZ, units=units)
        assert np.abs(d.values).max() == pytest.approx(factor / (2 * np.pi * 50) ** 2, rel=1e-3)


class TestBand:
    @pytest.mark.parametrize(
        ("frequency", "least", "most"),
        # ISO 2954: relative sensitivity of a meter of vibration severity from 10 to 1000 Hz
        [(10, 0.8, 1.1), (20, 0.9, 1.1), (80, 1 - 1e-9, 1 + 1e-9), (500, 0.9, 1.1), (1000, 0.8, 1.1)],
    )
    def test_meters_limits(self, frequency, least, most):
        v = velocity(acceleration(frequency), rate_hz=RATE_HZ, units="m s-2")
        # by the root mean square of whole cycles, which has no sample off the top
        assert least < np.sqrt(2 * np.mean(v.values**2)) / (3e3 / (2 * np.pi * frequency)) < most

    @pytest.mark.parametrize("frequency", [1.0, 7.5, 1250.0])
    def test_beyond_its_tapers_nothing_passes(self, frequency):
        v = velocity(acceleration(frequency), rate_hz=RATE_HZ, units="m s-2")
        assert np.abs(v.values).max() < 1e-9 * 3e3 / (2 * np.pi * frequency)  # rounding

    @pytest.mark.parametrize("edge", [10.0, 1000.0])
    def test_half_way_down_the_taper_half_passes(self, edge):
        beyond = edge * (1 - 0.125) if edge == 10 else edge * (1 + 0.125)
        frequency = round(beyond * 4) / 4  # whole cycles
        v = velocity(acceleration(frequency), rate_hz=RATE_HZ, units="m s-2")
        assert np.abs(v.values).max() / (3e3 / (2 * np.pi * frequency)) == pytest.approx(0.5, abs=0.01)

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            (
                {"band_hz": (0.9, 1000.0)},
                "narrower than the 0.25 Hz resolved by a record of 4 s; record at least 4.44 s",
            ),
            ({"band_hz": (0.0, 1000.0)}, "must rise and lie above 0"),
            ({"band_hz": (10.0, 5000.0)}, "up to 4096 Hz"),
            ({"units": "um"}, "units='um' is unknown"),
        ],
    )
    def test_refusals(self, changes, words):
        arguments = {"x": acceleration(50.0), "rate_hz": RATE_HZ, "units": "g"} | changes
        with pytest.raises(ValueError, match=words):
            velocity(arguments.pop("x"), **arguments)

    def test_a_short_record_is_not_judged(self):
        v = velocity(acceleration(50.0)[: COUNT // 4], rate_hz=RATE_HZ, units="g")
        assert v.settled.size == 0
        with pytest.raises(ValueError, match=r"the record of 1 s holds nothing beyond the 1\.2 s"):
            _ = v.rms


def test_the_velocity_of_single_precision_samples():
    rng = np.random.default_rng(8)
    x = rng.standard_normal(100_003).astype(np.float32)
    single, exact = (velocity(samples, rate_hz=5000.0, units="g") for samples in (x, x.astype(np.float64)))
    assert single.values.dtype == np.float32
    np.testing.assert_allclose(single.values, exact.values, rtol=0, atol=3e-6 * exact.rms)
    assert single.rms == pytest.approx(exact.rms, rel=1e-6)


def test_a_reduced_result_has_the_same_rms():
    rate, count = 20_000, 100_000
    rng = np.random.default_rng(3)
    x = np.cos(2 * np.pi * 37.3 * np.arange(count) / rate) + rng.standard_normal(count)
    whole, reduced = (velocity(x, rate_hz=rate, units="g", reduced=one) for one in (False, True))
    assert 25_000 <= reduced.values.size < 27_000  # four times 1250 Hz in 5 s, or the next length with small factors
    assert reduced.values.size / reduced.rate_hz == pytest.approx(count / rate)
    # the mean squares differ by what the settled part has more or less at its ends: a sample of 22,600
    assert reduced.rms == pytest.approx(whole.rms, rel=1e-3)
    # the values are those of the whole result at fewer instants: both have the same lines
    some, every = (np.fft.rfft(one.values)[:7000] / one.values.size for one in (reduced, whole))
    np.testing.assert_allclose(some, every, atol=1e-12 * np.abs(every).max())
