"""What pictures need: against a signal whose amplitude, average and resonance follow from its formula."""

import numpy as np
import pytest

import hums
from hums.analysis.pictures import AVERAGES, KURTOGRAM, ORDER_MAP, WAVEFORM, WIDEBAND, pictures_of

RATE_HZ, SPEED_HZ, SECONDS, AMPLITUDE, RING_HZ = 8000.0, 20.0, 4.0, 0.5, 3000.0


@pytest.fixture(scope="module")
def record():
    times = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    mesh = AMPLITUDE * np.cos(2 * np.pi * 23 * SPEED_HZ * times)
    since = times % 0.05
    ring = 3 * np.exp(-1500 * since) * np.sin(2 * np.pi * RING_HZ * since)
    values = mesh + ring + np.random.default_rng(0).normal(0, 0.02, times.size)
    pulses = hums.PulseTimes(times_s=np.arange(0.0, SECONDS, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1)
    return hums.make_record({"a b": values, "other": values[::-1].copy()}, rate_hz=RATE_HZ, units="g", angle=pulses)


@pytest.fixture(scope="module")
def analysis(record):
    return hums.analyze(record, hums.load_gearbox("two-stage"))


def first(analysis, name):
    channel, picture = next(pictures_of(analysis, name))
    assert channel == "a b"
    return picture


def test_every_channel_has_its_pictures(analysis):
    for name in (WAVEFORM, ORDER_MAP, AVERAGES, KURTOGRAM):
        assert [channel for channel, _ in pictures_of(analysis, name)] == ["a b", "other"]


@pytest.mark.parametrize(
    ("picture", "names"),
    [
        (WAVEFORM, ("least", "largest", "excerpt")),
        (WIDEBAND, ("amplitude",)),
        (ORDER_MAP, ("amplitude",)),
        (AVERAGES, ("average", "difference")),
    ],
)
def test_values_are_in_the_unit_of_their_channel(analysis, picture, names):
    assert [first(analysis, picture)[name].attrs["units"] for name in names] == ["g"] * len(names)


def test_no_sample_is_beyond_the_waveform(analysis, record):
    picture, values = first(analysis, WAVEFORM), record["a b"].to_numpy()
    assert (float(picture["least"].min()), float(picture["largest"].max())) == (values.min(), values.max())
    peak = np.abs(values - values.mean()).max() + values.mean()
    assert peak in picture["excerpt"].to_numpy()
    middle = picture["excerpt_time_s"].to_numpy()
    np.testing.assert_array_equal(picture["excerpt"], values[np.rint(middle * RATE_HZ).astype(int)])


def test_a_row_of_the_map_holds_the_amplitude_and_the_speed(analysis):
    picture = first(analysis, ORDER_MAP)
    mesh = picture["amplitude"].sel(order=23, method="nearest")
    np.testing.assert_allclose(mesh, AMPLITUDE, atol=0.02)  # noise of 0.02, and the ringing's share of this order
    np.testing.assert_allclose(picture["speed_hz"], SPEED_HZ, rtol=1e-6)
    assert np.all(np.diff(picture["time_s"]) > 0)


def test_the_average_of_a_gear_is_its_mesh(analysis):
    picture = first(analysis, AVERAGES)
    components = picture["component"].to_numpy().tolist()
    at = components.index("stage 1/pinion")
    size = int(picture["size"][at])
    start = int(picture["size"][:at].sum())
    average = picture["average"].to_numpy()[start : start + size]
    lines = 2 * np.abs(np.fft.rfft(average)) / size
    assert lines[23] == pytest.approx(AMPLITUDE, abs=0.02)
    assert int(picture["teeth"][at]) == 23
    assert int(picture["size"].sum()) == picture.sizes["angle"]


def test_the_kurtogram_is_highest_where_impacts_ring(analysis):
    picture = first(analysis, KURTOGRAM)
    best = picture.isel(band=int(np.nanargmax(picture["kurtosis"].to_numpy())))
    assert float(best["low_hz"]) <= RING_HZ <= float(best["high_hz"])


def test_an_analysis_without_pictures(record):
    settings = hums.AnalysisSettings(channels=("other",), pictures=False, envelope_band_hz=None, most_tracks=0)
    analysis = hums.analyze(record, hums.load_gearbox("two-stage"), settings=settings)
    assert not list(pictures_of(analysis, WAVEFORM))


@pytest.mark.parametrize("limits", [(1.8, 1.8, 4.5), (4.5, 2.8, 1.8)])
def test_limits_of_zones_rise(limits):
    with pytest.raises(hums.AnalysisError, match="must rise"):
        hums.AnalysisSettings(velocity_limits_mm_s=limits)
