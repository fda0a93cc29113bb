"""Harmonic balance against dense solutions, and where no motion is periodic."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from data_synth.fidelity.harmonic_balance import Balance, Modes, Varying

STEP_HZ, SPEED_HZ = 0.5, 5.0


def one_mode(pole, gains, waves, lines):
    """Balance of one mode at 5 Hz of base order 1, with gains at half of a Hz from each other."""
    residue = -(abs(pole) ** 2) / (2j * pole.imag)
    return Balance.at(
        SPEED_HZ,
        base=Fraction(1),
        gains=gains[None, None],
        step_hz=STEP_HZ,
        varying=Varying(waves=waves, lines=lines),
        modes=Modes(
            poles=np.array([pole]), deflections=np.array([[2 * residue]]), inputs=np.ones((1, 1), dtype=complex)
        ),
        bound=1e-5,
    )


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
    found = one_mode(pole, gains, waves, coefficients[None, 1 : lines + 1]).solved(
        spectrum[None, None], np.zeros((1, 1, lines), dtype=np.complex64)
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


@pytest.mark.parametrize(("share", "parts"), [(0.3, False), (0.45, True), (0.6, True)])
def test_teeth_that_part_have_the_lines_of_an_integration(share, parts):
    """One mode at 200 Hz, its stiffness varying at 150 Hz, under a constant force, from scipy's own solver.

    Tooth forces whose largest is 4 times their mean differ by 0.7 %; those of teeth that hold by more than they are.
    """
    lines, damping, static = 150, 0.05, 2.0
    pole = 2 * np.pi * 200 * (-damping + 1j * np.sqrt(1 - damping**2))
    residue = -(abs(pole) ** 2) / (2j * pole.imag)
    s = 2j * np.pi * STEP_HZ * np.arange(4096)
    points = 3 * lines + 3
    coefficients = np.zeros(points // 2 + 1, dtype=np.complex64)
    coefficients[30] = share * points / 2
    waves = np.fft.irfft(coefficients, points)[None].astype(np.float32)
    gains = residue / (s - pole) - residue / (s - pole.conjugate())
    balance = one_mode(pole, gains, waves, coefficients[None, 1 : lines + 1])
    excitation = static * coefficients[None, 1 : lines + 1] / (points / 2)
    held = balance.solved(excitation[None], np.zeros((1, 1, lines), dtype=np.complex64))[0]
    found = balance.parted(excitation, held, np.array([static]), may_part=np.array([True]))
    assert (found is not None) == parts
    forces = held if found is None else found
    tooth_force = (balance.deflections(forces[None])[0] + forces)[0]

    def force(at_s, u):
        return (1 + share * np.cos(2 * np.pi * 150 * at_s)) * np.maximum(u, 0.0)

    def motion(at_s, x):
        return [x[1], abs(pole) ** 2 * (static - force(at_s, x[0])) + 2 * pole.real * x[1]]

    times_s = 0.4 + 0.2 * np.arange(4096) / 4096
    own = solve_ivp(motion, (0.0, times_s[-1]), [static, 0.0], t_eval=times_s, rtol=1e-8, atol=1e-9, max_step=2e-4)
    expected = 2 * np.fft.rfft(force(times_s, own.y[0]))[1 : lines + 1] / 4096
    assert np.linalg.norm(tooth_force - expected) < (0.01 if parts else 1e-3) * np.linalg.norm(expected)
    if parts:
        lost = (balance.deflections(held[None])[0] + held)[0] - expected
        assert np.linalg.norm(lost) > np.linalg.norm(expected)
