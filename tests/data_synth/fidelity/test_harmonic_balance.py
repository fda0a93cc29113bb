"""Harmonic balance against dense solutions, and where no motion is periodic."""

from fractions import Fraction

import numpy as np
import pytest

from data_synth.fidelity.harmonic_balance import Modes, Varying, balanced

STEP_HZ, SPEED_HZ = 0.5, 5.0


def balance_of_one_mode(lines, *, varying, damping):
    """Exciting force of two lines on one mode at 200 Hz, static gain -1, at base order 1; p, and its dense solution."""
    pole = 2 * np.pi * 200 * (-damping + 1j * np.sqrt(1 - damping**2))
    residue = -(abs(pole) ** 2) / (2j * pole.imag)  # of -w^2 / (s^2 + 2 damping w s + w^2)
    s = 2j * np.pi * STEP_HZ * np.arange(4096)
    gains = residue / (s - pole) - residue / (s - pole.conjugate())
    spectrum = np.zeros(lines, dtype=np.complex64)
    spectrum[[4, 9]] = 1 + 1j, -2
    points = 3 * lines + 3
    coefficients = np.zeros(points // 2 + 1, dtype=np.complex64)
    coefficients[1 : varying.size + 1] = varying * points / 2
    waves = np.fft.irfft(coefficients, points)[None].astype(np.float32)
    found = balanced(
        spectrum[None, None],
        np.zeros((1, 1, lines), dtype=np.complex64),
        SPEED_HZ,
        gains=gains[None, None],
        varying_of=lambda _base, count: Varying(waves=waves, lines=coefficients[None, 1 : count + 1]),
        modes=Modes(
            poles=np.array([pole]), deflections=np.array([[2 * residue]]), inputs=np.ones((1, 1), dtype=complex)
        ),
        base=Fraction(1),
        step_hz=STEP_HZ,
        bound=1e-5,
    )[0, 0]
    # coefficients of exp(j n theta), n from -lines to lines, none at zero
    n = np.r_[-lines:0, 1 : lines + 1]
    two_sided = np.zeros(4 * lines + 1, dtype=complex)
    two_sided[2 * lines + 1 : 2 * lines + 1 + varying.size] = varying / 2
    two_sided += two_sided[::-1].conj()
    v = two_sided[np.subtract.outer(n, n) + 2 * lines]
    v = v - np.outer(two_sided[n + 2 * lines], two_sided[2 * lines - n])  # the mean force stays
    one_sided = gains[(np.arange(1, lines + 1) * SPEED_HZ / STEP_HZ).astype(int)]
    gain = np.concatenate([one_sided[::-1].conj(), one_sided])
    right = np.concatenate([spectrum[::-1].conj(), spectrum]) / 2
    return found, 2 * np.linalg.solve(np.eye(2 * lines) - v * gain, right)[lines:]


@pytest.mark.parametrize("damping", [0.01, 0.05, 0.5])
def test_sweeps_find_the_dense_solution(damping):
    """Of lines up to three times the frequency of the mode, which the stiffness couples."""
    found, dense = balance_of_one_mode(120, varying=np.array([0.1j, 0, 0.05, 0, 0.15]), damping=damping)
    assert np.linalg.norm(found - dense) < 1e-4 * np.linalg.norm(dense)
    assert np.linalg.norm(dense) > 1.05 * np.sqrt(6)  # the stiffness makes lines of its own


@pytest.mark.parametrize("share", [0.4, 0.6])  # squares of the first leave the range of numbers, then all
def test_a_stiffness_that_excites_vibration_which_grows_has_lines_within_the_range_of_numbers(share):
    """At twice the mode's frequency, 80 orders, with 1 % of damping: no motion is periodic."""
    varying = np.zeros(80, dtype=complex)
    varying[-1] = share
    found, _ = balance_of_one_mode(120, varying=varying, damping=0.01)
    assert np.isfinite(found).all()
