"""A bank of envelopes is the envelope of each band; a level divided out leaves what repeats faster."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from signals.demodulation.envelope import bank_bands, bank_envelopes, envelope, level_normalised, passband_end_hz
from signals.resampling.resampling import AngularSignal

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("band", [(100.0, 200.0), (0.0, 500.0), (437.5, 500.0)])
def test_each_envelope_is_that_of_its_band(band):
    x = RNG.standard_normal(8000)
    ((rate_hz, values),) = bank_envelopes(x, rate_hz=1000, bands_hz=[band])
    every = 1000 / rate_hz
    shared = np.arange(0, values.size, round(1 / (every % 1)) if every % 1 else 1)
    whole = envelope(x, rate_hz=1000, band_hz=band)
    at = np.round(shared * every).astype(int)
    same = np.isclose(at, shared * every)
    assert same.sum() > 50
    assert_allclose(values[shared][same], whole[at[same]], rtol=1e-9, atol=1e-9)


def test_the_slow_part_is_the_envelope_without_its_fast_lines():
    x = 1e-30 * RNG.standard_normal(20_000)  # whose square single precision does not hold
    every = {(20.0, 270.0): 2, (100.0, 200.0): 5, (300.0, 400.0): 5, (470.0, 480.0): 50}  # 1 / (2 width) in samples
    found = bank_envelopes(x, rate_hz=1000, bands_hz=list(every), highest_hz=40.0)
    for (band, step), (rate_hz, values) in zip(every.items(), found, strict=True):
        assert rate_hz == values.size / 20 >= 2.5 * 40
        lines = np.fft.rfft(envelope(x, rate_hz=1000, band_hz=band)[::step])[: 40 * 20 + 1]
        exact = np.fft.irfft(lines, values.size) * (values.size * step / x.size)
        assert_allclose(values, exact, rtol=0, atol=1e-6 * exact.max())


def test_bands_nest_and_cover_the_range():
    bands = np.array(bank_bands(rate_hz=1000, least_width_hz=50))
    widths = np.diff(bands).ravel()
    for width in (60.0, 120.0, 240.0):
        same = bands[np.isclose(widths, width)]
        assert_allclose([*same[:, 0], 490], np.arange(10, 491, width))
    assert same.size == 4


def test_a_band_that_falls_is_refused():
    with pytest.raises(ValueError, match=r"\(200, 100\) Hz of bands_hz must rise"):
        next(bank_envelopes(np.ones(10), rate_hz=1000, bands_hz=[(200, 100)]))


def over_angle(values, per_rev=32):
    return AngularSignal(values=values, samples_per_rev=per_rev, start_rev=0.0, passband_orders=per_rev / 2.5)


def test_a_level_is_divided_out_and_what_repeats_stays():
    turns = np.arange(200 * 32) / 32
    level = np.exp(np.sin(2 * np.pi * turns / 150))
    x = over_angle(level * (1 + 0.3 * np.cos(2 * np.pi * turns)))
    flat = level_normalised(x, revolutions=8).values
    inner = slice(10 * 32, -10 * 32)
    # over eight turns the level bends by (2 pi 8 / 150)^2 / 24 of itself, some 0.5 %
    assert_allclose(flat[inner] / x.values.mean(), (1 + 0.3 * np.cos(2 * np.pi * turns))[inner], rtol=0.02)


def test_silence_stays_silent():
    assert_allclose(level_normalised(over_angle(np.zeros(320)), revolutions=4).values, 0.0)


@pytest.mark.parametrize("cut_hz", [1000.0, 3000.0, 8000.0])
@pytest.mark.parametrize("floor", [0.0, 1e-3])
def test_a_signal_ends_where_its_filter_takes_20_db(cut_hz, floor):
    noise, sections = RNG.standard_normal((2, 2**17)), signal.butter(8, cut_hz, fs=50_000, output="sos")
    filtered = signal.sosfilt(sections, noise[0]) + floor * noise[1]
    frequency_hz, response = signal.sosfreqz(sections, 25_000, fs=50_000)
    end_hz = frequency_hz[np.flatnonzero(abs(response) > 0.1)[-1]]
    assert passband_end_hz(filtered, rate_hz=50_000) == pytest.approx(end_hz, rel=0.05)  # cells of 49 Hz, and scatter


def test_resonances_and_gentle_filters_end_no_signal():
    noise = RNG.standard_normal(2**17)
    mode = signal.lfilter([1.0], [1.0, -2 * 0.97 * np.cos(2 * np.pi * 2000 / 50_000), 0.97**2], noise)
    gentle = np.fft.irfft(
        np.fft.rfft(noise) / (1 + (np.fft.rfftfreq(2**17, 1 / 50_000) / 3000) ** 2)
    )  # 12 dB per octave
    assert [passband_end_hz(x, rate_hz=50_000) for x in (noise, mode, gentle)] == [25_000.0] * 3
