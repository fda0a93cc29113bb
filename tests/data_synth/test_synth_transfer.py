from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, lsim

from data_synth.transfer import MeasuredPath, ModalPath

RATE = 20_000.0
PATH = ModalPath(
    frequencies_hz=np.array([800.0, 3000.0]),
    damping_ratios=np.array([0.02, 0.05]),
    residues=np.array([1.0 - 2.0j, 0.5j]),
)


def test_the_response_is_that_of_an_oscillator():
    # displacement of m x'' + c x' + k x = F: 1 / (k - m w^2 + j c w); residue -j / (2 m w_d)
    mass, damper, spring = 2.0, 40.0, 5e6
    natural = np.sqrt(spring / mass)
    zeta = damper / (2 * mass * natural)
    residue = -0.5j / (mass * natural * np.sqrt(1 - zeta**2))
    path = ModalPath(
        frequencies_hz=np.array([natural / 2 / np.pi]),
        damping_ratios=np.array([zeta]),
        residues=np.array([residue]),
    )
    frequency = np.array([0.0, 100.0, 251.0, 900.0])
    omega = 2 * np.pi * frequency
    assert_allclose(path.response(frequency), 1 / (spring - mass * omega**2 + 1j * damper * omega), rtol=1e-12)
    # an impulse is a start at 1 / m
    times = np.linspace(0, 0.05, 30)
    exact = solve_ivp(
        lambda _, y: [y[1], -(damper * y[1] + spring * y[0]) / mass],
        (0, 0.05),
        [0, 1 / mass],
        t_eval=times,
        rtol=1e-11,
        atol=1e-16,
    ).y[0]
    assert_allclose(path.impulse(times), exact, atol=1e-9 * np.max(np.abs(exact)))
    assert path.impulse(-1e-9) == 0


def blocks(data, sizes):
    edges = np.cumsum([0, *sizes, len(data)])
    return [data[a:b] for a, b in pairwise(edges) if a < len(data)]


def test_a_sampled_force_is_linear_between_its_samples():
    # lsim steps a state space of real matrices with the matrix exponential, linear between samples
    force = np.random.default_rng(0).standard_normal(400)
    dynamics, drive, read = [], [], []
    for pole, residue in zip(PATH.poles, PATH.residues, strict=True):
        dynamics.append(np.array([[pole.real, -pole.imag], [pole.imag, pole.real]]))
        drive.append([1.0, 0.0])
        read.append([2 * residue.real, -2 * residue.imag])
    a = np.zeros((4, 4))
    a[:2, :2], a[2:, 2:] = dynamics
    system = StateSpace(a, np.concatenate(drive)[:, None], np.concatenate(read)[None], np.zeros((1, 1)))
    expected = lsim(system, force, np.arange(400) / RATE)[1]
    found = PATH.force_filter(rate_hz=RATE).push(force)
    assert_allclose(found, expected, atol=1e-11 * np.max(np.abs(expected)))


def test_slow_modes_keep_their_digits():
    # a mode at a thousandth of a millionth of the rate, where the weights of the recursion would cancel: for a constant
    # force its response is the integral of the impulse response
    path = ModalPath(frequencies_hz=np.array([1e-5]), damping_ratios=np.array([0.5]), residues=np.array([1.0 + 0.3j]))
    found = path.force_filter(rate_hz=1e4).push(np.ones(1000))
    times = np.arange(1000) / 1e4
    pole, residue = path.poles[0], path.residues[0]
    assert_allclose(found, 2 * (residue * np.expm1(pole * times) / pole).real, rtol=1e-10, atol=1e-18)


def test_blocks_of_any_size_make_one_record():
    force = np.random.default_rng(1).standard_normal(1000)
    whole = PATH.force_filter(rate_hz=RATE).push(force)
    running = PATH.force_filter(rate_hz=RATE)
    parts = [running.push(block) for block in blocks(force, [1, 0, 37, 400])]
    assert_allclose(np.concatenate(parts), whole, atol=1e-12)


def test_impacts_ring_from_their_very_instant():
    struck = np.array([-0.004, -1e-5, 0.0, 0.0123456789, 0.0129, 0.02, 0.0499])
    size = np.array([1.0, 2.0, -1.0, 0.5, 1.5, 4.0, 1.0])
    times = np.arange(1000) / RATE
    expected = sum(value * PATH.impulse(times - at) for at, value in zip(struck, size, strict=True))
    whole = PATH.impact_filter(rate_hz=RATE).push(struck, size, samples=1000)
    assert_allclose(whole, expected, atol=1e-11)
    running, found = PATH.impact_filter(rate_hz=RATE), []
    for start, stop in ((0, 10), (10, 260), (260, 1000)):
        first = np.maximum(np.ceil(struck * RATE), 0)
        now = (first >= start) & (first < stop)
        found.append(running.push(struck[now], size[now], samples=stop - start))
    assert_allclose(np.concatenate(found), expected, atol=1e-11)
    assert np.all(np.abs(PATH.impulse([PATH.ring_seconds(), 2.0])) < 1e-11 * np.max(np.abs(PATH.impulse(times))))
    with pytest.raises(ValueError, match="do not belong to the block"):
        running.push([0.01], [1.0], samples=10)


SMOOTH = ModalPath(
    frequencies_hz=PATH.frequencies_hz, damping_ratios=PATH.damping_ratios, residues=np.array([-2j, -1j])
)


def measured(spacing=2.0, highest=10_000.0, path=PATH, delay=0.0):
    frequency = np.arange(0, highest + spacing / 2, spacing)
    return MeasuredPath(
        frequencies_hz=frequency, values=path.response(frequency) * np.exp(-2j * np.pi * frequency * delay)
    )


def test_a_measured_path_responds_as_it_was_measured():
    # displacement-like, so that little is lost at half the rate: residues -j alike
    fir = measured(path=SMOOTH).fir(rate_hz=RATE, taps=2048)
    assert 0 <= fir.delay_s < 30 / RATE
    assert fir.left_out < 2e-3
    frequency = np.array([100.0, 790.0, 1500.0, 3000.0, 6000.0])
    waves = np.exp(-2j * np.pi * np.outer(frequency, np.arange(fir.taps.size) / RATE))
    found = waves @ fir.taps * np.exp(2j * np.pi * frequency * fir.delay_s)
    largest = np.max(np.abs(SMOOTH.response([790.0])))
    # a line of 2 Hz against a half width of 16 Hz: interpolated to (2 / 16)^2 / 8 = 0.2 % of the peak
    assert_allclose(found, SMOOTH.response(frequency), atol=4e-3 * largest)


def test_a_path_with_a_travel_time_needs_no_further_delay():
    late = measured(path=SMOOTH, delay=0.002).fir(rate_hz=RATE, taps=2048)
    assert late.delay_s == 0
    at_once = measured(path=SMOOTH).fir(rate_hz=RATE, taps=2048)
    # the transform of the two is the same, 40 samples apart
    shift = 40 - round(at_once.delay_s * RATE)
    assert_allclose(late.taps[shift:], at_once.taps[: at_once.taps.size - shift], atol=5e-3 * np.max(late.taps))


def test_filters_by_taps_are_convolutions_in_blocks():
    fir = measured().fir(rate_hz=RATE, taps=1500, leakage=0.01)
    force = np.random.default_rng(2).standard_normal(4000)
    expected = np.convolve(force, fir.taps)[:4000]
    running = fir.filter()
    found = np.concatenate([running.push(block) for block in blocks(force, [1, 0, 700, 2000])])
    assert_allclose(found, expected, atol=1e-10)


def test_nothing_lies_outside_of_what_was_measured():
    path = MeasuredPath(frequencies_hz=np.array([100.0, 200.0]), values=np.array([1.0, 1j]))
    assert_allclose(path.response([50, 100, 150, 200, 250]), [0, 1, 0.5 + 0.5j, 1j, 0])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: measured().fir(rate_hz=RATE, taps=20), "taps = 20 leave out"),
        (lambda: measured().fir(rate_hz=RATE, taps=1), "taps = 1"),
        (lambda: PATH.force_filter(rate_hz=RATE).push([1.0, np.nan]), "never forget"),
        (lambda: PATH.impact_filter(rate_hz=RATE).push([np.nan], [1.0], samples=3), "never forget"),
        (lambda: MeasuredPath(frequencies_hz=np.array([1.0, 0.5]), values=np.ones(2)), "has to rise"),
        (lambda: MeasuredPath(frequencies_hz=np.array([1.0, 2.0]), values=np.array([1, np.nan])), "NaN"),
        (lambda: MeasuredPath(frequencies_hz=np.ones(1), values=np.ones(1)), "give two alike"),
        (
            lambda: ModalPath(frequencies_hz=np.ones(2), damping_ratios=np.ones(1), residues=np.ones(2)),
            "give one of each",
        ),
        (
            lambda: ModalPath(frequencies_hz=np.ones(1), damping_ratios=np.zeros(1), residues=np.ones(1)),
            "never forgets",
        ),
        (
            lambda: ModalPath(frequencies_hz=np.zeros(1), damping_ratios=np.ones(1) / 2, residues=np.ones(1)),
            "above zero",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()
