"""Condition indicators against closed forms, brute force and the moments of Gaussian noise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from signals import indicators as ci
from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import (
    DifferenceSignal,
    MeshBand,
    RegularSignal,
    ResidualSignal,
    difference_signal,
    mesh_band,
    regular_signal,
    residual_signal,
)
from signals.indicators import INDICATORS, VarianceHistory
from signals.spectra.spectra import AmplitudeSpectrum, amplitude_spectrum

N = 3600
ANGLE = 2 * np.pi * np.arange(N) / N
NOISE = np.random.default_rng(5).normal(size=4096)
TEETH = 20
EXACT = 1e-11  # sums of some thousand rounded terms, ratios of them


@pytest.fixture
def rng():
    return np.random.default_rng(6)


def average(values, **more):
    return SynchronousAverage(values=values, standard_error=np.zeros(values.size), revolutions=10, **more)


def difference(values):
    return DifferenceSignal(values=values, removed_orders=(0,))


def residual(values):
    return ResidualSignal(values=values, removed_orders=(0,))


def band(values, sidebands=18):
    return mesh_band(average(values), mesh_order=TEETH, sidebands=sidebands)


# ---- any waveform ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [3.0, 1e-160, 1e160])
def test_a_sine(scale):
    sine = scale * np.sin(4 * ANGLE)  # a quarter of a cycle is 225 samples: the peaks are on the grid
    assert ci.peak(sine) == pytest.approx(scale, rel=EXACT)
    assert ci.crest_factor(sine) == pytest.approx(np.sqrt(2), rel=EXACT)
    assert ci.kurtosis(sine) == pytest.approx(1.5, rel=EXACT)


@pytest.mark.parametrize("wrap", [np.asarray, average])
def test_level_about_the_mean(wrap):
    sine = wrap(5.0 + 3.0 * np.sin(4 * ANGLE))
    assert ci.rms(sine) == pytest.approx(3 / np.sqrt(2), rel=EXACT)
    assert ci.peak(sine) == pytest.approx(3.0, rel=EXACT)


def test_a_constant_has_no_shape():
    for indicator in (ci.kurtosis, ci.crest_factor):
        with pytest.raises(ValueError, match="of a constant signal is not defined"):
            indicator(np.full(10, 3.0))


# ---- shafts ------------------------------------------------------------------------------------------------


def test_shaft_orders():
    turning = average(0.3 * np.cos(ANGLE + 1) + 0.2 * np.cos(2 * ANGLE) + 0.1 * np.sin(3 * ANGLE) + 7)
    found = [ci.so1(turning), ci.so2(turning), ci.so3(turning), ci.shaft_order(turning, order=4)]
    assert_allclose(found, [0.3, 0.2, 0.1, 0], atol=1e-13)


def test_an_order_that_the_average_does_not_pass():
    with pytest.raises(ValueError, match="order 3 lies above 2"):
        ci.so3(average(np.cos(ANGLE), passband_orders=2.5))
    with pytest.raises(ValueError, match="order 4 lies above 3"):
        ci.shaft_order(average(np.arange(8.0)), order=4)


# ---- gears -------------------------------------------------------------------------------------------------


def test_fm0_of_pure_mesh_tones():
    assert ci.fm0(average(2 * np.cos(TEETH * ANGLE)), teeth=TEETH, harmonics=1) == pytest.approx(2, rel=EXACT)
    # cos a + cos(2a) / 2 = c^2 + c - 1/2 with c = cos a: from -3/4 at c = -1/2, which is on the grid, to 3/2
    two = np.cos(TEETH * ANGLE) + 0.5 * np.cos(2 * TEETH * ANGLE)
    assert ci.fm0(average(two), teeth=TEETH, harmonics=2) == pytest.approx(2.25 / 1.5, rel=EXACT)
    assert ci.fm0(average(two), teeth=TEETH, harmonics=1) == pytest.approx(2.25, rel=EXACT)


def test_moments_by_another_hand(rng):
    x = rng.exponential(size=500)
    assert ci.kurtosis(x) == pytest.approx(stats.kurtosis(x, fisher=False), rel=EXACT)
    for indicator, order in ((ci.fm4, 4), (ci.m6a, 6), (ci.m8a, 8)):
        by_scipy = stats.moment(x, order) / stats.moment(x, 2) ** (order / 2)
        assert indicator(difference(x)) == pytest.approx(by_scipy, rel=EXACT)


def test_na4_by_its_definition(rng):
    runs = rng.normal(size=(7, 300)) * np.linspace(1, 2, 7)[:, None]
    history = VarianceHistory()
    for run in runs:
        history = history.update(residual(run))
    top = sum((value - runs[-1].mean()) ** 4 for value in runs[-1])
    below = sum(sum((value - run.mean()) ** 2 for value in run) for run in runs) / len(runs)
    assert ci.na4(residual(runs[-1]), history=history) == pytest.approx(300 * top / below**2, rel=EXACT)


def test_energy_ratio():
    turning = average(np.cos(TEETH * ANGLE) + 0.1 * np.cos(7 * ANGLE) + 4)
    left = difference_signal(turning, teeth=TEETH, harmonics=2, shaft_orders=(1,))
    assert ci.energy_ratio(left, regular_signal(turning, left=left)) == pytest.approx(0.1, rel=1e-9)


def test_energy_operator_by_its_definition(rng):
    x = rng.normal(size=100)
    teager = np.array([x[i] ** 2 - x[i - 1] * x[(i + 1) % 100] for i in range(100)])
    wanted = stats.kurtosis(teager, fisher=False)
    assert ci.energy_operator(residual(x)) == pytest.approx(wanted, rel=EXACT)
    assert ci.energy_operator(residual(1e-120 * x)) == pytest.approx(wanted, rel=EXACT)


def test_first_sidebands():
    # (1 + 0.4 cos a) cos 20 a has sidebands of 0.2 and a mean square of (1 + 0.4^2 / 2) / 2
    turning = average((1 + 0.4 * np.cos(ANGLE)) * np.cos(TEETH * ANGLE))
    assert ci.sideband_index(turning, teeth=TEETH) == pytest.approx(0.2, rel=EXACT)
    assert ci.sideband_level_factor(turning, teeth=TEETH) == pytest.approx(0.4 / np.sqrt(0.54), rel=EXACT)


# ---- the mesh, demodulated ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("depth", "index", "per_rev"), [(0.0, 0.0, 1), (0.3, 0.2, 1), (0.0, 0.4, 2), (0.8, 0.0, 1)])
def test_a_mesh_of_known_modulation(depth, index, per_rev):
    modulated = 2 * (1 + depth * np.cos(ANGLE)) * np.cos(TEETH * ANGLE + index * np.sin(per_rev * ANGLE) + 0.7)
    found = band(modulated)
    # the band ends at 18 sidebands, where J_6(0.4) = 9e-8 is the largest that is left out
    assert ci.amplitude_modulation(found) == pytest.approx(depth, abs=1e-6)
    assert ci.phase_modulation(found) == pytest.approx(index, abs=1e-6)
    assert ci.frequency_modulation(found) == pytest.approx(index * per_rev / TEETH, abs=1e-6)
    if depth:
        assert ci.amplitude_modulation_kurtosis(found) == pytest.approx(1.5, rel=1e-5)
    if index:
        assert ci.frequency_modulation_kurtosis(found) == pytest.approx(1.5, rel=1e-5)


def test_nb4():
    found = band((1 + 0.3 * np.cos(ANGLE)) * np.cos(TEETH * ANGLE))
    history = VarianceHistory().update(found)
    assert ci.nb4(found, history=history) == pytest.approx(1.5, rel=EXACT)  # the envelope is a sine
    deeper = band((1 + 0.6 * np.cos(ANGLE)) * np.cos(TEETH * ANGLE))
    assert ci.nb4(deeper, history=history.freeze()) == pytest.approx(1.5 * 16, rel=EXACT)
    # mean of the two variances, 1 and 4 times the first: 1.5 * (4 / 2.5)^2
    assert ci.nb4(deeper, history=history.update(deeper)) == pytest.approx(1.5 * 1.6**2, rel=EXACT)


def test_a_sideband_above_the_mesh_leaves_no_carrier():
    lost = band(0.5 * np.cos(TEETH * ANGLE) + np.cos((TEETH + 2) * ANGLE))
    for indicator in (ci.phase_modulation, ci.frequency_modulation):
        with pytest.raises(ValueError, match="slips by 2 cycles"):
            indicator(lost)


# ---- the history -------------------------------------------------------------------------------------------


def test_a_history_is_the_mean_and_scatter_of_variances(rng):
    runs = rng.normal(size=(9, 50))
    first = history = VarianceHistory()
    for run in runs:
        history = history.update(residual(run))
    variances = runs.var(axis=1)
    assert (history.records, history.kind) == (9, "residual")
    assert history.mean_variance == pytest.approx(variances.mean(), rel=EXACT)
    assert history.std == pytest.approx(variances.std(ddof=1), rel=EXACT)
    assert first == VarianceHistory()  # an update leaves the one before as it was


def test_a_history_freezes_itself_at_the_first_record_beyond_its_limit(rng):
    history = VarianceHistory(limit_std=4.0, learning=10)
    for _ in range(30):
        history = history.update(residual(rng.normal(size=400)))
    assert not history.frozen
    before = history.mean_variance
    history = history.update(residual(2 * rng.normal(size=400)))
    assert history.frozen
    assert history.update(residual(NOISE)) is history
    assert history.records == 30
    assert history.mean_variance == before


def test_a_history_keeps_to_one_signal():
    history = VarianceHistory().update(residual(NOISE))
    with pytest.raises(ValueError, match="holds the variance of the residual, not of the mesh envelope"):
        ci.nb4(band(np.cos(TEETH * ANGLE)), history=history)
    with pytest.raises(TypeError, match=r"takes a ResidualSignal .* not a DifferenceSignal"):
        history.update(difference(NOISE))
    with pytest.raises(ValueError, match="holds no record yet"):
        ci.na4(residual(NOISE), history=VarianceHistory())
    with pytest.raises(ValueError, match="holds no record yet"):
        VarianceHistory().freeze()
    with pytest.raises(TypeError, match="takes a VarianceHistory"):
        ci.na4(residual(NOISE), history=1.0)


# ---- bearings and planets ----------------------------------------------------------------------------------


def test_energy_at_defect_lines(rng):
    per_rev, turns = 64, 200
    revolutions = np.arange(per_rev * turns) / per_rev
    heights = [0.5, 0.3, 0.2]
    lines = sum(a * np.cos(2 * np.pi * 3.57 * k * revolutions) for k, a in enumerate(heights, start=1))
    spectrum = amplitude_spectrum(lines + 1e-3 * rng.normal(size=lines.size), rate=per_rev)
    found = ci.defect_energy(spectrum, order=3.6, harmonics=3, tolerance=0.02, background_width=2.0)
    assert_allclose(found.orders, [3.57, 7.14, 10.71], atol=spectrum.axis[1])
    assert_allclose(found.amplitude, heights, rtol=3e-3)  # the padded grid meets a Hann line within 0.25 %
    assert found.energy == pytest.approx(sum(a**2 for a in heights) / 2, rel=6e-3)
    assert found.ratio > 1e4


def test_defect_lines_that_cannot_be_judged(rng):
    spectrum = amplitude_spectrum(rng.normal(size=640), rate=64)
    with pytest.raises(ValueError, match=r"harmonic 9 of 3\.6 extends to 32\.724, beyond the end"):
        ci.defect_energy(spectrum, order=3.6, harmonics=9, tolerance=0.01, background_width=2.0)
    with pytest.raises(ValueError, match="only 0 points of the spectrum"):
        ci.defect_energy(spectrum, order=3.6, harmonics=1, tolerance=0.01, background_width=0.1)


@pytest.mark.parametrize("ring_teeth", [98, 99])
def test_planets_that_pass_a_sensor(ring_teeth):
    def passing(gains):
        places = 2 * np.pi * np.arange(3) / 3
        return sum(
            g * (1 + np.cos(ANGLE - place)) * np.cos(ring_teeth * (ANGLE - place))
            for g, place in zip(gains, places, strict=True)
        )

    settings = {"ring_teeth": ring_teeth, "planets": 3, "harmonic": 1, "sidebands": 3}
    assert ci.carrier_sideband_ratio(average(passing([1, 1, 1])), **settings) < 1e-13
    # each planet has lines 1/2, 1, 1/2; where they add up (orders 96, 99, 102) the gains do, elsewhere 0.1 is left
    window = {ring_teeth - 1: 0.5, ring_teeth: 1.0, ring_teeth + 1: 0.5}
    orders = np.arange(ring_teeth - 3, ring_teeth + 4)
    height = np.array([window.get(k, 0) * (3.1 if k % 3 == 0 else 0.1) for k in orders])
    wanted = np.sqrt(np.mean(height[orders % 3 != 0] ** 2) / np.mean(height[orders % 3 == 0] ** 2))
    assert ci.carrier_sideband_ratio(average(passing([1.1, 1, 1])), **settings) == pytest.approx(wanted, rel=1e-10)


def test_sidebands_of_a_carrier_that_do_not_fit():
    with pytest.raises(ValueError, match="extend below order 1"):
        ci.carrier_sideband_ratio(average(NOISE), ring_teeth=20, planets=3, harmonic=1, sidebands=20)
    with pytest.raises(ValueError, match="sidebands=2 must be a whole number of at least 3"):
        ci.carrier_sideband_ratio(average(NOISE), ring_teeth=20, planets=3, harmonic=1, sidebands=2)


# ---- all of them -------------------------------------------------------------------------------------------

SETTINGS = {
    "teeth": TEETH,
    "harmonics": 2,
    "history": None,
    "order": 3.6,
    "tolerance": 0.01,
    "background_width": 2.0,
    "ring_teeth": 30,
    "planets": 3,
    "harmonic": 1,
    "sidebands": 4,
}


def signals_of(values):
    turning = average(values)
    settings = {"teeth": TEETH, "harmonics": 2, "shaft_orders": (1,)}
    left = difference_signal(turning, **settings)
    return {
        np.ndarray: values,
        SynchronousAverage: turning,
        ResidualSignal: residual_signal(turning, **settings),
        DifferenceSignal: left,
        RegularSignal: regular_signal(turning, left=left),
        MeshBand: mesh_band(turning, mesh_order=TEETH, sidebands=5),
        AmplitudeSpectrum: amplitude_spectrum(np.tile(values, 20), rate=values.size, maximum=100),
    }


def settings_of(indicator, given):
    history = VarianceHistory().update(given[0]) if "history" in indicator.needs else None
    return {need: history if need == "history" else SETTINGS[need] for need in indicator.needs}


@pytest.mark.parametrize("indicator", INDICATORS.values(), ids=lambda indicator: indicator.name)
class TestEach:
    values = np.cos(TEETH * ANGLE) + 0.1 * np.cos(ANGLE) + 0.1 * NOISE[:N]

    def test_grows_with_the_signal_as_its_unit_says(self, indicator):
        ones, twos = signals_of(self.values), signals_of(2 * self.values)
        found = []
        for signals in (ones, twos):
            given = [signals[kind] for kind in indicator.takes]
            value = indicator(*given, **settings_of(indicator, given))
            found.append(value.energy if indicator.part == "bearing" else value)
        power = {"signal": 1, "unit of the spectrum squared": 2}.get(indicator.unit, 0)
        assert found[1] / found[0] == pytest.approx(2**power, rel=1e-6)

    def test_refuses_every_other_signal(self, indicator):
        signals = signals_of(self.values)
        given = [signals[kind] for kind in indicator.takes]
        also = {SynchronousAverage} if indicator.takes == (np.ndarray,) else set()
        settings = settings_of(indicator, given)
        for kind in signals.keys() - set(indicator.takes[:1]) - also:
            with pytest.raises((TypeError, ValueError), match=r"takes (a|the) |real array"):
                indicator(signals[kind], *given[1:], **settings)
