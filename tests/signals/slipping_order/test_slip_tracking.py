"""A slipping order: against bounds in closed form, scipy's optimum, the plain tracker, its own model, and a turbine."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import loadmat
from scipy.optimize import least_squares

from signals.demodulation.envelope import envelope
from signals.harmonics import Bandwidth, track_orders
from signals.resampling.resampling import angular_resample
from signals.shaft.tachometer import shaft_phase
from signals.slipping_order.slip_tracking import track_slipping_order
from signals.spectra.spectra import order_spectrum

ORDER = 9.46


def tracked(x, phase, **changes):
    """Track the line of 9.46 orders over an angle of 64 samples a revolution, but for what is changed."""
    setting = {"order": ORDER, "largest_slip": 0.02, "slip_change_per_rev": 5e-4, "samples_per_rev": 64}
    return track_slipping_order(x, phase_rad=phase, **setting | changes)


def line(slip, *, samples_per_rev, order=ORDER):
    """Phase of the shaft, and the turn of a line beyond `order phase`: the sum of its slip, sample by sample."""
    phase = 2 * np.pi * np.arange(slip.size) / samples_per_rev
    return phase, np.concatenate([[0.0], np.cumsum(order * slip[:-1] * np.diff(phase))])


def drawn(seed, *, revolutions, samples_per_rev, noise, bandwidth, change, harmonics=1):
    """Draw a record from the model, sample by sample; return it with the true slip and the harmonics at rest."""
    rng = np.random.default_rng(seed)
    n = revolutions * samples_per_rev
    slip = rng.uniform(-0.01, 0.01) + np.cumsum(change / np.sqrt(samples_per_rev) * rng.standard_normal(n))
    phase, turn = line(slip, samples_per_rev=samples_per_rev)
    q = 2 * noise / Bandwidth(width=bandwidth / samples_per_rev, poles=1).weight ** 2
    walk = rng.standard_normal((2, harmonics, n)) * np.sqrt(q)
    amplitude = np.exp(2j * np.pi * rng.uniform(size=(harmonics, 1))) + np.cumsum(walk[0] + 1j * walk[1], axis=1)
    number = np.arange(1, harmonics + 1)[:, None]
    x = np.sum((amplitude * np.exp(1j * number * (ORDER * phase + turn))).real, axis=0)
    return x + np.sqrt(noise) * rng.standard_normal(n), phase, slip, amplitude * np.exp(1j * number * turn)


def at_rest(track):
    """Amplitudes as the nominal phase sees them."""
    number = np.arange(1, len(track.complex_amplitude) + 1)
    return track.complex_amplitude * np.exp(1j * np.outer(number, track.slip_phase_rad))


def rms(values):
    return np.sqrt(np.mean(np.abs(values) ** 2))


@pytest.fixture(scope="module")
def swaying():
    """A line of amplitude 1 that sways by +-1 % in 200 revolutions, 18 dB below the noise."""
    samples_per_rev, noise = 128, 36.0
    n = np.arange(400 * samples_per_rev)
    slip = 0.01 * np.sin(2 * np.pi * n / (200 * samples_per_rev))
    phase, turn = line(slip, samples_per_rev=samples_per_rev)
    rng = np.random.default_rng(1)
    x = np.cos(ORDER * phase + turn + 0.4) + np.sqrt(noise) * rng.standard_normal(n.size)
    return x, phase, slip, np.exp(1j * (turn + 0.4))


def test_a_swaying_line_is_followed(swaying):
    x, phase, slip, truth = swaying
    # The sway is at most 0.01 2 pi / 200 = 3e-4 a revolution; over the ten or so that can be told apart, 1e-3 sqrt(10).
    track = tracked(x, phase, slip_change_per_rev=6e-4, bandwidth_orders=0.01, samples_per_rev=128)
    assert track.status == "converged"
    assert track.false_alarm_probability < 1e-20
    at = track.sample_index
    # 0.12 of the amplitude is the tracker's own std at this bandwidth, 1/9 of the sway that of the slip.
    assert rms(np.abs(track.complex_amplitude[0]) - 1) < 0.15
    assert rms(track.slip - slip[at]) < 0.01 / 9
    # A sway is smoother than a walk, so the errors are below the std of one that would need the walk.
    assert rms(track.slip - slip[at]) < np.mean(track.slip_std)
    assert rms(at_rest(track)[0] - truth[at]) < 0.35
    # R comes from some 350 independent cells of exponential power: the median's std is 1.44 / sqrt(350), or 8 %.
    assert track.noise_variance == pytest.approx(36, rel=0.2)
    assert 2 * track.objective[-1] == pytest.approx(x.size, rel=0.2)


def test_a_constant_slip_is_as_sure_as_the_cramer_rao_bound():
    # Frequency of a sinusoid with unknown amplitude and phase: 24 R / (A^2 n (n^2 - 1)) in (rad a sample)^2
    # (Rife and Boorstyn 1974).
    samples_per_rev, n, noise = 32, 3200, 0.5
    bound = np.sqrt(24 * noise / (n * (n**2 - 1.0))) / (ORDER * 2 * np.pi / samples_per_rev)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        phase, turn = line(np.full(n, -0.0083), samples_per_rev=samples_per_rev)
        x = np.cos(ORDER * phase + turn) + np.sqrt(noise) * rng.standard_normal(n)
        track = tracked(
            x,
            phase,
            slip_change_per_rev=1e-8,
            bandwidth_orders=1e-5,
            samples_per_rev=samples_per_rev,
            output_every=25,
            noise_variance=noise,
        )
        # The bound holds at the true amplitude, known here to 1.8 %.
        assert_allclose(track.slip_std, bound, rtol=0.06)
        assert abs(track.slip[50] + 0.0083) < 4 * bound


# The last has 26 numbers in a state, of which a block of 9 samples tells less than half.
@pytest.mark.parametrize(
    ("harmonics", "order", "block", "blocks"), [(1, 3.3, 16, 20), (2, 3.3, 16, 20), (12, 1.3, 9, 12)]
)
def test_the_smoother_is_the_optimum_that_scipy_finds(harmonics, order, block, blocks):
    # No block is above the default, 20 samples for the bandwidth and 9 or more for the slip.
    samples_per_rev, noise, change, width = 40, 0.04, 3e-4, 0.01
    rng = np.random.default_rng(2)
    n = blocks * block
    slip = 0.01 + np.cumsum(change / np.sqrt(samples_per_rev) * rng.standard_normal(n))
    phase, turn = line(slip, samples_per_rev=samples_per_rev, order=order)
    number = np.arange(1, harmonics + 1)
    x = np.sum(np.cos(np.outer(number, order * phase + turn + 0.3)), axis=0) + np.sqrt(noise) * rng.standard_normal(n)
    x[60:64] = np.nan
    track = tracked(
        x,
        phase,
        order=order,
        largest_slip=0.015,
        slip_change_per_rev=change,
        bandwidth_orders=width,
        samples_per_rev=samples_per_rev,
        harmonics=harmonics,
        output_every=block,
        noise_variance=noise,
    )
    middle = phase[track.sample_index]
    q = 2 * noise / Bandwidth(width=width / samples_per_rev, poles=1).weight ** 2 * block
    unit = np.sqrt(noise)

    def residuals(state):
        real, imaginary, mean, s = np.split(
            state.reshape(blocks, -1), harmonics * np.array([1, 2, 2]) + [0, 0, 1], axis=1
        )
        amplitude = real + 1j * imaginary
        own = np.arange(n) // block
        angle = order * (phase + s[own, 0] * (phase - middle[own]))
        model = mean[own, 0] + np.sum((amplitude[own] * np.exp(1j * np.outer(angle, number))).real, axis=1)
        half = order * np.diff(middle) / 2  # the amplitude changes half of the way between two blocks
        before, after = (np.exp(1j * np.outer(turn, number)) for turn in (half * s[:-1, 0], -half * s[1:, 0]))
        change_a = after * amplitude[1:] - before * amplitude[:-1]
        change_s = np.diff(s[:, 0]) / (change * np.sqrt(block / samples_per_rev))
        # Before the record: zero within 1000 standard deviations of the noise, and no slip within the largest.
        start = np.concatenate([np.concatenate([real[0], imaginary[0], mean[0]]) / (1e3 * unit), s[0] / 0.015])
        seen = ~np.isnan(x)
        return np.concatenate(
            [
                (x - model)[seen] / unit,
                change_a.real.ravel() / np.sqrt(q),
                change_a.imag.ravel() / np.sqrt(q),
                np.diff(mean[:, 0]) / np.sqrt(q / 2),
                change_s,
                start,
            ]
        )

    found = at_rest(track).T
    guess = np.concatenate([found.real, found.imag, np.zeros((blocks, 1)), track.slip[:, None]], axis=1).ravel()
    away = guess + 0.02 * np.random.default_rng(3).standard_normal(guess.size) * np.abs(guess)
    best = least_squares(
        residuals, away, method="trf", x_scale="jac", jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-12
    )
    known = np.delete(np.arange(guess.size).reshape(blocks, -1), -2, axis=1)  # all but the mean
    assert_allclose(guess[known], best.x[known], rtol=0, atol=1e-6)
    assert track.objective[-1] == pytest.approx(best.cost, rel=1e-9)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    stds = np.sqrt(np.diag(covariance)).reshape(blocks, -1)
    # Differences of third order leave some six digits of the derivatives.
    assert_allclose(track.slip_std, stds[:, -1], rtol=1e-5)
    assert_allclose(track.std.T**2, (stds[:, :harmonics] ** 2 + stds[:, harmonics:-2] ** 2) / 2, rtol=1e-5)


def test_the_objective_never_rises_and_an_early_end_is_said():
    x, phase, _, _ = drawn(14, revolutions=200, samples_per_rev=64, noise=10, bandwidth=0.02, change=5e-4)
    track = tracked(x, phase, bandwidth_orders=0.02, noise_variance=10.0)
    assert track.status == "converged"
    assert track.converged
    assert track.objective.size > 2
    assert np.all(np.diff(track.objective) < 0)
    early = tracked(x, phase, bandwidth_orders=0.02, noise_variance=10.0, most_iterations=2)
    assert (early.status, early.objective.size, early.converged) == ("not converged", 3, False)


def test_at_the_end_of_the_record_the_filter_agrees_with_the_smoother():
    setting = {"order": ORDER, "largest_slip": 0.02, "slip_change_per_rev": 1e-3, "noise_variance": 5e-4}
    for seed in range(5):
        x, phase, _, _ = drawn(seed, revolutions=100, samples_per_rev=32, noise=5e-4, bandwidth=0.05, change=1e-3)
        causal, smooth = (
            track_slipping_order(
                x, phase_rad=phase, bandwidth_orders=0.05, samples_per_rev=32, estimator=estimator, **setting
            )
            for estimator in ("filter", "smoother")
        )
        assert causal.status == "single pass"
        assert causal.slip_std[-1] == pytest.approx(smooth.slip_std[-1], rel=0.005)
        assert causal.std[0, -1] == pytest.approx(smooth.std[0, -1], rel=0.005)
        assert abs(causal.slip[-1] - smooth.slip[-1]) < 0.05 * smooth.slip_std[-1]
        # The phase, known to 0.01 rad, is corrected along the tangent some fifty times in the amplitude's memory,
        # which lengthens it by up to 50 x 0.01^2 / 2, half of its std of 0.005.
        assert abs(at_rest(causal)[0, -1] - at_rest(smooth)[0, -1]) < 0.5 * smooth.std[0, -1]
        # What comes later is worth as much as what came before, and more at a turn of the walk.
        assert np.median(causal.slip_std) > 1.5 * np.median(smooth.slip_std)


SWAYING_SETTING = {"order": ORDER, "largest_slip": 0.02, "slip_change_per_rev": 6e-4, "bandwidth_orders": 0.01}


def turning_line(phase, *, sway=0.005, harmonics=1, noise=1e-4):
    """A line 1 % below its order that sways in 200 revolutions; its record, and its turn by the trapezoidal rule.

    The turn is exact to (step of the sway)^2 / 12 of itself: 1e-6 rad. Harmonic k has the phase 0.4 k where turn is 0.
    """
    turning = np.abs(phase - phase[0])
    slip = -0.01 + sway * np.sin(turning / 200)
    turn = np.concatenate([[0.0], np.cumsum(ORDER * (slip[1:] + slip[:-1]) / 2 * np.diff(phase))])
    x = sum(np.cos(k * (ORDER * phase + turn + 0.4)) / k for k in range(1, harmonics + 1))
    return x + np.sqrt(noise) * np.random.default_rng(0).standard_normal(phase.size), turn


def assert_turn_is(track, turn, *, atol):
    """The slipped phase is the line's true turn since the first output, cycles and all; the rest is that of Z."""
    at = track.sample_index
    assert track.slip_phase_rad[0] == 0
    assert_allclose(track.slip_phase_rad, turn[at] - turn[at[0]], rtol=0, atol=atol)
    number = np.arange(1, len(track.complex_amplitude) + 1)
    truth = np.exp(1j * number * (0.4 + turn[at[0]])) / number
    # Phases of harmonics are k times as wrong, relative to an amplitude of 1 / k.
    assert_allclose(track.complex_amplitude, np.broadcast_to(truth[:, None], track.complex_amplitude.shape), atol=atol)


@pytest.mark.parametrize(
    ("start", "way", "harmonics", "every"),
    [(0.0, 1, 1, None), (1234.5, -1, 1, 7), (-777.0, 1, 1, 1000), (1234.5, -1, 3, None)],
)
def test_the_slipped_phase_is_the_true_turn_of_the_line(start, way, harmonics, every):
    samples_per_rev = 64
    phase = start + way * 2 * np.pi * np.arange(200 * samples_per_rev) / samples_per_rev
    x, turn = turning_line(phase, harmonics=harmonics)
    track = track_slipping_order(
        x, phase_rad=phase, samples_per_rev=samples_per_rev, harmonics=harmonics, output_every=every, **SWAYING_SETTING
    )
    # A walk of 6e-4 a revolution seen in noise 1e-4 of the line's square: some 0.003 rad of the fundamental's phase. A
    # block too early or too late is 0.05 rad where the line sways.
    assert_turn_is(track, turn, atol=0.02)
    assert abs(track.slip_phase_rad[-1]) > 80


@pytest.mark.parametrize("estimator", ["smoother", "filter"])
def test_the_slipped_phase_of_a_shaft_that_speeds_up_and_slows_down(estimator):
    samples_per_rev = 128
    n = np.arange(200 * samples_per_rev)
    phase = 5.0 + 2 * np.pi * (n / samples_per_rev + 20 * np.sin(2 * np.pi * n / n.size))
    x, turn = turning_line(phase)
    track = track_slipping_order(
        x, phase_rad=phase, samples_per_rev=samples_per_rev, estimator=estimator, **SWAYING_SETTING
    )
    # The filter knows the first slip no better than the search has it, and does not come back to it.
    assert_turn_is(track, turn, atol=0.02 if estimator == "smoother" else 0.5)


@pytest.mark.parametrize(("harmonics", "noise"), [(1, 1.0), (3, 4.0)])
def test_errors_are_within_the_stated_uncertainty(harmonics, noise):
    inside = []
    for seed in range(40 if harmonics == 1 else 15):
        x, phase, slip, truth = drawn(
            seed, revolutions=100, samples_per_rev=64, noise=noise, bandwidth=0.05, change=5e-4, harmonics=harmonics
        )
        track = tracked(x, phase, bandwidth_orders=0.05, harmonics=harmonics, noise_variance=noise)
        assert track.status == "converged"
        true, found = truth[:, track.sample_index], at_rest(track)
        inside.append(
            [
                np.mean(np.abs(np.abs(found) - np.abs(true)) < 1.96 * track.amplitude_std),
                np.mean(np.abs(np.angle(found / true)) < 1.96 * track.phase_std_rad),
                np.mean(np.abs(track.slip - slip[track.sample_index]) < 1.96 * track.slip_std),
            ]
        )
    # Each record holds some 5 independent amplitudes a harmonic and more slips: 200 in all, 95 % +- 1.5 %.
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 0.03)


@pytest.mark.parametrize("gap_revolutions", [10, 60])
def test_across_a_gap_the_uncertainty_grows_and_the_line_is_found_again(gap_revolutions):
    inside = []
    for seed in range(12):
        x, phase, slip, truth = drawn(seed, revolutions=200, samples_per_rev=64, noise=1, bandwidth=0.02, change=5e-4)
        gap = slice(90 * 64, (90 + gap_revolutions) * 64)
        x[gap] = np.nan
        track = tracked(x, phase, largest_slip=0.04, bandwidth_orders=0.02, output_every=32)
        assert track.status == "converged"
        at = track.sample_index
        within, after = (at >= gap.start) & (at < gap.stop), at >= gap.stop + 10 * 64
        for std in (track.slip_std, track.amplitude_std[0], track.phase_std_rad[0]):
            assert std[within].max() > 1.2 * np.median(std[~within])
        if gap_revolutions == 60:
            # In 30 revolutions from either side the slip walks by 5e-4 sqrt(30), the phase by several turns.
            assert track.slip_std[within].max() > 1.5e-3
            assert track.phase_std_rad[0, within].max() > 1
        assert np.all(np.abs(track.slip - slip[at])[after] < 5 * track.slip_std[after])
        assert np.all(np.abs(np.abs(track.complex_amplitude[0]) - np.abs(truth[0, at]))[after] < 0.25)
        inside.append(np.abs(track.slip - slip[at])[within] < 1.96 * track.slip_std[within])
    # 12 gaps with one to a few independent slips each.
    assert 0.85 < np.mean(inside) <= 1


@pytest.mark.parametrize("end", [0.015, 0.04])
def test_a_slip_beyond_the_bound_has_a_status_of_its_own(end):
    slip = np.linspace(0, end, 20_000)
    phase, turn = line(slip, samples_per_rev=64)
    x = np.cos(ORDER * phase + turn) + np.random.default_rng(0).standard_normal(slip.size)
    track = track_slipping_order(
        x, phase_rad=phase, order=ORDER, largest_slip=0.02, slip_change_per_rev=1e-3, bandwidth_orders=0.02,
        samples_per_rev=64,
    )  # fmt: skip
    assert track.status == ("converged" if end < 0.02 else "slip at its bound")
    assert track.converged == (end < 0.02)


@pytest.mark.parametrize(("change", "status"), [(1e-3, "converged"), (4e-3, "slip faster than declared")])
def test_a_slip_faster_than_declared_has_a_status_of_its_own(change, status):
    setting = {"order": ORDER, "largest_slip": 0.1, "slip_change_per_rev": 1e-3, "samples_per_rev": 64}
    for seed in range(5):
        x, phase, *_ = drawn(seed, revolutions=100, samples_per_rev=64, noise=0.5, bandwidth=0.1, change=change)
        track = track_slipping_order(x, phase_rad=phase, bandwidth_orders=0.1, **setting)
        assert track.status == status


def test_a_run_up_in_time_and_a_shaft_that_turns_backwards():
    rate = 2000.0
    t = np.arange(20000) / rate
    phase = 2 * np.pi * (20 * t + 1.5 * t**2)  # 20 to 50 Hz
    slip = -0.008 + 0.004 * np.sin(0.5 * t)
    turn = np.concatenate([[0.0], np.cumsum(ORDER * slip[:-1] * np.diff(phase))])
    x = 2 * np.cos(ORDER * phase + turn + 1) + 0.5 * np.random.default_rng(0).standard_normal(t.size)
    setting = {"order": ORDER, "largest_slip": 0.02, "slip_change_per_rev": 5e-4, "bandwidth_hz": 1, "rate_hz": rate}
    track = track_slipping_order(x, phase_rad=phase, **setting)
    at = track.sample_index
    assert_allclose(np.abs(track.complex_amplitude[0]), 2, rtol=0.05)  # about four std
    assert np.mean(np.abs(track.slip - slip[at]) < 1.96 * track.slip_std) > 0.9
    assert_allclose(np.angle(at_rest(track)[0] * np.exp(-1j * (turn[at] + 1))), 0, atol=0.15)
    back = track_slipping_order(x, phase_rad=-phase, **setting)
    assert_allclose(back.complex_amplitude, np.conj(track.complex_amplitude), atol=1e-6)
    assert_allclose(back.slip, track.slip, atol=1e-9)


GOOD = {
    "x": np.cos(np.arange(200) * 0.5) + np.random.default_rng(0).standard_normal(200),
    "phase_rad": np.arange(200) * 0.25,
    "order": 2.0,
    "largest_slip": 0.02,
    "slip_change_per_rev": 1e-3,
    "bandwidth_orders": 0.1,
    "samples_per_rev": 25.0,
}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"phase_rad": np.arange(199)}, "phase_rad has 199 values for 200 samples of x; give one angle per sample"),
        ({"phase_rad": np.zeros(200)}, "phase_rad turns by 0 rad in all.* the shaft has turned too little"),
        ({"x": np.zeros(200)}, "no noise on both sides of order 2.* pass noise_variance"),
        ({"largest_slip": 2}, "largest_slip=2 is relative to the order and must be below 1; 2 % is 0.02"),
        ({"order": 12.4}, "order 12.4 with a slip of 0.02 turns by 3.162 rad between samples .* half of the rate"),
        ({"harmonics": 0}, "harmonics=0 must be a whole number from 1 to 16"),
        ({"bandwidth_orders": 13}, "bandwidth_orders=13 must be above 0 and below 12.5"),
        ({"estimator": "smother"}, "estimator='smother' is unknown.* Did you mean 'smoother'"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(change, sentence):
    arguments = GOOD | change
    with pytest.raises(ValueError, match=sentence):
        track_slipping_order(arguments.pop("x"), **arguments)


@pytest.fixture(scope="module")
def turbine_envelope(real_data):
    """Envelope of 9 to 11 kHz over angle, its mean taken out: the bearing's lines are in it."""
    record = loadmat(real_data / "wt_hss_bearing" / "data-20130425T232202Z.mat")
    phase = shaft_phase(record["tach"].ravel(), pulses_per_rev=2)
    demodulated = envelope(record["vibration"].ravel(), rate_hz=97656, band_hz=(9000, 11000))
    return angular_resample(demodulated, rate_hz=97656, phase=phase, samples_per_rev=256)


def test_the_inner_race_of_a_wind_turbine_slips_by_one_per_cent(turbine_envelope):
    spectrum = order_spectrum(turbine_envelope)
    near = np.abs(spectrum.axis - 9.46) < 0.2
    height = spectrum.amplitude[near].max()
    x = turbine_envelope.values - turbine_envelope.values.mean()
    setting = {"phase_rad": turbine_envelope.angle_rad, "bandwidth_orders": 0.02, "samples_per_rev": 256}
    track = track_slipping_order(x, order=9.46, largest_slip=0.02, slip_change_per_rev=1e-3, **setting)
    assert track.status == "converged"
    assert track.false_alarm_probability < 1e-50
    # The line of the spectrum lies at 9.366 +- 0.02 by the record's own description.
    assert 9.46 * (1 + track.slip.mean()) == pytest.approx(9.366, abs=0.02)
    # A line that slips by a bin or two over the record is smeared there: its amplitude is a little low.
    amplitude = np.abs(track.complex_amplitude[0])
    assert height * 0.95 < amplitude.mean() < height * 1.15
    assert amplitude.std() < 0.2 * amplitude.mean()
    assert np.ptp(9.46 * track.slip) < 0.05
    plain = track_orders(x, orders=[9.46], output_every=64, **setting)
    assert np.abs(plain.complex_amplitude).mean() < 0.2 * height
