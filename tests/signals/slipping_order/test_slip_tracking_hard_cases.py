"""A slipping order where the shaft turns back or rests, where nothing is there, in odd units and short records."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom

from signals.harmonics import Bandwidth
from signals.slipping_order.slip_tracking import track_slipping_order

ORDER, PER_REV, CHANGE, WIDTH = 9.46, 64, 5e-4, 0.05
SETTING = {
    "order": ORDER,
    "largest_slip": 0.02,
    "slip_change_per_rev": CHANGE,
    "bandwidth_orders": WIDTH,
    "samples_per_rev": PER_REV,
}
UNKNOWN_PHASE = np.pi / np.sqrt(3)  # std of an even spread over a turn


def revolutions(motion):
    """Angle of a shaft that turns at one speed, backwards at times, or rests."""
    out = np.arange(50 * PER_REV) / PER_REV
    back = out[-1] - out
    return {
        "out and back": np.concatenate([out, back]),
        "partly back": np.concatenate([out, back[: 20 * PER_REV]]),
        "at rest for most of the time": np.concatenate([out, np.full(200 * PER_REV, out[-1]), out[-1] + out]),
        "rocking": 8 * np.arcsin(np.sin(out * np.pi / 16)) / np.pi * 2,
    }[motion]


def drawn(rev, *, seed, noise=0.5):
    """Draw a record from the model over this angle; return it with the true slip and the harmonic at rest."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * rev
    step = np.diff(phase)
    change = CHANGE * np.sqrt(np.abs(step) / (2 * np.pi))
    slip = rng.uniform(-0.01, 0.01) + np.append(0.0, np.cumsum(change * rng.standard_normal(step.size)))
    turn = np.append(0.0, np.cumsum(ORDER * slip[:-1] * step))
    q = 2 * noise / Bandwidth(width=WIDTH / PER_REV, poles=1).weight ** 2
    walk = rng.standard_normal((2, rev.size)) * np.sqrt(q)
    amplitude = np.exp(2j * np.pi * rng.uniform()) + np.cumsum(walk[0] + 1j * walk[1])
    x = (amplitude * np.exp(1j * (ORDER * phase + turn))).real + np.sqrt(noise) * rng.standard_normal(rev.size)
    return x, phase, slip, amplitude * np.exp(1j * turn)


@pytest.mark.parametrize("motion", ["out and back", "partly back", "at rest for most of the time", "rocking"])
def test_a_shaft_may_turn_back_and_rest(motion):
    rev = revolutions(motion)
    inside = []
    for seed in range(8):
        x, phase, slip, truth = drawn(rev, seed=seed)
        track = track_slipping_order(x, phase_rad=phase, **SETTING)
        assert track.converged
        # A 200th of 1 / bandwidth, however long it rests: 6 samples, and an odd number has a middle one.
        assert np.all(np.diff(track.sample_index) <= 7)
        # Half of some 100 bins count, of which the window makes two dependent; the std of their median is a fifth.
        assert track.noise_variance == pytest.approx(0.5, rel=0.6)
        found = track.complex_amplitude[0] * np.exp(1j * track.slip_phase_rad)
        at = track.sample_index
        inside.append(
            [
                np.mean(np.abs(np.abs(found) - np.abs(truth[at])) < 1.96 * track.amplitude_std[0]),
                np.mean(np.abs(np.angle(found / truth[at])) < 1.96 * track.phase_std_rad[0]),
                np.mean(np.abs(track.slip - slip[at]) < 1.96 * track.slip_std),
            ]
        )
    # Each record holds 4 independent amplitudes or more, 32 in all: 95 % +- 4 %; R, measured, moves the std by a tenth.
    assert np.all(np.mean(inside, axis=0) > 0.85)


def test_before_any_sample_the_filter_knows_no_phase():
    rev = np.arange(100 * PER_REV) / PER_REV
    x, phase, slip, truth = drawn(rev, seed=1)
    x[: x.size // 2] = np.nan
    track = track_slipping_order(x, phase_rad=phase, estimator="filter", noise_variance=0.5, **SETTING)
    blind = track.sample_index < x.size // 2 - 5
    assert np.all(track.complex_amplitude[:, blind] == 0)
    assert np.all(track.phase_std_rad[:, blind] == UNKNOWN_PHASE)
    # Nothing is known of it but the prior: 1000 standard deviations of the noise, and what walks before a sample.
    assert np.all(track.amplitude_std[:, blind] == track.std[:, blind])
    assert_allclose(track.std[0, 0], 1000 * np.sqrt(0.5), rtol=1e-9)
    late = track.sample_index > 0.8 * x.size
    at = track.sample_index[late]
    assert np.all(
        np.abs(np.abs(track.complex_amplitude[0, late]) - np.abs(truth[at])) < 5 * track.amplitude_std[0, late]
    )
    assert np.all(np.abs(track.slip[late] - slip[at]) < 5 * track.slip_std[late])
    assert np.all(track.phase_std_rad[0, late] < 0.5)


@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_a_silent_record_has_no_line_and_no_phase(estimator):
    x = np.zeros(30 * PER_REV)
    phase = 2 * np.pi * np.arange(x.size) / PER_REV
    track = track_slipping_order(x, phase_rad=phase, noise_variance=4.0, estimator=estimator, **SETTING)
    assert track.status == "no line"
    assert track.false_alarm_probability == 1
    assert np.all(track.complex_amplitude == 0)
    assert np.all(track.phase_std_rad == UNKNOWN_PHASE)
    assert_allclose(track.amplitude_std, track.std, rtol=0)
    # 2 R over the samples taken in, which all of the record can at most be.
    assert np.all(track.std > np.sqrt(2 * 4.0 / x.size))
    assert np.all(track.slip_std >= 0.02 / np.sqrt(3))


def noise_records(samples, count):
    return np.random.default_rng(samples).standard_normal((count, samples))


@pytest.mark.parametrize("samples", [4, 5, 8, 16, 32, 63])
def test_a_record_too_short_to_measure_its_noise_is_refused(samples):
    phase = 2 * np.pi * np.arange(samples) / PER_REV
    for x in noise_records(samples, 10):
        with pytest.raises(ValueError, match=r"turned too little|take a longer record .* or pass noise_variance"):
            track_slipping_order(x, phase_rad=phase, **SETTING)


CASES = [
    # samples, samples a revolution, order, harmonics, whether R is given
    (96, 64, 9.46, 1, False),
    (300, 64, 2.1, 3, False),
    (600, 16, 0.4, 1, False),
    (20, 8, 2.3, 1, True),
    (100, 100, 1.05, 3, True),  # a turn
]


@pytest.mark.parametrize(("samples", "per_rev", "order", "harmonics", "given"), CASES)
def test_noise_passes_for_a_line_as_rarely_as_stated(samples, per_rev, order, harmonics, given):
    phase = 2 * np.pi * np.arange(samples) / per_rev

    def chance(x):
        changed = {"order": order, "samples_per_rev": per_rev, "harmonics": harmonics, "most_iterations": 1}
        noise_variance = 1.0 if given else None
        tracked = track_slipping_order(x, phase_rad=phase, noise_variance=noise_variance, **SETTING | changed)
        return tracked.false_alarm_probability

    noise = noise_records(samples, 300)
    found = np.array([chance(x) for x in noise])
    for level in (0.01, 0.1, 0.5):
        # More than this happens by chance once in a thousand.
        assert np.sum(found <= level) <= binom.ppf(0.999, found.size, level)
    # And a line is seen: 100 times the variance of the noise that is left of it when its power is summed.
    amplitude = np.sqrt(4 * 100 / samples)
    lines = noise[:20] + amplitude * np.cos(0.99 * order * phase + 0.5)
    assert np.all([chance(x) < 1e-3 for x in lines])


@pytest.mark.parametrize("every", [33, 501, 6400, 6401, 10**6])
def test_one_output_for_much_of_the_record_is_no_surer_for_it(every):
    x, phase, *_ = drawn(np.arange(100 * PER_REV) / PER_REV, seed=2)
    setting = SETTING | {"phase_rad": phase, "noise_variance": 0.5}
    dense = track_slipping_order(x, **setting)
    few = track_slipping_order(x, output_every=every, **setting)
    assert few.slip.size == max(1, round(x.size / every))
    assert np.all(np.diff(few.sample_index)[:-1] == every)
    near = np.abs(dense.sample_index - few.sample_index[:, None]).argmin(axis=1)
    # The blocks are not the same: theirs differ by a few 1e-4 of the std, their middles by up to half a block.
    assert_allclose(few.slip_std, dense.slip_std[near], rtol=0.02)
    assert np.all(np.abs(few.slip - dense.slip[near]) < 0.1 * dense.slip_std[near])
    assert few.objective[-1] == pytest.approx(dense.objective[-1], rel=0.02)


@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_an_offset_of_the_record_does_not_matter(estimator):
    x, phase, *_ = drawn(np.arange(60 * PER_REV) / PER_REV, seed=2)
    given = {"phase_rad": phase, "estimator": estimator, **SETTING}
    one, other = (track_slipping_order(x + offset, **given) for offset in (0.0, 5 * np.std(x)))
    later = one.sample_index > 20 * PER_REV  # the filter has to learn the offset
    assert np.abs((other.complex_amplitude - one.complex_amplitude)[:, later] / one.std[:, later]).mean() < 0.2
    assert np.abs((other.slip - one.slip)[later] / one.slip_std[later]).mean() < 0.2


@pytest.mark.parametrize("unit", [1e-115, 1e-40, 1e40, 1e115])
def test_the_unit_of_the_record_does_not_matter(unit):
    x, phase, *_ = drawn(np.arange(30 * PER_REV) / PER_REV, seed=2)
    one, other = (track_slipping_order(scale * x, phase_rad=phase, **SETTING) for scale in (1.0, unit))
    # Steps of Gauss and Newton end where they are below 1e-7 standard deviations.
    assert_allclose(other.slip, one.slip, atol=1e-5 * one.slip_std.min())
    assert_allclose(other.complex_amplitude / unit, one.complex_amplitude, atol=1e-5 * one.std.min())
    assert_allclose(other.amplitude_std / unit, one.amplitude_std, rtol=1e-5)
    assert other.noise_variance / unit / unit == pytest.approx(one.noise_variance, rel=1e-9)
    assert other.false_alarm_probability == pytest.approx(one.false_alarm_probability, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-300, 1e-160, 1e-122, 1e122, 1e155, 1e300])
def test_a_unit_beyond_double_precision_is_refused(unit):
    x, phase, *_ = drawn(np.arange(10 * PER_REV) / PER_REV, seed=2)
    with pytest.raises(ValueError, match=r"x reaches .* whose square is lost .* between 1e-120 and 1e\+120"):
        track_slipping_order(unit * x, phase_rad=phase, **SETTING)


@pytest.mark.parametrize("noise", [1e-22, 1e-30])
def test_a_noise_far_below_what_is_left_over_does_not_converge(noise):
    x, phase, *_ = drawn(np.arange(10 * PER_REV) / PER_REV, seed=2)
    track = track_slipping_order(x, phase_rad=phase, noise_variance=noise, **SETTING)
    assert track.status == "not converged"
    assert track.objective[-1] > 1e15 * x.size


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_noise_whose_squares_overflow_is_refused():
    x, phase, *_ = drawn(np.arange(10 * PER_REV) / PER_REV, seed=2)
    with pytest.raises(FloatingPointError, match=r"covariance .* times the noise.* a larger noise_variance"):
        track_slipping_order(1e100 * x, phase_rad=phase, noise_variance=1e-200, **SETTING)
